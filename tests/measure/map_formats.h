/* map_formats.h: what formats of exported maps cost in accuracy. The shader's code reads decoded texels, four of them a
   look-up, or once the contents that a texture's filter has mixed. */

#ifndef MAP_FORMATS_H
#define MAP_FORMATS_H

static float moment_bias;
#define TMAP_MOMENT_BIAS(map, n) moment_bias
#include "shaders/transmittance_map.h"

#include "map_trials.h"

enum { FORMATS = 4, FORMAT_COLUMNS = FORMATS + 1 }; /* and floats, filtered */

/* A map as a shader has it after sps_tmap_export: components of all texels, decoded. */
typedef struct decoded_map {
    tmap bound;
    float *texels;
} decoded_map;

static float decode(const unsigned char *bytes, sps_export_format format, size_t i) {
    static const float halves[2] = {1 / 16777216.0f, 1 / 1024.0f};
    float single;
    uint16_t number;
    if (format == SPS_EXPORT_UNORM8) return (float)bytes[i] / 255;
    if (format == SPS_EXPORT_FLOAT) return memcpy(&single, bytes + 4 * i, sizeof single), single;
    memcpy(&number, bytes + 2 * i, sizeof number);
    if (format == SPS_EXPORT_UNORM16) return (float)number / 65535;
    const int exponent = number >> 10 & 31;
    const float size =
        exponent ? ldexpf(1 + (float)(number & 1023) * halves[1], exponent - 15) : (float)(number & 1023) * halves[0];
    return number & 0x8000 ? -size : size;
}

static decoded_map decode_map(const ex_session *session, const char *program, sps_tmap *map, sps_export_format format) {
    sps_tmap_export_settings settings = {.format = format, .layout = SPS_EXPORT_SLICES};
    sps_tmap_texture texture;
    sps_tmap_constants constants;
    decoded_map made;
    ex_stop_unless_ok(sps_tmap_export(map, &settings, NULL, 0, &texture), program, session);
    unsigned char *bytes = (unsigned char *)ex_allocate(texture.bytes, 1);
    ex_stop_unless_ok(sps_tmap_export(map, &settings, bytes, texture.bytes, &texture), program, session);
    const size_t texels = (size_t)texture.width * (size_t)texture.height, count = (size_t)texture.layers;
    made.texels = (float *)ex_allocate(texels * count, sizeof(float));
    for (size_t i = 0; i < texels; ++i)
        for (size_t k = 0; k < count; ++k)
            made.texels[i * count + k] =
                texture.constants.offset[k] + texture.constants.scale[k] * decode(bytes, format, k * texels + i);
    free(bytes);
    memset(&made.bound, 0, sizeof made.bound);
    sps_tmap_get_constants(map, 0, &constants);
    memcpy(&made.bound, &constants, sizeof constants);
    made.bound.texels = made.texels, made.bound.has_surfaces = 0;
    moment_bias = texture.constants.moment_bias;
    return made;
}

static tmap_place decoded_place(const decoded_map *map, const double *point) {
    const tmap_vec3 position = {(float)point[0], (float)point[1], (float)point[2]};
    return tmap_project(map->bound, position);
}

/* Transmittance by one evaluation of the mean contents of four texels. */
static float filtered_transmittance(const decoded_map *map, const double *point) {
    const tmap_place p = decoded_place(map, point);
    const int n = map->bound.components, last_x = map->bound.width - 1, last_y = map->bound.height - 1;
    tmap one = map->bound;
    float mixed[65] = {0};
    for (int i = 0; i < 4; ++i) {
        const int x = (int)floorf(p.x) + i % 2, y = (int)floorf(p.y) + i / 2;
        const int texel = tmap_clamp_int(y, 0, last_y) * map->bound.width + tmap_clamp_int(x, 0, last_x);
        const float weight = (1 - fabsf(p.x - (float)x)) * (1 - fabsf(p.y - (float)y));
        for (int k = 0; k < n; ++k) mixed[k] += weight * map->texels[texel * n + k];
    }
    one.texels = mixed;
    return expf(-tmap_gas_depth(one, 0, fminf(fmaxf(p.u, 0), 1)));
}

/* A row: rms error in the gas by format, then of floats with one look-up. */
static void print_format_row(const ex_session *session, const char *program, const set_up *s, const trial *t) {
    char name[48];
    sps_tmap *map = ex_tmap_build(session, program, &s->light_view, &t->settings, &s->occluders);
    printf("| %s |", trial_name(t, name));
    for (int column = 0; column < FORMAT_COLUMNS; ++column) {
        const sps_export_format format = (sps_export_format)(column % FORMATS);
        const decoded_map made = decode_map(session, program, map, format);
        double sum = 0;
        for (int i = 0; i < GAS_POINTS; ++i) {
            const double *point = s->points + 3 * i;
            const float through = column < FORMATS ? tmap_transmittance(made.bound, decoded_place(&made, point))
                                                   : filtered_transmittance(&made, point);
            sum += pow((double)through - (double)s->exact[i], 2);
        }
        printf(" %.4f |", sqrt(sum / GAS_POINTS));
        free(made.texels);
    }
    printf("\n");
    sps_tmap_destroy(map);
}

/* Two scenes: connected smoke, and scattered puffs. */
static void print_formats(const ex_session *session, const char *program, set_up *const *scenes) {
    static const int shown[2] = {PUFF, CLUMPS};
    printf("\n## Formats\n\nRms errors of maps with 8 floats or the next lower number, exported by `sps_tmap_export`, "
           "with "
           "four look-ups per point. The last\ncolumn has one look-up of filtered floats. `build/measure/maps formats` "
           "prints this alone.\n");
    for (int i = 0; i < 2; ++i) {
        const set_up *s = scenes[shown[i]];
        printf("\n| %s | float | half | unorm16 | unorm8 | float, one look-up |\n|---|---|---|---|---|---|\n", s->name);
        for (int k = 0; k < KINDS; ++k) {
            const trial *t = trial_of(&s->trials, k, kinds[k].technique == SPS_TMAP_BEER ? 6 : 8);
            if (t && k != COMPRESSED && k != FEW_NODES) print_format_row(session, program, s, t);
        }
    }
}

#endif /* MAP_FORMATS_H */
