/* Lights: their samples as seen from a point, the side they are on, the region
 * they lie in.  The hemisphere of ambient occlusion is one, too. */
#ifndef VOCC_LIGHT_H
#define VOCC_LIGHT_H

#include "kdtree.h"
#include "platform.h"
#include "shaft.h"
#include "view.h"
#include "vocc.h"

/* Beside the types of vocc_light_type. */
enum { VOCC_LIGHT_HEMISPHERE = VOCC_LIGHT_SUN + 1 };

/* A light in the scene's coordinates; of the fields, those that its type needs
 * are set. */
typedef struct vocc_emitter {
    int type, one_sided;
    float position[3], edge_u[3], edge_v[3];
    double centre[3];
    double plane[3]; /* edge_u x edge_v; 0 if it has no area */
    double radius;   /* float32 */
    /* SPOT: where its cone points, its cosine.  SUN: where it is, the axes of
     * its disk. */
    double axis[3], axis_u[3], axis_v[3], cosine;
    double cap;     /* SUN: 1 - cosine of half its angle */
    double chord;   /* SUN: the distance from the axis to a unit direction */
    float distance; /* HEMISPHERE */
} vocc_emitter;

/* A light as seen from one point. */
typedef struct vocc_aim {
    const vocc_emitter *emitter;
    double normal[3];
    vocc_view view;
} vocc_aim;

typedef enum vocc_facing {
    VOCC_FACING_NONE, /* no sample can light the surface */
    VOCC_FACING_PART, /* some samples may not be above it */
    VOCC_FACING_ALL   /* all are */
} vocc_facing;

/* Moves the light by the scene's origin and rounds it.  Fails:
 * INVALID_ARGUMENT, with the light's number as the index. */
VOCC_INTERNAL vocc_status vocc_emitter_init(vocc_emitter *emitter,
                                            const vocc_light *light,
                                            size_t number,
                                            const double origin[3],
                                            vocc_error *error);

/* The hemisphere of a point's normal, up to a distance.  Fails:
 * INVALID_ARGUMENT. */
VOCC_INTERNAL vocc_status vocc_emitter_hemisphere(vocc_emitter *emitter,
                                                  double distance,
                                                  vocc_error *error);

/* How the light lies to the surface at a point; NONE if a value is NaN. */
VOCC_INTERNAL vocc_facing vocc_emitter_facing(const vocc_emitter *emitter,
                                              const float point[3],
                                              const double normal[3],
                                              int32_t horizon);

/* Points with their normals: all finite, and what they lie between. */
typedef struct vocc_patch {
    double lower[3], upper[3]; /* points */
    double normal_lower[3], normal_upper[3];
} vocc_patch;

/* 1 if vocc_emitter_facing is the same at all of the patch: *facing. */
VOCC_INTERNAL int vocc_emitter_facing_patch(const vocc_emitter *emitter,
                                            const vocc_patch *patch,
                                            int32_t horizon,
                                            vocc_facing *facing);

/* vocc_emitter_facing at some points, a byte each. */
VOCC_INTERNAL void vocc_emitter_face(const vocc_emitter *emitter, size_t count,
                                     const float (*point)[3],
                                     const double (*normal)[3], int32_t horizon,
                                     uint8_t *facing);

VOCC_INTERNAL void vocc_aim_init(vocc_aim *aim, const vocc_emitter *emitter,
                                 const float point[3], const double normal[3]);

/* The same for what is not a RECT. */
VOCC_INTERNAL float vocc_aim_ray_round(const vocc_aim *aim, float a, float b,
                                       float dir[3]);

/* The ray to sample (a, b): dir, and its tmax (1, infinity, a distance). */
VOCC_INLINE float vocc_aim_ray(const vocc_aim *aim, float a, float b,
                               float dir[3])
{
    const vocc_emitter *e = aim->emitter;
    int k;
    if (e->type != VOCC_LIGHT_RECT)
        return vocc_aim_ray_round(aim, a, b, dir);
    for (k = 0; k < 3; k++)
        dir[k] = ((e->position[k] + a * e->edge_u[k]) + b * e->edge_v[k]) -
                 aim->view.point[k];
    return 1.0f;
}

/* Whether a ray leaves the surface on the normal's side. */
VOCC_INTERNAL int vocc_aim_is_above(const vocc_aim *aim, const float dir[3]);

/* What the light of that sample would add to the irradiance, in a unit that
 * depends on light and point. */
VOCC_INTERNAL double vocc_aim_weight(const vocc_aim *aim, const float dir[3]);

/* What every ray from a point with |coordinates| up to reach[] to the light
 * ends on.  Its region is VOCC_END_UNKNOWN if triangles are too near to the
 * light to name one for all.  Not for a HEMISPHERE. */
VOCC_INTERNAL void vocc_emitter_target(const vocc_emitter *emitter,
                                       const vocc_tree *tree,
                                       const double reach[3],
                                       vocc_target *target);

/* An orthonormal frame of the ends of rays from about that point: the light is
 * thin, or seen from the front, along the third axis.  Not for a HEMISPHERE. */
VOCC_INTERNAL void vocc_emitter_frame(const vocc_emitter *emitter,
                                      const float point[3],
                                      vocc_end_frame *frame);

#endif
