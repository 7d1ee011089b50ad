/* inflate.h: unpacks data that deflate packed: bare (RFC 1951), as zlib (RFC 1950) or as gzip (RFC 1952, several
   members in a row too), from memory to memory. Checksums and sizes are checked, and nothing is written beyond the room
   given.

   Not read: zlib's preset dictionaries. */

#ifndef EX_INFLATE_H
#define EX_INFLATE_H

#include "checksums.h"

typedef enum ex_packing { EX_PACKED_RAW, EX_PACKED_ZLIB, EX_PACKED_GZIP } ex_packing;

/* An entry of a table of codes has 5 bits for the length of the code, the lowest ones, and 3 for its kind. 8 bits for
   the number of extra bits after the code follow, and 16 for a value. */
enum { EX_CODE_INVALID, EX_CODE_LITERAL, EX_CODE_COPY, EX_CODE_END, EX_CODE_TABLE };
#define EX_CODE(length, kind, extra, value)                                                                            \
    ((uint32_t)(length) | (uint32_t)(kind) << 5 | (uint32_t)(extra) << 8 | (uint32_t)(value) << 16)
#define EX_CODE_KIND(entry)      ((entry) >> 5 & 7)
#define EX_LOW_BITS(bits, count) ((uint32_t)((bits) & (((uint64_t)1 << (count)) - 1)))

/* A table is indexed by the bits that come next, 11 or 9. Longer codes go on in a second table, by all bits up to the
   15th. Codes are complete, so two or more share each of these: of 288 and 32 codes, at most 144 and 16 need one. */
enum { EX_LITERAL_BITS = 11, EX_DISTANCE_BITS = 9, EX_LITERALS = 2048 + 144 * 16, EX_DISTANCES = 512 + 16 * 64 };

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
    uint32_t literals[EX_LITERALS], distances[EX_DISTANCES];
} ex_inflater;

/* ----------------------------------------------------------------------------------------------------------- bits */

/* Fails at the byte that holds the next bit. */
static inline int ex_inflate_fail(const ex_inflater *z, const char *what) {
    const size_t byte = (8 * (size_t)(z->source.next - z->in) - z->source.count) / 8;
    return ex_fail(z->error, "%s: packed data: %s at byte %zu of them", z->path, what, byte);
}

/* Afterwards there are 56 bits or more, if the data have as many; and zeros after the last. */
static inline void ex_fill(ex_bits *from) {
    if (from->end - from->next >= 8) {
        from->bits |= ex_u64(from->next) << from->count;
        from->next += (63 - from->count) >> 3;
        from->count |= 56;
    }
    for (; from->count <= 55 && from->next < from->end; from->count += 8)
        from->bits |= (uint64_t)*from->next++ << from->count;
}

static inline uint32_t ex_take(ex_bits *from, unsigned count) {
    const uint32_t value = EX_LOW_BITS(from->bits, count);
    from->bits >>= count, from->count -= count;
    return value;
}

static inline int ex_inflate_bits(ex_inflater *z, unsigned count, uint32_t *value) {
    ex_fill(&z->source);
    if (z->source.count < count) return ex_inflate_fail(z, "the end");
    *value = ex_take(&z->source, count);
    return 0;
}

/* ---------------------------------------------------------------------------------------------------------- codes */

static inline uint32_t ex_find_code(const uint32_t *table, unsigned index_bits, uint64_t bits) {
    const uint32_t entry = table[EX_LOW_BITS(bits, index_bits)];
    if (EX_CODE_KIND(entry) != EX_CODE_TABLE) return entry;
    return table[(entry >> 16) + EX_LOW_BITS(bits >> index_bits, 15 - index_bits)];
}

/* What a symbol stands for: a literal, the end, or a length or a distance, whose steps double every 4 or 2 symbols. */
static inline uint32_t ex_symbol_entry(int is_distance, unsigned symbol, unsigned length) {
    if (!is_distance && symbol < 256) return EX_CODE(length, EX_CODE_LITERAL, 0, symbol);
    if (!is_distance && symbol == 256) return EX_CODE(length, EX_CODE_END, 0, 0);
    const unsigned n = is_distance ? symbol : symbol - 257, steps = is_distance ? 2 : 4;
    const unsigned extra = n < steps ? 0 : n / steps - 1, least = is_distance ? 1 : 3;
    if (n >= (is_distance ? 30 : 29)) return EX_CODE(length, EX_CODE_INVALID, 0, 0);
    if (!is_distance && n == 28) return EX_CODE(length, EX_CODE_COPY, 0, 258);
    return EX_CODE(length, EX_CODE_COPY, extra, least + (n < steps ? n : (steps + n % steps) << extra));
}

/* Codes of the same length follow each other, in the order of their symbols, after all that are shorter. They must be
   complete; a single code of one bit, or none, is enough where `may_lack`. A code's first bit comes first: the lowest.
 */
static inline int ex_build_table(ex_inflater *z, uint32_t *table, const unsigned char *lengths, unsigned count,
                                 int may_lack) {
    const int is_distance = table == z->distances;
    const unsigned index_bits = is_distance ? EX_DISTANCE_BITS : EX_LITERAL_BITS;
    unsigned counts[16] = {0}, codes[16] = {0}, used = 0, end = 1u << index_bits;
    for (unsigned i = 0; i < count; ++i) ++counts[lengths[i]];
    counts[0] = 0;
    for (unsigned n = 1; n < 16; ++n) codes[n] = (codes[n - 1] + counts[n - 1]) << 1, used += counts[n] << (15 - n);
    if (used > 1u << 15) return ex_inflate_fail(z, "too many codes");
    if (used < 1u << 15 && !(may_lack && (used == 0 || (counts[1] == 1 && used == 1u << 14))))
        return ex_inflate_fail(z, "an incomplete code");
    for (unsigned i = 0; i < end; ++i) table[i] = EX_CODE(1, EX_CODE_INVALID, 0, 0);
    for (unsigned symbol = 0; symbol < count; ++symbol) {
        const unsigned length = lengths[symbol];
        unsigned code = 0, start = 0, bits = index_bits, known = 0;
        for (unsigned n = 0; n < length; ++n) code |= (codes[length] >> (length - 1 - n) & 1) << n;
        if (length == 0) continue;
        ++codes[length];
        if (length > index_bits) {
            uint32_t *link = &table[EX_LOW_BITS(code, index_bits)];
            bits = 15 - index_bits, known = index_bits;
            if (EX_CODE_KIND(*link) != EX_CODE_TABLE) *link = EX_CODE(0, EX_CODE_TABLE, 0, end), end += 1u << bits;
            start = *link >> 16;
        }
        for (unsigned i = code >> known; i < 1u << bits; i += 1u << (length - known))
            table[start + i] = ex_symbol_entry(is_distance, symbol, length);
    }
    return 0;
}

/* The lengths of codes are symbols themselves, 0 to 15; 16 repeats the one before, 17 and 18 are runs of zeros. */
static inline int ex_read_lengths(ex_inflater *z, unsigned count, unsigned char *lengths) {
    for (unsigned i = 0; i < count;) {
        uint32_t times = 1;
        ex_fill(&z->source);
        const uint32_t entry = ex_find_code(z->literals, EX_LITERAL_BITS, z->source.bits), symbol = entry >> 16;
        if (ex_inflate_bits(z, entry & 31, &times)) return 1;
        if (symbol == 16 && i == 0) return ex_inflate_fail(z, "a repeated length that none precedes");
        if (symbol >= 16 && ex_inflate_bits(z, symbol == 16 ? 2 : symbol == 17 ? 3 : 7, &times)) return 1;
        times = symbol < 16 ? 1 : symbol == 18 ? times + 11 : times + 3;
        if (times > count - i) return ex_inflate_fail(z, "more lengths of codes than were announced");
        memset(lengths + i, symbol < 16 ? (int)symbol : symbol == 16 ? lengths[i - 1] : 0, times);
        i += times;
    }
    return 0;
}

static inline int ex_read_codes(ex_inflater *z, int are_dynamic) {
    static const unsigned char order[19] = {16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15};
    unsigned char lengths[320] = {0};
    uint32_t literals = 31, distances = 31, codes = 0, length = 0;
    for (int i = 0; i < 320 && !are_dynamic; ++i)
        lengths[i] = i < 144 ? 8 : i < 256 ? 9 : i < 280 ? 7 : i < 288 ? 8 : 5;
    if (are_dynamic) {
        if (ex_inflate_bits(z, 5, &literals) || ex_inflate_bits(z, 5, &distances)) return 1;
        if (ex_inflate_bits(z, 4, &codes)) return 1;
        if (literals > 29 || distances > 29) return ex_inflate_fail(z, "too many symbols");
        for (unsigned i = 0; i < codes + 4; lengths[order[i++]] = (unsigned char)length)
            if (ex_inflate_bits(z, 3, &length)) return 1;
        if (ex_build_table(z, z->literals, lengths, 19, 0)) return 1;
        if (ex_read_lengths(z, literals + distances + 258, lengths)) return 1;
        if (lengths[256] == 0) return ex_inflate_fail(z, "no code for the end of a block");
    }
    return ex_build_table(z, z->literals, lengths, literals + 257, are_dynamic) ||
           ex_build_table(z, z->distances, lengths + literals + 257, distances + 1, are_dynamic);
}

/* --------------------------------------------------------------------------------------------------------- blocks */

/* Takes literals and matches up to the end of the block, or to the end of the room where that is no error. A length and
   a distance have 48 bits at most; where the data end, more bits are taken than there are, and their count wraps. */
static inline int ex_inflate_codes(ex_inflater *z) {
    ex_bits from = z->source;
    unsigned char *const out = z->out;
    const size_t first = z->first, room = z->room;
    size_t at = z->at;
    const char *wrong = NULL;
    uint32_t kind = EX_CODE_LITERAL;
    while (!wrong && kind != EX_CODE_END && !(z->partly && at == room)) {
        if (from.count < 48) ex_fill(&from);
        uint32_t entry = ex_find_code(z->literals, EX_LITERAL_BITS, from.bits);
        kind = EX_CODE_KIND(entry);
        ex_take(&from, entry & 31);
        if (kind == EX_CODE_LITERAL && at < room && from.count < 64) {
            out[at++] = (unsigned char)(entry >> 16);
        } else if (kind == EX_CODE_COPY && at < room) {
            const size_t length = (entry >> 16) + ex_take(&from, entry >> 8 & 255);
            entry = ex_find_code(z->distances, EX_DISTANCE_BITS, from.bits);
            ex_take(&from, entry & 31);
            const size_t distance = (entry >> 16) + ex_take(&from, entry >> 8 & 255);
            if (EX_CODE_KIND(entry) == EX_CODE_INVALID) wrong = "an invalid code of a distance";
            if (!wrong && distance > at - first) wrong = "a distance to before the first byte";
            if (!wrong && length > room - at && !z->partly) wrong = "more than there is room for";
            const size_t end = wrong ? at : length > room - at ? room : at + length;
            if (distance >= 8 && room - end >= 7) /* up to 7 bytes too many, which are overwritten */
                for (; at < end; at += 8) memcpy(out + at, out + at - distance, 8);
            for (; at < end; ++at) out[at] = out[at - distance];
            at = end;
        } else if (kind != EX_CODE_END) {
            wrong = kind == EX_CODE_INVALID ? "an invalid code" : "more than there is room for";
        }
        if (from.count > 64) wrong = "the end", from.count = 0;
    }
    z->at = at, z->source = from;
    return wrong ? ex_inflate_fail(z, wrong) : 0;
}

/* Drops the rest of a byte, and gives back whole bytes. */
static inline void ex_inflate_align(ex_bits *from) {
    from->next -= from->count / 8;
    from->bits = 0, from->count = 0;
}

static inline int ex_inflate_stored(ex_inflater *z) {
    const size_t left = (size_t)(z->source.end - z->source.next), room = z->room - z->at;
    const uint32_t lengths = left < 4 ? 0 : ex_u32(z->source.next);
    size_t length = lengths & 0xffff;
    if (left < 4 || length != ~lengths >> 16) return ex_inflate_fail(z, "a stored block with a wrong length");
    if (length > room && !z->partly) return ex_inflate_fail(z, "more than there is room for");
    length = length > room ? room : length;
    if (length > left - 4) return ex_inflate_fail(z, "too few bytes for a stored block");
    memcpy(z->out + z->at, z->source.next + 4, length);
    z->at += length, z->source.next += 4 + length;
    return 0;
}

static inline int ex_inflate_blocks(ex_inflater *z) {
    uint32_t last = 0, kind = 0;
    z->first = z->at;
    while (!last && !(z->partly && z->at == z->room)) {
        if (ex_inflate_bits(z, 1, &last) || ex_inflate_bits(z, 2, &kind)) return 1;
        if (kind == 3) return ex_inflate_fail(z, "a block of unknown kind");
        if (kind == 0) ex_inflate_align(&z->source);
        if (kind == 0 ? ex_inflate_stored(z) : ex_read_codes(z, kind == 2) || ex_inflate_codes(z)) return 1;
    }
    ex_inflate_align(&z->source);
    return 0;
}

/* ------------------------------------------------------------------------------------------------------- wrappings */

/* zlib has two bytes. gzip has ten, and then maybe an extra field, two texts that end with a 0, and a checksum. */
static inline int ex_inflate_header(ex_inflater *z, ex_packing packing) {
    const unsigned char *at = z->source.next;
    size_t left = (size_t)(z->source.end - at), size = packing == EX_PACKED_ZLIB ? 2 : 10;
    if (left < size) return ex_inflate_fail(z, "the end");
    if (packing == EX_PACKED_ZLIB) {
        if ((at[0] & 0x8f) != 8 || (at[0] << 8 | at[1]) % 31) return ex_inflate_fail(z, "no zlib header");
        if (at[1] & 32) return ex_inflate_fail(z, "a preset dictionary, which is not supported,");
    } else {
        if ((ex_u32(at) & 0xe0ffffff) != 0x00088b1f) return ex_inflate_fail(z, "no gzip header");
        if (at[3] & 4) size += left < 12 ? 2 : (size_t)(at[10] | at[11] << 8) + 2;
        for (int flag = 8; flag <= 16; flag *= 2)
            for (int is_text = at[3] & flag; is_text && size <= left; ++size) is_text = size < left && at[size] != 0;
        size += at[3] & 2;
        if (size > left) return ex_inflate_fail(z, "the end, within a gzip header,");
    }
    z->source.next += size;
    return 0;
}

/* Compares what follows the blocks. zlib's number begins with its highest byte. */
static inline int ex_inflate_check(ex_inflater *z, int is_zlib) {
    const unsigned char *at = z->source.next, *data = z->out + z->first;
    const size_t size = z->at - z->first;
    if (z->source.end - at < (is_zlib ? 4 : 8)) return ex_inflate_fail(z, "the end, before the checksum,");
    const uint32_t sum = is_zlib ? ex_adler32(data, size) : ex_crc32(data, size), said = ex_u32(at);
    const uint32_t turned = said >> 24 | (said >> 8 & 0xff00) | (said & 0xff00) << 8 | said << 24;
    if (sum != (is_zlib ? turned : said)) return ex_inflate_fail(z, "a wrong checksum");
    if (!is_zlib && (size & 0xffffffff) != ex_u32(at + 4)) return ex_inflate_fail(z, "a wrong length of the data");
    z->source.next += is_zlib ? 4 : 8;
    return 0;
}

/* Takes all members, and zeros after the last, which tapes leave. */
static inline int ex_inflate_members(ex_inflater *z, ex_packing packing, const unsigned char *in, size_t in_size) {
    const ex_bits start = {0, 0, in, in + in_size};
    z->in = in, z->source = start, z->at = 0;
    for (int more = 1; more;) {
        if ((packing != EX_PACKED_RAW && ex_inflate_header(z, packing)) || ex_inflate_blocks(z)) return 1;
        if (z->partly && z->at == z->room) return 0;
        if (packing != EX_PACKED_RAW && ex_inflate_check(z, packing == EX_PACKED_ZLIB)) return 1;
        const unsigned char *at = z->source.next, *end = z->source.end;
        more = packing == EX_PACKED_GZIP && end - at >= 2 && at[0] == 0x1f && at[1] == 0x8b;
        while (packing == EX_PACKED_GZIP && !more && at < end && *at == 0) ++at;
        if (at == end) z->source.next = at;
    }
    return 0;
}

/* Unpacks exactly `size` bytes into out. *used receives the number of bytes taken; if it is NULL, all must be. Returns
   0, or fills the error, in which `path` names the file. */
static inline int ex_inflate(const char *path, ex_packing packing, const unsigned char *in, size_t in_size,
                             unsigned char *out, size_t size, size_t *used, ex_error *error) {
    ex_inflater z;
    z.path = path, z.error = error, z.out = out, z.room = size, z.partly = 0;
    if (ex_inflate_members(&z, packing, in, in_size)) return 1;
    if (z.at != size) return ex_fail(error, "%s: packed data: %zu bytes, but %zu are called for", path, z.at, size);
    if (used) *used = (size_t)(z.source.next - in);
    return used || z.source.next == z.source.end ? 0 : ex_inflate_fail(&z, "something else after the end");
}

/* Unpacks the start, up to `most` bytes; *got is their number. Only members that end within them are checked. */
static inline int ex_inflate_start(const char *path, ex_packing packing, const unsigned char *in, size_t in_size,
                                   unsigned char *out, size_t most, size_t *got, ex_error *error) {
    ex_inflater z;
    z.path = path, z.error = error, z.out = out, z.room = most, z.partly = 1;
    *got = 0;
    if (ex_inflate_members(&z, packing, in, in_size)) return 1;
    return *got = z.at, 0;
}

#endif /* EX_INFLATE_H */
