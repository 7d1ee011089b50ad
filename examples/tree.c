/* A volumetric tree above polygon mushrooms on a volumetric plate. A transfer function separates bark from leaves;
   volumes and polygons cast shadows on each other. */

#include "scene.h"
#include "scene_program.h"
#include "shapes.h"
#include "tree.h"

/* sps_volume.eval_fn: a low mound of mossy earth. */
static int earth_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], positions[1], positions[2]);
        const double around = sqrt(p.x * p.x + p.z * p.z), grain = ex_fractal(ex_vec_scale(p, 3.0), 3);
        const double top = 0.02 + 0.05 * ex_ramp(1.2, 0.2, around) + 0.03 * grain;
        const double distance = fmax(fmax(p.y - top, -0.10 - p.y), around - 1.70);
        out[i] = (float)(ex_solid(distance, 0.07) * ex_clamp(0.65 + 0.35 * grain, 0.4, 1));
    }
    return 0;
}

/* sps_volume.eval_fn: the rim of the clay dish that holds it. */
static int dish_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], positions[1], positions[2]);
        out[i] = (float)ex_solid(ex_ring_distance(p, ex_vec_of(0, -0.06, 0), ex_vec_of(0, 1, 0), 1.72, 0.13), 0.07);
    }
    return 0;
}

static void set_plate(sps_volume plate[2]) {
    static const sps_transfer_point earth[3] = {{0.15f, {0.17f, 0.26f, 0.05f}, 0, {0, 0, 0}},
                                                {0.40f, {0.25f, 0.34f, 0.08f}, 50, {0, 0, 0}},
                                                {0.80f, {0.50f, 0.42f, 0.22f}, 90, {0, 0, 0}}};
    static const sps_transfer_point clay[2] = {{0.15f, {0.58f, 0.36f, 0.27f}, 0, {0, 0, 0}},
                                               {0.50f, {0.58f, 0.36f, 0.27f}, 120, {0, 0, 0}}};
    static const sps_transfer earth_look = {earth, 3, NULL, NULL, 0}, clay_look = {clay, 2, NULL, NULL, 0};
    ex_volume_box(&plate[0], ex_vec_of(-1.75, -0.16, -1.75), ex_vec_of(1.75, 0.20, 1.75), 128);
    ex_volume_box(&plate[1], ex_vec_of(-1.92, -0.26, -1.92), ex_vec_of(1.92, 0.14, 1.92), 144);
    plate[0].eval_fn = earth_value, plate[0].concurrent = 1, plate[0].transfer = &earth_look;
    plate[1].eval_fn = dish_value, plate[1].concurrent = 1, plate[1].transfer = &clay_look;
    plate[0].shading = plate[1].shading = SPS_SHADING_SURFACE;
}

/* The S-shaped trunk of a bonsai, with branches at its bends. */
static void grow_tree(ex_tree *tree) {
    static const double trunk[6][3] = {{-0.45, -0.05, -0.20}, {-0.32, 0.30, -0.18}, {-0.02, 0.60, -0.22},
                                       {0.12, 0.90, -0.25},   {-0.05, 1.20, -0.22}, {-0.22, 1.45, -0.20}};
    static const double limbs[6][6] = {{-0.02, 0.60, -0.22, 0.85, 0.55, 0.45}, {0.12, 0.90, -0.25, 0.75, 0.55, -0.45},
                                       {0.05, 1.05, -0.22, -1.0, 0.30, 0.25},  {-0.10, 1.25, -0.22, 0.6, 0.5, 0.5},
                                       {-0.10, 1.25, -0.22, -0.7, 0.5, -0.6},  {-0.22, 1.45, -0.20, 0.0, 0.8, 0.15}};
    memset(tree, 0, sizeof *tree);
    tree->random = 19;
    for (int i = 0; i < 5; ++i) {
        const ex_vec a = ex_vec_of(trunk[i][0], trunk[i][1], trunk[i][2]);
        const ex_vec b = ex_vec_of(trunk[i + 1][0], trunk[i + 1][1], trunk[i + 1][2]);
        ex_tree_rod(tree, a, b, 0.17 - 0.022 * i, 0.17 - 0.022 * (i + 1));
    }
    for (int i = 0; i < 6; ++i) {
        const double *l = limbs[i];
        ex_tree_grow(tree, ex_vec_of(l[0], l[1], l[2]), ex_vec_unit(ex_vec_of(l[3], l[4], l[5])), 0.46, 0.075, 2);
    }
}

static void set_tree(sps_volume *volume, ex_grid *grid) {
    static const sps_transfer_point bark_and_leaves[6] = {
        {0.14f, {0.10f, 0.22f, 0.04f}, 0, {0, 0, 0}},   {0.22f, {0.12f, 0.27f, 0.04f}, 30, {0, 0, 0}},
        {0.30f, {0.20f, 0.38f, 0.06f}, 30, {0, 0, 0}},  {0.36f, {0.32f, 0.42f, 0.10f}, 30, {0, 0, 0}},
        {0.40f, {0.52f, 0.30f, 0.16f}, 200, {0, 0, 0}}, {1.00f, {0.56f, 0.33f, 0.19f}, 200, {0, 0, 0}}};
    static const sps_transfer look = {bark_and_leaves, 6, NULL, NULL, 0};
    static ex_tree tree;
    ex_volume_box(volume, ex_vec_of(-1.65, -0.1, -1.5), ex_vec_of(1.65, 2.55, 1.2), 160);
    grow_tree(&tree);
    ex_tree_fill(&tree, volume, grid);
    volume->read_fn = ex_grid_read, volume->range_fn = ex_grid_range, volume->user = grid;
    volume->concurrent = 1;
    volume->transfer = &look;
    volume->shading = SPS_SHADING_SURFACE;
}

static void build_mushrooms(ex_mesh *mesh) {
    static const float red[3] = {0.62f, 0.05f, 0.03f}, ochre[3] = {0.68f, 0.36f, 0.08f},
                       brown[3] = {0.36f, 0.17f, 0.07f};
    ex_shape_mushroom(mesh, ex_vec_of(0.30, 0.03, 0.62), ex_vec_of(0.05, 1, 0.08), 0.46, 0.27, red, ex_paint_dots);
    ex_shape_mushroom(mesh, ex_vec_of(0.78, 0.0, 0.62), ex_vec_of(0.14, 1, 0.02), 0.30, 0.19, ochre, NULL);
    ex_shape_mushroom(mesh, ex_vec_of(-0.22, 0.02, 0.95), ex_vec_of(-0.1, 1, 0.1), 0.25, 0.17, brown, NULL);
}

int main(int argc, char **argv) {
    const sps_light sun = ex_sun(ex_vec_of(0.55, -1.3, -0.12), 3.3);
    const sps_view view = ex_view(ex_vec_of(0.6, 2.5, 6.9), ex_vec_of(0.0, 0.86, 0), 29);
    sps_scene scene = ex_scene(&sun);
    sps_volume volumes[3];
    ex_grid grid = {0};
    ex_mesh mushrooms = {0};
    memset(volumes, 0, sizeof volumes);
    set_tree(&volumes[0], &grid);
    set_plate(&volumes[1]);
    build_mushrooms(&mushrooms);
    const sps_mesh mesh = ex_shape_mesh(&mushrooms);
    scene.volumes = volumes, scene.volume_count = 3;
    scene.meshes = &mesh, scene.mesh_count = 1;
    /* Classified voxels are hardly larger than pixels. */
    const int status = ex_scene_program(argc, argv, "tree.png", &scene, &view, EX_SAMPLE_ALL);
    ex_grid_free(&grid);
    ex_mesh_free(&mushrooms);
    return status;
}
