/* Vectors interpolated along the ribbon: from the slots where they are measured
 * to where they are needed. */
#include "stencil.h"

#include <math.h>

#include "vec3.h"

#define STENCIL_POINTS_LOPSIDED_MAX 4u

static const float SPACING = 2.0f; /* pitches between sensors of one kind */

/* Farther sensors say nothing of this place: a ribbon can turn by a radian in
 * between. */
static const float REACH = 7.0f; /* pitches */

/* Largest square of a stencil's noise gain. Half a spacing beyond an end it
 * lets degree two (5.2) pass, not three (11.4); one and a half, where the last
 * sensor is dead, degree one (8.5). */
static const float GAIN_SQUARED_MAX = 9.0f;

static float distance(float at, unsigned index) {
    return fabsf((float)index * SPACING - at);
}

/* Takes the nearest sensors: three of each side where both have them, else four, no more than two of a side
 * while the other has some. Six that lie to one side err more than four. */
static unsigned nearest(uint8_t *index, float at, const bool *valid, unsigned count, unsigned except) {
    uint8_t below[STENCIL_POINTS_MAX];
    uint8_t above[STENCIL_POINTS_MAX];
    unsigned below_count = 0u;
    unsigned above_count = 0u;
    for (unsigned i = 0; i < count; i++) {
        if (!valid[i] || i == except || distance(at, i) > REACH)
            continue;
        if ((float)i * SPACING > at) {
            if (above_count < STENCIL_POINTS_MAX)
                above[above_count++] = (uint8_t)i;
        } else {
            if (below_count == STENCIL_POINTS_MAX) {
                for (unsigned j = 1; j < STENCIL_POINTS_MAX; j++)
                    below[j - 1u] = below[j];
                below_count--;
            }
            below[below_count++] = (uint8_t)i;
        }
    }

    const unsigned half_max = STENCIL_POINTS_MAX / 2u;
    const unsigned half =
        below_count >= half_max && above_count >= half_max ? half_max : STENCIL_POINTS_LOPSIDED_MAX / 2u;
    unsigned from_below = below_count;
    unsigned from_above = above_count;
    if (from_below + from_above > 2u * half) {
        if (from_below <= half)
            from_above = 2u * half - from_below;
        else if (from_above <= half)
            from_below = 2u * half - from_above;
        else
            from_below = from_above = half;
    }

    unsigned used = 0u;
    unsigned b = 0u;
    unsigned a = 0u;
    while (b < from_below || a < from_above) {
        const bool is_below =
            a == from_above ||
            (b < from_below && distance(at, below[below_count - 1u - b]) <= distance(at, above[a]));
        index[used++] = is_below ? below[below_count - 1u - b++] : above[a++];
    }
    return used;
}

/* Lagrange's weights at `at`. */
static void lagrange(float *weight, float at, const uint8_t *index, unsigned count) {
    for (unsigned i = 0; i < count; i++) {
        weight[i] = 1.0f;
        for (unsigned j = 0; j < count; j++)
            if (j != i)
                weight[i] *=
                    (at - (float)index[j] * SPACING) / (SPACING * ((float)index[i] - (float)index[j]));
    }
}

static float gain_squared(const float *weight, unsigned count) {
    float sum = 0.0f;
    for (unsigned i = 0; i < count; i++)
        sum += weight[i] * weight[i];
    return sum;
}

void stencil_make(struct stencil *stencil, float at, const bool *valid, unsigned count, unsigned except) {
    unsigned used = nearest(stencil->index, at, valid, count, except);
    lagrange(stencil->weight, at, stencil->index, used);
    while (used > 1u && gain_squared(stencil->weight, used) > GAIN_SQUARED_MAX) {
        used--;
        lagrange(stencil->weight, at, stencil->index, used);
    }
    stencil->count = (uint8_t)used;
    if (used == 0u)
        return;

    float lower[STENCIL_POINTS_MAX] = {0.0f};
    lagrange(lower, at, stencil->index, used - 1u);
    for (unsigned i = 0; i < used; i++)
        stencil->last_term[i] = stencil->weight[i] - lower[i];
}

static inline void weigh(const struct stencil *stencil, const float *weights, const float (*vectors)[3],
                         float sum[3]) {
    float x = 0.0f;
    float y = 0.0f;
    float z = 0.0f;
    for (unsigned i = 0; i < stencil->count; i++) {
        const float *const vector = vectors[stencil->index[i]];
        x += weights[i] * vector[0];
        y += weights[i] * vector[1];
        z += weights[i] * vector[2];
    }
    sum[0] = x;
    sum[1] = y;
    sum[2] = z;
}

void stencil_apply(const struct stencil *stencil, const float (*vectors)[3], float value[3]) {
    weigh(stencil, stencil->weight, vectors, value);
}

float stencil_last_term(const struct stencil *stencil, const float (*vectors)[3]) {
    float term[3];
    weigh(stencil, stencil->last_term, vectors, term);
    return vec3_norm(term);
}

/* The hot loop of a scan: one pass, with sums that stay in registers. */
struct stencil_error stencil_apply_told(const struct stencil *stencil, const float (*vectors)[3],
                                        const float *variances, float value[3]) {
    float x = 0.0f;
    float y = 0.0f;
    float z = 0.0f;
    float term_x = 0.0f;
    float term_y = 0.0f;
    float term_z = 0.0f;
    float variance = 0.0f;
    for (unsigned i = 0; i < stencil->count; i++) {
        const unsigned index = stencil->index[i];
        const float *const vector = vectors[index];
        const float weight = stencil->weight[i];
        const float last_weight = stencil->last_term[i];
        x += weight * vector[0];
        y += weight * vector[1];
        z += weight * vector[2];
        term_x += last_weight * vector[0];
        term_y += last_weight * vector[1];
        term_z += last_weight * vector[2];
        variance += weight * weight * variances[index];
    }
    value[0] = x;
    value[1] = y;
    value[2] = z;
    return (struct stencil_error){
        .last_term = sqrtf(term_x * term_x + term_y * term_y + term_z * term_z),
        .variance = variance,
    };
}

float stencil_variance(const struct stencil *stencil, const float *variances) {
    float sum = 0.0f;
    for (unsigned i = 0; i < stencil->count; i++)
        sum += stencil->weight[i] * stencil->weight[i] * variances[stencil->index[i]];
    return sum;
}
