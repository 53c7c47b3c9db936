/* What the sensors of one scan say of a state: their equations, and what they leave unexplained. */
#include <stdlib.h>
#include <string.h>

#include "motion_internal.h"

static bool usable_force(const struct ribbon_motion_sample *sample, size_t k) {
    const double *f = sample->force_mps2[k];
    return sample->force_valid[k] && isfinite(f[0] + f[1] + f[2]);
}

static bool usable_field(const struct ribbon_motion_sample *sample, size_t k) {
    const double *b = sample->field_ut[k];
    return sample->field_valid[k] && isfinite(b[0] + b[1] + b[2]);
}

/* A sample taken at the wrong instant is off by as much as the force changes until then; as it is off along
 * one direction only, a third of the square falls on each axis. */
static double force_sigma(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                          size_t k, const struct motion_equations *equations) {
    double change = sample->force_change_mps3[k];
    return hypot(equations->force_sigma,
                 isfinite(change) ? model->params.force_jitter_s * change * 0.577 : 0.0);
}

/* Adds the sensor whose derivatives are in the next rows: `residual` at the place of linearisation, which
 * lies `offset` from the prediction. */
static void add_sensor(size_t axes, size_t columns, double sigma, const double residual[3],
                       const double *offset, struct ribbon_motion_work *work,
                       struct motion_equations *equations) {
    for (size_t a = 0; a < axes; a++) {
        double *row = work->rows[equations->rows];
        work->innovation[equations->rows++] = (residual[a] + motion_dot(columns, row, offset)) / sigma;
        for (size_t j = 0; j < columns; j++)
            row[j] *= 1.0 / sigma;
    }
}

/* What an accelerometer reads less its offset, in the frame of the anchor. */
static void unbiased_force(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                           const struct ribbon_motion_state *state, size_t k,
                           const struct motion_shape *shape, double out[3]) {
    double force[3];
    for (size_t d = 0; d < 3; d++) {
        force[d] = sample->force_mps2[k][d];
        for (size_t j = 0; j < RIBBON_MOTION_OFFSET_SHAPES; j++)
            force[d] -= model->offset_shape[j][k] * state->x[3 * model->block + 3 * j + d];
    }
    rotate(shape->rotation[2 * k], force, out);
}

/* Specific force, seen from the anchor: that of the anchor and the acceleration of the shape. */
static void add_force(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                      const struct ribbon_motion_state *at, size_t k, const double *offset,
                      struct ribbon_motion_work *work, struct motion_equations *equations) {
    size_t nb = model->block, slot = 2 * k, last = model->states - 3;
    const struct motion_shape *shape = &work->shape;
    double (*rows)[RIBBON_MOTION_MATRIX_MAX] = work->rows + equations->rows;
    double v[3], measured[3], residual[3];
    unbiased_force(model, sample, at, k, shape, measured);
    for (size_t d = 0; d < 3; d++) {
        v[d] = shape->acceleration[slot][d] + at->x[last + d];
        residual[d] = measured[d] - v[d];
        memcpy(rows[d], work->pull[d], 3 * nb * sizeof(double));
        memset(rows[d] + last - 6, 0, 9 * sizeof(double));
        for (size_t j = 0; j < RIBBON_MOTION_OFFSETS; j++)
            rows[d][3 * nb + j] = shape->rotation[slot][3 * d + j % 3] * model->offset_shape[j / 3][k];
        rows[d][last + d] = 1.0;
    }
    /* Turning the node turns the measured vector the other way: + v x turn. */
    for (size_t j = 3; j < nb; j++) {
        double t[3] = {shape->turn[slot][0][j], shape->turn[slot][1][j], shape->turn[slot][2][j]}, c[3];
        cross(v, t, c);
        for (size_t d = 0; d < 3; d++)
            rows[d][j] += c[d];
    }
    equations->fit.forces++;
    add_sensor(3, model->states, force_sigma(model, sample, k, equations), residual, offset, work, equations);
}

/* What a magnetometer reads less what it should, in its own frame. field: in that of the anchor; rotation:
 * becomes that of the anchor from the magnetometer. */
static void field_residual(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                           size_t k, const struct motion_shape *shape, const double field[3],
                           double rotation[9], double residual[3]) {
    double measured[3], expected[3], turned[3], later[3], across[9];
    for (size_t i = 0; i < 9; i++)
        across[i] = model->field_frame[k][3 * (i % 3) + i / 3];
    multiply3(shape->rotation[2 * k + 1], across, rotation);
    rotate(model->field_frame[k], sample->field_ut[k], measured);
    rotate_back(rotation, field, expected);
    /* The node turns on until the magnetometer samples. */
    rotate_back(rotation, shape->rate[2 * k + 1], turned);
    cross(expected, turned, later);
    for (size_t d = 0; d < 3; d++)
        residual[d] = measured[d] - expected[d] - model->params.field_later_s * later[d];
}

static void add_field(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                      const struct ribbon_motion_state *at, size_t k, const double *offset,
                      struct ribbon_motion_work *work, struct motion_equations *equations) {
    size_t nb = model->block, slot = 2 * k + 1, axes = (size_t)model->params.field_axes;
    double (*rows)[RIBBON_MOTION_MATRIX_MAX] = work->rows + equations->rows;
    double field[3], rotation[9], residual[3];
    rotate_back(at->root, model->params.field_ut, field);
    field_residual(model, sample, k, &work->shape, field, rotation, residual);
    for (size_t a = 0; a < axes; a++) {
        /* Row of transpose(rotation) [field]x. */
        double column[3] = {rotation[a], rotation[3 + a], rotation[6 + a]}, m[3];
        cross(column, field, m);
        rotate(at->root, m, rows[a]);
        for (size_t j = 3; j < nb; j++)
            rows[a][j] = m[0] * work->shape.turn[slot][0][j] + m[1] * work->shape.turn[slot][1][j] +
                         m[2] * work->shape.turn[slot][2][j];
    }
    equations->fit.fields++;
    add_sensor(axes, nb, equations->field_sigma, residual, offset, work, equations);
}

/* The derivative of the acceleration from slot i to the next. */
static void integrate_pull(const struct ribbon_motion_model *model, size_t i,
                           struct ribbon_motion_work *work) {
    double weight[4];
    size_t first = motion_quadrature(model->slots, i, weight), columns = 3 * model->block;
    for (int d = 0; d < 3; d++) {
        double *restrict o = work->pull[d];
        const double *a = work->shape.change[first][d], *b = work->shape.change[first + 1][d];
        const double *c = work->shape.change[first + 2][d], *e = work->shape.change[first + 3][d];
        double h = model->params.pitch_m;
        double wa = h * weight[0], wb = h * weight[1], wc = h * weight[2], we = h * weight[3];
        for (size_t j = 0; j < columns; j++)
            o[j] += wa * a[j] + wb * b[j] + wc * c[j] + we * e[j];
    }
}

void motion_add_sensors(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                        const struct ribbon_motion_state *at, const double *offset,
                        struct ribbon_motion_work *work, struct motion_equations *equations) {
    size_t nodes = model->params.nodes;
    motion_shape(model, at, true, &work->shape);
    for (size_t k = 0; k < nodes; k++)
        if (usable_field(sample, k))
            add_field(model, sample, at, k, offset, work, equations);
    equations->fields = equations->rows;
    memset(work->pull, 0, sizeof work->pull);
    for (size_t k = 0; k < nodes; k++) {
        if (usable_force(sample, k))
            add_force(model, sample, at, k, offset, work, equations);
        for (size_t i = 2 * k; i < 2 * k + 2 && i + 1 < model->slots; i++)
            integrate_pull(model, i, work);
    }
}

static int ascending(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Value below which a share of `count` values lies, 1 if there is none. Sorts them. */
static double quantile(double *values, size_t count, double share) {
    if (count == 0)
        return 1.0;
    qsort(values, count, sizeof values[0], ascending);
    return values[(size_t)((double)count * share)];
}

/* Median of chi squared with 3 degrees of freedom, lower quartiles with 2 and 3. */
#define MEDIAN_3   2.366
#define QUARTILE_2 0.575
#define QUARTILE_3 1.213

/* Outliers have no say in quantiles. Of the magnetometers half and more may be beside one magnet. */
void motion_typical_residuals(const struct ribbon_motion_model *model,
                              const struct ribbon_motion_sample *sample,
                              const struct ribbon_motion_state *state,
                              const struct motion_equations *equations, struct motion_shape *shape,
                              struct ribbon_motion_fit *fit) {
    double forces[RIBBON_MOTION_NODE_MAX], fields[RIBBON_MOTION_NODE_MAX], residual[3], field[3];
    size_t force_count = 0, field_count = 0, axes = (size_t)model->params.field_axes;
    motion_shape(model, state, false, shape);
    rotate_back(state->root, model->params.field_ut, field);
    for (size_t k = 0; k < model->params.nodes; k++) {
        fit->force_left[k][0] = NAN;
        if (usable_force(sample, k)) {
            unbiased_force(model, sample, state, k, shape, residual);
            for (size_t d = 0; d < 3; d++)
                residual[d] -= shape->acceleration[2 * k][d] + state->x[model->states - 3 + d];
            memcpy(fit->force_left[k], residual, sizeof residual);
            double sigma = force_sigma(model, sample, k, equations);
            forces[force_count++] = dot(residual, residual) / (MEDIAN_3 * sigma * sigma);
        }
        if (usable_field(sample, k)) {
            double rotation[9], square = 0.0;
            field_residual(model, sample, k, shape, field, rotation, residual);
            for (size_t a = 0; a < axes; a++)
                square += residual[a] * residual[a];
            fields[field_count++] = square / ((axes == 2 ? QUARTILE_2 : QUARTILE_3) * equations->field_sigma *
                                              equations->field_sigma);
        }
    }
    fit->force_residual = quantile(forces, force_count, 0.5);
    fit->field_residual = quantile(fields, field_count, 0.25);
}
