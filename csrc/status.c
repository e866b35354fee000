#include "status.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

const char *vocc_status_string(int32_t status)
{
    switch (status) {
    case VOCC_OK:
        return "ok";
    case VOCC_ERROR_INVALID_ARGUMENT:
        return "invalid argument";
    case VOCC_ERROR_OUT_OF_MEMORY:
        return "out of memory";
    case VOCC_ERROR_CANCELLED:
        return "cancelled";
    case VOCC_ERROR_NOT_BUILT:
        return "the scene is not built";
    case VOCC_ERROR_FROZEN:
        return "the scene is built and can no longer be changed";
    case VOCC_ERROR_LIMIT:
        return "more than the format can hold";
    case VOCC_ERROR_UNSUPPORTED:
        return "not supported by this library or machine";
    case VOCC_ERROR_OPEN_MESH:
        return "a mesh is not closed";
    case VOCC_ERROR_THREAD:
        return "the system gave no thread or lock";
    case VOCC_ERROR_MISMATCH:
        return "a check of the answer found a difference";
    default:
        return "unknown status";
    }
}

#define VOCC_TEXT2(x) #x
#define VOCC_TEXT(x) VOCC_TEXT2(x)

const char *vocc_version(void)
{
    return VOCC_TEXT(VOCC_VERSION_MAJOR) "." VOCC_TEXT(
        VOCC_VERSION_MINOR) "." VOCC_TEXT(VOCC_VERSION_PATCH);
}

vocc_status vocc_fail(vocc_error *error, vocc_status status,
                      const char *argument, int64_t index, double value,
                      const char *format, ...)
{
    if (error) {
        va_list args;
        memset(error, 0, sizeof *error);
        error->status = (int32_t)status;
        (void)snprintf(error->argument, sizeof error->argument, "%s", argument);
        error->index = index;
        error->value = value;
        va_start(args, format);
        (void)vsnprintf(error->message, sizeof error->message, format, args);
        va_end(args);
    }
    return status;
}

vocc_status vocc_fail_plain(vocc_error *error, vocc_status status)
{
    return vocc_fail(error, status, "", -1, (double)NAN, "%s",
                     vocc_status_string((int32_t)status));
}

vocc_status vocc_check_range(vocc_error *error, const char *argument,
                             double value, double low, double high)
{
    if (value >= low && value <= high)
        return VOCC_OK;
    return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, argument, -1, value,
                     "%s is %.10g: it has to be from %.10g to %.10g", argument,
                     value, low, high);
}
