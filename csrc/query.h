/* What all queries share: options, workers, counters. */
#ifndef VOCC_QUERY_H
#define VOCC_QUERY_H

#include "platform.h"
#include "scene.h"
#include "traverse.h"
#include "vocc.h"

/* One worker's own. */
typedef struct vocc_worker {
    vocc_tracer *tracer;
    vocc_block *block;
} vocc_worker;

/* A query under way. */
typedef struct vocc_query {
    const vocc_scene *scene;
    vocc_query_options options; /* checked; no zeros or AUTO left */
    int32_t occluders; /* for the hierarchies: as asked, where options.occluders
                          is for the kd-tree, whose order AUTO chooses */
    const vocc_kernels *kernels;
    vocc_worker workers[VOCC_MAX_THREADS];
    int worker_count;
    vocc_ticker ticker;
} vocc_query;

/* Checks scene and options (NULL: defaults) of a query of `jobs` jobs and makes
 * its workers.  After VOCC_OK, vocc_query_end has to follow. */
VOCC_INTERNAL vocc_status vocc_query_begin(vocc_query *query,
                                           const vocc_scene *scene,
                                           const vocc_query_options *options,
                                           size_t jobs, vocc_error *error);

/* Runs the jobs; each gets the query's worker by number. */
VOCC_INTERNAL vocc_status vocc_query_run(vocc_query *query, size_t jobs,
                                         vocc_job_fn run, void *context);

/* Adds up the counters (of a query that succeeded) and frees the workers. */
VOCC_INTERNAL vocc_status vocc_query_end(vocc_query *query, vocc_status status,
                                         vocc_error *error);

#endif
