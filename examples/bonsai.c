/* A scanned bonsai above polygon mushrooms on a floor, with the shadows of all of them. The scan is read from the
   folder that SPLATSHADOW_DATA names. */

#include "scans.h"
#include "scene.h"
#include "scene_program.h"
#include "shapes.h"

#define FLOOR 0.25 /* hides the mat under the pot */

/* The floor, and mushrooms around the pot. */
static void build_polygons(ex_mesh *mesh) {
    static const float planks[3] = {0.32f, 0.29f, 0.25f}, red[3] = {0.62f, 0.05f, 0.03f},
                       ochre[3] = {0.68f, 0.36f, 0.08f}, brown[3] = {0.36f, 0.17f, 0.07f};
    ex_shape_quad(mesh, ex_vec_of(-20, FLOOR, -20), ex_vec_of(-20, FLOOR, 20), ex_vec_of(20, FLOOR, 20),
                  ex_vec_of(20, FLOOR, -20), planks);
    ex_shape_mushroom(mesh, ex_vec_of(0.78, FLOOR, 0.55), ex_vec_of(0.05, 1, 0.08), 0.52, 0.28, red, ex_paint_dots);
    ex_shape_mushroom(mesh, ex_vec_of(1.22, FLOOR, 0.28), ex_vec_of(0.14, 1, 0.02), 0.34, 0.20, ochre, NULL);
    ex_shape_mushroom(mesh, ex_vec_of(0.10, FLOOR, 1.15), ex_vec_of(-0.1, 1, 0.1), 0.27, 0.17, brown, NULL);
}

int main(int argc, char **argv) {
    const sps_light sun = ex_sun(ex_vec_of(0.75, -1.5, 0.12), 4.2);
    sps_view view = ex_view(ex_vec_of(1.5, 2.5, 4.8), ex_vec_of(0.30, 0.88, 0), 29);
    sps_scene scene = ex_scene(&sun);
    sps_volume bonsai = {0};
    ex_grid grid = {0};
    ex_mesh polygons = {0};
    ex_error error;
    view.quality = SPS_QUALITY_MEDIUM;
    if (ex_bonsai_load(&grid, &error)) {
        fprintf(stderr, "%s: %s\n", argv[0], error.text);
        return EX_MISTAKEN;
    }
    ex_bonsai_volume(&bonsai, &grid);
    bonsai.shading = SPS_SHADING_SURFACE;
    build_polygons(&polygons);
    const sps_mesh mesh = ex_shape_mesh(&polygons);
    scene.volumes = &bonsai, scene.volume_count = 1;
    scene.meshes = &mesh, scene.mesh_count = 1;
    /* Classified voxels are smaller than pixels. */
    const int status = ex_scene_program(argc, argv, "bonsai.png", &scene, &view, EX_SAMPLE_ALL);
    ex_mesh_free(&polygons);
    ex_grid_free(&grid);
    return status;
}
