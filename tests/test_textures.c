/* shade_fn: texture coordinates and other properties of the points that it receives, against exact answers; what it
   sets, against the same scene without it and against the reference; its calls; its failures; and what it costs scenes
   that have none. */

#include "check.h"
#include "splatshadow.h"

enum { WIDTH = 97, HEIGHT = 75, PIXELS = WIDTH * HEIGHT };
static float image_a[4 * PIXELS], image_b[4 * PIXELS];
static sps_context *context;
static check_triangles ground, body;

/* ---------------------------------------------------------------------------------------------------------- helpers */

/* What a shade_fn has received, and what it is to do. */
typedef struct record {
    sps_surface_point points[PIXELS];
    size_t count, calls, most;     /* points, calls, points of the largest call */
    int meshes[PIXELS];            /* per call: the mesh of its points, -1: of several */
    size_t fail_call, spoil_point; /* from 1; 0: none */
    int spoil;                     /* of color and emission, which of six numbers becomes `value` */
    float value, color[3], emission[3];
    int keeps; /* 1: sets nothing */
} record;

static int record_points(void *user, size_t count, const sps_surface_point *points, sps_surface *out) {
    record *l = (record *)user;
    if (++l->calls == l->fail_call) return 12;
    l->most = count > l->most ? count : l->most;
    l->meshes[l->calls - 1] = points[0].mesh;
    for (size_t i = 0; i < count; ++i) {
        if (points[i].mesh != points[0].mesh) l->meshes[l->calls - 1] = -1;
        if (l->count < PIXELS) l->points[l->count] = points[i];
        l->count += 1;
        if (!l->keeps) {
            memcpy(out[i].albedo, l->color, sizeof l->color);
            memcpy(out[i].emission, l->emission, sizeof l->emission);
        }
        if (l->count != l->spoil_point) continue;
        if (l->spoil < 3)
            out[i].albedo[l->spoil] = l->value;
        else
            out[i].emission[l->spoil - 3] = l->value;
    }
    return 0;
}

static record seen, seen_too;

static void record_clear(record *l) {
    memset(l, 0, sizeof *l);
    l->keeps = 1;
}

static sps_mesh *shade(sps_mesh *mesh, record *l) {
    mesh->shade_fn = record_points;
    mesh->shade_user = l;
    return mesh;
}

/* Empties what tests share. */
static void start(check_scene *s, int width, int height) {
    check_clear(s, width, height);
    ground.count = body.count = 0;
    record_clear(&seen);
    record_clear(&seen_too);
}

static sps_stats_report stats_now(void) {
    sps_stats_report stats;
    sps_get_stats(context, &stats);
    return stats;
}

/* Texture coordinates of the last quad: `at` at its origin, and the sums with `along_u` and `along_v` at the other
   corners. */
static void put_uvs(check_triangles *triangles, const double at[2], const double along_u[2], const double along_v[2]) {
    static const int corners[2][3] = {{0, 1, 2}, {0, 2, 3}};
    for (int half = 0; half < 2; ++half)
        for (int k = 0; k < 3; ++k)
            for (int i = 0; i < 2; ++i) {
                const int corner = corners[half][k];
                triangles->list[triangles->count - 2 + (size_t)half].uv[k][i] =
                    (float)(at[i] + (corner == 1 || corner == 2 ? along_u[i] : 0) + (corner > 1 ? along_v[i] : 0));
            }
}

/* A shade_fn: a checker of 1 by 1, whose cells shine in proportion to the whole part of u + v. */
static int checker(void *user, size_t count, const sps_surface_point *points, sps_surface *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i) {
        const int cell = ((int)floor(points[i].uv[0]) + (int)floor(points[i].uv[1])) & 1;
        check_color(out[i].albedo, cell ? 0.8 : 0.1, cell ? 0.7 : 0.2, 0.3);
        out[i].emission[2] = cell ? 0.05f : 0;
    }
    return 0;
}

/* Gas above a ground, with a directional and a point light: bits of everything that light on surfaces has. */
static float one = 1;

static void add_gas_and_lights(check_scene *s) {
    sps_volume *gas = check_add_volume(s, 8, 8, 8, check_box(-0.5, -0.6, -0.5, 0.5, 0.2, 0.5));
    gas->read_fn = check_read_constant;
    gas->user = &one;
    gas->extinction = 2;
    check_color(gas->albedo, 0.9, 0.8, 0.7);
    check_add_directional(s, 0.6, -1, -0.5, 3);
    check_color(check_add_point(s, -1.5, 2.5, 2, 1)->color, 4, 6, 9);
    check_color(s->scene.ambient, 0.1, 0.1, 0.2);
    check_color(s->scene.background, 0.3, 0.4, 0.5);
    check_set3(s->view.camera.position, 0.7, 1.2, 4);
    check_perspective(&s->view.camera, 0.6);
    s->view.shadow_resolution = 60;
}

/* The ground has 4 by 4 cells of the checker. */
static void add_ground(void) {
    const double origin[3] = {-2, -1, 2}, u[3] = {4, 0, 0}, v[3] = {0, 0, -4};
    const double at[2] = {0.25, -0.5}, along_u[2] = {4, 0}, along_v[2] = {0, 4};
    check_add_quad(&ground, origin, u, v);
    put_uvs(&ground, at, along_u, along_v);
}

static void add_wall(void) {
    const double origin[3] = {-0.75, -1, -0.5}, u[3] = {1.5, 0, 0.25}, v[3] = {0.125, 1.25, 0};
    const double at[2] = {0, 0}, along_u[2] = {3, 0}, along_v[2] = {0, 3};
    check_add_quad(&body, origin, u, v);
    put_uvs(&body, at, along_u, along_v);
}

/* ------------------------------------------------------------------------------------------------- what points hold */

/* A tilted quad, whose corners floats hold exactly. */
static const double quad[3][3] = {{-3, -2.5, 1.5}, {7, 0.5, -4}, {-1, 6, -2}};
static const double quad_uv[3][2] = {{0.25, 7}, {5, -1}, {-2, 3}};

/* The point of the quad on the ray through (x, y), and its texture coordinates. The camera is at (0, 0, 10) and looks
   along -z; `pitch` is the width of a pixel, in perspective at a distance of 1. */
static void quad_at(const check_scene *s, double pitch, double x, double y, double point[3], double uv[2]) {
    const double right = (x - 0.5 * (s->view.width - 1)) * pitch, up = (0.5 * (s->view.height - 1) - y) * pitch;
    const int wide = s->view.camera.field_of_view > 0;
    const double from[3] = {wide ? 0 : right, wide ? 0 : up, 10}, ray[3] = {wide ? right : 0, wide ? up : 0, -1};
    double normal[3], offset[3], cross[3], square, share[2];
    vec_cross(quad[1], quad[2], normal);
    square = vec_dot(normal, normal);
    vec_along(quad[0], from, -1, offset);
    vec_along(from, ray, vec_dot(normal, offset) / vec_dot(normal, ray), point);
    vec_along(point, quad[0], -1, offset);
    vec_cross(offset, quad[2], cross);
    share[0] = vec_dot(cross, normal) / square;
    vec_cross(quad[1], offset, cross);
    share[1] = vec_dot(cross, normal) / square;
    for (int i = 0; i < 2; ++i) uv[i] = quad_uv[0][i] + share[0] * quad_uv[1][i] + share[1] * quad_uv[2][i];
}

/* Weights are floats, whose rounding is 2^-25 of at most 1 for each of two, and the third is 1 minus both: each
   texture coordinate is off by at most 2^-24 of the triangle's range of them, which is below 10. Points are computed in
   double precision. */
#define UV_EXACT (10 / 16777216.0)

/* Checks a point of the quad, and the difference quotients of its texture coordinates. */
static int check_quad_point(const check_scene *s, double pitch, const sps_surface_point *p) {
    double point[3], uv[2], normal[3], before[2], after[2], unused[3];
    int good = 1;
    quad_at(s, pitch, p->x, p->y, point, uv);
    vec_cross(quad[1], quad[2], normal);
    vec_normalise(normal);
    if (normal[2] < 0) vec_along(normal, normal, -2, normal);
    for (int i = 0; i < 3; ++i) {
        good &= CHECK_NEAR(p->position[i], point[i], 1e-12);
        good &= CHECK_NEAR((double)p->normal[i], normal[i], 1e-7);
    }
    for (int i = 0; i < 2; ++i) good &= CHECK_NEAR(p->uv[i], uv[i], UV_EXACT);
    for (int axis = 0; axis < 2; ++axis) {
        const float *change = axis ? p->uv_dy : p->uv_dx;
        const double dx = axis ? 0 : 1e-3, dy = axis ? 1e-3 : 0;
        quad_at(s, pitch, p->x - dx, p->y - dy, unused, before);
        quad_at(s, pitch, p->x + dx, p->y + dy, unused, after);
        /* second order in 1e-3 of a pixel, of which a third derivative takes some 1e-3; and the floats' rounding */
        for (int i = 0; i < 2; ++i)
            good &= CHECK_NEAR((double)change[i], (after[i] - before[i]) / 2e-3, 1e-6 * fabs(change[i]) + 1e-7);
    }
    return good;
}

/* Also that each pixel comes once, in rows from the top. */
static void test_points(void) {
    for (int wide = 0; wide < 2; ++wide) {
        const double pitch = wide ? 2 * tan(0.45) / 37 : 7.0 / 37;
        check_scene s;
        size_t covered = 0;
        start(&s, 53, 37);
        check_orthographic(&s.view.camera, wide ? 0 : 7);
        check_perspective(&s.view.camera, wide ? 0.9 : 0);
        check_add_quad(&ground, quad[0], quad[1], quad[2]);
        put_uvs(&ground, quad_uv[0], quad_uv[1], quad_uv[2]);
        shade(check_add_mesh(&s, &ground, 0.5), &seen);
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 53 * 37; ++i) covered += image_a[4 * i + 3] > 0;
        CHECK(seen.count == covered && covered > 400 && covered < 53 * 37);
        CHECK(stats_now().surface_points == covered && stats_now().pixels_of_polygons == covered);
        CHECK(seen.calls == 1 && stats_now().shade_calls == 1);
        for (size_t i = 0; i < seen.count; ++i) {
            const sps_surface_point *p = &seen.points[i];
            if (!CHECK(p->mesh == 0 && p->triangle < 2 && image_a[4 * (p->y * 53 + p->x) + 3] == 1) ||
                !check_quad_point(&s, pitch, p)) {
                printf("    wide %d, pixel %d, %d\n", wide, p->x, p->y);
                break;
            }
            if (i > 0) CHECK(p->y * 53 + p->x > p[-1].y * 53 + p[-1].x);
        }
    }
}

/* Weights interpolate the corners' positions to the point; triangles are numbered with those that have no area. */
static void test_weights_and_numbers(void) {
    check_scene s;
    size_t of[3] = {0};
    start(&s, 31, 29);
    check_orthographic(&s.view.camera, 7);
    check_add_triangle(&ground); /* of no area */
    check_add_quad(&ground, quad[0], quad[1], quad[2]);
    put_uvs(&ground, quad_uv[0], quad_uv[1], quad_uv[2]);
    shade(check_add_mesh(&s, &ground, 0.5), &seen);
    if (!check_render(context, &s, image_a)) return;
    for (size_t i = 0; i < seen.count; ++i) {
        const sps_surface_point *p = &seen.points[i];
        const sps_triangle *t = &ground.list[p->triangle < 3 ? p->triangle : 0];
        CHECK(p->triangle > 0 && p->triangle < 3);
        of[p->triangle] += 1;
        CHECK_NEAR((double)p->weights[0] + (double)p->weights[1] + (double)p->weights[2], 1, 2e-7);
        for (int c = 0; c < 3; ++c) {
            double sum = 0;
            for (int k = 0; k < 3; ++k) sum += (double)p->weights[k] * (double)t->position[k][c];
            CHECK_NEAR(sum, p->position[c], UV_EXACT);
        }
    }
    CHECK(of[1] > 50 && of[2] > 50);
}

/* Normals of the corners are interpolated, and turned to the eye, as they are for light: a point's radiance is
   color / pi * irradiance * cosine with the normal that it was given. */
static void test_normals(void) {
    static const double normals[3][3] = {{-0.3, -0.2, -1}, {0.5, 0.1, -0.8}, {0.1, 0.9, -2}};
    const double toward[3] = {0.5 / sqrt(1.5), -0.5 / sqrt(1.5), 1 / sqrt(1.5)};
    check_scene s;
    start(&s, 31, 29);
    check_orthographic(&s.view.camera, 3);
    check_add_corners(&ground, quad[0], quad[1], quad[2]);
    for (int k = 0; k < 3; ++k)
        for (int c = 0; c < 3; ++c) ground.list[0].normal[k][c] = (float)normals[k][c];
    shade(check_add_mesh(&s, &ground, 0.5), &seen)->has_normals = 1;
    check_add_directional(&s, -toward[0], -toward[1], -toward[2], 2)->no_shadow = 1;
    if (!check_render(context, &s, image_a)) return;
    CHECK(seen.count > 300);
    for (size_t i = 0; i < seen.count; ++i) {
        const sps_surface_point *p = &seen.points[i];
        const double n[3] = {(double)p->normal[0], (double)p->normal[1], (double)p->normal[2]};
        CHECK(n[2] > 0);
        CHECK_NEAR(vec_length(n), 1, 2e-7);
        CHECK_NEAR((double)image_a[4 * (p->y * 31 + p->x)], 0.5 / PI * 2 * fmax(0, vec_dot(n, toward)), 1e-6);
    }
}

/* Seen nearly edge-on by one row of pixels, a triangle's coordinates change much, but not infinitely. */
static void test_edge_on(void) {
    for (int n = 0; n < 3; ++n) { /* the last one with coordinates that are as large as they may be */
        const double rise = 1e-9;
        const double origin[3] = {-1, -rise, -4}, u[3] = {2, 0, 0}, v[3] = {0, 2 * rise, 8};
        const double at[2] = {0, 0}, along_u[2] = {2, 0}, along_v[2] = {0, n == 2 ? 1e38 : 1e4};
        check_scene s;
        start(&s, 31, 31);
        check_perspective(&s.view.camera, n == 1 ? 0.2 : 0);
        check_add_quad(&ground, origin, u, v);
        put_uvs(&ground, at, along_u, along_v);
        shade(check_add_mesh(&s, &ground, 0.5), &seen);
        if (!check_render(context, &s, image_a)) return;
        CHECK(seen.count > 0);
        for (size_t i = 0; i < seen.count; ++i) {
            const sps_surface_point *p = &seen.points[i];
            for (int k = 0; k < 2; ++k) CHECK(fabsf(p->uv_dx[k]) <= 1e30f && fabsf(p->uv_dy[k]) <= 1e30f);
            CHECK(fabsf(p->uv_dy[1]) > 1e10f);
        }
    }
}

/* ---------------------------------------------------------------------------------------------------- what they set */

/* A shade_fn that leaves the mesh's own color leaves the picture, to the bit; that of corners, to a float's rounding.
   The scene is grey without it: one channel of radiance stands for three. */
static void test_own_color(void) {
    for (int n = 0; n < 8; ++n) {
        const int colors = n & 1, grey = n >> 1 & 1, reference = n >> 2;
        const size_t floats = 4 * (size_t)(reference ? 24 * 24 : PIXELS);
        check_scene s;
        start(&s, WIDTH, HEIGHT);
        add_gas_and_lights(&s);
        add_ground();
        add_wall();
        for (int i = 0; i < 9; ++i) body.list[1].albedo[i / 3][i % 3] = 0.1f * (float)(i + 1);
        check_color(check_add_mesh(&s, &ground, 0.5)->albedo, 0.3, 0.6, 0.7);
        check_add_mesh(&s, &body, 0.3)->has_albedos = colors;
        if (grey) {
            check_color(s.mesh[0].albedo, 0.3, 0.3, 0.3);
            check_color(s.volume[0].albedo, 0.3, 0.3, 0.3);
            check_color(s.scene.ambient, 0.3, 0.3, 0.3);
            check_color(s.scene.background, 0.3, 0.3, 0.3);
            check_color(s.light[1].color, 3, 3, 3);
        }
        if (reference) s.view.width = s.view.height = 24;
        for (int shaded = 0; shaded < 2; ++shaded) {
            float *image = shaded ? image_b : image_a;
            if (shaded) shade(&s.mesh[0], &seen), shade(&s.mesh[1], &seen);
            if (!(reference ? check_march(context, &s, 4, image, NULL) : check_render(context, &s, image))) return;
        }
        CHECK(seen.count > 100);
        if (colors)
            CHECK(check_largest(image_a, image_b, floats) <= 4e-7);
        else
            CHECK(memcmp(image_a, image_b, floats * sizeof(float)) == 0);
    }
}

/* color (ambient + irradiance cosine / pi) + emission, in sps_render and in sps_reference; emission also without any
   light, and once where there are two sweeps. */
static void test_terms(void) {
    for (int n = 0; n < 6; ++n) {
        const int lights = n % 3, reference = n / 3;
        check_scene s;
        start(&s, 9, 7);
        add_wall();
        shade(check_add_mesh(&s, &body, 0.5), &seen);
        check_set3(s.view.camera.target, 0, 0, 0);
        check_orthographic(&s.view.camera, 0.25);
        seen.keeps = 0;
        check_color(seen.color, 0.2, 0.4, 1);
        check_color(seen.emission, 3, 0, 0.5);
        if (lights) check_color(s.scene.ambient, 0.5, 0.25, 0.125);
        for (int i = 0; i < lights; ++i) check_add_directional(&s, 0, 0, -1, 2);
        if (!(reference ? check_march(context, &s, 1, image_a, NULL) : check_render(context, &s, image_a))) return;
        for (int i = 0; i < 63; ++i) {
            const double cosine = (double)seen.points[i].normal[2];
            for (int c = 0; c < 3; ++c) {
                const double light = (lights ? (double)s.scene.ambient[c] : 0) + lights * 2 * cosine / PI;
                CHECK_NEAR((double)image_a[4 * i + c], (double)seen.color[c] * light + (double)seen.emission[c], 2e-6);
            }
        }
        CHECK(seen.count == 63);
    }
}

/* With gas that each light shades by sheets of its own there are two sweeps, of which one adds emission. */
static void test_emission_once(void) {
    check_scene s;
    start(&s, 24, 24);
    add_gas_and_lights(&s);
    add_ground();
    shade(check_add_mesh(&s, &ground, 0.5), &seen);
    s.light[0].no_shadow = 0;
    check_force_sheets(&s);
    seen.keeps = 0;
    for (int lit = 0; lit < 2; ++lit) {
        check_color(seen.emission, lit * 0.5, lit * 0.5, lit * 0.5);
        if (!check_render(context, &s, lit ? image_b : image_a)) return;
    }
    {
        sps_plan_report plan;
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
        CHECK(plan.sweep_count == 2);
    }
    for (size_t i = 0; i < seen.count; ++i) {
        const int at = 4 * (seen.points[i].y * 24 + seen.points[i].x);
        CHECK((double)image_b[at] - (double)image_a[at] <= 0.5 + 1e-6);
    }
    CHECK_NEAR((double)image_b[4 * (23 * 24 + 2)] - (double)image_a[4 * (23 * 24 + 2)], 0.5, 1e-6); /* beside the gas */
}

/* A checker on ground and wall, under gas and in its shadow. As in test_mixed_scene of test_polygons.c, edges of
   shadows may be up to half a texel off, which turns up to 8 pixels; cells of the checker are shaded in double
   precision, and none of their edges may move. */
static void test_checker_against_reference(void) {
    check_scene s;
    double most = 0;
    int far = 0;
    start(&s, 32, 24);
    add_gas_and_lights(&s);
    add_ground();
    add_wall();
    check_add_mesh(&s, &ground, 0.5)->shade_fn = checker;
    check_add_mesh(&s, &body, 0.5)->shade_fn = checker;
    s.view.quality = SPS_QUALITY_HIGH;
    s.view.shadow_resolution = 100;
    if (!check_render(context, &s, image_a) || !check_march(context, &s, 0.5, image_b, NULL)) return;
    for (int i = 0; i < 4 * 768; ++i) most = fmax(most, (double)image_b[i]);
    for (int i = 0; i < 768; ++i) far += check_largest(image_a + 4 * i, image_b + 4 * i, 4) > 0.004 * most;
    printf("checker: error %.2e, %d pixels beyond 0.004\n", check_rms(image_a, image_b, 4 * 768) / most, far);
    CHECK_NEAR(check_rms(image_a, image_b, 4 * 768) / most, 0, 0.01);
    CHECK(far <= 8);
}

/* ----------------------------------------------------------------------------------------------------------- calls */

/* Any number of workers: the same calls with the same points in the same order, and the same picture. */
static void test_workers(void) {
    check_scene s;
    start(&s, WIDTH, HEIGHT);
    add_gas_and_lights(&s);
    add_ground();
    add_wall();
    check_add_mesh(&s, &ground, 0.5);
    check_add_mesh(&s, &body, 0.5);
    for (int workers = 0; workers < 4; ++workers) {
        record *now = workers ? &seen_too : &seen;
        check_hooks hooks;
        sps_context *other;
        memset(&hooks, 0, sizeof hooks);
        hooks.worker_count = workers ? 2 * workers - 1 : 0;
        hooks.order = (uint64_t)workers;
        other = check_context(&hooks);
        record_clear(now);
        shade(&s.mesh[0], now), shade(&s.mesh[1], now);
        check_render(other, &s, workers ? image_b : image_a);
        sps_destroy(other);
        if (!workers) continue;
        CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
        CHECK(seen.count == seen_too.count && seen.calls == seen_too.calls && seen.count > 1000);
        for (size_t i = 0; i < seen.count; ++i) {
            const sps_surface_point *a = &seen.points[i], *b = &seen_too.points[i];
            CHECK(a->x == b->x && a->y == b->y && a->mesh == b->mesh && a->triangle == b->triangle);
            CHECK(memcmp(a->position, b->position, sizeof a->position) == 0);
            CHECK(memcmp(a->uv, b->uv, sizeof a->uv) == 0 && memcmp(a->uv_dx, b->uv_dx, sizeof a->uv_dx) == 0);
        }
    }
}

/* A region has the bits of the whole image, and only its points are shaded. */
static void test_regions(void) {
    static const int regions[3][4] = {{0, 0, 1, 1}, {13, 9, 61, 40}, {70, 64, 27, 11}};
    for (int n = 0; n < 6; ++n) {
        const int *region = regions[n % 3], reference = n / 3;
        size_t differ = 0, outside = 0, covered = 0;
        check_hooks hooks;
        sps_context *fresh;
        check_scene s;
        start(&s, WIDTH, HEIGHT);
        add_gas_and_lights(&s);
        add_ground();
        add_wall();
        check_add_mesh(&s, &ground, 0.5)->shade_fn = checker;
        check_add_mesh(&s, &body, 0.5)->shade_fn = checker;
        if (!(reference ? check_march(context, &s, 4, image_a, NULL) : check_render(context, &s, image_a))) return;
        memcpy(s.view.region, region, sizeof s.view.region);
        memset(&hooks, 0, sizeof hooks);
        fresh = check_context(&hooks); /* which holds nothing of the whole image */
        if (reference)
            check_march(fresh, &s, 4, image_b, NULL);
        else
            check_render(fresh, &s, image_b);
        sps_destroy(fresh);
        for (int y = 0; y < region[3]; ++y)
            differ += memcmp(image_a + 4 * ((region[1] + y) * WIDTH + region[0]), image_b + 4 * y * region[2],
                             4 * (size_t)region[2] * sizeof(float)) != 0;
        if (!CHECK(differ == 0)) printf("    region %d, reference %d\n", n % 3, reference);
        shade(&s.mesh[0], &seen), shade(&s.mesh[1], &seen);
        if (!(reference ? check_march(context, &s, 4, image_b, NULL) : check_render(context, &s, image_b))) return;
        for (size_t i = 0; i < seen.count; ++i)
            outside += seen.points[i].x < region[0] || seen.points[i].x >= region[0] + region[2] ||
                       seen.points[i].y < region[1] || seen.points[i].y >= region[1] + region[3];
        if (!reference) /* gas alone is not opaque */
            for (int i = 0; i < region[2] * region[3]; ++i) covered += image_b[4 * i + 3] >= 1;
        CHECK(outside == 0 && (reference || seen.count == covered));
        CHECK(stats_now().surface_points == seen.count);
    }
}

/* Three meshes that alternate from row to row and from pixel to pixel, the middle one without shade_fn: calls of up to
   4096 points, each of one mesh, and each point once. */
static void test_batches(void) {
    check_scene s;
    record *logs[2] = {&seen, &seen_too};
    start(&s, WIDTH, HEIGHT);
    check_orthographic(&s.view.camera, HEIGHT);
    for (int x = 0; x < WIDTH; ++x) {
        const double origin[3] = {x - 0.5 * WIDTH, -0.5 * HEIGHT, 0}, u[3] = {1, 0, 0}, v[3] = {0, HEIGHT, 0};
        const double at[2] = {(double)x, 0}, along[2] = {0, 0};
        check_add_quad(x % 3 == 0 ? &ground : &body, origin, u, v);
        put_uvs(x % 3 == 0 ? &ground : &body, at, along, along);
    }
    shade(check_add_mesh(&s, &ground, 0.25), &seen);
    check_add_mesh(&s, &body, 0.5)->triangle_count = 0; /* has no place among those that are read */
    s.mesh[1].shade_fn = record_points;
    check_add_mesh(&s, &body, 0.5)->triangle_count = 32;
    shade(check_add_mesh(&s, &body, 0.75), &seen_too);
    seen.keeps = seen_too.keeps = 0;
    check_color(s.scene.ambient, 1, 1, 1);
    check_color(seen.color, 0.125, 0.125, 0.125);
    check_color(seen_too.color, 1, 1, 1);
    if (!check_render(context, &s, image_a)) return;
    for (int i = 0; i < 2; ++i) {
        size_t least = (size_t)(i ? 40 : 33) * HEIGHT / 2;
        CHECK(logs[i]->most <= 4096 && logs[i]->count >= least &&
              logs[i]->calls == (logs[i]->count + 4095) / 4096);
        for (size_t k = 0; k < logs[i]->calls; ++k) CHECK(logs[i]->meshes[k] == (i ? 3 : 0));
        for (size_t k = 0; k < logs[i]->count; ++k) CHECK_NEAR(logs[i]->points[k].uv[0], logs[i]->points[k].x, 1e-5);
    }
    CHECK(stats_now().surface_points == seen.count + seen_too.count && stats_now().shade_calls == seen.calls + seen_too.calls);
    for (int i = 0; i < PIXELS; ++i) {
        const int x = i % WIDTH, quad_of = x - x / 3 - 1; /* among those of `body` */
        const float wanted = x % 3 == 0 ? 0.125f : quad_of < 16 ? 0.5f : 1;
        if (!CHECK(image_a[4 * i] == wanted || (x % 3 != 0 && quad_of < 16 && image_a[4 * i] == 1))) {
            printf("    pixel %d, %d: %g\n", x, i / WIDTH, (double)image_a[4 * i]);
            break;
        }
    }
}

/* Nothing to shade: no triangles, none in the image, none in the region, all hidden. */
static void test_nothing_to_shade(void) {
    for (int n = 0; n < 4; ++n) {
        const double before[3] = {-5, -5, 1}, u[3] = {10, 0, 0}, v[3] = {0, 10, 0};
        check_scene s;
        start(&s, 40, 30);
        add_wall();
        shade(check_add_mesh(&s, &body, 0.5), &seen);
        check_orthographic(&s.view.camera, 4);
        if (n == 0) s.mesh[0].triangle_count = 0, s.mesh[0].read_fn = NULL;
        if (n == 1) s.view.camera.position[0] = s.view.camera.target[0] = 9;
        if (n == 2) s.view.region[2] = s.view.region[3] = 2;
        if (n == 3) check_add_quad(&ground, before, u, v), check_add_mesh(&s, &ground, 0.5);
        CHECK(check_render(context, &s, image_a) && check_march(context, &s, 1, image_b, NULL));
        CHECK(seen.calls == 0 && stats_now().surface_points == 0 && stats_now().shade_calls == 0);
    }
}

/* Triangles that are kept for the next call keep their texture coordinates; a shade_fn that is added, or that others
   than a picture pass by, changes nothing about that. */
static void test_revision(void) {
    static float again[4 * PIXELS];
    check_scene s;
    sps_tmap_light light;
    sps_tmap_settings settings;
    sps_tmap *map = NULL;
    start(&s, WIDTH, HEIGHT);
    add_gas_and_lights(&s);
    add_ground();
    check_add_mesh(&s, &ground, 0.5)->revision = 1;
    check_render(context, &s, image_b);
    for (int n = 0; n < 4; ++n) {
        s.mesh[0].shade_fn = n == 3 ? NULL : checker;
        if (n == 2) {
            light = check_light_of(&s.view);
            memset(&settings, 0, sizeof settings);
            settings.far_depth = 9;
            CHECK_OK(context, sps_tmap_create(context, &light, &settings, &map));
            CHECK_OK(context, sps_tmap_add(map, &s.scene));
            CHECK_OK(context, sps_tmap_finish(map));
            CHECK(stats_now().surface_points == 0 && stats_now().triangle_calls == 0);
            sps_tmap_destroy(map);
        }
        check_render(context, &s, n == 0 ? image_a : again);
        CHECK(stats_now().triangle_calls == (n == 0 || n == 3));
        CHECK(memcmp(n < 3 ? image_a : image_b, n == 0 ? image_a : again, sizeof image_a) == 0);
    }
    CHECK(memcmp(image_a, image_b, sizeof image_a) != 0);
}

/* sps_indexed_mesh.uvs, packed and with a stride; NULL: zeros. */
static void test_indexed_uvs(void) {
    static const float vertices[4][6] = {
        {-3, -3, 0, 0, 0.5f, 2}, {3, -3, 0, 0, 2.5f, 2}, {3, 3, 0, 0, 2.5f, 6}, {-3, 3, 0, 0, 0.5f, 6}};
    static const float packed[8] = {0.5f, 2, 2.5f, 2, 2.5f, 6, 0.5f, 6};
    static const uint16_t indices[6] = {0, 1, 2, 0, 2, 3};
    for (int n = 0; n < 3; ++n) {
        sps_indexed_mesh net;
        check_scene s;
        start(&s, 11, 11);
        memset(&net, 0, sizeof net);
        net.vertex_count = 4;
        net.positions = vertices[0];
        net.position_stride = sizeof vertices[0];
        net.uvs = n == 0 ? packed : n == 1 ? vertices[0] + 4 : NULL;
        net.uv_stride = n == 1 ? sizeof vertices[0] : 0;
        net.triangle_count = 2;
        net.indices_u16 = indices;
        shade(check_add_mesh(&s, &ground, 0.5), &seen);
        s.mesh[0].read_fn = sps_indexed_mesh_read;
        s.mesh[0].user = &net;
        s.mesh[0].triangle_count = 2;
        if (!check_render(context, &s, image_a)) return;
        CHECK(seen.count == 121);
        for (size_t i = 0; i < seen.count && n < 2; ++i) {
            CHECK_NEAR(seen.points[i].uv[0], 1.5 + seen.points[i].position[0] / 3, UV_EXACT);
            CHECK_NEAR(seen.points[i].uv[1], 4 + seen.points[i].position[1] * 2 / 3, UV_EXACT);
        }
        for (size_t i = 0; i < seen.count && n == 2; ++i)
            CHECK(seen.points[i].uv[0] == 0 && seen.points[i].uv[1] == 0 && seen.points[i].uv_dx[0] == 0);
    }
}

/* -------------------------------------------------------------------------------------------------------- failures */

static int untouched(const float *image) {
    for (int i = 0; i < 4 * PIXELS; ++i)
        if (!(image[i] == (float)-i)) return 0;
    return 1;
}

/* The call fails as `expected` with a sentence that begins so, names mesh 1 and its shade_fn, leaves the image as it
   was, and the next call succeeds. */
static void check_call_fails(check_scene *s, int reference, sps_result expected, const char *sentence) {
    sps_image image;
    sps_error_info info;
    sps_result result;
    memset(&image, 0, sizeof image);
    image.rgba = image_a;
    for (int i = 0; i < 4 * PIXELS; ++i) image_a[i] = (float)-i;
    result = reference ? check_reference(context, &s->scene, &s->view, 4, &image)
                       : sps_render(context, &s->scene, &s->view, &image);
    if (!CHECK(result == expected) || !CHECK(strcmp(sps_error(context), sentence) == 0))
        printf("    wanted \"%s\", got %d: %s\n", sentence, (int)result, sps_error(context));
    CHECK(check_error_info(context, expected) && untouched(image_a));
    sps_get_error(context, &info);
    CHECK(info.object == SPS_OBJECT_MESH && info.index == 1 && strncmp(info.field, "shade_fn", 8) == 0);
    record_clear(&seen);
    CHECK_OK(context, sps_render(context, &s->scene, &s->view, &image));
    CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
}

static void failing_scene(check_scene *s) {
    start(s, WIDTH, HEIGHT);
    add_gas_and_lights(s);
    add_ground();
    add_wall();
    check_add_mesh(s, &body, 0.5);
    shade(check_add_mesh(s, &ground, 0.5), &seen);
}

static void test_failing(void) {
    for (int reference = 0; reference < 2; ++reference) {
        check_scene s;
        failing_scene(&s);
        check_render(context, &s, image_b);
        record_clear(&seen);
        seen.fail_call = 1;
        check_call_fails(&s, reference, SPS_ERROR_CALLBACK, "mesh[1].shade_fn failed: it returned 12");
    }
}

static void test_bad_values(void) {
    static const struct {
        int spoil;
        float value;
        const char *sentence;
    } cases[] = {{0, -1, "mesh[1].shade_fn's albedo is -1; red, green and blue must be 0..1"},
                 {1, 1.5f, "mesh[1].shade_fn's albedo is 1.5; red, green and blue must be 0..1"},
                 {2, NAN, "mesh[1].shade_fn's albedo is nan; red, green and blue must be 0..1"},
                 {3, -2, "mesh[1].shade_fn's emission is -2; red, green and blue must be 0..1e18"},
                 {4, INFINITY, "mesh[1].shade_fn's emission is inf; red, green and blue must be 0..1e18"},
                 {5, NAN, "mesh[1].shade_fn's emission is nan; red, green and blue must be 0..1e18"}};
    for (int n = 0; n < 12; ++n) {
        check_scene s;
        size_t count;
        failing_scene(&s);
        check_render(context, &s, image_b);
        count = seen.count;
        record_clear(&seen);
        seen.spoil = cases[n % 6].spoil;
        seen.value = cases[n % 6].value;
        seen.spoil_point = n % 2 ? 1 : count;
        s.scene.replace_invalid = n % 4 == 0; /* is about volumes and particles */
        check_call_fails(&s, n / 6, SPS_ERROR_DATA, cases[n % 6].sentence);
    }
}

/* Texture coordinates must be finite, where they are read. */
static void test_bad_uvs(void) {
    for (int n = 0; n < 6; ++n) {
        check_scene s;
        sps_image image;
        failing_scene(&s);
        memset(&image, 0, sizeof image);
        image.rgba = image_a;
        ground.list[1].uv[n / 2][n % 2] = n % 3 ? INFINITY : NAN;
        CHECK(sps_render(context, &s.scene, &s.view, &image) == SPS_ERROR_DATA);
        CHECK(check_error_info(context, SPS_ERROR_DATA));
        CHECK(strcmp(sps_error(context), n % 3 ? "mesh[1].triangle[1].uv is inf; it must be finite"
                                               : "mesh[1].triangle[1].uv is nan; it must be finite") == 0);
        s.mesh[1].shade_fn = NULL;
        CHECK_OK(context, sps_render(context, &s.scene, &s.view, &image));
    }
}

/* Cancelled at any call of progress_fn, the image is untouched; between two batches no more points are shaded. */
static void test_cancel(void) {
    long n;
    int stopped = 0;
    check_scene s;
    start(&s, WIDTH, HEIGHT);
    check_orthographic(&s.view.camera, 1);
    check_add_quad(&ground, quad[0], quad[1], quad[2]);
    shade(check_add_mesh(&s, &ground, 0.5), &seen);
    check_add_directional(&s, 0, 0, -1, 2);
    for (n = 1; n < 1000; ++n) {
        check_cancel c = {0, n};
        sps_config config;
        sps_context *other;
        sps_image image;
        sps_result result;
        memset(&config, 0, sizeof config);
        memset(&image, 0, sizeof image);
        config.progress_fn = check_cancel_at;
        config.clock_fn = check_hasty_clock;
        config.progress_user = &c;
        image.rgba = image_a;
        for (int i = 0; i < 4 * PIXELS; ++i) image_a[i] = (float)-i;
        record_clear(&seen);
        other = sps_create(&config, NULL);
        result = sps_render(other, &s.scene, &s.view, &image);
        stopped += seen.calls == 1;
        sps_destroy(other);
        if (result == SPS_OK) break;
        CHECK(result == SPS_ERROR_CANCELLED && untouched(image_a));
    }
    CHECK(n > 10 && stopped > 3 && seen.calls == 2 && seen.count == PIXELS);
}

/* -------------------------------------------------------------------------------------------------- plan and memory */

/* The pass says why it is left out; with it, the plan's bytes bound what is held; without it, nothing is held. */
static void test_plan_and_memory(void) {
    static const char *const reasons[3] = {"no triangles", "no mesh has a shade_fn", "meshes have a shade_fn"};
    for (int n = 0; n < 3; ++n) {
        check_hooks hooks;
        sps_plan_report plan;
        sps_context *other;
        check_scene s;
        size_t held = 0;
        start(&s, WIDTH, HEIGHT);
        add_gas_and_lights(&s);
        add_ground();
        if (n > 0) check_add_mesh(&s, &ground, 0.5)->shade_fn = n > 1 ? checker : NULL;
        memset(&hooks, 0, sizeof hooks);
        other = check_context(&hooks);
        CHECK_OK(other, sps_plan(other, &s.scene, &s.view, &plan));
        CHECK(plan.pass[SPS_PASS_TEXTURES].runs == (n == 2));
        CHECK(strcmp(plan.pass[SPS_PASS_TEXTURES].reason, reasons[n]) == 0);
        CHECK(strcmp(sps_pass_name(SPS_PASS_TEXTURES), "textures") == 0);
        check_render(other, &s, image_a);
        held += other->buffers[SPSI_BUFFER_FACE_TEXTURES].size + other->buffers[SPSI_BUFFER_MESH_FACES].size;
        held += other->buffers[SPSI_BUFFER_SURFACES].size + other->buffers[SPSI_BUFFER_SURFACE_BATCH].size;
        if (n == 2) held += 4 * SPSI_LINK_BYTES; /* an allocation's own */
        CHECK(plan.pass[SPS_PASS_TEXTURES].bytes == held && (held > 0) == (n == 2));
        CHECK(hooks.peak <= plan.bytes);
        sps_destroy(other);
    }
}

/* A triangle covers the first columns of a pixel's samples, or the first rows: the point that it is shaded at is their
   middle. Pixels are 1 wide, samples a quarter; the triangle ends at 0.6, before the third of them. */
static void test_strips(void) {
    for (int n = 0; n < 2; ++n) {
        const double corners[2][3][3] = {{{-10, -20, 0}, {-0.4, -20, 0}, {-0.4, 20, 0}},
                                         {{-20, 10, 0}, {-20, 0.4, 0}, {20, 0.4, 0}}};
        check_scene s;
        check_clear(&s, 2, 2);
        check_orthographic(&s.view.camera, 2);
        s.view.coverage_samples = 4;
        ground.count = 0;
        check_add_corners(&ground, corners[n][0], corners[n][1], corners[n][2]);
        shade(check_add_mesh(&s, &ground, 0.5), &seen);
        check_color(s.scene.ambient, 1, 1, 1);
        record_clear(&seen);
        if (!check_render(context, &s, image_a)) return;
        CHECK(seen.count > 0);
        for (size_t i = 0; i < seen.count; ++i) {
            const sps_surface_point *at = &seen.points[i];
            CHECK(n ? at->y == 0 : at->x == 0);
            CHECK_NEAR(at->position[n], n ? 0.75 : -0.75, 1e-6);
            CHECK_NEAR(fabs(at->position[1 - n]), 0.5, 1e-6);
        }
        CHECK_NEAR((double)image_a[3], 0.5, 1e-6); /* 8 of 16 samples */
    }
}

int main(void) {
    context = sps_create(NULL, NULL);
    RUN(test_points);
    RUN(test_weights_and_numbers);
    RUN(test_normals);
    RUN(test_edge_on);
    RUN(test_own_color);
    RUN(test_terms);
    RUN(test_emission_once);
    RUN_LONG(test_checker_against_reference);
    RUN(test_strips);
    RUN(test_workers);
    RUN(test_regions);
    RUN(test_batches);
    RUN(test_nothing_to_shade);
    RUN(test_revision);
    RUN(test_indexed_uvs);
    RUN(test_failing);
    RUN(test_bad_values);
    RUN(test_bad_uvs);
    RUN(test_cancel);
    RUN(test_plan_and_memory);
    check_free_triangles(&ground);
    check_free_triangles(&body);
    sps_destroy(context);
    return check_report();
}
