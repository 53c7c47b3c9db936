/* Bytes of a LIS2DW12 burst to counts. */
#include "sensors/lis2dw12.h"
#include "sensors/lis2dw12_regs.h"

void lis2dw12_decode(const uint8_t *burst, struct part_sample *sample) {
    sample->is_new = (burst[0] & LIS2DW12_STATUS_DRDY) != 0u;
    sample->is_saturated = false;
    sample->is_configured = true; /* its control registers are read back, not part of the burst */
    for (unsigned axis = 0; axis < 3u; axis++) {
        const uint8_t *const bytes = burst + 1u + 2u * axis;
        const int32_t left_justified = (int16_t)(uint16_t)(bytes[0] | (bytes[1] << 8));
        const int32_t count = left_justified / (1 << (16 - LIS2DW12_COUNT_BITS));
        sample->counts[axis] = count;
        if (count >= LIS2DW12_COUNT_MAX || count <= LIS2DW12_COUNT_MIN)
            sample->is_saturated = true;
    }
}
