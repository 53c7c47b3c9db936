/* One slot of the sensor string: which transaction is next, and what its answer means. */
#include "slot.h"

#include <string.h>

#include "slot_bring_up.h"
#include "wire.h"

/* A part that was not usable for so long is looked for anew. */
static const uint32_t UNUSABLE_MAX_US = 500000u;
/* One that reads well what only does not fit in with the others is seldom cured by that, and a calibration
 * needs its readings without gaps. */
static const uint32_t OUT_OF_RANGE_MAX_US = 60000000u;

/* A new sample is overdue after so many sample periods of the part. */
static const float STALE_PERIODS = 4.0f;
/* One scan without a new sample is bridged all the same, unless the sample before is older than this by then.
 */
static const uint32_t BRIDGED_MAX_US = 50000u;

/* Noise repeats a reading now and then; over this time, and so many samples, it does not. */
static const uint32_t STUCK_US = 300000u;
static const uint16_t STUCK_SAMPLES = 8u;
/* Three readings of 18 bits do not repeat. */
static const uint16_t STUCK_SAMPLES_FINE = 2u;

/* The offset of a bridge is found by flipping it for every sample; after so many pairs it moves with
 * temperature only, and every so many samples are enough. */
static const uint16_t FLIP_ALWAYS_PAIRS = 32u;
static const uint8_t FLIP_INTERVAL = 4u;

/* A measurement that ends too late twice in a row takes longer than it was configured to. */
static const uint8_t LATE_MAX = 2u;

/* Readings must have fitted in with their neighbours for so long. */
static const uint32_t IMPLAUSIBLE_US = 300000u;

static bool is_past(uint32_t t_us, uint32_t now_us) {
    return (int32_t)(now_us - t_us) >= 0;
}

void slot_init(struct slot *slot, enum part_kind kind, uint32_t now_us) {
    memset(slot, 0, sizeof *slot);
    slot->kind = (uint8_t)kind;
    slot->state = SLOT_IDENTIFY;
    slot->reason = WIRE_SLOT_REASON_NOT_CONFIGURED;
    while (PARTS[slot->part_index]->kind != kind)
        slot->part_index++;
    slot->due_us = slot->usable_us = now_us;
}

const struct part *slot_part(const struct slot *slot) {
    return slot->is_found ? PARTS[slot->part_index] : NULL;
}

const int32_t *slot_reading(const struct slot *slot) {
    const bool is_sample =
        slot->reason == WIRE_SLOT_REASON_OK || slot->reason == WIRE_SLOT_REASON_OUT_OF_RANGE;
    return is_sample && slot->has_sample ? slot->counts : slot->as_read;
}

void slot_reconfigure(struct slot *slot, uint32_t now_us) {
    if (slot->state != SLOT_RUN)
        return;
    slot->is_outdated = true;
    slot->due_us = now_us;
}

bool slot_wants_flip(const struct slot *slot) {
    return slot->state == SLOT_RUN && PARTS[slot->part_index]->has_polarity &&
           (slot->bridge.pairs < FLIP_ALWAYS_PAIRS || slot->samples_since_flip >= FLIP_INTERVAL);
}

static size_t command(uint8_t *tx, uint8_t first, size_t count) {
    tx[0] = first;
    return 1u + count;
}

static size_t begin_identity(struct slot *slot, const struct part *part, uint8_t *tx) {
    slot->transaction = SLOT_READ_IDENTITY;
    return command(tx, part->identity_command, part->identity_count);
}

static size_t begin_write_config(struct slot *slot, const struct part *part, const struct part_config *config,
                                 uint8_t *tx) {
    slot->transaction = SLOT_WRITE_CONFIG;
    tx[0] = part->config_write_command;
    memcpy(tx + 1, config->registers, part->config_count);
    return 1u + part->config_count;
}

static size_t begin_read_config(struct slot *slot, const struct part *part, uint8_t *tx) {
    slot->transaction = SLOT_READ_CONFIG;
    return command(tx, part->config_read_command, part->config_count);
}

static size_t begin_pair(struct slot *slot, enum slot_transaction transaction, const uint8_t pair[2],
                         uint8_t *tx) {
    slot->transaction = (uint8_t)transaction;
    memcpy(tx, pair, 2u);
    return 2u;
}

static size_t begin_patrol(struct slot *slot, const struct part *part, const struct part_config *config,
                           uint32_t now_us, uint8_t *tx) {
    if (!is_past(slot->due_us, now_us))
        return 0u;
    switch ((enum slot_state)slot->state) {
    case SLOT_IDENTIFY:
        return begin_identity(slot, part, tx);
    case SLOT_RESET:
        return begin_pair(slot, SLOT_WRITE_RESET, part->reset, tx);
    case SLOT_CONFIGURE:
        return begin_write_config(slot, part, config, tx);
    case SLOT_CHECK:
        return begin_read_config(slot, part, tx);
    case SLOT_RUN:
        break;
    }
    if (slot->is_outdated) {
        slot->is_outdated = false;
        return begin_write_config(slot, part, config, tx);
    }
    slot->due_us = now_us + SLOT_CHECK_US;
    slot->checks_identity = !slot->checks_identity || part->config_read_command == 0u;
    return slot->checks_identity ? begin_identity(slot, part, tx) : begin_read_config(slot, part, tx);
}

size_t slot_begin(struct slot *slot, const struct slot_setup *setup, enum slot_pass pass, uint32_t now_us,
                  uint8_t *tx) {
    const struct part *const part = PARTS[slot->part_index];
    const struct part_config *const config = &setup->configs[slot->part_index];
    slot->transaction = SLOT_NOTHING;
    if (pass == SLOT_PASS_PATROL)
        return begin_patrol(slot, part, config, now_us, tx);
    if (slot->state != SLOT_RUN)
        return 0u;
    switch (pass) {
    case SLOT_PASS_POLARISE:
        if (!slot_wants_flip(slot))
            return 0u;
        slot->samples_since_flip = 0u;
        slot->polarity ^= 1u;
        return begin_pair(slot, SLOT_WRITE_POLARITY, part->polarise[slot->polarity], tx);
    case SLOT_PASS_TRIGGER:
        slot->is_started = true;
        return config->measurement_us > 0u ? begin_pair(slot, SLOT_WRITE_TRIGGER, part->trigger, tx) : 0u;
    case SLOT_PASS_READ:
        slot->is_usable = false;
        if (config->measurement_us > 0u && !slot->is_started)
            return 0u;
        slot->transaction = SLOT_READ_SAMPLE;
        return command(tx, part->burst_command, part->burst_count);
    case SLOT_PASS_PATROL:
        break;
    }
    return 0u;
}

/* For how long the last sample serves. */
static uint32_t patience_us(const struct part_config *config, const struct slot_setup *setup) {
    const uint32_t of_part_us = (uint32_t)(STALE_PERIODS * 1e6f / config->sample_hz);
    const uint32_t of_scan_us = setup->scan_us + setup->scan_us / 2u;
    return of_scan_us > of_part_us && of_scan_us <= BRIDGED_MAX_US ? of_scan_us : of_part_us;
}

/* A sample that is not new: the last one serves for a while. */
static void take_old(struct slot *slot, const struct part *part, const struct slot_setup *setup,
                     bool has_changed, uint32_t now_us) {
    const struct part_config *const config = &setup->configs[slot->part_index];
    /* A measurement that was started, and ended after it was read, takes longer than configured. */
    slot->late_count = config->measurement_us > 0u && has_changed ? (uint8_t)(slot->late_count + 1u) : 0u;
    if (slot->late_count >= LATE_MAX && part->config_read_command == 0u) {
        slot_set_reason(slot, WIRE_SLOT_REASON_NOT_CONFIGURED);
        slot_lose(slot, false, now_us);
        return;
    }
    const bool is_stale = now_us - slot->sample_us > patience_us(config, setup);
    slot->is_usable = slot->has_sample && !is_stale;
    if (is_stale) {
        if (slot->reason != WIRE_SLOT_REASON_STALE) {
            /* It may have lost its configuration: look at once. */
            slot->due_us = now_us;
            slot->checks_identity = true;
        }
        slot->reason = WIRE_SLOT_REASON_STALE;
    }
}

static void take_new(struct slot *slot, const struct part *part, const struct slot_setup *setup,
                     struct part_sample *sample, bool has_changed, uint32_t now_us) {
    slot->sample_us = now_us;
    slot->late_count = 0u;
    slot->samples_since_flip++;
    if (has_changed) {
        slot->same_count = 0u;
        slot->change_us = now_us;
    } else if (slot->same_count < UINT16_MAX) {
        slot->same_count++;
    }

    const bool is_stuck = part->has_polarity
                              ? slot->same_count >= STUCK_SAMPLES_FINE
                              : slot->same_count >= STUCK_SAMPLES && now_us - slot->change_us > STUCK_US;
    if (is_stuck) {
        slot->reason = WIRE_SLOT_REASON_STUCK;
        slot->change_us = now_us - STUCK_US - 1u; /* the clock wraps in 71 minutes, and it stays stuck */
    } else if (sample->is_saturated) {
        slot->reason = WIRE_SLOT_REASON_SATURATED;
    } else if (!part->has_polarity ||
               bridge_offset_cancel(&slot->bridge, slot->polarity, setup->bridge_pairs, sample->counts)) {
        memcpy(slot->counts, sample->counts, sizeof slot->counts);
        slot->is_usable = true;
        slot->has_sample = true;
    }
}

static void end_sample(struct slot *slot, const struct part *part, const struct slot_setup *setup,
                       uint32_t now_us, const uint8_t *answer) {
    struct part_sample sample;
    /* Zeros may also be the outputs of a part that has not measured yet. */
    if (slot_is_silent(answer, part->burst_count) && (answer[0] != 0u || slot->has_sample)) {
        slot->reason = WIRE_SLOT_REASON_ABSENT;
        slot_lose(slot, true, now_us);
        return;
    }
    part_decode(part, answer, &sample);
    if (!sample.is_configured) {
        slot_set_reason(slot, WIRE_SLOT_REASON_NOT_CONFIGURED);
        slot_lose(slot, false, now_us);
        return;
    }
    bool has_changed = false;
    for (unsigned axis = 0; axis < 3u; axis++) {
        has_changed = has_changed || sample.counts[axis] != slot->as_read[axis];
        slot->as_read[axis] = sample.counts[axis];
    }
    if (sample.is_new)
        take_new(slot, part, setup, &sample, has_changed, now_us);
    else
        take_old(slot, part, setup, has_changed, now_us);
}

void slot_end(struct slot *slot, const struct slot_setup *setup, uint32_t now_us, const uint8_t *rx) {
    const struct part *const part = PARTS[slot->part_index];
    const uint8_t *const answer = rx + 1; /* what came while the command went out means nothing */
    switch ((enum slot_transaction)slot->transaction) {
    case SLOT_READ_IDENTITY:
        slot_end_identity(slot, part, now_us, answer);
        break;
    case SLOT_WRITE_RESET:
        slot->state = SLOT_CONFIGURE;
        /* The data sheets' times are typical ones, and both clocks are off by something. */
        slot->due_us = now_us + part->reset_us + part->reset_us / 4u;
        break;
    case SLOT_WRITE_CONFIG:
        if (slot->state == SLOT_RUN)
            break;
        if (part->config_read_command != 0u)
            slot->state = SLOT_CHECK;
        else
            slot_run(slot, now_us);
        break;
    case SLOT_READ_CONFIG:
        slot_end_read_config(slot, part, &setup->configs[slot->part_index], now_us, answer);
        break;
    case SLOT_READ_SAMPLE:
        end_sample(slot, part, setup, now_us, answer);
        break;
    case SLOT_WRITE_POLARITY:
    case SLOT_WRITE_TRIGGER:
    case SLOT_NOTHING:
        break;
    }
    slot->transaction = SLOT_NOTHING;
}

void slot_mark_implausible(struct slot *slot, bool jumped, uint32_t now_us) {
    if (!slot->is_implausible || jumped)
        slot->reason = jumped ? WIRE_SLOT_REASON_NOISY : WIRE_SLOT_REASON_OUT_OF_RANGE;
    slot->is_implausible = true;
    slot->implausible_us = now_us;
}

void slot_judge(struct slot *slot, uint32_t now_us) {
    if (slot->is_implausible && now_us - slot->implausible_us > IMPLAUSIBLE_US) {
        slot->is_implausible = false;
        /* What was read wrongly is in the mean that tells the offset: it is found anew. */
        if (PARTS[slot->part_index]->has_polarity) {
            bridge_offset_reset(&slot->bridge);
            slot->is_usable = false;
        }
    }
    if (slot->is_implausible)
        slot->is_usable = false;
    if (slot->is_usable) {
        slot->reason = WIRE_SLOT_REASON_OK;
        slot->usable_us = now_us;
        return;
    }
    if (slot->errors < UINT16_MAX)
        slot->errors++;
    const uint32_t unusable_max_us =
        slot->reason == WIRE_SLOT_REASON_OUT_OF_RANGE ? OUT_OF_RANGE_MAX_US : UNUSABLE_MAX_US;
    if (slot->state == SLOT_RUN && now_us - slot->usable_us > unusable_max_us) {
        if (slot->reason == WIRE_SLOT_REASON_OUT_OF_RANGE) {
            /* What is read until the bridge's offset is known again is no field. */
            slot->reason = WIRE_SLOT_REASON_NOT_CONFIGURED;
            slot->is_implausible = false;
        }
        slot_lose(slot, false, now_us);
    }
}
