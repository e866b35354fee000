/* Packets of four in NEON: every aarch64. */
#include "lanes.h"
#include "shaft.h"
#include "traverse.h"
#include "triangle.h"
#include "vec3.h"

#include <math.h>
#include <string.h>

#if VOCC_HAVE_NEON

#define VOCC_LANES 4
#include "simd_neon.h"

#define VOCC_KERNELS vocc_kernels_neon
#include "traverse_body.inc"

#else

typedef int vocc_not_empty; /* ISO C wants a declaration */

#endif
