/* Shape and acceleration of a ribbon from its state, and their derivatives. */
#include <string.h>

#include "motion_internal.h"

#define PI 3.14159265358979323846

/* The uniform cubic B-spline whose support is [0, 4], integrated once or twice from -infinity to u. */
static double bspline_integral(double u, int times) {
    static const double binomial[5] = {1.0, -4.0, 6.0, -4.0, 1.0};
    if (u >= 4.0)
        return times == 1 ? 1.0 : u - 2.0;
    double sum = 0.0;
    for (int i = 0; i < 5 && u > i; i++) {
        double v = u - i, power = v * v * v * v;
        sum += binomial[i] * (times == 1 ? power : power * v / 5.0);
    }
    return sum / 24.0;
}

/* Integral and first moment about its middle, over each segment, of `count` B-splines that cover the ribbon.
 */
static void segment_integrals(struct ribbon_motion_model *model, size_t first, size_t count) {
    double intervals = (double)(count - 3), segments = (double)(model->slots - 1);
    double width = intervals / segments, spacing = model->params.pitch_m / width;
    for (size_t i = 0; i + 1 < model->slots; i++)
        for (size_t j = 0; j < count; j++) {
            double u = (double)i * width + 3.0 - (double)j;
            double before = bspline_integral(u, 1), after = bspline_integral(u + width, 1);
            double mean = (bspline_integral(u + width, 2) - bspline_integral(u, 2)) / width;
            model->segment[i][first + j] = spacing * (after - before);
            model->moment[i][first + j] = spacing * (0.5 * (before + after) - mean);
        }
}

/* The anchor's x''' = -c2 x'' - c1 x' - c0 x + white noise; its stationary covariance follows from the
 * derivatives of E[x x''] and E[x' x''] being zero. */
static void anchor_process(struct ribbon_motion_model *model) {
    const struct ribbon_motion_params *p = &model->params;
    double low = 2.0 * PI * p->anchor_low_hz, high = 2.0 * PI * p->anchor_high_hz;
    double *c = model->anchor_rate;
    c[0] = low * low * high;
    c[1] = low * (low + 2.0 * high);
    c[2] = 2.0 * low + high;
    double acceleration = p->anchor_sigma_mps2 * p->anchor_sigma_mps2;
    double velocity = acceleration / c[1];
    memset(model->anchor_covariance, 0, sizeof model->anchor_covariance);
    model->anchor_covariance[0][0] = velocity * c[2] / c[0];
    model->anchor_covariance[1][1] = velocity;
    model->anchor_covariance[2][2] = acceleration;
    model->anchor_covariance[0][2] = model->anchor_covariance[2][0] = -velocity;
}

/* Orthonormal polynomials over the nodes, by Gram and Schmidt. */
static void offset_shapes(struct ribbon_motion_model *model) {
    size_t n = model->params.nodes;
    for (size_t j = 0; j < RIBBON_MOTION_OFFSET_SHAPES; j++) {
        double *shape = model->offset_shape[j], square = 0.0;
        for (size_t k = 0; k < n; k++)
            shape[k] =
                j == 0 ? 1.0 : model->offset_shape[j - 1][k] * (2.0 * (double)k / (double)(n - 1) - 1.0);
        for (size_t i = 0; i < j; i++) {
            double along = 0.0;
            for (size_t k = 0; k < n; k++)
                along += shape[k] * model->offset_shape[i][k];
            for (size_t k = 0; k < n; k++)
                shape[k] -= along * model->offset_shape[i][k];
        }
        for (size_t k = 0; k < n; k++)
            square += shape[k] * shape[k];
        for (size_t k = 0; k < n; k++)
            shape[k] /= sqrt(square);
    }
}

/* x of a magnetometer as near that of the node as its normal lets it. False if there is none. */
static bool field_frames(struct ribbon_motion_model *model) {
    for (size_t k = 0; k < model->params.nodes; k++) {
        const double *normal = model->params.field_normal[k];
        double *x = model->field_frame[k], *y = x + 3, *z = x + 6;
        double length = sqrt(dot(normal, normal));
        for (size_t d = 0; d < 3; d++)
            z[d] = normal[d] / length;
        double across = sqrt(1.0 - z[0] * z[0]);
        if (!(across > 0.1))
            return false;
        for (size_t d = 0; d < 3; d++)
            x[d] = ((d == 0 ? 1.0 : 0.0) - z[0] * z[d]) / across;
        cross(z, x, y);
    }
    return true;
}

static bool positive(double x) {
    return isfinite(x) && x > 0.0;
}

int ribbon_motion_model_init(struct ribbon_motion_model *model, const struct ribbon_motion_params *params) {
    const struct ribbon_motion_params *p = params;
    if (p->nodes < RIBBON_MOTION_NODE_MIN || p->nodes > RIBBON_MOTION_NODE_MAX)
        return RIBBON_MOTION_ERROR_COUNT;
    bool good = positive(p->pitch_m) && positive(p->gravity_mps2) &&
                positive(dot(p->field_ut, p->field_ut)) && (p->field_axes == 2 || p->field_axes == 3) &&
                positive(p->accel_sigma_mps2) && positive(p->field_sigma_ut) && positive(p->root_jerk) &&
                positive(p->twist_jerk) && positive(p->bend_jerk) && p->force_jitter_s >= 0.0 &&
                p->force_overlap >= 1.0 && isfinite(p->force_overlap) && isfinite(p->force_jitter_s) &&
                isfinite(p->field_later_s) && positive(p->persistence_s) &&
                positive(p->offset_persistence_s) && positive(p->anchor_sigma_mps2) &&
                positive(p->anchor_low_hz) && positive(p->anchor_high_hz);
    if (!good)
        return RIBBON_MOTION_ERROR_PARAMETER;
    memset(model, 0, sizeof *model);
    model->params = *p;
    model->slots = 2 * p->nodes;
    /* Fewer modes than nodes: what they cannot hold would be noise. */
    model->twist_modes = p->nodes < RIBBON_MOTION_TWIST_MAX ? p->nodes : RIBBON_MOTION_TWIST_MAX;
    size_t bend = p->nodes + 2 < RIBBON_MOTION_BEND_MAX ? p->nodes + 2 : RIBBON_MOTION_BEND_MAX;
    model->modes = model->twist_modes + bend;
    model->block = 3 + model->modes;
    model->states = 3 * model->block + RIBBON_MOTION_OFFSETS + 9;
    if (!field_frames(model))
        return RIBBON_MOTION_ERROR_PARAMETER;
    offset_shapes(model);
    segment_integrals(model, 0, model->twist_modes);
    segment_integrals(model, model->twist_modes, bend);
    anchor_process(model);
    return 0;
}

size_t motion_quadrature(size_t slots, size_t i, double weight[4]) {
    /* Integrals of the cubic through four neighbouring slots. */
    static const double rule[3][4] = {{9.0 / 24.0, 19.0 / 24.0, -5.0 / 24.0, 1.0 / 24.0},
                                      {-1.0 / 24.0, 13.0 / 24.0, 13.0 / 24.0, -1.0 / 24.0},
                                      {1.0 / 24.0, -5.0 / 24.0, 19.0 / 24.0, 9.0 / 24.0}};
    size_t which = i == 0 ? 0 : i + 2 == slots ? 2 : 1;
    memcpy(weight, rule[which], sizeof rule[which]);
    return i - which;
}

/* out (3, columns) += m in, with row strides `stride_out` and `stride_in`. */
WIDE static void add_product(const double m[9], size_t columns, const double *in, size_t stride_in,
                             double *out, size_t stride_out) {
    for (size_t r = 0; r < 3; r++) {
        double a = m[3 * r], b = m[3 * r + 1], c = m[3 * r + 2];
        const double *restrict x = in, *restrict y = in + stride_in, *restrict z = in + 2 * stride_in;
        double *restrict o = out + r * stride_out;
        for (size_t j = 0; j < columns; j++)
            o[j] += a * x[j] + b * y[j] + c * z[j];
    }
}

/* Matrix of u -> v x u, times `scale`. */
static void skew(const double v[3], double scale, double m[9]) {
    m[0] = m[4] = m[8] = 0.0;
    m[1] = -scale * v[2];
    m[2] = scale * v[1];
    m[3] = scale * v[2];
    m[5] = -scale * v[0];
    m[6] = -scale * v[1];
    m[7] = scale * v[0];
}

enum { BLOCK = RIBBON_MOTION_BLOCK_MAX };

/* Derivatives of angular rate and angular acceleration at one slot. */
struct running {
    double rate[3][2 * BLOCK];
    double angular[3][3 * BLOCK];
};

/* Twist about the tangent and bending about the binormal of a segment from coefficients `c`: integral and
 * moment. */
static void segment_vector(const struct ribbon_motion_model *model, size_t i, const double *c, double out[3],
                           double moment[2]) {
    const double *s = model->segment[i], *m = model->moment[i];
    out[0] = out[1] = out[2] = moment[0] = moment[1] = 0.0;
    for (size_t j = 0; j < model->modes; j++) {
        size_t axis = j < model->twist_modes ? 0 : 1;
        out[axis] += s[j] * c[j];
        moment[axis] += m[j] * c[j];
    }
}

/* Twist and bending do not commute: where one changes along a segment relative to the other, the segment
 * turns about its normal, too (second term of the Magnus expansion). v: integrals, m: moments; place, rate,
 * acceleration. */
static void turn_in_plane(double v[3][3], double m[3][2]) {
    v[0][2] = v[0][0] * m[0][1] - v[0][1] * m[0][0];
    v[1][2] = v[1][0] * m[0][1] - v[1][1] * m[0][0] + v[0][0] * m[1][1] - v[0][1] * m[1][0];
    v[2][2] = v[2][0] * m[0][1] - v[2][1] * m[0][0] + v[0][0] * m[2][1] - v[0][1] * m[2][0] +
              2.0 * (v[1][0] * m[1][1] - v[1][1] * m[1][0]);
}

/* Carries the derivatives over segment i: u, u2 are its relative angular rate and acceleration, w its mean
 * angular rate; `middle` the orientation halfway. */
static void carry(const struct ribbon_motion_model *model, size_t i, const double middle[9],
                  const double u[3], const double u2[3], const double w[3], struct motion_shape *shape,
                  struct running *run) {
    size_t nb = model->block, tw = model->twist_modes;
    double mode[3][BLOCK], half[3][BLOCK], change[3][2 * BLOCK], mean[3][2 * BLOCK], m[9];
    for (int r = 0; r < 3; r++) {
        mode[r][0] = mode[r][1] = mode[r][2] = 0.0;
        for (size_t j = 0; j < model->modes; j++)
            mode[r][3 + j] = middle[3 * r + (j < tw ? 0 : 1)] * model->segment[i][j];
        for (size_t j = 0; j < nb; j++) {
            half[r][j] = shape->turn[i][r][j] + 0.5 * mode[r][j];
            shape->turn[i + 1][r][j] = shape->turn[i][r][j] + mode[r][j];
            change[r][j] = 0.0;
            change[r][nb + j] = mode[r][j];
        }
    }
    skew(u, -1.0, m);
    add_product(m, nb, half[0], BLOCK, change[0], 2 * BLOCK);
    for (int r = 0; r < 3; r++)
        for (size_t j = 0; j < 2 * nb; j++) {
            mean[r][j] = run->rate[r][j] + 0.5 * change[r][j];
            run->rate[r][j] += change[r][j];
        }
    add_product(m, 2 * nb, mean[0], 2 * BLOCK, run->angular[0], 3 * BLOCK);
    skew(w, 1.0, m);
    add_product(m, 2 * nb, change[0], 2 * BLOCK, run->angular[0], 3 * BLOCK);
    skew(u2, -1.0, m);
    add_product(m, nb, half[0], BLOCK, run->angular[0], 3 * BLOCK);
    for (int r = 0; r < 3; r++)
        for (size_t j = 0; j < nb; j++)
            run->angular[r][2 * nb + j] += mode[r][j];
}

/* Derivatives of the tangent's second time derivative t'' = alpha x t + w x (w x t) at slot i. */
static void tangent_derivatives(const struct ribbon_motion_model *model, size_t i, const double t[3],
                                struct motion_shape *shape, const struct running *run) {
    size_t nb = model->block;
    const double *w = shape->rate[i], *alpha = shape->angular[i];
    double st[9], sw[9], sa[9], swt[9], ww[9], m[9], wt[3];
    cross(w, t, wt);
    skew(t, -1.0, st);
    skew(w, 1.0, sw);
    skew(alpha, 1.0, sa);
    skew(wt, -1.0, swt);
    multiply3(sw, sw, ww);
    for (int k = 0; k < 9; k++)
        ww[k] += sa[k];
    for (int r = 0; r < 3; r++)
        memset(shape->change[i][r], 0, 3 * nb * sizeof(double));
    double *out = shape->change[i][0];
    add_product(st, 3 * nb, run->angular[0], 3 * BLOCK, out, 3 * BLOCK);
    multiply3(ww, st, m);
    add_product(m, nb, shape->turn[i][0], BLOCK, out, 3 * BLOCK);
    multiply3(sw, st, m);
    for (int k = 0; k < 9; k++)
        m[k] += swt[k];
    add_product(m, 2 * nb, run->rate[0], 2 * BLOCK, out, 3 * BLOCK);
}

static void start_derivatives(size_t nb, struct motion_shape *shape, struct running *run) {
    memset(run, 0, sizeof *run);
    memset(shape->turn[0], 0, sizeof shape->turn[0]);
    for (size_t r = 0; r < 3; r++)
        run->rate[r][nb + r] = run->angular[r][2 * nb + r] = 1.0;
}

/* Second derivative of the tangent at slot i, into the shape. */
static void tangent_change(size_t i, const double t[3], struct motion_shape *shape) {
    const double *w = shape->rate[i];
    double wt[3], centripetal[3];
    cross(w, t, wt);
    cross(w, wt, centripetal);
    cross(shape->angular[i], t, shape->tangent_change[i]);
    for (int d = 0; d < 3; d++)
        shape->tangent_change[i][d] += centripetal[d];
}

static void accelerations(const struct ribbon_motion_model *model, struct motion_shape *shape) {
    memset(shape->acceleration[0], 0, sizeof shape->acceleration[0]);
    for (size_t i = 0; i + 1 < model->slots; i++) {
        double weight[4];
        size_t first = motion_quadrature(model->slots, i, weight);
        for (int d = 0; d < 3; d++) {
            double sum = 0.0;
            for (size_t k = 0; k < 4; k++)
                sum += weight[k] * shape->tangent_change[first + k][d];
            shape->acceleration[i + 1][d] = shape->acceleration[i][d] + model->params.pitch_m * sum;
        }
    }
}

void motion_shape(const struct ribbon_motion_model *model, const struct ribbon_motion_state *state,
                  bool derivatives, struct motion_shape *shape) {
    size_t nb = model->block;
    struct running run;
    if (derivatives)
        start_derivatives(nb, shape, &run);
    memset(shape->rotation[0], 0, sizeof shape->rotation[0]);
    shape->rotation[0][0] = shape->rotation[0][4] = shape->rotation[0][8] = 1.0;
    memcpy(shape->rate[0], state->x + nb, sizeof shape->rate[0]);
    memcpy(shape->angular[0], state->x + 2 * nb, sizeof shape->angular[0]);
    for (size_t i = 0; i < model->slots; i++) {
        const double *rotation = shape->rotation[i], *w = shape->rate[i];
        const double t[3] = {rotation[0], rotation[3], rotation[6]};
        tangent_change(i, t, shape);
        if (derivatives)
            tangent_derivatives(model, i, t, shape, &run);
        if (i + 1 == model->slots)
            break;
        double turns[3][3], moments[3][2], half[9], middle[9], u[3], u2[3], mean[3], turning[3], bend[3];
        for (size_t order = 0; order < 3; order++)
            segment_vector(model, i, state->x + order * nb + 3, turns[order], moments[order]);
        turn_in_plane(turns, moments);
        for (int d = 0; d < 3; d++)
            bend[d] = 0.5 * turns[0][d];
        motion_exp(bend, half);
        multiply3(rotation, half, middle);
        multiply3(middle, half, shape->rotation[i + 1]);
        rotate(middle, turns[1], u);
        rotate(middle, turns[2], u2);
        for (int d = 0; d < 3; d++)
            mean[d] = w[d] + 0.5 * u[d];
        cross(mean, u, turning);
        for (int d = 0; d < 3; d++) {
            shape->rate[i + 1][d] = w[d] + u[d];
            shape->angular[i + 1][d] = shape->angular[i][d] + u2[d] + turning[d];
        }
        if (derivatives)
            carry(model, i, middle, u, u2, mean, shape, &run);
    }
    accelerations(model, shape);
}
