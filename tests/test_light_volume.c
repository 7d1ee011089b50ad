/* examples/light_volume.h and bake light-volume: grids that fill a box, files read back by readers that know nothing of
   the writers against sps_light_probes, and the command line. */

#include "check.h"
#include "light_volume.h"
#include "command_line.h"
#include <unistd.h>

enum { NX = 4, NY = 2, NZ = 3, PROBES = NX * NY * NZ, LIGHTS = 2, EACH = 15 + 3 * LIGHTS, MOST = 1 << 17 };
static char data[MOST], other[MOST];
static float sky[3 * PROBES], l0[3 * PROBES], l1[9 * PROBES], through[3 * LIGHTS * PROBES];
static check_scene s;

/* ---------------------------------------------------------------------------------------------------------- the grid
 */

static void check_grid(const ex_light_volume *v, const int count[3], const double origin[3], const double spacing[3]) {
    for (int a = 0; a < 3; ++a) {
        CHECK(v->count[a] == count[a]);
        CHECK_NEAR(v->origin[a], origin[a], 1e-12);
        CHECK_NEAR(v->spacing[a], spacing[a], 1e-12);
    }
}

/* The first and the last cell are as far within the box as beyond: their centres lie half a cell within it, or about
   its middle. */
static void test_fit(void) {
    static const double lo[3] = {-1, 2, 0}, hi[3] = {1, 3, 0.25}, flat[3] = {1, 3, 0}, odd[3] = {1, 2.99, 0.1};
    static const int by_cubes[3] = {32, 16, 4}, flat_cubes[3] = {32, 16, 1}, odd_cubes[3] = {32, 16, 2};
    static const double origin[3] = {-1 + 1 / 32.0, 2 + 1 / 32.0, 1 / 32.0}, cube[3] = {1 / 16.0, 1 / 16.0, 1 / 16.0};
    static const double flat_origin[3] = {-1 + 1 / 32.0, 2 + 1 / 32.0, 0};
    static const double odd_origin[3] = {-1 + 1 / 32.0, 2.495 - 7.5 / 16, 0.05 - 0.5 / 16};
    static const int given[3] = {4, 2, 5};
    static const double given_origin[3] = {-0.75, 2.25, 0.025}, given_spacing[3] = {0.5, 0.5, 0.05};
    static const double level_origin[3] = {-0.75, 2.25, -1}, level_spacing[3] = {0.5, 0.5, 0.5};
    ex_light_volume v;
    ex_error error;
    CHECK(ex_light_volume_fit(lo, hi, NULL, &v, &error) == 0), check_grid(&v, by_cubes, origin, cube);
    CHECK(ex_light_volume_fit(lo, flat, NULL, &v, &error) == 0), check_grid(&v, flat_cubes, flat_origin, cube);
    CHECK(ex_light_volume_fit(lo, odd, NULL, &v, &error) == 0), check_grid(&v, odd_cubes, odd_origin, cube);
    CHECK(ex_light_volume_fit(lo, hi, given, &v, &error) == 0), check_grid(&v, given, given_origin, given_spacing);
    CHECK(ex_light_volume_fit(lo, flat, given, &v, &error) == 0), check_grid(&v, given, level_origin, level_spacing);
    CHECK(ex_light_volume_fit(lo, lo, NULL, &v, &error) == 1 && strstr(error.text, "the scene has no extent"));
    CHECK(ex_light_volume_fit(lo, lo, given, &v, &error) == 1);
}

/* What is too large, by its first number too many. */
static void test_large(void) {
    static const struct {
        int count[3], lights, is_dds;
        const char *words;
    } cases[] = {{{2048, 1, 1}, 0, 1, NULL},
                 {{2049, 1, 1}, 0, 1, "x: a DDS texture of 2049 x 1"},
                 {{1, 2049, 1}, 0, 1, "x: a DDS texture of 1 x 2049"},
                 {{2049, 1, 1}, 0, 0, NULL},
                 {{1, 1, 512}, 0, 1, NULL},
                 {{1, 1, 513}, 0, 1, "x: a DDS texture with 2052 slices"},
                 {{1, 1, 409}, 1, 1, NULL},
                 {{1, 1, 410}, 1, 1, "x: a DDS texture with 2050 slices"},
                 {{1, 1, 1024}, 60000, 1, "x: a DDS texture with 61444096 slices"},
                 {{2048, 2048, 4}, 0, 0, NULL},
                 {{2048, 2048, 5}, 0, 0, "x: 2048 x 2048 x 5 probes of 15 numbers: more than 268435456 numbers"},
                 {{2048, 2048, 4}, 1, 0, "x: 2048 x 2048 x 4 probes of 18 numbers: more than 268435456 numbers"},
                 {{2048, 2048, 2048}, 0, 1, "x: 2048 x 2048 x 2048 probes of 15 numbers"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        ex_light_volume v;
        ex_error error;
        memset(&v, 0, sizeof v);
        memcpy(v.count, cases[i].count, sizeof v.count), v.lights = cases[i].lights;
        const int failed = ex_light_volume_check("x", &v, cases[i].is_dds, &error);
        const char *said = failed ? error.text : "";
        if (!CHECK(cases[i].words ? strstr(said, cases[i].words) != NULL : !failed))
            printf("    %d: %s\n", (int)i, said);
    }
}

/* ----------------------------------------------------------------------------------------------------------- reading
 */

static unsigned word_at(size_t place) {
    const unsigned char *at = (const unsigned char *)data + place;
    return (unsigned)at[0] | (unsigned)at[1] << 8 | (unsigned)at[2] << 16 | (unsigned)at[3] << 24;
}

static float float_at(size_t place) {
    const unsigned bits = word_at(place);
    float value;
    memcpy(&value, &bits, 4);
    return value;
}

static double half_at(size_t place) {
    const unsigned bits = word_at(place) & 0xffff;
    const int exponent = (int)(bits >> 10 & 31), digits = (int)(bits & 1023);
    const double size = exponent ? ldexp(1024 + digits, exponent - 25) : ldexp(digits, -24);
    return bits >> 15 ? -size : size;
}

static int same(float a, float b) { return memcmp(&a, &b, sizeof a) == 0; }

/* What channel c of a probe's block has. */
static float expected(size_t probe, int block, int c) {
    const float *part = block == 0  ? l0 + 3 * probe
                        : block < 4 ? l1 + 9 * probe + 3 * (block - 1)
                                    : through + 3 * LIGHTS * probe + 3 * (block - 4);
    if (c < 3) return part[c];
    return block == 0 ? (sky[3 * probe] + sky[3 * probe + 1] + sky[3 * probe + 2]) / 3.0f : 0;
}

/* A volume texture whose slices are blocks one after the other. Halves are off by half a digit of eleven. */
static void check_dds(const char *name, int bytes) {
    const size_t size = (size_t)read_file(name, data, sizeof data);
    int wrong = 0;
    if (!CHECK(size == 148 + (size_t)(PROBES * (4 + LIGHTS) * 4 * bytes) && memcmp(data, "DDS ", 4) == 0)) return;
    CHECK(word_at(12) == NY && word_at(16) == NX && word_at(24) == NZ * (4 + LIGHTS) && word_at(112) == 0x200000);
    CHECK(word_at(128) == (bytes == 4 ? 2 : 10) && word_at(132) == 4 && word_at(140) == 1);
    for (int z = 0; z < NZ * (4 + LIGHTS); ++z)
        for (int i = 0; i < NX * NY; ++i)
            for (int c = 0; c < 4; ++c) {
                const size_t place = 148 + (size_t)((z * NX * NY + i) * 4 + c) * (size_t)bytes;
                const float exact = expected((size_t)(z % NZ * NX * NY + i), z / NZ, c);
                const double most = fmax(ldexp(fabs((double)exact), -11), ldexp(1, -25));
                wrong += bytes == 4 ? !same(float_at(place), exact) : fabs(half_at(place) - (double)exact) > most;
            }
    CHECK(wrong == 0);
}

/* The header ends a multiple of 64 bytes in with a newline, padded by spaces. */
static size_t npy_begin(const char *name, const char *shape) {
    const size_t size = (size_t)read_file(name, data, sizeof data);
    const size_t start = 10 + (word_at(8) & 0xffff);
    if (!CHECK(size > 64 && memcmp(data, "\x93NUMPY\1\0", 8) == 0 && start % 64 == 0 && start < size)) return 0;
    CHECK(data[start - 1] == '\n' && data[start - 2] == ' ' && data[10] == '{');
    data[start - 1] = 0;
    CHECK(strstr(data + 10, "'descr': '<f4'") && strstr(data + 10, "'fortran_order': False"));
    if (!CHECK(strstr(data + 10, shape))) printf("    %s\n", data + 10);
    CHECK(strspn(strchr(data + 10, '}') + 1, " ") == strlen(strchr(data + 10, '}') + 1));
    return start;
}

static void check_npy(const char *name) {
    const size_t start = npy_begin(name, "'shape': (3, 2, 4, 21)"), size = (size_t)PROBES * EACH * 4;
    int wrong = 0;
    CHECK(read_file(name, other, sizeof other) == (int)(start + size));
    for (size_t i = 0; i < PROBES && start; ++i)
        for (size_t k = 0; k < EACH; ++k) {
            const float exact = k < 3    ? sky[3 * i + k]
                                : k < 6  ? l0[3 * i + k - 3]
                                : k < 15 ? l1[9 * i + k - 6]
                                         : through[3 * LIGHTS * i + k - 15];
            wrong += !same(float_at(start + 4 * (EACH * i + k)), exact);
        }
    CHECK(wrong == 0);
}

/* ---------------------------------------------------------------------------------------------------------- the files
 */

enum { SIDE = 8 };
static unsigned char cloud[SIDE * SIDE * SIDE];

static int read_cloud(void *user, const int lo[3], const int size[3], float *out) {
    (void)user;
    for (int z = 0; z < size[2]; ++z)
        for (int y = 0; y < size[1]; ++y)
            for (int x = 0; x < size[0]; ++x)
                *out++ = (float)cloud[((z + lo[2]) * SIDE + y + lo[1]) * SIDE + x + lo[0]] / 255.0f;
    return 0;
}

/* The scene of the command line below: gas of colors, a sun and a lamp. */
static void make_scene(void) {
    check_clear(&s, 8, 8);
    for (int i = 0; i < SIDE * SIDE * SIDE; ++i) cloud[i] = (unsigned char)(100 + i * 37 % 151);
    sps_volume *gas = check_add_volume(&s, SIDE, SIDE, SIDE, check_box(-1, -1, -1, 1, 1, 1));
    gas->read_fn = read_cloud, gas->extinction = 1;
    check_color(gas->albedo, 0.9, 0.5, 0.25), check_color(gas->emission, 0.125, 0.5, 0.25);
    check_add_directional(&s, 0.25, -1, 0.5, 1);
    check_add_point(&s, 0, 2, 1, 4);
    s.view.quality = SPS_QUALITY_DRAFT, s.view.scattering = SPS_SCATTERING_SINGLE;
}

static const int counts[3] = {NX, NY, NZ};
static const double lowest[3] = {-1, -1, -1}, highest[3] = {1, 1, 1};

/* What the library says of positions that are found here. */
static void find_expected(sps_context *context, const double origin[3], const double spacing[3]) {
    double positions[3 * PROBES];
    sps_probe_arrays out;
    for (int i = 0; i < PROBES; ++i) {
        const int at[3] = {i % NX, i / NX % NY, i / (NX * NY)};
        for (int a = 0; a < 3; ++a) positions[3 * i + a] = origin[a] + at[a] * spacing[a];
    }
    memset(&out, 0, sizeof out);
    out.sky = sky, out.l0 = l0, out.l1 = l1, out.transmittance = through;
    CHECK_OK(context, sps_light_probes(context, &s.scene, &s.view, PROBES, positions, &out));
}

static void path_of(const char *name, char out[100]) { snprintf(out, 100, "%s/%s", folder, name); }

static void test_files(void) {
    static const double origin[3] = {-0.75, -0.5, -2 / 3.0}, spacing[3] = {0.5, 1, 2 / 3.0};
    sps_context *context = check_context(NULL);
    ex_light_volume v;
    ex_error error;
    char path[100];
    memset(&v, 0, sizeof v);
    make_scene();
    CHECK(ex_light_volume_fit(lowest, highest, counts, &v, &error) == 0);
    check_grid(&v, counts, origin, spacing);
    CHECK_OK(context, ex_light_volume_compute(context, &s.scene, &s.view, &v));
    find_expected(context, v.origin, v.spacing);
    CHECK(v.lights == LIGHTS && l0[0] > 0.01f && through[0] < 0.9f && fabs((double)l1[3]) > 1e-3 && sky[0] < 1);
    path_of("a.dds", path);
    CHECK(ex_light_volume_write_dds(path, &v, 1, &error) == 0), check_dds("a.dds", 4);
    CHECK(ex_light_volume_write_dds(path, &v, 0, &error) == 0), check_dds("a.dds", 2);
    path_of("a.npy", path);
    CHECK(ex_light_volume_write_npy(path, &v, &error) == 0), check_npy("a.npy");
    CHECK(ex_light_volume_beyond(&v) == 0);
    v.l0[1] = v.l1[2] = 65504, v.l0[3 * PROBES - 1] = 65505, v.l1[0] = -65505, v.l1[9 * PROBES - 1] = 7e4f;
    CHECK(ex_light_volume_beyond(&v) == 3);
    CHECK(ex_light_volume_write_npy("build", &v, &error) == 1 && strstr(error.text, "build: cannot be written"));
    if (access("/dev/full", W_OK) == 0) {
        CHECK(ex_light_volume_write_npy("/dev/full", &v, &error) == 1 && strstr(error.text, "writing failed"));
        CHECK(ex_light_volume_write_dds("/dev/full", &v, 1, &error) == 1 && strstr(error.text, "writing failed"));
    }
    ex_light_volume_free(&v);
    sps_destroy(context);
}

/* A failure leaves what can be freed. Without lights, there are no transmittances. */
static void test_failure(void) {
    sps_context *context = check_context(NULL);
    ex_light_volume v;
    ex_error error;
    char path[100];
    make_scene();
    s.view.scattering = SPS_SCATTERING_FORWARD;
    CHECK(ex_light_volume_fit(lowest, highest, counts, &v, &error) == 0);
    CHECK(ex_light_volume_compute(context, &s.scene, &s.view, &v) == SPS_ERROR_UNSUPPORTED);
    ex_light_volume_free(&v);
    s.view.scattering = SPS_SCATTERING_SINGLE, s.scene.light_count = 0;
    CHECK_OK(context, ex_light_volume_compute(context, &s.scene, &s.view, &v));
    path_of("b.npy", path);
    CHECK(v.lights == 0 && ex_light_volume_write_npy(path, &v, &error) == 0);
    const size_t start = npy_begin("b.npy", "'shape': (3, 2, 4, 15)");
    CHECK(read_file("b.npy", other, sizeof other) == (int)start + PROBES * 15 * 4);
    path_of("b.dds", path);
    CHECK(ex_light_volume_write_dds(path, &v, 1, &error) == 0);
    CHECK(read_file("b.dds", other, sizeof other) == 148 + PROBES * 4 * 16);
    ex_light_volume_free(&v);
    sps_destroy(context);
}

/* --------------------------------------------------------------------------------------------------- the command line
 */

#define GAS    "light-volume --volume c.raw --size 8,8,8 --box -1,-1,-1,1,1,1 "
#define LIGHT  "--light directional,0.25,-1,0.5,1,1,1 --light point,0,2,1,4,4,4 "
#define COLORS "--albedo 0.9,0.5,0.25 --emission 0.125,0.5,0.25 "
#define PLAIN  GAS COLORS LIGHT "--quality draft --scattering single "

static void test_wrong_options(void) {
    static const complaint wrong[] = {
        {GAS, 2, "nothing to write: give --out"},
        {"light-volume --out a.npy", 2, "nothing to bake: give --volume, --particles or --mesh"},
        {"light-volume --particles none.f32 --out a.npy", 2, "nothing to bake: the scene is empty"},
        {GAS "--out a.png", 2, "--out a.png: the name must end in .dds or .npy"},
        {GAS "--out a.npy --texels half", 2, "--out a.npy holds no --texels half"},
        {GAS "--out a.dds --texels unorm8", 2, "--texels unorm8: bake light-volume has half or float"},
        {GAS "--out a.npy --texels unorm16", 2, "--texels unorm16: bake light-volume has half or float"},
        {GAS "--out a.dds --shadow deep", 2, "--shadow deep says nothing about bake light-volume"},
        {GAS "--out a.dds --probes 0,1,1", 2, "--probes: '0,1,1' is out of range: X,Y,Z must be within 1..2048"},
        {GAS "--out a.dds --probes 1,1,2049", 2, "--probes: '1,1,2049' is out of range"},
        {GAS "--out a.dds --probes 4,4", 2, "--probes: '4,4' is not X,Y,Z"},
        {GAS "--out a.dds --probes 1,1,513", 2, "a.dds: a DDS texture with 2052 slices"},
        {GAS "--out a.npy --probes 2048,2048,5", 2, "a.npy: 2048 x 2048 x 5 probes of 15 numbers: more than"},
        {GAS "--out missing/a.npy", 2, "missing/a.npy: cannot be written"},
        {"light-volume --volume v.dds --size 2,2,2 --out v.dds", 2, "--out v.dds is a file that --volume reads"},
        {GAS "--out a.npy --scattering forward", 1, "light probes have no FORWARD and no CONVOLUTION (give --scat"},
        {GAS "--out a.npy --scattering convolution", 1, "--scattering: "},
        {"light-volume --mesh dot.obj --out a.npy", 2, "light probes need a box, but the scene has no extent"},
        {"impostor --probes 1,1,1", 2, "--probes says nothing about bake impostor: bake light-volume has it"},
        {"six-way --out-a a.png --out-b b.png --probes 1,1,1", 2,
         "--probes says nothing about bake six-way: bake light-volume has it"},
        {"map --probes 1,1,1", 2, "--probes says nothing about bake map: bake light-volume has it"},
        {"cloud-shadow --probes 1,1,1", 2, "--probes says nothing about bake cloud-shadow: bake light-volume has it"}};
    CHECK_COMPLAINTS(wrong);
}

/* Options of other commands, with a value. */
static void test_refused_options(void) {
    static const char *const given[] = {"--camera 0,0,5,0,0,0",
                                        "--fov 9",
                                        "--ortho 2",
                                        "--width 4",
                                        "--height 4",
                                        "--region 0,0,1,1",
                                        "--background 1,1,1",
                                        "--coverage 2",
                                        "--slab-thickness 1",
                                        "--shadow-resolution 4",
                                        "--map-components 4",
                                        "--map-resolution 4",
                                        "--table-size 9",
                                        "--map-cubic",
                                        "--filling splat",
                                        "--tolerance 1",
                                        "--reference",
                                        "--samples 4",
                                        "--budget-seconds 1",
                                        "--budget-error 1",
                                        "--pfm x.pfm",
                                        "--exr x.exr",
                                        "--exr-compression zip",
                                        "--stats x.json",
                                        "--part 1/2",
                                        "--plan",
                                        "--list-grids",
                                        "--layout cube",
                                        "--tile 4",
                                        "--tiles 2,2",
                                        "--frames 1,2",
                                        "--alpha straight",
                                        "--scale 2",
                                        "--out-a x.dds",
                                        "--convention unreal",
                                        "--border 1",
                                        "--depths 1,2",
                                        "--surfaces x.dds",
                                        "--constants x.json"};
    for (size_t i = 0; i < sizeof given / sizeof *given; ++i) {
        char options[300], words[100];
        snprintf(options, sizeof options, GAS "--out a.dds %s", given[i]);
        snprintf(words, sizeof words, "%.*s says nothing about bake light-volume: ", (int)strcspn(given[i], " "),
                 given[i]);
        const complaint one = {options, 2, words};
        check_complaints(&one, 1);
    }
}

/* The program may round otherwise than this one: some 100 operations of 6e-8 each, of numbers up to about 1. Its origin
   and spacing are those of the numbers. */
static void test_same_as_library(void) {
    static const complaint made[] = {{PLAIN "--probes 4,2,3 --out a.npy >said.txt", 0, NULL},
                                     {PLAIN "--probes 4,2,3 --texels float --out a.dds --threads 3 >b.txt", 0, NULL},
                                     {PLAIN "--probes 4,2,3 --out h.dds >b.txt", 0, NULL}};
    sps_context *context = check_context(NULL);
    double origin[3] = {9, 9, 9}, spacing[3] = {9, 9, 9}, worst = 0;
    int n[3], lights;
    CHECK_COMPLAINTS(made);
    read_file("said.txt", other, sizeof other);
    CHECK(sscanf(other, "probes %d,%d,%d lights %d origin %lf,%lf,%lf spacing %lf,%lf,%lf\n", n, n + 1, n + 2, &lights,
                 origin, origin + 1, origin + 2, spacing, spacing + 1, spacing + 2) == 10);
    CHECK(n[0] == NX && n[1] == NY && n[2] == NZ && lights == LIGHTS && strchr(other, '\n')[1] == 0);
    CHECK(origin[0] == -0.75 && origin[1] == -0.5 && spacing[0] == 0.5 && spacing[1] == 1);
    make_scene();
    find_expected(context, origin, spacing);
    const size_t start = npy_begin("a.npy", "'shape': (3, 2, 4, 21)");
    for (size_t i = 0; i < PROBES && start; ++i)
        for (size_t k = 0; k < EACH; ++k) {
            float *exact = k < 3    ? sky + 3 * i + k
                           : k < 6  ? l0 + 3 * i + k - 3
                           : k < 15 ? l1 + 9 * i + k - 6
                                    : through + 3 * LIGHTS * i + k - 15;
            const float found = float_at(start + 4 * (EACH * i + k));
            worst = fmax(worst, fabs((double)*exact - (double)found));
            *exact = found; /* which the textures repeat exactly */
        }
    if (figures()) printf("program: off by %.2g\n", worst);
    CHECK(start && worst <= 6e-6);
    check_dds("a.dds", 4), check_dds("h.dds", 2);
    sps_destroy(context);
}

/* Cubes by default, about the scene; --shadow none lets all light through; what halves cannot hold is told. */
static void test_defaults(void) {
    static const complaint made[] = {{"light-volume --volume c.raw --size 8,8,8 --box 0,0,0,2,1,0.25 --quality draft "
                                      "--out a.npy >a.txt",
                                      0, NULL},
                                     {PLAIN "--probes 1,1,1 --shadow none --out b.npy >b.txt", 0, NULL}};
    static const char loud[] = GAS LIGHT "--emission 1e6,0,0 --probes 1,1,1 --scattering single --out c.dds >c.txt";
    CHECK_COMPLAINTS(made);
    CHECK(read_file("a.txt", data, sizeof data) > 0);
    CHECK(strcmp(data, "probes 32,16,4 lights 0 origin 0.03125,0.03125,0.03125 spacing 0.0625,0.0625,0.0625\n") == 0);
    size_t start = npy_begin("b.npy", "'shape': (1, 1, 1, 21)");
    for (size_t k = 15; k < 21 && start; ++k) CHECK(float_at(start + 4 * k) == 1);
    const outcome got = run_render(loud);
    CHECK(got.status == 0 && strstr(got.said, "bake: c.dds: ") && strstr(got.said, "numbers exceed 65504"));
}

/* Help lists what there is and no more. */
static void test_help(void) {
    static const complaint helps[] = {{"light-volume --help >help.txt", 0, NULL}};
    CHECK_COMPLAINTS(helps);
    CHECK(read_file("help.txt", data, sizeof data) > 3000 && strstr(data, "usage: bake light-volume [options]\n"));
    CHECK(strstr(data, "--probes X,Y,Z") && strstr(data, "--light ") && strstr(data, "--scattering "));
    CHECK(!strstr(data, "  --camera") && !strstr(data, "  --tile ") && !strstr(data, "  --budget-seconds"));
    for (char *line = strtok(data, "\n"); line; line = strtok(NULL, "\n")) CHECK(strlen(line) <= 120);
}

static void test_command_line(void) {
    static const char dot[] = "v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n";
    if (!render_is_built()) {
        printf("skipped: the command line: run this in the top folder, after make build/tests/bake\n");
        return;
    }
    make_scene();
    write_file("c.raw", cloud, sizeof cloud), write_file("v.dds", cloud, 8), write_file("none.f32", "", 0);
    write_file("dot.obj", dot, sizeof dot - 1);
    RUN(test_wrong_options);
    RUN(test_refused_options);
    RUN(test_same_as_library);
    RUN(test_defaults);
    RUN(test_help);
}

int main(void) {
    tested = "bake";
    if (!CHECK(folder_begin())) return check_report();
    RUN(test_fit);
    RUN(test_large);
    RUN(test_files);
    RUN(test_failure);
    if (!check_memory_only()) test_command_line(); /* which is no program with sanitizers */
    folder_end();
    return check_report();
}
