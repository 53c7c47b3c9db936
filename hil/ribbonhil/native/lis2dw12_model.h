/* The LIS2DW12 accelerometer as a slave on the bus, from the data sheet. */
#ifndef LIS2DW12_MODEL_H
#define LIS2DW12_MODEL_H

#include <stdbool.h>
#include <stdint.h>

#include "sample_clock.h"

#define LIS2DW12_MODEL_REGISTERS 64u

struct lis2dw12_model {
    uint8_t control[LIS2DW12_MODEL_REGISTERS]; /* registers that keep what is written, by address */
    struct sample_clock clock;
    bool data_ready;
    int16_t newest[3];      /* of the last sample, left-justified */
    int16_t output[3];      /* in the output registers */
    uint8_t halves_read[3]; /* block data update: 1 low byte, 2 high byte of this output were read */
};

extern const struct sensor_part lis2dw12_part;

#endif
