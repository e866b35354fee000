#include "wide.h"

#include "../../csrc/platform.h"

#if VOCC_HAVE_AVX2

#include "../../csrc/target_avx2.h"
#include "../../csrc/wide_avx2.h"

#define WIDE_NAME wide_avx2
#include "wide_body.inc"

#include "../../csrc/target_end.h"

#else

typedef int not_empty; /* ISO C wants a declaration */

#endif
