/* Matrices from world to clip, of every convention: none that is legal is refused, and transposed ones are. The latter
   need no truth but that: each is made from a legal one. */

#include "check.h"

enum {
    LEFT_HANDED = 1, /* the view looks along +z instead of -z */
    ZERO_TO_ONE = 2, /* instead of -1..1 */
    REVERSED = 4,
    INFINITE = 8,
    ORTHOGRAPHIC = 16,
    KINDS = 32
};

typedef enum placing { ANYWHERE, AROUND_ORIGIN, ALONG_AXIS, PLACINGS } placing;

typedef struct camera {
    int kind;
    placing place;
    double half[2], shift[2]; /* of the image at depth 1; lens shift in clip space */
    double near_depth, far_depth, distance;
    double scale;   /* of the world */
    int as_floats;  /* the product is rounded to floats */
    int is_oblique; /* the near plane is not across the view */
} camera;

static sps_context *context;
static check_random numbers;

static double between(double low, double high) { return low + (high - low) * check_next(&numbers); }
static double spread(double low, double high) { return exp(between(log(low), log(high))); }

/* clip = matrix * (x, y, z, 1), where z is along the view if left-handed. The depth row maps near_depth to one end of
   the range and far_depth to the other. */
static void make_projection(const camera *seen, double m[16]) {
    const double sign = seen->kind & LEFT_HANDED ? 1 : -1, low = seen->kind & ZERO_TO_ONE ? 0 : -1;
    const double at_near = seen->kind & REVERSED ? 1 : low, at_far = seen->kind & REVERSED ? low : 1;
    const double n = seen->near_depth, f = seen->far_depth;
    memset(m, 0, 16 * sizeof *m);
    for (int i = 0; i < 2; ++i) {
        m[5 * i] = 1 / seen->half[i];
        m[4 * i + (seen->kind & ORTHOGRAPHIC ? 3 : 2)] = seen->shift[i];
    }
    if (seen->kind & ORTHOGRAPHIC) {
        m[10] = sign * (at_far - at_near) / (f - n);
        m[11] = (at_near * f - at_far * n) / (f - n);
        m[15] = 1;
    } else { /* depth = a + b / d */
        const double b = seen->kind & INFINITE ? (at_near - at_far) * n : (at_near - at_far) * n * f / (f - n);
        m[10] = sign * (seen->kind & INFINITE ? at_far : at_far - b / f);
        m[11] = b;
        m[14] = sign;
        if (seen->is_oblique) m[8] = 0.3, m[9] = -0.2, m[10] *= 0.7, m[11] *= 0.7;
    }
}

/* From the world into the camera's space */
static void make_view(const camera *seen, double m[16]) {
    const double angle = between(0.05, 3.1);
    double axis[3], to[3] = {0, 0, 0}, length = 0;
    for (int i = 0; i < 3; ++i) axis[i] = between(-1, 1), length += axis[i] * axis[i];
    if (seen->place == ALONG_AXIS) axis[0] = axis[1] = 0, length = axis[2] * axis[2];
    memset(m, 0, 16 * sizeof *m);
    for (int i = 0; i < 3; ++i) {
        const double a = axis[i] / sqrt(length), b = axis[(i + 1) % 3] / sqrt(length);
        m[5 * i] = seen->scale * (cos(angle) + (1 - cos(angle)) * a * a);
        m[4 * i + (i + 1) % 3] =
            seen->scale * ((1 - cos(angle)) * a * b - sin(angle) * axis[(i + 2) % 3] / sqrt(length));
        m[4 * ((i + 1) % 3) + i] =
            seen->scale * ((1 - cos(angle)) * a * b + sin(angle) * axis[(i + 2) % 3] / sqrt(length));
    }
    to[2] = (seen->kind & LEFT_HANDED ? 1 : -1) * seen->distance;
    if (seen->place == ANYWHERE)
        for (int i = 0; i < 3; ++i) to[i] += between(-1, 1) * seen->distance;
    for (int i = 0; i < 3; ++i) m[4 * i + 3] = to[i];
    m[15] = 1;
}

static void make_matrix(const camera *seen, double m[16], double transposed[16]) {
    double projection[16], view[16];
    make_projection(seen, projection);
    make_view(seen, view);
    for (int i = 0; i < 16; ++i) {
        m[i] = 0;
        for (int k = 0; k < 4; ++k) m[i] += projection[i / 4 * 4 + k] * view[4 * k + i % 4];
        if (seen->as_floats) m[i] = (double)(float)m[i];
        transposed[i % 4 * 4 + i / 4] = m[i];
    }
}

static sps_result plan(const double matrix[16]) {
    sps_plan_report report;
    check_scene s;
    check_clear(&s, 16, 12);
    check_matrix(&s.view.camera, matrix);
    return sps_plan(context, &s.scene, &s.view, &report);
}

static camera any_camera(int kind, int places) {
    camera seen;
    memset(&seen, 0, sizeof seen);
    seen.kind = kind;
    seen.place = (placing)((int)(check_next(&numbers) * places) % places);
    for (int i = 0; i < 2; ++i) {
        seen.half[i] = spread(0.05, 4) * (kind & ORTHOGRAPHIC ? 10 : 1);
        seen.shift[i] = check_next(&numbers) < 0.5 ? 0 : between(-1.5, 1.5);
    }
    seen.near_depth = check_next(&numbers) < 0.25 ? 1 : spread(1e-6, 1e3);
    seen.far_depth = seen.near_depth * (1 + spread(0.1, 1e6));
    seen.distance = spread(0.3, 1e3);
    seen.scale = check_next(&numbers) < 0.75 ? 1 : spread(0.01, 100);
    seen.as_floats = check_next(&numbers) < 0.5;
    return seen;
}

/* A near plane at 1 gives the transpose a w in world units, too, as an infinite reversed depth does from 1 to 0. Then a
   scaled world leaves nothing by which to tell the two. */
static int is_ambiguous(const camera *seen) {
    return seen->near_depth >= 1 && seen->near_depth <= 1 && !(seen->scale >= 1 && seen->scale <= 1);
}

/* Every legal matrix is taken: with lens shift, any near plane, scaled worlds, oblique near planes, and along an axis.
 */
static void test_legal(void) {
    long refused = 0, count = 0;
    for (int n = 0; n < 200 * KINDS; ++n) {
        double matrix[16], transposed[16];
        camera seen = any_camera(n % KINDS, PLACINGS);
        if ((seen.kind & INFINITE && seen.kind & ORTHOGRAPHIC) || is_ambiguous(&seen)) continue;
        seen.is_oblique = n % 7 == 0;
        if (seen.is_oblique) seen.scale = 1;
        make_matrix(&seen, matrix, transposed);
        ++count;
        if (plan(matrix) && ++refused < 5)
            printf("    kind %d placing %d near %g scale %g oblique %d: %s\n", seen.kind, (int)seen.place,
                   seen.near_depth, seen.scale, seen.is_oblique, sps_error(context));
    }
    CHECK(count > 3500);
    CHECK_CASE("Found in review", "matrices of every convention", "none is refused", (double)refused, 0, "exact");
}

/* Transposed ones are refused, and the sentence says why: wherever the camera is, and in perspective along the world's
   z axis, too, where the transpose has the form of a camera's, but not the unit of length. Not told are orthographic
   views along that axis, and those in whose middle is the world's origin, half way from near to far: their transpose is
   orthographic, too. */
static void test_transposed(void) {
    long taken = 0, count = 0;
    for (int n = 0; n < 200 * KINDS; ++n) {
        double matrix[16], transposed[16];
        camera seen = any_camera(n % KINDS, PLACINGS);
        int good;
        if (seen.place == ALONG_AXIS) {
            if (seen.kind & ORTHOGRAPHIC || (seen.near_depth >= 1 && seen.near_depth <= 1)) continue;
            seen.scale = 1;
        }
        if ((seen.kind & INFINITE && seen.kind & ORTHOGRAPHIC) || is_ambiguous(&seen)) continue;
        make_matrix(&seen, matrix, transposed);
        ++count;
        good = plan(transposed) == SPS_ERROR_ARGUMENT &&
               strstr(sps_error(context), "view.camera.world_to_clip seems transposed: it must be row-major") != NULL;
        if (!good && ++taken < 5)
            printf("    kind %d placing %d near %g scale %g: %s\n", seen.kind, (int)seen.place, seen.near_depth,
                   seen.scale, sps_error(context));
    }
    CHECK(count > 3500);
    CHECK_CASE("Found in review", "matrix that was not transposed", "the error says so", (double)taken, 0, "exact");
}

int main(void) {
    context = sps_create(NULL, NULL);
    RUN(test_legal);
    RUN(test_transposed);
    sps_destroy(context);
    return check_report();
}
