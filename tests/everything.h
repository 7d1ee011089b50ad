/* A scene that has everything, small, and the ways to make images and maps of it: what test_fields changes field by
   field, and test_relations as a whole. */

#ifndef EVERYTHING_H
#define EVERYTHING_H

#include "check.h"

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
    sps_strands strands, other_strands;
    sps_strand_point strand[4], other_strand[4];
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
    double unit; /* of the places where maps are asked */
} everything;

static everything it;

static inline int read_ramp(void *user, const int lo[3], const int size[3], float *out) {
    const float *level = (const float *)user;
    for (int k = lo[2]; k < lo[2] + size[2]; ++k)
        for (int j = lo[1]; j < lo[1] + size[1]; ++j)
            for (int i = lo[0]; i < lo[0] + size[0]; ++i)
                *out++ = level[0] * (0.62f + 0.3f * sinf((float)(i + 2 * j)) + 0.3f * cosf((float)(k - i))) + level[1];
    return 0;
}

static inline int eval_transfer(void *user, size_t count, const float *values, sps_transfer_point *out) {
    const float *level = (const float *)user;
    for (size_t i = 0; i < count; ++i) {
        out[i].extinction = level[0] * 4 * values[i] * values[i];
        for (int c = 0; c < 3; ++c) out[i].albedo[c] = fminf(1, values[i] * (0.5f + 0.2f * (float)c));
    }
    return 0;
}

static inline int shade(void *user, size_t count, const sps_surface_point *points, sps_surface *out) {
    const sps_surface *look = (const sps_surface *)user;
    for (size_t i = 0; i < count; ++i)
        for (int c = 0; c < 3; ++c) {
            out[i].albedo[c] = look->albedo[c] * (0.8f + 0.1f * sinf((float)(3 * points[i].uv[0] + points[i].uv[1])));
            out[i].emission[c] = look->emission[c];
        }
    return 0;
}

static int slide_turn; /* by which channels of the slide are exchanged */

static inline int throw_slide(void *user, size_t count, const float *uv, float *out) {
    for (size_t i = 0; i < 3 * count; ++i)
        out[i] =
            *(const float *)user *
            (0.5f + 0.4f * sinf(9 * uv[i / 3 * 2] + 5 * uv[i / 3 * 2 + 1] + (float)((i + (size_t)slide_turn) % 3)));
    return 0;
}

static inline int paint_backdrop(void *user, size_t count, const float *directions, float *out) {
    for (size_t i = 0; i < 3 * count; ++i) out[i] = *(const float *)user * (1.2f + directions[i]);
    return 0;
}

static inline void build_volumes(void) {
    sps_volume *gas = &it.volume[0], *matter = &it.volume[1];
    static const sps_lobe lobes[2] = {{0.6f, 2}, {-0.3f, 1}}, others[2] = {{0.2f, 2}, {-0.5f, 1}};
    static const sps_transfer_point points[3] = {{0.1f, {0.9f, 0.4f, 0.4f}, 0, {0, 0, 0}},
                                                 {0.5f, {0.7f, 0.7f, 0.3f}, 3, {0.2f, 0.1f, 0}},
                                                 {0.9f, {0.2f, 0.5f, 0.9f}, 6, {0, 0, 0}}};
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

static inline void build_triangle(sps_triangle *triangle, const float corners[9]) {
    for (int i = 0; i < 9; ++i) {
        triangle->position[i / 3][i % 3] = corners[i];
        triangle->normal[i / 3][i % 3] = i % 3 == 2 ? 1 : 0.1f + 0.2f * (float)(i / 3);
        triangle->albedo[i / 3][i % 3] = 0.4f + 0.05f * (float)i;
        if (i < 6) triangle->uv[i / 2][i % 2] = 0.3f * (float)i;
    }
}

static inline void build_meshes(void) {
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
    it.indexed.positions = it.positions, it.indexed.normals = it.normals, it.indexed.albedos = it.colors;
    it.indexed.uvs = it.uvs;
    it.indexed.position_stride = it.indexed.normal_stride = it.indexed.albedo_stride = 12, it.indexed.uv_stride = 8;
    it.other_indexed = it.indexed, it.other_indexed.albedos = it.other_floats;
    check_color(it.look.albedo, 0.6, 0.6, 0.5), check_color(it.look.emission, 0.01, 0.03, 0.03);
    it.other_look = it.look, it.other_look.albedo[2] = 0.9f;
    for (int i = 0; i < 2; ++i) {
        sps_mesh *mesh = &it.mesh[i];
        mesh->read_fn = i ? sps_indexed_mesh_read : NULL, mesh->user = i ? (void *)&it.indexed : it.triangle;
        mesh->triangle_count = i ? 3 : 2, mesh->placement = check_box(0, 0, 0, 1, 1, 1), mesh->revision = 3;
        check_color(mesh->albedo, 0.7, 0.5, 0.5), mesh->has_normals = 1, mesh->has_albedos = i;
    }
    check_color(it.mesh[1].transmittance, 0.5, 0.5, 0.3);
    it.mesh[0].shade_fn = shade, it.mesh[0].shade_user = &it.look;
}

static inline int read_triangles(void *user, size_t first, size_t count, sps_triangle *out) {
    memcpy(out, (const sps_triangle *)user + first, count * sizeof *out);
    return 0;
}

static inline void build_particles(void) {
    for (int i = 0; i < 4; ++i) {
        it.particle[i].position[0] = -0.6f + 0.45f * (float)i,
        it.particle[i].position[1] = 0.5f - 0.3f * (float)(i % 3);
        it.particle[i].position[2] = 0.3f * (float)(i % 2), it.particle[i].radius = 0.2f + 0.05f * (float)i;
        it.particle[i].optical_depth = 0.9f;
        check_color(it.particle[i].albedo, 0.9, 0.2 + 0.2 * i, 0.1);
        it.other_particle[i] = it.particle[i], it.other_particle[i].radius = 0.3f;
    }
    it.set.count = 3, it.set.read_fn = check_read_particles, it.set.user = it.particle, it.set.soft = 1;
    check_color(it.set.albedo, 0.5, 0.9, 0.9), check_color(it.set.emission, 0.05, 0.02, 0.05);
    check_color(it.set.ambient, 0.04, 0.04, 0.02), it.set.lobes = it.lobe, it.set.lobe_count = 1;
    it.other_set = it.set, it.other_set.albedo[0] = 0.8f;
}

static inline int read_strand(void *user, size_t first, size_t count, sps_strand_point *out) {
    memcpy(out, (const sps_strand_point *)user + first, count * sizeof *out);
    return 0;
}

static inline void build_strands(void) {
    for (int i = 0; i < 4; ++i) {
        sps_strand_point *p = &it.strand[i];
        p->position[0] = -0.6f + 0.4f * (float)i, p->position[1] = 0.3f * (float)(i % 2), p->position[2] = 0.4f;
        p->width = 0.2f, p->optical_depth = 0.5f;
        it.other_strand[i] = *p, it.other_strand[i].width = 0.3f;
    }
    it.strands.point_count = 4, it.strands.read_fn = read_strand, it.strands.user = it.strand;
    it.other_strands = it.strands, it.other_strands.user = it.other_strand;
}

static inline void build_lights(void) {
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

static inline void build_maps(void) {
    for (int i = 0; i < 6; ++i) it.planes[i] = (float)(i + 1) / 6, it.other_planes[i] = it.planes[i] * it.planes[i];
    it.map_light.width = 11, it.map_light.height = 9;
    check_set3(it.map_light.camera.position, 1.3, 1.4, 2.6), check_set3(it.map_light.camera.target, 0, 0, 0);
    it.map_light.camera.up[0] = 0.2, it.map_light.camera.up[1] = 1, it.map_light.camera.field_of_view = 1.1,
    it.map_light.slab_thickness = 0.7;
    it.map_light.quality = SPS_QUALITY_HIGH;
    it.map_settings.near_depth = 1, it.map_settings.far_depth = 6, it.map_settings.surface_bias = 0.05;
    it.map_settings.technique = SPS_TMAP_OPACITY, it.map_settings.components = 6, it.map_settings.planes = it.planes;
}

static inline void build(void) {
    sps_camera *camera = &it.view.camera;
    memset(&it, 0, sizeof it), it.unit = 1;
    build_volumes(), build_meshes(), build_particles(), build_strands(), build_lights(), build_maps();
    it.mesh[0].read_fn = read_triangles;
    memcpy(it.other_mesh, it.mesh, sizeof it.mesh), it.other_mesh[0].albedo[1] = 0.2f,
                                                    it.other_mesh[1].albedo[1] = 0.3f;
    it.other_mesh[1].transmittance[0] = 0.2f;
    it.scene.volumes = it.volume, it.scene.volume_count = 2, it.scene.meshes = it.mesh, it.scene.mesh_count = 2;
    it.scene.lights = it.light, it.scene.light_count = 3, it.scene.particles = &it.set;
    it.scene.particle_set_count = 1;
    check_color(it.scene.ambient, 0.05, 0.05, 0.08), check_color(it.scene.background, 0.2, 0.1, 0.2);
    it.backdrop = 0.1f, it.other_backdrop = 0.2f;
    check_set3(camera->position, 0.4, 0.5, 5), check_set3(camera->target, 0.1, 0, 0), camera->up[1] = 1;
    camera->up[0] = 0.2, camera->field_of_view = 0.6, it.view.width = 9, it.view.height = 7,
    it.view.quality = SPS_QUALITY_DRAFT;
    it.view.slab_thickness = 1.5, it.view.shadow_resolution = 14, it.view.coverage_samples = 2,
    it.view.scattering_resolution = 4;
    it.view.scattering_tolerance = 0.01f, it.reference.step = 4;
}

/* What the fields of a row need besides. */
typedef enum base {
    PLAIN,
    ORTHOGRAPHIC, /* cameras and the light's map */
    MATRIX,
    EVALUATED,  /* a transfer function by eval_fn */
    CROPPED,    /* both volumes */
    BACKDROP,   /* background_fn */
    SKY,        /* sky_fn */
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
    DYED,         /* particles */
    LONG_INDICES, /* and a second mesh that is shaded by shade_fn */
    STRANDS,      /* maps */
    BASES
} base;

static inline void build_matrices(double height) {
    static const double rows[16] = {0.6, 0, 0.05, 0, 0, 0.7, 0, 0.05, 0.01, 0, -0.2, 0, 0, 0, 0, 1};
    memcpy(it.matrix, rows, sizeof rows), memcpy(it.other_matrix, rows, sizeof rows);
    for (int i = 0; i < 8; ++i) it.matrix[i] /= height, it.other_matrix[i] /= i < 4 ? 0.9 * height : height;
}

static inline void build_base(base b) {
    build();
    if (b == ORTHOGRAPHIC) {
        check_orthographic(&it.view.camera, 2.6), check_orthographic(&it.map_light.camera, 2.6);
    } else if (b == MATRIX) {
        build_matrices(1);
        check_matrix(&it.view.camera, it.matrix), check_matrix(&it.map_light.camera, it.matrix);
    } else if (b == EVALUATED) {
        it.transfer.points = NULL, it.transfer.point_count = 0, it.transfer.eval_fn = eval_transfer;
    } else if (b == CROPPED) {
        static const int crop[2][6] = {{1, 0, 1, 6, 4, 4}, {1, 0, 1, 5, 6, 6}};
        for (int i = 0; i < 2; ++i) memcpy(it.volume[i].crop, crop[i], sizeof crop[i]);
    } else if (b == BACKDROP) {
        it.scene.background_fn = paint_backdrop, it.scene.background_user = &it.backdrop;
    } else if (b == SKY) {
        it.scene.sky_fn = paint_backdrop, it.scene.sky_user = &it.backdrop;
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
            it.light[i].shadow_map_resolution = 12,
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
        it.mesh[0].has_albedos = 1;
    } else if (b == DYED) {
        it.set.has_albedos = 1;
    } else if (b == LONG_INDICES) {
        it.indexed.indices_u16 = NULL, it.indexed.indices_u32 = it.long_indices;
        it.mesh[1].shade_fn = shade, it.mesh[1].shade_user = &it.look;
    } else if (b == STRANDS) {
        it.scene.strands = &it.strands, it.scene.strand_set_count = 1;
    }
}

/* --------------------------------------------------------------------------------------------------------- the ways */

typedef enum maker { RENDER, REFERENCE, MAP } maker;

typedef struct way {
    maker by;
    sps_scattering scattering;
    sps_shadow_source source; /* AUTO: as the lights have it */
} way;

static const way ways[] = {
    {RENDER, SPS_SCATTERING_SINGLE, SPS_SHADOW_AUTO},     {MAP, SPS_SCATTERING_SINGLE, SPS_SHADOW_AUTO},
    {RENDER, SPS_SCATTERING_AMBIENT, SPS_SHADOW_AUTO},    {RENDER, SPS_SCATTERING_SINGLE, SPS_SHADOW_SHEETS},
    {RENDER, SPS_SCATTERING_SINGLE, SPS_SHADOW_TABLE},    {RENDER, SPS_SCATTERING_CONVOLUTION, SPS_SHADOW_AUTO},
    {REFERENCE, SPS_SCATTERING_SINGLE, SPS_SHADOW_AUTO},  {RENDER, SPS_SCATTERING_FORWARD, SPS_SHADOW_SHEETS},
    {RENDER, SPS_SCATTERING_FORWARD, SPS_SHADOW_AUTO},    {RENDER, SPS_SCATTERING_AMBIENT, SPS_SHADOW_SHEETS},
    {RENDER, SPS_SCATTERING_AMBIENT, SPS_SHADOW_TABLE},   {RENDER, SPS_SCATTERING_MULTIPLE, SPS_SHADOW_AUTO},
    {RENDER, SPS_SCATTERING_FORWARD, SPS_SHADOW_TABLE},   {RENDER, SPS_SCATTERING_CONVOLUTION, SPS_SHADOW_SHEETS},
    {RENDER, SPS_SCATTERING_AUTO, SPS_SHADOW_SHEETS},     {RENDER, SPS_SCATTERING_CONVOLUTION, SPS_SHADOW_TABLE},
    {RENDER, SPS_SCATTERING_MULTIPLE, SPS_SHADOW_TABLE},  {RENDER, SPS_SCATTERING_AUTO, SPS_SHADOW_AUTO},
    {RENDER, SPS_SCATTERING_MULTIPLE, SPS_SHADOW_SHEETS}, {RENDER, SPS_SCATTERING_AUTO, SPS_SHADOW_TABLE}};

enum { WAYS = sizeof ways / sizeof *ways };

/* What a call returned and wrote. */
typedef struct outcome {
    sps_result result;
    size_t count;
    float data[FLOATS];
} outcome;

static inline void append(outcome *out, const float *values, size_t count) {
    if (!values || !CHECK(out->count + count <= FLOATS)) return;
    memcpy(out->data + out->count, values, count * sizeof *values);
    out->count += count;
}

/* A map's texels, where they begin, its surfaces, and shadows at places along a line through the scene. */
static inline void make_map(sps_context *context, outcome *out) {
    sps_tmap *map = NULL;
    sps_tmap_info info;
    double positions[8][3];
    float depths[8];
    out->result = sps_tmap_create(context, &it.map_light, &it.map_settings, &map);
    if (out->result == SPS_OK) out->result = sps_tmap_add(map, &it.scene);
    if (out->result == SPS_OK) out->result = sps_tmap_finish(map);
    if (out->result == SPS_OK && CHECK(sps_tmap_get_info(map, &info) == SPS_OK)) {
        for (int i = 0; i < 8; ++i)
            check_set3(positions[i], it.unit * (0.2 * i - 0.8), it.unit * (0.3 - 0.1 * i), it.unit * (1.1 - 0.4 * i));
        CHECK(sps_tmap_query(map, 8, positions[0], depths, NULL) == SPS_OK);
        append(out, depths, 8);
        append(out, sps_tmap_texels(map), info.float_count);
        append(out, sps_tmap_surfaces(map), info.texel_count);
        append(out, sps_tmap_fronts(map), info.texel_count);
    }
    sps_tmap_destroy(map);
}

static inline void make_picture(sps_context *context, const way *w, outcome *out) {
    static float rgba[4 * 2000], depth[2000];
    sps_scene scene = it.scene;
    size_t count;
    scene.strand_set_count = 0; /* only maps take them */
    it.image.rgba = rgba, it.image.depth = depth;
    memset(rgba, 0, sizeof rgba), memset(depth, 0, sizeof depth);
    out->result = w->by == REFERENCE ? sps_reference(context, &scene, &it.view, &it.reference, &it.image)
                                     : sps_render(context, &scene, &it.view, &it.image);
    count = (size_t)it.view.width * (size_t)it.view.height * (it.image.row_pixels ? 2 : 1);
    append(out, rgba, 4 * count), append(out, depth, count);
}

static inline void make(sps_context *context, const way *w, outcome *out) {
    memset(out, 0, sizeof *out);
    if (w->by == MAP)
        make_map(context, out);
    else
        make_picture(context, w, out);
}

static inline void make_fresh(const way *w, outcome *out) {
    sps_context *context = check_context(NULL);
    make(context, w, out);
    sps_destroy(context);
}

static inline int same_outcome(const outcome *a, const outcome *b) {
    return a->result == b->result && a->count == b->count && memcmp(a->data, b->data, a->count * sizeof *a->data) == 0;
}

/* A base without images that lights throw: they may change without notice, so that scattered light is not kept. */
static inline void build_kept(base b) {
    build_base(b);
    for (int i = 0; i < 3; ++i) it.light[i].projector = NULL;
}

/* What a way asks for, unless the base has it otherwise. */
static inline void set_way(const way *w, base b) {
    const int paths = b == PATHS && w->by == REFERENCE;
    it.view.scattering = paths ? SPS_SCATTERING_MULTIPLE : w->scattering;
    if (!paths) it.reference.samples = 0;
    for (int i = 0; i < 3; ++i)
        if (w->source != SPS_SHADOW_AUTO && b != TABLES && b != MAPPED) it.light[i].shadow_source = w->source;
    memcpy(it.other_light, it.light, sizeof it.light), it.other_light[2].position[0] = -1;
}

#endif
