/* render: the library from the command line. Volumes (raw, NRRD, MetaImage, NIfTI, NPY, OpenVDB, NanoVDB), particles
   and OBJ meshes in; PNG, PFM, OpenEXR, Radiance HDR and statistics out. Exit status: 0 done; 1 the render failed; 2 an
   option or a file was wrong. The last two with one line on stderr. */

#include "part.h"
#include "render_scene.h"
#include "results.h"

#include <inttypes.h>

/* ================================================================================================= reports */

/* clang-format does not come to rest on these lists. */
/* clang-format off */
#define PLAN_COUNTS(X)                                                                                                 \
    X(sweep_count) X(color_channels) X(sheet_channels) X(slab_count) X(shadow_width) X(shadow_height)                  \
    X(light_points) X(eye_gathered) X(light_gathered) X(cells_gathered) X(range_calls) X(read_calls)                   \
    X(eval_calls) X(triangle_calls) X(particle_calls) X(projector_calls) X(voxels_read) X(bytes)
/* clang-format on */

/* What was chosen for a budget, in one line. */
static void print_budget(FILE *file, const sps_budget_report *budget) {
    fprintf(file, "about %.3g s, error up to %.2g %%: quality %s, slab %.3g, tolerance %g", budget->seconds,
            100 * budget->error, ex_quality_names[budget->quality], budget->slab_thickness, (double)budget->tolerance);
    if (budget->samples) fprintf(file, ", light-samples %d", budget->samples);
    if (budget->scattering_resolution) fprintf(file, ", scattering-resolution %d", budget->scattering_resolution);
    fprintf(file, ", size %d,%d", budget->width, budget->height);
    fprintf(file, budget->is_met ? "\n" : "; the budget is not met\n");
}

static int print_plan(const arguments *all, ex_session *session, const sps_scene *scene, const sps_view *view,
                      ex_error *error) {
    sps_plan_report plan;
    const sps_result result = sps_plan(session->context, scene, view, &plan);
    if (result != SPS_OK) return explain(all, session, result, error);
    printf("%-16s %-9s %14s  %s\n", "pass", "runs", "bytes", "why");
    for (int i = 0; i < SPS_PASS_COUNT; ++i) {
        char runs[16] = "left out";
        if (plan.pass[i].runs) snprintf(runs, sizeof runs, "%d", plan.pass[i].runs);
        printf("%-16s %-9s %14zu  %s\n", sps_pass_name((sps_pass)i), runs, plan.pass[i].bytes, plan.pass[i].reason);
    }
#define PRINT_COUNT(field) printf("%-16s %" PRIu64 "\n", #field, (uint64_t)plan.field);
    PLAN_COUNTS(PRINT_COUNT)
#undef PRINT_COUNT
    printf("%-16s %s\n%-16s %s\n", "eye_filling", plan.eye_filling, "light_filling", plan.light_filling);
    printf("%-16s %s\n", "cells_filling", plan.cells_filling);
    if (all->budget_seconds > 0 || all->budget_error > 0)
        printf("%-16s ", "budget"), print_budget(stdout, &plan.budget);
    printf("%-16s %d\n", "tables_made",
           has_maps(all) && !shadow_is(all, "table") ? 0 : plan.pass[SPS_PASS_LIGHT_MAPS].runs);
    return 0;
}

/* clang-format off */
#define STATS_REALS(X)                                                                                               \
    X(seconds_gather) X(seconds_polygons) X(seconds_textures) X(seconds_tree) X(seconds_shadow_rays) X(seconds_bin)    \
    X(seconds_light) X(seconds_cells) X(seconds_eye) X(seconds_total) X(scattering_bound)
#define STATS_COUNTS(X)                                                                                                \
    X(range_calls) X(read_calls) X(eval_calls) X(triangle_calls) X(particle_calls) X(projector_calls)                  \
    X(background_calls) X(shade_calls) X(blocks_skipped)                                                               \
    X(voxels_read) X(voxels_relevant) X(bricks) X(values_replaced)                                                     \
    X(triangles) X(triangles_degenerate) X(pixels_of_polygons) X(surface_points) X(layers) X(shadow_rays)              \
    X(particles) X(slabs) X(slabs_empty)                                                                               \
    X(eye_footprints) X(eye_fragments) X(light_footprints) X(light_fragments)                                          \
    X(eye_samples) X(light_samples)                                                                                    \
    X(tables_made) X(tables_held) X(cells) X(soft_texels) X(pixels_shaded) \
    X(tiles_finished) X(allocations) X(bytes) X(bytes_peak)
/* clang-format on */

static int write_stats(const char *path, const sps_context *context, ex_error *error) {
    sps_stats_report stats;
    ex_output output;
    if (ex_output_begin(&output, path, error)) return 1;
    sps_get_stats(context, &stats);
    fputs("{\n", output.file);
#define WRITE_SECONDS(field) fprintf(output.file, "  \"%s\": %.9g,\n", #field, stats.field);
#define WRITE_COUNT(field)   fprintf(output.file, "  \"%s\": %" PRIu64 ",\n", #field, (uint64_t)stats.field);
    STATS_REALS(WRITE_SECONDS)
    STATS_COUNTS(WRITE_COUNT)
#undef WRITE_SECONDS
#undef WRITE_COUNT
    if (stats.budget.seconds > 0)
        fprintf(output.file, "  \"budget\": {\"seconds\": %.9g, \"error\": %.9g, \"is_met\": %d},\n",
                stats.budget.seconds, stats.budget.error, stats.budget.is_met);
    fprintf(output.file, "  \"version\": %d\n}\n", sps_version());
    errno = 0;
    ex_output_note(&output, ferror(output.file) || fflush(output.file) != 0);
    return ex_output_end(&output, error);
}

/* ================================================================================================= parts */

/* Adds a line, in which no other begins. */
static void add_line(picture_text *lines, const char *text) {
    for (;; ++text) {
        lines->text = (char *)ex_grow(lines->text, lines->length, &lines->capacity, 1);
        lines->text[lines->length++] = *text && *text != '\n' ? *text : *text ? '?' : '\n';
        if (!*text) return;
    }
}

/* Adds an option whose value is or ends with a file. What counts is what is in the file, and its name without folders,
   which may differ between machines. */
static int add_file(picture_text *lines, const char *option, const char *path, ex_error *error) {
    char line[400];
    const char *slash = strrchr(path, '/');
    uint32_t checksum = 0;
    uint64_t size = 0;
    if (ex_file_checksum(path, &checksum, &size, error)) return 1;
    snprintf(line, sizeof line, "%s %s: checksum %08x, %llu bytes", option, ex_quoted(slash ? slash + 1 : path).text,
             checksum, (unsigned long long)size);
    add_line(lines, line);
    return 0;
}

/* Adds an option. Those that do not change the picture are left out. */
static int add_setting_line(picture_text *lines, const setting *given, ex_error *error) {
    static const char *const no_matter[] = {"--part",       "--threads", "--max-bytes", "--out",
                                            "--exr-type",   "--plan",    "--stats",     "--exr-compression",
                                            "--list-grids", "--help",    NULL};
    const char *name = given->rule->name, *value = given->value ? given->value : "";
    const char *image = given->rule->apply == add_light ? find_image(value) : NULL;
    if (ex_find_name(no_matter, name) >= 0) return 0;
    if (given->rule->form && strncmp(given->rule->form, "FILE", 4) == 0) return add_file(lines, name, value, error);
    if (image && add_file(lines, name, image, error)) return 1;
    char *line = (char *)ex_allocate(strlen(name) + strlen(value) + 2, 1);
    const size_t length = image ? (size_t)(image - value) : strlen(value);
    sprintf(line, "%s %.*s", name, (int)length, value);
    add_line(lines, line);
    free(line);
    return 0;
}

/* Adds a file that another names, which holds its voxels. */
static int add_detached(picture_text *lines, const char *path, const char *detached, ex_error *error) {
    if (!*detached || ex_same_file(path, detached)) return 0;
    return add_file(lines, "voxels of", detached, error);
}

/* Describes the picture by all that decides what it looks like, before anything is read: files may change while it is
   rendered. */
static int describe_picture(arguments *all, ex_error *error) {
    picture_text *lines = &all->described;
    for (size_t i = 0; i < all->settings->count; ++i)
        if (add_setting_line(lines, &all->settings->list[i], error)) return 1;
    for (int i = 0; i < all->volume_count; ++i) {
        const volume_arguments *volume = &all->volumes[i];
        const char *const colors[2] = {volume->albedo_file, volume->emission_file};
        if (add_detached(lines, volume->file, volume->voxels.path, error)) return 1;
        for (int k = 0; k < 2; ++k) {
            ex_volume_file file;
            if (!colors[k]) continue;
            if (ex_volume_file_read(&file, colors[k], error)) return 1;
            if (add_detached(lines, colors[k], file.voxels.path, error)) return 1;
        }
    }
    return 0;
}

static int write_part(const arguments *all, const ex_exr *picture, const sps_image *image, ex_error *error) {
    char build[1000];
    ex_part part;
    memset(&part, 0, sizeof part);
    part.path = all->out;
    part.width = picture->width, part.height = picture->height;
    part.number = all->part[0], part.count = all->part[1];
    part.screen_width = picture->screen_width;
    ex_part_build(build, sizeof build);
    part.build = build, part.build_size = strlen(build);
    part.options = all->described.text, part.options_size = all->described.length;
    return ex_write_part(&part, image->rgba, image->depth, error);
}

/* Renders the rows of one part. */
static void choose_rows(arguments *all) {
    const ex_part part = {.height = all->height, .count = all->part[1]};
    const int top = ex_part_row(&part, all->part[0]), below = ex_part_row(&part, all->part[0] + 1);
    const int region[4] = {0, top, all->width, below - top};
    memcpy(all->region, region, sizeof region);
}

/* ============================================================================================ the program */

/* Writes the picture, or the part of it. */
static int write_picture(const arguments *all, const sps_view *view, const sps_image *image, ex_error *error) {
    const ex_results files = {all->out, all->pfm, all->alpha_pfm, all->exr, all->radiance_hdr};
    ex_exr picture;
    memset(&picture, 0, sizeof picture);
    picture.rgba = image->rgba, picture.depth = image->depth;
    picture.width = view->width, picture.height = view->height;
    memcpy(picture.region, view->region, sizeof picture.region);
    picture.screen_width = 2 * tan(0.5 * view->camera.field_of_view) * view->width / view->height;
    picture.is_float = strcmp(exr_type_names[all->exr_type], "float") == 0;
    picture.zip = strcmp(exr_compression_names[all->exr_compression], "zip") == 0;
    if (has(all->given, "--part")) return write_part(all, &picture, image, error);
    return ex_write_results(&files, &picture, error);
}

static int write_files(const arguments *all, const ex_session *session, const sps_view *view, const sps_image *image,
                       ex_error *error) {
    if (write_picture(all, view, image, error)) return 1;
    return all->stats ? write_stats(all->stats, session->context, error) : 0;
}

/* Moves rows together where a budget has shrunk the picture. */
static void pack_rows(const sps_image *image, const sps_budget_report *shown, sps_view *view) {
    const size_t from = (size_t)view->width, to = (size_t)shown->width;
    view->width = shown->width, view->height = shown->height;
    for (size_t y = 1; y < (size_t)shown->height; ++y) {
        memmove(image->rgba + 4 * y * to, image->rgba + 4 * y * from, 4 * to * sizeof *image->rgba);
        if (image->depth) memmove(image->depth + y * to, image->depth + y * from, to * sizeof *image->depth);
    }
}

/* Returns the exit status. */
static int render(const arguments *all, ex_session *session, const sps_scene *scene, const sps_view *view,
                  ex_error *error) {
    sps_image image;
    sps_reference_settings reference;
    sps_stats_report stats;
    sps_view shown = *view;
    const size_t width = (size_t)(view->region[2] ? view->region[2] : view->width);
    const size_t height = (size_t)(view->region[2] ? view->region[3] : view->height);
    memset(&image, 0, sizeof image);
    memset(&reference, 0, sizeof reference);
    reference.step = all->slab > 0 ? all->slab : 0.5;
    reference.samples = all->samples;
    image.rgba = (float *)ex_allocate(width * height, 4 * sizeof *image.rgba);
    if (all->exr || has(all->given, "--part")) image.depth = (float *)ex_allocate(width * height, sizeof *image.depth);
    const sps_result result = is_marched(all) ? sps_reference(session->context, scene, view, &reference, &image)
                                              : sps_render(session->context, scene, view, &image);
    ex_progress_end(&session->progress);
    sps_get_stats(session->context, &stats);
    if (result == SPS_OK && all->budget_scale_min > 0 && !is_marched(all)) pack_rows(&image, &stats.budget, &shown);
    int status = EX_OK;
    if (result != SPS_OK)
        status = explain(all, session, result, error);
    else if (write_files(all, session, &shown, &image, error))
        status = EX_MISTAKEN;
    if (result == SPS_OK && (all->budget_seconds > 0 || all->budget_error > 0) && !is_marched(all)) {
        fprintf(stderr, "render: %.3g s; expected were ", stats.seconds_total);
        print_budget(stderr, &stats.budget);
    }
    if (result == SPS_OK && is_scattered_once(all) && all->volume_count + all->particle_set_count > 0)
        fprintf(stderr, "render: %s without --samples: light scatters once (--scattering single)\n",
                all->reference ? "--reference" : "--shadow samples");
    free(image.rgba);
    free(image.depth);
    return status;
}

/* Loads the scene, and plans or renders it. Returns the exit status. */
static int run_checked(arguments *all, const scene_arrays *arrays, ex_error *error) {
    ex_session session;
    sps_scene scene;
    sps_view view;
    memset(&scene, 0, sizeof scene);
    memset(&view, 0, sizeof view);
    if (load_scene(all, arrays, &scene, error)) return EX_MISTAKEN;
    tell_backgrounds(all);
    make_view(all, &view);
    if (ex_session_begin(&session, all->threads, error)) return EX_FAILED;
    const int status =
        all->plan ? print_plan(all, &session, &scene, &view, error) : render(all, &session, &scene, &view, error);
    ex_session_end(&session);
    return status;
}

/* Prints a line about one grid: its active voxels, and the box around them. */
static void print_grid(void *user, const ex_sparse *grid, const char *reason) {
    (void)user;
    printf("%s: %s, ", ex_quoted(grid->name).text, ex_quoted(grid->type).text);
    if (*reason) {
        printf("%s\n", reason);
        return;
    }
    printf("class %s, %" PRIu64 " voxels, from %d,%d,%d to %d,%d,%d\n",
           grid->grid_class[0] ? ex_quoted(grid->grid_class).text : "unknown", grid->voxel_count, grid->low[0],
           grid->low[1], grid->low[2], grid->low[0] + grid->size[0] - 1, grid->low[1] + grid->size[1] - 1,
           grid->low[2] + grid->size[2] - 1);
}

static int list_grids(const arguments *all, ex_error *error) {
    if (all->volume_count == 0) return ex_fail(error, "--list-grids: there is no --volume that it could be about");
    for (int i = 0; i < all->volume_count; ++i) {
        const char *path = all->volumes[i].file;
        const ex_sparse_format *format = sparse_format(path);
        if (!format) return ex_fail(error, "--list-grids: %s is not an OpenVDB or NanoVDB file", path);
        if (all->volume_count > 1) printf("%s\n", path);
        if (ex_sparse_list(format, path, (uint64_t)all->max_bytes, print_grid, NULL, error)) return 1;
    }
    return 0;
}

/* Does what the settings say. Returns the exit status. */
static int run(arguments *all, ex_error *error) {
    static const char *const none[] = {NULL};
    scene_arrays arrays;
    if (apply_settings(all, error)) return EX_MISTAKEN;
    if (all->help) {
        print_help(RENDER, "render [options]", none);
        return EX_OK;
    }
    if (all->list_grids) return list_grids(all, error) ? EX_MISTAKEN : EX_OK;
    if (find_volumes(all, error) || check(all, error)) return EX_MISTAKEN;
    if (has(all->given, "--part")) {
        choose_rows(all);
        if (describe_picture(all, error)) return EX_MISTAKEN;
    }
    begin_scene(&arrays, all->settings);
    const int status = run_checked(all, &arrays, error);
    free_scene(&arrays);
    return status;
}

int main(int argc, char **argv) {
    settings given = {0};
    arguments all;
    ex_error error;
    int status = EX_MISTAKEN;
    if (read_settings(argc, argv, &given, &error) == 0) {
        begin_arguments(&all, &given);
        status = run(&all, &error);
        free_arguments(&all);
    }
    if (status == EX_OK && finish_standard_output(&error)) status = EX_MISTAKEN;
    if (status != EX_OK) fprintf(stderr, "render: %s\n", error.text);
    free_settings(&given);
    return status;
}
