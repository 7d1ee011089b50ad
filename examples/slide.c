/* A slide thrown through smoke onto a wall: on the left by a point, sharp everywhere; on the right through a lens, a
   disc that is in focus on the wall, so that beams are soft near it.
   cc -std=c99 -O3 -march=native -pthread -I. -I/usr/include/stb examples/slide.c -o slide -lm */

#define SPLATSHADOW_IMPLEMENTATION
#include "scene.h"
#include "scene_program.h"
#include "shapes.h"
#include "slide.h"

enum { SHARP = 0, LENS, PANELS };

/* A rose window: rings of petals of colored glass, held by dark lead. */
static void draw_window(ex_slide *slide) {
    static const float glass[4][3] = {{1, 0.10f, 0.06f}, {0.10f, 0.22f, 1}, {1, 0.62f, 0.08f}, {0.12f, 0.75f, 0.25f}};
    for (int i = 0; i < slide->width * slide->height; ++i) {
        const double x = 2 * (i % slide->width + 0.5) / slide->width - 1;
        const double y = 2 * (i / slide->width + 0.5) / slide->height - 1;
        const double radius = sqrt(x * x + y * y), ring = radius * 3.4, turn = atan2(y, x) / (2 * EX_PI) + 0.5;
        const int row = (int)ring, petals = row ? 6 * row : 1;
        const double petal = turn * petals + 0.5 * row, beside = fabs(petal - floor(petal) - 0.5);
        const int open = row < 3 && ring - row > 0.1 && ring - row < 0.9 && (row == 0 || beside < 0.42);
        const float *color = glass[(row + (int)petal % 2 * 2) % 4];
        for (int c = 0; c < 3; ++c) slide->rgb[3 * i + c] = open ? color[c] : 0;
    }
}

/* sps_volume.eval_fn: drifting smoke. */
static int smoke_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], 1.6 * positions[1], positions[2]);
        out[i] = (float)(0.35 + 1.3 * ex_turbulence(ex_vec_scale(p, 1.6), 4));
    }
    return 0;
}

static void set_smoke(sps_volume *smoke) {
    static const sps_lobe forward = {0.35f, 1};
    ex_volume_box(smoke, ex_vec_of(-2.2, 0.02, -1.3), ex_vec_of(1.95, 2.4, 1.3), 56);
    smoke->eval_fn = smoke_value;
    smoke->extinction = 0.5f;
    ex_color(smoke->albedo, 0.95, 0.95, 0.95);
    smoke->lobes = &forward, smoke->lobe_count = 1;
}

/* A floor, and the wall at the right that the slide is thrown at. */
static void build_room(ex_mesh *mesh) {
    static const float stone[3] = {0.30f, 0.29f, 0.28f}, plaster[3] = {0.75f, 0.74f, 0.72f};
    ex_shape_quad(mesh, ex_vec_of(-9, 0, -9), ex_vec_of(-9, 0, 9), ex_vec_of(9, 0, 9), ex_vec_of(9, 0, -9), stone);
    ex_shape_quad(mesh, ex_vec_of(2, 0, 5), ex_vec_of(2, 0, -5), ex_vec_of(2, 5, -5), ex_vec_of(2, 5, 5), plaster);
}

static void set_lamp(sps_light *lamp, const sps_projector *projector, int panel) {
    memset(lamp, 0, sizeof *lamp);
    lamp->kind = panel == LENS ? SPS_LIGHT_DISC : SPS_LIGHT_POINT;
    lamp->position[0] = -6, lamp->position[1] = 1.7;
    lamp->direction[0] = 1, lamp->direction[1] = -0.06;
    lamp->axes[0][1] = lamp->axes[1][2] = 0.2; /* a lens of this radius, across the axis */
    ex_color(lamp->color, 1500, 1500, 1500);
    lamp->projector = projector;
    lamp->samples = 32;
}

int main(int argc, char **argv) {
    sps_light lamps[PANELS];
    sps_scene scenes[PANELS];
    sps_projector projectors[PANELS];
    const ex_panels panels = {scenes, PANELS, NULL};
    sps_view view = ex_view(ex_vec_of(-3.4, 2.1, 9), ex_vec_of(0.1, 1.1, 0), 24);
    sps_volume smoke = {0};
    ex_mesh room = {0};
    ex_slide slide = {384, 384, NULL};
    slide.rgb = (float *)ex_allocate((size_t)slide.width * (size_t)slide.height, 3 * sizeof(float));
    view.width = 340, view.height = 240, view.quality = SPS_QUALITY_MEDIUM;
    draw_window(&slide);
    set_smoke(&smoke);
    build_room(&room);
    const sps_mesh mesh = ex_shape_mesh(&room);
    for (int i = 0; i < PANELS; ++i) {
        projectors[i] = ex_slide_projector(&slide, 14);
        projectors[i].up[1] = 1;
        projectors[i].focus = 8; /* the wall */
        set_lamp(&lamps[i], &projectors[i], i);
        scenes[i] = ex_scene(&lamps[i]);
        scenes[i].background_fn = NULL;
        ex_color(scenes[i].background, 0.004, 0.005, 0.008);
        ex_color(scenes[i].ambient, 0.012, 0.014, 0.02);
        scenes[i].volumes = &smoke, scenes[i].volume_count = 1;
        scenes[i].meshes = &mesh, scenes[i].mesh_count = 1;
    }
    const int status = ex_panels_program(argc, argv, "slide.png", &panels, &view);
    ex_slide_free(&slide);
    ex_mesh_free(&room);
    return status;
}
