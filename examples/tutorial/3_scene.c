/* Step 3 of docs/tutorial.md: polygons over vertices in memory, particles, and two lights, one of them among the gas.
 */

#include "splatshadow.h"
#include "../picture.h"

enum { WIDTH = 320, HEIGHT = 240, STONES = 7, PUFFS = 4000 };

/* Vertices as a mesh file has them: place and color, one after the other. */
typedef struct vertex {
    float position[3], color[3];
} vertex;

static vertex vertices[4 + 8 * STONES];
static uint16_t indices[2 + 12 * STONES][3];
static sps_particle puffs[PUFFS];

static void build_ground(void) {
    static const vertex corners[4] = {{{-90, 0, 9}, {0.2f, 0.22f, 0.14f}},
                                      {{90, 0, 9}, {0.2f, 0.22f, 0.14f}},
                                      {{90, 0, -90}, {0.2f, 0.22f, 0.14f}},
                                      {{-90, 0, -90}, {0.2f, 0.22f, 0.14f}}};
    memcpy(vertices, corners, sizeof corners);
    for (int c = 0; c < 3; ++c) indices[0][c] = (uint16_t)c, indices[1][c] = (uint16_t)(c ? c + 1 : 0);
}

/* Corner i of a box is at its low or high side along x, y and z by bits 0, 1 and 2. Stands in a circle. */
static void build_stone(int number) {
    static const uint8_t faces[12][3] = {{0, 1, 3}, {0, 3, 2}, {4, 6, 7}, {4, 7, 5}, {0, 4, 5}, {0, 5, 1},
                                         {2, 3, 7}, {2, 7, 6}, {0, 2, 6}, {0, 6, 4}, {1, 5, 7}, {1, 7, 3}};
    const int first = 4 + 8 * number;
    const double angle = 6.2831853 * number / STONES + 0.25, s = sin(angle), c = cos(angle);
    for (int i = 0; i < 8; ++i) {
        const double across = i & 1 ? 0.2 : -0.2, out = i & 4 ? 1.65 : 1.4;
        const vertex corner = {{(float)(c * out - s * across), i & 2 ? 1.25f : -0.1f, (float)(s * out + c * across)},
                               {0.42f, 0.4f, 0.37f}};
        vertices[first + i] = corner;
    }
    for (int i = 0; i < 12; ++i)
        for (int k = 0; k < 3; ++k) indices[2 + 12 * number + i][k] = (uint16_t)(first + faces[i][k]);
}

/* 0..1, a step of a linear congruential generator. */
static float next_random(uint32_t *state) {
    *state = *state * 1664525u + 1013904223u;
    return (float)(*state >> 8) / 16777216.0f;
}

/* A low bank of mist: soft balls that overlap, of an optical depth of 0.007 each. */
static void fill_mist(void) {
    uint32_t state = 1;
    for (int i = 0; i < PUFFS; ++i) {
        const float angle = 6.2831853f * next_random(&state), out = 3.2f * sqrtf(next_random(&state));
        const float height = next_random(&state) * next_random(&state);
        const sps_particle puff = {.position = {out * cosf(angle), 1.3f * height, out * sinf(angle)},
                                   .radius = 0.2f + 0.25f * next_random(&state),
                                   .optical_depth = 0.007f};
        puffs[i] = puff;
    }
}

/* sps_particles.read_fn. */
static int read_mist(void *user, size_t first, size_t count, sps_particle *out) {
    memcpy(out, (const sps_particle *)user + first, count * sizeof *out);
    return 0;
}

int main(int argc, char **argv) {
    static float rgba[WIDTH * HEIGHT * 4];
    build_ground();
    for (int i = 0; i < STONES; ++i) build_stone(i);
    fill_mist();

    sps_indexed_mesh indexed = {.vertex_count = sizeof vertices / sizeof *vertices};
    indexed.positions = vertices[0].position, indexed.position_stride = sizeof(vertex);
    indexed.albedos = vertices[0].color, indexed.albedo_stride = sizeof(vertex);
    indexed.triangle_count = sizeof indices / sizeof *indices, indexed.indices_u16 = indices[0];
    sps_mesh mesh = {.triangle_count = indexed.triangle_count, .has_albedos = 1};
    mesh.read_fn = sps_indexed_mesh_read, mesh.user = &indexed;

    sps_particles mist = {.count = PUFFS, .read_fn = read_mist, .user = puffs, .soft = 1};
    for (int c = 0; c < 3; ++c) mist.albedo[c] = 0.95f;

    sps_light lights[2] = {{.direction = {0.8, -0.7, -0.5}, .color = {0.8f, 1.1f, 1.8f}}, /* the moon */
                           {.kind = SPS_LIGHT_POINT, .position = {0, 0.6, 0}, .color = {16, 10, 4.5f}}};

    sps_scene scene = {.meshes = &mesh, .mesh_count = 1, .particles = &mist, .particle_set_count = 1};
    scene.lights = lights, scene.light_count = 2;
    scene.background[0] = 0.02f, scene.background[1] = 0.03f, scene.background[2] = 0.06f;

    sps_view view = {.width = WIDTH, .height = HEIGHT, .scattering = SPS_SCATTERING_SINGLE};
    view.coverage_samples = 4; /* along each side of a pixel: smooth edges of the stones */
    view.camera = (sps_camera){.position = {1, 2.6, 6.4}, .target = {0, 0.3, 0}, .field_of_view = 0.62};
    view.camera.up[1] = 1;
    sps_image image = {.rgba = rgba};

    sps_context *context = sps_create(NULL, NULL);
    if (!context) return puts("out of memory"), 1;
    if (sps_render(context, &scene, &view, &image)) return puts(sps_error(context)), 1;
    sps_stats_report stats;
    sps_get_stats(context, &stats);
    printf("%llu particles, %llu triangles, %llu shadow rays, %.1f MB\n", (unsigned long long)stats.particles,
           (unsigned long long)stats.triangles, (unsigned long long)stats.shadow_rays, 1e-6 * (double)stats.bytes_peak);
    printf("%.1f M fragments for the eye, %.1f M for the light, %llu table made\n", 1e-6 * (double)stats.eye_fragments,
           1e-6 * (double)stats.light_fragments, (unsigned long long)stats.tables_made);
    sps_destroy(context);

    ex_error error;
    if (ex_write_picture(argc > 1 ? argv[1] : "3_scene.png", rgba, WIDTH, HEIGHT, &error)) return puts(error.text), 1;
    return 0;
}
