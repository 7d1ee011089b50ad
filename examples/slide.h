/* slide.h: an image for a projector, drawn by a program or read from a PPM file. */

#ifndef EX_SLIDE_H
#define EX_SLIDE_H

#include "files.h"

#define EX_SLIDE_SIZE_MAX 4096

/* Linear colors, row by row from the top. */
typedef struct ex_slide {
    int width, height;
    float *rgb;
} ex_slide;

static inline void ex_slide_free(ex_slide *slide) { free(slide->rgb); }

/* sps_projector.sample_fn; `user` is an ex_slide. */
static inline int ex_slide_sample(void *user, size_t count, const float *uv, float *out_rgb) {
    const ex_slide *slide = (const ex_slide *)user;
    for (size_t i = 0; i < count; ++i) {
        const int x = (int)(uv[2 * i] * (float)slide->width), y = (int)(uv[2 * i + 1] * (float)slide->height);
        memcpy(out_rgb + 3 * i, slide->rgb + 3 * ((size_t)y * (size_t)slide->width + (size_t)x), 3 * sizeof(float));
    }
    return 0;
}

/* A projector of this slide whose image is `angle` degrees high. */
static inline sps_projector ex_slide_projector(ex_slide *slide, double angle) {
    sps_projector projector;
    memset(&projector, 0, sizeof projector);
    projector.width = slide->width, projector.height = slide->height;
    projector.sample_fn = ex_slide_sample;
    projector.user = slide;
    projector.top = tan(0.5 * angle * 3.14159265358979323846 / 180);
    projector.right = projector.top * slide->width / slide->height;
    projector.left = -projector.right, projector.bottom = -projector.top;
    return projector;
}

/* Reads a whole number of a PPM header, after blanks and comments. Returns -1 if there is none. */
static inline int ex_ppm_number(FILE *file) {
    int c = fgetc(file), number = -1;
    while (c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == '#') {
        if (c == '#')
            while ((c = fgetc(file)) != '\n')
                if (c == EOF) return -1;
        c = fgetc(file);
    }
    for (; c >= '0' && c <= '9'; c = fgetc(file)) {
        number = 10 * (number < 0 ? 0 : number) + c - '0';
        if (number > 65535) return -1;
    }
    return number;
}

/* Linear intensity of an sRGB code. */
static inline float ex_srgb_linear(double code) {
    return (float)(code <= 0.04045 ? code / 12.92 : pow((code + 0.055) / 1.055, 2.4));
}

/* Nothing is allocated before the length of the file, `held`, is known to be right. */
static inline int ex_ppm_read(const char *path, FILE *file, uint64_t held, ex_slide *slide, ex_error *error) {
    const int magic = fgetc(file) == 'P' && fgetc(file) == '6', width = magic ? ex_ppm_number(file) : -1;
    const int height = ex_ppm_number(file), most = ex_ppm_number(file), bytes = most > 255 ? 2 : 1;
    if (width < 0 || height < 0 || most < 1) return ex_fail(error, "%s: not a binary PPM file ('P6')", path);
    if (width < 1 || width > EX_SLIDE_SIZE_MAX || height < 1 || height > EX_SLIDE_SIZE_MAX)
        return ex_fail(error, "%s: %d x %d pixels; there may be 1..%d on a side", path, width, height,
                       EX_SLIDE_SIZE_MAX);
    const uint64_t needed = 3 * (uint64_t)bytes * (uint64_t)width * (uint64_t)height;
    const off_t before = ftello(file);
    if (before < 0 || held < (uint64_t)before || held - (uint64_t)before < needed)
        return ex_fail(error, "%s: the file ends amid its pixels", path);
    slide->width = width, slide->height = height;
    slide->rgb = (float *)ex_allocate((size_t)width * (size_t)height, 3 * sizeof(float));
    for (size_t i = 0; i < 3 * (size_t)width * (size_t)height; ++i) {
        const int high = bytes == 2 ? fgetc(file) : 0, low = fgetc(file);
        if (high == EOF || low == EOF) return ex_fail(error, "%s: the file ends amid its pixels", path);
        slide->rgb[i] = ex_srgb_linear(fmin((256.0 * high + low) / most, 1));
    }
    return 0;
}

/* Reads a binary PPM file of 8 or 16 bits, taken as sRGB. The caller frees the slide. */
static inline int ex_slide_read(const char *path, ex_slide *slide, ex_error *error) {
    uint64_t held = 0;
    FILE *file = ex_open(path, &held, error);
    int failed;
    memset(slide, 0, sizeof *slide);
    if (!file) return 1;
    failed = ex_ppm_read(path, file, held, slide, error);
    fclose(file);
    if (failed) ex_slide_free(slide), slide->rgb = NULL;
    return failed;
}

#endif /* EX_SLIDE_H */
