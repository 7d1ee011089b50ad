/* sps_grid and sps_indexed_mesh: the library reads the values that arrays in the caller's memory hold, and invalid
   arrays are errors. Expected values are computed independently here, with doubles and ldexp. */

#include "check.h"

enum { NX = 7, NY = 5, NZ = 4, VOXELS = NX * NY * NZ };

/* ------------------------------------------------------------------------------------------------------------ grids */

/* A half-precision number by its definition. */
static double half_value(unsigned half) {
    const int exponent = (int)(half >> 10 & 31), fraction = (int)(half & 1023);
    const double sign = half >> 15 ? -1 : 1;
    if (exponent == 31) return fraction ? HUGE_VAL - HUGE_VAL : sign * HUGE_VAL;
    return sign * (exponent ? ldexp(1024 + fraction, exponent - 25) : ldexp(fraction, -24));
}

/* The stored value of a voxel in each format: all different, except for bytes. */
static double stored(sps_voxel_format format, int x, int y, int z) {
    const int n = (z * NY + y) * NX + x;
    if (format == SPS_VOXEL_U8) return n;
    if (format == SPS_VOXEL_U16) return 60000 - 401 * n;
    if (format == SPS_VOXEL_I16) return -32768 + 471 * n; /* up to 32701 */
    return format == SPS_VOXEL_F16 ? half_value((unsigned)(0x0380 + 97 * n)) : 0.25 + n * 0.375;
}

static size_t voxel_bytes(sps_voxel_format format) {
    return format == SPS_VOXEL_U8 ? 1 : format == SPS_VOXEL_F32 ? 4 : 2;
}

static void store(sps_voxel_format format, int x, int y, int z, char *at) {
    const int n = (z * NY + y) * NX + x;
    const unsigned char byte = (unsigned char)n;
    const uint16_t word = (uint16_t)(format == SPS_VOXEL_U16   ? 60000 - 401 * n
                                     : format == SPS_VOXEL_I16 ? 32768 + 471 * n /* two's complement */
                                                               : 0x0380 + 97 * n);
    const float number = 0.25f + (float)n * 0.375f;
    memcpy(at,
           format == SPS_VOXEL_U8    ? (const void *)&byte
           : format == SPS_VOXEL_F32 ? (const void *)&number
                                     : &word,
           voxel_bytes(format));
}

/* A grid of any layout in a buffer that is not aligned: 0: packed; 1: gaps between rows and layers; 2: z fastest; 3:
   rows and layers run backwards. */
static void fill(sps_grid *grid, sps_voxel_format format, int layout, char *buffer) {
    const ptrdiff_t bytes = (ptrdiff_t)voxel_bytes(format);
    ptrdiff_t stride[3] = {bytes, NX * bytes, NX * NY * bytes};
    char *first = buffer + 1;
    memset(grid, 0, sizeof *grid);
    if (layout == 1) stride[0] += 3, stride[1] = NX * stride[0] + 5, stride[2] = NY * stride[1] + 7;
    if (layout == 2) stride[2] = bytes, stride[1] = NZ * bytes, stride[0] = NY * NZ * bytes;
    if (layout == 3) first += (NZ - 1) * stride[2] + (NY - 1) * stride[1], stride[1] *= -1, stride[2] *= -1;
    for (int z = 0; z < NZ; ++z)
        for (int y = 0; y < NY; ++y)
            for (int x = 0; x < NX; ++x) store(format, x, y, z, first + x * stride[0] + y * stride[1] + z * stride[2]);
    grid->voxels = first;
    grid->format = format;
    grid->size[0] = NX, grid->size[1] = NY, grid->size[2] = NZ;
    if (layout > 0) memcpy(grid->stride, stride, sizeof stride);
}

/* Blocks of any position and size, of any format and layout, scaled or not: values within the float round-off of two
   operations, and bounds that are exactly those of the values. */
static void test_grids(void) {
    static char buffer[16 * VOXELS];
    check_random random = {11};
    for (int n = 0; n < 5 * 4 * 2 * 20; ++n) {
        const sps_voxel_format format = (sps_voxel_format)(SPS_VOXEL_U8 + n % 5);
        const int scaled = n / 20 % 2 || format == SPS_VOXEL_I16, most[3] = {NX, NY, NZ};
        const float offset = format == SPS_VOXEL_I16 ? 32768 * 0.37f : 11;
        int lo[3], size[3];
        float values[VOXELS], range[2] = {-1, -1}, low = HUGE_VALF, high = 0;
        sps_grid grid;
        fill(&grid, format, n / 5 % 4, buffer);
        if (scaled) grid.scale = 0.37f, grid.offset = offset;
        for (int k = 0; k < 3; ++k) {
            lo[k] = n < 40 ? 0 : (int)(check_next(&random) * most[k]);
            size[k] = n < 40 ? most[k] : 1 + (int)(check_next(&random) * (most[k] - lo[k]));
        }
        for (int i = 0; i < VOXELS; ++i) values[i] = -7;
        CHECK(sps_grid_read(&grid, lo, size, values) == 0);
        for (int i = 0; i < VOXELS; ++i) {
            const int x = i % size[0], y = i / size[0] % size[1], z = i / size[0] / size[1];
            double exact = stored(format, lo[0] + x, lo[1] + y, lo[2] + z);
            const double product = fabs(exact * (double)0.37f);
            if (scaled) exact = exact * (double)0.37f + (double)offset;
            if (i >= size[0] * size[1] * size[2]) exact = -7;
            /* the product and the sum are rounded by 2^-24 each */
            if (!CHECK_NEAR((double)values[i], exact, scaled && exact >= 0 ? 6e-8 * (product + exact) : 0))
                printf("    %d\n", n);
            if (i >= size[0] * size[1] * size[2]) continue;
            low = fminf(low, values[i]), high = fmaxf(high, values[i]);
        }
        CHECK(sps_grid_range(&grid, lo, size, range) == 0);
        CHECK(range[0] == low && range[1] == high);
    }
}

/* All 65536 half-precision numbers: normal, subnormal, infinite and NaN. */
static void test_halves(void) {
    static uint16_t halves[65536];
    static float values[65536];
    const int lo[3] = {0, 0, 0}, size[3] = {256, 256, 1};
    sps_grid grid;
    for (int i = 0; i < 65536; ++i) halves[i] = (uint16_t)i;
    memset(&grid, 0, sizeof grid);
    grid.voxels = halves, grid.format = SPS_VOXEL_F16;
    grid.size[0] = grid.size[1] = 256, grid.size[2] = 1;
    CHECK(sps_grid_read(&grid, lo, size, values) == 0);
    for (int i = 0; i < 65536; ++i) {
        const double exact = half_value((unsigned)i);
        if (!CHECK(isnan(exact) ? isnan(values[i]) : (double)values[i] == exact)) printf("    half %d\n", i);
    }
}

/* Blocks with invalid values have no bounds: reading them reports the error. */
static void test_invalid_values(void) {
    static const float bad[4] = {NAN, INFINITY, -1, 2e18f};
    const int lo[3] = {0, 0, 0}, size[3] = {40, 1, 1}; /* longer than the part of a row that is processed at a time */
    for (int n = 0; n < 5; ++n) {
        float list[40], range[2];
        sps_grid grid;
        for (int i = 0; i < 40; ++i) list[i] = 3 + (float)(i % 3);
        if (n < 4) list[35] = bad[n];
        memset(&grid, 0, sizeof grid);
        grid.voxels = list, grid.format = SPS_VOXEL_F32;
        memcpy(grid.size, size, sizeof size);
        CHECK(sps_grid_range(&grid, lo, size, range) == 0);
        CHECK(n < 4 ? range[0] == 0 && range[1] >= 1e18f : range[0] == 3 && range[1] == 5);
    }
}

/* Each invalid field makes both callbacks fail with the documented number, and leaves the block untouched. */
static void test_bad_grids(void) {
    static char buffer[16 * VOXELS];
    for (int n = 0; n < 16; ++n) {
        int lo[3] = {1, 1, 1}, size[3] = {2, 2, 2};
        const int expected = n == 0 ? 0 : n < 11 ? 1 : 2;
        float values[8], range[2] = {7, 7};
        sps_grid grid;
        fill(&grid, SPS_VOXEL_U16, 0, buffer);
        if (n == 2) grid.voxels = NULL;
        if (n == 3) grid.start_canary = 1;
        if (n == 4) grid.end_canary = 1;
        if (n == 5) grid.format = (sps_voxel_format)0;
        if (n == 6) grid.format = (sps_voxel_format)6;
        if (n == 7) grid.size[0] = 0;
        if (n == 8) grid.size[2] = -1;
        if (n == 9) grid.scale = NAN;
        if (n == 10) grid.offset = INFINITY;
        if (n == 11) lo[0] = -1;
        if (n == 12) lo[1] = NY - 1;
        if (n == 13) size[2] = NZ;
        if (n == 14) lo[2] = 2147483647;
        if (n == 15) size[0] = 2147483647;
        for (int i = 0; i < 8; ++i) values[i] = 7;
        CHECK(sps_grid_read(n == 1 ? NULL : &grid, lo, size, values) == expected);
        if (expected) CHECK(values[0] == 7 && values[7] == 7);
        if (!CHECK(sps_grid_range(n == 1 ? NULL : &grid, lo, size, range) == expected)) printf("    %d\n", n);
    }
}

/* The same picture, bit for bit, by a grid and by a callback of the test; empty blocks are skipped. */
static void test_volume_of_grid(void) {
    enum { SIDE = 12, EDGE = 70 };
    static float voxels[EDGE * EDGE * EDGE], images[2][4 * SIDE * SIDE];
    check_array own;
    sps_stats_report stats[2];
    sps_grid grid;
    memset(&own, 0, sizeof own);
    for (int i = 0; i < EDGE * EDGE * EDGE; ++i) {
        const int x = i % EDGE, y = i / EDGE % EDGE, z = i / EDGE / EDGE;
        voxels[i] = x + y + z < EDGE ? (float)(x * y % 7) * 0.1f : 0;
    }
    memset(&grid, 0, sizeof grid);
    grid.voxels = voxels, grid.format = SPS_VOXEL_F32;
    for (int k = 0; k < 3; ++k) grid.size[k] = own.size[k] = EDGE;
    own.values = voxels;
    for (int i = 0; i < 2; ++i) {
        sps_context *context = check_context(NULL);
        check_scene s;
        sps_volume *volume;
        check_clear(&s, SIDE, SIDE);
        check_orthographic(&s.view.camera, 2.4);
        volume = check_add_volume(&s, EDGE, EDGE, EDGE, check_box(-1, -1, -1, 1, 1, 1));
        volume->read_fn = i ? sps_grid_read : check_read_array;
        volume->user = i ? (void *)&grid : (void *)&own;
        if (i) volume->range_fn = sps_grid_range;
        volume->extinction = 2;
        check_color(volume->albedo, 0.9, 0.8, 0.7);
        check_add_directional(&s, 1, -1, -1, 3);
        check_render(context, &s, images[i]);
        sps_get_stats(context, &stats[i]);
        if (i) { /* larger than the grid: an error */
            sps_image image;
            memset(&image, 0, sizeof image);
            image.rgba = images[1];
            volume->size[1] = EDGE + 1;
            CHECK(sps_render(context, &s.scene, &s.view, &image) == SPS_ERROR_ARGUMENT);
            CHECK(strcmp(sps_error(context), "volume[0].grid.size is 70; it must be the volume's size") == 0);
        }
        sps_destroy(context);
    }
    CHECK(memcmp(images[0], images[1], sizeof images[0]) == 0);
    CHECK(stats[0].blocks_skipped == 0 && stats[1].blocks_skipped > 0);
}

/* Rows that run upwards, in layers that follow each other: the stride of layers is that of rows without its sign. */
static void test_flipped_rows(void) {
    static const int lo[3] = {0, 0, 0}, size[3] = {3, 4, 2};
    unsigned char bytes[3 * 4 * 2];
    float values[3 * 4 * 2];
    sps_grid grid;
    memset(&grid, 0, sizeof grid);
    for (int i = 0; i < 24; ++i) bytes[i] = (unsigned char)i;
    grid.voxels = bytes + 9, grid.format = SPS_VOXEL_U8, grid.stride[1] = -3;
    memcpy(grid.size, size, sizeof size);
    CHECK(sps_grid_read(&grid, lo, size, values) == 0);
    for (int i = 0; i < 24; ++i) CHECK_NEAR((double)values[i], i / 12 * 12 + (3 - i / 3 % 4) * 3 + i % 3, 0);
}

/* What is wrong with an array is said by the field's name when it is rendered. */
static void test_array_refusals(void) {
    static const char *const texts[] = {"volume[0].user is NULL",
                                        "volume[0].grid.start_canary is 1",
                                        "volume[0].grid.end_canary is 1",
                                        "volume[0].grid.voxels is NULL",
                                        "volume[0].grid.size is 5",
                                        "volume[0].grid.scale is nan",
                                        "volume[0].grid.offset is inf",
                                        "volume[0].grid.format is 6",
                                        "mesh[0].user is NULL",
                                        "mesh[0].arrays.start_canary is 1",
                                        "mesh[0].arrays.end_canary is 1",
                                        "mesh[0].arrays.triangle_count is 0",
                                        "mesh[0].arrays.vertex_count is 0",
                                        "mesh[0].arrays.indices_u16 and indices_u32 are both set",
                                        "mesh[0].arrays.albedos is NULL",
                                        "mesh[0].arrays.normals is NULL",
                                        "mesh[0].arrays.positions is NULL",
                                        "mesh[0].arrays.position_stride is 11; it must be 0, or at least 12 bytes",
                                        "mesh[0].arrays.normal_stride is 3",
                                        "mesh[0].arrays.albedo_stride is 1",
                                        "mesh[0].arrays.uv_stride is 7; it must be 0, or at least 8 bytes"};
    static const float corners[9] = {-1, -1, 0, 1, -1, 0, 1, 1, 0};
    static const uint16_t narrow[3] = {0, 1, 2};
    static const uint32_t wide[3] = {0, 1, 2};
    static const unsigned char voxels[64] = {1};
    sps_context *context = check_context(NULL);
    for (int n = -1; n < (int)(sizeof texts / sizeof *texts); ++n) {
        sps_indexed_mesh arrays;
        sps_grid grid;
        sps_volume *volume;
        sps_image image;
        float rgba[16];
        check_scene s;
        check_clear(&s, 2, 2);
        memset(&arrays, 0, sizeof arrays);
        memset(&grid, 0, sizeof grid);
        memset(&image, 0, sizeof image);
        image.rgba = rgba;
        grid.voxels = n == 3 ? NULL : voxels, grid.format = n == 7 ? (sps_voxel_format)6 : SPS_VOXEL_U8;
        for (int k = 0; k < 3; ++k) grid.size[k] = n == 4 && k == 1 ? 5 : 4;
        grid.start_canary = n == 1, grid.end_canary = n == 2;
        if (n == 5) grid.scale = NAN;
        if (n == 6) grid.offset = INFINITY;
        volume = check_add_volume(&s, 4, 4, 4, check_box(-1, -1, -1, 1, 1, 1));
        volume->read_fn = sps_grid_read, volume->user = n == 0 ? NULL : &grid, volume->extinction = 1;
        arrays.start_canary = n == 9, arrays.end_canary = n == 10;
        arrays.positions = n == 16 ? NULL : corners, arrays.vertex_count = n == 12 ? 0 : 3;
        arrays.indices_u16 = narrow, arrays.indices_u32 = n == 13 ? wide : NULL;
        arrays.triangle_count = n == 11 ? 0 : 1;
        arrays.position_stride = n == 17 ? 11 : 12, arrays.normal_stride = n == 18 ? 3 : 12;
        arrays.albedo_stride = n == 19 ? 1 : 12, arrays.uv_stride = n == 20 ? 7 : 8;
        s.scene.mesh_count = 1;
        s.mesh[0].read_fn = sps_indexed_mesh_read, s.mesh[0].user = n == 8 ? NULL : &arrays;
        s.mesh[0].triangle_count = 1, s.mesh[0].has_albedos = n == 14, s.mesh[0].has_normals = n == 15;
        CHECK(sps_render(context, &s.scene, &s.view, &image) == (n < 0 ? SPS_OK : SPS_ERROR_ARGUMENT));
        if (n >= 0 && !CHECK(strncmp(sps_error(context), texts[n], strlen(texts[n])) == 0))
            printf("    %d: %s\n", n, sps_error(context));
    }
    sps_destroy(context);
}

/* ----------------------------------------------------------------------------------------------------------- meshes */

typedef struct vertex {
    float position[3], normal[3], color[3], more;
} vertex;

enum { VERTICES = 9, TRIANGLES = 8 };

static void make_vertices(vertex *list) {
    for (int i = 0; i < VERTICES; ++i)
        for (int k = 0; k < 3; ++k) {
            list[i].position[k] = (float)(10 * i + k);
            list[i].normal[k] = (float)(100 + 10 * i + k);
            list[i].color[k] = 0.01f * (float)(10 * i + k);
            list[i].more = NAN;
        }
}

static int corner(int triangle, int k, int indexed) {
    return indexed ? (triangle * 5 + k * 3) % VERTICES : 3 * triangle + k;
}

/* Interleaved and separate vertices, with both kinds of indices and none, unaligned, in any batches. */
static void test_indexed(void) {
    static const size_t batches[3] = {TRIANGLES, 1, 3};
    for (int n = 0; n < 3 * 2 * 3; ++n) {
        const int kind = n % 3, apart = n / 3 % 2;
        const size_t batch = batches[n / 6];
        vertex vertices[VERTICES];
        char narrow[3 * TRIANGLES * 2 + 1], wide[3 * TRIANGLES * 4 + 1];
        float positions[3 * VERTICES];
        sps_indexed_mesh mesh;
        make_vertices(vertices);
        for (int i = 0; i < 3 * TRIANGLES; ++i) {
            const uint32_t index = (uint32_t)corner(i / 3, i % 3, 1);
            const uint16_t low = (uint16_t)index;
            memcpy(narrow + 1 + 2 * i, &low, sizeof low);
            memcpy(wide + 1 + 4 * i, &index, sizeof index);
        }
        for (int i = 0; i < VERTICES; ++i) memcpy(positions + 3 * i, vertices[i].position, sizeof vertices[i].position);
        memset(&mesh, 0, sizeof mesh);
        mesh.vertex_count = VERTICES;
        mesh.triangle_count = kind == 0 ? VERTICES / 3 : TRIANGLES;
        mesh.positions = apart ? positions : vertices[0].position;
        if (!apart) mesh.position_stride = sizeof(vertex);
        if (!apart) mesh.normals = vertices[0].normal, mesh.normal_stride = sizeof(vertex);
        if (!apart) mesh.albedos = vertices[0].color, mesh.albedo_stride = sizeof(vertex);
        if (kind == 1) mesh.indices_u16 = (const uint16_t *)(const void *)(narrow + 1);
        if (kind == 2) mesh.indices_u32 = (const uint32_t *)(const void *)(wide + 1);
        for (size_t first = 0; first < mesh.triangle_count; first += batch) {
            const size_t count = batch < mesh.triangle_count - first ? batch : mesh.triangle_count - first;
            sps_triangle list[TRIANGLES];
            memset(list, 0, sizeof list);
            CHECK(sps_indexed_mesh_read(&mesh, first, count, list) == 0);
            for (int i = 0; i < 3 * (int)count; ++i) {
                const vertex *v = &vertices[corner((int)first + i / 3, i % 3, kind > 0)];
                const sps_triangle *t = &list[i / 3];
                const float zero[3] = {0, 0, 0};
                CHECK(memcmp(t->position[i % 3], v->position, sizeof v->position) == 0);
                CHECK(memcmp(t->normal[i % 3], apart ? zero : v->normal, sizeof zero) == 0);
                CHECK(memcmp(t->albedo[i % 3], apart ? zero : v->color, sizeof zero) == 0);
            }
        }
    }
}

static void test_bad_meshes(void) {
    for (int n = 0; n < 13; ++n) {
        static const int expected[13] = {0, 1, 1, 1, 1, 1, 1, 2, 2, 2, 3, 3, 3};
        vertex vertices[VERTICES];
        uint16_t narrow[6] = {0, 1, 2, 2, 1, 8};
        uint32_t wide[6] = {0, 1, 2, 2, 1, 8};
        size_t first = 0, count = 2;
        sps_triangle out[2];
        sps_indexed_mesh mesh;
        make_vertices(vertices);
        memset(&mesh, 0, sizeof mesh);
        mesh.vertex_count = VERTICES, mesh.triangle_count = 2;
        mesh.positions = vertices[0].position, mesh.position_stride = sizeof(vertex);
        if (n % 2)
            mesh.indices_u16 = narrow;
        else
            mesh.indices_u32 = wide;
        if (n == 2) mesh.positions = NULL;
        if (n == 3) mesh.start_canary = 1;
        if (n == 4) mesh.end_canary = 1;
        if (n == 5) mesh.vertex_count = 0;
        if (n == 6) mesh.indices_u16 = narrow;
        if (n == 7) count = 3;
        if (n == 8) first = 1;
        if (n == 9) first = SIZE_MAX;
        if (n == 10) wide[4] = VERTICES;
        if (n == 11) mesh.vertex_count = 8; /* the last index is 8 */
        if (n == 12) mesh.indices_u32 = NULL, mesh.vertex_count = 5;
        if (!CHECK(sps_indexed_mesh_read(n == 1 ? NULL : &mesh, first, count, out) == expected[n]))
            printf("    %d\n", n);
    }
}

/* The library renders an indexed mesh: a quad of two triangles and four vertices, with a pixel of the right brightness
   in its middle; an index beyond them fails the call. */
static void test_mesh_of_arrays(void) {
    static const float corners[12] = {-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0};
    uint16_t indices[6] = {0, 1, 2, 0, 2, 3};
    float image[4];
    sps_context *context = check_context(NULL);
    sps_indexed_mesh indexed;
    sps_image target;
    check_scene s;
    check_clear(&s, 1, 1);
    memset(&indexed, 0, sizeof indexed);
    memset(&target, 0, sizeof target);
    target.rgba = image;
    indexed.positions = corners, indexed.vertex_count = 4;
    indexed.indices_u16 = indices, indexed.triangle_count = 2;
    s.scene.mesh_count = 1;
    s.mesh[0].read_fn = sps_indexed_mesh_read, s.mesh[0].user = &indexed;
    s.mesh[0].triangle_count = indexed.triangle_count;
    check_color(s.mesh[0].albedo, 0.5, 0.5, 0.5);
    check_add_directional(&s, 0, 0, -1, 3);
    CHECK_OK(context, sps_render(context, &s.scene, &s.view, &target));
    /* reflectance, 1 / pi, irradiance and two products: five roundings of 6e-8 each */
    CHECK_NEAR((double)image[0], 0.5 / 3.14159265358979 * 3, 5 * 6e-8 * 0.5);
    indices[5] = 4;
    CHECK(sps_render(context, &s.scene, &s.view, &target) == SPS_ERROR_CALLBACK);
    CHECK(strcmp(sps_error(context),
                 "mesh[0].read_fn failed: it returned 3, since an index is not below vertex_count") == 0);
    s.mesh[1] = s.mesh[0], s.mesh[0].triangle_count = 0, s.scene.mesh_count = 2; /* behind an empty one */
    CHECK(sps_render(context, &s.scene, &s.view, &target) == SPS_ERROR_CALLBACK);
    CHECK(strcmp(sps_error(context),
                 "mesh[1].read_fn failed: it returned 3, since an index is not below vertex_count") == 0);
    sps_destroy(context);
}

int main(void) {
    RUN(test_grids);
    RUN(test_halves);
    RUN(test_invalid_values);
    RUN(test_bad_grids);
    RUN(test_volume_of_grid);
    RUN(test_flipped_rows);
    RUN(test_array_refusals);
    RUN(test_indexed);
    RUN(test_bad_meshes);
    RUN(test_mesh_of_arrays);
    return check_report();
}
