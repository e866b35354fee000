#include "shaft.h"
#include "vec3.h"

#include <string.h>

#define MAX_SIZE 0x1p30

static double larger(double a, double b)
{
    return a > b ? a : b;
}

/* Points and their bounds: the slice at t = 0.  Returns their largest
 * |coordinate|. */
static double set_points(vocc_shaft *s, const float (*point)[3],
                         const uint16_t *which, size_t count, double lower[3],
                         double upper[3])
{
    double size = 0.0;
    size_t i;
    int k;
    s->count = count;
    for (k = 0; k < 3; k++) {
        float low = point[which[0]][k], high = low;
        for (i = 0; i < count; i++) {
            const float x = point[which[i]][k];
            s->point[k][i] = x;
            low = x < low ? x : low;
            high = x > high ? x : high;
        }
        for (; i < count + VOCC_MAX_LANES; i++)
            s->point[k][i] = s->point[k][count - 1];
        lower[k] = (double)low;
        upper[k] = (double)high;
        size = larger(size, larger(vocc_abs(lower[k]), vocc_abs(upper[k])));
    }
    return size;
}

/* The slices: from the box of the points to the target, or `length` along its
 * directions. */
static void set_slices(vocc_shaft *s, const double lower[3],
                       const double upper[3], double length,
                       const vocc_target *target)
{
    int k;
    s->region = target->region;
    for (k = 0; k < 3; k++) {
        const double end_lower = length * target->lower[k],
                     end_upper = length * target->upper[k],
                     size = larger(vocc_abs(lower[k]), vocc_abs(upper[k])),
                     end = larger(vocc_abs(end_lower), vocc_abs(end_upper));
        s->lower[k] = lower[k];
        s->upper[k] = upper[k];
        s->lower_step[k] =
            target->is_direction ? end_lower : end_lower - lower[k];
        s->upper_step[k] =
            target->is_direction ? end_upper : end_upper - upper[k];
        s->lower_inverse[k] = 1.0 / s->lower_step[k];
        s->upper_inverse[k] = 1.0 / s->upper_step[k];
        s->size[k] = target->is_direction ? size + end : larger(size, end);
    }
}

int vocc_shaft_init(vocc_shaft *s, const vocc_tree *tree,
                    const float (*point)[3], const uint16_t *which,
                    size_t count, const vocc_target *target)
{
    double lower[3], upper[3];
    const double scale = (double)tree->scale,
                 point_size = set_points(s, point, which, count, lower, upper);
    /* From a point no triangle is farther than sqrt(3) (point_size + scale). */
    const double length =
        target->is_direction ? 4.0 * (point_size + scale) : 1.0;
    double end_size = 0.0;
    int i, k;
    s->corners = target->corners;
    s->is_direction = target->is_direction;
    set_slices(s, lower, upper, length, target);
    for (k = 0; k < 3; k++) {
        const double end = larger(vocc_abs(length * target->lower[k]),
                                  vocc_abs(length * target->upper[k]));
        for (i = 0; i < VOCC_TARGET_CORNERS + VOCC_MAX_LANES; i++)
            s->corner[k][i] =
                (float)(length *
                        (double)target
                            ->corner[i < s->corners ? i : s->corners - 1][k]);
        end_size = larger(end_size, end);
    }
    if (!(larger(larger(point_size, end_size), scale) <= MAX_SIZE))
        return 0;
    /* With u = 2^-24: n is off by 1.1 u of each component, the sum of three
     * products and d by 4.1 u of each product; planes.h has the rest, and what
     * is u of d is added for each plane. */
    s->point_error =
        (float)(3.0 * 5.5 * 0x1p-24 * point_size + 0x1p-36 * scale + 0x1p-100);
    s->corner_error =
        (float)(3.0 * (5.5 * 0x1p-24 * end_size + length * target->slack) +
                0x1p-36 * scale + 0x1p-100);
    return 1;
}

void vocc_shaft_walk_at_root(vocc_shaft_walk *w, const vocc_tree *tree)
{
    w->count = 0;
    w->entry = 0;
    memcpy(w->entry_lower, tree->lower, sizeof w->entry_lower);
    memcpy(w->entry_upper, tree->upper, sizeof w->entry_upper);
}

int vocc_shaft_within(const vocc_shaft *s, const float lower[3],
                      const float upper[3])
{
    double from = 0.0, to = 1.0, middle;
    int k;
    /* Where each slice is inside: about, then checked where it counts. */
    for (k = 0; k < 3; k++) {
        const double low = (double)lower[k] - s->lower[k],
                     high = (double)upper[k] - s->upper[k];
        const double t_low = low * s->lower_inverse[k],
                     t_high = high * s->upper_inverse[k];
        if (s->lower_step[k] > 0.0)
            from = t_low > from ? t_low : from;
        else if (s->lower_step[k] < 0.0)
            to = t_low < to ? t_low : to;
        else if (low >= 0.0)
            return 0;
        if (s->upper_step[k] < 0.0)
            from = t_high > from ? t_high : from;
        else if (s->upper_step[k] > 0.0)
            to = t_high < to ? t_high : to;
        else if (high <= 0.0)
            return 0;
        if (!(from < to))
            return 0;
    }
    middle = 0.5 * (from + to);
    if (!(middle > 0.0 && middle < 1.0))
        return 0;
    for (k = 0; k < 3; k++) {
        /* Three roundings of numbers up to twice the size. */
        const double error = 0x1p-49 * s->size[k];
        if (!(s->lower[k] + middle * s->lower_step[k] - error >
                  (double)lower[k] &&
              s->upper[k] + middle * s->upper_step[k] + error <
                  (double)upper[k]))
            return 0;
    }
    return 1;
}
