/* SPDX-License-Identifier: MIT OR Unlicense

splatshadow.h 0.3.0 (2026-11-22): renders volumes, gases, particles and polygons into correctly shadowed images, and
into shadow maps for engines, on the CPU.
MIT or public domain, as you choose (full text at the end of this file).

QUICK START (examples/hello.c is this text)

    #define SPLATSHADOW_IMPLEMENTATION
    #include "splatshadow.h"
    #include <math.h>
    #include <stdio.h>
    static int blob(void *user, size_t count, const double *xyz, float *density) {
        for (size_t i = 0; i < count; ++i, xyz += 3)
            density[i] = (float)exp(-16 * (xyz[0] * xyz[0] + xyz[1] * xyz[1] + xyz[2] * xyz[2]));
        return (void)user, 0;
    }
    int main(void) {
        static const float corners[] = {-9, -0.8f, 5, 9, -0.8f, 5, 9, -0.8f, -9, -9, -0.8f, -9};
        static const uint16_t indices[] = {0, 1, 2, 0, 2, 3};
        static float rgba[256 * 256 * 4];
        sps_volume gas = {.size = {64, 64, 64}, .placement = {{-1, -1, -1}, {{2, 0, 0}, {0, 2, 0}, {0, 0, 2}}},
                          .eval_fn = blob, .extinction = 6, .albedo = {0.7f, 0.8f, 0.9f}};
        sps_indexed_mesh net = {.vertex_count = 4, .positions = corners, .triangle_count = 2, .indices_u16 = indices};
        sps_mesh mesh = {.triangle_count = 2, .read_fn = sps_indexed_mesh_read, .user = &net, .color = {.3f, .3f, .2f}};
        sps_light sun = {.direction = {1, -1, -0.5}, .color = {9, 8, 7}};
        sps_scene scene = {.volumes = &gas, .volume_count = 1, .meshes = &mesh, .mesh_count = 1, .lights = &sun,
                           .light_count = 1, .background = {0.1f, 0.2f, 0.4f}};
        sps_camera camera = {.position = {0, 1.2, 4}, .up = {0, 1, 0}, .field_of_view = 0.6};
        sps_view view = {.width = 256, .height = 256, .camera = camera};
        sps_image image = {.rgba = rgba};
        sps_context *context = sps_create(NULL, NULL);
        if (sps_render(context, &scene, &view, &image)) return puts(sps_error(context)), 1;
        printf("P3 256 256 255\n");
        for (int i = 0; i < 256 * 256 * 4; ++i)
            if (i % 4 != 3) printf("%d ", (int)(255 * pow(fmin(rgba[i], 1), 1 / 2.2)));
        return sps_destroy(context), 0;
    }

CONTENTS (search for the tag)

    >>types            public types                  >>functions        public functions
    >>config        1  macros and the C library      >>simd          2  vectors of floats
    >>maths         3  vectors and matrices          >>memory        4  allocator, errors, tasks
    >>kernel        5  the voxel kernel              >>view          6  rays of a camera or a light
    >>transfer      7  transfer functions, phase     >>transmittance 8  curves of transmittance
    >>scene         9  checking and resolving        >>gather        10 voxels, particles into lists
    >>trees         11 trees of boxes, for rays      >>polygons      12 triangles, rasterised
    >>layers        13 panes and edges, by pixel     >>surfaces      14 their looks, shadow rays
    >>lamps         15 lights and their rays         >>projectors    16 images that lights throw
    >>depthmaps     17 polygons before gas           >>balls         18 particles as rays see them
    >>slicing       19 slabs and sweeps              >>splat         20 footprints into sheets
    >>targets       21 filling sheets, by tile       >>lightsheets   22 sheets as optical depth
    >>tmaps         23 transmittance maps            >>penumbrae     24 light of many points
    >>shadows       25 shadows on gas, surfaces      >>shading       26 light leaving a sheet
    >>sweep         27 chunks of slabs, tiles        >>frame         28 sweep after sweep, the image
    >>plan          29 what a scene calls for        >>reference     30 brute-force ray marching
    >>public        31 the public functions          >>licence

NOT INCLUDED
    No files, no windows, no threads of its own, no GPU. Single scattering (plus unshadowed ambient light).
    No refraction, no mirrors: light passes translucent polygons straight on.
    Edges of polygons are sampled if sps_view.coverage_samples is set; edges of their shadows, and those of a classified
    volume whose voxels are smaller than pixels, are not: render larger and downsample where they matter. Gas is
    filtered: a pixel shows its mean.

CONVENTIONS
    World space is right-handed in the examples, but nothing depends on handedness. Lengths are in the caller's unit.
    Angles are in radians. Matrices are row-major and multiply column vectors.
    Row 0 of an image is its top row. Pixel (x,y) is the ray through its centre. Colors are linear RGB radiance.
    A directional light's `direction` is the direction in which the light travels; its color is the irradiance on a
    plane facing it.
    A point light's color is its intensity: irradiance = intensity / distance^2, unless its falloff is none.
    Extinction is per unit length at value 1. Phase functions integrate to 1 over the sphere (isotropic: 1 / 4 pi).
    A surface of reflectance r reflects a radiance of r / pi * irradiance * cosine towards the eye.
    Voxel (i,j,k) sits at the centre of its cell; x runs fastest. Outside its box a volume's value is 0; since kernels
    reach beyond the box, the field fades out within 2.5 voxels of it.
    A volume stands for the field f(p) = sum of value * kernel(p - centre), where the kernel is a normalised Gaussian
    with a standard deviation of 0.65 voxels. sps_reference marches through exactly this sum; sps_render cuts the
    kernels at 1.8 to 2.5 voxels, depending on quality.

BUILD OPTIONS (define before the implementation is included; none changes a public type)

    SPLATSHADOW_IMPLEMENTATION   compiles the implementation; define it in exactly one source file
    SPS_API                      default extern; may be `static` or an export attribute
    SPS_ASSERT(c)                default assert(c); catches bugs in the library and in parallel_for_fn. Bad input
                                 returns an sps_result instead
    SPS_MALLOC(n), SPS_FREE(p)   default malloc, free; used if the config has no allocator (define both or neither)
    SPS_SNPRINTF                 default snprintf; writes the error sentences
    SPS_ALLOW_FAST_MATH          allows -ffast-math, -ffinite-math-only and /fp:fast, which are an #error otherwise:
                                 with them invalid data goes unnoticed, and polygons may show gaps
    SPS_NO_SIMD                  plain C only. Otherwise the widest of AVX-512, AVX2+FMA, SSE2 and NEON that the
                                 compiler is told to use (-march=native, /arch:AVX2, ...)

MEMORY   Everything comes from the config's allocator and stays in the context for the next frame. Rendering needs
    about 20 bytes per relevant voxel, 32 per particle and 264 more for those in the fullest 16 slabs, 176 per triangle
    and 68 more if lights cast shadows, 24 to 60 per pixel, 68 per texel of shadow buffer, and per worker a tile of
    sheets (0.3 MB per kind of gas or classified volume). Each light that casts shadows adds 18 bytes per texel of its
    depth map if polygons shade gas, 4 per pixel of the image if there are polygons, and its map or table; those of
    lights that share a sweep are held at the same time. Shadow tables stay for the next call: 4 bytes per entry, 8
    while one is made or updated, by default up to 256^3 entries per face; if all volumes have a revision, also 8 per
    patch of 8 x 8 texels, and 8 per brick of 8^3 voxels. A light with an extent adds 64 bytes per texel of its shadow
    buffer, 4 per texel and point (8 if there are polygons), and 12 per texel and worker. An image that a light throws
    takes 16 bytes per texel, and 8 per pixel more if the light has an extent. Meshes that have a shade_fn add 28 bytes
    per triangle of theirs, 24 per pixel of the region, and 0.9 MB. Translucent polygons and coverage_samples add 4
    bytes per pixel, 80 per layer of a pixel and more per light, and a band of samples per worker. sps_plan returns an
    upper bound beforehand, without these layers and the lists that maps are made from, which may be several times as
    much; memory_limit is never exceeded.
ERRORS   Calls return sps_result; sps_error returns one sentence that names the field and its value, sps_get_error the
    same as data. After a failure the image is untouched and the context can be used again.
THREADS   A context serves one call at a time; any number of contexts can run at once, and any number of threads may
    query a finished map. Work is distributed by parallel_for_fn. All other callbacks (read, range, eval, shade, sample,
    background, progress, message, allocator) run on the calling thread, one at a time, and must not call into the same
    context. With both parallel_for_fn and progress_fn, several workers may call clock_fn at once.
REPEATABLE   A build produces the same bits for any number of workers, on every run, and for any region of an image. So
    it does on different machines if they have the same C library and all threads use the same rounding mode and the
    same treatment of denormal numbers.
LIMITS   Images and shadow buffers up to 16384 on a side, images that lights throw up to 4096; 2^28 entries of a shadow
    table; 2^20 slabs. Coordinates and matrices must lie within 1e15.
    Voxels are resolved from 1e-14 to 1e10 world units, polygons from 1e-20 up, and shadows of polygons in gas for
    point lights up to 1e7 times as far away as the gas is wide. A polygon shades only what lies farther behind it than
    the round-off of its corners, which are floats: 1.2e-7 of their distance from the mesh's origin.
    Values above 1e18 are an error, values below 1e-30 count as 0. Beyond an optical depth of 86, transmittance is
    exactly 0; a polygon has an optical depth of 1e15. Where a volume's optical depth is well above 1 per voxel, its
    silhouette shrinks by a fraction of a voxel, because kernels are cut. Classified volumes need slabs of 0.7 voxels
    or less.

PAPERS
    C. Zhang, R. Crawfis, "Light Propagation for Mixed Polygonal and Volumetric Data Using Splatting" >>slicing
    D. Ebert, R. Parent, "Rendering and Animation of Gaseous Phenomena by Combining Fast Volume and Scanline
      A-buffer Techniques", SIGGRAPH 1990 >>transfer >>layers >>tmaps
    L. Carpenter, "The A-buffer, an Antialiased Hidden Surface Method", SIGGRAPH 1984 >>layers
    M. Zwicker et al., "EWA Splatting", IEEE TVCG 8(3), 2002 >>splat
    M. Olano, T. Greer, "Triangle Scan Conversion using 2D Homogeneous Coordinates", Graphics Hardware 1997 >>polygons
    I. Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", Interactive Ray Tracing 2007 >>trees
    J. Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems II, 2021 >>surfaces
    T. Dekker, "A Floating-Point Technique for Extending the Available Precision", Numer. Math. 18, 1971 >>maths
    T.-Y. Kim, U. Neumann, "Opacity Shadow Maps", EGSR 2001 >>transmittance
    C. Yuksel, J. Keyser, "Deep Opacity Maps", Eurographics 2008 >>transmittance
    J. Jansen, L. Bavoil, "Fourier Opacity Mapping", I3D 2010 >>transmittance
    T. Lokovic, E. Veach, "Deep Shadow Maps", SIGGRAPH 2000 >>transmittance
    M. Salvi et al., "Adaptive Volumetric Shadow Maps", EGSR 2010 >>transmittance
    C. Muenstermann et al., "Moment-Based Order-Independent Transparency", I3D 2018 >>transmittance
    M. Steffen, "A simple method for monotonic interpolation in one dimension", Astronomy & Astrophysics 239, 1990
      >>transmittance
*/

#ifndef SPLATSHADOW_H
#define SPLATSHADOW_H
#include <stddef.h>
#include <stdint.h>

#define SPS_VERSION 300 /* major*10000 + minor*100 + patch; sps_version() returns the compiled one */
#ifndef SPS_API
#define SPS_API extern
#endif
#ifdef __cplusplus
extern "C" {
#endif

/* ================================================================================================ >>types */

typedef enum sps_result {
    SPS_OK = 0,
    SPS_ERROR_ARGUMENT,    /* a field is missing or outside its documented range */
    SPS_ERROR_MEMORY,      /* the allocator returned NULL, or memory_limit would be exceeded */
    SPS_ERROR_CALLBACK,    /* a callback of the scene returned non-zero */
    SPS_ERROR_DATA,        /* a callback delivered a value that is not finite, negative or above 1e18 */
    SPS_ERROR_UNSUPPORTED, /* no slicing direction suits camera and light, and the light has an extent or is to shade by
                              sheets (sps_light); or numbers exceed the range of floats */
    SPS_ERROR_CANCELLED    /* progress_fn returned non-zero */
} sps_result;

/* The struct that caused a failure. */
typedef enum sps_object {
    SPS_OBJECT_NONE = 0, /* out of memory, cancelled, or no failure */
    SPS_OBJECT_CALL,     /* an argument of the call, which `field` names */
    SPS_OBJECT_CONFIG,
    SPS_OBJECT_SCENE,
    SPS_OBJECT_VIEW,
    SPS_OBJECT_IMAGE,
    SPS_OBJECT_VOLUME,    /* volume number `index` of the scene */
    SPS_OBJECT_MESH,      /* mesh number `index` */
    SPS_OBJECT_LIGHT,     /* light number `index`; others' fields are "shadow_map.components", "projector.width" */
    SPS_OBJECT_PARTICLES, /* set number `index` */
    SPS_OBJECT_TMAP,      /* a transmittance map itself, not what it was made from */
    SPS_OBJECT_TMAP_LIGHT,
    SPS_OBJECT_TMAP_SETTINGS
} sps_object;

/* A failure, as data; `sentence` says the same for people. */
typedef struct sps_error_info {
    sps_result result;
    sps_object object;
    /* Of the volume, mesh, light or set of particles in the scene's array; from sps_tmap_finish, counted through all
       scenes added to the map. -1 for other objects. */
    int index;
    /* The member of the object in C syntax ("transfer.points[2].value", "placement.origin[2]"; colors and directions as
       a whole), the callback that failed, or, for SPS_ERROR_DATA, what a callback delivered ("value",
       "particle[7].radius"). Of arrays that the library reads itself: "grid.scale", "arrays.positions". "": the object
       as a whole. */
    char field[64];
    double value;       /* the field's value, what the callback returned, or another number that the sentence names; 0
                           if there is none */
    char sentence[256]; /* what sps_error returns */
} sps_error_info;

/* Runs a loop in parallel. Must call task(task_data, index, worker) once for each index 0..count-1, in any order, on
   any threads, and return when all calls have returned and their writes are visible to the caller. Tasks that were left
   out are run afterwards by the calling thread, as worker 0. `worker` is 0..worker_count-1 and never the same for two
   calls that run at the same time. Tasks do not block, call no callback except for clock_fn, and use up to 16 KB of
   stack (24 KB with AVX-512). */
typedef void (*sps_task_fn)(void *task_data, int index, int worker);
typedef void (*sps_parallel_for_fn)(void *user, int count, sps_task_fn task, void *task_data);

/* All zero is valid: malloc, no threads, no messages, no limit. Copied by sps_create. */
typedef struct sps_config {
    uint32_t start_canary;                                   /* leave 0 */
    void *(*alloc_fn)(void *user, size_t size);              /* set both or neither; aligned as by malloc */
    void (*free_fn)(void *user, void *pointer, size_t size); /* `size` is the one passed to alloc_fn */
    sps_parallel_for_fn parallel_for_fn;                     /* NULL: everything runs on the calling thread */
    int worker_count;                                        /* 1..1024 with parallel_for_fn; 0 means 1 */
    /* `fraction` is 0..1 and never decreases. Returning non-zero cancels, though not at once. Called on the calling
       thread, every few milliseconds of work for most sizes. With parallel_for_fn, set clock_fn too: otherwise all
       workers wait for each other after every few tasks, which costs up to a sixth of a frame's time. */
    int (*progress_fn)(void *user, float fraction);
    /* One line without newline: errors (except for SPS_ERROR_CANCELLED), and warnings. */
    void (*message_fn)(void *user, const char *text);
    /* Returns seconds. With progress_fn, several workers may call it at once. NULL: no times in sps_get_stats. */
    double (*clock_fn)(void *user);
    size_t memory_limit; /* bytes; 0: no limit */
    void *alloc_user, *parallel_user, *progress_user, *message_user, *clock_user;
    uint32_t end_canary; /* leave 0 */
} sps_config;

/* An affine map from local to world space: local (0,0,0) maps to origin, the local unit vectors along x, y, z map to
   axis[0], axis[1], axis[2]. All axes zero: the identity. A zero determinant is an error. */
typedef struct sps_placement {
    double origin[3];
    double axis[3][3];
} sps_placement;

/* One Henyey-Greenstein lobe: p(c) = (1 - g^2) / (4 pi (1 + g^2 - 2 g c)^1.5), where c is the cosine of the angle
   between the directions of travel before and after scattering. [Henyey & Greenstein 1941] */
typedef struct sps_lobe {
    float asymmetry; /* g, -0.99..0.99; positive scatters forward */
    float weight;    /* > 0; weights are divided by their sum */
} sps_lobe;

/* A transfer function maps values to color and extinction, by points or by a callback. Linear between points, constant
   before the first and after the last. Sampled once per call into a table of 2048 entries over 0..value_max. Value 0
   (everything outside the data) is always empty. */
typedef struct sps_transfer_point {
    float value;      /* strictly increasing from point to point, >= 0 */
    float color[3];   /* albedo (gas) or reflectance (surface), 0..1 */
    float extinction; /* per world unit, >= 0 */
} sps_transfer_point;

typedef struct sps_transfer {
    const sps_transfer_point *points; /* NULL with point_count 0: use eval_fn */
    int point_count;
    /* Writes color and extinction for `count` values. `out` is zeroed beforehand. Returns non-zero on failure. */
    int (*eval_fn)(void *user, size_t count, const float *values, sps_transfer_point *out);
    void *user;
    float value_max; /* largest value of interest; 0 means the last point's value, or 1 with eval_fn */
} sps_transfer;

typedef enum sps_shading {
    SPS_SHADING_GAS = 0, /* scatters by the phase function */
    SPS_SHADING_SURFACE  /* diffuse and specular where the gradient, its normal, is strong; gas elsewhere */
} sps_shading;

/* A grid of voxels in the world. Values come from read_fn or eval_fn, in blocks of at most 38^3 voxels. Without a
   transfer function it is a gas: extinction = value * `extinction`, scattering = `albedo` * that. */
typedef struct sps_volume {
    uint32_t start_canary;   /* leave 0 */
    int size[3];             /* voxels along x, y, z, at most 65536 each; no volume if any of them is 0 */
    sps_placement placement; /* maps the unit cube to the volume's box; may rotate, scale and shear */

    /* Writes the size[0]*size[1]*size[2] values, >= 0, of the block of voxels that begins at lo, x fastest. `out` is
       zeroed beforehand. Returns non-zero on failure. */
    int (*read_fn)(void *user, const int lo[3], const int size[3], float *out);
    /* Optional: bounds of the values in a block, so that it can be skipped without reading. They may be too wide, never
       too narrow; if data may be invalid, write 0..1e18, and reading detects it. Returns non-zero on failure. */
    int (*range_fn)(void *user, const int lo[3], const int size[3], float out_min_max[2]);
    /* Instead of read_fn: the values at world positions (packed triples), which are the voxels' centres. `out` is
       zeroed beforehand. Returns non-zero on failure. */
    int (*eval_fn)(void *user, size_t count, const double *positions, float *out);
    void *user;
    /* Non-zero: the voxels of all volumes are kept for the next call, provided that every volume has a revision and
       none has changed; otherwise all are read again. */
    uint64_t revision;

    float extinction;      /* gas: per world unit at value 1, >= 0 */
    float albedo[3];       /* gas: 0..1; all zero: absorbs only */
    float emission[3];     /* gas: radiance per world unit at value 1, >= 0 */
    const sps_lobe *lobes; /* NULL: isotropic */
    int lobe_count;        /* 0..8 */

    const sps_transfer *transfer; /* NULL: gas; otherwise extinction, albedo and emission are ignored, lobes are not */
    sps_shading shading;          /* with a transfer function */
    float gradient_full;          /* change of value per voxel from which on shading is all surface; 0 means 0.05 */
    float specular;               /* strength of the highlight, 0..1 */
    float shininess;              /* Blinn-Phong exponent, 0 means 32 */
    uint32_t end_canary;          /* leave 0 */
} sps_volume;

/* Storage of a voxel, in the machine's byte order. There is no default: 0 is an error. */
typedef enum sps_voxel_format {
    SPS_VOXEL_U8 = 1, /* 0..255 */
    SPS_VOXEL_U16,    /* 0..65535 */
    SPS_VOXEL_F16,    /* IEEE 754 half precision */
    SPS_VOXEL_F32     /* float */
} sps_voxel_format;

/* A dense array of voxels in the caller's memory, for volumes that need no callback of their own:
       volume.read_fn = sps_grid_read, volume.range_fn = sps_grid_range, volume.user = &grid;
   The caller owns the struct and its voxels, and must not change them until the call that reads them has returned
   (sps_tmap_add: until sps_tmap_finish has). Any number of volumes, contexts and threads may read one grid at once. */
typedef struct sps_grid {
    uint32_t start_canary; /* leave 0 */
    const void *voxels;    /* voxel (0,0,0); need not be aligned */
    sps_voxel_format format;
    int size[3];         /* voxels along x, y, z; must equal the volume's */
    ptrdiff_t stride[3]; /* bytes from one voxel to the next along x, y, z; may be negative. 0: packed, x fastest:
                            a voxel's bytes, size[0] times |stride[0]|, size[1] times |stride[1]| */
    float scale;         /* value = stored * scale + offset; 0 means 1; 1 / 255.0f maps a byte to 0..1 */
    float offset;
    uint32_t end_canary; /* leave 0 */
} sps_grid;

typedef struct sps_triangle {
    float position[3][3]; /* local to the mesh's placement */
    float normal[3][3];   /* read if has_normals; of any length; zero: the triangle's geometric normal */
    float color[3][3];    /* read if has_colors; replaces the mesh's color; 0..1 */
    float uv[3][2];       /* read if there is a shade_fn, which receives it; any finite numbers */
} sps_triangle;

/* The point of a mesh that a pixel shows, for shade_fn. */
typedef struct sps_surface_point {
    double position[3]; /* world */
    double uv[2];       /* interpolated between the corners' in perspective */
    /* Change of uv from this pixel to the next one to the right, and to the next one below, in the plane of the
       triangle: a texture is filtered over them. Large where the triangle is seen edge-on, but finite. */
    float uv_dx[2], uv_dy[2];
    float normal[3];  /* in the world, of unit length, on the eye's side: light is reflected by it */
    float weights[3]; /* of the triangle's corners, to interpolate the caller's own data; their sum is 1 */
    size_t triangle;  /* number in the mesh */
    int mesh;         /* number in the scene's array */
    int x, y;         /* pixel of the whole image */
} sps_surface_point;

/* Appearance of such a point. */
typedef struct sps_surface {
    float color[3];    /* reflectance, 0..1 */
    float emission[3]; /* the point's own radiance, 0..1e18; seen by the eye, lights nothing else */
} sps_surface;

/* Triangles, lit on both sides: what is seen of them is lit from the eye's side. Their shadows on each other are found
   by exact rays to the light; the sharpness of their shadows in gas is set by sps_view.shadow_size. Degenerate
   triangles are skipped; non-finite ones are an error. */
typedef struct sps_mesh {
    uint32_t start_canary; /* leave 0 */
    size_t triangle_count; /* 0: no mesh; at most 2^29, over all meshes of a scene */
    /* Writes `count` triangles, beginning with number `first`. Called for blocks of 256, once each per call, or not at
       all if `revision` shows that all are held. `out` is zeroed beforehand. Returns non-zero on failure. */
    int (*read_fn)(void *user, size_t first, size_t count, sps_triangle *out);
    void *user;
    sps_placement placement;
    float color[3]; /* reflectance, 0..1 */
    int has_normals, has_colors;
    /* Optional, for textures: sets the appearance of `count` points of this mesh, at most 4096. Each pixel of the
       region that shows the mesh, even through gas, is passed once, in rows from the top, whatever the number of
       workers; where it shows several of its triangles (through translucent ones, or at sampled edges), once for each.
       Light is added later. `out` holds the mesh's own color beforehand, or that of the corners, and no emission. A
       point's appearance must not depend on the other points of a call, which depend on the region. Values out of the
       ranges of sps_surface are SPS_ERROR_DATA. Maps do not call it. Returns non-zero on failure. */
    int (*shade_fn)(void *user, size_t count, const sps_surface_point *points, sps_surface *out);
    void *shade_user;
    /* Share of red, green and blue that passes straight through, at any angle, 0..1; all 0: opaque. The rest of what
       arrives is reflected, by `color`, or absorbed; for energy to be conserved, the two add up to at most 1. A pixel
       shows any number of translucent triangles, in order with each other and with gas, and light that passes them
       colors what it falls on. Cost: of the eye's pixels and, if gas scatters, of the texels of lights' depth maps, 24
       to 80 bytes per triangle on the ray; each that a pixel shows is shaded, and found by shadow rays, as an opaque
       one is. From a light with an extent, gas receives the mean of what translucent polygons let pass times the mean
       of what everything else does. Transmittance maps use the mean of the three colors. */
    float transmittance[3];
    /* Non-zero: the triangles of all meshes, and the tree through which their shadows are traced, are kept for the next
       call, provided that every mesh has a revision and nothing about any of them has changed; otherwise all are read
       again. */
    uint64_t revision;
    uint32_t end_canary; /* leave 0 */
} sps_mesh;

/* Triangles over vertices in the caller's memory, for meshes that need no callback of their own:
       mesh.read_fn = sps_indexed_mesh_read, mesh.user = &indexed, mesh.triangle_count = indexed.triangle_count;
   The caller owns the struct and its arrays, on the terms of sps_grid. The arrays need not be aligned. */
typedef struct sps_indexed_mesh {
    uint32_t start_canary;  /* leave 0 */
    size_t vertex_count;    /* above 0 */
    const float *positions; /* x, y, z of each vertex, local to the mesh's placement */
    const float *normals;   /* three floats per vertex, or NULL: then mesh.has_normals must be 0 */
    const float *colors;    /* three floats per vertex, or NULL: then mesh.has_colors must be 0 */
    const float *uvs;       /* two floats per vertex, or NULL: all 0 */
    size_t position_stride, normal_stride, color_stride; /* bytes from one vertex to the next; 0: 12, packed */
    size_t uv_stride;                                    /* 0: 8, packed */
    size_t triangle_count;
    /* Three indices per triangle, in one array or the other. Both NULL: vertices 0, 1, 2 are the first triangle,
       3, 4, 5 the second, and so on. */
    const uint16_t *indices_u16;
    const uint32_t *indices_u32;
    uint32_t end_canary; /* leave 0 */
} sps_indexed_mesh;

/* A ball of gas. */
typedef struct sps_particle {
    float position[3];   /* world */
    float radius;        /* world units, >= 0; 0: nothing */
    float optical_depth; /* along its diameter, 0..1e18; less along a shorter chord */
} sps_particle;

/* A set of particles of the same material. Those smaller than a pixel or texel are widened to one, at the same mass.
   Optical depth along a pixel's ray is exact for slabs of any thickness; light within a ball is resolved by slabs
   (sps_view.slab) and by the texels of the light's sheets, which are 0.35 radii wide at medium quality. A particle that
   overlaps a polygon ends at it. */
typedef struct sps_particles {
    uint32_t start_canary; /* leave 0 */
    size_t count;          /* 0: no particles; at most 2^29, over all sets of a scene */
    /* Writes `count` particles, beginning with number `first`. Called for blocks of at most 4096, once each per call.
       `out` is zeroed beforehand. Returns non-zero on failure. */
    int (*read_fn)(void *user, size_t first, size_t count, sps_particle *out);
    void *user;
    int soft;              /* 0: uniform density; 1: density falls as 1 - (r / radius)^2, to nothing at the rim */
    int is_extinction;     /* 1: optical_depth holds extinction per world unit instead; if soft, at the centre */
    float albedo[3];       /* 0..1; all zero: absorbs only */
    float emission[3];     /* radiance per unit of optical depth, >= 0 */
    const sps_lobe *lobes; /* NULL: isotropic */
    int lobe_count;        /* 0..8 */
    uint32_t end_canary;   /* leave 0 */
} sps_particles;

/* How a transmittance map stores optical depth along the ray of each texel. u runs from 0 at near_depth to 1 at
   far_depth. The order in which occluders are added does not matter except for round-off. Deep, compressed, depth,
   cosine and adaptive maps are made from sorted lists, which takes 3 to 33 times as long as SPS_TMAP_DEFAULT. n stands
   for `components`; docs/shadow_maps.md helps to choose. */
typedef enum sps_tmap_technique {
    /* SPS_TMAP_DEEP_OPACITY with `cubic`: small errors on most gases for few floats. As a light's shadow_map:
       SPS_TMAP_TABLE, less than half the error in less time, but more memory. */
    SPS_TMAP_DEFAULT = 0,
    /* Every interval of every occluder: exact along the texels' own rays, as a reference for the others. (In all maps,
       particles with a radius up to one texel are weighted so that their mass is right wherever they lie between
       texels; from 1.5 texels on they are unchanged. Volumes are exact except for the cut of their kernels, which
       `quality` sets: see sps_tmap_bracket.) 16 bytes per interval and 4 per texel; a query sums the intervals that
       begin before it. No components. */
    SPS_TMAP_DEEP,
    /* Deep shadow map [Lokovic & Veach 2000]: a polyline of transmittance that is nowhere more than `epsilon` off along
       a texel's own ray; the one technique whose error the caller sets. (Between four texels, the mean of their optical
       depths may be farther off where some of them are nearly black.) 8 bytes per node and 4 per texel; a query
       searches. No components. */
    SPS_TMAP_COMPRESSED,
    /* Where transmittance falls to one half; 1 before, 0 behind. Right for opaque occluders only. 1 component. */
    SPS_TMAP_DEPTH,
    /* Optical depth at n planes, u = 1/n .. 1 or as set by `planes` [Kim & Neumann 2001]. Exact there; in between, the
       neighbouring planes bracket the true value. n 1..65, default 8. Insertion costs the planes that an interval
       passes through, a query 2 lookups (cubic: 4), and a comparison with each plane if `planes` is set. */
    SPS_TMAP_OPACITY,
    /* Deep opacity map, after [Yuksel & Keyser 2008]: the same with planes between the texel's own first and last
       occluder, which are stored before them. (In the paper, the first number is the depth of the first occluder, and
       n - 1 planes of equal thickness, the same for all texels, follow it: with n = 8 its errors are 1.2 to 2.7 times
       as large in five of the six scenes of docs/maps.md.) Thin shells stay sharp; two clumps far apart gain nothing.
       n 3..65, default 8; occluders are processed twice. */
    SPS_TMAP_DEEP_OPACITY,
    /* A Fourier series of extinction [Jansen & Bavoil 2010]: a0 a1 b1 a2 b2 .. . Exact at u = 1; before that it rings,
       by up to 9 % of a step without a window. The series is periodic, with u = 0 next to u = 1: leave room before the
       first occluder and behind the last, or set texel_range. n 3, 5 .. 65, default 7, and two more with texel_range;
       insertion and query cost n. */
    SPS_TMAP_FOURIER,
    /* A cosine series of transmittance itself: c0 c1 .. . It does not wrap around, and rings only at opaque occluders,
       but is exact nowhere. n 2..64, default 8; made from lists, slowest of all to build; a query costs n. */
    SPS_TMAP_COSINE,
    /* 4, 6 or 8 moments of extinction along the ray [Muenstermann et al. 2018]: the total, and the means of z ..
       z^(n-1) with z = 2u - 1. A query returns the middle of the narrowest bracket that they allow. Soft, never rings,
       exact at u = 1. n 5, 7 or 9, default 5; insertion costs n; a query solves a small matrix and finds the roots of a
       polynomial, ten times the cost of others. */
    SPS_TMAP_MOMENT,
    /* Adaptive volumetric shadow map [Salvi et al. 2010]: the transmittance curve as n / 2 nodes, u T u T .. . The node
       whose removal changes the area least is removed until n / 2 are left. There is no error bound; the rms error is
       1.3 to 1.5 times that of the best nodes. n 4, 6 .. 64, default 16; made from lists; a query searches. */
    SPS_TMAP_ADAPTIVE,
    /* Beer shadow map, as engines have it: u where gas begins, optical depth per u from there on, and the total, at
       which it is capped. Exact for a single uniform interval, and behind everything; gas in several clumps is spread
       over the gaps between them. (Engines use the mean over the occupied part instead: better for two clumps, 0.106
       against 0.170, worse in the other five scenes of docs/maps.md. The three numbers are read in the same way.)
       3 components; insertion and query cost least of all. */
    SPS_TMAP_BEER,
    /* For sps_light.shadow_map only. A shadow table, after [Ebert & Parent 1990]: optical depth at n even planes and
       interpolated linearly between them, in steps of 16 / 65535, which is up to 1.2e-4 off; beyond 16 all is dark. By
       default entries are as wide as a texel of the light's sheets, or wider if more than 256 would be needed on a
       side. n 8..1024; the default makes entries as long as they are wide, but at most 256 planes. At most 2^28
       entries. 4 bytes per texel and plane, twice that while it is made; cheapest of all maps to look up. Held for the
       next call, and updated there where gas has changed (sps_light.shadow_map). */
    SPS_TMAP_TABLE
} sps_tmap_technique;

/* Weight of harmonic k of a Fourier or cosine map that has n of them. */
typedef enum sps_tmap_window {
    SPS_TMAP_WINDOW_NONE = 0, /* sharpest; overshoots */
    SPS_TMAP_WINDOW_LANCZOS,  /* sinc(k / (n + 1)): hardly overshoots, twice the blur */
    SPS_TMAP_WINDOW_FEJER     /* 1 - k / (n + 1): optical depth of a Fourier map never decreases; most blur */
} sps_tmap_window;

/* Zero is valid for all but far_depth: deep opacity, cubic, with 8 components. For sps_light.shadow_map all of it may
   be zero: a table. */
typedef struct sps_tmap_settings {
    uint32_t start_canary; /* leave 0 */
    sps_tmap_technique technique;
    int components;     /* floats per texel; 0: the technique's default, or fewer to stay within byte_budget */
    size_t byte_budget; /* maximum size of the finished map, including surfaces; 0: no limit */
    /* Range of depths along the light's axis (six faces: the nearest coordinate axis) or its direction, 0 <= near <
       far, which should contain all gas. Gas before or behind it counts as if at its near or far end, where Fourier
       maps confuse it with that of the other end and cosine maps lose it. Opaque surfaces shade from where they are,
       outside the range too; but points before near_depth are lit. */
    double near_depth, far_depth;
    /* Opacity: u of each plane, increasing from above 0 to 1; copied. There are `components` of them (deep opacity: two
       fewer), which must be set. NULL: even steps. A technique ignores those of the fields from here to epsilon that
       are not meant for it. */
    const float *planes;
    int cubic;              /* opacity: 1: monotone cubics between planes instead of straight lines */
    sps_tmap_window window; /* Fourier and cosine */
    int texel_range;        /* Fourier: 1: u runs from each texel's first occluder to its last, two more components */
    /* Fourier: 1: a query returns the maximum of the series so far, so that T never rises; n times the cost. */
    int running_maximum;
    float epsilon; /* compressed: maximum error of T, up to 0.5; 0 means 0.01; kept to 1e-6 (soft particles: 0.001) */
    double surface_bias; /* world units behind an opaque surface at which its shadow begins; 0 means 2 texels' width */
    uint32_t end_canary; /* leave 0 */
} sps_tmap_settings;

typedef enum sps_light_kind {
    SPS_LIGHT_DIRECTIONAL = 0,
    SPS_LIGHT_POINT,
    SPS_LIGHT_DISC,
    SPS_LIGHT_RECTANGLE
} sps_light_kind;

/* How the irradiance from a light with a position falls with the distance from it. */
typedef enum sps_falloff {
    SPS_FALLOFF_INVERSE_SQUARE = 0, /* irradiance = color / distance^2 */
    SPS_FALLOFF_NONE                /* irradiance = color, at any distance */
} sps_falloff;

/* How gas is shaded from a light without a shadow_map. Sheets are filled slab by slab as the eye's are, in a sweep of
   their own; a table is looked up in any slab. */
typedef enum sps_shadow_source {
    /* Sheets where slabs can serve light and camera, a table where none can. Further lights take a table too, and share
       the first one's sweep, if that costs no detail: nothing is classified, the table is as fine as the light's sheets
       (within its default size of 256 entries each way), and it fits into memory_limit beside everything that the scene
       may need. Known before anything is read, from the volumes' boxes; only with particles not until they are. */
    SPS_SHADOW_AUTO = 0,
    SPS_SHADOW_SHEETS, /* refused where no slabs serve light and camera */
    SPS_SHADOW_TABLE   /* a table with default settings, of shadow_map_size */
} sps_shadow_source;

/* An image that a light throws, like a slide: its light is multiplied by the image's color, and there is none beyond
   the edges, over which the image fades within a texel. Lookups are bilinear, in a pyramid of halved images where
   pixels are larger than texels. Every point of a light with an extent throws the image. Cost: 3 floats per texel and
   1/3 more; for each of the light's points, 12 to 24 lookups per pixel of a polygon, and four times as many per part of
   a slab that the image reaches. */
typedef struct sps_projector {
    uint32_t start_canary; /* leave 0 */
    int width, height;     /* texels, 1..4096 each */
    /* Color at places of the image, given by pairs from (0, 0), the image's top left corner as seen along the light's
       direction, to (1, 1), the opposite one: the centres of a row of texels per call, from the top row down, in every
       call that uses the light. out_rgb: packed triples, 0..1e18. Returns non-zero on failure. */
    int (*sample_fn)(void *user, size_t count, const float *uv, float *out_rgb);
    void *user;
    /* The image's edges, left < right and bottom < top, to the right of and above sps_light.direction: as tangents of
       angles from it (-1, 1, -1, 1: a square of 90 degrees); of a directional light, in world units from
       sps_light.position. */
    double left, right, bottom, top;
    double up[3]; /* towards the image's top row; zero or along the direction: an axis across it is chosen */
    /* Disc, rectangle: the distance, along the direction, at which all points of the extent throw the image to the same
       place; it must be beyond the extent. 0: infinity. At distance d the image is blurred by the extent, |1 - d /
       focus| times. A directional light with an angular_diameter is in focus at sps_light.position. Where shadows of
       gas fall into the blur, each is averaged over the extent by itself, which is several percent off. */
    double focus;
    uint32_t end_canary; /* leave 0 */
} sps_projector;

/* A light. One with an extent casts penumbrae: it shines as points spread evenly over it would, except that gas
   scatters its light as if it came from the centre, and that a surface takes the mean of what polygons let pass times
   the mean of what gas does. Where the extent is 0, shadows are sharp, to the same bits as those of a point. Where gas
   cannot cast or receive a penumbra of half a texel of the light's sheets, by the bounds of all gas and polygons, its
   shadows are left sharp. Shadows of volumes and particles by sheets come from slabs perpendicular to the half-way
   vector between eye and light, so every eye ray and every light ray through the volumes must cross those slabs with a
   cosine of at least 0.1. Where that cannot be (a point light inside or close to a volume, a very wide camera), the
   light takes a table (shadow_source). A light with an extent cannot, unless its penumbrae are narrower than half a
   texel and there are neither polygons nor particles: rendering fails with SPS_ERROR_UNSUPPORTED then. Where no light
   shades by sheets, slabs are perpendicular to the eye's central ray; the image of a camera that sees volumes across
   more than 168 degrees (2.94) from corner to corner is rendered in two or four parts, each with slabs of its own.
   Polygons have no such limit. */
typedef struct sps_light {
    uint32_t start_canary; /* leave 0 */
    sps_light_kind kind;
    /* Directional: the direction in which the light travels. With a cone or a projector: its axis. Of any length except
       for 0. */
    double direction[3];
    double position[3]; /* the point, or the centre; directional: of a projector's image, otherwise unused */
    float color[3];     /* >= 0; directional: irradiance, otherwise intensity; all zero: no light */
    /* Directional: extent, as the angle that the light subtends, in radians, 0..2 (the sun: 0.0093): a disc of even
       radiance, infinitely far away. */
    double angular_diameter;
    /* Disc, rectangle: extent, as two vectors from the centre to the rim, in world units. Perpendicular vectors of
       equal length make a disc or a square, others an ellipse, a rectangle or a parallelogram. Each of its points
       shines with the same intensity in all directions, unless there is a cone. */
    double axes[2][3];
    /* All but directional: makes a spotlight. Angles from `direction`, in radians, 0 <= inner < outer <= pi; outer 0:
       no cone. Intensity is `color` within the inner angle and 0 beyond the outer; in between it is s^2 color, s rising
       from 0 to 1 in proportion to the cosine [KHR_lights_punctual]. Each point of an extent has this cone. */
    double inner_cone, outer_cone;
    sps_falloff falloff; /* all but directional; with SPS_FALLOFF_NONE, `color` is irradiance */
    /* NULL: none. Otherwise an image that the light throws along `direction`, with or without a cone. Borrowed for the
       call. */
    const sps_projector *projector;
    /* Number of points that stand for an extent, up to 256; 0: from quality (draft 8, medium 16, high 32, ultra 64).
       The error of a penumbra falls nearly in proportion. Cost: per point and pixel of polygons, a shadow ray and, in
       gas, up to 17 lookups; in gas, three lookups per point, slab and texel that has gas. sps_reference uses this
       number of points for each sample, 64 if this is 0, and other ones. */
    int samples;
    int no_shadow; /* 1: shines through everything */
    /* NULL: see shadow_source. Otherwise from a transmittance map made with these settings, which has no
       slicing limit: around a point light amid what it lights, the map has six faces. Its depth range is fitted to the
       gas, and shadows of polygons are the same as without it: near_depth, far_depth and surface_bias must be 0. By
       default it is a table. If all volumes have a revision, a table is held for the next call, and used there if
       nothing that it was made from has changed; the camera is not part of that. If only gas has changed, and as a
       whole reaches as far as before, the table is updated, to the same bits as a new one: only patches of 8 x 8 texels
       are filled whose rays pass bricks of 8^3 voxels, or particles, that have changed. Volumes are read and compared
       as a whole: a revision need not say where. A call that fails may release it. Volumes that are shaded
       as surfaces, or dense, show the errors of maps of few components as blotches near the terminator. A light with an
       extent cannot have one. Borrowed for the call. */
    const sps_tmap_settings *shadow_map;
    /* How gas is shaded where shadow_map is NULL. SPS_SHADOW_SHEETS beside a shadow_map is an error, and so is
       SPS_SHADOW_TABLE beside one of another technique. */
    sps_shadow_source shadow_source;
    /* Texels on the map's, or a face's, longer side, up to 16384; 0: shadow_size, or from quality. */
    int shadow_map_size;
    /* Point: 1: six faces wherever the light is; 0: only if it is amid what it lights. */
    int shadow_map_omnidirectional;
    uint32_t end_canary; /* leave 0 */
} sps_light;

/* Borrowed for the call. Members that are zero are absent. Objects may overlap each other. */
typedef struct sps_scene {
    uint32_t start_canary; /* leave 0 */
    const sps_volume *volumes;
    int volume_count; /* up to 64 that hold voxels */
    const sps_mesh *meshes;
    int mesh_count;
    const sps_light *lights;
    int light_count;
    float ambient[3];    /* radiance from all directions, >= 0; lights gases and surfaces without shadow */
    float background[3]; /* radiance behind everything, >= 0; not part of alpha */
    /* Instead of `background`: radiance along unit directions (packed triples), one row of pixels per call. Returns
       non-zero on failure. */
    int (*background_fn)(void *user, size_t count, const float *directions, float *out_rgb);
    void *background_user;
    /* 1: values of volumes, particles and projectors that would be SPS_ERROR_DATA become 0 and are counted. */
    int replace_invalid;
    const sps_particles *particles;
    int particle_set_count; /* sets of particles, up to 64 that are not empty */
    uint32_t end_canary;    /* leave 0 */
} sps_scene;

/* Settings of a quality:    slab (voxels) of a   shadow texels per   rays end at     kernels end   ripple of a constant
                             gas, classified      voxel; classified   transmittance   at (voxels)   (rms, maximum)
   At medium, the kernels of classified volumes end at 1.82 voxels in shadow buffers, where their ripple is small
   compared with the error of the texels; the price is that flat voxels ripple more. */
typedef enum sps_quality {
    SPS_QUALITY_DEFAULT = 0, /* medium */
    SPS_QUALITY_DRAFT,       /*  2     1.4         0.75  1            0.01            1.82          0.5 %   1.5 %  */
    SPS_QUALITY_MEDIUM,      /*  1     0.7         1     1.25         0.003           2.15          0.12 %  0.4 %  */
    SPS_QUALITY_HIGH,        /*  0.5   0.4         2     2            0.0005          2.5           0.07 %  0.2 %  */
    SPS_QUALITY_ULTRA        /*  0.25  0.2         4     4            0.00005         2.5           0.07 %  0.2 %  */
} sps_quality;

/* Where rays start and where they go. Exactly one of field_of_view, ortho_height and world_to_clip must be set: none or
   several is an error. */
typedef struct sps_camera {
    double position[3], target[3], up[3]; /* up zero or along the view: an axis across the view is chosen */
    double field_of_view;                 /* perspective: the vertical angle, above 0, up to 3.1 */
    double ortho_height;                  /* orthographic: world height of the image, above 0 */
    /* Instead of all above: 16 numbers, row-major, clip = matrix * (x, y, z, 1), +y up in the image. In perspective,
       depth may run either way and over any range. In an orthographic matrix it must increase away from the eye;
       distances are measured from the plane of clip depth -1, which is the near plane if depth is -1..1, lies
       far - near in front of it if depth is 0..1, and is replaced by a plane across the world's origin if there is none
       within 1e12 pixels. Borrowed for the call. */
    const double *world_to_clip;
} sps_camera;

typedef struct sps_view {
    uint32_t start_canary; /* leave 0 */
    int width, height;     /* pixels of the whole image, 1..16384 each */
    sps_camera camera;
    /* Along the camera's axis, >= 0. Nothing nearer is seen; 0 with an orthographic matrix: no near plane. */
    double near_distance;
    int region[4]; /* x, y, width, height of the part to render; all 0: the whole image */
    sps_quality quality;
    /* Slab thickness in voxels, the main trade of speed for error: error is proportional to its square. 0: from
       quality. Particles count as voxels of 0.7 times their geometric mean radius, but no smaller than about 1/500 of
       their cloud; with voxels too, the smaller of the two counts. */
    double slab;
    /* Texels on the longer side of a light's sheets, and of the depth map by which polygons shade gas, up to 16384; 0:
       from quality. The depth map, which is fitted to the gas, has at least 512, 1024, 2048 or 4096 by quality, and
       sheets of particles alone have at most that many. Shadows on polygons have no texels. */
    int shadow_size;
    int no_shadows; /* 1: as no_shadow on every light */
    /* Samples of polygons' edges along each side of a pixel, up to 8; 0 or 1: one per pixel, at its centre. With N, a
       pixel shows the polygons that N x N points see, weighted by their number, before gas that is sampled once: a
       straight edge covers a pixel to within 1 / 2N of the area, 0.5 / N^1.5 rms. Cost: all of the image, whatever the
       region, is rasterised at N x N times as many pixels, twice; every polygon beyond one that a pixel shows is
       shaded by itself. */
    int coverage_samples;
    /* Optical depth, along an eye's ray, over which gas may be lit as at the last place where its shadows were looked
       up, 0..1. 0: they are looked up at every slab. A pixel is off by no more than twice this times what its gas would
       scatter without shadow, mostly far less; 0.01 spares most lookups of thin gas. Shadows of polygons are never
       skipped. */
    float lookup_threshold;
    uint32_t end_canary; /* leave 0 */
} sps_view;

/* The caller's buffers: for a region of W x H pixels, (H - 1) * row_pixels + W of them. Written on SPS_OK only. */
typedef struct sps_image {
    /* Four floats per pixel: radiance, including the background, and coverage (1 - transmittance), without it. On a
       black background that is premultiplied alpha. */
    float *rgba;
    /* Optional, one float per pixel: mean distance from the eye along the ray, in world units, weighted by coverage;
       infinity where nothing is seen. Orthographic: from the plane through camera.position, or see world_to_clip. */
    float *depth;
    size_t row_pixels; /* pixels from one row to the next, in both; 0 means the region's width */
} sps_image;

typedef enum sps_pass {
    SPS_PASS_GATHER = 0,     /* reads relevant voxels into bricks, and particles */
    SPS_PASS_PROJECTORS,     /* reads the images that lights throw */
    SPS_PASS_EYE_POLYGONS,   /* rasterises triangles for the eye */
    SPS_PASS_LAYERS,         /* lists translucent polygons, and what edges show, pixel by pixel */
    SPS_PASS_TEXTURES,       /* calls shade_fn for the points of polygons that pixels show */
    SPS_PASS_LIGHT_POLYGONS, /* rasterises triangles into depth maps, for gas that scatters, per shadowing light without
                                penumbrae */
    SPS_PASS_TRIANGLE_TREE,  /* builds a tree of triangles for shadow rays */
    SPS_PASS_SHADOW_RAYS,    /* traces rays from polygons to each shadowing light */
    SPS_PASS_EYE_SHEETS,     /* splats voxels and particles for the eye, once per sweep */
    SPS_PASS_LIGHT_SHEETS,   /* splats voxels and particles for each shadowing light without a map */
    SPS_PASS_LIGHT_MAPS,     /* makes a transmittance map for each shadowing light with a shadow_map or a table; counts
                                tables that turn out to be held */
    SPS_PASS_PENUMBRAE,      /* follows the points of lights with an extent through the sheets */
    SPS_PASS_GRADIENT,       /* central differences across sheets */
    SPS_PASS_SCATTERING,     /* light leaving the sheets */
    SPS_PASS_EMISSION,       /* emission of volumes and particles */
    SPS_PASS_AMBIENT,        /* ambient light on gases and surfaces */
    SPS_PASS_SURFACE_LIGHT,  /* lights on polygons */
    SPS_PASS_COUNT
} sps_pass;

typedef struct sps_pass_report {
    int runs;           /* number of times that the pass runs; 0: skipped */
    const char *reason; /* why it runs or is skipped; a static string */
    size_t bytes;       /* upper bound held for this pass, without the lists that maps are made from, and layers */
} sps_pass_report;

typedef struct sps_plan_report {
    sps_pass_report pass[SPS_PASS_COUNT];
    /* Passes over the slabs: one per light that shades by sheets; without such lights, one per part of the image that
       has pixels in the region, but at least one. With particles, the choice between sheets and tables, and parts, may
       depend on where they are: then an upper bound, as are runs of the passes that depend on it. */
    int sweep_count;
    int color_channels;              /* 3, or 1 if every color that plays a part is grey */
    int sheet_channels;              /* values splatted per pixel and slab for the eye */
    int slab_count;                  /* of the longest sweep */
    int shadow_width, shadow_height; /* of the largest shadow buffer */
    int light_points; /* maximum number of points that stand for a light: 1 without an extent; 0: no light */
    uint64_t range_calls, read_calls, eval_calls, triangle_calls, particle_calls, projector_calls; /* exact */
    uint64_t voxels_read; /* exact, borders of blocks counted each time */
    /* Upper bound of all that the context will hold, with image.depth, but without layers (of pixels, and of texels of
       lights) and the lists that maps are made from, which may be several times as much. Often 2 or 3 times the actual
       size. With particles, whose extents are not known, lights' sheets and maps count with their maximum size, and the
       bound is far higher, unless shadow_size or shadow_map_size sets it. Then it holds for lights with an extent if,
       from none of their points, gas looks more than twice as wide as from their centre. */
    size_t bytes;
} sps_plan_report;

typedef struct sps_stats_report {
    /* By clock_fn, in this order: reading voxels, particles and triangles; rasterising triangles; passing their points
       to shade_fn; building their tree; tracing shadow rays through it; binning bricks and particles; the lights'
       sheets; the eye's sheets, shading and the image; all of the call. Set by sps_render; sps_reference and
       sps_tmap_finish set only seconds_total. */
    double seconds_gather, seconds_polygons, seconds_textures, seconds_tree, seconds_shadow_rays;
    double seconds_bin, seconds_light, seconds_eye, seconds_total;
    uint64_t range_calls, read_calls, eval_calls, triangle_calls, particle_calls, projector_calls, background_calls;
    uint64_t shade_calls;
    uint64_t blocks_skipped; /* not read, because range_fn showed that nothing in them matters */
    uint64_t voxels_read, voxels_relevant, bricks, values_replaced;
    uint64_t triangles, triangles_degenerate, pixels_of_polygons;
    uint64_t surface_points; /* passed to shade_fn */
    uint64_t layers;         /* of pixels: translucent polygons, and those at edges if coverage_samples is set */
    uint64_t shadow_rays;    /* from pixels' polygons towards lights */
    uint64_t particles;      /* that have a radius and an optical depth */
    /* Transmittance maps: particles that reach beyond near_depth or far_depth. message_fn is told of these, and of such
       voxels. */
    uint64_t particles_outside;
    uint64_t slabs, slabs_empty; /* over all sweeps */
    /* Footprints: voxels and particles written to a tile's chunk of slabs. Fragments: their pixels times slabs
       (particles: the pixels of their boxes). */
    uint64_t eye_footprints, eye_fragments;
    uint64_t light_footprints, light_fragments;
    uint64_t tables_made, tables_held; /* shadow tables that were made or updated, and taken over from the last call */
    /* Of all these tables: patches of up to 8 x 8 texels, of the whole depth range, that were filled, and that were
       kept from the last call. */
    uint64_t table_patches_made, table_patches_held;
    /* Texels times planes times points of lights whose penumbrae gas is shaded by; 0: all light on gas was hard. */
    uint64_t soft_texels;
    uint64_t pixels_shaded;  /* pixels times slabs that held something */
    uint64_t tiles_finished; /* tiles that became opaque before the last slab */
    uint64_t allocations;
    size_t bytes, bytes_peak; /* held now; maximum since sps_create */
} sps_stats_report;

/* The view of a light's transmittance map: perspective for a point light or a spot light, orthographic for a
   directional light. */
typedef struct sps_tmap_light {
    uint32_t start_canary; /* leave 0 */
    int width, height;     /* texels of the map, or of each of six faces, 1..16384 each; six faces are square */
    sps_camera camera;     /* copied, matrix and all */
    /* 1: six faces around camera.position, the only field of camera used then. 0: one view. If a light with one view
       lies amid voxels, those outside its view count as lit, and message_fn is told. */
    int omnidirectional;
    sps_quality quality; /* of volumes: cut of the kernels, and slabs; as in sps_view */
    double slab;         /* of volumes: thickness in voxels, as in sps_view */
    uint32_t end_canary; /* leave 0 */
} sps_tmap_light;

/* Size and settings of a map. */
typedef struct sps_tmap_info {
    int width, height;  /* texels of a face */
    int face_count;     /* 1, or 6 */
    int is_finished;    /* 1: it can be queried and uploaded */
    int item_floats;    /* floats per texel in sps_tmap_texels; deep, compressed: per interval or node */
    size_t texel_count; /* of all faces; also the length of sps_tmap_surfaces; sps_tmap_starts has one more */
    size_t float_count; /* length of sps_tmap_texels; deep, compressed: 0 before sps_tmap_finish */
    /* Held by the map. Before sps_tmap_finish, what it will hold, except for what depends on the occluders: intervals
       or nodes, and 4 per texel if anything is opaque. */
    size_t bytes;
    sps_tmap_settings settings; /* resolved: never SPS_TMAP_DEFAULT, actual components; planes belong to the map */
} sps_tmap_info;

/* Constants that a shader needs for a face of a map: a std140 block or constant buffer, 128 bytes to copy as they are.
   struct tmap in examples/shaders/ begins with the same members. The texel of a world point p = (x, y, z, 1) is
   (row_x . p, row_y . p) / (row_w . p), where whole numbers are texel centres; row_distance . p is its distance from
   the light as measured by near_depth. The rows are the matrix of sps_tmap_get_projection in floats. */
typedef struct sps_tmap_constants {
    float row_x[4], row_y[4], row_w[4], row_distance[4]; /* at bytes 0, 16, 32, 48 */
    int32_t technique, components;                       /* sps_tmap_technique; 0 components: intervals or nodes */
    int32_t has_range;  /* 1: a texel begins with the u of its first and last occluder */
    int32_t has_planes; /* 1: settings.planes is not NULL */
    int32_t cubic, running_maximum;
    int32_t has_surfaces;        /* 1: sps_tmap_surfaces is not NULL */
    int32_t width, height;       /* texels of a face */
    float near_depth, far_depth; /* u = (distance - near_depth) / (far_depth - near_depth) */
    /* A surface shades what is farther behind it than bias + bias_per_distance * distance. */
    float bias, bias_per_distance;
    int32_t face, face_count;
    int32_t padding; /* 0 */
} sps_tmap_constants;

typedef struct sps_tmap sps_tmap; /* opaque; belongs to the context it was made with */

typedef struct sps_context sps_context; /* opaque */

/* ============================================================================================ >>functions */

/* Returns the version of the compiled implementation, in the form of SPS_VERSION. */
SPS_API int sps_version(void);

/* Creates a context, which the caller must free with sps_destroy. config may be NULL: all defaults. Returns NULL on
   failure. `why` may be NULL; otherwise it receives the error, or SPS_OK. Errors: ARGUMENT (a canary of config is not
   0, only one of alloc_fn and free_fn is set, worker_count is not 0..1024), MEMORY (the allocator returned NULL, or
   memory_limit is less than a context needs). */
SPS_API sps_context *sps_create(const sps_config *config, sps_error_info *why);

/* Frees everything that the context holds. Its maps must have been destroyed before (SPS_ASSERT). NULL is allowed. */
SPS_API void sps_destroy(sps_context *context);

/* Returns one sentence about the last call on the context if that failed, "" otherwise. Never NULL. Valid until the
   next call on the context. */
SPS_API const char *sps_error(const sps_context *context);

/* The same as data. `info` is the caller's and always filled: if the last call succeeded, `result` is SPS_OK, `object`
   SPS_OBJECT_NONE, and strings are empty. If context is NULL, `result` is SPS_ERROR_ARGUMENT. */
SPS_API void sps_get_error(const sps_context *context, sps_error_info *info);

/* Reports what sps_render would run for this scene and view, and why. Calls range_fn, but reads no voxels, triangles or
   particles: slab_count is that of the volumes alone, and with particles shadow_width and shadow_height are upper
   bounds. `report` is filled on SPS_OK and zeroed otherwise. How lights shade gas is chosen as by sps_render. Volumes
   count with their whole boxes, so UNSUPPORTED (of lights without that choice), or too many slabs, may be reported
   where sps_render, which knows the voxels, succeeds. Errors: ARGUMENT, MEMORY, CALLBACK (range_fn), UNSUPPORTED. */
SPS_API sps_result sps_plan(sps_context *context, const sps_scene *scene, const sps_view *view,
                            sps_plan_report *report);

/* Renders the view's region into the caller's image. Time is about (relevant voxels) * (footprint area in pixels) *
   (slabs that a voxel touches) for the eye, the same again for each shadowing light, and a little per pixel and slab.
   The image is written only if SPS_OK is returned. Any sps_result can occur. */
SPS_API sps_result sps_render(sps_context *context, const sps_scene *scene, const sps_view *view,
                              const sps_image *image);

/* Renders the same scene by brute force, in double precision, as a reference to measure against. Marches f(p) along
   each pixel's ray with a shadow ray per light at every sample, and intersects polygons and particles exactly: a step
   has the optical depth of the balls along it, lit as at its middle. `step`, > 0, is in voxels, or in units of 0.7
   times the particles' geometric mean radius if that is less; the error is second order in it. No slicing limit: any
   light, any camera. Holds all voxels, triangles and particles in memory, 68 bytes per particle, and 144 bytes per
   pixel of the region. Particles smaller than a pixel are not widened. With coverage_samples, each of a pixel's rays is
   marched by itself, through gas as well; only the background is that at the pixel's centre. shade_fn is called for the
   nearest polygons of all pixels, then for those seen through these, and so on; all of it again for each sample. The
   image is written only if SPS_OK is returned. Any sps_result can occur. */
SPS_API sps_result sps_reference(sps_context *context, const sps_scene *scene, const sps_view *view, double step,
                                 const sps_image *image);

/* Fills a report of what the last sps_render, sps_reference, sps_plan or sps_tmap_create, _add, _finish did, even if it
   failed. Footprints splatted into maps are not counted. If context is NULL, all of the report is 0. */
SPS_API void sps_get_stats(const sps_context *context, sps_stats_report *report);

/* Returns a short lower-case name of a pass ("light sheets"), a static string; never NULL. */
SPS_API const char *sps_pass_name(sps_pass pass);

/* The read_fn and range_fn of a volume whose `user` is an sps_grid. sps_grid_range looks at each voxel of the block,
   and writes 0..1e18 if one is not finite, negative or above 1e18. Threads: see sps_grid. Where read_fn is
   sps_grid_read, the library checks the grid first and fails with ARGUMENT and a field such as "grid.scale"; the codes
   below are for callbacks that wrap these functions. Both return 0, or 1: grid or its voxels are NULL, a canary is not
   0, a size is below 1, the format is unknown, or scale or offset is not finite; 2: the block reaches beyond the grid.
 */
SPS_API int sps_grid_read(void *grid, const int lo[3], const int size[3], float *out);
SPS_API int sps_grid_range(void *grid, const int lo[3], const int size[3], float out_min_max[2]);

/* The read_fn of a mesh whose `user` is an sps_indexed_mesh. Leaves normals and colors that it does not have as they
   are in `out`. Threads: see sps_grid. Where this is read_fn, the library checks everything except for the indices
   first and fails with ARGUMENT and a field such as "arrays.positions"; codes 1 and 2 are for callbacks that wrap this
   function. Returns 0, or 1: indexed or its positions are NULL, a canary is not 0, vertex_count is 0, or both kinds of
   indices are set; 2: it has fewer triangles than are to be read; 3, with which the call fails as CALLBACK: an index is
   not below vertex_count. */
SPS_API int sps_indexed_mesh_read(void *indexed, size_t first, size_t count, sps_triangle *out);

/* Creates a transmittance map, in which an engine looks up shadows: add occluders, finish, query. The caller must free
   it with sps_tmap_destroy. Everything that settings and light point to is copied. A call on a map counts as a call on
   its context, except for queries and others that only read the map. Errors: ARGUMENT, MEMORY (also byte_budget); *map
   is NULL then. */
SPS_API sps_result sps_tmap_create(sps_context *context, const sps_tmap_light *light, const sps_tmap_settings *settings,
                                   sps_tmap **map);

/* Adds the volumes, meshes and particles of a scene; its lights and background are checked but not used. These structs
   are copied; what they point to is borrowed until sps_tmap_finish, which reads it. May be called any number of times
   before that. Errors: ARGUMENT (the map is finished; a field of the scene), MEMORY. */
SPS_API sps_result sps_tmap_add(sps_tmap *map, const sps_scene *scene);

/* Reads the occluders' data and makes the map: along each texel's ray, every particle at its chord, every voxel's
   kernel cut at slabs perpendicular to the light's axis, every triangle where it is. Time is about occluders * texels
   under them * components. Memory, on top of the map's: 160 bytes per particle, and 4 bytes per component of 64 rows of
   texels, or 16 bytes for every interval in these; growing lists need up to one and a half times their size in
   addition. Techniques made from lists need, per worker, 0.1 KB for each interval of the fullest texel (0.5 KB if
   particles are soft), and 18 KB for a compressed map. After a failure the map can only be destroyed. Errors: ARGUMENT
   (finished already), and all those of sps_render. */
SPS_API sps_result sps_tmap_finish(sps_tmap *map);

/* Writes the optical depth between the light and each of `count` world positions (packed triples), and exp(-that);
   either array may be NULL. Gas is interpolated between four texels; surfaces shade by the fraction of these that they
   cover. Optical depth is 0, and transmittance 1, outside the map, behind the light, before near_depth, and for a
   position that is not finite; 1e15 and 0 behind surfaces that cover all four texels. May be called from many threads,
   and therefore records no error in the context. Errors, which leave both arrays untouched: ARGUMENT (map is NULL or
   not finished; positions is NULL and count is not 0). */
SPS_API sps_result sps_tmap_query(const sps_tmap *map, size_t count, const double *positions, float *optical_depths,
                                  float *transmittances);

/* The same for positions in floats, as in vertex buffers: x, y, z, with `stride` bytes from one position to the next
   (0: 12, packed). They need not be aligned. */
SPS_API sps_result sps_tmap_query_floats(const sps_tmap *map, size_t count, const float *positions, size_t stride,
                                         float *optical_depths, float *transmittances);

/* Writes bounds of the true optical depth along the rays of the texels, certain except for round-off: for deep,
   compressed, opacity, deep opacity and moment maps. 0 and 1e15 for the others, which have no bounds. Of volumes they
   bound the field of the kernels as `quality` cuts them, slab by slab. It differs from f(p) itself by what lies beyond
   the cut: at medium up to 0.9 % of the optical depth through the fullest voxels near the ray and 0.5 % of its own
   (draft 3 and 2 %, high and ultra 0.2 and 0.1 %). No bracket includes that: choose a higher quality. least or most may
   be NULL. Threads and errors as for sps_tmap_query. */
SPS_API sps_result sps_tmap_bracket(const sps_tmap *map, size_t count, const double *positions, float *least,
                                    float *most);

/* Returns the texels for an engine to upload, rows from the top. `components` floats each; for a deep map intervals
   (u0, u1, optical depth, 1 if densest in the middle), for a compressed map nodes (u, transmittance), texel after
   texel. An interval may begin before 0 or end behind 1, since a particle that is cut keeps its shape: what is before 0
   counts at 0, and at u = 1 all of it counts. If the light is inside a soft particle, the fourth number is less than 1:
   only the last part of its chord, that fraction of it, counts, and u0 is where that begins. Six faces follow each
   other, +x -x +y -y +z -z, columns and rows along the next two axes, y z, z x or x y; the centres of the outermost
   texels lie on the cube's edges, so this is not a hardware cube map. Valid until sps_tmap_destroy; NULL before
   sps_tmap_finish. examples/shaders/ has the code that samples them as sps_tmap_query does. */
SPS_API const float *sps_tmap_texels(const sps_tmap *map);

/* Deep and compressed maps: returns the index of each texel's first interval or node, followed by the number of all.
   Valid as sps_tmap_texels. NULL for other maps. */
SPS_API const uint32_t *sps_tmap_starts(const sps_tmap *map);

/* Returns u of each texel's first opaque surface, one float per texel in the same order: below 0 before near_depth,
   1e30 if there is no surface. Valid as sps_tmap_texels. NULL if the whole map has no surface. */
SPS_API const float *sps_tmap_surfaces(const sps_tmap *map);

/* Writes the projection of world points onto a face of the map (0, or 0..5): row-major, (X, Y, D, W) = matrix * (x, y,
   z, 1). The texel is (X / W, Y / W), where whole numbers are texel centres. D is the distance from the light as
   measured by near_depth; the point lies behind the light unless W > 0. A surface shades what is more than bias[0] +
   bias[1] * D behind it, in the same units. matrix or bias may be NULL. Errors, which leave both untouched: ARGUMENT
   (map is NULL or not finished, or has no such face). */
SPS_API sps_result sps_tmap_get_projection(const sps_tmap *map, int face, double matrix[16], double bias[2]);

/* Fills the constants for a shader that reads a face of the map (0, or 0..5). Only the rows and `face` depend on the
   face. Errors, which leave them untouched: ARGUMENT (map is NULL or not finished, or has no such face; constants is
   NULL). */
SPS_API sps_result sps_tmap_get_constants(const sps_tmap *map, int face, sps_tmap_constants *constants);

/* Writes size and settings of the map, finished or not. Errors, which leave info untouched: ARGUMENT (either is NULL).
 */
SPS_API sps_result sps_tmap_get_info(const sps_tmap *map, sps_tmap_info *info);

/* Frees the map, which must be done before its context is destroyed. NULL is allowed. */
SPS_API void sps_tmap_destroy(sps_tmap *map);

#ifdef __cplusplus
}
#endif
#endif /* SPLATSHADOW_H */

#ifdef SPLATSHADOW_IMPLEMENTATION
#ifndef SPSI_IMPLEMENTED /* the header may be included again below its implementation */
#define SPSI_IMPLEMENTED

/* =============================================================================================== >>config
   1  Macros and the C library. Everything used from libc is named here. */

#if defined(__FAST_MATH__) || defined(_M_FP_FAST) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0)
#ifndef SPS_ALLOW_FAST_MATH
#error "fast-math leaves out the checks for invalid data: compile without it, or define SPS_ALLOW_FAST_MATH"
#endif
#endif

#include <float.h>
#include <math.h>
#include <string.h>
#ifndef SPS_ASSERT
#include <assert.h>
#define SPS_ASSERT(c) assert(c)
#endif
#ifndef SPS_MALLOC
#include <stdlib.h>
#define SPS_MALLOC(n) malloc(n)
#define SPS_FREE(p)   free(p)
#elif !defined(SPS_FREE)
#error "SPS_MALLOC is defined, and SPS_FREE is not"
#endif
#ifndef SPS_SNPRINTF
#include <stdio.h>
#define SPS_SNPRINTF snprintf
#endif

#define SPSI_PI       3.14159265358979323846
#define SPSI_INFINITY ((float)HUGE_VAL)

#define SPSI_SIZE_MAX       16384     /* pixels or texels on a side; 2^28 of them fit an int */
#define SPSI_SLABS_MAX      (1 << 20) /* with this many, lookups along the eye's rays resolve a sixteenth of a slab */
#define SPSI_VOLUMES_MAX    64
#define SPSI_SETS_MAX       64 /* of particles */
#define SPSI_MATERIALS_MAX  (SPSI_VOLUMES_MAX + SPSI_SETS_MAX)
#define SPSI_LOBES_MAX      8
#define SPSI_WORKERS_MAX    1024
#define SPSI_FACES_MAX      (1 << 29) /* four numbers of each still fit an int */
#define SPSI_PARTICLES_MAX  (1 << 29)
#define SPSI_VALUE_MAX      1e18f  /* larger values could overflow when multiplied by extinction and length */
#define SPSI_COORDINATE_MAX 1e15   /* products of squares of it do not overflow a double */
#define SPSI_VALUE_MIN      1e-30f /* smaller values would only make denormal numbers */
#define SPSI_RADIANCE_MAX   1e30f  /* cap of a sheet's emission, so that sums stay finite */
#define SPSI_DEPTH_MAX      1e15f  /* cap of optical depth, and a polygon's optical depth; exp(-86) is already 0 here */
#define SPSI_LIGHT_END      16.0f  /* optical depth at which a light is no longer followed: 1e-7 of it is left */
#define SPSI_POINTS_MAX     256    /* that stand for an extended light */
#define SPSI_IMAGE_SIZE_MAX 4096   /* of an image that a light throws */

#define SPSI_TILE_WIDTH  64 /* pixels; a tile's sheets stay in the level-2 cache, measured best on 512 KiB */
#define SPSI_TILE_HEIGHT 64
#define SPSI_PATCH       8  /* pixels on a side of a patch: a tile has 8 x 8 of them, one bit each in a uint64_t */
#define SPSI_CHUNK       16 /* slabs splatted in one visit of a voxel */
#define SPSI_BRICK       8  /* voxels along the edge of a brick, the unit of binning */
#define SPSI_BLOCK       32 /* voxels along the edge of a block, the unit of reading */
#define SPSI_MARGIN      3  /* voxels around a block that decide which of its voxels a transfer function shows */

/* ================================================================================================= >>simd
   2  Vectors of floats: spsi_v holds SPSI_LANES floats, spsi_m a boolean for each. All code below is written once, for
   any width. Lanes never mix, so results do not depend on the width except for the rounding of fused multiply-add. Only
   this section names instruction sets. */

#if !defined(SPS_NO_SIMD) && defined(__AVX512F__)
#define SPSI_SIMD_AVX512
#include <immintrin.h>
#elif !defined(SPS_NO_SIMD) && defined(__AVX2__) && (defined(__FMA__) || defined(_MSC_VER))
#define SPSI_SIMD_AVX2
#include <immintrin.h>
#elif !defined(SPS_NO_SIMD) && (defined(__SSE2__) || defined(_M_X64))
#define SPSI_SIMD_SSE2
#include <emmintrin.h>
#elif !defined(SPS_NO_SIMD) && (defined(__ARM_NEON) && defined(__aarch64__) || defined(_M_ARM64))
#define SPSI_SIMD_NEON
#include <arm_neon.h>
#endif

#if defined(SPSI_SIMD_AVX512)
#define SPSI_LANES 16
typedef __m512 spsi_v;
typedef __mmask16 spsi_m;
static inline spsi_v spsi_set(float a) { return _mm512_set1_ps(a); }
static inline spsi_v spsi_load(const float *p) { return _mm512_loadu_ps(p); }
static inline void spsi_store(float *p, spsi_v a) { _mm512_storeu_ps(p, a); }
static inline spsi_v spsi_add(spsi_v a, spsi_v b) { return _mm512_add_ps(a, b); }
static inline spsi_v spsi_sub(spsi_v a, spsi_v b) { return _mm512_sub_ps(a, b); }
static inline spsi_v spsi_mul(spsi_v a, spsi_v b) { return _mm512_mul_ps(a, b); }
static inline spsi_v spsi_div(spsi_v a, spsi_v b) { return _mm512_div_ps(a, b); }
static inline spsi_v spsi_fma(spsi_v a, spsi_v b, spsi_v c) { return _mm512_fmadd_ps(a, b, c); }
static inline spsi_v spsi_min(spsi_v a, spsi_v b) { return _mm512_min_ps(a, b); }
static inline spsi_v spsi_max(spsi_v a, spsi_v b) { return _mm512_max_ps(a, b); }
static inline spsi_v spsi_sqrt(spsi_v a) { return _mm512_sqrt_ps(a); }
static inline spsi_v spsi_round(spsi_v a) { return _mm512_roundscale_ps(a, 8); }
static inline spsi_v spsi_floor(spsi_v a) { return _mm512_roundscale_ps(a, 9); }
static inline spsi_v spsi_pow2(spsi_v n) {
    const __m512i e = _mm512_add_epi32(_mm512_cvtps_epi32(n), _mm512_set1_epi32(127));
    return _mm512_castsi512_ps(_mm512_slli_epi32(e, 23));
}
static inline spsi_m spsi_less(spsi_v a, spsi_v b) { return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ); }
static inline spsi_m spsi_and(spsi_m a, spsi_m b) { return (spsi_m)(a & b); }
static inline int spsi_bits(spsi_m m) { return (int)m; }
static inline spsi_v spsi_select(spsi_m m, spsi_v a, spsi_v b) { return _mm512_mask_blend_ps(m, b, a); }
static inline void spsi_store_int(int *p, spsi_v a) { _mm512_storeu_si512(p, _mm512_cvtps_epi32(a)); }
static inline spsi_v spsi_iota(void) { return _mm512_set_ps(15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0); }
static inline spsi_v spsi_lookup(const float *grid, int stride, spsi_v x, spsi_v y) {
    const __m512i row = _mm512_mullo_epi32(_mm512_cvttps_epi32(y), _mm512_set1_epi32(stride));
    return _mm512_i32gather_ps(_mm512_add_epi32(row, _mm512_cvttps_epi32(x)), grid, 4);
}
static inline void spsi_lookup_pair(const uint32_t *grid, int stride, spsi_v x, spsi_v y, spsi_v pair[2]) {
    const __m512i row = _mm512_mullo_epi32(_mm512_cvttps_epi32(y), _mm512_set1_epi32(stride));
    const __m512i both = _mm512_i32gather_epi32(_mm512_add_epi32(row, _mm512_cvttps_epi32(x)), grid, 4);
    pair[0] = _mm512_cvtepi32_ps(_mm512_and_si512(both, _mm512_set1_epi32(0xffff)));
    pair[1] = _mm512_cvtepi32_ps(_mm512_srli_epi32(both, 16));
}
/* As the general ones below: all of a vector if `count` is more than it holds. */
static inline spsi_m spsi_first(int count) { return (spsi_m)(count < 16 ? (1u << count) - 1 : 0xffffu); }
static inline spsi_v spsi_load_first(const float *p, int count) { return _mm512_maskz_loadu_ps(spsi_first(count), p); }
static inline void spsi_store_first(float *p, spsi_v a, int count) { _mm512_mask_storeu_ps(p, spsi_first(count), a); }
#define SPSI_HAS_FIRST
#define SPSI_HAS_LOOKUP

#elif defined(SPSI_SIMD_AVX2)
#define SPSI_LANES 8
typedef __m256 spsi_v;
typedef __m256 spsi_m;
static inline spsi_v spsi_set(float a) { return _mm256_set1_ps(a); }
static inline spsi_v spsi_load(const float *p) { return _mm256_loadu_ps(p); }
static inline void spsi_store(float *p, spsi_v a) { _mm256_storeu_ps(p, a); }
static inline spsi_v spsi_add(spsi_v a, spsi_v b) { return _mm256_add_ps(a, b); }
static inline spsi_v spsi_sub(spsi_v a, spsi_v b) { return _mm256_sub_ps(a, b); }
static inline spsi_v spsi_mul(spsi_v a, spsi_v b) { return _mm256_mul_ps(a, b); }
static inline spsi_v spsi_div(spsi_v a, spsi_v b) { return _mm256_div_ps(a, b); }
static inline spsi_v spsi_fma(spsi_v a, spsi_v b, spsi_v c) { return _mm256_fmadd_ps(a, b, c); }
static inline spsi_v spsi_min(spsi_v a, spsi_v b) { return _mm256_min_ps(a, b); }
static inline spsi_v spsi_max(spsi_v a, spsi_v b) { return _mm256_max_ps(a, b); }
static inline spsi_v spsi_sqrt(spsi_v a) { return _mm256_sqrt_ps(a); }
static inline spsi_v spsi_round(spsi_v a) { return _mm256_round_ps(a, 8); }
static inline spsi_v spsi_floor(spsi_v a) { return _mm256_floor_ps(a); }
static inline spsi_v spsi_pow2(spsi_v n) {
    const __m256i e = _mm256_add_epi32(_mm256_cvtps_epi32(n), _mm256_set1_epi32(127));
    return _mm256_castsi256_ps(_mm256_slli_epi32(e, 23));
}
static inline spsi_m spsi_less(spsi_v a, spsi_v b) { return _mm256_cmp_ps(a, b, _CMP_LT_OQ); }
static inline spsi_m spsi_and(spsi_m a, spsi_m b) { return _mm256_and_ps(a, b); }
static inline int spsi_bits(spsi_m m) { return _mm256_movemask_ps(m); }
static inline spsi_v spsi_select(spsi_m m, spsi_v a, spsi_v b) { return _mm256_blendv_ps(b, a, m); }
static inline void spsi_store_int(int *p, spsi_v a) {
    _mm256_storeu_si256((__m256i *)(void *)p, _mm256_cvtps_epi32(a));
}
static inline spsi_v spsi_iota(void) { return _mm256_set_ps(7, 6, 5, 4, 3, 2, 1, 0); }
static inline spsi_v spsi_lookup(const float *grid, int stride, spsi_v x, spsi_v y) {
    const __m256i row = _mm256_mullo_epi32(_mm256_cvttps_epi32(y), _mm256_set1_epi32(stride));
    return _mm256_i32gather_ps(grid, _mm256_add_epi32(row, _mm256_cvttps_epi32(x)), 4);
}
static inline void spsi_lookup_pair(const uint32_t *grid, int stride, spsi_v x, spsi_v y, spsi_v pair[2]) {
    const __m256i row = _mm256_mullo_epi32(_mm256_cvttps_epi32(y), _mm256_set1_epi32(stride));
    const __m256i at = _mm256_add_epi32(row, _mm256_cvttps_epi32(x));
    const __m256i both = _mm256_i32gather_epi32((const int *)(const void *)grid, at, 4);
    pair[0] = _mm256_cvtepi32_ps(_mm256_and_si256(both, _mm256_set1_epi32(0xffff)));
    pair[1] = _mm256_cvtepi32_ps(_mm256_srli_epi32(both, 16));
}
static inline __m256i spsi_first(int count) {
    return _mm256_cmpgt_epi32(_mm256_set1_epi32(count), _mm256_set_epi32(7, 6, 5, 4, 3, 2, 1, 0));
}
static inline spsi_v spsi_load_first(const float *p, int count) { return _mm256_maskload_ps(p, spsi_first(count)); }
static inline void spsi_store_first(float *p, spsi_v a, int count) { _mm256_maskstore_ps(p, spsi_first(count), a); }
#define SPSI_HAS_FIRST
#define SPSI_HAS_LOOKUP

#elif defined(SPSI_SIMD_SSE2)
#define SPSI_LANES 4
typedef __m128 spsi_v;
typedef __m128 spsi_m;
static inline spsi_v spsi_set(float a) { return _mm_set1_ps(a); }
static inline spsi_v spsi_load(const float *p) { return _mm_loadu_ps(p); }
static inline void spsi_store(float *p, spsi_v a) { _mm_storeu_ps(p, a); }
static inline spsi_v spsi_add(spsi_v a, spsi_v b) { return _mm_add_ps(a, b); }
static inline spsi_v spsi_sub(spsi_v a, spsi_v b) { return _mm_sub_ps(a, b); }
static inline spsi_v spsi_mul(spsi_v a, spsi_v b) { return _mm_mul_ps(a, b); }
static inline spsi_v spsi_div(spsi_v a, spsi_v b) { return _mm_div_ps(a, b); }
static inline spsi_v spsi_fma(spsi_v a, spsi_v b, spsi_v c) { return _mm_add_ps(_mm_mul_ps(a, b), c); }
static inline spsi_v spsi_min(spsi_v a, spsi_v b) { return _mm_min_ps(a, b); }
static inline spsi_v spsi_max(spsi_v a, spsi_v b) { return _mm_max_ps(a, b); }
static inline spsi_v spsi_sqrt(spsi_v a) { return _mm_sqrt_ps(a); }
static inline spsi_v spsi_round(spsi_v a) { return _mm_cvtepi32_ps(_mm_cvtps_epi32(a)); }
static inline spsi_v spsi_pow2(spsi_v n) {
    const __m128i e = _mm_add_epi32(_mm_cvtps_epi32(n), _mm_set1_epi32(127));
    return _mm_castsi128_ps(_mm_slli_epi32(e, 23));
}
static inline spsi_m spsi_less(spsi_v a, spsi_v b) { return _mm_cmplt_ps(a, b); }
static inline spsi_m spsi_and(spsi_m a, spsi_m b) { return _mm_and_ps(a, b); }
static inline int spsi_bits(spsi_m m) { return _mm_movemask_ps(m); }
static inline spsi_v spsi_select(spsi_m m, spsi_v a, spsi_v b) {
    return _mm_or_ps(_mm_and_ps(m, a), _mm_andnot_ps(m, b));
}
static inline void spsi_store_int(int *p, spsi_v a) { _mm_storeu_si128((__m128i *)(void *)p, _mm_cvtps_epi32(a)); }
static inline spsi_v spsi_iota(void) { return _mm_set_ps(3, 2, 1, 0); }

#elif defined(SPSI_SIMD_NEON)
#define SPSI_LANES 4
typedef float32x4_t spsi_v;
typedef uint32x4_t spsi_m;
static inline spsi_v spsi_set(float a) { return vdupq_n_f32(a); }
static inline spsi_v spsi_load(const float *p) { return vld1q_f32(p); }
static inline void spsi_store(float *p, spsi_v a) { vst1q_f32(p, a); }
static inline spsi_v spsi_add(spsi_v a, spsi_v b) { return vaddq_f32(a, b); }
static inline spsi_v spsi_sub(spsi_v a, spsi_v b) { return vsubq_f32(a, b); }
static inline spsi_v spsi_mul(spsi_v a, spsi_v b) { return vmulq_f32(a, b); }
static inline spsi_v spsi_div(spsi_v a, spsi_v b) { return vdivq_f32(a, b); }
static inline spsi_v spsi_fma(spsi_v a, spsi_v b, spsi_v c) { return vfmaq_f32(c, a, b); }
static inline spsi_v spsi_min(spsi_v a, spsi_v b) { return vminnmq_f32(a, b); }
static inline spsi_v spsi_max(spsi_v a, spsi_v b) { return vmaxnmq_f32(a, b); }
static inline spsi_v spsi_sqrt(spsi_v a) { return vsqrtq_f32(a); }
static inline spsi_v spsi_round(spsi_v a) { return vrndnq_f32(a); }
static inline spsi_v spsi_floor(spsi_v a) { return vrndmq_f32(a); }
static inline spsi_v spsi_pow2(spsi_v n) {
    return vreinterpretq_f32_s32(vshlq_n_s32(vaddq_s32(vcvtq_s32_f32(n), vdupq_n_s32(127)), 23));
}
static inline spsi_m spsi_less(spsi_v a, spsi_v b) { return vcltq_f32(a, b); }
static inline spsi_m spsi_and(spsi_m a, spsi_m b) { return vandq_u32(a, b); }
static inline int spsi_bits(spsi_m m) {
    const uint32_t weights[4] = {1, 2, 4, 8};
    return (int)vaddvq_u32(vandq_u32(m, vld1q_u32(weights)));
}
static inline spsi_v spsi_select(spsi_m m, spsi_v a, spsi_v b) { return vbslq_f32(m, a, b); }
static inline void spsi_store_int(int *p, spsi_v a) { vst1q_s32(p, vcvtnq_s32_f32(a)); }
static inline spsi_v spsi_iota(void) {
    const float numbers[4] = {0, 1, 2, 3};
    return vld1q_f32(numbers);
}

#else
#define SPSI_LANES 1
typedef float spsi_v;
typedef int spsi_m;
static inline spsi_v spsi_set(float a) { return a; }
static inline spsi_v spsi_load(const float *p) { return *p; }
static inline void spsi_store(float *p, spsi_v a) { *p = a; }
static inline spsi_v spsi_add(spsi_v a, spsi_v b) { return a + b; }
static inline spsi_v spsi_sub(spsi_v a, spsi_v b) { return a - b; }
static inline spsi_v spsi_mul(spsi_v a, spsi_v b) { return a * b; }
static inline spsi_v spsi_div(spsi_v a, spsi_v b) { return a / b; }
static inline spsi_v spsi_fma(spsi_v a, spsi_v b, spsi_v c) { return a * b + c; }
static inline spsi_v spsi_min(spsi_v a, spsi_v b) { return a < b ? a : b; }
static inline spsi_v spsi_max(spsi_v a, spsi_v b) { return a > b ? a : b; }
static inline spsi_v spsi_sqrt(spsi_v a) { return sqrtf(a); }
static inline spsi_v spsi_round(spsi_v a) { return (float)(int)(a < 0 ? a - 0.5f : a + 0.5f); }
static inline spsi_v spsi_pow2(spsi_v n) {
    const uint32_t bits = (uint32_t)((int)n + 127) << 23;
    float result;
    memcpy(&result, &bits, sizeof result);
    return result;
}
static inline spsi_m spsi_less(spsi_v a, spsi_v b) { return a < b; }
static inline spsi_m spsi_and(spsi_m a, spsi_m b) { return a & b; }
static inline int spsi_bits(spsi_m m) { return m; }
static inline spsi_v spsi_select(spsi_m m, spsi_v a, spsi_v b) { return m ? a : b; }
static inline void spsi_store_int(int *p, spsi_v a) { *p = (int)a; } /* only called with whole numbers */
static inline spsi_v spsi_iota(void) { return 0; }
#endif

/* Zeroes the upper bits of wide registers, above the first 128. Compilers do that before function calls, but gcc 12
   sometimes omits it after it has copied a struct through such a register. As long as they are not zero, each call of
   a C library function compiled for SSE, such as fmin, takes tens of times as long on some processors. */
#if defined(SPSI_SIMD_AVX512) || defined(SPSI_SIMD_AVX2)
static inline void spsi_zero_upper(void) { _mm256_zeroupper(); }
#else
static inline void spsi_zero_upper(void) {}
#endif

#ifndef SPSI_HAS_FIRST
/* Loads the first `count` lanes only, if there are fewer than SPSI_LANES; the others are 0. */
static inline spsi_v spsi_load_first(const float *p, int count) {
    float lanes[SPSI_LANES] = {0};
    if (count >= SPSI_LANES) return spsi_load(p);
    memcpy(lanes, p, (size_t)count * sizeof(float));
    return spsi_load(lanes);
}

static inline void spsi_store_first(float *p, spsi_v a, int count) {
    float lanes[SPSI_LANES];
    if (count >= SPSI_LANES) {
        spsi_store(p, a);
        return;
    }
    spsi_store(lanes, a);
    memcpy(p, lanes, (size_t)count * sizeof(float));
}
#endif

#if defined(SPSI_SIMD_SSE2) || SPSI_LANES == 1
/* Rounds down, for |a| < 2^30. */
static inline spsi_v spsi_floor(spsi_v a) {
    const spsi_v r = spsi_round(a);
    return spsi_select(spsi_less(a, r), spsi_sub(r, spsi_set(1)), r);
}
#endif

#ifndef SPSI_HAS_LOOKUP
/* Gathers grid[y * stride + x], per lane, for whole-numbered x and y. */
static inline spsi_v spsi_lookup(const float *grid, int stride, spsi_v x, spsi_v y) {
    float xs[SPSI_LANES], ys[SPSI_LANES];
    spsi_store(xs, x);
    spsi_store(ys, y);
    for (int i = 0; i < SPSI_LANES; ++i) xs[i] = grid[(ptrdiff_t)ys[i] * stride + (ptrdiff_t)xs[i]];
    return spsi_load(xs);
}

/* Gathers pairs of 16-bit numbers, per lane: the low and the high half of grid[y * stride + x]. */
static inline void spsi_lookup_pair(const uint32_t *grid, int stride, spsi_v x, spsi_v y, spsi_v pair[2]) {
    float xs[SPSI_LANES], ys[SPSI_LANES];
    spsi_store(xs, x);
    spsi_store(ys, y);
    for (int i = 0; i < SPSI_LANES; ++i) {
        const uint32_t both = grid[(ptrdiff_t)ys[i] * stride + (ptrdiff_t)xs[i]];
        xs[i] = (float)(both & 0xffff);
        ys[i] = (float)(both >> 16);
    }
    pair[0] = spsi_load(xs);
    pair[1] = spsi_load(ys);
}
#endif

/* Gathers the four neighbours (x,y), (x+1,y), (x,y+1), (x+1,y+1) for a bilinear lookup. */
static inline void spsi_lookup_quad(const float *grid, int stride, spsi_v x, spsi_v y, spsi_v quad[4]) {
    quad[0] = spsi_lookup(grid, stride, x, y);
    quad[1] = spsi_lookup(grid + 1, stride, x, y);
    quad[2] = spsi_lookup(grid + stride, stride, x, y);
    quad[3] = spsi_lookup(grid + stride + 1, stride, x, y);
}

/* Prefetches memory that will be read soon, if the compiler has a way to. */
static inline void spsi_prefetch(const void *data, size_t size) {
#if defined(__GNUC__)
    for (size_t i = 0; i < size; i += 64) __builtin_prefetch((const char *)data + i);
#else
    (void)data, (void)size;
#endif
}

static inline spsi_v spsi_clamp(spsi_v a, spsi_v low, spsi_v high) { return spsi_max(low, spsi_min(a, high)); }
static inline spsi_v spsi_abs(spsi_v a) { return spsi_max(a, spsi_sub(spsi_set(0), a)); }
static inline spsi_v spsi_mix(spsi_v a, spsi_v b, spsi_v t) { return spsi_fma(spsi_sub(b, a), t, a); }

static inline void spsi_set3(const double from[3], spsi_v to[3]) {
    for (int i = 0; i < 3; ++i) to[i] = spsi_set((float)from[i]);
}

static inline spsi_v spsi_dot_v(const spsi_v a[3], const spsi_v b[3]) {
    return spsi_fma(a[0], b[0], spsi_fma(a[1], b[1], spsi_mul(a[2], b[2])));
}

/* Bilinear lookup, clamped to the edge (whose texels are 0 in most grids). */
static inline spsi_v spsi_bilinear(const float *grid, int width, int height, spsi_v x, spsi_v y) {
    const spsi_v cx = spsi_clamp(x, spsi_set(0), spsi_set((float)(width - 1)));
    const spsi_v cy = spsi_clamp(y, spsi_set(0), spsi_set((float)(height - 1)));
    const spsi_v ix = spsi_min(spsi_floor(cx), spsi_set((float)(width - 2)));
    const spsi_v iy = spsi_min(spsi_floor(cy), spsi_set((float)(height - 2)));
    const spsi_v fx = spsi_sub(cx, ix), fy = spsi_sub(cy, iy);
    spsi_v quad[4];
    spsi_lookup_quad(grid, width, ix, iy, quad);
    return spsi_mix(spsi_mix(quad[0], quad[1], fx), spsi_mix(quad[2], quad[3], fx), fy);
}

/* e^x with a relative error of 2e-7 for -86 < x < 88; exactly 0 below, so that no denormal numbers arise.
   x = n ln 2 + r; the polynomial in r was fitted for this library (maximum relative error 1.1e-7). */
static inline spsi_v spsi_exp(spsi_v x) {
    const spsi_v inside = spsi_clamp(x, spsi_set(-87.0f), spsi_set(88.0f));
    const spsi_v n = spsi_round(spsi_mul(inside, spsi_set(1.44269504f)));
    spsi_v r = spsi_fma(n, spsi_set(-0.693359375f), inside);
    spsi_v p = spsi_set(0.008261530995f);
    r = spsi_fma(n, spsi_set(2.12194440e-4f), r);
    p = spsi_fma(p, r, spsi_set(0.04189873203f));
    p = spsi_fma(p, r, spsi_set(0.1666811427f));
    p = spsi_fma(p, r, spsi_set(0.4999914103f));
    p = spsi_fma(p, r, spsi_set(0.9999995317f));
    p = spsi_fma(p, r, spsi_set(1.0f));
    return spsi_select(spsi_less(x, spsi_set(-86.0f)), spsi_set(0), spsi_mul(p, spsi_pow2(n)));
}

/* ================================================================================================ >>maths
   3  Vectors and matrices in double precision: all placement is done with these, relative to the camera or to the first
   slab, before anything becomes a float. */

static double spsi_dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static double spsi_length(const double a[3]) { return sqrt(spsi_dot(a, a)); }

/* a b + c with the same bits wherever it is computed: a compiler may fuse product and sum in one place and not in
   another. Fused explicitly where the hardware can; elsewhere the product goes through memory. */
static inline double spsi_multiply_add(double a, double b, double c) {
#if defined(FP_FAST_FMA) || defined(__FMA__) || defined(__ARM_FEATURE_FMA)
    return fma(a, b, c);
#else
    const volatile double product = a * b;
    return product + c;
#endif
}

/* The upper 26 bits of a number. [Veltkamp, in Dekker 1971] */
static double spsi_upper_half(double a) {
    const volatile double scaled = 134217729 * a, rest = scaled - a;
    return scaled - rest;
}

/* The rounding error of a product. Products of halves are exact, so fusing them changes nothing. [Dekker 1971] */
static double spsi_product_rest(double a, double b, double product) {
    const double a0 = spsi_upper_half(a), b0 = spsi_upper_half(b), a1 = a - a0, b1 = b - b0;
    return a0 * b0 - product + a0 * b1 + a1 * b0 + a1 * b1;
}

/* The exact sign of a b - c d. Rounding is monotonic: if the rounded products differ, so do the exact ones in the same
   way; otherwise their rounding errors decide. */
static int spsi_sign_of_difference(double a, double b, double c, double d) {
    const volatile double first = a * b, second = c * d;
    double p = first, q = second;
    if (!(p < q || p > q)) {
        const double rest = spsi_product_rest(a, b, p);
        q = spsi_product_rest(c, d, q);
        p = rest;
    }
    return (p > q) - (p < q);
}

static void spsi_cross(const double a[3], const double b[3], double out[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* out = a + t b */
static void spsi_along(const double a[3], const double b[3], double t, double out[3]) {
    for (int i = 0; i < 3; ++i) out[i] = a[i] + t * b[i];
}

/* Scales a to length 1 without overflow or underflow; returns 0, and leaves a alone, if it has no direction. */
static int spsi_normalise(double a[3]) {
    const double square = spsi_dot(a, a);
    double largest, length;
    if (square > 1e-200 && square < 1e200) { /* nearly always, and cheap: one division and one root */
        length = 1 / sqrt(square);
        for (int i = 0; i < 3; ++i) a[i] *= length;
        return 1;
    }
    largest = fmax(fabs(a[0]), fmax(fabs(a[1]), fabs(a[2])));
    if (!(largest > 0) || !(largest <= DBL_MAX) || !(spsi_dot(a, a) >= 0)) return 0; /* fmax passes over NaN */
    for (int i = 0; i < 3; ++i) a[i] /= largest;
    length = spsi_length(a);
    for (int i = 0; i < 3; ++i) a[i] /= length;
    return 1;
}

/* Two unit vectors perpendicular to the unit vector n; `x` is near the coordinate axis along which n is smallest. */
static void spsi_basis(const double n[3], double x[3], double y[3]) {
    const double ax = fabs(n[0]), ay = fabs(n[1]), az = fabs(n[2]);
    const int least = ax <= ay && ax <= az ? 0 : ay <= az ? 1 : 2;
    double axis[3] = {0, 0, 0};
    axis[least] = 1;
    spsi_along(axis, n, -n[least], x);
    spsi_normalise(x);
    spsi_cross(n, x, y);
}

/* The determinant of the matrix with columns a, b, c. */
static double spsi_determinant(const double a[3], const double b[3], const double c[3]) {
    double bc[3];
    spsi_cross(b, c, bc);
    return spsi_dot(a, bc);
}

/* Rows of the inverse of the matrix with columns a, b, c. Returns 0 if it is singular. */
static int spsi_invert(const double a[3], const double b[3], const double c[3], double rows[3][3]) {
    const double determinant = spsi_determinant(a, b, c);
    if (!(fabs(determinant) > 0) || !(fabs(determinant) <= DBL_MAX)) return 0;
    spsi_cross(b, c, rows[0]);
    spsi_cross(c, a, rows[1]);
    spsi_cross(a, b, rows[2]);
    for (int i = 0; i < 9; ++i) rows[i / 3][i % 3] /= determinant;
    return 1;
}

/* Returns the first number that is not a usable coordinate, NULL if there is none. */
static const double *spsi_bad_coordinate(const double *values, int count) {
    for (int i = 0; i < count; ++i)
        if (!(fabs(values[i]) <= SPSI_COORDINATE_MAX)) return &values[i];
    return NULL;
}

/* Returns the first of three components that is not within 0..most, NULL if there is none. */
static const float *spsi_bad_color(const float c[3], float most) {
    for (int i = 0; i < 3; ++i)
        if (!(c[i] >= 0 && c[i] <= most)) return &c[i];
    return NULL;
}

static int spsi_black(const float c[3]) { return !(c[0] > 0) && !(c[1] > 0) && !(c[2] > 0); }
static int spsi_grey(const float c[3]) { return !(c[0] < c[1] || c[0] > c[1] || c[1] < c[2] || c[1] > c[2]); }
/* Inlined, as fminf and fmin rarely are. b if a is NaN. */
static inline float spsi_lower(float a, float b) { return a < b ? a : b; }
static inline float spsi_higher(float a, float b) { return a > b ? a : b; }
static inline double spsi_minimum(double a, double b) { return a < b ? a : b; }
static inline double spsi_maximum(double a, double b) { return a > b ? a : b; }
static int spsi_least(int a, int b) { return a < b ? a : b; }
static int spsi_most(int a, int b) { return a > b ? a : b; }

/* =============================================================================================== >>memory
   4  The context, its one allocator, its one error path, and the distribution of work. Memory lives in numbered buffers
   that keep their largest size from call to call. */

typedef enum spsi_buffer_id {
    SPSI_BUFFER_FRAME,       /* the checked scene, >>scene */
    SPSI_BUFFER_CONTENT,     /* what is read from the scene, >>scene */
    SPSI_BUFFER_TABLES,      /* transfer functions */
    SPSI_BUFFER_MESHES,      /* resolved meshes */
    SPSI_BUFFER_LAMPS,       /* resolved lights */
    SPSI_BUFFER_LAMP_POINTS, /* points that stand for extended lights */
    SPSI_BUFFER_LAMP_PLANES, /* of the opacity maps of lights */
    SPSI_BUFFER_IMAGES,      /* that lights throw, >>projectors */
    SPSI_BUFFER_BLOCK,       /* one block of values, its positions and flags, >>gather */
    SPSI_BUFFER_BRICKS,
    SPSI_BUFFER_BRICK_PRINTS,  /* fingerprints of the bricks, for shadow tables */
    SPSI_BUFFER_SEGMENTS,      /* the list of voxel segments */
    SPSI_BUFFER_FACES,         /* triangles, >>polygons */
    SPSI_BUFFER_FACE_ROWS,     /* the rows that each triangle covers */
    SPSI_BUFFER_FACE_ORDER,    /* the order of the triangles in their tree, >>trees */
    SPSI_BUFFER_FACE_NODES,    /* the nodes of the triangles' tree */
    SPSI_BUFFER_TREE_ITEMS,    /* items of any tree that is being built */
    SPSI_BUFFER_FACE_TEXTURES, /* texture coordinates of triangles that need them */
    SPSI_BUFFER_MESH_FACES,    /* which triangles belong to each mesh */
    SPSI_BUFFER_EYE_FACES,     /* the triangle visible at each pixel */
    SPSI_BUFFER_LAYER_SAMPLES, /* a band of samples per worker, >>layers */
    SPSI_BUFFER_LAYER_STARTS,  /* where each pixel's layers begin */
    SPSI_BUFFER_FRAGMENTS,     /* of all pixels */
    SPSI_BUFFER_LAYERS,        /* of all pixels */
    SPSI_BUFFER_SURFACES,      /* what shade_fn has set at each pixel of the region, and at each layer */
    SPSI_BUFFER_SURFACE_BATCH, /* points for one call of shade_fn */
    SPSI_BUFFER_SHADOWS,       /* of a sweep's lights, >>shading */
    SPSI_BUFFER_ARRIVALS,      /* light that arrives at a vector of pixels, per worker */
    SPSI_BUFFER_SURFACE_LIGHT, /* per light of a sweep: the pixels whose polygons see it */
    SPSI_BUFFER_DEPTH_MAPS,
    SPSI_BUFFER_PANE_MAPS,         /* of translucent polygons, >>depthmaps */
    SPSI_BUFFER_PANE_TEXELS,       /* where each texel's panes begin */
    SPSI_BUFFER_PANES,             /* of all texels */
    SPSI_BUFFER_PIXELS,            /* optical depth and radiance, >>shading */
    SPSI_BUFFER_PLANES,            /* a light's optical depth at the slabs of a chunk, >>lightsheets */
    SPSI_BUFFER_BEAMS,             /* light from the points of an extended light, >>penumbrae */
    SPSI_BUFFER_PENUMBRA,          /* their texels, and a chunk of sheets */
    SPSI_BUFFER_SHEETS,            /* a tile of sheets per worker */
    SPSI_BUFFER_SAMPLES,           /* samples of the volumes at a vector of pixels, per worker, >>shading */
    SPSI_BUFFER_PARTICLES,         /* >>gather */
    SPSI_BUFFER_BRICK_QUEUE,       /* bricks by the chunks that they touch, >>targets */
    SPSI_BUFFER_PARTICLE_QUEUE,    /* particles by the chunks that they touch */
    SPSI_BUFFER_BRICK_BOXES,       /* pixels that bricks touch, for the eye or a map */
    SPSI_BUFFER_BRICK_LIGHT_BOXES, /* texels that bricks touch, for a light */
    SPSI_BUFFER_EYE_BALLS,         /* the particles of one chunk as the eye sees them, by tile */
    SPSI_BUFFER_LIGHT_BALLS,       /* the particles of one chunk as a light sees them, by tile */
    SPSI_BUFFER_TILES,             /* state of each tile */
    SPSI_BUFFER_RUN,               /* data shared by the tasks of a sweep */
    SPSI_BUFFER_TMAP_VOLUMES,      /* data for splatting volumes into a map, >>tmaps */
    SPSI_BUFFER_LIGHT_TMAPS,       /* lights' transmittance maps */
    SPSI_BUFFER_SHADOW_TABLES,     /* shadow tables of the last call */
    SPSI_BUFFER_TOTAL,             /* sum of the sweeps' images */
    SPSI_BUFFER_ROW,               /* directions and colors of one row of background */
    SPSI_BUFFER_MARCHER,           /* >>reference */
    SPSI_BUFFER_WALKERS,           /* the reference's rays, one per pixel */
    SPSI_BUFFER_REFERENCE_VALUES,
    SPSI_BUFFER_REFERENCE_PARTICLES,
    SPSI_BUFFER_REFERENCE_PARTICLE_NODES,
    SPSI_BUFFER_BALL_ORDER,  /* particles of a map in order of depth */
    SPSI_BUFFER_BALLS,       /* particles as a map's rays see them, >>tmaps */
    SPSI_BUFFER_BALL_STARTS, /* where each tile's particles begin in the list */
    SPSI_BUFFER_BALL_LIST,   /* the particles of all tiles */
    SPSI_BUFFER_BAND,        /* sums or intervals of a band of tiles of a map */
    SPSI_BUFFER_CURSORS,     /* where each texel's intervals begin */
    SPSI_BUFFER_CURVES,      /* per worker, the data that a texel of a map is made from */
    SPSI_BUFFER_COUNT
} spsi_buffer_id;

typedef struct spsi_buffer {
    void *data;
    size_t size;
} spsi_buffer;

#define SPSI_FIELD_SIZE    sizeof(((sps_error_info *)0)->field)
#define SPSI_SENTENCE_SIZE sizeof(((sps_error_info *)0)->sentence)

struct sps_context {
    sps_config config;
    sps_stats_report stats;
    sps_result result;
    sps_error_info error; /* of that result */
    float progress;
    int tmap_count;     /* maps not yet destroyed */
    int cancelled;      /* progress_fn has returned non-zero, which takes effect at the next spsi_progress */
    double clock_start; /* of the call, by clock_fn */
    spsi_buffer buffers[SPSI_BUFFER_COUNT];
    int segment_count; /* voxel segments held, >>gather */
    uint64_t gathered; /* fingerprint of the volumes whose voxels are held; 0: none */
    int brick_count;
    int bricks_printed; /* 1: their fingerprints are held too */
    uint64_t voxel_count;
    uint64_t faces_held; /* fingerprint of the meshes whose triangles are held; 0: none, >>polygons */
    int face_count;
    int tree_held;          /* 1: the tree of these triangles is held too */
    int shadow_table_count; /* held from the last call, >>tmaps */
    double mesh_low[3], mesh_high[3];
};

/* The member at the beginning of a phrase: "count" of "count, with those before it,". */
static void spsi_leading_member(const char *phrase, char member[SPSI_FIELD_SIZE]) {
    size_t length = 0;
    while (length < SPSI_FIELD_SIZE - 1 && phrase[length] && !strchr(" ,'(", phrase[length])) ++length;
    memcpy(member, phrase, length);
    member[length] = 0;
}

static void spsi_clear_error(sps_error_info *info) {
    memset(info, 0, sizeof *info);
    info->index = -1;
}

/* Describes a failure, in data and as the sentence "OBJECT[index].PHRASE REST"; index < 0 omits the brackets. */
static void spsi_describe(sps_error_info *info, sps_object object, int index, const char *phrase, double value,
                          const char *rest) {
    static const char *const names[] = {"",     "",      "config",    "scene", "view",  "image",   "volume",
                                        "mesh", "light", "particles", "tmap",  "light", "settings"};
    char brackets[24] = "";
    info->object = object;
    info->index = index;
    info->value = value;
    spsi_leading_member(object == SPS_OBJECT_NONE ? "" : phrase, info->field);
    if (index >= 0) SPS_SNPRINTF(brackets, sizeof brackets, "[%d]", index);
    SPS_SNPRINTF(info->sentence, sizeof info->sentence, "%s%s%s%s%s%s", names[object], brackets,
                 *names[object] && *phrase ? "." : "", phrase, *names[object] || *phrase ? " " : "", rest);
}

/* The one way to fail: records the description, tells message_fn unless the caller has cancelled, and returns the
   result. The first failure stands. */
static sps_result spsi_fail_that(sps_context *context, sps_result result, sps_object object, int index,
                                 const char *phrase, double value, const char *rest) {
    if (context->result == SPS_OK) {
        context->result = context->error.result = result;
        spsi_describe(&context->error, object, index, phrase, value, rest);
        if (context->config.message_fn && result != SPS_ERROR_CANCELLED)
            context->config.message_fn(context->config.message_user, context->error.sentence);
    }
    return context->result;
}

/* As spsi_fail_that, for a failure without an object. */
static sps_result spsi_fail(sps_context *context, sps_result result, const char *sentence) {
    return spsi_fail_that(context, result, SPS_OBJECT_NONE, -1, "", 0, sentence);
}

#define SPSI_NOT_ZEROED "the struct was not zeroed"
#define SPSI_IS_NULL    "is NULL; it must not be"

/* The rest of a sentence about a field whose value breaks a rule. Returns the value. */
static double spsi_say_value(double value, const char *rule, char rest[SPSI_SENTENCE_SIZE]) {
    if (!(value <= 0) && !(value > 0)) value = fabs(value); /* NaN may print its sign, which is meaningless */
    SPS_SNPRINTF(rest, SPSI_SENTENCE_SIZE, "is %g; %s", value, rule);
    return value;
}

/* As spsi_fail_that, for "OBJECT[index].FIELD is VALUE; RULE", or for a callback, whose result is SPS_ERROR_CALLBACK
   and which has no rule, "OBJECT[index].FIELD failed: it returned VALUE". */
static sps_result spsi_fail_field(sps_context *context, sps_result result, sps_object object, int index,
                                  const char *field, double value, const char *rule) {
    char rest[SPSI_SENTENCE_SIZE];
    if (result == SPS_ERROR_CALLBACK)
        SPS_SNPRINTF(rest, sizeof rest, "failed: it returned %g", value);
    else
        value = spsi_say_value(value, rule, rest);
    return spsi_fail_that(context, result, object, index, field, value, rest);
}

static void spsi_release(sps_context *context, void *data, size_t size) {
    if (!data) return;
    SPS_ASSERT(context->stats.bytes >= size);
    context->stats.bytes -= size; /* before: the last thing released is the context itself */
    if (context->config.free_fn)
        context->config.free_fn(context->config.alloc_user, data, size);
    else
        SPS_FREE(data);
}

/* Every allocation except for the context's own comes from here: overflow, limit and failure are one error, with NULL
   returned. */
static void *spsi_acquire(sps_context *context, size_t count, size_t size) {
    const size_t limit = context->config.memory_limit;
    const size_t bytes = count * size;
    void *data = NULL;
    char sentence[256];
    if (count == 0 || count <= SIZE_MAX / size) {
        if (limit == 0 || (bytes <= limit && context->stats.bytes <= limit - bytes))
            data = context->config.alloc_fn ? context->config.alloc_fn(context->config.alloc_user, bytes)
                                            : SPS_MALLOC(bytes);
    }
    if (!data) {
        SPS_SNPRINTF(sentence, sizeof sentence, "memory: %.0f bytes more than the %.0f held were refused by the %s",
                     (double)count * (double)size, (double)context->stats.bytes,
                     limit && (double)count * (double)size + (double)context->stats.bytes > (double)limit
                         ? "memory_limit"
                         : "allocator");
        spsi_fail(context, SPS_ERROR_MEMORY, sentence);
        return NULL;
    }
    context->stats.allocations += 1;
    context->stats.bytes += bytes;
    if (context->stats.bytes > context->stats.bytes_peak) context->stats.bytes_peak = context->stats.bytes;
    return data;
}

/* Calls progress_fn in the middle of work, so that it is called often enough even if tasks take long. */
static void spsi_tick(sps_context *context) {
    if (context->config.progress_fn && !context->cancelled)
        context->cancelled = context->config.progress_fn(context->config.progress_user, context->progress) != 0;
}

#define SPSI_COPY_BYTES ((size_t)1 << 24) /* a few milliseconds' work */

/* memcpy of possibly large data, with progress. */
static void spsi_copy(sps_context *context, void *to, const void *from, size_t bytes) {
    for (size_t at = 0; at < bytes; at += SPSI_COPY_BYTES) {
        const size_t some = bytes - at < SPSI_COPY_BYTES ? bytes - at : SPSI_COPY_BYTES;
        memcpy((char *)to + at, (const char *)from + at, some);
        if (bytes > SPSI_COPY_BYTES) spsi_tick(context);
    }
}

static void spsi_buffer_release(sps_context *context, spsi_buffer *buffer) {
    spsi_release(context, buffer->data, buffer->size);
    buffer->data = NULL;
    buffer->size = 0;
}

/* Makes a buffer hold at least count * size bytes; its contents are lost if it has to grow. Returns NULL on failure. */
static void *spsi_buffer_reserve(sps_context *context, spsi_buffer *buffer, size_t count, size_t size) {
    const size_t wanted = count > 0 ? count : 1;
    if (buffer->data && buffer->size / size >= wanted) return buffer->data;
    spsi_buffer_release(context, buffer);
    buffer->data = spsi_acquire(context, wanted, size);
    if (buffer->data) buffer->size = wanted * size;
    return buffer->data;
}

/* As spsi_buffer_reserve, but keeps the first `kept` items and grows by at least half. */
static void *spsi_buffer_extend(sps_context *context, spsi_buffer *buffer, size_t kept, size_t count, size_t size) {
    const size_t held = buffer->size / size, grown = held + held / 2;
    const size_t wanted = grown > count ? grown : count > 0 ? count : 1;
    void *data;
    if (buffer->data && held >= count) return buffer->data;
    data = spsi_acquire(context, wanted, size);
    if (!data) return NULL;
    spsi_copy(context, data, buffer->data, kept * size);
    spsi_release(context, buffer->data, buffer->size);
    buffer->data = data;
    buffer->size = wanted * size;
    return data;
}

/* The same for the context's numbered buffers. */
static void *spsi_reserve(sps_context *context, spsi_buffer_id id, size_t count, size_t size) {
    return spsi_buffer_reserve(context, &context->buffers[id], count, size);
}

static void *spsi_extend(sps_context *context, spsi_buffer_id id, size_t kept, size_t count, size_t size) {
    return spsi_buffer_extend(context, &context->buffers[id], kept, count, size);
}

static int spsi_worker_count(const sps_context *context) {
    return context->config.parallel_for_fn && context->config.worker_count > 0 ? context->config.worker_count : 1;
}

static double spsi_clock(const sps_context *context) {
    return context->config.clock_fn ? context->config.clock_fn(context->config.clock_user) : 0;
}

#define SPSI_GROUP_TASKS  1024
#define SPSI_TICK_SECONDS 0.01
#define SPSI_TICK_TASKS   4 /* per worker, if there is no clock: fewer would leave even more workers idle */

static void spsi_task_run(sps_task_fn task, void *data, int index, int worker) {
    spsi_zero_upper();
    task(data, index, worker);
    spsi_zero_upper();
}

/* Tasks from `first` on. A task that starts after the deadline is left for another round, so that workers wait for each
   other only when progress_fn is due, and not after every few tasks, which took a sixth of a frame. */
typedef struct spsi_task_group {
    const sps_context *context;
    sps_task_fn task;
    void *data;
    int first, count;
    double deadline;                      /* by clock_fn; infinity: none */
    unsigned char done[SPSI_GROUP_TASKS]; /* per task, written by the worker that ran it */
} spsi_task_group;

static void spsi_group_task(void *data, int index, int worker) {
    spsi_task_group *group = (spsi_task_group *)data;
    if (group->done[index]) return;
    if (group->deadline < HUGE_VAL && spsi_clock(group->context) > group->deadline) return;
    group->done[index] = 1;
    spsi_task_run(group->task, group->data, group->first + index, worker);
}

/* Runs a group's tasks in rounds, with a call of progress_fn after each. If nothing was done in a round, because the
   clock jumped, the next round has no deadline and is the last. Tasks that parallel_for_fn left out are run here. */
static void spsi_group_run(sps_context *context, spsi_task_group *group) {
    const int timed = context->config.progress_fn && context->config.clock_fn;
    int left = group->count, stuck = 0;
    memset(group->done, 0, (size_t)group->count);
    for (int last = 0; left > 0 && !last;) {
        int still = 0;
        last = !timed || stuck;
        group->deadline = last ? HUGE_VAL : spsi_clock(context) + SPSI_TICK_SECONDS;
        context->config.parallel_for_fn(context->config.parallel_user, group->count, spsi_group_task, group);
        spsi_tick(context);
        for (int i = 0; i < group->count; ++i) still += !group->done[i];
        stuck = still == left;
        left = still;
    }
    for (int i = 0; i < group->count && left > 0; ++i) spsi_group_task(group, i, 0);
}

/* Runs task(data, i, worker) for i = 0..count-1, and calls progress_fn at intervals. Tasks write to disjoint memory, so
   the order does not matter. */
static void spsi_parallel(sps_context *context, int count, sps_task_fn task, void *data) {
    const int untimed = context->config.progress_fn && !context->config.clock_fn;
    int some = SPSI_GROUP_TASKS;
    spsi_task_group group;
    if (!context->config.parallel_for_fn || count <= 1) {
        for (int i = 0; i < count; ++i) {
            spsi_task_run(task, data, i, 0);
            spsi_tick(context);
        }
        return;
    }
    if (untimed) some = spsi_least(some, SPSI_TICK_TASKS * spsi_worker_count(context));
    group.context = context, group.task = task, group.data = data;
    for (group.first = 0; group.first < count; group.first += some) {
        group.count = spsi_least(some, count - group.first);
        spsi_group_run(context, &group);
    }
}

/* A part of a call: the call's progress when the part begins, and the part's share of the call. */
typedef struct spsi_part_of_call {
    double progress, share;
} spsi_part_of_call;

/* The call's progress when a fraction of the part is done. */
static double spsi_part_done(const spsi_part_of_call *part, double fraction) {
    return part->progress + part->share * fraction;
}

/* Shares of a call's progress, roughly: of reading, and, in a sweep, of its lights' maps. */
#define SPSI_PROGRESS_GATHER 0.2
#define SPSI_PROGRESS_TMAP   0.3

#define SPSI_BATCH 256 /* items per task where they are many and small: enough to hide a task's overhead */

/* Runs the tasks for `count` items in batches. */
static void spsi_parallel_batches(sps_context *context, int count, sps_task_fn task, void *data) {
    spsi_parallel(context, count / SPSI_BATCH + (count % SPSI_BATCH > 0), task, data);
}

/* The end of a task's batch, which begins at index * SPSI_BATCH. */
static int spsi_batch_end(int index, int count) { return spsi_least(count, (index + 1) * SPSI_BATCH); }

/* Reports progress; SPS_ERROR_CANCELLED if the caller wants to stop. */
static sps_result spsi_progress(sps_context *context, double fraction) {
    const float now = (float)fmin(1.0, fmax((double)context->progress, fraction));
    context->progress = now;
    spsi_tick(context);
    if (context->cancelled) return spsi_fail(context, SPS_ERROR_CANCELLED, "cancelled by progress_fn");
    return SPS_OK;
}

/* FNV-1a, 64 bits: tells whether the caller's data is the data already held. [Fowler, Noll, Vo] */
#define SPSI_FINGERPRINT_START UINT64_C(14695981039346656037)

static uint64_t spsi_fingerprint(uint64_t hash, const void *data, size_t size) {
    const unsigned char *bytes = (const unsigned char *)data;
    for (size_t i = 0; i < size; ++i) hash = (hash ^ bytes[i]) * UINT64_C(1099511628211);
    return hash;
}

/* The same for 64 bits at once: several times as fast. Multiplying carries changes upwards only, so the upper half is
   folded into the lower. */
static inline uint64_t spsi_fingerprint_word(uint64_t hash, uint64_t word) {
    hash = (hash ^ word) * UINT64_C(0x9e3779b97f4a7c15);
    return hash ^ hash >> 32;
}

/* =============================================================================================== >>kernel
   5  The voxel kernel, a Gaussian with a standard deviation of SPSI_SIGMA voxels, cut at SPSI_CUT standard deviations
   or less, and the closed forms for light in a sheet. */

#define SPSI_SIGMA       0.65 /* voxels; a lattice of such kernels is constant to 0.05 % */
#define SPSI_REACH       2.5  /* voxels */
#define SPSI_CUT         (SPSI_REACH / SPSI_SIGMA)
#define SPSI_PIXEL_SIGMA 0.5 /* minimum footprint width in pixels: the pixel filter if voxels are smaller */

/* The kernel's mass within the cut footprint. Dividing by it keeps a constant grid constant. */
static double spsi_footprint_mass(double cut) { return -expm1(-0.5 * cut * cut); }

/* The share of a kernel's line integral that lies before a plane; v = distance / (SPSI_CUT * standard deviation).
   A polynomial whose derivative (1 - v^2)^2 (..) is never negative, so that sheets are never negative. It was fitted to
   the cut Gaussian: maximum error 2e-4 of the integral, and the shares of all slabs add up to 1. */
static inline spsi_v spsi_kernel_share(spsi_v v) {
    const spsi_v x = spsi_clamp(v, spsi_set(-1), spsi_set(1)), x2 = spsi_mul(x, x);
    spsi_v p = spsi_set(0.915625417f);
    p = spsi_fma(p, x2, spsi_set(-4.38040258f));
    p = spsi_fma(p, x2, spsi_set(8.9310312f));
    p = spsi_fma(p, x2, spsi_set(-10.2611645f));
    p = spsi_fma(p, x2, spsi_set(7.45445085f));
    p = spsi_fma(p, x2, spsi_set(-3.6912726f));
    p = spsi_fma(p, x2, spsi_set(1.53173222f));
    return spsi_fma(p, x, spsi_set(0.5f));
}

/* The derivative of spsi_kernel_share. */
static inline spsi_v spsi_kernel_slope(spsi_v v) {
    const spsi_v x = spsi_clamp(v, spsi_set(-1), spsi_set(1)), x2 = spsi_mul(x, x);
    spsi_v p = spsi_set(13 * 0.915625417f);
    p = spsi_fma(p, x2, spsi_set(11 * -4.38040258f));
    p = spsi_fma(p, x2, spsi_set(9 * 8.9310312f));
    p = spsi_fma(p, x2, spsi_set(7 * -10.2611645f));
    p = spsi_fma(p, x2, spsi_set(5 * 7.45445085f));
    p = spsi_fma(p, x2, spsi_set(3 * -3.6912726f));
    return spsi_fma(p, x2, spsi_set(1.53173222f));
}

/* The mean of exp(-x) for x between a and b (in any order): exp(-min) (1 - exp(-d)) / d, d = |a - b|; exp(-a) at d = 0.
   A sheet of optical depth t that emits c per unit of depth, with optical depths a and b at its two sides, contributes
   c t spsi_mean_transmittance(a, b): exact if extinction is constant within the sheet, for either compositing order.
   The series below d = 0.25 is accurate to 1e-7. */
static inline spsi_v spsi_mean_transmittance(spsi_v a, spsi_v b) {
    const spsi_v d = spsi_abs(spsi_sub(a, b));
    const spsi_v quotient =
        spsi_div(spsi_sub(spsi_set(1), spsi_exp(spsi_sub(spsi_set(0), d))), spsi_max(d, spsi_set(0.25f)));
    spsi_v series = spsi_fma(d, spsi_set(-1.0f / 720), spsi_set(1.0f / 120));
    series = spsi_fma(spsi_mul(d, spsi_set(-1)), series, spsi_set(1.0f / 24));
    series = spsi_fma(spsi_mul(d, spsi_set(-1)), series, spsi_set(1.0f / 6));
    series = spsi_fma(spsi_mul(d, spsi_set(-1)), series, spsi_set(0.5f));
    series = spsi_fma(spsi_mul(d, spsi_set(-1)), series, spsi_set(1));
    return spsi_mul(spsi_exp(spsi_sub(spsi_set(0), spsi_min(a, b))),
                    spsi_select(spsi_less(d, spsi_set(0.25f)), series, quotient));
}

/* The mean position, as a fraction of its length, of what the eye sees of an interval of optical depth d:
   1/d - 1/(exp(d) - 1), which is 1/2 at d = 0. The series below d = 0.5 is accurate to 1e-7. */
static inline spsi_v spsi_mean_way(spsi_v d) {
    const spsi_v square = spsi_mul(d, d), most = spsi_max(d, spsi_set(0.5f));
    const spsi_v left = spsi_exp(spsi_sub(spsi_set(0), most));
    const spsi_v far_share = spsi_sub(spsi_div(spsi_set(1), most), spsi_div(left, spsi_sub(spsi_set(1), left)));
    spsi_v series = spsi_fma(square, spsi_set(-1.0f / 30240), spsi_set(1.0f / 720));
    series = spsi_fma(square, series, spsi_set(-1.0f / 12));
    return spsi_select(spsi_less(d, spsi_set(0.5f)), spsi_fma(d, series, spsi_set(0.5f)), far_share);
}

/* ================================================================================================= >>view
   6  Rays. A camera and a light are the same thing: a grid of rays through pixel (or texel) centres,
       perspective    p = origin + t (c + x a + y b)
       orthographic   p = origin + x a + y b + t c
   so one rasteriser and one splatter serve both. Ray space is (x, y, t). Depths are stored as t - depth_reference, so
   that a distant camera loses no precision. */

typedef struct spsi_rays {
    int perspective, width, height;
    double origin[3], a[3], b[3], c[3];
    double inverse[3][3]; /* rows; maps (p - origin) to (x t, y t, t) or (x, y, t) */
    double depth_reference, near_depth;
    int is_cube_face; /* 1: one of six faces around the origin */
} spsi_rays;

static size_t spsi_ray_count(const spsi_rays *rays) { return (size_t)rays->width * (size_t)rays->height; }

/* Columns and rows of tiles that cover the rays; the last ones may be partly filled. */
static int spsi_tile_columns(const spsi_rays *rays) { return (rays->width + SPSI_TILE_WIDTH - 1) / SPSI_TILE_WIDTH; }
static int spsi_tile_rows(const spsi_rays *rays) { return (rays->height + SPSI_TILE_HEIGHT - 1) / SPSI_TILE_HEIGHT; }

/* Returns 0 if the rays do not span space, or if a nearly singular matrix puts them too far away. */
static int spsi_rays_complete(spsi_rays *rays) {
    if (!spsi_invert(rays->a, rays->b, rays->c, rays->inverse)) return 0;
    return !spsi_bad_coordinate(rays->origin, 3) && !spsi_bad_coordinate(rays->a, 3) &&
           !spsi_bad_coordinate(rays->b, 3);
}

/* The start of the rays, as t - depth_reference. */
static float spsi_rays_begin(const spsi_rays *rays) {
    return rays->near_depth > -DBL_MAX ? (float)(rays->near_depth - rays->depth_reference) : -FLT_MAX;
}

/* Transforms a world offset from the origin to ray coordinates, before any division. */
static void spsi_to_rays(const spsi_rays *rays, const double offset[3], double q[3]) {
    for (int i = 0; i < 3; ++i) q[i] = spsi_dot(rays->inverse[i], offset);
}

/* Pixel coordinates and depth t of a world point; x and y are meaningless if t is not positive in perspective. */
static void spsi_project(const spsi_rays *rays, const double point[3], double q[3]) {
    double offset[3];
    spsi_along(point, rays->origin, -1, offset);
    spsi_to_rays(rays, offset, q);
    if (rays->perspective && q[2] > 0) q[0] /= q[2], q[1] /= q[2];
}

/* The direction of a pixel's ray: the change of p per unit of t. */
static void spsi_ray_direction(const spsi_rays *rays, double x, double y, double direction[3]) {
    memcpy(direction, rays->c, sizeof rays->c);
    if (!rays->perspective) return;
    spsi_along(direction, rays->a, x, direction);
    spsi_along(direction, rays->b, y, direction);
}

static void spsi_ray_point(const spsi_rays *rays, double x, double y, double t, double point[3]) {
    double direction[3];
    spsi_ray_direction(rays, x, y, direction);
    spsi_along(rays->origin, direction, t, point);
    if (rays->perspective) return;
    spsi_along(point, rays->a, x, point);
    spsi_along(point, rays->b, y, point);
}

/* Rays from a basis: the centre of the image plane lies along `forward`; pixels step along `right` and `down`, by
   `pitch` at t = 1 (perspective) or everywhere (orthographic). */
static void spsi_rays_aim(spsi_rays *rays, const double eye[3], const double right[3], const double down[3],
                          const double forward[3], double pitch_x, double pitch_y) {
    const double x = -0.5 * (rays->width - 1) * pitch_x, y = -0.5 * (rays->height - 1) * pitch_y;
    double *corner = rays->perspective ? rays->c : rays->origin;
    for (int i = 0; i < 3; ++i) {
        rays->a[i] = right[i] * pitch_x;
        rays->b[i] = down[i] * pitch_y;
        rays->c[i] = forward[i];
        rays->origin[i] = eye[i];
    }
    spsi_along(corner, right, x, corner);
    spsi_along(corner, down, y, corner);
}

/* Unit vectors to the right of and below a unit vector, seen along it; `up` zero or along it: some such vectors. */
static void spsi_axes_across(const double forward[3], const double up[3], double right[3], double down[3]) {
    spsi_cross(forward, up, right);
    if (!(spsi_length(right) > 1e-6 * spsi_length(up)) || !spsi_normalise(right)) spsi_basis(forward, right, down);
    spsi_cross(forward, right, down);
}

/* Rays through the pixels of a camera without a matrix; width and height are already set. Returns 0 if it has no
   direction, or if its pixels coincide. */
static int spsi_rays_from_camera(spsi_rays *rays, const sps_camera *camera) {
    double forward[3], right[3], down[3], pitch;
    spsi_along(camera->target, camera->position, -1, forward);
    if (!spsi_normalise(forward)) return 0;
    spsi_axes_across(forward, camera->up, right, down);
    rays->perspective = camera->field_of_view > 0;
    pitch = (rays->perspective ? 2 * tan(0.5 * camera->field_of_view) : camera->ortho_height) / rays->height;
    spsi_rays_aim(rays, camera->position, right, down, forward, pitch, pitch);
    return spsi_rays_complete(rays);
}

/* World size of a pixel at t units of depth from the origin of its rays. */
static double spsi_pixel_size_at(const spsi_rays *rays, double t) {
    const double size = sqrt(spsi_length(rays->a) * spsi_length(rays->b));
    return rays->perspective ? fmax(t, 0) * size : size;
}

/* Rays shifted by parts of a pixel. Depths stay the same. */
static void spsi_rays_shift(const spsi_rays *rays, double x, double y, spsi_rays *shifted) {
    double *from = rays->perspective ? shifted->c : shifted->origin;
    *shifted = *rays;
    spsi_along(from, rays->a, x, from);
    spsi_along(from, rays->b, y, from);
    if (!rays->perspective) return;
    spsi_along(rays->inverse[0], rays->inverse[2], -x, shifted->inverse[0]);
    spsi_along(rays->inverse[1], rays->inverse[2], -y, shifted->inverse[1]);
}

/* The rays of n x n points of each pixel, in even steps. */
static int spsi_rays_split(const spsi_rays *rays, int n, spsi_rays *fine) {
    spsi_rays_shift(rays, 0.5 / n - 0.5, 0.5 / n - 0.5, fine);
    fine->width *= n;
    fine->height *= n;
    for (int i = 0; i < 3; ++i) {
        fine->a[i] /= n;
        fine->b[i] /= n;
    }
    return n == 1 || spsi_rays_complete(fine);
}

/* The row-major matrix from world points to texels: (X, Y, t, W), where the texel is (X / W, Y / W). */
static void spsi_rays_matrix(const spsi_rays *rays, double matrix[16]) {
    for (int i = 0; i < 4; ++i) {
        const double *row = rays->inverse[spsi_least(i, 2)];
        const int flat = i == 3 && !rays->perspective;
        for (int k = 0; k < 3; ++k) matrix[4 * i + k] = flat ? 0 : row[k];
        matrix[4 * i + 3] = flat ? 1 : -spsi_dot(row, rays->origin);
    }
}

#define SPSI_CUBE_FACES 6 /* +x -x +y -y +z -z */

/* The cube face that a direction points at: the axis of its largest component. */
static int spsi_cube_face_of(const double offset[3]) {
    const double x = fabs(offset[0]), y = fabs(offset[1]), z = fabs(offset[2]);
    const int axis = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
    return 2 * axis + (offset[axis] < 0);
}

/* Rays through one face of a cube around a point. The centres of the outermost texels lie on the cube's edges, or
   `border` texels beyond them. */
static int spsi_rays_of_cube_face(const double position[3], int face, int size, int border, spsi_rays *rays) {
    static const double axes[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    const double pitch = 2.0 / spsi_most(size - 1 - 2 * border, 1);
    double forward[3] = {0, 0, 0};
    memset(rays, 0, sizeof *rays);
    rays->perspective = rays->is_cube_face = 1;
    rays->width = rays->height = size;
    forward[face / 2] = face % 2 ? -1 : 1;
    spsi_rays_aim(rays, position, axes[(face / 2 + 1) % 3], axes[(face / 2 + 2) % 3], forward, pitch, pitch);
    return spsi_rays_complete(rays);
}

/* The distance, along the ray direction c from a point, at which an orthographic matrix has clip depth -1; 0 if that is
   farther than 1e12 pixels, where positions would lose precision. A near plane at -1 cannot be told from one at 0;
   measured from here, distances are positive with either. */
static double spsi_clip_start(const double m[16], const double point[3], const double c[3], double pixel) {
    const double start = (-m[15] - m[11] - spsi_dot(m + 8, point)) / spsi_dot(m + 8, c);
    return fabs(start) <= 1e12 * pixel ? start : 0;
}

/* Rays from rows 0, 1 and 3 of a world-to-clip matrix; in perspective, row 2 (the depth convention) is not needed. The
   ray of clip position (X,Y) lies in the planes (r0 - X r3) p = 0 and (r1 - Y r3) p = 0, so its direction is linear in
   X and Y. */
static int spsi_rays_from_matrix(spsi_rays *rays, const double m[16]) {
    const double *r0 = m, *r1 = m + 4, *r3 = m + 12;
    const double dx = 2.0 / rays->width, dy = -2.0 / rays->height, x0 = -1 + 0.5 * dx, y0 = 1 + 0.5 * dy;
    double rows[3][3], base[3], ax[3], ay[3], scale;
    rays->perspective = spsi_length(r3) > 1e-12 * (spsi_length(r0) + spsi_length(r1));
    spsi_cross(r0, r1, base);
    if (rays->perspective) {
        spsi_cross(r1, r3, ax);
        spsi_cross(r3, r0, ay);
        scale = spsi_dot(base, r3);
        if (!spsi_invert(r0, r1, r3, rows)) return 0;
        for (int i = 0; i < 3; ++i) rays->origin[i] = -(rows[0][i] * r0[3] + rows[1][i] * r1[3] + rows[2][i] * r3[3]);
        scale = spsi_length(r3) / scale;
    } else {
        if (!(r3[3] > 0) || !spsi_invert(r0, r1, base, rows)) return 0;
        for (int i = 0; i < 3; ++i) {
            rays->origin[i] = (rows[0][i] * (x0 * r3[3] - r0[3])) + rows[1][i] * (y0 * r3[3] - r1[3]);
            ax[i] = rows[0][i] * r3[3];
            ay[i] = rows[1][i] * r3[3];
        }
        scale = (spsi_dot(base, m + 8) < 0 ? -1 : 1) / spsi_length(base);
    }
    for (int i = 0; i < 3; ++i) {
        rays->a[i] = ax[i] * dx * (rays->perspective ? scale : 1);
        rays->b[i] = ay[i] * dy * (rays->perspective ? scale : 1);
        rays->c[i] = rays->perspective ? (base[i] + ax[i] * x0 + ay[i] * y0) * scale : base[i] * scale;
    }
    if (!rays->perspective) {
        double middle[3];
        for (int i = 0; i < 3; ++i) middle[i] = rays->origin[i] - x0 * ax[i] - y0 * ay[i];
        spsi_along(rays->origin, rays->c, spsi_clip_start(m, middle, rays->c, spsi_length(rays->b)), rays->origin);
    }
    return spsi_rays_complete(rays);
}

/* ---- quantities that are linear along rays ---- */

/* A quantity that is linear in depth along each of the eye's rays: (base . (1,x,y)) + d (slope . (1,x,y)), where d is
   t - depth_reference. Slab coordinates, light ray coordinates and positions are all of this kind. */
typedef struct spsi_linear {
    float base[3], slope[3];
} spsi_linear;

/* The linear quantity row . (p - origin) + offset. */
static void spsi_linear_build(const spsi_rays *rays, const double row[3], const double origin[3], double offset,
                              spsi_linear *linear) {
    const double a = spsi_dot(row, rays->a), b = spsi_dot(row, rays->b), c = spsi_dot(row, rays->c);
    const double t = rays->depth_reference;
    double from[3];
    spsi_along(rays->origin, origin, -1, from);
    memset(linear, 0, sizeof *linear);
    linear->base[0] = (float)(spsi_dot(row, from) + offset + t * c);
    linear->base[1] = (float)(a * (rays->perspective ? t : 1));
    linear->base[2] = (float)(b * (rays->perspective ? t : 1));
    linear->slope[0] = (float)c;
    if (!rays->perspective) return;
    linear->slope[1] = (float)a;
    linear->slope[2] = (float)b;
}

static inline spsi_v spsi_linear_base(const spsi_linear *linear, spsi_v x, float y) {
    return spsi_fma(x, spsi_set(linear->base[1]), spsi_set(linear->base[0] + y * linear->base[2]));
}

static inline spsi_v spsi_linear_slope(const spsi_linear *linear, spsi_v x, float y) {
    return spsi_fma(x, spsi_set(linear->slope[1]), spsi_set(linear->slope[0] + y * linear->slope[2]));
}

/* World length per unit of t along the rays of a row of pixels. */
static inline spsi_v spsi_ray_lengths(const spsi_rays *rays, spsi_v x, float y) {
    spsi_v sum = spsi_set(0);
    for (int i = 0; i < 3; ++i) {
        const float fixed = (float)(rays->c[i] + (rays->perspective ? (double)y * rays->b[i] : 0));
        const spsi_v part =
            rays->perspective ? spsi_fma(x, spsi_set((float)rays->a[i]), spsi_set(fixed)) : spsi_set(fixed);
        sum = spsi_fma(part, part, sum);
    }
    return spsi_sqrt(sum);
}

/* ============================================================================================= >>transfer
   7  Appearance of values. A gas scatters albedo * extinction * value by a sum of Henyey-Greenstein lobes; a transfer
   function is a table from value to color and extinction. */

#define SPSI_TABLE_SIZE 2048

typedef struct spsi_table {
    float entry[SPSI_TABLE_SIZE + 1][4]; /* red, green, blue, extinction */
    int shown[SPSI_TABLE_SIZE + 2];      /* number of entries before this one that have extinction */
} spsi_table;

typedef struct spsi_material {
    float extinction, albedo[3], emission[3];
    sps_lobe lobes[SPSI_LOBES_MAX]; /* weights add up to 1 */
    int lobe_count;
    spsi_table *table; /* NULL: gas */
    float table_scale; /* entries per unit of value */
    sps_shading shading;
    float gradient_scale; /* per change of value per voxel */
    float voxel_length;   /* world; the cube root of a voxel's volume */
    float specular, shininess;
    int scatters, emits, extinguishes;
} spsi_material;

/* One lobe for a vector of cosines. The square in the denominator is at least (1 - |g|)^2 > 0.
   [Henyey & Greenstein 1941] */
static inline spsi_v spsi_lobe_phase(float g, spsi_v cosine) {
    const spsi_v square =
        spsi_max(spsi_set((1 - g) * (1 - g) < (1 + g) * (1 + g) ? (1 - g) * (1 - g) : (1 + g) * (1 + g)),
                 spsi_fma(cosine, spsi_set(-2 * g), spsi_set(1 + g * g)));
    return spsi_div(spsi_set((1 - g * g) * (float)(0.25 / SPSI_PI)), spsi_mul(square, spsi_sqrt(square)));
}

static inline spsi_v spsi_phase(const spsi_material *material, spsi_v cosine) {
    spsi_v sum = spsi_set(0);
    for (int i = 0; i < material->lobe_count; ++i)
        sum = spsi_fma(spsi_lobe_phase(material->lobes[i].asymmetry, cosine), spsi_set(material->lobes[i].weight), sum);
    return sum;
}

/* Extinction only, for a vector of values. */
static inline spsi_v spsi_classify_extinction(const spsi_material *material, spsi_v value) {
    const spsi_v zero = spsi_set(0), scaled = spsi_mul(value, spsi_set(material->table_scale));
    const spsi_v at = spsi_clamp(scaled, zero, spsi_set((float)SPSI_TABLE_SIZE));
    const spsi_v entry = spsi_min(spsi_floor(at), spsi_set((float)(SPSI_TABLE_SIZE - 1)));
    const spsi_v low = spsi_lookup(material->table->entry[0], 4, spsi_set(3), entry);
    const spsi_v high = spsi_lookup(material->table->entry[0], 4, spsi_set(7), entry);
    return spsi_select(spsi_less(zero, value), spsi_mix(low, high, spsi_sub(at, entry)), zero);
}

/* Red, green, blue and extinction for a vector of values, linear between table entries. */
static inline void spsi_classify(const spsi_material *material, spsi_v value, spsi_v out[4]) {
    float at[SPSI_LANES], channel[4][SPSI_LANES];
    const spsi_v scaled = spsi_mul(value, spsi_set(material->table_scale));
    spsi_store(at, spsi_clamp(scaled, spsi_set(0), spsi_set((float)SPSI_TABLE_SIZE)));
    for (int i = 0; i < SPSI_LANES; ++i) {
        const int entry = at[i] < SPSI_TABLE_SIZE - 1 ? (int)at[i] : SPSI_TABLE_SIZE - 1;
        const float *low = material->table->entry[entry], *high = low + 4, t = at[i] - (float)entry;
        for (int c = 0; c < 4; ++c) channel[c][i] = low[c] + t * (high[c] - low[c]);
    }
    for (int c = 0; c < 4; ++c) out[c] = spsi_load(channel[c]);
    out[3] = spsi_select(spsi_less(spsi_set(0), value), out[3], spsi_set(0));
}

/* Checks color and extinction of points[i], or, if i < 0, those that eval_fn wrote for a value. */
static sps_result spsi_transfer_check_point(sps_context *context, int volume, const sps_transfer_point *point, int i,
                                            float value) {
    const float *bad = spsi_bad_color(point->color, 1);
    char field[64];
    if (!bad && point->extinction >= 0 && point->extinction <= SPSI_VALUE_MAX) return SPS_OK;
    if (i < 0)
        SPS_SNPRINTF(field, sizeof field, "transfer.eval_fn(%g).%s", (double)value, bad ? "color" : "extinction");
    else
        SPS_SNPRINTF(field, sizeof field, "transfer.points[%d].%s", i, bad ? "color" : "extinction");
    return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VOLUME, volume, field,
                           (double)(bad ? *bad : point->extinction),
                           bad ? "red, green and blue must be 0..1" : "it must be 0..1e18");
}

/* The transfer function at `value`, linear between its points. */
static void spsi_transfer_at_points(const sps_transfer *transfer, float value, float out[4]) {
    const sps_transfer_point *points = transfer->points;
    int high = 0;
    float t = 0;
    while (high < transfer->point_count - 1 && points[high].value < value) ++high;
    const int low = high > 0 ? high - 1 : 0;
    if (points[high].value > points[low].value)
        t = (value - points[low].value) / (points[high].value - points[low].value);
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    for (int c = 0; c < 3; ++c) out[c] = points[low].color[c] + t * (points[high].color[c] - points[low].color[c]);
    out[3] = points[low].extinction + t * (points[high].extinction - points[low].extinction);
}

static sps_result spsi_transfer_from_callback(sps_context *context, const sps_transfer *transfer, int volume,
                                              float last, spsi_table *table) {
    enum { BATCH = 64 };
    float values[BATCH];
    sps_transfer_point points[BATCH];
    for (int first = 0; first <= SPSI_TABLE_SIZE; first += BATCH) {
        const int count = spsi_least(BATCH, SPSI_TABLE_SIZE + 1 - first);
        int returned;
        memset(points, 0, sizeof points);
        for (int i = 0; i < count; ++i) values[i] = last * (float)(first + i) / SPSI_TABLE_SIZE;
        returned = transfer->eval_fn(transfer->user, (size_t)count, values, points);
        if (returned)
            return spsi_fail_field(context, SPS_ERROR_CALLBACK, SPS_OBJECT_VOLUME, volume, "transfer.eval_fn", returned,
                                   NULL);
        for (int i = 0; i < count; ++i) {
            if (spsi_transfer_check_point(context, volume, &points[i], -1, values[i])) return context->result;
            memcpy(table->entry[first + i], points[i].color, 3 * sizeof(float));
            table->entry[first + i][3] = points[i].extinction;
        }
    }
    return SPS_OK;
}

static sps_result spsi_transfer_check(sps_context *context, const sps_transfer *transfer, int volume) {
    char text[96];
    if (!transfer->points == !transfer->eval_fn) {
        SPS_SNPRINTF(text, sizeof text, "and eval_fn are both %s; exactly one must be set",
                     transfer->points ? "set" : "NULL");
        return spsi_fail_that(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VOLUME, volume, "transfer.points", 0, text);
    }
    if (transfer->points && transfer->point_count < 1)
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VOLUME, volume, "transfer.point_count",
                               transfer->point_count, "it must be at least 1");
    for (int i = 0; i < transfer->point_count && transfer->points; ++i) {
        const float value = transfer->points[i].value;
        if (!(value >= 0 && value <= SPSI_VALUE_MAX) || (i > 0 && !(value > transfer->points[i - 1].value))) {
            SPS_SNPRINTF(text, sizeof text, "transfer.points[%d].value", i);
            return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VOLUME, volume, text, (double)value,
                                   "values must be 0..1e18 and rise from point to point");
        }
        if (spsi_transfer_check_point(context, volume, &transfer->points[i], i, value)) return context->result;
    }
    if (!(transfer->value_max >= 0 && transfer->value_max <= SPSI_VALUE_MAX) ||
        (transfer->value_max > 0 && transfer->value_max < SPSI_VALUE_MIN))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VOLUME, volume, "transfer.value_max",
                               (double)transfer->value_max, "it must be 0 or 1e-30..1e18");
    return SPS_OK;
}

/* Fills a material's table and the members that depend on it. */
static sps_result spsi_transfer_tabulate(sps_context *context, const sps_transfer *transfer, int volume,
                                         spsi_material *material) {
    float last = transfer->value_max;
    if (spsi_transfer_check(context, transfer, volume)) return context->result;
    if (!(last > 0) && transfer->points) last = transfer->points[transfer->point_count - 1].value;
    if (!(last >= SPSI_VALUE_MIN)) last = 1; /* values below it count as 0 */
    material->table_scale = SPSI_TABLE_SIZE / last;
    if (!transfer->points && spsi_transfer_from_callback(context, transfer, volume, last, material->table))
        return context->result;
    material->table->shown[0] = 0;
    for (int i = 0; i <= SPSI_TABLE_SIZE; ++i) {
        float *entry = material->table->entry[i];
        if (transfer->points) spsi_transfer_at_points(transfer, last * (float)i / SPSI_TABLE_SIZE, entry);
        material->table->shown[i + 1] = material->table->shown[i] + (entry[3] > 0);
        material->extinguishes |= entry[3] > 0;
        material->scatters |= entry[3] > 0 && !spsi_black(entry);
    }
    return SPS_OK;
}

/* Whether any value between low and high has extinction. */
static int spsi_transfer_shows(const spsi_material *material, float low, float high) {
    const float first = low * material->table_scale, last = high * material->table_scale;
    const int a = first < SPSI_TABLE_SIZE ? (int)first : SPSI_TABLE_SIZE;
    const int b = last < SPSI_TABLE_SIZE - 1 ? (int)last + 1 : SPSI_TABLE_SIZE;
    return material->table->shown[b + 1] > material->table->shown[a];
}

/* ======================================================================================== >>transmittance
   8  Optical depth along one ray: how each technique of a transmittance map stores and evaluates it. A ray runs from
   u = 0 to 1. Along it lie intervals, uniform or with a particle's density of 1 - s^2. Their sum is a curve, kept as
   straight lines and jumps, which no technique represents exactly except for the list itself. Two kinds:

   Sums accept intervals in any order, a vector of neighbouring texels at a time, and are finished once:
     opacity planes, deep opacity planes       [Kim & Neumann 2001; Yuksel & Keyser 2008; cubics: Steffen 1990]
     Fourier series of extinction              [Jansen & Bavoil 2010], a_k = 2 sum t cos(2 pi k u), b_k with the sine
     power moments of extinction               [Muenstermann et al. 2018; Peters & Klein 2015]
     first, last and total                     (Beer shadow maps)
   Fits use the whole curve of a ray:
     u where T falls to one half, cosine series of T, nodes by least area [Salvi et al. 2010], and straight lines of T
     within epsilon                            [Lokovic & Veach 2000]

   Cost: insertion takes time for the planes that an interval passes through, or for all components; a fit (nodes of the
   curve) x (components), but n log n for an adaptive or a compressed map; the cost of a query stands at its function. T
   is short for transmittance, exp(-optical depth). */

#define SPSI_TMAP_COMPONENTS 65     /* maximum floats per texel */
#define SPSI_SOFT_PIECES     8      /* uniform pieces for a soft interval in a curve: 1.2 % of its depth off */
#define SPSI_SOFT_MOST       256    /* maximum of such pieces, where an error is to be kept */
#define SPSI_SOFT_EPSILON    0.001f /* minimum error that these keep */
#define SPSI_BEER_LENGTH     1e-6f  /* minimum length of a Beer map's gas, so that its density stays finite */

/* An interval of a ray from u0 to u1, of optical depth `depth`: uniform (soft 0), or with density 1 - s^2, where s runs
   from -1 to 1 (soft 1), as in a particle. If the light is inside a particle, s begins at 1 - 2 soft: the interval is
   the last `soft` of the chord. Its ends may lie outside 0..1, so that its shape stays exact: what is before 0 counts
   at 0, and what is behind 1 counts at 1. */
typedef struct spsi_interval {
    float u0, u1, depth, soft;
} spsi_interval;

/* The same for a vector of neighbouring texels; depth 0: no interval there. */
typedef struct spsi_intervals {
    spsi_v u0, u1, depth;
    float soft;
} spsi_intervals;

/* One node of a curve along a texel's ray, of optical depth, or of transmittance where a map stores that. The curve is
   linear between nodes; before the first it is unattenuated, after the last it keeps the last value. Two nodes may
   share one u: a jump (a sheet without thickness, an opaque surface whose depth is SPSI_DEPTH_MAX), which is complete
   at that u. */
typedef struct spsi_node {
    float u;
    float value;
} spsi_node;

/* A vector of texels of a map with the same number of floats each: those at (x, y) begin at floats + y * stride + x. */
typedef struct spsi_texels {
    const float *floats;
    int stride;
    spsi_v x, y;
} spsi_texels;

typedef struct spsi_technique {
    const char *name;             /* with its article, for error sentences */
    int least, most, step, usual; /* components: minimum, maximum, step from the minimum, default; all 0 for lists */
    int lists;                    /* 1: a list per texel, whose length depends on its ray */
    int sums;                     /* 1: insert and finish, in any order; 0: fit, from the curve of a texel's ray */
    /* 1: insert has no closed form for a soft interval that is cut, which is inserted as points. 0: accepts intervals
       whose ends lie outside 0..1. */
    int points;
    /* 1: u runs from the texel's first occluder to its last, whose u are the texel's first two components. The
       functions below see only the components after these, and the remapped u. -1: settings->texel_range decides
       (Fourier). */
    int range;
    /* Adds intervals to sums: component k of the vector's texels is at sums + k * stride. */
    void (*insert)(const sps_tmap_settings *settings, float *sums, size_t stride, const spsi_intervals *intervals);
    /* Turns the sums of one texel (packed) into the stored components, in place. NULL: they are the same. */
    void (*finish)(const sps_tmap_settings *settings, float *texel);
    /* Makes a texel from its ray's curve. */
    void (*fit)(const sps_tmap_settings *settings, const spsi_node *curve, int count, void *scratch, float *texel);
    /* Size of the scratch memory that `fit` needs for a curve of `count` nodes. NULL: none. */
    size_t (*fit_bytes)(int count);
    /* Writes the initial sums of `count` texels. NULL: these are 0. */
    void (*clear)(float *sums, size_t stride, size_t count, int components);
    /* Optical depth before u in 0..1 for a vector of texels. NULL: see `optical_depth`. */
    spsi_v (*optical_depths)(const sps_tmap_settings *settings, const spsi_texels *texels, spsi_v u);
    /* The same for one texel, where that takes a search or more precision than floats have. NULL: see `optical_depths`.
     */
    float (*optical_depth)(const sps_tmap_settings *settings, const float *texel, float u);
    /* Guaranteed bounds of optical depth. NULL: none known; 0 .. SPSI_DEPTH_MAX is returned. */
    void (*bracket)(const sps_tmap_settings *settings, const float *texel, float u, float bracket[2]);
} spsi_technique;

/* ---- intervals ---- */

/* The share of a soft interval that lies in its first `t`. For a whole chord S(t) = t^2 (3 - 2 t); for the last `soft`
   of one, 1 - S(soft (1 - t)) / S(soft), written without cancellation. */
static inline float spsi_soft_share(float soft, float t) {
    return t * (6 * (1 - soft) + t * (6 * soft - 3 - 2 * soft * t)) / (3 - 2 * soft);
}

/* The share of an interval that lies before u. An interval without length lies before u entirely if u >= u0, and so
   does any that ends at u: a query at an occluder's back includes it. */
static inline float spsi_interval_share(const spsi_interval *interval, float u) {
    float t;
    if (u < interval->u0) return 0;
    if (!(u < interval->u1)) return 1;
    t = (u - interval->u0) / (interval->u1 - interval->u0);
    return interval->soft > 0 ? spsi_soft_share(interval->soft, t) : t;
}

/* The same for a query: at u = 1 what lies behind counts, too. */
static inline float spsi_interval_before(const spsi_interval *interval, float u) {
    return u < 1 ? spsi_interval_share(interval, u) : 1;
}

/* Exact optical depth before u of a list sorted by u0. Cost: the intervals that begin before u. */
static inline float spsi_intervals_optical_depth(const spsi_interval *list, uint32_t count, float u) {
    double sum = 0;
    for (uint32_t i = 0; i < count && list[i].u0 <= u; ++i)
        sum += (double)list[i].depth * (double)spsi_interval_before(&list[i], u);
    return (float)fmin(sum, (double)SPSI_DEPTH_MAX);
}

/* By u0; the rest only makes the order, and with it round-off, independent of the order of insertion. */
static inline int spsi_interval_less(const spsi_interval *a, const spsi_interval *b) {
    if (a->u0 < b->u0 || a->u0 > b->u0) return a->u0 < b->u0;
    if (a->u1 < b->u1 || a->u1 > b->u1) return a->u1 < b->u1;
    if (a->depth < b->depth || a->depth > b->depth) return a->depth < b->depth;
    return a->soft < b->soft;
}

/* Merges the sorted first `half` of a list with the sorted rest. The part of the first half that comes before all of
   the rest stays in place, so that a list that is nearly in order costs next to nothing. */
static void spsi_intervals_merge(spsi_interval *list, size_t half, size_t count, spsi_interval *scratch) {
    size_t to = half, left = 0, right = half, moved;
    while (to > 0 && spsi_interval_less(&list[half], &list[to - 1])) --to;
    moved = half - to;
    memcpy(scratch, list + to, moved * sizeof *list);
    while (left < moved && right < count)
        list[to++] = spsi_interval_less(&list[right], &scratch[left]) ? list[right++] : scratch[left++];
    memcpy(list + to, scratch + left, (moved - left) * sizeof *list);
}

static void spsi_intervals_insert(spsi_interval *list, size_t count) {
    for (size_t i = 1; i < count; ++i) {
        const spsi_interval taken = list[i];
        size_t k = i;
        for (; k > 0 && spsi_interval_less(&taken, &list[k - 1]); --k) list[k] = list[k - 1];
        list[k] = taken;
    }
}

#define SPSI_SORT_SHORT 16 /* number of intervals up to which insertion is faster than merging */

/* Sorts intervals by where they begin; `scratch` has room for half of them. Merge sort: n log n at worst, n if they are
   nearly in order. */
static void spsi_intervals_sort(spsi_interval *list, size_t count, spsi_interval *scratch) {
    const size_t half = count / 2;
    if (count <= SPSI_SORT_SHORT) {
        spsi_intervals_insert(list, count);
        return;
    }
    spsi_intervals_sort(list, half, scratch);
    spsi_intervals_sort(list + half, count - half, scratch);
    spsi_intervals_merge(list, half, count, scratch);
}

/* spsi_interval_share for a vector of intervals. */
static inline spsi_v spsi_intervals_before(const spsi_intervals *intervals, spsi_v u) {
    const spsi_v one = spsi_set(1), length = spsi_max(spsi_sub(intervals->u1, intervals->u0), spsi_set(1e-30f));
    const float soft = intervals->soft;
    spsi_v s = spsi_clamp(spsi_div(spsi_sub(u, intervals->u0), length), spsi_set(0), one);
    if (soft > 0) {
        const spsi_v bend = spsi_fma(spsi_set(-2 * soft), s, spsi_set(6 * soft - 3));
        s = spsi_mul(spsi_mul(s, spsi_fma(s, bend, spsi_set(6 * (1 - soft)))), spsi_set(1 / (3 - 2 * soft)));
    }
    s = spsi_select(spsi_less(u, intervals->u1), s, one);
    return spsi_select(spsi_less(u, intervals->u0), spsi_set(0), s);
}

static inline spsi_v spsi_intervals_capped(const spsi_intervals *intervals) {
    return spsi_clamp(intervals->depth, spsi_set(0), spsi_set(SPSI_DEPTH_MAX));
}

static inline void spsi_accumulate(float *sums, spsi_v more) { spsi_store(sums, spsi_add(spsi_load(sums), more)); }

/* Component k of each of a vector's texels. */
static inline spsi_v spsi_texels_at(const spsi_texels *texels, spsi_v k) {
    return spsi_lookup(texels->floats, texels->stride, spsi_add(texels->x, k), texels->y);
}

/* Where the first of a vector's intervals begins and the last one ends, within 0..1. Returns 0 if there are none. */
static int spsi_intervals_extent(const spsi_intervals *intervals, float *first, float *last) {
    float u0[SPSI_LANES], u1[SPSI_LANES];
    const spsi_m there = spsi_less(spsi_set(0), intervals->depth);
    if (!spsi_bits(there)) return 0;
    spsi_store(u0, spsi_select(there, intervals->u0, spsi_set(1)));
    spsi_store(u1, spsi_select(there, intervals->u1, spsi_set(0)));
    for (int i = 1; i < SPSI_LANES; ++i) u0[0] = spsi_lower(u0[0], u0[i]), u1[0] = spsi_higher(u1[0], u1[i]);
    *first = spsi_higher(u0[0], 0);
    *last = spsi_lower(u1[0], 1);
    return 1;
}

/* ---- curves ---- */

/* Maximum number of nodes of a curve of `count` intervals: a soft one bends it at both ends of its pieces, and there is
   a jump at either end for those that are cut. Intervals needed to build it: two per piece, one for what lies before or
   behind, and half as many again for sorting. */
#define SPSI_CURVE_NODES(count, pieces)   (((pieces) + 1) * (count) + 2)
#define SPSI_CURVE_SCRATCH(count, pieces) (3 * ((pieces) + 1) * (count))

#define SPSI_SOFT_DEPTH  8  /* optical depth into a soft interval behind which the rest of it is not cut finely */
#define SPSI_SOFT_HALVES 20 /* bisection steps that find this depth in a cut interval, to a millionth of its length */

/* Number of even pieces of soft intervals with which transmittance is off by at most a quarter of epsilon: the error of
   a piece of length h is h^2 / 8 times the slope of density, which is 6 d at either end of an interval of depth d;
   those that overlap add up. Behind SPSI_SOFT_DEPTH light is practically gone, so no more of each interval counts, nor
   more than twice that of all. */
static int spsi_soft_pieces(const spsi_interval *list, int count, float epsilon) {
    double sum = 0;
    for (int i = 0; i < count; ++i)
        if (list[i].soft > 0) sum += fmin((double)list[i].depth, SPSI_SOFT_DEPTH);
    return (int)fmin(2 + ceil(sqrt(3 * fmin(sum, 2 * SPSI_SOFT_DEPTH) / (double)epsilon)), SPSI_SOFT_MOST);
}

/* The place in a soft interval, between `from` and `to`, where light is practically gone: where t^2 = SPSI_SOFT_DEPTH /
   depth in a whole chord, before which lies more than that depth, as S(t) > t^2; in one that is cut, where twice that
   depth lies before it, which bisection finds. */
static float spsi_soft_end(const spsi_interval *interval, float from, float to) {
    const float want = spsi_interval_share(interval, from) + 2 * SPSI_SOFT_DEPTH / interval->depth;
    if (!(interval->depth > SPSI_SOFT_DEPTH) || !(spsi_interval_share(interval, to) > want)) return to;
    if (!(interval->u0 < from) && !(interval->soft < 1))
        return spsi_lower(to, from + (interval->u1 - from) * sqrtf(SPSI_SOFT_DEPTH / interval->depth));
    for (int i = 0; i < SPSI_SOFT_HALVES; ++i) {
        const float middle = 0.5f * (from + to);
        if (spsi_interval_share(interval, middle) > want)
            to = middle;
        else
            from = middle;
    }
    return to;
}

/* The bends of an interval's curve, built piece by piece: the end of the last piece, and the share of the interval
   before it. */
typedef struct spsi_bends {
    spsi_interval *list;
    int count;
    float depth, u, share;
} spsi_bends;

/* Appends an even piece as two bends: one where the last piece ended, which points ahead to its end, and one at its
   end, which points back, so that depth / (u1 - u0) is the change of slope at either. A piece without length is a
   single bend, a jump. */
static void spsi_bends_add(spsi_bends *bends, float u, float share) {
    const spsi_interval ahead = {bends->u, u, bends->depth * (share - bends->share), 0};
    const spsi_interval back = {u, bends->u, ahead.depth, 0};
    if (!(share > bends->share)) return;
    bends->list[bends->count++] = ahead;
    if (u > bends->u) bends->list[bends->count++] = back;
    bends->u = u, bends->share = share;
}

/* The bends of the part of an interval within 0..1, which is cut into several pieces if soft; the parts before and
   behind become jumps. All pieces of a deep interval except for the last lie where light still gets to. Returns the
   number of bends. */
static int spsi_curve_bends(const spsi_interval *interval, int soft_pieces, spsi_interval *list) {
    const float first = spsi_higher(spsi_lower(interval->u0, 1), 0), last = spsi_higher(spsi_lower(interval->u1, 1), 0);
    const int pieces = interval->soft > 0 && last > first ? soft_pieces : 1;
    const float end = pieces > 1 ? spsi_soft_end(interval, first, last) : last;
    const int fine = end < last ? pieces - 1 : pieces;
    spsi_bends bends = {list, 0, spsi_lower(interval->depth, SPSI_DEPTH_MAX), first, 0};
    if (!(bends.depth > 0)) return 0;
    if (interval->u0 < 0) spsi_bends_add(&bends, first, spsi_interval_share(interval, first));
    for (int i = 1; i < pieces; ++i) {
        const float u = first + (end - first) * ((float)i / (float)fine);
        spsi_bends_add(&bends, u, spsi_interval_share(interval, u));
    }
    if (last > first) spsi_bends_add(&bends, last, spsi_interval_share(interval, last));
    spsi_bends_add(&bends, last, 1);
    return bends.count;
}

/* A compensated sum, for numbers as far apart as the slopes of thin dense and thick faint gas, some of which are
   subtracted again. [Neumaier 1974] */
typedef struct spsi_sum {
    double high, low;
} spsi_sum;

static inline void spsi_sum_add(spsi_sum *sum, double x) {
    const double high = sum->high + x;
    sum->low += fabs(sum->high) >= fabs(x) ? sum->high - high + x : x - high + sum->high;
    sum->high = high;
}

/* Appends a node unless it is redundant: of more than two at one u, only the outer ones matter. */
static int spsi_curve_append(spsi_node *nodes, int count, float u, double depth) {
    const float capped = spsi_lower((float)depth, SPSI_DEPTH_MAX);
    const int same = count > 0 && !(nodes[count - 1].u < u);
    if (same && !(nodes[count - 1].value < capped)) return count;
    if (same && count > 1 && !(nodes[count - 2].u < u)) --count;
    nodes[count].u = u;
    nodes[count].value = capped;
    return count + 1;
}

/* The sum of intervals sorted by u0 as a curve, its ends and bends exact except for round-off. Soft intervals are cut
   into `pieces`, at least 2. `scratch` has room for SPSI_CURVE_SCRATCH(count, pieces) intervals, `nodes` for
   SPSI_CURVE_NODES(count, pieces) nodes. Returns the number of nodes, the first of which has depth 0. Cost: n log n. */
static int spsi_curve_build(const spsi_interval *sorted, int count, int pieces, spsi_interval *scratch,
                            spsi_node *nodes) {
    int bends = 0, nodes_made = 0, open = 0;
    double depth = 0;
    spsi_sum slope = {0, 0};
    for (int i = 0; i < count; ++i) bends += spsi_curve_bends(&sorted[i], pieces, scratch + bends);
    spsi_intervals_sort(scratch, (size_t)bends, scratch + bends);
    for (int i = 0; i < bends; ++i) {
        const double length = (double)scratch[i].u1 - (double)scratch[i].u0, more = (double)scratch[i].depth;
        if (i > 0) depth += fmax(slope.high + slope.low, 0) * ((double)scratch[i].u0 - (double)scratch[i - 1].u0);
        nodes_made = spsi_curve_append(nodes, nodes_made, scratch[i].u0, depth);
        if (length > 0 || length < 0) {
            spsi_sum_add(&slope, more / length);
            open += length > 0 ? 1 : -1;
            if (open == 0) slope.high = slope.low = 0;
        } else
            nodes_made = spsi_curve_append(nodes, nodes_made, scratch[i].u0, depth += more);
    }
    return nodes_made;
}

/* ---- turning angles ---- */

/* Cosine and sine of 2 pi u with an error of 2e-7, for |u| < 2^20; for small angles that is the relative error of the
   sine. u - n / 2 lies within a quarter turn of 0 and is exact; the polynomials interpolate cosine and sine / u at the
   zeros of a Chebyshev polynomial in u^2. */
static inline void spsi_turn(spsi_v u, spsi_v *cosine, spsi_v *sine) {
    const spsi_v n = spsi_round(spsi_add(u, u)), half = spsi_mul(n, spsi_set(0.5f));
    const spsi_v r = spsi_sub(u, half), x = spsi_mul(r, r);
    const spsi_v sign = spsi_fma(spsi_sub(spsi_floor(half), half), spsi_set(4), spsi_set(1)); /* -1 for odd n */
    spsi_v c = spsi_set(-24.98143447f), s = spsi_set(39.75982709f);
    c = spsi_fma(c, x, spsi_set(60.14388956f));
    s = spsi_fma(s, x, spsi_set(-76.58117264f));
    c = spsi_fma(c, x, spsi_set(-85.45356477f));
    s = spsi_fma(s, x, spsi_set(81.60247637f));
    c = spsi_fma(c, x, spsi_set(64.93934648f));
    s = spsi_fma(s, x, spsi_set(-41.34168061f));
    c = spsi_fma(c, x, spsi_set(-19.73920855f));
    s = spsi_fma(s, x, spsi_set(6.28318528f));
    *cosine = spsi_mul(sign, spsi_fma(c, x, spsi_set(1)));
    *sine = spsi_mul(sign, spsi_mul(s, r));
}

/* The next multiple of an angle: (c, s) rotated by (c1, s1). */
static inline void spsi_turn_by(spsi_v *c, spsi_v *s, spsi_v c1, spsi_v s1) {
    const spsi_v turned = spsi_sub(spsi_mul(*c, c1), spsi_mul(*s, s1));
    *s = spsi_fma(*s, c1, spsi_mul(*c, s1));
    *c = turned;
}

/* The same for one angle in double precision: z = cosine, sine. */
static inline void spsi_turn_double(double z[2], const double by[2]) {
    const double cosine = z[0] * by[0] - z[1] * by[1];
    z[1] = z[1] * by[0] + z[0] * by[1];
    z[0] = cosine;
}

/* The weight of harmonic k of n. */
static double spsi_window(sps_tmap_window window, int k, int n) {
    const double share = (double)k / (n + 1);
    if (window == SPS_TMAP_WINDOW_FEJER) return 1 - share;
    return window == SPS_TMAP_WINDOW_LANCZOS && k > 0 ? sin(SPSI_PI * share) / (SPSI_PI * share) : 1;
}

/* ---- opacity planes ---- */

static inline float spsi_plane(const sps_tmap_settings *settings, int i) {
    return settings->planes ? settings->planes[i] : (float)(i + 1) / (float)settings->components;
}

/* The first plane that is not before u; the last if all are. */
static int spsi_plane_from(const sps_tmap_settings *settings, float u) {
    const int last = settings->components - 1;
    int low = 0, high = last;
    if (!settings->planes) { /* start one plane early, to be safe from round-off */
        low = spsi_most((int)(u * (float)settings->components) - 1, 0);
        while (low < last && spsi_plane(settings, low) < u) ++low;
        return spsi_least(low, last);
    }
    while (low < high) {
        const int middle = (low + high) / 2;
        if (settings->planes[middle] < u)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* Adds to each plane its increment over the plane before, so that planes behind an interval need not be visited. */
static void spsi_opacity_insert(const sps_tmap_settings *settings, float *sums, size_t stride,
                                const spsi_intervals *intervals) {
    const spsi_v depth = spsi_intervals_capped(intervals);
    spsi_v before = spsi_set(0);
    float first, end;
    int last;
    if (!spsi_intervals_extent(intervals, &first, &end)) return;
    last = spsi_plane_from(settings, end);
    for (int i = spsi_plane_from(settings, first); i <= last; ++i) {
        spsi_v share = spsi_set(1); /* what lies behind 1 counts at the last plane */
        if (i < settings->components - 1) share = spsi_intervals_before(intervals, spsi_set(spsi_plane(settings, i)));
        share = spsi_max(share, before); /* round-off must not lower it */
        spsi_accumulate(sums + (size_t)i * stride, spsi_mul(depth, spsi_sub(share, before)));
        before = share;
    }
}

static void spsi_opacity_finish(const sps_tmap_settings *settings, float *texel) {
    double sum = 0;
    for (int i = 0; i < settings->components; ++i) {
        sum += (double)texel[i];
        texel[i] = (float)fmin(sum, (double)SPSI_DEPTH_MAX);
    }
}

/* The points of curves through planes, u and optical depth; plane -1 is 0 at u = 0. */
typedef struct spsi_knots {
    spsi_v u, depth;
} spsi_knots;

static inline spsi_knots spsi_opacity_knots(const sps_tmap_settings *settings, const spsi_texels *texels,
                                            spsi_v plane) {
    const spsi_v zero = spsi_set(0), at = spsi_clamp(plane, zero, spsi_set((float)(settings->components - 1)));
    const spsi_m before = spsi_less(plane, zero);
    spsi_knots knots;
    knots.u = settings->planes ? spsi_lookup(settings->planes, 0, at, zero)
                               : spsi_div(spsi_add(at, spsi_set(1)), spsi_set((float)settings->components));
    knots.u = spsi_select(before, zero, knots.u);
    knots.depth = spsi_select(before, zero, spsi_texels_at(texels, at));
    return knots;
}

/* spsi_plane_from for a vector; for even planes, the same except for round-off. */
static inline spsi_v spsi_planes_from(const sps_tmap_settings *settings, spsi_v u) {
    const int last = settings->components - 1;
    const spsi_v zero = spsi_set(0), one = spsi_set(1);
    spsi_v plane = zero;
    if (!settings->planes) {
        plane = spsi_sub(zero, spsi_floor(spsi_mul(u, spsi_set((float)-settings->components))));
        return spsi_clamp(spsi_sub(plane, one), zero, spsi_set((float)last));
    }
    for (int i = 0; i < last; ++i)
        plane = spsi_select(spsi_less(spsi_set(settings->planes[i]), u), spsi_set((float)(i + 1)), plane);
    return plane;
}

/* a / b, or 0 where b is 0, as between a knot and its own copy beyond the first or the last plane. */
static inline spsi_v spsi_ratio(spsi_v a, spsi_v b) {
    const spsi_m some = spsi_less(spsi_set(0), spsi_abs(b));
    return spsi_select(some, spsi_div(a, spsi_select(some, b, spsi_set(1))), spsi_set(0));
}

static inline spsi_v spsi_secant(const spsi_knots *a, const spsi_knots *b) {
    return spsi_ratio(spsi_sub(b->depth, a->depth), spsi_sub(b->u, a->u));
}

/* The slope at b of the cubic through increasing points a, b, c: that of their parabola, limited so that nothing
   overshoots. [Steffen 1990] */
static inline spsi_v spsi_steffen_inner(const spsi_knots *a, const spsi_knots *b, const spsi_knots *c) {
    const spsi_v before = spsi_secant(a, b), after = spsi_secant(b, c);
    const spsi_v sum = spsi_fma(before, spsi_sub(c->u, b->u), spsi_mul(after, spsi_sub(b->u, a->u)));
    const spsi_v parabola = spsi_ratio(sum, spsi_sub(c->u, a->u));
    return spsi_mul(spsi_set(2), spsi_min(spsi_min(before, after), spsi_mul(spsi_set(0.5f), parabola)));
}

/* The slope at the endpoint a of a curve whose next points are b and c. [Steffen 1990] */
static inline spsi_v spsi_steffen_end(const spsi_knots *a, const spsi_knots *b, const spsi_knots *c) {
    const spsi_v secant = spsi_secant(a, b), part = spsi_ratio(spsi_sub(b->u, a->u), spsi_sub(c->u, a->u));
    const spsi_v slope = spsi_fma(part, spsi_sub(secant, spsi_secant(b, c)), secant);
    return spsi_clamp(slope, spsi_set(0), spsi_add(secant, secant));
}

/* The monotone cubic between planes i - 1 and i, which are b and c: Hermite form relative to the straight line, so that
   it is exact for straight lines and at both ends. */
static inline spsi_v spsi_opacity_cubic(const sps_tmap_settings *settings, const spsi_texels *texels, spsi_v i,
                                        const spsi_knots *b, const spsi_knots *c, spsi_v t) {
    const spsi_v one = spsi_set(1), even = spsi_secant(b, c), rest = spsi_sub(one, t),
                 rise = spsi_sub(c->depth, b->depth);
    const spsi_knots a = spsi_opacity_knots(settings, texels, spsi_sub(i, spsi_set(2)));
    const spsi_knots d = spsi_opacity_knots(settings, texels, spsi_add(i, one));
    const spsi_m first = spsi_less(i, spsi_set(0.5f));
    const spsi_m last = spsi_less(spsi_set((float)settings->components - 1.5f), i);
    const spsi_v first_slope = spsi_select(last, even, spsi_steffen_end(b, c, &d));
    const spsi_v last_slope = spsi_select(first, even, spsi_steffen_end(c, b, &a));
    const spsi_v slope0 = spsi_select(first, first_slope, spsi_steffen_inner(&a, b, c));
    const spsi_v slope1 = spsi_select(last, last_slope, spsi_steffen_inner(b, c, &d));
    spsi_v bend = spsi_sub(spsi_mul(rest, spsi_sub(slope0, even)), spsi_mul(t, spsi_sub(slope1, even)));
    bend = spsi_mul(spsi_mul(spsi_mul(t, rest), spsi_sub(c->u, b->u)), bend);
    return spsi_clamp(spsi_add(spsi_fma(t, rise, b->depth), bend), b->depth, c->depth);
}

/* Cost: two lookups, or four if cubic; a comparison with every plane if settings->planes is set. */
static spsi_v spsi_opacity_optical_depths(const sps_tmap_settings *settings, const spsi_texels *texels, spsi_v u) {
    const spsi_v zero = spsi_set(0), i = spsi_planes_from(settings, u);
    const spsi_knots before = spsi_opacity_knots(settings, texels, spsi_sub(i, spsi_set(1)));
    const spsi_knots after = spsi_opacity_knots(settings, texels, i);
    const spsi_v share = spsi_ratio(spsi_sub(u, before.u), spsi_sub(after.u, before.u));
    const spsi_v t = spsi_clamp(share, zero, spsi_set(1));
    const spsi_v depth = settings->cubic ? spsi_opacity_cubic(settings, texels, i, &before, &after, t)
                                         : spsi_mix(before.depth, after.depth, t);
    return spsi_select(spsi_less(zero, u), spsi_select(spsi_less(u, after.u), depth, after.depth), zero);
}

/* Optical depth never decreases, so the planes around u bound it. */
static void spsi_opacity_bracket(const sps_tmap_settings *settings, const float *texel, float u, float bracket[2]) {
    const int i = spsi_plane_from(settings, u);
    bracket[0] = i > 0 ? texel[i - 1] : 0;
    bracket[1] = texel[i];
}

/* ---- Fourier series ---- */

/* The mean of cos(2 pi k (u - m)) over an interval with middle m and half length h, where x = 2 pi k h has cosine c and
   sine s: sin x / x for a uniform one, 3 (sin x - x cos x) / x^3 for a soft one, which cancels for small x; its series,
   cut after x^10, is as accurate up to 2. */
static inline spsi_v spsi_fourier_spread(spsi_v x, spsi_v c, spsi_v s, float soft) {
    const spsi_v one = spsi_set(1), safe = spsi_max(x, spsi_set(1e-6f)), square = spsi_mul(x, x);
    spsi_v series, closed;
    if (!(soft > 0)) return spsi_select(spsi_less(x, spsi_set(1e-6f)), one, spsi_div(s, safe));
    series = spsi_set(-1.0f / 172972800);
    series = spsi_fma(series, square, spsi_set(1.0f / 1330560));
    series = spsi_fma(series, square, spsi_set(-1.0f / 15120));
    series = spsi_fma(series, square, spsi_set(1.0f / 280));
    series = spsi_fma(series, square, spsi_set(-0.1f));
    series = spsi_fma(series, square, one);
    closed = spsi_div(spsi_mul(spsi_set(3), spsi_sub(s, spsi_mul(x, c))), spsi_mul(spsi_max(square, one), safe));
    return spsi_select(spsi_less(x, spsi_set(2)), series, closed);
}

/* a_k += 2 t cos(2 pi k m) spread_k, b_k likewise with the sine. */
static void spsi_fourier_insert(const sps_tmap_settings *settings, float *sums, size_t stride,
                                const spsi_intervals *intervals) {
    const spsi_v middle = spsi_mul(spsi_set(0.5f), spsi_add(intervals->u0, intervals->u1));
    const spsi_v half = spsi_mul(spsi_set(0.5f), spsi_max(spsi_sub(intervals->u1, intervals->u0), spsi_set(0)));
    const spsi_v depth = spsi_intervals_capped(intervals), twice = spsi_add(depth, depth);
    spsi_v c1, s1, ch, sh, c, s, cd, sd;
    spsi_turn(middle, &c1, &s1);
    spsi_turn(half, &ch, &sh);
    c = c1, s = s1, cd = ch, sd = sh;
    spsi_accumulate(sums, twice);
    for (int k = 1; 2 * k < settings->components; ++k) {
        const spsi_v x = spsi_mul(half, spsi_set((float)(2 * SPSI_PI * k)));
        const spsi_v size = spsi_mul(twice, spsi_fourier_spread(x, cd, sd, intervals->soft));
        spsi_accumulate(sums + (size_t)(2 * k - 1) * stride, spsi_mul(size, c));
        spsi_accumulate(sums + (size_t)(2 * k) * stride, spsi_mul(size, s));
        spsi_turn_by(&c, &s, c1, s1);
        spsi_turn_by(&cd, &sd, ch, sh);
    }
}

/* The window is baked in, so that shaders need not know it. */
static void spsi_fourier_finish(const sps_tmap_settings *settings, float *texel) {
    const int n = (settings->components - 1) / 2;
    for (int i = 1; i < settings->components; ++i)
        texel[i] = (float)((double)texel[i] * spsi_window(settings->window, (i + 1) / 2, n));
}

/* The contribution of harmonic k to the optical depth before u, on top of a0 u / 2: (a_k sin(2 pi k u) +
   b_k (1 - cos(2 pi k u))) / (2 pi k). [Jansen & Bavoil 2010] */
static inline spsi_v spsi_fourier_harmonic(spsi_v a, spsi_v b, int k, spsi_v cosine, spsi_v sine) {
    const spsi_v both = spsi_fma(a, sine, spsi_mul(b, spsi_sub(spsi_set(1), cosine)));
    return spsi_mul(both, spsi_set((float)(1 / (2 * SPSI_PI * k))));
}

#define SPSI_FOURIER_SAMPLES (2 * (SPSI_TMAP_COMPONENTS - 1))
#define SPSI_FOURIER_GROUP   8 /* samples that share lookups, and that fit on a task's stack */

/* The maximum of `most` and of the series at those of 4 n even samples that lie before u, where n is the number of
   harmonics: the highest has four samples per period. All multiples of the samples' angles are angles of samples. */
static spsi_v spsi_fourier_running(const spsi_texels *texels, int components, spsi_v u, spsi_v most) {
    const int samples = 2 * (components - 1);
    const double by[2] = {cos(2 * SPSI_PI / samples), sin(2 * SPSI_PI / samples)};
    const spsi_v slope = spsi_mul(spsi_texels_at(texels, spsi_set(0)), spsi_set(0.5f / (float)samples));
    float cosines[SPSI_FOURIER_SAMPLES], sines[SPSI_FOURIER_SAMPLES];
    double z[2] = {1, 0};
    for (int i = 0; i < samples; ++i) {
        cosines[i] = (float)z[0], sines[i] = (float)z[1];
        spsi_turn_double(z, by);
    }
    for (int first = 1; first < samples; first += SPSI_FOURIER_GROUP) {
        const int count = spsi_least(SPSI_FOURIER_GROUP, samples - first);
        spsi_v sums[SPSI_FOURIER_GROUP];
        if (!spsi_bits(spsi_less(spsi_set((float)first / (float)samples), u))) break;
        for (int i = 0; i < count; ++i) sums[i] = spsi_mul(slope, spsi_set((float)(first + i)));
        for (int k = 1; 2 * k < components; ++k) {
            const spsi_v a = spsi_texels_at(texels, spsi_set((float)(2 * k - 1)));
            const spsi_v b = spsi_texels_at(texels, spsi_set((float)(2 * k)));
            for (int i = 0; i < count; ++i) {
                const int turn = k * (first + i) % samples;
                sums[i] =
                    spsi_add(sums[i], spsi_fourier_harmonic(a, b, k, spsi_set(cosines[turn]), spsi_set(sines[turn])));
            }
        }
        for (int i = 0; i < count; ++i) {
            const spsi_m before = spsi_less(spsi_set((float)(first + i) / (float)samples), u);
            most = spsi_select(before, spsi_max(most, sums[i]), most);
        }
    }
    return most;
}

/* Clamped to 0 .. the total. */
static spsi_v spsi_fourier_optical_depths(const sps_tmap_settings *settings, const spsi_texels *texels, spsi_v u) {
    const spsi_v half = spsi_mul(spsi_set(0.5f), spsi_texels_at(texels, spsi_set(0)));
    spsi_v cosine, sine, c, s, sum = spsi_mul(half, u);
    spsi_turn(u, &cosine, &sine);
    c = cosine, s = sine;
    for (int k = 1; 2 * k < settings->components; ++k) {
        const spsi_v a = spsi_texels_at(texels, spsi_set((float)(2 * k - 1)));
        const spsi_v b = spsi_texels_at(texels, spsi_set((float)(2 * k)));
        sum = spsi_add(sum, spsi_fourier_harmonic(a, b, k, c, s));
        spsi_turn_by(&c, &s, cosine, sine);
    }
    if (settings->running_maximum) sum = spsi_fourier_running(texels, settings->components, u, sum);
    return spsi_clamp(sum, spsi_set(0), spsi_min(half, spsi_set(SPSI_DEPTH_MAX)));
}

/* ---- curves for fits, piece by piece ---- */

/* A straight piece of a curve, of optical depths t0 to t1; u0 = u1 is a jump. */
typedef struct spsi_piece {
    double u0, u1, t0, t1;
} spsi_piece;

/* The piece that ends at node i; the first one is a jump from 0. */
static inline spsi_piece spsi_curve_piece(const spsi_node *curve, int i) {
    spsi_piece piece;
    piece.u1 = (double)curve[i].u;
    piece.t1 = (double)spsi_lower(curve[i].value, SPSI_DEPTH_MAX);
    piece.u0 = i > 0 ? (double)curve[i - 1].u : piece.u1;
    piece.t0 = i > 0 ? (double)spsi_lower(curve[i - 1].value, (float)piece.t1) : 0;
    return piece;
}

/* -log T: 0 for T above 1, SPSI_DEPTH_MAX for T = 0 or less. */
static inline float spsi_optical_depth_of(double transmittance) {
    if (!(transmittance > 0)) return SPSI_DEPTH_MAX;
    return (float)(transmittance < 1 ? 0 - log(transmittance) : 0);
}

/* Transmittance of a polyline with nodes (u, T): 1 before the first, the last T after the last, the later one if two
   share one u. Cost: a binary search. */
static double spsi_nodes_transmittance(const spsi_node *nodes, uint32_t count, float u) {
    uint32_t low = 0, high = count; /* the first node behind u */
    double t;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (nodes[middle].u <= u)
            low = middle + 1;
        else
            high = middle;
    }
    if (low == 0) return 1;
    if (low == count) return (double)nodes[count - 1].value;
    t = ((double)u - (double)nodes[low - 1].u) / ((double)nodes[low].u - (double)nodes[low - 1].u);
    return (double)nodes[low - 1].value + t * ((double)nodes[low].value - (double)nodes[low - 1].value);
}

/* ---- depth maps ---- */

/* u where T falls to one half; 2 if it never does. */
static void spsi_depth_fit(const sps_tmap_settings *settings, const spsi_node *curve, int count, void *scratch,
                           float *texel) {
    const double half = 0.69314718055994531;
    (void)settings;
    (void)scratch;
    texel[0] = 2;
    for (int i = 0; i < count; ++i) {
        const spsi_piece piece = spsi_curve_piece(curve, i);
        if (!(piece.t1 >= half)) continue;
        texel[0] = (float)(piece.u0 + (half - piece.t0) / (piece.t1 - piece.t0) * (piece.u1 - piece.u0));
        return;
    }
}

static spsi_v spsi_depth_optical_depths(const sps_tmap_settings *settings, const spsi_texels *texels, spsi_v u) {
    (void)settings;
    return spsi_select(spsi_less(u, spsi_texels_at(texels, spsi_set(0))), spsi_set(0), spsi_set(SPSI_DEPTH_MAX));
}

/* ---- cosine series ---- */

/* A point of a curve: terms shared by the integrals of the pieces on either side of it. */
typedef struct spsi_cosine_end {
    double u, depth, through, turn[2]; /* turn: cosine and sine of pi u */
} spsi_cosine_end;

static spsi_cosine_end spsi_cosine_end_at(double u, double depth) {
    const spsi_cosine_end end = {u, depth, exp(-depth), {cos(SPSI_PI * u), sin(SPSI_PI * u)}};
    return end;
}

/* sums[k] += integral of T cos(pi k u) over a piece from a to b. T = e^-t0 e^-s(u - u0), so the antiderivative of
   T e^(i w u) is that function divided by i w - s: only k = 0 with s = 0 needs a limit. Since w is pi or more,
   round-off is no larger than that of T itself. */
static void spsi_cosine_add(double *sums, int components, const spsi_cosine_end *a, const spsi_cosine_end *b) {
    const double length = b->u - a->u, more = b->depth - a->depth;
    double z0[2] = {a->turn[0], a->turn[1]}, z1[2] = {b->turn[0], b->turn[1]}, slope;
    if (!(length > 0) || !(a->through > 0)) return;
    slope = more / length;
    sums[0] += length * a->through * (more > 1e-12 ? -expm1(-more) / more : 1);
    for (int k = 1; k < components; ++k) {
        const double w = SPSI_PI * k, cosine = a->through * z0[0] - b->through * z1[0];
        const double sine = b->through * z1[1] - a->through * z0[1];
        sums[k] += (slope * cosine + w * sine) / (slope * slope + w * w);
        spsi_turn_double(z0, a->turn);
        spsi_turn_double(z1, b->turn);
    }
}

/* T = c_0 + sum of c_k cos(pi k u), c_k = 2 integral of T cos(pi k u), with the window baked in. Mirrored at both ends,
   T has no jump there, unlike extinction repeated periodically. */
static void spsi_cosine_fit(const sps_tmap_settings *settings, const spsi_node *curve, int count, void *scratch,
                            float *texel) {
    const int n = settings->components;
    spsi_cosine_end from = spsi_cosine_end_at(0, 0), to;
    double sums[SPSI_TMAP_COMPONENTS];
    (void)scratch;
    memset(sums, 0, sizeof sums);
    for (int i = -1; i < count && count > 0; ++i, from = to) { /* first the part before the curve, with depth 0 */
        const spsi_piece piece = spsi_curve_piece(curve, spsi_most(i, 0));
        to = spsi_cosine_end_at(piece.u1, i < 0 ? 0 : piece.t1);
        spsi_cosine_add(sums, n, &from, &to);
    }
    to = spsi_cosine_end_at(1, from.depth);
    spsi_cosine_add(sums, n, &from, &to);
    texel[0] = (float)sums[0];
    for (int k = 1; k < n; ++k) texel[k] = (float)(2 * sums[k] * spsi_window(settings->window, k, n - 1));
}

/* T is clamped to at least e^-SPSI_LIGHT_END, 1e-7: that is the round-off of coefficients up to 1, and otherwise a
   series that rings below 0 would be opaque. */
static spsi_v spsi_cosine_optical_depths(const sps_tmap_settings *settings, const spsi_texels *texels, spsi_v u) {
    const float least = expf(-SPSI_LIGHT_END);
    float lanes[SPSI_LANES];
    spsi_v cosine, sine, c, s, sum = spsi_texels_at(texels, spsi_set(0));
    spsi_turn(spsi_mul(spsi_set(0.5f), u), &cosine, &sine);
    c = cosine, s = sine;
    for (int k = 1; k < settings->components; ++k) {
        sum = spsi_fma(spsi_texels_at(texels, spsi_set((float)k)), c, sum);
        spsi_turn_by(&c, &s, cosine, sine);
    }
    spsi_store(lanes, spsi_clamp(sum, spsi_set(least), spsi_set(1)));
    for (int i = 0; i < SPSI_LANES; ++i) lanes[i] = -logf(lanes[i]);
    return spsi_load(lanes);
}

/* ---- transmittance as a polyline ---- */

/* Cuts a piece so that straight lines of T between the cuts stay within step^2 of the exponential: in even steps of
   sqrt(T). Where T falls from a^2 to b^2, the line is at most (a - b)^2 above the exponential: half of that for small
   steps, all of it if b is 0. */
typedef struct spsi_cuts {
    spsi_piece piece;
    float u;             /* of the last cut */
    double through, end; /* T at the last cut, and at the end of the piece */
} spsi_cuts;

/* Before the first piece of a curve. */
static void spsi_cuts_begin(spsi_cuts *cuts) { cuts->end = 1; }

/* Goes on to the piece that ends at node i of a curve; T continues from the end of the piece before. */
static void spsi_cuts_piece(spsi_cuts *cuts, const spsi_node *curve, int i) {
    cuts->piece = spsi_curve_piece(curve, i);
    cuts->u = (float)cuts->piece.u0;
    cuts->through = cuts->end;
    cuts->end = exp(-cuts->piece.t1);
}

/* Goes on to the next cut; returns 0 at the last, which is the end of the piece. Cuts are rounded down to floats, but
   advance by at least one: between neighbouring floats there is no u to query. */
static int spsi_cuts_next(spsi_cuts *cuts, double step) {
    const spsi_piece *piece = &cuts->piece;
    const double length = piece->u1 - piece->u0, more = piece->t1 - piece->t0, root = sqrt(cuts->through) - step;
    const float end = (float)piece->u1;
    float cut = end;
    if (length > 0 && root > 0 && root * root > cuts->end) {
        const double exact = piece->u0 + length * ((-2 * log(root) - piece->t0) / more);
        cut = (float)exact;
        if ((double)cut > exact) cut = nextafterf(cut, -1);
        if (!(cut > cuts->u)) cut = nextafterf(cuts->u, 2);
    }
    cuts->u = spsi_lower(cut, end);
    cuts->through = cut < end ? exp(-(piece->t0 + more * (((double)cut - piece->u0) / length))) : cuts->end;
    return cut < end;
}

/* A deep shadow map under construction: its nodes, and the range of slopes of a line from the last node that has stayed
   within the error so far. */
typedef struct spsi_compressor {
    spsi_node *out;
    int count;
    double low, high;            /* range of slopes */
    double below, above;         /* maximum distance of a line from a cut of the curve */
    double last_u, last_through; /* the last cut that the slopes satisfy */
} spsi_compressor;

static void spsi_compressor_node(spsi_compressor *c, double u, double through) {
    spsi_node *node = &c->out[c->count++];
    node->u = (float)u;
    node->value = (float)through;
    c->low = -(double)SPSI_INFINITY;
    c->high = 0; /* T never rises */
}

/* Ends the line at the last cut, as close to the curve as its slopes allow. */
static void spsi_compressor_end(spsi_compressor *c) {
    const spsi_node *from = &c->out[c->count - 1];
    const double length = c->last_u - (double)from->u, start = (double)from->value;
    double slope;
    if (!(length > 0)) return;
    slope = fmin(fmax((c->last_through - start) / length, c->low), c->high);
    spsi_compressor_node(c, c->last_u, fmax(start + slope * length, 0));
}

/* Narrows the slopes to those that satisfy a cut. Returns 0, and leaves them unchanged, if there are none. */
static int spsi_compressor_allows(spsi_compressor *c, double u, double through) {
    const spsi_node *from = &c->out[c->count - 1];
    const double length = u - (double)from->u, start = (double)from->value;
    const double bottom = fmax(through - c->below, 0) - start, top = through + c->above - start;
    if (!(length > 0)) return bottom <= 0 && top >= 0;
    if (fmax(c->low, bottom / length) > fmin(c->high, top / length)) return 0;
    c->low = fmax(c->low, bottom / length);
    c->high = fmin(c->high, top / length);
    return 1;
}

static void spsi_compressor_take(spsi_compressor *c, double u, double through) {
    if (!spsi_compressor_allows(c, u, through)) {
        spsi_compressor_end(c);
        if (!spsi_compressor_allows(c, u, through)) /* a jump */
            spsi_compressor_node(c, u, fmin(through, (double)c->out[c->count - 1].value));
    }
    c->last_u = u;
    c->last_through = through;
}

#define SPSI_EPSILON_MIN 1e-6f /* minimum error: nodes are floats, accurate to 6e-8 */

static double spsi_compress_step(float epsilon) { return sqrt(0.25 * (double)spsi_higher(epsilon, SPSI_EPSILON_MIN)); }

/* Maximum number of nodes that a curve of `count` nodes is compressed to: two for each cut. There are fewer than
   1 / step steps of sqrt(T), each of which rounding may turn into two cuts. */
static int spsi_compressed_most(int count, float epsilon) {
    return 2 + 2 * count + (int)(4 / spsi_compress_step(epsilon));
}

/* Deep shadow map: straight lines of T, in out[i].value, from T = 1 at the curve's first node to its last. They never
   rise, and are nowhere, including between nodes, more than epsilon (at least 1e-6) off. Lines are as long as a greedy
   search without backtracking makes them [Lokovic & Veach 2000]. A quarter of epsilon is for the error between cuts of
   the curve, which is always upwards, as lines lie above exponentials; 1.2e-7 is for round-off. `out` has room for
   spsi_compressed_most(count, epsilon) nodes. Returns the number of nodes. Cost: linear in the number of cuts. */
static int spsi_curve_compress(const spsi_node *curve, int count, float epsilon, spsi_node *out) {
    const double error = (double)spsi_higher(epsilon, SPSI_EPSILON_MIN), step = spsi_compress_step(epsilon);
    spsi_compressor c = {out, 0, 0, 0, error - 1.2e-7, error - step * step - 1.2e-7, 0, 1};
    spsi_cuts cuts;
    if (count <= 0) return 0;
    c.last_u = (double)curve[0].u;
    spsi_compressor_node(&c, c.last_u, 1);
    spsi_cuts_begin(&cuts);
    for (int i = 0; i < count; ++i) {
        int more = 1;
        for (spsi_cuts_piece(&cuts, curve, i); more;) {
            more = spsi_cuts_next(&cuts, step);
            spsi_compressor_take(&c, (double)cuts.u, cuts.through);
        }
    }
    spsi_compressor_end(&c);
    return c.count;
}

/* Optical depth of compressed nodes: -log T. */
static float spsi_compressed_optical_depth(const spsi_node *nodes, uint32_t count, float u) {
    return spsi_optical_depth_of(spsi_nodes_transmittance(nodes, count, u));
}

/* ---- adaptive maps ---- */

#define SPSI_ADAPTIVE_EPSILON (1.0f / 1024) /* error of the polyline whose nodes are chosen from */

/* A node (u, T) that an adaptive map is made from. */
typedef struct spsi_adaptive_node {
    spsi_node node;
    double cost;       /* change of the area below the curve if this node is removed */
    int before, after; /* remaining neighbours */
    int slot;          /* in the heap */
} spsi_adaptive_node;

/* The heap holds inner nodes, with the cheapest to remove at its top. */
typedef struct spsi_adaptive {
    spsi_adaptive_node *nodes;
    int *heap;
    int count, heap_count;
} spsi_adaptive;

static size_t spsi_adaptive_bytes(int count) {
    const size_t most = (size_t)spsi_compressed_most(count, SPSI_ADAPTIVE_EPSILON);
    return most * (sizeof(spsi_adaptive_node) + sizeof(spsi_node) + sizeof(int));
}

/* Only inner nodes may be removed. */
static int spsi_adaptive_is_inner(const spsi_adaptive *map, int i) { return i > 0 && i < map->count - 1; }

static void spsi_adaptive_price(spsi_adaptive *map, int i) {
    spsi_adaptive_node *own = &map->nodes[i];
    const spsi_node *a = &map->nodes[own->before].node, *b = &own->node, *c = &map->nodes[own->after].node;
    own->cost = fabs(((double)b->u - (double)a->u) * ((double)c->value - (double)a->value) -
                     ((double)c->u - (double)a->u) * ((double)b->value - (double)a->value));
}

static int spsi_adaptive_less(const spsi_adaptive *map, int a, int b) {
    const double first = map->nodes[a].cost, second = map->nodes[b].cost;
    return first < second || (!(second < first) && a < b);
}

static void spsi_adaptive_place(spsi_adaptive *map, int slot, int i) {
    map->heap[slot] = i;
    map->nodes[i].slot = slot;
}

/* Moves node i, whose cost may have changed, up or down in the heap from `slot`. */
static void spsi_adaptive_sift(spsi_adaptive *map, int slot, int i) {
    int child;
    for (; slot > 0 && spsi_adaptive_less(map, i, map->heap[(slot - 1) / 2]); slot = (slot - 1) / 2)
        spsi_adaptive_place(map, slot, map->heap[(slot - 1) / 2]);
    for (; (child = 2 * slot + 1) < map->heap_count; slot = child) {
        if (child + 1 < map->heap_count && spsi_adaptive_less(map, map->heap[child + 1], map->heap[child])) ++child;
        if (!spsi_adaptive_less(map, map->heap[child], i)) break;
        spsi_adaptive_place(map, slot, map->heap[child]);
    }
    spsi_adaptive_place(map, slot, i);
}

/* Removes the cheapest node. */
static void spsi_adaptive_remove(spsi_adaptive *map) {
    const spsi_adaptive_node *gone = &map->nodes[map->heap[0]];
    const int sides[2] = {gone->before, gone->after};
    map->heap_count -= 1;
    if (map->heap_count > 0) spsi_adaptive_sift(map, 0, map->heap[map->heap_count]);
    map->nodes[sides[0]].after = sides[1];
    map->nodes[sides[1]].before = sides[0];
    for (int k = 0; k < 2; ++k) {
        if (!spsi_adaptive_is_inner(map, sides[k])) continue;
        spsi_adaptive_price(map, sides[k]);
        spsi_adaptive_sift(map, map->nodes[sides[k]].slot, sides[k]);
    }
}

/* A compressed curve, whose last node is made exact again: the total transmittance. */
static int spsi_adaptive_begin(const spsi_node *curve, int count, spsi_node *nodes) {
    const int made = spsi_curve_compress(curve, count, SPSI_ADAPTIVE_EPSILON, nodes);
    const float last = made > 0 ? (float)exp(-(double)spsi_lower(curve[count - 1].value, SPSI_DEPTH_MAX)) : 1;
    for (int i = made - 1; i >= 0 && (i == made - 1 || nodes[i].value < last); --i) nodes[i].value = last;
    return made;
}

/* Compresses the curve to few lines first; then the node whose removal changes the area least is removed until there
   are few enough. [Salvi et al. 2010 do so during insertion, with few nodes known at a time: with 4 nodes the error is
   twice as large.] */
static void spsi_adaptive_fit(const sps_tmap_settings *settings, const spsi_node *curve, int count, void *scratch,
                              float *texel) {
    const int most = settings->components / 2, room = spsi_compressed_most(count, SPSI_ADAPTIVE_EPSILON);
    spsi_node *line;
    spsi_adaptive map;
    int at = 0;
    map.nodes = (spsi_adaptive_node *)scratch;
    line = (spsi_node *)(void *)(map.nodes + room);
    map.heap = (int *)(void *)(line + room);
    map.heap_count = 0;
    map.count = spsi_adaptive_begin(curve, count, line);
    for (int i = 0; i < map.count; ++i) {
        map.nodes[i].node = line[i];
        map.nodes[i].before = i - 1, map.nodes[i].after = i + 1;
    }
    for (int i = 1; i < map.count - 1; ++i) {
        spsi_adaptive_price(&map, i);
        map.heap_count += 1;
        spsi_adaptive_sift(&map, map.heap_count - 1, i);
    }
    while (map.heap_count + 2 > most && map.heap_count > 0) spsi_adaptive_remove(&map);
    for (int i = 0; i < most; ++i) {
        texel[2 * i] = map.count > 0 ? map.nodes[at].node.u : 0;
        texel[2 * i + 1] = map.count > 0 ? map.nodes[at].node.value : 1;
        at = map.count > 0 ? spsi_least(map.nodes[at].after, map.count - 1) : 0;
    }
}

static float spsi_adaptive_optical_depth(const sps_tmap_settings *settings, const float *texel, float u) {
    const spsi_node *nodes = (const spsi_node *)(const void *)texel;
    return spsi_optical_depth_of(spsi_nodes_transmittance(nodes, (uint32_t)(settings->components / 2), u));
}

/* ---- moments ---- */

#define SPSI_MOMENTS_MAX 8

/* Binomial coefficients, 2 j of k. */
static const float spsi_moment_choose[SPSI_MOMENTS_MAX + 1][SPSI_MOMENTS_MAX / 2 + 1] = {
    {1, 0, 0, 0, 0},  {1, 0, 0, 0, 0},   {1, 1, 0, 0, 0},   {1, 3, 0, 0, 0},    {1, 6, 1, 0, 0},
    {1, 10, 5, 0, 0}, {1, 15, 15, 1, 0}, {1, 21, 35, 7, 0}, {1, 28, 70, 28, 1},
};

/* Sums of t E z^k, z = 2 u - 1: z = m + h s around the interval's middle, where odd powers of s have mean 0, and even
   powers 1 / (2 j + 1) in a uniform interval, 3 / ((2 j + 1) (2 j + 3)) in a soft one. */
static void spsi_moment_insert(const sps_tmap_settings *settings, float *sums, size_t stride,
                               const spsi_intervals *intervals) {
    const spsi_v m = spsi_sub(spsi_add(intervals->u0, intervals->u1), spsi_set(1));
    const spsi_v h = spsi_sub(intervals->u1, intervals->u0), square = spsi_mul(h, h);
    const spsi_v depth = spsi_intervals_capped(intervals);
    spsi_v powers[SPSI_MOMENTS_MAX + 1], spread[SPSI_MOMENTS_MAX / 2 + 1];
    powers[0] = spread[0] = spsi_set(1);
    for (int k = 1; k < settings->components; ++k) powers[k] = spsi_mul(powers[k - 1], m);
    for (int j = 1; 2 * j < settings->components; ++j) { /* from each mean to the next */
        const float ratio =
            intervals->soft > 0 ? (float)(2 * j - 1) / (float)(2 * j + 3) : (float)(2 * j - 1) / (float)(2 * j + 1);
        spread[j] = spsi_mul(spread[j - 1], spsi_mul(square, spsi_set(ratio)));
    }
    for (int k = 0; k < settings->components; ++k) {
        spsi_v mean = powers[k];
        for (int j = 1; 2 * j <= k; ++j)
            mean = spsi_fma(spsi_mul(powers[k - 2 * j], spread[j]), spsi_set(spsi_moment_choose[k][j]), mean);
        spsi_accumulate(sums + (size_t)k * stride, spsi_mul(depth, mean));
    }
}

static void spsi_moment_finish(const sps_tmap_settings *settings, float *texel) {
    const double whole = (double)texel[0];
    for (int k = 1; k < settings->components; ++k)
        texel[k] = whole > 0 ? (float)fmin(fmax((double)texel[k] / whole, -1), 1) : 0;
    texel[0] = spsi_lower(texel[0], SPSI_DEPTH_MAX);
}

/* The moments of a distribution as the Cholesky factor of its Hankel matrix, H_ij = b_(i+j), i, j = 0 .. size - 1. */
typedef struct spsi_hankel {
    int size;
    double factor[SPSI_MOMENTS_MAX / 2 + 1][SPSI_MOMENTS_MAX / 2 + 1]; /* lower left; H = factor * its transpose */
} spsi_hankel;

/* Cholesky factorisation. Returns 0 if b are not the moments of at least `size` points. */
static int spsi_hankel_factor(spsi_hankel *hankel, const double *b) {
    for (int i = 0; i < hankel->size; ++i)
        for (int j = 0; j <= i; ++j) {
            double sum = b[i + j];
            for (int k = 0; k < j; ++k) sum -= hankel->factor[i][k] * hankel->factor[j][k];
            if (i == j && !(sum > 1e-14)) return 0;
            hankel->factor[i][j] = i == j ? sqrt(sum) : sum / hankel->factor[j][j];
        }
    return 1;
}

/* A texel's moments, biased by a share of those of a wide distribution, so that round-off cannot make them invalid, or
   those of too few points; by a larger share if that is not enough. The distributions are those of [Muenstermann et al.
   2018], for the same reason: their matrices are far from singular. Returns the share. */
static double spsi_hankel_build(spsi_hankel *hankel, const float *texel, int components, double share) {
    static const double wide[3][SPSI_MOMENTS_MAX / 2] = {
        {0.375, 0.375}, {0.48, 0.451, 0.45}, {0.75, 0.67666666666666667, 0.63, 0.60030303030303030}};
    double b[SPSI_MOMENTS_MAX + 1];
    hankel->size = (components + 1) / 2;
    for (;; share = fmin(10 * share, 1)) {
        b[0] = 1;
        for (int k = 1; k < components; ++k) {
            const double moment = fmin(fmax((double)texel[k], -1), 1);
            b[k] = (1 - share) * moment + (k % 2 == 0 ? share * wide[hankel->size - 3][k / 2 - 1] : 0);
        }
        if (spsi_hankel_factor(hankel, b) || share >= 1) return share;
    }
}

/* The orthonormal polynomials at x: factor^-1 (1, x, x^2 ..). Returns the sum of their squares, whose reciprocal is the
   maximum mass at x. */
static double spsi_hankel_solve(const spsi_hankel *hankel, double x, double *values) {
    double power = 1, squares = 0;
    for (int i = 0; i < hankel->size; ++i, power *= x) {
        values[i] = power;
        for (int k = 0; k < i; ++k) values[i] -= hankel->factor[i][k] * values[k];
        values[i] /= hankel->factor[i][i];
        squares += values[i] * values[i];
    }
    return squares;
}

/* A polynomial's value, slope and half its second derivative. */
static inline void spsi_polynomial(const double *c, int degree, double x, double out[3]) {
    out[0] = c[degree];
    out[1] = out[2] = 0;
    for (int i = degree - 1; i >= 0; --i) {
        out[2] = out[2] * x + out[1];
        out[1] = out[1] * x + out[0];
        out[0] = out[0] * x + c[i];
    }
}

static int spsi_polynomial_positive(const double *c, int degree, double x) {
    double at[3];
    spsi_polynomial(c, degree, x, at);
    return at[0] > 0;
}

#define SPSI_ROOT_STEPS    100   /* more than bisection alone needs from 2000 down to a double's precision */
#define SPSI_ROOT_NEARNESS 1e-13 /* relative step below which x is close enough; convergence is cubic */

/* The root between a and b, at which the values have different signs: Laguerre's method, which, if all roots are real,
   finds the nearest one on the side given by `rising` in three or four steps; bisection where round-off misleads it. */
static double spsi_polynomial_root(const double *c, int degree, double a, double b, int rising) {
    const double n = degree;
    double x = 0.5 * (a + b);
    for (int i = 0; i < SPSI_ROOT_STEPS; ++i) {
        double at[3], spread, slope, step;
        spsi_polynomial(c, degree, x, at);
        if ((at[0] > 0) == rising)
            b = x;
        else
            a = x;
        spread = (n - 1) * ((n - 1) * at[1] * at[1] - 2 * n * at[0] * at[2]);
        spread = spread > 0 ? sqrt(spread) : 0;
        slope = rising ? at[1] + spread : at[1] - spread;
        step = slope < 0 || slope > 0 ? n * at[0] / slope : b - a;
        if (fabs(step) <= SPSI_ROOT_NEARNESS * (fabs(x) > 1 ? fabs(x) : 1)) return x;
        x = x - step > a && x - step < b ? x - step : 0.5 * (a + b);
    }
    return x;
}

/* The roots of a parabola within -reach .. reach, in order, without cancellation: the larger one first, the other from
   their product. A double root has even order and does not count. */
static int spsi_parabola_roots(double a, double b, double c, double reach, double *roots) {
    const double square = b * b - 4 * a * c, q = -0.5 * (b + (b < 0 ? -1 : 1) * sqrt(fmax(square, 0)));
    const double one = fabs(a) > 0 ? q / a : HUGE_VAL, other = fabs(q) > 0 ? c / q : HUGE_VAL;
    int count = 0;
    if (!(square > 0)) return 0;
    if (fabs(fmin(one, other)) < reach) roots[count++] = fmin(one, other);
    if (fabs(fmax(one, other)) < reach) roots[count++] = fmax(one, other);
    return count;
}

/* Bounds of all roots, if they are real: their distance from the mean is limited by their mean square
   [Samuelson 1968]. */
static void spsi_polynomial_within(const double *c, int degree, double reach, double within[2]) {
    const double n = degree, a1 = c[degree - 1] / c[degree], a2 = c[degree - 2] / c[degree];
    const double square = a1 * a1 - 2 * n / (n - 1) * a2, middle = -a1 / n;
    const double radius = (n - 1) / n * sqrt(fmax(square, 0)), room = 1e-6 * (fabs(middle) + radius); /* rounding */
    const int known = fabs(middle) + radius < reach; /* neither infinite nor NaN */
    within[0] = known ? fmax(middle - radius - room, -reach) : -reach;
    within[1] = known ? fmin(middle + radius + room, reach) : reach;
}

/* The roots of odd order within two bounds, in order: they lie between those of the derivative. `roots` holds `count`
   roots of the derivative, which are replaced by those of the polynomial. Returns their number. */
static int spsi_polynomial_between(const double *c, int degree, const double within[2], double *roots, int count) {
    double a = within[0];
    int low = spsi_polynomial_positive(c, degree, a), found = 0;
    for (int i = 0; i <= count; ++i) {
        const double b = i < count ? roots[i] : within[1];
        const int high = spsi_polynomial_positive(c, degree, b);
        if (low != high) roots[found++] = spsi_polynomial_root(c, degree, a, b, high);
        a = b;
        low = high;
    }
    return found;
}

/* The roots of odd order within -reach .. reach, in order, by way of all derivatives from the parabola upwards. */
static int spsi_polynomial_roots(const double *c, int degree, double reach, double *roots) {
    double derivatives[SPSI_MOMENTS_MAX / 2 - 1][SPSI_MOMENTS_MAX / 2 + 1], within[2];
    const double *parabola = derivatives[degree - 2];
    int count;
    memcpy(derivatives[0], c, (size_t)(degree + 1) * sizeof *c);
    for (int order = 1; order <= degree - 2; ++order)
        for (int i = 0; i <= degree - order; ++i) derivatives[order][i] = (i + 1) * derivatives[order - 1][i + 1];
    count = spsi_parabola_roots(parabola[2], parabola[1], parabola[0], reach, roots);
    if (degree == 2) return count;
    spsi_polynomial_within(c, degree, reach, within);
    for (int order = degree - 3; order >= 0; --order)
        count = spsi_polynomial_between(derivatives[order], degree - order, within, roots, count);
    return count;
}

/* The minimum and maximum share before z of all distributions with these moments: those of the only one that consists
   of `size` points, of which z is one. With the orthonormal polynomials p_k, the others are the roots of sum p_k(z)
   p_k(x), and the mass at each is 1 / sum p_k^2 [Akhiezer 1965; Peters & Klein 2015]. Points beyond 1000 hold less
   than 1e-12, as the moments are at most 1. */
static void spsi_hankel_bounds(const spsi_hankel *hankel, double z, double bounds[2]) {
    double at[SPSI_MOMENTS_MAX / 2 + 1], c[SPSI_MOMENTS_MAX / 2 + 1], roots[SPSI_MOMENTS_MAX / 2 + 1], before = 0;
    const double here = 1 / spsi_hankel_solve(hankel, z, at);
    double whole = here;
    int count;
    for (int i = hankel->size - 1; i >= 0; --i) {
        c[i] = at[i];
        for (int k = i + 1; k < hankel->size; ++k) c[i] -= hankel->factor[k][i] * c[k];
        c[i] /= hankel->factor[i][i];
    }
    count = spsi_polynomial_roots(c, hankel->size - 1, 1000, roots);
    for (int i = 0; i < count; ++i) {
        const double weight = 1 / spsi_hankel_solve(hankel, roots[i], at);
        whole += weight;
        before += roots[i] < z ? weight : 0;
    }
    bounds[0] = before / whole;
    bounds[1] = (before + here) / whole;
}

/* Biases for 4, 6 and 8 moments in floats [Muenstermann et al. 2018]. Cost: a matrix of 3 to 5 rows, and the roots of a
   polynomial of degree 2 to 4. At u = 1 the result is exactly the total. */
static float spsi_moment_optical_depth(const sps_tmap_settings *settings, const float *texel, float u) {
    static const double biases[3] = {5e-7, 5e-6, 5e-5};
    spsi_hankel hankel;
    double bounds[2];
    if (!(texel[0] > 0)) return 0;
    if (u >= 1) return texel[0];
    spsi_hankel_build(&hankel, texel, settings->components, biases[(settings->components - 5) / 2]);
    spsi_hankel_bounds(&hankel, 2 * (double)u - 1, bounds);
    return (float)(0.5 * (bounds[0] + bounds[1]) * (double)texel[0]);
}

/* A mixture of (1 - a) F and a G that has the biased moments is within their bounds, and since G is 0 .. 1, F is
   within (low - a) / (1 - a) .. high / (1 - a). That also holds for moments that round-off has changed by d of the
   total, as long as the correction of G that makes up for it, d / a, leaves G's matrix positive: d (matrix size) < a
   (smallest eigenvalue: 0.199, 0.0137, 0.0049). These biases allow for 2e-6, the round-off of a thousand sums and more.
   The result of spsi_moment_optical_depth, which is less biased, is included. */
static void spsi_moment_bracket(const sps_tmap_settings *settings, const float *texel, float u, float bracket[2]) {
    static const double biases[3] = {3e-5, 6e-4, 2e-3};
    const double whole = (double)texel[0], answer = (double)spsi_moment_optical_depth(settings, texel, u);
    spsi_hankel hankel;
    double bounds[2], share;
    bracket[0] = bracket[1] = (float)answer;
    if (!(whole > 0) || u >= 1) return;
    share = spsi_hankel_build(&hankel, texel, settings->components, biases[(settings->components - 5) / 2]);
    spsi_hankel_bounds(&hankel, 2 * (double)u - 1, bounds);
    bracket[0] = (float)(share < 1 ? fmin(fmax((bounds[0] - share) / (1 - share), 0) * whole, answer) : 0);
    bracket[1] = (float)(share < 1 ? fmax(fmin(bounds[1] / (1 - share), 1) * whole, answer) : whole);
}

/* ---- Beer ---- */

static void spsi_beer_clear(float *sums, size_t stride, size_t count, int components) {
    for (int k = 0; k < components; ++k)
        for (size_t i = 0; i < count; ++i) sums[(size_t)k * stride + i] = k == 0; /* nothing begins before the end */
}

/* Until the map is finished: where gas begins, where it ends, and the total. */
static void spsi_beer_insert(const sps_tmap_settings *settings, float *sums, size_t stride,
                             const spsi_intervals *intervals) {
    const spsi_v depth = spsi_intervals_capped(intervals), first = spsi_load(sums), last = spsi_load(sums + stride);
    const spsi_m there = spsi_less(spsi_set(0), depth);
    (void)settings;
    spsi_store(sums, spsi_select(there, spsi_min(first, intervals->u0), first));
    spsi_store(sums + stride, spsi_select(there, spsi_max(last, intervals->u1), last));
    spsi_accumulate(sums + 2 * stride, depth);
}

/* Replaces the end of gas by its density. Gas without length is extended towards the light, so that all of it counts
   where it is, and at u = 1. */
static void spsi_beer_finish(const sps_tmap_settings *settings, float *texel) {
    const float last = spsi_higher(spsi_lower(texel[1], 1), 0);
    (void)settings;
    texel[1] = 0;
    if (!(texel[2] > 0)) return;
    texel[2] = spsi_lower(texel[2], SPSI_DEPTH_MAX);
    texel[0] = spsi_higher(spsi_lower(texel[0], last - SPSI_BEER_LENGTH), 0);
    texel[1] = texel[2] / spsi_higher(last - texel[0], SPSI_BEER_LENGTH);
}

static spsi_v spsi_beer_optical_depths(const sps_tmap_settings *settings, const spsi_texels *texels, spsi_v u) {
    const spsi_v behind = spsi_max(spsi_sub(u, spsi_texels_at(texels, spsi_set(0))), spsi_set(0));
    (void)settings;
    return spsi_min(spsi_mul(behind, spsi_texels_at(texels, spsi_set(1))), spsi_texels_at(texels, spsi_set(2)));
}

/* By sps_tmap_technique; the default is resolved before (spsi_settings_resolve). */
static const spsi_technique spsi_techniques[] = {
    {"no map", 0, 0, 0, 0, 0, 0, 0, 0, NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL},
    {"a deep map", 0, 0, 0, 0, 1, 0, 0, 0, NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL},
    {"a compressed map", 0, 0, 0, 0, 1, 0, 0, 0, NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL},
    {"a depth map", 1, 1, 1, 1, 0, 0, 0, 0, NULL, NULL, spsi_depth_fit, NULL, NULL, spsi_depth_optical_depths, NULL,
     NULL},
    {"an opacity map", 1, 65, 1, 8, 0, 1, 0, 0, spsi_opacity_insert, spsi_opacity_finish, NULL, NULL, NULL,
     spsi_opacity_optical_depths, NULL, spsi_opacity_bracket},
    {"a deep opacity map", 3, 65, 1, 8, 0, 1, 0, 1, spsi_opacity_insert, spsi_opacity_finish, NULL, NULL, NULL,
     spsi_opacity_optical_depths, NULL, spsi_opacity_bracket},
    {"a Fourier map", 3, 65, 2, 7, 0, 1, 1, -1, spsi_fourier_insert, spsi_fourier_finish, NULL, NULL, NULL,
     spsi_fourier_optical_depths, NULL, NULL},
    {"a cosine map", 2, 64, 1, 8, 0, 0, 0, 0, NULL, NULL, spsi_cosine_fit, NULL, NULL, spsi_cosine_optical_depths, NULL,
     NULL},
    {"a moment map", 5, 9, 2, 5, 0, 1, 1, 0, spsi_moment_insert, spsi_moment_finish, NULL, NULL, NULL, NULL,
     spsi_moment_optical_depth, spsi_moment_bracket},
    {"an adaptive map", 4, 64, 2, 16, 0, 0, 0, 0, NULL, NULL, spsi_adaptive_fit, spsi_adaptive_bytes, NULL, NULL,
     spsi_adaptive_optical_depth, NULL},
    {"a Beer map", 3, 3, 1, 3, 0, 1, 0, 0, spsi_beer_insert, spsi_beer_finish, NULL, NULL, spsi_beer_clear,
     spsi_beer_optical_depths, NULL, NULL},
    {"a shadow table", 8, 1024, 1, 256, 0, 1, 0, 0, spsi_opacity_insert, spsi_opacity_finish, NULL, NULL, NULL,
     spsi_opacity_optical_depths, NULL, NULL},
};

/* Optical depth before u in one texel, by the function that the technique has. */
static float spsi_texel_optical_depth(const sps_tmap_settings *settings, const float *texel, float u) {
    const spsi_technique *technique = &spsi_techniques[settings->technique];
    const spsi_texels texels = {texel, 0, spsi_set(0), spsi_set(0)};
    float lanes[SPSI_LANES];
    if (technique->optical_depth) return technique->optical_depth(settings, texel, u);
    spsi_store(lanes, technique->optical_depths(settings, &texels, spsi_set(u)));
    return lanes[0];
}

/* Settings with SPS_TMAP_DEFAULT replaced by the technique that it stands for, and without planes that are not meant
   for theirs. */
static sps_tmap_settings spsi_settings_resolve(const sps_tmap_settings *settings, int of_light) {
    sps_tmap_settings resolved = *settings;
    if (settings->technique == SPS_TMAP_DEFAULT) {
        resolved.technique = of_light ? SPS_TMAP_TABLE : SPS_TMAP_DEEP_OPACITY;
        resolved.cubic = !of_light;
    }
    if (resolved.technique != SPS_TMAP_OPACITY && resolved.technique != SPS_TMAP_DEEP_OPACITY) resolved.planes = NULL;
    return resolved;
}

/* 1: texels begin with the u of their first and their last occluder. */
static int spsi_settings_have_range(const sps_tmap_settings *settings) {
    const int range = spsi_techniques[settings->technique].range;
    return range > 0 || (range < 0 && settings->texel_range);
}

/* The minimum number of components that settings allow, including the range. */
static int spsi_components_least(const sps_tmap_settings *settings) {
    const spsi_technique *technique = &spsi_techniques[settings->technique];
    return technique->least + (technique->range < 0 ? 2 * spsi_settings_have_range(settings) : 0);
}

/* The number of planes that the caller has set, which come with a number of components. */
static int spsi_settings_planes(const sps_tmap_settings *settings) {
    return settings->planes ? settings->components - 2 * spsi_settings_have_range(settings) : 0;
}

/* The number of components: that of the settings, or the technique's default. */
static int spsi_components_of(const sps_tmap_settings *settings) {
    const spsi_technique *technique = &spsi_techniques[settings->technique];
    if (settings->components > 0) return settings->components;
    return spsi_components_least(settings) + technique->usual - technique->least;
}

/* ================================================================================================ >>scene
   9  The frame: a scene and a view, checked, with every default filled in. Later sections read the frame and not the
   caller's structs, so that none has to interpret a zero in them. Only a light's number of texels stays open (0) until
   the gas that it has to fit has been read. */

/* A grid of voxels in the world. Each medium has one, that of its volume. */
typedef struct spsi_lattice {
    int medium;
    double corner[3];  /* world position of the box's corner at voxel (0,0,0) */
    double step[3][3]; /* world vectors of one voxel's edges */
    double voxel_volume;
} spsi_lattice;

/* A volume that holds voxels. */
typedef struct spsi_medium {
    int index;             /* in the scene's array, for error sentences */
    int size[3];           /* voxels along x, y, z */
    spsi_lattice *lattice; /* its volume's grid */
    int channel;           /* channel of the eye's sheets, and index of its material */
    int light_channel;     /* channel of a light's sheets: gases share number 0 */
    int (*read_fn)(void *user, const int lo[3], const int size[3], float *out);            /* NULL: eval_fn is set */
    int (*range_fn)(void *user, const int lo[3], const int size[3], float out_min_max[2]); /* NULL: all are read */
    int (*eval_fn)(void *user, size_t count, const double *positions, float *out);         /* NULL: read_fn is set */
    void *user;                                                                            /* of the three callbacks */
    uint64_t revision; /* of the values; 0: they are read in every call */
} spsi_medium;

/* A set of particles that is not empty. */
typedef struct spsi_particle_set {
    int index;         /* in the scene's array, for error sentences */
    int channel;       /* channel of the eye's sheets, and index of its material; in a light's sheets it is number 0 */
    size_t count;      /* particles to be read */
    int soft;          /* 1: density falls to nothing at the rim, 0: it is uniform */
    int is_extinction; /* 1: the optical depth that is read is extinction, if soft at the centre */
    int (*read_fn)(void *user, size_t first, size_t count, sps_particle *out); /* as in sps_particles */
    void *user;                                                                /* of read_fn */
} spsi_particle_set;

/* A mesh that has triangles. */
typedef struct spsi_mesh {
    int index;               /* in the scene's array, for error sentences */
    size_t triangle_count;   /* triangles to be read */
    sps_placement placement; /* with the identity in place of all-zero axes */
    float color[3];          /* reflectance, unless has_colors */
    float transmittance[3];  /* all 0: opaque */
    int has_normals;         /* 1: corners have normals */
    int has_colors;          /* 1: corners have colors */
    int (*read_fn)(void *user, size_t first, size_t count, sps_triangle *out);                    /* as in sps_mesh */
    void *user;                                                                                   /* of read_fn */
    int (*shade_fn)(void *user, size_t count, const sps_surface_point *points, sps_surface *out); /* NULL: `color` */
    void *shade_user;                                                                             /* of shade_fn */
    uint64_t revision; /* of the triangles; 0: they are read in every call */
} spsi_mesh;

/* The extent of a light. Places in it are (x, y), within the unit disc or within the square from -1 to 1. */
typedef struct spsi_light_extent {
    int exists;
    int is_disc;       /* 1: the unit disc, 0: the square */
    double radius;     /* maximum distance from the centre: world units, or radians of a directional light */
    double axis[2][3]; /* from the centre to (1, 0) and (0, 1); directional: unit vectors across its direction */
} spsi_light_extent;

/* The cone of a spotlight: its light is the square of scale * cosine + offset, clamped to 0..1. */
typedef struct spsi_cone {
    int exists;
    float scale, offset;
} spsi_cone;

/* The image that a light throws. The texel of a point at `offset` from the light is
       (across . offset) / (forward . offset) + add,   directional: across . offset + add */
typedef struct spsi_projection {
    int exists;
    int width, height; /* of the image */
    double across[2][3], add[2], forward[3];
    double edge[2]; /* of a texel at distance 1, or in the world */
    double focus;   /* 1 / distance of the plane in focus; 0: infinity */
    int image;      /* in the content's list */
    int (*sample_fn)(void *user, size_t count, const float *uv, float *out_rgb);
    void *user; /* of sample_fn */
} spsi_projection;

/* Why a light shades gas by sheets or by a map. */
typedef enum spsi_choice {
    SPSI_CHOICE_CALLER, /* the caller has set it */
    SPSI_CHOICE_OPEN,   /* not chosen yet, >>shadows; sheets so far */
    SPSI_CHOICE_SHEETS,
    SPSI_CHOICE_TABLE_IN_GAS, /* a table: the light is in the gas or too close to it for slabs */
    SPSI_CHOICE_TABLE_CAMERA, /* a table: no slabs serve both this light and the camera's rays */
    SPSI_CHOICE_TABLE_SHARED  /* a table: another light's sweep can carry it */
} spsi_choice;

/* A light that is not black. */
typedef struct spsi_lamp {
    int index;           /* in the scene's array, for error sentences */
    int is_point;        /* 1: a light with a position, 0: a directional light */
    double position[3];  /* its centre */
    double direction[3]; /* direction in which a directional light travels, or a cone's axis; of unit length */
    spsi_cone cone;
    spsi_projection projection;
    float color[3]; /* intensity of a point light, irradiance of a directional one or of one that does not fall off */
    int falls_off;  /* 1: irradiance falls with the square of the distance */
    spsi_light_extent extent;
    const struct spsi_lamp *points; /* that stand for an extended light; of another light, itself */
    int point_count;
    const struct spsi_lamp *few; /* fewer points, from which gas takes its irradiance; at least one */
    int few_count;
    int samples;             /* as the caller set it */
    int shadows;             /* 1: it casts shadows */
    int sliced;              /* 1: it shades gas by sheets, and so needs slabs that suit it */
    int has_map;             /* 1: it shades gas by a transmittance map */
    spsi_choice choice;      /* who chose between the two, and why */
    int map_size;            /* texels on the map's longer side; 0: fitted to the gas */
    int map_omnidirectional; /* 1: the map has six faces wherever the light is */
    sps_tmap_settings map;   /* the map's settings, with the technique resolved */
} spsi_lamp;

typedef struct spsi_bounds {
    double low[3], high[3]; /* low > high: empty */
} spsi_bounds;

/* Parameters set by quality. */
typedef struct spsi_accuracy {
    double threshold;     /* transmittance at which an eye ray ends */
    double shadow_texels; /* shadow texels per voxel */
    int depth_map_texels; /* minimum on a side of a depth map */
    double cut;           /* radius of kernels in standard deviations */
    double light_cut;     /* the same for classified volumes in a light's sheets; maps use `cut` */
    int light_points;     /* points that stand for an extended light */
} spsi_accuracy;

/* The sets of particles that are not empty. */
typedef struct spsi_particle_sets {
    int set_count;
    spsi_particle_set sets[SPSI_SETS_MAX];
    size_t count; /* of particles in all sets, known before any is read */
    int has_soft; /* 1: some set is soft */
} spsi_particle_sets;

/* The meshes that have triangles. */
typedef struct spsi_meshes {
    spsi_mesh *list;
    int count;
    size_t triangle_count; /* of all meshes, known before any is read */
    size_t textured_count; /* of those that have a shade_fn */
    int translucent;       /* 1: some let light pass */
} spsi_meshes;

/* The appearance of volumes and particles. */
typedef struct spsi_matter {
    int material_count;
    spsi_material materials[SPSI_MATERIALS_MAX];
    int light_channel_count; /* channels of a light's sheets: one for all gases, one for each classified volume */
    int scatters;            /* 1: some material scatters */
    int emits;               /* 1: some material emits */
    int extinguishes;        /* 1: some material has extinction */
    int classifies;          /* 1: some volume has a transfer function */
} spsi_matter;

typedef struct spsi_lamps {
    spsi_lamp *list;
    int count;
    int shadow_count; /* number of lamps that cast shadows */
    int sliced_count; /* number of lamps that shade gas by sheets: each needs a sweep of its own */
    int image_count;  /* number of lamps that throw an image */
} spsi_lamps;

/* Gradients of volumes that are shaded as surfaces. */
typedef struct spsi_gradients {
    int exist;    /* 1: some volume has such gradients */
    int reach;    /* pixels to either side of a difference: 1, or 2 if voxels are less than 4 pixels wide */
    int splatted; /* 1: gradients have sheets of their own, as neighbouring pixels are too far apart */
} spsi_gradients;

/* Light from everywhere. */
typedef struct spsi_ambient {
    float radiance[3];
    int exists; /* 1: it is not black */
} spsi_ambient;

/* Radiance behind everything. */
typedef struct spsi_background {
    float color[3];                                                                     /* without a callback */
    int (*color_fn)(void *user, size_t count, const float *directions, float *out_rgb); /* NULL: `color` everywhere */
    void *user;                                                                         /* of color_fn */
} spsi_background;

#define SPSI_IMAGE_LEVELS 25 /* of an image of 4096 texels on a side, if one side is halved before the other */

/* An image and its halves, down to a texel. Each level is three planes, of red, green and blue, within a border of one
   black texel. */
typedef struct spsi_image {
    int level_count;
    int width[SPSI_IMAGE_LEVELS], height[SPSI_IMAGE_LEVELS]; /* with the border */
    float edge[SPSI_IMAGE_LEVELS];                           /* of the texels, the shorter one; 1 at level 0 */
    float *texels[SPSI_IMAGE_LEVELS];
} spsi_image;

/* Results of reading a frame's data. Before that, bounds are those of the volumes' boxes. */
typedef struct spsi_content {
    spsi_bounds bounds;            /* of gas */
    spsi_bounds outer;             /* of the volumes' boxes and the particles, by which shadows are chosen, >>shadows */
    int parts[2], cut[2];          /* columns and rows, 1 or 2, that the image is cut into, and where, >>slicing */
    spsi_bounds mesh_bounds;       /* of polygons */
    const sps_particle *particles; /* of all sets, except for empty ones, >>gather */
    int particle_count;            /* length of `particles`; 0 until they are read */
    int set_ends[SPSI_SETS_MAX];   /* the end of each set in `particles`; the next one begins there */
    double particle_radius;        /* geometric mean of the radii */
    double particle_spread;        /* root mean square distance of the particles from their mean */
    const spsi_image *images;      /* that lights throw, >>projectors */
    spsi_rays eye;                 /* the frame's, with depths relative to the middle of the content */
} spsi_content;

/* The checked and resolved scene, complete before anything is read, and never written again except when lights' shadows
   are chosen, >>shadows. */
typedef struct spsi_frame {
    spsi_content *content;
    sps_view view;     /* all fields resolved, including the region; a shadow_size of 0: fitted to the gas */
    sps_object viewer; /* the struct that errors about the view name: a view, or a map's light */
    int has_matrix;    /* 1: its camera was given as a matrix, which only `eye` has now */
    spsi_accuracy accuracy;
    spsi_rays eye;
    int medium_count;
    spsi_medium media[SPSI_VOLUMES_MAX];
    spsi_lattice lattices[SPSI_VOLUMES_MAX]; /* one per medium */
    spsi_bounds volume_bounds;               /* of the volumes' boxes, extended by the reach of their kernels */
    spsi_particle_sets particles;
    spsi_matter matter;
    spsi_meshes meshes;
    spsi_lamps lamps;
    spsi_ambient ambient;
    spsi_background background;
    int replace_invalid; /* 1: invalid values become 0 instead of an error */
    spsi_gradients gradients;
    int channels;    /* channels of radiance: 1 if every color is grey, otherwise 3 */
    int wants_depth; /* 1: the image has depths */
} spsi_frame;

#define SPSI_BEHIND       3  /* slabs splatted behind the eye: profiles of the first visible slab need 2 */
#define SPSI_NEAR_REACHES 16 /* kernel radii; nearer to the eye, a kernel is integrated along each pixel's own ray */

static const spsi_bounds spsi_nowhere = {{DBL_MAX, DBL_MAX, DBL_MAX}, {-DBL_MAX, -DBL_MAX, -DBL_MAX}};

static int spsi_bounds_empty(const spsi_bounds *bounds) { return !(bounds->low[0] <= bounds->high[0]); }

static void spsi_bounds_add(spsi_bounds *bounds, const double point[3]) {
    for (int i = 0; i < 3; ++i) {
        bounds->low[i] = fmin(bounds->low[i], point[i]);
        bounds->high[i] = fmax(bounds->high[i], point[i]);
    }
}

static void spsi_bounds_corner(const spsi_bounds *bounds, int corner, double point[3]) {
    for (int i = 0; i < 3; ++i) point[i] = corner >> i & 1 ? bounds->high[i] : bounds->low[i];
}

static void spsi_bounds_centre(const spsi_bounds *bounds, double point[3]) {
    for (int i = 0; i < 3; ++i) point[i] = bounds->low[i] + 0.5 * (bounds->high[i] - bounds->low[i]);
}

/* The world position of fractional voxel coordinates; (0.5, 0.5, 0.5) is the first voxel's centre. */
static void spsi_voxel_position(const spsi_lattice *lattice, const double at[3], double point[3]) {
    spsi_along(lattice->corner, lattice->step[0], at[0], point);
    spsi_along(point, lattice->step[1], at[1], point);
    spsi_along(point, lattice->step[2], at[2], point);
}

/* The extent of a voxel's kernel along a unit direction, sqrt(s' V V' s): the edge length for cubes. */
static double spsi_voxel_extent(const spsi_lattice *lattice, const double s[3]) {
    double sum = 0;
    for (int i = 0; i < 3; ++i) sum += spsi_dot(lattice->step[i], s) * spsi_dot(lattice->step[i], s);
    return sqrt(sum);
}

/* The chord of a ray of unit direction d through a voxel's centre, 1 / sqrt(d' (V V')^-1 d): the edge length for cubes.
   In flat and slanted voxels the chord is much shorter than the kernel's extent. */
static double spsi_voxel_chord(const spsi_lattice *lattice, const double d[3]) {
    double rows[3][3], sum = 0;
    if (!spsi_invert(lattice->step[0], lattice->step[1], lattice->step[2], rows)) return spsi_voxel_extent(lattice, d);
    for (int i = 0; i < 3; ++i) sum += spsi_dot(rows[i], d) * spsi_dot(rows[i], d);
    return 1 / sqrt(sum);
}

/* The minimum extent of a voxel's kernel along any direction in the plane of two perpendicular unit vectors: the root
   of the smaller eigenvalue of (x, y)' V V' (x, y). */
static double spsi_voxel_breadth(const spsi_lattice *lattice, const double x[3], const double y[3]) {
    double xx = 0, xy = 0, yy = 0;
    for (int i = 0; i < 3; ++i) {
        const double along_x = spsi_dot(lattice->step[i], x), along_y = spsi_dot(lattice->step[i], y);
        xx += along_x * along_x;
        xy += along_x * along_y;
        yy += along_y * along_y;
    }
    /* the product of both divided by the greater: their difference would lose a needle's breadth to round-off */
    return sqrt(fmax(xx * yy - xy * xy, 0) / (0.5 * (xx + yy) + sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)));
}

/* Copies a placement, with the identity in place of all-zero axes. */
static void spsi_placement_resolve(const sps_placement *from, sps_placement *to) {
    const double *axes = &from->axis[0][0];
    int zero = 1;
    *to = *from;
    for (int i = 0; i < 9; ++i) zero &= axes[i] == 0.0;
    for (int i = 0; i < 3 && zero; ++i) to->axis[i][i] = 1;
}

/* Checks that a resolved placement is finite, and not flat. */
static sps_result spsi_check_placement(sps_context *context, const sps_placement *placement, sps_object object,
                                       int index) {
    const double *bad = spsi_bad_coordinate(placement->origin, 3);
    const double determinant = spsi_determinant(placement->axis[0], placement->axis[1], placement->axis[2]);
    double room = 1e-14;
    char field[32];
    if (bad) {
        SPS_SNPRINTF(field, sizeof field, "placement.origin[%d]", (int)(bad - placement->origin));
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, object, index, field, *bad, "it must be within 1e15");
    }
    for (int i = 0; i < 9; ++i) {
        bad = spsi_bad_coordinate(&placement->axis[i / 3][i % 3], 1);
        if (!bad) continue;
        SPS_SNPRINTF(field, sizeof field, "placement.axis[%d][%d]", i / 3, i % 3);
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, object, index, field, *bad, "it must be within 1e15");
    }
    for (int i = 0; i < 3; ++i) room *= spsi_length(placement->axis[i]); /* the round-off of a flat one */
    if (!(fabs(determinant) > room) || !(fabs(determinant) <= DBL_MAX))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, object, index, "placement's determinant", determinant,
                               "its axes must not lie in a plane");
    return SPS_OK;
}

static int spsi_volume_present(const sps_volume *volume) {
    return volume->size[0] > 0 && volume->size[1] > 0 && volume->size[2] > 0;
}

/* Fails if a struct was not zeroed; `prefix` leads from the object to the struct: "", "grid.". */
static sps_result spsi_check_canaries(sps_context *context, sps_object object, int index, const char *prefix,
                                      uint32_t start, uint32_t end) {
    char field[32];
    if (!start && !end) return SPS_OK;
    SPS_SNPRINTF(field, sizeof field, "%s%s", prefix, start ? "start_canary" : "end_canary");
    return spsi_fail_field(context, SPS_ERROR_ARGUMENT, object, index, field, (double)(start ? start : end),
                           SPSI_NOT_ZEROED);
}

static sps_result spsi_check_lobes(sps_context *context, sps_object object, int index, const sps_lobe *lobes,
                                   int count) {
    if (count < 0 || count > SPSI_LOBES_MAX || (count > 0 && !lobes))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, object, index, "lobe_count", count,
                               "it must be 0..8, with lobes set");
    for (int k = 0; k < count; ++k) {
        const int bent = !(fabsf(lobes[k].asymmetry) <= 0.99f);
        char field[32];
        if (!bent && lobes[k].weight > 0 && lobes[k].weight <= SPSI_VALUE_MAX) continue;
        SPS_SNPRINTF(field, sizeof field, "lobes[%d].%s", k, bent ? "asymmetry" : "weight");
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, object, index, field,
                               (double)(bent ? lobes[k].asymmetry : lobes[k].weight),
                               bent ? "it must be -0.99..0.99" : "it must be above 0, and 1e18 at most");
    }
    return SPS_OK;
}

static sps_result spsi_check_gas_colors(sps_context *context, sps_object object, int index, const float albedo[3],
                                        const float emission[3]) {
    if (spsi_bad_color(albedo, 1))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, object, index, "albedo", (double)*spsi_bad_color(albedo, 1),
                               "red, green and blue must be 0..1");
    if (spsi_bad_color(emission, SPSI_VALUE_MAX))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, object, index, "emission",
                               (double)*spsi_bad_color(emission, SPSI_VALUE_MAX),
                               "red, green and blue must be 0..1e18");
    return SPS_OK;
}

static sps_result spsi_check_gas(sps_context *context, const sps_volume *volume, int i) {
    if (!(volume->extinction >= 0 && volume->extinction <= SPSI_VALUE_MAX))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VOLUME, i, "extinction",
                               (double)volume->extinction, "it must be 0..1e18");
    return spsi_check_gas_colors(context, SPS_OBJECT_VOLUME, i, volume->albedo, volume->emission);
}

/* Checks the array behind a volume that is read by sps_grid_read, whose own errors have no names. */
static sps_result spsi_check_array(sps_context *context, const sps_volume *volume, int i) {
    const sps_grid *grid = (const sps_grid *)volume->user;
    const char *field = NULL, *rule = "it must be finite";
    double value = 0;
    if (volume->read_fn != sps_grid_read) return SPS_OK;
    if (!grid)
        return spsi_fail_that(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VOLUME, i, "user", 0,
                              "is NULL; with sps_grid_read it must be an sps_grid");
    if (spsi_check_canaries(context, SPS_OBJECT_VOLUME, i, "grid.", grid->start_canary, grid->end_canary))
        return context->result;
    if (!grid->voxels)
        return spsi_fail_that(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VOLUME, i, "grid.voxels", 0, SPSI_IS_NULL);
    for (int k = 0; k < 3; ++k)
        if (grid->size[k] != volume->size[k])
            field = "grid.size", value = grid->size[k], rule = "it must be the volume's size";
    if (!(fabsf(grid->scale) <= FLT_MAX)) field = "grid.scale", value = (double)grid->scale;
    if (!(fabsf(grid->offset) <= FLT_MAX)) field = "grid.offset", value = (double)grid->offset;
    if ((int)grid->format < SPS_VOXEL_U8 || grid->format > SPS_VOXEL_F32)
        field = "grid.format", value = (int)grid->format, rule = "it must be an sps_voxel_format";
    return field ? spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VOLUME, i, field, value, rule) : SPS_OK;
}

static sps_result spsi_check_volume(sps_context *context, const sps_volume *volume, int i) {
    char text[96];
    if (spsi_check_canaries(context, SPS_OBJECT_VOLUME, i, "", volume->start_canary, volume->end_canary))
        return context->result;
    for (int k = 0; k < 3; ++k)
        if (volume->size[k] < 0 || volume->size[k] > 65536)
            return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VOLUME, i, "size", volume->size[k],
                                   "it must be 0..65536");
    if (!spsi_volume_present(volume)) return SPS_OK;
    if (!volume->read_fn == !volume->eval_fn) {
        SPS_SNPRINTF(text, sizeof text, "and eval_fn are both %s; exactly one must be set",
                     volume->read_fn ? "set" : "NULL");
        return spsi_fail_that(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VOLUME, i, "read_fn", 0, text);
    }
    if (spsi_check_array(context, volume, i)) return context->result;
    if (spsi_check_lobes(context, SPS_OBJECT_VOLUME, i, volume->lobes, volume->lobe_count)) return context->result;
    if (!(volume->gradient_full >= 0 && volume->gradient_full <= SPSI_VALUE_MAX))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VOLUME, i, "gradient_full",
                               (double)volume->gradient_full, "it must be 0 or positive");
    if (!(volume->specular >= 0 && volume->specular <= 1))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VOLUME, i, "specular", (double)volume->specular,
                               "it must be 0..1");
    if (!(volume->shininess >= 0 && volume->shininess <= 1e4f))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VOLUME, i, "shininess",
                               (double)volume->shininess, "it must be 0..10000");
    if ((int)volume->shading < 0 || volume->shading > SPS_SHADING_SURFACE)
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VOLUME, i, "shading",
                               (double)(int)volume->shading, "it must be an sps_shading");
    return volume->transfer ? SPS_OK : spsi_check_gas(context, volume, i);
}

/* Checks the arrays behind a mesh that is read by sps_indexed_mesh_read, whose own errors have no names. */
static sps_result spsi_check_indexed(sps_context *context, const sps_mesh *mesh, int i) {
    const sps_indexed_mesh *arrays = (const sps_indexed_mesh *)mesh->user;
    const char *field = NULL, *rest = SPSI_IS_NULL;
    if (mesh->triangle_count == 0 || mesh->read_fn != sps_indexed_mesh_read) return SPS_OK;
    if (!arrays)
        return spsi_fail_that(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_MESH, i, "user", 0,
                              "is NULL; with sps_indexed_mesh_read it must be an sps_indexed_mesh");
    if (spsi_check_canaries(context, SPS_OBJECT_MESH, i, "arrays.", arrays->start_canary, arrays->end_canary))
        return context->result;
    if (arrays->triangle_count < mesh->triangle_count)
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_MESH, i, "arrays.triangle_count",
                               (double)arrays->triangle_count, "it must be at least the mesh's");
    if (arrays->vertex_count == 0) field = "arrays.vertex_count", rest = "is 0; it must be positive";
    if (arrays->indices_u16 && arrays->indices_u32)
        field = "arrays.indices_u16", rest = "and indices_u32 are both set; at most one must be";
    if (mesh->has_colors && !arrays->colors) field = "arrays.colors", rest = "is NULL; has_colors needs it";
    if (mesh->has_normals && !arrays->normals) field = "arrays.normals", rest = "is NULL; has_normals needs it";
    if (!arrays->positions) field = "arrays.positions", rest = SPSI_IS_NULL;
    return field ? spsi_fail_that(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_MESH, i, field, 0, rest) : SPS_OK;
}

static sps_result spsi_check_mesh(sps_context *context, const sps_mesh *mesh, int i) {
    if (spsi_check_canaries(context, SPS_OBJECT_MESH, i, "", mesh->start_canary, mesh->end_canary))
        return context->result;
    if (mesh->triangle_count > SPSI_FACES_MAX)
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_MESH, i, "triangle_count",
                               (double)mesh->triangle_count, "it must be 0..2^29");
    if (mesh->triangle_count > 0 && !mesh->read_fn)
        return spsi_fail_that(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_MESH, i, "read_fn", 0,
                              "is NULL; it must be set where there are triangles");
    if (spsi_check_indexed(context, mesh, i)) return context->result;
    if (spsi_bad_color(mesh->color, 1))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_MESH, i, "color",
                               (double)*spsi_bad_color(mesh->color, 1), "red, green and blue must be 0..1");
    if (spsi_bad_color(mesh->transmittance, 1))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_MESH, i, "transmittance",
                               (double)*spsi_bad_color(mesh->transmittance, 1), "red, green and blue must be 0..1");
    return SPS_OK;
}

static sps_result spsi_check_set(sps_context *context, const sps_particles *set, int i) {
    if (spsi_check_canaries(context, SPS_OBJECT_PARTICLES, i, "", set->start_canary, set->end_canary))
        return context->result;
    if (set->count > SPSI_PARTICLES_MAX)
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_PARTICLES, i, "count", (double)set->count,
                               "it must be 0..2^29");
    if (set->count > 0 && !set->read_fn)
        return spsi_fail_that(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_PARTICLES, i, "read_fn", 0,
                              "is NULL; it must be set where count is not 0");
    if (spsi_check_lobes(context, SPS_OBJECT_PARTICLES, i, set->lobes, set->lobe_count)) return context->result;
    return spsi_check_gas_colors(context, SPS_OBJECT_PARTICLES, i, set->albedo, set->emission);
}

/* The object that has the settings of a light's shadow_map, or, if `light` is below 0, of a map by itself; and the way
   from it to a setting. */
static sps_object spsi_setting_object(int light) { return light < 0 ? SPS_OBJECT_TMAP_SETTINGS : SPS_OBJECT_LIGHT; }
static const char *spsi_setting_prefix(int light) { return light < 0 ? "" : "shadow_map."; }

/* As spsi_fail_field, for these settings. */
static sps_result spsi_fail_setting(sps_context *context, sps_result result, int light, const char *field, double value,
                                    const char *rule) {
    char member[64];
    SPS_SNPRINTF(member, sizeof member, "%s%s", spsi_setting_prefix(light), field);
    return spsi_fail_field(context, result, spsi_setting_object(light), light, member, value, rule);
}

/* Checks the number of components, including the range, unless it is left to the technique. */
static sps_result spsi_check_components(sps_context *context, int light, const sps_tmap_settings *settings) {
    const spsi_technique *technique = &spsi_techniques[settings->technique];
    const int least = spsi_components_least(settings), n = settings->components;
    const char *with = technique->range < 0 && settings->texel_range ? " with texel_range" : "";
    char rule[96];
    if (n == 0) return SPS_OK;
    if (technique->lists) {
        SPS_SNPRINTF(rule, sizeof rule, "%s sets it from its rays: it must be 0", technique->name);
    } else {
        if (n >= least && n <= technique->most && (n - least) % technique->step == 0) return SPS_OK;
        if (least == technique->most)
            SPS_SNPRINTF(rule, sizeof rule, "%s has %d", technique->name, least);
        else
            SPS_SNPRINTF(rule, sizeof rule, "%s%s has %d, %d .. %d", technique->name, with, least,
                         least + technique->step, technique->most);
    }
    return spsi_fail_setting(context, SPS_ERROR_ARGUMENT, light, "components", n, rule);
}

/* Checks the planes of an opacity map. */
static sps_result spsi_check_planes(sps_context *context, int light, const sps_tmap_settings *settings) {
    const float *planes = settings->planes;
    const int count = spsi_settings_planes(settings);
    if (planes && settings->components == 0)
        return spsi_fail_setting(context, SPS_ERROR_ARGUMENT, light, "components", 0,
                                 "with planes it must be their number, plus two for a deep opacity map");
    for (int i = 0; i < count; ++i) {
        const float before = i > 0 ? planes[i - 1] : 0, least = i == count - 1 ? 1 : 0;
        char field[32];
        if (planes[i] > before && planes[i] >= least && planes[i] <= 1) continue;
        SPS_SNPRINTF(field, sizeof field, "planes[%d]", i);
        return spsi_fail_setting(context, SPS_ERROR_ARGUMENT, light, field, (double)planes[i],
                                 "they must rise from above 0, and the last must be 1");
    }
    return SPS_OK;
}

/* Checks all settings of a map except for its depth range. */
static sps_result spsi_check_settings(sps_context *context, int light, const sps_tmap_settings *settings) {
    sps_tmap_settings resolved;
    if (spsi_check_canaries(context, spsi_setting_object(light), light, spsi_setting_prefix(light),
                            settings->start_canary, settings->end_canary))
        return context->result;
    if ((int)settings->technique < 0 || settings->technique > SPS_TMAP_TABLE)
        return spsi_fail_setting(context, SPS_ERROR_ARGUMENT, light, "technique", (double)(int)settings->technique,
                                 "it must be an sps_tmap_technique");
    if (settings->technique == SPS_TMAP_TABLE && light < 0)
        return spsi_fail_that(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_TMAP_SETTINGS, -1, "technique", 0,
                              "is SPS_TMAP_TABLE, which is for sps_light.shadow_map only");
    if ((int)settings->window < 0 || settings->window > SPS_TMAP_WINDOW_FEJER)
        return spsi_fail_setting(context, SPS_ERROR_ARGUMENT, light, "window", (double)(int)settings->window,
                                 "it must be an sps_tmap_window");
    if (!(settings->epsilon >= 0 && settings->epsilon <= 0.5f))
        return spsi_fail_setting(context, SPS_ERROR_ARGUMENT, light, "epsilon", (double)settings->epsilon,
                                 "it must be 0..0.5");
    if (!(settings->surface_bias >= 0 && settings->surface_bias <= SPSI_COORDINATE_MAX))
        return spsi_fail_setting(context, SPS_ERROR_ARGUMENT, light, "surface_bias", settings->surface_bias,
                                 "it must be 0..1e15");
    resolved = spsi_settings_resolve(settings, light >= 0);
    if (spsi_check_components(context, light, &resolved)) return context->result;
    return spsi_check_planes(context, light, &resolved);
}

/* Checks how a light shades gas: neither sheets nor a table can be meant beside a map of another kind. */
static sps_result spsi_check_shadow_source(sps_context *context, const sps_light *light, int i) {
    const sps_tmap_settings *settings = light->shadow_map;
    if ((int)light->shadow_source < 0 || light->shadow_source > SPS_SHADOW_TABLE)
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "shadow_source",
                               (double)(int)light->shadow_source, "it must be an sps_shadow_source");
    if (settings && light->shadow_source == SPS_SHADOW_SHEETS)
        return spsi_fail_that(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "shadow_source", SPS_SHADOW_SHEETS,
                              "is SPS_SHADOW_SHEETS, and shadow_map is set; only one of them can be meant");
    if (settings && light->shadow_source == SPS_SHADOW_TABLE &&
        spsi_settings_resolve(settings, 1).technique != SPS_TMAP_TABLE)
        return spsi_fail_that(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "shadow_source", SPS_SHADOW_TABLE,
                              "is SPS_SHADOW_TABLE, and shadow_map is of another technique; only one of them can be "
                              "meant");
    return SPS_OK;
}

/* Checks the map by which a light shades gas. Its depth range is that of the gas, and surfaces have a depth map of
   their own. */
static sps_result spsi_check_shadow_map(sps_context *context, const sps_light *light, int i) {
    const sps_tmap_settings *settings = light->shadow_map;
    if (light->shadow_map_size < 0 || light->shadow_map_size > SPSI_SIZE_MAX)
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "shadow_map_size",
                               light->shadow_map_size, "it must be 0..16384");
    if (light->shadow_map_omnidirectional && light->kind == SPS_LIGHT_DIRECTIONAL)
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "shadow_map_omnidirectional",
                               light->shadow_map_omnidirectional, "a directional light has one direction");
    if (spsi_check_shadow_source(context, light, i)) return context->result;
    if (!settings) return SPS_OK;
    if (spsi_check_settings(context, i, settings)) return context->result;
    if (!(fabs(settings->near_depth) <= 0))
        return spsi_fail_setting(context, SPS_ERROR_ARGUMENT, i, "near_depth", settings->near_depth,
                                 "it must be 0: the range is fitted to the gas");
    if (!(fabs(settings->far_depth) <= 0))
        return spsi_fail_setting(context, SPS_ERROR_ARGUMENT, i, "far_depth", settings->far_depth,
                                 "it must be 0: the range is fitted to the gas");
    if (settings->surface_bias > 0)
        return spsi_fail_setting(context, SPS_ERROR_ARGUMENT, i, "surface_bias", settings->surface_bias,
                                 "it must be 0: surfaces shade by rays and a depth map of their own");
    return SPS_OK;
}

/* Whether a light has an extent. */
static int spsi_light_extended(const sps_light *light) {
    if (light->kind == SPS_LIGHT_DIRECTIONAL) return light->angular_diameter > 0;
    if (light->kind == SPS_LIGHT_POINT) return 0;
    return spsi_length(light->axes[0]) > 0 || spsi_length(light->axes[1]) > 0;
}

static sps_result spsi_check_cone(sps_context *context, const sps_light *light, int i) {
    if (light->kind == SPS_LIGHT_DIRECTIONAL && (light->inner_cone < 0 || light->inner_cone > 0))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "inner_cone", light->inner_cone,
                               "it must be 0: a directional light has no cone");
    if (light->kind == SPS_LIGHT_DIRECTIONAL && (light->outer_cone < 0 || light->outer_cone > 0))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "outer_cone", light->outer_cone,
                               "it must be 0: a directional light has no cone");
    if (!(light->outer_cone >= 0 && light->outer_cone <= SPSI_PI * (1 + DBL_EPSILON)))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "outer_cone", light->outer_cone,
                               "it must be 0..pi");
    if (!(light->inner_cone >= 0 && (light->inner_cone < light->outer_cone || !(light->inner_cone > 0))))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "inner_cone", light->inner_cone,
                               "it must be 0, or less than outer_cone");
    return SPS_OK;
}

static sps_result spsi_fail_projector(sps_context *context, int i, const char *name, double value, const char *rule) {
    char field[48];
    SPS_SNPRINTF(field, sizeof field, "projector.%s", name);
    return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, field, value, rule);
}

static sps_result spsi_check_projector(sps_context *context, const sps_light *light, int i) {
    const sps_projector *projector = light->projector;
    const double *bad;
    double direction[3], along[2] = {0, 0}, reach;
    if (!projector) return SPS_OK;
    if (spsi_check_canaries(context, SPS_OBJECT_LIGHT, i, "projector.", projector->start_canary, projector->end_canary))
        return context->result;
    if (!projector->sample_fn)
        return spsi_fail_that(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "projector.sample_fn", 0, SPSI_IS_NULL);
    if (projector->width < 1 || projector->width > SPSI_IMAGE_SIZE_MAX)
        return spsi_fail_projector(context, i, "width", projector->width, "it must be 1..4096");
    if (projector->height < 1 || projector->height > SPSI_IMAGE_SIZE_MAX)
        return spsi_fail_projector(context, i, "height", projector->height, "it must be 1..4096");
    if (spsi_bad_coordinate(&projector->right, 1))
        return spsi_fail_projector(context, i, "right", projector->right, "it must be within 1e15");
    if (!(projector->left >= -1e15 && projector->right - projector->left >= 1e-15))
        return spsi_fail_projector(context, i, "left", projector->left,
                                   "it must be within 1e15, and less than right by 1e-15 or more");
    if (spsi_bad_coordinate(&projector->top, 1))
        return spsi_fail_projector(context, i, "top", projector->top, "it must be within 1e15");
    if (!(projector->bottom >= -1e15 && projector->top - projector->bottom >= 1e-15))
        return spsi_fail_projector(context, i, "bottom", projector->bottom,
                                   "it must be within 1e15, and less than top by 1e-15 or more");
    bad = spsi_bad_coordinate(projector->up, 3);
    if (bad) return spsi_fail_projector(context, i, "up", *bad, "it must be within 1e15");
    memcpy(direction, light->direction, sizeof direction);
    spsi_normalise(direction);
    for (int axis = 0; axis < 2 && light->kind >= SPS_LIGHT_DISC; ++axis)
        along[axis] = fabs(spsi_dot(light->axes[axis], direction));
    reach = light->kind == SPS_LIGHT_RECTANGLE ? along[0] + along[1] : sqrt(along[0] * along[0] + along[1] * along[1]);
    if (!(fabs(projector->focus) <= 0) && !(projector->focus > reach && projector->focus <= 1e15))
        return spsi_fail_projector(context, i, "focus", projector->focus,
                                   "it must be 0, or within 1e15 and beyond the extent");
    return SPS_OK;
}

static sps_result spsi_check_extent(sps_context *context, const sps_light *light, int i) {
    if (light->samples < 0 || light->samples > SPSI_POINTS_MAX)
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "samples", light->samples,
                               "it must be 0..256");
    if (light->kind == SPS_LIGHT_DIRECTIONAL && !(light->angular_diameter >= 0 && light->angular_diameter <= 2))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "angular_diameter",
                               light->angular_diameter, "it must be 0..2 radians");
    for (int axis = 0; axis < 2 && light->kind >= SPS_LIGHT_DISC; ++axis)
        if (spsi_bad_coordinate(light->axes[axis], 3))
            return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, axis ? "axes[1]" : "axes[0]",
                                   *spsi_bad_coordinate(light->axes[axis], 3), "it must be within 1e15");
    if (light->shadow_map && spsi_light_extended(light))
        return spsi_fail_that(context, SPS_ERROR_UNSUPPORTED, SPS_OBJECT_LIGHT, i, "shadow_map", 0,
                              "holds the shadow of a single point; an extended light has none");
    if (light->shadow_source == SPS_SHADOW_TABLE && spsi_light_extended(light))
        return spsi_fail_that(context, SPS_ERROR_UNSUPPORTED, SPS_OBJECT_LIGHT, i, "shadow_source", 0,
                              "is SPS_SHADOW_TABLE: a table holds the shadow of a single point; an extended light has "
                              "none");
    return SPS_OK;
}

static sps_result spsi_check_light(sps_context *context, const sps_light *light, int i) {
    const double *bad;
    double direction[3];
    if (spsi_check_canaries(context, SPS_OBJECT_LIGHT, i, "", light->start_canary, light->end_canary))
        return context->result;
    if ((int)light->kind < 0 || light->kind > SPS_LIGHT_RECTANGLE)
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "kind", (double)(int)light->kind,
                               "it must be an sps_light_kind");
    if ((int)light->falloff < 0 || light->falloff > SPS_FALLOFF_NONE)
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "falloff", (double)(int)light->falloff,
                               "it must be an sps_falloff");
    if (spsi_bad_color(light->color, SPSI_VALUE_MAX))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "color",
                               (double)*spsi_bad_color(light->color, SPSI_VALUE_MAX),
                               "red, green and blue must be 0..1e18");
    memcpy(direction, light->direction, sizeof direction);
    if (spsi_check_cone(context, light, i)) return context->result;
    if ((light->kind == SPS_LIGHT_DIRECTIONAL || light->outer_cone > 0 || light->projector) &&
        !spsi_normalise(direction)) {
        int k = 0; /* the component that is not finite, or the last: all are 0 then */
        while (k < 2 && fabs(direction[k]) <= DBL_MAX) ++k;
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "direction", direction[k],
                               "it must be finite and have a length");
    }
    bad = spsi_bad_coordinate(light->position, 3);
    if ((light->kind != SPS_LIGHT_DIRECTIONAL || light->projector) && bad)
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_LIGHT, i, "position", *bad,
                               "it must be within 1e15");
    if (spsi_check_extent(context, light, i) || spsi_check_projector(context, light, i)) return context->result;
    return spsi_check_shadow_map(context, light, i);
}

static sps_result spsi_check_scene(sps_context *context, const sps_scene *scene) {
    if (spsi_check_canaries(context, SPS_OBJECT_SCENE, -1, "", scene->start_canary, scene->end_canary))
        return context->result;
    if (scene->volume_count < 0 || (scene->volume_count > 0 && !scene->volumes))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_SCENE, -1, "volume_count", scene->volume_count,
                               "it must be 0, or positive with volumes set");
    if (scene->mesh_count < 0 || (scene->mesh_count > 0 && !scene->meshes))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_SCENE, -1, "mesh_count", scene->mesh_count,
                               "it must be 0, or positive with meshes set");
    if (scene->light_count < 0 || (scene->light_count > 0 && !scene->lights))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_SCENE, -1, "light_count", scene->light_count,
                               "it must be 0, or positive with lights set");
    if (scene->particle_set_count < 0 || (scene->particle_set_count > 0 && !scene->particles))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_SCENE, -1, "particle_set_count",
                               scene->particle_set_count, "it must be 0, or positive with particles set");
    if (spsi_bad_color(scene->ambient, SPSI_VALUE_MAX))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_SCENE, -1, "ambient",
                               (double)*spsi_bad_color(scene->ambient, SPSI_VALUE_MAX),
                               "red, green and blue must be 0..1e18");
    if (spsi_bad_color(scene->background, SPSI_VALUE_MAX))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_SCENE, -1, "background",
                               (double)*spsi_bad_color(scene->background, SPSI_VALUE_MAX),
                               "red, green and blue must be 0..1e18");
    for (int i = 0; i < scene->volume_count; ++i)
        if (spsi_check_volume(context, &scene->volumes[i], i)) return context->result;
    for (int i = 0; i < scene->mesh_count; ++i)
        if (spsi_check_mesh(context, &scene->meshes[i], i)) return context->result;
    for (int i = 0; i < scene->light_count; ++i)
        if (spsi_check_light(context, &scene->lights[i], i)) return context->result;
    for (int i = 0; i < scene->particle_set_count; ++i)
        if (spsi_check_set(context, &scene->particles[i], i)) return context->result;
    return SPS_OK;
}

/* Checks that a camera has exactly one kind of projection. */
static sps_result spsi_check_projection(sps_context *context, sps_object object, const sps_camera *camera) {
    static const char *const names[3] = {"field_of_view", "ortho_height", "world_to_clip"};
    const int set[3] = {!(fabs(camera->field_of_view) <= 0), !(fabs(camera->ortho_height) <= 0),
                        camera->world_to_clip != NULL};
    char rest[96];
    if (set[0] + set[1] + set[2] == 1) return SPS_OK;
    if (set[0] + set[1] + set[2] == 0)
        return spsi_fail_that(context, SPS_ERROR_ARGUMENT, object, -1, "camera", 0,
                              "has neither field_of_view nor ortho_height nor world_to_clip; one must be set");
    SPS_SNPRINTF(rest, sizeof rest, "has %s and %s; only one may be set", names[!set[0]], names[set[2] ? 2 : 1]);
    return spsi_fail_that(context, SPS_ERROR_ARGUMENT, object, -1, "camera", 0, rest);
}

/* Checks one of a camera's vectors. */
static sps_result spsi_check_vector(sps_context *context, sps_object object, const char *field, const double v[3]) {
    const double *bad = spsi_bad_coordinate(v, 3);
    if (!bad) return SPS_OK;
    return spsi_fail_field(context, SPS_ERROR_ARGUMENT, object, -1, field, *bad, "it must be within 1e15");
}

/* Checks the camera of a view, or of a map's light. */
static sps_result spsi_check_camera(sps_context *context, sps_object object, const sps_camera *camera) {
    const double *matrix = camera->world_to_clip;
    if (spsi_check_projection(context, object, camera)) return context->result;
    if (matrix) {
        const double *bad = spsi_bad_coordinate(matrix, 16);
        char field[32];
        if (!bad) return SPS_OK;
        SPS_SNPRINTF(field, sizeof field, "camera.world_to_clip[%d]", (int)(bad - matrix));
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, object, -1, field, *bad, "it must be within 1e15");
    }
    if (spsi_check_vector(context, object, "camera.position", camera->position) ||
        spsi_check_vector(context, object, "camera.target", camera->target) ||
        spsi_check_vector(context, object, "camera.up", camera->up))
        return context->result;
    if (!(camera->field_of_view >= 0 && camera->field_of_view <= 3.1))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, object, -1, "camera.field_of_view", camera->field_of_view,
                               "it must be above 0, up to 3.1 radians");
    if (!(camera->ortho_height >= 0 && camera->ortho_height <= DBL_MAX))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, object, -1, "camera.ortho_height", camera->ortho_height,
                               "it must be above 0");
    return SPS_OK;
}

/* Checks the fields common to a view and a map's light, apart from their cameras. */
static sps_result spsi_check_sampling(sps_context *context, sps_object object, const int size[2], sps_quality quality,
                                      double slab) {
    for (int i = 0; i < 2; ++i)
        if (size[i] < 1 || size[i] > SPSI_SIZE_MAX)
            return spsi_fail_field(context, SPS_ERROR_ARGUMENT, object, -1, i ? "height" : "width", size[i],
                                   "it must be 1..16384");
    if ((int)quality < 0 || quality > SPS_QUALITY_ULTRA)
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, object, -1, "quality", (double)(int)quality,
                               "it must be an sps_quality");
    if (!(slab >= 0 && slab <= DBL_MAX))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, object, -1, "slab", slab, "it must be 0 or positive");
    return SPS_OK;
}

#define SPSI_COVERAGE_MAX 8 /* along a side of a pixel: samples are bits of 64 */

static int spsi_has_region(const int r[4]) { return r[0] || r[1] || r[2] || r[3]; }

static sps_result spsi_check_view(sps_context *context, const sps_view *view) {
    const int *r = view->region, size[2] = {view->width, view->height};
    if (spsi_check_canaries(context, SPS_OBJECT_VIEW, -1, "", view->start_canary, view->end_canary) ||
        spsi_check_sampling(context, SPS_OBJECT_VIEW, size, view->quality, view->slab))
        return context->result;
    if (spsi_has_region(r) && (r[0] < 0 || r[1] < 0 || r[2] < 1 || r[3] < 1 || r[0] >= size[0] || r[1] >= size[1] ||
                               r[2] > size[0] - r[0] || r[3] > size[1] - r[1])) {
        char rest[128];
        SPS_SNPRINTF(rest, sizeof rest, "is %d,%d,%d,%d; it must lie inside %d x %d", r[0], r[1], r[2], r[3], size[0],
                     size[1]);
        return spsi_fail_that(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VIEW, -1, "region", 0, rest);
    }
    if (view->shadow_size < 0 || view->shadow_size > SPSI_SIZE_MAX)
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VIEW, -1, "shadow_size", view->shadow_size,
                               "it must be 0..16384");
    if (view->coverage_samples < 0 || view->coverage_samples > SPSI_COVERAGE_MAX)
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VIEW, -1, "coverage_samples",
                               view->coverage_samples, "it must be 0..8");
    if (!(view->lookup_threshold >= 0 && view->lookup_threshold <= 1))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VIEW, -1, "lookup_threshold",
                               (double)view->lookup_threshold, "it must be 0..1");
    if (!(view->near_distance >= 0 && view->near_distance <= DBL_MAX))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VIEW, -1, "near_distance", view->near_distance,
                               "it must be 0 or positive");
    return spsi_check_camera(context, SPS_OBJECT_VIEW, &view->camera);
}

static void spsi_resolve_quality(spsi_frame *frame) {
    static const double slab[2][5] = {{1, 2, 1, 0.5, 0.25}, {0.7, 1.4, 0.7, 0.4, 0.2}};
    static const double texels[2][5] = {{1, 0.75, 1, 2, 4}, {1.25, 1, 1.25, 2, 4}};
    static const double cut[] = {3.3, 2.8, 3.3, SPSI_CUT, SPSI_CUT};
    static const double light_cut[] = {2.8, 2.8, 2.8, SPSI_CUT, SPSI_CUT};
    static const double threshold[] = {0.003, 0.01, 0.003, 0.0005, 0.00005};
    static const int depth_map_texels[] = {1024, 512, 1024, 2048, 4096};
    static const int light_points[] = {16, 8, 16, 32, 64};
    if (!(frame->view.slab > 0)) frame->view.slab = slab[frame->matter.classifies][frame->view.quality];
    frame->accuracy.shadow_texels = texels[frame->matter.classifies][frame->view.quality];
    frame->accuracy.threshold = threshold[frame->view.quality];
    frame->accuracy.cut = cut[frame->view.quality];
    frame->accuracy.light_cut = light_cut[frame->view.quality];
    frame->accuracy.depth_map_texels = depth_map_texels[frame->view.quality];
    frame->accuracy.light_points = light_points[frame->view.quality];
}

/* The rays of a checked camera; their width and height are already set. */
static sps_result spsi_rays_build(sps_context *context, sps_object object, const sps_camera *camera, spsi_rays *rays) {
    double forward[3];
    if (camera->world_to_clip) {
        if (spsi_rays_from_matrix(rays, camera->world_to_clip)) return SPS_OK;
        return spsi_fail_that(context, SPS_ERROR_ARGUMENT, object, -1, "camera.world_to_clip", 0, "cannot be inverted");
    }
    if (spsi_rays_from_camera(rays, camera)) return SPS_OK;
    spsi_along(camera->target, camera->position, -1, forward);
    if (!spsi_normalise(forward))
        return spsi_fail_that(context, SPS_ERROR_ARGUMENT, object, -1, "camera.position", 0,
                              "and camera.target are the same point");
    return spsi_fail_field(context, SPS_ERROR_ARGUMENT, object, -1,
                           rays->perspective ? "camera.field_of_view" : "camera.ortho_height",
                           rays->perspective ? camera->field_of_view : camera->ortho_height,
                           "pixels of that size cannot be told apart, or do not fit into the world");
}

static sps_result spsi_resolve_view(sps_context *context, spsi_frame *frame) {
    sps_view *view = &frame->view;
    spsi_rays *eye = &frame->eye;
    if (!spsi_has_region(view->region)) {
        view->region[2] = view->width;
        view->region[3] = view->height;
    }
    eye->width = view->width;
    eye->height = view->height;
    if (spsi_rays_build(context, SPS_OBJECT_VIEW, &view->camera, eye)) return context->result;
    frame->has_matrix = view->camera.world_to_clip != NULL;
    view->camera.world_to_clip = NULL; /* the caller's */
    eye->near_depth =
        frame->has_matrix && !eye->perspective && !(view->near_distance > 0) ? -HUGE_VAL : view->near_distance;
    spsi_resolve_quality(frame);
    return SPS_OK;
}

static void spsi_material_gas(float extinction, const float albedo[3], const float emission[3],
                              spsi_material *material) {
    material->extinction = extinction;
    for (int c = 0; c < 3; ++c) {
        material->albedo[c] = albedo[c];
        material->emission[c] = emission[c];
    }
    material->extinguishes = extinction > 0;
    material->scatters = material->extinguishes && !spsi_black(albedo);
    material->emits = !spsi_black(emission);
}

static void spsi_material_lobes(const sps_lobe *lobes, int count, spsi_material *material) {
    double sum = 0;
    material->lobe_count = count > 0 ? count : 1;
    material->lobes[0].weight = 1;
    for (int i = 0; i < count; ++i) sum += (double)lobes[i].weight;
    for (int i = 0; i < count; ++i) {
        material->lobes[i] = lobes[i];
        material->lobes[i].weight = (float)((double)lobes[i].weight / sum);
    }
}

/* The channel of an equal gas, -1 if there is none: gases of equal appearance share one channel of the sheets. */
static int spsi_find_material(const spsi_frame *frame, const spsi_material *material) {
    for (int i = 0; i < frame->matter.material_count; ++i)
        if (!material->table && memcmp(material, &frame->matter.materials[i], sizeof *material) == 0) return i;
    return -1;
}

/* The channel of a material, a new one unless an equal gas has one. */
static int spsi_take_material(spsi_frame *frame, const spsi_material *material) {
    int channel = spsi_find_material(frame, material);
    frame->matter.scatters |= material->scatters;
    frame->matter.emits |= material->emits;
    if (channel < 0) {
        channel = frame->matter.material_count++;
        frame->matter.materials[channel] = *material;
    }
    return channel;
}

static sps_result spsi_add_material(sps_context *context, spsi_frame *frame, const sps_volume *volume,
                                    spsi_medium *medium, spsi_table *table) {
    spsi_material material;
    memset(&material, 0, sizeof material);
    spsi_material_lobes(volume->lobes, volume->lobe_count, &material);
    if (volume->transfer) {
        frame->matter.classifies = 1;
        material.table = table;
        material.shading = volume->shading;
        material.gradient_scale = 1 / fmaxf(volume->gradient_full > 0 ? volume->gradient_full : 0.05f, SPSI_VALUE_MIN);
        material.voxel_length = (float)cbrt(medium->lattice->voxel_volume);
        material.specular = volume->specular;
        material.shininess = volume->shininess > 0 ? volume->shininess : 32;
        if (spsi_transfer_tabulate(context, volume->transfer, medium->index, &material)) return context->result;
        medium->light_channel = frame->matter.light_channel_count++;
    } else {
        spsi_material_gas(volume->extinction, volume->albedo, volume->emission, &material);
    }
    medium->channel = spsi_take_material(frame, &material);
    return SPS_OK;
}

static sps_result spsi_medium_place(sps_context *context, const sps_volume *volume, const spsi_medium *medium) {
    spsi_lattice *lattice = medium->lattice;
    sps_placement placement;
    spsi_placement_resolve(&volume->placement, &placement);
    if (spsi_check_placement(context, &placement, SPS_OBJECT_VOLUME, medium->index)) return context->result;
    memcpy(lattice->corner, placement.origin, sizeof lattice->corner);
    for (int axis = 0; axis < 3; ++axis)
        for (int i = 0; i < 3; ++i) lattice->step[axis][i] = placement.axis[axis][i] / medium->size[axis];
    lattice->voxel_volume = fabs(spsi_determinant(lattice->step[0], lattice->step[1], lattice->step[2]));
    if (lattice->voxel_volume > 0) return SPS_OK;
    return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_VOLUME, medium->index,
                           "placement's volume of a voxel", lattice->voxel_volume,
                           "it is too small for the numbers in use");
}

static void spsi_medium_build(const sps_volume *volume, int index, spsi_lattice *lattice, spsi_medium *medium) {
    medium->index = index;
    memcpy(medium->size, volume->size, sizeof medium->size);
    medium->lattice = lattice;
    medium->read_fn = volume->read_fn;
    medium->range_fn = volume->range_fn;
    medium->eval_fn = volume->eval_fn;
    medium->user = volume->user;
    medium->revision = volume->revision;
}

static sps_result spsi_resolve_volumes(sps_context *context, spsi_frame *frame, const sps_scene *scene) {
    int classified = 0;
    spsi_table *table;
    for (int i = 0; i < scene->volume_count; ++i) {
        const sps_volume *volume = &scene->volumes[i];
        const int visible = volume->transfer || volume->extinction > 0 || !spsi_black(volume->emission);
        spsi_medium *medium = &frame->media[frame->medium_count];
        if (!spsi_volume_present(volume) || !visible) continue;
        if (frame->medium_count == SPSI_VOLUMES_MAX)
            return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_SCENE, -1, "volume_count",
                                   scene->volume_count, "at most 64 volumes may hold voxels");
        spsi_medium_build(volume, i, &frame->lattices[frame->medium_count], medium);
        medium->lattice->medium = frame->medium_count;
        if (spsi_medium_place(context, volume, medium)) return context->result;
        frame->medium_count += 1;
        classified += volume->transfer != NULL;
        frame->matter.light_channel_count |= !volume->transfer; /* number 0 is for gases, if there are any */
    }
    table = (spsi_table *)spsi_reserve(context, SPSI_BUFFER_TABLES, (size_t)classified, sizeof(spsi_table));
    if (!table) return context->result;
    for (int i = 0; i < frame->medium_count; ++i) {
        spsi_medium *medium = &frame->media[i];
        const sps_volume *volume = &scene->volumes[medium->index];
        if (spsi_add_material(context, frame, volume, medium, table)) return context->result;
        table += volume->transfer != NULL;
        for (int corner = 0; corner < 8; ++corner) {
            const double margin = SPSI_REACH;
            double at[3], point[3];
            for (int k = 0; k < 3; ++k) at[k] = corner >> k & 1 ? medium->size[k] + margin : -margin;
            spsi_voxel_position(medium->lattice, at, point);
            spsi_bounds_add(&frame->volume_bounds, point);
        }
    }
    return SPS_OK;
}

static void spsi_particle_set_build(const sps_particles *particles, int index, int channel, spsi_particle_set *set) {
    set->index = index;
    set->channel = channel;
    set->count = particles->count;
    set->soft = particles->soft != 0;
    set->is_extinction = particles->is_extinction != 0;
    set->read_fn = particles->read_fn;
    set->user = particles->user;
}

/* Sets of particles are gases whose value is extinction. */
static sps_result spsi_resolve_particles(sps_context *context, spsi_frame *frame, const sps_scene *scene) {
    for (int i = 0; i < scene->particle_set_count; ++i) {
        const sps_particles *particles = &scene->particles[i];
        spsi_particle_set *set = &frame->particles.sets[frame->particles.set_count];
        spsi_material material;
        if (particles->count == 0) continue;
        if (frame->particles.set_count == SPSI_SETS_MAX)
            return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_SCENE, -1, "particle_set_count",
                                   scene->particle_set_count, "at most 64 sets may hold particles");
        /* both are at most SPSI_PARTICLES_MAX, so that the sum fits a size_t of 32 bits */
        frame->particles.count += particles->count;
        if (frame->particles.count > SPSI_PARTICLES_MAX)
            return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_PARTICLES, i, "count, with those before it,",
                                   (double)frame->particles.count, "all sets together must have 2^29 at most");
        memset(&material, 0, sizeof material);
        spsi_material_lobes(particles->lobes, particles->lobe_count, &material);
        spsi_material_gas(1, particles->albedo, particles->emission, &material);
        spsi_particle_set_build(particles, i, spsi_take_material(frame, &material), set);
        frame->particles.has_soft |= set->soft;
        frame->particles.set_count += 1;
        frame->matter.light_channel_count = 1;
    }
    return SPS_OK;
}

static void spsi_mesh_build(const sps_mesh *from, int index, spsi_mesh *mesh) {
    mesh->index = index;
    mesh->triangle_count = from->triangle_count;
    spsi_placement_resolve(&from->placement, &mesh->placement);
    memcpy(mesh->color, from->color, sizeof mesh->color);
    memcpy(mesh->transmittance, from->transmittance, sizeof mesh->transmittance);
    mesh->has_normals = from->has_normals != 0;
    mesh->has_colors = from->has_colors != 0;
    mesh->read_fn = from->read_fn;
    mesh->user = from->user;
    mesh->shade_fn = from->shade_fn;
    mesh->shade_user = from->shade_user;
    mesh->revision = from->revision;
}

static sps_result spsi_resolve_meshes(sps_context *context, spsi_frame *frame, const sps_scene *scene) {
    spsi_meshes *meshes = &frame->meshes;
    meshes->list = (spsi_mesh *)spsi_reserve(context, SPSI_BUFFER_MESHES, (size_t)scene->mesh_count, sizeof(spsi_mesh));
    if (!meshes->list) return context->result;
    for (int i = 0; i < scene->mesh_count; ++i) {
        spsi_mesh *mesh = &meshes->list[meshes->count];
        spsi_mesh_build(&scene->meshes[i], i, mesh);
        if (spsi_check_placement(context, &mesh->placement, SPS_OBJECT_MESH, i)) return context->result;
        /* both are at most SPSI_FACES_MAX, so that the sum fits a size_t of 32 bits */
        meshes->triangle_count += mesh->triangle_count;
        meshes->textured_count += mesh->shade_fn ? mesh->triangle_count : 0;
        for (int c = 0; c < 3 && mesh->triangle_count > 0; ++c) meshes->translucent |= mesh->transmittance[c] > 0;
        if (meshes->triangle_count > SPSI_FACES_MAX)
            return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_MESH, i,
                                   "triangle_count, with those before it,", (double)meshes->triangle_count,
                                   "all meshes together must have 2^29 at most");
        meshes->count += mesh->triangle_count > 0; /* an empty one is overwritten by the next */
    }
    return SPS_OK;
}

/* The longer half axis of an ellipse with two conjugate half axes: the larger singular value of the matrix (u v). */
static double spsi_ellipse_radius(const double u[3], const double v[3]) {
    const double a = spsi_dot(u, u), b = spsi_dot(v, v), c = spsi_dot(u, v);
    return sqrt(0.5 * (a + b + sqrt((a - b) * (a - b) + 4 * c * c)));
}

static void spsi_extent_build(const sps_light *light, const double direction[3], spsi_light_extent *extent) {
    extent->exists = 1;
    extent->is_disc = light->kind != SPS_LIGHT_RECTANGLE;
    if (light->kind == SPS_LIGHT_DIRECTIONAL) {
        extent->radius = 0.5 * light->angular_diameter;
        spsi_basis(direction, extent->axis[0], extent->axis[1]);
        return;
    }
    memcpy(extent->axis, light->axes, sizeof extent->axis);
    extent->radius = extent->is_disc ? spsi_ellipse_radius(light->axes[0], light->axes[1])
                                     : spsi_length(light->axes[0]) + spsi_length(light->axes[1]);
}

static void spsi_projection_build(const sps_light *light, const double direction[3], spsi_projection *projection) {
    const sps_projector *projector = light->projector;
    const double across = projector->width / (projector->right - projector->left);
    const double down = projector->height / (projector->top - projector->bottom);
    memset(projection, 0, sizeof *projection);
    projection->exists = 1;
    projection->width = projector->width;
    projection->height = projector->height;
    projection->sample_fn = projector->sample_fn;
    projection->user = projector->user;
    memcpy(projection->forward, direction, sizeof projection->forward);
    spsi_axes_across(direction, projector->up, projection->across[0], projection->across[1]);
    for (int i = 0; i < 3; ++i) projection->across[0][i] *= across, projection->across[1][i] *= down;
    projection->add[0] = -projector->left * across - 0.5; /* texel centres have whole coordinates */
    projection->add[1] = projector->top * down - 0.5;
    projection->edge[0] = 1 / across;
    projection->edge[1] = 1 / down;
    projection->focus = projector->focus > 0 ? 1 / projector->focus : 0;
}

/* Moves a projection from a light's centre to one of its points, so that both throw the image to the same place on the
   plane in focus: that of distance 1 / focus, or for a directional light that of its position. */
static void spsi_projection_move(const spsi_lamp *centre, spsi_lamp *point) {
    spsi_projection *projection = &point->projection;
    const double *forward = projection->forward;
    double offset[3];
    spsi_along(point->position, centre->position, -1, offset);
    for (int k = 0; k < 2; ++k) {
        double *across = projection->across[k];
        projection->add[k] += projection->focus * spsi_dot(across, offset);
        if (!point->is_point)
            spsi_along(across, forward, -spsi_dot(across, point->direction) / spsi_dot(forward, point->direction),
                       across);
        else
            for (int i = 0; i < 3; ++i) across[i] *= 1 - projection->focus * spsi_dot(forward, offset);
    }
}

/* The light without extent at place (x, y) of an extended one. Places on a directional light's disc are spread evenly
   over its solid angle: 1 - cos grows with the square of the distance from its middle. */
static void spsi_lamp_place(const spsi_lamp *lamp, double x, double y, spsi_lamp *point) {
    const spsi_light_extent *extent = &lamp->extent;
    *point = *lamp;
    memset(&point->extent, 0, sizeof point->extent);
    point->points = point->few = point;
    point->point_count = point->few_count = 1;
    if (lamp->is_point) {
        spsi_along(point->position, extent->axis[0], x, point->position);
        spsi_along(point->position, extent->axis[1], y, point->position);
    } else {
        const double r = sqrt(x * x + y * y), less = r * r * 2 * pow(sin(0.5 * extent->radius), 2);
        const double per = r > 0 ? sqrt(less * (2 - less)) / r : 0;
        for (int i = 0; i < 3; ++i)
            point->direction[i] =
                (1 - less) * lamp->direction[i] + per * (x * extent->axis[0][i] + y * extent->axis[1][i]);
        spsi_normalise(point->direction);
    }
    if (lamp->projection.exists) spsi_projection_move(lamp, point);
}

/* Places `count` points evenly over an extended light: a disc's on a spiral of equal areas and golden angles [Vogel
   1979], a rectangle's on a lattice of one point per column whose rows advance by the golden ratio. They are moved so
   that their mean is the centre, which a few points would miss. */
static void spsi_extent_points(const spsi_lamp *lamp, int count, spsi_lamp *points) {
    double places[SPSI_POINTS_MAX][2], mean[2] = {0, 0};
    for (int i = 0; i < count; ++i) {
        const double share = (i + 0.5) / count, turn = 2.39996322972865332 * i, row = 0.61803398874989485 * (i + 0.5);
        places[i][0] = lamp->extent.is_disc ? sqrt(share) * cos(turn) : 2 * share - 1;
        places[i][1] = lamp->extent.is_disc ? sqrt(share) * sin(turn) : 2 * (row - floor(row)) - 1;
        for (int k = 0; k < 2; ++k) mean[k] += places[i][k] / count;
    }
    for (int i = 0; i < count; ++i) spsi_lamp_place(lamp, places[i][0] - mean[0], places[i][1] - mean[1], &points[i]);
}

static void spsi_cone_build(const sps_light *light, spsi_cone *cone) {
    const double whole = cos(light->inner_cone), none = cos(light->outer_cone);
    const double scale = 1 / fmax(whole - none, 1e-6); /* a narrower rim could not be told from a jump in floats */
    cone->exists = light->outer_cone > 0;
    cone->scale = (float)scale;
    cone->offset = (float)(-none * scale);
}

static void spsi_lamp_build(const spsi_frame *frame, const sps_light *light, int index, spsi_lamp *lamp) {
    sps_tmap_settings table;
    memset(lamp, 0, sizeof *lamp);
    lamp->index = index;
    lamp->is_point = light->kind != SPS_LIGHT_DIRECTIONAL;
    memcpy(lamp->position, light->position, sizeof lamp->position);
    memcpy(lamp->direction, light->direction, sizeof lamp->direction);
    spsi_normalise(lamp->direction);
    memcpy(lamp->color, light->color, sizeof lamp->color);
    lamp->samples = light->samples;
    spsi_cone_build(light, &lamp->cone);
    if (light->projector) spsi_projection_build(light, lamp->direction, &lamp->projection);
    lamp->falls_off = lamp->is_point && light->falloff == SPS_FALLOFF_INVERSE_SQUARE;
    lamp->points = lamp->few = lamp;
    lamp->point_count = lamp->few_count = 1;
    if (spsi_light_extended(light)) spsi_extent_build(light, lamp->direction, &lamp->extent);
    lamp->shadows = !light->no_shadow && !frame->view.no_shadows;
    if (!lamp->shadows || !frame->matter.extinguishes) return;
    lamp->has_map = light->shadow_map || light->shadow_source == SPS_SHADOW_TABLE;
    lamp->sliced = !lamp->has_map;
    if (lamp->sliced && light->shadow_source == SPS_SHADOW_AUTO) lamp->choice = SPSI_CHOICE_OPEN;
    memset(&table, 0, sizeof table);
    lamp->map = spsi_settings_resolve(light->shadow_map ? light->shadow_map : &table, 1);
    lamp->map_omnidirectional = light->shadow_map_omnidirectional;
    lamp->map_size = light->shadow_map_size > 0 ? light->shadow_map_size : frame->view.shadow_size;
}

/* Places the points of all extended lights. A mean over few points is as good for what varies slowly over a light: its
   squared distance and, with more of them, its cone. An image needs all points. */
static sps_result spsi_resolve_points(sps_context *context, spsi_frame *frame) {
    spsi_lamp *points;
    size_t count = 0;
    for (int i = 0; i < frame->lamps.count; ++i) {
        spsi_lamp *lamp = &frame->lamps.list[i];
        if (!lamp->extent.exists) continue;
        lamp->point_count = lamp->samples > 0 ? lamp->samples : frame->accuracy.light_points;
        if (lamp->is_point) lamp->few_count = spsi_least(lamp->point_count, lamp->cone.exists ? 16 : 4);
        if (lamp->projection.exists) lamp->few_count = lamp->point_count;
        count += (size_t)(lamp->point_count + lamp->few_count);
    }
    if (count == 0) return SPS_OK;
    points = (spsi_lamp *)spsi_reserve(context, SPSI_BUFFER_LAMP_POINTS, count, sizeof(spsi_lamp));
    if (!points) return context->result;
    for (int i = 0; i < frame->lamps.count; ++i) {
        spsi_lamp *lamp = &frame->lamps.list[i];
        if (!lamp->extent.exists) continue;
        spsi_extent_points(lamp, lamp->point_count, points);
        lamp->points = points;
        points += lamp->point_count;
        if (lamp->few_count == 1) continue;
        spsi_extent_points(lamp, lamp->few_count, points);
        lamp->few = points;
        points += lamp->few_count;
    }
    return SPS_OK;
}

/* Copies the planes of lights' maps. */
static sps_result spsi_resolve_planes(sps_context *context, spsi_frame *frame) {
    size_t count = 0;
    float *planes;
    for (int i = 0; i < frame->lamps.count; ++i) count += (size_t)spsi_settings_planes(&frame->lamps.list[i].map);
    if (count == 0) return SPS_OK;
    planes = (float *)spsi_reserve(context, SPSI_BUFFER_LAMP_PLANES, count, sizeof(float));
    if (!planes) return context->result;
    for (int i = 0; i < frame->lamps.count; ++i) {
        sps_tmap_settings *map = &frame->lamps.list[i].map;
        const int own = spsi_settings_planes(map);
        if (own == 0) continue;
        memcpy(planes, map->planes, (size_t)own * sizeof *planes);
        map->planes = planes;
        planes += own;
    }
    return SPS_OK;
}

/* Lists the lights that are not black; none if nothing in the scene could reflect or scatter them. */
static sps_result spsi_resolve_lamps(sps_context *context, spsi_frame *frame, const sps_scene *scene) {
    const int count = frame->matter.scatters || frame->meshes.count > 0 ? scene->light_count : 0;
    for (int i = 0; i < frame->matter.material_count; ++i) {
        const spsi_material *material = &frame->matter.materials[i];
        frame->matter.extinguishes |= material->extinguishes;
        frame->gradients.exist |= material->table && material->scatters && material->shading == SPS_SHADING_SURFACE;
    }
    frame->lamps.list = (spsi_lamp *)spsi_reserve(context, SPSI_BUFFER_LAMPS, (size_t)count, sizeof(spsi_lamp));
    if (!frame->lamps.list) return context->result;
    for (int i = 0; i < count; ++i) {
        spsi_lamp *lamp = &frame->lamps.list[frame->lamps.count];
        if (spsi_black(scene->lights[i].color)) continue;
        spsi_lamp_build(frame, &scene->lights[i], i, lamp);
        if (lamp->projection.exists) lamp->projection.image = frame->lamps.image_count++;
        frame->lamps.count += 1;
        frame->lamps.shadow_count += lamp->shadows;
        frame->lamps.sliced_count += lamp->sliced;
    }
    if (frame->lamps.count == 0) frame->gradients.exist = 0;
    if (spsi_resolve_planes(context, frame)) return context->result;
    return spsi_resolve_points(context, frame);
}

/* The breadth of a voxel's kernel in pixels, at the middle of the volumes' depth range. Sets *near_by if the eye is so
   close that kernels may be integrated along each pixel's own ray. */
static double spsi_voxel_pixels(const spsi_frame *frame, const spsi_medium *medium, int *near_by) {
    const spsi_rays *eye = &frame->eye;
    double across[2][3], forward[3], low = HUGE_VAL, high = 0, q[3];
    const double pixel = sqrt(spsi_length(eye->a) * spsi_length(eye->b));
    memcpy(forward, eye->inverse[2], sizeof forward);
    spsi_normalise(forward);
    spsi_basis(forward, across[0], across[1]);
    *near_by = 0;
    if (!eye->perspective) return spsi_voxel_breadth(medium->lattice, across[0], across[1]) / pixel;
    for (int corner = 0; corner < 8; ++corner) {
        double point[3];
        spsi_bounds_corner(&frame->volume_bounds, corner, point);
        spsi_along(point, eye->origin, -1, point);
        spsi_to_rays(eye, point, q);
        low = fmin(low, q[2]);
        high = fmax(high, q[2]);
    }
    *near_by = low < SPSI_NEAR_REACHES * frame->accuracy.cut * SPSI_SIGMA *
                         spsi_voxel_extent(medium->lattice, eye->inverse[2]);
    return spsi_voxel_breadth(medium->lattice, across[0], across[1]) /
           (pixel * fmax(0.5 * (fmax(low, 0) + high), DBL_MIN));
}

/* Chooses how gradients are computed. Differences over two pixels fall short of a sharp edge by up to a sixth of
   (pixels / 0.65 voxels)^2, and normals lean towards the slabs' normal; over four pixels, which costs a tenth of a
   frame's time, they are right to 1 % down to one pixel per voxel. Below that they need sheets of their own, with three
   times as much splatting. */
static void spsi_resolve_gradients(spsi_frame *frame) {
    double pixels = HUGE_VAL;
    int near_by = 0;
    for (int i = 0; i < frame->medium_count && frame->gradients.exist; ++i) {
        const spsi_material *material = &frame->matter.materials[frame->media[i].channel];
        int here;
        if (!material->table || material->shading != SPS_SHADING_SURFACE) continue;
        pixels = fmin(pixels, spsi_voxel_pixels(frame, &frame->media[i], &here));
        near_by |= here;
    }
    frame->gradients.reach = frame->gradients.exist ? 1 + (pixels < 4) : 0;
    frame->gradients.splatted = pixels < 0.9 && !near_by;
}

/* 1 if every color in the frame is grey, so that one channel of radiance stands for three; 3 otherwise. */
static int spsi_count_channels(const spsi_frame *frame) {
    int grey = spsi_grey(frame->ambient.radiance) && spsi_grey(frame->background.color) && !frame->background.color_fn;
    for (int i = 0; i < frame->lamps.count; ++i)
        grey &= spsi_grey(frame->lamps.list[i].color) && !frame->lamps.list[i].projection.exists;
    for (int i = 0; i < frame->meshes.count; ++i)
        grey &= !frame->meshes.list[i].has_colors && !frame->meshes.list[i].shade_fn &&
                spsi_grey(frame->meshes.list[i].color) && spsi_grey(frame->meshes.list[i].transmittance);
    for (int i = 0; i < frame->matter.material_count; ++i) {
        const spsi_material *material = &frame->matter.materials[i];
        grey &= spsi_grey(material->albedo) && spsi_grey(material->emission);
        for (int k = 0; k <= SPSI_TABLE_SIZE && material->table; ++k) grey &= spsi_grey(material->table->entry[k]);
    }
    return grey ? 1 : 3;
}

/* Resolves the scene's own fields, after its objects. */
static void spsi_resolve_scene(spsi_frame *frame, const sps_scene *scene) {
    memcpy(frame->ambient.radiance, scene->ambient, sizeof frame->ambient.radiance);
    frame->ambient.exists = !spsi_black(scene->ambient);
    memcpy(frame->background.color, scene->background, sizeof frame->background.color);
    frame->background.color_fn = scene->background_fn;
    frame->background.user = scene->background_user;
    frame->replace_invalid = scene->replace_invalid != 0;
    frame->channels = spsi_count_channels(frame);
}

/* Checks everything and fills a frame, without reading voxels, triangles or particles. view may be NULL if there is
   none yet. Returns NULL on failure. */
static spsi_frame *spsi_frame_build(sps_context *context, const sps_scene *scene, const sps_view *view,
                                    int wants_depth) {
    spsi_frame *frame = (spsi_frame *)spsi_reserve(context, SPSI_BUFFER_FRAME, 1, sizeof(spsi_frame));
    spsi_content *content = (spsi_content *)spsi_reserve(context, SPSI_BUFFER_CONTENT, 1, sizeof(spsi_content));
    if (!frame || !content) return NULL;
    if (spsi_check_scene(context, scene) || (view && spsi_check_view(context, view))) return NULL;
    memset(frame, 0, sizeof *frame);
    if (view) frame->view = *view;
    frame->viewer = SPS_OBJECT_VIEW;
    frame->wants_depth = wants_depth;
    frame->volume_bounds = spsi_nowhere;
    frame->content = content;
    if (spsi_resolve_particles(context, frame, scene) || spsi_resolve_volumes(context, frame, scene) ||
        spsi_resolve_meshes(context, frame, scene))
        return NULL;
    if (view && spsi_resolve_view(context, frame)) return NULL;
    if (spsi_resolve_lamps(context, frame, scene)) return NULL;
    if (view) spsi_resolve_gradients(frame);
    spsi_resolve_scene(frame, scene);
    memset(content, 0, sizeof *content);
    content->bounds = content->outer = frame->volume_bounds;
    content->parts[0] = content->parts[1] = 1;
    content->mesh_bounds = spsi_nowhere;
    content->eye = frame->eye;
    return frame;
}

/* =============================================================================================== >>gather
   10 Relevant voxels. Volumes are read block by block; relevant voxels go into bricks of 8^3, 16 bytes each, in
   segments that never move. A gas's voxel is relevant if it is not 0. A classified volume's voxel is relevant within
   two voxels of a place where any value up to the largest of 3^3 neighbours has extinction: two voxels hold 99.6 % of a
   kernel's weight, so that visible voxels are complete. Cost: linear in the number of voxels read. */

#define SPSI_SEGMENT 16384 /* voxels; a brick lies in one segment */

typedef struct spsi_segment {
    float x[SPSI_SEGMENT + 16], y[SPSI_SEGMENT + 16], z[SPSI_SEGMENT + 16]; /* voxel steps from the brick's base */
    float value[SPSI_SEGMENT + 16]; /* padded by 16, so that a vector may be loaded at the last voxel */
    int used;                       /* number of voxels */
} spsi_segment;

typedef struct spsi_brick {
    int lattice, base[3];          /* index of its lattice; its first voxel */
    unsigned char low[3], high[3]; /* minimum and maximum of its voxels' steps */
    int segment, first, count;     /* index of the segment; range of voxels in it */
} spsi_brick;

typedef struct spsi_block {
    const spsi_medium *medium;
    const spsi_material *material;
    int low[3], size[3];           /* the voxels that are read: the core and its margin, clipped to the volume */
    int core_low[3], core_high[3]; /* the core, whose voxels are gathered */
    float *values, *flags;         /* SPSI_BLOCK_VOXELS each */
    double *positions;             /* of one layer, for eval_fn */
} spsi_block;

#define SPSI_BLOCK_EDGE   (SPSI_BLOCK + 2 * SPSI_MARGIN)
#define SPSI_BLOCK_VOXELS (SPSI_BLOCK_EDGE * SPSI_BLOCK_EDGE * SPSI_BLOCK_EDGE)
#define SPSI_BLOCK_BYTES                                                                                               \
    (2 * SPSI_BLOCK_VOXELS * sizeof(float) + 3 * SPSI_BLOCK_EDGE * SPSI_BLOCK_EDGE * sizeof(double))

static void spsi_block_place(spsi_block *block, const spsi_medium *medium, const spsi_material *material,
                             int64_t index) {
    const int margin = material->table ? SPSI_MARGIN : 0;
    block->medium = medium;
    block->material = material;
    for (int i = 0; i < 3; ++i) {
        const int size = medium->size[i], count = (size + SPSI_BLOCK - 1) / SPSI_BLOCK;
        block->core_low[i] = (int)(index % count) * SPSI_BLOCK;
        block->core_high[i] = spsi_least(size, block->core_low[i] + SPSI_BLOCK);
        block->low[i] = spsi_most(0, block->core_low[i] - margin);
        block->size[i] = spsi_least(size, block->core_high[i] + margin) - block->low[i];
        index /= count;
    }
}

static int64_t spsi_block_count(const spsi_medium *medium) {
    int64_t count = 1;
    for (int i = 0; i < 3; ++i) count *= (medium->size[i] + SPSI_BLOCK - 1) / SPSI_BLOCK;
    return count;
}

static size_t spsi_block_index(const spsi_block *block, int x, int y, int z) {
    return (size_t)(x - block->low[0]) +
           (size_t)block->size[0] *
               ((size_t)(y - block->low[1]) + (size_t)block->size[1] * (size_t)(z - block->low[2]));
}

/* Sets *empty if range_fn shows that nothing in the block can be relevant. */
static sps_result spsi_block_range(sps_context *context, const spsi_block *block, int *empty) {
    const spsi_medium *medium = block->medium;
    float range[2] = {0, 0};
    int returned;
    *empty = 0;
    if (!medium->range_fn) return SPS_OK;
    context->stats.range_calls += 1;
    returned = medium->range_fn(medium->user, block->low, block->size, range);
    if (returned)
        return spsi_fail_field(context, SPS_ERROR_CALLBACK, SPS_OBJECT_VOLUME, medium->index, "range_fn", returned,
                               NULL);
    if (!(range[0] <= range[1]) || !(range[1] <= SPSI_VALUE_MAX)) return SPS_OK; /* reading reports the error */
    if (block->material->table)
        *empty = !spsi_transfer_shows(block->material, 0, range[1]);
    else
        *empty = range[1] < SPSI_VALUE_MIN;
    return SPS_OK;
}

static sps_result spsi_block_evaluate(sps_context *context, const spsi_block *block) {
    const spsi_medium *medium = block->medium;
    const size_t layer = (size_t)block->size[0] * (size_t)block->size[1];
    for (int z = 0; z < block->size[2]; ++z) {
        double *position = block->positions;
        int returned;
        for (int y = 0; y < block->size[1]; ++y)
            for (int x = 0; x < block->size[0]; ++x, position += 3) {
                const double at[3] = {block->low[0] + x + 0.5, block->low[1] + y + 0.5, block->low[2] + z + 0.5};
                spsi_voxel_position(medium->lattice, at, position);
            }
        context->stats.eval_calls += 1;
        returned = medium->eval_fn(medium->user, layer, block->positions, block->values + layer * (size_t)z);
        if (returned)
            return spsi_fail_field(context, SPS_ERROR_CALLBACK, SPS_OBJECT_VOLUME, medium->index, "eval_fn", returned,
                                   NULL);
    }
    return SPS_OK;
}

/* Fails on invalid values, or replaces them by 0. */
static sps_result spsi_block_validate(sps_context *context, const spsi_block *block, int replace) {
    size_t i = 0;
    for (int z = 0; z < block->size[2]; ++z)
        for (int y = 0; y < block->size[1]; ++y)
            for (int x = 0; x < block->size[0]; ++x, ++i) {
                char rule[96];
                if (block->values[i] >= 0 && block->values[i] <= SPSI_VALUE_MAX) continue;
                if (replace) {
                    block->values[i] = 0;
                    context->stats.values_replaced += 1;
                    continue;
                }
                SPS_SNPRINTF(rule, sizeof rule, "values must be 0..1e18 (voxel %d,%d,%d)", block->low[0] + x,
                             block->low[1] + y, block->low[2] + z);
                return spsi_fail_field(context, SPS_ERROR_DATA, SPS_OBJECT_VOLUME, block->medium->index, "value",
                                       (double)block->values[i], rule);
            }
    return SPS_OK;
}

static sps_result spsi_block_read(sps_context *context, const spsi_block *block, int replace) {
    const spsi_medium *medium = block->medium;
    const size_t count = (size_t)block->size[0] * (size_t)block->size[1] * (size_t)block->size[2];
    memset(block->values, 0, count * sizeof(float));
    if (medium->eval_fn) {
        if (spsi_block_evaluate(context, block)) return context->result;
    } else {
        int returned;
        context->stats.read_calls += 1;
        returned = medium->read_fn(medium->user, block->low, block->size, block->values);
        if (returned)
            return spsi_fail_field(context, SPS_ERROR_CALLBACK, SPS_OBJECT_VOLUME, medium->index, "read_fn", returned,
                                   NULL);
    }
    context->stats.voxels_read += count;
    return spsi_block_validate(context, block, replace);
}

/* Replaces each value by the maximum of itself and its two neighbours along x. */
static void spsi_block_spread_x(const spsi_block *block, float *data) {
    const size_t length = (size_t)block->size[0], rows = (size_t)block->size[1] * (size_t)block->size[2];
    float line[SPSI_BLOCK_EDGE + 2];
    for (size_t r = 0; r < rows; ++r, data += length) {
        memcpy(line + 1, data, length * sizeof(float));
        line[0] = line[1];
        line[length + 1] = line[length];
        for (size_t i = 0; i < length; ++i) {
            const float most = line[i] > line[i + 1] ? line[i] : line[i + 1];
            data[i] = most > line[i + 2] ? most : line[i + 2];
        }
    }
}

/* The same along y (axis 1) or z (axis 2): `rows` of `width` contiguous values at a time. */
static void spsi_block_spread_rows(const spsi_block *block, float *data, int axis) {
    const size_t width = (size_t)block->size[0] * (axis == 1 ? 1 : (size_t)block->size[1]);
    const size_t rows = (size_t)block->size[axis], sets = axis == 1 ? (size_t)block->size[2] : 1;
    float before[SPSI_BLOCK_EDGE * SPSI_BLOCK_EDGE];
    for (size_t set = 0; set < sets; ++set) {
        memcpy(before, data, width * sizeof(float));
        for (size_t r = 0; r < rows; ++r, data += width) {
            const float *after = r + 1 < rows ? data + width : data;
            for (size_t i = 0; i < width; ++i) {
                const float here = data[i], most = before[i] > here ? before[i] : here;
                data[i] = most > after[i] ? most : after[i];
                before[i] = here;
            }
        }
    }
}

/* Replaces each value by the maximum of its 3^3 neighbourhood. */
static void spsi_block_spread(const spsi_block *block, float *data) {
    spsi_block_spread_x(block, data);
    spsi_block_spread_rows(block, data, 1);
    spsi_block_spread_rows(block, data, 2);
}

/* Flags (1 or 0) the voxels of a block that contribute to anything that the transfer function shows. A voxel is shown
   if any value up to the maximum around it is: without it the field would fall to 0, through the values shown. */
static void spsi_block_flag_shown(const spsi_block *block) {
    const size_t count = (size_t)block->size[0] * (size_t)block->size[1] * (size_t)block->size[2];
    memcpy(block->flags, block->values, count * sizeof(float));
    spsi_block_spread(block, block->flags);
    for (size_t i = 0; i < count; ++i)
        block->flags[i] = (float)spsi_transfer_shows(block->material, 0, block->flags[i]);
    for (int twice = 0; twice < 2; ++twice) spsi_block_spread(block, block->flags);
}

/* Whether anything in a block that has been read can be relevant: a quick test that saves most blocks the flags. */
static int spsi_block_matters(const spsi_block *block) {
    const size_t count = (size_t)block->size[0] * (size_t)block->size[1] * (size_t)block->size[2];
    float most = block->values[0];
    for (size_t i = 1; i < count; ++i) most = block->values[i] > most ? block->values[i] : most;
    if (!block->material->table) return most >= SPSI_VALUE_MIN;
    return spsi_transfer_shows(block->material, 0, most);
}

static spsi_segment *spsi_segment_at(const sps_context *context, int index) {
    SPS_ASSERT(index >= 0 && index < context->segment_count);
    return ((spsi_segment **)context->buffers[SPSI_BUFFER_SEGMENTS].data)[index];
}

/* The segment with room for a whole brick; `current`, its index, advances when it is full. Returns NULL on failure. */
static spsi_segment *spsi_segment_with_room(sps_context *context, int *current) {
    const int whole = SPSI_BRICK * SPSI_BRICK * SPSI_BRICK;
    spsi_segment *segment = *current < 0 ? NULL : spsi_segment_at(context, *current);
    if (segment && segment->used + whole <= SPSI_SEGMENT) return segment;
    *current += 1;
    if (*current == context->segment_count) {
        spsi_segment **list = (spsi_segment **)spsi_extend(context, SPSI_BUFFER_SEGMENTS, (size_t)*current,
                                                           (size_t)*current + 1, sizeof(spsi_segment *));
        if (!list) return NULL;
        list[*current] = (spsi_segment *)spsi_acquire(context, 1, sizeof(spsi_segment));
        if (!list[*current]) return NULL;
        memset(list[*current], 0, sizeof(spsi_segment));
        context->segment_count += 1;
    }
    segment = spsi_segment_at(context, *current);
    segment->used = 0;
    return segment;
}

static void spsi_brick_widen(spsi_brick *brick, const int step[3]) {
    for (int i = 0; i < 3; ++i) {
        if (brick->count == 0 || step[i] < brick->low[i]) brick->low[i] = (unsigned char)step[i];
        if (brick->count == 0 || step[i] > brick->high[i]) brick->high[i] = (unsigned char)step[i];
    }
}

/* Collects the brick at `base` from a block. */
static void spsi_brick_fill(const spsi_block *block, const int base[3], spsi_segment *segment, spsi_brick *brick) {
    int end[3];
    memcpy(brick->base, base, sizeof brick->base);
    brick->first = segment->used;
    brick->count = 0;
    for (int i = 0; i < 3; ++i) end[i] = spsi_least(SPSI_BRICK, block->core_high[i] - base[i]);
    for (int z = 0; z < end[2]; ++z)
        for (int y = 0; y < end[1]; ++y) {
            const size_t row = spsi_block_index(block, base[0], base[1] + y, base[2] + z);
            for (int x = 0; x < end[0]; ++x) {
                const float value = block->values[row + (size_t)x];
                const int step[3] = {x, y, z};
                if (value < SPSI_VALUE_MIN || (block->material->table && !(block->flags[row + (size_t)x] > 0)))
                    continue;
                spsi_brick_widen(brick, step);
                segment->x[segment->used] = (float)x;
                segment->y[segment->used] = (float)y;
                segment->z[segment->used] = (float)z;
                segment->value[segment->used++] = value;
                brick->count += 1;
            }
        }
}

static sps_result spsi_block_to_bricks(sps_context *context, const spsi_block *block, int lattice, int *current) {
    int base[3];
    for (base[2] = block->core_low[2]; base[2] < block->core_high[2]; base[2] += SPSI_BRICK)
        for (base[1] = block->core_low[1]; base[1] < block->core_high[1]; base[1] += SPSI_BRICK)
            for (base[0] = block->core_low[0]; base[0] < block->core_high[0]; base[0] += SPSI_BRICK) {
                const int count = context->brick_count;
                spsi_segment *segment = spsi_segment_with_room(context, current);
                spsi_brick *bricks = segment ? (spsi_brick *)spsi_extend(context, SPSI_BUFFER_BRICKS, (size_t)count,
                                                                         (size_t)count + 1, sizeof(spsi_brick))
                                             : NULL;
                if (!bricks) return context->result;
                bricks[count].lattice = lattice;
                bricks[count].segment = *current;
                spsi_brick_fill(block, base, segment, &bricks[count]);
                if (bricks[count].count > 0) context->brick_count += 1;
                context->voxel_count += (uint64_t)bricks[count].count;
            }
    return SPS_OK;
}

static void spsi_block_buffers(spsi_block *block, void *memory) {
    block->positions = (double *)memory;
    block->values = (float *)(block->positions + 3 * SPSI_BLOCK_EDGE * SPSI_BLOCK_EDGE);
    block->flags = block->values + SPSI_BLOCK_VOXELS;
}

static sps_result spsi_gather_medium(sps_context *context, const spsi_frame *frame, int medium, int *current) {
    const int64_t count = spsi_block_count(&frame->media[medium]);
    void *memory = spsi_reserve(context, SPSI_BUFFER_BLOCK, 1, SPSI_BLOCK_BYTES);
    spsi_block block;
    if (!memory) return context->result;
    spsi_block_buffers(&block, memory);
    for (int64_t i = 0; i < count; ++i) {
        int empty;
        spsi_block_place(&block, &frame->media[medium], &frame->matter.materials[frame->media[medium].channel], i);
        if (spsi_progress(context, SPSI_PROGRESS_GATHER * (medium + (double)i / (double)count) / frame->medium_count))
            return context->result;
        if (spsi_block_range(context, &block, &empty)) return context->result;
        context->stats.blocks_skipped += (uint64_t)empty;
        if (empty) continue;
        if (spsi_block_read(context, &block, frame->replace_invalid)) return context->result;
        if (!spsi_block_matters(&block)) continue;
        if (block.material->table) spsi_block_flag_shown(&block);
        if (spsi_block_to_bricks(context, &block, medium, current)) return context->result;
    }
    return SPS_OK;
}

/* A hash of everything that decides which voxels are held; 0 if a volume has no revision. */
static uint64_t spsi_volumes_fingerprint(const spsi_frame *frame) {
    uint64_t hash = spsi_fingerprint(SPSI_FINGERPRINT_START, &frame->replace_invalid, sizeof(int));
    for (int i = 0; i < frame->medium_count; ++i) {
        const spsi_medium *medium = &frame->media[i];
        const spsi_material *material = &frame->matter.materials[medium->channel];
        const spsi_lattice *lattice = medium->lattice;
        const spsi_table *table = material->table;
        if (medium->revision == 0) return 0;
        hash = spsi_fingerprint(hash, medium->size, sizeof medium->size);
        hash = spsi_fingerprint(hash, &medium->user, sizeof medium->user);
        hash = spsi_fingerprint(hash, &medium->read_fn, sizeof medium->read_fn);
        hash = spsi_fingerprint(hash, &medium->eval_fn, sizeof medium->eval_fn);
        hash = spsi_fingerprint(hash, &medium->revision, sizeof medium->revision);
        if (medium->eval_fn) hash = spsi_fingerprint(hash, lattice->step, sizeof lattice->step);
        if (medium->eval_fn) hash = spsi_fingerprint(hash, lattice->corner, sizeof lattice->corner);
        if (table) hash = spsi_fingerprint(hash, table->shown, sizeof table->shown);
        if (table) hash = spsi_fingerprint(hash, &material->table_scale, sizeof material->table_scale);
    }
    return hash | 1;
}

/* A hash of a brick's voxels and of its place in its volume. Four sums side by side, as each waits for itself. */
static uint64_t spsi_brick_fingerprint(const sps_context *context, const spsi_brick *brick) {
    const spsi_segment *segment = spsi_segment_at(context, brick->segment);
    uint64_t sums[4] = {SPSI_FINGERPRINT_START, 1, 2, 3};
    for (int i = 0; i < brick->count; ++i) {
        const int at = brick->first + i;
        const float place = segment->x[at] + SPSI_BRICK * (segment->y[at] + SPSI_BRICK * segment->z[at]);
        uint32_t value;
        memcpy(&value, &segment->value[at], sizeof value);
        sums[i & 3] = spsi_fingerprint_word(sums[i & 3], (uint64_t)place << 32 | value);
    }
    for (int i = 1; i < 4; ++i) sums[0] = spsi_fingerprint_word(sums[0], sums[i]);
    for (int i = 0; i < 3; ++i) sums[0] = spsi_fingerprint_word(sums[0], (uint64_t)brick->base[i]);
    return sums[0];
}

static void spsi_brick_prints_task(void *data, int index, int worker) {
    const sps_context *context = (const sps_context *)data;
    const spsi_brick *bricks = (const spsi_brick *)context->buffers[SPSI_BUFFER_BRICKS].data;
    uint64_t *prints = (uint64_t *)context->buffers[SPSI_BUFFER_BRICK_PRINTS].data;
    const int end = spsi_batch_end(index, context->brick_count);
    (void)worker;
    for (int i = index * SPSI_BATCH; i < end; ++i) prints[i] = spsi_brick_fingerprint(context, &bricks[i]);
}

/* Computes the fingerprints of all bricks, unless they are held with them. */
static sps_result spsi_brick_prints(sps_context *context) {
    if (context->bricks_printed) return SPS_OK;
    if (!spsi_reserve(context, SPSI_BUFFER_BRICK_PRINTS, (size_t)context->brick_count, sizeof(uint64_t)))
        return context->result;
    spsi_parallel_batches(context, context->brick_count, spsi_brick_prints_task, context);
    context->bricks_printed = 1;
    return SPS_OK;
}

/* The world bounds of the relevant voxels and their kernels; empty if there are none. */
static void spsi_tighten_bounds(const sps_context *context, const spsi_frame *frame) {
    const spsi_brick *bricks = (const spsi_brick *)context->buffers[SPSI_BUFFER_BRICKS].data;
    frame->content->bounds = spsi_nowhere;
    for (int i = 0; i < context->brick_count; ++i)
        for (int corner = 0; corner < 8; ++corner) {
            double at[3], point[3];
            for (int k = 0; k < 3; ++k)
                at[k] = bricks[i].base[k] + 0.5 +
                        (corner >> k & 1 ? bricks[i].high[k] + SPSI_REACH : bricks[i].low[k] - SPSI_REACH);
            spsi_voxel_position(&frame->lattices[bricks[i].lattice], at, point);
            spsi_bounds_add(&frame->content->bounds, point);
        }
}

/* Tells the caller of values that were replaced. */
static void spsi_tell_replaced(const sps_context *context, uint64_t before) {
    const double replaced = (double)(context->stats.values_replaced - before);
    char text[96];
    if (!(replaced > 0) || !context->config.message_fn) return;
    SPS_SNPRINTF(text, sizeof text, "%.0f values of volumes were invalid and count as 0", replaced);
    context->config.message_fn(context->config.message_user, text);
}

/* Reads the relevant voxels of all volumes, unless they are still held from the last call. */
static sps_result spsi_gather(sps_context *context, const spsi_frame *frame) {
    const uint64_t fingerprint = spsi_volumes_fingerprint(frame), replaced = context->stats.values_replaced;
    if (fingerprint == 0 || fingerprint != context->gathered) {
        int current = -1;
        context->gathered = 0;
        context->bricks_printed = 0;
        context->brick_count = 0;
        context->voxel_count = 0;
        for (int i = 0; i < frame->medium_count; ++i)
            if (spsi_gather_medium(context, frame, i, &current)) return context->result;
        context->gathered = fingerprint;
        spsi_tell_replaced(context, replaced);
    }
    context->stats.bricks = (uint64_t)context->brick_count;
    context->stats.voxels_relevant = context->voxel_count;
    spsi_tighten_bounds(context, frame);
    return SPS_OK;
}

/* ---- particles ---- */

#define SPSI_PARTICLE_BATCH 4096 /* particles read at a time */

/* Returns the name of an invalid field of a particle, with the rule that it breaks and its value; NULL if all are
   valid. */
static const char *spsi_particle_wrong(const sps_particle *particle, const char **rule, double *value) {
    for (int i = 0; i < 3; ++i) {
        *value = (double)particle->position[i];
        *rule = "it must be within 1e15";
        if (spsi_bad_coordinate(value, 1)) return "position";
    }
    *value = (double)particle->radius;
    *rule = "it must be 0..1e15";
    if (!(*value >= 0 && *value <= SPSI_COORDINATE_MAX)) return "radius";
    *value = (double)particle->optical_depth;
    *rule = "it must be 0..1e18";
    return *value >= 0 && particle->optical_depth <= SPSI_VALUE_MAX ? NULL : "optical_depth";
}

/* Fails on invalid particles, or replaces them by empty ones. */
static sps_result spsi_particles_validate(sps_context *context, const spsi_particle_set *set, sps_particle *list,
                                          size_t first, size_t count, int replace) {
    for (size_t i = 0; i < count; ++i) {
        const char *rule;
        double value;
        const char *wrong = spsi_particle_wrong(&list[i], &rule, &value);
        char field[64];
        if (!wrong) continue;
        if (replace) {
            list[i].radius = 0;
            context->stats.values_replaced += 1;
            continue;
        }
        SPS_SNPRINTF(field, sizeof field, "particle[%.0f].%s", (double)(first + i), wrong);
        return spsi_fail_field(context, SPS_ERROR_DATA, SPS_OBJECT_PARTICLES, set->index, field, value, rule);
    }
    return SPS_OK;
}

/* Moves the particles of a batch that are not empty to its beginning. Returns their number. */
static int spsi_particles_keep(sps_particle *batch, size_t count) {
    int kept = 0;
    for (size_t i = 0; i < count; ++i)
        if (batch[i].radius >= SPSI_VALUE_MIN && batch[i].optical_depth >= SPSI_VALUE_MIN) batch[kept++] = batch[i];
    return kept;
}

static sps_result spsi_gather_set(sps_context *context, const spsi_frame *frame, const spsi_particle_set *set,
                                  size_t *read, sps_particle *list) {
    for (size_t first = 0; first < set->count; first += SPSI_PARTICLE_BATCH) {
        const size_t left = set->count - first, count = left < SPSI_PARTICLE_BATCH ? left : SPSI_PARTICLE_BATCH;
        sps_particle *batch = list + frame->content->particle_count; /* there is room: no more were kept than read */
        int returned;
        if (spsi_progress(context, SPSI_PROGRESS_GATHER * (double)*read / (double)frame->particles.count))
            return context->result;
        memset(batch, 0, count * sizeof *batch);
        context->stats.particle_calls += 1;
        returned = set->read_fn(set->user, first, count, batch);
        if (returned)
            return spsi_fail_field(context, SPS_ERROR_CALLBACK, SPS_OBJECT_PARTICLES, set->index, "read_fn", returned,
                                   NULL);
        if (spsi_particles_validate(context, set, batch, first, count, frame->replace_invalid)) return context->result;
        frame->content->particle_count += spsi_particles_keep(batch, count);
        *read += count;
    }
    frame->content->set_ends[set - frame->particles.sets] = frame->content->particle_count;
    return SPS_OK;
}

/* Bounds, mean radius and spread of the particles. The latter two are means, so that a stray particle among many hardly
   changes them. */
static void spsi_measure_particles(const spsi_frame *frame) {
    double logs = 0, sum[3] = {0, 0, 0}, squares = 0, origin[3];
    if (frame->content->particle_count == 0) return;
    for (int i = 0; i < 3; ++i) origin[i] = (double)frame->content->particles[0].position[i];
    for (int n = 0; n < frame->content->particle_count; ++n) {
        const sps_particle *particle = &frame->content->particles[n];
        double low[3], high[3];
        for (int i = 0; i < 3; ++i) {
            const double at = (double)particle->position[i], apart = at - origin[i];
            const double reach = fmax((double)particle->radius, 1e-12 * fabs(at)); /* so that low and high differ */
            low[i] = at - reach;
            high[i] = at + reach;
            sum[i] += apart;
            squares += apart * apart;
        }
        spsi_bounds_add(&frame->content->bounds, low);
        spsi_bounds_add(&frame->content->bounds, high);
        logs += log((double)particle->radius);
    }
    frame->content->particle_radius = exp(logs / frame->content->particle_count);
    squares -= spsi_dot(sum, sum) / frame->content->particle_count;
    frame->content->particle_spread = sqrt(fmax(squares / frame->content->particle_count, 0));
}

/* Reads every set of particles once, and keeps 20 bytes per particle. */
static sps_result spsi_gather_particles(sps_context *context, const spsi_frame *frame) {
    const uint64_t replaced = context->stats.values_replaced;
    size_t read = 0;
    sps_particle *list;
    if (frame->particles.set_count == 0) return SPS_OK;
    list = (sps_particle *)spsi_reserve(context, SPSI_BUFFER_PARTICLES, frame->particles.count, sizeof(sps_particle));
    if (!list) return context->result;
    for (int i = 0; i < frame->particles.set_count; ++i)
        if (spsi_gather_set(context, frame, &frame->particles.sets[i], &read, list)) return context->result;
    frame->content->particles = list;
    context->stats.particles = (uint64_t)frame->content->particle_count;
    spsi_measure_particles(frame);
    if (context->stats.values_replaced > replaced && context->config.message_fn) {
        char text[96];
        SPS_SNPRINTF(text, sizeof text, "%.0f particles were invalid and are ignored",
                     (double)(context->stats.values_replaced - replaced));
        context->config.message_fn(context->config.message_user, text);
    }
    return SPS_OK;
}

/* The set that a particle of the content belongs to. Cost: a binary search. */
static const spsi_particle_set *spsi_set_of(const spsi_frame *frame, int particle) {
    int low = 0, high = frame->particles.set_count - 1;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (particle < frame->content->set_ends[middle])
            high = middle;
        else
            low = middle + 1;
    }
    return &frame->particles.sets[low];
}

/* ================================================================================================ >>trees
   11 Trees of boxes that rays traverse: of triangles, and of the reference's particles. They are built from the top;
   each node is cut where the sum of area times number of items is smallest, at one of 16 bins along the axis on which
   the items' centres spread most [Wald 2007]. This copes with a ground a million times as wide as what stands on it,
   since the area term separates such outliers at once. Boxes are floats relative to a centre, rounded outwards; rays
   are widened by the round-off of their own floats. So round-off never misses a box; boxes only select the items for an
   exact test. Cost: items times levels to build, about 0.3 us per item for a million items; 36 bytes per item, and 28
   more during the build. */

#define SPSI_TREE_LEAF  4 /* maximum number of items in a leaf; the minimum is 2, unless the tree has only 1 */
#define SPSI_TREE_BINS  16
#define SPSI_TREE_DEPTH 48 /* from this depth on, nodes are split in half: 2^31 items go at most 30 levels deeper */
#define SPSI_TREE_STACK 96
#define SPSI_TREE_TASKS 64 /* approximate number of subtrees built in parallel */

typedef struct spsi_tree_node {
    float low[3], high[3];
    int first, count; /* count > 0: a leaf of these entries of `order`; 0: children first and first + 1 */
} spsi_tree_node;

/* An item while the tree is being built. */
typedef struct spsi_tree_item {
    float low[3], high[3];
    int number;
} spsi_tree_item;

typedef struct spsi_tree {
    spsi_tree_node *nodes;
    int *order, count; /* order: the items' numbers, leaf after leaf */
    double centre[3];  /* boxes are relative to this */
} spsi_tree;

/* A node whose items are to be split. */
typedef struct spsi_tree_task {
    int node, depth;
} spsi_tree_task;

/* A float just above (1) or below (0) `a`: the next one, or a little farther. */
static float spsi_outward(double a, int above) {
    const double room = 1.2e-7 * fabs(a) + 1e-37;
    return (float)(above ? a + room : a - room);
}

static void spsi_tree_item_add(spsi_tree_item *item, const double centre[3], const double low[3],
                               const double high[3]) {
    for (int i = 0; i < 3; ++i) {
        item->low[i] = spsi_outward(low[i] - centre[i], 0);
        item->high[i] = spsi_outward(high[i] - centre[i], 1);
    }
}

static void spsi_tree_box_add(float low[3], float high[3], const float other_low[3], const float other_high[3]) {
    for (int i = 0; i < 3; ++i) {
        low[i] = spsi_lower(low[i], other_low[i]);
        high[i] = spsi_higher(high[i], other_high[i]);
    }
}

/* Half the surface area of a box. `unit` is 1 over the node's longest side, so that nothing overflows. */
static float spsi_tree_area(const float low[3], const float high[3], float unit) {
    const float x = (high[0] - low[0]) * unit, y = (high[1] - low[1]) * unit, z = (high[2] - low[2]) * unit;
    return x >= 0 ? x * y + y * z + z * x : 0;
}

/* Twice an item's centre along an axis. */
static inline float spsi_tree_middle(const spsi_tree_item *item, int axis) {
    return item->low[axis] + item->high[axis];
}

typedef struct spsi_tree_bin {
    float low[3], high[3];
    int count;
} spsi_tree_bin;

/* How to split a node's items: those whose centres fall into bins 0..last along the axis come first. last < 0: no cut
   separates them. */
typedef struct spsi_tree_cut {
    int axis, last;
    float start, scale;
} spsi_tree_cut;

static inline int spsi_tree_bin_of(const spsi_tree_cut *cut, const spsi_tree_item *item) {
    return spsi_least((int)((spsi_tree_middle(item, cut->axis) - cut->start) * cut->scale), SPSI_TREE_BINS - 1);
}

static void spsi_tree_bins_clear(spsi_tree_bin *bins, int count) {
    memset(bins, 0, (size_t)count * sizeof *bins);
    for (int i = 0; i < count; ++i)
        for (int k = 0; k < 3; ++k) bins[i].low[k] = FLT_MAX, bins[i].high[k] = -FLT_MAX;
}

/* Returns the bin after which a cut is cheapest: sweeps over the bins from both ends. */
static int spsi_tree_cheapest(const spsi_tree_bin *bins, float unit) {
    float cost[SPSI_TREE_BINS], least = FLT_MAX;
    spsi_tree_bin sum;
    int last = -1;
    for (int side = 0; side < 2; ++side) {
        spsi_tree_bins_clear(&sum, 1);
        for (int i = 0; i < SPSI_TREE_BINS; ++i) {
            const int bin = side ? SPSI_TREE_BINS - 1 - i : i;
            if (side && sum.count > 0 && cost[bin] < FLT_MAX) {
                cost[bin] += (float)sum.count * spsi_tree_area(sum.low, sum.high, unit);
                if (cost[bin] < least) least = cost[bin], last = bin;
            }
            spsi_tree_box_add(sum.low, sum.high, bins[bin].low, bins[bin].high);
            sum.count += bins[bin].count;
            if (!side) cost[bin] = sum.count > 0 ? (float)sum.count * spsi_tree_area(sum.low, sum.high, unit) : FLT_MAX;
        }
    }
    return last;
}

/* Computes a node's box, and chooses its cut. */
static void spsi_tree_plan_cut(const spsi_tree_item *items, spsi_tree_node *node, int depth, spsi_tree_cut *cut) {
    float low[3] = {FLT_MAX, FLT_MAX, FLT_MAX}, high[3] = {-FLT_MAX, -FLT_MAX, -FLT_MAX}, size = 0;
    spsi_tree_bin bins[SPSI_TREE_BINS];
    for (int k = 0; k < 3; ++k) node->low[k] = FLT_MAX, node->high[k] = -FLT_MAX;
    for (int i = node->first; i < node->first + node->count; ++i) {
        float middle[3];
        for (int k = 0; k < 3; ++k) middle[k] = spsi_tree_middle(&items[i], k);
        spsi_tree_box_add(node->low, node->high, items[i].low, items[i].high);
        spsi_tree_box_add(low, high, middle, middle);
    }
    cut->axis = 0;
    cut->last = -1;
    if (node->count <= SPSI_TREE_LEAF || depth >= SPSI_TREE_DEPTH) return;
    for (int k = 1; k < 3; ++k)
        if (high[k] - low[k] > high[cut->axis] - low[cut->axis]) cut->axis = k;
    for (int k = 0; k < 3; ++k) size = spsi_higher(size, node->high[k] - node->low[k]);
    cut->start = low[cut->axis];
    cut->scale = SPSI_TREE_BINS / (high[cut->axis] - cut->start);
    if (!(cut->scale <= FLT_MAX) || !(size <= FLT_MAX)) return;
    spsi_tree_bins_clear(bins, SPSI_TREE_BINS);
    for (int i = node->first; i < node->first + node->count; ++i) {
        spsi_tree_bin *bin = &bins[spsi_tree_bin_of(cut, &items[i])];
        spsi_tree_box_add(bin->low, bin->high, items[i].low, items[i].high);
        bin->count += 1;
    }
    cut->last = spsi_tree_cheapest(bins, 1 / size);
}

/* Partitions items first..end-1 in place: those up to the cut come before the others. Returns the first of the
   others. */
static int spsi_tree_part(spsi_tree_item *items, int first, int end, const spsi_tree_cut *cut) {
    while (first < end) {
        if (spsi_tree_bin_of(cut, &items[first]) <= cut->last) {
            ++first;
        } else {
            const spsi_tree_item other = items[--end];
            items[end] = items[first];
            items[first] = other;
        }
    }
    return first;
}

/* Makes a leaf of a node, or splits it in two. Both sides get at least two items, even if a single item lies far from
   the others: cuts are then at least two apart, and a cut's position alone determines where its two nodes are stored,
   whichever task builds them. Returns the first child, or 0 for a leaf. */
static int spsi_tree_split(spsi_tree *tree, spsi_tree_item *items, const spsi_tree_task *task) {
    spsi_tree_node *node = &tree->nodes[task->node], *children;
    const int first = node->first, count = node->count;
    spsi_tree_cut cut;
    int middle = first + count / 2;
    spsi_tree_plan_cut(items, node, task->depth, &cut);
    if (count <= SPSI_TREE_LEAF) {
        for (int i = first; i < first + count; ++i) tree->order[i] = items[i].number;
        return 0;
    }
    if (cut.last >= 0)
        middle = spsi_least(spsi_most(spsi_tree_part(items, first, first + count, &cut), first + 2), first + count - 2);
    node->first = middle / 2 * 2;
    node->count = 0;
    children = &tree->nodes[node->first];
    children[0].first = first;
    children[0].count = middle - first;
    children[1].first = middle;
    children[1].count = first + count - middle;
    return node->first;
}

typedef struct spsi_tree_job {
    spsi_tree *tree;
    spsi_tree_item *items;
    spsi_tree_task tasks[4 * SPSI_TREE_TASKS];
    int task_count;
} spsi_tree_job;

/* Builds one subtree. */
static void spsi_tree_task_run(void *data, int index, int worker) {
    const spsi_tree_job *job = (const spsi_tree_job *)data;
    spsi_tree_task stack[SPSI_TREE_STACK];
    int top = 0;
    (void)worker;
    stack[top++] = job->tasks[index];
    while (top > 0) {
        const spsi_tree_task task = stack[--top];
        const int child = spsi_tree_split(job->tree, job->items, &task);
        for (int i = 0; i < 2 && child > 0; ++i) {
            stack[top].node = child + i;
            stack[top++].depth = task.depth + 1;
        }
    }
}

/* Number of nodes to reserve for a tree of `count` items. */
static size_t spsi_tree_nodes(size_t count) { return count + 2; }

static size_t spsi_tree_bytes(size_t count) {
    return count * (sizeof(int) + sizeof(spsi_tree_item)) + spsi_tree_nodes(count) * sizeof(spsi_tree_node);
}

/* Builds a tree whose memory is already reserved: the top nodes serially, then the subtrees in parallel. */
static sps_result spsi_tree_build(sps_context *context, spsi_tree *tree, spsi_tree_item *items) {
    spsi_tree_job job;
    const int few = spsi_most(tree->count / SPSI_TREE_TASKS, 1024);
    int next = 0;
    if (tree->count == 0) return SPS_OK;
    job.tree = tree;
    job.items = items;
    tree->nodes[0].first = 0;
    tree->nodes[0].count = tree->count;
    job.tasks[0].node = job.tasks[0].depth = 0;
    job.task_count = 1;
    while (next < job.task_count && job.task_count + 1 < 4 * SPSI_TREE_TASKS) {
        const spsi_tree_task task = job.tasks[next];
        int child;
        if (tree->nodes[task.node].count <= few) {
            ++next;
            continue;
        }
        if (spsi_progress(context, 0)) return context->result;
        child = spsi_tree_split(tree, items, &task);
        job.tasks[next].node = child;
        job.tasks[next].depth = task.depth + 1;
        job.tasks[job.task_count].node = child + 1;
        job.tasks[job.task_count++].depth = task.depth + 1;
    }
    spsi_parallel(context, job.task_count, spsi_tree_task_run, &job);
    return spsi_progress(context, 0);
}

/* ============================================================================================= >>polygons
   12 Triangles as the eye and each light see them, by homogeneous edge functions [Olano & Greer 1997]: for corners h0,
   h1, h2 in ray space, the three (h1 x h2) . (x, y, 1) have one sign where the ray hits the triangle, even with corners
   behind the eye, so nothing is ever clipped. A sign that round-off may have changed is determined exactly: the corners
   are moved so that the ray is at (0, 0), which leaves a difference of two products; where that is 0, the ray is moved
   by (e, e^2) for an infinitesimal e > 0. All of this depends only on the ray and the edge's two corners, and changes
   sign when they are swapped. So triangles that share corners neither leave gaps nor overlap, not even for a ray
   through an edge or a corner. Cost: triangles times rows of tiles to cull, then three edge functions per pixel of a
   triangle's bounding box, whose rows the rasteriser first narrows to the edges. */

typedef struct spsi_face {
    double position[3][3]; /* in the world */
    float normal[3][3], color[3][3];
    float transmittance[3]; /* all 0: opaque */
    float rounding;         /* maximum error of its corners, which are floats in their mesh */
} spsi_face;

/* Optical depth of a face to light of all colors, for transmittance maps. */
static float spsi_face_optical_depth(const spsi_face *face) {
    const float mean = (face->transmittance[0] + face->transmittance[1] + face->transmittance[2]) / 3;
    return mean > 0 ? -logf(mean) : SPSI_DEPTH_MAX;
}

static int spsi_face_is_translucent(const spsi_face *face) { return !spsi_black(face->transmittance); }

typedef struct spsi_hit {
    float depth; /* t - depth_reference; infinity: nothing */
    int face;
    float weights[2]; /* of corners 1 and 2 */
} spsi_hit;

/* What shade_fn needs to know of a face, in addition. */
typedef struct spsi_face_texture {
    float uv[3][2];
    uint32_t number; /* of the triangle in its mesh: those without area are no faces */
} spsi_face_texture;

/* The faces of a mesh, which follow those of the mesh before it. */
typedef struct spsi_mesh_faces {
    int end;      /* of its faces in the list */
    int textures; /* of a mesh that has a shade_fn: index of its first face's texture, minus that of the face */
} spsi_mesh_faces;

typedef struct spsi_faces {
    const spsi_face *list;
    int count;
    double extent; /* largest absolute coordinate */
    spsi_tree tree;
    const spsi_face_texture *textures; /* of the faces of all meshes that have a shade_fn; NULL: none has */
    const spsi_mesh_faces *meshes;     /* per mesh; NULL likewise */
} spsi_faces;

/* Checks a triangle's colors, normals and texture coordinates, and its corners' positions in the world. */
static sps_result spsi_triangle_check(sps_context *context, const sps_triangle *t, const spsi_mesh *mesh, size_t number,
                                      double world[3][3]) {
    const char *names[] = {"position", "normal", "color", "uv"};
    const char *rules[] = {"in the world it must be within 1e15", "it must be finite", "it must be 0..1",
                           "it must be finite"};
    char field[64];
    int wrong = -1;
    double value = 0;
    for (int i = 0; i < 9 && wrong < 0; ++i) {
        const float local[3] = {t->position[i / 3][i % 3], t->normal[i / 3][i % 3], t->color[i / 3][i % 3]};
        if (spsi_bad_coordinate(&world[i / 3][i % 3], 1)) wrong = 0;
        if (mesh->has_normals && !(fabsf(local[1]) <= FLT_MAX)) wrong = 1;
        if (mesh->has_colors && !(local[2] >= 0 && local[2] <= 1)) wrong = 2;
        if (wrong >= 0) value = wrong == 0 ? world[i / 3][i % 3] : (double)local[wrong];
    }
    for (int i = 0; i < 6 && mesh->shade_fn && wrong < 0; ++i)
        if (!(fabsf(t->uv[i / 2][i % 2]) <= FLT_MAX)) wrong = 3, value = (double)t->uv[i / 2][i % 2];
    if (wrong < 0) return SPS_OK;
    for (int i = 0; i < 9 && wrong == 0; ++i) /* a NaN spreads to other components on its way into the world */
        if (!(fabsf(t->position[i / 3][i % 3]) <= FLT_MAX)) value = (double)t->position[i / 3][i % 3];
    SPS_SNPRINTF(field, sizeof field, "triangle[%.0f].%s", (double)number, names[wrong]);
    return spsi_fail_field(context, SPS_ERROR_DATA, SPS_OBJECT_MESH, mesh->index, field, value, rules[wrong]);
}

/* World position of a local one; equal corners get equal bits. */
static void spsi_to_world(const sps_placement *placement, const float local[3], double world[3]) {
    memcpy(world, placement->origin, sizeof placement->origin);
    for (int i = 0; i < 9; ++i)
        world[i % 3] = spsi_multiply_add(placement->axis[i / 3][i % 3], (double)local[i / 3], world[i % 3]);
}

/* Corner normals in the world, or the triangle's own. They are transformed by the placement's cofactors, so that they
   stay perpendicular to the surface under any affine map. */
static void spsi_face_normals(const spsi_mesh *mesh, const sps_triangle *triangle, const double own[3],
                              spsi_face *face) {
    const sps_placement *placement = &mesh->placement;
    double cofactors[3][3];
    for (int i = 0; i < 3; ++i) spsi_cross(placement->axis[(i + 1) % 3], placement->axis[(i + 2) % 3], cofactors[i]);
    for (int corner = 0; corner < 3; ++corner) {
        double n[3] = {0, 0, 0};
        for (int i = 0; i < 3 && mesh->has_normals; ++i)
            spsi_along(n, cofactors[i], (double)triangle->normal[corner][i], n);
        if (!spsi_normalise(n)) memcpy(n, own, sizeof n);
        for (int i = 0; i < 3; ++i) face->normal[corner][i] = (float)n[i];
    }
}

/* Turns one triangle into a face; returns 0 if it has no area. */
static int spsi_face_from_triangle(const spsi_mesh *mesh, const sps_triangle *triangle, double world[3][3],
                                   const spsi_frame *frame, spsi_face *face) {
    double u[3], v[3], own[3], reach = 0;
    spsi_along(world[1], world[0], -1, u);
    spsi_along(world[2], world[0], -1, v);
    spsi_cross(u, v, own);
    if (!spsi_normalise(own)) return 0;
    for (int corner = 0; corner < 3; ++corner) {
        spsi_bounds_add(&frame->content->mesh_bounds, world[corner]);
        for (int i = 0; i < 3; ++i) {
            face->position[corner][i] = world[corner][i];
            face->color[corner][i] = mesh->has_colors ? triangle->color[corner][i] : mesh->color[i];
            reach = fmax(reach, fabs(world[corner][i] - mesh->placement.origin[i]));
        }
    }
    memcpy(face->transmittance, mesh->transmittance, sizeof face->transmittance);
    face->rounding = (float)(reach * (double)FLT_EPSILON);
    spsi_face_normals(mesh, triangle, own, face);
    return 1;
}

/* Depths at a vector of pixels, clamped to the image's edge; infinity without hits. */
static inline spsi_v spsi_hit_depths(const spsi_hit *hits, int width, int height, int x, int y) {
    const int row = spsi_least(spsi_most(y, 0), height - 1);
    float depth[SPSI_LANES];
    if (!hits) return spsi_set(SPSI_INFINITY);
    for (int i = 0; i < SPSI_LANES; ++i)
        depth[i] = hits[(size_t)row * (size_t)width + (size_t)spsi_least(spsi_most(x + i, 0), width - 1)].depth;
    return spsi_load(depth);
}

#define SPSI_TRIANGLE_BATCH 256 /* triangles read at a time */

/* Where faces go while they are read. */
typedef struct spsi_face_lists {
    spsi_face *faces;
    spsi_face_texture *textures; /* NULL: no mesh has a shade_fn */
    spsi_mesh_faces *meshes;     /* NULL likewise */
    int face_count, texture_count;
} spsi_face_lists;

/* Adds a triangle, unless it has no area. */
static void spsi_face_add(const spsi_frame *frame, const spsi_mesh *mesh, const sps_triangle *triangle, size_t number,
                          double world[3][3], spsi_face_lists *lists) {
    if (!spsi_face_from_triangle(mesh, triangle, world, frame, &lists->faces[lists->face_count])) return;
    lists->face_count += 1;
    if (!mesh->shade_fn) return;
    memcpy(lists->textures[lists->texture_count].uv, triangle->uv, sizeof triangle->uv);
    lists->textures[lists->texture_count].number = (uint32_t)number;
    lists->texture_count += 1;
}

static sps_result spsi_gather_mesh(sps_context *context, const spsi_frame *frame, const spsi_mesh *mesh,
                                   spsi_face_lists *lists) {
    sps_triangle *triangles =
        (sps_triangle *)spsi_reserve(context, SPSI_BUFFER_BLOCK, SPSI_TRIANGLE_BATCH, sizeof(sps_triangle));
    if (!triangles) return context->result;
    for (size_t first = 0; first < mesh->triangle_count; first += SPSI_TRIANGLE_BATCH) {
        const size_t left = mesh->triangle_count - first,
                     count = left < SPSI_TRIANGLE_BATCH ? left : SPSI_TRIANGLE_BATCH;
        int returned;
        memset(triangles, 0, count * sizeof(sps_triangle));
        context->stats.triangle_calls += 1;
        returned = mesh->read_fn(mesh->user, first, count, triangles);
        if (returned)
            return spsi_fail_field(context, SPS_ERROR_CALLBACK, SPS_OBJECT_MESH, mesh->index, "read_fn", returned,
                                   NULL);
        for (size_t i = 0; i < count; ++i) {
            double world[3][3];
            for (int k = 0; k < 3; ++k) spsi_to_world(&mesh->placement, triangles[i].position[k], world[k]);
            if (spsi_triangle_check(context, &triangles[i], mesh, first + i, world)) return context->result;
            spsi_face_add(frame, mesh, &triangles[i], first + i, world, lists);
        }
    }
    return SPS_OK;
}

/* A hash of everything that determines which faces are held; 0 if a mesh has no revision. */
static uint64_t spsi_meshes_fingerprint(const spsi_frame *frame) {
    uint64_t hash = SPSI_FINGERPRINT_START;
    for (int i = 0; i < frame->meshes.count; ++i) {
        const spsi_mesh *mesh = &frame->meshes.list[i];
        const int textured = mesh->shade_fn != NULL;
        if (mesh->revision == 0) return 0;
        hash = spsi_fingerprint(hash, &mesh->triangle_count, sizeof mesh->triangle_count);
        hash = spsi_fingerprint(hash, &mesh->read_fn, sizeof mesh->read_fn);
        hash = spsi_fingerprint(hash, &mesh->user, sizeof mesh->user);
        hash = spsi_fingerprint(hash, &mesh->placement, sizeof mesh->placement);
        hash = spsi_fingerprint(hash, mesh->color, sizeof mesh->color);
        hash = spsi_fingerprint(hash, &mesh->has_normals, sizeof mesh->has_normals);
        hash = spsi_fingerprint(hash, &mesh->has_colors, sizeof mesh->has_colors);
        hash = spsi_fingerprint(hash, mesh->transmittance, sizeof mesh->transmittance);
        hash = spsi_fingerprint(hash, &textured, sizeof textured);
        hash = spsi_fingerprint(hash, &mesh->revision, sizeof mesh->revision);
    }
    return hash | 1;
}

/* Whether the faces of all meshes are still held from an earlier call. */
static int spsi_faces_held(const sps_context *context, const spsi_frame *frame) {
    const uint64_t fingerprint = spsi_meshes_fingerprint(frame);
    return fingerprint != 0 && fingerprint == context->faces_held;
}

/* Reserves the lists of faces, and of what shade_fn needs if any mesh has one. */
static sps_result spsi_face_lists_begin(sps_context *context, const spsi_frame *frame, spsi_face_lists *lists) {
    const spsi_meshes *meshes = &frame->meshes;
    memset(lists, 0, sizeof *lists);
    lists->faces = (spsi_face *)spsi_reserve(context, SPSI_BUFFER_FACES, meshes->triangle_count, sizeof(spsi_face));
    if (!lists->faces || meshes->textured_count == 0) return context->result;
    lists->textures = (spsi_face_texture *)spsi_reserve(context, SPSI_BUFFER_FACE_TEXTURES, meshes->textured_count,
                                                        sizeof *lists->textures);
    lists->meshes =
        (spsi_mesh_faces *)spsi_reserve(context, SPSI_BUFFER_MESH_FACES, (size_t)meshes->count, sizeof *lists->meshes);
    return context->result;
}

/* Reads every mesh, once. */
static sps_result spsi_read_faces(sps_context *context, const spsi_frame *frame) {
    spsi_face_lists lists;
    if (spsi_face_lists_begin(context, frame, &lists)) return context->result;
    for (int i = 0; i < frame->meshes.count; ++i) {
        const int textures = lists.texture_count - lists.face_count;
        if (spsi_gather_mesh(context, frame, &frame->meshes.list[i], &lists)) return context->result;
        if (!lists.meshes) continue;
        lists.meshes[i].end = lists.face_count;
        lists.meshes[i].textures = textures;
    }
    context->face_count = lists.face_count;
    memcpy(context->mesh_low, frame->content->mesh_bounds.low, sizeof context->mesh_low);
    memcpy(context->mesh_high, frame->content->mesh_bounds.high, sizeof context->mesh_high);
    return SPS_OK;
}

/* Provides the triangles of all meshes, reading them unless they are still held from an earlier call. */
static sps_result spsi_gather_faces(sps_context *context, const spsi_frame *frame, spsi_faces *faces) {
    memset(faces, 0, sizeof *faces);
    if (frame->meshes.triangle_count == 0) return SPS_OK;
    if (!spsi_faces_held(context, frame)) {
        context->faces_held = 0;
        context->tree_held = 0;
        if (spsi_read_faces(context, frame)) return context->result;
        context->faces_held = spsi_meshes_fingerprint(frame);
    }
    if (!spsi_reserve(context, SPSI_BUFFER_FACE_ROWS, frame->meshes.triangle_count, 4 * sizeof(int)))
        return context->result;
    faces->list = (const spsi_face *)context->buffers[SPSI_BUFFER_FACES].data;
    faces->count = context->face_count;
    if (frame->meshes.textured_count > 0) {
        faces->textures = (const spsi_face_texture *)context->buffers[SPSI_BUFFER_FACE_TEXTURES].data;
        faces->meshes = (const spsi_mesh_faces *)context->buffers[SPSI_BUFFER_MESH_FACES].data;
    }
    memcpy(frame->content->mesh_bounds.low, context->mesh_low, sizeof context->mesh_low);
    memcpy(frame->content->mesh_bounds.high, context->mesh_high, sizeof context->mesh_high);
    for (int i = 0; i < 3; ++i)
        faces->extent = fmax(faces->extent, fmax(fabs(context->mesh_low[i]), fabs(context->mesh_high[i])));
    context->stats.triangles = (uint64_t)faces->count;
    context->stats.triangles_degenerate = (uint64_t)(frame->meshes.triangle_count - (size_t)faces->count);
    return SPS_OK;
}

typedef struct spsi_edges {
    double corner[3][3]; /* in ray space */
    double depth[3];     /* of the corners, t - depth_reference */
    double edge[3][3];   /* edge functions of corner pairs 12, 20, 01; positive inside */
    double rounding[3];  /* upper bounds of their round-off; infinity where the triangle is seen nearly edge-on */
    int side;            /* sign that the edges were multiplied by; 0: it is unknown which side is the inside */
} spsi_edges;

/* Corners in ray space: (x t, y t, t) in perspective, (x, y, 1) otherwise. A corner has the same bits in every triangle
   that shares it. */
static void spsi_face_corners(const spsi_faces *faces, int index, const spsi_rays *rays, spsi_edges *e) {
    for (int i = 0; i < 3; ++i) {
        double offset[3];
        spsi_along(faces->list[index].position[i], rays->origin, -1, offset);
        for (int k = 0; k < 3; ++k) {
            const double *row = rays->inverse[k], first = spsi_multiply_add(row[0], offset[0], 0);
            e->corner[i][k] = spsi_multiply_add(row[2], offset[2], spsi_multiply_add(row[1], offset[1], first));
        }
        e->depth[i] = e->corner[i][2] - rays->depth_reference;
        if (!rays->perspective) e->corner[i][2] = 1;
    }
}

/* The value of an edge is off by at most 5 u of the sum of its products' magnitudes, u = 2^-53, and by 4 u of it where
   corners are moved; 32 u are allowed for both. The determinant is the sum of the edges' values at any ray, each times
   its corner's t. */
static void spsi_face_edges(const spsi_faces *faces, int index, const spsi_rays *rays, spsi_edges *e) {
    double determinant = 0, rounding = 0, most[3][2];
    spsi_face_corners(faces, index, rays, e);
    for (int i = 0; i < 3; ++i) {
        const double t = fabs(e->corner[i][2]);
        most[i][0] = fabs(e->corner[i][0]) + rays->width * t;
        most[i][1] = fabs(e->corner[i][1]) + rays->height * t;
    }
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        spsi_cross(e->corner[j], e->corner[k], e->edge[i]);
        e->rounding[i] = 3.6e-15 * (most[j][0] * most[k][1] + most[j][1] * most[k][0]);
        determinant += e->corner[i][2] * e->edge[i][2];
        rounding += 2 * fabs(e->corner[i][2]) * e->rounding[i];
    }
    e->side = (determinant > rounding) - (determinant < -rounding);
    for (int i = 0; i < 9; ++i) e->edge[i / 3][i % 3] *= e->side < 0 ? -1 : 1;
    for (int i = 0; i < 3 && e->side == 0; ++i) e->rounding[i] = HUGE_VAL;
}

/* Pixels that a face may cover: x0, y0, x1, y1 inclusive; x1 < x0 for none. Where a face crosses the eye's plane, its
   part in front reaches from the corners there to infinity, on the side where an edge crosses. */
static void spsi_face_box(const spsi_faces *faces, int index, const spsi_rays *rays, int box[4]) {
    const int last[2] = {rays->width - 1, rays->height - 1};
    spsi_edges e;
    spsi_face_corners(faces, index, rays, &e);
    for (int k = 0; k < 2; ++k) {
        double low = HUGE_VAL, high = -HUGE_VAL;
        for (int i = 0; i < 3; ++i) {
            const double *a = e.corner[i], *b = e.corner[(i + 1) % 3];
            if (a[2] > 0) {
                low = spsi_minimum(a[k] / a[2], low);
                high = spsi_maximum(a[k] / a[2], high);
            }
            if ((a[2] > 0) != (b[2] > 0)) { /* the edge crosses t = 0, on the side of this sign */
                const double side = (a[2] > 0 ? 1 : -1) * (b[k] * a[2] - a[k] * b[2]);
                const double rounding = 1e-12 * (fabs(b[k] * a[2]) + fabs(a[k] * b[2]));
                if (!(side > rounding)) low = -HUGE_VAL;
                if (!(side < -rounding)) high = HUGE_VAL;
            }
        }
        box[k] = (int)ceil(spsi_minimum(spsi_maximum(low - 1e-6, 0), last[k] + 1));
        box[k + 2] = (int)floor(spsi_maximum(spsi_minimum(high + 1e-6, last[k]), -1));
    }
}

/* The exact sign of an edge's value; 0 where the edge is seen end-on, since its triangle is then seen edge-on. */
static int spsi_edge_sign(const double from[3], const double to[3], double x, double y) {
    double a[2], b[2];
    int sign;
    a[0] = spsi_multiply_add(-x, from[2], from[0]);
    a[1] = spsi_multiply_add(-y, from[2], from[1]);
    b[0] = spsi_multiply_add(-x, to[2], to[0]);
    b[1] = spsi_multiply_add(-y, to[2], to[1]);
    sign = spsi_sign_of_difference(a[0], b[1], a[1], b[0]);
    if (sign == 0) sign = spsi_sign_of_difference(a[1], to[2], from[2], b[1]); /* as x grows */
    if (sign == 0) sign = spsi_sign_of_difference(from[2], b[0], a[0], to[2]); /* as y grows */
    return sign;
}

/* Whether all edges have the same exact sign. */
static int spsi_face_hit_exactly(const spsi_edges *e, double x, double y) {
    int side = e->side;
    for (int i = 0; i < 3; ++i) {
        const int sign = spsi_edge_sign(e->corner[(i + 1) % 3], e->corner[(i + 2) % 3], x, y);
        if (sign == 0 || sign == -side) return 0;
        side = sign;
    }
    return 1;
}

/* Barycentric weights of the point where a pixel's ray hits the triangle; returns 0 if it misses. A triangle seen
   nearly edge-on may be hit behind the eye. */
static inline int spsi_face_hit(const spsi_edges *e, double x, double y, double weights[3]) {
    double sum = 0;
    int certain = 1;
    for (int i = 0; i < 3; ++i) {
        const double value = e->edge[i][0] * x + e->edge[i][1] * y + e->edge[i][2];
        if (value < -e->rounding[i]) return 0;
        certain &= value > e->rounding[i];
        weights[i] = fabs(value);
        sum += weights[i];
    }
    if (!certain && !spsi_face_hit_exactly(e, x, y)) return 0;
    if (!(sum > 0)) weights[0] = weights[1] = weights[2] = 1, sum = 3; /* the ray lies in its plane: any point of it */
    for (int i = 0; i < 3; ++i) weights[i] /= sum;
    return 1;
}

/* Narrows x0 .. x1 to the pixels of row y whose rays may hit the triangle, plus at most one at each end. */
static void spsi_face_span(const spsi_edges *e, int y, int *x0, int *x1) {
    for (int i = 0; i < 3 && *x1 - *x0 > 8; ++i) { /* for fewer, testing pixels is cheaper than dividing */
        const double slope = e->edge[i][0], value = e->edge[i][1] * y + e->edge[i][2] + e->rounding[i];
        if (slope > 0) *x0 = (int)fmin(fmax(*x0, -value / slope - 1), *x1 + 1);
        if (slope < 0) *x1 = (int)fmax(fmin(*x1, -value / slope + 1), *x0 - 1);
    }
}

typedef struct spsi_raster {
    const spsi_faces *faces;
    const spsi_rays *rays;
    int *boxes;     /* four per face */
    spsi_hit *hits; /* per pixel of the eye; NULL for a light */
    float *depths;  /* per texel of a light: depth of the nearest triangle; NULL for the eye */
    int *numbers;   /* per texel of a light: number of the nearest triangle, -1: none */
    int pitch;      /* pixels from one row to the next */
    int first_row;  /* that the lists above begin with */
} spsi_raster;

static void spsi_raster_box_task(void *data, int index, int worker) {
    const spsi_raster *raster = (const spsi_raster *)data;
    const int end = spsi_batch_end(index, raster->faces->count);
    (void)worker;
    for (int i = index * SPSI_BATCH; i < end; ++i) spsi_face_box(raster->faces, i, raster->rays, raster->boxes + 4 * i);
}

/* Depth and barycentric weights of the point where a pixel's ray hits a face; returns 0 if it misses, or before the
   near plane. */
static inline int spsi_face_depth(const spsi_edges *e, const spsi_rays *rays, int x, int y, double w[3], float *depth) {
    double t;
    if (!spsi_face_hit(e, x, y, w)) return 0;
    t = w[0] * e->depth[0] + w[1] * e->depth[1] + w[2] * e->depth[2];
    if (!(t + rays->depth_reference > rays->near_depth)) return 0;
    *depth = (float)t;
    return 1;
}

/* Rasterises an opaque face. */
static void spsi_raster_face(const spsi_raster *raster, int face, int y0, int y1) {
    const int *box = raster->boxes + 4 * face;
    spsi_edges e;
    if (spsi_face_is_translucent(&raster->faces->list[face])) return;
    spsi_face_edges(raster->faces, face, raster->rays, &e);
    for (int y = spsi_most(y0, box[1]); y <= spsi_least(y1, box[3]); ++y) {
        int x0 = box[0], x1 = box[2];
        spsi_face_span(&e, y, &x0, &x1);
        for (int x = x0; x <= x1; ++x) {
            const size_t at = (size_t)(y - raster->first_row) * (size_t)raster->pitch + (size_t)x;
            double w[3];
            float depth;
            if (!spsi_face_depth(&e, raster->rays, x, y, w, &depth)) continue;
            if (raster->depths) {
                if (!(depth < raster->depths[at])) continue;
                raster->depths[at] = depth;
                raster->numbers[at] = face;
            } else if (depth < raster->hits[at].depth) {
                const spsi_hit hit = {depth, face, {(float)w[1], (float)w[2]}};
                raster->hits[at] = hit;
            }
        }
    }
}

/* Whether a face may reach into rows y0 to y1. */
static inline int spsi_raster_reaches(const spsi_raster *raster, int face, int y0, int y1) {
    const int *box = raster->boxes + 4 * face;
    return box[2] >= box[0] && box[1] <= y1 && box[3] >= y0;
}

/* Clears one band of rows, then rasterises every face that reaches into it, in order. */
static void spsi_raster_band_task(void *data, int index, int worker) {
    const spsi_raster *raster = (const spsi_raster *)data;
    const int y0 = index * SPSI_TILE_HEIGHT, y1 = spsi_least(raster->rays->height, y0 + SPSI_TILE_HEIGHT) - 1;
    const spsi_hit nothing = {SPSI_INFINITY, -1, {0, 0}};
    const size_t first = (size_t)y0 * (size_t)raster->pitch, end = (size_t)(y1 + 1) * (size_t)raster->pitch;
    (void)worker;
    for (size_t i = first; i < end && !raster->depths; ++i) raster->hits[i] = nothing;
    for (size_t i = first; i < end && raster->depths; ++i) {
        raster->depths[i] = SPSI_INFINITY;
        raster->numbers[i] = -1;
    }
    for (int face = 0; face < raster->faces->count; ++face)
        if (spsi_raster_reaches(raster, face, y0, y1)) spsi_raster_face(raster, face, y0, y1);
}

/* Prepares to rasterise faces. */
static void spsi_raster_begin(sps_context *context, const spsi_faces *faces, const spsi_rays *rays,
                              spsi_raster *raster) {
    memset(raster, 0, sizeof *raster);
    raster->faces = faces;
    raster->rays = rays;
    raster->boxes = (int *)context->buffers[SPSI_BUFFER_FACE_ROWS].data;
    raster->pitch = rays->width;
    spsi_parallel_batches(context, faces->count, spsi_raster_box_task, raster);
}

/* Rasterises all opaque faces: for the eye into `hits`, for a light into `depths` and `numbers`. */
static void spsi_rasterise(sps_context *context, const spsi_faces *faces, const spsi_rays *rays, spsi_hit *hits,
                           float *depths, int *numbers) {
    spsi_raster raster;
    spsi_raster_begin(context, faces, rays, &raster);
    raster.hits = hits;
    raster.depths = depths;
    raster.numbers = numbers;
    spsi_parallel(context, spsi_tile_rows(rays), spsi_raster_band_task, &raster);
}

/* --- the surface at a pixel --- */

/* The point of a polygon that one pixel's ray hits. */
typedef struct spsi_surface {
    double point[3];
    double start[3];  /* origin of rays to lights: off the facet where the mesh is smooth */
    double normal[3]; /* for shading, turned towards the eye, not normalised */
    double pixel;     /* world size of a pixel there */
} spsi_surface;

/* The point of the face's plane on a pixel's ray; where the ray grazes the plane, the rasterised point projected onto
   it. The rasteriser's float depth alone is too coarse: in grazing light the point would lie behind the plane. */
static void spsi_surface_place(const spsi_face *face, const double plane[3], const double ray[3],
                               const double rasterised[3], double point[3]) {
    const double facing = spsi_dot(plane, ray), grazing = 1e-16; /* squared cosine below which a float is better */
    double offset[3], way;
    spsi_along(face->position[0], rasterised, -1, offset);
    way = spsi_dot(plane, offset);
    if (facing * facing > grazing * spsi_dot(plane, plane) * spsi_dot(ray, ray))
        spsi_along(rasterised, ray, way / facing, point);
    else
        spsi_along(rasterised, plane, way / spsi_dot(plane, plane), point);
}

/* Origin of rays to lights on a mesh with normals of its own: raised from the facet to the surface that the normals
   describe, so that neighbouring facets do not shadow what shading shows as lit [Hanika 2021, "Hacking the Shadow
   Terminator"]. Round-off in a flat mesh's normals raises nothing. */
static void spsi_surface_raise(const spsi_face *face, const double weights[3], const double plane[3], int turned,
                               spsi_surface *surface) {
    const double side = turned ? -1 : 1; /* the side of the plane that the eye is on */
    for (int corner = 0; corner < 3; ++corner) {
        double normal[3], offset[3], below, room = 0;
        for (int i = 0; i < 3; ++i) {
            normal[i] = (double)face->normal[corner][i];
            offset[i] = surface->point[i] - face->position[corner][i];
            room += fabs(offset[i]) * 2 * (double)FLT_EPSILON;
        }
        if (side * spsi_dot(normal, plane) < 0)
            for (int i = 0; i < 3; ++i) normal[i] = -normal[i];
        below = fmin(0, spsi_dot(normal, offset) + room);
        spsi_along(surface->start, normal, -weights[corner] * below, surface->start);
    }
}

/* Weights of a face's corners at a hit. */
static void spsi_hit_weights(const spsi_hit *hit, double weights[3]) {
    weights[0] = 1.0 - (double)hit->weights[0] - (double)hit->weights[1];
    weights[1] = (double)hit->weights[0];
    weights[2] = (double)hit->weights[1];
}

static int spsi_face_is_flat(const spsi_face *face) {
    return memcmp(face->normal[0], face->normal[1], sizeof face->normal[0]) == 0 &&
           memcmp(face->normal[0], face->normal[2], sizeof face->normal[0]) == 0;
}

static void spsi_surface_at(const spsi_rays *eye, const spsi_faces *faces, const spsi_hit *hit, double x, double y,
                            spsi_surface *surface) {
    const spsi_face *face = &faces->list[hit->face];
    double w[3], u[3], v[3], plane[3], ray[3], rasterised[3];
    int turned;
    spsi_along(face->position[1], face->position[0], -1, u);
    spsi_along(face->position[2], face->position[0], -1, v);
    spsi_cross(u, v, plane);
    spsi_ray_direction(eye, x, y, ray);
    spsi_ray_point(eye, x, y, (double)hit->depth + eye->depth_reference, rasterised);
    spsi_surface_place(face, plane, ray, rasterised, surface->point);
    surface->pixel = spsi_pixel_size_at(eye, (double)hit->depth + eye->depth_reference);
    memcpy(surface->start, surface->point, sizeof surface->start);
    turned = spsi_dot(plane, ray) > 0;
    for (int i = 0; i < 3; ++i) surface->normal[i] = (double)face->normal[0][i];
    if (!spsi_face_is_flat(face)) {
        spsi_hit_weights(hit, w);
        for (int i = 0; i < 3; ++i)
            surface->normal[i] = w[0] * (double)face->normal[0][i] + w[1] * (double)face->normal[1][i] +
                                 w[2] * (double)face->normal[2][i];
        spsi_surface_raise(face, w, plane, turned, surface);
        if (!(spsi_dot(surface->normal, surface->normal) > 0)) memcpy(surface->normal, plane, sizeof plane);
    }
    if ((spsi_dot(surface->normal, plane) < 0) != turned)
        for (int i = 0; i < 3; ++i) surface->normal[i] = -surface->normal[i];
}

/* Reflectance of a face by itself. Where corners have the same color, so has the face, to the bit. */
static void spsi_face_color(const spsi_face *face, const spsi_hit *hit, double color[3]) {
    for (int c = 0; c < 3; ++c) {
        const double first = (double)face->color[0][c];
        color[c] = first + (double)hit->weights[0] * ((double)face->color[1][c] - first) +
                   (double)hit->weights[1] * ((double)face->color[2][c] - first);
    }
}

/* The mesh that a face belongs to. Cost: a binary search. */
static int spsi_mesh_of(const spsi_frame *frame, const spsi_faces *faces, int face) {
    int low = 0, high = frame->meshes.count - 1;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (face < faces->meshes[middle].end)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

/* ============================================================================================== >>layers
   13 What a pixel shows besides one opaque polygon: translucent ones in front of it, and where edges are sampled, the
   polygons on both sides of an edge. Each is a fragment with a mask of the samples that see it [Carpenter 1984].
   Fragments become layers by following every sample's light past them, from the eye on:
       seen   = mean over samples of (mask) * (transmittance before),   what of its radiance the pixel shows
       behind = mean over samples of (transmittance behind),            what of anything behind it
   so that shading, which knows nothing of samples, composites gas and layers in order of depth. Gas is not sampled: it
   lies before or behind a layer as a whole. Cost: translucent faces, or all at N x N times the pixels where edges are
   sampled, are rasterised twice, to count fragments and to list them; 24 bytes per fragment, 56 per layer. */

typedef struct spsi_fragment {
    uint64_t mask; /* bits: samples, in rows */
    float depth;   /* their mean, t - depth_reference */
    int face;      /* that one of them sees */
    int sample;    /* its bit */
} spsi_fragment;

typedef struct spsi_layer {
    spsi_hit hit;    /* its depth is the mean of what it covers */
    float at[2];     /* where it is shaded, from the pixel's centre, in pixels */
    float seen[3];   /* share of its radiance that the pixel shows, where there is no gas */
    float behind[3]; /* the same of anything behind it, and behind all layers in front of it */
    float covered;   /* share of what is behind that it covers: a mean of colors */
    uint32_t pixel;
} spsi_layer;

/* Layers of all pixels, in order of depth. */
typedef struct spsi_layers {
    const uint32_t *first; /* of a pixel's; those of the next pixel follow them. NULL: there are none */
    const spsi_layer *list;
    size_t count;
} spsi_layers;

#define SPSI_LAYER_ROWS 8 /* rows of pixels of a task */

/* A worker's scratch memory: the samples of a band. */
typedef struct spsi_layer_scratch {
    float *depths;   /* of the nearest opaque face */
    int *numbers;    /* its number */
    uint64_t *masks; /* per pixel of a row: samples that see one face */
    double *sums;    /* of these samples' depths */
} spsi_layer_scratch;

typedef struct spsi_layers_job {
    const spsi_frame *frame;
    const spsi_faces *faces;
    const spsi_rays *rays; /* of pixels */
    spsi_rays fine;        /* of their samples */
    spsi_raster raster;    /* of the fine rays */
    int samples;           /* along a side of a pixel */
    spsi_hit *hits;        /* opaque faces at pixels' centres, which hide what is behind; NULL: nothing does */
    char *scratch;         /* of all workers */
    uint32_t *first;       /* number of fragments, then where they begin; see spsi_layers_sum */
    spsi_fragment *fragments;
    spsi_layer *layers;
    int listing; /* 0: counts fragments, 1: lists them */
} spsi_layers_job;

static size_t spsi_layer_scratch_bytes(const spsi_rays *eye, int samples) {
    const size_t row = (size_t)eye->width, fine = row * SPSI_LAYER_ROWS * (size_t)(samples * samples);
    return row * (sizeof(uint64_t) + sizeof(double)) + (samples > 1 ? fine * (sizeof(float) + sizeof(int)) : 0);
}

static void spsi_layer_scratch_of(const spsi_layers_job *job, int worker, spsi_layer_scratch *scratch) {
    const spsi_rays *eye = job->rays;
    const size_t fine = (size_t)eye->width * SPSI_LAYER_ROWS * (size_t)(job->samples * job->samples);
    char *memory = job->scratch + (size_t)worker * spsi_layer_scratch_bytes(eye, job->samples);
    scratch->masks = (uint64_t *)(void *)memory;
    scratch->sums = (double *)(void *)(scratch->masks + eye->width);
    scratch->depths = (float *)(void *)(scratch->sums + eye->width);
    scratch->numbers = (int *)(void *)(scratch->depths + fine);
}

/* Counts a fragment of a pixel, or lists it. Entry p + 2 counts the fragments of pixel p; summed up, entry p + 1 is
   where they begin, and where they end once they are listed. */
static void spsi_fragment_add(const spsi_layers_job *job, size_t pixel, const spsi_fragment *fragment) {
    if (job->listing)
        job->fragments[job->first[pixel + 1]++] = *fragment;
    else
        job->first[pixel + 2] += 1;
}

static int spsi_bit_count(uint64_t mask) {
    int count = 0;
    for (; mask; mask &= mask - 1) count += 1;
    return count;
}

/* The sample among those of a mask that is nearest to their mean. */
static int spsi_mask_middle(uint64_t mask, int samples) {
    int sum[2] = {0, 0}, count = 0, least = 0x7fffffff, best = 0;
    for (int i = 0; i < samples * samples; ++i)
        if (mask >> i & 1) sum[0] += i % samples, sum[1] += i / samples, count += 1;
    for (int i = 0; i < samples * samples; ++i) {
        const int x = i % samples * count - sum[0], y = i / samples * count - sum[1];
        if (!(mask >> i & 1) || x * x + y * y >= least) continue;
        least = x * x + y * y;
        best = i;
    }
    return best;
}

/* --- fragments of translucent faces --- */

/* Adds the samples of one row that see a face to the masks. `seen` receives the range of its pixels. */
static void spsi_pane_row(const spsi_layers_job *job, const spsi_layer_scratch *scratch, const spsi_edges *e, int face,
                          int y, int seen[2]) {
    const int n = job->samples, *box = job->raster.boxes + 4 * face, width = job->fine.width;
    const int row = y % (n * SPSI_LAYER_ROWS);
    int x0 = box[0], x1 = box[2];
    spsi_face_span(e, y, &x0, &x1);
    for (int x = x0; x <= x1; ++x) {
        double w[3];
        float depth, ends = SPSI_INFINITY;
        if (n > 1) ends = scratch->depths[(size_t)row * (size_t)width + (size_t)x];
        if (n == 1 && job->hits) ends = job->hits[(size_t)y * (size_t)width + (size_t)x].depth;
        if (!spsi_face_depth(e, &job->fine, x, y, w, &depth) || !(depth < ends)) continue;
        scratch->masks[x / n] |= UINT64_C(1) << (y % n * n + x % n);
        scratch->sums[x / n] += (double)depth;
        seen[0] = spsi_least(seen[0], x / n);
        seen[1] = spsi_most(seen[1], x / n);
    }
}

/* Adds a face's fragments in one row of pixels. */
static void spsi_pane_fragments(const spsi_layers_job *job, const spsi_layer_scratch *scratch, const spsi_edges *e,
                                int face, int y) {
    const int n = job->samples, *box = job->raster.boxes + 4 * face;
    int seen[2] = {0x7fffffff, -1};
    for (int row = spsi_most(y * n, box[1]); row <= spsi_least(y * n + n - 1, box[3]); ++row)
        spsi_pane_row(job, scratch, e, face, row, seen);
    for (int x = seen[0]; x <= seen[1]; ++x) {
        spsi_fragment fragment = {scratch->masks[x], 0, face, 0};
        if (!fragment.mask) continue;
        fragment.sample = spsi_mask_middle(fragment.mask, n);
        fragment.depth = (float)(scratch->sums[x] / spsi_bit_count(fragment.mask));
        spsi_fragment_add(job, (size_t)y * (size_t)job->rays->width + (size_t)x, &fragment);
        scratch->masks[x] = 0;
        scratch->sums[x] = 0;
    }
}

/* --- fragments of opaque faces, where edges are sampled --- */

/* One of the opaque surfaces that a pixel's samples see: faces that look alike there. */
typedef struct spsi_group {
    uint64_t mask;
    int face, sample; /* the first that was found */
    float depth;      /* there */
    spsi_surface surface;
    double color[3];
} spsi_group;

#define SPSI_GROUP_COSINE 0.97       /* of the angle between normals: 14 degrees */
#define SPSI_GROUP_COLOR  (1 / 64.0) /* difference of colors */
#define SPSI_GROUP_DEPTH  0.5        /* of a pixel's size: distance from the plane, along the ray */

/* Describes what one sample sees. */
static void spsi_group_begin(const spsi_layers_job *job, int face, float depth, int x, int y, spsi_group *group) {
    spsi_edges e;
    spsi_hit hit;
    double w[3] = {1, 0, 0};
    spsi_face_edges(job->faces, face, &job->fine, &e);
    spsi_face_hit(&e, x, y, w);
    hit.depth = depth;
    hit.face = face;
    hit.weights[0] = (float)w[1];
    hit.weights[1] = (float)w[2];
    spsi_surface_at(&job->fine, job->faces, &hit, x, y, &group->surface);
    spsi_normalise(group->surface.normal);
    spsi_face_color(&job->faces->list[face], &hit, group->color);
    group->face = face;
    group->depth = depth;
    group->mask = 0;
}

/* Whether shading one of two samples stands for both: they lie on one surface, and look alike. */
static int spsi_groups_agree(const spsi_layers_job *job, const spsi_group *a, const spsi_group *b) {
    const spsi_face *face = &job->faces->list[a->face];
    double u[3], v[3], plane[3], offset[3], size;
    if (a->face == b->face) return 1;
    for (int c = 0; c < 3; ++c)
        if (fabs(a->color[c] - b->color[c]) > SPSI_GROUP_COLOR) return 0;
    if (spsi_dot(a->surface.normal, b->surface.normal) < SPSI_GROUP_COSINE) return 0;
    if (job->faces->meshes &&
        spsi_mesh_of(job->frame, job->faces, a->face) != spsi_mesh_of(job->frame, job->faces, b->face))
        return 0;
    spsi_along(face->position[1], face->position[0], -1, u);
    spsi_along(face->position[2], face->position[0], -1, v);
    spsi_cross(u, v, plane);
    spsi_along(b->surface.point, a->surface.point, -1, offset);
    size = SPSI_GROUP_DEPTH * job->samples * fmax(a->surface.pixel, b->surface.pixel);
    return fabs(spsi_dot(plane, offset)) <= size * spsi_length(plane);
}

/* Sorts the samples of a pixel into groups. Returns their number. */
static int spsi_groups_of(const spsi_layers_job *job, const spsi_layer_scratch *scratch, int x, int y,
                          spsi_group *groups) {
    const int n = job->samples;
    int count = 0, last = -1, group = 0;
    for (int i = 0; i < n * n; ++i) {
        const int sx = x * n + i % n, sy = y * n + i / n;
        const size_t at = (size_t)(sy % (n * SPSI_LAYER_ROWS)) * (size_t)job->fine.width + (size_t)sx;
        const int face = scratch->numbers[at];
        if (face < 0) continue;
        if (face != last) {
            spsi_group *next = &groups[count];
            spsi_group_begin(job, face, scratch->depths[at], sx, sy, next);
            next->sample = i;
            for (group = 0; group < count && !spsi_groups_agree(job, &groups[group], next);) group += 1;
            count += group == count;
            last = face;
        }
        groups[group].mask |= UINT64_C(1) << i;
    }
    return count;
}

/* Whether one group is all of a pixel and looks like what its centre sees: then that alone is shaded. */
static int spsi_group_is_all(const spsi_layers_job *job, const spsi_group *group, int x, int y) {
    const int n = job->samples;
    const spsi_hit *hit = &job->hits[(size_t)y * (size_t)job->rays->width + (size_t)x];
    const uint64_t all = n < 8 ? (UINT64_C(1) << n * n) - 1 : ~UINT64_C(0);
    spsi_group centre;
    if (group->mask != all || hit->face < 0) return 0;
    if (hit->face == group->face) return 1;
    spsi_surface_at(job->rays, job->faces, hit, x, y, &centre.surface);
    spsi_normalise(centre.surface.normal);
    spsi_face_color(&job->faces->list[hit->face], hit, centre.color);
    centre.face = hit->face;
    return spsi_groups_agree(job, group, &centre);
}

/* Adds a group's fragment. Its place is the sample in the middle of it. */
static void spsi_group_add(const spsi_layers_job *job, const spsi_layer_scratch *scratch, const spsi_group *group,
                           int x, int y, float *deepest) {
    const int n = job->samples;
    spsi_fragment fragment = {group->mask, 0, 0, spsi_mask_middle(group->mask, n)};
    double sum = 0;
    for (int i = 0; i < n * n; ++i) {
        const size_t at =
            (size_t)((y * n + i / n) % (n * SPSI_LAYER_ROWS)) * (size_t)job->fine.width + (size_t)(x * n + i % n);
        if (group->mask >> i & 1) sum += (double)scratch->depths[at];
        if (i == fragment.sample) fragment.face = scratch->numbers[at];
    }
    fragment.depth = (float)(sum / spsi_bit_count(group->mask));
    *deepest = fragment.depth > *deepest ? fragment.depth : *deepest;
    spsi_fragment_add(job, (size_t)y * (size_t)job->rays->width + (size_t)x, &fragment);
}

/* Whether all samples of a pixel see the face that its centre sees, or all of them nothing. */
static int spsi_pixel_is_even(const spsi_layers_job *job, const spsi_layer_scratch *scratch, int face, int x, int y) {
    const int n = job->samples;
    for (int row = y * n; row < y * n + n; ++row)
        for (int i = 0; i < n; ++i)
            if (scratch->numbers[(size_t)(row % (n * SPSI_LAYER_ROWS)) * (size_t)job->fine.width +
                                 (size_t)(x * n + i)] != face)
                return 0;
    return 1;
}

/* Adds the opaque fragments of a pixel, unless it shows one surface. Once they are listed, the pixel's hit is no
   surface, but ends gas where no sample sees past the deepest of them. */
static void spsi_edge_fragments(const spsi_layers_job *job, const spsi_layer_scratch *scratch, int x, int y) {
    const int n = job->samples;
    spsi_hit *hit = &job->hits[(size_t)y * (size_t)job->rays->width + (size_t)x];
    spsi_group groups[SPSI_COVERAGE_MAX * SPSI_COVERAGE_MAX];
    float deepest = -SPSI_INFINITY;
    int open = n * n, count;
    if (spsi_pixel_is_even(job, scratch, hit->face, x, y)) return;
    count = spsi_groups_of(job, scratch, x, y, groups);
    if (count == 1 && spsi_group_is_all(job, &groups[0], x, y)) return;
    for (int i = 0; i < count; ++i) {
        spsi_group_add(job, scratch, &groups[i], x, y, &deepest);
        open -= spsi_bit_count(groups[i].mask);
    }
    if (!job->listing) return;
    hit->face = -1;
    hit->depth = open ? SPSI_INFINITY : deepest;
}

/* --- from fragments to layers --- */

/* Finds what each sample of a band sees of opaque faces. */
static void spsi_layers_opaque(const spsi_layers_job *job, const spsi_layer_scratch *scratch, int y0, int y1) {
    const size_t samples = (size_t)(y1 - y0 + 1) * (size_t)job->fine.width;
    spsi_raster raster = job->raster;
    raster.depths = scratch->depths;
    raster.numbers = scratch->numbers;
    raster.first_row = y0;
    for (size_t i = 0; i < samples; ++i) {
        scratch->depths[i] = SPSI_INFINITY;
        scratch->numbers[i] = -1;
    }
    for (int face = 0; face < job->faces->count; ++face)
        if (spsi_raster_reaches(&raster, face, y0, y1)) spsi_raster_face(&raster, face, y0, y1);
}

/* Counts or lists the fragments of a band of pixels. */
static void spsi_layers_task(void *data, int index, int worker) {
    const spsi_layers_job *job = (const spsi_layers_job *)data;
    const spsi_rays *eye = job->rays;
    const int n = job->samples, top = index * SPSI_LAYER_ROWS;
    const int bottom = spsi_least(eye->height, top + SPSI_LAYER_ROWS) - 1;
    spsi_layer_scratch scratch;
    spsi_layer_scratch_of(job, worker, &scratch);
    memset(scratch.masks, 0, (size_t)eye->width * (sizeof *scratch.masks + sizeof *scratch.sums));
    if (n > 1) spsi_layers_opaque(job, &scratch, top * n, bottom * n + n - 1);
    for (int face = 0; face < job->faces->count && job->frame->meshes.translucent; ++face) {
        spsi_edges e;
        if (!spsi_face_is_translucent(&job->faces->list[face])) continue;
        if (!spsi_raster_reaches(&job->raster, face, top * n, bottom * n + n - 1)) continue;
        spsi_face_edges(job->faces, face, &job->fine, &e);
        for (int y = top; y <= bottom; ++y) spsi_pane_fragments(job, &scratch, &e, face, y);
    }
    for (int y = top; y <= bottom && n > 1; ++y)
        for (int x = 0; x < eye->width; ++x) spsi_edge_fragments(job, &scratch, x, y);
}

/* Replaces counts of fragments by where they begin. Returns their sum. */
static size_t spsi_layers_sum(uint32_t *first, size_t pixels) {
    uint64_t sum = 0;
    for (size_t i = 2; i < pixels + 2; ++i) {
        sum += first[i];
        first[i] = (uint32_t)sum;
    }
    return sum <= UINT32_MAX ? (size_t)sum : SIZE_MAX;
}

/* Sorts a pixel's fragments by depth, those of equal depth by face. [Shell 1959] */
static void spsi_fragments_sort(spsi_fragment *list, uint32_t count) {
    for (uint32_t gap = count > 16 ? count / 3 : 1; gap > 0; gap = gap > 2 ? gap * 4 / 10 : gap - 1)
        for (uint32_t i = gap; i < count; ++i) {
            const spsi_fragment moved = list[i];
            uint32_t at = i;
            for (; at >= gap && (list[at - gap].depth > moved.depth ||
                                 (!(list[at - gap].depth < moved.depth) && list[at - gap].face > moved.face));
                 at -= gap)
                list[at] = list[at - gap];
            list[at] = moved;
        }
}

/* Describes a layer in the middle of its samples, which is where light on it is closest to its mean; if that is on
   another face, at the sample nearest to it. */
static void spsi_layer_place(const spsi_layers_job *job, const spsi_fragment *fragment, uint32_t pixel,
                             spsi_layer *layer) {
    const int n = job->samples, x = (int)(pixel % (uint32_t)job->rays->width) * n;
    const int y = (int)(pixel / (uint32_t)job->rays->width) * n, count = spsi_bit_count(fragment->mask);
    double w[3] = {1, 0, 0}, column = 0, row = 0;
    spsi_edges e;
    for (int i = 0; i < n * n; ++i)
        if (fragment->mask >> i & 1) column += i % n, row += i / n;
    column /= count;
    row /= count;
    spsi_face_edges(job->faces, fragment->face, &job->fine, &e);
    if (!spsi_face_hit(&e, x + column, y + row, w)) {
        column = fragment->sample % n;
        row = fragment->sample / n;
        spsi_face_hit(&e, x + column, y + row, w);
    }
    layer->hit.depth = fragment->depth;
    layer->hit.face = fragment->face;
    layer->hit.weights[0] = (float)w[1];
    layer->hit.weights[1] = (float)w[2];
    layer->at[0] = (float)((column + 0.5) / n - 0.5);
    layer->at[1] = (float)((row + 0.5) / n - 0.5);
    layer->pixel = pixel;
}

#define SPSI_LAYERS_ORDERED 16 /* fragments of a pixel that each sample puts in order by itself */

/* The fragments of a pixel, and their depth where each sample sees them. */
typedef struct spsi_stack {
    const spsi_fragment *list;
    int count;
    int translucent[SPSI_LAYERS_ORDERED];
    float depths[SPSI_LAYERS_ORDERED][SPSI_COVERAGE_MAX * SPSI_COVERAGE_MAX];
} spsi_stack;

/* Depth at which a sample's ray meets a face's plane, clamped to the depths of the face's corners. */
static float spsi_fragment_depth(const spsi_layers_job *job, const spsi_edges *e, const spsi_face *face, int x, int y) {
    double u[3], v[3], plane[3], ray[3], start[3], t;
    spsi_along(face->position[1], face->position[0], -1, u);
    spsi_along(face->position[2], face->position[0], -1, v);
    spsi_cross(u, v, plane);
    spsi_ray_direction(&job->fine, x, y, ray);
    spsi_ray_point(&job->fine, x, y, job->fine.depth_reference, start);
    spsi_along(face->position[0], start, -1, start);
    t = spsi_dot(plane, start) / spsi_dot(plane, ray);
    t = fmax(t, fmin(e->depth[0], fmin(e->depth[1], e->depth[2])));
    return (float)fmin(t, fmax(e->depth[0], fmax(e->depth[1], e->depth[2])));
}

/* Finds these depths. */
static void spsi_stack_build(const spsi_layers_job *job, uint32_t pixel, spsi_stack *stack) {
    const int n = job->samples, width = job->rays->width;
    const int x = (int)(pixel % (uint32_t)width) * n, y = (int)(pixel / (uint32_t)width) * n;
    for (int i = 0; i < stack->count && n > 1 && stack->count <= SPSI_LAYERS_ORDERED; ++i) {
        const spsi_fragment *fragment = &stack->list[i];
        const spsi_face *face = &job->faces->list[fragment->face];
        spsi_edges e;
        stack->translucent[i] = spsi_face_is_translucent(face);
        spsi_face_corners(job->faces, fragment->face, &job->fine, &e);
        for (int k = 0; k < n * n; ++k)
            if (fragment->mask >> k & 1) stack->depths[i][k] = spsi_fragment_depth(job, &e, face, x + k % n, y + k / n);
    }
}

/* Whether a sample sees one fragment before another. Nothing behind an opaque one has become a fragment. */
static int spsi_stack_before(const spsi_stack *stack, int a, int b, int sample) {
    if (!stack->translucent[a] || !stack->translucent[b]) return stack->translucent[a] > stack->translucent[b];
    return stack->depths[a][sample] < stack->depths[b][sample];
}

/* The fragments that a sample sees, nearest first. Returns their number. */
static int spsi_stack_of_sample(const spsi_stack *stack, int sample, int order[SPSI_LAYERS_ORDERED]) {
    int count = 0;
    for (int i = 0; i < stack->count; ++i) {
        int at = count;
        if (!(stack->list[i].mask >> sample & 1)) continue;
        for (; at > 0 && spsi_stack_before(stack, i, order[at - 1], sample); --at) order[at] = order[at - 1];
        order[at] = i;
        count += 1;
    }
    return count;
}

/* Lets a sample's light pass a layer, at a depth. */
static void spsi_layer_pass(const spsi_layers_job *job, const spsi_fragment *fragment, float depth, float through[3],
                            spsi_layer *layer) {
    const float *passes = job->faces->list[fragment->face].transmittance;
    float covered = 0;
    for (int c = 0; c < 3; ++c) {
        layer->seen[c] += through[c];
        covered += through[c] * (1 - passes[c]);
        through[c] *= passes[c];
    }
    layer->covered += covered; /* its depth is the mean so far, weighted by what is covered */
    layer->hit.depth += layer->covered > 0 ? covered / layer->covered * (depth - layer->hit.depth) : 0;
}

/* Follows the light of every sample of a pixel past its fragments, in the sample's own order or, if they are many, in
   that of the pixel. */
static void spsi_layers_follow(const spsi_layers_job *job, const spsi_stack *stack, spsi_layer *layers) {
    for (int k = 0; k < job->samples * job->samples; ++k) {
        float through[3] = {1, 1, 1};
        int order[SPSI_LAYERS_ORDERED], count;
        if (job->samples == 1 || stack->count > SPSI_LAYERS_ORDERED) {
            for (int i = 0; i < 2 * stack->count; ++i) { /* opaque ones last, as in a sample's own order */
                const spsi_fragment *fragment = &stack->list[i % stack->count];
                if (spsi_face_is_translucent(&job->faces->list[fragment->face]) != (i < stack->count)) continue;
                if (fragment->mask >> k & 1)
                    spsi_layer_pass(job, fragment, fragment->depth, through, &layers[i % stack->count]);
            }
            continue;
        }
        count = spsi_stack_of_sample(stack, k, order);
        for (int i = 0; i < count; ++i)
            spsi_layer_pass(job, &stack->list[order[i]], stack->depths[order[i]][k], through, &layers[order[i]]);
    }
}

/* What a pixel's layers let pass, up to each of them. Turns sums into means. */
static void spsi_layers_accumulate(const spsi_layers_job *job, const spsi_stack *stack, spsi_layer *layers) {
    const int samples = job->samples * job->samples;
    float through[3][SPSI_COVERAGE_MAX * SPSI_COVERAGE_MAX];
    for (int c = 0; c < 3; ++c)
        for (int k = 0; k < samples; ++k) through[c][k] = 1;
    for (int i = 0; i < stack->count; ++i) {
        const spsi_fragment *fragment = &stack->list[i];
        for (int c = 0; c < 3; ++c) {
            const float passes = job->faces->list[fragment->face].transmittance[c];
            for (int k = 0; k < samples; ++k) {
                through[c][k] *= fragment->mask >> k & 1 ? passes : 1;
                layers[i].behind[c] += through[c][k];
            }
            layers[i].behind[c] /= (float)samples;
            layers[i].seen[c] /= (float)samples;
        }
        layers[i].covered /= 3 * (float)samples;
    }
}

static void spsi_layers_of_pixel(const spsi_layers_job *job, uint32_t pixel) {
    const uint32_t first = job->first[pixel], count = job->first[pixel + 1] - first;
    spsi_stack stack;
    if (count == 0) return;
    spsi_fragments_sort(job->fragments + first, count);
    stack.list = job->fragments + first;
    stack.count = (int)count;
    memset(job->layers + first, 0, count * sizeof *job->layers);
    for (int i = 0; i < stack.count; ++i)
        spsi_layer_place(job, &stack.list[i], pixel, &job->layers[first + (uint32_t)i]);
    spsi_stack_build(job, pixel, &stack);
    spsi_layers_follow(job, &stack, job->layers + first);
    spsi_layers_accumulate(job, &stack, job->layers + first);
}

static void spsi_layers_resolve_task(void *data, int index, int worker) {
    const spsi_layers_job *job = (const spsi_layers_job *)data;
    const int end = spsi_batch_end(index, (int)spsi_ray_count(job->rays));
    (void)worker;
    for (int i = index * SPSI_BATCH; i < end; ++i) spsi_layers_of_pixel(job, (uint32_t)i);
}

/* Whether pixels may show more than one polygon. */
static int spsi_has_layers(const spsi_frame *frame) {
    return frame->meshes.triangle_count > 0 && (frame->meshes.translucent || frame->view.coverage_samples > 1);
}

/* Bytes of all that is known before fragments are counted. */
static size_t spsi_layers_bytes(const sps_context *context, const spsi_frame *frame) {
    const spsi_rays *eye = &frame->content->eye;
    if (!spsi_has_layers(frame)) return 0;
    return (spsi_ray_count(eye) + 2) * sizeof(uint32_t) +
           (size_t)spsi_worker_count(context) *
               spsi_layer_scratch_bytes(eye, spsi_most(1, frame->view.coverage_samples));
}

static int spsi_layer_bands(const spsi_layers_job *job) {
    return (job->rays->height + SPSI_LAYER_ROWS - 1) / SPSI_LAYER_ROWS;
}

/* Counts the fragments of all pixels. Their number may be SIZE_MAX, which cannot be reserved. */
static size_t spsi_fragments_count(sps_context *context, spsi_layers_job *job) {
    const size_t pixels = spsi_ray_count(job->rays);
    memset(job->first, 0, (pixels + 2) * sizeof *job->first);
    spsi_raster_begin(context, job->faces, &job->fine, &job->raster);
    job->listing = 0;
    spsi_parallel(context, spsi_layer_bands(job), spsi_layers_task, job);
    return spsi_layers_sum(job->first, pixels);
}

/* Lists the fragments, which have been counted. Boxes of faces may be others' by now. */
static void spsi_fragments_list(sps_context *context, spsi_layers_job *job) {
    spsi_raster_begin(context, job->faces, &job->fine, &job->raster);
    job->listing = 1;
    spsi_parallel(context, spsi_layer_bands(job), spsi_layers_task, job);
}

/* Finds the layers of all pixels. Where edges are sampled, hits of pixels that show several polygons become ends of
   gas. */
static sps_result spsi_layers_build(sps_context *context, const spsi_frame *frame, const spsi_faces *faces,
                                    spsi_hit *hits, spsi_layers *layers) {
    const spsi_rays *eye = &frame->content->eye;
    spsi_layers_job job;
    memset(layers, 0, sizeof *layers);
    if (!hits || !spsi_has_layers(frame)) return SPS_OK;
    memset(&job, 0, sizeof job);
    job.frame = frame;
    job.faces = faces;
    job.rays = eye;
    job.hits = hits;
    job.samples = spsi_most(1, frame->view.coverage_samples);
    if (!spsi_rays_split(eye, job.samples, &job.fine))
        return spsi_fail_field(context, SPS_ERROR_UNSUPPORTED, SPS_OBJECT_VIEW, -1, "coverage_samples", job.samples,
                               "the camera cannot tell samples apart");
    job.scratch = (char *)spsi_reserve(context, SPSI_BUFFER_LAYER_SAMPLES, (size_t)spsi_worker_count(context),
                                       spsi_layer_scratch_bytes(eye, job.samples));
    job.first = (uint32_t *)spsi_reserve(context, SPSI_BUFFER_LAYER_STARTS, spsi_ray_count(eye) + 2, sizeof *job.first);
    if (!job.scratch || !job.first) return context->result;
    layers->count = spsi_fragments_count(context, &job);
    job.fragments = (spsi_fragment *)spsi_reserve(context, SPSI_BUFFER_FRAGMENTS, layers->count, sizeof *job.fragments);
    job.layers = (spsi_layer *)spsi_reserve(context, SPSI_BUFFER_LAYERS, layers->count, sizeof *job.layers);
    if (!job.fragments || !job.layers) return context->result;
    spsi_fragments_list(context, &job);
    spsi_parallel_batches(context, (int)spsi_ray_count(eye), spsi_layers_resolve_task, &job);
    layers->first = job.first;
    layers->list = job.layers;
    context->stats.layers = (uint64_t)layers->count;
    return SPS_OK;
}

/* ============================================================================================ >>surfaces
   14 Where the eye sees surfaces, what they look like, and how rays towards lights find what shades them. Their shadows
   on each other are exact: one ray per place through a tree of triangles, with neither texels nor a bias. Translucent
   triangles filter the ray, by color. Gas is shaded by depth maps, which are rasterised like the eye's image,
   >>depthmaps. Cost: the tree's height per place and light. */

/* --- appearance of surfaces: what shade_fn sets --- */

/* Color and emission of a face where a pixel meets it. */
typedef struct spsi_appearance {
    double color[3];
    float emission[3];
} spsi_appearance;

/* A place where a pixel shows a polygon: what its ray hits, or one of its layers. */
typedef struct spsi_place {
    const spsi_hit *hit;
    int x, y;     /* the pixel */
    double at[2]; /* x and y of the ray */
    size_t index; /* the pixel's, or the number of pixels plus the layer's */
} spsi_place;

/* The polygons that the eye sees. */
typedef struct spsi_visible {
    const spsi_hit *hits; /* of the whole image; NULL: no polygons */
    spsi_layers layers;
    const sps_surface *set; /* what shade_fn has set at the region's pixels and all layers; NULL: no mesh has one */
} spsi_visible;

static void spsi_place_of_pixel(const spsi_frame *frame, const spsi_visible *visible, int x, int y, spsi_place *place) {
    place->index = (size_t)y * (size_t)frame->content->eye.width + (size_t)x;
    place->hit = &visible->hits[place->index];
    place->x = x;
    place->y = y;
    place->at[0] = x;
    place->at[1] = y;
}

static void spsi_place_of_layer(const spsi_frame *frame, const spsi_visible *visible, size_t number,
                                spsi_place *place) {
    const spsi_layer *layer = &visible->layers.list[number];
    place->index = spsi_ray_count(&frame->content->eye) + number;
    place->hit = &layer->hit;
    place->x = (int)(layer->pixel % (uint32_t)frame->content->eye.width);
    place->y = (int)(layer->pixel / (uint32_t)frame->content->eye.width);
    place->at[0] = place->x + (double)layer->at[0];
    place->at[1] = place->y + (double)layer->at[1];
}

/* Number of places that a frame may have. */
static size_t spsi_place_count(const spsi_frame *frame, const spsi_visible *visible) {
    return spsi_ray_count(&frame->content->eye) + visible->layers.count;
}

static int spsi_in_region(const spsi_frame *frame, int x, int y) {
    const int *region = frame->view.region, column = x - region[0], row = y - region[1];
    return column >= 0 && row >= 0 && column < region[2] && row < region[3];
}

/* Where what shade_fn sets at a place is stored; SIZE_MAX: nowhere, since the pixel is outside the region. */
static size_t spsi_surface_index(const spsi_frame *frame, const spsi_place *place) {
    const int *region = frame->view.region, column = place->x - region[0], row = place->y - region[1];
    const size_t pixels = spsi_ray_count(&frame->content->eye);
    if (!spsi_in_region(frame, place->x, place->y)) return SIZE_MAX;
    return place->index < pixels ? (size_t)row * (size_t)region[2] + (size_t)column
                                 : (size_t)region[2] * (size_t)region[3] + place->index - pixels;
}

/* What shade_fn has set at a place; NULL: nothing. */
static const sps_surface *spsi_surface_set(const spsi_frame *frame, const sps_surface *set, const spsi_place *place) {
    const size_t at = spsi_surface_index(frame, place);
    return set && at != SIZE_MAX && set[at].color[0] >= 0 ? &set[at] : NULL;
}

static void spsi_appearance_at(const spsi_faces *faces, const spsi_hit *hit, const sps_surface *set,
                               spsi_appearance *look) {
    if (!set) spsi_face_color(&faces->list[hit->face], hit, look->color);
    for (int c = 0; c < 3; ++c) {
        if (set) look->color[c] = (double)set->color[c];
        look->emission[c] = set ? set->emission[c] : 0;
    }
}

#define SPSI_SURFACE_BATCH 4096 /* points for a call of shade_fn, at most */

/* A place on a mesh that has a shade_fn. */
typedef struct spsi_shown {
    spsi_place place;
    int mesh; /* in the frame's list */
} spsi_shown;

/* The next places, in rows of pixels from the top, whose meshes have a shade_fn; and those of one mesh among them. A
   pixel's layers come after what its ray hits. */
typedef struct spsi_surface_batch {
    const spsi_frame *frame;
    const spsi_faces *faces;
    const spsi_visible *visible;
    int x, y;   /* the next pixel to look at */
    int number; /* 0: its hit, then its layers from 1 */
    int shown_count, count;
    spsi_shown shown[SPSI_SURFACE_BATCH];
    spsi_shown same[SPSI_SURFACE_BATCH]; /* of one mesh */
    sps_surface_point points[SPSI_SURFACE_BATCH];
    sps_surface out[SPSI_SURFACE_BATCH];
} spsi_surface_batch;

/* Change of a face's weights from a pixel to its neighbour, whose ray is `step` away at the point: `step`, projected
   along the ray onto the plane, in the coordinates of edges u and v. */
static void spsi_weights_step(const double ray[3], const double step[3], const double u[3], const double v[3],
                              double change[3]) {
    double n[3], across[3], along[3];
    spsi_cross(u, v, n);
    spsi_along(step, ray, -spsi_dot(n, step) / spsi_dot(n, ray), along);
    spsi_cross(along, v, across);
    change[1] = spsi_dot(across, n) / spsi_dot(n, n);
    spsi_cross(u, along, across);
    change[2] = spsi_dot(across, n) / spsi_dot(n, n);
    change[0] = -change[1] - change[2];
}

/* The i-th texture coordinate at weights, or its change at a change of weights. */
static double spsi_uv_mean(const spsi_face_texture *texture, const double w[3], int i) {
    return w[0] * (double)texture->uv[0][i] + w[1] * (double)texture->uv[1][i] + w[2] * (double)texture->uv[2][i];
}

/* Change of texture coordinates from pixel to pixel, along x if axis is the eye's a, along y if it is b. */
static void spsi_uv_step(const spsi_rays *eye, const spsi_face *face, const spsi_face_texture *texture,
                         const spsi_shown *at, double depth, const double axis[3], float change[2]) {
    double ray[3], step[3], u[3], v[3], w[3];
    const double scale = eye->perspective ? depth : 1;
    spsi_ray_direction(eye, at->place.at[0], at->place.at[1], ray);
    for (int i = 0; i < 3; ++i) step[i] = scale * axis[i];
    spsi_along(face->position[1], face->position[0], -1, u);
    spsi_along(face->position[2], face->position[0], -1, v);
    spsi_weights_step(ray, step, u, v, w);
    for (int i = 0; i < 2; ++i) change[i] = (float)fmax(-1e30, fmin(1e30, spsi_uv_mean(texture, w, i)));
}

/* Describes the point that a place shows. Without shade_fn it would have the mesh's own color. */
static void spsi_surface_point(const spsi_surface_batch *batch, const spsi_shown *at, sps_surface_point *point,
                               sps_surface *out) {
    const spsi_rays *eye = &batch->frame->content->eye;
    const spsi_hit *hit = at->place.hit;
    const spsi_face *face = &batch->faces->list[hit->face];
    const spsi_face_texture *texture = &batch->faces->textures[batch->faces->meshes[at->mesh].textures + hit->face];
    const double depth = (double)hit->depth + eye->depth_reference;
    double w[3], color[3];
    spsi_surface surface;
    spsi_surface_at(eye, batch->faces, hit, at->place.at[0], at->place.at[1], &surface);
    spsi_normalise(surface.normal);
    spsi_hit_weights(hit, w);
    spsi_face_color(face, hit, color);
    memcpy(point->position, surface.point, sizeof point->position);
    for (int i = 0; i < 2; ++i) point->uv[i] = spsi_uv_mean(texture, w, i);
    spsi_uv_step(eye, face, texture, at, depth, eye->a, point->uv_dx);
    spsi_uv_step(eye, face, texture, at, depth, eye->b, point->uv_dy);
    for (int i = 0; i < 3; ++i) {
        point->normal[i] = (float)surface.normal[i];
        point->weights[i] = (float)w[i];
        out->color[i] = (float)color[i];
        out->emission[i] = 0;
    }
    point->triangle = texture->number;
    point->mesh = batch->frame->meshes.list[at->mesh].index;
    point->x = at->place.x;
    point->y = at->place.y;
}

static void spsi_surface_point_task(void *data, int index, int worker) {
    spsi_surface_batch *batch = (spsi_surface_batch *)data;
    const int end = spsi_batch_end(index, batch->count);
    (void)worker;
    for (int i = index * SPSI_BATCH; i < end; ++i)
        spsi_surface_point(batch, &batch->same[i], &batch->points[i], &batch->out[i]);
}

/* The next place of the current pixel; returns 0 if there are no more. */
static int spsi_surface_batch_place(spsi_surface_batch *batch, spsi_place *place) {
    const spsi_layers *layers = &batch->visible->layers;
    const size_t pixel = (size_t)batch->y * (size_t)batch->frame->content->eye.width + (size_t)batch->x;
    const int count = layers->first ? (int)(layers->first[pixel + 1] - layers->first[pixel]) : 0;
    if (batch->number == 0 && batch->visible->hits[pixel].face < 0) batch->number = 1;
    if (batch->number > count) return 0;
    if (batch->number == 0)
        spsi_place_of_pixel(batch->frame, batch->visible, batch->x, batch->y, place);
    else
        spsi_place_of_layer(batch->frame, batch->visible, layers->first[pixel] + (size_t)batch->number - 1, place);
    return 1;
}

/* Collects the next places. Returns 0 if there are none. */
static int spsi_surface_batch_fill(spsi_surface_batch *batch) {
    const int *region = batch->frame->view.region, right = region[0] + region[2], bottom = region[1] + region[3];
    spsi_place place;
    batch->shown_count = 0;
    for (; batch->y < bottom; ++batch->y, batch->x = region[0])
        for (; batch->x < right; ++batch->x, batch->number = 0)
            for (; spsi_surface_batch_place(batch, &place); ++batch->number) {
                spsi_shown *shown = &batch->shown[batch->shown_count];
                if (batch->shown_count == SPSI_SURFACE_BATCH) return 1;
                shown->place = place;
                shown->mesh = spsi_mesh_of(batch->frame, batch->faces, place.hit->face);
                batch->shown_count += batch->frame->meshes.list[shown->mesh].shade_fn != NULL;
            }
    return batch->shown_count > 0;
}

/* Picks the places of one mesh. Returns the next mesh that has any, or -1. */
static int spsi_surface_batch_pick(spsi_surface_batch *batch, int mesh) {
    int next = -1;
    batch->count = 0;
    for (int i = 0; i < batch->shown_count; ++i) {
        const int other = batch->shown[i].mesh;
        if (other == mesh) batch->same[batch->count++] = batch->shown[i];
        if (other > mesh && (next < 0 || other < next)) next = other;
    }
    return next;
}

/* Calls a mesh's shade_fn for the points that were picked, and checks what it has set. */
static sps_result spsi_surface_batch_shade(sps_context *context, spsi_surface_batch *batch, const spsi_mesh *mesh) {
    int returned;
    spsi_parallel_batches(context, batch->count, spsi_surface_point_task, batch);
    context->stats.shade_calls += 1;
    context->stats.surface_points += (uint64_t)batch->count;
    returned = mesh->shade_fn(mesh->shade_user, (size_t)batch->count, batch->points, batch->out);
    if (returned)
        return spsi_fail_field(context, SPS_ERROR_CALLBACK, SPS_OBJECT_MESH, mesh->index, "shade_fn", returned, NULL);
    for (int i = 0; i < batch->count; ++i) {
        const float *color = spsi_bad_color(batch->out[i].color, 1);
        const float *emission = spsi_bad_color(batch->out[i].emission, SPSI_VALUE_MAX);
        if (color)
            return spsi_fail_field(context, SPS_ERROR_DATA, SPS_OBJECT_MESH, mesh->index, "shade_fn's color",
                                   (double)*color, "red, green and blue must be 0..1");
        if (emission)
            return spsi_fail_field(context, SPS_ERROR_DATA, SPS_OBJECT_MESH, mesh->index, "shade_fn's emission",
                                   (double)*emission, "red, green and blue must be 0..1e18");
    }
    return SPS_OK;
}

/* Shades the places that were collected, mesh by mesh. */
static sps_result spsi_surface_batch_run(sps_context *context, spsi_surface_batch *batch, sps_surface *set) {
    int next;
    for (int mesh = spsi_surface_batch_pick(batch, -1); mesh >= 0; mesh = next) {
        next = spsi_surface_batch_pick(batch, mesh);
        if (spsi_surface_batch_shade(context, batch, &batch->frame->meshes.list[mesh])) return context->result;
        for (int i = 0; i < batch->count; ++i)
            set[spsi_surface_index(batch->frame, &batch->same[i].place)] = batch->out[i];
    }
    return spsi_progress(context, 0);
}

/* Calls shade_fn for the points that the region's pixels show, once each. Sets visible->set. */
static sps_result spsi_textures(sps_context *context, const spsi_frame *frame, const spsi_faces *faces,
                                spsi_visible *visible) {
    const size_t places = (size_t)frame->view.region[2] * (size_t)frame->view.region[3] + visible->layers.count;
    spsi_surface_batch *batch;
    sps_surface *out;
    visible->set = NULL;
    if (!faces->textures || !visible->hits) return SPS_OK;
    out = (sps_surface *)spsi_reserve(context, SPSI_BUFFER_SURFACES, places, sizeof *out);
    batch = (spsi_surface_batch *)spsi_reserve(context, SPSI_BUFFER_SURFACE_BATCH, 1, sizeof *batch);
    if (!out || !batch) return context->result;
    for (size_t i = 0; i < places; ++i) out[i].color[0] = -1; /* nothing is set there */
    batch->frame = frame;
    batch->faces = faces;
    batch->visible = visible;
    batch->x = frame->view.region[0];
    batch->y = frame->view.region[1];
    batch->number = 0;
    while (spsi_surface_batch_fill(batch))
        if (spsi_surface_batch_run(context, batch, out)) return context->result;
    visible->set = out;
    return SPS_OK;
}

/* Bytes of all that shade_fn needs: of triangles, and of pixels. */
static size_t spsi_textures_bytes(const spsi_frame *frame) {
    const spsi_meshes *meshes = &frame->meshes;
    if (meshes->textured_count == 0) return 0;
    return meshes->textured_count * sizeof(spsi_face_texture) + (size_t)meshes->count * sizeof(spsi_mesh_faces) +
           (size_t)frame->view.region[2] * (size_t)frame->view.region[3] * sizeof(sps_surface) +
           sizeof(spsi_surface_batch);
}

/* --- shadows on surfaces: rays through a tree of triangles --- */

#define SPSI_PACKET 16 /* rays traced together: those of 4 x 4 pixels */

/* Rays from points towards one light. */
typedef struct spsi_packet {
    double origin[3][SPSI_PACKET], toward[3][SPSI_PACKET];
    double reach;         /* the light is at origin + reach * toward; infinity for a directional light */
    double rounding;      /* round-off of world coordinates */
    int on_faces;         /* 0: rays begin in gas, where no face is near enough for round-off to matter */
    int own[SPSI_PACKET]; /* face that each ray begins on and ignores; -1: none */
    int count;            /* vectors that hold any rays */
    int open;             /* bit mask of rays that nothing has occluded yet */
    int filtered;         /* bit mask of rays that translucent faces have filtered */
    /* Optical depth of translucent faces on each ray, by color, in units of 2^-32: sums of integers do not depend on
       the order in which faces are met. */
    uint64_t filter[3][SPSI_PACKET];
    float above[3][SPSI_PACKET];   /* origins relative to the tree's centre, plus room for round-off */
    float below[3][SPSI_PACKET];   /* the same, minus that room */
    float inverse[3][SPSI_PACKET]; /* toward; 1 / toward once the packet is traced */
} spsi_packet;

/* Begins an empty packet. */
static void spsi_packet_begin(const spsi_faces *faces, int is_direction, int on_faces, spsi_packet *packet) {
    memset(packet, 0, sizeof *packet);
    packet->on_faces = on_faces;
    packet->reach = is_direction ? HUGE_VAL : 1;
    packet->rounding = 16 * DBL_EPSILON * faces->extent;
}

/* Adds a ray. `room` covers the rounding of its origin to floats, and the round-off of subtracting it from boxes.
   Reciprocals are kept finite: no box is 1e30 times as far away as it is wide. */
static void spsi_packet_add(const spsi_tree *tree, int at, int own, const double origin[3], const double toward[3],
                            spsi_packet *packet) {
    double offset[3], room = 0;
    for (int i = 0; i < 3; ++i) {
        packet->origin[i][at] = origin[i];
        packet->toward[i][at] = toward[i];
        offset[i] = origin[i] - tree->centre[i];
        room = fabs(offset[i]) > room ? fabs(offset[i]) : room;
    }
    room *= 3e-7;
    for (int i = 0; i < 3; ++i) {
        packet->above[i][at] = (float)(offset[i] + room);
        packet->below[i][at] = (float)(offset[i] - room);
        packet->inverse[i][at] = (float)(fabs(toward[i]) > 1e-30 ? toward[i] : 1e-30);
    }
    packet->own[at] = own;
    packet->open |= 1 << at;
    packet->count = spsi_most(packet->count, at / SPSI_LANES + 1);
}

/* Bit mask of the open rays that may hit a node's box. */
static inline int spsi_packet_meets(const spsi_packet *packet, const spsi_tree_node *node, spsi_v reach) {
    int bits = 0;
    for (int k = 0; k < packet->count; ++k) {
        spsi_v enter = spsi_set(0), leave = reach;
        for (int i = 0; i < 3; ++i) {
            const int at = k * SPSI_LANES;
            const spsi_v inverse = spsi_load(&packet->inverse[i][at]);
            const spsi_v a = spsi_mul(spsi_sub(spsi_set(node->low[i]), spsi_load(&packet->above[i][at])), inverse);
            const spsi_v b = spsi_mul(spsi_sub(spsi_set(node->high[i]), spsi_load(&packet->below[i][at])), inverse);
            enter = spsi_max(enter, spsi_min(a, b));
            leave = spsi_min(leave, spsi_max(a, b));
        }
        bits |= spsi_bits(spsi_less(enter, spsi_mul(leave, spsi_set(1 + 1e-6f)))) << k * SPSI_LANES;
    }
    return bits & packet->open;
}

/* d . (a x b): the side of an edge on which a ray in direction d passes; a and b are relative to its origin. */
static inline double spsi_edge_side(const double a[3], const double b[3], const double d[3]) {
    return d[0] * (a[1] * b[2] - a[2] * b[1]) + d[1] * (a[2] * b[0] - a[0] * b[2]) + d[2] * (a[0] * b[1] - a[1] * b[0]);
}

static inline double spsi_reach_of(const double a[3]) { return fabs(a[0]) + fabs(a[1]) + fabs(a[2]); }

/* Whether a ray in direction d passes between three corners, given relative to its origin; ab, bc and ac are the edges'
   sides. A side whose sign round-off may have changed counts as inside: round-off is below 8 * 2^-53 of the product of
   the lengths, which are bounded by the sums of their components. So no ray through an edge or a corner slips between
   two faces, however the compiler contracts multiplications and additions. */
static inline int spsi_edges_hold(const double a[3], const double b[3], const double c[3], const double d[3], double ab,
                                  double bc, double ac) {
    const double ra = spsi_reach_of(a), rb = spsi_reach_of(b), rc = spsi_reach_of(c), rab = ra > rb ? ra : rb;
    const double longest = rab > rc ? rab : rc, room = 1e-15 * spsi_reach_of(d) * longest * longest;
    return ((ab >= -room) & (bc >= -room) & (ac <= room)) | ((ab <= room) & (bc <= room) & (ac >= -room));
}

/* Bit mask of the rays of a vector, from number `first` on, that a face occludes. Where rays begin on faces, it must
   lie ahead of a ray's origin by more than the round-off of world coordinates and of its corners in their mesh. So
   neither an adjoining face nor a twin in the same plane shades a point, and no adjacency is needed. */
static int spsi_face_stops(const spsi_face *face, const spsi_packet *packet, int first) {
    const double *p = face->position[0], *q = face->position[1], *r = face->position[2];
    double u[3], v[3], n[3], room, stops[SPSI_LANES];
    int bits = 0;
    spsi_along(q, p, -1, u);
    spsi_along(r, p, -1, v);
    spsi_cross(u, v, n);
    room = packet->on_faces ? (double)face->rounding + packet->rounding : 0;
    room *= fabs(n[0]) + fabs(n[1]) + fabs(n[2]);
    for (int i = 0; i < SPSI_LANES; ++i) {
        const int at = first + i;
        const double o[3] = {packet->origin[0][at], packet->origin[1][at], packet->origin[2][at]};
        const double d[3] = {packet->toward[0][at], packet->toward[1][at], packet->toward[2][at]};
        const double a[3] = {p[0] - o[0], p[1] - o[1], p[2] - o[2]};
        const double b[3] = {q[0] - o[0], q[1] - o[1], q[2] - o[2]};
        const double c[3] = {r[0] - o[0], r[1] - o[1], r[2] - o[2]};
        const double ab = spsi_edge_side(a, b, d), bc = spsi_edge_side(b, c, d), ac = spsi_edge_side(a, c, d);
        const double facing = n[0] * d[0] + n[1] * d[1] + n[2] * d[2], turn = facing < 0 ? -1 : 1;
        const double ahead = turn * (n[0] * a[0] + n[1] * a[1] + n[2] * a[2]);
        const int inside = spsi_edges_hold(a, b, c, d, ab, bc, ac);
        stops[i] = (inside & (ahead > room) & (ahead < packet->reach * (turn * facing))) ? 1 : 0;
    }
    for (int i = 0; i < SPSI_LANES; ++i) bits |= (stops[i] > 0) << i;
    return bits;
}

/* Whether a ray passes through a face, which is translucent: of the faces that share an edge or a corner, a ray through
   it passes one, as if it were an orthographic pixel. Corners are projected along the ray onto the plane of the other
   two axes, to the same bits for all faces that share them. */
static int spsi_face_passes(const spsi_face *face, const double origin[3], const double toward[3]) {
    const double x = fabs(toward[0]), y = fabs(toward[1]), z = fabs(toward[2]);
    const int along = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
    double corner[3][3];
    int side = 0;
    for (int i = 0; i < 3; ++i) {
        double offset[3];
        spsi_along(face->position[i], origin, -1, offset);
        for (int k = 0; k < 2; ++k) {
            const int axis = (along + 1 + k) % 3;
            corner[i][k] = spsi_multiply_add(-toward[axis] / toward[along], offset[along], offset[axis]);
        }
        corner[i][2] = 1;
    }
    for (int i = 0; i < 3; ++i) {
        const int sign = spsi_edge_sign(corner[i], corner[(i + 1) % 3], 0, 0);
        if (sign == 0 || sign == -side) return 0;
        side = sign;
    }
    return 1;
}

/* Optical depth of a face in units of 2^-32, 86 at most: 4e7 of them do not overflow. */
static uint64_t spsi_filter_of(float transmittance) {
    const double depth = transmittance > 0 ? -log((double)transmittance) : (double)SPSI_DEPTH_MAX;
    return (uint64_t)(fmin(depth, 86) * 4294967296.0);
}

/* Filters the open rays that pass through a translucent face. */
static void spsi_packet_filter(const spsi_face *face, int number, spsi_packet *packet) {
    for (int first = 0; packet->open >> first; first += SPSI_LANES) {
        const int met = spsi_face_stops(face, packet, first) << first & packet->open;
        for (int at = first; met >> at > 0; ++at) {
            const double origin[3] = {packet->origin[0][at], packet->origin[1][at], packet->origin[2][at]};
            const double toward[3] = {packet->toward[0][at], packet->toward[1][at], packet->toward[2][at]};
            if (!(met >> at & 1) || packet->own[at] == number || !spsi_face_passes(face, origin, toward)) continue;
            for (int c = 0; c < 3; ++c) packet->filter[c][at] += spsi_filter_of(face->transmittance[c]);
            packet->filtered |= 1 << at;
        }
    }
}

/* What translucent faces let pass along a ray, by color. */
static void spsi_packet_through(const spsi_packet *packet, int at, double through[3]) {
    for (int c = 0; c < 3; ++c) {
        const double depth = (double)packet->filter[c][at] / 4294967296.0;
        through[c] = depth < 86 ? exp(-depth) : 0;
    }
}

/* Closes the rays among `bits` that a face occludes, or filters them. */
static void spsi_packet_meet_face(const spsi_faces *faces, int number, int bits, spsi_packet *packet) {
    if (spsi_face_is_translucent(&faces->list[number])) {
        spsi_packet_filter(&faces->list[number], number, packet);
        return;
    }
    for (int first = 0; first < SPSI_PACKET; first += SPSI_LANES) {
        int stopped;
        if (!(bits >> first & ((1 << SPSI_LANES) - 1))) continue;
        stopped = spsi_face_stops(&faces->list[number], packet, first) << first & packet->open;
        for (int at = first; stopped >> at > 0; ++at)
            if (stopped >> at & 1 && packet->own[at] != number) packet->open &= ~(1 << at);
    }
}

/* Traces a packet: afterwards, its open rays are those that reach the light, through translucent faces or not. */
static void spsi_packet_trace(const spsi_faces *faces, spsi_packet *packet) {
    const spsi_tree *tree = &faces->tree;
    const spsi_v reach = spsi_set(packet->reach <= 1 ? 1.0f : FLT_MAX);
    int stack[SPSI_TREE_STACK], top = 0;
    if (tree->count == 0) return;
    for (int at = 0; at < packet->count * SPSI_LANES; at += SPSI_LANES)
        for (int i = 0; i < 3; ++i)
            spsi_store(&packet->inverse[i][at], spsi_div(spsi_set(1), spsi_load(&packet->inverse[i][at])));
    stack[top++] = 0;
    while (top > 0 && packet->open) {
        const spsi_tree_node *node = &tree->nodes[stack[--top]];
        for (int i = 0; i < node->count; ++i)
            spsi_packet_meet_face(faces, tree->order[node->first + i], packet->open, packet);
        for (int child = node->first; child < node->first + 2 && node->count == 0; ++child)
            if (spsi_packet_meets(packet, &tree->nodes[child], reach)) stack[top++] = child;
    }
}

typedef struct spsi_face_items {
    const spsi_faces *faces;
    spsi_tree_item *items;
} spsi_face_items;

static void spsi_face_items_task(void *data, int index, int worker) {
    const spsi_face_items *job = (const spsi_face_items *)data;
    const int end = spsi_batch_end(index, job->faces->count);
    (void)worker;
    for (int i = index * SPSI_BATCH; i < end; ++i) {
        spsi_bounds bounds = spsi_nowhere;
        for (int corner = 0; corner < 3; ++corner) spsi_bounds_add(&bounds, job->faces->list[i].position[corner]);
        job->items[i].number = i;
        spsi_tree_item_add(&job->items[i], job->faces->tree.centre, bounds.low, bounds.high);
    }
}

/* Builds the tree of all faces, or reuses the one that is held with them. */
static sps_result spsi_faces_tree(sps_context *context, spsi_faces *faces) {
    spsi_face_items job;
    spsi_tree *tree = &faces->tree;
    const size_t count = (size_t)faces->count;
    if (count == 0) return SPS_OK;
    tree->nodes =
        (spsi_tree_node *)spsi_reserve(context, SPSI_BUFFER_FACE_NODES, spsi_tree_nodes(count), sizeof(spsi_tree_node));
    tree->order = (int *)spsi_reserve(context, SPSI_BUFFER_FACE_ORDER, count, sizeof(int));
    if (!tree->nodes || !tree->order) return context->result;
    tree->count = faces->count;
    for (int i = 0; i < 3; ++i) tree->centre[i] = 0.5 * (context->mesh_low[i] + context->mesh_high[i]);
    if (context->tree_held) return SPS_OK;
    job.faces = faces;
    job.items = (spsi_tree_item *)spsi_reserve(context, SPSI_BUFFER_TREE_ITEMS, count, sizeof(spsi_tree_item));
    if (!job.items) return context->result;
    spsi_parallel_batches(context, faces->count, spsi_face_items_task, &job);
    if (spsi_tree_build(context, tree, job.items)) return context->result;
    context->tree_held = 1;
    return SPS_OK;
}

/* ================================================================================================ >>lamps
   15 Lights: where their light comes from, and grids of rays that cover what it may reach. */

#define SPSI_PARTICLE_EDGE 0.7 /* in radii, >>slicing */
#define SPSI_TEXELS_ALIKE  "cannot tell its texels apart so far from the world's origin"

/* Unit vector along which light travels at a point. */
static void spsi_lamp_direction(const spsi_lamp *lamp, const double point[3], double direction[3]) {
    if (!lamp->is_point)
        memcpy(direction, lamp->direction, sizeof lamp->direction);
    else
        spsi_along(point, lamp->position, -1, direction);
    spsi_normalise(direction);
}

/* Minimum breadth of any volume's voxels across a ray; infinity without volumes. */
static double spsi_voxel_across(const spsi_frame *frame, const double right[3], const double down[3]) {
    double least = HUGE_VAL;
    for (int i = 0; i < frame->medium_count; ++i)
        least = fmin(least, spsi_voxel_breadth(frame->media[i].lattice, right, down));
    return least;
}

/* Fits a light's rays to `bounds`. `texel` is the desired size of a texel in the world (for a point light, at the
   middle of the bounds). `size` is the number of texels on the longer side; 0: what `texel` calls for, `most` at most.
   A border of two texels stays free on every side. As a light turns, texels keep their places about the middle of the
   bounds, and come and go in pairs at the borders: errors that jump would be visible. Returns 0 if a point light does
   not see the bounds within a cone, or if spsi_rays_complete fails. */
static int spsi_rays_fit(const spsi_lamp *lamp, const spsi_bounds *bounds, double texel, int size, int most,
                         spsi_rays *rays) {
    double centre[3], forward[3], right[3], down[3], low[2] = {HUGE_VAL, HUGE_VAL}, high[2] = {-HUGE_VAL, -HUGE_VAL};
    double eye[3], pitch, extent, distance;
    int columns, rows;
    spsi_bounds_centre(bounds, centre);
    spsi_lamp_direction(lamp, centre, forward);
    spsi_basis(forward, right, down);
    rays->perspective = lamp->is_point;
    memcpy(eye, rays->perspective ? lamp->position : centre, sizeof eye);
    for (int corner = 0; corner < 8; ++corner) {
        double offset[3], depth, at[2];
        spsi_bounds_corner(bounds, corner, offset);
        spsi_along(offset, eye, -1, offset);
        depth = rays->perspective ? spsi_dot(offset, forward) : 1;
        if (!(depth > 0.2 * spsi_length(offset)) && rays->perspective) return 0;
        at[0] = spsi_dot(offset, right) / depth;
        at[1] = spsi_dot(offset, down) / depth;
        for (int k = 0; k < 2; ++k) low[k] = fmin(low[k], at[k]), high[k] = fmax(high[k], at[k]);
    }
    spsi_along(centre, eye, -1, centre);
    distance = rays->perspective ? spsi_dot(centre, forward) : 1;
    extent = fmax(high[0] - low[0], high[1] - low[1]);
    pitch = fmin(fmax(texel / distance, extent / (most - 4)), extent / 12);
    if (size > 0) pitch = extent / spsi_most(1, size - 4);
    if (!(pitch > 0)) pitch = 1;
    if (size == 0) size = spsi_least(most, 2 * (int)ceil(0.5 * extent / pitch * (1 - 1e-9)) + 4);
    columns = (int)floor(0.5 * (extent - (high[0] - low[0])) / pitch);
    rows = (int)floor(0.5 * (extent - (high[1] - low[1])) / pitch);
    rays->width = spsi_most(2, size - 2 * columns);
    rays->height = spsi_most(2, size - 2 * rows);
    spsi_rays_aim(rays, eye, right, down, forward, pitch, pitch);
    {
        double *corner = rays->perspective ? rays->c : rays->origin;
        spsi_along(corner, right, 0.5 * (low[0] + high[0]), corner);
        spsi_along(corner, down, 0.5 * (low[1] + high[1]), corner);
    }
    rays->depth_reference = rays->perspective ? distance : 0;
    rays->near_depth = rays->perspective ? 0 : -HUGE_VAL;
    return spsi_rays_complete(rays);
}

/* Maximum number of texels on the longer side of a light's sheets where shadow_size does not set it. */
static int spsi_light_texels_most(const spsi_frame *frame) {
    return frame->medium_count > 0 ? 4096 : frame->accuracy.depth_map_texels;
}

static int spsi_has_shadow_table(const spsi_lamp *lamp) {
    return lamp->has_map && lamp->map.technique == SPS_TMAP_TABLE;
}

#define SPSI_SHADOW_TABLE_TEXELS_MOST 256 /* on a side of a shadow table whose size is not set */

/* The same of a light's map. */
static int spsi_map_texels_most(const spsi_frame *frame, const spsi_lamp *lamp) {
    return spsi_has_shadow_table(lamp) ? SPSI_SHADOW_TABLE_TEXELS_MOST : spsi_light_texels_most(frame);
}

static int spsi_has_shadow_tables(const spsi_frame *frame) {
    for (int i = 0; i < frame->lamps.count; ++i)
        if (spsi_has_shadow_table(&frame->lamps.list[i])) return 1;
    return 0;
}

/* Desired size of a light's texels: that of a voxel, or half of the voxel edge that stands for a particle, whose rim is
   sharper, divided by the quality's texels per voxel. Particles alone do not call for more texels than a depth map
   has. For a light in the very centre, where no direction is that of the gas, voxels are measured across z. */
static double spsi_lamp_texel(const spsi_frame *frame, const spsi_lamp *lamp) {
    double centre[3], forward[3], right[3], down[3], across[3], size, own;
    spsi_bounds_centre(&frame->content->bounds, centre);
    spsi_lamp_direction(lamp, centre, forward);
    if (!(spsi_dot(forward, forward) > 0)) forward[2] = 1;
    spsi_basis(forward, right, down);
    size = spsi_voxel_across(frame, right, down) / frame->accuracy.shadow_texels;
    if (frame->content->particle_count == 0) return size;
    own = 0.5 * SPSI_PARTICLE_EDGE * frame->content->particle_radius / frame->accuracy.shadow_texels;
    spsi_along(frame->content->bounds.high, frame->content->bounds.low, -1, across);
    return fmin(size, fmax(own, spsi_length(across) / frame->accuracy.depth_map_texels));
}

/* Six grids of rays around a point light, whose texels have the desired size where the gas is farthest. */
static int spsi_lamp_rays_around(const spsi_frame *frame, const spsi_lamp *lamp, spsi_rays rays[SPSI_CUBE_FACES]) {
    const spsi_bounds *bounds = &frame->content->bounds;
    const double texel = spsi_lamp_texel(frame, lamp);
    double farthest = 0;
    int size = lamp->map_size;
    for (int i = 0; i < 3; ++i)
        farthest = fmax(farthest, fmax(bounds->high[i] - lamp->position[i], lamp->position[i] - bounds->low[i]));
    if (size == 0) size = (int)fmin(fmax(ceil(2 * farthest / texel), 16), spsi_map_texels_most(frame, lamp));
    for (int face = 0; face < SPSI_CUBE_FACES; ++face)
        if (!spsi_rays_of_cube_face(lamp->position, face, size, 0, &rays[face])) return 0;
    return SPSI_CUBE_FACES;
}

/* Aims a light's transmittance map at the gas: one grid of rays if the light sees all of it within a cone, otherwise
   six. Returns the number of grids; 0: the light is too far from the world's origin to tell its rays apart. */
static int spsi_lamp_rays(const spsi_frame *frame, const spsi_lamp *lamp, spsi_rays rays[SPSI_CUBE_FACES]) {
    if (!lamp->map_omnidirectional && spsi_rays_fit(lamp, &frame->content->bounds, spsi_lamp_texel(frame, lamp),
                                                    lamp->map_size, spsi_map_texels_most(frame, lamp), &rays[0]))
        return 1;
    return lamp->is_point ? spsi_lamp_rays_around(frame, lamp, rays) : 0;
}

/* What a spotlight's cone lets pass in a direction, given by its cosine with the axis. */
static inline spsi_v spsi_cone_share(const spsi_cone *cone, spsi_v cosine) {
    const spsi_v share =
        spsi_clamp(spsi_fma(cosine, spsi_set(cone->scale), spsi_set(cone->offset)), spsi_set(0), spsi_set(1));
    return spsi_mul(share, share);
}

/* The same for one direction. */
static double spsi_cone_at(const spsi_cone *cone, double cosine) {
    const double share = fmin(fmax(cosine * (double)cone->scale + (double)cone->offset, 0), 1);
    return cone->exists ? share * share : 1;
}

/* Vector from a point to a light, in units of a packet's reach: the whole way to a point light, a unit vector towards a
   directional one. */
static void spsi_toward_lamp(const spsi_lamp *lamp, const double point[3], double toward[3]) {
    if (lamp->is_point) {
        spsi_along(lamp->position, point, -1, toward);
        return;
    }
    spsi_lamp_direction(lamp, point, toward);
    for (int i = 0; i < 3; ++i) toward[i] = -toward[i];
}

/* =========================================================================================== >>projectors
   16 Images that lights throw: read once per call, halved down to a texel, looked up along the light's rays. A texel of
   a halved image is the mean of the area that it covers; between two images, the share of each is linear in the size of
   a pixel. Cost: 3 floats per texel and 1/3 more; a lookup gathers 12 texels, or 24 between two images. */

#define SPSI_IMAGE_ROW_FLOATS 5 /* per texel of the row that is being read: a place and a color */

static size_t spsi_image_level_floats(const spsi_image *image, int level) {
    return 3 * (size_t)image->width[level] * (size_t)image->height[level];
}

/* Sets the sizes of an image's levels. From one to the next, the sides whose texels are the shorter ones are halved, or
   both if texels are about square. Returns the number of floats of all. */
static size_t spsi_image_size(const spsi_projection *projection, spsi_image *image) {
    int size[2] = {projection->width, projection->height}, level = 0;
    double edge[2] = {projection->edge[0], projection->edge[1]}, shortest = fmin(edge[0], edge[1]);
    const double unit = shortest;
    size_t floats = 0;
    for (;;) {
        image->width[level] = size[0] + 2;
        image->height[level] = size[1] + 2;
        image->edge[level] = (float)(shortest / unit);
        floats += spsi_image_level_floats(image, level++);
        if (size[0] == 1 && size[1] == 1) break;
        shortest = fmin(size[0] > 1 ? edge[0] : HUGE_VAL, size[1] > 1 ? edge[1] : HUGE_VAL);
        for (int k = 0; k < 2; ++k)
            if (size[k] > 1 && edge[k] < 1.5 * shortest) size[k] = (size[k] + 1) / 2, edge[k] *= 2;
        shortest *= 2;
    }
    image->level_count = level;
    return floats;
}

/* Bytes of all lights' images, and of the row that is being read. If they exceed a size_t: SIZE_MAX, which cannot be
   reserved. */
static size_t spsi_images_bytes(const spsi_frame *frame) {
    uint64_t bytes = (uint64_t)frame->lamps.image_count * sizeof(spsi_image), row = 0;
    for (int i = 0; i < frame->lamps.count; ++i) {
        const spsi_projection *projection = &frame->lamps.list[i].projection;
        const size_t width = (size_t)projection->width;
        spsi_image image;
        if (!projection->exists) continue;
        bytes += (uint64_t)spsi_image_size(projection, &image) * sizeof(float);
        if (width * SPSI_IMAGE_ROW_FLOATS * sizeof(float) > row) row = width * SPSI_IMAGE_ROW_FLOATS * sizeof(float);
    }
    return bytes + row < SIZE_MAX ? (size_t)(bytes + row) : SIZE_MAX;
}

/* Fails on an invalid color of a texel, or makes it black. */
static sps_result spsi_texel_validate(sps_context *context, const spsi_frame *frame, const spsi_lamp *lamp,
                                      float *rgb) {
    const float *bad = spsi_bad_color(rgb, SPSI_VALUE_MAX);
    if (!bad) return SPS_OK;
    if (!frame->replace_invalid)
        return spsi_fail_field(context, SPS_ERROR_DATA, SPS_OBJECT_LIGHT, lamp->index, "projector.sample_fn's color",
                               (double)*bad, "red, green and blue must be 0..1e18");
    rgb[0] = rgb[1] = rgb[2] = 0;
    context->stats.values_replaced += 1;
    return SPS_OK;
}

/* Reads an image row by row; `row` has room for one. */
static sps_result spsi_image_read(sps_context *context, const spsi_frame *frame, const spsi_lamp *lamp, float *row,
                                  const spsi_image *image) {
    const spsi_projection *projection = &lamp->projection;
    const size_t width = (size_t)projection->width, pitch = (size_t)image->width[0];
    const size_t plane = pitch * (size_t)image->height[0];
    float *rgb = row + 2 * width;
    for (int y = 0; y < projection->height; ++y) {
        int returned;
        if (spsi_progress(context, 0)) return context->result;
        for (size_t x = 0; x < width; ++x) {
            row[2 * x] = (float)(((double)x + 0.5) / projection->width);
            row[2 * x + 1] = (float)((y + 0.5) / projection->height);
        }
        memset(rgb, 0, 3 * width * sizeof *rgb);
        context->stats.projector_calls += 1;
        returned = projection->sample_fn(projection->user, width, row, rgb);
        if (returned)
            return spsi_fail_field(context, SPS_ERROR_CALLBACK, SPS_OBJECT_LIGHT, lamp->index, "projector.sample_fn",
                                   returned, NULL);
        for (size_t x = 0; x < width; ++x) {
            float *to = image->texels[0] + (size_t)(y + 1) * pitch + x + 1;
            if (spsi_texel_validate(context, frame, lamp, rgb + 3 * x)) return context->result;
            for (size_t c = 0; c < 3; ++c) to[c * plane] = rgb[3 * x + c];
        }
    }
    return SPS_OK;
}

/* The texels of a row of `fine` that texel i of a row of `coarse` covers, and the share of each: three at most. */
static int spsi_halving(int fine, int coarse, int i, float shares[3]) {
    const double per = (double)fine / coarse, low = i * per, high = low + per;
    const int first = (int)low;
    for (int k = 0; k < 3; ++k) shares[k] = (float)(fmax(fmin(high, first + k + 1) - fmax(low, first + k), 0) / per);
    return first;
}

/* Fills one texel of a level from the level before, three planes of it. */
static void spsi_image_halve_texel(const spsi_image *image, int level, int x, int y) {
    const size_t from_pitch = (size_t)image->width[level - 1], pitch = (size_t)image->width[level];
    const size_t from_plane = from_pitch * (size_t)image->height[level - 1];
    const size_t plane = pitch * (size_t)image->height[level];
    float across[3], down[3];
    const int x0 = spsi_halving(image->width[level - 1] - 2, image->width[level] - 2, x, across);
    const int y0 = spsi_halving(image->height[level - 1] - 2, image->height[level] - 2, y, down);
    for (size_t c = 0; c < 3; ++c) {
        float sum = 0;
        for (int k = 0; k < 9; ++k) {
            const float share = across[k % 3] * down[k / 3];
            if (share > 0)
                sum += share * image->texels[level - 1][c * from_plane + (size_t)(y0 + 1 + k / 3) * from_pitch +
                                                        (size_t)(x0 + 1 + k % 3)];
        }
        image->texels[level][c * plane + (size_t)(y + 1) * pitch + (size_t)(x + 1)] = sum;
    }
}

static void spsi_image_halve(const spsi_image *image) {
    for (int level = 1; level < image->level_count; ++level)
        for (int y = 0; y < image->height[level] - 2; ++y)
            for (int x = 0; x < image->width[level] - 2; ++x) spsi_image_halve_texel(image, level, x, y);
}

/* Lays out an image's levels in memory. Returns what follows them. */
static float *spsi_image_lay_out(const spsi_projection *projection, float *memory, spsi_image *image) {
    spsi_image_size(projection, image);
    for (int level = 0; level < image->level_count; ++level) {
        image->texels[level] = memory;
        memory += spsi_image_level_floats(image, level);
    }
    return memory;
}

/* Reads the images of all lights. */
static sps_result spsi_gather_images(sps_context *context, const spsi_frame *frame) {
    const size_t bytes = spsi_images_bytes(frame);
    spsi_image *images;
    float *row;
    if (frame->lamps.image_count == 0) return SPS_OK;
    images = (spsi_image *)spsi_reserve(context, SPSI_BUFFER_IMAGES, 1, bytes);
    if (!images) return context->result;
    memset(images, 0, bytes);
    row = (float *)(void *)(images + frame->lamps.image_count);
    for (int i = 0; i < frame->lamps.count; ++i) {
        const spsi_projection *projection = &frame->lamps.list[i].projection;
        if (projection->exists) row = spsi_image_lay_out(projection, row, &images[projection->image]);
    }
    for (int i = 0; i < frame->lamps.count; ++i) {
        const spsi_lamp *lamp = &frame->lamps.list[i];
        if (!lamp->projection.exists) continue;
        if (spsi_image_read(context, frame, lamp, row, &images[lamp->projection.image])) return context->result;
        spsi_image_halve(&images[lamp->projection.image]);
    }
    frame->content->images = images;
    return SPS_OK;
}

/* Whether any of a vector of lookups may find something: where pixels have `size` texels, the image ends less than
   twice that beyond its edges. */
static int spsi_image_meets(const spsi_image *image, spsi_v x, spsi_v y, spsi_v size) {
    const spsi_v margin = spsi_add(spsi_max(size, spsi_set(1)), size), before = spsi_sub(spsi_set(0), margin);
    const spsi_v after_x = spsi_add(margin, spsi_set((float)image->width[0]));
    const spsi_v after_y = spsi_add(margin, spsi_set((float)image->height[0]));
    return spsi_bits(spsi_and(spsi_and(spsi_less(before, x), spsi_less(x, after_x)),
                              spsi_and(spsi_less(before, y), spsi_less(y, after_y)))) != 0;
}

/* Color of an image at texel (x, y) of its largest level, as seen by pixels of `size` texels. */
static void spsi_image_lookup(const spsi_image *image, spsi_v x, spsi_v y, spsi_v size, spsi_v rgb[3]) {
    const spsi_v zero = spsi_set(0), one = spsi_set(1), half = spsi_set(0.5f);
    rgb[0] = rgb[1] = rgb[2] = zero;
    if (!spsi_image_meets(image, x, y, size)) return;
    for (int level = 0; level < image->level_count; ++level) {
        const int width = image->width[level], height = image->height[level];
        const float scale_x = (float)(width - 2) / (float)(image->width[0] - 2);
        const float scale_y = (float)(height - 2) / (float)(image->height[0] - 2);
        const float *edge = &image->edge[level];
        /* shares of levels: linear in size from one's edge to the next */
        spsi_v before = one, after = one, share, u, v;
        if (level > 0) before = spsi_mul(spsi_sub(size, spsi_set(edge[-1])), spsi_set(1 / (edge[0] - edge[-1])));
        if (level + 1 < image->level_count)
            after = spsi_mul(spsi_sub(spsi_set(edge[1]), size), spsi_set(1 / (edge[1] - edge[0])));
        share = spsi_clamp(spsi_min(before, after), zero, one);
        if (!spsi_bits(spsi_less(zero, share))) continue;
        u = spsi_fma(spsi_add(x, half), spsi_set(scale_x), half); /* texel centres, counted from the border's */
        v = spsi_fma(spsi_add(y, half), spsi_set(scale_y), half);
        for (int c = 0; c < 3; ++c) {
            const float *plane = image->texels[level] + (size_t)c * (size_t)width * (size_t)height;
            rgb[c] = spsi_fma(share, spsi_bilinear(plane, width, height, u, v), rgb[c]);
        }
    }
}

/* Color that a light's image has in the direction of points at `offset` from the light, as seen by pixels of world size
   `pixel`. Nothing is thrown backwards. */
static void spsi_projection_lookup(const spsi_frame *frame, const spsi_lamp *lamp, const spsi_v offset[3], spsi_v pixel,
                                   spsi_v rgb[3]) {
    const spsi_projection *projection = &lamp->projection;
    const float per_edge = (float)(1 / fmin(projection->edge[0], projection->edge[1]));
    spsi_v row[3], at[2], way = spsi_set(1), size = spsi_mul(pixel, spsi_set(per_edge));
    spsi_m ahead = spsi_less(spsi_set(0), way);
    if (lamp->is_point) {
        spsi_set3(projection->forward, row);
        way = spsi_dot_v(row, offset);
        ahead = spsi_less(spsi_set(FLT_MIN), way);
        way = spsi_max(way, spsi_set(FLT_MIN));
        size = spsi_div(size, way);
    }
    for (int k = 0; k < 2; ++k) {
        spsi_set3(projection->across[k], row);
        at[k] = spsi_add(spsi_div(spsi_dot_v(row, offset), way), spsi_set((float)projection->add[k]));
    }
    spsi_image_lookup(&frame->content->images[projection->image], at[0], at[1], size, rgb);
    for (int c = 0; c < 3; ++c) rgb[c] = spsi_select(ahead, rgb[c], spsi_set(0));
}

/* The same for one point. */
static void spsi_projection_at(const spsi_frame *frame, const spsi_lamp *lamp, const double point[3], double pixel,
                               double rgb[3]) {
    double offset[3];
    spsi_v place[3], color[3];
    float lanes[SPSI_LANES];
    spsi_along(point, lamp->position, -1, offset);
    spsi_set3(offset, place);
    spsi_projection_lookup(frame, lamp, place, spsi_set((float)pixel), color);
    for (int c = 0; c < 3; ++c) {
        spsi_store(lanes, color[c]);
        rgb[c] = (double)lanes[0];
    }
}

/* ============================================================================================ >>depthmaps
   17 Polygons as gas sees them between itself and a light. Cost: the rasteriser's, and 12 bytes per texel; six faces
   have 1.5 times the texels of one. */

#define SPSI_CELL  16   /* texels along a side of a depth map's cell */
#define SPSI_STEEP 1024 /* maximum rise of a depth map's planes from texel to texel, in texels */

/* For each texel, the plane of the polygon nearest to the light, which is evaluated on the gas's own ray. So a plane
   shades nothing in front of it, however slanted it is; the texel size shows only at a polygon's edge. */
typedef struct spsi_depth_map {
    int face_count; /* 0: no polygons; 1; 6 for a point light amid the gas */
    spsi_rays rays[SPSI_CUBE_FACES];
    float *depths[SPSI_CUBE_FACES];    /* at texel centres, t - depth_reference; infinity: no polygon */
    float *slopes[SPSI_CUBE_FACES][2]; /* rise of the plane from texel to texel along x and y */
    float *nearest[SPSI_CUBE_FACES];   /* per cell: minimum depth in it and the cells around it */
    int cells[SPSI_CUBE_FACES];        /* per row */
    /* ray coordinates of the map along the eye's rays; t is relative to the map's depth reference */
    spsi_linear along[SPSI_CUBE_FACES][3];
} spsi_depth_map;

/* Texels on a side of a light's depth map: finer than the light's sheets where the quality says so, since it is
   cheap. */
static int spsi_depth_map_size(const spsi_frame *frame) {
    return spsi_most(8, spsi_most(frame->view.shadow_size, frame->accuracy.depth_map_texels));
}

/* Number of cells on a side of a map of `size` texels. */
static int spsi_depth_map_cells(int size) { return (size + SPSI_CELL - 1) / SPSI_CELL; }

static size_t spsi_depth_map_floats(const spsi_depth_map *map) {
    size_t floats = 0;
    for (int face = 0; face < map->face_count; ++face) {
        const spsi_rays *rays = &map->rays[face];
        floats += 3 * spsi_ray_count(rays);
        floats += 2 * (size_t)spsi_depth_map_cells(rays->width) * (size_t)spsi_depth_map_cells(rays->height);
    }
    return floats;
}

/* Its maximum for a map of `size` texels on a side, or six of half that size. */
static size_t spsi_depth_map_floats_most(size_t size) {
    const size_t cells = size / SPSI_CELL + 2, texels = size * size / 2 * 3 + SPSI_CUBE_FACES * 64;
    return 3 * texels + 2 * SPSI_CUBE_FACES * cells * cells;
}

/* Lays out a depth map in memory, and returns the memory after it. */
static float *spsi_depth_map_lay_out(spsi_depth_map *map, float *memory) {
    for (int face = 0; face < map->face_count; ++face) {
        const spsi_rays *rays = &map->rays[face];
        const size_t texels = spsi_ray_count(rays);
        map->depths[face] = memory;
        map->slopes[face][0] = memory + texels;
        map->slopes[face][1] = memory + 2 * texels;
        map->nearest[face] = memory + 3 * texels;
        map->cells[face] = spsi_depth_map_cells(rays->width);
        memory = map->nearest[face] + 2 * (size_t)map->cells[face] * (size_t)spsi_depth_map_cells(rays->height);
    }
    return memory;
}

/* Aims a light's depth map: a single face fitted to the gas, however far the polygons reach, or six where a point light
   does not see all gas within a cone. */
static void spsi_depth_map_aim(const spsi_frame *frame, const spsi_lamp *lamp, int size, spsi_depth_map *map) {
    map->face_count = 1;
    if (spsi_rays_fit(lamp, &frame->content->bounds, 1, size, size, &map->rays[0])) return;
    map->face_count = SPSI_CUBE_FACES;
    for (int face = 0; face < SPSI_CUBE_FACES; ++face) /* they overlap by a texel */
        spsi_rays_of_cube_face(lamp->position, face, spsi_most(8, size / 2), 1, &map->rays[face]);
}

/* --- filling a depth map --- */

typedef struct spsi_planes_job {
    const spsi_faces *faces;
    const spsi_depth_map *map;
    float *alone; /* per cell: minimum depth in it alone */
    int face;
} spsi_planes_job;

/* A plane as a depth map's rays meet it. With n its normal and r a texel's ray, t changes by -(n.a) / (n.r) from texel
   to texel, times t itself in perspective. */
typedef struct spsi_map_plane {
    int number;       /* of its face; -1: none */
    double a, b;      /* n.a and n.b, with the rays' steps from texel to texel */
    double normal[3]; /* n */
    double texel;     /* size of a step */
} spsi_map_plane;

static void spsi_map_plane_build(const spsi_faces *faces, int number, const spsi_rays *rays, spsi_map_plane *plane) {
    const spsi_face *face = &faces->list[number];
    double u[3], v[3];
    spsi_along(face->position[1], face->position[0], -1, u);
    spsi_along(face->position[2], face->position[0], -1, v);
    spsi_cross(u, v, plane->normal);
    plane->a = spsi_dot(plane->normal, rays->a);
    plane->b = spsi_dot(plane->normal, rays->b);
    plane->texel = spsi_length(rays->a);
    plane->number = number;
}

/* The slope -t (n.a) / (n.r), clamped where the ray grazes the plane. */
static float spsi_map_slope(double across, double facing, double t, double steepest) {
    const double slope = -t * across / facing;
    return (float)(slope >= -steepest && slope <= steepest ? slope : slope > 0 ? steepest : -steepest);
}

/* The slopes at a texel where the plane has this depth. Returns the minimum that it reaches within a texel. */
static float spsi_map_plane_slopes(const spsi_map_plane *plane, const spsi_rays *rays, int x, int y, float depth,
                                   float slope[2]) {
    double ray[3], facing, t = 1;
    spsi_ray_direction(rays, x, y, ray);
    facing = spsi_dot(plane->normal, ray);
    if (rays->perspective) t = (double)depth + rays->depth_reference;
    slope[0] = spsi_map_slope(plane->a, facing, t, SPSI_STEEP * t * plane->texel);
    slope[1] = spsi_map_slope(plane->b, facing, t, SPSI_STEEP * t * plane->texel);
    return depth - fabsf(slope[0]) - fabsf(slope[1]);
}

/* Replaces the face numbers that the rasteriser left in one row of texels by the slopes of their planes, and lowers the
   row's cells to the minimum that its planes reach within a texel. */
static void spsi_planes_row(const spsi_planes_job *job, int y, float *cells) {
    const spsi_depth_map *map = job->map;
    const spsi_rays *rays = &map->rays[job->face];
    const size_t first = (size_t)y * (size_t)rays->width;
    spsi_map_plane plane = {-1, 0, 0, {0, 0, 0}, 0};
    for (int x = 0; x < rays->width; ++x) {
        float *along_x = &map->slopes[job->face][0][first + (size_t)x];
        float *along_y = &map->slopes[job->face][1][first + (size_t)x];
        float slope[2] = {0, 0}, least = SPSI_INFINITY;
        int number;
        memcpy(&number, along_y, sizeof number);
        if (number >= 0) {
            if (number != plane.number) spsi_map_plane_build(job->faces, number, rays, &plane);
            least = spsi_map_plane_slopes(&plane, rays, x, y, map->depths[job->face][first + (size_t)x], slope);
        }
        *along_x = slope[0];
        *along_y = slope[1];
        cells[x / SPSI_CELL] = spsi_lower(cells[x / SPSI_CELL], least);
    }
}

/* Fills one row of cells. */
static void spsi_planes_task(void *data, int index, int worker) {
    const spsi_planes_job *job = (const spsi_planes_job *)data;
    const int columns = job->map->cells[job->face], height = job->map->rays[job->face].height;
    float *cells = job->alone + (size_t)index * (size_t)columns;
    (void)worker;
    for (int i = 0; i < columns; ++i) cells[i] = SPSI_INFINITY;
    for (int y = index * SPSI_CELL; y < spsi_least(height, (index + 1) * SPSI_CELL); ++y)
        spsi_planes_row(job, y, cells);
}

/* Computes the minimum depth in each cell and the cells around it from the minimum in each alone. */
static void spsi_depth_map_spread(const spsi_depth_map *map, int face, const float *alone) {
    const int columns = map->cells[face], rows = spsi_depth_map_cells(map->rays[face].height);
    for (int row = 0; row < rows; ++row)
        for (int column = 0; column < columns; ++column) {
            float least = SPSI_INFINITY;
            for (int y = spsi_most(row - 1, 0); y <= spsi_least(row + 1, rows - 1); ++y)
                for (int x = spsi_most(column - 1, 0); x <= spsi_least(column + 1, columns - 1); ++x)
                    least = spsi_lower(least, alone[y * columns + x]);
            map->nearest[face][row * columns + column] = least;
        }
}

/* Rasterises the polygons into a depth map, as the light sees them. */
static void spsi_depth_map_fill(sps_context *context, const spsi_faces *faces, spsi_depth_map *map) {
    spsi_planes_job job;
    job.faces = faces;
    job.map = map;
    for (job.face = 0; job.face < map->face_count; ++job.face) {
        const spsi_rays *rays = &map->rays[job.face];
        spsi_rasterise(context, faces, rays, NULL, map->depths[job.face], (int *)(void *)map->slopes[job.face][1]);
        job.alone = map->nearest[job.face] + (size_t)map->cells[job.face] * (size_t)spsi_depth_map_cells(rays->height);
        spsi_parallel(context, spsi_depth_map_cells(rays->height), spsi_planes_task, &job);
        spsi_depth_map_spread(map, job.face, job.alone);
    }
}

/* --- looking up a depth map --- */

/* Prepares lookups along the eye's rays. */
static void spsi_depth_map_follow(const spsi_rays *eye, spsi_depth_map *map) {
    for (int face = 0; face < map->face_count; ++face)
        for (int i = 0; i < 3; ++i)
            spsi_linear_build(eye, map->rays[face].inverse[i], map->rays[face].origin,
                              i == 2 ? -map->rays[face].depth_reference : 0, &map->along[face][i]);
}

/* Ways from d0 to d1 along the eye's rays, on a face of a depth map. */
typedef struct spsi_map_way {
    spsi_v middle[3], rise[3]; /* texel and depth of its middle, relative to the texel (ix, iy), and half its extent */
    spsi_v ix, iy;             /* the first of the four texels around it */
    spsi_m inside;             /* of the grid */
} spsi_map_way;

static inline void spsi_map_way_build(const spsi_depth_map *map, int face, spsi_v at, float y, spsi_v d0, spsi_v d1,
                                      spsi_map_way *way) {
    const spsi_rays *rays = &map->rays[face];
    const spsi_v zero = spsi_set(0), half = spsi_set(0.5f), origin = spsi_set((float)rays->depth_reference);
    spsi_v q[2][3];
    for (int i = 0; i < 3; ++i) {
        const spsi_v base = spsi_linear_base(&map->along[face][i], at, y);
        const spsi_v change = spsi_linear_slope(&map->along[face][i], at, y);
        q[0][i] = spsi_fma(d0, change, base);
        q[1][i] = spsi_fma(d1, change, base);
    }
    way->inside = spsi_less(spsi_set(rays->perspective ? FLT_MIN * 16 : -FLT_MAX),
                            rays->perspective ? spsi_add(spsi_min(q[0][2], q[1][2]), origin) : zero);
    for (int end = 0; end < 2 && rays->perspective; ++end) {
        const spsi_v t = spsi_max(spsi_add(q[end][2], origin), spsi_set(FLT_MIN * 16));
        for (int i = 0; i < 2; ++i) q[end][i] = spsi_div(q[end][i], t);
    }
    for (int i = 0; i < 3; ++i) {
        const float size = (float)(i == 0 ? rays->width - 1 : rays->height - 1);
        way->middle[i] = spsi_mul(half, spsi_add(q[0][i], q[1][i]));
        way->rise[i] = spsi_mul(half, spsi_sub(q[1][i], q[0][i]));
        if (i == 2) break;
        way->inside =
            spsi_and(way->inside, spsi_and(spsi_less(zero, way->middle[i]), spsi_less(way->middle[i], spsi_set(size))));
        way->middle[i] = spsi_clamp(way->middle[i], zero, spsi_set(size));
    }
    way->ix = spsi_min(spsi_floor(way->middle[0]), spsi_set((float)(rays->width - 2)));
    way->iy = spsi_min(spsi_floor(way->middle[1]), spsi_set((float)(rays->height - 2)));
    way->middle[0] = spsi_sub(way->middle[0], way->ix);
    way->middle[1] = spsi_sub(way->middle[1], way->iy);
}

/* The share of a way that lies before a plane: that of the i-th of the four texels. How far a point is in front of it
   is linear along the way: `ahead` in its middle, and `per` more or less at either end. In perspective a plane of slope
   g reaches g / (1 - g / t) beyond the texel's own depth t. */
static inline spsi_v spsi_map_way_share(const spsi_map_way *way, const spsi_rays *rays, int i, spsi_v depth,
                                        const spsi_v slope[2]) {
    const spsi_v zero = spsi_set(0), one = spsi_set(1), half = spsi_set(0.5f),
                 origin = spsi_set((float)rays->depth_reference);
    const spsi_v dx = spsi_sub(way->middle[0], spsi_set((float)(i & 1))),
                 dy = spsi_sub(way->middle[1], spsi_set((float)(i >> 1)));
    const spsi_v bent = rays->perspective ? spsi_div(one, spsi_add(depth, origin)) : zero;
    spsi_v up = spsi_fma(slope[0], dx, spsi_mul(slope[1], dy)), ahead, per;
    ahead = spsi_div(up, spsi_max(spsi_sub(one, spsi_mul(up, bent)), spsi_set(1e-6f)));
    ahead = spsi_sub(spsi_add(depth, ahead), way->middle[2]);
    per = spsi_abs(spsi_sub(spsi_fma(slope[0], way->rise[0], spsi_mul(slope[1], way->rise[1])), way->rise[2]));
    return spsi_clamp(spsi_fma(half, spsi_div(ahead, spsi_max(per, spsi_set(FLT_MIN * 16))), half), zero, one);
}

/* The mean of four texels' values, by their distance. */
static inline spsi_v spsi_map_way_mean(const spsi_map_way *way, const spsi_v texels[4]) {
    return spsi_mix(spsi_mix(texels[0], texels[1], way->middle[0]), spsi_mix(texels[2], texels[3], way->middle[0]),
                    way->middle[1]);
}

/* The share of the way from d0 to d1 that one face of a depth map leaves lit; 1 outside of its grid. */
static inline spsi_v spsi_depth_map_share(const spsi_depth_map *map, int face, spsi_v at, float y, spsi_v d0,
                                          spsi_v d1) {
    const spsi_rays *rays = &map->rays[face];
    spsi_v share[4], depth[4], slopes[2][4];
    spsi_map_way way;
    spsi_map_way_build(map, face, at, y, d0, d1, &way);
    spsi_lookup_quad(map->depths[face], rays->width, way.ix, way.iy, depth);
    for (int i = 0; i < 2; ++i) spsi_lookup_quad(map->slopes[face][i], rays->width, way.ix, way.iy, slopes[i]);
    for (int i = 0; i < 4; ++i) {
        const spsi_v slope[2] = {slopes[0][i], slopes[1][i]};
        share[i] = spsi_map_way_share(&way, rays, i, depth[i], slope);
    }
    return spsi_select(way.inside, spsi_map_way_mean(&way, share), spsi_set(1));
}

/* Whether a face of a depth map may shade any of the ways from d0 to d1: one lookup of a cell, which spares most slabs
   the lookups of four texels' planes. Both ends must lie within a cell of the middle's, or the answer is yes. */
static inline int spsi_depth_map_may_shade(const spsi_depth_map *map, int face, spsi_v at, float y, spsi_v d0,
                                           spsi_v d1) {
    const spsi_rays *rays = &map->rays[face];
    const float size[2] = {(float)(rays->width - 1), (float)(rays->height - 1)};
    const spsi_v zero = spsi_set(0), half = spsi_set(0.5f), near_t = spsi_set(FLT_MIN * 16);
    spsi_v q[2][3], cell[2], deepest;
    int clear = 0; /* bit mask of lanes that miss the face */
    int wide = 0;  /* bit mask of lanes that may be shaded, if only because their ends are too far apart to tell */
    for (int i = 0; i < 3; ++i) {
        const spsi_v slope = spsi_linear_slope(&map->along[face][i], at, y);
        const spsi_v base = spsi_linear_base(&map->along[face][i], at, y);
        q[0][i] = spsi_fma(d0, slope, base);
        q[1][i] = spsi_fma(d1, slope, base);
    }
    deepest = spsi_max(q[0][2], q[1][2]);
    if (rays->perspective) {
        for (int end = 0; end < 2; ++end) q[end][2] = spsi_add(q[end][2], spsi_set((float)rays->depth_reference));
        clear = spsi_bits(spsi_less(spsi_max(q[0][2], q[1][2]), near_t));
        wide = spsi_bits(spsi_less(spsi_min(q[0][2], q[1][2]), near_t));
        for (int end = 0; end < 2; ++end)
            for (int i = 0; i < 2; ++i) q[end][i] = spsi_div(q[end][i], spsi_max(q[end][2], near_t));
    }
    for (int i = 0; i < 2; ++i) {
        const spsi_v low = spsi_min(q[0][i], q[1][i]), high = spsi_max(q[0][i], q[1][i]);
        clear |= (spsi_bits(spsi_less(high, zero)) | spsi_bits(spsi_less(spsi_set(size[i]), low))) & ~wide;
        wide |= spsi_bits(spsi_less(spsi_set(2 * SPSI_CELL - 4), spsi_sub(high, low)));
        cell[i] = spsi_clamp(spsi_mul(half, spsi_add(low, high)), zero, spsi_set(size[i]));
        cell[i] = spsi_floor(spsi_mul(cell[i], spsi_set(1.0f / SPSI_CELL)));
    }
    wide |= spsi_bits(spsi_less(spsi_lookup(map->nearest[face], map->cells[face], cell[0], cell[1]), deepest));
    return (wide & ~clear) != 0;
}

/* --- translucent polygons --- */

/* The plane of a translucent face at a texel. */
typedef struct spsi_pane {
    float depth, slope[2]; /* as those of a depth map */
    int face;
} spsi_pane;

/* All translucent faces on each texel's ray, as gas sees them between itself and a point of a light. */
typedef struct spsi_pane_map {
    spsi_depth_map grid;              /* without depths and slopes; `nearest` is that of the panes */
    uint32_t *first[SPSI_CUBE_FACES]; /* per texel: its first pane */
    spsi_pane *list[SPSI_CUBE_FACES];
    size_t counts[SPSI_CUBE_FACES];
} spsi_pane_map;

/* Bytes of what a pane map holds per texel and per cell. */
static size_t spsi_pane_map_bytes(const spsi_pane_map *map) {
    size_t bytes = 0;
    for (int face = 0; face < map->grid.face_count; ++face) {
        const spsi_rays *rays = &map->grid.rays[face];
        bytes += (spsi_ray_count(rays) + 2) * sizeof(uint32_t);
        bytes +=
            2 * sizeof(float) * (size_t)spsi_depth_map_cells(rays->width) * (size_t)spsi_depth_map_cells(rays->height);
    }
    return bytes;
}

/* Lays out a pane map in memory, and returns the memory after it. */
static char *spsi_pane_map_lay_out(spsi_pane_map *map, char *memory) {
    for (int face = 0; face < map->grid.face_count; ++face) {
        const spsi_rays *rays = &map->grid.rays[face];
        const int columns = spsi_depth_map_cells(rays->width);
        map->first[face] = (uint32_t *)(void *)memory;
        map->grid.nearest[face] = (float *)(void *)(map->first[face] + spsi_ray_count(rays) + 2);
        map->grid.cells[face] = columns;
        memory = (char *)(map->grid.nearest[face] + 2 * (size_t)columns * (size_t)spsi_depth_map_cells(rays->height));
    }
    return memory;
}

typedef struct spsi_panes_job {
    const spsi_faces *faces;
    const spsi_fragment *fragments;
    spsi_pane_map *map;
    int face;
    float *alone; /* as in spsi_planes_job */
} spsi_panes_job;

/* Turns the fragments of one row of texels into panes. */
static void spsi_panes_row(const spsi_panes_job *job, int y, float *cells) {
    spsi_pane_map *map = job->map;
    const spsi_rays *rays = &map->grid.rays[job->face];
    const uint32_t *first = map->first[job->face] + (size_t)y * (size_t)rays->width;
    spsi_map_plane plane = {-1, 0, 0, {0, 0, 0}, 0};
    for (int x = 0; x < rays->width; ++x)
        for (uint32_t i = first[x]; i < first[x + 1]; ++i) {
            const spsi_fragment *fragment = &job->fragments[i];
            spsi_pane *pane = &map->list[job->face][i];
            float least;
            if (fragment->face != plane.number) spsi_map_plane_build(job->faces, fragment->face, rays, &plane);
            least = spsi_map_plane_slopes(&plane, rays, x, y, fragment->depth, pane->slope);
            pane->depth = fragment->depth;
            pane->face = fragment->face;
            cells[x / SPSI_CELL] = spsi_lower(cells[x / SPSI_CELL], least);
        }
}

/* Fills one row of cells. */
static void spsi_panes_task(void *data, int index, int worker) {
    const spsi_panes_job *job = (const spsi_panes_job *)data;
    const int columns = job->map->grid.cells[job->face], height = job->map->grid.rays[job->face].height;
    float *cells = job->alone + (size_t)index * (size_t)columns;
    (void)worker;
    for (int i = 0; i < columns; ++i) cells[i] = SPSI_INFINITY;
    for (int y = index * SPSI_CELL; y < spsi_least(height, (index + 1) * SPSI_CELL); ++y) spsi_panes_row(job, y, cells);
}

/* The panes of one face of a map: counts them (listing 0) or lists them. */
static void spsi_panes_raster(sps_context *context, const spsi_frame *frame, const spsi_faces *faces,
                              spsi_pane_map *map, int face, int listing) {
    spsi_layers_job job;
    memset(&job, 0, sizeof job);
    job.frame = frame;
    job.faces = faces;
    job.rays = &map->grid.rays[face];
    job.fine = *job.rays;
    job.samples = 1;
    job.scratch = (char *)context->buffers[SPSI_BUFFER_LAYER_SAMPLES].data;
    job.first = map->first[face];
    job.fragments = (spsi_fragment *)context->buffers[SPSI_BUFFER_FRAGMENTS].data;
    if (!listing) {
        map->counts[face] = spsi_fragments_count(context, &job);
        return;
    }
    spsi_fragments_list(context, &job);
}

/* Lists the panes of a map, whose fragments have been counted. */
static void spsi_pane_map_fill(sps_context *context, const spsi_frame *frame, const spsi_faces *faces,
                               spsi_pane_map *map) {
    spsi_panes_job job;
    job.faces = faces;
    job.fragments = (const spsi_fragment *)context->buffers[SPSI_BUFFER_FRAGMENTS].data;
    job.map = map;
    for (job.face = 0; job.face < map->grid.face_count; ++job.face) {
        const int rows = spsi_depth_map_cells(map->grid.rays[job.face].height);
        spsi_panes_raster(context, frame, faces, map, job.face, 1);
        job.alone = map->grid.nearest[job.face] + (size_t)map->grid.cells[job.face] * (size_t)rows;
        spsi_parallel(context, rows, spsi_panes_task, &job);
        spsi_depth_map_spread(&map->grid, job.face, job.alone);
    }
}

/* A way along an eye's ray on a face of a pane map: its middle and half of its extent, in texels and depth. */
typedef struct spsi_pane_way {
    float middle[3], rise[3];
    int x, y; /* the first of the four texels around it */
} spsi_pane_way;

/* The share of a way that lies before a pane of texel (x + dx, y + dy); see spsi_map_way_share. */
static float spsi_pane_share(const spsi_rays *rays, const spsi_pane *pane, const spsi_pane_way *way, int dx, int dy) {
    const float bent = rays->perspective ? 1 / (pane->depth + (float)rays->depth_reference) : 0;
    const float up = pane->slope[0] * (way->middle[0] - (float)(way->x + dx)) +
                     pane->slope[1] * (way->middle[1] - (float)(way->y + dy));
    const float ahead = pane->depth + up / fmaxf(1 - up * bent, 1e-6f) - way->middle[2];
    const float per = fabsf(pane->slope[0] * way->rise[0] + pane->slope[1] * way->rise[1] - way->rise[2]);
    return fminf(fmaxf(0.5f + 0.5f * ahead / fmaxf(per, FLT_MIN * 16), 0), 1);
}

/* What the panes of the four texels around a way let pass, by color: each filters the share of the way behind it. */
static void spsi_panes_through(const spsi_pane_map *map, int face, const spsi_faces *faces, const spsi_pane_way *way,
                               float through[3]) {
    const spsi_rays *rays = &map->grid.rays[face];
    for (int c = 0; c < 3; ++c) through[c] = 0;
    for (int i = 0; i < 4; ++i) {
        const int dx = i & 1, dy = i >> 1;
        const size_t texel = (size_t)(way->y + dy) * (size_t)rays->width + (size_t)(way->x + dx);
        float weight[3];
        for (int c = 0; c < 3; ++c)
            weight[c] =
                (1 - fabsf(way->middle[0] - (float)(way->x + dx))) * (1 - fabsf(way->middle[1] - (float)(way->y + dy)));
        for (uint32_t n = map->first[face][texel]; n < map->first[face][texel + 1]; ++n) {
            const spsi_pane *pane = &map->list[face][n];
            const float lit = spsi_pane_share(rays, pane, way, dx, dy);
            for (int c = 0; c < 3; ++c) weight[c] *= lit + (1 - lit) * faces->list[pane->face].transmittance[c];
        }
        for (int c = 0; c < 3; ++c) through[c] += weight[c];
    }
}

/* A vector of ways on a face, and how far they are from the light along its axis. */
typedef struct spsi_pane_ways {
    spsi_v middle[3], rise[3], t;
} spsi_pane_ways;

/* The middle is projected, and the extent along with it, to first order: either end may be beyond the face. */
static void spsi_pane_ways_build(const spsi_pane_map *map, int face, spsi_v at, float y, const spsi_v d[2],
                                 spsi_pane_ways *ways) {
    const spsi_rays *rays = &map->grid.rays[face];
    const spsi_v half = spsi_set(0.5f), d_middle = spsi_mul(half, spsi_add(d[0], d[1]));
    const spsi_v d_rise = spsi_mul(half, spsi_sub(d[1], d[0]));
    for (int i = 0; i < 3; ++i) {
        const spsi_v change = spsi_linear_slope(&map->grid.along[face][i], at, y);
        ways->middle[i] = spsi_fma(d_middle, change, spsi_linear_base(&map->grid.along[face][i], at, y));
        ways->rise[i] = spsi_mul(d_rise, change);
    }
    ways->t = spsi_add(ways->middle[2], spsi_set((float)rays->depth_reference));
    for (int i = 0; i < 2 && rays->perspective; ++i) {
        const spsi_v t = spsi_max(ways->t, spsi_set(FLT_MIN * 16));
        ways->middle[i] = spsi_div(ways->middle[i], t);
        ways->rise[i] = spsi_div(spsi_sub(ways->rise[i], spsi_mul(ways->middle[i], ways->rise[2])), t);
    }
}

/* Filters the ways that a bit mask names, whose middle is on a face. */
static void spsi_pane_map_face(const spsi_pane_map *map, int face, const spsi_faces *faces, const spsi_pane_ways *ways,
                               int bits, float filter[3][SPSI_LANES]) {
    const spsi_rays *rays = &map->grid.rays[face];
    float middle[3][SPSI_LANES], rise[3][SPSI_LANES];
    for (int i = 0; i < 3; ++i) {
        spsi_store(middle[i], ways->middle[i]);
        spsi_store(rise[i], ways->rise[i]);
    }
    for (int lane = 0; bits >> lane; ++lane) {
        float through[3];
        spsi_pane_way way;
        if (!(bits >> lane & 1)) continue;
        for (int i = 0; i < 3; ++i) way.middle[i] = middle[i][lane], way.rise[i] = rise[i][lane];
        if (!(fabsf(way.middle[0]) < 1e9f) || !(fabsf(way.middle[1]) < 1e9f)) continue;
        way.middle[0] = fminf(fmaxf(way.middle[0], 0), (float)(rays->width - 1));
        way.middle[1] = fminf(fmaxf(way.middle[1], 0), (float)(rays->height - 1));
        way.x = spsi_least((int)way.middle[0], rays->width - 2);
        way.y = spsi_least((int)way.middle[1], rays->height - 2);
        spsi_panes_through(map, face, faces, &way, through);
        for (int c = 0; c < 3; ++c) filter[c][lane] = through[c];
    }
}

/* What translucent polygons let pass from a point of a light to the ways from d[0] to d[1], by color. Of six faces, the
   one that a way's middle is farthest along has it. */
static void spsi_pane_map_filter(const spsi_pane_map *map, const spsi_faces *faces, spsi_v at, float y,
                                 const spsi_v d[2], spsi_v filter[3]) {
    float lanes[3][SPSI_LANES];
    int left = (1 << SPSI_LANES) - 1;
    spsi_v farthest = spsi_set(-FLT_MAX);
    spsi_pane_ways ways;
    for (int c = 0; c < 3; ++c)
        for (int i = 0; i < SPSI_LANES; ++i) lanes[c][i] = 1;
    for (int face = 0; face < map->grid.face_count && map->grid.face_count > 1; ++face) {
        spsi_pane_ways_build(map, face, at, y, d, &ways);
        farthest = spsi_max(farthest, ways.t);
    }
    for (int face = 0; face < map->grid.face_count; ++face) {
        int bits = left;
        if (map->grid.face_count > 1 || spsi_depth_map_may_shade(&map->grid, face, at, y, d[0], d[1]))
            spsi_pane_ways_build(map, face, at, y, d, &ways);
        else
            continue;
        if (map->grid.face_count > 1) bits &= ~spsi_bits(spsi_less(ways.t, farthest));
        spsi_pane_map_face(map, face, faces, &ways, bits, lanes);
        left &= ~bits;
    }
    for (int c = 0; c < 3; ++c) filter[c] = spsi_load(lanes[c]);
}

/* ================================================================================================ >>balls
   18 Particles as a set of rays sees them. The ray with direction e meets a ball of radius r about C in a chord about
   t = C.e / e.e, of half length sqrt(1 - d^2) r, where d r = |C x e| / |e|. All of this is relative to the ball's own
   centre, in pixels and in t, which makes it short polynomials without differences of large numbers, so floats suffice.
   Balls that contain the rays' origin, or are close to it, are intersected one ray at a time. Cost: 15 operations per
   vector of pixels. */

/* A ball is near if it is within SPSI_BALL_NEAR radii of the origin's plane, or if the cosine between its rays and the
   axis is below SPSI_BALL_ASIDE, since pixels are stretched there. */
#define SPSI_BALL_NEAR  4.0
#define SPSI_BALL_ASIDE 0.05
#define SPSI_BALL_LEAST 0.75 /* minimum radius in pixels; a smaller ball could fall between rays */

/* A ball, with (dx, dy) a pixel's offset from the centre's, e its ray and c the centre's ray. With p = tilt . (dx, dy)
   and q = bend[0] dx^2 + 2 bend[1] dx dy + bend[2] dy^2, e.e / c.c = 1 + 2p + q in perspective. */
typedef struct spsi_ball {
    int x0, y0, x1, y1; /* pixels that it may cover, inclusive; x1 < x0: none */
    float x, y;         /* pixel of its centre, relative to (x0, y0) */
    float t;            /* t - depth_reference of its centre */
    float radius;       /* in t, at the centre */
    float cross[3];     /* d^2 e.e / c.c = cross[0] dx^2 + 2 cross[1] dx dy + cross[2] dy^2 */
    float tilt[2];      /* coefficients of p */
    float bend[3];      /* coefficients of q; 0 without perspective */
    float shift;        /* the chord's middle lies shift (p + q) / (e.e / c.c) behind the centre */
    float depth;        /* optical depth along the diameter */
    int soft;           /* 1: densest in the middle */
    float offset[3];    /* of the centre from the rays' origin */
    int near_by;        /* 1: near the rays' origin, so intersected one ray at a time */
    float world_radius; /* of a near ball */
} spsi_ball;

/* The chords in which a vector of rays meets a ball. */
typedef struct spsi_chord {
    spsi_v middle; /* t - depth_reference of the chord's middle */
    spsi_v half;   /* half its length, in t */
    spsi_v share;  /* half its length per radius; 0: missed */
} spsi_chord;

/* Distance of a point along the rays, in t; the same for all faces of a cube. 1 where pixels have the same size
   everywhere. */
static double spsi_distance_to(const spsi_rays *rays, const double offset[3]) {
    if (!rays->perspective) return 1;
    if (rays->is_cube_face) return fmax(fabs(offset[0]), fmax(fabs(offset[1]), fabs(offset[2])));
    return fmax(spsi_dot(rays->inverse[2], offset), 0);
}

/* The particle's radius, raised to the minimum that pixels allow, and its optical depth, reduced by as much as the area
   has grown. `offset`: of its centre from the rays' origin. */
static void spsi_ball_size(const spsi_rays *rays, const spsi_particle_set *set, const sps_particle *particle,
                           const double offset[3], spsi_ball *ball, double *radius) {
    const double pixel = fmax(spsi_length(rays->a), spsi_length(rays->b)) * spsi_distance_to(rays, offset);
    const double own = (double)particle->radius, shape = set->soft ? 4.0 / 3 : 2.0;
    double depth = (double)particle->optical_depth;
    if (set->is_extinction) depth *= shape * own;
    *radius = fmax(own, SPSI_BALL_LEAST * pixel);
    if (own < *radius) depth *= (own / *radius) * (own / *radius);
    ball->depth = (float)fmin(depth, (double)SPSI_DEPTH_MAX);
    ball->soft = set->soft;
}

/* The outline of a ball: a dx^2 + 2 b dx dy + c dy^2 - 2 d dx - 2 e dy = 1. */
typedef struct spsi_outline {
    double a, b, c, d, e;
} spsi_outline;

/* Range of pixels, of `size`, that lie within the outline along dx. */
static void spsi_outline_range(const spsi_outline *outline, double centre, int size, int *first, int *last) {
    const double a = outline->a, b = outline->b, c = outline->c, d = outline->d, e = outline->e;
    const double square = a * c - b * b, half = c * d - b * e;
    const double root = sqrt(fmax(half * half + square * (e * e + c), 0));
    *first = 0;
    *last = size - 1;
    if (!(square > 1e-12 * a * c) || !(a > 0)) return; /* not an ellipse: the eye's plane cuts it */
    *first = (int)fmin(fmax(ceil(centre + (half - root) / square), 0), size);
    *last = (int)fmax(fmin(floor(centre + (half + root) / square), size - 1), -1);
}

/* Fills in what depends on the direction of the rays. `c`: the ray's direction at the centre; q: the centre's pixel and
   t. */
static void spsi_ball_shape(const spsi_rays *rays, const double c[3], const double q[3], double radius,
                            spsi_ball *ball) {
    const double per_square = 1 / spsi_dot(c, c), t = rays->perspective ? q[2] : 1;
    const double per_radius = t * t * per_square / (radius * radius);
    double ca[3], cb[3], cross[3], bend[3] = {0, 0, 0}, tilt[2];
    spsi_cross(c, rays->a, ca);
    spsi_cross(c, rays->b, cb);
    cross[0] = spsi_dot(ca, ca) * per_radius;
    cross[1] = spsi_dot(ca, cb) * per_radius;
    cross[2] = spsi_dot(cb, cb) * per_radius;
    tilt[0] = spsi_dot(c, rays->a) * per_square;
    tilt[1] = spsi_dot(c, rays->b) * per_square;
    if (rays->perspective) {
        bend[0] = spsi_dot(rays->a, rays->a) * per_square;
        bend[1] = spsi_dot(rays->a, rays->b) * per_square;
        bend[2] = spsi_dot(rays->b, rays->b) * per_square;
    }
    {
        const double flat = rays->perspective;
        const spsi_outline along_x = {cross[0] - bend[0], cross[1] - bend[1], cross[2] - bend[2], flat * tilt[0],
                                      flat * tilt[1]};
        const spsi_outline along_y = {along_x.c, along_x.b, along_x.a, along_x.e, along_x.d};
        spsi_outline_range(&along_x, q[0], rays->width, &ball->x0, &ball->x1);
        spsi_outline_range(&along_y, q[1], rays->height, &ball->y0, &ball->y1);
    }
    for (int i = 0; i < 3; ++i) ball->cross[i] = (float)cross[i], ball->bend[i] = (float)bend[i];
    for (int i = 0; i < 2; ++i) ball->tilt[i] = (float)tilt[i];
    ball->shift = (float)-t;
    ball->radius = (float)(radius * sqrt(per_square));
}

/* Range of pixels along one axis between the two planes through the rays' origin that touch a ball: x solves
   (X - x T)^2 = r^2 |across - x along|^2. A ball that reaches behind the origin is bounded on one side only; one that
   contains the planes' common line is not bounded at all. */
static void spsi_ball_near_range(const double across[3], const double along[3], const double offset[3], double radius,
                                 int size, int *first, int *last) {
    const double x = spsi_dot(across, offset), t = spsi_dot(along, offset), square = radius * radius;
    const double a = t * t - square * spsi_dot(along, along), b = x * t - square * spsi_dot(across, along);
    const double c = x * x - square * spsi_dot(across, across), root = sqrt(fmax(b * b - a * c, 0));
    double low, high;
    *first = 0;
    *last = size - 1;
    if (!(root > 0) || !(fabs(a) > 1e-9 * t * t)) return;
    low = fmin((b - root) / a, (b + root) / a);
    high = fmax((b - root) / a, (b + root) / a);
    if (a > 0 || x - b / a * t > 0) *first = (int)fmin(fmax(ceil(a > 0 ? low : high), 0), size);
    if (a > 0 || !(x - b / a * t > 0)) *last = (int)fmax(fmin(floor(a > 0 ? high : low), size - 1), -1);
}

static void spsi_ball_build(const spsi_rays *rays, const spsi_particle_set *set, const sps_particle *particle,
                            spsi_ball *ball) {
    double centre[3], offset[3], q[3], c[3], radius, ahead;
    memset(ball, 0, sizeof *ball);
    for (int i = 0; i < 3; ++i) centre[i] = (double)particle->position[i];
    spsi_along(centre, rays->origin, -1, offset);
    spsi_project(rays, centre, q);
    spsi_ball_size(rays, set, particle, offset, ball, &radius);
    ball->x1 = ball->y1 = -1;
    ahead = q[2] / spsi_length(rays->inverse[2]); /* distance from the origin's plane, in the world */
    if (!(ball->depth > 0) || !(radius > 0) || (rays->perspective && !(ahead > -radius))) return;
    ball->near_by =
        rays->perspective && !(ahead > SPSI_BALL_NEAR * radius && ahead > SPSI_BALL_ASIDE * spsi_length(offset));
    ball->t = (float)(q[2] - rays->depth_reference);
    for (int i = 0; i < 3; ++i) ball->offset[i] = (float)offset[i];
    if (ball->near_by) {
        spsi_ball_near_range(rays->inverse[0], rays->inverse[2], offset, radius, rays->width, &ball->x0, &ball->x1);
        spsi_ball_near_range(rays->inverse[1], rays->inverse[2], offset, radius, rays->height, &ball->y0, &ball->y1);
        ball->world_radius = (float)radius;
        return;
    }
    spsi_ray_direction(rays, q[0], q[1], c);
    spsi_ball_shape(rays, c, q, radius, ball);
    ball->x = (float)(q[0] - ball->x0);
    ball->y = (float)(q[1] - ball->y0);
}

/* Intersects one ray with a near ball; returns 0 if it misses. The chord is as in spsi_chord. */
static int spsi_ball_meets(const spsi_rays *rays, const spsi_ball *ball, int x, int y, double chord[3]) {
    const double radius = (double)ball->world_radius;
    double centre[3], e[3], nearest[3], square, middle, share;
    for (int i = 0; i < 3; ++i) centre[i] = (double)ball->offset[i];
    spsi_ray_direction(rays, x, y, e);
    square = spsi_dot(e, e);
    middle = spsi_dot(centre, e) / square;
    spsi_along(centre, e, -middle, nearest); /* from the ray's nearest point: avoids a difference of large squares */
    share = 1 - spsi_dot(nearest, nearest) / (radius * radius);
    if (!(share > 0)) return 0;
    share = sqrt(share);
    chord[0] = middle - rays->depth_reference;
    chord[1] = radius * share / sqrt(square);
    chord[2] = share;
    return 1;
}

static void spsi_ball_chord_near(const spsi_rays *rays, const spsi_ball *ball, int x, int y, spsi_chord *chord) {
    float lanes[3][SPSI_LANES] = {{0}};
    for (int i = 0; i < SPSI_LANES; ++i) {
        double one[3];
        if (!spsi_ball_meets(rays, ball, x + i, y, one)) continue;
        for (int k = 0; k < 3; ++k) lanes[k][i] = (float)one[k];
    }
    chord->middle = spsi_load(lanes[0]);
    chord->half = spsi_load(lanes[1]);
    chord->share = spsi_load(lanes[2]);
}

/* The chords of a vector of pixels' rays, from (x, y) on. They also hold outside of x0 .. x1, wherever there is a
   ray. */
static inline void spsi_ball_chord(const spsi_rays *rays, const spsi_ball *ball, int x, int y, spsi_chord *chord) {
    const spsi_v one = spsi_set(1), zero = spsi_set(0);
    const float dy = (float)(y - ball->y0) - ball->y;
    const spsi_v dx = spsi_add(spsi_set((float)(x - ball->x0) - ball->x), spsi_iota());
    const spsi_v p = spsi_fma(dx, spsi_set(ball->tilt[0]), spsi_set(dy * ball->tilt[1]));
    spsi_v q, d, square, root;
    if (ball->near_by) {
        spsi_ball_chord_near(rays, ball, x, y, chord);
        return;
    }
    q = spsi_fma(dx, spsi_set(ball->bend[0]), spsi_set(2 * dy * ball->bend[1]));
    q = spsi_fma(dx, q, spsi_set(dy * dy * ball->bend[2]));
    d = spsi_fma(dx, spsi_set(ball->cross[0]), spsi_set(2 * dy * ball->cross[1]));
    d = spsi_fma(dx, d, spsi_set(dy * dy * ball->cross[2]));
    square = rays->perspective ? spsi_add(one, spsi_fma(spsi_set(2), p, q)) : one;
    root = spsi_div(one, spsi_sqrt(spsi_max(square, spsi_set(FLT_MIN))));
    chord->share = spsi_sqrt(spsi_max(spsi_sub(one, spsi_mul(d, spsi_mul(root, root))), zero));
    chord->half = spsi_mul(spsi_mul(chord->share, root), spsi_set(ball->radius));
    chord->middle = spsi_fma(spsi_mul(spsi_add(p, q), spsi_set(ball->shift)), spsi_mul(root, root), spsi_set(ball->t));
}

/* Optical depth along a vector of chords: the integral of 1, or of 1 - s^2 for a soft ball, over them. */
static inline spsi_v spsi_chord_depth(const spsi_ball *ball, const spsi_chord *chord) {
    const spsi_v depth = spsi_mul(chord->share, spsi_set(ball->depth));
    return ball->soft ? spsi_mul(depth, spsi_mul(chord->share, chord->share)) : depth;
}

/* The share of a chord that lies before position v in it, which is clamped to -1..1. */
static inline spsi_v spsi_chord_share(int soft, spsi_v v) {
    const spsi_v half = spsi_set(0.5f), s = spsi_clamp(v, spsi_set(-1), spsi_set(1));
    if (!soft) return spsi_fma(half, s, half);
    return spsi_fma(s, spsi_sub(spsi_set(0.75f), spsi_mul(spsi_set(0.25f), spsi_mul(s, s))), half);
}

/* ============================================================================================== >>slicing
   19 Slabs. They are perpendicular to s = normalise(e + l), where e and l are the directions in which the eye's and the
   light's rays travel, or to normalise(l - e) where these differ by more than a right angle; |l +- e| >= sqrt 2, so s
   never degenerates. Light always crosses slabs in the direction of s; in the second case the eye composites back to
   front. [Zhang & Crawfis, section 4] */

#define SPSI_COSINE_MIN  0.1  /* minimum of a ray with s, which then crosses a slab within 10 times its thickness */
#define SPSI_COSINE_EVEN 0.35 /* below this, slabs are halved; the middle ray has 0.71 or more */

typedef struct spsi_slabs {
    double normal[3]; /* s */
    double start;     /* s . p where the first slab begins */
    double thickness;
    int count;
} spsi_slabs;

/* Slab coordinate of a point: its integer part is the number of the slab. */
static double spsi_slab_at(const spsi_slabs *slabs, const double point[3]) {
    return (spsi_dot(slabs->normal, point) - slabs->start) / slabs->thickness;
}

static int spsi_chunk_count(const spsi_slabs *slabs) { return (slabs->count + SPSI_CHUNK - 1) / SPSI_CHUNK; }

/* Slab coordinate along rays. */
static void spsi_linear_of_slabs(const spsi_rays *rays, const spsi_slabs *slabs, spsi_linear *linear) {
    static const double zero[3] = {0, 0, 0};
    double row[3];
    for (int i = 0; i < 3; ++i) row[i] = slabs->normal[i] / slabs->thickness;
    spsi_linear_build(rays, row, zero, -slabs->start / slabs->thickness, linear);
}

typedef struct spsi_sweep {
    const spsi_lamp *lamp; /* the light whose sheets this sweep has; NULL: none */
    int first;             /* 1: also carries coverage, ambient light, emission, and all lights without sheets */
    int back_to_front;
    double cosine_of_light, cosine_of_eye; /* minimum of the rays with s */
    int part[4];                           /* of the image: its first column and row, and those beyond its last */
    spsi_rays eye;                         /* through its pixels; only their directions are used */
    spsi_slabs slabs;
    spsi_rays rays; /* of the light's sheets */
    int soft;       /* 1: its light's penumbrae are wider than half a texel */
} spsi_sweep;

/* Minimum cosine between s and the rays through a grid's corners. */
static double spsi_cosine_to_corners(const double s[3], const spsi_rays *rays) {
    double least = 1;
    for (int corner = 0; corner < 4; ++corner) {
        double ray[3];
        spsi_ray_direction(rays, corner & 1 ? rays->width - 1 : 0, corner & 2 ? rays->height - 1 : 0, ray);
        spsi_normalise(ray);
        least = fmin(least, spsi_dot(s, ray));
    }
    return least;
}

static int spsi_bounds_hold(const spsi_bounds *bounds, const double point[3]) {
    int inside = 1;
    for (int i = 0; i < 3; ++i) inside &= point[i] >= bounds->low[i] && point[i] <= bounds->high[i];
    return inside;
}

/* Minimum cosine between s and the rays from `from` to the corners of `bounds`; -1 if `from` is inside. */
static double spsi_cosine_to_bounds(const double s[3], const double from[3], const spsi_bounds *bounds) {
    const int inside = spsi_bounds_hold(bounds, from);
    double least = 1;
    for (int corner = 0; corner < 8 && !inside; ++corner) {
        double ray[3];
        spsi_bounds_corner(bounds, corner, ray);
        spsi_along(ray, from, -1, ray);
        if (!spsi_normalise(ray)) return -1;
        least = fmin(least, spsi_dot(s, ray));
    }
    return inside ? -1 : least;
}

/* --- parts of the image ---
   Where slabs perpendicular to one direction cannot serve all rays of a very wide camera, the image is cut where its
   rays are perpendicular to its plane, into halves or quarters that have slabs of their own. The rays of a quarter then
   lie within an octant, and cross slabs perpendicular to their middle at a cosine of 0.25 or more. */

/* Number of parts of the image. Sweeps with a light's sheets serve all of it. */
static int spsi_part_count(const spsi_frame *frame) {
    return frame->lamps.sliced_count > 0 ? 1 : frame->content->parts[0] * frame->content->parts[1];
}

/* The n-th part: its first column and row, and those beyond its last. */
static void spsi_part_place(const spsi_frame *frame, int n, int part[4]) {
    const spsi_content *content = frame->content;
    const int at[2] = {n % content->parts[0], n / content->parts[0]};
    const int size[2] = {content->eye.width, content->eye.height};
    for (int k = 0; k < 2; ++k) {
        part[k] = at[k] > 0 ? content->cut[k] : 0;
        part[2 + k] = at[k] + 1 < content->parts[k] ? content->cut[k] : size[k];
    }
}

/* The column (0) or row (1) at which the image is cut; 0: the place is outside of it. */
static int spsi_image_cut(const spsi_rays *eye, int axis) {
    const double *step = axis ? eye->b : eye->a;
    const double at = ceil(-spsi_dot(eye->c, step) / spsi_dot(step, step));
    const int size = axis ? eye->height : eye->width;
    return eye->perspective && at > 0 && at < size ? (int)at : 0;
}

/* Whether a part has pixels in the region. */
static int spsi_part_meets(const int part[4], const int region[4]) {
    return part[0] < region[0] + region[2] && part[2] > region[0] && part[1] < region[1] + region[3] &&
           part[3] > region[1];
}

/* Middle direction of a part's rays: the mean of those through its corners. */
static void spsi_part_direction(const spsi_rays *eye, double direction[3]) {
    memset(direction, 0, 3 * sizeof *direction);
    for (int corner = 0; corner < 4; ++corner) {
        double ray[3];
        spsi_ray_direction(eye, corner & 1 ? eye->width - 1 : 0, corner & 2 ? eye->height - 1 : 0, ray);
        spsi_normalise(ray);
        spsi_along(direction, ray, 1, direction);
    }
    spsi_normalise(direction);
}

/* Clears a sweep with the sheets of a light, or without (NULL), for the n-th part of the image. */
static void spsi_sweep_clear(const spsi_frame *frame, const spsi_lamp *lamp, int part, spsi_sweep *sweep) {
    double *corner = frame->content->eye.perspective ? sweep->eye.c : sweep->eye.origin;
    memset(sweep, 0, sizeof *sweep);
    sweep->lamp = lamp;
    sweep->slabs.normal[2] = sweep->slabs.thickness = 1;
    sweep->eye = frame->content->eye;
    spsi_part_place(frame, part, sweep->part);
    sweep->eye.width = sweep->part[2] - sweep->part[0];
    sweep->eye.height = sweep->part[3] - sweep->part[1];
    spsi_along(corner, sweep->eye.a, sweep->part[0], corner);
    spsi_along(corner, sweep->eye.b, sweep->part[1], corner);
}

/* --- their direction --- */

/* Minimum cosine between s and the rays that matter: those inside the sweep's part of the image which can also meet
   gas. Each condition alone gives a lower bound, and the greater of the two is used. */
static double spsi_cosine_of_eye(const spsi_frame *frame, const spsi_sweep *sweep, const double s[3]) {
    const spsi_rays *eye = &sweep->eye;
    const double least = spsi_cosine_to_corners(s, eye);
    return eye->perspective ? fmax(least, spsi_cosine_to_bounds(s, eye->origin, &frame->content->bounds)) : least;
}

/* The direction of a camera's middle ray. */
static void spsi_eye_axis(const spsi_rays *eye, double axis[3]) {
    spsi_ray_direction(eye, 0.5 * (eye->width - 1), 0.5 * (eye->height - 1), axis);
    spsi_normalise(axis);
}

/* Middle direction of the eye's rays: towards the middle of the gas if all of it lies in front of the eye, otherwise
   along the camera's axis. */
static void spsi_eye_direction(const spsi_frame *frame, double direction[3]) {
    const spsi_rays *eye = &frame->content->eye;
    double axis[3], centre[3], to_centre[3];
    spsi_eye_axis(eye, axis);
    memcpy(direction, axis, sizeof axis);
    if (!eye->perspective) return;
    spsi_bounds_centre(&frame->content->bounds, centre);
    spsi_along(centre, eye->origin, -1, to_centre);
    if (spsi_normalise(to_centre) && spsi_cosine_to_bounds(axis, eye->origin, &frame->content->bounds) > 0)
        memcpy(direction, to_centre, sizeof to_centre);
}

/* The word for the frame's gas in messages. */
static const char *spsi_gases(const spsi_frame *frame) {
    return frame->particles.set_count > 0 ? "volumes or particles" : "volumes";
}

/* The fields of a light that spare it slabs. */
static const char *spsi_unsliced(const spsi_lamp *lamp) {
    return lamp->extent.exists ? "no_shadow" : "shadow_source or no_shadow";
}

/* Reports that one of a light's rays meets the slabs at too small a cosine, and the remedy. */
static sps_result spsi_sweep_refuse_light(sps_context *context, const spsi_frame *frame, const spsi_sweep *sweep) {
    const double cosine = sweep->cosine_of_light;
    char rest[SPSI_SENTENCE_SIZE];
    SPS_SNPRINTF(rest, sizeof rest,
                 "is inside or too close to the %s: one of its rays meets the slabs at a cosine of %g, and 0.1 is "
                 "needed; move it away, or set %s on it",
                 spsi_gases(frame), cosine, spsi_unsliced(sweep->lamp));
    return spsi_fail_that(context, SPS_ERROR_UNSUPPORTED, SPS_OBJECT_LIGHT, sweep->lamp->index, "", cosine, rest);
}

/* The same for the camera's rays. */
static sps_result spsi_sweep_refuse_camera(sps_context *context, const spsi_frame *frame, const spsi_sweep *sweep) {
    const sps_camera *seen = &frame->view.camera;
    const double value = seen->field_of_view > 0 ? seen->field_of_view : seen->ortho_height;
    char rest[SPSI_SENTENCE_SIZE], camera[64] = "is too wide";
    char way_out[64] = "it to 168 degrees from corner to corner";
    if (!frame->has_matrix) SPS_SNPRINTF(camera, sizeof camera, "is %g", value);
    if (sweep->lamp)
        SPS_SNPRINTF(way_out, sizeof way_out, "it, or set %s on light[%d]", spsi_unsliced(sweep->lamp),
                     sweep->lamp->index);
    SPS_SNPRINTF(rest, sizeof rest,
                 "%s: one of the camera's rays meets the slabs at a cosine of %g, and 0.1 is needed; %snarrow %s",
                 camera, sweep->cosine_of_eye, frame->has_matrix ? "is it row-major? If it is, " : "", way_out);
    return spsi_fail_that(context, SPS_ERROR_UNSUPPORTED, SPS_OBJECT_VIEW, -1,
                          frame->has_matrix         ? "camera.world_to_clip"
                          : seen->field_of_view > 0 ? "camera.field_of_view"
                                                    : "camera.ortho_height",
                          frame->has_matrix ? 0 : value, rest);
}

/* Reports that a light does not see the gas within a cone, or cannot tell its texels apart. */
static sps_result spsi_sweep_refuse_fit(sps_context *context, const spsi_frame *frame, const spsi_sweep *sweep) {
    const spsi_lamp *lamp = sweep->lamp;
    char rest[SPSI_SENTENCE_SIZE] = SPSI_TEXELS_ALIKE;
    if (lamp->is_point)
        SPS_SNPRINTF(rest, sizeof rest,
                     "is too close to the %s: as seen from it they do not lie within a cone of 78 degrees about their "
                     "middle; move it away, or set %s on it",
                     spsi_gases(frame), spsi_unsliced(lamp));
    return spsi_fail_that(context, SPS_ERROR_UNSUPPORTED, SPS_OBJECT_LIGHT, lamp->index, "", 0, rest);
}

/* Minimum cosine between s and a light's rays through the gas. */
static double spsi_cosine_of_light(const spsi_frame *frame, const spsi_lamp *lamp, const double s[3]) {
    double least = HUGE_VAL;
    for (int i = 0; i < lamp->point_count; ++i) {
        const spsi_lamp *point = &lamp->points[i];
        least = fmin(least, !point->is_point ? spsi_dot(s, point->direction)
                                             : spsi_cosine_to_bounds(s, point->position, &frame->content->bounds));
    }
    return least;
}

/* Turns the slabs of a sweep to suit its light, if it has one, and a middle direction of the eye's rays. Returns
   whether they serve all rays. */
static int spsi_sweep_turn(const spsi_frame *frame, const double eye[3], spsi_sweep *sweep) {
    double toward[3], centre[3];
    memcpy(sweep->slabs.normal, eye, sizeof sweep->slabs.normal);
    sweep->back_to_front = 0;
    sweep->cosine_of_light = 1;
    if (sweep->lamp) {
        spsi_bounds_centre(&frame->content->bounds, centre);
        spsi_lamp_direction(sweep->lamp, centre, toward);
        sweep->back_to_front = spsi_dot(eye, toward) < 0;
        spsi_along(toward, eye, sweep->back_to_front ? -1 : 1, sweep->slabs.normal);
        spsi_normalise(sweep->slabs.normal);
        sweep->cosine_of_light = spsi_cosine_of_light(frame, sweep->lamp, sweep->slabs.normal);
    }
    for (int i = 0; i < 3; ++i) toward[i] = sweep->back_to_front ? -sweep->slabs.normal[i] : sweep->slabs.normal[i];
    sweep->cosine_of_eye = spsi_cosine_of_eye(frame, sweep, toward);
    return sweep->cosine_of_light >= SPSI_COSINE_MIN && sweep->cosine_of_eye >= SPSI_COSINE_MIN;
}

/* Chooses s: towards the gas, or, where that does not serve, about the camera's axis; for a part of the image, about
   its middle. Returns whether it serves. */
static int spsi_sweep_direction(const spsi_frame *frame, spsi_sweep *sweep) {
    double eye[3], axis[3];
    if (!sweep->lamp && spsi_part_count(frame) > 1) {
        spsi_part_direction(&sweep->eye, eye);
        return spsi_sweep_turn(frame, eye, sweep);
    }
    spsi_eye_direction(frame, eye);
    if (spsi_sweep_turn(frame, eye, sweep)) return 1;
    spsi_eye_axis(&frame->content->eye, axis);
    return spsi_sweep_turn(frame, axis, sweep) || spsi_sweep_turn(frame, eye, sweep);
}

/* The voxel edge that stands for particles: a ball has the variance of the kernel of a voxel of 0.7 radii (r^2 / 5 if
   it is homogeneous). Particles much smaller than their cloud need not be told apart in depth: a cloud is at most about
   500 of these edges deep. 0 without particles. */
static double spsi_particle_edge(const spsi_frame *frame) {
    return fmax(SPSI_PARTICLE_EDGE * frame->content->particle_radius, frame->content->particle_spread / 200);
}

/* The voxel length by which slabs across s are sized for a ray: what the ray crosses of a voxel, and half or a quarter
   of that where the ray grazes the slabs and is long in each of them. Powers of 1/2 keep all slabs in place as a light
   turns: errors that jump would be visible. */
static double spsi_slab_chord(const spsi_lattice *lattice, const double s[3], const double ray[3]) {
    const double cosine = fabs(spsi_dot(s, ray));
    const double share = cosine >= SPSI_COSINE_EVEN ? 1 : cosine >= SPSI_COSINE_EVEN / 2 ? 0.5 : 0.25;
    return share * spsi_voxel_chord(lattice, ray);
}

/* Minimum of these lengths for rays from a point to the corners and the middle of `bounds`. */
static double spsi_chord_to_bounds(const spsi_lattice *lattice, const double s[3], const double from[3],
                                   const spsi_bounds *bounds) {
    double least = HUGE_VAL;
    for (int corner = 0; corner <= 8; ++corner) {
        double ray[3];
        if (corner < 8)
            spsi_bounds_corner(bounds, corner, ray);
        else
            spsi_bounds_centre(bounds, ray);
        spsi_along(ray, from, -1, ray);
        if (spsi_normalise(ray)) least = fmin(least, spsi_slab_chord(lattice, s, ray));
    }
    return least;
}

/* The same for a grid's rays: those through its corners and its middle, or those that can meet gas, whichever set has
   the larger minimum. */
static double spsi_chord_of_rays(const spsi_frame *frame, const spsi_lattice *lattice, const double s[3],
                                 const spsi_rays *rays) {
    double least = HUGE_VAL;
    for (int i = 0; i < 5; ++i) {
        const double x = i < 4 ? i & 1 : 0.5, y = i < 4 ? i >> 1 : 0.5;
        double ray[3];
        spsi_ray_direction(rays, x * (rays->width - 1), y * (rays->height - 1), ray);
        if (spsi_normalise(ray)) least = fmin(least, spsi_slab_chord(lattice, s, ray));
    }
    if (!rays->perspective || spsi_bounds_hold(&frame->content->bounds, rays->origin)) return least;
    return fmax(least, spsi_chord_to_bounds(lattice, s, rays->origin, &frame->content->bounds));
}

/* The voxel length by which slabs are sized. What is classified must not change much from slab to slab along any ray,
   so for it the length is what the eye's and the light's rays cross of a voxel, if that is less than the voxel's extent
   along s. A sixteenth of the extent is the minimum, since voxels as flat as paper would need slabs without end. */
static double spsi_slab_voxel(const spsi_frame *frame, const spsi_lattice *lattice, const spsi_rays *rays,
                              const spsi_lamp *lamp, const double s[3]) {
    const double extent = spsi_voxel_extent(lattice, s), flattest = 1.0 / 16;
    double chord, travel[3];
    if (!frame->matter.materials[frame->media[lattice->medium].channel].table) return extent;
    chord = spsi_chord_of_rays(frame, lattice, s, rays);
    if (lamp && !lamp->is_point) {
        spsi_lamp_direction(lamp, lamp->position, travel);
        chord = fmin(chord, spsi_slab_chord(lattice, s, travel));
    } else if (lamp) {
        chord = fmin(chord, spsi_chord_to_bounds(lattice, s, lamp->position, &frame->content->bounds));
    }
    return fmin(extent, fmax(chord, flattest * extent));
}

/* Cuts the bounds of volumes and particles, along the slabs' normal, into slabs that serve the rays of a target and
   those of a light (NULL: none). `edge` is the voxel edge that stands for particles, or infinite. */
static sps_result spsi_slabs_cut(sps_context *context, const spsi_frame *frame, const spsi_rays *rays,
                                 const spsi_lamp *lamp, double edge, spsi_slabs *slabs) {
    double low = HUGE_VAL, high = -HUGE_VAL, count;
    for (int corner = 0; corner < 8; ++corner) {
        double point[3];
        spsi_bounds_corner(&frame->content->bounds, corner, point);
        low = fmin(low, spsi_dot(point, slabs->normal));
        high = fmax(high, spsi_dot(point, slabs->normal));
    }
    edge = fmax(edge, (high - low) / (SPSI_SLABS_MAX / 16)); /* limits the slabs that a stray particle calls for */
    for (int i = 0; i < frame->medium_count; ++i)
        edge = fmin(edge, spsi_slab_voxel(frame, &frame->lattices[i], rays, lamp, slabs->normal));
    slabs->start = low;
    slabs->thickness = fmin(frame->view.slab * edge, high - low); /* never thicker than the whole extent */
    count = ceil((high - low) / slabs->thickness);
    if (!(count <= SPSI_SLABS_MAX))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, frame->viewer, -1, "slab", frame->view.slab,
                               "it makes more than 2^20 slabs");
    slabs->count = spsi_most(1, (int)count);
    return SPS_OK;
}

/* Width, in texels, of the widest penumbra that gas can cast on gas or polygons, or polygons on gas: that of an edge at
   one end of everything, at the other end. What is beside or behind a lamp counts as touching it. */
static double spsi_penumbra_texels(const spsi_frame *frame, const spsi_sweep *sweep) {
    const spsi_lamp *lamp = sweep->lamp;
    const double texel = fmin(spsi_length(sweep->rays.a), spsi_length(sweep->rays.b));
    spsi_bounds all = frame->content->mesh_bounds;
    double near_by = HUGE_VAL, far_off = 0, across[3];
    spsi_bounds_add(&all, frame->content->bounds.low);
    spsi_bounds_add(&all, frame->content->bounds.high);
    spsi_along(all.high, all.low, -1, across);
    if (!lamp->is_point) return 2 * tan(lamp->extent.radius) * spsi_length(across) / texel;
    for (int corner = 0; corner < 8; ++corner) {
        double point[3], q[3];
        spsi_bounds_corner(&all, corner, point);
        spsi_project(&sweep->rays, point, q);
        near_by = fmin(near_by, fmax(q[2], lamp->extent.radius));
        far_off = fmax(far_off, q[2]);
    }
    return 2 * lamp->extent.radius * (1 / near_by - 1 / far_off) / texel;
}

/* Fits the rays of the light's sheets. Returns whether that is possible. */
static int spsi_sweep_fit(const spsi_frame *frame, spsi_sweep *sweep) {
    const spsi_lamp *lamp = sweep->lamp;
    if (!spsi_rays_fit(lamp, &frame->content->bounds, spsi_lamp_texel(frame, lamp), frame->view.shadow_size,
                       spsi_light_texels_most(frame), &sweep->rays))
        return 0;
    sweep->soft = lamp->extent.exists && spsi_penumbra_texels(frame, sweep) >= 0.5;
    return 1;
}

/* Aims a sweep's slabs and its light's rays at the content's bounds. Returns whether they serve. */
static int spsi_sweep_aim(const spsi_frame *frame, spsi_sweep *sweep) {
    return spsi_sweep_direction(frame, sweep) && (!sweep->lamp || spsi_sweep_fit(frame, sweep));
}

/* Number of sweeps in a frame: one for each light that shades by sheets, and at least one. */
static int spsi_sweep_count(const spsi_frame *frame) { return spsi_most(1, frame->lamps.sliced_count); }

/* The n-th lamp that shades by sheets; NULL if there is none. */
static const spsi_lamp *spsi_sliced_lamp(const spsi_frame *frame, int n) {
    for (int i = 0; i < frame->lamps.count; ++i)
        if (frame->lamps.list[i].sliced && n-- == 0) return &frame->lamps.list[i];
    return NULL;
}

/* Whether a sweep carries the shadows of a lamp: those of its own lamp, and in the first sweep those of all shadowing
   lamps without slabs of their own. */
static int spsi_sweep_carries(const spsi_sweep *sweep, const spsi_lamp *lamp) {
    return lamp->sliced ? lamp == sweep->lamp : sweep->first && lamp->shadows;
}

/* Number of lights whose shadows the n-th sweep carries; no sweep has more than the first. */
static int spsi_sweep_shadow_count(const spsi_frame *frame, int n) {
    return (n < frame->lamps.sliced_count) + (n == 0 ? frame->lamps.shadow_count - frame->lamps.sliced_count : 0);
}

/* Aims a sweep at the gas or, where that does not serve, at the bounds by which shadows were chosen: what serves these
   serves all that lies within. */
static sps_result spsi_sweep_place(sps_context *context, const spsi_frame *frame, spsi_sweep *sweep) {
    const spsi_bounds tight = frame->content->bounds;
    spsi_sweep wider = *sweep;
    int serves;
    if (spsi_sweep_aim(frame, sweep)) return SPS_OK;
    frame->content->bounds = frame->content->outer;
    serves = spsi_sweep_aim(frame, &wider);
    frame->content->bounds = tight;
    if (!serves && !(sweep->cosine_of_light >= SPSI_COSINE_MIN)) return spsi_sweep_refuse_light(context, frame, sweep);
    if (!serves && !(sweep->cosine_of_eye >= SPSI_COSINE_MIN)) return spsi_sweep_refuse_camera(context, frame, sweep);
    if (!serves) return spsi_sweep_refuse_fit(context, frame, sweep);
    *sweep = wider;
    return SPS_OK;
}

/* Sets up the n-th sweep for a part of the image. Without gas there are no slabs, and nothing can prevent slicing. */
static sps_result spsi_sweep_build(sps_context *context, const spsi_frame *frame, int n, int part, spsi_sweep *sweep) {
    const double edge = frame->content->particle_count > 0 ? spsi_particle_edge(frame) : HUGE_VAL;
    spsi_sweep_clear(frame, spsi_sliced_lamp(frame, n), part, sweep);
    sweep->first = n == 0;
    if (spsi_bounds_empty(&frame->content->bounds)) return SPS_OK;
    if (spsi_sweep_place(context, frame, sweep)) return context->result;
    return spsi_slabs_cut(context, frame, &sweep->eye, sweep->lamp, edge, &sweep->slabs);
}

/* Cuts the image into as few parts as slabs can serve, for sweeps without a light's sheets. If even quarters cannot be
   served, it stays whole, and is refused. */
static void spsi_image_divide(const spsi_frame *frame) {
    spsi_content *content = frame->content;
    for (int parts = 0; parts < 4; ++parts) {
        int serves = 1;
        for (int k = 0; k < 2; ++k) {
            content->parts[k] = 1 + (parts >> k & 1);
            content->cut[k] = spsi_image_cut(&content->eye, k);
            serves &= content->parts[k] == 1 || content->cut[k] > 0;
        }
        for (int n = 0; n < content->parts[0] * content->parts[1] && serves; ++n) {
            spsi_sweep sweep;
            spsi_sweep_clear(frame, NULL, n, &sweep);
            serves = spsi_sweep_aim(frame, &sweep);
        }
        if (serves) return;
    }
    content->parts[0] = content->parts[1] = 1;
}

/* ================================================================================================ >>splat
   20 Footprints. In ray space a voxel's kernel is a Gaussian of covariance R [Zwicker et al. 2002]. Its line integral
   is a 2D Gaussian in the pixel plane. The share of it between two slab planes is the difference of spsi_kernel_share
   at the planes, whose distance from the kernel's middle changes from pixel to pixel because the slab is tilted and the
   kernel sheared. This tilted section is exact; without it, the error does not fall with thickness. Every section of a
   voxel within a chunk of slabs is written in one visit, each plane's share serving two sheets. Near a perspective eye,
   where rays are not parallel across a kernel, the integral along each pixel's own ray is used instead. Sections end at
   polygons and at the near plane, and footprints are widened to a pixel by its filter. Classified volumes as the eye
   sees them are the exception: a transfer function of a mean is not the mean of a transfer function, so they are
   sampled once per pixel, as polygons are, and from whole slabs, as profiles and gradients require. Where voxels are
   smaller than pixels, the gradient has sheets of its own, d/dx and d/dy of each section (spsi_add_slopes). Sheets hold
   the integral of value over t; the length of a ray per t is applied at shading. Cost: about 14 vector operations per
   vector of fragments and section, and 25 per row. */

/* A kernel near a perspective eye, in units of t's standard deviation, so that fourth powers stay in range. */
typedef struct spsi_near_case {
    float unit;          /* the standard deviation of t */
    float covariance[6]; /* 00 01 02 11 12 22 */
    float inverse[6];    /* of the covariance */
    float root;          /* of its determinant */
    float weight;        /* integral for value 1, except for what depends on the pixel */
} spsi_near_case;

/* Constants shared by all voxels of a volume, for one set of rays and slabs. */
typedef struct spsi_splatter {
    int perspective;              /* 1: rays share an origin; 0: they are parallel */
    float sign;                   /* -1 where rays cross the slabs against their order, else 1 */
    float step[3][3];             /* change of (x t, y t, t) or (x, y, t) per voxel along each axis */
    float slab_step[3];           /* change of slab coordinate per voxel along each axis */
    float slab_x, slab_y, slab_t; /* slab coordinate along a ray: (slab_t + x slab_x + y slab_y) per t */
    float covariance[6];          /* of the kernel in ray space: 00 01 02 11 12 22 */
    float weight;                 /* integral for value 1, without the factors that depend on the footprint */
    float cut;                    /* standard deviations at which footprints end */
    float filter;                 /* minimum variance of a footprint, in square pixels */
    float reach_depth;            /* kernel radius in t */
    float reach_slabs;            /* kernel radius along s, in slabs */
    float near_depth;             /* t below which the near case applies */
    spsi_near_case near_case;     /* the kernel in the near case */
    float eye_near;               /* t at which rays begin, as t - depth_reference: sections are cut there */
    float depth_reference;        /* of the rays */
    int whole;                    /* 1: neither polygons nor the near plane cut sections; rays go on behind the eye */
} spsi_splatter;

/* Position of a brick's first voxel. */
typedef struct spsi_anchor {
    float q[3];  /* ray coordinates */
    float depth; /* t - depth_reference */
    float slab;  /* slab coordinate */
} spsi_anchor;

/* Footprints of a vector of voxels. Distances along a ray are in v = t / (SPSI_CUT * standard deviation). */
typedef struct spsi_footprints {
    float x[SPSI_LANES];           /* column of the centre, in pixels */
    float y[SPSI_LANES];           /* row of the centre, in pixels */
    float depth[SPSI_LANES];       /* t - depth_reference of the centre */
    float slab[SPSI_LANES];        /* slab coordinate of the centre */
    float amplitude[SPSI_LANES];   /* peak value: integral along the ray through the centre */
    float across[SPSI_LANES];      /* 1 / variance of x at given y */
    float lean[SPSI_LANES];        /* change of the mean x per y */
    float upright[SPSI_LANES];     /* 1 / variance of y */
    float inverse_yy[SPSI_LANES];  /* -1/2 of the inverse covariance's y y entry */
    float row_width[SPSI_LANES];   /* standard deviation of x at given y */
    float half_height[SPSI_LANES]; /* half the height of its bounding box, in pixels */
    float half_width[SPSI_LANES];  /* half the width of its bounding box, in pixels */
    float per_slab[SPSI_LANES];    /* change of v from plane to plane */
    float slope_x[SPSI_LANES];     /* change of a plane's v per pixel along x */
    float slope_y[SPSI_LANES];     /* change of a plane's v per pixel along y */
    float mean_x[SPSI_LANES];      /* change of the kernel's mean t per pixel along x */
    float mean_y[SPSI_LANES];      /* change of the kernel's mean t per pixel along y */
    float per_depth[SPSI_LANES];   /* v per t */
    float spread[SPSI_LANES];      /* range of v in a row per standard deviation, widened by the x slope */
    float slabs[SPSI_LANES];       /* 1 / per_slab */
} spsi_footprints;

/* A tile's sheets: one float per pixel, slab and channel. */
typedef struct spsi_tile {
    float *sheets;          /* channel by channel, each slab by slab, each row by row */
    size_t sheet_size;      /* floats from one slab to the next */
    size_t channel_size;    /* floats from one channel to the next */
    int x0, y0, x1, y1;     /* pixels covered, inclusive, with the margin */
    int pitch;              /* floats from one row to the next */
    int slab_count;         /* slabs of a chunk, and those of the margin before and after it */
    int clamped;            /* 1: sections may end at `limits`, or begin at the near plane */
    float nearest_limit;    /* minimum depth of a polygon in the tile */
    const spsi_hit *limits; /* polygons of the whole image, by pixel; NULL: none */
    int limit_width;        /* of the image */
    int limit_height;       /* of the image */
    float *slopes;          /* sheets of d/dx of the current channel, followed by those of d/dy; NULL: none */
    uint64_t open;          /* bit mask of patches that are not opaque yet; footprints that meet none are skipped */
    int margin;             /* pixels around the patches; they count as part of the patches at the edge */
    float eye_slab;         /* slab coordinate of the rays' origin, for the near case and gradients */
    uint64_t visits;        /* footprints written */
    uint64_t fragments;     /* the sum of their pixels times slabs */
} spsi_tile;

/* Column or row of patches of a pixel `at` from a tile's edge; pixels outside count as part of the nearest patch. */
static inline int spsi_patch_at(int at) { return spsi_least(spsi_most(at, 0), SPSI_TILE_WIDTH - 1) / SPSI_PATCH; }

/* Bit mask of the patches that meet a box of pixels, counted from the tile's first. */
static inline uint64_t spsi_patch_box(int x0, int y0, int x1, int y1) {
    const int c0 = spsi_patch_at(x0), c1 = spsi_patch_at(x1), r0 = spsi_patch_at(y0), r1 = spsi_patch_at(y1);
    const uint64_t columns = (UINT64_C(0xff) << c0) & (UINT64_C(0xff) >> (7 - c1));
    return columns * UINT64_C(0x0101010101010101) & (~UINT64_C(0) << 8 * r0) & (~UINT64_C(0) >> 8 * (7 - r1));
}

/* Bit mask of the patches of a tile that meet a box of its pixels and the margin around it. */
static inline uint64_t spsi_patches(const spsi_tile *tile, int x0, int y0, int x1, int y1) {
    const int margin = tile->margin, left = tile->x0 + margin, top = tile->y0 + margin;
    return spsi_patch_box(x0 - margin - left, y0 - margin - top, x1 + margin - left, y1 + margin - top);
}

/* Bit mask of the patches of a tile in which some pixel's optical depth is less than `end`. */
static uint64_t spsi_patches_open(const float *depth, size_t pitch, int width, int height, float end) {
    uint64_t open = 0;
    for (int y = 0; y < height; ++y, depth += pitch)
        for (int x = 0; x < width; ++x) open |= (uint64_t)(depth[x] < end) << (y / SPSI_PATCH * 8 + x / SPSI_PATCH);
    return open;
}

/* Returns 0 if footprints would exceed the range of floats. */
static int spsi_splatter_build(const spsi_lattice *lattice, const spsi_rays *rays, const spsi_slabs *slabs, float scale,
                               double cut, spsi_splatter *splatter) {
    double e[3][3], covariance[3][3], rows[3][3], reach = 0, unit, root, weight;
    memset(splatter, 0, sizeof *splatter);
    memset(covariance, 0, sizeof covariance);
    splatter->perspective = rays->perspective;
    for (int axis = 0; axis < 3; ++axis) {
        const double change = spsi_dot(slabs->normal, lattice->step[axis]) / slabs->thickness;
        spsi_to_rays(rays, lattice->step[axis], e[axis]);
        splatter->slab_step[axis] = (float)change;
        reach += change * change;
        for (int i = 0; i < 3; ++i) splatter->step[axis][i] = (float)e[axis][i];
        for (int i = 0; i < 9; ++i)
            covariance[i / 3][i % 3] += SPSI_SIGMA * SPSI_SIGMA * e[axis][i / 3] * e[axis][i % 3];
    }
    spsi_invert(covariance[0], covariance[1], covariance[2], rows);
    unit = sqrt(covariance[2][2]);
    root = sqrt(spsi_determinant(covariance[0], covariance[1], covariance[2]));
    weight = (double)scale * lattice->voxel_volume / fabs(spsi_determinant(rays->a, rays->b, rays->c)) /
             (2 * SPSI_PI * spsi_footprint_mass(cut));
    for (int i = 0, k = 0; i < 3; ++i)
        for (int j = i; j < 3; ++j, ++k) {
            splatter->covariance[k] = (float)covariance[i][j];
            splatter->near_case.covariance[k] = (float)(covariance[i][j] / (unit * unit));
            splatter->near_case.inverse[k] = (float)(rows[i][j] * unit * unit);
        }
    splatter->near_case.unit = (float)unit;
    splatter->near_case.root = (float)(root / (unit * unit * unit));
    splatter->near_case.weight = (float)(weight * unit / root);
    splatter->slab_x = (float)(spsi_dot(slabs->normal, rays->a) / slabs->thickness);
    splatter->slab_y = (float)(spsi_dot(slabs->normal, rays->b) / slabs->thickness);
    splatter->slab_t = (float)(spsi_dot(slabs->normal, rays->c) / slabs->thickness);
    splatter->sign = 1;
    splatter->weight = (float)weight;
    splatter->cut = (float)cut;
    splatter->filter = (float)(SPSI_PIXEL_SIGMA * SPSI_PIXEL_SIGMA);
    splatter->reach_depth = (float)(cut * sqrt(covariance[2][2]));
    splatter->reach_slabs = (float)(cut * SPSI_SIGMA * sqrt(reach));
    splatter->near_depth = rays->perspective ? (float)(SPSI_NEAR_REACHES * cut * sqrt(covariance[2][2])) : -FLT_MAX;
    splatter->depth_reference = (float)rays->depth_reference;
    splatter->eye_near = spsi_rays_begin(rays);
    { /* the widest footprint, in pixels to the fourth power */
        const double nearest = rays->perspective ? (double)splatter->near_depth : 1;
        const double widest = covariance[0][0] * covariance[1][1] / (nearest * nearest * nearest * nearest);
        return widest < 1e36 && weight < (double)FLT_MAX && splatter->near_case.weight <= FLT_MAX &&
               splatter->near_depth <= FLT_MAX && splatter->near_case.unit >= FLT_MIN;
    }
}

/* For a classified volume as the eye sees it: footprints are not widened, and sections not cut. */
static void spsi_splatter_classified(spsi_splatter *splatter) {
    splatter->filter = 0;
    splatter->whole = 1;
    splatter->eye_near = -FLT_MAX;
}

/* The parts of a footprint that follow from R at (x, y, t): the pixel filter, the conditional Gaussians, the
   section. */
static inline void spsi_footprint_shape(const spsi_splatter *s, spsi_v x, spsi_v y, spsi_v t, spsi_v value,
                                        spsi_footprints *out) {
    const spsi_v one = spsi_set(1), c22 = spsi_set(s->covariance[5]);
    const spsi_v near_one = s->perspective ? spsi_div(one, spsi_max(t, spsi_set(FLT_MIN * 16))) : one;
    const spsi_v px = s->perspective ? x : spsi_set(0), py = s->perspective ? y : spsi_set(0);
    const spsi_v square = spsi_mul(near_one, near_one);
    const spsi_v x22 = spsi_mul(px, c22), y22 = spsi_mul(py, c22);
    const spsi_v c02 = spsi_set(s->covariance[2]), c12 = spsi_set(s->covariance[4]);
    const spsi_v rxt = spsi_mul(near_one, spsi_sub(c02, x22)), ryt = spsi_mul(near_one, spsi_sub(c12, y22));
    const spsi_v two = spsi_set(2), half = spsi_set(0.5f);
    spsi_v rxx = spsi_add(spsi_set(s->covariance[0]), spsi_mul(px, spsi_sub(x22, spsi_mul(two, c02))));
    spsi_v ryy = spsi_add(spsi_set(s->covariance[3]), spsi_mul(py, spsi_sub(y22, spsi_mul(two, c12))));
    spsi_v rxy = spsi_sub(spsi_fma(px, spsi_sub(y22, c12), spsi_set(s->covariance[1])), spsi_mul(py, c02));
    spsi_v least, widen, determinant, across, mean_x, mean_y, per_depth, along, slope_x;
    rxx = spsi_mul(rxx, square);
    ryy = spsi_mul(ryy, square);
    rxy = spsi_mul(rxy, square);
    least = spsi_mul(half, spsi_sub(rxx, ryy));
    least = spsi_sub(spsi_mul(half, spsi_add(rxx, ryy)), spsi_sqrt(spsi_fma(least, least, spsi_mul(rxy, rxy))));
    widen = spsi_max(spsi_set(0), spsi_sub(spsi_set(s->filter), least));
    rxx = spsi_add(rxx, widen);
    ryy = spsi_add(ryy, widen);
    determinant =
        spsi_max(spsi_sub(spsi_mul(rxx, ryy), spsi_mul(rxy, rxy)), spsi_mul(spsi_set(1e-6f), spsi_mul(rxx, ryy)));
    across = spsi_div(ryy, determinant);
    mean_x = spsi_div(spsi_sub(spsi_mul(rxt, ryy), spsi_mul(ryt, rxy)), determinant);
    mean_y = spsi_div(spsi_sub(spsi_mul(ryt, rxx), spsi_mul(rxt, rxy)), determinant);
    along = spsi_sub(spsi_sub(c22, spsi_mul(mean_x, rxt)), spsi_mul(mean_y, ryt));
    per_depth = spsi_div(spsi_set((float)(1 / SPSI_CUT)), spsi_sqrt(spsi_max(along, spsi_mul(spsi_set(1e-6f), c22))));
    spsi_store(out->amplitude,
               spsi_div(spsi_mul(spsi_mul(value, spsi_set(s->weight)), square), spsi_sqrt(determinant)));
    spsi_store(out->across, across);
    spsi_store(out->lean, spsi_div(rxy, ryy));
    spsi_store(out->upright, spsi_div(one, ryy));
    spsi_store(out->inverse_yy, spsi_mul(spsi_set(-0.5f), spsi_div(rxx, determinant)));
    spsi_store(out->row_width, spsi_sqrt(spsi_div(determinant, ryy)));
    spsi_store(out->half_height, spsi_mul(spsi_set(s->cut), spsi_sqrt(ryy)));
    spsi_store(out->half_width, spsi_mul(spsi_set(s->cut), spsi_sqrt(rxx)));
    spsi_store(out->mean_x, mean_x);
    spsi_store(out->mean_y, mean_y);
    spsi_store(out->per_depth, per_depth);
    { /* a plane's t changes by -(s.a) / (s.w) per pixel, times t in perspective */
        const spsi_v crossing =
            spsi_fma(px, spsi_set(s->slab_x), spsi_fma(py, spsi_set(s->slab_y), spsi_set(s->slab_t)));
        const spsi_v per_crossing = spsi_div(spsi_set(s->sign), crossing);
        const spsi_v tilt = spsi_mul(per_crossing, s->perspective ? t : one);
        const spsi_v signed_depth = spsi_mul(per_depth, spsi_set(s->sign));
        slope_x = spsi_sub(spsi_set(0),
                           spsi_fma(spsi_mul(tilt, spsi_set(s->slab_x)), per_depth, spsi_mul(mean_x, signed_depth)));
        spsi_store(out->slope_x, slope_x);
        spsi_store(out->slope_y, spsi_sub(spsi_set(0), spsi_fma(spsi_mul(tilt, spsi_set(s->slab_y)), per_depth,
                                                                spsi_mul(mean_y, signed_depth))));
        spsi_store(out->per_slab, spsi_mul(per_depth, per_crossing));
        spsi_store(out->slabs, spsi_div(one, spsi_mul(per_depth, per_crossing)));
    }
    spsi_store(out->spread, spsi_sqrt(spsi_add(spsi_div(spsi_mul(slope_x, slope_x), across),
                                               spsi_set((float)(1 / (SPSI_CUT * SPSI_CUT))))));
}

/* How mass is distributed along a ray. */
typedef enum spsi_mass { SPSI_MASS_KERNEL, SPSI_MASS_CHORD, SPSI_MASS_SOFT_CHORD } spsi_mass;

/* The mass of a kernel or a ball along a vector of rays, to be added to a run of sheets. */
typedef struct spsi_sections {
    float *sheet;      /* the first one */
    size_t sheet_size; /* floats from one sheet to the next */
    int count;         /* number of sheets */
    int starts;        /* 1: the first sheet also receives what lies before its plane */
    int ends;          /* 1: the last sheet also receives what lies behind its plane */
    spsi_v weight;     /* the whole mass */
    spsi_v v;          /* where the first plane cuts the profile, which extends from -1 to 1 */
    spsi_v per_plane;  /* change of v from plane to plane */
    spsi_v low, high;  /* v at which rays begin and end, if they are clamped */
} spsi_sections;

static inline spsi_v spsi_mass_share(spsi_mass mass, spsi_v v) {
    if (mass == SPSI_MASS_KERNEL) return spsi_kernel_share(v);
    return spsi_chord_share(mass == SPSI_MASS_SOFT_CHORD, v);
}

/* Adds to each sheet the weight times the change of share from plane to plane. Each plane's share serves two sheets. */
static inline void spsi_add_sections(const spsi_sections *s, spsi_mass mass, int clamped) {
    float *sheet = s->sheet;
    spsi_v v = s->v, before, after;
    if (s->starts)
        before = clamped ? spsi_mass_share(mass, s->low) : spsi_set(0);
    else
        before = spsi_mass_share(mass, clamped ? spsi_clamp(v, s->low, s->high) : v);
    for (int k = 0; k < s->count - s->ends; ++k, sheet += s->sheet_size) {
        v = spsi_add(v, s->per_plane);
        after = spsi_mass_share(mass, clamped ? spsi_clamp(v, s->low, s->high) : v);
        spsi_store(sheet, spsi_fma(s->weight, spsi_sub(after, before), spsi_load(sheet)));
        before = after;
    }
    if (!s->ends) return;
    after = clamped ? spsi_mass_share(mass, s->high) : spsi_set(1);
    spsi_store(sheet, spsi_fma(s->weight, spsi_sub(after, before), spsi_load(sheet)));
}

/* Derivatives along x and y of sections that are not clamped. */
typedef struct spsi_slopes {
    spsi_v log_weight[2]; /* of the logarithm of their weight */
    float v[2];           /* of v */
} spsi_slopes;

/* Adds the derivatives of sections along x and y to sheets of their own: w (S(b) - S(a)) changes by w' (S(b) - S(a)) +
   w (S'(b) b' - S'(a) a'). */
static void spsi_add_slopes(const spsi_sections *s, const spsi_slopes *slopes, size_t channel_size, float *sheet) {
    const spsi_v zero = spsi_set(0);
    spsi_v v = s->v, share[2] = {zero, zero}, slope[2] = {zero, zero};
    for (int k = -1; k < s->count; ++k, v = spsi_add(v, s->per_plane)) {
        const int first = k < 0 && s->starts, last = k + 1 == s->count && s->ends;
        share[1] = first || last ? spsi_set(last ? 1.0f : 0.0f) : spsi_kernel_share(v);
        slope[1] = first || last ? zero : spsi_kernel_slope(v);
        if (k >= 0) {
            const spsi_v held = spsi_sub(share[1], share[0]), moved = spsi_sub(slope[1], slope[0]);
            for (int axis = 0; axis < 2; ++axis) {
                float *to = sheet + (size_t)axis * channel_size + (size_t)k * s->sheet_size;
                const spsi_v change =
                    spsi_fma(slopes->log_weight[axis], held, spsi_mul(moved, spsi_set(slopes->v[axis])));
                spsi_store(to, spsi_fma(s->weight, change, spsi_load(to)));
            }
        }
        share[0] = share[1];
        slope[0] = slope[1];
    }
}

/* Rows of one footprint, a vector of rows at a time: their ranges of pixels and slabs. */
typedef struct spsi_rows {
    int x0[SPSI_LANES], x1[SPSI_LANES];        /* pixels, inclusive, clamped to the tile */
    int first[SPSI_LANES];                     /* first slab plane, clamped to the tile's */
    int slabs[SPSI_LANES];                     /* number of slabs, clamped to the tile's; 0: nothing here */
    int area[SPSI_LANES];                      /* pixels times slabs */
    int starts[SPSI_LANES], ends[SPSI_LANES];  /* 1: not clamped at this end, which is the kernel's own */
    float left[SPSI_LANES], right[SPSI_LANES]; /* x0 and x1, half a pixel outwards */
    float dy[SPSI_LANES];                      /* y from the kernel's centre */
    float factor[SPSI_LANES];                  /* of the weight: exp of the term that depends on y alone */
    float v[SPSI_LANES];                       /* of the first plane at the kernel's own x */
} spsi_rows;

static inline void spsi_rows_build(const spsi_tile *tile, const spsi_footprints *f, int i, int y, float cut,
                                   spsi_rows *rows) {
    const spsi_v dy = spsi_sub(spsi_add(spsi_set((float)y), spsi_iota()), spsi_set(f->y[i]));
    const spsi_v square = spsi_mul(dy, dy), zero = spsi_set(0), one = spsi_set(1), per_slab = spsi_set(f->per_slab[i]);
    const spsi_v left = spsi_sub(spsi_set(cut * cut), spsi_mul(square, spsi_set(f->upright[i])));
    const spsi_v radius = spsi_sqrt(spsi_max(zero, left)), half = spsi_mul(radius, spsi_set(f->row_width[i]));
    const spsi_v middle = spsi_fma(dy, spsi_set(f->lean[i]), spsi_set(f->x[i]));
    const spsi_v v = spsi_fma(dy, spsi_set(f->slope_y[i]), spsi_sub(zero, spsi_mul(per_slab, spsi_set(f->slab[i]))));
    const spsi_v v_middle = spsi_fma(dy, spsi_set(f->slope_x[i] * f->lean[i]), v);
    const spsi_v range = spsi_mul(radius, spsi_set(f->spread[i])), slabs = spsi_set(f->slabs[i]);
    const spsi_v beyond = spsi_set((float)(tile->slab_count + 1)), before = spsi_set(-1),
                 count = spsi_set((float)tile->slab_count);
    const spsi_v low =
        spsi_floor(spsi_clamp(spsi_mul(spsi_sub(spsi_sub(zero, range), v_middle), slabs), before, beyond));
    const spsi_v high =
        spsi_add(spsi_floor(spsi_clamp(spsi_mul(spsi_sub(range, v_middle), slabs), before, beyond)), one);
    const spsi_v first = spsi_max(low, zero);
    const spsi_v x0 = spsi_sub(zero, spsi_floor(spsi_clamp(spsi_sub(half, middle), spsi_set(-2.0f * SPSI_SIZE_MAX),
                                                           spsi_set((float)-tile->x0))));
    const spsi_v x1 =
        spsi_floor(spsi_clamp(spsi_add(middle, half), spsi_set((float)(tile->x0 - 1)), spsi_set((float)tile->x1)));
    const spsi_v width = spsi_max(spsi_add(spsi_sub(x1, x0), one), zero);
    const spsi_v held = spsi_max(spsi_sub(spsi_min(high, count), first), zero);
    spsi_store(rows->dy, dy);
    spsi_store(rows->factor, spsi_exp(spsi_mul(square, spsi_set(f->inverse_yy[i]))));
    spsi_store(rows->v, spsi_fma(per_slab, first, v));
    spsi_store(rows->left, spsi_sub(x0, spsi_set(0.5f)));
    spsi_store(rows->right, spsi_add(x1, spsi_set(0.5f)));
    spsi_store_int(rows->x0, x0);
    spsi_store_int(rows->x1, x1);
    spsi_store_int(rows->first, first);
    spsi_store_int(rows->slabs, spsi_select(spsi_less(zero, width), held, zero));
    spsi_store_int(rows->area, spsi_mul(width, held));
    spsi_store_int(rows->starts, spsi_select(spsi_less(low, zero), zero, one));
    spsi_store_int(rows->ends, spsi_select(spsi_less(count, high), zero, one));
}

/* Depths of the polygons at a vector of a tile's pixels. */
static inline spsi_v spsi_tile_limits(const spsi_tile *tile, int x, int y) {
    return spsi_hit_depths(tile->limits, tile->limit_width, tile->limit_height, x, y);
}

/* The range of v to which a section is clamped: it begins behind the near plane, and ends at the polygon at depth
   `beyond`. */
static inline void spsi_limits(spsi_v beyond, float sign, float eye_near, spsi_v mean, spsi_v per_depth, spsi_v *low,
                               spsi_v *high) {
    spsi_v near_v = spsi_mul(spsi_sub(spsi_set(eye_near), mean), per_depth);
    beyond = spsi_clamp(spsi_mul(spsi_sub(beyond, mean), per_depth), spsi_set(-2), spsi_set(2));
    near_v = spsi_clamp(near_v, spsi_set(-2), beyond);
    *low = sign > 0 ? near_v : spsi_sub(spsi_set(0), beyond);
    *high = sign > 0 ? beyond : spsi_sub(spsi_set(0), near_v);
}

/* A footprint that is being splatted into a channel of a tile. */
typedef struct spsi_print {
    spsi_tile *tile;
    const spsi_splatter *splatter;
    const spsi_footprints *footprints;
    int lane; /* of the footprints */
    float *channel;
} spsi_print;

/* A vector of columns of up to SPSI_LANES rows. With the inverse covariance (A B; B C), weights are
   exp(-A dx^2 / 2 - B dx dy0) * exp(-B dx)^row * exp(-C dy^2 / 2): the first two are per column, the last per row, so
   that no exponential is evaluated per pixel. Slender ellipses, whose factors could overflow, evaluate one per vector
   and row. */
static inline void spsi_splat_columns(const spsi_print *print, const spsi_rows *rows, int count, int x, int y,
                                      int clamped, int sloped) {
    const spsi_tile *tile = print->tile;
    const spsi_splatter *s = print->splatter;
    const spsi_footprints *f = print->footprints;
    const int i = print->lane;
    const float a = -0.5f * f->across[i], b = f->across[i] * f->lean[i], c = f->inverse_yy[i];
    const int slender = b * b > 0.8f * 4 * a * c;
    const spsi_v at = spsi_add(spsi_set((float)x), spsi_iota()), dx = spsi_sub(at, spsi_set(f->x[i]));
    const spsi_v square = spsi_mul(spsi_mul(dx, dx), spsi_set(a)), amplitude = spsi_set(f->amplitude[i]);
    const spsi_v v_column = spsi_mul(dx, spsi_set(f->slope_x[i]));
    const spsi_v turn = b < 0 || b > 0 ? spsi_exp(spsi_mul(dx, spsi_set(b))) : spsi_set(1);
    float *row = print->channel + (size_t)((y - tile->y0) * tile->pitch + (x - tile->x0));
    spsi_v column = spsi_mul(spsi_exp(spsi_fma(dx, spsi_set(b * rows->dy[0]), square)), amplitude);
    spsi_sections sections;
    sections.sheet_size = tile->sheet_size;
    sections.per_plane = spsi_set(f->per_slab[i]);
    sections.low = sections.high = spsi_set(0);
    for (int r = 0; r < count; ++r, row += tile->pitch) {
        spsi_v weight = spsi_mul(column, spsi_set(rows->factor[r]));
        column = spsi_mul(column, turn);
        if (rows->slabs[r] == 0 || rows->x0[r] >= x + SPSI_LANES || rows->x1[r] < x) continue;
        if (slender)
            weight = spsi_mul(amplitude, spsi_exp(spsi_fma(dx, spsi_set(b * rows->dy[r]),
                                                           spsi_add(square, spsi_set(c * rows->dy[r] * rows->dy[r])))));
        if (clamped) {
            const spsi_v mean =
                spsi_fma(dx, spsi_set(f->mean_x[i]), spsi_set(f->depth[i] + rows->dy[r] * f->mean_y[i]));
            spsi_limits(spsi_tile_limits(tile, x, y + r), s->sign, s->eye_near, mean, spsi_set(f->per_depth[i]),
                        &sections.low, &sections.high);
        }
        sections.weight =
            spsi_select(spsi_and(spsi_less(spsi_set(rows->left[r]), at), spsi_less(at, spsi_set(rows->right[r]))),
                        weight, spsi_set(0));
        sections.sheet = row + (size_t)rows->first[r] * tile->sheet_size;
        sections.count = rows->slabs[r];
        sections.starts = rows->starts[r];
        sections.ends = rows->ends[r];
        sections.v = spsi_add(v_column, spsi_set(rows->v[r]));
        spsi_add_sections(&sections, SPSI_MASS_KERNEL, clamped);
        if (sloped) {
            const float dy = rows->dy[r];
            const spsi_slopes slopes = {
                {spsi_fma(dx, spsi_set(2 * a), spsi_set(b * dy)), spsi_fma(dx, spsi_set(b), spsi_set(2 * c * dy))},
                {f->slope_x[i], f->slope_y[i]}};
            spsi_add_slopes(&sections, &slopes, tile->channel_size, tile->slopes + (sections.sheet - print->channel));
        }
    }
}

static void spsi_splat_footprint(const spsi_print *print) {
    spsi_tile *tile = print->tile;
    const spsi_splatter *s = print->splatter;
    const spsi_footprints *f = print->footprints;
    const int i = print->lane;
    const float height = f->half_height[i], width = f->half_width[i];
    /* clamped as floats: a footprint may be wider than the range of an int */
    const int y0 = (int)spsi_higher(ceilf(f->y[i] - height), (float)tile->y0);
    const int y1 = (int)spsi_lower(floorf(f->y[i] + height), (float)tile->y1);
    const int x0 = (int)spsi_higher(ceilf(f->x[i] - width), (float)tile->x0);
    const int x1 = (int)spsi_lower(floorf(f->x[i] + width), (float)tile->x1);
    const int clamped =
        tile->clamped && !s->whole &&
        (f->depth[i] + s->reach_depth > tile->nearest_limit || f->depth[i] - s->reach_depth < s->eye_near);
    if (!(tile->open & spsi_patches(tile, x0, y0, x1, y1))) return;
    tile->visits += 1;
    for (int y = y0; y <= y1; y += SPSI_LANES) {
        const int count = spsi_least(SPSI_LANES, y1 - y + 1);
        spsi_rows rows;
        spsi_rows_build(tile, f, i, y, s->cut, &rows);
        for (int r = 0; r < count; ++r) tile->fragments += (uint64_t)rows.area[r];
        for (int x = x0; x <= x1; x += SPSI_LANES)
            if (tile->slopes)
                spsi_splat_columns(print, &rows, count, x, y, 0, 1);
            else if (clamped)
                spsi_splat_columns(print, &rows, count, x, y, 1, 0);
            else
                spsi_splat_columns(print, &rows, count, x, y, 0, 0);
    }
}

/* An ellipsoid along x or y, as the near case sees it: its centre (q, t), its cut, and the covariance of q and t. */
typedef struct spsi_extent {
    float q, t, cut, qq, qt, tt;
} spsi_extent;

/* The extent along x (axis 0) or y; `side` is 1, or -1 for the mirror image behind the eye. */
static spsi_extent spsi_near_extent(const spsi_splatter *s, const float q[3], int axis, float side) {
    const float *c = s->near_case.covariance;
    spsi_extent extent;
    extent.q = side * q[axis];
    extent.t = side * q[2];
    extent.cut = s->cut;
    extent.qq = c[axis == 0 ? 0 : 3];
    extent.qt = c[axis == 0 ? 2 : 4];
    extent.tt = c[5];
    return extent;
}

/* Minimum and maximum pixel coordinate of an ellipsoid, by the tangent planes through the eye; returns 0 if the eye's
   plane cuts it, so that there is no bound. */
static int spsi_extent_range(const spsi_extent *e, float *low, float *high) {
    const float square = e->cut * e->cut, a = e->t * e->t - square * e->tt, b = e->q * e->t - square * e->qt;
    const float root = b * b - a * (e->q * e->q - square * e->qq);
    if (!(a > 1e-4f * e->t * e->t) || e->t < 0) return 0;
    *low = (b - sqrtf(root > 0 ? root : 0)) / a;
    *high = (b + sqrtf(root > 0 ? root : 0)) / a;
    return 1;
}

/* Whether an ellipsoid reaches in front of the eye and meets the rays between two columns (or rows) of pixels: it does
   not if it lies entirely outside of one of the planes through the eye and these. */
static int spsi_extent_meets(const spsi_extent *e, int first, int last) {
    const float ends[2] = {(float)first - 0.5f, (float)last + 0.5f};
    for (int i = 0; i < 2; ++i) {
        const float at = ends[i], variance = e->qq - 2 * at * e->qt + at * at * e->tt, before = e->q - at * e->t;
        if (!((i ? -before : before) + e->cut * sqrtf(spsi_higher(variance, 0)) > 0)) return 0;
    }
    return e->t + e->cut * sqrtf(e->tt) > 0;
}

/* A kernel that is being splatted along each pixel's own ray. */
typedef struct spsi_near_print {
    spsi_tile *tile;
    const spsi_splatter *splatter;
    float q[3];      /* (x t, y t, t) of its centre, in the near case's units */
    float value;     /* of the voxel */
    int x1;          /* the last column */
    int first, last; /* first and last plane of its sections */
    float *channel;
} spsi_near_print;

/* A vector of pixels of the near case: w = (x, y, 1) is the ray, a = w' C^-1 w, and the exponent
   (P x w)' adj(C^-1) (P x w) / a involves no difference of large numbers. */
static inline void spsi_splat_near_row(const spsi_near_print *print, int x, int y) {
    const spsi_tile *tile = print->tile;
    const spsi_splatter *s = print->splatter;
    const float *q = print->q, *c = s->near_case.covariance, *n = s->near_case.inverse, fy = (float)y;
    const int k0 = spsi_most(print->first, 0), k1 = spsi_least(print->last, tile->slab_count);
    const spsi_v at = spsi_add(spsi_set((float)x), spsi_iota()), zero = spsi_set(0);
    const spsi_v nx = spsi_fma(at, spsi_set(n[0]), spsi_set(n[1] * fy + n[2]));
    const spsi_v ny = spsi_fma(at, spsi_set(n[1]), spsi_set(n[3] * fy + n[4]));
    const spsi_v nt = spsi_fma(at, spsi_set(n[2]), spsi_set(n[4] * fy + n[5]));
    const spsi_v a = spsi_max(spsi_fma(at, nx, spsi_fma(spsi_set(fy), ny, nt)), spsi_set(FLT_MIN));
    const spsi_v b = spsi_fma(spsi_set(q[0]), nx, spsi_fma(spsi_set(q[1]), ny, spsi_mul(spsi_set(q[2]), nt)));
    const spsi_v ux = spsi_set(q[1] - q[2] * fy), uy = spsi_sub(spsi_mul(spsi_set(q[2]), at), spsi_set(q[0]));
    const spsi_v ut = spsi_sub(spsi_set(q[0] * fy), spsi_mul(spsi_set(q[1]), at));
    const spsi_v two = spsi_set(2);
    spsi_v e = spsi_mul(spsi_mul(ux, ux), spsi_set(c[0])), root = spsi_sqrt(a), per_depth, mean, crossing, weight;
    spsi_v beyond;
    spsi_sections sections;
    e = spsi_fma(spsi_mul(uy, uy), spsi_set(c[3]), spsi_fma(spsi_mul(ut, ut), spsi_set(c[5]), e));
    e = spsi_fma(two,
                 spsi_fma(spsi_mul(ux, uy), spsi_set(c[1]),
                          spsi_fma(spsi_mul(ux, ut), spsi_set(c[2]), spsi_mul(spsi_mul(uy, ut), spsi_set(c[4])))),
                 e);
    e = spsi_div(e, spsi_mul(a, spsi_set(s->near_case.root * s->near_case.root)));
    per_depth = spsi_mul(root, spsi_set((float)(1 / SPSI_CUT) / s->near_case.unit));
    mean = spsi_mul(spsi_div(b, a), spsi_set(s->near_case.unit));
    crossing = spsi_mul(spsi_set(s->sign), spsi_fma(at, spsi_set(s->slab_x), spsi_set(s->slab_y * fy + s->slab_t)));
    sections.per_plane = spsi_div(per_depth, spsi_max(crossing, spsi_set(1e-20f)));
    sections.v = spsi_sub(spsi_mul(sections.per_plane, spsi_set((float)k0 - tile->eye_slab)),
                          spsi_mul(spsi_mul(mean, per_depth), spsi_set(s->sign)));
    weight =
        spsi_div(spsi_mul(spsi_set(print->value * s->near_case.weight), spsi_exp(spsi_mul(e, spsi_set(-0.5f)))), root);
    weight = spsi_select(spsi_less(e, spsi_set(s->cut * s->cut)), weight, zero);
    sections.weight = spsi_select(spsi_and(spsi_less(at, spsi_set((float)print->x1 + 0.5f)), spsi_less(zero, crossing)),
                                  weight, zero);
    beyond = s->whole ? spsi_set(SPSI_INFINITY) : spsi_tile_limits(tile, x, y);
    spsi_limits(beyond, s->sign, s->eye_near, spsi_sub(mean, spsi_set(s->depth_reference)), per_depth, &sections.low,
                &sections.high);
    sections.sheet =
        print->channel + (size_t)k0 * tile->sheet_size + (size_t)((y - tile->y0) * tile->pitch + (x - tile->x0));
    sections.sheet_size = tile->sheet_size;
    sections.count = k1 - k0;
    sections.starts = k0 == print->first;
    sections.ends = k1 == print->last;
    spsi_add_sections(&sections, SPSI_MASS_KERNEL, 1);
}

/* Whether a kernel, or (side -1) its mirror image behind the eye, meets a tile's rays. */
static int spsi_near_meets(const spsi_tile *tile, const spsi_splatter *s, const float q[3], float side) {
    const spsi_extent x = spsi_near_extent(s, q, 0, side), y = spsi_near_extent(s, q, 1, side);
    return spsi_extent_meets(&x, tile->x0, tile->x1) && spsi_extent_meets(&y, tile->y0, tile->y1);
}

/* Splats a kernel near the eye, at (x t, y t, t). */
static void spsi_splat_near(spsi_tile *tile, const spsi_splatter *s, const float at[3], float slab, float value,
                            float *channel) {
    const int behind = s->whole && fabsf(slab - tile->eye_slab) < s->reach_slabs + SPSI_BEHIND;
    const float side = behind && at[2] < 0 ? -1.0f : 1.0f; /* the mirror image has the same pixels */
    int x0 = tile->x0, x1 = tile->x1, y0 = tile->y0, y1 = tile->y1;
    float low, high;
    spsi_near_print print;
    spsi_extent across, down;
    print.tile = tile;
    print.splatter = s;
    for (int i = 0; i < 3; ++i) print.q[i] = at[i] / s->near_case.unit;
    print.value = value;
    print.first = (int)floorf(slab - s->reach_slabs);
    print.last = (int)floorf(slab + s->reach_slabs) + 1;
    print.channel = channel;
    if (!spsi_near_meets(tile, s, print.q, 1) && !(behind && spsi_near_meets(tile, s, print.q, -1))) return;
    across = spsi_near_extent(s, print.q, 0, side);
    down = spsi_near_extent(s, print.q, 1, side);
    if (spsi_extent_range(&across, &low, &high)) {
        x0 = (int)fmaxf(ceilf(low), (float)x0); /* a tile's margin may lie beyond the image */
        x1 = spsi_least(x1, (int)fminf(floorf(high), (float)SPSI_SIZE_MAX));
    }
    if (spsi_extent_range(&down, &low, &high)) {
        y0 = (int)fmaxf(ceilf(low), (float)y0);
        y1 = spsi_least(y1, (int)fminf(floorf(high), (float)SPSI_SIZE_MAX));
    }
    if (x0 > x1 || y0 > y1 || print.first >= tile->slab_count || print.last <= 0) return;
    if (!(tile->open & spsi_patches(tile, x0, y0, x1, y1))) return;
    print.x1 = x1;
    tile->visits += 1;
    tile->fragments += (uint64_t)(x1 - x0 + 1) * (uint64_t)(y1 - y0 + 1) *
                       (uint64_t)(spsi_least(print.last, tile->slab_count) - spsi_most(print.first, 0));
    for (int y = y0; y <= y1; ++y)
        for (int x = x0; x <= x1; x += SPSI_LANES) spsi_splat_near_row(&print, x, y);
}

/* Splats those voxels of a vector, near the eye, whose bits are set. */
static void spsi_splat_near_voxels(spsi_tile *tile, const spsi_splatter *s, const spsi_v q[3], spsi_v slab,
                                   spsi_v value, int bits, float *channel) {
    float lanes[5][SPSI_LANES];
    for (int i = 0; i < 3; ++i) spsi_store(lanes[i], q[i]);
    spsi_store(lanes[3], slab);
    spsi_store(lanes[4], value);
    for (int i = 0; bits >> i; ++i) {
        const float position[3] = {lanes[0][i], lanes[1][i], lanes[2][i]};
        if (bits >> i & 1) spsi_splat_near(tile, s, position, lanes[3][i], lanes[4][i], channel);
    }
}

/* Ray coordinates, depth and slab coordinate of a vector of a brick's voxels. */
static inline void spsi_voxels_place(const spsi_splatter *s, const spsi_anchor *anchor, const spsi_v at[3], spsi_v q[3],
                                     spsi_v *depth, spsi_v *slab) {
    for (int i = 0; i < 3; ++i) {
        q[i] = spsi_fma(at[2], spsi_set(s->step[2][i]), spsi_set(anchor->q[i]));
        q[i] = spsi_fma(at[0], spsi_set(s->step[0][i]), spsi_fma(at[1], spsi_set(s->step[1][i]), q[i]));
    }
    *depth = spsi_add(spsi_sub(q[2], spsi_set(anchor->q[2])), spsi_set(anchor->depth));
    *slab = spsi_fma(at[2], spsi_set(s->slab_step[2]), spsi_set(anchor->slab));
    *slab = spsi_fma(at[0], spsi_set(s->slab_step[0]), spsi_fma(at[1], spsi_set(s->slab_step[1]), *slab));
}

/* Bit mask of a vector's footprints that reach into the tile. */
static inline int spsi_footprints_inside(const spsi_tile *tile, const spsi_footprints *f) {
    const spsi_v x = spsi_load(f->x), width = spsi_load(f->half_width);
    const spsi_v y = spsi_load(f->y), height = spsi_load(f->half_height);
    const spsi_m m0 = spsi_and(spsi_less(spsi_sub(x, width), spsi_set((float)tile->x1 + 0.5f)),
                               spsi_less(spsi_set((float)tile->x0 - 0.5f), spsi_add(x, width)));
    const spsi_m m1 = spsi_and(spsi_less(spsi_sub(y, height), spsi_set((float)tile->y1 + 0.5f)),
                               spsi_less(spsi_set((float)tile->y0 - 0.5f), spsi_add(y, height)));
    return spsi_bits(spsi_and(spsi_and(m0, m1), spsi_less(spsi_set(0), spsi_load(f->per_slab))));
}

/* Splats the voxels of one brick into a tile. */
static void spsi_splat_brick(spsi_tile *tile, const spsi_splatter *s, const spsi_anchor *anchor,
                             const spsi_segment *segment, const spsi_brick *brick, float *channel) {
    const spsi_v reach = spsi_set(s->reach_slabs);
    spsi_footprints f;
    spsi_print print;
    print.tile = tile;
    print.splatter = s;
    print.footprints = &f;
    print.channel = channel;
    memset(&f, 0, sizeof f); /* compilers do not see that perspective fills it in later */
    if (!s->perspective) spsi_footprint_shape(s, spsi_set(0), spsi_set(0), spsi_set(1), spsi_set(1), &f);
    const float unit = f.amplitude[0];
    for (int i = 0; i < brick->count; i += SPSI_LANES) {
        const int at = brick->first + i;
        const int all = brick->count - i < SPSI_LANES ? (1 << (brick->count - i)) - 1 : (1 << SPSI_LANES) - 1;
        const spsi_v value = spsi_load(segment->value + at);
        const spsi_v steps[3] = {spsi_load(segment->x + at), spsi_load(segment->y + at), spsi_load(segment->z + at)};
        spsi_v q[3], depth, slab;
        int bits, near_bits;
        spsi_voxels_place(s, anchor, steps, q, &depth, &slab);
        bits = all & spsi_bits(spsi_and(spsi_less(spsi_sub(slab, reach), spsi_set((float)tile->slab_count)),
                                        spsi_less(spsi_set(0), spsi_add(slab, reach))));
        if (!bits) continue;
        near_bits = s->perspective ? bits & spsi_bits(spsi_less(q[2], spsi_set(s->near_depth))) : 0;
        bits &= ~near_bits;
        spsi_store(f.depth, depth);
        spsi_store(f.slab, slab);
        if (s->perspective) {
            const spsi_v t = spsi_max(q[2], spsi_set(s->near_depth));
            spsi_store(f.x, spsi_div(q[0], t));
            spsi_store(f.y, spsi_div(q[1], t));
            if (bits) spsi_footprint_shape(s, spsi_load(f.x), spsi_load(f.y), t, value, &f);
        } else {
            spsi_store(f.x, q[0]);
            spsi_store(f.y, q[1]);
            spsi_store(f.amplitude, spsi_mul(value, spsi_set(unit)));
        }
        if (bits) bits &= spsi_footprints_inside(tile, &f);
        for (print.lane = 0; bits >> print.lane; ++print.lane)
            if (bits >> print.lane & 1) spsi_splat_footprint(&print);
        if (near_bits) spsi_splat_near_voxels(tile, s, q, slab, value, near_bits, channel);
    }
}

/* Position of a brick for these rays and slabs; slab coordinates are relative to `first_slab`. */
static void spsi_anchor_build(const spsi_lattice *lattice, const spsi_brick *brick, const spsi_rays *rays,
                              const spsi_slabs *slabs, int first_slab, spsi_anchor *anchor) {
    double at[3], point[3], offset[3], q[3];
    for (int i = 0; i < 3; ++i) at[i] = brick->base[i] + 0.5;
    spsi_voxel_position(lattice, at, point);
    spsi_along(point, rays->origin, -1, offset);
    spsi_to_rays(rays, offset, q);
    for (int i = 0; i < 3; ++i) anchor->q[i] = (float)q[i];
    anchor->depth = (float)(q[2] - rays->depth_reference);
    anchor->slab = (float)(spsi_slab_at(slabs, point) - first_slab);
}

/* --- particles --- */

/* Constants shared by all particles of a sweep, for one set of rays. */
typedef struct spsi_crossing {
    const spsi_rays *rays;
    float sign;                   /* -1 where rays cross the slabs against their order, else 1 */
    float slab_x, slab_y, slab_t; /* slab coordinate along a ray: (slab_t + x slab_x + y slab_y) per t */
    float eye_near;               /* t at which rays begin, as t - depth_reference */
    double row[3], slab_origin;   /* slab coordinate: row . p - slab_origin */
    double reach;                 /* change of slab coordinate per world unit, perpendicular to slabs */
    double reach_depth;           /* maximum change of t per world unit, along the rays' axis */
} spsi_crossing;

/* A particle as one set of rays sees it, in one chunk of slabs. */
typedef struct spsi_seen {
    spsi_ball ball;
    float weight;         /* extinction in the middle */
    float slab;           /* slab coordinate of the centre, relative to the chunk's first slab */
    float reach;          /* radius in slabs */
    float reach_depth;    /* maximum radius in t */
    float tilt_x, tilt_y; /* change of slab coordinate from pixel to pixel at constant t */
    int channel;          /* of the sheets */
    int list;             /* the tiles' list that it is in, >>targets; -1: none */
} spsi_seen;

static void spsi_crossing_build(const spsi_rays *rays, const spsi_slabs *slabs, int backwards,
                                spsi_crossing *crossing) {
    memset(crossing, 0, sizeof *crossing);
    crossing->rays = rays;
    crossing->sign = backwards ? -1.0f : 1.0f;
    for (int i = 0; i < 3; ++i) crossing->row[i] = slabs->normal[i] / slabs->thickness;
    crossing->slab_origin = slabs->start / slabs->thickness;
    if (rays->perspective) {
        crossing->slab_x = (float)spsi_dot(crossing->row, rays->a);
        crossing->slab_y = (float)spsi_dot(crossing->row, rays->b);
    }
    crossing->slab_t = (float)spsi_dot(crossing->row, rays->c);
    crossing->eye_near = spsi_rays_begin(rays);
    crossing->reach = 1 / slabs->thickness;
    crossing->reach_depth = spsi_length(rays->inverse[2]);
}

/* Slab coordinate of a particle's centre, and its radius in slabs, for these rays. */
static void spsi_particle_slabs(const spsi_crossing *crossing, const spsi_particle_set *set,
                                const sps_particle *particle, double *slab, double *reach) {
    const spsi_rays *rays = crossing->rays;
    double centre[3], offset[3], radius;
    spsi_ball size;
    for (int i = 0; i < 3; ++i) centre[i] = (double)particle->position[i];
    spsi_along(centre, rays->origin, -1, offset);
    spsi_ball_size(rays, set, particle, offset, &size, &radius);
    *slab = spsi_dot(crossing->row, centre) - crossing->slab_origin;
    *reach = radius * crossing->reach;
}

static void spsi_seen_build(const spsi_crossing *crossing, const spsi_particle_set *set, const sps_particle *particle,
                            int channel, int first_slab, spsi_seen *seen) {
    const spsi_rays *rays = crossing->rays;
    double slab, reach, t;
    spsi_ball_build(rays, set, particle, &seen->ball);
    spsi_particle_slabs(crossing, set, particle, &slab, &reach);
    if (!(seen->ball.depth >= SPSI_VALUE_MIN)) seen->ball.x1 = -1; /* widened to a pixel, it is too thin to count */
    t = rays->perspective ? (double)seen->ball.t + rays->depth_reference : 1;
    seen->slab = (float)(slab - first_slab);
    seen->reach = (float)reach;
    reach /= crossing->reach;
    seen->reach_depth = (float)(reach * crossing->reach_depth);
    seen->weight = (float)fmin((double)seen->ball.depth / (seen->ball.soft ? 4.0 / 3 : 2.0) / reach, 1e30);
    seen->tilt_x = (float)(spsi_dot(crossing->row, rays->a) * t);
    seen->tilt_y = (float)(spsi_dot(crossing->row, rays->b) * t);
    seen->channel = channel;
}

/* A ball that is being splatted into a tile: its box there, and its slabs. */
typedef struct spsi_ball_print {
    const spsi_tile *tile;
    const spsi_crossing *crossing;
    const spsi_seen *seen;
    int x0, x1, y0, y1; /* inclusive */
    int first, last;    /* slabs; the last is exclusive */
    int starts;         /* 1: the first slab also receives what a particle widened to a pixel has before it */
    int ends;           /* 1: the last slab also receives what it has behind that */
} spsi_ball_print;

/* Positions along a vector of chords at which the rays cross the slabs of a chunk, in half chords from the middle. */
static inline void spsi_print_planes(const spsi_ball_print *print, const spsi_chord *chord, int x, int y, int clamped,
                                     spsi_sections *sections) {
    const spsi_tile *tile = print->tile;
    const spsi_crossing *crossing = print->crossing;
    const spsi_seen *seen = print->seen;
    const spsi_v at = spsi_add(spsi_set((float)x), spsi_iota()), zero = spsi_set(0);
    const spsi_v slope =
        spsi_fma(at, spsi_set(crossing->slab_x), spsi_set(crossing->slab_t + (float)y * crossing->slab_y));
    const spsi_v rate = spsi_max(spsi_mul(slope, spsi_set(crossing->sign)), spsi_set(1e-20f));
    spsi_v middle, step;
    if (seen->ball.near_by) {
        const float eye_slab = tile->eye_slab - (float)(tile->slab_count - SPSI_CHUNK) / 2;
        middle = spsi_fma(spsi_add(chord->middle, spsi_set((float)crossing->rays->depth_reference)), slope,
                          spsi_set(eye_slab));
    } else {
        const float dy = (float)(y - seen->ball.y0) - seen->ball.y;
        const spsi_v dx = spsi_add(spsi_set((float)(x - seen->ball.x0) - seen->ball.x), spsi_iota());
        middle = spsi_fma(dx, spsi_set(seen->tilt_x), spsi_set(seen->slab + dy * seen->tilt_y));
        middle = spsi_fma(spsi_sub(chord->middle, spsi_set(seen->ball.t)), slope, middle);
    }
    step = spsi_div(spsi_set(1), spsi_max(spsi_mul(rate, chord->half), spsi_set(1e-20f)));
    sections->per_plane = step;
    sections->v = spsi_fma(step, spsi_set((float)print->first), spsi_mul(spsi_sub(zero, middle), step));
    sections->low = spsi_set(-1);
    sections->high = spsi_set(1);
    if (!clamped) return;
    spsi_limits(spsi_tile_limits(tile, x, y), crossing->sign, crossing->eye_near, chord->middle, spsi_mul(step, rate),
                &sections->low, &sections->high);
    sections->low = spsi_clamp(sections->low, spsi_set(-1), spsi_set(1));
    sections->high = spsi_clamp(sections->high, spsi_set(-1), spsi_set(1));
}

/* Splats one row of a ball. `row`: its first sheet, at print->x0. */
static inline void spsi_splat_row(const spsi_ball_print *print, int y, int clamped, float *row) {
    const spsi_ball *ball = &print->seen->ball;
    const spsi_mass mass = ball->soft ? SPSI_MASS_SOFT_CHORD : SPSI_MASS_CHORD;
    const spsi_v zero = spsi_set(0), beyond = spsi_set((float)print->x1 + 0.5f);
    spsi_sections sections;
    sections.sheet_size = print->tile->sheet_size;
    sections.count = print->last - print->first;
    sections.starts = print->starts;
    sections.ends = print->ends;
    for (int x = print->x0; x <= print->x1; x += SPSI_LANES) {
        const spsi_v at = spsi_add(spsi_set((float)x), spsi_iota());
        spsi_chord chord;
        spsi_v weight;
        spsi_m inside;
        spsi_ball_chord(print->crossing->rays, ball, x, y, &chord);
        inside = spsi_and(spsi_less(zero, chord.share), spsi_less(at, beyond));
        if (!spsi_bits(inside)) continue;
        spsi_print_planes(print, &chord, x, y, clamped, &sections);
        weight = spsi_mul(spsi_mul(chord.half, spsi_set(2)), spsi_set(print->seen->weight));
        if (ball->soft) weight = spsi_mul(weight, spsi_mul(spsi_mul(chord.share, chord.share), spsi_set(2.0f / 3)));
        sections.weight = spsi_select(inside, weight, zero);
        sections.sheet = row + (x - print->x0);
        spsi_add_sections(&sections, mass, 1);
    }
}

/* Splats a particle into a tile's slabs of a chunk. `starts`: this chunk is the first; `left`: number of slabs from its
   first one to the last of all. */
static void spsi_splat_particle(spsi_tile *tile, const spsi_crossing *crossing, const spsi_seen *seen, int starts,
                                int left) {
    const spsi_ball *ball = &seen->ball;
    const int margin = (tile->slab_count - SPSI_CHUNK) / 2;
    const float rounding = 1e-4f + 1e-6f * (fabsf(seen->slab) + seen->reach);
    const float low = seen->slab - seen->reach - rounding, high = seen->slab + seen->reach + rounding;
    const int clamped = ball->near_by || (tile->clamped && (ball->t + seen->reach_depth > tile->nearest_limit ||
                                                            ball->t - seen->reach_depth < crossing->eye_near));
    spsi_ball_print p;
    p.tile = tile;
    p.crossing = crossing;
    p.seen = seen;
    p.x0 = spsi_most(ball->x0, tile->x0 + tile->margin), p.x1 = spsi_least(ball->x1, tile->x1 - tile->margin);
    p.y0 = spsi_most(ball->y0, tile->y0 + tile->margin), p.y1 = spsi_least(ball->y1, tile->y1 - tile->margin);
    p.first = (int)floorf(spsi_lower(spsi_higher(low, 0), (float)(spsi_least(left, SPSI_CHUNK) - 1)));
    p.last = (int)ceilf(spsi_lower(spsi_higher(high, (float)(p.first + 1)), (float)spsi_least(left, SPSI_CHUNK)));
    p.starts = starts && p.first == 0;
    p.ends = p.last == left;
    if (p.x0 > p.x1 || p.y0 > p.y1 || !(tile->open & spsi_patches(tile, p.x0, p.y0, p.x1, p.y1))) return;
    tile->visits += 1;
    tile->fragments += (uint64_t)(p.x1 - p.x0 + 1) * (uint64_t)(p.y1 - p.y0 + 1) * (uint64_t)(p.last - p.first);
    for (int y = p.y0; y <= p.y1; ++y) {
        float *row = tile->sheets + (size_t)seen->channel * tile->channel_size +
                     (size_t)(p.first + margin) * tile->sheet_size +
                     (size_t)((y - tile->y0) * tile->pitch + (p.x0 - tile->x0));
        if (clamped)
            spsi_splat_row(&p, y, 1, row);
        else
            spsi_splat_row(&p, y, 0, row);
    }
}

/* ============================================================================================== >>targets
   21 Filling sheets. A target is a grid of rays with sheets between slabs: the eye's, a light's, that of a face of a
   map. The bricks and particles in a chunk of SPSI_CHUNK slabs are splatted into it tile by tile. A tile belongs to one
   task, which adds bricks and then particles in the order of their numbers, so every pixel is the same sum for any
   number of workers and any region. Bricks and particles are kept in queues, sorted by the first chunk that they reach.
   A tile costs one comparison per brick of the chunk; particles are binned by tile. Once all rays through a patch of
   8 x 8 pixels or texels have ended, a footprint that lies in such patches only costs one test. */

/* --- contents of the slabs --- */

/* Items sorted by the first chunk that they reach. */
typedef struct spsi_queue {
    uint16_t (*chunks)[2]; /* per item: the first and the last */
    int *order;            /* items sorted by first chunk, then by number */
    int *starts;           /* per chunk: index in `order` of the first item that begins there; one more at the end */
    int *present;          /* items in the current chunk, sorted by number */
    int count;             /* of all items */
    int current;           /* number of items present */
} spsi_queue;

static size_t spsi_queue_bytes(size_t items, size_t chunks) {
    return items * (2 * sizeof(int) + 2 * sizeof(uint16_t)) + 2 * (chunks + 1) * sizeof(int);
}

static sps_result spsi_queue_reserve(sps_context *context, spsi_buffer_id id, int count, int chunks,
                                     spsi_queue *queue) {
    queue->count = count;
    queue->order = (int *)spsi_reserve(context, id, 1, spsi_queue_bytes((size_t)count, (size_t)chunks));
    if (!queue->order) return context->result;
    queue->present = queue->order + count;
    queue->starts = queue->present + count;
    queue->chunks = (uint16_t(*)[2])(void *)(queue->starts + 2 * (chunks + 1));
    return SPS_OK;
}

/* Sets the chunks of an item that lies between two slab coordinates. */
static void spsi_queue_set(spsi_queue *queue, int item, int chunks, double low, double high) {
    queue->chunks[item][0] = (uint16_t)fmin(fmax(floor(low / SPSI_CHUNK), 0), chunks - 1);
    queue->chunks[item][1] = (uint16_t)fmin(fmax(floor(high / SPSI_CHUNK), 0), chunks - 1);
}

/* Counting sort of the items by first chunk; returns the maximum number of items in a chunk. */
static int spsi_queue_sort(spsi_queue *queue, int chunks) {
    int *passing = queue->starts + chunks + 1, here = 0, most = 0;
    memset(queue->starts, 0, ((size_t)chunks + 1) * sizeof(int));
    memset(passing, 0, ((size_t)chunks + 1) * sizeof(int));
    for (int i = 0; i < queue->count; ++i) {
        queue->starts[queue->chunks[i][0] + 1] += 1;
        passing[queue->chunks[i][1] + 1] += 1; /* left behind by the chunk, but not by the one before it */
    }
    for (int chunk = 0; chunk < chunks; ++chunk) {
        here += queue->starts[chunk + 1] - passing[chunk];
        most = spsi_most(most, here);
        queue->starts[chunk + 1] += queue->starts[chunk];
    }
    memcpy(passing, queue->starts, ((size_t)chunks + 1) * sizeof(int));
    for (int i = 0; i < queue->count; ++i) queue->order[passing[queue->chunks[i][0]]++] = i;
    return most;
}

/* Advances to the next chunk, or starts over with chunk 0. Items that reach into it stay; items that begin in it are
   merged with them, from the end of the list backwards, in place. */
static void spsi_queue_advance(spsi_queue *queue, int chunk) {
    int held = 0, added;
    const int *next;
    if (queue->count == 0) return;
    for (int i = 0; i < queue->current && chunk > 0; ++i)
        if (queue->chunks[queue->present[i]][1] >= chunk) queue->present[held++] = queue->present[i];
    next = queue->order + queue->starts[chunk];
    added = queue->starts[chunk + 1] - queue->starts[chunk];
    queue->current = held + added;
    for (int at = queue->current - 1; added > 0; --at)
        queue->present[at] =
            held > 0 && queue->present[held - 1] > next[added - 1] ? queue->present[--held] : next[--added];
}

/* Whether any voxel or particle was read. */
static int spsi_holds_gas(const sps_context *context, const spsi_frame *frame) {
    return context->brick_count > 0 || frame->content->particle_count > 0;
}

/* --- a target --- */

/* A chunk's particles as a target's rays see them, binned by tile. A particle that reaches into at most two by two
   tiles is listed with the top left one; wider particles are in the last list, which every tile reads. */
typedef struct spsi_lists {
    spsi_seen *seen;
    int *members; /* 4 * index in `seen`, plus 1 if the particle reaches the next column of tiles, plus 2: the next row
                   */
    int *starts;  /* per tile, and one more: index of its first member */
} spsi_lists;

/* The workers' sheets, one tile each. */
typedef struct spsi_sheets {
    float *memory;
    size_t floats; /* per worker */
    int worker_count;
} spsi_sheets;

/* Extents of a tile's sheets. */
typedef struct spsi_shape {
    int channels;
    int margin;      /* pixels around a tile, for gradients, which read neighbours */
    int slab_margin; /* slabs before and after a chunk: one for profiles, one for gradients */
} spsi_shape;

typedef struct spsi_target {
    const spsi_frame *frame;
    const spsi_rays *rays;
    const spsi_slabs *slabs;
    double origin_slab; /* slab coordinate of the rays' origin */
    int columns, rows;  /* of tiles */
    spsi_shape shape;
    int channels[SPSI_VOLUMES_MAX];       /* of each lattice; -1: it is not splatted */
    int slope_channels[SPSI_VOLUMES_MAX]; /* of its d/dx, followed by d/dy; -1: none */
    int set_channels[SPSI_SETS_MAX];      /* of each set of particles */
    spsi_splatter splatters[SPSI_VOLUMES_MAX];
    spsi_crossing crossing;
    int16_t (*brick_boxes)[4]; /* x0, y0, x1, y1 of each brick, in pixels; x1 < x0: nowhere */
    spsi_lists particles;
    spsi_sheets sheets;
    uint64_t (*counts)[2]; /* per worker: footprints and fragments */
} spsi_target;

/* The bricks and particles of a frame, one chunk of slabs at a time, and the targets that they are splatted into, which
   have these slabs in common. */
typedef struct spsi_contents {
    sps_context *context;
    const spsi_frame *frame;
    const spsi_slabs *slabs;
    spsi_target *targets[2];
    int target_count;
    const spsi_brick *list;
    spsi_queue bricks, particles;
    int first_slab; /* of the current chunk */
} spsi_contents;

static void spsi_contents_advance(spsi_contents *contents, int chunk) {
    contents->first_slab = chunk * SPSI_CHUNK;
    spsi_queue_advance(&contents->bricks, chunk);
    spsi_queue_advance(&contents->particles, chunk);
}

static size_t spsi_shape_floats(const spsi_shape *shape) {
    const int pixels = 2 * shape->margin, slabs = SPSI_CHUNK + 2 * shape->slab_margin;
    return (size_t)shape->channels * (size_t)(slabs * (SPSI_TILE_WIDTH + pixels) * (SPSI_TILE_HEIGHT + pixels)) +
           2 * SPSI_LANES;
}

/* The eye's sheets have a channel for each material. Classified volumes interpolate from slab to slab, and gradients
   read up to two slabs and pixels to either side. */
static spsi_shape spsi_eye_shape(const spsi_frame *frame) {
    spsi_shape shape;
    shape.channels = frame->matter.material_count * (frame->gradients.splatted ? 3 : 1);
    shape.margin = frame->gradients.reach;
    shape.slab_margin = frame->matter.classifies + frame->gradients.exist;
    return shape;
}

/* A light's sheets have a channel for all gases, and one for each classified volume. */
static spsi_shape spsi_light_shape(const spsi_frame *frame) {
    spsi_shape shape;
    shape.channels = frame->matter.light_channel_count;
    shape.margin = 0;
    shape.slab_margin = frame->matter.classifies;
    return shape;
}

/* The channel of the d/dx of a channel of the eye's sheets; that of the d/dy follows. */
static int spsi_slope_channel(const spsi_frame *frame, int channel) {
    return frame->matter.material_count + 2 * channel;
}

static void spsi_target_place(const spsi_frame *frame, const spsi_rays *rays, const spsi_slabs *slabs,
                              spsi_target *target) {
    target->frame = frame;
    target->rays = rays;
    target->slabs = slabs;
    target->origin_slab = spsi_slab_at(slabs, rays->origin);
    target->columns = spsi_tile_columns(rays);
    target->rows = spsi_tile_rows(rays);
    for (int i = 0; i < frame->medium_count; ++i) target->channels[i] = target->slope_channels[i] = -1;
}

static sps_result spsi_target_refuse(sps_context *context, const spsi_medium *medium) {
    return spsi_fail_field(context, SPS_ERROR_UNSUPPORTED, SPS_OBJECT_VOLUME, medium->index, "placement's voxel edge",
                           cbrt(medium->lattice->voxel_volume),
                           "it is too large or too small for the world, or for this view's pixels");
}

/* The eye as a target; `backwards`: its rays cross the slabs against their order. */
static sps_result spsi_target_of_eye(sps_context *context, const spsi_frame *frame, const spsi_slabs *slabs,
                                     int backwards, spsi_target *target) {
    spsi_target_place(frame, &frame->content->eye, slabs, target);
    target->shape = spsi_eye_shape(frame);
    spsi_crossing_build(&frame->content->eye, slabs, backwards, &target->crossing);
    for (int i = 0; i < frame->particles.set_count; ++i) target->set_channels[i] = frame->particles.sets[i].channel;
    for (int i = 0; i < frame->medium_count && context->brick_count > 0; ++i) {
        const spsi_medium *medium = &frame->media[i];
        const spsi_material *material = &frame->matter.materials[medium->channel];
        spsi_splatter *splatter = &target->splatters[i];
        target->channels[i] = medium->channel;
        if (frame->gradients.splatted && material->table && material->shading == SPS_SHADING_SURFACE)
            target->slope_channels[i] = spsi_slope_channel(frame, medium->channel);
        if (!spsi_splatter_build(medium->lattice, &frame->content->eye, slabs, 1, frame->accuracy.cut, splatter))
            return spsi_target_refuse(context, medium);
        if (backwards) splatter->sign = -1;
        if (material->table) spsi_splatter_classified(splatter);
    }
    return SPS_OK;
}

/* The rays of a light or of a map's face as a target. Its sheets hold the optical depth of gases and the values of
   classified volumes, whose kernels end at `classified_cut`. */
static sps_result spsi_target_of_light(sps_context *context, const spsi_frame *frame, const spsi_rays *rays,
                                       const spsi_slabs *slabs, double classified_cut, spsi_target *target) {
    spsi_target_place(frame, rays, slabs, target);
    target->shape = spsi_light_shape(frame);
    spsi_crossing_build(rays, slabs, 0, &target->crossing);
    for (int i = 0; i < frame->particles.set_count; ++i) target->set_channels[i] = 0;
    for (int i = 0; i < frame->medium_count && context->brick_count > 0; ++i) {
        const spsi_medium *medium = &frame->media[i];
        const spsi_material *material = &frame->matter.materials[medium->channel];
        const float scale = material->table ? 1 : material->extinction;
        if (!material->extinguishes) continue;
        target->channels[i] = medium->light_channel;
        if (!spsi_splatter_build(medium->lattice, rays, slabs, scale,
                                 material->table ? classified_cut : frame->accuracy.cut, &target->splatters[i]))
            return spsi_target_refuse(context, medium);
    }
    return SPS_OK;
}

/* Allocates the workers' scratch: a tile of sheets, shared by the targets, and counters for each target. */
static sps_result spsi_targets_reserve(const spsi_contents *contents) {
    sps_context *context = contents->context;
    const int count = contents->target_count;
    const size_t workers = (size_t)spsi_worker_count(context);
    size_t floats = 0;
    uint64_t *counts;
    float *sheets;
    for (int i = 0; i < count; ++i) {
        const size_t own = spsi_shape_floats(&contents->targets[i]->shape);
        floats = own > floats ? own : floats;
    }
    floats = (floats + 1) / 2 * 2; /* keeps the counters aligned */
    sheets = (float *)spsi_reserve(context, SPSI_BUFFER_SHEETS, workers,
                                   floats * sizeof(float) + 2 * (size_t)count * sizeof(uint64_t));
    if (!sheets) return context->result;
    counts = (uint64_t *)(void *)(sheets + workers * floats);
    memset(counts, 0, 2 * (size_t)count * workers * sizeof *counts);
    for (int i = 0; i < count; ++i) {
        spsi_target *target = contents->targets[i];
        target->sheets.memory = sheets;
        target->sheets.floats = floats;
        target->sheets.worker_count = (int)workers;
        target->counts = (uint64_t(*)[2])(void *)(counts + 2 * (size_t)i * workers);
    }
    return SPS_OK;
}

/* --- where bricks and particles are --- */

/* The range of slab coordinates of the centres of a brick's voxels. */
static void spsi_brick_slabs(const spsi_lattice *lattice, const spsi_brick *brick, const spsi_slabs *slabs, double *low,
                             double *high) {
    *low = HUGE_VAL;
    *high = -HUGE_VAL;
    for (int corner = 0; corner < 8; ++corner) {
        double at[3], point[3], slab;
        for (int k = 0; k < 3; ++k) at[k] = brick->base[k] + 0.5 + (corner >> k & 1 ? brick->high[k] : brick->low[k]);
        spsi_voxel_position(lattice, at, point);
        slab = spsi_slab_at(slabs, point);
        *low = fmin(*low, slab);
        *high = fmax(*high, slab);
    }
}

/* The pixels that a brick's kernels may reach; `behind`: 1 if rays extend behind their origin. */
static void spsi_brick_box(const spsi_lattice *lattice, const spsi_brick *brick, const spsi_target *target, int behind,
                           int16_t box[4]) {
    const spsi_rays *rays = target->rays;
    double low[2] = {HUGE_VAL, HUGE_VAL}, high[2] = {-HUGE_VAL, -HUGE_VAL};
    const double filter = SPSI_PIXEL_SIGMA * SPSI_CUT + target->shape.margin + 1;
    int ahead = 0, back = 0;
    for (int corner = 0; corner < 8; ++corner) {
        double at[3], point[3], q[3];
        for (int k = 0; k < 3; ++k)
            at[k] = brick->base[k] + 0.5 + (corner >> k & 1 ? brick->high[k] + SPSI_REACH : brick->low[k] - SPSI_REACH);
        spsi_voxel_position(lattice, at, point);
        spsi_project(rays, point, q);
        ahead += !rays->perspective || q[2] > 0;
        back += rays->perspective && q[2] < 0;
        if (rays->perspective && q[2] < 0) q[0] /= q[2], q[1] /= q[2];
        for (int k = 0; k < 2; ++k) low[k] = fmin(low[k], q[k]), high[k] = fmax(high[k], q[k]);
    }
    if (ahead == 0 && !behind)
        low[0] = HUGE_VAL, high[0] = -HUGE_VAL;
    else if (ahead < 8 && back < 8)
        low[0] = low[1] = -HUGE_VAL, high[0] = high[1] = HUGE_VAL;
    box[0] = (int16_t)floor(fmin(fmax(low[0] - filter, 0), rays->width));
    box[1] = (int16_t)floor(fmin(fmax(low[1] - filter, 0), rays->height));
    box[2] = (int16_t)floor(fmax(fmin(high[0] + filter, rays->width - 1), -1));
    box[3] = (int16_t)floor(fmax(fmin(high[1] + filter, rays->height - 1), -1));
}

static void spsi_bricks_task(void *data, int index, int worker) {
    spsi_contents *contents = (spsi_contents *)data;
    const int end = spsi_batch_end(index, contents->bricks.count), chunks = spsi_chunk_count(contents->slabs);
    (void)worker;
    for (int i = index * SPSI_BATCH; i < end; ++i) {
        const spsi_brick *brick = &contents->list[i];
        const spsi_lattice *lattice = &contents->frame->lattices[brick->lattice];
        double low, high, farthest = 0;
        spsi_brick_slabs(lattice, brick, contents->slabs, &low, &high);
        for (int n = 0; n < contents->target_count; ++n) {
            const spsi_target *target = contents->targets[n];
            const spsi_splatter *splatter = &target->splatters[brick->lattice];
            const double reach = (double)splatter->reach_slabs + target->shape.slab_margin + 1e-3;
            const double eye_slab = target->origin_slab;
            const int behind = splatter->whole && low - reach < eye_slab + 1 && high + reach > eye_slab - 1;
            farthest = fmax(farthest, reach);
            spsi_brick_box(lattice, brick, target, behind, target->brick_boxes[i]);
        }
        spsi_queue_set(&contents->bricks, i, chunks, low - farthest, high + farthest);
    }
}

/* The chunks that particles touch, in any target. */
static void spsi_particles_task(void *data, int index, int worker) {
    spsi_contents *contents = (spsi_contents *)data;
    const spsi_frame *frame = contents->frame;
    const int end = spsi_batch_end(index, frame->content->particle_count), chunks = spsi_chunk_count(contents->slabs);
    (void)worker;
    for (int i = index * SPSI_BATCH; i < end; ++i) {
        const spsi_particle_set *set = spsi_set_of(frame, i);
        double slab = 0, reach, farthest = 0, room;
        for (int n = 0; n < contents->target_count; ++n) {
            spsi_particle_slabs(&contents->targets[n]->crossing, set, &frame->content->particles[i], &slab, &reach);
            farthest = fmax(farthest, reach);
        }
        room = farthest + 1e-3 + 1e-6 * farthest;
        spsi_queue_set(&contents->particles, i, chunks, slab - room, slab + room);
    }
}

/* Number of list starts: one per tile, one for wide particles, and the end. */
static size_t spsi_list_starts(const spsi_rays *rays) {
    return (size_t)spsi_tile_columns(rays) * (size_t)spsi_tile_rows(rays) + 2;
}

/* Bytes of a target's lists for a given number of particles in a chunk. If they exceed a size_t: SIZE_MAX, which cannot
   be reserved. */
static size_t spsi_lists_bytes(const spsi_rays *rays, size_t particles) {
    const size_t each = sizeof(spsi_seen) + sizeof(int), starts = spsi_list_starts(rays) * sizeof(int);
    if (particles == 0) return 0;
    return particles > (SIZE_MAX - starts) / each ? SIZE_MAX : particles * each + starts;
}

static sps_result spsi_lists_reserve(sps_context *context, spsi_buffer_id id, int most, spsi_target *target) {
    spsi_lists *lists = &target->particles;
    lists->seen = (spsi_seen *)spsi_reserve(context, id, 1, spsi_lists_bytes(target->rays, (size_t)most));
    if (!lists->seen) return context->result;
    lists->members = (int *)(void *)(lists->seen + most);
    lists->starts = lists->members + most;
    return SPS_OK;
}

/* Finds the chunks and boxes of all bricks, and allocates the targets' sheets. `second` may be NULL. */
static sps_result spsi_contents_build(sps_context *context, spsi_target *first, spsi_target *second,
                                      spsi_contents *contents) {
    static const spsi_buffer_id boxes[2] = {SPSI_BUFFER_BRICK_BOXES, SPSI_BUFFER_BRICK_LIGHT_BOXES};
    const int chunks = spsi_chunk_count(first->slabs), count = context->brick_count;
    contents->context = context;
    contents->frame = first->frame;
    contents->slabs = first->slabs;
    contents->targets[0] = first;
    contents->targets[1] = second;
    contents->target_count = second ? 2 : 1;
    contents->list = (const spsi_brick *)context->buffers[SPSI_BUFFER_BRICKS].data;
    if (spsi_targets_reserve(contents)) return context->result;
    if (spsi_queue_reserve(context, SPSI_BUFFER_BRICK_QUEUE, count, chunks, &contents->bricks)) return context->result;
    for (int i = 0; i < contents->target_count; ++i) {
        spsi_target *target = contents->targets[i];
        target->brick_boxes =
            (int16_t(*)[4])spsi_reserve(context, boxes[i], (size_t)count, sizeof *target->brick_boxes);
        if (!target->brick_boxes) return context->result;
    }
    spsi_parallel_batches(context, count, spsi_bricks_task, contents);
    spsi_queue_sort(&contents->bricks, chunks);
    return SPS_OK;
}

/* The same for particles. */
static sps_result spsi_contents_add_particles(spsi_contents *contents) {
    static const spsi_buffer_id lists[2] = {SPSI_BUFFER_EYE_BALLS, SPSI_BUFFER_LIGHT_BALLS};
    sps_context *context = contents->context;
    const int chunks = spsi_chunk_count(contents->slabs), count = contents->frame->content->particle_count;
    int fullest;
    if (count == 0) return SPS_OK;
    if (spsi_queue_reserve(context, SPSI_BUFFER_PARTICLE_QUEUE, count, chunks, &contents->particles))
        return context->result;
    spsi_parallel_batches(context, count, spsi_particles_task, contents);
    fullest = spsi_queue_sort(&contents->particles, chunks);
    for (int i = 0; i < contents->target_count; ++i)
        if (spsi_lists_reserve(context, lists[i], fullest, contents->targets[i])) return context->result;
    return SPS_OK;
}

/* --- a chunk's particles, by tile --- */

/* The list that a particle belongs in. */
static int spsi_list_of(const spsi_target *target, const spsi_ball *ball) {
    const int x0 = ball->x0 / SPSI_TILE_WIDTH, x1 = ball->x1 / SPSI_TILE_WIDTH;
    const int y0 = ball->y0 / SPSI_TILE_HEIGHT, y1 = ball->y1 / SPSI_TILE_HEIGHT;
    if (ball->x1 < ball->x0 || ball->y1 < ball->y0) return -1;
    return x1 - x0 <= 1 && y1 - y0 <= 1 ? y0 * target->columns + x0 : target->columns * target->rows;
}

static void spsi_seen_task(void *data, int index, int worker) {
    const spsi_contents *contents = (const spsi_contents *)data;
    const spsi_frame *frame = contents->frame;
    const int end = spsi_batch_end(index, contents->particles.current);
    (void)worker;
    for (int i = index * SPSI_BATCH; i < end; ++i) {
        const int particle = contents->particles.present[i];
        const spsi_particle_set *set = spsi_set_of(frame, particle);
        for (int n = 0; n < contents->target_count; ++n) {
            const spsi_target *target = contents->targets[n];
            spsi_seen *seen = &target->particles.seen[i];
            spsi_seen_build(&target->crossing, set, &frame->content->particles[particle],
                            target->set_channels[set - frame->particles.sets], contents->first_slab, seen);
            seen->list = spsi_list_of(target, &seen->ball);
        }
    }
}

/* Bins a target's particles by a stable counting sort. */
static void spsi_lists_task(void *data, int index, int worker) {
    const spsi_contents *contents = (const spsi_contents *)data;
    const spsi_target *target = contents->targets[index];
    const spsi_lists *lists = &target->particles;
    const int count = contents->particles.current, list_count = target->columns * target->rows + 1;
    (void)worker;
    memset(lists->starts, 0, ((size_t)list_count + 1) * sizeof(int));
    for (int i = 0; i < count; ++i)
        if (lists->seen[i].list >= 0) lists->starts[lists->seen[i].list] += 1;
    for (int list = 0; list < list_count; ++list) lists->starts[list + 1] += lists->starts[list];
    for (int i = count - 1; i >= 0; --i) /* from the end: each list's end moves to its start */
        if (lists->seen[i].list >= 0) {
            const spsi_ball *ball = &lists->seen[i].ball;
            const int right = ball->x1 / SPSI_TILE_WIDTH > ball->x0 / SPSI_TILE_WIDTH;
            const int below = ball->y1 / SPSI_TILE_HEIGHT > ball->y0 / SPSI_TILE_HEIGHT;
            lists->members[--lists->starts[lists->seen[i].list]] = 4 * i + right + 2 * below;
        }
}

/* Projects and bins the chunk's particles for all targets. */
static void spsi_contents_bin_particles(spsi_contents *contents) {
    sps_context *context = contents->context;
    const double start = spsi_clock(context);
    if (contents->particles.current == 0) return;
    spsi_parallel_batches(context, contents->particles.current, spsi_seen_task, contents);
    spsi_parallel(context, contents->target_count, spsi_lists_task, contents);
    context->stats.seconds_bin += spsi_clock(context) - start;
}

/* --- a tile --- */

static void spsi_tile_place(const spsi_target *target, int column, int row, int worker, spsi_tile *tile) {
    const int margin = target->shape.margin;
    SPS_ASSERT(worker >= 0 && worker < target->sheets.worker_count); /* else two tasks would share sheets */
    memset(tile, 0, sizeof *tile);
    tile->open = ~UINT64_C(0);
    tile->nearest_limit = SPSI_INFINITY;
    tile->x0 = column * SPSI_TILE_WIDTH - margin;
    tile->y0 = row * SPSI_TILE_HEIGHT - margin;
    tile->margin = margin;
    tile->pitch = SPSI_TILE_WIDTH + 2 * margin;
    tile->x1 = spsi_least(tile->x0 + tile->pitch, target->rays->width + margin) - 1;
    tile->y1 = spsi_least(tile->y0 + SPSI_TILE_HEIGHT + 2 * margin, target->rays->height + margin) - 1;
    tile->slab_count = SPSI_CHUNK + 2 * target->shape.slab_margin;
    tile->sheet_size = (size_t)(tile->pitch * (SPSI_TILE_HEIGHT + 2 * margin));
    tile->channel_size = tile->sheet_size * (size_t)tile->slab_count;
    tile->sheets = target->sheets.memory + (size_t)worker * target->sheets.floats;
}

/* Whether a box of pixels, as of a brick, meets a tile. */
static int spsi_box_meets_tile(const int16_t box[4], int column, int row) {
    const int x0 = column * SPSI_TILE_WIDTH, y0 = row * SPSI_TILE_HEIGHT;
    return box[0] < x0 + SPSI_TILE_WIDTH && box[2] >= x0 && box[1] < y0 + SPSI_TILE_HEIGHT && box[3] >= y0;
}

/* A tile that is being filled. Its sheets are cleared when the first footprint is added. */
typedef struct spsi_tile_fill {
    const spsi_target *target;
    const spsi_contents *contents;
    spsi_tile *tile;
    int column, row, touched;
} spsi_tile_fill;

static void spsi_tile_touch(spsi_tile_fill *fill) {
    if (!fill->touched) memset(fill->tile->sheets, 0, spsi_shape_floats(&fill->target->shape) * sizeof(float));
    fill->touched = 1;
}

static void spsi_tile_splat_bricks(spsi_tile_fill *fill) {
    const spsi_target *target = fill->target;
    const spsi_contents *contents = fill->contents;
    spsi_tile *tile = fill->tile;
    const int first_slab = contents->first_slab - target->shape.slab_margin;
    tile->eye_slab = (float)(target->origin_slab - first_slab);
    for (int i = 0; i < contents->bricks.current; ++i) {
        const int index = contents->bricks.present[i];
        const int16_t *box = target->brick_boxes[index];
        const spsi_brick *brick = &contents->list[index];
        const int channel = target->channels[brick->lattice], slopes = target->slope_channels[brick->lattice];
        spsi_anchor anchor;
        if (channel < 0 || !spsi_box_meets_tile(box, fill->column, fill->row)) continue;
        if (!(tile->open & spsi_patches(tile, box[0], box[1], box[2], box[3]))) continue;
        spsi_tile_touch(fill);
        spsi_anchor_build(&contents->frame->lattices[brick->lattice], brick, target->rays, target->slabs, first_slab,
                          &anchor);
        tile->slopes = slopes < 0 ? NULL : tile->sheets + (size_t)slopes * tile->channel_size;
        spsi_splat_brick(tile, &target->splatters[brick->lattice], &anchor,
                         spsi_segment_at(contents->context, brick->segment), brick,
                         tile->sheets + (size_t)channel * tile->channel_size);
    }
}

static void spsi_tile_splat_one(spsi_tile_fill *fill, const spsi_seen *seen) {
    const int left = fill->target->slabs->count - fill->contents->first_slab;
    spsi_tile_touch(fill);
    spsi_splat_particle(fill->tile, &fill->target->crossing, seen, fill->contents->first_slab == 0, left);
}

/* Splats those particles of a list that reach beyond its tile: 0: all, 1: to the right, 2: down, 3: both. */
static void spsi_tile_splat_list(spsi_tile_fill *fill, int list, int beyond) {
    const spsi_lists *lists = &fill->target->particles;
    const int first = lists->starts[list], end = lists->starts[list + 1], ahead = 8;
    for (int i = first; i < end; ++i) {
        const int member = lists->members[i];
        if (i + ahead < end && (lists->members[i + ahead] & beyond) == beyond)
            spsi_prefetch(&lists->seen[lists->members[i + ahead] / 4], sizeof(spsi_seen));
        if ((member & beyond) == beyond) spsi_tile_splat_one(fill, &lists->seen[member / 4]);
    }
}

/* Splats the wide particles that overlap the tile. */
static void spsi_tile_splat_wide(spsi_tile_fill *fill) {
    const spsi_lists *lists = &fill->target->particles;
    const int list = fill->target->columns * fill->target->rows;
    for (int i = lists->starts[list]; i < lists->starts[list + 1]; ++i) {
        const spsi_seen *seen = &lists->seen[lists->members[i] / 4];
        const spsi_ball *ball = &seen->ball;
        if (ball->x0 / SPSI_TILE_WIDTH <= fill->column && ball->x1 / SPSI_TILE_WIDTH >= fill->column &&
            ball->y0 / SPSI_TILE_HEIGHT <= fill->row && ball->y1 / SPSI_TILE_HEIGHT >= fill->row)
            spsi_tile_splat_one(fill, seen);
    }
}

/* Splats the chunk's bricks and particles that overlap a tile. Particles come from its own list, those of its left and
   upper neighbours, and the list of wide ones. Returns 0 if there are none; the sheets are not cleared then. */
static int spsi_tile_splat(const spsi_target *target, const spsi_contents *contents, int column, int row,
                           spsi_tile *tile) {
    spsi_tile_fill fill;
    fill.target = target;
    fill.contents = contents;
    fill.tile = tile;
    fill.column = column;
    fill.row = row;
    fill.touched = 0;
    spsi_tile_splat_bricks(&fill);
    if (contents->particles.current == 0) return fill.touched;
    for (int up = 0; up <= (row > 0); ++up)
        for (int left = 0; left <= (column > 0); ++left)
            spsi_tile_splat_list(&fill, (row - up) * target->columns + column - left, left + 2 * up);
    spsi_tile_splat_wide(&fill);
    return fill.touched;
}

/* Adds a finished tile's counts to its worker's counters. */
static void spsi_tile_count(const spsi_target *target, const spsi_tile *tile, int worker) {
    target->counts[worker][0] += tile->visits;
    target->counts[worker][1] += tile->fragments;
}

/* ========================================================================================== >>lightsheets
   22 The optical depth of a light's sheets. Sheets of gases hold it already, per unit of t. A transfer function is not
   linear, so a slab's mean value is not enough: classified slabs are divided into SPSI_PARTS parts, whose means come
   from the parabola through the means of three slabs. */

#define SPSI_PARTS 4 /* of a slab that is classified or shaded by polygons */

/* value + slope x + bend x^2, x from -1/2 to 1/2 through a slab. */
typedef struct spsi_parabola {
    spsi_v value, slope, bend;
} spsi_parabola;

/* The parabola whose means over a slab and the ones before and after are given. */
static inline spsi_parabola spsi_parabola_through(spsi_v before, spsi_v here, spsi_v after) {
    spsi_parabola p;
    p.slope = spsi_mul(spsi_set(0.5f), spsi_sub(after, before));
    p.bend = spsi_fma(spsi_set(0.5f), spsi_add(before, after), spsi_sub(spsi_set(0), here));
    p.value = spsi_fma(p.bend, spsi_set(-1.0f / 12), here);
    return p;
}

/* A portion of a slab: its middle x, relative to the slab's, and the mean of the squared position over its width w,
   x^2 + w^2 / 12. */
typedef struct spsi_portion {
    spsi_v middle, square;
} spsi_portion;

/* One of SPSI_PARTS equal parts of the interval between the shares `first` and `last` of a slab. */
static inline spsi_portion spsi_portion_of(spsi_v first, spsi_v last, int part) {
    const spsi_v width = spsi_mul(spsi_sub(last, first), spsi_set(1.0f / SPSI_PARTS));
    spsi_portion s;
    s.middle = spsi_fma(width, spsi_set((float)part + 0.5f), spsi_sub(first, spsi_set(0.5f)));
    s.square = spsi_fma(s.middle, s.middle, spsi_mul(spsi_mul(width, width), spsi_set(1.0f / 12)));
    return s;
}

/* A parabola's mean over a portion. */
static inline spsi_v spsi_parabola_mean(const spsi_parabola *p, const spsi_portion *s) {
    return spsi_fma(p->bend, s->square, spsi_fma(p->slope, s->middle, p->value));
}

typedef struct spsi_light_shader {
    const spsi_frame *frame;
    const spsi_rays *rays;
    spsi_linear slab;
    int material_of_channel[SPSI_VOLUMES_MAX + 1]; /* -1: gases, whose sheets hold optical depth already */
} spsi_light_shader;

static void spsi_light_shader_build(const spsi_frame *frame, const spsi_rays *rays, const spsi_slabs *slabs,
                                    spsi_light_shader *shader) {
    shader->frame = frame;
    shader->rays = rays;
    shader->material_of_channel[0] = -1;
    for (int i = 0; i < frame->medium_count; ++i)
        if (frame->matter.materials[frame->media[i].channel].table)
            shader->material_of_channel[frame->media[i].light_channel] = frame->media[i].channel;
    spsi_linear_of_slabs(rays, slabs, &shader->slab);
}

/* How a vector of a light's rays crosses slabs. */
typedef struct spsi_row_slabs {
    spsi_v length;          /* world length per unit of t */
    spsi_v count, per_slab; /* number of slabs per unit of t, and its inverse */
} spsi_row_slabs;

static inline spsi_row_slabs spsi_row_slabs_at(const spsi_light_shader *shader, int x, int y) {
    const spsi_v at = spsi_add(spsi_set((float)x), spsi_iota());
    spsi_row_slabs slabs;
    slabs.length = spsi_ray_lengths(shader->rays, at, (float)y);
    slabs.count = spsi_abs(spsi_linear_slope(&shader->slab, at, (float)y));
    slabs.per_slab = spsi_div(spsi_set(1), slabs.count);
    return slabs;
}

/* A sheet's values for a vector of pixels. Round-off in the kernel's share can make sums slightly negative. */
static inline spsi_v spsi_sheet_sum(const spsi_tile *tile, int channel, size_t at) {
    return spsi_max(spsi_load(tile->sheets + (size_t)channel * tile->channel_size + at), spsi_set(0));
}

/* Optical depth of one slab for a vector of texels; `at`: index of the slab in a channel. Classified volumes follow a
   parabola through the slabs before and after, as they do for the eye. */
static inline spsi_v spsi_light_sheet(const spsi_light_shader *shader, const spsi_tile *tile, size_t at,
                                      const spsi_row_slabs *slabs) {
    const spsi_v part_length = spsi_mul(spsi_mul(slabs->per_slab, slabs->length), spsi_set(1.0f / SPSI_PARTS));
    spsi_v depth = spsi_set(0);
    for (int c = 0; c < shader->frame->matter.light_channel_count; ++c) {
        const int material = shader->material_of_channel[c];
        const spsi_v sum = spsi_sheet_sum(tile, c, at);
        spsi_parabola value;
        if (!spsi_bits(spsi_less(spsi_set(0), sum))) continue;
        if (material < 0) {
            depth = spsi_fma(sum, slabs->length, depth);
            continue;
        }
        value = spsi_parabola_through(spsi_sheet_sum(tile, c, at - tile->sheet_size), sum,
                                      spsi_sheet_sum(tile, c, at + tile->sheet_size));
        for (int part = 0; part < SPSI_PARTS; ++part) {
            const spsi_portion portion = spsi_portion_of(spsi_set(0), spsi_set(1), part);
            const spsi_v mean = spsi_mul(spsi_parabola_mean(&value, &portion), slabs->count);
            depth = spsi_fma(spsi_classify_extinction(&shader->frame->matter.materials[material], mean), part_length,
                             depth);
        }
    }
    return depth;
}

/* =============================================================================================== >>tmaps
   23 Transmittance maps: a light's texels, how they are filled and how they are queried. Each of up to six faces is a
   grid of rays; u is the share of the way from near_depth to far_depth along t. Six faces share the rays of their
   common edges, and t is the largest coordinate from the light, which is the same from either side, so nothing jumps
   from face to face. Opaque surfaces are kept apart, as a depth per texel: no technique could hold them without harming
   everything else. A map is filled one row of tiles (a band) at a time. Each tile is a task of its own that visits
   volumes, particles and triangles in their order, so that the result is the same to the bit for any number of workers.
   Whatever meets a vector of texels is a vector of intervals. The kind of visit decides what becomes of it: sums, for a
   technique that accepts intervals in any order; before that the texel's range, where the technique needs it; or a list
   that is first counted, then filled, sorted, and made into a curve to which the technique is fitted. Volumes are
   splatted into slabs perpendicular to the light's axis, which takes one visit of all voxels for plain sums and two for
   the rest. A light's shadow table is an opacity map whose planes are packed into pairs of 16 bits, and held for the
   next call; there, only patches of texels are filled whose fingerprints have changed. Cost: occluders times texels
   under them times components; 4 bytes per texel and component in a band of 64 rows, or 16 per interval in it. */

#define SPSI_NO_SURFACE 1e30f /* u where there is none: no point is so far behind far_depth */
#define SPSI_GUARD_BAND 0.05  /* share of the depth range, free at either end of a Fourier series: it is periodic */

/* The occluders of a map, as they were added. */
typedef struct spsi_added {
    spsi_buffer volumes, meshes, particles;
    int volume_count, mesh_count, particle_set_count;
} spsi_added;

typedef struct spsi_tmap_data {
    spsi_buffer texels;   /* components of each texel, or the intervals or nodes of all */
    spsi_buffer starts;   /* of lists: the index of each texel's first item, plus one more for the end */
    spsi_buffer table;    /* of a shadow table, in place of texels: pairs of planes */
    spsi_buffer surfaces; /* u of each texel's first opaque surface; no data: there are no opaque surfaces */
    spsi_buffer prints;   /* of a shadow table with a key: what its texels are made from, face by face, tile by tile */
} spsi_tmap_data;

/* What the texels of a tile of a shadow table are made from, patch by patch. */
typedef struct spsi_tile_prints {
    uint64_t open; /* bit mask of the patches that are filled; the others keep what they held in the last call */
    uint64_t patches[64];
} spsi_tile_prints;

struct sps_tmap {
    sps_context *context;
    const spsi_technique *technique;
    int light;                  /* index of the light whose shadow_map it is; -1: none */
    sps_tmap_settings settings; /* with defaults filled in */
    sps_tmap_settings inner;    /* as the technique's functions see them: without the texel's range */
    sps_view view;              /* of the light */
    double matrix[16];          /* its camera's world_to_clip */
    int has_range;              /* 1: a texel begins with the u of its first and its last occluder */
    int has_vectors;            /* 1: vectors of texels are looked up at once */
    int face_count, replace_invalid;
    int finished, failed;
    spsi_rays rays[SPSI_CUBE_FACES];
    uint64_t key;     /* of a shadow table: fingerprint of all that it is made from; 0: it is not kept */
    uint64_t aim;     /* fingerprint of its rays and planes: only tables with the same have the same entries */
    spsi_buffer past; /* no data, or the table of the last call that is brought up to date */
    double per_depth; /* 1 / (far - near) */
    double bias[2];   /* of surfaces, in t: bias[0] + bias[1] * t */
    spsi_buffer planes;
    spsi_added added; /* until the map is finished */
    spsi_tmap_data data;
};

static size_t spsi_tmap_texel_count(const sps_tmap *map) {
    return spsi_ray_count(&map->rays[0]) * (size_t)map->face_count;
}

/* Fingerprints of a tile of a face; NULL: there are none. */
static spsi_tile_prints *spsi_tmap_prints(const sps_tmap *map, int face, int row, int column) {
    const int columns = spsi_tile_columns(&map->rays[0]), rows = spsi_tile_rows(&map->rays[0]);
    spsi_tile_prints *prints = (spsi_tile_prints *)map->data.prints.data;
    return prints ? prints + ((size_t)face * (size_t)rows + (size_t)row) * (size_t)columns + column : NULL;
}

/* Bit mask of the patches of a tile that a face's texels lie in. */
static uint64_t spsi_tmap_patches(const sps_tmap *map, int row, int column) {
    return spsi_patch_box(0, 0, map->rays[0].width - 1 - column * SPSI_TILE_WIDTH,
                          map->rays[0].height - 1 - row * SPSI_TILE_HEIGHT);
}

/* Of a map made from lists: bytes of an item, an interval or a node, and number of items. */
static size_t spsi_tmap_item_bytes(const sps_tmap *map) {
    return map->settings.technique == SPS_TMAP_DEEP ? sizeof(spsi_interval) : sizeof(spsi_node);
}

static size_t spsi_tmap_item_count(const sps_tmap *map) {
    return ((const uint32_t *)map->data.starts.data)[spsi_tmap_texel_count(map)];
}

/* The part of a texel that a technique looks up: its floats without the range, and u within the range. */
typedef struct spsi_texel {
    const float *floats;
    float u; /* below 0: before all occluders */
} spsi_texel;

static spsi_texel spsi_tmap_texel(const sps_tmap *map, size_t index, float u) {
    spsi_texel texel;
    texel.floats = (const float *)map->data.texels.data + index * (size_t)map->settings.components;
    texel.u = u;
    if (!map->has_range) return texel;
    {
        const float first = texel.floats[0], length = texel.floats[1] - first;
        texel.u = u < first ? -1 : length > 0 ? spsi_lower((u - first) / length, 1) : 1;
        texel.floats += 2;
    }
    return texel;
}

/* Optical depth of gas before u in one texel. */
static float spsi_tmap_optical_depth(const sps_tmap *map, size_t index, float u) {
    if (map->technique->lists) {
        const uint32_t *starts = (const uint32_t *)map->data.starts.data + index;
        const uint32_t count = starts[1] - starts[0];
        return map->settings.technique == SPS_TMAP_DEEP
                   ? spsi_intervals_optical_depth((const spsi_interval *)map->data.texels.data + starts[0], count, u)
                   : spsi_compressed_optical_depth((const spsi_node *)map->data.texels.data + starts[0], count, u);
    }
    {
        const spsi_texel texel = spsi_tmap_texel(map, index, u);
        return texel.u < 0 ? 0 : spsi_texel_optical_depth(&map->inner, texel.floats, texel.u);
    }
}

/* Bounds of the optical depth of gas before u in one texel. */
static void spsi_tmap_bounds(const sps_tmap *map, size_t index, float u, float bounds[2]) {
    bounds[0] = 0;
    bounds[1] = SPSI_DEPTH_MAX;
    if (map->settings.technique == SPS_TMAP_DEEP) {
        bounds[0] = bounds[1] = spsi_tmap_optical_depth(map, index, u);
    } else if (map->settings.technique == SPS_TMAP_COMPRESSED) {
        const float through = expf(-spsi_tmap_optical_depth(map, index, u)), epsilon = map->inner.epsilon;
        bounds[0] = spsi_higher(-logf(spsi_lower(through + epsilon, 1)), 0);
        bounds[1] = through > epsilon ? -logf(through - epsilon) : SPSI_DEPTH_MAX;
    } else if (map->technique->bracket) {
        const spsi_texel texel = spsi_tmap_texel(map, index, u);
        bounds[1] = 0;
        if (!(texel.u < 0)) map->technique->bracket(&map->inner, texel.floats, texel.u, bounds);
    }
}

/* The four texels around a point, for a bilinear lookup. */
typedef struct spsi_tmap_quad {
    int column[2], row[2]; /* rows of all faces, one below the other */
    double weight[4], t;
    float u;
} spsi_tmap_quad;

static size_t spsi_quad_texel(const sps_tmap *map, const spsi_tmap_quad *quad, int i) {
    return (size_t)quad->row[i >> 1] * (size_t)map->rays[0].width + (size_t)quad->column[i & 1];
}

/* Finds the texels around a point. Returns 0 outside of the map, before near_depth, and for a point that is not
   finite. */
static int spsi_tmap_locate(const sps_tmap *map, const double point[3], spsi_tmap_quad *quad) {
    const int width = map->rays[0].width, height = map->rays[0].height;
    double q[3], offset[3];
    int x, y, face = 0;
    if (map->face_count > 1) {
        spsi_along(point, map->rays[0].origin, -1, offset);
        face = spsi_cube_face_of(offset);
    }
    spsi_project(&map->rays[face], point, q);
    if (!(fabs(q[0]) <= DBL_MAX && fabs(q[1]) <= DBL_MAX && fabs(q[2]) <= DBL_MAX)) return 0;
    quad->t = q[2];
    quad->u = (float)fmin((q[2] - map->settings.near_depth) * map->per_depth, 1);
    if (!(quad->u >= 0) || (map->rays[face].perspective && !(q[2] > 0))) return 0;
    if (map->face_count > 1) /* round-off must not lead out of the face */
        q[0] = fmin(fmax(q[0], 0), width - 1), q[1] = fmin(fmax(q[1], 0), height - 1);
    if (!(q[0] >= -0.5 && q[1] >= -0.5 && q[0] <= width - 0.5 && q[1] <= height - 0.5)) return 0;
    x = (int)floor(q[0]);
    y = (int)floor(q[1]);
    for (int i = 0; i < 2; ++i) {
        quad->column[i] = spsi_least(spsi_most(x + i, 0), width - 1);
        quad->row[i] = face * height + spsi_least(spsi_most(y + i, 0), height - 1);
    }
    for (int i = 0; i < 4; ++i) quad->weight[i] = (1 - fabs(q[0] - (x + (i & 1)))) * (1 - fabs(q[1] - (y + (i >> 1))));
    return 1;
}

/* The bilinear share of the four texels whose surfaces do not lie before the point. */
static double spsi_tmap_lit(const sps_tmap *map, const spsi_tmap_quad *quad) {
    const double bias = (map->bias[0] + map->bias[1] * quad->t) * map->per_depth;
    const double u = (quad->t - map->settings.near_depth) * map->per_depth; /* not clamped: may lie behind far_depth */
    const float *surfaces = (const float *)map->data.surfaces.data;
    double lit = 0, sum = 0;
    if (!surfaces) return 1;
    for (int i = 0; i < 4; ++i) {
        sum += quad->weight[i];
        if (!((double)surfaces[spsi_quad_texel(map, quad, i)] + bias < u)) lit += quad->weight[i];
    }
    return lit < sum ? lit / sum : 1;
}

/* The same for a vector of points; those outside of the map have no weights. */
typedef struct spsi_tmap_quads {
    spsi_v column[2], row[2], weight[4], u;
} spsi_tmap_quads;

/* Optical depth of gas before u in a vector of texels, looked up at once. */
static spsi_v spsi_tmap_all_optical_depths(const sps_tmap *map, spsi_v column, spsi_v row, spsi_v u) {
    const spsi_v zero = spsi_set(0), one = spsi_set(1);
    spsi_texels texels;
    spsi_v first, length, within;
    texels.floats = (const float *)map->data.texels.data;
    texels.stride = map->rays[0].width * map->settings.components;
    texels.x = spsi_mul(column, spsi_set((float)map->settings.components));
    texels.y = row;
    if (!map->has_range) return map->technique->optical_depths(&map->inner, &texels, u);
    first = spsi_texels_at(&texels, zero);
    length = spsi_sub(spsi_texels_at(&texels, one), first);
    within = spsi_div(spsi_sub(u, first), spsi_max(length, spsi_set(FLT_MIN)));
    within = spsi_select(spsi_less(zero, length), spsi_clamp(within, zero, one), one);
    texels.x = spsi_add(texels.x, spsi_set(2));
    return spsi_select(spsi_less(u, first), zero, map->technique->optical_depths(&map->inner, &texels, within));
}

/* The same, one texel at a time; texels without weight are skipped. */
static spsi_v spsi_tmap_each_optical_depth(const sps_tmap *map, spsi_v column, spsi_v row, spsi_v u, spsi_v weight) {
    float columns[SPSI_LANES], rows[SPSI_LANES], us[SPSI_LANES], weights[SPSI_LANES];
    spsi_store(columns, column);
    spsi_store(rows, row);
    spsi_store(us, u);
    spsi_store(weights, weight);
    for (int i = 0; i < SPSI_LANES; ++i) {
        const size_t texel = (size_t)rows[i] * (size_t)map->rays[0].width + (size_t)columns[i];
        us[i] = weights[i] > 0 ? spsi_tmap_optical_depth(map, texel, us[i]) : 0;
    }
    return spsi_load(us);
}

#define SPSI_SHADOW_TABLE_SIDE                                                                                         \
    4 /* texels on a side of a block: a plane of it is 64 bytes, which are fetched together */
#define SPSI_SHADOW_TABLE_TEXELS      (SPSI_SHADOW_TABLE_SIDE * SPSI_SHADOW_TABLE_SIDE)
#define SPSI_SHADOW_TABLE_MOST        65535.0f   /* stands for an optical depth of SPSI_SHADOW_TABLE_DEPTH */
#define SPSI_SHADOW_TABLE_DEPTH       16.0f      /* e^-16 = 1.1e-7 */
#define SPSI_SHADOW_TABLE_BLOCKS_MOST 16777216.0 /* planes of blocks, which floats count */

/* Blocks along a row of a table, and along its columns, faces one below the other. */
static int spsi_shadow_table_columns(const sps_tmap *map) {
    return (map->rays[0].width + SPSI_SHADOW_TABLE_SIDE - 1) / SPSI_SHADOW_TABLE_SIDE;
}

static int spsi_shadow_table_rows(const sps_tmap *map) {
    return (map->rays[0].height * map->face_count + SPSI_SHADOW_TABLE_SIDE - 1) / SPSI_SHADOW_TABLE_SIDE;
}

static double spsi_shadow_table_blocks(const sps_tmap *map) {
    return (double)spsi_shadow_table_columns(map) * spsi_shadow_table_rows(map);
}

/* Along one axis: the block that a texel is in, and its place there, `size` apart. */
typedef struct spsi_shadow_table_place {
    spsi_v block, within;
} spsi_shadow_table_place;

static inline spsi_shadow_table_place spsi_shadow_table_place_of(spsi_v texel, float size) {
    spsi_shadow_table_place place;
    place.block = spsi_floor(spsi_mul(texel, spsi_set(1.0f / SPSI_SHADOW_TABLE_SIDE)));
    place.within = spsi_mul(spsi_fma(place.block, spsi_set(-SPSI_SHADOW_TABLE_SIDE), texel), spsi_set(size));
    return place;
}

/* Optical depth in texels of a table, `share` of the way from plane k - 1 to plane k of u = (k + 1) / n; plane -1, at
   u = 0, is 0. Item k of a texel holds both. */
static inline spsi_v spsi_shadow_table_at(const sps_tmap *map, const spsi_shadow_table_place *column,
                                          const spsi_shadow_table_place *row, spsi_v k, spsi_v share) {
    const spsi_v block = spsi_fma(row->block, spsi_set((float)spsi_shadow_table_columns(map)), column->block);
    spsi_v pair[2];
    spsi_lookup_pair((const uint32_t *)map->data.table.data, SPSI_SHADOW_TABLE_TEXELS,
                     spsi_add(row->within, column->within),
                     spsi_fma(block, spsi_set((float)map->settings.components), k), pair);
    return spsi_mix(pair[0], pair[1], share);
}

#define SPSI_SHADOW_TABLE_STEP (SPSI_SHADOW_TABLE_DEPTH / SPSI_SHADOW_TABLE_MOST)

/* The same as spsi_tmap_all_optical_depths, from a shadow table. */
static spsi_v spsi_shadow_table_optical_depths(const sps_tmap *map, spsi_v column, spsi_v row, spsi_v u) {
    const spsi_v planes = spsi_set((float)map->settings.components), at = spsi_mul(u, planes);
    const spsi_v k = spsi_min(spsi_floor(at), spsi_sub(planes, spsi_set(1)));
    const spsi_shadow_table_place x = spsi_shadow_table_place_of(column, 1),
                                  y = spsi_shadow_table_place_of(row, SPSI_SHADOW_TABLE_SIDE);
    return spsi_mul(spsi_shadow_table_at(map, &x, &y, k, spsi_sub(at, k)), spsi_set(SPSI_SHADOW_TABLE_STEP));
}

/* The same as spsi_tmap_optical_depths. */
static spsi_v spsi_shadow_table_lookup(const sps_tmap *map, const spsi_tmap_quads *quads) {
    const spsi_v planes = spsi_set((float)map->settings.components), at = spsi_mul(quads->u, planes);
    const spsi_v k = spsi_min(spsi_floor(at), spsi_sub(planes, spsi_set(1))), share = spsi_sub(at, k);
    spsi_shadow_table_place x[2], y[2];
    spsi_v sum = spsi_set(0);
    for (int i = 0; i < 2; ++i) {
        x[i] = spsi_shadow_table_place_of(quads->column[i], 1);
        y[i] = spsi_shadow_table_place_of(quads->row[i], SPSI_SHADOW_TABLE_SIDE);
    }
    for (int i = 0; i < 4; ++i)
        sum = spsi_fma(quads->weight[i], spsi_shadow_table_at(map, &x[i & 1], &y[i >> 1], k, share), sum);
    return spsi_mul(sum, spsi_set(SPSI_SHADOW_TABLE_STEP));
}

/* The same, by whichever of these the map supports. */
static spsi_v spsi_tmap_texel_optical_depths(const sps_tmap *map, spsi_v column, spsi_v row, spsi_v u, spsi_v weight) {
    if (map->data.table.data) return spsi_shadow_table_optical_depths(map, column, row, u);
    return map->has_vectors ? spsi_tmap_all_optical_depths(map, column, row, u)
                            : spsi_tmap_each_optical_depth(map, column, row, u, weight);
}

/* Optical depth of gas at a vector of points. Each of the four texels is evaluated at the point's own u, rather than
   the result interpolated between their depths. */
static spsi_v spsi_tmap_optical_depths(const sps_tmap *map, const spsi_tmap_quads *quads) {
    spsi_v sum = spsi_set(0);
    for (int i = 0; i < 4; ++i) {
        const spsi_v column = quads->column[i & 1], row = quads->row[i >> 1], weight = quads->weight[i];
        sum = spsi_fma(weight, spsi_tmap_texel_optical_depths(map, column, row, quads->u, weight), sum);
    }
    return spsi_min(sum, spsi_set(SPSI_DEPTH_MAX));
}

/* Optical depth of gas at up to SPSI_LANES world points (packed triples), located in double precision, and the shares
   of light that surfaces let through. */
static void spsi_tmap_at(const sps_tmap *map, int count, const double *points, float *depths, double *lit) {
    float column[4 * SPSI_LANES] = {0}, row[4 * SPSI_LANES] = {0}, u[4 * SPSI_LANES] = {0};
    float weight[4 * SPSI_LANES] = {0}, depth[4 * SPSI_LANES];
    for (int n = 0; n < count; ++n) {
        spsi_tmap_quad quad;
        lit[n] = 1;
        if (!spsi_tmap_locate(map, points + 3 * n, &quad)) continue;
        lit[n] = spsi_tmap_lit(map, &quad);
        for (int i = 0; i < 4; ++i) {
            column[4 * n + i] = (float)quad.column[i & 1];
            row[4 * n + i] = (float)quad.row[i >> 1];
            weight[4 * n + i] = (float)quad.weight[i];
            u[4 * n + i] = quad.u;
        }
    }
    for (int i = 0; i < 4 * count; i += SPSI_LANES)
        spsi_store(depth + i, spsi_tmap_texel_optical_depths(map, spsi_load(column + i), spsi_load(row + i),
                                                             spsi_load(u + i), spsi_load(weight + i)));
    for (int n = 0; n < count; ++n) {
        double sum = 0;
        for (int i = 4 * n; i < 4 * n + 4; ++i) sum += (double)weight[i] * (double)depth[i];
        depths[n] = (float)fmin(sum, (double)SPSI_DEPTH_MAX);
    }
}

/* A vector of points as seen by the rays of the faces that they lie in: x and y in texels, and t. */
typedef struct spsi_seen_by_map {
    spsi_v face, x, y, t;
    spsi_m in_range; /* 0: behind the light, or nearer than near_depth */
} spsi_seen_by_map;

static void spsi_quads_build(const sps_tmap *map, const spsi_seen_by_map *seen, spsi_tmap_quads *quads) {
    const float width = (float)map->rays[0].width, height = (float)map->rays[0].height;
    const spsi_v zero = spsi_set(0), one = spsi_set(1), edge = spsi_set(-0.5f);
    const spsi_v x = spsi_clamp(seen->x, spsi_set(-1), spsi_set(width)), column = spsi_floor(x);
    const spsi_v y = spsi_clamp(seen->y, spsi_set(-1), spsi_set(height)), row = spsi_floor(y);
    const spsi_m across = spsi_and(spsi_less(edge, x), spsi_less(x, spsi_set(width - 0.5f)));
    const spsi_m down = spsi_and(spsi_less(edge, y), spsi_less(y, spsi_set(height - 0.5f)));
    const spsi_m inside = spsi_and(seen->in_range, spsi_and(across, down));
    const spsi_v right = spsi_sub(x, column), low = spsi_sub(y, row);
    const spsi_v shares[2][2] = {{spsi_sub(one, right), right}, {spsi_sub(one, low), low}};
    const spsi_v first_row = spsi_mul(seen->face, spsi_set(height));
    for (int i = 0; i < 2; ++i) {
        const spsi_v next = spsi_set((float)i);
        quads->column[i] = spsi_clamp(spsi_add(column, next), zero, spsi_set(width - 1));
        quads->row[i] = spsi_add(first_row, spsi_clamp(spsi_add(row, next), zero, spsi_set(height - 1)));
    }
    for (int i = 0; i < 4; ++i)
        quads->weight[i] = spsi_select(inside, spsi_mul(shares[0][i & 1], shares[1][i >> 1]), zero);
}

/* Points given in the coordinates of the map's only rays, before any division; t is relative to near_depth. */
static void spsi_tmap_see(const sps_tmap *map, const spsi_v q[3], spsi_seen_by_map *seen) {
    const spsi_v distance = spsi_add(q[2], spsi_set((float)map->settings.near_depth));
    const spsi_v scale =
        map->rays[0].perspective ? spsi_div(spsi_set(1), spsi_max(distance, spsi_set(FLT_MIN * 16))) : spsi_set(1);
    /* allows for round-off; what lies behind the light also lies before near_depth */
    seen->in_range = spsi_less(spsi_set(-1e-6f), spsi_mul(q[2], spsi_set((float)map->per_depth)));
    seen->face = spsi_set(0);
    seen->x = spsi_mul(q[0], scale);
    seen->y = spsi_mul(q[1], scale);
    seen->t = q[2];
}

/* Points given as world offsets from the light, each seen through the one of six faces that it lies in. */
static void spsi_tmap_see_round(const sps_tmap *map, const spsi_v offset[3], spsi_seen_by_map *seen) {
    const spsi_v zero = spsi_set(0), half = spsi_set(0.5f), last = spsi_set((float)map->rays[0].width - 1);
    const spsi_v x = spsi_abs(offset[0]), y = spsi_abs(offset[1]), z = spsi_abs(offset[2]);
    const spsi_m is_y = spsi_less(x, y), is_z = spsi_less(spsi_max(x, y), z);
    spsi_v axes[3], per_distance, distance; /* axes: along the face's axis, and along the two after it */
    for (int i = 0; i < 3; ++i)
        axes[i] = spsi_select(is_z, offset[(i + 2) % 3], spsi_select(is_y, offset[(i + 1) % 3], offset[i]));
    distance = spsi_abs(axes[0]);
    per_distance = spsi_div(half, spsi_max(distance, spsi_set(FLT_MIN * 16)));
    seen->face = spsi_select(is_z, spsi_set(4), spsi_select(is_y, spsi_set(2), zero));
    seen->face = spsi_add(seen->face, spsi_select(spsi_less(axes[0], zero), spsi_set(1), zero));
    seen->x = spsi_mul(spsi_fma(axes[1], per_distance, half), last);
    seen->y = spsi_mul(spsi_fma(axes[2], per_distance, half), last);
    seen->t = spsi_sub(distance, spsi_set((float)map->settings.near_depth));
    seen->in_range = spsi_less(spsi_set(-1e-6f), spsi_mul(seen->t, spsi_set((float)map->per_depth)));
    seen->in_range = spsi_and(seen->in_range, spsi_less(zero, distance));
}

/* Optical depth of gas at a vector of points, in the coordinates that spsi_tmap_see expects, or spsi_tmap_see_round for
   six faces. Floats are precise enough within an image. */
static spsi_v spsi_tmap_lookup(const sps_tmap *map, const spsi_v q[3]) {
    spsi_seen_by_map seen;
    spsi_tmap_quads quads;
    if (map->face_count > 1)
        spsi_tmap_see_round(map, q, &seen);
    else
        spsi_tmap_see(map, q, &seen);
    spsi_quads_build(map, &seen, &quads);
    quads.u = spsi_clamp(spsi_mul(seen.t, spsi_set((float)map->per_depth)), spsi_set(0), spsi_set(1));
    return map->data.table.data ? spsi_shadow_table_lookup(map, &quads) : spsi_tmap_optical_depths(map, &quads);
}

/* Optical depth, surfaces included, from that of gas and the share that surfaces let through. */
static double spsi_optical_depth_with_surfaces(double depth, double lit) {
    return lit > 0 ? fmin(depth - log(lit), (double)SPSI_DEPTH_MAX) : (double)SPSI_DEPTH_MAX;
}

/* Guaranteed bounds of the optical depth at a world point, surfaces included. */
static void spsi_tmap_bracket_at(const sps_tmap *map, const double point[3], double bracket[2]) {
    spsi_tmap_quad quad;
    double lit;
    bracket[0] = bracket[1] = 0;
    if (!spsi_tmap_locate(map, point, &quad)) return;
    for (int i = 0; i < 4; ++i) {
        float bounds[2];
        if (!(quad.weight[i] > 0)) continue;
        spsi_tmap_bounds(map, spsi_quad_texel(map, &quad, i), quad.u, bounds);
        for (int k = 0; k < 2; ++k) bracket[k] += quad.weight[i] * (double)bounds[k];
    }
    lit = spsi_tmap_lit(map, &quad);
    for (int k = 0; k < 2; ++k) bracket[k] = spsi_optical_depth_with_surfaces(bracket[k], lit);
}

/* --- filling a map: tiles --- */

typedef enum spsi_visit { SPSI_VISIT_RANGE, SPSI_VISIT_SUMS, SPSI_VISIT_COUNT, SPSI_VISIT_LIST } spsi_visit;

/* Everything needed to splat volumes into a face. */
typedef struct spsi_map_volumes {
    spsi_slabs slabs;
    spsi_target target;
    spsi_contents contents;
    spsi_light_shader shader;
} spsi_map_volumes;

/* The occluders that all faces of a map are made from. */
typedef struct spsi_occluders {
    const spsi_frame *frame;
    spsi_faces faces;
    const spsi_ball *balls;                   /* for the current face */
    const uint32_t *tile_starts, *tile_balls; /* of each tile, plus one more; tile_balls NULL: all, for every tile */
    int *boxes;                               /* of triangles, in texels of the current face */
    spsi_map_volumes *volumes;                /* NULL: none */
    spsi_part_of_call part;
} spsi_occluders;

/* A row of tiles that is being filled. */
typedef struct spsi_band {
    int face, row;
    int tiles_x;
    size_t first_texel;       /* of the map */
    float *ranges, *sums;     /* tile after tile */
    uint32_t *starts;         /* per texel, plus one more: its first interval */
    uint32_t *cursors;        /* per texel: the number of its intervals, or where the next one goes */
    spsi_interval *intervals; /* of all its texels */
    uint32_t most;            /* maximum number of intervals in a texel */
} spsi_band;

typedef struct spsi_filling {
    sps_context *context;
    sps_tmap *map;
    const spsi_occluders *occluders;
    spsi_band band;
    spsi_visit visit;
    int pieces;    /* maximum number that a soft particle is cut into */
    float epsilon; /* of a compressed map, except for what soft pieces use up */
    int has_sizes; /* 1: the number of nodes of each texel of a compressed map is known; the nodes replace its intervals
                      where they fit */
    char *scratch; /* scratch_size per worker: a curve and what is made of it */
    size_t scratch_size;
    double slab_u, u_per_slab; /* u of the plane before slab k: slab_u + k u_per_slab */
    double light_u;            /* of the light's own position, or -infinity */
    double progress;
} spsi_filling;

/* A tile's texels. Its sums are `components` planes of width x height floats plus one vector, so that a vector that
   reaches beyond the last row overwrites nothing. */
typedef struct spsi_map_tile {
    const spsi_filling *filling;
    int x0, y0, width, height;
    uint64_t open; /* bit mask of the patches that are filled */
    size_t stride;
    float *ranges, *sums;
} spsi_map_tile;

static int spsi_filling_height(const spsi_filling *filling) {
    return spsi_least(SPSI_TILE_HEIGHT, filling->map->rays[0].height - filling->band.row * SPSI_TILE_HEIGHT);
}

/* Number of floats of a band with `components` components. */
static size_t spsi_band_floats(const sps_tmap *map, int components) {
    const size_t tiles = (size_t)spsi_tile_columns(&map->rays[0]);
    const size_t height = (size_t)spsi_least(SPSI_TILE_HEIGHT, map->rays[0].height);
    return (size_t)components * ((size_t)map->rays[0].width * height + tiles * SPSI_LANES);
}

static void spsi_map_tile_place(const spsi_filling *filling, int column, spsi_map_tile *into) {
    const spsi_tile_prints *prints = spsi_tmap_prints(filling->map, filling->band.face, filling->band.row, column);
    size_t before;
    into->filling = filling;
    into->open = prints ? prints->open : ~UINT64_C(0);
    into->x0 = column * SPSI_TILE_WIDTH;
    into->y0 = filling->band.row * SPSI_TILE_HEIGHT;
    into->width = spsi_least(SPSI_TILE_WIDTH, filling->map->rays[0].width - into->x0);
    into->height = spsi_filling_height(filling);
    into->stride = (size_t)(into->width * into->height) + SPSI_LANES;
    before = (size_t)into->x0 * (size_t)into->height + (size_t)column * SPSI_LANES;
    into->ranges = filling->band.ranges ? filling->band.ranges + 2 * before : NULL; /* lists have none */
    into->sums = filling->band.sums ? filling->band.sums + (size_t)filling->map->inner.components * before : NULL;
}

/* Whether any patch of a box of texels is filled. */
static int spsi_map_tile_is_open(const spsi_map_tile *into, int x0, int y0, int x1, int y1) {
    return (into->open & spsi_patch_box(x0 - into->x0, y0 - into->y0, x1 - into->x0, y1 - into->y0)) != 0;
}

/* The number of a texel in its map. */
static size_t spsi_map_tile_texel(const spsi_map_tile *into, int x, int y) {
    const spsi_rays *rays = &into->filling->map->rays[0];
    return ((size_t)into->filling->band.face * (size_t)rays->height + (size_t)y) * (size_t)rays->width + (size_t)x;
}

static void spsi_insert_range(const spsi_map_tile *into, size_t at, const spsi_intervals *intervals) {
    const spsi_v zero = spsi_set(0), one = spsi_set(1);
    const spsi_m some = spsi_less(zero, intervals->depth);
    const spsi_v first = spsi_load(into->ranges + at), last = spsi_load(into->ranges + into->stride + at);
    const spsi_v u0 = spsi_clamp(intervals->u0, zero, one), u1 = spsi_clamp(intervals->u1, zero, one);
    spsi_store(into->ranges + at, spsi_select(some, spsi_min(first, u0), first));
    spsi_store(into->ranges + into->stride + at, spsi_select(some, spsi_max(last, u1), last));
}

/* Limits of how far intervals may reach beyond 0..1: in u, so that lengths stay finite; and in their texel's range,
   which may be tiny, where going farther makes no difference. */
#define SPSI_INTERVAL_REACH 1e30
#define SPSI_RANGE_REACH    1e6f

/* Makes u relative to the texel's range; ends that lie outside of 0..1 stay outside. */
static void spsi_intervals_within(const spsi_map_tile *into, size_t at, spsi_intervals *intervals) {
    const spsi_v zero = spsi_set(0), one = spsi_set(1), first = spsi_load(into->ranges + at);
    const spsi_v length = spsi_sub(spsi_load(into->ranges + into->stride + at), first);
    const spsi_v inverse =
        spsi_select(spsi_less(zero, length), spsi_div(one, spsi_max(length, spsi_set(FLT_MIN))), zero);
    intervals->u0 = spsi_mul(spsi_sub(intervals->u0, first), inverse);
    intervals->u1 = spsi_mul(spsi_sub(intervals->u1, first), inverse);
    intervals->u0 = spsi_clamp(intervals->u0, spsi_set(-SPSI_RANGE_REACH), one);
    intervals->u1 = spsi_clamp(intervals->u1, zero, spsi_set(SPSI_RANGE_REACH));
}

static void spsi_insert_list(const spsi_map_tile *into, int x, int y, const spsi_intervals *intervals) {
    const spsi_filling *filling = into->filling;
    uint32_t *cursors = filling->band.cursors + (spsi_map_tile_texel(into, x, y) - filling->band.first_texel);
    float lanes[3][SPSI_LANES];
    spsi_store(lanes[0], intervals->u0);
    spsi_store(lanes[1], intervals->u1);
    spsi_store(lanes[2], intervals->depth);
    for (int i = 0; i < spsi_least(SPSI_LANES, into->x0 + into->width - x); ++i) {
        if (!(lanes[2][i] > 0)) continue;
        if (filling->visit == SPSI_VISIT_LIST) {
            const spsi_interval one = {lanes[0][i], lanes[1][i], lanes[2][i], intervals->soft};
            filling->band.intervals[cursors[i]] = one;
        }
        cursors[i] += 1;
    }
}

/* Inserts intervals into a tile's texels from (x, y) on; in texels beyond its edge, depth must be 0. */
static void spsi_insert(const spsi_map_tile *into, int x, int y, const spsi_intervals *intervals) {
    const spsi_filling *filling = into->filling;
    const size_t at = (size_t)((y - into->y0) * into->width + (x - into->x0));
    spsi_intervals within = *intervals;
    if (filling->visit == SPSI_VISIT_RANGE) {
        spsi_insert_range(into, at, intervals);
    } else if (filling->visit == SPSI_VISIT_SUMS) {
        if (filling->map->has_range) spsi_intervals_within(into, at, &within);
        filling->map->technique->insert(&filling->map->inner, into->sums + at, into->stride, &within);
    } else {
        spsi_insert_list(into, x, y, intervals);
    }
}

/* --- particles --- */

/* Inserts an interval into one texel. */
static void spsi_insert_one(const spsi_map_tile *into, int x, int y, const spsi_interval *interval) {
    float lanes[3][SPSI_LANES] = {{0}};
    spsi_intervals one;
    if (!(interval->depth > 0)) return;
    lanes[0][0] = interval->u0;
    lanes[1][0] = interval->u1;
    lanes[2][0] = interval->depth;
    one.u0 = spsi_load(lanes[0]);
    one.u1 = spsi_load(lanes[1]);
    one.depth = spsi_load(lanes[2]);
    one.soft = interval->soft;
    spsi_insert(into, x, y, &one);
}

/* A chord in one texel. */
typedef struct spsi_cut_chord {
    double u0, u1, depth;
    int soft;
} spsi_cut_chord;

static double spsi_cut_chord_share(const spsi_cut_chord *chord, double u) {
    const double s = fmin(fmax((u - chord->u0) / (chord->u1 - chord->u0), 0), 1);
    return chord->soft ? s * s * (3 - 2 * s) : s;
}

/* Six-point Gauss-Legendre rule on -1..1: exact for a soft chord's density (degree 2) times powers of u up to 9. */
#define SPSI_GAUSS_POINTS 6
static const double spsi_gauss_nodes[SPSI_GAUSS_POINTS] = {-0.9324695142031521, -0.6612093864662645,
                                                           -0.2386191860831969, 0.2386191860831969,
                                                           0.6612093864662645,  0.9324695142031521};
static const double spsi_gauss_weights[SPSI_GAUSS_POINTS] = {0.1713244923791704, 0.3607615730481386,
                                                             0.4679139345726910, 0.4679139345726910,
                                                             0.3607615730481386, 0.1713244923791704};

/* Inserts the part of a soft chord between two positions as points: exact for moments, and good to 1e-6 for Fourier
   series, since no part is longer than a wave. */
static void spsi_insert_points(const spsi_map_tile *into, int x, int y, const spsi_cut_chord *chord, double from,
                               double to) {
    const sps_tmap *map = into->filling->map;
    const int waves = map->inner.components / 2;
    const int parts = map->has_range ? waves : spsi_most((int)ceil(waves * (to - from)), 1);
    const double half = 0.5 * (to - from) / parts, length = chord->u1 - chord->u0;
    for (int i = 0; i < parts * SPSI_GAUSS_POINTS; ++i) {
        const int part = i / SPSI_GAUSS_POINTS, k = i % SPSI_GAUSS_POINTS;
        const double u = from + half * (2 * part + 1 + spsi_gauss_nodes[k]), s = (u - chord->u0) / length;
        const double depth = chord->depth * half / length * spsi_gauss_weights[k] * 6 * s * (1 - s);
        const spsi_interval point = {(float)u, (float)u, (float)depth, 0};
        spsi_insert_one(into, x, y, &point);
    }
}

/* Inserts a clipped chord in parts, for techniques that need this: what lies before 0 or behind 1 counts there. */
static void spsi_insert_parts(const spsi_map_tile *into, int x, int y, const spsi_cut_chord *chord, double light) {
    const double from = fmin(fmax(chord->u0, 0), 1), to = fmin(fmax(chord->u1, 0), 1);
    const double before = spsi_cut_chord_share(chord, from), until = spsi_cut_chord_share(chord, to);
    const double unlit = spsi_cut_chord_share(chord, light);
    const spsi_interval front = {(float)from, (float)from, (float)(chord->depth * (before - unlit)), 0};
    const spsi_interval even = {(float)from, (float)to, (float)(chord->depth * (until - before)), 0};
    const spsi_interval back = {(float)to, (float)to, (float)(chord->depth * (1 - until)), 0};
    spsi_insert_one(into, x, y, &front);
    if (!chord->soft || !(to > from))
        spsi_insert_one(into, x, y, &even);
    else
        spsi_insert_points(into, x, y, chord, from, to);
    spsi_insert_one(into, x, y, &back);
}

/* Inserts a chord that contains the light, or is clipped otherwise and has to be inserted in parts. `in_t`: its middle
   and half length in t, and its optical depth. What lies before the light does not count: the rest is the last part of
   a chord. */
static void spsi_insert_cut(const spsi_map_tile *into, int soft, int x, int y, const float in_t[3]) {
    const spsi_filling *filling = into->filling;
    const double per_t = filling->map->per_depth, light = filling->light_u;
    const spsi_cut_chord chord = {((double)in_t[0] - (double)in_t[1]) * per_t,
                                  ((double)in_t[0] + (double)in_t[1]) * per_t, (double)in_t[2], soft};
    const double part = (chord.u1 - fmax(chord.u0, light)) / (chord.u1 - chord.u0);
    if (!(part > 0)) return;
    if (filling->map->technique->points && filling->visit != SPSI_VISIT_RANGE) {
        spsi_insert_parts(into, x, y, &chord, light);
    } else {
        const double share = soft ? part * part * (3 - 2 * part) : part;
        const double from = fmax(fmax(chord.u0, light), -SPSI_INTERVAL_REACH);
        const spsi_interval rest = {(float)fmin(from, 1), (float)fmin(chord.u1, SPSI_INTERVAL_REACH),
                                    (float)(chord.depth * share), soft ? (float)part : 0};
        spsi_insert_one(into, x, y, &rest);
    }
}

/* Inserts chords of which some reach beyond 0..1. Those that contain the light, and all clipped ones where a technique
   needs these in parts, are inserted one by one; the rest together. */
static void spsi_insert_cut_chords(const spsi_map_tile *into, int soft, int x, int y, const spsi_chord *chord,
                                   spsi_intervals *intervals) {
    const int parts = into->filling->map->technique->points;
    const spsi_v zero = spsi_set(0), one = spsi_set(1);
    const spsi_v low = parts ? zero : spsi_set((float)fmax(into->filling->light_u, -SPSI_INTERVAL_REACH));
    const spsi_v high = parts ? one : spsi_set((float)SPSI_INTERVAL_REACH);
    const int outside = spsi_bits(spsi_less(intervals->u0, low)) | spsi_bits(spsi_less(high, intervals->u1));
    const int bits = outside & spsi_bits(spsi_less(zero, intervals->depth));
    float lanes[3][SPSI_LANES];
    spsi_store(lanes[0], chord->middle);
    spsi_store(lanes[1], chord->half);
    spsi_store(lanes[2], intervals->depth);
    for (int i = 0; i < SPSI_LANES; ++i) {
        const float in_t[3] = {lanes[0][i], lanes[1][i], lanes[2][i]};
        if (bits >> i & 1) spsi_insert_cut(into, soft, x + i, y, in_t);
        if (bits >> i & 1) lanes[2][i] = 0;
    }
    intervals->depth = spsi_load(lanes[2]);
    intervals->u0 = spsi_clamp(intervals->u0, low, one); /* none begins behind 1, where lists end */
    intervals->u1 = spsi_clamp(intervals->u1, zero, high);
    spsi_insert(into, x, y, intervals);
}

/* Inserts a vector of a ball's texels in a row, from x on. */
static void spsi_insert_chords(const spsi_map_tile *into, const spsi_ball *ball, int x, int y, int last) {
    const spsi_filling *filling = into->filling;
    const spsi_v per_t = spsi_set((float)filling->map->per_depth), zero = spsi_set(0), one = spsi_set(1);
    const spsi_m here = spsi_less(spsi_iota(), spsi_set((float)(last - x) + 0.5f));
    spsi_intervals intervals;
    spsi_chord chord;
    int bits;
    spsi_ball_chord(&filling->map->rays[filling->band.face], ball, x, y, &chord);
    intervals.u0 = spsi_mul(spsi_sub(chord.middle, chord.half), per_t);
    intervals.u1 = spsi_mul(spsi_add(chord.middle, chord.half), per_t);
    intervals.depth = spsi_select(here, spsi_chord_depth(ball, &chord), zero);
    intervals.soft = (float)ball->soft;
    bits = spsi_bits(spsi_less(zero, intervals.depth));
    if (!bits) return;
    if (bits & (spsi_bits(spsi_less(intervals.u0, zero)) | spsi_bits(spsi_less(one, intervals.u1))))
        spsi_insert_cut_chords(into, ball->soft, x, y, &chord, &intervals);
    else
        spsi_insert(into, x, y, &intervals);
}

static void spsi_insert_ball(const spsi_map_tile *into, const spsi_ball *ball) {
    const int x0 = spsi_most(ball->x0, into->x0), x1 = spsi_least(ball->x1, into->x0 + into->width - 1);
    const int y0 = spsi_most(ball->y0, into->y0), y1 = spsi_least(ball->y1, into->y0 + into->height - 1);
    if (x0 > x1 || y0 > y1 || !spsi_map_tile_is_open(into, x0, y0, x1, y1)) return;
    for (int y = y0; y <= y1; ++y)
        for (int x = x0; x <= x1; x += SPSI_LANES) spsi_insert_chords(into, ball, x, y, x1);
}

/* Number of balls that a tile may meet. */
static uint32_t spsi_tile_ball_count(const spsi_occluders *occluders, int tile) {
    if (!occluders->balls) return 0;
    if (occluders->tile_balls) return occluders->tile_starts[tile + 1] - occluders->tile_starts[tile];
    return (uint32_t)occluders->frame->content->particle_count;
}

/* The number of the i-th of them. */
static uint32_t spsi_tile_ball(const spsi_occluders *occluders, int tile, uint32_t i) {
    return occluders->tile_balls ? occluders->tile_balls[occluders->tile_starts[tile] + i] : i;
}

static void spsi_insert_balls(const spsi_map_tile *into, int tile) {
    const spsi_occluders *occluders = into->filling->occluders;
    const uint32_t count = spsi_tile_ball_count(occluders, tile);
    for (uint32_t i = 0; i < count; ++i) spsi_insert_ball(into, &occluders->balls[spsi_tile_ball(occluders, tile, i)]);
}

/* --- triangles --- */

/* Inserts a triangle into a tile: as a sheet without thickness or, if it is opaque, as the nearest surface of its
   texels. */
static void spsi_insert_triangle(const spsi_map_tile *into, int number) {
    const spsi_filling *filling = into->filling;
    const sps_tmap *map = filling->map;
    const spsi_rays *rays = &map->rays[filling->band.face];
    const int *box = filling->occluders->boxes + 4 * number;
    const float depth = spsi_face_optical_depth(&filling->occluders->faces.list[number]);
    float *surfaces = (float *)map->data.surfaces.data;
    const int opaque = depth >= SPSI_DEPTH_MAX;
    spsi_edges edges;
    spsi_face_edges(&filling->occluders->faces, number, rays, &edges);
    for (int y = spsi_most(box[1], into->y0); y <= spsi_least(box[3], into->y0 + into->height - 1); ++y)
        for (int x = spsi_most(box[0], into->x0); x <= spsi_least(box[2], into->x0 + into->width - 1); ++x) {
            double w[3], t, u;
            if (!spsi_face_hit(&edges, x, y, w)) continue;
            t = w[0] * edges.depth[0] + w[1] * edges.depth[1] + w[2] * edges.depth[2];
            if (rays->perspective && !(t + rays->depth_reference > 0)) continue;
            u = t * map->per_depth; /* surfaces may lie before near_depth and behind far_depth */
            if (!opaque) {
                const float at = (float)fmin(fmax(u, 0), 1);
                const spsi_interval sheet = {at, at, depth, 0};
                spsi_insert_one(into, x, y, &sheet);
            } else if (filling->visit == SPSI_VISIT_SUMS || filling->visit == SPSI_VISIT_LIST)
                surfaces[spsi_map_tile_texel(into, x, y)] =
                    spsi_lower(surfaces[spsi_map_tile_texel(into, x, y)], (float)fmin(fmax(u, -1e29), 1e29));
        }
}

static void spsi_insert_triangles(const spsi_map_tile *into) {
    const spsi_occluders *occluders = into->filling->occluders;
    for (int i = 0; i < occluders->faces.count; ++i) {
        const int *box = occluders->boxes + 4 * i;
        if (box[0] < into->x0 + into->width && box[2] >= into->x0 && box[1] < into->y0 + into->height &&
            box[3] >= into->y0)
            spsi_insert_triangle(into, i);
    }
}

static void spsi_fill_task(void *data, int index, int worker) {
    const spsi_filling *filling = (const spsi_filling *)data;
    spsi_map_tile into;
    (void)worker;
    spsi_map_tile_place(filling, index, &into);
    spsi_insert_balls(&into, filling->band.row * filling->band.tiles_x + index);
    spsi_insert_triangles(&into);
}

/* --- volumes --- */

/* Inserts the slabs of a chunk that a tile's voxels were splatted into, as intervals. */
static void spsi_insert_slabs(const spsi_map_tile *into, const spsi_tile *tile) {
    const spsi_filling *filling = into->filling;
    const spsi_map_volumes *volumes = filling->occluders->volumes;
    const spsi_light_shader *shader = &volumes->shader;
    const int first_slab = volumes->contents.first_slab, margin = volumes->target.shape.slab_margin;
    spsi_intervals intervals;
    intervals.soft = 0;
    for (int y = into->y0; y < into->y0 + into->height; ++y)
        for (int x = into->x0; x < into->x0 + into->width; x += SPSI_LANES) {
            const size_t from = (size_t)((y - tile->y0) * tile->pitch + (x - tile->x0));
            const spsi_v at = spsi_add(spsi_set((float)x), spsi_iota());
            const spsi_row_slabs slabs = spsi_row_slabs_at(shader, x, y);
            const int open = spsi_map_tile_is_open(into, x, y, x + SPSI_LANES - 1, y);
            const spsi_m here = spsi_less(at, spsi_set((float)(into->x0 + into->width) - 0.5f));
            for (int k = 0; k < SPSI_CHUNK && open; ++k) {
                const double u = filling->slab_u + (first_slab + k) * filling->u_per_slab;
                spsi_v depth = spsi_light_sheet(shader, tile, from + (size_t)(k + margin) * tile->sheet_size, &slabs);
                depth = spsi_select(here, spsi_min(depth, spsi_set(SPSI_DEPTH_MAX)), spsi_set(0));
                if (!spsi_bits(spsi_less(spsi_set(0), depth))) continue;
                intervals.u0 = spsi_set((float)fmin(fmax(u, 0), 1));
                intervals.u1 = spsi_set((float)fmin(fmax(u + filling->u_per_slab, 0), 1));
                intervals.depth = depth;
                spsi_insert(into, x, y, &intervals);
            }
        }
}

static void spsi_fill_volumes_task(void *data, int index, int worker) {
    const spsi_filling *filling = (const spsi_filling *)data;
    const spsi_map_volumes *volumes = filling->occluders->volumes;
    spsi_map_tile into;
    spsi_tile tile;
    spsi_map_tile_place(filling, index, &into);
    if (!into.open) return;
    spsi_tile_place(&volumes->target, index, filling->band.row, worker, &tile);
    tile.open = into.open;
    if (spsi_tile_splat(&volumes->target, &volumes->contents, index, filling->band.row, &tile))
        spsi_insert_slabs(&into, &tile);
}

static sps_result spsi_fill_volumes(spsi_filling *filling) {
    spsi_map_volumes *volumes = filling->occluders->volumes;
    const int chunks = volumes ? spsi_chunk_count(&volumes->slabs) : 0;
    for (int chunk = 0; chunk < chunks; ++chunk) {
        spsi_contents_advance(&volumes->contents, chunk);
        if (volumes->contents.bricks.current == 0) continue;
        if (spsi_progress(filling->context, filling->progress)) break;
        spsi_parallel(filling->context, filling->band.tiles_x, spsi_fill_volumes_task, filling);
    }
    return filling->context->result;
}

/* --- a band of sums --- */

static void spsi_clear_task(void *data, int index, int worker) {
    const spsi_filling *filling = (const spsi_filling *)data;
    const sps_tmap *map = filling->map;
    spsi_map_tile into;
    (void)worker;
    spsi_map_tile_place(filling, index, &into);
    if (filling->visit == SPSI_VISIT_RANGE)
        for (size_t i = 0; i < into.stride; ++i) into.ranges[i] = 1, into.ranges[into.stride + i] = 0;
    if (filling->visit != SPSI_VISIT_SUMS) return;
    memset(into.sums, 0, (size_t)map->inner.components * into.stride * sizeof(float));
    if (map->technique->clear) map->technique->clear(into.sums, into.stride, into.stride, map->inner.components);
}

/* Writes a tile's sums to its texels. */
static void spsi_store_task(void *data, int index, int worker) {
    const spsi_filling *filling = (const spsi_filling *)data;
    const sps_tmap *map = filling->map;
    const int components = map->inner.components;
    spsi_map_tile into;
    (void)worker;
    spsi_map_tile_place(filling, index, &into);
    for (int i = 0; i < into.width * into.height; ++i) {
        const int x = into.x0 + i % into.width, y = into.y0 + i / into.width;
        const size_t texel = spsi_map_tile_texel(&into, x, y);
        float *out = (float *)map->data.texels.data + texel * (size_t)map->settings.components;
        if (!spsi_map_tile_is_open(&into, x, y, x, y)) continue;
        if (map->has_range) {
            *out++ = into.ranges[i];
            *out++ = spsi_higher(into.ranges[into.stride + (size_t)i], into.ranges[i]);
        }
        for (int k = 0; k < components; ++k) out[k] = into.sums[(size_t)k * into.stride + (size_t)i];
        if (map->technique->finish) map->technique->finish(&map->inner, out);
    }
}

/* One parallel visit of all occluders to a band. */
static sps_result spsi_fill_band(spsi_filling *filling, spsi_visit visit) {
    filling->visit = visit;
    if (spsi_progress(filling->context, filling->progress)) return filling->context->result;
    spsi_parallel(filling->context, filling->band.tiles_x, spsi_clear_task, filling);
    if (spsi_fill_volumes(filling)) return filling->context->result;
    spsi_parallel(filling->context, filling->band.tiles_x, spsi_fill_task, filling);
    return SPS_OK;
}

static sps_result spsi_fill_sums(spsi_filling *filling) {
    const sps_tmap *map = filling->map;
    const size_t floats = spsi_band_floats(map, map->inner.components + 2 * map->has_range);
    filling->band.ranges = (float *)spsi_reserve(filling->context, SPSI_BUFFER_BAND, floats, sizeof(float));
    if (!filling->band.ranges) return filling->context->result;
    filling->band.sums = filling->band.ranges + (map->has_range ? spsi_band_floats(map, 2) : 0);
    if (map->has_range && spsi_fill_band(filling, SPSI_VISIT_RANGE)) return filling->context->result;
    if (spsi_fill_band(filling, SPSI_VISIT_SUMS)) return filling->context->result;
    spsi_parallel(filling->context, filling->band.tiles_x, spsi_store_task, filling);
    return SPS_OK;
}

/* --- lists --- */

/* Counts the band's intervals, lists them, and finds the maximum number in a texel. */
static sps_result spsi_fill_lists(spsi_filling *filling) {
    sps_context *context = filling->context;
    const size_t texels = (size_t)filling->map->rays[0].width * (size_t)spsi_filling_height(filling);
    uint64_t sum = 0;
    filling->band.starts = (uint32_t *)spsi_reserve(context, SPSI_BUFFER_CURSORS, 2 * texels + 1, sizeof(uint32_t));
    if (!filling->band.starts) return context->result;
    filling->band.cursors = filling->band.starts + texels + 1;
    memset(filling->band.cursors, 0, texels * sizeof *filling->band.cursors);
    if (spsi_fill_band(filling, SPSI_VISIT_COUNT)) return context->result;
    filling->band.most = 0;
    for (size_t i = 0; i < texels; ++i) {
        filling->band.most =
            filling->band.cursors[i] > filling->band.most ? filling->band.cursors[i] : filling->band.most;
        filling->band.starts[i] = (uint32_t)sum;
        sum += filling->band.cursors[i];
        filling->band.cursors[i] = filling->band.starts[i];
    }
    filling->band.starts[texels] = (uint32_t)sum;
    if (sum > INT32_MAX)
        return spsi_fail_field(context, SPS_ERROR_MEMORY, SPS_OBJECT_TMAP, -1, "intervals in 64 rows", (double)sum,
                               "2^31 - 1 are held at most");
    filling->band.intervals =
        (spsi_interval *)spsi_reserve(context, SPSI_BUFFER_BAND, (size_t)sum, sizeof(spsi_interval));
    if (!filling->band.intervals) return context->result;
    return spsi_fill_band(filling, SPSI_VISIT_LIST);
}

/* A worker's memory for fitting: intervals, a curve, and compressed nodes or whatever a technique needs. */
typedef struct spsi_fitting {
    const spsi_filling *filling;
    spsi_interval *intervals;
    spsi_node *curve, *nodes;
} spsi_fitting;

static size_t spsi_fitting_intervals(const spsi_filling *filling) {
    const size_t most = filling->band.most;
    if (filling->map->settings.technique == SPS_TMAP_DEEP) return most / 2; /* they are only sorted, not fitted */
    return SPSI_CURVE_SCRATCH(most, (size_t)filling->pieces);
}

static size_t spsi_fitting_curve(const spsi_filling *filling) {
    const int curve = filling->map->settings.technique != SPS_TMAP_DEEP;
    return curve ? SPSI_CURVE_NODES((size_t)filling->band.most, (size_t)filling->pieces) : 0;
}

/* In 64 bits: a size_t may have fewer. Rounded up to whole intervals, so that the next worker's are aligned. */
static uint64_t spsi_fitting_bytes(const spsi_filling *filling) {
    size_t nodes = spsi_fitting_curve(filling);
    uint64_t bytes;
    if (filling->map->settings.technique == SPS_TMAP_COMPRESSED)
        nodes += (size_t)spsi_compressed_most((int)nodes, filling->epsilon);
    bytes = (uint64_t)spsi_fitting_intervals(filling) * sizeof(spsi_interval) + (uint64_t)nodes * sizeof(spsi_node);
    if (filling->map->technique->fit_bytes) bytes += filling->map->technique->fit_bytes((int)nodes);
    return (bytes / sizeof(spsi_interval) + 1) * sizeof(spsi_interval);
}

static void spsi_fitting_place(const spsi_filling *filling, int worker, spsi_fitting *fitting) {
    fitting->filling = filling;
    fitting->intervals = (spsi_interval *)(void *)(filling->scratch + (size_t)worker * filling->scratch_size);
    fitting->curve = (spsi_node *)(void *)(fitting->intervals + spsi_fitting_intervals(filling));
    fitting->nodes = fitting->curve + spsi_fitting_curve(filling);
}

/* Computes the nodes of a compressed map's texel, whose list is sorted; returns their number. */
static uint32_t spsi_fit_compressed(const spsi_fitting *fitting, const spsi_interval *list, uint32_t count) {
    const spsi_filling *filling = fitting->filling;
    const int pieces = spsi_soft_pieces(list, (int)count, filling->map->settings.epsilon);
    int bends;
    SPS_ASSERT(filling->pieces == 1 || pieces <= filling->pieces); /* there is room; 1: nothing is soft */
    bends = spsi_curve_build(list, (int)count, pieces, fitting->intervals, fitting->curve);
    return (uint32_t)spsi_curve_compress(fitting->curve, bends, filling->epsilon, fitting->nodes);
}

/* Number of nodes that fit into the memory of a texel's intervals. */
static uint32_t spsi_nodes_in_place(uint32_t intervals) {
    return intervals * (uint32_t)(sizeof(spsi_interval) / sizeof(spsi_node));
}

/* Sorts a texel's list, and turns it into what the technique keeps: floats or, where that is a list too, the number of
   its items, in `cursors`. */
static void spsi_fit_texel(const spsi_fitting *fitting, size_t texel) {
    const spsi_filling *filling = fitting->filling;
    const sps_tmap *map = filling->map;
    const size_t in_band = texel - filling->band.first_texel;
    const uint32_t count = filling->band.starts[in_band + 1] - filling->band.starts[in_band];
    spsi_interval *list = filling->band.intervals + filling->band.starts[in_band];
    spsi_intervals_sort(list, count, fitting->intervals);
    if (map->technique->fit) {
        const int nodes = spsi_curve_build(list, (int)count, SPSI_SOFT_PIECES, fitting->intervals, fitting->curve);
        map->technique->fit(&map->inner, fitting->curve, nodes, fitting->nodes,
                            (float *)map->data.texels.data + texel * (size_t)map->settings.components);
    } else if (map->settings.technique == SPS_TMAP_COMPRESSED) {
        const uint32_t nodes = spsi_fit_compressed(fitting, list, count);
        if (nodes <= spsi_nodes_in_place(count)) memcpy((void *)list, fitting->nodes, nodes * sizeof(spsi_node));
        filling->band.cursors[in_band] = nodes;
    } else {
        filling->band.cursors[in_band] = count;
    }
}

/* Writes the nodes of a compressed map's texel to their final place. */
static void spsi_fit_again(const spsi_fitting *fitting, size_t texel) {
    const spsi_filling *filling = fitting->filling;
    const size_t in_band = texel - filling->band.first_texel;
    const uint32_t *starts = (const uint32_t *)filling->map->data.starts.data + texel;
    const uint32_t count = filling->band.starts[in_band + 1] - filling->band.starts[in_band],
                   nodes = starts[1] - starts[0];
    const spsi_interval *list = filling->band.intervals + filling->band.starts[in_band];
    const int in_place = nodes <= spsi_nodes_in_place(count);
    if (!in_place) spsi_fit_compressed(fitting, list, count);
    memcpy((spsi_node *)filling->map->data.texels.data + starts[0], in_place ? (const void *)list : fitting->nodes,
           nodes * sizeof(spsi_node));
}

/* Fits the texels of one row of a tile: a whole tile would take too long where lists are long. */
static void spsi_fit_task(void *data, int index, int worker) {
    const spsi_filling *filling = (const spsi_filling *)data;
    spsi_fitting fitting;
    spsi_map_tile into;
    if (filling->context->cancelled) return;
    spsi_map_tile_place(filling, index % filling->band.tiles_x, &into);
    spsi_fitting_place(filling, worker, &fitting);
    for (int i = 0; i < into.width; ++i) {
        const size_t texel = spsi_map_tile_texel(&into, into.x0 + i, into.y0 + index / filling->band.tiles_x);
        if (filling->has_sizes)
            spsi_fit_again(&fitting, texel);
        else
            spsi_fit_texel(&fitting, texel);
    }
}

static sps_result spsi_tmap_refuse_budget(const sps_tmap *map, double bytes) {
    char rule[96];
    SPS_SNPRINTF(rule, sizeof rule, "the map takes %.0f bytes", bytes);
    return spsi_fail_setting(map->context, SPS_ERROR_MEMORY, map->light, "byte_budget",
                             (double)map->settings.byte_budget, rule);
}

/* Makes room for the items of a band, whose numbers are in `cursors`, and copies those of a deep map. */
static sps_result spsi_append_band(spsi_filling *filling) {
    sps_tmap *map = filling->map;
    const size_t texels = (size_t)map->rays[0].width * (size_t)spsi_filling_height(filling);
    const size_t item = spsi_tmap_item_bytes(map);
    uint32_t *starts = (uint32_t *)map->data.starts.data + filling->band.first_texel;
    const size_t held = starts[0];
    uint64_t sum = held;
    for (size_t i = 0; i < texels; ++i) {
        starts[i] = (uint32_t)sum;
        sum += filling->band.cursors[i];
    }
    if (sum > UINT32_MAX)
        return spsi_fail_field(filling->context, SPS_ERROR_MEMORY, SPS_OBJECT_TMAP, -1, "items", (double)sum,
                               "2^32 - 1 are held at most");
    starts[texels] = (uint32_t)sum;
    if (map->settings.byte_budget && (double)sum * (double)item > (double)map->settings.byte_budget)
        return spsi_tmap_refuse_budget(map, (double)sum * (double)item);
    if (!spsi_buffer_extend(filling->context, &map->data.texels, held, (size_t)sum, item))
        return filling->context->result;
    if (map->settings.technique == SPS_TMAP_DEEP)
        spsi_copy(filling->context, (spsi_interval *)map->data.texels.data + held, filling->band.intervals,
                  ((size_t)sum - held) * item);
    return SPS_OK;
}

static sps_result spsi_fill_fits(spsi_filling *filling) {
    sps_context *context = filling->context;
    const sps_tmap *map = filling->map;
    const spsi_technique *technique = map->technique;
    const int has_soft = filling->occluders->frame->particles.has_soft;
    uint64_t bytes;
    int tasks;
    if (spsi_fill_lists(filling)) return context->result;
    filling->pieces = has_soft ? technique->fit ? SPSI_SOFT_PIECES : SPSI_SOFT_MOST : 1;
    filling->epsilon = map->settings.epsilon * (has_soft ? 0.75f : 1); /* the rest is for soft pieces */
    /* the error that brackets allow for */
    filling->map->inner.epsilon = spsi_higher(map->settings.epsilon, has_soft ? SPSI_SOFT_EPSILON : SPSI_EPSILON_MIN);
    if (filling->band.most > INT32_MAX / (4 * (SPSI_SOFT_MOST + 1)) && map->settings.technique != SPS_TMAP_DEEP)
        return spsi_fail_field(context, SPS_ERROR_MEMORY, SPS_OBJECT_TMAP, -1, "intervals in a texel",
                               (double)filling->band.most, "2 million can be fitted");
    bytes = spsi_fitting_bytes(filling);
    if (bytes > SIZE_MAX)
        return spsi_fail_field(context, SPS_ERROR_MEMORY, SPS_OBJECT_TMAP, -1, "bytes to fit a texel", (double)bytes,
                               "they are more than memory can have");
    filling->scratch_size = (size_t)bytes;
    filling->scratch =
        (char *)spsi_reserve(context, SPSI_BUFFER_CURVES, (size_t)spsi_worker_count(context), filling->scratch_size);
    if (!filling->scratch) return context->result;
    filling->has_sizes = 0;
    tasks = filling->band.tiles_x * spsi_filling_height(filling);
    spsi_parallel(context, tasks, spsi_fit_task, filling);
    if (spsi_progress(context, filling->progress) || !technique->lists) return context->result;
    if (spsi_append_band(filling)) return context->result;
    filling->has_sizes = 1;
    if (map->settings.technique == SPS_TMAP_COMPRESSED) spsi_parallel(context, tasks, spsi_fit_task, filling);
    return spsi_progress(context, filling->progress);
}

/* --- particles into tiles --- */

/* Number of depth steps by which particles are sorted; more would not shorten the sorting that remains. */
#define SPSI_DEPTH_STEPS 4096

/* Radii in texels. Up to the first, a particle's mass is made exact wherever among the texels it lies; from the second
   on, its chords are exact. In between, the two are blended. */
#define SPSI_BALL_FINE   1.0
#define SPSI_BALL_COARSE 1.5

typedef struct spsi_ball_job {
    const spsi_rays *rays;
    const spsi_rays *faces; /* of a cube, in all of which a particle has one mass; NULL: there is only one face */
    const spsi_frame *frame;
    double near_depth, steps_per_depth;
    uint32_t *order; /* of particles; NULL: in their own order */
    uint16_t *steps; /* the depth step, from near_depth on, at which each particle begins */
    spsi_ball *balls;
} spsi_ball_job;

static void spsi_ball_steps_task(void *data, int index, int worker) {
    const spsi_ball_job *job = (const spsi_ball_job *)data;
    const double *axis = job->rays->inverse[2], reach = spsi_length(axis);
    const int end = spsi_batch_end(index, job->frame->content->particle_count);
    (void)worker;
    for (int i = index * SPSI_BATCH; i < end; ++i) {
        const sps_particle *particle = &job->frame->content->particles[i];
        double offset[3], front;
        for (int k = 0; k < 3; ++k) offset[k] = (double)particle->position[k] - job->rays->origin[k];
        front = spsi_dot(axis, offset) - reach * (double)particle->radius - job->near_depth;
        job->steps[i] = (uint16_t)fmin(fmax(front * job->steps_per_depth, 0), SPSI_DEPTH_STEPS - 1);
    }
}

static size_t spsi_balls_order_bytes(size_t particles) {
    return SPSI_DEPTH_STEPS * sizeof(uint32_t) + particles * (sizeof(uint32_t) + sizeof(uint16_t));
}

/* Sorts particles into the order in which light meets them (a counting sort), so that the lists of all texels are
   nearly sorted already. */
static sps_result spsi_balls_order(sps_context *context, spsi_ball_job *job) {
    const int count = job->frame->content->particle_count;
    uint32_t *starts, sum = 0;
    job->order = (uint32_t *)spsi_reserve(context, SPSI_BUFFER_BALL_ORDER, 1, spsi_balls_order_bytes((size_t)count));
    if (!job->order) return context->result;
    starts = job->order + count;
    job->steps = (uint16_t *)(void *)(starts + SPSI_DEPTH_STEPS);
    spsi_parallel_batches(context, count, spsi_ball_steps_task, job);
    memset(starts, 0, SPSI_DEPTH_STEPS * sizeof *starts);
    for (int i = 0; i < count; ++i) starts[job->steps[i]] += 1;
    for (int step = 0; step < SPSI_DEPTH_STEPS; ++step) {
        const uint32_t here = starts[step];
        starts[step] = sum;
        sum += here;
    }
    for (int i = 0; i < count; ++i) job->order[starts[job->steps[i]]++] = (uint32_t)i;
    return SPS_OK;
}

/* Solid angle of a texel of a cube's face, relative to one in its middle; a texel on an edge has only half of its solid
   angle in the face. */
static double spsi_ray_angle(const spsi_rays *rays, int x, int y) {
    const int edges = (x == 0 || x == rays->width - 1) + (y == 0 || y == rays->height - 1);
    double e[3];
    spsi_ray_direction(rays, x, y, e);
    return pow(spsi_dot(e, e), -1.5) * (edges == 0 ? 1 : edges == 1 ? 0.5 : 0.25);
}

/* Sum of a ball's chords, each 1 in its middle, over the texels of a box; around a light, texels are weighted by their
   solid angle. Summed row by row and one by one, so that the sum does not depend on the vectors' length. */
static double spsi_ball_sum(const spsi_rays *rays, const spsi_ball *ball, const int box[4], int round) {
    double sum = 0;
    for (int y = box[1]; y <= box[3]; ++y)
        for (int x = box[0]; x <= box[2]; x += SPSI_LANES) {
            float shares[SPSI_LANES];
            spsi_chord chord;
            spsi_ball_chord(rays, ball, x, y, &chord);
            spsi_store(shares, chord.share);
            for (int i = 0; i < spsi_least(SPSI_LANES, box[2] + 1 - x); ++i) {
                const double share = (double)shares[i];
                if (share > 0)
                    sum += (ball->soft ? share * share * share : share) * (round ? spsi_ray_angle(rays, x + i, y) : 1);
            }
        }
    return sum;
}

/* Mean of a ball's chords, which are 1 in the middle, over its outline. */
static double spsi_ball_mean(const spsi_ball *ball) { return ball->soft ? 2.0 / 5 : 2.0 / 3; }

/* Box of texels that a ball which is not near may cover, also beyond its face's edges: that of an ellipse. Returns the
   ellipse's area, or 0 where the angle is so grazing that there is none. */
static double spsi_ball_box(const spsi_ball *ball, int box[4]) {
    const double a = (double)ball->cross[0], b = (double)ball->cross[1], c = (double)ball->cross[2];
    const double square = a * c - b * b, x = ball->x0 + (double)ball->x, y = ball->y0 + (double)ball->y;
    double across, down;
    if (!(square > 0)) return 0;
    across = sqrt(c / square) + 1, down = sqrt(a / square) + 1; /* perspective shifts it a little */
    if (!(across + down < SPSI_TILE_WIDTH)) return 0;
    box[0] = (int)ceil(x - across), box[2] = (int)floor(x + across);
    box[1] = (int)ceil(y - down), box[3] = (int)floor(y + down);
    return SPSI_PI / sqrt(square);
}

/* Ratio of the sum of a ball's chords in all faces around a light to the exact sum. It is the same for each face that
   sees the ball, so that there is no seam. */
static double spsi_ball_mass_round(const spsi_ball_job *job, const spsi_particle_set *set, const sps_particle *particle,
                                   const spsi_ball *ball, const double offset[3]) {
    const double texel = spsi_length(job->rays->a) * spsi_length(offset);
    const int last = job->rays->width - 1;
    double radius, sum = 0;
    spsi_ball other;
    int box[4], alone;
    spsi_ball_size(job->rays, set, particle, offset, &other, &radius);
    alone = !ball->near_by && spsi_ball_box(ball, box) > 0;
    alone = alone && box[0] > 0 && box[1] > 0 && box[2] < last && box[3] < last; /* no other face sees it */
    for (int face = 0; face < SPSI_CUBE_FACES; ++face) {
        const spsi_rays *rays = &job->faces[face];
        if (alone && rays != job->rays) continue;
        spsi_ball_build(rays, set, particle, &other);
        box[0] = other.x0, box[1] = other.y0, box[2] = other.x1, box[3] = other.y1;
        sum += spsi_ball_sum(rays, &other, box, 1);
    }
    return sum * texel * texel / (SPSI_PI * radius * radius * spsi_ball_mean(ball));
}

/* Ratio of the sum of a ball's chords over all texels to the exact sum; 1 where that is unknown. */
static double spsi_ball_mass(const spsi_ball_job *job, const spsi_particle_set *set, const sps_particle *particle,
                             const spsi_ball *ball, const double offset[3]) {
    int box[4];
    double area;
    if (job->faces) return spsi_ball_mass_round(job, set, particle, ball, offset);
    area = ball->near_by ? 0 : spsi_ball_box(ball, box);
    return area > 0 ? spsi_ball_sum(job->rays, ball, box, 0) / (area * spsi_ball_mean(ball)) : 1;
}

/* Adjusts the optical depth of a ball of a texel or less so that its mass is exact, wherever its centre lies among the
   texels. */
static void spsi_ball_weigh(const spsi_ball_job *job, const spsi_particle_set *set, const sps_particle *particle,
                            spsi_ball *ball) {
    const spsi_rays *rays = job->rays;
    double centre[3], offset[3], texel, share, mass;
    /* most are much too large: the sum of the inverse squares of the outline's half axes is small */
    if (!ball->near_by && (double)ball->cross[0] + (double)ball->cross[2] < 1 / (SPSI_BALL_COARSE * SPSI_BALL_COARSE))
        return;
    for (int i = 0; i < 3; ++i) centre[i] = (double)particle->position[i];
    spsi_along(centre, rays->origin, -1, offset);
    texel = fmax(spsi_length(rays->a), spsi_length(rays->b)) * spsi_distance_to(rays, offset);
    share = (SPSI_BALL_COARSE - (double)particle->radius / texel) / (SPSI_BALL_COARSE - SPSI_BALL_FINE);
    if (!(share > 0) || ball->x1 < ball->x0 || ball->y1 < ball->y0) return;
    /* a face of too few texels, or a ball as wide as its distance */
    if (job->faces && (rays->width < 3 || !(2 * (double)particle->radius < spsi_length(offset)))) return;
    mass = spsi_ball_mass(job, set, particle, ball, offset);
    if (mass > 0) ball->depth *= (float)(1 + fmin(share, 1) * (1 / mass - 1));
}

static void spsi_balls_task(void *data, int index, int worker) {
    const spsi_ball_job *job = (const spsi_ball_job *)data;
    const spsi_frame *frame = job->frame;
    const int end = spsi_batch_end(index, frame->content->particle_count);
    (void)worker;
    for (int i = index * SPSI_BATCH; i < end; ++i) {
        const int particle = job->order ? (int)job->order[i] : i;
        const spsi_particle_set *set = spsi_set_of(frame, particle);
        spsi_ball_build(job->rays, set, &frame->content->particles[particle], &job->balls[i]);
        spsi_ball_weigh(job, set, &frame->content->particles[particle], &job->balls[i]);
    }
}

#define SPSI_OUTSIDE 1e-3 /* share of a map's depth range: reaching less beyond it is negligible */

/* Average number of tiles per ball above which no lists are made: such balls cover much of a map anyway. */
#define SPSI_BALL_TILES 8

/* Counts the balls of each tile in `starts`; or, if there is a list, stores them at `starts`, which are advanced. */
static void spsi_balls_into_tiles(const spsi_ball *balls, size_t count, int tiles_x, uint32_t *starts, uint32_t *list) {
    for (size_t i = 0; i < count; ++i) {
        const spsi_ball *ball = &balls[i];
        if (ball->x1 < ball->x0 || ball->y1 < ball->y0) continue;
        for (int y = ball->y0 / SPSI_TILE_HEIGHT; y <= ball->y1 / SPSI_TILE_HEIGHT; ++y)
            for (int x = ball->x0 / SPSI_TILE_WIDTH; x <= ball->x1 / SPSI_TILE_WIDTH; ++x) {
                uint32_t *start = &starts[y * tiles_x + x];
                if (list) list[*start] = (uint32_t)i;
                *start += 1;
            }
    }
}

/* Counts the balls that reach beyond the map's depth range; with six faces, on the face through which the centre is
   seen. */
static void spsi_balls_outside(sps_tmap *map, const spsi_rays *rays, const spsi_ball *balls, size_t count) {
    const double per_length = spsi_length(rays->inverse[2]);
    const double light = rays->perspective ? -map->settings.near_depth * map->per_depth : -HUGE_VAL;
    for (size_t i = 0; i < count; ++i) {
        const spsi_ball *ball = &balls[i];
        const double radius = ball->near_by ? (double)ball->world_radius * per_length : (double)ball->radius;
        const double low =
            fmax(((double)ball->t - radius) * map->per_depth, light); /* behind the light, none is lost */
        const double high = ((double)ball->t + radius) * map->per_depth;
        double offset[3];
        if (ball->x1 < ball->x0 || ball->y1 < ball->y0 || (low > -SPSI_OUTSIDE && high < 1 + SPSI_OUTSIDE)) continue;
        for (int k = 0; k < 3; ++k) offset[k] = (double)ball->offset[k];
        if (map->face_count > 1 && rays != &map->rays[spsi_cube_face_of(offset)]) continue;
        map->context->stats.particles_outside += 1;
    }
}

/* Builds the particles as a face's rays see them, sorted by depth if the technique needs lists, and lists those of each
   tile. */
static sps_result spsi_occluders_sort(sps_tmap *map, const spsi_rays *rays, spsi_occluders *occluders) {
    sps_context *context = map->context;
    const int tiles_x = spsi_tile_columns(rays);
    const size_t tiles = (size_t)tiles_x * (size_t)spsi_tile_rows(rays);
    const size_t count = (size_t)occluders->frame->content->particle_count;
    uint32_t *starts, *list;
    uint64_t sum = 0;
    spsi_ball_job job;
    if (count == 0) return SPS_OK;
    memset(&job, 0, sizeof job);
    job.rays = rays;
    job.faces = map->face_count > 1 ? map->rays : NULL;
    job.frame = occluders->frame;
    job.near_depth = map->settings.near_depth;
    job.steps_per_depth = SPSI_DEPTH_STEPS * map->per_depth;
    if (!map->technique->sums && spsi_balls_order(context, &job)) return context->result;
    job.balls = (spsi_ball *)spsi_reserve(context, SPSI_BUFFER_BALLS, count, sizeof(spsi_ball));
    starts = (uint32_t *)spsi_reserve(context, SPSI_BUFFER_BALL_STARTS, tiles + 1, sizeof *starts);
    if (!job.balls || !starts) return context->result;
    spsi_parallel_batches(context, occluders->frame->content->particle_count, spsi_balls_task, &job);
    spsi_balls_outside(map, rays, job.balls, count);
    memset(starts, 0, (tiles + 1) * sizeof *starts);
    spsi_balls_into_tiles(job.balls, count, tiles_x, starts + 1, NULL);
    for (size_t i = 0; i <= tiles; ++i) {
        sum += starts[i];
        starts[i] = (uint32_t)sum;
    }
    occluders->balls = job.balls;
    occluders->tile_balls = NULL;
    if (sum > SPSI_BALL_TILES * (uint64_t)(count + tiles) || sum > UINT32_MAX) return SPS_OK;
    list = (uint32_t *)spsi_reserve(context, SPSI_BUFFER_BALL_LIST, (size_t)sum, sizeof *list);
    if (!list) return context->result;
    spsi_balls_into_tiles(job.balls, count, tiles_x, starts, list);
    memmove(starts + 1, starts, tiles * sizeof *starts); /* each was advanced to where the next begins */
    starts[0] = 0;
    occluders->tile_starts = starts;
    occluders->tile_balls = list;
    return SPS_OK;
}

/* --- a face of a map, and its slabs --- */

/* Slabs perpendicular to a face's axis, for the volumes of a frame; here particles are not part of sheets. */
static sps_result spsi_tmap_slabs(sps_context *context, const spsi_frame *frame, const spsi_rays *rays,
                                  spsi_slabs *slabs) {
    double least;
    memcpy(slabs->normal, rays->inverse[2], sizeof slabs->normal);
    spsi_normalise(slabs->normal);
    least = spsi_cosine_to_corners(slabs->normal, rays);
    if (!(least >= SPSI_COSINE_MIN))
        return spsi_fail_field(
            context, SPS_ERROR_UNSUPPORTED, frame->viewer, -1, "camera's outermost rays' cosine with its axis", least,
            frame->has_matrix ? "volumes need 0.1; is world_to_clip row-major? If it is, narrow the light's view"
                              : "volumes need 0.1; narrow the light's view, up and down or sideways");
    return spsi_slabs_cut(context, frame, rays, NULL, HUGE_VAL, slabs);
}

/* Prepares the splatting of volumes into a face. */
static sps_result spsi_map_volumes_build(sps_context *context, const spsi_frame *frame, const spsi_rays *rays,
                                         spsi_map_volumes *volumes) {
    spsi_target *target = &volumes->target;
    memset(volumes, 0, sizeof *volumes);
    if (spsi_tmap_slabs(context, frame, rays, &volumes->slabs)) return context->result;
    spsi_light_shader_build(frame, rays, &volumes->slabs, &volumes->shader);
    if (spsi_target_of_light(context, frame, rays, &volumes->slabs, frame->accuracy.cut, target))
        return context->result;
    return spsi_contents_build(context, target, NULL, &volumes->contents);
}

/* --- what a table's texels are made from --- */

/* A hash of what a voxel's optical depth is made from, except for its value. */
static uint64_t spsi_medium_fingerprint(const spsi_frame *frame, int i) {
    const spsi_material *material = &frame->matter.materials[frame->media[i].channel];
    uint64_t hash = SPSI_FINGERPRINT_START;
    hash = spsi_fingerprint(hash, frame->lattices[i].step, sizeof frame->lattices[i].step);
    hash = spsi_fingerprint(hash, frame->lattices[i].corner, sizeof frame->lattices[i].corner);
    hash = spsi_fingerprint(hash, &material->extinction, sizeof material->extinction);
    hash = spsi_fingerprint(hash, &material->table_scale, sizeof material->table_scale);
    if (material->table) hash = spsi_fingerprint(hash, material->table->entry, sizeof material->table->entry);
    return hash;
}

/* A hash of how particles of a set become balls. */
static uint64_t spsi_set_fingerprint(uint64_t hash, const spsi_particle_set *set) {
    hash = spsi_fingerprint(hash, &set->soft, sizeof set->soft);
    return spsi_fingerprint(hash, &set->is_extinction, sizeof set->is_extinction);
}

typedef struct spsi_print_job {
    const spsi_filling *filling;
    uint64_t start;                   /* of all patches: the slabs and kernels of the face */
    uint64_t media[SPSI_VOLUMES_MAX]; /* of each medium */
} spsi_print_job;

/* Adds a fingerprint to those of the patches that meet a box of texels, counted from the tile's first. */
static void spsi_print_patches(uint64_t prints[64], int x0, int y0, int x1, int y1, uint64_t print) {
    for (int row = spsi_patch_at(y0); row <= spsi_patch_at(y1); ++row)
        for (int column = spsi_patch_at(x0); column <= spsi_patch_at(x1); ++column)
            prints[8 * row + column] = spsi_fingerprint_word(prints[8 * row + column], print);
}

static void spsi_print_bricks(const spsi_print_job *job, int column, int row, uint64_t prints[64]) {
    const spsi_map_volumes *volumes = job->filling->occluders->volumes;
    const sps_context *context = job->filling->context;
    const uint64_t *voxels = (const uint64_t *)context->buffers[SPSI_BUFFER_BRICK_PRINTS].data;
    const int x = column * SPSI_TILE_WIDTH, y = row * SPSI_TILE_HEIGHT;
    for (int i = 0; i < context->brick_count && volumes; ++i) {
        const int16_t *box = volumes->target.brick_boxes[i];
        const int lattice = volumes->contents.list[i].lattice;
        if (volumes->target.channels[lattice] < 0 || !spsi_box_meets_tile(box, column, row)) continue;
        spsi_print_patches(prints, box[0] - x, box[1] - y, box[2] - x, box[3] - y,
                           spsi_fingerprint_word(job->media[lattice], voxels[i]));
    }
}

static void spsi_print_balls(const spsi_print_job *job, int column, int row, uint64_t prints[64]) {
    const spsi_occluders *occluders = job->filling->occluders;
    const int tile = row * job->filling->band.tiles_x + column;
    const int x = column * SPSI_TILE_WIDTH, y = row * SPSI_TILE_HEIGHT;
    const uint32_t count = spsi_tile_ball_count(occluders, tile);
    for (uint32_t i = 0; i < count; ++i) {
        const int number = (int)spsi_tile_ball(occluders, tile, i);
        const spsi_ball *ball = &occluders->balls[number];
        uint64_t print;
        if (ball->x1 < spsi_most(x, ball->x0) || ball->x0 >= x + SPSI_TILE_WIDTH) continue;
        if (ball->y1 < spsi_most(y, ball->y0) || ball->y0 >= y + SPSI_TILE_HEIGHT) continue;
        print = spsi_fingerprint(SPSI_FINGERPRINT_START, &occluders->frame->content->particles[number],
                                 sizeof(sps_particle));
        print = spsi_set_fingerprint(print, spsi_set_of(occluders->frame, number));
        spsi_print_patches(prints, ball->x0 - x, ball->y0 - y, ball->x1 - x, ball->y1 - y, print);
    }
}

/* Computes a tile's fingerprints in the order in which it is filled, and opens the patches whose own have changed. */
static void spsi_print_task(void *data, int index, int worker) {
    const spsi_print_job *job = (const spsi_print_job *)data;
    const spsi_filling *filling = job->filling;
    const int column = index % filling->band.tiles_x, row = index / filling->band.tiles_x;
    spsi_tile_prints *held = spsi_tmap_prints(filling->map, filling->band.face, row, column);
    uint64_t prints[64];
    (void)worker;
    for (int i = 0; i < 64; ++i) prints[i] = job->start;
    spsi_print_bricks(job, column, row, prints);
    spsi_print_balls(job, column, row, prints);
    held->open = 0;
    for (int i = 0; i < 64; ++i)
        held->open |= (uint64_t)(!filling->map->past.data || held->patches[i] != prints[i]) << i;
    held->open &= spsi_tmap_patches(filling->map, row, column);
    memcpy(held->patches, prints, sizeof prints);
}

/* Fingerprints of all tiles of a face whose bricks and balls are binned. */
static void spsi_print_face(const spsi_filling *filling) {
    const spsi_frame *frame = filling->occluders->frame;
    const spsi_map_volumes *volumes = filling->occluders->volumes;
    spsi_print_job job;
    job.filling = filling;
    job.start = spsi_fingerprint(SPSI_FINGERPRINT_START, &frame->accuracy.cut, sizeof frame->accuracy.cut);
    for (int i = 0; i < frame->medium_count && volumes; ++i) job.media[i] = spsi_medium_fingerprint(frame, i);
    if (volumes) {
        job.start = spsi_fingerprint(job.start, &volumes->slabs.start, sizeof volumes->slabs.start);
        job.start = spsi_fingerprint(job.start, &volumes->slabs.thickness, sizeof volumes->slabs.thickness);
    }
    spsi_parallel(filling->context, filling->band.tiles_x * spsi_tile_rows(&filling->map->rays[0]), spsi_print_task,
                  &job);
}

/* Counts a shadow table's patches, those that were filled and those that were kept; `held`: 1 if all were. */
static void spsi_shadow_table_count(const sps_tmap *map, int held) {
    sps_stats_report *stats = &map->context->stats;
    const int columns = spsi_tile_columns(&map->rays[0]), rows = spsi_tile_rows(&map->rays[0]);
    for (int tile = 0; tile < map->face_count * rows * columns; ++tile) {
        const int column = tile % columns, row = tile / columns % rows;
        const spsi_tile_prints *prints = spsi_tmap_prints(map, tile / columns / rows, row, column);
        const uint64_t all = spsi_tmap_patches(map, row, column);
        const uint64_t made = held ? 0 : prints ? prints->open : all;
        for (int i = 0; i < 64; ++i) {
            stats->table_patches_made += made >> i & 1;
            stats->table_patches_held += (all & ~made) >> i & 1;
        }
    }
}

/* --- filling a face, and the whole map --- */

/* Whether no texel of a band is filled. */
static int spsi_band_is_closed(const spsi_filling *filling) {
    for (int column = 0; column < filling->band.tiles_x; ++column) {
        spsi_map_tile into;
        spsi_map_tile_place(filling, column, &into);
        if (into.open) return 0;
    }
    return 1;
}

static sps_result spsi_fill_face(spsi_filling *filling, spsi_occluders *occluders) {
    sps_tmap *map = filling->map;
    const spsi_rays *rays = &map->rays[filling->band.face];
    const int rows = spsi_tile_rows(rays);
    if (spsi_occluders_sort(map, rays, occluders)) return filling->context->result;
    for (int i = 0; i < occluders->faces.count; ++i)
        spsi_face_box(&occluders->faces, i, rays, occluders->boxes + 4 * i);
    if (occluders->volumes) {
        const double per_depth = spsi_length(rays->inverse[2]) * map->per_depth;
        const spsi_slabs *slabs = &occluders->volumes->slabs;
        if (spsi_map_volumes_build(filling->context, occluders->frame, rays, occluders->volumes))
            return filling->context->result;
        filling->u_per_slab = slabs->thickness * per_depth;
        filling->slab_u = (slabs->start - spsi_dot(slabs->normal, rays->origin)) * per_depth -
                          map->settings.near_depth * map->per_depth;
    }
    if (map->data.prints.data) spsi_print_face(filling);
    for (filling->band.row = 0; filling->band.row < rows; ++filling->band.row) {
        if (spsi_band_is_closed(filling)) continue;
        filling->progress =
            spsi_part_done(&occluders->part, (filling->band.face + (double)filling->band.row / rows) / map->face_count);
        filling->band.first_texel =
            ((size_t)filling->band.face * (size_t)rays->height + (size_t)filling->band.row * SPSI_TILE_HEIGHT) *
            (size_t)rays->width;
        if (map->technique->sums ? spsi_fill_sums(filling) : spsi_fill_fits(filling)) return filling->context->result;
    }
    return SPS_OK;
}

/* Bytes that the map holds; before it is finished, what it will hold, as far as that is known. */
static size_t spsi_tmap_bytes(const sps_tmap *map) {
    const size_t texels = spsi_tmap_texel_count(map);
    const size_t fixed = sizeof *map + map->planes.size;
    if (map->finished)
        return fixed + map->data.texels.size + map->data.starts.size + map->data.table.size + map->data.surfaces.size;
    if (map->technique->lists) return fixed + (texels + 1) * sizeof(uint32_t);
    if (map->settings.technique == SPS_TMAP_TABLE)
        return fixed + (size_t)(spsi_shadow_table_blocks(map) * SPSI_SHADOW_TABLE_TEXELS * map->settings.components) *
                           sizeof(float);
    return fixed + texels * (size_t)map->settings.components * sizeof(float);
}

/* Reserves what the map will hold, as far as that is known. */
static sps_result spsi_tmap_reserve_texels(sps_tmap *map, int has_surfaces) {
    const size_t texels = spsi_tmap_texel_count(map);
    float *surfaces = NULL;
    if (map->technique->lists) {
        if (!spsi_buffer_reserve(map->context, &map->data.starts, texels + 1, sizeof(uint32_t)))
            return map->context->result;
        memset(map->data.starts.data, 0, (texels + 1) * sizeof(uint32_t));
    } else if (!spsi_buffer_reserve(map->context, &map->data.texels, texels,
                                    (size_t)map->settings.components * sizeof(float)))
        return map->context->result;
    if (!has_surfaces) return SPS_OK;
    surfaces = (float *)spsi_buffer_reserve(map->context, &map->data.surfaces, texels, sizeof(float));
    for (size_t i = 0; i < texels && surfaces; ++i) surfaces[i] = SPSI_NO_SURFACE;
    return map->context->result;
}

/* Prepares the fingerprints of a shadow table that can be held: those of a table that is brought up to date are there.
 */
static sps_result spsi_tmap_reserve_prints(sps_tmap *map) {
    const size_t tiles = (size_t)spsi_tile_columns(&map->rays[0]) * (size_t)spsi_tile_rows(&map->rays[0]);
    if (!map->key || spsi_brick_prints(map->context)) return map->context->result;
    spsi_buffer_reserve(map->context, &map->data.prints, (size_t)map->face_count * tiles, sizeof(spsi_tile_prints));
    return map->context->result;
}

/* Releases the memory that a list has grown to beyond what it holds. */
static sps_result spsi_tmap_trim(sps_tmap *map) {
    const size_t item = spsi_tmap_item_bytes(map), count = spsi_tmap_item_count(map);
    spsi_buffer exact = {NULL, 0};
    if (map->data.texels.size <= (count > 0 ? count : 1) * item) return SPS_OK;
    if (!spsi_buffer_reserve(map->context, &exact, count, item)) return map->context->result;
    spsi_copy(map->context, exact.data, map->data.texels.data, count * item);
    spsi_buffer_release(map->context, &map->data.texels);
    map->data.texels = exact;
    return SPS_OK;
}

/* Fills a map with the triangles, and with the frame's voxels and particles, which must have been gathered. */
static sps_result spsi_tmap_fill(sps_tmap *map, spsi_occluders *occluders) {
    sps_context *context = map->context;
    spsi_filling filling;
    int has_surfaces = 0;
    if (context->brick_count > 0 && occluders->frame->medium_count > 0 && occluders->frame->matter.extinguishes) {
        occluders->volumes =
            (spsi_map_volumes *)spsi_reserve(context, SPSI_BUFFER_TMAP_VOLUMES, 1, sizeof(spsi_map_volumes));
        if (!occluders->volumes) return context->result;
    }
    for (int i = 0; i < occluders->faces.count; ++i)
        has_surfaces |= spsi_face_optical_depth(&occluders->faces.list[i]) >= SPSI_DEPTH_MAX;
    if (has_surfaces && map->settings.byte_budget &&
        spsi_tmap_bytes(map) + spsi_tmap_texel_count(map) * sizeof(float) > map->settings.byte_budget)
        return spsi_tmap_refuse_budget(map,
                                       (double)(spsi_tmap_bytes(map) + spsi_tmap_texel_count(map) * sizeof(float)));
    if (spsi_tmap_reserve_texels(map, has_surfaces) || spsi_tmap_reserve_prints(map)) return context->result;
    memset(&filling, 0, sizeof filling);
    filling.context = context;
    filling.map = map;
    filling.occluders = occluders;
    filling.band.tiles_x = spsi_tile_columns(&map->rays[0]);
    filling.light_u = map->rays[0].perspective ? -map->settings.near_depth * map->per_depth : -HUGE_VAL;
    occluders->boxes = (int *)context->buffers[SPSI_BUFFER_FACE_ROWS].data;
    for (filling.band.face = 0; filling.band.face < map->face_count; ++filling.band.face)
        if (spsi_fill_face(&filling, occluders)) return context->result;
    if ((map->technique->lists && spsi_tmap_trim(map)) || spsi_progress(context, spsi_part_done(&occluders->part, 1)))
        return context->result;
    map->finished = 1;
    if (!map->settings.byte_budget || spsi_tmap_bytes(map) <= map->settings.byte_budget) return SPS_OK;
    spsi_tmap_refuse_budget(map, (double)spsi_tmap_bytes(map)); /* only while it is finished is its size known */
    map->finished = 0;
    return context->result;
}

/* --- making a map --- */

/* Checks the camera of a map's light, or only its position if the light is omnidirectional. */
static sps_result spsi_check_tmap_camera(sps_context *context, const sps_tmap_light *light) {
    const sps_camera *camera = &light->camera;
    double forward[3];
    if (light->omnidirectional)
        return spsi_check_vector(context, SPS_OBJECT_TMAP_LIGHT, "camera.position", camera->position);
    if (spsi_check_camera(context, SPS_OBJECT_TMAP_LIGHT, camera)) return context->result;
    spsi_along(camera->target, camera->position, -1, forward);
    if (camera->world_to_clip || spsi_dot(forward, forward) > 0) return SPS_OK;
    return spsi_fail_that(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_TMAP_LIGHT, -1, "camera.position", 0,
                          "and camera.target are the same point; a map looks from one to the other, or, where "
                          "light.omnidirectional is 1, all round");
}

static sps_result spsi_tmap_check(sps_context *context, const sps_tmap_light *light,
                                  const sps_tmap_settings *settings) {
    const int size[2] = {light->width, light->height};
    if (spsi_check_settings(context, -1, settings)) return context->result;
    if (!(settings->near_depth >= 0 && settings->near_depth <= SPSI_COORDINATE_MAX))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_TMAP_SETTINGS, -1, "near_depth",
                               settings->near_depth, "it must be 0..1e15");
    if (!(settings->far_depth > settings->near_depth && settings->far_depth <= SPSI_COORDINATE_MAX))
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_TMAP_SETTINGS, -1, "far_depth",
                               settings->far_depth, "it must be above near_depth, and within 1e15");
    if (spsi_check_canaries(context, SPS_OBJECT_TMAP_LIGHT, -1, "", light->start_canary, light->end_canary) ||
        spsi_check_sampling(context, SPS_OBJECT_TMAP_LIGHT, size, light->quality, light->slab))
        return context->result;
    if (light->omnidirectional && size[0] != size[1])
        return spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_TMAP_LIGHT, -1, "width", size[0],
                               "it must equal the height of an omnidirectional light");
    return spsi_check_tmap_camera(context, light);
}

/* Number of planes that make a table's entries as long as they are wide, in the middle of its depths, unless these are
   too many. */
static int spsi_shadow_table_planes(const sps_tmap *map) {
    const spsi_rays *rays = &map->rays[0];
    const double low = map->settings.near_depth, high = map->settings.far_depth;
    const double pitch = spsi_pixel_size_at(rays, 0.5 * (low + high));
    const spsi_technique *technique = map->technique;
    const double most = fmin(technique->usual, floor(SPSI_SHADOW_TABLE_BLOCKS_MOST / spsi_shadow_table_blocks(map)));
    return (int)fmax(fmin(ceil((high - low) / pitch), most), technique->least);
}

/* Fills in the number of components; if it is left to the technique, the largest that fits into the budget, up to the
   default. */
static sps_result spsi_tmap_resolve(sps_tmap *map) {
    const spsi_technique *technique = map->technique;
    sps_tmap_settings *settings = &map->settings;
    const size_t budget = settings->byte_budget; /* a light's map has no surfaces */
    const size_t surfaces = map->light < 0 ? spsi_tmap_texel_count(map) * sizeof(float) : 0;
    const int is_set = settings->components > 0;
    map->has_range = spsi_settings_have_range(settings);
    settings->components = spsi_components_of(settings);
    if (!is_set && settings->technique == SPS_TMAP_TABLE) settings->components = spsi_shadow_table_planes(map);
    while (!is_set && budget && spsi_tmap_bytes(map) + surfaces > budget && technique->step > 0 &&
           settings->components - technique->step >= spsi_components_least(settings))
        settings->components -= technique->step;
    if (!(settings->epsilon > 0)) settings->epsilon = 0.01f;
    map->inner = *settings;
    map->inner.components -= 2 * map->has_range;
    /* lookups index by int */
    map->has_vectors =
        technique->optical_depths && spsi_tmap_texel_count(map) <= INT32_MAX / (size_t)settings->components;
    return budget && spsi_tmap_bytes(map) > budget ? spsi_tmap_refuse_budget(map, (double)spsi_tmap_bytes(map))
                                                   : SPS_OK;
}

/* Copies the caller's planes, which are checked, into a map. */
static sps_result spsi_tmap_take_planes(sps_tmap *map) {
    const size_t count = (size_t)spsi_settings_planes(&map->settings);
    float *planes;
    if (count == 0) return SPS_OK;
    planes = (float *)spsi_buffer_reserve(map->context, &map->planes, count, sizeof(float));
    if (!planes) return map->context->result;
    memcpy(planes, map->settings.planes, count * sizeof *planes);
    map->settings.planes = map->inner.planes = planes;
    return SPS_OK;
}

/* Builds the rays of a map's faces. */
static sps_result spsi_tmap_aim(sps_tmap *map) {
    map->rays[0].width = map->view.width;
    map->rays[0].height = map->view.height;
    if (map->face_count == 1 && spsi_rays_build(map->context, SPS_OBJECT_TMAP_LIGHT, &map->view.camera, &map->rays[0]))
        return map->context->result;
    for (int face = 0; face < map->face_count; ++face) {
        spsi_rays *rays = &map->rays[face];
        if (map->face_count > 1 && !spsi_rays_of_cube_face(map->view.camera.position, face, map->view.width, 0, rays))
            return spsi_fail_field(map->context, SPS_ERROR_ARGUMENT, SPS_OBJECT_TMAP_LIGHT, -1, "camera.position",
                                   map->view.camera.position[0], "texels cannot be told apart there");
        rays->depth_reference = map->settings.near_depth;
        rays->near_depth = rays->perspective ? 0 : -HUGE_VAL;
    }
    {
        const double per_length = spsi_length(map->rays[0].inverse[2]);
        const double texel = fmax(spsi_length(map->rays[0].a), spsi_length(map->rays[0].b));
        const int own = map->settings.surface_bias > 0;
        map->bias[0] = own                        ? map->settings.surface_bias * per_length
                       : map->rays[0].perspective ? 0
                                                  : 2 * texel * per_length;
        map->bias[1] = own || !map->rays[0].perspective ? 0 : 2 * texel * per_length;
    }
    return SPS_OK;
}

/* Sets up a map that is zeroed except for its context. */
static sps_result spsi_tmap_build(sps_tmap *map, const sps_tmap_light *light, const sps_tmap_settings *settings) {
    map->light = -1;
    map->settings = spsi_settings_resolve(settings, 0);
    map->technique = &spsi_techniques[map->settings.technique];
    map->view.width = light->width;
    map->view.height = light->height;
    map->view.camera = light->camera;
    map->view.camera.world_to_clip = NULL;
    map->view.quality = light->quality;
    map->view.slab = light->slab;
    map->face_count = light->omnidirectional ? SPSI_CUBE_FACES : 1;
    if (light->camera.world_to_clip && map->face_count == 1) {
        memcpy(map->matrix, light->camera.world_to_clip, sizeof map->matrix);
        map->view.camera.world_to_clip = map->matrix;
    }
    map->per_depth = 1 / (settings->far_depth - settings->near_depth);
    if (spsi_tmap_aim(map) || spsi_tmap_resolve(map)) return map->context->result;
    return spsi_tmap_take_planes(map);
}

/* Appends structs to those already added to a map. */
static sps_result spsi_tmap_append(sps_tmap *map, spsi_buffer *buffer, int *held, const void *more, int count,
                                   size_t size) {
    const size_t kept = (size_t)*held, all = kept + (size_t)count;
    if (count == 0) return SPS_OK;
    if (count > INT32_MAX - *held)
        return spsi_fail_field(map->context, SPS_ERROR_ARGUMENT, SPS_OBJECT_SCENE, -1, "number of structs", (double)all,
                               "2^31 - 1 of a kind can be added");
    if (!spsi_buffer_extend(map->context, buffer, kept, all, size)) return map->context->result;
    memcpy((char *)buffer->data + kept * size, more, (size_t)count * size);
    *held += count;
    return SPS_OK;
}

/* Adds all of a scene or nothing, so that a failed call can be repeated. */
static sps_result spsi_tmap_add(sps_tmap *map, const sps_scene *scene) {
    const int volumes = map->added.volume_count, meshes = map->added.mesh_count;
    if (spsi_check_scene(map->context, scene)) return map->context->result;
    if (spsi_tmap_append(map, &map->added.volumes, &map->added.volume_count, scene->volumes, scene->volume_count,
                         sizeof(sps_volume)) ||
        spsi_tmap_append(map, &map->added.meshes, &map->added.mesh_count, scene->meshes, scene->mesh_count,
                         sizeof(sps_mesh)) ||
        spsi_tmap_append(map, &map->added.particles, &map->added.particle_set_count, scene->particles,
                         scene->particle_set_count, sizeof(sps_particles))) {
        map->added.volume_count = volumes;
        map->added.mesh_count = meshes;
        return map->context->result;
    }
    map->replace_invalid |= scene->replace_invalid;
    return SPS_OK;
}

/* Releases what a map holds. */
static void spsi_tmap_release(sps_tmap *map) {
    spsi_buffer_release(map->context, &map->planes);
    spsi_buffer_release(map->context, &map->data.texels);
    spsi_buffer_release(map->context, &map->data.starts);
    spsi_buffer_release(map->context, &map->data.table);
    spsi_buffer_release(map->context, &map->data.surfaces);
    spsi_buffer_release(map->context, &map->data.prints);
    spsi_buffer_release(map->context, &map->past);
}

/* Releases the occluders that were added, once they have been read. */
static void spsi_tmap_forget(sps_tmap *map) {
    spsi_buffer_release(map->context, &map->added.volumes);
    spsi_buffer_release(map->context, &map->added.meshes);
    spsi_buffer_release(map->context, &map->added.particles);
    map->added.volume_count = map->added.mesh_count = map->added.particle_set_count = 0;
}

/* Builds the frame of all that was added, as the light's first face sees it; NULL if that fails. */
static spsi_frame *spsi_tmap_frame(sps_tmap *map) {
    spsi_frame *frame;
    sps_scene scene;
    memset(&scene, 0, sizeof scene);
    scene.volumes = (const sps_volume *)map->added.volumes.data;
    scene.volume_count = map->added.volume_count;
    scene.meshes = (const sps_mesh *)map->added.meshes.data;
    scene.mesh_count = map->added.mesh_count;
    scene.particles = (const sps_particles *)map->added.particles.data;
    scene.particle_set_count = map->added.particle_set_count;
    scene.replace_invalid = map->replace_invalid;
    frame = spsi_frame_build(map->context, &scene, NULL, 0);
    if (!frame) return NULL;
    frame->view = map->view;
    frame->has_matrix = map->view.camera.world_to_clip != NULL;
    frame->viewer = SPS_OBJECT_TMAP_LIGHT;
    frame->content->eye = map->rays[0];
    spsi_resolve_quality(frame);
    return frame;
}

/* Whether the box around all voxels reaches beyond a map's depth range. */
static int spsi_voxels_outside(const sps_tmap *map, const spsi_bounds *bounds) {
    const double near_depth = map->settings.near_depth, room = SPSI_OUTSIDE / map->per_depth;
    for (int corner = 0; corner < 8 && !spsi_bounds_empty(bounds); ++corner) {
        double point[3], q[3], t = 0;
        spsi_bounds_corner(bounds, corner, point);
        spsi_project(&map->rays[0], point, q);
        for (int i = 0; i < 3 && map->face_count > 1; ++i) t = fmax(t, fabs(point[i] - map->rays[0].origin[i]));
        if (map->face_count == 1) t = q[2];
        if (t > map->settings.far_depth + room) return 1;
        if (t < near_depth - room && !(map->rays[0].perspective && !(t > 0))) return 1;
    }
    return 0;
}

/* Tells message_fn of gas that lies beyond the map's depth range and so counts at its ends. */
static void spsi_tmap_tell_outside(const sps_tmap *map, const spsi_frame *frame) {
    const sps_context *context = map->context;
    const double particles = (double)context->stats.particles_outside;
    const int voxels = frame->medium_count > 0 && spsi_voxels_outside(map, &frame->content->bounds);
    char counted[40] = "", text[160];
    if (!context->config.message_fn || (!(particles > 0) && !voxels)) return;
    if (particles > 0) SPS_SNPRINTF(counted, sizeof counted, "%.0f of the particles%s", particles, voxels ? ", " : "");
    SPS_SNPRINTF(text, sizeof text, "tmap: gas beyond near_depth %g or far_depth %g counts there: %s%s",
                 map->settings.near_depth, map->settings.far_depth, counted, voxels ? "the box about all voxels" : "");
    context->config.message_fn(context->config.message_user, text);
}

/* Tells message_fn if the light is inside the gas, since its single view covers only what lies in front of it. */
static void spsi_tmap_tell_amid(const sps_tmap *map, const spsi_frame *frame) {
    const sps_config *config = &map->context->config;
    const spsi_rays *rays = &map->rays[0];
    if (!config->message_fn || map->face_count > 1 || !rays->perspective) return;
    if (spsi_bounds_empty(&frame->content->bounds) || !spsi_bounds_hold(&frame->content->bounds, rays->origin)) return;
    config->message_fn(config->message_user, "tmap: the light is amid the gas, and what its view leaves out counts as "
                                             "lit; light.omnidirectional is for a light that shines all round");
}

/* Reads all that was added, and fills the map with it. */
static sps_result spsi_tmap_finish(sps_tmap *map) {
    sps_context *context = map->context;
    spsi_occluders occluders;
    spsi_frame *frame = spsi_tmap_frame(map);
    memset(&occluders, 0, sizeof occluders);
    if (!frame) return context->result;
    /* voxels last, since slabs are cut from their bounds alone: particles need none */
    if (spsi_gather_particles(context, frame) || spsi_gather(context, frame) ||
        spsi_gather_faces(context, frame, &occluders.faces))
        return context->result;
    occluders.frame = frame;
    occluders.part.progress = SPSI_PROGRESS_GATHER;
    occluders.part.share = 1 - SPSI_PROGRESS_GATHER;
    if (spsi_tmap_fill(map, &occluders)) return context->result;
    spsi_tmap_tell_outside(map, frame);
    spsi_tmap_tell_amid(map, frame);
    return SPS_OK;
}

/* --- a light's own map --- */

/* Fits the depth range, along a face's axis, to all gas. */
static void spsi_tmap_fit_range(sps_tmap *map, const spsi_bounds *bounds) {
    sps_tmap_settings *settings = &map->settings;
    double low = HUGE_VAL, high = 0, room;
    for (int corner = 0; corner < 8; ++corner) {
        double point[3], q[3];
        spsi_bounds_corner(bounds, corner, point);
        if (map->face_count > 1) {
            for (int i = 0; i < 3; ++i) high = fmax(high, fabs(point[i] - map->rays[0].origin[i]));
            low = 0;
            continue;
        }
        spsi_project(&map->rays[0], point, q);
        low = fmin(low, q[2]);
        high = corner > 0 ? fmax(high, q[2]) : q[2];
    }
    /* gas so far away that it looks like a point still lies between two depths */
    high = fmax(high, low + fmax(1e-12 * fabs(low), DBL_MIN / DBL_EPSILON));
    room = settings->technique == SPS_TMAP_FOURIER && !map->has_range ? SPSI_GUARD_BAND * (high - low) : 0;
    settings->near_depth = map->rays[0].perspective ? fmax(low - room, 0) : low - room;
    settings->far_depth = high + room;
    map->per_depth = 1 / (settings->far_depth - settings->near_depth);
    for (int face = 0; face < map->face_count; ++face) map->rays[face].depth_reference = settings->near_depth;
}

/* The steps of a shadow table that stand for an optical depth. */
static uint32_t spsi_shadow_table_steps(float depth) {
    return (uint32_t)(spsi_higher(0, depth < SPSI_SHADOW_TABLE_DEPTH ? depth : SPSI_SHADOW_TABLE_DEPTH) *
                          (SPSI_SHADOW_TABLE_MOST / SPSI_SHADOW_TABLE_DEPTH) +
                      0.5f);
}

/* Whether a texel of a table was filled; `y` counts rows of all faces. */
static int spsi_shadow_table_is_new(const sps_tmap *map, int x, int y) {
    const int height = map->rays[0].height, in_face = y % height;
    const spsi_tile_prints *prints = spsi_tmap_prints(map, y / height, in_face / SPSI_TILE_HEIGHT, x / SPSI_TILE_WIDTH);
    x %= SPSI_TILE_WIDTH;
    return !prints || (prints->open & spsi_patch_box(x, in_face % SPSI_TILE_HEIGHT, x, in_face % SPSI_TILE_HEIGHT));
}

/* Fills a row of a table's blocks. What lies beyond the last row or column repeats the last: it is never looked up. */
static void spsi_shadow_table_task(void *data, int row, int worker) {
    const sps_tmap *map = (const sps_tmap *)data;
    const int planes = map->settings.components, width = map->rays[0].width;
    const int height = map->rays[0].height * map->face_count, columns = spsi_shadow_table_columns(map);
    uint32_t *to =
        (uint32_t *)map->data.table.data + (size_t)row * (size_t)columns * (size_t)planes * SPSI_SHADOW_TABLE_TEXELS;
    (void)worker;
    for (int column = 0; column < columns; ++column, to += (size_t)planes * SPSI_SHADOW_TABLE_TEXELS)
        for (int i = 0; i < SPSI_SHADOW_TABLE_TEXELS; ++i) {
            const int x = spsi_least(column * SPSI_SHADOW_TABLE_SIDE + i % SPSI_SHADOW_TABLE_SIDE, width - 1);
            const int y = spsi_least(row * SPSI_SHADOW_TABLE_SIDE + i / SPSI_SHADOW_TABLE_SIDE, height - 1);
            const size_t texel = (size_t)y * (size_t)width + (size_t)x;
            const float *from = (const float *)map->data.texels.data + texel * (size_t)planes;
            uint32_t before = 0;
            const int count = spsi_shadow_table_is_new(map, x, y) ? planes : 0;
            for (int k = 0; k < count; ++k) {
                const uint32_t next = spsi_shadow_table_steps(from[k]);
                to[k * SPSI_SHADOW_TABLE_TEXELS + i] = before | next << 16;
                before = next;
            }
        }
}

/* Turns an opacity map's texels into a table, or into the new part of one, and releases them. */
static sps_result spsi_shadow_table_build(sps_tmap *map) {
    const size_t blocks = (size_t)spsi_shadow_table_columns(map) * (size_t)spsi_shadow_table_rows(map);
    const size_t planes = (size_t)map->settings.components;
    map->data.table = map->past;
    memset(&map->past, 0, sizeof map->past);
    if (!spsi_buffer_reserve(map->context, &map->data.table, blocks * planes,
                             SPSI_SHADOW_TABLE_TEXELS * sizeof(uint32_t)))
        return map->context->result;
    spsi_parallel(map->context, spsi_shadow_table_rows(map), spsi_shadow_table_task, map);
    spsi_buffer_release(map->context, &map->data.texels);
    map->context->stats.tables_made += 1;
    spsi_shadow_table_count(map, 0);
    return SPS_OK;
}

/* A hash of the gas that a map shows; 0 if it may be another in the next call. */
static uint64_t spsi_gas_fingerprint(const spsi_frame *frame) {
    uint64_t hash = spsi_volumes_fingerprint(frame);
    for (int i = 0; i < frame->medium_count && hash; ++i)
        hash = spsi_fingerprint_word(hash, spsi_medium_fingerprint(frame, i));
    for (int i = 0; i < frame->particles.set_count && hash; ++i) {
        hash = spsi_set_fingerprint(hash, &frame->particles.sets[i]);
        hash = spsi_fingerprint(hash, &frame->content->set_ends[i], sizeof(int));
    }
    if (hash && frame->content->particle_count > 0)
        hash = spsi_fingerprint(hash, frame->content->particles,
                                (size_t)frame->content->particle_count * sizeof *frame->content->particles);
    return hash;
}

/* A hash of a table's rays and planes. */
static uint64_t spsi_shadow_table_aim(const sps_tmap *map) {
    const double range[] = {map->settings.near_depth, map->settings.far_depth};
    uint64_t hash = spsi_fingerprint(SPSI_FINGERPRINT_START, range, sizeof range);
    hash = spsi_fingerprint(hash, &map->settings.components, sizeof map->settings.components);
    for (int face = 0; face < map->face_count; ++face) {
        const spsi_rays *rays = &map->rays[face];
        const int shape[] = {rays->width, rays->height, rays->perspective};
        const double *const vectors[] = {rays->a, rays->b, rays->c, rays->origin};
        hash = spsi_fingerprint(hash, shape, sizeof shape);
        for (int i = 0; i < 4; ++i) hash = spsi_fingerprint(hash, vectors[i], 3 * sizeof(double));
    }
    return hash;
}

/* A hash of all that a table is made from, given that of the gas; 0 if the gas has none. */
static uint64_t spsi_shadow_table_key(const spsi_frame *frame, uint64_t aim, uint64_t gas) {
    const double knobs[] = {frame->view.slab, frame->accuracy.cut};
    return gas ? spsi_fingerprint_word(spsi_fingerprint(gas, knobs, sizeof knobs), aim) | 1 : 0;
}

/* Moves a table that is held and has the map's rays into the map: as its own or, if the gas is another, to be brought
   up to date. All tables that are held show the same gas. */
static void spsi_shadow_table_take(sps_context *context, sps_tmap *map) {
    sps_tmap *held = (sps_tmap *)context->buffers[SPSI_BUFFER_SHADOW_TABLES].data;
    int i = 0;
    while (i < context->shadow_table_count && !(held[i].data.table.data && held[i].aim == map->aim)) ++i;
    if (i == context->shadow_table_count || !map->key) return;
    map->finished = held[i].key == map->key;
    *(map->finished ? &map->data.table : &map->past) = held[i].data.table;
    map->data.prints = held[i].data.prints;
    memset(&held[i], 0, sizeof held[i]);
    held[i].context = context;
    if (!map->finished) return;
    context->stats.tables_held += 1;
    spsi_shadow_table_count(map, 1);
}

/* Releases all shadow tables that are held. */
static void spsi_shadow_tables_drop(sps_context *context) {
    sps_tmap *held = (sps_tmap *)context->buffers[SPSI_BUFFER_SHADOW_TABLES].data;
    for (int i = 0; i < context->shadow_table_count; ++i) spsi_tmap_release(&held[i]);
    context->shadow_table_count = 0;
}

/* Releases a map, or, unless the call has failed, holds its table for the next one, where there is room for the tables
   of all maps. */
static void spsi_shadow_table_hold(sps_context *context, sps_tmap *map) {
    sps_tmap *held = (sps_tmap *)context->buffers[SPSI_BUFFER_SHADOW_TABLES].data;
    if (!context->result && map->key && map->data.table.data)
        held[context->shadow_table_count++] = *map;
    else
        spsi_tmap_release(map);
}

/* Aims the map by which gas casts a light's shadow. */
static sps_result spsi_lamp_tmap_aim(sps_context *context, const spsi_frame *frame, const spsi_lamp *lamp,
                                     sps_tmap *map) {
    memset(map, 0, sizeof *map);
    map->context = context;
    map->light = lamp->index;
    map->settings = lamp->map;
    map->technique = &spsi_techniques[map->settings.technique];
    map->face_count = spsi_lamp_rays(frame, lamp, map->rays);
    if (map->face_count == 0)
        return spsi_fail_that(context, SPS_ERROR_UNSUPPORTED, SPS_OBJECT_LIGHT, map->light, "shadow_map", 0,
                              SPSI_TEXELS_ALIKE);
    map->has_range = spsi_settings_have_range(&map->settings);
    spsi_tmap_fit_range(map, &frame->content->bounds);
    return spsi_tmap_resolve(map);
}

/* Begins that map: takes its table, or one to start from, if it is held. `gas` is the fingerprint of the gas. */
static sps_result spsi_lamp_tmap_begin(sps_context *context, const spsi_frame *frame, const spsi_lamp *lamp,
                                       uint64_t gas, sps_tmap *map) {
    if (spsi_lamp_tmap_aim(context, frame, lamp, map)) return context->result;
    if (!spsi_has_shadow_table(lamp)) return SPS_OK;
    if (spsi_shadow_table_blocks(map) * map->settings.components > SPSI_SHADOW_TABLE_BLOCKS_MOST)
        return spsi_fail_setting(context, SPS_ERROR_MEMORY, map->light, "components", map->settings.components,
                                 "a table of this size would have more than 2^28 entries");
    map->aim = spsi_shadow_table_aim(map);
    map->key = spsi_shadow_table_key(frame, map->aim, gas);
    spsi_shadow_table_take(context, map);
    return SPS_OK;
}

/* Fills it, unless it was held. */
static sps_result spsi_lamp_tmap_fill(sps_context *context, const spsi_frame *frame, const spsi_lamp *lamp,
                                      const spsi_part_of_call *part, sps_tmap *map) {
    spsi_occluders occluders;
    memset(&occluders, 0, sizeof occluders);
    occluders.frame = frame;
    occluders.part = *part;
    if (map->finished) return SPS_OK;
    if (spsi_tmap_fill(map, &occluders)) return context->result;
    return spsi_has_shadow_table(lamp) ? spsi_shadow_table_build(map) : SPS_OK;
}

/* --- its size, before anything is read --- */

/* Maximum size of a light's transmittance map: texels of all faces, and of the longer side. Particles have not been
   read. A light amid the volumes' boxes may turn out to be in front of what they hold: a single face then, of up to
   2 tan 78 degrees times its distance, which is up to sqrt(3) times as long as along an axis. */
static size_t spsi_lamp_tmap_texels(const spsi_frame *frame, const spsi_lamp *lamp, size_t *side) {
    spsi_rays rays[SPSI_CUBE_FACES];
    const size_t most = (size_t)(lamp->map_size > 0 ? lamp->map_size : spsi_map_texels_most(frame, lamp));
    const int known = frame->particles.set_count == 0;
    const int faces = known ? spsi_lamp_rays(frame, lamp, rays) : 0;
    size_t six;
    *side = most;
    if (faces == 1) {
        *side = (size_t)spsi_most(rays[0].width, rays[0].height);
        return spsi_ray_count(&rays[0]);
    }
    if (faces == 0) return most * most * (lamp->is_point ? SPSI_CUBE_FACES : 1);
    six = SPSI_CUBE_FACES * spsi_ray_count(&rays[0]);
    if (lamp->map_omnidirectional) {
        *side = (size_t)rays[0].width;
        return six;
    }
    if (9 * (size_t)rays[0].width < most) *side = 9 * (size_t)rays[0].width;
    return *side * *side > six ? *side * *side : six;
}

/* Maximum number of components. A table's planes are a texel apart in the middle of its depths. */
static size_t spsi_lamp_tmap_components(const spsi_frame *frame, const spsi_lamp *lamp) {
    const int most = spsi_techniques[SPS_TMAP_TABLE].usual;
    double across[3], planes;
    if (!spsi_has_shadow_table(lamp) || lamp->map.components > 0) return (size_t)spsi_components_of(&lamp->map);
    if (frame->particles.set_count > 0) return (size_t)most;
    spsi_along(frame->content->bounds.high, frame->content->bounds.low, -1, across);
    planes = ceil(2 * spsi_length(across) / spsi_lamp_texel(frame, lamp)) + spsi_techniques[SPS_TMAP_TABLE].least;
    return (size_t)fmin(planes, most);
}

/* Bytes of a light's transmittance map, and those needed to fill it, except for lists of intervals, whose length is not
   known, and what is fitted to them. A light's map holds no surfaces. */
static void spsi_lamp_tmap_bytes(const spsi_frame *frame, const spsi_lamp *lamp, size_t *held, size_t *filling) {
    size_t side;
    const size_t texels = spsi_lamp_tmap_texels(frame, lamp, &side);
    const size_t tiles = (side + SPSI_TILE_WIDTH - 1) / SPSI_TILE_WIDTH;
    const size_t components = spsi_lamp_tmap_components(frame, lamp);
    if (spsi_techniques[lamp->map.technique].lists)
        *held = sizeof(sps_tmap) + (texels + 1) * sizeof(uint32_t);
    else
        *held = sizeof(sps_tmap) + (texels + 1) * components * sizeof(float); /* one more for the planes */
    if (spsi_has_shadow_table(lamp)) /* also fingerprints, the map that holds it, and blocks beyond two edges */
        *held += SPSI_CUBE_FACES * tiles * tiles * sizeof(spsi_tile_prints) + sizeof(sps_tmap) +
                 SPSI_CUBE_FACES * SPSI_SHADOW_TABLE_SIDE * (side + 16) * components * sizeof(float);
    *filling = sizeof(spsi_map_volumes) + (components + 2) * (side + tiles) * SPSI_TILE_HEIGHT * sizeof(float);
    *filling += (components + 2) * tiles * SPSI_LANES * sizeof(float);
    *filling += frame->particles.count * (sizeof(spsi_ball) + SPSI_BALL_TILES * sizeof(uint32_t));
    if (!spsi_techniques[lamp->map.technique].sums) *filling += spsi_balls_order_bytes(frame->particles.count);
    *filling += (tiles * tiles * (1 + SPSI_BALL_TILES) + 2) * sizeof(uint32_t);
    if (spsi_has_shadow_table(lamp))
        *filling += (texels + 1) * components * sizeof(float); /* before they become a table */
}

/* ============================================================================================ >>penumbrae
   24 Gas between an extended light and its sheets' planes. The light is K points, whose rays share the sheets: gas is
   splatted once, along the rays of the light's centre, and only optical depth is kept K times, in texels that travel
   with each point's rays. Slabs are parallel, so a point's texel u and the centre's texel x meet on a plane where
       x = (u + d L) / (1 + d_t L),    L linear in u
   with d the offset from centre to point in the centre's texels. For a directional light L is the number of slabs so
   far, d the shift per slab, and a row of texels has one fraction. Optical depth is never resampled, so no blur builds
   up, and occluders one behind the other are right. Planes hold -log of the mean transmittance.
       A_s(u) += sheet_k(x at k + 1/2),    V_k(x) = mean over s of exp(-A_s(u at k))
   Polygons stop a point's rays at the plane where they are. Cost: 3 bicubic lookups and an exponential per point, slab
   and texel that has gas, 4 with polygons; 4 bytes per point and texel, 8 with polygons. */

/* A rectangle of texels. */
typedef struct spsi_area {
    int x0, y0, x1, y1; /* first and last */
} spsi_area;

static spsi_area spsi_area_meet(spsi_area a, spsi_area b) {
    a.x0 = spsi_most(a.x0, b.x0), a.y0 = spsi_most(a.y0, b.y0);
    a.x1 = spsi_least(a.x1, b.x1), a.y1 = spsi_least(a.y1, b.y1);
    return a;
}

static spsi_area spsi_area_join(spsi_area a, spsi_area b) {
    a.x0 = spsi_least(a.x0, b.x0), a.y0 = spsi_least(a.y0, b.y0);
    a.x1 = spsi_most(a.x1, b.x1), a.y1 = spsi_most(a.y1, b.y1);
    return a;
}

static spsi_area spsi_area_none(void) {
    const spsi_area none = {0x7fffffff, 0x7fffffff, -0x7fffffff, -0x7fffffff};
    return none;
}

static int spsi_area_empty(spsi_area a) { return a.x0 > a.x1 || a.y0 > a.y1; }

#define SPSI_SLIDE_LEAST 0.1 /* minimum of 1 + d_t L where there is gas; elsewhere it is clamped */

/* Texels on a plane as seen from another grid of rays: (x + d L) / (1 + d_t L), L = l . (1, x, y). */
typedef struct spsi_slide {
    float l[3], d[3];
    int even; /* 1: all texels move by the same */
} spsi_slide;

/* Light from one point: its rays, and how much gas they have crossed. */
typedef struct spsi_beam {
    spsi_rays rays;
    int x0, y0;      /* the centre's texel at its texel (0, 0), on the first plane of a directional light */
    double shift[3]; /* d */
    spsi_linear slab;
    float *depth;      /* optical depth so far, per texel */
    float *stop;       /* slab coordinate of the first polygon; NULL: there are none */
    spsi_area crossed; /* texels that may have crossed gas or polygons, as those of the centre */
} spsi_beam;

typedef struct spsi_penumbra {
    const spsi_rays *rays;   /* of the light's centre */
    const spsi_slabs *slabs; /* of the sheets */
    int tiles_x, tiles_y;
    spsi_beam *beams;
    int beam_count;
    int first_slab; /* of the chunk that the sheets hold */
    int pending;    /* 1: the beams have not yet crossed these sheets */
    float *sheets;  /* mean extinction per slab, SPSI_CHUNK sheets of the rays' texels */
    uint64_t *held; /* per tile, bits: patches whose sheets hold something */
    float *scratch; /* per worker */
    size_t scratch_floats;
} spsi_penumbra;

/* The same as spsi_bilinear for one point. */
static double spsi_bilinear_at(const float *grid, int width, int height, double x, double y) {
    const double cx = x > 0 ? fmin(x, width - 1) : 0, cy = y > 0 ? fmin(y, height - 1) : 0;
    const int ix = spsi_least((int)cx, width - 2), iy = spsi_least((int)cy, height - 2);
    const float *quad = grid + (size_t)iy * (size_t)width + (size_t)ix, *next = quad + width;
    const double fx = cx - ix, fy = cy - iy;
    const double above = (double)quad[0] + fx * ((double)quad[1] - (double)quad[0]);
    return above + fy * ((double)next[0] + fx * ((double)next[1] - (double)next[0]) - above);
}

/* The same, but 0 beyond the grid. */
static double spsi_bilinear_inside(const float *grid, int width, int height, double x, double y) {
    return x > 0 && y > 0 && x < width - 1 && y < height - 1 ? spsi_bilinear_at(grid, width, height, x, y) : 0;
}

/* Weights of a cubic through four values, `t` of the way from the second to the third. [Catmull & Rom 1974] */
static inline void spsi_cubic_weights(spsi_v t, spsi_v weights[4]) {
    const spsi_v one = spsi_set(1), u = spsi_sub(one, t), tt = spsi_mul(t, t), uu = spsi_mul(u, u);
    weights[0] = spsi_mul(spsi_mul(spsi_set(-0.5f), t), uu);
    weights[1] = spsi_fma(tt, spsi_fma(spsi_set(1.5f), t, spsi_set(-2.5f)), one);
    weights[2] = spsi_fma(uu, spsi_fma(spsi_set(1.5f), u, spsi_set(-2.5f)), one);
    weights[3] = spsi_mul(spsi_mul(spsi_set(-0.5f), u), tt);
}

/* Texels of floats. Lookups within two texels of their border find 0: what is looked up is farther inside. */
typedef struct spsi_texel_grid {
    const float *values;
    int x0, y0, width, height;
} spsi_texel_grid;

static void spsi_slide_at(const spsi_slide *slide, double x, double y, double at[2]) {
    const double l = (double)slide->l[0] + x * (double)slide->l[1] + y * (double)slide->l[2];
    const double per = 1 / fmax(1 + (double)slide->d[2] * l, SPSI_SLIDE_LEAST);
    at[0] = (x + (double)slide->d[0] * l) * per;
    at[1] = (y + (double)slide->d[1] * l) * per;
}

/* From a beam's texels to the centre's on the plane at a slab coordinate (sign 1), or back (sign -1). */
static void spsi_slide_build(const spsi_penumbra *penumbra, const spsi_beam *beam, double slab, int sign,
                             spsi_slide *slide) {
    const spsi_rays *rays = penumbra->rays;
    const double *normal = penumbra->slabs->normal, *from = sign > 0 ? beam->rays.origin : rays->origin;
    memset(slide, 0, sizeof *slide);
    for (int i = 0; i < 3; ++i) slide->d[i] = (float)(sign * beam->shift[i]);
    slide->l[0] = (float)slab;
    if (rays->perspective) {
        const double way = penumbra->slabs->start + slab * penumbra->slabs->thickness - spsi_dot(normal, from);
        slide->l[0] = (float)(spsi_dot(normal, rays->c) / way);
        slide->l[1] = (float)(spsi_dot(normal, rays->a) / way);
        slide->l[2] = (float)(spsi_dot(normal, rays->b) / way);
    }
    slide->even = !rays->perspective;
}

/* Bounds of a rectangle of texels on the planes from `low` to `high`, as texels of the other side, with two to spare.
 */
static spsi_area spsi_slide_area(const spsi_penumbra *penumbra, const spsi_beam *beam, double low, double high,
                                 int sign, spsi_area area) {
    spsi_area out = spsi_area_none();
    for (int corner = 0; corner < 8; ++corner) {
        spsi_slide slide;
        double at[2];
        spsi_slide_build(penumbra, beam, corner & 4 ? high : low, sign, &slide);
        spsi_slide_at(&slide, corner & 1 ? area.x1 : area.x0, corner & 2 ? area.y1 : area.y0, at);
        for (int i = 0; i < 2; ++i) at[i] = fmin(fmax(at[i], -1e6), 1e6); /* far beyond any texel */
        out.x0 = spsi_least(out.x0, (int)floor(at[0]) - 2), out.x1 = spsi_most(out.x1, (int)ceil(at[0]) + 2);
        out.y0 = spsi_least(out.y0, (int)floor(at[1]) - 2), out.y1 = spsi_most(out.y1, (int)ceil(at[1]) + 2);
    }
    return out;
}

/* --- a row of texels as another grid sees it --- */

/* Lookups are cubic: linear ones would blur every sheet by up to a quarter of a squared texel, half as much again as
   its kernels. */

#define SPSI_ROW_PART 64 /* texels of a row that are weighted at a time */

/* Texels x0 .. x0 + count - 1 of row y, to each of which `scale` times what it finds in a grid is added. */
typedef struct spsi_texel_row {
    int x0, y, count;
    const float *scale; /* per texel; NULL: 1 */
    float *out;         /* per texel */
} spsi_texel_row;

/* Adds what a row finds where all of it moves by the same: four rows of the grid are weighted once, then four
   columns. */
static void spsi_row_add_even(const spsi_texel_grid *grid, const spsi_slide *slide, const spsi_texel_row *to) {
    const float move_x = slide->d[0] * slide->l[0], move_y = slide->d[1] * slide->l[0];
    const int row = to->y + (int)floorf(move_y) - grid->y0 - 1, column = to->x0 + (int)floorf(move_x) - grid->x0 - 1;
    const int first = spsi_most(0, -column), end = spsi_least(to->count, grid->width - 3 - column);
    spsi_v across[4], down[4];
    if (row < 0 || row + 3 >= grid->height || first >= end) return;
    spsi_cubic_weights(spsi_set(move_x - floorf(move_x)), across);
    spsi_cubic_weights(spsi_set(move_y - floorf(move_y)), down);
    for (int start = first; start < end; start += SPSI_ROW_PART) {
        const int part = spsi_least(SPSI_ROW_PART, end - start);
        const float *from = grid->values + (size_t)row * (size_t)grid->width + (size_t)(column + start);
        float weighted[SPSI_ROW_PART + 3 + SPSI_LANES]; /* filters reach three texels farther */
        for (int i = 0; i < part + 3; i += SPSI_LANES) {
            const int some = spsi_least(SPSI_LANES, part + 3 - i);
            spsi_v value = spsi_set(0);
            for (int r = 0; r < 4; ++r)
                value = spsi_fma(down[r], spsi_load_first(from + (size_t)r * (size_t)grid->width + i, some), value);
            spsi_store(weighted + i, value);
        }
        for (int i = 0; i < part; i += SPSI_LANES) {
            const int some = spsi_least(SPSI_LANES, part - i);
            spsi_v sum = spsi_mul(across[0], spsi_load(weighted + i));
            for (int c = 1; c < 4; ++c) sum = spsi_fma(across[c], spsi_load(weighted + i + c), sum);
            if (to->scale) sum = spsi_mul(sum, spsi_load_first(to->scale + start + i, some));
            spsi_store_first(to->out + start + i, spsi_add(sum, spsi_load_first(to->out + start + i, some)), some);
        }
    }
}

/* The cubic lookup of a vector of texels at any places; 0 where fewer than two texels are left to the border. */
static spsi_v spsi_grid_gather(const spsi_texel_grid *grid, spsi_v u, spsi_v v, spsi_m inside) {
    const spsi_v x = spsi_select(inside, u, spsi_set(1)), y = spsi_select(inside, v, spsi_set(1));
    const spsi_v ix = spsi_floor(x), iy = spsi_floor(y);
    spsi_v across[4], down[4], sum = spsi_set(0);
    spsi_cubic_weights(spsi_sub(x, ix), across);
    spsi_cubic_weights(spsi_sub(y, iy), down);
    for (int r = 0; r < 4; ++r) {
        spsi_v value = spsi_set(0);
        for (int c = 0; c < 4; ++c)
            value = spsi_fma(across[c],
                             spsi_lookup(grid->values + (r * grid->width + c), grid->width, spsi_sub(ix, spsi_set(1)),
                                         spsi_sub(iy, spsi_set(1))),
                             value);
        sum = spsi_fma(down[r], value, sum);
    }
    return spsi_select(inside, sum, spsi_set(0));
}

/* The same, where places differ by nearly one from lane to lane: then all lanes have the same texels, shifted by their
   number, and only weights differ, which may reach a quarter of a texel beyond their four. */
static spsi_v spsi_grid_lookup(const spsi_texel_grid *grid, spsi_v u, spsi_v v) {
    const spsi_v one = spsi_set(1), half = spsi_set(0.5f), at = spsi_sub(u, spsi_iota());
    const spsi_m inside = spsi_and(spsi_and(spsi_less(one, u), spsi_less(u, spsi_set((float)(grid->width - 2)))),
                                   spsi_and(spsi_less(one, v), spsi_less(v, spsi_set((float)(grid->height - 2)))));
    const size_t size = (size_t)grid->width * (size_t)grid->height;
    float lanes_u[SPSI_LANES], lanes_v[SPSI_LANES];
    int column, row;
    spsi_v tx, ty, across[4], down[4], sum = spsi_set(0);
    if (!spsi_bits(inside)) return sum;
    spsi_store(lanes_u, spsi_clamp(at, spsi_set(-1e6f), spsi_set(1e6f)));
    spsi_store(lanes_v, spsi_clamp(v, spsi_set(-1e6f), spsi_set(1e6f)));
    column = (int)floorf(lanes_u[SPSI_LANES / 2]) - 1, row = (int)floorf(lanes_v[SPSI_LANES / 2]) - 1;
    tx = spsi_sub(at, spsi_set((float)(column + 1)));
    ty = spsi_sub(v, spsi_set((float)(row + 1)));
    if (column < 0 || row < 0 || row + 4 > grid->height ||
        (size_t)(row + 3) * (size_t)grid->width + (size_t)column + SPSI_LANES + 3 > size ||
        spsi_bits(spsi_less(spsi_set(0.75f), spsi_max(spsi_abs(spsi_sub(tx, half)), spsi_abs(spsi_sub(ty, half))))))
        return spsi_grid_gather(grid, u, v, inside);
    spsi_cubic_weights(tx, across);
    spsi_cubic_weights(ty, down);
    for (int r = 0; r < 4; ++r) {
        const float *from = grid->values + (size_t)(row + r) * (size_t)grid->width + (size_t)column;
        spsi_v value = spsi_mul(across[0], spsi_load(from));
        for (int c = 1; c < 4; ++c) value = spsi_fma(across[c], spsi_load(from + c), value);
        sum = spsi_fma(down[r], value, sum);
    }
    return spsi_select(inside, sum, spsi_set(0));
}

/* As spsi_row_add_even, in general. */
static void spsi_row_add(const spsi_texel_grid *grid, const spsi_slide *slide, const spsi_texel_row *to) {
    const spsi_v one = spsi_set(1), fixed = spsi_set(slide->l[0] + (float)to->y * slide->l[2]);
    const spsi_v least = spsi_set((float)SPSI_SLIDE_LEAST);
    if (slide->even) {
        spsi_row_add_even(grid, slide, to);
        return;
    }
    for (int i = 0; i < to->count; i += SPSI_LANES) {
        const int some = spsi_least(SPSI_LANES, to->count - i);
        const spsi_v x = spsi_add(spsi_set((float)(to->x0 + i)), spsi_iota());
        const spsi_v l = spsi_fma(x, spsi_set(slide->l[1]), fixed);
        const spsi_v per = spsi_div(one, spsi_max(spsi_fma(l, spsi_set(slide->d[2]), one), least));
        const spsi_v u = spsi_sub(spsi_mul(spsi_fma(l, spsi_set(slide->d[0]), x), per), spsi_set((float)grid->x0));
        const spsi_v v = spsi_sub(spsi_mul(spsi_fma(l, spsi_set(slide->d[1]), spsi_set((float)to->y)), per),
                                  spsi_set((float)grid->y0));
        spsi_v value = spsi_grid_lookup(grid, u, v);
        if (to->scale) value = spsi_mul(value, spsi_load_first(to->scale + i, some));
        spsi_store_first(to->out + i, spsi_add(value, spsi_load_first(to->out + i, some)), some);
    }
}

/* Minus the logarithm of a transmittance, which is clamped to e^-SPSI_LIGHT_END: with z = x^(1/16) >= e^-1 and
   t = (z - 1) / (z + 1), ln z = 2 (t + t^3 / 3 + ..); after t^13, 16 times what is left is 2e-5. Exactly 0 at 1. */
static inline spsi_v spsi_minus_log(spsi_v x) {
    spsi_v z = spsi_max(x, spsi_set(1.1253517e-7f)), t, square, sum = spsi_set(1.0f / 13);
    for (int i = 0; i < 4; ++i) z = spsi_sqrt(z);
    t = spsi_div(spsi_sub(spsi_set(1), z), spsi_add(spsi_set(1), z));
    square = spsi_mul(t, t);
    for (int n = 11; n > 0; n -= 2) sum = spsi_fma(sum, square, spsi_set(1.0f / (float)n));
    return spsi_mul(spsi_mul(t, sum), spsi_set(32));
}

/* --- setting it up --- */

/* Maximum number of texels on a side of a beam, without its border, whose light's sheets have at most `side`: bounds a
   beam's memory where the gas looks far wider from a point of the light than from its centre. */
static int spsi_beam_texels_most(const spsi_frame *frame, int side) {
    return 2 * spsi_most(spsi_light_texels_most(frame), side);
}

/* Aims the rays of one point at the gas. They have the axes of the centre's; those of a directional light have the
   centre's texels where the slabs begin. Returns 0 if gas is beside or behind the point, or too far away. */
static int spsi_beam_aim(const spsi_frame *frame, const spsi_penumbra *penumbra, const spsi_lamp *point,
                         spsi_beam *beam) {
    const spsi_rays *rays = penumbra->rays;
    const spsi_slabs *slabs = penumbra->slabs;
    const int most = spsi_beam_texels_most(frame, spsi_most(rays->width, rays->height));
    double offset[3], low[2] = {HUGE_VAL, HUGE_VAL}, high[2] = {-HUGE_VAL, -HUGE_VAL}, *corner;
    beam->rays = *rays;
    if (rays->perspective) {
        spsi_along(point->position, rays->origin, -1, offset);
        spsi_to_rays(rays, offset, beam->shift);
        memcpy(beam->rays.origin, point->position, sizeof beam->rays.origin);
    } else {
        const double across = spsi_dot(slabs->normal, rays->c), own = spsi_dot(slabs->normal, point->direction);
        spsi_along(rays->origin, rays->c, (slabs->start - spsi_dot(slabs->normal, rays->origin)) / across,
                   beam->rays.origin);
        spsi_along(rays->a, rays->c, -spsi_dot(slabs->normal, rays->a) / across, beam->rays.a);
        spsi_along(rays->b, rays->c, -spsi_dot(slabs->normal, rays->b) / across, beam->rays.b);
        for (int i = 0; i < 3; ++i) offset[i] = slabs->thickness * (point->direction[i] / own - rays->c[i] / across);
        spsi_to_rays(rays, offset, beam->shift);
        beam->shift[2] = 0;
        memcpy(beam->rays.c, point->direction, sizeof beam->rays.c);
        beam->rays.depth_reference = 0;
    }
    if (!spsi_rays_complete(&beam->rays)) return 0;
    for (int n = 0; n < 8; ++n) {
        double at[3], q[3], middle[3];
        spsi_bounds_corner(&frame->content->bounds, n, at);
        spsi_project(&beam->rays, at, q);
        spsi_project(rays, at, middle);
        if (rays->perspective && !(q[2] >= SPSI_SLIDE_LEAST * middle[2])) return 0;
        for (int k = 0; k < 2; ++k) low[k] = fmin(low[k], q[k]), high[k] = fmax(high[k], q[k]);
    }
    for (int k = 0; k < 2; ++k)
        if (!(high[k] - low[k] < most) || !(fabs(low[k]) < 1e6)) return 0;
    beam->x0 = (int)floor(low[0]) - 2, beam->y0 = (int)floor(low[1]) - 2;
    beam->rays.width = (int)ceil(high[0]) + 2 - beam->x0 + 1;
    beam->rays.height = (int)ceil(high[1]) + 2 - beam->y0 + 1;
    corner = rays->perspective ? beam->rays.c : beam->rays.origin;
    spsi_along(corner, beam->rays.a, beam->x0, corner);
    spsi_along(corner, beam->rays.b, beam->y0, corner);
    if (!spsi_rays_complete(&beam->rays)) return 0;
    spsi_linear_of_slabs(&beam->rays, slabs, &beam->slab);
    return 1;
}

/* Finds the slab coordinate at which polygons stop each of a beam's rays. `numbers` is scratch memory. */
static void spsi_beam_stop(sps_context *context, const spsi_faces *faces, spsi_beam *beam, int *numbers) {
    const int width = beam->rays.width, height = beam->rays.height;
    spsi_area at;
    spsi_rasterise(context, faces, &beam->rays, NULL, beam->stop, numbers);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            float *stop = beam->stop + (size_t)y * (size_t)width + (size_t)x;
            const float base = beam->slab.base[0] + (float)x * beam->slab.base[1] + (float)y * beam->slab.base[2];
            const float slope = beam->slab.slope[0] + (float)x * beam->slab.slope[1] + (float)y * beam->slab.slope[2];
            if (!(*stop < SPSI_INFINITY)) continue;
            *stop = base + slope * *stop;
            at.x0 = at.x1 = beam->x0 + x, at.y0 = at.y1 = beam->y0 + y;
            beam->crossed = spsi_area_join(beam->crossed, at);
        }
}

/* Aims all beams of a sweep's light. */
static sps_result spsi_penumbra_aim(sps_context *context, const spsi_frame *frame, const spsi_sweep *sweep,
                                    spsi_penumbra *penumbra) {
    const spsi_lamp *lamp = sweep->lamp;
    memset(penumbra, 0, sizeof *penumbra);
    penumbra->rays = &sweep->rays;
    penumbra->slabs = &sweep->slabs;
    penumbra->tiles_x = spsi_tile_columns(&sweep->rays);
    penumbra->tiles_y = spsi_tile_rows(&sweep->rays);
    penumbra->beam_count = lamp->point_count;
    penumbra->beams =
        (spsi_beam *)spsi_reserve(context, SPSI_BUFFER_BEAMS, (size_t)lamp->point_count, sizeof(spsi_beam));
    if (!penumbra->beams) return context->result;
    for (int i = 0; i < lamp->point_count; ++i)
        if (!spsi_beam_aim(frame, penumbra, &lamp->points[i], &penumbra->beams[i]))
            return spsi_fail_that(context, SPS_ERROR_UNSUPPORTED, SPS_OBJECT_LIGHT, lamp->index, "", 0,
                                  "is so wide or so close that some of its points have gas beside or behind them; make "
                                  "it smaller, move it away, or set no_shadow on it");
    return SPS_OK;
}

/* What a penumbra is kept in, in floats. */
typedef struct spsi_penumbra_size {
    uint64_t beams;   /* texels of all beams, twice with polygons */
    uint64_t sheets;  /* of a chunk */
    uint64_t scratch; /* per worker */
    uint64_t held;    /* of the patches' bits */
} spsi_penumbra_size;

static spsi_penumbra_size spsi_penumbra_measure(const spsi_penumbra *penumbra, int has_polygons) {
    spsi_penumbra_size size = {0, 0, 0, 0};
    for (int i = 0; i < penumbra->beam_count; ++i) {
        const uint64_t texels = spsi_ray_count(&penumbra->beams[i].rays);
        size.beams += texels * (uint64_t)(1 + has_polygons);
        size.scratch = 3 * texels > size.scratch ? 3 * texels : size.scratch;
    }
    size.scratch += SPSI_LANES; /* lengths are stored in whole vectors */
    size.sheets = SPSI_CHUNK * (uint64_t)spsi_ray_count(penumbra->rays);
    size.held = 2 * (uint64_t)penumbra->tiles_x * (uint64_t)penumbra->tiles_y;
    return size;
}

/* At most what SIZE_MAX bytes hold, which cannot be reserved. */
static size_t spsi_penumbra_floats(const sps_context *context, const spsi_penumbra_size *size) {
    const uint64_t workers = (uint64_t)spsi_worker_count(context), most = SIZE_MAX / sizeof(float);
    const uint64_t floats = size->beams + size->sheets + workers * size->scratch + size->held;
    return (size_t)(floats < most ? floats : most);
}

/* Lays out the beams' texels, the sheets and the workers' scratch memory. */
static sps_result spsi_penumbra_reserve(sps_context *context, spsi_penumbra *penumbra, int has_polygons) {
    const spsi_penumbra_size size = spsi_penumbra_measure(penumbra, has_polygons);
    float *memory =
        (float *)spsi_reserve(context, SPSI_BUFFER_PENUMBRA, spsi_penumbra_floats(context, &size), sizeof(float));
    if (!memory) return context->result;
    penumbra->held = (uint64_t *)(void *)memory; /* first, as its alignment is the strictest */
    memory += size.held;
    memset(penumbra->held, 0, (size_t)(size.held + size.beams + size.sheets) * sizeof(float));
    for (int i = 0; i < penumbra->beam_count; ++i) {
        spsi_beam *beam = &penumbra->beams[i];
        const size_t texels = spsi_ray_count(&beam->rays);
        beam->depth = memory;
        beam->stop = has_polygons ? memory + texels : NULL;
        beam->crossed = spsi_area_none();
        memory += texels * (size_t)(1 + has_polygons);
    }
    penumbra->sheets = memory;
    penumbra->scratch = memory + size.sheets;
    penumbra->scratch_floats = (size_t)size.scratch;
    return SPS_OK;
}

static sps_result spsi_penumbra_begin(sps_context *context, const spsi_frame *frame, const spsi_sweep *sweep,
                                      const spsi_faces *faces, spsi_penumbra *penumbra) {
    const int has_polygons = faces->count > 0;
    if (spsi_penumbra_aim(context, frame, sweep, penumbra) || spsi_penumbra_reserve(context, penumbra, has_polygons))
        return context->result;
    for (int i = 0; i < penumbra->beam_count && has_polygons; ++i)
        spsi_beam_stop(context, faces, &penumbra->beams[i], (int *)(void *)penumbra->scratch);
    return SPS_OK;
}

/* --- from slab to slab --- */

/* Keeps a tile's sheets, as mean extinction. */
static void spsi_penumbra_keep(const spsi_penumbra *penumbra, const spsi_light_shader *shader, const spsi_tile *tile,
                               int index) {
    const int margin = (tile->slab_count - SPSI_CHUNK) / 2, width = penumbra->rays->width;
    const size_t texels = spsi_ray_count(penumbra->rays);
    uint64_t held = 0;
    for (int y = tile->y0; y <= tile->y1; ++y)
        for (int x = tile->x0; x <= tile->x1; x += SPSI_LANES) {
            const size_t to = (size_t)y * (size_t)width + (size_t)x;
            const size_t from = (size_t)((y - tile->y0) * tile->pitch + (x - tile->x0));
            const int count = spsi_least(SPSI_LANES, tile->x1 - x + 1);
            const spsi_row_slabs slabs = spsi_row_slabs_at(shader, x, y);
            const spsi_v per_length = spsi_div(slabs.count, slabs.length);
            spsi_v any = spsi_set(0);
            for (int k = 0; k < SPSI_CHUNK; ++k) {
                const spsi_v depth =
                    spsi_light_sheet(shader, tile, from + (size_t)(k + margin) * tile->sheet_size, &slabs);
                any = spsi_max(any, depth);
                spsi_store_first(penumbra->sheets + (size_t)k * texels + to, spsi_mul(depth, per_length), count);
            }
            if (spsi_bits(spsi_less(spsi_set(0), any)))
                held |= spsi_patch_box(x - tile->x0, y - tile->y0, x - tile->x0 + count - 1, y - tile->y0);
        }
    penumbra->held[index] = held;
}

/* Empties a tile's sheets. */
static void spsi_penumbra_clear(const spsi_penumbra *penumbra, int index) {
    const int x0 = index % penumbra->tiles_x * SPSI_TILE_WIDTH, y0 = index / penumbra->tiles_x * SPSI_TILE_HEIGHT;
    const int width = penumbra->rays->width, some = spsi_least(SPSI_TILE_WIDTH, width - x0);
    const size_t texels = spsi_ray_count(penumbra->rays);
    if (!penumbra->held[index]) return;
    penumbra->held[index] = 0;
    for (int k = 0; k < SPSI_CHUNK; ++k)
        for (int y = y0; y < spsi_least(penumbra->rays->height, y0 + SPSI_TILE_HEIGHT); ++y)
            memset(penumbra->sheets + (size_t)k * texels + (size_t)y * (size_t)width + (size_t)x0, 0,
                   (size_t)some * sizeof(float));
}

/* A beam's texels as far as they reach a tile of the planes within a chunk. */
typedef struct spsi_beam_part {
    const spsi_beam *beam;
    spsi_area area;
    int width, height;
    float *depth;   /* optical depth so far */
    float *stopped; /* share of light that polygons have stopped */
    float *lengths; /* world length per slab */
} spsi_beam_part;

static spsi_area spsi_beam_area(const spsi_beam *beam) {
    const spsi_area area = {beam->x0, beam->y0, beam->x0 + beam->rays.width - 1, beam->y0 + beam->rays.height - 1};
    return area;
}

static spsi_area spsi_tile_area(const spsi_penumbra *penumbra, int index) {
    const int x0 = index % penumbra->tiles_x * SPSI_TILE_WIDTH, y0 = index / penumbra->tiles_x * SPSI_TILE_HEIGHT;
    const spsi_area area = {x0, y0, spsi_least(penumbra->rays->width, x0 + SPSI_TILE_WIDTH) - 1,
                            spsi_least(penumbra->rays->height, y0 + SPSI_TILE_HEIGHT) - 1};
    return area;
}

/* Whether the sheets hold something in an area of the planes' texels. */
static int spsi_penumbra_holds(const spsi_penumbra *penumbra, spsi_area area) {
    const int x0 = spsi_most(area.x0, 0) / SPSI_TILE_WIDTH, y0 = spsi_most(area.y0, 0) / SPSI_TILE_HEIGHT;
    const int x1 = spsi_least(area.x1, penumbra->rays->width - 1), y1 = spsi_least(area.y1, penumbra->rays->height - 1);
    for (int y = y0; y * SPSI_TILE_HEIGHT <= y1; ++y)
        for (int x = x0; x * SPSI_TILE_WIDTH <= x1; ++x) {
            const int left = x * SPSI_TILE_WIDTH, top = y * SPSI_TILE_HEIGHT;
            if (penumbra->held[y * penumbra->tiles_x + x] &
                spsi_patch_box(area.x0 - left, area.y0 - top, area.x1 - left, area.y1 - top))
                return 1;
        }
    return 0;
}

/* The part of a tile of the planes that gas can look up: patches with gas within two texels, as far as a cubic lookup
   reaches. Elsewhere planes are not computed. */
typedef struct spsi_lookups {
    spsi_area bounds;
    spsi_area rows[SPSI_TILE_HEIGHT / SPSI_PATCH]; /* per row of patches */
} spsi_lookups;

static void spsi_lookups_find(const spsi_penumbra *penumbra, int index, spsi_lookups *lookups) {
    const spsi_area tile = spsi_tile_area(penumbra, index);
    lookups->bounds = spsi_area_none();
    for (int row = 0; row < SPSI_TILE_HEIGHT / SPSI_PATCH; ++row) {
        lookups->rows[row] = spsi_area_none();
        for (int column = 0; column < SPSI_TILE_WIDTH / SPSI_PATCH; ++column) {
            const int x = tile.x0 + column * SPSI_PATCH, y = tile.y0 + row * SPSI_PATCH;
            const spsi_area patch = {x, y, x + SPSI_PATCH - 1, y + SPSI_PATCH - 1};
            const spsi_area around = {x - 2, y - 2, x + SPSI_PATCH + 1, y + SPSI_PATCH + 1};
            const spsi_area inside = spsi_area_meet(patch, tile);
            if (!spsi_area_empty(inside) && spsi_penumbra_holds(penumbra, around))
                lookups->rows[row] = spsi_area_join(lookups->rows[row], inside);
        }
        lookups->bounds = spsi_area_join(lookups->bounds, lookups->rows[row]);
    }
}

/* World length per slab along a vector of a beam's rays. */
static void spsi_slab_lengths(const spsi_beam *beam, spsi_v x, float y, float lengths[SPSI_LANES]) {
    const spsi_v slabs = spsi_abs(spsi_linear_slope(&beam->slab, x, y));
    spsi_store(lengths, spsi_div(spsi_ray_lengths(&beam->rays, x, y), spsi_max(slabs, spsi_set(FLT_MIN * 16))));
}

/* The same along texels x0 .. x0 + count - 1 of a row; `lengths` has room for whole vectors. */
static void spsi_beam_lengths(const spsi_beam *beam, int x0, int y, int count, float *lengths) {
    for (int i = 0; i < count; i += SPSI_LANES)
        spsi_slab_lengths(beam, spsi_add(spsi_set((float)(x0 - beam->x0 + i)), spsi_iota()), (float)(y - beam->y0),
                          lengths + i);
}

/* Adds sheet k, as a row of a beam's texels crosses it, to their optical depth. */
static void spsi_beam_cross(const spsi_penumbra *penumbra, const spsi_slide *slide, int k, const spsi_texel_row *row) {
    const spsi_rays *rays = penumbra->rays;
    const spsi_texel_grid sheet = {penumbra->sheets + (size_t)k * spsi_ray_count(rays), 0, 0, rays->width,
                                   rays->height};
    spsi_row_add(&sheet, slide, row);
}

static void spsi_beam_part_load(const spsi_beam *beam, spsi_area area, float *memory, spsi_beam_part *part) {
    const size_t width = (size_t)beam->rays.width;
    size_t texels;
    part->beam = beam;
    part->area = area;
    part->width = area.x1 - area.x0 + 1;
    part->height = area.y1 - area.y0 + 1;
    texels = (size_t)part->width * (size_t)part->height;
    part->depth = memory;
    part->stopped = memory + texels;
    part->lengths = memory + 2 * texels;
    for (int y = 0; y < part->height; ++y) {
        const size_t from = (size_t)(area.y0 + y - beam->y0) * width + (size_t)(area.x0 - beam->x0);
        const size_t to = (size_t)y * (size_t)part->width;
        memcpy(part->depth + to, beam->depth + from, (size_t)part->width * sizeof(float));
        spsi_beam_lengths(beam, area.x0, area.y0 + y, part->width, part->lengths + to);
    }
}

/* The share of each texel's light that polygons have stopped before the plane at a slab coordinate, spread over the
   slab around it. */
static void spsi_beam_part_stop(const spsi_beam_part *part, float slab) {
    const spsi_beam *beam = part->beam;
    for (int y = 0; y < part->height; ++y) {
        const size_t own =
            (size_t)(part->area.y0 + y - beam->y0) * (size_t)beam->rays.width + (size_t)(part->area.x0 - beam->x0);
        float *stopped = part->stopped + (size_t)y * (size_t)part->width;
        for (int x = 0; x < part->width; ++x) {
            const float behind = slab + 0.5f - beam->stop[own + (size_t)x];
            stopped[x] = behind > 0 ? behind < 1 ? behind : 1 : 0;
        }
    }
}

/* Adds what a beam has lost at a row of a plane's texels: optical depth is looked up, since transmittance bends more
   between texels. */
static void spsi_beam_add_row(const spsi_beam_part *part, const spsi_slide *slide, const spsi_area *area, int y,
                              float *plane) {
    const spsi_v zero = spsi_set(0), one = spsi_set(1);
    float depth[SPSI_TILE_WIDTH + SPSI_LANES] = {0}, stopped[SPSI_TILE_WIDTH + SPSI_LANES] = {0};
    spsi_texel_grid grid = {part->depth, part->area.x0, part->area.y0, part->width, part->height};
    spsi_texel_row row = {area->x0, y, area->x1 - area->x0 + 1, NULL, depth};
    spsi_row_add(&grid, slide, &row);
    grid.values = part->stopped;
    row.out = stopped;
    if (part->beam->stop) spsi_row_add(&grid, slide, &row);
    for (int i = 0; i < row.count; i += SPSI_LANES) {
        const int some = spsi_least(SPSI_LANES, row.count - i);
        const spsi_v through = spsi_exp(spsi_sub(zero, spsi_max(zero, spsi_load(depth + i))));
        const spsi_v lit = spsi_sub(one, spsi_clamp(spsi_load(stopped + i), zero, one)); /* cubics overshoot */
        const spsi_v lost = spsi_sub(one, spsi_mul(through, lit));
        spsi_store_first(plane + i, spsi_add(spsi_load_first(plane + i, some), lost), some);
    }
}

/* Adds what one beam has lost at the planes of a chunk to a tile of them. */
static void spsi_beam_add(const spsi_penumbra *penumbra, const spsi_beam *beam, const spsi_lookups *lookups,
                          float *memory, float *const *planes) {
    const double first = penumbra->first_slab;
    const spsi_area reach = spsi_slide_area(penumbra, beam, first, first + SPSI_CHUNK, -1, lookups->bounds);
    const spsi_area area = spsi_area_meet(reach, spsi_beam_area(beam));
    const size_t pitch = (size_t)penumbra->rays->width;
    int held;
    spsi_slide slide;
    spsi_beam_part part;
    if (spsi_area_empty(area)) return;
    held = spsi_penumbra_holds(penumbra, spsi_slide_area(penumbra, beam, first, first + SPSI_CHUNK, 1, area));
    if (!held && spsi_area_empty(spsi_area_meet(area, beam->crossed))) return;
    spsi_beam_part_load(beam, area, memory, &part);
    for (int k = 0; k <= SPSI_CHUNK; ++k) {
        if (beam->stop) spsi_beam_part_stop(&part, (float)(first + k));
        spsi_slide_build(penumbra, beam, first + k, -1, &slide);
        for (int y = lookups->bounds.y0; y <= lookups->bounds.y1; ++y) {
            const spsi_area *row = &lookups->rows[y % SPSI_TILE_HEIGHT / SPSI_PATCH];
            if (!spsi_area_empty(*row))
                spsi_beam_add_row(&part, &slide, row, y, planes[k] + (size_t)y * pitch + (size_t)row->x0);
        }
        if (k == SPSI_CHUNK || !held) continue;
        spsi_slide_build(penumbra, beam, first + k + 0.5, 1, &slide);
        for (int y = 0; y < part.height; ++y) {
            const size_t at = (size_t)y * (size_t)part.width;
            const spsi_texel_row row = {area.x0, area.y0 + y, part.width, part.lengths + at, part.depth + at};
            spsi_beam_cross(penumbra, &slide, k, &row);
        }
    }
}

/* Turns the sum of what beams have lost into -log of the mean transmittance. */
static void spsi_penumbra_finish_row(const spsi_penumbra *penumbra, int count, float *plane) {
    const spsi_v share = spsi_set(1.0f / (float)penumbra->beam_count), one = spsi_set(1);
    for (int x = 0; x < count; x += SPSI_LANES) {
        const int some = spsi_least(SPSI_LANES, count - x);
        const spsi_v lost = spsi_mul(spsi_load_first(plane + x, some), share);
        spsi_store_first(plane + x, spsi_minus_log(spsi_sub(one, lost)), some);
    }
}

/* Fills a tile of the planes of the current chunk, as far as gas can look it up. */
static void spsi_penumbra_tile(const spsi_penumbra *penumbra, int index, int worker, float *const *planes) {
    const size_t pitch = (size_t)penumbra->rays->width;
    float *memory = penumbra->scratch + (size_t)worker * penumbra->scratch_floats;
    spsi_lookups lookups;
    spsi_lookups_find(penumbra, index, &lookups);
    if (spsi_area_empty(lookups.bounds)) return;
    for (int pass = 0; pass < 2; ++pass) {
        for (int k = 0; k <= SPSI_CHUNK; ++k)
            for (int y = lookups.bounds.y0; y <= lookups.bounds.y1; ++y) {
                const spsi_area *row = &lookups.rows[y % SPSI_TILE_HEIGHT / SPSI_PATCH];
                float *plane = planes[k] + (size_t)y * pitch;
                if (spsi_area_empty(*row)) continue;
                if (pass == 0)
                    memset(plane + row->x0, 0, (size_t)(row->x1 - row->x0 + 1) * sizeof(float));
                else
                    spsi_penumbra_finish_row(penumbra, row->x1 - row->x0 + 1, plane + row->x0);
            }
        for (int i = 0; i < penumbra->beam_count && pass == 0; ++i)
            spsi_beam_add(penumbra, &penumbra->beams[i], &lookups, memory, planes);
    }
}

/* --- the beams' own way --- */

#define SPSI_BEAM_BLOCK 32 /* texels on a side of a block, which crosses sheets as a whole or not at all */

/* Rows of blocks of the tallest beam. */
static int spsi_beam_tasks(const spsi_penumbra *penumbra) {
    int most = 0;
    for (int i = 0; i < penumbra->beam_count; ++i) most = spsi_most(most, penumbra->beams[i].rays.height);
    return (most + SPSI_BEAM_BLOCK - 1) / SPSI_BEAM_BLOCK;
}

/* Lets a block of a beam's texels cross the chunk's sheets. */
static void spsi_beam_block(const spsi_penumbra *penumbra, const spsi_beam *beam, spsi_area block) {
    const double first = penumbra->first_slab;
    spsi_slide slides[SPSI_CHUNK];
    if (!spsi_penumbra_holds(penumbra, spsi_slide_area(penumbra, beam, first, first + SPSI_CHUNK, 1, block))) return;
    for (int k = 0; k < SPSI_CHUNK; ++k) spsi_slide_build(penumbra, beam, first + k + 0.5, 1, &slides[k]);
    for (int y = block.y0; y <= block.y1; ++y) {
        float lengths[SPSI_BEAM_BLOCK + SPSI_LANES];
        const size_t at = (size_t)(y - beam->y0) * (size_t)beam->rays.width + (size_t)(block.x0 - beam->x0);
        const spsi_texel_row row = {block.x0, y, block.x1 - block.x0 + 1, lengths, beam->depth + at};
        spsi_beam_lengths(beam, row.x0, y, row.count, lengths);
        for (int k = 0; k < SPSI_CHUNK; ++k) spsi_beam_cross(penumbra, &slides[k], k, &row);
    }
}

/* A row of blocks of one beam. */
static void spsi_beam_task(void *data, int index, int worker) {
    const spsi_penumbra *penumbra = (const spsi_penumbra *)data;
    const spsi_beam *beam = &penumbra->beams[index % penumbra->beam_count];
    const spsi_area area = spsi_beam_area(beam);
    const int y0 = area.y0 + index / penumbra->beam_count * SPSI_BEAM_BLOCK;
    (void)worker;
    for (int x0 = area.x0; x0 <= area.x1 && y0 <= area.y1; x0 += SPSI_BEAM_BLOCK) {
        const spsi_area block = {x0, y0, x0 + SPSI_BEAM_BLOCK - 1, y0 + SPSI_BEAM_BLOCK - 1};
        spsi_beam_block(penumbra, beam, spsi_area_meet(block, area));
    }
}

/* Texels of the tiles whose sheets hold something. */
static spsi_area spsi_penumbra_held(const spsi_penumbra *penumbra) {
    spsi_area area = spsi_area_none();
    for (int tile = 0; tile < penumbra->tiles_x * penumbra->tiles_y; ++tile)
        if (penumbra->held[tile]) area = spsi_area_join(area, spsi_tile_area(penumbra, tile));
    return area;
}

/* Lets the beams cross the sheets that are kept, if they have not yet. */
static void spsi_penumbra_cross(sps_context *context, spsi_penumbra *penumbra) {
    const double first = penumbra->first_slab;
    const spsi_area held = spsi_penumbra_held(penumbra);
    if (!penumbra->pending) return;
    penumbra->pending = 0;
    spsi_parallel(context, penumbra->beam_count * spsi_beam_tasks(penumbra), spsi_beam_task, penumbra);
    for (int i = 0; i < penumbra->beam_count && !spsi_area_empty(held); ++i) {
        spsi_beam *beam = &penumbra->beams[i];
        const spsi_area crossed = spsi_slide_area(penumbra, beam, first, first + SPSI_CHUNK, -1, held);
        beam->crossed = spsi_area_join(beam->crossed, crossed);
    }
}

/* Whether a ray of a beam, given by its texel, may meet gas in the kept sheets up to a slab coordinate. */
static int spsi_beam_meets(const spsi_penumbra *penumbra, const spsi_beam *beam, const double texel[2], double slab) {
    spsi_area area = spsi_area_none();
    for (int end = 0; end < 2; ++end) {
        spsi_slide slide;
        spsi_area here;
        double at[2];
        spsi_slide_build(penumbra, beam, end ? slab : penumbra->first_slab, 1, &slide);
        spsi_slide_at(&slide, texel[0], texel[1], at);
        for (int i = 0; i < 2; ++i) at[i] = fmin(fmax(at[i], -1e6), 1e6);
        here.x0 = (int)floor(at[0]) - 1, here.y0 = (int)floor(at[1]) - 1;
        here.x1 = here.x0 + 3, here.y1 = here.y0 + 3;
        area = spsi_area_join(area, here);
    }
    return spsi_penumbra_holds(penumbra, area);
}

/* Optical depth of gas in front of a point on one beam: what the beam has crossed, and the kept sheets up to there. */
static double spsi_beam_depth_at(const spsi_penumbra *penumbra, const spsi_beam *beam, const double point[3]) {
    const double first = penumbra->first_slab, slab = fmin(spsi_slab_at(penumbra->slabs, point), first + SPSI_CHUNK);
    const spsi_rays *rays = penumbra->rays;
    double q[3], texel[2], sum = 0, depth;
    float lengths[SPSI_LANES];
    spsi_project(&beam->rays, point, q);
    if (beam->rays.perspective && !(q[2] > 0)) return 0;
    texel[0] = q[0] + beam->x0, texel[1] = q[1] + beam->y0;
    depth = spsi_bilinear_inside(beam->depth, beam->rays.width, beam->rays.height, q[0], q[1]);
    if (!penumbra->pending || !(slab > first) || !spsi_beam_meets(penumbra, beam, texel, slab)) return depth;
    for (int k = 0; k < SPSI_CHUNK && slab > first + k; ++k) {
        const float *sheet = penumbra->sheets + (size_t)k * spsi_ray_count(rays);
        spsi_slide slide;
        double at[2];
        spsi_slide_build(penumbra, beam, first + k + 0.5, 1, &slide);
        spsi_slide_at(&slide, texel[0], texel[1], at);
        sum += fmin(slab - first - k, 1) * spsi_bilinear_inside(sheet, rays->width, rays->height, at[0], at[1]);
    }
    spsi_slab_lengths(beam, spsi_set((float)q[0]), (float)q[1], lengths);
    return depth + sum * (double)lengths[0];
}

/* Mean transmittance of gas between a light and a point, as -log of it. Polygons do not count. */
static double spsi_penumbra_depth(const spsi_penumbra *penumbra, const double point[3]) {
    double sum = 0;
    for (int i = 0; i < penumbra->beam_count; ++i)
        sum += exp(-spsi_beam_depth_at(penumbra, &penumbra->beams[i], point));
    sum /= penumbra->beam_count;
    return sum > 1e-7 ? -log(sum) : (double)SPSI_LIGHT_END;
}

/* ============================================================================================== >>shadows
   25 Shadows of a lamp on gas and surfaces. Gas shades by sheets, which are filled chunk by chunk as the eye's are and
   hold the optical depth towards the lamp at the planes between slabs: plane k holds the optical depth in front of slab
   k. Or gas shades by a transmittance map. A shadow begins with a sweep. It advances by a chunk: its sheets are filled,
   and light propagates from slab to slab, tile by tile, since hard light never leaves its ray. It can be looked up
   anywhere in the current chunk. Polygons shade gas by a depth map and each other by rays; a point behind an opaque one
   is dark, whatever the planes hold there. Penumbrae are followed beam by beam, >>penumbrae. Cost: 68 bytes per texel
   of the planes. */

typedef struct spsi_planes {
    float *depth[SPSI_CHUNK + 1]; /* width * height each */
    int width, height, tiles_x, tiles_y;
    int cubic;             /* 1: bicubic lookup, for classified volumes, whose depth bends within a voxel */
    uint64_t *open;        /* per tile: a bit for each patch that light still passes */
    unsigned char *uneven; /* per tile: 1: its planes differ and must be levelled before the next chunk */
} spsi_planes;

#define SPSI_PLANES_TEXEL_BYTES ((SPSI_CHUNK + 1) * sizeof(float))

/* Bicubic lookup, clamped to the range of the four nearest values so that nothing overshoots. The optical depth of
   classified volumes bends within a voxel: bilinear interpolation would lie above the bend everywhere, and darken
   surfaces by 3 % with one texel per voxel. The grid is at least 4 x 4; the lookup is clamped to its inner cells. */
static inline spsi_v spsi_bicubic(const float *grid, int width, int height, spsi_v x, spsi_v y) {
    const spsi_v cx = spsi_clamp(x, spsi_set(1), spsi_set((float)(width - 2)));
    const spsi_v cy = spsi_clamp(y, spsi_set(1), spsi_set((float)(height - 2)));
    const spsi_v ix = spsi_min(spsi_floor(cx), spsi_set((float)(width - 3)));
    const spsi_v iy = spsi_min(spsi_floor(cy), spsi_set((float)(height - 3)));
    spsi_v across[4], down[4], sum = spsi_set(0), low = spsi_set(SPSI_INFINITY), high = sum;
    spsi_cubic_weights(spsi_sub(cx, ix), across);
    spsi_cubic_weights(spsi_sub(cy, iy), down);
    for (int r = 0; r < 4; ++r) {
        spsi_v row = spsi_set(0);
        for (int c = 0; c < 4; ++c) {
            const spsi_v value = spsi_lookup(grid + (r - 1) * width + c - 1, width, ix, iy);
            row = spsi_fma(across[c], value, row);
            if (r == 0 || r == 3 || c == 0 || c == 3) continue;
            low = spsi_min(low, value);
            high = spsi_max(high, value);
        }
        sum = spsi_fma(down[r], row, sum);
    }
    return spsi_clamp(sum, low, high);
}

/* Accumulates a tile's sheets from plane to plane. */
static void spsi_planes_propagate(spsi_planes *planes, const spsi_light_shader *shader, const spsi_tile *tile) {
    const int margin = (tile->slab_count - SPSI_CHUNK) / 2;
    for (int y = tile->y0; y <= tile->y1; ++y)
        for (int x = tile->x0; x <= tile->x1; x += SPSI_LANES) {
            const size_t to = (size_t)y * (size_t)planes->width + (size_t)x;
            const size_t from = (size_t)((y - tile->y0) * tile->pitch + (x - tile->x0));
            const spsi_row_slabs slabs = spsi_row_slabs_at(shader, x, y);
            const int count = spsi_least(SPSI_LANES, tile->x1 - x + 1);
            spsi_v depth = spsi_load_first(planes->depth[SPSI_CHUNK] + to, count);
            for (int k = 0; k <= SPSI_CHUNK; ++k) {
                spsi_store_first(planes->depth[k] + to, depth, count);
                if (k == SPSI_CHUNK) break;
                const spsi_v sheet =
                    spsi_light_sheet(shader, tile, from + (size_t)(k + margin) * tile->sheet_size, &slabs);
                const spsi_v behind = spsi_min(spsi_add(depth, sheet), spsi_set(SPSI_DEPTH_MAX));
                depth = spsi_select(spsi_less(depth, spsi_set(SPSI_LIGHT_END)), behind, depth);
            }
        }
}

/* Sets all planes of a tile to the optical depth so far, if the last chunk changed it. */
static void spsi_planes_level(spsi_planes *planes, int tile) {
    const int x0 = tile % planes->tiles_x * SPSI_TILE_WIDTH, y0 = tile / planes->tiles_x * SPSI_TILE_HEIGHT;
    const int width = spsi_least(SPSI_TILE_WIDTH, planes->width - x0);
    if (!planes->uneven[tile]) return;
    planes->uneven[tile] = 0;
    for (int y = y0; y < spsi_least(planes->height, y0 + SPSI_TILE_HEIGHT); ++y)
        for (int k = 0; k < SPSI_CHUNK; ++k) {
            const size_t at = (size_t)y * (size_t)planes->width + (size_t)x0;
            memcpy(planes->depth[k] + at, planes->depth[SPSI_CHUNK] + at, (size_t)width * sizeof(float));
        }
}

/* The shadow of a lamp that has slabs of its own. */
typedef struct spsi_sliced {
    const spsi_contents *contents;
    spsi_target target;
    spsi_light_shader shader;
    spsi_planes planes;
    int is_soft; /* 1: light propagates by `penumbra` */
    spsi_penumbra penumbra;
} spsi_sliced;

typedef enum spsi_shadow_kind {
    SPSI_SHADOW_NONE, /* no gas casts it */
    SPSI_SHADOW_SHEETS,
    SPSI_SHADOW_MAP
} spsi_shadow_kind;

typedef struct spsi_shadow {
    const spsi_lamp *lamp;
    spsi_shadow_kind kind;
    const spsi_sliced *sliced; /* with sheets */
    const sps_tmap *tmap;      /* with a map */
    int soft;                  /* 1: its sheets hold polygons' shadows too */
    const float *lit;          /* per pixel of the image: spsi_sight */
    spsi_linear along[3];      /* arguments of spsi_shadow_lookup along the eye's rays */
    spsi_depth_map depth_map;
    spsi_pane_map *pane_maps; /* of the light's points */
    int pane_map_count;       /* 0: no translucent polygons */
} spsi_shadow;

/* --- sheets --- */

static sps_result spsi_planes_build(sps_context *context, const spsi_frame *frame, const spsi_rays *rays,
                                    spsi_planes *planes) {
    const size_t texels = spsi_ray_count(rays);
    float *memory;
    size_t tiles;
    planes->tiles_x = spsi_tile_columns(rays);
    planes->tiles_y = spsi_tile_rows(rays);
    tiles = (size_t)planes->tiles_x * (size_t)planes->tiles_y;
    /* a tile's bits and flag take less than one more texel */
    planes->open = (uint64_t *)spsi_reserve(context, SPSI_BUFFER_PLANES, texels + tiles, SPSI_PLANES_TEXEL_BYTES);
    if (!planes->open) return context->result;
    memory = (float *)(void *)(planes->open + tiles);
    planes->width = rays->width;
    planes->height = rays->height;
    planes->cubic = frame->matter.classifies && rays->width >= 4 && rays->height >= 4;
    for (int k = 0; k <= SPSI_CHUNK; ++k) planes->depth[k] = memory + (size_t)k * texels;
    planes->uneven = (unsigned char *)(memory + (SPSI_CHUNK + 1) * texels);
    memset(memory, 0, texels * (SPSI_CHUNK + 1) * sizeof(float));
    memset(planes->uneven, 0, tiles);
    memset(planes->open, 0xff, tiles * sizeof *planes->open);
    return SPS_OK;
}

static sps_result spsi_sliced_begin(sps_context *context, const spsi_frame *frame, const spsi_sweep *sweep,
                                    const spsi_faces *faces, const spsi_contents *contents, spsi_sliced *sliced) {
    sliced->contents = contents;
    sliced->is_soft = sweep->soft;
    if (sweep->soft && spsi_penumbra_begin(context, frame, sweep, faces, &sliced->penumbra)) return context->result;
    spsi_light_shader_build(frame, &sweep->rays, &sweep->slabs, &sliced->shader);
    if (spsi_planes_build(context, frame, &sweep->rays, &sliced->planes)) return context->result;
    return spsi_target_of_light(context, frame, &sweep->rays, &sweep->slabs, frame->accuracy.light_cut,
                                &sliced->target);
}

/* Fills the sheets of one tile and propagates light through them. */
static void spsi_sliced_task(void *data, int index, int worker) {
    spsi_sliced *sliced = (spsi_sliced *)data;
    spsi_planes *planes = &sliced->planes;
    const int column = index % planes->tiles_x, row = index / planes->tiles_x;
    spsi_tile tile;
    spsi_tile_place(&sliced->target, column, row, worker, &tile);
    tile.open = planes->open[index];
    if (!tile.open || !spsi_tile_splat(&sliced->target, sliced->contents, column, row, &tile)) {
        spsi_planes_level(planes, index);
        return;
    }
    spsi_planes_propagate(planes, &sliced->shader, &tile);
    planes->open[index] =
        spsi_patches_open(planes->depth[SPSI_CHUNK] + (size_t)tile.y0 * (size_t)planes->width + (size_t)tile.x0,
                          (size_t)planes->width, tile.x1 - tile.x0 + 1, tile.y1 - tile.y0 + 1, SPSI_LIGHT_END);
    planes->uneven[index] = 1;
    spsi_tile_count(&sliced->target, &tile, worker);
}

/* Fills the sheets of one tile and keeps them. */
static void spsi_soft_sheets_task(void *data, int index, int worker) {
    spsi_sliced *sliced = (spsi_sliced *)data;
    const int column = index % sliced->planes.tiles_x, row = index / sliced->planes.tiles_x;
    spsi_tile tile;
    spsi_tile_place(&sliced->target, column, row, worker, &tile);
    if (!spsi_tile_splat(&sliced->target, sliced->contents, column, row, &tile)) {
        spsi_penumbra_clear(&sliced->penumbra, index);
        return;
    }
    spsi_penumbra_keep(&sliced->penumbra, &sliced->shader, &tile, index);
    spsi_tile_count(&sliced->target, &tile, worker);
}

static void spsi_soft_planes_task(void *data, int index, int worker) {
    const spsi_sliced *sliced = (const spsi_sliced *)data;
    spsi_penumbra_tile(&sliced->penumbra, index, worker, sliced->planes.depth);
}

/* Advances to the contents' current chunk. Hard light propagates tile by tile, since it never leaves its ray; a
   penumbra needs all sheets of the chunk. */
static void spsi_sliced_advance(sps_context *context, spsi_sliced *sliced) {
    const double start = spsi_clock(context);
    const int tiles = sliced->planes.tiles_x * sliced->planes.tiles_y;
    if (sliced->is_soft) {
        spsi_penumbra_cross(context, &sliced->penumbra);
        sliced->penumbra.first_slab = sliced->contents->first_slab;
        sliced->penumbra.pending = 1;
        spsi_parallel(context, tiles, spsi_soft_sheets_task, sliced);
        spsi_parallel(context, tiles, spsi_soft_planes_task, sliced);
        context->stats.soft_texels +=
            (SPSI_CHUNK + 1) * (uint64_t)sliced->penumbra.beam_count * (uint64_t)spsi_ray_count(sliced->target.rays);
    } else {
        spsi_parallel(context, tiles, spsi_sliced_task, sliced);
    }
    context->stats.seconds_light += spsi_clock(context) - start;
}

static void spsi_level_task(void *data, int index, int worker) {
    (void)worker;
    spsi_planes_level(&((spsi_sliced *)data)->planes, index);
}

/* Advances past the current chunk: all planes hold the optical depth so far. */
static void spsi_sliced_level(sps_context *context, spsi_sliced *sliced) {
    if (sliced->is_soft)
        spsi_penumbra_cross(context, &sliced->penumbra);
    else
        spsi_parallel(context, sliced->planes.tiles_x * sliced->planes.tiles_y, spsi_level_task, sliced);
}

/* --- lookup --- */

/* Prepares lookups along the eye's rays. */
static void spsi_shadow_aim(const spsi_rays *eye, spsi_shadow *shadow) {
    spsi_depth_map_follow(eye, &shadow->depth_map);
    for (int i = 0; i < shadow->pane_map_count; ++i) spsi_depth_map_follow(eye, &shadow->pane_maps[i].grid);
    for (int i = 0; i < 3; ++i) {
        const double axis[3] = {(double)(i == 0), (double)(i == 1), (double)(i == 2)};
        if (shadow->kind == SPSI_SHADOW_MAP) {
            const spsi_rays *rays = &shadow->tmap->rays[0];
            const int whole = shadow->tmap->face_count > 1;
            spsi_linear_build(eye, whole ? axis : rays->inverse[i], rays->origin,
                              i == 2 && !whole ? -rays->depth_reference : 0, &shadow->along[i]);
        } else if (shadow->kind == SPSI_SHADOW_SHEETS) {
            const spsi_rays *rays = shadow->sliced->target.rays;
            spsi_linear_build(eye, rays->inverse[i], rays->origin, 0, &shadow->along[i]);
        }
    }
}

/* Optical depth between the lamp and a vector of points, given by the coordinates of `along`, on plane k. */
static spsi_v spsi_shadow_lookup(const spsi_shadow *shadow, const spsi_v at[3], int k) {
    const spsi_planes *planes;
    spsi_v q[2];
    if (shadow->kind == SPSI_SHADOW_NONE) return spsi_set(0);
    if (shadow->kind == SPSI_SHADOW_MAP) return spsi_tmap_lookup(shadow->tmap, at);
    planes = &shadow->sliced->planes;
    q[0] = at[0];
    q[1] = at[1];
    if (shadow->sliced->target.rays->perspective) {
        const spsi_v t = spsi_max(at[2], spsi_set(FLT_MIN * 16));
        q[0] = spsi_div(q[0], t);
        q[1] = spsi_div(q[1], t);
    }
    if (planes->cubic) return spsi_bicubic(planes->depth[k], planes->width, planes->height, q[0], q[1]);
    return spsi_bilinear(planes->depth[k], planes->width, planes->height, q[0], q[1]);
}

/* Optical depth between the lamp and a point, in or next to the chunk that begins with `first_slab`. */
static double spsi_shadow_depth(const spsi_shadow *shadow, int first_slab, const double point[3]) {
    const spsi_planes *planes;
    const spsi_rays *rays;
    double q[3], slab, before, after, lit;
    float depth;
    int k;
    if (shadow->kind == SPSI_SHADOW_NONE) return 0;
    if (shadow->kind == SPSI_SHADOW_MAP) {
        spsi_tmap_at(shadow->tmap, 1, point, &depth, &lit);
        return (double)depth;
    }
    if (shadow->sliced->is_soft) return spsi_penumbra_depth(&shadow->sliced->penumbra, point);
    planes = &shadow->sliced->planes;
    rays = shadow->sliced->target.rays;
    spsi_project(rays, point, q);
    if (rays->perspective && !(q[2] > 0)) return 0;
    slab = fmin(fmax(spsi_slab_at(shadow->sliced->target.slabs, point) - first_slab, 0), SPSI_CHUNK);
    k = spsi_least((int)slab, SPSI_CHUNK - 1);
    before = spsi_bilinear_at(planes->depth[k], planes->width, planes->height, q[0], q[1]);
    after = spsi_bilinear_at(planes->depth[k + 1], planes->width, planes->height, q[0], q[1]);
    return before + (slab - k) * (after - before);
}

/* --- the choice between sheets and a table --- */

/* Whether a light's table, in place of sheets that are aimed already, has entries as fine as their texels, along the
   light too. */
static int spsi_table_is_fine(sps_context *context, const spsi_frame *frame, const spsi_sweep *sheets,
                              const spsi_lamp *lamp) {
    sps_tmap map;
    const double *near_depth = &map.settings.near_depth, *far_depth = &map.settings.far_depth;
    const spsi_rays *rays = &map.rays[0];
    if (spsi_lamp_tmap_aim(context, frame, lamp, &map)) return 0;
    if (map.face_count > 1 || rays->width < sheets->rays.width || rays->height < sheets->rays.height) return 0;
    return ceil((*far_depth - *near_depth) / spsi_pixel_size_at(rays, 0.5 * (*near_depth + *far_depth))) <=
           map.settings.components;
}

/* Upper bound of the bytes that a frame may need without tables, by the figures at the top of this file, had all voxels
   to be kept: a table that is not needed must not be what exceeds the memory limit. It does not depend on what the
   context holds, nor on the region, so that the same scene always looks the same. */
static double spsi_bytes_without_tables(const sps_context *context, const spsi_frame *frame, const spsi_sweep *sheets) {
    const double pixels = (double)(frame->eye.width + SPSI_TILE_WIDTH) * (frame->eye.height + SPSI_TILE_HEIGHT);
    const double map = spsi_depth_map_size(frame), lights = frame->lamps.shadow_count;
    const double triangles = (double)frame->meshes.triangle_count;
    double bytes = (double)spsi_worker_count(context) * 3e5 * (frame->matter.material_count + 1);
    for (int i = 0; i < frame->medium_count; ++i)
        bytes += 20.0 * frame->media[i].size[0] * frame->media[i].size[1] * frame->media[i].size[2];
    bytes += (32 + 264) * (double)frame->particles.count + (176 + 68) * triangles;
    bytes += 60 * pixels + 68.0 * sheets->rays.width * sheets->rays.height;
    return bytes + (triangles > 0 ? lights * (18 * map * map + 4 * pixels) : 0);
}

/* Makes a light shade gas by a table (1), or by sheets (0). */
static void spsi_lamp_take(spsi_lamp *lamp, int table, spsi_choice choice) {
    lamp->has_map = table;
    lamp->sliced = !table;
    lamp->choice = choice;
}

/* A table for a light that no slabs serve. It holds the shadow of a point: a light that has an extent keeps its sheets,
   which are refused, unless its widest penumbra is narrower than half a texel. Where that cannot be known before
   reading, it counts as wider. */
static void spsi_choose_for_unserved(const spsi_frame *frame, spsi_sweep *sweep, spsi_lamp *lamp) {
    const int known = frame->meshes.triangle_count == 0 && frame->particles.set_count == 0;
    const int by_camera = sweep->cosine_of_light >= SPSI_COSINE_MIN && sweep->cosine_of_eye < SPSI_COSINE_MIN;
    spsi_rays rays[SPSI_CUBE_FACES];
    int faces;
    spsi_lamp_take(lamp, 1, by_camera ? SPSI_CHOICE_TABLE_CAMERA : SPSI_CHOICE_TABLE_IN_GAS);
    faces = spsi_lamp_rays(frame, lamp, rays);
    sweep->rays = rays[0];
    if (faces == 0 || (lamp->extent.exists && !(known && by_camera && spsi_penumbra_texels(frame, sweep) < 0.5)))
        spsi_lamp_take(lamp, 0, SPSI_CHOICE_SHEETS);
}

/* Chooses between sheets and a table for a light for which the caller has not. `others`: 1 if an earlier light has
   sheets; `room`: bytes that tables may take, less those that they take already. */
static void spsi_choose_for_lamp(sps_context *context, const spsi_frame *frame, int others, double *room,
                                 spsi_lamp *lamp) {
    spsi_sweep sweep;
    size_t held, filling;
    double bytes;
    spsi_sweep_clear(frame, lamp, 0, &sweep);
    lamp->choice = SPSI_CHOICE_SHEETS;
    if (!spsi_sweep_aim(frame, &sweep)) {
        spsi_choose_for_unserved(frame, &sweep, lamp);
        return;
    }
    if (!others || frame->matter.classifies || lamp->extent.exists) return;
    spsi_lamp_take(lamp, 1, SPSI_CHOICE_TABLE_SHARED);
    spsi_lamp_tmap_bytes(frame, lamp, &held, &filling);
    bytes = (double)held + (double)filling;
    if (spsi_table_is_fine(context, frame, &sweep, lamp) &&
        bytes + spsi_bytes_without_tables(context, frame, &sweep) <= *room)
        *room -= bytes;
    else
        spsi_lamp_take(lamp, 0, SPSI_CHOICE_SHEETS);
}

/* Chooses how gas is shaded by each light that leaves it open, and how the image is cut, from the volumes' boxes and
   from the particles, if they have been read. So, without particles, the choice is the same before reading and after.
 */
static void spsi_choose_shadows(sps_context *context, spsi_frame *frame) {
    spsi_content *content = frame->content;
    const spsi_bounds tight = content->bounds;
    double room = context->config.memory_limit > 0 ? (double)context->config.memory_limit : HUGE_VAL;
    if (spsi_bounds_empty(&tight)) return;
    if (frame->medium_count > 0) {
        spsi_bounds_add(&content->outer, tight.low);
        spsi_bounds_add(&content->outer, tight.high);
    } else {
        content->outer = tight;
    }
    content->bounds = content->outer;
    frame->lamps.sliced_count = 0;
    for (int i = 0; i < frame->lamps.count; ++i) {
        spsi_lamp *lamp = &frame->lamps.list[i];
        if (lamp->choice == SPSI_CHOICE_OPEN)
            spsi_choose_for_lamp(context, frame, frame->lamps.sliced_count > 0, &room, lamp);
        frame->lamps.sliced_count += lamp->sliced;
    }
    if (frame->lamps.sliced_count == 0) spsi_image_divide(frame);
    content->bounds = tight;
}

/* --- maps of a sweep's shadows --- */

/* Builds the depth maps by which polygons shade gas. Surfaces do not use them. */
static sps_result spsi_depth_maps_build(sps_context *context, const spsi_frame *frame, const spsi_faces *faces,
                                        spsi_shadow *shadows, int count) {
    size_t floats = 0, more;
    float *memory;
    if (faces->count == 0 || !frame->matter.scatters || !spsi_holds_gas(context, frame)) return SPS_OK;
    for (int i = 0; i < count; ++i) {
        if (shadows[i].soft) continue;
        spsi_depth_map_aim(frame, shadows[i].lamp, spsi_depth_map_size(frame), &shadows[i].depth_map);
        more = spsi_depth_map_floats(&shadows[i].depth_map);
        floats = more > SIZE_MAX - floats ? SIZE_MAX : floats + more; /* SIZE_MAX cannot be reserved */
    }
    memory = (float *)spsi_reserve(context, SPSI_BUFFER_DEPTH_MAPS, floats, sizeof(float));
    if (!memory) return context->result;
    for (int i = 0; i < count; ++i) memory = spsi_depth_map_lay_out(&shadows[i].depth_map, memory);
    for (int i = 0; i < count; ++i)
        if (!shadows[i].soft) spsi_depth_map_fill(context, faces, &shadows[i].depth_map);
    return SPS_OK;
}

/* Lays out the pane maps of a sweep's lights: one for each point of a light that is soft, which share the texels of
   one. */
static sps_result spsi_pane_maps_lay_out(sps_context *context, const spsi_frame *frame, spsi_shadow *shadows, int count,
                                         spsi_pane_map *maps) {
    size_t bytes = 0;
    spsi_pane_map *next = maps;
    char *memory;
    for (int i = 0; i < count; ++i) {
        const spsi_lamp *lamp = shadows[i].lamp;
        shadows[i].pane_maps = next;
        shadows[i].pane_map_count = shadows[i].soft ? lamp->point_count : 1;
        for (int k = 0; k < shadows[i].pane_map_count; ++k, ++next) {
            const double share = 1 / sqrt((double)shadows[i].pane_map_count);
            memset(next, 0, sizeof *next);
            spsi_depth_map_aim(frame, shadows[i].soft ? &lamp->points[k] : lamp,
                               spsi_most(8, (int)(share * spsi_depth_map_size(frame))), &next->grid);
            bytes += spsi_pane_map_bytes(next);
        }
    }
    memory = (char *)spsi_reserve(context, SPSI_BUFFER_PANE_TEXELS, bytes, 1);
    for (spsi_pane_map *map = maps; memory && map < next; ++map) memory = spsi_pane_map_lay_out(map, memory);
    return context->result;
}

/* Counts the panes of all maps, and lists them. */
static sps_result spsi_pane_maps_fill(sps_context *context, const spsi_frame *frame, const spsi_faces *faces,
                                      spsi_pane_map *maps, size_t map_count) {
    size_t sum = 0, most = 0;
    spsi_pane *panes;
    for (size_t i = 0; i < map_count; ++i)
        for (int face = 0; face < maps[i].grid.face_count; ++face) {
            spsi_panes_raster(context, frame, faces, &maps[i], face, 0);
            sum = maps[i].counts[face] > SIZE_MAX - sum ? SIZE_MAX : sum + maps[i].counts[face];
            most = maps[i].counts[face] > most ? maps[i].counts[face] : most;
        }
    panes = (spsi_pane *)spsi_reserve(context, SPSI_BUFFER_PANES, sum, sizeof *panes);
    if (!panes || !spsi_reserve(context, SPSI_BUFFER_FRAGMENTS, most, sizeof(spsi_fragment))) return context->result;
    for (size_t i = 0; i < map_count; ++i) {
        for (int face = 0; face < maps[i].grid.face_count; ++face) {
            maps[i].list[face] = panes;
            panes += maps[i].counts[face];
        }
        spsi_pane_map_fill(context, frame, faces, &maps[i]);
    }
    return SPS_OK;
}

/* Builds the maps by which translucent polygons filter the light of gas. */
static sps_result spsi_pane_maps_build(sps_context *context, const spsi_frame *frame, const spsi_faces *faces,
                                       spsi_shadow *shadows, int count) {
    size_t map_count = 0;
    int widest = 0;
    spsi_pane_map *maps;
    if (!frame->meshes.translucent || !frame->matter.scatters || !spsi_holds_gas(context, frame)) return SPS_OK;
    if (count == 0) return SPS_OK;
    for (int i = 0; i < count; ++i) map_count += (size_t)(shadows[i].soft ? shadows[i].lamp->point_count : 1);
    maps = (spsi_pane_map *)spsi_reserve(context, SPSI_BUFFER_PANE_MAPS, map_count, sizeof *maps);
    if (!maps || spsi_pane_maps_lay_out(context, frame, shadows, count, maps)) return context->result;
    for (size_t i = 0; i < map_count; ++i)
        for (int face = 0; face < maps[i].grid.face_count; ++face)
            widest = spsi_most(widest, maps[i].grid.rays[face].width);
    if (!spsi_reserve(context, SPSI_BUFFER_LAYER_SAMPLES, (size_t)spsi_worker_count(context),
                      (size_t)widest * (sizeof(uint64_t) + sizeof(double))))
        return context->result;
    return spsi_pane_maps_fill(context, frame, faces, maps, map_count);
}

/* Builds the transmittance maps of a sweep's lamps, and leaves the rest of the call's part to the sweep. Even after a
   failure, spsi_shadow_maps_release frees them. */
static sps_result spsi_shadow_maps_build(sps_context *context, const spsi_frame *frame, spsi_shadow *shadows, int count,
                                         spsi_part_of_call *sweep) {
    spsi_part_of_call part = {sweep->progress, SPSI_PROGRESS_TMAP * sweep->share};
    int mapped = 0;
    uint64_t gas;
    sps_tmap *maps, *next;
    for (int i = 0; i < count; ++i) mapped += shadows[i].lamp->has_map;
    if (mapped == 0 || spsi_bounds_empty(&frame->content->bounds)) return SPS_OK;
    sweep->progress += part.share;
    sweep->share -= part.share;
    maps = (sps_tmap *)spsi_reserve(context, SPSI_BUFFER_LIGHT_TMAPS, (size_t)mapped, sizeof *maps);
    if (!maps) return context->result;
    part.share /= mapped;
    gas = spsi_has_shadow_tables(frame) ? spsi_gas_fingerprint(frame) : 0;
    next = maps;
    for (int i = 0; i < count; ++i) {
        if (!shadows[i].lamp->has_map) continue;
        shadows[i].tmap = next;
        shadows[i].kind = SPSI_SHADOW_MAP;
        if (spsi_lamp_tmap_begin(context, frame, shadows[i].lamp, gas, next++)) return context->result;
    }
    spsi_shadow_tables_drop(context); /* what no light has taken */
    if (!spsi_reserve(context, SPSI_BUFFER_SHADOW_TABLES, (size_t)mapped, sizeof *maps)) return context->result;
    next = maps;
    for (int i = 0; i < count; ++i) {
        if (!shadows[i].tmap) continue;
        if (spsi_lamp_tmap_fill(context, frame, shadows[i].lamp, &part, next++)) return context->result;
        part.progress += part.share;
    }
    return SPS_OK;
}

static void spsi_shadow_maps_release(sps_context *context, const spsi_shadow *shadows, int count) {
    sps_tmap *maps = (sps_tmap *)context->buffers[SPSI_BUFFER_LIGHT_TMAPS].data;
    for (int i = 0; i < count; ++i)
        if (shadows[i].tmap) spsi_shadow_table_hold(context, maps++);
}

/* ============================================================================================== >>shading
   26 Light leaving sheets and surfaces towards the eye. At share x, in the light's order, of the eye ray's path through
   a sheet of optical depth t, light has passed optical depth A0 + x (A1 - A0), and what is scattered there passes x t
   (front to back) or (1 - x) t on its way out. Both are linear in x, so the sheet sends c t spsi_mean_transmittance(..)
   for either compositing order. A polygon between light and sheet ends the range of x; one between eye and sheet cuts
   the slab (>>splat), and the range of x with it.
   A transfer function is not linear, so a slab's mean value is not enough: what is classified is shaded in SPSI_PARTS
   parts, whose means come from the parabola through the means of three slabs; x is then a share of optical depth. */

/* One light at the current slab of a vector of pixels. */
typedef struct spsi_arrival {
    spsi_v light[2];        /* optical depth from the light to the start and end of the ray's path through the slab */
    int plane;              /* plane of the last lookup; -1: none */
    spsi_v plane_light;     /* optical depth found there */
    spsi_v skipped;         /* optical depth of the gas that was passed since */
    spsi_v lit[SPSI_PARTS]; /* share of each part that polygons leave lit; of an undivided slab, lit[0] */
} spsi_arrival;

typedef struct spsi_shader {
    const spsi_frame *frame;
    const spsi_sweep *sweep;
    const spsi_faces *faces;
    const spsi_shadow *shadows; /* of the lights that the sweep carries */
    int shadow_count;
    const spsi_visible *visible;
    const spsi_hit *hits;      /* those of `visible`, unless there are no polygons: NULL */
    spsi_linear slab;          /* slab coordinate */
    spsi_linear position[3];   /* world position, relative to `position_origin` */
    double position_origin[3]; /* in the world */
    int unshadowed;            /* 1: the sweep also carries ambient light, emission, and lights that cast no shadows */
    int first_slab;            /* of the current chunk */
    int x_origin, y_origin;    /* first pixel of the buffers below */
    int pitch;                 /* pixels per row of the buffers */
    float *depth;              /* optical depth so far */
    float *radiance[3];        /* radiance so far; grey: three times the same buffer */
    float *distance;           /* distance so far, weighted by coverage; NULL: not wanted */
    float end_depth;           /* optical depth of early ray termination */
} spsi_shader;

/* Where the rays of a vector of pixels cross the slabs, and where they end. */
typedef struct spsi_line {
    int x, y;           /* first pixel */
    spsi_v at;          /* x of each pixel */
    spsi_v base, scale; /* plane k of the chunk lies at depth d = (k - base) * scale */
    spsi_v slabs;       /* number of slabs per unit of d: 1 / |scale| */
    spsi_v polygon;     /* d of the polygon; infinity: none */
} spsi_line;

/* Rays of a vector of pixels. */
typedef struct spsi_pixels {
    spsi_line line;
    spsi_line around[8]; /* for gradients: neighbours at x - 1, x + 1, y - 1, y + 1, then at twice these distances */
    spsi_v length;       /* world length per unit of t */
    spsi_v polygon_slab; /* slab coordinate of the polygon, counted from the sweep's first slab */
    spsi_v toward[3];    /* unit direction from the eye */
} spsi_pixels;

/* Sums of a vector of rays so far. */
typedef struct spsi_gathered {
    spsi_v depth; /* optical depth */
    spsi_v radiance[3];
    spsi_v distance; /* weighted by coverage */
} spsi_gathered;

/* One material's part of a sheet. */
typedef struct spsi_sample {
    spsi_v depth;        /* optical depth */
    spsi_v value_length; /* integral of value over world length */
    spsi_v color[3];     /* albedo or reflectance */
    spsi_v surface;      /* 0: gas .. 1: surface */
    spsi_v normal[3];    /* of unit length */
    int has_normal;
} spsi_sample;

#define SPSI_VECTOR_ALIGNMENT 64 /* of the widest vectors */

/* Bytes of `count` structs of vectors for each worker. If they exceed a size_t: SIZE_MAX, which cannot be reserved. */
static size_t spsi_vectors_bytes(const sps_context *context, int count, size_t size) {
    const size_t each = (size_t)spsi_worker_count(context) * size;
    return (size_t)count > (SIZE_MAX - SPSI_VECTOR_ALIGNMENT) / each ? SIZE_MAX
                                                                     : (size_t)count * each + SPSI_VECTOR_ALIGNMENT;
}

/* Reserves them, as they are too large for the stacks of some job systems. Returns NULL after a failure. */
static void *spsi_vectors_reserve(sps_context *context, spsi_buffer_id id, int count, size_t size) {
    char *memory = (char *)spsi_reserve(context, id, 1, spsi_vectors_bytes(context, count, size));
    const uintptr_t beyond = (uintptr_t)memory % SPSI_VECTOR_ALIGNMENT;
    return memory ? memory + (beyond ? SPSI_VECTOR_ALIGNMENT - beyond : 0) : NULL;
}

static inline void spsi_line_build(const spsi_shader *shader, int x, int y, spsi_line *line) {
    spsi_v slope;
    line->x = x;
    line->y = y;
    line->at = spsi_add(spsi_set((float)x), spsi_iota());
    slope = spsi_linear_slope(&shader->slab, line->at, (float)y);
    slope = spsi_select(spsi_less(spsi_abs(slope), spsi_set(1e-20f)), spsi_set(1e-20f), slope);
    line->base = spsi_sub(spsi_linear_base(&shader->slab, line->at, (float)y), spsi_set((float)shader->first_slab));
    line->scale = spsi_div(spsi_set(1), slope);
    line->slabs = spsi_abs(slope);
    line->polygon =
        spsi_hit_depths(shader->hits, shader->frame->content->eye.width, shader->frame->content->eye.height, x, y);
}

static void spsi_pixels_build(const spsi_shader *shader, int x, int y, spsi_pixels *p) {
    const float fy = (float)y;
    spsi_v at, inverse_length;
    spsi_line_build(shader, x, y, &p->line);
    at = p->line.at;
    p->length = spsi_ray_lengths(&shader->frame->content->eye, at, fy);
    inverse_length = spsi_div(spsi_set(1), p->length);
    p->polygon_slab =
        spsi_fma(p->line.polygon, spsi_linear_slope(&shader->slab, at, fy), spsi_linear_base(&shader->slab, at, fy));
    for (int i = 0; i < 3; ++i)
        p->toward[i] = spsi_mul(spsi_linear_slope(&shader->position[i], at, fy), inverse_length);
}

static inline spsi_v spsi_plane_depth(const spsi_line *line, int k) {
    return spsi_mul(spsi_sub(spsi_set((float)k), line->base), line->scale);
}

/* The depths at which a ray enters and leaves slab k, nearer first, clamped to the polygon and the near plane. */
static inline void spsi_slab_range(const spsi_shader *shader, const spsi_line *line, int k, spsi_v *enter,
                                   spsi_v *leave) {
    const spsi_rays *eye = &shader->frame->content->eye;
    const spsi_v a = spsi_plane_depth(line, k), b = spsi_plane_depth(line, k + 1);
    const float near_d = spsi_rays_begin(eye);
    *enter = spsi_min(spsi_max(spsi_min(a, b), spsi_set(near_d)), line->polygon);
    *leave = spsi_max(*enter, spsi_min(spsi_max(a, b), line->polygon));
}

/* World position at depth d, relative to the shader's position origin. */
static inline void spsi_position_at(const spsi_shader *shader, spsi_v x, float y, spsi_v d, spsi_v position[3]) {
    for (int i = 0; i < 3; ++i)
        position[i] =
            spsi_fma(d, spsi_linear_slope(&shader->position[i], x, y), spsi_linear_base(&shader->position[i], x, y));
}

/* The mean value of a classified material in slab k along a line. Its sections are not cut. */
static inline spsi_v spsi_mean_value(const spsi_tile *tile, int channel, const spsi_line *line, int k) {
    const int margin = (tile->slab_count - SPSI_CHUNK) / 2;
    const size_t at =
        (size_t)(k + margin) * tile->sheet_size + (size_t)((line->y - tile->y0) * tile->pitch + (line->x - tile->x0));
    return spsi_mul(spsi_sheet_sum(tile, channel, at), line->slabs);
}

/* World position of the middle of slab k on a line, relative to the shader's position origin. */
static inline void spsi_place_in_slab(const spsi_shader *shader, const spsi_line *line, int k, spsi_v place[3]) {
    const spsi_v middle = spsi_fma(spsi_set(0.5f), line->scale, spsi_plane_depth(line, k));
    spsi_position_at(shader, line->at, (float)line->y, middle, place);
}

static inline void spsi_cross_v(const spsi_v a[3], const spsi_v b[3], spsi_v out[3]) {
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        out[i] = spsi_sub(spsi_mul(a[j], b[k]), spsi_mul(a[k], b[j]));
    }
}

/* A slab on a vector of rays. If any volume is classified it is shaded in parts, in the light's order. */
typedef struct spsi_slab {
    int k, part_count, material_count;
    spsi_sample *samples;          /* material_count per part */
    spsi_v enter, leave;           /* depths along the ray */
    spsi_v first, last;            /* range of the slab that the ray crosses, as shares of it in the light's order */
    spsi_arrival *arrivals;        /* one for each of the shader's shadows */
    spsi_v depth;                  /* optical depth of all samples */
    spsi_v part_depth[SPSI_PARTS]; /* the same for each part */
} spsi_slab;

/* One part of a slab. */
typedef struct spsi_part {
    const spsi_sample *samples;
    spsi_v middle;      /* depth of its middle along the ray */
    spsi_v half;        /* half of its extent in depth */
    spsi_v depth;       /* optical depth */
    spsi_v first, last; /* shares of the slab's optical depth at which it begins and ends */
    int number;         /* in the light's order */
    int is_cut;         /* 1: a layer cuts it: it is only the shares from cut[0] to cut[1] of a part, in that order */
    spsi_v cut[2];
    spsi_v before, after; /* optical depth from the eye to its beginning and end, in the light's order */
} spsi_part;

/* Variation of a classified value within a slab: a parabola through the means of the slab and its two neighbours, and
   likewise for the lateral differences. The change along the ray comes from five slabs: from three, the normal's
   component along the ray would be too small compared with the lateral ones, and lean the surface away from the eye. */
typedef struct spsi_profile {
    spsi_parabola value;
    spsi_parabola aside[2]; /* differences from x - 1 to x + 1, and from y - 1 to y + 1 */
    spsi_parabola along;    /* difference from the slab before to the slab after */
    spsi_v cofactor[3][3];  /* of the matrix of the three difference vectors, in voxels */
    spsi_v determinant;     /* of that matrix */
} spsi_profile;

/* Twice the derivative, per slab, of the quartic whose means over five slabs are outer[0], own[0..2] and outer[1]. In
   the slab's middle its first derivative is (34 (m1 - m-1) - 5 (m2 - m-2)) / 48, the second (12 (m1 + m-1) - (m2 + m-2)
   - 22 m0) / 8, and the third ((m2 - m-2) - 2 (m1 - m-1)) / 2. */
static inline void spsi_profile_along(const spsi_v own[3], const spsi_v outer[2], spsi_parabola *along) {
    const spsi_v near_change = spsi_sub(own[2], own[0]), far_change = spsi_sub(outer[1], outer[0]);
    const spsi_v near_sum = spsi_add(own[2], own[0]), far_sum = spsi_add(outer[1], outer[0]);
    along->value =
        spsi_mul(spsi_set(1.0f / 24), spsi_fma(spsi_set(34), near_change, spsi_mul(spsi_set(-5), far_change)));
    along->slope = spsi_fma(spsi_set(12), near_sum, spsi_mul(spsi_set(-22), own[1]));
    along->slope = spsi_mul(spsi_set(0.25f), spsi_sub(along->slope, far_sum));
    along->bend = spsi_mul(spsi_set(0.5f), spsi_fma(spsi_set(-2), near_change, far_change));
}

/* Spread of the rays in the middle of slab k: its signed distance from the eye in slabs, to which the spacing of
   neighbouring rays is proportional. 1 for parallel rays. */
static float spsi_slab_spread(const spsi_shader *shader, const spsi_tile *tile, int k) {
    const int margin = (tile->slab_count - SPSI_CHUNK) / 2;
    return shader->frame->content->eye.perspective ? (float)(k + margin) + 0.5f - tile->eye_slab : 1;
}

/* Whether the eye is in a slab. The rays meet there, so they have no neighbours. */
static int spsi_slab_has_eye(float spread) { return fabsf(spread) < 0.5f; }

/* The difference in slab k between the neighbours on either side, divided by the rays' spread. With two on each side,
   it is that of the quartic through all of them: (8 (f1 - f-1) - (f2 - f-2)) / 6. In the eye's slab it is the mean of
   those in the slabs before and after. */
static spsi_v spsi_slab_change(const spsi_shader *shader, const spsi_tile *tile, const spsi_pixels *p, int k,
                               int channel, int axis) {
    const spsi_line *near_by = &p->around[2 * axis], *beyond = &p->around[4 + 2 * axis];
    const float spread = spsi_slab_spread(shader, tile, k);
    spsi_v change;
    if (spsi_slab_has_eye(spread))
        return spsi_mul(spsi_set(0.5f), spsi_add(spsi_slab_change(shader, tile, p, k - 1, channel, axis),
                                                 spsi_slab_change(shader, tile, p, k + 1, channel, axis)));
    change = spsi_sub(spsi_mean_value(tile, channel, near_by + 1, k), spsi_mean_value(tile, channel, near_by, k));
    if (shader->frame->gradients.reach >= 2) {
        const spsi_v wide =
            spsi_sub(spsi_mean_value(tile, channel, beyond + 1, k), spsi_mean_value(tile, channel, beyond, k));
        change = spsi_mul(spsi_set(1.0f / 6), spsi_sub(spsi_mul(spsi_set(8), change), wide));
    }
    return spsi_mul(spsi_set(1 / spread), change);
}

/* Twice the derivative per pixel of a slab's mean, from its sheets of slopes. The mean is the sheet's sum divided by
   the ray's path length in the slab, 1 / |slope|, whose relative change is -slope' / slope. */
static inline void spsi_mean_slopes(const spsi_shader *shader, const spsi_tile *tile, int channel,
                                    const spsi_line *line, int k, spsi_v mean, spsi_v slopes[2]) {
    const int margin = (tile->slab_count - SPSI_CHUNK) / 2;
    const float *sheet = tile->sheets + (size_t)spsi_slope_channel(shader->frame, channel) * tile->channel_size +
                         (size_t)(k + margin) * tile->sheet_size +
                         (size_t)((line->y - tile->y0) * tile->pitch + (line->x - tile->x0));
    for (int axis = 0; axis < 2; ++axis) {
        const spsi_v turn = spsi_mul(spsi_mul(mean, line->scale), spsi_set(shader->slab.slope[1 + axis]));
        const spsi_v sum = spsi_mul(spsi_load(sheet + (size_t)axis * tile->channel_size), line->slabs);
        slopes[axis] = spsi_mul(spsi_set(2), spsi_add(sum, turn));
    }
}

/* The lateral differences in slabs k - 1 to k + 1, from the sheets of slopes if there are any. `means`: those of the
   three slabs. */
static void spsi_profile_aside(const spsi_shader *shader, const spsi_tile *tile, const spsi_pixels *p, int k,
                               int channel, const spsi_v means[3], spsi_parabola aside[2]) {
    spsi_v change[3][2];
    for (int n = 0; n < 3; ++n) {
        const spsi_v per_spread = spsi_set(1 / spsi_slab_spread(shader, tile, k + n - 1));
        if (shader->frame->gradients.splatted) /* the eye is not near */
            spsi_mean_slopes(shader, tile, channel, &p->line, k + n - 1, means[n], change[n]);
        for (int axis = 0; axis < 2; ++axis)
            change[n][axis] = shader->frame->gradients.splatted
                                  ? spsi_mul(per_spread, change[n][axis])
                                  : spsi_slab_change(shader, tile, p, k + n - 1, channel, axis);
    }
    for (int axis = 0; axis < 2; ++axis)
        aside[axis] = spsi_parabola_through(change[0][axis], change[1][axis], change[2][axis]);
}

/* A difference vector, in voxels: from one neighbour to the other along x or y, divided by the rays' spread, or (axis
   2) from the slab before to the slab after. */
static void spsi_profile_way(const spsi_shader *shader, const spsi_tile *tile, const spsi_pixels *p, int k, int axis,
                             float per_length, spsi_v way[3]) {
    const int from = axis < 2 && spsi_slab_has_eye(spsi_slab_spread(shader, tile, k)) ? k + 1 : k;
    const float per_spread = axis < 2 ? per_length / spsi_slab_spread(shader, tile, from) : per_length;
    spsi_v place[2][3];
    for (int side = 0; side < 2; ++side)
        spsi_place_in_slab(shader, axis < 2 ? &p->around[2 * axis + side] : &p->line,
                           axis < 2 ? from : k - 1 + 2 * side, place[side]);
    for (int c = 0; c < 3; ++c) way[c] = spsi_mul(spsi_sub(place[1][c], place[0][c]), spsi_set(per_spread));
}

/* The differences along x, y and the ray, and their vectors. These are not perpendicular, so the gradient g is solved
   from vector . g = difference. If they are coplanar there is no gradient. */
static void spsi_profile_gradient(const spsi_shader *shader, const spsi_tile *tile, const spsi_pixels *p, int k,
                                  int channel, const spsi_v means[3], spsi_profile *profile) {
    const float per_length = 1 / shader->frame->matter.materials[channel].voxel_length;
    spsi_v way[3][3], outer[2];
    for (int n = 0; n < 2; ++n) outer[n] = spsi_mean_value(tile, channel, &p->line, k - 2 + 4 * n);
    spsi_profile_along(means, outer, &profile->along);
    spsi_profile_aside(shader, tile, p, k, channel, means, profile->aside);
    for (int axis = 0; axis < 3; ++axis) spsi_profile_way(shader, tile, p, k, axis, per_length, way[axis]);
    for (int i = 0; i < 3; ++i) spsi_cross_v(way[(i + 1) % 3], way[(i + 2) % 3], profile->cofactor[i]);
    profile->determinant = spsi_dot_v(way[0], profile->cofactor[0]);
    profile->determinant = spsi_select(spsi_less(spsi_abs(profile->determinant), spsi_set(FLT_MIN)),
                                       spsi_set(SPSI_INFINITY), profile->determinant);
}

/* A sample's normal, and how much of a surface it is. */
static void spsi_sample_gradient(const spsi_material *material, const spsi_profile *profile,
                                 const spsi_portion *portion, spsi_sample *sample) {
    const float unit = material->table_scale / SPSI_TABLE_SIZE; /* relative to the largest value: squares stay finite */
    const spsi_v scale = spsi_set(unit);
    const spsi_v x = spsi_mul(spsi_parabola_mean(&profile->aside[0], portion), scale);
    const spsi_v y = spsi_mul(spsi_parabola_mean(&profile->aside[1], portion), scale);
    const spsi_v along = spsi_mul(spsi_parabola_mean(&profile->along, portion), scale);
    spsi_v g[3], size;
    for (int c = 0; c < 3; ++c) {
        g[c] = spsi_fma(y, profile->cofactor[1][c], spsi_mul(x, profile->cofactor[0][c]));
        g[c] = spsi_div(spsi_fma(along, profile->cofactor[2][c], g[c]), profile->determinant);
    }
    size = spsi_sqrt(spsi_dot_v(g, g));
    for (int c = 0; c < 3; ++c)
        sample->normal[c] = spsi_div(spsi_sub(spsi_set(0), g[c]), spsi_max(size, spsi_set(FLT_MIN)));
    sample->surface = spsi_min(spsi_mul(size, spsi_set(fminf(material->gradient_scale / unit, FLT_MAX))), spsi_set(1));
    sample->has_normal = 1;
}

/* Fills the parts of a slab for a gas, which is constant within the slab. */
static void spsi_samples_gas(const spsi_material *material, spsi_v value_length, int channel, spsi_slab *slab) {
    const spsi_v sum = spsi_mul(value_length, spsi_set(1.0f / (float)slab->part_count));
    for (int part = 0; part < slab->part_count; ++part) {
        spsi_sample *sample = &slab->samples[part * slab->material_count + channel];
        sample->has_normal = 0;
        sample->surface = spsi_set(0);
        sample->value_length = sum;
        sample->depth = spsi_min(spsi_mul(sum, spsi_set(material->extinction)), spsi_set(SPSI_DEPTH_MAX));
        for (int c = 0; c < 3; ++c) sample->color[c] = spsi_set(material->albedo[c]);
        slab->part_depth[part] = spsi_add(slab->part_depth[part], sample->depth);
    }
}

/* Fills the parts of a slab for a classified volume, which follows its profile. Most slabs that hold values have no
   extinction anywhere: they cost neither colors nor gradients. */
static void spsi_samples_classified(const spsi_shader *shader, const spsi_tile *tile, const spsi_pixels *p, int channel,
                                    spsi_slab *slab) {
    const spsi_material *material = &shader->frame->matter.materials[channel];
    const spsi_v share = spsi_set(1.0f / (float)slab->part_count), zero = spsi_set(0);
    const spsi_v way = spsi_mul(spsi_mul(spsi_sub(slab->leave, slab->enter), p->length), share);
    const int surface = shader->frame->gradients.exist && material->shading == SPS_SHADING_SURFACE;
    spsi_v means[3];
    spsi_profile profile;
    int has_gradient = 0;
    memset(&profile, 0, sizeof profile); /* compilers cannot tell that gradient fields are read only where set */
    for (int n = 0; n < 3; ++n) means[n] = spsi_mean_value(tile, channel, &p->line, slab->k + n - 1);
    profile.value = spsi_parabola_through(means[0], means[1], means[2]);
    for (int part = 0; part < slab->part_count; ++part) {
        spsi_sample *sample = &slab->samples[part * slab->material_count + channel];
        const spsi_portion portion = spsi_portion_of(slab->first, slab->last, part);
        const spsi_v value = spsi_parabola_mean(&profile.value, &portion);
        spsi_v appearance[4] = {zero, zero, zero, zero};
        if (spsi_bits(spsi_less(zero, spsi_classify_extinction(material, value))))
            spsi_classify(material, value, appearance);
        sample->has_normal = 0;
        sample->surface = sample->value_length = zero;
        sample->depth = spsi_min(spsi_mul(appearance[3], way), spsi_set(SPSI_DEPTH_MAX));
        for (int c = 0; c < 3; ++c) sample->color[c] = appearance[c];
        slab->part_depth[part] = spsi_add(slab->part_depth[part], sample->depth);
        if (!surface || !spsi_bits(spsi_less(zero, sample->depth))) continue;
        if (!has_gradient) spsi_profile_gradient(shader, tile, p, slab->k, channel, means, &profile);
        has_gradient = 1;
        spsi_sample_gradient(material, &profile, &portion, sample);
    }
}

/* Blinn-Phong highlight (n + 8) / (8 pi) (n.h)^n, normalised to reflect about what arrives: at perpendicular incidence
   at most 7.5 % more, if the exponent is 9. */
static spsi_v spsi_highlight(spsi_v cosine, float exponent) {
    float lanes[SPSI_LANES];
    spsi_store(lanes, cosine);
    for (int i = 0; i < SPSI_LANES; ++i)
        lanes[i] =
            lanes[i] > 0 ? powf(lanes[i] < 1 ? lanes[i] : 1, exponent) * (exponent + 8) * (float)(0.125 / SPSI_PI) : 0;
    return spsi_load(lanes);
}

/* Radiance that a sample sends towards the eye per unit of its optical depth and of irradiance travelling along
   `travel`. */
static void spsi_sample_response(const spsi_material *material, const spsi_sample *sample, const spsi_v toward[3],
                                 const spsi_v travel[3], spsi_v response[3]) {
    const spsi_v cosine = spsi_sub(spsi_set(0), spsi_dot_v(travel, toward));
    const spsi_v gas = spsi_phase(material, cosine);
    spsi_v halfway[3], facing, diffuse, shine = spsi_set(0);
    if (!sample->has_normal) {
        for (int c = 0; c < 3; ++c) response[c] = spsi_mul(sample->color[c], gas);
        return;
    }
    facing = spsi_max(spsi_set(0), spsi_sub(spsi_set(0), spsi_dot_v(sample->normal, travel)));
    if (material->specular > 0) {
        spsi_v size;
        for (int c = 0; c < 3; ++c) halfway[c] = spsi_sub(spsi_set(0), spsi_add(travel[c], toward[c]));
        size = spsi_sqrt(spsi_max(spsi_dot_v(halfway, halfway), spsi_set(1e-12f)));
        shine = spsi_highlight(spsi_div(spsi_dot_v(sample->normal, halfway), size), material->shininess);
        shine = spsi_mul(spsi_mul(shine, facing), spsi_mul(sample->surface, spsi_set(material->specular)));
    }
    diffuse = spsi_mix(gas, spsi_mul(facing, spsi_set((float)(1 / SPSI_PI))), sample->surface);
    for (int c = 0; c < 3; ++c) response[c] = spsi_fma(sample->color[c], diffuse, shine);
}

/* atan2(y, x) for y >= 0: 0 to pi. [Abramowitz & Stegun 1964, 4.4.49] */
static inline spsi_v spsi_angle(spsi_v x, spsi_v y) {
    const spsi_v size = spsi_abs(x), most = spsi_max(spsi_max(size, y), spsi_set(FLT_MIN));
    const spsi_v ratio = spsi_div(spsi_min(size, y), most), square = spsi_mul(ratio, ratio);
    spsi_v p = spsi_set(0.0028662257f);
    p = spsi_fma(p, square, spsi_set(-0.0161657367f));
    p = spsi_fma(p, square, spsi_set(0.0429096138f));
    p = spsi_fma(p, square, spsi_set(-0.0752896400f));
    p = spsi_fma(p, square, spsi_set(0.1065626393f));
    p = spsi_fma(p, square, spsi_set(-0.1420889944f));
    p = spsi_fma(p, square, spsi_set(0.1999355085f));
    p = spsi_fma(p, square, spsi_set(-0.3333314528f));
    p = spsi_mul(ratio, spsi_fma(p, square, spsi_set(1)));
    p = spsi_select(spsi_less(size, y), spsi_sub(spsi_set((float)(SPSI_PI / 2)), p), p);
    return spsi_select(spsi_less(x, spsi_set(0)), spsi_sub(spsi_set((float)SPSI_PI), p), p);
}

/* The mean of 1 / r^2 along a segment of a ray, r being the distance from a point: the angle that the segment subtends
   at the point, divided by its length 2 h and by the ray's distance q from the point. If s is the distance along the
   ray from its nearest point to the segment's middle, this is the angle of the vector (q^2 + s^2 - h^2, 2 h q). Small
   angles use their series, which does not divide by q. [d(angle) = q ds / r^2] */
static spsi_v spsi_mean_inverse_square(spsi_v q, spsi_v s, spsi_v h) {
    const spsi_v x = spsi_fma(q, q, spsi_mul(spsi_sub(s, h), spsi_add(s, h)));
    const spsi_v y = spsi_max(spsi_mul(spsi_mul(h, q), spsi_set(2)), spsi_set(FLT_MIN * 16));
    const spsi_v tangent = spsi_div(y, spsi_max(x, y)); /* of small angles */
    const spsi_m small = spsi_less(y, spsi_mul(spsi_set(0.1f), x));
    const spsi_v series = spsi_div(spsi_fma(spsi_mul(tangent, tangent), spsi_set(-1.0f / 3), spsi_set(1)), x);
    if (spsi_bits(small) == spsi_bits(spsi_less(spsi_set(-1), spsi_set(0)))) return series;
    return spsi_select(small, series, spsi_div(spsi_angle(x, y), y));
}

/* A point light's 1 / r^2 is infinite on a ray through the light, and its mean over a part grows as 1 / q. A pixel's
   area makes that finite: over a square pixel around the light, 1 / q has the mean 4 log(1 + sqrt 2). So a ray that
   passes nearer than the reciprocal of this, in pixels, is treated as passing at that distance. */
#define SPSI_LAMP_PIXELS 0.28364f

/* World size of a pixel at depth d. */
static inline spsi_v spsi_pixel_size(const spsi_rays *rays, spsi_v d) {
    const spsi_v size = spsi_set((float)spsi_pixel_size_at(rays, 1));
    return rays->perspective
               ? spsi_mul(spsi_max(spsi_add(d, spsi_set((float)rays->depth_reference)), spsi_set(0)), size)
               : size;
}

/* Light at a part of a slab, before any shadow. */
typedef struct spsi_incident {
    spsi_v travel[3];     /* unit direction in which it travels */
    spsi_v irradiance[3]; /* mean over the part, per unit of the light's color; all the same without an image */
} spsi_incident;

/* A part of a slab as seen from a light. */
typedef struct spsi_reach {
    spsi_v middle[3]; /* from the light */
    spsi_v half;      /* half of its length along the eye's ray */
    spsi_v pixel;     /* world size of a pixel */
} spsi_reach;

static void spsi_reach_build(const spsi_shader *shader, const spsi_lamp *lamp, const spsi_pixels *p,
                             const spsi_part *part, spsi_reach *reach) {
    reach->half = spsi_mul(part->half, p->length);
    reach->pixel = spsi_pixel_size(&shader->frame->content->eye, part->middle);
    spsi_position_at(shader, p->line.at, (float)p->line.y, part->middle, reach->middle);
    for (int i = 0; i < 3; ++i)
        reach->middle[i] =
            spsi_add(reach->middle[i], spsi_set((float)(shader->position_origin[i] - lamp->position[i])));
}

/* The direction in which light travels at a part. To a light with a position, equal angles along the part have equal
   weight, so the ray that halves the angle stands for all. */
static void spsi_lamp_travel(const spsi_lamp *lamp, const spsi_pixels *p, const spsi_reach *reach, spsi_v travel[3]) {
    spsi_v ends[2][3], square;
    if (!lamp->is_point) {
        spsi_set3(lamp->direction, travel);
        return;
    }
    for (int end = 0; end < 2; ++end) {
        for (int i = 0; i < 3; ++i)
            ends[end][i] =
                spsi_fma(reach->half, end ? p->toward[i] : spsi_sub(spsi_set(0), p->toward[i]), reach->middle[i]);
        square = spsi_max(spsi_dot_v(ends[end], ends[end]), spsi_set(FLT_MIN));
        for (int i = 0; i < 3; ++i) ends[end][i] = spsi_div(ends[end][i], spsi_sqrt(square));
    }
    for (int i = 0; i < 3; ++i) travel[i] = spsi_add(ends[0][i], ends[1][i]);
    square = spsi_max(spsi_dot_v(travel, travel), spsi_set(FLT_MIN));
    for (int i = 0; i < 3; ++i) travel[i] = spsi_div(travel[i], spsi_sqrt(square));
}

/* The mean of 1 / r^2 over a part, with a pixel's area taken into account. */
static spsi_v spsi_lamp_falloff(const spsi_pixels *p, const spsi_reach *reach) {
    const spsi_v s = spsi_dot_v(reach->middle, p->toward), beside = spsi_mul(reach->pixel, spsi_set(SPSI_LAMP_PIXELS));
    spsi_v foot[3];
    for (int i = 0; i < 3; ++i) foot[i] = spsi_sub(reach->middle[i], spsi_mul(s, p->toward[i]));
    return spsi_mean_inverse_square(spsi_max(beside, spsi_sqrt(spsi_dot_v(foot, foot))), s, reach->half);
}

#define SPSI_IMAGE_STEPS 4 /* lookups of an image along a part of a slab */

/* Colors the light at a part by the mean of the light's image along it. Pixels are at least as large as a step across
   the light's rays: what lies between lookups would show as moire. */
static void spsi_incident_color(const spsi_frame *frame, const spsi_lamp *lamp, const spsi_pixels *p,
                                const spsi_reach *reach, spsi_incident *incident) {
    const spsi_v share = spsi_set(1.0f / SPSI_IMAGE_STEPS), cosine = spsi_dot_v(p->toward, incident->travel);
    const spsi_v sine = spsi_sqrt(spsi_max(spsi_sub(spsi_set(1), spsi_mul(cosine, cosine)), spsi_set(0)));
    const spsi_v step = spsi_mul(spsi_mul(reach->half, sine), spsi_set(2.0f / SPSI_IMAGE_STEPS));
    spsi_v color[3] = {spsi_set(0), spsi_set(0), spsi_set(0)};
    for (int n = 0; n < SPSI_IMAGE_STEPS; ++n) {
        const spsi_v along = spsi_mul(reach->half, spsi_set((2 * (float)n + 1) / SPSI_IMAGE_STEPS - 1));
        spsi_v at[3], here[3];
        for (int i = 0; i < 3; ++i) at[i] = spsi_fma(along, p->toward[i], reach->middle[i]);
        spsi_projection_lookup(frame, lamp, at, spsi_max(reach->pixel, step), here);
        for (int c = 0; c < 3; ++c) color[c] = spsi_fma(share, here[c], color[c]);
    }
    for (int c = 0; c < 3; ++c) incident->irradiance[c] = spsi_mul(incident->irradiance[c], color[c]);
}

/* Light from a point of a light at a part of a slab. */
static void spsi_lamp_point_at(const spsi_shader *shader, const spsi_lamp *lamp, const spsi_pixels *p,
                               const spsi_part *part, spsi_incident *incident) {
    const spsi_frame *frame = shader->frame;
    spsi_v axis[3], irradiance = spsi_set(1);
    spsi_reach reach;
    for (int c = 0; c < 3; ++c) incident->irradiance[c] = irradiance;
    if (!lamp->is_point && !lamp->projection.exists) { /* the same everywhere */
        spsi_set3(lamp->direction, incident->travel);
        return;
    }
    spsi_reach_build(shader, lamp, p, part, &reach);
    if (lamp->falls_off) irradiance = spsi_lamp_falloff(p, &reach);
    spsi_lamp_travel(lamp, p, &reach, incident->travel);
    if (lamp->cone.exists) {
        spsi_set3(lamp->direction, axis);
        irradiance = spsi_mul(irradiance, spsi_cone_share(&lamp->cone, spsi_dot_v(axis, incident->travel)));
    }
    for (int c = 0; c < 3; ++c) incident->irradiance[c] = irradiance;
    if (lamp->projection.exists) spsi_incident_color(frame, lamp, p, &reach, incident);
}

/* The same from a light with an extent: the direction from its centre, and the mean irradiance of its points. */
static void spsi_lamp_at(const spsi_shader *shader, const spsi_lamp *lamp, const spsi_pixels *p, const spsi_part *part,
                         spsi_incident *incident) {
    const spsi_v share = spsi_set(1.0f / (float)lamp->few_count);
    spsi_v sum[3] = {spsi_set(0), spsi_set(0), spsi_set(0)};
    spsi_reach reach;
    if (lamp->few_count == 1) {
        spsi_lamp_point_at(shader, lamp, p, part, incident);
        return;
    }
    for (int i = 0; i < lamp->few_count; ++i) {
        spsi_lamp_point_at(shader, &lamp->few[i], p, part, incident);
        for (int c = 0; c < 3; ++c) sum[c] = spsi_add(sum[c], incident->irradiance[c]);
    }
    spsi_reach_build(shader, lamp, p, part, &reach);
    spsi_lamp_travel(lamp, p, &reach, incident->travel);
    for (int c = 0; c < 3; ++c) incident->irradiance[c] = spsi_mul(sum[c], share);
}

/* Adds one light's contribution from all samples of a part to radiance. `carried`: mean transmittance between light and
   eye, times the lit share, by color. */
static void spsi_add_lamp(const spsi_shader *shader, const spsi_pixels *p, const spsi_part *part, const spsi_lamp *lamp,
                          const spsi_v carried[3], spsi_v radiance[3]) {
    spsi_incident incident;
    spsi_lamp_at(shader, lamp, p, part, &incident);
    for (int c = 0; c < 3; ++c) incident.irradiance[c] = spsi_mul(incident.irradiance[c], carried[c]);
    for (int m = 0; m < shader->frame->matter.material_count; ++m) {
        const spsi_material *material = &shader->frame->matter.materials[m];
        spsi_v response[3];
        if (!material->scatters) continue;
        spsi_sample_response(material, &part->samples[m], p->toward, incident.travel, response);
        for (int c = 0; c < shader->frame->channels; ++c) {
            const spsi_v share = spsi_mul(incident.irradiance[c], part->samples[m].depth);
            radiance[c] =
                spsi_add(radiance[c], spsi_min(spsi_mul(spsi_mul(share, response[c]), spsi_set(lamp->color[c])),
                                               spsi_set(SPSI_RADIANCE_MAX)));
        }
    }
}

/* The share of each part of a ray's path through a slab that polygons leave lit. A shadow's edge may cross the path at
   a slant, so one lookup for all of it would not do. */
static void spsi_lit_shares(const spsi_shader *shader, const spsi_depth_map *map, const spsi_pixels *p,
                            const spsi_slab *slab, spsi_v lit[SPSI_PARTS]) {
    const int backwards = shader->sweep->back_to_front;
    const spsi_v from = backwards ? slab->leave : slab->enter, to = backwards ? slab->enter : slab->leave;
    const spsi_v step = spsi_mul(spsi_sub(to, from), spsi_set(1.0f / SPSI_PARTS));
    for (int i = 0; i < SPSI_PARTS; ++i) lit[i] = spsi_set(1);
    for (int face = 0; face < map->face_count; ++face) {
        if (!spsi_depth_map_may_shade(map, face, p->line.at, (float)p->line.y, from, to)) continue;
        for (int i = 0; i < SPSI_PARTS; ++i) {
            const spsi_v d0 = spsi_fma(step, spsi_set((float)i), from), d1 = spsi_add(d0, step);
            lit[i] = spsi_min(lit[i], spsi_depth_map_share(map, face, p->line.at, (float)p->line.y, d0, d1));
        }
    }
    if (slab->part_count > 1) return;
    for (int i = 1; i < SPSI_PARTS; ++i) lit[0] = spsi_add(lit[0], lit[i]);
    lit[0] = spsi_mul(lit[0], spsi_set(1.0f / SPSI_PARTS));
}

/* Optical depth from a light to the rays' points at depth d, on plane k. */
static inline spsi_v spsi_pixels_shadow(const spsi_shadow *shadow, const spsi_pixels *p, int k, spsi_v d) {
    spsi_v at[3];
    for (int i = 0; i < 3; ++i)
        at[i] = spsi_fma(d, spsi_linear_slope(&shadow->along[i], p->line.at, (float)p->line.y),
                         spsi_linear_base(&shadow->along[i], p->line.at, (float)p->line.y));
    return spsi_shadow_lookup(shadow, at, k);
}

/* Whether the light at the last lookup serves a slab, too. */
static int spsi_slab_skips(const spsi_shader *shader, const spsi_slab *slab, spsi_arrival *arrival) {
    const spsi_v most = spsi_set(shader->frame->view.lookup_threshold);
    if (!(shader->frame->view.lookup_threshold > 0) || arrival->plane < 0) return 0;
    arrival->skipped = spsi_add(arrival->skipped, slab->depth);
    return spsi_bits(spsi_less(most, arrival->skipped)) == 0;
}

/* Looks up one light where the ray enters and leaves a slab. */
static void spsi_slab_light(const spsi_shader *shader, const spsi_shadow *shadow, const spsi_pixels *p,
                            const spsi_slab *slab, spsi_arrival *arrival) {
    spsi_v a0 = arrival->plane_light, a1 = a0;
    if (!spsi_slab_skips(shader, slab, arrival)) {
        a1 = spsi_pixels_shadow(shadow, p, slab->k + 1, spsi_plane_depth(&p->line, slab->k + 1));
        if (arrival->plane != slab->k) a0 = spsi_pixels_shadow(shadow, p, slab->k, spsi_plane_depth(&p->line, slab->k));
        arrival->plane = slab->k + 1;
        arrival->plane_light = a1;
        arrival->skipped = spsi_set(0);
    }
    arrival->light[0] = spsi_mix(a0, a1, slab->first);
    arrival->light[1] = spsi_mix(a0, a1, slab->last);
    spsi_lit_shares(shader, &shadow->depth_map, p, slab, arrival->lit);
}

/* The share of a part that opaque polygons leave lit. */
static spsi_v spsi_part_lit(const spsi_arrival *arrival, const spsi_part *part) {
    const spsi_v lit = arrival->lit[part->number], way = spsi_sub(part->cut[1], part->cut[0]);
    if (!part->is_cut) return lit;
    return spsi_clamp(spsi_div(spsi_sub(lit, part->cut[0]), spsi_max(way, spsi_set(FLT_MIN))), spsi_set(0),
                      spsi_set(1));
}

/* What translucent polygons let pass from a light to a part, by color: the mean over the light's points, and over steps
   along a part that is a whole slab. */
static void spsi_part_filter(const spsi_shader *shader, const spsi_shadow *shadow, const spsi_pixels *p,
                             const spsi_part *part, spsi_v filter[3]) {
    const int steps = shader->frame->matter.classifies ? 1 : SPSI_PARTS;
    const spsi_v from = spsi_sub(part->middle, part->half);
    const spsi_v step = spsi_mul(part->half, spsi_set(2.0f / (float)steps));
    spsi_v sum[3] = {spsi_set(0), spsi_set(0), spsi_set(0)};
    for (int i = 0; i < shadow->pane_map_count * steps; ++i) {
        const float n = (float)(i % steps);
        const spsi_v d[2] = {spsi_fma(step, spsi_set(n), from), spsi_fma(step, spsi_set(n + 1), from)};
        spsi_pane_map_filter(&shadow->pane_maps[i / steps], shader->faces, p->line.at, (float)p->line.y, d, filter);
        for (int c = 0; c < 3; ++c) sum[c] = spsi_add(sum[c], filter[c]);
    }
    for (int c = 0; c < 3; ++c) filter[c] = spsi_mul(sum[c], spsi_set(1.0f / (float)(shadow->pane_map_count * steps)));
}

/* Adds one of the lights that the sweep carries, attenuated by its planes or its map, cut off by opaque polygons and
   filtered by translucent ones. Within a slab, optical depth towards the light and towards the eye grow in proportion:
   both come from the same matter. */
static void spsi_add_shadowed(const spsi_shader *shader, const spsi_shadow *shadow, const spsi_arrival *arrival,
                              const spsi_pixels *p, const spsi_part *part, spsi_v radiance[3]) {
    const spsi_v lit = spsi_part_lit(arrival, part), end_share = spsi_mix(part->first, part->last, lit);
    spsi_v start, end, carried[3], filter[3];
    if (!spsi_bits(spsi_less(spsi_set(0), lit))) return;
    start = spsi_add(spsi_mix(arrival->light[0], arrival->light[1], part->first), part->before);
    end = spsi_add(spsi_mix(arrival->light[0], arrival->light[1], end_share), spsi_mix(part->before, part->after, lit));
    carried[0] = carried[1] = carried[2] = spsi_mul(lit, spsi_mean_transmittance(start, end));
    if (shadow->pane_map_count > 0) {
        spsi_part_filter(shader, shadow, p, part, filter);
        for (int c = 0; c < 3; ++c) carried[c] = spsi_mul(carried[c], filter[c]);
    }
    spsi_add_lamp(shader, p, part, shadow->lamp, carried, radiance);
}

/* Adds ambient light, emission, and the lights that cast no shadows. */
static void spsi_add_unshadowed(const spsi_shader *shader, const spsi_pixels *p, const spsi_part *part,
                                spsi_v radiance[3]) {
    const spsi_v mean = spsi_mean_transmittance(part->before, part->after), carried[3] = {mean, mean, mean};
    for (int m = 0; m < shader->frame->matter.material_count; ++m) {
        const spsi_material *material = &shader->frame->matter.materials[m];
        const spsi_sample *sample = &part->samples[m];
        for (int c = 0; c < shader->frame->channels; ++c) {
            spsi_v sent = spsi_set(0);
            if (material->scatters && shader->frame->ambient.exists)
                sent =
                    spsi_mul(spsi_mul(sample->depth, sample->color[c]), spsi_set(shader->frame->ambient.radiance[c]));
            if (material->emits) sent = spsi_fma(sample->value_length, spsi_set(material->emission[c]), sent);
            radiance[c] = spsi_fma(spsi_min(sent, spsi_set(SPSI_RADIANCE_MAX)), mean, radiance[c]);
        }
    }
    for (int i = 0; i < shader->frame->lamps.count; ++i)
        if (!shader->frame->lamps.list[i].shadows)
            spsi_add_lamp(shader, p, part, &shader->frame->lamps.list[i], carried, radiance);
}

/* --- polygons: per pixel, in double precision --- */

/* Irradiance on a surface per unit of a light's color, before any shadow: all three numbers are the same without an
   image. Only the shading normal decides which side is lit; testing the facet as well would draw its outline where
   light grazes a curved mesh. Returns 0 if there is none. */
static int spsi_surface_point_irradiance(const spsi_frame *frame, const spsi_lamp *lamp, const spsi_surface *surface,
                                         double irradiance[3]) {
    double toward[3], square, cosine;
    irradiance[0] = irradiance[1] = irradiance[2] = 0;
    spsi_toward_lamp(lamp, surface->point, toward);
    cosine = spsi_dot(surface->normal, toward);
    if (!(cosine > 0)) return 0;
    square = fmax(spsi_dot(toward, toward), DBL_MIN);
    cosine /= sqrt(square) * spsi_length(surface->normal);
    if (lamp->falls_off) cosine /= square;
    if (lamp->is_point) cosine *= spsi_cone_at(&lamp->cone, -spsi_dot(lamp->direction, toward) / sqrt(square));
    irradiance[0] = irradiance[1] = irradiance[2] = 1;
    if (lamp->projection.exists) spsi_projection_at(frame, lamp, surface->point, surface->pixel, irradiance);
    for (int c = 0; c < 3; ++c) irradiance[c] *= cosine;
    return irradiance[0] > 0 || irradiance[1] > 0 || irradiance[2] > 0;
}

/* The same from all points of a light. */
static int spsi_surface_irradiance(const spsi_frame *frame, const spsi_lamp *lamp, const spsi_surface *surface,
                                   double irradiance[3]) {
    double sum[3] = {0, 0, 0};
    int any = 0;
    for (int i = 0; i < lamp->point_count; ++i) {
        any |= spsi_surface_point_irradiance(frame, &lamp->points[i], surface, irradiance);
        for (int c = 0; c < 3; ++c) sum[c] += irradiance[c];
    }
    for (int c = 0; c < 3; ++c) irradiance[c] = sum[c] / lamp->point_count;
    return any;
}

#define SPSI_SIGHT_BLOCK 4  /* pixels along a side of a block, whose rays form a packet */
#define SPSI_SIGHT_TILE  32 /* pixels along a side of a task's tile, whose rays meet much the same boxes and faces */

typedef struct spsi_sight_job {
    const spsi_frame *frame;
    const spsi_faces *faces;
    const spsi_visible *visible;
    const spsi_lamp *lamp;
    float *lit;     /* per place: spsi_lit_channels shares of a light's irradiance that polygons let pass */
    uint64_t *rays; /* per worker: number of rays */
} spsi_sight_job;

/* Places whose rays form a packet: those of a block of pixels, or of layers that follow each other. */
typedef struct spsi_sight_surfaces {
    int facing; /* bit mask of places */
    size_t index[SPSI_PACKET];
    spsi_surface at[SPSI_PACKET];
    int face[SPSI_PACKET];
    double all[SPSI_PACKET][3], seen[SPSI_PACKET][3]; /* irradiance without polygons' shadows, and with them */
} spsi_sight_surfaces;

/* Shares per place that a light's sight needs: where each point of it throws the image to a place of its own, a polygon
   keeps off a share of each color, as translucent ones do. */
static int spsi_lit_channels(const spsi_frame *frame, const spsi_lamp *lamp) {
    return frame->meshes.translucent || (lamp->projection.exists && lamp->point_count > 1) ? 3 : 1;
}

/* Traces rays from a block's polygons to one point of the light. Returns their number. */
static int spsi_sight_point(const spsi_sight_job *job, const spsi_lamp *point, spsi_sight_surfaces *block) {
    spsi_packet packet;
    double toward[3], irradiance[SPSI_PACKET][3];
    int rays = 0, open;
    spsi_packet_begin(job->faces, !point->is_point, 1, &packet);
    for (int at = 0; at < SPSI_PACKET; ++at) {
        if (!(block->facing >> at & 1)) continue;
        if (!spsi_surface_point_irradiance(job->frame, point, &block->at[at], irradiance[at])) continue;
        spsi_toward_lamp(point, block->at[at].start, toward);
        spsi_packet_add(&job->faces->tree, at, block->face[at], block->at[at].start, toward, &packet);
        for (int c = 0; c < 3; ++c) block->all[at][c] += irradiance[at][c];
        rays += 1;
    }
    open = packet.open;
    if (!open) return 0;
    spsi_packet_trace(job->faces, &packet);
    open &= packet.open;
    for (int at = 0; at < SPSI_PACKET; ++at) {
        double through[3] = {1, 1, 1};
        if (packet.filtered >> at & 1) spsi_packet_through(&packet, at, through);
        for (int c = 0; c < 3 && open >> at & 1; ++c) block->seen[at][c] += through[c] * irradiance[at][c];
    }
    return rays;
}

/* Stores the shares that are lit at a place. A single point is seen or not, whatever its color. */
static void spsi_sight_store(const spsi_sight_job *job, size_t index, const double all[3], const double seen[3]) {
    const int channels = spsi_lit_channels(job->frame, job->lamp);
    float *lit = job->lit + (size_t)channels * index;
    if (channels == 1 && job->lamp->projection.exists) {
        lit[0] = (float)(seen[0] > 0 || seen[1] > 0 || seen[2] > 0);
        return;
    }
    for (int c = 0; c < channels; ++c) lit[c] = seen[c] > 0 ? (float)(seen[c] / all[c]) : 0;
}

/* Adds a place to a block. */
static void spsi_sight_add(const spsi_sight_job *job, const spsi_place *place, int at, spsi_sight_surfaces *block) {
    spsi_surface_at(&job->frame->content->eye, job->faces, place->hit, place->at[0], place->at[1], &block->at[at]);
    block->face[at] = place->hit->face;
    block->index[at] = place->index;
    block->facing |= 1 << at;
}

/* Traces the shadow rays of a block. Returns their number. */
static int spsi_sight_trace(const spsi_sight_job *job, spsi_sight_surfaces *block) {
    int rays = 0;
    for (int i = 0; i < job->lamp->point_count && block->facing; ++i)
        rays += spsi_sight_point(job, &job->lamp->points[i], block);
    for (int at = 0; at < SPSI_PACKET; ++at)
        if (block->facing >> at & 1) spsi_sight_store(job, block->index[at], block->all[at], block->seen[at]);
    return rays;
}

/* The same for a block of pixels, as far as they are in the region. */
static int spsi_sight_block(const spsi_sight_job *job, int x0, int y0) {
    const int width = job->frame->content->eye.width, *region = job->frame->view.region;
    const int x1 = spsi_least(region[0] + region[2], x0 + SPSI_SIGHT_BLOCK);
    const int y1 = spsi_least(region[1] + region[3], y0 + SPSI_SIGHT_BLOCK);
    spsi_sight_surfaces block;
    memset(&block, 0, sizeof block);
    for (int y = spsi_most(y0, region[1]); y < y1; ++y)
        for (int x = spsi_most(x0, region[0]); x < x1; ++x) {
            spsi_place place;
            if (job->visible->hits[(size_t)y * (size_t)width + (size_t)x].face < 0) continue;
            spsi_place_of_pixel(job->frame, job->visible, x, y, &place);
            spsi_sight_add(job, &place, (y - y0) * SPSI_SIGHT_BLOCK + x - x0, &block);
        }
    return spsi_sight_trace(job, &block);
}

/* The same for layers that follow each other. */
static void spsi_sight_layers_task(void *data, int index, int worker) {
    const spsi_sight_job *job = (const spsi_sight_job *)data;
    const size_t first = (size_t)index * SPSI_PACKET;
    const int count =
        (int)(job->visible->layers.count - first < SPSI_PACKET ? job->visible->layers.count - first : SPSI_PACKET);
    spsi_sight_surfaces block;
    memset(&block, 0, sizeof block);
    for (int i = 0; i < count; ++i) {
        spsi_place place;
        spsi_place_of_layer(job->frame, job->visible, first + (size_t)i, &place);
        if (spsi_in_region(job->frame, place.x, place.y)) spsi_sight_add(job, &place, i, &block);
    }
    job->rays[worker] += (uint64_t)spsi_sight_trace(job, &block);
}

/* Number of tiles of the image that a region's columns or rows touch. */
static int spsi_sight_tiles(int first, int pixels) {
    return (first + pixels - 1) / SPSI_SIGHT_TILE - first / SPSI_SIGHT_TILE + 1;
}

/* Traces a tile, block by block. Blocks are aligned to the image, not to the region, since within round-off the rays
   that share a packet decide which faces each is tested against. */
static void spsi_sight_task(void *data, int index, int worker) {
    const spsi_sight_job *job = (const spsi_sight_job *)data;
    const int *region = job->frame->view.region;
    const int columns = spsi_sight_tiles(region[0], region[2]);
    const int x0 = (region[0] / SPSI_SIGHT_TILE + index % columns) * SPSI_SIGHT_TILE;
    const int y0 = (region[1] / SPSI_SIGHT_TILE + index / columns) * SPSI_SIGHT_TILE;
    for (int y = y0; y < y0 + SPSI_SIGHT_TILE; y += SPSI_SIGHT_BLOCK)
        for (int x = x0; x < x0 + SPSI_SIGHT_TILE; x += SPSI_SIGHT_BLOCK)
            job->rays[worker] += (uint64_t)spsi_sight_block(job, x, y);
}

/* Finds the share of a light that reaches each place: an exact ray for each point of the light that the polygon faces.
   All pixels have the same points: turning them from pixel to pixel would trade the steps of a penumbra
   for noise, which neither a filter nor the next frame of an animation could tell from the picture. */
static void spsi_sight(sps_context *context, const spsi_frame *frame, const spsi_faces *faces,
                       const spsi_visible *visible, const spsi_lamp *lamp, uint64_t *rays, float *lit) {
    const int *region = frame->view.region;
    const double start = spsi_clock(context);
    spsi_sight_job job;
    job.frame = frame;
    job.faces = faces;
    job.visible = visible;
    job.lamp = lamp;
    job.lit = lit;
    job.rays = rays;
    memset(job.lit, 0, spsi_place_count(frame, visible) * (size_t)spsi_lit_channels(frame, lamp) * sizeof *lit);
    memset(job.rays, 0, (size_t)spsi_worker_count(context) * sizeof *rays);
    spsi_parallel(context, spsi_sight_tiles(region[0], region[2]) * spsi_sight_tiles(region[1], region[3]),
                  spsi_sight_task, &job);
    spsi_parallel(context, (int)((visible->layers.count + SPSI_PACKET - 1) / SPSI_PACKET), spsi_sight_layers_task,
                  &job);
    for (int i = 0; i < spsi_worker_count(context); ++i) context->stats.shadow_rays += rays[i];
    context->stats.seconds_shadow_rays += spsi_clock(context) - start;
}

/* The sweep's shadow of a light; NULL: it belongs to another sweep, or the light casts none. */
static const spsi_shadow *spsi_shadow_of(const spsi_shader *shader, const spsi_lamp *lamp) {
    for (int i = 0; i < shader->shadow_count; ++i)
        if (shader->shadows[i].lamp == lamp) return &shader->shadows[i];
    return NULL;
}

/* The shares of a light's irradiance that polygons let pass to a place. Returns 0 if there is none. */
static int spsi_surface_lit(const spsi_frame *frame, const spsi_shadow *shadow, size_t index, double lit[3]) {
    const size_t channels = (size_t)spsi_lit_channels(frame, shadow->lamp);
    const float *from = shadow->lit + index * channels;
    for (size_t c = 0; c < 3; ++c) lit[c] = (double)from[channels == 3 ? c : 0];
    return lit[0] > 0 || lit[1] > 0 || lit[2] > 0;
}

static void spsi_surface_radiance(const spsi_shader *shader, const spsi_place *place, float radiance[3]) {
    const spsi_frame *frame = shader->frame;
    spsi_appearance look;
    spsi_surface surface;
    spsi_surface_at(&frame->content->eye, shader->faces, place->hit, place->at[0], place->at[1], &surface);
    spsi_appearance_at(shader->faces, place->hit, spsi_surface_set(frame, shader->visible->set, place), &look);
    for (int c = 0; c < 3; ++c)
        radiance[c] = shader->sweep->first ? (float)look.color[c] * frame->ambient.radiance[c] + look.emission[c] : 0;
    for (int i = 0; i < frame->lamps.count; ++i) {
        const spsi_lamp *lamp = &frame->lamps.list[i];
        const spsi_shadow *shadow = spsi_shadow_of(shader, lamp);
        double arrives[3], lit[3] = {1, 1, 1}, through = 1;
        if (shadow ? !spsi_surface_lit(frame, shadow, place->index, lit) : !shader->sweep->first || lamp->shadows)
            continue;
        if (!spsi_surface_irradiance(frame, lamp, &surface, arrives)) continue;
        if (shadow) through = exp(-spsi_shadow_depth(shadow, shader->first_slab, surface.point));
        for (int c = 0; c < 3; ++c) {
            arrives[c] = arrives[c] / SPSI_PI * lit[c] * through;
            radiance[c] += (float)fmin(look.color[c] * arrives[c] * (double)lamp->color[c], (double)SPSI_RADIANCE_MAX);
        }
    }
}

/* The layers of a vector of pixels that the sweep has not yet reached. */
typedef struct spsi_ahead {
    const spsi_layer *list;
    uint32_t first[SPSI_LANES], end[SPSI_LANES]; /* of each pixel's list, in order of depth */
    int nearest[SPSI_LANES];                     /* 1: `first` is the nearest of all to the eye */
    float depth[SPSI_LANES];                     /* of the next one, t - depth_reference; infinity: none */
    float filter[3][SPSI_LANES];                 /* what layers in front let pass of light from here */
    spsi_v slab;                                 /* slab coordinate of the next one; infinity: none */
} spsi_ahead;

/* Looks at a pixel's next layer, and at what those in front of it let pass. */
static void spsi_ahead_look(const spsi_shader *shader, int lane, spsi_ahead *ahead) {
    const int backwards = shader->sweep->back_to_front, left = ahead->first[lane] < ahead->end[lane];
    const int filtered = backwards ? left : !ahead->nearest[lane];
    ahead->depth[lane] = SPSI_INFINITY;
    if (left) ahead->depth[lane] = ahead->list[backwards ? ahead->end[lane] - 1 : ahead->first[lane]].hit.depth;
    for (int c = 0; c < 3; ++c) {
        ahead->filter[c][lane] = 1;
        if (filtered)
            ahead->filter[c][lane] = ahead->list[(backwards ? ahead->end[lane] : ahead->first[lane]) - 1].behind[c];
    }
}

/* Goes on to the layer after the next one. */
static void spsi_ahead_pass(const spsi_shader *shader, int lane, spsi_ahead *ahead) {
    if (shader->sweep->back_to_front)
        ahead->end[lane] -= 1;
    else
        ahead->first[lane] += 1, ahead->nearest[lane] = 0;
    spsi_ahead_look(shader, lane, ahead);
}

/* Finds the slab coordinates of the next layers. */
static void spsi_ahead_measure(const spsi_shader *shader, const spsi_pixels *p, spsi_ahead *ahead) {
    const spsi_v d = spsi_load(ahead->depth), at = p->line.at, infinity = spsi_set(SPSI_INFINITY);
    const float y = (float)p->line.y;
    ahead->slab = spsi_fma(d, spsi_linear_slope(&shader->slab, at, y), spsi_linear_base(&shader->slab, at, y));
    ahead->slab = spsi_select(spsi_less(d, infinity), ahead->slab, infinity);
}

/* Bit mask of the pixels whose next layer lies before a slab coordinate. */
static int spsi_ahead_before(const spsi_ahead *ahead, float slab) {
    return spsi_bits(spsi_less(ahead->slab, spsi_set(slab)));
}

/* Begins with the layers at or behind a slab coordinate, in the sweep's order. */
static void spsi_ahead_begin(const spsi_shader *shader, const spsi_pixels *p, int width, float low, spsi_ahead *ahead) {
    const spsi_layers *layers = &shader->visible->layers;
    const size_t pixel = (size_t)p->line.y * (size_t)shader->frame->content->eye.width + (size_t)p->line.x;
    ahead->list = layers->list;
    for (int lane = 0; lane < SPSI_LANES; ++lane) {
        ahead->first[lane] = lane < width ? layers->first[pixel + (size_t)lane] : 0;
        ahead->end[lane] = lane < width ? layers->first[pixel + (size_t)lane + 1] : 0;
        ahead->nearest[lane] = 1;
        spsi_ahead_look(shader, lane, ahead);
    }
    spsi_ahead_measure(shader, p, ahead);
    for (int bits = spsi_ahead_before(ahead, low); bits; bits = spsi_ahead_before(ahead, low)) {
        for (int lane = 0; bits >> lane; ++lane)
            if (bits >> lane & 1) spsi_ahead_pass(shader, lane, ahead);
        spsi_ahead_measure(shader, p, ahead);
    }
}

/* What layers in front let pass of light from here: the mean of colors. */
static spsi_v spsi_ahead_mean(const spsi_ahead *ahead) {
    const spsi_v sum = spsi_add(spsi_load(ahead->filter[0]), spsi_load(ahead->filter[1]));
    return spsi_mul(spsi_add(sum, spsi_load(ahead->filter[2])), spsi_set(1.0f / 3));
}

/* Composites what surfaces send towards the eye, of which `share` is the part of what is behind that they cover, at
   depth d. */
static void spsi_add_sent(const spsi_shader *shader, const spsi_pixels *p, float sent[3][SPSI_LANES], spsi_v open,
                          spsi_v share, spsi_v d, spsi_gathered *sum) {
    const spsi_v t = spsi_add(d, spsi_set((float)shader->frame->content->eye.depth_reference));
    const spsi_v way = spsi_select(spsi_less(spsi_set(0), share), spsi_mul(t, p->length), spsi_set(0));
    for (int c = 0; c < shader->frame->channels; ++c)
        sum->radiance[c] = spsi_fma(spsi_load(sent[c]), open, sum->radiance[c]);
    sum->distance = spsi_fma(share, way, sum->distance);
}

/* Composites the next layers of some pixels, given as a bit mask, and passes them. Front to back, a ray that its last
   layer has covered in all colors becomes opaque. */
static void spsi_add_layers(const spsi_shader *shader, const spsi_pixels *p, int bits, spsi_ahead *ahead,
                            spsi_gathered *sum) {
    const int backwards = shader->sweep->back_to_front;
    const spsi_v open = backwards ? spsi_set(1) : spsi_exp(spsi_sub(spsi_set(0), sum->depth)),
                 d = spsi_load(ahead->depth);
    float sent[3][SPSI_LANES] = {{0}}, covered[SPSI_LANES] = {0}, opaque[SPSI_LANES] = {0};
    for (int lane = 0; bits >> lane; ++lane) {
        const size_t number = backwards ? ahead->end[lane] - 1 : ahead->first[lane];
        const spsi_layer *layer = &ahead->list[number];
        spsi_place place;
        float radiance[3];
        if (!(bits >> lane & 1)) continue;
        spsi_place_of_layer(shader->frame, shader->visible, number, &place);
        spsi_surface_radiance(shader, &place, radiance);
        for (int c = 0; c < 3; ++c) sent[c][lane] = radiance[c] * layer->seen[c];
        covered[lane] = layer->covered;
        spsi_ahead_pass(shader, lane, ahead);
        if (!backwards && ahead->first[lane] == ahead->end[lane] && spsi_black(layer->behind))
            opaque[lane] = SPSI_DEPTH_MAX;
    }
    spsi_add_sent(shader, p, sent, open, spsi_mul(spsi_load(covered), open), d, sum);
    sum->depth = spsi_min(spsi_add(sum->depth, spsi_load(opaque)), spsi_set(SPSI_DEPTH_MAX));
    spsi_ahead_measure(shader, p, ahead);
}

/* Composites the opaque polygons of a vector of pixels whose slab coordinate lies in [low, high), which makes their
   rays opaque. `ahead`: NULL without layers. */
static void spsi_add_surfaces(const spsi_shader *shader, const spsi_pixels *p, int width, float low, float high,
                              const spsi_ahead *ahead, spsi_gathered *sum) {
    const spsi_m here =
        spsi_and(spsi_less(p->polygon_slab, spsi_set(high)), spsi_less(p->line.polygon, spsi_set(SPSI_INFINITY)));
    const spsi_v before = spsi_set(low), open = spsi_exp(spsi_sub(spsi_set(0), sum->depth));
    const int bits = spsi_bits(here) & ~spsi_bits(spsi_less(p->polygon_slab, before));
    float lanes[3][SPSI_LANES] = {{0}}, opaque[SPSI_LANES] = {0};
    spsi_v share;
    if (!bits) return;
    for (int i = 0; i < width; ++i)
        if (bits >> i & 1) {
            float sent[3];
            spsi_place place;
            spsi_place_of_pixel(shader->frame, shader->visible, p->line.x + i, p->line.y, &place);
            if (place.hit->face < 0) continue; /* an edge: its layers have ended the ray */
            spsi_surface_radiance(shader, &place, sent);
            for (int c = 0; c < 3; ++c) lanes[c][i] = ahead ? sent[c] * ahead->filter[c][i] : sent[c];
            opaque[i] = SPSI_DEPTH_MAX;
        }
    share = spsi_select(spsi_less(spsi_set(0), spsi_load(opaque)), open, spsi_set(0));
    if (ahead) share = spsi_mul(share, spsi_ahead_mean(ahead));
    spsi_add_sent(shader, p, lanes, open, share, p->line.polygon, sum);
    sum->depth = spsi_min(spsi_add(sum->depth, spsi_load(opaque)), spsi_set(SPSI_DEPTH_MAX));
}

/* --- a tile --- */

/* A worker's scratch memory for shading. */
typedef struct spsi_scratch {
    spsi_sample *samples;   /* one per material and part, and one per material of a part that is cut */
    spsi_arrival *arrivals; /* one per shadow */
} spsi_scratch;

/* Number of samples of a worker's scratch memory. */
static int spsi_scratch_samples(const spsi_frame *frame) { return frame->matter.material_count * (SPSI_PARTS + 1); }

/* Reads slab k of a vector of pixels. Returns 0 if it holds nothing. */
static int spsi_slab_build(const spsi_shader *shader, const spsi_tile *tile, const spsi_pixels *p, int k,
                           spsi_slab *slab) {
    const int margin = (tile->slab_count - SPSI_CHUNK) / 2, count = slab->material_count;
    const size_t at = (size_t)(k + margin) * tile->sheet_size +
                      (size_t)((p->line.y - tile->y0) * tile->pitch + (p->line.x - tile->x0));
    const spsi_v zero = spsi_set(0), whole = spsi_abs(p->line.scale);
    spsi_v any = zero, way;
    for (int m = 0; m < count; ++m) any = spsi_max(any, spsi_load(tile->sheets + (size_t)m * tile->channel_size + at));
    if (!spsi_bits(spsi_less(zero, any))) return 0;
    slab->k = k;
    spsi_slab_range(shader, &p->line, k, &slab->enter, &slab->leave);
    way = spsi_sub(slab->leave, slab->enter);
    if (!spsi_bits(spsi_less(zero, way))) return 0;
    slab->first = zero;
    slab->last = spsi_set(1);
    if (spsi_bits(spsi_less(way, spsi_mul(whole, spsi_set(0.999f))))) {
        const spsi_v a = spsi_plane_depth(&p->line, k);
        const spsi_v from =
            spsi_div(spsi_abs(spsi_sub(shader->sweep->back_to_front ? slab->leave : slab->enter, a)), whole);
        slab->first = spsi_clamp(from, zero, spsi_set(1));
        slab->last = spsi_clamp(spsi_add(from, spsi_div(way, whole)), slab->first, spsi_set(1));
    }
    slab->depth = zero;
    for (int i = 0; i < slab->part_count; ++i) slab->part_depth[i] = zero;
    for (int m = 0; m < count; ++m)
        if (shader->frame->matter.materials[m].table)
            spsi_samples_classified(shader, tile, p, m, slab);
        else
            spsi_samples_gas(&shader->frame->matter.materials[m], spsi_mul(spsi_sheet_sum(tile, m, at), p->length), m,
                             slab);
    for (int i = 0; i < slab->part_count; ++i) slab->depth = spsi_add(slab->depth, slab->part_depth[i]);
    if (!shader->frame->matter.emits && !spsi_bits(spsi_less(zero, slab->depth)))
        return 0; /* values without extinction */
    for (int i = 0; i < shader->shadow_count && shader->frame->matter.scatters; ++i)
        spsi_slab_light(shader, &shader->shadows[i], p, slab, &slab->arrivals[i]);
    return 1;
}

/* The i-th part of a slab. `depth` is the optical depth that the ray has accumulated: front to back, that in front of
   the part. A part begins where the one before ended, which `part` still holds. */
static void spsi_part_build(const spsi_shader *shader, const spsi_slab *slab, int i, spsi_v depth, spsi_part *part) {
    const int backwards = shader->sweep->back_to_front;
    const spsi_v from = backwards ? slab->leave : slab->enter, to = backwards ? slab->enter : slab->leave;
    const float count = (float)slab->part_count;
    const spsi_v share = spsi_div(slab->part_depth[i], spsi_max(slab->depth, spsi_set(FLT_MIN)));
    part->samples = slab->samples + i * slab->material_count;
    part->middle = spsi_mix(from, to, spsi_set(((float)i + 0.5f) / count));
    part->half = spsi_mul(spsi_abs(spsi_sub(to, from)), spsi_set(0.5f / count));
    part->depth = slab->part_depth[i];
    part->first = i > 0 ? part->last : spsi_set(0);
    part->last = i + 1 < slab->part_count ? spsi_min(spsi_add(part->first, share), spsi_set(1)) : spsi_set(1);
    part->number = i;
    part->is_cut = 0;
    part->before = backwards ? part->depth : depth;
    part->after = backwards ? spsi_set(0) : spsi_add(depth, part->depth);
}

/* The shares from `first` to `last` of a slab's way, as far as they belong to one part of it. Within a part, matter is
   even. `samples` receives its samples. Returns 0 if there is nothing of it. */
static int spsi_part_cut(const spsi_shader *shader, const spsi_slab *slab, spsi_v first, spsi_v last,
                         spsi_sample *samples, spsi_v depth, spsi_part *part) {
    const int backwards = shader->sweep->back_to_front;
    const spsi_v zero = spsi_set(0), one = spsi_set(1), count = spsi_set((float)slab->part_count);
    const spsi_v number = spsi_set((float)part->number);
    const spsi_v from = spsi_clamp(spsi_sub(spsi_mul(first, count), number), zero, one);
    const spsi_v to = spsi_clamp(spsi_sub(spsi_mul(last, count), number), from, one);
    const spsi_v share = spsi_sub(to, from), aside = spsi_sub(spsi_add(from, to), one), begins = part->first;
    if (!spsi_bits(spsi_less(zero, share))) return 0;
    for (int m = 0; m < slab->material_count; ++m) {
        samples[m] = part->samples[m];
        samples[m].depth = spsi_mul(samples[m].depth, share);
        samples[m].value_length = spsi_mul(samples[m].value_length, share);
    }
    part->samples = samples;
    part->is_cut = 1;
    part->cut[0] = from;
    part->cut[1] = to;
    part->middle = spsi_fma(spsi_mul(part->half, spsi_set(backwards ? -1.0f : 1.0f)), aside, part->middle);
    part->half = spsi_mul(part->half, share);
    part->depth = spsi_mul(part->depth, share);
    part->first = spsi_mix(begins, part->last, from);
    part->last = spsi_mix(begins, part->last, to);
    part->before = backwards ? part->depth : depth;
    part->after = backwards ? zero : spsi_add(depth, part->depth);
    return 1;
}

/* Composites one part of a slab. `ahead`: NULL without layers. */
static void spsi_add_part(const spsi_shader *shader, const spsi_pixels *p, const spsi_slab *slab, const spsi_part *part,
                          const spsi_ahead *ahead, spsi_gathered *sum) {
    const spsi_v zero = spsi_set(0);
    spsi_v filtered[3] = {zero, zero, zero}, *sent = ahead ? filtered : sum->radiance;
    if (shader->sweep->back_to_front) {
        const spsi_v through = spsi_exp(spsi_sub(zero, part->depth));
        for (int c = 0; c < shader->frame->channels; ++c) sum->radiance[c] = spsi_mul(sum->radiance[c], through);
        sum->distance = spsi_mul(sum->distance, through);
    }
    for (int i = 0; i < shader->shadow_count && shader->frame->matter.scatters; ++i)
        spsi_add_shadowed(shader, &shader->shadows[i], &slab->arrivals[i], p, part, sent);
    if (shader->unshadowed) spsi_add_unshadowed(shader, p, part, sent);
    for (int c = 0; c < shader->frame->channels && ahead; ++c)
        sum->radiance[c] = spsi_fma(sent[c], spsi_load(ahead->filter[c]), sum->radiance[c]);
    if (shader->distance) { /* the part is seen there with weight T (1 - exp(-depth)) */
        const spsi_v ahead_of = spsi_sub(spsi_mean_way(part->depth), spsi_set(0.5f));
        const spsi_v seen = spsi_fma(spsi_mul(spsi_set(2), part->half), ahead_of, part->middle);
        const spsi_v t = spsi_add(seen, spsi_set((float)shader->frame->content->eye.depth_reference));
        spsi_v covered = spsi_mul(part->depth, spsi_mean_transmittance(part->before, part->after));
        if (ahead) covered = spsi_mul(covered, spsi_ahead_mean(ahead));
        sum->distance = spsi_fma(covered, spsi_mul(t, p->length), sum->distance);
    }
    sum->depth = spsi_min(spsi_add(sum->depth, part->depth), spsi_set(SPSI_DEPTH_MAX));
}

/* A chunk of slabs, or polygons only (slab_count 0), in a tile that is being shaded. Its polygons are those between the
   slab coordinates `low` and `high`, counted from the sweep's first slab. */
typedef struct spsi_shading {
    const spsi_shader *shader;
    const spsi_tile *tile;
    spsi_scratch scratch;
    int slab_count;
    float low, high;
} spsi_shading;

/* A vector of pixels that is being shaded. */
typedef struct spsi_row {
    spsi_pixels pixels;
    spsi_slab slab;
    spsi_ahead ahead;
    int has_layers; /* 1: `ahead` is in use */
    int width;      /* number of pixels */
    spsi_gathered sum;
} spsi_row;

static const spsi_ahead *spsi_row_ahead(const spsi_row *row) { return row->has_layers ? &row->ahead : NULL; }

/* Composites the parts of a slab. */
static void spsi_add_parts(const spsi_shader *shader, spsi_row *row) {
    spsi_part part;
    for (int i = 0; i < row->slab.part_count; ++i) {
        spsi_part_build(shader, &row->slab, i, row->sum.depth, &part);
        if (shader->frame->matter.emits || spsi_bits(spsi_less(spsi_set(0), part.depth)))
            spsi_add_part(shader, &row->pixels, &row->slab, &part, spsi_row_ahead(row), &row->sum);
    }
}

/* Composites the shares from `first` to `last` of a slab's way. */
static void spsi_add_parts_cut(const spsi_shading *shading, spsi_v first, spsi_v last, spsi_row *row) {
    const spsi_shader *shader = shading->shader;
    spsi_sample *samples = shading->scratch.samples + SPSI_PARTS * row->slab.material_count;
    spsi_part whole, part;
    for (int i = 0; i < row->slab.part_count; ++i) {
        spsi_part_build(shader, &row->slab, i, row->sum.depth, &whole);
        part = whole;
        if (!spsi_part_cut(shader, &row->slab, first, last, samples, row->sum.depth, &part)) continue;
        if (shader->frame->matter.emits || spsi_bits(spsi_less(spsi_set(0), part.depth)))
            spsi_add_part(shader, &row->pixels, &row->slab, &part, &row->ahead, &row->sum);
    }
}

/* Composites the layers before slab coordinate `high`, and between them the slab that they lie in, if it holds
   anything. */
static void spsi_add_layered(const spsi_shading *shading, int held, float high, spsi_row *row) {
    const spsi_shader *shader = shading->shader;
    const int backwards = shader->sweep->back_to_front;
    const spsi_v zero = spsi_set(0), one = spsi_set(1);
    spsi_v first = zero, from = zero, way = zero;
    if (held) {
        from = backwards ? row->slab.leave : row->slab.enter;
        way = spsi_sub(backwards ? row->slab.enter : row->slab.leave, from);
    }
    for (;;) {
        const spsi_m here = spsi_less(row->ahead.slab, spsi_set(high));
        const int bits = spsi_bits(here);
        const spsi_v d = spsi_select(here, spsi_load(row->ahead.depth), from);
        spsi_v last = spsi_div(spsi_sub(d, from), spsi_select(spsi_less(zero, spsi_abs(way)), way, one));
        last = spsi_select(here, spsi_clamp(last, first, one), one);
        if (held) spsi_add_parts_cut(shading, first, last, row);
        if (!bits) return;
        spsi_add_layers(shader, &row->pixels, bits, &row->ahead, &row->sum);
        first = last;
    }
}

/* Composites slab k of a vector of pixels, and the polygons in it. Returns 0 if it held nothing. */
static int spsi_add_slab(const spsi_shading *shading, int k, spsi_row *row) {
    const spsi_shader *shader = shading->shader;
    const float low = k == 0 ? shading->low : (float)(shader->first_slab + k);
    const float high = k + 1 == shading->slab_count ? shading->high : (float)(shader->first_slab + k + 1);
    const int backwards = shader->sweep->back_to_front;
    const int held = spsi_slab_build(shader, shading->tile, &row->pixels, k, &row->slab);
    if (shader->hits && backwards)
        spsi_add_surfaces(shader, &row->pixels, row->width, low, high, spsi_row_ahead(row), &row->sum);
    if (row->has_layers && spsi_ahead_before(&row->ahead, high))
        spsi_add_layered(shading, held, high, row);
    else if (held)
        spsi_add_parts(shader, row);
    if (shader->hits && !backwards)
        spsi_add_surfaces(shader, &row->pixels, row->width, low, high, spsi_row_ahead(row), &row->sum);
    return held;
}

/* Composites the polygons of a range of slabs that hold nothing else. */
static void spsi_add_range(const spsi_shading *shading, spsi_row *row) {
    const spsi_shader *shader = shading->shader;
    const int backwards = shader->sweep->back_to_front;
    for (int pass = 0; pass < 2; ++pass) /* surfaces are behind layers */
        if (pass == !backwards)
            spsi_add_surfaces(shader, &row->pixels, row->width, shading->low, shading->high, spsi_row_ahead(row),
                              &row->sum);
        else if (row->has_layers)
            spsi_add_layered(shading, 0, shading->high, row);
}

static void spsi_gathered_load(const spsi_shader *shader, size_t from, spsi_gathered *sum) {
    sum->depth = spsi_load(shader->depth + from);
    for (int c = 0; c < 3; ++c) sum->radiance[c] = spsi_load(shader->radiance[c] + from); /* grey: all one buffer */
    sum->distance = shader->distance ? spsi_load(shader->distance + from) : spsi_set(0);
}

static void spsi_gathered_store(const spsi_shader *shader, size_t to, const spsi_gathered *sum) {
    spsi_store(shader->depth + to, sum->depth);
    for (int c = 0; c < shader->frame->channels; ++c) spsi_store(shader->radiance[c] + to, sum->radiance[c]);
    if (shader->distance) spsi_store(shader->distance + to, sum->distance);
}

/* Early ray termination before plane k. A ray whose transmittance is below the threshold becomes opaque, so that no
   bright background shines through and nothing added later counts; what it let through counts as seen at the plane.
   Returns 0 if all rays have ended. */
static int spsi_end_rays(const spsi_shader *shader, const spsi_pixels *p, int k, const spsi_ahead *ahead,
                         spsi_gathered *sum) {
    const spsi_m open = spsi_less(sum->depth, spsi_set(shader->end_depth));
    const int bits = spsi_bits(open);
    if (bits != spsi_bits(spsi_less(spsi_set(-1), spsi_set(0)))) {
        const spsi_v t = spsi_add(spsi_min(spsi_plane_depth(&p->line, k), p->line.polygon),
                                  spsi_set((float)shader->frame->content->eye.depth_reference));
        spsi_v left = spsi_exp(spsi_sub(spsi_set(0), sum->depth));
        if (ahead) left = spsi_mul(left, spsi_ahead_mean(ahead));
        sum->distance = spsi_select(open, sum->distance, spsi_fma(left, spsi_mul(t, p->length), sum->distance));
        sum->depth = spsi_select(open, sum->depth, spsi_set(SPSI_DEPTH_MAX));
    }
    return bits != 0;
}

/* Whether any of a vector of pixels has layers. */
static int spsi_pixels_layered(const spsi_shader *shader, int x, int y, int width) {
    const uint32_t *first = shader->visible->layers.first;
    const size_t pixel = (size_t)y * (size_t)shader->frame->content->eye.width + (size_t)x;
    return shader->hits && first && first[pixel] < first[pixel + (size_t)width];
}

/* Composites a chunk on a vector of `width` pixels. Returns the number of slabs that held something, times pixels. */
static int spsi_shade_pixels(const spsi_shading *shading, int x, int y, int width) {
    const spsi_shader *shader = shading->shader;
    const size_t at = (size_t)(y - shader->y_origin) * (size_t)shader->pitch + (size_t)(x - shader->x_origin);
    spsi_row row;
    int held = 0;
    row.slab.samples = shading->scratch.samples;
    row.slab.arrivals = shading->scratch.arrivals;
    row.slab.material_count = shader->frame->matter.material_count;
    row.slab.part_count = shader->frame->matter.classifies ? SPSI_PARTS : 1;
    row.width = width;
    for (int i = 0; i < shader->shadow_count; ++i) row.slab.arrivals[i].plane = -1;
    spsi_pixels_build(shader, x, y, &row.pixels);
    for (int i = 0; i < 4 * shader->frame->gradients.reach && shading->slab_count > 0; ++i) {
        const int side = (i & 1 ? 1 : -1) * (i < 4 ? 1 : 2);
        spsi_line_build(shader, x + (i & 2 ? 0 : side), y + (i & 2 ? side : 0), &row.pixels.around[i]);
    }
    row.has_layers = spsi_pixels_layered(shader, x, y, width);
    if (row.has_layers) spsi_ahead_begin(shader, &row.pixels, width, shading->low, &row.ahead);
    spsi_gathered_load(shader, at, &row.sum);
    for (int k = 0; k < shading->slab_count; ++k) {
        held += width * spsi_add_slab(shading, k, &row);
        if (!shader->sweep->back_to_front && !spsi_end_rays(shader, &row.pixels, k + 1, spsi_row_ahead(&row), &row.sum))
            break;
    }
    if (shading->slab_count == 0) spsi_add_range(shading, &row);
    spsi_gathered_store(shader, at, &row.sum);
    return held;
}

/* ================================================================================================ >>sweep
   27 One pass over the slabs, a chunk at a time: first the light's tiles, then the eye's, which look up what the
   light's have just written. Empty chunks cost next to nothing, and patches whose rays have all ended are not
   shaded. */

/* The tiles of the image that the region to render touches. */
typedef struct spsi_region {
    int x0, y0, columns, rows; /* in tiles */
    uint64_t *open;            /* per tile, bits: patches whose rays have not all ended */
    int outside;               /* number of tiles without a pixel of the sweep's part of the image */
    float (*polygon_range)[3]; /* per tile: minimum and maximum slab coordinate of its polygons, and minimum depth */
} spsi_region;

#define SPSI_REGION_TILE_BYTES (sizeof(uint64_t) + 3 * sizeof(float)) /* of `open` and `polygon_range` */

/* Data shared by the tasks of a sweep. A task writes only its own tile's pixels, planes and flags, and its own worker's
   sheets, scratch memory and counters. */
typedef struct spsi_run {
    sps_context *context;
    const spsi_frame *frame;
    const spsi_sweep *sweep;
    spsi_contents contents; /* bricks and particles by chunk */
    spsi_target eye;        /* the eye's sheets */
    spsi_sliced sliced;     /* the shadow of the sweep's lamp */
    int has_sliced;         /* 1: `sliced` is in use, since gas shades */
    spsi_shader shader;
    spsi_shadow *shadows;   /* those of the shader */
    spsi_sample *samples;   /* of the workers' scratch memory */
    spsi_arrival *arrivals; /* one per shadow, per worker */
    uint64_t *shaded;       /* per worker: pixels times slabs */
    int slab_count;         /* to composite in this chunk; 0: polygons only */
    float low, high;        /* range of slab coordinates whose polygons belong to this chunk */
    spsi_region region;
} spsi_run;

/* The patches of a tile of the image whose rays have not all ended. */
static uint64_t spsi_tile_open(const spsi_run *run, int x0, int y0) {
    const spsi_shader *shader = &run->shader;
    const size_t at = (size_t)(y0 - shader->y_origin) * (size_t)shader->pitch + (size_t)(x0 - shader->x_origin);
    return spsi_patches_open(shader->depth + at, (size_t)shader->pitch,
                             spsi_least(SPSI_TILE_WIDTH, run->frame->content->eye.width - x0),
                             spsi_least(SPSI_TILE_HEIGHT, run->frame->content->eye.height - y0), shader->end_depth);
}

/* Ends the rays of all pixels outside of the sweep's part of the image, which other sweeps serve. */
static void spsi_run_end_others(const spsi_run *run, int rows) {
    const int *part = run->sweep->part, x0 = run->shader.x_origin, y0 = run->shader.y_origin;
    for (int y = 0; y < rows; ++y)
        for (int x = 0; x < run->shader.pitch; ++x)
            if (x0 + x < part[0] || x0 + x >= part[2] || y0 + y < part[1] || y0 + y >= part[3])
                run->shader.depth[(size_t)y * (size_t)run->shader.pitch + (size_t)x] = SPSI_DEPTH_MAX;
}

/* Cuts a tile's sections at polygons, where any may lie in the chunk or nearer to the eye, and at the near plane, where
   there is one. */
static void spsi_tile_limit(const spsi_run *run, int index, spsi_tile *tile) {
    const spsi_rays *eye = &run->frame->content->eye;
    const float *range = run->region.polygon_range[index];
    if (range[0] <= range[1]) {
        tile->limits = run->shader.hits;
        tile->limit_width = eye->width;
        tile->limit_height = eye->height;
        tile->nearest_limit = range[2];
        tile->clamped = run->sweep->back_to_front ? range[1] >= run->low - 2 : range[0] < run->high + 2;
    }
    if (eye->near_depth > 0 || (!eye->perspective && eye->near_depth > -DBL_MAX)) tile->clamped = 1;
}

static void spsi_eye_task(void *data, int index, int worker) {
    spsi_run *run = (spsi_run *)data;
    const spsi_region *region = &run->region;
    const int column = region->x0 + index % region->columns, row = region->y0 + index / region->columns;
    const int x0 = column * SPSI_TILE_WIDTH, y0 = row * SPSI_TILE_HEIGHT;
    const int width = run->frame->content->eye.width, height = run->frame->content->eye.height;
    const float *range = region->polygon_range[index];
    const int polygons = range[0] < run->high && range[1] >= run->low;
    int touched = 0;
    spsi_tile tile;
    spsi_shading shading;
    if (!region->open[index]) return;
    spsi_tile_place(&run->eye, column, row, worker, &tile);
    tile.open = region->open[index];
    spsi_tile_limit(run, index, &tile);
    if (run->slab_count > 0) touched = spsi_tile_splat(&run->eye, &run->contents, column, row, &tile);
    if (!touched && !polygons) return;
    shading.shader = &run->shader;
    shading.tile = &tile;
    shading.scratch.samples = run->samples + (size_t)worker * (size_t)spsi_scratch_samples(run->frame);
    shading.scratch.arrivals = run->arrivals + (size_t)worker * (size_t)run->shader.shadow_count;
    shading.slab_count = touched ? SPSI_CHUNK : 0;
    shading.low = run->low;
    shading.high = run->high;
    for (int y = y0; y < spsi_least(height, y0 + SPSI_TILE_HEIGHT); ++y)
        for (int x = x0; x < spsi_least(width, x0 + SPSI_TILE_WIDTH); x += SPSI_LANES)
            if (tile.open & spsi_patches(&tile, x, y, x + SPSI_LANES - 1, y))
                run->shaded[worker] += (uint64_t)spsi_shade_pixels(&shading, x, y, spsi_least(SPSI_LANES, width - x));
    spsi_tile_count(&run->eye, &tile, worker);
    if (!run->sweep->back_to_front) region->open[index] = spsi_tile_open(run, x0, y0);
}

/* Widens a range of slab coordinates to the layers of a vector of pixels. */
static void spsi_layers_range(const spsi_shader *shader, const spsi_pixels *p, int width, float *low, float *high) {
    spsi_ahead ahead;
    if (!spsi_pixels_layered(shader, p->line.x, p->line.y, width)) return;
    spsi_ahead_begin(shader, p, width, -SPSI_INFINITY, &ahead);
    for (int left = spsi_ahead_before(&ahead, SPSI_INFINITY); left; left = spsi_ahead_before(&ahead, SPSI_INFINITY)) {
        float slabs[SPSI_LANES];
        spsi_store(slabs, ahead.slab);
        for (int lane = 0; left >> lane; ++lane) {
            if (!(left >> lane & 1)) continue;
            *low = slabs[lane] < *low ? slabs[lane] : *low;
            *high = slabs[lane] > *high ? slabs[lane] : *high;
            spsi_ahead_pass(shader, lane, &ahead);
        }
        spsi_ahead_measure(shader, p, &ahead);
    }
}

/* The range of slab coordinates of the polygons in a tile and its margin, and their minimum depth. Opens all patches of
   the tile. */
static void spsi_polygon_range_task(void *data, int index, int worker) {
    spsi_run *run = (spsi_run *)data;
    spsi_region *region = &run->region;
    const int margin = run->eye.shape.margin;
    const int left = (region->x0 + index % region->columns) * SPSI_TILE_WIDTH;
    const int top = (region->y0 + index / region->columns) * SPSI_TILE_HEIGHT;
    const int x0 = spsi_most(0, left - margin), y0 = spsi_most(0, top - margin);
    const int x1 = spsi_least(run->frame->content->eye.width, left + SPSI_TILE_WIDTH + margin);
    const int y1 = spsi_least(run->frame->content->eye.height, top + SPSI_TILE_HEIGHT + margin);
    float low = SPSI_INFINITY, high = -SPSI_INFINITY, nearest = SPSI_INFINITY;
    const uint32_t *layers = run->shader.visible->layers.first;
    (void)worker;
    for (int y = y0; y < y1 && run->shader.hits; ++y)
        for (int x = x0; x < x1; x += SPSI_LANES) {
            float lanes[SPSI_LANES], depths[SPSI_LANES];
            const int width = spsi_least(SPSI_LANES, x1 - x);
            spsi_pixels p;
            spsi_pixels_build(&run->shader, x, y, &p);
            spsi_store(lanes, p.polygon_slab);
            spsi_store(depths, p.line.polygon);
            for (int i = 0; i < width; ++i)
                if (depths[i] < SPSI_INFINITY) {
                    low = lanes[i] < low ? lanes[i] : low;
                    high = lanes[i] > high ? lanes[i] : high;
                    nearest = depths[i] < nearest ? depths[i] : nearest;
                }
            if (layers) spsi_layers_range(&run->shader, &p, width, &low, &high);
        }
    region->polygon_range[index][0] = low;
    region->polygon_range[index][1] = high;
    region->polygon_range[index][2] = nearest;
    region->open[index] = spsi_tile_open(run, left, top);
}

/* --- setting up a sweep --- */

/* Begins the shadow of the sweep's own lamp. */
static sps_result spsi_run_slice(sps_context *context, spsi_run *run) {
    run->has_sliced = run->sweep->lamp && spsi_holds_gas(context, run->frame);
    if (!run->has_sliced) return SPS_OK;
    for (int i = 0; i < run->shader.shadow_count; ++i) {
        if (run->shadows[i].lamp != run->sweep->lamp) continue;
        run->shadows[i].kind = SPSI_SHADOW_SHEETS;
        run->shadows[i].sliced = &run->sliced;
    }
    return spsi_sliced_begin(context, run->frame, run->sweep, run->shader.faces, &run->contents, &run->sliced);
}

/* The linear quantities that shading evaluates along the eye's rays. */
static void spsi_run_linears(spsi_run *run) {
    const spsi_frame *frame = run->frame;
    spsi_shader *shader = &run->shader;
    spsi_linear_of_slabs(&frame->content->eye, &run->sweep->slabs, &shader->slab);
    for (int n = 0; n < shader->shadow_count; ++n) spsi_shadow_aim(&frame->content->eye, &run->shadows[n]);
    spsi_ray_point(&frame->content->eye, 0.5 * frame->content->eye.width, 0.5 * frame->content->eye.height,
                   frame->content->eye.depth_reference, shader->position_origin);
    for (int i = 0; i < 3; ++i) {
        double axis[3] = {0, 0, 0};
        axis[i] = 1;
        spsi_linear_build(&frame->content->eye, axis, shader->position_origin, 0, &shader->position[i]);
    }
}

static void spsi_region_place(const spsi_frame *frame, spsi_region *region) {
    const int *pixels = frame->view.region;
    region->x0 = pixels[0] / SPSI_TILE_WIDTH;
    region->y0 = pixels[1] / SPSI_TILE_HEIGHT;
    region->columns = (pixels[0] + pixels[2] - 1) / SPSI_TILE_WIDTH - region->x0 + 1;
    region->rows = (pixels[1] + pixels[3] - 1) / SPSI_TILE_HEIGHT - region->y0 + 1;
}

static size_t spsi_region_tiles(const spsi_region *region) { return (size_t)region->columns * (size_t)region->rows; }

/* Floats per pixel while a sweep runs: optical depth, radiance, and distance if wanted. */
static size_t spsi_pixel_floats(const spsi_frame *frame) { return (size_t)(1 + frame->channels + frame->wants_depth); }

/* Lays out the region's tiles, and the buffers of their pixels. */
static sps_result spsi_run_region(sps_context *context, spsi_run *run) {
    const size_t planes = spsi_pixel_floats(run->frame);
    spsi_region *region = &run->region;
    spsi_shader *shader = &run->shader;
    size_t tiles, pixels;
    float *memory;
    spsi_region_place(run->frame, region);
    tiles = spsi_region_tiles(region);
    pixels = tiles * SPSI_TILE_WIDTH * SPSI_TILE_HEIGHT;
    region->open = (uint64_t *)spsi_reserve(context, SPSI_BUFFER_TILES, tiles, SPSI_REGION_TILE_BYTES);
    memory = (float *)spsi_reserve(context, SPSI_BUFFER_PIXELS, pixels * planes, sizeof(float));
    if (!region->open || !memory) return context->result;
    memset(memory, 0, pixels * planes * sizeof(float));
    region->polygon_range = (float(*)[3])(void *)(region->open + tiles);
    shader->x_origin = region->x0 * SPSI_TILE_WIDTH;
    shader->y_origin = region->y0 * SPSI_TILE_HEIGHT;
    shader->pitch = region->columns * SPSI_TILE_WIDTH;
    shader->depth = memory;
    for (int c = 0; c < 3; ++c)
        shader->radiance[c] = memory + pixels * (size_t)(1 + (c < run->frame->channels ? c : 0));
    shader->distance = run->frame->wants_depth ? memory + pixels * (planes - 1) : NULL;
    if (spsi_part_count(run->frame) > 1) spsi_run_end_others(run, region->rows * SPSI_TILE_HEIGHT);
    return SPS_OK;
}

/* Reserves the workers' scratch memory and clears their counters. */
static sps_result spsi_run_scratch(sps_context *context, spsi_run *run) {
    run->samples = (spsi_sample *)spsi_vectors_reserve(context, SPSI_BUFFER_SAMPLES, spsi_scratch_samples(run->frame),
                                                       sizeof *run->samples);
    run->arrivals = (spsi_arrival *)spsi_vectors_reserve(context, SPSI_BUFFER_ARRIVALS, run->shader.shadow_count,
                                                         sizeof *run->arrivals);
    run->shaded = (uint64_t *)(void *)(run + 1); /* spsi_run_bytes includes them */
    memset(run->shaded, 0, (size_t)spsi_worker_count(context) * sizeof *run->shaded);
    return run->samples && run->arrivals ? SPS_OK : context->result;
}

/* Bytes of a run and of the workers' counters behind it. */
static size_t spsi_run_bytes(const sps_context *context) {
    return sizeof(spsi_run) + (size_t)spsi_worker_count(context) * sizeof(uint64_t);
}

/* Fills the run for one sweep. */
static sps_result spsi_run_build(sps_context *context, const spsi_frame *frame, const spsi_faces *faces,
                                 const spsi_visible *visible, const spsi_sweep *sweep, spsi_run *run) {
    spsi_shader *shader = &run->shader;
    run->context = context;
    run->frame = frame;
    run->sweep = sweep;
    shader->frame = frame;
    shader->sweep = sweep;
    shader->faces = faces;
    shader->shadows = run->shadows;
    shader->visible = visible;
    shader->hits = faces->count > 0 ? visible->hits : NULL;
    shader->unshadowed = sweep->first && (frame->ambient.exists || frame->matter.emits ||
                                          frame->lamps.count > frame->lamps.shadow_count);
    shader->end_depth = (float)-log(frame->accuracy.threshold);
    if (spsi_target_of_eye(context, frame, &sweep->slabs, sweep->back_to_front, &run->eye) ||
        spsi_run_slice(context, run))
        return context->result;
    spsi_run_linears(run);
    if (spsi_run_region(context, run) || spsi_run_scratch(context, run) ||
        spsi_contents_build(context, &run->eye, run->has_sliced ? &run->sliced.target : NULL, &run->contents) ||
        spsi_contents_add_particles(&run->contents))
        return context->result;
    spsi_parallel(context, run->region.columns * run->region.rows, spsi_polygon_range_task, run);
    for (int i = 0; i < run->region.columns * run->region.rows; ++i) run->region.outside += run->region.open[i] == 0;
    return SPS_OK;
}

/* --- running it --- */

static int spsi_run_finished(const spsi_run *run) {
    for (int i = 0; i < run->region.columns * run->region.rows; ++i)
        if (run->region.open[i]) return 0;
    return 1;
}

/* Composites the polygons in a range of slabs that holds neither voxels nor particles. */
static void spsi_run_polygons(spsi_run *run, float low, float high) {
    if (!run->shader.hits || !(low < high)) return;
    run->slab_count = 0;
    run->low = low;
    run->high = high;
    if (run->has_sliced) spsi_sliced_level(run->context, &run->sliced);
    spsi_parallel(run->context, run->region.columns * run->region.rows, spsi_eye_task, run);
}

/* Splats and composites the current chunk. */
static void spsi_run_chunk(spsi_run *run) {
    sps_context *context = run->context;
    run->shader.first_slab = run->contents.first_slab;
    run->slab_count = SPSI_CHUNK;
    run->low = (float)run->shader.first_slab;
    run->high = run->low + SPSI_CHUNK;
    spsi_contents_bin_particles(&run->contents);
    if (run->has_sliced) spsi_sliced_advance(context, &run->sliced);
    spsi_parallel(context, run->region.columns * run->region.rows, spsi_eye_task, run);
}

/* Adds the workers' counts and the tiles' flags to the statistics. */
static void spsi_run_count(spsi_run *run) {
    sps_stats_report *stats = &run->context->stats;
    for (int i = 0; i < spsi_worker_count(run->context); ++i) {
        stats->eye_footprints += run->eye.counts[i][0];
        stats->eye_fragments += run->eye.counts[i][1];
        stats->pixels_shaded += run->shaded[i];
        if (!run->has_sliced) continue;
        stats->light_footprints += run->sliced.target.counts[i][0];
        stats->light_fragments += run->sliced.target.counts[i][1];
    }
    for (int i = 0; i < run->region.columns * run->region.rows; ++i) stats->tiles_finished += run->region.open[i] == 0;
    stats->tiles_finished -= (uint64_t)run->region.outside;
}

static sps_result spsi_run_sweep(spsi_run *run, const spsi_part_of_call *part) {
    sps_context *context = run->context;
    const int held = spsi_holds_gas(context, run->frame), slabs = held ? run->sweep->slabs.count : 0;
    const int chunks = held ? spsi_chunk_count(&run->sweep->slabs) : 0;
    float done = -SPSI_INFINITY;
    context->stats.slabs += (uint64_t)slabs;
    for (int chunk = 0; chunk < chunks; ++chunk) {
        if (spsi_progress(context, spsi_part_done(part, (double)chunk / chunks))) return context->result;
        spsi_contents_advance(&run->contents, chunk);
        if (run->contents.bricks.current == 0 && run->contents.particles.current == 0) {
            context->stats.slabs_empty += (uint64_t)spsi_least(SPSI_CHUNK, slabs - chunk * SPSI_CHUNK);
            continue;
        }
        spsi_run_polygons(run, done, (float)(chunk * SPSI_CHUNK));
        spsi_run_chunk(run);
        done = (float)((chunk + 1) * SPSI_CHUNK);
        if (spsi_run_finished(run)) break;
    }
    spsi_run_polygons(run, done, SPSI_INFINITY);
    spsi_run_count(run);
    return SPS_OK;
}

/* ================================================================================================ >>frame
   28 The frame: one sweep after another, then the image. */

/* --- the image --- */

/* Floats per pixel of the sum of sweeps: radiance, coverage, and distance if wanted. */
static size_t spsi_total_floats(const spsi_frame *frame) { return (size_t)(4 + frame->wants_depth); }

#define SPSI_ROW_FLOATS 6 /* per pixel of a row of background: a color and a direction */

/* Fills `rgb` with the background's radiance for one row of the region, three floats per pixel. Directions are kept
   behind it. */
static sps_result spsi_background_row(sps_context *context, const spsi_frame *frame, int y, float *rgb) {
    const spsi_background *background = &frame->background;
    const int *region = frame->view.region;
    float *directions = rgb + 3 * (size_t)region[2];
    int returned;
    for (int x = 0; x < region[2]; ++x) {
        double ray[3];
        memcpy(rgb + 3 * x, background->color, sizeof background->color);
        if (!background->color_fn) continue;
        spsi_ray_direction(&frame->content->eye, region[0] + x, region[1] + y, ray);
        spsi_normalise(ray);
        for (int i = 0; i < 3; ++i) directions[3 * x + i] = (float)ray[i];
    }
    if (!background->color_fn) return SPS_OK;
    context->stats.background_calls += 1;
    returned = background->color_fn(background->user, (size_t)region[2], directions, rgb);
    if (returned)
        return spsi_fail_field(context, SPS_ERROR_CALLBACK, SPS_OBJECT_SCENE, -1, "background_fn", returned, NULL);
    for (int i = 0; i < region[2]; ++i)
        if (spsi_bad_color(rgb + 3 * i, SPSI_VALUE_MAX))
            return spsi_fail_field(context, SPS_ERROR_DATA, SPS_OBJECT_SCENE, -1, "background_fn's color",
                                   (double)*spsi_bad_color(rgb + 3 * i, SPSI_VALUE_MAX),
                                   "red, green and blue must be 0..1e18");
    return SPS_OK;
}

/* Flushes denormals to 0, since they could slow down the arithmetic of the caller. */
static float spsi_flush(float a) { return a < FLT_MIN ? 0 : a; }

/* What a pixel's layers let pass of what is behind all of them, by color; NULL: there are none. */
static const float *spsi_behind(const spsi_shader *shader, int x, int y) {
    const spsi_layers *layers = &shader->visible->layers;
    const size_t pixel = (size_t)y * (size_t)shader->frame->content->eye.width + (size_t)x;
    if (!layers->first || layers->first[pixel] == layers->first[pixel + 1]) return NULL;
    return layers->list[layers->first[pixel + 1] - 1].behind;
}

/* Begins the total with the background. */
static sps_result spsi_begin_total(sps_context *context, const spsi_frame *frame, float *total) {
    const size_t width = (size_t)frame->view.region[2], floats = spsi_total_floats(frame);
    float *rgb = (float *)spsi_reserve(context, SPSI_BUFFER_ROW, width, SPSI_ROW_FLOATS * sizeof(float));
    if (!rgb) return context->result;
    for (int y = 0; y < frame->view.region[3]; ++y) {
        if (spsi_background_row(context, frame, y, rgb)) return context->result;
        for (size_t x = 0; x < width; ++x)
            memcpy(total + ((size_t)y * width + x) * floats, rgb + 3 * x, 3 * sizeof *rgb);
    }
    return SPS_OK;
}

/* Adds a sweep's radiance to a pixel of the total; the first sweep also covers the background, and contributes coverage
   and distance. */
static void spsi_add_pixel(const spsi_run *run, int x, int y, float *pixel) {
    const spsi_shader *shader = &run->shader;
    const size_t at = (size_t)(y - shader->y_origin) * (size_t)shader->pitch + (size_t)(x - shader->x_origin);
    const float depth = shader->depth[at], covered = spsi_flush(depth < 86 ? -expm1f(-depth) : 1);
    const float *behind = spsi_behind(shader, x, y);
    for (int c = 0; c < 3 && run->sweep->first; ++c) pixel[c] = pixel[c] * (1 - covered) * (behind ? behind[c] : 1);
    for (int c = 0; c < 3; ++c) pixel[c] = spsi_flush(pixel[c] + shader->radiance[c][at]);
    if (!run->sweep->first) return;
    pixel[3] = covered;
    if (behind) pixel[3] = spsi_flush(1 - (1 - covered) * (behind[0] + behind[1] + behind[2]) / 3);
    if (run->frame->wants_depth) pixel[4] = pixel[3] > 0 ? shader->distance[at] / pixel[3] : SPSI_INFINITY;
}

/* The same for all pixels of the sweep's part of the image. */
static void spsi_add_sweep(const spsi_run *run, float *total) {
    const int *region = run->frame->view.region, *part = run->sweep->part;
    const int x1 = spsi_least(part[2], region[0] + region[2]), y1 = spsi_least(part[3], region[1] + region[3]);
    for (int y = spsi_most(part[1], region[1]); y < y1; ++y)
        for (int x = spsi_most(part[0], region[0]); x < x1; ++x) {
            const size_t pixel = (size_t)(y - region[1]) * (size_t)region[2] + (size_t)(x - region[0]);
            spsi_add_pixel(run, x, y, total + pixel * spsi_total_floats(run->frame));
        }
}

static void spsi_write_image(const spsi_frame *frame, const float *total, const sps_image *image) {
    const size_t width = (size_t)frame->view.region[2], height = (size_t)frame->view.region[3];
    const size_t pitch = image->row_pixels ? image->row_pixels : width;
    const int floats = (int)spsi_total_floats(frame);
    for (size_t y = 0; y < height; ++y)
        for (size_t x = 0; x < width; ++x) {
            const float *pixel = total + (y * width + x) * (size_t)floats;
            memcpy(image->rgba + 4 * (y * pitch + x), pixel, 4 * sizeof(float));
            if (frame->wants_depth) image->depth[y * pitch + x] = pixel[4];
        }
}

/* Sets the depth that the eye's depths are relative to: that of the middle of the gas, whose lookups need it to be
   near, or, if there is no gas, that of the polygons, which may be far behind. */
static void spsi_eye_reference(const spsi_frame *frame) {
    spsi_bounds all = frame->content->bounds;
    double centre[3], q[3];
    if (spsi_bounds_empty(&all)) all = frame->content->mesh_bounds;
    if (spsi_bounds_empty(&all)) return;
    spsi_bounds_centre(&all, centre);
    spsi_project(&frame->content->eye, centre, q);
    frame->content->eye.depth_reference = frame->content->eye.perspective ? fmax(q[2], 0) : q[2];
}

/* Finds what the eye sees of polygons. */
static sps_result spsi_eye_polygons(sps_context *context, const spsi_frame *frame, const spsi_faces *faces,
                                    spsi_visible *visible) {
    const size_t pixels = spsi_ray_count(&frame->content->eye);
    spsi_hit *hits;
    memset(visible, 0, sizeof *visible);
    if (faces->count == 0) return SPS_OK;
    hits = (spsi_hit *)spsi_reserve(context, SPSI_BUFFER_EYE_FACES, pixels, sizeof(spsi_hit));
    if (!hits) return context->result;
    visible->hits = hits;
    spsi_rasterise(context, faces, &frame->content->eye, hits, NULL, NULL);
    if (spsi_layers_build(context, frame, faces, hits, &visible->layers)) return context->result;
    for (size_t i = 0; i < pixels; ++i) {
        const uint32_t *first = visible->layers.first;
        context->stats.pixels_of_polygons += hits[i].face >= 0 || (first && first[i] < first[i + 1]);
    }
    return SPS_OK;
}

/* Data for the eye's pixels that all sweeps share. */
typedef struct spsi_picture {
    const spsi_frame *frame;
    spsi_faces faces;
    spsi_visible visible;
    float *total; /* radiance, coverage and distance of the region so far */
} spsi_picture;

/* Runs one sweep whose depth maps and transmittance maps are ready, from set-up to total. */
static sps_result spsi_sweep_once(sps_context *context, const spsi_picture *picture, const spsi_sweep *sweep,
                                  spsi_run *run, const spsi_part_of_call *part) {
    const double start = spsi_clock(context);
    double swept, light;
    if (spsi_run_build(context, picture->frame, &picture->faces, &picture->visible, sweep, run)) return context->result;
    swept = spsi_clock(context);
    context->stats.seconds_bin += swept - start;
    light = context->stats.seconds_light + context->stats.seconds_bin; /* time that is not the eye's */
    if (spsi_run_sweep(run, part)) return context->result;
    spsi_add_sweep(run, picture->total);
    context->stats.seconds_eye +=
        spsi_clock(context) - swept - (context->stats.seconds_light + context->stats.seconds_bin - light);
    return SPS_OK;
}

/* Bytes of what shadow rays find: `shares` per pixel for all lights, and the workers' counters. SIZE_MAX cannot be
   reserved. */
static size_t spsi_sight_bytes(const sps_context *context, size_t pixels, int shares) {
    const size_t counters = (size_t)spsi_worker_count(context) * sizeof(uint64_t);
    if (pixels > (SIZE_MAX - counters) / sizeof(float) / (size_t)spsi_most(1, shares)) return SIZE_MAX;
    return counters + pixels * (size_t)shares * sizeof(float);
}

static void spsi_shadow_start(const spsi_sweep *sweep, const spsi_lamp *lamp, spsi_shadow *shadow) {
    shadow->lamp = lamp;
    shadow->soft = sweep->soft && lamp == sweep->lamp;
}

/* Lists a sweep's lights, and traces the shadow rays from surfaces to them. */
static sps_result spsi_shadows_begin(sps_context *context, const spsi_picture *picture, const spsi_sweep *sweep, int n,
                                     spsi_run *run) {
    const spsi_frame *frame = picture->frame;
    const int count = spsi_sweep_shadow_count(frame, n);
    const size_t places = spsi_place_count(frame, &picture->visible);
    int shares = 0;
    uint64_t *rays;
    float *lit;
    run->shadows = (spsi_shadow *)spsi_reserve(context, SPSI_BUFFER_SHADOWS, (size_t)count, sizeof *run->shadows);
    if (!run->shadows) return context->result;
    memset(run->shadows, 0, (size_t)count * sizeof *run->shadows);
    for (int i = 0; i < frame->lamps.count; ++i)
        if (spsi_sweep_carries(sweep, &frame->lamps.list[i]))
            spsi_shadow_start(sweep, &frame->lamps.list[i], &run->shadows[run->shader.shadow_count++]);
    if (!picture->visible.hits || count == 0) return SPS_OK;
    for (int i = 0; i < count; ++i) shares += spsi_lit_channels(frame, run->shadows[i].lamp);
    rays = (uint64_t *)spsi_reserve(context, SPSI_BUFFER_SURFACE_LIGHT, 1, spsi_sight_bytes(context, places, shares));
    if (!rays) return context->result;
    lit = (float *)(void *)(rays + spsi_worker_count(context));
    for (int i = 0; i < count; ++i) {
        spsi_sight(context, frame, &picture->faces, &picture->visible, run->shadows[i].lamp, rays, lit);
        run->shadows[i].lit = lit;
        lit += places * (size_t)spsi_lit_channels(frame, run->shadows[i].lamp);
    }
    return SPS_OK;
}

/* Renders the region's pixels in a part of the image, whose shadows are ready. */
static sps_result spsi_render_part(sps_context *context, const spsi_picture *picture, const spsi_sweep *sweep,
                                   spsi_run *run, const spsi_part_of_call *part) {
    spsi_shadow *shadows = run->shadows;
    const int count = run->shader.shadow_count;
    if (!spsi_part_meets(sweep->part, picture->frame->view.region)) return SPS_OK;
    memset(run, 0, sizeof *run);
    run->shadows = shadows;
    run->shader.shadow_count = count;
    return spsi_sweep_once(context, picture, sweep, run, part);
}

static sps_result spsi_render_sweep(sps_context *context, const spsi_picture *picture, spsi_run *run, int n) {
    const spsi_frame *frame = picture->frame;
    const int parts = spsi_part_count(frame);
    spsi_part_of_call part = {0, (1 - SPSI_PROGRESS_GATHER) / spsi_sweep_count(frame)};
    spsi_sweep sweep;
    double start;
    part.progress = SPSI_PROGRESS_GATHER + n * part.share;
    memset(run, 0, sizeof *run);
    if (spsi_sweep_build(context, frame, n, 0, &sweep) || spsi_shadows_begin(context, picture, &sweep, n, run))
        return context->result;
    start = spsi_clock(context);
    if (spsi_depth_maps_build(context, frame, &picture->faces, run->shadows, run->shader.shadow_count) ||
        spsi_pane_maps_build(context, frame, &picture->faces, run->shadows, run->shader.shadow_count))
        return context->result;
    context->stats.seconds_polygons += spsi_clock(context) - start;
    start = spsi_clock(context);
    spsi_shadow_maps_build(context, frame, run->shadows, run->shader.shadow_count, &part);
    context->stats.seconds_light += spsi_clock(context) - start;
    part.share /= parts;
    for (int i = 0; i < parts && !context->result; ++i, part.progress += part.share)
        if (i == 0 || !spsi_sweep_build(context, frame, n, i, &sweep))
            spsi_render_part(context, picture, &sweep, run, &part);
    spsi_shadow_maps_release(context, run->shadows, run->shader.shadow_count);
    return context->result;
}

static sps_result spsi_render_frame(sps_context *context, spsi_frame *frame, const sps_image *image) {
    const size_t pixels = (size_t)frame->view.region[2] * (size_t)frame->view.region[3];
    const double start = spsi_clock(context);
    double gathered;
    spsi_picture picture;
    spsi_run *run;
    picture.frame = frame;
    if (spsi_gather(context, frame) || spsi_gather_particles(context, frame)) return context->result;
    spsi_choose_shadows(context, frame);
    if (!spsi_has_shadow_tables(frame)) spsi_shadow_tables_drop(context);
    if (spsi_gather_images(context, frame) || spsi_gather_faces(context, frame, &picture.faces)) return context->result;
    gathered = spsi_clock(context);
    context->stats.seconds_gather = gathered - start;
    spsi_eye_reference(frame);
    if (spsi_eye_polygons(context, frame, &picture.faces, &picture.visible)) return context->result;
    context->stats.seconds_polygons = spsi_clock(context) - gathered;
    gathered = spsi_clock(context);
    if (spsi_textures(context, frame, &picture.faces, &picture.visible)) return context->result;
    context->stats.seconds_textures = spsi_clock(context) - gathered;
    gathered = spsi_clock(context);
    if (frame->lamps.shadow_count > 0 && spsi_faces_tree(context, &picture.faces)) return context->result;
    context->stats.seconds_tree = spsi_clock(context) - gathered;
    picture.total = (float *)spsi_reserve(context, SPSI_BUFFER_TOTAL, pixels, spsi_total_floats(frame) * sizeof(float));
    run = (spsi_run *)spsi_reserve(context, SPSI_BUFFER_RUN, 1, spsi_run_bytes(context));
    if (!picture.total || !run || spsi_begin_total(context, frame, picture.total)) return context->result;
    for (int n = 0; n < spsi_sweep_count(frame); ++n)
        if (spsi_render_sweep(context, &picture, run, n)) return context->result;
    if (spsi_progress(context, 1)) return context->result;
    spsi_write_image(frame, picture.total, image);
    return SPS_OK;
}

/* ================================================================================================= >>plan
   29 The passes that a scene calls for. Each states its reason, whether it runs or not; bytes are upper bounds, counts
   of calls are exact. The bounds follow from what is known without reading: the blocks that range_fn does not exclude,
   and counts of triangles and particles. */

static const char *const spsi_pass_names[SPS_PASS_COUNT] = {
    "gather",        "projectors",  "eye polygons", "layers",       "textures",     "light polygons",
    "triangle tree", "shadow rays", "eye sheets",   "light sheets", "light maps",   "penumbrae",
    "gradient",      "scattering",  "emission",     "ambient",      "surface light"};

/* Whether any volume or particle may be visible. */
static int spsi_has_gas(const spsi_frame *frame) { return frame->medium_count > 0 || frame->particles.set_count > 0; }

/* The blocks of all volumes that will be read, and upper bounds of what they hold. */
typedef struct spsi_reading {
    int held; /* 1: the voxels are held from an earlier call, nothing will be read */
    uint64_t blocks, bricks, voxels_kept;
} spsi_reading;

static sps_result spsi_plan_reading(sps_context *context, const spsi_frame *frame, sps_plan_report *report,
                                    spsi_reading *reading) {
    memset(reading, 0, sizeof *reading);
    reading->held = context->gathered != 0 && context->gathered == spsi_volumes_fingerprint(frame);
    if (reading->held) return SPS_OK;
    for (int medium = 0; medium < frame->medium_count; ++medium) {
        const int64_t count = spsi_block_count(&frame->media[medium]);
        for (int64_t i = 0; i < count; ++i) {
            uint64_t bricks = 1, voxels = 1, kept = 1;
            spsi_block block;
            int empty;
            spsi_block_place(&block, &frame->media[medium], &frame->matter.materials[frame->media[medium].channel], i);
            if (spsi_block_range(context, &block, &empty)) return context->result;
            report->range_calls += block.medium->range_fn != NULL;
            if (empty) continue;
            for (int k = 0; k < 3; ++k) {
                const uint64_t core = (uint64_t)(block.core_high[k] - block.core_low[k]);
                bricks *= (core + SPSI_BRICK - 1) / SPSI_BRICK;
                kept *= core;
                voxels *= (uint64_t)block.size[k];
            }
            reading->blocks += 1;
            reading->bricks += bricks;
            reading->voxels_kept += kept;
            report->voxels_read += voxels;
            if (block.medium->eval_fn)
                report->eval_calls += (uint64_t)block.size[2];
            else
                report->read_calls += 1;
        }
    }
    return SPS_OK;
}

static size_t spsi_plan_gather_bytes(const spsi_frame *frame, const spsi_reading *reading) {
    const uint64_t whole = SPSI_BRICK * SPSI_BRICK * SPSI_BRICK;
    const uint64_t segments = reading->voxels_kept / (SPSI_SEGMENT - whole + 1) + 1;
    uint64_t bytes = segments * (sizeof(spsi_segment) + 3 * sizeof(spsi_segment *)) + SPSI_BLOCK_BYTES;
    bytes += (reading->bricks + 2) * 3 * sizeof(spsi_brick); /* the list grows by half, old and new at once */
    if (frame->medium_count == 0) return 0;
    if (reading->blocks == 0) bytes = SPSI_BLOCK_BYTES;
    return (size_t)bytes;
}

/* Maximum number of texels on the longer side of a sweep's light. Particles have not been read, so the bounds that were
   planned with are not those of the render. */
static size_t spsi_plan_light_side(const spsi_frame *frame, const spsi_sweep *sweep) {
    const int planned = spsi_most(sweep->rays.width, sweep->rays.height);
    if (frame->particles.set_count == 0) return (size_t)planned;
    return (size_t)spsi_most(2, frame->view.shadow_size > 0 ? frame->view.shadow_size : spsi_light_texels_most(frame));
}

/* Bytes of a target's lists of particles: a chunk may hold all of them. */
static size_t spsi_plan_lists_bytes(const spsi_frame *frame, int width, int height) {
    spsi_rays rays;
    rays.width = width;
    rays.height = height;
    return spsi_lists_bytes(&rays, frame->particles.count);
}

/* Bytes of the queues. Once read, volumes may be cut into other slabs than their boxes, but not into many more; with
   particles there is no bound but the maximum. */
static size_t spsi_plan_queues_bytes(const spsi_frame *frame, const spsi_slabs *slabs, size_t bricks) {
    const size_t most = SPSI_SLABS_MAX / SPSI_CHUNK;
    const size_t chunks = frame->particles.set_count > 0 ? most : 2 * (size_t)spsi_chunk_count(slabs) + 1;
    return spsi_queue_bytes(bricks, chunks) + bricks * 2 * sizeof(int16_t[4]) +
           (frame->particles.set_count > 0 ? spsi_queue_bytes(frame->particles.count, chunks) : 0);
}

/* Floats of a worker's sheets, for any target. */
static size_t spsi_plan_sheet_floats(const spsi_frame *frame) {
    const spsi_shape eye = spsi_eye_shape(frame), light = spsi_light_shape(frame);
    const size_t shadow = frame->lamps.shadow_count > 0 ? spsi_shape_floats(&light) : 0;
    return shadow > spsi_shape_floats(&eye) ? shadow : spsi_shape_floats(&eye);
}

/* Bytes by which a sweep's light casts penumbrae. Particles and polygons have not been read: whether penumbrae are wide
   enough is not known then. With particles, beams count as twice as wide as the light's sheets, which is their maximum
   if shadow_size does not set that of the sheets. Boxes of volumes may be wider than what is in them, and penumbrae
   narrower in their texels, so that the bytes count even if those are left sharp. */
static sps_result spsi_plan_penumbra_bytes(sps_context *context, const spsi_frame *frame, const spsi_sweep *sweep,
                                           sps_plan_report *report) {
    const int polygons = frame->meshes.triangle_count > 0;
    const uint64_t side = spsi_plan_light_side(frame, sweep), most = 2 * side + 8;
    sps_pass_report *pass = &report->pass[SPS_PASS_PENUMBRAE];
    spsi_penumbra penumbra;
    spsi_penumbra_size size;
    size_t bytes;
    pass->runs += sweep->soft || frame->particles.set_count > 0 || polygons;
    if (frame->particles.set_count > 0) {
        const uint64_t tiles = side / SPSI_TILE_WIDTH + 1;
        size.scratch = 3 * most * most + SPSI_LANES;
        size.beams = (uint64_t)sweep->lamp->point_count * most * most * (uint64_t)(1 + polygons);
        size.sheets = SPSI_CHUNK * side * side;
        size.held = 2 * tiles * tiles;
    } else {
        if (spsi_penumbra_aim(context, frame, sweep, &penumbra)) return context->result;
        size = spsi_penumbra_measure(&penumbra, polygons);
    }
    bytes = (size_t)sweep->lamp->point_count * sizeof(spsi_beam) + spsi_penumbra_floats(context, &size) * sizeof(float);
    if (bytes > pass->bytes) pass->bytes = bytes;
    return SPS_OK;
}

/* --- the choice between sheets and tables --- */

/* Whether slabs about the camera's axis serve a directional light, wherever the gas is. */
static int spsi_axis_serves(const spsi_frame *frame, const spsi_lamp *lamp) {
    double axis[3], toward[3];
    spsi_sweep sweep;
    if (lamp->is_point) return 0;
    spsi_sweep_clear(frame, lamp, 0, &sweep);
    spsi_eye_axis(&frame->content->eye, axis);
    spsi_sweep_turn(frame, axis, &sweep);
    for (int i = 0; i < 3; ++i) toward[i] = sweep.back_to_front ? -sweep.slabs.normal[i] : sweep.slabs.normal[i];
    return spsi_cosine_to_corners(toward, &frame->content->eye) >= SPSI_COSINE_MIN;
}

/* Chooses as a render does, except that particles have not been read: what depends on them stays open. */
static void spsi_plan_choices(sps_context *context, spsi_frame *frame) {
    int open = 0, sliced = 0;
    spsi_choose_shadows(context, frame);
    for (int i = 0; i < frame->lamps.count && frame->particles.set_count > 0; ++i) {
        spsi_lamp *lamp = &frame->lamps.list[i];
        const int is_known = lamp->choice == SPSI_CHOICE_CALLER || lamp->extent.exists ||
                             (open + sliced == 0 && spsi_axis_serves(frame, lamp));
        if (!is_known || lamp->choice == SPSI_CHOICE_OPEN)
            lamp->choice = is_known ? SPSI_CHOICE_SHEETS : SPSI_CHOICE_OPEN;
        open += !is_known;
        sliced += is_known && lamp->sliced;
    }
}

/* Number of lights that have sheets, or may. */
static int spsi_plan_sliced_count(const spsi_frame *frame) {
    int count = 0;
    for (int i = 0; i < frame->lamps.count; ++i)
        count += frame->lamps.list[i].sliced || frame->lamps.list[i].choice == SPSI_CHOICE_OPEN;
    return count;
}

/* Number of sweeps, at most: of parts of the image in the region, where no light needs sheets. Particles may turn out
   to call for all four where slabs about the camera's axis do not serve the whole image. */
static int spsi_plan_sweep_count(const spsi_frame *frame) {
    const int sliced = spsi_plan_sliced_count(frame);
    double axis[3];
    int parts = 0, part[4], sheets = 0;
    for (int i = 0; i < frame->lamps.count; ++i)
        sheets |= frame->lamps.list[i].sliced && frame->lamps.list[i].choice != SPSI_CHOICE_OPEN;
    spsi_eye_axis(&frame->content->eye, axis);
    for (int n = 0; n < spsi_part_count(frame); ++n) {
        spsi_part_place(frame, n, part);
        parts += spsi_part_meets(part, frame->view.region);
    }
    if (frame->particles.set_count > 0 && !sheets)
        parts = spsi_cosine_to_corners(axis, &frame->content->eye) >= SPSI_COSINE_MIN ? 1 : 4;
    return spsi_most(parts, sliced);
}

/* Number of lights whose shadows the n-th sweep carries, at most. */
static int spsi_plan_shadow_count(const spsi_frame *frame, int n) {
    int open = 0;
    for (int i = 0; i < frame->lamps.count; ++i) open |= frame->lamps.list[i].choice == SPSI_CHOICE_OPEN;
    return open && n == 0 ? frame->lamps.shadow_count : spsi_sweep_shadow_count(frame, n);
}

/* --- sweeps --- */

/* Bytes of the largest sweep's planes, sheets, queues and pixels. */
static sps_result spsi_plan_sweep_bytes(sps_context *context, const spsi_frame *frame, const spsi_sweep *sweep, int n,
                                        uint64_t bricks, sps_plan_report *report) {
    const size_t width = (size_t)frame->view.region[2], height = (size_t)frame->view.region[3];
    const size_t workers = (size_t)spsi_worker_count(context);
    const size_t side = spsi_plan_light_side(frame, sweep);
    const int shadows = spsi_most(1, spsi_plan_shadow_count(frame, n));
    size_t eye = workers * (spsi_plan_sheet_floats(frame) * sizeof(float) + 48) +
                 spsi_plan_queues_bytes(frame, &sweep->slabs, (size_t)bricks) + 64;
    spsi_region region;
    spsi_region_place(frame, &region);
    eye += spsi_region_tiles(&region) * SPSI_REGION_TILE_BYTES;
    eye += spsi_region_tiles(&region) * SPSI_TILE_WIDTH * SPSI_TILE_HEIGHT * spsi_pixel_floats(frame) * sizeof(float);
    eye += width * height * spsi_total_floats(frame) * sizeof(float) + width * SPSI_ROW_FLOATS * sizeof(float);
    eye += spsi_run_bytes(context) + (size_t)shadows * sizeof(spsi_shadow) +
           spsi_vectors_bytes(context, frame->matter.material_count * SPSI_PARTS, sizeof(spsi_sample)) +
           spsi_vectors_bytes(context, shadows, sizeof(spsi_arrival));
    eye += spsi_plan_lists_bytes(frame, frame->content->eye.width, frame->content->eye.height);
    if (eye > report->pass[SPS_PASS_EYE_SHEETS].bytes) report->pass[SPS_PASS_EYE_SHEETS].bytes = eye;
    if (sweep->lamp) {
        const size_t tiles = (side / SPSI_TILE_WIDTH + 1) * (side / SPSI_TILE_HEIGHT + 1);
        const size_t light =
            (side * side + tiles) * SPSI_PLANES_TEXEL_BYTES + spsi_plan_lists_bytes(frame, (int)side, (int)side);
        if (light > report->pass[SPS_PASS_LIGHT_SHEETS].bytes) report->pass[SPS_PASS_LIGHT_SHEETS].bytes = light;
    }
    if (sweep->lamp && sweep->lamp->extent.exists && spsi_plan_penumbra_bytes(context, frame, sweep, report))
        return context->result;
    report->slab_count = spsi_most(report->slab_count, frame->medium_count > 0 ? sweep->slabs.count : 0);
    if (!sweep->lamp) return SPS_OK;
    report->shadow_width = spsi_most(report->shadow_width, frame->particles.set_count ? (int)side : sweep->rays.width);
    report->shadow_height =
        spsi_most(report->shadow_height, frame->particles.set_count ? (int)side : sweep->rays.height);
    return SPS_OK;
}

static void spsi_plan_pass(sps_plan_report *report, sps_pass pass, int runs, const char *why, const char *why_not) {
    report->pass[pass].runs = runs;
    report->pass[pass].reason = runs ? why : why_not;
}

static void spsi_plan_gather_pass(const spsi_frame *frame, const spsi_reading *reading, sps_plan_report *report) {
    const int volumes = frame->medium_count > 0 && reading->blocks > 0, particles = frame->particles.set_count > 0;
    spsi_plan_pass(report, SPS_PASS_GATHER, volumes || particles,
                   !particles ? "volumes must be read"
                   : volumes  ? "volumes and particles must be read"
                              : "particles must be read",
                   frame->medium_count == 0 ? "no volume or particle that could be seen"
                   : reading->held          ? "the voxels are held from an earlier call"
                                            : "range_fn shows that no voxel matters");
}

/* Why lights have maps: the first of the library's reasons, or the caller's. */
static const char *spsi_plan_map_reason(const spsi_frame *frame) {
    static const char *const reasons[] = {"lights have a shadow_map or SPS_SHADOW_TABLE",
                                          "a table, if particles turn out to call for one",
                                          "",
                                          "a table: the light is in the gas",
                                          "a table: no slabs serve both the light and so wide a camera",
                                          "a table: the light shares the sweep of another"};
    for (int choice = SPSI_CHOICE_OPEN; choice <= SPSI_CHOICE_TABLE_SHARED; ++choice)
        for (int i = 0; i < frame->lamps.count && choice != SPSI_CHOICE_SHEETS; ++i)
            if ((int)frame->lamps.list[i].choice == choice) return reasons[choice];
    return reasons[SPSI_CHOICE_CALLER];
}

static void spsi_plan_shadow_passes(const spsi_frame *frame, int gases, sps_plan_report *report) {
    const int shade = frame->matter.extinguishes;
    const char *nothing = gases ? "nothing has extinction" : "no volume or particle that could be seen";
    int maps = 0;
    for (int i = 0; i < frame->lamps.count; ++i)
        maps += frame->lamps.list[i].has_map || frame->lamps.list[i].choice == SPSI_CHOICE_OPEN;
    spsi_plan_pass(report, SPS_PASS_LIGHT_SHEETS, spsi_plan_sliced_count(frame), "volumes or particles cast shadows",
                   !shade                      ? nothing
                   : frame->lamps.shadow_count ? "every light that casts shadows has a shadow_map or a table"
                                               : "no light casts shadows on anything");
    spsi_plan_pass(report, SPS_PASS_LIGHT_MAPS, maps, spsi_plan_map_reason(frame),
                   !shade ? nothing : "no light that casts shadows has a shadow_map or a table");
}

static void spsi_plan_penumbra_pass(const spsi_frame *frame, int gases, sps_plan_report *report) {
    int extended = 0;
    report->light_points = frame->lamps.count > 0;
    for (int i = 0; i < frame->lamps.count; ++i) {
        extended |= frame->lamps.list[i].extent.exists && frame->lamps.list[i].shadows;
        report->light_points = spsi_most(report->light_points, frame->lamps.list[i].point_count);
    }
    spsi_plan_pass(report, SPS_PASS_PENUMBRAE, report->pass[SPS_PASS_PENUMBRAE].runs, "lights have an extent",
                   !extended ? "no light that casts shadows has an extent"
                   : !gases  ? "no volume or particle that could be seen"
                             : "all penumbrae in gas are narrower than half a texel: they are left sharp");
}

static void spsi_plan_polygon_passes(const spsi_frame *frame, int gases, int held, sps_plan_report *report) {
    const int polygons = frame->meshes.triangle_count > 0, shadows = polygons ? frame->lamps.shadow_count : 0;
    const int hard = shadows - (polygons ? report->pass[SPS_PASS_PENUMBRAE].runs : 0);
    const char *nothing = polygons ? "no light casts shadows" : "no triangles";
    spsi_plan_pass(report, SPS_PASS_EYE_POLYGONS, polygons, "there are triangles", "no triangles");
    spsi_plan_pass(report, SPS_PASS_LAYERS, spsi_has_layers(frame),
                   frame->meshes.translucent ? "meshes are translucent" : "coverage_samples is set",
                   polygons ? "no mesh is translucent, and coverage_samples is not set" : "no triangles");
    spsi_plan_pass(report, SPS_PASS_TEXTURES, frame->meshes.textured_count > 0, "meshes have a shade_fn",
                   polygons ? "no mesh has a shade_fn" : "no triangles");
    spsi_plan_pass(report, SPS_PASS_LIGHT_POLYGONS, gases && frame->matter.scatters ? hard : 0,
                   "polygons cast shadows on gas, one map per light without penumbrae",
                   shadows == 0 ? nothing
                   : hard == 0  ? "all lights that cast shadows cast penumbrae on gas"
                                : "no volume or particle that scatters light");
    spsi_plan_pass(report, SPS_PASS_TRIANGLE_TREE, shadows > 0 && !held, "polygons cast shadows on polygons",
                   shadows == 0 ? nothing : "the tree is held from an earlier call");
    spsi_plan_pass(report, SPS_PASS_SHADOW_RAYS, shadows, "polygons cast shadows on polygons", nothing);
}

static void spsi_plan_passes(const sps_context *context, const spsi_frame *frame, const spsi_reading *reading,
                             sps_plan_report *report) {
    const int gases = spsi_has_gas(frame), polygons = frame->meshes.triangle_count > 0;
    const int sweeps = report->sweep_count, lit = frame->lamps.count > 0;
    const int held = context->tree_held && spsi_faces_held(context, frame);
    spsi_plan_gather_pass(frame, reading, report);
    spsi_plan_pass(report, SPS_PASS_PROJECTORS, frame->lamps.image_count, "lights throw an image",
                   lit ? "no light throws an image" : "no light");
    spsi_plan_polygon_passes(frame, gases, held, report);
    spsi_plan_pass(report, SPS_PASS_EYE_SHEETS, gases ? sweeps : 0,
                   sweeps == 1 ? "volumes or particles are seen, one sweep"
                   : spsi_plan_sliced_count(frame) > 0
                       ? "volumes or particles are seen, one sweep for each light that shades by sheets"
                       : "volumes or particles are seen, one sweep for each part of an image too wide for one",
                   "no volume or particle that could be seen");
    spsi_plan_shadow_passes(frame, gases, report);
    spsi_plan_penumbra_pass(frame, gases, report);
    spsi_plan_pass(report, SPS_PASS_GRADIENT, frame->gradients.exist ? sweeps : 0, "a volume is shaded as a surface",
                   "no volume shaded as a surface, or no light for it");
    spsi_plan_pass(report, SPS_PASS_SCATTERING, frame->matter.scatters && lit ? sweeps : 0,
                   "volumes or particles scatter light",
                   frame->matter.scatters ? "no light" : "nothing scatters: albedo 0 or no extinction");
    spsi_plan_pass(report, SPS_PASS_EMISSION, frame->matter.emits, "volumes or particles emit", "nothing emits");
    spsi_plan_pass(report, SPS_PASS_AMBIENT, frame->ambient.exists && (frame->matter.scatters || polygons),
                   "there is ambient light", frame->ambient.exists ? "nothing to light" : "ambient is black");
    spsi_plan_pass(report, SPS_PASS_SURFACE_LIGHT, polygons && lit ? sweeps : 0, "lights shine on polygons",
                   polygons ? "no light" : "no triangles");
}

/* Bytes of everything outside the sweeps. */
static void spsi_plan_bytes(const sps_context *context, const spsi_frame *frame, const spsi_reading *reading,
                            sps_plan_report *report) {
    const size_t size = (size_t)spsi_depth_map_size(frame);
    const size_t lights = (size_t)spsi_plan_shadow_count(frame, 0); /* at once */
    size_t tables = 1, sum = sizeof *context + sizeof *frame + sizeof *frame->content;
    int shares = (int)lights;
    for (int i = 0; i < frame->medium_count; ++i)
        tables += frame->matter.materials[frame->media[i].channel].table != NULL;
    report->pass[SPS_PASS_GATHER].bytes = spsi_plan_gather_bytes(frame, reading) + tables * sizeof(spsi_table) +
                                          frame->particles.count * sizeof(sps_particle);
    report->pass[SPS_PASS_PROJECTORS].bytes = spsi_images_bytes(frame);
    for (int i = 0; i < frame->lamps.count; ++i) shares += spsi_lit_channels(frame, &frame->lamps.list[i]) - 1;
    if (frame->meshes.triangle_count > 0) {
        report->pass[SPS_PASS_EYE_POLYGONS].bytes =
            frame->meshes.triangle_count * (sizeof(spsi_face) + 4 * sizeof(int)) +
            (size_t)frame->content->eye.width * (size_t)frame->content->eye.height * sizeof(spsi_hit) +
            SPSI_BLOCK_BYTES;
        report->pass[SPS_PASS_LAYERS].bytes = spsi_layers_bytes(context, frame);
        report->pass[SPS_PASS_TEXTURES].bytes = spsi_textures_bytes(frame);
        if (frame->lamps.shadow_count > 0) {
            if (frame->matter.scatters)
                report->pass[SPS_PASS_LIGHT_POLYGONS].bytes = lights * spsi_depth_map_floats_most(size) * sizeof(float);
            report->pass[SPS_PASS_TRIANGLE_TREE].bytes = spsi_tree_bytes(frame->meshes.triangle_count);
            report->pass[SPS_PASS_SHADOW_RAYS].bytes =
                spsi_sight_bytes(context, spsi_ray_count(&frame->content->eye), shares);
        }
    }
    for (int i = 0; i < SPS_PASS_COUNT; ++i) sum += report->pass[i].bytes;
    report->bytes = sum + (context->stats.bytes > sizeof *context ? context->stats.bytes - sizeof *context : 0);
}

/* Bytes of the lights' maps, which are held at the same time, and of filling them one after the other. */
static void spsi_plan_tmaps(const spsi_frame *frame, uint64_t bricks, sps_plan_report *report) {
    size_t most = 0, prints = 0;
    for (int i = 0; i < frame->lamps.count; ++i) {
        spsi_lamp lamp = frame->lamps.list[i];
        size_t held, filling;
        lamp.has_map |= lamp.choice == SPSI_CHOICE_OPEN;
        if (!lamp.has_map) continue;
        spsi_lamp_tmap_bytes(frame, &lamp, &held, &filling);
        report->pass[SPS_PASS_LIGHT_MAPS].bytes += held;
        if (filling > most) most = filling;
        if (spsi_has_shadow_table(&lamp)) prints = (size_t)bricks * sizeof(uint64_t);
    }
    report->pass[SPS_PASS_LIGHT_MAPS].bytes += most + prints;
}

/* All sweeps, and those of lights that may turn out to need one. */
static sps_result spsi_plan_sweeps(sps_context *context, const spsi_frame *frame, uint64_t bricks,
                                   sps_plan_report *report) {
    spsi_sweep sweep;
    for (int n = 0; n < spsi_sweep_count(frame); ++n)
        for (int part = 0; part < spsi_part_count(frame); ++part)
            if (spsi_sweep_build(context, frame, n, part, &sweep) ||
                spsi_plan_sweep_bytes(context, frame, &sweep, n, bricks, report))
                return context->result;
    for (int i = 0; i < frame->lamps.count; ++i) {
        if (frame->lamps.list[i].choice != SPSI_CHOICE_OPEN || frame->lamps.list[i].sliced) continue;
        spsi_sweep_clear(frame, &frame->lamps.list[i], 0, &sweep);
        if (spsi_plan_sweep_bytes(context, frame, &sweep, 0, bricks, report)) return context->result;
    }
    return SPS_OK;
}

static sps_result spsi_plan_frame(sps_context *context, spsi_frame *frame, sps_plan_report *report) {
    spsi_reading reading;
    uint64_t bricks;
    spsi_plan_choices(context, frame);
    if (spsi_plan_reading(context, frame, report, &reading)) return context->result;
    bricks = reading.held ? (uint64_t)context->brick_count : reading.bricks;
    if (spsi_plan_sweeps(context, frame, bricks, report)) return context->result;
    spsi_plan_tmaps(frame, bricks, report);
    for (int i = 0; i < frame->meshes.count && !spsi_faces_held(context, frame); ++i)
        report->triangle_calls +=
            (frame->meshes.list[i].triangle_count + SPSI_TRIANGLE_BATCH - 1) / SPSI_TRIANGLE_BATCH;
    for (int i = 0; i < frame->particles.set_count; ++i)
        report->particle_calls += (frame->particles.sets[i].count + SPSI_PARTICLE_BATCH - 1) / SPSI_PARTICLE_BATCH;
    for (int i = 0; i < frame->lamps.count; ++i)
        report->projector_calls += (uint64_t)frame->lamps.list[i].projection.height;
    report->sweep_count = spsi_plan_sweep_count(frame);
    report->color_channels = frame->channels;
    report->sheet_channels = frame->matter.material_count * (frame->gradients.splatted ? 3 : 1);
    spsi_plan_bytes(context, frame, &reading, report);
    spsi_plan_passes(context, frame, &reading, report);
    for (int i = 0; i < SPS_PASS_COUNT; ++i)
        if (report->pass[i].runs == 0) report->pass[i].bytes = 0; /* the rest is part of the sum only */
    return SPS_OK;
}

/* ============================================================================================ >>reference
   30 The same scene by brute force, as a measure: f(p) summed over all voxels within SPSI_REFERENCE_REACH, marched at
   the midpoints of equal steps, a shadow ray at every sample, and triangles and balls intersected exactly through trees
   of boxes, in double precision. It shares with the renderer how samples and surfaces respond to light (samples in
   floats), and the tests of a ray with a triangle (>>polygons), but nothing else about where light goes. Second order
   in the step. Rays are marched in rounds, each from one translucent triangle to the next, so that shade_fn can be
   called for all pixels in between. Cost: pixels * samples per ray * (1 + lights * samples per shadow ray) * 343
   voxels. */

#define SPSI_REFERENCE_REACH  3.25 /* voxels, 5 standard deviations: 2e-6 of the kernel's mass is beyond */
#define SPSI_REFERENCE_TAPS   8
#define SPSI_REFERENCE_POINTS 64 /* of an extended light at each place */

typedef struct spsi_dense {
    const float *values;
    unsigned char *occupied; /* per brick, 1: it or a neighbour holds something */
    int size[3];             /* in voxels */
    int bricks[3];           /* size in bricks */
    double inverse[3][3];    /* rows; world offset from the corner to voxels */
    double corner[3];        /* in the world */
} spsi_dense;

/* The ray of a pixel, on its way from one translucent face to the next. */
typedef struct spsi_walker {
    double sums[5];     /* over the pixel's samples so far: color, coverage, distance weighted by coverage */
    double radiance[3]; /* of what lies before `low` */
    double through[3];  /* share of each color that passes it */
    double distance;    /* weighted by what is taken from `through` */
    double low, high;   /* the part of the ray before the next face, in world length */
    double depth;       /* of the next face: t - depth_reference; where the part begins if there is none yet */
    spsi_hit hit;       /* of the next face */
    int ended;          /* 1: nothing more is seen */
} spsi_walker;

typedef struct spsi_marcher {
    const spsi_frame *frame;
    const spsi_faces *faces;
    spsi_dense grids[SPSI_VOLUMES_MAX]; /* one for each volume */
    spsi_tree particles;                /* of all sets */
    int part_count;                     /* number of volumes and sets of particles; parts are in this order */
    double step;                        /* maximum, in world length */
    float *total;                       /* the region's pixels, spsi_total_floats each */
    int first_row;                      /* of the current batch, in the region */
    spsi_walker *walkers;               /* of the region's pixels */
    int side;                           /* number of samples along a pixel's side */
    int sample;                         /* number of the current one */
    spsi_hit *hits;                     /* of the whole image, for shade_fn; NULL: no mesh has one */
    spsi_visible visible;               /* those hits, and what shade_fn has set there */
    spsi_sample *samples;               /* one per part, per worker */
} spsi_marcher;

/* --- the field --- */

/* Computes the weights of the taps around `at` along one axis, and their derivatives. Returns the first tap. */
static int spsi_field_taps(double at, int size, int *count, double *weights, double *slopes) {
    const int first = spsi_most(0, (int)ceil(fmax(at - 0.5 - SPSI_REFERENCE_REACH, -1)));
    const int last = spsi_least(size - 1, (int)floor(fmin(at - 0.5 + SPSI_REFERENCE_REACH, size)));
    const double scale = 1 / (sqrt(2 * SPSI_PI) * SPSI_SIGMA * erf(SPSI_REFERENCE_REACH / SPSI_SIGMA / sqrt(2.0)));
    *count = spsi_most(0, last - first + 1);
    for (int i = 0; i < *count; ++i) {
        const double d = (at - 0.5 - first - i) / SPSI_SIGMA;
        weights[i] = scale * exp(-0.5 * d * d);
        slopes[i] = -weights[i] * d / SPSI_SIGMA;
    }
    return first;
}

static int spsi_dense_empty(const spsi_dense *grid, const double at[3]) {
    int index = 0;
    for (int i = 2; i >= 0; --i) {
        const int brick = (int)floor(fmin(fmax(at[i], 0), grid->size[i] - 1)) / SPSI_BRICK;
        if (at[i] < -SPSI_REFERENCE_REACH || at[i] > grid->size[i] + SPSI_REFERENCE_REACH) return 1;
        index = index * grid->bricks[i] + brick;
    }
    return !grid->occupied[index];
}

/* f at a world point, and its gradient in the world unless `gradient` is NULL. */
static double spsi_field(const spsi_dense *grid, const double point[3], double gradient[3]) {
    double offset[3], at[3], w[3][SPSI_REFERENCE_TAPS], s[3][SPSI_REFERENCE_TAPS], sum = 0, g[3] = {0, 0, 0};
    int first[3], count[3];
    spsi_along(point, grid->corner, -1, offset);
    for (int i = 0; i < 3; ++i) at[i] = spsi_dot(grid->inverse[i], offset);
    if (gradient) memset(gradient, 0, 3 * sizeof(double));
    if (spsi_dense_empty(grid, at)) return 0;
    for (int i = 0; i < 3; ++i) first[i] = spsi_field_taps(at[i], grid->size[i], &count[i], w[i], s[i]);
    for (int z = 0; z < count[2]; ++z)
        for (int y = 0; y < count[1]; ++y) {
            const float *row =
                grid->values +
                ((size_t)(first[2] + z) * (size_t)grid->size[1] + (size_t)(first[1] + y)) * (size_t)grid->size[0] +
                (size_t)first[0];
            double along = 0, slope = 0;
            for (int x = 0; x < count[0]; ++x) along += w[0][x] * (double)row[x];
            sum += w[2][z] * w[1][y] * along;
            if (!gradient) continue;
            for (int x = 0; x < count[0]; ++x) slope += s[0][x] * (double)row[x];
            g[0] += w[2][z] * w[1][y] * slope;
            g[1] += w[2][z] * s[1][y] * along;
            g[2] += s[2][z] * w[1][y] * along;
        }
    for (int i = 0; i < 3 && gradient; ++i)
        for (int k = 0; k < 3; ++k) gradient[k] += g[i] * grid->inverse[i][k];
    return sum;
}

/* --- intersections of rays --- */

typedef struct spsi_ray {
    double origin[3], direction[3];
    double low, high; /* segment of interest, in lengths of `direction` from the origin */
} spsi_ray;

static int spsi_ray_meets_box(const spsi_ray *ray, const double low[3], const double high[3], double range[2]) {
    range[0] = ray->low;
    range[1] = ray->high;
    for (int i = 0; i < 3; ++i) {
        const double d = ray->direction[i], from = ray->origin[i];
        double a, b;
        if (!(fabs(d) > 0)) {
            if (from < low[i] || from > high[i]) return 0;
            continue;
        }
        a = (low[i] - from) / d;
        b = (high[i] - from) / d;
        range[0] = fmax(range[0], fmin(a, b));
        range[1] = fmin(range[1], fmax(a, b));
    }
    return range[0] <= range[1];
}

/* Boxes are floats, rounded outwards; they need a margin for the sums in double precision that place them about the
   centre, and for those by which faces are tested, so that none is missed that is hit by round-off. */
static int spsi_ray_meets_node(const spsi_tree *tree, const spsi_ray *ray, const spsi_tree_node *node) {
    double low[3], high[3], range[2], room = 0;
    for (int i = 0; i < 3; ++i)
        room += fabs(tree->centre[i]) + fabs(ray->origin[i]) + fabs((double)node->low[i]) + fabs((double)node->high[i]);
    room *= 1e-12;
    for (int i = 0; i < 3; ++i) {
        low[i] = tree->centre[i] + (double)node->low[i] - room;
        high[i] = tree->centre[i] + (double)node->high[i] + room;
    }
    return spsi_ray_meets_box(ray, low, high, range);
}

/* Optical depth of a ball along a segment of a ray: that of the whole chord times the difference of a function of s at
   the segment's ends, s running from -1 to 1 along the chord. It is s / 2 for density 1, and 3 s / 4 - s^3 / 4 for
   density 1 - (r / radius)^2. */
static double spsi_ray_depth_in_ball(const spsi_ray *ray, const sps_particle *particle, const spsi_particle_set *set) {
    const double radius = (double)particle->radius;
    double offset[3], ends[2], middle, square, half, depth = (double)particle->optical_depth;
    for (int i = 0; i < 3; ++i) offset[i] = (double)particle->position[i] - ray->origin[i];
    middle = spsi_dot(offset, ray->direction);
    spsi_along(offset, ray->direction, -middle, offset);
    square = 1 - spsi_dot(offset, offset) / (radius * radius);
    if (!(square > 0)) return 0;
    if (set->is_extinction) depth *= radius * (set->soft ? 4.0 / 3 : 2.0);
    half = radius * sqrt(square);
    ends[0] = fmin(fmax((ray->low - middle) / half, -1), 1);
    ends[1] = fmin(fmax((ray->high - middle) / half, -1), 1);
    for (int i = 0; i < 2; ++i) ends[i] *= set->soft ? (3 - ends[i] * ends[i]) / 4 : 0.5;
    return fmin(depth, (double)SPSI_DEPTH_MAX) * sqrt(square) * (set->soft ? square : 1) * (ends[1] - ends[0]);
}

/* Adds the optical depth of each set of particles along a segment of a ray to `depths`. */
static void spsi_trace_particles(const spsi_marcher *marcher, const spsi_ray *ray, double *depths) {
    const spsi_tree *tree = &marcher->particles;
    const spsi_frame *frame = marcher->frame;
    int stack[SPSI_TREE_STACK], top = 0;
    if (tree->count == 0 || !(ray->high > ray->low)) return;
    stack[top++] = 0;
    while (top > 0) {
        const spsi_tree_node *node = &tree->nodes[stack[--top]];
        if (!spsi_ray_meets_node(tree, ray, node)) continue;
        for (int i = 0; i < node->count; ++i) {
            const int particle = tree->order[node->first + i];
            const spsi_particle_set *set = spsi_set_of(frame, particle);
            depths[set - frame->particles.sets] +=
                spsi_ray_depth_in_ball(ray, &frame->content->particles[particle], set);
        }
        if (node->count > 0) continue;
        stack[top++] = node->first;
        stack[top++] = node->first + 1;
    }
}

/* The ray of a pixel, from the near plane on. Returns its length per unit of t. */
static double spsi_march_ray(const spsi_rays *eye, int x, int y, spsi_ray *ray) {
    double length;
    spsi_ray_point(eye, x, y, 0, ray->origin);
    spsi_ray_direction(eye, x, y, ray->direction);
    length = spsi_length(ray->direction);
    spsi_normalise(ray->direction);
    ray->low = eye->near_depth > -DBL_MAX ? eye->near_depth * length : -HUGE_VAL;
    ray->high = HUGE_VAL;
    return length;
}

/* Finds a face where a pixel's ray meets it, in the same way as the rasteriser does, but in double precision; returns
   0 if it does not. Faces along a ray are in order of depth, or of their numbers where depths are equal: `after`
   precedes what is found, which precedes `nearest`. */
static int spsi_march_face(const spsi_marcher *marcher, int number, int x, int y, const spsi_walker *after,
                           spsi_walker *nearest) {
    const spsi_rays *eye = &marcher->frame->content->eye;
    spsi_edges e;
    double w[3], depth;
    spsi_face_edges(marcher->faces, number, eye, &e);
    if (!spsi_face_hit(&e, x, y, w)) return 0;
    depth = w[0] * e.depth[0] + w[1] * e.depth[1] + w[2] * e.depth[2];
    if (!(depth + eye->depth_reference > eye->near_depth)) return 0;
    if (depth < after->depth || (!(depth > after->depth) && number <= after->hit.face)) return 0;
    if (depth > nearest->depth || (!(depth < nearest->depth) && number >= nearest->hit.face)) return 0;
    nearest->depth = depth;
    nearest->hit.depth = (float)depth;
    nearest->hit.face = number;
    for (int i = 0; i < 2; ++i) nearest->hit.weights[i] = (float)w[i + 1];
    return 1;
}

/* Finds the next face that a pixel's ray meets. If there is none, the ray goes on for ever. */
static void spsi_march_meet(const spsi_marcher *marcher, int x, int y, spsi_walker *walker) {
    const spsi_tree *tree = &marcher->faces->tree;
    const double reference = marcher->frame->content->eye.depth_reference;
    int stack[SPSI_TREE_STACK], top = 0;
    spsi_walker next = *walker;
    spsi_ray ray;
    const double length = spsi_march_ray(&marcher->frame->content->eye, x, y, &ray);
    next.low = ray.low = fmax(ray.low, walker->high);
    next.depth = next.high = HUGE_VAL;
    next.hit.face = -1;
    if (tree->count > 0) stack[top++] = 0;
    while (top > 0) {
        const spsi_tree_node *node = &tree->nodes[stack[--top]];
        if (!spsi_ray_meets_node(tree, &ray, node)) continue;
        for (int i = 0; i < node->count; ++i)
            if (spsi_march_face(marcher, tree->order[node->first + i], x, y, walker, &next))
                ray.high = next.high = (next.depth + reference) * length;
        if (node->count > 0) continue;
        stack[top++] = node->first;
        stack[top++] = node->first + 1;
    }
    *walker = next;
}

/* Share of a light's red, green and blue that polygons let pass to a point on face `own` (-1: on none). Returns 0 if
   they let nothing pass. */
static int spsi_march_sight(const spsi_faces *faces, const spsi_lamp *lamp, const double point[3], int own,
                            double passes[3]) {
    const spsi_tree *tree = &faces->tree;
    int stack[SPSI_TREE_STACK], top = 0;
    spsi_packet packet;
    spsi_ray ray;
    passes[0] = passes[1] = passes[2] = 1;
    if (tree->count == 0) return 1;
    memcpy(ray.origin, point, sizeof ray.origin);
    spsi_toward_lamp(lamp, point, ray.direction);
    spsi_packet_begin(faces, !lamp->is_point, own >= 0, &packet);
    spsi_packet_add(tree, 0, own, ray.origin, ray.direction, &packet);
    ray.low = 0;
    ray.high = packet.reach;
    stack[top++] = 0;
    while (top > 0) {
        const spsi_tree_node *node = &tree->nodes[stack[--top]];
        if (!spsi_ray_meets_node(tree, &ray, node)) continue;
        for (int i = 0; i < node->count; ++i) {
            const int number = tree->order[node->first + i];
            const spsi_face *face = &faces->list[number];
            if (number == own || !(spsi_face_stops(face, &packet, 0) & 1)) continue;
            if (!spsi_black(face->transmittance) && !spsi_face_passes(face, ray.origin, ray.direction)) continue;
            for (int c = 0; c < 3; ++c) passes[c] *= (double)face->transmittance[c];
            if (!(passes[0] > 0 || passes[1] > 0 || passes[2] > 0)) return 0;
        }
        if (node->count > 0) continue;
        stack[top++] = node->first;
        stack[top++] = node->first + 1;
    }
    return 1;
}

/* --- transport --- */

static const spsi_material *spsi_part_material(const spsi_frame *frame, int part) {
    return &frame->matter
                .materials[part < frame->medium_count ? frame->media[part].channel
                                                      : frame->particles.sets[part - frame->medium_count].channel];
}

/* Clips a ray to the bounds of all gas. Returns the number of steps in what is left. */
static int spsi_march_range(const spsi_marcher *marcher, const double origin[3], const double direction[3], double low,
                            double high, double range[2]) {
    spsi_ray ray;
    if (marcher->part_count == 0) return 0;
    memcpy(ray.origin, origin, sizeof ray.origin);
    memcpy(ray.direction, direction, sizeof ray.direction);
    ray.low = low;
    ray.high = high;
    if (!spsi_ray_meets_box(&ray, marcher->frame->content->bounds.low, marcher->frame->content->bounds.high, range))
        return 0;
    if (!(range[1] > range[0])) return 0;
    return (int)fmin(fmax(ceil((range[1] - range[0]) / marcher->step), 1), 1e8);
}

/* Extinction of one volume where its value is f. If it is classified and f > 0, `appearance` gets its color and
   extinction. */
static double spsi_extinction_at(const spsi_material *material, double f, float appearance[4]) {
    spsi_v out[4];
    float lanes[SPSI_LANES];
    if (!material->table) return f * (double)material->extinction;
    if (!(f > 0)) return 0;
    spsi_classify(material, spsi_set((float)f), out);
    for (int c = 0; c < 4; ++c) {
        spsi_store(lanes, out[c]);
        appearance[c] = lanes[0];
    }
    return (double)appearance[3];
}

/* Transmittance of all gas between a point and a light. */
static double spsi_march_lamp(const spsi_marcher *marcher, const spsi_lamp *lamp, const double point[3]) {
    double toward[3], range[2], depths[SPSI_SETS_MAX] = {0}, depth = 0, beyond = HUGE_VAL;
    int count;
    spsi_ray ray;
    spsi_lamp_direction(lamp, point, toward);
    for (int i = 0; i < 3; ++i) toward[i] = -toward[i];
    if (lamp->is_point) {
        double offset[3];
        spsi_along(lamp->position, point, -1, offset);
        beyond = spsi_length(offset);
    }
    memcpy(ray.origin, point, sizeof ray.origin);
    memcpy(ray.direction, toward, sizeof toward);
    ray.low = 0;
    ray.high = beyond;
    spsi_trace_particles(marcher, &ray, depths);
    for (int i = 0; i < marcher->frame->particles.set_count; ++i) depth += depths[i];
    if (marcher->frame->medium_count == 0) return exp(-depth);
    count = spsi_march_range(marcher, point, toward, 0, beyond, range);
    for (int i = 0; i < count; ++i) {
        const double h = (range[1] - range[0]) / count;
        double at[3];
        spsi_along(point, toward, range[0] + (i + 0.5) * h, at);
        for (int m = 0; m < marcher->frame->medium_count; ++m) {
            const spsi_material *material = &marcher->frame->matter.materials[marcher->frame->media[m].channel];
            float appearance[4];
            if (material->extinguishes)
                depth += h * spsi_extinction_at(material, spsi_field(&marcher->grids[m], at, NULL), appearance);
        }
    }
    return exp(-depth);
}

/* Fills a sample with a volume's color at a point, and with the normal from the field's gradient. */
static void spsi_march_sample(const spsi_material *material, const float appearance[4], const double gradient[3],
                              spsi_sample *sample) {
    double n[3] = {-gradient[0], -gradient[1], -gradient[2]};
    const double size = spsi_length(n);
    memset(sample, 0, sizeof *sample);
    for (int c = 0; c < 3; ++c) sample->color[c] = spsi_set(material->table ? appearance[c] : material->albedo[c]);
    if (!material->table || material->shading != SPS_SHADING_SURFACE) return;
    spsi_normalise(n);
    spsi_set3(n, sample->normal);
    sample->surface = spsi_set((float)fmin(1, size * (double)(material->voxel_length * material->gradient_scale)));
    sample->has_normal = 1;
}

/* The gas on one step along a ray: volumes at its middle, particles averaged over all of it. */
typedef struct spsi_point {
    double position[3];                    /* middle of the step, in the world */
    double direction[3];                   /* of the eye's ray, of unit length */
    double half;                           /* half of the step's length */
    double pixel;                          /* world size of a pixel there */
    double value[SPSI_MATERIALS_MAX];      /* of each part; of particles, their extinction */
    double extinction[SPSI_MATERIALS_MAX]; /* of each part */
    double extinction_sum;                 /* of all parts */
    double value_sum;                      /* of all parts; 0: there is nothing */
    spsi_sample *samples;                  /* one per part */
} spsi_point;

static void spsi_point_take(spsi_point *point, int part, double value, double extinction) {
    point->value[part] = value;
    point->extinction[part] = extinction;
    point->value_sum += value;
    point->extinction_sum += extinction;
}

/* Samples the step from ray->low to ray->high of a ray whose direction has unit length. */
static void spsi_point_build(const spsi_marcher *marcher, const spsi_ray *ray, spsi_point *point) {
    const spsi_frame *frame = marcher->frame;
    double depths[SPSI_SETS_MAX] = {0}, depth[3];
    float appearance[4] = {0, 0, 0, 0};
    spsi_along(ray->origin, ray->direction, 0.5 * (ray->low + ray->high), point->position);
    memcpy(point->direction, ray->direction, sizeof point->direction);
    point->extinction_sum = point->value_sum = 0;
    point->half = 0.5 * (ray->high - ray->low);
    spsi_to_rays(&frame->content->eye, ray->direction, depth);
    point->pixel = spsi_pixel_size_at(&frame->content->eye, 0.5 * (ray->low + ray->high) * depth[2]);
    for (int m = 0; m < frame->medium_count; ++m) {
        const spsi_material *material = spsi_part_material(frame, m);
        const int surface = material->table && material->shading == SPS_SHADING_SURFACE;
        double gradient[3] = {0, 0, 0}, value;
        memset(appearance, 0, sizeof appearance);
        value = spsi_field(&marcher->grids[m], point->position, surface ? gradient : NULL);
        spsi_point_take(point, m, value, spsi_extinction_at(material, value, appearance));
        spsi_march_sample(material, appearance, gradient, &point->samples[m]);
    }
    spsi_trace_particles(marcher, ray, depths);
    for (int i = 0; i < frame->particles.set_count; ++i) {
        const int part = frame->medium_count + i;
        const double extinction = depths[i] / (ray->high - ray->low), none[3] = {0, 0, 0};
        spsi_point_take(point, part, extinction, extinction);
        spsi_march_sample(spsi_part_material(frame, part), appearance, none, &point->samples[part]);
    }
}

/* Number of points by which the reference samples a light at each place. */
static int spsi_reference_points(const spsi_lamp *lamp) {
    if (!lamp->extent.exists) return 1;
    return lamp->samples > 0 ? lamp->samples : SPSI_REFERENCE_POINTS;
}

/* The n-th of these points: a low-discrepancy sequence [Roberts 2018, R2] that starts elsewhere at every place, by a
   hash of its bits, so that what the points miss is noise and averages out along a ray. */
static void spsi_reference_point(const spsi_lamp *lamp, const double place[3], int n, spsi_lamp *point) {
    const uint64_t hash = spsi_fingerprint(SPSI_FINGERPRINT_START, place, 3 * sizeof *place);
    const double x = 0.75487766624669276 * (n + 1) + (double)(hash >> 40) / 16777216;
    const double y = 0.56984029099805327 * (n + 1) + (double)(hash >> 16 & 0xffffff) / 16777216;
    const double u = x - floor(x), v = y - floor(y), turn = 2 * SPSI_PI * v;
    if (!lamp->extent.exists)
        *point = *lamp;
    else if (lamp->extent.is_disc)
        spsi_lamp_place(lamp, sqrt(u) * cos(turn), sqrt(u) * sin(turn), point);
    else
        spsi_lamp_place(lamp, 2 * u - 1, 2 * v - 1, point);
}

/* The mean of 1 / r^2 over a step, computed as the renderer does over a part of a slab, but in double precision. */
static double spsi_point_inverse_square(const spsi_point *point, const double from[3]) {
    double offset[3], foot[3], s, q, x, y;
    spsi_along(point->position, from, -1, offset);
    s = spsi_dot(offset, point->direction);
    spsi_along(offset, point->direction, -s, foot);
    q = fmax(spsi_length(foot), fmax((double)SPSI_LAMP_PIXELS * point->pixel, DBL_MIN));
    x = q * q + (s - point->half) * (s + point->half);
    y = 2 * point->half * q;
    return y < 1e-6 * x ? 1 / x : atan2(y, x) / y;
}

/* Adds the radiance per unit of length that all gas at a point scatters from one point of a light. */
static void spsi_point_add_lamp(const spsi_marcher *marcher, const spsi_point *point, const spsi_lamp *lamp,
                                double weight, double source[3]) {
    double travel[3], image[3] = {1, 1, 1}, passes[3] = {1, 1, 1}, irradiance = weight;
    spsi_v toward_v[3], travel_v[3], response[3];
    spsi_lamp_direction(lamp, point->position, travel);
    if (lamp->falls_off) irradiance *= spsi_point_inverse_square(point, lamp->position);
    if (lamp->projection.exists) spsi_projection_at(marcher->frame, lamp, point->position, point->pixel, image);
    if (!(image[0] > 0 || image[1] > 0 || image[2] > 0)) return;
    irradiance *= spsi_cone_at(&lamp->cone, spsi_dot(lamp->direction, travel));
    if (!(irradiance > 0)) return;
    if (lamp->shadows) {
        if (!spsi_march_sight(marcher->faces, lamp, point->position, -1, passes)) return;
        irradiance *= spsi_march_lamp(marcher, lamp, point->position);
    }
    spsi_set3(point->direction, toward_v);
    spsi_set3(travel, travel_v);
    for (int m = 0; m < marcher->part_count && irradiance > 0; ++m) {
        const spsi_material *material = spsi_part_material(marcher->frame, m);
        float lanes[SPSI_LANES];
        if (!material->scatters || !(point->extinction[m] > 0)) continue;
        spsi_sample_response(material, &point->samples[m], toward_v, travel_v, response);
        for (int c = 0; c < 3; ++c) {
            spsi_store(lanes, response[c]);
            source[c] +=
                point->extinction[m] * (double)lanes[0] * irradiance * image[c] * passes[c] * (double)lamp->color[c];
        }
    }
}

/* Radiance per unit of length that all gas at a point sends along the ray, before any attenuation. */
static void spsi_point_source(const spsi_marcher *marcher, const spsi_point *point, double source[3]) {
    const spsi_frame *frame = marcher->frame;
    source[0] = source[1] = source[2] = 0;
    for (int m = 0; m < marcher->part_count; ++m) {
        const spsi_material *material = spsi_part_material(marcher->frame, m);
        float lanes[SPSI_LANES];
        for (int c = 0; c < 3; ++c) {
            spsi_store(lanes, point->samples[m].color[c]);
            source[c] += point->extinction[m] * (double)lanes[0] * (double)frame->ambient.radiance[c];
            source[c] += point->value[m] * (double)material->emission[c];
        }
    }
    for (int i = 0; i < frame->lamps.count && point->extinction_sum > 0; ++i)
        for (int n = 0; n < spsi_reference_points(&frame->lamps.list[i]); ++n) {
            spsi_lamp at;
            spsi_reference_point(&frame->lamps.list[i], point->position, n, &at);
            spsi_point_add_lamp(marcher, point, &at, 1.0 / spsi_reference_points(&frame->lamps.list[i]), source);
        }
}

/* Irradiance that reaches a surface from all points of a light, per unit of its color. */
static void spsi_march_arrival(const spsi_marcher *marcher, const spsi_lamp *lamp, int face,
                               const spsi_surface *surface, double arrives[3]) {
    const int count = spsi_reference_points(lamp);
    arrives[0] = arrives[1] = arrives[2] = 0;
    for (int n = 0; n < count; ++n) {
        spsi_lamp at;
        double irradiance[3], passes[3] = {1, 1, 1}, through;
        spsi_reference_point(lamp, surface->point, n, &at);
        if (!spsi_surface_point_irradiance(marcher->frame, &at, surface, irradiance)) continue;
        if (lamp->shadows && !spsi_march_sight(marcher->faces, &at, surface->start, face, passes)) continue;
        through = lamp->shadows ? spsi_march_lamp(marcher, &at, surface->point) : 1;
        for (int c = 0; c < 3; ++c) arrives[c] += irradiance[c] * passes[c] * through;
    }
    for (int c = 0; c < 3; ++c) arrives[c] /= count;
}

/* Radiance of the polygon that a ray meets, from all lights and ambient light. */
static void spsi_march_surface(const spsi_marcher *marcher, const spsi_hit *hit, int x, int y, double radiance[3]) {
    const spsi_frame *frame = marcher->frame;
    spsi_appearance look;
    spsi_surface surface;
    spsi_place place = {hit, x, y, {(double)x, (double)y}, 0};
    spsi_surface_at(&frame->content->eye, marcher->faces, hit, x, y, &surface);
    spsi_appearance_at(marcher->faces, hit, spsi_surface_set(frame, marcher->visible.set, &place), &look);
    for (int c = 0; c < 3; ++c)
        radiance[c] = look.color[c] * (double)frame->ambient.radiance[c] + (double)look.emission[c];
    for (int i = 0; i < frame->lamps.count; ++i) {
        const spsi_lamp *lamp = &frame->lamps.list[i];
        double arrives[3];
        spsi_march_arrival(marcher, lamp, hit->face, &surface, arrives);
        for (int c = 0; c < 3; ++c) radiance[c] += look.color[c] * (arrives[c] / SPSI_PI) * (double)lamp->color[c];
    }
}

/* Mean of three colors; their own value if they are equal, to the bit. */
static double spsi_color_mean(const double c[3]) { return c[0] + (c[1] - c[0] + (c[2] - c[0])) / 3; }

/* Marches through the gas before a pixel's next face. */
static void spsi_march_gas(const spsi_marcher *marcher, const spsi_ray *ray, spsi_sample *samples,
                           spsi_walker *walker) {
    double range[2];
    spsi_ray step = *ray;
    const int count = spsi_march_range(marcher, ray->origin, ray->direction, walker->low, walker->high, range);
    for (int i = 0; i < count && spsi_color_mean(walker->through) > 1e-12; ++i) {
        const double h = (range[1] - range[0]) / count, t = range[0] + (i + 0.5) * h;
        double source[3], depth, mean;
        spsi_point point;
        point.samples = samples;
        step.low = t - 0.5 * h;
        step.high = t + 0.5 * h;
        spsi_point_build(marcher, &step, &point);
        if (!(point.value_sum > 0)) continue;
        depth = h * point.extinction_sum;
        mean = depth > 1e-9 ? -expm1(-depth) / depth : 1;
        spsi_point_source(marcher, &point, source);
        walker->distance += spsi_color_mean(walker->through) * -expm1(-depth) * t;
        for (int c = 0; c < 3; ++c) {
            walker->radiance[c] += walker->through[c] * source[c] * h * mean;
            walker->through[c] *= exp(-depth);
        }
    }
}

/* Marches a pixel's ray up to its next face and through that. */
static void spsi_march_on(const spsi_marcher *marcher, int x, int y, spsi_sample *samples, spsi_walker *walker) {
    const spsi_face *face;
    double surface[3], before;
    spsi_ray ray;
    spsi_march_ray(&marcher->frame->content->eye, x, y, &ray);
    spsi_march_gas(marcher, &ray, samples, walker);
    walker->ended = walker->hit.face < 0;
    if (walker->ended) return;
    face = &marcher->faces->list[walker->hit.face];
    before = spsi_color_mean(walker->through);
    spsi_march_surface(marcher, &walker->hit, x, y, surface);
    for (int c = 0; c < 3; ++c) {
        walker->radiance[c] += walker->through[c] * surface[c];
        walker->through[c] *= (double)face->transmittance[c];
    }
    walker->distance += (before - spsi_color_mean(walker->through)) * walker->high;
    walker->ended = !(walker->through[0] > 0 || walker->through[1] > 0 || walker->through[2] > 0);
}

#define SPSI_MARCH_SPAN 8 /* pixels of a row per task */

static int spsi_march_spans(int width) { return (width + SPSI_MARCH_SPAN - 1) / SPSI_MARCH_SPAN; }

/* Marches a span of a row. With a whole row per task, workers would wait for the slowest one in each batch. */
static void spsi_march_span_task(void *data, int index, int worker) {
    const spsi_marcher *marcher = (const spsi_marcher *)data;
    const int *region = marcher->frame->view.region, spans = spsi_march_spans(region[2]);
    const int row = marcher->first_row + index / spans;
    const int first = index % spans * SPSI_MARCH_SPAN, last = spsi_least(region[2], first + SPSI_MARCH_SPAN);
    spsi_sample *samples = marcher->samples + (size_t)worker * (size_t)marcher->part_count;
    for (int x = first; x < last; ++x) {
        spsi_walker *walker = &marcher->walkers[(size_t)row * (size_t)region[2] + (size_t)x];
        if (!walker->ended) spsi_march_on(marcher, region[0] + x, region[1] + row, samples, walker);
    }
}

/* Finds the next face of each pixel of a row. */
static void spsi_march_meet_task(void *data, int index, int worker) {
    const spsi_marcher *marcher = (const spsi_marcher *)data;
    const int *region = marcher->frame->view.region, width = marcher->frame->content->eye.width;
    const int y = region[1] + index;
    (void)worker;
    for (int x = region[0]; x < region[0] + region[2]; ++x) {
        spsi_walker *walker = &marcher->walkers[(size_t)index * (size_t)region[2] + (size_t)(x - region[0])];
        if (!walker->ended) spsi_march_meet(marcher, x, y, walker);
        if (!marcher->hits) continue;
        marcher->hits[(size_t)y * (size_t)width + (size_t)x] = walker->hit;
        if (walker->ended) marcher->hits[(size_t)y * (size_t)width + (size_t)x].face = -1;
    }
}

/* Starts every pixel's ray, through the n-th of its samples. */
static void spsi_march_start(const spsi_marcher *marcher, const spsi_rays *centre, int n) {
    const size_t pixels = (size_t)marcher->frame->view.region[2] * (size_t)marcher->frame->view.region[3];
    const int side = marcher->side;
    spsi_rays_shift(centre, (n % side + 0.5) / side - 0.5, (n / side + 0.5) / side - 0.5,
                    &marcher->frame->content->eye);
    for (size_t i = 0; i < pixels; ++i) {
        spsi_walker *walker = &marcher->walkers[i];
        for (int c = 0; c < 3; ++c) walker->radiance[c] = 0, walker->through[c] = 1;
        walker->distance = 0;
        walker->high = walker->depth = -HUGE_VAL;
        walker->hit.face = -1;
        walker->ended = 0;
    }
}

/* Adds what has been marched to the pixels' sums, over the background that the image holds. */
static void spsi_march_add(const spsi_marcher *marcher) {
    const size_t pixels = (size_t)marcher->frame->view.region[2] * (size_t)marcher->frame->view.region[3];
    for (size_t i = 0; i < pixels; ++i) {
        spsi_walker *walker = &marcher->walkers[i];
        const float *behind = marcher->total + i * spsi_total_floats(marcher->frame);
        for (int c = 0; c < 3; ++c) walker->sums[c] += walker->radiance[c] + walker->through[c] * (double)behind[c];
        walker->sums[3] += 1 - spsi_color_mean(walker->through);
        walker->sums[4] += walker->distance;
    }
}

/* Fills in the image's pixels. */
static void spsi_march_finish(const spsi_marcher *marcher) {
    const size_t pixels = (size_t)marcher->frame->view.region[2] * (size_t)marcher->frame->view.region[3];
    const int samples = marcher->side * marcher->side;
    for (size_t i = 0; i < pixels; ++i) {
        const double *sums = marcher->walkers[i].sums;
        float *pixel = marcher->total + i * spsi_total_floats(marcher->frame);
        for (int c = 0; c < 4; ++c) pixel[c] = (float)(sums[c] / samples);
        if (marcher->frame->wants_depth) pixel[4] = sums[3] > 0 ? (float)(sums[4] / sums[3]) : SPSI_INFINITY;
    }
}

/* Marches every ray that has not ended up to its next face, and through that. *left: whether any goes on. */
static sps_result spsi_march_round(sps_context *context, spsi_marcher *marcher, int *left) {
    const spsi_frame *frame = marcher->frame;
    const int *region = frame->view.region;
    const size_t pixels = (size_t)region[2] * (size_t)region[3];
    const int rows = spsi_worker_count(context); /* between two calls of progress_fn: one row can take a second */
    spsi_parallel(context, region[3], spsi_march_meet_task, marcher);
    marcher->visible.hits = marcher->hits;
    if (spsi_textures(context, frame, marcher->faces, &marcher->visible)) return context->result;
    for (marcher->first_row = 0; marcher->first_row < region[3]; marcher->first_row += rows) {
        const double done = marcher->sample + (double)marcher->first_row / region[3];
        if (spsi_progress(context, done / (marcher->side * marcher->side))) return context->result;
        spsi_parallel(context, spsi_least(rows, region[3] - marcher->first_row) * spsi_march_spans(region[2]),
                      spsi_march_span_task, marcher);
    }
    *left = 0;
    for (size_t i = 0; i < pixels; ++i) *left |= !marcher->walkers[i].ended;
    return SPS_OK;
}

/* --- setting up --- */

/* Reads a whole volume, and marks the bricks that hold anything, and their neighbours. */
static sps_result spsi_dense_read(sps_context *context, const spsi_frame *frame, int medium, float *values,
                                  spsi_dense *grid) {
    const spsi_medium *m = &frame->media[medium];
    const int64_t count = spsi_block_count(m);
    spsi_material plain;
    spsi_block block;
    void *memory = spsi_reserve(context, SPSI_BUFFER_BLOCK, 1, SPSI_BLOCK_BYTES);
    if (!memory) return context->result;
    memset(&plain, 0, sizeof plain); /* a gas: blocks without margins */
    spsi_block_buffers(&block, memory);
    for (int64_t i = 0; i < count; ++i) {
        spsi_block_place(&block, m, &plain, i);
        if (spsi_block_read(context, &block, frame->replace_invalid)) return context->result;
        spsi_tick(context);
        for (int z = block.core_low[2]; z < block.core_high[2]; ++z)
            for (int y = block.core_low[1]; y < block.core_high[1]; ++y) {
                const size_t to =
                    ((size_t)z * (size_t)grid->size[1] + (size_t)y) * (size_t)grid->size[0] + (size_t)block.core_low[0];
                memcpy(values + to, block.values + spsi_block_index(&block, block.core_low[0], y, z),
                       (size_t)block.size[0] * sizeof(float));
            }
    }
    for (int z = 0; z < grid->size[2]; spsi_tick(context), ++z)
        for (int y = 0; y < grid->size[1]; ++y)
            for (int x = 0; x < grid->size[0]; ++x) {
                const int b[3] = {x / SPSI_BRICK, y / SPSI_BRICK, z / SPSI_BRICK};
                if (!(values[((size_t)z * (size_t)grid->size[1] + (size_t)y) * (size_t)grid->size[0] + (size_t)x] > 0))
                    continue;
                for (int n = 0; n < 27; ++n) {
                    const int bx = b[0] + n % 3 - 1, by = b[1] + n / 3 % 3 - 1, bz = b[2] + n / 9 - 1;
                    if (bx < 0 || by < 0 || bz < 0 || bx >= grid->bricks[0] || by >= grid->bricks[1] ||
                        bz >= grid->bricks[2])
                        continue;
                    grid->occupied[(bz * grid->bricks[1] + by) * grid->bricks[0] + bx] = 1;
                }
            }
    return SPS_OK;
}

static sps_result spsi_march_grids(sps_context *context, const spsi_frame *frame, spsi_marcher *marcher) {
    uint64_t voxels = 0, bricks = 0;
    float *values;
    for (int i = 0; i < frame->medium_count; ++i) {
        const spsi_lattice *lattice = frame->media[i].lattice;
        spsi_dense *grid = &marcher->grids[i];
        uint64_t b = 1, v = 1;
        for (int k = 0; k < 3; ++k) {
            grid->size[k] = frame->media[i].size[k];
            grid->bricks[k] = (grid->size[k] + SPSI_BRICK - 1) / SPSI_BRICK;
            v *= (uint64_t)grid->size[k];
            b *= (uint64_t)grid->bricks[k];
        }
        memcpy(grid->corner, lattice->corner, sizeof grid->corner);
        spsi_invert(lattice->step[0], lattice->step[1], lattice->step[2], grid->inverse);
        voxels += v;
        bricks += b;
    }
    if (voxels + bricks > SIZE_MAX / 8)
        return spsi_fail_field(context, SPS_ERROR_MEMORY, SPS_OBJECT_SCENE, -1, "volumes' number of voxels",
                               (double)voxels,
                               "sps_reference holds all of them, and they are more than memory can have");
    values = (float *)spsi_reserve(context, SPSI_BUFFER_REFERENCE_VALUES,
                                   (size_t)voxels + (size_t)bricks / sizeof(float) + 1, sizeof(float));
    if (!values) return context->result;
    memset(values + voxels, 0, (size_t)bricks);
    for (int i = 0; i < frame->medium_count; ++i) {
        spsi_dense *grid = &marcher->grids[i];
        grid->occupied = (unsigned char *)(values + voxels) +
                         (i > 0 ? marcher->grids[i - 1].occupied - (unsigned char *)(values + voxels) +
                                      marcher->grids[i - 1].bricks[0] * marcher->grids[i - 1].bricks[1] *
                                          marcher->grids[i - 1].bricks[2]
                                : 0);
        grid->values = i > 0 ? marcher->grids[i - 1].values + (size_t)marcher->grids[i - 1].size[0] *
                                                                  (size_t)marcher->grids[i - 1].size[1] *
                                                                  (size_t)marcher->grids[i - 1].size[2]
                             : values;
        if (spsi_dense_read(context, frame, i, values + (grid->values - values), grid)) return context->result;
    }
    return SPS_OK;
}

/* Builds the tree of all particles. */
static sps_result spsi_march_particles(sps_context *context, const spsi_frame *frame, spsi_tree *tree) {
    const size_t count = (size_t)frame->content->particle_count;
    spsi_tree_item *items;
    if (count == 0) return SPS_OK;
    tree->count = frame->content->particle_count;
    tree->order = (int *)spsi_reserve(context, SPSI_BUFFER_REFERENCE_PARTICLES, count, sizeof(int));
    tree->nodes = (spsi_tree_node *)spsi_reserve(context, SPSI_BUFFER_REFERENCE_PARTICLE_NODES, spsi_tree_nodes(count),
                                                 sizeof(spsi_tree_node));
    items = (spsi_tree_item *)spsi_reserve(context, SPSI_BUFFER_TREE_ITEMS, count, sizeof(spsi_tree_item));
    if (!tree->order || !tree->nodes || !items) return context->result;
    for (int i = 0; i < 3; ++i) tree->centre[i] = (double)frame->content->particles[0].position[i];
    for (int i = 0; i < tree->count; ++i) {
        const sps_particle *particle = &frame->content->particles[i];
        double low[3], high[3];
        for (int k = 0; k < 3; ++k) {
            low[k] = (double)particle->position[k] - (double)particle->radius;
            high[k] = (double)particle->position[k] + (double)particle->radius;
        }
        items[i].number = i;
        spsi_tree_item_add(&items[i], tree->centre, low, high);
    }
    return spsi_tree_build(context, tree, items);
}

static sps_result spsi_march_build(sps_context *context, const spsi_frame *frame, spsi_faces *faces, double step,
                                   spsi_marcher *marcher) {
    const size_t pixels = (size_t)frame->view.region[2] * (size_t)frame->view.region[3];
    double extent = HUGE_VAL;
    marcher->frame = frame;
    marcher->faces = faces;
    for (int i = 0; i < frame->medium_count; ++i)
        for (int k = 0; k < 3; ++k) extent = fmin(extent, spsi_length(frame->media[i].lattice->step[k]));
    if (spsi_march_grids(context, frame, marcher) || spsi_gather_faces(context, frame, faces)) return context->result;
    spsi_tell_replaced(context, 0);
    if (spsi_gather_particles(context, frame) || spsi_gather_images(context, frame)) return context->result;
    if (frame->content->particle_count > 0) extent = fmin(extent, SPSI_PARTICLE_EDGE * frame->content->particle_radius);
    marcher->step = step * extent;
    marcher->part_count = frame->medium_count + frame->particles.set_count;
    spsi_eye_reference(frame);
    marcher->total =
        (float *)spsi_reserve(context, SPSI_BUFFER_TOTAL, pixels, spsi_total_floats(frame) * sizeof(float));
    marcher->samples = (spsi_sample *)spsi_vectors_reserve(context, SPSI_BUFFER_SAMPLES, marcher->part_count,
                                                           sizeof *marcher->samples);
    marcher->walkers = (spsi_walker *)spsi_reserve(context, SPSI_BUFFER_WALKERS, pixels, sizeof *marcher->walkers);
    if (!marcher->total || !marcher->samples || !marcher->walkers) return context->result;
    memset(marcher->walkers, 0, pixels * sizeof *marcher->walkers);
    marcher->side = spsi_most(1, frame->view.coverage_samples);
    if (faces->textures) {
        marcher->hits = (spsi_hit *)spsi_reserve(context, SPSI_BUFFER_EYE_FACES, spsi_ray_count(&frame->content->eye),
                                                 sizeof *marcher->hits);
        if (!marcher->hits) return context->result;
    }
    if (spsi_faces_tree(context, faces)) return context->result;
    return spsi_march_particles(context, frame, &marcher->particles);
}

static sps_result spsi_march_frame(sps_context *context, const spsi_frame *frame, double step, const sps_image *image) {
    const int *region = frame->view.region, floats = (int)spsi_total_floats(frame);
    spsi_rays centre;
    spsi_faces faces;
    spsi_marcher *marcher = (spsi_marcher *)spsi_reserve(context, SPSI_BUFFER_MARCHER, 1, sizeof(spsi_marcher));
    float *rgb = (float *)spsi_reserve(context, SPSI_BUFFER_ROW, (size_t)region[2], SPSI_ROW_FLOATS * sizeof(float));
    if (!marcher || !rgb) return context->result;
    memset(marcher, 0, sizeof *marcher);
    if (spsi_march_build(context, frame, &faces, step, marcher)) return context->result;
    for (int y = 0; y < region[3]; ++y) {
        if (spsi_background_row(context, frame, y, rgb)) return context->result;
        for (int x = 0; x < region[2]; ++x)
            memcpy(marcher->total + ((size_t)y * (size_t)region[2] + (size_t)x) * (size_t)floats, rgb + 3 * x,
                   3 * sizeof(float));
    }
    centre = frame->content->eye;
    for (; marcher->sample < marcher->side * marcher->side; ++marcher->sample) {
        int left = 1;
        spsi_march_start(marcher, &centre, marcher->sample);
        while (left)
            if (spsi_march_round(context, marcher, &left)) return context->result;
        spsi_march_add(marcher);
    }
    if (spsi_progress(context, 1)) return context->result;
    spsi_march_finish(marcher);
    spsi_write_image(frame, marcher->total, image);
    return SPS_OK;
}

/* =============================================================================================== >>public
   31 The public functions, which check their arguments and leave the work to the sections above, and the ready-made
   callbacks for grids and meshes. */

#ifdef __GNUC__ /* if SPS_API is static: no warnings about functions that a program does not call */
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#endif

SPS_API int sps_version(void) { return SPS_VERSION; }

#define SPSI_NO_CONTEXT "context " SPSI_IS_NULL

static void spsi_refuse_config(sps_error_info *why, sps_result result, const char *field, double value,
                               const char *rule) {
    char rest[SPSI_SENTENCE_SIZE];
    why->result = result;
    value = spsi_say_value(value, rule, rest);
    spsi_describe(why, SPS_OBJECT_CONFIG, -1, field, value, rest);
}

/* Describes the first error in a config. Leaves `why` as it is if there is none. */
static void spsi_check_config(const sps_config *config, sps_error_info *why) {
    const uint32_t start = config->start_canary, end = config->end_canary;
    if (start || end) {
        spsi_refuse_config(why, SPS_ERROR_ARGUMENT, start ? "start_canary" : "end_canary",
                           (double)(start ? start : end), SPSI_NOT_ZEROED);
    } else if (!config->alloc_fn != !config->free_fn) {
        why->result = SPS_ERROR_ARGUMENT;
        spsi_describe(why, SPS_OBJECT_CONFIG, -1, config->alloc_fn ? "free_fn" : "alloc_fn", 0,
                      "is NULL; alloc_fn and free_fn must both be set, or neither");
    } else if (config->worker_count < 0 || config->worker_count > SPSI_WORKERS_MAX) {
        spsi_refuse_config(why, SPS_ERROR_ARGUMENT, "worker_count", config->worker_count, "it must be 0..1024");
    } else if (config->memory_limit && config->memory_limit < sizeof(sps_context)) {
        spsi_refuse_config(why, SPS_ERROR_MEMORY, "memory_limit", (double)config->memory_limit,
                           "a context alone takes more");
    }
}

/* Begins a call that records errors: clears result and error, and restarts the statistics except for the bytes held. */
static void spsi_begin(sps_context *context) {
    sps_stats_report fresh;
    memset(&fresh, 0, sizeof fresh);
    fresh.bytes = context->stats.bytes;
    fresh.bytes_peak = context->stats.bytes_peak;
    context->stats = fresh;
    context->result = SPS_OK;
    spsi_clear_error(&context->error);
    context->progress = 0;
    context->cancelled = 0;
    context->clock_start = spsi_clock(context);
}

/* Ends a call whose time is recorded. Returns its result. */
static sps_result spsi_end(sps_context *context) {
    context->stats.seconds_total = spsi_clock(context) - context->clock_start;
    return context->result;
}

SPS_API sps_context *sps_create(const sps_config *config, sps_error_info *why) {
    sps_error_info error;
    sps_context *context = NULL;
    spsi_clear_error(&error);
    if (config) spsi_check_config(config, &error);
    if (error.result == SPS_OK) {
        context = (sps_context *)(config && config->alloc_fn ? config->alloc_fn(config->alloc_user, sizeof *context)
                                                             : SPS_MALLOC(sizeof *context));
        if (!context) {
            error.result = SPS_ERROR_MEMORY;
            SPS_SNPRINTF(error.sentence, sizeof error.sentence,
                         "memory: the %.0f bytes of a context were refused by the allocator", (double)sizeof *context);
        }
    }
    if (why) *why = error;
    if (!context) return NULL;
    memset(context, 0, sizeof *context);
    if (config) context->config = *config;
    context->stats.bytes = context->stats.bytes_peak = sizeof *context;
    context->error = error; /* none */
    return context;
}

SPS_API void sps_destroy(sps_context *context) {
    if (!context) return;
    SPS_ASSERT(context->tmap_count == 0); /* maps must be destroyed before their context */
    spsi_shadow_tables_drop(context);
    for (int i = 0; i < context->segment_count; ++i)
        spsi_release(context, spsi_segment_at(context, i), sizeof(spsi_segment));
    for (int i = 0; i < SPSI_BUFFER_COUNT; ++i)
        spsi_release(context, context->buffers[i].data, context->buffers[i].size);
    spsi_release(context, context, sizeof *context);
}

SPS_API const char *sps_error(const sps_context *context) {
    return context ? context->error.sentence : SPSI_NO_CONTEXT;
}

SPS_API void sps_get_error(const sps_context *context, sps_error_info *info) {
    if (!info) return;
    spsi_clear_error(info);
    if (context) *info = context->error;
    if (context) return;
    info->result = SPS_ERROR_ARGUMENT;
    spsi_describe(info, SPS_OBJECT_CALL, -1, "context", 0, SPSI_IS_NULL);
}

static sps_result spsi_require(sps_context *context, const void *argument, const char *name) {
    return argument ? SPS_OK : spsi_fail_that(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_CALL, -1, name, 0, SPSI_IS_NULL);
}

/* Whether row_pixels leaves room for a row, and the size of such an image in bytes does not overflow. */
static int spsi_rows_fit(const spsi_frame *frame, size_t row_pixels) {
    const size_t width = (size_t)frame->view.region[2], height = (size_t)frame->view.region[3];
    if (row_pixels == 0) return 1;
    return row_pixels >= width && row_pixels <= (size_t)PTRDIFF_MAX / (4 * sizeof(float)) / height;
}

/* Begins sps_render and sps_reference: checks their arguments, and returns the frame. NULL after a failure. */
static spsi_frame *spsi_begin_frame(sps_context *context, const sps_scene *scene, const sps_view *view,
                                    const sps_image *image) {
    spsi_frame *frame;
    if (!context) return NULL;
    spsi_begin(context);
    if (spsi_require(context, scene, "scene") || spsi_require(context, view, "view") ||
        spsi_require(context, image, "image"))
        return NULL;
    if (!image->rgba) {
        spsi_fail_that(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_IMAGE, -1, "rgba", 0, SPSI_IS_NULL);
        return NULL;
    }
    frame = spsi_frame_build(context, scene, view, image->depth != NULL);
    if (!frame) return NULL;
    if (!spsi_rows_fit(frame, image->row_pixels)) {
        spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_IMAGE, -1, "row_pixels", (double)image->row_pixels,
                        "it must be 0, or at least the region's width, and the image must fit into memory");
        return NULL;
    }
    return frame;
}

SPS_API sps_result sps_render(sps_context *context, const sps_scene *scene, const sps_view *view,
                              const sps_image *image) {
    spsi_frame *frame = spsi_begin_frame(context, scene, view, image);
    if (!context) return SPS_ERROR_ARGUMENT;
    if (frame) spsi_render_frame(context, frame, image);
    return spsi_end(context);
}

SPS_API void sps_get_stats(const sps_context *context, sps_stats_report *report) {
    if (!report) return;
    memset(report, 0, sizeof *report);
    if (context) *report = context->stats;
}

SPS_API sps_result sps_plan(sps_context *context, const sps_scene *scene, const sps_view *view,
                            sps_plan_report *report) {
    spsi_frame *frame;
    if (report) memset(report, 0, sizeof *report);
    if (!context) return SPS_ERROR_ARGUMENT;
    spsi_begin(context);
    if (spsi_require(context, scene, "scene") || spsi_require(context, view, "view") ||
        spsi_require(context, report, "report"))
        return context->result;
    frame = spsi_frame_build(context, scene, view, 1);
    if (frame && spsi_plan_frame(context, frame, report)) memset(report, 0, sizeof *report);
    return context->result;
}

SPS_API const char *sps_pass_name(sps_pass pass) {
    return (int)pass >= 0 && pass < SPS_PASS_COUNT ? spsi_pass_names[pass] : "unknown";
}

SPS_API sps_result sps_reference(sps_context *context, const sps_scene *scene, const sps_view *view, double step,
                                 const sps_image *image) {
    spsi_frame *frame = spsi_begin_frame(context, scene, view, image);
    if (!context) return SPS_ERROR_ARGUMENT;
    if (frame && !(step > 0 && step <= DBL_MAX))
        spsi_fail_field(context, SPS_ERROR_ARGUMENT, SPS_OBJECT_CALL, -1, "step", step, "it must be above 0");
    else if (frame)
        spsi_march_frame(context, frame, step, image);
    return spsi_end(context);
}

/* Converts a half to a float, which can hold every half exactly. */
static float spsi_half(uint16_t half) {
    const uint32_t exponent = half >> 10 & 31, fraction = half & 1023;
    const float small = (float)fraction * (1 / 16777216.0f); /* if subnormal: in units of 2^-24 */
    uint32_t bits = (exponent == 31 ? 255 : exponent + 112) << 23 | fraction << 13;
    float value;
    if (exponent == 0) memcpy(&bits, &small, sizeof bits);
    bits |= (uint32_t)(half >> 15) << 31;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* Converts a row of voxels that lie `step` bytes apart to values. */
static void spsi_voxel_row(const sps_grid *grid, const char *from, ptrdiff_t step, int count, float *out) {
    const float scale = fabsf(grid->scale) > 0 ? grid->scale : 1;
    for (int i = 0; i < count; ++i, from += step) {
        uint16_t word;
        if (grid->format == SPS_VOXEL_U8) out[i] = (float)*(const unsigned char *)from;
        if (grid->format == SPS_VOXEL_F32) memcpy(&out[i], from, sizeof out[i]);
        if (grid->format == SPS_VOXEL_U8 || grid->format == SPS_VOXEL_F32) continue;
        memcpy(&word, from, sizeof word);
        out[i] = grid->format == SPS_VOXEL_F16 ? spsi_half(word) : (float)word;
    }
    for (int i = 0; i < count; ++i) out[i] = out[i] * scale + grid->offset;
}

/* Checks a grid and a block of it. Returns what sps_grid_read and sps_grid_range return for them. */
static int spsi_grid_check(const sps_grid *grid, const int lo[3], const int size[3]) {
    if (!grid || !grid->voxels || grid->start_canary || grid->end_canary) return 1;
    if ((int)grid->format < SPS_VOXEL_U8 || grid->format > SPS_VOXEL_F32) return 1;
    if (!(fabsf(grid->scale) <= FLT_MAX) || !(fabsf(grid->offset) <= FLT_MAX)) return 1;
    for (int i = 0; i < 3; ++i)
        if (grid->size[i] < 1) return 1;
    for (int i = 0; i < 3; ++i)
        if (lo[i] < 0 || size[i] > grid->size[i] || lo[i] > grid->size[i] - size[i]) return 2;
    return 0;
}

/* Bytes between neighbours along x, y, z. */
static void spsi_grid_strides(const sps_grid *grid, ptrdiff_t stride[3]) {
    static const ptrdiff_t bytes[] = {0, 1, 2, 2, 4};
    for (int i = 0; i < 3; ++i) {
        ptrdiff_t packed = i == 0 ? bytes[grid->format] : stride[i - 1] * grid->size[i - 1];
        if (packed < 0) packed = -packed; /* rows that run upwards are still in layers that follow each other */
        stride[i] = grid->stride[i] ? grid->stride[i] : packed;
    }
}

SPS_API int sps_grid_read(void *grid, const int lo[3], const int size[3], float *out) {
    const sps_grid *from = (const sps_grid *)grid;
    const int wrong = spsi_grid_check(from, lo, size);
    ptrdiff_t stride[3];
    if (wrong) return wrong;
    spsi_grid_strides(from, stride);
    for (int z = lo[2]; z < lo[2] + size[2]; ++z)
        for (int y = lo[1]; y < lo[1] + size[1]; ++y, out += size[0])
            spsi_voxel_row(from, (const char *)from->voxels + z * stride[2] + y * stride[1] + lo[0] * stride[0],
                           stride[0], size[0], out);
    return 0;
}

SPS_API int sps_grid_range(void *grid, const int lo[3], const int size[3], float out_min_max[2]) {
    float row[SPSI_BLOCK];
    int valid = 1;
    out_min_max[0] = SPSI_VALUE_MAX, out_min_max[1] = 0;
    for (int z = 0; z < size[2]; ++z)
        for (int y = 0; y < size[1]; ++y)
            for (int x = 0; x < size[0]; x += SPSI_BLOCK) {
                const int at[3] = {lo[0] + x, lo[1] + y, lo[2] + z},
                          part[3] = {spsi_least(SPSI_BLOCK, size[0] - x), 1, 1};
                const int wrong = sps_grid_read(grid, at, part, row);
                if (wrong) return wrong;
                for (int i = 0; i < part[0]; ++i) {
                    valid &= row[i] >= 0 && row[i] <= SPSI_VALUE_MAX;
                    out_min_max[0] = spsi_lower(row[i], out_min_max[0]);
                    out_min_max[1] = spsi_higher(row[i], out_min_max[1]);
                }
            }
    if (!valid) out_min_max[0] = 0, out_min_max[1] = SPSI_VALUE_MAX;
    return 0;
}

/* The vertex of the i-th corner, counted through all triangles. */
static size_t spsi_mesh_index(const sps_indexed_mesh *mesh, size_t i) {
    uint16_t narrow;
    uint32_t wide;
    if (mesh->indices_u16) {
        memcpy(&narrow, (const char *)mesh->indices_u16 + i * sizeof narrow, sizeof narrow);
        return narrow;
    }
    if (!mesh->indices_u32) return i;
    memcpy(&wide, (const char *)mesh->indices_u32 + i * sizeof wide, sizeof wide);
    return wide;
}

/* Copies the floats of a vertex, if there is a list. */
static void spsi_mesh_vector(const float *list, size_t stride, size_t vertex, size_t floats, float *out) {
    if (list) memcpy(out, (const char *)list + vertex * (stride ? stride : floats * sizeof *out), floats * sizeof *out);
}

SPS_API int sps_indexed_mesh_read(void *indexed, size_t first, size_t count, sps_triangle *out) {
    const sps_indexed_mesh *mesh = (const sps_indexed_mesh *)indexed;
    if (!mesh || !mesh->positions || mesh->start_canary || mesh->end_canary || mesh->vertex_count == 0) return 1;
    if (mesh->indices_u16 && mesh->indices_u32) return 1;
    if (count > mesh->triangle_count || first > mesh->triangle_count - count) return 2;
    for (size_t i = 0; i < 3 * count; ++i) {
        const size_t vertex = spsi_mesh_index(mesh, 3 * first + i);
        sps_triangle *triangle = &out[i / 3];
        if (vertex >= mesh->vertex_count) return 3;
        spsi_mesh_vector(mesh->positions, mesh->position_stride, vertex, 3, triangle->position[i % 3]);
        spsi_mesh_vector(mesh->normals, mesh->normal_stride, vertex, 3, triangle->normal[i % 3]);
        spsi_mesh_vector(mesh->colors, mesh->color_stride, vertex, 3, triangle->color[i % 3]);
        spsi_mesh_vector(mesh->uvs, mesh->uv_stride, vertex, 2, triangle->uv[i % 3]);
    }
    return 0;
}

SPS_API void sps_tmap_destroy(sps_tmap *map) {
    if (!map) return;
    spsi_tmap_forget(map);
    spsi_tmap_release(map);
    map->context->tmap_count -= 1;
    spsi_release(map->context, map, sizeof *map);
}

SPS_API sps_result sps_tmap_create(sps_context *context, const sps_tmap_light *light, const sps_tmap_settings *settings,
                                   sps_tmap **map) {
    if (map) *map = NULL;
    if (!context) return SPS_ERROR_ARGUMENT;
    spsi_begin(context);
    if (spsi_require(context, light, "light") || spsi_require(context, settings, "settings") ||
        spsi_require(context, map, "map"))
        return context->result;
    if (spsi_tmap_check(context, light, settings)) return context->result;
    *map = (sps_tmap *)spsi_acquire(context, 1, sizeof **map);
    if (!*map) return context->result;
    memset(*map, 0, sizeof **map);
    (*map)->context = context;
    context->tmap_count += 1;
    if (spsi_tmap_build(*map, light, settings)) {
        sps_tmap_destroy(*map);
        *map = NULL;
    }
    return context->result;
}

/* Maps accept occluders until they are finished, or have failed to finish. */
static sps_result spsi_require_unfinished(const sps_tmap *map) {
    const char *rest = map->failed ? "has failed to finish; destroy it" : "is finished already";
    if (!map->failed && !map->finished) return SPS_OK;
    return spsi_fail_that(map->context, SPS_ERROR_ARGUMENT, SPS_OBJECT_TMAP, -1, "", 0, rest);
}

SPS_API sps_result sps_tmap_add(sps_tmap *map, const sps_scene *scene) {
    if (!map) return SPS_ERROR_ARGUMENT;
    spsi_begin(map->context);
    if (spsi_require(map->context, scene, "scene") || spsi_require_unfinished(map)) return map->context->result;
    return spsi_tmap_add(map, scene);
}

SPS_API sps_result sps_tmap_finish(sps_tmap *map) {
    if (!map) return SPS_ERROR_ARGUMENT;
    spsi_begin(map->context);
    if (spsi_require_unfinished(map)) return spsi_end(map->context);
    map->failed = spsi_tmap_finish(map) != SPS_OK;
    spsi_tmap_forget(map);
    return spsi_end(map->context);
}

/* Queries a map at up to SPSI_LANES positions. */
static void spsi_tmap_answer(const sps_tmap *map, int count, const double *positions, float *optical_depths,
                             float *transmittances) {
    float depths[SPSI_LANES] = {0};
    double lit[SPSI_LANES];
    for (int i = 0; i < count; ++i) lit[i] = 1;
    spsi_tmap_at(map, count, positions, depths, lit);
    for (int i = 0; i < count; ++i) {
        const double depth = (double)depths[i];
        if (transmittances) transmittances[i] = (float)(depth < 86 ? lit[i] * exp(-depth) : 0);
        if (optical_depths) optical_depths[i] = (float)spsi_optical_depth_with_surfaces(depth, lit[i]);
    }
}

static int spsi_tmap_queryable(const sps_tmap *map, size_t count, const void *positions) {
    return map && map->finished && (positions || count == 0);
}

SPS_API sps_result sps_tmap_query(const sps_tmap *map, size_t count, const double *positions, float *optical_depths,
                                  float *transmittances) {
    if (!spsi_tmap_queryable(map, count, positions)) return SPS_ERROR_ARGUMENT;
    for (size_t first = 0; first < count; first += SPSI_LANES) {
        const int some = count - first < SPSI_LANES ? (int)(count - first) : SPSI_LANES;
        spsi_tmap_answer(map, some, positions + 3 * first, optical_depths ? optical_depths + first : NULL,
                         transmittances ? transmittances + first : NULL);
    }
    return SPS_OK;
}

SPS_API sps_result sps_tmap_query_floats(const sps_tmap *map, size_t count, const float *positions, size_t stride,
                                         float *optical_depths, float *transmittances) {
    const char *next = (const char *)positions;
    if (!spsi_tmap_queryable(map, count, positions)) return SPS_ERROR_ARGUMENT;
    for (size_t first = 0; first < count; first += SPSI_LANES) {
        const int some = count - first < SPSI_LANES ? (int)(count - first) : SPSI_LANES;
        double wide[3 * SPSI_LANES];
        for (int i = 0; i < some; ++i, next += stride ? stride : 3 * sizeof(float)) {
            float position[3];
            memcpy(position, next, sizeof position);
            for (int k = 0; k < 3; ++k) wide[3 * i + k] = (double)position[k];
        }
        spsi_tmap_answer(map, some, wide, optical_depths ? optical_depths + first : NULL,
                         transmittances ? transmittances + first : NULL);
    }
    return SPS_OK;
}

SPS_API sps_result sps_tmap_bracket(const sps_tmap *map, size_t count, const double *positions, float *least,
                                    float *most) {
    if (!spsi_tmap_queryable(map, count, positions)) return SPS_ERROR_ARGUMENT;
    for (size_t i = 0; i < count; ++i) {
        double bracket[2] = {0, 0};
        spsi_tmap_bracket_at(map, positions + 3 * i, bracket);
        if (least) least[i] = (float)bracket[0];
        if (most) most[i] = (float)bracket[1];
    }
    return SPS_OK;
}

SPS_API const float *sps_tmap_texels(const sps_tmap *map) {
    return map && map->finished ? (const float *)map->data.texels.data : NULL;
}

SPS_API const uint32_t *sps_tmap_starts(const sps_tmap *map) {
    return map && map->finished ? (const uint32_t *)map->data.starts.data : NULL;
}

SPS_API const float *sps_tmap_surfaces(const sps_tmap *map) {
    return map && map->finished ? (const float *)map->data.surfaces.data : NULL;
}

static int spsi_tmap_has_face(const sps_tmap *map, int face) {
    return map && map->finished && face >= 0 && face < map->face_count;
}

SPS_API sps_result sps_tmap_get_projection(const sps_tmap *map, int face, double matrix[16], double bias[2]) {
    if (!spsi_tmap_has_face(map, face)) return SPS_ERROR_ARGUMENT;
    if (matrix) spsi_rays_matrix(&map->rays[face], matrix);
    if (bias) memcpy(bias, map->bias, sizeof map->bias);
    return SPS_OK;
}

/* Copies the rows of a matrix, (X, Y, distance, W), to a shader's constants. */
static void spsi_fill_rows(const double matrix[16], sps_tmap_constants *constants) {
    for (int i = 0; i < 4; ++i) {
        constants->row_x[i] = (float)matrix[i];
        constants->row_y[i] = (float)matrix[4 + i];
        constants->row_distance[i] = (float)matrix[8 + i];
        constants->row_w[i] = (float)matrix[12 + i];
    }
}

SPS_API sps_result sps_tmap_get_constants(const sps_tmap *map, int face, sps_tmap_constants *constants) {
    const sps_tmap_settings *settings;
    double matrix[16], bias[2];
    if (!constants || sps_tmap_get_projection(map, face, matrix, bias) != SPS_OK) return SPS_ERROR_ARGUMENT;
    settings = &map->settings;
    memset(constants, 0, sizeof *constants);
    spsi_fill_rows(matrix, constants);
    constants->technique = (int32_t)settings->technique;
    constants->components = settings->components;
    constants->has_range = map->has_range;
    constants->has_planes = settings->planes != NULL;
    constants->cubic = settings->cubic != 0;
    constants->running_maximum = settings->running_maximum != 0;
    constants->has_surfaces = map->data.surfaces.data != NULL;
    constants->width = map->rays[face].width;
    constants->height = map->rays[face].height;
    constants->near_depth = (float)settings->near_depth;
    constants->far_depth = (float)settings->far_depth;
    constants->bias = (float)bias[0];
    constants->bias_per_distance = (float)bias[1];
    constants->face = face;
    constants->face_count = map->face_count;
    return SPS_OK;
}

SPS_API sps_result sps_tmap_get_info(const sps_tmap *map, sps_tmap_info *info) {
    if (!map || !info) return SPS_ERROR_ARGUMENT;
    memset(info, 0, sizeof *info);
    info->width = map->rays[0].width;
    info->height = map->rays[0].height;
    info->face_count = map->face_count;
    info->is_finished = map->finished;
    info->item_floats =
        map->technique->lists ? (int)(spsi_tmap_item_bytes(map) / sizeof(float)) : map->settings.components;
    info->texel_count = spsi_tmap_texel_count(map);
    info->float_count = info->texel_count * (size_t)info->item_floats;
    if (map->technique->lists)
        info->float_count = map->finished ? spsi_tmap_item_count(map) * (size_t)info->item_floats : 0;
    info->bytes = spsi_tmap_bytes(map);
    info->settings = map->settings;
    return SPS_OK;
}

#ifdef __GNUC__
#pragma GCC diagnostic pop
#endif

#endif /* SPSI_IMPLEMENTED */
#endif /* SPLATSHADOW_IMPLEMENTATION */

/* ============================================================================================== >>licence

Choose either of these two licences.

------------------------------------------------------------------------------- A: MIT License

Copyright (c) 2026 the splatshadow authors

Permission is hereby granted, free of charge, to any person obtaining a copy of this software and associated
documentation files (the "Software"), to deal in the Software without restriction, including without limitation the
rights to use, copy, modify, merge, publish, distribute, sublicense, and/or sell copies of the Software, and to permit
persons to whom the Software is furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in all copies or substantial portions of the
Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT NOT LIMITED TO THE
WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR
COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR
OTHERWISE, ARISING FROM, OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.

------------------------------------------------------------------------------- B: Unlicense

This is free and unencumbered software released into the public domain.

Anyone is free to copy, modify, publish, use, compile, sell, or distribute this software, either in source code form or
as a compiled binary, for any purpose, commercial or non-commercial, and by any means.

In jurisdictions that recognize copyright laws, the author or authors of this software dedicate any and all copyright
interest in the software to the public domain. We make this dedication for the benefit of the public at large and to
the detriment of our heirs and successors. We intend this dedication to be an overt act of relinquishment in perpetuity
of all present and future rights to this software under copyright law.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT NOT LIMITED TO THE
WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS BE
LIABLE FOR ANY CLAIM, DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM, OUT
OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.

For more information, please refer to <https://unlicense.org>
*/
