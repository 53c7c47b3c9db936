/* The paper's frame update: chained cubic Hermite segments of exact arc length and least bending energy. */
#include "internal.h"
#include "tables.h"

/* Chord over length for cosines below 0. Length is convex and increasing in the chord, and the chord shrinks
 * as the turn grows: Newton from the chord at c = 0 comes down to the solution without overshooting. */
static double chord_beyond_right_angle(double c) {
    double m = sqrt(2.0 + 2.0 * c), difference = sqrt(2.0 - 2.0 * c);
    double chord = 0.91;
    for (int iteration = 0; iteration < 30; iteration++) {
        double length = 0.0, slope = 0.0;
        for (size_t i = 0; i < ARC_POINTS; i++) {
            double v = arc_node[i], v2 = v * v;
            double along = m * 0.25 * (1.0 + v2) + (3.0 * chord - m) * 0.5 * (1.0 - v2);
            double across = difference * 0.5 * v;
            double speed = sqrt(along * along + across * across);
            length += arc_weight[i] * speed;
            slope += arc_weight[i] * along / speed * 1.5 * (1.0 - v2);
        }
        double step = (length - 1.0) / slope;
        chord -= step;
        if (fabs(step) < 1e-15)
            break;
    }
    return chord;
}

static inline double gamma_to_right_angle(double c) {
    double y = 1.0 - 2.0 * c;
    double gamma = gamma_power[GAMMA_TERMS - 1];
    for (int i = GAMMA_TERMS - 2; i >= 0; i--)
        gamma = gamma * y + gamma_power[i];
    return gamma;
}

double ribbon_hermite_gamma(double c) {
    c = fmin(1.0, fmax(-1.0, c));
    return c >= 0.0 ? gamma_to_right_angle(c) : chord_beyond_right_angle(c) / sqrt(2.0 + 2.0 * c);
}

/* A unit vector perpendicular to t, away from the axis that is nearest to t. */
static void perpendicular(const double *t, double *out) {
    size_t least = fabs(t[0]) <= fabs(t[1]) ? 0 : 1;
    if (fabs(t[2]) < fabs(t[least]))
        least = 2;
    for (size_t d = 0; d < 3; d++)
        out[d] = (d == least ? 1.0 : 0.0) - t[least] * t[d];
    normalise3(out);
}

/* Adds the chord of a segment that turns by more than 90 degrees; returns 1 if its plane was open, else 0. */
static int wide_chord(double h, double c, const double *t0, const double *t1, double *chord) {
    double bisector[3] = {t0[0] + t1[0], t0[1] + t1[1], t0[2] + t1[2]};
    double m = sqrt(dot3(bisector, bisector));
    /* Below this the sum of two rounded unit vectors has no direction left. */
    int open = m < 1e-15;
    if (open) {
        perpendicular(t0, bisector);
        m = 1.0;
    }
    double scale = h * chord_beyond_right_angle(fmax(-1.0, c)) / m;
    for (size_t d = 0; d < 3; d++)
        chord[d] = scale * bisector[d];
    return open;
}

/* Tangent at s = 0 from the first nodes beyond it. */
static void anchor_tangent(size_t nodes, const double *s, const double *tangent, double *out) {
    size_t count = nodes < 3 ? nodes : 3;
    fill(out, 3, 0.0);
    for (size_t i = 0; i < count; i++) {
        double weight = 1.0;
        for (size_t j = 0; j < count; j++)
            if (j != i)
                weight *= s[j] / (s[j] - s[i]);
        for (size_t d = 0; d < 3; d++)
            out[d] += weight * tangent[3 * i + d];
    }
    normalise3(out);
}

/* Chains the segments between knots, the first of them at s = 0, the others at `s`; returns the number of
 * turns whose plane was open. */
static int chain(size_t knots, const double *s, const double *tangent, double *position) {
    int open = 0;
    double p[3] = {0.0, 0.0, 0.0};
    double before = 0.0;
    copy3(position, p);
    for (size_t k = 1; k < knots; k++) {
        const double *t0 = tangent + 3 * (k - 1), *t1 = tangent + 3 * k;
        double h = s[k - 1] - before;
        double c = dot3(t0, t1);
        if (c < 0.0) {
            double chord[3];
            open += wide_chord(h, c, t0, t1, chord);
            p[0] += chord[0];
            p[1] += chord[1];
            p[2] += chord[2];
        } else {
            double scale = h * gamma_to_right_angle(c);
            p[0] += scale * (t0[0] + t1[0]);
            p[1] += scale * (t0[1] + t1[1]);
            p[2] += scale * (t0[2] + t1[2]);
        }
        copy3(position + 3 * k, p);
        before = s[k - 1];
    }
    return open;
}

int ribbon_hermite_update(size_t ribbons, size_t nodes, const double *s, const double *tangent,
                          double *position, double *knot_tangent) {
    if (!counts_ok(ribbons, nodes))
        return RIBBON_ERROR_COUNT;
    if (!increasing(s, nodes))
        return RIBBON_ERROR_NOT_INCREASING;
    size_t knots = ribbon_knot_count(nodes, s), extra = knots - nodes;
    int open = 0;
    for (size_t r = 0; r < ribbons; r++) {
        const double *t = tangent + 3 * nodes * r;
        double *kt = knot_tangent + 3 * knots * r;
        if (extra)
            anchor_tangent(nodes, s, t, kt);
        for (size_t i = 0; i < 3 * nodes; i++)
            kt[3 * extra + i] = t[i];
        open += chain(knots, extra ? s : s + 1, kt, position + 3 * knots * r);
    }
    return open;
}

int ribbon_hermite_points(size_t ribbons, size_t nodes, const double *s, const double *position,
                          const double *knot_tangent, size_t count, const double *s_out, double *out) {
    if (!counts_ok(ribbons, nodes))
        return RIBBON_ERROR_COUNT;
    if (!increasing(s, nodes))
        return RIBBON_ERROR_NOT_INCREASING;
    if (!all_within(count, s_out, s[nodes - 1]))
        return RIBBON_ERROR_OUTSIDE;
    size_t knots = ribbon_knot_count(nodes, s), extra = knots - nodes;
    for (size_t i = 0; i < count; i++) {
        /* Segment between knots k and k + 1, and the arc lengths of both. */
        bool before = s_out[i] < s[0];
        size_t piece = find_piece(nodes, s, s_out[i]), k = before ? 0 : piece + extra;
        double s0 = before ? 0.0 : s[piece], length = (before ? s[0] : s[piece + 1]) - s0;
        double h[4];
        hermite_basis((s_out[i] - s0) / length, h);
        for (size_t r = 0; r < ribbons; r++) {
            const double *p = position + 3 * (knots * r + k), *t = knot_tangent + 3 * (knots * r + k);
            double *o = out + 3 * (count * r + i);
            for (size_t d = 0; d < 3; d++)
                o[d] = h[0] * p[d] + h[1] * p[3 + d] + length * (h[2] * t[d] + h[3] * t[3 + d]);
        }
    }
    return 0;
}
