/* effects_scenes.h: for each effect a scene that needs it and the same scene without, and effects that are set although
   nothing needs them. effects.c measures them, tests/test_effects.c checks them at a small size. */

#ifndef EX_EFFECTS_SCENES_H
#define EX_EFFECTS_SCENES_H

#include "densities.h"
#include "particles.h"

/* ================================================================================================= the stage */

/* A cloud in the box -1..1 under a warm sun, and what may be added to it. Stays where it is: the scene points into it.
   Light scatters once, and lights shade by sheets. */
typedef struct ex_stage {
    sps_volume clouds[2];
    int voxels; /* along a length of 2 */
    sps_mesh meshes[2];
    sps_indexed_mesh nets[2];
    sps_light lights[2];
    sps_particles swarm;
    sps_lobe lobe;
    sps_transfer transfer;
    sps_projector slide;
    sps_tmap_settings map;
    sps_scene scene;
    sps_view view;
    int wants_depth; /* the image's */
    int frames;      /* the last of which is looked at; 0: one */
} ex_stage;

/* What is done to a stage; NULL does nothing. */
typedef void (*ex_change)(ex_stage *stage);

static inline double ex_cloud(const double p[3]) {
    const double r = sqrt(ex_dot(p, p));
    if (r >= 1) return 0;
    return ex_clamp(2.5 * (0.8 + 0.19 * sin(7 * p[0] + 1) * cos(6 * p[1]) * sin(8 * p[2]) - r), 0, 1);
}

/* sps_volume.read_fn; `user` is the number of voxels along a length of 2. */
static inline int ex_cloud_read(void *user, const int lo[3], const int size[3], float *out) {
    const double voxel = 2.0 / *(const int *)user;
    for (int k = lo[2]; k < lo[2] + size[2]; ++k)
        for (int j = lo[1]; j < lo[1] + size[1]; ++j)
            for (int i = lo[0]; i < lo[0] + size[0]; ++i) {
                const double p[3] = {(i + 0.5) * voxel - 1, (j + 0.5) * voxel - 1, (k + 0.5) * voxel - 1};
                *out++ = (float)ex_cloud(p);
            }
    return 0;
}

/* sps_volume.range_fn of the same. */
static inline int ex_cloud_range(void *user, const int lo[3], const int size[3], float out[2]) {
    const double voxel = 2.0 / *(const int *)user;
    double square = 0;
    for (int k = 0; k < 3; ++k) {
        const double from = lo[k] * voxel - 1, to = (lo[k] + size[k]) * voxel - 1;
        const double nearest = ex_clamp(0, from, to);
        square += nearest * nearest;
    }
    out[0] = 0, out[1] = square < 1 ? 1 : 0;
    return 0;
}

/* Voxels of value 0. */
static inline int ex_nothing_read(void *user, const int lo[3], const int size[3], float *out) {
    (void)user, (void)lo, (void)size, (void)out;
    return 0;
}

/* Noise from voxel to voxel. */
static inline int ex_noise_read(void *user, const int lo[3], const int size[3], float *out) {
    uint32_t state;
    (void)user;
    for (int k = lo[2]; k < lo[2] + size[2]; ++k)
        for (int j = lo[1]; j < lo[1] + size[1]; ++j)
            for (int i = lo[0]; i < lo[0] + size[0]; ++i) {
                state = (uint32_t)(i + 71 * j + 5003 * k);
                *out++ = (float)ex_random(&state);
            }
    return 0;
}

static inline void ex_stage_begin(ex_stage *s, int voxels, int width) {
    sps_volume *cloud = s->clouds;
    memset(s, 0, sizeof *s);
    s->voxels = voxels;
    for (int k = 0; k < 3; ++k)
        cloud->size[k] = voxels, cloud->placement.origin[k] = -1, cloud->placement.axis[k][k] = 2;
    cloud->read_fn = ex_cloud_read, cloud->user = &s->voxels;
    cloud->extinction = 3;
    ex_color(cloud->albedo, 0.7, 0.8, 0.9);
    s->scene.volumes = s->clouds, s->scene.volume_count = 1;
    s->lights[0].direction[0] = 0.5, s->lights[0].direction[1] = -1, s->lights[0].direction[2] = -0.4;
    s->lights[0].shadow_source = SPS_SHADOW_SHEETS;
    ex_color(s->lights[0].color, 3, 2.8, 2.4);
    s->scene.lights = s->lights, s->scene.light_count = 1;
    s->scene.meshes = s->meshes, s->scene.particles = &s->swarm;
    ex_color(s->scene.background, 0.1, 0.15, 0.2);
    s->view.width = width, s->view.height = width * 3 / 4;
    s->view.camera.position[0] = 1, s->view.camera.position[1] = 1.5, s->view.camera.position[2] = 5;
    s->view.camera.target[1] = -0.1;
    s->view.camera.up[1] = 1, s->view.camera.field_of_view = 0.6;
    s->view.scattering = SPS_SCATTERING_SINGLE;
}

/* A stage of that size with these changes, in their order. */
static inline void ex_stage_set(ex_stage *s, int voxels, int width, ex_change common, ex_change change) {
    ex_stage_begin(s, voxels, width);
    if (common) common(s);
    if (change) change(s);
}

/* ============================================================================================ what is added */

static inline void ex_add_net(ex_stage *s, const float *positions, size_t vertices, const uint16_t *indices,
                              size_t triangles) {
    const int n = s->scene.mesh_count++;
    s->nets[n].positions = positions, s->nets[n].vertex_count = vertices;
    s->nets[n].indices_u16 = indices, s->nets[n].triangle_count = triangles;
    s->meshes[n].read_fn = sps_indexed_mesh_read, s->meshes[n].user = &s->nets[n];
    s->meshes[n].triangle_count = triangles;
    ex_color(s->meshes[n].albedo, 0.5, 0.4, 0.3);
}

static inline void ex_add_floor(ex_stage *s) {
    static const float corners[12] = {-5, -1.1f, -5, 5, -1.1f, -5, 5, -1.1f, 5, -5, -1.1f, 5};
    static const uint16_t indices[6] = {0, 1, 2, 0, 2, 3};
    ex_add_net(s, corners, 4, indices, 2);
}

/* An upright triangle in the cloud, which casts a shadow on it and on the floor. */
static inline void ex_add_sail(ex_stage *s) {
    static const float corners[9] = {-0.6f, 0.9f, 0.3f, 0.5f, 0.8f, -0.2f, -0.1f, -0.5f, 0.1f};
    static const uint16_t indices[3] = {0, 1, 2};
    ex_add_net(s, corners, 3, indices, 1);
}

static inline void ex_add_polygons(ex_stage *s) {
    ex_add_floor(s);
    ex_add_sail(s);
}

/* The sail lets light pass. */
static inline void ex_make_pane(ex_stage *s) { ex_color(s->meshes[1].transmittance, 0.2, 0.5, 0.4); }

static inline void ex_add_swarm_of(ex_stage *s, double optical_depth) {
    enum { COUNT = 60 };
    static sps_particle list[COUNT];
    for (int i = 0; i < COUNT; ++i) {
        for (int k = 0; k < 3; ++k) list[i].position[k] = (float)fmod(0.37 * (i + 1) * (k + 1) * 1.618, 1.4) - 0.7f;
        list[i].radius = 0.2f, list[i].optical_depth = (float)optical_depth;
    }
    s->swarm.count = COUNT, s->swarm.read_fn = ex_particles_read, s->swarm.user = list;
    ex_color(s->swarm.albedo, 0.7, 0.8, 0.9);
    s->scene.particle_set_count = 1;
}

static inline void ex_add_swarm(ex_stage *s) { ex_add_swarm_of(s, 0.5); }

/* A second light from the other side. */
static inline void ex_add_light(ex_stage *s) {
    s->lights[1] = s->lights[0];
    s->lights[1].direction[0] = -0.6, s->lights[1].direction[2] = -0.6;
    s->scene.light_count = 2;
}

static inline int ex_stripes(void *user, size_t count, const float *uv, float *out_rgb) {
    (void)user;
    for (size_t i = 0; i < count; ++i) {
        const double wave = 0.5 + 0.5 * sin(40 * (double)uv[2 * i]);
        ex_color(out_rgb + 3 * i, wave, 1, wave);
    }
    return 0;
}

static inline int ex_white(void *user, size_t count, const float *uv, float *out_rgb) {
    (void)user, (void)uv;
    for (size_t i = 0; i < 3 * count; ++i) out_rgb[i] = 1;
    return 0;
}

/* Wide enough for all that is seen. */
static inline void ex_throw(ex_stage *s, int (*sample_fn)(void *, size_t, const float *, float *)) {
    s->slide.width = s->slide.height = 64, s->slide.sample_fn = sample_fn;
    s->slide.left = s->slide.bottom = -20, s->slide.right = s->slide.top = 20;
    s->lights[0].projector = &s->slide;
}

static inline void ex_throw_stripes(ex_stage *s) { ex_throw(s, ex_stripes); }
static inline void ex_throw_white(ex_stage *s) { ex_throw(s, ex_white); }

/* A point light in place of the sun. */
static inline void ex_make_lamp(ex_stage *s) {
    s->lights[0].kind = SPS_LIGHT_POINT;
    s->lights[0].position[0] = -2, s->lights[0].position[1] = 4, s->lights[0].position[2] = 1.6;
    s->lights[0].falloff = SPS_FALLOFF_NONE;
}

static inline void ex_make_disc(ex_stage *s, double radius) {
    ex_make_lamp(s);
    s->lights[0].kind = SPS_LIGHT_DISC;
    s->lights[0].axes[0][0] = radius, s->lights[0].axes[1][2] = radius;
}

static inline void ex_make_large_disc(ex_stage *s) { ex_make_disc(s, 0.6); }
static inline void ex_make_point_disc(ex_stage *s) { ex_make_disc(s, 0); }
static inline void ex_make_small_disc(ex_stage *s) { ex_make_disc(s, 1e-9); }

static inline void ex_make_spot(ex_stage *s) { s->lights[0].inner_cone = 0.1, s->lights[0].outer_cone = 0.3; }
static inline void ex_make_wide_spot(ex_stage *s) { s->lights[0].inner_cone = 3, s->lights[0].outer_cone = 3.1; }

static inline void ex_make_soft(ex_stage *s) { s->lights[0].angular_diameter = 0.15; }
static inline void ex_make_hardly_soft(ex_stage *s) { s->lights[0].angular_diameter = 1e-9; }

static inline void ex_no_shadow(ex_stage *s) { s->lights[0].no_shadow = 1; }
static inline void ex_no_shadows(ex_stage *s) { s->view.no_shadows = 1; }
static inline void ex_add_shadowless(ex_stage *s) {
    ex_add_light(s);
    s->lights[1].no_shadow = 1;
}
static inline void ex_light_up(ex_stage *s) { s->scene.light_count = 1; }
static inline void ex_no_light(ex_stage *s) { s->scene.light_count = 0; }

static inline void ex_make_table(ex_stage *s) { s->lights[0].shadow_source = SPS_SHADOW_TABLE; }
static inline void ex_hold(ex_stage *s) {
    s->clouds[0].revision = 1;
    s->frames = 2;
}
static inline void ex_look_again(ex_stage *s) { s->frames = 2; }
static inline void ex_make_fourier(ex_stage *s) {
    s->map.technique = SPS_TMAP_FOURIER;
    s->lights[0].shadow_map = &s->map, s->lights[0].shadow_source = SPS_SHADOW_AUTO;
}

static inline void ex_emit(ex_stage *s) { ex_color(s->clouds[0].emission, 0.3, 0.1, 0.05); }
static inline void ex_absorb(ex_stage *s) { ex_color(s->clouds[0].albedo, 0, 0, 0); }
static inline void ex_make_lobe(ex_stage *s, double g) {
    s->lobe.asymmetry = (float)g, s->lobe.weight = 1;
    s->clouds[0].lobes = &s->lobe, s->clouds[0].lobe_count = 1;
}
static inline void ex_scatter_forward(ex_stage *s) { ex_make_lobe(s, 0.6); }
static inline void ex_scatter_evenly(ex_stage *s) { ex_make_lobe(s, 0); }

static inline void ex_make_grey(ex_stage *s) {
    ex_color(s->clouds[0].albedo, 0.8, 0.8, 0.8);
    ex_color(s->lights[0].color, 3, 3, 3);
    ex_color(s->scene.background, 0.2, 0.2, 0.2);
}
static inline void ex_color_albedo(ex_stage *s) { ex_color(s->clouds[0].albedo, 0.7, 0.8, 0.9); }

/* Opaque from a value of one half on. */
static inline void ex_classify(ex_stage *s) {
    static const sps_transfer_point points[3] = {{0.4f, {0.8f, 0.5f, 0.3f}, 0, {0, 0, 0}},
                                                 {0.5f, {0.8f, 0.5f, 0.3f}, 20, {0, 0, 0}},
                                                 {1, {0.9f, 0.8f, 0.7f}, 20, {0, 0, 0}}};
    s->transfer.points = points, s->transfer.point_count = 3;
    s->clouds[0].transfer = &s->transfer;
}
/* What the cloud is without a transfer function. */
static inline void ex_classify_as_is(ex_stage *s) {
    static const sps_transfer_point points[2] = {{0, {0.7f, 0.8f, 0.9f}, 0, {0, 0, 0}},
                                                 {1, {0.7f, 0.8f, 0.9f}, 3, {0, 0, 0}}};
    s->transfer.points = points, s->transfer.point_count = 2;
    s->clouds[0].transfer = &s->transfer;
}
static inline void ex_shade_surface(ex_stage *s) { s->clouds[0].shading = SPS_SHADING_SURFACE; }
static inline void ex_shade_highlight(ex_stage *s) { s->clouds[0].specular = 0.5f; }
static inline void ex_classify_surface(ex_stage *s) {
    ex_classify(s);
    ex_shade_surface(s);
}
static inline void ex_dull_surface(ex_stage *s) { s->clouds[0].shininess = 64; }
static inline void ex_no_gradient(ex_stage *s) {
    ex_shade_surface(s);
    s->clouds[0].gradient_full = 1e18f;
}

static inline void ex_add_ambient(ex_stage *s) { ex_color(s->scene.ambient, 0.2, 0.25, 0.3); }
static inline void ex_own_ambient(ex_stage *s) { ex_color(s->clouds[0].ambient, 0.2, 0.25, 0.3); }
static inline void ex_scatter_ambient(ex_stage *s) { s->view.scattering = SPS_SCATTERING_AMBIENT; }
static inline void ex_scatter_ways_forward(ex_stage *s) { s->view.scattering = SPS_SCATTERING_FORWARD; }
static inline void ex_scatter_aside(ex_stage *s) { s->view.scattering = SPS_SCATTERING_CONVOLUTION; }
static inline void ex_scatter_fully(ex_stage *s) { s->view.scattering = SPS_SCATTERING_MULTIPLE; }
static inline void ex_scatter_auto(ex_stage *s) { s->view.scattering = SPS_SCATTERING_AUTO; }
static inline void ex_thin(ex_stage *s) { s->clouds[0].extinction = 0.001f; }

static inline int ex_sky(void *user, size_t count, const float *directions, float *out_rgb) {
    (void)user;
    for (size_t i = 0; i < count; ++i) ex_color(out_rgb + 3 * i, 0.1, 0.15, 0.2 + 0.1 * (double)directions[3 * i + 1]);
    return 0;
}
static inline int ex_plain_sky(void *user, size_t count, const float *directions, float *out_rgb) {
    (void)directions;
    for (size_t i = 0; i < count; ++i) memcpy(out_rgb + 3 * i, user, 3 * sizeof(float));
    return 0;
}
static inline void ex_paint_sky(ex_stage *s) { s->scene.background_fn = ex_sky; }
static inline void ex_paint_plain_sky(ex_stage *s) {
    s->scene.background_fn = ex_plain_sky, s->scene.background_user = s->scene.background;
}

static inline int ex_checker(void *user, size_t count, const sps_surface_point *points, sps_surface *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i)
        if ((int)(floor(4 * points[i].position[0]) + floor(4 * points[i].position[2])) & 1)
            ex_color(out[i].albedo, 0.1, 0.1, 0.1);
    return 0;
}
static inline int ex_as_it_is(void *user, size_t count, const sps_surface_point *points, sps_surface *out) {
    (void)user, (void)count, (void)points, (void)out;
    return 0;
}
static inline void ex_paint_checker(ex_stage *s) { s->meshes[0].shade_fn = ex_checker; }
static inline void ex_paint_as_it_is(ex_stage *s) { s->meshes[0].shade_fn = ex_as_it_is; }

static inline void ex_sample_edges(ex_stage *s) { s->view.coverage_samples = 4; }
static inline void ex_sample_once(ex_stage *s) { s->view.coverage_samples = 1; }
static inline void ex_ask_depth(ex_stage *s) { s->wants_depth = 1; }
static inline void ex_tolerate(ex_stage *s) { s->view.tolerance = 0.1f; }
static inline void ex_replace(ex_stage *s) { s->scene.replace_invalid = 1; }
static inline void ex_tell_ranges(ex_stage *s) { s->clouds[0].range_fn = ex_cloud_range; }

/* The cloud in a corner of a box that is four times as wide. */
static inline void ex_surround(ex_stage *s) {
    for (int k = 0; k < 3; ++k) s->clouds[0].size[k] *= 4, s->clouds[0].placement.axis[k][k] *= 4;
}

static inline void ex_no_cloud(ex_stage *s) { s->scene.volume_count = 0; }
static inline void ex_only_polygons(ex_stage *s) {
    ex_no_cloud(s);
    ex_add_polygons(s);
}
static inline void ex_add_cloud(ex_stage *s) { s->scene.volume_count = 1; }

static inline void ex_let_shadow(ex_stage *s) { s->lights[0].no_shadow = 0; }
static inline void ex_floor_no_shadow(ex_stage *s) {
    ex_add_polygons(s);
    ex_no_shadow(s);
}
static inline void ex_only_polygons_no_shadow(ex_stage *s) {
    ex_only_polygons(s);
    ex_no_shadow(s);
}
static inline void ex_lamp_and_polygons(ex_stage *s) {
    ex_make_lamp(s);
    ex_add_polygons(s);
}
/* From above, so that it fills the picture. */
static inline void ex_only_floor(ex_stage *s) {
    ex_add_floor(s);
    s->view.camera.position[1] = 6;
    s->view.camera.position[2] = 0.5;
}
static inline void ex_absorb_unlit(ex_stage *s) {
    ex_absorb(s);
    ex_no_light(s);
}
/* Polygons keep the light in the scene. */
static inline void ex_absorb_beside(ex_stage *s) {
    ex_absorb(s);
    ex_add_polygons(s);
}
static inline void ex_polygons_again(ex_stage *s) {
    ex_add_polygons(s);
    ex_look_again(s);
}
static inline void ex_hold_polygons(ex_stage *s) { s->meshes[0].revision = s->meshes[1].revision = 1; }
static inline void ex_cells_again(ex_stage *s) {
    ex_scatter_fully(s);
    ex_look_again(s);
}
static inline void ex_add_tables(ex_stage *s) {
    ex_make_table(s);
    ex_look_again(s);
}

/* ---------------------------------------------------------------------------------- what is set, and not needed */

static inline void ex_emit_nothing(ex_stage *s) { ex_color(s->clouds[0].emission, 0, 0, 0); }
static inline void ex_add_dark(ex_stage *s) {
    ex_throw_stripes(s);
    ex_add_light(s);
    s->lights[0].projector = NULL;
    s->lights[1].angular_diameter = 0.1;
    ex_color(s->lights[1].color, 0, 0, 0);
}
/* A spotlight that meets nothing. */
static inline void ex_add_light_away(ex_stage *s) {
    ex_add_light(s);
    s->lights[1].kind = SPS_LIGHT_POINT;
    s->lights[1].position[0] = 2, s->lights[1].position[1] = 4;
    s->lights[1].direction[0] = 0, s->lights[1].direction[1] = 1, s->lights[1].direction[2] = 0;
    s->lights[1].outer_cone = 0.3;
}
static inline void ex_add_empty_volume(ex_stage *s) {
    s->clouds[1] = s->clouds[0];
    s->clouds[1].size[1] = 0;
    ex_color(s->clouds[1].emission, 1, 1, 1);
    s->scene.volume_count = 2;
}
static inline void ex_add_clear_volume(ex_stage *s) {
    s->clouds[1] = s->clouds[0];
    s->clouds[1].extinction = 0;
    s->scene.volume_count = 2;
}
/* A volume that would emit, if its voxels had values. */
static inline void ex_add_void(ex_stage *s) {
    s->clouds[1] = s->clouds[0];
    s->clouds[1].read_fn = ex_nothing_read;
    ex_color(s->clouds[1].emission, 1, 1, 1);
    s->scene.volume_count = 2;
}
static inline void ex_add_empty_mesh(ex_stage *s) {
    ex_add_polygons(s);
    s->meshes[0].triangle_count = s->meshes[1].triangle_count = 0;
    ex_make_pane(s);
    ex_paint_checker(s);
}
/* Behind the eye, where it shades nothing. */
static inline void ex_add_mesh_behind(ex_stage *s) {
    ex_add_sail(s);
    s->meshes[0].placement.origin[2] = 40;
    for (int k = 0; k < 3; ++k) s->meshes[0].placement.axis[k][k] = 1;
}
/* All light passes it, and it reflects none. */
static inline void ex_add_clear_pane(ex_stage *s) {
    ex_add_sail(s);
    ex_color(s->meshes[s->scene.mesh_count - 1].transmittance, 1, 1, 1);
    ex_color(s->meshes[s->scene.mesh_count - 1].albedo, 0, 0, 0);
}
static inline void ex_add_no_swarm(ex_stage *s) {
    ex_add_swarm(s);
    s->swarm.count = 0;
}
static inline void ex_add_clear_swarm(ex_stage *s) { ex_add_swarm_of(s, 0); }
static inline void ex_make_pane_opaque(ex_stage *s) { ex_color(s->meshes[1].transmittance, 1e-31, 1e-31, 1e-31); }
static inline void ex_whole_region(ex_stage *s) {
    s->view.region[2] = s->view.width, s->view.region[3] = s->view.height;
}
static inline void ex_make_noise(ex_stage *s) { s->clouds[0].read_fn = ex_noise_read; }

static inline void ex_table_no_shadow(ex_stage *s) {
    s->lights[0].no_shadow = 1;
    s->lights[0].shadow_source = SPS_SHADOW_TABLE;
    s->lights[0].shadow_map_resolution = 256;
}
static inline void ex_many_points(ex_stage *s) { s->lights[0].samples = 256; }
static inline void ex_fine_sheets(ex_stage *s) { s->view.shadow_resolution = 512; }
static inline void ex_many_cells(ex_stage *s) { s->view.scattering_resolution = 200; }
/* Behind the eye, and not on the light's way. */
static inline void ex_add_volume_behind(ex_stage *s) {
    s->clouds[1] = s->clouds[0];
    s->clouds[1].placement.origin[2] = 40;
    s->scene.volume_count = 2;
}
static inline void ex_add_swarm_behind(ex_stage *s) {
    static sps_particle far_ball;
    ex_add_swarm(s);
    far_ball.position[2] = 40, far_ball.radius = 0.2f, far_ball.optical_depth = 1;
    s->swarm.user = &far_ball, s->swarm.count = 1;
}

/* ================================================================================================= the lists */

typedef struct ex_effect {
    const char *name, *field;
    ex_change common, with; /* common: of both scenes */
    int pass;               /* runs with it, and does not without it; -1: none does */
} ex_effect;

static const ex_effect ex_effects[] = {
    {"volumes", "`volumes`", ex_only_polygons, ex_add_cloud, SPS_PASS_EYE_SHEETS},
    {"classified volumes", "`transfer`", NULL, ex_classify, -1},
    {"surfaces by the gradient", "`shading`", ex_classify, ex_shade_surface, SPS_PASS_GRADIENT},
    {"... their highlight", "`specular`", ex_classify_surface, ex_shade_highlight, -1},
    {"emission", "`emission`", NULL, ex_emit, SPS_PASS_EMISSION},
    {"single scattering", "`albedo`", ex_absorb, ex_color_albedo, SPS_PASS_SCATTERING},
    {"phase functions", "`lobes`", NULL, ex_scatter_forward, -1},
    {"colors", "`albedo`, `color`", ex_make_grey, ex_color_albedo, -1},
    {"particles", "`particles`", ex_no_cloud, ex_add_swarm, SPS_PASS_EYE_SHEETS},
    {"polygons", "`meshes`", NULL, ex_add_polygons, SPS_PASS_EYE_POLYGONS},
    {"... their shadows on each other", "`no_shadow` 0", ex_only_polygons_no_shadow, ex_let_shadow,
     SPS_PASS_SHADOW_RAYS},
    {"... and in gas, by depth maps", "`no_shadow` 0", ex_floor_no_shadow, ex_let_shadow, SPS_PASS_LIGHT_POLYGONS},
    {"textures", "`shade_fn`", ex_add_polygons, ex_paint_checker, SPS_PASS_TEXTURES},
    {"translucent polygons", "`transmittance`", ex_add_polygons, ex_make_pane, SPS_PASS_LAYERS},
    {"smooth edges", "`coverage_samples`", ex_add_polygons, ex_sample_edges, SPS_PASS_LAYERS},
    {"lights", "`lights`", ex_no_light, ex_light_up, SPS_PASS_SCATTERING},
    {"shadows of gas, by sheets", "`no_shadow` 0", ex_no_shadow, ex_let_shadow, SPS_PASS_LIGHT_SHEETS},
    {"... by a shadow table", "`shadow_source`", NULL, ex_make_table, SPS_PASS_LIGHT_MAPS},
    {"... by a Fourier map", "`shadow_map`", NULL, ex_make_fourier, SPS_PASS_LIGHT_MAPS},
    {"a second light", "`lights`", NULL, ex_add_light, -1},
    {"... without shadows", "`no_shadow`", NULL, ex_add_shadowless, -1},
    {"a sun with an angular diameter", "`angular_diameter`", ex_add_polygons, ex_make_soft, SPS_PASS_PENUMBRAE},
    {"a disc", "`axes`", ex_lamp_and_polygons, ex_make_large_disc, SPS_PASS_PENUMBRAE},
    {"a spotlight", "`outer_cone`", ex_make_lamp, ex_make_spot, -1},
    {"a projected texture", "`projector`", ex_add_polygons, ex_throw_stripes, SPS_PASS_PROJECTORS},
    {"ambient light", "`ambient`", NULL, ex_add_ambient, SPS_PASS_AMBIENT},
    {"a volume's own", "`SPS_SCATTERING_AMBIENT`", ex_own_ambient, ex_scatter_ambient, SPS_PASS_AMBIENT},
    {"multiple scattering, forward", "`SPS_SCATTERING_FORWARD`", NULL, ex_scatter_ways_forward, SPS_PASS_FORWARD},
    {"... with lateral spread, from sheet to sheet", "`SPS_SCATTERING_CONVOLUTION`", NULL, ex_scatter_aside,
     SPS_PASS_SPREADING},
    {"... in every direction", "`SPS_SCATTERING_MULTIPLE`", NULL, ex_scatter_fully, SPS_PASS_CELLS},
    {"... where gas calls for it", "`SPS_SCATTERING_AUTO`", NULL, ex_scatter_auto, SPS_PASS_CELLS},
    {"a background that varies", "`background_fn`", NULL, ex_paint_sky, -1},
    {"distances", "`sps_image.depth`", NULL, ex_ask_depth, -1},
};

/* What may be expected of an effect that is set although nothing needs it. */
typedef enum ex_expectation {
    EX_UNTOUCHED = 0, /* it is recognised: the same calls, passes, counts, bytes, and the same bits */
    EX_SAME_BITS,     /* costs something; the same bits */
    EX_ROUNDING,      /* costs something; the same picture within `allowed` */
    EX_OTHER          /* another picture, for a reason that is stated */
} ex_expectation;

typedef struct ex_unneeded {
    const char *name;
    ex_change common, set;
    ex_expectation expectation;
    double allowed; /* of radiance, which is at most 1 here */
    const char *why;
} ex_unneeded;

#define EX_HALF_ULP                                                                                                    \
    (0.5 * (double)FLT_EPSILON) /* of a value up to 1: by which a sum or a product of floats is rounded */

/* Values of voxels are off by 16 half ulps: of products and sums along three axes, four of each. The slope of
   ex_classify is 200 per unit of value, over half a unit of a ray at most. */
#define EX_CLASSIFIED (16 * 200 * 0.5)

static const ex_unneeded ex_unneeded_effects[] = {
    {"emission of 0", NULL, ex_emit_nothing, EX_UNTOUCHED, 0, ""},
    {"a soft black light with an image", NULL, ex_add_dark, EX_UNTOUCHED, 0, ""},
    {"a light, and nothing that it could shine on", ex_absorb_unlit, ex_light_up, EX_UNTOUCHED, 0, ""},
    {"a volume of no voxels that emits", NULL, ex_add_empty_volume, EX_UNTOUCHED, 0, ""},
    {"a volume without extinction and emission", NULL, ex_add_clear_volume, EX_UNTOUCHED, 0, ""},
    {"a set of 0 particles", NULL, ex_add_no_swarm, EX_UNTOUCHED, 0, ""},
    {"textured and translucent meshes of 0 triangles", NULL, ex_add_empty_mesh, EX_UNTOUCHED, 0, ""},
    {"a pane that lets 1e-31 pass", ex_add_polygons, ex_make_pane_opaque, EX_UNTOUCHED, 0, ""},
    {"`coverage_samples` of 1", ex_add_polygons, ex_sample_once, EX_UNTOUCHED, 0, ""},
    {"`coverage_samples` of 4 without polygons", NULL, ex_sample_edges, EX_UNTOUCHED, 0, ""},
    {"a disc of radius 0", ex_make_lamp, ex_make_point_disc, EX_UNTOUCHED, 0, ""},
    {"a cone of nearly the whole sphere", ex_make_lamp, ex_make_wide_spot, EX_UNTOUCHED, 0, ""},
    {"an even lobe", NULL, ex_scatter_evenly, EX_UNTOUCHED, 0, ""},
    {"a shininess without `specular`", ex_classify_surface, ex_dull_surface, EX_UNTOUCHED, 0, ""},
    {"scattering forward in gas that absorbs", ex_absorb_beside, ex_scatter_ways_forward, EX_UNTOUCHED, 0, ""},
    {"... aside", ex_absorb_beside, ex_scatter_aside, EX_UNTOUCHED, 0, ""},
    {"... in every direction", ex_absorb_beside, ex_scatter_fully, EX_UNTOUCHED, 0, ""},
    {"... by default", ex_absorb_beside, ex_scatter_auto, EX_UNTOUCHED, 0, ""},
    {"scattering in every direction, and no gas", ex_only_polygons, ex_scatter_fully, EX_UNTOUCHED, 0, ""},
    {"... and no light", ex_no_light, ex_scatter_fully, EX_UNTOUCHED, 0, ""},
    {"`SPS_SCATTERING_AMBIENT` without a volume's own", NULL, ex_scatter_ambient, EX_UNTOUCHED, 0, ""},
    {"a volume's own ambient light, without it", NULL, ex_own_ambient, EX_UNTOUCHED, 0, ""},
    {"`no_shadows` without a light that casts any", ex_no_shadow, ex_no_shadows, EX_UNTOUCHED, 0, ""},
    {"a `tolerance` without volumes", ex_only_polygons, ex_tolerate, EX_UNTOUCHED, 0, ""},
    {"a `tolerance` for what is classified", ex_classify, ex_tolerate, EX_UNTOUCHED, 0, ""},
    {"... for what emits", ex_emit, ex_tolerate, EX_UNTOUCHED, 0, ""},
    {"a table, for a light without shadows", ex_no_shadow, ex_table_no_shadow, EX_UNTOUCHED, 0, ""},
    {"256 points, for a light without an extent", ex_add_polygons, ex_many_points, EX_UNTOUCHED, 0, ""},
    {"a `shadow_resolution` without shadows", ex_no_shadow, ex_fine_sheets, EX_UNTOUCHED, 0, ""},
    {"a `scattering_resolution` without cells", NULL, ex_many_cells, EX_UNTOUCHED, 0, ""},
    {"ambient light, and nothing that it could light", ex_absorb, ex_add_ambient, EX_UNTOUCHED, 0, ""},
    {"scattering forward without shadows", ex_no_shadow, ex_scatter_ways_forward, EX_UNTOUCHED, 0, ""},
    {"... aside", ex_no_shadow, ex_scatter_aside, EX_UNTOUCHED, 0, ""},
    {"a region of all", NULL, ex_whole_region, EX_UNTOUCHED, 0, ""},
    {"`replace_invalid` without invalid values", NULL, ex_replace, EX_UNTOUCHED, 0, ""},
    {"a volume that would emit, of value 0", NULL, ex_add_void, EX_SAME_BITS, 0,
     "it is read; a channel for emission is planned before that"},
    {"particles of optical depth 0", NULL, ex_add_clear_swarm, EX_SAME_BITS, 0, "they are read, and dropped"},
    {"a mesh behind the eye, beside the light's way", NULL, ex_add_mesh_behind, EX_SAME_BITS, 0,
     "it is read; hits of the eye's rays, and a tree"},
    {"a pane that lets all light pass", NULL, ex_add_clear_pane, EX_ROUNDING, 16 * EX_HALF_ULP,
     "sums are split where it stands; layers, a map of panes, shadow rays"},
    {"a `shade_fn` that changes nothing", ex_add_polygons, ex_paint_as_it_is, EX_SAME_BITS, 0,
     "only the callback knows what it does"},
    {"`coverage_samples` of 4 where no edge is seen", ex_only_floor, ex_sample_edges, EX_SAME_BITS, 0,
     "all is rasterised at 4 x 4 points to find no edge"},
    {"an even white image, by the light", NULL, ex_throw_white, EX_ROUNDING, 16 * EX_HALF_ULP,
     "weights of lookups add up to 1 within rounding; 4 lookups per part of a slab"},
    {"a light whose cone meets nothing", NULL, ex_add_light_away, EX_ROUNDING, 16 * EX_HALF_ULP,
     "it is not black; a sweep of its own"},
    {"a disc of radius 1e-9", ex_make_lamp, ex_make_small_disc, EX_ROUNDING, 16 * EX_HALF_ULP,
     "gas leaves its shadows sharp; its irradiance is a mean over points"},
    {"a sun of 1e-9 radians", NULL, ex_make_hardly_soft, EX_SAME_BITS, 0, "gas leaves it sharp"},
    {"... and polygons", ex_add_polygons, ex_make_hardly_soft, EX_ROUNDING, 16 * EX_HALF_ULP,
     "surfaces trace 16 rays for one, and take their mean"},
    {"a surface whose gradient never counts", ex_classify, ex_no_gradient, EX_ROUNDING, EX_CLASSIFIED *EX_HALF_ULP,
     "gradients; values are summed in another order, and the transfer function's slope amplifies their rounding"},
    {"`SPS_SCATTERING_AUTO` in thin gas", ex_thin, ex_scatter_auto, EX_SAME_BITS, 0,
     "it turns out to be thin: a look at each voxel, and a plan of what might be"},
    {"a `tolerance` for noise", ex_make_noise, ex_tolerate, EX_SAME_BITS, 0,
     "third differences of voxels, which prove that none is smooth"},
    {"a `background_fn` that is even", NULL, ex_paint_plain_sky, EX_SAME_BITS, 0, "a call per row"},
    {"`depth`, which is not looked at", NULL, ex_ask_depth, EX_SAME_BITS, 0, "the sum of distances"},
    {"a `range_fn` that tells of no empty block", NULL, ex_tell_ranges, EX_SAME_BITS, 0, "a call per block"},
    {"a transfer function that says what the gas says", NULL, ex_classify_as_is, EX_OTHER, 0,
     "classified volumes have thinner slabs and finer sheets: other samples of the same field"},
    {"a volume behind the eye", NULL, ex_add_volume_behind, EX_OTHER, 0,
     "it might shade what is seen: slabs and sheets are fitted to all gas, and so lie elsewhere"},
    {"a particle behind the eye", NULL, ex_add_swarm_behind, EX_OTHER, 0, "the same"},
};

/* Work that is left out, to the same bits, where `set`. */
static const ex_unneeded ex_savings[] = {
    {"empty blocks, by `range_fn`", ex_surround, ex_tell_ranges, EX_SAME_BITS, 0, ""},
    {"voxels cached by the last call", ex_look_again, ex_hold, EX_SAME_BITS, 0, ""},
    {"polygons and their tree cached", ex_polygons_again, ex_hold_polygons, EX_SAME_BITS, 0, ""},
    {"a shadow table cached", ex_add_tables, ex_hold, EX_SAME_BITS, 0, ""},
    {"light in cells cached", ex_cells_again, ex_hold, EX_SAME_BITS, 0, ""},
};

#define EX_COUNT(list) ((int)(sizeof(list) / sizeof(list)[0]))

/* ============================================================================================ what they cost */

typedef enum ex_counter_kind {
    EX_CALLS_OF, /* a callback */
    EX_WORK,
    EX_DETAIL /* follows from others */
} ex_counter_kind;

typedef struct ex_counter {
    const char *name;
    size_t offset; /* of a uint64_t in sps_stats_report */
    ex_counter_kind kind;
} ex_counter;

#define EX_COUNTER(field, kind, name)                                                                                  \
    { name, offsetof(sps_stats_report, field), kind }

static const ex_counter ex_counters[] = {EX_COUNTER(range_calls, EX_CALLS_OF, "`range_fn`"),
                                         EX_COUNTER(read_calls, EX_CALLS_OF, "`read_fn`"),
                                         EX_COUNTER(eval_calls, EX_CALLS_OF, "`eval_fn`"),
                                         EX_COUNTER(triangle_calls, EX_CALLS_OF, "of triangles"),
                                         EX_COUNTER(particle_calls, EX_CALLS_OF, "of particles"),
                                         EX_COUNTER(projector_calls, EX_CALLS_OF, "`sample_fn`"),
                                         EX_COUNTER(background_calls, EX_CALLS_OF, "`background_fn`"),
                                         EX_COUNTER(shade_calls, EX_CALLS_OF, "`shade_fn`"),
                                         EX_COUNTER(blocks_skipped, EX_WORK, "blocks skipped"),
                                         EX_COUNTER(voxels_read, EX_WORK, "voxels read"),
                                         EX_COUNTER(voxels_relevant, EX_DETAIL, "relevant voxels"),
                                         EX_COUNTER(bricks, EX_DETAIL, "bricks"),
                                         EX_COUNTER(values_replaced, EX_DETAIL, "values replaced"),
                                         EX_COUNTER(triangles, EX_DETAIL, "triangles"),
                                         EX_COUNTER(pixels_of_polygons, EX_WORK, "pixels of polygons"),
                                         EX_COUNTER(surface_points, EX_WORK, "points for `shade_fn`"),
                                         EX_COUNTER(layers, EX_WORK, "layers"),
                                         EX_COUNTER(shadow_rays, EX_WORK, "shadow rays"),
                                         EX_COUNTER(particles, EX_DETAIL, "particles"),
                                         EX_COUNTER(slabs, EX_WORK, "slabs"),
                                         EX_COUNTER(slabs_empty, EX_DETAIL, "empty slabs"),
                                         EX_COUNTER(eye_footprints, EX_WORK, "eye's footprints"),
                                         EX_COUNTER(light_footprints, EX_WORK, "lights' footprints"),
                                         EX_COUNTER(eye_samples, EX_WORK, "eye's samples"),
                                         EX_COUNTER(light_samples, EX_WORK, "lights' samples"),
                                         EX_COUNTER(tables_made, EX_DETAIL, "tables made"),
                                         EX_COUNTER(tables_held, EX_WORK, "tables held"),
                                         EX_COUNTER(cells, EX_WORK, "cells (or texels)"),
                                         EX_COUNTER(soft_texels, EX_WORK, "soft texels"),
                                         EX_COUNTER(pixels_shaded, EX_WORK, "pixels shaded"),
                                         EX_COUNTER(tiles_finished, EX_WORK, "tiles finished early"),
                                         EX_COUNTER(allocations, EX_DETAIL, "allocations")};

static inline uint64_t ex_counted(const sps_stats_report *stats, int counter) {
    uint64_t value;
    memcpy(&value, (const char *)stats + ex_counters[counter].offset, sizeof value);
    return value;
}

/* Whether two calls have done the same, callback by callback and count by count. */
static inline int ex_same_counts(const sps_stats_report *a, const sps_stats_report *b) {
    for (int i = 0; i < EX_COUNT(ex_counters); ++i)
        if (ex_counted(a, i) != ex_counted(b, i)) return 0;
    return 1;
}

/* Whether two plans are the same, whatever their reasons. */
static inline int ex_same_plans(const sps_plan_report *a, const sps_plan_report *b) {
    for (int i = 0; i < SPS_PASS_COUNT; ++i)
        if (a->pass[i].runs != b->pass[i].runs || a->pass[i].bytes != b->pass[i].bytes) return 0;
    return a->sweep_count == b->sweep_count && a->color_channels == b->color_channels &&
           a->sheet_channels == b->sheet_channels && a->slab_count == b->slab_count &&
           a->shadow_width == b->shadow_width && a->shadow_height == b->shadow_height &&
           a->light_points == b->light_points && a->bytes == b->bytes;
}

#endif /* EX_EFFECTS_SCENES_H */
