/* examples/map_texture.h, bake map and bake cloud-shadow: views that hold the scene, textures and constants read back
   by readers that know nothing of the writers, the Beer shadow map of Unreal, tiles that meet, and the command line. */

#include "check.h"
#include "impostor.h"
#include "map_texture.h"
#include "mesh.h"
#include "particles.h"
#include "command_line.h"
#include <unistd.h>

enum { MOST = 1 << 20 };
static char data[MOST];
static size_t data_size;

/* ----------------------------------------------------------------------------------------------------- reading DDS */

typedef struct dds_file {
    unsigned dxgi, width, height, depth, array, flags, caps;
    int channels, bytes; /* of a texel: channels, and bytes of each */
    size_t count;        /* of numbers in the file */
} dds_file;

static unsigned word_at(size_t place) {
    const unsigned char *at = (const unsigned char *)data + place;
    return (unsigned)at[0] | (unsigned)at[1] << 8 | (unsigned)at[2] << 16 | (unsigned)at[3] << 24;
}

/* Formats by their numbers in Microsoft's list; and what the last channel is. */
static dds_file read_alpha(const char *name, unsigned alpha) {
    static const int known[9][3] = {{2, 4, 4},  {10, 4, 2}, {11, 4, 2}, {28, 4, 1}, {29, 4, 1},
                                    {41, 1, 4}, {54, 1, 2}, {56, 1, 2}, {61, 1, 1}};
    dds_file file = {0};
    data_size = (size_t)read_file(name, data, sizeof data);
    if (!CHECK(data_size > 148 && memcmp(data, "DDS ", 4) == 0 && memcmp(data + 84, "DX10", 4) == 0)) return file;
    file.height = word_at(12), file.width = word_at(16), file.depth = word_at(24), file.caps = word_at(112);
    file.dxgi = word_at(128), file.flags = word_at(136), file.array = word_at(140);
    for (int i = 0; i < 9; ++i)
        if (known[i][0] == (int)file.dxgi) file.channels = known[i][1], file.bytes = known[i][2];
    CHECK(file.bytes > 0 && word_at(144) == alpha);
    file.count = file.bytes ? (data_size - 148) / (size_t)file.bytes : 0;
    return file;
}

/* Its last channel is no alpha. */
static dds_file read_dds(const char *name) { return read_alpha(name, 4); }

static double half_of(unsigned bits) {
    const int exponent = (int)(bits >> 10 & 31), digits = (int)(bits & 1023);
    const double size = exponent ? ldexp(1024 + digits, exponent - 25) : ldexp(digits, -24);
    return bits >> 15 ? -size : size;
}

/* What a sampler returns for number i of the file that was read last. */
static double number_at(const dds_file *file, size_t i) {
    const unsigned char *at = (const unsigned char *)data + 148 + i * (size_t)file->bytes;
    const unsigned bits = file->bytes == 1 ? at[0] : (unsigned)at[0] | (unsigned)at[1] << 8;
    float single;
    if (file->bytes == 4) return memcpy(&single, at, 4), (double)single;
    return file->bytes == 1 ? bits / 255.0 : file->dxgi == 10 || file->dxgi == 54 ? half_of(bits) : bits / 65535.0;
}

/* ---------------------------------------------------------------------------------------------------- reading JSON */

/* Walks a whole text by the grammar of RFC 8259, without escapes, and keeps the value at one path, such as
   .faces[2].row_x[3]. */
typedef struct json {
    const char *at, *wanted;
    char path[200], text[80];
    double value;
    int failed, found;
} json;

static void json_blanks(json *j) { j->at += strspn(j->at, " \t\r\n"); }

static int json_take(json *j, char c) {
    json_blanks(j);
    if (*j->at != c) return 0;
    ++j->at;
    return 1;
}

static void json_string(json *j, char *out, size_t size) {
    const size_t length = json_take(j, '"') ? strcspn(j->at, "\"\\\n") : 0;
    if (j->at[-1] != '"' || j->at[length] != '"' || length >= size) {
        j->failed = 1;
        return;
    }
    memcpy(out, j->at, length), out[length] = 0;
    j->at += length + 1;
}

/* Digits, not beginning with 0 unless it is the only one; a fraction; an exponent. */
static void json_number(json *j) {
    const char *start = j->at;
    char *end;
    if (*j->at == '-') ++j->at;
    const size_t whole = strspn(j->at, "0123456789");
    if (whole == 0 || (whole > 1 && *j->at == '0')) j->failed = 1;
    j->at += whole;
    if (*j->at == '.' && strspn(++j->at, "0123456789") == 0) j->failed = 1;
    j->at += strspn(j->at, "0123456789");
    if (*j->at == 'e') {
        j->at += j->at[1] == '+' || j->at[1] == '-' ? 2 : 1;
        if (strspn(j->at, "0123456789") == 0) j->failed = 1;
        j->at += strspn(j->at, "0123456789");
    }
    const double value = strtod(start, &end);
    if (end != j->at) j->failed = 1;
    if (strcmp(j->path, j->wanted) == 0) j->value = value, ++j->found;
}

static void json_value(json *j) {
    const size_t length = strlen(j->path);
    char name[80] = "";
    json_blanks(j);
    if (*j->at == '"') {
        json_string(j, name, sizeof name);
        if (strcmp(j->path, j->wanted) == 0) memcpy(j->text, name, sizeof name), ++j->found;
    } else if (*j->at == '{' || *j->at == '[') {
        const char open = *j->at++, close = open == '{' ? '}' : ']';
        int count = 0;
        if (json_take(j, close)) return;
        do {
            if (open == '{') json_string(j, name, sizeof name);
            if (open == '{' && !json_take(j, ':')) j->failed = 1;
            if (open == '{')
                snprintf(j->path + length, sizeof j->path - length, ".%s", name);
            else
                snprintf(j->path + length, sizeof j->path - length, "[%d]", count++);
            if (!j->failed) json_value(j);
            j->path[length] = 0;
        } while (!j->failed && json_take(j, ','));
        if (!json_take(j, close)) j->failed = 1;
    } else {
        json_number(j);
    }
}

/* The value at a path, which must stand there once; -999 without one. */
static json json_find(const char *text, const char *path) {
    json j;
    memset(&j, 0, sizeof j);
    j.at = text, j.wanted = path, j.value = -999;
    json_value(&j);
    json_blanks(&j);
    if (*j.at) j.failed = 1;
    if (!CHECK(!j.failed && j.found == 1)) printf("    %s: %d, %.40s\n", path, j.found, j.at);
    return j;
}

static double json_at(const char *text, const char *path) { return json_find(text, path).value; }

static int json_says(const char *text, const char *path, const char *words) {
    return strcmp(json_find(text, path).text, words) == 0;
}

/* ------------------------------------------------------------------------------------------------------- the views */

static ex_map_aim box_of(double x, double y, double z, double a, double b, double c) {
    ex_map_aim aim;
    memset(&aim, 0, sizeof aim);
    check_set3(aim.lo, x - a, y - b, z - c), check_set3(aim.hi, x + a, y + b, z + c);
    check_set3(aim.up, 0, 1, 0);
    aim.texels = 16, aim.tiles[0] = aim.tiles[1] = 1, aim.slack = 1.0 / 64;
    return aim;
}

/* An empty map of a view: its projection says what it sees. */
static sps_tmap *view_of(sps_context *context, const sps_tmap_light *light, const double range[2]) {
    sps_tmap_settings settings;
    sps_tmap *map = NULL;
    memset(&settings, 0, sizeof settings);
    settings.technique = SPS_TMAP_BEER, settings.near_depth = range[0], settings.far_depth = range[1];
    CHECK_OK(context, sps_tmap_create(context, light, &settings, &map));
    if (map) CHECK_OK(context, sps_tmap_finish(map));
    return map;
}

/* The least and the greatest column, row and distance of the box's corners. */
static void find_extent(const ex_map_aim *aim, const sps_tmap *map, double low[3], double high[3]) {
    double m[16], p[4];
    for (int k = 0; k < 3; ++k) low[k] = HUGE_VAL, high[k] = -HUGE_VAL;
    if (!CHECK(sps_tmap_get_projection(map, 0, m, NULL) == SPS_OK)) return;
    for (int corner = 0; corner < 8; ++corner) {
        for (int a = 0; a < 4; ++a) {
            p[a] = m[4 * a + 3];
            for (int k = 0; k < 3; ++k) p[a] += m[4 * a + k] * (corner >> k & 1 ? aim->hi[k] : aim->lo[k]);
        }
        CHECK(p[3] > 0);
        p[0] /= p[3], p[1] /= p[3];
        for (int k = 0; k < 3; ++k) low[k] = fmin(low[k], p[k]), high[k] = fmax(high[k], p[k]);
    }
}

/* The box touches the ring of texels at the edges, which are empty, on two opposite sides, and lies in the middle. A
   map's edge is half a texel beyond the centre of its outermost texel. */
static void test_sun(void) {
    sps_context *context = check_context(NULL);
    check_random random = {7};
    for (int n = 0; n < 40; ++n) {
        double r[9], low[3], high[3], range[2];
        for (int i = 0; i < 9; ++i) r[i] = check_next(&random);
        ex_map_aim aim = box_of(1e3 * r[0], -50 * r[1], 20 * r[2], 0.1 + r[3], 5 * r[4], r[5]);
        const double way[3] = {n % 4 ? r[6] - 0.5 : 0, n % 4 ? r[7] - 0.5 : -1, n % 4 ? r[8] - 0.5 : 0};
        if (n % 4 == 0) check_set3(aim.up, 0, n % 8 ? 1 : 0, 0); /* along the view, or none */
        aim.tiles[0] = 1 + n % 3, aim.tiles[1] = 1 + n / 3 % 2, aim.texels = n == 9 ? 1 : 3 + n % 5;
        double all[2] = {0, 0}, least[2] = {1e9, 1e9};
        for (int tile = 0; tile < aim.tiles[0] * aim.tiles[1]; ++tile) {
            const int place[2] = {tile % aim.tiles[0], tile / aim.tiles[0]};
            sps_tmap_light light;
            memset(&light, 0, sizeof light);
            ex_map_aim_sun(&aim, way, place, &light, range);
            sps_tmap *map = view_of(context, &light, range);
            find_extent(&aim, map, low, high);
            for (int k = 0; k < 2; ++k) { /* counted across all tiles */
                low[k] += place[k] * aim.texels, high[k] += place[k] * aim.texels;
                CHECK_NEAR(low[k] + high[k], aim.tiles[k] * aim.texels - 1, 1e-7);
                all[k] = fmax(all[k], high[k]), least[k] = fmin(least[k], low[k]);
                CHECK_NEAR(high[k], all[k], 1e-7);
            }
            const double span = high[2] - low[2];
            CHECK(range[0] == 0);
            CHECK_NEAR(low[2], span / 64, 1e-9 * (1 + span));
            CHECK_NEAR(range[1] - high[2], span / 64, 1e-9 * (1 + span));
            sps_tmap_destroy(map);
        }
        const double spare[2] = {least[0] + 0.5, least[1] + 0.5}; /* texels from the edge */
        if (aim.texels > 2) CHECK_NEAR(fmin(spare[0], spare[1]), 1, 1e-7);
    }
    sps_destroy(context);
}

/* Heights that are given; a scene without depth; one of a single point. */
static void test_sun_given(void) {
    static const double down[3] = {0, 0, -2};
    static const int first[2] = {0, 0};
    ex_map_aim aim = box_of(1, 2, 3, 4, 1, 0);
    sps_tmap_light light;
    double range[2];
    memset(&light, 0, sizeof light);
    aim.size = 10, aim.tiles[1] = 2;
    ex_map_aim_sun(&aim, down, first, &light, range);
    CHECK(light.camera.ortho_height == 5 && light.width == 16 && light.height == 16);
    CHECK_NEAR(light.camera.position[0], 1, 1e-14), CHECK_NEAR(light.camera.position[1], 4.5, 1e-14);
    CHECK_NEAR(light.camera.position[2] - light.camera.target[2], range[1], 1e-14);
    CHECK_NEAR(light.camera.position[2], 3 + 0.5 * range[1], 1e-14);
    CHECK(range[0] == 0 && range[1] == 10); /* a flat scene lies in the middle */
    aim = box_of(1, 2, 3, 0, 0, 0);
    ex_map_aim_sun(&aim, down, first, &light, range);
    CHECK(light.camera.ortho_height == 1 && range[1] == 2);
}

/* From a point, the box lies within a texel of the edges as well, and touches them. */
static void test_point(void) {
    static const double towards[3] = {0, 0, 0}, along[3] = {0, -1, 0.5};
    sps_context *context = check_context(NULL);
    check_random random = {11};
    ex_error error;
    for (int n = 0; n < 20; ++n) {
        double r[6], low[3], high[3], range[2];
        sps_tmap_light light;
        for (int i = 0; i < 6; ++i) r[i] = check_next(&random);
        ex_map_aim aim = box_of(3 * r[0], r[1], r[2], 1, 0.2 + r[3], 0.5);
        const double position[3] = {r[4], 6 + 3 * r[5], -1};
        memset(&light, 0, sizeof light);
        if (n % 2) aim.size = 0.7;
        CHECK(ex_map_aim_point(&aim, position, n % 2 ? along : towards, &light, range, &error) == 0);
        sps_tmap *map = view_of(context, &light, range);
        find_extent(&aim, map, low, high);
        const double span = high[2] - low[2], edge = fmin(fmin(low[0], low[1]), 15 - fmax(high[0], high[1]));
        if (n % 2)
            CHECK(light.camera.field_of_view == 0.7);
        else
            CHECK_NEAR(edge, 0.5, 1e-9); /* one texel beyond an edge at -0.5 */
        CHECK_NEAR(range[0], low[2] - span / 64, 1e-12), CHECK_NEAR(range[1], high[2] + span / 64, 1e-12);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* Lights that no view holds, and scenes behind. Faces of a cube count depth along the nearest axis. */
static void test_amid(void) {
    static const double inside[3] = {1, 0.5, 0}, beside[3] = {2.01, 0, 0}, far_off[3] = {0, 0, 9}, none[3] = {0, 0, 0};
    static const double away[3] = {0, 0, 1};
    const ex_map_aim aim = box_of(0, 0, 0, 2, 2, 2), flat = box_of(0, 0, 0, 2, 2, 0);
    sps_tmap_light light;
    double range[2];
    ex_error error;
    memset(&light, 0, sizeof light);
    const double *const amid[3] = {none, inside, beside};
    for (int i = 0; i < 3; ++i)
        CHECK(ex_map_aim_point(&aim, amid[i], none, &light, range, &error) && strstr(error.text, "amid the scene"));
    CHECK(ex_map_aim_point(&aim, far_off, away, &light, range, &error) && strstr(error.text, "lies behind"));
    CHECK(ex_map_aim_around(&aim, inside, &light, range, &error) == 0 && light.omnidirectional == 1);
    CHECK(light.width == 16 && light.height == 16 && light.camera.position[1] == 0.5);
    CHECK(range[0] == 0 && range[1] == 3 + 3.0 / 64); /* from x = 1 to x = -2 */
    CHECK(ex_map_aim_around(&aim, far_off, &light, range, &error) == 0);
    CHECK(range[0] == 7 - 4.0 / 64 && range[1] == 11 + 4.0 / 64);
    CHECK(ex_map_aim_around(&flat, far_off, &light, range, &error) == 0 && range[1] == 9 + 1e-3 * 9);
}

/* ---------------------------------------------------------------------------------------------------- the textures */

static const sps_tmap_technique techniques[] = {SPS_TMAP_OPACITY, SPS_TMAP_DEEP_OPACITY, SPS_TMAP_FOURIER,
                                                SPS_TMAP_MOMENT, SPS_TMAP_BEER};
static const char *const technique_names[] = {"opacity", "deep-opacity", "fourier", "moment", "beer"};
enum { TECHNIQUES = 5 };

/* A puff with particles and a polygon, from a point above it, or around one amid it. */
static sps_tmap *make_map(sps_context *context, int technique, int is_round, int size) {
    static check_triangles square;
    check_scene s;
    sps_tmap_light light;
    sps_tmap_settings settings;
    sps_tmap *map = NULL;
    check_clear(&s, 1, 1), memset(&light, 0, sizeof light), memset(&settings, 0, sizeof settings);
    static const double corners[3][3] = {{-1, -0.5, -1}, {1, -0.5, -1}, {0, -0.5, 1}};
    memset(&square, 0, sizeof square);
    check_add_puff(&s, 2), check_add_swarm(&s, 0.5);
    check_add_corners(&square, corners[0], corners[1], corners[2]);
    check_add_mesh(&s, &square, 0.5);
    light.width = light.height = size, light.omnidirectional = is_round;
    check_set3(light.camera.position, 0.2, is_round ? 0 : 4, 0.1);
    if (!is_round) check_perspective(&light.camera, 0.6);
    settings.technique = (sps_tmap_technique)technique;
    settings.near_depth = is_round ? 0 : 3.5, settings.far_depth = is_round ? 2 : 6; /* with gas in front */
    if (CHECK_OK(context, sps_tmap_create(context, &light, &settings, &map))) {
        CHECK_OK(context, sps_tmap_add(map, &s.scene));
        CHECK_OK(context, sps_tmap_finish(map));
    }
    check_free_triangles(&square);
    return map;
}

/* The file holds the bytes that sps_tmap_export writes, and says what they are. */
static void check_dds(sps_tmap *map, const sps_tmap_export_settings *settings) {
    static const unsigned dxgi[4][2] = {{41, 2}, {54, 10}, {56, 11}, {61, 28}}; /* of one channel, of four */
    static char made[MOST];
    char path[100];
    ex_map_texture texture;
    sps_tmap_texture about;
    ex_error error;
    memset(&texture, 0, sizeof texture);
    texture.settings = *settings;
    snprintf(path, sizeof path, "%s/a.dds", folder);
    CHECK(sps_tmap_export(map, settings, made, sizeof made, &about) == SPS_OK);
    if (!CHECK(ex_map_export(map, &texture) == SPS_OK)) return;
    CHECK(memcmp(&texture.about, &about, sizeof about) == 0);
    CHECK(ex_map_write_dds(path, &texture, &error) == 0);
    free(texture.texels);
    const dds_file file = read_dds("a.dds");
    const int deep = settings->layout == SPS_EXPORT_SLICES, cube = settings->layout == SPS_EXPORT_CUBE;
    CHECK(data_size == 148 + about.bytes && memcmp(data + 148, made, about.bytes) == 0);
    CHECK(file.dxgi == dxgi[settings->format][about.channels == 4] && file.channels == about.channels);
    CHECK(file.width == (unsigned)about.width && file.height == (unsigned)about.height);
    CHECK(file.depth == (deep ? (unsigned)about.layers : 0) && file.flags == (cube ? 4u : 0));
    CHECK(file.array == (unsigned)(deep ? 1 : cube ? about.layers / 6 : about.layers));
    CHECK((file.caps & 0x200) == (cube ? 0x200u : 0) && (file.caps & 0x200000) == (deep ? 0x200000u : 0));
}

static void test_textures(void) {
    sps_context *context = check_context(NULL);
    for (int n = 0; n < TECHNIQUES * 4; ++n) {
        sps_tmap_export_settings settings;
        memset(&settings, 0, sizeof settings);
        settings.layout = (sps_export_layout)(n / TECHNIQUES);
        sps_tmap *map = make_map(context, (int)techniques[n % TECHNIQUES], settings.layout == SPS_EXPORT_CUBE, 9);
        for (int format = 0; format < 4 && map; ++format) {
            settings.format = (sps_export_format)format;
            settings.content = SPS_EXPORT_GAS;
            check_dds(map, &settings);
            settings.content = SPS_EXPORT_SURFACES;
            if (format < SPS_EXPORT_UNORM16) check_dds(map, &settings);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* Without compression, the rows end the file: each has its number, its size, and A, B, G, R. */
static void test_exr(void) {
    sps_context *context = check_context(NULL);
    sps_tmap *map = make_map(context, SPS_TMAP_FOURIER, 0, 9);
    for (int is_float = 0; is_float < 2 && map; ++is_float) {
        const size_t item = is_float ? 4 : 2;
        ex_map_texture texture;
        ex_error error;
        char path[100];
        int wrong = 0;
        memset(&texture, 0, sizeof texture);
        texture.settings.layout = SPS_EXPORT_ATLAS;
        texture.settings.format = is_float ? SPS_EXPORT_FLOAT : SPS_EXPORT_HALF;
        snprintf(path, sizeof path, "%s/a.exr", folder);
        CHECK(ex_map_export(map, &texture) == SPS_OK && ex_map_write_exr(path, &texture, 0, &error) == 0);
        data_size = (size_t)read_file("a.exr", data, sizeof data);
        const size_t width = (size_t)texture.about.width, height = (size_t)texture.about.height;
        const size_t row = 8 + 4 * item * width;
        if (!CHECK(width == 18 && height == 9 && data_size > height * row)) continue;
        const size_t start = data_size - height * row;
        for (size_t y = 0; y < height; ++y) {
            CHECK(word_at(start + y * row) == y && word_at(start + y * row + 4) == row - 8);
            for (size_t i = 0; i < 4 * width; ++i) {
                const char *at = data + start + y * row + 8 + ((3 - i % 4) * width + i / 4) * item;
                wrong += memcmp(at, (const char *)texture.texels + (4 * y * width + i) * item, item) != 0;
            }
        }
        CHECK(wrong == 0);
        free(texture.texels);
    }
    sps_tmap_destroy(map);
    sps_destroy(context);
}

static void test_png(void) {
    const char *magick = find_magick();
    sps_context *context = check_context(NULL);
    sps_tmap *map = make_map(context, SPS_TMAP_OPACITY, 0, 9);
    ex_map_texture texture;
    ex_error error;
    char path[100], command[300];
    memset(&texture, 0, sizeof texture);
    texture.settings.layout = SPS_EXPORT_ATLAS, texture.settings.format = SPS_EXPORT_UNORM8;
    snprintf(path, sizeof path, "%s/a.png", folder);
    CHECK(ex_map_export(map, &texture) == SPS_OK && ex_map_write_png(path, &texture, &error) == 0);
    snprintf(command, sizeof command, "cd %s && %s a.png -depth 8 rgba:a.bytes", folder, magick ? magick : "");
    if (!magick) printf("skipped: PNG by ImageMagick: install imagemagick\n");
    if (magick)
        CHECK(system(command) == 0 && read_file("a.bytes", data, sizeof data) == (int)texture.about.bytes &&
              memcmp(data, texture.texels, texture.about.bytes) == 0);
    free(texture.texels);
    sps_tmap_destroy(map);
    sps_destroy(context);
}

/* --------------------------------------------------------------------------------------------------- the constants */

static int same_float(const char *text, const char *path, float value) {
    const float found = (float)json_at(text, path);
    return memcmp(&found, &value, sizeof value) == 0;
}

static void check_face(const char *text, int number, const sps_tmap_constants *face) {
    const float *const rows[4] = {face->row_x, face->row_y, face->row_w, face->row_distance};
    static const char *const names[4] = {"row_x", "row_y", "row_w", "row_distance"};
    const struct {
        const char *name;
        int value;
    } integers[] = {
        {"technique", face->technique},   {"components", face->components}, {"has_range", face->has_range},
        {"has_planes", face->has_planes}, {"cubic", face->cubic},           {"has_surfaces", face->has_surfaces},
        {"width", face->width},           {"height", face->height},         {"face", face->face},
        {"face_count", face->face_count}, {"has_fronts", face->has_fronts}, {"border", face->border}};
    const struct {
        const char *name;
        float value;
    } floats[] = {{"near_depth", face->near_depth},
                  {"far_depth", face->far_depth},
                  {"bias", face->bias},
                  {"bias_per_distance", face->bias_per_distance}};
    char path[100];
    for (int i = 0; i < 16; ++i) {
        snprintf(path, sizeof path, ".faces[%d].%s[%d]", number, names[i / 4], i % 4);
        CHECK(same_float(text, path, rows[i / 4][i % 4]));
    }
    for (int i = 0; i < 12; ++i) {
        snprintf(path, sizeof path, ".faces[%d].%s", number, integers[i].name);
        CHECK((int)json_at(text, path) == integers[i].value);
    }
    for (int i = 0; i < 4; ++i) {
        snprintf(path, sizeof path, ".faces[%d].%s", number, floats[i].name);
        CHECK(same_float(text, path, floats[i].value));
    }
}

/* All members of both structs, bit for bit; and what the texture is. */
static void test_constants(void) {
    static const char *const formats[] = {"float", "half", "unorm16", "unorm8"};
    static const char *const layouts[] = {"array", "slices", "atlas", "cube"};
    sps_context *context = check_context(NULL);
    for (int n = 0; n < 4; ++n) {
        static char text[20000];
        char path[100];
        ex_map_texture texture;
        ex_error error;
        sps_tmap_constants face;
        sps_tmap *map = make_map(context, (int)techniques[4 - n], n == 3, 7);
        memset(&texture, 0, sizeof texture);
        texture.settings.format = (sps_export_format)n, texture.settings.layout = (sps_export_layout)n;
        texture.settings.depth_limit = n == 1 ? 0.25f : 0;
        if (n == 2) texture.settings.distance_unit = 1e5, texture.settings.extinction_unit = 1 / 3.0;
        snprintf(path, sizeof path, "%s/a.json", folder);
        CHECK(ex_map_export(map, &texture) == SPS_OK && ex_map_write_constants(path, map, &texture, &error) == 0);
        CHECK(read_file("a.json", text, sizeof text) > 500);
        for (int i = 0; i < (n == 3 ? 6 : 1); ++i)
            if (CHECK(sps_tmap_get_constants(map, i, &face) == SPS_OK)) check_face(text, i, &face);
        const sps_export_constants *c = &texture.about.constants;
        CHECK(json_at(text, ".width") == texture.about.width && json_at(text, ".height") == texture.about.height);
        CHECK(json_at(text, ".layers") == texture.about.layers && json_at(text, ".channels") == texture.about.channels);
        CHECK(json_at(text, ".clamped") == (double)texture.about.clamped);
        CHECK((texture.about.clamped > 0) == (n == 1));
        CHECK(json_says(text, ".format", formats[n]) && json_says(text, ".layout", layouts[n]));
        CHECK(json_says(text, ".content", "gas"));
        CHECK(json_at(text, ".distance_unit") == (n == 2 ? 1e5 : 1));
        CHECK(json_at(text, ".extinction_unit") == (n == 2 ? 1 / 3.0 : 1));
        CHECK((int)json_at(text, ".export.components") == c->components && c->components > 0);
        CHECK((int)json_at(text, ".export.columns") == c->columns);
        CHECK(same_float(text, ".export.moment_bias", c->moment_bias));
        for (int i = 0; i < 2 * c->components; ++i) {
            snprintf(path, sizeof path, ".export.%s[%d]", i % 2 ? "offset" : "scale", i / 2);
            CHECK(same_float(text, path, (i % 2 ? c->offset : c->scale)[i / 2]));
        }
        free(texture.texels);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* ----------------------------------------------------------------------------------------------------- the impostor */

enum { CARD = 17 };

static void see_card(check_scene *s) {
    check_clear(s, CARD, CARD);
    check_set3(s->view.camera.position, 0, 0, 5);
    s->view.camera.ortho_height = 2;
}

static void find_normals(const check_scene *s, float *normals) {
    sps_context *context = check_context(NULL);
    memset(normals, 0, 3 * CARD * CARD * sizeof *normals);
    CHECK_OK(context, ex_impostor_normals(context, &s->scene, &s->view, normals));
    sps_destroy(context);
}

/* A ball of radius 1, with the middle of a pixel at x, y. The gradient is at its rim: at the front, where T is 1, and
   at the back, where it is e^-t: (1 + T) x, (1 + T) y, (1 - T) z. Gas in a slab counts as mixed. Where T matters, slabs
   are 0.04 * 0.7 of the radius, by which the normal may be off; otherwise the default holds the ball's front. Particles
   that glow absorb 2^-14; of d, depth in a step of 1/16 pixel, rounding takes 1e-6 / d. */
static void test_ball_normals(void) {
    static const double depths[] = {0.5, 2, 20, 200};
    static float normals[3 * CARD * CARD];
    for (int n = 0; n < 4; ++n) {
        sps_particle ball = {{0, 0, 0}, 1, (float)depths[n], {0, 0, 0}};
        sps_particles set;
        check_scene s;
        double worst = 0;
        see_card(&s);
        memset(&set, 0, sizeof set);
        set.count = 1, set.read_fn = check_read_particles, set.user = &ball;
        set.albedo[0] = 1, set.emission[1] = 3; /* which count for nothing */
        s.scene.particles = &set, s.scene.particle_set_count = 1;
        s.view.slab_thickness = depths[n] < 10 ? 0.04 : 0;
        find_normals(&s, normals);
        const double d = 0.5 * depths[n] * 2.0 / CARD / 16, most = 1e-6 / d + (depths[n] < 10 ? 0.028 : 2.0 / 16384);
        for (int i = 0; i < CARD * CARD; ++i) {
            const double x = (i % CARD - CARD / 2) * 2.0 / CARD, y = (CARD / 2 - i / CARD) * 2.0 / CARD;
            const double r = x * x + y * y, z = sqrt(fmax(1 - r, 0)), through = exp(-depths[n] * z);
            const ex_vec exact = ex_vec_unit(ex_vec_of((1 + through) * x, (1 + through) * y, (1 - through) * z));
            const float *to = normals + 3 * i;
            const ex_vec found = ex_vec_of((double)to[0], (double)to[1], (double)to[2]);
            if (r < 0.64) worst = fmax(worst, ex_vec_length(ex_vec_sub(found, exact)));
            if (r > 1.1) CHECK(to[0] == 0 && to[1] == 0 && to[2] == 1);
        }
        if (figures()) printf("ball of %g: normals off by %.2g, allowed %.2g\n", depths[n], worst, most);
        CHECK(worst < most);
    }
}

/* Extinction 2 (1 + x) in a cube: inside, the gradient is 2 along x; at the front and the back face, extinction falls
   to 0 along z. Both are weighted alike, by 1 - e^-4: at x = 0, the normal is -2 : 0 : 2^2. Kernels turn faces into
   ramps of up to four voxels of 2/128. A ramp of depth t has a sixth of t less of extinction squared than it should: 2
   % of z. */
static int ramp(void *user, const int lo[3], const int size[3], float *out) {
    (void)user;
    for (int k = 0; k < size[2]; ++k)
        for (int j = 0; j < size[1]; ++j)
            for (int i = 0; i < size[0]; ++i) *out++ = (float)((lo[0] + i + 0.5) / 16);
    return 0;
}

static void test_ramp_normals(void) {
    static const sps_transfer_point points[2] = {{0, {1, 1, 1}, 0, {0, 0, 0}}, {1, {1, 0, 1}, 4, {5, 5, 5}}};
    static float plain[3 * CARD * CARD], classified[3 * CARD * CARD], turned[3 * CARD * CARD];
    const sps_transfer transfer = {points, 2, NULL, NULL, 0};
    const int middle = 3 * (CARD * (CARD / 2) + CARD / 2);
    check_scene s;
    double worst = 0;
    see_card(&s);
    sps_volume *volume = check_add_volume(&s, 16, 16, 128, check_box(-1, -1, -1, 1, 1, 1));
    volume->read_fn = ramp, volume->extinction = 4, s.view.slab_thickness = 0.2;
    find_normals(&s, plain);
    if (figures())
        printf("ramp: %.4f %.4f %.4f\n", (double)plain[middle], (double)plain[middle + 1], (double)plain[middle + 2]);
    CHECK_NEAR((double)plain[middle], -2 / sqrt(20), 0.02), CHECK_NEAR((double)plain[middle + 2], 4 / sqrt(20), 0.02);
    CHECK_NEAR((double)plain[middle + 1], 0, 1e-4);
    volume->transfer = &transfer;
    find_normals(&s, classified);
    for (int i = 0; i < 3 * CARD * CARD; ++i) { /* values end where kernels smooth extinction */
        const int x = i / 3 % CARD, y = i / 3 / CARD;
        if (x > CARD / 3 && x < CARD - CARD / 3 && y > CARD / 3 && y < CARD - CARD / 3)
            worst = fmax(worst, fabs((double)plain[i] - (double)classified[i]));
    }
    if (figures()) printf("ramp: with a transfer function %.2g\n", worst);
    CHECK(worst < 0.02);
    /* The card's axes turn with its camera. */
    volume->transfer = NULL, s.view.camera.up[0] = 1, s.view.camera.up[1] = 0;
    find_normals(&s, turned);
    CHECK_NEAR((double)turned[middle + 1], (double)plain[middle], 1e-3);
    CHECK_NEAR((double)turned[middle], 0, 1e-4);
}

/* An opaque polygon hides gas, and has no gradient of it. */
static void test_hidden_normals(void) {
    static const double origin[3] = {-1, -1, 1}, u[3] = {1, 0, 0}, v[3] = {0, 2, 0};
    static float normals[3 * CARD * CARD];
    check_triangles wall;
    check_scene s;
    int bent = 0;
    memset(&wall, 0, sizeof wall);
    see_card(&s);
    check_add_swarm(&s, 3);
    check_add_quad(&wall, origin, u, v);
    check_add_mesh(&s, &wall, 0.5);
    find_normals(&s, normals);
    for (int i = 0; i < CARD * CARD; ++i) {
        const float *n = normals + 3 * i;
        if (i % CARD < CARD / 2) CHECK(n[0] == 0 && n[1] == 0 && n[2] == 1);
        bent += i % CARD > CARD / 2 && n[2] < 0.9f;
        CHECK_NEAR(sqrt(pow((double)n[0], 2) + pow((double)n[1], 2) + pow((double)n[2], 2)), 1, 1e-6);
    }
    CHECK(bent > 5);
    check_free_triangles(&wall);
}

/* Straight colors, also beside what has alpha; depths; failures. */
static void test_impostor_numbers(void) {
    static const float rgba[16] = {0.5f, 0.25f, 0, 0.5f, 9, 9, 9, 0, 1, 0, 2, 1, 0, 0, 0, 0};
    static const float straight[16] = {1, 0.5f, 0, 0.5f, 1, 0.25f, 1, 0, 1, 0, 2, 1, 1, 0.25f, 1, 0};
    static const double range[2] = {2, 4};
    float out[16], normals[3 * CARD * CARD];
    sps_context *context = check_context(NULL);
    check_scene s;
    see_card(&s);
    ex_impostor_straight(rgba, 2, out);
    CHECK(memcmp(out, straight, sizeof out) == 0);
    CHECK(ex_impostor_depth(2.5f, range) == 0.25f && ex_impostor_depth(1, range) == 0);
    CHECK(ex_impostor_depth(5, range) == 1 && ex_impostor_depth((float)HUGE_VAL, range) == 1);
    check_add_puff(&s, NAN);
    CHECK(ex_impostor_normals(context, &s.scene, &s.view, normals) == SPS_ERROR_ARGUMENT);
    sps_destroy(context);
}

/* ------------------------------------------------------------------------------------------------ the command line */

#define VOLUME  "--volume c.raw --size 8,8,8 --box -1,-1,-1,1,1,1 --extinction 2 "
#define SCENE   VOLUME "--particles balls.f32 --mesh q.obj "
#define SUN     "--light directional,0.3,-1,0.2,1,1,1 --map-resolution 9 "
#define LAMP    "--light point,0,5,0,1,1,1 --map-resolution 9 "
#define MAP     "map " VOLUME SUN
#define CLOUD   "cloud-shadow " VOLUME SUN
#define WORD    "--out a.dds "
#define SPHERES "--light directional,0,0,-1,1,1,1 --metres-per-unit .01 --map-resolution 33 "

static void test_wrong_options(void) {
    static const complaint wrong[] = {
        {"map " SUN WORD, 2, "nothing to bake: give --volume, --particles or --mesh"},
        {"map --particles none.f32 " SUN WORD, 2, "nothing to bake: the scene is empty"},
        {"map " VOLUME WORD, 2, "bake map needs one --light or --camera, and there are 0"},
        {MAP LAMP WORD, 2, "bake map needs one --light or --camera, and there are 2"},
        {"cloud-shadow " VOLUME WORD, 2, "bake cloud-shadow needs one --light, and there are 0"},
        {MAP "--camera 0,0,5,0,0,0 " WORD, 2, "--camera and --light exclude each other"},
        {MAP, 2, "nothing to write: give --out FILE.dds or --surfaces"},
        {CLOUD, 2, "nothing to write: give --out FILE.dds\n"},
        {MAP "--out a.tif", 2, "--out a.tif: the name must end in .dds, .exr or .png"},
        {MAP WORD "--surfaces a.exr", 2, "--surfaces a.exr: the name must end in .dds"},
        {MAP "--out a.exr", 2, "--out a.exr holds one picture: give --layout atlas, or a .dds file"},
        {MAP "--out a.png --layout slices", 2, "--out a.png holds one picture"},
        {MAP "--out a.png --layout atlas --texels half", 2, "--out a.png holds no --texels half"},
        {MAP "--out a.exr --layout atlas --texels unorm16", 2, "--out a.exr holds no --texels unorm16"},
        {MAP "--surfaces a.dds --texels unorm8", 2, "--surfaces a.dds holds no --texels unorm8"},
        {MAP "--surfaces a.dds --shadow beer", 2, "--shadow says nothing without --out"},
        {MAP "--surfaces a.dds --map-components 3", 2, "--map-components says nothing without --out"},
        {MAP WORD "--layout unity", 2, "--layout unity is for bake six-way; maps have array, slices, atlas and cube"},
        {MAP WORD "--layout cube", 2, "--layout cube needs a point light, which has six views"},
        {"map " VOLUME "--camera 0,0,5,0,0,0 --layout cube " WORD, 2, "--layout cube needs a point light"},
        {"map " VOLUME LAMP "--layout cube --border 1 " WORD, 2, "--border says nothing about --layout cube"},
        {"map " VOLUME LAMP "--layout cube --fov 9 " WORD, 2, "--fov says nothing about --layout cube"},
        {"map " VOLUME LAMP "--ortho 9 " WORD, 2, "--ortho says nothing about --light point,0,5,0,1,1,1: give --fov"},
        {MAP "--fov 9 " WORD, 2, "--fov says nothing about --light directional,0.3,-1,0.2,1,1,1: give --ortho"},
        {"map " VOLUME "--light point,0,0,0,1,1,1 " WORD, 2, "the light lies amid the scene, or nearly"},
        {"map " VOLUME "--light spot,0,5,0,0,-1,0,9,89,1,1,1 " WORD, 2, "a map sees up to 88 degrees from its axis"},
        {"map " VOLUME "--light spot,0,5,0,0,1,0,9,20,1,1,1 " WORD, 2, "all of the scene lies behind the map's view"},
        {"map " VOLUME "--camera 0,0,5,0,0,9 " WORD, 2, "all of the scene lies behind the map's view"},
        {"map " VOLUME "--light projector,0,5,0,0,-1,0,20,1,1,1,x.ppm " WORD, 2, "a projector makes no map"},
        {"cloud-shadow " VOLUME LAMP WORD, 2, "--light point,0,5,0,1,1,1: a cloud shadow needs a directional one"},
        {MAP WORD "--depths 2,2", 2, "--depths 2,2: the far one must be greater"},
        {MAP WORD "--border 65", 2, "--border: '65' is out of range"},
        {MAP WORD "--shadow deep", 2, "--shadow deep: a texture holds no lists"},
        {MAP WORD "--shadow table", 2, "--shadow table: bake map needs opacity, deep-opacity, fourier, moment or beer"},
        {MAP WORD "--shadow fourier --map-cubic", 2, "--map-cubic says nothing about --shadow fourier"},
        {MAP WORD "--shadow fourier --map-components 4", 2, "components is 4"},
        {CLOUD WORD "--shadow opacity", 2, "--shadow opacity: --convention unreal needs deep or compressed"},
        {CLOUD WORD "--convention library --shadow deep", 2, "--shadow deep: a texture holds no lists"},
        {CLOUD WORD "--convention unity", 2, "--convention: 'unity' is not unreal|library"},
        {CLOUD WORD "--convention library --metres-per-unit 2", 2,
         "--metres-per-unit says nothing about --convention l"},
        {CLOUD WORD "--metres-per-unit 0", 2, "--metres-per-unit: '0' is out of range"},
        {CLOUD WORD "--texels unorm8", 2, "--convention unreal has --texels half or float"},
        {CLOUD "--out a.png", 2, "--convention unreal has --texels half or float"},
        {CLOUD WORD "--layout atlas", 2, "--layout says nothing about --convention unreal"},
        {CLOUD WORD "--tiles 2,1", 2, "--out a.dds: with 2 tiles, the name needs %d"},
        {CLOUD "--out a%d.dds --constants b.json --tiles 1,2", 2,
         "--constants b.json: with 2 tiles, the name needs %d"},
        {CLOUD "--out a%s.dds", 2, "--out a%s.dds: % begins %d or %0Nd, once"},
        {CLOUD "--out a%d.dds --tiles 4096,5", 2, "--tiles 4096,5: more than 16384 maps"},
        {CLOUD WORD "--exr-compression zip", 2, "--exr-compression says nothing without an .exr file"},
        {MAP "--out a.dds --constants a.dds", 2, "--out and --constants are the same file: a.dds"},
        {MAP "--out a.dds --surfaces a.dds", 2, "--out and --surfaces are the same file: a.dds"},
        {MAP "--out missing/a.dds", 2, "missing/a.dds: cannot be written"},
        {"map --volume v.dds --size 2,2,2 " SUN "--out v.dds", 2, "--out v.dds is a file that --volume reads"},
        {"map " VOLUME SUN WORD "--constants balls.f32 --particles balls.f32", 2,
         "--constants balls.f32 is a file that --particles reads"},
        {"map --volume nan.raw --type f32 --size 1,1,1 " SUN WORD, 2, "(--replace-invalid makes it 0)"},
        {"map --volume nan.raw --type f32 --size 1,1,1 --replace-invalid " SUN WORD, 0, NULL}};
    CHECK_COMPLAINTS(wrong);
}

/* Options of other commands, with a value. */
static void test_refused_options(void) {
    static const char *const given[] = {"--ambient 1,1,1",  "--gas-ambient 1,1,1", "--background 1,1,1",
                                        "--width 4",        "--region 0,0,1,1",    "--coverage 2",
                                        "--light-size 2",   "--light-angle 1",     "--shadow-resolution 4",
                                        "--table-size 9",   "--no-shadows",        "--reference",
                                        "--samples 4",      "--filling splat",     "--tolerance 1",
                                        "--budget-error 1", "--scattering single", "--pfm x.pfm",
                                        "--exr x.exr",      "--stats x.json",      "--part 1/2",
                                        "--plan",           "--list-grids",        "--tile 4",
                                        "--frames 1,2",     "--alpha straight",    "--scale 2",
                                        "--out-a x.dds",    "--sky x.hdr"};
    static const char *const of_map[] = {"--tiles 1,1", "--convention unreal", "--metres-per-unit 1"};
    static const char *const of_cloud[] = {"--camera 0,0,5,0,0,0", "--fov 4", "--depths 1,2", "--surfaces x.dds"};
    enum { GIVEN = sizeof given / sizeof *given };
    for (int i = 0; i < 2 * GIVEN + 7; ++i) {
        char options[300], words[100];
        const int is_cloud = i < 2 * GIVEN ? i % 2 : i >= 2 * GIVEN + 3;
        const char *option = i < 2 * GIVEN ? given[i / 2]
                             : is_cloud    ? of_cloud[i - 2 * GIVEN - 3]
                                           : of_map[i - 2 * GIVEN];
        snprintf(options, sizeof options, "%s%s " WORD, is_cloud ? CLOUD : MAP, option);
        snprintf(words, sizeof words, "%.*s says nothing about bake %s: ", (int)strcspn(option, " "), option,
                 is_cloud ? "cloud-shadow" : "map");
        const complaint one = {options, 2, words};
        check_complaints(&one, 1);
    }
}

/* What the command reads, loaded here. */
typedef struct loaded {
    sps_volume gas;
    sps_particles set;
    sps_mesh mesh;
    sps_scene scene;
    ex_grid grid;
    ex_particles particles;
    ex_mesh polygons;
} loaded;

static void load(loaded *s) {
    static const int size[3] = {8, 8, 8};
    char path[100];
    ex_voxel_file file;
    ex_error error;
    memset(s, 0, sizeof *s);
    snprintf(path, sizeof path, "%s/c.raw", folder);
    CHECK(ex_voxel_file_raw(&file, path, size, EX_U8, &error) == 0);
    file.max_bytes = EX_MAX_BYTES;
    CHECK(ex_grid_load(&s->grid, &file, &error) == 0);
    snprintf(path, sizeof path, "%s/balls.f32", folder);
    CHECK(ex_particles_load(&s->particles, path, 0, &error) == 0);
    snprintf(path, sizeof path, "%s/q.obj", folder);
    CHECK(ex_mesh_load(&s->polygons, path, 60, &error) == 0);
    memcpy(s->gas.size, size, sizeof size);
    s->gas.placement = check_box(-1, -1, -1, 1, 1, 1);
    s->gas.read_fn = ex_grid_read, s->gas.range_fn = ex_grid_range, s->gas.user = &s->grid, s->gas.extinction = 2;
    s->set.count = s->particles.count, s->set.read_fn = ex_particles_read, s->set.user = s->particles.list;
    s->mesh.triangle_count = s->polygons.triangle_count, s->mesh.read_fn = ex_mesh_read, s->mesh.user = &s->polygons;
    s->mesh.has_normals = 1;
    s->scene.volumes = &s->gas, s->scene.volume_count = 1, s->scene.particles = &s->set;
    s->scene.particle_set_count = 1, s->scene.meshes = &s->mesh, s->scene.mesh_count = 1;
}

static void unload(loaded *s) { ex_grid_free(&s->grid), ex_particles_free(&s->particles), ex_mesh_free(&s->polygons); }

static sps_tmap *make_loaded(sps_context *context, const loaded *s, const sps_tmap_light *light, int technique) {
    sps_tmap_settings settings;
    sps_tmap *map = NULL;
    memset(&settings, 0, sizeof settings);
    settings.technique = (sps_tmap_technique)technique, settings.near_depth = 2, settings.far_depth = 8;
    settings.cubic = technique == SPS_TMAP_DEEP_OPACITY;
    if (CHECK_OK(context, sps_tmap_create(context, light, &settings, &map))) {
        CHECK_OK(context, sps_tmap_add(map, &s->scene));
        CHECK_OK(context, sps_tmap_finish(map));
    }
    return map;
}

/* Numbers of a file of floats, and what is exported here. The two programs may round differently: 16 operations of
   6e-8, of numbers up to the largest one. Where both are compiled alike, no more than that is found. Otherwise a texel
   may have one more slice of gas at an end, with an optical depth of 1e-10, which the other rounds to none. That moves
   the bins by which a range is found, and so its ends by up to half of one of 16 bins. At three times the mean density,
   there is a tenth of the optical depth. One texel in 100 may be such. Vectors and plain C differ by 2e-5, as in
   test_simd. */
static void check_numbers(sps_tmap *map, sps_export_layout layout, sps_export_content content, const char *name) {
    static float made[MOST / 4];
    sps_tmap_export_settings settings;
    sps_tmap_texture about;
    const double room = SPSI_LANES > 1 ? 1e-6 : 2e-5;
    double worst = 0, largest = 0;
    size_t moved = 0;
    memset(&settings, 0, sizeof settings);
    settings.layout = layout, settings.content = content;
    CHECK(sps_tmap_export(map, &settings, made, sizeof made, &about) == SPS_OK);
    const dds_file file = read_dds(name);
    if (!CHECK(file.count * 4 == about.bytes && file.bytes == 4)) return;
    for (size_t i = 0; i < file.count; ++i) {
        const double exact = (double)made[i];
        if (exact < 1e29) largest = fmax(largest, fabs(exact));
        if (exact > 1e29) CHECK(number_at(&file, i) > 1e29);
    }
    for (size_t i = 0; i < file.count; ++i) {
        const double off = fabs((double)made[i] - number_at(&file, i));
        if (made[i] < 1e29f) worst = fmax(worst, off), moved += off > room * largest;
    }
    if (!CHECK(moved * 100 <= file.count && worst <= 0.1 * largest && largest > 0.05))
        printf("    %s: %d numbers, by up to %g of %g\n", name, (int)moved, worst, largest);
    if (figures())
        printf("%s of content %d: %d off, by up to %g of %g\n", name, (int)content, (int)moved, worst, largest);
}

/* Every number of a map is that of sps_tmap_export of the same scene, seen from the same place. */
static void test_same_as_export(void) {
    static const char *const layouts[] = {"array", "slices", "atlas"};
    sps_context *context = check_context(NULL);
    loaded s;
    load(&s);
    for (int n = 0; n < 2 * TECHNIQUES; ++n) {
        const int t = n % TECHNIQUES, spot = n / TECHNIQUES;
        char options[400];
        sps_tmap_light light;
        memset(&light, 0, sizeof light);
        check_set3(light.camera.position, 3, 4, 2), check_set3(light.camera.up, 0, 1, 0);
        check_orthographic(&light.camera, 4);
        check_perspective(&light.camera, spot ? 50 * EX_PI / 180 : 0);
        light.width = light.height = 12, light.border = t % 3;
        snprintf(options, sizeof options,
                 "map " SCENE "--camera 3,4,2,0,0,0 %s --depths 2,8 --map-resolution 12 --border %d --shadow %s%s "
                 "--texels float --layout %s --out a.dds --surfaces s.dds",
                 spot ? "--fov 50" : "--ortho 4", t % 3, technique_names[t], t == 1 ? " --map-cubic" : "",
                 layouts[n % 3]);
        const complaint made = {options, 0, NULL};
        check_complaints(&made, 1);
        sps_tmap *map = make_loaded(context, &s, &light, (int)techniques[t]);
        check_numbers(map, (sps_export_layout)(n % 3), SPS_EXPORT_GAS, "a.dds");
        check_numbers(map, SPS_EXPORT_ARRAY, SPS_EXPORT_SURFACES, "s.dds");
        sps_tmap_destroy(map);
    }
    unload(&s);
    sps_destroy(context);
}

/* The same of a cube, of each content. The default is cubic deep opacity. */
static void test_cube(void) {
    static const complaint made[] = {{"map " SCENE "--light point,0.11,0.23,0.02,1,1,1 --layout cube --depths 2,8 "
                                      "--map-resolution 7 --texels float --out a.dds --surfaces s.dds",
                                      0, NULL},
                                     {"map " SCENE
                                      "--light point,0.11,0.23,0.02,1,1,1 --layout cube --map-resolution 7 "
                                      "--out b.dds --surfaces s8.dds --texels unorm8",
                                      0, NULL}};
    sps_context *context = check_context(NULL);
    sps_tmap_light light;
    loaded s;
    load(&s);
    memset(&light, 0, sizeof light);
    check_set3(light.camera.position, 0.11, 0.23, 0.02);
    light.omnidirectional = 1, light.width = light.height = 7;
    CHECK_COMPLAINTS(made);
    sps_tmap *map = make_loaded(context, &s, &light, SPS_TMAP_DEEP_OPACITY);
    check_numbers(map, SPS_EXPORT_CUBE, SPS_EXPORT_GAS, "a.dds");
    CHECK(word_at(136) == 4 && word_at(140) == 3); /* eight components and the front */
    check_numbers(map, SPS_EXPORT_CUBE, SPS_EXPORT_SURFACES, "s.dds");
    CHECK(word_at(136) == 4 && word_at(140) == 1 && word_at(128) == 41);
    CHECK(read_dds("b.dds").dxgi == 28 && read_dds("s8.dds").dxgi == 41); /* surfaces are never unorm */
    sps_tmap_destroy(map);
    unload(&s);
    sps_destroy(context);
}

/* By default, the scene with two more voxels lies a texel within the map, and between the ends of its range; for
   Fourier with a sixteenth to spare. */
static void test_fitted(void) {
    static const char *const given[] = {SUN,
                                        SUN "--shadow fourier",
                                        LAMP,
                                        "--light spot,0,5,0,0,-1,0,10,15,1,1,1 --map-resolution 9",
                                        SUN "--ortho 3",
                                        LAMP "--fov 20"};
    static char text[20000];
    for (int n = 0; n < 6; ++n) {
        char options[300];
        double low[2] = {1e9, 1e9}, high[2] = {-1e9, -1e9}, ends[2] = {1e9, -1e9};
        snprintf(options, sizeof options, "map " VOLUME "%s --out a.dds --constants a.json", given[n]);
        const complaint made = {options, 0, NULL};
        check_complaints(&made, 1);
        CHECK(read_file("a.json", text, sizeof text) > 500);
        for (int corner = 0; corner < 8; ++corner) {
            double p[4];
            for (int row = 0; row < 4; ++row) {
                static const char *const names[4] = {"x", "y", "distance", "w"};
                char path[60];
                p[row] = 0;
                for (int k = 0; k < 4; ++k) {
                    snprintf(path, sizeof path, ".faces[0].row_%s[%d]", names[row], k);
                    p[row] += json_at(text, path) * (k == 3 ? 1 : corner >> k & 1 ? 1.5 : -1.5); /* voxels of 0.25 */
                }
            }
            for (int k = 0; k < 2; ++k) low[k] = fmin(low[k], p[k] / p[3]), high[k] = fmax(high[k], p[k] / p[3]);
            ends[0] = fmin(ends[0], p[2]), ends[1] = fmax(ends[1], p[2]);
        }
        const double slack = n == 1 ? 16 : 1024, span = ends[1] - ends[0];
        const double edge = fmin(fmin(low[0], low[1]), 8 - fmax(high[0], high[1]));
        CHECK_NEAR(json_at(text, ".faces[0].near_depth"), ends[0] - span / slack, 1e-5);
        CHECK_NEAR(json_at(text, ".faces[0].far_depth"), ends[1] + span / slack, 1e-5);
        if (n < 3) CHECK_NEAR(edge, 0.5, 1e-4);
        CHECK((int)json_at(text, ".faces[0].cubic") == (n != 1)); /* the library's default is cubic */
        if (n == 3) CHECK_NEAR(0.5 * (high[0] - low[0]), 4.5 * 1.5 / 3.5 / tan(15 * EX_PI / 180), 1e-4);
        if (n == 4)
            CHECK_NEAR(sqrt(pow(json_at(text, ".faces[0].row_x[0]"), 2) + pow(json_at(text, ".faces[0].row_x[1]"), 2) +
                            pow(json_at(text, ".faces[0].row_x[2]"), 2)),
                       9 / 3.0, 1e-5);
        if (n == 5) CHECK_NEAR(0.5 * (high[0] - low[0]), 4.5 * 1.5 / 3.5 / tan(10 * EX_PI / 180), 1e-4);
    }
}

/* --------------------------------------------------------------------------------------------------- cloud shadows */

/* Red, green and blue of the middle of a map of floats or halves. */
static void find_center(const char *name, double out[4]) {
    const dds_file file = read_dds(name);
    const size_t place = 4 * ((size_t)file.height / 2 * file.width + file.width / 2);
    for (size_t i = 0; i < 4; ++i) out[i] = file.channels == 4 ? number_at(&file, place + i) : -1;
}

/* Two balls of 150 m of 762 m, of optical depth 2 each, in centimetres: along the axis, a total depth of 4 over 300 m
   is 0.01333 per metre, where the mean over the span is 0.00525. The view begins 762 / 1024 m before the first. Floats:
   chords are off by 1e-6. Halves: 2^-11. Compressed: 1e-5 of transmittance is 5.5e-4 of a depth of 4; lengths likewise.
 */
static void test_unreal(void) {
    static const struct {
        const char *options;
        double error;
    } cases[] = {
        {"--texels float", 2e-6}, {"", 1.0 / 2048}, {"--texels float --shadow compressed --map-epsilon 1e-5", 3e-4}};
    for (int i = 0; i < 3; ++i) {
        char options[300];
        double found[4];
        snprintf(options, sizeof options, "cloud-shadow --particles two.f32 " SPHERES "%s --out a.dds",
                 cases[i].options);
        const complaint made = {options, 0, NULL};
        check_complaints(&made, 1);
        find_center("a.dds", found);
        if (figures()) printf("unreal: %.6g km, %.6g / m, %.6g\n", found[0], found[1], found[2]);
        CHECK_NEAR(found[0], 0.762 / 1024, 1e-6);
        CHECK_NEAR(found[1], 4.0 / 300, cases[i].error * 4 / 300);
        CHECK_NEAR(found[2], 4, cases[i].error * 4);
        CHECK(found[3] == 0);
        const dds_file file = read_dds("a.dds"); /* a corner without gas: the far end, no depth */
        CHECK_NEAR(number_at(&file, 0), 0.762 * (1 + 2.0 / 1024), 1e-3 * 0.762);
        CHECK(number_at(&file, 1) == 0 && number_at(&file, 2) == 0);
    }
}

/* The same of two slabs of voxels. Kernels reach two voxels beyond each face, and intervals end where sheets do, up to
   a voxel later: the mean is that of 300 m and at most ten voxels more. The optical depth of a constant grid is
   constant to 0.24 %. */
static void test_slabs(void) {
    static const complaint made = {
        "cloud-shadow --volume full.raw --size 4,4,32 --box -50000,-50000,-38100,50000,50000,-23100 "
        "--extinction 0.000133333333 --volume full.raw --size 4,4,32 --box -50000,-50000,23100,50000,50000,38100 "
        "--extinction 0.000133333333 " SPHERES "--texels float --out a.dds --constants a.json",
        0, NULL};
    const double voxel = 150 / 32.0, whole = 762 + 4 * voxel;
    static char text[20000];
    double found[4];
    check_complaints(&made, 1);
    find_center("a.dds", found);
    if (figures()) printf("slabs: %.6g km, %.6g / m, %.6g\n", found[0], found[1], found[2]);
    CHECK(found[0] >= 0.001 * whole / 1024 - 1e-6 && found[0] <= 0.001 * (whole / 1024 + 2 * voxel));
    CHECK(found[1] >= 0.9976 * 4 / (300 + 10 * voxel) && found[1] <= 1.0024 * 4 / 300);
    CHECK_NEAR(found[2], 4, 0.0024 * 4);
    CHECK(read_file("a.json", text, sizeof text) > 500 && json_says(text, ".content", "beer"));
    CHECK(json_at(text, ".distance_unit") == 1e5 && json_at(text, ".extinction_unit") == 100);
    CHECK(json_says(text, ".format", "float") && json_at(text, ".export.components") == 3);
}

/* Tiles are cut out of one map, whatever their borders hold: 2 x 3 tiles of 9 texels, and a map of 27, whose texels
   are as large. Views are rounded differently: 1e-12 of the scene, which moves depths by less than floats do. */
static void test_tiles(void) {
    static const complaint made[] = {
        {"cloud-shadow " SCENE SUN "--tiles 2,3 --border 2 --texels float --out t%02d.dds --constants t%02d.json", 0,
         NULL},
        {"cloud-shadow " SCENE SUN "--tiles 2,3 --border 2 --convention library --shadow opacity --texels float "
         "--out l%d.dds",
         0, NULL}};
    static float all[2][6][12 * 169];
    double worst[2] = {0, 0}, largest[2] = {0, 0};
    CHECK_COMPLAINTS(made);
    for (int n = 0; n < 12; ++n) {
        char name[40];
        snprintf(name, sizeof name, n < 6 ? "t%02d.dds" : "l%d.dds", n % 6);
        const dds_file file = read_dds(name);
        CHECK(file.width == 13 && file.height == 13 && file.count == 4 * 169u * file.array);
        for (size_t i = 0; i < file.count && i < 12 * 169; ++i) all[n / 6][n % 6][i] = (float)number_at(&file, i);
    }
    /* The border, and two texels within it, are the neighbour's. */
    for (int n = 0; n < 2 * 6 * 169 * 4; ++n) {
        const int kind = n / (6 * 169 * 4), c = n % 4, x = n / 4 % 13, y = n / 52 % 13, tile = n / 676 % 6;
        for (int side = 0; side < 2; ++side) {
            const int next = tile + (side ? 2 : 1), u = side ? x : x - 9, v = side ? y - 9 : y;
            if ((side == 0 && tile % 2 == 1) || next > 5 || u < 0 || v < 0) continue;
            const double here = (double)all[kind][tile][4 * (13 * y + x) + c];
            const double there = (double)all[kind][next][4 * (13 * v + u) + c];
            worst[kind] = fmax(worst[kind], fabs(here - there)), largest[kind] = fmax(largest[kind], fabs(here));
        }
    }
    if (figures()) printf("seams: %.2g of %.2g, %.2g of %.2g\n", worst[0], largest[0], worst[1], largest[1]);
    for (int kind = 0; kind < 2; ++kind) CHECK(worst[kind] <= 1e-5 * largest[kind] && largest[kind] > 1);
}

/* One map holds what its tiles hold. */
static void test_one_map(void) {
    static const complaint made[] = {
        {"cloud-shadow " SCENE "--light directional,0.3,-1,0.2,1,1,1 --map-resolution 18 --texels float --out a.dds", 0,
         NULL},
        {"cloud-shadow " SCENE SUN "--tiles 2,2 --texels float --out a%d.dds", 0, NULL}};
    static float whole[4 * 18 * 18];
    double worst = 0, largest = 0;
    CHECK_COMPLAINTS(made);
    const dds_file one = read_dds("a.dds");
    if (!CHECK(one.count == 4 * 18 * 18)) return;
    for (size_t i = 0; i < one.count; ++i) whole[i] = (float)number_at(&one, i);
    for (int tile = 0; tile < 4; ++tile) {
        char name[40];
        snprintf(name, sizeof name, "a%d.dds", tile);
        const dds_file file = read_dds(name);
        CHECK(file.count == 4 * 81);
        for (int i = 0; i < 4 * 81; ++i) {
            const int x = i / 4 % 9 + tile % 2 * 9, y = i / 36 + tile / 2 * 9;
            const double exact = (double)whole[4 * (18 * y + x) + i % 4];
            worst = fmax(worst, fabs(number_at(&file, (size_t)i) - exact)), largest = fmax(largest, fabs(exact));
        }
    }
    if (figures()) printf("one map: %.2g of %.2g\n", worst, largest);
    CHECK(worst <= 1e-5 * largest && largest > 1);
}

/* ----------------------------------------------------------------------------------------------- files and remarks */

/* Bytes are the same for any number of threads; other files hold what the .dds file holds. */
static void test_files(void) {
    static const complaint made[] = {{MAP "--threads 1 --out a.dds --constants a.json", 0, NULL},
                                     {MAP "--threads 3 --out b.dds --constants b.json", 0, NULL},
                                     {MAP "--layout atlas --texels unorm8 --out c.dds", 0, NULL},
                                     {MAP "--layout atlas --out c.png", 0, NULL},
                                     {MAP "--layout atlas --out c.exr --exr-compression none", 0, NULL},
                                     {CLOUD "--out d.exr", 0, NULL}};
    static char other[MOST];
    const char *magick = find_magick();
    char command[300];
    CHECK_COMPLAINTS(made);
    CHECK(read_dds("a.dds").dxgi == 10 && data_size == 148 + 8 * 81 * 2);
    CHECK(read_file("b.dds", other, sizeof other) == (int)data_size && memcmp(data, other, data_size) == 0);
    const int length = read_file("a.json", data, sizeof data);
    CHECK(length > 500 && read_file("b.json", other, sizeof other) == length && strcmp(data, other) == 0);
    CHECK(read_file("c.exr", other, sizeof other) > 81 * 8 * 2 && memcmp(other, "\x76\x2f\x31\x01", 4) == 0);
    CHECK(read_file("d.exr", other, sizeof other) > 300);
    snprintf(command, sizeof command, "cd %s && python3 -m json.tool a.json >/dev/null 2>&1", folder);
    if (system("python3 -c 'import json.tool' >/dev/null 2>&1") == 0)
        CHECK(system(command) == 0);
    else
        printf("skipped: JSON by Python: install python3\n");
    snprintf(command, sizeof command, "cd %s && %s c.png -depth 8 rgba:c.bytes", folder, magick ? magick : "");
    if (!magick) return;
    CHECK(system(command) == 0 && read_dds("c.dds").count == 4 * 81 * 2);
    CHECK(read_file("c.bytes", other, sizeof other) == 4 * 81 * 2 && memcmp(other, data + 148, 4 * 81 * 2) == 0);
}

/* What a texture cannot hold is said, and does not fail. */
static void test_remarks(void) {
    static const struct {
        const char *options, *words;
    } said[] = {{MAP "--extinction 90 --shadow opacity --texels unorm8 --out a.dds", "bake: a.dds: "},
                {MAP "--extinction 90 --shadow opacity --texels unorm8 --out a.dds", " numbers exceed the format"},
                {"map " SCENE SUN "--out a.dds", "bake: opaque polygons are not in this texture: --surfaces FILE.dds"}};
    static const complaint quiet[] = {{MAP "--extinction 90 --shadow opacity --out a.dds", 0, NULL},
                                      {"map " SCENE SUN "--out a.dds --surfaces s.dds", 0, NULL},
                                      {"map " SCENE SUN "--surfaces s.dds --constants a.json", 0, NULL},
                                      {"cloud-shadow " SCENE SUN "--out a.dds", 0, NULL}};
    static char text[20000];
    for (size_t i = 0; i < sizeof said / sizeof *said; ++i) {
        const outcome got = run_render(said[i].options);
        CHECK(got.status == 0 && strstr(got.said, said[i].words));
    }
    CHECK_COMPLAINTS(quiet);
    CHECK(read_dds("s.dds").dxgi == 54); /* of polygons alone: the default, halves */
    const dds_file surfaces = read_dds("s.dds");
    CHECK(number_at(&surfaces, 0) >= 65504);
    CHECK(read_file("a.json", text, sizeof text) > 500);
    CHECK(json_at(text, ".faces[0].technique") == SPS_TMAP_DEPTH && json_says(text, ".content", "surfaces"));
}

static void test_full_disk(void) {
    static const complaint full[] = {
        {MAP "--out full.dds", 2, "full.dds: writing failed: No space"},
        {MAP "--layout atlas --out full.png", 2, "full.png: writing failed: No space"},
        {MAP "--layout atlas --out full.exr", 2, "full.exr: writing failed: No space"},
        {MAP "--out a.dds --constants full.json", 2, "full.json: writing failed: No space"},
        {"map " SCENE SUN "--out a.dds --surfaces full.dds", 2, "full.dds: writing failed"},
        {"map --help >/dev/full", 2, "standard output: "}};
    char command[200];
    if (access("/dev/full", W_OK) != 0) return;
    snprintf(command, sizeof command, "cd %s && for e in dds png exr json; do ln -s /dev/full full.$e; done", folder);
    CHECK(system(command) == 0);
    CHECK_COMPLAINTS(full);
}

/* Help lists what there is and no more. */
static void test_help(void) {
    static char text[40000];
    static const complaint helps[] = {{"map --help >help.txt", 0, NULL}, {"cloud-shadow --help >cloud.txt", 0, NULL}};
    CHECK_COMPLAINTS(helps);
    CHECK(read_file("help.txt", text, sizeof text) > 3000 && strstr(text, "usage: bake map [options]\n"));
    CHECK(strstr(text, "--depths NEAR,FAR") && strstr(text, "--volume FILE") && strstr(text, "--light ") != NULL);
    CHECK(!strstr(text, "--convention") && !strstr(text, "--plan") && !strstr(text, "--out-a"));
    CHECK(read_file("cloud.txt", text, sizeof text) > 3000 && strstr(text, "--convention unreal|library"));
    CHECK(!strstr(text, "--camera") && !strstr(text, "--surfaces FILE"));
    for (char *line = strtok(text, "\n"); line; line = strtok(NULL, "\n")) CHECK(strlen(line) <= 120);
}

/* ---------------------------------------------------------------------------------------------------- bake impostor */

#define CARDS "impostor --particles ball.f32 --light directional,-1,0,-1,1,1,1 --tile 9 "
#define PAIR  "--out-a a.dds --out-b b.dds "

static void test_wrong_impostors(void) {
    static const complaint wrong[] = {
        {CARDS "--out-b b.dds", 2, "an impostor has two textures: give --out-a"},
        {CARDS "--out-a a.dds", 2, "an impostor has two textures: give --out-b"},
        {CARDS "--out-a a.dds --out-b b.tif", 2, "--out-b b.tif: the name must end in .png, .exr or .dds"},
        {CARDS "--out-a a.dds --out-b a.dds", 2, "--out-a and --out-b are the same file: a.dds"},
        {CARDS "--out-a a.dds --out-b b.png --texels half", 2, "--out-b b.png holds no --texels half"},
        {CARDS PAIR "--texels unorm16", 2, "--texels unorm16 is for maps, not for bake impostor"},
        {CARDS PAIR "--exr-compression none", 2, "--exr-compression says nothing without an .exr file"},
        {CARDS PAIR "--shadow samples", 2, "--shadow samples says nothing about bake impostor"},
        {CARDS "--out-a missing/a.dds --out-b b.dds", 2, "missing/a.dds: cannot be written"},
        {"impostor --volume v.dds --size 2,2,2 --out-a v.dds --out-b b.dds", 2,
         "--out-a v.dds is a file that --volume"},
        {"impostor " PAIR, 2, "nothing to bake: give --volume, --particles or --mesh"},
        {"impostor --particles none.f32 " PAIR, 2, "nothing to bake: the scene is empty"},
        {CARDS "--out-a full.dds --out-b b.dds", 2, "full.dds: writing failed: No space"},
        {CARDS "--out-a a.dds --out-b full.dds", 2, "full.dds: writing failed: No space"}};
    static const char *const given[] = {"--background 1,1,1",  "--fov 9",        "--width 4",    "--reference",
                                        "--out x.png",         "--stats x.json", "--part 1/2",   "--plan",
                                        "--layout unity",      "--tiles 2,2",    "--frames 1,2", "--out-c c.dds",
                                        "--convention unreal", "--border 1",     "--depths 1,2", "--surfaces s.dds",
                                        "--constants c.json"};
    CHECK_COMPLAINTS(wrong);
    for (size_t i = 0; i < sizeof given / sizeof *given; ++i) {
        char options[300], words[100];
        snprintf(options, sizeof options, CARDS PAIR "%s", given[i]);
        snprintf(words, sizeof words, "%.*s says nothing about bake impostor: ", (int)strcspn(given[i], " "), given[i]);
        const complaint one = {options, 2, words};
        check_complaints(&one, 1);
    }
}

/* The picture has render's bits. Depths run through the box along the view: a dense ball of radius 1 begins there at 0
   in the middle; its camera is 6 in front of its middle. */
static void test_impostor(void) {
    static const complaint made[] = {
        {CARDS PAIR "--texels float --alpha premultiplied --scale 2", 0, NULL},
        {CARDS "--texels unorm8 --alpha premultiplied --out-a c.dds --out-b d.dds", 0, NULL},
        {CARDS "--texels half --out-a c.exr --out-b d.dds", 0, NULL}};
    static const complaint lit = {
        "--particles ball.f32 --light directional,-1,0,-1,1,1,1 --width 9 --height 9 --camera "
        "0,0,6,0,0,0 --ortho 2 --shadow table --pfm x.pfm",
        0, NULL};
    static char pfm[2000];
    static double a[324];
    int wrong = 0;
    check_complaints(made, 1);
    dds_file file = read_alpha("a.dds", 2);
    if (!CHECK(file.count == 324 && file.dxgi == 2)) return;
    for (size_t i = 0; i < 324; ++i) a[i] = number_at(&file, i);
    tested = "render";
    check_complaints(&lit, 1);
    tested = "bake";
    CHECK(read_file("x.pfm", pfm, sizeof pfm) == 12 + 972);
    for (int i = 0; i < 81; ++i)
        for (int c = 0; c < 3; ++c) { /* PFM has the bottom row first */
            float value;
            memcpy(&value, pfm + 12 + 12 * ((8 - i / 9) * 9 + i % 9) + 4 * c, 4);
            wrong += (double)(2 * value) != a[4 * i + c];
        }
    CHECK(wrong == 0 && a[4 * 32] > 0.01 && a[3] == 0);
    file = read_dds("b.dds");
    if (!CHECK(file.count == 324 && file.dxgi == 2)) return;
    CHECK_NEAR(number_at(&file, 4 * 40 + 3), 0.5 / 20, 1e-3); /* the mean depth of light, 1 / 20, of 2 */
    CHECK(number_at(&file, 3) == 1 && number_at(&file, 2) == 1);
    CHECK_NEAR(number_at(&file, 4 * 42), 2 * 2 / 9.0, 2e-4); /* x of the surface, and so of the normal */
    CHECK_NEAR(number_at(&file, 4 * 22 + 1), 2 * 2 / 9.0, 2e-4);
    const double normal = number_at(&file, 4 * 42), depth = number_at(&file, 4 * 42 + 3);
    check_complaints(made + 1, 2);
    file = read_alpha("c.dds", 2);
    CHECK(file.dxgi == 29 && file.count == 324); /* sRGB */
    read_dds("d.dds");
    CHECK(word_at(128) == 10); /* of the third command */
    check_complaints(made + 1, 1);
    file = read_dds("d.dds");
    CHECK_NEAR(number_at(&file, 4 * 42), 0.5 + 0.5 * normal, 0.5001 / 255);
    CHECK_NEAR(number_at(&file, 4 * 42 + 3), depth, 0.5001 / 255);
    CHECK(file.dxgi == 28);
}

/* The sky lights a card, but does not stand behind it. */
static void test_impostor_under_sky(void) {
    static const complaint made = {
        "impostor --particles ball.f32 --sky white.ppm --tile 9 --texels float --alpha premultiplied " PAIR, 0, NULL};
    check_complaints(&made, 1);
    const dds_file file = read_alpha("a.dds", 2);
    if (!CHECK(file.count == 324 && file.dxgi == 2)) return;
    CHECK(number_at(&file, 0) == 0 && number_at(&file, 3) == 0);
    CHECK(number_at(&file, 4 * 36) > 0.1 && number_at(&file, 4 * 36 + 3) > 0.9); /* at its left edge */
}

static void write_inputs(void) {
    static const float balls[3][5] = {{0, 0, 0, 0.5f, 1}, {0.9f, 0.3f, 0.2f, 0.25f, 2}, {-0.5f, 0.6f, -0.4f, 0.3f, 1}};
    static const float two[2][5] = {{0, 0, -30600, 7500, 2}, {0, 0, 30600, 7500, 2}};
    static const char polygons[] = "v -1 -1.2 -1\nv 1 -1.2 -1\nv 1 -1.2 1\nv -1 -1.2 1\nf 1 2 3 4\n"
                                   "v 0 0.9 0\nv 0.5 0.9 0\nv 0 0.9 0.5\nf 5 6 7\n";
    static const float not_a_number = NAN, ball[5] = {0, 0, 0, 1, 40};
    static unsigned char full[512];
    unsigned char cloud[512];
    memset(full, 255, sizeof full);
    for (int i = 0; i < 512; ++i) cloud[i] = (unsigned char)(100 + i * 37 % 151);
    write_file("c.raw", cloud, sizeof cloud), write_file("full.raw", full, sizeof full);
    write_file("balls.f32", balls, sizeof balls), write_file("two.f32", two, sizeof two);
    write_file("ball.f32", ball, sizeof ball);
    write_file("none.f32", "", 0), write_file("q.obj", polygons, sizeof polygons - 1);
    write_file("white.ppm", "P6 1 1 255\n\377\377\377", 14);
    write_file("v.dds", cloud, 8), write_file("nan.raw", &not_a_number, 4);
}

static void test_command_line(void) {
    if (!render_is_built()) {
        printf("skipped: the command line: run this in the top folder, after make build/tests/bake\n");
        return;
    }
    write_inputs();
    RUN(test_wrong_options);
    RUN(test_refused_options);
    RUN(test_same_as_export);
    RUN(test_cube);
    RUN(test_fitted);
    RUN(test_unreal);
    RUN(test_slabs);
    RUN(test_tiles);
    RUN(test_one_map);
    RUN(test_files);
    RUN(test_remarks);
    RUN(test_full_disk);
    RUN(test_help);
    RUN(test_wrong_impostors);
    RUN(test_impostor);
    RUN(test_impostor_under_sky);
}

int main(void) {
    tested = "bake";
    if (!CHECK(folder_begin())) return check_report();
    RUN(test_sun);
    RUN(test_sun_given);
    RUN(test_point);
    RUN(test_amid);
    RUN(test_textures);
    RUN(test_exr);
    RUN(test_png);
    RUN(test_constants);
    RUN(test_ball_normals);
    RUN(test_ramp_normals);
    RUN(test_hidden_normals);
    RUN(test_impostor_numbers);
    if (!check_memory_only()) test_command_line(); /* which is no program with sanitizers */
    folder_end();
    return check_report();
}
