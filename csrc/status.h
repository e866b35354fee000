/* Filling a vocc_error. */
#ifndef VOCC_STATUS_H
#define VOCC_STATUS_H

#include "platform.h"
#include "vocc.h"

/* Fills *error (which may be NULL) and returns `status`, so that a caller can
 * write `return vocc_fail(...)`.  argument may be "", index -1, value NaN. */
VOCC_INTERNAL vocc_status vocc_fail(vocc_error *error, vocc_status status,
                                    const char *argument, int64_t index,
                                    double value, const char *format, ...)
    VOCC_PRINTF(6, 7);

/* The same for a failure that has no argument to blame. */
VOCC_INTERNAL vocc_status vocc_fail_plain(vocc_error *error,
                                          vocc_status status);

/* INVALID_ARGUMENT unless low <= value <= high. */
VOCC_INTERNAL vocc_status vocc_check_range(vocc_error *error,
                                           const char *argument, double value,
                                           double low, double high);

#endif
