#include "wide.h"

#include "../../csrc/platform.h"

#if VOCC_HAVE_SSE2

#include "../../csrc/wide_sse2.h"

#define WIDE_NAME wide_sse2
#include "wide_body.inc"

#else

typedef int not_empty; /* ISO C wants a declaration */

#endif
