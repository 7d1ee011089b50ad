/* Polygons about cells: the links that they close, what they reflect, and the light that cells send to them, each
   against geometry or an integral; whole pictures against random paths; a white sky above white floors. */

#include "check.h"

enum { SIDE = 16, PIXELS = SIDE * SIDE, COUNT = 4 * PIXELS };
static float image_a[COUNT], image_b[COUNT], image_c[COUNT];
static sps_context *context;
static check_triangles faces;
static const float one = 1;
static const sps_lobe forward = {0.85f, 1};

static void add_quad(double x, double y, double z, double ux, double uy, double uz, double vx, double vy, double vz) {
    const double origin[3] = {x, y, z}, u[3] = {ux, uy, uz}, v[3] = {vx, vy, vz};
    check_add_quad(&faces, origin, u, v);
}

/* A puff of gas about the origin, seen from above one side. Polygons come next. */
static void start(check_scene *s, const sps_lobe *lobe) {
    check_clear(s, SIDE, SIDE);
    check_set3(s->view.camera.position, 0, 1.2, 5);
    check_perspective(&s->view.camera, 0.7);
    check_add_puff(s, 6);
    s->volume[0].lobes = lobe, s->volume[0].lobe_count = lobe != NULL;
    check_color(s->volume[0].albedo, 1, 1, 1);
    s->view.scattering = SPS_SCATTERING_MULTIPLE;
    s->view.scattering_resolution = 16;
    faces.count = 0;
}

/* Gas of one density fills the same box. */
static void start_even(check_scene *s) {
    start(s, NULL);
    s->volume[0].eval_fn = NULL;
    s->volume[0].read_fn = check_read_constant;
    s->volume[0].user = (void *)(size_t)&one;
    s->volume[0].extinction = 1;
}

static const spsi_cell_grid *grid_of(const sps_context *by) {
    return (const spsi_cell_grid *)by->buffers[SPSI_BUFFER_CELL_GRID].data;
}

static const spsi_cell_job *job_of(const sps_context *by) {
    return (const spsi_cell_job *)by->buffers[SPSI_BUFFER_CELL_JOB].data;
}

static size_t cell_at(const spsi_cell_grid *grid, const int at[3]) {
    return (size_t)(at[2] * grid->size[1] + at[1]) * (size_t)grid->pitch + (size_t)at[0];
}

enum { ON_FLOOR, ABOVE_FLOOR, WALL, SKY, SLANT, COLORS, ROOM, GLOW, SMOKE, ROOF, PLACES };
static const char *const places[] = {"on a floor",        "above a floor",    "a wall amid gas", "floor under a sky",
                                     "floor at a slant",  "colored floor",    "lamp in a room",  "glow above a floor",
                                     "smoke under a sky", "glow above a roof"};

static void add_place(check_scene *s, int place) {
    if (place == ON_FLOOR || place == SKY || place == COLORS || place == SMOKE)
        add_quad(-4, -0.6, -4, 8, 0, 0, 0, 0, 8);
    if (place == ABOVE_FLOOR || place == GLOW) add_quad(-6, -2, -6, 12, 0, 0, 0, 0, 12);
    if (place == ROOF) {
        add_quad(-9, -3, -9, 18, 0, 0, 0, 0, 18);
        add_quad(-1, -2, -1, 1.6, 0, 0, 0, 0, 2);
        check_set3(s->view.camera.position, 0, -1.6, 5);
        check_set3(s->view.camera.target, 0, -2.9, 0);
    }
    if (place == WALL) add_quad(0.02, -3, -3, 0, 6, 0, 0, 0, 6);
    if (place == SLANT) add_quad(-4, -1.6, -4, 8, 1.6, 0, 0, 0, 8);
    if (place == ROOM) {
        for (int i = 0; i < 2; ++i)
            add_quad(-1, 2 * i - 1, -1, 2, 0, 0, 0, 0, 2), add_quad(2 * i - 1, -1, -1, 0, 2, 0, 0, 0, 2);
        add_quad(-1, -1, -1, 2, 0, 0, 0, 2, 0);
        check_add_point(s, 0.3, 0.5, 0.2, 1);
        check_set3(s->view.camera.position, 0, 0, 3.2);
    } else if (place == SKY || place == SMOKE) {
        check_color(s->scene.ambient, 0.5, 0.6, 0.7);
        if (place == SMOKE) check_color(s->volume[0].albedo, 0, 0, 0);
    } else if (place == GLOW || place == ROOF) { /* it scatters nothing */
        check_color(s->volume[0].albedo, 0, 0, 0);
        check_color(s->volume[0].emission, 3, 2, 1);
    } else {
        check_add_directional(s, place == WALL ? 1 : 0.3, place == WALL ? -0.1 : -1, -0.2, 1);
    }
    check_add_mesh(s, &faces, 0.8);
    if (place == COLORS) check_color(s->mesh[0].albedo, 0.9, 0.5, 0.2);
}

/* --- which links are closed --- */

typedef struct plane {
    double normal[3], offset;
} plane;

/* Whether a plane lies between two centres, neither of which may be in it. */
static int is_between(const plane *wall, const double a[3], const double b[3]) {
    return (vec_dot(wall->normal, a) > wall->offset) != (vec_dot(wall->normal, b) > wall->offset);
}

/* Adds a quadrangle in a plane, wide enough to cut all of the gas. */
static void add_plane(const plane *wall) {
    double u[3], v[3], origin[3];
    vec_basis(wall->normal, u, v);
    for (int k = 0; k < 3; ++k) origin[k] = wall->offset * wall->normal[k] - 5 * u[k] - 5 * v[k];
    add_quad(origin[0], origin[1], origin[2], 10 * u[0], 10 * u[1], 10 * u[2], 10 * v[0], 10 * v[1], 10 * v[2]);
}

/* Links between cells are closed just where the plane of a polygon is between their centres, from both sides. */
static void check_links(const plane *wall) {
    const spsi_cell_grid *grid = grid_of(context);
    int wrong = 0, closed = 0, at[3];
    for (at[2] = 0; at[2] < grid->size[2]; ++at[2])
        for (at[1] = 0; at[1] < grid->size[1]; ++at[1])
            for (at[0] = 0; at[0] < grid->size[0]; ++at[0])
                for (int link = 0; link < 27; ++link) {
                    const int from[3] = {at[0] - (link % 3 - 1), at[1] - (link / 3 % 3 - 1), at[2] - (link / 9 - 1)};
                    const int is = job_of(context)->walls[cell_at(grid, at)].closed >> link & 1;
                    double here[3], there[3];
                    int inside = link != 13;
                    for (int k = 0; k < 3; ++k) inside &= from[k] >= 0 && from[k] < grid->size[k];
                    if (!inside) continue;
                    spsi_cell_centre(grid, at[0], at[1], at[2], here);
                    spsi_cell_centre(grid, from[0], from[1], from[2], there);
                    wrong += is != is_between(wall, here, there);
                    closed += is;
                }
    if (figures()) printf("closed: %d, wrong: %d\n", closed, wrong);
    CHECK(wrong == 0);
    CHECK(closed > 100);
}

static void test_links(void) {
    static const plane walls[] = {{{0, 1, 0}, -0.6}, {{1, 0, 0}, 0.02}, {{0, 0, 1}, 0}, {{0.48, 0.6, 0.64}, 0.1}};
    for (int n = 0; n < 4; ++n) {
        check_scene s;
        start_even(&s);
        if (n == 2) s.view.scattering_resolution = 15; /* cells' centres are in the plane */
        check_add_directional(&s, 0.1, -1, 0.2, 1);
        add_plane(&walls[n]);
        check_add_mesh(&s, &faces, 0.5);
        check_render(context, &s, image_a);
        check_links(&walls[n]);
        check_translucent(&s.mesh[0], 0.5);
        s.mesh[0].revision = (uint64_t)n + 1;
        check_render(context, &s, image_a);
        for (size_t i = 0; i < grid_of(context)->count; ++i)
            if (job_of(context)->walls[i].closed) CHECK(!"panes close links");
    }
}

/* A plane cuts the patches of the four sides that it crosses: no patch reaches past it, and a row of them ends there,
   on the side of the grid's middle. Rays from these begin in cells whose middles are on that side. */
static void test_trimmed(void) {
    static const double cuts[6] = {2.55, 4.55, 6.55, 9.45, 11.45, 13.45}; /* just past middles */
    for (int n = 0; n < 6; ++n) {
        const int axis = n % 3;
        plane wall = {{0, 0, 0}, 0.145 * cuts[n] - 1.16}; /* edges of 0.145, from -1.16 on */
        const spsi_cell_grid *grid;
        double cut;
        check_scene s;
        start_even(&s);
        check_add_directional(&s, 0.2, -1, 0.1, 1);
        wall.normal[axis] = 1;
        add_plane(&wall);
        check_add_mesh(&s, &faces, 0.5);
        check_render(context, &s, image_a);
        grid = grid_of(context);
        cut = (wall.offset - grid->corner[axis]) / grid->edge;
        CHECK(fabs(cut - cuts[n]) < 1e-4);
        for (int side = 0; side < 6; ++side) {
            const int along = axis == 2 || (axis == 1 && side > 3) ? 5 : 4; /* extent across the plane */
            const int low = cut < 0.5 * grid->size[axis];
            int crossing = 0, ending = 0;
            if (side / 2 == axis) continue;
            for (int i = 0; i < SPSI_CELL_SHEET; ++i) {
                const double middle = (double)grid->patches[axis * SPSI_CELL_SHEET + i] / grid->edge;
                const double half = 0.5 * (double)grid->patches[along * SPSI_CELL_SHEET + i] / grid->edge;
                int at[3] = {0, 0, 0};
                double centre[3];
                if (spsi_cell_patch_side(i) != side) continue;
                crossing += middle - half < cut - 1e-4 && middle + half > cut + 1e-4;
                if (fabs((low ? middle - half : middle + half) - cut) > 1e-4) continue;
                ending += 1;
                at[axis] = (int)spsi_cell_patch_origin(grid, i, axis);
                spsi_cell_centre(grid, at[0], at[1], at[2], centre);
                CHECK((centre[axis] < wall.offset) != low);
            }
            CHECK(crossing == 0 && ending == SPSI_CELL_PATCHES);
        }
    }
}

/* Rays to what is outside the grid: on the mean of many cells along the direction that they stand for, and spread over
   its share of the sphere. */
static void test_rays(void) {
    enum { CELLS = 20 };
    static spsi_cell_direction directions[SPSI_CELL_DIRECTIONS];
    static spsi_cell_grid grid;
    static spsi_faces none;
    grid.edge = 0.25;
    grid.size[0] = grid.size[1] = grid.size[2] = CELLS;
    spsi_cell_directions(directions);
    for (int i = 0; i < SPSI_CELL_DIRECTIONS; ++i) {
        const float *harmonic = directions[i].harmonic;
        const double back = -sqrt(1.0 / 3);
        const double way[3] = {back * (double)harmonic[3], back * (double)harmonic[1], back * (double)harmonic[2]};
        double mean[3] = {0, 0, 0}, square = 0;
        int count = 0, wrong = 0;
        for (int cell = 0; cell < CELLS * CELLS * CELLS; ++cell) {
            spsi_cell_view view = {&none, &grid, {0, 0, 0}, {0, 0, 0}};
            spsi_ray ray;
            spsi_hit hit;
            double off[3];
            int leaves = 0;
            spsi_cell_view_move(&view, cell % CELLS, cell / CELLS % CELLS, cell / CELLS / CELLS);
            for (int k = 0; k < 3; ++k) {
                const int next = view.at[k] - directions[i].step[k];
                leaves |= next < 0 || next >= CELLS;
            }
            ray.high = 0;
            wrong += spsi_cell_view_outside(&view, &directions[i], i, &ray, &hit) || (ray.high > 1) != leaves;
            if (!leaves) continue;
            for (int k = 0; k < 3; ++k) ray.direction[k] /= grid.edge, mean[k] += ray.direction[k];
            vec_along(ray.direction, way, -1, off);
            square += vec_dot(off, off);
            ++count;
        }
        CHECK(count >= CELLS * CELLS && wrong == 0);
        for (int k = 0; k < 3; ++k) CHECK_NEAR(mean[k] / count, way[k], 0.02);
        CHECK_NEAR(square / count, 2 * (double)directions[i].weight, 0.1 * (double)directions[i].weight);
    }
}

/* Irradiance by one channel of a grid, or of its sides alone. */
static double irradiance_of(const spsi_cell_grid *grid, int sides, int channel, const double point[3],
                            const double normal[3], const float *open) {
    const spsi_cell_receiver to = {point, normal, open, SPSI_CELL_SIDE / (grid->light_count > 0 ? 4 : 8)};
    double irradiance[3];
    if (sides)
        spsi_cells_irradiance_outside(grid, channel, 1, &to, irradiance);
    else
        spsi_cells_irradiance(grid, channel, 1, &to, irradiance);
    return irradiance[0];
}

/* No light passes an opaque plane, at whatever angle, and gas behind it stays dark. */
static void test_dark_side(void) {
    static const plane walls[] = {{{1, 0, 0}, 0.02}, {{0.48, 0.6, 0.64}, 0.1}};
    for (int n = 0; n < 2; ++n) {
        double lit = 0, dark = 0, beside[3], facing[3];
        const spsi_cell_grid *grid;
        int at[3];
        check_scene s;
        start_even(&s);
        check_add_directional(&s, -walls[n].normal[0], -walls[n].normal[1], -walls[n].normal[2], 1);
        add_plane(&walls[n]);
        check_add_mesh(&s, &faces, 0.5);
        check_render(context, &s, image_a);
        grid = grid_of(context);
        for (at[2] = 0; at[2] < grid->size[2]; ++at[2])
            for (at[1] = 0; at[1] < grid->size[1]; ++at[1])
                for (at[0] = 0; at[0] < grid->size[0]; ++at[0]) {
                    double centre[3], side;
                    spsi_cell_centre(grid, at[0], at[1], at[2], centre);
                    side = vec_dot(walls[n].normal, centre) - walls[n].offset;
                    if (side > 0) lit = fmax(lit, (double)grid->moments[cell_at(grid, at)]);
                    if (side < -1.8 * grid->edge) dark = fmax(dark, (double)grid->moments[cell_at(grid, at)]);
                }
        if (figures()) printf("before a wall up to %.3g, behind it %.3g\n", lit, dark);
        CHECK(lit > 0.05);
        CHECK(dark <= (n ? 0.02 : SPSI_CELL_BALANCE) * lit); /* at a slant, cells that it cuts have lit samples */
        for (int k = 0; k < 3; ++k) beside[k] = 4 * walls[n].normal[k], facing[k] = -walls[n].normal[k];
        lit = irradiance_of(grid, 1, 0, beside, facing, NULL); /* rays from the grid's sides stop at the plane, too */
        for (int k = 0; k < 3; ++k) beside[k] = -beside[k];
        dark = irradiance_of(grid, 1, 0, beside, walls[n].normal, NULL);
        CHECK(dark <= (n ? 0.02 : SPSI_CELL_BALANCE) * lit);
    }
}

/* --- what cells send to polygons --- */

/* Irradiance by the sides of a box of uniform exitance, by 200 x 200 points each. */
static double box_irradiance(const spsi_cell_grid *grid, const double point[3], const double normal[3]) {
    enum { POINTS = 200 };
    double sum = 0;
    for (int side = 0; side < 6; ++side) {
        const int axis = side / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
        const double area = grid->edge * grid->size[u] * grid->edge * grid->size[v] / (POINTS * POINTS);
        for (int i = 0; i < POINTS * POINTS; ++i) {
            double from[3], way[3], facing, leaving, square;
            from[axis] = grid->corner[axis] + side % 2 * grid->edge * grid->size[axis];
            from[u] = grid->corner[u] + (i % POINTS + 0.5) / POINTS * grid->edge * grid->size[u];
            from[v] = grid->corner[v] + (i / POINTS + 0.5) / POINTS * grid->edge * grid->size[v];
            for (int k = 0; k < 3; ++k) way[k] = from[k] - point[k];
            facing = vec_dot(way, normal), square = vec_dot(way, way);
            leaving = side % 2 ? -way[axis] : way[axis];
            if (facing > 0 && leaving > 0) sum += facing * leaving / (square * square) * area / PI;
        }
    }
    return sum;
}

/* Even cones before a wall, of which cells know degrees 0 and 1: irradiance is pi sin^2 a cos b, a being half the angle
   and b how far its axis leans. The fullest hemisphere is exact. A ray's degree 2 is exact, its degree 4 is left out:
   1 / 16 straight ahead, less at a slant. Degrees 0 and 1 alone miss a quarter of it. */
static void test_cones(void) {
    static const double cones[][2] = {{0, 1}, {0.5, 1}, {0.8, 1}, {0.9999, 1}, {0.866, 0.5}, {0.7, 0.8}, {0.95, 0.9}};
    static float flux[4];
    spsi_cell_grid grid;
    memset(&grid, 0, sizeof grid);
    grid.flux_terms = 4, grid.count = 1;
    for (int i = 0; i < 7; ++i) {
        const double c = cones[i][0], b = cones[i][1], axis[3] = {sqrt(1 - b * b), 0, b}, normal[3] = {0, 0, 1};
        float harmonic[SPSI_CELL_TERMS];
        spsi_harmonics(axis, harmonic);
        for (int t = 0; t < 4; ++t) flux[t] = (float)(t ? 0.25 * (1 - c * c) : 0.5 * (1 - c)) * harmonic[t];
        spsi_harmonics(normal, harmonic);
        const double found = spsi_cell_irradiance(&grid, flux, harmonic), exact = PI * (1 - c * c) * b;
        if (figures()) printf("cone %g, %g: %+.1f %%\n", c, b, 100 * (found / exact - 1));
        CHECK_NEAR(found, exact, (i ? 0.0626 : 1e-6) * exact);
    }
}

/* A grid whose sides send the same everywhere, at a few places and angles. Parts of patches at most half as wide as far
   away count as points with a term of second order; the next one is of order (1/2)^4 / 24. A patch's width off, halves
   of patches are seen at a slant: within 12 %. */
static void test_outside(void) {
    static const double places[][3] = {{0, -3, 0}, {0.3, -1.4, 0.2}, {1.5, -1.3, 0.5}, {3, 2, -2.5}, {-1.55, 0.2, 0}};
    static const double normals[][3] = {{0, 1, 0}, {-0.6, 0.8, 0}, {0.48, 0.6, 0.64}, {-0.8, 0, 0.6}};
    static spsi_cell_grid grid;
    static float patches[(SPSI_CELL_PLACES + 1 + SPSI_CELL_TERMS) * SPSI_CELL_SHEET], shut[SPSI_CELL_SHEET];
    static float flux[64 * 12 * 5], thick = 1e6f;
    double worst[2] = {0, 0};
    memset(&grid, 0, sizeof grid);
    grid.size[0] = 16, grid.size[1] = 12, grid.size[2] = 5;
    grid.edge = 0.15, grid.channels = 1, grid.patches = patches, grid.flux = flux;
    grid.thick = &thick; /* the shape of the grid does not show in what leaves */
    for (int k = 0; k < 3; ++k) grid.corner[k] = -0.5 * grid.edge * grid.size[k];
    static spsi_cell_solver solver; /* whose links are open */
    spsi_cell_job job;
    memset(&job, 0, sizeof job);
    job.solver = &solver;
    job.grid = &grid;
    spsi_cells_place_patches(&job);
    for (int i = 0; i < 2 * SPSI_CELL_SHEET; ++i) patches[SPSI_CELL_PLACES * SPSI_CELL_SHEET + i] = 1; /* flux; even */
    for (int n = 0; n < 5 * 4; ++n) {
        const double *place = places[n / 4], *normal = normals[n % 4];
        const double exact = box_irradiance(&grid, place, normal),
                     found = irradiance_of(&grid, 0, 0, place, normal, NULL);
        double off = fabs(found - exact);
        if (figures()) printf("place %d, normal %d: %.5f, exact %.5f\n", n / 4, n % 4, found, exact);
        CHECK(off <= (n / 4 == 4 ? 0.12 : 0.02) * exact + 0.002);
        worst[n / 4 % 3 != 0] = fmax(worst[n / 4 % 3 != 0], off / fmax(exact, 0.01));
    }
    if (figures()) printf("worst %.3f, close by %.3f\n", worst[0], worst[1]);
    { /* next to its centre a patch is all that a surface sees; the change to light within takes a sixth of a patch,
         0.05, of which `before` is half away */
        const size_t middle = SPSI_CELL_SIDE / 2 + 4;
        const double point[3] = {grid.corner[0] - 0.01, grid.corner[1] + (double)patches[SPSI_CELL_SHEET + middle],
                                 grid.corner[2] + (double)patches[2 * SPSI_CELL_SHEET + middle]};
        const double before[3] = {-1.225, 0.2, 0}, normal[3] = {1, 0, 0};
        CHECK_NEAR(irradiance_of(&grid, 1, 0, point, normal, NULL), 1, 0.05);
        CHECK_NEAR(irradiance_of(&grid, 0, 0, before, normal, NULL),
                   0.5 * irradiance_of(&grid, 1, 0, before, normal, NULL), 1e-6);
        for (int i = 0; i < 64 * 12 * 5; ++i) flux[i] = 1;
        grid.flux_terms = 1, grid.pitch = spsi_cell_pitch(16);
        CHECK(irradiance_of(&grid, 0, 0, before, normal, NULL) > 0.4 * PI);
        CHECK(irradiance_of(&grid, 0, 0, before, normal, shut) == 0); /* what hides all patches hides all cells */
    }
}

/* Light that leaves a patch as a polynomial of degree 3 in its direction is found again from its rays. Floats: 5e-4. */
static void test_polynomials(void) {
    static spsi_cell_rays rays;
    spsi_cell_rays_build(&rays);
    for (int term = 0; term < SPSI_CELL_TERMS; ++term)
        for (int i = 0; i < SPSI_CELL_TERMS; ++i) {
            double sum = 0;
            for (int n = 0; n < SPSI_CELL_RAYS; ++n) sum += (double)(rays.fit[i][n] * rays.harmonic[term][n]);
            CHECK_NEAR(sum, i == term, 5e-4);
        }
}

/* Moments of light that comes evenly from half of all directions give a surface before it pi times its radiance, one
   that looks away nothing, and one aside half of that. */
static void test_within(void) {
    static const double normals[][3] = {{0, 1, 0}, {0, -1, 0}, {1, 0, 0}, {0, 0.6, 0.8}};
    static const double shares[] = {1, 0, 0.5, 0.8};
    static spsi_cell_grid grid;
    static float flux[9 * 2 * 2 * 2 * SPSI_LANES];
    memset(&grid, 0, sizeof grid), memset(flux, 0, sizeof flux);
    grid.size[0] = grid.size[1] = grid.size[2] = 2;
    grid.pitch = spsi_cell_pitch(2), grid.count = (size_t)grid.pitch * 4;
    grid.edge = 1, grid.channels = 1, grid.flux_terms = 9, grid.flux = flux;
    for (size_t i = 0; i < grid.count; ++i) { /* light that falls: the mean of y over the lower half is -1 / 2 */
        flux[i] = 0.5f;
        flux[grid.count + i] = (float)(-0.25 * sqrt(3.0));
    }
    for (int n = 0; n < 4; ++n) {
        const double point[3] = {1, 1, 1};
        CHECK_NEAR(irradiance_of(&grid, 0, 0, point, normals[n], NULL), PI * shares[n], 1e-5);
    }
}

/* Cells behind a polygon, which may be dark, do not count for what it receives. */
static void test_before(void) {
    static spsi_cell_grid grid;
    static float flux[4 * 4 * 4 * 4 * SPSI_LANES];
    memset(&grid, 0, sizeof grid), memset(flux, 0, sizeof flux);
    grid.size[0] = grid.size[1] = grid.size[2] = 4;
    grid.pitch = spsi_cell_pitch(4), grid.count = (size_t)grid.pitch * 16;
    grid.edge = 1, grid.channels = 1, grid.flux_terms = 4, grid.flux = flux;
    for (int z = 0; z < 4; ++z)
        for (int x = 0; x < 4; ++x)
            for (int y = 2; y < 4; ++y) flux[(z * 4 + y) * grid.pitch + x] = 1;
    for (double y = 1.55; y < 2.5; y += 0.1) {
        const double up[3] = {0, 1, 0}, point[3] = {2.2, y, 1.7};
        CHECK_NEAR(irradiance_of(&grid, 0, 0, point, up, NULL), PI, 1e-5);
    }
}

/* What leaves the grid by its sides is all that is sent in it, less what is absorbed: for a floor far below and gas
   that absorbs nothing, the light that goes in. Residuals are a part of all that is scattered, once or again. With
   fewer than 5 cells, rays are off by more than what is scaled, 5 %. */
static void test_leaving(void) {
    static const int sides[] = {16, 9, 6, 5};
    for (int n = 0; n < 4; ++n) {
        const spsi_cell_grid *grid;
        double out = 0, in = 0, scattered = 0;
        check_scene s;
        start(&s, NULL);
        s.view.scattering_resolution = sides[n];
        check_add_directional(&s, 0.2, -1, 0.3, 1);
        add_quad(-1, -900, -1, 2, 0, 0, 0, 0, 2);
        check_add_mesh(&s, &faces, 0.5);
        check_render(context, &s, image_a);
        grid = grid_of(context);
        for (int i = 0; i < SPSI_CELL_SHEET; ++i)
            out += (double)(grid->patches[3 * SPSI_CELL_SHEET + i] *
                            grid->patches[SPSI_CELL_PLACES * SPSI_CELL_SHEET + i]);
        for (size_t i = 0; i < grid->count; ++i) /* E / 4 pi, weighted by optical depth; four samples of half an edge */
            in += (double)job_of(context)->incoming[i] / 4 * 4 * PI * grid->edge * grid->edge;
        for (size_t i = 0; i < grid->count; ++i)
            scattered += (double)(grid->depth[i] * grid->moments[i]) * 4 * PI * grid->edge * grid->edge;
        if (figures()) printf("%d cells: out %.4f of %.4f, scattered %.4f\n", sides[n], out, in, scattered);
        CHECK_NEAR(out, in, SPSI_CELL_BALANCE * (in + scattered));
    }
}

/* Dense gas sends most light back to the side that it comes from. */
static void test_sides(void) {
    for (int n = 0; n < 6; ++n) {
        double sides[2] = {0, 0}, way[3] = {0, 0, 0};
        const float *patches;
        check_scene s;
        start(&s, NULL);
        way[n / 2] = n % 2 ? -1 : 1;
        check_add_directional(&s, way[0], way[1], way[2], 1);
        add_quad(500, -900, 700, 2, 0, 0, 0, 0, 2);
        check_add_mesh(&s, &faces, 0.5);
        check_render(context, &s, image_a);
        patches = grid_of(context)->patches + SPSI_CELL_PLACES * SPSI_CELL_SHEET;
        for (int i = 0; i < 2 * SPSI_CELL_SIDE; ++i)
            sides[i / SPSI_CELL_SIDE] += (double)patches[n / 2 * 2 * SPSI_CELL_SIDE + i];
        if (figures()) printf("light along axis %d: %.2f and %.2f\n", n / 2, sides[0], sides[1]);
        CHECK(sides[n % 2] > 2 * sides[1 - n % 2]);
    }
}

/* --- what is in the way of that --- */

/* The polygons of the last picture, and their tree. */
static spsi_faces faces_of(const sps_context *by) {
    spsi_faces held;
    memset(&held, 0, sizeof held);
    held.list = (const spsi_face *)by->buffers[SPSI_BUFFER_FACES].data;
    held.count = held.tree.count = (int)faces.count;
    held.extent = 10;
    held.tree.nodes = (spsi_tree_node *)by->buffers[SPSI_BUFFER_FACE_NODES].data;
    held.tree.order = (int *)by->buffers[SPSI_BUFFER_FACE_ORDER].data;
    spsi_bounds_centre(&by->mesh_bounds, held.tree.centre);
    return held;
}

/* A point of the picture's polygons, which looks up. */
static void look_up(const spsi_faces *held, int face, double x, double y, double z, spsi_surface *surface,
                    spsi_cell_visibility *sight) {
    static const double up[3] = {0, 1, 0};
    check_set3(surface->point, x, y, z);
    memcpy(surface->start, surface->point, sizeof surface->start);
    memcpy(surface->normal, up, sizeof up);
    sight->grid = grid_of(context), sight->faces = held, sight->surface = surface, sight->normal = up;
    sight->face = face;
}

/* Whether a rectangle at y, of the given corners, is between two points. */
static int is_hidden(const double from[3], const double to[3], double y, const double low[2], const double high[2]) {
    const double share = (y - from[1]) / (to[1] - from[1]);
    const double x = from[0] + share * (to[0] - from[0]), z = from[2] + share * (to[2] - from[2]);
    return share > 0 && share < 1 && x > low[0] && x < high[0] && z > low[1] && z < high[1];
}

/* Irradiance of a point that looks up, below a rectangle at `y`: the patches' own, each times what 24 x 24 points of it
   see. `all`: without the rectangle. `off`: by how much rays may be off. A shadow's edge along an axis meets the rays
   of a row of patches one by one: four of each of its patches where it is, so it is a quarter of the largest patch off
   at most. There are four edges on each of three sides, of which those along an axis are seen once at a time. */
static double roofed(const spsi_cell_grid *grid, const double point[3], double y, const double low[2],
                     const double high[2], double *all, double *off) {
    enum { POINTS = 24 };
    const double up[3] = {0, 1, 0};
    double sum = 0;
    *all = *off = 0;
    for (int side = 0; side < 6; ++side) {
        double largest = 0, hidden = 0;
        for (int n = side * SPSI_CELL_SIDE; n < (side + 1) * SPSI_CELL_SIDE; ++n) {
            const int axis = side / 2, along[2] = {axis == 0 ? 1 : 0, axis == 2 ? 1 : 2};
            const int at[2] = {n % SPSI_CELL_PATCHES, n / SPSI_CELL_PATCHES % SPSI_CELL_PATCHES};
            float open[SPSI_CELL_SHEET] = {0};
            double sent, to[3];
            int seen = 0;
            open[n] = 1;
            sent = irradiance_of(grid, 1, 0, point, up, open);
            to[axis] = grid->corner[axis] + grid->edge * (side % 2 ? grid->size[axis] - 0.51 : 0.51);
            for (int i = 0; i < POINTS * POINTS && sent > 0; ++i) {
                const double part[2] = {(i % POINTS + 0.5) / POINTS, (i / POINTS + 0.5) / POINTS};
                for (int k = 0; k < 2; ++k) {
                    const double begin = spsi_cell_patch_begin(at[k]), end = spsi_cell_patch_begin(at[k] + 1);
                    to[along[k]] =
                        grid->corner[along[k]] + grid->edge * grid->size[along[k]] * (begin + part[k] * (end - begin));
                }
                seen += !is_hidden(point, to, y, low, high);
            }
            *all += sent;
            sum += sent * seen / (POINTS * POINTS);
            hidden += sent * (1 - (double)seen / (POINTS * POINTS));
            largest = fmax(largest, sent);
        }
        if (hidden > 0) *off += 4 * largest / 4;
    }
    return sum;
}

/* Renders the scene with the quads that were added as its mesh, and returns what the context holds of them. */
static spsi_faces render_faces(check_scene *s) {
    s->scene.mesh_count = 0;
    check_add_mesh(s, &faces, 0.8);
    check_render(context, s, image_a);
    return faces_of(context);
}

/* Floors below a roof, at places all about: what an integral with exact shadows says. In the middle there is nothing,
   far off all. */
static void test_roof(void) {
    static const double sizes[] = {0.3, 0.8, 2};
    const double step = check_long() ? 0.61 : 1.22;
    for (int n = 0; n < 3; ++n) {
        const double low[2] = {-sizes[n] - 0.2, -sizes[n]}, high[2] = {sizes[n], sizes[n] + 0.1};
        double worst = 0, mean = 0, darkest = 1, lightest = 0;
        int count = 0;
        spsi_faces held;
        check_scene s;
        start(&s, NULL);
        add_place(&s, GLOW);
        s.volume[0].extinction *= 20; /* so dense that its light does not fly, but leaves by the grid's sides */
        faces.count = 0;
        add_quad(-9, -3, -9, 18, 0, 0, 0, 0, 18);
        add_quad(low[0], -2, low[1], high[0] - low[0], 0, 0, 0, 0, high[1] - low[1]);
        held = render_faces(&s);
        for (double x = -6.1; x < 6.2; x += step)
            for (double z = -6.1; z < 6.2; z += step) {
                float open[SPSI_CELL_SHEET];
                spsi_surface surface;
                spsi_cell_visibility sight;
                double all, off, exact, found;
                int some;
                look_up(&held, x > z ? 0 : 1, x, -3, z, &surface, &sight);
                some = spsi_cells_visibility(&sight, open);
                exact = roofed(grid_of(context), surface.point, -2, low, high, &all, &off);
                found = irradiance_of(grid_of(context), 0, 0, surface.point, sight.normal, some ? open : NULL);
                CHECK_NEAR(found, exact, off + 1e-5 * all);
                worst = fmax(worst, fabs(found - exact) / all), mean += fabs(found - exact) / all, ++count;
                darkest = fmin(darkest, found / all), lightest = fmax(lightest, found / all);
            }
        if (figures())
            printf("roof of %.1f: off by up to %.4f, mean %.4f; from %.4f to %.4f of what it would be\n", sizes[n],
                   worst, mean / count, darkest, lightest);
        CHECK(n < 2 || darkest < 1e-6);
        CHECK_NEAR(lightest, 1, 1e-5);
        CHECK(mean / count < 0.002);
    }
}

/* Rays are traced only where an opaque polygon may be between. Floors have no shadow of their own, at whatever
   slant. */
static void test_free(void) {
    const double step = check_long() ? 0.61 : 1.22;
    for (int n = 0; n < 6; ++n) {
        const double slant = n == 5 ? 0.2 : 0;
        int rays = 0, hidden = 0;
        spsi_faces held;
        check_scene s;
        start(&s, NULL);
        add_place(&s, GLOW);
        faces.count = 0;
        if (n == 0) add_quad(-9, -3, -9, 18, 0, 0, 0, 0, 18);
        if (n == 1) add_quad(-9, -3, -9, 18, 0, 0, 0, 0, 18), add_quad(-1, -3.5, -1, 2, 0, 0, 0, 0, 2);
        if (n == 2) add_quad(-9, -3, -9, 18, 0, 0, 0, 0, 18), add_quad(-1, 1.5, -1, 2, 0, 0, 0, 0, 2);
        if (n == 3) add_quad(-9, -3, -9, 18, 0, 0, 0, 0, 18), add_quad(8, -3, -1, 0, 3, 0, 0, 0, 2);
        for (int i = 0; i < 30 * 30 && n >= 4; ++i) {
            const double x = -9 + 0.6 * (i % 30), z = -9 + 0.6 * (i / 30);
            add_quad(x, -3 + slant * x, z, 0.6, slant * 0.6, 0, 0, 0, 0.6);
        }
        held = render_faces(&s);
        for (double x = -6.1; x < 6.2; x += step)
            for (double z = -6.1; z < 6.2; z += step) {
                float open[SPSI_CELL_SHEET];
                spsi_surface surface;
                spsi_cell_visibility sight;
                const double normal[3] = {-slant / sqrt(1 + slant * slant), 1 / sqrt(1 + slant * slant), 0};
                look_up(&held, -1, x, -3 + slant * x, z, &surface, &sight);
                sight.normal = normal;
                rays += spsi_cell_visibility_near(&sight) != 0;
                hidden += spsi_cells_visibility(&sight, open);
            }
        if (figures()) printf("floor %d: %d with rays, %d hidden\n", n, rays, hidden);
        CHECK(n == 5 || rays == 0);
        CHECK(hidden == 0);
    }
}

/* The picture of a floor is the same, to the bit, with a polygon below it, which is not in the way. A pane above it
   that lets pass half of all light leaves half of what glows where it is in the way, all of it elsewhere, and something
   between where it hides a part. With a roof it is darker. */
static void test_same_floor(void) {
    double sums[2][2] = {{0, 0}, {0, 0}}, half = 0, whole = 0;
    for (int k = 0; k < 8; ++k) {
        const int n = k % 4, scatters = k / 4; /* gas sends a sun's light by cells; its own flies */
        check_scene s;
        if (scatters && n == 1) continue; /* panes filter both alike */
        if (scatters) {
            start_even(&s);
            check_add_directional(&s, 1, 0, 0, 1); /* along the floor, and past what is above it */
        } else {
            start(&s, NULL);
            add_place(&s, GLOW);
            s.volume[0].extinction *= 0.05f;
        }
        check_set3(s.view.camera.position, 0, -2.5, 5);
        check_set3(s.view.camera.target, 0, -2.9, 0);
        faces.count = 0;
        add_quad(-9, -3, -9, 18, 0, 0, 0, 0, 18);
        if (n == 2) add_quad(-2, -3.5, -2, 4, 0, 0, 0, 0, 4);
        if (n == 3) add_quad(-2, -2, -2, 4, 0, 0, 0, 0, 4);
        s.scene.mesh_count = 0;
        check_add_mesh(&s, &faces, 0.8);
        if (n == 1) {
            static check_triangles pane;
            const double origin[3] = {-2, -2, -2}, u[3] = {4, 0, 0}, v[3] = {0, 0, 4};
            pane.count = 0;
            check_add_quad(&pane, origin, u, v);
            check_translucent(check_add_mesh(&s, &pane, 0), 0.5);
            check_render(context, &s, image_a);
            check_free_triangles(&pane);
        } else {
            check_render(context, &s, n ? image_a : image_b);
        }
        for (int i = COUNT / 2; i < COUNT && n == 1; ++i) { /* the lower half of the picture */
            const double open = (double)image_b[i], filtered = (double)image_a[i];
            /* along the sides of 16 pixels beside polygons light is linear, up to 1.4 % more than it curves */
            CHECK(filtered <= open * 1.014 && filtered >= open * (0.5 - 1e-5));
            if (i % 4 < 3) half += filtered, whole += open;
        }
        if (n == 2) CHECK(memcmp(image_a + COUNT / 2, image_b + COUNT / 2, COUNT / 2 * sizeof *image_a) == 0);
        for (int i = COUNT / 2; i < COUNT && n == 3; ++i)
            if (i % 4 < 3) sums[scatters][0] += (double)image_a[i], sums[scatters][1] += (double)image_b[i];
    }
    if (figures()) printf("a floor below a pane is %.3f of what it would be\n", half / whole);
    CHECK(half < 0.9 * whole);
    for (int scatters = 0; scatters < 2; ++scatters) {
        const double share = sums[scatters][0] / sums[scatters][1];
        if (figures()) printf("a floor below a roof is %.3f of what it would be\n", share);
        CHECK(share < 0.7 && share > 0.01);
    }
}

/* --- what polygons send --- */

/* A wide floor below thin gas, which a sun above lights, sends everywhere half of what even light would be: within the
   share of directions in the plane of its horizon, a seventh, half of which see it on the mean of many cells. None
   where a plate keeps the sun off. */
static void test_floor_sends(void) {
    static const int sides[] = {16, 24};
    for (int n = 0; n < 4; ++n) {
        double least = HUGE_VAL, most = 0;
        const double reflectance = 0.3, sent = reflectance / PI;
        const spsi_cell_grid *grid;
        int at[3];
        check_scene s;
        start_even(&s);
        s.view.scattering_resolution = sides[n % 2];
        s.volume[0].extinction = 1e-3f;
        check_add_directional(&s, 0, -1, 0, 1);
        add_quad(-90, -1.3, -90, 180, 0, 0, 0, 0, 180);
        if (n / 2) add_quad(-90, 2, -90, 180, 0, 0, 0, 0, 180);
        check_add_mesh(&s, &faces, reflectance);
        check_render(context, &s, image_a);
        grid = grid_of(context);
        at[0] = at[2] = grid->size[0] / 2;
        for (at[1] = 0; at[1] < grid->size[1]; ++at[1]) {
            const double found = (double)(grid->moments[cell_at(grid, at)] - grid->flux[cell_at(grid, at)]);
            least = fmin(least, found / sent), most = fmax(most, found / sent);
        }
        if (figures()) printf("below %s: %.4f to %.4f of what it sends\n", n / 2 ? "a plate" : "the sun", least, most);
        CHECK(n / 2 ? most < 1e-3 : least > 0.5 - 0.5 / 7 - 0.005 && most < 0.5 + 0.5 / 7);
    }
}

/* A floor in the picture is brighter by what cells send to it, in its color. */
static void test_floor_receives(void) {
    double off = 0, more = 0;
    check_scene s;
    start(&s, NULL);
    add_place(&s, ABOVE_FLOOR);
    s.view.filling = SPS_FILLING_SPLAT; /* cells' tables have other samples than the other picture's sheets, */
    s.view.shadow_resolution = 64, s.view.slab_thickness = 1; /* and neither texels nor slabs that follow pixels */
    check_color(s.mesh[0].albedo, 0.9, 0.6, 0.3);
    check_render(context, &s, image_a);
    s.view.scattering = SPS_SCATTERING_SINGLE;
    check_render(context, &s, image_b);
    for (int x = 0; x < SIDE; ++x) { /* the lowest row of pixels, in front of the gas */
        const double toward[3] = {0, -1.2, -5}, right[3] = {1, 0, 0}, up[3] = {0, 5 / 5.141984, -1.2 / 5.141984};
        const double half = 5.141984 * tan(0.35), i = ((x + 0.5) / SIDE * 2 - 1) * half, normal[3] = {0, 1, 0};
        const double k = (1.0 / SIDE - 1) * half;
        double ray[3], point[3];
        for (int axis = 0; axis < 3; ++axis) ray[axis] = toward[axis] + i * right[axis] + k * up[axis];
        for (int axis = 0; axis < 3; ++axis)
            point[axis] = s.view.camera.position[axis] + (-2 - 1.2) / ray[1] * ray[axis];
        for (int c = 0; c < 3; ++c) {
            const size_t at = 4 * (size_t)((SIDE - 1) * SIDE + x) + (size_t)c;
            const double exact =
                (double)s.mesh[0].albedo[c] / PI * irradiance_of(grid_of(context), 0, c, point, normal, NULL);
            off = fmax(off, fabs((double)image_a[at] - (double)image_b[at] - exact)), more = fmax(more, exact);
        }
    }
    if (figures()) printf("a floor is brighter by up to %.4f, off by %.2g\n", more, off);
    CHECK(more > 0.003);
    CHECK(off < 5e-5); /* the distance of points, rounded to floats, where light falls off by its square */
}

/* Between pixels that receive cells' light it is interpolated: pictures of a few pixels' width have it exactly. Along
   lines of three knots it departs from a straight line by 4 % at most. Where it is smooth, parabolas through the knots
   are off by the third derivative, a tenth of that. Where it has a kink, at the grid's border, or a step, where patches
   divide, they are off by half of it along each axis; along the second, they add up to 5/4 of the first's. */
static void test_received_between(void) {
    enum { WIDE = 160, NEAR = 5 };
    static float wide[4 * WIDE * WIDE], close[4 * NEAR * NEAR];
    for (int place = ON_FLOOR; place <= ABOVE_FLOOR; ++place) {
        double most = 0, squares = 0;
        int count = 0;
        check_scene s;
        start(&s, NULL);
        add_place(&s, place);
        check_set3(s.light[0].direction, 1, 0, -0.3); /* along the floor, which has cells' light only */
        check_set3(s.view.camera.position, 0, 4, 5);
        check_perspective(&s.view.camera, 0.9);
        s.view.width = s.view.height = WIDE;
        s.volume[0].revision = s.mesh[0].revision = 1000 + (uint64_t)place; /* light is solved once */
        if (!check_render(context, &s, wide)) return;
        const double *eye = s.view.camera.position, low[3] = {-1, -1, -1}, high[3] = {1, 1, 1};
        const double away = sqrt(eye[1] * eye[1] + eye[2] * eye[2]), half = tan(0.45);
        check_scene near_by = s;
        near_by.view.width = near_by.view.height = NEAR;
        near_by.view.camera.field_of_view = 1e-3;
        for (int n = 0; n < WIDE * WIDE; n += 67) {
            const double right = (2 * (n % WIDE + 0.5) / WIDE - 1) * half;
            const double up = (1 - 2 * (n / WIDE + 0.5) / WIDE) * half;
            const double way[3] = {right, (-eye[1] + up * eye[2]) / away, (-eye[2] - up * eye[1]) / away};
            double range[2];
            spsi_ray ray = {{eye[0], eye[1], eye[2]}, {way[0], way[1], way[2]}, 0, HUGE_VAL};
            if (spsi_ray_meets_box(&ray, low, high, range) || wide[4 * n + 3] < 0.999f) continue;
            for (int k = 0; k < 3; ++k) near_by.view.camera.target[k] = eye[k] + way[k];
            if (!check_render(context, &near_by, close)) return;
            const double exact = (double)close[4 * (NEAR * NEAR / 2)], off = fabs((double)wide[4 * n] - exact);
            most = fmax(most, off / exact), squares += off * off / exact / exact, ++count;
        }
        if (figures())
            printf("received between, %s: off by %.2g at most, rms %.2g, %d points\n", places[place], most,
                   sqrt(squares / count), count);
        CHECK(count > 50);
        CHECK(most < 0.02 + 1.25 * 0.02);
        CHECK(squares < count * 0.006 * 0.006);
    }
}

/* Weak lobes take few moments, beside polygons, too. */
static void test_orders(void) {
    static const float asymmetries[] = {0, 0.2f, 0.25f, 0.6f};
    static const int orders[4] = {1, 2, 4, 4};
    for (int n = 0; n < 8; ++n) {
        const sps_lobe lobe = {asymmetries[n % 4], 1};
        check_scene s;
        start(&s, &lobe);
        add_place(&s, SKY);
        if (n < 4) s.scene.mesh_count = 0;
        check_render(context, &s, image_a);
        CHECK(grid_of(context)->orders == orders[n % 4]);
    }
}

/* Even gas is solved with one moment, but lights polygons by four: by those that a lobe of asymmetry 1e-4, which takes
   four throughout, has. Its scattering differs by 3e-4 at most, besides the residual of 5e-4. */
static void test_even_moments(void) {
    static const sps_lobe lobe = {1e-4f, 1};
    enum { MOST = 1 << 17 };
    static float even[MOST];
    for (int weak = 0; weak < 2; ++weak) {
        check_scene s;
        start(&s, weak ? &lobe : NULL);
        add_place(&s, ON_FLOOR);
        check_add_directional(&s, 0.3, -1, -0.2, 3);
        check_render(context, &s, image_a);
        const spsi_cell_grid *grid = grid_of(context);
        const size_t count = 4 * grid->count * (size_t)grid->channels;
        double largest[4] = {0}, off[4] = {0};
        if (!CHECK(grid->terms == (weak ? 4 : 1) && grid->flux_terms == 4 && count <= MOST)) return;
        if (!weak) memcpy(even, grid->flux, count * sizeof(float));
        for (size_t i = 0; i < count; ++i) {
            const size_t term = i / grid->count % 4;
            largest[term] = fmax(largest[term], fabs((double)even[i]));
            off[term] = fmax(off[term], fabs((double)grid->flux[i] - (double)even[i]));
        }
        for (int t = 0; t < 4 && weak; ++t) {
            if (figures()) printf("moment %d: %.2g of %.3f\n", t, off[t], largest[t]);
            CHECK(largest[t] > 0.01 && off[t] < 1e-3 * largest[0]);
        }
    }
}

/* --- whole pictures --- */

/* Grey gas above a grey floor has the color of its lights, whatever their kind, with peaks and without: channels are
   computed alike, and differ by the rounding of sums of floats: 1e-6 of the brightest pixel is 17 roundings. */
static void test_colored_lights(void) {
    for (int n = 0; n < 16; ++n) {
        sps_light *light;
        check_scene s;
        double off = 0, most = 0;
        start(&s, n % 2 ? &forward : NULL);
        add_quad(-6, -2, -6, 12, 0, 0, 0, 0, 12);
        check_add_mesh(&s, &faces, 0.5);
        if (n / 4 == 0) light = check_add_directional(&s, 1, -0.4, 0.3, 1);
        if (n / 4 == 1) light = check_add_point(&s, 1.5, 2, 1, 10);
        if (n / 4 > 1) light = check_add_point(&s, 0.3, 2.6, 0.4, 100), check_set3(light->direction, -0.1, -1, -0.15);
        if (n / 4 > 1) light->outer_cone = n / 4 == 2 ? 0.4 : 0.05, light->inner_cone = light->outer_cone / 2;
        light->no_shadow = n / 2 % 2;
        for (int c = 1; c < 3; ++c) light->color[c] = (float)(c + 1) * light->color[0];
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < PIXELS; ++i)
            for (int c = 1; c < 3; ++c)
                off = fmax(off, fabs((double)image_a[4 * i + c] / (c + 1) - (double)image_a[4 * i]));
        for (int i = 0; i < PIXELS; ++i) most = fmax(most, (double)image_a[4 * i]);
        if (figures()) printf("light %d: channels apart by %.2g of the brightest pixel\n", n, off / most);
        CHECK(most > 0 && off <= 1e-6 * most);
    }
}

/* White floors and gas that absorbs nothing vanish before a white sky. */
static void test_white_floor(void) {
    for (int n = 0; n < 4; ++n) {
        double off = 0;
        check_scene s;
        start(&s, n % 2 ? &forward : NULL);
        if (n / 2) add_quad(-9, -0.4, -9, 18, 0, 0, 0, 0, 18);
        add_quad(-1, -2, -1, 2, 0.7, 0, 0, 0, 2);
        check_add_mesh(&s, &faces, 1);
        s.view.quality = SPS_QUALITY_ULTRA; /* rays end where 5e-5 of light would pass */
        check_color(s.scene.ambient, 2, 2, 2);
        check_color(s.scene.background, 2, 2, 2);
        check_render(context, &s, image_a);
        for (int i = 0; i < COUNT; ++i)
            if (i % 4 < 3) off = fmax(off, fabs((double)image_a[i] - 2));
        if (figures()) printf("white floor: off by %.2g\n", off);
        CHECK_CASE("Scattering", "white floors amid and below gas of albedo 1, before a white sky", "invisible", off,
                   2 * 6e-5, "rays end at 5e-5; floats");
    }
}

/* Gas by polygons, in their light, in front of them and behind. Scattered once, light is 16 to 74 % short. Were nothing
   in the way of what gas sends, the floor below a roof would be half too bright. */
static void test_paths(void) {
    const int roof = check_long() ? 1000 : 300; /* paths below it */
    for (int n = 0; n < 2 * PLACES; ++n) {
        const int place = n / 2;
        char name[64];
        check_scene s;
        if (!check_long() && n % 2 != place % 2) continue;
        if (place == ROOM)
            start_even(&s), s.volume[0].lobes = &forward, s.volume[0].lobe_count = n % 2;
        else
            start(&s, n % 2 ? &forward : NULL);
        if (place == WALL || place == GLOW || place == SMOKE) /* thin: pixels are wider than voxels, and blur its rim */
            s.volume[0].extinction = 1;
        add_place(&s, place);
        snprintf(name, sizeof name, "%s, g %g", places[place], n % 2 ? 0.85 : 0);
        /* the light of a lamp within gas: 7 %; the sides of a grid, where the light that a roof hides comes from
           further up: 4 % */
        check_paths(context, &s, name, place == ROOF ? roof : 30, place == ROOM ? 0.08 : place == ROOF ? 0.06 : 0.03);
    }
}

/* A floor amid forward gas, or below it, under a sun without shadows: gas passes nothing on of the sun's light, but
   scatters what the floor reflects. */
static void test_paths_unshadowed(void) {
    for (int below = 0; below < 2; ++below) {
        check_scene s;
        start_even(&s);
        s.volume[0].lobes = &forward, s.volume[0].lobe_count = 1;
        check_set3(s.view.camera.position, 0, 4, 3);
        check_add_directional(&s, 0, -1, 0, 1)->no_shadow = 1;
        add_quad(-4, below ? -1.6 : -0.6, -4, 8, 0, 0, 0, 0, 8);
        check_add_mesh(&s, &faces, 0.8);
        check_paths(context, &s, below ? "floor below, unshadowed sun" : "floor, unshadowed sun", 60, 0.03);
    }
}

/* A spot that a black roof amid the gas cuts off is narrow there, though its cone would be wide at the gas's far end:
   gas gets the light of the whole cone. */
static void test_paths_cut_spot(void) {
    check_scene s;
    sps_light *spot;
    start_even(&s);
    s.volume[0].extinction = 3;
    add_quad(-4, 0.4, -4, 8, 0, 0, 0, 0, 8);
    check_add_mesh(&s, &faces, 0);
    check_set3(s.view.camera.position, 0, 2, 5), check_set3(s.view.camera.target, 0, 0.7, 0);
    check_orthographic(&s.view.camera, 1.5);
    spot = check_add_point(&s, 0.1, 1.6, 0.2, 10);
    check_set3(spot->direction, 0, -1, 0);
    spot->inner_cone = 0.1, spot->outer_cone = 0.15;
    check_paths(context, &s, "a spot cut by a roof", 300, 0.03);
}

/* Even gas under a sun, or with a peak beside a lamp whose light is kept apart in part, in any unit of length: powers
   of two round nothing. */
static void start_scaled(check_scene *s, int lamp, double scale) {
    start_even(s);
    add_place(s, lamp ? GLOW : ABOVE_FLOOR);
    if (lamp) {
        s->volume[0].lobes = &forward, s->volume[0].lobe_count = 1;
        check_color(s->volume[0].albedo, 0.9, 0.9, 0.9), check_color(s->volume[0].emission, 0, 0, 0);
        check_add_point(s, 1.7, 0.3, 0.2, 5 * scale * scale);
    }
    for (size_t i = 0; i < faces.count; ++i)
        for (int k = 0; k < 9; ++k) faces.list[i].position[k / 3][k % 3] *= (float)scale;
    for (int i = 0; i < 3; ++i) {
        s->view.camera.position[i] *= scale;
        s->volume[0].placement.origin[i] *= scale;
        s->light[0].position[i] *= scale;
        for (int k = 0; k < 3; ++k) s->volume[0].placement.axis[i][k] *= scale;
    }
    s->volume[0].extinction /= (float)scale;
    s->mesh[0].revision = (uint64_t)(8192 * scale);
}

static void test_scaled(void) {
    static const double scales[] = {1.0 / 8192, 131072};
    for (int n = 0; n < 4; ++n) {
        check_scene s;
        start_scaled(&s, n / 2, 1);
        if (!check_render(context, &s, image_b)) return;
        start_scaled(&s, n / 2, scales[n % 2]);
        if (!check_render(context, &s, image_a)) return;
        if (figures())
            printf("scale %g: off by %.2g of %.2g\n", scales[n % 2], check_largest(image_a, image_b, COUNT),
                   mean_of(image_b, PIXELS));
        CHECK(check_largest(image_a, image_b, COUNT) <= 1e-5 * mean_of(image_b, PIXELS));
    }
}

/* Exchanges the axes of a vector: x becomes y, y z, and z x, `by` times. */
static void turn(double v[3], int by) {
    const double kept[3] = {v[0], v[1], v[2]};
    for (int k = 0; k < 3; ++k) v[(k + by) % 3] = kept[k];
}

static const double turned_sides[3] = {1.5, 0.7, 0.45};

/* Gas that fades out towards the sides of an oblong box: how faces lie in cells would depend on the axis. */
static double turned_gas(const void *user, const double p[3]) {
    const int by = *(const int *)user;
    double value = 1;
    for (int k = 0; k < 3; ++k) value *= fmax(cos(0.5 * PI * p[(k + by) % 3] / turned_sides[k]), 0);
    value = fmin(2 * value, 1);
    return value * value;
}

/* Dense gas in an oblong grid about a floor and a wall, with its axes exchanged. */
static void start_turned(check_scene *s, int by) {
    const double *sides = turned_sides;
    static int number;
    static const check_field field = {turned_gas, &number, {0, 0, 0}, {{0, 0, 0}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}}};
    double quads[6][3] = {{-4, -0.2, -4}, {8, 0.3, 0}, {0, 0, 8}, {0.3, -0.2, -4}, {0.2, 2, 0}, {0, 0, 8}};
    sps_placement *placement = &s->volume[0].placement;
    start_even(s);
    s->volume[0].extinction = 60;
    s->volume[0].read_fn = NULL;
    s->volume[0].eval_fn = check_eval_field, s->volume[0].user = (void *)(size_t)&field;
    number = by;
    for (int i = 0; i < 6; ++i) turn(quads[i], by);
    for (int i = 0; i < 6; i += 3) check_add_quad(&faces, quads[i], quads[i + 1], quads[i + 2]);
    check_add_mesh(s, &faces, 0.8)->revision = (uint64_t)by + 1;
    check_add_directional(s, 0.4, -1, -0.3, 1);
    check_set3(s->view.camera.position, -2, 1.5, 4);
    s->view.scattering_resolution = 40;
    memset(placement, 0, sizeof *placement);
    for (int k = 0; k < 3; ++k) {
        const int to = (k + by) % 3;
        placement->origin[to] = -sides[k], placement->axis[to][to] = 2 * sides[k];
        s->volume[0].size[to] = (int)(40 * sides[k]);
    }
    turn(s->light[0].direction, by), turn(s->view.camera.position, by), turn(s->view.camera.up, by);
}

/* The picture is the same: of the light that polygons send to and fro, 5e-3 may be missing in each. */
static void test_turned(void) {
    for (int by = 0; by < 3; ++by) {
        check_scene s;
        double off;
        start_turned(&s, by);
        if (!check_render(context, &s, by ? image_a : image_b)) return;
        off = by ? check_rms(image_a, image_b, COUNT) : 0;
        if (figures()) printf("turned %d times: off by %.2g of %.2g\n", by, off, mean_of(image_b, PIXELS));
        CHECK(off <= 2 * 5e-3 * mean_of(image_b, PIXELS));
    }
}

/* Colors do not mix: each channel is that of a picture all of whose gas and polygons have its color. Numbers of rounds
   are chosen by the brightest one, and what is left out beyond them is below a thousandth of the light. */
static void test_channels(void) {
    static const double colors[3] = {0.98, 0.8, 0.5};
    for (int channel = -1; channel < 3; ++channel) {
        const double same = channel < 0 ? 0 : colors[channel];
        double off = 0;
        check_scene s;
        start(&s, &forward);
        add_place(&s, ON_FLOOR);
        if (channel < 0)
            check_color(s.volume[0].albedo, colors[0], colors[1], colors[2]);
        else
            check_color(s.volume[0].albedo, same, same, same);
        if (!check_render(context, &s, channel < 0 ? image_b : image_a)) return;
        for (int i = 0; i < PIXELS && channel >= 0; ++i)
            off = fmax(off, fabs((double)image_a[4 * i + channel] - (double)image_b[4 * i + channel]));
        if (figures()) printf("channel %d: off by %.2g of %.2g\n", channel, off, mean_of(image_b, PIXELS));
        CHECK(off <= 1e-3 * mean_of(image_b, PIXELS));
    }
}

/* --- workers, memory --- */

static void test_workers(void) {
    for (int n = 0; n < 2; ++n) {
        check_scene s;
        start(&s, &forward);
        add_place(&s, n ? ROOF : COLORS);
        check_color(s.scene.ambient, 0.1, 0.2, 0.3);
        check_workers(&s, image_a, image_b);
    }
}

static void test_failures(void) {
    check_scene s;
    start(&s, NULL);
    add_place(&s, SKY);
    s.view.width = s.view.height = 8;
    s.view.quality = SPS_QUALITY_DRAFT;
    s.view.scattering_resolution = 6;
    s.volume[0].revision = s.mesh[0].revision = 1;
    for (int k = 0; k < 3; ++k) s.volume[0].size[k] = 8;
    CHECK(check_failing(&s, 0, 0, image_a, image_b) > 17);
}

/* What cells and polygons about them take is planned; a tree is planned where only the sky lights them, too. */
static void test_plan(void) {
    for (int n = 0; n < 2; ++n) {
        static const int own[] = {SPSI_BUFFER_CELL_GRID,   SPSI_BUFFER_CELL_JOB,     SPSI_BUFFER_CELLS,
                                  SPSI_BUFFER_CELL_SOLVER, SPSI_BUFFER_CELL_MOMENTS, SPSI_BUFFER_CELL_WALLS};
        sps_context *by = check_context(NULL);
        sps_plan_report report;
        size_t bytes = 0;
        check_scene s;
        start(&s, NULL);
        add_place(&s, SKY);
        if (n) s.scene.mesh_count = 0;
        CHECK_OK(by, sps_plan(by, &s.scene, &s.view, &report));
        CHECK(report.pass[SPS_PASS_TRIANGLE_TREE].runs == !n);
        CHECK((report.pass[SPS_PASS_TRIANGLE_TREE].bytes > 0) == !n);
        check_render(by, &s, image_a);
        for (int i = 0; i < 6; ++i) /* what is seen and held of cells is planned for all grids that there may be */
            bytes += (i == 4 ? SPSI_CELL_GRIDS : 1) * by->buffers[own[i]].size;
        if (figures()) printf("plan: %zu of %zu bytes\n", bytes, report.pass[SPS_PASS_CELLS].bytes);
        CHECK(bytes <= report.pass[SPS_PASS_CELLS].bytes && bytes > report.pass[SPS_PASS_CELLS].bytes / 10 * 8);
        sps_destroy(by);
    }
}

/* --- beside a slab, and beside gas about a lamp --- */

/* Neighbours in a row, the first of which was rounded to below an entry, are interpolated as any other lanes are. The
   first is off by up to 4e-5 of an entry; entries differ by up to 1. */
static void test_neighbours(void) {
    enum { PITCH = 48 };
    static float depth[4 * PITCH];
    const int size[3] = {40, 2, 2};
    float x[SPSI_LANES], found[2][SPSI_LANES];
    for (int i = 0; i < 4 * PITCH; ++i) depth[i] = i % PITCH < 40 ? (float)(i * 37 % 64) / 64 : 0;
    for (int from = 0; from < 40; ++from) {
        spsi_v at[3];
        for (int i = 0; i < SPSI_LANES; ++i) x[i] = (float)(from + i);
        x[0] -= 1e-6f * x[0];
        at[0] = spsi_load(x), at[1] = spsi_set(0.25f), at[2] = spsi_set(0.5f);
        for (int even = 0; even < 2; ++even) spsi_store(found[even], spsi_cells_between(depth, PITCH, size, at, even));
        for (int i = 0; i < SPSI_LANES && from + i < 40; ++i)
            if (!CHECK_NEAR((double)found[1][i], (double)found[0][i], 1e-4)) printf("    at %d, lane %d\n", from, i);
    }
}

/* An isotropic slab of 6 x 6 x 2 and albedo 1 that a sun crosses, and a black wall: it reflects 1e-4. */
static void start_slab(check_scene *s, double depth, double z, check_triangles *wall) {
    const double origin[3] = {-40, -40, z}, side[2][3] = {{80, 0, 0}, {0, 80, 0}};
    memset(wall, 0, sizeof *wall);
    start_even(s);
    s->volume[0].extinction = (float)depth / 2;
    for (int k = 0; k < 3; ++k) s->volume[0].size[k] = k < 2 ? 96 : 32;
    s->volume[0].placement = check_box(-3, -3, 0, 3, 3, 2);
    s->scene.light_count = s->scene.mesh_count = 0;
    check_add_quad(wall, origin, side[0], side[1]);
    check_add_mesh(s, wall, 1e-4);
    check_add_directional(s, 0, 0, 1, 1);
    check_orthographic(&s->view.camera, 0.5);
    s->view.width = s->view.height = 4;
    s->view.scattering_resolution = 48;
}

static const double slab_depths[4] = {0.3, 1, 3, 6};

/* Irradiance of the wall by light that has scattered. Exact are 2e6 random paths each in doubles from the wall's point
   (SplitMix64, seed 2025) through the field that the voxels stand for, the box blurred by 0.65 voxels, within 0.3 %.
   The picture's is that of the sides' patches: light that leaves them in between the cells' directions is interpolated,
   and their own errors are a hundredth each for rims, rays and what is near. */
static void test_behind_slab(void) {
    static const double distance[] = {0.5, 1, 2, 3};
    static const double exact[4][4] = {{0.08234, 0.06892, 0.04780, 0.03353},
                                       {0.20863, 0.17798, 0.12566, 0.08933},
                                       {0.26517, 0.23237, 0.16860, 0.12103},
                                       {0.18846, 0.16699, 0.12211, 0.08697}};
    for (int n = 0; n < 16; ++n) {
        const double z = 2 + distance[n % 4], depth = slab_depths[n / 4];
        check_triangles wall;
        double sum = 0, off;
        check_scene s;
        if (!check_long() && n % 5) continue; /* each depth and each distance once */
        start_slab(&s, depth, z, &wall);
        check_set3(s.view.camera.position, 0, 0, 2 + 0.6 * distance[n % 4]), check_set3(s.view.camera.target, 0, 0, z);
        check_render(context, &s, image_a);
        for (int i = 0; i < 64; i += 4) sum += (double)image_a[i] * 1e4 * PI / 16;
        off = (sum - exp(-depth)) / exact[n / 4][n % 4] - 1;
        if (figures()) printf("depth %g, %g behind: %+.1f %%\n", depth, distance[n % 4], 100 * off);
        CHECK_CASE("Scattering", "a wall 0.5 to 3 behind a slab of depth 0.3 to 6", "random paths, relative", fabs(off),
                   0.04, "degree 3 in directions at the grid's sides; straight light, whose depth is off by 0.1 %");
        check_free_triangles(&wall);
    }
}

/* Floors, walls aside and before it, askew and past its edges, by paths as above (the eighth place's by 8e5 photons,
   the others' within 0.7 %). What the cells send to these places is within 2.5 %, summed along rays; harmonics up to
   degree 3 over the shape of the grid are within 2 % of that beside it. Without the shape, and by the cells' 25
   directions on each side, light past the edges was 9 % too bright. */
static void test_beside_slab(void) {
    enum { BESIDE = 16 };
    static const double places[BESIDE][6] = {
        {0, -3.5, 1, 0, 1, 0},      {1, -4, 0.5, 0, 1, 0},    {0, -5, 2, 0, 1, 0},     {4.5, 0.5, 1.5, -1, 0, 0},
        {5, -4, 3, -0.6, 0.8, 0},   {0, -4, 3, 0, 0.6, -0.8}, {0.5, 0.3, -1, 0, 0, 1}, {0.1, -3.5, 0, 0, 0, 1},
        {3, -4, 1, -1, 0, 0},       {2.5, -5, 1, 0, 1, 0},    {3, -5, 1, -1, 0, 0},    {2.5, -7, 1, 0, 1, 0},
        {0.1, -3.5, 1.75, 0, 1, 0}, {2.7, 0.1, 3, 0, 0, -1},  {0.1, -7, 0, 0, 0, 1},   {0.1, -4, 2.2, 0, 0, -1}};
    static const double exact[4][BESIDE] = {{0.06837, 0.04712, 0.02776, 0.03726, 0.01515, 0.03527, 0.07135, 0.02687,
                                             0.02005, 0.02339, 0.01145, 0.01240, 0.05708, 0.04477, 0.00241, 0.01933},
                                            {0.16172, 0.11157, 0.06061, 0.08408, 0.03118, 0.08080, 0.21459, 0.06576,
                                             0.04327, 0.05039, 0.02480, 0.02593, 0.12261, 0.10730, 0.00526, 0.04758},
                                            {0.23286, 0.16882, 0.07661, 0.11227, 0.03273, 0.09094, 0.46942, 0.10023,
                                             0.05582, 0.06598, 0.03245, 0.03295, 0.13610, 0.12053, 0.00669, 0.06735},
                                            {0.21469, 0.17293, 0.06633, 0.10127, 0.02448, 0.06385, 0.64035, 0.10253,
                                             0.05067, 0.06156, 0.03012, 0.03052, 0.09995, 0.07477, 0.00580, 0.06016}};
    double squares = 0;
    for (int n = 0; n < 4; ++n) {
        check_triangles wall;
        check_scene s;
        start_slab(&s, slab_depths[n], 200, &wall);
        check_set3(s.view.camera.position, 0, 0, 100), check_set3(s.view.camera.target, 0, 0, 200);
        check_render(context, &s, image_a);
        for (int i = 0; i < BESIDE; ++i) {
            const double off = irradiance_of(grid_of(context), 0, 0, places[i], places[i] + 3, NULL) / exact[n][i] - 1;
            if (figures()) printf("depth %g, place %d beside: %+.1f %%\n", slab_depths[n], i, 100 * off);
            squares += off * off / (4 * BESIDE);
            CHECK_CASE("Scattering", "floors and walls 0.5 to 3 beside a slab of depth 0.3 to 6",
                       "random paths, relative", fabs(off), 0.04, "degree 3 in directions at the grid's sides");
        }
        check_free_triangles(&wall);
    }
    if (figures()) printf("beside a slab: rms %.2f %%\n", 100 * sqrt(squares));
    CHECK(sqrt(squares) < 0.02);
}

/* Length of a way out of the slab. */
static double slab_way(const double from[3], const double way[3]) {
    double out = 1e30;
    for (int k = 0; k < 3; ++k)
        if (fabs(way[k]) > 1e-9)
            out = fmin(out, ((way[k] > 0 ? (k < 2 ? 3 : 2) : (k < 2 ? -3 : 0)) - from[k]) / way[k]);
    return out;
}

/* Irradiance of a place by what the slab, of albedo 0.1, scatters once of a sun (light[3]: 0) or lamp of color 1: the
   integral over the slab, by the midpoints of 15552 boxes: 0.1 % off. */
static double single_irradiance(double g, double extinction, const double light[4], const double place[6]) {
    const double lobe[2] = {1 + g * g, 1 - g * g};
    double sum = 0;
    for (int i = 0; i < 36 * 36 * 12; ++i) {
        const double at[3] = {(i % 36 + 0.5) / 6 - 3, (i / 36 % 36 + 0.5) / 6 - 3, (i / (36 * 36) + 0.5) / 6};
        double way[3], back[3], distance, square, sent = 1;
        for (int k = 0; k < 3; ++k) way[k] = place[k] - at[k], back[k] = light[3] > 0 ? light[k] - at[k] : -light[k];
        distance = vec_length(way);
        if (light[3] > 0) sent = 1 / vec_dot(back, back);
        vec_normalise(way), vec_normalise(back);
        square = lobe[0] + 2 * g * vec_dot(way, back);
        sum += sent * exp(-extinction * (slab_way(at, back) + slab_way(at, way))) * lobe[1] /
               (4 * PI * square * sqrt(square)) * fmax(-vec_dot(way, place + 3), 0) / (distance * distance);
    }
    return 0.1 * extinction * sum / (6 * 6 * 6);
}

/* Thin gas that scatters forward: walls three cells and more beside the slab have no bands, under a sun, under two in
   unequal colors, or under a lamp 0.8 of the slab's side off. Walls behind it get what its peak scatters from there,
   not along the sun's rays. What scatters twice adds up to 1 % at an albedo of 0.1 and a depth of at most 0.3 along the
   longest way. Sums of degree 3 about the shape of the grid are within 4 % beside isotropic gas; lobes hardly wider
   than parts of patches, within 5 %. Two directions of a lamp along a way add 2 % at single places: a third one changes
   them by that. Where gas scatters backward, what scatters twice goes on as light did: its albedo is 0.01. Sums of
   degree 3 of the lobe itself were off by 12 % at g 0.5, by up to 63 % at 0.8. */
static void test_lobes_beside_slab(void) {
    enum { BESIDE = 12 };
    static const sps_lobe lobes[5] = {{0.5f, 1}, {0.8f, 1}, {0.8f, 1}, {0.8f, 1}, {-0.6f, 1}};
    static const double blues[5] = {1, 1, 0.25, 0, 1}, albedos[5] = {0.1, 0.1, 0.1, 0.1, 0.01};
    static const double sun[4] = {0, 0, 1, 0}, others[2][4] = {{0.6, 0, 0.8, 0}, {-5.5, -5, -3.5, 1}};
    for (int n = 0; n < 5; ++n) { /* g 0.5, then 0.8: under a sun, two, a lamp; backward, under a sun */
        const double g = (double)lobes[n].asymmetry, blue = blues[n], albedo = albedos[n];
        double all[2][2] = {{0, 0}, {0, 0}}, found, exact, place[6] = {0, 0, 3, 0, 0, -1};
        check_triangles wall;
        check_scene s;
        if (!check_long() && n == 1) continue; /* the next has this lobe, too */
        start_slab(&s, 0.1, 3, &wall);
        s.volume[0].lobes = &lobes[n], s.volume[0].lobe_count = 1;
        check_color(s.volume[0].albedo, albedo, albedo, albedo);
        if (n == 2) check_color(s.light[0].color, 1, 0.5, 0.25), check_add_directional(&s, 0.6, 0, 0.8, 1);
        if (n == 3) s.scene.light_count = 0, check_add_point(&s, -5.5, -5, -3.5, 1);
        check_set3(s.view.camera.position, 0, 0, 2.6), check_set3(s.view.camera.target, 0, 0, 3);
        check_render(context, &s, image_a);
        found = (double)image_a[20] * 1e4 * PI - exp(-0.1);
        exact = n < 2 ? single_irradiance(g, 0.05, sun, place) : 0;
        if (figures()) printf("g %.1f, case %d, behind: %.5f, exact %.5f\n", g, n, found, exact);
        if (n < 2) CHECK_NEAR(found, exact, 0.09 * exact);
        for (int i = 0; i < 2 * BESIDE; ++i) { /* 0.4 and 1.5 beside; 0.6 and 1.6 behind, within the shadow and not */
            const int behind = i >= BESIDE, channel = grid_of(context)->channels - 1;
            check_set3(place, i % 2 ? 4.5 : 3.4, 0.3, i / 2 - 0.5), check_set3(place + 3, -1, 0, 0);
            if (behind) check_set3(place, i / 2 - 5.5, 0.3, i % 2 ? 3.6 : 2.6), check_set3(place + 3, 0, 0, -1);
            found = irradiance_of(grid_of(context), 0, channel, place, place + 3, NULL);
            exact = blue > 0 ? blue * single_irradiance(g, 0.05, sun, place) : 0;
            if (n == 2 || n == 3) exact += single_irradiance(g, 0.05, others[n - 2], place);
            exact *= albedo / 0.1;
            if (figures()) printf("at %.1f, %.1f: %+.1f %%\n", place[0], place[2], 100 * (found / exact - 1));
            CHECK_NEAR(found, exact, (n == 3 ? 0.12 : 0.1) * exact);
            all[behind][0] += found, all[behind][1] += exact;
        }
        for (int i = 0; i < 2; ++i) CHECK_NEAR(all[i][0], all[i][1], 0.04 * all[i][1]);
        check_free_triangles(&wall);
    }
}

/* A wall behind gas of g 0.8 and a depth of 2 keeps its light where another gas, of g 0.81, is a trace of 1e-6, and
   where such a trace scatters evenly and comes first, so that gases with a peak have other numbers. Under a model for
   one gas alone, the wall behind lost a quarter, and one beside it up to 47 %. Floats: 1e-5. Two halves of the gas, of
   g 0.8 and 0.8001, are the gas, within what g changes, 1 - g by 5e-4. */
static void test_trace(void) {
    static const sps_lobe lobes[3] = {{0.8f, 1}, {0.81f, 1}, {0.8001f, 1}};
    double found[4];
    for (int n = 0; n < 4; ++n) {
        check_triangles wall;
        check_scene s;
        start_slab(&s, 2, 3, &wall);
        s.volume[0].lobes = lobes, s.volume[0].lobe_count = 1;
        if (n > 0) *check_add_volume(&s, 8, 8, 8, check_box(-1, -1, 0.5, 1, 1, 1.5)) = s.volume[0];
        if (n == 1) s.volume[1].extinction *= 1e-6f, s.volume[1].lobes = &lobes[1];
        if (n == 2) s.volume[0].extinction *= 1e-6f, s.volume[0].lobes = NULL, s.volume[0].lobe_count = 0;
        if (n == 3) s.volume[0].extinction *= 0.5f, s.volume[1].extinction *= 0.5f, s.volume[1].lobes = &lobes[2];
        check_set3(s.view.camera.position, 0, 0, 2.6), check_set3(s.view.camera.target, 0, 0, 3);
        check_render(context, &s, image_a);
        found[n] = (double)image_a[20];
        check_free_triangles(&wall);
    }
    if (figures())
        printf("a trace of gas: %.5g, %.5g instead of %.5g; two halves: %.5g\n", found[1], found[2], found[0],
               found[3]);
    for (int n = 1; n < 4; ++n) CHECK_NEAR(found[n], found[0], 1e-3 * found[0]);
}

/* Adds something of a millionth of the sun's power: a sun, a lamp outside, one in the gas, a spotlight, a sky, a glow,
   more suns than have sums of their own, as many lamps far away; or a disc of many tables, or trace of gas far away. */
static void add_faint(check_scene *s, int kind) {
    if (kind == 1) check_add_directional(s, 0, 1, 0.2, 1e-6);
    if (kind == 2) check_add_point(s, 0, -8, 1, 64e-6);
    if (kind == 3) check_add_point(s, 0, 0, 1, 1e-6);
    if (kind == 4) {
        sps_light *light = check_add_point(s, -7, 1, 1, 40e-6);
        check_set3(light->direction, 1, 0, 0), light->outer_cone = 0.6;
    }
    for (int k = 0; k < 3 && kind == 5; ++k) s->scene.ambient[k] = 1e-6f;
    if (kind == 6) {
        sps_volume *glow = check_add_volume(s, 4, 4, 4, check_box(-0.2, -0.2, 0.8, 0.2, 0.2, 1.2));
        glow->read_fn = check_read_constant, glow->eval_fn = NULL, glow->user = (void *)(size_t)&one;
        check_color(glow->emission, 1e-6, 1e-6, 1e-6);
    }
    for (int i = 0; i < 6 && kind == 7; ++i) check_add_directional(s, 0, i - 2.5, 0.2, 1e-7);
    for (int i = 0; i < 6 && kind == 8; ++i) check_add_point(s, -80, 10 * i, 1, 1e-3);
    if (kind == 9) {
        sps_light *light = check_add_point(s, -6, 0, -4, 1e-7);
        light->kind = SPS_LIGHT_DISC, light->axes[0][0] = light->axes[1][1] = 0.5;
        light->samples = 64, light->shadow_source = SPS_SHADOW_TABLE;
    }
    if (kind >= 10) { /* a lamp instead of the sun */
        s->scene.light_count = 0;
        check_add_point(s, 0, 0, -6, 40);
    }
    if (kind == 11) {
        *check_add_volume(s, 8, 8, 8, check_box(60, 0, 0, 62, 2, 2)) = s->volume[0];
        s->volume[1].placement = check_box(60, 0, 0, 62, 2, 2), s->volume[1].extinction *= 1e-6f;
    }
}

/* A wall 1.5 beside a slab of g 0.8, whose light such things change by no more than what they send: a millionth, of the
   sky up to 1e-4 where the wall is dark; and those that come first do not take the sun's sums. Any of them turned these
   off, for up to 47 % of that light; gas far away those of a lamp, for up to 90 %. */
static void test_faint(void) {
    static const sps_lobe lobe = {0.8f, 1};
    for (int n = 0; n < 12; ++n) {
        const int alone = n == 0 || n == 10;
        if (!check_long() && n > 0 && n < 10 && n != 3 && n != 6) continue; /* a lamp within, a glow */
        check_triangles floor;
        check_scene s;
        double worst = 0;
        start_slab(&s, 2, 3, &floor);
        s.scene.mesh_count = 0, faces.count = 0, s.view.scattering_resolution = check_long() ? 16 : 12;
        add_quad(4.5, -20, -20, 0, 40, 0, 0, 0, 40);
        check_add_mesh(&s, &faces, 1);
        s.volume[0].lobes = &lobe, s.volume[0].lobe_count = 1;
        check_color(s.volume[0].albedo, 0.9, 0.9, 0.9);
        check_set3(s.view.camera.position, 4, 0, 2), check_set3(s.view.camera.target, 4.5, 0, 2);
        s.view.camera.ortho_height = 3;
        add_faint(&s, n);
        if (n == 8 || n == 9) { /* what is faint comes first */
            const sps_light sun = s.light[0];
            memmove(s.light, s.light + 1, (size_t)(s.scene.light_count - 1) * sizeof sun);
            s.light[s.scene.light_count - 1] = sun;
        }
        for (int i = 0; i < s.scene.light_count; ++i) s.light[i].shadow_source = SPS_SHADOW_TABLE;
        check_render(context, &s, alone ? image_b : image_a);
        for (int i = 0; i < 64 && !alone; ++i)
            if (i % 4 < 3) worst = fmax(worst, fabs((double)image_a[i] / (double)image_b[i] - 1));
        if (figures()) printf("faint light %d: %.2g\n", n, worst);
        CHECK(worst <= 1e-3);
        check_free_triangles(&floor);
    }
}

/* Length of a ray's way out of the cube from -1 to 1. */
static double way_out(const double from[3], const double way[3]) {
    double length = HUGE_VAL;
    for (int k = 0; k < 3; ++k)
        if (fabs(way[k]) > 1e-30) length = fmin(length, ((way[k] > 0 ? 1 : -1) - from[k]) / way[k]);
    return length;
}

/* Irradiance of places that look along y, by what a cube of even isotropic gas of albedo 1 and extinction 1/2 scatters
   of a lamp of intensity 1: photons, in doubles. Each place where one scatters is seen by all. */
static void lamp_photons(const double lamp[3], double (*places)[3], int count, double *irradiance) {
    enum { PHOTONS = 60000 };
    check_random random = {7};
    memset(irradiance, 0, (size_t)count * sizeof *irradiance);
    for (int i = 0; i < PHOTONS; ++i) {
        double at[3] = {lamp[0], lamp[1], lamp[2]};
        for (;;) {
            const double z = 2 * check_next(&random) - 1, turn = 2 * PI * check_next(&random);
            const double way[3] = {sqrt(1 - z * z) * cos(turn), sqrt(1 - z * z) * sin(turn), z};
            const double free_length = -2 * log1p(-check_next(&random));
            if (free_length > way_out(at, way)) break;
            vec_along(at, way, free_length, at);
            for (int n = 0; n < count; ++n) {
                double toward[3], distance;
                vec_along(places[n], at, -1, toward);
                distance = vec_length(toward);
                vec_normalise(toward);
                irradiance[n] += exp(-0.5 * way_out(at, toward)) * -toward[1] / (distance * distance) / PHOTONS;
            }
        }
    }
}

/* A line on a floor 0.3 below gas about a lamp: 12 cells lie between. Directions made a star of it, 3.8 times as bright
   beside the lamp's foot. Photons are within 1.5 %. Samples of cells, half an edge apart, miss 5 % of what gas scatters
   next to a lamp. What no cell sends by itself comes along rays, which leave the places between 6 % too dark. */
static void test_star(void) {
    enum { PLACES_ON = 24 };
    const double lamp[3] = {0.11, 0.07, -0.05}, origin[3] = {-4, -1.3, -4}, side[2][3] = {{8, 0, 0}, {0, 0, 8}};
    double exact[PLACES_ON], at[PLACES_ON][3], worst = 0;
    check_triangles wall;
    check_scene s;
    memset(&wall, 0, sizeof wall);
    start_even(&s);
    s.volume[0].extinction = 0.5f;
    for (int k = 0; k < 3; ++k) s.volume[0].size[k] = 48;
    s.volume[0].placement = check_box(-1, -1, -1, 1, 1, 1);
    s.scene.mesh_count = 0;
    check_add_quad(&wall, origin, side[0], side[1]);
    check_add_mesh(&s, &wall, 1e-4);
    check_add_point(&s, lamp[0], lamp[1], lamp[2], 1);
    check_set3(s.view.camera.position, 0, -1.26, lamp[2]), check_set3(s.view.camera.target, 0, -1.3, lamp[2]);
    check_set3(s.view.camera.up, 0, 0, -1);
    check_orthographic(&s.view.camera, 3.0 / PLACES_ON);
    s.view.width = PLACES_ON, s.view.height = 1;
    s.view.scattering_resolution = 0;
    check_render(context, &s, image_a);
    for (int i = 0; i < PLACES_ON; ++i) check_set3(at[i], (i + 0.5) / PLACES_ON * 3 - 1.5, -1.3, lamp[2]);
    lamp_photons(lamp, at, PLACES_ON, exact);
    for (int i = 0; i < PLACES_ON; ++i) {
        double way[3], distance, straight;
        vec_along(at[i], lamp, -1, way);
        distance = vec_length(way);
        vec_normalise(way);
        straight = exp(-0.5 * way_out(lamp, way)) * -way[1] / (distance * distance);
        worst = fmax(worst, fabs(((double)image_a[4 * i] * 1e4 * PI - straight) / exact[i] - 1));
        if (figures())
            printf("%.2f aside: %.4f, exact %.4f\n", at[i][0] - lamp[0], (double)image_a[4 * i] * 1e4 * PI - straight,
                   exact[i]);
    }
    CHECK_CASE("Scattering", "a floor below gas about a lamp, what the gas sends", "photons, relative", worst, 0.125,
               "gas next to a lamp, 5 %; between rays, 6 %; photons, 1.5 %");
    check_free_triangles(&wall);
}

/* Smoke that fades within its box: a ball of a standard deviation of 0.5. user: 1, or -1: below a ceiling. */
static int smoke(void *user, size_t count, const double *places, float *values) {
    const double up = *(const double *)user;
    for (size_t i = 0; i < count; ++i, places += 3) {
        const double x = places[0], y = up * places[1] - 0.7, z = places[2] + 0.4;
        values[i] = (float)exp(-2 * (x * x + y * y + z * z));
    }
    return 0;
}

/* Smoke about a lamp, on a floor that cuts the lowest cells, or below a ceiling: light on it falls with distance,
   across the edge of the grid, too, in each color, whatever lamps are red. At 32 and 40 cells, the floor passes the
   centres of cells by 0.04 to 0.06 edges: patches reach past these centres, and cells there are cut off. Sides whose
   patches end above the floor or below it leave a rim, after which light rises by 2 to 8 %; places between knots, a
   pixel apart, may be off by a few per mille. */
static void test_rim(void) {
    enum { PLACES_ON = 20 };
    static const int cells[5] = {0, 0, 32, 32, 40};
    double rise = 0, up = 1;
    check_scene s;
    for (int n = 0; n < 5; n += check_long() || n == 2 ? 1 : 2) { /* a floor, a ceiling is left to the long test */
        up = n == 3 ? -1 : 1;
        start_even(&s);
        s.volume[0].placement = check_box(-1, up > 0 ? 0 : -1.4, -1.4, 1, up > 0 ? 1.4 : 0, 0.6);
        s.volume[0].read_fn = NULL, s.volume[0].eval_fn = smoke, s.volume[0].user = &up, s.volume[0].extinction = 3;
        for (int k = 0; k < 3; ++k) s.volume[0].size[k] = 32;
        check_color(s.volume[0].albedo, 0.95, 0.9, 0.8);
        add_quad(-6, 0, 6, 12, 0, 0, 0, 0, -12);
        check_add_mesh(&s, &faces, 0.7);
        check_add_point(&s, 0, up * 0.4, -0.4, 1.5);
        if (n > 0) s.light[0].color[0] = 0;
        check_set3(s.view.camera.position, 1.1, up * 20, -0.4), check_set3(s.view.camera.target, 1.1, 0, -0.4);
        check_set3(s.view.camera.up, 0, 0, -1);
        check_orthographic(&s.view.camera, 0.6 / PLACES_ON);
        s.view.width = PLACES_ON, s.view.height = 1;
        s.view.scattering_resolution = cells[n];
        check_render(context, &s, image_a);
        for (int i = 1; i < PLACES_ON; ++i)
            for (int c = n > 0; c < 3; ++c) {
                const int last = 4 * (up > 0 ? i : PLACES_ON - i) + c; /* a ceiling is seen mirrored */
                rise = fmax(rise, (double)(image_a[up > 0 ? last : last - 4] / image_a[up > 0 ? last - 4 : last]) - 1);
            }
        for (int i = 0; i < PLACES_ON && figures(); ++i)
            printf("%d cells, %d beside: %.4f\n", cells[n], i, (double)image_a[4 * i + 1]);
    }
    CHECK_CASE("Scattering", "a floor below smoke about a lamp, across the edge of the cells",
               "rise of light, relative", rise, 0.005, "what falls with distance does not rise; interpolation");
}

/* Gas takes light of the sky and sends a sun's. What polygons beside it get of both together is the sum of what they
   get of each, also at suns for which the two are about alike: there, what leaves the cells says nothing of the scale
   of what rays find. 3 %: that scale is within 5 % of 1, and half of a floor's light may come from gas. */
static void test_balance(void) {
    const int suns = check_long() ? 30 : 15;
    double worst = 0;
    check_scene s;
    start_even(&s);
    s.volume[0].placement = check_box(-0.5, -0.5, -0.5, 0.5, 0.5, 0.5);
    s.volume[0].extinction = 3;
    check_color(s.volume[0].albedo, 0.8, 0.8, 0.8);
    add_quad(-3, -0.8, -3, 6, 0, 0, 0, 0, 6);
    check_add_mesh(&s, &faces, 0.5);
    check_add_directional(&s, 0.3, -1, -0.2, 1)->shadow_source = SPS_SHADOW_TABLE; /* the same slabs without a sun */
    check_set3(s.view.camera.position, 0, 2.5, 3.5), check_set3(s.view.camera.target, 0, -0.4, 0);
    check_render(context, &s, image_a);
    for (int n = 0; n <= suns; ++n) {
        const double sun = n == 0 ? 0 : 7 * pow(1.002, (n - 1) * (30 / suns));
        check_color(s.light[0].color, sun, sun, sun);
        check_color(s.scene.ambient, 1, 1, 1);
        check_render(context, &s, n == 0 ? image_b : image_c);
        for (int i = 0; i < PIXELS && n > 0; ++i) {
            const double sum = (double)image_b[4 * i] + sun * (double)image_a[4 * i];
            worst = fmax(worst, sum > 0 ? fabs((double)image_c[4 * i] / sum - 1) : 0);
        }
    }
    if (figures()) printf("sun and sky: %.4f off the sum of both\n", worst);
    CHECK_CASE("Scattering", "a floor below gas that a sun and the sky light", "each alone, relative", worst, 0.03,
               "bounds of the scale of what leaves cells");
}

/* The spot of a narrow beam on a floor does not light a wall beside it, since light never goes from polygon to
   polygon: as far as gas of a depth of 1e-6 scatters nothing. */
static void test_spot(void) {
    check_scene s;
    sps_light *light;
    start_even(&s);
    s.volume[0].extinction = 1e-6f;
    add_quad(-2, -1, -2, 4, 0, 0, 0, 0, 4);
    add_quad(-2, -1, -1, 4, 0, 0, 0, 4, 0);
    check_add_mesh(&s, &faces, 0.8);
    light = check_add_point(&s, 0, 3, 0, 100);
    check_set3(light->direction, 0, -1, 0);
    light->outer_cone = 0.01;
    check_set3(s.view.camera.position, 0, 0, 5), check_set3(s.view.camera.target, 0, 0, 0);
    check_orthographic(&s.view.camera, 1);
    check_render(context, &s, image_a);
    if (figures()) printf("a wall beside a spot: %.2g\n", mean_of(image_a, PIXELS));
    CHECK(mean_of(image_a, PIXELS) < 1e-5);
}

int main(void) {
    context = check_context(NULL);
    RUN(test_links);
    RUN(test_rays);
    RUN(test_trimmed);
    RUN(test_dark_side);
    RUN(test_cones);
    RUN(test_outside);
    RUN(test_polynomials);
    RUN(test_within);
    RUN_LONG(test_behind_slab);
    RUN(test_neighbours);
    RUN(test_beside_slab);
    RUN(test_lobes_beside_slab);
    RUN(test_trace);
    RUN(test_faint);
    RUN(test_star);
    RUN(test_rim);
    RUN(test_balance);
    RUN(test_spot);
    RUN(test_before);
    RUN(test_leaving);
    RUN(test_sides);
    RUN(test_roof);
    RUN(test_free);
    RUN(test_same_floor);
    RUN(test_floor_sends);
    RUN(test_floor_receives);
    RUN(test_received_between);
    RUN(test_orders);
    RUN(test_even_moments);
    RUN_LONG(test_colored_lights);
    RUN(test_white_floor);
    RUN(test_paths);
    RUN(test_paths_unshadowed);
    RUN(test_paths_cut_spot);
    RUN_LONG(test_scaled);
    RUN_LONG(test_turned);
    RUN(test_channels);
    RUN(test_workers);
    RUN(test_failures);
    RUN(test_plan);
    sps_destroy(context);
    check_free_triangles(&faces);
    return check_report();
}
