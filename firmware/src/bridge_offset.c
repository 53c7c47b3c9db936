/* The offset of an AMR bridge, told from the field by flipping the bridge between samples. */
#include "bridge_offset.h"

#include <string.h>

void bridge_offset_reset(struct bridge_offset *bridge) {
    *bridge = (struct bridge_offset){.pairs = 0u};
}

static int32_t rounded(float x) {
    return (int32_t)(x < 0.0f ? x - 0.5f : x + 0.5f);
}

bool bridge_offset_cancel(struct bridge_offset *bridge, unsigned polarity, uint16_t pairs_max,
                          int32_t counts[3]) {
    if (bridge->has_previous && bridge->previous_polarity != polarity) {
        if (bridge->pairs < pairs_max)
            bridge->pairs++;
        const float gain = 1.0f / (float)bridge->pairs;
        for (unsigned i = 0; i < 3u; i++) {
            const float mean = 0.5f * (float)(counts[i] + bridge->previous[i]);
            bridge->offset[i] += gain * (mean - bridge->offset[i]);
        }
    }
    bridge->has_previous = true;
    bridge->previous_polarity = (uint8_t)polarity;
    memcpy(bridge->previous, counts, sizeof bridge->previous);
    if (bridge->pairs == 0u)
        return false;
    for (unsigned i = 0; i < 3u; i++) {
        const float field = (float)counts[i] - bridge->offset[i];
        counts[i] = rounded(polarity == 0u ? field : -field);
    }
    return true;
}
