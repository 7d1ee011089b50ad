/* The tutorial: the lines that docs/tutorial.md quotes are those of the steps in examples/tutorial/, and each step,
   which the Makefile builds into build/tests/tutorial/, draws a picture that has light and shadow where they belong. */

#include "check.h"
#include "command_line.h"

enum { STEPS = 7, CHANNELS_MAX = 384 * 256 * 3 };

typedef struct step {
    const char *name;
    int width, height;
    int dark[2], bright[2]; /* x, y of a pixel in shadow, and of one of the same material in light */
} step;

static const step steps[STEPS] = {
    {"1_blob", 320, 240, {225, 173}, {60, 173}}, /* the ground in the blob's shadow, and beside it */
    {"2_scan", 320, 240, {146, 102}, {180, 62}}, /* bone deep in an opening, and on the outside */
    {"3_scene",
     320,
     240,
     {275, 150},
     {230, 150}}, /* the ground behind and in front of a stone, as seen from the lamp */
    {"4_engine", 320, 240, {84, 174}, {250, 174}},      /* the ground in the smoke's shadow, and beside it */
    {"5_progressive", 384, 256, {245, 208}, {60, 208}}, /* likewise */
    {"6_shadow_map", 320, 240, {190, 162}, {60, 162}},  /* likewise */
    {"7_relight", 320, 240, {174, 172}, {204, 170}}};   /* the ground in all lights' shadows, and within the ring's */

/* ----------------------------------------------------------------------------------------------------------- quotes */

static const char *next_line(const char *line) {
    line += strcspn(line, "\n");
    return *line ? line + 1 : line;
}

/* The same line except for its indentation. */
static int is_line(const char *a, const char *b) {
    a += strspn(a, " "), b += strspn(b, " ");
    return strcspn(a, "\n") == strcspn(b, "\n") && strncmp(a, b, strcspn(a, "\n")) == 0;
}

/* A quotation is cut into runs by lines of "...", and ends at its fence. */
static int ends_run(const char *line) { return is_line(line, "...") || strncmp(line, "```", 3) == 0 || !*line; }

/* The position in the file after the first place that has all lines of the run, one after another; NULL if there is
   none. */
static const char *find_run(const char *file, const char *run) {
    for (; *file; file = next_line(file)) {
        const char *at = file, *line = run;
        while (*at && !ends_run(line) && is_line(at, line)) at = next_line(at), line = next_line(line);
        if (ends_run(line)) return at;
    }
    return NULL;
}

/* Checks a quotation of the file, from its first line on; returns its number of lines. */
static int check_quotation(const char *name, const char *file, const char *line) {
    int lines = 0;
    for (;; line = next_line(line)) {
        file = find_run(file, line);
        if (!CHECK(file != NULL)) {
            printf("    %s has no such lines: %.*s\n", name, (int)strcspn(line, "\n"), line);
            return lines;
        }
        for (; !ends_run(line); line = next_line(line)) ++lines;
        if (!is_line(line, "...")) return lines;
    }
}

/* Each step has a section of the page, whose heading names its file, and from which it is quoted. */
static void check_section(const step *s, const char *page) {
    char path[64], heading[80];
    snprintf(path, sizeof path, "examples/tutorial/%s.c", s->name);
    snprintf(heading, sizeof heading, "](../%s)\n", path);
    char *file = read_text(path);
    const char *section = strstr(page, heading), *end = section ? strstr(section, "\n## ") : NULL;
    int lines = 0;
    if (CHECK(file != NULL) && CHECK(section != NULL)) {
        for (const char *at = section; (at = strstr(at, "\n```c\n")) != NULL && (!end || at < end); ++at)
            lines += check_quotation(path, file, at + strlen("\n```c\n"));
        if (!CHECK(lines >= 6)) printf("    %s: %d lines are quoted\n", path, lines);
    }
    free(file);
}

static void test_quotations(void) {
    char *page = read_text("docs/tutorial.md"), *readme = read_text("README.md");
    if (CHECK(page && readme)) {
        CHECK(strstr(readme, "](docs/tutorial.md)") != NULL);
        for (int i = 0; i < STEPS; ++i) check_section(&steps[i], page);
    }
    free(page), free(readme);
}

/* The helpers of the test above notice a line that differs, is missing or stands elsewhere. */
static void test_runs(void) {
    static const char file[] = "a\n  b\nc\n    d\nb\ne\n";
    CHECK(find_run(file, "b\nc\n```\n") != NULL && find_run(file, "    a\nb\n...\n") != NULL);
    CHECK(is_line(find_run(file, "b\ne\n```\n"), "") && is_line(find_run(file, "b\n```\n"), "c"));
    CHECK(find_run(file, "b\nd\n```\n") == NULL && find_run(file, "a\nB\n```\n") == NULL);
    CHECK(find_run(file, "e\nf\n```\n") == NULL);
}

/* --------------------------------------------------------------------------------------------------------- pictures */

/* Runs a step. Returns 1 if it has left a picture of its size, whose channels, rows from the bottom, are then in
   `channels`. */
static int run_step(const step *s, float *channels) {
    static char file[4 * CHANNELS_MAX + 100];
    char command[200], header[40];
    const size_t size = (size_t)(3 * s->width * s->height) * sizeof(float);
    snprintf(command, sizeof command, "cd %s && ../tests/tutorial/%s picture.pfm >said 2>&1", folder, s->name);
    const size_t length = (size_t)snprintf(header, sizeof header, "PF\n%d %d\n-1.0\n", s->width, s->height);
    if (!CHECK(system(command) == 0)) {
        read_file("said", file, sizeof file);
        printf("    %s: %s\n", s->name, file);
        return 0;
    }
    if (!CHECK((size_t)read_file("picture.pfm", file, sizeof file) == length + size)) return 0;
    if (!CHECK(memcmp(file, header, length) == 0)) return 0;
    memcpy(channels, file + length, size);
    return 1;
}

/* Green of a pixel, rows from the top. */
static double green(const step *s, const float *channels, const int at[2]) {
    return (double)channels[3 * ((s->height - 1 - at[1]) * s->width + at[0]) + 1];
}

/* A shadow removes at least half of the light, as it does in the tutorial's pictures by a wide margin; and at most a
   twentieth of the channels may be overexposed. */
static void check_picture(const step *s, const float *channels) {
    const int count = 3 * s->width * s->height;
    const double dark = green(s, channels, s->dark), bright = green(s, channels, s->bright);
    int wrong = 0, over = 0;
    for (int i = 0; i < count; ++i) wrong += !(channels[i] >= 0 && channels[i] < 1e3f), over += channels[i] > 1;
    CHECK(wrong == 0 && 20 * over < count);
    if (!CHECK(bright > 0.03 && dark < 0.5 * bright)) printf("    %s: %g beside %g\n", s->name, dark, bright);
    if (getenv("CHECK_TIMES")) printf("%s: %g beside %g, %d of %d above 1\n", s->name, dark, bright, over, count);
}

static void test_pictures(void) {
    static float channels[CHANNELS_MAX];
    struct stat there;
    if (stat("build/tests/tutorial", &there) != 0 || !folder_begin()) {
        printf("skipped: pictures of the tutorial: make test builds its steps\n");
        return;
    }
    for (int i = 0; i < STEPS; ++i)
        if ((check_long() || i % 3 || !i) && run_step(&steps[i], channels)) check_picture(&steps[i], channels);
    folder_end();
}

int main(void) {
    RUN(test_runs);
    RUN(test_quotations);
    RUN(test_pictures);
    return check_report();
}
