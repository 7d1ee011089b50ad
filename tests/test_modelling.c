/* The modelling tools of the example programs: metaballs, marching cubes, the thickness of closed meshes, smoke puffs,
   texture coordinates. */

#include "check.h"

#include "metaballs.h"
#include "puff.h"
#include "thickness.h"

static const float white[3] = {1, 1, 1};

/* ------------------------------------------------------------------------------------------------------- the fields */

/* Negated distances, as inside is above the level. user: the centre and the radius, or both radii. */
static double ball_field(void *user, ex_vec p) {
    const double *ball = (const double *)user;
    return ball[3] - ex_vec_length(ex_vec_sub(p, ex_vec_of(ball[0], ball[1], ball[2])));
}

static double ring_field(void *user, ex_vec p) {
    const double *radii = (const double *)user;
    return -ex_ring_distance(p, ex_vec_of(0, 0, 0), ex_vec_of(0, 0, 1), radii[0], radii[1]);
}

/* -1..1 at every whole position, uncorrelated between neighbours. */
static double random_field(void *user, ex_vec p) {
    const int seed = *(const int *)user;
    return ex_hash((int)floor(p.x + 0.5) + 1000 * seed, (int)floor(p.y + 0.5), (int)floor(p.z + 0.5)) / 2147483648.0 -
           1;
}

static void add_ball(ex_mesh *mesh, double x, double y, double z, double radius, int cells) {
    double ball[4] = {x, y, z, radius};
    const double half = 1.2 * radius;
    ex_shape_field(mesh, ball_field, ball, 0, ex_vec_of(x - half, y - half, z - half),
                   ex_vec_of(x + half, y + half, z + half), cells, white);
}

/* ------------------------------------------------------------------------------------------------- measuring meshes */

static ex_vec corner_of(const sps_triangle *t, int c) {
    return ex_vec_of((double)t->position[c][0], (double)t->position[c][1], (double)t->position[c][2]);
}

/* Area and, by the divergence theorem, volume: positive only if the triangles face outwards. */
static void measure(const ex_mesh *mesh, double *area, double *volume) {
    *area = *volume = 0;
    for (size_t i = 0; i < mesh->triangle_count; ++i) {
        const ex_vec a = corner_of(&mesh->triangles[i], 0), b = corner_of(&mesh->triangles[i], 1),
                     c = corner_of(&mesh->triangles[i], 2);
        *area += 0.5 * ex_vec_length(ex_vec_cross(ex_vec_sub(b, a), ex_vec_sub(c, a)));
        *volume += ex_vec_dot(a, ex_vec_cross(b, c)) / 6;
    }
}

typedef struct edge {
    size_t from, to; /* indices of the points */
} edge;

static int edge_compare(const void *left, const void *right) {
    const edge *a = (const edge *)left, *b = (const edge *)right;
    if (a->from != b->from) return a->from < b->from ? -1 : 1;
    return a->to < b->to ? -1 : a->to > b->to;
}

/* Counts directed edges that occur more than once, and those whose opposite does not occur: both 0 for a closed
   manifold. Returns its Euler characteristic, corners - edges + triangles. */
static long topology(const ex_mesh *mesh, long *repeated, long *unmatched) {
    const size_t count = 3 * mesh->triangle_count;
    ex_builder builder;
    size_t point_count = 0;
    edge *edges = (edge *)ex_allocate(count, sizeof *edges);
    memset(&builder, 0, sizeof builder);
    for (size_t i = 0; i < count; ++i) {
        const ex_vec p = corner_of(&mesh->triangles[i / 3], (int)(i % 3));
        ex_add_position(&builder, p.x, p.y, p.z);
    }
    size_t *points = ex_weld(&builder, &point_count);
    for (size_t i = 0; i < count; ++i) {
        edges[i].from = points[i];
        edges[i].to = points[i % 3 == 2 ? i - 2 : i + 1];
    }
    qsort(edges, count, sizeof *edges, edge_compare);
    *repeated = *unmatched = 0;
    for (size_t i = 0; i < count; ++i) {
        const edge opposite = {edges[i].to, edges[i].from};
        if (i > 0 && edge_compare(&edges[i - 1], &edges[i]) == 0) ++*repeated;
        if (!bsearch(&opposite, edges, count, sizeof *edges, edge_compare)) ++*unmatched;
    }
    free(points);
    free(edges);
    ex_builder_free(&builder);
    return (long)point_count - (long)(count / 2) + (long)mesh->triangle_count;
}

/* -------------------------------------------------------------------------------------------------------- metaballs */

static void test_metaballs(void) {
    const ex_metaball balls[2] = {{{1, 2, 3}, 2, 5}, {{2, 2, 3}, 0.5, 1}};
    const ex_metaballs both = {balls, 2};
    ex_metaballs user = both;
    const double places[12] = {1, 2, 3, 2, 2, 3, 3, 2, 3, 1, 3.999, 3};
    float out[4];
    /* (1 - r^2 / R^2)^3 in closed form: at the centre 1; at half the radius (3/4)^3, and there the other ball's centre
       is; at the radius and beyond 0, just before it not yet. Rounding of a few operations: 1e-14. As floats: half a
       unit in the last place, 6e-8 of the value. */
    CHECK_NEAR(ex_metaball_value(&balls[0], ex_vec_of(1, 2, 3)), 5, 1e-14);
    CHECK_NEAR(ex_metaballs_value(&user, ex_vec_of(2, 2, 3)), 5 * 27.0 / 64 + 1, 1e-14);
    CHECK_NEAR(ex_metaball_value(&balls[0], ex_vec_of(1, 2, 1)), 0, 0);
    CHECK_NEAR(ex_metaball_value(&balls[0], ex_vec_of(1, 2, 0)), 0, 0);
    CHECK(ex_metaball_value(&balls[0], ex_vec_of(1, 3.999, 3)) > 0);
    CHECK(ex_metaballs_eval(&user, 4, places, out) == 0);
    for (int i = 0; i < 4; ++i) {
        const ex_vec p = ex_vec_of(places[3 * i], places[3 * i + 1], places[3 * i + 2]);
        const double value = ex_metaballs_value(&user, p);
        CHECK_NEAR((double)out[i], value, 6e-8 * value);
    }
}

/* --------------------------------------------------------------------------------------------------- marching cubes */

/* All 256 cases: each crossed edge is in exactly one loop, each loop has an apex. */
static void test_cells(void) {
    for (int inside = 0; inside < 256; ++inside) {
        int follower[24], loop[12], crossed = 0, walked = 0, good = 1;
        for (int corner = 0; corner < 8; ++corner)
            for (int axis = 0; axis < 3; ++axis)
                if (!(corner >> axis & 1)) crossed += (inside >> corner & 1) != (inside >> (corner | 1 << axis) & 1);
        ex_cell_borders(inside, follower);
        for (int start = 0; start < 24; ++start) {
            const int count = ex_cell_loop(follower, start, loop);
            walked += count;
            good &= count == 0 || (count >= 3 && count <= 7 && ex_loop_apex(loop, count) >= 0);
        }
        if (!CHECK(good && walked == crossed)) printf("    inside %d\n", inside);
    }
}

/* Area and volume of a ball and of a ring: a mesh whose corners lie on the surface to O(h^2), h being the cell, misses
   both by O(h^2). Halving h should quarter the error; its constant depends on where the surface meets the lattice,
   hence a ratio above 3 and not 4. Chords up to sqrt(3) h long sag by 3 h^2 / 8 R at the most, R being the smallest
   radius of curvature, and linear interpolation in a distance moves corners by less than the mean sag falls short of
   that. A surface sunk by s loses s times its area of volume, and s times `widening` (how fast the area grows with
   the surface moved out) of area. */
static void check_convergence(ex_field_fn field, double *user, double half, double area, double volume, double radius,
                              double widening, long euler) {
    double area_error[2], volume_error[2];
    for (int fine = 0; fine < 2; ++fine) {
        const int cells = fine ? 46 : 23;
        const double h = 2 * half / cells, sunk = 3 * h * h / (8 * radius);
        ex_mesh mesh;
        double got_area, got_volume;
        long repeated, unmatched;
        memset(&mesh, 0, sizeof mesh);
        ex_shape_field(&mesh, field, user, 0, ex_vec_of(-half, -half, -half), ex_vec_of(half, half, half), cells,
                       white);
        CHECK(topology(&mesh, &repeated, &unmatched) == euler);
        CHECK(repeated == 0 && unmatched == 0);
        measure(&mesh, &got_area, &got_volume);
        CHECK_NEAR(got_volume, volume, area * sunk);
        CHECK_NEAR(got_area, area, widening * sunk);
        area_error[fine] = fabs(got_area - area), volume_error[fine] = fabs(got_volume - volume);
        ex_mesh_free(&mesh);
    }
    if (!CHECK(area_error[0] > 3 * area_error[1]))
        printf("    area off by %g, then %g\n", area_error[0], area_error[1]);
    if (!CHECK(volume_error[0] > 3 * volume_error[1]))
        printf("    volume off by %g, then %g\n", volume_error[0], volume_error[1]);
}

static void test_ball_and_ring(void) {
    double ball[4] = {0.03, -0.02, 0.01, 1}, radii[2] = {1, 0.45};
    check_convergence(ball_field, ball, 1.3, 4 * EX_PI, 4 * EX_PI / 3, 1, 8 * EX_PI, 2);
    check_convergence(ring_field, radii, 1.6, 4 * EX_PI * EX_PI * 0.45, 2 * EX_PI * EX_PI * 0.45 * 0.45, 0.45,
                      4 * EX_PI * EX_PI, 0);
}

/* Normals point away from the ball's centre. Central differences over h of a distance with a curvature of 1/R and a
   third derivative of at most 3/R^3 are off by h^2 / 2 R^2; interpolation along the edge, h^2 / 8 of the same, adds
   less than that again. The triangle faces the same way. */
static void test_normals(void) {
    ex_mesh mesh;
    double worst = 0, facing = 1;
    const double h = 2.4 / 24;
    memset(&mesh, 0, sizeof mesh);
    add_ball(&mesh, 0, 0, 0, 1, 24);
    for (size_t i = 0; i < mesh.triangle_count; ++i) {
        const sps_triangle *t = &mesh.triangles[i];
        const ex_vec a = corner_of(t, 0), b = corner_of(t, 1), c = corner_of(t, 2);
        const ex_vec out = ex_vec_unit(ex_vec_cross(ex_vec_sub(b, a), ex_vec_sub(c, a)));
        for (int k = 0; k < 3; ++k) {
            const ex_vec n = ex_vec_of((double)t->normal[k][0], (double)t->normal[k][1], (double)t->normal[k][2]);
            worst = fmax(worst, ex_vec_length(ex_vec_sub(n, ex_vec_unit(corner_of(t, k)))));
            facing = fmin(facing, ex_vec_dot(n, out));
        }
    }
    CHECK_NEAR(worst, 0, h * h);
    CHECK(mesh.triangle_count > 1000 && facing > 0);
    ex_mesh_free(&mesh);
}

/* Uncorrelated values: most cells have ambiguous faces, and the box's faces cut through the inside. The surface is
   still a closed manifold. */
static void test_random_fields(void) {
    for (int seed = 0; seed < 6; ++seed) {
        ex_mesh mesh;
        long repeated, unmatched;
        double area, volume;
        int user = seed;
        memset(&mesh, 0, sizeof mesh);
        /* another level each time: more and less inside */
        ex_shape_field(&mesh, random_field, &user, 0.15 * (seed - 3), ex_vec_of(0, 0, 0), ex_vec_of(13, 12, 11.5), 13,
                       white);
        topology(&mesh, &repeated, &unmatched);
        measure(&mesh, &area, &volume);
        CHECK(mesh.triangle_count > 2000);
        if (!CHECK(repeated == 0 && unmatched == 0))
            printf("    seed %d: %ld repeated, %ld unmatched\n", seed, repeated, unmatched);
        CHECK(volume > 0);
        ex_mesh_free(&mesh);
    }
}

/* -------------------------------------------------------------------------------------------------------- thickness */

enum { SIDE = 33, PIXELS = SIDE * SIDE };

/* An eye at z = `distance` that looks at the origin; field of view 0: orthographic, 2.4 high. */
static sps_view view_of(double distance, double field_of_view) {
    sps_view view;
    memset(&view, 0, sizeof view);
    view.width = view.height = SIDE;
    view.camera.position[2] = distance;
    view.camera.up[1] = 1;
    check_orthographic(&view.camera, 2.4);
    check_perspective(&view.camera, field_of_view);
    return view;
}

/* The unit vector of a pixel's ray in such a view. */
static ex_vec ray_of(const sps_view *view, int pixel) {
    const double scale = 2 * tan(0.5 * view->camera.field_of_view) / SIDE;
    return ex_vec_unit(
        ex_vec_of((pixel % SIDE + 0.5 - 0.5 * SIDE) * scale, (0.5 * SIDE - pixel / SIDE - 0.5) * scale, -1));
}

/* The length of a ray from `eye` inside a ball at the origin, up to `end`. */
static double chord_of(ex_vec eye, ex_vec ray, double radius, double end) {
    const double middle = -ex_vec_dot(eye, ray), square = radius * radius - ex_vec_dot(eye, eye) + middle * middle;
    const double half = sqrt(fmax(square, 0));
    return ex_clamp(middle + half, 0, end) - ex_clamp(middle - half, 0, end);
}

/* Largest difference between the thickness of a ball's mesh and the ball's chords, where these pass the centre within
   0.9 of the radius. */
static double ball_error(const sps_view *view, int cells, const float *depth) {
    static double sums[PIXELS];
    ex_mesh mesh;
    double worst = 0;
    memset(&mesh, 0, sizeof mesh);
    memset(sums, 0, sizeof sums);
    add_ball(&mesh, 0, 0, 0, 1, cells);
    ex_mesh_thickness(&mesh, view, depth, sums);
    for (int i = 0; i < PIXELS; ++i) {
        const ex_vec eye = ex_vec_of(0, 0, view->camera.position[2]), ray = ray_of(view, i);
        const double square = ex_vec_dot(eye, eye) - pow(ex_vec_dot(eye, ray), 2);
        if (square > 0.81) continue;
        worst = fmax(worst, fabs(sums[i] - chord_of(eye, ray, 1, depth ? (double)depth[i] : 1e9)));
    }
    ex_mesh_free(&mesh);
    return worst;
}

/* A surface that is sunk by s (3 h^2 / 8, see above) moves along a ray by s over the cosine, 0.43 at 0.9 of the radius,
   at either end. And corners are rounded to 1/512 of a pixel: at a slope of 2 and with pixels 0.1 wide, that moves the
   ends by another 0.1 * 2 / 512 each. The error is quartered as the cells are halved, except for the orientation of
   facets and for rounding: more than halved. */
static void test_ball_chords(void) {
    const double coarse = 2.4 / 16, fine = 2.4 / 32, rounding = 8e-4;
    const double eyes[3] = {5, 1.3, 0.4}, angles[3] = {0.5, 1.2, 1.5}; /* the last one is inside */
    for (int i = 0; i < 3; ++i) {
        const sps_view view = view_of(eyes[i], angles[i]);
        const double a = ball_error(&view, 16, NULL), b = ball_error(&view, 32, NULL);
        CHECK_NEAR(a, 0, 2 * 0.375 * coarse * coarse / 0.43 + rounding);
        CHECK_NEAR(b, 0, 2 * 0.375 * fine * fine / 0.43 + rounding);
        if (!CHECK(a > 2 * b)) printf("    eye at %g: %g, then %g\n", eyes[i], a, b);
    }
}

/* Rays that end before the ball, in it and behind it. The same tolerance. */
static void test_ends_of_rays(void) {
    static float depth[PIXELS];
    const sps_view view = view_of(5, 0.5);
    for (int i = 0; i < PIXELS; ++i) depth[i] = i % 4 == 0 ? HUGE_VALF : 3.5f + 0.9f * (float)(i % 4);
    CHECK_NEAR(ball_error(&view, 32, depth), 0, 2 * 0.375 * (2.4 / 32) * (2.4 / 32) / 0.43 + 8e-4);
    for (int i = 0; i < PIXELS; ++i) depth[i] = 1.5f;
    static double sums[PIXELS];
    ex_mesh mesh;
    int nothing = 1;
    memset(&mesh, 0, sizeof mesh);
    add_ball(&mesh, 0, 0, 0, 1, 12);
    ex_mesh_thickness(&mesh, &view, depth, sums);
    for (int i = 0; i < PIXELS; ++i) nothing &= sums[i] == 0;
    CHECK(nothing); /* the same numbers are added and subtracted */
    ex_mesh_free(&mesh);
}

/* Orthographic rays through a ring in the plane across them: two tubes along a ray in its plane, none in its hole. From
   the side, where one tube lies behind the other, chords add up: 2 x the tube's diameter through the middle. */
static void test_ring_chords(void) {
    static double sums[PIXELS];
    const double minor = 0.3, h = 2.4 / 40, sunk = 3 * h * h / (8 * minor);
    double radii[2] = {0.8, 0.3};
    sps_view view = view_of(5, 0);
    ex_mesh mesh;
    memset(&mesh, 0, sizeof mesh);
    ex_shape_field(&mesh, ring_field, radii, 0, ex_vec_of(-1.2, -1.2, -0.5), ex_vec_of(1.2, 1.2, 0.5), 40, white);
    memset(sums, 0, sizeof sums);
    ex_mesh_thickness(&mesh, &view, NULL, sums);
    CHECK_NEAR(sums[PIXELS / 2], 0, 0); /* nothing through the hole */
    /* 11 pixels of 2.4 / 33 to the side is 0.8: through the tube's middle, at a right angle to it */
    CHECK_NEAR(sums[PIXELS / 2 + 11], 2 * minor, 2 * sunk + 1e-3);
    view.camera.position[0] = 5, view.camera.position[2] = 0;
    memset(sums, 0, sizeof sums);
    ex_mesh_thickness(&mesh, &view, NULL, sums);
    CHECK_NEAR(sums[PIXELS / 2], 4 * minor, 4 * sunk + 1e-3);
    view.camera.position[0] = 0; /* from the middle of the hole, and along the axis x from within: one tube ahead */
    view.camera.target[0] = 1;
    memset(sums, 0, sizeof sums);
    ex_mesh_thickness(&mesh, &view, NULL, sums);
    CHECK_NEAR(sums[PIXELS / 2], 2 * minor, 2 * sunk + 1e-3);
    ex_mesh_free(&mesh);
}

/* Two overlapping balls in one mesh: each layer counts, so their thicknesses add up. Round-off of sums of eight numbers
   below 10: 1e-14. Orthographic rays run along the lattice's edges, through the corners of triangles that lie on these
   and along others' edges: none may be missed or counted twice, which would leave a whole distance (3 or more) as
   error. */
static void test_overlap(void) {
    static double both[PIXELS], apart[PIXELS];
    const double centers[2] = {-0.4, 0.4};
    ex_mesh mesh;
    double most = 0, least = 0, worst = 0;
    for (int angle = 0; angle < 2; ++angle) {
        sps_view view = view_of(4, angle ? 0.8 : 0);
        if (!angle)
            check_orthographic(&view.camera,
                               0.05 * SIDE); /* pixels as wide as the cells, their centres on the lattice */
        memset(&mesh, 0, sizeof mesh);
        memset(both, 0, sizeof both);
        memset(apart, 0, sizeof apart);
        for (int i = 0; i < 2; ++i) {
            ex_mesh one;
            memset(&one, 0, sizeof one);
            add_ball(&one, centers[i], 0, 0, 0.5, 24);
            add_ball(&mesh, centers[i], 0, 0, 0.5, 24);
            ex_mesh_thickness(&one, &view, NULL, apart);
            ex_mesh_free(&one);
        }
        ex_mesh_thickness(&mesh, &view, NULL, both);
        for (int i = 0; i < PIXELS; ++i) {
            most = fmax(most, both[i]), least = fmin(least, both[i]);
            worst = fmax(worst, fabs(both[i] - apart[i]));
        }
        ex_mesh_free(&mesh);
    }
    CHECK_NEAR(worst, 0, 1e-14);
    CHECK(least > -1e-14 && most > 0.9 && most < 2);
}

/* The library's rays are the same: with its distances to a mesh as the rays' ends, nothing of the mesh is left. Seen
   from the side, with a view higher than wide. Distances are floats (3e-7 of 4), and rounding of corners moves a
   facet's border by 1/512 pixel, 2e-5 here, times its slope, up to 3 within 0.95 of the radius. */
static void test_library_rays(void) {
    enum { WIDE = 40, HIGH = 56 };
    static float rgba[4 * WIDE * HIGH], depth[WIDE * HIGH];
    static double sums[WIDE * HIGH];
    check_scene s;
    ex_mesh mesh;
    double worst = 0;
    int hit = 0;
    sps_context *context = check_context(NULL);
    memset(&mesh, 0, sizeof mesh);
    add_ball(&mesh, 0.2, 0.1, -0.3, 0.5, 20);
    check_clear(&s, WIDE, HIGH);
    s.mesh[0] = ex_shape_mesh(&mesh);
    s.scene.mesh_count = 1;
    check_set3(s.view.camera.position, 2, 1.5, 2.5);
    check_set3(s.view.camera.target, 0.1, 0.2, 0);
    check_set3(s.view.camera.up, 0.1, 1, 0);
    check_perspective(&s.view.camera, 0.3);
    check_render_depth(context, &s, rgba, depth);
    ex_mesh_thickness(&mesh, &s.view, depth, sums);
    for (int i = 0; i < WIDE * HIGH; ++i)
        if (depth[i] < HUGE_VALF) ++hit, worst = fmax(worst, fabs(sums[i]));
    CHECK(hit > 500);
    CHECK_NEAR(worst, 0, 1e-4);
    ex_mesh_free(&mesh);
    sps_destroy(context);
}

/* ------------------------------------------------------------------------------------------------------------ puffs */

enum { SOME = 400 };

static ex_puff puff_of(uint32_t seed) {
    ex_puff puff;
    puff.center = ex_vec_of(1, 2, 3), puff.radius = 2;
    puff.smallest = 0.05, puff.largest = 0.3, puff.optical_depth = 0.25;
    puff.seed = seed;
    return puff;
}

static ex_vec place_of(const sps_particle *p) {
    return ex_vec_of((double)p->position[0], (double)p->position[1], (double)p->position[2]);
}

/* The same seed makes the same bits, another one another puff; memory behind the last particle is untouched; no
   particle extends out of the puff, except for rounding to floats (3e-7 of 5), and sizes spread over their range. */
static void test_puff(void) {
    static sps_particle list[EX_PUFF_PARTICLES + 1], again[EX_PUFF_PARTICLES + 1];
    const ex_puff other = puff_of(2);
    ex_puff puff = puff_of(1);
    double furthest = 0, smallest = 1e9, largest = 0, depth = 0;
    memset(list, 0x5a, sizeof list);
    memset(again, 0x5a, sizeof again);
    const sps_particle untouched = list[EX_PUFF_PARTICLES];
    ex_puff_fill(&puff, EX_PUFF_PARTICLES, list);
    ex_puff_fill(&puff, EX_PUFF_PARTICLES, again);
    CHECK(memcmp(list, again, sizeof list) == 0);
    CHECK(memcmp(&list[EX_PUFF_PARTICLES], &untouched, sizeof untouched) == 0);
    for (int i = 0; i < EX_PUFF_PARTICLES; ++i) {
        const double radius = (double)list[i].radius;
        furthest = fmax(furthest, ex_vec_length(ex_vec_sub(place_of(&list[i]), puff.center)) + radius);
        smallest = fmin(smallest, radius), largest = fmax(largest, radius);
        depth += (double)list[i].optical_depth;
    }
    CHECK(furthest <= puff.radius * (1 + 1e-6) && furthest > 0.8 * puff.radius);
    CHECK(smallest >= 0.0499999 && smallest < 0.07 && largest <= 0.3000001 && largest > 0.25);
    CHECK_NEAR(depth, 0.25 * EX_PUFF_PARTICLES, 0); /* a quarter is exact */
    ex_puff_fill(&other, EX_PUFF_PARTICLES, again);
    CHECK(memcmp(list, again, sizeof list) != 0);
    puff.smallest = 0.9,
    puff.largest = 1.1; /* all of them large, so that those at the edge would extend beyond it if they could */
    ex_puff_fill(&puff, EX_PUFF_PARTICLES, list);
    for (int i = 0; i < EX_PUFF_PARTICLES; ++i)
        furthest = fmax(furthest, ex_vec_length(ex_vec_sub(place_of(&list[i]), puff.center)) + (double)list[i].radius);
    CHECK(furthest <= puff.radius * (1 + 1e-6));
}

/* Another seed makes another shape, not the same one filled differently: chance alone moves the centre of mass of 2500
   particles, each 0.45 of the radius from the centre per axis (rms), by 0.009 of it; the distance of two such centres
   is 0.022 (all three axes), and beyond 0.11, five times that, it is not chance. */
static void test_shapes_of_puffs(void) {
    static sps_particle list[EX_PUFF_PARTICLES];
    ex_vec middles[4];
    double apart = 0;
    for (int i = 0; i < 4; ++i) {
        const ex_puff puff = puff_of((uint32_t)(i + 1));
        middles[i] = ex_vec_of(0, 0, 0);
        ex_puff_fill(&puff, EX_PUFF_PARTICLES, list);
        for (int k = 0; k < EX_PUFF_PARTICLES; ++k)
            middles[i] = ex_vec_add(middles[i], ex_vec_scale(place_of(&list[k]), 1.0 / EX_PUFF_PARTICLES));
        for (int k = 0; k < i; ++k)
            apart = fmax(apart, ex_vec_length(ex_vec_sub(middles[i], middles[k])) / puff.radius);
    }
    CHECK(apart > 0.11);
}

static ex_wind wind_of(double gusts) {
    ex_wind wind;
    wind.velocity = ex_vec_of(3, 0, 1), wind.ground = 0, wind.height = 2, wind.exponent = 0.5;
    wind.eddy_size = 1.5, wind.gusts = gusts, wind.seed = 7;
    return wind;
}

/* Without gusts every particle moves straight at the speed of its height for 2 seconds: closed form, rounded to floats
   of up to 15, 1e-6. With gusts the particles end elsewhere, no two in one place, but sizes and depths stay. */
static void test_blown_puff(void) {
    static sps_particle still[SOME], blown[SOME];
    const ex_puff puff = puff_of(3);
    const ex_wind calm = wind_of(0), gusty = wind_of(0.4);
    double worst = 0, moved = 0;
    int kept = 1;
    ex_puff_fill(&puff, SOME, still);
    memcpy(blown, still, sizeof blown);
    ex_puff_blow(&calm, 2, 4, SOME, blown);
    for (int i = 0; i < SOME; ++i) {
        const ex_vec from = place_of(&still[i]);
        const ex_vec exact = ex_vec_add(from, ex_vec_scale(calm.velocity, 2 * sqrt(fmax(from.y, 0) / 2)));
        worst = fmax(worst, ex_vec_length(ex_vec_sub(place_of(&blown[i]), exact)));
    }
    CHECK_NEAR(worst, 0, 2e-6);
    ex_puff_blow(&gusty, 1, 4, SOME, blown);
    for (int i = 0; i < SOME; ++i) {
        kept &= blown[i].radius == still[i].radius && blown[i].optical_depth == still[i].optical_depth;
        for (int c = 0; c < 3; ++c) kept &= fabs((double)blown[i].position[c]) < 30;
        moved = fmax(moved, fabs((double)blown[i].position[1] - (double)still[i].position[1]));
    }
    CHECK(kept);
    CHECK(moved > 0.1); /* up or down, which only eddies do */
}

/* The swirl has no divergence: central differences of central differences with the same step cancel exactly, except for
   round-off: 1e-16 of noises below 2, over 4 * step^2 = 4e-6, in twelve differences: at most 6e-10. */
static void test_swirl(void) {
    const double step = 1e-3;
    uint32_t random = 5;
    double worst = 0, fastest = 0;
    for (int i = 0; i < 200; ++i) {
        const ex_vec p = ex_vec_scale(ex_random_in_ball(&random), 20);
        double divergence = 0;
        for (int k = 0; k < 3; ++k) {
            const ex_vec side = ex_vec_of(step * (k == 0), step * (k == 1), step * (k == 2));
            const ex_vec after = ex_swirl(ex_vec_add(p, side)), before = ex_swirl(ex_vec_sub(p, side));
            const double change[3] = {after.x - before.x, after.y - before.y, after.z - before.z};
            divergence += change[k] / (2 * step);
        }
        worst = fmax(worst, fabs(divergence));
        fastest = fmax(fastest, ex_vec_length(ex_swirl(p)));
    }
    CHECK_NEAR(worst, 0, 1e-8);
    CHECK(fastest > 1 && fastest < 10);
}

/* ------------------------------------------------------------------------------------------------------- OBJ files */

/* Reads lines into a builder. Returns what is wrong with the first that is wrong, or NULL. */
static const char *obj_lines(ex_builder *builder, const char *const *lines, int count) {
    static ex_face face;
    for (int i = 0; i < count; ++i) {
        char line[64];
        const char *wrong;
        snprintf(line, sizeof line, "%s", lines[i]);
        wrong = ex_obj_line(line, builder, &face);
        if (wrong) return wrong;
    }
    return NULL;
}

/* Texture coordinates of one, two or three numbers, by indices from either end; corners without have 0. */
static void test_obj_uvs(void) {
    static const char *const square[] = {"v 0 0 0", "v 1 0 0",  "v 1 1 0",   "v 0 1 0",           "vt 0.25 0.5",
                                         "vt 3",    "vt 4 5 6", "vn 0 0 1 ", "f 1/1 2/2 3/-1/1 4"};
    static const float wanted[2][3][2] = {{{0.25f, 0.5f}, {3, 0}, {4, 5}}, {{0.25f, 0.5f}, {4, 5}, {0, 0}}};
    static const char *const wrong[] = {"f 1/4 2/1 3/1", "f 1/0 2/1 3/1", "f 1/x 2/1 3/1", "vt x 1", "vt 1 1e16"};
    ex_builder builder;
    ex_mesh mesh;
    memset(&builder, 0, sizeof builder);
    CHECK(obj_lines(&builder, square, 9) == NULL);
    for (int i = 0; i < 5; ++i)
        if (!CHECK(obj_lines(&builder, &wrong[i], 1) != NULL)) printf("    %s\n", wrong[i]);
    builder.corner_count = 6;
    ex_mesh_build(&mesh, &builder, 60);
    CHECK(mesh.triangle_count == 2);
    for (int i = 0; i < 12; ++i) CHECK(mesh.triangles[i / 6].uv[i / 2 % 3][i % 2] == wanted[i / 6][i / 2 % 3][i % 2]);
    ex_mesh_free(&mesh);
}

/* Shapes have texture coordinates: those of a surface are its parameters, those of a quadrilateral run from 0 to 1. */
static void test_shapes_uvs(void) {
    static const double profile[] = {1, 0, 1, 2};
    const ex_lathe lathe = {profile, 2, {0, 0, 0}, {0, 1, 0}};
    ex_mesh mesh;
    memset(&mesh, 0, sizeof mesh);
    ex_shape_lathe(&mesh, &lathe, 8, white, NULL);
    ex_shape_quad(&mesh, ex_vec_of(0, 0, 0), ex_vec_of(1, 0, 0), ex_vec_of(1, 1, 0), ex_vec_of(0, 1, 0), white);
    for (size_t i = 0; i < 3 * mesh.triangle_count; ++i) {
        const sps_triangle *t = &mesh.triangles[i / 3];
        const float *uv = t->uv[i % 3], *p = t->position[i % 3];
        if (i / 3 < mesh.triangle_count - 2)
            CHECK_NEAR((double)uv[0], 0.5 * (double)p[1], 1e-6);
        else
            CHECK(uv[0] == p[0] && uv[1] == p[1]);
    }
    CHECK(mesh.triangle_count == 18);
    ex_mesh_free(&mesh);
}

int main(void) {
    RUN(test_metaballs);
    RUN(test_cells);
    RUN(test_ball_and_ring);
    RUN(test_normals);
    RUN(test_random_fields);
    RUN(test_ball_chords);
    RUN(test_ends_of_rays);
    RUN(test_ring_chords);
    RUN(test_overlap);
    RUN(test_library_rays);
    RUN(test_puff);
    RUN(test_shapes_of_puffs);
    RUN(test_blown_puff);
    RUN(test_swirl);
    RUN(test_obj_uvs);
    RUN(test_shapes_uvs);
    return check_report();
}
