/* One ray at a time. */
#include "lanes.h"
#include "shaft.h"
#include "traverse.h"
#include "triangle.h"
#include "vec3.h"

#include <math.h>
#include <string.h>

#define VOCC_LANES 1
#include "simd_plain.h"

#define VOCC_KERNELS vocc_kernels_single
#include "traverse_body.inc"
