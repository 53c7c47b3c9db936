/* One scan on its way through the fusion: what fusion.c, fusion_field.c and fusion_quality.c hand on to each
 * other. */
#ifndef FUSION_SCAN_H
#define FUSION_SCAN_H

#include "fusion.h"

struct fusion_scan {
    float dt_s; /* since the scan before, within bounds */
    bool accel_valid[RIBBON_NODE_COUNT];
    float accel_direction[RIBBON_NODE_COUNT][3]; /* unit vectors */
    float accel_variance[RIBBON_NODE_COUNT];     /* of a component of the direction, rad^2 */

    bool is_any_moving; /* of the accelerometers */

    bool up_valid[RIBBON_NODE_COUNT];
    float up[RIBBON_NODE_COUNT][3];         /* at the nodes, unit vectors */
    float tilt_variance[RIBBON_NODE_COUNT]; /* of a component of up, rad^2 */

    bool field_valid[RIBBON_NODE_COUNT];           /* measured at the node itself */
    bool field_trusted[RIBBON_NODE_COUNT];         /* and nothing says that it is not the local field */
    float field_ut[RIBBON_NODE_COUNT][3];          /* all three components */
    float field_noise_variance[RIBBON_NODE_COUNT]; /* of a component, uT^2 */
    float sensitivity_ut[RIBBON_NODE_COUNT];       /* change of what is measured with heading, uT a radian */
    float misfit_ut[RIBBON_NODE_COUNT][2];         /* two axes: what no heading explains, as in two_axis.h */
    bool is_ambiguous[RIBBON_NODE_COUNT];
};

/* fusion_field.c: the fields that were measured, with two axes completed to three. Needs up. */
void fusion_field_find(const struct fusion_params *params, const struct fusion_state *state,
                       const struct fusion_derived *derived, const struct fusion_input *input,
                       struct fusion_scan *scan);

/* fusion_quality.c: the variance of a component of accelerometer j's direction, rad^2. length_mps2: what it
 * reads. */
float fusion_quality_accel_variance(const struct fusion_params *params, const struct fusion_state *state,
                                    const struct fusion_input *input, unsigned j, float length_mps2);

/* The variance of a component of the field at node k from noise alone, uT^2. */
float fusion_quality_field_variance(const struct fusion_state *state, const struct fusion_input *input,
                                    unsigned k);

/* Starts or counts down the time for which accelerometer j is called moving. */
void fusion_quality_watch_level(const struct fusion_params *params, struct fusion_state *state,
                                struct fusion_scan *scan, unsigned j, float length_mps2);

/* The same for node k and what may be wrong with its field. explained_ut: what its neighbours say it should
 * be. */
void fusion_quality_watch_field(const struct fusion_params *params, struct fusion_state *state,
                                const struct fusion_derived *derived, const struct fusion_input *input,
                                const struct fusion_scan *scan, unsigned k, const float explained_ut[3]);

/* Standard deviation of the orientation of node k, worst axis, rad. field_variance: of a component, uT^2. */
float fusion_quality_sigma(const struct fusion_params *params, const struct fusion_scan *scan,
                           float field_variance, unsigned k);

/* enum wire_quality */
uint8_t fusion_quality_flags(const struct fusion_state *state, const struct fusion_derived *derived,
                             const struct fusion_scan *scan, unsigned k);

#endif
