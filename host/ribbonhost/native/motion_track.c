/* Follows a ribbon: start, health, restart. */
#include <string.h>

#include "motion_internal.h"

/* At the start the level reading is trusted, and the accelerometers hardly: what the shape's own acceleration
 * may be is yet unknown. This slack fades as the magnetometers tell how the ribbon turns. */
#define SLACK_MPS2   3.0
#define SLACK_FADE_S 0.04
#define LEARNING_S   0.2 /* when the slack is small enough to learn the noise */
#define SETTLED_S    0.35

/* Lost: for this long the samples have been that many times further off than expected. */
#define LOST_S      0.15
#define LOST_MISFIT 8.0
/* A gap after which a prediction says nothing. */
#define GAP_S  0.6
#define HOLE_S 0.05

/* Reciprocal of the share of outliers beyond which they are none. */
#define SURPRISE 4

int ribbon_motion_tracker_init(struct ribbon_motion_tracker *tracker,
                               const struct ribbon_motion_params *params) {
    memset(tracker, 0, sizeof *tracker);
    motion_learn_nothing(tracker);
    return ribbon_motion_model_init(&tracker->model, params);
}

void ribbon_motion_tracker_rewind(struct ribbon_motion_tracker *tracker) {
    tracker->status = RIBBON_MOTION_WAITING;
    tracker->has_learnt = 1;
    tracker->samples = tracker->restarts = tracker->outliers = tracker->rejected = 0;
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
    motion_learn_anew(t, sample->level_still);
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
    while (result == 0 && SURPRISE * t->fit.force_outliers > t->fit.forces && motion_livelier(t)) {
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
    if (sample->t_s - t->unsure_s > LEARNING_S && dt_s < HOLE_S)
        motion_learn(t, dt_s, after);
    if (judge_health(t, dt_s) && t->status == RIBBON_MOTION_TRACKING) {
        t->restarts++;
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

void ribbon_motion_step_outputs(const struct ribbon_motion_model *model, size_t count,
                                const struct ribbon_motion_step *steps, struct ribbon_motion_nodes *nodes,
                                struct ribbon_motion_work *work) {
    for (size_t i = 0; i < count; i++)
        if (steps[i].status != RIBBON_MOTION_WAITING)
            ribbon_motion_output(model, &steps[i].state, steps[i].covariance, &nodes[i], work);
}
