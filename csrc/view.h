/* From the unit square to a light as seen from one point: what single rays and
 * lanes share.  In double, one rounding an operation, and without branches, so
 * that compilers make lanes of it. */
#ifndef VOCC_VIEW_H
#define VOCC_VIEW_H

#include "platform.h"
#include "trig.h"

typedef enum vocc_view_kind {
    VOCC_VIEW_RECT, /* (corner + a edge_u) + b edge_v - point, in float32 */
    VOCC_VIEW_FLAT, /* centre + x u + y v - point, x and y times `radius` */
    VOCC_VIEW_CAP   /* a cap of the unit sphere around w */
} vocc_view_kind;

typedef struct vocc_view {
    vocc_view_kind kind;
    float point[3], corner[3], edge_u[3], edge_v[3];
    double centre[3], w[3], u[3], v[3];
    double cap; /* 1 - cosine is up to it */
    /* CAP, if is_sphere: where directions meet the sphere of `radius` whose
     * centre is at `distance`: first, or from inside. */
    int is_sphere;
    double distance, radius;
} vocc_view;

VOCC_INLINE float vocc_view_rect(const vocc_view *s, int k, float a, float b)
{
    return ((s->corner[k] + a * s->edge_u[k]) + b * s->edge_v[k]) - s->point[k];
}

VOCC_INLINE float vocc_view_flat(const vocc_view *s, int k, double x, double y)
{
    return (float)(s->centre[k] + x * s->radius * s->u[k] +
                   y * s->radius * s->v[k] - (double)s->point[k]);
}

/* Of the cap's point (x, y) of the unit disk, areas in proportion: the cosine,
 * and the square of what x and y are multiplied by. */
VOCC_INLINE double vocc_view_cosine(const vocc_view *s, double x, double y,
                                    double *wide)
{
    const double lowered = s->cap * (x * x + y * y), left = 2.0 - lowered,
                 square = s->cap * left;
    *wide = left > 0.0 ? square : 0.0;
    return 1.0 - lowered;
}

/* On a sphere: how far along, and the square of what to go back or on. */
VOCC_INLINE double vocc_view_along(const vocc_view *s, double cosine,
                                   double *half)
{
    const double along = s->distance * cosine,
                 square = s->radius * s->radius -
                          (s->distance - along) * (s->distance + along);
    *half = square > 0.0 ? square : 0.0;
    return along;
}

VOCC_INLINE double vocc_view_length(const vocc_view *s, double along,
                                    double half)
{
    return s->distance > s->radius ? along - half : along + half;
}

VOCC_INLINE float vocc_view_cap(const vocc_view *s, int k, double length,
                                double cosine, double wide, double x, double y)
{
    return (float)(length *
                   (cosine * s->w[k] + wide * (x * s->u[k] + y * s->v[k])));
}

#endif
