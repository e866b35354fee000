#if defined(__linux__) && !defined(_DEFAULT_SOURCE)
#define _DEFAULT_SOURCE /* madvise */
#endif

#include "memory.h"

#include <stdlib.h>
#include <string.h>

#ifdef __linux__
#include <sys/mman.h>
#include <unistd.h>
#endif

/* Bytes: smaller blocks stay in pages of the usual size. */
#define LARGE_PAGES ((size_t)8 << 20)

static void *default_allocate(void *user, size_t size)
{
    (void)user;
    return malloc(size);
}

static void default_deallocate(void *user, void *memory)
{
    (void)user;
    free(memory);
}

vocc_allocator vocc_default_allocator(void)
{
    vocc_allocator a = {default_allocate, default_deallocate, NULL};
    return a;
}

void *vocc_allocate(const vocc_allocator *allocator, size_t count, size_t size)
{
    if (count == 0)
        count = 1;
    if (size > SIZE_MAX / count)
        return NULL;
    return allocator->allocate(allocator->user, count * size);
}

void vocc_release(const vocc_allocator *allocator, void *memory)
{
    if (memory)
        allocator->deallocate(allocator->user, memory);
}

/* Pages of 2 MB save those who follow pointers through it most of the misses of
 * the processor's page table cache.  Not of memory that is not ours, and only
 * what is larger than several of them. */
static void ask_for_large_pages(const vocc_allocator *allocator, void *memory,
                                size_t size)
{
#if defined(__linux__) && defined(MADV_HUGEPAGE)
    const long page = sysconf(_SC_PAGESIZE);
    if (allocator->allocate == default_allocate && memory &&
        size >= LARGE_PAGES && page > 0) {
        const uintptr_t mask = (uintptr_t)page - 1u,
                        first = ((uintptr_t)memory + mask) & ~mask,
                        end = ((uintptr_t)memory + size) & ~mask;
        /* Where it is refused all works as well. */
        (void)madvise((void *)first, end - first, MADV_HUGEPAGE);
    }
#else
    (void)allocator, (void)memory, (void)size;
#endif
}

void *vocc_allocate_lasting(const vocc_allocator *allocator, size_t count,
                            size_t size)
{
    void *const memory = vocc_allocate(allocator, count, size);
    ask_for_large_pages(allocator, memory, count * size);
    return memory;
}

/* In front of the items: what the allocator gave. */
void *vocc_allocate_lines(const vocc_allocator *allocator, size_t count,
                          size_t size)
{
    char *memory, *items;
    if (size && count > (SIZE_MAX - 2 * VOCC_LINE) / size)
        return NULL;
    memory = vocc_allocate_lasting(allocator, 1, count * size + 2 * VOCC_LINE);
    if (!memory)
        return NULL;
    items = memory + 2 * VOCC_LINE - (uintptr_t)memory % VOCC_LINE;
    memcpy(items - sizeof memory, &memory, sizeof memory);
    return items;
}

void vocc_release_lines(const vocc_allocator *allocator, void *items)
{
    char *memory;
    if (!items)
        return;
    memcpy(&memory, (char *)items - sizeof memory, sizeof memory);
    vocc_release(allocator, memory);
}

int vocc_grow(const vocc_allocator *allocator, void **items, size_t *capacity,
              size_t used, size_t wanted, size_t size)
{
    size_t grown = *capacity + *capacity / 2 + 16;
    void *memory;
    if (wanted <= *capacity)
        return 1;
    if (grown < wanted)
        grown = wanted;
    memory = vocc_allocate(allocator, grown, size);
    if (!memory)
        return 0;
    if (used)
        memcpy(memory, *items, used * size);
    vocc_release(allocator, *items);
    *items = memory;
    *capacity = grown;
    return 1;
}
