/* Bytes of a MMC5983MA burst to counts. */
#include "sensors/mmc5983ma.h"
#include "sensors/mmc5983ma_regs.h"

void mmc5983ma_decode(const uint8_t *burst, struct part_sample *sample) {
    sample->is_new = (burst[MMC5983MA_STATUS] & MMC5983MA_STATUS_MEAS_M_DONE) != 0u;
    sample->is_saturated = false;
    sample->is_configured = true; /* its control registers cannot be read */
    for (unsigned axis = 0; axis < 3u; axis++) {
        const uint32_t high = burst[MMC5983MA_XOUT0 + 2u * axis];
        const uint32_t middle = burst[MMC5983MA_XOUT1 + 2u * axis];
        const uint32_t low = ((uint32_t)burst[MMC5983MA_XYZOUT2] >> (6u - 2u * axis)) & 3u;
        const int32_t count = (int32_t)((high << 10) | (middle << 2) | low);
        sample->counts[axis] = count - MMC5983MA_NULL_FIELD_COUNT;
        if (count == 0 || count == MMC5983MA_COUNT_MAX)
            sample->is_saturated = true;
    }
}
