/* What a LIS2DW12 is, and what it is set to for a scan rate. */
#include "sensors/lis2dw12.h"

#include <math.h>

#include "sensors/lis2dw12_regs.h"

/* Less noise than this bandwidth lets through is not worth the delay that comes with it. */
static const uint32_t BANDWIDTH_MIN_MILLIHZ = 20000u;

/* The part samples by a clock of its own. So many samples a scan, averaged over about its period, have as
 * little noise as fewer, and the time at which they were taken is known as many times better: what the
 * specific force of a moving ribbon changes by in an unknown time counts for more than noise. */
static const uint32_t SAMPLES_A_SCAN = 8u;

static const float STANDARD_GRAVITY_MPS2 = 9.80665f;

enum { CONFIG_FIRST = LIS2DW12_CTRL1, CONFIG_LAST = LIS2DW12_CTRL6 };

const struct part LIS2DW12_PART = {
    .id = WIRE_PART_LIS2DW12,
    .kind = PART_ACCELEROMETER,
    .identity_command = LIS2DW12_SPI_READ | LIS2DW12_WHO_AM_I,
    .identity_count = 1u,
    .identity = {LIS2DW12_WHO_AM_I_VALUE},
    .reset = {LIS2DW12_CTRL2,
              LIS2DW12_CTRL2_SOFT_RESET | LIS2DW12_CTRL2_IF_ADD_INC | LIS2DW12_CTRL2_I2C_DISABLE},
    .has_reset = true,
    .reset_us = LIS2DW12_SOFT_RESET_US,
    .config_write_command = CONFIG_FIRST,
    .config_read_command = LIS2DW12_SPI_READ | CONFIG_FIRST,
    .config_count = CONFIG_LAST - CONFIG_FIRST + 1,
    .burst_command = LIS2DW12_SPI_READ | LIS2DW12_STATUS,
    .burst_count = LIS2DW12_BURST_COUNT,
};

static uint8_t odr_code(uint32_t rate_hz) {
    static const uint32_t ODR_MILLIHZ[] = LIS2DW12_ODR_MILLIHZ;
    uint8_t code = LIS2DW12_ODR_CODE_MIN;
    const uint32_t for_rate_millihz = SAMPLES_A_SCAN * 1000u * rate_hz;
    const uint32_t for_bandwidth_millihz = 2u * BANDWIDTH_MIN_MILLIHZ;
    while (code < LIS2DW12_ODR_CODE_MAX &&
           (ODR_MILLIHZ[code] < for_rate_millihz || ODR_MILLIHZ[code] < for_bandwidth_millihz))
        code++;
    return code;
}

static uint8_t bandwidth_code(uint32_t odr_millihz) {
    static const uint32_t DIVISOR[] = LIS2DW12_BW_DIVISOR;
    uint8_t code = sizeof DIVISOR / sizeof *DIVISOR - 1u;
    while (code > 0u && odr_millihz < DIVISOR[code] * BANDWIDTH_MIN_MILLIHZ)
        code--;
    return code;
}

static uint8_t range_code(uint32_t range_g) {
    static const uint32_t RANGE_G[] = LIS2DW12_RANGE_G;
    uint8_t code = 0u;
    while (code < sizeof RANGE_G / sizeof *RANGE_G - 1u && RANGE_G[code] < range_g)
        code++;
    return code;
}

void lis2dw12_configure(uint32_t rate_hz, uint32_t range_g, struct part_config *config) {
    static const uint32_t ODR_MILLIHZ[] = LIS2DW12_ODR_MILLIHZ;
    static const uint32_t DIVISOR[] = LIS2DW12_BW_DIVISOR;
    const uint8_t odr = odr_code(rate_hz);
    const uint8_t bandwidth = bandwidth_code(ODR_MILLIHZ[odr]);
    const uint8_t range = range_code(range_g);
    const uint32_t averaged = DIVISOR[bandwidth] / 2u; /* a mean over so many samples has this bandwidth */
    const float sample_us = 1e9f / (float)ODR_MILLIHZ[odr];
    const float bandwidth_hz = 0.001f * (float)ODR_MILLIHZ[odr] / (float)DIVISOR[bandwidth];

    *config = (struct part_config){
        .lsb = 0.001f * LIS2DW12_MG_PER_COUNT_2G * (float)(1u << range) * STANDARD_GRAVITY_MPS2,
        .noise = 1e-6f * LIS2DW12_NOISE_UG_RTHZ * sqrtf(bandwidth_hz) * STANDARD_GRAVITY_MPS2,
        .sample_hz = 0.001f * (float)ODR_MILLIHZ[odr],
        .middle_us = (uint32_t)(0.5f * (float)(averaged + 1u) * sample_us), /* half until the next one */
        .span_us = (uint32_t)((float)averaged * sample_us),
    };
    uint8_t *const registers = config->registers;
    registers[LIS2DW12_CTRL1 - CONFIG_FIRST] =
        (uint8_t)((odr << LIS2DW12_CTRL1_ODR_SHIFT) | LIS2DW12_CTRL1_MODE_HIGH_PERFORMANCE);
    /* The bus is shared: traffic for other slots must not look like I2C to this one. */
    registers[LIS2DW12_CTRL2 - CONFIG_FIRST] =
        LIS2DW12_CTRL2_BDU | LIS2DW12_CTRL2_IF_ADD_INC | LIS2DW12_CTRL2_I2C_DISABLE;
    registers[LIS2DW12_CTRL6 - CONFIG_FIRST] =
        (uint8_t)((bandwidth << LIS2DW12_CTRL6_BW_FILT_SHIFT) | (range << LIS2DW12_CTRL6_FS_SHIFT) |
                  LIS2DW12_CTRL6_LOW_NOISE);
    for (unsigned i = 0; i < LIS2DW12_PART.config_count; i++)
        config->mask[i] = 0xFFu;
}
