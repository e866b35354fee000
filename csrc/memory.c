#include "memory.h"

#include <stdlib.h>
#include <string.h>

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
