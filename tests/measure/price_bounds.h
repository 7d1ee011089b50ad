/* price_bounds.h: for prices.c, how far apart the bounds of sps_reference are in each scene, at which price, and what
   they say of pictures. */

#ifndef PRICE_BOUNDS_H
#define PRICE_BOUNDS_H

/* The step of the bounds, in voxels; and of a reference's pixels, every how many-th is taken in each direction: where it
   has all of the picture, and otherwise. */
#define BOUND_STEP 0.5
enum { BOUND_STRIDE_ALL = 9, BOUND_STRIDE = 3 };

/* Some pixels of a scene, and their bounds. */
typedef struct bounded {
    sampled pixels;
    float *lower, *upper;
    double seconds, width, high; /* of the call; mean distance of the bounds, and its 99th percentile */
} bounded;

static size_t bounded_count(const bounded *b) {
    return 3 * (size_t)b->pixels.frame.view.width * (size_t)b->pixels.frame.view.height;
}

/* The first of a sample's columns, and rows, in a picture of PRICE_SIZE. */
static size_t sampled_first(const sampled *t) {
    return (size_t)(PRICE_SIZE - (t->frame.view.width - 1) * t->stride - 1) / 2;
}

/* Where number i of a sample's pixels is in that picture. */
static size_t sampled_place(const sampled *t, size_t i) {
    const size_t side = (size_t)t->frame.view.width, stride = (size_t)t->stride, first = sampled_first(t);
    return (first + i / side * stride) * PRICE_SIZE + first + i % side * stride;
}

/* The number of a pixel of that picture, which the sample has. */
static size_t sampled_number(const sampled *t, size_t place) {
    const size_t side = (size_t)t->frame.view.width, stride = (size_t)t->stride, first = sampled_first(t);
    return (place / PRICE_SIZE - first) / stride * side + (place % PRICE_SIZE - first) / stride;
}

/* Returns non-zero where a scene has no bounds, for which the context has a sentence. */
static int bounded_measure(bounded *b, ex_session *session) {
    sps_reference_settings settings;
    sps_image image;
    const size_t count = bounded_count(b);
    double *widths = (double *)ex_allocate(count, sizeof *widths);
    memset(&settings, 0, sizeof settings), memset(&image, 0, sizeof image);
    settings.step = BOUND_STEP, settings.lower = b->lower, settings.upper = b->upper;
    image.rgba = b->pixels.frame.rgba;
    const double start = ex_now(NULL);
    const sps_result failed =
        sps_reference(session->context, &b->pixels.frame.scene, &b->pixels.frame.view, &settings, &image);
    b->seconds = ex_now(NULL) - start;
    b->width = 0;
    for (size_t i = 0; i < count && !failed; ++i) {
        widths[i] = (double)b->upper[i] - (double)b->lower[i];
        b->width += widths[i] / (double)count;
    }
    if (!failed) b->high = ex_percentile(widths, count, 0.99);
    free(widths);
    return failed != SPS_OK;
}

/* The largest distance by which what is known otherwise, at least in these pixels, is outside of the bounds. */
static double bounded_outside(const bounded *b, const sampled *truth) {
    double most = 0;
    for (size_t i = 0; i < bounded_count(b); ++i) {
        const size_t pixel = sampled_number(truth, sampled_place(&b->pixels, i / 3));
        const double exact = (double)truth->frame.rgba[4 * pixel + i % 3];
        most = fmax(most, fmax((double)b->lower[i] - exact, exact - (double)b->upper[i]));
    }
    return most;
}

/* Root mean squares between which the error of a picture of PRICE_SIZE must be, at these pixels. */
static void bounded_error(const bounded *b, const float *rgba, double error[2]) {
    double squares[2] = {0, 0};
    for (size_t i = 0; i < bounded_count(b); ++i) {
        const double found = (double)rgba[4 * sampled_place(&b->pixels, i / 3) + i % 3];
        const double below = found - (double)b->lower[i], above = (double)b->upper[i] - found;
        squares[0] += pow(fmax(0, -fmin(below, above)), 2);
        squares[1] += pow(fmax(below, above), 2);
    }
    for (int k = 0; k < 2; ++k) error[k] = sqrt(squares[k] / (double)bounded_count(b));
}

static void bounded_begin(bounded *b, const priced *p) {
    const int stride = p->truth.stride == 1 ? BOUND_STRIDE_ALL : p->truth.stride * BOUND_STRIDE;
    sampled_begin(&b->pixels, &p->frame, stride);
    b->lower = (float *)ex_allocate(bounded_count(b), sizeof(float));
    b->upper = (float *)ex_allocate(bounded_count(b), sizeof(float));
}

static void bounded_end(bounded *b) {
    sampled_end(&b->pixels);
    free(b->lower), free(b->upper);
}

#endif /* PRICE_BOUNDS_H */
