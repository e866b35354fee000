/* Beams in plain C. */
#include "beam.h"
#include "lanes.h"
#include "sampler.h"
#include "triangle.h"
#include "vec3.h"

#include <math.h>
#include <string.h>

#include "wide_plain.h"
#define VOCC_BEAM_KERNELS vocc_beam_kernels_plain
#include "beam_body.inc"
