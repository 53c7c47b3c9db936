/* How a part is found, configured, and checked while it runs: slot.c's other half, for slot.c only. */
#ifndef SLOT_BRING_UP_H
#define SLOT_BRING_UP_H

#include "slot.h"
#include "wire.h" /* enum wire_slot_reason */

/* Between two checks of a running part, of its identity and its configuration in turn, microseconds. */
#define SLOT_CHECK_US 100000u

/* Whether an answer is that of an empty bus, all ones or all zeros. */
bool slot_is_silent(const uint8_t *bytes, size_t n);

/* Tells why a slot is not usable, unless its line is noisy: then nothing else that was read is known for
 * sure. */
void slot_set_reason(struct slot *slot, enum wire_slot_reason reason);

/* Stops reading the part until it was found again, and was configured again unless it still is. */
void slot_lose(struct slot *slot, bool may_be_configured, uint32_t now_us);

/* The part is configured: it is read from now on. */
void slot_run(struct slot *slot, uint32_t now_us);

/* Take what the identity or the control registers read, of a part that is brought up or of one that runs. */
void slot_end_identity(struct slot *slot, const struct part *part, uint32_t now_us, const uint8_t *answer);
void slot_end_read_config(struct slot *slot, const struct part *part, const struct part_config *config,
                          uint32_t now_us, const uint8_t *answer);

#endif
