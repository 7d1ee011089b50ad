/* examples/inflate.h: data that tests/deflate.h packed come back bit for bit; anything that RFC 1950, 1951 and 1952 do
   not allow ends in one line that names the file and the byte; and nothing is written beyond the room given. */

#include "check.h"
#include "inflate.h"
#include "deflate.h"

enum { SIZE_MAX_HERE = 160000, ROOM = 400000 };

static unsigned char data[SIZE_MAX_HERE], packed[ROOM];
static deflate_token tokens[SIZE_MAX_HERE + 1];

static check_random numbers = {49};
static unsigned below(unsigned end) { return (unsigned)(check_next(&numbers) * end); }

/* Unpacks into memory of exactly that size, so that a sanitizer sees what is written beyond it. Whether it gives `size`
   bytes that are the same as in data. */
static int gives(wrapping kind, const unsigned char *in, size_t in_size, size_t size, ex_error *error) {
    unsigned char *from = (unsigned char *)malloc(in_size + 1), *out = (unsigned char *)malloc(size + 1);
    int good = 0;
    error->text[0] = '\0';
    if (CHECK(from && out)) {
        from = from + 1; /* the last byte is the last of the allocation */
        memcpy(from, in, in_size);
        out[size] = 0xa5;
        good = ex_inflate("file", (ex_packing)kind, from, in_size, out, size, NULL, error) == 0;
        CHECK(out[size] == 0xa5);
        if (good && !CHECK(memcmp(out, data, size) == 0)) printf("    other bytes than were packed\n");
        if (!good && !CHECK(strncmp(error->text, "file: packed data: ", 19) == 0)) printf("    %s\n", error->text);
        from = from - 1;
    }
    free(from);
    free(out);
    return good;
}

/* Random data with runs and repetitions, of all bytes or few. */
static void fill_data(size_t size, unsigned letters) {
    for (size_t i = 0; i < size;) {
        const unsigned kind = below(3), length = 1 + below(kind == 0 ? 4 : 40), back = 1 + below(200);
        for (unsigned k = 0; k < length && i < size; ++k, ++i)
            data[i] = (unsigned char)(kind == 0 || i < back ? below(letters) : data[i - (kind == 1 ? 1 : back)]);
    }
}

static const size_t sizes[] = {0, 1, 2, 7, 8, 9, 300, 1000, 5552, 5553, 20000};
enum { SIZE_COUNT = sizeof sizes / sizeof *sizes };

/* Every kind of block, wrapping and size, for many shapes of codes: up to 15 bits. */
static void test_every_block(void) {
    for (size_t s = 0; s < SIZE_COUNT; ++s)
        for (unsigned shape = 0; shape < 10; ++shape) {
            const size_t size = sizes[s];
            ex_error error;
            fill_data(size, shape % 3 == 0 ? 256 : shape % 3 == 1 ? 20 : 2);
            const size_t count = deflate_match(data, size, tokens);
            for (int kind = BARE; kind <= GZIP; ++kind) {
                deflater d = {packed, ROOM, 0, 0};
                deflate_begin(&d, (wrapping)kind);
                if (shape == 0) deflate_stored(&d, data, (unsigned)size, 1);
                if (shape == 1) deflate_fixed(&d, tokens, count, 1);
                if (shape > 1) deflate_dynamic(&d, tokens, count, 1, shape - 2);
                deflate_end(&d, (wrapping)kind, data, size);
                if (!CHECK(gives((wrapping)kind, packed, d.count, size, &error)))
                    printf("    %zu bytes, shape %u, wrapping %d: %s\n", size, shape, kind, error.text);
            }
        }
}

/* Blocks of all kinds in one stream, which copies cross. */
static void test_several_blocks(void) {
    ex_error error;
    fill_data(60000, 9);
    const size_t count = deflate_match(data, 60000, tokens);
    deflater d = {packed, ROOM, 0, 0};
    size_t bytes = 0;
    deflate_begin(&d, GZIP);
    for (size_t i = 0, n; i < count; i += n) {
        const unsigned kind = below(4);
        size_t length = 0;
        n = 1 + below(900);
        if (n > count - i) n = count - i;
        for (size_t k = i; k < i + n; ++k) length += tokens[k].length ? tokens[k].length : 1;
        if (kind == 0 && length <= 65535)
            deflate_stored(&d, data + bytes, (unsigned)length, 0);
        else if (kind <= 1)
            deflate_fixed(&d, tokens + i, n, 0);
        else
            deflate_dynamic(&d, tokens + i, n, 0, below(8));
        bytes += length;
    }
    deflate_fixed(&d, tokens, 0, 1); /* an empty one */
    deflate_end(&d, GZIP, data, bytes);
    if (!CHECK(gives(GZIP, packed, d.count, 60000, &error))) printf("    %s\n", error.text);
}

/* Every length, at many distances up to 32768; one after the other. */
static void test_every_copy(void) {
    static const unsigned distances[] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 15, 16, 17, 255, 257, 4097, 32767, 32768};
    size_t count = 0, at = 0;
    ex_error error;
    for (; at < 32768; ++at) data[at] = (unsigned char)below(256), tokens[count++].literal = data[at];
    for (size_t i = 0; i < count; ++i) tokens[i].length = 0;
    for (unsigned length = 3; length <= 258; ++length) {
        const unsigned distance = distances[length % (sizeof distances / sizeof *distances)];
        const deflate_token token = {0, length, distance};
        tokens[count++] = token;
        for (unsigned k = 0; k < length; ++k, ++at) data[at] = data[at - distance];
    }
    for (unsigned symbol = 0; symbol < 30; ++symbol) { /* the first and the last distance of each symbol */
        for (int end = 0; end < 2; ++end) {
            const deflate_token token = {0, 3, end ? deflate_distances[symbol + 1] - 1 : deflate_distances[symbol]};
            tokens[count++] = token;
            for (unsigned k = 0; k < 3; ++k, ++at) data[at] = data[at - token.distance];
        }
    }
    for (unsigned i = 0; i < 200; ++i) { /* with codes of 15 bits each, and 5 and 13 more */
        const deflate_token zero = {0, 0, 0}, token = {0, 227 + i % 31, 32768 - i};
        for (unsigned k = 0; k < 9 + i % 8; ++k) data[at++] = 0, tokens[count++] = zero; /* one bit each */
        tokens[count++] = token;
        for (unsigned k = 0; k < token.length; ++k, ++at) data[at] = data[at - token.distance];
    }
    for (unsigned kind = 0; kind < 3; ++kind) {
        deflater d = {packed, ROOM, 0, 0};
        if (kind == 0)
            deflate_fixed(&d, tokens, count, 1);
        else
            deflate_dynamic(&d, tokens, count, 1, 7 * kind);
        if (!CHECK(gives(BARE, packed, d.count, at, &error))) printf("    %s\n", error.text);
    }
}

/* Streams and checksums of others: RFC 1950's check of "123456789" and what common programs write for a short text. */
static void test_known_data(void) {
    static const unsigned char zlib[] = {0x78, 0x9c, 0xcb, 0x48, 0xcd, 0xc9, 0xc9, 0x57,
                                         0xc8, 0xc0, 0x20, 0x01, 0x70, 0xd4, 0x08, 0xd1};
    const char *text = "hello hello hello hello ";
    ex_error error;
    memcpy(data, text, strlen(text));
    CHECK(ex_crc32((const unsigned char *)"123456789", 9) == 0xcbf43926u);
    CHECK(ex_adler32((const unsigned char *)"Wikipedia", 9) == 0x11e60398u);
    CHECK(ex_crc32(data, 0) == 0 && ex_adler32(data, 0) == 1);
    if (!CHECK(gives(ZLIB, zlib, sizeof zlib, strlen(text), &error))) printf("    %s\n", error.text);
    memset(data, 255, SIZE_MAX_HERE); /* the largest sums */
    for (size_t size = 0; size < SIZE_MAX_HERE; size += 1 + size / 3) {
        CHECK(ex_adler32(data, size) == deflate_adler(data, size));
        CHECK(ex_crc32(data, size) == deflate_crc(data, size));
    }
}

/* ---------------------------------------------------------------------------------------------------- damaged data */

/* A stream that ends at any byte is refused, in every kind of block. */
static void test_truncated(void) {
    for (unsigned shape = 0; shape < 8; ++shape) {
        ex_error error;
        fill_data(400, 30);
        const size_t count = deflate_match(data, 400, tokens);
        deflater d = {packed, ROOM, 0, 0};
        deflate_begin(&d, (wrapping)(shape % 3));
        if (shape < 2) deflate_stored(&d, data, 400, 1);
        if (shape >= 2 && shape < 5) deflate_fixed(&d, tokens, count, 1);
        if (shape >= 5) deflate_dynamic(&d, tokens, count, 1, shape);
        deflate_end(&d, (wrapping)(shape % 3), data, 400);
        for (size_t length = 0; length < d.count; ++length)
            if (!CHECK(!gives((wrapping)(shape % 3), packed, length, 400, &error)))
                printf("    shape %u, %zu of %zu bytes\n", shape, length, d.count);
        CHECK(gives((wrapping)(shape % 3), packed, d.count, 400, &error));
    }
}

/* Any bit that is flipped is noticed, or means nothing; in a bare stream, nothing worse than other bytes happens. */
static void test_flipped(void) {
    for (int kind = ZLIB; kind <= GZIP; ++kind) {
        int refused = 0;
        ex_error error;
        fill_data(300, 30);
        const size_t count = deflate_all((wrapping)kind, data, 300, packed, ROOM);
        for (size_t bit = 0; bit < 8 * count; ++bit) {
            packed[bit / 8] = (unsigned char)(packed[bit / 8] ^ 1 << bit % 8);
            refused += !gives((wrapping)kind, packed, count, 300, &error);
            packed[bit / 8] = (unsigned char)(packed[bit / 8] ^ 1 << bit % 8);
        }
        CHECK(refused >= (int)(8 * count) - 70); /* gzip's time, level and system: 48 bits; its flags; unused bits */
    }
}

static void test_noise(void) {
    for (int i = 0; i < 20000; ++i) {
        static unsigned char out[1000];
        const size_t size = below(60);
        size_t used = 0;
        ex_error error;
        for (size_t k = 0; k < size; ++k) packed[k] = (unsigned char)below(256);
        if (i % 2) packed[0] = (unsigned char)((packed[0] & ~7) | 5);
        if (ex_inflate("file", EX_PACKED_RAW, packed, size, out, below(1000), &used, &error) == 0) CHECK(used <= size);
    }
}

/* The header of a dynamic block: 257 or more literals, distances, and 19 lengths of codes, all 0 but for two of 1 bit.
   Those are `a` and `b` in RFC 1951's order,
   which begins with 16 17 18 0 and ends with 2 14 1 15. */
static void put_dynamic_start(deflater *d, unsigned literals, unsigned distances, unsigned a, unsigned b) {
    deflate_number(d, 1 | 2 << 1, 3);
    deflate_number(d, literals - 257, 5);
    deflate_number(d, distances - 1, 5);
    deflate_number(d, 19 - 4, 4);
    for (unsigned i = 0; i < 19; ++i) deflate_number(d, i == a || i == b, 3);
}

static void check_broken(const deflater *d, const char *words) {
    ex_error error;
    if (!CHECK(!gives(BARE, packed, d->count, 10, &error)) || !CHECK(strstr(error.text, words) != NULL))
        printf("    '%s' is not in: %s\n", words, error.text);
}

static deflater begin_broken(void) {
    const deflater d = {packed, ROOM, 0, 0};
    memset(packed, 0, 200);
    return d;
}

/* Codes of which there are too many or too few. */
static void test_wrong_codes(void) {
    deflater d = begin_broken();
    deflate_number(&d, 7, 3);
    check_broken(&d, "a block of unknown kind at byte 0");
    for (unsigned too_many = 30; too_many < 32; ++too_many) {
        d = begin_broken();
        put_dynamic_start(&d, 257 + too_many, 1, 3, 17);
        check_broken(&d, "too many symbols at byte 2");
        d = begin_broken();
        put_dynamic_start(&d, 257, 1 + too_many, 3, 17);
        check_broken(&d, "too many symbols at byte 2");
    }
    d = begin_broken();
    put_dynamic_start(&d, 257, 1, 3, 3); /* one code of one bit, where two are needed */
    check_broken(&d, "an incomplete code");
    d = begin_broken();
    deflate_number(&d, 1 | 2 << 1, 3), deflate_number(&d, 0, 10), deflate_number(&d, 15, 4);
    for (int i = 0; i < 19; ++i) deflate_number(&d, 1, 3);
    check_broken(&d, "too many codes");
    d = begin_broken();
    put_dynamic_start(&d, 257, 1, 0, 17); /* codes for "repeat" (1) and for a length of 1 (0) */
    deflate_number(&d, 1, 1), deflate_number(&d, 0, 2);
    check_broken(&d, "a repeated length that none precedes");
    d = begin_broken();
    put_dynamic_start(&d, 257, 1, 0, 17);
    deflate_number(&d, 0, 1);
    for (int i = 0; i < 43; ++i) deflate_number(&d, 1, 1), deflate_number(&d, 3, 2); /* 1 + 43 * 6 = 259 of 258 */
    check_broken(&d, "more lengths of codes than were announced");
    d = begin_broken();
    put_dynamic_start(&d, 257, 1, 3, 17); /* lengths 0 (0) and 1 (1) */
    for (int i = 0; i < 258; ++i) deflate_number(&d, i < 2, 1);
    check_broken(&d, "no code for the end of a block");
    d = begin_broken();
    put_dynamic_start(&d, 257, 1, 3, 17);
    for (int i = 0; i < 258; ++i) deflate_number(&d, i < 2 || i == 256, 1); /* three literals of one bit */
    check_broken(&d, "too many codes");
    d = begin_broken();
    put_dynamic_start(&d, 257, 3, 3, 17);
    for (int i = 0; i < 260; ++i) deflate_number(&d, i == 0 || i >= 256, 1); /* three distances of one bit */
    check_broken(&d, "too many codes");
    d = begin_broken();
    put_dynamic_start(&d, 257, 2, 3, 15); /* lengths 0 and 2: two distances of two bits, literals complete */
    for (int i = 0; i < 259; ++i) deflate_number(&d, (i < 3 || i >= 256), 1);
    check_broken(&d, "an incomplete code");
}

/* A single code of one bit is complete enough; its other bit stands for nothing. */
static void test_single_codes(void) {
    ex_error error;
    deflater d = begin_broken();
    put_dynamic_start(&d, 257, 1, 3, 17);
    for (int i = 0; i < 258; ++i) deflate_number(&d, i == 256, 1); /* only the end of the block */
    const deflater kept = d;
    deflate_number(&d, 0, 1);
    if (!CHECK(gives(BARE, packed, d.count, 0, &error))) printf("    %s\n", error.text);
    d = kept;
    deflate_number(&d, 1, 1);
    check_broken(&d, "an invalid code");
    for (int none = 0; none < 2; ++none) { /* one distance, whose other bit is used; or none */
        static const deflate_token copy[2] = {{'a', 0, 0}, {0, 3, 1}};
        deflate_codes codes;
        deflate_mark(copy, 2, &codes);
        deflate_complete(codes.literal, LITERALS, 0);
        if (none) codes.distance[0] = 0;
        d = begin_broken();
        deflate_number(&d, 1 | 2 << 1, 3);
        deflate_put_codes(&d, &codes, 1);
        deflate_symbol(&d, codes.literal, LITERALS, 'a');
        deflate_symbol(&d, codes.literal, LITERALS, 257);
        deflate_number(&d, none ? 0 : 1, 30);
        check_broken(&d, "an invalid code of a distance");
    }
}

/* Copies and symbols that mean nothing. */
static void test_wrong_symbols(void) {
    static const deflate_token far[2] = {{'a', 0, 0}, {0, 3, 2}}, near[2] = {{'a', 0, 0}, {0, 3, 1}};
    ex_error error;
    deflater d = begin_broken();
    deflate_fixed(&d, far, 2, 1);
    check_broken(&d, "a distance to before the first byte");
    d = begin_broken();
    deflate_fixed(&d, near, 2, 1);
    memcpy(data, "aaaa", 4);
    CHECK(gives(BARE, packed, d.count, 4, &error));
    for (unsigned symbol = 286; symbol < 288; ++symbol) {
        d = begin_broken();
        deflate_number(&d, 3, 3);
        deflate_code(&d, 0xc0 + symbol - 280, 8);
        deflate_number(&d, 0, 30);
        check_broken(&d, "an invalid code");
    }
    for (unsigned symbol = 30; symbol < 32; ++symbol) { /* more than 32768 */
        d = begin_broken();
        deflate_number(&d, 3, 3);
        deflate_code(&d, 0x30 + 'a', 8);
        deflate_code(&d, 1, 7);
        deflate_code(&d, symbol, 5);
        deflate_number(&d, 0, 30);
        check_broken(&d, "an invalid code of a distance");
    }
    d = begin_broken();
    deflate_number(&d, 1, 8), deflate_number(&d, 3, 16), deflate_number(&d, 0xfffd, 16);
    check_broken(&d, "a stored block with a wrong length at byte 1");
}

/* -------------------------------------------------------------------------------------------- sizes and wrappings */

/* Room for fewer bytes or more than there are: nothing is written beyond, and the error says so. */
static void test_sizes(void) {
    for (unsigned shape = 0; shape < 3; ++shape) {
        ex_error error;
        fill_data(500, 20);
        const size_t count = deflate_match(data, 500, tokens);
        deflater d = {packed, ROOM, 0, 0};
        if (shape == 0) deflate_stored(&d, data, 500, 1);
        if (shape == 1) deflate_fixed(&d, tokens, count, 1);
        if (shape == 2) deflate_dynamic(&d, tokens, count, 1, 3);
        for (size_t size = 0; size < 500; ++size)
            if (!CHECK(!gives(BARE, packed, d.count, size, &error)) || !CHECK(strstr(error.text, "more than there is")))
                printf("    %zu: %s\n", size, error.text);
        CHECK(!gives(BARE, packed, d.count, 501, &error));
        CHECK(strcmp(error.text, "file: packed data: 500 bytes, but 501 are called for") == 0);
        for (size_t most = 0; most <= 600; most += most < 20 || most > 480 ? 1 : 17) {
            unsigned char *out = (unsigned char *)malloc(most + 1);
            size_t got = 1234;
            if (!CHECK(out != NULL)) return;
            CHECK(ex_inflate_start("file", EX_PACKED_RAW, packed, d.count, out, most, &got, &error) == 0);
            CHECK(got == (most < 500 ? most : 500) && memcmp(out, data, got) == 0);
            free(out);
        }
    }
}

static void check_wrapped(wrapping kind, size_t count, size_t size, const char *words) {
    ex_error error;
    const int good = gives(kind, packed, count, size, &error);
    if (!CHECK(good == (words == NULL)) || (words && !CHECK(strstr(error.text, words) != NULL)))
        printf("    '%s' is not in: %s\n", words ? words : "no error", error.text);
}

/* What stands before and after the blocks. */
static void test_zlib_wrapping(void) {
    fill_data(100, 20);
    const size_t count = deflate_all(ZLIB, data, 100, packed, ROOM);
    packed[count] = 7;
    check_wrapped(ZLIB, count + 1, 100, "something else after the end at byte");
    for (size_t i = 0; i < 4; ++i) {
        packed[count - 1 - i] ^= 16;
        check_wrapped(ZLIB, count, 100, "a wrong checksum at byte");
        packed[count - 1 - i] ^= 16;
    }
    check_wrapped(ZLIB, count, 100, NULL);
    packed[1] ^= 1;
    check_wrapped(ZLIB, count, 100, "no zlib header at byte 0");
    packed[0] = 0x79, packed[1] = 0x9c - 8;
    check_wrapped(ZLIB, count, 100, "no zlib header at byte 0");
    packed[0] = 0x88, packed[1] = 0x1c; /* a window of 64 KB; both are a multiple of 31 */
    check_wrapped(ZLIB, count, 100, "no zlib header at byte 0");
    packed[0] = 0x78, packed[1] = 0x20 | 0x1b;
    packed[1] = (unsigned char)(0x20 + 31 - (0x7820 % 31));
    check_wrapped(ZLIB, count, 100, "a preset dictionary, which is not supported");
}

/* gzip's optional fields, one by one and together. */
static void test_gzip_header(void) {
    ex_error error;
    fill_data(100, 20);
    static unsigned char body[1000];
    const size_t count = deflate_all(GZIP, data, 100, body, sizeof body);
    for (unsigned flags = 0; flags < 32; ++flags) {
        deflater d = {packed, ROOM, 0, 0};
        deflate_bytes(&d, body, 3);
        deflate_number(&d, flags, 8);
        deflate_bytes(&d, body + 4, 6);
        if (flags & 4) deflate_bytes(&d, "\3\0abc", 5);
        if (flags & 8) deflate_bytes(&d, "a name", 7);
        if (flags & 16) deflate_bytes(&d, "", 1);
        if (flags & 2) deflate_number(&d, deflate_crc(packed, d.count) & 0xffff, 16);
        const size_t header = d.count;
        deflate_bytes(&d, body + 10, count - 10);
        if (!CHECK(gives(GZIP, packed, d.count, 100, &error))) printf("    flags %u: %s\n", flags, error.text);
        for (size_t length = 0; length <= header; ++length) CHECK(!gives(GZIP, packed, length, 100, &error));
    }
    memcpy(packed, body, count);
    for (unsigned flag = 32; flag < 256; flag *= 2) {
        packed[3] = (unsigned char)flag;
        check_wrapped(GZIP, count, 100, "no gzip header at byte 0");
    }
    packed[3] = 4, packed[10] = packed[11] = 255;
    check_wrapped(GZIP, count, 100, "the end, within a gzip header,");
    memcpy(packed, body, count);
    for (int i = 0; i < 3; ++i) {
        packed[i] ^= 8;
        check_wrapped(GZIP, count, 100, "no gzip header at byte 0");
        packed[i] ^= 8;
    }
    packed[count - 1] ^= 1;
    check_wrapped(GZIP, count, 100, "a wrong length of the data");
    packed[count - 1] ^= 1;
    packed[count - 5] ^= 1;
    check_wrapped(GZIP, count, 100, "a wrong checksum");
}

/* Members follow each other; no copy reaches into the one before. Zeros may follow, and nothing else. */
static void test_gzip_members(void) {
    static const deflate_token back[1] = {{0, 3, 1}};
    size_t count = 0, used = 0;
    ex_error error;
    unsigned char out[300];
    fill_data(300, 20);
    for (size_t i = 0; i < 3; ++i) {
        static unsigned char member[1000];
        const size_t size = deflate_all(GZIP, data + 100 * i, 100, member, sizeof member);
        memcpy(packed + count, member, size);
        count += size;
    }
    check_wrapped(GZIP, count, 300, NULL);
    check_wrapped(GZIP, count, 200, "more than there is room for");
    memset(packed + count, 0, 600);
    check_wrapped(GZIP, count + 600, 300, NULL);
    packed[count + 5] = 9;
    check_wrapped(GZIP, count + 6, 300, "something else after the end");
    CHECK(ex_inflate("file", EX_PACKED_GZIP, packed, count + 6, out, 300, &used, &error) == 0 && used == count);
    deflater d = {packed, ROOM, count, 0};
    deflate_begin(&d, GZIP);
    deflate_fixed(&d, back, 1, 1);
    check_wrapped(GZIP, d.count, 303, "a distance to before the first byte");
}

int main(void) {
    RUN(test_every_block);
    RUN(test_several_blocks);
    RUN(test_every_copy);
    RUN(test_known_data);
    RUN(test_truncated);
    RUN(test_flipped);
    RUN(test_noise);
    RUN(test_wrong_codes);
    RUN(test_single_codes);
    RUN(test_wrong_symbols);
    RUN(test_sizes);
    RUN(test_zlib_wrapping);
    RUN(test_gzip_header);
    RUN(test_gzip_members);
    return check_report();
}
