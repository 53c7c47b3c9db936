/* Calls every function of the C solver on odd sizes and odd values, with exactly as much memory as it may
 * use; built with sanitizers, which end the program at the first access or operation that is not defined. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "ribbon_native.h"

static unsigned seed = 1;

static double random_number(void) {
    seed = seed * 1103515245u + 12345u;
    return (double)(seed >> 8) / (double)(1u << 24) - 0.5;
}

static double *numbers(size_t count) {
    double *out = malloc(count * sizeof *out);
    for (size_t i = 0; i < count; i++)
        out[i] = random_number();
    return out;
}

static double *units(size_t count, size_t dimension) {
    double *out = numbers(count * dimension);
    for (size_t i = 0; i < count; i++) {
        double square = 0.0;
        for (size_t d = 0; d < dimension; d++)
            square += out[dimension * i + d] * out[dimension * i + d];
        for (size_t d = 0; d < dimension; d++)
            out[dimension * i + d] /= sqrt(square);
    }
    return out;
}

static double *growing(size_t count, double first) {
    double *out = malloc(count * sizeof *out);
    for (size_t i = 0; i < count; i++)
        out[i] = i ? out[i - 1] + 0.01 + 0.1 * fabs(random_number()) : first;
    return out;
}

static uint8_t *flags(size_t count) {
    uint8_t *out = malloc(count);
    for (size_t i = 0; i < count; i++)
        out[i] = random_number() > -0.2;
    return out;
}

static void expect(int code, int least, const char *what) {
    if (code < least) {
        fprintf(stderr, "%s returned %d\n", what, code);
        exit(1);
    }
}

static void drive_curves(size_t ribbons, size_t nodes, double first) {
    double *s = growing(nodes, first), *q = units(ribbons * nodes, 4), *t = numbers(3 * ribbons * nodes);
    size_t knots = ribbon_knot_count(nodes, s), count = 5;
    uint8_t *valid = flags(ribbons * nodes);
    double *bridged = numbers(4 * ribbons * nodes), *spread = numbers(ribbons * nodes);
    double *binormal = numbers(3 * ribbons * nodes), *position = numbers(3 * ribbons * knots);
    double *knot_tangent = numbers(3 * ribbons * knots), *shape = numbers(3 * ribbons * nodes);
    double *workspace5 = numbers(5 * nodes), *workspace4 = numbers(4 * nodes),
           *out = numbers(3 * ribbons * count);
    double at[5] = {0.0, s[0] / 2, s[0], (s[0] + s[nodes - 1]) / 2, s[nodes - 1]};
    for (size_t r = 0; r < ribbons; r++)
        valid[nodes * r + r % nodes] = 1;
    expect(ribbon_bridge(ribbons, nodes, s, q, valid, bridged, spread), 0, "bridge");
    ribbon_directions(ribbons * nodes, bridged, t, binormal);
    expect(ribbon_check_directions(ribbons * nodes, t), 0, "check");
    expect(ribbon_hermite_update(ribbons, nodes, s, t, position, knot_tangent), 0, "hermite update");
    expect(ribbon_hermite_points(ribbons, nodes, s, position, knot_tangent, count, at, out), 0,
           "hermite points");
    expect(ribbon_spherical_update(ribbons, nodes, s, t, position, shape, workspace4), 0, "spherical update");
    expect(ribbon_spherical_points(ribbons, nodes, s, t, position, shape, count, at, out), 0,
           "spherical points");
    expect(ribbon_spline_update(ribbons, nodes, s, t, position, shape, workspace5), 0, "spline update");
    expect(ribbon_spline_points(ribbons, nodes, s, t, position, shape, count, at, out), 0, "spline points");
    double *curvature = numbers(ribbons * (2 * nodes - 1)), *torsion = numbers(ribbons * (2 * nodes - 1));
    expect(ribbon_curvature(ribbons, nodes, s, t, shape, curvature, torsion), 0, "curvature");
    double *first_order = numbers(9 * ribbons * count * nodes),
           *second_order = numbers(3 * ribbons * count * nodes);
    double *workspace = numbers(ribbon_sensitivity_workspace(nodes));
    expect(ribbon_sensitivity(ribbons, nodes, s, bridged, valid, count, at, first_order, second_order,
                              workspace),
           0, "sensitivity");
    double *times = growing(3, 0.0), *turning = units(3 * ribbons * nodes, 4);
    double *state = malloc(ribbons * nodes * RIBBON_SMOOTH_STATE * sizeof *state);
    for (size_t i = 0; i < ribbons * nodes * RIBBON_SMOOTH_STATE; i++)
        state[i] = NAN;
    uint8_t *often = flags(3 * ribbons * nodes);
    double *smooth = numbers(4 * 3 * ribbons * nodes);
    expect(ribbon_smooth(3, ribbons * nodes, times, 0.01, turning, often, state, smooth), 0, "smooth");
    void *all[] = {
        s,     q,          t,          valid, bridged,   spread,  binormal,    position,     knot_tangent,
        shape, workspace5, workspace4, out,   curvature, torsion, first_order, second_order, workspace,
        times, turning,    state,      often, smooth};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        free(all[i]);
}

static void drive_comb(size_t frames, size_t ribbons, size_t nodes, size_t side, int method, int twist,
                       int patches) {
    size_t all = (ribbons + 1) * nodes, own = ribbons * nodes;
    size_t mesh = (ribbons - 1) * (nodes - 1) * side * side * 3;
    double *s = growing(nodes, 0.02), *start = malloc(ribbons * sizeof *start);
    for (size_t j = 0; j < ribbons; j++)
        start[j] = s[nodes - 1] * (double)j / (double)(ribbons - 1);
    struct ribbon_comb comb = {ribbons, nodes, side, method, twist, s, start};
    double *q = units(frames * all, 4), *workspace = numbers(ribbon_comb_workspace(&comb));
    uint8_t *valid = flags(frames * all);
    for (size_t k = 0; k < nodes; k++)
        valid[nodes * (1 + frames % ribbons) + k] = 0;
    struct ribbon_comb_frame out = {
        .anchor = numbers(frames * 3 * (ribbons + 1)),
        .node = numbers(frames * 3 * all),
        .tangent = numbers(frames * 3 * all),
        .along = numbers(frames * 3 * own),
        .transversal = numbers(frames * 3 * own),
        .twist = numbers(frames * 3 * own),
        .lambda = numbers(frames * own),
        .vertices = patches ? malloc(frames * mesh * sizeof(float)) : NULL,
        .normals = patches ? malloc(frames * mesh * sizeof(float)) : NULL,
        .ribbon_valid = malloc(frames * (ribbons + 1)),
        .held = malloc(frames * sizeof(int32_t)),
    };
    expect(ribbon_comb_frames(&comb, frames, q, valid, &out, workspace), 0, "comb frames");
    expect(ribbon_comb_frames(&comb, frames, q, NULL, &out, workspace), 0, "comb frames, all valid");
    for (size_t i = 0; i < frames * all; i++)
        valid[i] = 0;
    expect(ribbon_comb_frames(&comb, frames, q, valid, &out, workspace), 0, "comb frames, none valid");
    void *memory[] = {s,
                      start,
                      q,
                      workspace,
                      valid,
                      out.anchor,
                      out.node,
                      out.tangent,
                      out.along,
                      out.transversal,
                      out.twist,
                      out.lambda,
                      out.vertices,
                      out.normals,
                      out.ribbon_valid,
                      out.held};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++)
        free(memory[i]);
}

int main(void) {
    const size_t nodes[] = {2, 3, 4, 5, 16, 33};
    for (size_t i = 0; i < sizeof nodes / sizeof *nodes; i++) {
        drive_curves(1, nodes[i], 0.0);
        drive_curves(3, nodes[i], 0.02);
        for (int method = RIBBON_METHOD_HERMITE; method <= RIBBON_METHOD_SPLINE; method++)
            for (int twist = RIBBON_TWIST_ZERO; twist <= RIBBON_TWIST_MEASURED; twist++) {
                drive_comb(1, 2, nodes[i], 2, method, twist, 1);
                drive_comb(2, 5, nodes[i], 5, method, twist, 1);
                drive_comb(2, 3, nodes[i], RIBBON_PATCH_VERTEX_LIMIT, method, twist, i == 0);
            }
    }
    for (int i = -1000; i <= 1000; i++)
        if (!(ribbon_hermite_gamma(i / 1000.0) >= 0.5 - 1e-12))
            return 1;
    return 0;
}
