/* measuring.h: for programs that measure. They have nothing to save, so a failure ends them with one line on stderr. */

#ifndef EX_MEASURING_H
#define EX_MEASURING_H

#include "session.h"

/* The value below which `share` of all values lie. Reorders the values. [Hoare 1961, "Find"] */
static inline double ex_percentile(double *values, size_t count, double share) {
    const size_t wanted = (size_t)(share * (double)(count - 1) + 0.5);
    size_t low = 0, high = count - 1;
    while (low < high) {
        const double pivot = values[low + (high - low) / 2];
        size_t i = low, j = high;
        for (;;) {
            while (values[i] < pivot) ++i;
            while (pivot < values[j]) --j;
            if (i >= j) break;
            const double swapped = values[i];
            values[i++] = values[j], values[j--] = swapped;
        }
        if (wanted <= j)
            high = j;
        else
            low = j + 1;
    }
    return values[wanted];
}

static inline void ex_stop_if(int failed, const char *program, const ex_error *error) {
    if (!failed) return;
    fprintf(stderr, "%s: %s\n", program, error->text);
    exit(EX_FAILED);
}

/* The same for a result of the library. */
static inline void ex_stop_unless_ok(sps_result result, const char *program, const ex_session *session) {
    ex_error error;
    if (result != SPS_OK) ex_stop_if(ex_fail(&error, "%s", sps_error(session->context)), program, &error);
}

/* Begins a session without a progress line, which would run into the figures. */
static inline void ex_session_measure(ex_session *session, const char *program, int threads) {
    ex_error error;
    ex_stop_if(ex_session_begin(session, threads, &error), program, &error);
    session->progress.terminal = 0;
}

/* Makes a transmittance map of what the light sees, ready for queries. */
static inline sps_tmap *ex_tmap_build(const ex_session *session, const char *program, const sps_tmap_light *light,
                                      const sps_tmap_settings *settings, const sps_scene *occluders) {
    sps_tmap *map;
    ex_stop_unless_ok(sps_tmap_create(session->context, light, settings, &map), program, session);
    ex_stop_unless_ok(sps_tmap_add(map, occluders), program, session);
    ex_stop_unless_ok(sps_tmap_finish(map), program, session);
    return map;
}

enum { EX_QUERY_BLOCK = 4096 }; /* points per task */

typedef struct ex_query {
    const sps_tmap *map;
    size_t count;
    const double *positions;
    float *optical_depths, *transmittances;
} ex_query;

static inline void ex_query_block(void *data, int index, int worker) {
    const ex_query *query = (const ex_query *)data;
    const size_t first = (size_t)index * EX_QUERY_BLOCK, left = query->count - first;
    (void)worker;
    sps_tmap_query(query->map, left < EX_QUERY_BLOCK ? left : EX_QUERY_BLOCK, query->positions + 3 * first,
                   query->optical_depths ? query->optical_depths + first : NULL,
                   query->transmittances ? query->transmittances + first : NULL);
}

/* The number of bytes that a map holds. */
static inline double ex_tmap_bytes(const sps_tmap *map) {
    sps_tmap_info info;
    return sps_tmap_get_info(map, &info) == SPS_OK ? (double)info.bytes : 0;
}

/* sps_tmap_query on all threads of the session. */
static inline void ex_tmap_query(ex_session *session, const sps_tmap *map, size_t count, const double *positions,
                                 float *optical_depths, float *transmittances) {
    ex_query query = {map, count, positions, optical_depths, transmittances};
    ex_parallel_for(&session->pool, (int)((count + EX_QUERY_BLOCK - 1) / EX_QUERY_BLOCK), ex_query_block, &query);
}

#endif /* EX_MEASURING_H */
