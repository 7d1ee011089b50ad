/* dispatch.c: one library for every processor of a kind. This file is compiled once for each variant, and once to
   choose a variant when a program runs. The program includes splatshadow.h without the implementation, calls the
   library as ever, and is linked with all objects:

       cc -O3 -I. -c examples/dispatch.c -o dispatch.o
       cc -O3 -I. -DVARIANT=sse2 -c examples/dispatch.c -o sse2.o
       cc -O3 -I. -DVARIANT=avx2 -mavx2 -mfma -c examples/dispatch.c -o avx2.o
       cc -O3 -I. -DVARIANT=avx512 -mavx512f -mavx512dq -mavx512bw -mavx512vl -mfma -c examples/dispatch.c -o avx512.o

   64-bit ARM has plain (with -DSPS_NO_SIMD) and neon; other processors have plain alone. In the first line,
   -DDISPATCH_MOST=1 leaves out AVX-512, and 0 all but the first variant. `make build/libsplatshadow.a` does all this,
   and so does the target splatshadow::dispatch of cmake/.

   In a variant, SPS_API is static. What it exports are functions with its name behind theirs, sps_render_avx2. Variants
   share no other function, since a linker might then run what is compiled for AVX-512 on any processor. */

#define JOIN_(a, b) a##_##b
#define JOIN(a, b)  JOIN_(a, b)

#ifdef VARIANT

/* The library compares a scene's callbacks with these three. Programs pass the chooser's functions, not the variant's.
   So macros rename the variant's own where they are declared or called, but not where addresses are compared. */
#include <stddef.h>
#ifdef __cplusplus
extern "C" {
#endif
struct sps_triangle;
int sps_grid_read(void *grid, const int lo[3], const int size[3], float *out);
int sps_grid_range(void *grid, const int lo[3], const int size[3], float out_min_max[2]);
int sps_indexed_mesh_read(void *indexed, size_t first, size_t count, struct sps_triangle *out);
#ifdef __cplusplus
}
#endif
#define sps_grid_read(a, b, c, d)         own_grid_read(a, b, c, d)
#define sps_grid_range(a, b, c, d)        own_grid_range(a, b, c, d)
#define sps_indexed_mesh_read(a, b, c, d) own_indexed_mesh_read(a, b, c, d)

#define SPS_API static
#define SPLATSHADOW_IMPLEMENTATION
#include "splatshadow.h"

#define LANES_plain  1
#define LANES_neon   4
#define LANES_sse2   4
#define LANES_avx2   8
#define LANES_avx512 16
#if SPSI_LANES != JOIN(LANES, VARIANT)
#error "the compiler's flags are not those of the variant"
#endif

#define FUNCTION(type, name, parameters, arguments)                                                                    \
    type JOIN(name, VARIANT) parameters;                                                                               \
    type JOIN(name, VARIANT) parameters { return name arguments; }
#define PROCEDURE(name, parameters, arguments)                                                                         \
    void JOIN(name, VARIANT) parameters;                                                                               \
    void JOIN(name, VARIANT) parameters { name arguments; }

#else

#include "splatshadow.h"

#if defined(__x86_64__) || defined(__i386__) || defined(_M_X64) || defined(_M_IX86)
#define LEAST  sse2
#define MIDDLE avx2
#define MOST   avx512
#elif defined(__aarch64__) || defined(_M_ARM64)
#define LEAST  plain
#define MIDDLE neon
#else
#define LEAST plain
#endif
#if !defined(MIDDLE) || defined(DISPATCH_MOST) && DISPATCH_MOST < 1
#undef MIDDLE
#define MIDDLE LEAST
#endif
#if !defined(MOST) || defined(DISPATCH_MOST) && DISPATCH_MOST < 2
#undef MOST
#define MOST MIDDLE
#endif

/* 2: the processor and the system have what MOST needs, 1: what MIDDLE needs, 0: neither. */
#if defined(_MSC_VER) && (defined(_M_X64) || defined(_M_IX86))
#include <intrin.h>
static int ask_processor(void) {
    int first[4], seventh[4];
    unsigned long long saved;
    __cpuid(first, 0);
    if (first[0] < 7) return 0;
    __cpuid(first, 1);
    __cpuidex(seventh, 7, 0);
    if ((first[2] & (1 << 12 | 1 << 27)) != (1 << 12 | 1 << 27)) return 0; /* FMA, and xgetbv */
    saved = _xgetbv(0);                                                    /* registers that the system saves */
    if ((saved & 6) != 6 || !(seventh[1] & 1 << 5)) return 0;              /* AVX2 */
    return (saved & 0xe6) == 0xe6 && (~(unsigned)seventh[1] & 0xc0030000u) == 0 ? 2 : 1; /* F, DQ, BW, VL */
}
static int level(void) {
    static volatile int known; /* 1 more than the level; whichever threads come first write the same */
    if (!known) known = 1 + ask_processor();
    return known - 1;
}
#elif defined(__x86_64__) || defined(__i386__)
static int level(void) {
    if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma")) return 0;
    return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                   __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl")
               ? 2
               : 1;
}
#else
static int level(void) { return 1; } /* 64-bit ARM always has NEON */
#endif

#define CHOOSE(name, arguments)                                                                                        \
    (level() > 1 ? JOIN(name, MOST) arguments : level() ? JOIN(name, MIDDLE) arguments : JOIN(name, LEAST) arguments)
#define DECLARE(type, name, parameters)                                                                                \
    type JOIN(name, LEAST) parameters;                                                                                 \
    type JOIN(name, MIDDLE) parameters;                                                                                \
    type JOIN(name, MOST) parameters;
#define FUNCTION(type, name, parameters, arguments)                                                                    \
    DECLARE(type, name, parameters)                                                                                    \
    type name parameters { return CHOOSE(name, arguments); }
#define PROCEDURE(name, parameters, arguments)                                                                         \
    DECLARE(void, name, parameters)                                                                                    \
    void name parameters { CHOOSE(name, arguments); }

#endif

#ifdef __cplusplus
extern "C" {
#endif
FUNCTION(int, sps_version, (void), ())
FUNCTION(sps_context *, sps_create, (const sps_config *config, sps_error_info *why), (config, why))
PROCEDURE(sps_destroy, (sps_context * context), (context))
FUNCTION(const char *, sps_error, (const sps_context *context), (context))
PROCEDURE(sps_get_error, (const sps_context *context, sps_error_info *info), (context, info))
FUNCTION(sps_result, sps_plan,
         (sps_context * context, const sps_scene *scene, const sps_view *view, sps_plan_report *report),
         (context, scene, view, report))
FUNCTION(sps_result, sps_render,
         (sps_context * context, const sps_scene *scene, const sps_view *view, const sps_image *image),
         (context, scene, view, image))
FUNCTION(sps_result, sps_reference,
         (sps_context * context, const sps_scene *scene, const sps_view *view, const sps_reference_settings *settings,
          const sps_image *image),
         (context, scene, view, settings, image))
FUNCTION(sps_result, sps_light_probes,
         (sps_context * context, const sps_scene *scene, const sps_view *view, size_t count, const double *positions,
          const sps_probe_arrays *out),
         (context, scene, view, count, positions, out))
PROCEDURE(sps_get_stats, (const sps_context *context, sps_stats_report *report), (context, report))
FUNCTION(const char *, sps_pass_name, (sps_pass pass), (pass))
FUNCTION(int, sps_grid_read, (void *grid, const int lo[3], const int size[3], float *out), (grid, lo, size, out))
FUNCTION(int, sps_grid_range, (void *grid, const int lo[3], const int size[3], float out[2]), (grid, lo, size, out))
FUNCTION(int, sps_indexed_mesh_read, (void *indexed, size_t first, size_t count, sps_triangle *out),
         (indexed, first, count, out))
FUNCTION(sps_result, sps_tmap_create,
         (sps_context * context, const sps_tmap_light *light, const sps_tmap_settings *settings, sps_tmap **map),
         (context, light, settings, map))
FUNCTION(sps_result, sps_tmap_add, (sps_tmap * map, const sps_scene *scene), (map, scene))
FUNCTION(sps_result, sps_tmap_finish, (sps_tmap * map), (map))
FUNCTION(sps_result, sps_tmap_update, (sps_tmap * map, const sps_scene *removed, const sps_scene *added),
         (map, removed, added))
FUNCTION(sps_result, sps_tmap_query,
         (const sps_tmap *map, size_t count, const double *positions, float *depths, float *transmittances),
         (map, count, positions, depths, transmittances))
FUNCTION(sps_result, sps_tmap_query_floats,
         (const sps_tmap *map, size_t count, const float *positions, size_t stride, float *depths,
          float *transmittances),
         (map, count, positions, stride, depths, transmittances))
FUNCTION(sps_result, sps_tmap_bounds,
         (const sps_tmap *map, size_t count, const double *positions, float *least, float *most),
         (map, count, positions, least, most))
FUNCTION(const float *, sps_tmap_texels, (const sps_tmap *map), (map))
FUNCTION(const uint32_t *, sps_tmap_starts, (const sps_tmap *map), (map))
FUNCTION(const float *, sps_tmap_surfaces, (const sps_tmap *map), (map))
FUNCTION(const float *, sps_tmap_fronts, (const sps_tmap *map), (map))
FUNCTION(sps_result, sps_tmap_get_projection, (const sps_tmap *map, int face, double matrix[16], double bias[2]),
         (map, face, matrix, bias))
FUNCTION(sps_result, sps_tmap_get_constants, (const sps_tmap *map, int face, sps_tmap_constants *constants),
         (map, face, constants))
FUNCTION(sps_result, sps_tmap_export,
         (sps_tmap * map, const sps_tmap_export_settings *settings, void *texels, size_t bytes,
          sps_tmap_texture *texture),
         (map, settings, texels, bytes, texture))
FUNCTION(sps_result, sps_tmap_get_info, (const sps_tmap *map, sps_tmap_info *info), (map, info))
PROCEDURE(sps_tmap_destroy, (sps_tmap * map), (map))
#ifdef __cplusplus
}
#endif
