/* Polygons of OBJ files, which examples/mesh.h cuts into triangles. For any outline that does not intersect itself, the
   triangles cover the inside once: their signed areas add up to that of the outline whatever they are, so it is enough
   that none is negative. */

#include "check.h"
#include "mesh.h"
#include "command_line.h"

enum { CORNERS = EX_FACE_CORNERS };

/* An outline in a plane. */
typedef struct outline {
    double points[CORNERS][2];
    int count;
} outline;

/* How an outline lies in space: its origin, and where its two axes point. */
typedef struct placing {
    double origin[3], axes[2][3];
} placing;

static const placing flat = {{0, 0, 0}, {{1, 0, 0}, {0, 1, 0}}};

static ex_face face;

static double outline_area(const outline *shape) {
    double sum = 0;
    for (int i = 0; i < shape->count; ++i) {
        const double *p = shape->points[i], *q = shape->points[(i + 1) % shape->count];
        sum += 0.5 * (p[0] * q[1] - p[1] * q[0]);
    }
    return sum;
}

static void add_point(outline *shape, double x, double y) {
    shape->points[shape->count][0] = x, shape->points[shape->count++][1] = y;
}

/* Adds the placed outline to a new builder. */
static void cut(const outline *shape, const placing *place, ex_builder *builder) {
    memset(builder, 0, sizeof *builder);
    face.count = shape->count;
    for (int i = 0; i < shape->count; ++i) {
        double p[3];
        const ex_corner corner = {(size_t)i, EX_NOT_GIVEN, EX_NOT_GIVEN};
        for (int a = 0; a < 3; ++a)
            p[a] = place->origin[a] + shape->points[i][0] * place->axes[0][a] + shape->points[i][1] * place->axes[1][a];
        ex_add_position(builder, p[0], p[1], p[2]);
        face.corners[i] = corner;
    }
    ex_face_add(&face, builder);
}

/* The area of a triangle of the builder, along the normal of the placed outline. */
static double triangle_area(const ex_builder *builder, const double normal[3], size_t triangle) {
    double area[3];
    ex_area_vector(builder, triangle, area);
    return 0.5 * vec_dot(area, normal);
}

typedef struct sums {
    double area, sizes; /* the sum of signed areas, and of their absolute values */
    size_t count;
} sums;

static sums cut_sums(const outline *shape, const placing *place) {
    sums all = {0, 0, 0};
    ex_builder builder;
    double normal[3];
    vec_cross(place->axes[0], place->axes[1], normal);
    vec_normalise(normal);
    cut(shape, place, &builder);
    all.count = builder.corner_count / 3;
    for (size_t t = 0; t < all.count; ++t) {
        const double area = triangle_area(&builder, normal, t);
        all.area += area, all.sizes += fabs(area);
    }
    ex_builder_free(&builder);
    return all;
}

/* An outline whose coordinates are small multiples of 1/4 or whole numbers, so that all areas are exact. */
static void check_exact(const outline *shape, const char *name) {
    const sums all = cut_sums(shape, &flat);
    const double area = outline_area(shape);
    if (!CHECK(all.count == (size_t)shape->count - 2) || !CHECK(all.area == area && all.sizes == fabs(area)))
        printf("    %s of %d corners: %zu triangles, area %g, sizes %g, exact %g\n", name, shape->count, all.count,
               all.area, all.sizes, area);
}

/* Starts an outline at another corner, or runs it the other way round. */
static outline turned(const outline *shape, int first, int backwards) {
    outline out = {{{0}}, 0};
    for (int i = 0; i < shape->count; ++i) {
        const double *p = shape->points[(first + (backwards ? shape->count - i : i)) % shape->count];
        add_point(&out, p[0], p[1]);
    }
    return out;
}

/* ------------------------------------------------------------------------------------------------------------ shapes
 */

static outline made_l(void) {
    const outline l = {{{0, 0}, {3, 0}, {3, 1}, {1, 1}, {1, 2}, {0, 2}}, 6};
    return l;
}

/* Points on two circles in turn, rounded to 1/256. */
static outline made_star(int points, double inner) {
    outline star = {{{0}}, 0};
    for (int i = 0; i < 2 * points; ++i) {
        const double angle = PI * i / points, radius = i % 2 ? inner : 1;
        add_point(&star, floor(256 * radius * cos(angle)) / 256, floor(256 * radius * sin(angle)) / 256);
    }
    return star;
}

/* A band of width 1/2 along a path that turns left around every 2, 2, 4, 4, 6, 6 .. units: its right edge forwards,
   then its left edge backwards. */
static outline made_spiral(int sides) {
    static const int ways[4][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}};
    static double path[CORNERS][2];
    outline spiral = {{{0}}, 0};
    for (int i = 0; i < sides; ++i)
        for (int a = 0; a < 2; ++a) path[i + 1][a] = path[i][a] + ways[i % 4][a] * 2 * (i / 2 + 1);
    for (int k = 0; k < 2 * sides + 2; ++k) {
        const int i = k <= sides ? k : 2 * sides + 1 - k;
        const int *left[2] = {ways[(i + 4) % 4], ways[(i + 1) % 4]}; /* sides before and after */
        const double side = k <= sides ? -0.25 : 0.25;
        double p[2];
        for (int a = 0; a < 2; ++a)
            p[a] = path[i][a] + side * ((i > 0 ? left[0][a] : 0) + (i < sides ? left[1][a] : 0));
        add_point(&spiral, p[0], p[1]);
    }
    return spiral;
}

/* Teeth of width 1 and of different lengths on a bar of height 1. */
static outline made_comb(int teeth) {
    outline comb = {{{0}}, 0};
    add_point(&comb, 0, 0);
    add_point(&comb, 2 * teeth - 1, 0);
    for (int i = teeth - 1; i >= 0; --i) {
        if (i < teeth - 1) add_point(&comb, 2 * i + 1, 1);
        add_point(&comb, 2 * i + 1, 3 + i * 7 % 5);
        add_point(&comb, 2 * i, 3 + i * 7 % 5);
        if (i > 0) add_point(&comb, 2 * i, 1);
    }
    return comb;
}

/* Areas are known: the L 4, a comb of n teeth 2 n - 1 + sum of (2 + 7 i mod 5), a spiral half of its path's length. */
static void test_shapes(void) {
    outline shapes[5];
    shapes[0] = made_l(), shapes[1] = made_star(5, 0.4), shapes[2] = made_star(30, 0.1);
    shapes[3] = made_spiral(24), shapes[4] = made_comb(50);
    CHECK(outline_area(&shapes[0]) == 4 && shapes[4].count == 200 && shapes[3].count == 50);
    CHECK(outline_area(&shapes[4]) == 99 + 10 * (2 + 3 + 4 + 5 + 6));
    CHECK(outline_area(&shapes[3]) == 0.5 * 2 * 2 * (12 * 13 / 2));
    for (int i = 0; i < 5; ++i)
        for (int first = 0; first < shapes[i].count; first += check_memory_only() ? 5 : 1) {
            const outline one = turned(&shapes[i], first, first % 2);
            check_exact(&one, "shape");
        }
    const outline long_comb = made_comb(1024), long_spiral = made_spiral(2047);
    CHECK(long_comb.count == 4096 && long_spiral.count == 4096);
    check_exact(&long_comb, "comb");
    check_exact(&long_spiral, "spiral");
}

/* Along each axis, both ways round, oblique, and far away. A float's place is rounded by up to 2^-24 of it, which moves
   an edge by that much: the area changes by at most the outline's length times that. */
static void test_planes(void) {
    static const placing places[] = {{{0, 0, 0}, {{0, 1, 0}, {1, 0, 0}}},
                                     {{0, 0, 0}, {{0, 1, 0}, {0, 0, 1}}},
                                     {{0, 0, 0}, {{0, 0, 1}, {0, 1, 0}}},
                                     {{0, 0, 0}, {{0, 0, 1}, {1, 0, 0}}},
                                     {{0, 0, 0}, {{1, 0, 0}, {0, 0, 1}}},
                                     {{9, -7, 3}, {{0.6, 0.48, 0.64}, {-0.8, 0.36, 0.48}}},
                                     {{0, 0, 0}, {{0.6, -0.48, -0.64}, {0.8, 0.36, 0.48}}},
                                     {{9000, -7000, 3000}, {{0.36, 0.48, -0.8}, {-0.8, 0.6, 0}}}};
    const outline shapes[3] = {made_l(), made_star(7, 0.3), made_spiral(8)};
    for (size_t k = 0; k < sizeof places / sizeof *places; ++k)
        for (int i = 0; i < 3; ++i) {
            const sums all = cut_sums(&shapes[i], &places[k]);
            const double area = outline_area(&shapes[i]), step = places[k].origin[0] > 100 ? 9000 : 40;
            CHECK(all.count == (size_t)shapes[i].count - 2);
            CHECK_NEAR(all.area, area, step * pow(2, -24) * 90);
            CHECK_NEAR(all.sizes, area, step * pow(2, -24) * 90);
        }
}

/* ------------------------------------------------------------------------------------------------------ random
 * outlines */

static int side_of(const double a[2], const double b[2], const double c[2]) {
    const double area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
    return area > 0 ? 1 : area < 0 ? -1 : 0;
}

/* 1: edges i and k cross; 2: one touches the other. */
static int edges_meet(const outline *shape, int i, int k) {
    const double *a = shape->points[i], *b = shape->points[(i + 1) % shape->count];
    const double *c = shape->points[k], *d = shape->points[(k + 1) % shape->count];
    const int sides[4] = {side_of(a, b, c), side_of(a, b, d), side_of(c, d, a), side_of(c, d, b)};
    if (sides[0] * sides[1] < 0 && sides[2] * sides[3] < 0) return 1;
    return sides[0] * sides[1] <= 0 && sides[2] * sides[3] <= 0 ? 2 : 0;
}

/* Turns the part between two crossing edges around, which shortens the outline, until none cross. Returns whether none
   touch either. */
static int untangle(outline *shape) {
    int touches = 0;
    for (int again = 1; again;) {
        again = touches = 0;
        for (int i = 0; i < shape->count; ++i)
            for (int k = i + 2; k < shape->count - (i == 0); ++k) {
                const int meet = edges_meet(shape, i, k);
                touches += meet == 2;
                if (meet != 1) continue;
                again = 1;
                for (int a = i + 1, b = k; a < b; ++a, --b)
                    for (int c = 0; c < 2; ++c) {
                        const double kept = shape->points[a][c];
                        shape->points[a][c] = shape->points[b][c], shape->points[b][c] = kept;
                    }
            }
    }
    return touches == 0;
}

static unsigned next_random(unsigned *state) {
    *state = *state * 1664525u + 1013904223u;
    return *state >> 16;
}

static outline made_random(int count, unsigned range, unsigned *state) {
    outline out = {{{0}}, 0};
    for (int i = 0; i < count; ++i) {
        const unsigned x = next_random(state) % range;
        add_point(&out, x, next_random(state) % range);
    }
    return out;
}

/* Outlines through random points, and around a middle. */
static void test_random(void) {
    unsigned state = 5;
    int simple = 0;
    const int tries = check_long() ? 20000 : check_memory_only() ? 300 : 1500;
    for (int i = 0; i < tries; ++i) {
        outline shape = made_random(4 + i % 37, 1024, &state);
        if (!untangle(&shape)) continue;
        ++simple;
        check_exact(&shape, "random");
    }
    CHECK(simple > tries / 20);
    for (int i = 0; i < 300; i += check_memory_only() ? 5 : 1) {
        outline shape = {{{0}}, 0};
        const int count = 5 + i;
        for (int k = 0; k < count; ++k) {
            const double angle = 2 * PI * k / count, radius = 300 + next_random(&state) % 60000;
            add_point(&shape, floor(radius * cos(angle)), floor(radius * sin(angle)));
        }
        check_exact(&shape, "around a middle");
    }
}

/* --------------------------------------------------------------------------------------------- what touches itself */

/* Corners on straight lines, and corners that stand twice: areas stay, and triangles without any complete the number.
 */
static void test_degenerate(void) {
    const outline middles = {{{0, 0}, {1, 0}, {2, 0}, {2, 1}, {2, 2}, {1, 2}, {0, 2}, {0, 1}}, 8};
    const outline twice = {{{0, 0}, {0, 0}, {2, 0}, {2, 0}, {2, 0}, {1, 1}, {1, 1}, {0, 2}, {0, 2}}, 9};
    const outline spike = {{{0, 0}, {2, 0}, {5, 0}, {2, 0}, {2, 2}, {0, 2}}, 6};
    const outline line = {{{0, 0}, {1, 1}, {2, 2}, {3, 3}, {1, 1}}, 5};
    outline steps = {{{0}}, 0};
    static const outline point = {{{7, 7}}, CORNERS}; /* 4096 corners, all but the first at 0,0 */
    for (int i = 0; i < 40; ++i) add_point(&steps, i, 0);
    for (int i = 0; i < 20; ++i) add_point(&steps, 40 - 2 * i, 1 + i / 4), add_point(&steps, 39 - 2 * i, 1 + i / 4);
    const outline *const all[] = {&middles, &twice, &spike, &line, &steps, &point};
    for (int i = 0; i < 6; ++i)
        for (int first = 0; first < (i < 5 ? all[i]->count : 1); ++first) {
            const outline one = turned(all[i], first, first % 2);
            check_exact(&one, "degenerate");
        }
}

/* A square with holes along its diagonal, which a cut joins that runs forth and back. */
static outline made_holes(int count) {
    const int size = 4 * count + 1;
    outline out = {{{0, 0}, {0}}, 1};
    out.points[1][0] = out.points[2][0] = out.points[2][1] = out.points[3][1] = size;
    out.count = 5;
    for (int i = 0; i < count; ++i) {
        add_point(&out, 4 * i + 1, 4 * i + 1);
        add_point(&out, 4 * i + 1, 4 * i + 3);
        add_point(&out, 4 * i + 3, 4 * i + 3);
    }
    for (int i = count - 1; i >= 0; --i) {
        if (i < count - 1) add_point(&out, 4 * i + 3, 4 * i + 3);
        add_point(&out, 4 * i + 3, 4 * i + 1);
        add_point(&out, 4 * i + 1, 4 * i + 1);
    }
    return out;
}

static void check_every_start(const outline *shape, const char *name) {
    for (int first = 0; first < shape->count; first += check_memory_only() ? 3 : 1) {
        const outline one = turned(shape, first, 0), other = turned(shape, first, 1);
        check_exact(&one, name);
        check_exact(&other, name);
    }
}

/* Holes that touch the outline in a corner, from inside and along a side; parts that share a corner; outlines that pass
   a corner again from within. */
static void test_touching(void) {
    const outline corner = {{{0, 0}, {9, 0}, {9, 9}, {0, 9}, {0, 0}, {2, 5}, {5, 5}, {5, 2}}, 8};
    const outline side = {{{0, 0}, {4, 0}, {3, 3}, {5, 3}, {4, 0}, {9, 0}, {9, 9}, {0, 9}}, 8};
    const outline notch = {{{0, 0}, {9, 0}, {9, 9}, {5, 9}, {5, 0}, {4, 9}, {0, 9}}, 7};
    const outline squares = {{{0, 0}, {3, 0}, {3, 3}, {6, 3}, {6, 6}, {3, 6}, {3, 3}, {0, 3}}, 8};
    const outline within = {{{0, 0}, {9, 0}, {9, 3}, {0, 0}, {3, 9}, {0, 9}}, 6};
    const outline again = {{{1, 0}, {7, 3}, {1, 3}, {1, 0}, {2, 2}, {6, 3}}, 6};
    const outline *const all[] = {&corner, &side, &notch, &squares, &within};
    for (int i = 0; i < 5; ++i) check_every_start(all[i], "touching");
    check_exact(&again, "touching");
    for (int count = 1; count < 30; count += 14) {
        const outline holes = made_holes(count);
        CHECK(fabs(outline_area(&holes)) == pow(4 * count + 1, 2) - 4 * count);
        check_every_start(&holes, "holes");
    }
}

/* Signed areas still add up to the outline's, and there are n - 2 triangles, the same each time. */
static void test_crossing(void) {
    const outline bow = {{{0, 0}, {2, 2}, {2, 0}, {0, 2}}, 4};
    const outline eight = {{{0, 0}, {4, 4}, {6, 2}, {4, 0}, {0, 4}, {-2, 2}}, 6};
    unsigned state = 3;
    CHECK(cut_sums(&bow, &flat).count == 2 && cut_sums(&bow, &flat).area == 0);
    CHECK(cut_sums(&eight, &flat).count == 4 && cut_sums(&eight, &flat).area == outline_area(&eight));
    for (int i = 0; i < 200; i += check_memory_only() ? 5 : 1) {
        const outline shape = made_random(i < 190 ? 4 + i : CORNERS, i % 3 ? 2000 : 5, &state);
        const sums one = cut_sums(&shape, &flat), other = cut_sums(&shape, &flat);
        CHECK(one.count == (size_t)shape.count - 2 && one.area == outline_area(&shape));
        CHECK(one.sizes == other.sizes && one.sizes >= fabs(one.area));
    }
}

/* -------------------------------------------------------------------------------------------------------------- files
 */

/* A convex polygon is a fan around its first corner, in order. */
static void test_convex(void) {
    ex_builder builder;
    for (int count = 3; count < 40; ++count) {
        outline round = {{{0}}, 0};
        for (int i = 0; i < count; ++i) add_point(&round, cos(2 * PI * i / count), sin(2 * PI * i / count));
        cut(&round, &flat, &builder);
        CHECK(builder.corner_count == 3 * (size_t)(count - 2));
        for (size_t i = 0; i < builder.corner_count; ++i)
            CHECK(builder.corners[i].position == (i % 3 ? i / 3 + i % 3 : 0));
        ex_builder_free(&builder);
    }
}

static int load(ex_mesh *mesh, const char *text, ex_error *error) {
    char path[200];
    snprintf(path, sizeof path, "%s/a.obj", folder);
    write_file("a.obj", text, strlen(text));
    return ex_mesh_load(mesh, path, 60, error);
}

/* A face keeps what stands at each of its corners, and so does the one after it. */
static void test_corners_kept(void) {
    static const char text[] =
        "v 0 0 0\nv 3 0 0\nv 3 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\nvt 0 0.5\nvt 3 0.5\nvt 3 1.5\nvt 1 1.5\nvt 1 2.5\n"
        "vt 0 2.5\nvn 0 0 1\nvn 3 0 1\nvn 3 1 1\nvn 1 1 1\nvn 1 2 1\nvn 0 2 1\n"
        "f 4/4/4 5/5/5 6/6/6 1/1/1 2/2/2 3/3/3\nf 1/1/1 2/2/2 3/3/3\n";
    ex_mesh mesh;
    ex_error error;
    double area = 0;
    if (!CHECK(load(&mesh, text, &error) == 0)) return;
    CHECK(mesh.triangle_count == 5);
    for (size_t i = 0; i < 15; ++i) {
        const sps_triangle *t = &mesh.triangles[i / 3];
        const float *p = t->position[i % 3], *n = t->normal[i % 3], *uv = t->uv[i % 3];
        CHECK(uv[0] == p[0] && uv[1] == p[1] + 0.5f && n[0] == p[0] && n[1] == p[1] && n[2] == 1);
    }
    for (int i = 0; i < 4; ++i) {
        const float(*p)[3] = (const float(*)[3])mesh.triangles[i].position;
        area += 0.5 * (double)((p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[2][0] - p[0][0]) * (p[1][1] - p[0][1]));
    }
    CHECK(area == 4);
    ex_mesh_free(&mesh);
}

/* 4096 corners are a face; one more is refused. */
static void test_too_many(void) {
    static char text[60000];
    for (int count = 4096; count <= 4097; ++count) {
        ex_mesh mesh;
        ex_error error;
        size_t at = (size_t)snprintf(text, sizeof text, "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf");
        for (int i = 0; i < count; ++i)
            at += (size_t)snprintf(text + at, sizeof text - at, " %d//1", 1 + i * 3 / count);
        error.text[0] = 0;
        CHECK(load(&mesh, text, &error) == (count > 4096));
        if (count > 4096)
            CHECK(strstr(error.text, "a.obj:5: a face of more than 4096 corners: ") != NULL);
        else
            CHECK(mesh.triangle_count == 4094);
        ex_mesh_free(&mesh);
    }
}

int main(void) {
    RUN(test_shapes);
    RUN(test_planes);
    RUN(test_random);
    RUN(test_degenerate);
    RUN(test_touching);
    RUN(test_crossing);
    RUN(test_convex);
    if (!CHECK(folder_begin())) return check_report();
    RUN(test_corners_kept);
    RUN(test_too_many);
    folder_end();
    return check_report();
}
