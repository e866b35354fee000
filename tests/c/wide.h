/* Every operation of csrc/wide_*.h, for test_wide.c.  They all have the same
 * names: wide_*.c are one body (wide_body.inc), compiled for each of them. */
#ifndef VOCC_TEST_WIDE_H
#define VOCC_TEST_WIDE_H

#include <stdint.h>

typedef struct wide_results {
    float add[16], sub[16], mul[16], div[16], min[16], max[16];
    float fma[16], nfma[16], abs[16], select[16], set[16];
    unsigned lt, le;
    float lowest, highest; /* of c */
    float packed[16];      /* of a */
    uint32_t numbers[16];
} wide_results;

/* a, b, c: 16 lanes, unaligned.  out[0]: of all lanes at once, out[1]: of parts
 * (nothing packed). */
typedef void (*wide_fn)(const float *a, const float *b, const float *c,
                        unsigned bits, wide_results out[2]);

void wide_plain(const float *a, const float *b, const float *c, unsigned bits,
                wide_results out[2]);
void wide_sse2(const float *a, const float *b, const float *c, unsigned bits,
               wide_results out[2]);
void wide_avx2(const float *a, const float *b, const float *c, unsigned bits,
               wide_results out[2]);
void wide_avx512(const float *a, const float *b, const float *c, unsigned bits,
                 wide_results out[2]);
void wide_neon(const float *a, const float *b, const float *c, unsigned bits,
               wide_results out[2]);

#endif
