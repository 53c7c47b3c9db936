/* Drives the motion estimator through what samples can hold, for the sanitizers. */
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ribbon_motion.h"

enum { COUNT = 40 };

static double noise(void) {
    static unsigned state = 1u;
    state = state * 1664525u + 1013904223u;
    return (double)(state >> 8) / 8388608.0 - 1.0;
}

static void fill(struct ribbon_motion_sample *sample, size_t i, size_t nodes) {
    memset(sample, 0, sizeof *sample);
    sample->t_s = 0.01 * (double)i + (i > 20 ? 0.4 : 0.0) + (i > 30 ? 5.0 : 0.0);
    for (size_t k = 0; k < nodes; k++) {
        double shock = i == 25 ? 50.0 * noise() : 0.0;
        double force[3] = {0.01 * noise() + shock, 0.01 * noise(), 9.81 + 0.01 * noise()};
        double field[3] = {0.1 * noise(), 22.5 + 0.1 * noise(), -42.4};
        memcpy(sample->force_mps2[k], force, sizeof force);
        memcpy(sample->field_ut[k], field, sizeof field);
        sample->force_valid[k] = i != 12;
        sample->field_valid[k] = (i + k) % 7 != 0;
        sample->level_q[k][0] = 1.0;
        sample->level_valid[k] = i > 0;
    }
    if (i == 15)
        sample->force_mps2[nodes - 1][2] = sample->field_ut[0][0] = NAN;
}

/* Whether all but the first of `count` estimates are. */
static bool all_finite(const struct ribbon_motion_nodes *out, size_t count, size_t nodes) {
    bool all = true;
    for (size_t i = 1; i < count; i++)
        all = all && isfinite(out[i].position_m[nodes - 1][2] + out[i].sigma_rad[nodes - 1]);
    return all;
}

static int drive(size_t nodes, int field_axes) {
    struct ribbon_motion_params params = {.nodes = nodes,
                                          .pitch_m = 0.025,
                                          .gravity_mps2 = 9.81,
                                          .field_ut = {0.0, 22.5, -42.4},
                                          .field_axes = field_axes,
                                          .accel_sigma_mps2 = 0.006,
                                          .field_sigma_ut = 0.06,
                                          .force_overlap = 2.5,
                                          .force_jitter_s = 0.0014,
                                          .field_later_s = 0.012,
                                          .root_jerk = 3.0,
                                          .twist_jerk = 100.0,
                                          .bend_jerk = 100.0,
                                          .persistence_s = 0.3,
                                          .offset_persistence_s = 3.0,
                                          .anchor_sigma_mps2 = 1.7,
                                          .anchor_low_hz = 0.5,
                                          .anchor_high_hz = 1.5};
    struct ribbon_motion_tracker tracker;
    struct ribbon_motion_sample *samples = malloc(COUNT * sizeof *samples);
    struct ribbon_motion_step *steps = malloc((COUNT + 1) * sizeof *steps);
    struct ribbon_motion_state *states = malloc(COUNT * sizeof *states);
    struct ribbon_motion_nodes *out = malloc(COUNT * sizeof *out);
    struct ribbon_motion_work *work = malloc(ribbon_motion_work_bytes());
    for (size_t k = 0; k < nodes; k++)
        params.field_normal[k][2] = 1.0;
    int failed = ribbon_motion_tracker_init(&tracker, &params);
    for (size_t i = 0; i < COUNT; i++)
        fill(&samples[i], i, nodes);
    steps[0].status = RIBBON_MOTION_WAITING;
    failed |= ribbon_motion_run(&tracker, COUNT, samples, steps, work);
    ribbon_motion_smooth(&tracker.model, COUNT, steps + 1, states, out, COUNT - 5, 5, work);
    failed |= !all_finite(out, COUNT - 5, nodes);
    ribbon_motion_step_outputs(&tracker.model, COUNT, steps + 1, out, work);
    failed |= !all_finite(out, COUNT, nodes);
    failed |= tracker.restarts != 1 || steps[1].status != RIBBON_MOTION_WAITING;
    free(samples);
    free(steps);
    free(states);
    free(out);
    free(work);
    return failed;
}

int main(void) {
    int failed = drive(RIBBON_MOTION_NODE_MIN, 2) | drive(16, 2) | drive(RIBBON_MOTION_NODE_MAX, 3);
    if (failed)
        puts("an estimate is not finite, or a count is wrong");
    return failed != 0;
}
