/* Light that scatters any number of times from cell to cell: the directions and the solver against sums and sweeps in
   double precision, what is filled in against what is known of gas and lights, layers against published figures, clouds
   and all kinds of matter and lights against random paths; symmetries; what is held; where it must fail or change
   nothing. */

#include "check.h"

enum { SIDE = 16, PIXELS = SIDE * SIDE, COUNT = 4 * PIXELS };
static float image_a[COUNT], image_b[COUNT], image_c[COUNT];
static sps_context *context;
static check_triangles plate;

static const float one = 1;

static int same(const float *a, const float *b) { return memcmp(a, b, sizeof image_a) == 0; }

static uint64_t cells_made(const sps_context *by) {
    sps_stats_report stats;
    sps_get_stats(by, &stats);
    return stats.cells;
}

/* --- directions --- */

/* The mean of x^a y^b z^c over the sphere: (a - 1)!! (b - 1)!! (c - 1)!! / (a + b + c + 1)!!, or 0 if any is odd. */
static double mean_power(const int power[3]) {
    double mean = 1;
    int all = 1;
    for (int k = 0; k < 3; ++k) {
        if (power[k] % 2) return 0;
        for (int i = 1; i < power[k]; i += 2, all += 2) mean *= (double)i / (all + 2);
    }
    return mean;
}

/* The vector of a direction: three steps to one at a slant. */
static void vector_of(const spsi_cell_direction *direction, double v[3]) {
    for (int k = 0; k < 3; ++k)
        v[k] = direction->step[k] * (direction->axis >= 0 && direction->axis != k ? 1.0 / 3 : 1);
}

/* Weights are floats, and no power exceeds 1: 50 roundings of weights below 0.03 are below 1e-7. */
static void test_weights(void) {
    spsi_cell_direction directions[SPSI_CELL_DIRECTIONS];
    double beyond = 0;
    spsi_cell_directions(directions);
    for (int i = 0; i < SPSI_CELL_DIRECTIONS; ++i) {
        const spsi_cell_direction *here = &directions[i], *before = &directions[i > 0 ? i - 1 : 0];
        const int *step = here->step;
        const int axes = abs(step[0]) + abs(step[1]) + abs(step[2]);
        CHECK((here->axis < 0) == (i < SPSI_CELL_STRAIGHT) && here->length == (here->axis < 0 ? axes - 1 : 3));
        CHECK(axes > 0 && (here->axis < 0 || axes == 3));
        CHECK(here->axis != before->axis || before->step[2] <= step[2]); /* sweeps rely on their order */
        for (int k = 0; k < i; ++k)
            CHECK(memcmp(step, directions[k].step, sizeof here->step) || here->axis != directions[k].axis);
    }
    for (int i = 0; i < 13 * 13 * 13; ++i) {
        const int power[3] = {i % 13, i / 13 % 13, i / 169}, degree = power[0] + power[1] + power[2];
        double sum = 0;
        if (degree > 12) continue;
        for (int k = 0; k < SPSI_CELL_DIRECTIONS; ++k) {
            double v[3];
            vector_of(&directions[k], v);
            vec_normalise(v);
            sum += (double)directions[k].weight * pow(v[0], power[0]) * pow(v[1], power[1]) * pow(v[2], power[2]);
        }
        if (degree < 12 && !CHECK_NEAR(sum, mean_power(power), 1e-7))
            printf("    x^%d y^%d z^%d\n", power[0], power[1], power[2]);
        if (degree == 12) beyond = fmax(beyond, fabs(sum - mean_power(power)));
    }
    CHECK(beyond > 1e-5); /* 11 is the last degree that is exact */
}

/* The l-th Legendre polynomial. */
static double legendre(int l, double c) {
    if (l < 2) return l == 0 ? 1 : c;
    return l == 2 ? 1.5 * c * c - 0.5 : 2.5 * c * c * c - 1.5 * c;
}

/* Harmonics of one degree add up to (2 l + 1) P[l] of the angle between two directions. Products of them are of degree
   6, which the weights integrate. A harmonic is at most sqrt 7, and three roundings of a product make 7 * 3 * 6e-8. */
static void test_harmonics(void) {
    spsi_cell_direction directions[SPSI_CELL_DIRECTIONS];
    check_random random = {1};
    spsi_cell_directions(directions);
    for (int a = 0; a < SPSI_CELL_TERMS; ++a)
        for (int b = 0; b <= a; ++b) {
            double sum = 0;
            for (int i = 0; i < SPSI_CELL_DIRECTIONS; ++i)
                sum += (double)directions[i].weight * (double)directions[i].harmonic[a] *
                       (double)directions[i].harmonic[b];
            if (!CHECK_NEAR(sum, a == b, 1.5e-6)) printf("    terms %d and %d\n", a, b);
        }
    for (int n = 0; n < 100; ++n) {
        double u[3], v[3], sum[SPSI_CELL_ORDERS] = {0};
        float of_u[SPSI_CELL_TERMS], of_v[SPSI_CELL_TERMS];
        for (int k = 0; k < 3; ++k) u[k] = check_next(&random) - 0.5, v[k] = check_next(&random) - 0.5;
        vec_normalise(u), vec_normalise(v);
        spsi_harmonics(u, of_u), spsi_harmonics(v, of_v);
        for (int t = 0; t < SPSI_CELL_TERMS; ++t) sum[spsi_term_degree(t)] += (double)of_u[t] * (double)of_v[t];
        for (int l = 0; l < SPSI_CELL_ORDERS; ++l) CHECK_NEAR(sum[l], (2 * l + 1) * legendre(l, vec_dot(u, v)), 5e-6);
    }
}

/* A vector of directions, whose numbers of terms differ. */
static void test_harmonics_of_vectors(void) {
    check_random random = {2};
    float v[3][SPSI_LANES], out[SPSI_LANES], exact[SPSI_CELL_TERMS];
    spsi_v lanes[3], all[SPSI_CELL_TERMS];
    for (int k = 0; k < 3; ++k) {
        for (int i = 0; i < SPSI_LANES; ++i) v[k][i] = (float)(check_next(&random) - 0.5);
        lanes[k] = spsi_load(v[k]);
    }
    for (int orders = 1; orders <= 4; orders += orders) {
        spsi_harmonics_v(lanes, orders * orders, all);
        for (int i = 0; i < SPSI_LANES; ++i) {
            const double direction[3] = {(double)v[0][i], (double)v[1][i], (double)v[2][i]};
            spsi_harmonics(direction, exact);
            for (int t = 0; t < orders * orders; ++t) {
                spsi_store(out, all[t]);
                CHECK_NEAR((double)out[i], (double)exact[t], 1e-6);
            }
        }
    }
}

/* --- the solver --- */

enum { MOST_CELLS = 2048, MOST_TERMS = MOST_CELLS * SPSI_CELL_TERMS };

/* The same cells in double precision, without padding: terms of a cell beside each other. */
typedef struct exact_cells {
    int size[3], count, terms;
    double depth[MOST_CELLS], keep[4 * MOST_CELLS];
    double given[MOST_TERMS], sent[MOST_TERMS], moments[MOST_TERMS];
    double escaped; /* power through all faces of the grid, in the units of depth times moment */
} exact_cells;

static exact_cells exact;
static spsi_cell_solver solver;
static spsi_cell_grid grid;

static int degree_of(int term) { return (int)sqrt(term + 0.5); }

/* The number of a cell, `back` steps before (-1) or after (1) one in the order of a sweep; -1: beyond the grid. The
   bits of `along` say along which axes. */
static int cell_beside(const exact_cells *e, const int at[3], const int step[3], int along, int ahead) {
    int cell = 0;
    for (int k = 2; k >= 0; --k) {
        const int x = at[k] + (along >> k & 1 ? ahead * step[k] : 0);
        if (x < 0 || x >= e->size[k]) return -1;
        cell = cell * e->size[k] + x;
    }
    return cell;
}

/* The share of light that goes from a cell to the one beside it along these axes: linear between centres. */
static double share_of(const double vector[3], int along) {
    double share = 1;
    for (int k = 0; k < 3; ++k) share *= along >> k & 1 ? fabs(vector[k]) : 1 - fabs(vector[k]);
    return share;
}

/* Sweeps one direction, cell by cell. */
static void sweep_direction(exact_cells *e, const spsi_cell_direction *direction) {
    static double radiance[MOST_CELLS];
    const int *step = direction->step;
    double vector[3], way, weight = (double)direction->weight;
    float harmonic[SPSI_CELL_TERMS];
    vector_of(direction, vector);
    way = sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
    {
        const double unit[3] = {vector[0] / way, vector[1] / way, vector[2] / way};
        spsi_harmonics(unit, harmonic);
    }
    for (int n = 0; n < e->count; ++n) {
        int at[3] = {n % e->size[0], n / e->size[0] % e->size[1], n / (e->size[0] * e->size[1])}, cell;
        double s = 0, in = 0, t, mean;
        for (int k = 0; k < 3; ++k) at[k] = step[k] < 0 ? e->size[k] - 1 - at[k] : at[k];
        cell = cell_beside(e, at, step, 0, 0);
        for (int along = 1; along < 8; ++along) {
            const int from = cell_beside(e, at, step, along, -1);
            if (share_of(vector, along) > 0 && from >= 0) in += share_of(vector, along) * radiance[from];
        }
        for (int i = 0; i < e->terms; ++i) s += e->sent[cell * e->terms + i] * (double)harmonic[i];
        t = e->depth[cell] * way;
        mean = s + (in - s) * (t > 0 ? -expm1(-t) / t : 1);
        radiance[cell] = s + (in - s) * exp(-t);
        for (int i = 0; i < e->terms; ++i) e->moments[cell * e->terms + i] += weight * mean * (double)harmonic[i];
        for (int along = 1; along < 8; ++along)
            if (cell_beside(e, at, step, along, 1) < 0)
                e->escaped += weight / way * share_of(vector, along) * radiance[cell];
    }
}

/* The moments of what cells send. */
static void sweep(exact_cells *e) {
    spsi_cell_direction directions[SPSI_CELL_DIRECTIONS];
    spsi_cell_directions(directions);
    memset(e->moments, 0, sizeof e->moments);
    e->escaped = 0;
    for (int i = 0; i < SPSI_CELL_DIRECTIONS; ++i) sweep_direction(e, &directions[i]);
}

/* Sweeps until nothing changes. Returns the number of sweeps. */
static int converge(exact_cells *e) {
    for (int n = 1; n < 4000; ++n) {
        double change = 0, most = 0;
        sweep(e);
        for (int i = 0; i < e->count; ++i)
            for (int t = 0; t < e->terms; ++t) {
                const int at = i * e->terms + t;
                const double next = e->keep[4 * i + degree_of(t)] * e->moments[at] + e->given[at];
                change = fmax(change, fabs(next - e->sent[at]));
                most = fmax(most, fabs(next));
                e->sent[at] = next;
            }
        if (change < 1e-7 * most) return n;
    }
    return 4000;
}

static size_t padded(const exact_cells *e, int cell) {
    const int row = cell / e->size[0];
    return (size_t)row * (size_t)grid.pitch + (size_t)(cell % e->size[0]);
}

/* Lays a solver out as a frame of this asymmetry would. */
static int begin_solver(int nx, int ny, int nz, double g) {
    static spsi_frame frame;
    memset(&frame, 0, sizeof frame), memset(&grid, 0, sizeof grid);
    frame.channels = 1;
    frame.matter.material_count = frame.matter.materials[0].scatters = 1;
    frame.matter.materials[0].lobe_count = 1;
    frame.matter.materials[0].lobes[0].weight = 1, frame.matter.materials[0].lobes[0].asymmetry = (float)g;
    grid.size[0] = exact.size[0] = nx, grid.size[1] = exact.size[1] = ny, grid.size[2] = exact.size[2] = nz;
    frame.matter.orders = spsi_phase_orders(&frame.matter.materials[0]);
    spsi_cells_lay_out(&frame, &grid);
    exact.count = nx * ny * nz, exact.terms = grid.terms;
    if (!CHECK(exact.count <= MOST_CELLS)) return 0;
    if (!CHECK(spsi_cell_solver_build(context, &grid, &solver) == SPS_OK)) return 0;
    memset(solver.levels[0].depth, 0, (size_t)(solver.scratch - solver.levels[0].depth) * sizeof(float));
    return 1;
}

/* Solves what `exact` has, and takes over what was found, with moments of a sweep of its own. The sum of differences of
   moments goes into `off`, relative to the sum of all; in thin cells they are small differences of what is sent. */
static int run_solver(double *off) {
    static const spsi_call_stage whole = {0, 1};
    const spsi_cell_level *level = &solver.levels[0];
    double difference = 0, sum = 0;
    for (int i = 0; i < exact.count; ++i) {
        const size_t at = padded(&exact, i);
        level->depth[at] = (float)exact.depth[i];
        for (int l = 0; l < grid.orders; ++l) level->keep[l][at] = (float)exact.keep[4 * i + l];
        for (int t = 0; t < exact.terms; ++t)
            level->given[(size_t)t * level->count + at] = (float)exact.given[i * exact.terms + t];
    }
    if (!CHECK(spsi_cells_solve(&solver, 0, &whole) == SPS_OK)) return 0;
    spsi_cells_sweep(&solver.levels[0]);
    for (int i = 0; i < exact.count * exact.terms; ++i)
        exact.sent[i] = (double)level->sent[(size_t)(i % exact.terms) * level->count + padded(&exact, i / exact.terms)];
    sweep(&exact);
    for (int i = 0; i < exact.count * exact.terms; ++i) {
        const size_t at = (size_t)(i % exact.terms) * level->count + padded(&exact, i / exact.terms);
        difference += fabs((double)level->moments[0][at] - exact.moments[i]);
        sum += fabs(exact.moments[i]) + 0.01 * fabs(exact.sent[i]);
    }
    *off = sum > 0 ? difference / sum : difference;
    return 1;
}

/* The share of what cells send that is missing, as the solver measures it; `all`: of all terms instead of the first. */
static double imbalance(const exact_cells *e, int all) {
    double missing = 0, sent = 0;
    for (int i = 0; i < e->count; ++i)
        for (int t = 0; t < (all ? e->terms : 1); ++t) {
            const int at = i * e->terms + t;
            const double wanted = e->keep[4 * i + degree_of(t)] * e->moments[at] + e->given[at];
            missing += fabs(wanted - e->sent[at]) * fmin(e->depth[i], 1);
            if (t == 0) sent += fabs(e->sent[at]) * fmin(e->depth[i], 1);
        }
    return sent > 0 ? missing / sent : missing;
}

/* Gas of random depths, a fifth of it empty, given light at random, most of it on one side. */
static void fill_random(double depth, double albedo, double g, uint64_t seed) {
    const double peak = grid.orders > 1 ? pow(g, grid.orders) : 0;
    check_random random = {seed};
    for (int i = 0; i < exact.count; ++i) {
        const int empty = check_next(&random) < 0.2 && i > 0;
        const double light = i % exact.size[0] < 2 ? 1 : 0.05, kept = (albedo - albedo * peak) / (1 - albedo * peak);
        exact.depth[i] = empty ? 0 : depth * 2 * check_next(&random);
        for (int l = 0; l < grid.orders; ++l)
            exact.keep[4 * i + l] = empty ? 0 : kept * (pow(g, l) - peak) / (1 - peak);
        for (int t = 0; t < exact.terms; ++t)
            exact.given[i * exact.terms + t] =
                empty
                    ? 0
                    : light * (t == 0 ? check_next(&random) : 0.6 * (check_next(&random) - 0.5) * pow(g, degree_of(t)));
    }
}

/* Coarser cells hold the same gas: an eighth of its density each, twice the edge, and a quarter of their number. */
static void check_levels(void) {
    for (int n = 1; n < solver.level_count; ++n) {
        double sums[2] = {0, 0}, kept[2] = {0, 0};
        for (int i = 0; i < 2; ++i) {
            const spsi_cell_level *level = &solver.levels[n - 1 + i];
            for (size_t k = 0; k < level->count; ++k) {
                sums[i] += (double)level->depth[k] * (i ? 4 : 1);
                kept[i] += (double)level->depth[k] * (double)level->keep[0][k] * (i ? 4 : 1);
            }
        }
        CHECK_NEAR(sums[1], sums[0], 1e-5 * sums[0]);
        CHECK_NEAR(kept[1], kept[0], 1e-5 * kept[0]);
    }
}

static const int sizes[][3] = {{1, 1, 1}, {3, 2, 1}, {17, 5, 9}, {4, 19, 6}, {8, 3, 33}};
static const double asymmetries[] = {0, 0.2, 0.85};

/* What is found must be a solution: sent = keep * moments + given, by another sweep. That must hold as closely as the
   solver states, at any depth; and floats are as good as a few hundred of their roundings. */
static void test_solutions(void) {
    static const double depths[] = {0.001, 0.1, 1, 10, 1e4}, albedos[] = {1, 0.99, 0.5};
    double worst = 0, worst_sweep = 0, all = 0;
    for (int n = 0; n < 5 * 3 * 5 * 3; ++n) {
        const int *size = sizes[n % 5];
        const double g = asymmetries[n / 5 % 3], depth = depths[n / 15 % 5], albedo = albedos[n / 75];
        double off, missing;
        if (!check_long() && n % 2) continue; /* every pair of them still occurs */
        if (!begin_solver(size[0], size[1], size[2], g)) return;
        CHECK(grid.terms == (g < 0.1 ? 1 : g < 0.5 ? 4 : 16));
        fill_random(depth, albedo, g, (uint64_t)n + 1);
        if (!run_solver(&off)) return;
        check_levels();
        missing = imbalance(&exact, 0);
        if (!CHECK(off < 2e-5) | !CHECK(missing < SPSI_CELL_BALANCE) | !CHECK(imbalance(&exact, 1) < 1e-2))
            printf("    %d x %d x %d, g %g, depth %g, albedo %g: sweep off by %g, missing %g, of all terms %g\n",
                   size[0], size[1], size[2], g, depth, albedo, off, missing, imbalance(&exact, 1));
        worst = fmax(worst, missing), worst_sweep = fmax(worst_sweep, off), all = fmax(all, imbalance(&exact, 1));
    }
    if (figures())
        printf("solutions: missing %.2g at most, of all terms %.2g, sweeps off by %.2g\n", worst, all, worst_sweep);
}

/* Sweeps alone arrive at the same, where they arrive: what is missing is scattered about as often as light is. */
static void test_converged(void) {
    static const double depths[] = {0.05, 0.5, 2}, albedos[] = {1, 0.9};
    static double found[MOST_TERMS];
    double worst = 0;
    for (int n = 0; n < 3 * 3 * 3 * 2; ++n) {
        const int *size = sizes[1 + n % 3];
        const double g = asymmetries[n / 3 % 3], depth = depths[n / 9 % 3], albedo = albedos[n / 27];
        double off, difference = 0, sum = 0;
        if (!check_long() && (n / 3 + n / 9 + n / 27) % 2) continue;
        if (!check_long() && depth > 1 && (n % 3 == 2 || g > 0.5)) continue; /* many sweeps */
        if (!begin_solver(size[0], size[1], size[2], g)) return;
        fill_random(depth, albedo, g, (uint64_t)n + 1);
        if (!run_solver(&off)) return;
        memcpy(found, exact.moments, sizeof found);
        CHECK(converge(&exact) < 4000);
        for (int i = 0; i < exact.count * exact.terms; ++i) {
            difference += fabs(found[i] - exact.moments[i]);
            if (i % exact.terms == 0) sum += exact.moments[i];
        }
        worst = fmax(worst, difference / sum);
        if (!CHECK(difference < 5e-3 * sum))
            printf("    %d x %d x %d, g %g, depth %g, albedo %g: off by %g\n", size[0], size[1], size[2], g, depth,
                   albedo, difference / sum);
    }
    if (figures()) printf("converged: off by %.2g at most\n", worst);
}

/* Nothing is lost: what cells are given and do not absorb leaves the grid. Depths grow until what leaves is next to
   nothing of what is sent, where floats no longer show it. */
static void test_energy(void) {
    static const double depths[] = {0.01, 0.1, 1, 4, 30};
    for (int n = 0; n < 5 * 5; ++n) {
        const int *size = sizes[n / 5];
        const double depth = depths[n % 5];
        double off, given = 0, absorbed = 0, albedo = n % 2 ? 1 : 0.9;
        if (!begin_solver(size[0], size[1], size[2], 0)) return;
        fill_random(depth, albedo, 0, (uint64_t)n + 1);
        if (!run_solver(&off)) return;
        for (int i = 0; i < exact.count; ++i) {
            given += exact.depth[i] * exact.given[i];
            absorbed += exact.depth[i] * (exact.depth[i] > 0 ? 1 - exact.keep[4 * i] : 0) * exact.moments[i];
        }
        if (figures())
            printf("%d x %d x %d of depth %g, albedo %g: given %.6g, absorbed %.6g, escaped %.6g, off by %.2g\n",
                   size[0], size[1], size[2], depth, albedo, given, absorbed, exact.escaped,
                   (absorbed + exact.escaped) / given - 1);
        CHECK(exact.escaped >= 0);
        CHECK_CASE("Scattering", "energy of cells of depth 0.01 to 30: absorbed, and lost through the borders",
                   "what they are given, relative", fabs((absorbed + exact.escaped) / given - 1),
                   n % 5 < 4 ? 2e-3 : 0.02,
                   "the solver's balance; what leaves deep cells is a small difference of floats");
    }
}

/* Gas that gives what it absorbs of a radiance of 1 holds no more than that, and deep inside no less. */
static void test_furnace(void) {
    static const double depths[] = {0.01, 1, 100, 1e4};
    for (int n = 0; n < 4 * 5 * 2; ++n) {
        const int *size = sizes[n % 5];
        const double depth = depths[n / 5 % 4], albedo = n / 20 ? 0.99 : 0.5;
        double off, least = HUGE_VAL, most = 0;
        if (!begin_solver(size[0], size[1], size[2], 0)) return;
        for (int i = 0; i < exact.count; ++i)
            exact.depth[i] = depth, exact.keep[4 * i] = albedo, exact.given[i] = 1 - albedo;
        if (!run_solver(&off)) return;
        for (int i = 0; i < exact.count; ++i)
            least = fmin(least, exact.moments[i]), most = fmax(most, exact.moments[i]);
        if (!CHECK(least > 0 && most <= 1 + 1e-3))
            printf("    depth %g, albedo %g: %g..%g\n", depth, albedo, least, most);
        if (depth > 1000) CHECK(least > 0.98);
        if (depth < 0.1) CHECK(most < 30 * depth);
    }
}

/* A correction is lengthened, by its length at most, to where the residual is orthogonal to its change. */
static void test_lengthened(void) {
    check_random random = {5};
    for (int n = 0; n < 3; ++n) { /* too short, too long, much too short */
        double product = 0, square = 0;
        if (!begin_solver(9, 5, 6, 0.5)) return;
        spsi_cell_level *level = &solver.levels[0];
        const size_t count = (size_t)grid.terms * level->count;
        for (int i = 0; i < exact.count * exact.terms; ++i) {
            const size_t at = (size_t)(i % exact.terms) * level->count + padded(&exact, i / exact.terms);
            level->moments[1][at] = (float)(n == 0 ? 0.3 : n == 1 ? -0.3 : 3) + 0.1f * (float)check_next(&random);
            level->last[1][at] = level->moments[1][at] + 1;
            level->sent[at] = (float)check_next(&random), level->last[0][at] = level->sent[at] - 1;
        }
        spsi_cells_lengthen(&solver, 1);
        CHECK(n == 0 ? solver.longer > 0.3f && solver.longer < 0.4f : solver.longer == (n == 1 ? 0 : 1));
        for (int i = 0; i < exact.count * exact.terms; ++i) {
            const size_t at = (size_t)(i % exact.terms) * level->count + padded(&exact, i / exact.terms);
            product += (double)level->moments[1][at], square += 1;
        }
        if (n == 0) CHECK_NEAR(product, 0, 1e-6 * square);
        CHECK(memcmp(level->last[0], level->sent, count * sizeof(float)) == 0);
        CHECK(memcmp(level->last[1], level->moments[1], count * sizeof(float)) == 0);
        level->moments[1][0] = 1e30f; /* its square is no float */
        spsi_cells_lengthen(&solver, 1);
        CHECK(solver.longer == 0 && level->moments[1][0] == 1e30f);
        spsi_cells_lengthen(&solver, 0); /* the first cycle's is not known */
        CHECK(solver.longer == 0);
    }
}

/* Nothing is given: nothing is found, and nothing is divided by it. */
static void test_nothing_given(void) {
    double off;
    if (!begin_solver(5, 4, 3, 0.85)) return;
    fill_random(1, 1, 0.85, 1);
    memset(exact.given, 0, sizeof exact.given);
    if (!run_solver(&off)) return;
    for (int i = 0; i < exact.count * exact.terms; ++i) CHECK_NEAR(exact.moments[i], 0, 0);
    CHECK_NEAR(off, 0, 0);
}

/* --- scenes --- */

static double transformed_puff(const void *user, const double p[3]) {
    const double(*rows)[3] = (const double(*)[3])user;
    double q[3];
    for (int i = 0; i < 3; ++i) q[i] = vec_dot(rows[i], p);
    return check_puff(NULL, q);
}

/* The first 3 rows of where a scene's gas is looked up. */
static double look_rows[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
static const double unchanged[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
static const check_field puff_field = {
    transformed_puff, look_rows, {0, 0, 0}, {{0, 0, 0}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}}};

static const sps_transfer_point points[] = {{0, {0.9f, 0.9f, 0.5f}, 0, {0, 0, 0}},
                                            {1, {0.9f, 0.8f, 0.7f}, 6, {0, 0, 0}}};
static const sps_transfer tissue = {points, 2, NULL, NULL, 0};
static const sps_lobe lobes[] = {{0.5f, 3}, {-0.2f, 1}}, forward = {0.85f, 1}, middle = {0.5f, 1},
                      backward = {-0.3f, 1};
static sps_particles *swarm;

enum { GAS, CLASSIFIED, SWARM, MIXED, TWO_GASES, KINDS };
static const char *const kinds[] = {"gas", "classified", "particles", "particles in gas", "two gases"};
enum { SUN, BEHIND, POINT, WITHIN, SPOT, UNSHADOWED, LIGHTS };
static const char *const lights[] = {"sun", "sun behind", "point", "lamp within", "spot", "unshadowed sun"};

static void add_gas(check_scene *s) {
    sps_volume *volume = check_add_volume(s, 20, 20, 20, check_box(-1, -1, -1, 1, 1, 1));
    volume->eval_fn = check_eval_field;
    volume->user = (void *)(size_t)&puff_field;
    volume->extinction = 5;
    volume->lobes = lobes, volume->lobe_count = 2;
    check_color(volume->albedo, 1, 0.95, 0.8);
}

static void add_light(check_scene *s, int light) {
    if (light == SUN) check_add_directional(s, 0.5, -0.8, -0.4, 2);
    if (light == BEHIND) check_add_directional(s, 0.3, -0.2, 0.9, 2);
    if (light == UNSHADOWED) check_add_directional(s, 0.5, -0.8, 0.4, 2)->no_shadow = 1;
    if (light == POINT) check_add_point(s, -2, 3, 2, 20);
    if (light == WITHIN) check_add_point(s, 0.1, 0.15, -0.2, 1);
    if (light == SPOT) {
        sps_light *spot = check_add_point(s, -2, 2, 1, 30);
        check_set3(spot->direction, 2, -2, -1);
        spot->inner_cone = 0.1, spot->outer_cone = 0.25;
    }
}

static void start(check_scene *s, int kind, int light) {
    check_clear(s, SIDE, SIDE);
    memcpy(look_rows, unchanged, sizeof look_rows);
    check_set3(s->view.camera.position, 0, 0, 5);
    check_perspective(&s->view.camera, 0.4);
    if (kind != SWARM) add_gas(s);
    if (kind == CLASSIFIED) s->volume[0].transfer = &tissue;
    if (kind == SWARM || kind == MIXED) {
        swarm = check_add_swarm(s, kind == MIXED ? 0.3 : 0.8);
        swarm->soft = 1;
        swarm->lobes = lobes, swarm->lobe_count = 1;
        check_color(swarm->albedo, 0.8, 0.9, 1);
    }
    if (kind == TWO_GASES) {
        sps_volume *other = check_add_volume(s, 12, 12, 12, check_box(-0.2, -0.9, -0.8, 0.9, 0.3, 0.7));
        other->read_fn = check_read_constant;
        other->user = (void *)(size_t)&one;
        other->extinction = 2;
        check_color(other->albedo, 0.6, 0.9, 0.95);
    }
    add_light(s, light);
    s->view.scattering = SPS_SCATTERING_MULTIPLE;
    s->view.scattering_resolution = 12;
}

/* A grey scene that is quick to render: isotropic gas of albedo 1. */
static void start_plain(check_scene *s, int light) {
    start(s, GAS, light);
    s->volume[0].lobe_count = 0;
    check_color(s->volume[0].albedo, 1, 1, 1);
}

static const spsi_cell_grid *grid_of(const sps_context *by) {
    return (const spsi_cell_grid *)by->buffers[SPSI_BUFFER_CELL_GRID].data;
}

static const spsi_cell_job *job_of(const sps_context *by) {
    return (const spsi_cell_job *)by->buffers[SPSI_BUFFER_CELL_JOB].data;
}

/* --- what cells are filled with --- */

/* Half of the value is enough for all of the extinction. */
static const sps_transfer_point plateau_points[] = {{0, {0.5f, 0.5f, 0.5f}, 0, {0, 0, 0}},
                                                    {0.4f, {0.5f, 0.5f, 0.5f}, 0, {0, 0, 0}},
                                                    {0.6f, {0.5f, 0.5f, 0.5f}, 6, {0, 0, 0}},
                                                    {1, {0.5f, 0.5f, 0.5f}, 6, {0, 0, 0}}};
static const sps_transfer plateau = {plateau_points, 4, NULL, NULL, 0};

/* Cells cover the gas; as many as asked for lie along its longest side. Their optical depths add up to what the voxels
   hold: extinction times value times volume. */
static void test_filling(void) {
    static const double widths[][3] = {{2, 2, 2}, {2, 1, 0.3}, {0.5, 3, 1}};
    /* flat voxels ripple, and what is classified has sharper faces than samples */
    static const double allowed[] = {5e-4, 2e-3, 0.01, 2e-3, 1e-3, 1e-3, 0.03};
    for (int n = 0; n < 7; ++n) {
        const double *width = widths[n % 3];
        double sum = 0, fine_sum = 0, exact_sum = n < 3 ? 3 * width[0] * width[1] * width[2] : 0;
        int longest = 0;
        check_scene s;
        sps_volume *volume;
        const spsi_cell_grid *made;
        check_clear(&s, SIDE, SIDE);
        volume = check_add_volume(&s, 12, 12, 12, check_box(1, 2, 3, 1 + width[0], 2 + width[1], 3 + width[2]));
        volume->read_fn = check_read_constant, volume->user = (void *)(size_t)&one;
        volume->extinction = 3;
        check_color(volume->albedo, 0.5, 0.5, 0.5);
        if (n == 6) { /* its voxels are smaller than half a cell; half of its value is at its faces */
            volume->transfer = &plateau, volume->size[0] = volume->size[1] = volume->size[2] = 40;
            exact_sum = 6 * 8;
        }
        if (n >= 3 && n < 6) {
            s.scene.volume_count = 0;
            swarm = check_add_swarm(&s, 0.8);
            check_color(swarm->albedo, 0.5, 0.5, 0.5);
            exact_sum = 50 * 0.8 * PI * 0.25 * 0.25 * (2.0 / 3); /* chords of a ball: 2/3 of its diameter */
        }
        check_add_directional(&s, 0, 0, -1, 1);
        s.view.scattering = SPS_SCATTERING_MULTIPLE, s.view.scattering_resolution = 9 + n % 3;
        check_render(context, &s, image_a);
        made = grid_of(context);
        CHECK(cells_made(context) == (uint64_t)(made->size[0] * made->size[1] * made->size[2]));
        for (int k = 0; k < 3; ++k) {
            longest = spsi_imax(longest, made->size[k]);
            if (n >= 3) continue;
            CHECK(made->corner[k] <= 1 + k + 1e-6 &&
                  made->corner[k] + made->size[k] * made->edge >= 1 + k + width[k] - 1e-6);
        }
        CHECK(longest == s.view.scattering_resolution);
        for (size_t i = 0; i < made->count; ++i) sum += (double)made->depth[i] * made->edge * made->edge;
        for (size_t i = 0; i < 8 * made->count; ++i)
            fine_sum += (double)job_of(context)->samples[i] * made->edge * made->edge / 4;
        CHECK_NEAR(fine_sum, sum, 1e-5 * sum);
        CHECK((job_of(context)->fine > 1) == (n == 6));
        if (figures()) printf("filled: %.5f, exact %.5f\n", sum, exact_sum);
        CHECK_NEAR(sum, exact_sum, allowed[n] * exact_sum);
        for (size_t i = 0; i < made->count; ++i)
            CHECK_NEAR((double)job_of(context)->scattered[i], 0.5 * (double)made->depth[i],
                       1e-5 * (double)made->depth[i]);
    }
}

/* --- what is deposited --- */

enum { DEPOSITS = 5, MOST_SAMPLES = 48 * 48 * 48 };
static const char *const deposits[DEPOSITS] = {"upright", "turned", "sheared", "point", "flat"};
static float deposited[MOST_SAMPLES], splatted[MOST_SAMPLES];
static const double lump_width = 0.28;

/* A lump of gas whose second derivatives are at most 1 / lump_width^2, in the middle. */
static double lump(const void *user, const double p[3]) {
    (void)user;
    return exp(-0.5 * vec_dot(p, p) / (lump_width * lump_width));
}
static const check_field lump_field = {lump, NULL, {0, 0, 0}, {{0, 0, 0}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}}};

/* Gas in voxels of 0.5 to 0.8 samples: a lump whose voxels are upright, turned, or sheared, and in a point light's
   sheets; and gas up to its faces, in voxels of a twelfth of a slab, in two chunks of slabs. */
static void start_deposit(check_scene *s, int kind) {
    static const double axes[2][3][3] = {{{1.6, 1.2, 0}, {-0.96, 1.28, 1.2}, {0.72, -0.96, 1.6}},
                                         {{2, 0, 0}, {1, 2, 0.3}, {0.2, -0.4, 1.8}}};
    sps_volume *volume;
    check_clear(s, SIDE, SIDE);
    volume = check_add_volume(s, 40, 40, 40, check_box(-1, -1, -1, 1, 1, 1));
    volume->eval_fn = check_eval_field, volume->user = (void *)(size_t)&lump_field;
    if (kind == 4) {
        volume->size[0] = volume->size[1] = 24, volume->size[2] = 217; /* bricks end just before the second chunk */
        volume->placement = check_box(-1, -1, -1.4, 1, 1, 1.4);
        volume->eval_fn = NULL, volume->read_fn = check_read_constant, volume->user = (void *)(size_t)&one;
    }
    for (int k = 0; k < 3 && (kind == 1 || kind == 2); ++k)
        for (int i = 0; i < 3; ++i) {
            volume->placement.axis[k][i] = axes[kind - 1][k][i];
            volume->placement.origin[i] -= 0.5 * axes[kind - 1][k][i] - (k == i ? 1 : 0);
        }
    volume->extinction = 3;
    check_color(volume->albedo, 0.5, 0.5, 0.5);
    check_add_directional(s, 0, 0, -1, 1);
    if (kind == 3) s->scene.light_count = 0, check_add_point(s, 4, -5, 6, 80);
    s->view.scattering = kind == 3 ? SPS_SCATTERING_CONVOLUTION : SPS_SCATTERING_MULTIPLE;
    s->view.scattering_resolution = kind == 4 ? 9 : kind == 1 ? 24 : kind > 1 ? 18 + kind : 14;
}

/* Samples gas with the rays and slabs of sheets that were filled before. */
static void sample_gas(const spsi_sampling *as, int deposit, float *out) {
    static spsi_sampling sheets;
    const size_t width = (size_t)as->rays.width, count = width * (size_t)(as->rays.height * as->slabs.count);
    memset(&sheets, 0, sizeof sheets);
    sheets.rays = as->rays, sheets.slabs = as->slabs;
    memset(out, 0, MOST_SAMPLES * sizeof *out);
    if (!CHECK(count <= MOST_SAMPLES) || !CHECK_OK(context, spsi_sampling_begin(context, as->target.frame, &sheets)))
        return;
    CHECK(sheets.target.splatters[0].deposits == 1);
    sheets.target.splatters[0].deposits = deposit;
    for (int chunk = 0; chunk < spsi_chunk_count(&sheets.slabs); ++chunk) {
        spsi_contents_advance(&sheets.contents, chunk);
        spsi_contents_bin_particles(&sheets.contents);
        for (int i = 0; i < spsi_sampling_task_count(&sheets); ++i) {
            spsi_tile tile;
            const int slabs = spsi_sampling_tile(&sheets, i, 0, &tile);
            for (int k = 0; k < slabs; ++k)
                for (int y = tile.y0; y <= tile.y1; ++y)
                    for (int x = tile.x0; x <= tile.x1; ++x)
                        out[((size_t)(sheets.contents.first_slab + k) * (size_t)as->rays.height + (size_t)y) * width +
                            (size_t)x] = tile.sheets[(size_t)k * tile.sheet_size +
                                                     (size_t)((y - tile.y0) * tile.pitch + x - tile.x0)];
        }
    }
}

/* The place of a sample's middle, in world units and as t; its volume is the determinant times t^2 in perspective. */
static double sample_place(const spsi_sampling *sheets, size_t sample, double point[3]) {
    const spsi_rays *rays = &sheets->rays;
    const size_t row = sample / (size_t)rays->width;
    const double x = (double)(sample % (size_t)rays->width), y = (double)(row % (size_t)rays->height);
    const double from = vec_dot(sheets->slabs.normal, rays->origin), *c = rays->c;
    const double s =
        sheets->slabs.start + sheets->slabs.thickness * ((double)(row / (size_t)rays->height) + 0.5) - from;
    double ray[3], t = s / vec_dot(sheets->slabs.normal, c);
    if (rays->perspective) {
        for (int k = 0; k < 3; ++k) ray[k] = c[k] + x * rays->a[k] + y * rays->b[k];
        t = s / vec_dot(sheets->slabs.normal, ray);
        vec_along(rays->origin, ray, t, point);
        return t * t;
    }
    for (int k = 0; k < 3; ++k) point[k] = rays->origin[k] + x * rays->a[k] + y * rays->b[k] + t * c[k];
    return 1;
}

/* The most by which cells of a lump may differ, relative to its middle: half the difference between the variances that
   footprints and deposits add, in world units, times the second derivative. Mixed ones, of which deposits have none,
   are at most 1/e of that. 0.002 is for ripples: of footprints as wide as half a pixel, and of voxels that are turned.
   A quarter is for perspective, whose pixels are wider behind the middle. */
static double deposit_bound(const spsi_sampling *sheets, double *breadth) {
    static const double origin[3] = {0, 0, 0};
    const spsi_splatter *s = &sheets->target.splatters[0];
    const int perspective = sheets->rays.perspective;
    const double pitch = sheets->slabs.thickness;
    double centre[3], ray[3], change[3][3], c[3][3] = {{0}}, sum = 0, unit[3], across, least;
    spsi_project(&sheets->rays, origin, centre);
    for (int axis = 0; axis < 3; ++axis)
        for (int k = 0; k < 3; ++k) {
            const double t = perspective ? centre[2] : 1, along = perspective ? (double)s->step[axis][2] : 0;
            change[axis][k] = k < 2 ? ((double)s->step[axis][k] - centre[k] * along) / t : (double)s->slab_step[axis];
        }
    for (int i = 0; i < 27; ++i)
        c[i / 9][i / 3 % 3] += SPSI_SIGMA * SPSI_SIGMA * change[i % 3][i / 9] * change[i % 3][i / 3 % 3];
    across = 0.5 * (c[0][0] - c[1][1]);
    least = 0.5 * (c[0][0] + c[1][1]) - sqrt(across * across + c[0][1] * c[0][1]);
    unit[0] = unit[1] = vec_length(sheets->rays.a) * (perspective ? centre[2] : 1) / lump_width;
    spsi_ray_direction(&sheets->rays, centre[0], centre[1], ray); /* slabs are crossed along it */
    unit[2] = pitch / lump_width * vec_length(ray) / vec_dot(sheets->slabs.normal, ray);
    *breadth = 0;
    for (int k = 0; k < 3; ++k) {
        const double own = k < 2 ? fmax(0, 0.25 - least) : 1.0 / 12;
        const double square = c[k][k] / (SPSI_SIGMA * SPSI_SIGMA);
        sum += fabs(c[k][k] + own - (2 + square) / 12) * unit[k] * unit[k];
        for (int i = 0; i < k; ++i) sum += 2 * fabs(c[k][i]) / exp(1) * unit[k] * unit[i];
        *breadth = fmax(*breadth, sqrt(square));
    }
    return 0.5 * sum * (perspective ? 1.25 : 1) + 2e-3;
}

/* The largest difference between cells of 2^3 samples, deposited and splatted, and the most that any cell holds. */
static double cell_difference(const spsi_sampling *sheets, double *most) {
    const int width = sheets->rays.width, height = sheets->rays.height;
    double off = 0;
    *most = 0;
    for (int z = 0; z + 2 <= sheets->slabs.count; z += 2)
        for (int y = 0; y + 2 <= height; y += 2)
            for (int x = 0; x + 2 <= width; x += 2) {
                double sums[2] = {0, 0};
                for (int i = 0; i < 8; ++i) {
                    const int at = ((z + (i >> 2)) * height + y + (i >> 1 & 1)) * width + x + (i & 1);
                    sums[0] += (double)deposited[at] / 8;
                    sums[1] += (double)splatted[at] / 8;
                }
                *most = fmax(*most, sums[1]);
                off = fmax(off, fabs(sums[0] - sums[1]));
            }
    return off;
}

/* Voxels that are small against samples are deposited there, as good as splatted. They keep their mass and its first
   moments, to rounding. In perspective, a sample's volume grows as t^2 through the variance of 1/4 that a deposit has
   at most: a share of 3 / 4 (h / t)^2 of mass, and a shift of h^2 / (2 t), if samples are h long. */
static void test_deposits(void) {
    for (int kind = 0; kind < DEPOSITS; ++kind) {
        double sums[4] = {0, 0, 0, 0}, exact_sums[4] = {0, 0, 0, 0}, mass = 0, most = 0, off = 0, bound, breadth;
        double allowed = kind == 4 ? 1e-5 : 1e-6; /* some hundred voxels per sample, or a few */
        const spsi_sampling *sheets;
        check_scene s;
        start_deposit(&s, kind);
        check_render(context, &s, image_a);
        sheets = kind == 3 ? &((const spsi_spread_job *)context->buffers[SPSI_BUFFER_CELL_JOB].data)->sheets
                           : &job_of(context)->sheets;
        sample_gas(sheets, 1, deposited);
        sample_gas(sheets, 0, splatted);
        bound = deposit_bound(sheets, &breadth);
        if (kind == 3) {
            const double t = sheets->slabs.start - vec_dot(sheets->slabs.normal, sheets->rays.origin);
            allowed = pow(sheets->slabs.thickness, 2) * (0.75 / (t * t) + 0.5 / t);
        }
        for (size_t i = 0; i < (size_t)(sheets->rays.width * sheets->rays.height * sheets->slabs.count); ++i) {
            double point[3], volume = sample_place(sheets, i, point);
            volume *= fabs(vec_determinant(sheets->rays.a, sheets->rays.b, sheets->rays.c));
            mass += volume * (double)splatted[i];
            for (int k = 0; k < 4; ++k) sums[k] += volume * (double)deposited[i] * (k < 3 ? point[k] : 1);
        }
        off = cell_difference(sheets, &most);
        for (int i = 0; i < context->brick_count; ++i) {
            const spsi_brick *brick = (const spsi_brick *)context->buffers[SPSI_BUFFER_BRICKS].data + i;
            const spsi_segment *segment = spsi_segment_at(context, brick->segment);
            const spsi_lattice *lattice = &sheets->target.frame->lattices[0];
            for (int n = brick->first; n < brick->first + brick->count; ++n) {
                double at[3], point[3];
                for (int k = 0; k < 3; ++k) at[k] = brick->base[k] + spsi_segment_step(segment, n, k) + 0.5;
                spsi_voxel_position(lattice, at, point);
                for (int k = 0; k < 4; ++k)
                    exact_sums[k] += lattice->voxel_volume * (double)segment->value[n] * (k < 3 ? point[k] : 1);
            }
        }
        if (figures())
            printf("deposited, %s: breadth %.3f, mass %.8f, splatted %.8f, off %.5f of %.5f\n", deposits[kind], breadth,
                   sums[3] / exact_sums[3], mass / exact_sums[3], off / most, bound);
        for (int k = kind == 4 ? 3 : 0; k < 4; ++k) CHECK_NEAR(sums[k], exact_sums[k], allowed * exact_sums[3]);
        if (kind == 4) continue; /* footprints are cut off there */
        CHECK_NEAR(mass, exact_sums[3], 1e-3 * exact_sums[3]);
        CHECK(off > 0 && off < bound * most);
        CHECK(breadth > 0.5 && breadth < (double)SPSI_DEPOSIT_MOST);
    }
}

/* What lights send to each cell, by moment: irradiance / 4 pi, times the harmonics of its direction, times what gas on
   the way leaves. Lights without shadows send nothing. */
static void test_lit(void) {
    static const sps_lobe lobe = {0.8f, 1};
    for (int n = 0; n < 4; ++n) { /* a sun behind others, a sun, a point, a spot, all from above */
        check_scene s;
        sps_volume *volume;
        const spsi_cell_grid *made;
        const spsi_cell_job *job;
        sps_light *light;
        check_clear(&s, SIDE, SIDE);
        volume = check_add_volume(&s, 24, 24, 24, check_box(-1, -1, -1, 1, 1, 1));
        volume->read_fn = check_read_constant, volume->user = (void *)(size_t)&one;
        volume->extinction = 1;
        volume->lobes = &lobe, volume->lobe_count = 1;
        check_color(volume->albedo, 0.9, 0.9, 0.9);
        if (n == 0) check_add_directional(&s, 0, 0, -1, 5)->no_shadow = 1;
        if (n == 0) check_add_directional(&s, 1, 0, 0, 1e-6f); /* the first table is another light's */
        light = n < 2 ? check_add_directional(&s, 0, -1, 0, 2) : check_add_point(&s, 0, 9, 0, 200);
        if (n == 3) light->direction[1] = -1, light->inner_cone = 0.02, light->outer_cone = 0.05;
        s.view.scattering = SPS_SCATTERING_MULTIPLE, s.view.scattering_resolution = 16;
        check_render(context, &s, image_a);
        made = grid_of(context), job = job_of(context);
        CHECK(made->terms == 16);
        for (int i = 0; i < 16 * 16 * 16; ++i) {
            const int cell[3] = {i % 16, i / 16 % 16, i / 256};
            const size_t at = (size_t)(i / 16) * (size_t)made->pitch + (size_t)cell[0];
            const double k = 1 - 0.9 * pow((double)lobe.asymmetry, 4);
            double p[3], way[3], irradiance = 2, depth, distance, cosine;
            float harmonic[SPSI_CELL_TERMS];
            if (cell[0] % 5 || cell[1] % 5 || cell[2] % 5) continue;
            for (int c = 0; c < 3; ++c) {
                p[c] = made->corner[c] + made->edge * (cell[c] + 0.5);
                way[c] = p[c] - (n < 2 ? p[c] : c == 1 ? 9 : 0);
            }
            if (fabs(p[0]) > 0.85 || fabs(p[1]) > 0.85 || fabs(p[2]) > 0.85) continue; /* where gas fades out */
            if (n < 2) way[1] = -1;
            distance = vec_length(way);
            if (n >= 2) irradiance = 200 / (distance * distance);
            vec_normalise(way);
            cosine = -way[1];
            if (n == 3) {
                const double share = (cosine - cos(0.05)) / (cos(0.02) - cos(0.05));
                irradiance *= pow(fmax(0, fmin(share, 1)), 2);
            }
            depth = (1 - p[1]) / cosine;
            spsi_harmonics(way, harmonic);
            for (int t = 0; t < 16; ++t) {
                const size_t moment = (size_t)t * made->count + at;
                const double got = (double)job->incoming[moment] / (4 * (double)made->depth[at]);
                const double given = irradiance / (4 * PI) * (double)harmonic[t];
                const double allowed = n < 2 ? 0.002 : n == 2 ? 0.01 : 0.2;
                if (!CHECK_NEAR(got, given * exp(-k * depth), allowed))
                    printf("    light %d, term %d, at %g %g %g\n", n, t, p[0], p[1], p[2]);
            }
        }
    }
}

/* A floor in even gas below a sun or a lamp, in cells of a depth of 0.58: what gas leaves of the light on the way to
   it, half of the floor's own cell included, without which a third more would arrive. Cells fade over an edge of gas: 5
   %. */
static void test_lit_floor(void) {
    for (int lamp = 0; lamp < 2; ++lamp) {
        int found = 0;
        check_scene s;
        check_triangles floor;
        sps_volume *volume;
        memset(&floor, 0, sizeof floor);
        check_clear(&s, SIDE, SIDE);
        volume = check_add_volume(&s, 24, 24, 24, check_box(-1, -1, -1, 1, 1, 1));
        volume->read_fn = check_read_constant, volume->user = (void *)(size_t)&one;
        volume->extinction = 4;
        check_color(volume->albedo, 0.1, 0.1, 0.1);
        const double corner[3] = {-2, -0.3, -2}, u[3] = {0, 0, 4}, v[3] = {4, 0, 0};
        check_add_quad(&floor, corner, u, v);
        check_add_mesh(&s, &floor, 0.5);
        if (lamp) check_add_point(&s, 0, 40, 0, 2 * 40.3 * 40.3);
        if (!lamp) check_add_directional(&s, 0, -1, 0, 2);
        s.view.scattering = SPS_SCATTERING_MULTIPLE, s.view.scattering_resolution = 16;
        check_render(context, &s, image_a);
        const spsi_cell_grid *made = grid_of(context);
        for (int i = 0; i < 16 * 16 * 16; ++i) {
            const int cell[3] = {i % 16, i / 16 % 16, i / 256};
            const spsi_cell_wall *wall =
                &job_of(context)->walls[(size_t)(i / 16) * (size_t)made->pitch + (size_t)cell[0]];
            const double above = made->corner[1] + made->edge * (cell[1] + 0.5) + 0.3;
            if (!wall->closed || !(above > 0) || above > made->edge) continue;
            if (abs(2 * cell[0] - 15) > 8 || abs(2 * cell[2] - 15) > 8) continue; /* where gas fades out */
            CHECK_NEAR((double)wall->lit[0], 0.5 * 2 / PI * exp(-4 * 1.3), 0.05 * 0.5 * 2 / PI * exp(-4 * 1.3));
            found += 1;
        }
        CHECK(found > 30);
        check_free_triangles(&floor);
    }
}

enum { RODS = 96, ROD = 2, CELLS_ALONG = 11 }; /* voxels along the box, and across a rod; cells along the box */

/* Value 1 in the rods of the upper half, of which there is one every 2 * ROD voxels along x, 0 between them, and 0.2
   below. */
static int read_rods(void *user, const int lo[3], const int size[3], float *out) {
    (void)user;
    for (int i = 0; i < size[0] * size[1] * size[2]; ++i) {
        const int x = lo[0] + i % size[0], y = lo[1] + i / size[0] % size[1];
        out[i] = y < RODS / 2 ? 0.2f : x / ROD % 2 ? 1.0f : 0.0f;
    }
    return 0;
}

/* Light of a sun above rods of optical depth 1 that are narrower than texels of its table, 4.4 voxels. What rods are in
   the mean, 0.5, is transparent, but a texel's ray meets one or not: a share of them, those where the value is above
   0.65. Across rods it is 0.5 + 0.378 cosine, the first harmonic of a square wave that the kernel has blurred. Between
   texels, optical depth is interpolated, by which light is at least what the mean leaves. Rays meet rods at eleven
   places, of which one may be wrong. Gas below has a depth of up to 0.05. */
static void test_lit_behind_rods(void) {
    static const sps_transfer_point points[] = {{0, {1, 1, 1}, 0, {0, 0, 0}},    {0.2f, {1, 1, 1}, 0.05f, {0, 0, 0}},
                                                {0.3f, {1, 1, 1}, 0, {0, 0, 0}}, {0.6f, {1, 1, 1}, 0, {0, 0, 0}},
                                                {0.7f, {1, 1, 1}, 1, {0, 0, 0}}, {1, {1, 1, 1}, 1, {0, 0, 0}}};
    static const sps_transfer rods = {points, 6, NULL, NULL, 0};
    const double share = acos((0.65 - 0.5) / 0.378) / PI, wrong = 1 / 11.0 * (1 - exp(-1));
    for (int filling = SPS_FILLING_AUTO; filling <= SPS_FILLING_GATHER; ++filling) {
        double light = 0, gas = 0;
        check_scene s;
        sps_volume *volume;
        check_clear(&s, SIDE, SIDE);
        volume = check_add_volume(&s, RODS, RODS, RODS, check_box(-1, -1, -1, 1, 1, 1));
        volume->read_fn = read_rods;
        volume->transfer = &rods;
        check_add_directional(&s, 0, -1, 0, 2);
        s.view.scattering = SPS_SCATTERING_MULTIPLE, s.view.scattering_resolution = CELLS_ALONG;
        s.view.filling = (sps_filling)filling;
        check_render(context, &s, image_a);
        for (int i = 0; i < CELLS_ALONG * CELLS_ALONG * CELLS_ALONG; ++i) {
            const int x = i % CELLS_ALONG, y = i / CELLS_ALONG % CELLS_ALONG, z = i / (CELLS_ALONG * CELLS_ALONG);
            const size_t at = (size_t)(i / CELLS_ALONG) * (size_t)grid_of(context)->pitch + (size_t)x;
            if (y == 0 || y > 2 || x == 0 || x == CELLS_ALONG - 1 || z == 0 || z == CELLS_ALONG - 1) continue;
            light += (double)job_of(context)->incoming[at];
            gas += 4 * (double)grid_of(context)->depth[at];
        }
        light /= gas * 2 / (4 * PI);
        if (figures()) printf("filling %d: %.3f of light behind rods\n", filling, light);
        CHECK(light >= exp(-share - 0.05) - wrong && light <= 1 - share * (1 - exp(-1)) + wrong);
    }
}

/* Gas takes no more light than comes in: what crosses its section, at most a circle of radius 0.95, and 3 % for the
   corners of cells. It takes half at least: of the deepest gas, whose rim is thinner than a sample, neighbours between
   which rays are interpolated hide up to 45 % at 12 cells, known to be wrong. */
static void test_deep(void) {
    static const double extinctions[] = {10, 100, 400, 3000, 1e6};
    for (int n = 0; n < 2 * 5; ++n) {
        double in = 0;
        check_scene s;
        start_plain(&s, LIGHTS);
        check_add_directional(&s, 0.2, -1, 0.3, 1);
        s.volume[0].extinction = (float)extinctions[n / 2];
        s.volume[0].lobes = &forward, s.volume[0].lobe_count = n % 2;
        check_render(context, &s, image_a);
        for (size_t i = 0; i < grid_of(context)->count; ++i)
            in += (double)job_of(context)->incoming[i] * PI * pow(grid_of(context)->edge, 2);
        in *= (double)grid_of(context)->scale[0]; /* sharp lobes: what goes straight on is taken again */
        if (figures()) printf("extinction %g, g %d: takes %.3f\n", extinctions[n / 2], n % 2, in);
        CHECK(in > 0.5 * PI * 0.95 * 0.95);
        CHECK_CASE("Found in review", "light that gas takes, in cells of a depth of 1 to 1e5", "no more than comes in",
                   in / (PI * 0.95 * 0.95), 1.03, "corners of cells, 3 %");
    }
}

/* Lookups are linear between cells' centres, and constant beyond the outermost. */
static void test_lookups(void) {
    float seen[4 * 8 * 3 * 4], out[SPSI_LANES];
    check_random random = {4};
    spsi_cell_grid small;
    memset(&small, 0, sizeof small);
    small.size[0] = 5, small.size[1] = 3, small.size[2] = 4;
    small.pitch = 8, small.count = 8 * 3 * 4, small.channels = 2, small.seen = seen;
    for (int c = 0; c < 2; ++c)
        for (int i = 0; i < 96; ++i) seen[4 * i + c] = (float)(c + i % 8 + 10 * (i / 8 % 3) + 100 * (i / 24));
    for (int n = 0; n < 200; ++n) {
        double p[3], inside[3];
        spsi_v at[3], four[4];
        for (int k = 0; k < 3; ++k) {
            p[k] = (double)(float)(8 * check_next(&random) - 2);
            inside[k] = fmax(0, fmin(p[k], small.size[k] - 1));
            at[k] = spsi_set((float)p[k]);
        }
        spsi_cells_lookup(&small, 0, at, 1, four);
        spsi_store(out, four[n % 2]);
        CHECK_NEAR((double)out[0], n % 2 + inside[0] + 10 * inside[1] + 100 * inside[2], 1e-3);
    }
}

/* An empty cell beside gas shows what gas would show there, if it went on as it goes: linearly, and never below 0. */
static void test_continued(void) {
    float seen[4 * 8 * 3 * 3] = {0}, depth[8 * 3 * 3 + SPSI_LANES] = {0};
    const int middle_cell[3] = {3, 1, 1}, corner_cell[3] = {0, 0, 0};
    const int here = 3 + 8 + 24;
    spsi_cell_grid small;
    memset(&small, 0, sizeof small);
    small.size[0] = 7, small.size[1] = small.size[2] = 3;
    small.pitch = 8, small.count = 72, small.depth = depth;
    CHECK_NEAR((double)spsi_cells_extrapolated(&small, seen, middle_cell), 0, 0);
    depth[here + 1] = 1, seen[4 * (here + 1)] = 3; /* one cell only */
    CHECK_NEAR((double)spsi_cells_extrapolated(&small, seen, middle_cell), 3, 0);
    depth[here + 2] = 1, seen[4 * (here + 2)] = 1;
    CHECK_NEAR((double)spsi_cells_extrapolated(&small, seen, middle_cell), 5, 0);
    seen[4 * (here + 2)] = 7;
    CHECK_NEAR((double)spsi_cells_extrapolated(&small, seen, middle_cell), 0, 0);
    depth[here - 8] = 1, seen[4 * (here - 8)] = 5; /* at the grid's end: as it is */
    CHECK_NEAR((double)spsi_cells_extrapolated(&small, seen, middle_cell), 2.5, 0);
    depth[24] = 1, seen[4 * 24] = 6;
    CHECK_NEAR((double)spsi_cells_extrapolated(&small, seen, corner_cell), 6, 0);
}

/* What is rendered continues in that way: into all empty cells beside gas, and no others. */
static void test_continued_in_scene(void) {
    int beside = 0;
    check_scene s;
    const spsi_cell_grid *made;
    start_plain(&s, SUN);
    check_render(context, &s, image_a);
    made = grid_of(context);
    for (int i = 0; i < made->size[0] * made->size[1] * made->size[2]; ++i) {
        const int at[3] = {i % made->size[0], i / made->size[0] % made->size[1], i / (made->size[0] * made->size[1])};
        const size_t cell = (size_t)(i / made->size[0]) * (size_t)made->pitch + (size_t)at[0];
        if (made->depth[cell] > 0) continue;
        CHECK_NEAR((double)made->seen[4 * cell], (double)spsi_cells_extrapolated(made, made->seen, at), 0);
        beside += made->seen[4 * cell] > 0;
    }
    CHECK(beside > 20);
}

/* --- energy --- */

/* Before a white sky, a cloud that absorbs nothing cannot be seen, whatever its lobes; with an absorber it is darker.
 */
static void test_white_sky(void) {
    static const double all[] = {0, 0.5, 0.85, -0.3};
    for (int n = 0; n < 4 * 3; ++n) {
        const sps_lobe lobe = {(float)all[n % 4], 1};
        double least = HUGE_VAL, most = 0;
        check_scene s;
        start(&s, GAS, LIGHTS);
        s.volume[0].lobes = &lobe, s.volume[0].lobe_count = 1;
        s.volume[0].extinction = n / 4 == 1 ? 100 : 1; /* ultra: rays end where 5e-5 of light would pass */
        s.view.quality = SPS_QUALITY_ULTRA;
        check_color(s.volume[0].albedo, 1, 1, 1);
        if (n / 4 == 2) check_color(s.volume[0].albedo, 0.9, 0.99, 0.5);
        check_color(s.scene.ambient, 2, 2, 2);
        check_color(s.scene.background, 2, 2, 2);
        check_render(context, &s, image_a);
        for (int i = 0; i < COUNT; ++i)
            if (i % 4 < 3) least = fmin(least, (double)image_a[i]), most = fmax(most, (double)image_a[i]);
        if (!CHECK_CASE("Scattering", "cloud of albedo 1 or less before a white sky", "never brighter than the sky",
                        most - 2, 2e-5, "sums of floats") ||
            !CHECK(n / 4 == 2 ? least > 0.1 && least < 1.8 : least >= 2 - (n / 4 ? 1.2e-4 : 2e-5)))
            printf("    g %g, kind %d: %g..%g\n", all[n % 4], n / 4, least, most);
    }
    { /* gas that only absorbs, in the midst of it */
        check_scene s;
        start_plain(&s, LIGHTS);
        add_gas(&s);
        s.volume[1].size[0] = 12;
        s.volume[1].placement = check_box(-0.3, -0.3, -0.3, 0.3, 0.3, 0.3);
        check_color(s.volume[1].albedo, 0, 0, 0);
        check_color(s.scene.ambient, 1, 1, 1);
        check_color(s.scene.background, 1, 1, 1);
        check_render(context, &s, image_a);
        for (int i = 0; i < COUNT; ++i)
            if (i % 4 < 3) CHECK(image_a[i] <= 1 + 1e-5f && image_a[i] > 0);
        CHECK((double)image_a[4 * (SIDE / 2 * SIDE + SIDE / 2)] < 0.97);
    }
}

/* The same in 1, 8, 64 and 512 sheets: what each sheet hides of the sky it must scatter, to float round-off. */
static void test_white_sky_in_sheets(void) {
    static const int sheets[] = {1, 8, 64, 512};
    for (int n = 0; n < 4; ++n) {
        double whole, worst = 0;
        sps_stats_report stats;
        check_scene s;
        start_plain(&s, LIGHTS);
        s.view.quality = SPS_QUALITY_ULTRA; /* rays end where 5e-5 of light would pass */
        s.view.width = s.view.height = 8;
        check_color(s.scene.ambient, 1, 1, 1);
        check_color(s.scene.background, 1, 1, 1);
        s.view.slab_thickness = 1;
        check_render(context, &s, image_a);
        sps_get_stats(context, &stats);
        whole = (double)stats.slabs;
        s.view.slab_thickness = whole / sheets[n];
        check_render(context, &s, image_a);
        sps_get_stats(context, &stats);
        CHECK_NEAR((double)stats.slabs, sheets[n], 1 + sheets[n] / whole);
        for (int i = 0; i < 4 * 64; ++i)
            if (i % 4 < 3) worst = fmax(worst, fabs((double)image_a[i] - 1));
        CHECK_CASE("Scattering", "cloud of albedo 1 before a white sky, in 1, 8, 64 and 512 sheets",
                   "reflected and transmitted light add up to 1", worst, 2e-5 + 5e-5 + sheets[n] * 6e-8,
                   "sums of floats, of each sheet, too; rays end at 5e-5");
    }
}

/* The depth at value 1 that light has yet to pass in the puff, on average, from where it has scattered: a place as
   likely as the gas is dense, a random direction. 2e5 of them, whose depths spread by as much as their mean: 0.5 %
   twice over. */
static double depth_to_pass(void) {
    check_random random = {17};
    double sum = 0, weights = 0;
    for (int i = 0; i < 200000; ++i) {
        double p[3], w[3], q[3], value, z = 2 * check_next(&random) - 1, turn = 2 * PI * check_next(&random);
        for (int k = 0; k < 3; ++k) p[k] = 2 * check_next(&random) - 1;
        w[0] = sqrt(1 - z * z) * cos(turn), w[1] = sqrt(1 - z * z) * sin(turn), w[2] = z;
        value = puff_field.value_fn(puff_field.user, p);
        vec_along(p, w, 2 * check_next(&random), q);
        for (int k = 0; k < 3; ++k)
            if (fabs(q[k]) > 1)
                break;
            else if (k == 2)
                sum += 2 * value * puff_field.value_fn(puff_field.user, q);
        weights += value;
    }
    return sum / weights;
}

/* What a volume shows as surface receives no light that gas has scattered: where all that is seen is surface, light
   from cell to cell adds nothing. What there is, some of it, is of the last gas before surfaces begin. */
static void test_nothing_for_surfaces(void) {
    for (int light = SUN; light <= BEHIND; light += BEHIND - SUN) {
        check_scene s;
        double without;
        start(&s, CLASSIFIED, SUN);
        s.volume[0].shading = SPS_SHADING_SURFACE, s.volume[0].gradient_full = 1e-4f;
        if (light == BEHIND) s.light[0].direction[2] = 0.3;
        check_render(context, &s, image_a);
        CHECK(cells_made(context) > 0);
        s.view.scattering = SPS_SCATTERING_SINGLE;
        check_render(context, &s, image_b);
        without = mean_of(image_b, PIXELS);
        if (figures()) printf("surfaces amid cells: %.5f, without %.5f\n", mean_of(image_a, PIXELS), without);
        CHECK(mean_of(image_a, PIXELS) <= 1.02 * without);
        s.volume[0].shading = SPS_SHADING_GAS, s.view.scattering = SPS_SCATTERING_MULTIPLE;
        check_render(context, &s, image_a);
        s.view.scattering = SPS_SCATTERING_SINGLE;
        check_render(context, &s, image_b);
        if (figures())
            printf("gas amid cells: %.5f, without %.5f\n", mean_of(image_a, PIXELS), mean_of(image_b, PIXELS));
        CHECK(mean_of(image_a, PIXELS) > 1.2 * mean_of(image_b, PIXELS)); /* it is there to be added */
    }
}

/* Ambient light alone on a ball of surface, which shades itself. The formula is for flat ones, and 1.4 % off. A skin of
   three of the radius's ten voxels also gets light from up to acos(0.7) below its horizon: 10 % of its own. */
static void test_ambient_on_surfaces(void) {
    static const float depths[] = {40, 4, 0.5f, 40};
    for (int n = 0; n < 4; ++n) {
        sps_transfer_point points[] = {{0.2f, {0.8f, 0.6f, 0.4f}, 0, {0, 0, 0}},
                                       {0.5f, {0.8f, 0.6f, 0.4f}, 0, {0, 0, 0}}};
        const sps_transfer skin = {points, 2, NULL, NULL, 1};
        check_scene s;
        char name[80];
        start_plain(&s, SUN);
        points[1].extinction = depths[n];
        s.volume[0].transfer = &skin, s.volume[0].classify_voxels = n == 3;
        s.volume[0].shading = SPS_SHADING_SURFACE, s.volume[0].gradient_full = 1e-4f;
        s.scene.light_count = 0;
        s.view.quality = SPS_QUALITY_HIGH;
        check_color(s.scene.ambient, 1, 0.8, 0.5);
        snprintf(name, sizeof name, "ambient light on a surface of extinction %g, %d", (double)depths[n], n == 3);
        check_paths(context, &s, name, n == 3 ? 200 : 60, 0.1);
    }
}

/* Where nothing scatters nothing is followed; thin gas scatters next to nothing again. If it scatters evenly, that is,
   of what scatters once, the albedo times the depth that this has yet to pass, if both shade by the same. Cells are 1/6
   wide, a fifth of the puff's radius. */
static void test_little(void) {
    const double again = 1e-3 * depth_to_pass();
    for (int kind = 0; kind < 4; ++kind)
        for (int light = SUN; light <= BEHIND; ++light) {
            double found;
            check_scene s;
            start(&s, GAS, light);
            if (kind < 3) check_color(s.scene.ambient, 0.5, 0.5, 0.5);
            if (kind == 0) check_color(s.volume[0].albedo, 0, 0, 0);
            if (kind > 0) s.volume[0].extinction = 1e-3f;
            if (kind == 2) s.volume[0].lobes = &forward, s.volume[0].lobe_count = 1;
            if (kind == 3) s.volume[0].lobe_count = 0, s.light[0].shadow_source = SPS_SHADOW_SHEETS;
            check_render(context, &s, image_a);
            CHECK((cells_made(context) == 0) == (kind == 0));
            s.view.scattering = SPS_SCATTERING_SINGLE;
            check_render(context, &s, image_b);
            if (kind == 0)
                CHECK_CASE("Scattering", "albedo 0, from cell to cell", "that of scattering off",
                           !same(image_a, image_b), 0, "same bits");
            if (kind == 0) continue;
            if (figures()) printf("thin: %.2g of the light is other\n", error_of(image_a, image_b, PIXELS));
            CHECK(!same(image_a, image_b) && error_of(image_a, image_b, PIXELS) < (kind == 2 ? 0.01 : 2e-3));
            for (int c = 0; c < 3 && kind == 3; ++c) {
                double sum[2] = {0, 0};
                for (int i = c; i < COUNT; i += 4) sum[0] += (double)image_a[i], sum[1] += (double)image_b[i];
                found = (sum[0] / sum[1] - 1) / (double)s.volume[0].albedo[c];
                if (figures()) printf("again: %.3g of %.3g\n", found, again);
                CHECK_NEAR(found, again, 0.2 * again);
            }
        }
}

/* --- symmetries --- */

static void add_images(float *to, const float *more) {
    for (int i = 0; i < COUNT; ++i)
        if (i % 4 < 3) to[i] += more[i];
}

/* Light adds up, as far as the solver's balance goes, and its scale is free. */
static void test_linear(void) {
    check_scene s;
    start(&s, GAS, SUN);
    s.light[0].shadow_source = SPS_SHADOW_TABLE;
    add_light(&s, POINT);
    s.light[1].shadow_source = SPS_SHADOW_TABLE;
    check_render(context, &s, image_c);
    s.scene.light_count = 1;
    check_render(context, &s, image_a);
    for (int c = 0; c < 3; ++c) s.light[0].color[c] *= 1024;
    check_render(context, &s, image_b);
    for (int i = 0; i < COUNT; ++i) CHECK_NEAR((double)image_b[i], (i % 4 < 3 ? 1024 : 1) * (double)image_a[i], 0);
    s.light[0] = s.light[1];
    check_render(context, &s, image_b);
    add_images(image_a, image_b);
    if (figures()) printf("two lights: off by %.2g\n", error_of(image_a, image_c, PIXELS));
    CHECK(error_of(image_a, image_c, PIXELS) < 2e-4);
}

/* A light without shadows scatters once in gas. Alone, it needs no cells, unless there are polygons, and none but those
   that reflect it change the picture. Beside a light with shadows, it adds what it shows alone: within floats, or
   SPSI_CELL_CHANGE of what polygons send, which the cells may leave out; less than a fifth is in the picture. */
static void test_unshadowed(void) {
    static const double corner[3] = {-2, -1, -2}, u[3] = {4, 0, 0}, v[3] = {0, 0, 4};
    static const int of[] = {UNSHADOWED, POINT, SPOT};
    enum { OPEN, BLACK, GREY, FLOORS };
    for (int n = 0; n < 3 * FLOORS; ++n) {
        const int ground = n % FLOORS;
        double off;
        sps_plan_report report;
        check_scene s;
        start(&s, GAS, of[n / FLOORS]);
        s.volume[0].lobes = &forward, s.volume[0].lobe_count = 1;
        s.light[0].no_shadow = 1;
        if (s.light[0].outer_cone > 0) s.light[0].inner_cone = 0.02, s.light[0].outer_cone = 0.04; /* a narrow beam */
        plate.count = 0;
        check_add_quad(&plate, corner, u, v);
        if (ground != OPEN) check_add_mesh(&s, &plate, ground == GREY ? 0.7 : 0);
        s.view.scattering = SPS_SCATTERING_SINGLE;
        check_render(context, &s, image_b);
        s.view.scattering = SPS_SCATTERING_MULTIPLE;
        check_render(context, &s, image_a);
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &report));
        CHECK(report.pass[SPS_PASS_CELLS].runs == (ground != OPEN) && report.pass[SPS_PASS_FORWARD].runs == 0);
        if (ground == OPEN) {
            CHECK(strcmp(report.pass[SPS_PASS_CELLS].reason, "no light casts shadows") == 0);
            CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
        }
        if (ground == BLACK) CHECK(error_of(image_a, image_b, PIXELS) < 2e-6);
        if (ground == GREY) CHECK(error_of(image_a, image_b, PIXELS) > 0.01);
        add_light(&s, BEHIND);
        s.light[1].shadow_source = SPS_SHADOW_TABLE; /* the same slabs as without it */
        check_render(context, &s, image_c);
        if (ground != OPEN) CHECK(grid_of(context)->light_count == 1 && grid_of(context)->lights[0].index == 1);
        s.light[0] = s.light[1], s.scene.light_count = 1;
        check_render(context, &s, image_b);
        add_images(image_a, image_b);
        off = error_of(image_a, image_c, PIXELS);
        if (figures())
            printf("%s, unshadowed, floor %d, beside a sun: off by %.2g\n", lights[of[n / FLOORS]], ground, off);
        CHECK(off < (ground == GREY ? 0.2 * SPSI_CELL_CHANGE : 2e-6));
    }
}

/* v becomes its products with the rows. */
/* Which of two gases comes first does not matter: they scatter differently, into the same cells. Sums are rounded
   otherwise. */
static void test_swapped(void) {
    check_scene s;
    start(&s, TWO_GASES, SUN);
    check_render(context, &s, image_a);
    const sps_volume first = s.volume[0];
    s.volume[0] = s.volume[1], s.volume[1] = first;
    check_render(context, &s, image_b);
    for (int i = 0; i < COUNT; ++i) CHECK_NEAR((double)image_b[i], (double)image_a[i], 1e-5);
}

static void turn(const double rows[3][3], double v[3]) {
    double out[3];
    for (int i = 0; i < 3; ++i) out[i] = vec_dot(rows[i], v);
    check_set3(v, out[0], out[1], out[2]);
}

/* A scene that is mirrored or turned as a whole shows the same, mirrored where the camera is not. Of a lamp within,
   what the nearest cells receive is a mean along z, but not across it. */
static void test_turned(void) {
    static const double ways[][3][3] = {{{-1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, /* mirrored */
                                        {{0, -1, 0}, {1, 0, 0}, {0, 0, 1}}, /* about z */
                                        {{1, 0, 0}, {0, 0, -1}, {0, 1, 0}}, /* about x */
                                        {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}}}; /* x, y, z in turn */
    for (int n = 0; n < 4 * 2; ++n) {
        const double(*rows)[3] = ways[n % 4];
        double off;
        check_scene s;
        if (!check_long() && (n + n / 4) % 2) continue; /* mirrored and about x; about z and in turn */
        start(&s, GAS, n < 4 ? SUN : WITHIN);
        s.light[0].shadow_source = SPS_SHADOW_TABLE;
        s.view.camera.up[1] = 1;
        s.view.quality = SPS_QUALITY_HIGH;
        if (n < 4) s.volume[0].lobes = &forward, s.volume[0].lobe_count = 1;
        check_render(context, &s, image_b);
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < 3; ++k) look_rows[i][k] = rows[k][i];
        turn(rows, s.view.camera.position), turn(rows, s.view.camera.up);
        turn(rows, s.light[0].direction), turn(rows, s.light[0].position);
        check_render(context, &s, image_a);
        if (n % 4 == 0) {
            for (int i = 0; i < COUNT; ++i)
                image_c[i] = image_a[i / (4 * SIDE) * 4 * SIDE + 4 * (SIDE - 1 - i / 4 % SIDE) + i % 4];
            memcpy(image_a, image_c, sizeof image_a);
        }
        off = error_of(image_a, image_b, PIXELS);
        if (figures()) printf("turned by way %d, %s: off by %.2g\n", n % 4, n < 4 ? "sun" : "lamp", off);
        if (!CHECK(off < (n < 6 ? 2e-3 : 0.2))) printf("    way %d, light %d: %g\n", n % 4, n / 4, off);
    }
}

/* The unit of length is free. */
static void test_scaled(void) {
    static const double scales[] = {1e6, 1e-6, 0.3};
    for (int light = SUN; light <= POINT; light += POINT - SUN)
        for (int n = 0; n < 3; ++n) {
            const double scale = scales[n];
            check_scene s;
            start(&s, GAS, light);
            check_render(context, &s, image_b);
            for (int i = 0; i < 3; ++i) {
                s.view.camera.position[i] *= scale;
                s.light[0].position[i] *= scale;
                s.volume[0].placement.origin[i] *= scale;
                for (int k = 0; k < 3; ++k) s.volume[0].placement.axis[i][k] *= scale;
                if (light == POINT) s.light[0].color[i] *= (float)(scale * scale);
                look_rows[i][i] = 1 / scale;
            }
            s.volume[0].extinction /= (float)scale;
            check_render(context, &s, image_a);
            if (!CHECK(error_of(image_a, image_b, PIXELS) < 1e-3))
                printf("    %s, scale %g: %g\n", lights[light], scale, error_of(image_a, image_b, PIXELS));
        }
}

/* --- against random paths --- */

enum { CLOUD = 32 };
static float cloud[CLOUD * CLOUD * CLOUD];

/* A cloud of an optical depth of about 10, of albedo 1. */
static void start_cloud(check_scene *s, const sps_lobe *lobes, int lobe_count, int view) {
    static const double directions[6][3] = {{0.3, 0.1, 1}, {1, 0.2, 0},  {0.3, -0.4, -1},
                                            {0.02, 0, 1},  {0, -1, 0.1}, {-0.6, 0.7, 0.5}};
    static check_array array = {cloud, {CLOUD, CLOUD, CLOUD}, 0, 0};
    sps_volume *volume;
    check_lumps(cloud, CLOUD);
    check_clear(s, SIDE, SIDE);
    s->view.camera.ortho_height = 1.4;
    volume = check_add_volume(s, CLOUD, CLOUD, CLOUD, check_box(-1, -1, -1, 1, 1, 1));
    volume->read_fn = check_read_array, volume->user = &array;
    volume->extinction = 10;
    volume->lobes = lobes, volume->lobe_count = lobe_count;
    check_color(volume->albedo, 1, 1, 1);
    check_add_directional(s, directions[view][0], directions[view][1], directions[view][2], 1);
    s->view.scattering = SPS_SCATTERING_MULTIPLE;
}

static const char *const cloud_views[] = {"from behind",       "aside",      "from the front",
                                          "towards the light", "from above", "from below, behind"};

/* --- sharpening --- */

/* Means over entries of x^2 + 2 y^2 - z^2 + 30 exceed it by a 24th of the second differences 2, 4 and -2, and its
   linear interpolation does by a 12th in the mean: sharpened by an 8th, the mean is that of the parabola. */
static void test_sharpened(void) {
    static const size_t step[3] = {1, 5, 25};
    static const int size[3] = {5, 5, 5}, corner[3] = {0, 4, 0};
    float means[125];
    int at[3];
    for (int i = 0; i < 125; ++i) {
        const int x = i % 5, y = i / 5 % 5, z = i / 25;
        means[i] = (float)(x * x + 2 * y * y - z * z + 30 + 4 / 24.0);
    }
    for (at[2] = 1; at[2] < 4; ++at[2])
        for (at[1] = 1; at[1] < 4; ++at[1])
            for (at[0] = 1; at[0] < 4; ++at[0]) {
                float *here = &means[at[0] + 5 * at[1] + 25 * at[2]], kept = here[1];
                const double exact = at[0] * at[0] + 2 * at[1] * at[1] - at[2] * at[2] + 30 - 4 / 12.0;
                CHECK_NEAR((double)spsi_sharpened(here, step, size, at, 0.125f, 9), exact, 1e-5);
                CHECK_NEAR((double)spsi_sharpened(here, step, size, at, 0.125f, 0.25f), (double)*here - 0.25, 1e-5);
                CHECK_NEAR((double)spsi_sharpened(here, step, size, at, -0.125f, 0.25f), (double)*here + 0.25, 1e-5);
                here[1] = 0; /* y and z remain */
                CHECK_NEAR((double)spsi_sharpened(here, step, size, at, 0.125f, 9), (double)*here - 2 / 8.0, 1e-5);
                here[1] = kept;
                CHECK(spsi_sharpened(here, step, size, at, 100, HUGE_VALF) == 0);
            }
    CHECK(spsi_sharpened(&means[20], step, size, corner, 0.125f, 9) == means[20]);
}

/* Coarse cells beside fine ones: pixels' rms, in % of their mean, as measured and 2 % of that. Without sharpening what
   the eye sees it is 2.7 times that, and without sharpening samples it is 5 % more. */
static void test_coarse(void) {
    static const struct {
        int view;
        double most;
    } cases[] = {{1, 2.56}, {2, 1.94}, {5, 2.31}};
    for (int n = 0; n < 3; ++n) {
        double squares = 0, sum = 0;
        check_scene s;
        start_cloud(&s, NULL, 0, cases[n].view);
        s.view.scattering_resolution = 48;
        check_render(context, &s, image_a);
        s.view.scattering_resolution = 16;
        check_render(context, &s, image_b);
        for (int i = 0; i < COUNT; ++i) {
            if (i % 4 == 3) continue;
            squares += pow((double)image_b[i] - (double)image_a[i], 2);
            sum += (double)image_a[i];
        }
        const double error = 100 * sqrt(squares / (3 * PIXELS)) / (sum / (3 * PIXELS));
        if (figures()) printf("16 cells, %s: %.2f %%\n", cloud_views[cases[n].view], error);
        CHECK(error < cases[n].most);
    }
}

/* From behind, aside and in front: means of pictures. */
static void test_clouds(void) {
    for (int n = 0; n < 9; ++n) {
        const sps_lobe *const all[] = {NULL, &middle, &forward};
        char name[64];
        check_scene s;
        if (!check_long() && n % 4) continue; /* each direction and each lobe once */
        start_cloud(&s, all[n / 3], n / 3 > 0, n % 3);
        s.view.quality = SPS_QUALITY_HIGH;
        s.view.scattering_resolution = check_long() ? 64 : 32;
        snprintf(name, sizeof name, "cloud, g %g, %s", n < 3 ? 0 : (double)all[n / 3]->asymmetry, cloud_views[n % 3]);
        check_paths(context, &s, name, 20, 0.05);
    }
}

/* The rms error of pixels in units of their mean, less what the paths' own noise has in it. */
static double noiseless_error(const check_scene *s, int samples, double *noise) {
    static float errors[3 * PIXELS];
    sps_reference_settings settings;
    sps_image image;
    double square = 0, mean = 0, own = 0;
    memset(&settings, 0, sizeof settings), memset(&image, 0, sizeof image);
    settings.step = 0.5, settings.samples = samples, settings.seed = 1, settings.error = errors, image.rgba = image_b;
    check_render(context, s, image_a);
    CHECK_OK(context, sps_reference(context, &s->scene, &s->view, &settings, &image));
    for (int i = 0; i < PIXELS; ++i) {
        const double difference = (double)image_a[4 * i] - (double)image_b[4 * i], error = (double)errors[3 * i];
        square += difference * difference;
        own += error * error;
        mean += (double)image_b[4 * i];
    }
    *noise = sqrt(own * PIXELS) / mean;
    return sqrt(fmax(square - own, 0) * PIXELS) / mean;
}

/* Pixel by pixel, for all kinds of phase functions, from six sides; long. */
static void test_cloud_pixels(void) {
    static const sps_lobe lobes[][2] = {
        {{-0.3f, 1}, {0, 0}}, {{0, 1}, {0, 0}},     {{0.3f, 1}, {0, 0}}, {{0.5f, 1}, {0, 0}},
        {{0.75f, 1}, {0, 0}}, {{0.85f, 1}, {0, 0}}, {{0.9f, 1}, {0, 0}}, {{0.8f, 0.8f}, {-0.3f, 0.2f}}};
    for (int n = 0; n < 48; ++n) {
        const sps_lobe *own = lobes[n / 6];
        double noise, error;
        check_scene s;
        if (!check_long() && n != 33) continue; /* a forward lobe, towards the light */
        start_cloud(&s, own, 1 + (own[1].weight > 0), n % 6);
        error = noiseless_error(&s, check_long() ? 2000 : 200, &noise);
        if (figures())
            printf("cloud, g %g, %s: rms error %.1f %% of the mean, noise %.1f %%\n", (double)own->asymmetry,
                   cloud_views[n % 6], 100 * error, 100 * noise);
        CHECK_CASE("Found in review", "cloud with a forward lobe, seen towards the light",
                   "random paths, rms of pixels less noise", error, 0.05 + noise, "cells, 5 %; the paths' noise");
    }
}

/* All kinds of matter and of lights. */
static void test_paths(void) {
    for (int kind = 0; kind < KINDS; ++kind)
        for (int light = 0; light < LIGHTS; ++light) {
            char name[64];
            check_scene s;
            if (!check_long() && light != (kind % 2 ? SUN : WITHIN)) continue;
            start(&s, kind, light);
            s.view.scattering_resolution = 20;
            snprintf(name, sizeof name, "%s, %s", kinds[kind], lights[light]);
            check_paths(context, &s, name, light == WITHIN ? 40 : 20, 0.06);
        }
}

/* An eye near the rim of gas has a lamp behind itself, and sees what turns straight back. Of random paths too few come
   there; soak has photons. A trace of a sharp lobe makes cells keep four orders. Two leave out 17 % of it at an
   asymmetry of 0.49, 6 % at 0.32, and 2 % at 0.2. */
static void test_straight_back(void) {
    static const sps_lobe all[] = {{0.49f, 1}, {0.32f, 1}, {0.2f, 1}};
    for (int n = 0; n < 3; ++n) {
        double mean, exact;
        check_scene s;
        start_plain(&s, LIGHTS);
        s.volume[0].lobes = &all[n], s.volume[0].lobe_count = 1;
        check_set3(s.view.camera.position, 0, 0, -0.6);
        check_set3(s.view.camera.target, 0, 0, -1);
        check_orthographic(&s.view.camera, 0.5);
        check_add_point(&s, 0, 0, 0.1, 1);
        s.view.scattering_resolution = 24;
        check_render(context, &s, image_a);
        mean = mean_of(image_a, PIXELS);
        s.volume[1] = s.volume[0], s.scene.volume_count = 2; /* the trace */
        s.volume[1].extinction = 1e-6f, s.volume[1].lobes = &forward;
        check_render(context, &s, image_a);
        exact = mean_of(image_a, PIXELS);
        if (figures()) printf("straight back, g %g: %+.2f %%\n", (double)all[n].asymmetry, 100 * (mean / exact - 1));
        CHECK_NEAR(mean, exact, 0.03 * exact);
    }
}

/* An eye amid gas, with the sun behind itself, beside itself and before. The light of cells beside and behind the eye
   lies between places on its rays: were they seen from the other side, the first picture would be a quarter too bright.
   Cells are an eighth of the gas's radius wide: towards the sun, 5 % is missing; with half the edge 1, a quarter .1. */
static void test_eye_amid(void) {
    static const double ways[3][3] = {{0.5, -0.8, -0.4}, {0.8, 0.5, 0}, {-0.5, 0.8, 0.4}};
    static const char *const names[] = {"eye amid gas, away from a sun", "beside it", "towards it"};
    static const sps_lobe lobe = {0.49f, 1};
    for (int n = 0; n < 3; ++n) {
        check_scene s;
        start_plain(&s, SUN);
        s.volume[0].lobes = &lobe, s.volume[0].lobe_count = 1;
        check_set3(s.view.camera.position, 0.1, -0.05, 0.08);
        for (int k = 0; k < 3; ++k) s.view.camera.target[k] = s.view.camera.position[k] + ways[n][k];
        check_perspective(&s.view.camera, n == 1 ? 1.5 : 0.4);
        s.view.scattering_resolution = 16;
        check_paths(context, &s, names[n], 60, 0.05);
    }
}

/* Emission is scattered, and ambient light comes through the gas. */
static void test_paths_unlit(void) {
    for (int kind = 0; kind < 5; ++kind) {
        static const char *const names[] = {"emission", "ambient", "ambient, forward", "emission, ambient and sun",
                                            "emission, forward"};
        check_scene s;
        start(&s, GAS, kind == 3 ? SUN : LIGHTS);
        if (kind == 2 || kind == 4) s.volume[0].lobes = &forward, s.volume[0].lobe_count = 1;
        if (kind > 0 && kind < 4) check_color(s.scene.ambient, 0.5, 0.6, 0.7);
        if (kind == 0 || kind > 2) check_color(s.volume[0].emission, 0.5, 0.6, 1);
        s.view.scattering_resolution = 20;
        check_paths(context, &s, names[kind], 20, 0.03);
    }
}

/* --- layers --- */

/* What a layer a unit thick and 8 wide sends back (0) and through (1), of a sun square to it, by quadrature over the
   cosine of orthographic views. What goes straight through is left out. */
static void layer_sends(double depth, double g, double albedo, double share[2]) {
    static const double at[] = {0.0950125098, 0.2816035508, 0.4580167777, 0.6178762444,
                                0.7554044084, 0.8656312024, 0.9445750231, 0.9894009350};
    static const double weight[] = {0.1894506105, 0.1826034150, 0.1691565194, 0.1495959888,
                                    0.1246289713, 0.0951585117, 0.0622535239, 0.0271524594};
    const sps_lobe lobe = {(float)g, 1};
    float rgba[16];
    check_scene s;
    sps_volume *volume;
    check_clear(&s, 2, 2);
    volume = check_add_volume(&s, 128, 128, 32, check_box(-4, -4, 0, 4, 4, 1));
    volume->read_fn = check_read_constant, volume->user = (void *)(size_t)&one;
    volume->extinction = (float)depth;
    volume->lobes = &lobe, volume->lobe_count = 1;
    volume->revision = 1;
    check_color(volume->albedo, albedo, albedo, albedo);
    check_add_directional(&s, 0, 0, -1, 1);
    s.view.scattering = SPS_SCATTERING_MULTIPLE, s.view.scattering_resolution = check_long() ? 192 : 96;
    s.view.camera.ortho_height = 0.1;
    s.view.camera.target[2] = 0.5;
    for (int through = 0; through < 2; ++through) {
        share[through] = 0;
        for (int i = 0; i < 16; ++i) {
            const double cosine = 0.5 + (i < 8 ? -0.5 : 0.5) * at[i % 8];
            s.view.camera.position[0] = 1000 * sqrt(1 - cosine * cosine);
            s.view.camera.position[2] = 0.5 + (through ? -1000 : 1000) * cosine;
            check_render(context, &s, rgba);
            share[through] += PI * weight[i % 8] * cosine * (double)rgba[0];
        }
    }
}

/* H. C. van de Hulst, Multiple Light Scattering, 1980, for a depth of 2; doubling for 10 (test_paths.c), where no light
   is lost. There, the light that cells send is a constant within 0.8 units of optical depth, and grows by a sixth on
   that way beside the lit face: of the tenth or so of all light that leaves within it, a fifth may be off. What leaves
   at the layer's sides is below 0.005. */
static void test_layers(void) {
    static const double depths[] = {2, 10}, asymmetries_of[] = {0.75, 0}, albedos[] = {0.9, 1};
    static const double back[] = {0.0974, 0.8525}, through[] = {0.6610, 0.1475}, allowed[] = {0.01, 0.02};
    for (int n = 0; n < 2; ++n) {
        const double straight = exp(-depths[n]);
        double share[2];
        layer_sends(depths[n], asymmetries_of[n], albedos[n], share);
        share[1] += straight;
        if (figures())
            printf("layer of %g, g %g: back %.4f of %.4f, through %.4f of %.4f\n", depths[n], asymmetries_of[n],
                   share[0], back[n], share[1], through[n]);
        CHECK_CASE("Scattering", "layers of depth 2 and 10: reflected", "van de Hulst's tables; doubling",
                   fabs(share[0] - back[n]), allowed[n], "a fifth of what leaves the outermost cells, a tenth of all");
        CHECK_CASE("Scattering", "layers of depth 2 and 10: transmitted", "van de Hulst's tables; doubling",
                   fabs(share[1] - through[n]), allowed[n],
                   "a fifth of what leaves the outermost cells, a tenth of all");
        if (n == 1)
            CHECK_CASE("Scattering", "layer of depth 10, albedo 1", "reflected and transmitted add up to 1",
                       fabs(share[0] + share[1] - 1), 2 * allowed[n], "that of both; 0.005 leaves at the sides");
    }
}

/* --- shadows and polygons --- */

/* Whatever gas is shaded by, it shows the same, as far as it does where light scatters once. A light's own table is
   finer than one made for cells, which has four texels for each: with 24 cells the difference is below that of once.
   Once is what sps_reference shows: a pixel's mean is off from the ray through its middle by a 24th of the square of
   its width, 0.13, times the curvature: ripples of a wavelength of 0.8, (2 pi / 0.8)^2, make 4.3 %, and ripple 0.4 %.
 */
static void test_sources(void) {
    sps_tmap_settings deep;
    memset(&deep, 0, sizeof deep);
    deep.technique = SPS_TMAP_COMPRESSED, deep.epsilon = 0.002f;
    for (int light = SUN; light <= SPOT; ++light)
        for (int g = 0; g < 2; ++g)
            for (int source = 0; source < 2; ++source) {
                double off[2];
                if (light == WITHIN || (!check_long() && (light + g) % 2)) continue; /* no sheets */
                for (int full = 0; full < 2; ++full) {
                    check_scene s;
                    start_plain(&s, light);
                    if (g) s.volume[0].lobes = &forward, s.volume[0].lobe_count = 1;
                    s.view.scattering = full ? SPS_SCATTERING_MULTIPLE : SPS_SCATTERING_SINGLE;
                    s.view.scattering_resolution = 24;
                    s.light[0].shadow_source = SPS_SHADOW_SHEETS;
                    check_render(context, &s, image_b);
                    s.light[0].shadow_source = source ? SPS_SHADOW_TABLE : SPS_SHADOW_AUTO;
                    if (!source) s.light[0].shadow_map = &deep;
                    check_render(context, &s, image_a);
                    off[full] = error_of(image_a, image_b, PIXELS);
                    if (full || !source) continue;
                    check_march(context, &s, 0.75, image_c, NULL);
                    CHECK(error_of(image_a, image_c, PIXELS) < 0.05 && error_of(image_b, image_c, PIXELS) < 0.05);
                }
                if (figures())
                    printf("%s, g %d, source %d: once %.4f, full %.4f\n", lights[light], g, source, off[0], off[1]);
                CHECK(off[1] < off[0] + 0.002);
            }
}

/* Cells get light through a table of their own, whatever the number of components of the light's map. */
static void test_own_map(void) {
    sps_context *by[2];
    for (int n = 0; n < 2; ++n) {
        sps_tmap_settings deep;
        check_scene s;
        memset(&deep, 0, sizeof deep);
        deep.technique = SPS_TMAP_DEEP_OPACITY, deep.components = n ? 16 : 6;
        by[n] = check_context(NULL);
        start_plain(&s, SUN);
        s.light[0].shadow_map = &deep;
        s.view.scattering = SPS_SCATTERING_MULTIPLE;
        s.view.scattering_resolution = 24;
        check_render(by[n], &s, image_a);
    }
    const spsi_buffer *light[2] = {&by[0]->buffers[SPSI_BUFFER_CELL_MOMENTS],
                                   &by[1]->buffers[SPSI_BUFFER_CELL_MOMENTS]};
    CHECK(light[0]->size == light[1]->size && memcmp(light[0]->data, light[1]->data, light[0]->size) == 0);
    sps_destroy(by[0]), sps_destroy(by[1]);
}

/* What scatters more than once, as the picture's mean less that of light that scatters once. */
static double scattered_again(check_scene *s) {
    double mean[2];
    for (int full = 0; full < 2; ++full) {
        s->view.scattering = full ? SPS_SCATTERING_MULTIPLE : SPS_SCATTERING_SINGLE;
        check_render(context, s, image_a);
        mean[full] = mean_of(image_a, PIXELS);
    }
    return mean[1] - mean[0];
}

/* A cube of dense gas, lit through a face: beside sheets, cells have a table of four texels for each of their edges,
   and so the same light as by the light's own table of that size, but for what kernels' ends leave out of the coarser
   one, less than 6e-4. With half as many, 0.8 % of it is missing. */
static void test_table_of_sheets(void) {
    check_scene s;
    sps_volume *volume;
    double again[2];
    check_clear(&s, SIDE, SIDE);
    s.view.camera.ortho_height = 1.6;
    volume = check_add_volume(&s, 24, 24, 24, check_box(-1, -1, -1, 1, 1, 1));
    volume->read_fn = check_read_constant, volume->user = (void *)(size_t)&one;
    volume->extinction = 20;
    check_color(volume->albedo, 0.98, 0.98, 0.98);
    check_add_directional(&s, 0, 0, -1, 3);
    s.view.scattering_resolution = 24;
    s.light[0].shadow_source = SPS_SHADOW_SHEETS;
    again[0] = scattered_again(&s);
    s.light[0].shadow_source = SPS_SHADOW_TABLE, s.light[0].shadow_map_resolution = 4 * 24;
    again[1] = scattered_again(&s);
    if (figures()) printf("again: by sheets %.6f, by the table %.6f\n", again[0], again[1]);
    CHECK_NEAR(again[0], again[1], 6e-4 * again[1]);
}

/* A plate above the gas, in the way of a sun from above. */
static void start_below(check_scene *s, double width, double transmittance) {
    static const sps_lobe weak = {0.2f, 1};
    const double origin[3] = {-width, 1.5, -2}, u[3] = {2 * width, 0, 0}, v[3] = {0, 0, 4};
    start_plain(s, LIGHTS);
    s->volume[0].lobes = &weak, s->volume[0].lobe_count = 1; /* with or without polygons, of two orders */
    check_add_directional(s, 0, -1, 0, 2);
    plate.count = 0;
    check_add_quad(&plate, origin, u, v);
    check_translucent(check_add_mesh(s, &plate, 0), transmittance);
}

/* An opaque plate leaves no light, and a pane its share of each color; half a plate darkens the other half of the gas,
   too. Seen from above, light is behind the eye; from below, in front of it. */
static void test_polygons(void) {
    for (int n = 0; n < 2; ++n) {
        double open, half, dark = 0;
        check_scene s;
        start_below(&s, 2, 0);
        if (n) check_set3(s.view.camera.position, 0, -5, 1);
        check_render(context, &s, image_a);
        for (int i = 0; i < COUNT; ++i) dark = fmax(dark, i % 4 < 3 ? (double)image_a[i] : 0);
        s.scene.mesh_count = 0;
        check_render(context, &s, image_b);
        open = mean_of(image_b, PIXELS);
        if (figures()) printf("below a plate: %.2g\n", dark / open);
        CHECK(dark < 2e-4 * open); /* as much as of light that scatters once, where the plate's triangles meet */
        start_below(&s, 2, 0.5);
        if (n) check_set3(s.view.camera.position, 0, -5, 1);
        s.mesh[0].transmittance[1] = 0.25f;
        check_render(context, &s, image_a);
        for (int i = 0; i < COUNT; ++i) image_b[i] *= i % 4 == 1 ? 0.25f : i % 4 == 3 ? 1.0f : 0.5f;
        if (figures()) printf("pane: off by %.2g\n", error_of(image_a, image_b, PIXELS));
        CHECK(error_of(image_a, image_b, PIXELS) <
              (n ? 0.01 : 2e-3)); /* from below, the eye sees the pane behind the gas */
        start_below(&s, 2, 0);
        if (n) check_set3(s.view.camera.position, 0, -5, 1);
        plate.list[0].position[0][0] = 0; /* of x -2 .. 2, what is beyond a slanted edge */
        s.light[0].shadow_source = SPS_SHADOW_TABLE;
        check_render(context, &s, image_a);
        half = mean_of(image_a, PIXELS);
        if (figures()) printf("part of a plate: %.3f of the light\n", half / open);
        CHECK(half > 0.2 * open && half < 0.8 * open);
    }
    check_free_triangles(&plate);
}

/* Plates and panes in part of the light, against random paths, which also meet them between one cell and another. */
static void test_polygon_paths(void) {
    for (int n = 0; n < 2; ++n) {
        const double origin[3] = {0, 2.5, -3}, u[3] = {3, 0, 0}, v[3] = {0, 0, 6};
        check_scene s;
        start_plain(&s, LIGHTS);
        check_add_directional(&s, 0.1, -1, 0, 2);
        plate.count = 0;
        check_add_quad(&plate, origin, u, v);
        check_translucent(check_add_mesh(&s, &plate, 0), n ? 0.4 : 0);
        s.view.scattering_resolution = 20;
        check_paths(context, &s, n ? "pane" : "plate", 20, 0.06);
    }
    check_free_triangles(&plate);
}

/* --- what is held --- */

enum {
    AGAIN,
    CAMERA,
    REGION,
    COLOR,
    DIRECTION,
    SHADOW,
    ANOTHER_LIGHT,
    ALBEDO,
    LOBE,
    AMBIENT,
    EMISSION,
    EXTINCTION,
    REVISION,
    PLACEMENT,
    MESH_REVISION,
    MESH_COLOR,
    CELLS,
    CHANGES
};
static const char *const changes[] = {
    "again", "camera",  "region",   "color",      "direction", "shadow",    "another light", "albedo",
    "lobe",  "ambient", "emission", "extinction", "revision",  "placement", "mesh revision", "mesh transmittance",
    "cells"};

static float held_value;
static double held_puff(const void *user, const double p[3]) { return (double)held_value * check_puff(user, p); }
static const check_field held_field = {held_puff, NULL, {0, 0, 0}, {{0, 0, 0}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}}};

static void change(check_scene *s, int what) {
    if (what == CAMERA) check_set3(s->view.camera.position, 3, 1, 4);
    if (what == REGION) s->view.region[0] = 1, s->view.region[2] = SIDE - 1, s->view.region[3] = SIDE;
    if (what == COLOR) s->light[0].color[1] *= 0.5f;
    if (what == DIRECTION) s->light[0].direction[0] = -0.5;
    if (what == SHADOW) s->light[1].no_shadow = 1;
    if (what == ANOTHER_LIGHT) s->scene.light_count = 1;
    if (what == ALBEDO) s->volume[0].albedo[2] = 0.5f;
    if (what == LOBE) s->volume[0].lobes = &backward, s->volume[0].lobe_count = 1;
    if (what == AMBIENT) s->scene.ambient[0] = 0.4f;
    if (what == EMISSION) s->volume[0].emission[0] = 0.4f;
    if (what == EXTINCTION) s->volume[0].extinction = 3;
    if (what == REVISION) s->volume[0].revision = 2, held_value = 0.7f;
    if (what == PLACEMENT) s->volume[0].placement.axis[0][0] = 1.5;
    if (what == MESH_REVISION) s->mesh[0].revision = 2, plate.list[0].position[0][0] = 1;
    if (what == MESH_COLOR) check_translucent(&s->mesh[0], 0.5);
    if (what == CELLS) s->view.scattering_resolution = 10;
}

static void start_held(check_scene *s) {
    const double origin[3] = {0.1, 1.5, -2}, u[3] = {3, 0, 0}, v[3] = {0, 0, 4};
    start(s, GAS, SUN);
    s->view.quality = SPS_QUALITY_DRAFT;
    held_value = 1;
    s->volume[0].user = (void *)(size_t)&held_field;
    for (int k = 0; k < 3; ++k) s->volume[0].size[k] = 12;
    add_light(s, POINT);
    s->volume[0].revision = 1;
    plate.count = 0;
    check_add_quad(&plate, origin, u, v);
    check_add_mesh(s, &plate, 0.5)->revision = 1;
    check_color(s->scene.ambient, 0.1, 0.2, 0.3);
}

/* The second call takes cells over if nothing of theirs has changed, and shows what a new context shows. */
static void test_held(void) {
    for (int what = 0; what < CHANGES; ++what) {
        sps_context *by = check_context(NULL), *fresh = check_context(NULL);
        check_scene s;
        start_held(&s);
        s.view.scattering_resolution = 8;
        check_render(by, &s, image_a);
        CHECK(cells_made(by) > 0);
        change(&s, what);
        memset(image_a, 0, sizeof image_a), memset(image_b, 0, sizeof image_b);
        check_render(by, &s, image_a);
        check_render(fresh, &s, image_b);
        CHECK(cells_made(fresh) > 0);
        if (!CHECK((cells_made(by) == 0) == (what < COLOR)) | !CHECK(same(image_a, image_b)))
            printf("    changed: %s\n", changes[what]);
        check_render(by, &s, image_a);
        CHECK(cells_made(by) == 0 && same(image_a, image_b));
        sps_destroy(by), sps_destroy(fresh);
    }
    for (int n = 0; n < 2; ++n) { /* without a revision of all volumes and meshes */
        sps_context *by = check_context(NULL);
        check_scene s;
        start_held(&s);
        if (n == 0) s.volume[0].revision = 0;
        if (n == 1) s.mesh[0].revision = 0;
        for (int i = 0; i < 2; ++i) {
            check_render(by, &s, image_a);
            CHECK(cells_made(by) > 0);
        }
        sps_destroy(by);
    }
    check_free_triangles(&plate);
}

/* Calls in between that follow no light, or other light, or that are cancelled amid it, do no harm. */
static void test_held_between(void) {
    for (int n = 0; n < 4; ++n) {
        check_hooks hooks;
        check_cancel cancel = {0, 0};
        sps_config config;
        sps_context *by;
        check_scene s, other;
        memset(&hooks, 0, sizeof hooks);
        config = check_config(&hooks);
        config.progress_fn = check_cancel_at, config.progress_user = &cancel;
        config.clock_fn = check_hasty_clock;
        by = sps_create(&config, NULL);
        start_held(&s);
        check_render(by, &s, image_b);
        other = s;
        other.scene.volumes = other.volume, other.scene.lights = other.light, other.scene.meshes = other.mesh;
        if (n == 0) other.view.scattering = SPS_SCATTERING_SINGLE;
        if (n == 1) other.scene.volume_count = 0;
        if (n == 2) other.view.scattering_resolution = 20;
        if (n == 3) {
            cancel.at = cancel.calls * 3 / 5, cancel.calls = 0; /* while cells are solved for */
            other.light[0].color[0] = 5;
            check_fails(by, &other, image_a, SPS_ERROR_CANCELLED, "cancelled");
            cancel.at = 0;
        } else
            check_render(by, &other, image_a);
        check_render(by, &s, image_a);
        CHECK(same(image_a, image_b));
        CHECK((cells_made(by) == 0) == (n < 2));
        sps_destroy(by);
    }
    check_free_triangles(&plate);
}

/* --- workers and regions --- */

static void test_workers(void) {
    for (int n = 0; n < 3; ++n) {
        check_scene s;
        start(&s, n ? MIXED : GAS, SUN);
        add_light(&s, WITHIN);
        if (n == 2) s.view.scattering_resolution = 8; /* voxels are deposited */
        if (n) s.volume[0].lobes = &forward, s.volume[0].lobe_count = 1;
        check_color(s.scene.ambient, 0.1, 0.2, 0.3);
        check_workers(&s, image_a, image_b);
    }
}

static void test_regions(void) {
    static const int regions[][4] = {{0, 0, 5, 16}, {3, 7, 9, 2}, {15, 15, 1, 1}};
    check_scene s;
    start(&s, GAS, SUN);
    s.volume[0].lobes = &forward, s.volume[0].lobe_count = 1;
    check_render(context, &s, image_b);
    for (int n = 0; n < 3; ++n) {
        const int *r = regions[n];
        int differ = 0;
        memcpy(s.view.region, r, sizeof s.view.region);
        check_render(context, &s, image_a);
        for (int i = 0; i < 4 * r[2] * r[3]; ++i)
            differ +=
                memcmp(&image_a[i], &image_b[4 * ((r[1] + i / (4 * r[2])) * SIDE + r[0]) + i % (4 * r[2])], 4) != 0;
        CHECK(differ == 0);
    }
}

/* --- hard cases --- */

static void check_finite(const check_scene *s, const char *name) {
    int bad = 0;
    check_render(context, s, image_a);
    for (int i = 0; i < COUNT; ++i) bad += !(image_a[i] >= 0 && image_a[i] <= FLT_MAX);
    if (!CHECK(bad == 0)) printf("    %s\n", name);
}

static void test_finite(void) {
    static const float extinctions[] = {1e-8f, 1e-3f, 1e3f, 1e6f, 1e15f};
    static const sps_lobe peak = {0.99f, 1}, back = {-0.99f, 1};
    const sps_lobe *const all[] = {NULL, &middle, &peak, &back};
    check_scene s;
    for (int n = 0; n < 5 * 4; ++n)
        for (int light = SUN; light <= WITHIN; light += WITHIN - SUN) {
            if (!check_long() && n % 4 == 1) continue;
            start_plain(&s, light);
            s.view.scattering_resolution = 9;
            s.volume[0].extinction = extinctions[n / 4];
            s.volume[0].lobes = all[n % 4], s.volume[0].lobe_count = n % 4 > 0;
            if (n % 2) check_color(s.scene.ambient, 1, 1, 1);
            check_finite(&s, "extinction");
        }
    for (int n = 1; n <= 3; ++n) { /* few voxels */
        start_plain(&s, WITHIN);
        check_set3(s.light[0].position, 0, 0, 0); /* a voxel's centre, if there are 1 or 3 */
        s.volume[0].size[0] = n, s.volume[0].size[1] = s.volume[0].size[2] = 1;
        s.volume[0].eval_fn = NULL, s.volume[0].read_fn = check_read_constant, s.volume[0].user = (void *)(size_t)&one;
        for (s.view.scattering_resolution = 1; s.view.scattering_resolution < 40; s.view.scattering_resolution += 13)
            check_finite(&s, "voxels");
    }
    start_plain(&s, SUN); /* the eye within */
    check_set3(s.view.camera.position, 0.1, 0, 0.1);
    check_set3(s.view.camera.target, -1, 0.5, -1);
    s.volume[0].lobes = &forward, s.volume[0].lobe_count = 1;
    check_finite(&s, "eye within");
    CHECK(mean_of(image_a, PIXELS) > 0);
    start_plain(&s, SUN); /* no gas */
    s.volume[0].eval_fn = NULL, s.volume[0].read_fn = check_read_constant;
    held_value = 0, s.volume[0].user = &held_value;
    check_finite(&s, "empty");
    CHECK_NEAR(mean_of(image_a, PIXELS), 0, 0);
    start(&s, TWO_GASES, SUN); /* one emits and has no extinction */
    s.volume[1].extinction = 0;
    check_color(s.volume[1].emission, 1, 1, 1);
    check_finite(&s, "emission alone");
    start(&s, GAS, LIGHTS); /* no light */
    check_finite(&s, "dark");
    CHECK_NEAR(mean_of(image_a, PIXELS), 0, 0);
}

/* Gas without extinction that emits lights gas around it, and gas beside it. */
static void test_emitter(void) {
    for (int beside = 0; beside < 2; ++beside) {
        double lit;
        check_scene s;
        sps_volume *volume;
        start_plain(&s, LIGHTS);
        volume = check_add_volume(&s, 12, 12, 12, check_box(-0.3, 0.2, -0.3, 0.3, 0.8, 0.3));
        if (beside) volume->placement.origin[1] = 1.1;
        volume->read_fn = check_read_constant, volume->user = (void *)(size_t)&one;
        check_color(volume->emission, 2, 2, 2);
        s.view.scattering_resolution = 20;
        check_paths(context, &s, beside ? "emitter beside gas" : "emitter in gas", 40, 0.05);
        check_render(context, &s, image_a);
        lit = mean_of(image_a, PIXELS);
        s.view.scattering = SPS_SCATTERING_SINGLE;
        check_render(context, &s, image_a);
        if (figures()) printf("emitter: %.3f times as bright\n", lit / mean_of(image_a, PIXELS));
        CHECK(lit > (beside ? 1.01 : 1.5) * mean_of(image_a, PIXELS));
    }
}

static void test_refused(void) {
    static const int wrong[] = {-1, 257};
    sps_reference_settings settings;
    sps_image image;
    check_scene s;
    for (int i = 0; i < 2; ++i) {
        start_plain(&s, SUN);
        s.view.scattering_resolution = wrong[i];
        s.scene.volume_count = 0; /* refused before anything is looked at */
        check_fails(context, &s, image_a, SPS_ERROR_ARGUMENT,
                    i ? "view.scattering_resolution is 257" : "view.scattering_resolution is -1");
        CHECK(check_error_info(context, SPS_ERROR_ARGUMENT));
        s.view.scattering = SPS_SCATTERING_SINGLE;
        check_fails(context, &s, image_a, SPS_ERROR_ARGUMENT, "view.scattering_resolution is");
    }
    start_plain(&s, SUN);
    memset(&settings, 0, sizeof settings), memset(&image, 0, sizeof image);
    settings.step = 0.5, image.rgba = image_a, image_a[0] = 7;
    CHECK(sps_reference(context, &s.scene, &s.view, &settings, &image) == SPS_ERROR_UNSUPPORTED);
    CHECK(image_a[0] == 7 && check_error_info(context, SPS_ERROR_UNSUPPORTED));
    settings.samples = 1;
    CHECK_OK(context, sps_reference(context, &s.scene, &s.view, &settings, &image));
    start_plain(&s, SUN); /* sheets about a lamp amid gas: before any cell is filled */
    s.light[0].kind = SPS_LIGHT_POINT;
    check_set3(s.light[0].position, 0, 0, 0);
    s.light[0].shadow_source = SPS_SHADOW_SHEETS;
    check_fails(context, &s, image_a, SPS_ERROR_UNSUPPORTED, "light");
    CHECK(cells_made(context) == 0);
}

/* --- failures --- */

static void start_small(check_scene *s) {
    start_below(s, 2, 0.5);
    if (!check_long()) s->scene.mesh_count = 0; /* its depth map takes as long as all else */
    swarm = check_add_swarm(s, 0.3);
    check_color(swarm->albedo, 0.8, 0.9, 1);
    s->view.width = s->view.height = 8;
    s->view.quality = SPS_QUALITY_DRAFT;
    s->view.scattering_resolution = 6;
    for (int k = 0; k < 3; ++k) s->volume[0].size[k] = 8;
    s->volume[0].lobes = &forward, s->volume[0].lobe_count = 1;
    s->volume[0].revision = 1;
}

/* Of some thousand calls of progress_fn, few are tried. */
static void test_failures(void) {
    check_scene s;
    start_small(&s);
    CHECK(check_failing(&s, 0, 0, image_a, image_b) > 18);
    CHECK(check_failing(&s, 1, check_long() ? 50 : 4, image_a, image_b) > 8);
    check_free_triangles(&plate);
}

/* A call that fails may take memory from what is held: what comes next is as it should be. */
static void test_failures_between(void) {
    check_hooks hooks;
    sps_result result;
    sps_context *by;
    long n = 0;
    check_scene held, other;
    start_small(&held);
    start_small(&other);
    other.view.scattering_resolution = 9;
    check_color(other.volume[0].albedo, 0.9, 0.5, 0.2);
    memset(&hooks, 0, sizeof hooks);
    check_render(context, &held, image_b);
    do {
        by = check_context(&hooks);
        CHECK(check_try(by, &held, image_a) == SPS_OK);
        hooks.fail_at = hooks.allocations + ++n;
        result = check_try(by, &other, image_a);
        hooks.fail_at = 0;
        CHECK(check_try(by, &held, image_a) == SPS_OK);
        CHECK(check_same(&held, image_a, image_b));
        sps_destroy(by);
    } while (result != SPS_OK && n < 1000);
    CHECK(n > 5 && hooks.live == 0);
}

/* Light stays finite, whatever the lobe: sharp ones backwards, too, from thin gas to dense. */
static void test_backward_lobes(void) {
    static const float g[] = {-0.99f, -0.95f, -0.9f, -0.8f, 0.99f};
    for (int n = 0; n < 10; ++n) {
        const sps_lobe lobe = {g[n / 2], 1};
        float most = 0;
        check_scene s;
        check_clear(&s, SIDE, SIDE);
        check_set3(s.view.camera.position, 0, 0, 5);
        check_orthographic(&s.view.camera, 2.2);
        check_add_puff(&s, n % 2 ? 200 : 20);
        s.volume[0].lobes = &lobe, s.volume[0].lobe_count = 1;
        check_color(s.volume[0].albedo, 1, 1, 1);
        check_add_directional(&s, 1, 0, -0.2, 1);
        s.view.scattering = SPS_SCATTERING_MULTIPLE;
        s.view.scattering_resolution = 16;
        check_render(context, &s, image_a);
        for (int i = 0; i < COUNT; ++i) most = i % 4 < 3 && image_a[i] > most ? image_a[i] : most;
        if (figures())
            printf("lobe %g, %g: brightest %g\n", (double)lobe.asymmetry, n % 2 ? 200.0 : 20.0, (double)most);
        CHECK(most > 0 && most < 1); /* a white wall sends 1 / pi */
    }
}

/* Of three gases the last one takes the look of the second, or of the first: the list of looks stays as it is. */
static void test_held_looks(void) {
    sps_context *by = check_context(NULL);
    for (int n = 0; n < 3; ++n) {
        check_scene s;
        check_clear(&s, SIDE, SIDE);
        check_set3(s.view.camera.position, 0, 0, 5);
        check_orthographic(&s.view.camera, 4);
        for (int i = 0; i < 3; ++i) {
            check_add_puff(&s, 4);
            s.volume[i].placement = check_box(i - 2, -1, -1, i, 1, 1);
            s.volume[i].revision = 1;
            check_color(s.volume[i].albedo, i == 1 || (i == 2 && n == 1) ? 0.1 : 1, 0.5, i == 0 ? 0.1 : 0.9);
            if (i == 2) check_color(s.volume[i].albedo, n == 1 ? 0.1 : 1, 0.5, n == 1 ? 0.9 : 0.1);
        }
        check_add_directional(&s, 0.3, -1, -0.4, 3);
        s.view.scattering = SPS_SCATTERING_MULTIPLE;
        s.view.scattering_resolution = 8;
        check_render(by, &s, image_a);
        CHECK(cells_made(by) > 0);
        check_render(context, &s, image_b);
        CHECK(same(image_a, image_b));
    }
    sps_destroy(by);
}

/* --- gas that is far apart --- */

static int grid_count(const sps_context *by) {
    return ((const spsi_content *)by->buffers[SPSI_BUFFER_CONTENT].data)->cell_grid_count;
}

/* Two boxes along x, so many of their sides apart, under a sun along x: the second one in the first one's shadow.
   The camera sees the n-th. */
static void start_apart(check_scene *s, double apart, int n) {
    check_clear(s, SIDE, SIDE);
    memcpy(look_rows, unchanged, sizeof look_rows);
    for (int i = 0; i < 2; ++i) {
        const double x = i * (apart + 1) * 2;
        check_add_puff(s, 4);
        s->volume[i].placement = check_box(x - 1, -1, -1, x + 1, 1, 1);
        s->volume[i].eval_fn = NULL;
        s->volume[i].read_fn = check_read_constant;
        s->volume[i].user = (void *)(size_t)&one;
        s->volume[i].extinction = 1;
        check_color(s->volume[i].albedo, 1, 1, 1);
    }
    check_add_directional(s, 1, 0.1, -0.2, 3);
    check_set3(s->view.camera.position, n == 1 ? (apart + 1) * 2 : 0, 0, 6);
    check_set3(s->view.camera.target, s->view.camera.position[0], 0, 0);
    check_orthographic(&s->view.camera, 2.4);
    s->view.scattering = SPS_SCATTERING_MULTIPLE;
    s->view.scattering_resolution = 12;
}

/* An opaque plate above the second half of the second box. */
static void add_plate_apart(check_scene *s, double apart) {
    const double origin[3] = {(apart + 1) * 2, 1.5, -2}, u[3] = {2, 0, 0}, v[3] = {0, 0, 4};
    plate.count = 0;
    check_add_quad(&plate, origin, u, v);
    check_add_mesh(s, &plate, 0.5);
}

/* Groups of gas that are far apart have grids of their own, as fine as if each were alone; those near by share one.
   Below a plate, n 4, one depth map serves both grids. It is aimed at all gas, 10 wide instead of 2, so that its 1024
   texels are .01 instead of .002 wide. A shadow's edge may be off by half a texel, .0025 of the box's width and of the
   light that it has without a plate; in the picture, texels are .3 pixels, and half of one is .15 * 2.4 / 16 = .0225,
   .011 of the width; the rest of .004 is for what scatters there. */
static void test_apart(void) {
    double open = 0;
    for (int n = 0; n < 5; ++n) {
        const double apart = n == 0 ? 1 : n == 1 || n == 4 ? 3 : n == 2 ? 12 : 200;
        uint64_t made;
        check_scene s;
        start_apart(&s, apart, 1);
        check_set3(s.light[0].direction, 0.1, -1, -0.2); /* neither shades the other */
        if (n == 4) add_plate_apart(&s, apart);
        check_render(context, &s, image_a);
        made = cells_made(context);
        CHECK(grid_count(context) == (n > 0 ? 2 : 1));
        s.volume[0] = s.volume[1], s.scene.volume_count = 1;
        check_render(context, &s, image_b);
        CHECK((made == 2 * cells_made(context)) == (n > 0));
        if (figures()) printf("apart %g: %.5f of %.5f\n", apart, mean_of(image_a, PIXELS), mean_of(image_b, PIXELS));
        if (n == 1) open = mean_of(image_b, PIXELS);
        if (n > 0)
            CHECK_NEAR(mean_of(image_a, PIXELS), mean_of(image_b, PIXELS),
                       n == 4 ? 0.015 * open : 0.004 * mean_of(image_b, PIXELS));
    }
    check_free_triangles(&plate);
}

/* The same, where the other one, listed first or last, is five times as wide: each grid has cells of its own size. */
static void test_apart_sizes(void) {
    for (int last = 0; last < 2; ++last) {
        check_scene s;
        start_apart(&s, 200, 1);
        check_set3(s.light[0].direction, 0.1, -1, -0.2);
        s.volume[0].placement = check_box(-5, -5, -5, 5, 5, 5);
        if (last) {
            const sps_volume other = s.volume[0];
            s.volume[0] = s.volume[1], s.volume[1] = other;
        }
        check_render(context, &s, image_a);
        CHECK(grid_count(context) == 2);
        s.volume[0] = s.volume[!last], s.scene.volume_count = 1;
        check_render(context, &s, image_b);
        CHECK_NEAR(mean_of(image_a, PIXELS), mean_of(image_b, PIXELS), 0.004 * mean_of(image_b, PIXELS));
    }
}

/* Both against random paths: what one sends the other is left out, what it takes from the light is not. */
static void test_apart_paths(void) {
    for (int n = 0; n < 2; ++n) {
        check_scene s;
        start_apart(&s, 3, n);
        check_paths(context, &s, n == 0 ? "apart, first" : "apart, second", n == 1 ? 100 : 40, 0.06);
    }
}

/* Behind a deep one that absorbs all light, the other is dark, whatever brings the light: through 16, e^-16 or 1e-7 of
   it is left; shadows are cut off beyond a depth of 12, e^-12. */
static void test_apart_shaded(void) {
    for (int lamp = 0; lamp < 2; ++lamp) {
        double mean[2];
        for (int shaded = 0; shaded < 2; ++shaded) {
            check_scene s;
            start_apart(&s, 3, 1);
            check_color(s.volume[0].albedo, 0, 0, 0);
            s.volume[0].placement = check_box(-1, -1.2, -1.2, 1, 1.2, 1.2); /* its rim fades out */
            s.volume[0].extinction = shaded ? 8 : 1e-6f;
            check_set3(s.light[0].direction, 1, 0, 0);
            if (lamp) s.scene.light_count = 0, check_add_point(&s, -9, 0, 0, 900);
            check_render(context, &s, image_a);
            CHECK(grid_count(context) == 2);
            mean[shaded] = mean_of(image_a, PIXELS);
        }
        if (figures()) printf("apart, shaded: %.2g of %.3f\n", mean[1], mean[0]);
        CHECK(mean[1] < exp(-12.0) * mean[0]);
    }
}

/* Particles, too. More groups than there are grids share some; if these are then as long as the gaps between them, all
   do. */
static void test_many_groups(void) {
    static sps_particle dots[40];
    sps_particles set;
    for (int n = 0; n < 3; ++n) {
        check_scene s;
        check_clear(&s, SIDE, SIDE);
        memset(&set, 0, sizeof set);
        for (int i = 0; i < 40; ++i) {
            const double group = n == 0 ? i % 3 : n == 1 ? pow(4, i % 6) : i;
            dots[i].position[0] = (float)(20 * group + 0.1 * (i / 7 % 3));
            dots[i].position[1] = (float)(0.1 * (i % 4));
            dots[i].position[2] = (float)(n == 2 ? 3 * i * i % 50 : 0);
            dots[i].radius = 0.5f;
            dots[i].optical_depth = 0.5f;
        }
        set.count = 40, set.read_fn = check_read_particles, set.user = dots;
        check_color(set.albedo, 0.9, 0.8, 0.7);
        s.scene.particles = &set, s.scene.particle_set_count = 1;
        check_add_directional(&s, 0.3, -1, -0.4, 3);
        check_set3(s.view.camera.position, n == 0 ? 20 : 60, 0, 100);
        check_set3(s.view.camera.target, n == 0 ? 20 : 60, 0, 0);
        check_orthographic(&s.view.camera, n == 2 ? 900 : 150);
        s.view.scattering = SPS_SCATTERING_MULTIPLE;
        s.view.scattering_resolution = 8;
        check_render(context, &s, image_a);
        if (!CHECK(grid_count(context) == (n == 0 ? 3 : n == 1 ? 4 : 1)))
            printf("    %d: %d grids\n", n, grid_count(context));
        for (int i = 0; i < COUNT; ++i) CHECK(image_a[i] >= 0 && image_a[i] < 1e6f);
        CHECK(mean_of(image_a, PIXELS) > 0);
    }
}

/* --- the plan --- */

static void test_plan(void) {
    static const double corner[3] = {-3, -3, -0.5}, u[3] = {6, 0, 0}, v[3] = {0, 6, 0};
    for (int n = 0; n < 7; ++n) {
        sps_context *by = check_context(NULL);
        sps_plan_report report;
        sps_stats_report stats;
        check_scene s;
        start(&s, n == 3 ? MIXED : GAS, n == 2 ? WITHIN : SUN);
        if (n == 1) s.volume[0].lobes = &forward, s.volume[0].lobe_count = 1;
        if (n == 4 || n == 6) start_plain(&s, SUN);
        if (n == 6) {
            plate.count = 0;
            check_add_quad(&plate, corner, u, v);
            check_add_mesh(&s, &plate, 0.5);
        }
        if (n == 5) add_light(&s, POINT), s.view.scattering_resolution = 30;
        CHECK_OK(by, sps_plan(by, &s.scene, &s.view, &report));
        CHECK(report.pass[SPS_PASS_CELLS].runs == 1 && strstr(report.pass[SPS_PASS_CELLS].reason, "asks"));
        CHECK(report.pass[SPS_PASS_FORWARD].runs == (n != 4 && n != 6));
        check_render(by, &s, image_a);
        sps_get_stats(by, &stats);
        if (figures())
            printf("plan: cells %zu of %zu bytes, used %zu\n", report.pass[SPS_PASS_CELLS].bytes, report.bytes,
                   stats.bytes_peak);
        if (!CHECK(stats.bytes_peak <= report.bytes))
            printf("    scene %d: %zu, planned %zu\n", n, stats.bytes_peak, report.bytes);
        if (n == 4 || n == 6) { /* nothing but cells, and polygons about them */
            /* the bound is a cube's, as the gas is, whose light is held four times */
            static const int own[] = {SPSI_BUFFER_CELL_GRID,  SPSI_BUFFER_CELL_JOB,    SPSI_BUFFER_CELLS,
                                      SPSI_BUFFER_CELL_WALLS, SPSI_BUFFER_CELL_SOLVER, SPSI_BUFFER_CELL_MOMENTS};
            size_t bytes = 0;
            for (int i = 0; i < 6; ++i) bytes += (i < 5 ? 1 : SPSI_CELL_GRIDS) * by->buffers[own[i]].size;
            if (figures()) printf("plan: %zu of %zu bytes for cells alone\n", bytes, report.pass[SPS_PASS_CELLS].bytes);
            CHECK(bytes <= report.pass[SPS_PASS_CELLS].bytes && bytes > report.pass[SPS_PASS_CELLS].bytes / 10 * 9);
        }
        CHECK(report.pass[SPS_PASS_CELLS].bytes > 0 && report.bytes > report.pass[SPS_PASS_CELLS].bytes);
        s.view.scattering = SPS_SCATTERING_FORWARD;
        CHECK_OK(by, sps_plan(by, &s.scene, &s.view, &report));
        CHECK(report.pass[SPS_PASS_CELLS].runs == 0 && report.pass[SPS_PASS_CELLS].bytes == 0);
        CHECK(strstr(report.pass[SPS_PASS_CELLS].reason, "does not ask") != NULL);
        s.view.scattering = SPS_SCATTERING_MULTIPLE;
        s.scene.particle_set_count = 0, check_color(s.volume[0].albedo, 0, 0, 0);
        CHECK_OK(by, sps_plan(by, &s.scene, &s.view, &report));
        CHECK(report.pass[SPS_PASS_CELLS].runs == 0 && strstr(report.pass[SPS_PASS_CELLS].reason, "nothing scatters"));
        sps_destroy(by);
    }
}

/* Cells by quality. */
static void test_qualities(void) {
    static const int sides[] = {24, 44, 64, 96};
    static const sps_quality qualities[] = {SPS_QUALITY_DRAFT, SPS_QUALITY_MEDIUM, SPS_QUALITY_HIGH, SPS_QUALITY_ULTRA};
    for (int i = 0; i < 4; ++i) {
        size_t bytes[2];
        for (int own = 0; own < 2; ++own) {
            sps_plan_report report;
            check_scene s;
            start(&s, GAS, SUN);
            s.view.quality = qualities[i], s.view.scattering_resolution = own ? sides[i] : 0;
            CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &report));
            bytes[own] = report.pass[SPS_PASS_CELLS].bytes;
        }
        CHECK(bytes[0] == bytes[1]);
    }
}

/* Cells along the longest side of a box of even gas, by default at medium quality: 44 times the root of depth / 30, in
   steps of 4, from 22 on; if it emits, no fewer than voxels (68, or just above 24; more if these are flat). Where
   nothing emits, they are two pixels wide at least, by the view's size and distance, not its region or turn. 8 of them
   span the shortest side, but there are at most 44^3 in all: in a box whose height is a share f of its other sides, a
   row of a has a * a * ceil(f a). A number that is set holds. */
static void test_chosen(void) {
    static const struct {
        double depth, flat, distance, turn;      /* depth along the longest side */
        int pixels, set, cells, glowing, voxels; /* 0: 64 voxels */
    } cases[] = {
        {1, 1, 40, 0, 4096, 0, 22, 44},    {14, 1, 40, 0, 4096, 0, 32, 0},     {20, 1, 40, 0, 4096, 0, 36, 0},
        {29, 1, 40, 0, 4096, 0, 44, 0},    {1000, 1, 40, 0, 4096, 0, 44, 0},   {20, 1, 40, 0, 4096, 13, 13, 13},
        {1, 0.2, 40, 0, 4096, 0, 40, 0},   {20, 0.23, 40, 0, 4096, 0, 36, 70}, {1000, 0.2, 40, 0, 4096, 0, 75, 0},
        {1, 0.05, 40, 0, 4096, 0, 119, 0}, {1, 0.02, 40, 0, 4096, 0, 150, 0},  {1, 0.2, 160, 0, 64, 0, 40, 0},
        {1000, 1, 40, 0, 512, 0, 44, 0},   {1000, 1, 160, 0, 480, 0, 32, 0},   {1000, 1, 160, 20, 480, 0, 32, 0},
        {1000, 1, 160, 0, 64, 0, 22, 44},  {1, 1, 40, 0, 4096, 0, 22, 28, 20}};
    for (size_t n = 0; n < sizeof cases / sizeof *cases; ++n)
        for (int emits = 0; emits < 2; ++emits) {
            sps_plan_report plans[2];
            check_scene s;
            if ((emits && !cases[n].glowing) || (!check_long() && n % 3 == 1)) continue;
            start_plain(&s, SUN);
            s.volume[0].read_fn = check_read_constant, s.volume[0].user = (void *)(size_t)&one;
            s.volume[0].eval_fn = NULL, s.volume[0].placement = check_box(-1, -cases[n].flat, -1, 1, cases[n].flat, 1);
            for (int k = 0; k < 3; ++k)
                s.volume[0].size[k] = cases[n].voxels ? cases[n].voxels : 64; /* kernels reach 2 out */
            s.volume[0].extinction = (float)(cases[n].depth / (2 + 2.0 / 16));
            s.volume[0].revision = 1 + 2 * n + (size_t)emits;
            if (emits) check_color(s.volume[0].emission, 1e-3, 1e-3, 1e-3);
            check_set3(s.view.camera.position, 0, 0, cases[n].distance);
            check_set3(s.view.camera.target, cases[n].turn, 0, 0);
            check_perspective(&s.view.camera, 0.1);
            s.view.width = s.view.height = cases[n].pixels;
            for (int k = 0; k < 4; ++k) s.view.region[k] = k < 2 ? 0 : 2;
            s.view.scattering_resolution = cases[n].set;
            if (!check_render(context, &s, image_a)) return;
            const int found = (int)(grid_of(context)->longest / grid_of(context)->edge + 0.5);
            if (figures()) printf("chosen %d: %d cells\n", (int)n, found);
            CHECK_NEAR(found, emits ? cases[n].glowing : cases[n].cells, 0);
            CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plans[0]));
            s.view.scattering_resolution = found;
            CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plans[1]));
            CHECK(strcmp(plans[0].cells_filling, plans[1].cells_filling) == 0);
            CHECK(plans[0].cells_gathered == plans[1].cells_gathered);
            if (found > 44) continue; /* a number that is set counts as a cube's */
            CHECK(plans[0].pass[SPS_PASS_CELLS].bytes >= plans[1].pass[SPS_PASS_CELLS].bytes);
        }
}

int main(void) {
    context = check_context(NULL);
    RUN(test_weights);
    RUN(test_harmonics);
    RUN(test_harmonics_of_vectors);
    RUN(test_solutions);
    RUN_LONG(test_converged);
    RUN(test_energy);
    RUN(test_furnace);
    RUN(test_lengthened);
    RUN(test_nothing_given);
    RUN(test_filling);
    RUN(test_deposits);
    RUN(test_lit);
    RUN(test_lit_floor);
    RUN_LONG(test_lit_behind_rods);
    RUN(test_deep);
    RUN(test_lookups);
    RUN(test_continued);
    RUN(test_continued_in_scene);
    RUN(test_white_sky);
    RUN(test_white_sky_in_sheets);
    RUN(test_little);
    RUN(test_nothing_for_surfaces);
    RUN(test_ambient_on_surfaces);
    RUN(test_linear);
    RUN(test_unshadowed);
    RUN(test_swapped);
    RUN_LONG(test_turned);
    RUN(test_scaled);
    RUN(test_sharpened);
    RUN_LONG(test_coarse);
    RUN(test_clouds);
    RUN_LONG(test_cloud_pixels);
    RUN_LONG(test_paths);
    RUN(test_straight_back);
    RUN(test_eye_amid);
    RUN(test_paths_unlit);
    RUN_LONG(test_layers);
    RUN(test_sources);
    RUN(test_table_of_sheets);
    RUN(test_polygons);
    RUN(test_polygon_paths);
    RUN(test_held);
    RUN(test_held_between);
    RUN(test_workers);
    RUN(test_regions);
    RUN(test_finite);
    RUN(test_emitter);
    RUN(test_refused);
    RUN(test_failures);
    RUN(test_failures_between);
    RUN(test_backward_lobes);
    RUN(test_held_looks);
    RUN(test_own_map);
    RUN(test_apart);
    RUN(test_apart_sizes);
    RUN(test_apart_paths);
    RUN(test_apart_shaded);
    RUN(test_many_groups);
    RUN(test_plan);
    RUN(test_qualities);
    RUN(test_chosen);
    sps_destroy(context);
    return check_report();
}
