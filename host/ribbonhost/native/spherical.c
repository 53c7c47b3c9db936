/* The paper's start: tangents by a cubic spline on the unit sphere (De Casteljau with slerp), integrated. */
#include "internal.h"
#include "tables.h"

#define POLYGON_ITERATIONS 60

/* Point at parameter u of the great circle through a (0) and b (1); NaN where they are exactly opposite. */
static void slerp(const double *a, const double *b, double u, double *out) {
    double cross[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    double sine = sqrt(dot3(cross, cross));
    double angle = atan2(sine, dot3(a, b));
    double wa = 1.0 - u, wb = u;
    if (angle > 1e-8) {
        wa = sin(wa * angle) / sine;
        wb = sin(wb * angle) / sine;
    }
    for (size_t d = 0; d < 3; d++)
        out[d] = wa * a[d] + wb * b[d];
}

/* Length of a piece; 0 outside the ribbon, where the knots of the spline fall together. */
static double piece_length(size_t nodes, const double *s, ptrdiff_t piece) {
    return piece < 0 || piece + 1 >= (ptrdiff_t)nodes ? 0.0 : s[piece + 1] - s[piece];
}

/* Inner Bezier points of a piece: both on the arc between two points of the control polygon. */
static void inner_points(size_t nodes, const double *s, const double *control, size_t piece, double *first,
                         double *second) {
    ptrdiff_t k = (ptrdiff_t)piece;
    double before = piece_length(nodes, s, k - 1), h = piece_length(nodes, s, k);
    double sum = before + h + piece_length(nodes, s, k + 1);
    slerp(control + 3 * piece, control + 3 * piece + 3, before / sum, first);
    slerp(control + 3 * piece, control + 3 * piece + 3, (before + h) / sum, second);
}

/* By how much the control polygon misses at node k. Inside the ribbon: tangent minus point of the spline; at
 * an end, where the spline shall not bend: middle of the tangent and the second inner Bezier point minus the
 * first. */
static void misses(size_t nodes, const double *s, const double *tangent, const double *control, size_t k,
                   double *out) {
    double left[3], right[3], unused[3], made[3];
    const double *t = tangent + 3 * k, *c = control + 3 * k;
    if (k > 0 && k + 1 < nodes) {
        inner_points(nodes, s, control, k - 1, unused, left);
        inner_points(nodes, s, control, k, right, unused);
        slerp(left, right, (s[k] - s[k - 1]) / (s[k + 1] - s[k - 1]), made);
        for (size_t d = 0; d < 3; d++)
            out[d] = t[d] - made[d];
        return;
    }
    if (k == 0)
        inner_points(nodes, s, control, 0, unused, right);
    else
        inner_points(nodes, s, control, k - 1, right, unused);
    slerp(t, right, 0.5, made);
    for (size_t d = 0; d < 3; d++)
        out[d] = made[d] - c[d];
}

/* Row k of the equations for the control points of the same spline in flat space, which the sphere's come
 * close to as the turns become small. */
static void flat_row(size_t nodes, const double *s, size_t k, double *below, double *diagonal,
                     double *above) {
    double h[4];
    for (ptrdiff_t i = 0; i < 4; i++)
        h[i] = piece_length(nodes, s, (ptrdiff_t)k - 2 + i);
    *below = *above = 0.0;
    if (k == 0) {
        *above = -0.5 * h[2] / (h[2] + h[3]);
        *diagonal = 0.5 - *above;
    } else if (k == nodes - 1) {
        *below = -0.5 * h[1] / (h[1] + h[0]);
        *diagonal = 0.5 - *below;
    } else {
        *below = h[2] * h[2] / ((h[0] + h[1] + h[2]) * (h[1] + h[2]));
        *above = h[1] * h[1] / ((h[1] + h[2] + h[3]) * (h[1] + h[2]));
        *diagonal = 1.0 - *below - *above;
    }
}

/* One correction of the control polygon by the flat equations; returns the largest miss before it. */
static double correct(size_t nodes, const double *s, const double *tangent, double *control,
                      double *workspace) {
    double *miss = workspace, *upper = workspace + 3 * nodes;
    double largest = 0.0, upper_before = 0.0;
    for (size_t k = 0; k < nodes; k++) {
        double below, diagonal, above, *m = miss + 3 * k;
        misses(nodes, s, tangent, control, k, m);
        flat_row(nodes, s, k, &below, &diagonal, &above);
        double square = dot3(m, m);
        if (!(square <= largest))
            largest = square;
        double scale = 1.0 / (diagonal - below * upper_before);
        for (size_t d = 0; d < 3; d++)
            m[d] = (m[d] - (k > 0 ? below * miss[3 * k - 3 + d] : 0.0)) * scale;
        upper[k] = upper_before = above * scale;
    }
    double step[3] = {0.0, 0.0, 0.0};
    for (size_t k = nodes; k-- > 0;) {
        for (size_t d = 0; d < 3; d++) {
            step[d] = miss[3 * k + d] - upper[k] * step[d];
            control[3 * k + d] += step[d];
        }
        normalise3(control + 3 * k);
    }
    return sqrt(largest);
}

/* Adds the integral of the spline between parameters u0 and u1 of a piece over the arc length `length`. */
static void integrate(size_t nodes, const double *s, const double *tangent, const double *control,
                      size_t piece, double u0, double u1, double length, double *p) {
    double bezier[4][3];
    copy3(bezier[0], tangent + 3 * piece);
    inner_points(nodes, s, control, piece, bezier[1], bezier[2]);
    copy3(bezier[3], tangent + 3 * piece + 3);
    for (size_t i = 0; i < PIECE_POINTS; i++) {
        double u = u0 + (u1 - u0) * piece_node[i];
        double level[4][3];
        for (size_t j = 0; j < 4; j++)
            copy3(level[j], bezier[j]);
        for (size_t left = 3; left > 0; left--)
            for (size_t j = 0; j < left; j++) {
                double between[3];
                slerp(level[j], level[j + 1], u, between);
                copy3(level[j], between);
            }
        for (size_t d = 0; d < 3; d++)
            p[d] += length * piece_weight[i] * level[0][d];
    }
}

int ribbon_spherical_update(size_t ribbons, size_t nodes, const double *s, const double *tangent,
                            double *position, double *control, double *workspace) {
    if (!counts_ok(ribbons, nodes))
        return RIBBON_ERROR_COUNT;
    if (!increasing(s, nodes))
        return RIBBON_ERROR_NOT_INCREASING;
    int failed = 0;
    for (size_t r = 0; r < ribbons; r++) {
        const double *t = tangent + 3 * nodes * r;
        double *polygon = control + 3 * nodes * r;
        for (size_t i = 0; i < 3 * nodes; i++)
            polygon[i] = t[i];
        double missed = INFINITY;
        for (int i = 0; i < POLYGON_ITERATIONS && missed > 1e-14; i++)
            missed = correct(nodes, s, t, polygon, workspace);
        bool found = missed < 1e-12;
        failed += !found;
        double p[3] = {0.0, 0.0, 0.0};
        if (!found)
            fill(p, 3, NAN);
        copy3(position, p);
        position += 3;
        if (s[0] > 0.0) {
            integrate(nodes, s, t, polygon, 0, -s[0] / (s[1] - s[0]), 0.0, s[0], p);
            copy3(position, p);
            position += 3;
        }
        for (size_t k = 0; k + 1 < nodes; k++) {
            integrate(nodes, s, t, polygon, k, 0.0, 1.0, s[k + 1] - s[k], p);
            copy3(position, p);
            position += 3;
        }
    }
    return failed;
}

int ribbon_spherical_points(size_t ribbons, size_t nodes, const double *s, const double *tangent,
                            const double *position, const double *control, size_t count, const double *s_out,
                            double *out) {
    if (!counts_ok(ribbons, nodes))
        return RIBBON_ERROR_COUNT;
    if (!increasing(s, nodes))
        return RIBBON_ERROR_NOT_INCREASING;
    if (!all_within(count, s_out, s[nodes - 1]))
        return RIBBON_ERROR_OUTSIDE;
    size_t knots = ribbon_knot_count(nodes, s), extra = knots - nodes;
    for (size_t i = 0; i < count; i++) {
        size_t k = find_piece(nodes, s, s_out[i]);
        bool before = s_out[i] < s[0];
        double h = s[k + 1] - s[k], from = before ? 0.0 : s[k];
        for (size_t r = 0; r < ribbons; r++) {
            double *o = out + 3 * (count * r + i);
            copy3(o, position + 3 * (knots * r + (before ? 0 : k + extra)));
            integrate(nodes, s, tangent + 3 * nodes * r, control + 3 * nodes * r, k, (from - s[k]) / h,
                      (s_out[i] - s[k]) / h, s_out[i] - from, o);
        }
    }
    return 0;
}
