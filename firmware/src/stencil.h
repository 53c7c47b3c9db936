/* Vectors interpolated along the ribbon: from the slots where they are measured
 * to where they are needed.
 *
 * Sensors of one kind sit two pitches apart. A stencil holds the weights of the
 * polynomial through the nearest valid ones: of degree five where three of each
 * side are in reach, else three where four are. It depends on which are valid, not on what they read: it is
 * computed when that changes, and used in every scan. */
#ifndef STENCIL_H
#define STENCIL_H

#include <stdbool.h>
#include <stdint.h>

#define STENCIL_POINTS_MAX 6u

struct stencil {
    uint8_t count;                       /* sensors used; 0: none is in reach */
    uint8_t index[STENCIL_POINTS_MAX];   /* which, counted among those of the kind,
                                            nearest first */
    float weight[STENCIL_POINTS_MAX];    /* sums to 1 */
    float last_term[STENCIL_POINTS_MAX]; /* the weights minus those of the
                                            polynomial of one degree less */
};

/* The stencil for the place `at` (pitches from the first sensor of the kind)
 * among `count` sensors at 0, 2, 4
 * ... pitches, those with valid[i]; sensor `except` is left out (count or more:
 * none).
 *
 * Between sensors, degree five instead of three takes the mean error of a comb on the sea from 0.10 to 0.07 %
 * of the length. Near an end it would take it back: there the six would not lie evenly around the place.
 *
 * Beyond an end a polynomial of degree three would make the noise 3.4 times
 * that of a sensor, of degree two 2.3 times. On the moving test surfaces (sea,
 * wing, breath; part noise) the last node's tangent is off by 2.9, 0.18 and
 * 0.18 deg in the mean with degree three, 2.4, 0.15 and 0.19 with two, 4.5,
 * 0.15 and 0.31 with one: two it is. */
void stencil_make(struct stencil *stencil, float at, const bool *valid, unsigned count, unsigned except);

/* value = sum of weight * vectors */
void stencil_apply(const struct stencil *stencil, const float (*vectors)[3], float value[3]);

/* The length of the polynomial's last term: a measure of what the next one
 * would be. */
float stencil_last_term(const struct stencil *stencil, const float (*vectors)[3]);

/* The variance of the interpolated value, given that of each sensor. */
float stencil_variance(const struct stencil *stencil, const float *variances);

/* How far an interpolated value may be off. */
struct stencil_error {
    float last_term; /* of stencil_last_term */
    float variance;  /* of stencil_variance */
};

/* All of these at once. */
struct stencil_error stencil_apply_told(const struct stencil *stencil, const float (*vectors)[3],
                                        const float *variances, float value[3]);

#endif
