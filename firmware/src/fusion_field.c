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

static void complete(const struct fusion_params *params, const struct fusion_state *state,
                     const struct fusion_derived *derived, struct fusion_scan *scan) {
    const float horizontal_ut = params->field_horizontal_ut;
    const float down_ut = params->field_down_ut;
    const float error_ut = params->field_error * derived->field_ut;
    struct two_axis_root roots[NODES][2];
    struct branch_node branches[NODES];
    for (unsigned k = 0; k < NODES; k++) {
        struct branch_node *const branch = &branches[k];
        branch->count = 0u;
        if (!scan->field_valid[k] || !scan->up_valid[k])
            continue;
        const float variance =
            scan->field_noise_variance[k] + error_ut * error_ut + scan->tilt_variance[k] * down_ut * down_ut;
        branch->count =
            (uint8_t)two_axis_solve(scan->up[k], params->blind[k], scan->field_ut[k], horizontal_ut, down_ut,
                                    MISFIT_MAX_SIGMAS * sqrtf(variance), roots[k]);
        float fit[2] = {0.0f, 0.0f};
        for (unsigned i = 0; i < branch->count; i++) {
            for (unsigned axis = 0; axis < 3u; axis++)
                branch->field[i][axis] =
                    horizontal_ut * roots[k][i].north[axis] - down_ut * scan->up[k][axis];
            fit[i] = two_axis_cost(&roots[k][i]) / variance;
            branch->cost[i] = fit[i] + time_cost(params, state, derived, k, branch->field[i]);
        }
        scan->is_ambiguous[k] = branch->count == 2u && fit[1] - fit[0] < params->ambiguous_cost;
    }

    uint8_t chosen[NODES];
    branch_choose(branches, params->branch_step * derived->field_ut, params->branch_cost_max, chosen);
    for (unsigned k = 0; k < NODES; k++) {
        scan->field_valid[k] = branches[k].count > 0u;
        if (!scan->field_valid[k])
            continue;
        const struct two_axis_root *const root = &roots[k][chosen[k]];
        memcpy(scan->field_ut[k], branches[k].field[chosen[k]], sizeof scan->field_ut[k]);
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
