/* Curves of sensor ribbons, combs of them and the surface between: the whole interface of the C solver.
 *
 * For every function:
 *  1. Arrays are plain, row-major and the caller's; lengths are in metres, vectors in the world frame
 *     (ENU), quaternions unit, Hamilton, scalar first, turning node vectors (x tangent, y binormal, z
 *     normal) into world vectors.
 *  2. Nothing is allocated, kept or shared between calls: any number of threads may call with different
 *     outputs and workspaces. Inputs and outputs must not overlap.
 *  3. The result is zero or a count (each function says of what), or a negative `enum ribbon_error`;
 *     after an error the outputs hold nothing of use.
 *  4. Pointers must not be null unless said otherwise. Flags (`valid`) are 0 or 1.
 *  5. Curves start at the anchor, s = 0, at the origin. Where the first node lies beyond it the anchor
 *     is a knot of its own, whose tangent the method extrapolates; see ribbon_knot_count.
 *  6. NaN directions make the ribbon they belong to NaN and no other. */
#ifndef RIBBON_NATIVE_H
#define RIBBON_NATIVE_H

#include <stddef.h>
#include <stdint.h>

enum ribbon_error {
    RIBBON_ERROR_COUNT = -1,      /* a count is outside the limits below */
    RIBBON_ERROR_NOT_FINITE = -2, /* an input holds NaN or infinity */
    RIBBON_ERROR_NOT_UNIT = -3,   /* |v|^2 of a quaternion or direction differs from 1 by more than 1e-3 */
    RIBBON_ERROR_NOT_INCREASING = -4, /* arc lengths are negative or not strictly increasing */
    RIBBON_ERROR_NO_VALID_NODE = -5,  /* a ribbon has no valid node to bridge from */
    RIBBON_ERROR_OUTSIDE = -6,        /* an arc length asked for lies beyond the last node */
    RIBBON_ERROR_METHOD = -7          /* unknown method or twist */
};

enum ribbon_limit {
    RIBBON_NODE_LIMIT = 4096,      /* nodes of a ribbon, at least 2 */
    RIBBON_BATCH_LIMIT = 524287,   /* ribbons in one call, frames times ribbons of a comb excepted */
    RIBBON_RIBBON_LIMIT = 1024,    /* ribbons of a comb, at least 2, without the reference */
    RIBBON_PATCH_VERTEX_LIMIT = 64 /* vertices along one side of a patch, at least 2 */
};

enum ribbon_method {
    RIBBON_METHOD_HERMITE = 0, /* the paper's step 1b: cubic segments of exact length, least bending energy */
    RIBBON_METHOD_SPLINE = 1,  /* the default: cubic spline of the tangents, normalised and integrated */
    RIBBON_METHOD_SPHERICAL = 2 /* the paper's step 1a: cubic spline on the sphere, integrated */
};

/* The mixed derivative of the surface at the nodes. */
enum ribbon_twist {
    RIBBON_TWIST_ZERO = 0,    /* the paper's */
    RIBBON_TWIST_MEASURED = 1 /* how the transversals' derivative changes along the ribbons */
};

/* Stands for the spread of a node that is filled from one single node: no estimate, about a radian. */
#define RIBBON_SPREAD_OF_ONE 1.0

enum ribbon_size {
    RIBBON_SMOOTH_STATE = 13 /* doubles of state of one orientation in ribbon_smooth */
};

/* The smallest tangent magnitude of a transversal, as a share of its parameter's arc length. */
#define RIBBON_LAMBDA_MIN 0.05

/* gamma(c) of the hermite update: the chord of a cubic Hermite segment of arc length h whose unit end
 * tangents t0, t1 have the cosine c, and whose bending energy is least, is h gamma(c) (t0 + t1).
 *  1. c is taken as within [-1, 1]; relative error below 1e-13.
 *  2. gamma(c) sqrt(2 + 2c), the chord over the length, stays finite to c = -1; there this returns
 *     infinity. */
double ribbon_hermite_gamma(double c);

/* Whether all directions are finite and unit.
 *  1. v: (count, 3).
 *  2. Returns 0, or RIBBON_ERROR_NOT_FINITE or _NOT_UNIT. */
int ribbon_check_directions(size_t count, const double *v);

/* Tangents and binormals of nodes: first and second column of the rotation matrices.
 *  1. q: (count, 4), not zero; need not be exactly unit: the results are.
 *  2. tangent, binormal: (count, 3). Either may be null. */
void ribbon_directions(size_t count, const double *q, double *tangent, double *binormal);

/* Fills the orientations of invalid nodes from the valid ones, per ribbon: cubic Lagrange interpolation of
 * sign-aligned quaternions through the four nearest valid nodes (fewer where there are fewer), normalised.
 *  1. s: (nodes), strictly increasing. q: (ribbons, nodes, 4). valid: (ribbons, nodes), null: all
 *     valid. Orientations of invalid nodes are not read: they may be NaN.
 *  2. Beyond the outermost valid node the orientation is extrapolated linearly from the outermost two,
 *     over no more than their distance, and constant from there.
 *  3. bridged: (ribbons, nodes, 4). A ribbon without a valid node becomes NaN.
 *  4. spread: (ribbons, nodes), may be null: radians between the filling and a simpler one (linear,
 *     beyond the ends constant), a cautious measure of its error; RIBBON_SPREAD_OF_ONE if there is but
 *     one valid node; 0 for nodes that were valid.
 *  5. Returns the number of nodes that were filled, or RIBBON_ERROR_COUNT, _NOT_INCREASING, _NOT_FINITE
 *     and _NOT_UNIT (of a valid node's quaternion). */
int ribbon_bridge(size_t ribbons, size_t nodes, const double *s, const double *q, const uint8_t *valid,
                  double *bridged, double *spread);

/* Knots of a ribbon: its nodes, preceded by the anchor at s = 0 where the first node lies beyond it. */
static inline size_t ribbon_knot_count(size_t nodes, const double *s) {
    return s[0] > 0.0 ? nodes + 1 : nodes;
}

/* The paper's frame update for a batch of ribbons with the same nodes: cubic Hermite segments with unit
 * end tangents and exact arc length, each of least bending energy, chained from the anchor at the origin.
 *  1. s: (nodes), s[0] >= 0, strictly increasing. tangent: (ribbons, nodes, 3), unit.
 *  2. If s[0] > 0 the tangent at the anchor is extrapolated from the first three nodes (quadratic,
 *     normalised).
 *  3. position, knot_tangent: (ribbons, knots, 3) with knots = ribbon_knot_count. Position 0 is the
 *     origin.
 *  4. Exactly opposite neighbours leave the plane of the turn open: one perpendicular to the tangent is
 *     taken.
 *  5. Returns the number of such turns, or RIBBON_ERROR_COUNT or _NOT_INCREASING. */
int ribbon_hermite_update(size_t ribbons, size_t nodes, const double *s, const double *tangent,
                          double *position, double *knot_tangent);

/* Points at given arc lengths of a batch of ribbons: the cubic Hermite segments between their knots.
 *  1. position, knot_tangent: (ribbons, knots, 3) as ribbon_hermite_update gives them.
 *  2. s_out: (count), each within [0, s[nodes - 1]], in any order. out: (ribbons, count, 3).
 *  3. Returns 0, or RIBBON_ERROR_COUNT, _NOT_INCREASING or _OUTSIDE. */
int ribbon_hermite_points(size_t ribbons, size_t nodes, const double *s, const double *position,
                          const double *knot_tangent, size_t count, const double *s_out, double *out);

/* The default method for a batch of ribbons with the same nodes: the component-wise cubic spline of the
 * tangents (not-a-knot), normalised, integrated by a Gauss rule of 8 points a piece. Fourth order; the
 * curve has unit speed, so its length is exact.
 *  1. s, tangent, position as for ribbon_hermite_update.
 *  2. second: (ribbons, nodes, 3), the spline's second derivatives, of use to the functions below.
 *  3. Where the spline is exactly zero, which opposite neighbours can make it, the curve stands still.
 *  4. workspace: 5 * nodes doubles.
 *  5. Returns 0, or RIBBON_ERROR_COUNT or _NOT_INCREASING. */
int ribbon_spline_update(size_t ribbons, size_t nodes, const double *s, const double *tangent,
                         double *position, double *second, double *workspace);

/* Points at given arc lengths of a batch of ribbons by the default method.
 *  1. tangent, second: (ribbons, nodes, 3), position: (ribbons, knots, 3) of ribbon_spline_update.
 *  2. s_out, out and the result as for ribbon_hermite_points. */
int ribbon_spline_points(size_t ribbons, size_t nodes, const double *s, const double *tangent,
                         const double *position, const double *second, size_t count, const double *s_out,
                         double *out);

/* The paper's start for a batch of ribbons with the same nodes: the cubic B-spline on the unit sphere
 * through the tangents (De Casteljau with slerp, its control polygon found by iteration, no bending at the
 * ends), integrated.
 *  1. s, tangent, position as for ribbon_hermite_update.
 *  2. control: (ribbons, nodes, 3), the control polygon.
 *  3. workspace: 4 * nodes doubles.
 *  4. Returns the number of ribbons whose polygon was not found, which become NaN: tangents that turn
 *     too far from node to node. Or RIBBON_ERROR_COUNT or _NOT_INCREASING. */
int ribbon_spherical_update(size_t ribbons, size_t nodes, const double *s, const double *tangent,
                            double *position, double *control, double *workspace);

/* Points at given arc lengths of a batch of ribbons by the paper's start.
 *  1. tangent, control: (ribbons, nodes, 3), position: (ribbons, knots, 3) of ribbon_spherical_update.
 *  2. s_out, out and the result as for ribbon_hermite_points. */
int ribbon_spherical_points(size_t ribbons, size_t nodes, const double *s, const double *tangent,
                            const double *position, const double *control, size_t count, const double *s_out,
                            double *out);

/* Curvature and torsion of a batch of ribbons at their nodes and half way between, from the default
 * method's spline.
 *  1. tangent, second: (ribbons, nodes, 3) of ribbon_spline_update.
 *  2. curvature, torsion: (ribbons, 2 nodes - 1), 1/m: node, middle, node ... Torsion is positive for a
 *     right-handed helix, and 0 where there is no curvature.
 *  3. Returns 0, or RIBBON_ERROR_COUNT or _NOT_INCREASING. */
int ribbon_curvature(size_t ribbons, size_t nodes, const double *s, const double *tangent,
                     const double *second, double *curvature, double *torsion);

/* Doubles of workspace that ribbon_sensitivity needs, or 0 if the count is outside the limits. */
size_t ribbon_sensitivity_workspace(size_t nodes);

/* How points of a batch of ribbons move when their nodes turn: the derivative of the default method's
 * curve.
 *  1. q: (ribbons, nodes, 4) with invalid nodes filled as by ribbon_bridge; valid: (ribbons, nodes),
 *     null: all valid.
 *  2. s_out: (count), each within [0, s[nodes - 1]].
 *  3. out: (ribbons, count, nodes, 3, 3): point i moves by out[][i][j] r when node j turns by the small
 *     rotation vector r (world axes). A turn of a valid node takes the nodes that are filled from it
 *     with it; the entry of an invalid node is for an error of the filling itself.
 *  4. shortening: (ribbons, count, nodes, 3), second order: by the same turn alone point i also moves
 *     by -|r'|^2 / 2 shortening[][i][j], r' the part of r perpendicular to the tangent.
 *  5. workspace: ribbon_sensitivity_workspace(nodes) doubles.
 *  6. Returns 0, or RIBBON_ERROR_COUNT, _NOT_INCREASING, _OUTSIDE or _NO_VALID_NODE (of any ribbon). */
int ribbon_sensitivity(size_t ribbons, size_t nodes, const double *s, const double *q, const uint8_t *valid,
                       size_t count, const double *s_out, double *out, double *shortening, double *workspace);

/* Smooths orientations over time: two equal first-order low-passes in a row, of time constant tau each. A
 * steady turn comes out 2 tau late, whatever the spacing of the frames.
 *  1. t: (frames) seconds. q: (frames, count, 4), signs free. valid: (frames, count), null: all valid;
 *     what is invalid is not read, and leaves the output where it was (NaN before the first valid one).
 *  2. state: (count, RIBBON_SMOOTH_STATE), NaN before the first frame; carries over from call to call.
 *  3. smooth: (frames, count, 4), unit.
 *  4. Returns 0, or RIBBON_ERROR_NOT_FINITE (t or tau, which must be positive too) or _NOT_INCREASING
 *     (t). */
int ribbon_smooth(size_t frames, size_t count, const double *t, double tau, const double *q,
                  const uint8_t *valid, double *state, double *smooth);

/* Tangent magnitudes of the transversals of a comb: for each row k the C1 cubic Hermite curve through node
 * k of all ribbons, with end tangents lambda * direction, that has the least bending energy.
 *  1. start: (ribbons), strictly increasing: the curve's parameter at each ribbon. position, direction:
 *     (ribbons, nodes, 3); directions unit, pointing toward the next ribbon.
 *  2. lambda: (ribbons, nodes), at least RIBBON_LAMBDA_MIN: where the minimum lies lower it is held
 *     there and the others of the row solved again.
 *  3. workspace: 6 * ribbons doubles.
 *  4. Returns the number of lambda that were held, or RIBBON_ERROR_COUNT or _NOT_INCREASING. */
int ribbon_transversals(size_t ribbons, size_t nodes, const double *start, const double *position,
                        const double *direction, double *lambda, double *workspace);

/* Vertices and normals of bicubically blended Coons patches with cubic Hermite borders, which are bicubic
 * patches.
 *  1. A patch spans nodes k, k + 1 of ribbons j, j + 1. s: (nodes), start: (ribbons): the parameters of
 *     its sides. position, tangent, transversal, twist: (ribbons, nodes, 3): point, derivative along
 *     the ribbon by s, derivative across by start, mixed derivative. twist may be null: zero.
 *  2. vertices, normals: (ribbons - 1, nodes - 1, side, side, 3), third index along the ribbon, fourth
 *     across. Normals are unit: facing * (along the ribbon x across), facing +1 or -1; zero where there
 *     is none.
 *  3. Patches next to NaN become NaN and no other.
 *  4. Returns 0, or RIBBON_ERROR_COUNT or _NOT_INCREASING. */
int ribbon_patches(size_t ribbons, size_t nodes, const double *s, const double *start, const double *position,
                   const double *tangent, const double *transversal, const double *twist, size_t side,
                   double facing, float *vertices, float *normals);

/* A comb: a reference ribbon and the ribbons that start on it, all with the same nodes. */
struct ribbon_comb {
    size_t ribbons;      /* without the reference */
    size_t nodes;        /* of each ribbon */
    size_t side;         /* vertices along a side of a patch */
    int method;          /* enum ribbon_method: hermite or spline */
    int twist;           /* enum ribbon_twist */
    const double *s;     /* (nodes) arc length of the nodes from the anchor */
    const double *start; /* (ribbons) where each ribbon starts on the reference, strictly increasing */
};

/* Where ribbon_comb_frames puts its results: arrays that begin with (frames), then as below. Index 0 of
 * (ribbons + 1) is the reference. */
struct ribbon_comb_frame {
    double *anchor;        /* (ribbons + 1, 3) start of each ribbon; the reference's is the origin */
    double *node;          /* (ribbons + 1, nodes, 3) node positions */
    double *tangent;       /* (ribbons + 1, nodes, 3) unit tangents, invalid nodes bridged */
    double *along;         /* (ribbons, nodes, 3) derivative of the surface by s */
    double *transversal;   /* (ribbons, nodes, 3) derivative of the surface by the start arc length */
    double *twist;         /* (ribbons, nodes, 3) mixed derivative */
    double *lambda;        /* (ribbons, nodes) magnitude of transversal */
    float *vertices;       /* (ribbons - 1, nodes - 1, side, side, 3); null: no patches are wanted */
    float *normals;        /* the same shape */
    uint8_t *ribbon_valid; /* (ribbons + 1) 0: no valid node at all */
    int32_t *held;         /* () how many lambda were held at their minimum */
};

/* Doubles of workspace that ribbon_comb_frames needs, or 0 if the comb's counts are outside the limits. */
size_t ribbon_comb_workspace(const struct ribbon_comb *comb);

/* Frames of a comb, from orientations to the surface: bridge, curves, placement on the reference's curve,
 * transversals, patches.
 *  1. q: (frames, ribbons + 1, nodes, 4), valid: (frames, ribbons + 1, nodes), null: all valid; both
 *     with the reference first.
 *  2. A ribbon without a valid node is flagged. Between two others the surface spans its place: its
 *     nodes, transversals and tangents are those of the wide patches at its start. At an end of the
 *     comb there is nothing to span from: NaN.
 *  3. Without a valid node of the reference the ribbons cannot be placed: each then starts on a
 *     straight line along x, and ribbon_valid[0] is 0.
 *  4. Per ribbon the transversals run along its binormals in the sense that leads to the next ribbon.
 *     Normals point to the side of the node z axes of the first present ribbon.
 *  5. workspace: ribbon_comb_workspace(comb) doubles.
 *  6. Returns 0, or RIBBON_ERROR_COUNT, _METHOD, _NOT_INCREASING (s or start), _OUTSIDE (start beyond
 *     the last node), _NOT_FINITE, _NOT_UNIT. */
int ribbon_comb_frames(const struct ribbon_comb *comb, size_t frames, const double *q, const uint8_t *valid,
                       const struct ribbon_comb_frame *first, double *workspace);

#endif
