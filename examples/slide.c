/* A slide thrown through smoke onto a wall: on the left by a point, sharp everywhere; on the right through a lens, a
   disc that is in focus on the wall, so that beams are soft near it. */

#include "scene.h"
#include "scene_program.h"
#include "shapes.h"
#include "slide.h"

enum { SHARP = 0, LENS, PANELS };

/* A rose window: petals of colored glass about a round pane, held by dark lead. */
static void draw_window(ex_slide *slide) {
    static const float glass[4][3] = {{1, 0.08f, 0.04f}, {0.06f, 0.16f, 1}, {1, 0.55f, 0.05f}, {0.08f, 0.7f, 0.2f}};
    for (int i = 0; i < slide->width * slide->height; ++i) {
        const double x = 2 * (i % slide->width + 0.5) / slide->width - 1;
        const double y = 2 * (i / slide->width + 0.5) / slide->height - 1;
        const double radius = hypot(x, y), petal = 6 * (atan2(y, x) / (2 * EX_PI) + 0.5);
        const int in_petal = radius > 0.46 && radius < 0.92 && fabs(petal - floor(petal) - 0.5) < 0.42;
        const float *color = glass[radius < 0.38 ? 0 : 1 + (int)petal % 3];
        for (int c = 0; c < 3; ++c) slide->rgb[3 * i + c] = radius < 0.38 || in_petal ? color[c] : 0;
    }
}

/* Two opposite corners of the smoke. */
static const double smoke_ends[2][3] = {{-3.5, 0, -1.4}, {2, 2.9, 1.4}};

/* sps_volume.eval_fn: drifting smoke, which fades towards the faces of its box, except for the wall's. */
static int smoke_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], 1.6 * positions[1], positions[2]);
        double fade = ex_ramp(smoke_ends[0][0], smoke_ends[0][0] + 1.6, positions[0]);
        for (int axis = 1; axis < 3; ++axis) {
            const double low = positions[axis] - smoke_ends[0][axis], high = smoke_ends[1][axis] - positions[axis];
            fade *= ex_ramp(0, 0.7, fmin(low, high));
        }
        out[i] = (float)(fade * (0.3 + 1.5 * ex_turbulence(ex_vec_scale(p, 1.6), 4)));
    }
    return 0;
}

static void set_smoke(sps_volume *smoke) {
    static const sps_lobe forward = {0.35f, 1};
    const double *low = smoke_ends[0], *high = smoke_ends[1];
    ex_volume_box(smoke, ex_vec_of(low[0], low[1], low[2]), ex_vec_of(high[0], high[1], high[2]), 48);
    smoke->eval_fn = smoke_value, smoke->concurrent = 1;
    smoke->extinction = 0.45f;
    ex_color(smoke->albedo, 0.95, 0.95, 0.95);
    smoke->lobes = &forward, smoke->lobe_count = 1;
}

/* A floor, and the wall at the right that the slide is thrown at. */
static void build_room(ex_mesh *mesh) {
    static const float stone[3] = {0.42f, 0.40f, 0.38f}, plaster[3] = {0.75f, 0.74f, 0.72f};
    ex_shape_quad(mesh, ex_vec_of(-9, 0, -9), ex_vec_of(-9, 0, 9), ex_vec_of(9, 0, 9), ex_vec_of(9, 0, -9), stone);
    ex_shape_quad(mesh, ex_vec_of(2, 0, 5), ex_vec_of(2, 0, -5), ex_vec_of(2, 5, -5), ex_vec_of(2, 5, 5), plaster);
}

static void set_lamp(sps_light *lamp, const sps_projector *projector, int panel) {
    memset(lamp, 0, sizeof *lamp);
    lamp->kind = panel == LENS ? SPS_LIGHT_DISC : SPS_LIGHT_POINT;
    lamp->position[0] = -6, lamp->position[1] = 1.7;
    lamp->direction[0] = 1, lamp->direction[1] = -0.06;
    lamp->axes[0][1] = lamp->axes[1][2] = 0.3; /* a lens of this radius, across the axis */
    ex_color(lamp->color, 2000, 2000, 2000);
    lamp->projector = projector;
    lamp->samples = 16;
}

int main(int argc, char **argv) {
    sps_light lamps[PANELS];
    sps_scene scenes[PANELS];
    sps_projector projectors[PANELS];
    const ex_panels panels = {scenes, PANELS, EX_SAMPLE_EDGES, NULL};
    sps_view view = ex_view(ex_vec_of(-3.6, 2.1, 9), ex_vec_of(-0.4, 1.15, 0), 24);
    sps_volume smoke = {0};
    ex_mesh room = {0};
    ex_slide slide = {256, 256, NULL};
    slide.rgb = (float *)ex_allocate((size_t)slide.width * (size_t)slide.height, 3 * sizeof(float));
    view.width = 320, view.height = 220, view.quality = SPS_QUALITY_MEDIUM;
    draw_window(&slide);
    set_smoke(&smoke);
    build_room(&room);
    const sps_mesh mesh = ex_shape_mesh(&room);
    for (int i = 0; i < PANELS; ++i) {
        projectors[i] = ex_slide_projector(&slide, 16);
        projectors[i].up[1] = 1;
        projectors[i].focus = 8; /* the wall */
        set_lamp(&lamps[i], &projectors[i], i);
        scenes[i] = ex_scene(&lamps[i]);
        scenes[i].background_fn = NULL;
        ex_color(scenes[i].background, 0.03, 0.031, 0.036);
        ex_color(scenes[i].ambient, 0.055, 0.056, 0.065);
        scenes[i].volumes = &smoke, scenes[i].volume_count = 1;
        scenes[i].meshes = &mesh, scenes[i].mesh_count = 1;
    }
    const int status = ex_panels_program(argc, argv, "slide.png", &panels, &view);
    ex_slide_free(&slide);
    ex_mesh_free(&room);
    return status;
}
