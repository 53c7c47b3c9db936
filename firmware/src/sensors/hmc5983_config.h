/* The settings of a HMC5983 that are the same at every rate: written by the driver, expected in each burst.
 */
#ifndef HMC5983_CONFIG_H
#define HMC5983_CONFIG_H

#include "sensors/hmc5983_regs.h"

/* 1.3 G: the earth's field with room for hard iron. */
#define HMC5983_GAIN_IN_USE 1u

/* Temperature compensation on, no averaging (the time of an averaged measurement is not specified), 220 Hz.
 */
#define HMC5983_CONFIG_A_IN_USE (HMC5983_CONFIG_A_TS | HMC5983_CONFIG_A_DO_MASK)
#define HMC5983_CONFIG_B_IN_USE (HMC5983_GAIN_IN_USE << HMC5983_CONFIG_B_GN_SHIFT)

#endif
