/* Which sensors' readings change otherwise than those of their neighbours on the ribbon: slow drifts.
 *
 * A drift is told from a bend by its rate. What a reading changed by in the last half second lies on a line
 * with what its neighbours' readings changed by, within a share of the motion, whatever shape the ribbon has.
 */
#ifndef DRIFT_H
#define DRIFT_H

#include <stdbool.h>
#include <stdint.h>

#include "plausibility.h"
#include "ribbon.h"

/* Readings are compared with those of 0.4 to 0.6 s ago. */
#define DRIFT_SNAPSHOTS 3u

/* Of the sensors of one kind; bit i of a mask is sensor i. All zeros: nothing is known. */
struct drift {
    float snapshots[DRIFT_SNAPSHOTS][RIBBON_NODE_COUNT][3]; /* readings */
    uint16_t taken[DRIFT_SNAPSHOTS];                        /* of which sensors */
    uint8_t oldest;                                         /* snapshot */
    uint16_t doubted;                                       /* at the last look, not at the one before */
    uint16_t named;                                         /* at two looks or more, one after the other */
    uint32_t snapshot_us, look_us, named_us;
};

/* For when all readings change at once. */
void drift_reset(struct drift *drift);

/* Whether it is time for a look, twenty a second. */
bool drift_is_due(const struct drift *drift, uint32_t now_us);

/* Looks at the readings of a scan. Those of `trusted` sensors count, and of those named before. Returns the
 * sensors that drift; each is named at every look, until it has changed no more than its neighbours, or for
 * two seconds: then what it reads is taken for the truth. */
uint16_t drift_look(struct drift *drift, const struct plausibility_input *input, uint16_t trusted,
                    uint32_t now_us);

#endif
