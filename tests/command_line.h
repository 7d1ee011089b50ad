/* Shared by tests of examples/render.c and bake.c: a folder for their files, and its output when run there. Include
 * after check.h.
 */

#ifndef COMMAND_LINE_H
#define COMMAND_LINE_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>

/* Where these tests read and write files, and where they run build/tests/render. */
static char folder[] = "build/command_line.XXXXXX";

/* Makes the folder. Returns 0 if that is not possible here. */
static inline int folder_begin(void) {
    mkdir("build", 0777); /* may exist already */
    return mkdtemp(folder) != NULL;
}

static inline void folder_end(void) {
    char command[200];
    snprintf(command, sizeof command, "rm -r %s", folder);
    CHECK(system(command) == 0);
}

/* The program that is tested. */
static const char *tested = "render";

static inline int render_is_built(void) {
    char path[200];
    FILE *program;
    snprintf(path, sizeof path, "build/tests/%s", tested);
    program = fopen(path, "rb");
    if (program) fclose(program);
    return program != NULL;
}

/* Returns the number of bytes read. */
static inline int read_file(const char *name, char *text, size_t size) {
    char path[200];
    FILE *file;
    size_t got = 0;
    snprintf(path, sizeof path, "%s/%s", folder, name);
    file = fopen(path, "rb");
    if (!file) return 0;
    got = fread(text, 1, size - 1, file);
    text[got] = 0;
    fclose(file);
    return (int)got;
}

static inline void write_file(const char *name, const void *data, size_t size) {
    char path[200];
    FILE *file;
    snprintf(path, sizeof path, "%s/%s", folder, name);
    file = fopen(path, "wb");
    if (CHECK(file && fwrite(data, 1, size, file) == size)) fclose(file);
}

typedef struct outcome {
    int status;
    char said[2000]; /* standard error */
} outcome;

static inline outcome run_render(const char *options) {
    static char command[4000];
    outcome result;
    int status;
    snprintf(command, sizeof command, "cd %s && ../tests/%s %s 2>said", folder, tested, options);
    status = system(command);
    result.status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    read_file("said", result.said, sizeof result.said);
    return result;
}

/* No control characters, and no second line. */
static inline int is_printable(const char *text, size_t length) {
    for (size_t i = 0; i < length; ++i)
        if ((unsigned char)text[i] < 32 || (unsigned char)text[i] == 127) return 0;
    return 1;
}

static inline int is_one_line(const char *said) {
    const size_t length = strlen(said), start = strlen(tested);
    return length > start + 4 && strncmp(said, tested, start) == 0 && strncmp(said + start, ": ", 2) == 0 &&
           said[length - 1] == '\n' && is_printable(said, length - 1);
}

typedef struct complaint {
    const char *options;
    int status;
    const char *words; /* text that the line must contain; NULL: there must be no line */
} complaint;

static inline void check_complaints(const complaint *list, size_t count) {
    for (size_t i = 0; i < count; ++i) {
        const outcome got = run_render(list[i].options);
        const int right = list[i].words ? is_one_line(got.said) && strstr(got.said, list[i].words) : got.said[0] == 0;
        if (!CHECK(got.status == list[i].status) || !CHECK(right))
            printf("    %s %s\n    gives %d, and says: %s\n", tested, list[i].options, got.status, got.said);
    }
}

/* ImageMagick's command that converts; NULL: it is not installed. */
static inline const char *find_magick(void) {
    static const char *const names[] = {"magick", "convert", "/usr/bin/convert"};
    char command[200];
    for (int i = 0; i < 3; ++i) {
        snprintf(command, sizeof command, "%s -version 2>/dev/null | grep -q 'Version: ImageMagick'", names[i]);
        if (system(command) == 0) return names[i];
    }
    return NULL;
}

#define CHECK_COMPLAINTS(list) check_complaints((list), sizeof(list) / sizeof *(list))

#endif
