/* thickness.h: the length of each pixel's ray inside a closed mesh, for fog with a polygon border. */

#ifndef EX_THICKNESS_H
#define EX_THICKNESS_H

#include "mesh.h"
#include "vectors.h"

/* The rays of a view that has a position, a target and an up vector; no matrix, no region. */
typedef struct ex_camera {
    ex_vec eye, right, up, forward;
    double scale; /* pixels per unit of x / z; orthographic: per unit of x */
    int perspective, width, height;
} ex_camera;

static inline ex_camera ex_camera_of(const sps_view *view) {
    const sps_camera *from = &view->camera;
    ex_camera c;
    c.eye = ex_vec_of(from->position[0], from->position[1], from->position[2]);
    c.forward = ex_vec_unit(ex_vec_sub(ex_vec_of(from->target[0], from->target[1], from->target[2]), c.eye));
    c.right = ex_vec_unit(ex_vec_cross(c.forward, ex_vec_of(from->up[0], from->up[1], from->up[2])));
    c.up = ex_vec_cross(c.right, c.forward);
    c.perspective = from->field_of_view > 0;
    c.width = view->width, c.height = view->height;
    c.scale = c.perspective ? 0.5 * c.height / tan(0.5 * from->field_of_view) : c.height / from->ortho_height;
    return c;
}

/* x to the right, y up, z away from the eye. */
static inline ex_vec ex_camera_space(const ex_camera *camera, const float position[3]) {
    const ex_vec d = ex_vec_sub(ex_vec_of((double)position[0], (double)position[1], (double)position[2]), camera->eye);
    return ex_vec_of(ex_vec_dot(d, camera->right), ex_vec_dot(d, camera->up), ex_vec_dot(d, camera->forward));
}

#define EX_SUBPIXELS  256.0       /* corners are rounded to 1 / 256 pixel; what follows is exact */
#define EX_SCREEN_MAX 536870912.0 /* in such steps: products of two differences fit in 64 bits */

typedef struct ex_thickness {
    ex_camera camera;
    double near;        /* z at which triangles are cut, so that no corner is beyond EX_SCREEN_MAX */
    const float *depth; /* where each ray ends; NULL: nowhere */
    double *sums;       /* for each pixel */
} ex_thickness;

/* A triangle in the camera's space. */
typedef struct ex_facet {
    ex_vec corner[3], normal;
    double nearest, furthest; /* z */
} ex_facet;

static inline ex_facet ex_facet_of(const ex_camera *camera, const sps_triangle *triangle) {
    ex_facet f;
    for (int i = 0; i < 3; ++i) f.corner[i] = ex_camera_space(camera, triangle->position[i]);
    f.normal = ex_vec_cross(ex_vec_sub(f.corner[1], f.corner[0]), ex_vec_sub(f.corner[2], f.corner[0]));
    f.nearest = fmax(fmin(f.corner[0].z, fmin(f.corner[1].z, f.corner[2].z)), 0);
    f.furthest = fmax(f.corner[0].z, fmax(f.corner[1].z, f.corner[2].z));
    return f;
}

/* Cuts off what is nearer than `near`, which leaves 0, 3 or 4 corners. An edge is always cut starting from its far end,
   so that both triangles at the edge get the same corner. */
static inline int ex_facet_cut(const ex_facet *facet, double near, ex_vec out[4]) {
    int count = 0;
    for (int i = 0; i < 3; ++i) {
        const ex_vec a = facet->corner[i], b = facet->corner[(i + 1) % 3];
        if (a.z >= near) out[count++] = a;
        if ((a.z >= near) == (b.z >= near)) continue;
        const ex_vec from = a.z >= near ? a : b, to = a.z >= near ? b : a;
        const double t = (from.z - near) / (from.z - to.z);
        out[count++] = ex_vec_of(ex_mix(from.x, to.x, t), ex_mix(from.y, to.y, t), near);
    }
    return count;
}

/* The position of a point in the image, in steps from the upper left corner. */
static inline void ex_thickness_project(const ex_camera *camera, ex_vec p, int64_t out[2]) {
    const double scale = camera->perspective ? camera->scale / p.z : camera->scale;
    const double x = (0.5 * camera->width + scale * p.x) * EX_SUBPIXELS;
    const double y = (0.5 * camera->height - scale * p.y) * EX_SUBPIXELS;
    out[0] = (int64_t)floor(ex_clamp(x, -EX_SCREEN_MAX, EX_SCREEN_MAX) + 0.5);
    out[1] = (int64_t)floor(ex_clamp(y, -EX_SCREEN_MAX, EX_SCREEN_MAX) + 0.5);
}

/* The side of the edge a -> b that a point lies on: positive inside a triangle that is clockwise in the image. Never 0:
   a point on the edge counts as infinitesimally further right, and by an infinitesimal of second order further down. So
   it belongs to exactly one of the two triangles at an edge, and to one of those around a corner. */
static inline int64_t ex_side(const int64_t a[2], const int64_t b[2], const int64_t p[2]) {
    const int64_t dx = b[0] - a[0], dy = b[1] - a[1], side = dx * (p[1] - a[1]) - dy * (p[0] - a[0]);
    if (side != 0) return side;
    return dy < 0 || (dy == 0 && dx > 0) ? 1 : -1;
}

/* Adds, with a sign, the distance along a pixel's ray to the facet's plane. Since corners are rounded, a pixel may lie
   slightly beyond the facet's edge; the clamp keeps an intersection with a facet seen edge-on from being far away. */
static inline void ex_thickness_add(const ex_thickness *all, const ex_facet *facet, int x, int y, double sign) {
    const ex_camera *c = &all->camera;
    const ex_vec ray =
        ex_vec_of((x + 0.5 - 0.5 * c->width) / c->scale, (0.5 * c->height - y - 0.5) / c->scale, c->perspective);
    const size_t pixel = (size_t)y * (size_t)c->width + (size_t)x;
    const double reach = ex_vec_dot(facet->normal, facet->corner[0]), across = ex_vec_dot(facet->normal, ray);
    const double met = c->perspective ? reach / across : (reach - across) / facet->normal.z;
    const double z = met == met ? ex_clamp(met, facet->nearest, facet->furthest) : facet->nearest;
    const double distance = c->perspective ? z * ex_vec_length(ray) : z;
    all->sums[pixel] += sign * (all->depth ? fmin(distance, (double)all->depth[pixel]) : distance);
}

/* Visits all pixels whose centers lie in a triangle of the image. Back faces add, front faces subtract. */
static inline void ex_thickness_fill(const ex_thickness *all, const ex_facet *facet, int64_t corner[3][2]) {
    const int size[2] = {all->camera.width, all->camera.height};
    const int64_t *a = corner[0], *b = corner[1], *c = corner[2];
    const int64_t area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    int first[2], last[2];
    if (area == 0) return;
    if (area < 0) b = corner[2], c = corner[1];
    for (int i = 0; i < 2; ++i) {
        const int64_t low = a[i] < b[i] ? (a[i] < c[i] ? a[i] : c[i]) : (b[i] < c[i] ? b[i] : c[i]);
        const int64_t high = a[i] > b[i] ? (a[i] > c[i] ? a[i] : c[i]) : (b[i] > c[i] ? b[i] : c[i]);
        first[i] = (int)ex_clamp(floor((double)low / EX_SUBPIXELS), 0, size[i]);
        last[i] = (int)ex_clamp(ceil((double)high / EX_SUBPIXELS), 0, size[i]);
    }
    for (int y = first[1]; y < last[1]; ++y)
        for (int x = first[0]; x < last[0]; ++x) {
            const int64_t p[2] = {(int64_t)((x + 0.5) * EX_SUBPIXELS), (int64_t)((y + 0.5) * EX_SUBPIXELS)};
            if (ex_side(a, b, p) > 0 && ex_side(b, c, p) > 0 && ex_side(c, a, p) > 0)
                ex_thickness_add(all, facet, x, y, area > 0 ? 1 : -1);
        }
}

/* The largest distance of a corner of the mesh from the eye. */
static inline double ex_thickness_reach(const ex_camera *camera, const ex_mesh *mesh) {
    double reach = 0;
    for (size_t t = 0; t < mesh->triangle_count; ++t)
        for (int c = 0; c < 3; ++c)
            reach = fmax(reach, ex_vec_length(ex_camera_space(camera, mesh->triangles[t].position[c])));
    return reach;
}

/* Adds to sums[y * width + x] the length of that pixel's ray inside a closed mesh: the distances to where the ray
   leaves the mesh minus the distances to where it enters, in any order, since they are only added. Where the mesh
   overlaps itself, each layer counts. A ray starts at the eye, which may be inside, and ends at depth[y * width + x]
   (sps_image.depth; NULL: it does not end). Neither needs extra work: what lies beyond an end adds as much as it
   subtracts. Triangles are counter-clockwise as seen from outside, as ex_shape_field makes them. */
static inline void ex_mesh_thickness(const ex_mesh *mesh, const sps_view *view, const float *depth, double *sums) {
    ex_thickness all;
    all.camera = ex_camera_of(view);
    all.near = 0;
    all.depth = depth, all.sums = sums;
    if (all.camera.perspective)
        all.near = ex_thickness_reach(&all.camera, mesh) * all.camera.scale * EX_SUBPIXELS / EX_SCREEN_MAX;
    for (size_t t = 0; t < mesh->triangle_count; ++t) {
        const ex_facet facet = ex_facet_of(&all.camera, &mesh->triangles[t]);
        ex_vec cut[4];
        const int count = ex_facet_cut(&facet, all.near, cut);
        for (int i = 1; i < count - 1; ++i) {
            int64_t corner[3][2];
            ex_thickness_project(&all.camera, cut[0], corner[0]);
            ex_thickness_project(&all.camera, cut[i], corner[1]);
            ex_thickness_project(&all.camera, cut[i + 1], corner[2]);
            ex_thickness_fill(&all, &facet, corner);
        }
    }
}

#endif /* EX_THICKNESS_H */
