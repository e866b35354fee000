/* Sine and cosine of the same bits on every machine: libm's are not. */
#ifndef VOCC_TRIG_H
#define VOCC_TRIG_H

#include "platform.h"

#define VOCC_PI 3.14159265358979323846

/* Both for |x| <= pi / 4 (about): Taylor's series, off by less than 1e-15. */
VOCC_INLINE void vocc_sincos(double x, double *sine, double *cosine)
{
    const double y = x * x;
    *sine = x * (1.0 + y * (-1.0 / 6 +
                            y * (1.0 / 120 +
                                 y * (-1.0 / 5040 +
                                      y * (1.0 / 362880 +
                                           y * (-1.0 / 39916800 +
                                                y * (1.0 / 6227020800.0)))))));
    *cosine =
        1.0 + y * (-1.0 / 2 +
                   y * (1.0 / 24 +
                        y * (-1.0 / 720 +
                             y * (1.0 / 40320 +
                                  y * (-1.0 / 3628800 +
                                       y * (1.0 / 479001600 +
                                            y * (-1.0 / 87178291200.0)))))));
}

/* Both for |x| <= pi: by doubling the angle twice. */
VOCC_INLINE void vocc_sincos_pi(double x, double *sine, double *cosine)
{
    int i;
    vocc_sincos(0.25 * x, sine, cosine);
    for (i = 0; i < 2; i++) {
        const double s = *sine, c = *cosine;
        *sine = 2.0 * s * c;
        *cosine = 1.0 - 2.0 * s * s;
    }
}

/* The unit square to the unit disk, areas in proportion: Shirley and Chiu, "A
 * Low Distortion Map Between Disk and Square", 1997. */
VOCC_INLINE void vocc_disk_point(float a, float b, double *x, double *y)
{
    const double p = 2.0 * (double)a - 1.0, q = 2.0 * (double)b - 1.0;
    const int is_wide = p * p > q * q;
    const double most = is_wide ? p : q, least = is_wide ? q : p,
                 divisor = most != 0.0 ? most : 1.0;
    double sine, cosine;
    vocc_sincos(0.25 * VOCC_PI * (least / divisor), &sine, &cosine);
    *x = most * (is_wide ? cosine : sine);
    *y = most * (is_wide ? sine : cosine);
}

#endif
