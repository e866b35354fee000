#include "beam.h"
#include "vec3.h"

#include <math.h>
#include <string.h>

/* Coordinates, in units of which the bounds of beam_body.inc hold: products of
 * three lie within 2^-90 .. 2^93. */
#define MAX_SIZE 0x1p30
#define MIN_SIZE 0x1p-30

/* The slices are widened by so much of the largest coordinate: beam_body.inc
 * finds t within 4 u, and what it compares is as far off. */
#define WIDER 0x1p-19

#define MAX_INVERSE 1e30

static float up(double x)
{
    return (float)(x + vocc_abs(x) * 0x1p-22);
}

static float down(double x)
{
    return (float)(x - vocc_abs(x) * 0x1p-22);
}

static double larger(double a, double b)
{
    return a > b ? a : b;
}

static float inverse(double step)
{
    const double x = 1.0 / step;
    return (float)(x > MAX_INVERSE    ? MAX_INVERSE
                   : x < -MAX_INVERSE ? -MAX_INVERSE
                                      : x);
}

/* Unit length; 0 if there is no direction. */
static int unit(const double in[3], double out[3])
{
    const double length = sqrt(vocc_dot(in, in));
    int k;
    if (!(length > 0x1p-300 && length < 0x1p300))
        return 0;
    for (k = 0; k < 3; k++)
        out[k] = in[k] / length;
    return 1;
}

/* Two unit vectors at right angles to w, the first as near to `near` as can
 * be. */
static void frame_around(const double w[3], const double near[3], double u[3],
                         double v[3])
{
    double c[3];
    int k, smallest = 0;
    vocc_cross(w, near, c);
    if (!unit(c, v)) {
        double axis[3] = {0.0, 0.0, 0.0};
        for (k = 1; k < 3; k++)
            if (vocc_abs(w[k]) < vocc_abs(w[smallest]))
                smallest = k;
        axis[smallest] = 1.0;
        vocc_cross(w, axis, c);
        (void)unit(c, v);
    }
    vocc_cross(v, w, u);
}

/* A box around the points whose third axis is their mean normal: thin where
 * they lie in a plane. */
static void set_box(vocc_beam *b, const double (*normal)[3],
                    const uint16_t *which, double margin)
{
    double axis[3][3], sum[3] = {0.0, 0.0, 0.0}, low[3], high[3], centre[3];
    const double none[3] = {0.0, 0.0, 0.0};
    const double first[3] = {(double)b->point[0][0], (double)b->point[1][0],
                             (double)b->point[2][0]};
    size_t i;
    int k, j;
    float reach = 0.0f;
    for (i = 0; i < b->count; i++)
        for (k = 0; k < 3; k++)
            sum[k] += normal[which[i]][k];
    if (!unit(sum, axis[2])) {
        axis[2][0] = axis[2][1] = 0.0;
        axis[2][2] = 1.0;
    }
    frame_around(axis[2], none, axis[0], axis[1]);
    for (j = 0; j < 3; j++)
        low[j] = high[j] = 0.0;
    for (i = 1; i < b->count; i++)
        for (j = 0; j < 3; j++) {
            const double x = ((double)b->point[0][i] - first[0]) * axis[j][0] +
                             ((double)b->point[1][i] - first[1]) * axis[j][1] +
                             ((double)b->point[2][i] - first[2]) * axis[j][2];
            low[j] = x < low[j] ? x : low[j];
            high[j] = x > high[j] ? x : high[j];
        }
    for (k = 0; k < 3; k++) {
        centre[k] = first[k];
        for (j = 0; j < 3; j++)
            centre[k] += 0.5 * (low[j] + high[j]) * axis[j][k];
        b->centre[k] = (float)centre[k];
    }
    for (j = 0; j < 3; j++)
        for (k = 0; k < 3; k++) {
            /* The axes, and the centre, are rounded. */
            b->axis[j][k] =
                (float)((0.5 * (high[j] - low[j]) * (1.0 + 0x1p-20) + margin) *
                        axis[j][k]);
            reach += vocc_absf(b->axis[j][k]);
        }
    b->reach = reach;
}

int vocc_beam_limits(vocc_beam *b, const double reach[3],
                     const vocc_target *target)
{
    double size = (double)b->tree->scale, length;
    int k;
    for (k = 0; k < 3; k++)
        size = larger(size, reach[k]);
    length = target->is_direction ? 4.0 * size : 1.0;
    for (k = 0; k < 3; k++)
        size = larger(size, length * larger(vocc_abs(target->lower[k]),
                                            vocc_abs(target->upper[k])));
    b->size = up(size);
    b->margin = up(WIDER * size);
    b->is_direction = target->is_direction;
    return size <= MAX_SIZE && size >= MIN_SIZE;
}

void vocc_beam_set_points(vocc_beam *b, const double (*normal)[3],
                          const uint16_t *which)
{
    size_t i;
    int k;
    for (k = 0; k < 3; k++) {
        float low = b->point[k][0], high = low;
        for (i = 1; i < b->count; i++) {
            const float x = b->point[k][i];
            low = x < low ? x : low;
            high = x > high ? x : high;
        }
        b->lower[k] = low;
        b->upper[k] = high;
    }
    set_box(b, normal, which, 0x1p-22 * (double)b->size);
}

/* Corner i & 1 << j of the target's hull is at the end of axis j. */
void vocc_beam_set_end(vocc_beam *b, const vocc_target *target,
                       const double low[2], const double high[2])
{
    const int axes = target->corners == 4 ? 2 : 3;
    const double margin = (double)b->margin,
                 slack = target->slack + 0x1p-22 * (double)b->size;
    /* From a point no triangle is farther than sqrt(3) times 2 size. */
    const double length = target->is_direction ? 4.0 * (double)b->size : 1.0;
    double reach = slack, lower[3], upper[3], end_lower[3], end_upper[3],
           width = 0.0;
    int j, k;
    for (k = 0; k < 3; k++) {
        const double corner = (double)target->corner[0][k];
        double centre = corner, half = slack;
        for (j = 0; j < 3; j++) {
            const double edge =
                j < axes ? (double)target->corner[1 << j][k] - corner : 0.0;
            const double from = j < 2 ? low[j] : 0.0,
                         to = j < 2 ? high[j] : 1.0;
            const double axis = 0.5 * (to - from) * edge;
            centre += 0.5 * (from + to) * edge;
            b->end_axis[j][k] = (float)axis;
            half += vocc_abs(axis);
            reach += vocc_abs(axis);
        }
        width = larger(width, 2.0 * length * half);
        end_lower[k] = larger(centre - half, target->lower[k]);
        end_upper[k] = -larger(-centre - half, -target->upper[k]);
        if (!target->is_direction)
            centre -= (double)b->centre[k];
        b->end[k] = (float)centre;
        reach += vocc_abs(centre);
    }
    b->end_width = (float)width;
    b->end_slack = up(slack);
    /* Segments from any of the points are not longer. */
    b->end_reach = up(reach + (double)b->reach);
    for (k = 0; k < 3; k++) {
        const int x = (k + 1) % 3, y = (k + 2) % 3;
        double twist = 0.0;
        int i;
        for (i = 0; i < 3; i++) {
            twist += slack * (vocc_abs((double)b->axis[i][x]) +
                              vocc_abs((double)b->axis[i][y]));
            for (j = 0; j < 3; j++)
                twist +=
                    vocc_abs((double)b->axis[i][x] * (double)b->end_axis[j][y] -
                             (double)b->axis[i][y] * (double)b->end_axis[j][x]);
        }
        b->twist[k] = up(twist);
    }
    for (k = 0; k < 3; k++) {
        /* Points and ends, and the steps between them, widened. */
        const double base_lower = (double)b->lower[k],
                     base_upper = (double)b->upper[k],
                     most_lower = length * end_lower[k] +
                                  (target->is_direction ? base_lower : 0.0),
                     most_upper = length * end_upper[k] +
                                  (target->is_direction ? base_upper : 0.0),
                     least = target->is_direction ? end_lower[k]
                                                  : end_lower[k] - base_upper,
                     most = target->is_direction ? end_upper[k]
                                                 : end_upper[k] - base_lower;
        b->slice_lower[k] = down(base_lower - margin);
        b->slice_upper[k] = up(base_upper + margin);
        b->step_lower[k] =
            inverse(most_lower - margin - (double)b->slice_lower[k]);
        b->step_upper[k] =
            inverse(most_upper + margin - (double)b->slice_upper[k]);
        b->way[k] = (float)(0.5 * (least + most));
        b->way_half[k] = up(0.5 * (most - least) + 0x1p-22 * (double)b->size);
        lower[k] = base_lower;
        upper[k] = base_upper;
    }
    {
        vocc_target part = *target;
        memcpy(part.lower, end_lower, sizeof part.lower);
        memcpy(part.upper, end_upper, sizeof part.upper);
        vocc_shaft_slices(&b->slices, lower, upper, length, &part);
    }
}

/* ---- occluders -------------------------------------------------------------
 */

/* Nodes that a search may look at. */
enum { SEARCH_STEPS = 96 };

typedef struct finding {
    const vocc_opaque **boxes;
    int count;
    int32_t region;
} finding;

/* Notes a box; whether it holds a slice. */
static int note_box(const vocc_beam *b, const vocc_opaque *box, finding *f)
{
    int i;
    if (box->region == f->region)
        return 0;
    for (i = 0; i < f->count; i++)
        if (f->boxes[i] == box)
            return 0;
    if (f->count < VOCC_BEAM_BOXES)
        f->boxes[f->count++] = box;
    return vocc_shaft_within(&b->slices, box->lower, box->upper);
}

/* Front to back along the segment from the middle of the points to that of the
 * light, but `u` and `v` half axes beside.  It need not be exact: what it finds
 * is checked. */
static const vocc_opaque *find_along(const vocc_beam *b, double u, double v,
                                     finding *f)
{
    const vocc_tree *tree = b->tree;
    struct {
        uint32_t node;
        double from, to;
    } stack[VOCC_MAX_DEPTH + 1];
    double org[3], inverse_way[3], from = 0.0, to = 1.0;
    int depth = 0, steps = 0, k;
    uint32_t node = 0;
    for (k = 0; k < 3; k++) {
        const vocc_shaft *s = &b->slices;
        double way = 0.5 * (s->lower_step[k] + s->upper_step[k]), x, y;
        way += u * (double)b->end_axis[0][k] + v * (double)b->end_axis[1][k];
        org[k] = 0.5 * (s->lower[k] + s->upper[k]);
        if (vocc_abs(way) < 1e-30)
            way = 1e-30;
        inverse_way[k] = 1.0 / way;
        x = ((double)tree->lower[k] - org[k]) * inverse_way[k];
        y = ((double)tree->upper[k] - org[k]) * inverse_way[k];
        from = larger(from, x < y ? x : y);
        to = to < (x < y ? y : x) ? to : (x < y ? y : x);
    }
    if (!(from <= to))
        return NULL;
    for (;;) {
        const vocc_node n = tree->nodes[node];
        if (++steps > SEARCH_STEPS)
            return NULL;
        if (!vocc_is_leaf(n)) {
            const unsigned axis = vocc_axis(n);
            const double t =
                ((double)n.at.split_pos - org[axis]) * inverse_way[axis];
            const uint32_t below = vocc_children(n);
            const unsigned above_first = inverse_way[axis] < 0.0;
            if (t >= to) {
                node = below + above_first;
            } else if (t <= from) {
                node = below + !above_first;
            } else {
                stack[depth].node = below + !above_first;
                stack[depth].from = t;
                stack[depth++].to = to;
                node = below + above_first;
                to = t;
            }
            continue;
        }
        if (vocc_label_of(n) == VOCC_OPAQUE) {
            const vocc_opaque *box = &tree->opaque[n.at.first];
            if (box->grown >= 0)
                box = &tree->grown[box->grown];
            if (note_box(b, box, f))
                return box;
        }
        if (!depth)
            return NULL;
        node = stack[--depth].node;
        from = stack[depth].from;
        to = stack[depth].to;
    }
}

const vocc_opaque *
vocc_beam_find_boxes(const vocc_beam *b, int32_t region,
                     const vocc_opaque *boxes[VOCC_BEAM_BOXES], int *count)
{
    static const double at[5][2] = {
        {0.0, 0.0}, {-0.6, -0.6}, {0.6, 0.6}, {-0.6, 0.6}, {0.6, -0.6}};
    const vocc_opaque *found = NULL;
    finding f;
    int i;
    f.boxes = boxes;
    f.count = 0;
    f.region = region;
    for (i = 0; i < 5 && !found && region >= 0 && b->tree->node_count; i++)
        found = find_along(b, at[i][0], at[i][1], &f);
    *count = f.count;
    return found;
}

const vocc_beam_kernels *vocc_find_beam_kernels(int32_t isa)
{
    switch (isa) {
#if VOCC_HAVE_SSE2
    case VOCC_ISA_SSE2:
        return &vocc_beam_kernels_sse2;
#endif
#if VOCC_HAVE_AVX2
    case VOCC_ISA_AVX2:
        return &vocc_beam_kernels_avx2;
#endif
#if VOCC_HAVE_AVX512
    case VOCC_ISA_AVX512:
        return &vocc_beam_kernels_avx512;
#endif
#if VOCC_HAVE_NEON
    case VOCC_ISA_NEON:
        return &vocc_beam_kernels_neon;
#endif
    default:
        return &vocc_beam_kernels_plain;
    }
}
