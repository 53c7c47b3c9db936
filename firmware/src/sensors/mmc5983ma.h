/* The MMC5983MA magnetometer: what it is set to, and its bursts decoded. */
#ifndef MMC5983MA_H
#define MMC5983MA_H

#include "sensors/part.h"

extern const struct part MMC5983MA_PART;

/* The longest, least noisy measurement that takes at most half of the time between two scans. */
void mmc5983ma_configure(uint32_t rate_hz, struct part_config *config);

/* burst: the seven output registers, the temperature and STATUS, MMC5983MA_BURST_COUNT bytes. */
#define MMC5983MA_BURST_COUNT 9u
void mmc5983ma_decode(const uint8_t *burst, struct part_sample *sample);

#endif
