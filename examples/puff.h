/* puff.h: puffs of smoke made of particles, and wind that carries them away. */

#ifndef EX_PUFF_H
#define EX_PUFF_H

#include "densities.h"
#include "particles.h"

enum { EX_PUFF_PARTICLES = 2500 }; /* enough for one puff to look like smoke */

/* A ball of particles, eroded by turbulence. */
typedef struct ex_puff {
    ex_vec center;
    double radius;            /* no particle reaches further */
    double smallest, largest; /* particles' radii; the small ones are at the edge */
    double optical_depth;     /* of each particle, along its diameter */
    uint32_t seed;
} ex_puff;

/* A uniformly distributed point in the unit ball. */
static inline ex_vec ex_random_in_ball(uint32_t *random) {
    ex_vec p;
    do {
        p.x = 2 * ex_random(random) - 1;
        p.y = 2 * ex_random(random) - 1;
        p.z = 2 * ex_random(random) - 1;
    } while (ex_vec_dot(p, p) > 1);
    return p;
}

/* Draws points and keeps those inside what the turbulence leaves, which is at least two fifths of the radius. */
static inline void ex_puff_fill(const ex_puff *puff, size_t count, sps_particle *out) {
    uint32_t random = ex_hash((int)puff->seed, 17, 3);                  /* so that seeds 1 and 2 are unrelated */
    const ex_vec shift = ex_vec_scale(ex_random_in_ball(&random), 100); /* each puff has its own turbulence */
    for (size_t i = 0; i < count; ++i) {
        ex_vec p;
        double inside;
        do {
            p = ex_random_in_ball(&random);
            const double billows = ex_turbulence(ex_vec_add(ex_vec_scale(p, 1.3), shift), 4);
            const double eaten =
                0.6 * ex_clamp(1.2 - 1.6 * billows, 0, 1); /* creases with round billows between them */
            inside = 1 - eaten - ex_vec_length(p);
        } while (inside < 0);
        const double size = ex_ramp(0, 0.4, inside) * (0.6 + 0.4 * ex_random(&random));
        const double radius = ex_mix(puff->smallest, puff->largest, size);
        ex_store(out[i].position, ex_vec_add(puff->center, ex_vec_scale(p, puff->radius - radius)));
        out[i].radius = (float)radius;
        out[i].optical_depth = (float)puff->optical_depth;
    }
}

/* Wind over level ground, with eddies in it. */
typedef struct ex_wind {
    ex_vec velocity;         /* at `height` above the ground */
    double ground, height;   /* the ground's y; the height that `velocity` is for */
    double exponent;         /* of speed as a power of height: 1/7 over open land, more over rough ground */
    double eddy_size, gusts; /* world units; approximate speed of the eddies */
    uint32_t seed;
} ex_wind;

/* The curl of three noise fields. It has no divergence, so particles neither gather nor thin out. [Bridson et al. 2007]
 */
static inline ex_vec ex_swirl(ex_vec p) {
    const double step = 1e-3;
    double slope[3][3]; /* of noise i along axis k */
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) {
            const ex_vec shift = ex_vec_of(31.4 * i, 15.9 * i, 26.5 * i);
            const ex_vec side = ex_vec_of(step * (k == 0), step * (k == 1), step * (k == 2)), q = ex_vec_add(p, shift);
            slope[i][k] = (ex_noise(ex_vec_add(q, side)) - ex_noise(ex_vec_sub(q, side))) / (2 * step);
        }
    return ex_vec_of(slope[2][1] - slope[1][2], slope[0][2] - slope[2][0], slope[1][0] - slope[0][1]);
}

static inline ex_vec ex_wind_velocity(const ex_wind *wind, ex_vec p) {
    const double share = pow(fmax(p.y - wind->ground, 0) / wind->height, wind->exponent);
    const ex_vec shift = ex_vec_of(wind->seed % 101, wind->seed % 103, wind->seed % 107);
    const ex_vec swirl = ex_swirl(ex_vec_add(ex_vec_scale(p, 1 / wind->eddy_size), shift));
    return ex_vec_add(ex_vec_scale(wind->velocity, share), ex_vec_scale(swirl, wind->gusts));
}

/* Moves the particles with the wind, in midpoint steps. Their sizes and optical depths do not change. */
static inline void ex_puff_blow(const ex_wind *wind, double seconds, int steps, size_t count, sps_particle *particles) {
    const double step = seconds / steps;
    for (size_t i = 0; i < count; ++i) {
        float *at = particles[i].position;
        ex_vec p = ex_vec_of((double)at[0], (double)at[1], (double)at[2]);
        for (int k = 0; k < steps; ++k) {
            const ex_vec half = ex_vec_add(p, ex_vec_scale(ex_wind_velocity(wind, p), 0.5 * step));
            p = ex_vec_add(p, ex_vec_scale(ex_wind_velocity(wind, half), step));
        }
        ex_store(at, p);
    }
}

#endif /* EX_PUFF_H */
