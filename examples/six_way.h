/* six_way.h: bakes gas into the textures of a card that engines light from six sides, frame by frame. A map holds the
   radiance that reaches the eye per irradiance of a light on one side; sides are the camera's. What the layouts come
   from:
   - Unity: manual of the package Visual Effect Graph 17.2, "Realistic smoke lighting with six-way lighting". Its shader
     weighs by squares; its back is along tangent x bitangent, away from the normal.
   - O3DE: "Custom Lighting Tutorial with Flipbook Animation", docs.o3de.org, and its code in o3de/sample-code-gems:
     packings TLRB and RLT. A draft of 2022 had LRT in the place of RLT. It weighs by squares too. Opacity is the alpha
     channel of a texture of its own ("Packed"), or, in the draft, its red ("Split"): that texture has both.
   - Godot: "Six-Way Volumetric Lighting" 2.2, and Blazium's module sixway_mtl, which has the same shader. Its ReadMe
     says that back is +z. In the code, +z of the view selects front: back is lit from behind here as well. The code
     reads the bottom from the first texture's alpha, so that both have it; and it decodes colors by the sRGB curve. */

#ifndef EX_SIX_WAY_H
#define EX_SIX_WAY_H

#include "dds.h"
#include "picture.h"
#include "vectors.h"

/* The side that the light is on, what else there is to store, and constants. */
typedef enum ex_side {
    EX_RIGHT,
    EX_TOP,
    EX_BACK,
    EX_LEFT,
    EX_BOTTOM,
    EX_FRONT,
    EX_ALPHA,
    EX_GLOW,
    EX_SIDES,
    EX_ZERO = EX_SIDES,
    EX_ONE
} ex_side;

enum { EX_CARD_TEXTURES = 3 }; /* the most that a layout has */

/* Four channels each of up to three textures. */
typedef struct ex_card_layout {
    ex_side channels[EX_CARD_TEXTURES][4];
    int count;    /* of textures */
    int has_srgb; /* 1: the engine decodes 8-bit red, green and blue by the sRGB curve */
} ex_card_layout;

/* In the order of layout_names in render_options.h. */
static inline ex_card_layout ex_card_layout_of(int number) {
    static const ex_card_layout layouts[] = {
        {{{EX_RIGHT, EX_TOP, EX_BACK, EX_ALPHA}, {EX_LEFT, EX_BOTTOM, EX_FRONT, EX_GLOW}}, 2, 0},
        {{{EX_TOP, EX_LEFT, EX_RIGHT, EX_BOTTOM},
          {EX_FRONT, EX_BACK, EX_ZERO, EX_ONE},
          {EX_ALPHA, EX_ALPHA, EX_ALPHA, EX_ALPHA}},
         3,
         0},
        {{{EX_RIGHT, EX_LEFT, EX_TOP, EX_ONE},
          {EX_BOTTOM, EX_BACK, EX_FRONT, EX_ONE},
          {EX_ALPHA, EX_ALPHA, EX_ALPHA, EX_ALPHA}},
         3,
         0},
        {{{EX_LEFT, EX_RIGHT, EX_TOP, EX_ONE},
          {EX_FRONT, EX_BACK, EX_BOTTOM, EX_ONE},
          {EX_ALPHA, EX_ALPHA, EX_ALPHA, EX_ALPHA}},
         3,
         0},
        {{{EX_RIGHT, EX_TOP, EX_BACK, EX_BOTTOM},
          {EX_LEFT, EX_BOTTOM, EX_FRONT, EX_ONE},
          {EX_ALPHA, EX_GLOW, EX_ONE, EX_ONE}}, /* the third one is ambient occlusion: the six maps have it already */
         3,
         1}};
    return layouts[number];
}

/* ------------------------------------------------------------------------------------------------ names of frames */

/* Puts a number in the place of %d or %0Nd, which may stand once in a name; N is 1 to 9. Nothing else may begin with %.
   Sets `has_number`. The caller frees the name. Returns NULL where the name is wrong. */
static inline char *ex_frame_name(const char *name, int number, int *has_number) {
    const char *mark = strchr(name, '%');
    int digits = 0;
    *has_number = mark != NULL;
    const size_t size = strlen(name) + 16;
    char *out = (char *)ex_allocate(size, 1);
    if (!mark) return strcpy(out, name);
    const char *after = mark + 1;
    if (after[0] == '0' && after[1] >= '1' && after[1] <= '9') digits = after[1] - '0', after += 2;
    if (*after != 'd' || strchr(after, '%')) {
        free(out);
        return NULL;
    }
    snprintf(out, size, "%.*s%0*d%s", (int)(mark - name), name, digits, number, after + 1);
    return out;
}

/* -------------------------------------------------------------------------------------------------------- the card */

/* Frames in rows from the top left. Each map has a number per pixel of all frames. Maps of light have premultiplied
   radiance. */
typedef struct ex_card {
    int tile, columns, rows; /* pixels along a frame's sides; frames */
    float *maps[EX_SIDES];
} ex_card;

static inline size_t ex_card_pixels(const ex_card *card) {
    return (size_t)card->tile * (size_t)card->columns * (size_t)card->tile * (size_t)card->rows;
}

static inline void ex_card_begin(ex_card *card, int tile, int columns, int rows) {
    card->tile = tile, card->columns = columns, card->rows = rows;
    for (int i = 0; i < EX_SIDES; ++i) card->maps[i] = (float *)ex_allocate(ex_card_pixels(card), sizeof(float));
}

static inline void ex_card_free(ex_card *card) {
    for (int i = 0; i < EX_SIDES; ++i) free(card->maps[i]);
    memset(card, 0, sizeof *card);
}

/* Copies a channel of a rendered frame into its place in a map. */
static inline void ex_card_place(ex_card *card, int frame, ex_side map, const float *rgba, int channel) {
    const size_t tile = (size_t)card->tile, width = tile * (size_t)card->columns;
    const size_t column = (size_t)(frame % card->columns), row = (size_t)(frame / card->columns);
    float *out = card->maps[map] + (row * width + column) * tile;
    for (size_t y = 0; y < tile; ++y)
        for (size_t x = 0; x < tile; ++x) out[y * width + x] = rgba[4 * (y * tile + x) + (size_t)channel];
}

/* ------------------------------------------------------------------------------------------------------ the camera */

/* The card's axes in the world: to the right, upwards, and towards the eye. */
typedef struct ex_card_axes {
    ex_vec right, up, front;
} ex_card_axes;

static inline ex_card_axes ex_card_axes_of(const sps_camera *camera) {
    const double *eye = camera->position, *at = camera->target, *up = camera->up;
    ex_card_axes axes;
    axes.front = ex_vec_unit(ex_vec_of(eye[0] - at[0], eye[1] - at[1], eye[2] - at[2]));
    axes.right = ex_vec_cross(ex_vec_unit(ex_vec_of(up[0], up[1], up[2])), axes.front);
    axes.right = ex_vec_length(axes.right) > 1e-9 ? ex_vec_unit(axes.right) : ex_vec_perpendicular(axes.front);
    axes.up = ex_vec_cross(axes.front, axes.right);
    return axes;
}

/* Makes an orthographic camera see a box as large as a square picture can show it, unless `ortho_height` is above 0.
   Without a place, the camera looks at the middle of the box along -z. */
static inline void ex_card_fit(const double lo[3], const double hi[3], int has_place, sps_camera *camera) {
    double middle[3], reach = 0;
    for (int a = 0; a < 3; ++a) middle[a] = 0.5 * (lo[a] + hi[a]), reach += hi[a] - lo[a];
    if (!has_place) {
        memcpy(camera->target, middle, sizeof middle);
        memcpy(camera->position, middle, sizeof middle);
        camera->position[2] += reach > 0 ? reach : 1; /* in front of all of it: no farther corner than that */
    }
    const ex_card_axes axes = ex_card_axes_of(camera);
    const ex_vec up = axes.up;
    camera->up[0] = up.x, camera->up[1] = up.y, camera->up[2] = up.z;
    if (camera->ortho_height > 0) return;
    for (int corner = 0; corner < 8; ++corner) {
        double d[3];
        for (int a = 0; a < 3; ++a) d[a] = (corner >> a & 1 ? hi[a] : lo[a]) - camera->target[a];
        const ex_vec from = ex_vec_of(d[0], d[1], d[2]);
        const double across = fmax(fabs(ex_vec_dot(from, axes.right)), fabs(ex_vec_dot(from, axes.up)));
        camera->ortho_height = fmax(camera->ortho_height, 2 * across);
    }
    if (!(camera->ortho_height > 0)) camera->ortho_height = 1;
}

/* ------------------------------------------------------------------------------------------------------ rendering */

static inline int ex_is_grey(const float color[3]) { return color[0] == color[1] && color[1] == color[2]; }

static inline int ex_transfer_is_grey(const sps_transfer *transfer) {
    for (int i = 0; i < transfer->point_count; ++i)
        if (!ex_is_grey(transfer->points[i].albedo)) return 0;
    return 1;
}

/* Whether all of a scene scatters, reflects and passes red, green and blue alike. */
static inline int ex_scene_is_grey(const sps_scene *scene) {
    int grey = 1;
    for (int i = 0; i < scene->volume_count; ++i) {
        const sps_volume *volume = &scene->volumes[i];
        grey = grey && !volume->appearance_fn && (volume->transfer || ex_is_grey(volume->albedo));
        grey = grey && (!volume->transfer || ex_transfer_is_grey(volume->transfer));
    }
    for (int i = 0; i < scene->particle_set_count; ++i)
        grey = grey && !scene->particles[i].has_albedos && ex_is_grey(scene->particles[i].albedo);
    for (int i = 0; i < scene->mesh_count; ++i) {
        const sps_mesh *mesh = &scene->meshes[i];
        grey = grey && !mesh->has_albedos && !mesh->shade_fn;
        grey = grey && ex_is_grey(mesh->albedo) && ex_is_grey(mesh->transmittance);
    }
    return grey;
}

/* What a frame is made of. The scene's own lights are left out. */
typedef struct ex_card_job {
    sps_context *context;
    const sps_scene *scene;
    const sps_view *view;   /* orthographic, of tile x tile pixels */
    const sps_light *light; /* how the six lights cast shadows */
} ex_card_job;

/* A light of irradiance 1 on a side, of one color or of all. */
static inline sps_light ex_card_light(const ex_card_job *job, ex_side side, int red, int green, int blue) {
    const ex_card_axes axes = ex_card_axes_of(&job->view->camera);
    const ex_vec towards[3] = {axes.right, axes.up, ex_vec_scale(axes.front, -1)};
    const ex_vec way = ex_vec_scale(towards[side % 3], side < EX_LEFT ? -1 : 1);
    sps_light light = *job->light;
    light.kind = SPS_LIGHT_DIRECTIONAL;
    light.direction[0] = way.x, light.direction[1] = way.y, light.direction[2] = way.z;
    light.color[0] = (float)red, light.color[1] = (float)green, light.color[2] = (float)blue;
    return light;
}

static inline sps_result ex_card_render(const ex_card_job *job, const sps_light *lights, int count, float *rgba) {
    sps_scene scene = *job->scene;
    sps_image image;
    memset(&image, 0, sizeof image);
    scene.lights = lights, scene.light_count = count;
    image.rgba = rgba;
    return sps_render(job->context, &scene, job->view, &image);
}

/* Replaces the color of each pixel by its luminance (Rec. 709). */
static inline void ex_card_luminance(float *rgba, size_t pixels) {
    for (size_t i = 0; i < pixels; ++i) {
        const double red = (double)rgba[4 * i], green = (double)rgba[4 * i + 1], blue = (double)rgba[4 * i + 2];
        rgba[4 * i] = (float)(0.2126 * red + 0.7152 * green + 0.0722 * blue);
    }
}

/* Bakes one frame of the six maps and of alpha. Grey gas takes two renders: a light of each color on three sides. Gas
   of colors takes six in white light, whose luminance is stored: it is exact however often light scatters. A gas of
   the luminance's albedo would be darker, since light of the strongest color survives more scattering than the mean. */
static inline sps_result ex_card_bake(const ex_card_job *job, ex_card *card, int frame) {
    const size_t pixels = (size_t)card->tile * (size_t)card->tile;
    const int is_grey = ex_scene_is_grey(job->scene), together = is_grey ? 3 : 1;
    float *rgba = (float *)ex_allocate(pixels, 4 * sizeof *rgba);
    sps_result result = SPS_OK;
    for (int first = 0; first < 6 && result == SPS_OK; first += together) {
        sps_light lights[3];
        for (int i = 0; i < together; ++i)
            lights[i] =
                ex_card_light(job, (ex_side)(first + i), !is_grey || i == 0, !is_grey || i == 1, !is_grey || i == 2);
        result = ex_card_render(job, lights, together, rgba);
        if (result != SPS_OK) break;
        if (!is_grey) ex_card_luminance(rgba, pixels);
        for (int i = 0; i < together; ++i) ex_card_place(card, frame, (ex_side)(first + i), rgba, i);
        if (first == 0) ex_card_place(card, frame, EX_ALPHA, rgba, 3);
    }
    free(rgba);
    return result;
}

/* Bakes one frame of the luminance of what glows, in no light. */
static inline sps_result ex_card_bake_glow(const ex_card_job *job, ex_card *card, int frame) {
    const size_t pixels = (size_t)card->tile * (size_t)card->tile;
    float *rgba = (float *)ex_allocate(pixels, 4 * sizeof *rgba);
    const sps_result result = ex_card_render(job, NULL, 0, rgba);
    if (result == SPS_OK) {
        ex_card_luminance(rgba, pixels);
        ex_card_place(card, frame, EX_GLOW, rgba, 0);
    }
    free(rgba);
    return result;
}

/* -------------------------------------------------------------------------------------------------------- textures */

/* How numbers become texels. */
typedef struct ex_card_texture {
    ex_card_layout layout;
    int number;      /* which of the layout's textures */
    float scale;     /* of radiance */
    int is_straight; /* 1: radiance is divided by alpha */
} ex_card_texture;

/* A map's mean over the neighbours in the frame that have alpha; 0 where none has. Filters mix such pixels with the
   neighbours, which would otherwise get a dark rim. */
static inline float ex_card_beside(const ex_card *card, ex_side side, size_t pixel) {
    const int width = card->tile * card->columns, x = (int)(pixel % (size_t)width), y = (int)(pixel / (size_t)width);
    const int left = x / card->tile * card->tile, top = y / card->tile * card->tile;
    float sum = 0;
    int count = 0;
    for (int v = y - 1; v <= y + 1; ++v)
        for (int u = x - 1; u <= x + 1; ++u) {
            if (u < left || u >= left + card->tile || v < top || v >= top + card->tile) continue;
            const size_t at = (size_t)v * (size_t)width + (size_t)u;
            const float alpha = card->maps[EX_ALPHA][at];
            if (alpha > 0.0f) sum += card->maps[side][at] / alpha, ++count;
        }
    return count > 0 ? sum / (float)count : 0.0f;
}

static inline float ex_card_number(const ex_card *card, const ex_card_texture *texture, ex_side side, size_t pixel) {
    if (side >= EX_SIDES) return side == EX_ONE ? 1.0f : 0.0f;
    const float value = card->maps[side][pixel], alpha = card->maps[EX_ALPHA][pixel];
    if (side == EX_ALPHA) return value;
    if (!texture->is_straight) return texture->scale * value;
    return texture->scale * (alpha > 0.0f ? value / alpha : ex_card_beside(card, side, pixel));
}

/* The four numbers of each pixel. The caller frees them. */
static inline float *ex_card_texels(const ex_card *card, const ex_card_texture *texture) {
    const size_t pixels = ex_card_pixels(card);
    float *out = (float *)ex_allocate(pixels, 4 * sizeof *out);
    for (size_t i = 0; i < 4 * pixels; ++i)
        out[i] = ex_card_number(card, texture, texture->layout.channels[texture->number][i % 4], i / 4);
    return out;
}

/* Eight bits of each number; alpha has no curve. */
static inline unsigned char *ex_card_codes(const float *texels, size_t pixels, int has_srgb) {
    unsigned char *codes = (unsigned char *)ex_allocate(pixels, 4);
    ex_dds_encode(EX_DDS_RGBA8, texels, 4 * pixels, codes);
    for (size_t i = 0; i < 4 * pixels && has_srgb; ++i)
        if (i % 4 != 3) codes[i] = ex_srgb_code(texels[i]);
    return codes;
}

/* What texels are made of: the order of texel_names in render_options.h. */
typedef enum ex_card_texel { EX_CARD_UNORM8, EX_CARD_HALF, EX_CARD_FLOAT } ex_card_texel;

static inline int ex_card_write_dds(const char *path, const ex_card *card, const ex_card_texture *texture,
                                    ex_card_texel texel, const float *texels, ex_error *error) {
    static const ex_dds_format formats[] = {EX_DDS_RGBA8, EX_DDS_RGBA16F, EX_DDS_RGBA32F};
    const size_t pixels = ex_card_pixels(card);
    const int has_alpha = texture->layout.channels[texture->number][3] == EX_ALPHA;
    ex_dds file;
    memset(&file, 0, sizeof file);
    file.width = card->tile * card->columns, file.height = card->tile * card->rows;
    file.format = formats[texel];
    file.alpha = !has_alpha             ? EX_DDS_ALPHA_CUSTOM
                 : texture->is_straight ? EX_DDS_ALPHA_STRAIGHT
                                        : EX_DDS_ALPHA_PREMULTIPLIED;
    if (texel == EX_CARD_UNORM8 && texture->layout.has_srgb) file.format = EX_DDS_SRGB;
    void *bytes = texel == EX_CARD_UNORM8 ? (void *)ex_card_codes(texels, pixels, texture->layout.has_srgb)
                                          : ex_allocate(pixels, 4 * sizeof *texels);
    if (texel != EX_CARD_UNORM8) ex_dds_encode(file.format, texels, 4 * pixels, bytes);
    file.texels = bytes;
    const int failed = ex_write_dds(path, &file, error);
    free(bytes);
    return failed;
}

static inline int ex_card_write_exr(const char *path, const ex_card *card, int is_float, int zip, const float *texels,
                                    ex_error *error) {
    ex_exr file;
    memset(&file, 0, sizeof file);
    file.rgba = texels;
    file.width = card->tile * card->columns, file.height = card->tile * card->rows;
    file.is_float = is_float, file.zip = zip;
    return ex_write_exr(path, &file, error);
}

static inline int ex_card_write_png(const char *path, const ex_card *card, int has_srgb, const float *texels,
                                    ex_error *error) {
    unsigned char *codes = ex_card_codes(texels, ex_card_pixels(card), has_srgb);
    const int width = card->tile * card->columns, height = card->tile * card->rows;
    const int failed = ex_write_png_codes(path, codes, width, height, 4, error);
    free(codes);
    return failed;
}

#endif /* EX_SIX_WAY_H */
