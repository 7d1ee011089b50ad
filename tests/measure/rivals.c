/* rivals: renders the scenes of `make rivals`, finds their true pictures by brute force, and compares pictures of other
   renderers with these. tests/measure/rivals.sh calls it.
   rivals prepare SCENE FOLDER        writes what other renderers read: voxels, polygons, numbers
   rivals truth SCENE FOLDER          writes the true pixels, truth.txt
   rivals ours SCENE GRADE SIZE FILE  renders by the library at a grade 0..3, writes a PFM
   rivals time COMMAND...             runs a command, some times if it is short; prints seconds and peak megabytes
   rivals page FOLDER RESULTS TRUTHS  prints the tables, and draws rivals_curves.png and rivals_pictures.png
   With SPLATSHADOW_DATA=folder, where the scans lie; a scene that needs one exits with 3 without it. */

#define _DEFAULT_SOURCE /* getrusage */
#define BENCH_PROGRAM   "rivals"
#include "measuring.h"
#include "particles.h"
#include "scans.h"
#include "shapes.h"
#include "picture.h"
#include "chart.h"
#include "bench_scenes.h"

#include <sys/resource.h>
#include <sys/wait.h>

enum { SIZE = 256, NO_DATA = 3, GRADES = 4 };

/* ================================================================================================== scenes */

/* What is rendered. Stays where it is, as a frame does. */
typedef struct contest {
    const char *name, *title;
    int (*build)(struct contest *c); /* returns non-zero if it needs data that is not there */
    int stride, paths;               /* of the true pixels; paths per pixel where light scatters again */
    double step;                     /* along their rays, in voxels */
    frame frame;
    ex_grid grid;
    ex_mesh land;
} contest;

/* A ground of 60 x 60 at y = 0, the first two triangles of every scene that has polygons. */
static void add_ground(contest *c, float reflectance) {
    const float color[3] = {reflectance, reflectance, reflectance};
    ex_shape_quad(&c->land, ex_vec_of(-30, 0, -30), ex_vec_of(-30, 0, 30), ex_vec_of(30, 0, 30), ex_vec_of(30, 0, -30),
                  color);
}

/* Polygons are flat: not every renderer interpolates normals in the same way. */
static void use_land(contest *c) {
    c->frame.mesh = ex_shape_mesh(&c->land);
    c->frame.mesh.has_normals = 0, c->frame.mesh.revision = 1;
    c->frame.scene.mesh_count = c->land.triangle_count > 0;
}

static int build_blob(contest *c) {
    blob_frame(&c->frame, 128, SIZE);
    add_ground(c, 0.5f);
    use_land(c);
    return 0;
}

/* The smoke, without ambient light, which not every renderer has. */
static int build_smoke_alone(contest *c) {
    if (smoke_load(&c->grid)) return 1;
    smoke_frame(&c->frame, &c->grid);
    frame_resize(&c->frame, SIZE, SIZE);
    c->frame.scene.mesh_count = 0;
    return 0;
}

static int build_smoke(contest *c) {
    if (build_smoke_alone(c)) return 1;
    add_ground(c, 0.4f);
    use_land(c);
    return 0;
}

static int build_soft_sun(contest *c) {
    if (build_smoke(c)) return 1;
    c->frame.light.angular_diameter = 10 * EX_PI / 180;
    return 0;
}

static ex_vec ring_point(const void *shape, double u, double v) {
    const double around = 2 * EX_PI * u, across = 2 * EX_PI * v, r = 0.75 + 0.22 * cos(across);
    const double flat[3] = {r * cos(around), r * sin(around), 0.22 * sin(across)};
    (void)shape; /* upright, turned and leaning */
    return ex_vec_of(0.8 * flat[0] + 0.6 * flat[2], 1.02 + 0.96 * flat[1] + 0.28 * flat[2],
                     -0.6 * flat[0] + 0.77 * flat[2] - 0.27 * flat[1]);
}

/* Uneven fog in a box about the ring, that ends softly: other renderers know no voxel that ends abruptly. */
static int ring_fog(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec at = ex_vec_of(2 * positions[0], 2 * positions[1], 2 * positions[2]);
        double inside = 1;
        for (int k = 0; k < 3; ++k) {
            const double from = (positions[k] - blob_centre[k]) / (0.5 * BLOB_BOX * BLOB_WIDTH);
            inside *= fmax(1 - pow(from, 4), 0);
        }
        out[i] = (float)(inside * fmax(0.35 + ex_fractal(at, 3), 0));
    }
    return 0;
}

static int build_ring(contest *c) {
    static const float stone[3] = {0.7f, 0.7f, 0.7f};
    blob_frame(&c->frame, 96, SIZE);
    c->frame.volume.eval_fn = ring_fog, c->frame.volume.extinction = 1.2f;
    c->frame.light.direction[2] = -0.5;
    add_ground(c, 0.5f);
    ex_shape_surface(&c->land, ring_point, NULL, 48, 24, stone, NULL);
    use_land(c);
    return 0;
}

static int build_cloud(contest *c) {
    static const int size[3] = {126, 86, 154};
    static const sps_lobe lobe = {0.6f, 1};
    static const double eye[3] = {1.6, 0.9, 2.6}, target[3] = {0.5, 0.32, 0.5};
    ex_error error;
    if (scan_failed(ex_scan_load(&c->grid, "wdas_cloud_sixteenth_126x86x154_u16.raw", size, EX_U16, &error), &error))
        return 1;
    smoke_frame(&c->frame, &c->grid);
    frame_resize(&c->frame, SIZE, SIZE);
    c->frame.scene.mesh_count = 0;
    for (int i = 0; i < 3; ++i) {
        c->frame.volume.placement.axis[i][i] = size[i] / 154.0;
        c->frame.volume.albedo[i] = 0.99f, c->frame.light.color[i] = (float)EX_PI;
    }
    c->frame.volume.extinction = 60, c->frame.volume.lobes = &lobe, c->frame.volume.lobe_count = 1;
    memcpy(c->frame.view.camera.position, eye, sizeof eye);
    memcpy(c->frame.view.camera.target, target, sizeof target);
    c->frame.view.scattering = SPS_SCATTERING_MULTIPLE;
    return 0;
}

/* The look that a viewer without shadows gives to a scan: each point sends its color, as ambient light of 1 makes it.
 */
static int build_scan(contest *c) {
    if (bonsai_load(&c->grid)) return 1;
    bonsai_frame(&c->frame, &c->grid);
    frame_resize(&c->frame, SIZE, SIZE);
    c->frame.scene.mesh_count = c->frame.scene.light_count = 0;
    for (int i = 0; i < 3; ++i) c->frame.scene.ambient[i] = 1;
    return 0;
}

static contest contests[] = {
    {.name = "blob", .title = "Blob over a plane", .build = build_blob, .stride = 1},
    {.name = "smoke", .title = "Smoke over a ground", .build = build_smoke, .stride = 5, .step = 0.125},
    {.name = "alone", .title = "The same smoke before black", .build = build_smoke_alone, .stride = 5, .step = 0.125},
    {.name = "ring", .title = "A mesh in fog", .build = build_ring, .stride = 5, .step = 0.0625},
    {.name = "sun", .title = "Smoke under a sun of 10 degrees", .build = build_soft_sun, .stride = 7, .step = 0.25},
    {.name = "cloud", .title = "A cloud, all orders of scattering", .build = build_cloud, .stride = 15, .paths = 40000},
    {.name = "scan", .title = "A scan, without shadows", .build = build_scan, .stride = 5, .step = 0.03125},
};
enum { CONTESTS = sizeof contests / sizeof *contests };

static void contest_end(contest *c) {
    frame_end(&c->frame);
    if (c->grid.data) ex_grid_free(&c->grid);
    ex_mesh_free(&c->land);
}

/* =================================================================================================== field */

/* A finer grid, for other renderers. */
typedef struct fine_grid {
    int size[3];
    double corner[3], edge; /* the middle of the first voxel */
    float *values;
} fine_grid;

/* The voxels' kernels, summed up at any point. Voxels have a rim of zeros, so that no sum leaves the array. */
enum { TAPS = 6, RIM = 8 };

typedef struct field {
    const fine_grid *instead;      /* NULL; otherwise the field is what others interpolate in this grid */
    int size[3];                   /* with the rim */
    double corner[3], edge, sigma; /* the middle of voxel (0,0,0); the edge of a voxel; kernels' width in voxels */
    double *voxels;
    unsigned char *near; /* of each voxel: whether a sum of which it is the lower middle is above 0 */
    double most;         /* voxel */
} field;

static size_t field_place(const field *f, int x, int y, int z) {
    return ((size_t)z * (size_t)f->size[1] + (size_t)y) * (size_t)f->size[0] + (size_t)x;
}

/* One row of the frame's voxels. */
static void read_row(const sps_volume *v, int y, int z, float *row) {
    const int at[3] = {0, y, z}, size[3] = {v->size[0], 1, 1};
    double *centres = (double *)ex_allocate((size_t)v->size[0], 3 * sizeof(double));
    for (int x = 0; x < v->size[0]; ++x)
        for (int k = 0; k < 3; ++k) {
            const double place = (k == 0 ? x : at[k]) + 0.5;
            centres[3 * x + k] = v->placement.origin[k] + v->placement.axis[k][k] * place / v->size[k];
        }
    memset(row, 0, (size_t)v->size[0] * sizeof *row);
    if (v->eval_fn)
        v->eval_fn(v->user, (size_t)v->size[0], centres, row);
    else
        v->read_fn(v->user, at, size, row);
    free(centres);
}

static void mark_near(field *f, int x, int y, int z) {
    for (int k = -TAPS / 2; k < TAPS / 2; ++k)
        for (int j = -TAPS / 2; j < TAPS / 2; ++j)
            for (int i = -TAPS / 2; i < TAPS / 2; ++i) f->near[field_place(f, x + i, y + j, z + k)] = 1;
}

static void field_begin(field *f, const sps_volume *v, double sigma) {
    memset(f, 0, sizeof *f);
    f->sigma = sigma, f->edge = v->placement.axis[0][0] / v->size[0];
    for (int k = 0; k < 3; ++k) {
        f->size[k] = v->size[k] + 2 * RIM;
        f->corner[k] = v->placement.origin[k] + (0.5 - RIM) * f->edge;
    }
    const size_t count = field_place(f, 0, 0, f->size[2]);
    float *row = (float *)ex_allocate((size_t)v->size[0], sizeof *row);
    f->voxels = (double *)ex_allocate(count, sizeof(double));
    f->near = (unsigned char *)ex_allocate(count, 1);
    for (int z = 0; z < v->size[2]; ++z)
        for (int y = 0; y < v->size[1]; ++y) {
            read_row(v, y, z, row);
            for (int x = 0; x < v->size[0]; ++x) {
                if (!(row[x] > 0)) continue;
                f->voxels[field_place(f, x + RIM, y + RIM, z + RIM)] = (double)row[x];
                f->most = fmax(f->most, (double)row[x]);
                mark_near(f, x + RIM, y + RIM, z + RIM);
            }
        }
    free(row);
}

static void field_end(field *f) { free(f->voxels), free(f->near); }

/* Weights of the taps about a place that lies `part` behind the third of them. */
static void tap_weights(double part, double sigma, double weights[TAPS]) {
    const double width = 1 / (sigma * sigma), norm = 1 / (sigma * sqrt(2 * EX_PI));
    for (int k = 0; k < TAPS; ++k) {
        const double apart = part - (k - (TAPS / 2 - 1));
        weights[k] = norm * exp(-0.5 * apart * apart * width);
    }
}

/* The value of a grid, linear between its voxels and 0 beyond. */
static double linear_at(const fine_grid *g, const double point[3]) {
    double part[3], sum = 0;
    int first[3];
    for (int k = 0; k < 3; ++k) {
        const double place = (point[k] - g->corner[k]) / g->edge, below = floor(place);
        if (!(below >= 0 && below < g->size[k] - 1)) return 0;
        first[k] = (int)below, part[k] = place - below;
    }
    for (int i = 0; i < 8; ++i) {
        const int x = first[0] + (i & 1), y = first[1] + (i >> 1 & 1), z = first[2] + (i >> 2);
        const double weight = (i & 1 ? part[0] : 1 - part[0]) * (i & 2 ? part[1] : 1 - part[1]);
        sum += weight * (i & 4 ? part[2] : 1 - part[2]) *
               (double)g->values[((size_t)z * (size_t)g->size[1] + (size_t)y) * (size_t)g->size[0] + (size_t)x];
    }
    return sum;
}

/* The value at a point of the world. */
static double field_at(const field *f, const double point[3]) {
    double weights[3][TAPS], sum = 0;
    int first[3];
    if (f->instead) return linear_at(f->instead, point);
    for (int k = 0; k < 3; ++k) {
        const double place = (point[k] - f->corner[k]) / f->edge, below = floor(place);
        if (!(below >= TAPS / 2 - 1 && below < f->size[k] - TAPS / 2)) return 0;
        first[k] = (int)below;
    }
    if (!f->near[field_place(f, first[0], first[1], first[2])]) return 0;
    for (int k = 0; k < 3; ++k) {
        tap_weights((point[k] - f->corner[k]) / f->edge - first[k], f->sigma, weights[k]);
        first[k] -= TAPS / 2 - 1;
    }
    for (int z = 0; z < TAPS; ++z)
        for (int y = 0; y < TAPS; ++y) {
            const double *row = f->voxels + field_place(f, first[0], first[1] + y, first[2] + z);
            double along = 0;
            for (int x = 0; x < TAPS; ++x) along += weights[0][x] * row[x];
            sum += weights[2][z] * weights[1][y] * along;
        }
    return sum;
}

/* ======================================================================== what other renderers read: a finer grid */

/* Others interpolate linearly between voxels: that is a tent, of variance 1/6 in units of their voxels. They are given
   the field at twice the resolution, of kernels narrower by just that, so that what they see has the same width. They
   receive a scan as it is, and what they interpolate is its truth for them. */
enum { FINER = 2, MARGIN = 3 };
#define NARROWER 0.61713 /* sqrt(0.65^2 - 1 / (6 * FINER^2)) */

typedef struct fine_task {
    const contest *contest;
    const field *field;
    fine_grid *out;
} fine_task;

static void fine_layer(void *data, int z, int worker) {
    const fine_task *task = (const fine_task *)data;
    fine_grid *g = task->out;
    const sps_volume *v = &task->contest->frame.volume;
    const int inner = RIM - MARGIN;
    (void)worker;
    for (int y = 0; y < g->size[1]; ++y)
        for (int x = 0; x < g->size[0]; ++x) {
            const double at[3] = {g->corner[0] + x * g->edge, g->corner[1] + y * g->edge, g->corner[2] + z * g->edge};
            float *to = g->values + ((size_t)z * (size_t)g->size[1] + (size_t)y) * (size_t)g->size[0] + (size_t)x;
            if (v->eval_fn == blob_density) /* its truth knows no kernels */
                blob_density(NULL, 1, at, to);
            else if (v->transfer)
                *to = (float)task->field->voxels[field_place(task->field, x + inner, y + inner, z + inner)];
            else
                *to = (float)field_at(task->field, at);
        }
}

static void fine_begin(fine_grid *g, const contest *c, ex_session *session) {
    const sps_volume *v = &c->frame.volume;
    field f;
    fine_task task = {c, &f, g};
    const int finer = v->transfer ? 1 : FINER;
    field_begin(&f, v, NARROWER);
    g->edge = f.edge / finer;
    for (int k = 0; k < 3; ++k) {
        g->size[k] = finer * (v->size[k] + 2 * MARGIN);
        g->corner[k] = v->placement.origin[k] - MARGIN * f.edge + 0.5 * g->edge;
    }
    g->values = (float *)ex_allocate((size_t)g->size[0] * (size_t)g->size[1] * (size_t)g->size[2], sizeof(float));
    ex_parallel_for(&session->pool, g->size[2], fine_layer, &task);
    field_end(&f);
}

static double fine_most(const fine_grid *g) {
    double most = 0;
    const size_t count = (size_t)g->size[0] * (size_t)g->size[1] * (size_t)g->size[2];
    for (size_t i = 0; i < count; ++i) most = fmax(most, (double)g->values[i]);
    return most;
}

/* POV-Ray's format: big-endian, 16 bits. */
static void write_df3(const fine_grid *g, double most, FILE *file) {
    const size_t count = (size_t)g->size[0] * (size_t)g->size[1] * (size_t)g->size[2];
    for (int k = 0; k < 3; ++k) fputc(g->size[k] >> 8, file), fputc(g->size[k] & 255, file);
    for (size_t i = 0; i < count; ++i) {
        const int stored = (int)((double)g->values[i] / most * 65535 + 0.5);
        fputc(stored >> 8, file), fputc(stored & 255, file);
    }
}

static FILE *open_in(const char *folder, const char *name, const char *mode) {
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, mode);
    if (file) return file;
    fprintf(stderr, "%s: cannot open %s\n", program, path);
    exit(EX_FAILED);
}

typedef struct eye_rays {
    double origin[3], ahead[3], right[3], up[3]; /* unit vectors */
    double half;                                 /* of the picture's height, at distance 1 */
} eye_rays;

static void store_vec(double out[3], ex_vec v) { out[0] = v.x, out[1] = v.y, out[2] = v.z; }

static eye_rays rays_of(const sps_camera *camera) {
    eye_rays rays;
    const ex_vec from = ex_vec_of(camera->position[0], camera->position[1], camera->position[2]);
    const ex_vec to = ex_vec_of(camera->target[0], camera->target[1], camera->target[2]);
    const ex_vec ahead = ex_vec_unit(ex_vec_sub(to, from));
    const ex_vec right = ex_vec_unit(ex_vec_cross(ahead, ex_vec_of(camera->up[0], camera->up[1], camera->up[2])));
    store_vec(rays.origin, from), store_vec(rays.ahead, ahead), store_vec(rays.right, right);
    store_vec(rays.up, ex_vec_cross(right, ahead));
    rays.half = tan(0.5 * camera->field_of_view);
    return rays;
}

/* One name and its numbers: for POV-Ray as a declaration, otherwise a line. */
static void write_numbers(FILE *pov, FILE *lines, const char *name, const double *numbers, int count) {
    fprintf(pov, "#declare %s = %s", name, count > 1 ? "<" : "");
    fprintf(lines, "%s", name);
    for (int i = 0; i < count; ++i) {
        fprintf(pov, "%s%.9g", i ? ", " : "", numbers[i]);
        fprintf(lines, " %.9g", numbers[i]);
    }
    fprintf(pov, "%s;\n", count > 1 ? ">" : "");
    fprintf(lines, "\n");
}

static void write_scene(const contest *c, const fine_grid *g, double most, FILE *pov, FILE *lines) {
    const sps_volume *v = &c->frame.volume;
    const eye_rays rays = rays_of(&c->frame.view.camera);
    double size[3], last[3];
    ex_vec light =
        ex_vec_unit(ex_vec_of(c->frame.light.direction[0], c->frame.light.direction[1], c->frame.light.direction[2]));
    const double toward[3] = {-light.x, -light.y, -light.z};
    const struct {
        const char *name;
        double value;
    } numbers[] = {{"Half", rays.half},
                   {"Irradiance", (double)c->frame.light.color[0]},
                   {"SunAngle", c->frame.light.angular_diameter},
                   {"Extinction", (double)v->extinction},
                   {"Albedo", (double)v->albedo[0]},
                   {"Asymmetry", v->lobes ? (double)v->lobes->asymmetry : 0},
                   {"Edge", g->edge},
                   {"Most", most},
                   {"IsBlob", v->eval_fn == blob_density},
                   {"BlobWidth", BLOB_WIDTH},
                   {"Triangles", (double)c->land.triangle_count}};
    for (int k = 0; k < 3; ++k) size[k] = g->size[k], last[k] = g->corner[k] + (g->size[k] - 1) * g->edge;
    write_numbers(pov, lines, "Eye", rays.origin, 3), write_numbers(pov, lines, "Ahead", rays.ahead, 3);
    write_numbers(pov, lines, "Right", rays.right, 3), write_numbers(pov, lines, "Up", rays.up, 3);
    write_numbers(pov, lines, "Toward", toward, 3), write_numbers(pov, lines, "Size", size, 3);
    write_numbers(pov, lines, "First", g->corner, 3), write_numbers(pov, lines, "Last", last, 3);
    write_numbers(pov, lines, "BlobCentre", blob_centre, 3);
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; ++i)
        write_numbers(pov, lines, numbers[i].name, &numbers[i].value, 1);
}

/* The points of a transfer function, a line for each of their numbers. */
static void write_look(const sps_transfer *look, FILE *pov, FILE *lines) {
    static const char *const names[] = {"Values", "Extinctions", "Reds", "Greens", "Blues"};
    double numbers[5][16];
    for (int i = 0; i < look->point_count; ++i) {
        const sps_transfer_point *p = look->points + i;
        numbers[0][i] = (double)p->value, numbers[1][i] = (double)p->extinction;
        for (int k = 0; k < 3; ++k) numbers[2 + k][i] = (double)p->albedo[k];
    }
    for (int k = 0; k < 5; ++k) write_numbers(pov, lines, names[k], numbers[k], look->point_count);
}

/* The ground, two triangles, and the rest are objects of their own: each has one color. */
static void write_land(const contest *c, FILE *pov, FILE *lines) {
    for (size_t i = 0; i < c->land.triangle_count; ++i) {
        const sps_triangle *t = c->land.triangles + i;
        if (i == 0 || i == 2) fprintf(pov, "%smesh {\n", i ? "}\n" : "");
        fprintf(pov, "triangle {");
        for (int k = 0; k < 3; ++k) {
            const double p[3] = {(double)t->position[k][0], (double)t->position[k][1], (double)t->position[k][2]};
            fprintf(pov, " <%.9g, %.9g, %.9g>%s", p[0], p[1], p[2], k < 2 ? "," : " }\n");
            fprintf(lines, "%.9g %.9g %.9g ", p[0], p[1], p[2]);
        }
        fprintf(lines, "%.9g\n", (double)t->albedo[0][0]);
        if (i == 1 || i + 1 == c->land.triangle_count)
            fprintf(pov, "pigment { rgb %.9g } finish { ambient 0 diffuse 1 }\n%s", (double)t->albedo[0][0],
                    i + 1 == c->land.triangle_count ? "}\n" : "");
    }
}

static void prepare(const contest *c, const char *folder) {
    ex_session session;
    fine_grid g;
    ex_session_measure(&session, program, WORKERS);
    fine_begin(&g, c, &session);
    ex_session_end(&session);
    const double most = fine_most(&g);
    FILE *df3 = open_in(folder, "density.df3", "wb"), *raw = open_in(folder, "density.raw", "wb");
    FILE *pov = open_in(folder, "scene.inc", "w"), *lines = open_in(folder, "scene.txt", "w");
    FILE *mesh = open_in(folder, "mesh.inc", "w"), *triangles = open_in(folder, "triangles.txt", "w");
    write_df3(&g, most, df3);
    fwrite(g.values, sizeof(float), (size_t)g.size[0] * (size_t)g.size[1] * (size_t)g.size[2], raw);
    write_scene(c, &g, most, pov, lines);
    if (c->frame.volume.transfer) write_look(c->frame.volume.transfer, pov, lines);
    write_land(c, mesh, triangles);
    fclose(df3), fclose(raw), fclose(pov), fclose(lines), fclose(mesh), fclose(triangles);
    free(g.values);
}

/* ==================================================================================== the truth, by brute force */

/* A scene in doubles, and how finely it is followed. */
typedef struct truth {
    const contest *contest;
    field field;
    eye_rays rays;
    double toward[3], irradiance, extinction, albedo, asymmetry, sun; /* sun: half its angle */
    double (*corners)[3][3], *reflectance;                            /* of triangles */
    size_t triangles;
    double middle[3], reach; /* a ball about all triangles but the ground's two */
    double low[3], high[3];  /* the box of the field */
    double step;             /* along rays of the eye, in voxels */
    int suns;                /* directions to the sun per step, and 400 per point of a polygon; 1: it has no extent */
    int side, first;         /* pixels that are followed, and the place of the first */
    double *values, *noise;  /* of these pixels: radiance, and variance of it */
    double *linear;          /* a scan's radiance as others interpolate it; NULL: no scan */
} truth;

/* A pseudo-random number in 0..1. Paths draw more numbers than ex_random has. [Steele et al. 2014] */
static double uniform(uint64_t *state) {
    uint64_t z = *state += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return (double)((z ^ (z >> 31)) >> 11) / 9007199254740992.0;
}

static void along(const double origin[3], const double direction[3], double t, double out[3]) {
    for (int k = 0; k < 3; ++k) out[k] = origin[k] + t * direction[k];
}

/* Distance along a ray to a triangle, or infinity. [Moeller & Trumbore 1997] */
static double triangle_distance(double (*const corners)[3], const double origin[3], const double direction[3]) {
    double a[3], b[3], p[3], q[3], s[3];
    for (int k = 0; k < 3; ++k)
        a[k] = corners[1][k] - corners[0][k], b[k] = corners[2][k] - corners[0][k], s[k] = origin[k] - corners[0][k];
    for (int k = 0; k < 3; ++k) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        p[k] = direction[i] * b[j] - direction[j] * b[i], q[k] = s[i] * a[j] - s[j] * a[i];
    }
    const double scale = ex_dot(a, p), u = ex_dot(s, p) / scale, v = ex_dot(direction, q) / scale;
    const double t = ex_dot(b, q) / scale;
    return u >= 0 && v >= 0 && u + v <= 1 && t > 1e-7 ? t : HUGE_VAL;
}

/* The nearest triangle; its distance is infinite if there is none. */
static double nearest(const truth *w, const double origin[3], const double direction[3], size_t *which) {
    double least = HUGE_VAL, to[3];
    for (int k = 0; k < 3; ++k) to[k] = w->middle[k] - origin[k];
    const double foot = ex_dot(to, direction), apart = ex_dot(to, to) - foot * foot;
    const size_t count = apart < w->reach * w->reach ? w->triangles : w->triangles < 2 ? w->triangles : 2;
    for (size_t i = 0; i < count; ++i) {
        const double t = triangle_distance(w->corners[i], origin, direction);
        if (t < least) least = t, *which = i;
    }
    return least;
}

/* The part of a ray within the field's box; returns 0 if there is none. */
static int clip(const truth *w, const double origin[3], const double direction[3], double *t0, double *t1) {
    for (int k = 0; k < 3; ++k) {
        const double a = (w->low[k] - origin[k]) / direction[k], b = (w->high[k] - origin[k]) / direction[k];
        if (!(fabs(direction[k]) > 1e-12)) continue;
        *t0 = fmax(*t0, fmin(a, b)), *t1 = fmin(*t1, fmax(a, b));
    }
    return *t0 < *t1;
}

/* Optical depth from a point to the end of the field: three nodes of Gauss and Legendre per voxel. */
static double depth_toward(const truth *w, const double origin[3], const double direction[3]) {
    static const double nodes[3] = {0.11270166537925831, 0.5, 0.88729833462074169}, weights[3] = {5, 8, 5};
    double t0 = 0, t1 = HUGE_VAL, sum = 0, point[3];
    if (!clip(w, origin, direction, &t0, &t1)) return 0;
    const double edge = w->field.edge;
    for (int i = 0; t0 + i * edge < t1; ++i)
        for (int k = 0; k < 3; ++k) {
            along(origin, direction, t0 + (i + nodes[k]) * edge, point);
            sum += weights[k] / 18 * field_at(&w->field, point);
        }
    return w->extinction * edge * sum;
}

/* What is left of the light at a point, in one direction. */
static double lit(const truth *w, const double point[3], const double toward[3]) {
    size_t which = 0;
    if (w->triangles > 0 && nearest(w, point, toward, &which) < HUGE_VAL) return 0;
    return exp(-depth_toward(w, point, toward));
}

/* A direction to the sun's disc: a place in stratum n of 20 x 20. */
static void sun_direction(const truth *w, int n, uint64_t *random, double out[3]) {
    const double u = (n % 20 + uniform(random)) / 20, v = (n / 20 % 20 + uniform(random)) / 20;
    const double cosine = 1 - u * (1 - cos(w->sun)), sine = sqrt(1 - cosine * cosine), turn = 2 * EX_PI * v;
    const ex_vec axis = ex_vec_of(w->toward[0], w->toward[1], w->toward[2]), a = ex_vec_perpendicular(axis);
    const ex_vec b = ex_vec_cross(axis, ex_vec_unit(a));
    store_vec(out, ex_vec_add(ex_vec_scale(axis, cosine), ex_vec_add(ex_vec_scale(ex_vec_unit(a), sine * cos(turn)),
                                                                     ex_vec_scale(b, sine * sin(turn)))));
}

/* The mean over `count` directions of the sun, if it has an extent, and over their cosines with a normal, if there is
   one; strata take turns from call to call. */
static double sunlight(const truth *w, const double point[3], const double *normal, int count, int *turn,
                       uint64_t *random) {
    double sum = 0, toward[3];
    if (!(w->sun > 0)) count = 1;
    memcpy(toward, w->toward, sizeof toward);
    for (int i = 0; i < count; ++i) {
        *turn = (*turn + 149) % 400;
        if (w->sun > 0) sun_direction(w, *turn, random, toward);
        const double cosine = normal ? ex_dot(normal, toward) : 1;
        if (cosine > 0) sum += cosine * lit(w, point, toward);
    }
    return sum / count;
}

static double polygon_radiance(const truth *w, size_t which, const double point[3], const double direction[3],
                               int *turn, uint64_t *random) {
    double(*const p)[3] = w->corners[which];
    const ex_vec corner = ex_vec_of(p[0][0], p[0][1], p[0][2]);
    const ex_vec a = ex_vec_sub(ex_vec_of(p[1][0], p[1][1], p[1][2]), corner);
    const ex_vec b = ex_vec_sub(ex_vec_of(p[2][0], p[2][1], p[2][2]), corner);
    double normal[3], above[3];
    store_vec(normal, ex_vec_unit(ex_vec_cross(a, b)));
    for (int k = 0, behind = ex_dot(normal, direction) > 0; k < 3; ++k)
        if (behind) normal[k] = -normal[k];
    along(point, normal, 1e-6, above);
    return w->reflectance[which] / EX_PI * w->irradiance * sunlight(w, above, normal, 400, turn, random);
}

/* Light that scatters once, and polygons. */
static double marched(const truth *w, const double direction[3], uint64_t *random) {
    const double *origin = w->rays.origin, length = w->step * w->field.edge;
    const double source = w->albedo * w->irradiance / (4 * EX_PI);
    double t0 = 0, t1 = HUGE_VAL, depth = 0, sum = 0, point[3];
    int turn = (int)(400 * uniform(random));
    size_t which = 0;
    const double wall = nearest(w, origin, direction, &which);
    t1 = wall;
    if (clip(w, origin, direction, &t0, &t1)) {
        const int steps = (int)ceil((t1 - t0) / length);
        const double each = (t1 - t0) / steps;
        for (int i = 0; i < steps && depth < 30; ++i) {
            along(origin, direction, t0 + (i + 0.5) * each, point);
            const double here = w->extinction * field_at(&w->field, point) * each;
            if (here > 1e-9) sum += exp(-depth) * -expm1(-here) * sunlight(w, point, NULL, w->suns, &turn, random);
            depth += here;
        }
    }
    sum *= source;
    if (!(wall < HUGE_VAL)) return sum;
    along(origin, direction, wall, point);
    return sum + exp(-depth) * polygon_radiance(w, which, point, direction, &turn, random);
}

/* The same for a scan in ambient light of 1. */
static double classified(const truth *w, const double direction[3]) {
    const sps_transfer *look = w->contest->frame.volume.transfer;
    const double length = w->step * w->field.edge;
    double t0 = 0, t1 = HUGE_VAL, depth = 0, sum = 0, at[3];
    if (!clip(w, w->rays.origin, direction, &t0, &t1)) return 0;
    for (double t = t0 + 0.5 * length; t < t1 && depth < 30; t += length) {
        const sps_transfer_point *high = look->points + 1, *last = look->points + look->point_count - 1;
        along(w->rays.origin, direction, t, at);
        const double value = field_at(&w->field, at);
        while (high < last && value > (double)high->value) ++high;
        const sps_transfer_point *low = high - 1;
        const double part = ex_clamp((value - (double)low->value) / (double)(high->value - low->value), 0, 1);
        const double color = (1 - part) * (double)low->albedo[1] + part * (double)high->albedo[1];
        const double here = ((1 - part) * (double)low->extinction + part * (double)high->extinction) * length;
        sum += exp(-depth) * -expm1(-here) * color;
        depth += here;
    }
    return sum;
}

/* ---------------------------------------------------------------------------------------------------- random paths */

/* The next place where a ray meets gas, or is left without; returns 0 if it leaves. [Woodcock 1965] */
static int collide(const truth *w, const double origin[3], const double direction[3], uint64_t *random, double at[3]) {
    const double majorant = w->extinction * w->field.most;
    double t0 = 0, t1 = HUGE_VAL;
    if (!clip(w, origin, direction, &t0, &t1)) return 0;
    for (double t = t0;;) {
        t -= log(1 - uniform(random)) / majorant;
        if (t >= t1) return 0;
        along(origin, direction, t, at);
        if (uniform(random) * w->field.most < field_at(&w->field, at)) return 1;
    }
}

static double phase(double g, double cosine) {
    return (1 - g * g) / (4 * EX_PI * pow(1 + g * g - 2 * g * cosine, 1.5));
}

/* A new direction by the phase function of Henyey and Greenstein. */
static void scatter(double g, uint64_t *random, double direction[3]) {
    const double s = (1 - g * g) / (1 - g + 2 * g * uniform(random)), turn = 2 * EX_PI * uniform(random);
    const double cosine = fabs(g) > 1e-3 ? (1 + g * g - s * s) / (2 * g) : 2 * uniform(random) - 1;
    const double sine = sqrt(fmax(1 - cosine * cosine, 0));
    const ex_vec axis = ex_vec_of(direction[0], direction[1], direction[2]);
    const ex_vec a = ex_vec_unit(ex_vec_perpendicular(axis)), b = ex_vec_cross(axis, a);
    store_vec(direction,
              ex_vec_unit(ex_vec_add(ex_vec_scale(axis, cosine), ex_vec_add(ex_vec_scale(a, sine * cos(turn)),
                                                                            ex_vec_scale(b, sine * sin(turn))))));
}

static double path(const truth *w, const double start[3], uint64_t *random) {
    double origin[3], direction[3], at[3], beyond[3], weight = 1, sum = 0;
    memcpy(origin, w->rays.origin, sizeof origin), memcpy(direction, start, sizeof direction);
    while (collide(w, origin, direction, random, at)) {
        weight *= w->albedo;
        if (weight < 0.3) { /* one of two goes on, with the weight of both */
            if (uniform(random) < 0.5) break;
            weight *= 2;
        }
        if (!collide(w, at, w->toward, random, beyond))
            sum += weight * w->irradiance * phase(w->asymmetry, ex_dot(direction, w->toward));
        scatter(w->asymmetry, random, direction);
        memcpy(origin, at, sizeof origin);
    }
    return sum;
}

/* -------------------------------------------------------------------------------------------------------- pixels */

static void pixel_direction(const truth *w, double x, double y, double out[3]) {
    const double across = w->rays.half * (2 * (x + 0.5) / SIZE - 1), above = w->rays.half * (1 - 2 * (y + 0.5) / SIZE);
    for (int k = 0; k < 3; ++k) out[k] = w->rays.ahead[k] + across * w->rays.right[k] + above * w->rays.up[k];
    store_vec(out, ex_vec_unit(ex_vec_of(out[0], out[1], out[2])));
}

static void truth_pixel(void *data, int index, int worker) {
    truth *w = (truth *)data;
    const int x = w->first + index % w->side * w->contest->stride, y = w->first + index / w->side * w->contest->stride;
    const int count = w->contest->paths ? w->contest->paths : w->sun > 0 ? 2 : 1;
    uint64_t random = (uint64_t)ex_hash(x, y, 1) << 32;
    double direction[3], sum = 0, squares = 0;
    (void)worker;
    pixel_direction(w, x, y, direction);
    for (int i = 0; i < count; ++i) {
        const double found = w->contest->paths                   ? path(w, direction, &random)
                             : w->contest->frame.volume.transfer ? classified(w, direction)
                                                                 : marched(w, direction, &random);
        sum += found, squares += found * found;
    }
    w->values[index] = sum / count;
    w->noise[index] = count > 1 ? fmax(squares / count - pow(sum / count, 2), 0) / (count - 1) : 0;
}

static void copy_triangles(truth *w) {
    const ex_mesh *land = &w->contest->land;
    w->triangles = land->triangle_count;
    w->corners = (double(*)[3][3])ex_allocate(w->triangles, sizeof *w->corners);
    w->reflectance = (double *)ex_allocate(w->triangles, sizeof(double));
    for (size_t i = 0; i < w->triangles; ++i) {
        w->reflectance[i] = (double)land->triangles[i].albedo[0][0];
        for (int k = 0; k < 9; ++k) {
            w->corners[i][k / 3][k % 3] = (double)land->triangles[i].position[k / 3][k % 3];
            if (i >= 2) w->middle[k % 3] += w->corners[i][k / 3][k % 3] / (3 * (double)(w->triangles - 2));
        }
    }
    for (size_t i = 2; i < w->triangles; ++i)
        for (int k = 0; k < 3; ++k) {
            double from[3];
            for (int j = 0; j < 3; ++j) from[j] = w->corners[i][k][j] - w->middle[j];
            w->reach = fmax(w->reach, 1e-6 + sqrt(ex_dot(from, from)));
        }
}

static void truth_begin(truth *w, const contest *c) {
    const frame *f = &c->frame;
    memset(w, 0, sizeof *w);
    w->contest = c;
    field_begin(&w->field, &f->volume, 0.65);
    w->rays = rays_of(&f->view.camera);
    store_vec(
        w->toward,
        ex_vec_scale(ex_vec_unit(ex_vec_of(f->light.direction[0], f->light.direction[1], f->light.direction[2])), -1));
    w->irradiance = (double)f->light.color[0], w->extinction = (double)f->volume.extinction;
    w->albedo = (double)f->volume.albedo[0], w->sun = 0.5 * f->light.angular_diameter;
    w->asymmetry = f->volume.lobes ? (double)f->volume.lobes->asymmetry : 0;
    for (int k = 0; k < 3; ++k) {
        w->low[k] = w->field.corner[k] + (RIM - 4) * w->field.edge;
        w->high[k] = w->field.corner[k] + (w->field.size[k] - 1 - RIM + 4) * w->field.edge;
    }
    copy_triangles(w);
    w->side = SIZE / c->stride / 2 * 2, w->first = (SIZE - (w->side - 1) * c->stride - 1) / 2;
    w->values = (double *)ex_allocate((size_t)(w->side * w->side), sizeof(double));
    w->noise = (double *)ex_allocate((size_t)(w->side * w->side), sizeof(double));
    w->suns = 4, w->step = c->step;
}

static void truth_end(truth *w) {
    field_end(&w->field);
    free(w->corners), free(w->reflectance), free(w->values), free(w->noise), free(w->linear);
}

/* The share of the picture's mean by which the pixels change if steps are `longer` times as long, or if gas is what
   others interpolate in `instead`. */
static double change_by(truth *w, ex_session *session, double longer, const fine_grid *instead) {
    const int count = w->side * w->side;
    double *found = w->values, squares = 0, sum = 0;
    w->values = (double *)ex_allocate((size_t)count, sizeof(double));
    w->step *= longer, w->field.instead = instead;
    ex_parallel_for(&session->pool, count, truth_pixel, w);
    w->step /= longer, w->field.instead = NULL;
    for (int i = 0; i < count; ++i) squares += pow(w->values[i] - found[i], 2), sum += found[i];
    if (instead && w->contest->frame.volume.transfer)
        w->linear = w->values;
    else
        free(w->values);
    w->values = found;
    return sqrt(squares / count) / (sum / count);
}

/* Fills the pixels. Of those that no chance plays a part in: how much they change as above; otherwise 0. */
static void find_truth(truth *w, ex_session *session, double *step_change, double *grid_change) {
    const contest *c = w->contest;
    *step_change = *grid_change = 0;
    if (c->frame.volume.eval_fn == blob_density) {
        const blob shape = {BLOB_WIDTH, BLOB_EXTINCTION};
        free(w->values);
        w->values = blob_exact(session, shape, SIZE);
        return;
    }
    ex_parallel_for(&session->pool, w->side * w->side, truth_pixel, w);
    if (c->paths || w->sun > 0) return;
    fine_grid g;
    fine_begin(&g, c, session);
    *step_change = change_by(w, session, 2, NULL), *grid_change = change_by(w, session, 1, &g);
    free(g.values);
}

/* A line with side, stride, and as shares of the mean standard error, change by the step and by the grid; then the
   pixels, and those of a scan once more as others interpolate it. */
static void write_truth(const contest *c, const char *folder) {
    ex_session session;
    truth w;
    double noise = 0, mean = 0, step_change, grid_change;
    truth_begin(&w, c);
    ex_session_measure(&session, program, WORKERS);
    const double start = ex_now(NULL);
    const int count = w.side * w.side;
    find_truth(&w, &session, &step_change, &grid_change);
    for (int i = 0; i < count; ++i) noise += w.noise[i] / count, mean += w.values[i] / count;
    FILE *file = open_in(folder, "truth.txt", "w");
    fprintf(file, "%d %d %.9g %.9g %.9g\n", w.side, c->stride, sqrt(noise) / mean, step_change, grid_change);
    for (int i = 0; i < count; ++i) fprintf(file, "%.9g\n", w.values[i]);
    for (int i = 0; w.linear && i < count; ++i) fprintf(file, "%.9g\n", w.linear[i]);
    fclose(file);
    fprintf(stderr, "%s: %d true pixels, mean %.4f, in %.1f s\n", c->name, count, mean, ex_now(NULL) - start);
    ex_session_end(&session);
    truth_end(&w);
}

/* ==================================================================================================== ours */

/* Grades are what docs/accuracy.md recommends for a preview, a picture and a film still; the last is the default mode,
   with nothing set. */
static void render_ours(contest *c, int grade, int size, const char *path) {
    static const sps_quality qualities[GRADES] = {SPS_QUALITY_DRAFT, SPS_QUALITY_MEDIUM, SPS_QUALITY_HIGH};
    static const float tolerances[GRADES] = {0.1f, 0.02f, 0.005f};
    static const int samples[GRADES] = {4, 16, 64}, cells[GRADES] = {32, 64, 128};
    frame *f = &c->frame;
    ex_session session;
    ex_error error;
    if (grade == GRADES - 1) f->view.scattering = SPS_SCATTERING_AUTO;
    f->view.quality = qualities[grade], f->view.tolerance = tolerances[grade];
    if (grade == 0 && !f->volume.transfer) f->view.slab_thickness = 4;
    if (f->light.angular_diameter > 0) f->light.samples = samples[grade];
    if (f->view.scattering == SPS_SCATTERING_MULTIPLE) f->view.scattering_resolution = cells[grade];
    if (size != SIZE) { /* start-up is measured so: what it has in common with a picture is reading */
        frame_resize(f, size, size);
        f->view.scattering = SPS_SCATTERING_SINGLE, f->view.scattering_resolution = 0, f->view.no_shadows = 1;
    }
    ex_session_measure(&session, program, WORKERS);
    render_seconds(&session, f, &f->view);
    ex_session_end(&session);
    ex_stop_if(ex_write_pfm(path, f->rgba, size, size, 0, 3, &error), program, &error);
}

/* ==================================================================================================== time */

static void run_once(char **command) {
    const pid_t child = fork();
    int status = 0;
    if (child == 0) {
        execvp(command[0], command);
        _exit(127);
    }
    if (child > 0 && waitpid(child, &status, 0) == child && status == 0) return;
    fprintf(stderr, "%s: %s failed\n", program, command[0]);
    exit(EX_FAILED);
}

/* The median of five runs if the first one takes less than two seconds. Output of the command is not wanted. */
static void time_command(char **command) {
    enum { RUNS = 5 };
    double seconds[RUNS];
    struct rusage usage;
    const int out = dup(1);
    int runs = 0;
    if (!freopen("/dev/null", "w", stdout)) exit(EX_FAILED);
    do {
        const double start = ex_now(NULL);
        run_once(command);
        seconds[runs] = ex_now(NULL) - start;
    } while (++runs < RUNS && seconds[0] < 2);
    getrusage(RUSAGE_CHILDREN, &usage);
    FILE *report = fdopen(out, "w");
    fprintf(report, "%.4f %.1f\n", ex_percentile(seconds, (size_t)runs, 0.5), (double)usage.ru_maxrss / 1024);
    fclose(report);
}

/* ================================================================================================ pictures */

/* Four floats per pixel, top row first, as the library has them. */
typedef struct picture {
    int width, height;
    float *rgba;
} picture;

static void picture_begin(picture *p, int width, int height) {
    p->width = width, p->height = height;
    p->rgba = (float *)ex_allocate((size_t)width * (size_t)height, 4 * sizeof(float));
}

static uint32_t little(const char *bytes, int count) {
    uint32_t value = 0;
    for (int i = 0; i < count; ++i) value |= (uint32_t)(unsigned char)bytes[i] << (8 * i);
    return value;
}

static float float_of(const char *bytes) {
    const uint32_t bits = little(bytes, 4);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* PFM, or PPM of 16 bits. Returns non-zero if there are too few bytes. */
static int read_portable(const char *text, size_t length, picture *p) {
    int width = 0, height = 0, header = 0;
    double scale = 0;
    const int is_float = text[1] == 'F', size = is_float ? 4 : 2;
    const char *from = text + 3;
    while (*from == '#') from += strcspn(from, "\n") + 1; /* POV-Ray's comments */
    if (sscanf(from, "%d %d %lf%n", &width, &height, &scale, &header) != 3) return 1;
    const char *bytes = from + header + 1;
    if (length < (size_t)(bytes - text) + (size_t)(3 * size * width * height)) return 1;
    picture_begin(p, width, height);
    for (int i = 0; i < 3 * width * height; ++i, bytes += size) {
        const int y = i / 3 / width, row = is_float ? height - 1 - y : y;
        float *to = p->rgba + 4 * (row * width + i / 3 % width) + i % 3;
        *to = is_float ? float_of(bytes) : (float)((unsigned char)bytes[0] * 256 + (unsigned char)bytes[1]) / 65535.0f;
    }
    return 0;
}

/* The value of an attribute in the header of an OpenEXR file; `at` becomes the place behind the header. NULL: none. */
static const char *exr_attribute(const char *text, const char *name, size_t *at) {
    const char *found = NULL, *from = text + 8;
    while (*from) {
        const char *type = from + strlen(from) + 1, *size = type + strlen(type) + 1;
        if (!strcmp(from, name)) found = size + 4;
        from = size + 4 + little(size, 4);
    }
    *at = (size_t)(from + 1 - text);
    return found;
}

/* OpenEXR as it is written without compression: rows of 32-bit floats, channel by channel. */
static int read_exr(const char *text, picture *p) {
    size_t at = 0;
    const char *channels = exr_attribute(text, "channels", &at), *window = exr_attribute(text, "dataWindow", &at);
    const char *compression = exr_attribute(text, "compression", &at);
    int planes[8], count = 0;
    if (!channels || !window || !compression || *compression != 0) return 1;
    for (; *channels && count < 8; channels += strlen(channels) + 17) {
        const char *found = strchr("RGB", channels[strlen(channels) - 1]);
        planes[count++] = found ? (int)(found - "RGB") : 3;
        if (little(channels + strlen(channels) + 1, 4) != 2) return 1;
    }
    picture_begin(p, (int)(little(window + 8, 4) - little(window, 4)) + 1,
                  (int)(little(window + 12, 4) - little(window + 4, 4)) + 1);
    const char *from = text + at + 8 * (size_t)p->height;
    for (int row = 0; row < p->height; ++row, from += 8 + 4 * count * p->width)
        for (int i = 0; i < count * p->width; ++i)
            p->rgba[4 * (row * p->width + i % p->width) + planes[i / p->width]] = float_of(from + 8 + 4 * i);
    return 0;
}

/* Returns non-zero if there is no such picture. */
static int read_picture(const char *path, picture *p) {
    char *text;
    size_t length;
    ex_error error;
    FILE *file = fopen(path, "rb");
    if (!file) return 1;
    fclose(file);
    ex_stop_if(ex_read_text(path, &text, &length, &error), program, &error);
    const int failed = length < 16 || (text[0] == 'P' ? read_portable(text, length, p)
                                                      : little(text, 4) != 20000630 || read_exr(text, p));
    free(text);
    if (failed) fprintf(stderr, "%s: %s: cannot be read\n", program, path);
    return failed;
}

/* ==================================================================================================== page */

enum { ROWS = 120, WORD = 120 };

static const char *const rival_names[] = {"splatshadow", "Cycles", "POV-Ray", "vdb_render", "VTK"};
enum { RIVALS = sizeof rival_names / sizeof *rival_names };

/* A picture of a contestant. */
typedef struct entry {
    char scene[WORD], who[WORD], setting[WORD], path[4 * WORD];
    double seconds, start, megabytes; /* of the whole process; what an empty picture takes; peak */
    double rms, bias;                 /* as shares of the mean */
    picture picture;
} entry;

/* The true pixels of a scene, and those for other renderers, which are the same except for scans. */
typedef struct pixels {
    int side, stride;
    double noise, step_change, grid_change, *values, *linear;
} pixels;

static int read_pixels(const char *folder, const char *scene, pixels *t) {
    char path[4096];
    snprintf(path, sizeof path, "%s/%s/truth.txt", folder, scene);
    FILE *file = fopen(path, "r");
    memset(t, 0, sizeof *t);
    if (!file) return 1;
    const int failed =
        fscanf(file, "%d %d %lf %lf %lf", &t->side, &t->stride, &t->noise, &t->step_change, &t->grid_change) != 5;
    const int count = failed ? 0 : t->side * t->side;
    int found = 0;
    t->values = (double *)ex_allocate(2 * (size_t)count, sizeof(double));
    while (found < 2 * count && fscanf(file, "%lf", t->values + found) == 1) ++found;
    t->linear = t->values + (found == 2 * count ? count : 0);
    fclose(file);
    return failed || found < count;
}

/* The truth's own error is taken out by squares, down to the standard error of what that is. */
static void measure(const pixels *t, entry *e) {
    const int count = t->side * t->side, first = (SIZE - (t->side - 1) * t->stride - 1) / 2;
    const double noise = t->noise * t->noise, *values = strcmp(e->who, rival_names[0]) ? t->linear : t->values;
    double squares = 0, mean = 0;
    for (int i = 0; i < count; ++i) mean += values[i] / count;
    for (int i = 0; i < count; ++i) {
        const int x = first + i % t->side * t->stride, y = first + i / t->side * t->stride;
        const double off = ((double)e->picture.rgba[4 * (y * SIZE + x) + 1] - values[i]) / mean;
        squares += off * off / count, e->bias += off / count;
    }
    e->rms = sqrt(fmax(squares - noise, noise * sqrt(2.0 / count)));
}

/* Lines of SCENE|WHO|SETTING|PICTURE|SECONDS MEGABYTES|SECONDS MEGABYTES, the last two of an empty picture. */
static int read_entries(const char *path, entry *entries) {
    char line[1024];
    int count = 0;
    FILE *file = fopen(path, "r");
    while (file && count < ROWS && fgets(line, sizeof line, file)) {
        entry *e = entries + count;
        memset(e, 0, sizeof *e);
        if (sscanf(line, "%119[^|]|%119[^|]|%119[^|]|%479[^|]|%lf %lf|%lf", e->scene, e->who, e->setting, e->path,
                   &e->seconds, &e->megabytes, &e->start) == 7 &&
            !read_picture(e->path, &e->picture) && e->picture.width == SIZE && e->picture.height == SIZE)
            ++count;
    }
    if (file) fclose(file);
    return count;
}

/* Times are noisy: what remains is a hundredth of a second at least. */
static double without_start(const entry *e) { return fmax(e->seconds - e->start, 0.01); }

/* An error or a bias in percent, with two digits or more. */
static void print_percent(FILE *file, double share, int signed_value) {
    const double percent = 100 * share;
    fprintf(file, " %s%.*g %% |", signed_value && share > 0 ? "+" : "", fabs(percent) < 10 ? 2 : 3, percent);
}

/* Every picture of a scene. */
static void print_scene(FILE *file, const contest *c, const pixels *t, const entry *entries, int count) {
    fprintf(file, "\n### %s\n\n", c->title);
    if (t->stride > 1)
        fprintf(file, "Truth: %d pixels", t->side * t->side);
    else
        fprintf(file, "Truth: the closed form, all pixels");
    if (t->noise > 0) fprintf(file, " with an error of %.2g %%, subtracted from the errors in squares", 100 * t->noise);
    if (t->step_change > 0)
        fprintf(file, "; doubled steps change them by %.2g %%, linear interpolation by %.2g %%", 100 * t->step_change,
                100 * t->grid_change);
    fprintf(file, ".\n\n| | setting | error | bias | whole process | start-up | without it | peak memory |\n"
                  "|---|---|---|---|---|---|---|---|\n");
    for (int i = 0; i < count; ++i) {
        const entry *e = entries + i;
        if (strcmp(e->scene, c->name) != 0) continue;
        fprintf(file, "| %s | %s |", e->who, e->setting);
        print_percent(file, e->rms, 0), print_percent(file, e->bias, 1);
        fprintf(file, " %.2f s | %.2f s | %.2f s | %.0f MB |\n", e->seconds, e->start, without_start(e), e->megabytes);
    }
}

/* The most accurate picture of a renderer, or its fastest one with an error of at most `bound`, if any. */
static const entry *best_of(const entry *entries, int count, const char *scene, const char *who, double bound) {
    const entry *best = NULL;
    for (int i = 0; i < count; ++i) {
        const entry *e = entries + i;
        if (strcmp(e->scene, scene) != 0 || strcmp(e->who, who) != 0) continue;
        const int quicker = best && best->rms <= bound && e->rms <= bound && without_start(e) < without_start(best);
        if (!best || quicker || (best->rms > bound && e->rms < best->rms)) best = e;
    }
    return best;
}

static void print_side(const entry *e) {
    printf(" %s |", e->setting);
    print_percent(stdout, e->rms, 0);
    printf(" %.2f s | %.0f MB |", without_start(e), e->megabytes);
}

/* Each rival's most accurate picture beside this library's fastest one that is no less accurate. */
static void print_duels(const contest *c, const entry *entries, int count) {
    for (int r = 1; r < RIVALS; ++r) {
        const entry *rival = best_of(entries, count, c->name, rival_names[r], 0);
        const entry *ours = rival ? best_of(entries, count, c->name, rival_names[0], rival->rms) : NULL;
        if (!ours) continue;
        printf("| %s | %s:", c->title, rival->who);
        print_side(rival), print_side(ours);
        const double times = without_start(rival) / without_start(ours);
        printf(" %.*f |\n", times < 10, times);
    }
}

/* The default mode, if it is there, beside the quickest picture of Cycles that takes no less time. */
static void print_default(const contest *c, const entry *entries, int count) {
    const entry *own = NULL, *other = NULL;
    for (int i = 0; i < count; ++i)
        if (!strcmp(entries[i].scene, c->name) && !strcmp(entries[i].setting, "default")) own = entries + i;
    for (int i = 0; own && i < count; ++i) {
        const entry *e = entries + i;
        if (strcmp(e->scene, c->name) != 0 || strcmp(e->who, rival_names[1]) != 0) continue;
        if (without_start(e) < without_start(own)) continue;
        if (!other || without_start(e) < without_start(other)) other = e;
    }
    if (!other) return;
    printf("\nThe default mode, with nothing set, and %s with the fewest samples that take as long:\n\n"
           "| scene | splatshadow | error | time | memory | %s | error | time | memory |\n"
           "|---|---|---|---|---|---|---|---|---|\n| %s |",
           other->who, other->who, c->title);
    print_side(own), print_side(other);
    printf("\n");
}

static int takes_part(const entry *entries, int count, const char *who) {
    for (int i = 0; i < count; ++i)
        if (!strcmp(entries[i].who, who)) return 1;
    return 0;
}

static void draw_curves(const entry *entries, int count, const char *folder) {
    static const ex_mark marks[RIVALS] = {EX_MARK_DISC, EX_MARK_SQUARE, EX_MARK_CROSS, EX_MARK_RHOMB, EX_MARK_RING};
    static const unsigned colors[RIVALS] = {0x1060c0, 0xc04010, 0x108040, 0x8030a0, 0x806000};
    enum { ACROSS = 3, WIDE = 270, HIGH = 220 };
    ex_canvas canvas = ex_canvas_begin(ACROSS * WIDE + 10, (CONTESTS + ACROSS - 1) / ACROSS * HIGH + 30, 1);
    ex_error error;
    for (int s = 0; s < CONTESTS; ++s) {
        ex_chart chart = {s % ACROSS * WIDE + 40,
                          s / ACROSS * HIGH + 24,
                          WIDE - 60,
                          HIGH - 64,
                          {0, 0},
                          {0, 0},
                          contests[s].title,
                          s == 0 ? "seconds without start-up" : "",
                          0};
        for (int i = 0; i < count; ++i)
            if (!strcmp(entries[i].scene, contests[s].name))
                ex_chart_reach(&chart, without_start(entries + i), 100 * entries[i].rms);
        if (!(chart.x[0] > 0)) continue;
        ex_chart_widen(&chart), ex_chart_frame(&canvas, &chart);
        for (int r = 0; r < RIVALS; ++r) {
            double points[ROWS][2];
            int found = 0;
            for (int i = 0; i < count; ++i) {
                if (strcmp(entries[i].scene, contests[s].name) != 0 || strcmp(entries[i].who, rival_names[r]) != 0)
                    continue;
                points[found][0] = without_start(entries + i);
                points[found++][1] = 100 * entries[i].rms;
            }
            ex_chart_curve(&canvas, &chart, (const double(*)[2])points, found, marks[r], colors[r]);
        }
    }
    for (int r = 0, keys = 0; r < RIVALS; ++r)
        if (takes_part(entries, count, rival_names[r]))
            ex_chart_key(&canvas, 40 + 150 * keys++, canvas.height - 18, rival_names[r], marks[r], colors[r]);
    ex_stop_if(ex_canvas_write(&canvas, folder, "rivals_curves", &error), program, &error);
    ex_canvas_end(&canvas);
}

/* A row per scene: of each contestant its last picture, which is its best. */
static void draw_pictures(const entry *entries, int count, const char *folder) {
    enum { SHRINK = 2, TILE = SIZE / SHRINK + 4 };
    ex_canvas canvas = ex_canvas_begin(RIVALS * TILE, CONTESTS * (TILE + 10), 1);
    ex_error error;
    for (int s = 0; s < CONTESTS; ++s)
        for (int r = 0; r < RIVALS; ++r)
            for (int i = count - 1; i >= 0; --i) {
                const entry *e = entries + i;
                if (strcmp(e->scene, contests[s].name) != 0 || strcmp(e->who, rival_names[r]) != 0) continue;
                ex_canvas_picture(&canvas, r * TILE, s * (TILE + 10), e->picture.rgba, SIZE, SIZE, SHRINK, e->who);
                break;
            }
    ex_stop_if(ex_canvas_write(&canvas, folder, "rivals_pictures", &error), program, &error);
    ex_canvas_end(&canvas);
}

static void print_page(const char *folder, const char *results, const char *truths) {
    static entry entries[ROWS];
    const int count = read_entries(results, entries);
    FILE *tables = open_in(truths, "tables.md", "w");
    if (!tables) exit(1);
    printf("\n| scene | rival | error | time | memory | splatshadow | error | time | memory | times faster |\n"
           "|---|---|---|---|---|---|---|---|---|---|\n");
    for (int s = 0; s < CONTESTS; ++s) {
        pixels t;
        if (read_pixels(truths, contests[s].name, &t)) continue;
        for (int i = 0; i < count; ++i)
            if (!strcmp(entries[i].scene, contests[s].name)) measure(&t, entries + i);
        print_scene(tables, contests + s, &t, entries, count);
        print_duels(contests + s, entries, count);
        free(t.values);
    }
    for (int s = 0; s < CONTESTS; ++s) print_default(contests + s, entries, count);
    fclose(tables);
    printf("\n![Error against time](rivals_curves.png)\n\nError in percent against seconds without start-up.\n\n"
           "![The best picture of each](rivals_pictures.png)\n\nThe best picture of each.\n");
    draw_curves(entries, count, folder);
    draw_pictures(entries, count, folder);
    for (int i = 0; i < count; ++i) free(entries[i].picture.rgba);
}

/* ==================================================================================================== main */

static contest *find_contest(const char *name) {
    for (int i = 0; i < CONTESTS; ++i)
        if (!strcmp(contests[i].name, name)) return contests + i;
    return NULL;
}

static int usage(void) {
    fprintf(stderr,
            "%s prepare|truth SCENE FOLDER, ours SCENE GRADE SIZE FILE, time COMMAND..., page FOLDER RESULTS "
            "TRUTHS\n",
            program);
    return EX_MISTAKEN;
}

int main(int argc, char **argv) {
    const char *mode = argc > 1 ? argv[1] : "";
    if (!strcmp(mode, "time") && argc > 2) {
        time_command(argv + 2);
        return EX_OK;
    }
    if (!strcmp(mode, "page") && argc == 5) {
        print_page(argv[2], argv[3], argv[4]);
        return EX_OK;
    }
    contest *c = argc > 3 ? find_contest(argv[2]) : NULL;
    if (!c) return usage();
    if (c->build(c)) return NO_DATA;
    if (!strcmp(mode, "prepare"))
        prepare(c, argv[3]);
    else if (!strcmp(mode, "truth"))
        write_truth(c, argv[3]);
    else if (!strcmp(mode, "ours") && argc == 6)
        render_ours(c, (int)ex_clamp(atoi(argv[3]), 0, GRADES - 1), atoi(argv[4]), argv[5]);
    else
        return usage();
    contest_end(c);
    return EX_OK;
}
