/* A scene that has everything, changed as a whole in ways of which the picture is known: brighter, larger, its colors
   exchanged, its lists turned round. Each of the ways to make images and maps of it must follow. */

#include "everything.h"

enum { FACTOR = 32 }; /* a power of two, which rounds nothing */

static void scale_floats(float *values, int count, double by) {
    for (int i = 0; i < count; ++i) values[i] = (float)((double)values[i] * by);
}

static void scale_doubles(double *values, int count, double by) {
    for (int i = 0; i < count; ++i) values[i] *= by;
}

/* What shines in everything. */
static void scale_light(double by) {
    for (int i = 0; i < 3; ++i) scale_floats(it.light[i].color, 3, by);
    for (int i = 0; i < 2; ++i) scale_floats(it.volume[i].emission, 3, by), scale_floats(it.volume[i].ambient, 3, by);
    for (int i = 0; i < 3; ++i) scale_floats(it.point[i].emission, 3, by);
    scale_floats(it.set.emission, 3, by), scale_floats(it.set.ambient, 3, by);
    scale_floats(it.look.emission, 3, by);
    scale_floats(it.scene.ambient, 3, by), scale_floats(it.scene.background, 3, by);
}

static void scale_camera(sps_camera *camera, double by) {
    scale_doubles(camera->position, 3, by), scale_doubles(camera->target, 3, by);
}

/* All lengths; gas has as many optical depths and as much radiance across it as before, and lamps light from there. */
static void scale_lengths(double by) {
    for (int i = 0; i < 2; ++i) {
        scale_doubles(it.volume[i].placement.origin, 3, by);
        scale_doubles(it.volume[i].placement.axis[0], 9, by);
        it.volume[i].extinction = (float)((double)it.volume[i].extinction / by);
        scale_floats(it.volume[i].emission, 3, 1 / by);
        scale_doubles(it.mesh[i].placement.axis[0], 9, by), scale_doubles(it.mesh[i].placement.origin, 3, by);
    }
    for (int i = 0; i < 3; ++i) {
        it.point[i].extinction = (float)((double)it.point[i].extinction / by);
        scale_floats(it.point[i].emission, 3, 1 / by);
    }
    for (int i = 0; i < 4; ++i)
        scale_floats(it.particle[i].position, 3, by), scale_floats(&it.particle[i].radius, 1, by);
    for (int i = 1; i < 3; ++i) {
        scale_doubles(it.light[i].position, 3, by);
        scale_floats(it.light[i].color, 3, by * by);
    }
    scale_doubles(it.light[2].axes[0], 6, by);
    it.unit = by;
    scale_camera(&it.view.camera, by), scale_camera(&it.map_light.camera, by);
    it.map_settings.near_depth *= by, it.map_settings.far_depth *= by;
    it.map_settings.surface_bias *= by;
}

/* Red becomes green, green blue, and blue red. */
static void turn(float color[3]) {
    const float red = color[0];
    color[0] = color[2], color[2] = color[1], color[1] = red;
}

static void turn_colors(void) {
    for (int i = 0; i < 3; ++i) turn(it.light[i].color), turn(it.point[i].albedo), turn(it.point[i].emission);
    for (int i = 0; i < 2; ++i) {
        turn(it.volume[i].albedo), turn(it.volume[i].emission), turn(it.volume[i].ambient);
        turn(it.mesh[i].albedo), turn(it.mesh[i].transmittance);
    }
    for (int i = 0; i < CORNERS; ++i) turn(it.colors + 3 * i);
    turn(it.set.albedo), turn(it.set.emission), turn(it.set.ambient), turn(it.look.albedo), turn(it.look.emission);
    turn(it.scene.ambient), turn(it.scene.background);
    slide_turn = 2;
}

static void brighter(void) { scale_light(FACTOR); }
static void larger(void) { scale_lengths(FACTOR); }

/* Everything but lights. */
static void turn_lists(void) {
    const sps_volume volume = it.volume[0];
    const sps_mesh mesh = it.mesh[0];
    const sps_triangle triangle = it.triangle[0];
    const sps_particle particle = it.particle[0];
    it.volume[0] = it.volume[1], it.volume[1] = volume;
    it.mesh[0] = it.mesh[1], it.mesh[1] = mesh;
    it.triangle[0] = it.triangle[1], it.triangle[1] = triangle;
    it.particle[0] = it.particle[2], it.particle[2] = particle;
}

/* Lights by tables share a sweep; of others, the first one's slabs also hold what no light shades. */
static void turn_lights(void) {
    const sps_light light = it.light[0];
    it.light[0] = it.light[2], it.light[2] = light;
}

/* How much each may be off, relative to the largest float. Factors round nothing; sums in another order round as floats
   do. Light between cells ends where cycles change little: as other rounding does (docs/ports.md), another order of
   channels may change it by 3e-5. */
static const struct {
    const char *name;
    void (*change)(void);
    double tolerance;
} relations[] = {{"brighter", brighter, 0},
                 {"larger", larger, 0},
                 {"colors", turn_colors, 5e-5},
                 {"lists", turn_lists, 1e-5},
                 {"lights", turn_lights, 1e-5}};

enum { BRIGHTER, LARGER, COLORS, LISTS, LIGHTS, RELATIONS };

/* The scene for a way. The reference turns the points of an extended light by a hash of the place, so its sun has no
   extent, and there is no disc. */
static void prepare(const way *w) {
    build(), slide_turn = 0;
    if (w->by != REFERENCE) return;
    it.light[0].angular_diameter = 0, it.light[0].samples = 0;
    it.scene.light_count = 2;
}

static void check_relation(int r, int n) {
    static outcome before, after;
    const way *w = &ways[n];
    double worst = 0, most = 0;
    size_t colors;
    if (r == LIGHTS && w->source != SPS_SHADOW_TABLE) return;
    prepare(w), set_way(w, PLAIN);
    make_fresh(w, &before);
    colors = w->by == MAP ? 0 : 4 * (size_t)it.view.width * (size_t)it.view.height;
    prepare(w), relations[r].change(), set_way(w, PLAIN);
    make_fresh(w, &after);
    if (!CHECK(before.result == SPS_OK && after.result == SPS_OK && before.count == after.count)) return;
    for (size_t i = 0; i < colors && r == COLORS; i += 4)
        for (int k = 0; k < 2; ++k) turn(after.data + i); /* twice more: as before */
    for (size_t i = 0; i < before.count; ++i) {
        const int is_color = i < colors && i % 4 < 3, is_depth = w->by != MAP && i >= colors;
        const double by = (r == BRIGHTER && is_color) || (r == LARGER && is_depth) ? FACTOR : 1;
        if (!(fabsf(before.data[i]) < 1e14f)) continue; /* nothing there */
        most = fmax(most, fabs((double)before.data[i]));
        worst = fmax(worst, fabs((double)after.data[i] / by - (double)before.data[i]));
    }
    if (figures()) printf("%s, way %d: %.3g of %.3g\n", relations[r].name, n, worst, most);
    if (!CHECK_CASE("Engineering", "everything brighter, larger, in exchanged colors, or in other order",
                    "the same picture or map; relative to its largest float", worst / most, relations[r].tolerance,
                    "exact; sums in another order"))
        printf("    %s, way %d (%d, scattering %d, source %d): %g of %g\n", relations[r].name, n, (int)w->by,
               (int)w->scattering, (int)w->source, worst, most);
}

static void test_relations(void) {
    for (int r = 0; r < RELATIONS; ++r)
        for (int n = 0; n < WAYS; ++n)
            if (check_long() || (r + n) % 2 == 0) check_relation(r, n);
}

int main(void) {
    RUN(test_relations);
    return check_report();
}
