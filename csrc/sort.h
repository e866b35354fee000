/* Sorting 64-bit keys in place, without memory and without a bad case. */
#ifndef VOCC_SORT_H
#define VOCC_SORT_H

#include "platform.h"

VOCC_INTERNAL void vocc_sort(uint64_t *keys, size_t count);

#endif
