/* exr.h: writes pictures as OpenEXR files: version 2, one part, scan lines; RGBA as halves or floats and Z as floats;
   no compression or ZIP. The format: "OpenEXR File Layout", openexr.com. It writes no tiles and reads nothing.

   R, G, B hold radiance with the background, A holds coverage without it, as in sps_image. On a black background that
   is premultiplied alpha, as OpenEXR has it. Z is the distance from the eye; infinity where nothing is. */

#ifndef EX_EXR_H
#define EX_EXR_H

#include "deflate.h"
#include "files.h"

typedef struct ex_exr {
    const float *rgba;   /* pixels of the region, packed */
    const float *depth;  /* the same; NULL: no Z */
    int width, height;   /* pixels of the whole picture */
    int region[4];       /* x, y, width, height of the part that there is; all 0: the whole picture */
    double screen_width; /* the whole picture's, at distance 1 from the eye; 0: not a perspective, written as 1 */
    int is_float;        /* 1: RGBA are floats; 0: halves */
    int zip;             /* 1: ZIP; 0: no compression */
} ex_exr;

/* The nearest half; of two as near, the even one. Finite numbers beyond the largest half, 65504, become that one:
   infinities would turn into NaN in programs that composite. */
static inline uint16_t ex_half_bits(float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    const uint32_t sign = bits >> 16 & 0x8000, size = bits & 0x7fffffff;
    if (size > 0x7f800000) return (uint16_t)(sign | 0x7e00); /* NaN */
    if (size == 0x7f800000) return (uint16_t)(sign | 0x7c00);
    if (size >= 0x477ff000) return (uint16_t)(sign | 0x7bff);
    if (size >= 0x38800000) { /* normal: exponents differ by 112 */
        const uint32_t moved = size - 0x38000000;
        return (uint16_t)(sign | (moved + 0xfff + (moved >> 13 & 1)) >> 13);
    }
    if (size < 0x33000000) return (uint16_t)sign; /* less than half of the smallest */
    const uint32_t digits = (size & 0x7fffff) | 0x800000, shift = 126 - (size >> 23);
    return (uint16_t)(sign | (digits + (1u << (shift - 1)) - 1 + (digits >> shift & 1)) >> shift);
}

/* Numbers are little endian. Returns where the next one goes. */
static inline unsigned char *ex_exr_number(unsigned char *out, uint64_t number, int size) {
    for (int i = 0; i < size; ++i) *out++ = (unsigned char)(number >> 8 * i & 255);
    return out;
}

static inline unsigned char *ex_exr_float(unsigned char *out, float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return ex_exr_number(out, bits, 4);
}

/* ------------------------------------------------------------------------------------------------------ the header */

/* The name and type of an attribute, and the size of its value, which follows. */
static inline unsigned char *ex_exr_attribute(unsigned char *out, const char *name, const char *type, int size) {
    memcpy(out, name, strlen(name) + 1);
    out += strlen(name) + 1;
    memcpy(out, type, strlen(type) + 1);
    return ex_exr_number(out + strlen(type) + 1, (uint64_t)size, 4);
}

static inline unsigned char *ex_exr_floats(unsigned char *out, const float *values, int count) {
    for (int i = 0; i < count; ++i) out = ex_exr_float(out, values[i]);
    return out;
}

/* Both corners are pixels of the window. */
static inline unsigned char *ex_exr_window(unsigned char *out, const char *name, const int region[4]) {
    const int corners[4] = {region[0], region[1], region[0] + region[2] - 1, region[1] + region[3] - 1};
    out = ex_exr_attribute(out, name, "box2i", 16);
    for (int i = 0; i < 4; ++i) out = ex_exr_number(out, (uint32_t)corners[i], 4);
    return out;
}

/* Names stand in the order of the alphabet. Each has a type (1: half, 2: float) and is there at every pixel. */
static inline unsigned char *ex_exr_channels(unsigned char *out, const ex_exr *picture) {
    const int count = picture->depth ? 5 : 4;
    out = ex_exr_attribute(out, "channels", "chlist", 18 * count + 1);
    for (int i = 0; i < count; ++i) {
        *out++ = (unsigned char)"ABGRZ"[i], *out++ = 0;
        out = ex_exr_number(out, i == 4 || picture->is_float ? 2 : 1, 4);
        out = ex_exr_number(out, 0, 4); /* not "perceptually linear"; three bytes are reserved */
        out = ex_exr_number(ex_exr_number(out, 1, 4), 1, 4);
    }
    *out++ = 0;
    return out;
}

enum { EX_EXR_HEADER = 600 }; /* more than the bytes of a header */

static inline size_t ex_exr_header(const ex_exr *picture, const int region[4], unsigned char *header) {
    static const float rec_709[8] = {0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f}, center[2] = {0, 0};
    const int whole[4] = {0, 0, picture->width, picture->height};
    const float one = 1, screen_width = picture->screen_width > 0 ? (float)picture->screen_width : 1;
    unsigned char *out = ex_exr_number(header, 20000630, 4);
    out = ex_exr_number(out, 2, 4);
    out = ex_exr_channels(out, picture);
    out = ex_exr_floats(ex_exr_attribute(out, "chromaticities", "chromaticities", 32), rec_709, 8);
    out = ex_exr_attribute(out, "compression", "compression", 1);
    *out++ = picture->zip ? 3 : 0;
    out = ex_exr_window(out, "dataWindow", region);
    out = ex_exr_window(out, "displayWindow", whole);
    out = ex_exr_attribute(out, "lineOrder", "lineOrder", 1);
    *out++ = 0; /* top row first */
    out = ex_exr_floats(ex_exr_attribute(out, "pixelAspectRatio", "float", 4), &one, 1);
    out = ex_exr_floats(ex_exr_attribute(out, "screenWindowCenter", "v2f", 8), center, 2);
    out = ex_exr_floats(ex_exr_attribute(out, "screenWindowWidth", "float", 4), &screen_width, 1);
    *out++ = 0;
    return (size_t)(out - header);
}

/* ------------------------------------------------------------------------------------------------------ the pixels */

/* A row: all of A, then B, G, R and Z. */
static inline unsigned char *ex_exr_row(unsigned char *out, const ex_exr *picture, size_t width, size_t row) {
    const float *rgba = picture->rgba + 4 * width * row;
    for (size_t channel = 4; channel-- > 0;)
        for (size_t x = 0; x < width; ++x) {
            const float value = rgba[4 * x + channel];
            out = picture->is_float ? ex_exr_float(out, value) : ex_exr_number(out, ex_half_bits(value), 2);
        }
    for (size_t x = 0; picture->depth && x < width; ++x) out = ex_exr_float(out, picture->depth[width * row + x]);
    return out;
}

/* ZIP packs bytes of even places before those of odd places, each as its difference from the one before it, plus 128.
   Bytes that are not less afterwards are stored as they are: then `zipped` is NULL. */
static inline size_t ex_exr_zip(const unsigned char *bytes, size_t size, unsigned char **zipped) {
    unsigned char *sorted = (unsigned char *)ex_allocate(size, 1), previous = 0;
    for (size_t i = 0; i < size; ++i) sorted[i % 2 ? (size + 1) / 2 + i / 2 : i / 2] = bytes[i];
    for (size_t i = 0; i < size; ++i) {
        const unsigned char byte = sorted[i];
        if (i > 0) sorted[i] = (unsigned char)(byte - previous + 128);
        previous = byte;
    }
    const size_t packed = ex_deflate(sorted, size, zipped);
    free(sorted);
    if (packed < size) return packed;
    free(*zipped);
    *zipped = NULL;
    return size;
}

/* Rows that are stored together. */
typedef struct ex_exr_chunk {
    unsigned char *zipped; /* NULL: as they are */
    size_t size;
} ex_exr_chunk;

/* Bytes of rows first .. first + count - 1. */
static inline void ex_exr_rows(const ex_exr *picture, const int region[4], int first, int count, unsigned char *out) {
    for (int i = 0; i < count; ++i) out = ex_exr_row(out, picture, (size_t)region[2], (size_t)(first + i));
}

static inline void ex_exr_write_chunks(ex_output *output, const ex_exr *picture, const int region[4],
                                       const ex_exr_chunk *chunks, unsigned char *rows) {
    const int lines = picture->zip ? 16 : 1;
    unsigned char start[8];
    for (int y = 0; y < region[3] && !output->failure; y += lines) {
        const ex_exr_chunk *chunk = &chunks[y / lines];
        ex_exr_number(ex_exr_number(start, (uint32_t)(region[1] + y), 4), chunk->size, 4);
        ex_output_bytes(output, start, sizeof start);
        if (!chunk->zipped) ex_exr_rows(picture, region, y, region[3] - y < lines ? region[3] - y : lines, rows);
        ex_output_bytes(output, chunk->zipped ? chunk->zipped : rows, chunk->size);
    }
}

static inline int ex_write_exr(const char *path, const ex_exr *picture, ex_error *error) {
    const int whole[4] = {0, 0, picture->width, picture->height},
              *region = picture->region[2] ? picture->region : whole;
    const int lines = picture->zip ? 16 : 1, chunk_count = (region[3] + lines - 1) / lines;
    const size_t row_size = (size_t)region[2] * (size_t)((picture->is_float ? 16 : 8) + (picture->depth ? 4 : 0));
    unsigned char header[EX_EXR_HEADER], place[8];
    ex_output output;
    if (ex_output_begin(&output, path, error)) return 1;
    unsigned char *rows = (unsigned char *)ex_allocate(row_size, (size_t)lines);
    ex_exr_chunk *chunks = (ex_exr_chunk *)ex_allocate((size_t)chunk_count, sizeof *chunks);
    const size_t header_size = ex_exr_header(picture, region, header);
    uint64_t offset = header_size + 8 * (uint64_t)chunk_count;
    ex_output_bytes(&output, header, header_size);
    for (int i = 0; i < chunk_count; ++i) {
        const int first = i * lines, count = region[3] - first < lines ? region[3] - first : lines;
        chunks[i].size = row_size * (size_t)count;
        if (picture->zip) {
            ex_exr_rows(picture, region, first, count, rows);
            chunks[i].size = ex_exr_zip(rows, chunks[i].size, &chunks[i].zipped);
        }
        ex_exr_number(place, offset, 8);
        ex_output_bytes(&output, place, sizeof place);
        offset += 8 + chunks[i].size;
    }
    ex_exr_write_chunks(&output, picture, region, chunks, rows);
    for (int i = 0; i < chunk_count; ++i) free(chunks[i].zipped);
    free(chunks);
    free(rows);
    return ex_output_end(&output, error);
}

#endif /* EX_EXR_H */
