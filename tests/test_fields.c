/* One field at a time. A scene that has everything is rendered; one field of one struct is changed, an array's elements
   one by one; it is rendered again in the same context. That must give the bits of a new context, and restoring the
   field those of before: whatever a context holds from call to call is made anew where a field that it depends on
   changes. Each change must show in at least one of the ways to make an image or a map, unless its row says that it
   must not. The struct declarations of splatshadow.h are read, and each field must have a row, or a reason to have
   none.

   CHECK_FIGURES in the environment prints in which ways each field shows. */

#include "everything.h"
#include <stddef.h>

/* ------------------------------------------------------------------------------------------------------- the fields */

typedef enum type_of_field { INT, FLOAT, DOUBLE, SIZE, WORD, POINTER } type_of_field;

/* Besides the field itself: nothing; the revisions, since it is data behind them; the volume's size, which has to be
   the grid's; or what must not show. */
typedef enum changes_too { NOTHING, REVISION, SIZES, HIDDEN } changes_too;

typedef struct row {
    const char *type, *name;
    size_t at, size;
    type_of_field kind;
    double value;
    void *pointer;
    base scene;
    changes_too also;
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
    F(sps_transfer_point, albedo, point[1], 0.5, PLAIN, NOTHING),
    F(sps_transfer_point, extinction, point[1], 2, PLAIN, NOTHING),
    F(sps_transfer_point, emission, point[1], 0.5, PLAIN, NOTHING),
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
    I(sps_volume, crop, volume[0], 2, CROPPED, NOTHING),
    I(sps_volume, crop, volume[1], 2, CROPPED, NOTHING),
    I(sps_volume, border, volume[1], 1, CROPPED, NOTHING),
    I(sps_volume, border, volume[1], 2, PLAIN, NOTHING),
    I(sps_volume, range_levels, volume[0], 3, PLAIN, HIDDEN),
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
    I(sps_volume, classify_voxels, volume[1], 1, PLAIN, NOTHING),
    P(sps_volume, transfer, volume[1], &it.other_transfer, PLAIN, NOTHING),
    P(sps_volume, transfer, volume[1], NULL, PLAIN, NOTHING),
    I(sps_volume, shading, volume[1], SPS_SHADING_GAS, PLAIN, NOTHING),
    F(sps_volume, gradient_full, volume[1], 0.7, PLAIN, NOTHING),
    F(sps_volume, specular, volume[1], 0.9, PLAIN, NOTHING),
    F(sps_volume, shininess, volume[1], 3, PLAIN, NOTHING),
    P(sps_grid, voxels, grid, it.other_voxels, PLAIN, REVISION),
    I(sps_grid, format, grid, SPS_VOXEL_U8, PLAIN, REVISION),
    I(sps_grid, size, grid, 3, PLAIN, SIZES),
    I(sps_grid, border, grid, 1, PLAIN, HIDDEN), /* the strides are set */
    Z(sps_grid, stride, grid, 8, PLAIN, REVISION),
    F(sps_grid, scale, grid, 0.6, PLAIN, REVISION),
    F(sps_grid, offset, grid, 0.1, PLAIN, REVISION),
    F(sps_triangle, position, triangle[0], 0.4, PLAIN, REVISION),
    F(sps_triangle, normal, triangle[0], 0.7, PLAIN, REVISION),
    F(sps_triangle, albedo, triangle[0], 0.1, COLORED, REVISION),
    F(sps_triangle, uv, triangle[1], 1.7, PLAIN, REVISION),
    F(sps_surface, albedo, look, 0.9, PLAIN, NOTHING),
    F(sps_surface, emission, look, 0.2, PLAIN, NOTHING),
    Z(sps_mesh, triangle_count, mesh[0], 1, PLAIN, NOTHING),
    Z(sps_mesh, triangle_count, mesh[1], 2, PLAIN, NOTHING),
    P(sps_mesh, user, mesh[0], it.other_triangle, PLAIN, NOTHING),
    P(sps_mesh, user, mesh[1], &it.other_indexed, PLAIN, NOTHING),
    D(sps_mesh, placement, mesh[0], 0.1, PLAIN, NOTHING),
    F(sps_mesh, albedo, mesh[0], 0.2, PLAIN, NOTHING),
    I(sps_mesh, has_normals, mesh[0], 0, PLAIN, NOTHING),
    I(sps_mesh, has_albedos, mesh[0], 1, PLAIN, NOTHING),
    I(sps_mesh, has_normals, mesh[1], 0, PLAIN, NOTHING),
    I(sps_mesh, has_albedos, mesh[1], 0, PLAIN, NOTHING),
    P(sps_mesh, shade_user, mesh[0], &it.other_look, PLAIN, NOTHING),
    F(sps_mesh, transmittance, mesh[1], 0.7, PLAIN, NOTHING),
    W(sps_mesh, revision, mesh[0], 0, PLAIN, HIDDEN),
    W(sps_mesh, revision, mesh[1], 4, PLAIN, HIDDEN),
    Z(sps_indexed_mesh, vertex_count, indexed, 5, PLAIN, REVISION),
    P(sps_indexed_mesh, positions, indexed, it.other_floats, PLAIN, REVISION),
    P(sps_indexed_mesh, normals, indexed, it.other_floats, PLAIN, REVISION),
    P(sps_indexed_mesh, albedos, indexed, it.other_floats, PLAIN, REVISION),
    Z(sps_indexed_mesh, position_stride, indexed, 8, PLAIN, REVISION),
    Z(sps_indexed_mesh, normal_stride, indexed, 16, PLAIN, REVISION),
    Z(sps_indexed_mesh, albedo_stride, indexed, 8, PLAIN, REVISION),
    Z(sps_indexed_mesh, triangle_count, indexed, 2, PLAIN, REVISION),
    P(sps_indexed_mesh, indices_u16, indexed, it.other_indices, PLAIN, REVISION),
    P(sps_indexed_mesh, uvs, indexed, it.other_floats, LONG_INDICES, REVISION),
    Z(sps_indexed_mesh, uv_stride, indexed, 4, LONG_INDICES, REVISION),
    P(sps_indexed_mesh, indices_u32, indexed, it.other_long_indices, LONG_INDICES, REVISION),
    F(sps_particle, position, particle[1], 0.25, PLAIN, NOTHING),
    F(sps_particle, radius, particle[1], 0.4, PLAIN, NOTHING),
    F(sps_particle, optical_depth, particle[1], 2, PLAIN, NOTHING),
    F(sps_particle, albedo, particle[1], 0.6, DYED, NOTHING),
    F(sps_strand_point, position, strand[1], 0.2, STRANDS, NOTHING),
    F(sps_strand_point, width, strand[1], 0.3, STRANDS, NOTHING),
    F(sps_strand_point, optical_depth, strand[1], 0.7, STRANDS, NOTHING),
    I(sps_strand_point, begins, strand[2], 1, STRANDS, NOTHING),
    Z(sps_strands, point_count, strands, 3, STRANDS, NOTHING),
    P(sps_strands, user, strands, it.other_strand, STRANDS, NOTHING),
    Z(sps_particles, count, set, 4, PLAIN, NOTHING),
    P(sps_particles, user, set, it.other_particle, PLAIN, NOTHING),
    I(sps_particles, soft, set, 0, PLAIN, NOTHING),
    I(sps_particles, is_extinction, set, 1, PLAIN, NOTHING),
    F(sps_particles, albedo, set, 0.3, PLAIN, NOTHING),
    I(sps_particles, has_albedos, set, 1, PLAIN, NOTHING),
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
    D(sps_light, direction, light[0], -0.4, PLAIN, NOTHING), /* x mirrored, then y, then z: its length is the same */
    D(sps_light, direction, light[0], 0.5, PLAIN, NOTHING),
    D(sps_light, direction, light[0], 1, PLAIN, NOTHING),
    D(sps_light, direction, light[1], -0.4, PLAIN, NOTHING),
    D(sps_light, direction, light[1], 0.5, PLAIN, NOTHING), /* likewise */
    D(sps_light, direction, light[1], 0.6, PLAIN, NOTHING),
    D(sps_light, direction, light[1], 1, PLAIN, NOTHING),
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
    I(sps_light, shadow_map_resolution, light[0], 20, TABLES, NOTHING),
    I(sps_light, shadow_map_resolution, light[1], 20, MAPPED, NOTHING),
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
    P(sps_scene, sky_user, scene, &it.other_backdrop, SKY, NOTHING),
    I(sps_scene, replace_invalid, scene, 0, INVALID, NOTHING),
    P(sps_scene, particles, scene, &it.other_set, PLAIN, NOTHING),
    P(sps_scene, strands, scene, &it.other_strands, STRANDS, NOTHING),
    I(sps_scene, strand_set_count, scene, 0, STRANDS, NOTHING),
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
    D(sps_view, slab_thickness, view, 1.1, PLAIN, NOTHING),
    I(sps_view, shadow_resolution, view, 16, PLAIN, NOTHING),
    I(sps_view, no_shadows, view, 1, PLAIN, NOTHING),
    I(sps_view, coverage_samples, view, 3, PLAIN, NOTHING),
    F(sps_view, tolerance, view, 0, SMOOTH, NOTHING),
    I(sps_view, scattering, view, SPS_SCATTERING_SINGLE, PLAIN, NOTHING),
    I(sps_view, scattering, view, SPS_SCATTERING_AMBIENT, PLAIN, NOTHING),
    I(sps_view, scattering, view, SPS_SCATTERING_FORWARD, PLAIN, NOTHING),
    I(sps_view, scattering, view, SPS_SCATTERING_MULTIPLE, PLAIN, NOTHING),
    I(sps_view, scattering, view, SPS_SCATTERING_CONVOLUTION, PLAIN, NOTHING),
    I(sps_view, scattering_resolution, view, 5, PLAIN, NOTHING),
    F(sps_view, scattering_tolerance, view, 1e6, SMOOTH, NOTHING),
    I(sps_view, sky_samples, view, 100, SKY, NOTHING),
    I(sps_view, filling, view, SPS_FILLING_SPLAT, SMOOTH, NOTHING),
    Z(sps_image, row_pixels, image, 12, PLAIN, NOTHING),
    D(sps_reference_settings, step, reference, 3, PLAIN, NOTHING),
    I(sps_reference_settings, samples, reference, 1, PATHS, NOTHING),
    W(sps_reference_settings, seed, reference, 6, PATHS, NOTHING),
    I(sps_tmap_light, width, map_light, 9, PLAIN, NOTHING),
    I(sps_tmap_light, height, map_light, 7, PLAIN, NOTHING),
    D(sps_tmap_light, camera, map_light, 0.8, PLAIN, NOTHING),
    I(sps_tmap_light, omnidirectional, map_light, 0, FACED, NOTHING),
    I(sps_tmap_light, border, map_light, 2, PLAIN, NOTHING),
    I(sps_tmap_light, quality, map_light, SPS_QUALITY_DRAFT, PLAIN, NOTHING),
    D(sps_tmap_light, slab_thickness, map_light, 0.4, PLAIN, NOTHING),
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
    {"sps_tmap_texture", "", "output"},
    {"sps_export_constants", "", "output"},
    {"sps_tmap_export_settings", "", "test_map_export changes it for finished maps"},
    {"sps_surface_point", "", "what shade_fn is given"},
    {"sps_config", "", "set once for a context"},
    {"sps_transfer", "eval_fn", "callback"},
    {"sps_volume", "read_fn", "callback"},
    {"sps_volume", "range_fn", "callback"},
    {"sps_volume", "eval_fn", "callback"},
    {"sps_volume", "appearance_fn", "callback: test_colors changes it in a context that holds"},
    {"sps_mesh", "read_fn", "callback"},
    {"sps_mesh", "shade_fn", "callback"},
    {"sps_particles", "read_fn", "callback"},
    {"sps_strands", "read_fn", "callback"},
    {"sps_projector", "sample_fn", "callback"},
    {"sps_scene", "background_fn", "callback"},
    {"sps_scene", "sky_fn", "callback"},
    {"sps_view", "budget_seconds", "budget: the setting may follow from measured times"},
    {"sps_view", "budget_scale_min", "budget: test_budget compares each size with a picture that has it"},
    {"sps_view", "budget_error", "budget: test_budget compares each setting with a picture that has it"},
    {"sps_image", "rgba", "output"},
    {"sps_image", "depth", "output"},
    {"sps_reference_settings", "error", "output"},
    {"sps_reference_settings", "lower", "output"},
    {"sps_reference_settings", "upper", "output"},
    {"sps_probe_arrays", "", "output"},
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
    CHECK(structs == 36 && fields > 200);
    for (int i = 0; i < ROWS + LEFT_OUT; ++i)
        if (!CHECK(used[i]))
            printf("    %s.%s is not in the header\n", i < ROWS ? rows[i].type : left_out[i - ROWS].type,
                   i < ROWS ? rows[i].name : left_out[i - ROWS].name);
}

/* ------------------------------------------------------------------------------------------------------ the changes */

static size_t element_size(type_of_field k) {
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

/* Ways that keep most from call to call: cells; light that spreads, and tables. */
static const int kept_ways[2] = {11, 15};

/* A second call in these ways makes neither cells nor tables. */
static void test_keeps(void) {
    for (int i = 0; i < 2; ++i) {
        sps_context *by = check_context(NULL);
        static outcome out;
        sps_stats_report stats;
        build_kept(PLAIN), set_way(&ways[kept_ways[i]], PLAIN);
        for (int n = 0; n < 2; ++n) make(by, &ways[kept_ways[i]], &out);
        sps_get_stats(by, &stats);
        CHECK(ways[kept_ways[i]].scattering == (i ? SPS_SCATTERING_CONVOLUTION : SPS_SCATTERING_MULTIPLE));
        CHECK(stats.cells == 0 && stats.tables_made == 0 && stats.tables_held == (i ? 5 : 0));
        sps_destroy(by);
    }
}

/* What a new context makes of a base before any change; `kept`: of one of which much is kept. */
static const outcome *made_before(base b, int kept, int n) {
    static outcome *made[2][BASES][WAYS];
    outcome **own = &made[kept][b][n];
    kept ? build_kept(b) : build_base(b);
    set_way(&ways[n], b);
    if (!*own) {
        *own = (outcome *)malloc(sizeof(outcome));
        if (!*own) abort();
        make_fresh(&ways[n], *own);
        if (!CHECK((*own)->result == SPS_OK)) printf("    base %d, way %d\n", (int)b, n);
    }
    return *own;
}

static void complain(const row *r, size_t element, int n, const char *what) {
    printf("    %s.%s, element %d, row %d, way %d: %s\n", r->type, r->name, (int)element, (int)(r - rows), n, what);
}

/* A context that holds, and what it has made last. Where much is kept, each way has one of its own, so that what was
   before need not be made anew for every element; all other ways take turns in one. */
typedef struct holder {
    sps_context *context;
    const outcome *last;
} holder;

static holder held[1 + WAYS];

/* Whether the change of an element shows in way number n. The held context makes what was before, what is after, and
   what was before again; all three are what a new context makes. Two changes at once would not do: that of one field
   may hide that another's was missed. */
static int shows(const row *r, int kept, size_t element, int n) {
    static outcome out, fresh;
    holder *by = &held[kept ? 1 + n : 0];
    const outcome *before = made_before(r->scene, kept, n);
    int wrong = 0, shown;
    if (!by->context) by->context = check_context(NULL);
    if (by->last != before) make(by->context, &ways[n], &out), wrong = !same_outcome(&out, before);
    change(r, element);
    make(by->context, &ways[n], &out);
    make_fresh(&ways[n], &fresh);
    shown = !same_outcome(&fresh, before);
    if (!same_outcome(&out, &fresh)) wrong |= 2;
    made_before(r->scene, kept, n);
    make(by->context, &ways[n], &out);
    if (!same_outcome(&out, before)) wrong |= 4;
    by->last = before;
    if (!CHECK_CASE("Engineering", "each field of each struct changed alone in a context that held what was before",
                    "the bits of a new context", wrong, 0, "same bits"))
        complain(r, element, n, wrong & 2 ? "changed" : wrong & 4 ? "changed back" : "before");
    return shown;
}

static int is_of_light(const row *r) { return strcmp(r->type, "sps_light") == 0; }

/* Changes an element where much is kept: a light's where cells are, others in one of two ways; in the long test in all
   that keep scattered light. Returns whether the change shows. */
static int check_kept(const row *r, size_t element) {
    const int own = kept_ways[is_of_light(r) ? 0 : (r - rows) % 2];
    int shown = 0;
    for (int n = 0; n < WAYS; ++n)
        if (check_long() ? ways[n].scattering >= SPS_SCATTERING_CONVOLUTION : n == own)
            shown |= shows(r, 1, element, n);
    return shown;
}

/* The order in which ways are tried: after the first, those that differ most from it. */
static const int order[] = {0, 1, 2, 11, 6, 3, 4, 5, 7, 8, 9, 10, 12, 13, 14, 15, 16, 17, 18, 19};

/* Tries the first way for each element, or, for some and for lights, one in which much is kept, and another one in turn
   for one element of every sixth row; in the long test, all ways. If the change shows in none of these, the others are
   tried until it does. */
static void check_element(const row *r, size_t element) {
    const int turn = 1 + (int)(r - rows) / 6 % (WAYS - 1), count = (int)(r->size / element_size(r->kind));
    const int takes_turn = (r - rows) % 6 == 0 && (int)element == (int)(r - rows) / (count > 3 ? 1 : 6) % count;
    const int turned = ((size_t)(r - rows) / 2 + element) % 5 == 0;
    const int keeps = check_long() || (r->scene == PLAIN && (turned || is_of_light(r)));
    char seen[WAYS + 1] = "";
    int shown = keeps && check_kept(r, element);
    CHECK(sizeof order / sizeof *order == WAYS);
    for (int n = 0; n < WAYS; ++n) seen[n] = '.';
    for (int due = 1; due >= 0; --due)
        for (int i = 0; i < WAYS; ++i) {
            const int n = order[i];
            if (due ? (n > 0 || keeps) && !(takes_turn && n == turn) && !check_long()
                    : shown || r->also == HIDDEN || seen[n] != '.')
                continue;
            seen[n] = shows(r, 0, element, n) ? 'x' : '-';
            shown |= seen[n] == 'x';
        }
    if (figures()) printf("%-20s %-16s %2d  %s\n", r->type + 4, r->name, (int)element, seen);
    if (!CHECK(shown == (r->also != HIDDEN))) complain(r, element, 0, shown ? "shows" : "shows nowhere");
}

/* The quick test takes every third element of arrays, but for the vectors of lights. */
static void test_fields(void) {
    for (int i = 0; i < ROWS; ++i) {
        const size_t count = rows[i].size / element_size(rows[i].kind);
        for (size_t element = 0; element < count; ++element)
            if (check_long() || count < (is_of_light(&rows[i]) ? 4 : 3) || element % 3 == (size_t)i % 3)
                check_element(&rows[i], element);
    }
    for (int i = 0; i <= WAYS; ++i) sps_destroy(held[i].context);
}

int main(void) {
    RUN(test_list);
    RUN(test_keeps);
    RUN(test_fields);
    return check_report();
}
