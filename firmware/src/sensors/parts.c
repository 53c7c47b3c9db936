/* The list of sensor parts: the only place that knows all of them. */
#include "sensors/part.h"

#include "sensors/hmc5983.h"
#include "sensors/lis2dw12.h"
#include "sensors/mmc5983ma.h"

/* A hand-held ribbon stays within 2 g, the range with the least noise. */
static const uint32_t ACCELEROMETER_RANGE_G = 2u;

const struct part *const PARTS[PART_COUNT] = {&LIS2DW12_PART, &MMC5983MA_PART, &HMC5983_PART};

/* A switch instead of function pointers, so that the stack's depth can be computed from the call graph. */
void part_configure(const struct part *part, uint32_t rate_hz, struct part_config *config) {
    switch (part->id) {
    case WIRE_PART_LIS2DW12:
        lis2dw12_configure(rate_hz, ACCELEROMETER_RANGE_G, config);
        break;
    case WIRE_PART_MMC5983MA:
        mmc5983ma_configure(rate_hz, config);
        break;
    case WIRE_PART_HMC5983:
        hmc5983_configure(rate_hz, config);
        break;
    case WIRE_PART_NONE:
        break;
    }
}

void part_decode(const struct part *part, const uint8_t *burst, struct part_sample *sample) {
    switch (part->id) {
    case WIRE_PART_LIS2DW12:
        lis2dw12_decode(burst, sample);
        break;
    case WIRE_PART_MMC5983MA:
        mmc5983ma_decode(burst, sample);
        break;
    case WIRE_PART_HMC5983:
        hmc5983_decode(burst, sample);
        break;
    case WIRE_PART_NONE:
        break;
    }
}
