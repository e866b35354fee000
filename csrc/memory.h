/* All memory of the library comes through here. */
#ifndef VOCC_MEMORY_H
#define VOCC_MEMORY_H

#include "platform.h"
#include "vocc.h"

/* malloc and free. */
VOCC_INTERNAL vocc_allocator vocc_default_allocator(void);

/* count * size bytes (at least one), or NULL if there are not so many or the
 * product overflows.  Not cleared. */
VOCC_INTERNAL void *vocc_allocate(const vocc_allocator *allocator, size_t count,
                                  size_t size);

/* Frees what vocc_allocate gave; NULL does nothing. */
VOCC_INTERNAL void vocc_release(const vocc_allocator *allocator, void *memory);

/* The same as vocc_allocate, for what queries read again and again: in large
 * pages where there are any. */
VOCC_INTERNAL void *vocc_allocate_lasting(const vocc_allocator *allocator,
                                          size_t count, size_t size);

/* The same, at a multiple of VOCC_LINE: what is loaded 16 values at a time then
 * comes from one cache line each. */
VOCC_INTERNAL void *vocc_allocate_lines(const vocc_allocator *allocator,
                                        size_t count, size_t size);
VOCC_INTERNAL void vocc_release_lines(const vocc_allocator *allocator,
                                      void *memory);

/* Grows *items (of `size` bytes each, *capacity of them, the first `used` in
 * use) to hold at least `wanted`.  Returns 0, leaving all as it was, if there
 * is no memory. */
VOCC_INTERNAL int vocc_grow(const vocc_allocator *allocator, void **items,
                            size_t *capacity, size_t used, size_t wanted,
                            size_t size);

#endif
