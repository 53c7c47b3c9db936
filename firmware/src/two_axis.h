/* The heading from a field of which one component is not measured: that along a direction b, which the
 * magnetometer is blind to.
 *
 * With up = u and a known field, m(n) = horizontal * n - down * u for the direction n of north, a unit vector
 * across u. All n make a circle, whose projection onto the plane across b is an ellipse: half an axis 1
 * across the plane's slope, |u . b| along it. The likeliest n belongs to the point of the ellipse
 * nearest to what was measured (least squares over the dip and the magnitude at once). Where the plane is
 * nearly vertical the ellipse is flat, and the points of its two sides fit almost alike: two headings explain
 * the reading. */
#ifndef TWO_AXIS_H
#define TWO_AXIS_H

#include <stdbool.h>

struct two_axis_root {
    float north[3];    /* unit vector across up, node frame */
    float misfit[2];   /* measured - explained, uT: across the slope of the plane, and along it */
    float sensitivity; /* change of the explained field with heading, uT a radian */
};

/* Finds the best root and, if there is one that matters, the other side's; returns how many, best first. up,
 * blind: unit vectors, node frame. field_ut: its part along blind is not looked at. The other side does not
 * matter if its misfit must exceed misfit_max_ut. */
unsigned two_axis_solve(const float up[3], const float blind[3], const float field_ut[3], float horizontal_ut,
                        float down_ut, float misfit_max_ut, struct two_axis_root roots[2]);

/* misfit^2, uT^2 */
float two_axis_cost(const struct two_axis_root *root);

#endif
