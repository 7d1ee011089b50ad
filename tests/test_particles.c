/* Particles in the picture: balls of gas against their own chords, summed in double precision here, then light on them,
   among them and behind them, by closed forms where there are any and by sps_reference otherwise; and failures of every
   callback. Tolerances are derived where they are used, from
   ROUNDING  floats: 6e-8 for each operation. A ball's optical depth is a sum of sections, one per slab, whose ends meet
             to within a few roundings of the slab's number: for n slabs, that is n ROUNDING of the total, twice;
   RIM       d^2, the square of a ray's distance from the centre in radii, is a dozen operations: off by at most 1e-6.
             A uniform chord, sqrt(1 - d^2), changes by 1e-6 / (2 sqrt(1 - d^2)), and by 1e-3 at the very rim. */

#include "check.h"

#define ROUNDING  6e-8
#define RIM       1e-6
#define ISOTROPIC (0.25 / PI)

enum { PIXELS_MOST = 192 * 96 };
static float image_a[4 * PIXELS_MOST], image_b[4 * PIXELS_MOST], distance_a[PIXELS_MOST];
static sps_context *context;

/* --------------------------------------------------------------------------------------------------------- provider */

/* Particles from an array. `limit_calls` > 0: this call and later ones fail. */
typedef struct cloud {
    sps_particle *list;
    size_t count, room;
    long calls, limit_calls;
    size_t largest, zeroed; /* largest batch; number of particles that were zeroed */
} cloud;

static int cloud_read(void *user, size_t first, size_t count, sps_particle *out) {
    static const sps_particle zero = {{0, 0, 0}, 0, 0, {0, 0, 0}};
    cloud *c = (cloud *)user;
    c->calls += 1;
    if (c->limit_calls > 0 && c->calls >= c->limit_calls) return 7;
    if (count > c->largest) c->largest = count;
    for (size_t i = 0; i < count; ++i) c->zeroed += memcmp(&out[i], &zero, sizeof zero) == 0;
    memcpy(out, c->list + first, count * sizeof *out);
    return 0;
}

static sps_particle *cloud_add(cloud *c, double x, double y, double z, double radius, double depth) {
    sps_particle *particle;
    if (c->count == c->room) {
        c->room = c->room ? 2 * c->room : 64;
        c->list = (sps_particle *)realloc(c->list, c->room * sizeof *c->list);
        if (!c->list) abort();
    }
    particle = &c->list[c->count++];
    check_color(particle->position, x, y, z);
    particle->radius = (float)radius;
    particle->optical_depth = (float)depth;
    return particle;
}

static void cloud_free(cloud *c) {
    free(c->list);
    memset(c, 0, sizeof *c);
}

/* A scene of up to three sets. It must not be moved. */
typedef struct stage {
    check_scene s;
    sps_particles set[3];
    cloud clouds[3];
    check_triangles triangles;
    sps_lobe lobe;
} stage;

static void stage_clear(stage *x, int width, int height) {
    memset(x, 0, sizeof *x);
    check_clear(&x->s, width, height);
    x->s.scene.particles = x->set;
    x->s.view.quality = SPS_QUALITY_ULTRA;
}

static void stage_free(stage *x) {
    for (int i = 0; i < 3; ++i) cloud_free(&x->clouds[i]);
    check_free_triangles(&x->triangles);
}

/* Appends a set; stage_render sets its count to that of its cloud. */
static sps_particles *stage_add(stage *x, double albedo) {
    sps_particles *set = &x->set[x->s.scene.particle_set_count];
    set->read_fn = cloud_read;
    set->user = &x->clouds[x->s.scene.particle_set_count++];
    check_color(set->albedo, albedo, albedo, albedo);
    return set;
}

static void stage_ready(stage *x) {
    for (int i = 0; i < x->s.scene.particle_set_count; ++i) x->set[i].count = x->clouds[i].count;
}

static int stage_render(stage *x, float *image) {
    stage_ready(x);
    return check_render(context, &x->s, image);
}

static int stage_march(stage *x, double step, float *image) {
    stage_ready(x);
    return check_march(context, &x->s, step, image, NULL);
}

/* ----------------------------------------------------------------------------------------------------- exact chords */

/* Optical depth of a set along a ray between `low` and `high` (unit direction), and its tolerance. */
static double chords(const cloud *c, const sps_particles *set, const double origin[3], const double direction[3],
                     double low, double high, double *slack) {
    double sum = 0;
    *slack = 0;
    for (size_t n = 0; n < c->count; ++n) {
        const sps_particle *p = &c->list[n];
        const double r = (double)p->radius;
        double middle = 0, square = 0, half, a, b, depth = (double)p->optical_depth;
        for (int i = 0; i < 3; ++i) middle += ((double)p->position[i] - origin[i]) * direction[i];
        for (int i = 0; i < 3; ++i) {
            const double off = (double)p->position[i] - origin[i] - middle * direction[i];
            square += off * off / (r * r);
        }
        if (set->is_extinction) depth *= set->soft ? r * 4 / 3 : 2 * r;
        half = sqrt(fmax(1 - square, 0));
        if (fabs(1 - square) < 0.1) *slack += depth * fmin(sqrt(RIM), RIM / (2 * half + 1e-9));
        if (!(half > 0)) continue;
        a = fmin(fmax((low - middle) / (half * r), -1), 1);
        b = fmin(fmax((high - middle) / (half * r), -1), 1);
        if (set->soft)
            sum += depth * half * half * half * ((3 * b - b * b * b) - (3 * a - a * a * a)) / 4;
        else
            sum += depth * half * (b - a) / 2;
    }
    return sum;
}

/* The rays of a camera, by the library's own geometry, which other tests cover. */
static void pixel_ray(const sps_view *view, int x, int y, double origin[3], double direction[3], double *length) {
    spsi_rays rays;
    memset(&rays, 0, sizeof rays);
    rays.width = view->width;
    rays.height = view->height;
    spsi_rays_from_camera(&rays, &view->camera);
    spsi_ray_point(&rays, x, y, 0, origin);
    spsi_ray_direction(&rays, x, y, direction);
    *length = vec_length(direction);
    vec_normalise(direction);
}

/* Compares the coverage of every pixel with the exact chords of all sets; returns the largest error beyond the
   tolerance. The eye's near plane is at `near_distance` along its axis. */
static void check_coverage(const stage *x, const float *image, double slabs, const char *what) {
    const sps_view *view = &x->s.view;
    double worst = 0;
    int where = 0;
    for (int i = 0; i < view->width * view->height; ++i) {
        double origin[3], direction[3], length, tau = 0, slack = 0, error, allowed;
        pixel_ray(view, i % view->width, i / view->width, origin, direction, &length);
        for (int n = 0; n < x->s.scene.particle_set_count; ++n) {
            double more;
            const double low =
                view->camera.field_of_view > 0 || view->near_distance > 0 ? view->near_distance * length : 0;
            tau += chords(&x->clouds[n], &x->set[n], origin, direction, low, HUGE_VAL, &more);
            slack += more;
        }
        error = fabs((double)image[4 * i + 3] + expm1(-tau));
        allowed = fmin(slack, 1) + exp(-tau) * tau * (RIM + 2 * slabs * ROUNDING) + 2e-7;
        if (!(error / allowed <= worst)) worst = error / allowed, where = i;
    }
    if (!CHECK_CASE("Found in review", "balls cut by the near plane, and whole, in any number of slabs",
                    "coverage by exact chords: error / what is allowed", worst, 1,
                    "6e-8 for each of some 40 slabs, and the rim's pixel"))
        printf("    %s: pixel %d,%d is off by %g of what is allowed\n", what, where % view->width, where / view->width,
               worst);
}

/* --------------------------------------------------------------------------------------------------------- one ball */

enum { ORTHOGRAPHIC, PERSPECTIVE, INSIDE, BESIDE, VIEWS };
static const char *const view_names[VIEWS] = {"orthographic", "perspective", "eye inside", "eye beside"};

static void aim(stage *x, int kind) {
    sps_view *view = &x->s.view;
    check_set3(view->camera.position, 3, 2, 5);
    if (kind == ORTHOGRAPHIC) check_orthographic(&view->camera, 2.5);
    if (kind == PERSPECTIVE) check_perspective(&view->camera, 0.6);
    if (kind == INSIDE) check_perspective(&view->camera, 1), check_set3(view->camera.position, 0.5, 0.1, 0.4);
    if (kind == BESIDE) { /* part of the ball lies behind the eye's plane */
        check_perspective(&view->camera, 2.2);
        check_set3(view->camera.position, 1.3, -0.5, 0.2);
        check_set3(view->camera.target, 1.2, -0.4, -1);
    }
}

/* Exact for any number of slabs, any position of the eye, uniform and soft, by depth or by extinction. */
static void test_one_ball(void) {
    static const int slabs[5] = {1, 4, 64, 512, 4096};
    for (int kind = 0; kind < VIEWS; ++kind)
        for (int n = 0; n < 5; ++n)
            for (int form = 0; form < 4; ++form) {
                stage x;
                sps_particles *set;
                sps_stats_report stats;
                char what[80];
                stage_clear(&x, 47, 45);
                aim(&x, kind);
                set = stage_add(&x, 0);
                set->soft = form & 1;
                set->is_extinction = form / 2;
                cloud_add(&x.clouds[0], 0.1, -0.05, 0.2, 1.01, 1.5);
                x.s.view.slab_thickness = 2 / 0.7 / slabs[n];
                if (!stage_render(&x, image_a)) return;
                sps_get_stats(context, &stats);
                CHECK(stats.slabs >= (uint64_t)slabs[n] && stats.particles == 1 && stats.particle_calls == 1);
                snprintf(what, sizeof what, "%s, %d slabs, form %d", view_names[kind], slabs[n], form);
                check_coverage(&x, image_a, (double)stats.slabs, what);
                stage_free(&x);
            }
}

/* A ball 90 pixels wide, which covers two columns of tiles or three and one row or two, or the other way round,
   wherever it lies. */
static void test_across_tiles(void) {
    enum { LONG = 192, SHORT = 96 };
    for (int turned = 0; turned < 2; ++turned)
        for (int place = 0; place < 6; ++place) {
            const double scale = 2.5 / (turned ? LONG : SHORT), aside = (place - 3) * 9 * scale;
            stage x;
            sps_stats_report stats;
            stage_clear(&x, turned ? SHORT : LONG, turned ? LONG : SHORT);
            check_set3(x.s.view.camera.position, 0, 0, 5);
            check_orthographic(&x.s.view.camera, 2.5);
            stage_add(&x, 0);
            cloud_add(&x.clouds[0], turned ? 0 : aside, turned ? aside : 0, 0, 45 * scale, 1.5);
            if (!stage_render(&x, image_a)) return;
            sps_get_stats(context, &stats);
            check_coverage(&x, image_a, (double)stats.slabs, turned ? "rows of tiles" : "columns of tiles");
            stage_free(&x);
        }
}

/* The near plane clips the ball at any position. */
static void test_near_plane(void) {
    for (int form = 0; form < 8; ++form) {
        stage x;
        stage_clear(&x, 33, 31);
        aim(&x, form & 1 ? PERSPECTIVE : ORTHOGRAPHIC);
        stage_add(&x, 0)->soft = form / 2 & 1;
        cloud_add(&x.clouds[0], 0, 0, 0, 1, 1.5);
        x.s.view.near_distance = sqrt(38.0) + (form & 4 ? 0.35 : -0.4);
        x.s.view.slab_thickness = form & 4 ? 1.3 : 0.2;
        if (!stage_render(&x, image_a)) return;
        check_coverage(&x, image_a, 40, "near plane");
        stage_free(&x);
    }
}

/* A white plane under ambient light of 1 has a radiance of 1 if unobstructed: it is seen through exp of a ball's
   optical depth in front of it, in front-to-back compositing and, with a light from behind, back to front. */
static void test_cut_by_polygon(void) {
    for (int form = 0; form < 12; ++form) {
        const double origin[3] = {-12, -12, -5.2}, u[3] = {24, 0, 7.5}, v[3] = {0, 24, 2.1};
        const int backwards = form & 1;
        double worst = 0;
        stage x;
        stage_clear(&x, 41, 39);
        aim(&x, form & 2 ? PERSPECTIVE : ORTHOGRAPHIC);
        stage_add(&x, 0)->soft = form >= 8;
        cloud_add(&x.clouds[0], 0, 0.05, 0.1, 1, 1.5);
        cloud_add(&x.clouds[0], 0.4, -0.3, 0.2, 0.5, 0.8);
        check_add_quad(&x.triangles, origin, u, v);
        check_add_mesh(&x.s, &x.triangles, 1);
        check_color(x.s.scene.ambient, 1, 1, 1);
        if (backwards) check_add_directional(&x.s, 3, 2, 5, 2);
        if (form & 4) x.s.view.slab_thickness = 3;
        if (!stage_render(&x, image_a)) return;
        for (int i = 0; i < 41 * 39; ++i) {
            double from[3], way[3], normal[3], offset[3], length, t, tau, slack;
            pixel_ray(&x.s.view, i % 41, i / 41, from, way, &length);
            vec_cross(u, v, normal);
            vec_along(origin, from, -1, offset);
            t = vec_dot(normal, offset) / vec_dot(normal, way);
            tau = chords(&x.clouds[0], &x.set[0], from, way, 0, t, &slack);
            worst = fmax(worst, fabs((double)image_a[4 * i] - exp(-tau)) - fmin(slack, 1));
        }
        /* depths are floats of about 6: the position of the cut is accurate to 6 ROUNDING, times the extinction there,
           at most 2; and 40 slabs' round-off */
        if (!CHECK_CASE("Found in review", "balls cut by a polygon", "what is before it, by exact chords", worst,
                        12 * ROUNDING + 40 * ROUNDING + 1e-6,
                        "the cut in floats of a depth of 6; round-off of 40 slabs"))
            printf("    form %d: off by %g\n", form, worst);
        stage_free(&x);
    }
}

/* Smaller than a pixel: widened to 3/4 of a pixel, each with its mass. A cell of 4 x 4 pixels for each of 32 x 32
   particles, each with a different offset from its pixel's centre. The sum over pixels is then a midpoint rule of 32
   steps per pixel over a profile that ends like a square root: h^1.5 of it, 0.6 %. Soft ones end smoothly. */
static void test_small(void) {
    for (int soft = 0; soft < 2; ++soft)
        for (int n = 0; n < 3; ++n) {
            static const double radii[3] = {0.4, 0.02, 1e-4};
            const double radius = radii[n] / 128, grown = 0.75 / 128, share = (radius / grown) * (radius / grown);
            const double mass = 1024 * 1e-3 * share * PI * 0.75 * 0.75 * (soft ? 2.0 / 5 : 2.0 / 3);
            double sum = 0;
            stage x;
            sps_stats_report stats;
            stage_clear(&x, 128, 128);
            stage_add(&x, 0)->soft = soft;
            for (int i = 0; i < 1024; ++i)
                cloud_add(&x.clouds[0], (4 * (i % 32) + 1.5 + (i % 32 + 0.5) / 32) / 128 - 0.5,
                          (4 * (i / 32) + 1.5 + (i / 32 + 0.5) / 32) / 128 - 0.5, 0, radius, 1e-3);
            if (!stage_render(&x, image_a)) return;
            for (int i = 0; i < 128 * 128; ++i) sum -= log1p(-(double)image_a[4 * i + 3]);
            /* coverage near 0 has its own float precision */
            CHECK_CASE("Found in review", "particles smaller than a pixel, at 1024 places in it", "their mass",
                       fabs(sum / mass - 1), 0.006 + 1e-4, "a midpoint rule over a profile that ends like a root");
            sps_get_stats(context, &stats);
            CHECK(stats.particles == 1024);
            stage_free(&x);
        }
}

/* Nearly invisible, and practically solid: neither is lost, and nothing is NaN. */
static void test_depths(void) {
    static const double depths[4] = {1e-8, 1e-3, 1e8, 1e18};
    for (int n = 0; n < 4; ++n) {
        stage x;
        double origin[3], direction[3], length, slack, tau;
        stage_clear(&x, 31, 31);
        check_orthographic(&x.s.view.camera, 2.2);
        stage_add(&x, 1);
        cloud_add(&x.clouds[0], 0, 0, 0, 1, depths[n]);
        check_add_directional(&x.s, 0.1, 0, -1, 3);
        if (!stage_render(&x, image_a)) return;
        pixel_ray(&x.s.view, 20, 15, origin, direction, &length);
        tau = chords(&x.clouds[0], &x.set[0], origin, direction, -HUGE_VAL, HUGE_VAL, &slack);
        /* of the coverage of a small optical depth */
        CHECK_NEAR((double)image_a[4 * (15 * 31 + 20) + 3], -expm1(-tau), -expm1(-tau) * 1e-5);
        for (int i = 0; i < 4 * 961; ++i)
            if (!CHECK(image_a[i] >= 0 && image_a[i] <= 1)) break;
        stage_free(&x);
    }
}

/* ------------------------------------------------------------------------------------------------------------ light */

/* Emission alone: exactly e (1 - exp(-tau)), since a ball is homogeneous. */
static void test_emission(void) {
    stage x;
    stage_clear(&x, 33, 31);
    aim(&x, PERSPECTIVE);
    check_color(stage_add(&x, 0)->emission, 2, 1, 0.5);
    cloud_add(&x.clouds[0], 0, 0, 0, 1, 1.5);
    cloud_add(&x.clouds[0], 0.3, 0, 0.6, 0.7, 2);
    if (!stage_render(&x, image_a)) return;
    for (int i = 0; i < 33 * 31; ++i)
        for (int c = 0; c < 3; ++c)
            if (!CHECK_NEAR((double)image_a[4 * i + c], (double)(x.set[0].emission[c] * image_a[4 * i + 3]), 2e-4))
                return; /* rays end at a transmittance of 5e-5, of 2 */
    stage_free(&x);
}

/* The shadow of a ball on a plane. Where light enters at distance d from its centre, transmittance is exp of the chord.
   The light's texels, 0.35 / 4 radii wide, interpolate a chord whose second derivatives are at most 1.54 and 1.16 for
   d < 0.5, along and across d: off by 2.7 tau (0.35 / 4)^2 / 8. Both planes of the lookup hold all of it. */
static void test_shadow_on_polygon(void) {
    for (int form = 0; form < 4; form += 3) {
        const double origin[3] = {-3, -1.5, 3}, u[3] = {6, 0, 0}, v[3] = {0, 0, -6}, tau = form & 1 ? 4 : 1;
        const double far_tolerance = 2.7 * tau * 0.0875 * 0.0875 / 8;
        int seen = 0;
        stage x;
        stage_clear(&x, 61, 59);
        stage_add(&x, form & 2 ? 0.5 : 0);
        cloud_add(&x.clouds[0], 0.1, 0.2, 0, 1, tau);
        check_add_quad(&x.triangles, origin, u, v);
        check_add_mesh(&x.s, &x.triangles, 0.8);
        check_add_directional(&x.s, 0.3, -1, 0.1, 2);
        check_set3(x.s.view.camera.position, 0, 0.5, 6);
        check_set3(x.s.view.camera.target, 0.6, -1.5, 0.2);
        check_orthographic(&x.s.view.camera, 1.3);
        if (!stage_render(&x, image_a)) return;
        for (int i = 0; i < 61 * 59; ++i) {
            double from[3], way[3], at[3], back[3] = {-0.3, 1, -0.1}, length, t, depth, hidden, slack, exact;
            pixel_ray(&x.s.view, i % 61, i / 61, from, way, &length);
            t = (-1.5 - from[1]) / way[1];
            vec_along(from, way, t, at);
            vec_normalise(back);
            depth = chords(&x.clouds[0], &x.set[0], at, back, 0, HUGE_VAL, &slack);
            hidden = chords(&x.clouds[0], &x.set[0], from, way, 0, t, &slack);
            if (!(t > 0) || hidden > 0 || depth < tau * sqrt(0.75)) continue;
            seen += 1;
            exact = 0.8 / PI * 2 / sqrt(1.1) * exp(-depth);
            if (!CHECK_NEAR((double)image_a[4 * i], exact, exact * far_tolerance + 1e-6)) return;
        }
        CHECK(seen > 100);
        stage_free(&x);
    }
}

/* A thin ball, seen from the side, in the shadow of another: its radiance is the integral along the eye's chord of the
   light that is left there, in 200 steps here. Texels as above. Slabs of 0.175 of the mean radius of 0.67 lie at 45
   degrees to the chord: steps of h = 0.165 on it. Within a step the curve of light is replaced by its chord: off by
   1.54 tau h^2 / 12. Where the thin ball ends within a step, its part counts at the step's middle, up to (1 - f) h / 2
   farther out, f being the fraction that it fills: f (1 - f) h^2 / 2 of the slope there over the chord's length, which
   is tau / 2 / sqrt(0.8): 2 ends make tau h^2 / 7. */
static void test_shadow_on_ball(void) {
    const double tau = 1.2, thin = 1e-3;
    int seen = 0;
    stage x;
    stage_clear(&x, 41, 41);
    stage_add(&x, 0.7);
    cloud_add(&x.clouds[0], -3, 0, 0, 1, tau);
    cloud_add(&x.clouds[0], 0, 0, 0, 0.45, thin);
    check_add_directional(&x.s, 1, 0, 0, 3);
    check_orthographic(&x.s.view.camera, 1);
    if (!stage_render(&x, image_a)) return;
    for (int i = 0; i < 41 * 41; ++i) {
        const double px = (i % 41 - 20) / 41.0, py = (20 - i / 41) / 41.0, square = 1 - (px * px + py * py) / 0.2025;
        double sum = 0, exact;
        if (square < 0.05) continue;
        for (int k = 0; k < 200; ++k) {
            const double z = 0.45 * sqrt(square) * ((k + 0.5) / 100 - 1), d = py * py + z * z;
            const double own = thin / 0.9 * (sqrt(0.2025 - d) + px);
            sum += exp(-tau * sqrt(1 - d) - own) / 200;
        }
        exact = 0.7 * ISOTROPIC * 3 * thin * sqrt(square) * sum;
        seen += 1;
        if (!CHECK_NEAR((double)image_a[4 * i], exact,
                        exact * (tau * (2.7 * 0.0875 * 0.0875 / 8 + 0.165 * 0.165 * (1.54 / 12 + 1.0 / 7)) + 2e-3)))
            return; /* 2e-3: thin balls shadow themselves, and their coverage is less than their optical depth */
    }
    CHECK(seen > 500);
    stage_free(&x);
}

/* Overlapping balls, lit: against the reference at a step of 0.125, halving slabs and texels together. */
static double lit_error(const sps_lobe *lobe, int from_behind, double slab, int shadow_resolution, float *reference) {
    stage x;
    double error = -1, most = 0;
    stage_clear(&x, 61, 59);
    aim(&x, PERSPECTIVE);
    sps_particles *set = stage_add(&x, 0.8);
    set->soft = 1;
    set->lobes = lobe;
    set->lobe_count = lobe != NULL;
    cloud_add(&x.clouds[0], 0, 0, 0, 1, 2);
    cloud_add(&x.clouds[0], 0.7, 0.3, 0.3, 0.8, 3);
    cloud_add(&x.clouds[0], -0.6, 0.5, -0.4, 0.9, 2);
    if (from_behind)
        check_add_directional(&x.s, 1, 0.4, 1, 5);
    else
        check_add_point(&x.s, 4, 9, 6, 400);
    if (slab > 0) {
        x.s.view.slab_thickness = slab;
        x.s.view.shadow_resolution = shadow_resolution;
        if (stage_render(&x, image_a)) {
            for (int i = 0; i < 61 * 59; ++i) most = fmax(most, (double)reference[4 * i]);
            error = check_rms(image_a, reference, 4 * 61 * 59) / most;
        }
    } else {
        stage_march(&x, -slab, reference);
    }
    stage_free(&x);
    return error;
}

static void test_against_reference(void) {
    static const sps_lobe forward = {0.5f, 1};
    for (int behind = 0; behind < 2; ++behind) {
        double errors[3], march;
        lit_error(&forward, behind, -0.0625, 0, image_b);
        for (int n = 0; n < 3; ++n) errors[n] = lit_error(&forward, behind, 0.8 / (1 << n), 32 << n, image_b);
        printf("balls lit from %s: error %.2e %.2e %.2e against the reference\n", behind ? "behind" : "the front",
               errors[0], errors[1], errors[2]);
        /* second order: a quarter each time, and as much again for the first, which is not asymptotic yet */
        CHECK(errors[0] >= 0 && errors[1] < 0.35 * errors[0] && errors[2] < 0.35 * errors[1] && errors[2] < 1e-3);
        lit_error(&forward, behind, -0.5, 0, image_a);
        march = check_rms(image_a, image_b, 4 * 61 * 59);
        lit_error(&forward, behind, -0.25, 0, image_a);
        /* the reference against itself: a quarter (1 - 1/16) / (1 - 1/64) of it, and some for the rims */
        CHECK(check_rms(image_a, image_b, 4 * 61 * 59) < 0.35 * march);
    }
}

/* --------------------------------------------------------------------------------------------- light inside of balls
 */

/* What the eye sees of a set lit by a sun of irradiance 4 pi that travels along `sun` (of unit length), isotropically,
   per unit of albedo: the sum over short ways of what they absorb, times what is left of the light in their middles,
   all by exact chords. With `wall`, gas is dark where light comes by x < -1.6 at y = 1.6. `steps` of 3 units of way. */
static double lit_inside(const stage *x, int pixel, const double sun[3], int wall, int steps) {
    const double back[3] = {-sun[0], -sun[1], -sun[2]};
    double from[3], way[3], length, slack, sum = 0, before = 1, start;
    pixel_ray(&x->s.view, pixel % x->s.view.width, pixel / x->s.view.width, from, way, &length);
    start = -vec_dot(from, way) - 1.5;
    for (int i = 0; i < steps; ++i) {
        const double middle = start + 3 * (i + 0.5) / steps;
        const double after = exp(-chords(&x->clouds[0], &x->set[0], from, way, 0, middle + 1.5 / steps, &slack));
        double at[3], light;
        if (before - after > 0) {
            for (int k = 0; k < 3; ++k) at[k] = from[k] + middle * way[k];
            light = exp(-chords(&x->clouds[0], &x->set[0], at, back, 0, 100, &slack));
            if (!wall || at[0] + (1.6 - at[1]) * sun[0] / sun[1] > -1.6) sum += (before - after) * light;
        }
        before = after;
    }
    return sum;
}

/* Balls whose inside is lit by a sun: slabs are as thin as their optical depth calls for. Light is linear in the share
   of matter within slabs, and groups of slabs take off most of what that errs by (Richardson). What is left is that of
   slabs in which a ball begins or ends: of an even ball of optical depth t in slabs of h radii, about 1.4 % (t h /
   0.35)^1.4 by exact sums on planes without texels, where h is such that this is 1.2 to 1.6 % at medium quality; slabs
   half as thick have 0.38 of it at high. Texels add 0.8 and 0.3 %: 2 and 0.7 % in all. Against the light, what is seen
   has passed about twice as much gas, and so do errors weigh twice, of a mean that is up to a third darker: 2.5 times
   as much. The edge of a wall's shadow crosses 48 rows in the middle of the ball, where a texel of a depth map of 1 to
   2 pixels is off by up to 0.29 of it, of twice the mean's light: 2 * 0.29 sqrt(2 / 48) = 12 %, and 6 % with texels of
   a half. */
static void test_lit_inside(void) {
    static const struct {
        int count, soft, wall;
        double depth;
    } balls[] = {{1, 0, 0, 1}, {1, 1, 0, 2}, {40, 1, 0, 0.5}, {1, 0, 0, 5}, {1, 0, 1, 1}};
    for (int form = 0; form < 10; ++form) {
        const int count = balls[form / 2].count, wall = balls[form / 2].wall, size = count > 1 ? 32 : 48;
        double sun[3] = {1, -1, -0.5}, origin[3] = {-9.6, 1.6, -4}, u[3] = {8, 0, 0}, v[3] = {0, 0, 8};
        check_random random = {9};
        stage x;
        stage_clear(&x, size, size);
        check_set3(x.s.view.camera.position, 0, 1, 5);
        check_perspective(&x.s.view.camera, 2 * atan(count > 1 ? 0.273 : 0.21));
        stage_add(&x, 1)->soft = balls[form / 2].soft;
        for (int i = 0; i < count; ++i) {
            double p[4] = {0, 0, 0, 1};
            for (int k = 0; k < 4 && count > 1; ++k) p[k] = k < 3 ? 1.6 * check_next(&random) - 0.8 : 0.45;
            cloud_add(&x.clouds[0], p[0], p[1], p[2], p[3], balls[form / 2].depth);
        }
        if (form & 1) sun[2] = 0.5; /* back to front */
        check_add_directional(&x.s, sun[0], sun[1], sun[2], 4 * PI);
        vec_normalise(sun);
        if (wall) {
            check_add_quad(&x.triangles, origin, u, v);
            check_add_mesh(&x.s, &x.triangles, 0);
        }
        for (int quality = SPS_QUALITY_MEDIUM; quality <= SPS_QUALITY_HIGH; ++quality) {
            const double part = quality == SPS_QUALITY_HIGH ? 0.35 : 1,
                         edge = quality == SPS_QUALITY_HIGH ? 0.06 : 0.12;
            const double allowed = 0.02 * part * (form & 1 ? 2.5 : 1) + edge * wall;
            double square = 0, mean = 0;
            x.s.view.quality = (sps_quality)quality;
            if (!stage_render(&x, image_a)) return;
            for (int i = 0; i < size * size; ++i) {
                const double exact = lit_inside(&x, i, sun, wall, count > 1 ? 60 : 150);
                square += pow((double)image_a[4 * i] - exact, 2);
                mean += exact / size;
            }
            if (!CHECK_CASE("Found in review", "dense balls of gas, lit from either side",
                            "light within, by exact chords", sqrt(square) / mean, allowed,
                            "2 % at medium quality, 0.7 % at high, more against the light"))
                printf("    form %d, quality %d\n", form, quality);
        }
        stage_free(&x);
    }
}

/* A million particles at one place that amount to one: each is lost in the rounding of a sum of them. Sums of 8192 lose
   up to 8192 / 2 roundings of their size, and sums of 123 such, of which coverage sees t exp(-t) at most, 0.37. */
static int read_weak(void *user, size_t first, size_t count, sps_particle *out) {
    (void)user, (void)first;
    memset(out, 0, count * sizeof *out);
    for (size_t i = 0; i < count; ++i) out[i].radius = 0.5f, out[i].optical_depth = 1e-6f;
    return 0;
}

static void test_weak(void) {
    for (int soft = 0; soft < 2; ++soft) {
        double worst = 0;
        stage x;
        sps_particles *set;
        stage_clear(&x, 6, 6);
        set = stage_add(&x, 0);
        cloud_add(&x.clouds[0], 0, 0, 0, 0.5, 1e6 * (double)1e-6f);
        set->read_fn = read_weak;
        set->soft = soft;
        set->count = 1000000;
        x.s.view.quality = SPS_QUALITY_MEDIUM;
        x.s.view.camera.ortho_height = 0.7; /* a radius of 4.3 pixels: chords are exact from 4 on */
        if (!check_render(context, &x.s, image_a)) return;
        for (int i = 0; i < 36; ++i) {
            double from[3], way[3], length, slack;
            pixel_ray(&x.s.view, i % 6, i / 6, from, way, &length);
            worst = fmax(worst, fabs((double)image_a[4 * i + 3] +
                                     expm1(-chords(&x.clouds[0], &x.set[0], from, way, 0, 100, &slack))));
        }
        CHECK_CASE("Extremes", "a million particles of optical depth 1e-6 at one place", "their sum, in coverage",
                   worst, 0.37 * (8192 + 123) / 2 * ROUNDING + 5 * RIM, "roundings of 8192 additions");
        stage_free(&x);
    }
}

/* A soft ball as a volume of 97^3 voxels. The differences: kernels blur it by 0.65 voxels of 1/40 radius, which changes
   the field by half of that squared times its second derivatives, 3 (0.65 / 40)^2 = 8e-4 of the centre's, 1.2e-3 of the
   mean; and the cut of kernels moves 2e-3 of their mass (test_transport's RIPPLE). Either changes the optical depths of
   eye and light, and radiance by as much for each: 4 times the larger. At the rim, where optical depth is
   2 (1 - b^2)^1.5, kernels extend it by a standard deviation: 2 (2 * 0.65 / 40)^1.5 = 1.2e-2, and half as much again of
   the brightest, since thin gas hides nothing of itself. Pixels are smaller than voxels, so that no pixel filter is
   applied. */
static double soft_ball(const void *user, const double p[3]) {
    (void)user;
    return fmax(0, 1 - p[0] * p[0] - p[1] * p[1] - p[2] * p[2]);
}

static void test_voxel_stand_in(void) {
    stage x;
    check_field field;
    sps_volume *volume;
    double most = 0;
    stage_clear(&x, 127, 121);
    aim(&x, PERSPECTIVE);
    stage_add(&x, 0.8)->soft = 1;
    cloud_add(&x.clouds[0], 0, 0, 0, 1, 2);
    check_add_directional(&x.s, -1, -0.8, 0.2, 3);
    x.s.view.slab_thickness = 0.1;
    x.s.view.shadow_resolution = 200;
    if (!stage_render(&x, image_a)) return;
    x.s.scene.particle_set_count = 0;
    memset(&field, 0, sizeof field);
    field.value_fn = soft_ball;
    volume = check_add_volume(&x.s, 97, 97, 97, check_box(-1.2125, -1.2125, -1.2125, 1.2125, 1.2125, 1.2125));
    volume->eval_fn = check_eval_field;
    volume->user = &field;
    volume->extinction = 1.5f; /* a depth of 2 is 4/3 of it */
    check_color(volume->albedo, 0.8, 0.8, 0.8);
    x.s.view.slab_thickness = 2;
    if (!check_render(context, &x.s, image_b)) return;
    for (int i = 0; i < 127 * 121; ++i) most = fmax(most, (double)image_b[4 * i]);
    for (int i = 0; i < 127 * 121; ++i)
        if (!CHECK_NEAR((double)image_a[4 * i], (double)image_b[4 * i],
                        (image_b[4 * i + 3] < 0.1f ? 2e-2 : 8e-3) * most))
            return;
    stage_free(&x);
}

/* ----------------------------------------------------------------------------------------------------- many of them */

/* Balls of many sizes, from a tenth of a pixel to half of the image. */
static void fill(stage *x, int set, int count, uint64_t seed) {
    check_random random;
    random.state = seed;
    for (int i = 0; i < count; ++i) {
        const double a = check_next(&random), b = check_next(&random), c = check_next(&random);
        const double size = i % 50 == 0 ? 0.5 : pow(check_next(&random), 4) * 0.2 + 1e-3;
        cloud_add(&x->clouds[set], 2 * a - 1, 1.6 * b - 0.8, 2 * c - 1, size, 0.02 + 0.3 * check_next(&random));
    }
}

static float half_value = 0.4f;

/* Two sets, a classified volume, a gas, a floor, and lights from two sides. */
static void build_mixed(stage *x) {
    static const sps_transfer_point points[] = {{0, {0.9f, 0.5f, 0.3f}, 0, {0, 0, 0}},
                                                {1, {0.9f, 0.5f, 0.3f}, 8, {0, 0, 0}}};
    static const sps_transfer transfer = {points, 2, NULL, NULL, 0};
    const double origin[3] = {-2, -0.6, 2}, u[3] = {4, 0, 0}, v[3] = {0, 0.3, -4};
    sps_volume *volume;
    stage_clear(x, 101, 83);
    x->s.view.quality = SPS_QUALITY_MEDIUM;
    check_set3(x->s.view.camera.position, 1, 1, 4);
    check_perspective(&x->s.view.camera, 0.8);
    x->s.view.shadow_resolution = 150;
    x->s.view.slab_thickness = 4;
    stage_add(x, 0.8);
    stage_add(x, 0.3)->soft = 1;
    check_color(x->set[1].emission, 0.1, 0.05, 0.2);
    x->lobe.asymmetry = 0.4f;
    x->lobe.weight = 2;
    x->set[1].lobes = &x->lobe;
    x->set[1].lobe_count = 1;
    fill(x, 0, 1500, 3);
    fill(x, 1, 5000, 4);
    for (int i = 0; i < 2; ++i) {
        volume = check_add_volume(&x->s, 9, 8, 7, check_box(-0.9 + i, -0.5, -0.4, -0.3 + i, 0.4, 0.5));
        volume->read_fn = check_read_constant;
        volume->user = &half_value;
        volume->extinction = 2;
        check_color(volume->albedo, 0.2, 0.5, 0.8);
        if (i == 0) volume->transfer = &transfer, volume->shading = SPS_SHADING_SURFACE;
    }
    check_add_quad(&x->triangles, origin, u, v);
    check_add_mesh(&x->s, &x->triangles, 0.7);
    check_add_directional(&x->s, -1, -1, -0.3, 3);
    check_add_directional(&x->s, 0.4, -0.5, 1, 2);
    check_color(x->s.scene.ambient, 0.1, 0.1, 0.2);
    check_color(x->s.scene.background, 0.3, 0.2, 0.1);
    stage_ready(x);
}

/* A ball of `radius` pixels that are `oblong` times as high as wide, at (x, y) in pixels from the middle of an image of
   16 x 16. */
enum { MASS_SIZE = 16 };
static int show_ball(int soft, double radius, double depth, double oblong, double x, double y) {
    enum { SIZE = MASS_SIZE };
    const double matrix[16] = {2.0 / SIZE, 0, 0, 0, 0, 2.0 / SIZE / oblong, 0, 0, 0, 0, -0.1, 0, 0, 0, 0, 1};
    stage s;
    stage_clear(&s, SIZE, SIZE);
    check_matrix(&s.s.view.camera, matrix);
    stage_add(&s, 0)->soft = soft;
    cloud_add(&s.clouds[0], x, oblong * y, 0, radius, depth);
    if (!stage_render(&s, image_a)) return 0;
    stage_free(&s);
    return 1;
}

/* The sum of its optical depths over all pixels, of what it is: pi r^2 depth times the mean chord. */
static double mass_of(int soft, double radius, double oblong, double x, double y) {
    const double depth = radius < 1.5 ? 0.01 : 0.5;
    double sum = 0;
    if (!show_ball(soft, radius, depth, oblong, x, y)) return 0;
    for (int i = 0; i < MASS_SIZE * MASS_SIZE; ++i) sum -= log1p(-(double)image_a[4 * i + 3]);
    return sum * oblong / (PI * radius * radius * depth * (soft ? 2.0 / 5 : 2.0 / 3));
}

/* Small balls keep their mass wherever they lie in a pixel. Up to 8/3 pixels, what their chords sum up to is made
   exact: what is left is the round-off of coverage, 6e-8 in each of up to 36 pixels whose mean is above 0.05 of those
   that are at least 5e-4. Below 3/4 of a pixel, if that is oblong 1.3, mass is that of thin balls:
   3/8 of their depth of 0.01 counts twice.
   Beyond, rims that fall between pixels take 3 / (2 pi r)^2 for each of four waves at most, fading in until 4 pixels:
   2 %. */
static void test_mass(void) {
    static const double radii[] = {1e-3, 0.1, 0.4, 0.75, 1.05, 1.68, 2.6, 3.2, 3.9, 5};
    double worst[3] = {0, 0, 0};
    for (int n = 0; n < 10; ++n)
        for (int soft = 0; soft < 2; ++soft)
            for (int place = 0; place < 12; ++place) {
                const double x = fmod(0.618 * place, 1), y = place / 12.0, oblong = place % 3 ? 1 : 1.7;
                const double off = fabs(mass_of(soft, radii[n], oblong, x, y) - 1);
                const int kind = (radii[n] > 1.5) + (radii[n] > 8.0 / 3);
                if (oblong < 1.5 || radii[n] < 2.6) worst[kind] = fmax(worst[kind], off);
            }
    CHECK_CASE("Found in review", "balls of 0.001 to 1.05 pixels, anywhere in a pixel",
               "mass: sum of optical depths / pi r^2 d mean chord", worst[0], 0.004, "thin up to d = 0.01");
    CHECK_CASE("Found in review", "balls of 1.68 to 8/3 pixels, anywhere in a pixel",
               "mass: sum of optical depths / pi r^2 d mean chord", worst[1], 2e-4, "round-off of coverage");
    CHECK_CASE("Found in review", "balls of 8/3 to 5 pixels, anywhere in a pixel",
               "mass: sum of optical depths / pi r^2 d mean chord", worst[2], 0.02, "rims between pixels");
}

/* Dense balls far below a pixel stop as much light as they do from near by: the mean over their outline of 1 - exp(-d
   u^p), with u = 1 - (distance / radius)^2, p a half or 3 / 2. The fits of that and of its inverse are within 2 and 3
   %; at 0.3 pixels, chords whose sum is exact stop 1 % less, or more, by place. */
static void test_dense_specks(void) {
    static const double radii[] = {1e-3, 0.05, 0.3}, depths[] = {0.3, 1, 4, 15, 1000, 1e12};
    double worst = 0;
    for (int n = 0; n < 36; ++n) {
        const int soft = n % 2;
        const double radius = radii[n / 2 % 3], depth = depths[n / 6];
        double stops = 0, sum = 0;
        for (int i = 0; i < 4000; ++i) stops -= expm1(-depth * pow((i + 0.5) / 4000, soft ? 1.5 : 0.5)) / 4000;
        for (int place = 0; place < 12; ++place) {
            if (!show_ball(soft, radius, depth, 1, fmod(0.618 * place, 1), place / 12.0)) return;
            for (int i = 0; i < MASS_SIZE * MASS_SIZE; ++i) sum += (double)image_a[4 * i + 3] / 12;
        }
        worst = fmax(worst, fabs(sum / (PI * radius * radius * stops) - 1));
    }
    CHECK_CASE("Found in review", "balls of 0.001 to 0.3 pixels, optical depths of 0.3 to 10^12",
               "coverage: pi r^2 of the mean of 1 - e^-chord", worst, 0.04, "fit and chords");
}

/* 60 small balls that drift by 0.1 pixels a frame, all within the picture and before the eye: neither the mean coverage
   nor the light that they scatter changes by more than 0.2 % from frame to frame, a twentieth of what the largest one
   brings. They are thin and apart, so that both are sums over balls. */
static void test_drift(void) {
    for (int soft = 0; soft < 2; ++soft) {
        double last[2] = {0, 0}, worst = 0;
        for (int frame = 0; frame < 11; ++frame) {
            check_random random = {5};
            double sum[2] = {0, 0};
            stage x;
            stage_clear(&x, 64, 64);
            check_set3(x.s.view.camera.position, 30, 20, 50);
            check_orthographic(&x.s.view.camera, 64);
            check_add_directional(&x.s, 1, -1, -1, 3);
            stage_add(&x, 0.8)->soft = soft;
            for (int i = 0; i < 60; ++i) {
                double at[4]; /* a cube whose corners are 26 from the origin */
                for (int k = 0; k < 4; ++k) at[k] = check_next(&random);
                cloud_add(&x.clouds[0], 30 * at[0] - 15 + 0.1 * frame, 30 * at[1] - 15 + 0.06 * frame, 30 * at[2] - 15,
                          0.2 + 0.5 * at[3], 0.02);
            }
            if (!stage_render(&x, image_a)) return;
            for (int i = 0; i < 64 * 64; ++i) sum[0] += (double)image_a[4 * i], sum[1] += (double)image_a[4 * i + 3];
            for (int k = 0; k < 2; ++k) {
                if (frame > 0) worst = fmax(worst, fabs(sum[k] / last[k] - 1));
                last[k] = sum[k];
            }
            stage_free(&x);
        }
        CHECK_CASE("Found in review", "small balls that drift by 0.1 pixels a frame",
                   "coverage and light of the picture: change from frame to frame", worst, 0.002,
                   "light within a texel");
    }
}

/* Hundreds in one picture add up to the sum of their chords, as long as each is wider than 4 pixels. */
static void test_many(void) {
    stage x;
    check_random random;
    random.state = 11;
    stage_clear(&x, 101, 97);
    aim(&x, PERSPECTIVE);
    stage_add(&x, 0);
    stage_add(&x, 0.5)->soft = 1;
    for (int i = 0; i < 900; ++i) /* of 4 pixels and more, from which on chords are exact */
        cloud_add(&x.clouds[i & 1], 2 * check_next(&random) - 1, 2 * check_next(&random) - 1,
                  2 * check_next(&random) - 1, i % 100 ? 0.2 + 0.05 * check_next(&random) : 0.8, i % 100 ? 0.02 : 1e-3);
    if (!stage_render(&x, image_a)) return;
    check_coverage(&x, image_a, 200, "many");
    check_set3(x.s.view.camera.position, 0.2, 0.1, 0.3); /* amid them */
    check_perspective(&x.s.view.camera, 1.2);
    if (!stage_render(&x, image_a)) return;
    check_coverage(&x, image_a, 200, "many, from within");
    stage_free(&x);
}

/* A classified volume shaded as a surface adds margins to tiles, which do not affect particles. */
static void test_margins(void) {
    static const sps_transfer_point points[] = {{0, {1, 1, 1}, 0, {0, 0, 0}}, {1, {1, 1, 1}, 8, {0, 0, 0}}};
    static const sps_transfer transfer = {points, 2, NULL, NULL, 0};
    stage x;
    sps_volume *volume;
    stage_clear(&x, 141, 77);
    check_orthographic(&x.s.view.camera, 2.2);
    stage_add(&x, 0);
    cloud_add(&x.clouds[0], -0.6, 0, 0, 1, 1.5);
    volume = check_add_volume(&x.s, 3, 3, 3, check_box(1.85, 0.9, -2, 1.95, 1, -1.9));
    volume->read_fn = check_read_constant;
    volume->user = &half_value;
    volume->transfer = &transfer;
    volume->shading = SPS_SHADING_SURFACE;
    check_add_directional(&x.s, 0.2, 0.1, -1, 1);
    x.s.view.slab_thickness = 4;
    if (!stage_render(&x, image_a)) return;
    for (int y = 0; y < 77; ++y) /* the volume is on the right, the ball on the left */
        memmove(image_a + (size_t)y * 4 * 109, image_a + (size_t)y * 4 * 141, 109 * 4 * sizeof(float));
    for (int i = 0; i < 109 * 77; ++i) {
        double origin[3], direction[3], length, slack, tau;
        pixel_ray(&x.s.view, i % 109, i / 109, origin, direction, &length);
        tau = chords(&x.clouds[0], &x.set[0], origin, direction, 0, HUGE_VAL, &slack);
        if (!CHECK_NEAR((double)image_a[4 * i + 3], -expm1(-tau), fmin(slack, 1) + 1e-5)) return;
    }
    stage_free(&x);
}

/* Sets and volumes of equal appearance share a channel; others do not. */
static void test_channels(void) {
    stage x;
    sps_plan_report plan;
    stage_clear(&x, 31, 31);
    stage_add(&x, 0.5);
    stage_add(&x, 0.5)->soft = 1;
    cloud_add(&x.clouds[0], 0.1, 0, 0, 0.2, 1);
    cloud_add(&x.clouds[1], 0, 0.1, 0, 0.2, 1);
    stage_ready(&x);
    CHECK_OK(context, sps_plan(context, &x.s.scene, &x.s.view, &plan));
    CHECK(plan.sheet_channels == 1 && plan.color_channels == 1);
    x.set[1].albedo[2] = 0.6f;
    CHECK_OK(context, sps_plan(context, &x.s.scene, &x.s.view, &plan));
    CHECK(plan.sheet_channels == 2 && plan.color_channels == 3);
    stage_free(&x);
}

/* Another order changes the rounding of sums, and nothing else: 6500 float addends, in sums of a few hundred. */
static void test_order(void) {
    stage x;
    build_mixed(&x);
    check_render(context, &x.s, image_a);
    for (int n = 0; n < 2; ++n)
        for (size_t i = 0; i < x.clouds[n].count / 2; ++i) {
            const sps_particle other = x.clouds[n].list[i];
            x.clouds[n].list[i] = x.clouds[n].list[x.clouds[n].count - 1 - i];
            x.clouds[n].list[x.clouds[n].count - 1 - i] = other;
        }
    check_render(context, &x.s, image_b);
    CHECK_NEAR(check_largest(image_a, image_b, 4 * 101 * 83), 0, 1e-4);
    stage_free(&x);
}

static void test_same_bits(void) {
    static const int workers[4] = {0, 1, 2, 7};
    static const int regions[4][4] = {{0, 0, 64, 64}, {63, 10, 38, 60}, {100, 82, 1, 1}, {5, 40, 90, 43}};
    stage x;
    sps_image image;
    build_mixed(&x);
    memset(&image, 0, sizeof image);
    for (int n = 0; n < 4; ++n) {
        check_hooks hooks;
        sps_context *own;
        memset(&hooks, 0, sizeof hooks);
        hooks.worker_count = workers[n];
        hooks.order = 17 * (uint64_t)n;
        own = check_context(&hooks);
        check_render(own, &x.s, n == 0 ? image_a : image_b);
        if (n > 0 && !CHECK(memcmp(image_a, image_b, 4 * 101 * 83 * sizeof(float)) == 0))
            printf("    %d workers\n", workers[n]);
        sps_destroy(own);
    }
    for (int n = 0; n < 4; ++n) {
        const int *r = regions[n];
        int same = 1;
        memcpy(x.s.view.region, r, sizeof regions[n]);
        check_render(context, &x.s, image_b);
        for (int y = 0; y < r[3]; ++y)
            same &= memcmp(image_b + 4 * y * r[2], image_a + 4 * ((r[1] + y) * 101 + r[0]),
                           4 * (size_t)r[2] * sizeof(float)) == 0;
        if (!CHECK(same)) printf("    region %d\n", n);
    }
    stage_free(&x);
}

/* The mixed scene against the reference, which has no pixel filter: so there are no particles smaller than a pixel. The
   remaining errors are those of the classified volume and of shadows' edges, which test_transport covers. */
static void test_mixed(void) {
    const int width = check_long() ? 50 : 31, height = check_long() ? 41 : 25;
    stage x;
    double most = 0, error;
    build_mixed(&x);
    x.s.view.quality = SPS_QUALITY_HIGH;
    x.s.view.slab_thickness = x.s.view.shadow_resolution = 0;
    x.s.view.width = width, x.s.view.height = height;
    x.s.volume[0] = x.s.volume[1];
    x.s.scene.volume_count = 1;
    for (int n = 0; n < 2; ++n) {
        size_t kept = 0;
        for (size_t i = 0; i < x.clouds[n].count; ++i)
            if (x.clouds[n].list[i].radius > 0.12f) x.clouds[n].list[kept++] = x.clouds[n].list[i];
        x.clouds[n].count = kept;
    }
    stage_render(&x, image_a);
    stage_march(&x, 0.7, image_b);
    for (int i = 0; i < width * height; ++i) most = fmax(most, (double)image_b[4 * i]);
    error = check_rms(image_a, image_b, 4 * (size_t)(width * height)) / most;
    printf("mixed scene: error %.2e\n", error);
    CHECK(error < 5e-3);
    stage_free(&x);
}

/* --------------------------------------------------------------------------------------------------------- odd data */

/* A stray particle, or radii far below all other sizes, need no more than the maximum number of slabs. */
static void test_outliers(void) {
    /* one stray of 250000 changes the spread by a 500th of its distance: 100000 slabs by itself */
    static const double strays[3] = {1e3, 1e7, 1e14};
    for (int n = 0; n < 6; ++n) {
        stage x;
        sps_stats_report stats;
        stage_clear(&x, 33, 31);
        stage_add(&x, 0.5);
        fill(&x, 0, n == 2 ? 250000 : 300, 5);
        if (n < 3)
            cloud_add(&x.clouds[0], 0, 0, -strays[n], 0.1, 1);
        else
            for (size_t i = 0; i < 300; ++i) x.clouds[0].list[i].radius = (float)(1 / strays[n - 3]);
        check_add_directional(&x.s, 0.3, 0.2, -1, 1);
        x.s.view.quality = SPS_QUALITY_MEDIUM;
        if (!stage_render(&x, image_a)) return;
        sps_get_stats(context, &stats);
        if (!CHECK(stats.slabs <= (n < 3 ? (1 << 16) + 1 : 1000)))
            printf("    %d: %.0f slabs\n", n, (double)stats.slabs);
        stage_free(&x);
    }
}

static void check_refused(stage *x, sps_result expected, const char *words) {
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = image_a;
    stage_ready(x);
    for (int reference = 0; reference < 2; ++reference) {
        const sps_result result = reference ? check_reference(context, &x->s.scene, &x->s.view, 1, &image)
                                            : sps_render(context, &x->s.scene, &x->s.view, &image);
        if (!CHECK(result == expected && strstr(sps_error(context), words)))
            printf("    %d: %s, not %s\n", (int)result, sps_error(context), words);
    }
}

static void test_invalid(void) {
    static const float bad[] = {-1, 2e18f, 0, 0};
    for (int field = 0; field < 5; ++field)
        for (int n = 0; n < 4; ++n) {
            const float value = n == 2 ? (float)HUGE_VAL : n == 3 ? (float)(HUGE_VAL - HUGE_VAL) : bad[n];
            static const char *const names[] = {"position", "position", "position", "radius", "optical_depth"};
            char words[80];
            sps_stats_report stats;
            sps_particle *particle;
            stage x;
            if (field < 3 && n == 0) continue; /* a valid position */
            stage_clear(&x, 13, 11);
            stage_add(&x, 0.5);
            stage_add(&x, 0.5);
            fill(&x, 0, 10, 6);
            fill(&x, 1, 5000, 7);
            particle = &x.clouds[1].list[4321];
            ((float *)(void *)particle)[field] = value;
            snprintf(words, sizeof words, "particles[1].particle[4321].%s is ", names[field]);
            check_refused(&x, SPS_ERROR_DATA, words);
            x.s.scene.replace_invalid = 1;
            if (!stage_render(&x, image_a)) return;
            sps_get_stats(context, &stats);
            CHECK(stats.values_replaced == 1 && stats.particles == 5009);
            particle->radius = 0;
            particle->optical_depth = 1;
            check_color(particle->position, 0, 0, 0);
            if (!stage_render(&x, image_b)) return;
            CHECK(memcmp(image_a, image_b, 13 * 11 * 4 * sizeof(float)) == 0);
            stage_free(&x);
        }
}

/* Invalid arguments, each named in the error. */
static void test_refusals(void) {
    static const char *const words[] = {
        "particles[1].start_canary", "particles[1].end_canary", "scene.particle_set_count", "scene.particle_set_count",
        "particles[1].read_fn",      "particles[1].lobe_count", "particles[1].lobes[0]",    "particles[1].albedo",
        "particles[1].emission",     "particles[1].count"};
    static const sps_lobe bent = {2, 1};
    for (int n = 0; n < 10; ++n) {
        sps_plan_report plan;
        stage x;
        stage_clear(&x, 13, 11);
        stage_add(&x, 0.5);
        stage_add(&x, 0.5);
        fill(&x, 0, 10, 6);
        fill(&x, 1, 10, 6);
        if (n == 0) { /* whatever stands behind a canary that is set is not read */
            x.set[1].start_canary = 1;
            x.set[1].lobes = (const sps_lobe *)(uintptr_t)8, x.set[1].lobe_count = 1;
        }
        if (n == 1) x.set[1].end_canary = 1;
        if (n == 2) x.s.scene.particles = NULL;
        if (n == 4) x.set[1].read_fn = NULL;
        if (n == 5) x.set[1].lobe_count = 3;
        if (n == 6) x.set[1].lobes = &bent, x.set[1].lobe_count = 1;
        if (n == 7) x.set[1].albedo[1] = 1.5f;
        if (n == 8) x.set[1].emission[1] = -1;
        stage_ready(&x);
        if (n == 9) x.set[1].count = (size_t)1 << 29; /* too many together with the set before */
        if (n == 3) x.s.scene.particle_set_count = -1;
        CHECK(sps_plan(context, &x.s.scene, &x.s.view, &plan) == SPS_ERROR_ARGUMENT);
        if (!CHECK(strstr(sps_error(context), words[n]))) printf("    %s: %s\n", words[n], sps_error(context));
        stage_free(&x);
    }
}

/* The sentence with which a stage is refused whose light cannot cast shadows by sheets. */
static const char *light_refused(stage *x) {
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = image_a;
    stage_ready(x);
    CHECK(sps_render(context, &x->s.scene, &x->s.view, &image) == SPS_ERROR_UNSUPPORTED);
    return sps_error(context);
}

/* A light amid particles that is to shade by sheets is refused as in a volume. */
static void test_light_inside(void) {
    stage x;
    stage_clear(&x, 13, 11);
    stage_add(&x, 0.5);
    fill(&x, 0, 100, 6);
    check_add_point(&x.s, 0, 0, 0, 1);
    check_force_sheets(&x.s);
    CHECK(strstr(light_refused(&x), "light[0]") != NULL);
    x.s.light[0].no_shadow = 1;
    stage_render(&x, image_a);
    stage_free(&x);
}

/* A sun on a ball as large as the world is not too close to it: its texels would begin beyond 1e15. */
static void test_light_too_far(void) {
    const char *sentence;
    stage x;
    stage_clear(&x, 13, 11);
    stage_add(&x, 0.5);
    cloud_add(&x.clouds[0], 0, 0, 0, 1e15, 1);
    check_add_directional(&x.s, 0.3, 0.2, -1, 1);
    sentence = light_refused(&x);
    if (!CHECK(strcmp(sentence, "light[0] cannot tell its texels apart so far from the world's origin") == 0))
        printf("    %s\n", sentence);
    stage_free(&x);
}

/* Empty sets, and sets of empty particles, have no effect. */
static void test_nothing(void) {
    stage x;
    build_mixed(&x);
    x.s.scene.particle_set_count = 0;
    check_render(context, &x.s, image_a);
    for (int form = 0; form < 4; ++form) {
        x.s.scene.particle_set_count = 2;
        x.set[0].count = x.set[1].count = form ? 1500 : 0;
        for (int i = 0; i < 1500; ++i)
            for (int n = 0; n < 2; ++n) {
                if (form == 1) x.clouds[n].list[i].radius = 0;
                if (form == 2) x.clouds[n].list[i].optical_depth = 0, x.clouds[n].list[i].radius = 1;
                if (form == 3) x.clouds[n].list[i].optical_depth = 1e-33f;
            }
        /* one of the same appearance as the volume, and one that would need a channel of its own */
        x.set[1].emission[0] = x.set[1].emission[1] = x.set[1].emission[2] = 0;
        check_render(context, &x.s, image_b);
        if (!CHECK(check_largest(image_a, image_b, 4 * 101 * 83) <= 1e-6)) printf("    form %d\n", form);
    }
    stage_free(&x);
}

/* Every callback's failure, in any call, is reported; so is every cancellation. */
static int stop_at(void *user, float fraction) {
    int *left = (int *)user;
    (void)fraction;
    return --*left == 0;
}

static void test_failing(void) {
    stage x;
    sps_config config;
    sps_context *own;
    int left = 0, cancelled = 0;
    stage_clear(&x, 13, 11);
    stage_add(&x, 0.5);
    stage_add(&x, 0.5);
    fill(&x, 0, 100, 6);
    fill(&x, 1, 9000, 7);
    for (int call = 1; call <= 3; ++call) {
        x.clouds[1].calls = 0;
        x.clouds[1].limit_calls = call;
        x.clouds[0].calls = 0;
        stage_ready(&x);
        {
            sps_image image;
            memset(&image, 0, sizeof image);
            image.rgba = image_a;
            CHECK(sps_render(context, &x.s.scene, &x.s.view, &image) == SPS_ERROR_CALLBACK);
            CHECK(strcmp(sps_error(context), "particles[1].read_fn failed: it returned 7") == 0);
            CHECK(x.clouds[0].calls == 1 && x.clouds[1].calls == call);
        }
    }
    x.clouds[1].limit_calls = 0;
    CHECK(x.clouds[1].largest == 4096 && x.clouds[1].zeroed == 3 * 4096);
    memset(&config, 0, sizeof config);
    config.progress_fn = stop_at;
    config.clock_fn = check_hasty_clock;
    config.progress_user = &left;
    own = sps_create(&config, NULL);
    for (int n = 1; n < 1000; n += 1 + n / 4) {
        sps_image image;
        sps_result result;
        memset(&image, 0, sizeof image);
        image.rgba = image_a;
        left = n;
        result = sps_render(own, &x.s.scene, &x.s.view, &image);
        if (result == SPS_OK) break;
        if (!CHECK(result == SPS_ERROR_CANCELLED)) break;
        ++cancelled;
    }
    CHECK(cancelled > 5); /* once a batch, once a chunk */
    sps_destroy(own);
    stage_free(&x);
}

/* Every allocation fails in turn: an error each time, nothing leaks, and the next call is right. */
static void test_memory(void) {
    stage x;
    build_mixed(&x);
    x.set[0].count = 200, x.set[1].count = 100;
    x.s.view.width = 31, x.s.view.height = 29;
    x.s.view.quality = SPS_QUALITY_DRAFT;
    check_render(context, &x.s, image_a);
    for (int reference = 0; reference < 2; ++reference)
        for (long fail = 1; fail < 200; ++fail) {
            check_hooks hooks;
            sps_context *own;
            sps_image image;
            sps_result result;
            memset(&hooks, 0, sizeof hooks);
            memset(&image, 0, sizeof image);
            image.rgba = image_b;
            own = check_context(&hooks);
            hooks.fail_at = hooks.allocations + fail;
            result = reference ? check_reference(own, &x.s.scene, &x.s.view, 30, &image)
                               : sps_render(own, &x.s.scene, &x.s.view, &image);
            if (result != SPS_OK) {
                CHECK(result == SPS_ERROR_MEMORY);
                check_render(own, &x.s, image_b);
                CHECK(memcmp(image_a, image_b, 31 * 29 * 4 * sizeof(float)) == 0);
            }
            sps_destroy(own);
            CHECK(hooks.live == 0 && hooks.live_blocks == 0);
            if (result == SPS_OK) {
                CHECK(fail > (reference ? 12 : 15));
                break;
            }
        }
    stage_free(&x);
}

/* ------------------------------------------------------------------------------------------------------------ plans */

static void test_plan(void) {
    for (int form = 0; form < 8; ++form) {
        check_hooks hooks;
        sps_context *own;
        sps_plan_report plan;
        sps_stats_report stats;
        stage x;
        build_mixed(&x);
        if (form & 1) x.s.scene.volume_count = 0;
        if (form & 2) x.s.scene.light_count = 0;
        if (form & 4) x.s.scene.mesh_count = 0, x.s.view.shadow_resolution = 90, x.set[0].count = 0;
        memset(&hooks, 0, sizeof hooks);
        own = check_context(&hooks);
        const int lit = form & 2 ? 0 : form & 1 ? 1 : 2; /* of lights by sheets; without volumes, one has a table */
        CHECK_OK(own, sps_plan(own, &x.s.scene, &x.s.view, &plan));
        check_render_depth(own, &x.s, image_a, distance_a);
        sps_get_stats(own, &stats);
        CHECK(plan.particle_calls == (uint64_t)(form & 4 ? 2 : 3) && stats.particle_calls == plan.particle_calls);
        CHECK(x.clouds[0].calls + x.clouds[1].calls == 2 * (long)plan.particle_calls); /* plan and render */
        if (!CHECK(hooks.peak <= plan.bytes)) printf("    form %d: %zu of %zu\n", form, hooks.peak, plan.bytes);
        CHECK(plan.pass[SPS_PASS_GATHER].runs == 1 && plan.pass[SPS_PASS_EYE_SHEETS].runs == (lit > 0 ? lit : 1));
        CHECK(plan.pass[SPS_PASS_LIGHT_SHEETS].runs == lit && plan.pass[SPS_PASS_EMISSION].runs == 1);
        CHECK(strstr(plan.pass[SPS_PASS_GATHER].reason, "particles") != NULL);
        CHECK(plan.pass[SPS_PASS_SCATTERING].runs == lit);
        sps_destroy(own);
        stage_free(&x);
    }
}

/* The bound holds even if particles' records, or the light's sheets, are nearly all of the memory. */
static void test_plan_bounds(void) {
    for (int lit = 0; lit < 2; ++lit) {
        check_hooks hooks;
        sps_context *own;
        sps_plan_report plan;
        stage x;
        stage_clear(&x, 3, 3);
        stage_add(&x, 0.5);
        fill(&x, 0, lit ? 1000 : 60000, 9);
        for (int i = 0; i < 1000 && lit; ++i) x.clouds[0].list[i].radius = 0.002f;
        if (lit) check_add_directional(&x.s, 0.2, 0.1, -1, 1);
        x.s.view.width = x.s.view.height = 4096; /* pixels are smaller than particles */
        x.s.view.region[2] = x.s.view.region[3] = 3;
        x.s.view.quality = SPS_QUALITY_DRAFT;
        x.s.view.slab_thickness = 1000;
        stage_ready(&x);
        memset(&hooks, 0, sizeof hooks);
        own = check_context(&hooks);
        CHECK_OK(own, sps_plan(own, &x.s.scene, &x.s.view, &plan));
        check_render(own, &x.s, image_a);
        if (!CHECK(hooks.peak <= plan.bytes)) printf("    lit %d: %zu of %zu\n", lit, hooks.peak, plan.bytes);
        /* 20 bytes, 12, and 132 of a record: one chunk holds them all; 68 a texel of 512 on the longer side, and some
         */
        CHECK(lit ? hooks.peak > 8 * 1000 * 1000 : hooks.peak > 60000 * 164);
        CHECK(plan.bytes < 3 * hooks.peak);
        sps_destroy(own);
        stage_free(&x);
    }
}

/* Statistics of a ball: its pixels, once, times the slabs it is in; nothing for a light that casts no shadow. */
static void test_stats(void) {
    sps_stats_report stats;
    stage x;
    stage_clear(&x, 40, 40);
    check_orthographic(&x.s.view.camera, 2);
    stage_add(&x, 0.5);
    cloud_add(&x.clouds[0], 0, 0, 0, 0.5, 1);
    check_add_directional(&x.s, 0, 0, -1, 1)->no_shadow = 1;
    x.s.view.slab_thickness = 1000;
    if (!stage_render(&x, image_a)) return;
    sps_get_stats(context, &stats);
    CHECK(stats.slabs == 1 && stats.eye_footprints == 1 && stats.eye_fragments == 400 && stats.light_footprints == 0);
    x.s.light[0].no_shadow = 0;
    if (!stage_render(&x, image_a)) return;
    sps_get_stats(context, &stats);
    CHECK(stats.light_footprints > 0 && stats.light_fragments > 0);
    stage_free(&x);
}

/* A chunk's items in a queue are those that reach into it, in the order of their numbers; and again after a restart. */
static void test_queue(void) {
    enum { ITEMS = 300, CHUNKS = 23 };
    check_random random = {17};
    spsi_queue queue;
    sps_context *own = sps_create(NULL, NULL);
    memset(&queue, 0, sizeof queue);
    CHECK_OK(own, spsi_queue_reserve(own, SPSI_BUFFER_PARTICLE_QUEUE, ITEMS, CHUNKS, &queue));
    for (int i = 0; i < ITEMS; ++i) {
        const double low = SPSI_CHUNK * (CHUNKS * 1.2 * check_next(&random) - 2), most = i % 7 ? 3 : 30;
        spsi_queue_set(&queue, i, CHUNKS, low, low + SPSI_CHUNK * most * check_next(&random));
    }
    spsi_queue_sort(&queue, CHUNKS);
    for (int n = 0; n < 2 * CHUNKS; ++n) {
        const int chunk = n % CHUNKS;
        int count = 0, in_order = 1;
        spsi_queue_advance(&queue, chunk);
        for (int i = 0; i < ITEMS; ++i) {
            if (queue.chunks[i][0] > chunk || queue.chunks[i][1] < chunk) continue;
            in_order &= count < queue.current && queue.present[count] == i;
            ++count;
        }
        CHECK(in_order && count == queue.current && count > 0);
    }
    sps_destroy(own);
}

/* Bounds and sizes of particles, far from the world's origin and from the first of them: six around one centre. */
static void test_measures(void) {
    static const double offsets[6][3] = {{3, 0, 0}, {-3, 0, 0}, {0, 2, 0}, {0, -2, 0}, {0, 0, 1}, {0, 0, -1}};
    static spsi_content content;
    static spsi_frame frame;
    spsi_particle list[6];
    memset(list, 0, sizeof list);
    for (int i = 0; i < 6; ++i) { /* whole numbers that are exact in floats */
        check_color(list[i].position, 70000 + offsets[i][0], -3000 + offsets[i][1], 500 + offsets[i][2]);
        list[i].radius = i & 1 ? 8 : 2;
    }
    memset(&content, 0, sizeof content);
    memset(&frame, 0, sizeof frame);
    frame.content = &content;
    content.bounds = spsi_nowhere;
    content.particles = list;
    content.particle_count = content.set_ends[0] = 6;
    spsi_measure_particles(&frame);
    CHECK_NEAR(content.particle_radius, 4, 1e-12);
    CHECK_NEAR(content.particle_spread, sqrt((9 + 9 + 4 + 4 + 1 + 1) / 6.0), 1e-12);
    CHECK_NEAR(content.bounds.low[0], 70000 - 11, 1e-9); /* of the second */
    CHECK_NEAR(content.bounds.high[0], 70000 + 8, 1e-9); /* of the fourth and the sixth */
    CHECK_NEAR(content.bounds.low[1], -3000 - 10, 1e-9);
    CHECK_NEAR(content.bounds.high[2], 500 + 8, 1e-9);
}

/* A particle smaller than a texel has the same width on all six faces of a cube around a light: that of a texel at the
   largest of its three coordinates; its optical depth is reduced by the square of the widening. */
static void test_sizes_on_six_faces(void) {
    static const double offsets[3][3] = {{3, -4, 2}, {-3, 3, 3}, {0.5, 0.25, -7}}, largest[3] = {4, 3, 7};
    static const double origin[3] = {100, 200, 300};
    enum { SIZE = 65 };
    spsi_particle_set set;
    memset(&set, 0, sizeof set);
    for (int n = 0; n < 3; ++n)
        for (int face = 0; face < SPSI_CUBE_FACES; ++face) {
            const double wide = SPSI_SPHERE_LEAST * 2 / (SIZE - 1) * largest[n];
            spsi_particle particle;
            spsi_rays rays;
            spsi_sphere ball;
            double radius;
            memset(&particle, 0, sizeof particle);
            memset(&ball, 0, sizeof ball);
            particle.radius = 0.01f;
            particle.optical_depth = 0.0005f;
            CHECK(spsi_rays_of_cube_face(origin, face, SIZE, 0, &rays));
            radius = spsi_sphere_radius(&rays, &particle, offsets[n]);
            spsi_sphere_dilute(&set, &particle, radius, &ball);
            CHECK_NEAR(radius, wide, 1e-12);
            CHECK_NEAR((double)ball.depth * wide * wide / 5e-8, 1, 4 * ROUNDING);
            particle.radius = 2, particle.optical_depth = 3;
            radius = spsi_sphere_radius(&rays, &particle, offsets[n]);
            spsi_sphere_dilute(&set, &particle, radius, &ball);
            CHECK(radius >= 2 && radius <= 2 && ball.depth >= 3 && ball.depth <= 3);
        }
}

/* The library's chords of a ball against double precision. */
typedef struct chord_errors {
    int missed;            /* pixels that meet the ball outside its range */
    double square, middle; /* errors of a chord's share of the diameter; of the depth of its middle */
} chord_errors;

/* The vector of pixels from (x, y) on. */
static void compare_chords(const spsi_rays *rays, const spsi_particle *particle, const spsi_sphere *ball, int x, int y,
                           chord_errors *errors) {
    const double radius = (double)particle->radius;
    float share[SPSI_LANES], middle[SPSI_LANES];
    spsi_chord chord;
    spsi_sphere_chord(rays, ball, x, y, &chord);
    spsi_store(share, chord.share);
    spsi_store(middle, chord.middle);
    for (int i = 0; i < SPSI_LANES; ++i) {
        double ray[3], centre[3], nearest[3], exact, square;
        for (int k = 0; k < 3; ++k) centre[k] = (double)particle->position[k];
        spsi_ray_direction(rays, x + i, y, ray);
        exact = vec_dot(centre, ray) / vec_dot(ray, ray);
        vec_along(centre, ray, -exact, nearest);
        square = fmax(1 - vec_dot(nearest, nearest) / (radius * radius), 0);
        if (exact + radius * sqrt(square / vec_dot(ray, ray)) < 0) continue; /* all of it is behind the eye */
        if (x + i < ball->x0 || x + i > ball->x1 || y < ball->y0 || y > ball->y1) {
            errors->missed += square > RIM;
            continue;
        }
        errors->square = fmax(errors->square, fabs((double)share[i] * (double)share[i] - square));
        if (square > 0) errors->middle = fmax(errors->middle, fabs((double)middle[i] + rays->depth_reference - exact));
    }
}

/* Close by, within four radii, chords have float precision: the square of the share to two roundings, the middle, which
   lies up to 4 radii of 1.5 ahead, to one. All pixels that meet the ball are in its range. */
static void test_chords_close_by(void) {
    enum { WIDTH = 64, HEIGHT = 40 };
    check_random random;
    random.state = 3;
    for (int n = 0; n < 200; ++n) {
        const double radius = 0.5 + check_next(&random), ahead = n % 40 * 0.1 * radius;
        chord_errors errors = {0, 0, 0};
        spsi_particle_set set;
        spsi_particle particle;
        sps_view view;
        spsi_rays rays;
        spsi_sphere ball;
        memset(&set, 0, sizeof set);
        memset(&view, 0, sizeof view);
        memset(&rays, 0, sizeof rays);
        rays.width = WIDTH, rays.height = view.height = HEIGHT;
        check_perspective(&view.camera, 0.3 + 1.5 * check_next(&random));
        view.camera.up[1] = 1;
        view.camera.target[2] = -1;
        if (!CHECK(spsi_rays_from_camera(&rays, &view.camera))) return;
        check_color(particle.position, (check_next(&random) - 0.5) * radius, (check_next(&random) - 0.5) * radius,
                    -ahead);
        particle.radius = (float)radius;
        particle.optical_depth = 1;
        spsi_sphere_build(&rays, &set, &particle, &ball);
        for (int y = 0; y < HEIGHT; ++y)
            for (int x = 0; x < WIDTH; x += SPSI_LANES) compare_chords(&rays, &particle, &ball, x, y, &errors);
        if (!CHECK(errors.missed == 0 && errors.square < 2 * ROUNDING && errors.middle < 4 * 1.5 * ROUNDING))
            printf("    %g radii ahead: %d missed, square off by %g, middle by %g\n", ahead / radius, errors.missed,
                   errors.square, errors.middle);
    }
}

int main(void) {
    context = check_context(NULL);
    RUN(test_chords_close_by);
    RUN(test_sizes_on_six_faces);
    RUN(test_queue);
    RUN(test_measures);
    RUN(test_one_ball);
    RUN(test_across_tiles);
    RUN(test_near_plane);
    RUN(test_cut_by_polygon);
    RUN(test_small);
    RUN(test_depths);
    RUN(test_emission);
    RUN(test_shadow_on_polygon);
    RUN(test_shadow_on_ball);
    RUN(test_against_reference);
    RUN(test_lit_inside);
    RUN(test_weak);
    RUN(test_voxel_stand_in);
    RUN_LONG(test_many);
    RUN(test_mass);
    RUN(test_dense_specks);
    RUN(test_drift);
    RUN(test_margins);
    RUN(test_channels);
    RUN(test_order);
    RUN(test_same_bits);
    RUN(test_mixed);
    RUN(test_outliers);
    RUN(test_invalid);
    RUN(test_refusals);
    RUN(test_light_inside);
    RUN(test_light_too_far);
    RUN(test_nothing);
    RUN(test_failing);
    RUN_LONG(test_memory);
    RUN(test_plan);
    RUN(test_plan_bounds);
    RUN(test_stats);
    sps_destroy(context);
    return check_report();
}
