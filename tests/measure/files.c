/* files: how fast examples/inflate.h unpacks, beside the program gzip, in processor time on the same data: a procedural
   scan of 16 MB, which is packed by gzip, or a file of yours: files FILE.gz. Without gzip, nothing is measured. */

#include "inflate.h"
#include "files.h"
#include "measuring.h"

#include <sys/resource.h>
#include <sys/wait.h>

enum { SIDE = 256, TURNS = 7 };

static const char *const program = "files";

/* Seconds of this process, or of those that it started and that have ended. */
static double seconds_of(int who) {
    struct rusage use;
    getrusage(who, &use);
    return (double)(use.ru_utime.tv_sec + use.ru_stime.tv_sec) +
           1e-6 * (double)(use.ru_utime.tv_usec + use.ru_stime.tv_usec);
}

/* A cloud of 8 bits, with some noise, as scanners have it. */
static void write_scan(const char *path) {
    ex_error error;
    ex_output output;
    unsigned char row[SIDE];
    uint32_t noise = 1;
    ex_stop_if(ex_output_begin(&output, path, &error), program, &error);
    for (int z = 0; z < SIDE; ++z)
        for (int y = 0; y < SIDE; ++y) {
            for (int x = 0; x < SIDE; ++x) {
                const double dx = x - SIDE / 2, dy = y - SIDE / 2, dz = z - SIDE / 2;
                const double value = 160 - 1.5 * sqrt(dx * dx + dy * dy + dz * dz) + 20 * sin(0.1 * x) * cos(0.07 * y);
                noise = noise * 1664525u + 1013904223u;
                row[x] = value > 0 ? (unsigned char)(value + (noise >> 30)) : (unsigned char)(noise >> 24 > 250);
            }
            ex_output_bytes(&output, row, sizeof row);
        }
    ex_stop_if(ex_output_end(&output, &error), program, &error);
}

/* The processor time of a command, the least of several turns; below 0 if it fails. */
static double time_command(const char *command) {
    double least = DBL_MAX;
    for (int i = 0; i < TURNS; ++i) {
        const double start = seconds_of(RUSAGE_CHILDREN);
        if (system(command) != 0) return -1;
        least = fmin(least, seconds_of(RUSAGE_CHILDREN) - start);
    }
    return least;
}

int main(int argc, char **argv) {
    const char *path = argc > 1 ? argv[1] : "build/measure/scan.raw.gz";
    char command[600], *packed = NULL;
    size_t count = 0;
    ex_error error;
    if (system("gzip --version >/dev/null 2>&1") != 0) {
        printf("inflate: not measured: there is no gzip\n");
        return EX_OK;
    }
    if (argc < 2) {
        write_scan("build/measure/scan.raw");
        if (system("gzip -f build/measure/scan.raw") != 0) return EX_FAILED;
    }
    if (strchr(path, '\'') || strlen(path) > 500) return EX_MISTAKEN;
    ex_stop_if(ex_read_text(path, &packed, &count, &error), program, &error);
    if (count < 18) return EX_MISTAKEN;
    const size_t size = ex_u32((const unsigned char *)packed + count - 4); /* the last member's */
    unsigned char *out = (unsigned char *)ex_allocate(size, 1);
    double least = DBL_MAX;
    for (int i = 0; i < TURNS; ++i) {
        const double start = seconds_of(RUSAGE_SELF);
        ex_stop_if(ex_inflate(path, EX_PACKED_GZIP, (const unsigned char *)packed, count, out, size, NULL, &error),
                   program, &error);
        least = fmin(least, seconds_of(RUSAGE_SELF) - start);
    }
    snprintf(command, sizeof command, "gzip -dc '%s' >/dev/null", path);
    const double gzip = time_command(command);
    printf("inflate: %.1f MB in %.3f s, gzip -dc %.3f s: %.2f times its speed\n", 1e-6 * (double)size, least, gzip,
           gzip / least);
    free(packed);
    free(out);
    return EX_OK;
}
