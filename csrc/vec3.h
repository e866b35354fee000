/* Three doubles, and the few operations that the library needs on them. */
#ifndef VOCC_VEC3_H
#define VOCC_VEC3_H

#include "platform.h"

#include <math.h>

VOCC_INLINE void vocc_cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

VOCC_INLINE double vocc_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

VOCC_INLINE int vocc_equal(const float a[3], const float b[3])
{
    return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

/* An instruction, not a comparison that is predicted. */
VOCC_INLINE double vocc_abs(double x)
{
    return fabs(x);
}

VOCC_INLINE float vocc_absf(float x)
{
    return fabsf(x);
}

/* Not NaN, not infinite. */
VOCC_INLINE int vocc_finitef(float x)
{
    return x - x == 0.0f;
}

#endif
