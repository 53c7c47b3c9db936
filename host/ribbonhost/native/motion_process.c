/* How a state moves on by itself: white jerk of rotation, twist and bending, and the anchor's process. */
#include <string.h>

#include "motion_internal.h"

void motion_add(const struct ribbon_motion_model *model, const struct ribbon_motion_state *from,
                const double *d, struct ribbon_motion_state *to) {
    if (to != from)
        *to = *from;
    motion_turn(to->root, d);
    for (size_t i = 3; i < model->states; i++)
        to->x[i] += d[i];
}

void motion_subtract(const struct ribbon_motion_model *model, const struct ribbon_motion_state *to,
                     const struct ribbon_motion_state *from, double *d) {
    double relative[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            relative[3 * i + j] = dot(to->root + 3 * i, from->root + 3 * j);
    motion_log(relative, d);
    for (size_t i = 3; i < model->states; i++)
        d[i] = to->x[i] - from->x[i];
}

static void multiply(double a[3][3], double b[3][3], double out[3][3]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
}

/* exp(A dt) of x''' = -rate[2] x'' - rate[1] x' - rate[0] x by its series on a 64th of dt, squared six times.
 */
static void chain_transition(const double rate[3], double dt_s, double out[3][3]) {
    double h = dt_s / 64.0;
    double a[3][3] = {{0.0, h, 0.0}, {0.0, 0.0, h}, {-rate[0] * h, -rate[1] * h, -rate[2] * h}};
    double power[3][3] = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}};
    double next[3][3];
    memcpy(out, power, sizeof power);
    for (int term = 1; term <= 8; term++) {
        multiply(power, a, next);
        for (int i = 0; i < 9; i++) {
            power[i / 3][i % 3] = next[i / 3][i % 3] / term;
            out[i / 3][i % 3] += power[i / 3][i % 3];
        }
    }
    for (int k = 0; k < 6; k++) {
        multiply(out, out, next);
        memcpy(out, next, sizeof next);
    }
}

void motion_transition(const struct ribbon_motion_model *model, const struct ribbon_motion_state *before,
                       const struct ribbon_motion_state *after, struct motion_transition *f) {
    size_t nb = model->block;
    double turn[3], h = after->t_s - before->t_s;
    f->before = before;
    f->after = after;
    f->dt_s = h;
    /* Rates and accelerations die away with a time constant each, what they led to stays. */
    const double rest = 1.0 / model->params.persistence_s, settling[3] = {0.0, rest * rest, 2.0 * rest};
    chain_transition(settling, h, f->shape);
    chain_transition(model->anchor_rate, h, f->anchor);
    f->offset = exp(-h / model->params.offset_persistence_s);
    for (size_t d = 0; d < 3; d++)
        turn[d] = f->shape[0][1] * before->x[nb + d] + f->shape[0][2] * before->x[2 * nb + d];
    motion_exp(turn, f->turn);
    double half[9];
    for (size_t d = 0; d < 3; d++)
        turn[d] *= 0.5;
    motion_exp(turn, half);
    multiply3(before->root, half, f->middle);
}

/* A turn d of the anchor turns its specific force s along: the acceleration in the world is
 * root ds + d x (root s). */
static void to_world(const struct ribbon_motion_model *model, const struct ribbon_motion_state *state,
                     double *v) {
    size_t last = model->states - 3;
    double force[3], turned[3], forth[3];
    rotate(state->root, state->x + last, force);
    cross(v, force, turned);
    rotate(state->root, v + last, forth);
    for (size_t d = 0; d < 3; d++)
        v[last + d] = forth[d] + turned[d];
}

static void to_world_transposed(const struct ribbon_motion_model *model,
                                const struct ribbon_motion_state *state, double *v) {
    size_t last = model->states - 3;
    double force[3], turned[3], back[3];
    rotate(state->root, state->x + last, force);
    cross(force, v + last, turned);
    rotate_back(state->root, v + last, back);
    for (size_t d = 0; d < 3; d++) {
        v[d] += turned[d];
        v[last + d] = back[d];
    }
}

void motion_to_body(const struct ribbon_motion_model *model, const struct ribbon_motion_state *state,
                    double *v) {
    size_t last = model->states - 3;
    double force[3], turned[3];
    rotate(state->root, state->x + last, force);
    cross(v, force, turned);
    for (size_t d = 0; d < 3; d++)
        turned[d] = v[last + d] - turned[d];
    rotate_back(state->root, turned, v + last);
}

static void to_body_transposed(const struct ribbon_motion_model *model,
                               const struct ribbon_motion_state *state, double *v) {
    size_t last = model->states - 3;
    double force[3], turned[3], forth[3];
    rotate(state->root, state->x + last, force);
    rotate(state->root, v + last, forth);
    cross(force, forth, turned);
    for (size_t d = 0; d < 3; d++) {
        v[d] -= turned[d];
        v[last + d] = forth[d];
    }
}

/* The step with the anchor's acceleration in the world. */
static void forward_world(const struct ribbon_motion_model *model, const struct motion_transition *f,
                          double *v) {
    size_t nb = model->block;
    double turn[3], root[3], *p = v + motion_anchor_index(model);
    const double (*g)[3] = f->shape;
    for (size_t d = 0; d < 3; d++)
        turn[d] = g[0][1] * v[nb + d] + g[0][2] * v[2 * nb + d];
    rotate(f->middle, turn, root);
    for (size_t i = 0; i < nb; i++) {
        double rate = v[nb + i], acceleration = v[2 * nb + i];
        v[i] += i < 3 ? root[i] : g[0][1] * rate + g[0][2] * acceleration;
        v[nb + i] = g[1][1] * rate + g[1][2] * acceleration;
        v[2 * nb + i] = g[2][1] * rate + g[2][2] * acceleration;
    }
    for (size_t i = 0; i < RIBBON_MOTION_OFFSETS; i++)
        v[3 * nb + i] *= f->offset;
    for (size_t d = 0; d < 3; d++) {
        double x = p[d], y = p[3 + d], z = p[6 + d];
        for (size_t r = 0; r < 3; r++)
            p[3 * r + d] = f->anchor[r][0] * x + f->anchor[r][1] * y + f->anchor[r][2] * z;
    }
}

void motion_backward(const struct ribbon_motion_model *model, const struct motion_transition *f, double *v) {
    size_t nb = model->block;
    double root[3], *p = v + motion_anchor_index(model);
    const double (*g)[3] = f->shape;
    to_body_transposed(model, f->after, v);
    for (size_t d = 0; d < 3; d++) {
        double x = p[d], y = p[3 + d], z = p[6 + d];
        for (size_t r = 0; r < 3; r++)
            p[3 * r + d] = f->anchor[0][r] * x + f->anchor[1][r] * y + f->anchor[2][r] * z;
    }
    rotate_back(f->middle, v, root);
    for (size_t i = 0; i < nb; i++) {
        double place = i < 3 ? root[i] : v[i], rate = v[nb + i], acceleration = v[2 * nb + i];
        v[nb + i] = g[0][1] * place + g[1][1] * rate + g[2][1] * acceleration;
        v[2 * nb + i] = g[0][2] * place + g[1][2] * rate + g[2][2] * acceleration;
    }
    for (size_t i = 0; i < RIBBON_MOTION_OFFSETS; i++)
        v[3 * nb + i] *= f->offset;
    to_world_transposed(model, f->before, v);
}

void motion_anchor_acceleration(const struct ribbon_motion_model *model,
                                const struct ribbon_motion_state *state, double out[3]) {
    rotate(state->root, state->x + model->states - 3, out);
    out[2] -= model->params.gravity_mps2;
}

double motion_anchor_variance(const struct ribbon_motion_model *model,
                              const struct ribbon_motion_state *state, const motion_matrix covariance) {
    /* Rows of the map to the world have values at the anchor's rotation and at its specific force only. */
    const size_t last = model->states - 3, at[6] = {0, 1, 2, last, last + 1, last + 2};
    double sum = 0.0;
    for (size_t d = 0; d < 3; d++) {
        double row[RIBBON_MOTION_STATE_MAX];
        for (size_t i = 0; i < 6; i++)
            row[at[i]] = at[i] == last + d ? 1.0 : 0.0;
        to_world_transposed(model, state, row);
        for (size_t i = 0; i < 6; i++)
            for (size_t j = 0; j < 6; j++)
                sum += row[at[i]] * covariance[at[i]][at[j]] * row[at[j]];
    }
    return sum;
}

void motion_set_anchor(const struct ribbon_motion_model *model, const double acceleration[3],
                       struct ribbon_motion_state *state) {
    double force[3] = {acceleration[0], acceleration[1], acceleration[2] + model->params.gravity_mps2};
    rotate_back(state->root, force, state->x + model->states - 3);
}

/* The state itself moves as its error does, but for the anchor's rotation and known acceleration. */
static void advance_state(const struct ribbon_motion_model *model, const struct motion_transition *f,
                          struct ribbon_motion_state *to) {
    const struct ribbon_motion_state *from = f->before;
    size_t last = model->states - 3;
    double v[RIBBON_MOTION_STATE_MAX];
    memcpy(v, from->x, sizeof v);
    motion_anchor_acceleration(model, from, v + last);
    for (size_t d = 0; d < 3; d++)
        v[last + d] -= from->known_mps2[d];
    forward_world(model, f, v);
    memcpy(to->x, v, sizeof v);
    memset(to->x, 0, 3 * sizeof(double));
    multiply3(from->root, f->turn, to->root);
    for (size_t d = 0; d < 3; d++)
        v[last + d] += to->known_mps2[d];
    motion_set_anchor(model, v + last, to);
}

void motion_both_sides(const struct ribbon_motion_model *model, const struct motion_transition *f,
                       bool process, motion_matrix p) {
    size_t n = model->states;
    for (int side = 0; side < 2; side++) {
        for (size_t i = 0; i < n; i++)
            if (process) {
                to_world(model, f->before, p[i]);
                forward_world(model, f, p[i]);
            } else {
                motion_to_body(model, f->after, p[i]);
            }
        if (side == 0) /* the result is symmetric */
            motion_transpose(n, p);
    }
}

enum ribbon_motion_jerk motion_jerk_kind(const struct ribbon_motion_model *model, size_t i) {
    if (i < 3)
        return (enum ribbon_motion_jerk)(RIBBON_MOTION_JERK_ROOT + i);
    return i < 3 + model->twist_modes ? RIBBON_MOTION_JERK_TWIST : RIBBON_MOTION_JERK_BEND;
}

static void add_process_noise(const struct ribbon_motion_model *model, const struct motion_transition *f,
                              const struct ribbon_motion_scales *scales, motion_matrix p) {
    const struct ribbon_motion_params *q = &model->params;
    size_t nb = model->block, anchor = motion_anchor_index(model);
    double h = f->dt_s, h2 = h * h, h3 = h2 * h;
    const double noise[3][3] = {{h3 * h2 / 20.0, h2 * h2 / 8.0, h3 / 6.0},
                                {h2 * h2 / 8.0, h3 / 3.0, h2 / 2.0},
                                {h3 / 6.0, h2 / 2.0, h}};
    for (size_t i = 3; i < nb; i++) {
        enum ribbon_motion_jerk kind = motion_jerk_kind(model, i);
        double jerk = kind == RIBBON_MOTION_JERK_TWIST ? q->twist_jerk : q->bend_jerk;
        for (size_t a = 0; a < 3; a++)
            for (size_t b = 0; b < 3; b++)
                p[a * nb + i][b * nb + i] += scales->jerk[kind] * jerk * jerk * noise[a][b];
    }
    /* The anchor's rotation is an error in the world, its rate and acceleration are in the anchor's frame. */
    for (size_t i = 0; i < 3; i++) {
        double density = scales->jerk[RIBBON_MOTION_JERK_ROOT + i] * q->root_jerk * q->root_jerk;
        for (size_t a = 1; a < 3; a++)
            for (size_t b = 1; b < 3; b++)
                p[a * nb + i][b * nb + i] += density * noise[a][b];
        for (size_t r = 0; r < 3; r++) {
            double along = f->middle[3 * r + i] * density;
            for (size_t a = 1; a < 3; a++) {
                p[r][a * nb + i] += along * noise[0][a];
                p[a * nb + i][r] += along * noise[0][a];
            }
            for (size_t c = 0; c < 3; c++)
                p[r][c] += along * f->middle[3 * c + i] * noise[0][0];
        }
    }
    /* What the transition takes from the stationary covariance, the noise gives back. */
    double kept[3][3], half[3][3], stationary[3][3], transposed[3][3], transition[3][3];
    memcpy(stationary, model->anchor_covariance, sizeof stationary);
    memcpy(transition, f->anchor, sizeof transition);
    for (int i = 0; i < 9; i++)
        transposed[i / 3][i % 3] = transition[i % 3][i / 3];
    multiply(transition, stationary, half);
    multiply(half, transposed, kept);
    for (size_t a = 0; a < 3; a++)
        for (size_t b = 0; b < 3; b++)
            for (size_t d = 0; d < 3; d++)
                p[anchor + 3 * a + d][anchor + 3 * b + d] += scales->anchor * (stationary[a][b] - kept[a][b]);
    for (size_t i = 3 * nb; i < anchor; i++)
        p[i][i] +=
            (1.0 - f->offset * f->offset) * scales->force_offset * q->accel_sigma_mps2 * q->accel_sigma_mps2;
}

int ribbon_motion_advance(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                          const struct ribbon_motion_scales *scales, const struct ribbon_motion_step *before,
                          struct ribbon_motion_step *step) {
    struct ribbon_motion_state from = before->state;
    if (!(sample->t_s > from.t_s))
        return RIBBON_MOTION_ERROR_TIME;
    struct motion_transition f;
    step->predicted.t_s = sample->t_s;
    memcpy(step->predicted.known_mps2, sample->anchor_mps2, sizeof step->predicted.known_mps2);
    motion_transition(model, &from, &step->predicted, &f);
    advance_state(model, &f, &step->predicted);
    memcpy(step->predicted_covariance, before->covariance, sizeof step->predicted_covariance);
    motion_both_sides(model, &f, true, step->predicted_covariance);
    add_process_noise(model, &f, scales, step->predicted_covariance);
    motion_both_sides(model, &f, false, step->predicted_covariance);
    return 0;
}
