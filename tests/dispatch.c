/* dispatch FILE: what a program sees of a library that chooses between variants, for tests/dispatch.sh: its callbacks
   for grids and meshes are known to be the library's own. Then writes the pictures of port_pictures.h.
   dispatch compare FILE FILE  as ports does
   It is compiled with SPSI_IMPLEMENTED, so that the implementation comes from an object. */

#include <float.h>
#include "port_pictures.h"

static unsigned char voxels[40 * 40 * 40];
static sps_grid grid = {.voxels = voxels, .format = SPS_VOXEL_U8, .size = {40, 40, 40}};

/* Within loops of workers, voxels have twice their value. */
static void loop_serially(void *user, int count, sps_task_fn task, void *task_data) {
    (void)user;
    grid.scale = 2;
    for (int i = 0; i < count; ++i) task(task_data, i, 0);
    grid.scale = 1;
}

static int wrapped_range(void *user, const int lo[3], const int size[3], float out_min_max[2]) {
    return sps_grid_range(user, lo, size, out_min_max);
}

static sps_volume *add_grid(check_scene *s) {
    sps_volume *volume = check_add_volume(s, 40, 40, 40, check_box(-1, -1, -1, 1, 1, 1));
    memset(voxels, 1, sizeof voxels);
    volume->read_fn = sps_grid_read, volume->range_fn = sps_grid_range, volume->user = &grid;
    volume->extinction = 0.05f;
    return volume;
}

/* A grid is checked before it is read. */
static void test_grid_is_checked(void) {
    sps_context *context = check_context(NULL);
    sps_error_info why;
    check_scene s;
    float rgba[4 * 8 * 8];
    const sps_image image = {.rgba = rgba};
    check_clear(&s, 8, 8);
    add_grid(&s);
    grid.format = (sps_voxel_format)0;
    CHECK(sps_render(context, &s.scene, &s.view, &image) == SPS_ERROR_ARGUMENT);
    sps_get_error(context, &why);
    CHECK(strcmp(why.field, "grid.format") == 0);
    grid.format = SPS_VOXEL_U8;
    CHECK_OK(context, sps_render(context, &s.scene, &s.view, &image));
    sps_destroy(context);
}

/* Coverage of a pixel in the middle */
static float coverage_with(int (*range_fn)(void *, const int *, const int *, float *)) {
    const sps_config config = {.parallel_for_fn = loop_serially, .worker_count = 2};
    sps_context *context = sps_create(&config, NULL);
    check_scene s;
    float rgba[4 * 8 * 8];
    const sps_image image = {.rgba = rgba};
    check_clear(&s, 8, 8);
    add_grid(&s)->range_fn = range_fn;
    CHECK_OK(context, sps_render(context, &s.scene, &s.view, &image));
    sps_destroy(context);
    return rgba[4 * (4 * 8 + 4) + 3];
}

/* Workers read a grid, unless a callback wraps its functions. Coverage grows by less than the extinction. */
static void test_grid_is_read_by_workers(void) {
    const float alone = coverage_with(wrapped_range);
    CHECK(alone > 0.01f && coverage_with(sps_grid_range) > 1.5f * alone);
}

/* The sentence says what only the library's own callback can mean. */
static void test_mesh_is_explained(void) {
    static const float corners[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    static const uint16_t indices[3] = {0, 1, 3};
    sps_indexed_mesh net = {.vertex_count = 3, .positions = corners, .triangle_count = 1, .indices_u16 = indices};
    const sps_mesh mesh = {.triangle_count = 1, .read_fn = sps_indexed_mesh_read, .user = &net};
    sps_context *context = check_context(NULL);
    check_scene s;
    float rgba[4 * 8 * 8];
    const sps_image image = {.rgba = rgba};
    check_clear(&s, 8, 8);
    s.scene.meshes = &mesh, s.scene.mesh_count = 1;
    CHECK(sps_render(context, &s.scene, &s.view, &image) == SPS_ERROR_CALLBACK);
    CHECK(strstr(sps_error(context), "an index is not below vertex_count") != NULL);
    sps_destroy(context);
}

int main(int argc, char **argv) {
    if (argc == 4 && !strcmp(argv[1], "compare")) return compare_pictures(argv[2], argv[3]);
    CHECK(sps_version() == SPS_VERSION);
    RUN(test_grid_is_checked);
    RUN(test_grid_is_read_by_workers);
    RUN(test_mesh_is_explained);
    CHECK(argc == 2 && write_pictures(argv[1]) == 0);
    return check_report();
}
