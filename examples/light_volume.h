/* light_volume.h: a grid of light probes: what sps_light_probes finds at the centres of cells that fill a box, and
   files of it. A .dds file is a 3D texture, a .npy file an array of 32-bit floats. The formats: dds.h names its own;
   NumPy's "NEP 1: a simple file format for NumPy arrays", version 1.0. It reads nothing. */

#ifndef EX_LIGHT_VOLUME_H
#define EX_LIGHT_VOLUME_H

#include "dds.h"

enum { EX_LIGHT_VOLUME_SIDE = 32, EX_LIGHT_VOLUME_BLOCKS = 4, EX_LIGHT_VOLUME_NUMBERS = 15 };
#define EX_LIGHT_VOLUME_MOST 268435456.0 /* numbers in all: 1 GB of floats */

/* Probes are in the order of positions: x fastest, z slowest. The arrays are those of sps_probe_arrays. */
typedef struct ex_light_volume {
    int count[3], lights;
    double origin[3], spacing[3]; /* the first probe's position; from each probe to the next */
    float *sky, *l0, *l1, *transmittance;
} ex_light_volume;

static inline size_t ex_light_volume_count(const ex_light_volume *volume) {
    return (size_t)volume->count[0] * (size_t)volume->count[1] * (size_t)volume->count[2];
}

/* Fills a box with cells. `count` NULL: cubes around the box's middle, 32 along the longest side. Otherwise they fit
   exactly; along a side without extent, they are as long as the longest edge of a cell. */
static inline int ex_light_volume_fit(const double lo[3], const double hi[3], const int *count, ex_light_volume *volume,
                                      ex_error *error) {
    double longest = 0, edge = 0;
    for (int a = 0; a < 3; ++a) longest = fmax(longest, hi[a] - lo[a]);
    for (int a = 0; a < 3; ++a) {
        const double cells = (hi[a] - lo[a]) / (longest / EX_LIGHT_VOLUME_SIDE);
        volume->count[a] = count ? count[a] : (int)fmax(ceil(cells - 1e-6), 1); /* sides may differ by rounding */
        volume->spacing[a] = count ? (hi[a] - lo[a]) / count[a] : longest / EX_LIGHT_VOLUME_SIDE;
        edge = fmax(edge, volume->spacing[a]);
    }
    if (!(edge > 0)) return ex_fail(error, "light probes need a box, but the scene has no extent");
    for (int a = 0; a < 3; ++a) {
        if (!(volume->spacing[a] > 0)) volume->spacing[a] = edge;
        volume->origin[a] = 0.5 * (lo[a] + hi[a]) - 0.5 * (volume->count[a] - 1) * volume->spacing[a];
    }
    return 0;
}

/* Light's parts lie one after the other along z. */
static inline ex_dds ex_light_volume_texture(const ex_light_volume *volume, int is_float) {
    ex_dds file;
    const double depth = (double)volume->count[2] * (EX_LIGHT_VOLUME_BLOCKS + volume->lights);
    memset(&file, 0, sizeof file);
    file.width = volume->count[0], file.height = volume->count[1], file.depth = (int)fmin(depth, INT32_MAX);
    file.format = is_float ? EX_DDS_RGBA32F : EX_DDS_RGBA16F;
    file.alpha = EX_DDS_ALPHA_CUSTOM;
    return file;
}

/* Refuses what would be too large, before it is computed. */
static inline int ex_light_volume_check(const char *path, const ex_light_volume *volume, int is_dds, ex_error *error) {
    const int *n = volume->count, each = EX_LIGHT_VOLUME_NUMBERS + 3 * volume->lights;
    const ex_dds file = ex_light_volume_texture(volume, 1);
    if ((double)n[0] * n[1] * n[2] * each > EX_LIGHT_VOLUME_MOST)
        return ex_fail(error, "%s: %d x %d x %d probes of %d numbers: more than %.0f numbers", path, n[0], n[1], n[2],
                       each, EX_LIGHT_VOLUME_MOST);
    return is_dds ? ex_dds_check(path, &file, error) : 0;
}

/* Fills the arrays, which ex_light_volume_free frees, also after a failure. */
static inline sps_result ex_light_volume_compute(sps_context *context, const sps_scene *scene, const sps_view *view,
                                                 ex_light_volume *volume) {
    const size_t probes = ex_light_volume_count(volume);
    double *positions = (double *)ex_allocate(probes, 3 * sizeof *positions), *to = positions;
    sps_probe_arrays out;
    memset(&out, 0, sizeof out);
    volume->lights = scene->light_count;
    volume->sky = out.sky = (float *)ex_allocate(probes, 3 * sizeof(float));
    volume->l0 = out.l0 = (float *)ex_allocate(probes, 3 * sizeof(float));
    volume->l1 = out.l1 = (float *)ex_allocate(probes, 9 * sizeof(float));
    volume->transmittance = out.transmittance =
        (float *)ex_allocate(probes * (size_t)volume->lights, 3 * sizeof(float));
    for (int z = 0; z < volume->count[2]; ++z)
        for (int y = 0; y < volume->count[1]; ++y)
            for (int x = 0; x < volume->count[0]; ++x) {
                const int at[3] = {x, y, z};
                for (int a = 0; a < 3; ++a) *to++ = volume->origin[a] + at[a] * volume->spacing[a];
            }
    const sps_result result = sps_light_probes(context, scene, view, probes, positions, &out);
    free(positions);
    return result;
}

static inline void ex_light_volume_free(ex_light_volume *volume) {
    free(volume->sky), free(volume->l0), free(volume->l1), free(volume->transmittance);
}

/* Makes four numbers per probe: L0 and mean sky; L1 of red, green and blue; each light's transmittance. */
static inline void ex_light_volume_block(const ex_light_volume *volume, int block, float *out) {
    const size_t probes = ex_light_volume_count(volume), lights = (size_t)volume->lights;
    for (size_t i = 0; i < probes; ++i, out += 4) {
        const float *sky = volume->sky + 3 * i, *from = volume->l0 + 3 * i;
        if (block > 0) from = volume->l1 + 9 * i + 3 * (size_t)(block - 1);
        if (block >= EX_LIGHT_VOLUME_BLOCKS)
            from = volume->transmittance + 3 * (lights * i + (size_t)(block - EX_LIGHT_VOLUME_BLOCKS));
        memcpy(out, from, 3 * sizeof *out);
        out[3] = block == 0 ? (sky[0] + sky[1] + sky[2]) / 3.0f : 0;
    }
}

static inline int ex_light_volume_write_dds(const char *path, const ex_light_volume *volume, int is_float,
                                            ex_error *error) {
    ex_dds file = ex_light_volume_texture(volume, is_float);
    const int blocks = EX_LIGHT_VOLUME_BLOCKS + volume->lights;
    const size_t numbers = 4 * ex_light_volume_count(volume), size = is_float ? 4 : 2;
    if (ex_dds_check(path, &file, error)) return 1;
    unsigned char *texels = (unsigned char *)ex_allocate((size_t)blocks * numbers, size);
    float *block = (float *)ex_allocate(numbers, sizeof *block);
    for (int n = 0; n < blocks; ++n) {
        ex_light_volume_block(volume, n, block);
        ex_dds_encode(file.format, block, numbers, texels + (size_t)n * numbers * size);
    }
    file.texels = texels;
    const int failed = ex_write_dds(path, &file, error);
    free(texels), free(block);
    return failed;
}

enum { EX_LIGHT_VOLUME_HEADER = 128 }; /* bytes before the array: a multiple of 64 */

/* Indexes are z, y, x and a number: 3 of the sky, 3 of L0, 9 of L1, 3 of each light. */
static inline int ex_light_volume_write_npy(const char *path, const ex_light_volume *volume, ex_error *error) {
    const size_t lights = 3 * (size_t)volume->lights, each = EX_LIGHT_VOLUME_NUMBERS + lights;
    const int *n = volume->count;
    char header[EX_LIGHT_VOLUME_HEADER + 1];
    ex_output output;
    if (ex_output_begin(&output, path, error)) return 1;
    float *row = (float *)ex_allocate(each, sizeof *row);
    memcpy(header, "\x93NUMPY\1\0", 8);
    header[8] = EX_LIGHT_VOLUME_HEADER - 10, header[9] = 0; /* the length of what follows */
    const int length =
        snprintf(header + 10, sizeof header - 10,
                 "{'descr': '<f4', 'fortran_order': False, 'shape': (%d, %d, %d, %zu), }", n[2], n[1], n[0], each);
    memset(header + 10 + length, ' ', (size_t)(EX_LIGHT_VOLUME_HEADER - 11 - length));
    header[EX_LIGHT_VOLUME_HEADER - 1] = '\n';
    ex_output_bytes(&output, header, EX_LIGHT_VOLUME_HEADER);
    for (size_t i = 0; i < ex_light_volume_count(volume) && !output.failure; ++i) {
        memcpy(row, volume->sky + 3 * i, 3 * sizeof *row);
        memcpy(row + 3, volume->l0 + 3 * i, 3 * sizeof *row);
        memcpy(row + 6, volume->l1 + 9 * i, 9 * sizeof *row);
        memcpy(row + 15, volume->transmittance + lights * i, lights * sizeof *row);
        ex_little_endian(row, each, sizeof *row);
        ex_output_bytes(&output, row, each * sizeof *row);
    }
    free(row);
    return ex_output_end(&output, error);
}

/* How many numbers half floats do not reach. */
static inline size_t ex_light_volume_beyond(const ex_light_volume *volume) {
    const size_t probes = ex_light_volume_count(volume);
    size_t beyond = 0;
    for (size_t i = 0; i < 3 * probes; ++i) beyond += volume->l0[i] > 65504.0f;
    for (size_t i = 0; i < 9 * probes; ++i) beyond += fabs((double)volume->l1[i]) > 65504;
    return beyond;
}

#endif /* EX_LIGHT_VOLUME_H */
