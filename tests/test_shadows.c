/* Shadows of polygons, on polygons and in gas, at every scale: rays through the tree of triangles against plain loops
   over all of them; grounds up to a million times as wide as the objects on them; meshes far from the origin; and what
   is kept by a revision. */

#include "check.h"

enum { SIDE = 48, GAS_SIDE = 28 };
static float image_a[4 * SIDE * SIDE], image_b[4 * SIDE * SIDE];
static sps_context *context;
static check_triangles ground, body;

static void start(check_scene *s) {
    check_clear(s, SIDE, SIDE);
    ground.count = body.count = 0;
}

/* The square |x|, |z| <= half at y = 0. */
static void add_ground(double half) {
    const double origin[3] = {-half, 0, -half}, u[3] = {2 * half, 0, 0}, v[3] = {0, 0, 2 * half};
    check_add_quad(&ground, origin, u, v);
}

static void add_box(check_triangles *triangles, const double low[3], const double high[3]) {
    for (int side = 0; side < 6; ++side) {
        const int a = side / 2, b = (a + 1) % 3, c = (a + 2) % 3;
        double origin[3], u[3] = {0, 0, 0}, v[3] = {0, 0, 0};
        memcpy(origin, low, sizeof origin);
        if (side % 2) origin[a] = high[a];
        u[b] = high[b] - low[b];
        v[c] = high[c] - low[c];
        check_add_quad(triangles, origin, u, v);
    }
}

/* A sphere of 2 n * n facets by latitude and longitude; normals are the sphere's. Neighbours' corners are the same to
   the bit, at the seam and the poles as well. */
static void add_globe(check_triangles *triangles, const double centre[3], double radius, int n) {
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < 2 * n; ++j) {
            double unit[4][3];
            for (int k = 0; k < 4; ++k) {
                const int column = (j + (k == 1 || k == 2)) % (2 * n), row = i + (k >= 2);
                const double across = PI * column / n, down = PI * row / n, wide = row % n ? sin(down) : 0;
                check_set3(unit[k], wide * cos(across), cos(down), wide * sin(across));
            }
            for (int half = 0; half < 2; ++half) {
                const int corners[3] = {0, half ? 2 : 1, half ? 3 : 2};
                sps_triangle *t;
                if ((half == 0 && i == 0) || (half == 1 && i == n - 1)) continue; /* at a pole, it is a line */
                t = check_add_triangle(triangles);
                for (int k = 0; k < 3; ++k)
                    for (int c = 0; c < 3; ++c) {
                        t->position[k][c] = (float)(centre[c] + radius * unit[corners[k]][c]);
                        t->normal[k][c] = (float)unit[corners[k]][c];
                    }
            }
        }
}

/* ------------------------------------------------------------------------------------- the tree against plain loops */

typedef long double real;

static real side_of(const real a[3], const real b[3], const real d[3]) {
    return d[0] * (a[1] * b[2] - a[2] * b[1]) + d[1] * (a[2] * b[0] - a[0] * b[2]) + d[2] * (a[0] * b[1] - a[1] * b[0]);
}

/* Whether a face blocks a ray: 0 or 1, or 2 where round-off decides. Doubles lose 1e-15 of the terms: products of three
   lengths, of which a few ulps of the largest are tolerated. */
static int stops(const spsi_face *face, const double origin[3], const double toward[3], double reach, double room) {
    real a[3][3], d[3], n[3], sides[3], largest = 0, facing = 0, ahead = 0, across = 0;
    int above = 0, below = 0, near_edge = 0;
    for (int i = 0; i < 3; ++i) {
        d[i] = toward[i];
        for (int k = 0; k < 3; ++k) a[k][i] = (real)face->position[k][i] - (real)origin[i];
        for (int k = 0; k < 3; ++k) largest = fmaxl(largest, fabsl(a[k][i]));
        across = fmaxl(across, fabsl(d[i]));
    }
    for (int k = 0; k < 3; ++k) sides[k] = side_of(a[k], a[(k + 1) % 3], d);
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        n[i] = (a[1][j] - a[0][j]) * (a[2][k] - a[0][k]) - (a[1][k] - a[0][k]) * (a[2][j] - a[0][j]);
    }
    for (int i = 0; i < 3; ++i) facing += n[i] * d[i], ahead += n[i] * a[0][i];
    if (facing < 0) facing = -facing, ahead = -ahead;
    room *= (double)(fabsl(n[0]) + fabsl(n[1]) + fabsl(n[2]));
    for (int k = 0; k < 3; ++k) {
        above += sides[k] > 0;
        below += sides[k] < 0;
        near_edge |= fabsl(sides[k]) <= 1e-14L * largest * largest * across;
    }
    if (above > 0 && below > 0 && !near_edge) return 0;
    {
        const real slack = 1e-3L * room + 1e-14L * largest * (fabsl(n[0]) + fabsl(n[1]) + fabsl(n[2]));
        const real beyond = reach <= 1 ? (real)reach * facing : HUGE_VALL;
        if (ahead < room - slack || ahead > beyond + slack) return 0;
        if (near_edge || fabsl(ahead - room) <= slack || fabsl(ahead - beyond) <= slack || facing <= slack) return 2;
    }
    return 1;
}

/* Rays from points on faces and in the air, to lights near and far, one packet after another. */
static void check_rays(spsi_faces *faces, int rays, int crowded, check_random *random, const char *name) {
    int wrong = 0, decided = 0, stopped_count = 0;
    for (int first = 0; first < rays; first += SPSI_PACKET) {
        double origin[SPSI_PACKET][3], toward[SPSI_PACKET][3];
        int own[SPSI_PACKET];
        spsi_packet packet;
        const int is_direction = check_next(random) < 0.5, on_faces = check_next(random) < 0.7;
        spsi_packet_begin(faces, is_direction, on_faces, &packet);
        for (int i = 0; i < SPSI_PACKET; ++i) {
            const spsi_face *face = &faces->list[(int)(check_next(random) * faces->count)];
            double w[3] = {check_next(random), check_next(random), 0};
            if (w[0] + w[1] > 1) w[0] = 1 - w[0], w[1] = 1 - w[1];
            w[2] = 1 - w[0] - w[1];
            own[i] = i % 4 && on_faces ? (int)(face - faces->list) : -1;
            for (int c = 0; c < 3; ++c) {
                const double size = fabs(face->position[1][c] - face->position[0][c]);
                origin[i][c] = w[0] * face->position[0][c] + w[1] * face->position[1][c] + w[2] * face->position[2][c];
                if (own[i] < 0) origin[i][c] += size * (check_next(random) - 0.5);
                toward[i][c] = (check_next(random) - 0.5) * (is_direction ? 1 : 10 * size + 1e-3);
            }
            spsi_packet_add(&faces->tree, i, own[i], origin[i], toward[i], &packet);
        }
        spsi_packet_trace(faces, &packet);
        for (int i = 0; i < SPSI_PACKET; ++i) {
            int stopped = 0;
            for (int f = 0; f < faces->count && stopped != 1; ++f) {
                const double room = on_faces ? (double)faces->list[f].rounding + packet.rounding : 0;
                const int met = f == own[i] ? 0 : stops(&faces->list[f], origin[i], toward[i], packet.reach, room);
                if (met > 0) stopped = met;
            }
            stopped_count += stopped == 1;
            if (stopped == 2) continue;
            decided += 1;
            wrong += (packet.open >> i & 1) == stopped;
        }
    }
    /* a few in a hundred begin within round-off of a face or an edge; in a crowd, many are blocked, and many are not */
    if (!CHECK(wrong == 0 && decided > rays * 3 / 4) ||
        (crowded && !CHECK(stopped_count > rays / 20 && stopped_count < decided - rays / 20)))
        printf("    %s: %d of %d wrong, %d decided, %d stopped\n", name, wrong, rays, decided, stopped_count);
}

/* Faces and their tree, of the body at a placement. */
static int build_faces(check_scene *s, const double offset[3], spsi_faces *faces) {
    sps_mesh *mesh = check_add_mesh(s, &body, 1);
    spsi_frame *frame;
    mesh->placement = check_box(0, 0, 0, 1, 1, 1);
    memcpy(mesh->placement.origin, offset, sizeof mesh->placement.origin);
    frame = spsi_frame_build(context, &s->scene, NULL, 0);
    return CHECK(frame) && CHECK_OK(context, spsi_gather_faces(context, frame, faces)) &&
           CHECK_OK(context, spsi_faces_tree(context, faces));
}

/* Triangles of many sizes within a radius, some of them slivers. */
static void add_soup(check_random *random, int count, double radius, double most) {
    for (int n = 0; n < count; ++n) {
        double corner[3][3];
        const double size = most * pow(1e-3, check_next(random)), thin = n % 5 ? 1 : 1e-4;
        for (int i = 0; i < 3; ++i) {
            corner[0][i] = radius * (2 * check_next(random) - 1);
            corner[1][i] = corner[0][i] + size * (check_next(random) - 0.5);
            corner[2][i] = corner[0][i] + thin * size * (check_next(random) - 0.5);
        }
        check_add_corners(&body, corner[0], corner[1], corner[2]);
    }
}

static void test_tree_against_loops(void) {
    static const int counts[] = {1, 2, 4, 5, 7, 40, 900};
    check_random random = {7};
    for (int place = 0; place < 3; ++place)
        for (int n = 0; n < 7; ++n) {
            const double offset[3] = {place * 1e6, place * -3e5, place == 2 ? 1e9 : 0};
            check_scene s;
            spsi_faces faces;
            char name[64];
            start(&s);
            add_soup(&random, counts[n] - (n >= 3), 1, n < 5 ? 8 : 0.8);
            if (n >= 3) { /* one a million times as wide */
                const double a[3] = {-1e6, -0.9, -1e6}, b[3] = {1e6, -0.9, -1e6}, c[3] = {0, -0.9, 2e6};
                check_add_corners(&body, a, b, c);
            }
            snprintf(name, sizeof name, "%d triangles at %g", counts[n], offset[0]);
            if (!build_faces(&s, offset, &faces)) return;
            check_rays(&faces, check_long() ? 1600 : 600, counts[n] >= 40, &random, name);
        }
}

/* Every face is in one leaf, each box contains its subtree, and no node has two parents: for any number of faces, with
   all in one place, and with one far away. */
static void test_tree_holds_all(void) {
    check_random random = {3};
    for (int count = 1; count < 3000; count = count * 5 / 4 + 1)
        for (int kind = 0; kind < 3; ++kind) {
            check_scene s;
            spsi_faces faces;
            int *seen = (int *)calloc((size_t)count, sizeof *seen), wrong = 0, leaves = 0;
            int stack[SPSI_TREE_STACK], top = 0;
            const double offset[3] = {1e5, 0, 0};
            start(&s);
            if (kind != 1) add_soup(&random, count, kind ? 1 : 0.5, 0.3);
            for (int i = 0; kind == 1 && i < count; ++i) {
                const double a[3] = {0, 0, 0}, b[3] = {1, 0, 0}, c[3] = {0, 1, 0};
                check_add_corners(&body, a, b, c);
            }
            if (kind == 2)
                for (int k = 0; k < 3; ++k) body.list[0].position[k][0] += 1e6f;
            if (!seen || !build_faces(&s, offset, &faces)) return;
            stack[top++] = 0;
            while (top > 0) {
                const spsi_tree_node *node = &faces.tree.nodes[stack[--top]];
                leaves += node->count > 0;
                for (int i = 0; i < node->count; ++i) {
                    const int number = faces.tree.order[node->first + i];
                    seen[number] += 1;
                    for (int k = 0; k < 9; ++k) {
                        const double at = faces.list[number].position[k / 3][k % 3] - faces.tree.centre[k % 3];
                        wrong += !(at >= (double)node->low[k % 3] && at <= (double)node->high[k % 3]);
                    }
                }
                for (int child = node->first; node->count == 0 && child < node->first + 2; ++child) {
                    for (int k = 0; k < 3; ++k)
                        wrong += faces.tree.nodes[child].low[k] < node->low[k] ||
                                 faces.tree.nodes[child].high[k] > node->high[k];
                    stack[top++] = child;
                }
            }
            for (int i = 0; i < faces.count; ++i) wrong += seen[i] != 1;
            if (!CHECK(wrong == 0 && leaves <= (faces.count + 1) / 2 + 1))
                printf("    %d faces, kind %d: %d wrong, %d leaves\n", faces.count, kind, wrong, leaves);
            free(seen);
        }
}

/* A closed body is dark inside, for rays through any corner, edge or face. */
static void test_closed_body_is_tight(void) {
    const double centre[3] = {0.1, 0.2, -0.3}, offset[3] = {3e4, 7, -2e3};
    check_random random = {11};
    spsi_faces faces;
    check_scene s;
    int leaks = 0;
    start(&s);
    add_globe(&body, centre, 1, 12);
    if (!build_faces(&s, offset, &faces)) return;
    for (int n = 0; n < 40000; n += SPSI_PACKET) {
        spsi_packet packet;
        spsi_packet_begin(&faces, 1, 0, &packet);
        for (int i = 0; i < SPSI_PACKET; ++i) {
            const spsi_face *face = &faces.list[(int)(check_next(&random) * faces.count)];
            const double t = i % 3 == 0 ? 0 : check_next(&random);
            double origin[3], toward[3];
            for (int c = 0; c < 3; ++c) {
                origin[c] = centre[c] + offset[c] + 0.5 * (check_next(&random) - 0.5);
                toward[c] =
                    face->position[0][c] + t * (face->position[1 + i % 2][c] - face->position[0][c]) - origin[c];
            }
            spsi_packet_add(&faces.tree, i, -1, origin, toward, &packet);
        }
        spsi_packet_trace(&faces, &packet);
        for (int i = 0; i < SPSI_PACKET; ++i) leaks += packet.open >> i & 1;
    }
    if (!CHECK(leaks == 0)) printf("    %d of 40000 rays leave a closed body\n", leaks);
}

/* ------------------------------------------------------------------------------------------- pictures, at any scale */

/* Pixels that differ by more than float round-off, of those whose ray passes no edge. */
static int differing(const check_scene *s) {
    int count = 0;
    if (!check_render(context, s, image_a) || !check_march(context, s, 1, image_b, NULL)) return -1;
    for (int i = 0; i < SIDE * SIDE; ++i)
        count += fabsf(image_a[4 * i] - image_b[4 * i]) > 1e-4f * (1 + image_b[4 * i]);
    return count;
}

/* A ball over a ground of any width: no pixel differs from the reference, whose shadow rays share only the rule by
   which faces block them; and none from the smallest ground's picture, where only that is seen. */
static void test_ground_of_any_width(void) {
    const double centre[3] = {0, 0.5, 0};
    static float smallest[4 * SIDE * SIDE];
    for (int point = 0; point < 2; ++point)
        for (double half = 4; half < 2e6; half *= 16) {
            check_scene s;
            int wrong;
            start(&s);
            add_ground(half);
            add_globe(&body, centre, 0.4, 10);
            check_add_mesh(&s, &ground, 0.5);
            check_add_mesh(&s, &body, 0.5);
            check_set3(s.view.camera.position, 0, 2.5, 2);
            check_set3(s.view.camera.target, -0.4, 0, 0);
            check_perspective(&s.view.camera, 0.8);
            if (point)
                check_add_point(&s, 3, 3, 0.2, 30);
            else
                check_add_directional(&s, -1, -1, 0.1, 3);
            wrong = differing(&s);
            if (half < 5) memcpy(smallest, image_a, sizeof smallest);
            /* an edge within the eye's round-off of a pixel's ray, 1e-13 of a pixel, does not occur by chance */
            if (!CHECK_CASE("Found in review", "shadow of a ball on a ground of 4 to 1e6",
                            "pixels unlike brute force's", wrong, 0,
                            "exact, except for edges within 1e-13 of a pixel's ray"))
                printf("    ground of %g: %d pixels differ from the reference\n", half, wrong);
            /* the ground's own float corners put the plane where it is exactly: y = 0 */
            CHECK(check_largest(image_a, smallest, 4 * SIDE * SIDE) <= 1e-5);
            CHECK(mean_of(image_a, (size_t)(SIDE * SIDE)) > 0.1);
        }
}

static double puff(const void *user, const double p[3]) {
    (void)user;
    return exp(-16 * (p[0] * p[0] + (p[1] - 0.55) * (p[1] - 0.55) + p[2] * p[2]));
}

/* Error of a picture against the reference, relative to the mean. */
static double relative_error(const check_scene *s, const float *reference) {
    double sum = 0;
    if (!check_render(context, s, image_a)) return HUGE_VAL;
    for (int i = 0; i < GAS_SIDE * GAS_SIDE; ++i) {
        const double off = (double)image_a[4 * i] - (double)reference[4 * i];
        sum += off * off;
    }
    return sqrt(sum) / GAS_SIDE / mean_of(reference, (size_t)(GAS_SIDE * GAS_SIDE));
}

/* Gas over a ground of any width: a puff above it, or fog that it cuts, under a low sun. */
static void check_gas_over_ground(int fog, int point) {
    static const sps_quality qualities[3] = {SPS_QUALITY_DRAFT, SPS_QUALITY_MEDIUM, SPS_QUALITY_HIGH};
    const float constant = 1;
    check_field field;
    double first[3] = {0, 0, 0};
    memset(&field, 0, sizeof field);
    field.value_fn = puff;
    for (double half = 4; half < 2e6; half *= check_long() ? 512 : 512 * 512) {
        check_scene s;
        sps_volume *gas;
        start(&s);
        s.view.width = s.view.height = GAS_SIDE;
        add_ground(half);
        check_add_mesh(&s, &ground, 0.1);
        if (fog) {
            gas = check_add_volume(&s, 20, 8, 20, check_box(-2, -0.1, -2, 2, 0.5, 2));
            gas->read_fn = check_read_constant, gas->user = (void *)(uintptr_t)&constant, gas->extinction = 0.3f;
        } else {
            gas = check_add_volume(&s, 32, 32, 32, check_box(-0.5, 0.05, -0.5, 0.5, 1.05, 0.5));
            gas->eval_fn = check_eval_field, gas->user = &field, gas->extinction = 6;
        }
        check_color(gas->albedo, 0.9, 0.9, 0.9);
        if (point)
            check_add_point(&s, 7, 5, 0.3, 200);
        else
            check_add_directional(&s, -1, fog ? -0.1 : -1, 0.2, 3);
        check_set3(s.view.camera.position, 0, 1.2, fog ? 4 : 2);
        check_set3(s.view.camera.target, 0, 0.4, 0);
        check_perspective(&s.view.camera, 0.6);
        if (!check_march(context, &s, 0.7, image_b, NULL)) return;
        for (int q = 0; q < 3; ++q) {
            double error;
            s.view.quality = qualities[q];
            error = relative_error(&s, image_b);
            if (half < 5) first[q] = error;
            if (!CHECK_CASE("Found in review", "gas and fog over a ground of 4 to 1e6, low sun and lamp",
                            "brute force, rms of the mean", error, fmin(1.2 * first[q] + 1e-6, 0.05),
                            "1.2 times the error on a ground of 4"))
                printf("    fog %d, point %d, ground of %g, quality %d: %g, of 4: %g\n", fog, point, half,
                       (int)qualities[q], error, first[q]);
        }
    }
}

static void test_gas_over_ground(void) {
    for (int i = 0; i < 4; i += check_long() ? 1 : 3) check_gas_over_ground(i & 1, i >> 1);
}

/* A town of 1000 boxes on a wide ground under a low sun, from street level to the horizon, and from above. */
static void test_town(void) {
    check_random random = {5};
    for (int view = 0; view < 3; ++view) {
        check_scene s;
        int wrong;
        start(&s);
        add_ground(5000);
        for (int n = 0; n < 1000; ++n) {
            double low[3], high[3];
            for (int i = 0; i < 3; ++i) {
                low[i] = i == 1 ? 0 : 80.0 * (i ? n / 32 - 16 : n % 32 - 16) + 20 * check_next(&random);
                high[i] = low[i] + (i == 1 ? 10 + 60 * check_next(&random) : 20 + 30 * check_next(&random));
            }
            add_box(&body, low, high);
        }
        check_add_mesh(&s, &ground, 0.5);
        check_add_mesh(&s, &body, 0.5);
        check_add_directional(&s, -1, -0.08, 0.37, 3);
        check_set3(s.view.camera.position, view == 1 ? 300 : 0, view == 2 ? 900 : 1.7, view == 2 ? 700 : 0);
        check_set3(s.view.camera.target, view == 2 ? 0 : 1000, view == 2 ? 0 : 1.7, view == 1 ? -900 : 300);
        check_perspective(&s.view.camera, 1);
        wrong = differing(&s);
        if (!CHECK(wrong == 0)) printf("    view %d: %d pixels differ\n", view, wrong);
    }
}

/* A smooth globe shades nothing that is lit by its normals, and everything behind another globe. */
static void test_smooth_terminator(void) {
    const double centre[3] = {0, 0, 0};
    for (int n = 4; n <= 32; n *= 2) {
        check_scene s;
        int dark = 0;
        start(&s);
        add_globe(&body, centre, 1, n);
        check_add_mesh(&s, &body, 1)->has_normals = 1;
        check_add_directional(&s, -0.9, -0.1, -0.42, 1);
        check_orthographic(&s.view.camera, 2.2);
        if (!check_render(context, &s, image_a)) return;
        s.view.no_shadows = 1;
        if (!check_render(context, &s, image_b)) return;
        for (int i = 0; i < 4 * SIDE * SIDE; ++i) dark += image_a[i] < image_b[i];
        if (!CHECK_CASE("Found in review", "coarse smooth globes, 4 to 32 facets about",
                        "shade nothing that their normals light", dark, 0, "exact") ||
            !CHECK(mean_of(image_b, (size_t)(SIDE * SIDE)) > 0.05))
            printf("    globe of %d: %d values too dark\n", n, dark);
    }
}

/* A lamp close to a coarse smooth globe: the side of a surface that is lit depends on the surface, not on the origin of
   its rays, which may be behind the lamp. */
static void test_lamp_near_coarse_mesh(void) {
    const double centre[3] = {0, 0, 0};
    for (int n = 0; n < 12; ++n) {
        const double angle = 0.5 * n, distance = 1.02 + 0.04 * (n % 4);
        check_scene s;
        start(&s);
        add_globe(&body, centre, 1, 4);
        check_add_mesh(&s, &body, 1)->has_normals = 1;
        check_add_point(&s, distance * cos(angle), 0.3, distance * sin(angle), 1);
        check_set3(s.view.camera.position, 5 * cos(angle + 0.4), 1, 5 * sin(angle + 0.4));
        check_orthographic(&s.view.camera, 2.2);
        if (!CHECK_CASE("Found in review", "lamp close to a coarse smooth globe", "pixels unlike brute force's",
                        differing(&s), 0, "exact, except for edges within 1e-13 of a pixel's ray"))
            printf("    lamp %d: %d pixels differ\n", n, differing(&s));
    }
}

/* Gas just below a ground of any width is dark, in every kind of picture: a point that is not on a face needs no
   allowance for round-off. The ground is 1 % of the gas's height above it, and 1e-8 of its own width. */
static void test_gas_under_ground(void) {
    static float one = 1;
    for (double half = 2; half < 2e6; half *= 100) {
        check_scene s;
        sps_volume *volume;
        start(&s);
        add_ground(half);
        check_add_mesh(&s, &ground, 0);
        volume = check_add_volume(&s, 8, 8, 8, check_box(-1, -1.01, -1, 1, -0.01, 1));
        volume->read_fn = check_read_constant;
        volume->user = &one;
        check_add_directional(&s, -0.2, -1, 0.1, 3);
        check_set3(s.view.camera.position, 0.3, -5, 0.2); /* from below */
        check_orthographic(&s.view.camera, 1);
        if (!check_render(context, &s, image_a) || !check_march(context, &s, 1, image_b, NULL)) return;
        CHECK(image_a[3] > 0.5f && image_b[3] > 0.5f);
        CHECK(mean_of(image_a, (size_t)(SIDE * SIDE)) <= 0 && mean_of(image_b, (size_t)(SIDE * SIDE)) <= 0);
    }
}

/* Duplicates in one plane, at odd positions and angles, shade each other nowhere; a sheet just above their round-off
   does. */
static void test_twins(void) {
    for (int n = 0; n < 6; ++n) {
        const double far_away[6] = {0, 1, 1e3, 1e5, 1e7, 3e8};
        const double at = far_away[n], size = n < 2 ? 3.3 : 0.7, turn = 0.3 + n;
        check_scene s;
        int wrong = 0;
        start(&s);
        add_ground(size);
        add_ground(0.77 * size);
        for (int lifted = 0; lifted < 2; ++lifted) {
            sps_mesh *mesh = check_add_mesh(&s, &ground, 0.5);
            mesh->placement = check_box(0, 0, 0, 1, 1, 1);
            check_set3(mesh->placement.origin, at, -0.5 * at, 0.1 * at);
            check_set3(mesh->placement.axis[0], cos(turn), sin(turn), 0);
            check_set3(mesh->placement.axis[1], -sin(turn), cos(turn), 0);
        }
        check_set3(s.view.camera.position, at, -0.5 * at, 0.1 * at);
        check_set3(s.view.camera.target, at, -0.5 * at, 0.1 * at);
        s.view.camera.position[0] += -4 * sin(turn), s.view.camera.position[1] += 4 * cos(turn);
        check_set3(s.view.camera.up, 0, 0, 1);
        check_orthographic(&s.view.camera, 2);
        check_add_directional(&s, sin(turn) + 2 * cos(turn), -cos(turn) + 2 * sin(turn), 0.1, 3);
        if (!check_render(context, &s, image_a)) return;
        s.view.no_shadows = 1;
        if (!check_render(context, &s, image_b)) return;
        for (int i = 0; i < 4 * SIDE * SIDE; ++i) wrong += image_a[i] < image_b[i];
        if (!CHECK_CASE("Extremes", "repeated triangles in one plane, as far out as 3e8", "shade each other nowhere",
                        wrong, 0, "exact") ||
            !CHECK(mean_of(image_b, (size_t)(SIDE * SIDE)) > 0.01))
            printf("    twins at %g: %d values too dark\n", at, wrong);
    }
}

/* -------------------------------------------------------------------------------------------------- reuse of meshes */

static void test_revision(void) {
    const double centre[3] = {0, 0.5, 0};
    sps_plan_report plan;
    sps_stats_report stats;
    check_scene s;
    start(&s);
    add_ground(3);
    add_globe(&body, centre, 0.4, 8);
    check_add_mesh(&s, &ground, 0.5)->revision = 1;
    check_add_mesh(&s, &body, 0.5)->revision = 1;
    check_add_directional(&s, -1, -1, 0.1, 3);
    s.view.camera.position[1] = 3;
    check_perspective(&s.view.camera, 0.4);
    for (int n = 0; n < 6; ++n) {
        const int read = n == 0 || n >= 3; /* then: another color; another placement; another revision */
        const long calls = ground.calls + body.calls;
        if (n == 3) s.mesh[1].albedo[0] = 0.25f;
        if (n == 4) s.mesh[1].placement = check_box(0.1, 0, 0, 1.1, 1, 1);
        if (n == 5) s.mesh[0].revision = 2;
        s.view.camera.position[0] = 0.1 * n; /* the camera may move */
        if (!CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan)) || !check_render(context, &s, image_a))
            return;
        sps_get_stats(context, &stats);
        CHECK(stats.triangle_calls == plan.triangle_calls && (plan.triangle_calls > 0) == read);
        CHECK((ground.calls + body.calls > calls) == read);
        CHECK((plan.pass[SPS_PASS_TRIANGLE_TREE].runs == 1) == read);
        CHECK(stats.triangles == 2 + body.count && stats.shadow_rays > 0);
        { /* the same bits from a context that has kept nothing */
            sps_context *other = check_context(NULL);
            CHECK(other && check_render(other, &s, image_b) && memcmp(image_a, image_b, sizeof image_a) == 0);
            sps_destroy(other);
        }
    }
    s.mesh[1].revision = 0; /* one without a revision: all are read, each time */
    for (int n = 0; n < 2; ++n) {
        if (!check_render(context, &s, image_a)) return;
        sps_get_stats(context, &stats);
        CHECK(stats.triangle_calls > 0);
    }
}

/* Minimum depths about the cells of a depth map of 20 x 13 cells, of which the second part is of each alone. */
static void test_depth_map_cells(void) {
    enum { COLUMNS = 20, ROWS = 13, CELLS = COLUMNS * ROWS };
    check_random random = {8};
    float memory[2 * CELLS];
    const float *alone = memory + CELLS;
    for (int i = 0; i < CELLS; ++i) memory[CELLS + i] = (float)check_next(&random);
    spsi_cells_spread(memory, COLUMNS, ROWS);
    for (int i = 0; i < CELLS; ++i) {
        float least = 1;
        for (int k = 0; k < CELLS; ++k)
            if (abs(k % COLUMNS - i % COLUMNS) <= 1 && abs(k / COLUMNS - i / COLUMNS) <= 1)
                least = alone[k] < least ? alone[k] : least;
        CHECK(memory[i] == least);
    }
}

int main(void) {
    context = check_context(NULL);
    if (!context) return 1;
    RUN(test_depth_map_cells);
    RUN(test_tree_holds_all);
    RUN(test_tree_against_loops);
    RUN(test_closed_body_is_tight);
    RUN(test_ground_of_any_width);
    RUN(test_gas_over_ground);
    RUN(test_town);
    RUN(test_smooth_terminator);
    RUN(test_lamp_near_coarse_mesh);
    RUN(test_gas_under_ground);
    RUN(test_twins);
    RUN(test_revision);
    sps_destroy(context);
    check_free_triangles(&ground);
    check_free_triangles(&body);
    return check_report();
}
