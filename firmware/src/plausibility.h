/* Which readings do not fit in with those of their neighbours on the ribbon.
 *
 * Neighbours share the motion and nearly the orientation, so that what one of them reads follows from what
 * the others read, however the ribbon moves and however rarely it is scanned. */
#ifndef PLAUSIBILITY_H
#define PLAUSIBILITY_H

#include <stdbool.h>

#include "ribbon.h"

/* The readings of all sensors of one kind. */
struct plausibility_input {
    float readings[RIBBON_NODE_COUNT][3]; /* node frame, any unit */
    bool present[RIBBON_NODE_COUNT];
    float size;        /* what a reading is like: g, or the field */
    bool has_two_axes; /* the third component is not measured, and lengths say nothing */
};

/* On entry suspect[i] says which readings are not to be trusted as neighbours; on return, which of those
 * present differ from what the trusted ones say: by more than a bend of 7 cm radius explains, or in length.
 * Where neighbours contradict each other, the one without which the others agree is marked. */
void plausibility_check(const struct plausibility_input *input, bool suspect[RIBBON_NODE_COUNT]);

#endif
