/* files.h: reading whole files or their start, lines of text, byte order; and writing so that a full disk is noticed.
 */

#ifndef EX_FILES_H
#define EX_FILES_H

#include "basics.h"

#include <sys/stat.h>
#include <unistd.h>

/* -------------------------------------------------------------------------------------------------------- reading */

/* Opens a regular file for reading and stores its length in bytes. Returns NULL on failure. */
static inline FILE *ex_open(const char *path, uint64_t *size, ex_error *error) {
    struct stat info;
    FILE *file = fopen(path, "rb");
    if (!file) {
        ex_fail(error, "%s: %s", path, strerror(errno));
        return NULL;
    }
    if (fstat(fileno(file), &info) != 0 || !S_ISREG(info.st_mode)) {
        ex_fail(error, "%s: not a regular file", path);
        fclose(file);
        return NULL;
    }
    *size = (uint64_t)info.st_size;
    return file;
}

/* Fails if a file of this name could not be written: better said before a long render than after it. */
static inline int ex_check_writable(const char *path, ex_error *error) {
    char folder[4096];
    struct stat info;
    const char *slash = strrchr(path, '/');
    if (stat(path, &info) == 0) {
        if (S_ISDIR(info.st_mode)) return ex_fail(error, "%s: cannot be written: it is a directory", path);
        if (access(path, W_OK) != 0) return ex_fail(error, "%s: cannot be written: %s", path, strerror(errno));
        return 0;
    }
    if (errno != ENOENT) return ex_fail(error, "%.300s: cannot be written: %s", path, strerror(errno));
    const size_t length = slash ? (size_t)(slash - path) + 1 : 1;
    if (length >= sizeof folder) return ex_fail(error, "%.64s...: the name is too long", path);
    memcpy(folder, slash ? path : ".", length);
    folder[length] = '\0';
    if (!*path || access(folder, W_OK) != 0)
        return ex_fail(error, "%s: cannot be written: %s", path, *path ? strerror(errno) : "the name is empty");
    return 0;
}

/* Whether two paths lead to the same regular file, or would once it is created. Terminals and pipes do not count. */
static inline int ex_same_file(const char *left, const char *right) {
    struct stat a, b;
    const int there = stat(left, &a) == 0;
    if (there != (stat(right, &b) == 0)) return 0;
    return there ? S_ISREG(a.st_mode) && a.st_dev == b.st_dev && a.st_ino == b.st_ino : strcmp(left, right) == 0;
}

/* Reads up to `most` bytes from the start of a file and appends a 0 byte. `held` is the length of the whole file. The
   caller frees the text. */
static inline int ex_read_start(const char *path, size_t most, char **text, size_t *length, uint64_t *held,
                                ex_error *error) {
    FILE *file = ex_open(path, held, error);
    if (!file) return 1;
    *length = *held < most ? (size_t)*held : most;
    *text = (char *)ex_allocate(*length + 1, 1);
    const size_t got = fread(*text, 1, *length, file);
    fclose(file);
    if (got == *length) return 0;
    free(*text);
    *text = NULL;
    return ex_fail(error, "%s: reading failed after %zu of %zu bytes", path, got, *length);
}

/* Reads a whole file and appends a 0 byte; the caller frees the text. The byte order mark that some editors write at
   the start of UTF-8 becomes blanks. */
static inline int ex_read_text(const char *path, char **text, size_t *length, ex_error *error) {
    uint64_t held = 0;
    if (ex_read_start(path, SIZE_MAX / 2, text, length, &held, error)) return 1;
    if (*length >= 3 && memcmp(*text, "\xef\xbb\xbf", 3) == 0) memset(*text, ' ', 3);
    if (*length == held) return 0;
    free(*text);
    *text = NULL;
    return ex_fail(error, "%s: too large", path);
}

/* Returns the next line, with a 0 in place of its newline, and advances `rest`. NULL after the last line. */
static inline char *ex_next_line(char **rest, const char *end) {
    char *line = *rest;
    if (line >= end) return NULL;
    char *newline = (char *)memchr(line, '\n', (size_t)(end - line));
    if (newline) *newline = '\0';
    *rest = newline ? newline + 1 : line + (end - line);
    return line;
}

static inline char *ex_skip_blanks(char *text) {
    while (*text == ' ' || *text == '\t' || *text == '\r') ++text;
    return text;
}

/* Removes blanks and line ends from both ends. */
static inline char *ex_trim(char *text) {
    text = ex_skip_blanks(text);
    size_t length = strlen(text);
    while (length > 0 && strchr(" \t\r\n", text[length - 1])) --length;
    text[length] = '\0';
    return text;
}

/* The path of a file that `path` names relative to itself; the caller frees it. */
static inline char *ex_path_beside(const char *path, const char *name) {
    const char *slash = name[0] == '/' ? NULL : strrchr(path, '/');
    const size_t folder = slash ? (size_t)(slash - path) + 1 : 0;
    char *out = (char *)ex_allocate(folder + strlen(name) + 1, 1);
    memcpy(out, path, folder);
    memcpy(out + folder, name, strlen(name));
    return out;
}

/* Converts items between a file's byte order and the machine's, in place. */
static inline void ex_byte_order(void *data, size_t count, size_t item_size, int big_endian) {
    const uint16_t one = 1;
    unsigned char first_byte;
    memcpy(&first_byte, &one, 1);
    if ((first_byte == 0) == (big_endian != 0)) return;
    unsigned char *item = (unsigned char *)data;
    for (size_t i = 0; i < count; ++i, item += item_size) {
        for (size_t a = 0, b = item_size - 1; a < b; ++a, --b) {
            const unsigned char swapped = item[a];
            item[a] = item[b], item[b] = swapped;
        }
    }
}

/* Raw and PFM files are little endian. */
static inline void ex_little_endian(void *data, size_t count, size_t item_size) {
    ex_byte_order(data, count, item_size, 0);
}

/* -------------------------------------------------------------------------------------------------------- writing */

/* A file that is being written. The first failure is kept until ex_output_end, which reports it. A full disk may show
   only when the file is closed. */
typedef struct ex_output {
    FILE *file;
    const char *path;
    int failure; /* errno of the first failure, 0 without one */
} ex_output;

static inline int ex_output_begin(ex_output *output, const char *path, ex_error *error) {
    output->path = path;
    output->failure = 0;
    output->file = fopen(path, "wb");
    return output->file ? 0 : ex_fail(error, "%s: cannot be written: %s", path, strerror(errno));
}

static inline void ex_output_note(ex_output *output, int failed) {
    if (failed && !output->failure) output->failure = errno ? errno : EIO;
}

static inline void ex_output_bytes(ex_output *output, const void *data, size_t size) {
    errno = 0;
    ex_output_note(output, fwrite(data, 1, size, output->file) != size);
}

static inline int ex_output_end(ex_output *output, ex_error *error) {
    errno = 0;
    ex_output_note(output, fclose(output->file) != 0);
    if (!output->failure) return 0;
    return ex_fail(error, "%s: writing failed: %s", output->path, strerror(output->failure));
}

#endif /* EX_FILES_H */
