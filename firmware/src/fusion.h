/* Orientations of the nodes from specific force and magnetic field along the ribbon.
 *
 * Gravity is interpolated along the ribbon to each magnetometer; the field gives the heading there, from
 * three of its components, or from two and what is known of dip and magnitude. Every orientation comes with
 * its standard deviation, from the geometry and the noise seen, and with the reasons to trust it less.
 *
 * Frames and units: vectors in the node frame (x tangent, y binormal, z normal); world east, north, up. */
#ifndef FUSION_H
#define FUSION_H

#include <stdbool.h>
#include <stdint.h>

#include "rest_filter.h"
#include "ribbon.h"
#include "stencil.h"

/* What can be tuned. Nothing in it depends on the scan rate. */
struct fusion_params {
    float gravity_mps2;        /* default 9.80665 */
    float field_horizontal_ut; /* of the local field; default 22.53 (48 uT, dip 62 deg) */
    float field_down_ut;       /* default 42.38 */
    bool has_two_axes;         /* one component of the field is not measured; default false */
    /* Which one: a unit vector of the node frame, node by node; default z. */
    float blind[RIBBON_NODE_COUNT][3];

    float accel_error; /* what calibration leaves of an accelerometer's error, share of g; default 0.003 */
    float field_error; /* the same of a magnetometer, share of the field; default 0.005 */
    float next_term;   /* error of an interpolation, share of its last term; default 0.45 */
    struct rest_filter_params rest;

    float level_tolerance; /* |a| may differ from g by so much, share of g; default 0.03 */
    float shake_tolerance; /* a may scatter by so much around a steady change, share of g; default 0.03 */
    float turn_tolerance;  /* a may turn so fast, rad/s; default 1 */
    float field_tolerance; /* |B| may differ from the local field by so much, share of it; default 0.025 */
    float dip_tolerance;   /* the field may be steeper or flatter by so much, rad; default 0.035 */
    float sweep_tolerance; /* the field may turn so fast while gravity does not, rad/s; default 0.3 */
    float
        step_tolerance; /* the field may differ from what its neighbours say by so much, share; default 0.1 */
    float hold_s;       /* a reason for less trust stays for so long after it was seen; default 0.5 s */

    float branch_step;  /* turn from a node to the next that costs 1 in the choice of a branch, rad; default
                           0.3 */
    float branch_rate;  /* turn in time, the same, rad/s; default 2 */
    float branch_still; /* and the part that does not grow with time, rad; default 0.1 */
    float branch_cost_max;     /* of a step in time or along the ribbon, chi squared; default 12 */
    float ambiguous_cost;      /* a second heading that fits worse by less is told, chi squared; default 9 */
    float ambiguous_sigma_rad; /* two axes: so is a range of headings as wide as this; default 0.07 */
    float sigma_max_rad;       /* an orientation worse than this is no orientation; default 0.55 */
};

/* What a reset clears. */
struct fusion_state {
    struct rest_filter_gain gain;
    struct rest_filter accel[RIBBON_NODE_COUNT]; /* m/s^2 */
    struct rest_filter field[RIBBON_NODE_COUNT]; /* uT */
    float unrest_s[RIBBON_NODE_COUNT];           /* how long the accelerometer is still called moving, s */
    float magnitude_s[RIBBON_NODE_COUNT];        /* how long the node's field is still called disturbed, s */
    float dip_s[RIBBON_NODE_COUNT];
    float last_field_ut[RIBBON_NODE_COUNT][3]; /* chosen last, all three components */
    float last_field_age_s[RIBBON_NODE_COUNT]; /* negative: there is none */
};

/* What follows from params and from which sensors are valid. */
struct fusion_derived {
    float field_ut;                               /* magnitude */
    bool accel_valid[RIBBON_NODE_COUNT];          /* that gravity[] was made for */
    bool field_trusted[RIBBON_NODE_COUNT];        /* that neighbours[] was made for */
    struct stencil gravity[RIBBON_NODE_COUNT];    /* from the accelerometers to each node */
    struct stencil neighbours[RIBBON_NODE_COUNT]; /* from the other trusted magnetometers to each node */
};

/* One scan, calibrated. Accelerometer j sits at 2 j pitches, magnetometer (and node) k at 2 k + 1. */
struct fusion_input {
    float dt_s; /* since the scan before */
    float accel_mps2[RIBBON_NODE_COUNT][3];
    float field_ut[RIBBON_NODE_COUNT][3]; /* with two axes it has no part along params->blind */
    float accel_age_s[RIBBON_NODE_COUNT]; /* of a reading at the time that the orientations are for */
    float field_age_s[RIBBON_NODE_COUNT];
    float accel_noise_mps2[RIBBON_NODE_COUNT]; /* of one axis of one reading, by the data sheet */
    float field_noise_ut[RIBBON_NODE_COUNT];
    bool accel_valid[RIBBON_NODE_COUNT];
    bool field_valid[RIBBON_NODE_COUNT];
    bool field_implausible[RIBBON_NODE_COUNT]; /* not valid, because it is not what its neighbours read */
};

struct fusion_node {
    float q_world_node[4]; /* unit, w >= 0 */
    float sigma_rad;       /* standard deviation of the orientation, worst axis; NaN if not valid */
    uint8_t flags;         /* enum wire_quality */
    bool valid;
};

void fusion_params_default(struct fusion_params *params);

/* Clears the state, and derives what follows from params; to be called after every change of params. */
void fusion_reset(const struct fusion_params *params, struct fusion_state *state,
                  struct fusion_derived *derived);

/* The orientations after one more scan. Readings that are not finite or absurdly large count as not valid;
 * they leave no trace in the state. */
void fusion_update(const struct fusion_params *params, struct fusion_state *state,
                   struct fusion_derived *derived, const struct fusion_input *input,
                   struct fusion_node nodes[RIBBON_NODE_COUNT]);

#endif
