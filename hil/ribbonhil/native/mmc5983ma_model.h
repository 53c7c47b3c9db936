/* The MMC5983MA magnetometer as a slave on the bus, from the data sheet. */
#ifndef MMC5983MA_MODEL_H
#define MMC5983MA_MODEL_H

#include <stdbool.h>
#include <stdint.h>

#include "sample_clock.h"

struct mmc5983ma_model {
    uint8_t control[4];        /* control registers 0 to 3; bits that clear themselves are never kept */
    struct sample_clock clock; /* of continuous mode; numbers the noise of all measurements */
    double single_end_ns;      /* of the measurement in progress, 0: none */
    double temperature_end_ns; /* the same for a measurement of temperature */
    double polarity;           /* of the bridge: 1 after SET, -1 after RESET */
    uint8_t done;              /* bits of STATUS */
    uint32_t output[3];        /* 18 bits */
    uint8_t temperature;
};

extern const struct sensor_part mmc5983ma_part;

#endif
