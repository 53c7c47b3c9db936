/* Whether the calibration still fits: slow means of what it must give, whatever shape the ribbon has.
 *
 * A resting accelerometer reads g, and the level that its neighbours read; a magnetometer the local field's
 * magnitude and dip, but for what passes by. One node is looked at in each scan. */
#ifndef HEALTH_H
#define HEALTH_H

#include <stdint.h>

#include "fusion.h"
#include "ribbon.h"

/* Means of one node, and for how long they were taken. */
struct health_node {
    float accel[4]; /* |a| - g, and what it reads beyond the level of its neighbours, m/s^2 */
    float
        field[3]; /* |B| - local field, uT, and the shares of the time that its magnitude and dip were off */
    float accel_s, field_s;
};

struct health {
    struct health_node nodes[RIBBON_NODE_COUNT];
    uint8_t misfit[RIBBON_SLOT_COUNT]; /* enum wire_misfit */
    uint8_t next;                      /* node to look at */
};

/* Forgets all; for a new calibration. */
void health_reset(struct health *health);

/* Looks at one node after a scan. field_ut: magnitude of the local field. */
void health_watch(struct health *health, const struct fusion_params *params, const struct fusion_state *state,
                  const struct fusion_input *input, float field_ut);

/* By how much |a| or |B| of a slot is too long, as slot_health.length_permille says it. */
int8_t health_length_permille(const struct health *health, const struct fusion_params *params, float field_ut,
                              unsigned slot);

#endif
