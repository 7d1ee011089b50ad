/* render_options.h: the options of render.c and bake.c: a table of all, what they set, files of options (looks), and
   checks. */

#ifndef EX_RENDER_OPTIONS_H
#define EX_RENDER_OPTIONS_H

#include "arguments.h"
#include "color_volume.h"
#include "mesh.h"
#include "nvdb.h"
#include "particles.h"
#include "sky.h"
#include "slide.h"
#include "transfer.h"
#include "vdb.h"
#include "volume_file.h"

/* The library accepts no more; and conversions to float stay finite. */
#define LARGEST  1e18 /* extinctions and colors */
#define FARTHEST EX_COORDINATE_MAX

/* ============================================================================================== arguments */

/* One bit per row of the table of options. */
typedef struct option_set {
    uint64_t words[2];
} option_set;

typedef struct phase_lobes {
    sps_lobe list[2];
    int count;
} phase_lobes;

/* Structs whose fields options set begin with `given`: which options were given for them. */
typedef struct volume_arguments {
    option_set given;
    const char *file, *transfer_file, *grid_name, *albedo_file, *emission_file;
    int size[3], type, shading, classify, fog;
    int crop[6];
    double range[2], box[6], extinction, albedo[3], emission[3], ambient[3];
    double temperature[2]; /* in kelvin at value 1, and luminance per world unit there */
    phase_lobes lobes;
    ex_voxel_file voxels; /* from the file's header, overridden by options */
    char space[64];       /* what the header says its coordinates are: ex_volume_file.space */
    sps_placement placement;
    ex_grid grid;
    ex_color_grid albedos, emissions; /* empty without such files */
    ex_sparse sparse;                 /* instead of the grid, where the file is .vdb or .nvdb: its size is then not 0 */
    ex_transfer points;
    sps_transfer transfer;
} volume_arguments;

typedef struct particles_arguments {
    option_set given;
    const char *file;
    int soft, is_extinction;
    int has_albedos;
    double albedo[3], emission[3], ambient[3];
    phase_lobes lobes;
    ex_particles particles;
} particles_arguments;

typedef struct mesh_arguments {
    option_set given;
    const char *file;
    double color[3], transmittance[3];
    ex_mesh mesh;
} mesh_arguments;

/* The extent of a point light: the radius of a disc, or the edges of a rectangle. */
typedef struct light_size {
    double lengths[2];
    int count; /* 1: a disc, 2: a rectangle */
} light_size;

typedef struct light_arguments {
    option_set given;
    const char *text; /* the value of --light */
    sps_light_kind kind;
    double place[3], color[3]; /* the position of a point light, the direction of a directional one */
    double axis[3], cone[2];   /* of a spotlight: its direction; inner and outer angle from it, in degrees */
    const char *image;         /* of a projector, which has an axis too: the file; otherwise NULL */
    double image_angle;        /* that the image's height subtends, in degrees */
    light_size size;
    double angle, focus; /* degrees; distance */
    int samples, falloff;
    ex_slide slide;
    sps_projector projector;
} light_arguments;

/* One option with its value. */
typedef struct setting {
    const struct option_rule *rule;
    const char *value; /* NULL if it takes none */
    const char *look;  /* the look that it comes from; NULL: the command line */
    int line;          /* in the look */
} setting;

typedef enum program { RENDER, BAKE } program;
static const char *const program_names[] = {"render", "bake"};

/* All options, in order. */
typedef struct settings {
    program program; /* which options there are */
    setting *list;
    size_t count, capacity;
    char **texts; /* memory that values point into */
    size_t text_count, text_capacity;
} settings;

/* What bake.c makes of a scene. */
typedef struct bake_arguments {
    int layout, tile, tiles[2], frames[2], alpha, texels, border, convention, probes[3];
    double scale, depths[2], metres_per_unit;
    const char *out[3], *surfaces, *constants;
} bake_arguments;

/* Lines that say what --part rendered. */
typedef struct picture_text {
    char *text;
    size_t length, capacity;
} picture_text;

/* No list can be longer than the list of settings, so all have its length. The first volume, set of particles, mesh and
   light exist before --volume and so on, for options that come before it. */
typedef struct arguments {
    option_set given;
    const settings *settings;
    volume_arguments *volumes;
    particles_arguments *particles;
    mesh_arguments *meshes;
    light_arguments *lights;
    int volume_count, particle_set_count, mesh_count, light_count;
    double camera[6], up[3], fov, ortho, ambient[3], background[3], slab;
    int width, height, region[4], part[2], coverage, shadow_resolution, quality, no_shadows, reference, samples,
        scattering, scattering_resolution, filling, threads, replace_invalid, plan, list_grids, help;
    int shadow, map_size, table_size;
    double map_epsilon, scattering_tolerance, tolerance, budget_seconds, budget_error, budget_scale_min, max_bytes;
    sps_tmap_settings map; /* of all lights that cast shadows by maps; options set its fields */
    int exr_type, exr_compression;
    const char *out, *pfm, *alpha_pfm, *exr, *radiance_hdr, *stats, *sky_file;
    double sky_turn, sky_scale;
    int sky_samples;
    ex_sky sky;
    picture_text described;
    bake_arguments bake;
} arguments;

/* Whose field an option sets. Options of FLIPBOOK set fields of the arguments too, but only bake.c has them. */
typedef enum option_owner { SCENE = 0, VOLUME, PARTICLES, MESH, LIGHT, FLIPBOOK } option_owner;

typedef struct option_rule {
    const char *name, *form, *help; /* form NULL: it takes no value */
    int (*apply)(const struct option_rule *rule, arguments *all, void *place, const char *value, ex_error *error);
    option_owner owner;
    size_t offset;            /* of the field in its owner */
    int count;                /* of numbers */
    double lo, hi;            /* each number's range */
    const char *const *names; /* of a choice; names before number `lo` are not for users */
} option_rule;

static const char *const shading_names[] = {"gas", "surface", NULL};
static const char *const classify_names[] = {"samples", "voxels", NULL};
/* sps_filling */
static const char *const filling_names[] = {"auto", "splat", "gather", NULL};
/* sps_scattering */
static const char *const scattering_names[] = {"auto", "single", "ambient", "forward", "convolution", "multiple", NULL};
/* sps_tmap_technique, after sheets; and what is not one. */
static const char *const shadow_names[] = {"sheets",  "deep",   "compressed", "opacity", "deep-opacity",
                                           "fourier", "moment", "beer",       "table",   "auto",
                                           "samples", "none",   NULL};
static const char *const exr_type_names[] = {"half", "float", NULL};
static const char *const exr_compression_names[] = {"zip", "none", NULL};
/* Cards of six-way lightmaps; then those of maps, in the order of sps_export_layout. */
static const char *const layout_names[] = {"unity", "o3de-tlrb", "o3de-rlt", "o3de-lrt", "godot",
                                           "array", "slices",    "atlas",    "cube",     NULL};
enum { FIRST_MAP_LAYOUT = 5 };
static const char *const convention_names[] = {"unreal", "library", NULL};
static const char *const alpha_names[] = {"straight", "premultiplied", NULL};
static const char *const texel_names[] = {"unorm8", "half", "float", "unorm16", NULL};
static const char *const falloff_names[] = {"inverse-square", "none", NULL}; /* in the order of sps_falloff */

/* ================================================================================================ handlers */

/* Every handler sets its field, or fills `error` and returns 1. */

static int malformed(const option_rule *rule, const char *value, ex_error *error) {
    return ex_fail(error, "%s: '%s' is not %s", rule->name, ex_quoted(value).text, rule->form);
}

static int unfit(const option_rule *rule, const char *value, const char *why, ex_error *error) {
    return ex_fail(error, "%s: '%s' will not do: %s", rule->name, ex_quoted(value).text, why);
}

static int outside(const option_rule *rule, const char *value, const char *what, double lo, double hi,
                   ex_error *error) {
    return ex_fail(error, "%s: '%s' is out of range: %s must be within %g..%g", rule->name, ex_quoted(value).text, what,
                   lo, hi);
}

/* Parses up to `most` decimal numbers with commas between them. Returns their number, or -1 if there are more or
   anything else is in the text. A number too large for a double becomes infinity, which is in no range. */
static int read_numbers(const char *text, int most, double *out) {
    int count = 0;
    if (text[strspn(text, "+-.,0123456789eE")] != '\0') return -1;
    for (;;) {
        char *end;
        if (count == most) return -1;
        out[count] = strtod(text, &end);
        if (end == text) return -1;
        ++count;
        if (*end == '\0') return count;
        if (*end != ',') return -1;
        text = end + 1;
    }
}

static int within(const double *numbers, int count, double lo, double hi) {
    for (int i = 0; i < count; ++i)
        if (!(numbers[i] >= lo && numbers[i] <= hi)) return 0;
    return 1;
}

static int set_reals(const option_rule *rule, arguments *all, void *place, const char *value, ex_error *error) {
    double numbers[8];
    (void)all;
    if (read_numbers(value, rule->count, numbers) != rule->count) return malformed(rule, value, error);
    if (!within(numbers, rule->count, rule->lo, rule->hi))
        return outside(rule, value, rule->form, rule->lo, rule->hi, error);
    memcpy(place, numbers, (size_t)rule->count * sizeof *numbers);
    return 0;
}

static int set_integers(const option_rule *rule, arguments *all, void *place, const char *value, ex_error *error) {
    double numbers[8];
    int *out = (int *)place;
    (void)all;
    if (value[strspn(value, "+-,0123456789")] != '\0' || read_numbers(value, rule->count, numbers) != rule->count)
        return malformed(rule, value, error);
    if (!within(numbers, rule->count, rule->lo, rule->hi))
        return outside(rule, value, rule->form, rule->lo, rule->hi, error);
    for (int i = 0; i < rule->count; ++i) out[i] = (int)numbers[i];
    return 0;
}

/* I/N. */
static int set_part(const option_rule *rule, arguments *all, void *place, const char *value, ex_error *error) {
    int *part = (int *)place, end = 0;
    long number, count;
    (void)all;
    if (!*value || value[strspn(value, "0123456789/")] != '\0' || strlen(value) > 16 ||
        sscanf(value, "%ld/%ld%n", &number, &count, &end) != 2 || value[end] != '\0')
        return malformed(rule, value, error);
    if (number < 1 || number > count) return unfit(rule, value, "parts are numbered from 1 to N", error);
    if (count > (long)rule->hi) return outside(rule, value, "N", rule->lo, rule->hi, error);
    part[0] = (int)number, part[1] = (int)count;
    return 0;
}

static int set_text(const option_rule *rule, arguments *all, void *place, const char *value, ex_error *error) {
    (void)all;
    if (*value == '\0') return malformed(rule, value, error);
    *(const char **)place = value;
    return 0;
}

static int set_flag(const option_rule *rule, arguments *all, void *place, const char *value, ex_error *error) {
    (void)rule, (void)all, (void)value, (void)error;
    *(int *)place = 1;
    return 0;
}

static int set_choice(const option_rule *rule, arguments *all, void *place, const char *value, ex_error *error) {
    const int choice = ex_find_name(rule->names, value);
    (void)all;
    if (choice < rule->lo) return malformed(rule, value, error);
    *(int *)place = choice;
    return 0;
}

static int set_camera(const option_rule *rule, arguments *all, void *place, const char *value, ex_error *error) {
    const double *camera = (const double *)place;
    if (set_reals(rule, all, place, value, error)) return 1;
    if (camera[0] == camera[3] && camera[1] == camera[4] && camera[2] == camera[5])
        return unfit(rule, value, "position and target are the same point", error);
    return 0;
}

static int set_range(const option_rule *rule, arguments *all, void *place, const char *value, ex_error *error) {
    const double *range = (const double *)place;
    if (set_reals(rule, all, place, value, error)) return 1;
    return range[0] == range[1] ? unfit(rule, value, "both ends are the same", error) : 0;
}

static int set_phase(const option_rule *rule, arguments *all, void *place, const char *value, ex_error *error) {
    phase_lobes *lobes = (phase_lobes *)place;
    double g[3] = {0, 0, 0};
    (void)all;
    const int count = read_numbers(value, 3, g);
    if (count != 1 && count != 3) return malformed(rule, value, error);
    if (!within(g, 2, rule->lo, rule->hi)) return outside(rule, value, "g and g2", rule->lo, rule->hi, error);
    if (!within(g + 2, 1, 0, 1)) return outside(rule, value, "w", 0, 1, error);
    const double weights[2] = {1 - g[2], g[2]};
    lobes->count = 0;
    for (int i = 0; i < 2; ++i) {
        if (weights[i] <= 0) continue; /* the library requires weights above 0 */
        lobes->list[lobes->count].asymmetry = (float)g[i];
        lobes->list[lobes->count++].weight = (float)weights[i];
    }
    return 0;
}

/* Appends a point of a transfer function. */
static int add_point(const option_rule *rule, arguments *all, void *place, const char *value, ex_error *error) {
    double numbers[8] = {0};
    float narrow[8];
    sps_transfer_point point;
    (void)all;
    const int count = read_numbers(value, 8, numbers);
    if (count != 5 && count != 8) return malformed(rule, value, error);
    if (!within(numbers, 1, 0, LARGEST) || !within(numbers + 4, 4, 0, LARGEST))
        return outside(rule, value, "value, extinction and emission", 0, LARGEST, error);
    if (!within(numbers + 1, 3, 0, 1)) return outside(rule, value, "r,g,b", 0, 1, error);
    for (int i = 0; i < 8; ++i) narrow[i] = (float)numbers[i];
    ex_transfer_set(narrow, &point);
    if (ex_transfer_add((ex_transfer *)place, &point)) return unfit(rule, value, "values must rise", error);
    return 0;
}

static int set_temperature(const option_rule *rule, arguments *all, void *place, const char *value, ex_error *error) {
    const double *temperature = (const double *)place;
    if (set_reals(rule, all, place, value, error)) return 1;
    return within(temperature, 1, 1, 1e6) ? 0 : outside(rule, value, "KELVIN", 1, 1e6, error);
}

static void default_volume(volume_arguments *volume) {
    volume->extinction = 1;
    for (int i = 0; i < 3; ++i) volume->albedo[i] = 0.8, volume->box[3 + i] = 1;
}

static void default_particles(particles_arguments *particles) {
    for (int i = 0; i < 3; ++i) particles->albedo[i] = 0.8;
}

static void default_mesh(mesh_arguments *mesh) {
    for (int i = 0; i < 3; ++i) mesh->color[i] = 0.8;
}

static int add_volume(const option_rule *rule, arguments *all, void *place, const char *value, ex_error *error) {
    volume_arguments *volume = all->volumes + all->volume_count;
    (void)place;
    if (set_text(rule, all, &volume->file, value, error)) return 1;
    if (all->volume_count++ > 0) default_volume(volume);
    return 0;
}

static int add_particles(const option_rule *rule, arguments *all, void *place, const char *value, ex_error *error) {
    particles_arguments *particles = all->particles + all->particle_set_count;
    (void)place;
    if (set_text(rule, all, &particles->file, value, error)) return 1;
    if (all->particle_set_count++ > 0) default_particles(particles);
    return 0;
}

static int add_mesh(const option_rule *rule, arguments *all, void *place, const char *value, ex_error *error) {
    mesh_arguments *mesh = all->meshes + all->mesh_count;
    (void)place;
    if (set_text(rule, all, &mesh->file, value, error)) return 1;
    if (all->mesh_count++ > 0) default_mesh(mesh);
    return 0;
}

/* Which way a spotlight or a projector points. */
static int read_axis(const option_rule *rule, const char *value, const double axis[3], light_arguments *light,
                     ex_error *error) {
    if (!within(axis, 3, rule->lo, rule->hi)) return outside(rule, value, "dx,dy,dz", rule->lo, rule->hi, error);
    if (axis[0] == 0 && axis[1] == 0 && axis[2] == 0) return unfit(rule, value, "the direction is zero", error);
    memcpy(light->axis, axis, sizeof light->axis);
    return 0;
}

/* x,y,z,dx,dy,dz,inner,outer,r,g,b: a point light with a cone. */
static int read_spot(const option_rule *rule, const char *value, const double numbers[11], light_arguments *light,
                     ex_error *error) {
    const double *cone = numbers + 6;
    if (read_axis(rule, value, numbers + 3, light, error)) return 1;
    if (!within(cone, 2, 0, 180)) return outside(rule, value, "inner,outer", 0, 180, error);
    if (!(cone[0] < cone[1])) return unfit(rule, value, "the inner angle must be less than the outer", error);
    memcpy(light->cone, cone, sizeof light->cone);
    return 0;
}

/* x,y,z,dx,dy,dz,angle,r,g,b,FILE.ppm: a point light that throws an image. */
static int read_projector(const option_rule *rule, const char *value, const double numbers[10], light_arguments *light,
                          ex_error *error) {
    if (read_axis(rule, value, numbers + 3, light, error)) return 1;
    if (!within(numbers + 6, 1, 0.001, 177)) return outside(rule, value, "angle", 0.001, 177, error);
    light->image_angle = numbers[6];
    return 0;
}

/* The file in the value of a projector, which follows its ten numbers and may contain commas. NULL if there is none. */
static const char *find_image(const char *value) {
    int commas = 0;
    if (strncmp(value, "projector,", 10) != 0) return NULL;
    while (*value && commas < 11) commas += *value++ == ',';
    return *value ? value : NULL;
}

/* Parses the numbers of a light, which end before the file of an image. Returns their number, or -1. */
static int read_light_numbers(const char *value, const char *image, int most, double *out) {
    char text[512];
    const char *start = strchr(value, ',') + 1;
    const size_t length = image ? (size_t)(image - start) - 1 : strlen(start);
    if (length >= sizeof text) return -1;
    memcpy(text, start, length);
    text[length] = '\0';
    return read_numbers(text, most, out);
}

static int add_light(const option_rule *rule, arguments *all, void *place, const char *value, ex_error *error) {
    enum { DIRECTIONAL, POINT, SPOT, PROJECTOR, FORMS };
    static const struct {
        const char *name;
        int count; /* of numbers; the last three are the color */
    } forms[FORMS] = {{"directional,", 6}, {"point,", 6}, {"spot,", 11}, {"projector,", 10}};
    double numbers[11];
    light_arguments *light = all->lights + all->light_count;
    int form = 0, count;
    (void)place;
    while (form < FORMS && strncmp(value, forms[form].name, strlen(forms[form].name)) != 0) ++form;
    if (form == FORMS) return malformed(rule, value, error);
    count = forms[form].count;
    light->image = find_image(value);
    if (form == PROJECTOR && !light->image) return malformed(rule, value, error);
    if (read_light_numbers(value, light->image, count, numbers) != count) return malformed(rule, value, error);
    if (!within(numbers, 3, rule->lo, rule->hi))
        return outside(rule, value, form == DIRECTIONAL ? "dx,dy,dz" : "x,y,z", rule->lo, rule->hi, error);
    if (!within(numbers + count - 3, 3, 0, LARGEST)) return outside(rule, value, "r,g,b", 0, LARGEST, error);
    if (form == DIRECTIONAL && numbers[0] == 0 && numbers[1] == 0 && numbers[2] == 0)
        return unfit(rule, value, "the direction is zero", error);
    if (form == SPOT && read_spot(rule, value, numbers, light, error)) return 1;
    if (form == PROJECTOR && read_projector(rule, value, numbers, light, error)) return 1;
    light->kind = form == DIRECTIONAL ? SPS_LIGHT_DIRECTIONAL : SPS_LIGHT_POINT;
    memcpy(light->place, numbers, sizeof light->place);
    memcpy(light->color, numbers + count - 3, sizeof light->color);
    light->text = value;
    all->light_count++;
    return 0;
}

static int set_light_size(const option_rule *rule, arguments *all, void *place, const char *value, ex_error *error) {
    light_size *size = (light_size *)place;
    (void)all;
    size->count = read_numbers(value, 2, size->lengths);
    if (size->count < 1) return malformed(rule, value, error);
    if (!within(size->lengths, size->count, rule->lo, rule->hi))
        return outside(rule, value, rule->form, rule->lo, rule->hi, error);
    return 0;
}

/* =============================================================================================== the table */

#define OF_SCENE(field)     SCENE, offsetof(arguments, field)
#define OF_VOLUME(field)    VOLUME, offsetof(volume_arguments, field)
#define OF_MESH(field)      MESH, offsetof(mesh_arguments, field)
#define OF_PARTICLES(field) PARTICLES, offsetof(particles_arguments, field)
#define OF_LIGHT(field)     LIGHT, offsetof(light_arguments, field)
#define OF_BAKE(field)      FLIPBOOK, offsetof(arguments, bake.field)
#define NO_NUMBERS          0, 0, 0, NULL
#define COORDINATES         -FARTHEST, FARTHEST, NULL /* ranges of numbers */
#define POSITIVE            0, LARGEST, NULL

/* clang-format off */
static const option_rule options[] = {
    {"--look", "FILE", "options from a file; repeatable", NULL, SCENE, 0, NO_NUMBERS},
    {"--volume", "FILE", "voxels; repeatable", add_volume, SCENE, 0, NO_NUMBERS},
    {"--size", "X,Y,Z", "voxels along each axis; required for a file without a header", set_integers, OF_VOLUME(size), 3, 1, 65536, NULL},
    {"--type", "u8|i8|u16|i16|u32|i32|f32|f64|u64|i64|f16", "of a voxel; default: the header's, or u8, little endian", set_choice, OF_VOLUME(type), 1, 0, 0, ex_type_names},
    {"--range", "LOW,HIGH", "numbers in the file that become the values 0 and 1; what lies beyond counts as these", set_range, OF_VOLUME(range), 2, -LARGEST, LARGEST, NULL},
    {"--box", "x0,y0,z0,x1,y1,z1", "two opposite corners in the world; default: the header's, or 0,0,0,1,1,1", set_reals, OF_VOLUME(box), 6, COORDINATES},
    {"--crop", "i0,j0,k0,i1,j1,k1", "faces between voxels that cut the volume; all 0, the default: nothing is cut", set_integers, OF_VOLUME(crop), 6, 0, 65536, NULL},
    {"--grid", "NAME", "of a .vdb or .nvdb file, default density, else the first that can be read; or of an .npz", set_text, OF_VOLUME(grid_name), NO_NUMBERS},
    {"--fog", NULL, "reads a level set of such a file: 1 inside, 0 outside, linear across its band", set_flag, OF_VOLUME(fog), NO_NUMBERS},
    {"--extinction", "S", "per world unit at value 1; default 1; not with --transfer", set_reals, OF_VOLUME(extinction), 1, POSITIVE},
    {"--albedo", "r,g,b", "default 0.8,0.8,0.8; not with --transfer", set_reals, OF_VOLUME(albedo), 3, 0, 1, NULL},
    {"--emission", "r,g,b", "radiance per world unit at value 1; default 0,0,0; for a gas, not with --transfer", set_reals, OF_VOLUME(emission), 3, POSITIVE},
    {"--albedo-volume", "FILE", "three numbers per voxel, in a file with a header, of the volume's size", set_text, OF_VOLUME(albedo_file), NO_NUMBERS},
    {"--emission-volume", "FILE", "likewise: radiance per world unit of each voxel, added to --emission", set_text, OF_VOLUME(emission_file), NO_NUMBERS},
    {"--gas-ambient", "r,g,b", "radiance from everywhere, with --scattering ambient; default 0,0,0", set_reals, OF_VOLUME(ambient), 3, POSITIVE},
    {"--phase", "g[,g2,w]", "Henyey-Greenstein lobes, g weighing 1-w and g2 weighing w; default 0, isotropic", set_phase, OF_VOLUME(lobes), 1, -0.99, 0.99, NULL},
    {"--transfer", "FILE", "lines: value r g b extinction [r g b]; values rise; the last three: emission", set_text, OF_VOLUME(transfer_file), NO_NUMBERS},
    {"--transfer-point", "value,r,g,b,extinction[,r,g,b]", "instead of --transfer, one such line; repeatable", add_point, OF_VOLUME(points), NO_NUMBERS},
    {"--classify", "voxels|samples", "voxels: --transfer applies before interpolation, as labels need; default samples", set_choice, OF_VOLUME(classify), 1, 0, 0, classify_names},
    {"--temperature", "KELVIN,INTENSITY", "a black body of values times KELVIN; INTENSITY: luminance per world unit at KELVIN", set_temperature, OF_VOLUME(temperature), 2, POSITIVE},
    {"--shading", "gas|surface", "surface: lit by the gradient, where that is strong; default gas", set_choice, OF_VOLUME(shading), 1, 0, 0, shading_names},
    {"--particles", "FILE", "little-endian 32-bit floats, x y z radius opticaldepth of each; repeatable", add_particles, SCENE, 0, NO_NUMBERS},
    {"--particle-albedo", "r,g,b", "default 0.8,0.8,0.8", set_reals, OF_PARTICLES(albedo), 3, 0, 1, NULL},
    {"--particle-emission", "r,g,b", "radiance per unit of optical depth; default 0,0,0", set_reals, OF_PARTICLES(emission), 3, POSITIVE},
    {"--particle-ambient", "r,g,b", "as --gas-ambient", set_reals, OF_PARTICLES(ambient), 3, POSITIVE},
    {"--particle-phase", "g[,g2,w]", "as --phase", set_phase, OF_PARTICLES(lobes), 1, -0.99, 0.99, NULL},
    {"--particle-albedos", NULL, "each particle has three more numbers, r g b, instead of --particle-albedo", set_flag, OF_PARTICLES(has_albedos), NO_NUMBERS},
    {"--particle-soft", NULL, "they fade to nothing at the rim; otherwise they are equally dense throughout", set_flag, OF_PARTICLES(soft), NO_NUMBERS},
    {"--particle-extinction", NULL, "the fifth number is extinction, per world unit, not optical depth along the diameter", set_flag, OF_PARTICLES(is_extinction), NO_NUMBERS},
    {"--mesh", "FILE.obj", "Wavefront OBJ, polygons; repeatable", add_mesh, SCENE, 0, NO_NUMBERS},
    {"--mesh-color", "r,g,b", "default 0.8,0.8,0.8", set_reals, OF_MESH(color), 3, 0, 1, NULL},
    {"--mesh-transmittance", "r,g,b", "share of light that passes straight through; default 0,0,0, opaque", set_reals, OF_MESH(transmittance), 3, 0, 1, NULL},
    {"--camera", "px,py,pz,tx,ty,tz", "position and target; default: all of the scene in view", set_camera, OF_SCENE(camera), 6, COORDINATES},
    {"--up", "x,y,z", "default 0,1,0", set_reals, OF_SCENE(up), 3, COORDINATES},
    {"--fov", "DEG", "perspective, vertical angle; default 40", set_reals, OF_SCENE(fov), 1, 0.001, 177, NULL},
    {"--ortho", "HEIGHT", "orthographic, world height of the image; not with --fov", set_reals, OF_SCENE(ortho), 1, 1e-15, FARTHEST, NULL},
    {"--width", "W", "pixels; default 512", set_integers, OF_SCENE(width), 1, 1, 16384, NULL},
    {"--height", "H", "pixels; default 512", set_integers, OF_SCENE(height), 1, 1, 16384, NULL},
    {"--region", "x,y,w,h", "renders only this part of the image, pixels from its top left corner", set_integers, OF_SCENE(region), 4, 0, 16384, NULL},
    {"--part", "I/N", "renders the I-th of N bands of rows, from 1, into the file --out, for build/join", set_part, OF_SCENE(part), 2, 1, 16384, NULL},
    {"--light", "directional,dx,dy,dz,r,g,b | point,x,y,z,r,g,b | spot,x,y,z,dx,dy,dz,inner,outer,r,g,b | projector,x,y,z,dx,dy,dz,angle,r,g,b,FILE.ppm", "dx,dy,dz: the way the light travels; inner, outer: degrees from it; repeatable", add_light, SCENE, 0, 6, COORDINATES},
    {"--light-size", "R | W,H", "of a point light: a disc's radius, or a rectangle's edges; not with maps (--shadow)", set_light_size, OF_LIGHT(size), 2, 0, FARTHEST, NULL},
    {"--light-angle", "DEG", "of a directional light: its angular diameter; not with maps (--shadow)", set_reals, OF_LIGHT(angle), 1, 0, 114, NULL},
    {"--light-samples", "K", "points that stand for a light with one of these; default by --quality", set_integers, OF_LIGHT(samples), 1, 1, 256, NULL},
    {"--light-focus", "D", "of a projector with --light-size: where its image is sharp; default infinitely far", set_reals, OF_LIGHT(focus), 1, 1e-15, FARTHEST, NULL},
    {"--light-falloff", "inverse-square|none", "by distance, of any but a directional light; default inverse-square", set_choice, OF_LIGHT(falloff), 1, 0, 0, falloff_names},
    {"--ambient", "r,g,b", "radiance from everywhere, unshadowed; default 0,0,0", set_reals, OF_SCENE(ambient), 3, POSITIVE},
    {"--background", "r,g,b", "radiance behind everything; default 0,0,0", set_reals, OF_SCENE(background), 3, POSITIVE},
    {"--sky", "FILE.ppm | FILE.hdr", "equirectangular picture of the sky: a light, and the background; the sun stays in it", set_text, OF_SCENE(sky_file), NO_NUMBERS},
    {"--sky-turn", "DEG", "turns it to the left; its middle is towards -z, or +y if --up is along z", set_reals, OF_SCENE(sky_turn), 1, -360, 360, NULL},
    {"--sky-scale", "S", "multiplies its radiance; default 1", set_reals, OF_SCENE(sky_scale), 1, 0, 1e9, NULL},
    {"--sky-samples", "N", "rays from a polygon's point to the sky, up to 512; default by --quality", set_integers, OF_SCENE(sky_samples), 1, 1, 512, NULL},
    {"--coverage", "N", "N x N samples of polygons' edges per pixel, up to 8; default 0: one, at its centre", set_integers, OF_SCENE(coverage), 1, 0, 8, NULL},
    {"--slab-thickness", "VOXELS", "sheet thickness, the main knob; the step of --reference; default by --quality, or 0.5", set_reals, OF_SCENE(slab), 1, 1e-6, 1e6, NULL},
    {"--shadow-resolution", "N", "texels along a shadow buffer's longer side; default by --quality", set_integers, OF_SCENE(shadow_resolution), 1, 1, 16384, NULL},
    {"--shadow", "auto|sheets|deep|compressed|opacity|deep-opacity|fourier|moment|beer|table|samples|none", "what gas shades by; auto, the default: sheets or a table; samples: as --reference", set_choice, OF_SCENE(shadow), 1, 0, 0, shadow_names},
    {"--map-components", "N", "floats a texel of that map, planes of a table; default by --shadow", set_integers, OF_SCENE(map.components), 1, 1, 1024, NULL},
    {"--map-resolution", "N", "texels along the map's longer side; default as --shadow-resolution, or by --quality", set_integers, OF_SCENE(map_size), 1, 1, 16384, NULL},
    {"--table-size", "N", "the same for tables (--shadow table, auto); default by --quality, up to 256", set_integers, OF_SCENE(table_size), 1, 1, 16384, NULL},
    {"--map-epsilon", "E", "largest error of transmittance, for compressed; default 0.01", set_reals, OF_SCENE(map_epsilon), 1, 1e-6, 0.5, NULL},
    {"--map-cubic", NULL, "monotone cubics between planes instead of straight lines, for opacity and deep-opacity", set_flag, OF_SCENE(map.cubic), NO_NUMBERS},
    {"--map-texel-range", NULL, "a range of depths for each texel, which takes two more floats, for fourier", set_flag, OF_SCENE(map.texel_range), NO_NUMBERS},
    {"--quality", "draft|medium|high|ultra", "default medium", set_choice, OF_SCENE(quality), 1, SPS_QUALITY_DRAFT, 0, ex_quality_names},
    {"--no-shadows", NULL, "light shines through everything; the same as --shadow none", set_flag, OF_SCENE(no_shadows), NO_NUMBERS},
    {"--reference", NULL, "brute-force ray marching, shadows traced from every step: slow; heeds --shadow none only", set_flag, OF_SCENE(reference), NO_NUMBERS},
    {"--samples", "N", "paths per pixel of --reference; default 0: single scattering, exactly", set_integers, OF_SCENE(samples), 1, 0, 1 << 20, NULL},
    {"--filling", "auto|splat|gather", "how voxels fill sheets; auto, the default: as costs less", set_choice, OF_SCENE(filling), 1, 0, 0, filling_names},
    {"--tolerance", "T", "optical depth by which rays through smooth gas may be off, to follow fewer; default 0", set_reals, OF_SCENE(tolerance), 1, 0, 1, NULL},
    {"--budget-seconds", "S", "as little error as S seconds buy; chooses quality, slab thickness, tolerance and cells", set_reals, OF_SCENE(budget_seconds), 1, 1e-9, 1e9, NULL},
    {"--budget-scale-min", "S", "with --budget-seconds: the smallest share of width and height that the picture may have", set_reals, OF_SCENE(budget_scale_min), 1, 1e-9, 1, NULL},
    {"--budget-error", "E", "as little time as an error of E takes, of radiance, relative to its mean", set_reals, OF_SCENE(budget_error), 1, 1e-9, 1e9, NULL},
    {"--scattering", "auto|single|ambient|forward|convolution|multiple", "light in gas; auto, the default: single in thin gas, otherwise multiple", set_choice, OF_SCENE(scattering), 1, 0, 0, scattering_names},
    {"--scattering-resolution", "N", "cells along the gas for --scattering multiple, half the texels for convolution", set_integers, OF_SCENE(scattering_resolution), 1, 1, 256, NULL},
    {"--scattering-tolerance", "T", "share of light that may be left out by --scattering auto; default 0.01", set_reals, OF_SCENE(scattering_tolerance), 1, 0, 1, NULL},
    {"--replace-invalid", NULL, "numbers that are NaN or too large count as 0; otherwise they end the render", set_flag, OF_SCENE(replace_invalid), NO_NUMBERS},
    {"--max-bytes", "N", "the most that a volume's file may take in memory, unpacked; default 4e9", set_reals, OF_SCENE(max_bytes), 1, 1, LARGEST, NULL},
    {"--threads", "N", "default one for each processor", set_integers, OF_SCENE(threads), 1, 1, 1024, NULL},
    {"--out", "FILE.png", "sRGB picture; with bake, a map as .dds, .exr or .png, or light as .dds or .npy", set_text, OF_SCENE(out), NO_NUMBERS},
    {"--pfm", "FILE.pfm", "linear radiance, three channels", set_text, OF_SCENE(pfm), NO_NUMBERS},
    {"--alpha-pfm", "FILE.pfm", "coverage, one channel", set_text, OF_SCENE(alpha_pfm), NO_NUMBERS},
    {"--exr", "FILE.exr", "OpenEXR: linear radiance, coverage as A, distance from the eye as Z", set_text, OF_SCENE(exr), NO_NUMBERS},
    {"--exr-type", "half|float", "of its R, G, B and A; Z is float; default half, where 65504 is the largest", set_choice, OF_SCENE(exr_type), 1, 0, 0, exr_type_names},
    {"--exr-compression", "zip|none", "default zip", set_choice, OF_SCENE(exr_compression), 1, 0, 0, exr_compression_names},
    {"--radiance-hdr", "FILE.hdr", "Radiance picture (RGBE): linear radiance", set_text, OF_SCENE(radiance_hdr), NO_NUMBERS},
    {"--stats", "FILE.json", "what the render did, and how long it took", set_text, OF_SCENE(stats), NO_NUMBERS},
    {"--plan", NULL, "says what would run, and why, and renders nothing; not with --reference", set_flag, OF_SCENE(plan), NO_NUMBERS},
    {"--list-grids", NULL, "says what grids the .vdb and .nvdb files have, and renders nothing", set_flag, OF_SCENE(list_grids), NO_NUMBERS},
    {"--layout", "unity|o3de-tlrb|o3de-rlt|o3de-lrt|godot | array|slices|atlas|cube", "of cards: which light goes into which channel, default unity; of maps: default array", set_choice, OF_BAKE(layout), 1, 0, 0, layout_names},
    {"--tile", "N", "pixels along each side of a frame; default 256", set_integers, OF_BAKE(tile), 1, 1, 16384, NULL},
    {"--tiles", "C,R", "columns and rows of frames, from the top left; of cloud shadows: of maps, default 1,1", set_integers, OF_BAKE(tiles), 2, 1, 4096, NULL},
    {"--frames", "A,B", "numbers of the first and the last frame, for %d or %0Nd in names of files", set_integers, OF_BAKE(frames), 2, 0, 999999999, NULL},
    {"--alpha", "straight|premultiplied", "premultiplied: radiance as it is seen; straight, the default: divided by coverage", set_choice, OF_BAKE(alpha), 1, 0, 0, alpha_names},
    {"--scale", "S", "texture's numbers per radiance, under lights of irradiance 1; default 1", set_reals, OF_BAKE(scale), 1, 1e-6, 1e6, NULL},
    {"--texels", "unorm8|half|float|unorm16", "of .dds, and .exr; unorm16 for maps; default half; .png is unorm8", set_choice, OF_BAKE(texels), 1, 0, 0, texel_names},
    {"--out-a", "FILE", "the first texture, as .png, .exr or .dds", set_text, OF_BAKE(out[0]), NO_NUMBERS},
    {"--out-b", "FILE", "the second one", set_text, OF_BAKE(out[1]), NO_NUMBERS},
    {"--out-c", "FILE", "the third one, of any layout but unity's", set_text, OF_BAKE(out[2]), NO_NUMBERS},
    {"--convention", "unreal|library", "what a cloud shadow's channels hold; default unreal", set_choice, OF_BAKE(convention), 1, 0, 0, convention_names},
    {"--metres-per-unit", "M", "of the world, for --convention unreal; default 1", set_reals, OF_BAKE(metres_per_unit), 1, 1e-9, 1e9, NULL},
    {"--border", "N", "texels beyond each edge of a map, up to 64; default 0", set_integers, OF_BAKE(border), 1, 0, 64, NULL},
    {"--depths", "NEAR,FAR", "range of a map along its axis; default: all of the scene", set_reals, OF_BAKE(depths), 2, 0, FARTHEST, NULL},
    {"--surfaces", "FILE.dds", "a second texture: where the first opaque polygons are", set_text, OF_BAKE(surfaces), NO_NUMBERS},
    {"--constants", "FILE.json", "what shaders need besides the textures", set_text, OF_BAKE(constants), NO_NUMBERS},
    {"--probes", "X,Y,Z", "of a light volume; default: 32 along the scene's longest side, in cubic cells", set_integers, OF_BAKE(probes), 3, 1, 2048, NULL},
    {"--help", NULL, "this text", set_flag, OF_SCENE(help), NO_NUMBERS},
};
/* clang-format on */

enum { OPTION_COUNT = sizeof options / sizeof options[0] };
typedef char options_fit_into_a_set[OPTION_COUNT <= 128 ? 1 : -1];

/* Printed by --help before an option. */
static const char *const headings[][2] = {
    {"--look",
     "Looks. A look is a file of options, one per line, without dashes: size 256,256,256. # starts a comment.\n"
     "  File names in it are relative to the look. Options after --look override those of the look."},
    {"--volume",
     "Volumes. Options apply to the --volume before them; those before the first --volume, to the first.\n"
     "  OpenVDB and NanoVDB files (.vdb, .nvdb) are known by their first bytes; their numbers are f32.\n"
     "  Files ending in .nrrd, .nhdr (NRRD), .mhd, .mha (MetaImage), .nii, .nii.gz, .hdr (NIfTI), .npy or .npz\n"
     "  have a header: it determines size, type, byte order, spacing and placement, unless an option below\n"
     "  does. Voxels may be packed by gzip or zlib. Coordinates are used as they are in the file. Without any\n"
     "  in the header, voxels are cubes of edge 1, the first one centered at 0,0,0. An .npy array is indexed\n"
     "  [z,y,x]. Any other file is raw: only voxels, x fastest, little endian.\n"
     "  Voxels become values as follows. u8, u16, u32 and u64: 0..1 over the whole range of the type. i8, i16,\n"
     "  i32 and i64, and integers that a header scales: 0..1 from the smallest to the largest in the file. f16,\n"
     "  f32 and f64: as they are, except that negative ones become 0. --range replaces all this; it is in\n"
     "  units after the header's scaling."},
    {"--particles", "Particles, in the same way: balls of gas."},
    {"--mesh", "Meshes, in the same way."},
    {"--camera", "View."},
    {"--light",
     "Light. Colors are linear: irradiance of a directional light, of others at distance 1. A projector throws an\n"
     "  image, angle degrees high, with its top towards --up: a binary PPM file (P6), taken as sRGB; commas may be\n"
     "  part of its name. --light-... applies to lights in the same way. A light with an extent casts penumbrae; a\n"
     "  disc or a rectangle faces the middle of the scene, but a projector's lies across its direction, like a\n"
     "  lens; W is its edge perpendicular to --up."},
    {"--slab-thickness", "Rendering."},
    {"--out", "Results. At least one is required."},
    {"--layout", "The textures."},
    {"--help", "Help."},
};

/* Prints an option and its form. A form that does not fit into 120 columns goes on in a second line. */
static void print_long_form(const char *name, const char *form) {
    const char *rest = form;
    for (const char *at = form; (at = strstr(at, " | ")) != NULL; ++at)
        if ((size_t)(at - form) + strlen(name) < 110) rest = at + 3;
    if (strlen(form) + strlen(name) < 116) rest = form;
    printf("  %s %.*s\n", name, (int)(rest > form ? (size_t)(rest - form) - 1 : strlen(form)), form);
    if (rest > form) printf("    %s\n", rest);
}

static const option_rule *find_option(const char *name) {
    for (int i = 0; i < OPTION_COUNT; ++i)
        if (strcmp(options[i].name, name) == 0) return &options[i];
    return NULL;
}

/* Whether a program has an option at all. */
static int is_option_of(program which, const option_rule *rule) { return which == BAKE || rule->owner != FLIPBOOK; }

/* Prints the usage, and all options but those that are left out; these end with NULL. */
static void print_help(program which, const char *usage, const char *const *left_out) {
    printf("usage: %s\n\n"
           "Options stand in any order. Of one that is given twice and is not repeatable, the last counts.\n"
           "Exit status: 0 done, 1 the render failed, 2 an option or a file is wrong.\n",
           usage);
    for (int i = 0; i < OPTION_COUNT; ++i) {
        char left[200];
        if (!is_option_of(which, &options[i]) || ex_find_name(left_out, options[i].name) >= 0) continue;
        for (size_t k = 0; k < sizeof headings / sizeof *headings; ++k)
            if (strcmp(headings[k][0], options[i].name) == 0) printf("\n%s\n", headings[k][1]);
        snprintf(left, sizeof left, "%s %s", options[i].name, options[i].form ? options[i].form : "");
        if (strlen(left) > 28) print_long_form(options[i].name, options[i].form), left[0] = '\0';
        printf("  %-28s %s\n", left, options[i].help);
    }
}

/* ================================================================================================= parsing */

/* Whether a set contains an option, by its row in the table or by its name. */
static int has_row(option_set given, int row) { return (int)(given.words[row / 64] >> row % 64 & 1); }
static int has(option_set given, const char *name) { return has_row(given, (int)(find_option(name) - options)); }

/* The struct whose field the option sets: the arguments, or the volume, particles, mesh or light before it, or else the
   first. */
static void *find_owner(const option_rule *rule, arguments *all) {
    if (rule->owner == SCENE || rule->owner == FLIPBOOK) return all;
    if (rule->owner == VOLUME) return all->volumes + (all->volume_count ? all->volume_count - 1 : 0);
    if (rule->owner == PARTICLES) return all->particles + (all->particle_set_count ? all->particle_set_count - 1 : 0);
    if (rule->owner == MESH) return all->meshes + (all->mesh_count ? all->mesh_count - 1 : 0);
    return all->lights + (all->light_count ? all->light_count - 1 : 0);
}

static int apply_option(const option_rule *rule, arguments *all, const char *value, ex_error *error) {
    void *owner = find_owner(rule, all);
    const int row = (int)(rule - options);
    ((option_set *)owner)->words[row / 64] |= (uint64_t)1 << row % 64;
    return rule->apply(rule, all, (char *)owner + rule->offset, value, error);
}

static void add_setting(settings *all, setting added) {
    all->list = (setting *)ex_grow(all->list, all->count, &all->capacity, sizeof *all->list);
    all->list[all->count++] = added;
}

/* Keeps a text until the settings are freed. */
static char *keep_text(settings *all, char *text) {
    all->texts = (char **)ex_grow(all->texts, all->text_count, &all->text_capacity, sizeof *all->texts);
    return all->texts[all->text_count++] = text;
}

static void free_settings(settings *all) {
    for (size_t i = 0; i < all->text_count; ++i) free(all->texts[i]);
    free(all->texts);
    free(all->list);
}

/* A comment starts with # at the beginning of a line or after a blank. Elsewhere # is part of a name. */
static void cut_comment(char *text) {
    for (char *at = text; *at; ++at) {
        if (*at != '#' || (at > text && at[-1] != ' ' && at[-1] != '\t')) continue;
        *at = '\0';
        return;
    }
}

/* A projector's value, with the image's path relative to the look. */
static char *image_beside(const char *look, const char *value, const char *image) {
    const size_t before = (size_t)(image - value);
    char *path = ex_path_beside(look, image);
    char *out = (char *)ex_allocate(before + strlen(path) + 1, 1);
    memcpy(out, value, before);
    memcpy(out + before, path, strlen(path));
    free(path);
    return out;
}

/* Reads one line of a look: the name of an option without dashes, and its value; or nothing. */
static int read_look_line(settings *all, const char *look, int line, char *text, ex_error *error) {
    char name[80];
    cut_comment(text);
    text = ex_trim(text);
    if (!*text) return 0;
    const size_t length = strcspn(text, " \t");
    snprintf(name, sizeof name, "--%.*s", (int)(length < 70 ? length : 70), text);
    const option_rule *rule = find_option(name);
    const char *value = ex_skip_blanks(text + length);
    if (!rule || !rule->apply || !is_option_of(all->program, rule))
        return ex_fail(error, "%s:%d: '%s' is not an option for a look", look, line, ex_quoted(name + 2).text);
    if (rule->form && !*value) return ex_fail(error, "%s:%d: %s needs a value: %s", look, line, name, rule->form);
    if (!rule->form && *value)
        return ex_fail(error, "%s:%d: %s takes no value: '%s'", look, line, name, ex_quoted(value).text);
    const char *image = rule->apply == add_light ? find_image(value) : NULL;
    if (image) value = keep_text(all, image_beside(look, value, image));
    if (rule->form && strncmp(rule->form, "FILE", 4) == 0) value = keep_text(all, ex_path_beside(look, value));
    const setting added = {rule, rule->form ? value : NULL, look, line};
    add_setting(all, added);
    return 0;
}

static int read_look(settings *all, const char *look, ex_error *error) {
    char *text = NULL, *line;
    size_t length = 0;
    int number = 0;
    if (ex_read_text(look, &text, &length, error)) return 1;
    char *rest = keep_text(all, text);
    while ((line = ex_next_line(&rest, text + length)) != NULL)
        if (read_look_line(all, look, ++number, line, error)) return 1;
    return 0;
}

/* Reads the command line. Looks are replaced by their options. */
static int read_settings(int argc, char **argv, settings *all, ex_error *error) {
    for (int i = 1; i < argc; ++i) {
        const option_rule *rule = find_option(argv[i]);
        if (!rule || !is_option_of(all->program, rule))
            return ex_fail(error, "unknown option '%.80s'; --help lists them", argv[i]);
        setting added = {rule, NULL, NULL, 0};
        if (rule->form) {
            if (i + 1 == argc || strncmp(argv[i + 1], "--", 2) == 0)
                return ex_fail(error, "%s needs a value: %s", rule->name, rule->form);
            added.value = argv[++i];
        }
        if (!rule->apply) {
            if (read_look(all, added.value, error)) return 1;
        } else {
            add_setting(all, added);
        }
    }
    return 0;
}

static int apply_settings(arguments *all, ex_error *error) {
    for (size_t i = 0; i < all->settings->count; ++i) {
        const setting *s = &all->settings->list[i];
        if (apply_option(s->rule, all, s->value, error) == 0) continue;
        const ex_error why = *error;
        return s->look ? ex_fail(error, "%s:%d: %s", s->look, s->line, why.text) : 1;
    }
    return 0;
}

/* A setting without effect is a mistake: of two ways to specify how a volume looks, only one can be meant. */
static int check_appearance(const volume_arguments *volume, ex_error *error) {
    static const char *const by_gas[] = {"--extinction", "--albedo", "--emission", "--albedo-volume",
                                         "--emission-volume"};
    const int has_points = volume->points.point_count > 0;
    if (volume->transfer_file && has_points)
        return ex_fail(error, "--transfer and --transfer-point of %s exclude each other: give one of them",
                       volume->file);
    for (int i = 0; i < 5 && (volume->transfer_file || has_points); ++i)
        if (has(volume->given, by_gas[i]))
            return ex_fail(error, "%s and %s of %s exclude each other: a transfer function's lines say all that",
                           by_gas[i], has_points ? "--transfer-point" : "--transfer", volume->file);
    if (volume->albedo_file && has(volume->given, "--albedo"))
        return ex_fail(error, "--albedo and --albedo-volume of %s exclude each other", volume->file);
    if (volume->shading && (volume->albedo_file || volume->emission_file))
        return ex_fail(error, "--shading surface of %s excludes --albedo-volume and --emission-volume", volume->file);
    if (volume->classify && !volume->transfer_file && !has_points && !has(volume->given, "--temperature"))
        return ex_fail(error, "--classify voxels of %s needs --transfer or --transfer-point", volume->file);
    if (volume->shading && has(volume->given, "--emission"))
        return ex_fail(error, "--emission and --shading surface of %s exclude each other: only a gas glows",
                       volume->file);
    return 0;
}

/* A volume of temperatures does nothing but glow. */
static int check_temperature(const volume_arguments *volume, ex_error *error) {
    static const char *const others[] = {"--transfer",      "--transfer-point",  "--extinction",
                                         "--albedo",        "--emission",        "--gas-ambient",
                                         "--albedo-volume", "--emission-volume", "--phase"};
    if (!has(volume->given, "--temperature")) return 0;
    for (size_t i = 0; i < sizeof others / sizeof *others; ++i)
        if (has(volume->given, others[i]))
            return ex_fail(
                error,
                "%s and --temperature of %s exclude each other: temperatures only glow; smoke is another --volume",
                others[i], volume->file);
    if (volume->shading)
        return ex_fail(error, "--shading surface and --temperature of %s exclude each other: only a gas glows",
                       volume->file);
    return 0;
}

/* OpenVDB and NanoVDB files are known by their first bytes. NULL: any other file. */
static const ex_sparse_format *sparse_format(const char *path) {
    char start[8] = "";
    FILE *file = fopen(path, "rb");
    if (!file) return NULL;
    const size_t got = fread(start, 1, sizeof start, file);
    fclose(file);
    if (got == sizeof start && memcmp(start, " BDV\0\0\0\0", 8) == 0) return &ex_vdb;
    return got == sizeof start && memcmp(start, "NanoVDB", 7) == 0 ? &ex_nvdb : NULL;
}

static int ends_with(const char *text, const char *ending) {
    const size_t length = strlen(text), part = strlen(ending);
    return length >= part && strcasecmp(text + length - part, ending) == 0;
}

/* Options for OpenVDB and NanoVDB files say nothing about others; nor can options replace what such a file says. */
static int check_sparse(const volume_arguments *volume, int is_sparse, ex_error *error) {
    static const char *const own[] = {"--grid", "--fog"}, *const others[] = {"--size", "--type"};
    const int has_arrays = ends_with(volume->file, ".npz"); /* which have names, too */
    for (int i = 0; i < 2; ++i) {
        if (!is_sparse && has(volume->given, own[i]) && !(has_arrays && i == 0))
            return ex_fail(error, "%s says nothing about %s, which is not an OpenVDB%s file", own[i], volume->file,
                           i ? " or NanoVDB" : ", NanoVDB or .npz");
        if (is_sparse && has(volume->given, others[i]))
            return ex_fail(error, "%s says nothing about %s: an OpenVDB or NanoVDB file has its own", others[i],
                           volume->file);
    }
    if (!is_sparse && ends_with(volume->file, "vdb") && !has(volume->given, "--size"))
        return ex_fail(error, "%s: not an OpenVDB or NanoVDB file: it starts with neither ' BDV' nor NanoVDB",
                       volume->file);
    if (has(volume->given, "--fog") && has(volume->given, "--range"))
        return ex_fail(error, "--fog and --range of %s exclude each other: a fog is 0 to 1", volume->file);
    return 0;
}

/* Opens a grid of an OpenVDB or a NanoVDB file. Its leaves are read when the library asks for them. */
static int open_sparse(volume_arguments *volume, const ex_sparse_format *format, ex_error *error) {
    static const int none[3] = {0, 0, 0};
    const uint64_t max_bytes = (uint64_t)volume->voxels.max_bytes;
    ex_sparse *grid = &volume->sparse;
    if (ex_voxel_file_raw(&volume->voxels, volume->file, none, EX_F32, error)) return 1;
    if (ex_sparse_open(format, grid, volume->file, volume->grid_name, max_bytes, error)) return 1;
    if (ex_sparse_check(grid, volume->fog, error)) return 1;
    ex_sparse_scale(grid, volume->range, volume->fog);
    memcpy(volume->voxels.size, grid->size, sizeof grid->size);
    memcpy(volume->voxels.range, volume->range, sizeof volume->range);
    volume->placement = ex_sparse_placement(grid);
    return 0;
}

/* Places a volume by the two corners of --box. */
static void place_by_box(volume_arguments *volume) {
    memset(&volume->placement, 0, sizeof volume->placement);
    for (int a = 0; a < 3; ++a) {
        volume->placement.origin[a] = volume->box[a];
        volume->placement.axis[a][a] = volume->box[3 + a] - volume->box[a];
    }
}

/* Finds out where the voxels are and what they mean, from the file's header, if it has one, and from options. */
static int find_voxels(volume_arguments *volume, ex_error *error) {
    const ex_sparse_format *format = sparse_format(volume->file);
    const int has_header = ex_volume_format_of(volume->file) != NULL;
    ex_volume_file file;
    ex_voxel_file *voxels = &file.voxels;
    if (check_sparse(volume, format != NULL, error)) return 1;
    if (format) {
        if (open_sparse(volume, format, error)) return 1;
        if (has(volume->given, "--box")) place_by_box(volume);
        return 0;
    }
    if (has_header ? ex_volume_file_read_array(&file, volume->file, volume->grid_name, error)
                   : ex_voxel_file_raw(voxels, volume->file, volume->size, (ex_type)volume->type, error))
        return 1;
    if (has(volume->given, "--size")) memcpy(voxels->size, volume->size, sizeof voxels->size);
    if (has(volume->given, "--type")) voxels->type = (ex_type)volume->type;
    if (has(volume->given, "--range")) memcpy(voxels->range, volume->range, sizeof voxels->range);
    volume->voxels = *voxels;
    if (has_header && !has(volume->given, "--box")) {
        memcpy(volume->space, file.space, sizeof volume->space);
        volume->placement = ex_volume_file_placement(&file);
    } else {
        place_by_box(volume);
    }
    return 0;
}

/* Says so once if files that are opened together name different directions for their coordinates. */
static void warn_of_spaces(const arguments *all) {
    static int is_told; /* a bake opens each frame twice */
    const volume_arguments *first = NULL;
    for (int i = 0; i < all->volume_count && !is_told; ++i) {
        const volume_arguments *volume = &all->volumes[i];
        if (!*volume->space) continue;
        if (!first) first = volume;
        if (strcmp(volume->space, first->space) == 0) continue;
        fprintf(stderr, "%s: coordinates of %s are %s, those of %s are %s: both are used as they are\n",
                program_names[all->settings->program], ex_quoted(first->file).text, first->space,
                ex_quoted(volume->file).text, volume->space);
        is_told = 1;
    }
}

static int find_volumes(arguments *all, ex_error *error) {
    for (int i = 0; i < all->volume_count; ++i) {
        all->volumes[i].voxels.max_bytes = all->max_bytes;
        if (find_voxels(&all->volumes[i], error)) return 1;
        all->volumes[i].voxels.max_bytes = all->max_bytes;
    }
    warn_of_spaces(all);
    return 0;
}

static int check_volumes(const arguments *all, ex_error *error) {
    for (int i = 0; i < all->volume_count; ++i) {
        const volume_arguments *volume = &all->volumes[i];
        if (volume->voxels.size[0] == 0)
            return ex_fail(error, "--volume %s has no --size%s", volume->file, i > 0 ? " after it" : "");
        for (int a = 0; a < 3; ++a)
            if (volume->box[a] == volume->box[3 + a])
                return ex_fail(error, "--box of %s: no extent along %c", volume->file, 'x' + a);
        for (int a = 0; a < 3 && has(volume->given, "--crop"); ++a)
            if (volume->crop[a] > volume->crop[3 + a] || volume->crop[3 + a] > volume->voxels.size[a])
                return ex_fail(error, "--crop of %s: faces %d and %d along %c must not fall, within 0..%d",
                               volume->file, volume->crop[a], volume->crop[3 + a], 'x' + a, volume->voxels.size[a]);
        if (check_temperature(volume, error) || check_appearance(volume, error)) return 1;
    }
    return 0;
}

/* Refuses options for a first volume, set of particles, mesh or light that never came. */
static int check_owners(const arguments *all, ex_error *error) {
    static const char *const owners[] = {"", "--volume", "--particles", "--mesh", "--light"};
    for (int i = 0; i < OPTION_COUNT; ++i)
        if ((!all->volume_count && has_row(all->volumes[0].given, i)) ||
            (!all->particle_set_count && has_row(all->particles[0].given, i)) ||
            (!all->mesh_count && has_row(all->meshes[0].given, i)) ||
            (!all->light_count && has_row(all->lights[0].given, i)))
            return ex_fail(error, "%s: there is no %s that it could be about", options[i].name,
                           owners[options[i].owner]);
    return 0;
}

/* The option whose file writing to `path` would overwrite; NULL if there is none. */
static const char *find_input(const arguments *all, const char *path) {
    for (int i = 0; i < all->volume_count; ++i) {
        const volume_arguments *volume = &all->volumes[i];
        if (ex_same_file(path, volume->file) || ex_same_file(path, volume->voxels.path)) return "--volume";
        if (volume->transfer_file && ex_same_file(path, volume->transfer_file)) return "--transfer";
        if (volume->albedo_file && ex_same_file(path, volume->albedo_file)) return "--albedo-volume";
        if (volume->emission_file && ex_same_file(path, volume->emission_file)) return "--emission-volume";
    }
    for (int i = 0; i < all->mesh_count; ++i)
        if (ex_same_file(path, all->meshes[i].file)) return "--mesh";
    for (int i = 0; i < all->particle_set_count; ++i)
        if (ex_same_file(path, all->particles[i].file)) return "--particles";
    for (int i = 0; i < all->light_count; ++i)
        if (all->lights[i].image && ex_same_file(path, all->lights[i].image)) return "--light";
    if (all->sky_file && ex_same_file(path, all->sky_file)) return "--sky";
    for (size_t i = 0; i < all->settings->count; ++i)
        if (all->settings->list[i].look && ex_same_file(path, all->settings->list[i].look)) return "--look";
    return NULL;
}

/* Checks files before the render, which may be long, and keeps inputs from being overwritten by mistake. */
static inline int check_outputs(const arguments *all, ex_error *error) {
    enum { OUTPUTS = 6 };
    const char *const names[OUTPUTS] = {"--out", "--pfm", "--alpha-pfm", "--exr", "--radiance-hdr", "--stats"};
    const char *const files[OUTPUTS] = {all->out, all->pfm, all->alpha_pfm, all->exr, all->radiance_hdr, all->stats};
    int count = 0;
    for (int i = 0; i < OUTPUTS; ++i) count += files[i] != NULL;
    for (int i = 0; i < 2; ++i)
        if (has(all->given, i ? "--exr-compression" : "--exr-type") && !all->exr)
            return ex_fail(error, "%s says nothing without --exr", i ? "--exr-compression" : "--exr-type");
    if (all->plan) return 0;
    if (count == 0)
        return ex_fail(error, "nothing to write: give --out or another result, or --plan; --help says more");
    for (int i = 0; i < OUTPUTS; ++i) {
        if (!files[i]) continue;
        const char *input = find_input(all, files[i]);
        if (input) return ex_fail(error, "%s %s is a file that %s reads", names[i], files[i], input);
        for (int k = 0; k < i; ++k)
            if (files[k] && ex_same_file(files[i], files[k]))
                return ex_fail(error, "%s and %s are the same file: %s", names[k], names[i], files[i]);
        if (ex_check_writable(files[i], error)) return 1;
    }
    return 0;
}

static int shadow_is(const arguments *all, const char *name) { return strcmp(shadow_names[all->shadow], name) == 0; }

/* Whether all lights have transmittance maps. */
static int has_maps(const arguments *all) {
    static const char *const others[] = {"auto", "sheets", "samples", "none", NULL};
    return ex_find_name(others, shadow_names[all->shadow]) < 0;
}

/* Whether shadows are traced from every step of every ray. */
static inline int is_marched(const arguments *all) { return all->reference || shadow_is(all, "samples"); }

/* Whether light scatters once although no option says so: only paths follow more of it in the reference. */
static inline int is_scattered_once(const arguments *all) {
    return is_marched(all) && all->samples == 0 && !has(all->given, "--scattering");
}

/* Options for transmittance maps must match the technique. */
static int check_map(const arguments *all, ex_error *error) {
    static const struct {
        const char *option, *kinds[3]; /* the techniques it applies to; none: all */
        const char *other;             /* but this one */
    } about[] = {
        {"--map-components", {NULL, NULL, NULL}, ""},           {"--map-resolution", {NULL, NULL, NULL}, "table"},
        {"--table-size", {"table", "auto", NULL}, ""},          {"--map-epsilon", {"compressed", NULL, NULL}, ""},
        {"--map-cubic", {"opacity", "deep-opacity", NULL}, ""}, {"--map-texel-range", {"fourier", NULL, NULL}, ""}};
    const char *kind = shadow_names[all->shadow];
    if ((has_maps(all) || shadow_is(all, "samples")) && all->no_shadows)
        return ex_fail(error, "--shadow %s says nothing with --no-shadows", kind);
    for (size_t i = 0; i < sizeof about / sizeof *about; ++i) {
        const int fits = about[i].kinds[0] ? ex_find_name(about[i].kinds, kind) >= 0
                                           : has_maps(all) && !shadow_is(all, about[i].other);
        if (has(all->given, about[i].option) && !fits)
            return ex_fail(error, "%s says nothing about --shadow %s", about[i].option, kind);
    }
    return 0;
}

/* A projector's focus has a meaning only with an extent, a falloff only with a position. */
static int check_throw(const light_arguments *light, ex_error *error) {
    if (has(light->given, "--light-focus") && !light->image)
        return ex_fail(error, "--light-focus says nothing about --light %s, which is not a projector", light->text);
    if (has(light->given, "--light-focus") && !has(light->given, "--light-size"))
        return ex_fail(error, "--light-focus says nothing about --light %s, which has no --light-size", light->text);
    if (has(light->given, "--light-falloff") && light->kind == SPS_LIGHT_DIRECTIONAL)
        return ex_fail(error, "--light-falloff says nothing about --light %s: it has no position", light->text);
    return 0;
}

/* The extent of a light must match its kind and how it casts shadows. */
static int check_lights(const arguments *all, ex_error *error) {
    static const char *const extents[] = {"--light-angle", "--light-size"}; /* by sps_light_kind */
    for (int i = 0; i < all->light_count; ++i) {
        const light_arguments *light = &all->lights[i];
        const char *own = extents[light->kind], *other = extents[1 - light->kind];
        if (has(light->given, other))
            return ex_fail(error, "%s says nothing about --light %s: give %s", other, light->text, own);
        if (has(light->given, "--light-samples") && !has(light->given, own))
            return ex_fail(error, "--light-samples says nothing about --light %s, which has no %s", light->text, own);
        if (has(light->given, own) && has_maps(all))
            return ex_fail(error,
                           "%s of --light %s and --shadow %s exclude each other: a map holds the shadow of a point",
                           own, light->text, shadow_names[all->shadow]);
        if (check_throw(light, error)) return 1;
    }
    return 0;
}

/* Checks that need the whole command line. */
static int check_scene_options(const arguments *all, ex_error *error) {
    const int *region = all->region;
    if (check_owners(all, error) || check_volumes(all, error) || check_map(all, error) || check_lights(all, error))
        return 1;
    if (has(all->given, "--fov") && has(all->given, "--ortho"))
        return ex_fail(error, "--fov (perspective) and --ortho (orthographic) exclude each other: give one of them");
    if (all->plan && is_marched(all))
        return ex_fail(error, "--plan and %s exclude each other: a plan is about sheets and sweeps, and there are none",
                       all->reference ? "--reference" : "--shadow samples");
    static const char *const of_sky[] = {"--sky-turn", "--sky-scale", "--sky-samples"};
    for (int i = 0; i < 3; ++i)
        if (has(all->given, of_sky[i]) && !all->sky_file)
            return ex_fail(error, "%s says nothing without --sky", of_sky[i]);
    if (has(all->given, "--samples") && !is_marched(all))
        return ex_fail(error, "--samples says nothing without --reference");
    if (has(all->given, "--region")) {
        if (region[2] < 1 || region[3] < 1 || region[0] + region[2] > all->width || region[1] + region[3] > all->height)
            return ex_fail(error, "--region %d,%d,%d,%d is empty or not within the image of %d x %d", region[0],
                           region[1], region[2], region[3], all->width, all->height);
    }
    return 0;
}

/* A part holds everything that can be written of it; it must be like its part of the whole picture. */
static inline int check_part(const arguments *all, ex_error *error) {
    static const char *const others[][2] = {{"--region", "a part is a region itself"},
                                            {"--budget-seconds", "a budget depends on the region; give --quality"},
                                            {"--budget-error", "a budget depends on the region; give --quality"},
                                            {"--budget-scale-min", "a part has the picture's pixels"},
                                            {"--pfm", "a part has one file, --out; give it to join"},
                                            {"--alpha-pfm", "a part has one file, --out; give it to join"},
                                            {"--exr", "a part has one file, --out; give it to join"},
                                            {"--radiance-hdr", "a part has one file, --out; give it to join"}};
    if (!has(all->given, "--part")) return 0;
    if (all->part[1] > all->height)
        return ex_fail(error, "--part %d/%d: a picture of %d rows has at most %d parts", all->part[0], all->part[1],
                       all->height, all->height);
    for (size_t i = 0; i < sizeof others / sizeof *others; ++i)
        if (has(all->given, others[i][0]))
            return ex_fail(error, "--part and %s exclude each other: %s", others[i][0], others[i][1]);
    if (!all->out && !all->plan) return ex_fail(error, "--part needs --out, the file that it is written to");
    return 0;
}

static inline int check(const arguments *all, ex_error *error) {
    return check_scene_options(all, error) || check_part(all, error) || check_outputs(all, error);
}

#endif /* EX_RENDER_OPTIONS_H */
