/* sky.h: a picture of the whole sky as a light and as the background. It is equirectangular, with up at its top: a
   binary PPM file, taken as sRGB, or a Radiance file (RGBE). Of these, it reads flat rows and rows with run lengths per
   component, but no run lengths of whole pixels, no XYZ, and no turned pictures. [Ward, "Real Pixels", Graphics Gems
   II]
 */

#ifndef EX_SKY_H
#define EX_SKY_H

#include "slide.h"
#include "vectors.h"

#include <strings.h>

#define EX_SKY_SIZE_MAX  16384
#define EX_SKY_BRIGHTEST 1e18f /* the library accepts no more */

typedef struct ex_sky {
    ex_slide image, even; /* as read; averaged, as a light */
    ex_vec up, ahead, right;
    float scale;
} ex_sky;

static inline void ex_sky_free(ex_sky *sky) {
    ex_slide_free(&sky->image);
    ex_slide_free(&sky->even);
}

/* --- Radiance files --- */

/* Reads the header's lines and the size. `scale` receives the radiance of a color of 1. */
static inline int ex_hdr_header(const char *path, char **rest, const char *end, int size[2], double *scale,
                                ex_error *error) {
    char *line = ex_next_line(rest, end);
    int ends = 0;
    *scale = 1;
    if (!line || strncmp(line, "#?", 2) != 0) return ex_fail(error, "%s: not a Radiance file ('#?')", path);
    while ((line = ex_next_line(rest, end)) != NULL && *ex_trim(line)) {
        if (strncmp(line, "FORMAT=", 7) == 0 && strncmp(line, "FORMAT=32-bit_rle_rgbe", 22) != 0)
            return ex_fail(error, "%s: %s is not read, only 32-bit_rle_rgbe", path, ex_quoted(line).text);
        if (strncmp(line, "EXPOSURE=", 9) == 0) *scale /= strtod(line + 9, NULL);
    }
    if (!(*scale > 0 && *scale < 1e30)) return ex_fail(error, "%s: its exposures are not positive numbers", path);
    line = line ? ex_next_line(rest, end) : NULL;
    if (!line || sscanf(line, "-Y %6d +X %6d%n", &size[1], &size[0], &ends) != 2 || *ex_trim(line + ends))
        return ex_fail(error, "%s: no size of the form '-Y height +X width'", path);
    if (size[0] < 1 || size[0] > EX_SKY_SIZE_MAX || size[1] < 1 || size[1] > EX_SKY_SIZE_MAX)
        return ex_fail(error, "%s: %d x %d pixels; there may be 1..%d on a side", path, size[0], size[1],
                       EX_SKY_SIZE_MAX);
    return 0;
}

/* Unpacks a component of a row. Returns 0 if the bytes end, or runs go beyond the row. */
static inline int ex_hdr_runs(const unsigned char **from, const unsigned char *end, int width, unsigned char *out) {
    for (int x = 0; x < width;) {
        if (end - *from < 2) return 0;
        const int code = *(*from)++, count = code > 128 ? code - 128 : code;
        if (count == 0 || count > width - x || (code <= 128 && end - *from < count)) return 0;
        if (code > 128)
            memset(out + x, *(*from)++, (size_t)count);
        else
            memcpy(out + x, *from, (size_t)count), *from += count;
        x += count;
    }
    return 1;
}

/* Reads a row as four components, one after another. Returns 0 if it is damaged. */
static inline int ex_hdr_row(const unsigned char **from, const unsigned char *end, int width, unsigned char *out) {
    const unsigned char *at = *from;
    const int packed = width >= 8 && width < 32768 && end - at >= 4 && at[0] == 2 && at[1] == 2 && at[2] < 128;
    if (packed) {
        if (256 * at[2] + at[3] != width) return 0;
        *from += 4;
        for (int k = 0; k < 4; ++k)
            if (!ex_hdr_runs(from, end, width, out + k * width)) return 0;
        return 1;
    }
    if (end - at < 4 * (ptrdiff_t)width) return 0;
    for (int i = 0; i < 4 * width; ++i) out[i % 4 * width + i / 4] = at[i];
    *from += 4 * width;
    return 1;
}

/* Nothing is allocated before the file is known to be long enough for the shortest rows. */
static inline int ex_hdr_pixels(const char *path, const char *rest, const char *last, const int size[2], double scale,
                                ex_slide *slide, ex_error *error) {
    const unsigned char *from = (const unsigned char *)rest, *end = (const unsigned char *)last;
    const size_t width = (size_t)size[0], flat = 4 * width, packed = 4 + 8 * ((width + 126) / 127);
    int good = 1;
    if ((size_t)(end - from) / (flat < packed ? flat : packed) < (size_t)size[1])
        return ex_fail(error, "%s: the file ends amid its pixels", path);
    slide->width = size[0], slide->height = size[1];
    slide->rgb = (float *)ex_allocate(width * (size_t)size[1], 3 * sizeof(float));
    unsigned char *row = (unsigned char *)ex_allocate(width, 4);
    for (int y = 0; y < size[1] && good; ++y) {
        good = ex_hdr_row(&from, end, size[0], row);
        for (size_t x = 0; x < width && good; ++x) {
            const unsigned char *at = row + x;
            const double unit = at[3 * width] ? scale * ldexp(1, at[3 * width] - 136) : 0;
            good = at[0] != 1 || at[width] != 1 || at[2 * width] != 1; /* run lengths of pixels */
            for (size_t c = 0; c < 3; ++c)
                slide->rgb[3 * ((size_t)y * width + x) + c] =
                    (float)fmin(unit * at[c * width], (double)EX_SKY_BRIGHTEST);
        }
        if (!good) ex_fail(error, "%s: row %d of its pixels is damaged, or packed in an old way", path, y);
    }
    free(row);
    return !good;
}

static inline int ex_hdr_read(const char *path, ex_slide *slide, ex_error *error) {
    char *text, *rest;
    size_t length;
    double scale;
    int size[2];
    memset(slide, 0, sizeof *slide);
    if (ex_read_text(path, &text, &length, error)) return 1;
    rest = text;
    const int failed = ex_hdr_header(path, &rest, text + length, size, &scale, error) ||
                       ex_hdr_pixels(path, rest, text + length, size, scale, slide, error);
    free(text);
    if (failed) ex_slide_free(slide), slide->rgb = NULL;
    return failed;
}

/* --- the sky --- */

/* Where pixel `i` of `from` pixels and pixel `k` of `to` pixels of the same length overlap: 0 to 1 along all. */
static inline void ex_sky_overlap(int i, int from, int k, int to, double ends[2]) {
    const double whole = (double)from * to;
    ends[0] = fmax((double)i * to, (double)k * from) / whole;
    ends[1] = fmin((i + 1.0) * to, (k + 1.0) * from) / whole;
}

/* The mean over a pixel of a smaller picture, by solid angle. */
static inline void ex_sky_average(const ex_slide *from, const ex_slide *to, int column, int row, float out[3]) {
    const int x0 = (int)((int64_t)column * from->width / to->width);
    const int x1 = (int)(((int64_t)(column + 1) * from->width + to->width - 1) / to->width);
    const int y0 = (int)((int64_t)row * from->height / to->height);
    const int y1 = (int)(((int64_t)(row + 1) * from->height + to->height - 1) / to->height);
    double sum[3] = {0, 0, 0}, whole = 0, wide[2], tall[2];
    for (int y = y0; y < y1; ++y) {
        ex_sky_overlap(y, from->height, row, to->height, tall);
        for (int x = x0; x < x1; ++x) {
            const float *color = from->rgb + 3 * ((size_t)y * (size_t)from->width + (size_t)x);
            ex_sky_overlap(x, from->width, column, to->width, wide);
            const double weight = (wide[1] - wide[0]) * (cos(EX_PI * tall[0]) - cos(EX_PI * tall[1]));
            for (int c = 0; c < 3; ++c) sum[c] += weight * (double)color[c];
            whole += weight;
        }
    }
    for (int c = 0; c < 3; ++c) out[c] = (float)(sum[c] / whole);
}

/* Averages a picture, so that it has at most `most` pixels along its width. */
static inline void ex_sky_shrink(const ex_slide *from, int most, ex_slide *to) {
    to->width = from->width < most ? from->width : most;
    to->height = (int)fmax(1, floor((double)from->height * to->width / from->width + 0.5));
    to->rgb = (float *)ex_allocate((size_t)to->width * (size_t)to->height, 3 * sizeof(float));
    for (int n = 0; n < to->width * to->height; ++n)
        ex_sky_average(from, to, n % to->width, n / to->width, to->rgb + 3 * (size_t)n);
}

/* Reads a picture. Its middle lies towards -z, or +y if up is along z; `turn` degrees rotate it to the left. */
static inline int ex_sky_read(const char *path, const double up[3], double turn, double scale, ex_sky *sky,
                              ex_error *error) {
    const size_t length = strlen(path);
    const int is_hdr = length > 4 && strcasecmp(path + length - 4, ".hdr") == 0;
    memset(sky, 0, sizeof *sky);
    if (is_hdr ? ex_hdr_read(path, &sky->image, error) : ex_slide_read(path, &sky->image, error)) return 1;
    ex_sky_shrink(&sky->image, 180, &sky->even);
    sky->up = ex_vec_unit(ex_vec_of(up[0], up[1], up[2]));
    const ex_vec ahead = fabs(sky->up.z) > 0.9 ? ex_vec_of(0, 1, 0) : ex_vec_of(0, 0, -1);
    const ex_vec right = ex_vec_unit(ex_vec_cross(ahead, sky->up)), level = ex_vec_cross(sky->up, right);
    const double c = cos(turn * EX_PI / 180), s = sin(turn * EX_PI / 180);
    sky->ahead = ex_vec_sub(ex_vec_scale(level, c), ex_vec_scale(right, s));
    sky->right = ex_vec_add(ex_vec_scale(right, c), ex_vec_scale(level, s));
    sky->scale = (float)scale;
    return 0;
}

/* Interpolates a picture of the sky; it closes around the horizon. */
static inline void ex_sky_look(const ex_sky *sky, const ex_slide *image, const float way[3], float out[3]) {
    const ex_vec d = ex_vec_unit(ex_vec_of((double)way[0], (double)way[1], (double)way[2]));
    const double turn = atan2(ex_vec_dot(d, sky->right), ex_vec_dot(d, sky->ahead)) / (2 * EX_PI) + 0.5;
    const double down = acos(fmax(-1, fmin(ex_vec_dot(d, sky->up), 1))) / EX_PI;
    const double x = turn * image->width - 0.5, y = fmax(0, fmin(down * image->height - 0.5, image->height - 1));
    const int x0 = (int)floor(x), y0 = (int)y;
    for (int c = 0; c < 3; ++c) out[c] = 0;
    for (int n = 0; n < 4; ++n) {
        const int column = (x0 + n % 2 + image->width) % image->width;
        const int row = y0 + n / 2 < image->height ? y0 + n / 2 : y0;
        const double share = (n % 2 ? x - x0 : 1 - x + x0) * (n / 2 ? y - y0 : 1 - y + y0);
        const float *color = image->rgb + 3 * ((size_t)row * (size_t)image->width + (size_t)column);
        for (int c = 0; c < 3; ++c) out[c] += sky->scale * (float)share * color[c];
    }
    for (int c = 0; c < 3; ++c) out[c] = fminf(out[c], EX_SKY_BRIGHTEST);
}

/* sps_scene.sky_fn; `user` is an ex_sky. */
static inline int ex_sky_light(void *user, size_t count, const float *directions, float *out_rgb) {
    const ex_sky *sky = (const ex_sky *)user;
    for (size_t i = 0; i < count; ++i) ex_sky_look(sky, &sky->even, directions + 3 * i, out_rgb + 3 * i);
    return 0;
}

/* sps_scene.background_fn; `user` is an ex_sky. */
static inline int ex_sky_behind(void *user, size_t count, const float *directions, float *out_rgb) {
    const ex_sky *sky = (const ex_sky *)user;
    for (size_t i = 0; i < count; ++i) ex_sky_look(sky, &sky->image, directions + 3 * i, out_rgb + 3 * i);
    return 0;
}

#endif /* EX_SKY_H */
