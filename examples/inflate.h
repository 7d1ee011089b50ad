/* inflate.h: unpacks data that deflate packed: bare (RFC 1951), as zlib (RFC 1950) or as gzip (RFC 1952, several
   members in a row too), from memory to memory. Checksums and sizes are checked, and nothing is written beyond the room
   given.

   Not read: preset dictionaries of zlib. */

#ifndef EX_INFLATE_H
#define EX_INFLATE_H

#include "basics.h"

typedef enum ex_packing { EX_PACKED_RAW, EX_PACKED_ZLIB, EX_PACKED_GZIP } ex_packing;

/* An entry of a table of codes has, from the lowest bit on: 5 bits for the length of the code, 3 for its kind, 8 for
   the number of extra bits that follow it, and 16 for a value. */
enum { EX_CODE_INVALID, EX_CODE_LITERAL, EX_CODE_COPY, EX_CODE_END, EX_CODE_TABLE };

#define EX_CODE(length, kind, extra, value)                                                                            \
    ((uint32_t)(length) | (uint32_t)(kind) << 5 | (uint32_t)(extra) << 8 | (uint32_t)(value) << 16)
#define EX_CODE_KIND(entry)      ((entry) >> 5 & 7)
#define EX_LOW_BITS(bits, count) ((uint32_t)((bits) & (((uint64_t)1 << (count)) - 1)))

/* Codes with more bits than the first index has continue in a second table. No complete code of 288 and 32 symbols
   takes more than 2342 and 402 entries. */
enum { EX_LITERAL_BITS = 11, EX_DISTANCE_BITS = 8, EX_LITERAL_ENTRIES = 2342, EX_DISTANCE_ENTRIES = 402 };

/* The bits that come next are the lowest of `bits`; `count` of them are valid. */
typedef struct ex_bits {
    uint64_t bits;
    unsigned count;
    const unsigned char *next, *end;
} ex_bits;

typedef struct ex_inflater {
    const char *path;
    const unsigned char *in;
    unsigned char *out;
    size_t first, at, room; /* in out: the first byte of this member, the next byte, the end */
    int partly;             /* stop without an error when there is no more room */
    ex_bits source;
    ex_error *error;
    uint32_t literals[EX_LITERAL_ENTRIES], distances[EX_DISTANCE_ENTRIES];
} ex_inflater;

/* ------------------------------------------------------------------------------------------------------ checksums */

static inline uint32_t ex_adler32(const unsigned char *data, size_t size) {
    uint32_t sum = 1, sums = 0;
    while (size > 0) {
        size_t step = size < 5552 ? size : 5552; /* the most for which 32 bits suffice */
        size -= step;
        for (; step >= 16; step -= 16, data += 16) {
            uint32_t plain = 0, weighted = 0;
            for (uint32_t i = 0; i < 16; ++i) plain += data[i], weighted += (16 - i) * data[i];
            sums += 16 * sum + weighted;
            sum += plain;
        }
        for (; step > 0; --step) sums += sum += *data++;
        sum %= 65521, sums %= 65521;
    }
    return sums << 16 | sum;
}

static inline uint32_t ex_u32(const unsigned char *bytes) {
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

/* Eight bytes at a time: table[k] has the effect of a byte that k more bytes follow. */
static inline uint32_t ex_crc32(const unsigned char *data, size_t size) {
    uint32_t table[8][256], crc = 0xffffffffu;
    for (uint32_t i = 0; i < 256; ++i) {
        table[0][i] = i;
        for (int bit = 0; bit < 8; ++bit) table[0][i] = table[0][i] >> 1 ^ (table[0][i] & 1 ? 0xedb88320u : 0);
    }
    for (size_t k = 1; k < 8; ++k)
        for (size_t i = 0; i < 256; ++i) table[k][i] = table[k - 1][i] >> 8 ^ table[0][table[k - 1][i] & 255];
    for (; size >= 8; size -= 8, data += 8) {
        const uint32_t low = crc ^ ex_u32(data), high = ex_u32(data + 4);
        crc = table[7][low & 255] ^ table[6][low >> 8 & 255] ^ table[5][low >> 16 & 255] ^ table[4][low >> 24] ^
              table[3][high & 255] ^ table[2][high >> 8 & 255] ^ table[1][high >> 16 & 255] ^ table[0][high >> 24];
    }
    for (; size > 0; --size) crc = crc >> 8 ^ table[0][(crc ^ *data++) & 255];
    return ~crc;
}

/* ----------------------------------------------------------------------------------------------------------- bits */

/* Fails at the byte that holds the next bit. */
static inline int ex_inflate_fail(const ex_inflater *z, const char *what) {
    const size_t byte = (size_t)(z->source.next - z->in) - z->source.count / 8;
    return ex_fail(z->error, "%s: packed data: %s at byte %zu of them", z->path, what, byte);
}

/* Afterwards there are 56 bits or more, if the data have as many. */
static inline void ex_fill(ex_bits *from) {
    if (from->end - from->next >= 8) {
        const uint64_t word = (uint64_t)ex_u32(from->next + 4) << 32 | ex_u32(from->next);
        from->bits |= word << from->count;
        from->next += (63 - from->count) >> 3;
        from->count |= 56;
    } else {
        for (; from->count <= 55 && from->next < from->end; from->count += 8)
            from->bits |= (uint64_t)*from->next++ << from->count;
    }
}

static inline uint32_t ex_take(ex_bits *from, unsigned count) {
    const uint32_t value = EX_LOW_BITS(from->bits, count);
    from->bits >>= count;
    from->count -= count;
    return value;
}

/* Takes up to 16 bits. */
static inline int ex_inflate_bits(ex_inflater *z, unsigned count, uint32_t *value) {
    ex_fill(&z->source);
    if (z->source.count < count) return ex_inflate_fail(z, "the end");
    *value = ex_take(&z->source, count);
    return 0;
}

/* Drops the rest of a byte, and gives back whole bytes. */
static inline void ex_inflate_align(ex_bits *from) {
    from->next -= from->count / 8;
    from->bits = 0, from->count = 0;
}

static inline uint32_t ex_find_code(const uint32_t *table, unsigned index_bits, uint64_t bits) {
    const uint32_t entry = table[EX_LOW_BITS(bits, index_bits)];
    if (EX_CODE_KIND(entry) != EX_CODE_TABLE) return entry;
    return table[(entry >> 16) + EX_LOW_BITS(bits >> index_bits, entry >> 8 & 255)];
}

static inline int ex_inflate_code(ex_inflater *z, const uint32_t *table, unsigned index_bits, uint32_t *entry) {
    ex_fill(&z->source);
    *entry = ex_find_code(table, index_bits, z->source.bits);
    if ((*entry & 31) > z->source.count) return ex_inflate_fail(z, "the end");
    if (EX_CODE_KIND(*entry) == EX_CODE_INVALID) return ex_inflate_fail(z, "a code that stands for nothing");
    ex_take(&z->source, *entry & 31);
    return 0;
}

/* ---------------------------------------------------------------------------------------------------------- codes */

/* What a symbol stands for; the alphabets are those of literals and lengths, of distances, and of code lengths. */
static inline uint32_t ex_symbol_entry(int alphabet, unsigned symbol, unsigned length) {
    const unsigned n = symbol - 257;
    if (alphabet == 1) {
        const unsigned extra = symbol < 4 ? 0 : symbol / 2 - 1;
        if (symbol >= 30) return EX_CODE(length, EX_CODE_INVALID, 0, 0);
        return EX_CODE(length, EX_CODE_COPY, extra, symbol < 2 ? symbol + 1 : ((2 + symbol % 2) << extra) + 1);
    }
    if (symbol < 256) return EX_CODE(length, EX_CODE_LITERAL, 0, symbol);
    if (symbol == 256) return EX_CODE(length, EX_CODE_END, 0, 0);
    if (n < 8) return EX_CODE(length, EX_CODE_COPY, 0, n + 3);
    if (n < 28) return EX_CODE(length, EX_CODE_COPY, n / 4 - 1, ((4 + n % 4) << (n / 4 - 1)) + 3);
    return n == 28 ? EX_CODE(length, EX_CODE_COPY, 0, 258) : EX_CODE(length, EX_CODE_INVALID, 0, 0);
}

/* Sorts symbols by the length of their codes. Fails unless the codes are complete; a single code of one bit, or none,
   is enough where `may_lack`. */
static inline int ex_sort_codes(ex_inflater *z, const unsigned char *lengths, unsigned count, int may_lack,
                                unsigned counts[16], uint16_t *sorted) {
    unsigned places[16] = {0}, used = 0;
    memset(counts, 0, 16 * sizeof *counts);
    for (unsigned i = 0; i < count; ++i) ++counts[lengths[i]];
    for (unsigned n = 1; n < 15; ++n) places[n + 1] = places[n] + counts[n];
    for (unsigned n = 1; n < 16; ++n) used += counts[n] << (15 - n);
    if (used > 1u << 15) return ex_inflate_fail(z, "too many codes");
    if (used < 1u << 15 && !(may_lack && (used == 0 || (counts[1] == 1 && used == 1u << 14))))
        return ex_inflate_fail(z, "an incomplete code");
    for (unsigned i = 0; i < count; ++i)
        if (lengths[i]) sorted[places[lengths[i]]++] = (uint16_t)i;
    return 0;
}

/* Codes of the same length follow each other; their first bit is the lowest. So code is the reverse of a number that
   rises, and longer codes go on from it with a 0. */
static inline int ex_build_table(ex_inflater *z, uint32_t *table, unsigned index_bits, int alphabet,
                                 const unsigned char *lengths, unsigned count) {
    unsigned counts[16], code = 0, place = 0, start = 0, bits = 0, prefix = ~0u, end = 1u << index_bits;
    uint16_t sorted[320];
    if (ex_sort_codes(z, lengths, count, alphabet != 2, counts, sorted)) return 1;
    for (unsigned i = 0; i < end; ++i) table[i] = EX_CODE(1, EX_CODE_INVALID, 0, 0);
    for (unsigned length = 1; length < 16; ++length)
        for (; counts[length] > 0; --counts[length], ++place) {
            const uint32_t entry = ex_symbol_entry(alphabet, sorted[place], length);
            unsigned carry = 1u << (length - 1);
            if (length > index_bits && (code & ((1u << index_bits) - 1)) != prefix) {
                unsigned room = counts[length];
                prefix = code & ((1u << index_bits) - 1);
                for (bits = length - index_bits; room < 1u << bits; ++bits)
                    room = 2 * room + counts[bits + 1 + index_bits];
                start = end, end += 1u << bits;
                table[prefix] = EX_CODE(index_bits, EX_CODE_TABLE, bits, start);
            }
            if (length > index_bits)
                for (unsigned i = code >> index_bits; i < 1u << bits; i += 1u << (length - index_bits))
                    table[start + i] = entry;
            else
                for (unsigned i = code; i < 1u << index_bits; i += 1u << length) table[i] = entry;
            while (code & carry) carry >>= 1;
            code = (code & (carry - 1)) + carry;
        }
    return 0;
}

/* Lengths of codes, 0 to 15; 16 repeats the one before, 17 and 18 are runs of zeros. */
static inline int ex_read_lengths(ex_inflater *z, unsigned count, unsigned char *lengths) {
    uint32_t entry, times;
    for (unsigned i = 0; i < count;) {
        if (ex_inflate_code(z, z->literals, 7, &entry)) return 1;
        const unsigned symbol = entry >> 16;
        if (symbol < 16) {
            lengths[i++] = (unsigned char)symbol;
            continue;
        }
        if (symbol == 16 && i == 0) return ex_inflate_fail(z, "a repeated length that none precedes");
        if (ex_inflate_bits(z, symbol == 16 ? 2 : symbol == 17 ? 3 : 7, &times)) return 1;
        times += symbol == 18 ? 11 : 3;
        if (times > count - i) return ex_inflate_fail(z, "more lengths of codes than were announced");
        memset(lengths + i, symbol == 16 ? lengths[i - 1] : 0, times);
        i += times;
    }
    return 0;
}

static inline int ex_dynamic_codes(ex_inflater *z) {
    static const unsigned char order[19] = {16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15};
    unsigned char lengths[320] = {0};
    uint32_t literals, distances, codes, length;
    if (ex_inflate_bits(z, 5, &literals) || ex_inflate_bits(z, 5, &distances) || ex_inflate_bits(z, 4, &codes))
        return 1;
    literals += 257, distances += 1;
    if (literals > 286 || distances > 30) return ex_inflate_fail(z, "too many symbols");
    for (unsigned i = 0; i < codes + 4; ++i) {
        if (ex_inflate_bits(z, 3, &length)) return 1;
        lengths[order[i]] = (unsigned char)length;
    }
    if (ex_build_table(z, z->literals, 7, 2, lengths, 19)) return 1;
    if (ex_read_lengths(z, literals + distances, lengths)) return 1;
    if (lengths[256] == 0) return ex_inflate_fail(z, "no code for the end of a block");
    return ex_build_table(z, z->literals, EX_LITERAL_BITS, 0, lengths, literals) ||
           ex_build_table(z, z->distances, EX_DISTANCE_BITS, 1, lengths + literals, distances);
}

static inline int ex_fixed_codes(ex_inflater *z) {
    unsigned char lengths[288];
    for (int i = 0; i < 288; ++i) lengths[i] = i < 144 ? 8 : i < 256 ? 9 : i < 280 ? 7 : 8;
    if (ex_build_table(z, z->literals, EX_LITERAL_BITS, 0, lengths, 288)) return 1;
    memset(lengths, 5, 32);
    return ex_build_table(z, z->distances, EX_DISTANCE_BITS, 1, lengths, 32);
}

/* --------------------------------------------------------------------------------------------------------- blocks */

/* May write up to 7 bytes beyond the length. */
static inline void ex_copy_match(unsigned char *to, size_t distance, size_t length) {
    const unsigned char *from = to - distance, *end = to + length;
    if (distance >= 8)
        for (; to < end; to += 8, from += 8) memcpy(to, from, 8);
    else if (distance == 1)
        memset(to, *from, length);
    else
        while (to < end) *to++ = *from++;
}

/* Goes on while 16 bytes of data and room for the longest copy are left, and nothing is wrong. */
static inline void ex_inflate_quickly(ex_inflater *z) {
    ex_bits from = z->source;
    unsigned char *out = z->out + z->at;
    while (from.end - from.next >= 16 && z->room - (size_t)(out - z->out) >= 272) {
        ex_fill(&from);
        uint32_t entry = ex_find_code(z->literals, EX_LITERAL_BITS, from.bits);
        for (int i = 0; i < 2 && EX_CODE_KIND(entry) == EX_CODE_LITERAL; ++i) { /* 30 bits at most */
            ex_take(&from, entry & 31);
            *out++ = (unsigned char)(entry >> 16);
            entry = ex_find_code(z->literals, EX_LITERAL_BITS, from.bits);
        }
        if (EX_CODE_KIND(entry) == EX_CODE_LITERAL) continue;
        z->at = (size_t)(out - z->out), z->source = from;
        if (EX_CODE_KIND(entry) != EX_CODE_COPY) return;
        ex_take(&from, entry & 31);
        const size_t length = (entry >> 16) + ex_take(&from, entry >> 8 & 255);
        ex_fill(&from);
        entry = ex_find_code(z->distances, EX_DISTANCE_BITS, from.bits);
        ex_take(&from, entry & 31);
        const size_t distance = (entry >> 16) + ex_take(&from, entry >> 8 & 255);
        if (EX_CODE_KIND(entry) != EX_CODE_COPY || distance > z->at - z->first) return;
        ex_copy_match(out, distance, length);
        out += length;
    }
    z->at = (size_t)(out - z->out), z->source = from;
}

static inline int ex_inflate_full(const ex_inflater *z) {
    char what[64];
    snprintf(what, sizeof what, "more than %zu bytes unpacked", z->room);
    return ex_inflate_fail(z, what);
}

/* Takes one symbol. *ended: it was the end of the block, or there is no more room where that is no error. */
static inline int ex_inflate_symbol(ex_inflater *z, int *ended) {
    uint32_t entry, more;
    if (ex_inflate_code(z, z->literals, EX_LITERAL_BITS, &entry)) return 1;
    *ended = EX_CODE_KIND(entry) == EX_CODE_END;
    if (*ended) return 0;
    *ended = z->partly && z->at == z->room;
    if (z->at == z->room) return *ended ? 0 : ex_inflate_full(z);
    if (EX_CODE_KIND(entry) == EX_CODE_LITERAL) {
        z->out[z->at++] = (unsigned char)(entry >> 16);
        return 0;
    }
    if (ex_inflate_bits(z, entry >> 8 & 255, &more)) return 1;
    size_t length = (entry >> 16) + more;
    if (ex_inflate_code(z, z->distances, EX_DISTANCE_BITS, &entry)) return 1;
    if (ex_inflate_bits(z, entry >> 8 & 255, &more)) return 1;
    const size_t distance = (entry >> 16) + more;
    if (distance > z->at - z->first) return ex_inflate_fail(z, "a distance to before the first byte");
    if (length > z->room - z->at && !z->partly) return ex_inflate_full(z);
    for (; length > 0 && z->at < z->room; --length, ++z->at) z->out[z->at] = z->out[z->at - distance];
    return 0;
}

static inline int ex_inflate_stored(ex_inflater *z) {
    ex_bits *from = &z->source;
    ex_inflate_align(from);
    if (from->end - from->next < 4) return ex_inflate_fail(z, "the end of the data, within the length of a block,");
    size_t length = ex_u32(from->next) & 0xffff;
    if (length != (~ex_u32(from->next) >> 16 & 0xffff)) return ex_inflate_fail(z, "a wrong length of a stored block");
    from->next += 4;
    if (length > z->room - z->at && !z->partly) return ex_inflate_full(z);
    if (length > z->room - z->at) length = z->room - z->at;
    if (length > (size_t)(from->end - from->next)) return ex_inflate_fail(z, "too few bytes for the stored block");
    memcpy(z->out + z->at, from->next, length);
    z->at += length, from->next += length;
    return 0;
}

/* All blocks. */
static inline int ex_inflate_blocks(ex_inflater *z) {
    uint32_t last = 0, kind;
    z->first = z->at;
    while (!last && !(z->partly && z->at == z->room)) {
        if (ex_inflate_bits(z, 1, &last) || ex_inflate_bits(z, 2, &kind)) return 1;
        if (kind == 3) return ex_inflate_fail(z, "a block of unknown kind");
        if (kind == 0 ? ex_inflate_stored(z) : kind == 1 ? ex_fixed_codes(z) : ex_dynamic_codes(z)) return 1;
        for (int ended = kind == 0; !ended;) {
            ex_inflate_quickly(z);
            if (ex_inflate_symbol(z, &ended)) return 1;
        }
    }
    ex_inflate_align(&z->source);
    return 0;
}

/* -------------------------------------------------------------------------------------------------------- wrappings */

static inline int ex_zlib_header(ex_inflater *z) {
    const unsigned char *at = z->source.next;
    if (z->source.end - at < 2) return ex_inflate_fail(z, "the end");
    if ((at[0] & 15) != 8 || at[0] >> 4 > 7 || (at[0] * 256 + at[1]) % 31) return ex_inflate_fail(z, "no zlib header");
    if (at[1] & 32) return ex_inflate_fail(z, "a preset dictionary, which is not supported,");
    z->source.next += 2;
    return 0;
}

/* After ten bytes there may be an extra field, two texts that end with a 0, and half of a CRC of all this. */
static inline int ex_gzip_header(ex_inflater *z) {
    const unsigned char *start = z->source.next, *at = start + 10, *end = z->source.end;
    if (end - start < 10) return ex_inflate_fail(z, "the end");
    if (start[0] != 0x1f || start[1] != 0x8b || start[2] != 8 || start[3] & 0xe0)
        return ex_inflate_fail(z, "no gzip header");
    if (start[3] & 4) {
        const size_t extra = end - at < 2 ? SIZE_MAX : (size_t)(at[0] | at[1] << 8);
        if (extra > (size_t)(end - at) - 2) return ex_inflate_fail(z, "too long an extra field in the gzip header");
        at += 2 + extra;
    }
    for (int flag = 8; flag <= 16; flag *= 2) {
        if (!(start[3] & flag)) continue;
        at = at < end ? (const unsigned char *)memchr(at, 0, (size_t)(end - at)) : NULL;
        if (!at++) return ex_inflate_fail(z, "a text without an end in the gzip header");
    }
    if (start[3] & 2) {
        if (end - at < 2) return ex_inflate_fail(z, "the end");
        if ((ex_crc32(start, (size_t)(at - start)) & 0xffff) != (ex_u32(at - 2) >> 16))
            return ex_inflate_fail(z, "a gzip header with a wrong checksum");
        at += 2;
    }
    z->source.next = at;
    return 0;
}

/* Compares what follows the blocks. */
static inline int ex_inflate_check(ex_inflater *z, ex_packing packing) {
    const unsigned char *at = z->source.next, *data = z->out + z->first;
    const size_t size = z->at - z->first, trailer = packing == EX_PACKED_GZIP ? 8 : 4;
    if ((size_t)(z->source.end - at) < trailer) return ex_inflate_fail(z, "the end, before the checksum,");
    if (packing == EX_PACKED_ZLIB) {
        const uint32_t sum = ex_adler32(data, size);
        if (at[0] != sum >> 24 || at[1] != (sum >> 16 & 255) || at[2] != (sum >> 8 & 255) || at[3] != (sum & 255))
            return ex_inflate_fail(z, "a wrong Adler-32 checksum");
    } else {
        if (ex_crc32(data, size) != ex_u32(at)) return ex_inflate_fail(z, "a wrong CRC-32 checksum");
        if ((uint32_t)(size & 0xffffffffu) != ex_u32(at + 4)) return ex_inflate_fail(z, "a wrong length after the CRC");
    }
    z->source.next += trailer;
    return 0;
}

/* One member after the other, and zeros after the last, which tapes leave. */
static inline int ex_inflate_members(ex_inflater *z, ex_packing packing) {
    int more = 1;
    while (more) {
        if (packing == EX_PACKED_ZLIB ? ex_zlib_header(z) : packing == EX_PACKED_GZIP && ex_gzip_header(z)) return 1;
        if (ex_inflate_blocks(z)) return 1;
        if (z->partly && z->at == z->room) return 0;
        if (packing != EX_PACKED_RAW && ex_inflate_check(z, packing)) return 1;
        const unsigned char *at = z->source.next, *end = z->source.end;
        more = packing == EX_PACKED_GZIP && end - at >= 2 && at[0] == 0x1f && at[1] == 0x8b;
        while (packing == EX_PACKED_GZIP && !more && at < end && *at == 0) ++at;
        if (at == end) z->source.next = at;
    }
    return 0;
}

static inline void ex_inflate_begin(ex_inflater *z, const char *path, const unsigned char *in, size_t in_size,
                                    ex_error *error) {
    z->path = path, z->error = error;
    z->in = z->source.next = in, z->source.end = in + in_size;
    z->source.bits = 0, z->source.count = 0;
    z->first = z->at = 0;
}

/* Unpacks exactly `size` bytes into out. *used receives the number of bytes taken; if it is NULL, all must be. Returns
   0, or fills the error, in which `path` names the file. */
static inline int ex_inflate(const char *path, ex_packing packing, const unsigned char *in, size_t in_size,
                             unsigned char *out, size_t size, size_t *used, ex_error *error) {
    ex_inflater z;
    ex_inflate_begin(&z, path, in, in_size, error);
    z.out = out, z.room = size, z.partly = 0;
    if (ex_inflate_members(&z, packing)) return 1;
    if (z.at != size)
        return ex_fail(error, "%s: packed data: they hold %zu bytes, but %zu are called for", path, z.at, size);
    if (used) *used = (size_t)(z.source.next - in);
    return used || z.source.next == z.source.end ? 0 : ex_inflate_fail(&z, "something else after the end");
}

/* Unpacks the start, up to `most` bytes; *got is their number. Checksums are those of members that end before. */
static inline int ex_inflate_start(const char *path, ex_packing packing, const unsigned char *in, size_t in_size,
                                   unsigned char *out, size_t most, size_t *got, ex_error *error) {
    ex_inflater z;
    ex_inflate_begin(&z, path, in, in_size, error);
    z.out = out, z.room = most, z.partly = 1;
    *got = 0;
    if (ex_inflate_members(&z, packing)) return 1;
    *got = z.at;
    return 0;
}

#endif /* EX_INFLATE_H */
