/* bake: textures for engines from what build/render renders. `bake six-way` makes the lightmaps of a card of smoke, and
   takes render's options for the scene. Exit status: 0 done; 1 a render failed; 2 an option or a file was wrong. The
   last two with one line on stderr. */

#include "render_scene.h"
#include "six_way.h"

/* ========================================================================================= options of six-way */

/* Options of render that a bake has no use for, and what to do instead. */
static const struct {
    const char *option, *why;
} refused[] = {{"--light", "its lights are one on each of six sides"},
               {"--ambient", "ambient light has no side"},
               {"--gas-ambient", "ambient light has no side"},
               {"--particle-ambient", "ambient light has no side"},
               {"--background", "there is nothing behind a card"},
               {"--fov", "a card is seen in parallel; give --ortho"},
               {"--width", "give --tile"},
               {"--height", "give --tile"},
               {"--region", "give --tile, --camera and --ortho"},
               {"--reference", "it renders as render does without --reference"},
               {"--samples", "it renders as render does without --reference"},
               {"--budget-seconds", "a budget would treat frames differently; give --quality"},
               {"--budget-error", "a budget would treat frames differently; give --quality"},
               {"--out", "give --out-a and --out-b"},
               {"--pfm", "give --out-a and --out-b"},
               {"--alpha-pfm", "give --out-a and --out-b"},
               {"--exr", "give --out-a and --out-b"},
               {"--radiance-hdr", "give --out-a and --out-b"},
               {"--exr-type", "give --texels"},
               {"--stats", "render writes statistics"},
               {"--plan", "render prints plans"},
               {"--list-grids", "render lists grids"}};

enum { REFUSED = sizeof refused / sizeof *refused };

/* Whether an option was given for anything. */
static int is_given(const arguments *all, const char *option) {
    int given = has(all->given, option);
    for (int i = 0; i == 0 || i < all->volume_count; ++i) given = given || has(all->volumes[i].given, option);
    for (int i = 0; i == 0 || i < all->particle_set_count; ++i) given = given || has(all->particles[i].given, option);
    return given;
}

static const char *const out_names[EX_CARD_TEXTURES] = {"--out-a", "--out-b", "--out-c"};
static const char *const endings[] = {".png", ".exr", ".dds", NULL};
enum { PNG, EXR, DDS, ENDINGS };

static int ending_of(const char *path) {
    for (int i = 0; i < ENDINGS; ++i)
        if (ends_with(path, endings[i])) return i;
    return ENDINGS;
}

/* Each texture of the layout needs a file, whose ending must suit the texels. */
static int check_textures(const arguments *all, ex_error *error) {
    const bake_arguments *bake = &all->bake;
    const int count = ex_card_layout_of(bake->layout).count, has_texels = has(all->given, "--texels");
    for (int i = 0; i < EX_CARD_TEXTURES; ++i) {
        const char *path = bake->out[i];
        if (!path && i < count)
            return ex_fail(error, "--layout %s has %d textures: give %s", layout_names[bake->layout], count,
                           out_names[i]);
        if (path && i >= count)
            return ex_fail(error, "%s says nothing about --layout %s, which has %d textures", out_names[i],
                           layout_names[bake->layout], count);
        if (!path) continue;
        const int ending = ending_of(path);
        if (ending == ENDINGS)
            return ex_fail(error, "%s %s: the name must end in .png, .exr or .dds", out_names[i], path);
        if (has_texels && ending != DDS && (ending == PNG) != (bake->texels == EX_CARD_UNORM8))
            return ex_fail(error, "%s %s holds no --texels %s", out_names[i], path, texel_names[bake->texels]);
        for (int k = 0; k < i; ++k)
            if (bake->out[k] && ex_same_file(path, bake->out[k]))
                return ex_fail(error, "%s and %s are the same file: %s", out_names[k], out_names[i], path);
    }
    return 0;
}

/* Finds columns and rows, and whether frames and pixels fit in. */
static int check_frames(arguments *all, ex_error *error) {
    bake_arguments *bake = &all->bake;
    const int count = bake->frames[1] - bake->frames[0] + 1;
    if (count < 1)
        return ex_fail(error, "--frames %d,%d: the last one comes before the first", bake->frames[0], bake->frames[1]);
    if (count > 16384) return ex_fail(error, "--frames %d,%d: more than 16384", bake->frames[0], bake->frames[1]);
    if (!has(all->given, "--tiles")) {
        bake->tiles[0] = (int)ceil(sqrt((double)count));
        bake->tiles[1] = (count + bake->tiles[0] - 1) / bake->tiles[0];
    }
    if (bake->tiles[0] * bake->tiles[1] < count)
        return ex_fail(error, "--tiles %d,%d has room for %d frames, of which there are %d", bake->tiles[0],
                       bake->tiles[1], bake->tiles[0] * bake->tiles[1], count);
    for (int a = 0; a < 2; ++a)
        if (bake->tiles[a] > 16384 / bake->tile)
            return ex_fail(error, "a texture of %d x %d frames of %d pixels: sides must be within 16384 pixels",
                           bake->tiles[0], bake->tiles[1], bake->tile);
    return 0;
}

/* What needs no file. */
static int check_six_way(arguments *all, ex_error *error) {
    for (int i = 0; i < REFUSED; ++i)
        if (is_given(all, refused[i].option))
            return ex_fail(error, "%s says nothing about bake six-way: %s", refused[i].option, refused[i].why);
    if (shadow_is(all, "samples"))
        return ex_fail(error, "--shadow samples says nothing about bake six-way: %s",
                       "it renders as render does without --reference");
    if (all->volume_count + all->particle_set_count == 0)
        return ex_fail(error, "nothing to bake: give --volume or --particles");
    if (has(all->given, "--exr-compression") && ending_of(all->bake.out[0]) != EXR &&
        ending_of(all->bake.out[1]) != EXR)
        return ex_fail(error, "--exr-compression says nothing without an .exr file");
    return 0;
}

/* =============================================================================================== the frames */

/* The whole bake. */
typedef struct six_way {
    settings *given;
    bake_arguments bake; /* with columns and rows */
    int threads, zip;
    int numbered;        /* names of files in which frames had a number */
    double lo[3], hi[3]; /* around the gas of all frames */
    ex_card card;
    ex_session session;
} six_way;

/* Puts a frame's number into a name. */
static int name_frame(six_way *run, int number, const char *option, const char **name, ex_error *error) {
    int has_number = 0;
    if (!*name) return 0;
    char *named = ex_frame_name(*name, number, &has_number);
    if (!named)
        return ex_fail(error, "%s %s: with --frames, %% begins %%d or %%0Nd, once, and N is 1 to 9", option, *name);
    *name = keep_text(run->given, named);
    run->numbered += has_number;
    return 0;
}

static int name_files(six_way *run, arguments *all, int number, ex_error *error) {
    for (int i = 0; i < all->volume_count; ++i) {
        volume_arguments *volume = &all->volumes[i];
        if (name_frame(run, number, "--volume", &volume->file, error) ||
            name_frame(run, number, "--transfer", &volume->transfer_file, error) ||
            name_frame(run, number, "--albedo-volume", &volume->albedo_file, error) ||
            name_frame(run, number, "--emission-volume", &volume->emission_file, error))
            return 1;
    }
    for (int i = 0; i < all->particle_set_count; ++i)
        if (name_frame(run, number, "--particles", &all->particles[i].file, error)) return 1;
    for (int i = 0; i < all->mesh_count; ++i)
        if (name_frame(run, number, "--mesh", &all->meshes[i].file, error)) return 1;
    return 0;
}

/* Reads the options anew, and finds the files of a frame. */
static int open_frame(six_way *run, arguments *all, int frame, ex_error *error) {
    if (apply_settings(all, error)) return 1;
    if (!has(all->given, "--shadow") && !all->no_shadows) all->shadow = ex_find_name(shadow_names, "table");
    if (check_textures(all, error) || check_six_way(all, error) || check_frames(all, error)) return 1;
    run->bake = all->bake, run->threads = all->threads;
    run->zip = strcmp(exr_compression_names[all->exr_compression], "zip") == 0;
    if (has(all->given, "--frames") && name_files(run, all, all->bake.frames[0] + frame, error)) return 1;
    if (has(all->given, "--frames") && run->numbered == 0)
        return ex_fail(error, "--frames says nothing: no name of a file has %%d");
    return find_volumes(all, error) || check_scene_options(all, error);
}

/* Finds out where the gas is, and whether textures would overwrite files of the frame. */
static int measure_frame(six_way *run, arguments *all, int frame, ex_error *error) {
    (void)frame;
    for (int i = 0; i < EX_CARD_TEXTURES; ++i) {
        const char *path = all->bake.out[i], *input = path ? find_input(all, path) : NULL;
        if (input) ex_fail(error, "%s %s is a file that %s reads", out_names[i], path, input);
        if (input || (path && ex_check_writable(path, error))) return EX_MISTAKEN;
    }
    for (int i = 0; i < all->particle_set_count; ++i) {
        particles_arguments *from = &all->particles[i];
        if (ex_particles_load(&from->particles, from->file, from->has_albedos, error)) return EX_MISTAKEN;
    }
    widen_by_gas(run->lo, run->hi, all);
    return EX_OK;
}

/* A view of the gas of all frames, in a square. */
static void make_card_view(const six_way *run, const arguments *all, sps_view *view) {
    memset(view, 0, sizeof *view);
    make_view(all, view);
    view->width = view->height = all->bake.tile;
    view->camera.field_of_view = 0;
    ex_card_fit(run->lo, run->hi, has(all->given, "--camera"), &view->camera);
}

static int has_light(const float emission[3]) { return emission[0] > 0 || emission[1] > 0 || emission[2] > 0; }

/* Whether anything in a loaded scene glows. With `remove`, nothing does afterwards. */
static int find_glow(arguments *all, const scene_arrays *arrays, int remove) {
    int glows = 0;
    for (int i = 0; i < all->volume_count; ++i) {
        volume_arguments *from = &all->volumes[i];
        glows = glows || has_light(arrays->volumes[i].emission) || from->emission_file;
        if (remove) memset(arrays->volumes[i].emission, 0, sizeof arrays->volumes[i].emission);
        if (remove) from->emission_file = NULL; /* the callbacks ask for it */
        for (size_t k = 0; k < from->points.point_count; ++k) {
            float *emission = from->points.points[k].emission;
            glows = glows || has_light(emission);
            if (remove) memset(emission, 0, 3 * sizeof *emission);
        }
    }
    for (int i = 0; i < all->particle_set_count; ++i) {
        glows = glows || has_light(arrays->particles[i].emission);
        if (remove) memset(arrays->particles[i].emission, 0, sizeof arrays->particles[i].emission);
    }
    return glows;
}

/* What glows is baked first, and then taken out, so that the six maps have none of it. */
static int bake_loaded(six_way *run, arguments *all, const scene_arrays *arrays, int frame, ex_error *error) {
    sps_scene scene;
    sps_view view;
    sps_light light;
    sps_result result = SPS_OK;
    memset(&scene, 0, sizeof scene), memset(&light, 0, sizeof light);
    if (load_scene(all, arrays, &scene, error)) return EX_MISTAKEN;
    make_card_view(run, all, &view);
    set_shadows(all, &light, 1);
    const ex_card_job job = {run->session.context, &scene, &view, &light};
    if (find_glow(all, arrays, 0)) result = ex_card_bake_glow(&job, &run->card, frame);
    find_glow(all, arrays, 1);
    if (result == SPS_OK) result = ex_card_bake(&job, &run->card, frame);
    ex_progress_end(&run->session.progress);
    return result == SPS_OK ? EX_OK : explain(all, &run->session, result, error);
}

static int bake_frame(six_way *run, arguments *all, int frame, ex_error *error) {
    scene_arrays arrays;
    begin_scene(&arrays, all->settings);
    tell_backgrounds(all);
    const int status = bake_loaded(run, all, &arrays, frame, error);
    free_scene(&arrays);
    return status;
}

/* Does something with each frame. Returns the exit status. */
static int for_frames(six_way *run, int (*frame_fn)(six_way *, arguments *, int, ex_error *), ex_error *error) {
    int status = EX_OK, count = 1;
    for (int frame = 0; frame < count && status == EX_OK; ++frame) {
        arguments all;
        begin_arguments(&all, run->given);
        status = open_frame(run, &all, frame, error) ? EX_MISTAKEN : EX_OK;
        count = run->bake.frames[1] - all.bake.frames[0] + 1;
        if (status == EX_OK) status = frame_fn(run, &all, frame, error);
        free_arguments(&all);
    }
    return status;
}

/* ============================================================================================= the textures */

/* Says what 8 bits cannot hold. */
static void tell_clamped(const char *path, const float *texels, size_t count, double scale) {
    float largest = 1;
    size_t above = 0;
    for (size_t i = 0; i < count; ++i) {
        above += texels[i] > 1.0f;
        largest = texels[i] > largest ? texels[i] : largest;
    }
    if (above > 0)
        fprintf(stderr, "bake: %s: %zu numbers of %zu are above 1, up to %.3g, and become 1: --scale %.3g keeps them\n",
                ex_quoted(path).text, above, count, (double)largest, scale / (double)largest);
}

/* Says what straight alpha cannot hold. */
static void tell_uncovered(const six_way *run) {
    size_t count = 0;
    for (size_t i = 0; i < ex_card_pixels(&run->card); ++i)
        count += run->card.maps[EX_GLOW][i] > 0 && !(run->card.maps[EX_ALPHA][i] > 0);
    if (count > 0)
        fprintf(stderr, "bake: %zu pixels glow without alpha, and are lost: --alpha premultiplied keeps them\n", count);
}

static int write_texture(const six_way *run, int number, ex_error *error) {
    const bake_arguments *bake = &run->bake;
    const char *path = bake->out[number];
    const ex_card_texture texture = {ex_card_layout_of(bake->layout), number, (float)bake->scale,
                                     strcmp(alpha_names[bake->alpha], "straight") == 0};
    const int ending = ending_of(path), srgb = texture.layout.has_srgb;
    const ex_card_texel texel = ending == PNG ? EX_CARD_UNORM8 : (ex_card_texel)bake->texels;
    float *texels = ex_card_texels(&run->card, &texture);
    if (texel == EX_CARD_UNORM8) tell_clamped(path, texels, 4 * ex_card_pixels(&run->card), bake->scale);
    const int failed = ending == PNG ? ex_card_write_png(path, &run->card, srgb, texels, error)
                       : ending == EXR
                           ? ex_card_write_exr(path, &run->card, texel == EX_CARD_FLOAT, run->zip, texels, error)
                           : ex_card_write_dds(path, &run->card, &texture, texel, texels, error);
    free(texels);
    return failed;
}

static int write_textures(const six_way *run, ex_error *error) {
    if (strcmp(alpha_names[run->bake.alpha], "straight") == 0) tell_uncovered(run);
    for (int i = 0; i < ex_card_layout_of(run->bake.layout).count; ++i)
        if (write_texture(run, i, error)) return EX_MISTAKEN;
    return EX_OK;
}

/* ============================================================================================== the program */

static int asks_for_help(const settings *given) {
    for (size_t i = 0; i < given->count; ++i)
        if (strcmp(given->list[i].rule->name, "--help") == 0) return 1;
    return 0;
}

static int bake_six_way(settings *given, ex_error *error) {
    const char *left_out[REFUSED + 1] = {NULL};
    six_way run;
    memset(&run, 0, sizeof run);
    for (int i = 0; i < REFUSED; ++i) left_out[i] = refused[i].option;
    if (asks_for_help(given)) {
        print_help(BAKE, "bake six-way [options]", left_out);
        return EX_OK;
    }
    run.given = given;
    for (int a = 0; a < 3; ++a) run.lo[a] = DBL_MAX, run.hi[a] = -DBL_MAX;
    int status = for_frames(&run, measure_frame, error);
    if (status != EX_OK) return status;
    if (run.lo[0] > run.hi[0]) {
        ex_fail(error, "nothing to bake: there is no gas in any frame");
        return EX_MISTAKEN;
    }
    if (ex_session_begin(&run.session, run.threads, error)) return EX_FAILED;
    ex_card_begin(&run.card, run.bake.tile, run.bake.tiles[0], run.bake.tiles[1]);
    status = for_frames(&run, bake_frame, error);
    if (status == EX_OK) status = write_textures(&run, error);
    ex_card_free(&run.card);
    ex_session_end(&run.session);
    return status;
}

/* What stands first on the command line. */
static const struct {
    const char *name, *help;
    int (*run_fn)(settings *given, ex_error *error);
} commands[] = {{"six-way", "lightmaps of a card of smoke, for engines that light it from six sides", bake_six_way}};

enum { COMMANDS = sizeof commands / sizeof *commands };

static int run_command(int argc, char **argv, settings *given, ex_error *error) {
    const char *name = argc > 1 ? argv[1] : "";
    for (int i = 0; i < COMMANDS; ++i) {
        if (strcmp(commands[i].name, name) != 0) continue;
        if (read_settings(argc - 1, argv + 1, given, error)) return EX_MISTAKEN;
        return commands[i].run_fn(given, error);
    }
    if (strcmp(name, "--help") != 0) {
        ex_fail(error, "'%.40s' is no command; --help lists them", name);
        return EX_MISTAKEN;
    }
    puts("usage: bake COMMAND [options]; bake COMMAND --help lists the options\n");
    for (int i = 0; i < COMMANDS; ++i) printf("  %-20s %s\n", commands[i].name, commands[i].help);
    return EX_OK;
}

int main(int argc, char **argv) {
    settings given = {BAKE, NULL, 0, 0, NULL, 0, 0};
    ex_error error;
    int status = run_command(argc, argv, &given, &error);
    if (status == EX_OK && finish_standard_output(&error)) status = EX_MISTAKEN;
    if (status != EX_OK) fprintf(stderr, "bake: %s\n", error.text);
    free_settings(&given);
    return status;
}
