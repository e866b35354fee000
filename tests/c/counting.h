/* An allocator for the tests: counts, limits, fails on demand, and knows what
 * is live, so that leaks, double frees and foreign pointers are seen without a
 * sanitizer too.  Safe to use from several threads. */
#ifndef VOCC_TEST_COUNTING_H
#define VOCC_TEST_COUNTING_H

#include <stddef.h>
#include <stdint.h>

#include "../../csrc/vocc.h"

typedef struct counting counting;

counting *counting_create(void);
/* Reports what is still live as a failure of the running test. */
void counting_free(counting *memory);
vocc_allocator counting_allocator(counting *memory);

/* The k-th allocation from now on fails, and with `all_after` every later one;
 * k = 0: none fails. */
void counting_fail(counting *memory, uint64_t k, int all_after);
/* Whether an allocation was made to fail since counting_fail. */
int counting_failed(counting *memory);

size_t counting_live_blocks(counting *memory);
size_t counting_live_bytes(counting *memory);
size_t counting_peak_bytes(counting *memory);
uint64_t counting_calls(counting *memory);
/* Frees of what was not live. */
int counting_faults(counting *memory);
/* Forgets the faults: they were made on purpose. */
void counting_forgive(counting *memory);
void counting_reset_peak(counting *memory);

#endif
