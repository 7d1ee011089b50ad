/* web_pictures FILE: the pictures of the page's scenes by a native build, for tests/web.mjs: 320 x 240 of four floats.
 */

#include "../examples/web/web.c"

int main(int argc, char **argv) {
    FILE *file = argc > 1 ? fopen(argv[1], "wb") : NULL;
    if (!file) return 1;
    for (int scene = BLOB; scene <= PARTICLES; ++scene)
        if (web_choose(scene) || web_frame(320, 240, 0, SPS_QUALITY_MEDIUM) ||
            fwrite(web_rgba(), 4 * sizeof(float), 320 * 240, file) != 320 * 240)
            return 1;
    return fclose(file) != 0;
}
