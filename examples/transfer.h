/* transfer.h: transfer functions, and loading them from a file. */

#ifndef EX_TRANSFER_H
#define EX_TRANSFER_H

#include "files.h"

/* The points of a transfer function. Zero-initialize it. */
typedef struct ex_transfer {
    sps_transfer_point *points;
    size_t point_count, point_capacity;
} ex_transfer;

/* Appends a point. Fails if its value is not above the previous one's. */
static inline int ex_transfer_add(ex_transfer *transfer, const sps_transfer_point *point) {
    const size_t count = transfer->point_count;
    if (count > 0 && !(point->value > transfer->points[count - 1].value)) return 1;
    transfer->points = (sps_transfer_point *)ex_grow(transfer->points, count, &transfer->point_capacity, sizeof *point);
    transfer->points[transfer->point_count++] = *point;
    return 0;
}

/* A point from value, albedo, extinction and emission. */
static inline void ex_transfer_set(const float numbers[8], sps_transfer_point *point) {
    point->value = numbers[0], point->extinction = numbers[4];
    memcpy(point->albedo, numbers + 1, sizeof point->albedo);
    memcpy(point->emission, numbers + 5, sizeof point->emission);
}

static inline void ex_transfer_free(ex_transfer *transfer) {
    free(transfer->points);
    memset(transfer, 0, sizeof *transfer);
}

/* Parses `value r g b extinction` and, if there is more, `r g b` of the emission; a comment may follow. */
static inline int ex_transfer_line(char *text, sps_transfer_point *point) {
    float numbers[8] = {0};
    int count = 0;
    for (; count < 8; ++count) {
        char *end;
        text = ex_skip_blanks(text);
        if (count == 5 && (*text == '\0' || *text == '#')) break;
        const double number = strtod(text, &end), most = count >= 1 && count <= 3 ? 1.0 : 1e18; /* albedo: 0..1 */
        if (end == text || !(number >= 0.0 && number <= most)) return 1;
        numbers[count] = (float)number;
        text = end;
    }
    ex_transfer_set(numbers, point);
    text = ex_skip_blanks(text);
    return *text != '\0' && *text != '#';
}

/* Reads one point from each line, values rising. # starts a comment; blank lines are skipped. */
static inline int ex_transfer_load(ex_transfer *transfer, const char *path, ex_error *error) {
    char *text = NULL, *line;
    size_t length = 0;
    int line_number = 0, failed = 0;
    memset(transfer, 0, sizeof *transfer);
    if (ex_read_text(path, &text, &length, error)) return 1;
    char *rest = text;
    while (!failed && (line = ex_next_line(&rest, text + length)) != NULL) {
        ++line_number;
        line = ex_skip_blanks(line);
        if (*line == '\0' || *line == '#') continue;
        sps_transfer_point point;
        if (ex_transfer_line(line, &point))
            failed = ex_fail(error, "%s:%d: not `value r g b extinction [r g b]`, or out of range: '%s'", path,
                             line_number, ex_quoted(line).text);
        else if (ex_transfer_add(transfer, &point))
            failed = ex_fail(error, "%s:%d: values must rise from line to line", path, line_number);
    }
    if (!failed && transfer->point_count == 0) failed = ex_fail(error, "%s: no lines with values", path);
    free(text);
    if (failed) ex_transfer_free(transfer);
    return failed;
}

#endif /* EX_TRANSFER_H */
