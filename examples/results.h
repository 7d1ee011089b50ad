/* results.h: the files of one picture that render.c and join.c write. */

#ifndef EX_RESULTS_H
#define EX_RESULTS_H

#include "exr.h"
#include "picture.h"

/* NULL: not wanted. */
typedef struct ex_results {
    const char *out, *pfm, *alpha_pfm, *exr, *radiance_hdr;
} ex_results;

static inline int ex_write_results(const ex_results *files, const ex_exr *picture, ex_error *error) {
    const float *rgba = picture->rgba;
    const int width = picture->region[2] ? picture->region[2] : picture->width;
    const int height = picture->region[2] ? picture->region[3] : picture->height;
    if (files->out && ex_write_png(files->out, rgba, width, height, error)) return 1;
    if (files->pfm && ex_write_pfm(files->pfm, rgba, width, height, 0, 3, error)) return 1;
    if (files->alpha_pfm && ex_write_pfm(files->alpha_pfm, rgba, width, height, 3, 1, error)) return 1;
    if (files->exr && ex_write_exr(files->exr, picture, error)) return 1;
    return files->radiance_hdr ? ex_write_hdr(files->radiance_hdr, rgba, width, height, error) : 0;
}

#endif /* EX_RESULTS_H */
