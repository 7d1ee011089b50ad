/* examples/part.h, render --part and join.c: part files against bytes that are written here, every way in which parts
   do not belong together, damaged files, and pictures that four processes render against those of one. */

#include "check.h"
#include "part.h"
#include "command_line.h"
#include <unistd.h>

/* ------------------------------------------------------------------------------------------------ files by hand */

enum { MOST = 1 << 16 };

/* What the file of a part says. */
typedef struct made {
    unsigned width, height, number, count;
    double screen_width;
    const char *build, *options;
} made;

static const made usual = {3, 7, 1, 1, 1.25, "build one\nsecond line\n", "--width 3\n--height 7\n"};

static unsigned char bytes[MOST];

/* Bit by bit, as RFC 1952 defines it. */
static unsigned slow_crc(const unsigned char *data, size_t size) {
    unsigned crc = 0xffffffffu;
    for (size_t i = 0; i < size; ++i)
        for (int bit = 0; bit < 8; ++bit) {
            const unsigned low = (crc ^ (unsigned)(data[i] >> bit)) & 1;
            crc = crc >> 1 ^ (low ? 0xedb88320u : 0);
        }
    return ~crc;
}

static size_t put(size_t at, unsigned long long number, int size) {
    for (int i = 0; i < size; ++i) bytes[at++] = (unsigned char)(number >> 8 * i & 255);
    return at;
}

static size_t put_float(size_t at, float value) {
    unsigned bits;
    memcpy(&bits, &value, 4);
    return put(at, bits, 4);
}

/* Number c of pixel i: all differ, and some are special. */
static float color_at(unsigned i, unsigned c) {
    return i == 4 && c == 1 ? INFINITY : i == 5 && c == 2 ? -0.0f : (float)(4 * i + c) / 7;
}
static float depth_at(unsigned i) { return i % 5 == 3 ? INFINITY : 1 + (float)i / 3; }

static unsigned row_of(const made *part, unsigned number) { return part->height * (number - 1) / part->count; }

static size_t texts_end(const made *part) { return 48 + strlen(part->build) + strlen(part->options); }

/* Stores the checksum of the header. */
static void seal(const made *part) { put(texts_end(part), slow_crc(bytes, texts_end(part)), 4); }

/* Fills `bytes`; returns their number. */
static size_t make_bytes(const made *part) {
    const unsigned first = part->width * row_of(part, part->number);
    const unsigned end = part->width * row_of(part, part->number + 1);
    const size_t build = strlen(part->build), options = strlen(part->options), colors = texts_end(part) + 4;
    unsigned long long screen;
    size_t at = 8;
    memcpy(bytes, "SPSPART1", 8);
    at = put(put(put(put(at, part->width, 4), part->height, 4), part->number, 4), part->count, 4);
    at = put(put(at, build, 4), options, 4);
    memcpy(&screen, &part->screen_width, 8);
    put(at, screen, 8);
    memcpy(bytes + 48, part->build, build);
    memcpy(bytes + 48 + build, part->options, options);
    at = colors;
    for (unsigned i = first; i < end; ++i)
        for (unsigned c = 0; c < 4; ++c) at = put_float(at, color_at(i, c));
    const size_t depths = at;
    for (unsigned i = first; i < end; ++i) at = put_float(at, depth_at(i));
    put(put(40, slow_crc(bytes + colors, depths - colors), 4), slow_crc(bytes + depths, at - depths), 4);
    seal(part);
    return at;
}

static void write_made(const char *name, const made *part) { write_file(name, bytes, make_bytes(part)); }

static const char *path_of(const char *name) {
    static char paths[64][100];
    static int next;
    next = (next + 1) % 64;
    snprintf(paths[next], sizeof paths[next], "%s/%s", folder, name);
    return paths[next];
}

/* Joins files of these names, which must fail with one line that has these words. */
static void check_refused_here(const char *const *names, int count, const char *words, const char *more) {
    const char *paths[16];
    ex_joined joined;
    ex_error error = {""};
    for (int i = 0; i < count; ++i) paths[i] = path_of(names[i]);
    const int failed = ex_join(paths, count, &joined, &error);
    if (!CHECK(failed && strstr(error.text, words) && strstr(error.text, more)) ||
        !CHECK(is_printable(error.text, strlen(error.text)) && !joined.rgba && !joined.depth))
        printf("    %d, %s\n    expected %s ... %s\n", failed, error.text, words, more);
    if (!failed) free(joined.rgba), free(joined.depth);
}

/* ------------------------------------------------------------------------------------------------------ the format */

static int is_whole(const ex_joined *joined, const made *part) {
    int same = joined->width == (int)part->width && joined->height == (int)part->height &&
               memcmp(&joined->screen_width, &part->screen_width, 8) == 0;
    for (unsigned i = 0; same && i < part->width * part->height; ++i) {
        const float depth = depth_at(i);
        for (unsigned c = 0; c < 4; ++c) {
            const float color = color_at(i, c);
            same = same && memcmp(&joined->rgba[4 * i + c], &color, 4) == 0;
        }
        same = same && memcmp(&joined->depth[i], &depth, 4) == 0;
    }
    return same;
}

/* Files that are made here join to all pixels, for every number of parts, in falling order and others. */
static void test_reading(void) {
    for (unsigned count = 1; count <= usual.height; ++count)
        for (unsigned turn = 0; turn < 3; ++turn) {
            const char *paths[8];
            ex_joined joined;
            ex_error error;
            for (unsigned i = 0; i < count; ++i) {
                made part = usual;
                char name[20];
                part.count = count, part.number = turn == 2 ? count - i : (i + turn) % count + 1;
                snprintf(name, sizeof name, "%u", i);
                write_made(name, &part);
                paths[i] = path_of(name);
            }
            if (!CHECK(ex_join(paths, (int)count, &joined, &error) == 0)) {
                printf("    %s\n", error.text);
                continue;
            }
            CHECK(is_whole(&joined, &usual));
            free(joined.rgba), free(joined.depth);
        }
}

/* What is written is, byte for byte, what is made here. */
static void test_writing(void) {
    for (unsigned number = 1; number <= 3; ++number) {
        static char read[MOST];
        made part = usual;
        ex_part out;
        ex_error error;
        float rgba[4 * 21], depth[21];
        part.count = 3, part.number = number;
        const unsigned first = part.width * row_of(&part, number), end = part.width * row_of(&part, number + 1);
        for (unsigned i = first; i < end; ++i) {
            for (unsigned c = 0; c < 4; ++c) rgba[4 * (i - first) + c] = color_at(i, c);
            depth[i - first] = depth_at(i);
        }
        memset(&out, 0, sizeof out);
        out.path = path_of("out"), out.width = 3, out.height = 7, out.number = (int)number, out.count = 3;
        out.screen_width = part.screen_width, out.build = part.build, out.build_size = strlen(part.build);
        out.options = part.options, out.options_size = strlen(part.options);
        CHECK(ex_part_pixels(&out) == end - first);
        CHECK(ex_write_part(&out, rgba, depth, &error) == 0);
        const size_t size = make_bytes(&part);
        CHECK((size_t)read_file("out", read, sizeof read) == size && memcmp(read, bytes, size) == 0);
        out.options_size = EX_PART_TEXT + 1;
        CHECK(ex_write_part(&out, rgba, depth, &error) && strstr(error.text, "out: options of more than 1048576"));
        out.options_size = 0, out.path = path_of("no/out");
        CHECK(ex_write_part(&out, rgba, depth, &error) && strstr(error.text, "no/out: cannot be written"));
    }
}

/* Parts cover all rows, and differ by at most one. */
static void test_rows(void) {
    static const int heights[] = {1, 2, 7, 64, 1000, 16383, 16384};
    for (int h = 0; h < 7; ++h)
        for (int count = 1; count <= heights[h]; count += 1 + count / 9) {
            ex_part part = {0};
            int good = 1;
            part.height = heights[h], part.count = count;
            good = ex_part_row(&part, 1) == 0 && ex_part_row(&part, count + 1) == heights[h];
            for (int i = 1; i <= count; ++i) {
                const int rows = ex_part_row(&part, i + 1) - ex_part_row(&part, i), even = heights[h] / count;
                good = good && rows >= even && rows <= even + (heights[h] % count != 0);
            }
            if (!CHECK(good)) printf("    %d parts of %d rows\n", count, heights[h]);
        }
}

/* ------------------------------------------------------------------------------------------ what does not belong */

/* The second of two parts with another header. */
static void check_second(const made *second, const char *words, const char *more) {
    static const char *const names[] = {"first", "second"};
    made first = usual;
    first.count = 2;
    write_made("first", &first);
    write_made("second", second);
    check_refused_here(names, 2, words, more);
}

static void test_differences(void) {
    made second = usual, changed;
    second.count = second.number = 2;
    changed = second, changed.build = "build two\nsecond line\n";
    check_second(&changed, "second: another build: build two, where ", "first has build one");
    changed = second, changed.build = "build one\n";
    check_second(&changed, "second: another build: nothing, where ", "first has second line");
    changed = second, changed.build = "build one\nsecond line\nthird\n";
    check_second(&changed, "second: another build: third, where ", "first has nothing");
    changed = second, changed.options = "--width 3\n--height 8\n";
    check_second(&changed, "second: another picture: --height 8, where ", "first has --height 7");
    changed = second, changed.options = "";
    check_second(&changed, "second: another picture: nothing, where ", "first has --width 3");
    changed = second, changed.width = 4;
    check_second(&changed, "second: of a picture of 4 x 7 pixels, where ", "first is of 3 x 7");
    changed = second, changed.height = 6;
    check_second(&changed, "second: of a picture of 3 x 6 pixels, where ", "first is of 3 x 7");
    changed = second, changed.count = 3;
    check_second(&changed, "second: one of 3 parts, where ", "first is one of 2");
    changed = second, changed.screen_width = 1.5;
    check_second(&changed, "second: a screen of width 1.5, where ", "first has 1.25");
    changed = second, changed.number = 1;
    check_second(&changed, "first and ", "second are both part 1 of 2");
    /* what cannot be printed, and what is too long to be */
    changed = second, changed.options = "--width 3\n--height \033[31m\n";
    check_second(&changed, "another picture: --height ?[31m, where ", "first has --height 7");
    changed = second, changed.options = "0123456789012345678901234567890123456789012345678901234567890123456789\n";
    check_second(&changed, "another picture: 012345678901234567890123456789012345678901234567890123456789..., where ",
                 "");
}

static void test_missing(void) {
    static const char *const names[] = {"third", "first", "first", "none"};
    made part = usual;
    part.count = 4, part.number = 3;
    write_made("third", &part);
    part.number = 1;
    write_made("first", &part);
    check_refused_here(names, 2, "part 2 of 4 is missing", "");
    check_refused_here(names, 1, "part 1 of 4 is missing", "");
    check_refused_here(names, 3, "first and ", "first are both part 1 of 4");
    check_refused_here(names, 4, "none: No such file", "");
    part.count = 2;
    write_made("first", &part);
    check_refused_here(names + 1, 1, "part 2 of 2 is missing", "");
}

/* Numbers that no part can have, under a checksum that is right. */
static void test_numbers(void) {
    static const struct {
        int at, size;
        unsigned long long value;
        const char *words;
    } wrong[] = {
        {0, 1, 's', "not a part of a picture"},
        {6, 1, 's', "not a part of a picture"},
        {7, 1, '2', "byte 7: format 2: only 1"},
        {7, 1, 0, "byte 7: format -48: only 1"},
        {8, 4, 0, "byte 8: a picture of 0 x 7 pixels"},
        {8, 4, 16385, "byte 8: a picture of 16385 x 7 pixels"},
        {8, 4, 0xffffffff, "byte 8: a picture of 4294967295 x 7 pixels"},
        {12, 4, 0, "byte 8: a picture of 3 x 0 pixels"},
        {12, 4, 16385, "byte 8: a picture of 3 x 16385 pixels"},
        {12, 4, 6, "but its header says"},
        {12, 4, 16384, "but its header says"},
        {16, 4, 0, "byte 16: part 0 of 1 of 7 rows"},
        {16, 4, 2, "byte 16: part 2 of 1 of 7 rows"},
        {16, 4, 0xffffffff, "byte 16: part 4294967295 of 1"},
        {20, 4, 0, "byte 16: part 1 of 0 of 7 rows"},
        {20, 4, 8, "byte 16: part 1 of 8 of 7 rows"},
        {20, 4, 0xffffffff, "byte 16: part 1 of 4294967295"},
        {20, 4, 2, "but its header says"},
        {24, 4, (1 << 20) + 1, "byte 24: texts of 1048577 and "},
        {24, 4, 0xffffffff, "byte 24: texts of 4294967295 and "},
        {24, 4, 0, "but its header says"},
        {28, 4, (1 << 20) + 1, "at most 1048576 are read"},
        {28, 4, 1 << 20, "but its header says"},
        {32, 8, 0xbff0000000000000, "byte 32: a screen of width -1"},
        {32, 8, 0x7ff0000000000000, "byte 32: a screen of width inf"},
        {32, 8, 0x7ff8000000000000, "byte 32: a screen of width nan"},
        {40, 4, 12345, "its colors are damaged: checksum "},
        {44, 4, 12345, "its depths are damaged: checksum "},
    };
    static const char *const name[] = {"wrong"};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; ++i) {
        const size_t size = make_bytes(&usual);
        put((size_t)wrong[i].at, wrong[i].value, wrong[i].size);
        seal(&usual);
        write_file("wrong", bytes, size);
        check_refused_here(name, 1, wrong[i].words, "wrong: ");
    }
}

/* A file of any other length, and one in which any bit is flipped */
static void test_damage(void) {
    static const char *const name[] = {"damaged"};
    const made part = {2, 2, 1, 1, 0, "b\n", "o\n"};
    const size_t size = make_bytes(&part);
    for (size_t length = 0; length <= size + 1; ++length) {
        if (length == size) continue;
        write_file("damaged", bytes, length);
        check_refused_here(name, 1,
                           length < 7    ? "not a part"
                           : length < 48 ? "within its header"
                                         : "cut off",
                           "damaged: ");
    }
    for (size_t i = 0; i < size; ++i)
        for (int bit = 0; bit < 8; ++bit) {
            bytes[i] = (unsigned char)(bytes[i] ^ 1 << bit);
            write_file("damaged", bytes, size);
            check_refused_here(name, 1, "damaged: ", "");
            bytes[i] = (unsigned char)(bytes[i] ^ 1 << bit);
        }
}

/* Any bit of a header that is flipped before its checksum is stored. All but some screens and texts are refused. */
static void test_sealed_damage(void) {
    const made part = {2, 2, 1, 1, 0, "b\n", "o\n"};
    const size_t size = make_bytes(&part);
    int read = 0;
    for (size_t i = 0; i < texts_end(&part); ++i)
        for (int bit = 0; bit < 8; ++bit) {
            const char *path = path_of("damaged");
            ex_joined joined;
            ex_error error = {""};
            bytes[i] = (unsigned char)(bytes[i] ^ 1 << bit);
            seal(&part);
            write_file("damaged", bytes, size);
            if (ex_join(&path, 1, &joined, &error) == 0) {
                if (!CHECK(i >= 32 && (i < 40 || i >= 48))) printf("    byte %d, bit %d\n", (int)i, bit);
                free(joined.rgba), free(joined.depth);
                ++read;
            } else {
                CHECK(strstr(error.text, "damaged: ") && is_printable(error.text, strlen(error.text)));
            }
            bytes[i] = (unsigned char)(bytes[i] ^ 1 << bit);
        }
    CHECK(read >= 8 * 4); /* the texts */
}

/* A header of the largest picture in a small file: it is refused before memory is taken. */
static void test_large(void) {
    static const char *const name[] = {"large"};
    const size_t size = make_bytes(&usual);
    put(put(8, 16384, 4), 16384, 4);
    seal(&usual);
    write_file("large", bytes, size);
    check_refused_here(name, 1, "but its header says 5368709", "it was cut off or damaged");
    put(20, 16384, 4); /* one row, which is not there either */
    seal(&usual);
    write_file("large", bytes, size);
    check_refused_here(name, 1, "but its header says 327", "it was cut off or damaged");
}

/* A file of more than one block has the checksum of its blocks' checksums. */
static void test_file_checksum(void) {
    enum { BLOCK = 1 << 20, SIZE = BLOCK + 5 };
    unsigned char *data = (unsigned char *)malloc(SIZE);
    uint32_t checksum = 0;
    uint64_t size = 0;
    ex_error error;
    if (!CHECK(data != NULL)) return;
    for (unsigned i = 0; i < SIZE; ++i) data[i] = (unsigned char)(i * i >> 7);
    write_file("blocks", data, SIZE);
    put(put(0, 0, 4), slow_crc(data, BLOCK), 4);
    const unsigned first = slow_crc(bytes, 8);
    put(put(0, first, 4), slow_crc(data + BLOCK, 5), 4);
    CHECK(ex_file_checksum(path_of("blocks"), &checksum, &size, &error) == 0);
    CHECK(checksum == slow_crc(bytes, 8) && size == SIZE);
    write_file("blocks", data, 0);
    CHECK(ex_file_checksum(path_of("blocks"), &checksum, &size, &error) == 0 && checksum == 0 && size == 0);
    CHECK(ex_file_checksum(path_of("none"), &checksum, &size, &error) && strstr(error.text, "none: No such file"));
    free(data);
}

/* -------------------------------------------------------------------------------------------------- the programs */

/* Rendered by `count` processes, four at once. */
static void render_parts(const char *options, int count) {
    static char command[4000];
    char names[2000] = "";
    snprintf(command, sizeof command,
             "cd %s && rm -f part-* && i=0; while test $i -lt %d; do i=$((i + 1)); "
             "../tests/render %s --part $i/%d --out part-$i 2>>complaints & test $((i %% 4)) = 0 && wait; done; wait",
             folder, count, options, count);
    CHECK(system(command) == 0);
    for (int i = count; i >= 1; --i) snprintf(names + strlen(names), sizeof names - strlen(names), " part-%d", i);
    tested = "join";
    snprintf(command, sizeof command,
             "-o j.png --pfm j.pfm --alpha-pfm ja.pfm --exr j.exr --exr-type float --radiance-hdr j.hdr%s", names);
    const outcome got = run_render(command);
    tested = "render";
    if (!CHECK(got.status == 0 && !*got.said)) printf("    %s\n    %s\n", options, got.said);
}

static int same_files(const char *left, const char *right) {
    static char a[MOST], b[MOST];
    const int size = read_file(left, a, sizeof a);
    return size > 0 && size < MOST - 1 && read_file(right, b, sizeof b) == size && memcmp(a, b, (size_t)size) == 0;
}

static void write_scenes(void) {
    static const char mesh[] = "v -1 -1 -1\nv 1 -1 -1\nv 1 -1 1\nv -1 -1 1\nv 0 1 0\nf 1 4 3 2\nf 1 2 5\nf 3 4 5\n";
    unsigned char voxels[6 * 5 * 4];
    float particles[5 * 12];
    for (int i = 0; i < 120; ++i) voxels[i] = (unsigned char)(i * 37 % 200 + 20);
    for (int i = 0; i < 60; ++i) particles[i] = (float)(i * 17 % 23) / 23 * (i % 5 == 3 ? 0.4f : 1) + 0.05f;
    write_file("gas.raw", voxels, sizeof voxels);
    write_file("balls.raw", particles, sizeof particles);
    write_file("mesh.obj", mesh, sizeof mesh - 1);
}

#define GAS   "--volume gas.raw --size 6,5,4 --extinction 6 "
#define BALLS "--particles balls.raw "
#define MESH  "--mesh mesh.obj "
#define SUN   "--light directional,-1,-2,-0.5,3,3,2 "

/* Joined pictures have the bits of one render, in every file. */
static void test_processes(void) {
    static const struct {
        const char *options;
        int counts[3];
    } scenes[] = {
        {MESH SUN "--coverage 3 --background 0.1,0.2,0.3 --width 23 --height 9 --camera 3,2,1,0,0,0", {4, 1, 9}},
        {GAS SUN "--scattering multiple --scattering-resolution 8 --width 7 --height 31", {4, 3, 31}},
        {BALLS SUN "--scattering multiple --scattering-resolution 6 --width 29 --height 10", {4, 0, 0}},
        {GAS BALLS MESH SUN "--scattering single --shadow moment --ortho 3 --width 16 --height 13", {4, 0, 0}},
        {GAS MESH SUN "--reference --samples 2 --width 9 --height 12", {4, 0, 0}}};
    static const char *const whole[] = {"w.png", "w.pfm", "wa.pfm", "w.exr", "w.hdr"};
    static const char *const joined[] = {"j.png", "j.pfm", "ja.pfm", "j.exr", "j.hdr"};
    static const char files[] = "--out w.png --pfm w.pfm --alpha-pfm wa.pfm --exr w.exr --exr-type float "
                                "--radiance-hdr w.hdr";
    for (size_t s = 0; s < sizeof scenes / sizeof *scenes; ++s) {
        char options[1000], said[1000];
        snprintf(options, sizeof options, "%s %s", scenes[s].options, files);
        CHECK(run_render(options).status == 0);
        for (int k = 0; k < 3 && scenes[s].counts[k]; ++k) {
            render_parts(scenes[s].options, scenes[s].counts[k]);
            for (int i = 0; i < 5; ++i)
                if (!CHECK(same_files(whole[i], joined[i])))
                    printf("    %s: %d parts of %s\n", joined[i], scenes[s].counts[k], scenes[s].options);
        }
        if (!CHECK(read_file("complaints", said, sizeof said) == 0)) printf("    %s\n", said);
    }
}

#define SMALL MESH "--width 5 --height 4 "

/* What changes no bit may differ; the rest may not. */
static void test_what_matters(void) {
    static const complaint parts[] = {
        {SMALL "--part 1/2 --out one --threads 1 --max-bytes 1e8", 0, NULL},
        {SMALL "--part 2/2 --out two --threads 2 --stats stats.json", 0, NULL},
        {"--look looks/small.txt --part 2/2 --out looked", 0, NULL},
        {SMALL "--part 2/2 --out fine --quality high", 0, NULL},
        {SMALL "--part 2/2 --out wide --width 6", 0, NULL},
        {SMALL "--part 2/3 --out third", 0, NULL},
        {"--mesh looks/mesh.obj --width 5 --height 4 --part 2/2 --out moved", 0, NULL},
        {"--mesh other/mesh.obj --width 5 --height 4 --part 2/2 --out other.part", 0, NULL},
        {GAS "--width 5 --height 4 --scattering single --part 2/2 --out gas", 0, NULL},
        {SMALL "--part 2/2 --plan >plan", 0, NULL}};
    static const complaint joins[] = {
        {"-o j.png one two", 0, NULL},
        {"-o j.png two one", 0, NULL},
        {"-o j.png one looked", 0, NULL},
        {"-o j.png one moved", 0, NULL},
        {"-o j.png one fine", 2, "fine: another picture: --quality high, where one has nothing"},
        {"-o j.png one wide", 2, "wide: of a picture of 6 x 4 pixels, where one is of 5 x 4"},
        {"-o j.png one third", 2, "third: one of 3 parts, where one is one of 2"},
        {"-o j.png one other.part", 2, "other.part: another picture: --mesh mesh.obj: checksum "},
        {"-o j.png one gas", 2, "gas: another picture: --volume gas.raw: checksum "},
        {"-o j.png one two two", 2, "two and two are both part 2 of 2"},
        {"-o j.png two", 2, "part 1 of 2 is missing"},
        {"-o j.png mesh.obj", 2, "mesh.obj: not a part of a picture: it does not start with SPSPART"},
        {"-o j.png none", 2, "none: No such file"},
        {"-o j.png .", 2, ".: not a regular file"}};
    static const char other[] = "v -1 -1 -1\nv 1 -1 -1\nv 1 -1 1\nf 1 2 3\n",
                      look[] = "mesh mesh.obj\nwidth 5\nheight 4\n";
    char text[2000];
    mkdir(path_of("looks"), 0777), mkdir(path_of("other"), 0777);
    write_file("other/mesh.obj", other, sizeof other - 1);
    write_file("looks/small.txt", look, sizeof look - 1);
    write_file("looks/mesh.obj", text, (size_t)read_file("mesh.obj", text, sizeof text));
    CHECK_COMPLAINTS(parts);
    CHECK(read_file("stats.json", text, sizeof text) > 60 && strstr(text, "\"tiles_finished\""));
    tested = "join";
    CHECK_COMPLAINTS(joins);
    tested = "render";
}

static void write_inputs(void) {
    static const char header[] = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 6 5 4\nencoding: raw\ndata file: d.raw\n";
    static const char colors[] = "NRRD0004\ntype: uchar\ndimension: 4\nsizes: 3 6 5 4\nkinds: RGB-color domain domain "
                                 "domain\nencoding: raw\ndata file: c.raw\n";
    static const char points[] = "0 0 0 0 0\n1 1 0.5 0 20\n", image[] = "P6 1 2 255 abcdef";
    unsigned char voxels[3 * 6 * 5 * 4];
    for (size_t i = 0; i < sizeof voxels; ++i) voxels[i] = (unsigned char)(i * 31 % 250);
    write_file("d.nhdr", header, sizeof header - 1);
    write_file("c.nhdr", colors, sizeof colors - 1);
    write_file("d.raw", voxels, 6 * 5 * 4);
    write_file("c.raw", voxels, sizeof voxels);
    write_file("points.txt", points, sizeof points - 1);
    write_file("image.ppm", image, sizeof image - 1);
}

/* Whatever file a picture is made of, a bit of it that changes between two parts is noticed. */
static void test_changed_inputs(void) {
    static const struct {
        const char *options, *file, *words;
        int at;
    } inputs[] = {{MESH, "mesh.obj", "--mesh mesh.obj: checksum ", 3},
                  {GAS, "gas.raw", "--volume gas.raw: checksum ", 60},
                  {BALLS, "balls.raw", "--particles balls.raw: checksum ", 40},
                  {"--volume d.nhdr", "d.raw", "voxels of d.raw: checksum ", 60},
                  {"--volume d.nhdr --albedo-volume c.nhdr", "c.raw", "voxels of c.raw: checksum ", 60},
                  {"--volume d.nhdr --emission-volume c.nhdr", "c.raw", "voxels of c.raw: checksum ", 60},
                  {"--volume gas.raw --size 6,5,4 --transfer points.txt", "points.txt", "--transfer points.txt: ", 21},
                  {MESH "--light projector,0,3,0,0,-1,0.1,40,9,9,9,image.ppm", "image.ppm", "--light image.ppm: ", 15}};
    write_inputs();
    for (size_t i = 0; i < sizeof inputs / sizeof *inputs; ++i) {
        static char text[4000];
        char options[2][300], words[100];
        for (int k = 0; k < 2; ++k)
            snprintf(options[k], sizeof options[k],
                     "%s --scattering single --width 4 --height 4 --part %d/2 --out in%d", inputs[i].options, k + 1,
                     k + 1);
        snprintf(words, sizeof words, "in2: another picture: %s", inputs[i].words);
        const complaint first = {options[0], 0, NULL}, second = {options[1], 0, NULL};
        const complaint whole = {"-o j.png in1 in2", 0, NULL}, refused = {"-o j.png in1 in2", 2, words};
        check_complaints(&first, 1), check_complaints(&second, 1);
        tested = "join", check_complaints(&whole, 1), tested = "render";
        const int size = read_file(inputs[i].file, text, sizeof text);
        text[inputs[i].at] = (char)(text[inputs[i].at] ^ 1);
        write_file(inputs[i].file, text, (size_t)size);
        check_complaints(&second, 1);
        tested = "join", check_complaints(&refused, 1), tested = "render";
    }
}

static void test_options(void) {
    static const complaint render[] = {
        {SMALL "--part 0/4 --out x", 2, "--part: '0/4' will not do: parts are numbered from 1 to N"},
        {SMALL "--part 5/4 --out x", 2, "--part: '5/4' will not do: parts are numbered from 1 to N"},
        {SMALL "--part 1/5 --out x", 2, "--part 1/5: a picture of 4 rows has at most 4 parts"},
        {SMALL "--part 1/16385 --out x", 2, "--part: '1/16385' is out of range"},
        {SMALL "--part 1 --out x", 2, "--part: '1' is not I/N"},
        {SMALL "--part 1/ --out x", 2, "--part: '1/' is not I/N"},
        {SMALL "--part /4 --out x", 2, "--part: '/4' is not I/N"},
        {SMALL "--part 1/4/2 --out x", 2, "--part: '1/4/2' is not I/N"},
        {SMALL "--part -1/4 --out x", 2, "--part: '-1/4' is not I/N"},
        {SMALL "--part 1/99999999999999999999 --out x", 2, "--part: '1/99999999999999999999' is not I/N"},
        {SMALL "--part 1/4", 2, "--part needs --out"},
        {SMALL "--part 1/4 --out x --region 0,0,1,1", 2, "--part and --region exclude each other"},
        {SMALL "--part 1/4 --out x --budget-seconds 1", 2, "--part and --budget-seconds exclude each other"},
        {SMALL "--part 1/4 --out x --budget-error 1", 2, "--part and --budget-error exclude each other"},
        {SMALL "--part 1/4 --out x --pfm y", 2, "--part and --pfm exclude each other"},
        {SMALL "--part 1/4 --out x --alpha-pfm y", 2, "--part and --alpha-pfm exclude each other"},
        {SMALL "--part 1/4 --out x --exr y", 2, "--part and --exr exclude each other"},
        {SMALL "--part 1/4 --out x --radiance-hdr y", 2, "--part and --radiance-hdr exclude each other"},
        {SMALL "--part 1/4 --out mesh.obj", 2, "--out mesh.obj is a file that --mesh reads"},
        {SMALL "--part 1/4 --out no/x", 2, "no/x: cannot be written"}};
    static const complaint join[] = {
        {"", 2, "nothing to join"},
        {"-o j.png", 2, "nothing to join"},
        {"whole", 2, "nothing to write: give -o"},
        {"-o j.gif whole", 2, "-o j.gif: the name must end in .png, .pfm, .exr or .hdr"},
        {"whole -o", 2, "-o needs a value"},
        {"--bogus x whole", 2, "unknown option '--bogus'"},
        {"-o j.png --exr-type float whole", 2, "--exr-type says nothing without --exr"},
        {"-o j.png --exr-compression zip whole", 2, "--exr-compression says nothing without --exr"},
        {"-o j.exr --exr-type double whole", 2, "--exr-type: 'double' is not half or float"},
        {"--out whole whole", 2, "--out whole is one of the parts"},
        {"-o j.pfm --alpha-pfm j.pfm whole", 2, "--pfm and --alpha-pfm are the same file: j.pfm"},
        {"-o no/j.pfm whole", 2, "no/j.pfm: cannot be written"},
        {"-o j.PNG -o j.Hdr -o j.pfm --exr-compression none -o j.exr whole", 0, NULL},
        {"--help >help", 0, NULL}};
    write_made("whole", &usual);
    CHECK_COMPLAINTS(render);
    tested = "join";
    CHECK_COMPLAINTS(join);
    tested = "render";
}

int main(void) {
    const int there = folder_begin();
    if (!there) return printf("skipped: no folder for files can be made here\n"), check_report();
    RUN(test_reading);
    RUN(test_writing);
    RUN(test_rows);
    RUN(test_differences);
    RUN(test_missing);
    RUN(test_numbers);
    RUN(test_damage);
    RUN(test_sealed_damage);
    RUN(test_large);
    RUN(test_file_checksum);
    tested = "join";
    const int is_built = render_is_built();
    tested = "render";
    if (is_built && render_is_built()) {
        write_scenes();
        if (!check_memory_only()) RUN(test_processes);
        RUN(test_what_matters);
        RUN(test_changed_inputs);
        RUN(test_options);
    } else {
        printf("skipped: the programs: build/tests/render and join are not built\n");
    }
    folder_end();
    return check_report();
}
