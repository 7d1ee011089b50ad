/* The command line of examples/render.c over files with arbitrary contents, which are drawn by test_seeds.c. Each is
   read through an option of its own, or is a look, and what it holds is rendered as a tiny picture. */

#ifndef FUZZ_FILES_H
#define FUZZ_FILES_H

#include "check.h"

/* The examples are C99 only. */
#ifndef __cplusplus

/* The program writes nothing here, and needs no library that does. */
#define EX_PICTURE_H
#include "files.h"
static int ex_write_png(const char *path, const float *pixels, int width, int height, ex_error *error) {
    (void)path, (void)pixels, (void)width, (void)height, (void)error;
    return 0;
}
static int ex_write_hdr(const char *path, const float *pixels, int width, int height, ex_error *error) {
    (void)path, (void)pixels, (void)width, (void)height, (void)error;
    return 0;
}
static int ex_write_pfm(const char *path, const float *pixels, int width, int height, int first_channel, int channels,
                        ex_error *error) {
    (void)path, (void)pixels, (void)width, (void)height, (void)first_channel, (void)channels, (void)error;
    return 0;
}
#include "command_line.h"
int render_main(int count, char **texts);
#define main render_main
#include "../examples/render.c"
#undef main

/* Files beside it that a look or a header may name: "v" and "f.img" are voxels, "o" is a mesh, "p" particles, "i" an
   image, "t" a transfer function. */
static void write_companions(void) {
    static const float particles[10] = {0, 0, 0, 0.5f, 1, 0.5f, 0.5f, 0, 0.25f, 2};
    static const char mesh[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 1\nf 1/1 2 3\n", image[] = "P6 1 2 255 abcdef";
    static const char transfer[] = "0 0 0 0 0\n1 1 0.5 0 20\n";
    uint8_t voxels[64];
    for (int i = 0; i < 64; ++i) voxels[i] = (uint8_t)(37 * i);
    write_file("v", voxels, sizeof voxels);
    write_file("f.img", voxels, sizeof voxels);
    write_file("o", mesh, sizeof mesh - 1);
    write_file("p", particles, sizeof particles);
    write_file("i", image, sizeof image - 1);
    write_file("t", transfer, sizeof transfer - 1);
}

static void files_end(void) { folder_end(); }

/* Makes the folder once. */
static int files_begin(void) {
    static int state; /* 1: it is there, -1: that is not possible */
    if (state == 0) {
        state = folder_begin() ? 1 : -1;
        if (state == 1) write_companions(), atexit(files_end);
    }
    return state == 1;
}

/* What a look may ask for in any size is tiny here. */
static void make_tiny(sps_view *view, sps_light *lights, const sps_scene *scene) {
    memset(view->region, 0, sizeof view->region);
    view->width = view->width < 6 ? view->width : 6;
    view->height = view->height < 6 ? view->height : 6;
    view->shadow_resolution = 16;
    view->scattering_resolution =
        view->scattering_resolution > 0 && view->scattering_resolution < 4 ? view->scattering_resolution : 4;
    for (int i = 0; i < scene->light_count; ++i) {
        lights[i].shadow_map_resolution = 8;
        if (lights[i].samples == 0 || lights[i].samples > 8) lights[i].samples = 8;
    }
}

/* Renders the scene in a context that can be cancelled. */
static void render_read(const arguments *all, const sps_scene *scene, const sps_view *view, sps_context *context) {
    float pixels[4 * 6 * 6];
    ex_session session;
    ex_error error;
    sps_plan_report plan;
    sps_reference_settings march;
    sps_image image;
    memset(&image, 0, sizeof image), memset(&march, 0, sizeof march), memset(&session, 0, sizeof session);
    session.context = context;
    image.rgba = pixels;
    march.step = all->slab > 0 ? all->slab : 0.5, march.samples = all->samples < 2 ? all->samples : 2;
    if (!is_marched(all)) sps_plan(context, scene, view, &plan);
    const sps_result result = is_marched(all) ? sps_reference(context, scene, view, &march, &image)
                                              : sps_render(context, scene, view, &image);
    if (result != SPS_OK) {
        explain(all, &session, result, &error);
        CHECK(error.text[0] != 0 && is_printable(error.text, strlen(error.text)));
        return;
    }
    for (int i = 0; i < 4 * view->width * view->height; ++i)
        if (!CHECK(pixels[i] >= 0 && pixels[i] <= FLT_MAX)) printf("    number %d: %g\n", i, (double)pixels[i]);
}

/* Whether a few bytes stand for more voxels than can be rendered soon. */
static int is_huge(const sps_scene *scene) {
    for (int i = 0; i < scene->volume_count; ++i) {
        const int *size = scene->volumes[i].size;
        if ((double)size[0] * size[1] * size[2] > 300000) return 1;
    }
    return 0;
}

/* Loads and renders what the settings name; as run of render.c. Returns whether there was a mistake, which is told. */
static int run_read(arguments *all, const scene_arrays *arrays, sps_context *context, ex_error *error) {
    sps_scene scene;
    sps_view view;
    memset(&scene, 0, sizeof scene), memset(&view, 0, sizeof view);
    if (apply_settings(all, error) || all->help) return !all->help;
    if (find_volumes(all, error) || check(all, error) || load_scene(all, arrays, &scene, error)) return 1;
    if (is_huge(&scene)) return 0;
    make_view(all, &view);
    make_tiny(&view, arrays->lights, &scene);
    render_read(all, &scene, &view, context);
    return 0;
}

/* A command line, as the program runs it. */
static void try_command_line(int count, char **texts, sps_context *context) {
    settings given = {0};
    arguments all;
    ex_error error;
    error.text[0] = 0;
    int wrong = read_settings(count, texts, &given, &error);
    if (!wrong) {
        const size_t most = given.count + 1;
        const scene_arrays arrays = {(sps_volume *)ex_allocate(most, sizeof(sps_volume)),
                                     (sps_particles *)ex_allocate(most, sizeof(sps_particles)),
                                     (sps_mesh *)ex_allocate(most, sizeof(sps_mesh)),
                                     (sps_light *)ex_allocate(most, sizeof(sps_light))};
        begin_arguments(&all, &given);
        wrong = run_read(&all, &arrays, context, &error);
        free_arguments(&all);
        free(arrays.volumes), free(arrays.particles), free(arrays.meshes), free(arrays.lights);
    }
    if (wrong) CHECK(error.text[0] != 0 && is_printable(error.text, strlen(error.text)));
    free_settings(&given);
}

/* A kind of file: the letter that selects it, its name, and the options that read it, in which FILE is its path. */
typedef struct file_kind {
    char letter;
    const char *name, *options[10];
} file_kind;

static const file_kind file_kinds[] = {
    {'n', "f.nrrd", {"--volume", "FILE"}},
    {'h', "f.nhdr", {"--volume", "FILE", "--shading", "surface"}},
    {'a', "f.mha", {"--volume", "FILE"}},
    {'d', "f.mhd", {"--volume", "FILE"}},
    {'i', "f.nii", {"--volume", "FILE"}},
    {'y', "f.npy", {"--volume", "FILE"}},
    {'g', "f.nii.gz", {"--volume", "FILE"}},
    {'x', "f.hdr", {"--volume", "FILE"}}, /* the voxels are in f.img */
    {'z', "f.npz", {"--volume", "FILE"}},
    {'w', "f.raw", {"--volume", "FILE", "--size", "3,2,2", "--type", "f32"}},
    {'v', "f.vdb", {"--volume", "FILE"}},
    {'V', "f.vdb", {"--volume", "FILE", "--fog"}},
    {'k', "f.nvdb", {"--volume", "FILE"}},
    {'o', "f.obj", {"--mesh", "FILE"}},
    {'p', "f.bin", {"--particles", "FILE"}},
    {'j', "f.ppm", {"--mesh", "FOLDER/o"}}, /* the image of a projector */
    {'t', "f.txt", {"--volume", "FOLDER/v", "--size", "4,4,4", "--transfer", "FILE"}},
    {'l', "f.look", {"--look", "FILE"}}};

enum { FILE_KINDS = sizeof file_kinds / sizeof *file_kinds };

/* Files of trees are mostly zeros, which are given as a zero and their number: n + 1, or (n - 127) * 64 from 128 on.
   The caller frees them. */
static uint8_t *expand_zeros(const uint8_t *data, size_t size, size_t *out_size) {
    const size_t most = 1 << 21;
    uint8_t *out = (uint8_t *)ex_allocate(most, 1);
    size_t count = 0;
    for (size_t i = 0; i < size && count < most; ++i) {
        if (data[i] != 0) {
            out[count++] = data[i];
            continue;
        }
        const size_t n = i + 1 < size ? data[++i] : 0;
        count += n < 128 ? n + 1 : (n - 127) * 64;
    }
    *out_size = count < most ? count : most;
    return out;
}

/* Writes a file of a kind and runs the command line over it. */
static void try_file(const file_kind *kind, const uint8_t *data, size_t size, sps_context *context) {
    char path[100], shared[100], light[200], program[] = "render", out[] = "--plan", *texts[16];
    char words[10][20], light_option[] = "--light", plain[] = "directional,1,-1,-1,1,2,3";
    int count = 0;
    if (!files_begin()) return;
    if (strstr(kind->name, "vdb")) {
        size_t expanded = 0;
        uint8_t *tree = expand_zeros(data, size, &expanded);
        write_file(kind->name, tree, expanded);
        free(tree);
    } else {
        write_file(kind->name, data, size);
    }
    snprintf(path, sizeof path, "%s/%s", folder, kind->name);
    texts[count++] = program;
    for (int i = 0; kind->options[i]; ++i) {
        snprintf(words[i], sizeof words[i], "%s", kind->options[i]);
        texts[count++] = strcmp(words[i], "FILE") == 0 ? path : words[i];
        if (strncmp(words[i], "FOLDER", 6) != 0) continue;
        snprintf(shared, sizeof shared, "%s%s", folder, words[i] + 6);
        texts[count - 1] = shared;
    }
    snprintf(light, sizeof light, "projector,0,0,2,0,0,-1,60,1,1,1,%s", path);
    if (kind->letter != 'l') { /* a look says itself what is to be done */
        texts[count++] = out, texts[count++] = light_option;
        texts[count++] = kind->letter == 'j' ? light : plain;
    }
    try_command_line(count, texts, context);
}

#endif /* __cplusplus */
#endif /* FUZZ_FILES_H */
