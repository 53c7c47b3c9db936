/* Parts of the cubic spline that more than one file of the solver uses. */
#ifndef SPLINE_H
#define SPLINE_H

#include <stddef.h>

#include "tables.h"

/* Factors of the equations for the second derivatives at inner nodes, not-a-knot at both ends, and the
 * lengths of the pieces. Parts of a workspace of SPLINE_WORKSPACE * nodes doubles. */
#define SPLINE_WORKSPACE 5
struct factors {
    double *h;        /* (nodes - 1) */
    double *inv_h;    /* (nodes - 1) */
    double *lower;    /* (nodes) multiplier of the row before in the elimination */
    double *upper;    /* (nodes) */
    double *inv_diag; /* (nodes) */
};

struct factors spline_factorise(size_t nodes, const double *s, double *workspace);

/* Second derivatives (nodes, 3) of the spline through value (nodes, 3). */
void spline_second_derivatives(size_t nodes, const struct factors *f, const double *value, double *second);

/* First derivatives (nodes, 3) of the spline with these values and second derivatives. */
void spline_slopes(size_t nodes, const struct factors *f, const double *value, const double *second,
                   double *slope);

/* Weights of the spline at the Gauss points of a piece: value = a v0 + b v1 + c m0 + d m1 with the values and
 * second derivatives at its two nodes. */
struct weights {
    double a[PIECE_POINTS], b[PIECE_POINTS], c[PIECE_POINTS], d[PIECE_POINTS];
};

/* At the Gauss points between u0 and u1, in units of the piece, which has the length h. */
struct weights spline_weights(double u0, double u1, double h);

#endif
