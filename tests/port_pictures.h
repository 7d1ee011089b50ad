/* port_pictures.h: five pictures that builds of the header are compared by, written as floats in text, and that
 * comparison. */

#ifndef PORT_PICTURES_H
#define PORT_PICTURES_H

#include "check.h"

enum { PICTURES = 5, ACROSS = 48, DOWN = 36, FLOATS = 4 * ACROSS * DOWN };

static const char *const picture_names[PICTURES] = {"gas over a floor", "surfaces of a scan", "particles and a light",
                                                    "translucent, soft sun", "multiple scattering"};
static check_triangles floor_of_ports, panes_of_ports;

static void look_from_above(check_scene *s) {
    check_clear(s, ACROSS, DOWN);
    check_perspective(&s->view.camera, 0.7);
    check_set3(s->view.camera.position, 1.5, 2, 4);
    check_set3(s->view.camera.target, 0, -0.2, 0);
}

static void add_floor(check_scene *s, double reflectance) { check_add_mesh(s, &floor_of_ports, reflectance); }

static void build_picture(check_scene *s, int number) {
    static const sps_transfer_point points[3] = {{0.2f, {0.8f, 0.6f, 0.4f}, 0, {0, 0, 0}},
                                                 {0.3f, {0.8f, 0.6f, 0.4f}, 20, {0, 0, 0}},
                                                 {1, {0.3f, 0.6f, 0.9f}, 40, {0, 0, 0}}};
    static const sps_transfer looks = {points, 3, NULL, NULL, 0};
    sps_volume *gas;
    look_from_above(s);
    if (number == 0 || number == 4) {
        gas = check_add_puff(s, 4);
        check_color(gas->albedo, 0.9, 0.8, 0.7);
        add_floor(s, 0.6);
        check_add_directional(s, 0.5, -1, -0.3, 3);
    } else if (number == 1) {
        gas = check_add_puff(s, 1);
        gas->transfer = &looks, gas->shading = SPS_SHADING_SURFACE;
        check_add_directional(s, 0.5, -1, -0.3, 3);
        s->view.quality = SPS_QUALITY_HIGH;
    } else if (number == 2) {
        check_add_swarm(s, 1);
        add_floor(s, 0.5);
        check_add_point(s, 0.6, 1.2, 0.8, 3)->shadow_source = SPS_SHADOW_TABLE;
        s->view.scattering = SPS_SCATTERING_FORWARD;
    } else {
        add_floor(s, 0.7);
        check_translucent(check_add_mesh(s, &panes_of_ports, 0.3), 0.5);
        check_add_directional(s, 0.4, -1, -0.2, 3)->angular_diameter = 0.2;
        s->view.coverage_samples = 3;
    }
    if (number == 4) s->view.scattering = SPS_SCATTERING_MULTIPLE, s->view.scattering_resolution = 12;
    check_color(s->scene.ambient, 0.1, 0.12, 0.15);
}

static int write_pictures(const char *path) {
    static float rgba[FLOATS];
    const double corner[3] = {-3, -1.1, 3}, u[3] = {6, 0, 0}, v[3] = {0, 0, -6};
    FILE *file = fopen(path, "w");
    if (!file) return 1;
    check_add_quad(&floor_of_ports, corner, u, v);
    for (int i = 0; i < 4; ++i) {
        const double at[3] = {-0.9 + 0.4 * i, -1 + 0.3 * i, 0.3 - 0.3 * i}, side[3] = {0.5, 0.1, 0},
                     up[3] = {0, 0.6, 0.2};
        check_add_quad(&panes_of_ports, at, side, up);
    }
    for (int n = 0; n < PICTURES; ++n) {
        check_scene s;
        build_picture(&s, n);
        check_render_plain(&s, rgba);
        for (int i = 0; i < FLOATS; ++i) fprintf(file, "%.9g\n", (double)rgba[i]);
    }
    check_free_triangles(&floor_of_ports), check_free_triangles(&panes_of_ports);
    return fclose(file) != 0;
}

static int read_picture(FILE *file, float *rgba) {
    for (int i = 0; i < FLOATS; ++i)
        if (!file || fscanf(file, "%f", &rgba[i]) != 1) return 1;
    return 0;
}

/* Prints the largest difference of two files, in units of the picture's maximum, and which picture has it. */
static int compare_pictures(const char *a, const char *b) {
    static float left[FLOATS], right[FLOATS];
    FILE *files[2] = {fopen(a, "r"), fopen(b, "r")};
    double largest = 0;
    int of = 0;
    for (int n = 0; n < PICTURES; ++n) {
        double off = 0, most = 0;
        if (read_picture(files[0], left) || read_picture(files[1], right)) return 1;
        for (int i = 0; i < FLOATS; ++i) {
            const double here = fabs((double)left[i] - (double)right[i]), size = fabs((double)left[i]);
            if (!(here <= off)) off = here; /* NaN stays */
            if (size > most) most = size;
        }
        if (!(off / most <= largest)) largest = off / most, of = n;
    }
    printf("%.2g, %s\n", largest, largest > 0 ? picture_names[of] : "all the same");
    return 0;
}

#endif
