/* How positions along a ribbon move when the orientations of its nodes turn: the first-order part of
 * uncertainty. */
#include <string.h>

#include "internal.h"
#include "spline.h"

/* What a node does to a point: the derivative by its tangent, which is symmetric (xx yy zz xy xz yz), and the
 * integral of the square of its weight along the curve (x y z). */
#define ENTRY 9

/* One frame of one ribbon as it is integrated, and the parts of the workspace. */
struct tracer {
    size_t nodes;
    const double *s;
    struct factors factors;
    double *tangent;  /* (nodes, 3) */
    double *second;   /* (nodes, 3) of the tangents */
    double *cardinal; /* (nodes, nodes + 2) second derivatives of the spline through 1 at node j, 0 elsewhere:
                         [k][j] */
    double *prefix;   /* (knots + 1, nodes, ENTRY) what node j does up to the knot */
};

size_t ribbon_sensitivity_workspace(size_t nodes) {
    if (nodes < 2 || nodes > RIBBON_NODE_LIMIT)
        return 0;
    return SPLINE_WORKSPACE * nodes + 12 * nodes + nodes * (nodes + 2) + (nodes + 2) * nodes * ENTRY;
}

/* Solves for three nodes at a time, because the spline's solver takes triples. */
static void solve_cardinal(const struct tracer *tracer, double *value, double *second) {
    size_t nodes = tracer->nodes, stride = nodes + 2;
    for (size_t j = 0; j < nodes; j += 3) {
        fill(value, 3 * nodes, 0.0);
        for (size_t d = 0; d < 3 && j + d < nodes; d++)
            value[3 * (j + d) + d] = 1.0;
        spline_second_derivatives(nodes, &tracer->factors, value, second);
        for (size_t k = 0; k < nodes; k++)
            memcpy(tracer->cardinal + stride * k + j, second + 3 * k, 3 * sizeof(double));
    }
}

/* Adds to sum (nodes, ENTRY) what the part u0 to u1 of a piece contributes. With the spline v(s) = sum of
 * w_j(s) t_j and the tangent v / |v|, the derivative of the tangent by t_j is w_j (1 - v v^T / |v|^2) / |v|.
 */
static void add_piece(const struct tracer *tracer, size_t piece, double u0, double u1, double *sum) {
    size_t nodes = tracer->nodes, stride = nodes + 2;
    double h = tracer->factors.h[piece];
    const double *t = tracer->tangent + 3 * piece, *m = tracer->second + 3 * piece;
    const double *c0 = tracer->cardinal + stride * piece, *c1 = c0 + stride;
    struct weights w = spline_weights(u0, u1, h);
    for (size_t i = 0; i < PIECE_POINTS; i++) {
        double v[3];
        for (size_t d = 0; d < 3; d++)
            v[d] = w.a[i] * t[d] + w.b[i] * t[3 + d] + w.c[i] * m[d] + w.d[i] * m[3 + d];
        double square = dot3(v, v);
        if (square == 0.0)
            continue;
        double scale = (u1 - u0) * h * piece_weight[i] / sqrt(square);
        double xx = scale * (1.0 - v[0] * v[0] / square), yy = scale * (1.0 - v[1] * v[1] / square);
        double zz = scale * (1.0 - v[2] * v[2] / square), xy = -scale * v[0] * v[1] / square;
        double xz = -scale * v[0] * v[2] / square, yz = -scale * v[1] * v[2] / square;
        double way = scale / square;
        for (size_t j = 0; j < nodes; j++) {
            double weight = w.c[i] * c0[j] + w.d[i] * c1[j];
            if (j == piece)
                weight += w.a[i];
            if (j == piece + 1)
                weight += w.b[i];
            double *entry = sum + ENTRY * j;
            entry[0] += weight * xx;
            entry[1] += weight * yy;
            entry[2] += weight * zz;
            entry[3] += weight * xy;
            entry[4] += weight * xz;
            entry[5] += weight * yz;
            for (size_t d = 0; d < 3; d++)
                entry[6 + d] += weight * weight * way * v[d];
        }
    }
}

/* From derivatives by tangents to derivatives by rotations: a turn by r moves t by r x t. */
static void by_rotation(size_t nodes, const double *tangent, const double *sum, double *out) {
    for (size_t j = 0; j < nodes; j++) {
        const double *e = sum + ENTRY * j, *t = tangent + 3 * j;
        const double row[3][3] = {{e[0], e[3], e[4]}, {e[3], e[1], e[5]}, {e[4], e[5], e[2]}};
        for (size_t a = 0; a < 3; a++) {
            double *o = out + 9 * j + 3 * a;
            o[0] = row[a][2] * t[1] - row[a][1] * t[2];
            o[1] = row[a][0] * t[2] - row[a][2] * t[0];
            o[2] = row[a][1] * t[0] - row[a][0] * t[1];
        }
    }
}

/* A bridged node turns with the nodes it is filled from: gives them its part, and leaves it its own. */
static void pass_on(size_t nodes, const double *s, const uint8_t *valid, double *out, double *shortening) {
    for (size_t k = 0; k < nodes; k++) {
        if (valid[k])
            continue;
        size_t at[4];
        double weight[4];
        size_t sources = bridge_weights(nodes, s, valid, k, at, weight);
        for (size_t i = 0; i < sources; i++) {
            for (size_t d = 0; d < 9; d++)
                out[9 * at[i] + d] += weight[i] * out[9 * k + d];
            for (size_t d = 0; d < 3; d++)
                shortening[3 * at[i] + d] += weight[i] * weight[i] * shortening[3 * k + d];
        }
    }
}

/* Derivatives up to every knot, for the ribbon whose tangents the tracer holds. */
static void accumulate(const struct tracer *tracer, size_t knots) {
    size_t nodes = tracer->nodes, extra = knots - nodes;
    fill(tracer->prefix, ENTRY * nodes, 0.0);
    for (size_t knot = 1; knot < knots; knot++) {
        double *sum = tracer->prefix + ENTRY * nodes * knot;
        memcpy(sum, sum - ENTRY * nodes, ENTRY * nodes * sizeof(double));
        if (knot == 1 && extra)
            add_piece(tracer, 0, -tracer->s[0] / tracer->factors.h[0], 0.0, sum);
        else
            add_piece(tracer, knot - 1 - extra, 0.0, 1.0, sum);
    }
}

int ribbon_sensitivity(size_t ribbons, size_t nodes, const double *s, const double *q, const uint8_t *valid,
                       size_t count, const double *s_out, double *out, double *shortening,
                       double *workspace) {
    if (!counts_ok(ribbons, nodes))
        return RIBBON_ERROR_COUNT;
    if (!increasing(s, nodes))
        return RIBBON_ERROR_NOT_INCREASING;
    if (!all_within(count, s_out, s[nodes - 1]))
        return RIBBON_ERROR_OUTSIDE;
    for (size_t r = 0; r < ribbons; r++)
        if (valid && !memchr(valid + nodes * r, 1, nodes))
            return RIBBON_ERROR_NO_VALID_NODE;
    size_t knots = ribbon_knot_count(nodes, s), extra = knots - nodes;
    struct tracer tracer = {.nodes = nodes, .s = s, .factors = spline_factorise(nodes, s, workspace)};
    double *value = workspace + SPLINE_WORKSPACE * nodes, *second = value + 3 * nodes;
    tracer.tangent = second + 3 * nodes;
    tracer.second = tracer.tangent + 3 * nodes;
    tracer.cardinal = tracer.second + 3 * nodes;
    tracer.prefix = tracer.cardinal + nodes * (nodes + 2);
    double *sum = tracer.prefix + ENTRY * nodes * knots;
    solve_cardinal(&tracer, value, second);
    for (size_t r = 0; r < ribbons; r++) {
        ribbon_directions(nodes, q + 4 * nodes * r, tracer.tangent, NULL);
        spline_second_derivatives(nodes, &tracer.factors, tracer.tangent, tracer.second);
        accumulate(&tracer, knots);
        for (size_t i = 0; i < count; i++) {
            double *point = out + 9 * nodes * (count * r + i),
                   *way = shortening + 3 * nodes * (count * r + i);
            size_t piece = find_piece(nodes, s, s_out[i]);
            bool before = s_out[i] < s[0];
            double h = tracer.factors.h[piece], from = before ? 0.0 : s[piece];
            memcpy(sum, tracer.prefix + ENTRY * nodes * (before ? 0 : piece + extra),
                   ENTRY * nodes * sizeof(double));
            add_piece(&tracer, piece, (from - s[piece]) / h, (s_out[i] - s[piece]) / h, sum);
            by_rotation(nodes, tracer.tangent, sum, point);
            for (size_t j = 0; j < nodes; j++)
                copy3(way + 3 * j, sum + ENTRY * j + 6);
            if (valid)
                pass_on(nodes, s, valid + nodes * r, point, way);
        }
    }
    return 0;
}
