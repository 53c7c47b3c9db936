/* Which sensors' readings change otherwise than those of their neighbours on the ribbon: slow drifts. */
#include "drift.h"

#include <math.h>
#include <string.h>

#include "vec3.h"

#define COUNT ((int)RIBBON_NODE_COUNT)

static const uint32_t LOOK_US = 50000u;
static const uint32_t SNAPSHOT_US = 200000u;
static const uint32_t NAMED_MAX_US = 2000000u;

/* Share of the size by which a change may differ from that of the neighbours between which a sensor lies, and
 * beyond which it lies. Part noise makes 0.006 and 0.012 of it. */
static const float TOLERANCE = 0.04f;
static const float TOLERANCE_AT_END = 0.08f;

/* And by so much of what the neighbours changed by: a wing that beats once a second needs 0.2, the sea 0.7.
 */
static const float TOLERANCE_MOVING = 0.7f;

enum { REACH_BETWEEN = 2, REACH_BEYOND = 3, FOUND_MAX = 4 };

struct changes {
    float change[RIBBON_NODE_COUNT][3];
    float length[RIBBON_NODE_COUNT];
    float size;
    uint16_t good; /* sensors that the others are compared with */
};

static bool has(uint16_t mask, int i) {
    return i >= 0 && i < COUNT && (mask >> i & 1u) != 0u;
}

static uint16_t without(uint16_t mask, int i) {
    return (uint16_t)(mask & ~(1u << i));
}

/* How far the nearest good sensor on a side is, beyond so many steps; 0: it is not within reach. */
static int find(const struct changes *changes, int i, int direction, int beyond, int reach) {
    for (int step = beyond + 1; step <= reach; step++)
        if (has(changes->good, i + direction * step))
            return direction * step;
    return 0;
}

/* How much the change of sensor i differs from that of its neighbours, in units of what it may; 0 if they say
 * nothing. */
static float contradiction(const struct changes *changes, int i) {
    int near = find(changes, i, -1, 0, REACH_BETWEEN);
    int far = find(changes, i, 1, 0, REACH_BETWEEN);
    if (near == 0 || far == 0) {
        const int direction = near != 0 ? -1 : 1;
        near = find(changes, i, direction, 0, REACH_BEYOND);
        far = near != 0 ? find(changes, i, direction, near * direction, REACH_BEYOND) : 0;
        if (far == 0)
            return 0.0f;
    }
    const float share = (float)far / (float)(far - near); /* of the nearer one, on the line through both */
    float difference[3];
    memcpy(difference, changes->change[i], sizeof difference);
    vec3_add_scaled(difference, -share, changes->change[i + near]);
    vec3_add_scaled(difference, share - 1.0f, changes->change[i + far]);
    const float tolerance = near == -1 && far == 1 ? TOLERANCE : TOLERANCE_AT_END;
    const float motion = 0.5f * (changes->length[i + near] + changes->length[i + far]);
    return vec3_norm(difference) / (tolerance * changes->size + TOLERANCE_MOVING * motion);
}

static float worst_of(const struct changes *changes, int from, int to, int *index) {
    float worst = 0.0f;
    for (int i = from; i <= to; i++) {
        const float value = has(changes->good, i) ? contradiction(changes, i) : 0.0f;
        if (value > worst) {
            worst = value;
            *index = i;
        }
    }
    return worst;
}

/* Of sensor i and its neighbours, the one without which those around agree best. */
static int culprit_near(const struct changes *changes, int i) {
    struct changes others = *changes;
    int culprit = i;
    float least = INFINITY;
    for (int candidate = i - 1; candidate <= i + 1; candidate++) {
        if (!has(changes->good, candidate))
            continue;
        int unused;
        others.good = without(changes->good, candidate);
        const float left = worst_of(&others, i - REACH_BEYOND, i + REACH_BEYOND, &unused);
        if (left < least) {
            least = left;
            culprit = candidate;
        }
    }
    return culprit;
}

/* Takes those out of changes->good that contradict the rest, and returns them. */
static uint16_t find_found(struct changes *changes) {
    uint16_t found = 0u;
    for (int rounds = 0; rounds < FOUND_MAX; rounds++) {
        int worst = 0;
        if (worst_of(changes, 0, COUNT - 1, &worst) <= 1.0f)
            break;
        const int culprit = culprit_near(changes, worst);
        changes->good = without(changes->good, culprit);
        found |= (uint16_t)(1u << culprit);
    }
    return found;
}

/* What a sensor read while it drifted and nobody knew is nothing to compare it with later. */
static void name(struct drift *drift, uint16_t sensors) {
    drift->named |= sensors;
    for (unsigned i = 0; i < DRIFT_SNAPSHOTS; i++)
        if (i != drift->oldest)
            drift->taken[i] &= (uint16_t)~sensors;
}

static void take_snapshot(struct drift *drift, const struct plausibility_input *input, uint16_t trusted,
                          uint32_t now_us) {
    memcpy(drift->snapshots[drift->oldest], input->readings, sizeof input->readings);
    drift->taken[drift->oldest] = trusted;
    drift->oldest = (uint8_t)((drift->oldest + 1u) % DRIFT_SNAPSHOTS);
    drift->snapshot_us = now_us;
}

void drift_reset(struct drift *drift) {
    memset(drift->taken, 0, sizeof drift->taken);
    drift->doubted = drift->named = 0u;
}

bool drift_is_due(const struct drift *drift, uint32_t now_us) {
    return now_us - drift->look_us >= LOOK_US;
}

uint16_t drift_look(struct drift *drift, const struct plausibility_input *input, uint16_t trusted,
                    uint32_t now_us) {
    drift->look_us = now_us;
    struct changes changes = {.size = input->size};
    uint16_t known = 0u;
    for (int i = 0; i < COUNT; i++) {
        if (!input->present[i] || !has((trusted | drift->named) & drift->taken[drift->oldest], i))
            continue;
        vec3_subtract(input->readings[i], drift->snapshots[drift->oldest][i], changes.change[i]);
        changes.length[i] = vec3_norm(changes.change[i]);
        known |= (uint16_t)(1u << i);
    }
    changes.good = (uint16_t)(known & ~drift->named);

    const uint16_t found = find_found(&changes);
    const uint16_t before = drift->named;
    for (int i = 0; i < COUNT; i++)
        if (has(before, i) && !(has(known, i) && contradiction(&changes, i) > 1.0f))
            drift->named = without(drift->named, i);
    name(drift, found & drift->doubted);
    drift->doubted = found;

    /* While a sensor is named, all are compared with what they read before. */
    if (drift->named != 0u && before == 0u)
        drift->named_us = now_us;
    if (drift->named != 0u && now_us - drift->named_us > NAMED_MAX_US)
        drift_reset(drift);
    else if (drift->named == 0u && now_us - drift->snapshot_us >= SNAPSHOT_US)
        take_snapshot(drift, input, trusted, now_us);
    return drift->named;
}
