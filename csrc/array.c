#include "array.h"
#include "status.h"

#include <math.h>

vocc_status vocc_check_floats(vocc_array array, size_t count,
                              const char *argument, vocc_error *error)
{
    if (array.type != VOCC_FLOAT32 && array.type != VOCC_FLOAT64)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, argument, -1,
                         (double)array.type,
                         "%s: type %d is not VOCC_FLOAT32 or VOCC_FLOAT64",
                         argument, (int)array.type);
    if (!array.data && count)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, argument, -1,
                         (double)NAN, "%s: data is NULL", argument);
    return VOCC_OK;
}
