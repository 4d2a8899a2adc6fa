/* The core as one unit, so that small functions are inlined across its files. */
#include "laws.c"
#include "formula.c"

#include "forces.c"
#include "memory.c"
#include "step.c"
#include "events.c"
#include "sample.c"
#include "predict.c"
#include "filter.c"
#include "twin.c"
