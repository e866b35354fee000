/* Packets of four in plain C: what every machine has, and the check of the
 * SIMD kernels. */
#include "lanes.h"
#include "shaft.h"
#include "traverse.h"
#include "triangle.h"
#include "vec3.h"

#include <math.h>
#include <string.h>

#define VOCC_LANES 4
#include "simd_plain.h"

#define VOCC_KERNELS vocc_kernels_plain4
#include "traverse_body.inc"
