#include "receivers.h"

#include <math.h>
#include <stdlib.h>

#include "test.h"

void receivers_make(receivers *r, const shape *s, size_t count)
{
    test_random random = random_seed(4711);
    double lower[3], upper[3];
    shape_bounds(s, lower, upper);
    r->count = count;
    r->points = malloc(3 * count * sizeof(float));
    r->normals = malloc(3 * count * sizeof(float));
    r->ids = NULL;
    REQUIRE(r->points && r->normals);
    for (size_t i = 0; i < count; i++) {
        float *p = r->points + 3 * i, *n = r->normals + 3 * i;
        const mesh *m =
            &s->parts[random_below(&random, (uint32_t)s->part_count)].m;
        const size_t t = random_below(&random, (uint32_t)m->triangle_count);
        const float *c[3];
        double cross[3], length = 0.0;
        for (int k = 0; k < 3; k++)
            c[k] = mesh_corner(m, t, k);
        for (int k = 0; k < 3; k++) {
            const int x = (k + 1) % 3, y = (k + 2) % 3;
            cross[k] = ((double)c[1][x] - (double)c[0][x]) *
                           ((double)c[2][y] - (double)c[0][y]) -
                       ((double)c[1][y] - (double)c[0][y]) *
                           ((double)c[2][x] - (double)c[0][x]);
            length += cross[k] * cross[k];
        }
        length = length > 0.0 ? sqrt(length) : 1.0;
        const double u = random_in(&random, 0, 0.5),
                     v = random_in(&random, 0, 0.5);
        const double off = i % 8 == 0 ? 0.0 : i % 8 == 1 ? -1e-4 : 1e-4;
        for (int k = 0; k < 3; k++) {
            n[k] = (float)(cross[k] / length);
            p[k] = (float)((double)c[0][k] +
                           u * ((double)c[1][k] - (double)c[0][k]) +
                           v * ((double)c[2][k] - (double)c[0][k]) +
                           off * cross[k] / length);
            if (i % 8 == 2) {
                p[k] = (float)random_in(&random, lower[k] - 1, upper[k] + 1);
                n[k] = (float)random_in(&random, -1, 1);
            }
        }
        if (i % 64 == 3)
            p[i / 64 % 3] = i & 128 ? NAN : HUGE_VALF;
        if (i % 64 == 4)
            n[i / 64 % 3] = NAN;
        if (i % 64 == 5)
            n[0] = n[1] = n[2] = 0.0f;
        if (i % 64 == 6)
            for (int k = 0; k < 3; k++)
                n[k] *= 1e30f;
    }
}

void receivers_free(receivers *r)
{
    free(r->points);
    free(r->normals);
    free(r->ids);
}

void receivers_make_patches(receivers *r, const shape *s, size_t count,
                            double spread, double off)
{
    test_random random = random_seed(815);
    r->count = count;
    r->points = malloc(3 * count * sizeof(float));
    r->normals = malloc(3 * count * sizeof(float));
    r->ids = NULL;
    REQUIRE(r->points && r->normals);
    for (size_t i = 0; i < count;) {
        const mesh *m =
            &s->parts[random_below(&random, (uint32_t)s->part_count)].m;
        const size_t t = random_below(&random, (uint32_t)m->triangle_count);
        const float *c[3];
        double e[2][3], n[3], length = 0.0;
        for (int k = 0; k < 3; k++)
            c[k] = mesh_corner(m, t, k);
        for (int k = 0; k < 3; k++) {
            e[0][k] = (double)c[1][k] - (double)c[0][k];
            e[1][k] = (double)c[2][k] - (double)c[0][k];
        }
        for (int k = 0; k < 3; k++) {
            const int x = (k + 1) % 3, y = (k + 2) % 3;
            n[k] = e[0][x] * e[1][y] - e[0][y] * e[1][x];
            length += n[k] * n[k];
        }
        length = length > 0.0 ? sqrt(length) : 1.0;
        const size_t end = i + 100 < count ? i + 100 : count;
        const double u0 = random_in(&random, 0, 1), v0 = 1.0 - u0;
        for (; i < end; i++) {
            const double u = u0 + spread * random_in(&random, -1, 1),
                         v = v0 + spread * random_in(&random, -1, 1);
            for (int k = 0; k < 3; k++) {
                r->normals[3 * i + (size_t)k] = (float)(n[k] / length);
                r->points[3 * i + (size_t)k] =
                    (float)((double)c[0][k] + u * e[0][k] + v * e[1][k] +
                            (i % 16 ? off : 0.0) * n[k] / length);
            }
        }
    }
}
