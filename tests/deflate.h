/* A writer of deflate, zlib, gzip and zip, for tests of readers: it follows RFC 1950, 1951 and 1952 by their tables and
   by bits, and knows nothing of examples/inflate.h. Include after check.h. */

#ifndef DEFLATE_H
#define DEFLATE_H

/* Bytes under construction; bits fill each byte from its lowest on. */
typedef struct deflater {
    unsigned char *out;
    size_t room, count;
    unsigned bit; /* bits in the last byte; 0: it is full */
} deflater;

static inline void deflate_bit(deflater *d, unsigned bit) {
    if (d->bit == 0) {
        if (!CHECK(d->count < d->room)) exit(check_report());
        d->out[d->count++] = 0;
    }
    d->out[d->count - 1] = (unsigned char)(d->out[d->count - 1] | bit << d->bit);
    d->bit = (d->bit + 1) % 8;
}

/* A number, its lowest bit first. */
static inline void deflate_number(deflater *d, unsigned number, unsigned bits) {
    for (unsigned i = 0; i < bits; ++i) deflate_bit(d, number >> i & 1);
}

/* A code, its highest bit first. */
static inline void deflate_code(deflater *d, unsigned code, unsigned bits) {
    while (bits-- > 0) deflate_bit(d, code >> bits & 1);
}

static inline void deflate_bytes(deflater *d, const void *data, size_t size) {
    d->bit = 0;
    for (size_t i = 0; i < size; ++i) deflate_number(d, ((const unsigned char *)data)[i], 8);
}

/* ----------------------------------------------------------------------------------------------------------- codes */

enum { LITERALS = 288, DISTANCES = 32 };

/* Lengths of codes and the codes. */
typedef struct deflate_codes {
    unsigned char literal[LITERALS], distance[DISTANCES];
} deflate_codes;

/* Code number `symbol`: codes of a length count upwards, after all that are shorter. */
static inline void deflate_symbol(deflater *d, const unsigned char *lengths, unsigned count, unsigned symbol) {
    unsigned code = 0;
    for (unsigned n = 1; n <= lengths[symbol]; ++n, code <<= 1) {
        for (unsigned i = 0; i < count; ++i)
            if (lengths[i] == n && (n < lengths[symbol] || i < symbol)) ++code;
        if (n == lengths[symbol]) break;
    }
    if (CHECK(lengths[symbol] > 0)) deflate_code(d, code, lengths[symbol]);
}

static inline void deflate_fixed_codes(deflate_codes *codes) {
    for (int i = 0; i < LITERALS; ++i) codes->literal[i] = i <= 143 ? 8 : i <= 255 ? 9 : i <= 279 ? 7 : 8;
    memset(codes->distance, 5, DISTANCES);
}

/* A complete set of codes for those symbols that have a 1 in `lengths`: `skew` codes of 1, 2, 3 ... bits, and the
   others with equally many, or one less. */
static inline void deflate_complete(unsigned char *lengths, unsigned count, unsigned skew) {
    unsigned used = 0, bits = 0, place = 0;
    for (unsigned i = 0; i < count; ++i) used += lengths[i];
    if (used < 2) return;
    if (skew > used - 2) skew = used - 2;
    while ((1u << bits) < used) ++bits;
    if (skew > 15 - bits) skew = 15 - bits; /* no code may have more than 15 bits */
    for (bits = 0; (1u << bits) < used - skew;) ++bits;
    const unsigned shorter = (1u << bits) - (used - skew);
    for (unsigned i = 0; i < count; ++i) {
        if (!lengths[i]) continue;
        lengths[i] = (unsigned char)(place < skew ? place + 1 : skew + bits - (place < skew + shorter));
        ++place;
    }
}

/* ---------------------------------------------------------------------------------------------------------- blocks */

/* A literal, or a copy of `length` bytes from `distance` before. */
typedef struct deflate_token {
    unsigned literal, length, distance; /* length 0: a literal */
} deflate_token;

/* RFC 1951, 3.2.5: the least length and distance of each symbol */
static const unsigned deflate_lengths[] = {3,  4,  5,  6,  7,  8,  9,  10, 11,  13,  15,  17,  19,  23,  27,
                                           31, 35, 43, 51, 59, 67, 83, 99, 115, 131, 163, 195, 227, 258, 259};
static const unsigned deflate_length_bits[] = {0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2,
                                               2, 3, 3, 3, 3, 4, 4, 4, 4, 5, 5, 5, 5, 0};
static const unsigned deflate_distances[] = {1,    2,    3,    4,    5,    7,     9,     13,    17,   25,   33,
                                             49,   65,   97,   129,  193,  257,   385,   513,   769,  1025, 1537,
                                             2049, 3073, 4097, 6145, 8193, 12289, 16385, 24577, 32769};
static const unsigned deflate_distance_bits[] = {0, 0, 0, 0, 1, 1, 2, 2,  3,  3,  4,  4,  5,  5,  6,
                                                 6, 7, 7, 8, 8, 9, 9, 10, 10, 11, 11, 12, 12, 13, 13};

static inline unsigned deflate_find(const unsigned *least, unsigned value) {
    unsigned i = 0;
    while (value >= least[i + 1]) ++i;
    return i;
}

static inline void deflate_mark(const deflate_token *tokens, size_t count, deflate_codes *codes) {
    memset(codes, 0, sizeof *codes);
    codes->literal[256] = 1;
    for (size_t i = 0; i < count; ++i) {
        if (tokens[i].length == 0) {
            codes->literal[tokens[i].literal] = 1;
            continue;
        }
        codes->literal[257 + deflate_find(deflate_lengths, tokens[i].length)] = 1;
        codes->distance[deflate_find(deflate_distances, tokens[i].distance)] = 1;
    }
}

static inline void deflate_put_token(deflater *d, const deflate_codes *codes, const deflate_token *token) {
    const unsigned l = deflate_find(deflate_lengths, token->length < 3 ? 3 : token->length);
    const unsigned s = deflate_find(deflate_distances, token->distance < 1 ? 1 : token->distance);
    if (token->length == 0) {
        deflate_symbol(d, codes->literal, LITERALS, token->literal);
        return;
    }
    deflate_symbol(d, codes->literal, LITERALS, 257 + l);
    deflate_number(d, token->length - deflate_lengths[l], deflate_length_bits[l]);
    deflate_symbol(d, codes->distance, DISTANCES, s);
    deflate_number(d, token->distance - deflate_distances[s], deflate_distance_bits[s]);
}

static inline void deflate_stored(deflater *d, const unsigned char *data, unsigned size, unsigned last) {
    deflate_number(d, last, 3);
    d->bit = 0;
    deflate_number(d, size, 16);
    deflate_number(d, ~size & 0xffff, 16);
    deflate_bytes(d, data, size);
}

static inline void deflate_tokens(deflater *d, const deflate_codes *codes, const deflate_token *tokens, size_t count) {
    const deflate_token end = {256, 0, 0};
    for (size_t i = 0; i < count; ++i) deflate_put_token(d, codes, &tokens[i]);
    deflate_put_token(d, codes, &end);
}

/* The two lists of lengths, by symbols for lengths and, with `runs`, for runs of them. */
static inline void deflate_put_codes(deflater *d, const deflate_codes *codes, int runs) {
    static const unsigned char order[19] = {16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15};
    unsigned char all[320], own[19];
    memcpy(all, codes->literal, 286);
    memcpy(all + 286, codes->distance, 30);
    memset(own, 1, sizeof own);
    deflate_complete(own, 19, 2);
    deflate_number(d, 286 - 257, 5);
    deflate_number(d, 30 - 1, 5);
    deflate_number(d, 19 - 4, 4);
    for (int i = 0; i < 19; ++i) deflate_number(d, own[order[i]], 3);
    for (unsigned i = 0, n; i < 316; i += n) {
        const unsigned limit = all[i] ? 7 : 138;
        for (n = 1; i + n < 316 && all[i + n] == all[i] && n < limit;) ++n;
        if (!runs || n < 4) n = 1;
        if (n == 1 || all[i]) deflate_symbol(d, own, 19, all[i]);
        if (n > 1 && all[i]) deflate_symbol(d, own, 19, 16), deflate_number(d, n - 1 - 3, 2);
        if (n > 1 && !all[i] && n < 11) deflate_symbol(d, own, 19, 17), deflate_number(d, n - 3, 3);
        if (n > 1 && !all[i] && n >= 11) deflate_symbol(d, own, 19, 18), deflate_number(d, n - 11, 7);
    }
}

static inline void deflate_fixed(deflater *d, const deflate_token *tokens, size_t count, unsigned last) {
    deflate_codes codes;
    deflate_fixed_codes(&codes);
    deflate_number(d, last | 1 << 1, 3);
    deflate_tokens(d, &codes, tokens, count);
}

static inline void deflate_dynamic(deflater *d, const deflate_token *tokens, size_t count, unsigned last,
                                   unsigned skew) {
    deflate_codes codes;
    deflate_mark(tokens, count, &codes);
    deflate_complete(codes.literal, LITERALS, skew);
    deflate_complete(codes.distance, DISTANCES, skew);
    deflate_number(d, last | 2 << 1, 3);
    deflate_put_codes(d, &codes, skew % 2 == 0);
    deflate_tokens(d, &codes, tokens, count);
}

/* Finds copies by looking back, at most 300 bytes. Returns the number of tokens. */
static inline size_t deflate_match(const unsigned char *data, size_t size, deflate_token *tokens) {
    size_t count = 0;
    for (size_t at = 0; at < size;) {
        deflate_token best = {data[at], 0, 0};
        for (unsigned distance = 1; distance <= 300 && distance <= at; ++distance) {
            unsigned n = 0;
            while (n < 258 && at + n < size && data[at + n - distance] == data[at + n]) ++n;
            if (n >= 3 && n > best.length) best.length = n, best.distance = distance;
        }
        at += best.length ? best.length : 1;
        tokens[count++] = best;
    }
    return count;
}

/* ------------------------------------------------------------------------------------------------------- wrappings */

static inline uint32_t deflate_crc(const unsigned char *data, size_t size) {
    uint32_t crc = 0xffffffffu;
    for (size_t i = 0; i < size; ++i) {
        crc ^= data[i];
        for (int bit = 0; bit < 8; ++bit) crc = crc & 1 ? crc >> 1 ^ 0xedb88320u : crc >> 1;
    }
    return crc ^ 0xffffffffu;
}

static inline uint32_t deflate_adler(const unsigned char *data, size_t size) {
    uint32_t a = 1, b = 0;
    for (size_t i = 0; i < size; ++i) a = (a + data[i]) % 65521, b = (b + a) % 65521;
    return b << 16 | a;
}

typedef enum wrapping { BARE, ZLIB, GZIP } wrapping;

static inline void deflate_begin(deflater *d, wrapping kind) {
    static const unsigned char gzip[10] = {0x1f, 0x8b, 8, 0, 1, 2, 3, 4, 0, 3};
    if (kind == ZLIB) deflate_bytes(d, "\x78\x9c", 2);
    if (kind == GZIP) deflate_bytes(d, gzip, sizeof gzip);
}

static inline void deflate_end(deflater *d, wrapping kind, const unsigned char *data, size_t size) {
    const uint32_t adler = deflate_adler(data, size), crc = deflate_crc(data, size);
    d->bit = 0;
    for (int i = 3; i >= 0 && kind == ZLIB; --i) deflate_number(d, adler >> 8 * i & 255, 8);
    if (kind == GZIP) deflate_number(d, crc, 32), deflate_number(d, (unsigned)size, 32);
}

/* All of the data in one dynamic block. */
static inline size_t deflate_all(wrapping kind, const void *data, size_t size, unsigned char *out, size_t room) {
    deflater d = {out, room, 0, 0};
    deflate_token *tokens = (deflate_token *)calloc(size + 1, sizeof *tokens);
    if (!CHECK(tokens != NULL)) return 0;
    deflate_begin(&d, kind);
    deflate_dynamic(&d, tokens, deflate_match((const unsigned char *)data, size, tokens), 1, 4);
    deflate_end(&d, kind, (const unsigned char *)data, size);
    free(tokens);
    return d.count;
}

/* ------------------------------------------------------------------------------------------------------------- zip */

/* What both headers of a member have: version, flags, method, time, date, checksum, sizes, length of the name. */
static inline void zip_fields(deflater *d, int method, uint32_t crc, size_t packed, size_t size, const char *name) {
    deflate_number(d, 20, 16);
    deflate_number(d, 0, 16);
    deflate_number(d, (unsigned)method, 16);
    deflate_number(d, 0x5821a000, 32);
    deflate_number(d, crc, 32);
    deflate_number(d, (unsigned)packed, 32);
    deflate_number(d, (unsigned)size, 32);
    deflate_number(d, (unsigned)strlen(name), 16);
}

typedef struct zip_member {
    const char *name;
    const void *data;
    size_t size;
    int method; /* 0: stored, 8: deflated */
} zip_member;

/* The members, with an extra field of 4 bytes in each one's own header; then the list of them. */
static inline size_t zip_all(const zip_member *members, int count, unsigned char *out, size_t room) {
    static unsigned char packed[1 << 16];
    size_t starts[8], sizes[8];
    deflater d = {out, room, 0, 0};
    for (int i = 0; i < count; ++i) {
        const zip_member *m = &members[i];
        sizes[i] = m->method ? deflate_all(BARE, m->data, m->size, packed, sizeof packed) : m->size;
        starts[i] = d.count;
        deflate_bytes(&d, "PK\3\4", 4);
        zip_fields(&d, m->method, deflate_crc((const unsigned char *)m->data, m->size), sizes[i], m->size, m->name);
        deflate_number(&d, 4, 16);
        deflate_bytes(&d, m->name, strlen(m->name));
        deflate_bytes(&d, "\xfe\xca\0\0", 4);
        deflate_bytes(&d, m->method ? packed : m->data, sizes[i]);
    }
    const size_t list = d.count;
    for (int i = 0; i < count; ++i) {
        const zip_member *m = &members[i];
        deflate_bytes(&d, "PK\1\2\24\3", 6);
        zip_fields(&d, m->method, deflate_crc((const unsigned char *)m->data, m->size), sizes[i], m->size, m->name);
        deflate_bytes(&d, "\0\0\0\0\0\0\0\0\0\0\0\0", 12);
        deflate_number(&d, (unsigned)starts[i], 32);
        deflate_bytes(&d, m->name, strlen(m->name));
    }
    const size_t end = d.count;
    deflate_bytes(&d, "PK\5\6\0\0\0\0", 8);
    deflate_number(&d, (unsigned)count, 16);
    deflate_number(&d, (unsigned)count, 16);
    deflate_number(&d, (unsigned)(end - list), 32);
    deflate_number(&d, (unsigned)list, 32);
    deflate_number(&d, 0, 16);
    return d.count;
}

#endif
