/* map_texture.h: transmittance maps as files: aims the view of a light at a box, and writes what sps_tmap_export makes
   as DDS, OpenEXR or PNG, and the constants of its shader as JSON (RFC 8259). It reads nothing. */

#ifndef EX_MAP_TEXTURE_H
#define EX_MAP_TEXTURE_H

#include "six_way.h"
#include "volume.h"

/* -------------------------------------------------------------------------------------------------------- the view */

/* What maps are to hold, and where they are seen from. */
typedef struct ex_map_aim {
    double lo[3], hi[3]; /* a box around the scene */
    double up[3];
    int texels;   /* along each side of a map, without its border */
    int tiles[2]; /* columns and rows of maps beside each other, of a sun */
    double size;  /* of all tiles together: height in the world; of a point light: angle; 0: as the box needs */
    double slack; /* part of the depth range that stays empty at both ends */
} ex_map_aim;

static inline ex_vec ex_map_middle(const ex_map_aim *aim) {
    const double *lo = aim->lo, *hi = aim->hi;
    return ex_vec_of(0.5 * (lo[0] + hi[0]), 0.5 * (lo[1] + hi[1]), 0.5 * (lo[2] + hi[2]));
}

static inline void ex_map_set(ex_vec from, double to[3]) { to[0] = from.x, to[1] = from.y, to[2] = from.z; }

/* The axes of a view along `forward`, which is opposite to their front. */
static inline ex_card_axes ex_map_axes(ex_vec forward, const double up[3]) {
    sps_camera camera;
    memset(&camera, 0, sizeof camera);
    ex_map_set(forward, camera.target);
    memcpy(camera.up, up, sizeof camera.up);
    return ex_card_axes_of(&camera);
}

/* Half of the box's extent along an axis. */
static inline double ex_map_half(const ex_map_aim *aim, ex_vec axis) {
    const double *lo = aim->lo, *hi = aim->hi;
    return 0.5 * (fabs(axis.x) * (hi[0] - lo[0]) + fabs(axis.y) * (hi[1] - lo[1]) + fabs(axis.z) * (hi[2] - lo[2]));
}

/* Texels that the box may cover: one stays empty at each edge, so that what lies beyond the map finds nothing. */
static inline double ex_map_inner(double texels) { return fmax(texels - 2, 1); }

/* One of the tiles that a sun sees side by side, counted from the top left. The view begins where the box does. */
static inline void ex_map_aim_sun(const ex_map_aim *aim, const double direction[3], const int tile[2],
                                  sps_tmap_light *light, double range[2]) {
    const ex_vec forward = ex_vec_unit(ex_vec_of(direction[0], direction[1], direction[2]));
    const ex_card_axes axes = ex_map_axes(forward, aim->up);
    const double deep = ex_map_half(aim, forward);
    const double columns = aim->tiles[0], rows = aim->tiles[1], texels = aim->texels;
    double texel = fmax(2 * ex_map_half(aim, axes.right) / ex_map_inner(columns * texels),
                        2 * ex_map_half(aim, axes.up) / ex_map_inner(rows * texels));
    if (aim->size > 0) texel = aim->size / (rows * texels);
    if (!(texel > 0)) texel = 1 / texels;
    const double side = texel * texels, across = (tile[0] - 0.5 * (columns - 1)) * side;
    const double upwards = (0.5 * (rows - 1) - tile[1]) * side;
    const double back = deep > 0 ? deep * (1 + 2 * aim->slack) : side;
    const ex_vec aside = ex_vec_add(ex_vec_scale(axes.right, across), ex_vec_scale(axes.up, upwards));
    const ex_vec from = ex_vec_add(ex_map_middle(aim), ex_vec_sub(aside, ex_vec_scale(forward, back)));
    ex_map_set(from, light->camera.position);
    ex_map_set(ex_vec_add(from, ex_vec_scale(forward, 2 * back)), light->camera.target);
    ex_map_set(axes.up, light->camera.up);
    light->camera.ortho_height = side;
    light->width = light->height = aim->texels;
    range[0] = 0, range[1] = 2 * back;
}

/* A range of depths from the nearest and the farthest point of the scene. */
static inline int ex_map_range(const ex_map_aim *aim, double nearest, double farthest, double range[2],
                               ex_error *error) {
    const double pad = farthest > nearest ? aim->slack * (farthest - nearest) : 1e-3 * fabs(farthest);
    range[0] = fmax(nearest - pad, 0), range[1] = farthest + pad;
    return farthest > 0 ? 0 : ex_fail(error, "all of the scene lies behind the map's view");
}

/* The range of depths that a view has, and the tangents of what it would have to see; infinite if some lies behind. */
static inline int ex_map_measure(const ex_map_aim *aim, const sps_camera *camera, double range[2], double *tangent,
                                 ex_error *error) {
    const ex_card_axes axes = ex_card_axes_of(camera);
    double nearest = HUGE_VAL, farthest = -HUGE_VAL;
    *tangent = 0;
    for (int corner = 0; corner < 8; ++corner) {
        double d[3];
        for (int a = 0; a < 3; ++a) d[a] = (corner >> a & 1 ? aim->hi[a] : aim->lo[a]) - camera->position[a];
        const ex_vec from = ex_vec_of(d[0], d[1], d[2]);
        const double depth = -ex_vec_dot(from, axes.front);
        const double across = fmax(fabs(ex_vec_dot(from, axes.right)), fabs(ex_vec_dot(from, axes.up)));
        nearest = fmin(nearest, depth), farthest = fmax(farthest, depth);
        *tangent = depth > 0 ? fmax(*tangent, across / depth) : HUGE_VAL;
    }
    return ex_map_range(aim, nearest, farthest, range, error);
}

/* The view of a point light, along an axis or, if that is 0, towards the middle of the box. */
static inline int ex_map_aim_point(const ex_map_aim *aim, const double position[3], const double axis[3],
                                   sps_tmap_light *light, double range[2], ex_error *error) {
    const ex_vec from = ex_vec_of(position[0], position[1], position[2]), along = ex_vec_of(axis[0], axis[1], axis[2]);
    const ex_vec towards = ex_vec_length(along) > 0 ? along : ex_vec_sub(ex_map_middle(aim), from);
    const double length = fmax(ex_vec_length(ex_vec_sub(ex_map_middle(aim), from)), 1);
    static const char *const amid = "the light lies amid the scene, or nearly: give --layout cube, or --fov";
    double tangent;
    if (!(ex_vec_length(towards) > 0)) return ex_fail(error, "%s", amid);
    ex_map_set(from, light->camera.position);
    ex_map_set(ex_vec_add(from, ex_vec_scale(ex_vec_unit(towards), length)), light->camera.target);
    memcpy(light->camera.up, aim->up, sizeof light->camera.up);
    if (ex_map_measure(aim, &light->camera, range, &tangent, error)) return 1;
    const double angle = 2 * atan(fmax(tangent, 1e-6) * aim->texels / ex_map_inner(aim->texels));
    if (!(aim->size > 0) && !(angle < 3.09)) return ex_fail(error, "%s", amid);
    light->camera.field_of_view = aim->size > 0 ? aim->size : angle;
    light->width = light->height = aim->texels;
    return 0;
}

/* Six faces around a point light. Their depths are along the nearest axis. */
static inline int ex_map_aim_around(const ex_map_aim *aim, const double position[3], sps_tmap_light *light,
                                    double range[2], ex_error *error) {
    double nearest = 0, farthest = 0;
    for (int a = 0; a < 3; ++a) {
        const double before = aim->lo[a] - position[a], behind = position[a] - aim->hi[a];
        nearest = fmax(nearest, fmax(before, behind));
        farthest = fmax(farthest, fmax(fabs(before), fabs(behind)));
    }
    memcpy(light->camera.position, position, sizeof light->camera.position);
    light->omnidirectional = 1;
    light->width = light->height = aim->texels;
    return ex_map_range(aim, nearest, farthest, range, error);
}

/* ------------------------------------------------------------------------------------------------------ the texture */

/* An exported map. */
typedef struct ex_map_texture {
    sps_tmap_export_settings settings;
    sps_tmap_texture about;
    void *texels;
} ex_map_texture;

static inline sps_result ex_map_export(sps_tmap *map, ex_map_texture *out) {
    out->texels = NULL;
    const sps_result result = sps_tmap_export(map, &out->settings, NULL, 0, &out->about);
    if (result != SPS_OK) return result;
    out->texels = ex_allocate(out->about.bytes, 1);
    return sps_tmap_export(map, &out->settings, out->texels, out->about.bytes, &out->about);
}

static inline int ex_map_write_dds(const char *path, const ex_map_texture *texture, ex_error *error) {
    static const ex_dds_format formats[4][2] = {{EX_DDS_R32F, EX_DDS_RGBA32F},
                                                {EX_DDS_R16F, EX_DDS_RGBA16F},
                                                {EX_DDS_R16, EX_DDS_RGBA16},
                                                {EX_DDS_R8, EX_DDS_RGBA8}};
    const sps_tmap_texture *about = &texture->about;
    const int is_deep = texture->settings.layout == SPS_EXPORT_SLICES;
    ex_dds file;
    memset(&file, 0, sizeof file);
    file.texels = texture->texels, file.width = about->width, file.height = about->height;
    file.layers = is_deep ? 0 : about->layers, file.depth = is_deep ? about->layers : 0;
    file.is_cube = texture->settings.layout == SPS_EXPORT_CUBE;
    file.format = formats[texture->settings.format][about->channels == 4];
    file.alpha = EX_DDS_ALPHA_CUSTOM;
    return ex_write_dds(path, &file, error);
}

/* One layer of four channels of floats or halves. */
static inline int ex_map_write_exr(const char *path, const ex_map_texture *texture, int zip, ex_error *error) {
    const size_t count = 4 * (size_t)texture->about.width * (size_t)texture->about.height;
    const int is_float = texture->settings.format == SPS_EXPORT_FLOAT;
    float *numbers = (float *)ex_allocate(count, sizeof *numbers);
    for (size_t i = 0; i < count; ++i)
        numbers[i] =
            is_float ? ((const float *)texture->texels)[i] : ex_half_value(((const uint16_t *)texture->texels)[i]);
    ex_exr file;
    memset(&file, 0, sizeof file);
    file.rgba = numbers, file.width = texture->about.width, file.height = texture->about.height;
    file.is_float = is_float, file.zip = zip;
    const int failed = ex_write_exr(path, &file, error);
    free(numbers);
    return failed;
}

/* One layer of four channels of 8 bits. */
static inline int ex_map_write_png(const char *path, const ex_map_texture *texture, ex_error *error) {
    return ex_write_png_codes(path, (const unsigned char *)texture->texels, texture->about.width, texture->about.height,
                              4, error);
}

/* ---------------------------------------------------------------------------------------------------- the constants */

static inline void ex_json_floats(FILE *file, const char *name, const float *values, int count) {
    fprintf(file, "\"%s\": [", name);
    for (int i = 0; i < count; ++i) fprintf(file, "%s%.9g", i ? ", " : "", (double)values[i]);
    fputs("]", file);
}

static inline void ex_json_face(FILE *file, const sps_tmap_constants *face) {
    const float *const rows[4] = {face->row_x, face->row_y, face->row_w, face->row_distance};
    static const char *const names[4] = {"row_x", "row_y", "row_w", "row_distance"};
    for (int i = 0; i < 4; ++i) {
        fputs(i ? ",\n      " : "\n    {", file);
        ex_json_floats(file, names[i], rows[i], 4);
    }
    fprintf(file, ",\n      \"technique\": %d, \"components\": %d, \"has_range\": %d, \"has_planes\": %d,",
            (int)face->technique, (int)face->components, (int)face->has_range, (int)face->has_planes);
    fprintf(file, "\n      \"cubic\": %d, \"has_surfaces\": %d, \"width\": %d, \"height\": %d,", (int)face->cubic,
            (int)face->has_surfaces, (int)face->width, (int)face->height);
    fprintf(file, "\n      \"near_depth\": %.9g, \"far_depth\": %.9g,", (double)face->near_depth,
            (double)face->far_depth);
    fprintf(file, "\n      \"bias\": %.9g, \"bias_per_distance\": %.9g,", (double)face->bias,
            (double)face->bias_per_distance);
    fprintf(file, "\n      \"face\": %d, \"face_count\": %d, \"has_fronts\": %d, \"border\": %d}", (int)face->face,
            (int)face->face_count, (int)face->has_fronts, (int)face->border);
}

/* What a shader needs: the members of sps_tmap_constants for each face, and of sps_export_constants, by their names;
   and what the texture is. Nine digits tell all floats apart. */
static inline int ex_map_write_constants(const char *path, const sps_tmap *map, const ex_map_texture *texture,
                                         ex_error *error) {
    static const char *const formats[] = {"float", "half", "unorm16", "unorm8"};
    static const char *const layouts[] = {"array", "slices", "atlas", "cube"};
    static const char *const contents[] = {"gas", "surfaces", "beer"};
    const sps_tmap_export_settings *made = &texture->settings;
    const sps_tmap_texture *about = &texture->about;
    const sps_export_constants *numbers = &about->constants;
    sps_tmap_constants face;
    ex_output output;
    if (ex_output_begin(&output, path, error)) return 1;
    errno = 0;
    FILE *file = output.file;
    fprintf(file, "{\n  \"content\": \"%s\", \"format\": \"%s\", \"layout\": \"%s\",", contents[made->content],
            formats[made->format], layouts[made->layout]);
    fprintf(file, "\n  \"width\": %d, \"height\": %d, \"layers\": %d, \"channels\": %d, \"clamped\": %.0f,",
            about->width, about->height, about->layers, about->channels, (double)about->clamped);
    fprintf(file, "\n  \"distance_unit\": %.17g, \"extinction_unit\": %.17g,\n  \"faces\": [",
            made->distance_unit > 0 ? made->distance_unit : 1, made->extinction_unit > 0 ? made->extinction_unit : 1);
    for (int i = 0; sps_tmap_get_constants(map, i, &face) == SPS_OK; ++i) {
        if (i) fputs(",", file);
        ex_json_face(file, &face);
    }
    fprintf(file, "],\n  \"export\": {\"components\": %d, \"columns\": %d, \"moment_bias\": %.9g,\n    ",
            (int)numbers->components, (int)numbers->columns, (double)numbers->moment_bias);
    ex_json_floats(file, "scale", numbers->scale, numbers->components);
    fputs(",\n    ", file);
    ex_json_floats(file, "offset", numbers->offset, numbers->components);
    fputs("}\n}\n", file);
    ex_output_note(&output, ferror(file));
    return ex_output_end(&output, error);
}

#endif /* EX_MAP_TEXTURE_H */
