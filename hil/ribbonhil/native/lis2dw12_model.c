/* LIS2DW12: high-performance mode with its filter, noise, block data update and data-ready.
 *
 * FIFO, interrupts, self-test, low-power and on-demand modes are not modelled: using them is rejected. */
#include "lis2dw12_model.h"

#include <math.h>
#include <string.h>

#include "noise.h"
#include "sensor.h"
#include "sensors/lis2dw12_regs.h"

#define GRAVITY_MPS2             9.80665
#define NOISE_UG_RTHZ_NORMAL     110.0 /* with LOW_NOISE clear */
#define TEMPERATURE_ZERO_C       25.0
#define TEMPERATURE_COUNTS_PER_C 16.0
#define ADDRESS_FIFO_CTRL        0x2Eu
#define ADDRESS_FIFO_SAMPLES     0x2Fu
#define ADDRESS_OUT_T            0x26u
#define ADDRESS_FIRST_FUNCTION   0x30u /* tap, wake-up, free fall: kept, without effect */
#define ADDRESS_LAST_FUNCTION    0x36u
#define ADDRESS_FIRST_SOURCE     0x37u
#define ADDRESS_LAST_SOURCE      0x3Bu
#define ADDRESS_LAST             0x3Fu
#define CTRL3_SELF_TEST          0xC0u
#define HALVES_BOTH              3u

static const uint32_t odr_millihz[] = LIS2DW12_ODR_MILLIHZ;
static const uint32_t bandwidth_divisor[] = LIS2DW12_BW_DIVISOR;

static struct lis2dw12_model *state(struct sensor *sensor) {
    return &sensor->state.lis2dw12;
}

static void reset_registers(struct lis2dw12_model *model) {
    memset(model->control, 0, sizeof model->control);
    model->control[LIS2DW12_CTRL2] = LIS2DW12_CTRL2_RESET;
    sample_clock_start(&model->clock, 0.0, 0.0);
    model->data_ready = false;
    memset(model->halves_read, 0, sizeof model->halves_read);
}

static void power_up(struct sensor *sensor, uint64_t t_ns) {
    struct lis2dw12_model *model = state(sensor);
    memset(model->newest, 0, sizeof model->newest);
    memset(model->output, 0, sizeof model->output);
    reset_registers(model);
    sensor->ready_ns = t_ns + LIS2DW12_BOOT_US * 1000u;
}

/* One axis as left-justified counts. */
static int16_t quantised(double acceleration_mps2, unsigned range_code) {
    double lsb_mps2 = (double)LIS2DW12_MG_PER_COUNT_2G * (double)(1u << range_code) * 1e-3 * GRAVITY_MPS2;
    double count = round(acceleration_mps2 / lsb_mps2);
    count = fmin(fmax(count, LIS2DW12_COUNT_MIN), LIS2DW12_COUNT_MAX);
    return (int16_t)(count * (double)(1 << (16 - LIS2DW12_COUNT_BITS)));
}

/* The low-pass filter averages as many internal samples as its bandwidth divides half the data rate, of white
 * noise with the density of the data sheet; its delay is half its length. */
static void convert(struct sensor *sensor, double ended_ns) {
    struct lis2dw12_model *model = state(sensor);
    uint8_t ctrl6 = model->control[LIS2DW12_CTRL6];
    unsigned range_code = (ctrl6 & LIS2DW12_CTRL6_FS_MASK) >> LIS2DW12_CTRL6_FS_SHIFT;
    unsigned length = bandwidth_divisor[ctrl6 >> LIS2DW12_CTRL6_BW_FILT_SHIFT] / 2u;
    double value_mps2[3];
    sensor_specific_force(sensor, ended_ns - 0.5 * (double)length * model->clock.period_ns, value_mps2);

    double density_ug =
        (ctrl6 & LIS2DW12_CTRL6_LOW_NOISE) != 0 ? (double)LIS2DW12_NOISE_UG_RTHZ : NOISE_UG_RTHZ_NORMAL;
    double sigma_mps2 = density_ug * 1e-6 * GRAVITY_MPS2 * sqrt(0.5e9 / model->clock.period_ns);
    double scale = sensor->environment.noise_scale * sigma_mps2 / (double)length;
    for (unsigned i = 0; i < length && scale > 0.0; i++) {
        double normal[3];
        noise_normal(sensor->environment.seed, sensor->environment.slot, NOISE_SAMPLE, model->clock.taken - i,
                     normal);
        for (int axis = 0; axis < 3; axis++) {
            value_mps2[axis] += scale * normal[axis];
        }
    }
    for (int axis = 0; axis < 3; axis++) {
        model->newest[axis] = quantised(value_mps2[axis], range_code);
    }
}

static void update(struct sensor *sensor, uint64_t t_ns) {
    struct lis2dw12_model *model = state(sensor);
    double ended_ns;
    uint64_t passed;
    if (!sample_clock_advance(&model->clock, sensor->environment.faults, sensor->environment.slot, t_ns,
                              &ended_ns, &passed)) {
        return;
    }
    sensor->counters.samples += passed;
    model->data_ready = true;
    if (!sensor_stuck(sensor, ended_ns)) {
        convert(sensor, ended_ns);
    }
    for (int axis = 0; axis < 3; axis++) {
        if (model->halves_read[axis] == 0) {
            model->output[axis] = model->newest[axis];
        }
    }
}

static uint8_t read_output(struct lis2dw12_model *model, uint8_t address) {
    unsigned axis = (address - LIS2DW12_OUT_X_L) / 2u;
    bool high = ((address - LIS2DW12_OUT_X_L) & 1u) != 0;
    uint16_t bits = (uint16_t)model->output[axis];
    if (high) {
        model->data_ready = false;
    }
    if ((model->control[LIS2DW12_CTRL2] & LIS2DW12_CTRL2_BDU) != 0) {
        model->halves_read[axis] |= high ? 2u : 1u;
        if (model->halves_read[axis] == HALVES_BOTH) {
            model->halves_read[axis] = 0;
            model->output[axis] = model->newest[axis];
        }
    }
    return (uint8_t)(high ? bits >> 8 : bits);
}

/* 12 bits, left-justified in two bytes. */
static uint16_t temperature_bits(const struct sensor *sensor, uint64_t t_ns) {
    double count =
        round((sensor_temperature_c(sensor, (double)t_ns) - TEMPERATURE_ZERO_C) * TEMPERATURE_COUNTS_PER_C);
    return (uint16_t)(int16_t)(fmin(fmax(count, -2048.0), 2047.0) * 16.0);
}

static bool keeps_what_is_written(uint8_t address) {
    return (address >= LIS2DW12_CTRL1 && address <= LIS2DW12_CTRL6) || address == ADDRESS_FIFO_CTRL ||
           (address >= ADDRESS_FIRST_FUNCTION && address <= ADDRESS_LAST_FUNCTION) ||
           (address > ADDRESS_LAST_SOURCE && address <= ADDRESS_LAST);
}

static bool is_read_only(uint8_t address) {
    return address == LIS2DW12_OUT_T_L || address == LIS2DW12_OUT_T_H || address == LIS2DW12_WHO_AM_I ||
           (address >= ADDRESS_OUT_T && address <= LIS2DW12_OUT_Z_H) || address == ADDRESS_FIFO_SAMPLES ||
           (address >= ADDRESS_FIRST_SOURCE && address <= ADDRESS_LAST_SOURCE);
}

static uint8_t read_register(struct sensor *sensor, uint64_t t_ns, uint8_t address) {
    struct lis2dw12_model *model = state(sensor);
    update(sensor, t_ns);
    if ((model->control[LIS2DW12_CTRL2] & LIS2DW12_CTRL2_SIM) != 0) {
        return 0xFF; /* three-wire mode: the answer goes out on another pin */
    }
    if (address >= LIS2DW12_OUT_X_L && address <= LIS2DW12_OUT_Z_H) {
        return read_output(model, address);
    }
    switch (address) {
    case LIS2DW12_OUT_T_L:
        return (uint8_t)temperature_bits(sensor, t_ns);
    case LIS2DW12_OUT_T_H:
    case ADDRESS_OUT_T:
        return (uint8_t)(temperature_bits(sensor, t_ns) >> 8);
    case LIS2DW12_WHO_AM_I:
        return LIS2DW12_WHO_AM_I_VALUE;
    case LIS2DW12_STATUS:
    case ADDRESS_FIRST_SOURCE:
        return model->data_ready ? LIS2DW12_STATUS_DRDY : 0u;
    default:
        if (keeps_what_is_written(address)) {
            return model->control[address];
        }
        if (!is_read_only(address)) {
            sensor_reject(sensor, SENSOR_RESERVED_ADDRESS, t_ns);
        }
        return 0;
    }
}

static void write_ctrl1(struct sensor *sensor, uint64_t t_ns, uint8_t value) {
    struct lis2dw12_model *model = state(sensor);
    unsigned odr_code = (value & LIS2DW12_CTRL1_ODR_MASK) >> LIS2DW12_CTRL1_ODR_SHIFT;
    model->control[LIS2DW12_CTRL1] = value;
    sample_clock_start(&model->clock, 0.0, 0.0);
    if (odr_code == 0) {
        return;
    }
    if (odr_code > LIS2DW12_ODR_CODE_MAX) {
        sensor_reject(sensor, SENSOR_RESERVED_VALUE, t_ns);
        return;
    }
    if ((value & LIS2DW12_CTRL1_MODE_MASK) != LIS2DW12_CTRL1_MODE_HIGH_PERFORMANCE) {
        sensor_reject(sensor, SENSOR_NOT_MODELLED, t_ns);
        return;
    }
    double period_ns =
        1e12 / odr_millihz[odr_code] * sensor_oscillator(sensor, (double)LIS2DW12_ODR_TOLERANCE);
    double phase =
        noise_uniform(sensor->environment.seed, sensor->environment.slot, NOISE_PHASE, model->clock.taken);
    sample_clock_start(&model->clock, (double)t_ns + phase * period_ns, period_ns);
}

static void write_ctrl2(struct sensor *sensor, uint64_t t_ns, uint8_t value) {
    struct lis2dw12_model *model = state(sensor);
    if ((value & LIS2DW12_CTRL2_BOOT) != 0) {
        power_up(sensor, t_ns);
    } else if ((value & LIS2DW12_CTRL2_SOFT_RESET) != 0) {
        reset_registers(model);
        sensor->ready_ns = t_ns + LIS2DW12_SOFT_RESET_US * 1000u;
    } else {
        model->control[LIS2DW12_CTRL2] = value;
        if ((value & LIS2DW12_CTRL2_BDU) == 0) {
            memset(model->halves_read, 0, sizeof model->halves_read);
        }
    }
}

static void write_register(struct sensor *sensor, uint64_t t_ns, uint8_t address, uint8_t value) {
    struct lis2dw12_model *model = state(sensor);
    update(sensor, t_ns);
    if (is_read_only(address)) {
        sensor_reject(sensor, SENSOR_READ_ONLY, t_ns);
    } else if (!keeps_what_is_written(address)) {
        sensor_reject(sensor, SENSOR_RESERVED_ADDRESS, t_ns);
    } else if (address == LIS2DW12_CTRL1) {
        write_ctrl1(sensor, t_ns, value);
    } else if (address == LIS2DW12_CTRL2) {
        write_ctrl2(sensor, t_ns, value);
    } else {
        if ((address == LIS2DW12_CTRL3 && (value & CTRL3_SELF_TEST) != 0) ||
            (address == LIS2DW12_CTRL6 && (value & LIS2DW12_CTRL6_FDS) != 0) ||
            (address == ADDRESS_FIFO_CTRL && value != 0)) {
            sensor_reject(sensor, SENSOR_NOT_MODELLED, t_ns);
        }
        model->control[address] = value;
    }
}

static uint8_t next_address(const struct sensor *sensor, uint8_t address) {
    bool advances = (sensor->state.lis2dw12.control[LIS2DW12_CTRL2] & LIS2DW12_CTRL2_IF_ADD_INC) != 0;
    return advances ? (address + 1u) & LIS2DW12_SPI_ADDRESS_MASK : address;
}

const struct sensor_part lis2dw12_part = {
    .address_mask = LIS2DW12_SPI_ADDRESS_MASK,
    .identity_address = LIS2DW12_WHO_AM_I,
    .power_up = power_up,
    .read = read_register,
    .write = write_register,
    .next_address = next_address,
};
