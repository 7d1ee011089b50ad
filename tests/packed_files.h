/* Files under construction, and what packs parts of them: zlib's stored blocks, LZ4 blocks, Blosc buffers. It shares
   nothing with what reads them. Include after check.h. */

#ifndef PACKED_FILES_H
#define PACKED_FILES_H

enum { MARKS = 64 };

/* Bytes, and where in them named fields are. */
typedef struct file_bytes {
    unsigned char *data;
    size_t count, room;
    struct {
        const char *name;
        size_t at;
    } marks[MARKS];
    int mark_count;
} file_bytes;

static inline void put(file_bytes *file, const void *data, size_t size) {
    while (file->count + size > file->room) {
        file->room = file->room ? 2 * file->room : 4096;
        file->data = (unsigned char *)realloc(file->data, file->room);
        if (!file->data) exit(1);
    }
    if (size) memcpy(file->data + file->count, data, size);
    file->count += size;
}

static inline void put_zeros(file_bytes *file, size_t size) {
    static const unsigned char zeros[256] = {0};
    for (; size > 256; size -= 256) put(file, zeros, 256);
    put(file, zeros, size);
}

/* An integer, little endian. */
static inline void put_integer(file_bytes *file, uint64_t number, size_t size) {
    unsigned char out[8];
    for (size_t i = 0; i < 8; ++i) out[i] = (unsigned char)(number >> 8 * i & 255);
    put(file, out, size);
}

static inline void put_float(file_bytes *file, float number) {
    uint32_t bits;
    memcpy(&bits, &number, sizeof bits);
    put_integer(file, bits, 4);
}

static inline void put_double(file_bytes *file, double number) {
    uint64_t bits;
    memcpy(&bits, &number, sizeof bits);
    put_integer(file, bits, 8);
}

/* A number that half precision can represent, other than 0, neither tiny nor huge; or 0. */
static inline void put_half(file_bytes *file, float number) {
    uint32_t bits;
    memcpy(&bits, &number, sizeof bits);
    const uint32_t sign = bits >> 31 << 15, rest = number == 0 ? 0 : (bits & 0x7fffffff) / 8192 - 112 * 1024;
    put_integer(file, sign | rest, 2);
}

static inline void mark(file_bytes *file, const char *name) {
    for (int i = 0; i < file->mark_count; ++i)
        if (strcmp(file->marks[i].name, name) == 0) return; /* the first counts */
    if (!CHECK(file->mark_count < MARKS)) return;
    file->marks[file->mark_count].name = name;
    file->marks[file->mark_count++].at = file->count;
}

static inline size_t mark_at(const file_bytes *file, const char *name) {
    for (int i = 0; i < file->mark_count; ++i)
        if (strcmp(file->marks[i].name, name) == 0) return file->marks[i].at;
    if (!CHECK(0)) printf("    no mark %s\n", name);
    return 0;
}

/* Replaces an integer. */
static inline void set_integer(file_bytes *file, size_t at, uint64_t number, size_t size) {
    const size_t count = file->count;
    file->count = at;
    put_integer(file, number, size);
    file->count = count;
}

static inline void file_free(file_bytes *file) {
    free(file->data);
    memset(file, 0, sizeof *file);
}

/* --------------------------------------------------------------------------------------------------------- packing */

/* zlib: a header, stored blocks, the checksum Adler-32. */
static inline void put_zlib(file_bytes *file, const unsigned char *data, size_t size) {
    uint32_t a = 1, b = 0;
    put_integer(file, 0x0178, 2);
    for (size_t at = 0;;) {
        const size_t step = size - at < 65535 ? size - at : 65535;
        put_integer(file, at + step == size, 1);
        put_integer(file, step, 2), put_integer(file, ~step & 65535, 2);
        put(file, data + at, step);
        at += step;
        if (at == size) break;
    }
    for (size_t i = 0; i < size; ++i) a = (a + data[i]) % 65521, b = (b + a) % 65521;
    for (int i = 3; i >= 0; --i) put_integer(file, (b << 16 | a) >> 8 * i & 255, 1);
}

static inline void put_lz4_length(file_bytes *file, size_t length) {
    if (length < 15) return;
    for (length -= 15; length >= 255; length -= 255) put_integer(file, 255, 1);
    put_integer(file, length, 1);
}

static inline void put_lz4_sequence(file_bytes *file, const unsigned char *literals, size_t count, size_t back,
                                    size_t match) {
    const size_t more = match ? match - 4 : 0;
    put_integer(file, (count < 15 ? count : 15) << 4 | (more < 15 ? more : 15), 1);
    put_lz4_length(file, count);
    put(file, literals, count);
    if (match == 0) return;
    put_integer(file, back, 2);
    put_lz4_length(file, more);
}

/* An LZ4 block. Each four bytes are looked up among those before. */
static inline void put_lz4(file_bytes *file, const unsigned char *data, size_t size) {
    static size_t last[4096];
    size_t from = 0;
    memset(last, 255, sizeof last);
    for (size_t at = 0; at + 12 < size;) {
        uint32_t word;
        memcpy(&word, data + at, 4);
        size_t *slot = &last[word * 2654435761u >> 20];
        const size_t before = *slot;
        size_t match = 0;
        *slot = at;
        if (before != (size_t)-1 && at - before < 65536)
            while (at + match + 5 < size && data[before + match] == data[at + match]) ++match;
        if (match < 4) {
            ++at;
            continue;
        }
        put_lz4_sequence(file, data + from, at - from, at - before, match);
        at += match, from = at;
    }
    put_lz4_sequence(file, data + from, size - from, 0, 0);
}

/* How a Blosc buffer is made. */
typedef struct blosc_style {
    int shuffled, copied, whole; /* flags; whole: blocks are not split */
    size_t block;                /* bytes of a block; 0: all */
    int item;                    /* bytes of an item */
} blosc_style;

/* One stream after its size: packed, unless that is larger. */
static inline void put_blosc_stream(file_bytes *file, const unsigned char *data, size_t size) {
    file_bytes packed = {0};
    put_lz4(&packed, data, size);
    const int worth = packed.count < size;
    mark(file, "stream");
    put_integer(file, worth ? packed.count : size, 4);
    put(file, worth ? packed.data : data, worth ? packed.count : size);
    file_free(&packed);
}

static inline void put_blosc_block(file_bytes *file, const unsigned char *data, size_t size, size_t block,
                                   const blosc_style *style) {
    const size_t item = (size_t)style->item, count = size / item;
    const size_t streams = !style->whole && item <= 16 && block / item >= 128 && size == block ? item : 1;
    unsigned char *sorted = (unsigned char *)malloc(size + 1);
    if (!sorted) exit(1);
    memcpy(sorted, data, size);
    for (size_t i = 0; style->shuffled && i < count * item; ++i) sorted[i % item * count + i / item] = data[i];
    for (size_t i = 0; i < streams; ++i) put_blosc_stream(file, sorted + i * (size / streams), size / streams);
    free(sorted);
}

static inline void put_blosc(file_bytes *file, const unsigned char *data, size_t size, const blosc_style *style) {
    const size_t start = file->count, block = style->block && style->block < size ? style->block : size;
    const size_t blocks = block ? (size + block - 1) / block : 0;
    mark(file, "blosc");
    put_integer(file, 2, 1), put_integer(file, 1, 1);
    put_integer(file, 32 | (style->shuffled != 0) | (style->copied ? 2 : 0) | (style->whole ? 16 : 0), 1);
    put_integer(file, (uint64_t)style->item, 1);
    put_integer(file, size, 4), put_integer(file, block, 4), put_integer(file, 0, 4);
    if (style->copied) {
        put(file, data, size);
    } else {
        const size_t table = file->count;
        put_zeros(file, 4 * blocks);
        for (size_t i = 0; i < blocks; ++i) {
            const size_t first = i * block, bytes = size - first < block ? size - first : block;
            set_integer(file, table + 4 * i, file->count - start, 4);
            put_blosc_block(file, data + first, bytes, block, style);
        }
    }
    set_integer(file, start + 12, file->count - start, 4);
}

#endif /* PACKED_FILES_H */
