/* blackbody.h: the color of a black body by its temperature, and transfer functions for volumes of temperatures. It
   integrates Planck's law with the CIE 1931 2-degree observer (CIE 15, color matching functions every 10 nm), in linear
   Rec. 709. */

#ifndef EX_BLACKBODY_H
#define EX_BLACKBODY_H

#include "vectors.h"

enum { EX_OBSERVER_FIRST = 380, EX_OBSERVER_STEP = 10, EX_OBSERVER_COUNT = 40 }; /* nanometers */

static const double ex_observer[EX_OBSERVER_COUNT][3] = {
    {0.0014, 0, 0.0065},      {0.0042, 0.0001, 0.0201}, {0.0143, 0.0004, 0.0679}, {0.0435, 0.0012, 0.2074},
    {0.1344, 0.0040, 0.6456}, {0.2839, 0.0116, 1.3856}, {0.3483, 0.0230, 1.7471}, {0.3362, 0.0380, 1.7721},
    {0.2908, 0.0600, 1.6692}, {0.1954, 0.0910, 1.2876}, {0.0956, 0.1390, 0.8130}, {0.0320, 0.2080, 0.4652},
    {0.0049, 0.3230, 0.2720}, {0.0093, 0.5030, 0.1582}, {0.0633, 0.7100, 0.0782}, {0.1655, 0.8620, 0.0422},
    {0.2904, 0.9540, 0.0203}, {0.4334, 0.9950, 0.0087}, {0.5945, 0.9950, 0.0039}, {0.7621, 0.9520, 0.0021},
    {0.9163, 0.8700, 0.0017}, {1.0263, 0.7570, 0.0011}, {1.0622, 0.6310, 0.0008}, {1.0026, 0.5030, 0.0003},
    {0.8544, 0.3810, 0.0002}, {0.6424, 0.2650, 0},      {0.4479, 0.1750, 0},      {0.2835, 0.1070, 0},
    {0.1649, 0.0610, 0},      {0.0874, 0.0320, 0},      {0.0468, 0.0170, 0},      {0.0227, 0.0082, 0},
    {0.0114, 0.0041, 0},      {0.0058, 0.0021, 0},      {0.0029, 0.0010, 0},      {0.0014, 0.0005, 0},
    {0.0007, 0.0002, 0},      {0.0003, 0.0001, 0},      {0.0002, 0.0001, 0},      {0.0001, 0, 0}};

/* Planck's law: radiance per wavelength, in nanometers, up to a constant factor. */
static inline double ex_planck(double nanometers, double kelvin) {
    return pow(nanometers, -5) / expm1(1.438776877e7 / (nanometers * kelvin));
}

/* CIE 1931 X, Y, Z, up to the same factor. */
static inline void ex_blackbody_xyz(double kelvin, double out[3]) {
    memset(out, 0, 3 * sizeof *out);
    for (int i = 0; i < EX_OBSERVER_COUNT; ++i) {
        const double power = EX_OBSERVER_STEP * ex_planck(EX_OBSERVER_FIRST + EX_OBSERVER_STEP * i, kelvin);
        for (int c = 0; c < 3; ++c) out[c] += power * ex_observer[i][c];
    }
}

/* Linear Rec. 709 of luminance 1. What this color space cannot show, negative components below 1910 K, becomes 0. From
   500 K down, where nothing is seen of what glows, the color stays that of 500 K. */
static inline void ex_blackbody_color(double kelvin, double out[3]) {
    static const double rows[3][3] = {
        {3.2404542, -1.5371385, -0.4985314}, {-0.9692660, 1.8760108, 0.0415560}, {0.0556434, -0.2040259, 1.0572252}};
    static const double luminance[3] = {0.2126, 0.7152, 0.0722};
    double xyz[3];
    ex_blackbody_xyz(fmax(kelvin, 500), xyz);
    for (int c = 0; c < 3; ++c) out[c] = fmax(ex_dot(rows[c], xyz), 0);
    const double sum = ex_dot(luminance, out);
    for (int c = 0; c < 3; ++c) out[c] /= sum;
}

enum { EX_TEMPERATURE_POINTS = 257 }; /* each stands at one of the 2049 entries of the library's table */

/* Fills a transfer function for values 0..value_max that are temperatures, in units of `kelvin`. They only glow:
   radiance per world unit has the luminance `intensity` at `kelvin` and falls with the fourth power. */
static inline void ex_temperature_points(double kelvin, double intensity, double value_max,
                                         sps_transfer_point *points) {
    memset(points, 0, EX_TEMPERATURE_POINTS * sizeof *points);
    for (int i = 0; i < EX_TEMPERATURE_POINTS; ++i) {
        const double value = value_max * i / (EX_TEMPERATURE_POINTS - 1);
        double color[3];
        ex_blackbody_color(value * kelvin, color);
        points[i].value = (float)value;
        for (int c = 0; c < 3; ++c) points[i].emission[c] = (float)fmin(intensity * pow(value, 4) * color[c], 1e18);
    }
}

#endif /* EX_BLACKBODY_H */
