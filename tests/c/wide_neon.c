#include "wide.h"

#include "../../csrc/platform.h"

#if VOCC_HAVE_NEON

#include "../../csrc/wide_neon.h"

#define WIDE_NAME wide_neon
#include "wide_body.inc"

#else

typedef int not_empty; /* ISO C wants a declaration */

#endif
