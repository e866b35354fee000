/* Whether it pays to test rays against occluders.  Rays deep in the shadow of a
 * solid need nothing else; those that pass near one and miss it pay for many
 * boxes in vain, and for the proof of where they end.  So packets of rays are
 * tested as long as that saved more of late than it took; after that now and
 * then one, to see.  Costs are in tests of 16 boxes. */
#ifndef VOCC_WORTH_H
#define VOCC_WORTH_H

#include "platform.h"

typedef struct vocc_worth {
    float balance;     /* what was saved of late, less what it took */
    float ray;         /* what it takes to trace a ray that is blocked */
    int skip, skipped; /* packets until the next is tested, and so far */
} vocc_worth;

enum { VOCC_FEW_SKIPPED = 2, VOCC_MANY_SKIPPED = 32 };

/* A ray's cost until some are traced; and how much more its saving counts:
 * measured, as is the share of the balance that stays. */
#define VOCC_USUAL_RAY 16.0f
#define VOCC_SAVING 2.0f
#define VOCC_KEPT 0.75f

VOCC_INLINE void vocc_worth_begin(vocc_worth *w)
{
    w->balance = 0.0f;
    w->ray = VOCC_USUAL_RAY;
    w->skip = VOCC_FEW_SKIPPED;
    w->skipped = 0;
}

/* Whether to test the next packet. */
VOCC_INLINE int vocc_worth_test(vocc_worth *w)
{
    if (w->balance >= 0.0f)
        return 1;
    if (w->skipped++ < w->skip)
        return 0;
    w->skipped = 0;
    w->skip = 2 * w->skip < VOCC_MANY_SKIPPED ? 2 * w->skip : VOCC_MANY_SKIPPED;
    return 1;
}

/* So many rays of a packet it took `tests` to find blocked. */
VOCC_INLINE void vocc_worth_tested(vocc_worth *w, int blocked, float tests)
{
    const float gain = (float)blocked * w->ray * VOCC_SAVING - tests;
    w->balance = VOCC_KEPT * w->balance + gain;
    if (gain > 0.0f)
        w->skip = VOCC_FEW_SKIPPED;
}

/* It took `tests` to trace so many rays, some of which triangles block.  Only
 * of packets that are blocked for the most part: those are what occluders save.
 */
VOCC_INLINE void vocc_worth_traced(vocc_worth *w, int rays, int blocked,
                                   float tests)
{
    if (blocked && 2 * blocked >= rays)
        w->ray += 0.125f * (tests / (float)rays - w->ray);
}

#endif
