/* bench_scenes.h: what bench.c measures: frames and races between them, its scenes, and errors of its pictures. Include
   after measuring.h, particles.h and scans.h. */

#ifndef BENCH_SCENES_H
#define BENCH_SCENES_H

#ifndef BENCH_PROGRAM
#define BENCH_PROGRAM "bench" /* the name of who measures */
#endif
static const char program[] = BENCH_PROGRAM;

#define REPEATS 5 /* frames timed of each contender */
#define WORKERS 2 /* that the targets speak of */

/* ================================================================================================== frames */

/* A scene of one volume, one mesh and one light at most, in which light scatters once, as closed forms and the
   reference without paths have it. Stays where it is: the scene points into it. */
typedef struct frame {
    sps_volume volume;
    sps_mesh mesh;
    sps_light light;
    sps_scene scene;
    sps_view view;
    float *rgba;
} frame;

static inline void frame_begin(frame *f, int width, int height) {
    memset(f, 0, sizeof *f);
    f->scene.volumes = &f->volume, f->scene.volume_count = 1;
    f->scene.meshes = &f->mesh, f->scene.mesh_count = 1;
    f->scene.lights = &f->light, f->scene.light_count = 1;
    f->view.width = width, f->view.height = height;
    f->view.quality = SPS_QUALITY_MEDIUM;
    f->view.scattering = SPS_SCATTERING_SINGLE;
    f->view.camera.up[1] = 1;
    f->rgba = (float *)ex_allocate((size_t)width * (size_t)height, 4 * sizeof(float));
}

/* The same frame with a picture of its own. */
static inline void frame_copy(frame *f, const frame *from) {
    *f = *from;
    f->scene.volumes = &f->volume, f->scene.meshes = &f->mesh, f->scene.lights = &f->light;
    f->rgba = (float *)ex_allocate((size_t)f->view.width * (size_t)f->view.height, 4 * sizeof(float));
}

/* Another size; what was rendered is lost. */
static inline void frame_resize(frame *f, int width, int height) {
    free(f->rgba);
    f->view.width = width, f->view.height = height;
    f->rgba = (float *)ex_allocate((size_t)width * (size_t)height, 4 * sizeof(float));
}

static inline void frame_end(frame *f) { free(f->rgba); }

static inline double render_seconds(ex_session *session, const frame *f, const sps_view *view) {
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = f->rgba;
    const double start = ex_now(NULL);
    ex_stop_unless_ok(sps_render(session->context, &f->scene, view, &image), program, session);
    return ex_now(NULL) - start;
}

/* sps_reference, without light that scatters more than once. */
static inline sps_result march(ex_session *session, const frame *f, double step, const sps_image *image) {
    const sps_reference_settings settings = {.step = step};
    return sps_reference(session->context, &f->scene, &f->view, &settings, image);
}

/* Its seconds with that many paths a pixel, into the frame's picture; 0: only marches light that scatters once. */
static inline double walk_seconds(ex_session *session, frame *f, int samples, float *error) {
    const sps_reference_settings settings = {.step = 0.5, .seed = 1, .samples = samples, .error = error};
    const double start = ex_now(NULL);
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = f->rgba;
    ex_stop_unless_ok(sps_reference(session->context, &f->scene, &f->view, &settings, &image), program, session);
    return ex_now(NULL) - start;
}

/* A way to render a frame that is timed against others. */
typedef struct contender {
    ex_session *session;
    const frame *frame;
    sps_view view;
    double *moving;     /* a coordinate that moves a little before each frame; may be NULL */
    sps_light *turning; /* lights that turn a little, so that their tables are made anew; may be NULL */
    int turning_count;
    double orbit;   /* radians that the camera turns about its target before each frame */
    int fresh;      /* each frame has a context of its own; its making is not timed */
    double seconds; /* median */
    sps_stats_report stats;
} contender;

static inline void contender_set(contender *c, ex_session *session, const frame *f, int no_shadows) {
    memset(c, 0, sizeof *c);
    c->session = session, c->frame = f, c->view = f->view;
    c->view.no_shadows = no_shadows;
}

static inline void camera_orbit(sps_camera *camera, double angle) {
    const double x = camera->position[0] - camera->target[0], z = camera->position[2] - camera->target[2];
    camera->position[0] = camera->target[0] + cos(angle) * x + sin(angle) * z;
    camera->position[2] = camera->target[2] + cos(angle) * z - sin(angle) * x;
}

/* What changes before each frame. */
static inline void contender_advance(contender *c) {
    const int workers = c->session->pool.worker_count;
    if (c->moving) *c->moving += 1e-3;
    for (int k = 0; c->turning && k < c->turning_count; ++k) c->turning[k].direction[0] += 1e-3;
    if (c->orbit > 0) camera_orbit(&c->view.camera, c->orbit);
    if (!c->fresh) return;
    ex_session_end(c->session);
    ex_session_measure(c->session, program, workers);
}

/* Times all in turns, so that whatever else the machine does falls on each alike; the first round only warms up. */
static inline void race(contender *contenders, int count, int repeats) {
    double *seconds = (double *)ex_allocate((size_t)(count * repeats), sizeof *seconds);
    for (int r = -1; r < repeats; ++r)
        for (int i = 0; i < count; ++i) {
            contender *c = contenders + i;
            contender_advance(c);
            const double took = render_seconds(c->session, c->frame, &c->view);
            if (r >= 0) seconds[i * repeats + r] = took;
            sps_get_stats(c->session->context, &c->stats);
        }
    for (int i = 0; i < count; ++i) contenders[i].seconds = ex_percentile(seconds + i * repeats, (size_t)repeats, 0.5);
    free(seconds);
}

/* What a first frame takes to read, classify and store voxels: the median of new contexts. */
static inline double reading_seconds(const frame *f) {
    enum { ROUNDS = 5 };
    double seconds[ROUNDS];
    for (int r = 0; r < ROUNDS; ++r) {
        ex_session session;
        sps_stats_report stats;
        ex_session_measure(&session, program, WORKERS);
        render_seconds(&session, f, &f->view);
        sps_get_stats(session.context, &stats);
        seconds[r] = stats.seconds_gather;
        ex_session_end(&session);
    }
    return ex_percentile(seconds, ROUNDS, 0.5);
}

static inline double fragments_per_second(const sps_stats_report *stats) {
    return (double)(stats->light_fragments + stats->eye_fragments) / (stats->seconds_light + stats->seconds_eye);
}

static inline void print_stages(const sps_stats_report *s) {
    printf("    of %.3f s: read voxels %.3f, polygons %.3f, shadow rays %.3f, sort %.3f, light sheets %.3f, eye sheets "
           "and shading %.3f\n",
           s->seconds_total, s->seconds_gather, s->seconds_polygons, s->seconds_shadow_rays, s->seconds_bin,
           s->seconds_light, s->seconds_eye);
    printf("    light: %.1f M fragments; eye: %.1f M fragments, %.1f M pixels of slabs shaded\n",
           1e-6 * (double)s->light_fragments, 1e-6 * (double)s->eye_fragments, 1e-6 * (double)s->pixels_shaded);
    printf("    light: %.1f M samples; eye: %.1f M samples\n", 1e-6 * (double)s->light_samples,
           1e-6 * (double)s->eye_samples);
}

/* =================================================================================================== errors */

/* The root mean square difference of the colors of two frames. */
static inline double frames_rms(const frame *a, const frame *b) {
    const size_t count = 4 * (size_t)a->view.width * (size_t)a->view.height;
    double sum = 0;
    for (size_t i = 0; i < count; ++i)
        if (i % 4 != 3) sum += pow((double)a->rgba[i] - (double)b->rgba[i], 2);
    return sqrt(sum / (0.75 * (double)count));
}

/* Mean radiance. */
static inline double frame_mean(const frame *f) {
    const size_t count = 4 * (size_t)f->view.width * (size_t)f->view.height;
    double sum = 0;
    for (size_t i = 0; i < count; ++i)
        if (i % 4 != 3) sum += (double)f->rgba[i];
    return sum / (0.75 * (double)count);
}

/* A part of a square frame's pixels by sps_reference: every stride-th in each direction. */
typedef struct sampled {
    int stride;
    frame frame; /* these pixels alone */
} sampled;

/* The stride must be odd, and an even number of these pixels is taken about the middle: then a smaller picture of a
   camera with a smaller angle has its pixels' centres where the frame has them. */
static inline void sampled_begin(sampled *t, const frame *f, int stride) {
    const int side = f->view.width / stride / 2 * 2;
    const double share = side * stride / (double)f->view.width;
    t->stride = stride;
    frame_copy(&t->frame, f);
    frame_resize(&t->frame, side, side);
    t->frame.view.camera.field_of_view = 2 * atan(share * tan(0.5 * f->view.camera.field_of_view));
    t->frame.view.camera.ortho_height *= share;
}

static inline void sampled_march(sampled *t, ex_session *session, const frame *f, int stride, double step) {
    sps_image image;
    memset(&image, 0, sizeof image);
    sampled_begin(t, f, stride);
    image.rgba = t->frame.rgba;
    ex_stop_unless_ok(march(session, &t->frame, step, &image), program, session);
}

static inline void sampled_end(sampled *t) { frame_end(&t->frame); }

/* The root mean square error in radiance, over red, green and blue. */
static inline double sampled_error(const sampled *t, const frame *f) {
    const int side = t->frame.view.width, first = (f->view.width - (side - 1) * t->stride - 1) / 2;
    double sum = 0;
    for (int i = 0; i < side * side; ++i) {
        const int x = first + i % side * t->stride, y = first + i / side * t->stride;
        const float *pixel = f->rgba + 4 * ((size_t)y * (size_t)f->view.width + (size_t)x);
        for (int c = 0; c < 3; ++c) sum += pow((double)pixel[c] - (double)t->frame.rgba[4 * i + c], 2);
    }
    return sqrt(sum / (3.0 * side * side));
}

/* ================================================================================================== bonsai */

/* Hands on whether loading a scan has failed, and says why. */
static inline int scan_failed(int failed, const ex_error *error) {
    if (failed) printf("  left out: %s\n", error->text);
    return failed;
}

static inline int bonsai_load(ex_grid *grid) {
    ex_error error;
    return scan_failed(ex_bonsai_load(grid, &error), &error);
}

static inline void bonsai_frame(frame *f, ex_grid *grid) {
    static const double eye[3] = {2.2, 2.6, 4.6}, target[3] = {0, 0.95, 0}, light[3] = {-1, -1.6, -0.6};
    frame_begin(f, 512, 512);
    ex_bonsai_volume(&f->volume, grid);
    f->volume.revision = 1;
    memcpy(f->light.direction, light, sizeof light);
    for (int i = 0; i < 3; ++i) f->light.color[i] = 2.5f - 0.1f * (float)i, f->scene.ambient[i] = 0.25f;
    memcpy(f->view.camera.position, eye, sizeof eye);
    memcpy(f->view.camera.target, target, sizeof target);
    f->view.camera.field_of_view = 34 * EX_PI / 180;
}

/* =================================================================================================== smoke */

static inline int smoke_load(ex_grid *grid) {
    static const int size[3] = {111, 222, 112};
    ex_error error;
    return scan_failed(ex_scan_load(grid, "smoke_openvdb_111x222x112_u16.raw", size, EX_U16, &error), &error);
}

static inline void smoke_frame(frame *f, ex_grid *grid) {
    static const double eye[3] = {1.6, 1.6, 5.2}, target[3] = {0.5, 0.95, 0.5}, light[3] = {-1, -1.3, -0.5};
    frame_begin(f, 288, 480);
    memcpy(f->volume.size, grid->size, sizeof f->volume.size);
    for (int i = 0; i < 3; ++i) {
        f->volume.placement.axis[i][i] = grid->size[i] / 111.0;
        f->volume.albedo[i] = 0.87f, f->light.color[i] = 6;
    }
    f->volume.read_fn = ex_grid_read, f->volume.range_fn = ex_grid_range, f->volume.user = grid;
    f->volume.concurrent = 1;
    f->volume.revision = 2;
    f->volume.extinction = 300;
    memcpy(f->light.direction, light, sizeof light);
    memcpy(f->view.camera.position, eye, sizeof eye);
    memcpy(f->view.camera.target, target, sizeof target);
    f->view.camera.field_of_view = 30 * EX_PI / 180;
}

/* =============================================================================================== particles */

/* Particles evenly spread in a ball of radius 1, each a few texels wide. */
static inline sps_particle *puff_build(size_t count) {
    sps_particle *list = (sps_particle *)ex_allocate(count, sizeof *list);
    uint32_t random = 7;
    for (size_t i = 0; i < count;) {
        double at[4];
        for (int k = 0; k < 4; ++k) at[k] = 2 * ex_random(&random) - 1;
        if (ex_dot(at, at) > 1) continue;
        for (int k = 0; k < 3; ++k) list[i].position[k] = (float)at[k];
        list[i].radius = (float)(0.02 + 0.01 * at[3]);
        list[i++].optical_depth = 0.05f;
    }
    return list;
}

/* A million of them, or fewer, 1024 x 768; the caller frees particles->user. Stays where it is, as a frame does. */
static inline void particles_frame(frame *f, sps_particles *particles, size_t count) {
    sps_particle *list = puff_build(count);
    for (size_t i = 0; i < count && count > 500000; ++i) list[i].radius *= 0.5f;
    memset(particles, 0, sizeof *particles);
    particles->count = count, particles->read_fn = ex_particles_read, particles->user = list;
    frame_begin(f, 1024, 768);
    f->scene.volume_count = f->scene.mesh_count = 0;
    f->scene.particles = particles, f->scene.particle_set_count = 1;
    f->view.camera.position[2] = 4, f->view.camera.field_of_view = 0.6;
    for (int i = 0; i < 3; ++i) f->light.direction[i] = -1, f->light.color[i] = 3, particles->albedo[i] = 0.8f;
}

/* ============================================================================== a blob over a plane, exactly */

/* A Gaussian blob of gas that scatters all light evenly, over a plane of reflectance 1/2. For such a blob the optical
   depth along any line is an error function, so that a pixel is one integral of a smooth function. */
#define BLOB_WIDTH      0.35 /* standard deviation */
#define BLOB_EXTINCTION 4.0  /* at its middle */
#define BLOB_LEAST      1e-4 /* below this share of its middle the blob's grid is empty */
#define BLOB_BOX        9.0  /* edge of the grid, in widths */
#define BLOB_NODES      32   /* of the quadrature; 48 change no pixel by 1e-7 */
#define BLOB_SIZE       512  /* pixels */

static const double blob_centre[3] = {0, 1.2, 0}, blob_eye[3] = {0, 4.5, 10}, blob_target[3] = {0, 0.8, 0};
static const double blob_light[3] = {-0.70710678118654752, -0.70710678118654752, 0}; /* irradiance pi */

typedef struct blob {
    double width, middle; /* standard deviation; extinction there */
} blob;

/* What the voxels' kernels make of the blob: a Gaussian of the sum of the variances and of the same mass. */
static inline blob blob_through_kernels(int grid) {
    const double kernel = 0.65 * BLOB_BOX * BLOB_WIDTH / grid;
    blob b;
    b.width = sqrt(BLOB_WIDTH * BLOB_WIDTH + kernel * kernel);
    b.middle = BLOB_EXTINCTION * pow(BLOB_WIDTH / b.width, 3);
    return b;
}

/* Optical depth along a line at squared distance `apart` from the middle, from s0 to s1 counted from the foot. */
static inline double blob_depth(const blob *b, double apart, double s0, double s1) {
    const double across = exp(-0.5 * apart / (b->width * b->width)), unit = 1 / (b->width * sqrt(2.0));
    return b->middle * b->width * sqrt(0.5 * EX_PI) * across * (erf(s1 * unit) - erf(s0 * unit));
}

/* Light that is left at a point, of what would arrive without the blob. */
static inline double blob_lit(const blob *b, const double point[3]) {
    double from[3];
    for (int i = 0; i < 3; ++i) from[i] = point[i] - blob_centre[i];
    const double along = ex_dot(from, blob_light);
    return exp(-blob_depth(b, ex_dot(from, from) - along * along, -1e3, along));
}

/* Gauss-Legendre nodes and weights on -1..1, by Newton's method on the recurrence. */
static inline void legendre_nodes(int count, double *nodes, double *weights) {
    for (int i = 0; i < count; ++i) {
        double x = cos(EX_PI * (i + 0.75) / (count + 0.5)), slope = 1;
        for (int step = 0; step < 20; ++step) {
            double before = 1, now = x;
            for (int k = 2; k <= count; ++k) {
                const double next = ((2 * k - 1) * x * now - (k - 1) * before) / k;
                before = now, now = next;
            }
            slope = count * (x * now - before) / (x * x - 1);
            x -= now / slope;
        }
        nodes[i] = x, weights[i] = 2 / ((1 - x * x) * slope * slope);
    }
}

typedef struct blob_task {
    blob shape;
    double nodes[BLOB_NODES], weights[BLOB_NODES], rows[3][3]; /* right, down, forward */
    int size;
    double *image;
} blob_task;

static inline void blob_point(const double direction[3], double t, double point[3]) {
    for (int i = 0; i < 3; ++i) point[i] = blob_eye[i] + t * direction[i];
}

static inline double blob_radiance(const blob_task *task, const double direction[3]) {
    const blob *b = &task->shape;
    double middle[3], point[3], sum = 0;
    for (int i = 0; i < 3; ++i) middle[i] = blob_centre[i] - blob_eye[i];
    const double foot = ex_dot(middle, direction), apart = ex_dot(middle, middle) - foot * foot;
    const double plane = direction[1] < 0 ? -blob_eye[1] / direction[1] : HUGE_VAL;
    const double t0 = foot - 6.5 * b->width, t1 = fmin(foot + 6.5 * b->width, plane);
    for (int i = 0; i < BLOB_NODES && t1 > t0; ++i) {
        const double t = t0 + 0.5 * (1 + task->nodes[i]) * (t1 - t0), s = t - foot;
        const double here = b->middle * exp(-0.5 * (apart + s * s) / (b->width * b->width));
        if (here < 1e-9) continue;
        blob_point(direction, t, point);
        sum += 0.5 * (t1 - t0) * task->weights[i] * 0.25 * here * blob_lit(b, point) *
               exp(-blob_depth(b, apart, -foot, s)); /* 0.25: pi / (4 pi) */
    }
    if (!(plane < HUGE_VAL)) return sum;
    blob_point(direction, plane, point);
    return sum + 0.5 * -blob_light[1] * blob_lit(b, point) * exp(-blob_depth(b, apart, -foot, plane - foot));
}

static inline void blob_row(void *data, int y, int worker) {
    const blob_task *task = (const blob_task *)data;
    const double pitch = 2 * tan(13 * EX_PI / 180) / task->size;
    (void)worker;
    for (int x = 0; x < task->size; ++x) {
        const double across = pitch * (x - 0.5 * (task->size - 1)), down = pitch * (y - 0.5 * (task->size - 1));
        double direction[3];
        for (int i = 0; i < 3; ++i)
            direction[i] = across * task->rows[0][i] + down * task->rows[1][i] + task->rows[2][i];
        const double length = sqrt(ex_dot(direction, direction));
        for (int i = 0; i < 3; ++i) direction[i] /= length;
        task->image[(size_t)y * (size_t)task->size + (size_t)x] = blob_radiance(task, direction);
    }
}

/* The exact image; freed by the caller. The camera looks along -z and down, so that its right is x. */
static inline double *blob_exact(ex_session *session, blob shape, int size) {
    blob_task task;
    const double dy = blob_target[1] - blob_eye[1], dz = blob_target[2] - blob_eye[2], length = sqrt(dy * dy + dz * dz);
    const double rows[3][3] = {{1, 0, 0}, {0, dz / length, -dy / length}, {0, dy / length, dz / length}};
    task.shape = shape, task.size = size;
    memcpy(task.rows, rows, sizeof rows);
    legendre_nodes(BLOB_NODES, task.nodes, task.weights);
    task.image = (double *)ex_allocate((size_t)size * (size_t)size, sizeof(double));
    ex_parallel_for(&session->pool, size, blob_row, &task);
    return task.image;
}

/* ============================================================================= ... and as the library has it */

static inline int blob_density(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        double square = 0;
        for (int k = 0; k < 3; ++k) square += (positions[k] - blob_centre[k]) * (positions[k] - blob_centre[k]);
        const double value = exp(-0.5 * square / (BLOB_WIDTH * BLOB_WIDTH));
        out[i] = value < BLOB_LEAST ? 0 : (float)value;
    }
    return 0;
}

static inline int plane_read(void *user, size_t first, size_t count, sps_triangle *out) {
    static const float corners[4][3] = {{-30, 0, -30}, {30, 0, -30}, {30, 0, 30}, {-30, 0, 30}};
    (void)user;
    for (size_t i = 0; i < count; ++i)
        for (size_t k = 0; k < 3; ++k)
            memcpy(out[i].position[k], corners[k == 0 ? 0 : first + i + k], sizeof corners[0]);
    return 0;
}

static inline void blob_frame(frame *f, int grid, int size) {
    frame_begin(f, size, size);
    for (int i = 0; i < 3; ++i) {
        f->volume.size[i] = grid;
        f->volume.placement.origin[i] = blob_centre[i] - 0.5 * BLOB_BOX * BLOB_WIDTH;
        f->volume.placement.axis[i][i] = BLOB_BOX * BLOB_WIDTH;
        f->volume.albedo[i] = 1, f->mesh.albedo[i] = 0.5f, f->light.color[i] = (float)EX_PI;
    }
    f->volume.eval_fn = blob_density, f->volume.concurrent = 1, f->volume.revision = 1;
    f->volume.extinction = (float)BLOB_EXTINCTION;
    f->mesh.triangle_count = 2, f->mesh.read_fn = plane_read;
    memcpy(f->light.direction, blob_light, sizeof blob_light);
    memcpy(f->view.camera.position, blob_eye, sizeof blob_eye);
    memcpy(f->view.camera.target, blob_target, sizeof blob_target);
    f->view.camera.field_of_view = 26 * EX_PI / 180;
}

/* Root mean square, and if asked for the 99th percentile, of the differences in radiance. */
static inline double image_error(const float *rgba, const double *exact, int size, double *high) {
    const size_t count = (size_t)size * (size_t)size;
    double *differences = (double *)ex_allocate(count, sizeof(double)), sum = 0;
    for (size_t i = 0; i < count; ++i) {
        differences[i] = fabs((double)rgba[4 * i] - exact[i]);
        sum += differences[i] * differences[i];
    }
    if (high) *high = ex_percentile(differences, count, 0.99);
    free(differences);
    return sqrt(sum / (double)count);
}

/* ======================================================================================= a box full of gas */

static inline int full_density(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3)
        out[i] = (float)(1.2 + sin(7 * positions[0]) * sin(5 * positions[1]) * sin(6 * positions[2]));
    return 0;
}

static inline void full_frame(frame *f, int size) {
    blob_frame(f, 256, size);
    f->volume.eval_fn = full_density, f->volume.concurrent = 1, f->volume.extinction = 0.3f;
    f->scene.mesh_count = 0;
}

/* ==================================================================================== the smoke over a ground */

static inline void smoke_ground_frame(frame *f, ex_grid *grid, int size) {
    smoke_frame(f, grid);
    frame_resize(f, size, size);
    f->mesh.triangle_count = 2, f->mesh.read_fn = plane_read;
    for (int i = 0; i < 3; ++i) f->mesh.albedo[i] = 0.4f, f->scene.ambient[i] = 0.1f;
}

#endif /* BENCH_SCENES_H */
