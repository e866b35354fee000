/* Unit vectors. */
#ifndef VOCC_FRAME_H
#define VOCC_FRAME_H

#include "platform.h"
#include "vec3.h"

#include <float.h>
#include <math.h>

/* Unit length; 0 if it has no direction. */
VOCC_INLINE int vocc_normalize(const double in[3], double out[3])
{
    double largest = 0.0, length;
    int k, exponent;
    for (k = 0; k < 3; k++) {
        if (!(vocc_abs(in[k]) <= DBL_MAX))
            return 0;
        largest = vocc_abs(in[k]) > largest ? vocc_abs(in[k]) : largest;
    }
    if (largest == 0.0)
        return 0;
    if (largest > 0x1p-200 && largest < 0x1p200) {
        /* Squares are in range as they are. */
        for (k = 0; k < 3; k++)
            out[k] = in[k];
    } else {
        (void)frexp(largest, &exponent);
        for (k = 0; k < 3; k++)
            out[k] = ldexp(in[k], -exponent);
    }
    length = sqrt(vocc_dot(out, out));
    for (k = 0; k < 3; k++)
        out[k] /= length;
    return 1;
}

/* Two unit vectors at right angles to the unit vector w and to each other: Duff
 * et al., "Building an Orthonormal Basis, Revisited", 2017. */
VOCC_INLINE void vocc_make_frame(const double w[3], double u[3], double v[3])
{
    const double sign = w[2] < 0.0 ? -1.0 : 1.0, a = -1.0 / (sign + w[2]),
                 b = w[0] * w[1] * a;
    u[0] = 1.0 + sign * w[0] * w[0] * a;
    u[1] = sign * b;
    u[2] = -sign * w[0];
    v[0] = b;
    v[1] = sign + w[1] * w[1] * a;
    v[2] = -w[1];
}

#endif
