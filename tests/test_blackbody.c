/* The color of black bodies, examples/blackbody.h, and volumes of temperatures on the command line. */

#include "check.h"
#include "blackbody.h"
#include "command_line.h"

static const double second_constant = 1.438776877e7; /* nanometers times kelvin */

/* Its maximum is where Wien's displacement law says; its integral over all wavelengths is (T / c2)^4 pi^4 / 15; where
   wavelengths are long it is T / (c2 wavelength^4), where they are short exp(-c2 / (wavelength T)) / wavelength^5. */
static void test_planck(void) {
    for (int i = 0; i < 6; ++i) {
        const double kelvin = 500 * pow(2, i), top = 2.897771955e6 / kelvin;
        double sum = 0;
        CHECK(ex_planck(top, kelvin) > ex_planck(1.001 * top, kelvin));
        CHECK(ex_planck(top, kelvin) > ex_planck(0.999 * top, kelvin));
        for (double u = -4; u < 8; u += 0.01) sum += 0.01 * top * exp(u) * ex_planck(top * exp(u), kelvin);
        /* The trapezoidal rule is exact to rounding here; beyond e^8 wavelengths of the maximum lies 15 / (3 pi^4) of
           (5 e^-8)^3. */
        CHECK_NEAR(sum / (pow(kelvin / second_constant, 4) * pow(PI, 4) / 15), 1, 1e-8);
    }
    CHECK_NEAR(ex_planck(500, 1e12) * second_constant * pow(500, 4) / 1e12, 1, 1e-7);
    CHECK_NEAR(ex_planck(400, 1000) / ex_planck(700, 1000) * pow(4. / 7, 5),
               exp(second_constant / 1e3 * (1 / 700. - 1 / 400.)), 1e-12);
}

/* The table adds up to the published sums, and both ends are dark. */
static void test_observer(void) {
    static const double wanted[3] = {10.6836, 10.6856, 10.6770};
    for (int c = 0; c < 3; ++c) {
        double sum = 0;
        for (int i = 0; i < EX_OBSERVER_COUNT; ++i) {
            sum += ex_observer[i][c];
            CHECK(ex_observer[i][c] >= 0 && ex_observer[i][c] < 1.8);
        }
        CHECK_NEAR(sum, wanted[c], 1e-9);
    }
    CHECK(ex_observer[17][1] == 0.9950 && ex_observer[18][1] == 0.9950 && ex_observer[7][2] == 1.7721);
}

/* x, y of sums over every wavelength of the table, or every second. Also the standard deviation that rounding the table
   to four digits gives them: each number is off by up to 5e-5, evenly, which is 5e-5 / sqrt(3). */
static double chromaticity(double kelvin, int step, double out[2]) {
    double sums[3] = {0, 0, 0}, squares = 0;
    for (int i = 0; i < EX_OBSERVER_COUNT; i += step) {
        const double power = ex_planck(380 + 10 * i, kelvin);
        squares += power * power;
        for (int c = 0; c < 3; ++c) sums[c] += power * ex_observer[i][c];
    }
    const double sum = sums[0] + sums[1] + sums[2];
    out[0] = sums[0] / sum, out[1] = sums[1] / sum;
    return 5e-5 / sqrt(3) * sqrt(squares) / sum;
}

/* Published chromaticities, rounded to four digits. The sum differs from an integral by less than the sum over every
   second wavelength differs from it. */
static void test_chromaticities(void) {
    static const double exact[][3] = {{1000, 0.6528, 0.3444},
                                      {2000, 0.5267, 0.4133},
                                      {3000, 0.4369, 0.4041},
                                      {6500, 0.3135, 0.3237},
                                      {10000, 0.2807, 0.2884}};
    for (int i = 0; i < 5; ++i) {
        double xyz[3], fine[2], coarse[2];
        const double deviation = chromaticity(exact[i][0], 1, fine);
        chromaticity(exact[i][0], 2, coarse);
        ex_blackbody_xyz(exact[i][0], xyz);
        for (int c = 0; c < 2; ++c) {
            const double tolerance = 5e-5 + 4 * deviation + fabs(fine[c] - coarse[c]),
                         found = xyz[c] / (xyz[0] + xyz[1] + xyz[2]);
            if (!CHECK_NEAR(found, exact[i][1 + c], tolerance) || figures())
                printf("%5.0f K: %c %.5f, published %.4f, allowed %.5f\n", exact[i][0], 'x' + c, found, exact[i][1 + c],
                       tolerance);
            CHECK(tolerance < 1.5e-3);
        }
    }
}

/* The colors of Rec. 709's primaries for a chromaticity, by Cramer's rule: columns are the primaries' X, Y, Z, scaled
   so that their sum is white. */
static void solve(double columns[3][3], const double right[3], double out[3]) {
    const double whole = vec_determinant(columns[0], columns[1], columns[2]);
    out[0] = vec_determinant(right, columns[1], columns[2]) / whole;
    out[1] = vec_determinant(columns[0], right, columns[2]) / whole;
    out[2] = vec_determinant(columns[0], columns[1], right) / whole;
}

static void rec_709(const double xyz[3], double out[3]) {
    static const double places[4][2] = {{0.64, 0.33}, {0.30, 0.60}, {0.15, 0.06}, {0.3127, 0.3290}};
    double columns[4][3], scale[3];
    for (int i = 0; i < 4; ++i) {
        columns[i][0] = places[i][0] / places[i][1], columns[i][1] = 1;
        columns[i][2] = (1 - places[i][0] - places[i][1]) / places[i][1];
    }
    solve(columns, columns[3], scale);
    for (int i = 0; i < 3; ++i)
        for (int c = 0; c < 3; ++c) columns[i][c] *= scale[i];
    solve(columns, xyz, out);
}

/* Where no component is negative, colors are those that the primaries and white give: to 5e-4, since the matrix has
   white as 0.95047, 1, 1.08883, which is 0.31273, 0.32902. Luminance is 1 at any temperature. */
static void test_colors(void) {
    double before = 10, color[3], xyz[3], exact[3];
    for (double kelvin = 1; kelvin < 1e6; kelvin *= 1.1) {
        ex_blackbody_color(kelvin, color);
        CHECK_NEAR(0.2126 * color[0] + 0.7152 * color[1] + 0.0722 * color[2], 1, 1e-12);
        CHECK(color[0] > 0 && color[1] >= 0 && color[2] >= 0 && color[0] <= before + 1e-12);
        before = color[0];
        if (kelvin < 2000) continue;
        ex_blackbody_xyz(kelvin, xyz);
        rec_709(xyz, exact);
        for (int c = 0; c < 3; ++c) CHECK_NEAR(color[c], exact[c] / xyz[1], 5e-4 * fmax(1, exact[c] / xyz[1]));
    }
    ex_blackbody_color(1000, color);
    CHECK(color[2] == 0 && color[1] > 0 && color[1] < 0.06 && color[0] > 4);
    ex_blackbody_color(2000, color);
    CHECK(color[2] > 0 && color[2] < 0.05);
    ex_blackbody_color(0, color);
    ex_blackbody_color(500, exact);
    CHECK(memcmp(color, exact, sizeof color) == 0);
}

static void test_points(void) {
    sps_transfer_point points[EX_TEMPERATURE_POINTS];
    double color[3];
    ex_temperature_points(1500, 3, 2, points);
    for (int i = 0; i < EX_TEMPERATURE_POINTS; ++i) {
        const double value = i / 128.0;
        ex_blackbody_color(1500 * value, color);
        CHECK((double)points[i].value == value && points[i].extinction == 0 && points[i].albedo[1] == 0);
        for (int c = 0; c < 3; ++c)
            CHECK_NEAR((double)points[i].emission[c], 3 * pow(value, 4) * color[c], 1e-6 * 48 * color[c]);
    }
    CHECK(points[0].emission[0] == 0);
    ex_temperature_points(1e6, 1e18, 4, points);
    CHECK(points[256].emission[0] == 1e18f);
}

/* -------------------------------------------------------------------------------------------------- the command line
 */

/* Radiance along the axis of a cube of 2 with 12^3 voxels of this value: they are Gaussians of 0.65 voxels.
   Temperatures that the transfer function does not reach count as its last. */
static void cube_radiance(double value, double kelvin, double intensity, double out[3]) {
    const double voxel = 2.0 / 12, width = 0.65 * sqrt(2.0), step = 0.01;
    memset(out, 0, 3 * sizeof *out);
    for (double z = -9; z < 9; z += step) {
        double here = 0, color[3], across = 0;
        for (int i = 0; i < 12; ++i)
            here += exp(-pow((z - i + 5.5) / width, 2)), across += exp(-pow((i - 5.5) / width, 2));
        here *= value * across * across / pow(width * sqrt(PI), 3);
        here = fmin(here, fmin(value, 4));
        ex_blackbody_color(here * kelvin, color);
        for (int c = 0; c < 3; ++c) out[c] += step * voxel * intensity * pow(here, 4) * color[c];
    }
}

#define CUBE                                                                                                           \
    "--volume cube.raw --type f32 --size 12,12,12 --box -1,-1,-1,1,1,1 --ortho 0.02 --width 1 --height 1 --camera "    \
    "0,0,5,0,0,0 "
#define THROUGH "--scattering single --reference --slab-thickness 0.1 --pfm glow.pfm "

static void fill_cube(float value) {
    float voxels[12 * 12 * 12];
    for (int i = 0; i < 12 * 12 * 12; ++i) voxels[i] = value;
    write_file("cube.raw", voxels, sizeof voxels);
}

static int read_glow(float glow[3]) {
    char data[40];
    const int size = read_file("glow.pfm", data, sizeof data);
    if (size > 12) memcpy(glow, data + size - 12, 12);
    return CHECK(size == 24);
}

/* The march has steps of 0.1 voxels, of second order in them: at an edge, a Gaussian's fourth power is as wide as 0.33
   voxels, and the error (0.1 / 0.33)^2 / 24 of an edge's light. Points in between are straight, within 4e-4. */
static void test_glowing_cube(void) {
    static const float values[] = {1, 0.7f, 2.5f, 4};
    for (int i = 0; i < 4; ++i) {
        const complaint all[] = {{CUBE THROUGH "--temperature 1800,0.25", 0, NULL}};
        float glow[3] = {0};
        double exact[3];
        fill_cube(values[i]);
        CHECK_COMPLAINTS(all);
        if (!read_glow(glow)) continue;
        cube_radiance((double)values[i], 1800, 0.25, exact);
        for (int c = 0; c < 3; ++c) {
            CHECK_NEAR((double)glow[c], exact[c], 2e-3 * exact[c] + 1e-6);
            if (figures()) printf("value %g: %g, exact %g\n", (double)values[i], (double)glow[c], exact[c]);
        }
    }
}

/* Beyond four times the temperature, all is as at four times; integers are 0..1. */
static void test_ranges(void) {
    static const complaint hot[] = {{CUBE THROUGH "--temperature 500,1e-3", 0, NULL}};
    static const complaint bytes[] = {
        {"--volume bytes.raw --size 4,4,4 --temperature 3000,1 --width 4 --height 4 --scattering single --pfm b.pfm", 0,
         NULL}};
    float glow[3] = {0};
    double color[3];
    fill_cube(40);
    CHECK_COMPLAINTS(hot);
    ex_blackbody_color(2000, color);
    if (read_glow(glow))
        for (int c = 0; c < 3; ++c)
            CHECK((double)glow[c] > 1.9 * 0.256 * color[c] && (double)glow[c] < 3 * 0.256 * color[c]);
    fill_cube(0);
    CHECK_COMPLAINTS(hot);
    CHECK(read_glow(glow) && glow[0] == 0);
    write_file("bytes.raw", "0123456789abcdefghijklmnopqrstuvwxyz0123456789abcdefghijklmnopqr", 64);
    CHECK_COMPLAINTS(bytes);
}

static void test_refusals(void) {
    static const complaint wrong[] = {
        {CUBE "--plan --temperature 1500", 2, "'1500' is not KELVIN,INTENSITY"},
        {CUBE "--plan --temperature 1500,1,2", 2, "is not KELVIN,INTENSITY"},
        {CUBE "--plan --temperature 0,1", 2, "KELVIN must be within 1..1e+06"},
        {CUBE "--plan --temperature 1500,-1", 2, "out of range"},
        {CUBE "--plan --temperature 1500,1 --transfer-point 1,1,1,1,1", 2,
         "--transfer-point and --temperature of cube.raw"},
        {CUBE "--plan --temperature 1500,1 --transfer t.txt", 2, "--transfer and --temperature"},
        {CUBE "--plan --temperature 1500,1 --extinction 2", 2, "--extinction and --temperature"},
        {CUBE "--plan --temperature 1500,1 --phase 0.5", 2, "--phase and --temperature"},
        {CUBE "--plan --temperature 1500,1 --shading surface", 2, "--shading surface and --temperature"}};
    CHECK_COMPLAINTS(wrong);
}

int main(void) {
    RUN(test_planck);
    RUN(test_observer);
    RUN(test_chromaticities);
    RUN(test_colors);
    RUN(test_points);
    if (!render_is_built()) {
        printf("skipped: the command line: there is no build/tests/render\n");
    } else if (CHECK(folder_begin())) {
        RUN(test_glowing_cube);
        RUN(test_ranges);
        RUN(test_refusals);
        folder_end();
    }
    return check_report();
}
