/* examples/sky.h: Radiance files written here byte by byte, flat and packed; what is damaged; where a picture's pixels
   lie in the sky. */

#include "check.h"
#include "sky.h"

static const char path[] = "build/test_sky_picture.hdr";
static unsigned char bytes[8192];
static size_t length;

static void put(const void *data, size_t size) {
    memcpy(bytes + length, data, size);
    length += size;
}

static void put_text(const char *text) { put(text, strlen(text)); }

static void put_byte(int byte) { bytes[length++] = (unsigned char)byte; }

/* Files end in .hdr, however it is spelled. */
static void test_ending(void) {
    static const double up[3] = {0, 1, 0};
    static const char upper[] = "build/test_sky_picture_2.HDR";
    ex_sky sky;
    ex_error error;
    FILE *file = fopen(upper, "wb");
    if (!CHECK(file != NULL)) return;
    CHECK(fputs("#?RADIANCE\n\n-Y 1 +X 1\nabcd", file) >= 0 && fclose(file) == 0);
    if (CHECK(ex_sky_read(upper, up, 0, 1, &sky, &error) == 0)) ex_sky_free(&sky);
    remove(upper);
}

static int load(ex_slide *slide, ex_error *error) {
    FILE *file = fopen(path, "wb");
    if (!CHECK(file != NULL)) return 1;
    CHECK(fwrite(bytes, 1, length, file) == length);
    CHECK(fclose(file) == 0);
    return ex_hdr_read(path, slide, error);
}

/* Component k of pixel x,y. */
static int component(int x, int y, int k) { return k == 3 ? 128 + y : (37 * x / 4 + 60 * y + 80 * k + 3) % 251; }

/* `packed`: 0: flat rows; 1: rows with literal runs; 2: with equal runs wherever bytes repeat. */
static void build(int width, int height, int packed, const char *lines) {
    char size[64];
    length = 0;
    put_text("#?RADIANCE\n# made here\n");
    put_text(lines);
    snprintf(size, sizeof size, "\n-Y %d +X %d\n", height, width);
    put_text(size);
    for (int y = 0; y < height; ++y) {
        if (packed) put_byte(2), put_byte(2), put_byte(width / 256), put_byte(width % 256);
        for (int n = 0; n < 4 * width && !packed; ++n) put_byte(component(n / 4, y, n % 4));
        for (int k = 0; k < 4 && packed; ++k)
            for (int x = 0, count; x < width; x += count) {
                const int first = component(x, y, k);
                for (count = 1; x + count < width && count < 100; ++count)
                    if (packed == 2 && component(x + count, y, k) != first) break;
                put_byte(packed == 2 ? 128 + count : count);
                for (int n = 0; n < (packed == 2 ? 1 : count); ++n) put_byte(component(x + n, y, k));
            }
    }
}

static void check_pixels(const ex_slide *slide, int width, int height, double scale) {
    int wrong = 0;
    if (!CHECK(slide->width == width && slide->height == height)) return;
    for (int n = 0; n < 3 * width * height; ++n) {
        const int x = n / 3 % width, y = n / 3 / width;
        const double exact = scale * component(x, y, n % 3) * pow(2, component(x, y, 3) - 136);
        wrong += !(fabs((double)slide->rgb[n] - exact) <= 1e-6 * exact);
    }
    CHECK(wrong == 0);
}

static void test_rows(void) {
    static const int widths[] = {1, 7, 8, 30, 300};
    for (int i = 0; i < 15; ++i) {
        const int width = widths[i % 5], packed = i / 5;
        ex_slide slide;
        ex_error error;
        if (packed && width < 8) continue;
        build(width, 3, packed, i % 2 ? "FORMAT=32-bit_rle_rgbe\nEXPOSURE=2\nEXPOSURE= 4\n" : "");
        if (!CHECK(load(&slide, &error) == 0)) {
            printf("    %d, packed %d: %s\n", width, packed, error.text);
            continue;
        }
        check_pixels(&slide, width, 3, i % 2 ? 0.125 : 1);
        ex_slide_free(&slide);
    }
}

/* No exponent: black. The largest is clamped to what the library takes. */
static void test_ends(void) {
    ex_slide slide;
    ex_error error;
    length = 0;
    put_text("#?RGBE\n\n-Y 1 +X 2\n");
    static const unsigned char pixels[] = {9, 9, 9, 0, 255, 0, 1, 255};
    put(pixels, sizeof pixels);
    if (!CHECK(load(&slide, &error) == 0)) return;
    CHECK(slide.rgb[0] == 0 && slide.rgb[2] == 0 && slide.rgb[3] == 1e18f && slide.rgb[4] == 0);
    ex_slide_free(&slide);
}

static void check_refused(const char *words) {
    ex_slide slide;
    ex_error error;
    if (!CHECK(load(&slide, &error) != 0)) {
        ex_slide_free(&slide);
        return;
    }
    CHECK(slide.rgb == NULL);
    if (!CHECK(strstr(error.text, words) != NULL && strstr(error.text, path) != NULL && !strchr(error.text, '\n')))
        printf("    wanted \"%s\", got \"%s\"\n", words, error.text);
}

static void test_refused(void) {
    static const struct {
        const char *text, *words;
    } list[] = {{"", "not a Radiance file"},
                {"P6\n\n", "not a Radiance file"},
                {"#?RADIANCE\n", "no size of the form"},
                {"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n1234", "FORMAT=32-bit_rle_xyze is not read"},
                {"#?RADIANCE\nEXPOSURE=0\n\n-Y 1 +X 1\n1234", "exposures"},
                {"#?RADIANCE\nEXPOSURE=-1\n\n-Y 1 +X 1\n1234", "exposures"},
                {"#?RADIANCE\nEXPOSURE=nan\n\n-Y 1 +X 1\n1234", "exposures"},
                {"#?RADIANCE\n\n+Y 1 +X 1\n1234", "no size of the form"},
                {"#?RADIANCE\n\n-Y 1 +X 1 x\n1234", "no size of the form"},
                {"#?RADIANCE\n\n-Y 0 +X 1\n1234", "1 x 0 pixels"},
                {"#?RADIANCE\n\n-Y 1 +X 16385\n1234", "16385 x 1 pixels"},
                {"#?RADIANCE\n\n-Y 16384 +X 16384\n1234", "ends amid its pixels"},
                {"#?RADIANCE\n\n-Y 1 +X 2\n\1\1\1\2abcd", "row 0 of its pixels is damaged"}};
    for (size_t i = 0; i < sizeof list / sizeof *list; ++i) {
        length = 0;
        put_text(list[i].text);
        check_refused(list[i].words);
    }
    build(8, 2, 1, "");
    bytes[length - 4 * 9 - 1] = 9; /* the row's width */
    check_refused("row 1 of its pixels is damaged");
    build(8, 2, 2, "");
    bytes[length - 2] = 128 + 9;
    check_refused("row 1 of its pixels is damaged");
    build(8, 2, 2, "");
    bytes[length - 2] = 0;
    check_refused("row 1 of its pixels is damaged");
}

/* Files cut anywhere are refused; any changed byte gives a picture or a sentence. */
static void test_damaged(void) {
    for (int packed = 0; packed < 3; ++packed) {
        build(12, 3, packed, "EXPOSURE=1\n");
        const size_t whole = length;
        ex_slide slide;
        ex_error error;
        for (length = 0; length < whole; ++length)
            if (!CHECK(load(&slide, &error) != 0)) ex_slide_free(&slide);
        for (size_t i = 0; i < whole; ++i)
            for (int bit = 0; bit < 8; ++bit) {
                bytes[i] ^= (unsigned char)(1 << bit);
                if (load(&slide, &error) == 0) ex_slide_free(&slide);
                bytes[i] ^= (unsigned char)(1 << bit);
            }
    }
}

static void check_look(const ex_sky *sky, double x, double y, double z, const float color[3]) {
    const float way[3] = {(float)x, (float)y, (float)z};
    float found[3], lit[3];
    CHECK(ex_sky_behind((void *)(size_t)sky, 1, way, found) == 0 &&
          ex_sky_light((void *)(size_t)sky, 1, way, lit) == 0);
    for (int c = 0; c < 3; ++c) {
        CHECK_NEAR((double)found[c], (double)color[c], 1e-5);
        CHECK_NEAR((double)lit[c], (double)color[c], 1e-5);
    }
}

/* A picture of 4 x 2: the middle of its upper right pixel is 45 degrees up, 45 degrees to the right of the middle. */
static void test_places(void) {
    static const double up[3][3] = {{0, 2, 0}, {0, 0, 1}, {0, 3, 0}};
    ex_sky sky;
    ex_error error;
    const double half = sqrt(0.5);
    length = 0;
    put_text("#?RADIANCE\n\n-Y 2 +X 4\n");
    for (int n = 0; n < 8; ++n) put_byte(10 + n), put_byte(20 * n), put_byte(3), put_byte(136);
    FILE *file = fopen(path, "wb");
    if (!CHECK(file != NULL)) return;
    CHECK(fwrite(bytes, 1, length, file) == length && fclose(file) == 0);
    for (int i = 0; i < 3; ++i) {
        if (!CHECK(ex_sky_read(path, up[i], i == 2 ? 90 : 0, 2, &sky, &error) == 0)) return;
        const int first = i == 2 ? 3 : 2; /* turned to the left: what was ahead is on the left */
        const float color[3] = {2 * (float)(10 + first), 2 * 20 * (float)first, 6};
        const float below[3] = {2 * (float)(14 + first), 2 * 20 * (float)(4 + first), 6};
        check_look(&sky, 0.5, i == 1 ? 0.5 : half, i == 1 ? half : -0.5, color);
        check_look(&sky, 0.5, i == 1 ? 0.5 : -half, i == 1 ? -half : -0.5, below);
        const float top[3] = {25, 100, 6}; /* beside the pole: between the two upper pixels on that side */
        if (i == 0) check_look(&sky, 1e-7, 1, 0, top);
        ex_sky_free(&sky);
    }
}

/* Nothing exceeds what the library accepts, although interpolation rounds and a scale multiplies. */
static void test_bright(void) {
    static const double up[3] = {0, 1, 0};
    static const float largest = 1e18f;
    ex_sky sky;
    ex_error error;
    FILE *file = fopen(path, "wb");
    if (!CHECK(file != NULL)) return;
    CHECK(fputs("#?RADIANCE\n\n-Y 1 +X 1\n\377\377\377\377", file) >= 0 && fclose(file) == 0);
    for (int i = 0; i < 2; ++i) {
        int above = 0;
        if (!CHECK(ex_sky_read(path, up, 0, i ? 1e9 : 1, &sky, &error) == 0)) return;
        for (int n = 0; n < 100; ++n) {
            const float way[3] = {cosf((float)n), 0.02f * (float)n - 1, sinf((float)n)};
            float behind[3], lit[3];
            CHECK(ex_sky_behind(&sky, 1, way, behind) == 0 && ex_sky_light(&sky, 1, way, lit) == 0);
            for (int c = 0; c < 3; ++c) above += !(behind[c] <= largest && lit[c] <= largest);
        }
        CHECK(above == 0);
        ex_sky_free(&sky);
    }
}

/* Red light of a picture over all directions. */
static double sum_light(const ex_slide *slide) {
    double sum = 0;
    for (int n = 0; n < slide->width * slide->height; ++n) {
        const int y = n / slide->width;
        const double top = cos(EX_PI * y / slide->height), below = cos(EX_PI * (y + 1) / slide->height);
        sum += (double)slide->rgb[3 * n] * 2 * EX_PI / slide->width * (top - below);
    }
    return sum;
}

/* Large pictures are averaged. Light stays wherever a sun is: amid the sky, in the last column, at either pole, and
   where a pixel lies in two of the smaller picture. Floats round to 6e-8, twice. */
static void test_shrink(void) {
    static const int suns[][2] = {{3, 150}, {399, 90}, {7, 0}, {200, 199}, {2, 2}};
    ex_slide from = {400, 200, NULL}, to;
    from.rgb = (float *)calloc(3 * 400 * 200, sizeof *from.rgb);
    if (!CHECK(from.rgb != NULL)) return;
    for (size_t i = 0; i < sizeof suns / sizeof *suns; ++i) {
        float *sun = &from.rgb[3 * (400 * suns[i][1] + suns[i][0])];
        *sun = 1e6f;
        ex_sky_shrink(&from, 180, &to);
        CHECK(to.width == 180 && to.height == 90);
        CHECK_NEAR(sum_light(&to) / sum_light(&from), 1, 2e-7);
        *sun = 0;
        free(to.rgb);
    }
    free(from.rgb);
}

/* Sizes that no block divides: the horizon stays in the middle, all round. */
static void test_horizon(void) {
    static const int sizes[][2] = {{4096, 2048}, {181, 90}, {16384, 3}, {1, 2}, {7, 9}};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; ++i) {
        ex_slide from = {sizes[i][0], sizes[i][1], NULL}, to;
        double sum = 0;
        const int pixels = from.width * from.height;
        from.rgb = (float *)malloc((size_t)pixels * 3 * sizeof *from.rgb);
        if (!CHECK(from.rgb != NULL)) return;
        for (int n = 0; n < 3 * pixels; ++n) {
            const int y = n / 3 / from.width;
            from.rgb[n] = 2 * y + 1 == from.height ? 0.5f : 2 * y + 1 < from.height;
        }
        ex_sky_shrink(&from, 180, &to);
        CHECK(to.width == (from.width < 180 ? from.width : 180) && to.height >= 1);
        sum = sum_light(&to);
        CHECK_NEAR(sum / (2 * EX_PI), 1, 1e-6);
        free(from.rgb), free(to.rgb);
    }
}

int main(void) {
    RUN(test_rows);
    RUN(test_ends);
    RUN(test_ending);
    RUN(test_refused);
    RUN_LONG(test_damaged);
    RUN(test_places);
    RUN(test_bright);
    RUN(test_shrink);
    RUN_LONG(test_horizon);
    remove(path);
    return check_report();
}
