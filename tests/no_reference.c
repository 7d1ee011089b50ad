/* SPLATSHADOW_NO_REFERENCE: sps_reference says that it was left out, leaves the image alone, and the context renders
   afterwards. */

#include "check.h"

int main(void) {
    sps_context *context = check_context(NULL);
    check_scene s;
    float rgba[4 * 8 * 8], before[4 * 8 * 8];
    sps_reference_settings settings;
    sps_image image;
    memset(&settings, 0, sizeof settings), memset(&image, 0, sizeof image);
    check_clear(&s, 8, 8);
    check_add_puff(&s, 2);
    for (int i = 0; i < 4 * 8 * 8; ++i) rgba[i] = before[i] = (float)i;
    settings.step = 0.5;
    image.rgba = rgba;
    CHECK(sps_reference(context, &s.scene, &s.view, &settings, &image) == SPS_ERROR_UNSUPPORTED);
    CHECK(strstr(sps_error(context), "SPLATSHADOW_NO_REFERENCE") != NULL);
    CHECK(memcmp(rgba, before, sizeof rgba) == 0);
    CHECK_OK(context, sps_render(context, &s.scene, &s.view, &image));
    CHECK(rgba[3] >= 0 && rgba[4 * 36 + 3] > 0.1f);
    sps_destroy(context);
    return check_report();
}
