/* Cascades of transmittance maps (examples/cascades.h): neighbours agree where one ends and the next begins, and with
   one map of everything. */

#include "check.h"

#include "cascades.h"

enum { TEXELS = 512, SEAM_POINTS = 300 };

/* Clouds from 4 to 6, waves as long as 9. */
static int cloud_value(void *user, size_t count, const double *positions, float *out) {
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const double layer = fmax(1 - pow(positions[1] - 5, 2), 0);
        const double waves = 0.5 + 0.5 * sin(0.7 * positions[0]) * sin(0.6 * positions[2] + 0.3 * positions[0]);
        out[i] = (float)(layer * waves);
    }
    return 0 * !user;
}

static ex_outlook look(void) {
    ex_outlook eye = {{0, 2.5, 8}, {0, 0, 0}, {1, 0, 0}, {0, 0, 0}, {0.6, 0.35}, {0, 1.5}};
    eye.forward = ex_vec_unit(ex_vec_of(0, -0.3, -1));
    eye.up = ex_vec_cross(eye.right, eye.forward);
    return eye;
}

/* A map of the same gas over all of the ground, exact along its rays. */
static sps_tmap *make_whole(sps_context *context, const sps_scene *scene, ex_vec sun) {
    const ex_outlook eye = look();
    ex_vec corners[8];
    sps_tmap_light light;
    sps_tmap_settings settings;
    sps_tmap *map = NULL;
    ex_outlook_corners(&eye, 1, 40, corners);
    for (int i = 0; i < 8; ++i) corners[i].y = i & 2 ? 20 : -1; /* from before all gas to behind it */
    ex_cascade_aim(corners, sun, TEXELS, &light, &settings);
    settings.technique = SPS_TMAP_DEEP;
    if (CHECK_OK(context, sps_tmap_create(context, &light, &settings, &map)) &&
        CHECK_OK(context, sps_tmap_add(map, scene)) && CHECK_OK(context, sps_tmap_finish(map)))
        return map;
    sps_tmap_destroy(map);
    return NULL;
}

static double through(const sps_tmap *map, ex_vec p) {
    const double at[3] = {p.x, p.y, p.z};
    float value = -1;
    sps_tmap_query(map, 1, at, NULL, &value);
    return (double)value;
}

/* Texels of the last cascade are 0.2 wide, on the ground. T bends by at most 0.7^2 0.35, so that interpolation is up to
   0.2^2 / 8 of that off, 9e-4; a map of everything has texels of 0.23 and is off by 1.1e-3. */
static void test_seams(void) {
    const double range[2] = {1, 40};
    const ex_vec sun = ex_vec_unit(ex_vec_of(0.4, -1, 0.3));
    const ex_outlook eye = look();
    const sps_placement placement = {{-40, 2, -45}, {{80, 0, 0}, {0, 6, 0}, {0, 0, 70}}};
    sps_context *context = sps_create(NULL, NULL);
    sps_scene scene;
    sps_volume gas;
    ex_cascades cascades;
    double seam = 0, error = 0, least = 1, most = 0;
    memset(&scene, 0, sizeof scene), memset(&gas, 0, sizeof gas);
    gas.size[0] = 100, gas.size[1] = 8, gas.size[2] = 88;
    gas.placement = placement, gas.eval_fn = cloud_value, gas.extinction = 1;
    scene.volumes = &gas, scene.volume_count = 1;
    CHECK_OK(context, ex_cascades_make(context, &scene, &eye, sun, range, TEXELS, &cascades));
    sps_tmap *whole = make_whole(context, &scene, sun);
    for (int i = 0; i < SEAM_POINTS * (EX_CASCADES - 1) && whole; ++i) {
        const int k = i % (EX_CASCADES - 1);
        const double side = 2 * fmod(i * 0.618034, 1) - 1, height = 1.5 * fmod(i * 0.754878, 1);
        ex_vec p = ex_vec_add(eye.position, ex_vec_scale(eye.forward, cascades.ends[k + 1]));
        p = ex_vec_add(p, ex_vec_scale(eye.right, 0.6 * side * cascades.ends[k + 1]));
        p.y = height;
        CHECK(ex_cascades_find(&cascades, cascades.ends[k + 1] * (1 - 1e-9)) == k);
        CHECK(ex_cascades_find(&cascades, cascades.ends[k + 1] * (1 + 1e-9)) == k + 1);
        const double a = through(cascades.maps[k], p), b = through(cascades.maps[k + 1], p);
        seam = fmax(seam, fabs(a - b)), error = fmax(error, fabs(b - through(whole, p)));
        least = fmin(least, a), most = fmax(most, a);
    }
    if (getenv("CHECK_FIGURES")) printf("seams %.2g, error %.2g, T %.2f to %.2f\n", seam, error, least, most);
    CHECK(least < 0.4 && most > 0.8);
    CHECK_CASE("Found in review", "cascades under clouds before their near_depth", "seams, in transmittance", seam,
               1e-3, "interpolation between texels");
    CHECK_CASE("Found in review", "cascades under clouds before their near_depth", "against one map", error, 2e-3,
               "interpolation between texels, of both");
    sps_tmap_destroy(whole);
    ex_cascades_destroy(&cascades);
    sps_destroy(context);
}

int main(void) {
    RUN(test_seams);
    return check_report();
}
