/* The surface between ribbons: transversals across them and the bicubic patches of the net they form. */
#include <string.h>

#include "internal.h"

/* Equations of one row of transversals: lower[j] l[j-1] + diagonal[j] l[j] + upper[j] l[j+1] = pull[j]. */
struct row {
    double *lower, *diagonal, *upper, *pull, *sweep_upper, *sweep_pull;
};

/* With segment width w, chord D and directions b0, b1 the bending energy of a segment is
 * (4/w)(l0^2 + l0 l1 b0.b1 + l1^2) - (12/w^2) D.(l0 b0 + l1 b1) + const. */
static void assemble_row(size_t ribbons, size_t nodes, const double *start, const double *position,
                         const double *direction, const struct row *row) {
    fill(row->lower, 4 * ribbons, 0.0); /* lower, diagonal, upper and pull are neighbours in the workspace */
    for (size_t j = 0; j + 1 < ribbons; j++) {
        const double *p0 = position + 3 * nodes * j, *p1 = p0 + 3 * nodes;
        const double *b0 = direction + 3 * nodes * j, *b1 = b0 + 3 * nodes;
        double chord[3] = {p1[0] - p0[0], p1[1] - p0[1], p1[2] - p0[2]};
        double w = 1.0 / (start[j + 1] - start[j]);
        row->diagonal[j] += 8.0 * w;
        row->diagonal[j + 1] += 8.0 * w;
        row->upper[j] = row->lower[j + 1] = 4.0 * w * dot3(b0, b1);
        row->pull[j] += 12.0 * w * w * dot3(chord, b0);
        row->pull[j + 1] += 12.0 * w * w * dot3(chord, b1);
    }
}

/* The equations are diagonally dominant: elimination without pivoting is safe. */
static void solve_row(size_t ribbons, size_t nodes, const struct row *row, double *lambda) {
    double upper = 0.0, pull = 0.0;
    for (size_t j = 0; j < ribbons; j++) {
        double scale = 1.0 / (row->diagonal[j] - row->lower[j] * upper);
        pull = (row->pull[j] - row->lower[j] * pull) * scale;
        upper = row->upper[j] * scale;
        row->sweep_pull[j] = pull;
        row->sweep_upper[j] = upper;
    }
    double next = 0.0;
    for (size_t j = ribbons; j-- > 0;)
        lambda[nodes * j] = next = row->sweep_pull[j] - row->sweep_upper[j] * next;
}

/* Holds what came out too small; returns how many. A held lambda stays held: its equation gives it exactly.
 */
static int hold_small(size_t ribbons, size_t nodes, const struct row *row, const double *lambda) {
    int held = 0;
    for (size_t j = 0; j < ribbons; j++) {
        if (!(lambda[nodes * j] < RIBBON_LAMBDA_MIN))
            continue;
        row->lower[j] = row->upper[j] = 0.0;
        row->diagonal[j] = 1.0;
        row->pull[j] = RIBBON_LAMBDA_MIN;
        held++;
    }
    return held;
}

int ribbon_transversals(size_t ribbons, size_t nodes, const double *start, const double *position,
                        const double *direction, double *lambda, double *workspace) {
    if (!counts_ok(ribbons, nodes) || ribbons < 2)
        return RIBBON_ERROR_COUNT;
    if (!increasing(start, ribbons))
        return RIBBON_ERROR_NOT_INCREASING;
    struct row row = {workspace,
                      workspace + ribbons,
                      workspace + 2 * ribbons,
                      workspace + 3 * ribbons,
                      workspace + 4 * ribbons,
                      workspace + 5 * ribbons};
    int held = 0;
    for (size_t k = 0; k < nodes; k++) {
        assemble_row(ribbons, nodes, start, position + 3 * k, direction + 3 * k, &row);
        int more;
        do {
            solve_row(ribbons, nodes, &row, lambda + k);
            more = hold_small(ribbons, nodes, &row, lambda + k);
            held += more;
        } while (more);
    }
    return held;
}

/* Vertices that are worked on at once: loops over a multiple of it, one number for each vertex, become vector
 * code. */
#define LANES 4

/* Cubic Hermite basis and its slope along one side of a patch, once by vertex and once by function. Single
 * precision is what the vertices are wanted in; the ends of the sides are exact in it, so patches meet
 * exactly. */
struct basis {
    float value[RIBBON_PATCH_VERTEX_LIMIT][4];
    float slope[RIBBON_PATCH_VERTEX_LIMIT][4];
    float value_lane[4][RIBBON_PATCH_VERTEX_LIMIT];
    float slope_lane[4][RIBBON_PATCH_VERTEX_LIMIT];
};

static void tabulate(size_t side, struct basis *basis) {
    memset(basis, 0, sizeof *basis);
    for (size_t i = 0; i < side; i++) {
        double u = (double)i / (double)(side - 1), value[4], slope[4];
        hermite_basis(u, value);
        hermite_basis_slope(u, slope);
        for (size_t f = 0; f < 4; f++) {
            basis->value[i][f] = basis->value_lane[f][i] = (float)value[f];
            basis->slope[i][f] = basis->slope_lane[f][i] = (float)slope[f];
        }
    }
}

/* Coordinates and slopes below this (metres, metres a metre) are rounding. As zeros they keep the squares in
 * a flat surface's normals from being denormal numbers, with which a patch takes three times as long. */
static const double ROUNDING = 1e-12;

static inline float corner_value(double value) {
    return fabs(value) < ROUNDING ? 0.0f : (float)value;
}

/* One coordinate of a patch: g[along][across], each start, end, derivative at start, derivative at end. */
static void gather(size_t nodes, double ds, double dt, const double *position, const double *tangent,
                   const double *transversal, const double *twist, float g[4][4]) {
    for (size_t a = 0; a < 2; a++)
        for (size_t b = 0; b < 2; b++) {
            size_t i = 3 * (nodes * b + a);
            g[a][b] = corner_value(position[i]);
            g[2 + a][b] = corner_value(ds * tangent[i]);
            g[a][2 + b] = corner_value(dt * transversal[i]);
            g[2 + a][2 + b] = twist ? corner_value(ds * dt * twist[i]) : 0.0f;
        }
}

/* The curve across a patch at one vertex along it: coefficients of its points and of their derivative along.
 */
struct line {
    float point[3][4], along[3][4];
};

/* restrict and the result in place are worth a tenth of the whole surface. */
static inline void line_across(const struct basis *basis, const float g[3][4][4], size_t vertex,
                               struct line *restrict line) {
    const float *value = basis->value[vertex], *slope = basis->slope[vertex];
    for (size_t d = 0; d < 3; d++)
        for (size_t f = 0; f < 4; f++) {
            line->point[d][f] =
                value[0] * g[d][0][f] + value[1] * g[d][1][f] + value[2] * g[d][2][f] + value[3] * g[d][3][f];
            line->along[d][f] =
                slope[1] * (g[d][1][f] - g[d][0][f]) + slope[2] * g[d][2][f] + slope[3] * g[d][3][f];
        }
}

/* The derivative; those of the two values are opposite. */
static inline void combine_slope(size_t lanes, const float basis[4][RIBBON_PATCH_VERTEX_LIMIT],
                                 const float *c, float *restrict out) {
    float step = c[1] - c[0];
    for (size_t i = 0; i < lanes; i++)
        out[i] = basis[1][i] * step + basis[2][i] * c[2] + basis[3][i] * c[3];
}

static inline void combine(size_t lanes, const float basis[4][RIBBON_PATCH_VERTEX_LIMIT], const float *c,
                           float *restrict out) {
    for (size_t i = 0; i < lanes; i++)
        out[i] = basis[0][i] * c[0] + basis[1][i] * c[1] + basis[2][i] * c[2] + basis[3][i] * c[3];
}

/* Coordinates in rows to points. In blocks that are written out, because a compiler turns those into vector
 * code. */
static inline void interleave(size_t side, float rows[3][RIBBON_PATCH_VERTEX_LIMIT], float *restrict out) {
    const float *x = rows[0], *y = rows[1], *z = rows[2];
    size_t i = 0;
    for (; i + LANES <= side; i += LANES) {
        out[0] = x[i], out[1] = y[i], out[2] = z[i];
        out[3] = x[i + 1], out[4] = y[i + 1], out[5] = z[i + 1];
        out[6] = x[i + 2], out[7] = y[i + 2], out[8] = z[i + 2];
        out[9] = x[i + 3], out[10] = y[i + 3], out[11] = z[i + 3];
        out += 3 * LANES;
    }
    for (; i < side; i++, out += 3)
        out[0] = x[i], out[1] = y[i], out[2] = z[i];
}

/* The vertices of a line and their normals. */
static void put_vertices(size_t side, const struct basis *basis, const struct line *line, float facing,
                         float *vertices, float *normals) {
    float p[3][RIBBON_PATCH_VERTEX_LIMIT], u[3][RIBBON_PATCH_VERTEX_LIMIT], v[3][RIBBON_PATCH_VERTEX_LIMIT];
    float n[3][RIBBON_PATCH_VERTEX_LIMIT];
    size_t lanes = (side + LANES - 1) / LANES * LANES;
    for (size_t d = 0; d < 3; d++) {
        combine(lanes, basis->value_lane, line->point[d], p[d]);
        combine(lanes, basis->value_lane, line->along[d], u[d]);
        combine_slope(lanes, basis->slope_lane, line->point[d], v[d]);
    }
    for (size_t i = 0; i < lanes; i++) {
        float x = u[1][i] * v[2][i] - u[2][i] * v[1][i];
        float y = u[2][i] * v[0][i] - u[0][i] * v[2][i];
        float z = u[0][i] * v[1][i] - u[1][i] * v[0][i];
        float square = x * x + y * y + z * z;
        float scale = square == 0.0f ? 0.0f : facing / sqrtf(square);
        n[0][i] = x * scale;
        n[1][i] = y * scale;
        n[2][i] = z * scale;
    }
    interleave(side, p, vertices);
    interleave(side, n, normals);
}

int ribbon_patches(size_t ribbons, size_t nodes, const double *s, const double *start, const double *position,
                   const double *tangent, const double *transversal, const double *twist, size_t side,
                   double facing, float *vertices, float *normals) {
    if (!counts_ok(ribbons, nodes) || ribbons < 2 || side < 2 || side > RIBBON_PATCH_VERTEX_LIMIT)
        return RIBBON_ERROR_COUNT;
    if (!increasing(s, nodes) || !increasing(start, ribbons))
        return RIBBON_ERROR_NOT_INCREASING;
    struct basis basis;
    tabulate(side, &basis);
    for (size_t j = 0; j + 1 < ribbons; j++)
        for (size_t k = 0; k + 1 < nodes; k++) {
            size_t corner = 3 * (nodes * j + k);
            float g[3][4][4];
            for (size_t d = 0; d < 3; d++)
                gather(nodes, s[k + 1] - s[k], start[j + 1] - start[j], position + corner + d,
                       tangent + corner + d, transversal + corner + d, twist ? twist + corner + d : NULL,
                       g[d]);
            for (size_t a = 0; a < side; a++) {
                struct line line;
                line_across(&basis, g, a, &line);
                put_vertices(side, &basis, &line, (float)facing, vertices, normals);
                vertices += 3 * side;
                normals += 3 * side;
            }
        }
    return 0;
}
