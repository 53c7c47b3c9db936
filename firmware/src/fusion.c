/* Orientations of the nodes from specific force and magnetic field along the
 * ribbon. */
#include "fusion.h"

#include <math.h>
#include <string.h>

#include "fusion_scan.h"
#include "quaternion.h"
#include "vec3.h"
#include "wire.h" /* enum wire_quality */

#define NODES RIBBON_NODE_COUNT

/* The square of what is beyond anything a sensor can read, and far from what
 * overflows a float when squared.
 */
static const float READING_MAX_SQUARED = 1e8f;

/* A node beside disturbed ones is judged anew by those that are left, so often in a scan. */
#define WATCH_ROUNDS_MAX 3u

/* Between two scans, seconds. */
static const float INTERVAL_MIN_S = 1e-4f;
static const float INTERVAL_MAX_S = 10.0f;

/* What a reading adds to the scatter is bounded by so many times what the scatter may be. */
static const float STEP_TOLERANCES = 3.0f;

/* A field this close to the vertical (share of its magnitude) has no heading.
 */
static const float HORIZONTAL_MIN = 0.02f;

void fusion_params_default(struct fusion_params *params) {
    *params = (struct fusion_params){
        .gravity_mps2 = 9.80665f,
        .field_horizontal_ut = 22.53f,
        .field_down_ut = 42.38f,
        .has_two_axes = false,
        .accel_error = 0.003f,
        .field_error = 0.005f,
        .next_term = 0.45f,
        .level_tolerance = 0.03f,
        .shake_tolerance = 0.03f,
        .turn_tolerance = 1.0f,
        .field_tolerance = 0.025f,
        .dip_tolerance = 0.03f,
        .sweep_tolerance = 0.3f,
        .step_tolerance = 0.1f,
        .hold_s = 0.5f,
        .branch_step = 0.3f,
        .branch_rate = 2.0f,
        .branch_still = 0.1f,
        .branch_cost_max = 12.0f,
        .ambiguous_cost = 9.0f,
        .ambiguous_sigma_rad = 0.07f,
        .sigma_max_rad = 0.55f,
    };
    for (unsigned k = 0; k < NODES; k++)
        params->blind[k][2] = 1.0f;
    rest_filter_params_default(&params->rest);
}

static void derive_gravity(struct fusion_derived *derived, const bool valid[NODES]) {
    memcpy(derived->accel_valid, valid, sizeof derived->accel_valid);
    for (unsigned k = 0; k < NODES; k++)
        stencil_make(&derived->gravity[k], 2.0f * (float)k + 1.0f, valid, NODES, NODES);
}

static void derive_neighbours(struct fusion_derived *derived, const bool trusted[NODES]) {
    memcpy(derived->field_trusted, trusted, sizeof derived->field_trusted);
    for (unsigned k = 0; k < NODES; k++)
        stencil_make(&derived->neighbours[k], 2.0f * (float)k, trusted, NODES, k);
}

void fusion_reset(const struct fusion_params *params, struct fusion_state *state,
                  struct fusion_derived *derived) {
    memset(state, 0, sizeof *state);
    state->gain = (struct rest_filter_gain){.gain = 1.0f, .window_gain = 1.0f};
    for (unsigned k = 0; k < NODES; k++)
        state->last_field_age_s[k] = -1.0f;

    const float horizontal = params->field_horizontal_ut;
    const float down = params->field_down_ut;
    derived->field_ut = sqrtf(horizontal * horizontal + down * down);
    const bool none[NODES] = {false};
    derive_gravity(derived, none);
    derive_neighbours(derived, none);
}

static bool is_sane(const float reading[3]) {
    return vec3_dot(reading, reading) < READING_MAX_SQUARED; /* false for NaN */
}

/* Takes the readings into their filters, and says which are valid. */
static void filter(const struct fusion_params *params, struct fusion_state *state,
                   const struct fusion_input *input, struct fusion_scan *scan) {
    unsigned count = 0u;
    for (unsigned k = 0; k < NODES; k++) {
        scan->accel_valid[k] = input->accel_valid[k] && is_sane(input->accel_mps2[k]);
        scan->field_valid[k] = input->field_valid[k] && is_sane(input->field_ut[k]);
        count += (unsigned)scan->accel_valid[k] + (unsigned)scan->field_valid[k];
    }

    struct rest_filter_gain *const gain = &state->gain;
    const float accel_max_mps2 = STEP_TOLERANCES * params->shake_tolerance * params->gravity_mps2;
    const float ratio_sum =
        rest_filter_watch(state->accel, NODES, gain, input->accel_mps2, scan->accel_valid, accel_max_mps2) +
        rest_filter_watch(state->field, NODES, gain, input->field_ut, scan->field_valid, INFINITY);
    rest_filter_adapt(&params->rest, scan->dt_s, count > 0u ? ratio_sum / (float)count : 0.0f, gain);
    rest_filter_take(state->accel, NODES, gain, input->accel_mps2, scan->accel_valid);
    rest_filter_take(state->field, NODES, gain, input->field_ut, scan->field_valid);
}

/* Gravity's direction at every accelerometer, and from there at every node. */
static void find_up(const struct fusion_params *params, struct fusion_state *state,
                    struct fusion_derived *derived, const struct fusion_input *input,
                    struct fusion_scan *scan) {
    scan->is_any_moving = false;
    for (unsigned j = 0; j < NODES; j++) {
        rest_filter_predict(&state->accel[j], &state->gain, scan->dt_s, input->accel_age_s[j],
                            scan->accel_direction[j]);
        const float length_mps2 = vec3_norm(scan->accel_direction[j]);
        scan->accel_valid[j] = scan->accel_valid[j] && length_mps2 > 0.0f;
        if (scan->accel_valid[j])
            vec3_scale(scan->accel_direction[j], 1.0f / length_mps2);
        scan->accel_variance[j] = fusion_quality_accel_variance(params, state, input, j, length_mps2);
        fusion_quality_watch_level(params, state, scan, j, length_mps2);
    }
    if (memcmp(derived->accel_valid, scan->accel_valid, sizeof derived->accel_valid) != 0)
        derive_gravity(derived, scan->accel_valid);

    for (unsigned k = 0; k < NODES; k++) {
        const struct stencil *const stencil = &derived->gravity[k];
        const float (*const directions)[3] = (const float (*)[3])scan->accel_direction;
        const struct stencil_error told =
            stencil_apply_told(stencil, directions, scan->accel_variance, scan->up[k]);
        const float error = params->next_term * told.last_term;
        scan->up_valid[k] = vec3_normalise(scan->up[k]);
        scan->tilt_variance[k] = told.variance + error * error;
    }
}

/* North: the field's part across up. False where there is none. */
static bool find_north(const float up[3], const float field_ut[3], float magnitude_ut, float north[3]) {
    memcpy(north, field_ut, 3u * sizeof *north);
    vec3_add_scaled(north, -vec3_dot(field_ut, up), up);
    return vec3_norm(north) > HORIZONTAL_MIN * magnitude_ut && vec3_normalise(north);
}

/* A field that something disturbs is not used where others tell it. If most are disturbed they are all there
 * is: then it is rather the calibration that does not fit. Returns whether others are trusted than before. */
static bool find_trusted(const struct fusion_state *state, struct fusion_derived *derived,
                         struct fusion_scan *scan) {
    unsigned valid = 0u, trusted = 0u;
    for (unsigned k = 0; k < NODES; k++) {
        scan->field_trusted[k] =
            scan->field_valid[k] && !(state->magnitude_s[k] > 0.0f) && !(state->dip_s[k] > 0.0f);
        valid += scan->field_valid[k];
        trusted += scan->field_trusted[k];
    }
    if (2u * trusted < valid)
        memcpy(scan->field_trusted, scan->field_valid, sizeof scan->field_trusted);
    if (memcmp(derived->field_trusted, scan->field_trusted, sizeof derived->field_trusted) == 0)
        return false;
    derive_neighbours(derived, scan->field_trusted);
    return true;
}

/* Looks for what disturbs the field at the nodes. */
static void watch_field(const struct fusion_params *params, struct fusion_state *state,
                        const struct fusion_derived *derived, const struct fusion_input *input,
                        const struct fusion_scan *scan) {
    const float (*const fields_ut)[3] = (const float (*)[3])scan->field_ut;
    for (unsigned k = 0; k < NODES; k++) {
        float explained_ut[3];
        stencil_apply(&derived->neighbours[k], fields_ut, explained_ut);
        fusion_quality_watch_field(params, state, derived, input, scan, k,
                                   derived->neighbours[k].count > 0u ? explained_ut : fields_ut[k]);
    }
}

/* The orientation of node k from up and its own field, or its neighbours' where it has none to trust. */
static void orient(const struct fusion_params *params, const struct fusion_state *state,
                   const struct fusion_derived *derived, struct fusion_scan *scan,
                   const float *field_variance, unsigned k, struct fusion_node *node) {
    float *const field_ut = scan->field_ut[k];
    float variance = field_variance[k];
    const struct stencil *const neighbours = &derived->neighbours[k];
    if (!scan->field_trusted[k] && neighbours->count > 0u) {
        const float (*const fields_ut)[3] = (const float (*)[3])scan->field_ut;
        const float error_ut = params->next_term * stencil_last_term(neighbours, fields_ut);
        /* The mean of several is no better than one of them: they were not where they should have been. */
        const float bridged_variance =
            larger_of(stencil_variance(neighbours, field_variance), field_variance[k]) + error_ut * error_ut;
        /* A field that is off tells more than one that could be any. */
        if (!scan->field_valid[k] ||
            fusion_quality_sigma(params, scan, bridged_variance, k) < params->sigma_max_rad) {
            float explained_ut[3];
            stencil_apply(neighbours, fields_ut, explained_ut);
            /* With two axes the next scan's choice starts from here, not from what was not trusted. */
            memcpy(field_ut, explained_ut, sizeof explained_ut);
            variance = bridged_variance;
        }
    }

    float north[3];
    node->valid = scan->up_valid[k] && (scan->field_valid[k] || neighbours->count > 0u) &&
                  find_north(scan->up[k], field_ut, derived->field_ut, north);
    if (node->valid) {
        quaternion_from_north_up(north, scan->up[k], node->q_world_node);
        node->sigma_rad = fusion_quality_sigma(params, scan, variance, k);
        node->valid = node->sigma_rad < params->sigma_max_rad; /* false for NaN */
    }
    if (!node->valid) {
        node->sigma_rad = NAN;
        node->q_world_node[0] = 1.0f;
        node->q_world_node[1] = node->q_world_node[2] = node->q_world_node[3] = 0.0f;
    }
    node->flags = fusion_quality_flags(state, derived, scan, k);
    if (params->has_two_axes && scan->field_trusted[k] && node->flags == 0u &&
        node->sigma_rad > params->ambiguous_sigma_rad)
        node->flags = WIRE_QUALITY_HEADING_AMBIGUOUS;
}

static void remember(struct fusion_state *state, const struct fusion_scan *scan) {
    for (unsigned k = 0; k < NODES; k++) {
        if (scan->field_valid[k]) {
            memcpy(state->last_field_ut[k], scan->field_ut[k], sizeof state->last_field_ut[k]);
            state->last_field_age_s[k] = 0.0f;
        } else if (state->last_field_age_s[k] >= 0.0f) {
            state->last_field_age_s[k] += scan->dt_s;
        }
    }
}

void fusion_update(const struct fusion_params *params, struct fusion_state *state,
                   struct fusion_derived *derived, const struct fusion_input *input,
                   struct fusion_node nodes[NODES]) {
    struct fusion_scan scan;
    scan.dt_s = smaller_of(larger_of(input->dt_s, INTERVAL_MIN_S), INTERVAL_MAX_S);
    filter(params, state, input, &scan);
    find_up(params, state, derived, input, &scan);
    fusion_field_find(params, state, derived, input, &scan);
    find_trusted(state, derived, &scan);
    unsigned rounds = 0u;
    do
        watch_field(params, state, derived, input, &scan);
    while (find_trusted(state, derived, &scan) && ++rounds < WATCH_ROUNDS_MAX);

    const float error_ut = params->field_error * derived->field_ut;
    float field_variance[NODES];
    for (unsigned k = 0; k < NODES; k++)
        field_variance[k] = scan.field_noise_variance[k] + error_ut * error_ut;
    for (unsigned k = 0; k < NODES; k++)
        orient(params, state, derived, &scan, field_variance, k, &nodes[k]);
    remember(state, &scan);
}
