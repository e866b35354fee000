#include "light.h"
#include "traverse.h"
#include "vec3.h"
#include "walk.h"

static int round_to(double source, double origin, float *out, double *bad)
{
    *out = (float)(source - origin);
    if (vocc_finitef(*out))
        return 1;
    *bad = source;
    return 0;
}

int vocc_light_init(vocc_light *light, const vocc_rect_light *source,
                    const double origin[3], double *bad)
{
    int k;
    for (k = 0; k < 3; k++) {
        if (!round_to(source->corner[k], origin[k], &light->corner[k], bad) ||
            !round_to(source->edge_u[k], 0.0, &light->edge_u[k], bad) ||
            !round_to(source->edge_v[k], 0.0, &light->edge_v[k], bad))
            return 0;
        light->centre[k] = (double)light->corner[k] +
                           (double)light->edge_u[k] / 2.0 +
                           (double)light->edge_v[k] / 2.0;
    }
    return 1;
}

void vocc_light_target(const vocc_light *light, const vocc_tree *tree,
                       const double reach[3], vocc_target *target)
{
    int k, i;
    target->slack = 0.0;
    for (k = 0; k < 3; k++) {
        const double p = (double)light->corner[k], u = (double)light->edge_u[k],
                     v = (double)light->edge_v[k];
        /* With u = 2^-24: a and b may be 2 u more than 1, a point has four
         * roundings of numbers up to `size`, the direction to it one of numbers
         * up to size + reach: org + dir is off by less than 8 u of the latter,
         * and corners are rounded to float32 by less than as much again. */
        const double size = vocc_abs(p) + vocc_abs(u) + vocc_abs(v);
        const double margin = 0x1p-21 * (size + reach[k]) + 0x1p-140;
        target->lower[k] =
            p + (u < 0.0 ? u : 0.0) + (v < 0.0 ? v : 0.0) - margin;
        target->upper[k] =
            p + (u > 0.0 ? u : 0.0) + (v > 0.0 ? v : 0.0) + margin;
        target->slack =
            2.0 * margin > target->slack ? 2.0 * margin : target->slack;
        for (i = 0; i < 4; i++)
            target->corner[i][k] =
                (float)(p + (i & 1 ? u : 0.0) + (i & 2 ? v : 0.0));
    }
    if (!vocc_locate_box(tree, target->lower, target->upper, &target->region))
        target->region = VOCC_END_UNKNOWN;
}
