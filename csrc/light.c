#include "light.h"
#include "frame.h"
#include "status.h"
#include "trig.h"
#include "vec3.h"
#include "walk.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

/* ---- from the caller's light ------------------------------------------------
 */

static vocc_status bad_field(vocc_error *error, size_t number,
                             const char *field, double value, const char *what)
{
    return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "lights",
                     (int64_t)number, value, "lights[%zu].%s is %.10g: %s",
                     number, field, value, what);
}

static vocc_status round_vector(float out[3], const double in[3],
                                const double *origin, size_t number,
                                const char *field, vocc_error *error)
{
    int k;
    for (k = 0; k < 3; k++) {
        out[k] = (float)(in[k] - (origin ? origin[k] : 0.0));
        if (!vocc_finitef(out[k]))
            return bad_field(error, number, field, in[k],
                             "it has to be a finite float32 number");
    }
    return VOCC_OK;
}

static vocc_status set_direction(vocc_emitter *e, const vocc_light *light,
                                 size_t number, double most, vocc_error *error)
{
    double sine, unused;
    if (!(light->angle >= 0.0 && light->angle <= most))
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "lights",
                         (int64_t)number, light->angle,
                         "lights[%zu].angle is %.10g: it has to be from 0 to "
                         "%.10g radians",
                         number, light->angle, most);
    if (!vocc_normalize(light->direction, e->axis))
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "lights",
                         (int64_t)number, light->direction[0],
                         "lights[%zu].direction is (%g, %g, %g): it has to be "
                         "finite and not 0",
                         number, light->direction[0], light->direction[1],
                         light->direction[2]);
    vocc_make_frame(e->axis, e->axis_u, e->axis_v);
    vocc_sincos_pi(0.5 * light->angle, &sine, &e->cosine);
    vocc_sincos_pi(0.25 * light->angle, &sine, &unused);
    e->chord = 2.0 * sine;
    e->cap = 2.0 * sine * sine;
    return VOCC_OK;
}

static vocc_status set_radius(vocc_emitter *e, const vocc_light *light,
                              size_t number, vocc_error *error)
{
    e->radius = (double)(float)light->radius;
    if (!(light->radius >= 0.0 && e->radius <= (double)FLT_MAX))
        return bad_field(error, number, "radius", light->radius,
                         "it has to be a finite float32 number, at least 0");
    return VOCC_OK;
}

static vocc_status set_edges(vocc_emitter *e, const vocc_light *light,
                             size_t number, vocc_error *error)
{
    vocc_status status =
        round_vector(e->edge_u, light->edge_u, NULL, number, "edge_u", error);
    double u[3], v[3];
    int k;
    if (status == VOCC_OK)
        status = round_vector(e->edge_v, light->edge_v, NULL, number, "edge_v",
                              error);
    if (status != VOCC_OK)
        return status;
    for (k = 0; k < 3; k++) {
        u[k] = (double)e->edge_u[k];
        v[k] = (double)e->edge_v[k];
        if (e->type == VOCC_LIGHT_RECT)
            e->centre[k] += u[k] / 2.0 + v[k] / 2.0;
    }
    vocc_cross(u, v, e->plane);
    e->one_sided = light->one_sided && vocc_dot(e->plane, e->plane) > 0.0;
    return VOCC_OK;
}

vocc_status vocc_emitter_init(vocc_emitter *e, const vocc_light *light,
                              size_t number, const double origin[3],
                              vocc_error *error)
{
    vocc_status status = VOCC_OK;
    int k;
    memset(e, 0, sizeof *e);
    if (light->type < VOCC_LIGHT_RECT || light->type > VOCC_LIGHT_SUN)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "lights",
                         (int64_t)number, (double)light->type,
                         "lights[%zu].type is %" PRId32
                         ": it has to be from 0 to %d",
                         number, light->type, VOCC_LIGHT_SUN);
    e->type = light->type;
    if (e->type != VOCC_LIGHT_SUN)
        status = round_vector(e->position, light->position, origin, number,
                              "position", error);
    for (k = 0; k < 3; k++)
        e->centre[k] = (double)e->position[k];
    if (status != VOCC_OK)
        return status;
    switch (e->type) {
    case VOCC_LIGHT_RECT:
    case VOCC_LIGHT_DISK:
        return set_edges(e, light, number, error);
    case VOCC_LIGHT_SUN:
        return set_direction(e, light, number, VOCC_PI, error);
    case VOCC_LIGHT_SPOT:
        status = set_direction(e, light, number, 2.0 * VOCC_PI, error);
        return status == VOCC_OK ? set_radius(e, light, number, error) : status;
    default:
        return set_radius(e, light, number, error);
    }
}

vocc_status vocc_emitter_hemisphere(vocc_emitter *e, double distance,
                                    vocc_error *error)
{
    memset(e, 0, sizeof *e);
    e->type = VOCC_LIGHT_HEMISPHERE;
    e->distance = (float)distance;
    if (!(e->distance > 0.0f))
        return vocc_fail(
            error, VOCC_ERROR_INVALID_ARGUMENT, "distance", -1, distance,
            "distance is %.10g: it has to be above 0 in float32", distance);
    return VOCC_OK;
}

/* ---- which side -------------------------------------------------------------
 */

/* How far normal . (sample - point) is from that of the light's centre, for
 * |normal . edges| up to u and v, a normal of length `length`, 1-norm, and
 * |coordinates| of the point; with what rounding may change.  No argument makes
 * it smaller by being larger. */
static double reach_of(const vocc_emitter *e, double u, double v, double length,
                       const double point[3])
{
    const int is_sun = e->type == VOCC_LIGHT_SUN;
    double reach, size = 0.0;
    int k;
    for (k = 0; k < 3; k++)
        size += vocc_abs(e->centre[k]) + (is_sun ? 0.0 : point[k]) +
                vocc_abs((double)e->edge_u[k]) + vocc_abs((double)e->edge_v[k]);
    switch (e->type) {
    case VOCC_LIGHT_RECT:
        reach = (u + v) / 2.0;
        break;
    case VOCC_LIGHT_DISK:
        reach = sqrt(u * u + v * v);
        break;
    case VOCC_LIGHT_SUN:
        reach = e->chord * length;
        break;
    default:
        reach = e->radius * length;
    }
    /* Samples and directions are rounded to float32, four times at most. */
    return reach + 0x1p-20 * (length * (size + (is_sun ? 4.0 : e->radius)));
}

/* The bounds of normal . (sample - point) over all samples, in double. */
static void heights(const vocc_emitter *e, const float point[3],
                    const double n[3], double *low, double *high)
{
    const int is_sun = e->type == VOCC_LIGHT_SUN;
    double centre = 0.0, u = 0.0, v = 0.0, length = 0.0, size[3], reach;
    int k;
    for (k = 0; k < 3; k++) {
        const double p = (double)point[k];
        centre += n[k] * (is_sun ? e->axis[k] : e->centre[k] - p);
        u += n[k] * (double)e->edge_u[k];
        v += n[k] * (double)e->edge_v[k];
        length += vocc_abs(n[k]);
        size[k] = vocc_abs(p);
    }
    reach = reach_of(e, vocc_abs(u), vocc_abs(v), length, size);
    *low = centre - reach;
    *high = centre + reach;
}

/* Whether the point is where a one-sided light or a spot's cone does not
 * reach. */
static int is_cut_off(const vocc_emitter *e, const float point[3])
{
    double to[3];
    int k;
    for (k = 0; k < 3; k++)
        to[k] = (double)point[k] - e->centre[k];
    if (e->one_sided)
        return !(vocc_dot(e->plane, to) > 0.0);
    if (e->type == VOCC_LIGHT_SPOT)
        return !(vocc_dot(e->axis, to) >= e->cosine * sqrt(vocc_dot(to, to)));
    return 0;
}

vocc_facing vocc_emitter_facing(const vocc_emitter *e, const float point[3],
                                const double n[3], int32_t horizon)
{
    double low, high, unit[3];
    int k;
    if (e->type == VOCC_LIGHT_HEMISPHERE)
        return vocc_normalize(n, unit) ? VOCC_FACING_ALL : VOCC_FACING_NONE;
    if (is_cut_off(e, point))
        return VOCC_FACING_NONE;
    if (horizon == VOCC_HORIZON_CENTRE) {
        double height = 0.0;
        if (e->type == VOCC_LIGHT_SUN)
            height = vocc_dot(n, e->axis);
        else
            for (k = 0; k < 3; k++)
                height += n[k] * (e->centre[k] - (double)point[k]);
        return height > 0.0 ? VOCC_FACING_ALL : VOCC_FACING_NONE;
    }
    heights(e, point, n, &low, &high);
    if (low > 0.0)
        return VOCC_FACING_ALL;
    return high > 0.0 ? VOCC_FACING_PART : VOCC_FACING_NONE;
}

/* ---- at all of a patch ------------------------------------------------------
 *
 * A rounded sum or product is no smaller if its operands are not (or, for
 * factors, if the exact product is not): the same operations on bounds give
 * bounds of what they give at any point, rounding and all. */

typedef struct range {
    double low, high;
} range;

static double larger(double a, double b)
{
    return a > b ? a : b;
}

static double smaller(double a, double b)
{
    return a < b ? a : b;
}

static range times(range a, range b)
{
    const double p = a.low * b.low, q = a.low * b.high, r = a.high * b.low,
                 s = a.high * b.high;
    range out;
    out.low = smaller(smaller(p, q), smaller(r, s));
    out.high = larger(larger(p, q), larger(r, s));
    return out;
}

static range one(double x)
{
    range r;
    r.low = r.high = x;
    return r;
}

static double largest(range r)
{
    return larger(vocc_abs(r.low), vocc_abs(r.high));
}

static range dot(const range a[3], const range b[3])
{
    const range x = times(a[0], b[0]), y = times(a[1], b[1]),
                z = times(a[2], b[2]);
    range out;
    out.low = x.low + y.low + z.low;
    out.high = x.high + y.high + z.high;
    return out;
}

int vocc_emitter_facing_patch(const vocc_emitter *e, const vocc_patch *patch,
                              int32_t horizon, vocc_facing *facing)
{
    const int is_sun = e->type == VOCC_LIGHT_SUN;
    range n[3], to[3], back[3], plane[3], height;
    int k;
    if (e->type == VOCC_LIGHT_SPOT || e->type == VOCC_LIGHT_HEMISPHERE)
        return 0;
    for (k = 0; k < 3; k++) {
        n[k].low = patch->normal_lower[k];
        n[k].high = patch->normal_upper[k];
        to[k].low = e->centre[k] - patch->upper[k];
        to[k].high = e->centre[k] - patch->lower[k];
        back[k].low = -to[k].high;
        back[k].high = -to[k].low;
        plane[k] = one(e->plane[k]);
        if (is_sun)
            to[k] = one(e->axis[k]);
    }
    if (e->one_sided) {
        const range side = dot(plane, back);
        *facing = VOCC_FACING_NONE;
        if (side.high <= 0.0)
            return 1;
        if (!(side.low > 0.0))
            return 0;
    }
    height = dot(n, to);
    if (horizon != VOCC_HORIZON_CENTRE) {
        range u[3], v[3];
        double size[3], length = 0.0, reach;
        for (k = 0; k < 3; k++) {
            u[k] = one((double)e->edge_u[k]);
            v[k] = one((double)e->edge_v[k]);
            length += largest(n[k]);
            size[k] =
                larger(vocc_abs(patch->lower[k]), vocc_abs(patch->upper[k]));
        }
        reach =
            reach_of(e, largest(dot(n, u)), largest(dot(n, v)), length, size);
        height.low -= reach;
        height.high += reach;
    }
    *facing = height.low > 0.0 ? VOCC_FACING_ALL : VOCC_FACING_NONE;
    return height.low > 0.0 || height.high <= 0.0;
}

void vocc_emitter_face(const vocc_emitter *e, size_t count,
                       const float (*point)[3], const double (*normal)[3],
                       int32_t horizon, uint8_t *facing)
{
    const double c[3] = {e->centre[0], e->centre[1], e->centre[2]};
    size_t i;
    if (horizon != VOCC_HORIZON_CENTRE || e->one_sided ||
        e->type == VOCC_LIGHT_SPOT || e->type == VOCC_LIGHT_SUN ||
        e->type == VOCC_LIGHT_HEMISPHERE) {
        for (i = 0; i < count; i++)
            facing[i] =
                (uint8_t)vocc_emitter_facing(e, point[i], normal[i], horizon);
        return;
    }
    for (i = 0; i < count; i++) {
        const float *const p = point[i];
        const double *const n = normal[i];
        facing[i] = n[0] * (c[0] - (double)p[0]) +
                                n[1] * (c[1] - (double)p[1]) +
                                n[2] * (c[2] - (double)p[2]) >
                            0.0
                        ? VOCC_FACING_ALL
                        : VOCC_FACING_NONE;
    }
}

/* ---- samples ----------------------------------------------------------------
 */

void vocc_aim_init(vocc_aim *aim, const vocc_emitter *e, const float point[3],
                   const double normal[3])
{
    vocc_view *const s = &aim->view;
    int k;
    aim->emitter = e;
    memcpy(aim->normal, normal, sizeof aim->normal);
    memcpy(s->point, point, sizeof s->point);
    s->is_sphere = e->type == VOCC_LIGHT_SPHERE;
    switch (e->type) {
    case VOCC_LIGHT_RECT:
        s->kind = VOCC_VIEW_RECT;
        memcpy(s->corner, e->position, sizeof s->corner);
        memcpy(s->edge_u, e->edge_u, sizeof s->edge_u);
        memcpy(s->edge_v, e->edge_v, sizeof s->edge_v);
        return;
    case VOCC_LIGHT_DISK:
        s->kind = VOCC_VIEW_FLAT;
        s->radius = 1.0;
        for (k = 0; k < 3; k++) {
            s->u[k] = (double)e->edge_u[k];
            s->v[k] = (double)e->edge_v[k];
        }
        break;
    case VOCC_LIGHT_SUN:
        s->kind = VOCC_VIEW_CAP;
        s->cap = e->cap;
        memcpy(s->w, e->axis, sizeof s->w);
        memcpy(s->u, e->axis_u, sizeof s->u);
        memcpy(s->v, e->axis_v, sizeof s->v);
        return;
    case VOCC_LIGHT_HEMISPHERE:
        vocc_normalize(normal, s->w);
        vocc_make_frame(s->w, s->u, s->v);
        return;
    default: { /* SPHERE, POINT, SPOT */
        double to[3];
        for (k = 0; k < 3; k++)
            to[k] = e->centre[k] - (double)point[k];
        s->distance = sqrt(vocc_dot(to, to));
        s->radius = e->radius;
        if (!vocc_normalize(to, s->w)) {
            s->w[0] = s->w[1] = 0.0;
            s->w[2] = 1.0;
        }
        vocc_make_frame(s->w, s->u, s->v);
        s->kind = s->is_sphere ? VOCC_VIEW_CAP : VOCC_VIEW_FLAT;
        s->cap = 2.0; /* all around */
        if (s->distance > e->radius) {
            const double sine = e->radius / s->distance, square = sine * sine;
            s->cap = square / (1.0 + sqrt(1.0 - square));
        }
    }
    }
    memcpy(s->centre, e->centre, sizeof s->centre);
}

float vocc_aim_ray_round(const vocc_aim *aim, float a, float b, float dir[3])
{
    const vocc_emitter *e = aim->emitter;
    const vocc_view *s = &aim->view;
    double x, y, cosine, wide, length = 1.0;
    int k;
    vocc_disk_point(a, b, &x, &y);
    if (e->type == VOCC_LIGHT_HEMISPHERE) {
        const double square = 1.0 - x * x - y * y,
                     z = square > 0.0 ? sqrt(square) : 0.0;
        for (k = 0; k < 3; k++)
            dir[k] = (float)(z * s->w[k] + x * s->u[k] + y * s->v[k]);
        return e->distance;
    }
    if (s->kind == VOCC_VIEW_FLAT) {
        for (k = 0; k < 3; k++)
            dir[k] = vocc_view_flat(s, k, x, y);
        return 1.0f;
    }
    cosine = vocc_view_cosine(s, x, y, &wide);
    wide = sqrt(wide);
    if (s->is_sphere) {
        double half;
        length = vocc_view_along(s, cosine, &half);
        length = vocc_view_length(s, length, sqrt(half));
    }
    for (k = 0; k < 3; k++)
        dir[k] = vocc_view_cap(s, k, length, cosine, wide, x, y);
    return s->is_sphere ? 1.0f : INFINITY;
}

static double height(const vocc_aim *aim, const float dir[3])
{
    const double d[3] = {(double)dir[0], (double)dir[1], (double)dir[2]};
    return vocc_dot(aim->normal, d);
}

int vocc_aim_is_above(const vocc_aim *aim, const float dir[3])
{
    return height(aim, dir) > 0.0;
}

double vocc_aim_weight(const vocc_aim *aim, const float dir[3])
{
    const vocc_emitter *e = aim->emitter;
    const double d[3] = {(double)dir[0], (double)dir[1], (double)dir[2]},
                 square = vocc_dot(d, d), cosine = height(aim, dir);
    double at_light;
    if (!(cosine > 0.0))
        return 0.0;
    switch (e->type) {
    case VOCC_LIGHT_SPHERE:
    case VOCC_LIGHT_SUN:
        return cosine / sqrt(square);
    case VOCC_LIGHT_RECT:
    case VOCC_LIGHT_DISK:
        at_light = vocc_abs(vocc_dot(e->plane, d));
        if (at_light == 0.0) /* a line, a point, or seen from the edge */
            at_light = sqrt(square);
        break;
    default:
        at_light = vocc_abs(vocc_dot(aim->view.w, d));
    }
    return cosine * at_light / (square * square);
}

/* ---- what the rays end on ---------------------------------------------------
 */

/* Corner i of a convex hull of the light, on axis k. */
static double hull_corner(const vocc_emitter *e, int i, int k)
{
    const double p = (double)e->position[k], u = (double)e->edge_u[k],
                 v = (double)e->edge_v[k];
    switch (e->type) {
    case VOCC_LIGHT_RECT:
        return p + (i & 1 ? u : 0.0) + (i & 2 ? v : 0.0);
    case VOCC_LIGHT_DISK:
        return p + (i & 1 ? u : -u) + (i & 2 ? v : -v);
    case VOCC_LIGHT_SUN:
        /* A box along the axes of the cap, which is `cap` high and less than
         * `chord` wide to each side. */
        return e->axis[k] * (i & 4 ? 1.0 : 1.0 - e->cap) +
               e->chord * ((i & 1 ? e->axis_u[k] : -e->axis_u[k]) +
                           (i & 2 ? e->axis_v[k] : -e->axis_v[k]));
    default:
        return p + (i >> k & 1 ? e->radius : -e->radius);
    }
}

/* How far an end, org + dir, may be outside of the hull on axis k.  With u =
 * 2^-24: a and b of a RECT may be 2 u more than 1, a point has four roundings
 * of numbers up to `size`, the direction to it one of numbers up to size +
 * reach: org + dir is off by less than 8 u of the latter, and corners are
 * rounded to float32 by less than as much again.  Other shapes are computed in
 * double from all axes, and rounded once on each. */
static double end_error(const vocc_emitter *e, const double reach[3], int k)
{
    double size = 0.0;
    int i;
    if (e->type == VOCC_LIGHT_SUN)
        return 0x1p-21 * 4.0;
    for (i = 0; i < 3; i++)
        if (i == k || e->type != VOCC_LIGHT_RECT)
            size += vocc_abs((double)e->position[i]) +
                    vocc_abs((double)e->edge_u[i]) +
                    vocc_abs((double)e->edge_v[i]) + e->radius + reach[i];
    return 0x1p-21 * size + 0x1p-140;
}

void vocc_emitter_target(const vocc_emitter *e, const vocc_tree *tree,
                         const double reach[3], vocc_target *target)
{
    int k, i;
    target->is_direction = e->type == VOCC_LIGHT_SUN;
    target->corners =
        e->type == VOCC_LIGHT_RECT || e->type == VOCC_LIGHT_DISK ? 4 : 8;
    target->slack = 0.0;
    for (k = 0; k < 3; k++) {
        const double error = end_error(e, reach, k);
        for (i = 0; i < target->corners; i++) {
            const double value = hull_corner(e, i, k);
            target->corner[i][k] = (float)value;
            if (i == 0 || value < target->lower[k])
                target->lower[k] = value;
            if (i == 0 || value > target->upper[k])
                target->upper[k] = value;
        }
        target->lower[k] -= error;
        target->upper[k] += error;
        if (2.0 * error > target->slack)
            target->slack = 2.0 * error;
    }
    if (target->is_direction)
        target->region = 0;
    else if (!vocc_locate_box(tree, target->lower, target->upper,
                              &target->region))
        target->region = VOCC_END_UNKNOWN;
}

/* Axes along the longer edge and in the plane of both, and their normal; of one
 * edge or none, whichever. */
static void edge_axes(const vocc_emitter *e, double axis[3][3])
{
    double u[3], v[3], p[3], q[3], along, beside, length;
    int k;
    for (k = 0; k < 3; k++) {
        u[k] = (double)e->edge_u[k];
        v[k] = (double)e->edge_v[k];
    }
    if (!vocc_normalize(vocc_dot(u, u) < vocc_dot(v, v) ? v : u, axis[0])) {
        axis[0][0] = axis[0][1] = 0.0;
        axis[0][2] = 1.0;
    }
    vocc_make_frame(axis[0], p, q);
    if (vocc_dot(u, u) < vocc_dot(v, v))
        memcpy(v, u, sizeof v);
    along = vocc_dot(v, p);
    beside = vocc_dot(v, q);
    length = sqrt(along * along + beside * beside);
    along = length > 0.0 ? along / length : 1.0;
    beside = length > 0.0 ? beside / length : 0.0;
    for (k = 0; k < 3; k++) {
        axis[1][k] = along * p[k] + beside * q[k];
        axis[2][k] = along * q[k] - beside * p[k];
    }
}

void vocc_emitter_frame(const vocc_emitter *e, const float point[3],
                        vocc_end_frame *frame)
{
    double (*const axis)[3] = frame->axis;
    int k;
    memcpy(frame->origin, e->type == VOCC_LIGHT_SUN ? e->axis : e->centre,
           sizeof frame->origin);
    switch (e->type) {
    case VOCC_LIGHT_RECT:
    case VOCC_LIGHT_DISK:
        edge_axes(e, axis);
        break;
    case VOCC_LIGHT_SUN:
        memcpy(axis[0], e->axis_u, sizeof axis[0]);
        memcpy(axis[1], e->axis_v, sizeof axis[1]);
        memcpy(axis[2], e->axis, sizeof axis[2]);
        break;
    default: {
        double to[3];
        for (k = 0; k < 3; k++)
            to[k] = e->centre[k] - (double)point[k];
        if (!vocc_normalize(to, axis[2])) {
            axis[2][0] = axis[2][1] = 0.0;
            axis[2][2] = 1.0;
        }
        vocc_make_frame(axis[2], axis[0], axis[1]);
    }
    }
}
