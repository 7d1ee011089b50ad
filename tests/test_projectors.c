/* Images that lights throw: reproduced on a wall, texel by texel; halved where pixels are large; sharp at the focus and
   blurred elsewhere, against closed forms; in gas, against the reference; a white image is none. */

#include "check.h"

enum { SIDE = 32, COUNT = 4 * SIDE * SIDE };
static float image_a[COUNT], image_b[COUNT];
static sps_context *context;
static check_triangles ground;

/* --- images --- */

typedef struct slide {
    int size, calls; /* texels on a side */
    int fail_at;     /* call that fails; 0: none */
    float wrong;     /* if not 0: the green of one texel of the last row */
    int pattern;
} slide;

enum { WHITE, NOISE, CHECKER, HALVES, GREY, HOLED, ROWS, COLUMNS, LINES, POSTS };

/* A color of the texel at (x, y): a hash. */
static void noise(int x, int y, float rgb[3]) {
    uint32_t h = (uint32_t)x * 0x9e3779b1u ^ (uint32_t)y * 0x85ebca77u;
    for (int c = 0; c < 3; ++c) {
        h ^= h >> 15, h *= 0x2c1b3c6du, h ^= h >> 12;
        rgb[c] = (float)(h & 0xffff) / 65535;
    }
}

static int sample_slide(void *user, size_t count, const float *uv, float *out) {
    slide *s = (slide *)user;
    s->calls += 1;
    for (size_t i = 0; i < count; ++i, uv += 2, out += 3) {
        const int x = (int)((double)uv[0] * s->size), y = (int)((double)uv[1] * s->size);
        out[0] = out[1] = out[2] = 1;
        if (s->pattern == NOISE || s->pattern == HOLED) noise(x, y, out);
        if (s->pattern == HOLED && y == s->size - 1 && x == 1) out[0] = out[1] = out[2] = 0;
        if (s->pattern == LINES) out[0] = out[1] = out[2] = (float)(y & 1);
        if (s->pattern == POSTS) out[0] = out[1] = out[2] = (float)(x & 1);
        if (s->pattern == ROWS) out[0] = out[1] = out[2] = (float)((y + 2) >> 2 & 1);
        if (s->pattern == COLUMNS) out[0] = out[1] = out[2] = (float)((x + 2) >> 2 & 1);
        if (s->pattern == GREY) out[0] = out[1] = out[2] = 0.5f;
        if (s->pattern == CHECKER) out[0] = out[1] = out[2] = (float)((x ^ y) & 1);
        if (s->pattern == HALVES) out[0] = (float)(uv[0] < 0.5f), out[1] = (float)(uv[1] < 0.5f), out[2] = 0;
        if (s->wrong != 0 && y == s->size - 1 && x == 1) out[1] = s->wrong; /* NaN differs from 0 too */
    }
    return s->calls == s->fail_at ? 5 : 0;
}

/* --- a white wall at z = 0, 4 world units high, seen from z = 5 along -z --- */

static void start_wall(check_scene *s) {
    const double origin[3] = {-30, -30, 0}, u[3] = {60, 0, 0}, v[3] = {0, 60, 0};
    check_clear(s, SIDE, SIDE);
    ground.count = 0;
    check_add_quad(&ground, origin, u, v);
    check_add_mesh(s, &ground, 1);
    check_set3(s->view.camera.position, 0, 0, 5);
    s->view.camera.ortho_height = 4;
}

static sps_projector projector_of(slide *image, double half) {
    sps_projector projector;
    memset(&projector, 0, sizeof projector);
    projector.width = projector.height = image->size;
    projector.sample_fn = sample_slide;
    projector.user = image;
    projector.left = projector.bottom = -half;
    projector.right = projector.top = half;
    projector.up[1] = 1;
    return projector;
}

/* A light at (0, 0, 5) that throws an image straight at the wall, over the camera's 4 world units. */
static sps_light *add_projector(check_scene *s, sps_light_kind kind, const sps_projector *projector) {
    sps_light *light = check_add_light(s, kind, PI);
    check_set3(light->position, 0, 0, 5);
    check_set3(light->direction, 0, 0, -2);
    light->falloff = SPS_FALLOFF_NONE;
    light->projector = projector;
    return light;
}

static const float *pixel(const float *image, int x, int y) { return image + 4 * (y * SIDE + x); }

/* Image and picture have the same texels, so that each pixel is one: by a directional light as it is, by one with a
   position times the cosine. Texels have floats' coordinates: 32 times 6e-8, times at most 1 from texel to texel. */
static void test_reproduced(void) {
    slide image = {SIDE, 0, 0, 0, NOISE};
    for (int kind = 0; kind < 2; ++kind) {
        const sps_projector projector = projector_of(&image, kind ? 2.0 / 5 : 2);
        check_scene s;
        double worst = 0;
        start_wall(&s);
        add_projector(&s, kind ? SPS_LIGHT_POINT : SPS_LIGHT_DIRECTIONAL, &projector);
        check_render(context, &s, image_a);
        for (int y = 0; y < SIDE; ++y)
            for (int x = 0; x < SIDE; ++x) {
                const double at[2] = {(x + 0.5) * 4 / SIDE - 2, (y + 0.5) * 4 / SIDE - 2};
                const double cosine = kind ? 5 / sqrt(25 + at[0] * at[0] + at[1] * at[1]) : 1;
                float rgb[3];
                noise(x, y, rgb);
                for (int c = 0; c < 3; ++c)
                    worst = fmax(worst, fabs((double)pixel(image_a, x, y)[c] - cosine * (double)rgb[c]));
            }
        if (figures()) printf("reproduced, %s: %.2g\n", kind ? "point" : "directional", worst);
        CHECK_CASE("Transport", "an image that a light throws at a wall", "the image's pixels", worst, 2e-5,
                   "roundings of floats of places in the image");
    }
}

/* A frustum off its axis, turned on its side: its top points along +x, so its right is down. */
static void test_any_frustum(void) {
    slide image = {64, 0, 0, 0, HALVES};
    sps_projector projector = projector_of(&image, 1);
    check_scene s;
    int wrong = 0;
    start_wall(&s);
    check_set3(projector.up, 1, 0, 0);
    projector.left = -0.3, projector.right = 0.1; /* 1.5 up to 0.5 down of the middle */
    projector.bottom = -0.2, projector.top = 0.2; /* 1 to either side */
    add_projector(&s, SPS_LIGHT_POINT, &projector);
    check_render(context, &s, image_a);
    for (int y = 0; y < SIDE; ++y)
        for (int x = 0; x < SIDE; ++x) {
            const double wx = (x + 0.5) * 4 / SIDE - 2, wy = 2 - (y + 0.5) * 4 / SIDE;
            const int inside = fabs(wx) < 1 && wy < 1.5 && wy > -0.5;
            wrong += (pixel(image_a, x, y)[0] > 0.5f) != (inside && wy > 0.5); /* left half: up */
            wrong += (pixel(image_a, x, y)[1] > 0.5f) != (inside && wx > 0);   /* upper half: +x */
            wrong += pixel(image_a, x, y)[2] > 0;
        }
    CHECK(wrong == 0);
    s.light[0].direction[2] = 2; /* away from the wall: the same places of the image, thrown backwards */
    projector.left = projector.bottom = -1, projector.right = projector.top = 1;
    check_render(context, &s, image_a);
    for (int i = 0; i < SIDE * SIDE; ++i) CHECK(!(image_a[4 * i] > 0) && !(image_a[4 * i + 1] > 0));
}

/* Where a pixel has 3 x 3 texels of a checker or more, it shows their mean, except at the edge: all halves are grey. */
static void test_large_pixels(void) {
    static const int sizes[] = {4 * SIDE, 8 * SIDE, 100};
    for (int i = 0; i < 3; ++i) {
        slide image = {sizes[i], 0, 0, 0, CHECKER};
        const sps_projector projector = projector_of(&image, 2);
        check_scene s;
        double worst = 0, sum = 0;
        start_wall(&s);
        add_projector(&s, SPS_LIGHT_DIRECTIONAL, &projector);
        check_render(context, &s, image_a);
        for (int y = 1; y < SIDE - 1; ++y)
            for (int x = 1; x < SIDE - 1; ++x) {
                worst = fmax(worst, fabs((double)pixel(image_a, x, y)[0] - 0.5));
                sum += (double)pixel(image_a, x, y)[0] / ((SIDE - 2) * (SIDE - 2));
            }
        if (figures()) printf("checker of %d on %d pixels: mean %.4f, worst %.4f\n", sizes[i], SIDE, sum, worst);
        CHECK_NEAR(sum, 0.5, 1e-6);
        CHECK(worst < 1e-6);
    }
}

/* Texels that are four times as fine along one side of the image as along the other count as fine: stripes of eight
   texels, one pixel, are grey, and those of halves of the coarse side's size would be black or white. Away from the
   edges, over which halves of eight texels fade within two pixels. */
static void test_oblong_texels(void) {
    for (int columns = 0; columns < 2; ++columns) {
        slide image = {8 * SIDE, 0, 0, 0, columns ? COLUMNS : ROWS};
        sps_projector projector = projector_of(&image, 2);
        check_scene s;
        double worst = 0;
        *(columns ? &projector.height : &projector.width) = 2 * SIDE;
        start_wall(&s);
        add_projector(&s, SPS_LIGHT_DIRECTIONAL, &projector);
        check_render(context, &s, image_a);
        for (int y = 3; y < SIDE - 3; ++y)
            for (int x = 3; x < SIDE - 3; ++x) worst = fmax(worst, fabs((double)pixel(image_a, x, y)[0] - 0.5));
        CHECK(worst < 1e-6);
    }
}

/* Eight rows of black and white, each four pixels high, however many columns there are, or eight such columns: halving
   the short side of texels must leave the long one. Rows' middles lie two pixels from where rows meet, so pixels there
   are an eighth off. */
static void test_long_texels(void) {
    for (int n = 0; n < 10; ++n) {
        const int many = 8 << 2 * (n / 2), columns = n % 2;
        slide image = {8, 0, 0, 0, columns ? POSTS : LINES};
        sps_projector projector = projector_of(&image, 2);
        check_scene s;
        double low = 1, high = 0;
        *(columns ? &projector.height : &projector.width) = many;
        start_wall(&s);
        add_projector(&s, SPS_LIGHT_DIRECTIONAL, &projector);
        check_render(context, &s, image_a);
        for (int i = 3; i < SIDE - 3; ++i) {
            const double here = (double)pixel(image_a, columns ? i : SIDE / 2, columns ? SIDE / 2 : i)[0];
            low = fmin(low, here);
            high = fmax(high, here);
        }
        CHECK_NEAR(low, 0.125, 1e-5);
        CHECK_NEAR(high, 0.875, 1e-5);
    }
}

/* Halving keeps the mean, for sizes that are not powers of two as well: a wall of one pixel per image. */
static void test_halving(void) {
    static const int sizes[] = {1, 2, 3, 5, 7, 37, 100};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; ++i) {
        slide image = {sizes[i], 0, 0, 0, NOISE};
        const sps_projector projector = projector_of(&image, 2);
        double mean[3] = {0, 0, 0};
        check_scene s;
        start_wall(&s);
        s.view.width = s.view.height = 1;
        add_projector(&s, SPS_LIGHT_DIRECTIONAL, &projector);
        check_render(context, &s, image_a);
        for (int k = 0; k < sizes[i] * sizes[i]; ++k) {
            float rgb[3];
            noise(k % sizes[i], k / sizes[i], rgb);
            for (int c = 0; c < 3; ++c) mean[c] += (double)rgb[c] / (sizes[i] * sizes[i]);
        }
        /* a pixel of 37 or 100 texels lies between two levels, of which the first has 2 texels a side: the same mean */
        for (int c = 0; c < 3; ++c) CHECK_NEAR((double)image_a[c], mean[c], 1e-5);
    }
}

/* A slide whose right half is black, thrown by a disc: at the focus the edge is sharp, and at distance d it is a disc's
   integral over |1 - d / focus| times its radius. A sun is in focus at its position. */
static double disc_share(double u) {
    u = fmin(fmax(u, -1), 1);
    return 0.5 + (asin(u) + u * sqrt(1 - u * u)) / PI;
}

static void test_focus(void) {
    static const double focuses[] = {5, 10, 3, 0};
    for (int sun = 0; sun < 2; ++sun)
        for (int i = 0; i < 4; ++i) {
            slide image = {256, 0, 0, 0, HALVES};
            sps_projector projector = projector_of(&image, sun ? 2 : 2.0 / 5);
            const double at_sun[] = {0, 2.5, 5, 10}; /* distance from the wall to the plane in focus */
            const double half = sun ? at_sun[i] * 0.1 : i == 3 ? 0.4 : 0.4 * fabs(1 - 5 / focuses[i]);
            const double blur = fmax(half, 1e-9);
            check_scene s;
            sps_light *light;
            double worst = 0;
            start_wall(&s);
            light = add_projector(&s, sun ? SPS_LIGHT_DIRECTIONAL : SPS_LIGHT_DISC, &projector);
            light->samples = 256;
            if (sun)
                light->angular_diameter = 2 * atan(0.1), light->position[2] = at_sun[i];
            else
                check_set3(light->axes[0], 0.4, 0, 0), check_set3(light->axes[1], 0, 0.4, 0),
                    projector.focus = focuses[i];
            check_render(context, &s, image_a);
            for (int x = 0; x < SIDE; ++x) {
                const double wx = (x + 0.5) * 4 / SIDE - 2;
                if (fabs(wx) > 1) continue;
                worst = fmax(worst, fabs((double)pixel(image_a, x, SIDE / 2)[0] - disc_share(-wx / blur)));
            }
            if (figures()) printf("%s %d, blur %.2f: worst %.4f\n", sun ? "sun" : "disc", i, half, worst);
            /* 256 points: steps of a few points, 1 / 64; cosines: 2 % at 1 from the axis, (1 + 0.4)^2 / 50 */
            CHECK(worst < 1.0 / 64 + (sun ? 0.005 : 0.04));
        }
}

/* The points of a disc that is tilted out of the plane across the axis are nearer to the wall or farther from it, and
   still agree on it. An edge beside the axis, at x = 1, lies between two pixels of 1/8, whose centres are 7/16 of a
   texel of 1/7 away from it: one has 15/16 of the light and the other 1/16. A lens that is not focused would move it by
   1/10 for its nearest and its farthest points. 2e-5: as in test_reproduced. */
static void test_tilted_lens(void) {
    slide halves = {28, 0, 0, 0, HALVES}, white = {28, 0, 0, 0, WHITE};
    sps_projector projectors[2] = {projector_of(&halves, 0.4), projector_of(&white, 0.4)};
    const int right = SIDE / 2 + SIDE / 4; /* the first pixel beyond x = 1 */
    check_scene s;
    sps_light *light;
    for (int i = 0; i < 2; ++i) projectors[i].left += 0.2, projectors[i].right += 0.2, projectors[i].focus = 5;
    start_wall(&s);
    light = add_projector(&s, SPS_LIGHT_DISC, &projectors[0]);
    check_set3(light->axes[0], 0.4, 0, 0.5);
    check_set3(light->axes[1], 0, 0.4, 0);
    light->samples = 64;
    check_render(context, &s, image_a);
    light->projector = &projectors[1];
    check_render(context, &s, image_b);
    for (int y = 2; y < SIDE - 2; ++y) {
        const double left_white = (double)pixel(image_b, right - 1, y)[0];
        const double right_white = (double)pixel(image_b, right, y)[0];
        CHECK(left_white > 0.8 && right_white > 0.8);
        CHECK_NEAR((double)pixel(image_a, right - 1, y)[0], 15.0 / 16 * left_white, 2e-5);
        CHECK_NEAR((double)pixel(image_a, right, y)[0], 1.0 / 16 * right_white, 2e-5);
    }
}

/* Half of a lens in focus at infinity is hidden by a plate, beyond the near plane: all of its points that throw the red
   half of the image to x = 3/16, but only half of those that throw the green one to y = 1/16. */
static void test_hidden_colors(void) {
    const double corner[3] = {0, -3, 4.9}, u[3] = {3, 0, 0}, v[3] = {0, 6, 0};
    slide image = {SIDE, 0, 0, 0, HALVES};
    const sps_projector projector = projector_of(&image, 0.4);
    const int x = SIDE / 2 + 1, y = SIDE / 2 - 1;
    check_scene s;
    sps_light *light;
    double open_green;
    start_wall(&s);
    light = add_projector(&s, SPS_LIGHT_DISC, &projector);
    check_set3(light->axes[0], 0.4, 0, 0);
    check_set3(light->axes[1], 0, 0.4, 0);
    light->samples = 64;
    s.view.near_distance = 0.5;
    check_render(context, &s, image_b);
    open_green = (double)pixel(image_b, x, y)[1];
    CHECK(pixel(image_b, x, y)[0] > 0.1f && open_green > 0.3);
    check_add_quad(&ground, corner, u, v);
    s.mesh[0].triangle_count = ground.count;
    check_render(context, &s, image_a);
    CHECK(pixel(image_a, x, y)[0] == 0);
    CHECK_NEAR((double)pixel(image_a, x, y)[1] / open_green, 0.5, 0.1); /* 6 of 64 points are near the plate's edge */
}

/* --- what stays the same --- */

static int read_fog(void *user, const int low[3], const int size[3], float *out) {
    (void)user;
    for (int z = 0; z < size[2]; ++z)
        for (int y = 0; y < size[1]; ++y)
            for (int x = 0; x < size[0]; ++x) {
                const int at[3] = {low[0] + x - 10, low[1] + y - 10, low[2] + z - 10};
                *out++ = at[0] * at[0] + at[1] * at[1] + at[2] * at[2] < 16 ? 4.0f : 0.5f; /* a ball in fog */
            }
    return 0;
}

/* A ball within fog before the wall, a plate that cuts off a part of the light, and a light beside the camera. */
static sps_light *start_fog(check_scene *s, sps_light_kind kind, const sps_projector *projector) {
    const double corner[3] = {0.1, 0.3, 2.4}, u[3] = {0.6, 0, 0}, v[3] = {0, 0.6, 0.1};
    sps_light *light;
    sps_volume *fog;
    start_wall(s);
    fog = check_add_volume(s, 20, 20, 20, check_box(-1.5, -1.5, 0.1, 1.5, 1.5, 2.1));
    fog->read_fn = read_fog;
    fog->extinction = 0.8f;
    check_color(fog->albedo, 0.9, 0.8, 0.7);
    check_add_quad(&ground, corner, u, v);
    check_set3(s->view.camera.position, 0.5, 0.4, 7);
    check_set3(s->view.camera.target, 0, 0, 1);
    check_perspective(&s->view.camera, 0.5);
    s->view.quality = SPS_QUALITY_HIGH;
    light = add_projector(s, kind, projector);
    check_color(light->color, 3, 2, 4);
    check_set3(light->position, 1.5, 1, 6);
    check_set3(light->direction, -1.5, -1, -5);
    check_set3(light->axes[0], 0.3, 0, 0.1);
    check_set3(light->axes[1], 0, 0.25, 0);
    if (kind == SPS_LIGHT_DIRECTIONAL) light->angular_diameter = 0.15;
    light->samples = 8;
    return light;
}

/* A white image that covers all is none: the same picture, within rounding. And inverse squares are what they were. */
static void test_white(void) {
    for (int kind = 0; kind < 4; ++kind)
        for (int falls = 0; falls < 2; ++falls) {
            slide image = {4, 0, 0, 0, WHITE};
            const sps_projector projector = projector_of(&image, 50);
            check_scene s;
            sps_light *light = start_fog(&s, (sps_light_kind)kind, &projector);
            if (falls) light->falloff = SPS_FALLOFF_INVERSE_SQUARE;
            check_render(context, &s, image_a);
            light->projector = NULL;
            check_render(context, &s, image_b);
            /* gas has few points without an image: their mean inverse square is off by (extent / distance)^4 */
            CHECK(check_largest(image_a, image_b, COUNT) < (falls && kind > 1 ? 2e-4 : 2e-6));
        }
}

static void test_falloff(void) {
    slide image = {4, 0, 0, 0, WHITE};
    const sps_projector projector = projector_of(&image, 50);
    for (int z = 3; z < 9; z += 2) {
        check_scene s;
        sps_light *light;
        start_wall(&s);
        light = add_projector(&s, SPS_LIGHT_POINT, &projector);
        light->position[2] = z;
        check_render(context, &s, image_a);
        light->falloff = SPS_FALLOFF_INVERSE_SQUARE;
        check_render(context, &s, image_b);
        for (int x = 0; x < SIDE; ++x) {
            const double wx = (x + 0.5) * 4 / SIDE - 2, wy = 2.0 / SIDE;
            const double square = wx * wx + wy * wy + z * z;
            CHECK_NEAR((double)pixel(image_a, x, SIDE / 2)[0] / (double)pixel(image_b, x, SIDE / 2)[0], square,
                       1e-5 * square);
        }
    }
}

/* --- against the reference --- */

/* A region whose reference takes a third of a second, with gas and polygons in it. The noise of 8 points in the
   reference is at most a tenth of what the image varies by, where all of it is seen through one pixel's points, and far
   less in gas. The same without an image is measured beside it. */
static void test_reference(void) {
    static const char *const names[] = {"sun", "point", "disc"};
    static const int region[4] = {13, 13, 4, 4};
    for (int kind = 0; kind < 3; ++kind) {
        double error[2], mean = 0;
        for (int white = 0; white < 2; ++white) {
            slide image = {6, 0, 0, 0, white ? WHITE : NOISE};
            const sps_projector projector = projector_of(&image, kind ? 0.3 : 1.5);
            check_scene s;
            start_fog(&s, (sps_light_kind)kind, &projector)->samples = 64;
            memcpy(s.view.region, region, sizeof region);
            check_render(context, &s, image_a);
            s.light[0].samples = 8;
            check_march(context, &s, 0.2, image_b, NULL);
            error[white] = check_rms(image_a, image_b, 4 * 16);
            mean = 0;
            for (int i = 0; i < 4 * 16; ++i) mean += (double)image_b[i] / 64;
        }
        if (figures())
            printf("%s: rms error %.5f, of a white image %.5f, of a mean of %.4f\n", names[kind], error[0], error[1],
                   mean);
        CHECK(error[0] < error[1] + 0.008 * mean);
    }
}

/* A checker across the line of sight whose texels are a tenth of a slab is grey in gas: a step along a part of a slab
   has 2.5 of them, so that halves of the image are looked up, which are grey. Only the image's edge differs. */
static void test_fine_in_gas(void) {
    double error;
    for (int grey = 0; grey < 2; ++grey) {
        slide image = {200, 0, 0, 0, grey ? GREY : CHECKER};
        const sps_projector projector = projector_of(&image, 1);
        check_scene s;
        start_fog(&s, SPS_LIGHT_DIRECTIONAL, &projector);
        s.light[0].angular_diameter = 0;
        check_set3(s.light[0].position, 0, 0, 1);
        check_set3(s.light[0].direction, -1, -0.2, -0.2);
        s.scene.mesh_count = 0;
        check_perspective(&s.view.camera, 0.05); /* pixels of a texel */
        s.view.quality = SPS_QUALITY_MEDIUM;
        check_render(context, &s, grey ? image_b : image_a);
    }
    error = check_largest(image_a, image_b, COUNT);
    if (figures()) printf("fine checker in gas: %.5f of %.4f\n", error, (double)pixel(image_b, SIDE / 2, SIDE / 2)[0]);
    CHECK(error < 0.01 * (double)pixel(image_b, SIDE / 2, SIDE / 2)[0]);
}

/* --- counts, workers, what is refused --- */

static void test_counts(void) {
    slide image = {24, 0, 0, 0, NOISE};
    const sps_projector projector = projector_of(&image, 2);
    sps_stats_report stats;
    sps_plan_report plan;
    check_scene s;
    sps_context *fresh = check_context(NULL);
    start_wall(&s);
    add_projector(&s, SPS_LIGHT_DIRECTIONAL, &projector);
    CHECK_OK(fresh, sps_plan(fresh, &s.scene, &s.view, &plan));
    CHECK(image.calls == 0 && plan.projector_calls == 24 && plan.pass[SPS_PASS_PROJECTORS].runs == 1);
    CHECK(plan.pass[SPS_PASS_PROJECTORS].bytes >= 24 * 24 * 12 && plan.color_channels == 3);
    check_render(fresh, &s, image_a);
    sps_get_stats(fresh, &stats);
    CHECK(image.calls == 24 && stats.projector_calls == 24 && stats.bytes <= plan.bytes);
    s.light[0].projector = NULL;
    CHECK_OK(fresh, sps_plan(fresh, &s.scene, &s.view, &plan));
    CHECK(plan.projector_calls == 0 && plan.pass[SPS_PASS_PROJECTORS].runs == 0 && plan.color_channels == 1);
    check_render(fresh, &s, image_a);
    sps_get_stats(fresh, &stats);
    CHECK(stats.projector_calls == 0);
    s.light[0].projector = &projector;
    check_color(s.light[0].color, 0, 0, 0); /* a black light's image is not read */
    check_render(fresh, &s, image_a);
    CHECK(image.calls == 24);
    sps_destroy(fresh);
}

static void test_workers(void) {
    static const int region[4] = {5, 9, 20, 13};
    check_hooks hooks;
    sps_context *many;
    memset(&hooks, 0, sizeof hooks);
    hooks.worker_count = 3, hooks.order = 1;
    many = check_context(&hooks);
    for (int kind = 0; kind < 4; ++kind) {
        slide image = {9, 0, 0, 0, NOISE};
        sps_projector projector = projector_of(&image, kind ? 0.3 : 1.5);
        check_scene s;
        int different = 0;
        projector.left *= 1.4, projector.right *= 1.4; /* texels that are halved along both sides, but not square */
        start_fog(&s, (sps_light_kind)kind, &projector);
        check_render(context, &s, image_a);
        check_render(many, &s, image_b);
        CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
        memcpy(s.view.region, region, sizeof region);
        check_render(context, &s, image_b);
        for (int y = 0; y < region[3]; ++y)
            different += memcmp(image_b + 4 * y * region[2], pixel(image_a, region[0], region[1] + y),
                                (size_t)region[2] * 4 * sizeof(float)) != 0;
        CHECK(different == 0);
    }
    sps_destroy(many);
}

static void check_refused(const check_scene *s, sps_result result, const char *text) {
    check_fails(context, s, image_a, result, text);
}

static void test_refused(void) {
    slide image = {8, 0, 0, 0, NOISE};
    const sps_projector right = projector_of(&image, 1);
    sps_projector wrong = right;
    check_scene s;
    start_wall(&s);
    add_projector(&s, SPS_LIGHT_DISC, &wrong);
    check_set3(s.light[0].axes[0], 0, 0, 0.5);
    check_set3(s.light[0].axes[1], 0.5, 0, 0);
    wrong.width = 0;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].projector.width is 0; it must be 1..4096");
    wrong = right, wrong.height = 4097;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].projector.height is 4097; it must be 1..4096");
    wrong = right, wrong.sample_fn = NULL;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].projector.sample_fn is NULL");
    wrong = right, wrong.left = 1;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].projector.left is 1; it must be within 1e15, and less than right");
    wrong = right, wrong.right = 1e16;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].projector.right is 1e+16");
    wrong = right, wrong.bottom = (double)NAN;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].projector.bottom is nan");
    wrong = right, wrong.top = (double)INFINITY;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].projector.top is inf");
    wrong = right, wrong.up[2] = (double)NAN;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].projector.up is nan");
    wrong = right, wrong.focus = 0.4;
    check_refused(&s, SPS_ERROR_ARGUMENT,
                  "light[0].projector.focus is 0.4; it must be 0, or within 1e15 and beyond the extent");
    wrong = right, wrong.focus = 2.5; /* a disc of radius 2, tilted by 45 degrees, is sqrt(2) deep */
    check_set3(s.light[0].axes[0], 0, 0, 2);
    check_set3(s.light[0].axes[1], 0, 2, 0);
    check_set3(s.light[0].direction, 0, -1, -1);
    s.light[0].samples = 2;
    check_render(context, &s, image_a);
    s.light[0].kind = SPS_LIGHT_RECTANGLE;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].projector.focus is 2.5");
    s.light[0].kind = SPS_LIGHT_DISC;
    wrong = right, wrong.end_canary = 3;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].projector.end_canary is 3");
    wrong = right;
    s.light[0].falloff = (sps_falloff)2;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].falloff is 2; it must be an sps_falloff");
    s.light[0].falloff = SPS_FALLOFF_NONE;
    check_set3(s.light[0].direction, 0, 0, 0);
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].direction is 0");
    check_set3(s.light[0].direction, 0, 0, -1);
    image.calls = 0, image.fail_at = 3;
    check_refused(&s, SPS_ERROR_CALLBACK, "light[0].projector.sample_fn failed: it returned 5");
    image.fail_at = 0, image.wrong = -1;
    check_refused(&s, SPS_ERROR_DATA, "light[0].projector.sample_fn's color is -1");
    image.wrong = NAN;
    check_refused(&s, SPS_ERROR_DATA, "light[0].projector.sample_fn's color is nan");
}

/* Where invalid colors are replaced, the texel is black: all of the picture is that of an image with a black one. */
static void test_replaced(void) {
    slide spoilt = {SIDE, 0, 0, NAN, NOISE}, holed = {SIDE, 0, 0, 0, HOLED};
    const sps_projector projectors[2] = {projector_of(&spoilt, 2), projector_of(&holed, 2)};
    sps_stats_report stats;
    check_scene s;
    start_wall(&s);
    add_projector(&s, SPS_LIGHT_DIRECTIONAL, &projectors[0]);
    s.scene.replace_invalid = 1;
    check_render(context, &s, image_a);
    sps_get_stats(context, &stats);
    CHECK(stats.values_replaced == 1);
    s.light[0].projector = &projectors[1];
    check_render(context, &s, image_b);
    CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
    CHECK(pixel(image_a, 1, SIDE - 1)[0] == 0 && pixel(image_a, 1, SIDE - 2)[0] > 0);
}

int main(void) {
    context = check_context(NULL);
    if (!context) return 1;
    RUN(test_reproduced);
    RUN(test_any_frustum);
    RUN(test_large_pixels);
    RUN(test_oblong_texels);
    RUN(test_long_texels);
    RUN(test_halving);
    RUN(test_focus);
    RUN(test_tilted_lens);
    RUN(test_hidden_colors);
    RUN_LONG(test_white);
    RUN(test_falloff);
    RUN(test_reference);
    RUN(test_fine_in_gas);
    RUN(test_counts);
    RUN(test_workers);
    RUN(test_refused);
    RUN(test_replaced);
    sps_destroy(context);
    check_free_triangles(&ground);
    return check_report();
}
