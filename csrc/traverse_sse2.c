/* Packets of four in SSE2: every x86-64. */
#include "lanes.h"
#include "shaft.h"
#include "traverse.h"
#include "triangle.h"
#include "vec3.h"

#include <math.h>
#include <string.h>

#if VOCC_HAVE_SSE2

#define VOCC_LANES 4
#include "simd_sse2.h"

#define VOCC_KERNELS vocc_kernels_sse2
#include "traverse_body.inc"

#else

typedef int vocc_not_empty; /* ISO C wants a declaration */

#endif
