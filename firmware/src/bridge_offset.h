/* The offset of an AMR bridge, told from the field by flipping the bridge between samples.
 *
 * With set polarity a bridge reads field + offset, reversed -field + offset: the mean of two samples of
 * opposite polarity is the offset, wrong by half of what the field changed between them. That error has the
 * other sign when the bridge is flipped back, so that a slow mean over the pairs is not moved by steady
 * motion. */
#ifndef BRIDGE_OFFSET_H
#define BRIDGE_OFFSET_H

#include <stdbool.h>
#include <stdint.h>

struct bridge_offset {
    float offset[3];     /* counts */
    int32_t previous[3]; /* sample before, as read, counts */
    uint8_t previous_polarity;
    bool has_previous;
    uint16_t pairs; /* that the offset is a mean of, stops at pairs_max */
};

void bridge_offset_reset(struct bridge_offset *bridge);

/* Takes one sample. Replaces counts (as read) by the field's, rounded, and returns true as soon as a pair of
 * opposite polarities was seen; false, and counts unchanged, before. pairs_max: length of the mean. */
bool bridge_offset_cancel(struct bridge_offset *bridge, unsigned polarity, uint16_t pairs_max,
                          int32_t counts[3]);

#endif
