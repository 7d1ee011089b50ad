/* Spotlights of any cone, down to 1e-7 radians, on a wall and in gas, against closed forms and sums in double precision
   that call nothing of the library. All lights are slanted, so that no small angle is small in world coordinates, and
   cameras are as narrow as the spots. Tolerances are shares of a picture's peak. */

#include "check.h"

enum { SIDE = 24, COUNT = 4 * SIDE * SIDE };
static float image[COUNT];
static sps_context *context;
static check_triangles wall;

static const double at[3] = {-2.3, 0.31, 0.17}; /* of the light in gas */
static const double outer_cones[] = {0.3, 1e-2, 1e-3, 1e-5, 1e-7};

/* What a cone lets pass [KHR_lights_punctual] at an angle between vectors: squares of sines, not differences of
   cosines. */
static double cone_at(const sps_light *light, const double offset[3]) {
    const double *a = light->direction, *b = offset;
    const double c[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    const double sine = sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]), cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const double angle = atan2(sine, cosine), inner = light->inner_cone, outer = light->outer_cone;
    const double whole = 2 * sin(0.5 * (outer + inner)) * sin(0.5 * (outer - inner));
    const double share = 2 * sin(0.5 * (outer + angle)) * sin(0.5 * (outer - angle)) / whole;
    return share < 0 ? 0 : share > 1 ? 1 : share * share;
}

static double square(const double a[3]) { return a[0] * a[0] + a[1] * a[1] + a[2] * a[2]; }

/* A spotlight at `from`, aimed at `target`, in a picture of what is 1.5 times as wide as the spot, seen along -z. */
static sps_light *start(check_scene *s, const double from[3], const double target[3], double inner, double outer) {
    sps_light *light;
    double way[3];
    check_clear(s, SIDE, SIDE);
    for (int i = 0; i < 3; ++i) way[i] = target[i] - from[i];
    check_add_point(s, from[0], from[1], from[2], 1);
    light = &s->light[0];
    check_set3(light->direction, way[0], way[1], way[2]);
    light->inner_cone = inner * outer, light->outer_cone = outer;
    check_set3(s->view.camera.position, target[0], target[1], 3);
    check_set3(s->view.camera.target, target[0], target[1], 0);
    check_set3(s->view.camera.up, 0, 1, 0);
    check_orthographic(&s->view.camera, 3 * sqrt(square(way)) * tan(fmin(outer, 0.1)));
    return light;
}

/* Offset from a light of the point at height z below a pixel's centre. */
static void point_of(const check_scene *s, int x, int y, double z, double offset[3]) {
    const double *camera = s->view.camera.target, pixel = s->view.camera.ortho_height / SIDE;
    offset[0] = camera[0] + (x + 0.5 - SIDE / 2) * pixel - s->light[0].position[0];
    offset[1] = camera[1] - (y + 0.5 - SIDE / 2) * pixel - s->light[0].position[1];
    offset[2] = z - s->light[0].position[2];
}

/* Light falls on a wall of albedo 1 by cone, cosine and distance. Floats leave 6e-8 of each of a dozen factors; where
   the rim is half of the spot, an angle's round-off counts four times: 1e-5. A disc of 1e-4 of the spot moves its
   points by that; the rim's slope is at most 4, and points on either side cancel but for its square. */
static void test_wall(void) {
    static const double origin[3] = {-9, -9, 0}, u[3] = {18, 0, 0}, v[3] = {0, 18, 0};
    static const double from[3] = {0.7, -0.9, 2.1}, target[3] = {0.123, 0.456, 0};
    wall.count = 0;
    check_add_quad(&wall, origin, u, v);
    for (int n = 0; n < 20; ++n) {
        double worst = 0, peak = 0, offset[3];
        check_scene s;
        sps_light *light = start(&s, from, target, n & 1 ? 0.5 : 0, outer_cones[n / 4]);
        check_add_mesh(&s, &wall, 1);
        if (n & 2) {
            light->kind = SPS_LIGHT_DISC;
            light->axes[0][0] = light->axes[1][1] = 1e-4 * light->outer_cone;
        }
        if (!check_render(context, &s, image)) continue;
        for (int i = 0; i < SIDE * SIDE; ++i) {
            double truth;
            point_of(&s, i % SIDE, i / SIDE, 0, offset);
            truth = cone_at(light, offset) * -offset[2] / pow(square(offset), 1.5) / PI;
            peak = fmax(peak, truth), worst = fmax(worst, fabs((double)image[4 * i] - truth));
        }
        CHECK(peak > 0.01);
        CHECK_CASE("Found in review", "spotlights of 0.3 to 1e-7 radians on a wall, points and discs",
                   "cone x cosine / (pi r^2)", worst / peak, 1e-5, "round-off of floats");
    }
}

/* Single scattering in gas of extinction 1e-3, which attenuates by 0.3 % at most: a pixel is the integral of cone, 1 /
   r^2 and attenuation along its ray, by sums here. `image`: what the light throws, u and v of the picture in red and
   green. */
static double beam(const check_scene *s, int x, int y, double extinction, double thrown[3]) {
    enum { STEPS = 1500 };
    const sps_light *light = &s->light[0];
    const double *a = light->direction, reach = 1.3 * sqrt(square(a)) * tan(fmin(light->outer_cone, 1));
    double first[3], middle, low, high, sum = 0;
    point_of(s, x, y, 0, first);
    /* the point of the ray z that is nearest to the axis: the beam is across it, nearly along x */
    middle = first[2] * 0 + (first[0] / a[0]) * a[2] - first[2];
    low = fmax(middle - reach, -1), high = fmin(middle + reach, 1);
    thrown[0] = thrown[1] = 0;
    for (int i = 0; i < STEPS; ++i) {
        const double z = low + (high - low) * (i + 0.5) / STEPS;
        double p[3], r2, share, within;
        point_of(s, x, y, z, p);
        r2 = square(p), within = sqrt(r2) * (1 - (-1 - light->position[0]) / p[0]);
        share = cone_at(light, p) * exp(-extinction * (1 - z + within));
        share *= light->falloff == SPS_FALLOFF_NONE ? 1 : 1 / r2;
        sum += share;
        if (light->projector) {
            const double ahead = (p[0] * a[0] + p[1] * a[1] + p[2] * a[2]) / sqrt(square(a));
            const double side = (p[2] * a[0] - p[0] * a[2]) / sqrt(a[0] * a[0] + a[2] * a[2]);
            thrown[0] += share * (side / ahead / light->projector->right + 1) / 2;
        }
    }
    thrown[0] *= extinction / (4 * PI) * (high - low) / STEPS;
    return sum * extinction / (4 * PI) * (high - low) / STEPS;
}

static double one(const void *user, const double p[3]) { return (void)user, (void)p, 1; }

static const check_field even = {one, NULL, {0, 0, 0}, {{0, 0, 0}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}}};

static int ramp(void *user, size_t count, const float *uv, float *rgb) {
    (void)user;
    for (size_t i = 0; i < count; ++i) rgb[3 * i] = uv[2 * i], rgb[3 * i + 1] = uv[2 * i + 1], rgb[3 * i + 2] = 1;
    return 0;
}

/* Error of a picture of a spotlight in gas, of its peak, and of what it throws. */
static double gas_error(check_scene *s, double extinction) {
    sps_volume *volume = check_add_volume(s, 32, 32, 32, check_box(-1, -1, -1, 1, 1, 1));
    double worst = 0, peak = 0;
    volume->eval_fn = check_eval_field, volume->user = (void *)(size_t)&even;
    volume->extinction = (float)extinction;
    check_color(volume->albedo, 1, 1, 1);
    s->view.scattering = SPS_SCATTERING_SINGLE;
    if (!check_render(context, s, image)) return HUGE_VAL;
    for (int i = 0; i < SIDE * SIDE; i += 7) {
        double thrown[3];
        const double truth = beam(s, i % SIDE, i / SIDE, extinction, thrown);
        peak = fmax(peak, truth), worst = fmax(worst, fabs((double)image[4 * i + 2] - truth));
        if (s->light[0].projector) worst = fmax(worst, fabs((double)image[4 * i] - thrown[0]));
    }
    return worst / peak;
}

/* In thin gas, what is left is the ripple of its voxels about the beam, of less than 1e-4 there; in gas of optical
   depth 2, what the ripple of 0.3 % does to the way in and out: 0.3 %, too, and 0.2 % where slabs are lit in part,
   within which gas counts evenly. A beam is much narrower than a slab, whose two ends differ by 4 % there. */
static void test_gas(void) {
    static const double target[3] = {0.0123, 0.0456, 0.02};
    for (int n = 0; n < 5; ++n)
        for (int kind = 0; kind < 6; ++kind) {
            const double outer = outer_cones[n], edge = 1.5 * tan(outer);
            sps_projector slide;
            check_scene s;
            sps_light *light = start(&s, at, target, kind & 1 ? 0.5 : 0, outer);
            if (kind == 1) light->falloff = SPS_FALLOFF_NONE;
            if (kind == 2) light->shadow_source = SPS_SHADOW_TABLE;
            if (kind == 3) light->kind = SPS_LIGHT_DISC, light->axes[0][2] = light->axes[1][1] = 1e-4 * outer;
            if (kind == 3) light->no_shadow = 1, s.view.no_shadows = 1;
            memset(&slide, 0, sizeof slide);
            slide.width = slide.height = 64, slide.sample_fn = ramp;
            slide.left = slide.bottom = -edge, slide.right = slide.top = edge, slide.up[1] = 1;
            if (kind == 4) light->projector = &slide;
            if (kind < 5)
                CHECK_CASE("Found in review",
                           "spotlights of 0.3 to 1e-7 radians in thin gas: sheets, tables, a disc, "
                           "an image, no falloff",
                           "the integral along the ray, of the peak", gas_error(&s, 1e-5), 1e-4, "ripple of voxels");
            else
                CHECK_CASE("Found in review", "spotlights of 0.3 to 1e-7 radians in gas of optical depth 2",
                           "the integral along the ray, of the peak", gas_error(&s, 1), 0.005,
                           "ripple of voxels, and slabs that are lit in part");
        }
}

/* A beam from a rectangle as wide as the spot: gas sees the mean of cones from all of it. Points a sixteenth of the
   spot apart stand for cells, whose midpoints err by 1 / 24 of the rim's curvature, of some 20 / 16^2: 0.3 % of the
   peak. */
static void test_wide_beam(void) {
    enum { PLACES = 24, POINTS = 256 };
    static const double target[3] = {0.0123, 0.0456, 0.02};
    const double outer = 0.04, half = 2.3 * outer;
    double worst = 0, peak = 0;
    check_scene s;
    sps_light *light = start(&s, at, target, 0, outer);
    light->kind = SPS_LIGHT_RECTANGLE, light->axes[0][2] = light->axes[1][1] = half;
    light->samples = POINTS, light->no_shadow = 1;
    s.view.no_shadows = 1;
    gas_error(&s, 1e-5);
    light->kind = SPS_LIGHT_POINT;
    for (int i = 0; i < SIDE * SIDE; i += check_long() ? 7 : 31) {
        double truth = 0, thrown[3];
        for (int n = 0; n < PLACES * PLACES; ++n) {
            light->position[1] = at[1] + ((n % PLACES + 0.5) / PLACES * 2 - 1) * half;
            light->position[2] = at[2] + ((n / PLACES + 0.5) / PLACES * 2 - 1) * half;
            truth += beam(&s, i % SIDE, i / SIDE, 1e-5, thrown) / PLACES / PLACES;
        }
        peak = fmax(peak, truth), worst = fmax(worst, fabs((double)image[4 * i + 2] - truth));
    }
    CHECK_CASE("Shadows", "a beam from a rectangle as wide as the spot, in gas", "the mean of beams, of the peak",
               worst / peak, 0.01, "256 points");
}

int main(void) {
    context = check_context(NULL);
    RUN(test_wall);
    RUN(test_gas);
    RUN(test_wide_beam);
    check_free_triangles(&wall);
    sps_destroy(context);
    return check_report();
}
