/* Means of readings while the ribbon rests, and the readings themselves while it moves; and how noisy they
 * are.
 *
 * A mean takes away noise and adds lag. Whether the ribbon rests is told by all of its sensors together:
 * while it does, what a reading differs from its mean has no direction (its own mean, the drift, stays small
 * against its size, the scatter). As soon as it has one, the mean gives way to the reading. (Trigg and Leach,
 * Exponential smoothing with an adaptive response rate, Operational Research Quarterly 18(1), 1967, for
 * vectors.) */
#ifndef REST_FILTER_H
#define REST_FILTER_H

#include <stdbool.h>

struct rest_filter_params {
    float rest_time_s;  /* longest mean; default 0.3 s */
    float window_s;     /* over which drift and scatter are means; default 0.5 s */
    float rest_ratio;   /* drift^2 / scatter, in units of what noise alone gives: rests below; default 2.5 */
    float motion_ratio; /* moves above; default 5 */
};

/* Of the ribbon. */
struct rest_filter_gain {
    float gain;        /* share of the newest reading in the mean, 1: no mean */
    float window_gain; /* share of the newest difference in drift and scatter */
};

/* Of one sensor. Unit u: that of the readings. */
struct rest_filter {
    float mean[3];   /* u */
    float drift[3];  /* mean of reading - mean, u */
    float scatter;   /* mean of |reading - mean|^2, u^2 */
    bool is_set;     /* the others are those of readings */
    bool has_jumped; /* the last reading was farther from what drift says than step_max */
};

void rest_filter_params_default(struct rest_filter_params *params);

/* Takes the readings of a scan into drift and scatter, those with valid[i]: they must be finite. A sensor
 * without a valid reading starts anew with the next one. A reading counts as no farther from what drift says
 * than step_max, u: a tap is soon forgotten. Returns the sum of their drift^2 / scatter, in units
 * of what noise alone gives (0 for a sensor that reads the same all the time). */
float rest_filter_watch(struct rest_filter *filters, unsigned count, const struct rest_filter_gain *gain,
                        const float (*readings)[3], const bool *valid, float step_max);

/* Sets the gains for a scan dt_s after the one before, from the mean of all sensors' ratios in it. */
void rest_filter_adapt(const struct rest_filter_params *params, float dt_s, float mean_ratio,
                       struct rest_filter_gain *gain);

/* Takes the readings that were watched into the means. */
void rest_filter_take(struct rest_filter *filters, unsigned count, const struct rest_filter_gain *gain,
                      const float (*readings)[3], const bool *valid);

/* What the sensor would read ahead_s after its last reading, if it went on as it moved on the whole during
 * the window. dt_s: between the last two scans. */
void rest_filter_predict(const struct rest_filter *filter, const struct rest_filter_gain *gain, float dt_s,
                         float ahead_s, float reading[3]);

/* Variance of one axis of a reading, and of the mean, as seen, u^2. */
float rest_filter_reading_variance(const struct rest_filter *filter, const struct rest_filter_gain *gain);
float rest_filter_mean_variance(const struct rest_filter *filter, const struct rest_filter_gain *gain);

#endif
