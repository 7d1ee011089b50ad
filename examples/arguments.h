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

/* The file that `--out FILE` names, or `name`. Returns NULL after a sentence if there are other arguments. */
static inline const char *ex_out_file(int argc, char **argv, const char *name) {
    if (argc == 3 && strcmp(argv[1], "--out") == 0) return argv[2];
    if (argc > 1) fprintf(stderr, "%s: %s is not known; it takes --out FILE.png\n", argv[0], ex_quoted(argv[1]).text);
    return argc > 1 ? NULL : name;
}

#endif /* EX_ARGUMENTS_H */
