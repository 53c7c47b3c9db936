/* The field at every node; where only two components are measured, the third from dip and magnitude. */
#include <math.h>
#include <string.h>

#include "branch.h"
#include "fusion_scan.h"
#include "two_axis.h"
#include "vec3.h"

#define NODES RIBBON_NODE_COUNT

/* A solution that fits worse than this could not be chosen, whatever the others say. */
static const float MISFIT_MAX_SIGMAS = 8.0f;

static float capped(float cost, float cost_max) {
    return cost < cost_max ? cost : cost_max;
}

/* The field that goes with a root. */
static void explain(const struct fusion_params *params, const struct two_axis_root *root, const float up[3],
                    float field_ut[3]) {
    for (unsigned axis = 0; axis < 3u; axis++)
        field_ut[axis] = params->field_horizontal_ut * root->north[axis] - params->field_down_ut * up[axis];
}

/* The cost of a field that differs from the last one of its node. */
static float time_cost(const struct fusion_params *params, const struct fusion_state *state,
                       const struct fusion_derived *derived, unsigned k, const float field_ut[3]) {
    if (state->last_field_age_s[k] < 0.0f)
        return 0.0f;
    const float turn = params->branch_still + params->branch_rate * state->last_field_age_s[k];
    const float step_squared = vec3_distance_squared(field_ut, state->last_field_ut[k]);
    const float tolerance_ut = turn * derived->field_ut;
    return capped(step_squared / (tolerance_ut * tolerance_ut), params->branch_cost_max);
}

/* The variance of what is measured of the field at node k, with what up says of it, uT^2. */
static float variance_of(const struct fusion_params *params, const struct fusion_derived *derived,
                         const struct fusion_scan *scan, unsigned k) {
    const float error_ut = params->field_error * derived->field_ut;
    return scan->field_noise_variance[k] + error_ut * error_ut +
           scan->tilt_variance[k] * params->field_down_ut * params->field_down_ut;
}

/* Which of its roots every node takes, if some node has two. */
static void choose(const struct fusion_params *params, const struct fusion_state *state,
                   const struct fusion_derived *derived, struct fusion_scan *scan,
                   const struct two_axis_root roots[NODES][2], const uint8_t counts[NODES],
                   uint8_t chosen[NODES]) {
    struct branch_node branches[NODES];
    for (unsigned k = 0; k < NODES; k++) {
        struct branch_node *const branch = &branches[k];
        const float variance = variance_of(params, derived, scan, k);
        float fit[2] = {0.0f, 0.0f};
        branch->count = counts[k];
        for (unsigned i = 0; i < counts[k]; i++) {
            explain(params, &roots[k][i], scan->up[k], branch->field[i]);
            fit[i] = two_axis_cost(&roots[k][i]) / variance;
            branch->cost[i] = fit[i] + time_cost(params, state, derived, k, branch->field[i]);
        }
        scan->is_ambiguous[k] = counts[k] == 2u && fit[1] - fit[0] < params->ambiguous_cost;
    }
    branch_choose(branches, params->branch_step * derived->field_ut, params->branch_cost_max, chosen);
}

static void complete(const struct fusion_params *params, const struct fusion_state *state,
                     const struct fusion_derived *derived, struct fusion_scan *scan) {
    struct two_axis_root roots[NODES][2];
    uint8_t counts[NODES];
    uint8_t chosen[NODES] = {0u};
    bool is_choice = false;
    for (unsigned k = 0; k < NODES; k++) {
        counts[k] = 0u;
        if (!scan->field_valid[k] || !scan->up_valid[k])
            continue;
        const float misfit_max_ut = MISFIT_MAX_SIGMAS * sqrtf(variance_of(params, derived, scan, k));
        counts[k] = (uint8_t)two_axis_solve(scan->up[k], params->blind[k], scan->field_ut[k],
                                            params->field_horizontal_ut, params->field_down_ut, misfit_max_ut,
                                            roots[k]);
        is_choice = is_choice || counts[k] == 2u;
    }
    if (is_choice)
        choose(params, state, derived, scan, (const struct two_axis_root(*)[2])roots, counts, chosen);
    for (unsigned k = 0; k < NODES; k++) {
        scan->field_valid[k] = counts[k] > 0u;
        if (!scan->field_valid[k])
            continue;
        const struct two_axis_root *const root = &roots[k][chosen[k]];
        explain(params, root, scan->up[k], scan->field_ut[k]);
        memcpy(scan->misfit_ut[k], root->misfit, sizeof scan->misfit_ut[k]);
        scan->sensitivity_ut[k] = root->sensitivity;
    }
}

void fusion_field_find(const struct fusion_params *params, const struct fusion_state *state,
                       const struct fusion_derived *derived, const struct fusion_input *input,
                       struct fusion_scan *scan) {
    for (unsigned k = 0; k < NODES; k++) {
        rest_filter_predict(&state->field[k], &state->gain, scan->dt_s, input->field_age_s[k],
                            scan->field_ut[k]);
        scan->field_noise_variance[k] = fusion_quality_field_variance(state, input, k);
        scan->sensitivity_ut[k] = params->field_horizontal_ut;
        scan->misfit_ut[k][0] = scan->misfit_ut[k][1] = 0.0f;
        scan->is_ambiguous[k] = false;
    }
    if (params->has_two_axes)
        complete(params, state, derived, scan);
}
