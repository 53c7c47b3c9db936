/* Small arithmetic and the interface between the files of the motion estimator. */
#ifndef MOTION_INTERNAL_H
#define MOTION_INTERNAL_H

#include <math.h>
#include <stdbool.h>

#include "ribbon_motion.h"

static inline void cross(const double a[3], const double b[3], double out[3]) {
    double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
    out[0] = x;
    out[1] = y;
    out[2] = z;
}

static inline double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* out = m v, row-major. */
static inline void rotate(const double m[9], const double v[3], double out[3]) {
    for (int i = 0; i < 3; i++)
        out[i] = m[3 * i] * v[0] + m[3 * i + 1] * v[1] + m[3 * i + 2] * v[2];
}

/* out = transpose(m) v. */
static inline void rotate_back(const double m[9], const double v[3], double out[3]) {
    for (int i = 0; i < 3; i++)
        out[i] = m[i] * v[0] + m[3 + i] * v[1] + m[6 + i] * v[2];
}

/* out = a b; out must not overlap. */
static inline void multiply3(const double a[9], const double b[9], double out[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}

/* Rotation by the vector v (angle times axis). */
void motion_exp(const double v[3], double out[9]);
/* The rotation vector of m, angle at most pi. */
void motion_log(const double m[9], double out[3]);
/* root = exp(v) root, made orthonormal again. */
void motion_turn(double root[9], const double v[3]);
void motion_to_quaternion(const double m[9], double q[4]);
void motion_from_quaternion(const double q[4], double m[9]);

/* The shape of a state at every slot, seen from the frame of the anchor: orientation there is the identity
 * and does not matter. Columns of derivatives are those of the first three blocks; those of the anchor's
 * rotation are zero. */
struct motion_shape {
    double rotation[RIBBON_MOTION_SLOT_MAX][9];
    double rate[RIBBON_MOTION_SLOT_MAX][3];           /* angular */
    double angular[RIBBON_MOTION_SLOT_MAX][3];        /* angular acceleration */
    double tangent_change[RIBBON_MOTION_SLOT_MAX][3]; /* second time derivative of the tangent */
    double acceleration[RIBBON_MOTION_SLOT_MAX][3];   /* relative to the anchor */
    /* Derivatives: of the rotation vector by the first block, of the acceleration by all three. */
    double turn[RIBBON_MOTION_SLOT_MAX][3][RIBBON_MOTION_BLOCK_MAX];
    double change[RIBBON_MOTION_SLOT_MAX][3][3 * RIBBON_MOTION_BLOCK_MAX];
};

/* Four-point integral (fourth order) over the segment after slot i: first of the slots and their weights in
 * units of the pitch. */
size_t motion_quadrature(size_t slots, size_t i, double weight[4]);

void motion_shape(const struct ribbon_motion_model *model, const struct ribbon_motion_state *state,
                  bool derivatives, struct motion_shape *shape);

enum { MOTION_ROW_MAX = 6 * RIBBON_MOTION_NODE_MAX }; /* values of all sensors */

typedef double motion_matrix[RIBBON_MOTION_MATRIX_MAX][RIBBON_MOTION_MATRIX_MAX];
typedef double motion_rows[MOTION_ROW_MAX][RIBBON_MOTION_MATRIX_MAX];
typedef double motion_columns[RIBBON_MOTION_MATRIX_MAX][MOTION_ROW_MAX];
typedef double motion_spread[MOTION_ROW_MAX][MOTION_ROW_MAX];

/* On processors that have wider vectors the functions in which the time is spent use them. Both kinds are
 * chosen by feature: of arch= only exactly that processor would have a use. */
#if defined(__x86_64__) && defined(__gnu_linux__) && defined(__GNUC__) && !defined(__clang__) &&             \
    !defined(__SANITIZE_ADDRESS__)
#define WIDE __attribute__((target_clones("fma", "default")))
#else
#define WIDE
#endif
/* A part of such a function. */
#define PART static inline __attribute__((always_inline))

/* Rows of numbers, `stride` from one to the next. */
struct motion_view {
    double *at;
    size_t stride;
};

/* The view of an array of arrays. */
#define MOTION_VIEW(a) ((struct motion_view){(double *)(a), sizeof((a)[0]) / sizeof((a)[0][0])})

/* In all of these, outputs are whole tiles of 6 x 8: there must be memory for them, and what lies beyond the
 * given sizes means nothing. */

/* out = inverse of symmetric positive definite a (n, n), of which the upper triangle is read; out may be a.
 * False, with out undefined, if it is not positive definite. */
bool motion_invert(size_t n, const motion_matrix a, motion_matrix out, motion_matrix workspace);
/* whitener x, a lower triangle, with x s transpose(x) = 1 for symmetric positive definite s (n, n), of which
 * the upper triangle is read and which is lost. False, with x undefined, if it is not positive definite. */
bool motion_whiten(size_t n, motion_spread s, motion_spread x);
/* out (rows, columns) = a (rows, inner) b (inner, columns); out must not overlap. */
void motion_product(size_t rows, size_t inner, size_t columns, struct motion_view a, struct motion_view b,
                    struct motion_view out);
/* The same with a lower triangle a (rows, rows). */
void motion_lower_product(size_t rows, size_t columns, struct motion_view a, struct motion_view b,
                          struct motion_view out);
/* out = a b for (n, n) where that is known to be symmetric; out must not overlap. */
void motion_symmetric_product(size_t n, const motion_matrix a, const motion_matrix b, motion_matrix out);
/* out = from - transpose(rows) rows, rows (count, n), from symmetric. */
void motion_subtract_squares(size_t n, size_t count, const motion_rows rows, const motion_matrix from,
                             motion_matrix out);
/* a = transpose(a). */
void motion_transpose(size_t n, motion_matrix a);
/* columns (n, count) = transpose(rows) of rows (count, n). */
void motion_transpose_rows(size_t count, size_t n, const motion_rows rows, motion_columns columns);
/* a b of vectors. */
double motion_dot(size_t n, const double *a, const double *b);
/* out = a v for (n, n). */
void motion_apply(size_t n, const motion_matrix a, const double *v, double *out);
/* e inverse(s) e, s symmetric. */
double motion_quadratic(double s[3][3], const double e[3]);

/* Equations of all sensors, each row in units of its noise: those of the magnetometers, which tell of the
 * first block of the state only, come before those of the accelerometers. */
struct motion_equations {
    size_t fields, rows; /* of the magnetometers, of all */
    double force_sigma, field_sigma;
    struct ribbon_motion_fit fit;
};

/* Adds the equations of all valid sensors, linearised at `at`, which lies `offset` from the prediction. */
void motion_add_sensors(const struct ribbon_motion_model *model, const struct ribbon_motion_sample *sample,
                        const struct ribbon_motion_state *at, const double *offset,
                        struct ribbon_motion_work *work, struct motion_equations *equations);
/* What a state leaves unexplained: fills force_left, and as force_residual and field_residual quantiles of
 * the squared residual over the sensors of a kind, in units of the one expected. */
void motion_typical_residuals(const struct ribbon_motion_model *model,
                              const struct ribbon_motion_sample *sample,
                              const struct ribbon_motion_state *state,
                              const struct motion_equations *equations, struct motion_shape *shape,
                              struct ribbon_motion_fit *fit);

/* to = from + d in the order of the error; `to` may be `from`. */
void motion_add(const struct ribbon_motion_model *model, const struct ribbon_motion_state *from,
                const double *d, struct ribbon_motion_state *to);
/* d with motion_add(from, d) = to. */
void motion_subtract(const struct ribbon_motion_model *model, const struct ribbon_motion_state *to,
                     const struct ribbon_motion_state *from, double *d);

/* What the jerk of entry i of the first block belongs to. */
enum ribbon_motion_jerk motion_jerk_kind(const struct ribbon_motion_model *model, size_t i);

/* The linear step of the error between two states. */
struct motion_transition {
    const struct ribbon_motion_state *before, *after;
    double dt_s;
    double turn[9];      /* of the anchor, in its own frame */
    double middle[9];    /* orientation at the anchor halfway */
    double offset;       /* of the accelerometers' offsets */
    double shape[3][3];  /* of rotation, twist and bending with their derivatives, one coordinate */
    double anchor[3][3]; /* of the anchor's position, velocity and acceleration, one axis */
};
/* Of `after` only the time must be filled. */
void motion_transition(const struct ribbon_motion_model *model, const struct ribbon_motion_state *before,
                       const struct ribbon_motion_state *after, struct motion_transition *transition);
/* Error of the specific force at the anchor in its frame, from that of its acceleration in the world. */
void motion_to_body(const struct ribbon_motion_model *model, const struct ribbon_motion_state *state,
                    double *v);
/* v = transpose(F) v, F the step of the error. */
void motion_backward(const struct ribbon_motion_model *model, const struct motion_transition *f, double *v);
/* p = F p transpose(F): F the process with the anchor's acceleration in the world, or motion_to_body at the
 * state after it. */
void motion_both_sides(const struct ribbon_motion_model *model, const struct motion_transition *f,
                       bool process, motion_matrix p);
/* The anchor's acceleration in the world, of a state and into a state. */
void motion_anchor_acceleration(const struct ribbon_motion_model *model,
                                const struct ribbon_motion_state *state, double out[3]);
/* Its variance, the sum of the three axes, if the state has that covariance. */
double motion_anchor_variance(const struct ribbon_motion_model *model,
                              const struct ribbon_motion_state *state, const motion_matrix covariance);
void motion_set_anchor(const struct ribbon_motion_model *model, const double acceleration[3],
                       struct ribbon_motion_state *state);

/* Index of the anchor's nine states, behind the offsets. */
static inline size_t motion_anchor_index(const struct ribbon_motion_model *model) {
    return model->states - 9;
}

/* Scales of a tracker that has seen nothing; those at a start, unless it has learnt in an earlier pass; and
 * what a sample teaches, which also makes the covariance of its step honest. */
void motion_learn_nothing(struct ribbon_motion_tracker *tracker);
void motion_learn_anew(struct ribbon_motion_tracker *tracker, bool still);
void motion_learn(struct ribbon_motion_tracker *tracker, double dt_s, struct ribbon_motion_step *step);
/* Raises all jerks; false if they cannot be larger. */
bool motion_livelier(struct ribbon_motion_tracker *tracker);

struct ribbon_motion_work {
    struct motion_shape shape;
    double pull[3]
               [3 * RIBBON_MOTION_BLOCK_MAX]; /* derivative of the acceleration, running along the ribbon */
    /* While a sample corrects: derivatives of the readings, their product with the covariance of the
     * prediction, whitened; the transpose of that product; the covariance of the innovations, and what
     * whitens it. */
    motion_rows rows, through, whitened;
    motion_columns across;
    motion_spread spread, whitener;
    double innovation[MOTION_ROW_MAX], solved[MOTION_ROW_MAX];
    motion_matrix matrix[4];
    double vector[2][RIBBON_MOTION_STATE_MAX];
};

#endif
