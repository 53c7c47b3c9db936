/* The default method: a cubic spline of the tangents, normalised and integrated, so that length is exact. */
#include "spline.h"

#include "internal.h"

struct factors spline_factorise(size_t nodes, const double *s, double *workspace) {
    struct factors f = {workspace, workspace + nodes, workspace + 2 * nodes, workspace + 3 * nodes,
                        workspace + 4 * nodes};
    for (size_t k = 0; k + 1 < nodes; k++) {
        f.h[k] = s[k + 1] - s[k];
        f.inv_h[k] = 1.0 / f.h[k];
    }
    for (size_t k = 1; k + 1 < nodes; k++) {
        double before = f.h[k - 1], after = f.h[k];
        double below = before, diagonal = 2.0 * (before + after), above = after;
        if (nodes == 3) {
            /* Not-a-knot at both ends leaves one parabola: all second derivatives are equal. */
            diagonal = 3.0 * (before + after);
            below = above = 0.0;
        } else if (k == 1) {
            diagonal += before * (1.0 + before / after);
            above -= before * before / after;
            below = 0.0;
        }
        if (nodes > 3 && k + 2 == nodes) {
            diagonal += after * (1.0 + after / before);
            below -= after * after / before;
            above = 0.0;
        }
        f.lower[k] = k > 1 ? below * f.inv_diag[k - 1] : 0.0;
        f.upper[k] = above;
        f.inv_diag[k] = 1.0 / (diagonal - f.lower[k] * (k > 1 ? f.upper[k - 1] : 0.0));
    }
    return f;
}

void spline_second_derivatives(size_t nodes, const struct factors *f, const double *value, double *second) {
    if (nodes == 2) {
        fill(second, 6, 0.0);
        return;
    }
    double slope[3], right[3] = {0.0, 0.0, 0.0};
    for (size_t d = 0; d < 3; d++)
        slope[d] = (value[3 + d] - value[d]) * f->inv_h[0];
    for (size_t k = 1; k + 1 < nodes; k++)
        for (size_t d = 0; d < 3; d++) {
            double next = (value[3 * k + 3 + d] - value[3 * k + d]) * f->inv_h[k];
            right[d] = 6.0 * (next - slope[d]) - f->lower[k] * right[d];
            slope[d] = next;
            second[3 * k + d] = right[d];
        }
    double after[3] = {0.0, 0.0, 0.0};
    for (size_t k = nodes - 2; k >= 1; k--)
        for (size_t d = 0; d < 3; d++)
            second[3 * k + d] = after[d] = (second[3 * k + d] - f->upper[k] * after[d]) * f->inv_diag[k];
    if (nodes == 3) {
        copy3(second, second + 3);
        copy3(second + 6, second + 3);
        return;
    }
    size_t last = nodes - 1;
    double first_ratio = f->h[0] * f->inv_h[1], last_ratio = f->h[last - 1] * f->inv_h[last - 2];
    for (size_t d = 0; d < 3; d++) {
        second[d] = second[3 + d] + first_ratio * (second[3 + d] - second[6 + d]);
        second[3 * last + d] =
            second[3 * last - 3 + d] + last_ratio * (second[3 * last - 3 + d] - second[3 * last - 6 + d]);
    }
}

void spline_slopes(size_t nodes, const struct factors *f, const double *value, const double *second,
                   double *slope) {
    for (size_t k = 0; k < nodes; k++) {
        /* The last node is the end of the piece before it, every other the start of the one after it. */
        size_t piece = k + 1 < nodes ? k : k - 1;
        double own = k + 1 < nodes ? -2.0 : 1.0, other = k + 1 < nodes ? -1.0 : 2.0;
        for (size_t d = 0; d < 3; d++) {
            size_t i = 3 * piece + d;
            slope[3 * k + d] = (value[i + 3] - value[i]) * f->inv_h[piece] +
                               (own * second[i] + other * second[i + 3]) * f->h[piece] / 6.0;
        }
    }
}

struct weights spline_weights(double u0, double u1, double h) {
    struct weights w;
    for (size_t i = 0; i < PIECE_POINTS; i++) {
        double b = u0 + (u1 - u0) * piece_node[i], a = 1.0 - b;
        w.a[i] = a;
        w.b[i] = b;
        w.c[i] = (a * a * a - a) * h * h / 6.0;
        w.d[i] = (b * b * b - b) * h * h / 6.0;
    }
    return w;
}

/* Integral over the arc length `length` of the normalised spline whose Gauss points have the weights w. Where
 * the spline is zero, which exactly opposite tangents can make it, it has no direction and adds nothing. */
static inline void integrate(const struct weights *w, double length, const double *t, const double *m,
                             double *p) {
    double v[3][PIECE_POINTS], scale[PIECE_POINTS];
    for (size_t d = 0; d < 3; d++)
        for (size_t i = 0; i < PIECE_POINTS; i++)
            v[d][i] = w->a[i] * t[d] + w->b[i] * t[3 + d] + w->c[i] * m[d] + w->d[i] * m[3 + d];
    for (size_t i = 0; i < PIECE_POINTS; i++) {
        double square = v[0][i] * v[0][i] + v[1][i] * v[1][i] + v[2][i] * v[2][i];
        scale[i] = square == 0.0 ? 0.0 : length * piece_weight[i] / sqrt(square);
    }
    for (size_t d = 0; d < 3; d++)
        for (size_t i = 0; i < PIECE_POINTS; i++)
            p[d] += scale[i] * v[d][i];
}

int ribbon_spline_update(size_t ribbons, size_t nodes, const double *s, const double *tangent,
                         double *position, double *second, double *workspace) {
    if (!counts_ok(ribbons, nodes))
        return RIBBON_ERROR_COUNT;
    if (!increasing(s, nodes))
        return RIBBON_ERROR_NOT_INCREASING;
    struct factors f = spline_factorise(nodes, s, workspace);
    struct weights unit = spline_weights(0.0, 1.0, 1.0);
    struct weights before = spline_weights(-s[0] * f.inv_h[0], 0.0, f.h[0]);
    for (size_t r = 0; r < ribbons; r++) {
        const double *t = tangent + 3 * nodes * r;
        double *m = second + 3 * nodes * r;
        double p[3] = {0.0, 0.0, 0.0};
        spline_second_derivatives(nodes, &f, t, m);
        copy3(position, p);
        position += 3;
        if (s[0] > 0.0) {
            integrate(&before, s[0], t, m, p);
            copy3(position, p);
            position += 3;
        }
        for (size_t k = 0; k + 1 < nodes; k++) {
            double square = f.h[k] * f.h[k];
            double scaled[6];
            for (size_t d = 0; d < 6; d++)
                scaled[d] = square * m[3 * k + d];
            integrate(&unit, f.h[k], t + 3 * k, scaled, p);
            copy3(position, p);
            position += 3;
        }
    }
    return 0;
}

int ribbon_spline_points(size_t ribbons, size_t nodes, const double *s, const double *tangent,
                         const double *position, const double *second, size_t count, const double *s_out,
                         double *out) {
    if (!counts_ok(ribbons, nodes))
        return RIBBON_ERROR_COUNT;
    if (!increasing(s, nodes))
        return RIBBON_ERROR_NOT_INCREASING;
    if (!all_within(count, s_out, s[nodes - 1]))
        return RIBBON_ERROR_OUTSIDE;
    size_t knots = ribbon_knot_count(nodes, s), extra = knots - nodes;
    for (size_t i = 0; i < count; i++) {
        /* Piece k of the spline; before the first node it continues piece 0 and starts from the anchor. */
        size_t k = find_piece(nodes, s, s_out[i]);
        bool before = s_out[i] < s[0];
        double h = s[k + 1] - s[k], from = before ? 0.0 : s[k];
        struct weights w = spline_weights((from - s[k]) / h, (s_out[i] - s[k]) / h, h);
        for (size_t r = 0; r < ribbons; r++) {
            double *o = out + 3 * (count * r + i);
            size_t node = 3 * (nodes * r + k);
            copy3(o, position + 3 * (knots * r + (before ? 0 : k + extra)));
            integrate(&w, s_out[i] - from, tangent + node, second + node, o);
        }
    }
    return 0;
}

/* Curvature and torsion of the curve whose tangent is v / |v|, from v and its first two derivatives. */
static void bend(const double *v, const double *v1, const double *v2, double *curvature, double *torsion) {
    double cross[3] = {v[1] * v1[2] - v[2] * v1[1], v[2] * v1[0] - v[0] * v1[2], v[0] * v1[1] - v[1] * v1[0]};
    double square = dot3(v, v), turning = dot3(cross, cross);
    *curvature = sqrt(turning) / square;
    *torsion = turning > 0.0 ? dot3(cross, v2) * sqrt(square) / turning : 0.0;
}

int ribbon_curvature(size_t ribbons, size_t nodes, const double *s, const double *tangent,
                     const double *second, double *curvature, double *torsion) {
    if (!counts_ok(ribbons, nodes))
        return RIBBON_ERROR_COUNT;
    if (!increasing(s, nodes))
        return RIBBON_ERROR_NOT_INCREASING;
    for (size_t r = 0; r < ribbons; r++) {
        const double *t = tangent + 3 * nodes * r, *m = second + 3 * nodes * r;
        for (size_t i = 0; i + 1 < 2 * nodes; i++) {
            size_t k = i / 2 < nodes - 1 ? i / 2 : nodes - 2;
            double h = s[k + 1] - s[k], b = 0.5 * (double)(i - 2 * k), a = 1.0 - b;
            double v[3], v1[3], v2[3];
            for (size_t d = 0; d < 3; d++) {
                double t0 = t[3 * k + d], t1 = t[3 * k + 3 + d], m0 = m[3 * k + d], m1 = m[3 * k + 3 + d];
                v[d] = a * t0 + b * t1 + ((a * a * a - a) * m0 + (b * b * b - b) * m1) * h * h / 6.0;
                v1[d] = (t1 - t0) / h + ((1.0 - 3.0 * a * a) * m0 + (3.0 * b * b - 1.0) * m1) * h / 6.0;
                v2[d] = a * m0 + b * m1;
            }
            size_t at = (2 * nodes - 1) * r + i;
            bend(v, v1, v2, curvature + at, torsion + at);
        }
    }
    return 0;
}
