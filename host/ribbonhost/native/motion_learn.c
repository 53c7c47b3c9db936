/* What a tracker learns of the sensors and of the motion: variances of noise, offsets, jerks and the anchor.
 */
#include <float.h>
#include <stdlib.h>
#include <string.h>

#include "motion_internal.h"

#define MISFIT_FADE_S 0.05
#define SURPLUS_MAX   3.0

/* Variance of the anchor's acceleration that counts as rest, and with which a ribbon that is found moving
 * starts. */
#define ANCHOR_REST  1e-7
#define ANCHOR_START 0.1
#define ANCHOR_ALARM 4.0
#define ANCHOR_RATE  10.0 /* change a second and unit of surplus */
#define POWER_FADE_S 0.5

#define NOISE_MIN     0.2
#define NOISE_MAX     400.0
#define NOISE_FADE_S  0.5
#define NOISE_LEARN_S 0.03
#define NOISE_GONE_S  0.05
#define RESIDUAL_GONE 0.3
#define RESIDUAL_MAX  10.0

/* Share of the accelerometers' residuals that may last by chance; variance of offsets that are none. */
#define LASTING_MIN 0.3
#define OFFSET_REST 1e-4

/* Variance of the jerk with which a ribbon at rest starts; the least, in general, of the rotation of an
 * anchor that is shaken, and in units of the liveliest, which takes the others along. */
#define JERK_STILL  1e-4
#define JERK_MIN    3e-6
#define JERK_SHAKEN 2e-4
#define JERK_LEAK   0.01
#define JERK_MAX    100.0

/* Change a second and unit of surplus: when the sample does not fit, and by the corrections. */
#define JERK_RATE_ALL    80.0
#define JERK_RATE        15.0
#define MISFIT_GOAL      1.2
#define FIELD_MISFIT_MAX 1.5

/* Corrections that go one way: over how long, how large, and how much they count; share of the magnetometers
 * that are outliers with which they do not. */
#define DRIFT_FADE_S 0.3
#define DRIFT_MAX    5.0
#define DRIFT_SHARE  0.5
#define OUTLYING_MAX 0.125

void motion_learn_nothing(struct ribbon_motion_tracker *t) {
    t->scales =
        (struct ribbon_motion_scales){.force_noise = 1.0, .field_noise = 1.0, .force_offset = OFFSET_REST};
    motion_learn_anew(t, false);
}

void motion_learn_anew(struct ribbon_motion_tracker *t, bool still) {
    t->misfit = t->field_misfit = t->anchor_test = t->anchor_correction = 1.0;
    t->anchor_power = t->field_outlying = 0.0;
    memset(t->drift, 0, sizeof t->drift);
    memset(t->drift_variance, 0, sizeof t->drift_variance);
    for (size_t i = 0; i < RIBBON_MOTION_JERK_COUNT; i++)
        t->jerk_test[i] = 1.0;
    if (!t->has_learnt) {
        t->scales.anchor = still ? ANCHOR_REST : ANCHOR_START;
        for (size_t i = 0; i < RIBBON_MOTION_JERK_COUNT; i++)
            t->scales.jerk[i] = still ? JERK_STILL : 1.0;
    }
    t->has_learnt = 0;
}

bool motion_livelier(struct ribbon_motion_tracker *t) {
    double least = JERK_MAX;
    for (size_t i = 0; i < RIBBON_MOTION_JERK_COUNT; i++)
        least = fmin(least, t->scales.jerk[i]);
    for (size_t i = 0; i < RIBBON_MOTION_JERK_COUNT; i++)
        t->scales.jerk[i] = fmax(t->scales.jerk[i], fmin(JERK_MAX, fmax(1.0, 10.0 * least)));
    return least < JERK_MAX;
}

/* Weight of the newest value in a running mean with the given memory. */
static double newest(double dt_s, double fade_s) {
    return 1.0 - exp(-dt_s / fade_s);
}

static void mix(double *mean, double value, double weight) {
    *mean += weight * (value - *mean);
}

/* An acceleration of the anchor is made room for at once when samples ask for it. Without that its variance
 * shrinks while both corrections and the acceleration itself are smaller than it says: corrections alone do
 * not tell, for a smooth acceleration needs few, nor does the acceleration, which is unknown at first. */
static void judge_anchor(struct ribbon_motion_tracker *t, double dt_s,
                         const struct ribbon_motion_step *step) {
    mix(&t->anchor_test, t->fit.anchor_score, newest(dt_s, MISFIT_FADE_S));
    if (t->anchor_test > ANCHOR_ALARM) {
        t->scales.anchor = fmin(1.0, 10.0 * t->scales.anchor);
        return;
    }
    double a[3], sigma = t->model.params.anchor_sigma_mps2, since_s = step->state.t_s - t->start_s;
    motion_anchor_acceleration(&t->model, &step->state, a);
    for (int d = 0; d < 3; d++)
        a[d] -= step->state.known_mps2[d];
    mix(&t->anchor_correction, t->fit.anchor_correction, newest(dt_s, MISFIT_FADE_S));
    mix(&t->anchor_power, dot(a, a) / (3.0 * sigma * sigma), newest(dt_s, fmin(POWER_FADE_S, since_s)));
    double surplus = fmin(fmax(t->anchor_correction, t->anchor_power / t->scales.anchor), SURPLUS_MAX) - 1.0;
    t->scales.anchor = fmin(1.0, fmax(ANCHOR_REST, t->scales.anchor * exp(dt_s * ANCHOR_RATE * surplus)));
}

/* Moves a running mean of the noise toward what a residual says; returns the factor of the change. Noise that
 * has clearly gone, as when a magnet has passed, is forgotten sooner than it was learnt. */
static double learn_noise(double *noise, double residual, double dt_s, double fade_s) {
    double before = *noise;
    double weight = newest(dt_s, residual < RESIDUAL_GONE ? fmin(fade_s, NOISE_GONE_S) : fade_s);
    *noise += weight * before * (fmin(residual, RESIDUAL_MAX) - 1.0);
    *noise = fmin(NOISE_MAX, fmax(NOISE_MIN, *noise));
    return *noise / before;
}

static int ascending(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* White noise changes from sample to sample by twice its square; what changes less lasts: an offset. */
static void judge_offset(struct ribbon_motion_tracker *t, double dt_s, double fade_s,
                         struct ribbon_motion_step *step) {
    double square[RIBBON_MOTION_NODE_MAX], change[RIBBON_MOTION_NODE_MAX];
    size_t count = 0;
    for (size_t k = 0; k < t->model.params.nodes; k++) {
        const double *now = t->fit.force_left[k], *before = t->force_left[k];
        double difference[3] = {now[0] - before[0], now[1] - before[1], now[2] - before[2]};
        if (!isfinite(difference[0]))
            continue;
        square[count] = dot(now, now);
        change[count++] = 0.5 * dot(difference, difference);
    }
    memcpy(t->force_left, t->fit.force_left, sizeof t->force_left);
    if (count < 3)
        return;
    qsort(square, count, sizeof square[0], ascending);
    qsort(change, count, sizeof change[0], ascending);
    mix(&t->left_square, square[count / 2], newest(dt_s, fade_s));
    mix(&t->left_change, change[count / 2] * t->model.params.force_overlap, newest(dt_s, fade_s));
    double lasting = 1.0 - t->left_change / fmax(t->left_square, DBL_MIN);
    double share = (lasting - LASTING_MIN) / (1.0 - LASTING_MIN);
    double offset = fmax(OFFSET_REST, share * t->scales.force_noise);
    double growth = offset - t->scales.force_offset, sigma = t->model.params.accel_sigma_mps2;
    t->scales.force_offset = offset;
    /* What was learnt while offsets were thought to be smaller is known that much worse. */
    for (size_t i = 3 * t->model.block; growth > 0.0 && i < motion_anchor_index(&t->model); i++)
        step->covariance[i][i] += growth * sigma * sigma;
}

/* Squares of corrections in units of those expected, averaged over what each jerk drives. */
static void compare(const struct ribbon_motion_model *model, const double *correction, const double *variance,
                    double square[RIBBON_MOTION_JERK_COUNT]) {
    double count[RIBBON_MOTION_JERK_COUNT] = {0.0};
    memset(square, 0, RIBBON_MOTION_JERK_COUNT * sizeof(double));
    for (size_t i = 0; i < model->block; i++) {
        enum ribbon_motion_jerk kind = motion_jerk_kind(model, i);
        if (variance[i] > 0.0) {
            square[kind] += correction[i] * correction[i] / variance[i];
            count[kind] += 1.0;
        }
    }
    for (size_t kind = 0; kind < RIBBON_MOTION_JERK_COUNT; kind++)
        square[kind] = count[kind] > 0.0 ? square[kind] / count[kind] : 1.0;
}

/* Adds the corrections of a sample to those of the last fraction of a second. Returns how much of what they
 * tell counts: less as an anchor that moves, lasting errors of accelerometers or a magnet make them go one
 * way. */
static double add_to_drift(struct ribbon_motion_tracker *t, double dt_s) {
    double kept = exp(-dt_s / DRIFT_FADE_S);
    for (size_t i = 0; i < t->model.block; i++) {
        t->drift[i] = kept * t->drift[i] + t->fit.correction[i];
        t->drift_variance[i] = kept * kept * t->drift_variance[i] + t->fit.correction_variance[i];
    }
    double outlying = t->fit.fields > 0 ? (double)t->fit.field_outliers / (double)t->fit.fields : 0.0;
    mix(&t->field_outlying, outlying, newest(dt_s, DRIFT_FADE_S));
    return DRIFT_SHARE * (1.0 - t->scales.anchor) *
           (1.0 - fmin(1.0, t->scales.force_offset / t->scales.force_noise)) *
           fmax(0.0, 1.0 - t->field_outlying / OUTLYING_MAX);
}

/* Each jerk so that the corrections of what it drives are as large as expected, each by itself and as a sum:
 * too small a jerk makes small corrections that all go one way. When the sample as a whole does not fit,
 * those grow whose corrections are too large: the motion has become livelier. None falls far behind the
 * liveliest. */
static void judge_jerk(struct ribbon_motion_tracker *t, double dt_s) {
    double anchor = t->scales.anchor, least = JERK_MIN, drift = add_to_drift(t, dt_s);
    double force = fmin(fmax(t->misfit, t->fit.force_innovation - 1.0), SURPLUS_MAX) - MISFIT_GOAL;
    /* The field alone, which a magnet passing by can bend, never asks for more than the usual. */
    double field = fmin(t->field_misfit, FIELD_MISFIT_MAX) - MISFIT_GOAL;
    double each[RIBBON_MOTION_JERK_COUNT], sum[RIBBON_MOTION_JERK_COUNT];
    compare(&t->model, t->fit.correction, t->fit.correction_variance, each);
    compare(&t->model, t->drift, t->drift_variance, sum);
    for (size_t i = 0; i < RIBBON_MOTION_JERK_COUNT; i++)
        least = fmax(least, fmin(1.0, JERK_LEAK * t->scales.jerk[i]));
    for (size_t i = 0; i < RIBBON_MOTION_JERK_COUNT; i++) {
        double *jerk = &t->scales.jerk[i], *test = &t->jerk_test[i];
        mix(test, each[i], newest(dt_s, MISFIT_FADE_S));
        double all = *test > 1.0 ? fmax(0.0, *jerk < 1.0 ? fmax(force, field) : force) : 0.0;
        /* An anchor that is shaken in ways the model does not know makes corrections of its rotation, too. */
        double shaken = i < RIBBON_MOTION_JERK_TWIST ? anchor : 0.0;
        double own = drift * (fmin(sum[i], DRIFT_MAX) - 1.0) +
                     (1.0 - drift) * (fmin(*test / (1.0 + shaken), SURPLUS_MAX) - 1.0);
        *jerk *= exp(dt_s * (JERK_RATE_ALL * (1.0 - anchor) * all + JERK_RATE * own));
        double floor = fmax(fmax(JERK_MIN, JERK_SHAKEN * shaken), least * (1.0 - shaken));
        *jerk = fmin(JERK_MAX, fmax(floor, *jerk));
    }
}

void motion_learn(struct ribbon_motion_tracker *t, double dt_s, struct ribbon_motion_step *step) {
    struct ribbon_motion_scales *s = &t->scales;
    bool young = t->status == RIBBON_MOTION_SETTLING;
    double fade_s = young ? NOISE_LEARN_S : NOISE_FADE_S;
    mix(&t->misfit, t->fit.force_innovation, newest(dt_s, MISFIT_FADE_S));
    mix(&t->field_misfit, t->fit.field_innovation, newest(dt_s, MISFIT_FADE_S));
    double growth = fmax(1.0, fmax(learn_noise(&s->force_noise, t->fit.force_residual, dt_s, fade_s),
                                   learn_noise(&s->field_noise, t->fit.field_residual, dt_s, fade_s)));
    /* What was learnt with too small a noise is known that much worse. */
    for (size_t i = 0; young && growth > 1.0 && i < t->model.states; i++)
        for (size_t j = 0; j < t->model.states; j++)
            step->covariance[i][j] *= growth;
    judge_offset(t, dt_s, fade_s, step);
    if (young)
        return;
    judge_jerk(t, dt_s);
    judge_anchor(t, dt_s, step);
}
