/* Dense linear algebra of small symmetric matrices, in loops that a compiler turns into vector code. */
#include <string.h>

#include "motion_internal.h"

enum { STRIDE = RIBBON_MOTION_STATE_MAX };

/* Nearly all of the time goes here: on processors that have wider vectors these functions use them. */
#if defined(__x86_64__) && defined(__linux__) && defined(__GNUC__) && !defined(__clang__) &&                 \
    !defined(__SANITIZE_ADDRESS__)
#define WIDE __attribute__((target_clones("arch=haswell", "default")))
#define PART static inline __attribute__((always_inline))
#else
#define WIDE
#define PART static inline
#endif

/* out[j] -= sum over k of coefficient[k * step] * rows[k][j] for j in [first, last). Four rows at a time,
 * which is what keeps the arithmetic busier than the memory. */
PART void subtract_rows(double *restrict out, const double *restrict rows, const double *coefficient,
                        size_t step, size_t count, size_t first, size_t last) {
    size_t k = 0;
    for (; k + 4 <= count; k += 4) {
        const double *r = rows + k * STRIDE;
        double a = coefficient[k * step], b = coefficient[(k + 1) * step];
        double c = coefficient[(k + 2) * step], d = coefficient[(k + 3) * step];
        for (size_t j = first; j < last; j++)
            out[j] -= a * r[j] + b * r[STRIDE + j] + c * r[2 * STRIDE + j] + d * r[3 * STRIDE + j];
    }
    for (; k < count; k++) {
        const double *r = rows + k * STRIDE;
        double a = coefficient[k * step];
        for (size_t j = first; j < last; j++)
            out[j] -= a * r[j];
    }
}

/* Cholesky a = transpose(U) U, then transpose(U) X = 1 and U Y = X. U replaces the upper triangle of a, X and
 * Y the lower one of the workspace. */
WIDE bool motion_invert(size_t n, motion_matrix a, motion_matrix workspace) {
    for (size_t i = 0; i < n; i++) {
        double row[STRIDE];
        memcpy(row + i, a[i] + i, (n - i) * sizeof(double));
        subtract_rows(row, a[0], &a[0][i], STRIDE, i, i, n);
        if (!(row[i] > 0.0) || !isfinite(row[i]))
            return false;
        double scale = 1.0 / sqrt(row[i]);
        for (size_t j = i; j < n; j++)
            a[i][j] = row[j] * scale;
    }
    for (size_t i = 0; i < n; i++) {
        double *row = workspace[i];
        memset(row, 0, n * sizeof(double));
        row[i] = 1.0;
        subtract_rows(row, workspace[0], &a[0][i], STRIDE, i, 0, i);
        double scale = 1.0 / a[i][i];
        for (size_t j = 0; j <= i; j++)
            row[j] *= scale;
    }
    for (size_t i = n; i-- > 0;) {
        double *row = workspace[i];
        if (i + 1 < n)
            subtract_rows(row, workspace[i + 1], &a[i][i + 1], 1, n - 1 - i, 0, i + 1);
        double scale = 1.0 / a[i][i];
        for (size_t j = 0; j <= i; j++)
            row[j] *= scale;
    }
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j <= i; j++)
            a[i][j] = a[j][i] = workspace[i][j];
    return true;
}

WIDE void motion_product(size_t n, const motion_matrix a, const motion_matrix b, motion_matrix out) {
    for (size_t i = 0; i < n; i++) {
        double *restrict o = out[i];
        memset(o, 0, n * sizeof(double));
        subtract_rows(o, b[0], a[i], 1, n, 0, n);
        for (size_t j = 0; j < n; j++)
            o[j] = -o[j];
    }
}

WIDE void motion_symmetric_product(size_t n, const motion_matrix a, const motion_matrix b,
                                   motion_matrix out) {
    for (size_t i = 0; i < n; i++) {
        double *restrict o = out[i];
        memset(o + i, 0, (n - i) * sizeof(double));
        subtract_rows(o, b[0], a[i], 1, n, i, n);
        for (size_t j = i; j < n; j++)
            o[j] = -o[j];
    }
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < i; j++)
            out[i][j] = out[j][i];
}

WIDE void motion_apply(size_t n, const motion_matrix a, const double *v, double *out) {
    for (size_t i = 0; i < n; i++) {
        /* Four partial sums: a compiler may not reorder one. */
        double s[4] = {0.0, 0.0, 0.0, 0.0};
        size_t j = 0;
        for (; j + 4 <= n; j += 4)
            for (size_t k = 0; k < 4; k++)
                s[k] += a[i][j + k] * v[j + k];
        for (; j < n; j++)
            s[0] += a[i][j] * v[j];
        out[i] = (s[0] + s[1]) + (s[2] + s[3]);
    }
}

/* Cramer's rule. */
double motion_quadratic(double s[3][3], const double e[3]) {
    double c0[3], c1[3], c2[3];
    cross(s[1], s[2], c0);
    cross(s[2], s[0], c1);
    cross(s[0], s[1], c2);
    double x = dot(e, c0), y = dot(e, c1), z = dot(e, c2);
    return (e[0] * x + e[1] * y + e[2] * z) / dot(s[0], c0);
}
