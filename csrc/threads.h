/* A portable layer of threads: locks, and jobs handed to workers.
 *
 * Results must not depend on which worker takes which job: a job writes only
 * what is its own.  The calling thread is worker 0 and the only one to call
 * the user's progress function. */
#ifndef VOCC_THREADS_H
#define VOCC_THREADS_H

#include "platform.h"
#include "vocc.h"

#define VOCC_MAX_THREADS 256

typedef struct vocc_mutex vocc_mutex;

/* NULL if there is no memory or the system gives no lock. */
VOCC_INTERNAL vocc_mutex *vocc_mutex_create(const vocc_allocator *allocator);
VOCC_INTERNAL void vocc_mutex_free(const vocc_allocator *allocator,
                                   vocc_mutex *mutex);
VOCC_INTERNAL void vocc_mutex_lock(vocc_mutex *mutex);
VOCC_INTERNAL void vocc_mutex_unlock(vocc_mutex *mutex);

/* Processors that may run threads, at least 1. */
VOCC_INTERNAL int vocc_processor_count(void);

/* Seconds of a monotonic clock. */
VOCC_INTERNAL double vocc_seconds(void);

/* The user's callback, with its rate bounded.  Used by the calling thread. */
typedef struct vocc_ticker {
    vocc_progress_fn call;
    void *user;
    double from, to; /* the part of [0, 1] that this stage covers */
    double last;     /* fraction told last: it never falls */
    double time;     /* of the last call */
    int stopped;     /* the user has asked to stop: not called again */
} vocc_ticker;

VOCC_INTERNAL void vocc_ticker_init(vocc_ticker *ticker, vocc_progress_fn call,
                                    void *user);

/* Sets the part of the whole that the next ticks are about. */
VOCC_INTERNAL void vocc_ticker_stage(vocc_ticker *ticker, double from,
                                     double to);

/* `fraction` of the stage is done.  Non-zero: stop. */
VOCC_INTERNAL int vocc_tick(vocc_ticker *ticker, double fraction);

/* A run of jobs 0 .. count - 1, taken in order by `threads` workers. */
typedef struct vocc_jobs vocc_jobs;
typedef vocc_status (*vocc_job_fn)(void *context, size_t job, int worker,
                                   vocc_jobs *jobs);

/* Runs all jobs; returns the status of the failed job with the smallest
 * number, CANCELLED, or OK.  Fewer workers than asked for is no error. */
VOCC_INTERNAL vocc_status vocc_jobs_run(const vocc_allocator *allocator,
                                        int threads, size_t count,
                                        vocc_job_fn run, void *context,
                                        vocc_ticker *ticker);

/* For long jobs: lets worker 0 report, and any worker learn that the run is to
 * stop.  Non-zero: return VOCC_ERROR_CANCELLED. */
VOCC_INTERNAL int vocc_jobs_poll(vocc_jobs *jobs, int worker);

/* Work beside the caller's, on a thread of its own.  Its ticker tells it to
 * stop, and nothing to the user. */
typedef struct vocc_aside vocc_aside;
typedef vocc_status (*vocc_aside_fn)(void *context, vocc_ticker *ticker);

/* *aside is NULL if the system gives no thread: then call `run` yourself.
 * Fails: OUT_OF_MEMORY. */
VOCC_INTERNAL vocc_status vocc_aside_begin(const vocc_allocator *allocator,
                                           vocc_aside_fn run, void *context,
                                           vocc_aside **aside);

/* Waits for what `run` returns, after asking it to stop if `stop`; reports to
 * the user in the meantime. */
VOCC_INTERNAL vocc_status vocc_aside_end(const vocc_allocator *allocator,
                                         vocc_aside *aside, int stop,
                                         vocc_ticker *ticker);

#endif
