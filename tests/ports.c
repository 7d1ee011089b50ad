/* ports: what a target's build of the header shows, for `make ports`.
   ports FILE               runs the tests of test_pictures.c, renders five pictures, and writes their floats as text
   ports compare FILE FILE  prints the largest difference of two such files, in units of each picture's maximum */

#define main pictures_main
#include "test_pictures.c"
#undef main
#include "port_pictures.h"

int main(int argc, char **argv) {
    int failed;
    if (argc == 4 && !strcmp(argv[1], "compare")) return compare_pictures(argv[2], argv[3]);
    if (argc != 2) return 2;
    failed = pictures_main();
    return write_pictures(argv[1]) || failed;
}
