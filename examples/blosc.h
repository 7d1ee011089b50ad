/* blosc.h: unpacks a Blosc 1 buffer of LZ4 blocks, as .vdb and .nvdb files hold them.
   References: README_HEADER.rst of c-blosc; lz4_Block_format.md of LZ4.
   It does not read other codecs (BloscLZ, Snappy, zlib, Zstandard), shuffled bits, or Blosc 2. */

#ifndef EX_BLOSC_H
#define EX_BLOSC_H

#include "files.h"

static inline uint32_t ex_get_u32(const unsigned char *from) {
    return (uint32_t)from[0] | (uint32_t)from[1] << 8 | (uint32_t)from[2] << 16 | (uint32_t)from[3] << 24;
}

static inline uint64_t ex_get_u64(const unsigned char *from) {
    return (uint64_t)ex_get_u32(from) | (uint64_t)ex_get_u32(from + 4) << 32;
}

/* Reads the rest of a length of LZ4, whose first four bits are in a token. Returns 0 if the input ends within it. */
static inline int ex_lz4_length(const unsigned char **at, const unsigned char *end, size_t *length) {
    unsigned char more = 255;
    if (*length < 15) return 1;
    while (more == 255) {
        if (*at == end) return 0;
        more = *(*at)++;
        *length += more;
    }
    return 1;
}

/* Unpacks an LZ4 block. Returns 1 unless it is well formed and gives exactly `size` bytes. */
static inline int ex_lz4(const unsigned char *in, size_t in_size, unsigned char *out, size_t size) {
    const unsigned char *at = in, *end = in + in_size;
    size_t made = 0;
    while (at < end) {
        const unsigned char token = *at++;
        size_t literals = token >> 4, match = token & 15;
        if (!ex_lz4_length(&at, end, &literals)) return 1;
        if (literals > (size_t)(end - at) || literals > size - made) return 1;
        memcpy(out + made, at, literals);
        at += literals, made += literals;
        if (at == end) break; /* the last literals have no match after them */
        if (end - at < 2) return 1;
        const size_t back = (size_t)at[0] | (size_t)at[1] << 8;
        at += 2;
        if (!ex_lz4_length(&at, end, &match)) return 1;
        match += 4;
        if (back == 0 || back > made || match > size - made) return 1;
        if (back >= match)
            memcpy(out + made, out + made - back, match);
        else
            for (size_t i = 0; i < match; ++i) out[made + i] = out[made - back + i];
        made += match;
    }
    return made != size;
}

/* The header of a buffer, and where it lies. */
typedef struct ex_blosc_buffer {
    const unsigned char *in;
    size_t in_size, size, block, item; /* bytes: packed, unpacked, of a block, of an item */
    int flags;
} ex_blosc_buffer;

enum { EX_BLOSC_SHUFFLED = 1, EX_BLOSC_COPIED = 2, EX_BLOSC_BITS = 4, EX_BLOSC_WHOLE = 16, EX_BLOSC_HEADER = 16 };

/* Puts bytes that were sorted by their place in an item back into items. Bytes after the last whole item are kept. */
static inline void ex_blosc_unshuffle(const unsigned char *from, size_t size, size_t item, unsigned char *out) {
    const size_t count = size / item;
    for (size_t k = 0; k < item; ++k)
        for (size_t i = 0; i < count; ++i) out[i * item + k] = from[k * count + i];
    memcpy(out + count * item, from + count * item, size - count * item);
}

/* Unpacks one block. It is a stream, or one stream for each byte of an item, each after its length. */
static inline int ex_blosc_block(const ex_blosc_buffer *b, size_t at, size_t size, unsigned char *out) {
    const int split = !(b->flags & EX_BLOSC_WHOLE) && b->item <= 16 && b->block / b->item >= 128 && size == b->block;
    const size_t streams = split ? b->item : 1, each = size / streams;
    if (each * streams != size) return 1;
    for (size_t i = 0; i < streams; ++i, out += each) {
        if (at > b->in_size || b->in_size - at < 4) return 1;
        const size_t packed = ex_get_u32(b->in + at);
        at += 4;
        if (packed > b->in_size - at) return 1;
        if (packed == each)
            memcpy(out, b->in + at, each);
        else if (ex_lz4(b->in + at, packed, out, each))
            return 1;
        at += packed;
    }
    return 0;
}

/* Reads and checks the header. `path` is for the error. */
static inline int ex_blosc_header(ex_blosc_buffer *b, const char *path, ex_error *error) {
    static const char *const codecs[8] = {"BloscLZ", "LZ4", "Snappy", "zlib", "Zstandard", "5", "6", "7"};
    if (b->in_size < EX_BLOSC_HEADER)
        return ex_fail(error, "%s: %zu bytes are too few for a Blosc buffer", path, b->in_size);
    b->flags = b->in[2], b->item = b->in[3] ? b->in[3] : 1, b->block = ex_get_u32(b->in + 8);
    if (b->in[0] < 1 || b->in[0] > 2)
        return ex_fail(error, "%s: Blosc's format %d is not supported: only 1 and 2 are", path, b->in[0]);
    if (ex_get_u32(b->in + 4) != b->size)
        return ex_fail(error, "%s: a Blosc buffer holds %u bytes instead of %zu", path, ex_get_u32(b->in + 4), b->size);
    if (ex_get_u32(b->in + 12) != b->in_size)
        return ex_fail(error, "%s: a Blosc buffer has %u bytes, but the file gives it %zu", path,
                       ex_get_u32(b->in + 12), b->in_size);
    if (b->flags & EX_BLOSC_COPIED) return 0;
    if (b->flags >> 5 != 1)
        return ex_fail(error, "%s: Blosc's codec %s is not supported: only LZ4 is", path, codecs[b->flags >> 5]);
    if (b->flags & EX_BLOSC_BITS) return ex_fail(error, "%s: Blosc's shuffled bits are not supported", path);
    if (b->size > 0 && (b->block == 0 || b->block > b->size))
        return ex_fail(error, "%s: a Blosc buffer of %zu bytes has blocks of %zu", path, b->size, b->block);
    return 0;
}

/* Unpacks a whole buffer into `out`, which has `size` bytes. */
static inline int ex_blosc(const char *path, const unsigned char *in, size_t in_size, unsigned char *out, size_t size,
                           ex_error *error) {
    unsigned char small[2048];
    ex_blosc_buffer b = {in, in_size, size, 0, 0, 0};
    if (ex_blosc_header(&b, path, error)) return 1;
    if (b.flags & EX_BLOSC_COPIED) {
        if (in_size - EX_BLOSC_HEADER < size) return ex_fail(error, "%s: a Blosc buffer is cut off", path);
        memcpy(out, in + EX_BLOSC_HEADER, size);
        return 0;
    }
    if (size == 0) return 0;
    const size_t blocks = (size + b.block - 1) / b.block;
    const int shuffled = (b.flags & EX_BLOSC_SHUFFLED) && b.item > 1;
    if (blocks > (in_size - EX_BLOSC_HEADER) / 4) return ex_fail(error, "%s: a Blosc buffer is cut off", path);
    unsigned char *sorted = !shuffled ? NULL : b.block <= sizeof small ? small : (unsigned char *)malloc(b.block);
    int failed = shuffled && !sorted;
    for (size_t i = 0; i < blocks && !failed; ++i) {
        const size_t first = i * b.block, bytes = size - first < b.block ? size - first : b.block;
        unsigned char *target = shuffled ? sorted : out + first;
        failed = ex_blosc_block(&b, ex_get_u32(in + EX_BLOSC_HEADER + 4 * i), bytes, target);
        if (shuffled && !failed) ex_blosc_unshuffle(sorted, bytes, b.item, out + first);
    }
    if (sorted != small) free(sorted);
    return failed ? ex_fail(error, "%s: an LZ4 block is damaged", path) : 0;
}

#endif /* EX_BLOSC_H */
