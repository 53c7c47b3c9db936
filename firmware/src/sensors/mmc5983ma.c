/* What a MMC5983MA is, and what it is set to for a scan rate. */
#include "sensors/mmc5983ma.h"

#include "sensors/mmc5983ma_regs.h"

static const float UT_PER_GAUSS = 100.0f;

const struct part MMC5983MA_PART = {
    .id = WIRE_PART_MMC5983MA,
    .kind = PART_MAGNETOMETER,
    .identity_command = MMC5983MA_SPI_READ | MMC5983MA_PRODUCT_ID,
    .identity_count = 1u,
    .identity = {MMC5983MA_PRODUCT_ID_VALUE},
    .reset = {MMC5983MA_CONTROL1, MMC5983MA_CONTROL1_SW_RESET},
    .has_reset = true,
    .reset_us = MMC5983MA_POWER_UP_US,
    .config_write_command = MMC5983MA_CONTROL1,
    .config_count = 1u,
    .burst_command = MMC5983MA_SPI_READ | MMC5983MA_XOUT0,
    .burst_count = MMC5983MA_BURST_COUNT,
    .has_polarity = true,
    .polarise = {{MMC5983MA_CONTROL0, MMC5983MA_CONTROL0_SET},
                 {MMC5983MA_CONTROL0, MMC5983MA_CONTROL0_RESET}},
    .trigger = {MMC5983MA_CONTROL0, MMC5983MA_CONTROL0_TM_M},
};

void mmc5983ma_configure(uint32_t rate_hz, struct part_config *config) {
    static const uint32_t MEASUREMENT_US[] = MMC5983MA_MEASUREMENT_US;
    static const float NOISE_MILLIGAUSS[] = MMC5983MA_NOISE_MILLIGAUSS;
    const uint32_t period_us = 1000000u / rate_hz;
    uint8_t bandwidth = 0u;
    while (bandwidth < MMC5983MA_CONTROL1_BW_MASK && 2u * MEASUREMENT_US[bandwidth] > period_us)
        bandwidth++;

    *config = (struct part_config){
        .registers = {bandwidth},
        .lsb = UT_PER_GAUSS / MMC5983MA_COUNTS_PER_GAUSS,
        .noise = 1e-3f * UT_PER_GAUSS * NOISE_MILLIGAUSS[bandwidth],
        .sample_hz = (float)rate_hz,
        /* The data sheet's times are typical ones. */
        .measurement_us = MEASUREMENT_US[bandwidth] + MEASUREMENT_US[bandwidth] / 10u,
        .middle_us = MEASUREMENT_US[bandwidth] / 2u,
        .span_us = MEASUREMENT_US[bandwidth],
    };
}
