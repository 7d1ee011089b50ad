/* price_scenes.h: the fourteen scenes of prices.c, each with its truth: six that have a closed form or an independent
   estimate, six like assets, and two of transfer functions: fire and labels. Include after bench_scenes.h. */

#ifndef PRICE_SCENES_H
#define PRICE_SCENES_H

#define PRICE_SIZE 256 /* pixels along both sides */

/* The radiance, the same in red, green and blue, of a ray from `origin` along a unit direction; `list`: the scene's
   particles, if it has any. */
typedef double (*exact_fn)(const sps_particle *list, ex_vec origin, ex_vec direction);

/* A scene and what its pictures are compared with. `kept`: what must outlive it. Stays where it is, as a frame does. */
typedef struct priced {
    frame frame;
    sampled truth;
    double noise;   /* standard error of the truth, root mean square; 0: it has none */
    exact_fn exact; /* of an orthographic picture from wherever it is seen; NULL: there is no such form */
    struct {
        ex_grid grid;
        sps_particles particles;
        sps_particle *list;
        ex_mesh land;
        sps_transfer transfer;
    } kept;
} priced;

/* ============================================================================================ closed forms */

/* The exact pixels of an orthographic picture. */
static void exact_truth(priced *p, exact_fn exact) {
    const sps_camera *camera = &p->frame.view.camera;
    frame *t = &p->truth.frame;
    const int size = p->frame.view.width;
    const double pixel = camera->ortho_height / size;
    const ex_vec from = ex_vec_of(camera->position[0], camera->position[1], camera->position[2]);
    const ex_vec to = ex_vec_of(camera->target[0], camera->target[1], camera->target[2]);
    const ex_vec ahead = ex_vec_unit(ex_vec_sub(to, from));
    const ex_vec right = ex_vec_unit(ex_vec_cross(ahead, ex_vec_of(camera->up[0], camera->up[1], camera->up[2])));
    const ex_vec up = ex_vec_cross(right, ahead);
    p->truth.stride = 1;
    frame_copy(t, &p->frame);
    for (int i = 0; i < size * size; ++i) {
        const double x = pixel * (i % size - 0.5 * (size - 1)), y = pixel * (0.5 * (size - 1) - i / size);
        const ex_vec origin = ex_vec_add(from, ex_vec_add(ex_vec_scale(right, x), ex_vec_scale(up, y)));
        for (int c = 0; c < 3; ++c) t->rgba[4 * i + c] = (float)exact(p->kept.list, origin, ahead);
    }
}

/* The square of a ray's distance from a point. */
static double square_beside(ex_vec origin, ex_vec direction, ex_vec point) {
    const ex_vec to = ex_vec_sub(point, origin);
    const double along = ex_vec_dot(to, direction);
    return fmax(ex_vec_dot(to, to) - along * along, 0);
}

static void seen_from_above(priced *p, double height) {
    frame_begin(&p->frame, PRICE_SIZE, PRICE_SIZE);
    p->frame.scene.volume_count = p->frame.scene.mesh_count = p->frame.scene.light_count = 0;
    p->frame.view.camera.position[2] = 10;
    p->frame.view.camera.ortho_height = height;
}

static int even_density(void *user, size_t count, const double *positions, float *out) {
    (void)user, (void)positions;
    for (size_t i = 0; i < count; ++i) out[i] = 1;
    return 0;
}

static void add_gas(frame *f, int voxels, double extinction) {
    f->scene.volume_count = 1;
    for (int i = 0; i < 3; ++i) f->volume.size[i] = voxels, f->volume.albedo[i] = 0.9f;
    f->volume.concurrent = 1, f->volume.revision = 1;
    f->volume.extinction = (float)extinction;
}

static void add_sun(frame *f, double x, double y, double z, double irradiance) {
    f->scene.light_count = 1;
    f->light.direction[0] = x, f->light.direction[1] = y, f->light.direction[2] = z;
    for (int c = 0; c < 3; ++c) f->light.color[c] = (float)irradiance;
}

/* A slab of even gas, 1 thick and 6 wide, lit at 45 degrees. With the light's and the eye's optical depths at depth s,
   t s sqrt 2 and t s, single scattering is a E / (4 pi (1 + sqrt 2)) (1 - exp(-t (1 + sqrt 2))). The light's sheets see
   the slab's whole width; the picture shows its middle, where light comes in through the face alone. */
static const double slab_depth = 3;

static double slab_exact(const sps_particle *list, ex_vec origin, ex_vec direction) {
    const double both = 1 + sqrt(2.0);
    (void)list, (void)origin, (void)direction;
    return (double)0.9f * EX_PI / (4 * EX_PI * both) * -expm1(-slab_depth * both);
}

static int build_slab(priced *p, ex_session *session) {
    static const double edges[3] = {6, 6, 1};
    (void)session;
    seen_from_above(p, 1);
    add_gas(&p->frame, 96, slab_depth);
    p->frame.volume.size[2] = 32;
    for (int i = 0; i < 3; ++i) {
        p->frame.volume.placement.axis[i][i] = edges[i];
        p->frame.volume.placement.origin[i] = -0.5 * edges[i];
    }
    p->frame.volume.eval_fn = even_density;
    add_sun(&p->frame, 1, 0, -1, EX_PI);
    exact_truth(p, slab_exact);
    return 0;
}

static int build_blob(priced *p, ex_session *session) {
    const blob shape = {BLOB_WIDTH, BLOB_EXTINCTION};
    double *exact = blob_exact(session, shape, PRICE_SIZE);
    blob_frame(&p->frame, 128, PRICE_SIZE);
    p->truth.stride = 1;
    frame_copy(&p->truth.frame, &p->frame);
    for (int i = 0; i < PRICE_SIZE * PRICE_SIZE; ++i)
        for (int c = 0; c < 3; ++c) p->truth.frame.rgba[4 * i + c] = (float)exact[i];
    free(exact);
    return 0;
}

/* A ball of gas that absorbs, before white, of density (1 - r^2)^2: voxels hold that well, unlike a sharp rim, of which
   the error would be theirs at any setting. Along a ray at distance b from its middle, optical depth is
   t 16 / 15 (1 - b^2)^(5/2). */
static const double ball_extinction = 3, ball_box = 2.5;
enum { BALL_VOXELS = 96 };

static double ball_exact(const sps_particle *list, ex_vec origin, ex_vec direction) {
    const double square = fmax(1 - square_beside(origin, direction, ex_vec_of(0, 0, 0)), 0);
    (void)list;
    return exp(-ball_extinction * 16 / 15 * square * square * sqrt(square));
}

static int ball_density(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const double inside = fmax(1 - ex_dot(positions, positions), 0);
        out[i] = (float)(inside * inside);
    }
    return 0;
}

static int build_ball(priced *p, ex_session *session) {
    (void)session;
    seen_from_above(p, 2.4);
    add_gas(&p->frame, BALL_VOXELS, ball_extinction);
    for (int i = 0; i < 3; ++i) {
        p->frame.volume.albedo[i] = 0, p->frame.scene.background[i] = 1;
        p->frame.volume.placement.axis[i][i] = ball_box;
        p->frame.volume.placement.origin[i] = -0.5 * ball_box;
    }
    p->frame.volume.eval_fn = ball_density;
    p->exact = ball_exact;
    exact_truth(p, ball_exact);
    return 0;
}

/* The ground below the edge of a plate, 1 above it, under a sun that subtends 2 r = 0.06: at x it sees the segment of
   the sun's disc beyond the edge, (acos q - q sqrt(1 - q^2)) / pi of it with q = -x / tan r. A ray's cosine, which the
   ground's irradiance has, differs from 1 by r^2 / 2 at most: 0.0005 of the light. The eye is below the plate. */
static const double penumbra_half = 0.03;

static double penumbra_exact(const sps_particle *list, ex_vec origin, ex_vec direction) {
    const double x = origin.x - origin.z / direction.z * direction.x;
    const double q = fmin(fmax(-x / tan(penumbra_half), -1), 1);
    (void)list;
    return 0.5 * (acos(q) - q * sqrt(1 - q * q)) / EX_PI;
}

static int edge_read(void *user, size_t first, size_t count, sps_triangle *out) {
    static const float corners[2][4][3] = {{{-3, -3, 0}, {3, -3, 0}, {3, 3, 0}, {-3, 3, 0}},
                                           {{-3, -3, 1}, {0, -3, 1}, {0, 3, 1}, {-3, 3, 1}}};
    (void)user;
    for (size_t i = 0; i < count; ++i)
        for (size_t k = 0; k < 3; ++k) {
            const size_t n = first + i, corner = k == 0 ? 0 : n % 2 + k;
            memcpy(out[i].position[k], corners[n / 2][corner], sizeof corners[0][0]);
        }
    return 0;
}

static int build_penumbra(priced *p, ex_session *session) {
    (void)session;
    seen_from_above(p, 0.12);
    p->frame.view.camera.position[2] = 0.5;
    p->frame.scene.mesh_count = 1;
    p->frame.mesh.triangle_count = 4, p->frame.mesh.read_fn = edge_read;
    for (int c = 0; c < 3; ++c) p->frame.mesh.albedo[c] = 0.5f;
    add_sun(&p->frame, 0, 0, -1, EX_PI);
    p->frame.light.angular_diameter = 2 * penumbra_half;
    p->exact = penumbra_exact;
    exact_truth(p, penumbra_exact);
    return 0;
}

/* Forty soft particles that absorb, before white: a ray at distance b from the middle of one of radius r passes
   t (1 - (b / r)^2)^1.5 of its optical depth t, since 1 - s^2 over a chord of half length h is 4/3 h^3 of 4/3. */
enum { CHORDS = 40 };

static double chords_exact(const sps_particle *list, ex_vec origin, ex_vec direction) {
    double depth = 0;
    for (int i = 0; i < CHORDS; ++i) {
        const sps_particle *at = list + i;
        const ex_vec middle = ex_vec_of((double)at->position[0], (double)at->position[1], (double)at->position[2]);
        const double r = (double)at->radius;
        const double inside = 1 - square_beside(origin, direction, middle) / (r * r);
        if (inside > 0) depth += (double)at->optical_depth * pow(inside, 1.5);
    }
    return exp(-depth);
}

static int build_chords(priced *p, ex_session *session) {
    uint32_t random = 3;
    (void)session;
    seen_from_above(p, 2.4);
    p->kept.list = (sps_particle *)ex_allocate(CHORDS, sizeof *p->kept.list);
    for (int i = 0; i < CHORDS; ++i) {
        sps_particle *at = p->kept.list + i;
        for (int k = 0; k < 3; ++k) at->position[k] = (float)(1.6 * ex_random(&random) - 0.8);
        at->radius = (float)(0.1 + 0.3 * ex_random(&random));
        at->optical_depth = (float)(0.2 + 2 * ex_random(&random));
    }
    p->kept.particles.count = CHORDS, p->kept.particles.soft = 1;
    p->kept.particles.read_fn = ex_particles_read, p->kept.particles.user = p->kept.list;
    p->frame.scene.particles = &p->kept.particles, p->frame.scene.particle_set_count = 1;
    for (int c = 0; c < 3; ++c) p->frame.scene.background[c] = 1;
    p->exact = chords_exact;
    exact_truth(p, chords_exact);
    return 0;
}

/* ============================================================================================== references */

/* sps_reference at every stride-th pixel, in steps of that many voxels; with `samples` random paths of light that
   scatters any number of times. */
static void marched_truth(priced *p, ex_session *session, int stride, double step, int samples) {
    sampled *t = &p->truth;
    sampled_begin(t, &p->frame, stride);
    const size_t count = (size_t)t->frame.view.width * (size_t)t->frame.view.height;
    float *error = samples > 0 ? (float *)ex_allocate(3 * count, sizeof(float)) : NULL;
    const sps_reference_settings settings = {.step = step, .samples = samples, .seed = 1, .error = error};
    sps_image image = {0};
    double sum = 0;
    image.rgba = t->frame.rgba;
    ex_stop_unless_ok(sps_reference(session->context, &t->frame.scene, &t->frame.view, &settings, &image), program,
                      session);
    for (size_t i = 0; error && i < 3 * count; ++i) sum += (double)error[i] * (double)error[i];
    p->noise = sqrt(sum / (3 * (double)count));
    free(error);
}

/* The slab again, of albedo 0.99 and seen at an angle, with all light that scatters in it: random paths. */
static int build_scattering(priced *p, ex_session *session) {
    frame_begin(&p->frame, PRICE_SIZE, PRICE_SIZE);
    p->frame.scene.mesh_count = 0;
    add_gas(&p->frame, 48, 4);
    p->frame.volume.size[2] = 24;
    for (int i = 0; i < 3; ++i) {
        p->frame.volume.albedo[i] = 0.99f;
        p->frame.volume.placement.axis[i][i] = i == 2 ? 1 : 2;
        p->frame.volume.placement.origin[i] = i == 2 ? -0.5 : -1;
    }
    p->frame.volume.eval_fn = even_density;
    add_sun(&p->frame, 0.6, -0.5, -1, EX_PI);
    p->frame.view.camera.position[0] = 2, p->frame.view.camera.position[2] = 5;
    p->frame.view.camera.field_of_view = 0.5;
    p->frame.view.scattering = SPS_SCATTERING_MULTIPLE;
    marched_truth(p, session, 5, 1, 400);
    return 0;
}

static int build_smoke(priced *p, ex_session *session) {
    if (smoke_load(&p->kept.grid)) return 1;
    smoke_ground_frame(&p->frame, &p->kept.grid, PRICE_SIZE);
    marched_truth(p, session, 5, 0.5, 0);
    return 0;
}

static int build_soft_sun(priced *p, ex_session *session) {
    if (smoke_load(&p->kept.grid)) return 1;
    smoke_ground_frame(&p->frame, &p->kept.grid, PRICE_SIZE);
    p->frame.light.angular_diameter = 10 * EX_PI / 180;
    p->frame.light.samples = 0;
    marched_truth(p, session, 9, 1, 0);
    return 0;
}

static int build_scan(priced *p, ex_session *session) {
    if (bonsai_load(&p->kept.grid)) return 1;
    bonsai_frame(&p->frame, &p->kept.grid);
    frame_resize(&p->frame, PRICE_SIZE, PRICE_SIZE);
    p->frame.volume.shading = SPS_SHADING_SURFACE;
    marched_truth(p, session, 5, 0.25, 0);
    return 0;
}

/* The cloud, lit by all light that scatters in it. */
static int build_cloud(priced *p, ex_session *session) {
    static const int size[3] = {126, 86, 154};
    static const sps_lobe lobe = {0.6f, 1};
    static const double eye[3] = {1.6, 0.9, 2.6}, target[3] = {0.5, 0.32, 0.5};
    ex_error error;
    if (scan_failed(ex_scan_load(&p->kept.grid, "wdas_cloud_sixteenth_126x86x154_u16.raw", size, EX_U16, &error),
                    &error))
        return 1;
    smoke_frame(&p->frame, &p->kept.grid);
    frame_resize(&p->frame, PRICE_SIZE, PRICE_SIZE);
    p->frame.scene.mesh_count = 0;
    for (int i = 0; i < 3; ++i) {
        p->frame.volume.placement.axis[i][i] = size[i] / 154.0;
        p->frame.volume.albedo[i] = 0.99f;
        p->frame.light.color[i] = (float)EX_PI;
    }
    p->frame.volume.extinction = 60, p->frame.volume.lobes = &lobe, p->frame.volume.lobe_count = 1;
    memcpy(p->frame.view.camera.position, eye, sizeof eye);
    memcpy(p->frame.view.camera.target, target, sizeof target);
    p->frame.view.scattering = SPS_SCATTERING_MULTIPLE;
    marched_truth(p, session, 13, 2, 4800);
    return 0;
}

/* Gas over polygons on a ground two thousand times as wide, under a low sun. */
static int build_mixed(priced *p, ex_session *session) {
    static const float earth[3] = {0.5f, 0.45f, 0.4f}, brick[3] = {0.6f, 0.3f, 0.2f};
    ex_mesh *land = &p->kept.land;
    blob_frame(&p->frame, 96, PRICE_SIZE);
    ex_shape_quad(land, ex_vec_of(-2000, 0, -2000), ex_vec_of(-2000, 0, 2000), ex_vec_of(2000, 0, 2000),
                  ex_vec_of(2000, 0, -2000), earth);
    for (int i = 0; i < 5; ++i) {
        const ex_vec low = ex_vec_of(i - 2.2, 0, -0.9 + 0.45 * i);
        ex_shape_box(land, low, ex_vec_add(low, ex_vec_of(0.35, 0.6 + 0.2 * i, 0.3)), brick);
    }
    p->frame.mesh = ex_shape_mesh(land);
    p->frame.mesh.revision = 1;
    add_sun(&p->frame, -1, -0.45, -0.3, EX_PI);
    for (int c = 0; c < 3; ++c) p->frame.scene.ambient[c] = 0.1f;
    marched_truth(p, session, 5, 1, 0);
    return 0;
}

static int fog_density(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec at = ex_vec_of(2 * positions[0], 2 * positions[1], 2 * positions[2]);
        out[i] = (float)fmax(0.35 + ex_fractal(at, 3), 0);
    }
    return 0;
}

/* A lamp amid uneven fog, over a plane. */
static int build_lamp(priced *p, ex_session *session) {
    blob_frame(&p->frame, 96, PRICE_SIZE);
    p->frame.volume.eval_fn = fog_density, p->frame.volume.extinction = 1.5f;
    p->frame.light.kind = SPS_LIGHT_POINT;
    p->frame.light.position[0] = 0.2, p->frame.light.position[1] = 1.1;
    for (int c = 0; c < 3; ++c) p->frame.light.color[c] = 2;
    marched_truth(p, session, 5, 0.5, 0);
    return 0;
}

/* Temperatures of a flame: hot at the foot, flickering above. */
static int flame_temperature(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const double x = positions[0] - blob_centre[0], z = positions[2] - blob_centre[2], up = fmax(positions[1], 0);
        const double wide = 0.25 * exp(-1.5 * up), square = (x * x + z * z) / (wide * wide);
        const ex_vec at = ex_vec_of(5 * positions[0], 3 * positions[1], 5 * positions[2]);
        out[i] = (float)fmax(exp(-square - 0.8 * up) * (1 + 0.6 * ex_fractal(at, 3)), 0);
    }
    return 0;
}

/* Glows with the fourth power of the temperature, redder where it is cooler, in thin smoke. */
static int flame_look(void *user, size_t count, const float *values, sps_transfer_point *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i) {
        const float power = values[i] * values[i] * values[i] * values[i];
        for (int c = 0; c < 3; ++c) {
            out[i].albedo[c] = 0.7f;
            out[i].emission[c] = power * powf(values[i], (float)c) * (30.0f - 10.0f * (float)c);
        }
        out[i].extinction = 2 * values[i];
    }
    return 0;
}

/* A flame in its own smoke over a plane, which it lights. */
static int build_fire(priced *p, ex_session *session) {
    blob_frame(&p->frame, 64, PRICE_SIZE);
    p->frame.scene.light_count = 0;
    p->frame.volume.eval_fn = flame_temperature;
    p->kept.transfer.eval_fn = flame_look, p->kept.transfer.value_max = 1.6f;
    p->frame.volume.transfer = &p->kept.transfer;
    p->frame.view.scattering = SPS_SCATTERING_MULTIPLE;
    marched_truth(p, session, 9, 1, 1200);
    return 0;
}

/* Three labels in layers; the middle one is not shown. */
static int read_layers(void *user, const int lo[3], const int size[3], float *out) {
    (void)user;
    for (int z = lo[2]; z < lo[2] + size[2]; ++z)
        for (int y = lo[1]; y < lo[1] + size[1]; ++y)
            for (int x = lo[0]; x < lo[0] + size[0]; ++x) {
                const double r =
                    sqrt(pow(x - 31.5, 2) + pow(y - 31.5, 2) + pow(z - 31.5, 2)) + 3 * sin(0.3 * x) * cos(0.4 * y);
                *out++ = r < 10 ? 1 : r < 14 ? 2 : r < 24 && x + z > 50 ? 3 : 0;
            }
    return 0;
}

static int build_labels(priced *p, ex_session *session) {
    static const sps_transfer_point looks[] = {
        {0.4f, {0.8f, 0.3f, 0.2f}, 0, {0, 0, 0}},  {0.6f, {0.8f, 0.3f, 0.2f}, 60, {0, 0, 0}},
        {1.4f, {0.8f, 0.3f, 0.2f}, 60, {0, 0, 0}}, {1.6f, {0.3f, 0.6f, 0.9f}, 0, {0, 0, 0}},
        {2.4f, {0.3f, 0.6f, 0.9f}, 0, {0, 0, 0}},  {2.6f, {0.3f, 0.6f, 0.9f}, 25, {0, 0, 0}}};
    blob_frame(&p->frame, 64, PRICE_SIZE);
    p->frame.volume.eval_fn = NULL, p->frame.volume.read_fn = read_layers;
    p->kept.transfer.points = looks, p->kept.transfer.point_count = 6;
    p->frame.volume.transfer = &p->kept.transfer, p->frame.volume.classify_voxels = 1;
    p->frame.volume.shading = SPS_SHADING_SURFACE;
    marched_truth(p, session, 5, 0.25, 0);
    return 0;
}

/* =================================================================================================== scenes */

typedef struct price_scene {
    const char *name, *truth, *file;
    int (*build)(priced *p, ex_session *session); /* returns non-zero if it needs data that is not there */
    int is_asset;
} price_scene;

static const price_scene price_scenes[] = {
    {"Slab", "closed form", "slab", build_slab, 0},
    {"Blob over a plane", "closed form", "blob", build_blob, 0},
    {"Ball", "closed form", "ball", build_ball, 0},
    {"Penumbra of an edge", "closed form", "penumbra", build_penumbra, 0},
    {"Slab that scatters", "random paths", "scattering", build_scattering, 0},
    {"Chords of particles", "closed form", "chords", build_chords, 0},
    {"Flame over a plane", "random paths", "fire", build_fire, 0},
    {"Labels", "sps_reference", "labels", build_labels, 0},
    {"Cloud", "random paths", "cloud", build_cloud, 1},
    {"Smoke over a ground", "sps_reference", "smoke", build_smoke, 1},
    {"Bonsai, a surface", "sps_reference", "bonsai", build_scan, 1},
    {"Gas, boxes and a ground of 4000", "sps_reference", "mixed", build_mixed, 1},
    {"Smoke under a sun of 10 degrees", "sps_reference", "soft_sun", build_soft_sun, 1},
    {"Lamp in fog", "sps_reference", "lamp", build_lamp, 1},
};
enum { PRICE_SCENES = sizeof price_scenes / sizeof *price_scenes, PRICE_ASSETS = 6 };

static void priced_end(priced *p) {
    frame_end(&p->frame);
    sampled_end(&p->truth);
    free(p->kept.list);
    if (p->kept.grid.data) ex_grid_free(&p->kept.grid);
    ex_mesh_free(&p->kept.land);
}

#endif /* PRICE_SCENES_H */
