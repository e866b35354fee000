/* Beams in AVX2. */
#include "beam.h"
#include "lanes.h"
#include "sampler.h"
#include "triangle.h"
#include "vec3.h"

#include <math.h>
#include <string.h>

#if VOCC_HAVE_AVX2
#include "target_avx2.h"
#include "wide_avx2.h"
#define VOCC_BEAM_KERNELS vocc_beam_kernels_avx2
#include "beam_body.inc"
#include "target_end.h"
#else
typedef int vocc_no_beams_here; /* a file is not empty */
#endif
