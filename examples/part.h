/* part.h: part files: a band of rows of a picture each, as `render --part I/N` writes them, and the picture that
   join.c makes of all. Parts join only if their builds, sizes and options are the same. The format, little endian:

     byte 0    "SPSPART" and the format's number as a digit, 1
     byte 8    width and height of the whole picture, this part's number, from 1, and how many there are: 32 bits each
     byte 24   lengths B and O of two texts: 32 bits each
     byte 32   the screen's width at distance 1 from the eye, a double; 0: not a perspective
     byte 40   CRC-32 of the pixels' colors, and of their depths
     byte 48   what rendered it, B bytes, and what was rendered, O bytes: lines of text; CRC-32 of all before
     then      R, G, B and A of each pixel, floats, rows from the top; then the depth of each

   Part I of N has the rows from (I - 1) * height / N up to I * height / N, rounded down. It reads no other format. */

#ifndef EX_PART_H
#define EX_PART_H

#include "checksums.h"
#include "exr.h"

enum { EX_PART_HEAD = 48, EX_PART_SIDE = 16384, EX_PART_TEXT = 1 << 20 /* the longest text */ };

typedef struct ex_part {
    const char *path;
    int width, height; /* the whole picture's */
    int number, count;
    double screen_width;
    const char *build, *options; /* texts, whose sizes do not count a 0 at their end */
    size_t build_size, options_size;
    uint32_t checksums[2]; /* colors', depths' */
    unsigned char *head;   /* memory of both texts, if they were read */
} ex_part;

/* The first row of a part; of the part after the last, the height. */
static inline int ex_part_row(const ex_part *part, int number) {
    return (int)((int64_t)part->height * (number - 1) / part->count);
}

static inline size_t ex_part_pixels(const ex_part *part) {
    return (size_t)part->width * (size_t)(ex_part_row(part, part->number + 1) - ex_part_row(part, part->number));
}

/* ---------------------------------------------------------------------------- what renders the same bits */

/* The checksum of a whole file of any size: that of its blocks' checksums, one after the other. */
static inline int ex_file_checksum(const char *path, uint32_t *checksum, uint64_t *size, ex_error *error) {
    enum { BLOCK = 1 << 20 };
    FILE *file = ex_open(path, size, error);
    if (!file) return 1;
    unsigned char *block = (unsigned char *)ex_allocate(BLOCK, 1), sums[8];
    uint64_t got = 0;
    size_t count;
    *checksum = 0;
    while ((count = fread(block, 1, BLOCK, file)) > 0) {
        ex_exr_number(ex_exr_number(sums, *checksum, 4), ex_crc32(block, count), 4);
        *checksum = ex_crc32(sums, sizeof sums);
        got += count;
    }
    free(block);
    fclose(file);
    return got == *size ? 0
                        : ex_fail(error, "%s: reading failed after %llu of %llu bytes", path, (unsigned long long)got,
                                  (unsigned long long)*size);
}

/* A checksum of what the C library's functions return, which may depend on the processor too, and of how this thread
   rounds and treats denormals. */
static inline uint32_t ex_arithmetic_checksum(void) {
    enum { COUNT = 64, FUNCTIONS = 18 };
    static double results[COUNT][FUNCTIONS];
    volatile double step = 0.731; /* the compiler computes nothing in advance */
    volatile float tiny = 1e-38f;
    for (int i = 0; i < COUNT; ++i) {
        const double x = 0.37 + i * step, share = x / 50;
        const float single = (float)x;
        const double row[FUNCTIONS] = {sin(x),
                                       cos(x),
                                       tan(x),
                                       asin(share),
                                       acos(share),
                                       atan2(x, 1.7),
                                       exp(-x),
                                       exp(share),
                                       expm1(-share),
                                       log(x),
                                       log1p(x),
                                       pow(x, 0.37),
                                       cbrt(x),
                                       sqrt(x),
                                       (double)expf(-single),
                                       (double)logf(single),
                                       (double)powf(single, 0.37f),
                                       (double)(tiny * (float)share)};
        memcpy(results[i], row, sizeof row);
    }
    return ex_crc32((const unsigned char *)results, sizeof results);
}

#if defined SPS_NO_SIMD
#define EX_PART_INSTRUCTIONS "plain C"
#elif defined __AVX512F__
#define EX_PART_INSTRUCTIONS "AVX-512"
#elif defined __AVX2__
#define EX_PART_INSTRUCTIONS "AVX2"
#elif defined __SSE2__
#define EX_PART_INSTRUCTIONS "SSE2"
#elif defined __ARM_NEON
#define EX_PART_INSTRUCTIONS "NEON"
#else
#define EX_PART_INSTRUCTIONS "plain C"
#endif
#if defined __clang__
#define EX_PART_COMPILER __VERSION__
#elif defined __GNUC__
#define EX_PART_COMPILER "GCC " __VERSION__
#else
#define EX_PART_COMPILER "unknown"
#endif

/* Lists all that changes bits of a picture, the most telling lines first. Only Linux tells where the program's own
   file is. */
static inline void ex_part_build(char *out, size_t size) {
    const int version = sps_version();
    uint32_t program = 0;
    uint64_t length = 0;
    ex_error ignored;
    if (ex_file_checksum("/proc/self/exe", &program, &length, &ignored)) program = 0, length = 0;
    snprintf(out, size,
             "splatshadow %d.%d.%d\ncompiler %s\npointers of %d bits\ninstructions %s\narithmetic %08x\n"
             "program of %llu bytes, checksum %08x\n",
             version / 10000, version / 100 % 100, version % 100, EX_PART_COMPILER, (int)(8 * sizeof(void *)),
             EX_PART_INSTRUCTIONS, ex_arithmetic_checksum(), (unsigned long long)length, program);
}

/* -------------------------------------------------------------------------------------------------------- writing */

/* Sets its checksums and writes it. On a big-endian machine, numbers are swapped in place. */
static inline int ex_write_part(ex_part *part, float *rgba, float *depth, ex_error *error) {
    const size_t pixels = ex_part_pixels(part), texts = part->build_size + part->options_size;
    ex_output output;
    uint64_t bits;
    if (part->build_size > EX_PART_TEXT || part->options_size > EX_PART_TEXT)
        return ex_fail(error, "%s: options of more than %d bytes", part->path, EX_PART_TEXT);
    ex_little_endian(rgba, 4 * pixels, sizeof *rgba);
    ex_little_endian(depth, pixels, sizeof *depth);
    part->checksums[0] = ex_crc32((const unsigned char *)rgba, 4 * pixels * sizeof *rgba);
    part->checksums[1] = ex_crc32((const unsigned char *)depth, pixels * sizeof *depth);
    const uint32_t fields[6] = {(uint32_t)part->width, (uint32_t)part->height,     (uint32_t)part->number,
                                (uint32_t)part->count, (uint32_t)part->build_size, (uint32_t)part->options_size};
    if (ex_output_begin(&output, part->path, error)) return 1;
    unsigned char *head = (unsigned char *)ex_allocate(EX_PART_HEAD + texts + 4, 1), *at = head + 8;
    memcpy(head, "SPSPART1", 8);
    for (int i = 0; i < 6; ++i) at = ex_exr_number(at, fields[i], 4);
    memcpy(&bits, &part->screen_width, sizeof bits);
    at = ex_exr_number(at, bits, 8);
    at = ex_exr_number(ex_exr_number(at, part->checksums[0], 4), part->checksums[1], 4);
    memcpy(at, part->build, part->build_size);
    memcpy(at + part->build_size, part->options, part->options_size);
    ex_exr_number(at + texts, ex_crc32(head, EX_PART_HEAD + texts), 4);
    ex_output_bytes(&output, head, EX_PART_HEAD + texts + 4);
    ex_output_bytes(&output, rgba, 4 * pixels * sizeof *rgba);
    ex_output_bytes(&output, depth, pixels * sizeof *depth);
    free(head);
    return ex_output_end(&output, error);
}

/* -------------------------------------------------------------------------------------------------------- reading */

static inline void ex_part_free(ex_part *part) {
    free(part->head);
    part->head = NULL;
}

/* Takes numbers from the first bytes. They must be possible, since what is allocated depends on them. */
static inline int ex_part_numbers(ex_part *part, const unsigned char *head, ex_error *error) {
    uint32_t fields[6];
    uint64_t bits = ex_u64(head + 32);
    for (int i = 0; i < 6; ++i) fields[i] = ex_u32(head + 8 + 4 * i);
    if (fields[0] < 1 || fields[0] > EX_PART_SIDE || fields[1] < 1 || fields[1] > EX_PART_SIDE)
        return ex_fail(error, "%s: byte 8: a picture of %u x %u pixels: sides must be within 1..%d", part->path,
                       fields[0], fields[1], EX_PART_SIDE);
    if (fields[3] < 1 || fields[3] > fields[1] || fields[2] < 1 || fields[2] > fields[3])
        return ex_fail(error, "%s: byte 16: part %u of %u of %u rows", part->path, fields[2], fields[3], fields[1]);
    if (fields[4] > EX_PART_TEXT || fields[5] > EX_PART_TEXT)
        return ex_fail(error, "%s: byte 24: texts of %u and %u bytes: at most %d are read", part->path, fields[4],
                       fields[5], EX_PART_TEXT);
    part->width = (int)fields[0], part->height = (int)fields[1];
    part->number = (int)fields[2], part->count = (int)fields[3];
    part->build_size = fields[4], part->options_size = fields[5];
    memcpy(&part->screen_width, &bits, sizeof bits);
    if (!(part->screen_width >= 0 && part->screen_width <= 1e9))
        return ex_fail(error, "%s: byte 32: a screen of width %g: it must be within 0..1e9", part->path,
                       part->screen_width);
    part->checksums[0] = ex_u32(head + 40), part->checksums[1] = ex_u32(head + 44);
    return 0;
}

/* Reads all but the pixels from a file of this size. */
static inline int ex_part_read_head(ex_part *part, FILE *file, uint64_t size, ex_error *error) {
    unsigned char start[EX_PART_HEAD] = {0};
    const size_t got = fread(start, 1, sizeof start, file);
    if (memcmp(start, "SPSPART", 7) != 0)
        return ex_fail(error, "%s: not a part of a picture: it does not start with SPSPART", part->path);
    if (got < sizeof start) return ex_fail(error, "%s: it ends after %zu bytes, within its header", part->path, got);
    if (start[7] != '1')
        return ex_fail(error, "%s: byte 7: format %d: only 1 is supported", part->path, start[7] - '0');
    if (ex_part_numbers(part, start, error)) return 1;
    const size_t texts = part->build_size + part->options_size, rest = texts + 4;
    const uint64_t expected = EX_PART_HEAD + (uint64_t)rest + 5 * sizeof(float) * (uint64_t)ex_part_pixels(part);
    if (size != expected)
        return ex_fail(error, "%s: %llu bytes, but its header says %llu: it was cut off or damaged", part->path,
                       (unsigned long long)size, (unsigned long long)expected);
    part->head = (unsigned char *)ex_allocate(EX_PART_HEAD + rest, 1);
    memcpy(part->head, start, sizeof start);
    if (fread(part->head + EX_PART_HEAD, 1, rest, file) != rest)
        return ex_fail(error, "%s: reading failed within its header", part->path);
    const uint32_t checksum = ex_crc32(part->head, EX_PART_HEAD + texts);
    const uint32_t stored = ex_u32(part->head + EX_PART_HEAD + texts);
    if (checksum != stored)
        return ex_fail(error, "%s: its header is damaged: checksum %08x, but %08x is stored", part->path, checksum,
                       stored);
    part->build = (const char *)part->head + EX_PART_HEAD;
    part->options = part->build + part->build_size;
    return 0;
}

/* Fills `part`, but for its pixels; the caller frees it in any case. */
static inline int ex_part_open(ex_part *part, const char *path, ex_error *error) {
    uint64_t size = 0;
    memset(part, 0, sizeof *part);
    part->path = path;
    FILE *file = ex_open(path, &size, error);
    if (!file) return 1;
    const int failed = ex_part_read_head(part, file, size, error);
    fclose(file);
    return failed;
}

/* Reads floats, and compares them with their checksum. */
static inline int ex_part_floats(const ex_part *part, FILE *file, int which, float *out, ex_error *error) {
    const char *const names[2] = {"colors", "depths"};
    const size_t count = ex_part_pixels(part) * (which ? 1 : 4);
    if (fread(out, sizeof *out, count, file) != count)
        return ex_fail(error, "%s: reading failed within its %s", part->path, names[which]);
    const uint32_t checksum = ex_crc32((const unsigned char *)out, count * sizeof *out);
    if (checksum != part->checksums[which])
        return ex_fail(error, "%s: its %s are damaged: checksum %08x, but %08x is stored", part->path, names[which],
                       checksum, part->checksums[which]);
    ex_little_endian(out, count, sizeof *out);
    return 0;
}

/* Reads the pixels of an open part into their rows of the whole picture. */
static inline int ex_part_read(const ex_part *part, float *rgba, float *depth, ex_error *error) {
    const size_t first = (size_t)part->width * (size_t)ex_part_row(part, part->number);
    const uint64_t start = EX_PART_HEAD + (uint64_t)part->build_size + part->options_size + 4;
    uint64_t size = 0;
    FILE *file = ex_open(part->path, &size, error);
    if (!file) return 1;
    int failed = fseek(file, (long)start, SEEK_SET) != 0 && ex_fail(error, "%s: reading failed", part->path);
    failed = failed || ex_part_floats(part, file, 0, rgba + 4 * first, error) ||
             ex_part_floats(part, file, 1, depth + first, error);
    fclose(file);
    return failed;
}

/* -------------------------------------------------------------------------------------------------------- joining */

/* The line of a text that has byte `at`, or "nothing" at its end. */
static inline ex_quote ex_part_line(const char *text, size_t size, size_t at) {
    char line[80] = "nothing";
    size_t start = at, length = 0;
    while (start > 0 && text[start - 1] != '\n') --start;
    while (start + length < size && text[start + length] != '\n') ++length;
    if (length >= sizeof line) length = sizeof line - 1;
    if (start < size) memcpy(line, text + start, length), line[length] = '\0';
    return ex_quoted(line);
}

/* Fails with the first line that differs. */
static inline int ex_part_texts(const ex_part *one, const ex_part *other, int is_build, ex_error *error) {
    const char *a = is_build ? one->build : one->options, *b = is_build ? other->build : other->options;
    const size_t a_size = is_build ? one->build_size : one->options_size;
    const size_t b_size = is_build ? other->build_size : other->options_size;
    size_t at = 0;
    while (at < a_size && at < b_size && a[at] == b[at]) ++at;
    if (at == a_size && at == b_size) return 0;
    return ex_fail(error, "%s: another %s: %s, where %s has %s", other->path, is_build ? "build" : "picture",
                   ex_part_line(b, b_size, at).text, one->path, ex_part_line(a, a_size, at).text);
}

/* Fails unless both are of the same picture. */
static inline int ex_part_compare(const ex_part *one, const ex_part *other, ex_error *error) {
    if (ex_part_texts(one, other, 1, error)) return 1;
    if (one->width != other->width || one->height != other->height)
        return ex_fail(error, "%s: of a picture of %d x %d pixels, where %s is of %d x %d", other->path, other->width,
                       other->height, one->path, one->width, one->height);
    if (one->count != other->count)
        return ex_fail(error, "%s: one of %d parts, where %s is one of %d", other->path, other->count, one->path,
                       one->count);
    if (ex_part_texts(one, other, 0, error)) return 1;
    if (one->screen_width < other->screen_width || one->screen_width > other->screen_width)
        return ex_fail(error, "%s: a screen of width %g, where %s has %g", other->path, other->screen_width, one->path,
                       one->screen_width);
    return 0;
}

/* Fails if a part is there twice or missing. */
static inline int ex_parts_complete(const ex_part *parts, int count, ex_error *error) {
    const int wanted = parts[0].count;
    const ex_part **found = (const ex_part **)ex_allocate((size_t)wanted + 1, sizeof *found);
    int failed = 0, missing = 1;
    for (int i = 0; i < count && !failed; ++i) {
        const ex_part **place = &found[parts[i].number];
        if (*place)
            failed = ex_fail(error, "%s and %s are both part %d of %d", (*place)->path, parts[i].path, parts[i].number,
                             wanted);
        *place = &parts[i];
    }
    while (missing <= wanted && found[missing]) ++missing;
    if (!failed && missing <= wanted) failed = ex_fail(error, "part %d of %d is missing", missing, wanted);
    free(found);
    return failed;
}

typedef struct ex_joined {
    int width, height;
    double screen_width;
    float *rgba, *depth; /* the caller frees both */
} ex_joined;

/* Joins opened parts. Memory for the picture is only taken if all its pixels are there. */
static inline int ex_parts_read(const ex_part *parts, int count, ex_joined *out, ex_error *error) {
    const size_t pixels = (size_t)parts->width * (size_t)parts->height;
    out->width = parts->width, out->height = parts->height, out->screen_width = parts->screen_width;
    out->rgba = (float *)ex_allocate(pixels, 4 * sizeof *out->rgba);
    out->depth = (float *)ex_allocate(pixels, sizeof *out->depth);
    for (int i = 0; i < count; ++i)
        if (ex_part_read(&parts[i], out->rgba, out->depth, error)) return 1;
    return 0;
}

/* Reads one picture from all of its parts, in any order. */
static inline int ex_join(const char *const *paths, int count, ex_joined *out, ex_error *error) {
    ex_part *parts = (ex_part *)ex_allocate((size_t)count, sizeof *parts);
    int failed = 0;
    memset(out, 0, sizeof *out);
    for (int i = 0; i < count && !failed; ++i) {
        failed = ex_part_open(&parts[i], paths[i], error) || ex_part_compare(&parts[0], &parts[i], error);
        if (i > 0) ex_part_free(&parts[i]);
    }
    failed = failed || ex_parts_complete(parts, count, error) || ex_parts_read(parts, count, out, error);
    ex_part_free(&parts[0]);
    free(parts);
    if (!failed) return 0;
    free(out->rgba), free(out->depth);
    memset(out, 0, sizeof *out);
    return 1;
}

#endif /* EX_PART_H */
