/* impostor.h: what an impostor, a card that stands for a scene, needs besides its picture: normals of gas and depths.

   The normal of a pixel is the direction of -(integral of T grad(extinction)) along its ray, where T is transmittance
   from the eye: the mean gradient of what is seen, turned outwards. Its axes are the card's: right, up, towards the
   eye. Where coverage is below 1/1024, or without a gradient, it points to the eye: 0, 0, 1.
   Three renders find it. Gas becomes black. It hides two copies of itself that glow by their extinction without
   absorbing, a red one and a green one, which are moved a little back and forth along a direction: red minus green is
   the difference of extinction, weighted by T. Gas in a slab counts as mixed. The three directions stand alike to the
   view, so that slabs do: their errors then have the same factor. Volumes with eval_fn cannot be moved. */

#ifndef EX_IMPOSTOR_H
#define EX_IMPOSTOR_H

#include "six_way.h"

/* A set of particles elsewhere. */
typedef struct ex_impostor_set {
    const sps_particles *from;
    double shift[3];
    float weight; /* factor on optical depth */
} ex_impostor_set;

static inline int ex_impostor_read(void *user, size_t first, size_t count, sps_particle *out) {
    const ex_impostor_set *set = (const ex_impostor_set *)user;
    if (set->from->read_fn(set->from->user, first, count, out)) return 1;
    for (size_t i = 0; i < count; ++i) {
        for (int a = 0; a < 3; ++a) out[i].position[a] = (float)((double)out[i].position[a] + set->shift[a]);
        out[i].optical_depth *= set->weight;
    }
    return 0;
}

/* A scene of black gas with its two glowing copies. */
typedef struct ex_impostor {
    sps_scene scene;
    sps_volume *volumes;
    sps_transfer *transfers;
    sps_transfer_point **points;
    sps_particles *particles;
    ex_impostor_set *sets;
    sps_mesh *meshes;
} ex_impostor;

/* The transfer function of a black volume, or of a copy that glows in a channel. */
static inline void ex_impostor_transfer(const sps_transfer *from, int channel, sps_transfer *to,
                                        sps_transfer_point **points) {
    const size_t count = (size_t)from->point_count;
    *points = (sps_transfer_point *)ex_allocate(count, sizeof **points);
    for (size_t i = 0; i < count; ++i) {
        sps_transfer_point *point = &(*points)[i];
        point->value = from->points[i].value;
        if (channel < 0)
            point->extinction = from->points[i].extinction;
        else
            point->emission[channel] = from->points[i].extinction;
    }
    *to = *from;
    to->points = *points;
}

static inline void ex_impostor_volume(const sps_volume *from, int channel, const double shift[3], sps_volume *to) {
    static const float none[3] = {0, 0, 0};
    *to = *from;
    to->appearance_fn = NULL, to->shading = SPS_SHADING_GAS;
    memcpy(to->albedo, none, sizeof none), memcpy(to->emission, none, sizeof none);
    memcpy(to->ambient, none, sizeof none);
    if (channel < 0) return;
    to->extinction = 0, to->emission[channel] = from->extinction;
    for (int a = 0; a < 3; ++a) to->placement.origin[a] += shift[a];
}

/* Particles glow in proportion to optical depth. Copies keep 2^-14 of it, which absorbs next to nothing. */
static inline void ex_impostor_particles(const sps_particles *from, int channel, const double shift[3],
                                         ex_impostor_set *set, sps_particles *to) {
    static const float none[3] = {0, 0, 0}, many = 16384;
    *to = *from;
    to->has_albedos = 0;
    memcpy(to->albedo, none, sizeof none), memcpy(to->emission, none, sizeof none);
    memcpy(to->ambient, none, sizeof none);
    if (channel < 0) return;
    set->from = from, set->weight = 1 / many;
    memcpy(set->shift, shift, sizeof set->shift);
    to->read_fn = ex_impostor_read, to->user = set;
    to->emission[channel] = many;
}

static inline void ex_impostor_free(ex_impostor *made) {
    for (int i = 0; i < made->scene.volume_count; ++i) free(made->points[i]);
    free(made->volumes), free(made->transfers), free(made->points);
    free(made->particles), free(made->sets), free(made->meshes);
}

/* Copies are moved by `step` along an axis: red by -step, so that it shows what lies ahead, and green by +step. */
static inline void ex_impostor_begin(const sps_scene *scene, const double step[3], ex_impostor *made) {
    const int volumes = scene->volume_count, sets = scene->particle_set_count;
    memset(made, 0, sizeof *made);
    made->volumes = (sps_volume *)ex_allocate(3 * (size_t)volumes, sizeof *made->volumes);
    made->transfers = (sps_transfer *)ex_allocate(3 * (size_t)volumes, sizeof *made->transfers);
    made->points = (sps_transfer_point **)ex_allocate(3 * (size_t)volumes, sizeof *made->points);
    made->particles = (sps_particles *)ex_allocate(3 * (size_t)sets, sizeof *made->particles);
    made->sets = (ex_impostor_set *)ex_allocate(3 * (size_t)sets, sizeof *made->sets);
    made->meshes = (sps_mesh *)ex_allocate((size_t)scene->mesh_count, sizeof *made->meshes);
    for (int channel = -1; channel < 2; ++channel) {
        double shift[3];
        for (int a = 0; a < 3; ++a) shift[a] = channel ? step[a] : -step[a];
        for (int i = 0; i < volumes; ++i) {
            const int k = (channel + 1) * volumes + i;
            ex_impostor_volume(&scene->volumes[i], channel, shift, &made->volumes[k]);
            if (!scene->volumes[i].transfer) continue;
            ex_impostor_transfer(scene->volumes[i].transfer, channel, &made->transfers[k], &made->points[k]);
            made->volumes[k].transfer = &made->transfers[k];
        }
        for (int i = 0; i < sets; ++i) {
            const int k = (channel + 1) * sets + i;
            ex_impostor_particles(&scene->particles[i], channel, shift, &made->sets[k], &made->particles[k]);
        }
    }
    for (int i = 0; i < scene->mesh_count; ++i) { /* black, and grey where they let light pass */
        sps_mesh *mesh = &made->meshes[i];
        *mesh = scene->meshes[i];
        const float grey = (mesh->transmittance[0] + mesh->transmittance[1] + mesh->transmittance[2]) / 3.0f;
        for (int c = 0; c < 3; ++c) mesh->albedo[c] = 0, mesh->transmittance[c] = grey;
        mesh->has_albedos = 0, mesh->shade_fn = NULL;
    }
    made->scene.volumes = made->volumes, made->scene.volume_count = 3 * volumes;
    made->scene.particles = made->particles, made->scene.particle_set_count = 3 * sets;
    made->scene.meshes = made->meshes, made->scene.mesh_count = scene->mesh_count;
    made->scene.replace_invalid = scene->replace_invalid;
}

/* Part of a pixel by which copies are moved: little beside the depth that light goes into dense gas. */
#define EX_IMPOSTOR_STEP 0.0625

/* `glow` is six times the coverage, roughly. Differences of less than 1e-5 of it are rounding. */
static inline void ex_impostor_unit(float normal[3], double glow) {
    const double a = (double)normal[0], b = (double)normal[1], c = (double)normal[2]; /* along the three directions */
    const ex_vec n = ex_vec_of((2 * a - b - c) / 3, (b - c) / sqrt(3), (a + b + c) / 3);
    const double length = ex_vec_length(n);
    const int is_seen = glow > 6.0 / 1024 && length > 1e-5 * glow;
    ex_store(normal, is_seen ? ex_vec_scale(n, 1 / length) : ex_vec_of(0, 0, 1));
}

/* Writes three numbers per pixel of an orthographic view. */
static inline sps_result ex_impostor_normals(sps_context *context, const sps_scene *scene, const sps_view *view,
                                             float *normals) {
    const ex_card_axes axes = ex_card_axes_of(&view->camera);
    const size_t pixels = (size_t)view->width * (size_t)view->height;
    float *rgba = (float *)ex_allocate(pixels, 4 * sizeof *rgba), *sums = (float *)ex_allocate(pixels, sizeof *sums);
    sps_result result = SPS_OK;
    sps_view plain = *view;
    plain.scattering = SPS_SCATTERING_SINGLE, plain.no_shadows = 1;
    for (int way = 0; way < 3 && result == SPS_OK; ++way) {
        const double turn = 2 * EX_PI / 3 * way;
        const ex_vec across = ex_vec_add(ex_vec_scale(axes.right, cos(turn)), ex_vec_scale(axes.up, sin(turn)));
        const ex_vec along = ex_vec_add(across, axes.front);
        const double move = EX_IMPOSTOR_STEP * view->camera.ortho_height / view->height;
        const double step[3] = {move * along.x, move * along.y, move * along.z};
        ex_impostor made;
        sps_image image;
        memset(&image, 0, sizeof image);
        image.rgba = rgba;
        ex_impostor_begin(scene, step, &made);
        result = sps_render(context, &made.scene, &plain, &image);
        ex_impostor_free(&made);
        for (size_t i = 0; i < pixels && result == SPS_OK; ++i) {
            normals[3 * i + (size_t)way] = rgba[4 * i + 1] - rgba[4 * i];
            sums[i] += rgba[4 * i] + rgba[4 * i + 1];
        }
    }
    for (size_t i = 0; i < pixels && result == SPS_OK; ++i) ex_impostor_unit(normals + 3 * i, (double)sums[i]);
    free(rgba), free(sums);
    return result;
}

/* A depth from 0 at the near end of a range to 1 at the far end, where nothing is as well. */
static inline float ex_impostor_depth(float depth, const double range[2]) {
    const double u = ((double)depth - range[0]) / (range[1] - range[0]);
    return (float)(u < 1 ? fmax(u, 0) : 1);
}

/* Divides radiance by alpha. Pixels without alpha take the mean of their neighbours, so that filters give no rim. */
static inline void ex_impostor_straight(const float *rgba, int size, float *out) {
    for (int i = 0; i < size * size; ++i) {
        float sum[3] = {0, 0, 0}, count = 0;
        const int reach = rgba[4 * i + 3] > 0.0f ? 0 : 1, x = i % size, y = i / size;
        for (int v = y - reach; v <= y + reach; ++v)
            for (int u = x - reach; u <= x + reach; ++u) {
                const float *from = rgba + 4 * (v * size + u);
                if (u < 0 || u >= size || v < 0 || v >= size || !(from[3] > 0.0f)) continue;
                for (int c = 0; c < 3; ++c) sum[c] += from[c] / from[3];
                count += 1.0f;
            }
        for (int c = 0; c < 3; ++c) out[4 * i + c] = count > 0.0f ? sum[c] / count : 0.0f;
        out[4 * i + 3] = rgba[4 * i + 3];
    }
}

#endif /* EX_IMPOSTOR_H */
