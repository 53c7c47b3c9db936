/* One frame of a comb: from the orientations of all nodes to curves in place and the surface between them. */
#include <string.h>

#include "internal.h"
#include "spline.h"

/* Parts of the caller's workspace. "Packed" arrays hold the present ribbons only, without gaps. */
struct parts {
    double *q;            /* (ribbons + 1, nodes, 4) bridged */
    double *binormal;     /* (ribbons + 1, nodes, 3) */
    double *knot;         /* (ribbons + 1, knots, 3) */
    double *knot_tangent; /* (ribbons + 1, knots, 3) */
    double *shape;        /* (ribbons + 1, nodes, 3) second derivatives of a spline */
    double *position;     /* (ribbons, nodes, 3) packed */
    double *direction;    /* (ribbons, nodes, 3) packed */
    double *lambda;       /* (ribbons, nodes) packed */
    double *start;        /* (ribbons) packed */
    double *row;          /* (6, ribbons) */
    double *factors;      /* (SPLINE_WORKSPACE, nodes) */
};

static bool comb_counts_ok(const struct ribbon_comb *comb) {
    return comb->ribbons >= 2 && comb->ribbons <= RIBBON_RIBBON_LIMIT && comb->nodes >= 2 &&
           comb->nodes <= RIBBON_NODE_LIMIT && comb->side >= 2 && comb->side <= RIBBON_PATCH_VERTEX_LIMIT;
}

size_t ribbon_comb_workspace(const struct ribbon_comb *comb) {
    if (!comb_counts_ok(comb))
        return 0;
    size_t r = comb->ribbons, n = comb->nodes;
    return (r + 1) * n * (4 + 3 + 3) + 2 * (r + 1) * (n + 1) * 3 + r * n * (3 + 3 + 1) + 7 * r +
           SPLINE_WORKSPACE * n;
}

static double *take(double **rest, size_t count) {
    double *part = *rest;
    *rest += count;
    return part;
}

static struct parts carve(const struct ribbon_comb *comb, double *workspace) {
    size_t r = comb->ribbons, n = comb->nodes;
    struct parts parts;
    parts.q = take(&workspace, (r + 1) * n * 4);
    parts.binormal = take(&workspace, (r + 1) * n * 3);
    parts.knot = take(&workspace, (r + 1) * (n + 1) * 3);
    parts.knot_tangent = take(&workspace, (r + 1) * (n + 1) * 3);
    parts.shape = take(&workspace, (r + 1) * n * 3);
    parts.position = take(&workspace, r * n * 3);
    parts.direction = take(&workspace, r * n * 3);
    parts.lambda = take(&workspace, r * n);
    parts.start = take(&workspace, r);
    parts.row = take(&workspace, 6 * r);
    parts.factors = take(&workspace, SPLINE_WORKSPACE * n);
    return parts;
}

static void flag_ribbons(const struct ribbon_comb *comb, const uint8_t *valid, uint8_t *ribbon_valid) {
    for (size_t r = 0; r <= comb->ribbons; r++)
        ribbon_valid[r] = !valid || memchr(valid + comb->nodes * r, 1, comb->nodes) != NULL;
}

/* The curves of all ribbons, each from its own anchor, and where the ribbons start on the reference's. */
static int trace(const struct ribbon_comb *comb, const struct ribbon_comb_frame *frame,
                 const struct parts *parts) {
    size_t all = comb->ribbons + 1, nodes = comb->nodes;
    double *starts = frame->anchor + 3;
    if (comb->method == RIBBON_METHOD_SPLINE) {
        ribbon_spline_update(all, nodes, comb->s, frame->tangent, parts->knot, parts->shape, parts->factors);
        return ribbon_spline_points(1, nodes, comb->s, frame->tangent, parts->knot, parts->shape,
                                    comb->ribbons, comb->start, starts);
    }
    ribbon_hermite_update(all, nodes, comb->s, frame->tangent, parts->knot, parts->knot_tangent);
    return ribbon_hermite_points(1, nodes, comb->s, parts->knot, parts->knot_tangent, comb->ribbons,
                                 comb->start, starts);
}

/* Puts every ribbon's curve on the reference's curve. */
static void place(const struct ribbon_comb *comb, const struct ribbon_comb_frame *frame,
                  const struct parts *parts) {
    size_t nodes = comb->nodes, knots = ribbon_knot_count(nodes, comb->s);
    fill(frame->anchor, 3, 0.0);
    for (size_t r = 1; r <= comb->ribbons && !frame->ribbon_valid[0]; r++) {
        frame->anchor[3 * r] = comb->start[r - 1];
        frame->anchor[3 * r + 1] = frame->anchor[3 * r + 2] = 0.0;
    }
    for (size_t r = 0; r <= comb->ribbons; r++) {
        const double *knot = parts->knot + 3 * (knots * r + knots - nodes), *anchor = frame->anchor + 3 * r;
        double *node = frame->node + 3 * nodes * r;
        for (size_t k = 0; k < nodes; k++)
            for (size_t d = 0; d < 3; d++)
                node[3 * k + d] = anchor[d] + knot[3 * k + d];
    }
}

/* Packs position and binormal of the present ribbons; returns how many there are. */
static size_t pack(const struct ribbon_comb *comb, const struct ribbon_comb_frame *frame,
                   const struct parts *parts) {
    size_t line = 3 * comb->nodes, present = 0;
    for (size_t j = 0; j < comb->ribbons; j++) {
        if (!frame->ribbon_valid[j + 1])
            continue;
        memcpy(parts->position + line * present, frame->node + line * (j + 1), line * sizeof(double));
        memcpy(parts->direction + line * present, parts->binormal + line * (j + 1), line * sizeof(double));
        parts->start[present++] = comb->start[j];
    }
    return present;
}

/* Turns the directions of each ribbon, all or none, so that on the whole they lead to the next ribbon;
 * returns -1 if those of the first were turned, else 1. */
static double orient(size_t ribbons, size_t nodes, const double *position, double *direction) {
    size_t line = 3 * nodes;
    double first = 1.0;
    for (size_t j = 0; j < ribbons; j++) {
        const double *before = position + line * (j > 0 ? j - 1 : j);
        const double *after = position + line * (j + 1 < ribbons ? j + 1 : j);
        double lead = 0.0;
        for (size_t i = 0; i < line; i++)
            lead += (after[i] - before[i]) * direction[line * j + i];
        if (j == 0 && lead < 0.0)
            first = -1.0;
        for (size_t i = 0; i < line && lead < 0.0; i++)
            direction[line * j + i] = -direction[line * j + i];
    }
    return first;
}

/* Spreads the packed results over all ribbons; missing ones stay NaN. */
static void unpack(const struct ribbon_comb *comb, const struct ribbon_comb_frame *frame,
                   const struct parts *parts, bool surface) {
    size_t nodes = comb->nodes, present = 0;
    fill(frame->lambda, comb->ribbons * nodes, NAN);
    fill(frame->transversal, 3 * comb->ribbons * nodes, NAN);
    for (size_t j = 0; j < comb->ribbons; j++) {
        if (!frame->ribbon_valid[j + 1])
            continue;
        for (size_t k = 0; k < nodes && surface; k++) {
            double lambda = parts->lambda[nodes * present + k];
            frame->lambda[nodes * j + k] = lambda;
            for (size_t d = 0; d < 3; d++)
                frame->transversal[3 * (nodes * j + k) + d] =
                    lambda * parts->direction[3 * (nodes * present + k) + d];
        }
        present++;
    }
    memcpy(frame->along, frame->tangent + 3 * nodes, 3 * comb->ribbons * nodes * sizeof(double));
}

/* Gives missing ribbon j the values that the wide patches between ribbons a and b have at its start. */
static void span(const struct ribbon_comb *comb, const struct ribbon_comb_frame *frame, size_t a, size_t j,
                 size_t b) {
    size_t line = 3 * comb->nodes;
    double w = comb->start[b] - comb->start[a], value[4], slope[4];
    double u = (comb->start[j] - comb->start[a]) / w;
    hermite_basis(u, value);
    hermite_basis_slope(u, slope);
    for (size_t i = 0; i < line; i++) {
        /* Over the wide patch: the point and its derivative along the ribbons, each with its derivative
         * across. */
        const double *point = frame->node + line + i, *along = frame->along + i;
        const double *across = frame->transversal + i, *twist = frame->twist + i;
        frame->node[line * (j + 1) + i] = value[0] * point[line * a] + value[1] * point[line * b] +
                                          w * (value[2] * across[line * a] + value[3] * across[line * b]);
        frame->transversal[line * j + i] = (slope[0] * point[line * a] + slope[1] * point[line * b]) / w +
                                           slope[2] * across[line * a] + slope[3] * across[line * b];
        frame->along[line * j + i] = value[0] * along[line * a] + value[1] * along[line * b] +
                                     w * (value[2] * twist[line * a] + value[3] * twist[line * b]);
        frame->twist[line * j + i] = (slope[0] * along[line * a] + slope[1] * along[line * b]) / w +
                                     slope[2] * twist[line * a] + slope[3] * twist[line * b];
    }
    for (size_t k = 0; k < comb->nodes; k++) {
        const double *v = frame->transversal + line * j + 3 * k;
        double *t = frame->tangent + line * (j + 1) + 3 * k;
        frame->lambda[comb->nodes * j + k] = sqrt(dot3(v, v));
        copy3(t, frame->along + line * j + 3 * k);
        normalise3(t);
    }
}

static void span_missing(const struct ribbon_comb *comb, const struct ribbon_comb_frame *frame) {
    const uint8_t *present = frame->ribbon_valid + 1;
    for (size_t j = 0, a = comb->ribbons; j < comb->ribbons; j++) {
        if (present[j]) {
            a = j;
            continue;
        }
        size_t b = j + 1;
        while (b < comb->ribbons && !present[b])
            b++;
        if (a < j && b < comb->ribbons)
            span(comb, frame, a, j, b);
    }
}

/* Mixed derivative of the surface at the nodes: how the transversals' derivative changes along each ribbon.
 */
static void find_twist(const struct ribbon_comb *comb, const struct ribbon_comb_frame *frame,
                       const struct parts *parts) {
    size_t line = 3 * comb->nodes;
    if (comb->twist == RIBBON_TWIST_ZERO) {
        fill(frame->twist, comb->ribbons * line, 0.0);
        return;
    }
    struct factors factors = spline_factorise(comb->nodes, comb->s, parts->factors);
    for (size_t j = 0; j < comb->ribbons; j++) {
        const double *across = frame->transversal + line * j;
        spline_second_derivatives(comb->nodes, &factors, across, parts->shape);
        spline_slopes(comb->nodes, &factors, across, parts->shape, frame->twist + line * j);
    }
}

static int one_frame(const struct ribbon_comb *comb, const double *q, const uint8_t *valid,
                     const struct ribbon_comb_frame *frame, const struct parts *parts) {
    size_t ribbons = comb->ribbons, nodes = comb->nodes, all = ribbons + 1;
    int error = ribbon_bridge(all, nodes, comb->s, q, valid, parts->q, NULL);
    if (error < 0)
        return error;
    flag_ribbons(comb, valid, frame->ribbon_valid);
    ribbon_directions(all * nodes, parts->q, frame->tangent, parts->binormal);
    error = trace(comb, frame, parts);
    if (error)
        return error;
    place(comb, frame, parts);

    size_t present = pack(comb, frame, parts);
    double facing = 1.0;
    *frame->held = 0;
    if (present >= 2) {
        facing = orient(present, nodes, parts->position, parts->direction);
        *frame->held = ribbon_transversals(present, nodes, parts->start, parts->position, parts->direction,
                                           parts->lambda, parts->row);
    }
    unpack(comb, frame, parts, present >= 2);
    find_twist(comb, frame, parts);
    if (present < ribbons)
        span_missing(comb, frame);
    if (!frame->vertices)
        return 0;
    bool flat = comb->twist == RIBBON_TWIST_ZERO && present == ribbons;
    return ribbon_patches(ribbons, nodes, comb->s, comb->start, frame->node + 3 * nodes, frame->along,
                          frame->transversal, flat ? NULL : frame->twist, comb->side, facing, frame->vertices,
                          frame->normals);
}

/* Where the results of frame f go. */
static struct ribbon_comb_frame frame_at(const struct ribbon_comb *comb,
                                         const struct ribbon_comb_frame *first, size_t f) {
    size_t r = comb->ribbons, n = comb->nodes, mesh = (r - 1) * (n - 1) * comb->side * comb->side * 3;
    return (struct ribbon_comb_frame){
        .anchor = first->anchor + f * (r + 1) * 3,
        .node = first->node + f * (r + 1) * n * 3,
        .tangent = first->tangent + f * (r + 1) * n * 3,
        .along = first->along + f * r * n * 3,
        .transversal = first->transversal + f * r * n * 3,
        .twist = first->twist + f * r * n * 3,
        .lambda = first->lambda + f * r * n,
        .vertices = first->vertices ? first->vertices + f * mesh : NULL,
        .normals = first->vertices ? first->normals + f * mesh : NULL,
        .ribbon_valid = first->ribbon_valid + f * (r + 1),
        .held = first->held + f,
    };
}

int ribbon_comb_frames(const struct ribbon_comb *comb, size_t frames, const double *q, const uint8_t *valid,
                       const struct ribbon_comb_frame *first, double *workspace) {
    if (!comb_counts_ok(comb))
        return RIBBON_ERROR_COUNT;
    if (comb->method != RIBBON_METHOD_HERMITE && comb->method != RIBBON_METHOD_SPLINE)
        return RIBBON_ERROR_METHOD;
    if (comb->twist != RIBBON_TWIST_ZERO && comb->twist != RIBBON_TWIST_MEASURED)
        return RIBBON_ERROR_METHOD;
    if (!increasing(comb->s, comb->nodes) || !increasing(comb->start, comb->ribbons))
        return RIBBON_ERROR_NOT_INCREASING;
    struct parts parts = carve(comb, workspace);
    size_t orientations = (comb->ribbons + 1) * comb->nodes;
    for (size_t f = 0; f < frames; f++) {
        struct ribbon_comb_frame frame = frame_at(comb, first, f);
        int error = one_frame(comb, q + 4 * orientations * f, valid ? valid + orientations * f : NULL, &frame,
                              &parts);
        if (error)
            return error;
    }
    return 0;
}
