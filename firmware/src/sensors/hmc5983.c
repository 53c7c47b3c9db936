/* What a HMC5983 is, and what it is set to for a scan rate. */
#include "sensors/hmc5983.h"

#include "sensors/hmc5983_config.h"
#include "sensors/hmc5983_regs.h"

static const float UT_PER_GAUSS = 100.0f;
static const float CONTINUOUS_HZ = 220.0f;

const struct part HMC5983_PART = {
    .id = WIRE_PART_HMC5983,
    .kind = PART_MAGNETOMETER,
    .identity_command = HMC5983_SPI_READ | HMC5983_SPI_INCREMENT | HMC5983_ID_A,
    .identity_count = 3u,
    .identity = {HMC5983_ID_A_VALUE, HMC5983_ID_B_VALUE, HMC5983_ID_C_VALUE},
    .config_write_command = HMC5983_SPI_INCREMENT | HMC5983_CONFIG_A,
    .config_read_command = HMC5983_SPI_READ | HMC5983_SPI_INCREMENT | HMC5983_CONFIG_A,
    .config_count = 3u,
    .burst_command = HMC5983_SPI_READ | HMC5983_SPI_INCREMENT | HMC5983_CONFIG_A,
    .burst_count = HMC5983_BURST_COUNT,
    .trigger = {HMC5983_MODE, HMC5983_MODE_SINGLE},
};

void hmc5983_configure(uint32_t rate_hz, struct part_config *config) {
    static const float COUNTS_PER_GAUSS[] = HMC5983_COUNTS_PER_GAUSS;
    /* Reading the string takes up to 1 ms of the time between two scans. */
    const bool is_single = 1000000u / rate_hz > HMC5983_MEASUREMENT_US + HMC5983_MEASUREMENT_US / 10u + 1000u;

    *config = (struct part_config){
        .registers = {HMC5983_CONFIG_A_IN_USE, HMC5983_CONFIG_B_IN_USE,
                      is_single ? HMC5983_MODE_IDLE : HMC5983_MODE_CONTINUOUS},
        .mask = {0xFFu, 0xFFu, 0u}, /* the mode changes with every measurement */
        .lsb = UT_PER_GAUSS / COUNTS_PER_GAUSS[HMC5983_GAIN_IN_USE],
        .noise = 1e-3f * UT_PER_GAUSS * HMC5983_NOISE_MILLIGAUSS,
        .sample_hz = is_single ? (float)rate_hz : CONTINUOUS_HZ,
        .measurement_us = is_single ? HMC5983_MEASUREMENT_US + HMC5983_MEASUREMENT_US / 10u : 0u,
        /* Continuous: half a measurement, and half of the time until the next one. */
        .middle_us = is_single ? HMC5983_MEASUREMENT_US / 2u : HMC5983_MEASUREMENT_US,
        .span_us = HMC5983_MEASUREMENT_US,
    };
}
