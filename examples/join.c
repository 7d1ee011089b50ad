/* join: one picture from the parts that `render --part I/N` wrote, on this machine or others: the same bits as of a
   single render. Exit status: 0 done; 2 an option or a file was wrong, with one line on stderr. */

#include "arguments.h"
#include "part.h"
#include "results.h"

#include <strings.h>

typedef struct join_arguments {
    ex_results files;
    int exr_type, exr_compression, help;
    const char **parts;
    int part_count;
} join_arguments;

static const char *const type_names[] = {"half", "float", NULL};
static const char *const compression_names[] = {"zip", "none", NULL};

/* An option that names a file. */
typedef struct file_option {
    const char *name, *ending, *help; /* ending: what -o takes it for; NULL: nothing */
    size_t offset;                    /* where ex_results has its field */
} file_option;

enum { FILE_OPTIONS = 5 };
static const file_option file_options[FILE_OPTIONS] = {
    {"--out", ".png", "sRGB picture", offsetof(ex_results, out)},
    {"--pfm", ".pfm", "linear radiance, three channels", offsetof(ex_results, pfm)},
    {"--alpha-pfm", NULL, "coverage, one channel", offsetof(ex_results, alpha_pfm)},
    {"--exr", ".exr", "OpenEXR: linear radiance, coverage as A, distance from the eye as Z", offsetof(ex_results, exr)},
    {"--radiance-hdr", ".hdr", "Radiance picture (RGBE): linear radiance", offsetof(ex_results, radiance_hdr)}};

/* The field of an option in some results. */
static const char **field_of(ex_results *files, const file_option *option) {
    return (const char **)(void *)((char *)files + option->offset);
}

static void print_help(void) {
    printf("usage: join -o FILE [options] PART...\n\n"
           "Joins the parts that render --part I/N wrote, in any order, into the picture that a single render writes.\n"
           "Parts of different builds, sizes or options are refused.\n\n"
           "  %-28s one of the following, by its ending: .png, .pfm, .exr, .hdr\n",
           "-o FILE");
    for (int i = 0; i < FILE_OPTIONS; ++i) {
        char left[40];
        snprintf(left, sizeof left, "%s FILE", file_options[i].name);
        printf("  %-28s %s\n", left, file_options[i].help);
    }
    printf("  %-28s of its R, G, B and A; Z is float; default half\n  %-28s default zip\n  %-28s this text\n",
           "--exr-type half|float", "--exr-compression zip|none", "--help");
}

/* -o FILE is the option of its ending. */
static const file_option *find_option(const char *name, const char *value) {
    for (int i = 0; i < FILE_OPTIONS; ++i) {
        const char *ending = file_options[i].ending;
        const size_t length = strlen(value), part = ending ? strlen(ending) : 0;
        if (strcmp(name, file_options[i].name) == 0) return &file_options[i];
        if (strcmp(name, "-o") == 0 && ending && length >= part && strcasecmp(value + length - part, ending) == 0)
            return &file_options[i];
    }
    return NULL;
}

static int read_choice(const char *name, const char *value, const char *const *names, int *out, ex_error *error) {
    const int choice = ex_find_name(names, value);
    if (choice < 0) return ex_fail(error, "%s: '%s' is not %s or %s", name, ex_quoted(value).text, names[0], names[1]);
    *out = choice;
    return 0;
}

static int read_option(const char *name, const char *value, join_arguments *all, ex_error *error) {
    if (strcmp(name, "--exr-type") == 0) return read_choice(name, value, type_names, &all->exr_type, error);
    if (strcmp(name, "--exr-compression") == 0)
        return read_choice(name, value, compression_names, &all->exr_compression, error);
    const file_option *option = find_option(name, value);
    if (!option && strcmp(name, "-o") == 0)
        return ex_fail(error, "-o %s: the name must end in .png, .pfm, .exr or .hdr", value);
    if (!option) return ex_fail(error, "unknown option '%.80s'; --help lists them", name);
    *field_of(&all->files, option) = value;
    return 0;
}

static int read_arguments(int argc, char **argv, join_arguments *all, ex_error *error) {
    all->exr_type = all->exr_compression = -1;
    for (int i = 1; i < argc; ++i) {
        if (argv[i][0] != '-') {
            all->parts[all->part_count++] = argv[i];
            continue;
        }
        if (strcmp(argv[i], "--help") == 0) {
            all->help = 1;
            continue;
        }
        if (i + 1 == argc) return ex_fail(error, "%.80s needs a value, or is unknown; --help lists options", argv[i]);
        if (read_option(argv[i], argv[i + 1], all, error)) return 1;
        ++i;
    }
    return 0;
}

/* Keeps parts from being overwritten, and checks files before anything is read. */
static int check_files(join_arguments *all, ex_error *error) {
    int count = 0;
    if (all->part_count == 0) return ex_fail(error, "nothing to join: give the files that render --part wrote");
    if ((all->exr_type >= 0 || all->exr_compression >= 0) && !all->files.exr)
        return ex_fail(error, "--exr-%s says nothing without --exr", all->exr_type >= 0 ? "type" : "compression");
    for (int i = 0; i < FILE_OPTIONS; ++i) {
        const char *path = *field_of(&all->files, &file_options[i]);
        if (!path) continue;
        ++count;
        for (int k = 0; k < all->part_count; ++k)
            if (ex_same_file(path, all->parts[k]))
                return ex_fail(error, "%s %s is one of the parts", file_options[i].name, path);
        for (int k = 0; k < i; ++k) {
            const char *other = *field_of(&all->files, &file_options[k]);
            if (other && ex_same_file(path, other))
                return ex_fail(error, "%s and %s are the same file: %s", file_options[k].name, file_options[i].name,
                               path);
        }
        if (ex_check_writable(path, error)) return 1;
    }
    return count ? 0 : ex_fail(error, "nothing to write: give -o; --help says more");
}

static int join(join_arguments *all, ex_error *error) {
    ex_joined joined;
    ex_exr picture;
    if (check_files(all, error) || ex_join(all->parts, all->part_count, &joined, error)) return EX_MISTAKEN;
    memset(&picture, 0, sizeof picture);
    picture.rgba = joined.rgba, picture.depth = joined.depth;
    picture.width = joined.width, picture.height = joined.height;
    picture.screen_width = joined.screen_width;
    picture.is_float = all->exr_type == 1;
    picture.zip = all->exr_compression != 1;
    const int failed = ex_write_results(&all->files, &picture, error);
    free(joined.rgba);
    free(joined.depth);
    return failed ? EX_MISTAKEN : EX_OK;
}

int main(int argc, char **argv) {
    join_arguments all;
    ex_error error;
    int status = EX_MISTAKEN;
    memset(&all, 0, sizeof all);
    all.parts = (const char **)ex_allocate((size_t)argc, sizeof *all.parts);
    if (read_arguments(argc, argv, &all, &error) == 0) {
        if (all.help) print_help();
        status = all.help ? EX_OK : join(&all, &error);
    }
    if (status != EX_OK) fprintf(stderr, "join: %s\n", error.text);
    free(all.parts);
    return status;
}
