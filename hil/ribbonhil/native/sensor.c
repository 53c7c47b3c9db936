/* Transactions, power and bus faults of a sensor, whatever its part. */
#include "sensor.h"

#include <math.h>
#include <string.h>

#include "noise.h"

#define COMMAND_READ 0x80u
#define NOT_DRIVEN   0xFFu

void sensor_init(struct sensor *sensor, const struct sensor_part *part,
                 const struct sensor_environment *environment) {
    memset(sensor, 0, sizeof *sensor);
    sensor->part = part;
    sensor->environment = *environment;
    if (part != NULL) {
        part->power_up(sensor, 0);
    }
}

static const struct fault *fault(const struct sensor *sensor, enum fault_kind kind, uint64_t t_ns) {
    return fault_active(sensor->environment.faults, sensor->environment.slot, kind, t_ns);
}

static bool is_connected(const struct sensor *sensor, uint64_t t_ns) {
    if (sensor->part == NULL || fault(sensor, FAULT_ABSENT, t_ns) != NULL) {
        return false;
    }
    const struct fault *contact = fault(sensor, FAULT_INTERMITTENT, t_ns);
    return contact == NULL || noise_uniform(sensor->environment.seed, sensor->environment.slot, NOISE_CONTACT,
                                            t_ns / FAULT_CONTACT_NS) >= contact->parameter;
}

void sensor_select(struct sensor *sensor, uint64_t t_ns) {
    uint64_t power_up_ns =
        fault_last_power_up_ns(sensor->environment.faults, sensor->environment.slot, sensor->seen_ns, t_ns);
    if (power_up_ns != 0 && sensor->part != NULL) {
        sensor->part->power_up(sensor, power_up_ns);
    }
    sensor->seen_ns = t_ns;
    sensor->connected = is_connected(sensor, t_ns);
    sensor->position = 0;
}

static uint8_t answer(struct sensor *sensor, uint64_t t_ns, uint8_t mosi) {
    const struct sensor_part *part = sensor->part;
    if (sensor->position++ == 0) {
        sensor->command = mosi;
        sensor->address = mosi & part->address_mask;
        sensor->counters.transactions++;
        return NOT_DRIVEN;
    }
    uint8_t address = sensor->address;
    sensor->address = part->next_address(sensor, address);
    if (t_ns < sensor->ready_ns) {
        sensor_reject(sensor, SENSOR_PREMATURE, t_ns);
        return NOT_DRIVEN;
    }
    if ((sensor->command & COMMAND_READ) == 0) {
        part->write(sensor, t_ns, address, mosi);
        return NOT_DRIVEN;
    }
    uint8_t value = part->read(sensor, t_ns, address);
    const struct fault *wrong_id = fault(sensor, FAULT_WRONG_ID, t_ns);
    return wrong_id != NULL && address == part->identity_address ? (uint8_t)wrong_id->parameter : value;
}

static uint8_t flipped(const struct sensor *sensor, uint8_t value, double probability) {
    for (unsigned bit = 0; bit < 8; bit++) {
        if (noise_uniform(sensor->environment.seed, sensor->environment.slot, NOISE_BIT_FLIP,
                          8u * sensor->bytes + bit) < probability) {
            value ^= (uint8_t)(1u << bit);
        }
    }
    return value;
}

uint8_t sensor_transfer(struct sensor *sensor, uint64_t t_ns, uint8_t mosi) {
    if (!sensor->connected) {
        return NOT_DRIVEN;
    }
    uint8_t value = answer(sensor, t_ns, mosi);
    sensor->bytes++;
    if (fault(sensor, FAULT_GARBAGE, t_ns) != NULL) {
        return (uint8_t)noise_bits(sensor->environment.seed, sensor->environment.slot, NOISE_GARBAGE,
                                   sensor->bytes);
    }
    const struct fault *flips = fault(sensor, FAULT_BIT_FLIPS, t_ns);
    return flips != NULL ? flipped(sensor, value, flips->parameter) : value;
}

void sensor_deselect(struct sensor *sensor, uint64_t t_ns) {
    if (sensor->connected && sensor->position == 1) {
        sensor_reject(sensor, SENSOR_TRUNCATED, t_ns);
    }
    sensor->connected = false;
}

void sensor_reject(struct sensor *sensor, enum sensor_rejection reason, uint64_t t_ns) {
    sensor->counters.rejected[reason]++;
    sensor->counters.last_rejected_ns = t_ns;
}

bool sensor_stuck(const struct sensor *sensor, double ended_ns) {
    return fault(sensor, FAULT_STUCK, (uint64_t)ended_ns) != NULL;
}

static void add_drift(const struct sensor *sensor, double t_ns, double out[3]) {
    const struct fault *drift = fault(sensor, FAULT_DRIFT, (uint64_t)t_ns);
    if (drift != NULL) {
        for (int axis = 0; axis < 3; axis++) {
            out[axis] += drift->parameter * (t_ns - (double)drift->start_ns) * 1e-9;
        }
    }
}

double sensor_temperature_c(const struct sensor *sensor, double t_ns) {
    const struct sensor_temperature *temperature = &sensor->environment.temperature;
    if (temperature->rise_c == 0.0) {
        return temperature->start_c;
    }
    return temperature->start_c + temperature->rise_c * (1.0 - exp(-t_ns * 1e-9 / temperature->time_s));
}

static void sense(const struct sensor *sensor, double t_ns, double v[3]) {
    if (sensor->environment.errors != NULL) {
        sensor_errors_apply(sensor->environment.errors, sensor_temperature_c(sensor, t_ns), v);
    }
    add_drift(sensor, t_ns, v);
}

void sensor_specific_force(const struct sensor *sensor, double t_ns, double out_mps2[3]) {
    truth_table_specific_force(sensor->environment.truth, sensor->environment.slot, t_ns * 1e-9, out_mps2);
    sense(sensor, t_ns, out_mps2);
}

void sensor_field(const struct sensor *sensor, double t_ns, double out_ut[3]) {
    truth_table_field(sensor->environment.truth, sensor->environment.slot, t_ns * 1e-9, out_ut);
    sense(sensor, t_ns, out_ut);
}

double sensor_oscillator(const struct sensor *sensor, double tolerance) {
    double u = noise_uniform(sensor->environment.seed, sensor->environment.slot, NOISE_OSCILLATOR, 0);
    return 1.0 + tolerance * (2.0 * u - 1.0);
}
