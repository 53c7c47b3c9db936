/* The string of sensors: walks the select chain, reads all slots, and turns readings into vectors. */
#include "sensor_string.h"

#include <math.h>
#include <string.h>

#include "plausibility.h"
#include "select_chain.h"
#include "vec3.h"

/* After power-up no part answers before this. */
static const uint32_t POWER_UP_US = 20000u;

/* Time for the two passes that start the measurements, before the first slot of the scan is read. */
static const uint32_t START_US = 300u;

/* The offset of a bridge moves with temperature, in minutes; the mean that tracks it is over this time, and
 * never over fewer pairs than make its noise small against that of a reading. */
static const uint32_t BRIDGE_TIME_S = 4u;
static const uint16_t BRIDGE_PAIRS_MIN = 32u;

static const float STANDARD_GRAVITY_MPS2 = 9.80665f;

/* A reading this many times as large as it should be is none. */
static const float SIZE_MAX_RATIO = 3.0f;

/* A reading that differs from the one before by this share of its size, and from its neighbours, has jumped.
 */
static const float JUMP = 0.2f;

static void transact(struct sensor_string *string, struct board *board, struct slot *slot,
                     enum slot_pass pass, uint32_t now_us) {
    uint8_t bytes[SLOT_TRANSFER_MAX] = {0u};
    const size_t n = slot_begin(slot, &string->setup, pass, now_us, bytes);
    if (n == 0u)
        return;
    board_spi_transfer(board, bytes, bytes, n);
    slot_end(slot, &string->setup, now_us, bytes);
}

/* Whether the slot has anything to do with a pass; said quickly for what only needs to be read. */
static bool takes_part(const struct sensor_string *string, const struct slot *slot, enum slot_pass pass) {
    return pass == SLOT_PASS_READ || pass == SLOT_PASS_PATROL ||
           string->setup.configs[slot->part_index].measurement_us > 0u;
}

/* One walk along the select chain, one transaction a slot. */
static void walk(struct sensor_string *string, struct board *board, enum slot_pass pass) {
    const uint32_t now_us = board_now_us(board);
    select_chain_first(board);
    for (unsigned i = 0; i < RIBBON_SLOT_COUNT; i++) {
        if (takes_part(string, &string->slots[i], pass))
            transact(string, board, &string->slots[i], pass, now_us);
        select_chain_next(board);
    }
}

static const struct part_config *config_of(const struct sensor_string *string, unsigned slot) {
    return &string->setup.configs[string->slots[slot].part_index];
}

static void survey(struct sensor_string *string, uint32_t now_us) {
    uint32_t longest_us = 0u;
    int32_t until_due_us = INT32_MAX;
    string->is_settled = true;
    string->is_flip_wanted = false;
    for (unsigned i = 0; i < RIBBON_SLOT_COUNT; i++) {
        const struct slot *const slot = &string->slots[i];
        const uint32_t measurement_us = config_of(string, i)->measurement_us;
        const int32_t until_us = (int32_t)(slot->due_us - now_us);
        if (slot->state == SLOT_RUN && measurement_us > longest_us)
            longest_us = measurement_us;
        if (until_us < until_due_us)
            until_due_us = until_us;
        if (slot->reason == WIRE_SLOT_REASON_NOT_CONFIGURED)
            string->is_settled = false;
        if (measurement_us > 0u && slot_wants_flip(slot))
            string->is_flip_wanted = true;
    }
    string->lead_us = longest_us > 0u ? longest_us + START_US : 0u;
    string->patrol_due_us = now_us + (uint32_t)until_due_us;
}

static void configure(struct sensor_string *string, uint32_t rate_hz) {
    const uint32_t pairs = BRIDGE_TIME_S * rate_hz;
    string->setup.scan_us = 1000000u / rate_hz;
    string->setup.bridge_pairs = pairs > BRIDGE_PAIRS_MIN ? (uint16_t)pairs : BRIDGE_PAIRS_MIN;
    for (size_t i = 0; i < PART_COUNT; i++)
        part_configure(PARTS[i], rate_hz, &string->setup.configs[i]);
}

void sensor_string_init(struct sensor_string *string, struct board *board, uint32_t rate_hz) {
    memset(string, 0, sizeof *string);
    const uint32_t now_us = board_now_us(board);
    for (unsigned i = 0; i < RIBBON_SLOT_COUNT; i++)
        slot_init(&string->slots[i], i % 2u == 0u ? PART_ACCELEROMETER : PART_MAGNETOMETER,
                  now_us + POWER_UP_US);
    configure(string, rate_hz);
    select_chain_flush(board, RIBBON_SLOT_COUNT);
    survey(string, now_us);
}

void sensor_string_set_rate(struct sensor_string *string, struct board *board, uint32_t rate_hz) {
    const uint32_t now_us = board_now_us(board);
    configure(string, rate_hz);
    for (unsigned i = 0; i < RIBBON_SLOT_COUNT; i++)
        slot_reconfigure(&string->slots[i], now_us);
    survey(string, now_us);
}

void sensor_string_start(struct sensor_string *string, struct board *board) {
    if (string->is_flip_wanted)
        walk(string, board, SLOT_PASS_POLARISE);
    walk(string, board, SLOT_PASS_TRIGGER);
}

static bool has_two_axes(const struct calibration *calibration, unsigned slot) {
    return slot % 2u == 1u && calibration->values.mag_axes == 2u;
}

/* The reading of a slot, calibrated; false if it is not finite or absurdly large. */
static bool convert(struct sensor_string *string, unsigned i, const struct calibration *calibration,
                    float size) {
    const float lsb = config_of(string, i)->lsb;
    float reading[3];
    for (unsigned axis = 0; axis < 3u; axis++)
        reading[axis] = lsb * (float)string->slots[i].counts[axis];
    calibration_apply(&calibration->values.slots[i], reading, string->reading[i]);
    if (has_two_axes(calibration, i)) {
        /* The part's z axis is not used: whatever it read lies along the direction without measurement. */
        const float *const blind = calibration->blind[i / 2u];
        vec3_add_scaled(string->reading[i], -vec3_dot(string->reading[i], blind), blind);
    }
    return vec3_norm(string->reading[i]) < SIZE_MAX_RATIO * size; /* false for NaN */
}

/* Which sensors of a kind are seen to drift; suspect: those that do not fit in anyway. */
static uint16_t find_drifting(struct sensor_string *string, const struct plausibility_input *input,
                              const bool suspect[RIBBON_NODE_COUNT], unsigned first, uint32_t now_us) {
    uint16_t trusted = 0u;
    if (!drift_is_due(&string->drifts[first], now_us))
        return 0u;
    for (unsigned k = 0; k < RIBBON_NODE_COUNT; k++)
        if (input->present[k] && !suspect[k] && !string->slots[2u * k + first].is_implausible)
            trusted |= (uint16_t)(1u << k);
    return drift_look(&string->drifts[first], input, trusted, now_us);
}

/* Judges the readings of one kind, those of slots first, first + 2, ... */
static void judge(struct sensor_string *string, const struct calibration *calibration, unsigned first,
                  float size, uint32_t now_us) {
    struct plausibility_input input;
    input.size = size;
    input.has_two_axes = has_two_axes(calibration, first);
    bool suspect[RIBBON_NODE_COUNT];
    for (unsigned k = 0; k < RIBBON_NODE_COUNT; k++) {
        const unsigned i = 2u * k + first;
        struct slot *const slot = &string->slots[i];
        suspect[k] = slot->is_implausible;
        input.present[k] = false;
        if (!slot->is_usable)
            continue;
        memcpy(string->previous[i], string->reading[i], sizeof string->previous[i]);
        input.present[k] = convert(string, i, calibration, size);
        if (!input.present[k])
            slot_mark_implausible(slot, false, now_us);
        memcpy(input.readings[k], string->reading[i], sizeof input.readings[k]);
    }
    plausibility_check(&input, suspect);
    const uint16_t drifting = find_drifting(string, &input, suspect, first, now_us);
    for (unsigned k = 0; k < RIBBON_NODE_COUNT; k++) {
        const unsigned i = 2u * k + first;
        struct slot *const slot = &string->slots[i];
        if (suspect[k]) {
            const float jump = JUMP * size;
            const bool jumped = string->has_previous[i] &&
                                vec3_distance_squared(string->reading[i], string->previous[i]) > jump * jump;
            slot_mark_implausible(slot, jumped, now_us);
        } else if ((drifting >> k & 1u) != 0u) {
            slot_mark_implausible(slot, false, now_us);
        }
        string->has_previous[i] = input.present[k];
        slot_judge(slot, now_us);
    }
}

uint32_t sensor_string_read(struct sensor_string *string, struct board *board) {
    walk(string, board, SLOT_PASS_READ);
    return board_now_us(board);
}

void sensor_string_judge(struct sensor_string *string, const struct calibration *calibration,
                         uint32_t now_us) {
    const float horizontal_ut = calibration->values.field_horizontal_ut;
    const float down_ut = calibration->values.field_down_ut;
    judge(string, calibration, 0u, STANDARD_GRAVITY_MPS2, now_us);
    judge(string, calibration, 1u, sqrtf(horizontal_ut * horizontal_ut + down_ut * down_ut), now_us);
    survey(string, now_us);
}

void sensor_string_recalibrated(struct sensor_string *string) {
    drift_reset(&string->drifts[0]);
    drift_reset(&string->drifts[1]);
}

void sensor_string_patrol(struct sensor_string *string, struct board *board) {
    walk(string, board, SLOT_PASS_PATROL);
    survey(string, board_now_us(board));
}

float sensor_string_lsb(const struct sensor_string *string, unsigned slot) {
    return string->slots[slot].is_found ? config_of(string, slot)->lsb : 0.0f;
}

float sensor_string_noise(const struct sensor_string *string, unsigned slot) {
    return string->slots[slot].is_found ? config_of(string, slot)->noise : 0.0f;
}

uint32_t sensor_string_age_us(const struct sensor_string *string, unsigned slot) {
    const struct part_config *const config = config_of(string, slot);
    return config->measurement_us > 0u ? string->lead_us - config->middle_us : config->middle_us;
}

static uint16_t at_most_u16(uint32_t value) {
    return value < UINT16_MAX ? (uint16_t)value : UINT16_MAX;
}

struct sensor_timing sensor_string_timing(const struct sensor_string *string, unsigned first,
                                          uint32_t scan_us) {
    unsigned slot = first;
    while (slot < RIBBON_SLOT_COUNT && !string->slots[slot].is_found)
        slot += 2u;
    if (slot >= RIBBON_SLOT_COUNT)
        return (struct sensor_timing){0};
    const struct part_config *const config = config_of(string, slot);
    const bool is_asked = config->measurement_us > 0u;
    return (struct sensor_timing){
        .age_us = at_most_u16(sensor_string_age_us(string, slot) + scan_us / 2u),
        .period_us = is_asked ? 0u : at_most_u16((uint32_t)(1e6f / config->sample_hz)),
        .span_us = at_most_u16(config->span_us),
    };
}
