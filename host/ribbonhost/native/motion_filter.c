/* One scan corrects a predicted state: iterated Kalman update, outliers down-weighted. */
#include <string.h>

#include "motion_internal.h"

/* Squared Mahalanobis norm beyond which a sensor is an outlier: one in a million of three Gaussian values. */
#define GATE 30.0
/* Linearise again while the estimate turns or bends by more than this from where it was linearised. */
#define RELINEARISE_RAD 0.02
#define ITERATIONS      4

enum { OFFSET, CORRECTION }; /* vectors in the working memory */

size_t ribbon_motion_work_bytes(void) {
    return sizeof(struct ribbon_motion_work);
}

/* Largest turn or bend of the first block between two errors. */
static double moved(const struct ribbon_motion_model *model, const double *a, const double *b) {
    double length = model->params.pitch_m * (double)(model->slots - 1), most = 0.0;
    for (size_t i = 0; i < model->block; i++)
        most = fmax(most, fabs(a[i] - b[i]) * (i < 3 ? 1.0 : length / (double)(model->modes / 2)));
    return most;
}

/* A correction has the covariance that the update takes from the state: with the right jerk its square is, on
 * average, what is expected. */
static void judge_corrections(const struct ribbon_motion_model *model, const struct ribbon_motion_step *step,
                              const double *x, struct ribbon_motion_fit *fit) {
    double before[3], after[3], square = 0.0;
    motion_anchor_acceleration(model, &step->predicted, before);
    motion_anchor_acceleration(model, &step->state, after);
    for (int d = 0; d < 3; d++)
        square += (after[d] - before[d]) * (after[d] - before[d]);
    double taken = motion_anchor_variance(model, &step->state, step->predicted_covariance) -
                   motion_anchor_variance(model, &step->state, step->covariance);
    fit->anchor_correction = taken > 0.0 ? square / taken : 1.0;
    for (size_t i = 0; i < model->block; i++) {
        size_t k = 2 * model->block + i;
        fit->correction[i] = x[k];
        fit->correction_variance[i] = fmax(0.0, step->predicted_covariance[k][k] - step->covariance[k][k]);
    }
}

/* Score test: with the derivatives H by an acceleration of the anchor and the covariance S of the innovations
 * e the gradient is transpose(H) inverse(S) e, and its covariance transpose(H) inverse(S) H. */
static double anchor_score(const struct ribbon_motion_model *model, const struct ribbon_motion_work *work,
                           const struct motion_equations *equations) {
    double gradient[3] = {0.0}, covariance[3][3] = {{0.0}};
    for (size_t i = equations->fields; i < equations->rows; i++) {
        double white[3] = {0.0};
        for (size_t d = 0; d < 3; d++) {
            size_t column = model->states - 3 + d;
            gradient[d] += work->rows[i][column] * work->solved[i];
            for (size_t k = equations->fields; k <= i; k++)
                white[d] += work->whitener[i][k] * work->rows[k][column];
        }
        for (size_t a = 0; a < 3; a++)
            for (size_t b = 0; b < 3; b++)
                covariance[a][b] += white[a] * white[b];
    }
    double score = motion_quadratic(covariance, gradient) / 3.0;
    return isfinite(score) && score > 0.0 ? score : 0.0;
}

/* Rows [first, last) of the equations, with the covariance S of their innovations e in units of the noise. */
struct share {
    double square;  /* of e inverse(S) e: the normalised innovation */
    double freedom; /* trace of inverse(S): what the correction leaves to the residuals */
};

static struct share share_of(const struct ribbon_motion_work *work, const struct motion_equations *equations,
                             size_t first, size_t last) {
    struct share share = {0.0, 0.0};
    for (size_t i = first; i < last; i++)
        share.square += work->innovation[i] * work->solved[i];
    for (size_t k = first; k < equations->rows; k++)
        for (size_t i = first; i < (k < last ? k + 1 : last); i++)
            share.freedom += work->whitener[k][i] * work->whitener[k][i];
    return share;
}

static void judge_fit(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                      const struct ribbon_motion_step *step, const struct motion_equations *equations,
                      struct ribbon_motion_work *work, struct ribbon_motion_fit *fit) {
    *fit = equations->fit;
    judge_corrections(model, step, work->vector[CORRECTION], fit);
    fit->anchor_score = anchor_score(model, work, equations);
    struct share force = share_of(work, equations, equations->fields, equations->rows);
    struct share field = share_of(work, equations, 0, equations->fields);
    /* Outliers do not count. */
    double axes = (double)model->params.field_axes;
    double forces = 3.0 * (double)(fit->forces - fit->force_outliers);
    double fields = axes * (double)(fit->fields - fit->field_outliers);
    double force_freedom = force.freedom - 3.0 * (double)fit->force_outliers;
    double field_freedom = field.freedom - axes * (double)fit->field_outliers;
    /* Overlapping readings are given more noise than each has: that much smaller are the squares expected. */
    double left = forces > 0.0 ? fmin(1.0, fmax(0.0, force_freedom / forces)) : 0.0;
    double expected = 1.0 - (1.0 - 1.0 / model->params.force_overlap) * left;
    fit->force_innovation = forces > 0.0 ? force.square / (forces * expected) : 1.0;
    fit->field_innovation = fields > 0.0 ? field.square / fields : 1.0;
    motion_typical_residuals(model, sample, &step->state, equations, &work->shape, fit);
    /* With hardly any freedom left there is nothing to learn from the residual. */
    fit->force_residual =
        force_freedom > 0.2 * forces ? fit->force_residual * forces / (force_freedom * expected) : 1.0;
    fit->field_residual = field_freedom > 0.2 * fields ? fit->field_residual * fields / field_freedom : 1.0;
}

/* Covariance of the innovations in units of their noise, without the noise: upper triangle of the spread. */
static void spread_innovations(const struct ribbon_motion_model *model, motion_matrix predicted,
                               const struct motion_equations *equations, struct ribbon_motion_work *work) {
    size_t n = model->states, nb = model->block, fields = equations->fields;
    size_t rows = equations->rows, forces = rows - fields;
    struct motion_view all = MOTION_VIEW(work->rows), through = MOTION_VIEW(work->through);
    struct motion_view across = MOTION_VIEW(work->across), spread = MOTION_VIEW(work->spread);
    struct motion_view force = {work->rows[fields], all.stride};
    motion_product(fields, nb, n, all, MOTION_VIEW(predicted), through);
    motion_product(forces, n, n, force, MOTION_VIEW(predicted),
                   (struct motion_view){work->through[fields], through.stride});
    motion_transpose_rows(rows, n, work->through, work->across);
    motion_product(fields, nb, rows, all, across, spread);
    motion_product(forces, n, forces, force, (struct motion_view){&work->across[0][fields], across.stride},
                   (struct motion_view){&work->spread[fields][fields], spread.stride});
}

/* Outliers among the sensors that have `axes` rows each from `first` on: the further off, the less they pull.
 * Returns their count. */
static size_t weigh(size_t axes, size_t first, size_t last, size_t rows, struct ribbon_motion_work *work) {
    size_t outliers = 0;
    for (size_t row = first; row < last; row += axes) {
        double e[3] = {0.0}, s[3][3] = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}};
        for (size_t a = 0; a < axes; a++) {
            e[a] = work->innovation[row + a];
            for (size_t b = 0; b < axes; b++)
                s[a][b] += work->spread[row + (a < b ? a : b)][row + (a < b ? b : a)];
        }
        double distance = motion_quadratic(s, e);
        if (distance <= GATE)
            continue;
        double weight = GATE / distance;
        outliers++;
        for (size_t i = row; i < row + axes; i++) {
            work->innovation[i] *= weight;
            for (size_t j = 0; j < RIBBON_MOTION_MATRIX_MAX; j++) {
                work->rows[i][j] *= weight;
                work->through[i][j] *= weight;
            }
            for (size_t j = 0; j <= i; j++)
                work->spread[j][i] *= weight;
            for (size_t j = i; j < rows; j++)
                work->spread[i][j] *= weight;
        }
    }
    return outliers;
}

/* Correction of the prediction, and the whitened rows whose squares its covariance loses; false if that has
 * lost its sense. */
static bool solve(const struct ribbon_motion_model *model, struct ribbon_motion_step *step,
                  struct motion_equations *equations, struct ribbon_motion_work *work) {
    size_t n = model->states, rows = equations->rows;
    double *x = work->vector[CORRECTION];
    spread_innovations(model, step->predicted_covariance, equations, work);
    equations->fit.field_outliers = weigh((size_t)model->params.field_axes, 0, equations->fields, rows, work);
    equations->fit.force_outliers = weigh(3, equations->fields, rows, rows, work);
    for (size_t i = 0; i < rows; i++)
        work->spread[i][i] += 1.0;
    if (!motion_whiten(rows, work->spread, work->whitener))
        return false;
    memset(work->solved, 0, rows * sizeof(double));
    memset(x, 0, n * sizeof(double));
    for (size_t i = 0; i < rows; i++) {
        double white = motion_dot(i + 1, work->whitener[i], work->innovation);
        for (size_t k = 0; k <= i; k++)
            work->solved[k] += work->whitener[i][k] * white;
    }
    for (size_t i = 0; i < rows; i++)
        for (size_t j = 0; j < n; j++)
            x[j] += work->through[i][j] * work->solved[i];
    motion_lower_product(rows, n, MOTION_VIEW(work->whitener), MOTION_VIEW(work->through),
                         MOTION_VIEW(work->whitened));
    return true;
}

int ribbon_motion_correct(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                          const struct ribbon_motion_state *around, const struct ribbon_motion_scales *scales,
                          struct ribbon_motion_step *step, struct ribbon_motion_fit *fit,
                          struct ribbon_motion_work *work) {
    size_t n = model->states;
    double *offset = work->vector[OFFSET], *correction = work->vector[CORRECTION];
    struct motion_equations equations;
    step->state = around ? *around : step->predicted;
    memset(fit, 0, sizeof *fit);
    bool last = false;
    for (int iteration = 1; !last; iteration++) {
        equations = (struct motion_equations){
            .force_sigma = hypot(sqrt(scales->force_noise * model->params.force_overlap) *
                                     model->params.accel_sigma_mps2,
                                 scales->slack_mps2),
            .field_sigma = sqrt(scales->field_noise) * model->params.field_sigma_ut,
        };
        motion_subtract(model, &step->state, &step->predicted, offset);
        motion_add_sensors(model, sample, &step->state, offset, work, &equations);
        if (!solve(model, step, &equations, work)) {
            step->state = step->predicted;
            memcpy(step->covariance, step->predicted_covariance, sizeof(motion_matrix));
            return RIBBON_MOTION_ERROR_NOT_FINITE;
        }
        motion_add(model, &step->predicted, correction, &step->state);
        last = around || iteration == ITERATIONS || moved(model, correction, offset) < RELINEARISE_RAD;
    }
    motion_subtract_squares(n, equations.rows, work->whitened, step->predicted_covariance, step->covariance);
    judge_fit(model, sample, step, &equations, work, fit);
    return 0;
}
