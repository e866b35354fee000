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

/* In front of the items: what the allocator gave. */
void *vocc_allocate_lines(const vocc_allocator *allocator, size_t count,
                          size_t size)
{
    char *memory, *items;
    if (size && count > (SIZE_MAX - 2 * VOCC_LINE) / size)
        return NULL;
    memory = vocc_allocate(allocator, 1, count * size + 2 * VOCC_LINE);
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
