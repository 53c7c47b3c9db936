/* Means of readings while the ribbon rests, and the readings themselves while it moves; and how noisy they
 * are. */
#include "rest_filter.h"

#include <string.h>

#include "vec3.h"

void rest_filter_params_default(struct rest_filter_params *params) {
    *params = (struct rest_filter_params){
        .rest_time_s = 0.3f,
        .window_s = 0.5f,
        .rest_ratio = 2.5f,
        .motion_ratio = 5.0f,
    };
}

/* By how much the largest ratio that there can be must exceed the one that means motion. */
static const float RATIO_MARGIN = 2.0f;

/* The square of the mean of white noise, over the mean of its square. */
static float ratio_of_noise(const struct rest_filter_gain *gain) {
    return gain->window_gain / (2.0f - gain->window_gain);
}

static void watch(struct rest_filter *filter, float window_gain, const float reading[3], float step_max) {
    float difference[3];
    float change[3];
    vec3_subtract(reading, filter->mean, difference);
    vec3_subtract(difference, filter->drift, change);
    const float step_squared = vec3_dot(change, change);
    filter->has_jumped = step_squared > step_max * step_max;
    if (filter->has_jumped) {
        vec3_scale(change, step_max / sqrtf(step_squared));
        memcpy(difference, filter->drift, sizeof difference);
        vec3_add_scaled(difference, 1.0f, change);
    }
    vec3_add_scaled(filter->drift, window_gain, change);
    filter->scatter += window_gain * (vec3_dot(difference, difference) - filter->scatter);
}

float rest_filter_watch(struct rest_filter *filters, unsigned count, const struct rest_filter_gain *gain,
                        const float (*readings)[3], const bool *valid, float step_max) {
    const float of_noise = ratio_of_noise(gain);
    float sum = 0.0f;
    for (unsigned i = 0; i < count; i++) {
        struct rest_filter *const filter = &filters[i];
        if (valid[i] && filter->is_set) {
            watch(filter, gain->window_gain, readings[i], step_max);
            const float drift_squared = vec3_dot(filter->drift, filter->drift);
            if (drift_squared > 0.0f)
                sum += drift_squared / (filter->scatter * of_noise);
            continue;
        }
        *filter = (struct rest_filter){.is_set = valid[i]};
        if (valid[i])
            memcpy(filter->mean, readings[i], sizeof filter->mean);
    }
    return sum;
}

void rest_filter_adapt(const struct rest_filter_params *params, float dt_s, float mean_ratio,
                       struct rest_filter_gain *gain) {
    gain->window_gain = dt_s / (params->window_s + dt_s);

    float motion = (mean_ratio - params->rest_ratio) / (params->motion_ratio - params->rest_ratio);
    motion = smaller_of(larger_of(motion, 0.0f), 1.0f);
    /* With few scans in a window the ratio is never far above that of noise: there are no means then. */
    const float largest_ratio = 1.0f / ratio_of_noise(gain);
    if (largest_ratio < RATIO_MARGIN * params->motion_ratio)
        motion = 1.0f;
    const float longest = dt_s / (params->rest_time_s + dt_s);
    /* 1, 1/2, 1/3 ...: the mean of all readings since it moved. */
    float gain_now = gain->gain / (1.0f + gain->gain);
    if (gain_now < longest)
        gain_now = longest;
    if (gain_now < motion)
        gain_now = motion;
    gain->gain = gain_now;
}

void rest_filter_take(struct rest_filter *filters, unsigned count, const struct rest_filter_gain *gain,
                      const float (*readings)[3], const bool *valid) {
    for (unsigned i = 0; i < count; i++) {
        if (!valid[i])
            continue;
        float difference[3];
        vec3_subtract(readings[i], filters[i].mean, difference);
        vec3_add_scaled(filters[i].mean, gain->gain, difference);
    }
}

void rest_filter_predict(const struct rest_filter *filter, const struct rest_filter_gain *gain, float dt_s,
                         float ahead_s, float reading[3]) {
    /* The mean moves by its gain's share of the drift in every scan. */
    memcpy(reading, filter->mean, sizeof filter->mean);
    vec3_add_scaled(reading, gain->gain * ahead_s / dt_s, filter->drift);
}

float rest_filter_reading_variance(const struct rest_filter *filter, const struct rest_filter_gain *gain) {
    const float around_drift = filter->scatter - vec3_dot(filter->drift, filter->drift);
    /* A reading differs from the mean of those before by the noise of both. */
    const float of_reading = around_drift * (2.0f - gain->gain) * (0.5f / 3.0f);
    return of_reading > 0.0f ? of_reading : 0.0f;
}

float rest_filter_mean_variance(const struct rest_filter *filter, const struct rest_filter_gain *gain) {
    return rest_filter_reading_variance(filter, gain) * gain->gain / (2.0f - gain->gain);
}
