/* What the compiler and the machine give.  Included by every source file. */
#ifndef VOCC_PLATFORM_H
#define VOCC_PLATFORM_H

#include <float.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __FAST_MATH__
#error "vocc needs IEEE arithmetic: compile without -ffast-math"
#endif
#if defined(FLT_EVAL_METHOD) && FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16
#error "vocc needs float and double arithmetic without excess precision"
#endif

/* -DVOCC_SIMD=0 leaves only the plain C kernels. */
#ifndef VOCC_SIMD
#define VOCC_SIMD 1
#endif
#if VOCC_SIMD && (defined(__x86_64__) || defined(_M_X64))
#define VOCC_HAVE_SSE2 1
#else
#define VOCC_HAVE_SSE2 0
#endif

/* Code beyond the compiler's target, in functions of their own; isa.h says
 * whether it may run. */
#if VOCC_HAVE_SSE2 && (defined(__clang__) || __GNUC__ >= 9 || _MSC_VER >= 1920)
#define VOCC_HAVE_AVX2 1
#define VOCC_HAVE_AVX512 1
#else
#define VOCC_HAVE_AVX2 0
#define VOCC_HAVE_AVX512 0
#endif

#if VOCC_SIMD && (defined(__aarch64__) || defined(_M_ARM64)) &&                \
    !defined(__AARCH64EB__)
#define VOCC_HAVE_NEON 1
#else
#define VOCC_HAVE_NEON 0
#endif

/* Bytes of a cache line, and of 16 floats. */
#define VOCC_LINE 64u

#if defined(__GNUC__)
#define VOCC_INTERNAL __attribute__((visibility("hidden")))
/* Sanitizers take minutes over kernels that are inlined by force. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define VOCC_INLINE static inline
#else
#define VOCC_INLINE static inline __attribute__((always_inline))
#endif
#define VOCC_NOINLINE __attribute__((noinline))
#define VOCC_ALIGN(n) __attribute__((aligned(n)))
#define VOCC_LIKELY(x) __builtin_expect(!!(x), 1)
#define VOCC_UNLIKELY(x) __builtin_expect(!!(x), 0)
#define VOCC_PRINTF(f, a) __attribute__((format(printf, f, a)))
#define VOCC_PREFETCH(p) __builtin_prefetch(p)
#elif defined(_MSC_VER)
#define VOCC_INTERNAL
#define VOCC_INLINE static __forceinline
#define VOCC_NOINLINE __declspec(noinline)
#define VOCC_ALIGN(n) __declspec(align(n))
#define VOCC_LIKELY(x) (x)
#define VOCC_UNLIKELY(x) (x)
#define VOCC_PRINTF(f, a)
#define VOCC_PREFETCH(p) ((void)(p))
#else
#define VOCC_INTERNAL
#define VOCC_INLINE static inline
#define VOCC_NOINLINE
#define VOCC_ALIGN(n)
#define VOCC_LIKELY(x) (x)
#define VOCC_UNLIKELY(x) (x)
#define VOCC_PRINTF(f, a)
#define VOCC_PREFETCH(p) ((void)(p))
#endif

#endif
