/* Instruction sets: which there are, and which a query uses. */
#ifndef VOCC_ISA_H
#define VOCC_ISA_H

#include "platform.h"
#include "vocc.h"

/* Bit 1 << isa for each that this library has code for and that machine and
 * system run.  SCALAR is always there. */
VOCC_INTERNAL unsigned vocc_isa_detect(void);

/* *isa is `asked` (a vocc_isa), or, for AUTO, what VOCC_ISA in the environment
 * asks for, or the best that there is.  Fails as vocc_query_isa. */
VOCC_INTERNAL vocc_status vocc_isa_choose(int32_t asked, int32_t *isa,
                                          vocc_error *error);

#endif
