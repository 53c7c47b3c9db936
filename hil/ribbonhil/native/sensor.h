/* A sensor part in a slot of the ribbon: the bus reads and writes its registers, the truth moves them.
 *
 * This is common to all parts: transactions, power, faults on the bus, counters. What a part adds is a
 * constant struct sensor_part and its state, in <part>_model.c/.h. */
#ifndef SENSOR_H
#define SENSOR_H

#include <stdbool.h>
#include <stdint.h>

#include "fault.h"
#include "hmc5983_model.h"
#include "lis2dw12_model.h"
#include "mmc5983ma_model.h"
#include "sensor_errors.h"
#include "truth_table.h"

/* Why a part did not do what the bus asked for. */
enum sensor_rejection {
    SENSOR_PREMATURE,        /* access while it starts up */
    SENSOR_TRUNCATED,        /* a command byte and nothing after it */
    SENSOR_READ_ONLY,        /* write to a register that can only be read */
    SENSOR_WRITE_ONLY,       /* read of a register that can only be written */
    SENSOR_RESERVED_ADDRESS, /* read or write where the data sheet has no register */
    SENSOR_RESERVED_VALUE,   /* bits or codes that the data sheet reserves or forbids */
    SENSOR_BUSY,             /* a command that the measurement in progress rules out */
    SENSOR_NOT_MODELLED,     /* the real part can do it, the model cannot */
    SENSOR_REJECTION_COUNT
};

struct sensor_counters {
    uint64_t transactions; /* with at least one byte */
    uint64_t samples;      /* taken, read or not */
    uint64_t rejected[SENSOR_REJECTION_COUNT];
    uint64_t last_rejected_ns;
};

/* A string that warms up: start_c + rise_c * (1 - exp(-t / time_s)). */
struct sensor_temperature {
    double start_c, rise_c, time_s;
};

/* The world of a sensor, set up by the bus. */
struct sensor_environment {
    const struct truth_table *truth;
    const struct fault_list *faults;
    uint64_t seed;
    uint32_t slot;
    double noise_scale; /* 1: as in the data sheet, 0: none */
    struct sensor_temperature temperature;
    const struct sensor_errors *errors; /* a null pointer: the part has none */
};

union sensor_state {
    struct lis2dw12_model lis2dw12;
    struct mmc5983ma_model mmc5983ma;
    struct hmc5983_model hmc5983;
};

struct sensor {
    const struct sensor_part *part; /* a null pointer: the slot is empty */
    struct sensor_environment environment;
    struct sensor_counters counters;

    uint64_t seen_ns;  /* until here faults have had their effect on power */
    uint64_t ready_ns; /* before that every access is premature */
    uint64_t bytes;    /* numbers the random numbers of garbage and bit flips */
    bool connected;    /* in this transaction */
    uint32_t position; /* of the next byte in this transaction */
    uint8_t command;
    uint8_t address;

    union sensor_state state;
};

/* What one kind of part does; all times are true time. Bit 7 of a command byte is 1 for a read in all of
 * them. */
struct sensor_part {
    uint8_t address_mask;     /* of the command byte */
    uint8_t identity_address; /* of the register that a wrong identity shows in */
    void (*power_up)(struct sensor *sensor, uint64_t t_ns);
    uint8_t (*read)(struct sensor *sensor, uint64_t t_ns, uint8_t address);
    void (*write)(struct sensor *sensor, uint64_t t_ns, uint8_t address, uint8_t value);
    uint8_t (*next_address)(const struct sensor *sensor, uint8_t address); /* after a byte */
};

/* Puts a part into a slot, powered up at true time 0. */
void sensor_init(struct sensor *sensor, const struct sensor_part *part,
                 const struct sensor_environment *environment);

/* A transaction: select goes low, bytes, select goes high. A part that drives nothing gives 0xFF. */
void sensor_select(struct sensor *sensor, uint64_t t_ns);
uint8_t sensor_transfer(struct sensor *sensor, uint64_t t_ns, uint8_t mosi);
void sensor_deselect(struct sensor *sensor, uint64_t t_ns);

/* For the models: counts what a part refuses to do. */
void sensor_reject(struct sensor *sensor, enum sensor_rejection reason, uint64_t t_ns);

/* For the models: true if a stuck fault keeps the outputs of a sample that ends at ended_ns. */
bool sensor_stuck(const struct sensor *sensor, double ended_ns);

/* For the models: how warm the part is. */
double sensor_temperature_c(const struct sensor *sensor, double t_ns);

/* For the models: the truth at t_ns as the part senses it, with its errors and the drift fault, if any. */
void sensor_specific_force(const struct sensor *sensor, double t_ns, double out_mps2[3]);
void sensor_field(const struct sensor *sensor, double t_ns, double out_ut[3]);

/* For the models: what the oscillator makes of a nominal time, by a factor within 1 +- tolerance. */
double sensor_oscillator(const struct sensor *sensor, double tolerance);

#endif
