/* Transmittance maps: particles, voxels and triangles against sums and integrals in double precision, in maps of every
   technique. The result of each technique for one ray is tested by test_transmittance. */

#include "map_scene.h"

enum { RANGE_POINTS = 400 };

/* -------------------------------------------------------------------------------------------------------- particles */

/* Chords from every side: particles cross near_depth, far_depth and the light's plane, and one contains the light. */
static void test_particles(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4 * WAYS; ++n) {
        const int way = n / 4, soft = n % 2;
        fixture f;
        sps_tmap *map;
        check_random random = {99};
        begin(&f, SPS_TMAP_DEEP);
        see(&f, way, way == ROUND ? 33 : SIDE);
        f.settings.near_depth = 1, f.settings.far_depth = 17;
        f.sets[soft].is_extinction = n / 2 % 2;
        scatter(&f, soft, 60, 6, 11);
        add(&f, soft, f.light.camera.position[0] + 0.5, f.light.camera.position[1], f.light.camera.position[2] - 0.25,
            2, 0.7);
        map = must_build(&f, context);
        for (int i = 0; i < 1500 && map; ++i) {
            const int side = f.light.width, x = (int)(side * check_next(&random)),
                      y = (int)(side * check_next(&random));
            const double t = i % 9 == 0 ? 25 : 19 * check_next(&random);
            double point[3];
            answer exact;
            on_ray(map, way == ROUND ? i % 6 : 0, x, y, t, point);
            exact = exact_particles(&f, point);
            if (!CHECK_NEAR(query_at(map, point), exact.depth, exact.slack))
                printf("    way %d soft %d texel %d %d t %g\n", way, soft, x, y, t);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* The same with literal numbers: halves, wholes, zeros. */
static void test_plain_numbers(void) {
    sps_context *context = sps_create(NULL, NULL);
    fixture f;
    sps_tmap *map;
    begin(&f, SPS_TMAP_DEEP);
    add(&f, 0, 0, 0, 1, 2, 3);
    map = must_build(&f, context);
    CHECK_NEAR(query(map, 0, 0, 3.5), 0, 0);
    CHECK_NEAR(query(map, 0, 0, 1), 1.5, 1e-5);
    CHECK_NEAR(query(map, 0, 0, -5), 3, 1e-6);
    CHECK_NEAR(query(map, 1, 0, -5), 3 * sqrt(3.0) / 2, 3e-6);
    CHECK_NEAR(query(map, 0.5, 0, -5), 0.5 * (3 + 3 * sqrt(3.0) / 2), 3e-6); /* between two texels */
    CHECK_NEAR(query(map, 30, 0, -5), 0, 0);
    CHECK_NEAR(query(map, 4.4, 0, -5), query(map, 4, 0, -5), 0); /* the outer half of the last texel is its own */
    sps_tmap_destroy(map);
    f.crowds[0].count = 0;
    for (int soft = 0; soft < 2; ++soft) { /* a light at the centre of a particle sees half of it */
        see(&f, SPOT, SIDE);
        f.crowds[0].count = f.crowds[1].count = 0;
        add(&f, soft, 0, 0, 10, 2, 4);
        map = must_build(&f, context);
        CHECK_NEAR(query(map, 0, 0, 0), 2, 2e-6);
        CHECK_NEAR(query(map, 0, 0, 12), 0, 0); /* behind the light */
        sps_tmap_destroy(map);
        f.crowds[soft].count = 0;
        add(&f, soft, 0, 0, 13, 2, 4); /* entirely behind it */
        add(&f, soft, 0, 0, 0, 0, 1e18);
        map = must_build(&f, context);
        CHECK_NEAR(query(map, 0, 0, 0), 0, 0);
        CHECK(sps_tmap_starts(map)[SIDE * SIDE] == 0);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* Between texels the result is bilinear in those of four texels at the point's own depth; it is clamped for half a
   texel beyond the outermost texels' centres, and 0 outside. */
static void test_between_texels(void) {
    sps_context *context = sps_create(NULL, NULL);
    check_random random = {3};
    fixture f;
    sps_tmap *map;
    begin(&f, SPS_TMAP_DEEP);
    scatter(&f, 0, 40, 4, 21);
    scatter(&f, 1, 40, 4, 22);
    map = must_build(&f, context);
    for (int i = 0; i < 600 && map; ++i) {
        const double x = 10.4 * (check_next(&random) - 0.5), y = 10.4 * (check_next(&random) - 0.5);
        const double z = 10 - 20 * check_next(&random), fx = x - floor(x), fy = y - floor(y);
        double sum = 0, slack = 0;
        for (int k = 0; k < 4; ++k) {
            const double point[3] = {fmin(fmax(floor(x) + k % 2, -4), 4), fmin(fmax(floor(y) + k / 2, -4), 4), z};
            const answer exact = exact_particles(&f, point);
            const double weight = (k % 2 ? fx : 1 - fx) * (k / 2 ? fy : 1 - fy);
            sum += weight * exact.depth, slack += weight * exact.slack;
        }
        if (fabs(x) > 4.5 || fabs(y) > 4.5) sum = slack = 0;
        CHECK_NEAR(query(map, x, y, z), sum, slack);
    }
    sps_tmap_destroy(map);
    sps_destroy(context);
}

/* A particle smaller than a texel becomes a ball of 3/4 of a texel, R, of the same mass; and up to a radius of one
   texel, wherever it lies between texels, its chords add up to its mass, 2/3 pi r^2 depth, or 2/5 if it is soft. Point
   samples alone would have 0.21 to 1.47 of it (test_sampling). What remains are CHORD's 1e-3 at up to four rims, of a
   sum of at least 1.17 in the map and in its weight. From 1.5 texels on chords are unchanged (test_particles). */
static void test_small_particles(void) {
    static const double radii[4] = {0.01, 0.5, 0.9, 1};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 8; ++n) {
        const int soft = n % 2;
        const double r = radii[n / 2],
                     depth = r < SPSI_SPHERE_LEAST ? 0.0009 : 0.1; /* denser ones keep what they stop */
        const double whole = depth * r * r * PI * (soft ? 2.0 / 5 : 2.0 / 3);
        for (int i = 0; i < 256; ++i) {
            const double px = (i % 16 + 0.5) / 16, py = (i / 16 + 0.5) / 16;
            double sum = 0, point[3];
            fixture f;
            sps_tmap *map;
            begin(&f, SPS_TMAP_OPACITY);
            f.settings.components = 2;
            f.sets[soft].is_extinction = i / 2 % 2;
            see(&f, i % 2 ? ORTHO : ORTHO_TURNED, SIDE);
            map = build(&f, context);
            on_ray(map, 0, 4, 4, 10, point);
            vec_along(point, map->grid.rays[0].a, px, point);
            vec_along(point, map->grid.rays[0].b, py, point);
            sps_tmap_destroy(map);
            add(&f, soft, point[0], point[1], point[2], r,
                depth / (f.sets[soft].is_extinction ? r * (soft ? 4.0 / 3 : 2) : 1));
            map = must_build(&f, context);
            for (int k = 0; k < SIDE * SIDE && map; ++k) sum += (double)sps_tmap_texels(map)[2 * k + 1];
            CHECK_CASE("Found in review", "particles below a texel, wherever they lie in it", "their mass, relative",
                       fabs(sum / whole - 1), 0.007,
                       "chords to 1e-3 at four rims, of a sum of 1.17, in map and weight");
            sps_tmap_destroy(map);
        }
    }
    sps_destroy(context);
}

/* The same around a light, at cubes' edges and corners: texels count by their solid angle, those on an edge for half of
   it in either face. The weights and the measurement use the same sum. */
static void test_small_particles_around(void) {
    enum { FACE = 33 };
    sps_context *context = sps_create(NULL, NULL);
    check_random random = {61};
    for (int n = 0; n < 240; ++n) {
        const int axis = n % 3, soft = n / 3 % 2, near_edge = n % 5 > 0, near_corner = n % 5 > 2;
        const double pitch = 2.0 / (FACE - 1), radius = 4 * pitch * (0.02 + 0.98 * check_next(&random));
        const double side[2] = {near_edge ? 1 + 6 * pitch * (check_next(&random) - 0.5) : check_next(&random),
                                near_corner ? 1 + 6 * pitch * (check_next(&random) - 0.5)
                                            : 2 * check_next(&random) - 1};
        const double sign = n % 2 ? 4 : -4, depth = radius < 4 * pitch ? 0.0009 : 1;
        double offset[3], sum = 0, exact;
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_OPACITY);
        f.settings.components = 1;
        see(&f, ROUND, FACE);
        offset[axis] = sign, offset[(axis + 1) % 3] = sign * side[0], offset[(axis + 2) % 3] = sign * side[1];
        add(&f, soft, f.light.camera.position[0] + offset[0], f.light.camera.position[1] + offset[1],
            f.light.camera.position[2] + offset[2], radius, depth);
        map = must_build(&f, context);
        for (int i = 0; i < 6 * FACE * FACE && map; ++i) {
            const int x = i % FACE, y = i / FACE % FACE;
            const double u = x * pitch - 1, v = y * pitch - 1;
            const double part = (x % (FACE - 1) ? 1 : 0.5) * (y % (FACE - 1) ? 1 : 0.5);
            sum += (double)sps_tmap_texels(map)[i] * part * pitch * pitch * pow(1 + u * u + v * v, -1.5);
        }
        exact = depth * PI * radius * radius * (soft ? 2.0 / 5 : 2.0 / 3) / vec_dot(offset, offset);
        if (!CHECK_NEAR(sum, exact, 0.007 * exact)) printf("    at %g %g\n", side[0], side[1]);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* ---------------------------------------------------------------------------------------------------------- volumes */

static double transfer_at(const sps_transfer *transfer, double value) {
    const sps_transfer_point *p = transfer->points;
    if (value <= (double)p[0].value) return (double)p[0].extinction;
    for (int i = 1; i < transfer->point_count; ++i)
        if (value <= (double)p[i].value) {
            const double part = (value - (double)p[i - 1].value) / ((double)p[i].value - (double)p[i - 1].value);
            return (double)p[i - 1].extinction + part * ((double)p[i].extinction - (double)p[i - 1].extinction);
        }
    return (double)p[transfer->point_count - 1].extinction;
}

/* The sum of a row of kernels that begins at a face, `at` voxels behind that. It is not exactly a Gaussian's integral:
   voxels are points, with a variance smaller than that of their cells by 1/12. */
static double face_at(double at) {
    static float table[8 * 64 + 2];
    const double x = fmin(fmax(at + 4, 0), 7.99) * 64;
    const int i = (int)x;
    if (!(table[8 * 64] > 0))
        for (int k = 0; k < 8 * 64 + 2; ++k)
            for (int n = 0; n < 9; ++n)
                table[k] += (float)(exp(-0.5 * pow((k / 64.0 - 4.5 - n) / 0.65, 2)) / (0.65 * sqrt(2 * PI)));
    return (double)table[i] + (x - i) * ((double)table[i + 1] - (double)table[i]);
}

/* Extinction of the fixture's boxes at a point: a lattice of kernels is uniform inside, and fades out at its faces. */
static double boxes_at(const fixture *f, const double point[3]) {
    double sum = 0;
    for (int i = 0; i < f->s.scene.volume_count; ++i) {
        const sps_volume *volume = &f->s.volume[i];
        double value = 1, offset[3];
        vec_along(point, volume->placement.origin, -1, offset);
        for (int k = 0; k < 3; ++k) {
            const double *axis = volume->placement.axis[k], n = volume->size[k];
            const double at = vec_dot(offset, axis) / vec_dot(axis, axis) * n;
            value *= face_at(fmin(at, n - at));
        }
        sum += volume->transfer ? transfer_at(volume->transfer, value) : value * (double)volume->extinction;
    }
    return sum;
}

/* Along a ray to a point by the midpoint rule, in steps of 0.02; all gas is within 5 of the origin. */
static double exact_boxes(const fixture *f, const ray *r, double end) {
    const double middle = -vec_dot(r->origin, r->direction), low = fmax(middle - 5, r->from);
    const double high = fmin(middle + 5, end);
    const int steps = (int)ceil((high - low) / 0.02);
    double sum = 0;
    for (int i = 0; i < steps; ++i) {
        double point[3];
        vec_along(r->origin, r->direction, low + (i + 0.5) * (high - low) / steps, point);
        sum += boxes_at(f, point) * (high - low) / steps;
    }
    return sum;
}

typedef struct box_case {
    int way;
    double slab; /* voxels */
    double angle;
    int classified, second;
} box_case;

static void check_boxes(const fixture *f, const sps_tmap *map, double slab, double slope, double density) {
    check_random random = {31};
    for (int i = 0; i < 250; ++i) {
        const int side = f->light.width, middle = side / 2;
        const int x = middle + (int)(side * 0.35 * (check_next(&random) - 0.5));
        const int y = middle + (int)(side * 0.35 * (check_next(&random) - 0.5));
        const double t = 4 + 12 * check_next(&random);
        double point[3], exact, whole;
        ray r;
        on_ray(map, 0, x, y, t, point);
        ray_to(f, point, &r);
        exact = exact_boxes(f, &r, t * r.length);
        whole = exact_boxes(f, &r, HUGE_VAL);
        /* straight lines between slabs: of a curve with such a slope, or of any that rises no faster than `density` */
        if (!CHECK_NEAR(query_at(map, point), exact,
                        RIPPLE * whole + r.length * fmin(slab * slab / 8 * slope, slab / 4 * density) + 1e-5))
            printf("    way %d slab %g texel %d %d t %g whole %g\n",
                   f->light.camera.world_to_clip ? 2 : f->settings.cubic, slab, x, y, t, whole);
    }
}

/* Uniform boxes, one and two that overlap, classified ones, upright and rotated, seen by every light, in slabs from a
   quarter of a voxel to one that contains everything. A box's density rises no faster than a Gaussian of 0.65 voxels at
   its faces, once for each face that a ray meets at one point: two if it is rotated. */
static void test_boxes(void) {
    static const sps_transfer_point points[3] = {
        {0.2f, {0, 0, 0}, 0, {0, 0, 0}}, {0.7f, {0, 0, 0}, 1, {0, 0, 0}}, {1.2f, {0, 0, 0}, 1.2f, {0, 0, 0}}};
    static const box_case cases[] = {
        {ORTHO, 0.25, 0, 0, 0},      {ORTHO, 1, 0, 0, 0},         {ORTHO, 2, 0, 0, 0},
        {ORTHO, 4, 0, 0, 0},         {ORTHO, 1000, 0, 0, 0},      {ORTHO, 0.5, 0.5, 0, 0},
        {SPOT, 0.5, 0, 0, 0},        {SPOT, 0.5, 0.4, 0, 0},      {ORTHO_TURNED, 0.5, 0, 0, 0},
        {SPOT_TURNED, 0.5, 0, 0, 0}, {ORTHO_MATRIX, 1, 0, 0, 0},  {SPOT_MATRIX, 1, 0, 0, 0},
        {ORTHO, 0.5, 0.3, 0, 1},     {SPOT_TURNED, 0.5, 0, 0, 1}, {ORTHO, 0.4, 0, 1, 0},
        {SPOT, 0.4, 0.3, 1, 0},      {ORTHO, 0.4, 0, 1, 1}};
    sps_context *context = sps_create(NULL, NULL);
    for (size_t n = 0; n < sizeof cases / sizeof *cases; n += check_memory_only() ? 3 : 1) {
        const box_case *c = &cases[n];
        const double edge = 0.25, slab = fmin(c->slab * edge, 12), steepest = 2 / (sqrt(2 * PI) * 0.65 * edge);
        sps_transfer transfer;
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_DEEP);
        memset(&transfer, 0, sizeof transfer);
        transfer.points = points, transfer.point_count = 3;
        see(&f, c->way, 54);
        f.settings.near_depth = 2;
        f.light.quality = SPS_QUALITY_HIGH;
        f.light.slab_thickness = c->slab;
        if (c->classified)
            add_box(&f, 20, 2.5, c->angle, 0)->transfer = &transfer;
        else
            add_box(&f, 20, 2.5, c->angle, 0.8);
        if (c->second) add_box(&f, 12, 1.5, 0.7, 0.5);
        map = must_build(&f, context);
        {
            const int failed = check_failed;
            if (map) check_boxes(&f, map, slab, steepest * (c->classified ? 2 : 0.8 + 0.5 * c->second), 1.3);
            if (check_failed > failed) printf("    case %d\n", (int)n);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* A box of voxels that are about as fine as texels, and fill the map: every texel has the optical depth of its ray. */
static void test_fine_voxels(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int spot = 0; spot < 2; ++spot) {
        enum { MANY = 80 };
        fixture f;
        sps_volume *volume;
        sps_tmap *map;
        begin(&f, SPS_TMAP_OPACITY);
        see(&f, spot ? SPOT : ORTHO, MANY);
        f.light.quality = SPS_QUALITY_HIGH;
        volume = add_box(&f, MANY, 8, 0, 0.1);
        volume->size[2] = 4;
        volume->placement.axis[2][2] = 8, volume->placement.origin[2] = -4;
        map = must_build(&f, context);
        for (int i = 0; i < MANY * MANY && map; ++i) {
            double point[3];
            on_ray(map, 0, i % MANY, i / MANY, 20, point);
            {
                const double dx = spot ? point[0] / 20 : 0, dy = spot ? point[1] / 20 : 0;
                const double exact = 0.8 * sqrt(1 + dx * dx + dy * dy);
                if (!CHECK_NEAR(query_at(map, point), exact, RIPPLE * exact))
                    printf("    texel %d %d\n", i % MANY, i / MANY);
            }
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* The maximum sum of kernels from beyond a cut, in standard deviations, at any position between voxels. */
static double beyond_cut(double cut) {
    double most = 0;
    for (int place = 0; place < 17 * 17; ++place) {
        double sum = 0;
        for (int i = 0; i < 13 * 13; ++i) {
            const double dx = i % 13 - 6 - place % 17 / 16.0, dy = i / 13 - 6 - place / 17 / 16.0;
            const double square = (dx * dx + dy * dy) / (0.65 * 0.65);
            sum += square > cut * cut ? exp(-0.5 * square) / (2 * PI * 0.65 * 0.65) : 0;
        }
        most = fmax(most, sum);
    }
    return most;
}

/* A box of voxels from an array in a map of one component, which has the total depth of its gas. */
static sps_volume *begin_voxels(fixture *f, check_array *array, int quality) {
    sps_volume *volume;
    begin(f, SPS_TMAP_OPACITY);
    f->settings.components = 1;
    f->light.quality = (sps_quality)quality;
    volume = add_box(f, array->size[0], array->size[0] / 2.0, 0, 1);
    volume->read_fn = check_read_array, volume->user = array;
    return volume;
}

/* "Exact" maps of volumes are as exact as their kernels: quality cuts these where a footprint has lost the share
   e = exp(-cut^2 / 2) of its mass, and rescales the rest to compensate. So a ray loses what comes from beyond the cut,
   at most the sum of such kernels times the fullest column of voxels, and gains e of its own: the map and the field
   f(p) are no farther apart, except for 4e-4, the error of the closed form of kernels. A checkered gas, and isolated
   voxels, are the most uneven cases. */
static void test_cut_kernels(void) {
    enum { VOXELS = 12 };
    static const double cuts[5] = {3.3, 2.8, 3.3, 2.5 / 0.65, 2.5 / 0.65};
    static float values[VOXELS * VOXELS * VOXELS];
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 8; ++n) {
        const int quality = 1 + n % 4;
        const double raised = expm1(0.5 * cuts[quality] * cuts[quality]), beyond = beyond_cut(cuts[quality]);
        double column[VOXELS * VOXELS] = {0}, fullest = 0;
        check_random random = {99};
        check_array array = {values, {VOXELS, VOXELS, VOXELS}, 0, 0};
        fixture f;
        sps_tmap *map;
        begin_voxels(&f, &array, quality);
        for (int i = 0; i < VOXELS * VOXELS * VOXELS; ++i) {
            const int chequer = i % VOXELS / 2 + i / VOXELS % VOXELS / 2;
            values[i] = n < 4 ? (chequer % 2 ? 8.0f : 0.0f) : check_next(&random) < 0.02 ? 8.0f : 0;
            column[i % (VOXELS * VOXELS)] += (double)values[i];
        }
        for (int i = 0; i < VOXELS * VOXELS; ++i) fullest = fmax(fullest, column[i]);
        map = must_build(&f, context);
        for (int texel = 0; texel < SIDE * SIDE && map; ++texel) {
            const double x = texel % SIDE - 4, y = 4 - texel / SIDE;
            double exact = 0;
            for (int i = 0; i < VOXELS * VOXELS; ++i) {
                const double dx = i % VOXELS - 5.5 - x, dy = i / VOXELS - 5.5 - y;
                exact += column[i] * exp(-0.5 * (dx * dx + dy * dy) / (0.65 * 0.65)) / (2 * PI * 0.65 * 0.65);
            }
            if (!CHECK_CASE("Found in review", "volumes in exact maps, at each quality", "the sum of uncut kernels",
                            fabs((double)sps_tmap_texels(map)[texel] - exact),
                            beyond * fullest + (1 / raised + 4e-4) * exact,
                            "what the quality's cut leaves out of the fullest column"))
                printf("    quality %d\n", quality);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* Maps cut the kernels of classified volumes where they cut those of a gas, not where a light's sheets do: a voxel
   contributes to a ray 2.12 voxels away at medium, whose kernels end at 2.15, but not at draft, where they end at
   1.82. A texel has the kernel's integral along its ray, 0.21 or 0.0018, or nothing. Half of that decides between the
   two: the sum over a classified slab's parts is not exact. */
static void test_classified_kernels(void) {
    const sps_transfer_point points[2] = {{0, {1, 1, 1}, 0, {0, 0, 0}}, {1, {1, 1, 1}, 1, {0, 0, 0}}};
    const sps_transfer transfer = {points, 2, NULL, NULL, 0};
    static float values[10 * 10 * 10];
    sps_context *context = sps_create(NULL, NULL);
    for (int quality = SPS_QUALITY_DRAFT; quality <= SPS_QUALITY_MEDIUM; ++quality) {
        check_array array = {values, {10, 10, 10}, 0, 0};
        fixture f;
        sps_tmap *map;
        values[555] = 1;
        begin_voxels(&f, &array, quality)->transfer = &transfer;
        map = must_build(&f, context);
        if (!map) return;
        for (int i = 0; i < 2; ++i) { /* the texels at (0,0) and (2,2) */
            const double square = i ? 4.5 : 0.5, kernel = exp(-0.5 * square / (0.65 * 0.65)) / (2 * PI * 0.65 * 0.65);
            const int is_cut = i && quality == SPS_QUALITY_DRAFT;
            CHECK_NEAR((double)sps_tmap_texels(map)[i ? 2 * SIDE + 6 : 4 * SIDE + 4], is_cut ? 0 : kernel,
                       0.5 * kernel);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* A Gaussian of variance 1, sampled at voxels of 0.25 and convolved with kernels, is one of variance 1 + 0.65^2 / 16
   and the same mass; its integral along any ray is an error function. Errors: interpolation between slabs, by the
   density's steepest slope, e^-1/2; and the box's end at 4 standard deviations, beyond which 4e-4 is left. */
static void test_blob(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int way = 0; way < ROUND; ++way) {
        const double variance = 1 + 0.65 * 0.65 / 16, deviation = sqrt(variance), slab = 0.125;
        check_random random = {8};
        fixture f;
        sps_tmap *map;
        sps_volume *volume;
        begin(&f, SPS_TMAP_DEEP);
        see(&f, way, 54);
        f.light.quality = SPS_QUALITY_HIGH;
        volume = add_box(&f, 32, 4, way % 2 ? 0.6 : 0, 1);
        f.field.value_fn = blob;
        f.field.user = &f;
        volume->read_fn = NULL, volume->eval_fn = check_eval_field, volume->user = &f.field;
        map = must_build(&f, context);
        for (int i = 0; i < 400 && map; ++i) {
            double point[3], along, square, exact;
            ray r;
            on_ray(map, 0, (int)(54 * check_next(&random)), (int)(54 * check_next(&random)),
                   5 + 10 * check_next(&random), point);
            ray_to(&f, point, &r);
            along = -vec_dot(r.origin, r.direction);
            square = vec_dot(r.origin, r.origin) - along * along;
            exact = sqrt(2 * PI) / variance * exp(-0.5 * square / variance);
            CHECK_NEAR(query_at(map, point), exact * normal_share((r.t * r.length - along) / deviation),
                       RIPPLE * exact + 4e-4 + slab * slab / 8 * exp(-0.5) * r.length);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* --------------------------------------------------------------------------------------------------------- polygons */

/* Opaque surfaces in every technique: nothing before, everything behind, beginning at the bias, which is two texels'
   width by default; a fraction if only some of the four texels are covered. */
static void test_opaque(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4 * (TECHNIQUES + 1); ++n) {
        const int given = n % 2, spot = n / 2 % 2;
        const double bias = given ? 0.01 : spot ? 2.5 : 2; /* t - 10 = 2 t / 10 at 12.5 */
        fixture f;
        sps_tmap *map;
        begin(&f, n < 4 * TECHNIQUES ? 1 + n / 4 : SPS_TMAP_DEPTH);
        see(&f, spot ? SPOT : ORTHO, SIDE);
        if (given) f.settings.surface_bias = bias;
        if (given) add_square(&f, 0, -30, -0.5, 30, -6); /* behind the first surface, which counts */
        add_square(&f, 0, -30, -0.5, 30, 0);
        if (!given) add_square(&f, 0, -30, -0.5, 30, -6);
        add_mesh(&f, 0, 0);
        map = must_build(&f, context);
        if (map) {
            const double behind = spot ? 1.5 : 1; /* the position of diverged rays at z = -5 */
            CHECK_NEAR(query(map, -1, 0, 1e-3), 0, 0);
            CHECK_NEAR(query(map, -1, 0, -0.99 * bias), 0, 1e-15); /* the logarithm of a sum of weights */
            CHECK_NEAR(query(map, -1.5, 0, -1.01 * bias), DARK, 0);
            CHECK_NEAR(through(map, -1.5, 0, -1.01 * bias), 0, 0);
            CHECK_NEAR(query(map, spot ? -31 : -2, 0, -300), DARK, 0);
            CHECK_NEAR(query(map, -0.25 * behind, 0, -5), -log(0.75), 1e-6);
            CHECK_NEAR(through(map, -0.25 * behind, 0, -5), 0.75, 1e-6);
            CHECK_NEAR(query(map, 0.001, 0, -9), 0, 1e-15);
            CHECK(sps_tmap_surfaces(map) && sps_tmap_surfaces(map)[3] < 0.51f && sps_tmap_surfaces(map)[4] > 1);
        }
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* A depth map holds a float per texel, the first opaque surface, and no gas: what lies between light and surface, gas
   or a sheet that lets light pass, does not count. Without opaque surfaces it holds nothing. */
static void test_depth_maps(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int opaque = 0; opaque < 2; ++opaque) {
        fixture f;
        sps_tmap *map;
        sps_tmap_info info;
        size_t empty;
        begin(&f, SPS_TMAP_DEPTH);
        map = must_build(&f, context);
        empty = check_bytes_of(map);
        sps_tmap_destroy(map);
        f.settings.surface_bias = 0.01;
        add(&f, 0, 0, 0, 3, 1, 5);
        add(&f, 1, 0, 0, 3, 1, 5);
        add_square(&f, 0, -30, 30, 30, 1);
        add_mesh(&f, 0, 0.3);
        add_square(&f, 1, -30, 30, 30, 0);
        add_mesh(&f, 1, opaque ? 0 : 0.7);
        map = must_build(&f, context);
        CHECK_NEAR(query(map, 0, 0, 0.1), 0, 1e-15); /* the logarithm of a sum of weights */
        CHECK_NEAR(query(map, 0, 0, -0.1), opaque ? DARK : 0, 0);
        CHECK(sps_tmap_get_info(map, &info) == SPS_OK && info.item_floats == 0 && info.float_count == 0);
        CHECK(check_bytes_of(map) == empty + (opaque ? sizeof(float) * SIDE * SIDE : 0));
        CHECK(!sps_tmap_surfaces(map) == !opaque);
        for (int i = 0; i < SIDE * SIDE && opaque; ++i) CHECK_NEAR((double)sps_tmap_surfaces(map)[i], 0.5, 1e-7);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* A compressed map of a number of nodes has at most so many in each texel, and no bracket: 0 .. the darkest. */
static void test_few_nodes(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int most = 2; most <= 32; most *= 4) {
        fixture f;
        sps_tmap *map;
        int full = 0;
        begin(&f, SPS_TMAP_COMPRESSED);
        scatter(&f, 0, 60, 3, 61);
        scatter(&f, 1, 60, 3, 62);
        f.settings.components = 2 * most;
        map = must_build(&f, context);
        for (int i = 0; i < SIDE * SIDE && map; ++i) {
            const int nodes = (int)(sps_tmap_starts(map)[i + 1] - sps_tmap_starts(map)[i]);
            CHECK(nodes <= most);
            full += nodes == most;
        }
        if (most < 32) CHECK(full > 5);
        for (int i = 0; i < 50 && map; ++i) {
            const double at[3] = {-2 + 0.08 * i, 0.5, -9};
            float least = 7, high = 7;
            CHECK(sps_tmap_bounds(map, 1, at, &least, &high) == SPS_OK);
            CHECK_NEAR((double)least, 0, 0);
            CHECK_NEAR((double)high / DARK, 1, 1e-6);
        }
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* If texels are not square, the bias is that of their longer side. */
static void test_bias_of_oblong_texels(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4; ++n) {
        const int spot = n / 2;
        const double bias = spot ? 15 : 6; /* two texels of 3; of a spot 0.3 t: t - 10 = 2 * 0.3 t */
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_DEEP);
        see(&f, spot ? SPOT_MATRIX : ORTHO_MATRIX, SIDE);
        f.matrix[n % 2 ? 0 : 5] /= 3;
        add_square(&f, 0, -90, 90, 90, 0);
        add_mesh(&f, 0, 0);
        map = must_build(&f, context);
        CHECK_NEAR(query(map, 0, 0, -0.99 * bias), 0, 1e-15);
        CHECK_NEAR(query(map, 0, 0, -1.01 * bias), DARK, 0);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* Polygons behind a light in perspective shade nothing in front of it, and those that extend from behind it to its
   front shade by the part in front. */
static void test_behind_the_light(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4; ++n) {
        const double across[3] = {0, 60, 0}, along[3] = {0, 0, 40}, corner[3] = {-2.5, -30, -5};
        const int opaque = n % 2;
        const double left = opaque ? 0 : 0.5;
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_DEEP);
        see(&f, n / 2 ? SPOT_MATRIX : SPOT, SIDE);
        f.settings.surface_bias = 0.01;
        add_square(&f, 0, -30, 30, 30, 10.5);
        add_square(&f, 0, -30, 30, 30, 14);
        check_add_quad(&f.triangles[0], corner, across, along);
        add_mesh(&f, 0, opaque ? 0 : 0.5);
        map = must_build(&f, context);
        for (int i = 0; i < SIDE * SIDE && map; ++i) { /* a ray meets the upright square where x = -2.5 */
            const int x = i % SIDE;
            const double t = 8 + i % 7, at = 10 * 2.5 / (SIDE / 2 - x), shaded = x < SIDE / 2 && at < 15;
            double point[3];
            float passes;
            on_ray(map, 0, x, i / SIDE, t, point);
            sps_tmap_query(map, 1, point, NULL, &passes);
            if (!shaded || fabs(t - at) > 0.1) CHECK_NEAR((double)passes, shaded && t > at ? left : 1, 1e-7);
        }
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* Surfaces before near_depth count at it, and those just before far_depth shade points behind that; so do translucent
   ones. */
static void test_surfaces_at_the_ends(void) {
    sps_context *context = sps_create(NULL, NULL);
    { /* without a surface, nothing shades at any depth */
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_OPACITY);
        f.settings.near_depth = 5, f.settings.far_depth = 6;
        add_square(&f, 0, -4, -2, 2, 4.5);
        add_mesh(&f, 0, 0);
        map = must_build(&f, context);
        CHECK_NEAR(query(map, 3, 0, 2.5), 0, 0);
        CHECK_NEAR(query(map, 3, 0, -1e6), 0, 0);
        sps_tmap_destroy(map);
        end(&f);
    }
    for (int spot = 0; spot < 2; ++spot)
        for (int opaque = 0; opaque < 2; ++opaque) {
            const double dark = opaque ? DARK : log(2.0);
            fixture f;
            sps_tmap *map;
            begin(&f, SPS_TMAP_DEEP);
            see(&f, spot ? SPOT : ORTHO, SIDE);
            f.settings.near_depth = 5, f.settings.far_depth = 15.5;
            f.settings.surface_bias = 1;
            add_square(&f, 0, -30, 0, 30, 8);
            add_square(&f, 0, 0, 30, 30, -5);
            add_mesh(&f, 0, opaque ? 0 : 0.5);
            map = must_build(&f, context);
            CHECK_NEAR(query(map, -1.5, 0, 5.5), 0, 0); /* before near_depth */
            CHECK_NEAR(query(map, -1.5, 0, 3.9), dark, 1e-7);
            CHECK_NEAR(query(map, -4, 0, -50), dark, 1e-7);
            CHECK_NEAR(query(map, 2, 0, -4.9), 0, 0);
            CHECK_NEAR(query(map, 2, 0, -5.4), opaque ? 0 : dark, 1e-7);
            CHECK_NEAR(query(map, 2, 0, -5.9), opaque ? 0 : dark, 1e-7); /* within the bias, behind far_depth */
            CHECK_NEAR(query(map, 2, 0, -6.1), dark, 1e-7);
            CHECK_NEAR(query(map, 3, 0, -50), dark, 1e-7);
            sps_tmap_destroy(map);
            end(&f);
        }
    sps_destroy(context);
}

/* A sheet of transmittance 1/2 has T = 1/2, two of 1/4 a sixteenth, one of 1 no shadow: exactly at any point for lists,
   at planes for opacity maps, and behind everything for all techniques that are exact there. -log T is a float. */
static void test_translucent(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique)
        for (int n = 0; n < 3; ++n) {
            static const double transmittance[3] = {0.5, 0.25, 1}, passes[3] = {0.5, 0.0625, 1};
            const double t = passes[n];
            fixture f;
            sps_tmap *map;
            begin(&f, technique);
            if (technique == SPS_TMAP_OPACITY) f.settings.components = 4;
            f.settings.epsilon = 1e-6f;
            add_square(&f, 0, -30, 30, 30, 0);
            if (n == 1) add_square(&f, 0, -30, 30, 30, 0);
            add_mesh(&f, 0, transmittance[n]);
            map = must_build(&f, context);
            CHECK(sps_tmap_surfaces(map) == NULL);
            CHECK_NEAR(query(map, 0, 0, 9), 0, n == 2 ? 1e-15 : 0.1); /* series ring by 9 % of it */
            CHECK_NEAR(through(map, 1, 0.5, -10), t, 2e-6 * t);
            CHECK_NEAR(query(map, 1, 0.5, -10), -log(t), 2e-6);
            if (technique <= SPS_TMAP_COMPRESSED || technique == SPS_TMAP_OPACITY ||
                technique == SPS_TMAP_DEEP_OPACITY) {
                CHECK_NEAR(through(map, 1, 0.5, 0), t, 2e-6 * t); /* at the sheet itself: u = 1/2 is a plane, too */
                CHECK_NEAR(query(map, 1, 0.5, 5), 0, 0);
            }
            if (n == 2 && technique <= SPS_TMAP_COMPRESSED) CHECK(sps_tmap_starts(map)[SIDE * SIDE] == 0);
            sps_tmap_destroy(map);
            end(&f);
        }
    sps_destroy(context);
}

/* A sheet in the plane t = 2 + 2 x, which crosses the light's own: the ray whose x is X t meets it at t = 2 / (1 - 2
   X). Corners lie on both sides of the light, one far behind it. */
static void test_across_the_light(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4; ++n) {
        const double corner[3] = {-20, -25, 10 + 38}, u[3] = {40, 0, -80}, v[3] = {0, 50, 0}; /* z = 8 - 2 x */
        const int opaque = n % 2, round = n / 2;
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_DEEP);
        see(&f, round ? ROUND : SPOT, SIDE);
        check_set3(f.light.camera.position, 0, 0, 10);
        f.settings.surface_bias = 1e-4;
        check_add_quad(&f.triangles[0], corner, u, v);
        add_mesh(&f, 0, opaque ? 0 : 0.5);
        map = must_build(&f, context);
        for (int i = 0; i < SIDE * SIDE && map && !round; ++i) {
            const double exact = 2 / (1 - 2 * (i % SIDE - 4) * 0.1) / 20; /* u */
            const uint32_t *starts = sps_tmap_starts(map);
            CHECK(starts[i + 1] - starts[i] == (opaque ? 0 : 1));
            CHECK_NEAR((double)(opaque ? sps_tmap_surfaces(map)[i] : sps_tmap_texels(map)[4 * starts[i]]), exact, U);
        }
        for (int i = 0; i < 800 && map; ++i) { /* the shadow begins at the sheet, in directions all around the light */
            double point[3], t;
            on_ray(map, round ? i % 6 : 0, i / 6 % SIDE, i / 54 % SIDE, 18.0 * (i % 97 + 1) / 97, point);
            t = 10 - point[2] - 2 * point[0];
            if (fabs(t - 2) > 0.001)
                CHECK_NEAR(through(map, point[0], point[1], point[2]), t < 2 ? 1 : opaque ? 0 : 0.5, 1e-7);
        }
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* A net of triangles with shared corners, some of which lie exactly at the centres of texels. */
static void add_net(fixture *f, const double origin[3], const double u[3], const double v[3], int n, double jitter) {
    check_random random = {77};
    double point[20][20][3], normal[3];
    vec_cross(u, v, normal);
    for (int j = 0; j <= n; ++j)
        for (int i = 0; i <= n; ++i) {
            const int inner = i > 0 && j > 0 && i < n && j < n;
            const double rise = inner ? jitter * check_next(&random) : 0, slide = inner && (i + j) % 2 ? jitter : 0;
            for (int k = 0; k < 3; ++k)
                point[j][i][k] = origin[k] + (i + slide * 0.7) / n * u[k] + (j - slide * 0.3) / n * v[k] +
                                 rise * normal[k] / vec_length(normal);
        }
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
            check_add_corners(&f->triangles[0], point[j][i], point[j][i + 1], point[j + 1][i + 1]);
            if (i % 2)
                check_add_corners(&f->triangles[0], point[j][i], point[j + 1][i + 1], point[j + 1][i]);
            else
                check_add_corners(&f->triangles[0], point[j + 1][i], point[j][i], point[j + 1][i + 1]);
        }
}

/* Every ray meets a closed net once, even exactly through edges and corners; triangles without area have no effect. */
static void test_watertight(void) {
    static const double nowhere[2][3] = {{-1, -1, 1}, {3, 2, 1}};
    sps_context *context = sps_create(NULL, NULL);
    for (int way = 0; way < WAYS; ++way)
        for (int jitter = 0; jitter < 2; ++jitter) {
            fixture f;
            sps_tmap *map;
            begin(&f, SPS_TMAP_DEEP);
            see(&f, way, way == ROUND ? 17 : 67);
            if (way == ROUND) {
                check_set3(f.light.camera.position, 0, 0, 0);
                for (int face = 0; face < 6; ++face) { /* a cube whose edges are the rays that faces share */
                    double origin[3] = {0, 0, 0}, u[3] = {0, 0, 0}, v[3] = {0, 0, 0};
                    origin[face / 2] = face % 2 ? -4 : 4;
                    origin[(face / 2 + 1) % 3] = origin[(face / 2 + 2) % 3] = -4;
                    u[(face / 2 + 1) % 3] = v[(face / 2 + 2) % 3] = 8;
                    add_net(&f, origin, u, v, 8, jitter * 0.25);
                }
            } else {
                const double w = way == SPOT_TURNED ? 120 : 18;
                const double origin[3] = {-w / 2, -w / 2, 0}, u[3] = {w, 0, 0}, v[3] = {0, w, 0};
                add_net(&f, origin, u, v, 18, jitter * 0.3);
            }
            for (int i = 0; i < 3; ++i) check_add_corners(&f.triangles[0], nowhere[0], nowhere[0], nowhere[1]);
            add_mesh(&f, 0, 0.5);
            map = must_build(&f, context);
            for (int i = 0; map && i < f.light.width * f.light.height * map->grid.face_count; ++i)
                if (!CHECK(sps_tmap_starts(map)[i + 1] - sps_tmap_starts(map)[i] == 1))
                    printf("    way %d texel %d jitter %d\n", way, i, jitter);
            sps_tmap_destroy(map);
            end(&f);
        }
    sps_destroy(context);
}

/* ------------------------------------------------------------------------------------- all of it in every technique */

/* Properties of each technique: T = exp(-depth), no depth below 0, and its bracket contains its own result and the deep
   map's. Sums of the 25 intervals that a ray meets, and of the planes, are floats: 1e-5 of the depth; so is u: the
   densest gas here, a particle of 0.4 across 3.4, has at most 5 per u, and no query comes near the sheet, which might
   count as before or behind. A compressed map's T is within epsilon of the deep map's. */
static void check_technique(const sps_tmap *map, const sps_tmap *deep, float epsilon) {
    const int technique = (int)map->settings.technique;
    int bracketed = 0;
    for (int i = 0; i < 21 * 17 * 24; i += technique == SPS_TMAP_MOMENT ? 5 : 1) {
        double point[3];
        float depth, passes, least, most, exact, exact_passes;
        on_ray(map, 0, i % 21, i / 21 % 17, 20 * ((i / 21 / 17) + 0.37) / 24, point);
        sps_tmap_query(map, 1, point, &depth, &passes);
        sps_tmap_query(deep, 1, point, &exact, &exact_passes);
        sps_tmap_bounds(map, 1, point, &least, &most);
        const double slack = 1e-5 * (1 + fabs((double)exact)) + 10 * U;
        if (!CHECK(depth >= 0 && depth <= 1e15f && passes >= 0 && passes <= 1)) printf("    technique %d\n", technique);
        CHECK_NEAR((double)passes, exp(-(double)depth), 2e-6 * (double)passes + 1e-37);
        CHECK((double)least <= (double)depth + slack && (double)depth <= (double)most + slack);
        if (!CHECK_CASE("Shadows", "brackets of every kind of map against exact columns", "contain the exact depth",
                        fmax((double)least - (double)exact, (double)exact - (double)most), slack,
                        "sums of 25 intervals in floats, 1e-5; u"))
            printf("    technique %d: %g .. %g, exact %g\n", technique, (double)least, (double)most, (double)exact);
        if (technique == SPS_TMAP_DEEP) CHECK(least >= depth && most <= depth);
        if (technique == SPS_TMAP_COMPRESSED)
            CHECK_CASE("Shadows", "compressed map against exact columns", "transmittance",
                       fabs((double)passes - (double)exact_passes), (double)epsilon + 2e-7,
                       "epsilon, as promised; floats");
        bracketed += most < 1e14f && most > least;
    }
    if (technique == SPS_TMAP_OPACITY || technique == SPS_TMAP_DEEP_OPACITY || technique == SPS_TMAP_MOMENT)
        CHECK(bracketed > 500);
}

static void test_techniques(void) {
    static const float epsilons[3] = {0.1f, 0, 0.0005f};
    sps_context *context = sps_create(NULL, NULL);
    for (int way = ORTHO; way <= SPOT; ++way)
        for (int n = 0; n < TECHNIQUES + 5; ++n) {
            const int technique = n < TECHNIQUES       ? 1 + n
                                  : n < TECHNIQUES + 2 ? SPS_TMAP_COMPRESSED
                                                       : n - TECHNIQUES + 2;
            const float epsilon =
                technique == SPS_TMAP_COMPRESSED ? epsilons[n < TECHNIQUES ? 1 : 2 * (n - TECHNIQUES)] : 0;
            fixture f;
            sps_tmap *deep, *map;
            begin_mixed(&f, SPS_TMAP_DEEP);
            see(&f, way, 21);
            f.light.height = 17;
            deep = must_build(&f, context);
            f.settings.technique = (sps_tmap_technique)technique;
            f.settings.epsilon = epsilon;
            if (n >= TECHNIQUES + 2) f.settings.cubic = f.settings.texel_range = 1;
            map = must_build(&f, context);
            if (map && deep) check_technique(map, deep, epsilon > 0 ? epsilon : 0.01f);
            sps_tmap_destroy(map);
            sps_tmap_destroy(deep);
            end(&f);
        }
    sps_destroy(context);
}

/* Soft particles are curves, which the polyline approximates within epsilon, too, thin or thick, alone or one inside
   another; 0.001 is the minimum promised for these, with a bracket that contains the true value for any epsilon, and is
   no wider than epsilon on either side. */
static void test_soft_compressed(void) {
    static const double depths[5] = {0.05, 0.8, 6, 50, 3000};
    static const float epsilons[4] = {0.2f, 0, 0.001f, 1e-8f};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 40; ++n) {
        const double epsilon = n / 5 % 4 == 1 ? 0.01 : fmax((double)epsilons[n / 5 % 4], 0.001);
        fixture f;
        sps_tmap *deep, *map;
        begin(&f, SPS_TMAP_DEEP);
        add(&f, 1, 0, 0, 0, 6, depths[n % 5]);
        for (int i = 0; i < 6 && n >= 20; ++i) add(&f, 1, 0.2 * i, 0.1 * i, i, 2 + 0.3 * i, depths[(n + i) % 5]);
        deep = must_build(&f, context);
        f.settings.technique = SPS_TMAP_COMPRESSED;
        f.settings.epsilon = epsilons[n / 5 % 4];
        map = must_build(&f, context);
        for (int i = 0; i < 700 && map && deep; ++i) {
            const double point[3] = {i % 7 - 3.0, i % 3 * 1.0, 9 - 18.0 * i / 700};
            const double exact = through(deep, point[0], point[1], point[2]);
            float least, most;
            sps_tmap_bounds(map, 1, point, &least, &most);
            if (!CHECK_NEAR(through(map, point[0], point[1], point[2]), exact, epsilon + 2e-7))
                printf("    epsilon %g\n", epsilon);
            if (!CHECK(exact <= exp(-(double)least) + 2e-7 && exact >= exp(-(double)most) - 2e-7) ||
                !CHECK(exp(-(double)least) - exp(-(double)most) <= 2 * epsilon + 4e-7))
                printf("    epsilon %g\n", (double)f.settings.epsilon);
        }
        sps_tmap_destroy(map);
        sps_tmap_destroy(deep);
    }
    sps_destroy(context);
}

/* Gas, voxels and panes before near_depth count there in full, in every technique, as a map from depth 0 tells; lists
   hold them at u = 0, the others in fronts. Just behind near_depth, and behind all: sums of 60 intervals as floats,
   4e-6 of the total of at most 10; a point 1e-6 of 10 behind near_depth passes 1e-5 of an extinction of at most 2. A
   compressed map's T is off by epsilon, and moments tell nothing but bounds there. */
static void test_before_near(void) {
    static const int ways[3] = {ORTHO_TURNED, SPOT, ROUND};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 3 * TECHNIQUES; ++n) {
        const int way = ways[n % 3], technique = SPS_TMAP_DEEP + n / 3;
        const double near_depth = way == ROUND ? 1.2 : 8.3;
        fixture f;
        double most = 0;
        begin_mixed(&f, SPS_TMAP_DEEP);
        see(&f, way, SIDE);
        add_square(&f, 0, -30, 30, 30, way == ROUND ? 0.4 : 3.5); /* a pane before near_depth */
        sps_tmap *whole = must_build(&f, context);
        f.settings.technique = (sps_tmap_technique)technique, f.settings.near_depth = near_depth;
        f.settings.epsilon = 1e-4f, f.settings.texel_range = n % 2;
        sps_tmap *map = must_build(&f, context);
        CHECK(!map || !sps_tmap_fronts(map) == (technique <= SPS_TMAP_COMPRESSED));
        for (int i = 0; i < SIDE * SIDE * 3 && map && whole; ++i) {
            const double t = i / (SIDE * SIDE) ? i / (SIDE * SIDE) == 1 ? 12 : 21 : near_depth + 1e-6 * 10;
            double point[3], exact, wrong;
            float least, most_there;
            on_ray(map, way == ROUND ? i % 6 : 0, i % SIDE, i / SIDE % SIDE, t, point);
            exact = query_at(whole, point);
            sps_tmap_bounds(map, 1, point, &least, &most_there);
            CHECK((double)least <= exact + 1e-4 && (double)most_there >= exact - 1e-4);
            if (t == 12 || (t < 12 && technique == SPS_TMAP_MOMENT)) continue;
            wrong = technique == SPS_TMAP_COMPRESSED ? fabs(exp(-query_at(map, point)) - exp(-exact))
                                                     : fabs(query_at(map, point) - exact);
            most = fmax(most, exact < DARK ? wrong : 0);
        }
        CHECK_CASE("Found in review", "gas and panes before near_depth", "optical depth there and behind all", most,
                   1.5e-4, "floats, and the length between; compressed: epsilon");
        sps_tmap_destroy(map);
        sps_tmap_destroy(whole);
        end(&f);
    }
    sps_destroy(context);
}

/* Voxels, a particle and a pane, each alone and reaching 0.1 before near_depth or not: there are fronts only if
   something lies there. Of a box of extinction 2, 0.1 and up to half a blurred voxel lie there: 0.2 to 0.7. A particle
   of 3 has a fortieth of its diameter there. */
static void test_fronts_alone(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 6; ++n) {
        const int before = n % 2;
        fixture f;
        begin(&f, SPS_TMAP_DEEP_OPACITY);
        f.settings.near_depth = before ? 8.1 : 7;
        if (n / 2 == 0) add_box(&f, 8, 2, 0, 2);
        if (n / 2 == 1) add(&f, 0, 0, 0, 0, 2, 3);
        if (n / 2 == 2) add_square(&f, 0, -30, 30, 30, 2), add_mesh(&f, 0, 0.5);
        sps_tmap *map = must_build(&f, context);
        const float *fronts = sps_tmap_fronts(map);
        CHECK(!fronts == !before);
        if (fronts && n / 2 == 0) CHECK(fronts[SIDE * SIDE / 2] > 0.2f && fronts[SIDE * SIDE / 2] < 0.7f);
        if (fronts && n / 2 == 1) CHECK_NEAR((double)fronts[SIDE * SIDE / 2], 3.0 / 40, 1e-5);
        if (fronts && n / 2 == 2) CHECK_NEAR((double)fronts[SIDE * SIDE / 2], log(2.0), 1e-6);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* Particles cut by near_depth, far_depth or the light, soft and uniform, thin and thick. */
static void begin_cut(fixture *f, int way, int technique, double depth) {
    begin(f, technique);
    see(f, way, SIDE);
    f->settings.near_depth = 0.5, f->settings.far_depth = 17;
    for (int soft = 0; soft < 2; ++soft) {
        add(f, soft, f->light.camera.position[0] + 0.7, f->light.camera.position[1] + 0.3,
            f->light.camera.position[2] - 0.4, 2, depth);
        add(f, soft, f->light.camera.position[0] - 1, f->light.camera.position[1], f->light.camera.position[2] - 1, 3.5,
            0.4 * depth);
        add(f, soft, f->light.camera.position[0], f->light.camera.position[1] - 1, f->light.camera.position[2] - 17, 4,
            depth);
        add(f, soft, 1, 1, 0, 2.2, 0.3 * depth);
    }
}

/* The deep map of such particles is exact (test_particles), so brackets and epsilon are compared with it. Sums of nine
   intervals are floats, and so is u: depths are accurate to 1e-6 of the total, at most 9.6, and where an interval may
   begin before or behind, to its depth within U of a range of 16.5, 1.5 U 16.5 / (2 0.75) of it. */
static void test_cut_particles(void) {
    static const int techniques[6] = {SPS_TMAP_COMPRESSED,   SPS_TMAP_COMPRESSED, SPS_TMAP_OPACITY,
                                      SPS_TMAP_DEEP_OPACITY, SPS_TMAP_MOMENT,     SPS_TMAP_MOMENT};
    static const int components[6] = {0, 0, 16, 16, 5, 7};
    static const int ways[3] = {ORTHO, SPOT, ROUND};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 3 * 3 * 6; ++n) {
        const double depth = n % 3 == 0 ? 0.3 : n % 3 == 1 ? 3 : 40;
        const int way = ways[n / 3 % 3], which = n / 9;
        fixture f;
        sps_tmap *deep, *map;
        begin_cut(&f, way, SPS_TMAP_DEEP, depth);
        deep = must_build(&f, context);
        f.settings.technique = (sps_tmap_technique)techniques[which];
        f.settings.components = components[which];
        f.settings.epsilon = which == 1 ? 0.001f : 0.01f;
        map = must_build(&f, context);
        for (int i = 0; i < SIDE * SIDE * 20 && map && deep; ++i) {
            const double slack = 9.6 * depth * (1e-6 + 17 * U);
            double point[3], exact;
            float least, most;
            on_ray(map, way == ROUND ? i % 6 : 0, i % SIDE, i / SIDE % SIDE,
                   0.5 + 16.5 * (i / (SIDE * SIDE) + 0.01) / 19, point);
            exact = query_at(deep, point);
            sps_tmap_bounds(map, 1, point, &least, &most);
            if (!CHECK_CASE("Found in review", "soft particles cut by near_depth, far_depth or the light",
                            "brackets contain the exact depth", fmax((double)least - exact, exact - (double)most),
                            slack, "sums of nine intervals in floats; u to its last place"))
                printf("    technique %d way %d depth %g: %g .. %g, exact %g\n", techniques[which], way, depth,
                       (double)least, (double)most, exact);
            if (techniques[which] == SPS_TMAP_COMPRESSED)
                CHECK_CASE("Found in review", "the same particles in a compressed map", "transmittance to epsilon",
                           fabs(through(map, point[0], point[1], point[2]) - exp(-exact)),
                           (double)f.settings.epsilon + 2e-7, "epsilon, as promised; floats");
        }
        sps_tmap_destroy(map);
        sps_tmap_destroy(deep);
    }
    sps_destroy(context);
}

/* Transmittance at points in two balls of gas and at one behind them, with a pane at z before or behind them unless it
 * passes everything. */
static void answers_with_pane(sps_context *context, int technique, int components, int range, double z, double passes,
                              float *out) {
    check_random random = {5};
    fixture f;
    begin(&f, technique);
    f.settings.components = components, f.settings.texel_range = range;
    f.settings.cubic = technique == SPS_TMAP_DEEP_OPACITY;
    add(&f, 0, 0, 0, 0, 4, 2);
    add(&f, 1, 1, 0, -1, 3, 1.5);
    if (passes < 1) add_square(&f, 0, -30, 30, 30, z), add_mesh(&f, 0, passes);
    sps_tmap *map = must_build(&f, context);
    for (int i = 0; i < RANGE_POINTS && map; ++i) {
        const double x = 4 * check_next(&random) - 2, y = 4 * check_next(&random) - 2;
        out[i] = (float)through(map, x, y, 8 * check_next(&random) - 4);
    }
    if (map) out[RANGE_POINTS - 1] = (float)through(map, 3.5, 0, -10); /* behind everything */
    sps_tmap_destroy(map);
    end(&f);
}

/* A pane of an optical depth of 1e-4 far before or behind gas moves the gas's range little. The mean place of the first
   p of the optical depth moves by 1e-4 / (3 p) of the pane's distance, 1.6 lengths of the gas at most: 1.3e-3 with 8
   components, 5e-3 with 16. Bins that reach as far as the pane are 2.3 times as wide, 0.07 or 0.14 lengths, half of
   which a place in a bin may be off. Light falls by up to 1.2 per length here: 0.045 (series)
   or 0.09, of which planes and harmonics hide at least half. With ranges from the first to the last occluder it was
   0.07 and 0.03 (8 and 16 planes), 0.09 and 0.04 (series), 0.7 (Beer). */
static void test_thin_occluders(void) {
    static const struct {
        int technique, components, range;
        double most;
    } list[] = {{SPS_TMAP_DEEP_OPACITY, 8, 0, 0.04},
                {SPS_TMAP_DEEP_OPACITY, 16, 0, 0.025},
                {SPS_TMAP_FOURIER, 9, 1, 0.015},
                {SPS_TMAP_FOURIER, 15, 1, 0.025},
                {SPS_TMAP_BEER, 3, 0, 0.03}};
    static float alone[RANGE_POINTS], behind[RANGE_POINTS];
    sps_context *context = sps_create(NULL, NULL);
    for (size_t n = 0; n < sizeof list / sizeof *list; ++n)
        for (int side = -1; side < 2; side += 2) {
            answers_with_pane(context, list[n].technique, list[n].components, list[n].range, 0, 1, alone);
            answers_with_pane(context, list[n].technique, list[n].components, list[n].range, 9 * side, 0.9999, behind);
            const double largest = check_largest(alone, behind, RANGE_POINTS);
            if (getenv("CHECK_FIGURES"))
                printf("technique %d, %d: %g\n", list[n].technique, list[n].components, largest);
            if (!CHECK(largest < list[n].most))
                printf("    technique %d, side %d: %g\n", list[n].technique, side, largest);
            const double last = (double)alone[RANGE_POINTS - 1];
            CHECK_NEAR((double)behind[RANGE_POINTS - 1], 0.9999 * last, 4e-6 * last); /* all that is beyond counts */
        }
    sps_destroy(context);
}

/* With more components, less lies outside of a range: with 24, half of a part of 0.44 % of an optical depth of 3.5 lies
   before it, 0.008, for points in about the first percent of the gas: 8e-4 rms. Planes add 1e-4. */
static void test_many_planes(void) {
    static float exact[RANGE_POINTS], planes[RANGE_POINTS];
    sps_context *context = sps_create(NULL, NULL);
    answers_with_pane(context, SPS_TMAP_DEEP, 0, 0, 0, 1, exact);
    answers_with_pane(context, SPS_TMAP_DEEP_OPACITY, 24, 0, 0, 1, planes);
    const double off = check_rms(exact, planes, RANGE_POINTS);
    if (getenv("CHECK_FIGURES")) printf("24 planes: %g\n", off);
    if (!CHECK(off < 0.001)) printf("    %g\n", off);
    sps_destroy(context);
}

/* A pane that half of the light passes, at an end of the gas: a series rings by up to 9 % of the step of 0.5, and does
   not divide the pane between both ends, which would be 0.09 to 0.12 off. */
static void test_panes_at_ends(void) {
    static float exact[RANGE_POINTS], range[RANGE_POINTS];
    sps_context *context = sps_create(NULL, NULL);
    for (int side = -1; side < 2; side += 2)
        for (int components = 9; components < 16; components += 6) {
            answers_with_pane(context, SPS_TMAP_DEEP, 0, 0, 5 * side, 0.5, exact);
            answers_with_pane(context, SPS_TMAP_FOURIER, components, 1, 5 * side, 0.5, range);
            const double off = check_rms(range, exact, RANGE_POINTS);
            if (!CHECK(off < 0.045)) printf("    side %d, %d: %g\n", side, components, off);
        }
    sps_destroy(context);
}

/* A texel's Fourier coefficients and moments are those of the exact curve, cut or not: sums of its steps, at each
   step's middle, where what a step h of u leaves out is (2 pi k h)^2 / 24, 3e-5 for 12 harmonics and 4000 steps; what
   lies behind u = 1 is there. What lies before u = 0 is the front: nine floats, the last digit of u times their
   slopes. */
static void test_cut_sums(void) {
    enum { STEPS = 4000, HARMONICS = 12 };
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 6; ++n) {
        const int way = n % 2 ? SPOT : ORTHO, moments = n / 2 == 1;
        fixture f;
        sps_tmap *deep, *map;
        begin_cut(&f, way, SPS_TMAP_DEEP, 3);
        deep = must_build(&f, context);
        f.settings.technique = moments ? SPS_TMAP_MOMENT : SPS_TMAP_FOURIER;
        f.settings.texel_range = n / 2 == 2;
        f.settings.components = moments ? 7 : 2 * HARMONICS + 1 + 2 * f.settings.texel_range;
        map = must_build(&f, context);
        for (int texel = 0; texel < SIDE * SIDE && map && deep; ++texel) {
            const int range = f.settings.texel_range;
            const float *made = sps_tmap_texels(map) + (size_t)texel * (size_t)f.settings.components;
            const double first = range ? (double)made[0] : 0, length = range ? (double)made[1] - first : 1;
            double sums[2 * HARMONICS + 1] = {0}, before = 0, front = 0, whole, nearest[3];
            on_ray(map, 0, texel % SIDE, texel / SIDE, 0.5 + 1e-9, nearest);
            before = front = query_at(deep, nearest);
            if (CHECK(sps_tmap_fronts(map) != NULL))
                CHECK_NEAR((double)sps_tmap_fronts(map)[texel], front, 3 * (1e-5 + 17 * U));
            for (int i = -1; i <= STEPS; ++i) { /* the first and the last are the parts before and behind */
                const double u = first + length * fmin((double)(i + 1), (double)STEPS) / STEPS;
                const double at = i < 0 ? 0 : i == STEPS ? 1 : (i + 0.5) / STEPS;
                double point[3], depth;
                on_ray(map, 0, texel % SIDE, texel / SIDE, 0.5 + 16.5 * (i == STEPS ? 2 : u - (u >= 1) * 1e-6), point);
                depth = query_at(deep, point);
                for (int k = 0; k < 2 * HARMONICS + 1; ++k)
                    sums[k] += (depth - before) * (moments ? pow(2 * at - 1, k)
                                                   : k % 2 ? 2 * cos(PI * (k + 1) * at)
                                                           : 2 * sin(PI * k * at));
                before = depth;
            }
            whole = before - front;
            for (int k = 1; k < f.settings.components - 2 * range && whole > 0; ++k)
                if (!CHECK_NEAR((double)made[2 * range + k], moments ? sums[k] / whole : sums[k],
                                (moments ? 1 : 2 * whole) * 1e-4))
                    printf("    technique %d way %d texel %d component %d\n", (int)f.settings.technique, way, texel, k);
        }
        sps_tmap_destroy(map);
        sps_tmap_destroy(deep);
    }
    sps_destroy(context);
}

/* Texels are where an engine expects them: rows from the top, faces in order, lists by their starts. */
static void test_texels(void) {
    sps_context *context = sps_create(NULL, NULL);
    fixture f;
    sps_tmap *map;
    begin(&f, SPS_TMAP_BEER);
    add(&f, 0, -4, 4, 0, 1.6, 1); /* top left */
    add(&f, 0, 4, -3, 0, 1.6, 2); /* right, last row but one */
    map = must_build(&f, context);
    CHECK_NEAR((double)sps_tmap_texels(map)[2], 1, 1e-6);
    CHECK_NEAR((double)sps_tmap_texels(map)[3 * (7 * SIDE + 8) + 2], 2, 1e-6);
    sps_tmap_destroy(map);
    begin(&f, SPS_TMAP_DEEP);
    see(&f, ROUND, SIDE);
    for (int face = 0; face < 6; ++face) {
        double point[3];
        memcpy(point, f.light.camera.position, sizeof point);
        point[face / 2] += face % 2 ? -5 : 5;
        add(&f, 0, point[0], point[1], point[2], 2, 1 + face);
    }
    map = must_build(&f, context);
    for (int face = 0; face < 6 && map; ++face) {
        const uint32_t *starts = sps_tmap_starts(map) + face * SIDE * SIDE + SIDE * SIDE / 2;
        const float *interval = sps_tmap_texels(map) + 4 * starts[0];
        CHECK(starts[1] - starts[0] == 1);
        CHECK_NEAR((double)interval[0], 3.0 / 20, U);
        CHECK_NEAR((double)interval[1], 7.0 / 20, U);
        CHECK_NEAR((double)interval[2], 1 + face, 1e-5);
        CHECK_NEAR((double)interval[3], 0, 0);
    }
    sps_tmap_destroy(map);
    sps_destroy(context);
}

/* -------------------------------------------------------------------------------------------------------- six faces */

/* Two points on either side of a cube's edge, or all three at a corner, 1e-9 apart: faces share their rays, so each
   technique has the same result except for float round-off, as the ray has different coordinates: a chord's CHORD of 4
   texels' 30 particles; techniques with line slopes of up to 30 (Beer) or roots (moments) amplify that. Deep
   maps are also compared with the exact sum. */
static void check_seams(const fixture *f, const sps_tmap *map, double slack, int exact_is_known) {
    check_random random = {41};
    const int n = f->light.width - 1;
    for (int i = 0; i < 600; ++i) {
        const int a = i % 3, b = (a + 1) % 3, c = (a + 2) % 3; /* the edge runs along c */
        const double sign[2] = {i / 3 % 2 ? 1.0 : -1.0, i / 6 % 2 ? 1.0 : -1.0}, t = 0.5 + 18 * check_next(&random);
        const int k = (int)((n + 1) * check_next(&random));
        const double along = i % 10 == 0 ? (i % 20 ? 1 : -1) : -1 + 2.0 * k / n;
        double one_side[3], other[3];
        one_side[a] = sign[0] * t, one_side[b] = sign[1] * t * (1 - 1e-9), one_side[c] = along * t * (1 - 1e-9);
        other[a] = sign[0] * t * (1 - 1e-9), other[b] = sign[1] * t, other[c] = along * t * (1 - 1e-9);
        vec_along(f->light.camera.position, one_side, 1, one_side);
        vec_along(f->light.camera.position, other, 1, other);
        CHECK_NEAR(query_at(map, one_side), query_at(map, other), slack);
        if (exact_is_known) {
            const answer exact = exact_particles(f, one_side);
            CHECK_NEAR(query_at(map, one_side), exact.depth, exact.slack + 1e-6);
        }
    }
}

/* Particles smaller than a texel are widened to the same size by all faces. */
static void test_seams_of_fine_particles(void) {
    sps_context *context = sps_create(NULL, NULL);
    fixture f;
    sps_tmap *map;
    begin(&f, SPS_TMAP_DEEP);
    see(&f, ROUND, 17);
    scatter(&f, 0, 200, 3, 52);
    for (int i = 0; i < 200; ++i) f.crowds[0].list[i].radius = 0.02f, f.crowds[0].list[i].optical_depth = 60;
    map = must_build(&f, context);
    if (map) check_seams(&f, map, 1e-3, 0);
    sps_tmap_destroy(map);
    sps_destroy(context);
}

static void test_seams(void) {
    static const double slack[TECHNIQUES + 1] = {0, 1e-3, 1e-3, 1e-3, 1e-3, 2e-3, 1e-2, 1e-3};
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique) {
        fixture f;
        sps_tmap *map;
        begin(&f, technique);
        see(&f, ROUND, 17);
        scatter(&f, 0, 30, 7, 51);
        for (int i = 0; i < 30; ++i) f.crowds[0].list[i].radius += 1;
        if (technique == SPS_TMAP_DEEP) f.settings.near_depth = 0.25;
        map = must_build(&f, context);
        if (map) check_seams(&f, map, slack[technique], technique == SPS_TMAP_DEEP);
        CHECK_NEAR(query_at(map, f.light.camera.position), 0, 0);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* A light in the middle of uniform gas, and off-centre: in every direction, the ray's own optical depth, as for other
   boxes; the slab that contains the light counts from the light's position, at most a quarter of a slab off. */
static void test_gas_around(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 2; ++n) {
        const double slab = n % 2 ? 0.25 : 0.125, slope = 0.8 * 2 / (sqrt(2 * PI) * 0.65 * 0.25);
        check_random random = {61};
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_DEEP);
        see(&f, ROUND, 17);
        if (n == 0) check_set3(f.light.camera.position, 0, 0, 0);
        f.settings.far_depth = 8;
        f.light.quality = SPS_QUALITY_HIGH;
        f.light.slab_thickness = slab / 0.25;
        add_box(&f, 20, 2.5, n * 0.5, 0.8);
        map = must_build(&f, context);
        for (int i = 0; i < 400 && map; ++i) {
            const int edge = i % 4 == 0; /* a quarter of the rays are those that faces share */
            double point[3], exact;
            ray r;
            on_ray(map, i % 6, edge ? 16 : (int)(17 * check_next(&random)), (int)(17 * check_next(&random)),
                   6 * check_next(&random), point);
            ray_to(&f, point, &r);
            exact = exact_boxes(&f, &r, r.t * r.length);
            CHECK_NEAR(query_at(map, point), exact,
                       r.length * (RIPPLE * 0.8 * 5 + slab * slab / 8 * slope + slab / 4 * 0.8) + 1e-5);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

int main(void) {
    RUN(test_particles);
    RUN(test_plain_numbers);
    RUN(test_between_texels);
    RUN(test_small_particles);
    RUN(test_small_particles_around);
    RUN(test_boxes);
    RUN(test_fine_voxels);
    RUN(test_blob);
    RUN(test_cut_kernels);
    RUN(test_classified_kernels);
    RUN(test_opaque);
    RUN(test_depth_maps);
    RUN(test_few_nodes);
    RUN(test_bias_of_oblong_texels);
    RUN(test_behind_the_light);
    RUN(test_surfaces_at_the_ends);
    RUN(test_translucent);
    RUN(test_across_the_light);
    RUN(test_watertight);
    RUN(test_techniques);
    RUN(test_thin_occluders);
    RUN(test_many_planes);
    RUN(test_panes_at_ends);
    RUN(test_soft_compressed);
    RUN(test_before_near);
    RUN(test_fronts_alone);
    RUN(test_cut_particles);
    RUN_LONG(test_cut_sums);
    RUN(test_texels);
    RUN(test_seams);
    RUN(test_seams_of_fine_particles);
    RUN(test_gas_around);
    return check_report();
}
