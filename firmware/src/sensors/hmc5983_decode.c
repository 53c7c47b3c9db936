/* Bytes of a HMC5983 burst to counts. */
#include "sensors/hmc5983.h"
#include "sensors/hmc5983_config.h"
#include "sensors/hmc5983_regs.h"

void hmc5983_decode(const uint8_t *burst, struct part_sample *sample) {
    static const unsigned OFFSET[3] = {0u, 4u, 2u}; /* the registers come as X, Z, Y */
    /* RDY would have to be read beyond the outputs, where the address may wrap; the mode says it as well. */
    sample->is_new = (burst[HMC5983_MODE] & HMC5983_MODE_MD_MASK) != HMC5983_MODE_SINGLE;
    sample->is_saturated = false;
    sample->is_configured = burst[HMC5983_CONFIG_A] == HMC5983_CONFIG_A_IN_USE &&
                            burst[HMC5983_CONFIG_B] == HMC5983_CONFIG_B_IN_USE;
    for (unsigned axis = 0; axis < 3u; axis++) {
        const uint8_t *const bytes = burst + HMC5983_OUT_X_MSB + OFFSET[axis];
        const int32_t count = (int16_t)(uint16_t)((bytes[0] << 8) | bytes[1]);
        sample->counts[axis] = count;
        if (count >= HMC5983_COUNT_MAX || count <= HMC5983_COUNT_MIN)
            sample->is_saturated = true;
    }
}
