/* Beams in SSE2. */
#include "beam.h"
#include "lanes.h"
#include "sampler.h"
#include "triangle.h"
#include "vec3.h"

#include <math.h>
#include <string.h>

#if VOCC_HAVE_SSE2
#include "wide_sse2.h"
#define VOCC_BEAM_KERNELS vocc_beam_kernels_sse2
#include "beam_body.inc"
#else
typedef int vocc_no_beams_here; /* a file is not empty */
#endif
