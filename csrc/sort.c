#include "sort.h"

static void sift_down(uint64_t *a, size_t root, size_t n)
{
    const uint64_t value = a[root];
    for (;;) {
        size_t child = 2 * root + 1;
        if (child >= n)
            break;
        if (child + 1 < n && a[child] < a[child + 1])
            child++;
        if (a[child] <= value)
            break;
        a[root] = a[child];
        root = child;
    }
    a[root] = value;
}

/* Insertion for a few keys, a heap for many. */
void vocc_sort(uint64_t *keys, size_t count)
{
    size_t i, j;
    if (count <= 24) {
        for (i = 1; i < count; i++) {
            const uint64_t value = keys[i];
            for (j = i; j > 0 && keys[j - 1] > value; j--)
                keys[j] = keys[j - 1];
            keys[j] = value;
        }
        return;
    }
    for (i = count / 2; i-- > 0;)
        sift_down(keys, i, count);
    for (i = count; i-- > 1;) {
        const uint64_t top = keys[0];
        keys[0] = keys[i];
        keys[i] = top;
        sift_down(keys, 0, i);
    }
}
