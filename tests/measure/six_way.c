/* six-way: a baked flipbook of smoke beside renders of the same smoke, light by light.
   six_way smoke FOLDER              writes the smoke's frames, FOLDER/smoke000.nrrd and so on, for bake to read
   six_way compare FOLDER SCALE PNG  shades FOLDER/a.dds and b.dds, baked with that --scale, by six_way.glsl as C; draws
                                     the card above the render for each frame and light, and prints rms differences */

#define _POSIX_C_SOURCE 200809L
#include "densities.h"
#include "session.h"
#include "shaders/six_way.h"
#include "six_way.h"
#include "volume_file.h"

enum { VOXELS = 64, TILE = 80, FRAMES = 2, LIGHTS = 5, PIXELS = TILE * TILE };
enum { CARD_WIDTH = FRAMES * TILE, WIDTH = LIGHTS * TILE, HEIGHT = 2 * FRAMES * TILE };

/* From the smoke to the light, in the world: x is the camera's right, y is up, and the eye is at +z. */
static const struct {
    const char *name;
    double x, y, z;
} lights[LIGHTS] = {{"left", -1, 0, 0},
                    {"right", 1, 0, 0},
                    {"top", 0, 1, 0},
                    {"back", 0, 0, -1},
                    {"between right, top and front", 1, 1, 1}};

static void need(int failed, const char *why) {
    if (!failed) return;
    fprintf(stderr, "six_way: %s\n", why);
    exit(1);
}

static const char *name_in(const char *folder, const char *name, int number) {
    static char path[EX_PATH_MAX];
    snprintf(path, sizeof path, "%s/", folder);
    const size_t length = strlen(path);
    snprintf(path + length, sizeof path - length, name, number);
    return path;
}

/* --- the smoke --- */

/* A puff on a bent stem, which rises and grows from frame to frame; without any symmetry. The box is -1..1. */
static double smoke_value(ex_vec p, int frame) {
    static const double puffs[FRAMES][2][4] = {{{0.05, -0.05, 0, 0.46}, {0.36, -0.28, 0.15, 0.30}},
                                               {{0.08, 0.22, 0, 0.62}, {0.52, 0, 0.2, 0.40}}};
    const ex_vec foot = ex_vec_of(-0.5, -0.75, 0), middle = ex_vec_of(puffs[frame][0][0], puffs[frame][0][1], 0);
    double merged = exp(-12 * ex_rod_distance(p, foot, middle, 0.12, 0.22)); /* a smooth maximum of depths */
    for (int i = 0; i < 2; ++i) {
        const double *puff = puffs[frame][i];
        merged += exp(12 * (puff[3] - ex_vec_length(ex_vec_sub(p, ex_vec_of(puff[0], puff[1], puff[2])))));
    }
    const ex_vec blown = ex_vec_of(2.4 * p.x, 2.4 * p.y - 0.7 * frame, 2.4 * p.z);
    const double depth = log(merged) / 12 + 0.14 - 0.5 * ex_turbulence(blown, 4);
    return ex_ramp(0, 0.25, depth);
}

static void write_smoke(const char *folder) {
    static unsigned char voxels[VOXELS][VOXELS][VOXELS];
    char header[200];
    snprintf(header, sizeof header,
             "NRRD0004\ntype: uint8\ndimension: 3\nsizes: %d %d %d\nspacings: 0.12 0.12 0.12\nencoding: raw\n\n",
             VOXELS, VOXELS, VOXELS);
    for (int frame = 0; frame < FRAMES; ++frame) {
        ex_output output;
        ex_error error;
        for (int i = 0; i < VOXELS * VOXELS * VOXELS; ++i) {
            const int x = i % VOXELS, y = i / VOXELS % VOXELS, z = i / (VOXELS * VOXELS);
            const double scale = 2.0 / VOXELS;
            const ex_vec p = ex_vec_of(scale * (x + 0.5) - 1, scale * (y + 0.5) - 1, scale * (z + 0.5) - 1);
            voxels[z][y][x] = (unsigned char)(255 * smoke_value(p, frame) + 0.5);
        }
        need(ex_output_begin(&output, name_in(folder, "smoke%03d.nrrd", frame), &error), error.text);
        ex_output_bytes(&output, header, strlen(header));
        ex_output_bytes(&output, voxels, sizeof voxels);
        need(ex_output_end(&output, &error), error.text);
    }
}

/* --- the card, and what it should look like --- */

/* Reads the texels of one texture as a graphics card does. */
static void read_texture(const char *folder, const char *name, six_way_vec4 *out) {
    static unsigned char codes[EX_DDS_HEADER + 4 * FRAMES * PIXELS];
    FILE *file = fopen(name_in(folder, name, 0), "rb");
    need(!file, "a texture is missing");
    need(fread(codes, 1, sizeof codes, file) != sizeof codes || fgetc(file) != EOF, "a texture has a wrong length");
    fclose(file);
    for (int i = 0; i < FRAMES * PIXELS; ++i) {
        const unsigned char *code = codes + EX_DDS_HEADER + 4 * i;
        const six_way_vec4 texel = {(float)code[0] / 255, (float)code[1] / 255, (float)code[2] / 255,
                                    (float)code[3] / 255};
        out[i] = texel;
    }
}

/* Renders one frame in each light of irradiance `scale`. */
static void render_frame(sps_context *context, const char *path, float scale, float *rgba) {
    ex_volume_file file;
    ex_grid grid;
    ex_error error;
    sps_volume smoke = {0};
    sps_view view = {0};
    sps_tmap_settings table = {0};
    need(ex_volume_file_read(&file, path, &error) || ex_grid_load(&grid, &file.voxels, &error), error.text);
    memcpy(smoke.size, file.voxels.size, sizeof smoke.size);
    smoke.placement = ex_volume_file_placement(&file);
    smoke.read_fn = ex_grid_read, smoke.range_fn = ex_grid_range, smoke.user = &grid;
    smoke.extinction = 1; /* what bake sets without options */
    ex_color(smoke.albedo, 0.8, 0.8, 0.8);
    const double *lo = smoke.placement.origin, side = smoke.placement.axis[0][0];
    const double hi[3] = {lo[0] + side, lo[1] + side, lo[2] + side};
    view.width = view.height = TILE;
    view.camera.up[1] = 1;
    ex_card_fit(lo, hi, 0, &view.camera);
    table.technique = SPS_TMAP_TABLE;
    for (int k = 0; k < LIGHTS; ++k) {
        sps_light light = {0};
        sps_scene scene = {0};
        sps_image image = {0};
        light.kind = SPS_LIGHT_DIRECTIONAL, light.shadow_map = &table;
        light.direction[0] = -lights[k].x, light.direction[1] = -lights[k].y, light.direction[2] = -lights[k].z;
        light.color[0] = light.color[1] = light.color[2] = scale;
        scene.volumes = &smoke, scene.volume_count = 1;
        scene.lights = &light, scene.light_count = 1;
        image.rgba = rgba + 4 * PIXELS * k;
        need(sps_render(context, &scene, &view, &image) != SPS_OK, sps_error(context));
    }
    ex_grid_free(&grid);
}

/* Premultiplied radiance of a card's pixel in a light. */
static double shade(six_way_vec4 a, six_way_vec4 b, int light) {
    const ex_vec to = ex_vec_unit(ex_vec_of(lights[light].x, lights[light].y, lights[light].z));
    const six_way_vec3 towards = {(float)to.x, (float)to.y, (float)to.z};
    return (double)(six_way_radiance(a, b, towards) * a.w);
}

static void compare(const char *folder, float scale, const char *out) {
    static six_way_vec4 a[FRAMES * PIXELS], b[FRAMES * PIXELS];
    static float rgba[LIGHTS * PIXELS * 4];
    static unsigned char picture[HEIGHT * WIDTH];
    double squares[LIGHTS] = {0}, sum[LIGHTS] = {0};
    ex_session session;
    ex_error error;
    read_texture(folder, "a.dds", a), read_texture(folder, "b.dds", b);
    need(ex_session_begin(&session, 0, &error), error.text);
    for (int frame = 0; frame < FRAMES; ++frame) {
        render_frame(session.context, name_in(folder, "smoke%03d.nrrd", frame), scale, rgba);
        for (int i = 0; i < LIGHTS * PIXELS; ++i) {
            const int light = i / PIXELS, x = i % TILE, y = i / TILE % TILE;
            const int texel = y * CARD_WIDTH + frame * TILE + x;
            const double card = shade(a[texel], b[texel], light), rendered = (double)rgba[4 * i];
            unsigned char *pixel = picture + (2 * frame * TILE + y) * WIDTH + light * TILE + x;
            pixel[0] = ex_srgb_code((float)card), pixel[TILE * WIDTH] = ex_srgb_code((float)rendered);
            squares[light] += (card - rendered) * (card - rendered), sum[light] += rendered;
        }
    }
    ex_session_end(&session);
    for (int k = 0; k < LIGHTS; ++k)
        printf("light %s: rms difference %.2f %% of mean radiance\n", lights[k].name,
               100 * sqrt(squares[k] * FRAMES * PIXELS) / sum[k]);
    need(ex_write_png_codes(out, picture, WIDTH, HEIGHT, 1, &error), error.text);
}

int main(int argc, char **argv) {
    if (argc == 3 && strcmp(argv[1], "smoke") == 0)
        write_smoke(argv[2]);
    else if (argc == 5 && strcmp(argv[1], "compare") == 0)
        compare(argv[2], strtof(argv[3], NULL), argv[4]);
    else
        need(1, "smoke FOLDER, or compare FOLDER SCALE OUT.png");
    return 0;
}
