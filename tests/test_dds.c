/* DDS files of examples/dds.h. A reader that knows nothing of the writer finds every field of the layout that Microsoft
   documents, and every texel, bit for bit; so do Pillow and ImageMagick, if they are installed, where they can. */

#include "check.h"
#include "dds.h"
#include "command_line.h"
#include <unistd.h>

/* ---------------------------------------------------------------------------------------------------- the reader */

/* The format by its name in Microsoft's list, so that no number is taken from the writer. */
typedef struct known_format {
    ex_dds_format format;
    unsigned dxgi;
    int channels, bytes;
    char kind; /* u: unorm, f: float */
} known_format;

static const known_format known[] = {
    {EX_DDS_R8, 61, 1, 1, 'u'},   {EX_DDS_RGBA8, 28, 4, 1, 'u'},   {EX_DDS_SRGB, 29, 4, 1, 'u'},
    {EX_DDS_R16, 56, 1, 2, 'u'},  {EX_DDS_R16F, 54, 1, 2, 'f'},    {EX_DDS_RGBA16, 11, 4, 2, 'u'},
    {EX_DDS_R32F, 41, 1, 4, 'f'}, {EX_DDS_RGBA16F, 10, 4, 2, 'f'}, {EX_DDS_RGBA32F, 2, 4, 4, 'f'}};

enum { KNOWN = sizeof known / sizeof *known, MOST_BYTES = 1 << 16 };

static unsigned char bytes[MOST_BYTES];

static unsigned word_at(int place) {
    return (unsigned)bytes[place] | (unsigned)bytes[place + 1] << 8 | (unsigned)bytes[place + 2] << 16 |
           (unsigned)bytes[place + 3] << 24;
}

/* Half to double, from its sign, exponent and digits. */
static double half_value(unsigned bits) {
    const int exponent = (int)(bits >> 10 & 31), digits = (int)(bits & 1023);
    const double size = exponent ? ldexp(1024 + digits, exponent - 25) : ldexp(digits, -24);
    return bits >> 15 ? -size : size;
}

/* The number that a texel's channel stands for. */
static double value_at(const known_format *format, int index) {
    const int place = 148 + index * format->bytes;
    unsigned bits = 0;
    float single;
    for (int i = 0; i < format->bytes; ++i) bits |= (unsigned)bytes[place + i] << 8 * i;
    if (format->kind == 'u') return bits / (format->bytes == 1 ? 255.0 : 65535.0);
    if (format->bytes == 2) return half_value(bits);
    memcpy(&single, &bits, sizeof single);
    return (double)single;
}

/* Reserved words, and those that only other kinds of texture have. */
static int others_are_zero(int is_cube) {
    for (int place = 32; place < 76; place += 4)
        if (word_at(place) != 0) return 0;
    for (int place = 88; place < 108; place += 4)
        if (word_at(place) != 0) return 0;
    return word_at(116) == 0 && word_at(120) == 0 && word_at(124) == 0 && (is_cube || word_at(136) == 0);
}

/* ---------------------------------------------------------------------------------------------------- the checks */

/* A distinct number for each texel; the first ones lie outside 0..1, or are none. */
static void make_numbers(float *numbers, int count) {
    for (int i = 0; i < count; ++i) numbers[i] = (float)(i * 37 % 1009) / 1009.0f;
    if (count < 8) return;
    numbers[0] = 1.5f, numbers[1] = -0.5f, numbers[2] = NAN, numbers[3] = 70000.0f, numbers[4] = 1e-7f;
}

/* Half a step of the format, by which a number may be rounded. */
static double half_step(const known_format *format, double value) {
    if (format->kind == 'u') return 0.5000001 / (format->bytes == 1 ? 255 : 65535);
    if (format->bytes == 4) return 0;
    return value < ldexp(1, -14) ? ldexp(1, -25) : ldexp(value, -11); /* 10 digits behind the first one */
}

static void check_values(const known_format *format, const float *numbers, int count) {
    int wrong = 0;
    for (int i = 0; i < count; ++i) {
        const double found = value_at(format, i), given = (double)numbers[i];
        const double most = format->kind == 'u' ? 1 : format->bytes == 2 ? 65504 : DBL_MAX;
        const double least = format->kind == 'u' ? 0 : -DBL_MAX;
        if (given != given) {
            const unsigned half = (unsigned)bytes[148 + 2 * i] | (unsigned)bytes[149 + 2 * i] << 8;
            const int is_nan = format->bytes == 4 ? found != found : (half & 0x7c00) == 0x7c00 && (half & 0x3ff) != 0;
            wrong += format->kind == 'u' ? found != 0 : !is_nan;
        } else {
            const double exact = fmin(fmax(given, least), most);
            wrong += !(fabs(found - exact) <= half_step(format, fabs(exact)));
        }
    }
    if (!CHECK(wrong == 0)) printf("    format %u: %d numbers\n", format->dxgi, wrong);
}

/* Writes a texture, and reads back every field and every texel. */
static void check_texture(const known_format *format, int width, int height, int layers, int depth, int cubes) {
    static float numbers[MOST_BYTES / 4];
    static unsigned char texels[MOST_BYTES];
    const int images = depth > 0 ? depth : layers > 1 ? layers : 1;
    const int count = width * height * images * format->channels;
    ex_dds texture = {0};
    char path[100];
    ex_error error;
    make_numbers(numbers, count);
    ex_dds_encode(format->format, numbers, (size_t)count, texels);
    texture.texels = texels, texture.width = width, texture.height = height;
    texture.layers = layers, texture.depth = depth, texture.format = format->format;
    texture.alpha = EX_DDS_ALPHA_PREMULTIPLIED, texture.is_cube = cubes > 0;
    snprintf(path, sizeof path, "%s/a.dds", folder);
    if (!CHECK(ex_write_dds(path, &texture, &error) == 0)) return;
    memset(bytes, 0xee, sizeof bytes);
    CHECK(read_file("a.dds", (char *)bytes, sizeof bytes) == 148 + count * format->bytes);
    CHECK(memcmp(bytes, "DDS ", 4) == 0 && word_at(4) == 124 && word_at(76) == 32);
    CHECK(word_at(8) == (0x1u | 0x2u | 0x4u | 0x8u | 0x1000u | (depth > 0 ? 0x800000u : 0)));
    CHECK(word_at(12) == (unsigned)height && word_at(16) == (unsigned)width);
    CHECK(word_at(20) == (unsigned)(width * format->channels * format->bytes));
    CHECK(word_at(24) == (unsigned)depth && word_at(28) == 1);
    CHECK(word_at(80) == 0x4 && memcmp(bytes + 84, "DX10", 4) == 0);
    CHECK(word_at(108) == (0x1000u | (layers > 1 ? 0x8u : 0)) &&
          word_at(112) == (depth > 0   ? 0x200000u
                           : cubes > 0 ? 0x200u + 0x400u + 0x800u + 0x1000u + 0x2000u + 0x4000u + 0x8000u
                                       : 0));
    CHECK(word_at(128) == format->dxgi && word_at(132) == (depth > 0 ? 4u : 3u));
    CHECK(word_at(136) == (cubes > 0 ? 4u : 0u)); /* the array counts cubes, not faces */
    CHECK(word_at(140) == (unsigned)(cubes > 0 ? cubes : layers > 1 ? layers : 1));
    CHECK(word_at(144) == 2 && others_are_zero(cubes > 0));
    check_values(format, numbers, count);
}

static void test_textures(void) {
    for (int i = 0; i < KNOWN; ++i) {
        check_texture(&known[i], 7, 5, 0, 0, 0);
        check_texture(&known[i], 1, 1, 1, 0, 0);
        check_texture(&known[i], 3, 2, 4, 0, 0);
        check_texture(&known[i], 2, 3, 0, 5, 0);
        check_texture(&known[i], 5, 2, 0, 1, 0);
        check_texture(&known[i], 3, 3, 6, 0, 1);
        check_texture(&known[i], 2, 2, 18, 0, 3);
    }
    CHECK((int)KNOWN == (int)EX_DDS_FORMATS);
}

/* What is refused, and in which words; nothing is then written. */
static void test_refusals(void) {
    static const struct {
        int width, height, layers, depth, format, is_cube;
        const char *words;
    } wrong[] = {{0, 1, 0, 0, 0, 0, "0 x 1: sides must be within 1..16384"},
                 {1, -1, 0, 0, 0, 0, "1 x -1: sides"},
                 {16385, 1, 0, 0, 0, 0, "16385 x 1: sides must be within 1..16384"},
                 {1, 16385, 0, 0, 0, 0, "1 x 16385"},
                 {2049, 1, 0, 1, 0, 0, "2049 x 1: sides must be within 1..2048"},
                 {1, 1, 0, 2049, 0, 0, "2049 slices"},
                 {1, 1, 0, -1, 0, 0, "-1 slices"},
                 {1, 1, 2049, 0, 0, 0, "2049 layers"},
                 {1, 1, -2, 0, 0, 0, "-2 layers"},
                 {1, 1, 2, 2, 0, 0, "not both"},
                 {1, 1, 0, 0, EX_DDS_FORMATS, 0, "9 is no format"},
                 {1, 1, 0, 0, -1, 0, "-1 is no format"},
                 {2, 2, 0, 0, 0, 1, "0 layers of 2 x 2: cube maps have six squares each"},
                 {2, 2, 7, 0, 0, 1, "7 layers of 2 x 2: cube maps"},
                 {3, 2, 6, 0, 0, 1, "6 layers of 3 x 2: cube maps"},
                 {2, 2, 0, 6, 0, 1, "0 layers of 2 x 2: cube maps"}};
    char path[100];
    ex_error error;
    snprintf(path, sizeof path, "%s/none.dds", folder);
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; ++i) {
        ex_dds texture = {0};
        texture.texels = "", texture.width = wrong[i].width, texture.height = wrong[i].height;
        texture.layers = wrong[i].layers, texture.depth = wrong[i].depth;
        texture.format = (ex_dds_format)wrong[i].format, texture.is_cube = wrong[i].is_cube;
        error.text[0] = 0;
        CHECK(ex_write_dds(path, &texture, &error) == 1);
        if (!CHECK(strstr(error.text, wrong[i].words) && strstr(error.text, "none.dds: ")))
            printf("    case %d: %s\n", (int)i, error.text);
    }
    CHECK(access(path, F_OK) != 0);
}

static void test_bad_places(void) {
    ex_dds texture = {0};
    ex_error error;
    texture.texels = "abcd", texture.width = texture.height = 2;
    CHECK(ex_write_dds("build/missing/a.dds", &texture, &error) == 1 && strstr(error.text, "missing/a.dds: cannot be"));
    if (access("/dev/full", W_OK) != 0) return;
    CHECK(ex_write_dds("/dev/full", &texture, &error) == 1 &&
          strstr(error.text, "/dev/full: writing failed: No space"));
}

/* ------------------------------------------------------------------------------------------------- other readers */

/* Runs a command that turns a.dds into bytes of one pixel after the other, and compares them with the file's own. */
static void check_reader(const char *name, const char *command, int count) {
    char line[400], found[1000];
    snprintf(line, sizeof line, "cd %s && rm -f a.bytes && %s >a.bytes 2>/dev/null", folder, command);
    if (system(line) != 0) {
        printf("skipped: DDS by %s, which does not read this format\n", name);
        return;
    }
    CHECK(read_file("a.bytes", found, sizeof found) == count && memcmp(found, bytes + 148, (size_t)count) == 0);
}

/* Pillow 9.4 reads RGBA8, ImageMagick 6 no uncompressed texture with a DX10 header; their later versions read more. */
static void test_other_readers(void) {
    static const char *const pythons[] = {"python3", "/usr/bin/python3"}; /* the second one has the system's packages */
    char pillow[200] = "";
    for (int i = 0; i < 2 && !*pillow; ++i) {
        snprintf(pillow, sizeof pillow, "%s -c 'import PIL' >/dev/null 2>&1", pythons[i]);
        const int is_there = system(pillow) == 0;
        snprintf(pillow, sizeof pillow,
                 "%s -c \"import sys; from PIL import Image; sys.stdout.buffer.write(Image.open('a.dds').tobytes())\"",
                 pythons[i]);
        if (!is_there) *pillow = 0;
    }
    const char *magick = find_magick();
    char line[100];
    if (!*pillow) printf("skipped: DDS by Pillow: install python3-pil\n");
    if (!magick) printf("skipped: DDS by ImageMagick: install imagemagick\n");
    check_texture(&known[1], 7, 5, 0, 0, 0);
    if (*pillow) check_reader("Pillow", pillow, 140);
    snprintf(line, sizeof line, "%s a.dds -depth 8 rgba:-", magick ? magick : "");
    if (magick) check_reader("ImageMagick", line, 140);
    check_texture(&known[0], 7, 5, 0, 0, 0);
    snprintf(line, sizeof line, "%s a.dds -depth 8 gray:-", magick ? magick : "");
    if (magick) check_reader("ImageMagick", line, 35);
}

int main(void) {
    if (!CHECK(folder_begin())) return check_report();
    RUN(test_textures);
    RUN(test_refusals);
    RUN(test_bad_places);
    RUN(test_other_readers);
    folder_end();
    return check_report();
}
