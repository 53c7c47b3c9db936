/* One slot of the sensor string: which transaction is next, and what its answer means.
 *
 * A slot is selected once in a pass, so that everything that takes several transactions (finding the part,
 * resetting, configuring, checking) goes on in the passes that follow, while the other slots are read. */
#ifndef SLOT_H
#define SLOT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "bridge_offset.h"
#include "sensors/part.h"

/* What the passes of a scan are for. */
enum slot_pass {
    SLOT_PASS_POLARISE, /* flips bridges */
    SLOT_PASS_TRIGGER,  /* starts measurements */
    SLOT_PASS_READ,     /* reads samples */
    SLOT_PASS_PATROL,   /* brings up what does not run; checks identity and configuration of what does */
};

enum slot_state { SLOT_IDENTIFY, SLOT_RESET, SLOT_CONFIGURE, SLOT_CHECK, SLOT_RUN };

enum slot_transaction {
    SLOT_NOTHING,
    SLOT_READ_IDENTITY,
    SLOT_WRITE_RESET,
    SLOT_WRITE_CONFIG,
    SLOT_READ_CONFIG,
    SLOT_WRITE_POLARITY,
    SLOT_WRITE_TRIGGER,
    SLOT_READ_SAMPLE,
};

#define SLOT_TRANSFER_MAX (1u + PART_BURST_MAX)

/* The same for all slots of a string. */
struct slot_setup {
    struct part_config configs[PART_COUNT]; /* by index of the part */
    uint32_t scan_us;                       /* from a scan to the next */
    uint16_t bridge_pairs;                  /* length of the mean that finds a bridge's offset */
};

struct slot {
    uint8_t kind;        /* enum part_kind that belongs here */
    uint8_t state;       /* enum slot_state */
    uint8_t transaction; /* enum slot_transaction under way */
    uint8_t part_index;  /* of the part found last, or being looked for */
    uint8_t probes;      /* parts looked for in this round */
    uint8_t reason;      /* enum wire_slot_reason */
    uint8_t polarity;    /* of the measurement under way */
    uint8_t samples_since_flip;
    bool is_found;          /* part_index is the part that is there */
    bool has_answered;      /* some probe of this round read other than all ones or all zeros */
    bool may_be_configured; /* it ran before it was lost: check before resetting it */
    uint8_t rounds;         /* of looking for all parts, in a row, without success; stops at 255 */
    uint8_t doubts;         /* wrong answers to checks in a row, none of them twice */
    bool is_outdated;       /* runs, but with the configuration of another rate */
    bool checks_identity;   /* what the next check of a running part looks at: identity, or configuration */
    bool is_usable;         /* counts are a reading of this scan */
    bool has_sample;        /* since the part runs */
    bool is_started;        /* a measurement, since the part runs */
    bool is_implausible;    /* implausible_us counts */
    uint8_t late_count;     /* measurements in a row that ended only after they were read */
    uint16_t same_count;    /* new samples in a row with the same counts */
    uint16_t errors;        /* scans without a usable reading, stops at 65535 */

    uint32_t answers;        /* of this round, as a hash */
    uint32_t doubted;        /* what the wrong answer was, as a hash; 0: there was none */
    uint32_t due_us;         /* when it has something to do in a patrol */
    uint32_t sample_us;      /* when the last new sample was read */
    uint32_t change_us;      /* when a sample last differed from the one before */
    uint32_t usable_us;      /* when the reading was last usable */
    uint32_t implausible_us; /* when a reading last did not fit in with its neighbours */
    int32_t as_read[3];      /* counts of the last burst */
    int32_t counts[3];       /* of the last sample that passed, offset cancelled */
    struct bridge_offset bridge;
};

/* A slot that nothing is known of. */
void slot_init(struct slot *slot, enum part_kind kind, uint32_t now_us);

/* Whether the bridge of the slot should be flipped before the next measurement. */
bool slot_wants_flip(const struct slot *slot);

/* The part in the slot, NULL if none was found. */
const struct part *slot_part(const struct slot *slot);

/* Writes what the slot exchanges in this pass to tx (SLOT_TRANSFER_MAX bytes, zeros on entry) and returns the
 * length; 0: nothing. */
size_t slot_begin(struct slot *slot, const struct slot_setup *setup, enum slot_pass pass, uint32_t now_us,
                  uint8_t *tx);

/* Takes the answer to what slot_begin() asked for, as many bytes. */
void slot_end(struct slot *slot, const struct slot_setup *setup, uint32_t now_us, const uint8_t *rx);

/* Marks the reading of this scan as not fitting in with its neighbours; jumped: it also differs much from the
 * reading of the scan before. The slot stays unusable until its readings have fitted for a while. */
void slot_mark_implausible(struct slot *slot, bool jumped, uint32_t now_us);

/* Ends a scan: settles reason and errors, and starts over with a part that was not usable for long. */
void slot_judge(struct slot *slot, uint32_t now_us);

/* Tells a running part that the rate changed. */
void slot_reconfigure(struct slot *slot, uint32_t now_us);

/* x, y, z counts of the scan: as used if the slot is usable or only does not fit in with the others, else as
 * read. */
const int32_t *slot_reading(const struct slot *slot);

#endif
