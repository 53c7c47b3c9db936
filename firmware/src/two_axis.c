/* The heading from a field of which only two components are measured. */
#include "two_axis.h"

#include "vec3.h"

/* A slope below this has no direction that floats could tell; it does not matter either. */
static const float SLOPE_MIN = 1e-3f;

/* Newton's method is quadratic: after a step as small as this the next one would be of some 1e-6 rad. */
static const float STEP_DONE = 1e-3f;
enum { NEWTON_STEPS_MAX = 8 };

/* A step of more than half a radian leaves the region in which the linearisation means anything. */
static const float STEP_MAX = 0.5f;

/* Roots nearer than this (radians) are one. */
static const float SEPARATION_MIN = 0.02f;

/* An ellipse as narrow as this tells next to nothing along it. */
static const float NARROW = 0.3f;

/* A point (cos, sin) of the unit circle that stands for (cos, w sin) of the ellipse; p is the measured point.
 */
struct ellipse_point {
    float c, s;
    bool is_minimum;
};

static struct ellipse_point nearest_from(float c, float s, const float p[2], float w) {
    float curvature = -1.0f;
    for (unsigned step = 0; step < NEWTON_STEPS_MAX; step++) {
        const float across = c - p[0];
        const float along = w * s - p[1];
        const float slope = -s * across + w * c * along;
        curvature = s * s - c * across + w * (w * c * c - s * along);
        const float size = fabsf(curvature) + 1e-6f;
        float turn = -slope / size;
        turn = turn > STEP_MAX ? STEP_MAX : turn < -STEP_MAX ? -STEP_MAX : turn;
        const float c_turned = c - s * turn;
        const float s_turned = s + c * turn;
        const float norm = sqrtf(1.0f + turn * turn);
        c = c_turned / norm;
        s = s_turned / norm;
        if (fabsf(turn) < STEP_DONE)
            break;
    }
    return (struct ellipse_point){c, s, curvature > 0.0f};
}

/* Some unit vector across a unit vector b. */
static void across(const float b[3], float v[3]) {
    const bool is_x = fabsf(b[0]) < 0.7f;
    v[0] = is_x ? 1.0f : 0.0f;
    v[1] = is_x ? 0.0f : 1.0f;
    v[2] = 0.0f;
    vec3_add_scaled(v, -vec3_dot(v, b), b);
    vec3_normalise(v);
}

unsigned two_axis_solve(const float up[3], const float blind[3], const float field_ut[3], float horizontal_ut,
                        float down_ut, float misfit_max_ut, struct two_axis_root roots[2]) {
    /* Unit vectors of the plane: downhill reversed (along), and level. */
    const float up_blind = vec3_dot(up, blind);
    float along[3] = {up[0], up[1], up[2]};
    vec3_add_scaled(along, -up_blind, blind);
    const float slope = vec3_norm(along);
    if (slope > SLOPE_MIN)
        vec3_scale(along, 1.0f / slope);
    else
        across(blind, along);
    float level[3];
    vec3_cross(blind, along, level);
    float uphill[3] = {slope * blind[0], slope * blind[1], slope * blind[2]}; /* up x level */
    vec3_add_scaled(uphill, -up_blind, along);

    /* north = c * level + s * uphill projects to c level, and -(up . blind) s along. */
    const float w = -up_blind;
    const float p[2] = {
        vec3_dot(field_ut, level) / horizontal_ut,
        (vec3_dot(field_ut, along) + down_ut * slope) / horizontal_ut,
    };

    /* One start a side, first on the side that the measured point is nearer to: where the ellipse would be
     * stretched to a circle, or, if it is narrow, above the point. */
    float c_start;
    float s_start;
    const float stretched = sqrtf(w * w * p[0] * p[0] + p[1] * p[1]);
    if (fabsf(w) > NARROW && stretched > NARROW * fabsf(w)) {
        const float scale = (w < 0.0f ? -1.0f : 1.0f) / stretched;
        c_start = scale * w * p[0];
        s_start = scale * p[1];
    } else {
        c_start = p[0] > 1.0f ? 1.0f : p[0] < -1.0f ? -1.0f : p[0];
        s_start = sqrtf(1.0f - c_start * c_start);
        if (p[1] * w < 0.0f)
            s_start = -s_start;
    }
    unsigned count = 0u;
    for (unsigned side = 0; side < 2u; side++) {
        const struct ellipse_point point = nearest_from(c_start, side == 0u ? s_start : -s_start, p, w);
        if (!point.is_minimum && side == 1u)
            continue;
        struct two_axis_root *const root = &roots[count];
        for (unsigned i = 0; i < 3u; i++)
            root->north[i] = point.c * level[i] + point.s * uphill[i];
        root->misfit[0] = horizontal_ut * (p[0] - point.c);
        root->misfit[1] = horizontal_ut * (p[1] - w * point.s);
        root->sensitivity = horizontal_ut * sqrtf(point.s * point.s + w * w * point.c * point.c);
        count++;
        /* All of the other side is beyond the ellipse's axis. */
        if (fabsf(p[1]) * horizontal_ut > misfit_max_ut)
            break;
    }
    if (count == 2u) {
        if (vec3_distance_squared(roots[0].north, roots[1].north) < SEPARATION_MIN * SEPARATION_MIN)
            count = 1u;
        if (two_axis_cost(&roots[1]) < two_axis_cost(&roots[0])) {
            const struct two_axis_root better = roots[1];
            roots[1] = roots[0];
            roots[0] = better;
        }
    }
    return count;
}

float two_axis_cost(const struct two_axis_root *root) {
    return root->misfit[0] * root->misfit[0] + root->misfit[1] * root->misfit[1];
}
