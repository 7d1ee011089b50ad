/* Light from a source to an orthographic camera: photons in doubles, which share nothing with the library. Each place
   where one is scattered or reflected is seen by all of the picture's rays, so that no distance is divided by: near a
   small source, where paths from the eye are rare and bright, these have little noise. */

#ifndef PHOTONS_H
#define PHOTONS_H

#include "random_scene.h"

enum { PHOTONS_BATCHES = 16, PHOTONS_SIDE = 8, PHOTONS_PIXELS = PHOTONS_SIDE * PHOTONS_SIDE, PHOTONS_MEDIA = 3 };

#define PHOTONS_SIGMA 0.65 /* of a voxel's kernel, in voxels, and how far it reaches */
#define PHOTONS_REACH 3.0

/* A volume, or a particle if there is no volume. */
typedef struct photons_medium {
    const sps_volume *volume;
    const sps_particle *particle;
    int soft, voxels;
    float *values;
    double *sums; /* of values, up to each voxel */
    double inverse[3][3], peak, most;
    double albedo[3], asymmetry, emission[3]; /* per unit of extinction or, of a volume, of value */
} photons_medium;

typedef struct photons_scene {
    const random_scene *x;
    photons_medium media[PHOTONS_MEDIA];
    int count;
    double forward[3], right[3], up[3], pixel;
    double reach;                         /* radius, around the scene's middle, of all that suns shine on */
    unsigned char judged[PHOTONS_PIXELS]; /* not those at the wall's edges */
    check_random random;
} photons_scene;

static inline double photons_density(const photons_medium *m, const double point[3]) {
    double at[3], weights[3][8], offset[3], sum = 0;
    int first[3], last[3];
    if (!m->volume) {
        double square = 0;
        for (int k = 0; k < 3; ++k)
            square += pow((point[k] - (double)m->particle->position[k]) / (double)m->particle->radius, 2);
        return square >= 1 ? 0 : m->soft ? 1 - square : 1;
    }
    for (int k = 0; k < 3; ++k) offset[k] = point[k] - m->volume->placement.origin[k];
    for (int i = 0; i < 3; ++i) {
        const int size = m->volume->size[i];
        at[i] = vec_dot(m->inverse[i], offset) * size - 0.5;
        first[i] = (int)fmax(0, ceil(at[i] - PHOTONS_REACH)),
        last[i] = (int)fmin(size - 1, floor(at[i] + PHOTONS_REACH));
        if (last[i] < first[i]) return 0;
        for (int k = first[i]; k <= last[i]; ++k)
            weights[i][k - first[i]] = exp(-0.5 * pow((k - at[i]) / PHOTONS_SIGMA, 2)) / (sqrt(2 * PI) * PHOTONS_SIGMA);
    }
    for (int z = first[2]; z <= last[2]; ++z)
        for (int y = first[1]; y <= last[1]; ++y) {
            const float *row = m->values + (z * m->volume->size[1] + y) * m->volume->size[0];
            double part = 0;
            for (int v = first[0]; v <= last[0]; ++v) part += weights[0][v - first[0]] * (double)row[v];
            sum += part * weights[1][y - first[1]] * weights[2][z - first[2]];
        }
    return sum;
}

/* The part of a ray where a medium may be. */
static inline int photons_range(const photons_medium *m, const double from[3], const double way[3], double range[2]) {
    range[0] = 0, range[1] = HUGE_VAL;
    if (!m->volume) {
        double offset[3], middle, square;
        const double radius = (double)m->particle->radius;
        for (int k = 0; k < 3; ++k) offset[k] = (double)m->particle->position[k] - from[k];
        middle = vec_dot(offset, way), square = radius * radius - vec_dot(offset, offset) + middle * middle;
        if (!(square > 0)) return 0;
        range[0] = fmax(0, middle - sqrt(square)), range[1] = middle + sqrt(square);
        return range[1] > range[0];
    }
    for (int i = 0; i < 3; ++i) {
        const double reach = (PHOTONS_REACH - 0.5) / m->volume->size[i];
        double offset[3], at, along, a, b;
        for (int k = 0; k < 3; ++k) offset[k] = from[k] - m->volume->placement.origin[k];
        at = vec_dot(m->inverse[i], offset), along = vec_dot(m->inverse[i], way);
        if (fabs(along) < 1e-30) along = 1e-30;
        a = (-reach - at) / along, b = (1 + reach - at) / along;
        range[0] = fmax(range[0], fmin(a, b)), range[1] = fmin(range[1], fmax(a, b));
    }
    return range[1] > range[0];
}

/* Where a photon collides with a medium [Woodcock et al. 1965], or infinity. */
static inline double photons_collision(photons_scene *p, const photons_medium *m, const double from[3],
                                       const double way[3], double limit) {
    double range[2], t;
    if (!(m->most > 0) || !photons_range(m, from, way, range)) return HUGE_VAL;
    for (t = range[0];;) {
        double point[3];
        t -= log1p(-check_next(&p->random)) / m->most;
        if (!(t < fmin(range[1], limit))) return HUGE_VAL;
        for (int k = 0; k < 3; ++k) point[k] = from[k] + t * way[k];
        if (check_next(&p->random) * m->most < m->peak * photons_density(m, point)) return t;
    }
}

/* An estimate of what passes all media up to a distance [Novak et al. 2014]. */
static inline double photons_passes(photons_scene *p, const double from[3], const double way[3], double limit) {
    double passes = 1;
    for (int i = 0; i < p->count; ++i) {
        const photons_medium *m = &p->media[i];
        double range[2];
        if (!(m->most > 0) || !photons_range(m, from, way, range)) continue;
        for (double t = range[0];;) {
            double point[3];
            t -= log1p(-check_next(&p->random)) / (2 * m->most);
            if (!(t < fmin(range[1], limit))) break;
            for (int k = 0; k < 3; ++k) point[k] = from[k] + t * way[k];
            passes *= 1 - m->peak * photons_density(m, point) / (2 * m->most);
        }
    }
    return passes;
}

/* The distance of the wall, whose quad's corners are those of its two triangles, or infinity. */
static inline double photons_wall(const photons_scene *p, const double from[3], const double way[3], double normal[3]) {
    const sps_triangle *t = p->x->triangles.list;
    double nearest = HUGE_VAL;
    if (p->x->s.scene.mesh_count == 0) return nearest;
    for (size_t n = 0; n < p->x->triangles.count; ++n) {
        double a[3], b[3], c[3], q[3], h[3], offset[3], determinant, u, v, d;
        for (int k = 0; k < 3; ++k) {
            a[k] = p->x->scale * (double)t[n].position[0][k];
            b[k] = p->x->scale * (double)t[n].position[1][k] - a[k],
            c[k] = p->x->scale * (double)t[n].position[2][k] - a[k];
            offset[k] = from[k] - a[k];
        }
        vec_cross(way, c, h);
        determinant = vec_dot(b, h);
        if (!(fabs(determinant) > 0)) continue;
        u = vec_dot(offset, h) / determinant;
        vec_cross(offset, b, q);
        v = vec_dot(way, q) / determinant, d = vec_dot(c, q) / determinant;
        if (!(u >= 0 && v >= 0 && u + v <= 1 && d > 1e-9 * p->x->scale && d < nearest)) continue;
        nearest = d;
        vec_cross(b, c, normal);
        vec_normalise(normal);
        if (vec_dot(normal, way) > 0)
            for (int k = 0; k < 3; ++k) normal[k] = -normal[k];
    }
    return nearest;
}

/* Adds what the camera sees of a place that sends so much its way, per steradian. */
static inline void photons_see(photons_scene *p, const double point[3], const double power[3], double *picture) {
    const double *eye = p->x->s.view.camera.position;
    const double back[3] = {-p->forward[0], -p->forward[1], -p->forward[2]};
    double offset[3], depth, passes, normal[3];
    int at[2], pixel;
    for (int k = 0; k < 3; ++k) offset[k] = point[k] - eye[k];
    depth = vec_dot(offset, p->forward);
    at[0] = (int)floor(vec_dot(offset, p->right) / p->pixel + 0.5 * PHOTONS_SIDE);
    at[1] = (int)floor(-vec_dot(offset, p->up) / p->pixel + 0.5 * PHOTONS_SIDE);
    if (depth < 0 || at[0] < 0 || at[1] < 0 || at[0] >= PHOTONS_SIDE || at[1] >= PHOTONS_SIDE) return;
    pixel = at[1] * PHOTONS_SIDE + at[0];
    if (!p->judged[pixel] || photons_wall(p, point, back, normal) < depth) return;
    passes = photons_passes(p, point, back, depth) / (p->pixel * p->pixel);
    for (int c = 0; c < 3; ++c) picture[3 * pixel + c] += passes * power[c];
}

/* Henyey-Greenstein, and a direction by it. */
static inline double photons_phase(double g, double cosine) {
    return (1 - g * g) / (4 * PI * pow(1 + g * g - 2 * g * cosine, 1.5));
}
static inline void photons_about(photons_scene *p, const double axis[3], double cosine, double out[3]) {
    const double turn = 2 * PI * check_next(&p->random), sine = sqrt(fmax(0, 1 - cosine * cosine));
    double u[3] = {0, 0, 0}, v[3], w[3];
    u[fabs(axis[0]) < 0.6 ? 0 : 1] = 1;
    vec_cross(axis, u, v);
    vec_normalise(v);
    vec_cross(axis, v, w);
    for (int k = 0; k < 3; ++k) out[k] = cosine * axis[k] + sine * (cos(turn) * v[k] + sin(turn) * w[k]);
}
static inline void photons_scatter(photons_scene *p, double g, double way[3]) {
    const double u = check_next(&p->random), s = (1 - g * g) / (1 - g + 2 * g * u);
    const double cosine = fabs(g) < 1e-3 ? 2 * u - 1 : (1 + g * g - s * s) / (2 * g);
    double out[3];
    photons_about(p, way, cosine, out);
    memcpy(way, out, sizeof out);
}

/* Follows a photon until it leaves or is weak. */
static inline void photons_follow(photons_scene *p, double from[3], double way[3], double power[3], double *picture) {
    const double back[3] = {-p->forward[0], -p->forward[1], -p->forward[2]};
    double most = fmax(fmax(power[0], power[1]), power[2]);
    for (;;) {
        double normal[3], nearest = photons_wall(p, from, way, normal), sent[3], share;
        const photons_medium *m = NULL;
        for (int i = 0; i < p->count; ++i) {
            const double t = photons_collision(p, &p->media[i], from, way, nearest);
            if (t < nearest) nearest = t, m = &p->media[i];
        }
        if (!(nearest < HUGE_VAL)) return;
        for (int k = 0; k < 3; ++k) from[k] += nearest * way[k];
        for (int c = 0; c < 3; ++c) power[c] *= m ? m->albedo[c] : (double)p->x->s.mesh[0].albedo[c];
        share = m ? photons_phase(m->asymmetry, vec_dot(way, back)) : fmax(0, vec_dot(normal, back)) / PI;
        for (int c = 0; c < 3; ++c) sent[c] = share * power[c];
        if (share > 0) photons_see(p, from, sent, picture);
        if (m)
            photons_scatter(p, m->asymmetry, way);
        else
            photons_about(p, normal, sqrt(check_next(&p->random)), way);
        share = fmax(fmax(power[0], power[1]), power[2]) / most;
        if (share < 0.1) {
            if (check_next(&p->random) > share) return;
            for (int c = 0; c < 3; ++c) power[c] /= share;
        }
    }
}

/* A point of what glows, drawn by its glow. */
static inline void photons_start(photons_scene *p, const photons_medium *m, double out[3]) {
    if (!m->volume) {
        double u[3], square;
        do {
            for (int k = 0; k < 3; ++k) u[k] = 2 * check_next(&p->random) - 1;
            square = vec_dot(u, u);
        } while (square > 1 || (m->soft && check_next(&p->random) > 1 - square));
        for (int k = 0; k < 3; ++k) out[k] = (double)m->particle->position[k] + (double)m->particle->radius * u[k];
        return;
    }
    const int *size = m->volume->size;
    const double goal = check_next(&p->random) * m->sums[m->voxels - 1];
    int low = 0, high = m->voxels - 1;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (m->sums[middle] > goal)
            high = middle;
        else
            low = middle + 1;
    }
    const int at[3] = {low % size[0], low / size[0] % size[1], low / size[0] / size[1]};
    for (int k = 0; k < 3; ++k) out[k] = m->volume->placement.origin[k];
    for (int i = 0; i < 3; ++i) {
        double offset, u;
        do {
            u = check_next(&p->random);
            offset = PHOTONS_SIGMA * sqrt(-2 * log1p(-u)) * cos(2 * PI * check_next(&p->random));
        } while (fabs(offset) > PHOTONS_REACH);
        for (int k = 0; k < 3; ++k) out[k] += (at[i] + 0.5 + offset) / size[i] * m->volume->placement.axis[i][k];
    }
}

/* Intensity of what glows, per steradian. */
static inline void photons_intensity(const photons_medium *m, double out[3]) {
    double extent;
    if (m->volume) {
        const double(*axis)[3] = m->volume->placement.axis;
        extent = fabs(vec_determinant(axis[0], axis[1], axis[2])) * m->sums[m->voxels - 1] / m->voxels;
    } else
        extent = m->peak * 4 * PI / 3 * pow((double)m->particle->radius, 3) * (m->soft ? 0.4 : 1);
    for (int c = 0; c < 3; ++c) out[c] = extent * m->emission[c];
}

/* Suns shine on volumes, and on the wall unless they shine along it. */
static inline double photons_reach(const random_scene *x) {
    const sps_triangle *t = x->triangles.list;
    double square = 0;
    for (int n = 0; n < 8 * x->s.scene.volume_count; ++n) {
        const sps_volume *v = &x->s.volume[n / 8];
        double offset[3];
        for (int k = 0; k < 3; ++k) offset[k] = v->placement.origin[k] - x->offset[k];
        for (int i = 0; i < 3; ++i) {
            const double reach = (PHOTONS_REACH - 0.5) / v->size[i], at = n >> i & 1 ? 1 + reach : -reach;
            for (int k = 0; k < 3; ++k) offset[k] += at * v->placement.axis[i][k];
        }
        square = fmax(square, vec_dot(offset, offset));
    }
    for (size_t n = 0; n < 3 * x->triangles.count; ++n) {
        double b[3], c[3], normal[3], corner[3];
        int lit = 0;
        for (int k = 0; k < 3; ++k) {
            const float(*at)[3] = t[n / 3].position;
            corner[k] = x->scale * (double)at[n % 3][k];
            b[k] = (double)at[1][k] - (double)at[0][k], c[k] = (double)at[2][k] - (double)at[0][k];
        }
        vec_cross(b, c, normal);
        for (int i = 0; i < x->s.scene.light_count; ++i)
            lit |= fabs(vec_dot(normal, x->s.light[i].direction)) > 1e-6 * vec_length(normal);
        if (lit) square = fmax(square, vec_dot(corner, corner));
    }
    return sqrt(square);
}

static inline int photons_begin(photons_scene *p, const random_scene *x) {
    static const int zero[3] = {0, 0, 0};
    const sps_camera *camera = &x->s.view.camera;
    memset(p, 0, sizeof *p);
    p->x = x, p->random.state = 12345;
    for (int i = 0; i < x->s.scene.volume_count; ++i) {
        photons_medium *m = &p->media[p->count++];
        const sps_volume *v = m->volume = &x->s.volume[i];
        float most = 0;
        double sum = 0, d = vec_determinant(v->placement.axis[0], v->placement.axis[1], v->placement.axis[2]);
        for (int a = 0; a < 3; ++a) {
            vec_cross(v->placement.axis[(a + 1) % 3], v->placement.axis[(a + 2) % 3], m->inverse[a]);
            for (int k = 0; k < 3; ++k) m->inverse[a][k] /= d;
        }
        m->voxels = v->size[0] * v->size[1] * v->size[2];
        m->values = (float *)malloc((size_t)m->voxels * sizeof(float));
        m->sums = (double *)malloc((size_t)m->voxels * sizeof(double));
        if (!m->values || !m->sums || v->read_fn(v->user, zero, v->size, m->values)) return 0;
        for (int n = 0; n < m->voxels; ++n) most = fmaxf(most, m->values[n]), m->sums[n] = sum += (double)m->values[n];
        m->peak = (double)v->extinction, m->most = 1.1 * m->peak * (double)most;
        m->asymmetry = v->lobe_count ? (double)v->lobes[0].asymmetry : 0;
        for (int c = 0; c < 3; ++c) m->albedo[c] = (double)v->albedo[c], m->emission[c] = (double)v->emission[c];
    }
    for (int i = 0; i < x->s.scene.particle_set_count; ++i) {
        photons_medium *m = &p->media[p->count++];
        m->particle = &x->crowds[i].list[0], m->soft = x->sets[i].soft;
        m->peak = m->most =
            (double)m->particle->optical_depth / ((double)m->particle->radius * (m->soft ? 4 / 3.0 : 2));
        for (int c = 0; c < 3; ++c)
            m->albedo[c] = (double)x->sets[i].albedo[c], m->emission[c] = (double)x->sets[i].emission[c];
    }
    for (int k = 0; k < 3; ++k) p->forward[k] = camera->target[k] - camera->position[k];
    vec_normalise(p->forward);
    vec_cross(p->forward, camera->up, p->right);
    vec_normalise(p->right);
    vec_cross(p->right, p->forward, p->up);
    p->pixel = camera->ortho_height / PHOTONS_SIDE, p->reach = photons_reach(x);
    for (int i = 0; i < PHOTONS_PIXELS; ++i) { /* all corners show the wall, or none does */
        int hits = 0;
        for (int corner = 0; corner < 4; ++corner) {
            const double u = i % PHOTONS_SIDE + corner % 2 - 0.5 * PHOTONS_SIDE,
                         v = 0.5 * PHOTONS_SIDE - i / PHOTONS_SIDE - corner / 2;
            double from[3], normal[3];
            for (int k = 0; k < 3; ++k) from[k] = camera->position[k] + p->pixel * (u * p->right[k] + v * p->up[k]);
            hits += photons_wall(p, from, p->forward, normal) < HUGE_VAL;
        }
        p->judged[i] = hits % 4 == 0;
    }
    return 1;
}

static inline void photons_end(photons_scene *p) {
    for (int i = 0; i < p->count; ++i) free(p->media[i].values), free(p->media[i].sums);
}

/* One photon of each source. `share`: one over their number. */
static inline void photons_send(photons_scene *p, double share, double *picture) {
    double from[3], way[3], power[3];
    for (int i = 0; i < p->count; ++i) {
        const photons_medium *m = &p->media[i];
        photons_intensity(m, power);
        if (!(power[0] + power[1] + power[2] > 0)) continue;
        photons_start(p, m, from);
        for (int c = 0; c < 3; ++c) power[c] *= share;
        photons_see(p, from, power, picture);
        for (int c = 0; c < 3; ++c) power[c] *= 4 * PI;
        photons_about(p, p->forward, 2 * check_next(&p->random) - 1, way);
        photons_follow(p, from, way, power, picture);
    }
    for (int i = 0; i < p->x->s.scene.light_count; ++i) {
        const sps_light *light = &p->x->s.light[i];
        const double radius = p->reach, r = radius * sqrt(check_next(&p->random));
        const int is_lamp = light->kind == SPS_LIGHT_POINT;
        for (int c = 0; c < 3; ++c)
            power[c] = share * (double)light->color[c] * (is_lamp ? 4 * PI : PI * radius * radius);
        if (is_lamp) {
            memcpy(from, light->position, sizeof from);
            photons_about(p, p->forward, 2 * check_next(&p->random) - 1, way);
        } else {
            double across[3];
            memcpy(way, light->direction, sizeof way);
            vec_normalise(way);
            photons_about(p, way, 0, across);
            for (int k = 0; k < 3; ++k) from[k] = r * across[k] - 2 * radius * way[k];
        }
        photons_follow(p, from, way, power, picture);
    }
}

#endif /* PHOTONS_H */
