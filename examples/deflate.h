/* deflate.h: packs bytes into a zlib stream (RFC 1950, RFC 1951). One block with the fixed Huffman code; matches within
   32 KB are found by chains of equal hashes, and the longest at each place is taken. Codes made for the data would save
   another 3 to 5 % of a picture. Data must be shorter than 4 GB. It does not unpack. */

#ifndef EX_DEFLATE_H
#define EX_DEFLATE_H

#include "basics.h"

enum {
    EX_DEFLATE_WINDOW = 32768, /* the farthest match */
    EX_DEFLATE_TRIES = 24,     /* matches that are compared at each place */
    EX_DEFLATE_LONGEST = 257   /* 258 has a code of its own, which is not used */
};

typedef struct ex_deflater {
    const unsigned char *data;
    size_t count;
    unsigned char *out;
    size_t size, capacity;
    uint32_t bits; /* not yet in `out`, lowest first */
    int bit_count;
    uint32_t newest[EX_DEFLATE_WINDOW], older[EX_DEFLATE_WINDOW]; /* positions of equal hash, plus 1; 0: none */
} ex_deflater;

static inline void ex_deflate_bits(ex_deflater *d, uint32_t value, int count) {
    d->bits |= value << d->bit_count;
    for (d->bit_count += count; d->bit_count >= 8; d->bit_count -= 8, d->bits >>= 8) {
        d->out = (unsigned char *)ex_grow(d->out, d->size, &d->capacity, 1);
        d->out[d->size++] = (unsigned char)(d->bits & 255);
    }
}

/* The bits of a code come highest first. */
static inline void ex_deflate_code(ex_deflater *d, uint32_t code, int count) {
    while (count-- > 0) ex_deflate_bits(d, code >> count & 1, 1);
}

/* A byte, 256 for the end, or 257 + the code of a length: RFC 1951, 3.2.6. */
static inline void ex_deflate_symbol(ex_deflater *d, uint32_t symbol) {
    if (symbol < 144)
        ex_deflate_code(d, 0x30 + symbol, 8);
    else if (symbol < 256)
        ex_deflate_code(d, 0x190 + symbol - 144, 9);
    else if (symbol < 280)
        ex_deflate_code(d, symbol - 256, 7);
    else
        ex_deflate_code(d, 0xc0 + symbol - 280, 8);
}

/* The code of a length minus 3 (group 2) or of a distance minus 1 (group 1), and its number of extra bits: the steps of
   RFC 1951's tables double every 4 or 2 codes. */
static inline uint32_t ex_deflate_slot(uint32_t value, int group, int *extra) {
    for (*extra = 0; value >> *extra >= (2u << group);) ++*extra;
    return ((uint32_t)*extra << group) + (value >> *extra);
}

static inline void ex_deflate_match(ex_deflater *d, uint32_t length, uint32_t distance) {
    int extra;
    ex_deflate_symbol(d, 257 + ex_deflate_slot(length - 3, 2, &extra));
    ex_deflate_bits(d, (length - 3) & ((1u << extra) - 1), extra);
    ex_deflate_code(d, ex_deflate_slot(distance - 1, 1, &extra), 5);
    ex_deflate_bits(d, (distance - 1) & ((1u << extra) - 1), extra);
}

static inline uint32_t ex_deflate_hash(const unsigned char *at) {
    return (((uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16) * 0x9E3779B1u) >> 17;
}

/* Finds the longest of the latest matches. Returns its length; 0 if there is none of 3 bytes or more. */
static inline uint32_t ex_deflate_find(const ex_deflater *d, size_t at, uint32_t *distance) {
    const size_t room = d->count - at, longest_match = EX_DEFLATE_LONGEST;
    const size_t most = room < longest_match ? room : longest_match;
    uint32_t longest = 0, place = most < 3 ? 0 : d->newest[ex_deflate_hash(d->data + at)];
    for (int tries = 0; tries < EX_DEFLATE_TRIES && place > 0 && at - (place - 1) < EX_DEFLATE_WINDOW; ++tries) {
        const unsigned char *from = d->data + place - 1;
        uint32_t length = 0;
        while (length < most && from[length] == d->data[at + length]) ++length;
        if (length > 2 && length > longest) longest = length, *distance = (uint32_t)at - (place - 1);
        place = d->older[(place - 1) % EX_DEFLATE_WINDOW];
    }
    return longest;
}

/* Returns the size of the stream, which the caller frees. */
static inline size_t ex_deflate(const unsigned char *data, size_t count, unsigned char **out) {
    ex_deflater *d = (ex_deflater *)ex_allocate(1, sizeof *d);
    uint32_t sums[2] = {1, 0}, distance = 0; /* Adler-32 */
    d->data = data, d->count = count;
    ex_deflate_bits(d, 0x9c78, 16);
    ex_deflate_bits(d, 3, 3); /* the last block, with the fixed code */
    for (size_t at = 0; at < count;) {
        const uint32_t length = ex_deflate_find(d, at, &distance);
        const size_t end = at + (length ? length : 1);
        if (length)
            ex_deflate_match(d, length, distance);
        else
            ex_deflate_symbol(d, data[at]);
        for (; at < end; ++at) {
            sums[0] = (sums[0] + data[at]) % 65521, sums[1] = (sums[1] + sums[0]) % 65521;
            if (count - at < 3) continue;
            uint32_t *newest = &d->newest[ex_deflate_hash(data + at)];
            d->older[at % EX_DEFLATE_WINDOW] = *newest, *newest = (uint32_t)at + 1;
        }
    }
    ex_deflate_symbol(d, 256);
    ex_deflate_bits(d, 0, (8 - d->bit_count) & 7);
    for (int i = 3; i >= 0; --i) ex_deflate_bits(d, sums[i / 2] >> 8 * (i & 1) & 255, 8);
    const size_t size = d->size;
    *out = d->out;
    free(d);
    return size;
}

#endif /* EX_DEFLATE_H */
