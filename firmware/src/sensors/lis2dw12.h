/* The LIS2DW12 accelerometer: what it is set to, and its bursts decoded. */
#ifndef LIS2DW12_H
#define LIS2DW12_H

#include "sensors/part.h"

extern const struct part LIS2DW12_PART;

/* Output data rate at least eight times rate_hz, filtered to the lowest bandwidth that does not lag a moving
 * ribbon; range_g is 2, 4, 8 or 16 (anything else counts as the next larger one, at most 16). */
void lis2dw12_configure(uint32_t rate_hz, uint32_t range_g, struct part_config *config);

/* burst: STATUS and the six output registers, LIS2DW12_BURST_COUNT bytes. */
#define LIS2DW12_BURST_COUNT 7u
void lis2dw12_decode(const uint8_t *burst, struct part_sample *sample);

#endif
