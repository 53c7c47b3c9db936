/* Vectors of three floats, and what else the fusion needs of a mathematical library. */
#ifndef VEC3_H
#define VEC3_H

#include <math.h>
#include <stdbool.h>

/* Not fmaxf and fminf, which need a library on a microcontroller. The second argument where the first is NaN.
 */
static inline float larger_of(float a, float b) {
    return a > b ? a : b;
}

static inline float smaller_of(float a, float b) {
    return a < b ? a : b;
}

static inline float vec3_dot(const float a[3], const float b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void vec3_cross(const float a[3], const float b[3], float product[3]) {
    product[0] = a[1] * b[2] - a[2] * b[1];
    product[1] = a[2] * b[0] - a[0] * b[2];
    product[2] = a[0] * b[1] - a[1] * b[0];
}

static inline float vec3_norm(const float a[3]) {
    return sqrtf(vec3_dot(a, a));
}

static inline float vec3_distance_squared(const float a[3], const float b[3]) {
    const float x = a[0] - b[0];
    const float y = a[1] - b[1];
    const float z = a[2] - b[2];
    return x * x + y * y + z * z;
}

static inline bool vec3_is_finite(const float a[3]) {
    return isfinite(a[0]) && isfinite(a[1]) && isfinite(a[2]);
}

/* a *= factor */
static inline void vec3_scale(float a[3], float factor) {
    a[0] *= factor;
    a[1] *= factor;
    a[2] *= factor;
}

/* difference = a - b */
static inline void vec3_subtract(const float a[3], const float b[3], float difference[3]) {
    difference[0] = a[0] - b[0];
    difference[1] = a[1] - b[1];
    difference[2] = a[2] - b[2];
}

/* sum += factor * a */
static inline void vec3_add_scaled(float sum[3], float factor, const float a[3]) {
    sum[0] += factor * a[0];
    sum[1] += factor * a[1];
    sum[2] += factor * a[2];
}

/* Scales a to length 1. False, and a unchanged, if its length is no positive finite number. */
static inline bool vec3_normalise(float a[3]) {
    const float norm = vec3_norm(a);
    if (!(norm > 0.0f) || !isfinite(norm))
        return false;
    vec3_scale(a, 1.0f / norm);
    return true;
}

#endif
