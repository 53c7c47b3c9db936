/* The sensor string as the MCU's pins see it: select chain and SPI in, MISO out. */
#ifndef SENSOR_BUS_H
#define SENSOR_BUS_H

#include <stdbool.h>
#include <stdint.h>

#include "fault.h"
#include "flip_flop_chain.h"
#include "sensor.h"
#include "truth_table.h"

struct sensor_bus_counters {
    uint64_t bytes;
    uint64_t conflicts; /* bytes transferred while two or more sensors were selected */
    uint64_t first_conflict_ns;
    uint64_t last_conflict_ns;
};

struct sensor_bus {
    struct flip_flop_chain chain;
    uint64_t selected; /* bit i: slot i is in a transaction */
    struct fault_list faults;
    struct truth_table truth;
    struct sensor_errors errors[FLIP_FLOP_CHAIN_MAX];
    struct sensor_bus_counters counters;
    struct sensor sensors[FLIP_FLOP_CHAIN_MAX];
};

struct sensor_bus_config {
    uint64_t seed;
    uint32_t slots; /* 1 to FLIP_FLOP_CHAIN_MAX */
    double noise_scale;
    struct sensor_temperature temperature;
    const struct sensor_errors *errors; /* of each slot, copied; a null pointer: no part has any */
    uint8_t parts[FLIP_FLOP_CHAIN_MAX]; /* enum wire_part of each slot; WIRE_PART_NONE leaves it empty */
};

/* Powers the string up at true time 0. The bus must not be moved afterwards; the table must outlive it.
 * 0, or -1 if the configuration is none: slots out of range, a part without a model, a table with fewer
 * slots. */
int sensor_bus_init(struct sensor_bus *bus, const struct sensor_bus_config *config,
                    const struct truth_table *truth);

/* The world changes: what the sensors feel from the next sample on. The table must outlive the bus and have
 * as many slots as that. */
void sensor_bus_set_truth(struct sensor_bus *bus, const struct truth_table *truth);

/* What host_bus asks for; `context` is the bus. A byte: two or more selected give the AND of their answers,
 * none gives 0xFF, the pull-up. */
uint8_t sensor_bus_transfer(void *context, uint64_t t_ns, uint8_t mosi);
void sensor_bus_select_clock(void *context, uint64_t t_ns, bool data);

/* Level of MISO while SCK rests: no part drives it then, and what does not hold it fast pulls it. */
bool sensor_bus_miso(const struct sensor_bus *bus, uint64_t t_ns, bool pulled_up);

#endif
