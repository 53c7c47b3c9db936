/* One scan corrects a predicted state: iterated Kalman update in information form, outliers down-weighted. */
#include <stdlib.h>
#include <string.h>

#include "motion_internal.h"

enum { STRIDE = RIBBON_MOTION_MATRIX_MAX, BLOCK = RIBBON_MOTION_BLOCK_MAX };

/* Squared Mahalanobis norm beyond which a sensor is an outlier: one in a million of three Gaussian values. */
#define GATE 30.0
/* Linearise again while the estimate turns or bends by more than this from where it was linearised. */
#define RELINEARISE_RAD 0.02
#define ITERATIONS      4

/* What is in the working memory while a sample corrects. */
enum { COVARIANCE, NORMAL, SPARE };        /* matrices: after it, of the magnetometers */
enum { FORCE, FIELD, OFFSET, CORRECTION }; /* vectors: right sides, errors from the prediction */

size_t ribbon_motion_work_bytes(void) {
    return sizeof(struct ribbon_motion_work);
}

static bool usable_force(const struct ribbon_motion_sample *sample, size_t k) {
    const double *f = sample->force_mps2[k];
    return sample->force_valid[k] && isfinite(f[0] + f[1] + f[2]);
}

static bool usable_field(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                         size_t k) {
    const double *b = sample->field_ut[k];
    return sample->field_valid[k] && isfinite(b[0] + b[1] + (model->params.field_axes == 3 ? b[2] : 0.0));
}

/* Equations of the sensors of one kind, each in units of its noise: rows (count) of derivatives, and what the
 * prediction leaves of the reading. */
struct equations {
    double (*rows)[STRIDE];
    double *innovation;
    size_t count, columns;
    double values; /* degrees of freedom of those that are no outliers */
    double sigma;
};

struct sums {
    struct equations force, field;
    struct ribbon_motion_fit fit;
};

/* A sample taken at the wrong instant is off by as much as the force changes until then; as it is off along
 * one direction only, a third of the square falls on each axis. */
static double force_sigma(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                          size_t k, const struct sums *sums) {
    double change = sample->force_change_mps3[k];
    return hypot(sums->force.sigma, isfinite(change) ? model->params.force_jitter_s * change * 0.577 : 0.0);
}

/* Squared norm of the innovation e of a sensor in units of its covariance J P transpose(J) + sigma^2. */
WIDE static double mahalanobis(size_t axes, size_t columns, double rows[3][STRIDE], const double e[3],
                               double variance, const motion_matrix p) {
    double s[3][3] = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}};
    for (size_t a = 0; a < axes; a++) {
        double pj[STRIDE];
        memset(pj, 0, sizeof pj);
        for (size_t i = 0; i < columns; i++)
            for (size_t j = 0; j < columns; j++)
                pj[j] += rows[a][i] * p[i][j];
        for (size_t b = 0; b < axes; b++) {
            s[a][b] = a == b ? variance : 0.0;
            for (size_t j = 0; j < columns; j++)
                s[a][b] += rows[b][j] * pj[j];
        }
    }
    return motion_quadratic(s, e);
}

/* Adds the sensor whose derivatives are in the next rows: `residual` at the place of linearisation, which
 * lies `offset` from the prediction. Returns whether it is an inlier. */
static bool add_sensor(struct equations *equations, size_t axes, double sigma, const double residual[3],
                       const double *offset, const motion_matrix predicted) {
    double (*rows)[STRIDE] = equations->rows + equations->count;
    double *innovation = equations->innovation + equations->count;
    double e[3] = {0.0, 0.0, 0.0}, variance = sigma * sigma, weight = 1.0 / sigma;
    size_t columns = equations->columns;
    for (size_t a = 0; a < axes; a++) {
        e[a] = residual[a];
        for (size_t j = 0; j < columns; j++)
            e[a] += rows[a][j] * offset[j];
    }
    bool inlier = true;
    /* The covariance is not less than that of the noise alone. */
    if (dot(e, e) > GATE * variance) {
        double distance = mahalanobis(axes, columns, rows, e, variance, predicted);
        inlier = distance <= GATE;
        /* The further off, the less it pulls. */
        if (!inlier)
            weight *= GATE / distance;
    }
    for (size_t a = 0; a < axes; a++) {
        innovation[a] = weight * e[a];
        for (size_t j = 0; j < columns; j++)
            rows[a][j] *= weight;
    }
    equations->count += axes;
    equations->values += inlier ? (double)axes : 0.0;
    return inlier;
}

/* rhs += transpose(rows) innovation. */
static void add_right_side(const struct equations *equations, double *rhs) {
    for (size_t k = 0; k < equations->count; k++)
        for (size_t j = 0; j < equations->columns; j++)
            rhs[j] += equations->innovation[k] * equations->rows[k][j];
}

static double sum_of_squares(const struct equations *equations) {
    double sum = 0.0;
    for (size_t k = 0; k < equations->count; k++)
        sum += equations->innovation[k] * equations->innovation[k];
    return sum;
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
                      const motion_matrix predicted, struct ribbon_motion_work *work, struct sums *sums) {
    size_t nb = model->block, slot = 2 * k, last = model->states - 3;
    const struct motion_shape *shape = &work->shape;
    double (*rows)[STRIDE] = sums->force.rows + sums->force.count;
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
    sums->fit.forces++;
    if (!add_sensor(&sums->force, 3, force_sigma(model, sample, k, sums), residual, offset, predicted))
        sums->fit.force_outliers++;
}

static void add_field(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                      const struct ribbon_motion_state *at, size_t k, const double *offset,
                      const motion_matrix predicted, struct ribbon_motion_work *work, struct sums *sums) {
    size_t nb = model->block, slot = 2 * k + 1, axes = (size_t)model->params.field_axes;
    const double *rotation = work->shape.rotation[slot];
    double (*rows)[STRIDE] = sums->field.rows + sums->field.count;
    double field[3], expected[3], residual[3] = {0.0, 0.0, 0.0};
    rotate_back(at->root, model->params.field_ut, field);
    rotate_back(rotation, field, expected);
    /* The node turns on until the magnetometer samples. */
    double turned[3], later[3];
    rotate_back(rotation, work->shape.rate[slot], turned);
    cross(expected, turned, later);
    for (size_t a = 0; a < axes; a++) {
        /* Row of transpose(rotation) [field]x. */
        double column[3] = {rotation[a], rotation[3 + a], rotation[6 + a]}, m[3];
        cross(column, field, m);
        residual[a] = sample->field_ut[k][a] - expected[a] - model->params.field_later_s * later[a];
        rotate(at->root, m, rows[a]);
        for (size_t j = 3; j < nb; j++)
            rows[a][j] = m[0] * work->shape.turn[slot][0][j] + m[1] * work->shape.turn[slot][1][j] +
                         m[2] * work->shape.turn[slot][2][j];
    }
    sums->fit.fields++;
    if (!add_sensor(&sums->field, axes, sums->field.sigma, residual, offset, predicted))
        sums->fit.field_outliers++;
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

/* Equations of all valid sensors, linearised at `at`, which lies `offset` from the prediction. */
static void add_sensors(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                        const struct ribbon_motion_state *at, const double *offset,
                        const motion_matrix predicted, struct ribbon_motion_work *work, struct sums *sums) {
    motion_shape(model, at, true, &work->shape);
    memset(work->pull, 0, sizeof work->pull);
    for (size_t k = 0; k < model->params.nodes; k++) {
        if (usable_force(sample, k))
            add_force(model, sample, at, k, offset, predicted, work, sums);
        integrate_pull(model, 2 * k, work);
        if (usable_field(model, sample, k))
            add_field(model, sample, at, k, offset, predicted, work, sums);
        if (k + 1 < model->params.nodes)
            integrate_pull(model, 2 * k + 1, work);
    }
}

/* Largest turn or bend of the first block between two errors. */
static double moved(const struct ribbon_motion_model *model, const double *a, const double *b) {
    double length = model->params.pitch_m * (double)(model->slots - 1), most = 0.0;
    for (size_t i = 0; i < model->block; i++)
        most = fmax(most, fabs(a[i] - b[i]) * (i < 3 ? 1.0 : length / (double)(model->modes / 2)));
    return most;
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

/* Quantiles over the sensors of a kind of the squared residual, in units of the one expected: outliers have
 * no say. Of the magnetometers half and more may be beside one magnet. */
static void typical_residuals(const struct ribbon_motion_model *model,
                              const struct ribbon_motion_sample *sample,
                              const struct ribbon_motion_state *state, const struct sums *sums,
                              struct motion_shape *shape, struct ribbon_motion_fit *fit) {
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
            double sigma = force_sigma(model, sample, k, sums);
            forces[force_count++] = dot(residual, residual) / (MEDIAN_3 * sigma * sigma);
        }
        if (usable_field(model, sample, k)) {
            const double *rotation = shape->rotation[2 * k + 1];
            double turned[3], later[3], square = 0.0;
            rotate_back(rotation, field, residual);
            rotate_back(rotation, shape->rate[2 * k + 1], turned);
            cross(residual, turned, later);
            for (size_t a = 0; a < axes; a++) {
                double e = sample->field_ut[k][a] - residual[a] - model->params.field_later_s * later[a];
                square += e * e;
            }
            fields[field_count++] =
                square / ((axes == 2 ? QUARTILE_2 : QUARTILE_3) * sums->field.sigma * sums->field.sigma);
        }
    }
    fit->force_residual = quantile(forces, force_count, 0.5);
    fit->field_residual = quantile(fields, field_count, 0.25);
}

/* A correction has the covariance that the update takes from the state: with the right jerk its square is, on
 * average, what is expected. */
static void judge_corrections(const struct ribbon_motion_model *model, const struct ribbon_motion_state *from,
                              const struct ribbon_motion_state *to, const double *x,
                              const motion_matrix before_covariance, const motion_matrix covariance,
                              struct ribbon_motion_fit *fit) {
    double before[3], after[3], square = 0.0;
    motion_anchor_acceleration(model, from, before);
    motion_anchor_acceleration(model, to, after);
    for (int d = 0; d < 3; d++)
        square += (after[d] - before[d]) * (after[d] - before[d]);
    double taken =
        motion_anchor_variance(model, to, before_covariance) - motion_anchor_variance(model, to, covariance);
    fit->anchor_correction = taken > 0.0 ? square / taken : 1.0;
    double count[RIBBON_MOTION_JERK_COUNT] = {0.0};
    for (size_t i = 0; i < model->block; i++) {
        enum ribbon_motion_jerk kind = motion_jerk_kind(model, i);
        size_t k = 2 * model->block + i;
        double expected = before_covariance[k][k] - covariance[k][k];
        if (expected > 0.0) {
            fit->jerk_correction[kind] += x[k] * x[k] / expected;
            count[kind] += 1.0;
        }
    }
    for (size_t kind = 0; kind < RIBBON_MOTION_JERK_COUNT; kind++)
        fit->jerk_correction[kind] = count[kind] > 0.0 ? fit->jerk_correction[kind] / count[kind] : 1.0;
}

/* Innovation and residuals a degree of freedom. With the information L before, the covariance P after and the
 * correction x, the accelerometers' part in the normalised innovation is their squares less b x, b their part
 * of the right side. The sensors take n - trace(L P) degrees of freedom for the correction, the magnetometers
 * of these trace(N P), N their normal matrix; what they have beside is left for the residuals. */
static void judge_fit(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                      const struct ribbon_motion_step *step, const struct ribbon_motion_state *state,
                      const struct sums *sums, struct ribbon_motion_work *work,
                      struct ribbon_motion_fit *fit) {
    const double *force = work->vector[FORCE], *field = work->vector[FIELD], *x = work->vector[CORRECTION];
    double explained = 0.0, explained_field = 0.0;
    size_t n = model->states;
    for (size_t i = 0; i < n; i++) {
        explained += force[i] * x[i];
        explained_field += field[i] * x[i];
    }
    double taken = (double)n - motion_trace(n, step->information, work->matrix[COVARIANCE]);
    double fields = motion_trace(model->block, work->matrix[NORMAL], work->matrix[COVARIANCE]);
    *fit = sums->fit;
    judge_corrections(model, &step->predicted, state, x, step->covariance, work->matrix[COVARIANCE], fit);
    double values = sums->force.values, field_values = sums->field.values;
    double force_freedom = values - (taken - fields);
    /* Overlapping readings are given more noise than each has: that much smaller are the squares expected. */
    double share = values > 0.0 ? fmin(1.0, fmax(0.0, force_freedom / values)) : 0.0;
    double expected = 1.0 - (1.0 - 1.0 / model->params.force_overlap) * share;
    fit->force_innovation =
        values > 0.0 ? (sum_of_squares(&sums->force) - explained) / (values * expected) : 1.0;
    fit->field_innovation =
        field_values > 0.0 ? (sum_of_squares(&sums->field) - explained_field) / field_values : 1.0;
    double field_freedom = field_values - fields;
    typical_residuals(model, sample, state, sums, &work->shape, fit);
    /* With hardly any freedom left there is nothing to learn from the residual. */
    fit->force_residual =
        force_freedom > 0.2 * values ? fit->force_residual * values / (force_freedom * expected) : 1.0;
    fit->field_residual =
        field_freedom > 0.2 * field_values ? fit->field_residual * field_values / field_freedom : 1.0;
}

/* Correction of the prediction and covariance, of sensors linearised at `at`; false if the latter is none. */
static bool solve(const struct ribbon_motion_model *model, const struct ribbon_motion_step *step,
                  const struct sums *sums, struct ribbon_motion_work *work) {
    size_t n = model->states, nb = model->block;
    double *force = work->vector[FORCE], *field = work->vector[FIELD], rhs[RIBBON_MOTION_STATE_MAX];
    motion_matrix *sum = &work->matrix[COVARIANCE], *normal = &work->matrix[NORMAL];
    memset(force, 0, n * sizeof(double));
    memset(field, 0, n * sizeof(double));
    add_right_side(&sums->force, force);
    add_right_side(&sums->field, field);
    motion_gram(n, sums->force.count, (const double (*)[STRIDE])sums->force.rows, *sum);
    motion_gram(nb, sums->field.count, (const double (*)[STRIDE])sums->field.rows, *normal);
    for (size_t i = 0; i < n; i++) {
        rhs[i] = force[i] + field[i];
        for (size_t j = i; j < n; j++)
            (*sum)[i][j] += step->information[i][j] + (j < nb ? (*normal)[i][j] : 0.0);
    }
    if (!motion_invert(n, *sum, *sum, work->matrix[SPARE]))
        return false;
    motion_apply(n, *sum, rhs, work->vector[CORRECTION]);
    return true;
}

int ribbon_motion_correct(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                          const struct ribbon_motion_state *around, const struct ribbon_motion_scales *scales,
                          struct ribbon_motion_step *step, struct ribbon_motion_fit *fit,
                          struct ribbon_motion_work *work) {
    size_t n = model->states;
    double *offset = work->vector[OFFSET], *correction = work->vector[CORRECTION];
    struct ribbon_motion_state at = around ? *around : step->predicted;
    step->state = step->predicted;
    memset(fit, 0, sizeof *fit);
    if (!motion_invert(n, step->covariance, step->information, work->matrix[SPARE]))
        return RIBBON_MOTION_ERROR_NOT_FINITE;
    int iterations = around ? 1 : ITERATIONS;
    for (int iteration = 0; iteration < iterations; iteration++) {
        struct sums sums = {
            .force = {.rows = work->force_rows,
                      .innovation = work->force_innovation,
                      .columns = n,
                      .sigma = hypot(sqrt(scales->force_noise * model->params.force_overlap) *
                                         model->params.accel_sigma_mps2,
                                     scales->slack_mps2)},
            .field = {.rows = work->field_rows,
                      .innovation = work->field_innovation,
                      .columns = model->block,
                      .sigma = sqrt(scales->field_noise) * model->params.field_sigma_ut},
        };
        motion_subtract(model, &at, &step->predicted, offset);
        add_sensors(model, sample, &at, offset, step->covariance, work, &sums);
        if (!solve(model, step, &sums, work))
            return RIBBON_MOTION_ERROR_NOT_FINITE;
        motion_add(model, &step->predicted, correction, &at);
        bool last = iteration + 1 == iterations || moved(model, correction, offset) < RELINEARISE_RAD;
        if (last) {
            judge_fit(model, sample, step, &at, &sums, work, fit);
            break;
        }
    }
    step->state = at;
    memcpy(step->covariance, work->matrix[COVARIANCE], sizeof(motion_matrix));
    return 0;
}
