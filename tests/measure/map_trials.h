/* map_trials.h: what maps.c measures: transmittance maps of every technique, on six scenes. Include after measuring.h,
   puff.h, shapes.h, scene.h and chart.h. */

#ifndef MAP_TRIALS_H
#define MAP_TRIALS_H

enum {
    PARTICLES = EX_PUFF_PARTICLES,
    MAP_SIZE = 512,       /* of the smoke, as in the thesis */
    SMALL_MAP_SIZE = 256, /* of the other scenes */
    WIDTH = 1024,
    HEIGHT = 768,
    GAS_POINTS = 100000,
    GROUND_POINTS = 50000,
    POINTS = GAS_POINTS + GROUND_POINTS,
    COUNTS = 4,
    TURNS = 2 /* of timing, in addition to the one that measures errors */
};

#define LONG 0.3 /* seconds from which on a time is not taken again */

static const int counts[COUNTS] = {6, 8, 16, 24};
static const float epsilons[COUNTS] = {0.1f, 0.03f, 0.01f, 0.003f};

/* ============================================================================================== techniques */

typedef struct kind {
    const char *name;
    sps_tmap_technique technique;
    int cubic;
    int texel_range;
    ex_mark mark;
    unsigned color;
} kind;

/* Places in `kinds`. Those of the thesis are OPACITY, DEEP_OPACITY and FOURIER. */
enum {
    OPACITY,
    OPACITY_CUBIC,
    DEEP_OPACITY,
    DEEP_OPACITY_CUBIC,
    FOURIER,
    FOURIER_TEXEL_RANGE,
    MOMENT,
    FEW_NODES,
    BEER,
    COMPRESSED,
    KINDS
};

static const kind kinds[KINDS] = {
    [OPACITY] = {"opacity", SPS_TMAP_OPACITY, 0, 0, EX_MARK_DISC, 0x1f5fbf},
    [OPACITY_CUBIC] = {"opacity, cubic", SPS_TMAP_OPACITY, 1, 0, EX_MARK_RING, 0x1f5fbf},
    [DEEP_OPACITY] = {"deep opacity", SPS_TMAP_DEEP_OPACITY, 0, 0, EX_MARK_DISC, 0x1a9641},
    [DEEP_OPACITY_CUBIC] = {"deep opacity, cubic", SPS_TMAP_DEEP_OPACITY, 1, 0, EX_MARK_RING, 0x1a9641},
    [FOURIER] = {"Fourier", SPS_TMAP_FOURIER, 0, 0, EX_MARK_DISC, 0xd7191c},
    [FOURIER_TEXEL_RANGE] = {"Fourier, texel range", SPS_TMAP_FOURIER, 0, 1, EX_MARK_RHOMB, 0xf08030},
    [MOMENT] = {"moment", SPS_TMAP_MOMENT, 0, 0, EX_MARK_SQUARE, 0x000000},
    [FEW_NODES] = {"adaptive", SPS_TMAP_COMPRESSED, 0, 0, EX_MARK_RHOMB, 0x00a0a0},
    [BEER] = {"Beer", SPS_TMAP_BEER, 0, 0, EX_MARK_SQUARE, 0x808080},
    [COMPRESSED] = {"compressed", SPS_TMAP_COMPRESSED, 0, 0, EX_MARK_RHOMB, 0xc08a00},
};

/* The nearest number of components that a technique can have, not above `wanted` except where there is none below. */
static int components_of(const kind *k, int wanted) {
    if (k == &kinds[COMPRESSED]) return 0;
    switch (k->technique) {
    case SPS_TMAP_BEER: return 3;
    case SPS_TMAP_FOURIER: return (wanted - 1) | 1;
    case SPS_TMAP_MOMENT: return wanted > 6 ? 7 : 5;
    default: return wanted;
    }
}

typedef struct spread {
    double rms, high, largest; /* high: the 99th percentile */
} spread;

/* One technique with one number of components. */
typedef struct trial {
    const kind *kind;
    int wanted;
    sps_tmap_settings settings;
    double bytes, build, query, render; /* seconds */
    spread gas, ground, picture;        /* against the exact deep map */
    double flicker;                     /* of transmittance in the gas, as the light turns */
    double own;                         /* rms in the gas against this technique's own map of 24, as in the thesis */
} trial;

typedef struct trials {
    trial list[COUNTS * KINDS];
    int count;
} trials;

/* Whether this number of components yields the same map as the one before it. */
static int is_repeated(const kind *k, int which) {
    return which > 0 && k != &kinds[COMPRESSED] &&
           components_of(k, counts[which]) == components_of(k, counts[which - 1]);
}

static void trials_list(trials *all, const sps_tmap_settings *range) {
    memset(all, 0, sizeof *all);
    for (int k = 0; k < KINDS; ++k)
        for (int which = 0; which < COUNTS; ++which) {
            trial *t = all->list + all->count;
            if (is_repeated(&kinds[k], which)) continue;

            t->kind = &kinds[k], t->wanted = counts[which], t->settings = *range;
            t->settings.technique = kinds[k].technique;
            t->settings.components = components_of(&kinds[k], counts[which]);
            t->settings.cubic = kinds[k].cubic;
            t->settings.texel_range = kinds[k].texel_range;
            t->settings.epsilon = k == COMPRESSED ? epsilons[which] : 0;
            ++all->count;
        }
}

/* NULL where this technique has no map of this number of components. */
static const trial *trial_of(const trials *all, int kind_index, int wanted) {
    for (int i = 0; i < all->count; ++i)
        if (all->list[i].kind == &kinds[kind_index] && all->list[i].wanted == wanted) return &all->list[i];
    return NULL;
}

/* "Fourier, Lanczos 7" */
static const char *trial_name(const trial *t, char text[48]) {
    if (t->kind == &kinds[COMPRESSED])
        snprintf(text, 48, "%s %g", t->kind->name, (double)t->settings.epsilon);
    else
        snprintf(text, 48, "%s %d", t->kind->name, t->settings.components);
    return text;
}

/* ================================================================================================== scenes */

/* Stays where it is: the scene points into it. */
typedef struct set_up {
    const char *name, *words;
    sps_particle list[PARTICLES];
    sps_particles gas;
    ex_mesh ground, core;
    sps_mesh meshes[2];
    sps_light light;
    sps_scene scene, occluders; /* the ground shades nothing */
    sps_view view;
    sps_tmap_light light_view;
    sps_tmap_settings range;
    int map_size;
    double *points;                     /* in the gas, then on the ground below it */
    float *exact;                       /* transmittance there */
    float *exact_turned;                /* transmittance in the gas with the light turned, by -1 and 1 steps */
    float *exact_rgba;                  /* the picture */
    double slabs_seconds;               /* of the picture without a map */
    spread slabs_apart;                 /* that picture from the exact map's */
    double exact_bytes, shade, covered; /* of the exact map, mean T in the gas, share of texels that see gas */
    /* Rms errors in the gas of layouts that the library does not have, made from the exact map's lists: deep opacity as
       in the thesis, by how many numbers a texel, and its difference from its own run with 24; Beer as engines have it
     */
    double thesis_rms[COUNTS], thesis_own[COUNTS], beer_rms;
    trials trials;
} set_up;

static const ex_vec middle = {0, 1.25, 0}, lamp = {2.6, 6.2, 2.0};

static void make_puff(set_up *s) {
    const ex_puff puff = {middle, 1.0, 0.05, 0.14, 0.11, 2};
    s->name = "puff", s->words = "a ball of smoke with billows";
    ex_puff_fill(&puff, PARTICLES, s->list);
}

static void make_wind(set_up *s) {
    const ex_wind wind = {{0.9, 0, 0}, 0, 1.25, 0.3, 0.5, 0.35, 3};
    make_puff(s);
    s->name = "wind", s->words = "the same smoke, after a gusty wind";
    ex_puff_blow(&wind, 1.2, 24, PARTICLES, s->list);
    for (int i = 0; i < PARTICLES; ++i) s->list[i].position[0] -= 0.9f; /* back to where camera and light look */
}

static void put(sps_particle *particle, ex_vec at, double radius, double optical_depth) {
    ex_store(particle->position, at);
    particle->radius = (float)radius, particle->optical_depth = (float)optical_depth;
}

static void make_shell(set_up *s) {
    const ex_vec along = ex_vec_unit(ex_vec_sub(lamp, middle));
    uint32_t random = 5;
    s->name = "shell", s->words = "particles on the half of a sphere that faces the light, nothing below it";
    for (int i = 0; i < PARTICLES;) {
        const ex_vec way = ex_vec_unit(ex_random_in_ball(&random));
        if (ex_vec_dot(way, along) < 0.1) continue;
        put(&s->list[i++], ex_vec_add(middle, ex_vec_scale(way, 0.95)), 0.04, 0.4);
    }
}

static void make_core(set_up *s) {
    uint32_t random = 9;
    s->name = "core", s->words = "a small core that nothing shines through, in faint gas";
    for (int i = 0; i < PARTICLES; ++i)
        if (i % 2)
            put(&s->list[i], ex_vec_add(middle, ex_vec_scale(ex_random_in_ball(&random), 0.25)), 0.07, 2);
        else
            put(&s->list[i], ex_vec_add(middle, ex_vec_scale(ex_random_in_ball(&random), 0.85)), 0.10, 0.03);
}

static void make_ball(set_up *s) {
    static const float grey[3] = {0.5f, 0.5f, 0.5f};
    uint32_t random = 9;
    double profile[2 * 9];
    s->name = "ball", s->words = "an opaque ball of polygons in the same faint gas";
    for (int i = 0; i < PARTICLES; ++i)
        put(&s->list[i], ex_vec_add(middle, ex_vec_scale(ex_random_in_ball(&random), 0.85)), 0.08, 0.03);
    for (int i = 0; i < 9; ++i)
        profile[2 * i] = 0.3 * sin(i * EX_PI / 8), profile[2 * i + 1] = -0.3 * cos(i * EX_PI / 8);
    const ex_lathe lathe = {profile, 9, middle, {0, 1, 0}};
    ex_shape_lathe(&s->core, &lathe, 48, grey, NULL);
    s->meshes[1] = ex_shape_mesh(&s->core);
}

static void make_clumps(set_up *s) {
    const ex_vec along = ex_vec_unit(ex_vec_sub(lamp, middle));
    const ex_puff upper = {ex_vec_add(middle, ex_vec_scale(along, 0.85)), 0.5, 0.03, 0.08, 0.12, 4},
                  lower = {ex_vec_add(middle, ex_vec_scale(along, -0.85)), 0.5, 0.03, 0.08, 0.12, 6};
    s->name = "clumps", s->words = "two clumps behind each other, and one stray particle far before them";
    ex_puff_fill(&upper, PARTICLES / 2, s->list);
    ex_puff_fill(&lower, PARTICLES / 2, s->list + PARTICLES / 2);
    put(&s->list[PARTICLES - 1], ex_vec_add(middle, ex_vec_scale(along, 3.2)), 0.05, 0.3);
}

enum { PUFF, WIND, CLUMPS, SHELL, CORE, BALL, SCENES };

static void (*const makers[SCENES])(set_up *) = {[PUFF] = make_puff,   [WIND] = make_wind, [CLUMPS] = make_clumps,
                                                 [SHELL] = make_shell, [CORE] = make_core, [BALL] = make_ball};

static ex_vec particle_at(const sps_particle *p) {
    return ex_vec_of((double)p->position[0], (double)p->position[1], (double)p->position[2]);
}

/* The narrowest cone about all particles, and the range of depths that they take up, with 2 % to spare. */
static void aim_light(set_up *s) {
    const ex_vec forward = ex_vec_unit(ex_vec_sub(middle, lamp));
    double widest = 0, depth[2] = {HUGE_VAL, 0};
    for (int i = 0; i < PARTICLES; ++i) {
        const ex_vec away = ex_vec_sub(particle_at(&s->list[i]), lamp);
        const double along = ex_vec_dot(away, forward), radius = (double)s->list[i].radius;
        const double across = sqrt(fmax(ex_vec_dot(away, away) - along * along, 0));
        widest = fmax(widest, atan2(across, along) + asin(radius / ex_vec_length(away)));
        depth[0] = fmin(depth[0], along - radius), depth[1] = fmax(depth[1], along + radius);
    }
    s->light_view.camera = ex_camera_at(lamp, middle, 2 * widest * 1.02 * 180 / EX_PI);
    s->light_view.width = s->light_view.height = s->map_size;
    s->range.technique = SPS_TMAP_DEEP;
    s->range.near_depth = depth[0] - 0.02 * (depth[1] - depth[0]);
    s->range.far_depth = depth[1] + 0.02 * (depth[1] - depth[0]);
}

/* Turns the light about the middle of the scene, by 0.02 degrees a step. */
static void turn_light(set_up *s, int steps) {
    const double angle = steps * 0.02 * EX_PI / 180, c = cos(angle), d = sin(angle);
    double *at = s->light_view.camera.position;
    const double x = at[0] - middle.x, z = at[2] - middle.z;
    at[0] = middle.x + c * x + d * z, at[2] = middle.z - d * x + c * z;
}

static void set_up_begin(set_up *s, void (*make)(set_up *)) {
    static const float grey[3] = {0.3f, 0.3f, 0.3f};
    memset(s, 0, sizeof *s);
    make(s);
    s->gas.count = PARTICLES, s->gas.read_fn = ex_particles_read, s->gas.user = s->list;
    ex_color(s->gas.albedo, 0.8, 0.8, 0.8);
    ex_shape_quad(&s->ground, ex_vec_of(-9, 0, 9), ex_vec_of(9, 0, 9), ex_vec_of(9, 0, -9), ex_vec_of(-9, 0, -9), grey);
    s->meshes[0] = ex_shape_mesh(&s->ground);
    s->light.kind = SPS_LIGHT_POINT;
    s->light.position[0] = lamp.x, s->light.position[1] = lamp.y, s->light.position[2] = lamp.z;
    ex_color(s->light.color, 300, 300, 300);
    s->scene.particles = s->occluders.particles = &s->gas;
    s->scene.particle_set_count = s->occluders.particle_set_count = 1;
    s->scene.meshes = s->meshes, s->scene.mesh_count = 2;
    s->occluders.meshes = s->meshes + 1, s->occluders.mesh_count = 1;
    s->scene.lights = &s->light, s->scene.light_count = 1;
    s->view = ex_view(ex_vec_of(-0.9, 2.2, 7.2), ex_vec_of(-0.3, 0.95, 0), 27);
    s->view.width = WIDTH, s->view.height = HEIGHT, s->view.quality = SPS_QUALITY_MEDIUM;
    s->scene.background[0] = s->scene.background[1] = s->scene.background[2] = 0.05f;
    s->scene.ambient[0] = s->scene.ambient[1] = s->scene.ambient[2] = 0.02f;
    s->map_size = make == make_puff || make == make_wind ? MAP_SIZE : SMALL_MAP_SIZE;
    aim_light(s);
    trials_list(&s->trials, &s->range);
}

static void set_up_end(set_up *s) {
    ex_mesh_free(&s->ground);
    ex_mesh_free(&s->core);
    free(s->points);
    free(s->exact);
    free(s->exact_turned);
    free(s->exact_rgba);
}

/* Points in the gas, a particle drawn at random and then a point in it, and where rays through such points meet the
   ground. */
static void scatter_points(set_up *s) {
    uint32_t random = 1;
    s->points = (double *)ex_allocate(POINTS, 3 * sizeof(double));
    for (int i = 0; i < POINTS; ++i) {
        const sps_particle *p = &s->list[(int)(ex_random(&random) * PARTICLES)];
        ex_vec at = ex_vec_add(particle_at(p), ex_vec_scale(ex_random_in_ball(&random), (double)p->radius));
        if (i >= GAS_POINTS)
            at = ex_vec_add(lamp, ex_vec_scale(ex_vec_sub(at, lamp), lamp.y / (lamp.y - fmin(at.y, 0.9 * lamp.y))));
        s->points[3 * i] = at.x, s->points[3 * i + 1] = at.y, s->points[3 * i + 2] = at.z;
    }
}

#endif /* MAP_TRIALS_H */
