/* The messages of the command line, build/render, and the files that it reads and writes. */

#include "check.h"
#include "command_line.h"
#include <unistd.h>

/* ------------------------------------------------------------------------------------------------- the command line */

#define SMALL  "--width 5 --height 4 --scattering single " /* sufficient for most of these tests */
#define VOLUME "--volume two.raw --size 2,2,2 " SMALL      /* the same with something visible */

static void test_full_disk(void) {
    static const complaint full[] = {{VOLUME "--out /dev/full", 2, "/dev/full: "},
                                     {VOLUME "--pfm /dev/full", 2, "/dev/full: "},
                                     {VOLUME "--alpha-pfm /dev/full", 2, "/dev/full: "},
                                     {VOLUME "--stats /dev/full", 2, "/dev/full: "},
                                     {VOLUME "--out a.png --stats /dev/full", 2, "No space left"},
                                     {VOLUME "--width 500 --pfm /dev/full", 2, "No space left"},
                                     {VOLUME "--plan >/dev/full", 2, "standard output: "},
                                     {"--help >/dev/full", 2, "standard output: "}};
    FILE *device = fopen("/dev/full", "wb");
    if (!device) {
        printf("skipped: a full disk: there is no /dev/full here\n");
        return;
    }
    fclose(device);
    CHECK_COMPLAINTS(full);
}

/* All four files at once, each of its expected size. */
static void test_files_written(void) {
    static const complaint all[] = {
        {VOLUME "--out a.png --pfm a.pfm --alpha-pfm b.pfm --stats a.json", 0, NULL},
        {VOLUME "--out missing/a.png", 2, "missing/a.png"},
    };
    char text[4000];
    CHECK_COMPLAINTS(all);
    CHECK(read_file("a.png", text, sizeof text) > 60 && memcmp(text, "\x89PNG\r\n\x1a\n", 8) == 0);
    CHECK(read_file("a.pfm", text, sizeof text) == 12 + 4 * 3 * 20 && memcmp(text, "PF\n5 4\n-1.0\n", 12) == 0);
    CHECK(read_file("b.pfm", text, sizeof text) == 12 + 4 * 20 && memcmp(text, "Pf\n5 4\n-1.0\n", 12) == 0);
    CHECK(read_file("a.json", text, sizeof text) > 60 && text[0] == '{' && strstr(text, "\"version\": 500\n}\n"));
}

/* Renders with the options in order from `first` on, or in reverse (step -1); returns whether this is that picture. */
static int same_picture(const char *const *list, int count, int first, int step, const char *same) {
    char options[1000] = "", picture[400];
    outcome got;
    for (int i = 0; i < count; ++i) {
        strcat(options, list[(first + step * i + count * count) % count]);
        strcat(options, " ");
    }
    got = run_render(options);
    memset(picture, 0, sizeof picture);
    read_file("order.pfm", picture, sizeof picture);
    if (CHECK(got.status == 0 && got.said[0] == 0) && CHECK(memcmp(picture, same, sizeof picture) == 0)) return 1;
    printf("    render %s\n    gives %d, and says: %s\n", options, got.status, got.said);
    return 0;
}

/* Two lights keep their order: a sum of floats depends on it. */
static void test_any_order(void) {
    static const char *const list[] = {"--volume two.raw",
                                       "--size 2,2,2",
                                       "--type u8",
                                       "--box -1,-1,-1,1,2,1",
                                       "--extinction 3",
                                       "--albedo 0.9,0.2,0.4",
                                       "--emission 0.1,0,0",
                                       "--phase 0.5,-0.3,0.2",
                                       "--mesh corner.obj",
                                       "--mesh-color 1,0.2,0",
                                       "--camera 1,2,5,0,0,0",
                                       "--up 1,1,0",
                                       "--fov 30",
                                       "--light directional,-1,-1,-1,2,2,2 --light point,9,9,9,50,40,30",
                                       "--ambient 0.1,0.1,0.2",
                                       "--background 0,0,0.1",
                                       "--region 0,1,5,3",
                                       "--width 5",
                                       "--height 4",
                                       "--coverage 3",
                                       "--slab-thickness 0.5",
                                       "--shadow-resolution 9",
                                       "--quality draft",
                                       "--scattering single",
                                       "--threads 1",
                                       "--pfm order.pfm"};
    const int count = sizeof list / sizeof *list;
    char picture[400];
    memset(picture, 0, sizeof picture);
    CHECK(run_render("--volume two.raw --size 2,2,2 --box -1,-1,-1,1,2,1 --extinction 3 --albedo 0.9,0.2,0.4 "
                     "--emission 0.1,0,0 --phase 0.5,-0.3,0.2 --mesh corner.obj --mesh-color 1,0.2,0 --width 5 "
                     "--height 4 --camera 1,2,5,0,0,0 --up 1,1,0 --fov 30 --light directional,-1,-1,-1,2,2,2 "
                     "--light point,9,9,9,50,40,30 --ambient 0.1,0.1,0.2 --background 0,0,0.1 --region 0,1,5,3 "
                     "--coverage 3 --slab-thickness 0.5 --shadow-resolution 9 --quality draft --scattering single "
                     "--pfm order.pfm")
              .status == 0);
    CHECK(read_file("order.pfm", picture, sizeof picture) == 12 + 4 * 3 * 15);
    for (int first = 0; first < count; ++first) {
        if (!same_picture(list, count, first, 1, picture)) return;
        if (!same_picture(list, count, first, -1, picture)) return;
    }
}

/* Options before the first volume apply to the first, others to the volume that they follow; the same for meshes. */
static void test_owners(void) {
    static const complaint owners[] = {
        {"--size 2,2,2 --volume two.raw --volume two.raw --size 2,2,2 --plan >plan", 0, NULL},
        {"--size 2,2,2 --volume two.raw --volume two.raw --plan", 2, "--volume two.raw has no --size after it"},
        {"--volume two.raw --plan", 2, "--volume two.raw has no --size"},
        {"--size 2,2,1 --volume two.raw --size 2,2,2 --plan >plan", 0, NULL}, /* of two, the last */
        {"--mesh-color 1,0,0 --mesh corner.obj --plan >plan", 0, NULL},
        {"--size 2,2,2 --plan", 2, "--size: there is no --volume"},
        {"--mesh-color 1,0,0 --plan", 2, "--mesh-color: there is no --mesh"},
        {"--mesh-transmittance 1,0,0 --plan", 2, "--mesh-transmittance: there is no --mesh"}};
    CHECK_COMPLAINTS(owners);
}

/* A look is equivalent to its lines: the same picture, with a mesh that lies beside it; later options override it. */
static void test_looks(void) {
    static const complaint good[] = {
        {SMALL "--volume two.raw --size 2,2,2 --transfer look.txt --shading surface --mesh corner.obj "
               "--light directional,-1,-1,-1,2,2,2 --light point,9,9,9,50,40,30 --pfm lines.pfm",
         0, NULL},
        {"--look looks/whole.txt --volume two.raw --pfm look.pfm", 0, NULL},
        {"--look looks/whole.txt --volume two.raw --width 6 --pfm wide.pfm", 0, NULL},
        {"--width 6 --look looks/whole.txt --volume two.raw --pfm narrow.pfm", 0, NULL},
        {"--look looks/empty.txt " VOLUME "--plan >plan", 0, NULL},
        {"--look looks/slide.txt --plan >plan", 0, NULL}};
    static const complaint bad[] = {
        {"--look missing.txt --plan", 2, "missing.txt: No such file"},
        {"--look looks/unknown.txt --plan", 2, "looks/unknown.txt:3: 'bogus' is not an option for a look"},
        {"--look looks/nested.txt --plan", 2, "looks/nested.txt:1: 'look' is not an option for a look"},
        {"--look looks/value.txt --plan", 2, "looks/value.txt:1: --size needs a value: X,Y,Z"},
        {"--look looks/flag.txt --plan", 2, "looks/flag.txt:1: --no-shadows takes no value: 'please'"},
        {"--look looks/range.txt --plan", 2, "looks/range.txt:2: --size: '2,2,0' is out of range"},
        {"--look looks/range.txt", 2, "looks/range.txt:2: --size: '2,2,0' is out of range"},
        {"--look looks/points.txt " VOLUME "--plan", 2, "looks/points.txt:2: --transfer-point: '0.1,0,0,0,0' will not"},
        {"--look looks/whole.txt --volume two.raw --transfer look.txt --plan", 2,
         "--transfer and --transfer-point of two.raw exclude"},
        {"--look looks/whole.txt --volume two.raw --albedo 1,1,1 --plan", 2,
         "--albedo and --transfer-point of two.raw exclude"},
        {"--look looks/whole.txt --volume two.raw --out looks/whole.txt", 2,
         "--out looks/whole.txt is a file that --look reads"},
        {"--look looks/whole.txt --volume two.raw --out looks/corner.obj", 2,
         "--out looks/corner.obj is a file that --mesh reads"},
        {"--look looks/slide.txt --out 'looks/dark, 1.ppm'", 2, "--out looks/dark, 1.ppm is a file that --light reads"},
        {"--transfer-point 0,1,1,1", 2, "--transfer-point: '0,1,1,1' is not value,r,g,b,extinction[,r,g,b]"},
        {"--transfer-point 0,1,1,2,0", 2, "out of range: r,g,b must be within 0..1"},
        {"--transfer-point -1,1,1,1,0", 2, "out of range: value, extinction and emission must be within 0..1e+18"},
        {"--transfer-point 0,1,1,1,0 --plan", 2, "--transfer-point: there is no --volume"},
        {VOLUME "--transfer-point 2,1,1,1,0 --transfer-point 3,1,1,1,9 --plan", 2,
         "--transfer-point: a line's value is 2, and there are lines beyond it; u8 voxels stand for 0..1"}};
    static const char corner[] = "v -1 0 0\nv 2 0 0\nv 0 2 -1\nf 1 2 3\n", dark[] = "P6 1 1 255 \0\0\0";
    static const char whole[] =
        "# two voxels\r\nwidth 5 # pixels\n\n  height\t4\nscattering single\nsize 2,2,2\nmesh corner.obj\n"
        "transfer-point 0.1,0.9,0.5,0.2,0\ntransfer-point 1,0.9,0.5,0.2,8\nshading surface\n"
        "light directional,-1,-1,-1,2,2,2\nlight point,9,9,9,50,40,30";
    static const char projector[] = "light projector,0,0,5,0,0,-1,30,1,1,1,dark, 1.ppm\n";
    char path[200], lines[400], look[400];
    snprintf(path, sizeof path, "%s/looks", folder);
    CHECK(mkdir(path, 0777) == 0);
    write_file("looks/corner.obj", corner, strlen(corner));
    write_file("looks/whole.txt", whole, strlen(whole));
    write_file("looks/empty.txt", "#\n", 2);
    write_file("looks/dark, 1.ppm", dark, sizeof dark - 1);
    write_file("looks/slide.txt", projector, strlen(projector));
    write_file("looks/unknown.txt", "\n\nbogus 1\n", 10);
    write_file("looks/nested.txt", "look empty.txt\n", 15);
    write_file("looks/value.txt", "size # nothing\n", 15);
    write_file("looks/flag.txt", "no-shadows please\n", 18);
    write_file("looks/range.txt", "type u8\nsize 2,2,0\n", 19);
    write_file("looks/points.txt", "transfer-point 0.1,0,0,0,0\ntransfer-point 0.1,0,0,0,0\n", 54);
    CHECK_COMPLAINTS(good);
    CHECK_COMPLAINTS(bad);
    CHECK(read_file("lines.pfm", lines, sizeof lines) == 12 + 4 * 3 * 20);
    CHECK(read_file("look.pfm", look, sizeof look) == 12 + 4 * 3 * 20);
    CHECK(memcmp(lines, look, 12 + 4 * 3 * 20) == 0);
    CHECK(read_file("wide.pfm", look, sizeof look) == 12 + 4 * 3 * 24);
    CHECK(read_file("narrow.pfm", look, sizeof look) == 12 + 4 * 3 * 20);
}

/* Contradictory options. */
static void test_exclusions(void) {
    static const complaint both[] = {
        {SMALL "--fov 30 --ortho 2 --out a.png", 2, "--fov (perspective) and --ortho (orthographic) exclude"},
        {SMALL "--ortho 2 --fov 30 --out a.png", 2, "--fov (perspective) and --ortho (orthographic) exclude"},
        {VOLUME "--transfer look.txt --extinction 1 --out a.png", 2, "--extinction and --transfer of two.raw"},
        {"--albedo 0.8,0.8,0.8 --transfer look.txt " VOLUME "--out a.png", 2, "--albedo and --transfer of two.raw"},
        {VOLUME "--emission 0,0,0 --transfer look.txt --out a.png", 2, "--emission and --transfer of two.raw"},
        {VOLUME "--emission 1,1,1 --shading surface --out a.png", 2, "--emission and --shading surface of two.raw"},
        {VOLUME "--crop 0,0,1,2,2,0 --out a.png", 2,
         "--crop of two.raw: faces 1 and 0 along z must not fall, within 0..2"},
        {VOLUME "--crop 0,0,0,2,3,2 --out a.png", 2,
         "--crop of two.raw: faces 0 and 3 along y must not fall, within 0..2"},
        {VOLUME "--crop 0,0,1,2,2,1 --out a.png", 0, NULL},
        {VOLUME "--crop 0,0,0,0,0,0 --out a.png", 0, NULL},
        {VOLUME "--crop 0,-1,0,2,2,2 --out a.png", 2, "--crop"},
        {VOLUME "--crop 0,1,0,2,2,2 --out a.png", 0, NULL},
        {VOLUME "--plan --reference >plan", 2, "--plan and --reference exclude"},
        {VOLUME "--transfer look.txt --phase 0.3 --shading surface --out a.png", 0, NULL},
        {VOLUME "--albedo 1,1,1 --extinction 9 --shading surface --out a.png", 0, NULL},
        {VOLUME "--transfer look.txt --volume two.raw --size 2,2,2 --extinction 5 --out a.png", 0, NULL},
        {VOLUME "--reference --quality high --shadow-resolution 9 --out a.png", 0,
         NULL}}; /* to compare one with the other */
    CHECK_COMPLAINTS(both);
}

/* Each line names the option and the invalid number. */
static void test_bad_values(void) {
    static const complaint bad[] = {
        {"--bogus", 2, "unknown option '--bogus'"},
        {"two.raw", 2, "unknown option 'two.raw'"},
        {"$(printf '\\033[31m')", 2, "unknown option '?[31m'"},
        {"--size", 2, "--size needs a value: X,Y,Z"},
        {"--size --plan", 2, "--size needs a value: X,Y,Z"},
        {"--size 2,2", 2, "--size: '2,2' is not X,Y,Z"},
        {"--size 2,2,2,2", 2, "--size: '2,2,2,2' is not X,Y,Z"},
        {"--size 2,2,2.0", 2, "--size: '2,2,2.0' is not X,Y,Z"},
        {"--size 2,2,0", 2, "--size: '2,2,0' is out of range: X,Y,Z must be within 1..65536"},
        {"--size 2,2,99999999999999999999", 2, "X,Y,Z must be within 1..65536"},
        {"--size ''", 2, "--size: '' is not X,Y,Z"},
        {"--size \"$(printf '2\\n2')\"", 2, "--size: '2?2' is not X,Y,Z"},
        {"--type u128", 2, "--type: 'u128' is not u8|i8|u16|i16|u32|i32|f32|f64|u64|i64|f16"},
        {"--quality default", 2, "--quality: 'default' is not draft|medium|high|ultra"},
        {"--box 0,0,0,1,1,1e17", 2, "must be within -1e+15..1e+15"},
        {"--box 0,0,0,1,1,nan", 2, "--box: '0,0,0,1,1,nan' is not x0,y0,z0,x1,y1,z1"},
        {VOLUME "--box 0,0,0,1,0,1 --plan", 2, "--box of two.raw: no extent along y"},
        {"--extinction -1", 2, "--extinction: '-1' is out of range: S must be within 0..1e+18"},
        {"--extinction 1e999", 2, "--extinction: '1e999' is out of range: S must be within 0..1e+18"},
        {"--albedo 0.5,0.5,1.5", 2, "r,g,b must be within 0..1"},
        {"--mesh-transmittance 0.5,0.5,1.5", 2, "--mesh-transmittance: '0.5,0.5,1.5' is out of range"},
        {"--mesh-transmittance 0.5", 2, "--mesh-transmittance: '0.5' is not r,g,b"},
        {"--phase .5,.5", 2, "--phase: '.5,.5' is not g[,g2,w]"},
        {"--phase .5,.5,2", 2, "--phase: '.5,.5,2' is out of range: w must be within 0..1"},
        {"--phase 1", 2, "--phase: '1' is out of range: g and g2 must be within -0.99..0.99"},
        {"--phase .5,-1,0", 2, "g and g2 must be within -0.99..0.99"},
        {"--camera 0,0,0,0,0,0", 2, "--camera: '0,0,0,0,0,0' will not do: position and target are the same point"},
        {"--camera 0,0,0,0,0,1e16", 2, "must be within -1e+15..1e+15"},
        {"--fov 0", 2, "--fov: '0' is out of range: DEG must be within 0.001..177"},
        {"--ortho 1e16", 2, "--ortho: '1e16' is out of range: HEIGHT must be within 1e-15..1e+15"},
        {"--light sun,0,0,1,1,1,1", 2, "--light: 'sun,0,0,1,1,1,1' is not directional,dx,dy,dz,r,g,b | point,x"},
        {"--light point,0,0,1,1,1", 2, "--light: 'point,0,0,1,1,1' is not directional"},
        {"--light directional,0,0,0,1,1,1", 2, "'directional,0,0,0,1,1,1' will not do: the direction is zero"},
        {"--light directional,0,0,1,1,-1,1", 2, "out of range: r,g,b must be within 0..1e+18"},
        {"--light point,0,0,1e16,1,1,1", 2, "out of range: x,y,z must be within -1e+15..1e+15"},
        {"--width 0", 2, "--width: '0' is out of range: W must be within 1..16384"},
        {SMALL "--region 0,0,6,1 --out a.png", 2, "--region 0,0,6,1 is empty or not within the image of 5 x 4"},
        {SMALL "--region 0,0,0,0 --out a.png", 2, "--region 0,0,0,0 is empty"},
        {"--slab-thickness 0", 2, "--slab-thickness: '0' is out of range"},
        {"--threads 0", 2, "--threads: '0' is out of range: N must be within 1..1024"},
        {"--out ''", 2, "--out: '' is not FILE.png"},
        {VOLUME, 2, "nothing to write"}};
    CHECK_COMPLAINTS(bad);
}

/* Two balls, soft and by extinction: there is a picture, and the statistics count them. */
static void test_particles_option(void) {
    static const complaint all[] = {
        {"--particle-soft --particles balls.f32 --particle-phase 0.5 --particle-emission 1,0,0 --particle-extinction "
         "--particle-albedo 1,0.5,0 --width 20 --height 20 --alpha-pfm b.pfm --stats a.json",
         0, NULL},
        {"--particles balls.f32 --plan >plan", 0, NULL},
        {"--particle-soft --plan", 2, "--particle-soft: there is no --particles"},
        {"--particles balls.f32 --out balls.f32", 2, "--out balls.f32 is a file that --particles reads"},
        {"--particles balls.f32 --particle-albedo 2,0,0 --plan", 2, "--particle-albedo: '2,0,0' is out of range"}};
    static const float balls[10] = {0, 0, 0, 1, 3, 0.5f, 0.25f, 0, 0.5f, 2};
    char text[4000];
    float middle;
    write_file("balls.f32", balls, sizeof balls);
    CHECK_COMPLAINTS(all);
    CHECK(read_file("a.json", text, sizeof text) > 60 && strstr(text, "\"particles\": 2,"));
    CHECK(read_file("plan", text, sizeof text) > 60 && strstr(text, "particle_calls   1"));
    CHECK(read_file("b.pfm", text, sizeof text) > 4 * 400);
    memcpy(&middle, strstr(text, "-1.0\n") + 5 + 4 * (10 * 20 + 10), sizeof middle);
    CHECK(middle > 0.9f && middle <= 1); /* three times 4/3 of a unit, at least */
}

/* Every kind of shadow makes a picture of its own, and so does every way to read a map; options for a map must fit the
   kind of map. */
static void test_shadow_option(void) {
    enum { KINDS = 14 };
    static const char *const kinds[KINDS] = {"sheets",       "deep",
                                             "compressed",   "compressed --map-components 16",
                                             "opacity",      "opacity --map-cubic",
                                             "deep-opacity", "deep-opacity --map-cubic",
                                             "fourier",      "fourier --map-texel-range",
                                             "moment",       "beer",
                                             "table",        "none"};
    static const complaint all[] = {
        {VOLUME "--shadow fourier --map-components 4 " SMALL "--light directional,0,0,-1,1,1,1 --out a.png", 2,
         "--map-components: light[0].shadow_map.components is 4; a Fourier map has 3, 5 .. 65"},
        {VOLUME "--map-resolution 8 --plan", 2, "--map-resolution says nothing about --shadow auto"},
        {VOLUME "--shadow deep --no-shadows --plan", 2, "--shadow deep says nothing with --no-shadows"},
        {VOLUME "--shadow deep --map-epsilon 0.1 --plan", 2, "--map-epsilon says nothing about --shadow deep"},
        {VOLUME "--shadow fourier --map-cubic --plan", 2, "--map-cubic says nothing about --shadow fourier"},
        {VOLUME "--map-cubic --shadow sheets --plan", 2, "--map-cubic says nothing about --shadow sheets"},
        {VOLUME "--map-texel-range --shadow moment --plan", 2, "--map-texel-range says nothing about --shadow moment"},
        {VOLUME "--table-size 8 --shadow sheets --plan", 2, "--table-size says nothing about --shadow sheets"},
        {VOLUME "--table-size 8 --plan >plan", 0, NULL},
        {VOLUME "--shadow samples --no-shadows --out a.png", 2, "--shadow samples says nothing with --no-shadows"},
        {VOLUME "--shadow samples --plan", 2, "--plan and --shadow samples exclude each other"},
        {VOLUME "--shadow samples --light directional,0,0,1,1,1,1 --light-angle 1 --out a.png", 0, NULL},
        {VOLUME "--shadow deep --table-size 8 --plan", 2, "--table-size says nothing about --shadow deep"},
        {VOLUME "--shadow table --map-resolution 8 --plan", 2, "--map-resolution says nothing about --shadow table"},
        {VOLUME "--shadow table --map-cubic --plan", 2, "--map-cubic says nothing about --shadow table"},
        {VOLUME "--shadow table --no-shadows --plan", 2, "--shadow table says nothing with --no-shadows"},
        {VOLUME "--shadow table --map-components 7 " SMALL "--light directional,0,0,-1,1,1,1 --out a.png", 2,
         "--map-components: light[0].shadow_map.components is 7; a shadow table has 8, 9 .. 1024"},
        {VOLUME "--shadow none --map-components 8 --plan", 2, "--map-components says nothing about --shadow none"},
        {VOLUME "--shadow none --light point,9,9,9,1,1,1 --light-size 1 --plan >plan", 0, NULL},
        {VOLUME "--shadow hairy --plan", 2, "--shadow: 'hairy' is not auto|sheets|deep"},
        {VOLUME "--light point,0.5,0.5,0.5,1,1,1 --shadow opacity --map-resolution 9 " SMALL "--out a.png", 0, NULL},
        {VOLUME "--shadow fourier --map-components 7 --light directional,0,0,-1,1,1,1 " SMALL "--out a.png", 0, NULL}};
    static char pictures[KINDS][400];
    for (int i = 0; i < KINDS; ++i) {
        char line[300];
        snprintf(line, sizeof line,
                 VOLUME SMALL "--extinction 15 --light directional,1,-1,-1,9,9,9 --shadow %s --pfm shadow.pfm",
                 kinds[i]);
        CHECK(run_render(line).status == 0);
        CHECK(read_file("shadow.pfm", pictures[i], sizeof pictures[i]) > 12);
        for (int k = 0; k < i; ++k)
            if (!CHECK(memcmp(pictures[k], pictures[i], sizeof pictures[i]) != 0))
                printf("    %s and %s give one picture\n", kinds[k], kinds[i]);
    }
    CHECK_COMPLAINTS(all);
}

#define CAST   VOLUME "--extinction 15 --light directional,1,-1,-1,9,9,9 "
#define INSIDE "--light point,0.5,0.5,0.5,1,1,1 "

/* Renders both into shadow.pfm. */
static int same_shadows(const char *line_a, const char *line_b) {
    char a[400], b[400];
    CHECK(run_render(line_a).status == 0);
    const int size = read_file("shadow.pfm", a, sizeof a);
    CHECK(run_render(line_b).status == 0);
    return CHECK(size > 12 && read_file("shadow.pfm", b, sizeof b) == size) && memcmp(a, b, (size_t)size) == 0;
}

static int says(const char *file, const char *words) {
    static char text[8000];
    CHECK(read_file(file, text, sizeof text) > 0);
    return strstr(text, words) != NULL;
}

/* By default the first light has sheets, and one in the gas has a table, as large as it is to be; all have sheets where
   they are forced. Samples are those of the reference. */
static void test_chosen_option(void) {
    CHECK(run_render(CAST INSIDE "--stats stats.json --out a.png").status == 0);
    CHECK(says("stats.json", "\"tables_made\": 1,"));
    CHECK(run_render(CAST INSIDE "--plan >plan").status == 0);
    CHECK(says("plan", "a table: the light is in the gas") && says("plan", "tables_made      1\n"));
    CHECK(same_shadows(CAST INSIDE "--pfm shadow.pfm", CAST INSIDE "--shadow auto --pfm shadow.pfm"));
    CHECK(!same_shadows(CAST INSIDE "--pfm shadow.pfm", CAST INSIDE "--table-size 8 --pfm shadow.pfm"));
    CHECK(run_render(CAST "--light directional,1,0,-1,9,9,9 --plan >plan").status == 0);
    CHECK(says("plan", "a table: the light shares the sweep of another"));
    CHECK(run_render(CAST "--light directional,1,0,-1,9,9,9 --shadow sheets --plan >plan").status == 0);
    CHECK(says("plan", "tables_made      0\n") && says("plan", "sweep_count      2\n"));
    CHECK(same_shadows(CAST "--shadow samples --pfm shadow.pfm", CAST "--reference --pfm shadow.pfm"));
    CHECK(!same_shadows(CAST "--shadow samples --pfm shadow.pfm", CAST "--pfm shadow.pfm"));
}

/* The size of a table and its planes change the picture; plan and statistics count tables; --shadow none is
   --no-shadows. */
static void test_table_option(void) {
    CHECK(same_shadows(CAST "--shadow table --pfm shadow.pfm", CAST "--shadow table --threads 1 --pfm shadow.pfm"));
    CHECK(!same_shadows(CAST "--shadow table --pfm shadow.pfm", CAST "--shadow table --table-size 8 --pfm shadow.pfm"));
    CHECK(!same_shadows(CAST "--shadow table --pfm shadow.pfm",
                        CAST "--shadow table --map-components 9 --pfm shadow.pfm"));
    CHECK(same_shadows(CAST "--shadow none --pfm shadow.pfm", CAST "--no-shadows --pfm shadow.pfm"));
    CHECK(same_shadows(CAST "--shadow none --reference --pfm shadow.pfm",
                       CAST "--no-shadows --reference --pfm shadow.pfm"));
    CHECK(run_render(CAST "--light point,0.5,0.5,0.5,1,1,1 --shadow table --stats stats.json --out a.png").status == 0);
    CHECK(says("stats.json", "\"tables_made\": 2,") && says("stats.json", "\"tables_held\": 0,"));
    CHECK(run_render(CAST "--shadow table --plan >plan").status == 0);
    CHECK(says("plan", "tables_made      1\n"));
    CHECK(run_render(CAST "--shadow deep --plan >plan").status == 0);
    CHECK(says("plan", "tables_made      0\n"));
    test_chosen_option();
}

/* Runs a line that writes extent.pfm, and compares it with the same picture of 5 x 4 pixels by the library. Floats
   differ by what the two programs' compilers make of a sum. */
static void check_same_pfm(const char *line, const float *rgba) {
    char file[400];
    float rows[3 * 20];
    CHECK(run_render(line).status == 0);
    if (!CHECK(read_file("extent.pfm", file, sizeof file) == 12 + sizeof rows)) return;
    memcpy(rows, file + 12, sizeof rows);
    for (int pixel = 0; pixel < 20; ++pixel)
        for (int c = 0; c < 3; ++c)
            CHECK_NEAR((double)rows[3 * ((3 - pixel / 5) * 5 + pixel % 5) + c], (double)rgba[4 * pixel + c], 1e-5);
}

/* The view of these tests: SMALL, and --mesh corner.obj --camera 0.5,1,4,0.5,1,-0.5. */
static void start_corner(check_scene *s, check_triangles *corner) {
    static const double origin[3] = {-1, 0, 0}, right[3] = {2, 0, 0}, top[3] = {0, 2, -1};
    corner->count = 0;
    check_add_corners(corner, origin, right, top);
    check_clear(s, 5, 4);
    check_add_mesh(s, corner, 0.8);
    check_set3(s->view.camera.position, 0.5, 1, 4);
    check_set3(s->view.camera.target, 0.5, 1, -0.5);
    check_set3(s->view.camera.up, 0, 1, 0);
    check_perspective(&s->view.camera, 40 * PI / 180);
}

/* The share of a white background that corner.obj lets pass, of each color. */
static void test_translucent_mesh(void) {
    static const float passes[3] = {0.5f, 0.25f, 1};
    const int inside = 4 * (2 * 5 + 2);
    check_triangles triangles = {0};
    sps_context *context = check_context(NULL);
    float rgba[4 * 20];
    check_scene s;
    start_corner(&s, &triangles);
    memcpy(s.mesh[0].transmittance, passes, sizeof passes);
    for (int c = 0; c < 3; ++c) s.scene.background[c] = 1;
    check_render(context, &s, rgba);
    for (int c = 0; c < 3; ++c) CHECK_NEAR((double)rgba[inside + c], (double)passes[c], 1e-6); /* round-off */
    check_same_pfm(SMALL "--mesh corner.obj --camera 0.5,1,4,0.5,1,-0.5 --mesh-transmittance 0.5,0.25,1 "
                         "--background 1,1,1 --pfm extent.pfm",
                   rgba);
    check_free_triangles(&triangles);
    sps_destroy(context);
}

#define THICK "--volume two.raw --size 2,2,2 --width 5 --height 4 --extinction 9 --light directional,1,-1,-1,9,9,9 "
#define FEW   "--scattering-resolution 8 --pfm shadow.pfm"

/* By default light scatters as often as the scene calls for; in the reference once if it has no paths, which it says,
   unless another option says so. */
static void test_scattering_option(void) {
    static const complaint all[] = {
        {THICK "--reference --out a.png", 0,
         "--reference without --samples: light scatters once (--scattering single)"},
        {THICK "--shadow samples --out a.png", 0, "--shadow samples without --samples: light scatters once"},
        {THICK "--reference --scattering single --out a.png", 0, NULL},
        {THICK "--reference --scattering forward --out a.png", 0, NULL},
        {THICK "--reference --samples 1 --out a.png", 0, NULL},
        {"--mesh corner.obj --width 5 --height 4 --reference --out a.png", 0, NULL}, /* there is no gas */
        {THICK "--reference --scattering auto --out a.png", 1, "--scattering: view.scattering is SPS_SCATTERING_AUTO"},
        {THICK "--reference --scattering multiple --out a.png", 1, "(--samples N, or --scattering single)"},
        {THICK "--scattering once --plan", 2,
         "--scattering: 'once' is not auto|single|ambient|forward|convolution|multiple"}};
    CHECK_COMPLAINTS(all);
    CHECK(same_shadows(THICK FEW, THICK "--scattering auto " FEW));
    CHECK(same_shadows(THICK FEW, THICK "--scattering multiple " FEW));
    CHECK(!same_shadows(THICK FEW, THICK "--scattering single " FEW));
    CHECK(same_shadows(THICK "--reference " FEW, THICK "--reference --scattering single " FEW));
    CHECK(!same_shadows(THICK "--reference " FEW, THICK "--reference --scattering forward " FEW));
}

#undef THICK
#undef FEW

#define LIT VOLUME "--reference --albedo 1,1,1 --extinction 9 --ambient 1,1,1 "

/* Paths of the reference; 0 of them is none. */
static void test_samples_option(void) {
    static const complaint all[] = {
        {"--reference --samples -1", 2, "--samples: '-1' is out of range: N must be within 0.."},
        {SMALL VOLUME "--samples 2", 2, "--samples says nothing without --reference"},
        {SMALL VOLUME "--sky-turn 2", 2, "--sky-turn says nothing without --sky"},
        {SMALL VOLUME "--sky-scale 2", 2, "--sky-scale says nothing without --sky"},
        {SMALL VOLUME "--sky-samples 2", 2, "--sky-samples says nothing without --sky"},
        {SMALL VOLUME "--sky no.hdr --out a.png", 2, "no.hdr"},
        {SMALL VOLUME "--sky no.ppm --out a.png", 2, "no.ppm"},
        {SMALL VOLUME "--sky no.ppm --sky-samples 513", 2, "must be within 1..512"},
        {SMALL VOLUME "--shadow sheets --samples 2", 2, "--samples says nothing"}};
    CHECK_COMPLAINTS(all);
    CHECK(same_shadows(LIT "--pfm shadow.pfm", LIT "--samples 0 --pfm shadow.pfm"));
    CHECK(!same_shadows(LIT "--pfm shadow.pfm", LIT "--samples 9 --pfm shadow.pfm"));
}

#undef LIT

#define EDGES SMALL "--mesh corner.obj --camera 0.5,1,4,0.5,1,-0.5 --ambient 1,1,1 --pfm extent.pfm "

/* Edges of corner.obj, sampled and not, by both renderers, against the library's pictures; 0 and 1 are the same. */
static void test_coverage_option(void) {
    static const complaint all[] = {{"--coverage 9", 2, "--coverage: '9' is out of range: N must be within 0..8"},
                                    {"--coverage -1", 2, "--coverage: '-1' is out of range: N must be within 0..8"},
                                    {"--coverage 2.5", 2, "--coverage: '2.5' is not N"},
                                    {EDGES "--coverage 8 --plan >sampled", 0, NULL},
                                    {EDGES "--coverage 4 --stats sampled.json", 0, NULL},
                                    {EDGES "--coverage 1 --plan >single", 0, NULL},
                                    {EDGES "--coverage 1 --stats single.json", 0, NULL}};
    check_triangles triangles = {0};
    sps_context *context = check_context(NULL);
    float rgba[4][4 * 20];
    check_scene s;
    start_corner(&s, &triangles);
    for (int c = 0; c < 3; ++c) s.scene.ambient[c] = 1;
    for (int i = 0; i < 4; ++i) {
        const int samples = i & 1 ? 4 : 0, by_reference = i >> 1;
        char line[300];
        s.view.coverage_samples = samples;
        if (by_reference)
            check_march(context, &s, 0.5, rgba[i], NULL);
        else
            check_render(context, &s, rgba[i]);
        snprintf(line, sizeof line, EDGES "%s --coverage %d", by_reference ? "--reference" : "", samples);
        check_same_pfm(line, rgba[i]);
    }
    CHECK(memcmp(rgba[0], rgba[1], sizeof rgba[0]) != 0 && memcmp(rgba[2], rgba[3], sizeof rgba[2]) != 0);
    CHECK(same_shadows(VOLUME "--mesh corner.obj --pfm shadow.pfm",
                       VOLUME "--mesh corner.obj --coverage 1 --pfm shadow.pfm"));
    CHECK_COMPLAINTS(all);
    CHECK(says("sampled", "coverage_samples is set") && says("single", "coverage_samples is not set"));
    CHECK(says("single.json", "\"layers\": 0,") && !says("sampled.json", "\"layers\": 0,"));
    check_free_triangles(&triangles);
    sps_destroy(context);
}

#undef EDGES

/* A disc and a rectangle before the middle of corner.obj (0.5, 1, -0.5), and a sun, against the same lights in the
   library: W lies along x, which is perpendicular to --up and to the way from light to middle, and H along y. */
static void test_extents_as_placed(void) {
    static const char *const options[] = {"--light point,0.5,1,2,9,9,9 --light-size 0.9",
                                          "--light point,0.5,1,2,9,9,9 --light-size 2,0.6",
                                          "--light directional,0,-1,-1,3,3,3 --light-angle 60"};
    check_triangles triangles = {0};
    sps_context *context = check_context(NULL);
    for (int i = 0; i < 3; ++i) {
        char line[300];
        float rgba[4 * 20];
        check_scene s;
        sps_light *light;
        start_corner(&s, &triangles);
        light = i < 2 ? check_add_point(&s, 0.5, 1, 2, 9) : check_add_directional(&s, 0, -1, -1, 3);
        light->samples = 7;
        if (i < 2) light->kind = i == 0 ? SPS_LIGHT_DISC : SPS_LIGHT_RECTANGLE;
        check_set3(light->axes[0], i == 0 ? 0.9 : 1, 0, 0);
        check_set3(light->axes[1], 0, i == 0 ? 0.9 : 0.3, 0);
        if (i == 2) light->angular_diameter = PI / 3;
        check_render(context, &s, rgba);
        snprintf(line, sizeof line,
                 SMALL "--mesh corner.obj --camera 0.5,1,4,0.5,1,-0.5 %s --light-samples 7 --pfm extent.pfm",
                 options[i]);
        check_same_pfm(line, rgba);
    }
    check_free_triangles(&triangles);
    sps_destroy(context);
}

/* A slide of three texels by two, none like another, as a PPM file, in the sRGB curve of its own formula. */
static void write_slide(const char *name, int most) {
    char head[40];
    unsigned char file[100];
    const int length = snprintf(head, sizeof head, "P6\n# three by two\n3 2\n%d\n", most);
    int at = length;
    memcpy(file, head, (size_t)length);
    for (int i = 0; i < 18; ++i) {
        const int code = 37 * i % 256 * (most > 255 ? 257 : 1);
        if (most > 255) file[at++] = (unsigned char)(code >> 8);
        file[at++] = (unsigned char)(code & 255);
    }
    write_file(name, file, (size_t)at);
}

/* sps_projector.sample_fn: the colors of write_slide. */
static int sample_slide(void *user, size_t count, const float *uv, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i)
        for (int c = 0; c < 3; ++c) {
            const int x = (int)(3 * uv[2 * i]), y = (int)(2 * uv[2 * i + 1]);
            const double code = 37 * (3 * (3 * y + x) + c) % 256 / 255.0;
            out[3 * i + (size_t)c] = (float)(code <= 0.04045 ? code / 12.92 : pow((code + 0.055) / 1.055, 2.4));
        }
    return 0;
}

/* A light at (0.5, 1, 2) that throws an image of half a unit on either side of y = 1 at the distance 2.5. */
static sps_light *add_slide(check_scene *s, sps_projector *projector, int kind) {
    sps_light *light = check_add_point(s, 0.5, 1, 2, 9);
    memset(projector, 0, sizeof *projector);
    projector->width = 3, projector->height = 2;
    projector->sample_fn = sample_slide;
    projector->top = tan(0.5 * 50 * PI / 180), projector->bottom = -projector->top;
    projector->right = projector->top * 3 / 2, projector->left = -projector->right;
    check_set3(projector->up, 0, 1, 0);
    check_set3(light->direction, -0.6, 0, -2);
    light->projector = projector;
    if (kind == 0) return light;
    light->kind = kind == 1 ? SPS_LIGHT_DISC : SPS_LIGHT_RECTANGLE;
    light->samples = 7;
    projector->focus = 3;
    check_set3(light->axes[0], (kind == 1 ? 0.4 : 0.5) * 2 / sqrt(4.36), 0,
               (kind == 1 ? 0.4 : 0.5) * -0.6 / sqrt(4.36));
    check_set3(light->axes[1], 0, kind == 1 ? 0.4 : 0.1, 0);
    if (kind == 2) light->falloff = SPS_FALLOFF_NONE;
    return light;
}

/* A projector by options, against the same one in the library: sharp, through a disc, and through a rectangle, whose W
   lies across the direction and --up. The light does not point at the middle of the scene, so that an extent that faced
   it would show. */
static void test_projector_as_placed(void) {
    static const char *const options[] = {"'projector,0.5,1,2,-0.6,0,-2,50,9,9,9,slide, 8.ppm'",
                                          "projector,0.5,1,2,-0.6,0,-2,50,9,9,9,slide16.ppm --light-size 0.4 "
                                          "--light-focus 3 --light-samples 7",
                                          "projector,0.5,1,2,-0.6,0,-2,50,9,9,9,slide16.ppm --light-size 1,0.2 "
                                          "--light-focus 3 --light-samples 7 --light-falloff none"};
    check_triangles triangles = {0};
    sps_context *context = check_context(NULL);
    write_slide("slide, 8.ppm", 255);
    write_slide("slide16.ppm", 65535);
    for (int i = 0; i < 3; ++i) {
        char line[300];
        float rgba[4 * 20];
        sps_projector projector;
        check_scene s;
        start_corner(&s, &triangles);
        add_slide(&s, &projector, i);
        check_render(context, &s, rgba);
        snprintf(line, sizeof line, SMALL "--mesh corner.obj --camera 0.5,1,4,0.5,1,-0.5 --light %s --pfm extent.pfm",
                 options[i]);
        check_same_pfm(line, rgba);
    }
    check_free_triangles(&triangles);
    sps_destroy(context);
}

/* A projector's options and files that are wrong. */
static void test_projector_options(void) {
#define THROW  "--light projector,0,0,5,0,0,-1,30,1,1,1,"
#define THROWN "--light projector,0,0,5,0,0,-1,30,1,1,1,slide16.ppm "
    static const complaint all[] = {
        {VOLUME THROWN "--plan >plan", 0, NULL},
        {VOLUME THROWN "--stats a.json", 0, NULL},
        {VOLUME THROWN "--shadow compressed --out a.png", 0, NULL},
        {"--light projector,0,0,5,0,0,-1,30,1,1,1", 2, "is not directional,dx,dy,dz,r,g,b"},
        {THROW, 2, "is not directional,dx,dy,dz,r,g,b"},
        {"--light projector,0,0,5,0,0,-1,1,1,1,slide16.ppm", 2, "is not directional,dx,dy,dz,r,g,b"},
        {"--light projector,0,0,5,0,0,-1,3x,1,1,1,slide16.ppm", 2, "is not directional,dx,dy,dz,r,g,b"},
        {"--light projector,0,0,1e16,0,0,-1,30,1,1,1,a", 2, "x,y,z must be within"},
        {"--light projector,0,0,5,0,0,-1e16,30,1,1,1,a", 2, "dx,dy,dz must be within"},
        {"--light projector,0,0,5,0,0,0,30,1,1,1,a", 2, "the direction is zero"},
        {"--light projector,0,0,5,0,0,-1,0,1,1,1,a", 2, "angle must be within 0.001..177"},
        {"--light projector,0,0,5,0,0,-1,178,1,1,1,a", 2, "angle must be within 0.001..177"},
        {"--light projector,0,0,5,0,0,-1,30,1,-1,1,a", 2, "r,g,b must be within 0..1e+18"},
        {THROW "no.ppm --plan", 2, "no.ppm: No such file"},
        {THROW ". --plan", 2, ".: not a regular file"},
        {THROW "two.raw --plan", 2, "two.raw: not a binary PPM file ('P6')"},
        {THROW "cut.ppm --plan", 2, "cut.ppm: the file ends amid its pixels"},
        {THROW "p3.ppm --plan", 2, "p3.ppm: not a binary PPM file ('P6')"},
        {THROW "zero.ppm --plan", 2, "zero.ppm: 0 x 2 pixels; there may be 1..4096 on a side"},
        {THROW "wide.ppm --plan", 2, "wide.ppm: 4097 x 1 pixels; there may be 1..4096 on a side"},
        {THROW "most.ppm --plan", 2, "most.ppm: not a binary PPM file ('P6')"},
        {THROWN "--out slide16.ppm", 2, "--out slide16.ppm is a file that --light reads"},
        {SMALL VOLUME "--sky slide16.ppm --out slide16.ppm", 2, "--out slide16.ppm is a file that --sky reads"},
        {THROWN "--light-focus 3 --plan", 2,
         "--light-focus says nothing about --light projector,0,0,5,0,0,-1,30,1,1,1,"
         "slide16.ppm, which has no --light-size"},
        {"--light point,0,0,5,1,1,1 --light-size 1 --light-focus 3 --plan", 2,
         "--light-focus says nothing about --light point,0,0,5,1,1,1, which is not a projector"},
        {"--light-focus 0", 2, "--light-focus: '0' is out of range: D must be within 1e-15..1e+15"},
        {"--light-focus 1 --plan", 2, "--light-focus: there is no --light that it could be about"},
        {THROWN "--light-angle 3 --plan", 2, "give --light-size"},
        {THROWN "--light-size 1 --shadow deep --plan", 2, "exclude each other: a map holds the shadow of a point"},
        {"--light projector,0,0,5,1,2,3,30,1,1,1,slide16.ppm --light-size 1e15 --light-focus 1e-15 --plan", 2,
         "--light-focus: light[0].projector.focus is 1e-15; it must be 0, or within 1e15 and beyond the extent"},
        {"--light-falloff linear", 2, "--light-falloff: 'linear' is not inverse-square|none"},
        {"--light directional,0,0,1,1,1,1 --light-falloff none --plan", 2,
         "--light-falloff says nothing about --light directional,0,0,1,1,1,1: it has no position"},
        {VOLUME "--light point,3,4,2,1,1,1 --light-falloff inverse-square --pfm near.pfm", 0, NULL},
        {VOLUME "--light point,3,4,2,1,1,1 --pfm hard.pfm", 0, NULL}};
    char text[4000], other[400];
    write_file("cut.ppm", "P6 3 2 255 12345678901234567", 28);
    write_file("p3.ppm", "P3 1 1 255 1 1 1", 16);
    write_file("zero.ppm", "P6 0 2 255 ", 11);
    write_file("wide.ppm", "P6 4097 1 255 ", 14);
    write_file("most.ppm", "P6 1 1 70000 123456", 19);
    CHECK_COMPLAINTS(all);
    CHECK(read_file("plan", text, sizeof text) > 60 && strstr(text, "projector_calls  2\n"));
    CHECK(read_file("a.json", text, sizeof text) > 60 && strstr(text, "\"projector_calls\": 2,"));
    CHECK(read_file("near.pfm", text, sizeof text) == read_file("hard.pfm", other, sizeof other));
    CHECK(memcmp(text, other, 12 + 4 * 3 * 20) == 0);
#undef THROW
#undef THROWN
}

/* Each extent makes a picture of its own, one of 0 that of a light without; what has no effect is a mistake. */
static void test_light_options(void) {
    enum { EXTENTS = 9, HARD = 2 };
    static const char *const extents[EXTENTS] = {"--light point,3,4,2,90,90,90",
                                                 "--light directional,-1,-1,-1,9,9,9",
                                                 "--light point,3,4,2,90,90,90 --light-size 1",
                                                 "--light-size 2,0.5 --light point,3,4,2,90,90,90",
                                                 "--light point,3,4,2,90,90,90 --light-size 0.5,2",
                                                 "--light point,3,4,2,90,90,90 --light-size 1 --light-samples 5",
                                                 "--light directional,-1,-1,-1,9,9,9 --light-angle 20",
                                                 "--light directional,-1,-1,-1,9,9,9 --light-angle 20 --quality high",
                                                 "--light point,3,4,2,90,90,90 --light-size 1 --light "
                                                 "directional,-1,-1,-1,9,9,9 --light-angle 20"};
    static const complaint all[] = {
        {VOLUME "--light point,3,4,2,9,9,9 --light-size 0,0 --light-samples 256 --pfm point.pfm", 0, NULL},
        {VOLUME "--light point,3,4,2,9,9,9 --pfm hard.pfm", 0, NULL},
        {VOLUME "--light point,.5,.5,.5,1,1,1 --light-size 1 --light-samples 3 --reference --out a.png", 0, NULL},
        {VOLUME "--light point,.5,.5,.5,1,1,1 --light-size 1 --no-shadows --out a.png", 0, NULL},
        {VOLUME "--light point,3,4,2,1,1,1 --light-size 1 --light-samples 3 --plan >plan", 0, NULL},
        {VOLUME "--light directional,0,0,-1,1,1,1 --light-angle 0 --out a.png", 0, NULL},
        {VOLUME "--light spot,3,4,2,-3,-4,-2,5,20,90,90,90 --light-size .2 --light-samples 3 --out a.png", 0, NULL},
        {"--light spot,1,2,3,0,0,0,5,20,1,1,1", 2, "the direction is zero"},
        {"--light spot,1,2,3,0,0,1,20,5,1,1,1", 2, "the inner angle must be less than the outer"},
        {"--light spot,1,2,3,0,0,1,5,200,1,1,1", 2, "inner,outer must be within 0..180"},
        {"--light spot,1,2,3,0,0,1e16,5,20,1,1,1", 2, "dx,dy,dz must be within"},
        {"--light spot,1,2,3,0,0,1,1,1,1", 2, "is not directional,dx,dy,dz,r,g,b"},
        {"--light-size 1 --plan", 2, "--light-size: there is no --light that it could be about"},
        {"--light-size -1", 2, "--light-size: '-1' is out of range: R | W,H must be within 0..1e+15"},
        {"--light-size 1,-1", 2, "--light-size: '1,-1' is out of range"},
        {"--light-size wide", 2, "--light-size: 'wide' is not R | W,H"},
        {"--light-size 1,2,3", 2, "--light-size: '1,2,3' is not R | W,H"},
        {"--light-size nan", 2, "--light-size: 'nan' is not R | W,H"},
        {"--light-angle -1", 2, "--light-angle: '-1' is out of range: DEG must be within 0..114"},
        {"--light-angle 115", 2, "--light-angle: '115' is out of range"},
        {"--light-angle 1,1", 2, "--light-angle: '1,1' is not DEG"},
        {"--light-samples 0", 2, "--light-samples: '0' is out of range: K must be within 1..256"},
        {"--light-samples 257", 2, "--light-samples: '257' is out of range"},
        {"--light-samples 1.5", 2, "--light-samples: '1.5' is not K"},
        {"--light directional,0,0,1,1,1,1 --light-size 1 --plan", 2,
         "--light-size says nothing about --light directional,0,0,1,1,1,1: give --light-angle"},
        {"--light point,0,0,1,1,1,1 --light-angle 1 --plan", 2,
         "--light-angle says nothing about --light point,0,0,1,1,1,1: give --light-size"},
        {"--light point,0,0,1,1,1,1 --light-samples 9 --plan", 2,
         "--light-samples says nothing about --light point,0,0,1,1,1,1, which has no --light-size"},
        {"--light directional,0,0,1,1,1,1 --light-samples 9 --plan", 2, "which has no --light-angle"},
        {"--light point,0,0,1,1,1,1 --light directional,0,0,1,1,1,1 --light-size 1 --plan", 2,
         "--light-size says nothing about --light directional,0,0,1,1,1,1"},
        {VOLUME "--light point,9,9,9,1,1,1 --light-size 1 --shadow deep --plan", 2,
         "--light-size of --light point,9,9,9,1,1,1 and --shadow deep exclude each other: a map holds the shadow"},
        {VOLUME "--shadow beer --map-resolution 9 --light directional,0,0,1,1,1,1 --light-angle 1 --plan", 2,
         "--light-angle of --light directional,0,0,1,1,1,1 and --shadow beer exclude each other"},
        {VOLUME "--light point,.5,.5,.5,1,1,1 --light-size 1 --out a.png", 0, NULL},
        {VOLUME "--light point,.5,.5,.5,1,1,1 --light-size 1 --shadow sheets --out a.png", 1,
         "--light point,.5,.5,.5,1,1,1: light[0]"},
        {VOLUME "--light point,.5,.5,.5,1,1,1 --light-size 1 --shadow sheets --out a.png", 1,
         "no_shadow on it (--shadow auto, --no-shadows and --reference have no such limit)"}};
    static char pictures[EXTENTS][400];
    char text[4000], other[400];
    for (int i = 0; i < EXTENTS; ++i) {
        char line[400];
        snprintf(line, sizeof line, VOLUME "--mesh corner.obj --extinction 15 %s --pfm extent.pfm --stats a.json",
                 extents[i]);
        CHECK(run_render(line).status == 0);
        CHECK(read_file("extent.pfm", pictures[i], sizeof pictures[i]) > 12);
        CHECK(read_file("a.json", text, sizeof text) > 12);
        CHECK((strstr(text, "\"soft_texels\": 0,") != NULL) == (i < HARD));
        for (int k = 0; k < i; ++k)
            if (!CHECK(memcmp(pictures[k], pictures[i], sizeof pictures[i]) != 0))
                printf("    %s and %s give one picture\n", extents[k], extents[i]);
    }
    CHECK_COMPLAINTS(all);
    CHECK(read_file("plan", text, sizeof text) > 60 && strstr(text, "light_points     3\n"));
    CHECK(read_file("point.pfm", text, sizeof text) == read_file("hard.pfm", other, sizeof other));
    CHECK(memcmp(text, other, 12 + 4 * 3 * 20) == 0);
    test_extents_as_placed();
    test_projector_as_placed();
    test_projector_options();
}

#define WIDE "--camera .5,.5,.5,.5,.5,0 --fov 170 --light directional,1,0,0.1,1,1,1 "

/* Errors that only the library detects name the option. */
static void test_library_errors(void) {
    static const complaint library[] = {
        {VOLUME "--slab-thickness 1e-6 --out a.png", 2,
         "--slab-thickness: view.slab_thickness is 1e-06; it makes more than 2^20 slabs"},
        {VOLUME "--slab-thickness 1e-6 --plan", 2, "--slab-thickness: view.slab_thickness is 1e-06"},
        {VOLUME "--box -1e15,0,0,1e15,1,1 --camera 1,2,3,0,0,0 --out a.png", 2, "--box of two.raw: "},
        {VOLUME "--box -1e15,0,0,1e15,1,1 --out a.png", 2, "--camera (not given, so that all of the scene is in view)"},
        {VOLUME "--ortho 1e-15 --camera 1e15,0,0,0,0,0 --out a.png", 1,
         "--box of two.raw: volume[0].placement's voxel edge"},
        {"--volume nan.raw --type f32 --size 1,1,1 " SMALL "--out a.png", 2, "--volume nan.raw: volume[0].value is "},
        {"--volume nan.raw --type f32 --size 1,1,1 " SMALL "--out a.png", 2, "(--replace-invalid makes it 0)"},
        {"--volume nan.raw --type f32 --size 1,1,1 --replace-invalid " SMALL "--out a.png", 0, NULL},
        {"--particles nan.f32 --replace-invalid " SMALL "--out a.png", 0, NULL},
        {VOLUME "--max-bytes 7 --plan", 2,
         "two.raw: size 2,2,2 and type u8 take 8 bytes in memory; --max-bytes allows 7"},
        {VOLUME "--max-bytes 8 --plan >plan", 0, NULL},
        {VOLUME "--max-bytes x --plan", 2, "--max-bytes: 'x' is not N"},
        {VOLUME "--max-bytes 0.5 --plan", 2, "--max-bytes: '0.5' is out of range"},
        {VOLUME INSIDE "--shadow sheets --out a.png", 1, "--light point,0.5,0.5,0.5,1,1,1: light[0]"},
        {VOLUME INSIDE "--shadow sheets --out a.png", 1, "(--shadow auto, --no-shadows and --reference have no such"},
        {VOLUME INSIDE "--out a.png", 0, NULL},
        {VOLUME WIDE "--shadow sheets --out a.png", 1, "--fov: view.camera.field_of_view is 2.96706: one of"},
        {VOLUME WIDE "--shadow sheets --out a.png", 1, "(--no-shadows and --reference have no such limit)"},
        {VOLUME WIDE "--out a.png", 0, NULL},
        {"--particles nan.f32 " SMALL "--out a.png", 2, "--particles nan.f32: particles[0].particle[0].radius is nan"},
        {VOLUME "--light point,0.5,0.5,0.5,1,1,1 --no-shadows --out a.png", 0, NULL}};
    const float not_a_number = (float)sqrt(-1.0), none[5] = {0, 0, 0, not_a_number, 1};
    write_file("nan.raw", &not_a_number, sizeof not_a_number);
    write_file("nan.f32", none, sizeof none);
    CHECK_COMPLAINTS(library);
}

/* Errors name the file and the line in it, without control characters. */
static void test_bad_files(void) {
    static const complaint bad[] = {
        {"--mesh far.obj --plan", 2, "far.obj:2: a number that is not within 1e15: 'v 1e30 0 0'"},
        {"--mesh nan.obj --plan", 2, "nan.obj:1: a number that is not within 1e15: 'v nan 0 0'"},
        {"--mesh index.obj --plan", 2, "index.obj:4: not a face, or an index that is not there: 'f 1 2 4'"},
        {"--mesh binary --plan", 2, "binary: no faces"},
        {"--mesh missing.obj --plan", 2, "missing.obj: No such file"},
        {"--mesh . --plan", 2, ".: not a regular file"},
        {"--particles two.raw --plan", 2, "two.raw: the file holds 8 bytes, which is no multiple of a particle's 20"},
        {"--particles missing.f32 --plan", 2, "missing.f32: No such file"},
        {"--volume two.raw --size 3,2,2 --plan", 2, "two.raw: the file holds 8 bytes, but size 3,2,2 and type u8"},
        {"--volume two.raw --size 2,2,2 --type u16 --plan", 2, "the file holds 8 bytes"},
        {"--volume \"$(printf 'a\\033[2Jb\\nc')\" --size 1,1,1 --plan", 2, "a?[2Jb?c: No such file"},
        {VOLUME "--transfer binary --plan", 2,
         "binary:1: not `value r g b extinction [r g b]`, or out of range: '"
         "?"
         "?"
         "[31mA?"},
        {VOLUME "--transfer long.txt --plan", 2, "'aaaaaaaaaaaa"},
        {VOLUME "--transfer falling.txt --plan", 2, "falling.txt:2: values must rise from line to line"},
        {VOLUME "--transfer empty.txt --plan", 2, "empty.txt: no lines with values"},
        {VOLUME "--transfer bytes.txt --plan >plan", 2,
         "bytes.txt: a line's value is 80, and there are lines beyond it"},
        {VOLUME "--transfer over.txt --plan >plan", 0, NULL},
        {VOLUME "--transfer marked.txt --mesh marked.obj --plan >plan", 0, NULL},
        {"--volume no --size 1,1,1 --out $(printf '%0300d' 7)", 2, "7: cannot be written: "}};
    static const char bytes[] = "0 1 1 1 0\n80 1 1 1 0\n255 1 1 1 9\n", over[] = "0.5 1 1 1 0\n1 1 1 1 5\n2 1 1 1 6\n";
    static const char marked[] = "\xef\xbb\xbf"
                                 "0 1 1 1 0\r\n1 1 1 1 5\r\n";
    static const char marked_mesh[] = "\xef\xbb\xbfv 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nf 1 2 3\r\n";
    static const char far[] = "v 0 0 0\nv 1e30 0 0\nv 0 1 0\nf 1 2 3\n", nan[] = "v nan 0 0\n";
    static const char index[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", falling[] = "1 1 1 1 1\n0 1 1 1 1\n";
    char line[3000];
    memset(line, 'a', sizeof line);
    write_file("far.obj", far, strlen(far));
    write_file("nan.obj", nan, strlen(nan));
    write_file("index.obj", index, strlen(index));
    write_file("binary", "\x90\033[31mA\x07\xff\0\1\n\2", 12);
    write_file("long.txt", line, sizeof line);
    write_file("falling.txt", falling, strlen(falling));
    write_file("empty.txt", "", 0);
    write_file("bytes.txt", bytes, strlen(bytes));
    write_file("over.txt", over, strlen(over));
    write_file("marked.txt", marked, strlen(marked));
    write_file("marked.obj", marked_mesh, strlen(marked_mesh));
    CHECK_COMPLAINTS(bad);
    CHECK(strlen(run_render(VOLUME "--transfer long.txt --plan").said) < 160);
}

/* Input files are not overwritten, and no file is written twice. */
static void test_precious_files(void) {
    static const complaint slips[] = {
        {"--mesh corner.obj " SMALL "--out corner.obj", 2, "--out corner.obj is a file that --mesh reads"},
        {VOLUME "--pfm ./two.raw", 2, "--pfm ./two.raw is a file that --volume reads"},
        {VOLUME "--transfer look.txt --stats link.txt", 2, "--stats link.txt is a file that --transfer reads"},
        {VOLUME "--out same --stats same", 2, "--out and --stats are the same file: same"},
        {VOLUME "--pfm a.pfm --alpha-pfm ./a.pfm", 2, "--pfm and --alpha-pfm are the same file: ./a.pfm"},
        {VOLUME "--out /dev/null --pfm /dev/null", 0, NULL},
        {"--mesh corner.obj --out corner.obj --plan >plan", 0, NULL}};
    static const char name[] = "/link.txt";
    char path[200];
    snprintf(path, sizeof path, "%s%s", folder, name);
    CHECK(symlink("look.txt", path) == 0);
    write_file("a.pfm", "", 0);
    CHECK_COMPLAINTS(slips);
}

/* Every option is in the help, by its usual name. */
static void test_help(void) {
    static const char *const words[] = {"--look FILE",
                                        "--volume FILE",
                                        "--size X,Y,Z",
                                        "--type u8|i8|u16|i16|u32|i32|f32|f64|u64|i64|f16",
                                        "--range LOW,HIGH",
                                        "--box x0,y0,z0,x1,y1,z1",
                                        "--crop i0,j0,k0,i1,j1,k1",
                                        "--extinction S",
                                        "--albedo r,g,b",
                                        "--emission r,g,b",
                                        "--phase g[,g2,w]",
                                        "--transfer FILE",
                                        "--transfer-point value,r,g,b,extinction[,r,g,b]",
                                        "--shading gas|surface",
                                        "--mesh FILE.obj",
                                        "--mesh-color r,g,b",
                                        "--mesh-transmittance r,g,b",
                                        "--camera px,py,pz,tx,ty,tz",
                                        "--up x,y,z",
                                        "default 0,1,0",
                                        "--fov DEG",
                                        "--ortho HEIGHT",
                                        "--light directional,dx,dy,dz,r,g,b | point,x,y,z,r,g,b",
                                        "projector,x,y,z,dx,dy,dz,angle,r,g,b,FILE.ppm\n",
                                        "--light-size R | W,H",
                                        "--light-angle DEG",
                                        "--light-samples K",
                                        "--light-focus D",
                                        "--light-falloff inverse-square|none",
                                        "--ambient r,g,b",
                                        "--background r,g,b",
                                        "--width W",
                                        "--height H",
                                        "--region x,y,w,h",
                                        "--coverage N",
                                        "--slab-thickness VOXELS",
                                        "--shadow-resolution N",
                                        "--shadow auto|sheets|deep|compressed|opacity|deep-opacity|fourier|"
                                        "moment|beer|table|samples|none",
                                        "--map-components N",
                                        "--map-resolution N",
                                        "--table-size N",
                                        "--map-epsilon E",
                                        "--map-cubic",
                                        "--map-texel-range",
                                        "--quality draft|medium|high|ultra",
                                        "--no-shadows",
                                        "--reference",
                                        "--samples N",
                                        "--scattering auto|single|ambient|forward|convolution|multiple",
                                        "--threads N",
                                        "--out FILE.png",
                                        "--pfm FILE.pfm",
                                        "--alpha-pfm FILE.pfm",
                                        "--stats FILE.json",
                                        "--plan",
                                        "required",
                                        "\nVolumes. ",
                                        "\nMeshes, ",
                                        "\nView.",
                                        "\nLight. ",
                                        "\nRendering.",
                                        "\nResults. ",
                                        "--volume before them"};
    static char help[12000];
    CHECK(run_render("--help >help").status == 0);
    CHECK(read_file("help", help, sizeof help) > 1000);
    for (size_t i = 0; i < sizeof words / sizeof *words; ++i)
        if (!CHECK(strstr(help, words[i]) != NULL)) printf("    no '%s' in --help\n", words[i]);
    CHECK(!strstr(help, "usual") && !strstr(help, "needed") && !strstr(help, "latest"));
    for (char *line = strtok(help, "\n"); line; line = strtok(NULL, "\n")) CHECK(strlen(line) <= 120);
}

static void test_command_line(void) {
    static const unsigned char two[8] = {0, 50, 100, 150, 200, 250, 30, 90};
    static const char look[] = "# value r g b extinction\n0.1 0.9 0.5 0.2 0\n1 0.9 0.5 0.2 8 # dense\n";
    static const char corner[] = "v -1 0 0\nv 2 0 0\nv 0 2 -1\nf 1 2 3\n";
    if (!render_is_built() || !folder_begin()) {
        printf("skipped: the command line: run this in the top folder, after make build/tests/render\n");
        return;
    }
    write_file("two.raw", two, sizeof two);
    write_file("corner.obj", corner, strlen(corner));
    write_file("look.txt", look, strlen(look));
    test_full_disk();
    test_files_written();
    test_any_order();
    test_owners();
    test_looks();
    test_exclusions();
    test_bad_values();
    test_particles_option();
    test_shadow_option();
    test_table_option();
    test_light_options();
    test_translucent_mesh();
    test_coverage_option();
    test_samples_option();
    test_scattering_option();
    test_library_errors();
    test_bad_files();
    test_precious_files();
    test_help();
    folder_end();
}

int main(void) {
    if (!check_memory_only()) test_command_line(); /* which is no program with sanitizers */
    return check_report();
}
