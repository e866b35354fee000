#include "counting.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

typedef struct block {
    void *memory; /* NULL: free slot */
    size_t size;
} block;

struct counting {
    pthread_mutex_t lock;
    /* Open addressing with linear probing and backward-shift deletion. */
    block *blocks;
    size_t mask, used;
    size_t bytes, peak;
    uint64_t calls, countdown;
    int all_after, failed, faults;
};

static size_t slot_of(const counting *memory, const void *address)
{
    const uint64_t key = (uint64_t)(uintptr_t)address;
    return (size_t)((key * UINT64_C(0x9e3779b97f4a7c15)) >> 24) & memory->mask;
}

static void insert(counting *memory, block b)
{
    size_t slot = slot_of(memory, b.memory);
    while (memory->blocks[slot].memory)
        slot = (slot + 1) & memory->mask;
    memory->blocks[slot] = b;
}

static void grow(counting *memory)
{
    const block *old = memory->blocks;
    const size_t count = memory->mask + 1;
    memory->mask = 2 * count - 1;
    memory->blocks = calloc(2 * count, sizeof(block));
    if (!memory->blocks) {
        fprintf(stderr, "the test ran out of memory\n");
        exit(3);
    }
    for (size_t i = 0; i < count; i++)
        if (old[i].memory)
            insert(memory, old[i]);
    free((void *)(uintptr_t)old);
}

static void *allocate(void *user, size_t size)
{
    counting *memory = user;
    pthread_mutex_lock(&memory->lock);
    memory->calls++;
    void *out = NULL;
    int fail = 0;
    if (memory->countdown) {
        memory->countdown--;
        fail = memory->countdown == 0;
        if (fail)
            memory->failed = 1;
    } else if (memory->failed && memory->all_after) {
        fail = 1;
    }
    if (!fail) {
        out = malloc(size ? size : 1);
        if (out) {
            /* Nobody may rely on fresh memory being zero. */
            memset(out, 0xa5, size < 4096 ? size : 4096);
            if (2 * (memory->used + 1) > memory->mask)
                grow(memory);
            const block b = {out, size};
            insert(memory, b);
            memory->used++;
            memory->bytes += size;
            if (memory->bytes > memory->peak)
                memory->peak = memory->bytes;
        }
    }
    pthread_mutex_unlock(&memory->lock);
    return out;
}

static void deallocate(void *user, void *address)
{
    counting *memory = user;
    pthread_mutex_lock(&memory->lock);
    size_t slot = slot_of(memory, address);
    while (memory->blocks[slot].memory &&
           memory->blocks[slot].memory != address)
        slot = (slot + 1) & memory->mask;
    if (!address || !memory->blocks[slot].memory) {
        memory->faults++;
        pthread_mutex_unlock(&memory->lock);
        return;
    }
    const size_t size = memory->blocks[slot].size;
    memory->bytes -= size;
    memory->used--;
    size_t hole = slot;
    for (size_t next = (hole + 1) & memory->mask; memory->blocks[next].memory;
         next = (next + 1) & memory->mask) {
        const size_t home = slot_of(memory, memory->blocks[next].memory);
        if (((next - home) & memory->mask) >= ((next - hole) & memory->mask)) {
            memory->blocks[hole] = memory->blocks[next];
            hole = next;
        }
    }
    memory->blocks[hole].memory = NULL;
    pthread_mutex_unlock(&memory->lock);
    memset(address, 0xdd, size < 4096 ? size : 4096);
    free(address);
}

counting *counting_create(void)
{
    counting *memory = calloc(1, sizeof(*memory));
    if (!memory)
        exit(3);
    pthread_mutex_init(&memory->lock, NULL);
    memory->mask = 63;
    memory->blocks = calloc(64, sizeof(block));
    if (!memory->blocks)
        exit(3);
    return memory;
}

void counting_free(counting *memory)
{
    if (memory->used)
        test_fail(__FILE__, __LINE__, "%zu blocks (%zu bytes) were not freed",
                  memory->used, memory->bytes);
    if (memory->faults)
        test_fail(__FILE__, __LINE__, "%d frees of what was not allocated",
                  memory->faults);
    pthread_mutex_destroy(&memory->lock);
    free(memory->blocks);
    free(memory);
}

vocc_allocator counting_allocator(counting *memory)
{
    const vocc_allocator allocator = {allocate, deallocate, memory};
    return allocator;
}

void counting_fail(counting *memory, uint64_t k, int all_after)
{
    pthread_mutex_lock(&memory->lock);
    memory->countdown = k;
    memory->all_after = all_after;
    memory->failed = 0;
    pthread_mutex_unlock(&memory->lock);
}

int counting_failed(counting *memory)
{
    pthread_mutex_lock(&memory->lock);
    const int failed = memory->failed;
    pthread_mutex_unlock(&memory->lock);
    return failed;
}

size_t counting_live_blocks(counting *memory)
{
    return memory->used;
}

size_t counting_live_bytes(counting *memory)
{
    return memory->bytes;
}

size_t counting_peak_bytes(counting *memory)
{
    return memory->peak;
}

uint64_t counting_calls(counting *memory)
{
    return memory->calls;
}

int counting_faults(counting *memory)
{
    return memory->faults;
}

void counting_forgive(counting *memory)
{
    memory->faults = 0;
}

void counting_reset_peak(counting *memory)
{
    memory->peak = memory->bytes;
}
