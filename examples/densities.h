/* densities.h: functions of position that volumes are made of: noise, and signed distances of solids. */

#ifndef EX_DENSITIES_H
#define EX_DENSITIES_H

#include "vectors.h"

/* ---------------------------------------------------------------------------------------------------------- noise */

/* Hashes a lattice point to 32 bits by multiplying and folding, which is good enough for noise. */
static inline uint32_t ex_hash(int x, int y, int z) {
    uint32_t h = (uint32_t)x * 0x8DA6B343u + (uint32_t)y * 0xD8163841u + (uint32_t)z * 0xCB1AB31Fu;
    h = (h ^ (h >> 15)) * 0x2C9277B5u;
    h = (h ^ (h >> 13)) * 0x5F356495u;
    return h ^ (h >> 16);
}

/* A pseudo-random number in 0..1; `state` counts up. */
static inline double ex_random(uint32_t *state) { return ex_hash((int)(*state)++, 71, 5) / 4294967296.0; }

/* The dot product of a lattice point's gradient (three 10-bit parts of its hash) and the offset from it. */
static inline double ex_lattice_slope(int x, int y, int z, double dx, double dy, double dz) {
    const uint32_t h = ex_hash(x, y, z);
    return (h % 1024 / 511.5 - 1) * dx + (h / 1024 % 1024 / 511.5 - 1) * dy + (h / 1048576 % 1024 / 511.5 - 1) * dz;
}

/* Gradient noise: 0 at lattice points, second derivatives continuous, mostly within -1..1. */
static inline double ex_noise(ex_vec p) {
    const double fx = floor(p.x), fy = floor(p.y), fz = floor(p.z), part[3] = {p.x - fx, p.y - fy, p.z - fz};
    double fade[3], sum = 0;
    for (int i = 0; i < 3; ++i) fade[i] = part[i] * part[i] * part[i] * (part[i] * (part[i] * 6 - 15) + 10);
    for (int c = 0; c < 8; ++c) {
        const int i = c & 1, j = c >> 1 & 1, k = c >> 2;
        const double weight = (i ? fade[0] : 1 - fade[0]) * (j ? fade[1] : 1 - fade[1]) * (k ? fade[2] : 1 - fade[2]);
        sum += weight * ex_lattice_slope((int)fx + i, (int)fy + j, (int)fz + k, part[0] - i, part[1] - j, part[2] - k);
    }
    return 1.5 * sum;
}

/* Octaves of noise, each at twice the frequency and half the strength, shifted so that their zeros do not coincide. */
static inline double ex_fractal(ex_vec p, int octaves) {
    double sum = 0, strength = 1;
    for (int i = 0; i < octaves; ++i, strength *= 0.5) {
        sum += strength * ex_noise(p);
        p = ex_vec_of(2 * p.x + 3.7, 2 * p.y + 1.3, 2 * p.z + 5.1);
    }
    return sum;
}

/* The same with absolute values, which makes creases where the noise is zero, as between eddies. */
static inline double ex_turbulence(ex_vec p, int octaves) {
    double sum = 0, strength = 1;
    for (int i = 0; i < octaves; ++i, strength *= 0.5) {
        sum += strength * fabs(ex_noise(p));
        p = ex_vec_of(2 * p.x + 3.7, 2 * p.y + 1.3, 2 * p.z + 5.1);
    }
    return sum;
}

/* --------------------------------------------------------------------------------------------------------- solids */

/* Signed distances: negative inside. */
static inline double ex_box_distance(ex_vec p, ex_vec center, ex_vec half, double rounding) {
    const ex_vec q = ex_vec_of(fabs(p.x - center.x) - half.x + rounding, fabs(p.y - center.y) - half.y + rounding,
                               fabs(p.z - center.z) - half.z + rounding);
    const double inside = fmin(fmax(q.x, fmax(q.y, q.z)), 0);
    return ex_vec_length(ex_vec_of(fmax(q.x, 0), fmax(q.y, 0), fmax(q.z, 0))) + inside - rounding;
}
/* A torus around `axis` (unit). `major`: from the center to the middle of the tube; `minor`: radius of the tube. */
static inline double ex_ring_distance(ex_vec p, ex_vec center, ex_vec axis, double major, double minor) {
    const ex_vec d = ex_vec_sub(p, center);
    const double along = ex_vec_dot(d, axis), around = ex_vec_length(ex_vec_sub(d, ex_vec_scale(axis, along)));
    return sqrt((around - major) * (around - major) + along * along) - minor;
}
/* A rod from a to b with round ends; its radius goes from radius_a to radius_b. */
static inline double ex_rod_distance(ex_vec p, ex_vec a, ex_vec b, double radius_a, double radius_b) {
    const ex_vec ab = ex_vec_sub(b, a), ap = ex_vec_sub(p, a);
    const double t = ex_clamp(ex_vec_dot(ap, ab) / ex_vec_dot(ab, ab), 0, 1);
    return ex_vec_length(ex_vec_sub(ap, ex_vec_scale(ab, t))) - ex_mix(radius_a, radius_b, t);
}
/* 1 inside and 0 outside, with a smooth step of `width` at the surface. Make it several voxels wide, so that there is a
   gradient to shade by. */
static inline double ex_solid(double distance, double width) {
    return 1 - ex_ramp(-0.5 * width, 0.5 * width, distance);
}

/* Places a volume in the box low..high, with cubic voxels, `voxels` of them along the longest side. */
static inline void ex_volume_box(sps_volume *volume, ex_vec low, ex_vec high, int voxels) {
    const double side[3] = {high.x - low.x, high.y - low.y, high.z - low.z};
    const double voxel = fmax(side[0], fmax(side[1], side[2])) / voxels;
    for (int i = 0; i < 3; ++i) {
        volume->size[i] = (int)ceil(side[i] / voxel - 1e-6);
        volume->placement.axis[i][i] = volume->size[i] * voxel;
    }
    volume->placement.origin[0] = low.x, volume->placement.origin[1] = low.y, volume->placement.origin[2] = low.z;
}

#endif /* EX_DENSITIES_H */
