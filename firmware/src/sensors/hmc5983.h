/* The HMC5983 magnetometer: what it is set to, and its bursts decoded. */
#ifndef HMC5983_H
#define HMC5983_H

#include "sensors/part.h"

extern const struct part HMC5983_PART;

/* Single measurements up to the rate at which one fits between two scans, beyond it continuous ones. */
void hmc5983_configure(uint32_t rate_hz, struct part_config *config);

/* burst: CONFIG_A, CONFIG_B, MODE and the six output registers, HMC5983_BURST_COUNT bytes. */
#define HMC5983_BURST_COUNT 9u
void hmc5983_decode(const uint8_t *burst, struct part_sample *sample);

#endif
