/* Reading the rows of a borrowed vocc_array. */
#ifndef VOCC_ARRAY_H
#define VOCC_ARRAY_H

#include "platform.h"
#include "vocc.h"

VOCC_INLINE const void *vocc_row(const vocc_array *array, size_t row)
{
    return (const char *)array->data + (ptrdiff_t)row * array->stride;
}

/* Checks type and pointer of a float array of `count` rows. */
VOCC_INTERNAL vocc_status vocc_check_floats(vocc_array array, size_t count,
                                            const char *argument,
                                            vocc_error *error);

/* One component as double: exact for both types. */
VOCC_INLINE double vocc_get_float(const vocc_array *array, size_t row, int k)
{
    const void *p = vocc_row(array, row);
    return array->type == VOCC_FLOAT32 ? (double)((const float *)p)[k]
                                       : ((const double *)p)[k];
}

#endif
