#include "planes.h"
#include "memory.h"
#include "vec3.h"

enum { JOB_TRIANGLES = 16384 };

static void make_plane(const float *c, float plane[4])
{
    double e1[3], e2[3], n[3], largest = 0.0, products = 0.0, d = 0.0;
    int k;
    plane[0] = plane[1] = plane[2] = plane[3] = 0.0f;
    if (vocc_equal(c, c + 3) || vocc_equal(c + 3, c + 6) ||
        vocc_equal(c + 6, c)) {
        plane[3] = 1.0f;
        return;
    }
    for (k = 0; k < 3; k++) {
        e1[k] = (double)c[3 + k] - (double)c[k];
        e2[k] = (double)c[6 + k] - (double)c[k];
    }
    vocc_cross(e1, e2, n);
    for (k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        const double p = vocc_abs(e1[i] * e2[j]) + vocc_abs(e1[j] * e2[i]);
        products = p > products ? p : products;
        largest = vocc_abs(n[k]) > largest ? vocc_abs(n[k]) : largest;
    }
    /* Edges and products have errors of 2^-53, their difference as well. */
    if (!(largest > 0x1p-1000) ||
        !(5.0 * 0x1p-53 * products <= 0x1p-41 * largest))
        return;
    for (k = 0; k < 3; k++) {
        n[k] /= largest;
        d += n[k] * (double)c[k];
        plane[k] = (float)n[k];
    }
    plane[3] = (float)d;
}

static vocc_status make_some(void *context, size_t job, int worker,
                             vocc_jobs *jobs)
{
    const vocc_tree *tree = context;
    size_t i = job * JOB_TRIANGLES;
    const size_t end = i + JOB_TRIANGLES < tree->triangle_count
                           ? i + JOB_TRIANGLES
                           : tree->triangle_count;
    (void)worker;
    (void)jobs;
    for (; i < end; i++)
        make_plane(tree->corners + 9 * i, tree->planes + 4 * i);
    return VOCC_OK;
}

vocc_status vocc_make_planes(const vocc_allocator *allocator, vocc_tree *tree,
                             int threads, vocc_ticker *ticker)
{
    tree->planes =
        vocc_allocate(allocator, tree->triangle_count, 4 * sizeof(float));
    if (!tree->planes)
        return VOCC_ERROR_OUT_OF_MEMORY;
    return vocc_jobs_run(allocator, threads,
                         (tree->triangle_count + JOB_TRIANGLES - 1) /
                             JOB_TRIANGLES,
                         make_some, tree, ticker);
}
