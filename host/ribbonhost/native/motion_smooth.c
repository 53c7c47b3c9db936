/* Smoothing over an interval, the state of a level reading, and what a state says of the nodes. */
#include <string.h>

#include "motion_internal.h"

/* Error of the curve's own arithmetic, in units of the pitch: without it a node near the anchor, which cannot
 * leave a sphere around it, would claim no error at all across that sphere. */
#define POSITION_FLOOR 1e-4

/* covariance, of the step after, becomes P + P transpose(F) (I covariance I - I) F P, with P of the step and
 * I the information predicted for the step after. */
static void smooth_covariance(const struct ribbon_motion_model *model, const struct motion_transition *f,
                              const struct ribbon_motion_step *step, motion_matrix information,
                              motion_matrix covariance, struct ribbon_motion_work *work) {
    size_t n = model->states;
    motion_matrix *half = &work->matrix[0], *whole = &work->matrix[1];
    motion_product(n, n, n, MOTION_VIEW(information), MOTION_VIEW(covariance), MOTION_VIEW(*half));
    motion_symmetric_product(n, *half, information, *whole);
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++)
            (*whole)[i][j] -= information[i][j];
        motion_backward(model, f, (*whole)[i]);
    }
    motion_transpose(n, *whole);
    for (size_t i = 0; i < n; i++)
        motion_backward(model, f, (*whole)[i]);
    memcpy(covariance, step->covariance, sizeof(motion_matrix));
    motion_product(n, n, n, MOTION_VIEW(covariance), MOTION_VIEW(*whole), MOTION_VIEW(*half));
    motion_symmetric_product(n, *half, step->covariance, *whole);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++)
            covariance[i][j] += (*whole)[i][j];
}

void ribbon_motion_smooth(const struct ribbon_motion_model *model, size_t count,
                          const struct ribbon_motion_step *steps, struct ribbon_motion_state *states,
                          struct ribbon_motion_nodes *nodes, size_t node_count, size_t ahead,
                          struct ribbon_motion_work *work) {
    size_t n = model->states, later = count; /* the next good step, `count`: none that is linked */
    size_t covered = node_count > 0 ? node_count + ahead : 0;
    double *d = work->vector[0], *v = work->vector[1];
    motion_matrix *information = &work->matrix[2], *covariance = &work->matrix[3];
    for (size_t k = count; k-- > 0;) {
        const struct ribbon_motion_step *step = &steps[k];
        if (step->status == RIBBON_MOTION_WAITING)
            continue;
        states[k] = step->state;
        bool linked = later < count &&
                      motion_invert(n, steps[later].predicted_covariance, *information, work->matrix[0]);
        if (linked) {
            const struct ribbon_motion_state *predicted = &steps[later].predicted;
            struct motion_transition f;
            motion_transition(model, &step->state, predicted, &f);
            motion_subtract(model, &states[later], predicted, d);
            motion_apply(n, *information, d, v);
            motion_backward(model, &f, v);
            motion_apply(n, step->covariance, v, d);
            motion_add(model, &step->state, d, &states[k]);
            if (later < covered)
                smooth_covariance(model, &f, step, *information, *covariance, work);
        }
        if (k < covered && !(linked && later < covered))
            memcpy(*covariance, step->covariance, sizeof(motion_matrix));
        if (k < node_count)
            ribbon_motion_output(model, &states[k], *covariance, &nodes[k], work);
        later = step->status == RIBBON_MOTION_STARTED ? count : k;
    }
}

/* Least squares of the modes of one axis to the turns between neighbouring valid nodes. */
static void fit_modes(const struct ribbon_motion_model *model, int axis, size_t count, const size_t *node,
                      double turn[RIBBON_MOTION_NODE_MAX][3], double *x, struct ribbon_motion_work *work) {
    /* A level reading is good to some 0.02 rad, and curvature rarely exceeds 1/(10 cm). */
    const double ridge = 0.02 * 0.02 / (10.0 * 10.0);
    size_t first = axis == 0 ? 0 : model->twist_modes;
    size_t modes = axis == 0 ? model->twist_modes : model->modes - model->twist_modes;
    double *rhs = work->vector[0];
    memset(work->matrix[0], 0, sizeof(motion_matrix));
    memset(rhs, 0, modes * sizeof(double));
    for (size_t i = 0; i < modes; i++)
        work->matrix[0][i][i] = ridge;
    for (size_t k = 0; k + 1 < count; k++) {
        double row[RIBBON_MOTION_BLOCK_MAX] = {0.0};
        for (size_t segment = 2 * node[k] + 1; segment < 2 * node[k + 1] + 1; segment++)
            for (size_t j = 0; j < modes; j++)
                row[j] += model->segment[segment][first + j];
        for (size_t i = 0; i < modes; i++) {
            rhs[i] += row[i] * turn[k][axis];
            for (size_t j = 0; j < modes; j++)
                work->matrix[0][i][j] += row[i] * row[j];
        }
    }
    motion_invert(modes, work->matrix[0], work->matrix[0], work->matrix[1]);
    motion_apply(modes, work->matrix[0], rhs, x + 3 + first);
}

int ribbon_motion_from_level(const struct ribbon_motion_model *model,
                             const struct ribbon_motion_sample *sample,
                             const struct ribbon_motion_scales *scales, struct ribbon_motion_step *step,
                             struct ribbon_motion_work *work) {
    size_t node[RIBBON_MOTION_NODE_MAX], count = 0;
    double turn[RIBBON_MOTION_NODE_MAX][3], rotation[2][9];
    struct ribbon_motion_state *state = &step->predicted;
    for (size_t k = 0; k < model->params.nodes; k++)
        if (sample->level_valid[k])
            node[count++] = k;
    if (count < 2)
        return RIBBON_MOTION_ERROR_NO_NODE;
    memset(state, 0, sizeof *state);
    state->t_s = sample->t_s;
    for (size_t k = 0; k + 1 < count; k++) {
        double relative[9];
        motion_from_quaternion(sample->level_q[node[k]], rotation[0]);
        motion_from_quaternion(sample->level_q[node[k + 1]], rotation[1]);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                relative[3 * i + j] = rotation[0][i] * rotation[1][j] +
                                      rotation[0][3 + i] * rotation[1][3 + j] +
                                      rotation[0][6 + i] * rotation[1][6 + j];
        motion_log(relative, turn[k]);
    }
    fit_modes(model, 0, count, node, turn, state->x, work);
    fit_modes(model, 1, count, node, turn, state->x, work);
    /* The anchor is where it has to be for the middle node to agree. */
    size_t middle = node[count / 2];
    motion_shape(model, state, false, &work->shape);
    motion_from_quaternion(sample->level_q[middle], rotation[0]);
    const double *shape = work->shape.rotation[2 * middle + 1];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            state->root[3 * i + j] = dot(rotation[0] + 3 * i, shape + 3 * j);
    memcpy(state->known_mps2, sample->anchor_mps2, sizeof state->known_mps2);
    motion_set_anchor(model, sample->anchor_mps2, state);
    step->state = *state;
    /* What the reading may be off by: orientation, then rate, then acceleration; at rest, in motion. */
    static const double root_sigma[2][3] = {{5e-4, 0.02, 0.2}, {0.5, 3.0, 30.0}};
    static const double mode_sigma[2][3] = {{0.01, 0.2, 2.0}, {3.0, 30.0, 300.0}};
    const double *root = root_sigma[!sample->level_still], *mode = mode_sigma[!sample->level_still];
    size_t nb = model->block, anchor = motion_anchor_index(model);
    memset(step->predicted_covariance, 0, sizeof step->predicted_covariance);
    for (size_t a = 0; a < 3; a++) {
        for (size_t i = 0; i < nb; i++) {
            double sigma = i < 3 ? root[a] : mode[a];
            step->predicted_covariance[a * nb + i][a * nb + i] = sigma * sigma;
        }
        for (size_t b = 0; b < 3; b++)
            for (size_t d = 0; d < 3; d++)
                step->predicted_covariance[anchor + 3 * a + d][anchor + 3 * b + d] =
                    scales->anchor * model->anchor_covariance[a][b];
    }
    double offset = model->params.accel_sigma_mps2;
    for (size_t i = 3 * nb; i < anchor; i++)
        step->predicted_covariance[i][i] = scales->force_offset * offset * offset;
    struct motion_transition f = {.before = state, .after = state};
    motion_both_sides(model, &f, false, step->predicted_covariance);
    return 0;
}

/* Covariance of J x, J (3, columns) with row stride BLOCK, for the first block of the state. */
WIDE static void project(size_t columns, double j[3][RIBBON_MOTION_BLOCK_MAX], const motion_matrix p,
                         double out[3][3]) {
    for (int a = 0; a < 3; a++) {
        double row[RIBBON_MOTION_BLOCK_MAX] = {0.0};
        for (size_t i = 0; i < columns; i++)
            for (size_t k = 0; k < columns; k++)
                row[k] += j[a][i] * p[i][k];
        for (int b = 0; b < 3; b++) {
            out[a][b] = 0.0;
            for (size_t k = 0; k < columns; k++)
                out[a][b] += row[k] * j[b][k];
        }
    }
}

/* Largest eigenvalue of a symmetric (3, 3), by its characteristic polynomial's trigonometric solution. */
static double largest_eigenvalue(double m[3][3]) {
    double mean = (m[0][0] + m[1][1] + m[2][2]) / 3.0;
    double a = m[0][0] - mean, b = m[1][1] - mean, c = m[2][2] - mean;
    double off = m[0][1] * m[0][1] + m[0][2] * m[0][2] + m[1][2] * m[1][2];
    double spread = sqrt((a * a + b * b + c * c + 2.0 * off) / 6.0);
    if (!(spread > 0.0))
        return mean;
    double determinant = a * (b * c - m[1][2] * m[1][2]) - m[0][1] * (m[0][1] * c - m[1][2] * m[0][2]) +
                         m[0][2] * (m[0][1] * m[1][2] - b * m[0][2]);
    double r = fmin(1.0, fmax(-1.0, determinant / (2.0 * spread * spread * spread)));
    return mean + 2.0 * spread * cos(acos(r) / 3.0);
}

/* m = root m transpose(root). */
static void turn_covariance(const double root[9], double m[3][3]) {
    double half[3][3];
    for (int i = 0; i < 3; i++)
        rotate(root, m[i], half[i]); /* m is symmetric: half is transpose(root m) */
    for (int i = 0; i < 3; i++) {
        double row[3] = {half[0][i], half[1][i], half[2][i]};
        rotate(root, row, m[i]);
    }
}

/* One node from its slot, what lies before it integrated. */
static void output_node(const struct ribbon_motion_model *model, const struct ribbon_motion_state *state,
                        size_t slot, const double position[3], const double velocity[3],
                        double reach[3][RIBBON_MOTION_BLOCK_MAX], const motion_matrix *covariance,
                        const struct motion_shape *shape, struct ribbon_motion_nodes *nodes) {
    size_t k = slot / 2;
    double rotation[9];
    multiply3(state->root, shape->rotation[slot], rotation);
    motion_to_quaternion(rotation, nodes->q[k]);
    rotate(state->root, position, nodes->position_m[k]);
    rotate(state->root, velocity, nodes->velocity_mps[k]);
    rotate(state->root, shape->acceleration[slot], nodes->acceleration_mps2[k]);
    rotate(state->root, shape->rate[slot], nodes->rate_radps[k]);
    nodes->sigma_rad[k] = NAN;
    for (int i = 0; i < 9; i++)
        nodes->position_covariance_m2[k][i / 3][i % 3] = NAN;
    if (!covariance)
        return;
    double turn[3][RIBBON_MOTION_BLOCK_MAX], angular[3][3];
    memcpy(turn, shape->turn[slot], sizeof turn);
    for (int d = 0; d < 3; d++) {
        const double *axis = state->root + 3 * d; /* of the world, in the frame of the anchor */
        double move[3];
        cross(axis, position, move);
        for (int r = 0; r < 3; r++) {
            reach[r][d] = move[r];
            turn[r][d] = axis[r];
        }
    }
    project(model->block, reach, *covariance, nodes->position_covariance_m2[k]);
    project(model->block, turn, *covariance, angular);
    double floor_m = POSITION_FLOOR * model->params.pitch_m;
    for (int d = 0; d < 3; d++)
        nodes->position_covariance_m2[k][d][d] += floor_m * floor_m;
    turn_covariance(state->root, nodes->position_covariance_m2[k]);
    /* By how much a part's readings are off in time stays the same for seconds: it does not average out. */
    const double *v = nodes->velocity_mps[k], jitter_s = model->params.force_jitter_s;
    for (int i = 0; i < 9; i++)
        nodes->position_covariance_m2[k][i / 3][i % 3] += jitter_s * jitter_s * v[i / 3] * v[i % 3];
    nodes->sigma_rad[k] = sqrt(fmax(0.0, largest_eigenvalue(angular)));
}

void ribbon_motion_output(const struct ribbon_motion_model *model, const struct ribbon_motion_state *state,
                          const double covariance[RIBBON_MOTION_MATRIX_MAX][RIBBON_MOTION_MATRIX_MAX],
                          struct ribbon_motion_nodes *nodes, struct ribbon_motion_work *work) {
    struct motion_shape *shape = &work->shape;
    double position[3] = {0.0}, velocity[3] = {0.0}, reach[3][RIBBON_MOTION_BLOCK_MAX] = {{0.0}};
    nodes->t_s = state->t_s;
    motion_anchor_acceleration(model, state, nodes->anchor_acceleration_mps2);
    motion_shape(model, state, covariance != NULL, shape);
    for (size_t i = 0; i + 1 < model->slots; i++) {
        double weight[4];
        size_t first = motion_quadrature(model->slots, i, weight);
        for (size_t k = 0; k < 4; k++) {
            const double *r = shape->rotation[first + k];
            double t[3] = {r[0], r[3], r[6]}, speed[3], h = weight[k] * model->params.pitch_m;
            cross(shape->rate[first + k], t, speed);
            for (int d = 0; d < 3; d++) {
                position[d] += h * t[d];
                velocity[d] += h * speed[d];
            }
            for (size_t j = 3; covariance && j < model->block; j++) {
                double turn[3], move[3];
                for (int d = 0; d < 3; d++)
                    turn[d] = shape->turn[first + k][d][j];
                cross(turn, t, move);
                for (int d = 0; d < 3; d++)
                    reach[d][j] += h * move[d];
            }
        }
        if (i % 2 == 0)
            output_node(model, state, i + 1, position, velocity, reach,
                        covariance ? (const motion_matrix *)covariance : NULL, shape, nodes);
    }
}
