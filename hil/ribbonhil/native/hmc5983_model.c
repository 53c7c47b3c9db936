/* HMC5983: single and continuous measurements, gain, averaging, the lock of half-read outputs.
 *
 * Bias self-test, the low-power and high-speed bits and three-wire SPI are not modelled: using them is
 * rejected. */
#include "hmc5983_model.h"

#include <math.h>
#include <string.h>

#include "noise.h"
#include "sensor.h"
#include "sensors/hmc5983_regs.h"

#define UT_PER_GAUSS             100.0
#define OSCILLATOR_TOLERANCE     0.05
#define TEMPERATURE_ZERO_C       25.0
#define TEMPERATURE_COUNTS_PER_C 128.0
#define TEMPERATURE_LSB          (HMC5983_TEMPERATURE_MSB + 1u)
#define ID_C                     (HMC5983_ID_A + 2u)
#define ALL_OUTPUTS_READ         0x3Fu

static const float counts_per_gauss[] = HMC5983_COUNTS_PER_GAUSS;
static const double output_rate_hz[] = {0.75, 1.5, 3.0, 7.5, 15.0, 30.0, 75.0, 220.0};
static const unsigned axis_of_output[] = {0, 2, 1}; /* the registers hold x, z, y */

static struct hmc5983_model *state(struct sensor *sensor) {
    return &sensor->state.hmc5983;
}

static void power_up(struct sensor *sensor, uint64_t t_ns) {
    struct hmc5983_model *model = state(sensor);
    uint64_t taken = model->clock.taken;
    memset(model, 0, sizeof *model);
    model->clock.taken = taken;
    model->config_a = HMC5983_CONFIG_A_RESET;
    model->config_b = HMC5983_CONFIG_B_RESET;
    model->mode = HMC5983_MODE_RESET;
    sensor->ready_ns = t_ns + HMC5983_POWER_UP_US * 1000u;
}

static unsigned averaged(const struct hmc5983_model *model) {
    return 1u << ((model->config_a & HMC5983_CONFIG_A_MA_MASK) >> HMC5983_CONFIG_A_MA_SHIFT);
}

static double measurement_ns(struct sensor *sensor) {
    return HMC5983_MEASUREMENT_US * 1e3 * averaged(state(sensor)) *
           sensor_oscillator(sensor, OSCILLATOR_TOLERANCE);
}

static void convert(struct sensor *sensor, double ended_ns) {
    struct hmc5983_model *model = state(sensor);
    const struct sensor_environment *environment = &sensor->environment;
    double field_ut[3];
    double normal[3];
    sensor_field(sensor, ended_ns - 0.5 * measurement_ns(sensor), field_ut);
    noise_normal(environment->seed, environment->slot, NOISE_SAMPLE, model->clock.taken, normal);
    double sigma_gauss =
        environment->noise_scale * (double)HMC5983_NOISE_MILLIGAUSS * 1e-3 / sqrt((double)averaged(model));
    double gain = (double)counts_per_gauss[model->config_b >> HMC5983_CONFIG_B_GN_SHIFT];
    for (int axis = 0; axis < 3; axis++) {
        double count = round(gain * (field_ut[axis] / UT_PER_GAUSS + sigma_gauss * normal[axis]));
        bool fits = count >= HMC5983_COUNT_MIN && count <= HMC5983_COUNT_MAX;
        model->newest[axis] = (int16_t)(fits ? count : HMC5983_COUNT_OVERFLOW);
    }
}

static void measurement_ended(struct sensor *sensor, double ended_ns) {
    struct hmc5983_model *model = state(sensor);
    if (!sensor_stuck(sensor, ended_ns)) {
        convert(sensor, ended_ns);
    }
    if ((model->status & HMC5983_STATUS_LOCK) != 0) {
        return;
    }
    if ((model->status & HMC5983_STATUS_RDY) != 0) {
        model->status |= HMC5983_STATUS_DOW;
    }
    model->status |= HMC5983_STATUS_RDY;
    model->bytes_read = 0;
    memcpy(model->output, model->newest, sizeof model->output);
}

static void update(struct sensor *sensor, uint64_t t_ns) {
    struct hmc5983_model *model = state(sensor);
    const struct sensor_environment *environment = &sensor->environment;
    double ended_ns;
    uint64_t passed;
    if (sample_clock_advance(&model->clock, environment->faults, environment->slot, t_ns, &ended_ns,
                             &passed)) {
        sensor->counters.samples += passed;
        measurement_ended(sensor, ended_ns);
    }
    if (model->single_end_ns > 0.0 && (double)t_ns >= model->single_end_ns &&
        fault_active(environment->faults, environment->slot, FAULT_STALE, (uint64_t)model->single_end_ns) ==
            NULL) {
        sensor->counters.samples++;
        model->clock.taken++;
        measurement_ended(sensor, model->single_end_ns);
        model->single_end_ns = 0.0;
        model->mode = HMC5983_MODE_IDLE;
    }
}

static uint8_t read_output(struct hmc5983_model *model, uint8_t address) {
    unsigned index = address - HMC5983_OUT_X_MSB;
    uint16_t bits = (uint16_t)model->output[axis_of_output[index / 2u]];
    model->bytes_read |= (uint8_t)(1u << index);
    if (model->bytes_read == ALL_OUTPUTS_READ) {
        model->bytes_read = 0;
        model->status = 0;
    } else {
        model->status |= HMC5983_STATUS_LOCK;
    }
    return (uint8_t)(index % 2u == 0 ? bits >> 8 : bits);
}

static uint16_t temperature_bits(const struct sensor *sensor, uint64_t t_ns) {
    if ((sensor->state.hmc5983.config_a & HMC5983_CONFIG_A_TS) == 0) {
        return 0;
    }
    double count =
        round((sensor_temperature_c(sensor, (double)t_ns) - TEMPERATURE_ZERO_C) * TEMPERATURE_COUNTS_PER_C);
    return (uint16_t)(int16_t)fmin(fmax(count, -32768.0), 32767.0);
}

static uint8_t read_register(struct sensor *sensor, uint64_t t_ns, uint8_t address) {
    static const uint8_t identity[] = {HMC5983_ID_A_VALUE, HMC5983_ID_B_VALUE, HMC5983_ID_C_VALUE};
    struct hmc5983_model *model = state(sensor);
    update(sensor, t_ns);
    if (address >= HMC5983_OUT_X_MSB && address <= HMC5983_OUT_Y_LSB) {
        return read_output(model, address);
    }
    if (address >= HMC5983_ID_A && address <= ID_C) {
        return identity[address - HMC5983_ID_A];
    }
    switch (address) {
    case HMC5983_CONFIG_A:
        return model->config_a;
    case HMC5983_CONFIG_B:
        return model->config_b;
    case HMC5983_MODE:
        return model->mode;
    case HMC5983_STATUS:
        return model->status;
    case HMC5983_TEMPERATURE_MSB:
        return (uint8_t)(temperature_bits(sensor, t_ns) >> 8);
    case TEMPERATURE_LSB:
        return (uint8_t)temperature_bits(sensor, t_ns);
    default:
        sensor_reject(sensor, SENSOR_RESERVED_ADDRESS, t_ns);
        return 0;
    }
}

/* A change of configuration or mode also ends the lock and starts measuring anew. */
static void restart(struct sensor *sensor, uint64_t t_ns) {
    struct hmc5983_model *model = state(sensor);
    model->status = 0;
    model->bytes_read = 0;
    model->single_end_ns = 0.0;
    sample_clock_start(&model->clock, 0.0, 0.0);
    unsigned mode = model->mode & HMC5983_MODE_MD_MASK;
    if (mode == HMC5983_MODE_SINGLE) {
        model->single_end_ns = (double)t_ns + measurement_ns(sensor);
    } else if (mode == HMC5983_MODE_CONTINUOUS) {
        unsigned code = (model->config_a & HMC5983_CONFIG_A_DO_MASK) >> HMC5983_CONFIG_A_DO_SHIFT;
        double period_ns = 1e9 / output_rate_hz[code] * sensor_oscillator(sensor, OSCILLATOR_TOLERANCE);
        sample_clock_start(&model->clock, (double)t_ns + period_ns,
                           period_ns); /* the first takes two periods */
    }
}

static void write_register(struct sensor *sensor, uint64_t t_ns, uint8_t address, uint8_t value) {
    struct hmc5983_model *model = state(sensor);
    update(sensor, t_ns);
    switch (address) {
    case HMC5983_CONFIG_A:
        if ((value & HMC5983_CONFIG_A_MS_MASK) != 0) {
            sensor_reject(sensor, SENSOR_NOT_MODELLED, t_ns);
        }
        model->config_a = value;
        if ((model->mode & HMC5983_MODE_MD_MASK) == HMC5983_MODE_CONTINUOUS) {
            restart(sensor, t_ns);
        }
        break;
    case HMC5983_CONFIG_B:
        if ((value & 0x1Fu) != 0) {
            sensor_reject(sensor, SENSOR_RESERVED_VALUE, t_ns);
        }
        model->config_b = value;
        break;
    case HMC5983_MODE:
        if ((value & ~HMC5983_MODE_MD_MASK) != 0) {
            sensor_reject(sensor, SENSOR_NOT_MODELLED, t_ns);
        }
        model->mode = value;
        restart(sensor, t_ns);
        break;
    default:
        sensor_reject(sensor,
                      address <= ID_C || address == HMC5983_TEMPERATURE_MSB || address == TEMPERATURE_LSB
                          ? SENSOR_READ_ONLY
                          : SENSOR_RESERVED_ADDRESS,
                      t_ns);
        break;
    }
}

/* With the increment bit the address goes round the outputs, and from the last register to the first. */
static uint8_t next_address(const struct sensor *sensor, uint8_t address) {
    if ((sensor->command & HMC5983_SPI_INCREMENT) == 0) {
        return address;
    }
    if (address == HMC5983_OUT_Y_LSB) {
        return HMC5983_OUT_X_MSB;
    }
    return address == ID_C ? 0u : (address + 1u) & HMC5983_SPI_ADDRESS_MASK;
}

const struct sensor_part hmc5983_part = {
    .address_mask = HMC5983_SPI_ADDRESS_MASK,
    .identity_address = HMC5983_ID_A,
    .power_up = power_up,
    .read = read_register,
    .write = write_register,
    .next_address = next_address,
};
