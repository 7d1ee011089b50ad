/* render_scene.h: makes what the options of render_options.h say: the scene, its files loaded, and the view; and says
   in their words what the library refuses. render.c and bake.c share it. */

#ifndef EX_RENDER_SCENE_H
#define EX_RENDER_SCENE_H

#include "blackbody.h"
#include "render_options.h"
#include "session.h"

#include <limits.h>

/* =============================================================================================== the scene */

static inline void to_floats(const double *from, float *out) {
    for (int i = 0; i < 3; ++i) out[i] = (float)from[i];
}

/* The largest value of a volume; 1 if there is none above 0. */
static inline int find_highest(volume_arguments *volume, float *highest, ex_error *error) {
    float range[2] = {0, 0};
    const int zero[3] = {0, 0, 0};
    if (volume->sparse.table) {
        if (ex_sparse_highest(&volume->sparse, &range[1], error)) return 1;
    } else {
        ex_grid_range(&volume->grid, zero, volume->grid.size, range);
    }
    *highest = range[1] > 0.0f ? range[1] : 1.0f;
    return 0;
}

/* Surface shading needs a transfer function. Without one, extinction is proportional to the value, as in a gas. */
static inline int make_linear_transfer(volume_arguments *volume, ex_error *error) {
    float highest;
    if (find_highest(volume, &highest, error)) return 1;
    volume->points.points = (sps_transfer_point *)ex_allocate(2, sizeof(sps_transfer_point));
    volume->points.point_count = 2;
    sps_transfer_point *points = volume->points.points;
    to_floats(volume->albedo, points[0].albedo);
    to_floats(volume->albedo, points[1].albedo);
    points[1].value = highest;
    points[1].extinction = (float)fmin(volume->extinction * (double)points[1].value, LARGEST);
    return 0;
}

/* Covers the values in the file, up to four times the temperature that stands for 1. */
static inline int make_temperature_transfer(volume_arguments *volume, ex_error *error) {
    float highest;
    if (find_highest(volume, &highest, error)) return 1;
    volume->points.points = (sps_transfer_point *)ex_allocate(EX_TEMPERATURE_POINTS, sizeof(sps_transfer_point));
    volume->points.point_count = EX_TEMPERATURE_POINTS;
    ex_temperature_points(volume->temperature[0], volume->temperature[1], fmin((double)highest, 4),
                          volume->points.points);
    return 0;
}

/* Points that no value can reach are a mistake: they are probably in units of the scanner, for example 0..255. */
static inline int check_transfer(const volume_arguments *volume, ex_error *error) {
    const ex_transfer *transfer = &volume->points;
    const char *name = volume->transfer_file ? volume->transfer_file : "--transfer-point";
    if (transfer->point_count > INT_MAX) return ex_fail(error, "%s: too many lines", name);
    if (ex_type_is_float(volume->voxels.type) && !has(volume->given, "--range")) return 0;
    if (transfer->point_count < 2) return 0;
    const double reach = (double)transfer->points[transfer->point_count - 2].value;
    if (reach <= 1) return 0;
    return ex_fail(error, "%s: a line's value is %g, and there are lines beyond it; %s voxels stand for 0..1", name,
                   reach, ex_type_names[volume->voxels.type]);
}

/* A volume with files of colors: its callbacks are those of its values, whatever these come from. */
static inline int read_values(void *user, const int lo[3], const int size[3], float *out) {
    volume_arguments *from = (volume_arguments *)user;
    return from->sparse.table ? ex_sparse_read(&from->sparse, lo, size, out) : ex_grid_read(&from->grid, lo, size, out);
}

/* Where voxels may glow, no block is empty. */
static inline int range_values(void *user, const int lo[3], const int size[3], float range[2]) {
    volume_arguments *from = (volume_arguments *)user;
    const int failed = from->sparse.table ? ex_sparse_range(&from->sparse, lo, size, range)
                                          : ex_grid_range(&from->grid, lo, size, range);
    if (from->emission_file && range[1] < 1) range[1] = 1;
    return failed;
}

static inline int read_colors(void *user, const int lo[3], const int size[3], float *albedo, float *emission) {
    const volume_arguments *from = (const volume_arguments *)user;
    if (albedo && from->albedo_file) ex_color_grid_read(&from->albedos, lo, size, albedo);
    if (emission && from->emission_file) ex_color_grid_read(&from->emissions, lo, size, emission);
    return 0;
}

static inline int load_colors(const volume_arguments *volume, const char *path, ex_color_grid *colors,
                              ex_error *error) {
    ex_volume_file file;
    if (!path) return 0;
    if (!ex_volume_format_of(path)) return ex_fail(error, "%s: colors need a file with a header", path);
    if (ex_volume_file_read(&file, path, error)) return 1;
    file.voxels.max_bytes = volume->voxels.max_bytes;
    for (int a = 0; a < 3; ++a)
        if (file.voxels.size[a] != volume->voxels.size[a])
            return ex_fail(error, "%s: %d,%d,%d voxels, but %s has %d,%d,%d", path, file.voxels.size[0],
                           file.voxels.size[1], file.voxels.size[2], volume->file, volume->voxels.size[0],
                           volume->voxels.size[1], volume->voxels.size[2]);
    return ex_color_grid_load(colors, &file.voxels, error);
}

static inline int load_volume(volume_arguments *from, sps_volume *volume, ex_error *error) {
    const int is_sparse = from->sparse.table != NULL;
    if (!is_sparse && ex_grid_load(&from->grid, &from->voxels, error)) return 1;
    memcpy(volume->size, from->voxels.size, sizeof volume->size);
    volume->placement = from->placement;
    memcpy(volume->crop, from->crop, sizeof volume->crop);
    volume->read_fn = ex_grid_read, volume->range_fn = ex_grid_range, volume->user = &from->grid;
    if (is_sparse) {
        volume->read_fn = ex_sparse_read, volume->range_fn = ex_sparse_range, volume->user = &from->sparse;
        volume->range_levels = EX_SPARSE_RANGE_LEVELS;
    }
    volume->concurrent = 1;
    volume->extinction = (float)from->extinction;
    to_floats(from->albedo, volume->albedo);
    to_floats(from->emission, volume->emission);
    to_floats(from->ambient, volume->ambient);
    volume->lobes = from->lobes.list, volume->lobe_count = from->lobes.count;
    if (from->albedo_file || from->emission_file) {
        if (load_colors(from, from->albedo_file, &from->albedos, error)) return 1;
        if (load_colors(from, from->emission_file, &from->emissions, error)) return 1;
        volume->read_fn = read_values, volume->range_fn = range_values, volume->user = from;
        volume->appearance_fn = read_colors;
    }
    volume->shading = from->shading ? SPS_SHADING_SURFACE : SPS_SHADING_GAS;
    if (from->transfer_file && ex_transfer_load(&from->points, from->transfer_file, error)) return 1;
    if (from->points.point_count > 0) {
        if (check_transfer(from, error)) return 1;
    } else if (has(from->given, "--temperature")) {
        if (make_temperature_transfer(from, error)) return 1;
    } else if (from->shading) {
        if (make_linear_transfer(from, error)) return 1;
    } else {
        return 0;
    }
    from->transfer.points = from->points.points, from->transfer.point_count = (int)from->points.point_count;
    volume->transfer = &from->transfer;
    volume->classify_voxels = from->classify;
    return 0;
}

static inline int load_particles(particles_arguments *from, sps_particles *set, ex_error *error) {
    if (ex_particles_load(&from->particles, from->file, from->has_albedos, error)) return 1;
    set->count = from->particles.count;
    set->read_fn = ex_particles_read, set->user = from->particles.list;
    set->has_albedos = from->has_albedos;
    set->soft = from->soft, set->is_extinction = from->is_extinction;
    to_floats(from->albedo, set->albedo);
    to_floats(from->emission, set->emission);
    to_floats(from->ambient, set->ambient);
    set->lobes = from->lobes.list, set->lobe_count = from->lobes.count;
    return 0;
}

static inline int load_mesh(mesh_arguments *from, sps_mesh *mesh, ex_error *error) {
    if (ex_mesh_load(&from->mesh, from->file, 60, error)) return 1;
    mesh->triangle_count = from->mesh.triangle_count;
    mesh->read_fn = ex_mesh_read, mesh->user = &from->mesh;
    mesh->has_normals = 1;
    to_floats(from->color, mesh->albedo);
    to_floats(from->transmittance, mesh->transmittance);
    return 0;
}

/* Sets the technique by which lights cast the shadows of gas. */
static inline void set_shadows(arguments *all, sps_light *lights, int count) {
    for (int i = 0; i < count; ++i) {
        lights[i].no_shadow = shadow_is(all, "none");
        if (shadow_is(all, "sheets")) lights[i].shadow_source = SPS_SHADOW_SHEETS;
        lights[i].shadow_map_resolution = all->table_size; /* used where the library chooses tables */
    }
    if (!has_maps(all)) return;
    all->map.technique = (sps_tmap_technique)all->shadow; /* the names are in their order */
    all->map.epsilon = (float)all->map_epsilon;
    for (int i = 0; i < count; ++i) {
        lights[i].shadow_map = &all->map;
        lights[i].shadow_map_resolution = shadow_is(all, "table") ? all->table_size : all->map_size;
    }
}

static inline void widen(double lo[3], double hi[3], const double *a, const double *b) {
    for (int i = 0; i < 3; ++i) {
        lo[i] = fmin(lo[i], fmin(a[i], b[i]));
        hi[i] = fmax(hi[i], fmax(a[i], b[i]));
    }
}

/* Widens the bounds by the corners of a placed unit cube. */
static inline void widen_by_box(double lo[3], double hi[3], const sps_placement *box) {
    for (int corner = 0; corner < 8; ++corner) {
        double p[3];
        for (int i = 0; i < 3; ++i) {
            p[i] = box->origin[i];
            for (int a = 0; a < 3; ++a) p[i] += corner >> a & 1 ? box->axis[a][i] : 0;
        }
        widen(lo, hi, p, p);
    }
}

/* Widens the bounds by volumes, whose placements must be known, and by loaded particles. */
static inline void widen_by_gas(double lo[3], double hi[3], const arguments *all) {
    for (int i = 0; i < all->volume_count; ++i) widen_by_box(lo, hi, &all->volumes[i].placement);
    for (int i = 0; i < all->particle_set_count; ++i)
        if (all->particles[i].particles.lo[0] <= all->particles[i].particles.hi[0])
            widen(lo, hi, all->particles[i].particles.lo, all->particles[i].particles.hi);
}

/* Finds a loaded scene's bounding box. Returns 0 if the scene is empty, and takes a unit cube. */
static inline int find_bounds(const arguments *all, double lo[3], double hi[3]) {
    for (int a = 0; a < 3; ++a) lo[a] = DBL_MAX, hi[a] = -DBL_MAX;
    widen_by_gas(lo, hi, all);
    for (int i = 0; i < all->mesh_count; ++i) widen(lo, hi, all->meshes[i].mesh.lo, all->meshes[i].mesh.hi);
    if (lo[0] <= hi[0]) return 1;
    for (int a = 0; a < 3; ++a) lo[a] = 0, hi[a] = 1;
    return 0;
}

/* Finds the middle of a loaded scene's bounding box, and half of its edges. */
static inline void find_middle(const arguments *all, double middle[3], double half[3]) {
    double lo[3], hi[3];
    find_bounds(all, lo, hi);
    for (int a = 0; a < 3; ++a) middle[a] = 0.5 * (lo[a] + hi[a]), half[a] = 0.5 * (hi[a] - lo[a]);
}

/* Turns a disc or a rectangle to face a direction, with the first axis perpendicular to `up`. Without a direction, it
   faces upwards. */
static inline void set_light_axes(const light_size *size, ex_vec towards, const double up[3], sps_light *light) {
    const ex_vec upwards = ex_vec_unit(ex_vec_of(up[0], up[1], up[2])), way = ex_vec_unit(towards);
    const ex_vec facing = ex_vec_length(way) > 0 ? way : upwards, cross = ex_vec_cross(facing, upwards);
    const ex_vec across = ex_vec_length(cross) > 1e-9 ? ex_vec_unit(cross) : ex_vec_perpendicular(facing);
    const ex_vec sides[2] = {across, ex_vec_cross(across, facing)};
    for (int a = 0; a < 2; ++a) {
        const ex_vec axis = ex_vec_scale(sides[a], size->count == 1 ? size->lengths[0] : 0.5 * size->lengths[a]);
        light->axes[a][0] = axis.x, light->axes[a][1] = axis.y, light->axes[a][2] = axis.z;
    }
    light->kind = size->count == 1 ? SPS_LIGHT_DISC : SPS_LIGHT_RECTANGLE;
}

static inline int load_projector(light_arguments *from, const double up[3], sps_light *light, ex_error *error) {
    if (ex_slide_read(from->image, &from->slide, error)) return 1;
    from->projector = ex_slide_projector(&from->slide, from->image_angle);
    from->projector.focus = from->focus;
    memcpy(from->projector.up, up, sizeof from->projector.up);
    light->projector = &from->projector;
    return 0;
}

static inline int load_lights(const arguments *all, sps_light *lights, ex_error *error) {
    double middle[3], half[3];
    find_middle(all, middle, half);
    for (int i = 0; i < all->light_count; ++i) {
        light_arguments *from = &all->lights[i];
        sps_light *light = &lights[i];
        light->kind = from->kind;
        memcpy(from->kind == SPS_LIGHT_POINT ? light->position : light->direction, from->place, sizeof from->place);
        to_floats(from->color, light->color);
        light->angular_diameter = from->angle * EX_PI / 180;
        if (from->cone[1] > 0 || from->image) memcpy(light->direction, from->axis, sizeof light->direction);
        light->inner_cone = from->cone[0] * EX_PI / 180;
        light->outer_cone = from->cone[1] * EX_PI / 180;
        light->samples = from->samples;
        light->falloff = (sps_falloff)from->falloff;
        if (from->image && load_projector(from, all->up, light, error)) return 1;
        const double *at = light->position, *axis = light->direction;
        const ex_vec to_middle = ex_vec_of(middle[0] - at[0], middle[1] - at[1], middle[2] - at[2]);
        const ex_vec towards = from->image ? ex_vec_of(axis[0], axis[1], axis[2]) : to_middle;
        if (from->size.count > 0) set_light_axes(&from->size, towards, all->up, light);
    }
    return 0;
}

/* What the scene borrows. */
typedef struct scene_arrays {
    sps_volume *volumes;
    sps_particles *particles;
    sps_mesh *meshes;
    sps_light *lights;
} scene_arrays;

static inline int load_scene(arguments *all, const scene_arrays *arrays, sps_scene *scene, ex_error *error) {
    for (int i = 0; i < all->volume_count; ++i)
        if (load_volume(&all->volumes[i], &arrays->volumes[i], error)) return 1;
    for (int i = 0; i < all->mesh_count; ++i)
        if (load_mesh(&all->meshes[i], &arrays->meshes[i], error)) return 1;
    for (int i = 0; i < all->particle_set_count; ++i)
        if (load_particles(&all->particles[i], &arrays->particles[i], error)) return 1;
    scene->volumes = arrays->volumes, scene->volume_count = all->volume_count;
    scene->meshes = arrays->meshes, scene->mesh_count = all->mesh_count;
    scene->particles = arrays->particles, scene->particle_set_count = all->particle_set_count;
    if (load_lights(all, arrays->lights, error)) return 1;
    set_shadows(all, arrays->lights, all->light_count);
    scene->lights = arrays->lights, scene->light_count = all->light_count;
    to_floats(all->ambient, scene->ambient);
    to_floats(all->background, scene->background);
    if (all->sky_file) {
        if (ex_sky_read(all->sky_file, all->up, all->sky_turn, all->sky_scale, &all->sky, error)) return 1;
        scene->sky_fn = ex_sky_light, scene->sky_user = &all->sky;
        /* Nothing is behind what bake.c makes. */
        if (all->settings->program == RENDER && !has(all->given, "--background"))
            scene->background_fn = ex_sky_behind, scene->background_user = &all->sky;
    }
    scene->replace_invalid = all->replace_invalid;
    return 0;
}

/* ================================================================================================ the view */

/* Places the camera so that the scene's bounding sphere fits into the image. */
static inline void frame_scene(const arguments *all, sps_view *view) {
    const double direction[3] = {0.4, 0.3, 1};
    double middle[3], half[3];
    find_middle(all, middle, half);
    const double radius = fmax(sqrt(ex_dot(half, half)), 1e-12);
    const double aspect = fmin(1.0, (double)view->width / (double)view->height);
    const double angle = all->ortho > 0 ? 0.5 : atan(tan(0.5 * view->camera.field_of_view) * aspect);
    const double distance = 1.02 * radius / sin(angle);
    for (int a = 0; a < 3; ++a) {
        view->camera.target[a] = middle[a];
        view->camera.position[a] =
            view->camera.target[a] + direction[a] * distance / sqrt(ex_dot(direction, direction));
    }
}

static inline void make_view(const arguments *all, sps_view *view) {
    const double degree = EX_PI / 180.0;
    view->width = all->width, view->height = all->height;
    if (all->ortho > 0)
        view->camera.ortho_height = all->ortho;
    else
        view->camera.field_of_view = all->fov * degree;
    memcpy(view->camera.up, all->up, sizeof view->camera.up);
    memcpy(view->camera.position, all->camera, sizeof view->camera.position);
    memcpy(view->camera.target, all->camera + 3, sizeof view->camera.target);
    if (!has(all->given, "--camera")) frame_scene(all, view);
    memcpy(view->region, all->region, sizeof view->region);
    view->quality = (sps_quality)all->quality;
    view->coverage_samples = all->coverage;
    view->sky_samples = all->sky_samples;
    view->slab_thickness = all->slab;
    view->shadow_resolution = all->shadow_resolution;
    view->no_shadows = all->no_shadows;
    view->scattering = is_scattered_once(all) ? SPS_SCATTERING_SINGLE : (sps_scattering)all->scattering;
    view->scattering_resolution = all->scattering_resolution;
    view->filling = (sps_filling)all->filling;
    view->scattering_tolerance = (float)all->scattering_tolerance;
    view->tolerance = (float)all->tolerance;
    view->budget_seconds = all->budget_seconds, view->budget_error = all->budget_error;
    view->budget_scale_min = all->budget_scale_min;
}

/* ================================================================================================== errors */

/* The option that a field of the library comes from; NULL where none is. */
static const char *find_field(const arguments *all, const sps_error_info *why) {
    static const struct {
        sps_object object;
        const char *field, *option;
    } fields[] = {{SPS_OBJECT_VIEW, "slab_thickness", "--slab-thickness"},
                  {SPS_OBJECT_VIEW, "coverage_samples", "--coverage"},
                  {SPS_OBJECT_VIEW, "scattering", "--scattering"},
                  {SPS_OBJECT_VIEW, "scattering_resolution", "--scattering-resolution"},
                  {SPS_OBJECT_VIEW, "quality", "--quality"},
                  {SPS_OBJECT_VIEW, "tolerance", "--tolerance"},
                  {SPS_OBJECT_VIEW, "budget_seconds", "--budget-seconds"},
                  {SPS_OBJECT_VIEW, "budget_error", "--budget-error"},
                  {SPS_OBJECT_VIEW, "budget_scale_min", "--budget-scale-min"},
                  {SPS_OBJECT_VIEW, "camera.field_of_view", "--fov"},
                  {SPS_OBJECT_VIEW, "camera.ortho_height", "--ortho"},
                  {SPS_OBJECT_VIEW, "camera.position", "--camera"},
                  {SPS_OBJECT_SCENE, "volume_count", "--volume"},
                  {SPS_OBJECT_SCENE, "mesh_count", "--mesh"},
                  {SPS_OBJECT_SCENE, "particle_set_count", "--particles"},
                  {SPS_OBJECT_LIGHT, "projector.focus", "--light-focus"},
                  {SPS_OBJECT_LIGHT, "shadow_map.components", "--map-components"}};
    for (size_t i = 0; i < sizeof fields / sizeof *fields; ++i) {
        if (why->object != fields[i].object || strcmp(why->field, fields[i].field) != 0) continue;
        if (strcmp(fields[i].option, "--camera") == 0 && !has(all->given, "--camera"))
            return "--camera (not given, so that all of the scene is in view)";
        return fields[i].option;
    }
    return NULL;
}

/* The name that the user knows the subject of a failure by: an option, with what was given to it if there may be
   several. */
static inline void name_subject(const arguments *all, const sps_error_info *why, char *out, size_t size) {
    const char *option = find_field(all, why), *given = "";
    const int i = why->index;
    if (!option && why->object == SPS_OBJECT_VOLUME && i < all->volume_count) {
        const volume_arguments *volume = &all->volumes[i];
        const int by_header = ex_volume_format_of(volume->file) && !has(volume->given, "--box");
        option = strncmp(why->field, "placement", 9) == 0 && !by_header ? "--box of" : "--volume";
        given = volume->file;
        if (strcmp(why->field, "appearance_fn's albedo") == 0) option = "--albedo-volume", given = volume->albedo_file;
        if (strcmp(why->field, "appearance_fn's emission") == 0)
            option = "--emission-volume", given = volume->emission_file;
    }
    if (!option && why->object == SPS_OBJECT_MESH && i < all->mesh_count)
        option = "--mesh", given = all->meshes[i].file;
    if (!option && why->object == SPS_OBJECT_PARTICLES && i < all->particle_set_count)
        option = "--particles", given = all->particles[i].file;
    if (!option && why->object == SPS_OBJECT_LIGHT && i < all->light_count)
        option = "--light", given = all->lights[i].text;
    snprintf(out, size, "%s%s%s%s", option ? option : "", *given ? " " : "", given, option ? ": " : "");
}

/* Hands on what the library says of a failure, with the option's name before it. Returns the exit status: 2 where the
   user can mend an option or a file. */
static inline int explain(const arguments *all, const ex_session *session, sps_result result, ex_error *error) {
    const char *way_out = "";
    sps_error_info why;
    char subject[600];
    sps_get_error(session->context, &why);
    for (int i = 0; i < all->volume_count; ++i)
        if (result == SPS_ERROR_CALLBACK && all->volumes[i].sparse.has_failed) {
            *error = all->volumes[i].sparse.failure;
            return EX_MISTAKEN;
        }
    name_subject(all, &why, subject, sizeof subject);
    if (result == SPS_ERROR_UNSUPPORTED && why.object == SPS_OBJECT_LIGHT)
        way_out = " (--shadow auto, --no-shadows and --reference have no such limit)";
    if (result == SPS_ERROR_DATA && (strcmp(why.field, "value") == 0 || strncmp(why.field, "appearance_fn", 13) == 0))
        way_out = " (--replace-invalid makes it 0)";
    const int is_bake = all->settings->program == BAKE; /* which has no --samples */
    if (result == SPS_ERROR_UNSUPPORTED && why.object == SPS_OBJECT_VIEW)
        way_out = strcmp(why.field, "scattering") == 0
                      ? (is_bake ? " (give --scattering single)" : " (--samples N, or --scattering single)")
                  : strcmp(why.field, "scattering_resolution") == 0 ? " (--scattering single has no such limit)"
                  : strcmp(why.field, "budget_error") == 0 ? " (--quality promises nothing, and has no such limit)"
                                                           : " (--no-shadows and --reference have no such limit)";
    ex_fail(error, "%s%s%s", subject, why.sentence, way_out);
    return result == SPS_ERROR_ARGUMENT || result == SPS_ERROR_DATA ? EX_MISTAKEN : EX_FAILED;
}

/* Beyond the box of a volume there is nothing, whatever the file says. */
static inline void tell_backgrounds(const arguments *all) {
    for (int i = 0; i < all->volume_count; ++i) {
        const ex_sparse *grid = &all->volumes[i].sparse;
        if (grid->table && ex_sparse_value(grid, grid->background) > 0)
            fprintf(stderr, "%s: %s: grid %s: its background, %g, fills its box; beyond, there is nothing\n",
                    program_names[all->settings->program], ex_quoted(grid->path).text, ex_quoted(grid->name).text,
                    (double)grid->background);
    }
}

/* What --plan and --help say may go to a full disk as well. */
static inline int finish_standard_output(ex_error *error) {
    errno = 0;
    if (fflush(stdout) == 0 && !ferror(stdout)) return 0;
    return ex_fail(error, "standard output: writing failed: %s", strerror(errno ? errno : EIO));
}

/* ============================================================================================ begin and end */

/* Sets all defaults and makes room for whatever the settings name. */
static inline void begin_arguments(arguments *all, const settings *given) {
    const size_t most = given->count + 1;
    memset(all, 0, sizeof *all);
    all->settings = given;
    all->volumes = (volume_arguments *)ex_allocate(most, sizeof *all->volumes);
    all->particles = (particles_arguments *)ex_allocate(most, sizeof *all->particles);
    all->meshes = (mesh_arguments *)ex_allocate(most, sizeof *all->meshes);
    all->lights = (light_arguments *)ex_allocate(most, sizeof *all->lights);
    all->width = all->height = 512;
    all->up[1] = 1;
    all->fov = 40;
    all->bake.tile = 256, all->bake.scale = 1, all->bake.texels = ex_find_name(texel_names, "half");
    all->bake.metres_per_unit = 1;
    all->max_bytes = EX_MAX_BYTES;
    all->shadow = ex_find_name(shadow_names, "auto");
    all->sky_scale = 1;
    default_volume(all->volumes);
    default_particles(all->particles);
    default_mesh(all->meshes);
}

static inline void free_arguments(arguments *all) {
    for (int i = 0; i < all->volume_count; ++i) {
        ex_grid_free(&all->volumes[i].grid);
        ex_sparse_free(&all->volumes[i].sparse);
    }
    for (int i = 0; i == 0 || i < all->volume_count; ++i) {
        ex_transfer_free(&all->volumes[i].points);
        ex_color_grid_free(&all->volumes[i].albedos), ex_color_grid_free(&all->volumes[i].emissions);
    }
    for (int i = 0; i < all->mesh_count; ++i) ex_mesh_free(&all->meshes[i].mesh);
    for (int i = 0; i < all->particle_set_count; ++i) ex_particles_free(&all->particles[i].particles);
    for (int i = 0; i < all->light_count; ++i) ex_slide_free(&all->lights[i].slide);
    ex_sky_free(&all->sky);
    free(all->described.text);
    free(all->particles);
    free(all->volumes);
    free(all->meshes);
    free(all->lights);
}

/* Room for everything that settings can name. */
static inline void begin_scene(scene_arrays *arrays, const settings *given) {
    const size_t most = given->count + 1;
    arrays->volumes = (sps_volume *)ex_allocate(most, sizeof *arrays->volumes);
    arrays->particles = (sps_particles *)ex_allocate(most, sizeof *arrays->particles);
    arrays->meshes = (sps_mesh *)ex_allocate(most, sizeof *arrays->meshes);
    arrays->lights = (sps_light *)ex_allocate(most, sizeof *arrays->lights);
}

static inline void free_scene(scene_arrays *arrays) {
    free(arrays->volumes);
    free(arrays->particles);
    free(arrays->meshes);
    free(arrays->lights);
}

#endif /* EX_RENDER_SCENE_H */
