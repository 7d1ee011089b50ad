/* OpenEXR files of examples/exr.h, and what examples/deflate.h packs. A reader that knows nothing of the writer, and
   unpacks by itself, finds every field and every pixel, bit for bit; so do OpenEXR's own tools, if they are installed.
   Radiance pictures are those of the command line. */

#include "check.h"
#include "exr.h"
#include "command_line.h"
#include <unistd.h>

/* -------------------------------------------------------------------------------------------------- reading bytes */

typedef struct cursor {
    const unsigned char *data;
    size_t size, at;
    int failed; /* 1: something beyond the end was asked for */
} cursor;

static const unsigned char *take(cursor *from, size_t count) {
    static const unsigned char nothing[64] = {0};
    if (from->at > from->size || count > from->size - from->at) {
        from->failed = 1;
        return nothing;
    }
    from->at += count;
    return from->data + from->at - count;
}

static uint64_t take_number(cursor *from, int size) {
    uint64_t number = 0;
    const unsigned char *bytes = take(from, (size_t)size);
    for (int i = 0; i < size; ++i) number |= (uint64_t)bytes[i] << 8 * i;
    return number;
}

static int take_int(cursor *from) { return (int)(int32_t)(uint32_t)take_number(from, 4); }

static float take_float(cursor *from) {
    const uint32_t bits = (uint32_t)take_number(from, 4);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* A text that ends with a 0 byte; names in these files have at most 31 characters. */
static void take_text(cursor *from, char text[32]) {
    for (int i = 0; i < 32; ++i) {
        text[i] = (char)take_number(from, 1);
        if (text[i] == 0) return;
    }
    from->failed = 1, text[31] = 0;
}

/* -------------------------------------------------------------------------------------------------------- unpacking */

/* Bits of a deflate stream, lowest first. */
typedef struct bit_reader {
    cursor bytes;
    unsigned held, count;
} bit_reader;

static unsigned bits(bit_reader *from, int count) {
    unsigned value = 0;
    for (int i = 0; i < count; ++i) {
        if (from->count == 0) from->held = (unsigned)take_number(&from->bytes, 1), from->count = 8;
        value |= (from->held & 1u) << i;
        from->held >>= 1, --from->count;
    }
    return value;
}

/* A symbol of the fixed code: its bits are compared with the three ranges of RFC 1951, 3.2.6. */
static int fixed_symbol(bit_reader *from) {
    unsigned code = 0;
    for (int length = 1; length <= 9; ++length) {
        code = code << 1 | bits(from, 1);
        if (length == 7 && code <= 0x17) return (int)code + 256;
        if (length == 8 && code >= 0x30 && code <= 0xbf) return (int)code - 0x30;
        if (length == 8 && code >= 0xc0 && code <= 0xc7) return (int)code - 0xc0 + 280;
        if (length == 9 && code >= 0x190) return (int)code - 0x190 + 144;
    }
    return -1;
}

/* The tables of RFC 1951, 3.2.5: least length or distance, and the number of extra bits. */
static const int least_lengths[29] = {3,  4,  5,  6,  7,  8,  9,  10, 11,  13,  15,  17,  19,  23, 27,
                                      31, 35, 43, 51, 59, 67, 83, 99, 115, 131, 163, 195, 227, 258};
static const int length_bits[29] = {0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2,
                                    2, 3, 3, 3, 3, 4, 4, 4, 4, 5, 5, 5, 5, 0};
static const int least_distances[30] = {1,    2,    3,    4,    5,    7,    9,    13,    17,    25,
                                        33,   49,   65,   97,   129,  193,  257,  385,   513,   769,
                                        1025, 1537, 2049, 3073, 4097, 6145, 8193, 12289, 16385, 24577};

/* Copies a match to the end of `out`. Returns its length; 0 if it is none. */
static size_t unpack_match(bit_reader *from, int symbol, unsigned char *out, size_t count, size_t room) {
    unsigned code = 0;
    const int index = symbol - 257;
    if (index > 28) return 0;
    const size_t length = (size_t)least_lengths[index] + bits(from, length_bits[index]);
    for (int i = 0; i < 5; ++i) code = code << 1 | bits(from, 1);
    if (code > 29) return 0;
    const size_t distance = (size_t)least_distances[code] + bits(from, code < 4 ? 0 : (int)code / 2 - 1);
    if (distance > count || distance > 32768 || length > room - count) return 0;
    for (size_t i = 0; i < length; ++i) out[count + i] = out[count + i - distance];
    return length;
}

/* Unpacks a zlib stream that has one block with the fixed code. Returns whether it is one, and has that size and no
   byte behind it. */
static int unpack(const unsigned char *data, size_t size, unsigned char *out, size_t wanted) {
    bit_reader from = {{data, size, 0, 0}, 0, 0};
    unsigned long a = 1, b = 0, sum = 0;
    size_t count = 0;
    if (((unsigned)data[0] << 8 | data[1]) % 31 != 0 || (data[0] & 15) != 8 || data[0] >> 4 > 7 || data[1] & 32)
        return 0;
    from.bytes.at = 2;
    if (bits(&from, 1) != 1 || bits(&from, 2) != 1) return 0;
    for (int symbol; (symbol = fixed_symbol(&from)) != 256;) {
        if (symbol < 0 || from.bytes.failed || (symbol < 256 && count == wanted)) return 0;
        const size_t length = symbol > 256 ? unpack_match(&from, symbol, out, count, wanted) : 1;
        if (length == 0) return 0;
        if (symbol < 256) out[count] = (unsigned char)symbol;
        count += length;
    }
    for (size_t i = 0; i < count; ++i) a = (a + out[i]) % 65521, b = (b + a) % 65521;
    for (int i = 0; i < 4; ++i) sum = sum << 8 | (unsigned long)take_number(&from.bytes, 1);
    return count == wanted && !from.bytes.failed && from.bytes.at == size && sum == (b << 16 | a);
}

/* Packs and unpacks. Returns the packed size. */
static size_t check_packing(const unsigned char *data, size_t size) {
    unsigned char *packed = NULL, *back = (unsigned char *)malloc(size + 1);
    const size_t packed_size = ex_deflate(data, size, &packed);
    if (!CHECK(unpack(packed, packed_size, back, size) && memcmp(back, data, size) == 0))
        printf("    %zu bytes as %zu\n", size, packed_size);
    free(packed), free(back);
    return packed_size;
}

static unsigned next_random(unsigned *state) {
    *state = *state * 1664525u + 1013904223u;
    return *state >> 16;
}

/* Every byte, runs, and repetitions at every distance around powers of two and the window's end, and of every length.
   A match has at most 8 + 5 + 5 + 13 bits; without any, a byte has at most 9. */
static void test_packing(void) {
    enum { SIZE = 100000 };
    unsigned char *data = (unsigned char *)calloc(SIZE, 1);
    unsigned state = 1;
    CHECK(check_packing(data, 0) <= 8);
    CHECK(check_packing(data, SIZE) <= 8 + SIZE / 257 * 31 / 8);
    for (size_t size = 1; size < 600; ++size) check_packing(data, size);
    for (size_t i = 0; i < SIZE; ++i) data[i] = (unsigned char)next_random(&state);
    CHECK(check_packing(data, SIZE) <= 8 + SIZE / 8 * 9);
    for (size_t length = 1; length < 300; ++length) {
        memmove(data + 400, data, length);
        check_packing(data, 400 + length + 3);
    }
    for (size_t distance = 1; distance <= 32770; distance = distance < 40 ? distance + 1 : distance * 5 / 4) {
        for (size_t i = distance; i < 70000; ++i) data[i] = data[i - distance];
        const size_t size = check_packing(data, 70000);
        CHECK(size <= 8 + 9 * (distance + 2) / 8 + 70000 / 257 * 31 / 8 + 4);
    }
    for (size_t distance = 32765; distance <= 32770; ++distance) {
        for (size_t i = 0; i < distance; ++i) data[i] = (unsigned char)next_random(&state);
        memcpy(data + distance, data, SIZE / 2 - distance);
        check_packing(data, SIZE / 2);
    }
    free(data);
}

/* ------------------------------------------------------------------------------------------------------------ halves
 */

/* The value of a finite half. */
static double half_value(unsigned half) {
    const int exponent = half >> 10 & 31;
    const double size = ldexp(half & 1023, exponent ? exponent - 25 : -24) + (exponent ? ldexp(1, exponent - 15) : 0);
    return half & 0x8000 ? -size : size;
}

/* Every half is itself; what is between two becomes the nearer, and in the middle the even one. */
static void test_halves(void) {
    int wrong = 0;
    for (unsigned half = 0; half < 0x7c00; ++half) {
        const double here = half_value(half), next = half < 0x7bff ? half_value(half + 1) : 65536;
        const float middle = (float)(0.5 * (here + next));
        const unsigned even = half & 1 ? half + 1 : half, above = half + 1;
        wrong += ex_half_bits((float)here) != half || ex_half_bits(-(float)here) != (half | 0x8000);
        if (half == 0x7bff) continue;
        wrong += ex_half_bits(middle) != even || ex_half_bits(-middle) != (even | 0x8000);
        wrong += ex_half_bits(nextafterf(middle, 0)) != half || ex_half_bits(nextafterf(middle, 1e9f)) != above;
    }
    CHECK(wrong == 0);
    CHECK(ex_half_bits(65505.0f) == 0x7bff && ex_half_bits(65520.0f) == 0x7bff && ex_half_bits(FLT_MAX) == 0x7bff);
    CHECK(ex_half_bits(-65520.0f) == 0xfbff && ex_half_bits(INFINITY) == 0x7c00 && ex_half_bits(-INFINITY) == 0xfc00);
    CHECK((ex_half_bits(NAN) & 0x7fff) > 0x7c00);
    CHECK(ex_half_bits(FLT_MIN) == 0 && ex_half_bits(-1e-45f) == 0x8000);
}

/* --------------------------------------------------------------------------------------------------------- the reader
 */

enum { CHANNELS = 5, PIXELS_MAX = 4000 };

typedef struct channel_list {
    int count, types[CHANNELS]; /* 1: half, 2: float */
    char names[CHANNELS + 1];
} channel_list;

/* What a file says, and the bits of its pixels. */
typedef struct exr_file {
    int version, attributes, others; /* numbers of those that are read, and that are not */
    channel_list channels;
    float chromaticities[8], aspect, center[2], screen_width;
    int data_window[4], display_window[4], compression, line_order;
    int tile[2]; /* 0: scan lines */
    int width, height;
    uint32_t pixels[CHANNELS][PIXELS_MAX];
} exr_file;

static int read_channels(cursor *from, channel_list *list) {
    for (list->count = 0;;) {
        char name[32];
        take_text(from, name);
        if (name[0] == 0) return 1;
        if (list->count == CHANNELS || name[1] != 0) return 0;
        list->names[list->count] = name[0];
        list->types[list->count++] = take_int(from);
        if (take_int(from) != 0 || take_int(from) != 1 || take_int(from) != 1) return 0;
    }
}

static void take_ints(cursor *from, int *out, int count) {
    for (int i = 0; i < count; ++i) out[i] = take_int(from);
}

static void take_floats(cursor *from, float *out, int count) {
    for (int i = 0; i < count; ++i) out[i] = take_float(from);
}

/* Reads the value of an attribute of this name and type. Returns whether it is known. */
static int read_value(cursor *from, const char *name, const char *type, exr_file *file) {
    char kind[70];
    snprintf(kind, sizeof kind, "%s:%s", name, type);
    if (strcmp(kind, "channels:chlist") == 0) return read_channels(from, &file->channels);
    if (strcmp(kind, "chromaticities:chromaticities") == 0)
        take_floats(from, file->chromaticities, 8);
    else if (strcmp(kind, "compression:compression") == 0)
        file->compression = (int)take_number(from, 1);
    else if (strcmp(kind, "dataWindow:box2i") == 0)
        take_ints(from, file->data_window, 4);
    else if (strcmp(kind, "displayWindow:box2i") == 0)
        take_ints(from, file->display_window, 4);
    else if (strcmp(kind, "lineOrder:lineOrder") == 0)
        file->line_order = (int)take_number(from, 1);
    else if (strcmp(kind, "pixelAspectRatio:float") == 0)
        take_floats(from, &file->aspect, 1);
    else if (strcmp(kind, "screenWindowCenter:v2f") == 0)
        take_floats(from, file->center, 2);
    else if (strcmp(kind, "screenWindowWidth:float") == 0)
        take_floats(from, &file->screen_width, 1);
    else if (strcmp(kind, "tiles:tiledesc") == 0)
        take_ints(from, file->tile, 2), take(from, 1);
    else
        return 0;
    return 1;
}

static int read_header(cursor *from, exr_file *file) {
    memset(file, 0, sizeof *file);
    if (take_int(from) != 0x01312f76) return 0;
    file->version = take_int(from);
    for (;;) {
        char name[32], type[32];
        take_text(from, name);
        if (name[0] == 0) break;
        take_text(from, type);
        const size_t size = (size_t)take_number(from, 4), end = from->at + size;
        if (read_value(from, name, type, file))
            ++file->attributes;
        else
            take(from, size), ++file->others;
        if (from->failed || from->at != end) return 0;
    }
    file->width = file->data_window[2] - file->data_window[0] + 1;
    file->height = file->data_window[3] - file->data_window[1] + 1;
    return file->width > 0 && file->height > 0 && file->width * file->height <= PIXELS_MAX;
}

/* Bytes of `width` x `height` pixels. */
static size_t pixel_bytes(const exr_file *file, int width, int height) {
    size_t size = 0;
    for (int i = 0; i < file->channels.count; ++i) size += file->channels.types[i] == 1 ? 2 : 4;
    return size * (size_t)width * (size_t)height;
}

/* Turns bytes back from ZIP's order and differences. */
static void unsort(const unsigned char *sorted, size_t size, unsigned char *out) {
    const size_t half = (size + 1) / 2;
    unsigned char sum = 0;
    for (size_t i = 0; i < size; ++i) {
        sum = (unsigned char)(i == 0 ? sorted[0] : sum + sorted[i] - 128);
        out[i < half ? 2 * i : 2 * (i - half) + 1] = sum;
    }
}

/* Reads a rectangle of pixels, which are packed if they are fewer bytes than expected. */
static int read_rectangle(cursor *from, exr_file *file, const int rectangle[4]) {
    static unsigned char sorted[20 * PIXELS_MAX], plain[20 * PIXELS_MAX];
    const size_t size = (size_t)take_number(from, 4), wanted = pixel_bytes(file, rectangle[2], rectangle[3]);
    const unsigned char *data = take(from, size);
    if (from->failed || size > wanted || (size < wanted && file->compression != 3)) return 0;
    if (size < wanted) {
        if (!unpack(data, size, sorted, wanted)) return 0;
        unsort(sorted, wanted, plain);
        data = plain;
    }
    cursor pixels = {data, wanted, 0, 0};
    for (int y = rectangle[1]; y < rectangle[1] + rectangle[3]; ++y)
        for (int c = 0; c < file->channels.count; ++c)
            for (int x = rectangle[0]; x < rectangle[0] + rectangle[2]; ++x)
                file->pixels[c][y * file->width + x] =
                    (uint32_t)take_number(&pixels, file->channels.types[c] == 1 ? 2 : 4);
    return !pixels.failed;
}

static int smaller(int a, int b) { return a < b ? a : b; }

/* Reads all chunks, which must follow each other, and where the table says. */
static int read_lines(cursor *from, exr_file *file) {
    const int lines = file->compression == 3 ? 16 : 1, count = (file->height + lines - 1) / lines;
    cursor table = *from;
    from->at += 8 * (size_t)count;
    for (int i = 0; i < count; ++i) {
        const int rectangle[4] = {0, i * lines, file->width, smaller(lines, file->height - i * lines)};
        if (take_number(&table, 8) != from->at) return 0;
        if (take_int(from) != file->data_window[1] + i * lines) return 0;
        if (!read_rectangle(from, file, rectangle)) return 0;
    }
    return from->at == from->size;
}

/* Tiles in any order. */
static int read_tiles(cursor *from, exr_file *file) {
    const int across = (file->width + file->tile[0] - 1) / file->tile[0];
    const int count = across * ((file->height + file->tile[1] - 1) / file->tile[1]);
    cursor table = *from;
    for (int i = 0; i < count; ++i) {
        from->at = (size_t)take_number(&table, 8);
        const int x = take_int(from) * file->tile[0], y = take_int(from) * file->tile[1];
        const int rectangle[4] = {x, y, smaller(file->tile[0], file->width - x),
                                  smaller(file->tile[1], file->height - y)};
        if (take_int(from) != 0 || take_int(from) != 0 || x < 0 || y < 0 || x >= file->width || y >= file->height)
            return 0;
        if (!read_rectangle(from, file, rectangle)) return 0;
    }
    return 1;
}

/* Reads a file of the folder. */
static int read_exr(const char *name, exr_file *file) {
    static char data[1 << 18];
    cursor from = {(const unsigned char *)data, (size_t)read_file(name, data, sizeof data), 0, 0};
    return CHECK(from.size < sizeof data - 1) && read_header(&from, file) &&
           (file->tile[0] > 0 ? read_tiles(&from, file) : read_lines(&from, file)) && !from.failed;
}

/* ------------------------------------------------------------------------------------------------------------ pictures
 */

/* A picture of all kinds of numbers. */
typedef struct picture {
    float rgba[4 * PIXELS_MAX], depth[PIXELS_MAX];
    ex_exr exr;
    char path[200];
} picture;

static const float odd_values[] = {0,     -0.0f, 1,    0.1f,   -2.5f,   1e-7f,     6.1e-5f, 3e-8f,
                                   65504, 65519, 1e9f, 1e-45f, FLT_MAX, 0.333333f, 2049,    1.0009766f};

/* Smooth in its middle, so that some rows shrink by ZIP, random elsewhere. */
static void make_picture(picture *made, int width, int height, int which) {
    static const float specials[3] = {INFINITY, NAN, -INFINITY};
    unsigned state = (unsigned)which + 7;
    memset(made, 0, sizeof *made);
    snprintf(made->path, sizeof made->path, "%s/a.exr", folder);
    for (int i = 0; i < width * height; ++i) {
        for (int c = 0; c < 4; ++c)
            made->rgba[4 * i + c] = which % 2 ? 0.25f * (float)(i % 7 == 0)
                                    : i % 3   ? (float)next_random(&state) / 65536
                                              : odd_values[next_random(&state) % 16];
        made->depth[i] = which % 2 ? 3 : (float)next_random(&state);
    }
    if (width * height > 3)
        for (int i = 0; i < 3; ++i) made->rgba[4 * i + i] = specials[i], made->depth[i] = specials[i];
    made->exr.rgba = made->rgba, made->exr.depth = which & 4 ? NULL : made->depth;
    made->exr.width = width, made->exr.height = height;
    made->exr.is_float = which >> 1 & 1, made->exr.zip = which >> 3 & 1;
}

/* The bits that a file must have. Halves are found among all of them, since test_halves has shown what they are. */
static uint32_t expected_bits(const picture *made, const char *name, int pixel) {
    const float value =
        *name == 'Z' ? made->depth[pixel] : made->rgba[4 * pixel + (int)(strchr("RGBA", *name) - "RGBA")];
    uint32_t whole;
    memcpy(&whole, &value, sizeof whole);
    return *name == 'Z' || made->exr.is_float ? whole : ex_half_bits(value);
}

static int same_pixels(const picture *made, const exr_file *file) {
    for (int c = 0; c < file->channels.count; ++c)
        for (int i = 0; i < file->width * file->height; ++i)
            if (file->pixels[c][i] != expected_bits(made, &file->channels.names[c], i)) return 0;
    return 1;
}

static int same_numbers(const int *a, int x0, int y0, int x1, int y1) {
    return a[0] == x0 && a[1] == y0 && a[2] == x1 && a[3] == y1;
}

static void check_header(const picture *made, const exr_file *file, const char *channels) {
    static const float rec_709[8] = {0.64f, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 0.3127f, 0.329f};
    const ex_exr *exr = &made->exr;
    const int *part = exr->region;
    CHECK(file->version == 2 && file->attributes == 9 && file->others == 0);
    CHECK(strcmp(file->channels.names, channels) == 0);
    for (int i = 0; i < file->channels.count; ++i)
        CHECK(file->channels.types[i] == (exr->is_float || channels[i] == 'Z' ? 2 : 1));
    CHECK(memcmp(file->chromaticities, rec_709, sizeof rec_709) == 0);
    CHECK(file->compression == (exr->zip ? 3 : 0) && file->line_order == 0);
    CHECK(same_numbers(file->display_window, 0, 0, exr->width - 1, exr->height - 1));
    if (part[2] > 0)
        CHECK(same_numbers(file->data_window, part[0], part[1], part[0] + part[2] - 1, part[1] + part[3] - 1));
    else
        CHECK(same_numbers(file->data_window, 0, 0, exr->width - 1, exr->height - 1));
    CHECK(file->aspect == 1 && file->center[0] == 0 && file->center[1] == 0);
    CHECK(file->screen_width == (exr->screen_width > 0 ? (float)exr->screen_width : 1));
}

/* Writes and reads. */
static void check_picture(const picture *made) {
    static exr_file file;
    ex_error error;
    if (!CHECK(ex_write_exr(made->path, &made->exr, &error) == 0) || !CHECK(read_exr("a.exr", &file))) return;
    check_header(made, &file, made->exr.depth ? "ABGRZ" : "ABGR");
    CHECK(same_pixels(made, &file));
}

/* All combinations of type, compression and Z, whole and in part; one pixel, and rows around ZIP's 16. */
static void test_pictures(void) {
    static const int sizes[][2] = {{1, 1}, {5, 4}, {7, 15}, {64, 16}, {33, 17}, {13, 49}, {1, 32}, {90, 3}};
    static picture made;
    for (int which = 0; which < 16; ++which)
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes; ++i) {
            make_picture(&made, sizes[i][0], sizes[i][1], which);
            made.exr.screen_width = which % 3 * 0.7;
            check_picture(&made);
            made.exr.region[0] = 3, made.exr.region[1] = 1 + which;
            made.exr.region[2] = made.exr.width, made.exr.region[3] = made.exr.height;
            made.exr.width += 10, made.exr.height += 20;
            check_picture(&made);
        }
}

/* Even pictures shrink by ZIP. Without it, a row of 64 pixels has 12 bytes for each, and 16 for its place and size. */
static void test_sizes(void) {
    static picture made;
    static char data[1 << 18];
    ex_error error;
    make_picture(&made, 64, 48, 1);
    CHECK(ex_write_exr(made.path, &made.exr, &error) == 0);
    const int plain = read_file("a.exr", data, sizeof data);
    made.exr.zip = 1;
    CHECK(ex_write_exr(made.path, &made.exr, &error) == 0);
    const int zipped = read_file("a.exr", data, sizeof data);
    CHECK(plain > (12 * 64 + 16) * 48 && plain < (12 * 64 + 16) * 48 + 600);
    CHECK(zipped > 400 && zipped < plain / 10);
}

static void test_failures(void) {
    static picture made;
    static const char *const wrong[] = {"/dev/full", "missing/a.exr", "build"};
    ex_error error;
    for (int i = 0; i < 6; ++i) {
        make_picture(&made, 40, 40, i < 3 ? 0 : 8);
        if (i % 3 == 0 && access("/dev/full", W_OK) != 0) continue;
        error.text[0] = 0;
        CHECK(ex_write_exr(wrong[i % 3], &made.exr, &error) == 1);
        CHECK(strncmp(error.text, wrong[i % 3], strlen(wrong[i % 3])) == 0 &&
              is_printable(error.text, strlen(error.text)));
    }
}

/* OpenEXR's own library reads each file and writes it as tiles, uncompressed, which have the same bits. */
static void test_tools(void) {
    static picture made;
    static exr_file file;
    char command[200], text[4000];
    ex_error error;
    if (system("command -v exrmaketiled >/dev/null && command -v exrheader >/dev/null") != 0) {
        printf("skipped: OpenEXR's own tools: install openexr\n");
        return;
    }
    for (int which = 0; which < 16; ++which) {
        make_picture(&made, 75, 35, which);
        made.exr.region[0] = 2, made.exr.region[1] = 3, made.exr.region[2] = 75, made.exr.region[3] = 35;
        made.exr.width = 200, made.exr.height = 100, made.exr.screen_width = 0.5;
        CHECK(ex_write_exr(made.path, &made.exr, &error) == 0);
        snprintf(command, sizeof command, "cd %s && exrmaketiled -z none a.exr tiles.exr && exrheader a.exr >header",
                 folder);
        if (!CHECK(system(command) == 0) || !CHECK(read_exr("tiles.exr", &file))) continue;
        CHECK(file.tile[0] > 0 && same_pixels(&made, &file));
        CHECK(strcmp(file.channels.names, made.exr.depth ? "ABGRZ" : "ABGR") == 0);
        CHECK(same_numbers(file.data_window, 2, 3, 76, 37) && same_numbers(file.display_window, 0, 0, 199, 99));
        CHECK(read_file("header", text, sizeof text) > 0 && strstr(text, "screenWindowWidth (type float): 0.5"));
        CHECK(strstr(text, made.exr.zip ? "zip" : "none") && strstr(text, "white (0.3127 0.329)"));
    }
}

/* ---------------------------------------------------------------------------------------------------- the command line
 */

#define SCENE                                                                                                          \
    "--volume two.raw --size 2,2,2 --scattering single --background 0.3,0.002,90000 --fov 50 --camera "                \
    "0.5,1,4,0.5,0.5,0.5 "
#define PART "--width 21 --height 20 --region 2,1,17,18 "

static float pfm_value(const char *data, int size, int channels, int x, int y, int c) {
    cursor from = {(const unsigned char *)data, (size_t)size, 0, 0};
    from.at = (size_t)(size - 4 * channels * 17 * 18 + 4 * (channels * (17 * (17 - y) + x) + c));
    return take_float(&from);
}

/* Pixels are those of the PFM files of the same call, whose bits do not depend on there being Z. */
static void check_command_line(const char *options, int is_float) {
    static exr_file file;
    static char pfm[20000], alpha[20000];
    char line[600];
    int wrong = 0;
    snprintf(line, sizeof line, SCENE PART "--exr a.exr %s --pfm a.pfm --alpha-pfm b.pfm", options);
    const complaint all[] = {{line, 0, NULL}, {SCENE PART "--pfm c.pfm", 0, NULL}};
    CHECK_COMPLAINTS(all);
    const int size = read_file("a.pfm", pfm, sizeof pfm), alpha_size = read_file("b.pfm", alpha, sizeof alpha);
    if (!CHECK(read_exr("a.exr", &file)) || !CHECK(same_numbers(file.data_window, 2, 1, 18, 18))) return;
    CHECK(same_numbers(file.display_window, 0, 0, 20, 19) && strcmp(file.channels.names, "ABGRZ") == 0);
    CHECK(file.channels.types[0] == (is_float ? 2 : 1) && file.compression == (strstr(options, "none") ? 0 : 3));
    CHECK_NEAR((double)file.screen_width, 2 * tan(25 * PI / 180) * 21 / 20, 1e-6);
    for (int i = 0; i < 17 * 18; ++i)
        for (int c = 0; c < 4; ++c) {
            const int x = i % 17, y = i / 17;
            const float value = c == 3 ? pfm_value(alpha, alpha_size, 1, x, y, 0) : pfm_value(pfm, size, 3, x, y, c);
            uint32_t whole;
            memcpy(&whole, &value, sizeof whole);
            wrong += file.pixels[3 - c][i] != (is_float ? whole : ex_half_bits(value));
        }
    CHECK(wrong == 0);
    CHECK(read_file("c.pfm", alpha, sizeof alpha) == size && memcmp(alpha, pfm, (size_t)size) == 0);
}

/* Where nothing is, Z is infinity; where the volume is, it is a distance within the scene's. */
static void check_depth(void) {
    static exr_file file;
    int near = 0, far = 0;
    if (!CHECK(read_exr("a.exr", &file))) return;
    for (int i = 0; i < file.width * file.height; ++i) {
        float depth, alpha;
        memcpy(&depth, &file.pixels[4][i], sizeof depth), memcpy(&alpha, &file.pixels[0][i], sizeof alpha);
        far += depth > FLT_MAX && alpha == 0;
        near += depth > 2 && depth < 6 && alpha > 0;
    }
    CHECK(near > 10 && far > 10 && near + far == file.width * file.height);
}

static void test_command_line(void) {
    static const complaint wrong[] = {{SCENE "--out a.png --exr-type half", 2, "--exr-type says nothing without --exr"},
                                      {SCENE "--plan --exr-compression zip", 2, "--exr-compression says nothing"},
                                      {SCENE "--exr a.exr --exr-type u8", 2, "'u8' is not half|float"},
                                      {SCENE "--exr a.exr --exr-compression piz", 2, "'piz' is not zip|none"},
                                      {SCENE "--exr missing/a.exr", 2, "missing/a.exr"},
                                      {SCENE "--exr a.x --radiance-hdr a.x", 2, "are the same file"},
                                      {SCENE "--exr two.raw", 2, "--exr two.raw is a file that --volume reads"}};
    static const complaint full[] = {{SCENE "--exr /dev/full", 2, "/dev/full: "},
                                     {SCENE "--radiance-hdr /dev/full", 2, "/dev/full: "}};
    write_file("two.raw", "\x10\x20\x40\x30\xff\x00\x80\x60", 8);
    CHECK_COMPLAINTS(wrong);
    if (access("/dev/full", W_OK) == 0) CHECK_COMPLAINTS(full);
    check_command_line("", 0);
    check_command_line("--exr-type half --exr-compression none", 0);
    check_command_line("--exr-type float --exr-compression zip", 1);
    check_depth();
}

/* ------------------------------------------------------------------------------------------------- Radiance pictures
 */

/* Reads a row: pixels one after the other, or, if these bytes announce it, each channel in runs. */
static void read_rgbe_row(cursor *from, int width, unsigned char (*out)[4]) {
    const unsigned char *start = take(from, 4);
    if (width < 8 || start[0] != 2 || start[1] != 2 || start[2] > 127) {
        for (int x = 0; x < width; ++x) memcpy(out[x], x ? take(from, 4) : start, 4);
        return;
    }
    CHECK((start[2] << 8 | start[3]) == width);
    for (int c = 0; c < 4; ++c)
        for (int x = 0; x < width && !from->failed;) {
            const int count = (int)take_number(from, 1), run = count > 128 ? count - 128 : count;
            const unsigned char *bytes = take(from, count > 128 ? 1 : (size_t)run);
            if (!CHECK(run > 0 && run <= width - x)) return;
            for (int i = 0; i < run; ++i) out[x++][c] = bytes[count > 128 ? 0 : i];
        }
}

/* A pixel's colors are below the file's numbers by less than one step, 2^(e - 136), where 2^(e - 128) is above the
   largest of them. */
static int same_rgbe(const unsigned char rgbe[4], const char *pfm, int size, int x, int y) {
    int same = 1;
    for (int c = 0; c < 3; ++c) {
        const double value = (double)pfm_value(pfm, size, 3, x, y, c), step = ldexp(1, rgbe[3] - 136);
        same = same && value >= rgbe[c] * step && value < (rgbe[c] + 1) * step;
    }
    return same && (rgbe[0] > 127 || rgbe[1] > 127 || rgbe[2] > 127);
}

static void test_radiance(void) {
    static const complaint all[] = {{SCENE PART "--radiance-hdr a.hdr --pfm a.pfm", 0, NULL},
                                    {SCENE "--width 5 --height 4 --radiance-hdr b.hdr", 0, NULL}};
    static char data[20000], pfm[20000];
    unsigned char row[32][4];
    int wrong = 0;
    CHECK_COMPLAINTS(all);
    cursor from = {(const unsigned char *)data, (size_t)read_file("a.hdr", data, sizeof data), 0, 0};
    const int size = read_file("a.pfm", pfm, sizeof pfm);
    const char *start = strstr(data, "\n\n-Y 18 +X 17\n");
    if (!CHECK(strncmp(data, "#?RADIANCE\n", 11) == 0 && strstr(data, "\nFORMAT=32-bit_rle_rgbe\n") && start)) return;
    from.at = (size_t)(start - data) + 14;
    for (int y = 0; y < 18; ++y) {
        read_rgbe_row(&from, 17, row);
        for (int x = 0; x < 17; ++x) wrong += !same_rgbe(row[x], pfm, size, x, y);
    }
    CHECK(wrong == 0 && from.at == from.size && !from.failed);
    from.size = (size_t)read_file("b.hdr", data, sizeof data);
    start = strstr(data, "\n\n-Y 4 +X 5\n");
    CHECK(start && from.size == (size_t)(start - data) + 12 + 4 * 20);
}

int main(void) {
    RUN(test_packing);
    RUN(test_halves);
    if (!CHECK(folder_begin())) return check_report();
    RUN(test_pictures);
    RUN(test_sizes);
    RUN(test_failures);
    RUN(test_tools);
    if (render_is_built()) {
        RUN(test_command_line);
        RUN(test_radiance);
    } else {
        printf("skipped: the command line: there is no build/tests/render\n");
    }
    folder_end();
    return check_report();
}
