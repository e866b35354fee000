#include "wide.h"

#include "../../csrc/platform.h"

#if VOCC_HAVE_AVX512

#include "../../csrc/target_avx512.h"
#include "../../csrc/wide_avx512.h"

#define WIDE_NAME wide_avx512
#include "wide_body.inc"

#include "../../csrc/target_end.h"

#else

typedef int not_empty; /* ISO C wants a declaration */

#endif
