/* Small vector arithmetic and input checks shared by the files of the solver. */
#ifndef INTERNAL_H
#define INTERNAL_H

#include <math.h>
#include <stdbool.h>

#include "ribbon_native.h"

static inline double dot3(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void copy3(double *out, const double *a) {
    out[0] = a[0];
    out[1] = a[1];
    out[2] = a[2];
}

static inline void fill(double *out, size_t count, double value) {
    for (size_t i = 0; i < count; i++)
        out[i] = value;
}

/* A zero vector becomes NaN, which stands for "no direction" everywhere here. */
static inline void normalise3(double *v) {
    double scale = 1.0 / sqrt(dot3(v, v));
    if (!isfinite(scale))
        scale = NAN;
    v[0] *= scale;
    v[1] *= scale;
    v[2] *= scale;
}

static inline bool counts_ok(size_t ribbons, size_t nodes) {
    return ribbons <= RIBBON_BATCH_LIMIT && nodes >= 2 && nodes <= RIBBON_NODE_LIMIT;
}

/* Also refuses NaN: every comparison with it is false. */
static inline bool increasing(const double *x, size_t count) {
    if (!(x[0] >= 0.0))
        return false;
    for (size_t i = 1; i < count; i++)
        if (!(x[i] > x[i - 1]))
            return false;
    return isfinite(x[count - 1]);
}

/* Nodes `at` (at most 4) from which invalid node k is filled, in ascending order, and their weights; returns
 * how many. There must be a valid node. */
size_t bridge_weights(size_t nodes, const double *s, const uint8_t *valid, size_t k, size_t *at,
                      double *weight);

/* Piece between nodes k and k + 1 that holds x; the first and the last go on beyond the nodes. */
static inline size_t find_piece(size_t nodes, const double *s, double x) {
    size_t low = 0, high = nodes - 1;
    while (high - low > 1) {
        size_t middle = (low + high) / 2;
        if (x >= s[middle])
            low = middle;
        else
            high = middle;
    }
    return low;
}

static inline bool all_within(size_t count, const double *x, double last) {
    for (size_t i = 0; i < count; i++)
        if (!(x[i] >= 0.0 && x[i] <= last))
            return false;
    return true;
}

/* Cubic Hermite basis at u in [0, 1]: values at the start and the end, derivatives at the start and the end.
 */
static inline void hermite_basis(double u, double h[4]) {
    double u2 = u * u, u3 = u2 * u;
    h[0] = 1.0 - 3.0 * u2 + 2.0 * u3;
    h[1] = 3.0 * u2 - 2.0 * u3;
    h[2] = u - 2.0 * u2 + u3;
    h[3] = u3 - u2;
}

static inline void hermite_basis_slope(double u, double h[4]) {
    double u2 = u * u;
    h[0] = 6.0 * (u2 - u);
    h[1] = -h[0];
    h[2] = 1.0 - 4.0 * u + 3.0 * u2;
    h[3] = 3.0 * u2 - 2.0 * u;
}

#endif
