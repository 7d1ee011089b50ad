/* examples/six_way.h and bake six-way: what a card's maps hold, by closed forms and by renders of single lights; which
   channel it goes into; names of frames; the shader; and the command line. */

#include "check.h"
#include "six_way.h"
#include "command_line.h"
#include "shaders/six_way.h"
#include <unistd.h>

enum { TILE = 24, PIXELS = TILE * TILE };

/* ---------------------------------------------------------------------------------------------------- the scenes */

/* A cloud without any symmetry, in a box from -1 to 1; *(float *)user is what it is multiplied by. */
static int cloud(void *user, size_t count, const double *xyz, float *out) {
    for (size_t i = 0; i < count; ++i, xyz += 3) {
        const double x = xyz[0], y = xyz[1], z = xyz[2], body = 1 - (x * x + y * y + z * z) / 0.9;
        const double bump = 1 - ((x - 0.4) * (x - 0.4) + (y - 0.3) * (y - 0.3) + (z - 0.2) * (z - 0.2)) / 0.2;
        out[i] = (float)(fmax(body, 0) * (0.6 + 0.4 * sin(5 * x + 1) * sin(4 * y)) + fmax(bump, 0)) * *(float *)user;
    }
    return 0;
}

/* One gas, and what a bake needs of it. */
typedef struct stage {
    sps_context *context;
    sps_volume gas;
    sps_particles swarm;
    sps_particle ball;
    sps_scene scene;
    sps_view view;
    sps_light light;
    sps_tmap_settings table;
    ex_card_job job;
    float value;
} stage;

static int read_ball(void *user, size_t first, size_t count, sps_particle *out) {
    (void)first, (void)count;
    *out = *(const sps_particle *)user;
    return 0;
}

static void begin(stage *s, const double half[3]) {
    memset(s, 0, sizeof *s);
    s->context = check_context(NULL);
    s->scene.volumes = &s->gas, s->scene.volume_count = 1;
    for (int a = 0; a < 3; ++a) {
        s->gas.size[a] = 32;
        s->gas.placement.origin[a] = -half[a], s->gas.placement.axis[a][a] = 2 * half[a];
        s->gas.albedo[a] = 1;
    }
    s->gas.eval_fn = cloud, s->gas.user = &s->value, s->value = 1;
    s->gas.extinction = 4;
    s->view.width = s->view.height = TILE;
    s->view.scattering = SPS_SCATTERING_SINGLE;
    s->view.camera.up[1] = 1;
    const double lo[3] = {-half[0], -half[1], -half[2]};
    ex_card_fit(lo, half, 0, &s->view.camera);
    s->table.technique = SPS_TMAP_TABLE;
    s->light.shadow_map = &s->table;
    const ex_card_job job = {s->context, &s->scene, &s->view, &s->light};
    s->job = job;
}

static void begin_cloud(stage *s) {
    static const double half[3] = {1, 1, 1};
    begin(s, half);
}

static void end(stage *s) { sps_destroy(s->context); }

/* Bakes the stage into the only frame of a card. */
static void bake(const stage *s, ex_card *card) {
    ex_card_begin(card, TILE, 1, 1);
    CHECK_OK(s->context, ex_card_bake(&s->job, card, 0));
}

/* Renders the stage in a light of irradiance 1 that comes from a direction. */
static void render_lit(const stage *s, double x, double y, double z, float *rgba) {
    sps_scene scene = s->scene;
    sps_light light = s->light;
    sps_image image = {0};
    light.direction[0] = -x, light.direction[1] = -y, light.direction[2] = -z;
    light.color[0] = light.color[1] = light.color[2] = 1;
    scene.lights = &light, scene.light_count = 1;
    image.rgba = rgba;
    CHECK_OK(s->context, sps_render(s->context, &scene, &s->view, &image));
}

/* Where the light is: right, top, back, left, bottom, front. The eye is at +z. */
static const double from[6][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, -1}, {-1, 0, 0}, {0, -1, 0}, {0, 0, 1}};

/* ---------------------------------------------------------------------------------------------------- closed forms */

static int full(void *user, size_t count, const double *xyz, float *out) {
    (void)user, (void)xyz;
    for (size_t i = 0; i < count; ++i) out[i] = 1;
    return 0;
}

/* A slab of optical depth t across the view: lit from behind w/(4 pi) t e^-t, from the front w/(8 pi) (1 - e^-2t),
   alpha 1 - e^-t. Sheets and the planes of shadow tables are d = t / 64 apart. Light that reaches the middle of a sheet
   lights all of it: from the front, d^2 / 8 too little. Next to a face, depth between planes is wrong by up to d / 4.
   That holds for 2 d of the light from the front, and for 2 d / t of the light from behind. Floats and 16-bit planes:
   1e-4. */
static void test_slab(void) {
    static const double half[3] = {0.5, 0.5, 0.25}, depths[] = {0.1, 0.7, 2, 5};
    for (int i = 0; i < 4; ++i) {
        const double t = depths[i], albedo = 0.75, d = t / 64;
        stage s;
        ex_card card;
        begin(&s, half);
        s.gas.size[0] = s.gas.size[1] = 32, s.gas.size[2] = 16, s.view.slab_thickness = 0.25;
        s.table.components = 64;
        s.gas.eval_fn = full, s.gas.extinction = (float)(t / 0.5);
        for (int c = 0; c < 3; ++c) s.gas.albedo[c] = (float)albedo;
        bake(&s, &card);
        const size_t middle = TILE / 2 * TILE + TILE / 2;
        const double back = albedo / (4 * PI) * t * exp(-t), front = albedo / (8 * PI) * (1 - exp(-2 * t));
        if (figures())
            printf("slab of %g: back %.2e, front %.2e, alpha %.2e\n", t, (double)card.maps[EX_BACK][middle] / back - 1,
                   (double)card.maps[EX_FRONT][middle] / front - 1, (double)card.maps[EX_ALPHA][middle] + exp(-t) - 1);
        CHECK_NEAR((double)card.maps[EX_BACK][middle], back, (d * d / (2 * t) + 1e-4) * back);
        CHECK_NEAR((double)card.maps[EX_FRONT][middle], front, (d * d / 8 + d * d / 2 + 1e-4) * front);
        CHECK_NEAR((double)card.maps[EX_ALPHA][middle], 1 - exp(-t), 1e-5);
        ex_card_free(&card);
        end(&s);
    }
}

/* The largest difference of a map from another one that is mirrored or turned, relative to the other's largest value.
 */
static double difference(const float *map, const float *other, int turned) {
    double most = 0, largest = 0;
    for (int y = 0; y < TILE; ++y)
        for (int x = 0; x < TILE; ++x) {
            /* mirrored: x to -x; turned by 90 degrees: what is at the right comes to the top */
            const int place = turned ? x * TILE + TILE - 1 - y : y * TILE + TILE - 1 - x;
            most = fmax(most, fabs((double)map[y * TILE + x] - (double)other[place]));
            largest = fmax(largest, fabs((double)other[place]));
        }
    return most / largest;
}

/* Only rounding differs, most of all that of the 16-bit planes of shadow tables: 2^-16 of the depth of 3. */
static void test_ball(void) {
    const double most = 3 / 65536.0;
    stage s;
    ex_card card;
    begin_cloud(&s);
    s.ball.radius = 0.9f, s.ball.optical_depth = 3;
    s.swarm.count = 1, s.swarm.read_fn = read_ball, s.swarm.user = &s.ball;
    for (int c = 0; c < 3; ++c) s.swarm.albedo[c] = 1;
    s.scene.volume_count = 0, s.scene.particles = &s.swarm, s.scene.particle_set_count = 1;
    bake(&s, &card);
    const double mirrored = difference(card.maps[EX_LEFT], card.maps[EX_RIGHT], 0);
    const double turned = difference(card.maps[EX_TOP], card.maps[EX_RIGHT], 1);
    const double bottom = difference(card.maps[EX_BOTTOM], card.maps[EX_LEFT], 1);
    const double itself = difference(card.maps[EX_RIGHT], card.maps[EX_RIGHT], 0);
    if (figures())
        printf("ball: left %.2e, top %.2e, bottom %.2e; not mirrored %.2f\n", mirrored, turned, bottom, itself);
    CHECK(mirrored < most && turned < most && bottom < most && itself > 0.3);
    CHECK(difference(card.maps[EX_FRONT], card.maps[EX_FRONT], 1) < most);
    ex_card_free(&card);
    end(&s);
}

/* ------------------------------------------------------------------------------------------ renders of single lights
 */

static int same_bits(const float *map, const float *rgba, int channel) {
    for (int i = 0; i < PIXELS; ++i)
        if (memcmp(&map[i], &rgba[4 * i + channel], sizeof *map) != 0) return 0;
    return 1;
}

/* Two renders give the bits of six in white light, however light scatters. */
static void test_single_renders(void) {
    static const sps_scattering scattering[] = {SPS_SCATTERING_SINGLE, SPS_SCATTERING_MULTIPLE, SPS_SCATTERING_AUTO};
    static float rgba[4 * PIXELS];
    for (int k = 0; k < 3; ++k) {
        stage s;
        ex_card card;
        begin_cloud(&s);
        s.view.scattering = scattering[k], s.view.scattering_resolution = k > 0 ? 12 : 0;
        bake(&s, &card);
        CHECK(ex_scene_is_grey(&s.scene));
        for (int side = 0; side < 6; ++side) {
            render_lit(&s, from[side][0], from[side][1], from[side][2], rgba);
            if (!CHECK(same_bits(card.maps[side], rgba, 0) && same_bits(card.maps[EX_ALPHA], rgba, 3)))
                printf("    side %d, scattering %d\n", side, (int)scattering[k]);
        }
        ex_card_free(&card);
        end(&s);
    }
}

/* Maps of colored gas are the luminance of a render in white light. */
static void test_colored(void) {
    static float rgba[4 * PIXELS];
    stage s;
    ex_card card;
    begin_cloud(&s);
    ex_color(s.gas.albedo, 0.9, 0.5, 0.2);
    s.view.scattering = SPS_SCATTERING_MULTIPLE, s.view.scattering_resolution = 12;
    CHECK(!ex_scene_is_grey(&s.scene));
    bake(&s, &card);
    for (int side = 0; side < 6; ++side) {
        double worst = 0;
        render_lit(&s, from[side][0], from[side][1], from[side][2], rgba);
        for (int i = 0; i < PIXELS; ++i) {
            const double luminance =
                0.2126 * (double)rgba[4 * i] + 0.7152 * (double)rgba[4 * i + 1] + 0.0722 * (double)rgba[4 * i + 2];
            worst = fmax(worst, fabs((double)card.maps[side][i] - luminance));
        }
        CHECK(worst < 1e-8 && card.maps[side][PIXELS / 2 + TILE / 2] > 0.01f);
    }
    ex_card_free(&card);
    end(&s);
}

/* Each way in which a scene can have a color. */
static void test_grey(void) {
    static const sps_transfer_point points[2] = {{0, {0.5f, 0.5f, 0.5f}, 0, {0, 0, 0}},
                                                 {1, {0.5f, 0.5f, 0.4f}, 1, {0}}};
    sps_transfer transfer = {0}, grey = {0};
    sps_volume volume = {0};
    sps_particles particles = {0};
    sps_mesh mesh = {0};
    sps_scene scene = {0};
    transfer.points = grey.points = points, transfer.point_count = 2, grey.point_count = 1;
    scene.volumes = &volume, scene.volume_count = 1, scene.meshes = &mesh, scene.mesh_count = 1;
    scene.particles = &particles, scene.particle_set_count = 1;
    CHECK(ex_scene_is_grey(&scene));
    volume.albedo[2] = 0.5f;
    CHECK(!ex_scene_is_grey(&scene));
    volume.transfer = &grey;
    CHECK(ex_scene_is_grey(&scene)); /* it replaces the albedo */
    volume.transfer = &transfer;
    CHECK(!ex_scene_is_grey(&scene));
    memset(&volume, 0, sizeof volume);
    particles.albedo[1] = 0.5f;
    CHECK(!ex_scene_is_grey(&scene));
    particles.albedo[1] = 0, particles.has_albedos = 1;
    CHECK(!ex_scene_is_grey(&scene));
    particles.has_albedos = 0, mesh.albedo[0] = 1;
    CHECK(!ex_scene_is_grey(&scene));
    mesh.albedo[0] = 0, mesh.transmittance[0] = 1;
    CHECK(!ex_scene_is_grey(&scene));
}

/* A frame lies in its tile, row by row from the top left, and nothing else changes. */
static void test_tiles(void) {
    stage s;
    ex_card one, many;
    int wrong = 0;
    begin_cloud(&s);
    bake(&s, &one);
    ex_card_begin(&many, TILE, 3, 2);
    CHECK_OK(s.context, ex_card_bake(&s.job, &many, 4)); /* the second row, in the middle */
    for (int map = 0; map < EX_SIDES; ++map)
        for (int i = 0; i < 6 * PIXELS; ++i) {
            const int x = i % (3 * TILE) - TILE, y = i / (3 * TILE) - TILE;
            const int inside = x >= 0 && x < TILE && y >= 0;
            wrong += many.maps[map][i] != (inside ? one.maps[map][y * TILE + x] : 0);
        }
    CHECK(wrong == 0);
    ex_card_free(&one), ex_card_free(&many);
    end(&s);
}

/* A failed render is the job's result. */
static void test_failure(void) {
    stage s;
    ex_card card;
    begin_cloud(&s);
    ex_card_begin(&card, TILE, 1, 1);
    s.value = NAN;
    CHECK(ex_card_bake(&s.job, &card, 0) == SPS_ERROR_DATA && ex_card_bake_glow(&s.job, &card, 0) == SPS_ERROR_DATA);
    ex_card_free(&card);
    end(&s);
}

/* What glows is a map of its own, the luminance of its radiance. */
static void test_glow(void) {
    stage s;
    ex_card card;
    static const double half[3] = {1, 1, 0.25};
    begin(&s, half);
    s.gas.eval_fn = full, s.gas.extinction = 2;
    ex_color(s.gas.albedo, 0, 0, 0);
    ex_color(s.gas.emission, 4, 2, 1);
    ex_card_begin(&card, TILE, 1, 1);
    CHECK_OK(s.context, ex_card_bake_glow(&s.job, &card, 0));
    const size_t middle = TILE / 2 * TILE + TILE / 2;
    const double luminance = 0.2126 * 4 + 0.7152 * 2 + 0.0722;
    CHECK_NEAR((double)card.maps[EX_GLOW][middle], luminance / 2 * (1 - exp(-1)), 1e-3);
    ex_card_free(&card);
    end(&s);
}

/* ---------------------------------------------------------------------------------------------------- the textures */

/* Letters of what the channels of each layout hold, as the engines' documents have them: Right, Top, bacK, Left,
   Bottom, Front, Alpha, Emission; 0 and 1. */
static const char *const expected[5][3] = {{"RTKA", "LBFE", NULL},
                                           {"TLRB", "FK01", "AAAA"},
                                           {"RLT1", "BKF1", "AAAA"},
                                           {"LRT1", "FKB1", "AAAA"},
                                           {"RTKB", "LBF1", "AE11"}};

/* Maps of one pixel, each with a number of its own. */
static double number_of(char letter, double scale, int is_straight) {
    static const char letters[] = "RTKLBFAE";
    const char *at = strchr(letters, letter);
    if (letter == '0' || letter == '1') return letter - '0';
    if (letter == 'A') return 0.5;
    return scale * (double)(at - letters + 1) / 16 / (is_straight ? 0.5 : 1);
}

static void test_layouts(void) {
    ex_card card;
    ex_card_begin(&card, 1, 1, 1);
    for (int i = 0; i < EX_SIDES; ++i) card.maps[i][0] = (float)(i + 1) / 16;
    card.maps[EX_ALPHA][0] = 0.5f;
    for (int i = 0; i < 5 * 2; ++i) {
        ex_card_texture texture = {ex_card_layout_of(i / 2), 0, 3, i % 2};
        CHECK(texture.layout.count == (i / 2 == 0 ? 2 : 3) && texture.layout.has_srgb == (i / 2 == 4));
        for (; texture.number < texture.layout.count; ++texture.number) {
            float *texels = ex_card_texels(&card, &texture);
            for (int c = 0; c < 4; ++c)
                CHECK((double)texels[c] == number_of(expected[i / 2][texture.number][c], 3, i % 2));
            free(texels);
        }
    }
    ex_card_free(&card);
}

/* Straight numbers of pixels without alpha are the mean of the neighbours with alpha, of the same frame. */
static void test_rim(void) {
    ex_card card;
    const ex_card_texture straight = {ex_card_layout_of(0), 1, 2, 1};
    ex_card_begin(&card, 3, 2, 2);
    for (int i = 0; i < 36; ++i) card.maps[EX_LEFT][i] = 9; /* which counts nowhere without alpha */
    card.maps[EX_ALPHA][0] = 0.5f, card.maps[EX_LEFT][0] = 0.25f, card.maps[EX_GLOW][0] = 1;
    card.maps[EX_ALPHA][2] = 0.25f, card.maps[EX_LEFT][2] = 0.5f;
    card.maps[EX_ALPHA][15] = 0.5f, card.maps[EX_LEFT][15] = 0.5f; /* the corner of the next frame */
    float *b = ex_card_texels(&card, &straight);
    const float left[18] = {1, 2.5f, 4, 0, 0, 0, 1, 2.5f, 4, 2, 2, 0, 0, 0, 0, 2, 2, 0}; /* three rows of two frames */
    for (int i = 0; i < 36; ++i) CHECK(b[4 * i] == (i < 18 ? left[i] : 0));
    CHECK(b[3] == 4 && b[4 + 3] == 2 && b[4 * 2 + 3] == 0 && b[4 * 6 + 3] == 4 && b[4 * 3 + 3] == 0);
    free(b);
    ex_card_free(&card);
}

/* Codes of 8 bits are rounded, and clamped. Engines that decode sRGB decode three channels, never alpha. */
static void test_codes(void) {
    static const float numbers[8] = {0.25f, 2, -1, 0.25f, 0.002f, NAN, 1, 0.75f};
    static const unsigned char linear[8] = {64, 255, 0, 64, 1, 0, 255, 191},
                               srgb[8] = {137, 255, 0, 64, 7, 0, 255, 191};
    unsigned char *codes[2] = {ex_card_codes(numbers, 2, 0), ex_card_codes(numbers, 2, 1)};
    CHECK(memcmp(codes[0], linear, 8) == 0 && memcmp(codes[1], srgb, 8) == 0);
    free(codes[0]), free(codes[1]);
}

/* The camera that a card is seen by: its place, what it sees, and which way is up, wherever it was put. */
static void test_fit(void) {
    const double lo[3] = {-1, 2, 5}, hi[3] = {3, 4, 6};
    sps_camera free_camera = {0}, above = {0}, narrow = {0}, point = {0};
    free_camera.up[1] = 2;
    ex_card_fit(lo, hi, 0, &free_camera);
    CHECK(free_camera.target[0] == 1 && free_camera.target[1] == 3 && free_camera.target[2] == 5.5);
    CHECK(free_camera.position[0] == 1 && free_camera.position[1] == 3 && free_camera.position[2] == 12.5);
    CHECK(free_camera.ortho_height == 4 && free_camera.up[0] == 0 && free_camera.up[1] == 1 && free_camera.up[2] == 0);
    above.position[1] = 9, above.up[1] = 1; /* up along the view: any axis across it */
    ex_card_fit(lo, hi, 1, &above);
    CHECK(above.position[1] == 9 && above.ortho_height == 12 && above.up[1] == 0); /* 6 from the target to z = 6 */
    CHECK_NEAR(above.up[0] * above.up[0] + above.up[2] * above.up[2], 1, 1e-15);
    narrow.up[1] = 1, narrow.ortho_height = 0.5;
    ex_card_fit(lo, hi, 0, &narrow);
    CHECK(narrow.ortho_height == 0.5 && narrow.target[0] == 1);
    point.up[1] = 1;
    ex_card_fit(lo, lo, 0, &point);
    CHECK(point.ortho_height == 1 && point.position[2] == 6 && point.target[2] == 5);
}

/* Premultiplied is straight times alpha, to the rounding of two divisions and a product. */
static void test_alpha(void) {
    stage s;
    ex_card card;
    int empty = 0;
    double worst = 0;
    begin_cloud(&s);
    bake(&s, &card);
    const ex_card_texture straight = {ex_card_layout_of(0), 0, 2.5f, 1}, seen = {ex_card_layout_of(0), 0, 2.5f, 0};
    float *a = ex_card_texels(&card, &straight), *b = ex_card_texels(&card, &seen);
    for (int i = 0; i < 4 * PIXELS; ++i) {
        const double alpha = (double)a[i - i % 4 + 3];
        empty += alpha == 0 && b[i] == 0;
        if (i % 4 == 3) CHECK(a[i] == b[i]);
        if (i % 4 != 3) worst = fmax(worst, fabs((double)a[i] * alpha - (double)b[i]) - 1.8e-7 * (double)b[i]);
    }
    CHECK(worst <= 0 && empty > 40);
    free(a), free(b);
    ex_card_free(&card);
    end(&s);
}

/* ------------------------------------------------------------------------------------------------ names of frames */

static void test_names(void) {
    static const struct {
        const char *name, *made; /* NULL: refused */
        int number, has_number;
    } cases[] = {{"a.vdb", "a.vdb", 7, 0},
                 {"a%d.vdb", "a7.vdb", 7, 1},
                 {"a%04d.vdb", "a0007.vdb", 7, 1},
                 {"%01d", "12", 12, 1},
                 {"d/%02d/x", "d/123/x", 123, 1},
                 {"%09d", "999999999", 999999999, 1},
                 {"%09dd", "000000000d", 0, 1},
                 {"%d4d", "54d", 5, 1},
                 {"%s", NULL, 1, 0},
                 {"%4d", NULL, 1, 0},
                 {"%00d", NULL, 1, 0},
                 {"%010d", NULL, 1, 0},
                 {"a%", NULL, 1, 0},
                 {"%0", NULL, 1, 0},
                 {"%05", NULL, 1, 0},
                 {"%d%d", NULL, 1, 0},
                 {"%%d", NULL, 1, 0},
                 {"%d%%", NULL, 1, 0},
                 {"%n%d", NULL, 1, 0},
                 {"%-d", NULL, 1, 0},
                 {"%ld", NULL, 1, 0},
                 {"%0d", NULL, 1, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        int has_number = -1;
        char *made = ex_frame_name(cases[i].name, cases[i].number, &has_number);
        const int right = cases[i].made ? made && strcmp(made, cases[i].made) == 0 && has_number == cases[i].has_number
                                        : made == NULL;
        if (!CHECK(right)) printf("    %s gives %s\n", cases[i].name, made ? made : "nothing");
        free(made);
    }
}

/* -------------------------------------------------------------------------------------------------------- the shader
 */

static six_way_vec4 texel_of(const float *texels, int pixel) {
    const six_way_vec4 texel = {texels[4 * pixel], texels[4 * pixel + 1], texels[4 * pixel + 2], texels[4 * pixel + 3]};
    return texel;
}

/* The error of the shader in 26 directions, rms over pixels and directions, relative to the mean of radiance. On the
   six sides it is none, to the rounding of floats. */
static double shader_error(const stage *s) {
    static float rgba[4 * PIXELS];
    ex_card card;
    double squares = 0, sum = 0, sides = 0;
    bake(s, &card);
    const ex_card_texture textures[2] = {{ex_card_layout_of(0), 0, 2, 0}, {ex_card_layout_of(0), 1, 2, 0}};
    float *a = ex_card_texels(&card, &textures[0]), *b = ex_card_texels(&card, &textures[1]);
    for (int k = 0; k < 27; ++k) {
        const double x = k % 3 - 1, y = k / 3 % 3 - 1, z = k / 9 - 1, length = sqrt(x * x + y * y + z * z);
        if (length == 0) continue;
        const six_way_vec3 towards = {(float)(x / length), (float)(y / length), (float)(z / length)};
        render_lit(s, x, y, z, rgba);
        for (int i = 0; i < PIXELS; ++i) {
            const double lit = (double)rgba[4 * i];
            const double error = (double)six_way_radiance(texel_of(a, i), texel_of(b, i), towards) / 2 - lit;
            squares += error * error, sum += lit;
            if (length == 1) sides = fmax(sides, fabs(error));
        }
    }
    CHECK(sides < 1e-7);
    free(a), free(b);
    ex_card_free(&card);
    return sqrt(squares / (26.0 * PIXELS)) / (sum / (26.0 * PIXELS));
}

/* What six_way.glsl says. Rays have up to 1.38 times the extinction as optical depth. */
static void test_shader(void) {
    static const sps_lobe forward = {0.6f, 1};
    static const struct {
        double extinction, most;
        sps_scattering scattering;
        int is_forward;
    } cases[] = {{0.5, 0.065, SPS_SCATTERING_SINGLE, 0},
                 {4, 0.225, SPS_SCATTERING_SINGLE, 0},
                 {4, 0.18, SPS_SCATTERING_MULTIPLE, 0},
                 {4, 2.05, SPS_SCATTERING_SINGLE, 1}};
    for (int k = 0; k < 4; ++k) {
        stage s;
        begin_cloud(&s);
        s.gas.extinction = (float)cases[k].extinction;
        s.view.scattering = cases[k].scattering;
        s.view.scattering_resolution = cases[k].scattering == SPS_SCATTERING_MULTIPLE ? 12 : 0;
        if (cases[k].is_forward) s.gas.lobes = &forward, s.gas.lobe_count = 1;
        const double error = shader_error(&s);
        if (figures()) printf("shader: extinction %g, case %d: %.3f\n", cases[k].extinction, k, error);
        CHECK(error < cases[k].most && error > 0.8 * cases[k].most);
        end(&s);
    }
}

/* ---------------------------------------------------------------------------------------------------- the command line
 */

#define GAS "--volume two.raw --size 2,2,2 --extinction 3 --tile 5 "
#define OUT "--out-a a.dds --out-b b.dds "

/* Reads a DDS file of RGBA floats. Returns the number of floats. */
static int read_floats(const char *name, float *out, int most) {
    static char data[200000];
    const int size = read_file(name, data, sizeof data), count = (size - 148) / 4;
    if (size < 148 || count > most || memcmp(data + 128, "\2\0\0\0\3", 5) != 0) return 0;
    memcpy(out, data + 148, (size_t)count * sizeof *out);
    return count;
}

static void test_wrong_options(void) {
    static const complaint wrong[] = {
        {"", 2, "'' is no command; --help lists them"},
        {"--out-a a.dds", 2, "'--out-a' is no command"},
        {"six-ways", 2, "'six-ways' is no command"},
        {"six-way", 2, "--layout unity has 2 textures: give --out-a"},
        {"six-way " GAS "--out-a a.dds", 2, "--layout unity has 2 textures: give --out-b"},
        {"six-way " GAS "--layout godot " OUT, 2, "--layout godot has 3 textures: give --out-c"},
        {"six-way " GAS "--layout o3de-rlt " OUT, 2, "--layout o3de-rlt has 3 textures: give --out-c"},
        {"six-way " GAS "--layout o3de-lrt " OUT, 2, "--layout o3de-lrt has 3 textures: give --out-c"},
        {"six-way " GAS OUT "--out-c c.dds", 2, "--out-c says nothing about --layout unity, which has 2 textures"},
        {"six-way " OUT, 2, "nothing to bake: give --volume or --particles"},
        {"six-way " GAS "--out-a a.tif --out-b b.dds", 2, "--out-a a.tif: the name must end in .png, .exr or .dds"},
        {"six-way " GAS "--out-a a.png --out-b a.png", 2, "--out-a and --out-b are the same file: a.png"},
        {"six-way " GAS "--out-a a.png --out-b b.dds --texels half", 2, "--out-a a.png holds no --texels half"},
        {"six-way " GAS "--out-a a.dds --out-b b.exr --texels unorm8", 2, "--out-b b.exr holds no --texels unorm8"},
        {"six-way " GAS OUT "--texels u8", 2, "--texels: 'u8' is not unorm8|half|float"},
        {"six-way " GAS OUT "--exr-compression zip", 2, "--exr-compression says nothing without an .exr file"},
        {"six-way " GAS OUT "--layout unreal", 2, "--layout: 'unreal' is not unity|o3de-tlrb|o3de-rlt|o3de-lrt|godot"},
        {"six-way " GAS OUT "--alpha none", 2, "--alpha: 'none' is not straight|premultiplied"},
        {"six-way " GAS OUT "--scale 0", 2, "--scale: '0' is out of range"},
        {"six-way " GAS OUT "--tile 0", 2, "--tile: '0' is out of range"},
        {"six-way " GAS OUT "--tile 8000 --tiles 3,1", 2, "3 x 1 frames of 8000 pixels: sides must be within 16384"},
        {"six-way " GAS OUT "--tile 8000 --tiles 1,3", 2, "1 x 3 frames of 8000 pixels: sides must be within 16384"},
        {"six-way " GAS OUT "--tiles 2", 2, "--tiles: '2' is not C,R"},
        {"six-way " GAS OUT "--frames 3,2", 2, "--frames 3,2: the last one comes before the first"},
        {"six-way " GAS OUT "--frames 0,16384", 2, "--frames 0,16384: more than 16384"},
        {"six-way " GAS OUT "--frames 0,999999999", 2, "more than 16384"},
        {"six-way " GAS OUT "--frames 1,2", 2, "--frames says nothing: no name of a file has %d"},
        {"six-way --volume f%d%d.raw --size 2,2,2 " OUT "--frames 1,2", 2,
         "--volume f%d%d.raw: with --frames, % begins"},
        {"six-way --volume f%s.raw --size 2,2,2 " OUT "--frames 1,2", 2, "--volume f%s.raw: with --frames, % begins"},
        {"six-way --volume f%d.raw --size 2,2,2 " OUT, 2, "f%d.raw: No such file"},
        {"six-way --volume f%d.raw --size 2,2,2 " OUT "--frames 1,4", 2, "f4.raw: No such file"},
        {"six-way --volume f%d.raw --size 2,2,2 --tiles 1,2 " OUT "--frames 1,3", 2,
         "--tiles 1,2 has room for 2 frames; there are 3"},
        {"six-way --volume v.dds --size 2,2,2 --out-a v.dds --out-b b.dds", 2,
         "--out-a v.dds is a file that --volume reads"},
        {"six-way --volume v%d.dds --size 2,2,2 --frames 1,2 --out-a a.dds --out-b v2.dds", 2,
         "--out-b v2.dds is a file that --volume reads"},
        {"six-way " GAS "--out-a missing/a.dds --out-b b.dds", 2, "missing/a.dds"},
        {"six-way --particles none.bin " OUT, 2, "nothing to bake: there is no gas in any frame"},
        {"six-way --particles absent.bin " OUT, 2, "absent.bin: No such file"},
        {"six-way " GAS OUT "--outt x", 2, "unknown option '--outt'"},
        {"six-way " GAS OUT "--shadow samples", 2, "--shadow samples says nothing about bake six-way"},
        {"six-way " GAS OUT "--shadow sheets --map-components 3", 2,
         "--map-components says nothing about --shadow sheets"},
        {"six-way " GAS OUT "--quality draft --no-shadows", 0, NULL},
        {"six-way " GAS OUT "--layout cube", 2, "--layout cube is for maps, not for bake six-way"},
        {"six-way " GAS OUT "--texels unorm16", 2, "--texels unorm16 is for maps, not for bake six-way"},
        {"six-way " GAS OUT "--look look.txt", 2, "look.txt:1: 'six' is not an option for a look"}};
    CHECK_COMPLAINTS(wrong);
}

/* Options of render that say nothing here, with a value. */
static void test_refused_options(void) {
    static const char *const given[] = {"--light directional,0,0,1,1,1,1",
                                        "--ambient 1,1,1",
                                        "--gas-ambient 1,1,1",
                                        "--sky x.hdr",
                                        "--sky-turn 1",
                                        "--background 1,1,1",
                                        "--fov 30",
                                        "--width 4",
                                        "--height 4",
                                        "--region 0,0,1,1",
                                        "--reference",
                                        "--samples 4",
                                        "--budget-seconds 1",
                                        "--budget-error 1",
                                        "--out x.png",
                                        "--pfm x.pfm",
                                        "--alpha-pfm x.pfm",
                                        "--exr x.exr",
                                        "--radiance-hdr x.hdr",
                                        "--exr-type half",
                                        "--stats x.json",
                                        "--part 1/2",
                                        "--plan",
                                        "--list-grids",
                                        "--convention unreal",
                                        "--metres-per-unit 1",
                                        "--border 1",
                                        "--depths 1,2",
                                        "--surfaces x.dds",
                                        "--constants x.json"};
    for (size_t i = 0; i < sizeof given / sizeof *given; ++i) {
        char options[300], words[100];
        snprintf(options, sizeof options, "six-way " GAS OUT "%s", given[i]);
        snprintf(words, sizeof words, "%.*s says nothing about bake six-way: ", (int)strcspn(given[i], " "), given[i]);
        const complaint one = {options, 2, words};
        check_complaints(&one, 1);
    }
    const complaint ambient = {"six-way --particles p1.bin --particle-ambient 1,1,1 " OUT, 2,
                               "--particle-ambient says nothing"};
    check_complaints(&ambient, 1);
}

/* A tile has the bits that render writes of each light. */
static void test_same_as_render(void) {
    static const char *const lights[] = {"-1,0,0", "0,-1,0", "0,0,1", "1,0,0", "0,1,0", "0,0,-1"};
    static const complaint made = {"six-way " GAS OUT "--texels float --alpha premultiplied", 0, NULL};
    float maps[2][100];
    check_complaints(&made, 1);
    if (!CHECK(read_floats("a.dds", maps[0], 100) == 100 && read_floats("b.dds", maps[1], 100) == 100)) return;
    tested = "render";
    for (int side = 0; side < 6; ++side) {
        char options[400], pfm[400];
        int wrong = 0;
        snprintf(options, sizeof options,
                 "--volume two.raw --size 2,2,2 --extinction 3 --width 5 --height 5 --camera 0.5,0.5,3.5,0.5,0.5,0.5 "
                 "--ortho 1 --shadow table --light directional,%s,1,1,1 --pfm x.pfm --alpha-pfm x.alpha",
                 lights[side]);
        const complaint lit = {options, 0, NULL};
        check_complaints(&lit, 1);
        CHECK(read_file("x.pfm", pfm, sizeof pfm) == 12 + 300);
        for (int i = 0; i < 25; ++i) {
            const int place = (4 - i / 5) * 5 + i % 5; /* PFM has the bottom row first */
            wrong += memcmp(pfm + 12 + 12 * place, &maps[side / 3][4 * i + side % 3], 4) != 0;
        }
        CHECK(wrong == 0 && maps[side / 3][4 * 12 + side % 3] > 0);
        CHECK(read_file("x.alpha", pfm, sizeof pfm) == 12 + 100 &&
              memcmp(pfm + 12 + 4 * 12, &maps[0][4 * 12 + 3], 4) == 0);
    }
    tested = "bake";
}

/* Frames go row by row from the top left; each has the bits of a bake of its own; what is left over is empty. */
static void test_frames(void) {
    static const complaint made[] = {
        {"six-way --volume f%d.raw --size 2,2,2 --frames 1,3 --tile 4 --texels float " OUT, 0, NULL}};
    static float all[4 * 64], one[4 * 16];
    CHECK_COMPLAINTS(made);
    CHECK(read_floats("a.dds", all, 4 * 64) == 4 * 64);
    for (int frame = 0; frame < 4; ++frame) {
        char options[200];
        int wrong = 0, empty = 0;
        snprintf(options, sizeof options, "six-way --volume f%d.raw --size 2,2,2 --tile 4 --texels float " OUT,
                 frame + 1);
        memset(one, 0, sizeof one);
        if (frame < 3) CHECK(run_render(options).status == 0 && read_floats("a.dds", one, 64) == 64);
        for (int i = 0; i < 64; ++i) {
            const int pixel = i / 4, x = pixel % 4 + frame % 2 * 4, y = pixel / 4 + frame / 2 * 4;
            wrong += all[4 * (8 * y + x) + i % 4] != one[i];
            empty += one[i] == 0;
        }
        CHECK(wrong == 0 && (frame == 3) == (empty == 64));
    }
}

/* The camera sees the gas of all frames: a ball at x = 0, then at x = 4, both of radius 1. */
static void test_same_camera(void) {
    static const complaint made[] = {
        {"six-way --particles p%d.bin --frames 1,2 --tiles 2,1 --tile 12 --texels float " OUT, 0, NULL},
        {"six-way --particles p1.bin --frames 1,1 --tile 12 --texels float " OUT, 2, "--frames says nothing"}};
    static float texels[4 * 12 * 24];
    int wrong = 0;
    CHECK_COMPLAINTS(made);
    CHECK(read_floats("a.dds", texels, 4 * 12 * 24) == 4 * 12 * 24);
    for (int i = 0; i < 12 * 24; ++i) {
        const int x = i % 24, y = i / 24, left = x < 12 ? 0 : 12 + 8;
        const double dx = x + 0.5 - left - 2, dy = y - 5.5;
        wrong += (texels[4 * i + 3] > 0) != (dx * dx + dy * dy < 4);
    }
    CHECK(wrong == 0);
}

/* The camera may be given: from above, right stays right, and top is where `--up` points. */
static void test_camera(void) {
    static const complaint made[] = {
        {"six-way --particles p2.bin --camera 4,9,0,4,0,0 --up 0,0,-1 --tile 6 --texels float " OUT, 0, NULL},
        {"six-way --particles p2.bin --camera 4,9,0,4,0,0 --ortho 4 --tile 6 --texels float --out-a c.dds --out-b "
         "b.dds",
         0, NULL}};
    static float a[144], b[144];
    CHECK_COMPLAINTS(made);
    CHECK(read_floats("a.dds", a, 144) == 144);
    CHECK(a[4 * (6 * 2 + 5)] > a[4 * (6 * 2)] && a[4 * 2 + 1] > a[4 * (30 + 2) + 1]); /* lit at the right, at the top */
    CHECK(read_floats("c.dds", b, 144) == 144);
    CHECK(b[4 * 12 + 3] == 0 && b[4 * 14 + 3] > 0 && a[4 * 12 + 3] > 0); /* twice as wide as the ball */
}

/* Bytes are the same for any number of threads, and as PNG and DDS of 8 bits. */
static void test_files(void) {
    static const complaint made[] = {
        {"six-way " GAS "--scale 4 --threads 1 " OUT, 0, NULL},
        {"six-way " GAS "--scale 4 --threads 3 --out-a c.dds --out-b d.dds", 0, NULL},
        {"six-way " GAS "--scale 4 --layout godot --texels unorm8 --out-a a8.dds --out-b b8.dds --out-c c8.dds", 0,
         NULL},
        {"six-way " GAS "--scale 4 --layout godot --out-a a.png --out-b b.exr --out-c c.png", 0, NULL},
        {"six-way " GAS "--layout o3de-tlrb --out-a a.exr --out-b b.exr --out-c c.dds --exr-compression none", 0,
         NULL}};
    static char one[2000], other[2000];
    const char *magick = find_magick();
    CHECK_COMPLAINTS(made);
    const int size = read_file("a.dds", one, sizeof one);
    CHECK(size == 148 + 8 * 25 && read_file("c.dds", other, sizeof other) == size && one[128] == 10);
    CHECK(read_file("c.dds", other, sizeof other) == 148 + 8 * 25 && other[144] == 1);
    CHECK(read_file("a8.dds", one, sizeof one) == 148 + 100 && one[128] == 29 && one[144] == 4);
    CHECK(read_file("a.exr", other, sizeof other) > 25 * 8 && memcmp(other, "\x76\x2f\x31\x01", 4) == 0);
    if (!magick) {
        printf("skipped: PNG by ImageMagick: install imagemagick\n");
        return;
    }
    for (int i = 0; i < 2; ++i) {
        char command[300];
        snprintf(command, sizeof command, "cd %s && %s %c.png -depth 8 rgba:x.bytes", folder, magick, i ? 'c' : 'a');
        CHECK(system(command) == 0 && read_file("x.bytes", other, sizeof other) == 100);
        CHECK(read_file(i ? "c8.dds" : "a8.dds", one, sizeof one) == 248 && memcmp(one + 148, other, 100) == 0);
    }
}

/* What a texture cannot hold is said, and does not fail. */
static void test_remarks(void) {
    static const struct {
        const char *options, *words;
    } said[] = {
        {"six-way " GAS "--scale 1000 --out-a a.png --out-b b.dds", "bake: a.png: "},
        {"six-way " GAS "--scale 1000 --out-a a.png --out-b b.dds", " are above 1, up to "},
        {"six-way " GAS "--extinction 0 --emission 1,1,1 " OUT, "bake: 25 pixels glow without alpha, and are lost"}};
    static const complaint quiet[] = {
        {"six-way " GAS "--extinction 0 --emission 1,1,1 --alpha premultiplied " OUT, 0, NULL},
        {"six-way " GAS "--scale 1000 " OUT, 0, NULL}};
    for (size_t i = 0; i < sizeof said / sizeof *said; ++i) {
        const outcome got = run_render(said[i].options);
        CHECK(got.status == 0 && strstr(got.said, said[i].words) && !strstr(got.said, "b.dds"));
    }
    CHECK_COMPLAINTS(quiet);
}

/* Gas that glows has the six maps of gas that does not, given the same cells, and its glow in its own channel. */
static void test_glowing(void) {
    static const char *const glows[] = {"--emission 2,2,2", "--emission-volume colors.mhd"};
    static float plain[100], a[100], b[100];
    CHECK(run_render("six-way " GAS "--scattering-resolution 24 --texels float " OUT).status == 0 &&
          read_floats("a.dds", plain, 100) == 100);
    CHECK(read_floats("b.dds", b, 100) == 100 && b[4 * 12 + 3] == 0);
    for (int i = 0; i < 2; ++i) {
        char options[300];
        snprintf(options, sizeof options, "six-way " GAS "--scattering-resolution 24 --texels float %s " OUT, glows[i]);
        CHECK(run_render(options).status == 0 && read_floats("a.dds", a, 100) == 100 &&
              read_floats("b.dds", b, 100) == 100);
        int wrong = 0;
        for (int k = 0; k < 100; ++k) wrong += fabs((double)a[k] - (double)plain[k]) > (i ? 1e-6 : 0);
        CHECK(wrong == 0 && b[4 * 12 + 3] > 0.05f);
    }
    for (int i = 0; i < 2; ++i) {
        char options[300];
        snprintf(options, sizeof options,
                 "six-way --volume two.raw --size 2,2,2 --tile 5 --transfer-point 0,1,1,1,0 --transfer-point "
                 "1,1,1,1,3%s --texels float " OUT,
                 i ? ",2,2,2" : "");
        CHECK(run_render(options).status == 0 && read_floats("a.dds", i ? a : plain, 100) == 100);
    }
    CHECK(read_floats("b.dds", b, 100) == 100 && b[4 * 12 + 3] > 0.05f && memcmp(a, plain, sizeof a) == 0);
}

static void test_full_disk(void) {
    static const complaint full[] = {
        {"six-way " GAS "--out-a full.dds --out-b b.dds", 2, "full.dds: writing failed: No space"},
        {"six-way " GAS "--out-a full.png --out-b b.dds", 2, "full.png: writing failed: No space"},
        {"six-way " GAS "--out-a a.dds --out-b full.exr", 2, "full.exr: writing failed: No space"},
        {"six-way --help >/dev/full", 2, "standard output: "},
        {"--help >/dev/full", 2, "standard output: "}};
    char command[200];
    if (access("/dev/full", W_OK) != 0) return;
    snprintf(command, sizeof command, "cd %s && for e in dds png exr; do ln -s /dev/full full.$e; done", folder);
    CHECK(system(command) == 0);
    CHECK_COMPLAINTS(full);
}

/* Help lists what there is and no more; options of bake are none of render. */
static void test_help(void) {
    static char text[40000];
    static const complaint helps[] = {{"six-way --help >help.txt", 0, NULL}, {"--help >commands.txt", 0, NULL}};
    static const complaint none[] = {{"--layout unity --plan", 2, "unknown option '--layout'"},
                                     {"--out-a a.png", 2, "unknown option '--out-a'"},
                                     {"--look bake.txt --plan", 2, "bake.txt:1: 'tile' is not an option for a look"}};
    static const complaint look = {"six-way " GAS "--look bake.txt " OUT, 0, NULL};
    CHECK_COMPLAINTS(helps);
    CHECK(read_file("help.txt", text, sizeof text) > 3000 && strstr(text, "usage: bake six-way [options]\n"));
    CHECK(strstr(text, "--layout unity|o3de-tlrb|o3de-rlt|o3de-lrt|godot") && strstr(text, "--volume FILE"));
    CHECK(!strstr(text, "--light ") && !strstr(text, "--plan") && !strstr(text, "--out FILE"));
    for (char *line = strtok(text, "\n"); line; line = strtok(NULL, "\n"))
        if (!CHECK(strlen(line) <= 120)) printf("    %s\n", line);
    CHECK(read_file("commands.txt", text, sizeof text) > 50 && strstr(text, "\n  six-way "));
    for (char *line = strtok(text, "\n"); line; line = strtok(NULL, "\n")) CHECK(strlen(line) <= 120);
    check_complaints(&look, 1);
    CHECK(read_file("a.dds", text, sizeof text) == 148 + 8 * 9);
    tested = "render";
    CHECK_COMPLAINTS(none);
    tested = "bake";
}

/* A volume of 2 x 2 x 2 voxels of three floats, as MetaImage. */
static void write_colors(void) {
    static const char head[] =
        "ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\nElementNumberOfChannels = 3\nElementType = "
        "MET_FLOAT\nElementDataFile = LOCAL\n";
    char file[sizeof head + 96];
    float colors[24];
    for (int i = 0; i < 24; ++i) colors[i] = 2;
    memcpy(file, head, sizeof head - 1);
    memcpy(file + sizeof head - 1, colors, sizeof colors);
    write_file("colors.mhd", file, sizeof head - 1 + sizeof colors);
}

static void test_command_line(void) {
    static const unsigned char two[8] = {0, 50, 100, 150, 200, 250, 30, 90}, one[8] = {255, 0, 9, 8, 7, 6, 5, 90};
    static const float balls[2][5] = {{0, 0, 0, 1, 2}, {4, 0, 0, 1, 2}};
    if (!render_is_built() || !folder_begin()) {
        printf("skipped: the command line: run this in the top folder, after make build/tests/bake\n");
        return;
    }
    write_file("two.raw", two, sizeof two), write_file("f1.raw", two, sizeof two);
    write_file("f2.raw", one, sizeof one), write_file("f3.raw", two + 1, 7);
    write_file("f3.raw", "\1\2\3\4\5\6\7\10", 8);
    write_file("v.dds", two, sizeof two), write_file("v1.dds", two, sizeof two), write_file("v2.dds", two, sizeof two);
    write_file("p1.bin", balls[0], sizeof balls[0]), write_file("p2.bin", balls[1], sizeof balls[1]);
    write_file("none.bin", "", 0), write_file("look.txt", "six 1\n", 6), write_file("bake.txt", "tile 3\n", 7);
    write_colors();
    RUN(test_wrong_options);
    RUN(test_refused_options);
    RUN(test_same_as_render);
    RUN(test_frames);
    RUN(test_same_camera);
    RUN(test_camera);
    RUN(test_files);
    RUN(test_remarks);
    RUN(test_glowing);
    RUN(test_full_disk);
    RUN(test_help);
    folder_end();
}

int main(void) {
    RUN(test_slab);
    RUN(test_ball);
    if (!check_memory_only()) RUN(test_single_renders);
    RUN(test_colored);
    RUN(test_grey);
    RUN(test_tiles);
    RUN(test_failure);
    RUN(test_glow);
    RUN(test_layouts);
    RUN(test_alpha);
    RUN(test_rim);
    RUN(test_codes);
    RUN(test_fit);
    RUN(test_names);
    RUN_LONG(test_shader);
    tested = "bake";
    if (!check_memory_only()) test_command_line(); /* which is no program with sanitizers */
    return check_report();
}
