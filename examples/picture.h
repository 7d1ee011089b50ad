/* picture.h: writing pictures as PNG, PFM and Radiance HDR files. */

#ifndef EX_PICTURE_H
#define EX_PICTURE_H

#include "files.h"

#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STB_IMAGE_WRITE_STATIC
#include "stb_image_write.h"

/* Averages 2x2 pixels into one; an odd last row or column is dropped. `out` may be the same as `in`. */
static inline void ex_halve(const float *in, int width, int height, int channels, float *out) {
    const size_t row = (size_t)width * (size_t)channels, step = (size_t)channels;
    for (int y = 0; y < height / 2; ++y)
        for (int x = 0; x < width / 2; ++x) {
            const float *from = in + 2 * (size_t)y * row + 2 * (size_t)x * step;
            for (size_t c = 0; c < step; ++c, ++from)
                *out++ = 0.25f * (from[0] + from[step] + from[row] + from[row + step]);
        }
}

/* Converts linear radiance to an 8-bit sRGB code; NaN becomes black. */
static inline unsigned char ex_srgb_code(float linear) {
    if (!(linear > 0.0f)) return 0;
    if (linear >= 1.0f) return 255;
    const float code = linear <= 0.0031308f ? 12.92f * linear : 1.055f * powf(linear, 1.0f / 2.4f) - 0.055f;
    return (unsigned char)(255.0f * code + 0.5f);
}

static inline void ex_encoded_bytes(void *output, void *data, int size) {
    ex_output_bytes((ex_output *)output, data, (size_t)size);
}

/* Writes codes of 8 bits as they are: three channels, or four, the last of which is alpha. */
static inline int ex_write_png_codes(const char *path, const unsigned char *codes, int width, int height, int channels,
                                     ex_error *error) {
    ex_output output;
    if (ex_output_begin(&output, path, error)) return 1;
    const int stride = channels * width;
    const int encoded = stbi_write_png_to_func(ex_encoded_bytes, &output, width, height, channels, codes, stride);
    if (!encoded) errno = ENOMEM; /* the encoder fails in no other way */
    ex_output_note(&output, !encoded);
    return ex_output_end(&output, error);
}

/* Writes RGB of an RGBA image as it is: premultiplied, over its background; clamped to 0..1. */
static inline int ex_write_png(const char *path, const float *rgba, int width, int height, ex_error *error) {
    const size_t count = (size_t)width * (size_t)height;
    unsigned char *codes = (unsigned char *)ex_allocate(count, 3);
    for (size_t i = 0; i < count; ++i)
        for (size_t c = 0; c < 3; ++c) codes[3 * i + c] = ex_srgb_code(rgba[4 * i + c]);
    const int failed = ex_write_png_codes(path, codes, width, height, 3, error);
    free(codes);
    return failed;
}

/* Writes RGB of an RGBA image as a Radiance picture (RGBE): each pixel in steps of at most 1/128 of its largest color.
   NaN becomes black; the format ends at 1.7e38. */
static inline int ex_write_hdr(const char *path, const float *rgba, int width, int height, ex_error *error) {
    const size_t count = 3 * (size_t)width * (size_t)height;
    ex_output output;
    if (ex_output_begin(&output, path, error)) return 1;
    float *colors = (float *)ex_allocate(count, sizeof *colors);
    for (size_t i = 0; i < count; ++i) {
        const float color = rgba[i / 3 * 4 + i % 3];
        colors[i] = !(color > 0.0f) ? 0.0f : color > 1.7e38f ? 1.7e38f : color;
    }
    const int encoded = stbi_write_hdr_to_func(ex_encoded_bytes, &output, width, height, 3, colors);
    free(colors);
    if (!encoded) errno = ENOMEM; /* the encoder fails in no other way */
    ex_output_note(&output, !encoded);
    return ex_output_end(&output, error);
}

/* Writes channels first_channel .. first_channel + channels - 1 (3: 'PF', 1: 'Pf') of an RGBA image as PFM: linear,
   little endian, bottom row first. */
static inline int ex_write_pfm(const char *path, const float *rgba, int width, int height, int first_channel,
                               int channels, ex_error *error) {
    ex_output output;
    char header[64];
    if (ex_output_begin(&output, path, error)) return 1;
    const size_t row_count = (size_t)width * (size_t)channels;
    float *row = (float *)ex_allocate(row_count, sizeof *row);
    snprintf(header, sizeof header, "%s\n%d %d\n-1.0\n", channels == 3 ? "PF" : "Pf", width, height);
    ex_output_bytes(&output, header, strlen(header));
    for (int y = height - 1; y >= 0 && !output.failure; --y) {
        const float *from = rgba + 4 * (size_t)y * (size_t)width + first_channel;
        for (size_t i = 0; i < row_count; ++i) row[i] = from[4 * (i / (size_t)channels) + i % (size_t)channels];
        ex_little_endian(row, row_count, sizeof *row);
        ex_output_bytes(&output, row, row_count * sizeof *row);
    }
    free(row);
    return ex_output_end(&output, error);
}

/* Writes RGB of an RGBA image as PFM if the name ends in ".pfm", and as PNG otherwise. */
static inline int ex_write_picture(const char *path, const float *rgba, int width, int height, ex_error *error) {
    const size_t length = strlen(path);
    if (length > 4 && strcmp(path + length - 4, ".pfm") == 0)
        return ex_write_pfm(path, rgba, width, height, 0, 3, error);
    return ex_write_png(path, rgba, width, height, error);
}

#endif /* EX_PICTURE_H */
