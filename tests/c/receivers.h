/* Points with normals that light is asked for at. */
#ifndef VOCC_TEST_RECEIVERS_H
#define VOCC_TEST_RECEIVERS_H

#include "shapes.h"

#include <stddef.h>
#include <stdint.h>

typedef struct receivers {
    size_t count;
    float *points, *normals; /* rows of 3 */
    uint32_t *ids;           /* NULL: 0, 1, 2, ... */
} receivers;

/* Points off, on and inside the surface; normals mostly outward; some that are
 * not numbers. */
void receivers_make(receivers *r, const shape *s, size_t count);

/* Patches of neighbouring points just off the surface, as pixels see it: what
 * entry points and voxels settle at once.  Some patches are as small as their
 * distance from the surface, some points are exactly on it. */
void receivers_make_patches(receivers *r, const shape *s, size_t count,
                            double spread, double off);

void receivers_free(receivers *r);

#endif
