#include "wide.h"

#include "../../csrc/wide_plain.h"

#define WIDE_NAME wide_plain
#include "wide_body.inc"
