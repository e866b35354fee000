/* From here to target_end.h functions are compiled for AVX2: only vocc_isa says
 * whether they may run.  Headers whose functions others call, too, come before
 * this one.  (MSVC has the intrinsics everywhere.) */
#include <immintrin.h>

#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx2,fma,bmi,bmi2"))),     \
                             apply_to = function)
#elif defined(__GNUC__)
#pragma GCC push_options
#pragma GCC target("avx2,fma,bmi,bmi2")
#endif
