/* basics.h: what all other files here build on: errors as one line of text, exit statuses, memory. None of it belongs
   to the library: an engine has all this already.

   Functions that can fail return 0 on success. Otherwise they return 1 and fill `error` with one line that names the
   file. */

#ifndef EX_BASICS_H
#define EX_BASICS_H

#ifndef _POSIX_C_SOURCE
#define _POSIX_C_SOURCE 200809L /* clock_gettime, isatty, sysconf, fseeko in a strict C99 build */
#endif
#ifndef SPLATSHADOW_H
#include "splatshadow.h"
#endif

#include <errno.h>
#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define EX_COORDINATE_MAX 1e15 /* the largest coordinate that the library takes */

/* What programs return from main. */
enum {
    EX_OK = 0,
    EX_FAILED = 1,  /* the work was begun and could not be finished */
    EX_MISTAKEN = 2 /* an option or a file is wrong: the user can mend it */
};

/* --------------------------------------------------------------------------------------------------------- errors */

typedef struct ex_error {
    char text[1024];
} ex_error;

#ifdef __GNUC__
#define EX_PRINTF __attribute__((format(printf, 2, 3))) /* the compiler checks arguments against the format */
#else
#define EX_PRINTF
#endif

/* Fills the error and returns 1, so that the caller can `return ex_fail(...)`. File names may contain newlines and
   terminal commands: these become question marks, so that an error stays one line. */
static inline int ex_fail(ex_error *error, const char *format, ...) EX_PRINTF;
static inline int ex_fail(ex_error *error, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(error->text, sizeof error->text, format, arguments);
    va_end(arguments);
    for (char *at = error->text; *at; ++at)
        if ((unsigned char)*at < ' ' || *at == 127) *at = '?';
    return 1;
}

typedef struct ex_quote {
    char text[64];
} ex_quote;

/* The start of any text, with question marks for what cannot be printed. */
static inline ex_quote ex_quoted(const char *text) {
    ex_quote quote;
    const size_t most = sizeof quote.text - 1, length = strlen(text);
    for (size_t i = 0; i < most && i < length; ++i) quote.text[i] = text[i] >= ' ' && text[i] <= '~' ? text[i] : '?';
    quote.text[length < most ? length : most] = '\0';
    if (length > most) memcpy(quote.text + most - 3, "...", 3);
    return quote;
}

/* --------------------------------------------------------------------------------------------------------- memory */

/* Zeroed memory. Small programs like these cannot go on without it, so this and ex_grow never return NULL. */
static inline void *ex_allocate(size_t count, size_t item_size) {
    void *memory = calloc(count ? count : 1, item_size);
    if (memory) return memory;
    fprintf(stderr, "out of memory (%zu items of %zu bytes)\n", count, item_size);
    exit(EX_FAILED);
}

/* Returns the array with room for at least one more item after the first `count`; it may have moved. */
static inline void *ex_grow(void *array, size_t count, size_t *capacity, size_t item_size) {
    if (count < *capacity) return array;
    const size_t larger = *capacity ? *capacity * 2 : 64;
    void *moved = larger > SIZE_MAX / item_size ? NULL : realloc(array, larger * item_size);
    if (!moved) {
        fprintf(stderr, "out of memory (%zu items of %zu bytes)\n", larger, item_size);
        exit(EX_FAILED);
    }
    *capacity = larger;
    return moved;
}

#endif /* EX_BASICS_H */
