/* arguments.h: parsing words and numbers of a command line. */

#ifndef EX_ARGUMENTS_H
#define EX_ARGUMENTS_H

#include "basics.h"

/* Parses a whole number within lo..hi; fails on anything else. */
static inline int ex_whole_number(const char *text, int lo, int hi, int *out) {
    char *end;
    const long number = strtol(text, &end, 10);
    if (end == text || *end != '\0' || number < lo || number > hi) return 1;
    *out = (int)number;
    return 0;
}

/* The index of `name` in a list that ends with NULL; -1 if it is not there. */
static inline int ex_find_name(const char *const *names, const char *name) {
    for (int i = 0; names[i]; ++i)
        if (strcmp(names[i], name) == 0) return i;
    return -1;
}

/* In the order of sps_quality. */
static const char *const ex_quality_names[] = {"default", "draft", "medium", "high", "ultra", NULL};

#endif /* EX_ARGUMENTS_H */
