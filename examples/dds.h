/* dds.h: writes textures as DDS files, always with the DX10 header: 2D, arrays, cube maps and 3D, without mipmaps. The
   format: Microsoft's "Programming guide for DDS", pages DDS_HEADER, DDS_PIXELFORMAT and DDS_HEADER_DXT10. It writes no
   compressed formats, and reads nothing. */

#ifndef EX_DDS_H
#define EX_DDS_H

#include "exr.h"

/* Unorm texels stand for 0..1. SRGB is RGBA8 whose red, green and blue have been coded by the sRGB curve. */
typedef enum ex_dds_format {
    EX_DDS_R8,
    EX_DDS_RGBA8,
    EX_DDS_SRGB,
    EX_DDS_R16,
    EX_DDS_RGBA16,
    EX_DDS_R16F,
    EX_DDS_RGBA16F,
    EX_DDS_R32F,
    EX_DDS_RGBA32F,
    EX_DDS_FORMATS
} ex_dds_format;

typedef enum ex_dds_texel { EX_DDS_UNORM8, EX_DDS_UNORM16, EX_DDS_HALF, EX_DDS_FLOAT } ex_dds_texel;

typedef struct ex_dds_layout {
    int dxgi; /* the number of DXGI_FORMAT */
    int channels, bytes;
    ex_dds_texel texel;
} ex_dds_layout;

static inline ex_dds_layout ex_dds_layout_of(ex_dds_format format) {
    static const ex_dds_layout layouts[EX_DDS_FORMATS] = {
        {61, 1, 1, EX_DDS_UNORM8},  {28, 4, 1, EX_DDS_UNORM8},  {29, 4, 1, EX_DDS_UNORM8},
        {56, 1, 2, EX_DDS_UNORM16}, {11, 4, 2, EX_DDS_UNORM16}, {54, 1, 2, EX_DDS_HALF},
        {10, 4, 2, EX_DDS_HALF},    {41, 1, 4, EX_DDS_FLOAT},   {2, 4, 4, EX_DDS_FLOAT}};
    return layouts[format];
}

/* What the last channel is: the header says it to readers that blend. */
typedef enum ex_dds_alpha {
    EX_DDS_ALPHA_UNKNOWN = 0,
    EX_DDS_ALPHA_STRAIGHT = 1,
    EX_DDS_ALPHA_PREMULTIPLIED = 2,
    EX_DDS_ALPHA_CUSTOM = 4 /* not an alpha */
} ex_dds_alpha;

typedef struct ex_dds {
    const void *texels; /* as ex_dds_encode makes them; top row first, and one layer or slice after the other */
    int width, height;
    int layers;  /* 0: no array, which differs from an array of one in nothing */
    int depth;   /* 0: 2D; otherwise the slices of a 3D texture, which has no layers */
    int is_cube; /* 1: each six layers are the faces of a cube map: +x -x +y -y +z -z */
    ex_dds_format format;
    ex_dds_alpha alpha;
} ex_dds;

/* Converts numbers to texels in the machine's byte order. Unorm clamps, and NaN becomes 0 there. */
static inline void ex_dds_encode(ex_dds_format format, const float *numbers, size_t count, void *out) {
    const ex_dds_texel texel = ex_dds_layout_of(format).texel;
    if (texel == EX_DDS_FLOAT) memcpy(out, numbers, count * sizeof *numbers);
    for (size_t i = 0; i < count && texel != EX_DDS_FLOAT; ++i) {
        const double unit = numbers[i] > 0.0f ? fmin((double)numbers[i], 1.0) : 0.0;
        if (texel == EX_DDS_UNORM8) ((uint8_t *)out)[i] = (uint8_t)(255.0 * unit + 0.5);
        if (texel == EX_DDS_UNORM16) ((uint16_t *)out)[i] = (uint16_t)(65535.0 * unit + 0.5);
        if (texel == EX_DDS_HALF) ((uint16_t *)out)[i] = ex_half_bits(numbers[i]);
    }
}

enum { EX_DDS_HEADER = 4 + 124 + 20 }; /* bytes before the texels */

static inline void ex_dds_header(const ex_dds *texture, unsigned char header[EX_DDS_HEADER]) {
    const ex_dds_layout layout = ex_dds_layout_of(texture->format);
    const int is_deep = texture->depth > 0, is_array = texture->layers > 1, is_cube = texture->is_cube != 0;
    uint32_t words[EX_DDS_HEADER / 4] = {0};
    words[0] = 0x20534444; /* "DDS " */
    words[1] = 124;
    words[2] = is_deep ? 0x80100f : 0x100f; /* caps, height, width, pitch and pixel format are there; and depth */
    words[3] = (uint32_t)texture->height;
    words[4] = (uint32_t)texture->width;
    words[5] = (uint32_t)(texture->width * layout.channels * layout.bytes);
    words[6] = (uint32_t)texture->depth;
    words[7] = 1;                                          /* level of detail; eleven words are reserved */
    words[19] = 32;                                        /* bytes of the pixel format */
    words[20] = 4;                                         /* which is four letters */
    words[21] = 0x30315844;                                /* "DX10" */
    words[27] = is_array ? 0x1008 : 0x1000;                /* a texture; of several surfaces */
    words[28] = is_deep ? 0x200000 : is_cube ? 0xfe00 : 0; /* a volume; a cube map with all faces */
    words[32] = (uint32_t)layout.dxgi;
    words[33] = is_deep ? 4 : 3; /* the number of dimensions, plus 1 */
    words[34] = is_cube ? 4 : 0; /* a cube map, again */
    words[35] = is_array ? (uint32_t)texture->layers / (is_cube ? 6 : 1) : 1;
    words[36] = (uint32_t)texture->alpha;
    for (int i = 0; i < EX_DDS_HEADER / 4; ++i) ex_exr_number(header + 4 * i, words[i], 4);
}

/* Refuses what Direct3D 11 cannot load. */
static inline int ex_dds_check(const char *path, const ex_dds *texture, ex_error *error) {
    const int most = texture->depth > 0 ? 2048 : 16384;
    if ((int)texture->format < 0 || texture->format >= EX_DDS_FORMATS)
        return ex_fail(error, "%s: %d is no format of a DDS file", path, (int)texture->format);
    if (texture->width < 1 || texture->height < 1 || texture->width > most || texture->height > most)
        return ex_fail(error, "%s: a DDS texture of %d x %d: sides must be within 1..%d", path, texture->width,
                       texture->height, most);
    if (texture->depth < 0 || texture->depth > 2048)
        return ex_fail(error, "%s: a DDS texture with %d slices: they must be within 0..2048", path, texture->depth);
    if (texture->layers < 0 || texture->layers > 2048)
        return ex_fail(error, "%s: a DDS texture with %d layers: they must be within 0..2048", path, texture->layers);
    if (texture->depth > 0 && texture->layers > 1)
        return ex_fail(error, "%s: a DDS texture has slices or layers, not both", path);
    if (texture->is_cube && (texture->layers < 6 || texture->layers % 6 != 0 || texture->width != texture->height))
        return ex_fail(error, "%s: a DDS texture with %d layers of %d x %d: cube maps have six squares each", path,
                       texture->layers, texture->width, texture->height);
    return 0;
}

static inline int ex_write_dds(const char *path, const ex_dds *texture, ex_error *error) {
    unsigned char header[EX_DDS_HEADER];
    ex_output output;
    if (ex_dds_check(path, texture, error) || ex_output_begin(&output, path, error)) return 1;
    const ex_dds_layout layout = ex_dds_layout_of(texture->format);
    const size_t numbers = (size_t)texture->width * (size_t)layout.channels, size = (size_t)layout.bytes;
    const int images = texture->depth > 0 ? texture->depth : texture->layers > 1 ? texture->layers : 1;
    const size_t rows = (size_t)texture->height * (size_t)images;
    const unsigned char *from = (const unsigned char *)texture->texels;
    unsigned char *row = (unsigned char *)ex_allocate(numbers, size);
    ex_dds_header(texture, header);
    ex_output_bytes(&output, header, sizeof header);
    for (size_t y = 0; y < rows && !output.failure; ++y, from += numbers * size) {
        memcpy(row, from, numbers * size);
        ex_little_endian(row, numbers, size);
        ex_output_bytes(&output, row, numbers * size);
    }
    free(row);
    return ex_output_end(&output, error);
}

#endif /* EX_DDS_H */
