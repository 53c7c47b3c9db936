/* How a part is found, configured, and checked while it runs. */
#include "slot_bring_up.h"

#include <string.h>

/* A part that was not found is looked for anew: at first it may just be starting, later it is missing. */
static const uint32_t RETRY_FIRST_US = 25000u;
static const uint32_t RETRY_US = 250000u;
static const uint8_t FIRST_ROUNDS = 10u;

bool slot_is_silent(const uint8_t *bytes, size_t n) {
    for (size_t i = 0; i < n; i++)
        if (bytes[i] != bytes[0])
            return false;
    return bytes[0] == 0x00u || bytes[0] == 0xFFu;
}

/* A hash of an answer, to know it again (FNV-1a); never 0. */
static uint32_t hash_of(uint32_t hash, const uint8_t *bytes, size_t n) {
    for (size_t i = 0; i < n; i++)
        hash = (hash ^ bytes[i]) * 16777619u;
    return hash | 1u;
}

void slot_set_reason(struct slot *slot, enum wire_slot_reason reason) {
    if (slot->reason != WIRE_SLOT_REASON_NOISY)
        slot->reason = (uint8_t)reason;
}

void slot_lose(struct slot *slot, bool may_be_configured, uint32_t now_us) {
    slot->state = SLOT_IDENTIFY;
    slot->probes = 0u;
    slot->rounds = 0u;
    slot->doubts = 0u;
    slot->doubted = 0u;
    slot->has_answered = false;
    slot->may_be_configured = may_be_configured;
    slot->is_usable = false;
    slot->due_us = now_us;
}

void slot_run(struct slot *slot, uint32_t now_us) {
    slot->state = SLOT_RUN;
    slot->is_outdated = false;
    slot->doubts = 0u;
    slot->has_sample = false;
    slot->is_started = false;
    slot->late_count = 0u;
    slot->sample_us = slot->usable_us = now_us;
    slot->due_us = now_us + SLOT_CHECK_US;
    bridge_offset_reset(&slot->bridge);
}

/* What a check of a running part read. A wrong answer counts when it comes twice; if another comes, or the
 * right one, the line is noisy. Returns whether the part is not what it was. */
static bool is_lost(struct slot *slot, bool is_right, const uint8_t *answer, size_t n, uint32_t now_us) {
    if (is_right) {
        if (slot->doubts > 0u)
            slot_mark_implausible(slot, true, now_us);
        slot->doubts = 0u;
        return false;
    }
    const uint32_t hash = hash_of(0u, answer, n);
    if (slot_is_silent(answer, n) || (slot->doubts > 0u && hash == slot->doubted))
        return true;
    if (slot->doubts > 0u)
        slot_mark_implausible(slot, true, now_us);
    slot->doubts = 1u;
    slot->doubted = hash;
    slot->checks_identity = !slot->checks_identity; /* the same check again */
    slot->due_us = now_us;
    return false;
}

static void end_round(struct slot *slot, uint32_t now_us) {
    /* Something that never answers twice alike is no part of another kind. */
    if (!slot->has_answered)
        slot->reason = WIRE_SLOT_REASON_ABSENT;
    else if (slot->rounds == 0u ? slot->reason == WIRE_SLOT_REASON_NOISY : slot->answers != slot->doubted)
        slot->reason = WIRE_SLOT_REASON_NOISY;
    else
        slot->reason = WIRE_SLOT_REASON_WRONG_ID;
    slot->doubted = slot->answers;
    slot->is_found = false;
    slot->probes = 0u;
    slot->has_answered = false;
    if (slot->rounds < UINT8_MAX)
        slot->rounds++;
    slot->due_us = now_us + (slot->rounds <= FIRST_ROUNDS ? RETRY_FIRST_US : RETRY_US);
}

static void end_probe(struct slot *slot, const struct part *part, bool is_right, const uint8_t *answer,
                      uint32_t now_us) {
    if (is_right && part->kind == (enum part_kind)slot->kind) {
        const bool is_known = slot->is_found && slot->may_be_configured && part->config_read_command != 0u;
        slot->is_found = true;
        if (slot->reason == WIRE_SLOT_REASON_ABSENT || slot->reason == WIRE_SLOT_REASON_WRONG_ID)
            slot->reason = WIRE_SLOT_REASON_NOT_CONFIGURED;
        slot->state = is_known ? SLOT_CHECK : part->has_reset ? SLOT_RESET : SLOT_CONFIGURE;
        return;
    }
    if (slot->probes == 0u)
        slot->answers = 0u;
    slot->answers = hash_of(slot->answers, answer, part->identity_count);
    slot->has_answered = slot->has_answered || !slot_is_silent(answer, part->identity_count);
    slot->part_index = (uint8_t)((slot->part_index + 1u) % PART_COUNT);
    slot->may_be_configured = false;
    slot->probes++;
    if (slot->probes == PART_COUNT)
        end_round(slot, now_us);
}

void slot_end_identity(struct slot *slot, const struct part *part, uint32_t now_us, const uint8_t *answer) {
    const bool is_right = memcmp(answer, part->identity, part->identity_count) == 0;
    if (slot->state != SLOT_RUN) {
        end_probe(slot, part, is_right, answer, now_us);
    } else if (is_lost(slot, is_right, answer, part->identity_count, now_us)) {
        slot_set_reason(slot, slot_is_silent(answer, part->identity_count) ? WIRE_SLOT_REASON_ABSENT
                                                                           : WIRE_SLOT_REASON_NOT_CONFIGURED);
        slot_lose(slot, true, now_us);
    }
}

void slot_end_read_config(struct slot *slot, const struct part *part, const struct part_config *config,
                          uint32_t now_us, const uint8_t *answer) {
    bool is_right = true;
    for (unsigned i = 0; i < part->config_count; i++)
        if (((answer[i] ^ config->registers[i]) & config->mask[i]) != 0u)
            is_right = false;
    if (slot->state == SLOT_RUN) {
        if (is_lost(slot, is_right, answer, part->config_count, now_us)) {
            slot_set_reason(slot, slot_is_silent(answer, part->config_count)
                                      ? WIRE_SLOT_REASON_ABSENT
                                      : WIRE_SLOT_REASON_NOT_CONFIGURED);
            slot_lose(slot, false, now_us);
        }
    } else if (is_right) {
        slot_run(slot, now_us);
    } else {
        const bool was_just_configured = !slot->may_be_configured;
        slot_set_reason(slot, WIRE_SLOT_REASON_NOT_CONFIGURED);
        slot_lose(slot, false, now_us);
        if (was_just_configured)
            slot->due_us = now_us + RETRY_FIRST_US;
    }
}
