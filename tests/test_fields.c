/* One field at a time. A scene that has everything is rendered; one field of one struct is changed, an array's elements
   one by one; it is rendered again in the same context. That must give the bits of a new context, and restoring the
   field those of before: whatever a context holds from call to call is made anew where a field that it depends on
   changes. Each change must show in at least one of the ways to make an image or a map, unless its row says that it
   must not. The struct declarations of splatshadow.h are read, and each field must have a row, or a reason to have
   none.

   CHECK_FIGURES in the environment prints in which ways each field shows. */

#include "check.h"
#include <stddef.h>

/* ------------------------------------------------------------------------------------------------------ the scene */

enum { VOXELS = 160, FACES = 4, CORNERS = 6, FLOATS = 8192 };

/* All that a call gets. Pointers refer to the struct itself, or to another content that a field may be changed to. */
typedef struct everything {
    sps_volume volume[2], other_volume[2];
    sps_grid grid, other_grid;
    float voxels[VOXELS], other_voxels[VOXELS], level[2], other_level[2];
    sps_lobe lobe[2], other_lobe[2];
    sps_transfer transfer, other_transfer;
    sps_transfer_point point[3], other_point[3];
    sps_mesh mesh[2], other_mesh[2];
    sps_triangle triangle[FACES], other_triangle[FACES];
    sps_indexed_mesh indexed, other_indexed;
    float positions[4 * CORNERS], normals[4 * CORNERS], colors[4 * CORNERS], uvs[3 * CORNERS];
    float other_floats[4 * CORNERS];
    uint16_t indices[3 * 3], other_indices[3 * 3];
    uint32_t long_indices[3 * 3], other_long_indices[3 * 3];
    sps_surface look, other_look;
    sps_particles set, other_set;
    sps_particle particle[4], other_particle[4];
    sps_light light[3], other_light[3];
    sps_projector projector, other_projector;
    sps_tmap_settings shadow_map, other_shadow_map;
    float slide, other_slide, backdrop, other_backdrop;
    sps_scene scene;
    sps_view view;
    sps_image image;
    double matrix[16], other_matrix[16];
    sps_reference_settings reference;
    sps_tmap_light map_light;
    sps_tmap_settings map_settings;
    float planes[6], other_planes[6];
} everything;

static everything it;

static int read_ramp(void *user, const int lo[3], const int size[3], float *out) {
    const float *level = (const float *)user;
    for (int k = lo[2]; k < lo[2] + size[2]; ++k)
        for (int j = lo[1]; j < lo[1] + size[1]; ++j)
            for (int i = lo[0]; i < lo[0] + size[0]; ++i)
                *out++ = level[0] * (0.62f + 0.3f * sinf((float)(i + 2 * j)) + 0.3f * cosf((float)(k - i))) + level[1];
    return 0;
}

static int eval_transfer(void *user, size_t count, const float *values, sps_transfer_point *out) {
    const float *level = (const float *)user;
    for (size_t i = 0; i < count; ++i) {
        out[i].extinction = level[0] * 4 * values[i] * values[i];
        for (int c = 0; c < 3; ++c) out[i].color[c] = fminf(1, values[i] * (0.5f + 0.2f * (float)c));
    }
    return 0;
}

static int shade(void *user, size_t count, const sps_surface_point *points, sps_surface *out) {
    const sps_surface *look = (const sps_surface *)user;
    for (size_t i = 0; i < count; ++i)
        for (int c = 0; c < 3; ++c) {
            out[i].color[c] = look->color[c] * (0.8f + 0.1f * sinf((float)(3 * points[i].uv[0] + points[i].uv[1])));
            out[i].emission[c] = look->emission[c];
        }
    return 0;
}

static int throw_slide(void *user, size_t count, const float *uv, float *out) {
    for (size_t i = 0; i < 3 * count; ++i)
        out[i] =
            *(const float *)user * (0.5f + 0.4f * sinf(9 * uv[i / 3 * 2] + 5 * uv[i / 3 * 2 + 1] + (float)(i % 3)));
    return 0;
}

static int paint_backdrop(void *user, size_t count, const float *directions, float *out) {
    for (size_t i = 0; i < 3 * count; ++i) out[i] = *(const float *)user * (1.2f + directions[i]);
    return 0;
}

static void build_volumes(void) {
    sps_volume *gas = &it.volume[0], *matter = &it.volume[1];
    static const sps_lobe lobes[2] = {{0.6f, 2}, {-0.3f, 1}}, others[2] = {{0.2f, 2}, {-0.5f, 1}};
    static const sps_transfer_point points[3] = {
        {0.1f, {0.9f, 0.4f, 0.4f}, 0}, {0.5f, {0.7f, 0.7f, 0.3f}, 3}, {0.9f, {0.2f, 0.5f, 0.9f}, 6}};
    static const int size[3] = {6, 5, 4}, sparse[3] = {5, 6, 7};
    for (int i = 0; i < VOXELS; ++i) {
        it.voxels[i] = 0.5f + 0.45f * sinf(1.7f * (float)i);
        it.other_voxels[i] = 0.5f + 0.45f * cosf(1.3f * (float)i);
    }
    it.grid.voxels = it.voxels, it.grid.format = SPS_VOXEL_F32, it.grid.scale = 1, it.grid.offset = 0.02f;
    it.grid.stride[0] = 4, it.grid.stride[1] = 24, it.grid.stride[2] = 120;
    memcpy(it.grid.size, size, sizeof size);
    it.other_grid = it.grid, it.other_grid.voxels = it.other_voxels;
    memcpy(it.lobe, lobes, sizeof lobes), memcpy(it.other_lobe, others, sizeof others);
    memcpy(it.point, points, sizeof points), memcpy(it.other_point, points, sizeof points);
    it.other_point[1].extinction = 5;
    it.transfer.points = it.point, it.transfer.point_count = 3, it.transfer.value_max = 0.95f;
    it.transfer.user = it.level;
    it.other_transfer = it.transfer, it.other_transfer.points = it.other_point;
    it.level[0] = 0.9f, it.level[1] = 0.05f, it.other_level[0] = 0.7f, it.other_level[1] = 0.1f;
    memcpy(gas->size, size, sizeof size), memcpy(matter->size, sparse, sizeof sparse);
    gas->placement = check_box(-1, -0.9, -0.8, 0.9, 0.8, 0.5), gas->placement.axis[0][1] = 0.1;
    matter->placement = check_box(-0.2, -0.8, -0.4, 1.1, 0.5, 0.7);
    gas->read_fn = sps_grid_read, gas->range_fn = sps_grid_range, gas->user = &it.grid;
    matter->read_fn = read_ramp, matter->user = it.level;
    gas->revision = matter->revision = 7;
    gas->extinction = 1.4f, gas->lobes = it.lobe, gas->lobe_count = 2;
    check_color(gas->albedo, 0.9, 0.8, 0.8), check_color(gas->emission, 0.02, 0.01, 0.02);
    check_color(gas->ambient, 0.03, 0.05, 0.05), check_color(matter->ambient, 0.06, 0.04, 0.06);
    matter->transfer = &it.transfer, matter->shading = SPS_SHADING_SURFACE, matter->gradient_full = 0.2f;
    matter->specular = 0.4f, matter->shininess = 9, matter->lobes = it.lobe + 1, matter->lobe_count = 1;
    memcpy(it.other_volume, it.volume, sizeof it.volume), it.other_volume[1].extinction = 2;
    it.other_volume[0].albedo[1] = 0.5f;
}

static void build_triangle(sps_triangle *triangle, const float corners[9]) {
    for (int i = 0; i < 9; ++i) {
        triangle->position[i / 3][i % 3] = corners[i];
        triangle->normal[i / 3][i % 3] = i % 3 == 2 ? 1 : 0.1f + 0.2f * (float)(i / 3);
        triangle->color[i / 3][i % 3] = 0.4f + 0.05f * (float)i;
        if (i < 6) triangle->uv[i / 2][i % 2] = 0.3f * (float)i;
    }
}

static void build_meshes(void) {
    static const float floor_corners[2][9] = {{-1.6f, -1.2f, -1.3f, 1.5f, -1.3f, -1.2f, 1.4f, 1.2f, -1.1f},
                                              {-1.6f, -1.2f, -1.3f, 1.4f, 1.2f, -1.1f, -1.5f, 1.3f, -1.2f}};
    static const float pane[CORNERS][3] = {{-0.9f, -0.3f, 0.9f}, {0.2f, -0.5f, 1},   {-0.3f, 0.6f, 0.8f},
                                           {0.3f, -0.2f, 1.1f},  {0.9f, 0.1f, 0.6f}, {0.1f, 0.7f, 1}};
    static const uint16_t indices[9] = {0, 1, 2, 3, 4, 5, 1, 3, 2}, others[9] = {0, 1, 2, 3, 4, 5, 0, 3, 5};
    for (int i = 0; i < 2; ++i) build_triangle(&it.triangle[i], floor_corners[i]);
    memcpy(it.other_triangle, it.triangle, sizeof it.triangle), it.other_triangle[0].position[0][0] = -1;
    for (int i = 0; i < 4 * CORNERS; ++i) {
        if (i < 3 * CORNERS) it.positions[i] = pane[i / 3][i % 3];
        it.normals[i] = i % 3 == 2 ? 1 : 0.1f * (float)(i % 4);
        it.colors[i] = 0.3f + 0.02f * (float)i;
        if (i < 3 * CORNERS) it.uvs[i] = 0.2f * (float)i;
        it.other_floats[i] = 0.2f + 0.03f * (float)(i * i % 17);
    }
    memcpy(it.indices, indices, sizeof indices), memcpy(it.other_indices, others, sizeof others);
    for (int i = 0; i < 9; ++i) it.long_indices[i] = others[i], it.other_long_indices[i] = indices[i];
    it.indexed.vertex_count = CORNERS, it.indexed.triangle_count = 3, it.indexed.indices_u16 = it.indices;
    it.indexed.positions = it.positions, it.indexed.normals = it.normals, it.indexed.colors = it.colors;
    it.indexed.uvs = it.uvs;
    it.indexed.position_stride = it.indexed.normal_stride = it.indexed.color_stride = 12, it.indexed.uv_stride = 8;
    it.other_indexed = it.indexed, it.other_indexed.colors = it.other_floats;
    check_color(it.look.color, 0.6, 0.6, 0.5), check_color(it.look.emission, 0.01, 0.03, 0.03);
    it.other_look = it.look, it.other_look.color[2] = 0.9f;
    for (int i = 0; i < 2; ++i) {
        sps_mesh *mesh = &it.mesh[i];
        mesh->read_fn = i ? sps_indexed_mesh_read : NULL, mesh->user = i ? (void *)&it.indexed : it.triangle;
        mesh->triangle_count = i ? 3 : 2, mesh->placement = check_box(0, 0, 0, 1, 1, 1), mesh->revision = 3;
        check_color(mesh->color, 0.7, 0.5, 0.5), mesh->has_normals = 1, mesh->has_colors = i;
    }
    check_color(it.mesh[1].transmittance, 0.5, 0.5, 0.3);
    it.mesh[0].shade_fn = shade, it.mesh[0].shade_user = &it.look;
}

static int read_triangles(void *user, size_t first, size_t count, sps_triangle *out) {
    memcpy(out, (const sps_triangle *)user + first, count * sizeof *out);
    return 0;
}

static void build_particles(void) {
    for (int i = 0; i < 4; ++i) {
        it.particle[i].position[0] = -0.6f + 0.45f * (float)i,
        it.particle[i].position[1] = 0.5f - 0.3f * (float)(i % 3);
        it.particle[i].position[2] = 0.3f * (float)(i % 2), it.particle[i].radius = 0.2f + 0.05f * (float)i;
        it.particle[i].optical_depth = 0.9f;
        it.other_particle[i] = it.particle[i], it.other_particle[i].radius = 0.3f;
    }
    it.set.count = 3, it.set.read_fn = check_read_particles, it.set.user = it.particle, it.set.soft = 1;
    check_color(it.set.albedo, 0.5, 0.9, 0.9), check_color(it.set.emission, 0.05, 0.02, 0.05);
    check_color(it.set.ambient, 0.04, 0.04, 0.02), it.set.lobes = it.lobe, it.set.lobe_count = 1;
    it.other_set = it.set, it.other_set.albedo[0] = 0.8f;
}

static void build_lights(void) {
    sps_light *sun = &it.light[0], *spot = &it.light[1], *disc = &it.light[2];
    sun->kind = SPS_LIGHT_DIRECTIONAL, check_set3(sun->direction, 0.4, -0.5, -1);
    check_color(sun->color, 1.1, 0.9, 0.9), sun->angular_diameter = 0.1, sun->samples = 2;
    spot->kind = SPS_LIGHT_POINT, check_set3(spot->direction, -0.5, -0.6, -1),
    check_set3(spot->position, 1.3, 1.4, 2.6);
    check_color(spot->color, 5, 5, 7), spot->inner_cone = 0.35, spot->outer_cone = 0.6, spot->projector = &it.projector;
    disc->kind = SPS_LIGHT_DISC, check_set3(disc->position, -1.4, 0.9, 2.9), check_color(disc->color, 4, 6, 4);
    check_set3(disc->axes[0], 0.3, 0, 0.1), check_set3(disc->axes[1], 0, 0.2, 0), disc->samples = 2;
    check_set3(disc->direction, 0.4, -0.3, -1);
    it.projector.width = 5, it.projector.height = 4, it.projector.sample_fn = throw_slide, it.slide = 1;
    it.projector.user = &it.slide, it.projector.left = -0.6, it.projector.right = 0.7, it.projector.bottom = -0.5;
    it.projector.top = 0.6, it.projector.up[0] = 0.3, it.projector.up[1] = 1, it.other_slide = 1.3f;
    it.other_projector = it.projector, it.other_projector.top = 0.4;
    it.shadow_map.technique = SPS_TMAP_TABLE, it.shadow_map.components = 32;
    it.other_shadow_map = it.shadow_map, it.other_shadow_map.components = 16;
    memcpy(it.other_light, it.light, sizeof it.light), it.other_light[2].position[0] = -1;
}

static void build_maps(void) {
    for (int i = 0; i < 6; ++i) it.planes[i] = (float)(i + 1) / 6, it.other_planes[i] = it.planes[i] * it.planes[i];
    it.map_light.width = 11, it.map_light.height = 9;
    check_set3(it.map_light.camera.position, 1.3, 1.4, 2.6), check_set3(it.map_light.camera.target, 0, 0, 0);
    it.map_light.camera.up[0] = 0.2, it.map_light.camera.up[1] = 1, it.map_light.camera.field_of_view = 1.1,
    it.map_light.slab = 0.7;
    it.map_light.quality = SPS_QUALITY_HIGH;
    it.map_settings.near_depth = 1, it.map_settings.far_depth = 6, it.map_settings.surface_bias = 0.05;
    it.map_settings.technique = SPS_TMAP_OPACITY, it.map_settings.components = 6, it.map_settings.planes = it.planes;
}

static void build(void) {
    sps_camera *camera = &it.view.camera;
    memset(&it, 0, sizeof it);
    build_volumes(), build_meshes(), build_particles(), build_lights(), build_maps();
    it.mesh[0].read_fn = read_triangles;
    memcpy(it.other_mesh, it.mesh, sizeof it.mesh), it.other_mesh[0].color[1] = 0.2f, it.other_mesh[1].color[1] = 0.3f;
    it.other_mesh[1].transmittance[0] = 0.2f;
    it.scene.volumes = it.volume, it.scene.volume_count = 2, it.scene.meshes = it.mesh, it.scene.mesh_count = 2;
    it.scene.lights = it.light, it.scene.light_count = 3, it.scene.particles = &it.set;
    it.scene.particle_set_count = 1;
    check_color(it.scene.ambient, 0.05, 0.05, 0.08), check_color(it.scene.background, 0.2, 0.1, 0.2);
    it.backdrop = 0.1f, it.other_backdrop = 0.2f;
    check_set3(camera->position, 0.4, 0.5, 5), check_set3(camera->target, 0.1, 0, 0), camera->up[1] = 1;
    camera->up[0] = 0.2, camera->field_of_view = 0.6, it.view.width = 9, it.view.height = 7,
    it.view.quality = SPS_QUALITY_DRAFT;
    it.view.slab = 1.5, it.view.shadow_size = 14, it.view.coverage_samples = 2, it.view.scatter_size = 4;
    it.view.scatter_tolerance = 0.01f, it.reference.step = 4;
}

/* What the fields of a row need besides. */
typedef enum base {
    PLAIN,
    ORTHOGRAPHIC, /* cameras and the light's map */
    MATRIX,
    EVALUATED,  /* a transfer function by eval_fn */
    BACKDROP,   /* background_fn */
    INVALID,    /* a voxel that is not a number */
    SMOOTH,     /* gas of many wide pixels, for tolerance */
    TABLES,     /* lights take tables of a size */
    MAPPED,     /* lights have a shadow_map */
    COMPRESSED, /* maps */
    DEEP,
    FOURIER,
    FACED, /* six faces */
    BUDGETED_MAP,
    PATHS,  /* paths in the reference */
    REGION, /* a part of the picture */
    SLIDE_OF_DISC,
    RECTANGLE,
    COLORED,      /* corners of the first mesh */
    LONG_INDICES, /* and a second mesh that is shaded by shade_fn */
    BASES
} base;

static void build_matrices(double height) {
    static const double rows[16] = {0.6, 0, 0.05, 0, 0, 0.7, 0, 0.05, 0.01, 0, -0.2, 0, 0, 0, 0, 1};
    memcpy(it.matrix, rows, sizeof rows), memcpy(it.other_matrix, rows, sizeof rows);
    for (int i = 0; i < 8; ++i) it.matrix[i] /= height, it.other_matrix[i] /= i < 4 ? 0.9 * height : height;
}

static void build_base(base b) {
    build();
    if (b == ORTHOGRAPHIC) {
        check_orthographic(&it.view.camera, 2.6), check_orthographic(&it.map_light.camera, 2.6);
    } else if (b == MATRIX) {
        build_matrices(1);
        check_matrix(&it.view.camera, it.matrix), check_matrix(&it.map_light.camera, it.matrix);
    } else if (b == EVALUATED) {
        it.transfer.points = NULL, it.transfer.point_count = 0, it.transfer.eval_fn = eval_transfer;
    } else if (b == BACKDROP) {
        it.scene.background_fn = paint_backdrop, it.scene.background_user = &it.backdrop;
    } else if (b == INVALID) {
        it.voxels[40] = (float)NAN, it.scene.replace_invalid = 1;
    } else if (b == SMOOTH) {
        for (int i = 0; i < VOXELS; ++i) it.voxels[i] = 0.2f + 0.1f * (float)(i % 6);
        it.view.width = 40, it.view.height = 30, it.view.tolerance = 1, it.view.filling = SPS_FILLING_GATHER;
        it.scene.volume_count = 1, it.scene.particle_set_count = 0, it.scene.mesh_count = 0, it.scene.light_count = 1;
        it.view.coverage_samples = 0, check_color(it.volume[0].emission, 0, 0, 0), it.light[0].angular_diameter = 0;
        it.volume[0].extinction = 0.05f;
    } else if (b == TABLES || b == MAPPED) {
        for (int i = 0; i < 2; ++i) {
            if (b == MAPPED) it.light[i].shadow_map = &it.shadow_map;
            it.light[i].shadow_map_size = 12,
            it.light[i].shadow_source = b == TABLES ? SPS_SHADOW_TABLE : SPS_SHADOW_AUTO;
        }
        it.light[0].angular_diameter = 0, it.light[0].samples = 0;
    } else if (b == COMPRESSED || b == DEEP || b == FOURIER) {
        it.map_settings.technique = b == COMPRESSED ? SPS_TMAP_COMPRESSED
                                    : b == DEEP     ? SPS_TMAP_DEEP
                                                    : SPS_TMAP_FOURIER;
        it.map_settings.components = b == FOURIER ? 7 : 0, it.map_settings.planes = NULL;
    } else if (b == FACED) {
        check_set3(it.map_light.camera.position, 0.1, 0.2, 0.3);
        it.map_light.width = it.map_light.height = 5, it.map_light.omnidirectional = 1;
        it.map_settings.near_depth = 0.01;
    } else if (b == BUDGETED_MAP) {
        it.map_settings.components = 0, it.map_settings.planes = NULL, it.map_settings.byte_budget = 8 * 99 * 4;
    } else if (b == PATHS) {
        it.reference.samples = 2, it.reference.seed = 5;
    } else if (b == REGION) {
        it.view.region[0] = 1, it.view.region[1] = 2, it.view.region[2] = 5, it.view.region[3] = 4;
    } else if (b == SLIDE_OF_DISC) {
        it.light[1].projector = NULL, it.light[2].projector = &it.projector, it.projector.focus = 3;
    } else if (b == RECTANGLE) {
        it.light[2].kind = SPS_LIGHT_RECTANGLE;
    } else if (b == COLORED) {
        it.mesh[0].has_colors = 1;
    } else if (b == LONG_INDICES) {
        it.indexed.indices_u16 = NULL, it.indexed.indices_u32 = it.long_indices;
        it.mesh[1].shade_fn = shade, it.mesh[1].shade_user = &it.look;
    }
}

/* ------------------------------------------------------------------------------------------------------- the fields */

typedef enum kind { INT, FLOAT, DOUBLE, SIZE, WORD, POINTER } kind;

/* Besides the field itself: nothing; the revisions, since it is data behind them; the volume's size, which has to be
   the grid's; or what must not show. */
typedef enum also { NOTHING, REVISION, SIZES, HIDDEN } also;

typedef struct row {
    const char *type, *name;
    size_t at, size;
    kind kind;
    double value;
    void *pointer;
    base base;
    also also;
} row;

#define AT(type, name, path) #type, #name, offsetof(everything, path.name), sizeof(((everything *)0)->path.name)
#define I(type, name, path, value, base, also)                                                                         \
    { AT(type, name, path), INT, value, NULL, base, also }
#define F(type, name, path, value, base, also)                                                                         \
    { AT(type, name, path), FLOAT, value, NULL, base, also }
#define D(type, name, path, value, base, also)                                                                         \
    { AT(type, name, path), DOUBLE, value, NULL, base, also }
#define Z(type, name, path, value, base, also)                                                                         \
    { AT(type, name, path), SIZE, value, NULL, base, also }
#define W(type, name, path, value, base, also)                                                                         \
    { AT(type, name, path), WORD, value, NULL, base, also }
#define P(type, name, path, pointer, base, also)                                                                       \
    { AT(type, name, path), POINTER, 0, pointer, base, also }

#define CAMERA(path)                                                                                                   \
    D(sps_camera, position, path, 4.2, PLAIN, NOTHING), D(sps_camera, target, path, 0.2, PLAIN, NOTHING),              \
        D(sps_camera, up, path, 0.5, PLAIN, NOTHING), D(sps_camera, field_of_view, path, 0.7, PLAIN, NOTHING),         \
        D(sps_camera, ortho_height, path, 2.2, ORTHOGRAPHIC, NOTHING),                                                 \
        P(sps_camera, world_to_clip, path, it.other_matrix, MATRIX, NOTHING)

static const row rows[] = {
    D(sps_placement, origin, volume[0].placement, 0.05, PLAIN, NOTHING),
    D(sps_placement, axis, volume[0].placement, 0.3, PLAIN, NOTHING),
    D(sps_placement, origin, volume[1].placement, 0.05, PLAIN, NOTHING),
    D(sps_placement, axis, volume[1].placement, 0.3, PLAIN, NOTHING),
    D(sps_placement, origin, mesh[0].placement, 0.07, PLAIN, NOTHING),
    D(sps_placement, axis, mesh[0].placement, 0.2, PLAIN, NOTHING),
    D(sps_placement, origin, mesh[1].placement, 0.07, PLAIN, NOTHING),
    D(sps_placement, axis, mesh[1].placement, 0.2, PLAIN, NOTHING),
    F(sps_lobe, asymmetry, lobe[0], 0.1, PLAIN, NOTHING),
    F(sps_lobe, weight, lobe[0], 5, PLAIN, NOTHING),
    F(sps_lobe, asymmetry, lobe[1], 0.1, PLAIN, NOTHING),
    F(sps_lobe, weight, lobe[1], 5, PLAIN, NOTHING),
    F(sps_transfer_point, value, point[0], 0.2, PLAIN, NOTHING),
    F(sps_transfer_point, color, point[1], 0.5, PLAIN, NOTHING),
    F(sps_transfer_point, extinction, point[1], 2, PLAIN, NOTHING),
    F(sps_transfer_point, value, point[2], 0.8, PLAIN, NOTHING),
    F(sps_transfer_point, extinction, point[0], 0.2, PLAIN, NOTHING),
    P(sps_transfer, points, transfer, it.other_point, PLAIN, NOTHING),
    I(sps_transfer, point_count, transfer, 2, PLAIN, NOTHING),
    P(sps_transfer, user, transfer, it.other_level, EVALUATED, NOTHING),
    F(sps_transfer, value_max, transfer, 0.5, EVALUATED, NOTHING),
    I(sps_volume, size, volume[1], 8, PLAIN, NOTHING),
    D(sps_volume, placement, volume[1], 0.35, PLAIN, NOTHING),
    P(sps_volume, user, volume[0], &it.other_grid, PLAIN, NOTHING),
    P(sps_volume, user, volume[1], it.other_level, PLAIN, NOTHING),
    I(sps_volume, concurrent, volume[1], 1, PLAIN, HIDDEN),
    W(sps_volume, revision, volume[0], 8, PLAIN, HIDDEN),
    W(sps_volume, revision, volume[1], 0, PLAIN, HIDDEN),
    F(sps_volume, extinction, volume[0], 2, PLAIN, NOTHING),
    F(sps_volume, albedo, volume[0], 0.4, PLAIN, NOTHING),
    F(sps_volume, emission, volume[0], 0.1, PLAIN, NOTHING),
    F(sps_volume, ambient, volume[0], 0.2, PLAIN, NOTHING),
    F(sps_volume, ambient, volume[1], 0.2, PLAIN, NOTHING),
    P(sps_volume, lobes, volume[0], it.other_lobe, PLAIN, NOTHING),
    I(sps_volume, lobe_count, volume[0], 1, PLAIN, NOTHING),
    P(sps_volume, lobes, volume[1], it.other_lobe, PLAIN, NOTHING),
    P(sps_volume, transfer, volume[1], &it.other_transfer, PLAIN, NOTHING),
    P(sps_volume, transfer, volume[1], NULL, PLAIN, NOTHING),
    I(sps_volume, shading, volume[1], SPS_SHADING_GAS, PLAIN, NOTHING),
    F(sps_volume, gradient_full, volume[1], 0.7, PLAIN, NOTHING),
    F(sps_volume, specular, volume[1], 0.9, PLAIN, NOTHING),
    F(sps_volume, shininess, volume[1], 3, PLAIN, NOTHING),
    P(sps_grid, voxels, grid, it.other_voxels, PLAIN, REVISION),
    I(sps_grid, format, grid, SPS_VOXEL_U8, PLAIN, REVISION),
    I(sps_grid, size, grid, 3, PLAIN, SIZES),
    Z(sps_grid, stride, grid, 8, PLAIN, REVISION),
    F(sps_grid, scale, grid, 0.6, PLAIN, REVISION),
    F(sps_grid, offset, grid, 0.1, PLAIN, REVISION),
    F(sps_triangle, position, triangle[0], 0.4, PLAIN, REVISION),
    F(sps_triangle, normal, triangle[0], 0.7, PLAIN, REVISION),
    F(sps_triangle, color, triangle[0], 0.1, COLORED, REVISION),
    F(sps_triangle, uv, triangle[1], 0.9, PLAIN, REVISION),
    F(sps_surface, color, look, 0.9, PLAIN, NOTHING),
    F(sps_surface, emission, look, 0.2, PLAIN, NOTHING),
    Z(sps_mesh, triangle_count, mesh[0], 1, PLAIN, NOTHING),
    Z(sps_mesh, triangle_count, mesh[1], 2, PLAIN, NOTHING),
    P(sps_mesh, user, mesh[0], it.other_triangle, PLAIN, NOTHING),
    P(sps_mesh, user, mesh[1], &it.other_indexed, PLAIN, NOTHING),
    D(sps_mesh, placement, mesh[0], 0.1, PLAIN, NOTHING),
    F(sps_mesh, color, mesh[0], 0.2, PLAIN, NOTHING),
    I(sps_mesh, has_normals, mesh[0], 0, PLAIN, NOTHING),
    I(sps_mesh, has_colors, mesh[0], 1, PLAIN, NOTHING),
    I(sps_mesh, has_normals, mesh[1], 0, PLAIN, NOTHING),
    I(sps_mesh, has_colors, mesh[1], 0, PLAIN, NOTHING),
    P(sps_mesh, shade_user, mesh[0], &it.other_look, PLAIN, NOTHING),
    F(sps_mesh, transmittance, mesh[1], 0.7, PLAIN, NOTHING),
    W(sps_mesh, revision, mesh[0], 0, PLAIN, HIDDEN),
    W(sps_mesh, revision, mesh[1], 4, PLAIN, HIDDEN),
    Z(sps_indexed_mesh, vertex_count, indexed, 5, PLAIN, REVISION),
    P(sps_indexed_mesh, positions, indexed, it.other_floats, PLAIN, REVISION),
    P(sps_indexed_mesh, normals, indexed, it.other_floats, PLAIN, REVISION),
    P(sps_indexed_mesh, colors, indexed, it.other_floats, PLAIN, REVISION),
    Z(sps_indexed_mesh, position_stride, indexed, 8, PLAIN, REVISION),
    Z(sps_indexed_mesh, normal_stride, indexed, 16, PLAIN, REVISION),
    Z(sps_indexed_mesh, color_stride, indexed, 8, PLAIN, REVISION),
    Z(sps_indexed_mesh, triangle_count, indexed, 2, PLAIN, REVISION),
    P(sps_indexed_mesh, indices_u16, indexed, it.other_indices, PLAIN, REVISION),
    P(sps_indexed_mesh, uvs, indexed, it.other_floats, LONG_INDICES, REVISION),
    Z(sps_indexed_mesh, uv_stride, indexed, 4, LONG_INDICES, REVISION),
    P(sps_indexed_mesh, indices_u32, indexed, it.other_long_indices, LONG_INDICES, REVISION),
    F(sps_particle, position, particle[1], 0.25, PLAIN, NOTHING),
    F(sps_particle, radius, particle[1], 0.4, PLAIN, NOTHING),
    F(sps_particle, optical_depth, particle[1], 2, PLAIN, NOTHING),
    Z(sps_particles, count, set, 4, PLAIN, NOTHING),
    P(sps_particles, user, set, it.other_particle, PLAIN, NOTHING),
    I(sps_particles, soft, set, 0, PLAIN, NOTHING),
    I(sps_particles, is_extinction, set, 1, PLAIN, NOTHING),
    F(sps_particles, albedo, set, 0.3, PLAIN, NOTHING),
    F(sps_particles, emission, set, 0.2, PLAIN, NOTHING),
    F(sps_particles, ambient, set, 0.2, PLAIN, NOTHING),
    P(sps_particles, lobes, set, it.other_lobe, PLAIN, NOTHING),
    I(sps_particles, lobe_count, set, 2, PLAIN, NOTHING),
    I(sps_tmap_settings, technique, shadow_map, SPS_TMAP_DEEP_OPACITY, MAPPED, NOTHING),
    I(sps_tmap_settings, components, shadow_map, 16, MAPPED, NOTHING),
    I(sps_tmap_settings, technique, map_settings, SPS_TMAP_DEEP_OPACITY, PLAIN, NOTHING),
    I(sps_tmap_settings, technique, map_settings, SPS_TMAP_BEER, DEEP, NOTHING),
    I(sps_tmap_settings, technique, map_settings, SPS_TMAP_MOMENT, DEEP, NOTHING),
    I(sps_tmap_settings, technique, map_settings, SPS_TMAP_DEPTH, DEEP, NOTHING),
    I(sps_tmap_settings, technique, map_settings, SPS_TMAP_DEFAULT, DEEP, NOTHING),
    I(sps_tmap_settings, components, map_settings, 5, PLAIN, NOTHING),
    Z(sps_tmap_settings, byte_budget, map_settings, 6 * 99 * 4, BUDGETED_MAP, NOTHING),
    D(sps_tmap_settings, near_depth, map_settings, 1.2, PLAIN, NOTHING),
    D(sps_tmap_settings, far_depth, map_settings, 5, PLAIN, NOTHING),
    P(sps_tmap_settings, planes, map_settings, it.other_planes, PLAIN, NOTHING),
    I(sps_tmap_settings, cubic, map_settings, 1, PLAIN, NOTHING),
    I(sps_tmap_settings, texel_range, map_settings, 1, FOURIER, NOTHING),
    F(sps_tmap_settings, epsilon, map_settings, 0.1, COMPRESSED, NOTHING),
    D(sps_tmap_settings, surface_bias, map_settings, 0.6, PLAIN, NOTHING),
    I(sps_projector, width, projector, 3, PLAIN, NOTHING),
    I(sps_projector, height, projector, 3, PLAIN, NOTHING),
    P(sps_projector, user, projector, &it.other_slide, PLAIN, NOTHING),
    D(sps_projector, left, projector, -0.4, PLAIN, NOTHING),
    D(sps_projector, right, projector, 0.4, PLAIN, NOTHING),
    D(sps_projector, bottom, projector, -0.4, PLAIN, NOTHING),
    D(sps_projector, top, projector, 0.4, PLAIN, NOTHING),
    D(sps_projector, up, projector, 0.5, PLAIN, NOTHING),
    D(sps_projector, focus, projector, 5, SLIDE_OF_DISC, NOTHING),
    I(sps_light, kind, light[2], SPS_LIGHT_RECTANGLE, PLAIN, NOTHING),
    I(sps_light, kind, light[2], SPS_LIGHT_DISC, RECTANGLE, NOTHING),
    D(sps_light, direction, light[0], -0.2, PLAIN, NOTHING),
    D(sps_light, direction, light[1], -0.4, PLAIN, NOTHING),
    D(sps_light, position, light[1], 1.7, PLAIN, NOTHING),
    D(sps_light, position, light[2], 1.1, PLAIN, NOTHING),
    F(sps_light, color, light[0], 2, PLAIN, NOTHING),
    F(sps_light, color, light[1], 3, PLAIN, NOTHING),
    F(sps_light, color, light[2], 3, PLAIN, NOTHING),
    D(sps_light, angular_diameter, light[0], 0.3, PLAIN, NOTHING),
    D(sps_light, axes, light[2], 0.4, PLAIN, NOTHING),
    D(sps_light, inner_cone, light[1], 0.2, PLAIN, NOTHING),
    D(sps_light, outer_cone, light[1], 0.5, PLAIN, NOTHING),
    D(sps_light, outer_cone, light[2], 0.4, PLAIN, NOTHING),
    I(sps_light, falloff, light[1], SPS_FALLOFF_NONE, PLAIN, NOTHING),
    I(sps_light, falloff, light[2], SPS_FALLOFF_NONE, PLAIN, NOTHING),
    P(sps_light, projector, light[1], &it.other_projector, PLAIN, NOTHING),
    P(sps_light, projector, light[1], NULL, PLAIN, NOTHING),
    I(sps_light, samples, light[0], 3, PLAIN, NOTHING),
    I(sps_light, samples, light[2], 3, PLAIN, NOTHING),
    I(sps_light, no_shadow, light[0], 1, PLAIN, NOTHING),
    I(sps_light, no_shadow, light[1], 1, PLAIN, NOTHING),
    I(sps_light, no_shadow, light[2], 1, PLAIN, NOTHING),
    P(sps_light, shadow_map, light[0], &it.other_shadow_map, MAPPED, NOTHING),
    P(sps_light, shadow_map, light[1], NULL, MAPPED, NOTHING),
    I(sps_light, shadow_source, light[0], SPS_SHADOW_SHEETS, TABLES, NOTHING),
    I(sps_light, shadow_source, light[1], SPS_SHADOW_AUTO, TABLES, NOTHING),
    I(sps_light, shadow_map_size, light[0], 20, TABLES, NOTHING),
    I(sps_light, shadow_map_size, light[1], 20, MAPPED, NOTHING),
    I(sps_light, shadow_map_omnidirectional, light[1], 1, TABLES, NOTHING),
    P(sps_scene, volumes, scene, it.other_volume, PLAIN, NOTHING),
    I(sps_scene, volume_count, scene, 1, PLAIN, NOTHING),
    P(sps_scene, meshes, scene, it.other_mesh, PLAIN, NOTHING),
    I(sps_scene, mesh_count, scene, 1, PLAIN, NOTHING),
    P(sps_scene, lights, scene, it.other_light, PLAIN, NOTHING),
    I(sps_scene, light_count, scene, 1, PLAIN, NOTHING),
    F(sps_scene, ambient, scene, 0.2, PLAIN, NOTHING),
    F(sps_scene, background, scene, 0.4, PLAIN, NOTHING),
    P(sps_scene, background_user, scene, &it.other_backdrop, BACKDROP, NOTHING),
    I(sps_scene, replace_invalid, scene, 0, INVALID, NOTHING),
    P(sps_scene, particles, scene, &it.other_set, PLAIN, NOTHING),
    I(sps_scene, particle_set_count, scene, 0, PLAIN, NOTHING),
    CAMERA(view.camera),
    CAMERA(map_light.camera),
    I(sps_view, width, view, 8, PLAIN, NOTHING),
    I(sps_view, height, view, 8, PLAIN, NOTHING),
    D(sps_view, camera, view, 0.9, PLAIN, NOTHING),
    D(sps_view, near_distance, view, 5, PLAIN, NOTHING),
    I(sps_view, region, view, 3, REGION, NOTHING),
    I(sps_view, quality, view, SPS_QUALITY_MEDIUM, PLAIN, NOTHING),
    I(sps_view, quality, view, SPS_QUALITY_HIGH, PLAIN, NOTHING),
    I(sps_view, quality, view, SPS_QUALITY_ULTRA, PLAIN, NOTHING),
    D(sps_view, slab, view, 1.1, PLAIN, NOTHING),
    I(sps_view, shadow_size, view, 16, PLAIN, NOTHING),
    I(sps_view, no_shadows, view, 1, PLAIN, NOTHING),
    I(sps_view, coverage_samples, view, 3, PLAIN, NOTHING),
    F(sps_view, tolerance, view, 0, SMOOTH, NOTHING),
    I(sps_view, scattering, view, SPS_SCATTERING_OFF, PLAIN, NOTHING),
    I(sps_view, scattering, view, SPS_SCATTERING_AMBIENT, PLAIN, NOTHING),
    I(sps_view, scattering, view, SPS_SCATTERING_FORWARD, PLAIN, NOTHING),
    I(sps_view, scattering, view, SPS_SCATTERING_FULL, PLAIN, NOTHING),
    I(sps_view, scattering, view, SPS_SCATTERING_CONVOLUTION, PLAIN, NOTHING),
    I(sps_view, scatter_size, view, 5, PLAIN, NOTHING),
    F(sps_view, scatter_tolerance, view, 1e6, SMOOTH, NOTHING),
    I(sps_view, filling, view, SPS_FILLING_SPLAT, SMOOTH, NOTHING),
    Z(sps_image, row_pixels, image, 12, PLAIN, NOTHING),
    D(sps_reference_settings, step, reference, 3, PLAIN, NOTHING),
    I(sps_reference_settings, samples, reference, 1, PATHS, NOTHING),
    W(sps_reference_settings, seed, reference, 6, PATHS, NOTHING),
    I(sps_tmap_light, width, map_light, 9, PLAIN, NOTHING),
    I(sps_tmap_light, height, map_light, 7, PLAIN, NOTHING),
    D(sps_tmap_light, camera, map_light, 0.8, PLAIN, NOTHING),
    I(sps_tmap_light, omnidirectional, map_light, 0, FACED, NOTHING),
    I(sps_tmap_light, quality, map_light, SPS_QUALITY_DRAFT, PLAIN, NOTHING),
    D(sps_tmap_light, slab, map_light, 0.4, PLAIN, NOTHING),
};

/* Fields without a row, or, with an empty name, whole structs. */
static const struct {
    const char *type, *name, *why;
} left_out[] = {
    {"sps_error_info", "", "output"},
    {"sps_budget_report", "", "output"},
    {"sps_pass_report", "", "output"},
    {"sps_plan_report", "", "output"},
    {"sps_stats_report", "", "output"},
    {"sps_tmap_info", "", "output"},
    {"sps_tmap_constants", "", "output"},
    {"sps_surface_point", "", "what shade_fn is given"},
    {"sps_config", "", "set once for a context"},
    {"sps_transfer", "eval_fn", "callback"},
    {"sps_volume", "read_fn", "callback"},
    {"sps_volume", "range_fn", "callback"},
    {"sps_volume", "eval_fn", "callback"},
    {"sps_mesh", "read_fn", "callback"},
    {"sps_mesh", "shade_fn", "callback"},
    {"sps_particles", "read_fn", "callback"},
    {"sps_projector", "sample_fn", "callback"},
    {"sps_scene", "background_fn", "callback"},
    {"sps_view", "budget_seconds", "budget: the setting may follow from measured times"},
    {"sps_view", "budget_error", "budget: test_budget compares each setting with a picture that has it"},
    {"sps_image", "rgba", "output"},
    {"sps_image", "depth", "output"},
    {"sps_reference_settings", "error", "output"},
    {"sps_reference_settings", "lower", "output"},
    {"sps_reference_settings", "upper", "output"},
};

enum { ROWS = sizeof rows / sizeof *rows, LEFT_OUT = sizeof left_out / sizeof *left_out };

static int has_canary_name(const char *name) {
    return strcmp(name, "start_canary") == 0 || strcmp(name, "end_canary") == 0;
}

/* Whether a field of the header has a row or a reason. Marks both as used. */
static int is_listed(const char *type, const char *name, char *used) {
    int listed = has_canary_name(name);
    for (int i = 0; i < ROWS; ++i)
        if (strcmp(rows[i].type, type) == 0 && strcmp(rows[i].name, name) == 0) used[i] = 1, listed = 1;
    for (int i = 0; i < LEFT_OUT; ++i)
        if (strcmp(left_out[i].type, type) == 0 && (!*left_out[i].name || strcmp(left_out[i].name, name) == 0))
            used[ROWS + i] = 1, listed = 1;
    return listed;
}

/* Replaces comments by blanks. */
static void blank_comments(char *text) {
    int inside = 0;
    for (char *c = text; *c; ++c) {
        const int begins = !inside && c[0] == '/' && c[1] == '*', ends = inside && c[0] == '*' && c[1] == '/';
        if (begins) inside = 1;
        if (ends) c[0] = c[1] = ' ', inside = 0;
        if (inside) *c = ' ';
    }
}

static int is_part_of_name(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
}

/* The name that ends at `end`, exclusive, or in brackets before that. */
static void copy_name(const char *begin, const char *end, char name[64]) {
    size_t length = 0;
    for (const char *c = begin; c < end; ++c)
        if (*c == '[') end = c;
    while (end > begin && !is_part_of_name(end[-1])) --end;
    while (end - length > begin && is_part_of_name(end[-1 - (long)length]) && length < 63) ++length;
    memcpy(name, end - length, length);
    name[length] = 0;
}

/* Looks up each name that a declaration declares: of a function pointer, what follows the star in parentheses. Returns
   how many there are. */
static int check_declaration(const char *type, const char *begin, const char *end, char *used) {
    const char *star = begin;
    int count = 0;
    char name[64];
    while (star + 1 < end && !(star[0] == '(' && star[1] == '*')) ++star;
    if (star + 1 < end) {
        const char *close = star;
        while (close < end && *close != ')') ++close;
        copy_name(star + 2, close, name);
        if (!CHECK(is_listed(type, name, used))) printf("    %s.%s has neither a row nor a reason\n", type, name);
        return 1;
    }
    for (const char *comma = begin; comma <= end; ++comma) {
        if (comma < end && *comma != ',') continue;
        copy_name(begin, comma, name);
        if (*name && !CHECK(is_listed(type, name, used)))
            printf("    %s.%s has neither a row nor a reason\n", type, name);
        count += *name != 0;
        begin = comma + 1;
    }
    return count;
}

/* Every field of every public struct is listed, and nothing else is. */
static void test_list(void) {
    static char used[ROWS + LEFT_OUT];
    static const char start[] = "typedef struct sps_";
    size_t size;
    FILE *file = fopen("splatshadow.h", "rb");
    char *text = (char *)calloc(1, 1 << 17);
    int structs = 0, fields = 0;
    if (!CHECK(file != NULL && text != NULL)) return;
    size = fread(text, 1, (1 << 17) - 1, file);
    fclose(file);
    CHECK(size > 100000);
    blank_comments(text);
    for (char *at = strstr(text, start); at; at = strstr(at + 1, start)) {
        char *open = strpbrk(at, "{;"), *end, *declaration, type[64];
        if (*open == ';') continue; /* opaque */
        copy_name(at, open, type);
        end = strchr(open, '}');
        for (declaration = open + 1; (at = strchr(declaration, ';')) != NULL && at < end; declaration = at + 1)
            fields += check_declaration(type, declaration, at, used);
        at = end, ++structs;
    }
    free(text);
    CHECK(structs == 30 && fields > 200);
    for (int i = 0; i < ROWS + LEFT_OUT; ++i)
        if (!CHECK(used[i]))
            printf("    %s.%s is not in the header\n", i < ROWS ? rows[i].type : left_out[i - ROWS].type,
                   i < ROWS ? rows[i].name : left_out[i - ROWS].name);
}

/* --------------------------------------------------------------------------------------------------------- the ways */

typedef enum maker { RENDER, REFERENCE, MAP } maker;

typedef struct way {
    maker maker;
    sps_scattering scattering;
    sps_shadow_source source; /* AUTO: as the lights have it */
} way;

static const way ways[] = {
    {RENDER, SPS_SCATTERING_OFF, SPS_SHADOW_AUTO},      {MAP, SPS_SCATTERING_OFF, SPS_SHADOW_AUTO},
    {RENDER, SPS_SCATTERING_AMBIENT, SPS_SHADOW_AUTO},  {RENDER, SPS_SCATTERING_OFF, SPS_SHADOW_SHEETS},
    {RENDER, SPS_SCATTERING_OFF, SPS_SHADOW_TABLE},     {RENDER, SPS_SCATTERING_CONVOLUTION, SPS_SHADOW_AUTO},
    {REFERENCE, SPS_SCATTERING_OFF, SPS_SHADOW_AUTO},   {RENDER, SPS_SCATTERING_FORWARD, SPS_SHADOW_SHEETS},
    {RENDER, SPS_SCATTERING_FORWARD, SPS_SHADOW_AUTO},  {RENDER, SPS_SCATTERING_AMBIENT, SPS_SHADOW_SHEETS},
    {RENDER, SPS_SCATTERING_AMBIENT, SPS_SHADOW_TABLE}, {RENDER, SPS_SCATTERING_FULL, SPS_SHADOW_AUTO},
    {RENDER, SPS_SCATTERING_FORWARD, SPS_SHADOW_TABLE}, {RENDER, SPS_SCATTERING_CONVOLUTION, SPS_SHADOW_SHEETS},
    {RENDER, SPS_SCATTERING_AUTO, SPS_SHADOW_SHEETS},   {RENDER, SPS_SCATTERING_CONVOLUTION, SPS_SHADOW_TABLE},
    {RENDER, SPS_SCATTERING_FULL, SPS_SHADOW_TABLE},    {RENDER, SPS_SCATTERING_AUTO, SPS_SHADOW_AUTO},
    {RENDER, SPS_SCATTERING_FULL, SPS_SHADOW_SHEETS},   {RENDER, SPS_SCATTERING_AUTO, SPS_SHADOW_TABLE}};

enum { WAYS = sizeof ways / sizeof *ways };

/* What a call returned and wrote. */
typedef struct outcome {
    sps_result result;
    size_t count;
    float data[FLOATS];
} outcome;

static void append(outcome *out, const float *values, size_t count) {
    if (!values || !CHECK(out->count + count <= FLOATS)) return;
    memcpy(out->data + out->count, values, count * sizeof *values);
    out->count += count;
}

/* A map's texels, where they begin, its surfaces, and shadows at places along a line through the scene. */
static void make_map(sps_context *context, outcome *out) {
    sps_tmap *map = NULL;
    sps_tmap_info info;
    double positions[8][3];
    float depths[8];
    out->result = sps_tmap_create(context, &it.map_light, &it.map_settings, &map);
    if (out->result == SPS_OK) out->result = sps_tmap_add(map, &it.scene);
    if (out->result == SPS_OK) out->result = sps_tmap_finish(map);
    if (out->result == SPS_OK && CHECK(sps_tmap_get_info(map, &info) == SPS_OK)) {
        for (int i = 0; i < 8; ++i) check_set3(positions[i], 0.2 * i - 0.8, 0.3 - 0.1 * i, 1.1 - 0.4 * i);
        CHECK(sps_tmap_query(map, 8, positions[0], depths, NULL) == SPS_OK);
        append(out, depths, 8);
        append(out, sps_tmap_texels(map), info.float_count);
        append(out, sps_tmap_surfaces(map), info.texel_count);
    }
    sps_tmap_destroy(map);
}

static void make_picture(sps_context *context, const way *w, outcome *out) {
    static float rgba[4 * 2000], depth[2000];
    size_t count;
    it.image.rgba = rgba, it.image.depth = depth;
    memset(rgba, 0, sizeof rgba), memset(depth, 0, sizeof depth);
    out->result = w->maker == REFERENCE ? sps_reference(context, &it.scene, &it.view, &it.reference, &it.image)
                                        : sps_render(context, &it.scene, &it.view, &it.image);
    count = (size_t)it.view.width * (size_t)it.view.height * (it.image.row_pixels ? 2 : 1);
    append(out, rgba, 4 * count), append(out, depth, count);
}

static void make(sps_context *context, const way *w, outcome *out) {
    memset(out, 0, sizeof *out);
    if (w->maker == MAP)
        make_map(context, out);
    else
        make_picture(context, w, out);
}

static void make_fresh(const way *w, outcome *out) {
    sps_context *context = check_context(NULL);
    make(context, w, out);
    sps_destroy(context);
}

static int same_outcome(const outcome *a, const outcome *b) {
    return a->result == b->result && a->count == b->count && memcmp(a->data, b->data, a->count * sizeof *a->data) == 0;
}

/* What a way asks for, unless the row's own base has it otherwise. */
static void set_way(const way *w, const row *r) {
    const int paths = r->base == PATHS && w->maker == REFERENCE;
    it.view.scattering = paths ? SPS_SCATTERING_FULL : w->scattering;
    if (!paths) it.reference.samples = 0;
    for (int i = 0; i < 3; ++i)
        if (w->source != SPS_SHADOW_AUTO && r->base != TABLES && r->base != MAPPED)
            it.light[i].shadow_source = w->source;
    memcpy(it.other_light, it.light, sizeof it.light), it.other_light[2].position[0] = -1;
}

static size_t element_size(kind k) {
    static const size_t sizes[] = {sizeof(int),    sizeof(float),    sizeof(double),
                                   sizeof(size_t), sizeof(uint64_t), sizeof(void *)};
    return sizes[k];
}

static void change(const row *r, size_t element) {
    unsigned char *at = (unsigned char *)&it + r->at + element * element_size(r->kind);
    const int i = (int)r->value;
    const float f = (float)r->value;
    const size_t z = (size_t)r->value;
    const uint64_t w = (uint64_t)r->value;
    if (r->kind == INT) memcpy(at, &i, sizeof i);
    if (r->kind == FLOAT) memcpy(at, &f, sizeof f);
    if (r->kind == DOUBLE) memcpy(at, &r->value, sizeof r->value);
    if (r->kind == SIZE) memcpy(at, &z, sizeof z);
    if (r->kind == WORD) memcpy(at, &w, sizeof w);
    if (r->kind == POINTER) memcpy(at, &r->pointer, sizeof r->pointer);
    if (r->also == REVISION || r->also == SIZES)
        for (int k = 0; k < 2; ++k) it.volume[k].revision += 1, it.mesh[k].revision += 1;
    if (r->also == SIZES) it.volume[0].size[element] = i;
}

/* What a new context makes of a base before any change. */
static const outcome *made_before(base b, int n, const row *r) {
    static outcome *made[BASES][WAYS];
    build_base(b), set_way(&ways[n], r);
    if (!made[b][n]) {
        made[b][n] = (outcome *)malloc(sizeof(outcome));
        if (!made[b][n]) abort();
        make_fresh(&ways[n], made[b][n]);
        if (!CHECK(made[b][n]->result == SPS_OK)) printf("    base %d, way %d\n", (int)b, n);
    }
    return made[b][n];
}

static void complain(const row *r, size_t element, int n, const char *what) {
    printf("    %s.%s, element %d, row %d, way %d: %s\n", r->type, r->name, (int)element, (int)(r - rows), n, what);
}

/* Whether the change of an element shows in way number n. The held context makes what was before, what is after, and
   what was before again; all three are what a new context makes. */
static int shows(sps_context *held, const row *r, size_t element, int n) {
    static const outcome *last; /* what the held context has made last */
    static outcome out, fresh;
    const outcome *before = made_before(r->base, n, r);
    int wrong = 0, shown;
    if (last != before) make(held, &ways[n], &out), wrong = !same_outcome(&out, before);
    change(r, element);
    make(held, &ways[n], &out);
    make_fresh(&ways[n], &fresh);
    shown = !same_outcome(&fresh, before);
    if (!same_outcome(&out, &fresh)) wrong |= 2;
    made_before(r->base, n, r);
    make(held, &ways[n], &out);
    if (!same_outcome(&out, before)) wrong |= 4;
    last = before;
    if (!CHECK_CASE("Engineering", "each field of each struct changed alone in a context that held what was before",
                    "the bits of a new context", wrong, 0, "same bits"))
        complain(r, element, n, wrong & 2 ? "changed" : wrong & 4 ? "changed back" : "before");
    return shown;
}

/* Tries the first way for each element, and another one in turn for one element of every third row; in the long test,
   all ways. If the change shows in none of these, the others are tried until it does. */
static void check_element(sps_context *held, const row *r, size_t element) {
    const int turn = 1 + (int)(r - rows) / 3 % (WAYS - 1), count = (int)(r->size / element_size(r->kind));
    const int takes_turn = (r - rows) % 3 == 0 && (int)element == (int)(r - rows) % count;
    char seen[WAYS + 1] = "";
    int shown = 0;
    for (int due = 1; due >= 0; --due)
        for (int n = 0; n < WAYS; ++n) {
            if (due) seen[n] = '.';
            if (due ? n > 0 && !(takes_turn && n == turn) && !check_long()
                    : shown || r->also == HIDDEN || seen[n] != '.')
                continue;
            seen[n] = shows(held, r, element, n) ? 'x' : '-';
            shown |= seen[n] == 'x';
        }
    if (getenv("CHECK_FIGURES")) printf("%-20s %-16s %2d  %s\n", r->type + 4, r->name, (int)element, seen);
    if (!CHECK(shown == (r->also != HIDDEN))) complain(r, element, 0, shown ? "shows" : "shows nowhere");
}

/* The quick test takes every third element of longer arrays. */
static void test_fields(void) {
    sps_context *held = check_context(NULL);
    for (int i = 0; i < ROWS; ++i) {
        const size_t count = rows[i].size / element_size(rows[i].kind);
        for (size_t element = 0; element < count; ++element)
            if (check_long() || count <= 3 || element % 3 == (size_t)i % 3) check_element(held, &rows[i], element);
    }
    sps_destroy(held);
}

int main(void) {
    RUN(test_list);
    RUN(test_fields);
    return check_report();
}
