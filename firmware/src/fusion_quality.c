/* How far an orientation can be trusted: variances, and reasons for less trust. */
#include <math.h>

#include "fusion_scan.h"
#include "vec3.h"
#include "wire.h"

/* Noise alone exceeds this many standard deviations once in 370 scans. */
static const float NOISE_SIGMAS = 3.0f;

/* An accelerometer with less weight than this in the interpolation does not make its node a moving one. */
static const float WEIGHT_MIN = 0.2f;

/* The field's rate over gravity's from which on no turn of the ribbon explains it, but one about the
 * vertical. */
static const float SWEEP_RATIO = 4.0f;

static float squared(float x) {
    return x * x;
}

/* Of a component of the mean, by the data sheet or by what is seen, whichever is more. */
static float noise_variance(const struct rest_filter *filter, const struct rest_filter_gain *gain,
                            float noise) {
    const float seen = rest_filter_reading_variance(filter, gain);
    return larger_of(seen, squared(noise)) * gain->gain / (2.0f - gain->gain);
}

float fusion_quality_accel_variance(const struct fusion_params *params, const struct fusion_state *state,
                                    const struct fusion_input *input, unsigned j, float length_mps2) {
    const float noise = noise_variance(&state->accel[j], &state->gain, input->accel_noise_mps2[j]);
    /* What pulls |a| away from g may pull as much across it, where it shows as a tilt. */
    const float pull = length_mps2 - params->gravity_mps2;
    return (noise + squared(pull)) / squared(params->gravity_mps2) + squared(params->accel_error);
}

float fusion_quality_field_variance(const struct fusion_state *state, const struct fusion_input *input,
                                    unsigned k) {
    return noise_variance(&state->field[k], &state->gain, input->field_noise_ut[k]);
}

/* How fast the mean of a sensor's readings moves, of the size given, 1/s. */
static float rate(const struct rest_filter *filter, const struct rest_filter_gain *gain, float size,
                  float dt_s) {
    return vec3_norm(filter->drift) * gain->gain / (size * dt_s);
}

static void hold(float *left_s, bool is_seen, float hold_s, float dt_s) {
    *left_s = is_seen ? hold_s : *left_s > dt_s ? *left_s - dt_s : 0.0f;
}

void fusion_quality_watch_level(const struct fusion_params *params, struct fusion_state *state,
                                struct fusion_scan *scan, unsigned j, float length_mps2) {
    const struct rest_filter *const filter = &state->accel[j];
    const float g = params->gravity_mps2;
    const float drift_squared = vec3_dot(filter->drift, filter->drift);
    const bool is_off_level = fabsf(length_mps2 - g) > params->level_tolerance * g;
    const bool is_shaken =
        filter->has_jumped || filter->scatter - drift_squared > squared(params->shake_tolerance * g);
    const bool is_turning = rate(filter, &state->gain, g, scan->dt_s) > params->turn_tolerance;
    hold(&state->unrest_s[j], scan->accel_valid[j] && (is_off_level || is_shaken || is_turning),
         params->hold_s, scan->dt_s);
    scan->is_any_moving = scan->is_any_moving || state->unrest_s[j] > 0.0f;
}

/* What magnitude and dip of the field at node k differ by from the local field's, uT: the dip as the change
 * of the vertical part of a field of the right magnitude. */
static void find_misfit(const struct fusion_params *params, const struct fusion_derived *derived,
                        const struct fusion_scan *scan, unsigned k, float *magnitude_ut, float *dip_ut) {
    if (params->has_two_axes) {
        *magnitude_ut = scan->misfit_ut[k][0];
        *dip_ut = scan->misfit_ut[k][1];
        return;
    }
    const float *const field_ut = scan->field_ut[k];
    const float magnitude = vec3_norm(field_ut);
    const float vertical = vec3_dot(scan->up[k], field_ut) * derived->field_ut / magnitude;
    *magnitude_ut = magnitude - derived->field_ut;
    *dip_ut = vertical + params->field_down_ut;
}

/* Whether a step is more than the interpolation between the neighbours may be wrong by. */
static bool is_step(const struct fusion_params *params, const struct fusion_derived *derived,
                    const struct fusion_scan *scan, unsigned k, const float step_ut[3], float tolerance_ut) {
    const float error_ut =
        params->next_term * stencil_last_term(&derived->neighbours[k], (const float (*)[3])scan->field_ut);
    return vec3_norm(step_ut) > tolerance_ut + error_ut;
}

void fusion_quality_watch_field(const struct fusion_params *params, struct fusion_state *state,
                                const struct fusion_derived *derived, const struct fusion_input *input,
                                const struct fusion_scan *scan, unsigned k, const float explained_ut[3]) {
    bool is_magnitude_off = input->field_implausible[k];
    bool is_dip_off = false;
    if (scan->field_valid[k] && scan->up_valid[k]) {
        const float noise_ut = NOISE_SIGMAS * sqrtf(scan->field_noise_variance[k] +
                                                    scan->tilt_variance[k] * squared(params->field_down_ut));
        float magnitude_ut;
        float dip_ut;
        find_misfit(params, derived, scan, k, &magnitude_ut, &dip_ut);
        is_magnitude_off = fabsf(magnitude_ut) > params->field_tolerance * derived->field_ut + noise_ut;
        is_dip_off = fabsf(dip_ut) > params->dip_tolerance * params->field_horizontal_ut + noise_ut;

        /* A magnet that comes near turns the field and leaves gravity alone. */
        const float field_rate = rate(&state->field[k], &state->gain, derived->field_ut, scan->dt_s);
        if (field_rate > params->sweep_tolerance &&
            field_rate > SWEEP_RATIO * rate(&state->accel[k], &state->gain, params->gravity_mps2, scan->dt_s))
            is_dip_off = true;

        float step_ut[3];
        vec3_subtract(scan->field_ut[k], explained_ut, step_ut);
        const float tolerance_ut = params->step_tolerance * derived->field_ut + noise_ut;
        if (vec3_dot(step_ut, step_ut) > squared(tolerance_ut) &&
            is_step(params, derived, scan, k, step_ut, tolerance_ut)) {
            const float along_ut = vec3_dot(step_ut, scan->field_ut[k]) / derived->field_ut;
            if (squared(along_ut) > 0.25f * vec3_dot(step_ut, step_ut))
                is_magnitude_off = true;
            else
                is_dip_off = true;
        }
    }
    hold(&state->magnitude_s[k], is_magnitude_off, params->hold_s, scan->dt_s);
    hold(&state->dip_s[k], is_dip_off, params->hold_s, scan->dt_s);
}

float fusion_quality_sigma(const struct fusion_params *params, const struct fusion_scan *scan,
                           float field_variance, unsigned k) {
    /* A tilt moves the vertical part of the field into the horizontal plane. */
    const float variance = field_variance + scan->tilt_variance[k] * squared(params->field_down_ut);
    /* Where the measured components do not change with heading to first order, they do to second:
     * horizontal * heading^2 / 2 = sqrt(variance). */
    const float second_order = 0.5f * params->field_horizontal_ut * sqrtf(variance);
    const float heading_variance = variance / (squared(scan->sensitivity_ut[k]) + second_order);
    return sqrtf(heading_variance + scan->tilt_variance[k]);
}

uint8_t fusion_quality_flags(const struct fusion_state *state, const struct fusion_derived *derived,
                             const struct fusion_scan *scan, unsigned k) {
    unsigned flags = 0u;
    const struct stencil *const gravity = &derived->gravity[k];
    for (unsigned i = 0; scan->is_any_moving && i < gravity->count; i++)
        if (fabsf(gravity->weight[i]) > WEIGHT_MIN && state->unrest_s[gravity->index[i]] > 0.0f)
            flags |= WIRE_QUALITY_MOVING;
    if (state->magnitude_s[k] > 0.0f)
        flags |= WIRE_QUALITY_FIELD_MAGNITUDE;
    if (state->dip_s[k] > 0.0f)
        flags |= WIRE_QUALITY_FIELD_DIP;
    if (scan->is_ambiguous[k])
        flags |= WIRE_QUALITY_HEADING_AMBIGUOUS;
    return (uint8_t)flags;
}
