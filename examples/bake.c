/* bake: textures for engines from what build/render renders: `bake six-way` makes the lightmaps of a card of smoke,
   `bake map` a transmittance map, `bake cloud-shadow` the shadow maps of clouds over a terrain, `bake impostor` a card
   with normals and depths, `bake light-volume` a grid of light probes. They take render's options for the scene. Exit
   status: 0 done; 1 a render failed; 2 an option or a file was wrong. The last two with one line on stderr. */

#include "render_scene.h"
#include "impostor.h"
#include "light_volume.h"
#include "map_texture.h"

/* ======================================================================================= options of any command */

/* An option that a command has no use for, and what to do instead. */
typedef struct refusal {
    const char *option, *why;
} refusal;

/* Whether an option was given for anything. */
static int is_given(const arguments *all, const char *option) {
    int given = has(all->given, option);
    for (int i = 0; i == 0 || i < all->volume_count; ++i) given = given || has(all->volumes[i].given, option);
    for (int i = 0; i == 0 || i < all->particle_set_count; ++i) given = given || has(all->particles[i].given, option);
    for (int i = 0; i == 0 || i < all->light_count; ++i) given = given || has(all->lights[i].given, option);
    return given;
}

/* Lists end with NULL. */
static const refusal refused_by_all[] = {
    {"--exr-type", "give --texels"},   {"--stats", "render writes statistics"}, {"--part", "render has it"},
    {"--plan", "render prints plans"}, {"--list-grids", "render lists grids"},  {NULL, NULL}};
static const refusal for_maps_alone[] = {{"--convention", "bake cloud-shadow has it"},
                                         {"--metres-per-unit", "bake cloud-shadow has it"},
                                         {"--border", "bake map has it"},
                                         {"--depths", "bake map has it"},
                                         {"--surfaces", "bake map has it"},
                                         {"--constants", "bake map has it"},
                                         {NULL, NULL}};

/* Refuses options on two lists, and options that no command of bake has. */
static int check_refused(const arguments *all, const refusal *one, const refusal *other, const char *command,
                         ex_error *error) {
    const refusal *const lists[3] = {one, other, refused_by_all};
    for (int i = 0; i < 3; ++i)
        for (const refusal *at = lists[i]; at->option; ++at)
            if (is_given(all, at->option))
                return ex_fail(error, "%s says nothing about bake %s: %s", at->option, command, at->why);
    return 0;
}

static const char *const endings[] = {".png", ".exr", ".dds", NULL};
enum { PNG, EXR, DDS, ENDINGS };

static int ending_of(const char *path) {
    for (int i = 0; i < ENDINGS; ++i)
        if (ends_with(path, endings[i])) return i;
    return ENDINGS;
}

static int asks_for_help(const settings *given) {
    for (size_t i = 0; i < given->count; ++i)
        if (strcmp(given->list[i].rule->name, "--help") == 0) return 1;
    return 0;
}

/* Lists the options that check_refused accepts. */
static int help(const char *usage, const refusal *one, const refusal *other) {
    const refusal *const lists[3] = {one, other, refused_by_all};
    const char *left_out[OPTION_COUNT + 1] = {NULL};
    int count = 0;
    for (int i = 0; i < 3; ++i)
        for (const refusal *at = lists[i]; at->option; ++at) left_out[count++] = at->option;
    print_help(BAKE, usage, left_out);
    return EX_OK;
}

/* ========================================================================================= options of six-way */

static const refusal refused[] = {{"--light", "its lights are one on each of six sides"},
                                  {"--ambient", "ambient light has no side"},
                                  {"--sky", "its lights are one on each of six sides"},
                                  {"--sky-turn", "its lights are one on each of six sides"},
                                  {"--sky-scale", "its lights are one on each of six sides"},
                                  {"--sky-samples", "its lights are one on each of six sides"},
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
                                  {"--budget-scale-min", "a budget would treat frames differently; give --quality"},
                                  {"--out", "give --out-a and --out-b"},
                                  {"--pfm", "give --out-a and --out-b"},
                                  {"--alpha-pfm", "give --out-a and --out-b"},
                                  {"--exr", "give --out-a and --out-b"},
                                  {"--radiance-hdr", "give --out-a and --out-b"},
                                  {"--probes", "bake light-volume has it"},
                                  {NULL, NULL}};

static const char *const out_names[EX_CARD_TEXTURES] = {"--out-a", "--out-b", "--out-c"};
/* Each texture of the layout needs a file, whose ending must suit the texels. */
static int check_textures(const arguments *all, ex_error *error) {
    const bake_arguments *bake = &all->bake;
    const int has_texels = has(all->given, "--texels");
    if (bake->layout >= FIRST_MAP_LAYOUT)
        return ex_fail(error, "--layout %s is for maps, not for bake six-way", layout_names[bake->layout]);
    if (bake->texels > EX_CARD_FLOAT) return ex_fail(error, "--texels unorm16 is for maps, not for bake six-way");
    const int count = ex_card_layout_of(bake->layout).count;
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
        return ex_fail(error, "--tiles %d,%d has room for %d frames; there are %d", bake->tiles[0], bake->tiles[1],
                       bake->tiles[0] * bake->tiles[1], count);
    for (int a = 0; a < 2; ++a)
        if (bake->tiles[a] > 16384 / bake->tile)
            return ex_fail(error, "a texture of %d x %d frames of %d pixels: sides must be within 16384 pixels",
                           bake->tiles[0], bake->tiles[1], bake->tile);
    return 0;
}

/* What needs no file. */
static int check_six_way(arguments *all, ex_error *error) {
    if (check_refused(all, refused, for_maps_alone, "six-way", error)) return 1;
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

/* A view of a box, in a square. */
static void make_card_view(const double lo[3], const double hi[3], const arguments *all, sps_view *view) {
    memset(view, 0, sizeof *view);
    make_view(all, view);
    view->width = view->height = all->bake.tile;
    view->camera.field_of_view = 0;
    ex_card_fit(lo, hi, has(all->given, "--camera"), &view->camera);
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
    make_card_view(run->lo, run->hi, all, &view);
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

static int bake_six_way(settings *given, ex_error *error) {
    six_way run;
    memset(&run, 0, sizeof run);
    if (asks_for_help(given)) return help("bake six-way [options]", refused, for_maps_alone);
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

/* ============================================================================================= options of maps */

/* Options that say nothing about transmittance. Those of appearance may stand, since looks have them. */
static const refusal refused_by_maps[] = {{"--ambient", "a map holds transmittance"},
                                          {"--sky", "a map holds transmittance"},
                                          {"--sky-turn", "a map holds transmittance"},
                                          {"--sky-scale", "a map holds transmittance"},
                                          {"--sky-samples", "a map holds transmittance"},
                                          {"--gas-ambient", "a map holds transmittance"},
                                          {"--particle-ambient", "a map holds transmittance"},
                                          {"--background", "a map holds transmittance"},
                                          {"--light-size", "a map holds the shadow of a point"},
                                          {"--light-angle", "a map holds the shadow of a point"},
                                          {"--light-samples", "a map holds the shadow of a point"},
                                          {"--light-falloff", "a map holds transmittance"},
                                          {"--light-focus", "a map holds transmittance"},
                                          {"--width", "give --map-resolution"},
                                          {"--height", "give --map-resolution"},
                                          {"--region", "give --camera, --ortho or --fov"},
                                          {"--coverage", "a texel has one ray"},
                                          {"--shadow-resolution", "give --map-resolution"},
                                          {"--table-size", "give --map-resolution"},
                                          {"--no-shadows", "a map is a shadow"},
                                          {"--reference", "a map is no picture"},
                                          {"--samples", "a map is no picture"},
                                          {"--filling", "a map is no picture"},
                                          {"--tolerance", "a map is no picture"},
                                          {"--budget-seconds", "give --quality"},
                                          {"--budget-error", "give --quality"},
                                          {"--budget-scale-min", "give --quality"},
                                          {"--scattering", "a map holds transmittance"},
                                          {"--scattering-resolution", "a map holds transmittance"},
                                          {"--scattering-tolerance", "a map holds transmittance"},
                                          {"--pfm", "give --out"},
                                          {"--alpha-pfm", "give --out"},
                                          {"--exr", "give --out"},
                                          {"--radiance-hdr", "give --out"},
                                          {"--tile", "give --map-resolution"},
                                          {"--frames", "it bakes one frame"},
                                          {"--alpha", "a map has none"},
                                          {"--scale", "a map holds transmittance"},
                                          {"--out-a", "give --out"},
                                          {"--out-b", "give --surfaces"},
                                          {"--out-c", "give --out"},
                                          {"--probes", "bake light-volume has it"},
                                          {NULL, NULL}};
static const refusal refused_by_map[] = {{"--tiles", "bake cloud-shadow has it"},
                                         {"--convention", "bake cloud-shadow has it"},
                                         {"--metres-per-unit", "bake cloud-shadow has it"},
                                         {NULL, NULL}};
static const refusal refused_by_cloud_shadow[] = {{"--camera", "its sun sees all of the scene"},
                                                  {"--fov", "its sun sees all of the scene"},
                                                  {"--depths", "they are those of the scene"},
                                                  {"--surfaces", "polygons have shadow maps of their own"},
                                                  {NULL, NULL}};

/* Both commands. */
typedef struct map_run {
    const char *command;
    int is_cloud, is_beer; /* bake cloud-shadow; with --convention unreal */
    int zip, has_told;
    settings *given;
    ex_session session;
    sps_scene scene;
    ex_map_aim aim;
    sps_tmap_light light;
    ex_map_texture texture;
} map_run;

static int is_spot(const light_arguments *light) { return light->cone[1] > 0; }

/* Which shadows textures can hold. The default is the library's. */
static int choose_technique(const map_run *run, arguments *all, ex_error *error) {
    static const char *const textures[] = {"opacity", "deep-opacity", "fourier", "moment", "beer", NULL};
    static const char *const lists[] = {"deep", "compressed", NULL};
    const char *const *fit = run->is_beer ? lists : textures;
    if (!has(all->given, "--shadow")) {
        all->shadow = ex_find_name(shadow_names, run->is_beer ? "deep" : "deep-opacity");
        if (!run->is_beer) all->map.cubic = 1;
    }
    const char *name = shadow_names[all->shadow];
    if (ex_find_name(fit, name) >= 0) return 0;
    if (run->is_beer) return ex_fail(error, "--shadow %s: --convention unreal needs deep or compressed", name);
    if (ex_find_name(lists, name) >= 0)
        return ex_fail(error, "--shadow %s: a texture holds no lists; bake cloud-shadow --convention unreal reads them",
                       name);
    return ex_fail(error, "--shadow %s: bake %s needs opacity, deep-opacity, fourier, moment or beer", name,
                   run->command);
}

/* Where a map is seen from. */
static int check_map_view(const map_run *run, const arguments *all, ex_error *error) {
    const light_arguments *light = all->lights;
    const int has_camera = has(all->given, "--camera"), fov = has(all->given, "--fov");
    const int is_cube = strcmp(layout_names[all->bake.layout], "cube") == 0;
    if (has_camera && all->light_count > 0)
        return ex_fail(error, "--camera and --light exclude each other: both say where the map is seen from");
    if (!has_camera && all->light_count != 1)
        return ex_fail(error, "bake %s needs one --light%s, and there are %d", run->command,
                       run->is_cloud ? "" : " or --camera", all->light_count);
    const int is_sun = !has_camera && light->kind == SPS_LIGHT_DIRECTIONAL;
    if (!has_camera && light->image)
        return ex_fail(error, "--light %s: a projector makes no map; give a spot or --camera", light->text);
    if (run->is_cloud && !is_sun)
        return ex_fail(error, "--light %s: a cloud shadow needs a directional one", light->text);
    if (is_cube && (has_camera || is_sun || is_spot(light)))
        return ex_fail(error, "--layout cube needs a point light, which has six views");
    if (is_cube && (fov || has(all->given, "--border")))
        return ex_fail(error, "%s says nothing about --layout cube", fov ? "--fov" : "--border");
    if (is_sun && fov) return ex_fail(error, "--fov says nothing about --light %s: give --ortho", light->text);
    if (!is_sun && !has_camera && has(all->given, "--ortho"))
        return ex_fail(error, "--ortho says nothing about --light %s: give --fov", light->text);
    if (!has_camera && is_spot(light) && !fov && light->cone[1] > 88)
        return ex_fail(error, "--light %s: a map sees up to 88 degrees from its axis; give --fov", light->text);
    if (has(all->given, "--depths") && !(all->bake.depths[0] < all->bake.depths[1]))
        return ex_fail(error, "--depths %g,%g: the far one must be greater", all->bake.depths[0], all->bake.depths[1]);
    return 0;
}

/* What kind of file holds what. */
static int check_map_files(const map_run *run, arguments *all, ex_error *error) {
    static const char *const of_gas[] = {"--shadow", "--map-components", "--map-epsilon", "--map-cubic",
                                         "--map-texel-range"};
    bake_arguments *bake = &all->bake;
    const char *layout = layout_names[bake->layout], *path = all->out;
    const int ending = path ? ending_of(path) : DDS, has_texels = has(all->given, "--texels");
    if (!path && (run->is_cloud || !bake->surfaces))
        return ex_fail(error, "nothing to write: give --out FILE.dds%s", run->is_cloud ? "" : " or --surfaces");
    if (ending == ENDINGS) return ex_fail(error, "--out %s: the name must end in .dds, .exr or .png", path);
    if (ending == PNG && !has_texels) bake->texels = EX_CARD_UNORM8;
    const char *texels = texel_names[bake->texels];
    const int is_unorm = strncmp(texels, "unorm", 5) == 0;
    if (!path && is_unorm) return ex_fail(error, "--surfaces %s holds no --texels %s", bake->surfaces, texels);
    for (int i = 0; i < 5 && !path; ++i)
        if (has(all->given, of_gas[i])) return ex_fail(error, "%s says nothing without --out", of_gas[i]);
    if (run->is_beer && is_unorm)
        return ex_fail(error, "--convention unreal has --texels half or float, which .dds and .exr hold");
    if ((ending == EXR && is_unorm) || (ending == PNG && strcmp(texels, "unorm8") != 0))
        return ex_fail(error, "--out %s holds no --texels %s", path, texels);
    if (ending != DDS && !run->is_beer && strcmp(layout, "atlas") != 0)
        return ex_fail(error, "--out %s holds one picture: give --layout atlas, or a .dds file", path);
    if (run->is_beer && has(all->given, "--layout"))
        return ex_fail(error, "--layout says nothing about --convention unreal, which is one picture");
    if (bake->surfaces && ending_of(bake->surfaces) != DDS)
        return ex_fail(error, "--surfaces %s: the name must end in .dds", bake->surfaces);
    if (has(all->given, "--exr-compression") && ending != EXR)
        return ex_fail(error, "--exr-compression says nothing without an .exr file");
    if (!run->is_beer && has(all->given, "--metres-per-unit"))
        return ex_fail(error, "--metres-per-unit says nothing about --convention library");
    return 0;
}

/* What needs no file. */
static int check_maps(map_run *run, arguments *all, ex_error *error) {
    bake_arguments *bake = &all->bake;
    run->is_beer = run->is_cloud && strcmp(convention_names[bake->convention], "unreal") == 0;
    run->zip = strcmp(exr_compression_names[all->exr_compression], "zip") == 0;
    if (check_refused(all, refused_by_maps, run->is_cloud ? refused_by_cloud_shadow : refused_by_map, run->command,
                      error))
        return 1;
    if (has(all->given, "--layout") && bake->layout < FIRST_MAP_LAYOUT)
        return ex_fail(error, "--layout %s is for bake six-way; maps have array, slices, atlas and cube",
                       layout_names[bake->layout]);
    if (!has(all->given, "--layout")) bake->layout = FIRST_MAP_LAYOUT;
    if (!has(all->given, "--tiles")) bake->tiles[0] = bake->tiles[1] = 1;
    if (all->volume_count + all->particle_set_count + all->mesh_count == 0)
        return ex_fail(error, "nothing to bake: give --volume, --particles or --mesh");
    if (bake->tiles[0] > 16384 / bake->tiles[1])
        return ex_fail(error, "--tiles %d,%d: more than 16384 maps", bake->tiles[0], bake->tiles[1]);
    if (!has(all->given, "--map-resolution")) all->map_size = 512;
    return choose_technique(run, all, error) || check_map_view(run, all, error) || check_map_files(run, all, error);
}

/* ================================================================================================== the maps */

enum { MAP_FILES = 3 };
static const char *const map_options[MAP_FILES] = {"--out", "--surfaces", "--constants"};

/* Names of the files of a tile, NULL where there is none. Tiles are counted row by row from the top left. */
static int name_map_files(const map_run *run, const arguments *all, int tile, const char *names[MAP_FILES],
                          ex_error *error) {
    const char *const given[MAP_FILES] = {all->out, all->bake.surfaces, all->bake.constants};
    const int count = all->bake.tiles[0] * all->bake.tiles[1];
    for (int i = 0; i < MAP_FILES; ++i) {
        int has_number = 0;
        names[i] = given[i];
        if (!given[i] || !run->is_cloud) continue;
        char *name = ex_frame_name(given[i], tile, &has_number);
        if (!name)
            return ex_fail(error, "%s %s: %% begins %%d or %%0Nd, once, and N is 1 to 9", map_options[i], given[i]);
        names[i] = keep_text(run->given, name);
        if (count > 1 && !has_number)
            return ex_fail(error, "%s %s: with %d tiles, the name needs %%d", map_options[i], given[i], count);
    }
    return 0;
}

/* Whether all files can be written, and overwrite nothing that is read. */
static int check_map_names(const map_run *run, const arguments *all, ex_error *error) {
    for (int tile = 0; tile < all->bake.tiles[0] * all->bake.tiles[1]; ++tile) {
        const char *names[MAP_FILES];
        if (name_map_files(run, all, tile, names, error)) return 1;
        for (int i = 0; i < MAP_FILES; ++i) {
            const char *input = names[i] ? find_input(all, names[i]) : NULL;
            if (input) return ex_fail(error, "%s %s is a file that %s reads", map_options[i], names[i], input);
            for (int k = 0; k < i; ++k)
                if (names[i] && names[k] && ex_same_file(names[i], names[k]))
                    return ex_fail(error, "%s and %s are the same file: %s", map_options[k], map_options[i], names[i]);
            if (names[i] && ex_check_writable(names[i], error)) return 1;
        }
    }
    return 0;
}

/* Bounds that hold the kernels of voxels as well, which reach two voxels beyond the box. Returns 0 without a scene. */
static int find_reach(const arguments *all, double lo[3], double hi[3]) {
    const int found = find_bounds(all, lo, hi);
    for (int i = 0; i < all->volume_count; ++i) {
        const volume_arguments *volume = &all->volumes[i];
        sps_placement wide = volume->placement;
        for (int a = 0; a < 3; ++a)
            for (int k = 0; k < 3; ++k) {
                const double voxel = volume->placement.axis[a][k] / volume->voxels.size[a];
                wide.origin[k] -= 2 * voxel, wide.axis[a][k] += 4 * voxel;
            }
        widen_by_box(lo, hi, &wide);
    }
    return found;
}

/* Sets what maps have in common. */
static int aim_maps(map_run *run, arguments *all, ex_error *error) {
    ex_map_aim *aim = &run->aim;
    sps_tmap_export_settings *made = &run->texture.settings;
    static const sps_export_format formats[] = {SPS_EXPORT_UNORM8, SPS_EXPORT_HALF, SPS_EXPORT_FLOAT,
                                                SPS_EXPORT_UNORM16};
    if (!find_reach(all, aim->lo, aim->hi)) return ex_fail(error, "nothing to bake: the scene is empty");
    memcpy(aim->up, all->up, sizeof aim->up);
    memcpy(aim->tiles, all->bake.tiles, sizeof aim->tiles);
    aim->texels = all->map_size;
    aim->size = all->ortho > 0 ? all->ortho : has(all->given, "--fov") ? all->fov * EX_PI / 180 : 0;
    aim->slack = shadow_is(all, "fourier") && !all->map.texel_range ? 1.0 / 16 : 1.0 / 1024;
    run->light.border = all->bake.border;
    run->light.quality = (sps_quality)all->quality, run->light.slab_thickness = all->slab;
    made->format = formats[all->bake.texels];
    made->layout = (sps_export_layout)(all->bake.layout - FIRST_MAP_LAYOUT);
    if (!run->is_beer) return 0;
    made->content = SPS_EXPORT_ENGINE_BEER;
    made->extinction_unit = 1 / all->bake.metres_per_unit;
    made->distance_unit = 1000 / all->bake.metres_per_unit;
    return 0;
}

/* Aims the map of a tile. */
static int aim_map(map_run *run, arguments *all, int tile, double range[2], ex_error *error) {
    const light_arguments *light = all->lights;
    const int place[2] = {tile % run->aim.tiles[0], tile / run->aim.tiles[0]};
    static const double none[3] = {0, 0, 0};
    double tangent;
    if (has(all->given, "--camera")) {
        sps_view view;
        memset(&view, 0, sizeof view);
        make_view(all, &view);
        run->light.camera = view.camera;
        run->light.width = run->light.height = run->aim.texels;
        return ex_map_measure(&run->aim, &run->light.camera, range, &tangent, error);
    }
    if (light->kind == SPS_LIGHT_DIRECTIONAL) {
        ex_map_aim_sun(&run->aim, light->place, place, &run->light, range);
        return 0;
    }
    if (run->texture.settings.layout == SPS_EXPORT_CUBE)
        return ex_map_aim_around(&run->aim, light->place, &run->light, range, error);
    if (is_spot(light) && !(run->aim.size > 0)) run->aim.size = 2 * light->cone[1] * EX_PI / 180;
    return ex_map_aim_point(&run->aim, light->place, is_spot(light) ? light->axis : none, &run->light, range, error);
}

/* Says what the file does not hold. */
static void tell_lost(map_run *run, const sps_tmap *map, const char *const names[MAP_FILES]) {
    const uint64_t clamped = run->texture.about.clamped;
    if (names[0] && clamped > 0)
        fprintf(stderr, "bake: %s: %.0f numbers exceed the format or its limit of optical depth, and are clamped\n",
                ex_quoted(names[0]).text, (double)clamped);
    if (!run->is_cloud && names[0] && !names[1] && sps_tmap_surfaces(map) && !run->has_told++)
        fputs("bake: opaque polygons are not in this texture: --surfaces FILE.dds makes one of them\n", stderr);
}

static int write_map(map_run *run, sps_tmap *map, const char *const names[MAP_FILES], ex_error *error) {
    const char *path = names[0];
    const int ending = path ? ending_of(path) : ENDINGS;
    if (ending == DDS && ex_map_write_dds(path, &run->texture, error)) return EX_MISTAKEN;
    if (ending == EXR && ex_map_write_exr(path, &run->texture, run->zip, error)) return EX_MISTAKEN;
    if (ending == PNG && ex_map_write_png(path, &run->texture, error)) return EX_MISTAKEN;
    if (names[2] && ex_map_write_constants(names[2], map, &run->texture, error)) return EX_MISTAKEN;
    return EX_OK;
}

/* Exports a finished map, and writes its files. */
static int store_map(map_run *run, arguments *all, sps_tmap *map, const char *const names[MAP_FILES], ex_error *error) {
    ex_map_texture surfaces = run->texture;
    int status = EX_OK;
    surfaces.settings.content = SPS_EXPORT_SURFACES;
    if (surfaces.settings.format != SPS_EXPORT_HALF) surfaces.settings.format = SPS_EXPORT_FLOAT;
    if (surfaces.settings.layout != SPS_EXPORT_CUBE) surfaces.settings.layout = SPS_EXPORT_ARRAY;
    if (names[1]) {
        const sps_result result = ex_map_export(map, &surfaces);
        status = result != SPS_OK                               ? explain(all, &run->session, result, error)
                 : ex_map_write_dds(names[1], &surfaces, error) ? EX_MISTAKEN
                                                                : EX_OK;
        free(surfaces.texels);
    }
    if (status != EX_OK) return status;
    if (!names[0]) run->texture.settings = surfaces.settings;
    const sps_result result = ex_map_export(map, &run->texture);
    status = result == SPS_OK ? write_map(run, map, names, error) : explain(all, &run->session, result, error);
    free(run->texture.texels);
    if (status == EX_OK) tell_lost(run, map, names);
    return status;
}

static int bake_tile(map_run *run, arguments *all, int tile, ex_error *error) {
    const char *names[MAP_FILES];
    double range[2];
    sps_tmap *map;
    sps_tmap_settings made = all->map;
    if (name_map_files(run, all, tile, names, error) || aim_map(run, all, tile, range, error)) return EX_MISTAKEN;
    if (has(all->given, "--depths")) memcpy(range, all->bake.depths, sizeof range);
    if (!names[0]) memset(&made, 0, sizeof made), made.technique = SPS_TMAP_DEPTH;
    made.near_depth = range[0], made.far_depth = range[1];
    sps_result result = sps_tmap_create(run->session.context, &run->light, &made, &map);
    if (result == SPS_OK) result = sps_tmap_add(map, &run->scene);
    if (result == SPS_OK) result = sps_tmap_finish(map);
    ex_progress_end(&run->session.progress);
    const int status =
        result == SPS_OK ? store_map(run, all, map, names, error) : explain(all, &run->session, result, error);
    sps_tmap_destroy(map);
    return status;
}

static int bake_all_tiles(map_run *run, arguments *all, const scene_arrays *arrays, ex_error *error) {
    int status = EX_OK;
    if (load_scene(all, arrays, &run->scene, error) || aim_maps(run, all, error)) return EX_MISTAKEN;
    if (ex_session_begin(&run->session, all->threads, error)) return EX_FAILED;
    for (int tile = 0; tile < all->bake.tiles[0] * all->bake.tiles[1] && status == EX_OK; ++tile)
        status = bake_tile(run, all, tile, error);
    ex_session_end(&run->session);
    return status;
}

static int bake_maps(map_run *run, settings *given, ex_error *error) {
    arguments all;
    scene_arrays arrays;
    run->given = given;
    begin_arguments(&all, given);
    begin_scene(&arrays, given);
    int status = EX_MISTAKEN;
    if (!apply_settings(&all, error) && !check_maps(run, &all, error) && !find_volumes(&all, error) &&
        !check_scene_options(&all, error) && !check_map_names(run, &all, error)) {
        tell_backgrounds(&all);
        status = bake_all_tiles(run, &all, &arrays, error);
    }
    free_scene(&arrays);
    free_arguments(&all);
    return status;
}

static int bake_map(settings *given, ex_error *error) {
    map_run run;
    memset(&run, 0, sizeof run);
    run.command = "map";
    if (asks_for_help(given)) return help("bake map [options]", refused_by_maps, refused_by_map);
    return bake_maps(&run, given, error);
}

static int bake_cloud_shadow(settings *given, ex_error *error) {
    map_run run;
    memset(&run, 0, sizeof run);
    run.command = "cloud-shadow", run.is_cloud = 1;
    if (asks_for_help(given)) return help("bake cloud-shadow [options]", refused_by_maps, refused_by_cloud_shadow);
    return bake_maps(&run, given, error);
}

/* ============================================================================================ a single scene */

/* Steps of commands that bake one scene once. Each returns 0 on success, the last an exit status. */
typedef struct one_scene {
    int (*check_fn)(const arguments *all, ex_error *error); /* needs no file */
    int (*check_names_fn)(const arguments *all, ex_error *error);
    int (*bake_fn)(arguments *all, const scene_arrays *arrays, ex_error *error);
} one_scene;

static int bake_one_scene(const one_scene *steps, settings *given, ex_error *error) {
    arguments all;
    scene_arrays arrays;
    int status = EX_MISTAKEN;
    begin_arguments(&all, given);
    begin_scene(&arrays, given);
    if (!apply_settings(&all, error) && !steps->check_fn(&all, error) && !find_volumes(&all, error) &&
        !check_scene_options(&all, error) && !steps->check_names_fn(&all, error)) {
        tell_backgrounds(&all);
        status = steps->bake_fn(&all, &arrays, error);
    }
    free_scene(&arrays);
    free_arguments(&all);
    return status;
}

/* ============================================================================================== the impostor */

static const refusal refused_by_impostor[] = {{"--background", "there is nothing behind a card"},
                                              {"--fov", "a card is seen in parallel; give --ortho"},
                                              {"--width", "give --tile"},
                                              {"--height", "give --tile"},
                                              {"--region", "give --tile, --camera and --ortho"},
                                              {"--reference", "it renders as render does without --reference"},
                                              {"--samples", "it renders as render does without --reference"},
                                              {"--budget-seconds", "give --quality"},
                                              {"--budget-error", "give --quality"},
                                              {"--budget-scale-min", "give --quality"},
                                              {"--out", "give --out-a and --out-b"},
                                              {"--pfm", "give --out-a and --out-b"},
                                              {"--alpha-pfm", "give --out-a and --out-b"},
                                              {"--exr", "give --out-a and --out-b"},
                                              {"--radiance-hdr", "give --out-a and --out-b"},
                                              {"--layout", "its two textures have one"},
                                              {"--tiles", "it bakes one frame"},
                                              {"--frames", "it bakes one frame"},
                                              {"--out-c", "it has two textures"},
                                              {"--probes", "bake light-volume has it"},
                                              {NULL, NULL}};

static int check_impostor_file(const arguments *all, int number, ex_error *error) {
    const char *path = all->bake.out[number], *option = out_names[number], *texels = texel_names[all->bake.texels];
    if (!path) return ex_fail(error, "an impostor has two textures: give %s", option);
    const int ending = ending_of(path);
    if (ending == ENDINGS) return ex_fail(error, "%s %s: the name must end in .png, .exr or .dds", option, path);
    if (has(all->given, "--texels") && ending != DDS && (ending == PNG) != (all->bake.texels == EX_CARD_UNORM8))
        return ex_fail(error, "%s %s holds no --texels %s", option, path, texels);
    if (number > 0 && ex_same_file(path, all->bake.out[0]))
        return ex_fail(error, "%s and %s are the same file: %s", out_names[0], option, path);
    return 0;
}

/* What needs no file. */
static int check_impostor(const arguments *all, ex_error *error) {
    const int has_exr = all->bake.out[0] && all->bake.out[1] &&
                        (ending_of(all->bake.out[0]) == EXR || ending_of(all->bake.out[1]) == EXR);
    if (check_refused(all, refused_by_impostor, for_maps_alone, "impostor", error)) return 1;
    if (all->bake.texels > EX_CARD_FLOAT) return ex_fail(error, "--texels unorm16 is for maps, not for bake impostor");
    if (shadow_is(all, "samples"))
        return ex_fail(error, "--shadow samples says nothing about bake impostor: %s",
                       "it renders as render does without --reference");
    if (all->volume_count + all->particle_set_count + all->mesh_count == 0)
        return ex_fail(error, "nothing to bake: give --volume, --particles or --mesh");
    if (check_impostor_file(all, 0, error) || check_impostor_file(all, 1, error)) return 1;
    if (has(all->given, "--exr-compression") && !has_exr)
        return ex_fail(error, "--exr-compression says nothing without an .exr file");
    return 0;
}

static int check_impostor_names(const arguments *all, ex_error *error) {
    for (int i = 0; i < 2; ++i) {
        const char *path = all->bake.out[i], *input = find_input(all, path);
        if (input) return ex_fail(error, "%s %s is a file that %s reads", out_names[i], path, input);
        if (ex_check_writable(path, error)) return 1;
    }
    return 0;
}

/* Writes the picture, or normals and depths. */
static int write_impostor(const arguments *all, int number, const float *texels, ex_error *error) {
    const char *path = all->bake.out[number];
    const int ending = ending_of(path), zip = strcmp(exr_compression_names[all->exr_compression], "zip") == 0;
    const int is_straight = strcmp(alpha_names[all->bake.alpha], "straight") == 0;
    const ex_card_texel texel = ending == PNG ? EX_CARD_UNORM8 : (ex_card_texel)all->bake.texels;
    ex_card card;
    ex_card_texture texture;
    memset(&card, 0, sizeof card), memset(&texture, 0, sizeof texture);
    card.tile = all->bake.tile, card.columns = card.rows = 1;
    texture.is_straight = is_straight, texture.layout.has_srgb = number == 0;
    texture.layout.channels[0][3] = number == 0 ? EX_ALPHA : EX_ONE;
    if (ending == PNG) return ex_card_write_png(path, &card, texture.layout.has_srgb, texels, error);
    if (ending == EXR) return ex_card_write_exr(path, &card, texel == EX_CARD_FLOAT, zip, texels, error);
    return ex_card_write_dds(path, &card, &texture, texel, texels, error);
}

/* Writes both textures. In 8 bits, -1 to 1 of normals becomes 0 to 1. */
static int write_impostors(const arguments *all, const double range[2], float *rgba, const float *depths,
                           const float *normals, ex_error *error) {
    const size_t pixels = (size_t)all->bake.tile * (size_t)all->bake.tile;
    const int is_unorm = ending_of(all->bake.out[1]) == PNG ||
                         (ending_of(all->bake.out[1]) == DDS && all->bake.texels == EX_CARD_UNORM8);
    float *texels = (float *)ex_allocate(pixels, 4 * sizeof *texels);
    for (size_t i = 0; i < 4 * pixels; ++i)
        if (i % 4 < 3) rgba[i] *= (float)all->bake.scale;
    if (strcmp(alpha_names[all->bake.alpha], "straight") == 0)
        ex_impostor_straight(rgba, all->bake.tile, texels);
    else
        memcpy(texels, rgba, 4 * pixels * sizeof *texels);
    int failed = write_impostor(all, 0, texels, error);
    for (size_t i = 0; i < pixels && !failed; ++i) {
        for (size_t c = 0; c < 3; ++c)
            texels[4 * i + c] = is_unorm ? 0.5f + 0.5f * normals[3 * i + c] : normals[3 * i + c];
        texels[4 * i + 3] = ex_impostor_depth(depths[i], range);
    }
    failed = failed || write_impostor(all, 1, texels, error);
    free(texels);
    return failed ? EX_MISTAKEN : EX_OK;
}

static int render_impostor(arguments *all, const sps_scene *scene, const ex_map_aim *aim, ex_error *error) {
    const size_t pixels = (size_t)all->bake.tile * (size_t)all->bake.tile;
    double range[2], tangent;
    ex_session session;
    sps_view view;
    sps_image image;
    make_card_view(aim->lo, aim->hi, all, &view);
    memset(&image, 0, sizeof image);
    if (ex_map_measure(aim, &view.camera, range, &tangent, error)) return EX_MISTAKEN;
    if (ex_session_begin(&session, all->threads, error)) return EX_FAILED;
    image.rgba = (float *)ex_allocate(pixels, 4 * sizeof *image.rgba);
    image.depth = (float *)ex_allocate(pixels, sizeof *image.depth);
    float *normals = (float *)ex_allocate(pixels, 3 * sizeof *normals);
    sps_result result = sps_render(session.context, scene, &view, &image);
    if (result == SPS_OK) result = ex_impostor_normals(session.context, scene, &view, normals);
    ex_progress_end(&session.progress);
    const int status = result == SPS_OK ? write_impostors(all, range, image.rgba, image.depth, normals, error)
                                        : explain(all, &session, result, error);
    ex_session_end(&session);
    free(image.rgba), free(image.depth), free(normals);
    return status;
}

static int load_impostor(arguments *all, const scene_arrays *arrays, ex_error *error) {
    sps_scene scene;
    ex_map_aim aim;
    memset(&scene, 0, sizeof scene), memset(&aim, 0, sizeof aim);
    if (shadow_is(all, "auto")) all->shadow = SPS_TMAP_TABLE; /* slabs of sheets blur depths */
    if (load_scene(all, arrays, &scene, error)) return EX_MISTAKEN;
    if (!find_bounds(all, aim.lo, aim.hi)) {
        ex_fail(error, "nothing to bake: the scene is empty");
        return EX_MISTAKEN;
    }
    return render_impostor(all, &scene, &aim, error);
}

static int bake_impostor(settings *given, ex_error *error) {
    static const one_scene steps = {check_impostor, check_impostor_names, load_impostor};
    if (asks_for_help(given)) return help("bake impostor [options]", refused_by_impostor, for_maps_alone);
    return bake_one_scene(&steps, given, error);
}

/* ========================================================================================== the light volume */

static const refusal refused_by_light_volume[] = {{"--camera", "it has light from all sides"},
                                                  {"--fov", "it has light from all sides"},
                                                  {"--ortho", "it has light from all sides"},
                                                  {"--width", "give --probes"},
                                                  {"--height", "give --probes"},
                                                  {"--region", "give --probes"},
                                                  {"--background", "it has the visible fraction of the sky"},
                                                  {"--coverage", "it is no picture"},
                                                  {"--slab-thickness", "probes need no slabs"},
                                                  {"--shadow-resolution", "probes need no shadow maps"},
                                                  {"--map-components", "probes need no shadow maps"},
                                                  {"--map-resolution", "probes need no shadow maps"},
                                                  {"--table-size", "probes need no shadow maps"},
                                                  {"--map-epsilon", "probes need no shadow maps"},
                                                  {"--map-cubic", "probes need no shadow maps"},
                                                  {"--map-texel-range", "probes need no shadow maps"},
                                                  {"--filling", "probes need no slabs"},
                                                  {"--tolerance", "it is no picture"},
                                                  {"--reference", "it is no picture"},
                                                  {"--samples", "it is no picture"},
                                                  {"--budget-seconds", "give --quality"},
                                                  {"--budget-error", "give --quality"},
                                                  {"--budget-scale-min", "give --quality"},
                                                  {"--pfm", "give --out"},
                                                  {"--alpha-pfm", "give --out"},
                                                  {"--exr", "give --out"},
                                                  {"--exr-compression", "it writes .dds or .npy"},
                                                  {"--radiance-hdr", "give --out"},
                                                  {"--layout", "it has one layout"},
                                                  {"--tile", "give --probes"},
                                                  {"--tiles", "give --probes"},
                                                  {"--frames", "it bakes one frame"},
                                                  {"--alpha", "its alpha is visibility of the sky"},
                                                  {"--scale", "it has radiance as it is"},
                                                  {"--out-a", "give --out"},
                                                  {"--out-b", "give --out"},
                                                  {"--out-c", "give --out"},
                                                  {NULL, NULL}};

/* What needs no file. */
static int check_light_volume(const arguments *all, ex_error *error) {
    const char *path = all->out, *texels = texel_names[all->bake.texels];
    if (check_refused(all, refused_by_light_volume, for_maps_alone, "light-volume", error)) return 1;
    if (!shadow_is(all, "auto") && !shadow_is(all, "none"))
        return ex_fail(error, "--shadow %s says nothing about bake light-volume: probes need no shadow maps",
                       shadow_names[all->shadow]);
    if (all->bake.texels != EX_CARD_HALF && all->bake.texels != EX_CARD_FLOAT)
        return ex_fail(error, "--texels %s: bake light-volume has half or float", texels);
    if (all->volume_count + all->particle_set_count + all->mesh_count == 0)
        return ex_fail(error, "nothing to bake: give --volume, --particles or --mesh");
    if (!path) return ex_fail(error, "nothing to write: give --out");
    if (!ends_with(path, ".dds") && !ends_with(path, ".npy"))
        return ex_fail(error, "--out %s: the name must end in .dds or .npy", path);
    if (has(all->given, "--texels") && ends_with(path, ".npy") && all->bake.texels != EX_CARD_FLOAT)
        return ex_fail(error, "--out %s holds no --texels %s", path, texels);
    return 0;
}

static int check_light_volume_name(const arguments *all, ex_error *error) {
    const char *input = find_input(all, all->out);
    if (input) return ex_fail(error, "--out %s is a file that %s reads", all->out, input);
    return ex_check_writable(all->out, error);
}

/* Writes the file, and says where its probes are: seventeen digits tell all doubles apart. */
static int write_light_volume(const arguments *all, const ex_light_volume *volume, ex_error *error) {
    const int is_dds = ends_with(all->out, ".dds"), is_float = all->bake.texels == EX_CARD_FLOAT;
    const size_t beyond = is_dds && !is_float ? ex_light_volume_beyond(volume) : 0;
    const double *o = volume->origin, *s = volume->spacing;
    if (is_dds ? ex_light_volume_write_dds(all->out, volume, is_float, error)
               : ex_light_volume_write_npy(all->out, volume, error))
        return EX_MISTAKEN;
    if (beyond > 0)
        fprintf(stderr, "bake: %s: %zu numbers exceed 65504, and become it: --texels float keeps them\n",
                ex_quoted(all->out).text, beyond);
    printf("probes %d,%d,%d lights %d origin %.17g,%.17g,%.17g spacing %.17g,%.17g,%.17g\n", volume->count[0],
           volume->count[1], volume->count[2], volume->lights, o[0], o[1], o[2], s[0], s[1], s[2]);
    return EX_OK;
}

static int load_light_volume(arguments *all, const scene_arrays *arrays, ex_error *error) {
    double lo[3], hi[3];
    sps_scene scene;
    sps_view view;
    ex_session session;
    ex_light_volume volume;
    memset(&scene, 0, sizeof scene), memset(&view, 0, sizeof view), memset(&volume, 0, sizeof volume);
    if (load_scene(all, arrays, &scene, error)) return EX_MISTAKEN;
    if (!find_bounds(all, lo, hi)) {
        ex_fail(error, "nothing to bake: the scene is empty");
        return EX_MISTAKEN;
    }
    volume.lights = scene.light_count;
    if (ex_light_volume_fit(lo, hi, has(all->given, "--probes") ? all->bake.probes : NULL, &volume, error) ||
        ex_light_volume_check(all->out, &volume, ends_with(all->out, ".dds"), error))
        return EX_MISTAKEN;
    if (ex_session_begin(&session, all->threads, error)) return EX_FAILED;
    make_view(all, &view);
    const sps_result result = ex_light_volume_compute(session.context, &scene, &view, &volume);
    ex_progress_end(&session.progress);
    const int status =
        result == SPS_OK ? write_light_volume(all, &volume, error) : explain(all, &session, result, error);
    ex_session_end(&session);
    ex_light_volume_free(&volume);
    return status;
}

static int bake_light_volume(settings *given, ex_error *error) {
    static const one_scene steps = {check_light_volume, check_light_volume_name, load_light_volume};
    if (asks_for_help(given)) return help("bake light-volume [options]", refused_by_light_volume, for_maps_alone);
    return bake_one_scene(&steps, given, error);
}

/* ============================================================================================== the program */

/* What stands first on the command line. */
static const struct {
    const char *name, *help;
    int (*run_fn)(settings *given, ex_error *error);
} commands[] = {{"six-way", "lightmaps of a card of smoke, for engines that light it from six sides", bake_six_way},
                {"map", "a transmittance map: the fraction of a light that reaches any point", bake_map},
                {"cloud-shadow", "maps of the sunlight that passes clouds, over a terrain", bake_cloud_shadow},
                {"impostor", "a card that stands for a scene: color and alpha; normals and depths", bake_impostor},
                {"light-volume", "a grid of light probes", bake_light_volume}};

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
