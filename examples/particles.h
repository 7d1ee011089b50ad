/* particles.h: particles in memory, and loading them from a file. */

#ifndef EX_PARTICLES_H
#define EX_PARTICLES_H

#include "files.h"

/* sps_particles.read_fn over a list of them. */
static inline int ex_particles_read(void *user, size_t first, size_t count, sps_particle *out) {
    memcpy(out, (const sps_particle *)user + first, count * sizeof *out);
    return 0;
}

/* Particles as a file has them. */
typedef struct ex_particles {
    sps_particle *list;
    size_t count;
    double lo[3], hi[3]; /* bounds of those that are finite; lo > hi if there are none */
} ex_particles;

static inline void ex_particles_measure(ex_particles *particles) {
    for (int a = 0; a < 3; ++a) particles->lo[a] = DBL_MAX, particles->hi[a] = -DBL_MAX;
    for (size_t i = 0; i < particles->count; ++i) {
        const sps_particle *p = particles->list + i;
        for (int a = 0; a < 3; ++a) {
            const double at = (double)p->position[a], radius = (double)p->radius;
            if (!(fabs(at) <= EX_COORDINATE_MAX && radius > 0 && radius <= EX_COORDINATE_MAX))
                continue; /* the library reports these */
            particles->lo[a] = fmin(particles->lo[a], at - radius);
            particles->hi[a] = fmax(particles->hi[a], at + radius);
        }
    }
}

static inline void ex_particle_set(const float numbers[8], int has_albedo, sps_particle *particle) {
    memcpy(particle->position, numbers, sizeof particle->position);
    particle->radius = numbers[3], particle->optical_depth = numbers[4];
    if (has_albedo) memcpy(particle->albedo, numbers + 5, sizeof particle->albedo);
}

/* The numbers of a particle in a file: x y z radius opticaldepth and, if they have albedos, r g b. */
static inline size_t ex_particle_floats(int has_albedos) { return has_albedos ? 8 : 5; }

static inline int ex_particles_load(ex_particles *particles, const char *path, int has_albedos, ex_error *error) {
    const size_t floats = ex_particle_floats(has_albedos), item = floats * sizeof(float);
    uint64_t held = 0;
    size_t got = 0;
    memset(particles, 0, sizeof *particles);
    FILE *file = ex_open(path, &held, error);
    if (!file) return 1;
    if (held % item != 0 || held > SIZE_MAX / 4) {
        fclose(file);
        return ex_fail(error, "%s: the file holds %llu bytes, which is no multiple of a particle's %zu", path,
                       (unsigned long long)held, item);
    }
    particles->count = (size_t)held / item;
    particles->list = (sps_particle *)ex_allocate(particles->count + 1, sizeof(sps_particle));
    while (got < particles->count) {
        float numbers[8];
        if (fread(numbers, sizeof *numbers, floats, file) != floats) break;
        ex_little_endian(numbers, floats, sizeof *numbers);
        ex_particle_set(numbers, has_albedos, &particles->list[got++]);
    }
    fclose(file);
    if (got != particles->count) {
        free(particles->list);
        memset(particles, 0, sizeof *particles);
        return ex_fail(error, "%s: reading failed after %zu particles", path, got);
    }
    ex_particles_measure(particles);
    return 0;
}

static inline void ex_particles_free(ex_particles *particles) {
    free(particles->list);
    memset(particles, 0, sizeof *particles);
}

#endif /* EX_PARTICLES_H */
