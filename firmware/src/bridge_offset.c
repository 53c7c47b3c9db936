/* The offset of an AMR bridge, told from the field by flipping the bridge between samples. */
#include "bridge_offset.h"

void bridge_offset_reset(struct bridge_offset *bridge) {
    *bridge = (struct bridge_offset){.pairs = 0u};
}

static int32_t rounded(float x) {
    return (int32_t)(x < 0.0f ? x - 0.5f : x + 0.5f);
}

bool bridge_offset_cancel(struct bridge_offset *bridge, unsigned polarity, uint16_t pairs_max,
                          int32_t counts[3]) {
    const bool is_pair = bridge->has_previous && bridge->previous_polarity != polarity;
    if (is_pair && bridge->pairs < pairs_max)
        bridge->pairs++;
    const float gain = is_pair ? 1.0f / (float)bridge->pairs : 0.0f;
    const bool is_known = bridge->pairs > 0u;
    for (unsigned i = 0; i < 3u; i++) {
        const int32_t as_read = counts[i];
        const float mean = 0.5f * (float)(as_read + bridge->previous[i]);
        bridge->offset[i] += gain * (mean - bridge->offset[i]);
        bridge->previous[i] = as_read;
        const float field = (float)as_read - bridge->offset[i];
        if (is_known)
            counts[i] = rounded(polarity == 0u ? field : -field);
    }
    bridge->has_previous = true;
    bridge->previous_polarity = (uint8_t)polarity;
    return is_known;
}
