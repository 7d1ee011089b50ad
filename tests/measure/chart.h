/* chart.h: curves on logarithmic or plain axes and labelled rows of small pictures, drawn into floats and written as
   PNG. Include after picture.h. Capital letters only: small texts are legible so, and the font stays short. */

#ifndef EX_CHART_H
#define EX_CHART_H

/* ================================================================================================= >>canvas */

typedef struct ex_canvas {
    int width, height;
    float *rgba; /* linear, as ex_write_png takes it */
} ex_canvas;

static inline ex_canvas ex_canvas_begin(int width, int height, float grey) {
    ex_canvas canvas = {width, height, NULL};
    const size_t count = (size_t)width * (size_t)height * 4;
    canvas.rgba = (float *)ex_allocate(count, sizeof(float));
    for (size_t i = 0; i < count; ++i) canvas.rgba[i] = grey;
    return canvas;
}

static inline void ex_canvas_end(ex_canvas *canvas) {
    free(canvas->rgba);
    canvas->rgba = NULL;
}

/* Of an sRGB code, 0..1. */
static inline double ex_linear_of(double code) {
    return code <= 0.04045 ? code / 12.92 : pow((code + 0.055) / 1.055, 2.4);
}

/* A pixel; NULL outside of the canvas, where nothing is drawn. */
static inline float *ex_canvas_pixel(const ex_canvas *canvas, int x, int y) {
    if (x < 0 || y < 0 || x >= canvas->width || y >= canvas->height) return NULL;
    return canvas->rgba + 4 * ((size_t)y * (size_t)canvas->width + (size_t)x);
}

/* Lays a color, 0xRRGGBB in sRGB, over a pixel. */
static inline void ex_canvas_dot(ex_canvas *canvas, int x, int y, unsigned color, double share) {
    float *pixel = ex_canvas_pixel(canvas, x, y);
    if (!pixel || share <= 0) return;
    for (int c = 0; c < 3; ++c) {
        const double linear = ex_linear_of((double)((color >> (16 - 8 * c)) & 255) / 255);
        pixel[c] += (float)(fmin(share, 1) * (linear - (double)pixel[c]));
    }
}

/* A stroke with round ends; a dot where both ends are the same. */
static inline void ex_canvas_line(ex_canvas *canvas, double x0, double y0, double x1, double y1, double width,
                                  unsigned color) {
    const double dx = x1 - x0, dy = y1 - y0, square = dx * dx + dy * dy, reach = 0.5 * width + 1;
    for (int y = (int)floor(fmin(y0, y1) - reach); y <= (int)ceil(fmax(y0, y1) + reach); ++y)
        for (int x = (int)floor(fmin(x0, x1) - reach); x <= (int)ceil(fmax(x0, x1) + reach); ++x) {
            const double along = square > 0 ? fmin(fmax(((x - x0) * dx + (y - y0) * dy) / square, 0), 1) : 0;
            const double away = hypot(x - x0 - along * dx, y - y0 - along * dy);
            ex_canvas_dot(canvas, x, y, color, 0.5 * width + 0.5 - away);
        }
}

/* What tells curves of like color apart. */
typedef enum ex_mark { EX_MARK_DISC = 0, EX_MARK_SQUARE, EX_MARK_CROSS, EX_MARK_RING, EX_MARK_RHOMB } ex_mark;

static inline void ex_canvas_mark(ex_canvas *canvas, double x, double y, ex_mark mark, unsigned color) {
    const double r = 4;
    if (mark == EX_MARK_DISC) {
        ex_canvas_line(canvas, x, y, x, y, 2 * r, color);
    } else if (mark == EX_MARK_SQUARE) {
        for (double row = -r + 0.5; row < r; row += 1)
            ex_canvas_line(canvas, x - r + 1, y + row, x + r - 1, y + row, 1.2, color);
    } else if (mark == EX_MARK_CROSS) {
        ex_canvas_line(canvas, x - r, y - r, x + r, y + r, 2, color);
        ex_canvas_line(canvas, x - r, y + r, x + r, y - r, 2, color);
    } else if (mark == EX_MARK_RING) {
        ex_canvas_line(canvas, x, y, x, y, 2 * r + 1, color);
        ex_canvas_line(canvas, x, y, x, y, 2 * r - 3, 0xffffff);
    } else {
        for (double row = -r - 1; row <= r + 1; row += 0.5)
            ex_canvas_line(canvas, x - (r + 1 - fabs(row)), y + row, x + (r + 1 - fabs(row)), y + row, 0.6, color);
    }
}

/* =================================================================================================== >>font */

enum { EX_GLYPH_WIDTH = 6, EX_GLYPH_HEIGHT = 7 }; /* one column of it between letters */

typedef struct ex_glyph {
    char letter;
    char rows[5 * EX_GLYPH_HEIGHT + 1];
} ex_glyph;

/* clang-format off */
static const ex_glyph ex_font[] = {
    {'A', ".###." "#...#" "#...#" "#####" "#...#" "#...#" "#...#"}, {'B', "####." "#...#" "#...#" "####." "#...#" "#...#" "####."},
    {'C', ".###." "#...#" "#...." "#...." "#...." "#...#" ".###."}, {'D', "####." "#...#" "#...#" "#...#" "#...#" "#...#" "####."},
    {'E', "#####" "#...." "#...." "####." "#...." "#...." "#####"}, {'F', "#####" "#...." "#...." "####." "#...." "#...." "#...."},
    {'G', ".###." "#...#" "#...." "#.###" "#...#" "#...#" ".###."}, {'H', "#...#" "#...#" "#...#" "#####" "#...#" "#...#" "#...#"},
    {'I', ".###." "..#.." "..#.." "..#.." "..#.." "..#.." ".###."}, {'J', "..###" "...#." "...#." "...#." "...#." "#..#." ".##.."},
    {'K', "#...#" "#..#." "#.#.." "##..." "#.#.." "#..#." "#...#"}, {'L', "#...." "#...." "#...." "#...." "#...." "#...." "#####"},
    {'M', "#...#" "##.##" "#.#.#" "#.#.#" "#...#" "#...#" "#...#"}, {'N', "#...#" "##..#" "##..#" "#.#.#" "#..##" "#..##" "#...#"},
    {'O', ".###." "#...#" "#...#" "#...#" "#...#" "#...#" ".###."}, {'P', "####." "#...#" "#...#" "####." "#...." "#...." "#...."},
    {'Q', ".###." "#...#" "#...#" "#...#" "#.#.#" "#..#." ".##.#"}, {'R', "####." "#...#" "#...#" "####." "#.#.." "#..#." "#...#"},
    {'S', ".####" "#...." "#...." ".###." "....#" "....#" "####."}, {'T', "#####" "..#.." "..#.." "..#.." "..#.." "..#.." "..#.."},
    {'U', "#...#" "#...#" "#...#" "#...#" "#...#" "#...#" ".###."}, {'V', "#...#" "#...#" "#...#" "#...#" ".#.#." ".#.#." "..#.."},
    {'W', "#...#" "#...#" "#...#" "#.#.#" "#.#.#" "##.##" "#...#"}, {'X', "#...#" "#...#" ".#.#." "..#.." ".#.#." "#...#" "#...#"},
    {'Y', "#...#" "#...#" ".#.#." "..#.." "..#.." "..#.." "..#.."}, {'Z', "#####" "....#" "...#." "..#.." ".#..." "#...." "#####"},
    {'0', ".###." "#...#" "#..##" "#.#.#" "##..#" "#...#" ".###."}, {'1', "..#.." ".##.." "..#.." "..#.." "..#.." "..#.." ".###."},
    {'2', ".###." "#...#" "....#" "...#." "..#.." ".#..." "#####"}, {'3', "####." "....#" "....#" ".###." "....#" "....#" "####."},
    {'4', "...#." "..##." ".#.#." "#..#." "#####" "...#." "...#."}, {'5', "#####" "#...." "####." "....#" "....#" "#...#" ".###."},
    {'6', ".###." "#...." "#...." "####." "#...#" "#...#" ".###."}, {'7', "#####" "....#" "...#." "..#.." "..#.." ".#..." ".#..."},
    {'8', ".###." "#...#" "#...#" ".###." "#...#" "#...#" ".###."}, {'9', ".###." "#...#" "#...#" ".####" "....#" "....#" ".###."},
    {'.', "....." "....." "....." "....." "....." ".##.." ".##.."}, {',', "....." "....." "....." "....." ".##.." "..#.." ".#..."},
    {'-', "....." "....." "....." "#####" "....." "....." "....."}, {'+', "....." "..#.." "..#.." "#####" "..#.." "..#.." "....."},
    {':', "....." ".##.." ".##.." "....." ".##.." ".##.." "....."}, {'/', "....#" "....#" "...#." "..#.." ".#..." "#...." "#...."},
    {'^', "..#.." ".#.#." "#...#" "....." "....." "....." "....."},
    {'(', "...#." "..#.." ".#..." ".#..." ".#..." "..#.." "...#."}, {')', ".#..." "..#.." "...#." "...#." "...#." "..#.." ".#..."},
};
/* clang-format on */

/* Text with its top left corner at (x,y). Letters without a glyph are left blank. */
static inline void ex_canvas_text(ex_canvas *canvas, int x, int y, const char *text, unsigned color) {
    for (; *text; ++text, x += EX_GLYPH_WIDTH) {
        const char letter = *text >= 'a' && *text <= 'z' ? (char)(*text - 'a' + 'A') : *text;
        for (size_t g = 0; g < sizeof ex_font / sizeof *ex_font; ++g)
            for (int i = 0; ex_font[g].letter == letter && i < 5 * EX_GLYPH_HEIGHT; ++i)
                if (ex_font[g].rows[i] == '#') ex_canvas_dot(canvas, x + i % 5, y + i / 5, color, 1);
    }
}

static inline int ex_text_width(const char *text) { return (int)strlen(text) * EX_GLYPH_WIDTH; }

/* ================================================================================================= >>curves */

/* A frame with logarithmic axes, or with plain ones from 0 on. */
typedef struct ex_chart {
    int left, top, width, height;
    double x[2], y[2]; /* first and last value of each axis; > 0 on logarithmic ones */
    const char *title, *x_name;
    int plain;
} ex_chart;

/* Where a value lies along an axis, 0..1. */
static inline double ex_chart_share(const ex_chart *chart, const double axis[2], double value) {
    return chart->plain ? value / axis[1] : log(value / axis[0]) / log(axis[1] / axis[0]);
}

static inline double ex_chart_x(const ex_chart *chart, double x) {
    return chart->left + chart->width * ex_chart_share(chart, chart->x, x);
}

static inline double ex_chart_y(const ex_chart *chart, double y) {
    return chart->top + chart->height * (1 - ex_chart_share(chart, chart->y, y));
}

/* Makes the axes reach over a value. */
static inline void ex_chart_reach(ex_chart *chart, double x, double y) {
    const double at[2] = {x, y};
    for (int i = 0; i < 2; ++i) {
        double *axis = i ? chart->y : chart->x;
        if (!(at[i] > 0)) continue;
        if (!(axis[0] > 0)) axis[0] = axis[1] = at[i];
        axis[0] = fmin(axis[0], at[i]), axis[1] = fmax(axis[1], at[i]);
    }
}

/* Room around what was reached. */
static inline void ex_chart_widen(ex_chart *chart) {
    chart->x[0] *= 0.8, chart->x[1] *= chart->plain ? 1.05 : 1.25;
    chart->y[0] *= 0.8, chart->y[1] *= chart->plain ? 1.05 : 1.25;
}

/* A grid line across an axis where it reaches a value, and the value if it is wanted. */
static inline void ex_chart_line(ex_canvas *canvas, const ex_chart *chart, int vertical, double value, unsigned color,
                                 int labelled) {
    const double *axis = vertical ? chart->x : chart->y;
    const int right = chart->left + chart->width, bottom = chart->top + chart->height;
    const double x = ex_chart_x(chart, value), y = ex_chart_y(chart, value);
    char label[32];
    if (value < (chart->plain ? 0 : axis[0] * 0.999) || value > axis[1] * 1.001) return;
    snprintf(label, sizeof label, "%g", value);
    if (vertical)
        ex_canvas_line(canvas, x, chart->top, x, bottom, 1, color);
    else
        ex_canvas_line(canvas, chart->left, y, right, y, 1, color);
    if (!labelled) return;
    if (vertical)
        ex_canvas_text(canvas, (int)x - ex_text_width(label) / 2, bottom + 5, label, 0x404040);
    else
        ex_canvas_text(canvas, chart->left - ex_text_width(label) - 4, (int)y - 3, label, 0x404040);
}

/* Lines at 1, 2 and 5 of each decade. */
static inline void ex_chart_decades(ex_canvas *canvas, const ex_chart *chart) {
    static const double steps[3] = {1, 2, 5};
    const int all = chart->height > 45 * log10(chart->y[1] / chart->y[0]);
    for (int power = -9; power <= 9; ++power)
        for (int k = 0; k < 3; ++k)
            for (int vertical = 1; vertical >= 0; --vertical)
                ex_chart_line(canvas, chart, vertical, steps[k] * pow(10, power), k ? 0xe8e8e8 : 0xc0c0c0,
                              vertical || k == 0 || all);
}

/* Four to ten lines at round values. */
static inline void ex_chart_steps(ex_canvas *canvas, const ex_chart *chart, int vertical) {
    const double last = vertical ? chart->x[1] : chart->y[1], decade = pow(10, floor(log10(last / 4)));
    const double step = decade * (last / decade >= 20 ? 5 : last / decade >= 10 ? 2 : 1);
    for (int i = 0; i * step <= last; ++i) ex_chart_line(canvas, chart, vertical, i * step, 0xe8e8e8, 1);
}

/* The axes, grid lines, and what they stand for. */
static inline void ex_chart_frame(ex_canvas *canvas, const ex_chart *chart) {
    const int right = chart->left + chart->width, bottom = chart->top + chart->height;
    if (!chart->plain) ex_chart_decades(canvas, chart);
    for (int vertical = 0; chart->plain && vertical < 2; ++vertical) ex_chart_steps(canvas, chart, vertical);
    ex_canvas_line(canvas, chart->left, chart->top, chart->left, bottom, 1, 0x404040);
    ex_canvas_line(canvas, chart->left, bottom, right, bottom, 1, 0x404040);
    ex_canvas_text(canvas, chart->left, chart->top - 13, chart->title, 0x000000);
    ex_canvas_text(canvas, right - ex_text_width(chart->x_name), bottom + 17, chart->x_name, 0x404040);
}

/* Points joined in their order; on logarithmic axes those with a zero are left out. */
static inline void ex_chart_curve(ex_canvas *canvas, const ex_chart *chart, const double (*points)[2], int count,
                                  ex_mark mark, unsigned color) {
    for (int i = 0; i < count; ++i) {
        if (!chart->plain && !(points[i][0] > 0 && points[i][1] > 0)) continue;
        const double x = ex_chart_x(chart, points[i][0]), y = ex_chart_y(chart, points[i][1]);
        if (i > 0 && (chart->plain || (points[i - 1][0] > 0 && points[i - 1][1] > 0)))
            ex_canvas_line(canvas, ex_chart_x(chart, points[i - 1][0]), ex_chart_y(chart, points[i - 1][1]), x, y, 1.4,
                           color);
        ex_canvas_mark(canvas, x, y, mark, color);
    }
}

/* A sample of a curve and its name. */
static inline void ex_chart_key(ex_canvas *canvas, int x, int y, const char *name, ex_mark mark, unsigned color) {
    ex_canvas_line(canvas, x, y + 3, x + 20, y + 3, 1.4, color);
    ex_canvas_mark(canvas, x + 10, y + 3, mark, color);
    ex_canvas_text(canvas, x + 28, y, name, 0x000000);
}

/* =============================================================================================== >>pictures */

/* Copies a picture made smaller by a whole number, each pixel the mean of `shrink`^2, with its name below. */
static inline void ex_canvas_picture(ex_canvas *canvas, int x, int y, const float *rgba, int width, int height,
                                     int shrink, const char *name) {
    for (int j = 0; j < height / shrink; ++j)
        for (int i = 0; i < width / shrink; ++i) {
            float *to = ex_canvas_pixel(canvas, x + i, y + j);
            for (int c = 0; to && c < 3; ++c) {
                double sum = 0;
                for (int k = 0; k < shrink * shrink; ++k)
                    sum += (double)rgba[4 * ((size_t)(j * shrink + k / shrink) * (size_t)width +
                                             (size_t)(i * shrink + k % shrink)) +
                                        (size_t)c];
                to[c] = (float)(sum / (shrink * shrink));
            }
        }
    ex_canvas_text(canvas, x, y + height / shrink + 3, name, 0x000000);
}

/* ================================================================================================ >>writing */

enum { EX_CANVAS_LEVELS = 31 }; /* of each color, besides 0, in what is written */

/* Writes folder/name.png for a document: of few colors, unfiltered and packed with patience, it is a third as large. */
static inline int ex_canvas_write(ex_canvas *canvas, const char *folder, const char *name, ex_error *error) {
    const int usual = stbi_write_png_compression_level;
    char path[4096];
    for (size_t i = 0; i < (size_t)canvas->width * (size_t)canvas->height * 4; ++i) {
        const double code = floor(ex_srgb_code(canvas->rgba[i]) * (EX_CANVAS_LEVELS / 255.0) + 0.5) / EX_CANVAS_LEVELS;
        canvas->rgba[i] = (float)ex_linear_of(code);
    }
    snprintf(path, sizeof path, "%s/%s.png", folder, name);
    stbi_write_png_compression_level = 64, stbi_write_force_png_filter = 0;
    const int failed = ex_write_png(path, canvas->rgba, canvas->width, canvas->height, error);
    stbi_write_png_compression_level = usual, stbi_write_force_png_filter = -1;
    return failed;
}

#endif /* EX_CHART_H */
