/* Follows a ribbon: start, health, restart, and whether its anchor moves. */
#include <string.h>

#include "motion_internal.h"

/* At the start the level reading is trusted, and the accelerometers hardly: what the shape's own acceleration
 * may be is yet unknown. This slack fades as the magnetometers tell how the ribbon turns. */
#define SLACK_MPS2   3.0
#define SLACK_FADE_S 0.04
#define LEARNING_S   0.2 /* when the slack is small enough to learn the noise */
#define SETTLED_S    0.35

/* Lost: for this long the samples have been that many times further off than expected. */
#define LOST_S        0.15
#define LOST_MISFIT   8.0
#define MISFIT_FADE_S 0.05
/* A gap after which a prediction says nothing. */
#define GAP_S  0.6
#define HOLE_S 0.05

/* Variance of the anchor's acceleration that counts as rest. */
#define ANCHOR_REST        1e-7
#define ANCHOR_FADE_S      0.5
#define ANCHOR_TEST_FADE_S 0.05
#define ANCHOR_ALARM       4.0

/* Reciprocal of the share of outliers beyond which they are none. */
#define SURPRISE 4

#define NOISE_MIN     0.2
#define NOISE_MAX     400.0
#define NOISE_FADE_S  0.5
#define NOISE_LEARN_S 0.03
#define NOISE_GONE_S  0.05
#define RESIDUAL_GONE 0.3
#define RESIDUAL_MAX  10.0

#define JERK_STILL 1e-4
#define JERK_MIN   1e-9
#define JERK_MAX   100.0
/* Growth a second and unit of misfit; faster up than down, for motion starts sooner than it can be ruled out.
 */
#define JERK_UP          80.0
#define JERK_DOWN        60.0
#define MISFIT_GOAL      1.0
#define MISFIT_MAX       3.0
#define FIELD_MISFIT_MAX 1.5

int ribbon_motion_tracker_init(struct ribbon_motion_tracker *tracker,
                               const struct ribbon_motion_params *params) {
    memset(tracker, 0, sizeof *tracker);
    tracker->scales = (struct ribbon_motion_scales){
        .force_noise = 1.0, .field_noise = 1.0, .jerk = 1.0, .anchor = ANCHOR_REST};
    return ribbon_motion_model_init(&tracker->model, params);
}

/* Weight of the newest value in a running mean with the given memory. */
static double newest(double dt_s, double fade_s) {
    return 1.0 - exp(-dt_s / fade_s);
}

/* Score test for an acceleration of the anchor at this instant, a degree of freedom. With the information L
 * before and the covariance P after a correction x: the gradient is L x and its covariance L - L P L, at the
 * rows of the anchor's specific force. */
static double anchor_score(const struct ribbon_motion_model *model, const struct ribbon_motion_step *step,
                           struct ribbon_motion_work *work) {
    size_t n = model->states, last = n - 3;
    double *x = work->vector[0], *applied = work->vector[1], g[3], s[3][3];
    motion_subtract(model, &step->state, &step->predicted, x);
    for (size_t a = 0; a < 3; a++) {
        const double *row = step->information[last + a];
        g[a] = 0.0;
        for (size_t j = 0; j < n; j++)
            g[a] += row[j] * x[j];
    }
    for (size_t a = 0; a < 3; a++) {
        motion_apply(n, step->covariance, step->information[last + a], applied);
        for (size_t b = 0; b < 3; b++) {
            s[a][b] = step->information[last + a][last + b];
            for (size_t j = 0; j < n; j++)
                s[a][b] -= applied[j] * step->information[last + b][j];
        }
    }
    double score = motion_quadratic(s, g) / 3.0;
    return isfinite(score) && score > 0.0 ? score : 0.0;
}

/* Mean square of the anchor's acceleration as far as it is known, in units of its greatest variance. */
static double anchor_power(const struct ribbon_motion_model *model, const struct ribbon_motion_step *step) {
    double a[3], power = 0.0, uncertain = 0.0;
    motion_anchor_acceleration(model, &step->state, a);
    for (int d = 0; d < 3; d++)
        a[d] -= step->state.known_mps2[d];
    power = dot(a, a);
    uncertain = motion_anchor_variance(model, step);
    double sigma = model->params.anchor_sigma_mps2;
    return (power + uncertain) / (3.0 * sigma * sigma);
}

static void judge_anchor(struct ribbon_motion_tracker *t, double dt_s, const struct ribbon_motion_step *step,
                         struct ribbon_motion_work *work) {
    double score = anchor_score(&t->model, step, work);
    t->anchor_test += newest(dt_s, ANCHOR_TEST_FADE_S) * (score - t->anchor_test);
    if (t->anchor_test > ANCHOR_ALARM) {
        t->scales.anchor = fmin(1.0, 10.0 * t->scales.anchor);
        return;
    }
    double power = fmin(1.0, fmax(ANCHOR_REST, anchor_power(&t->model, step)));
    t->scales.anchor += newest(dt_s, ANCHOR_FADE_S) * (power - t->scales.anchor);
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

static void judge_misfit(struct ribbon_motion_tracker *t, double dt_s) {
    double weight = newest(dt_s, MISFIT_FADE_S);
    t->misfit += weight * (t->fit.force_innovation - t->misfit);
    t->field_misfit += weight * (t->fit.field_innovation - t->field_misfit);
}

/* Noise from what no motion explains; jerk so that innovations are as large as they should be. */
static void judge_scales(struct ribbon_motion_tracker *t, double dt_s, struct ribbon_motion_step *step) {
    struct ribbon_motion_scales *s = &t->scales;
    bool young = t->status == RIBBON_MOTION_SETTLING;
    double fade_s = young ? NOISE_LEARN_S : NOISE_FADE_S;
    double growth = fmax(1.0, fmax(learn_noise(&s->force_noise, t->fit.force_residual, dt_s, fade_s),
                                   learn_noise(&s->field_noise, t->fit.field_residual, dt_s, fade_s)));
    /* What was learnt with too small a noise is known that much worse. */
    if (young && growth > 1.0)
        for (size_t i = 0; i < t->model.states; i++)
            for (size_t j = 0; j < t->model.states; j++)
                step->covariance[i][j] *= growth;
    if (young)
        return;
    double surplus = fmin(fmax(t->misfit, t->fit.force_innovation - 1.0), MISFIT_MAX) - MISFIT_GOAL;
    /* The field alone, which a magnet passing by can bend, never asks for more than the usual. */
    if (s->jerk < 1.0)
        surplus = fmax(surplus, fmin(t->field_misfit, FIELD_MISFIT_MAX) - MISFIT_GOAL);
    s->jerk *= exp(dt_s * surplus * (surplus > 0.0 ? JERK_UP : JERK_DOWN));
    s->jerk = fmin(JERK_MAX, fmax(JERK_MIN, s->jerk));
}

/* Whether the tracker has lost the ribbon. */
static bool judge_health(struct ribbon_motion_tracker *t, double dt_s) {
    bool ill = t->misfit > LOST_MISFIT || 2 * t->fit.force_outliers > t->fit.forces ||
               2 * t->fit.field_outliers > t->fit.fields;
    t->ill_s = ill ? t->ill_s + dt_s : 0.0;
    return t->ill_s > LOST_S;
}

static int start(struct ribbon_motion_tracker *t, const struct ribbon_motion_sample *sample,
                 struct ribbon_motion_step *step, struct ribbon_motion_work *work) {
    t->scales.jerk = sample->level_still ? JERK_STILL : 1.0;
    t->scales.slack_mps2 = SLACK_MPS2;
    if (ribbon_motion_from_level(&t->model, sample, &t->scales, step, work) < 0)
        return step->status = t->status = RIBBON_MOTION_WAITING;
    int result = ribbon_motion_correct(&t->model, sample, NULL, &t->scales, step, &t->fit, work);
    if (result < 0) {
        t->rejected++;
        step->status = t->status = RIBBON_MOTION_WAITING;
        return result;
    }
    t->start_s = t->unsure_s = sample->t_s;
    t->ill_s = 0.0;
    t->misfit = t->field_misfit = t->anchor_test = 1.0;
    return step->status = t->status = RIBBON_MOTION_STARTED;
}

/* So many accelerometers do not err together: unless it is a shock, which no jerk of the shape explains, the
 * motion is livelier than it was. */
static int meet_surprise(struct ribbon_motion_tracker *t, const struct ribbon_motion_sample *sample,
                         const struct ribbon_motion_step *before, struct ribbon_motion_step *after,
                         struct ribbon_motion_work *work) {
    struct ribbon_motion_scales calm = t->scales;
    size_t outliers = t->fit.force_outliers;
    int result = 0;
    while (result == 0 && SURPRISE * t->fit.force_outliers > t->fit.forces && t->scales.jerk < JERK_MAX) {
        t->scales.jerk = fmin(JERK_MAX, fmax(1.0, 10.0 * t->scales.jerk));
        result = ribbon_motion_advance(&t->model, sample, &t->scales, before, after);
        if (result == 0)
            result = ribbon_motion_correct(&t->model, sample, NULL, &t->scales, after, &t->fit, work);
    }
    if (result < 0 || 2 * t->fit.force_outliers < outliers)
        return result;
    t->scales = calm;
    result = ribbon_motion_advance(&t->model, sample, &t->scales, before, after);
    return result < 0 ? result
                      : ribbon_motion_correct(&t->model, sample, NULL, &t->scales, after, &t->fit, work);
}

int ribbon_motion_track(struct ribbon_motion_tracker *t, const struct ribbon_motion_sample *sample,
                        const struct ribbon_motion_step *before, struct ribbon_motion_step *after,
                        struct ribbon_motion_work *work) {
    bool running = before && before->status != RIBBON_MOTION_WAITING;
    double dt_s = running ? sample->t_s - before->state.t_s : 0.0;
    if (running && !(dt_s > 0.0)) {
        t->rejected++;
        return RIBBON_MOTION_ERROR_TIME;
    }
    t->samples++;
    if (!running || dt_s > GAP_S) {
        t->restarts += running;
        return start(t, sample, after, work);
    }
    int result = ribbon_motion_advance(&t->model, sample, &t->scales, before, after);
    double age_s = sample->t_s - t->start_s;
    t->scales.slack_mps2 = SLACK_MPS2 * exp((t->unsure_s - sample->t_s) / SLACK_FADE_S);
    if (result == 0)
        result = ribbon_motion_correct(&t->model, sample, NULL, &t->scales, after, &t->fit, work);
    if (result == 0 && SURPRISE * t->fit.force_outliers > t->fit.forces)
        result = meet_surprise(t, sample, before, after, work);
    if (result < 0) {
        t->rejected++;
        t->restarts++;
        return start(t, sample, after, work);
    }
    t->outliers += t->fit.force_outliers + t->fit.field_outliers;
    t->status = age_s < SETTLED_S ? RIBBON_MOTION_SETTLING : RIBBON_MOTION_TRACKING;
    after->status = t->status;
    /* A shock tells nothing of how the ribbon moves, nor do the accelerometers while it dies away. */
    if (SURPRISE * t->fit.force_outliers > t->fit.forces)
        t->unsure_s = sample->t_s;
    /* Nor does the first sample after a hole: what lies in it was guessed. */
    if (sample->t_s - t->unsure_s > LEARNING_S && dt_s < HOLE_S) {
        judge_misfit(t, dt_s);
        judge_scales(t, dt_s, after);
        if (t->status == RIBBON_MOTION_TRACKING)
            judge_anchor(t, dt_s, after, work);
    }
    if (judge_health(t, dt_s) && t->status == RIBBON_MOTION_TRACKING) {
        t->restarts++;
        t->scales.anchor = 1.0;
        return start(t, sample, after, work);
    }
    return t->status;
}

int ribbon_motion_run(struct ribbon_motion_tracker *t, size_t count,
                      const struct ribbon_motion_sample *samples, struct ribbon_motion_step *steps,
                      struct ribbon_motion_work *work) {
    for (size_t i = 0; i < count; i++) {
        bool first = i == 0 && steps[0].status == RIBBON_MOTION_WAITING;
        double before_s = i == 0 ? steps[0].state.t_s : samples[i - 1].t_s;
        if (!first && !(samples[i].t_s > before_s))
            return RIBBON_MOTION_ERROR_TIME;
    }
    for (size_t i = 0; i < count; i++) {
        const struct ribbon_motion_step *before = steps[i].status == RIBBON_MOTION_WAITING ? NULL : &steps[i];
        if (ribbon_motion_track(t, &samples[i], before, &steps[i + 1], work) <= RIBBON_MOTION_WAITING) {
            steps[i + 1].status = RIBBON_MOTION_WAITING;
            steps[i + 1].state.t_s = samples[i].t_s;
        }
    }
    return 0;
}

void ribbon_motion_outputs(const struct ribbon_motion_model *model, size_t count,
                           const struct ribbon_motion_state *states,
                           const double (*covariances)[RIBBON_MOTION_STATE_MAX][RIBBON_MOTION_STATE_MAX],
                           struct ribbon_motion_nodes *nodes, struct ribbon_motion_work *work) {
    for (size_t i = 0; i < count; i++)
        ribbon_motion_output(model, &states[i], covariances ? covariances[i] : NULL, &nodes[i], work);
}

void ribbon_motion_step_outputs(const struct ribbon_motion_model *model, size_t count,
                                const struct ribbon_motion_step *steps, struct ribbon_motion_nodes *nodes,
                                struct ribbon_motion_work *work) {
    for (size_t i = 0; i < count; i++)
        if (steps[i].status != RIBBON_MOTION_WAITING)
            ribbon_motion_output(model, &steps[i].state, steps[i].covariance, &nodes[i], work);
}
