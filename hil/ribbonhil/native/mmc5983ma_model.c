/* MMC5983MA: single and continuous measurements, the set/reset coil, bridge offset, noise by bandwidth.
 *
 * The outputs are not latched: a read during which a measurement ends sees parts of both. Axis inhibition,
 * self-test and three-wire SPI are not modelled: using them is rejected. */
#include "mmc5983ma_model.h"

#include <math.h>
#include <string.h>

#include "noise.h"
#include "sensor.h"
#include "sensors/mmc5983ma_regs.h"

#define UT_PER_GAUSS               100.0
#define OSCILLATOR_TOLERANCE       0.05
#define CONTROL2_FREQUENCY_MASK    0x07u
#define CONTROL2_PERIODIC_SET_MASK 0xF0u
#define TEMPERATURE_ZERO_C         (-75.0)
#define TEMPERATURE_C_PER_COUNT    0.8

static const uint32_t measurement_us[] = MMC5983MA_MEASUREMENT_US;
static const float noise_milligauss[] = MMC5983MA_NOISE_MILLIGAUSS;
static const double continuous_hz[] = {0.0, 1.0, 10.0, 20.0, 50.0, 100.0, 200.0, 1000.0};

static struct mmc5983ma_model *state(struct sensor *sensor) {
    return &sensor->state.mmc5983ma;
}

static uint8_t *control(struct mmc5983ma_model *model, uint8_t address) {
    return &model->control[address - MMC5983MA_CONTROL0];
}

static unsigned bandwidth_code(struct mmc5983ma_model *model) {
    return *control(model, MMC5983MA_CONTROL1) & MMC5983MA_CONTROL1_BW_MASK;
}

static double measurement_ns(struct sensor *sensor) {
    return measurement_us[bandwidth_code(state(sensor))] * 1e3 *
           sensor_oscillator(sensor, OSCILLATOR_TOLERANCE);
}

static void start_up(struct sensor *sensor, uint64_t t_ns) {
    struct mmc5983ma_model *model = state(sensor);
    memset(model->control, 0, sizeof model->control);
    sample_clock_start(&model->clock, 0.0, 0.0);
    model->single_end_ns = 0.0;
    model->temperature_end_ns = 0.0;
    model->done = MMC5983MA_STATUS_OTP_READ_DONE;
    memset(model->output, 0, sizeof model->output);
    model->temperature = 0;
    sensor->ready_ns = t_ns + MMC5983MA_POWER_UP_US * 1000u;
}

/* Nobody knows how the bridge is magnetised after power-up: only a SET or RESET tells. */
static void power_up(struct sensor *sensor, uint64_t t_ns) {
    start_up(sensor, t_ns);
    bool set =
        (noise_bits(sensor->environment.seed, sensor->environment.slot, NOISE_POLARITY, t_ns) & 1u) != 0;
    state(sensor)->polarity = set ? 1.0 : -1.0;
}

static void convert(struct sensor *sensor, double ended_ns) {
    struct mmc5983ma_model *model = state(sensor);
    const struct sensor_environment *environment = &sensor->environment;
    if ((*control(model, MMC5983MA_CONTROL0) & MMC5983MA_CONTROL0_AUTO_SR_EN) != 0) {
        model->polarity = 1.0;
    }
    if (sensor_stuck(sensor, ended_ns)) {
        return;
    }
    double field_ut[3];
    double normal[3];
    sensor_field(sensor, ended_ns - 0.5 * measurement_ns(sensor), field_ut);
    noise_normal(environment->seed, environment->slot, NOISE_SAMPLE, model->clock.taken, normal);
    double sigma_gauss = environment->noise_scale * (double)noise_milligauss[bandwidth_code(model)] * 1e-3;
    for (unsigned axis = 0; axis < 3; axis++) {
        double u = noise_uniform(environment->seed, environment->slot, NOISE_OFFSET, axis);
        double gauss = model->polarity * field_ut[axis] / UT_PER_GAUSS +
                       (double)MMC5983MA_OFFSET_MAX_GAUSS * (2.0 * u - 1.0) + sigma_gauss * normal[axis];
        double count = round(MMC5983MA_NULL_FIELD_COUNT + gauss * (double)MMC5983MA_COUNTS_PER_GAUSS);
        model->output[axis] = (uint32_t)fmin(fmax(count, 0.0), MMC5983MA_COUNT_MAX);
    }
}

static bool has_ended(const struct sensor *sensor, double end_ns, uint64_t t_ns) {
    return end_ns > 0.0 && (double)t_ns >= end_ns &&
           fault_active(sensor->environment.faults, sensor->environment.slot, FAULT_STALE,
                        (uint64_t)end_ns) == NULL;
}

static void update(struct sensor *sensor, uint64_t t_ns) {
    struct mmc5983ma_model *model = state(sensor);
    const struct sensor_environment *environment = &sensor->environment;
    double ended_ns;
    uint64_t passed;
    if (sample_clock_advance(&model->clock, environment->faults, environment->slot, t_ns, &ended_ns,
                             &passed)) {
        sensor->counters.samples += passed;
        model->done |= MMC5983MA_STATUS_MEAS_M_DONE;
        convert(sensor, ended_ns);
    }
    if (has_ended(sensor, model->single_end_ns, t_ns)) {
        sensor->counters.samples++;
        model->clock.taken++;
        model->done |= MMC5983MA_STATUS_MEAS_M_DONE;
        convert(sensor, model->single_end_ns);
        model->single_end_ns = 0.0;
    }
    if (has_ended(sensor, model->temperature_end_ns, t_ns)) {
        double temperature_c = sensor_temperature_c(sensor, model->temperature_end_ns);
        double count = round((temperature_c - TEMPERATURE_ZERO_C) / TEMPERATURE_C_PER_COUNT);
        model->temperature = (uint8_t)fmin(fmax(count, 0.0), 255.0);
        model->done |= MMC5983MA_STATUS_MEAS_T_DONE;
        model->temperature_end_ns = 0.0;
    }
}

static bool is_measuring(struct sensor *sensor, uint64_t t_ns) {
    struct mmc5983ma_model *model = state(sensor);
    if (model->single_end_ns > 0.0 || model->temperature_end_ns > 0.0) {
        return true;
    }
    double next_end_ns = model->clock.start_ns + (double)(model->clock.run + 1u) * model->clock.period_ns;
    return model->clock.period_ns > 0.0 && (double)t_ns >= next_end_ns - measurement_ns(sensor);
}

static uint8_t read_status(struct sensor *sensor, uint64_t t_ns) {
    struct mmc5983ma_model *model = state(sensor);
    bool measuring = model->clock.period_ns > 0.0 && is_measuring(sensor, t_ns);
    return measuring ? model->done & (uint8_t)~MMC5983MA_STATUS_MEAS_M_DONE : model->done;
}

static uint8_t read_register(struct sensor *sensor, uint64_t t_ns, uint8_t address) {
    struct mmc5983ma_model *model = state(sensor);
    const uint32_t *out = model->output;
    update(sensor, t_ns);
    switch (address) {
    case MMC5983MA_XOUT0:
    case MMC5983MA_YOUT0:
    case MMC5983MA_ZOUT0:
        return (uint8_t)(out[address / 2u] >> 10);
    case MMC5983MA_XOUT1:
    case MMC5983MA_YOUT1:
    case MMC5983MA_ZOUT1:
        return (uint8_t)(out[address / 2u] >> 2);
    case MMC5983MA_XYZOUT2:
        return (uint8_t)((out[0] & 3u) << 6 | (out[1] & 3u) << 4 | (out[2] & 3u) << 2);
    case MMC5983MA_TOUT:
        return model->temperature;
    case MMC5983MA_STATUS:
        return read_status(sensor, t_ns);
    case MMC5983MA_PRODUCT_ID:
        return MMC5983MA_PRODUCT_ID_VALUE;
    case MMC5983MA_CONTROL0:
    case MMC5983MA_CONTROL1:
    case MMC5983MA_CONTROL2:
    case MMC5983MA_CONTROL3:
        sensor_reject(sensor, SENSOR_WRITE_ONLY, t_ns);
        return 0;
    default:
        sensor_reject(sensor, SENSOR_RESERVED_ADDRESS, t_ns);
        return 0;
    }
}

static void write_control0(struct sensor *sensor, uint64_t t_ns, uint8_t value) {
    const uint8_t start = MMC5983MA_CONTROL0_TM_M | MMC5983MA_CONTROL0_TM_T;
    const uint8_t pulse = MMC5983MA_CONTROL0_SET | MMC5983MA_CONTROL0_RESET;
    struct mmc5983ma_model *model = state(sensor);
    if ((value & start) == start || (value & pulse) == pulse || (value & 0x80u) != 0) {
        sensor_reject(sensor, SENSOR_RESERVED_VALUE, t_ns);
        return;
    }
    if ((value & (start | pulse)) != 0 && is_measuring(sensor, t_ns)) {
        sensor_reject(sensor, SENSOR_BUSY, t_ns);
        return;
    }
    *control(model, MMC5983MA_CONTROL0) =
        value & (MMC5983MA_CONTROL0_INT_MEAS_DONE_EN | MMC5983MA_CONTROL0_AUTO_SR_EN);
    if ((value & pulse) != 0) {
        model->polarity = (value & MMC5983MA_CONTROL0_SET) != 0 ? 1.0 : -1.0;
    }
    if ((value & MMC5983MA_CONTROL0_TM_M) != 0) {
        model->done &= (uint8_t)~MMC5983MA_STATUS_MEAS_M_DONE;
        model->single_end_ns = (double)t_ns + measurement_ns(sensor);
    }
    if ((value & MMC5983MA_CONTROL0_TM_T) != 0) {
        model->done &= (uint8_t)~MMC5983MA_STATUS_MEAS_T_DONE;
        model->temperature_end_ns = (double)t_ns + measurement_ns(sensor);
    }
}

static void write_control1(struct sensor *sensor, uint64_t t_ns, uint8_t value) {
    const uint8_t inhibit = MMC5983MA_CONTROL1_X_INHIBIT | MMC5983MA_CONTROL1_YZ_INHIBIT;
    if ((value & MMC5983MA_CONTROL1_SW_RESET) != 0) {
        start_up(sensor, t_ns);
        return;
    }
    if ((value & inhibit) != 0) {
        sensor_reject(sensor, SENSOR_NOT_MODELLED, t_ns);
    }
    *control(state(sensor), MMC5983MA_CONTROL1) = value;
}

static void write_control2(struct sensor *sensor, uint64_t t_ns, uint8_t value) {
    struct mmc5983ma_model *model = state(sensor);
    unsigned code = value & CONTROL2_FREQUENCY_MASK;
    *control(model, MMC5983MA_CONTROL2) = value;
    sample_clock_start(&model->clock, 0.0, 0.0);
    if ((value & MMC5983MA_CONTROL2_CONTINUOUS) == 0) {
        return;
    }
    double period_ns =
        code == 0 ? 0.0 : 1e9 / continuous_hz[code] * sensor_oscillator(sensor, OSCILLATOR_TOLERANCE);
    if (period_ns <= measurement_ns(sensor)) {
        sensor_reject(sensor, SENSOR_RESERVED_VALUE, t_ns);
        return;
    }
    double phase =
        noise_uniform(sensor->environment.seed, sensor->environment.slot, NOISE_PHASE, model->clock.taken);
    sample_clock_start(&model->clock, (double)t_ns + phase * period_ns, period_ns);
}

static void write_register(struct sensor *sensor, uint64_t t_ns, uint8_t address, uint8_t value) {
    struct mmc5983ma_model *model = state(sensor);
    update(sensor, t_ns);
    switch (address) {
    case MMC5983MA_STATUS: /* a 1 clears the interrupt of that measurement */
        model->done &= (uint8_t)~(value & (MMC5983MA_STATUS_MEAS_M_DONE | MMC5983MA_STATUS_MEAS_T_DONE));
        break;
    case MMC5983MA_CONTROL0:
        write_control0(sensor, t_ns, value);
        break;
    case MMC5983MA_CONTROL1:
        write_control1(sensor, t_ns, value);
        break;
    case MMC5983MA_CONTROL2:
        write_control2(sensor, t_ns, value);
        break;
    case MMC5983MA_CONTROL3:
        if (value != 0) {
            sensor_reject(sensor, SENSOR_NOT_MODELLED, t_ns);
        }
        *control(model, MMC5983MA_CONTROL3) = value;
        break;
    default:
        sensor_reject(sensor,
                      address <= MMC5983MA_TOUT || address == MMC5983MA_PRODUCT_ID ? SENSOR_READ_ONLY
                                                                                   : SENSOR_RESERVED_ADDRESS,
                      t_ns);
        break;
    }
}

static uint8_t next_address(const struct sensor *sensor, uint8_t address) {
    (void)sensor;
    return (address + 1u) & MMC5983MA_SPI_ADDRESS_MASK;
}

const struct sensor_part mmc5983ma_part = {
    .address_mask = MMC5983MA_SPI_ADDRESS_MASK,
    .identity_address = MMC5983MA_PRODUCT_ID,
    .power_up = power_up,
    .read = read_register,
    .write = write_register,
    .next_address = next_address,
};
