#if defined(_MSC_VER)
#define _CRT_SECURE_NO_WARNINGS /* getenv */
#endif
#include "isa.h"
#include "status.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#if VOCC_HAVE_AVX2 && defined(_MSC_VER)
#include <immintrin.h>
#include <intrin.h>
#endif

#define VARIABLE "VOCC_ISA"

const char *vocc_isa_name(int32_t isa)
{
    static const char *const names[] = {"auto", "scalar", "sse2",
                                        "avx2", "avx512", "neon"};
    return isa >= VOCC_ISA_AUTO && isa <= VOCC_ISA_NEON ? names[isa] : NULL;
}

#if VOCC_HAVE_AVX2

enum { AVX2 = 1, AVX512 = 2 };

#if defined(__GNUC__)

/* The compiler's library asks cpuid, and xgetbv for what the system saves, once
 * before main: in a virtual machine each cpuid takes a microsecond or more. */
static int find_avx(void)
{
    if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma") ||
        !__builtin_cpu_supports("bmi") || !__builtin_cpu_supports("bmi2"))
        return 0;
    if (!__builtin_cpu_supports("avx512f") ||
        !__builtin_cpu_supports("avx512bw") ||
        !__builtin_cpu_supports("avx512dq") ||
        !__builtin_cpu_supports("avx512vl"))
        return AVX2;
    return AVX2 | AVX512;
}

#else

/* Intel's manual, volume 2, CPUID leaves 1 and 7; volume 1, 13.3 (XCR0). */
static int find_avx(void)
{
    enum {
        FMA = 1 << 12,
        OSXSAVE = 1 << 27, /* leaf 1, ecx */
        BMI = 1 << 3,
        LEAF_AVX2 = 1 << 5,
        BMI2 = 1 << 8,
        F = 1 << 16,
        DQ = 1 << 17,
        BW = 1 << 30, /* leaf 7, ebx; and VL, bit 31 */
        YMM = 6,
        ZMM = 0xe6 /* what the system saves */
    };
    int leaf[4];
    unsigned saved;
    __cpuid(leaf, 0);
    if (leaf[0] < 7)
        return 0;
    __cpuid(leaf, 1);
    if (!(leaf[2] & FMA) || !(leaf[2] & OSXSAVE))
        return 0;
    saved = (unsigned)_xgetbv(0);
    __cpuidex(leaf, 7, 0);
    if ((saved & YMM) != YMM || !(leaf[1] & BMI) || !(leaf[1] & LEAF_AVX2) ||
        !(leaf[1] & BMI2))
        return 0;
    if ((saved & ZMM) != ZMM || !(leaf[1] & F) || !(leaf[1] & DQ) ||
        !(leaf[1] & BW) || leaf[1] >= 0)
        return AVX2;
    return AVX2 | AVX512;
}

#endif

#endif

unsigned vocc_isa_detect(void)
{
    unsigned found = 1u << VOCC_ISA_SCALAR;
#if VOCC_HAVE_SSE2
    found |= 1u << VOCC_ISA_SSE2;
#endif
#if VOCC_HAVE_AVX2
    {
        const int avx = find_avx();
        if (avx & AVX2)
            found |= 1u << VOCC_ISA_AVX2;
        if (VOCC_HAVE_AVX512 && avx & AVX512)
            found |= 1u << VOCC_ISA_AVX512;
    }
#endif
#if VOCC_HAVE_NEON
    found |= 1u << VOCC_ISA_NEON;
#endif
    return found;
}

/* "scalar, sse2": the names of some. */
static void list(unsigned some, char *text, size_t size)
{
    int32_t isa;
    text[0] = '\0';
    for (isa = VOCC_ISA_SCALAR; isa <= VOCC_ISA_NEON; isa++) {
        if (!(some >> isa & 1u))
            continue;
        if (text[0])
            strncat(text, ", ", size - strlen(text) - 1);
        strncat(text, vocc_isa_name(isa), size - strlen(text) - 1);
    }
}

vocc_status vocc_isa_choose(int32_t asked, int32_t *isa, vocc_error *error)
{
    enum { ALL = (2 << VOCC_ISA_NEON) - 2 };
    const unsigned found = vocc_isa_detect();
    const char *variable = NULL;
    char names[64];
    if (asked == VOCC_ISA_AUTO) {
        variable = getenv(VARIABLE);
        if (variable && variable[0] && strcmp(variable, "auto") != 0) {
            for (asked = VOCC_ISA_SCALAR; asked <= VOCC_ISA_NEON; asked++)
                if (strcmp(variable, vocc_isa_name(asked)) == 0)
                    break;
            if (asked > VOCC_ISA_NEON) {
                list(ALL, names, sizeof names);
                return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, VARIABLE,
                                 -1, (double)NAN,
                                 VARIABLE " is \"%.40s\": it has to be one of "
                                          "auto, %s",
                                 variable, names);
            }
        } else {
            /* The better, the higher the number. */
            for (asked = VOCC_ISA_NEON; !(found >> asked & 1u);)
                asked--;
            variable = NULL;
        }
    }
    if (!(found >> asked & 1u)) {
        list(found, names, sizeof names);
        return vocc_fail(
            error, VOCC_ERROR_UNSUPPORTED, variable ? VARIABLE : "isa", -1,
            (double)asked, "%s is %s: this machine and library have %s",
            variable ? VARIABLE : "isa", vocc_isa_name(asked), names);
    }
    *isa = asked;
    return VOCC_OK;
}
