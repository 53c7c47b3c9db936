/* Whether the calibration still fits: slow means of what it must give. */
#include "health.h"

#include <math.h>
#include <string.h>

#include "vec3.h"
#include "wire.h"

#define NODES RIBBON_NODE_COUNT

/* Means are over so long, and say nothing before they have lasted for the other. */
static const float MEAN_S = 5.0f;
static const float KNOWN_S = 2.0f;

/* The rest filter's gain below which the ribbon rests. */
static const float REST_GAIN_MAX = 0.5f;

/* |a| / g - 1 that is too much. */
static const float LENGTH_MAX = 0.01f;

/* Share of g by which an accelerometer may differ from its neighbours: a bend of 7 cm radius makes as much.
 */
static const float NEIGHBOURS_MAX = 0.04f;

/* The field does not fit if it was called disturbed for so much of the time. */
static const float DISTURBED_MAX = 0.7f;

static const int8_t UNKNOWN_PERMILLE = -128;

void health_reset(struct health *health) {
    memset(health, 0, sizeof *health);
}

/* Takes values into means that have lasted for *lasted_s: all alike at first. Returns whether they can be
 * relied on. */
static bool take(float *mean, const float *value, unsigned count, float *lasted_s, float dt_s) {
    *lasted_s = smaller_of(*lasted_s + dt_s, MEAN_S);
    const float share = dt_s / *lasted_s;
    for (unsigned i = 0; i < count; i++)
        mean[i] += share * (value[i] - mean[i]);
    return *lasted_s >= KNOWN_S;
}

/* What accelerometer k reads beyond the cubic through two neighbours on each side; false where there are
 * none. */
static bool find_off(const struct fusion_state *state, const struct fusion_input *input, unsigned k,
                     float off[3]) {
    static const float weight[] = {1.0f / 6.0f, -4.0f / 6.0f, 1.0f, -4.0f / 6.0f, 1.0f / 6.0f};
    if (k < 2u || k + 2u >= NODES)
        return false;
    for (unsigned i = 0; i < 5u; i++) {
        if (!input->accel_valid[k - 2u + i])
            return false;
        vec3_add_scaled(off, weight[i], state->accel[k - 2u + i].mean);
    }
    return true;
}

static float off_squared(const struct health *health, unsigned k) {
    return vec3_dot(health->nodes[k].accel + 1, health->nodes[k].accel + 1);
}

static void watch_accel(struct health *health, float g, const struct fusion_state *state,
                        const struct fusion_input *input, unsigned k, float dt_s) {
    struct health_node *const node = &health->nodes[k];
    float value[4] = {vec3_norm(state->accel[k].mean) - g, 0.0f, 0.0f, 0.0f};
    const bool has_neighbours = find_off(state, input, k, value + 1);
    if (!take(node->accel, value, has_neighbours ? 4u : 1u, &node->accel_s, dt_s))
        return;
    unsigned misfit = 0u;
    if (fabsf(node->accel[0]) > LENGTH_MAX * g)
        misfit |= WIRE_MISFIT_LENGTH;
    /* Where one accelerometer is off, its neighbours seem to be off by two thirds of that. */
    const float off = off_squared(health, k);
    if (has_neighbours && off > NEIGHBOURS_MAX * NEIGHBOURS_MAX * g * g &&
        off >= off_squared(health, k - 1u) && off >= off_squared(health, k + 1u))
        misfit |= WIRE_MISFIT_NEIGHBOURS;
    health->misfit[2u * k] = (uint8_t)misfit;
}

static void watch_field(struct health *health, float field_ut, const struct fusion_state *state, unsigned k,
                        float dt_s) {
    struct health_node *const node = &health->nodes[k];
    const float value[3] = {
        vec3_norm(state->field[k].mean) - field_ut,
        state->magnitude_s[k] > 0.0f ? 1.0f : 0.0f,
        state->dip_s[k] > 0.0f ? 1.0f : 0.0f,
    };
    if (!take(node->field, value, 3u, &node->field_s, dt_s))
        return;
    health->misfit[2u * k + 1u] = (uint8_t)((node->field[1] > DISTURBED_MAX ? WIRE_MISFIT_LENGTH : 0) |
                                            (node->field[2] > DISTURBED_MAX ? WIRE_MISFIT_DIP : 0));
}

void health_watch(struct health *health, const struct fusion_params *params, const struct fusion_state *state,
                  const struct fusion_input *input, float field_ut) {
    const unsigned k = health->next;
    const float dt_s = smaller_of(input->dt_s * (float)NODES, KNOWN_S);
    health->next = (uint8_t)((k + 1u) % NODES);
    /* On a ribbon that is shaken the level is wrong, and with it the dip. */
    const bool is_level = !(state->unrest_s[k] > 0.0f) && !(state->unrest_s[(k + 1u) % NODES] > 0.0f);
    if (!input->accel_valid[k])
        health->misfit[2u * k] = 0u;
    else if (is_level && state->gain.gain < REST_GAIN_MAX)
        watch_accel(health, params->gravity_mps2, state, input, k, dt_s);
    if (!input->field_valid[k])
        health->misfit[2u * k + 1u] = 0u;
    else if (is_level)
        watch_field(health, field_ut, state, k, dt_s);
}

int8_t health_length_permille(const struct health *health, const struct fusion_params *params, float field_ut,
                              unsigned slot) {
    const struct health_node *const node = &health->nodes[slot / 2u];
    const bool is_accel = slot % 2u == 0u;
    if ((is_accel ? node->accel_s : node->field_s) < KNOWN_S || (!is_accel && params->has_two_axes))
        return UNKNOWN_PERMILLE;
    const float size = is_accel ? params->gravity_mps2 : field_ut;
    const float permille = 1000.0f * (is_accel ? node->accel[0] : node->field[0]) / size;
    return (int8_t)smaller_of(larger_of(permille + (permille < 0.0f ? -0.5f : 0.5f), -127.0f), 127.0f);
}
