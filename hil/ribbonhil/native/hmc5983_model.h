/* The HMC5983 magnetometer as a slave on the bus, from the data sheet. */
#ifndef HMC5983_MODEL_H
#define HMC5983_MODEL_H

#include <stdbool.h>
#include <stdint.h>

#include "sample_clock.h"

struct hmc5983_model {
    uint8_t config_a;
    uint8_t config_b;
    uint8_t mode;
    uint8_t status;
    struct sample_clock clock; /* of continuous mode; numbers the noise of all measurements */
    double single_end_ns;      /* of the measurement in progress, 0: none */
    int16_t newest[3];         /* x, y, z of the last measurement */
    int16_t output[3];         /* in the output registers */
    uint8_t bytes_read;        /* bit per output register: read since the outputs last changed */
};

extern const struct sensor_part hmc5983_part;

#endif
