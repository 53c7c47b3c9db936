/* Routes the pins of the bus to the selected sensors. */
#include "sensor_bus.h"

#include <string.h>

#include "wire.h"

#define PULLED_UP 0xFFu

static const struct sensor_part *part_model(uint8_t part) {
    switch (part) {
    case WIRE_PART_LIS2DW12:
        return &lis2dw12_part;
    case WIRE_PART_MMC5983MA:
        return &mmc5983ma_part;
    case WIRE_PART_HMC5983:
        return &hmc5983_part;
    default:
        return NULL;
    }
}

int sensor_bus_init(struct sensor_bus *bus, const struct sensor_bus_config *config,
                    const struct truth_table *truth) {
    memset(bus, 0, sizeof *bus);
    if (config->slots < 1 || config->slots > FLIP_FLOP_CHAIN_MAX || truth->slots < config->slots ||
        truth->rows < 1) {
        return -1;
    }
    bus->truth = *truth;
    if (config->errors != NULL) {
        memcpy(bus->errors, config->errors, config->slots * sizeof *config->errors);
    }
    flip_flop_chain_power_up(&bus->chain, config->slots, config->seed);
    for (uint32_t slot = 0; slot < config->slots; slot++) {
        const struct sensor_part *part = part_model(config->parts[slot]);
        if (part == NULL && config->parts[slot] != WIRE_PART_NONE) {
            return -1;
        }
        const struct sensor_environment environment = {
            .truth = &bus->truth,
            .faults = &bus->faults,
            .seed = config->seed,
            .slot = slot,
            .noise_scale = config->noise_scale,
            .temperature = config->temperature,
            .errors = config->errors != NULL ? &bus->errors[slot] : NULL,
        };
        sensor_init(&bus->sensors[slot], part, &environment);
    }
    return 0;
}

void sensor_bus_set_truth(struct sensor_bus *bus, const struct truth_table *truth) {
    bus->truth = *truth;
}

/* The selects are wires: what the outputs of the chain become on their way to the parts. */
static uint64_t through_wires(const struct sensor_bus *bus, uint64_t selected, const struct fault *fault) {
    if (fault->slot >= bus->chain.slots) {
        return selected;
    }
    const uint64_t here = (uint64_t)1 << fault->slot;
    if (fault->kind == FAULT_SELECTED) {
        return selected | here;
    }
    if ((fault->kind != FAULT_CROSSED && fault->kind != FAULT_SHORTED) ||
        !(fault->parameter >= 0.0 && fault->parameter < bus->chain.slots)) {
        return selected;
    }
    const uint64_t both = here | (uint64_t)1 << (unsigned)fault->parameter;
    const bool is_either = (selected & both) != 0;
    const bool is_one = is_either && (selected & both) != both;
    if (fault->kind == FAULT_CROSSED) {
        return is_one ? selected ^ both : selected;
    }
    return is_either ? selected | both : selected;
}

static uint64_t selected_parts(const struct sensor_bus *bus, uint64_t t_ns) {
    uint64_t selected = bus->chain.selected;
    for (uint32_t i = 0; i < bus->faults.count; i++) {
        const struct fault *fault = &bus->faults.faults[i];
        if (fault->start_ns <= t_ns && t_ns < fault->end_ns) {
            selected = through_wires(bus, selected, fault);
        }
    }
    return selected;
}

static void select(struct sensor_bus *bus, uint64_t t_ns) {
    uint64_t wanted = selected_parts(bus, t_ns);
    uint64_t changed = bus->selected ^ wanted;
    for (uint32_t slot = 0; changed != 0; slot++, changed >>= 1) {
        if ((changed & 1u) == 0) {
            continue;
        }
        if ((wanted >> slot & 1u) != 0) {
            sensor_select(&bus->sensors[slot], t_ns);
        } else {
            sensor_deselect(&bus->sensors[slot], t_ns);
        }
    }
    bus->selected = wanted;
}

uint8_t sensor_bus_transfer(void *context, uint64_t t_ns, uint8_t mosi) {
    struct sensor_bus *bus = context;
    select(bus, t_ns);
    bus->counters.bytes++;
    uint64_t rest = bus->selected;
    if ((rest & (rest - 1u)) != 0) {
        bus->counters.last_conflict_ns = t_ns;
        if (bus->counters.conflicts++ == 0) {
            bus->counters.first_conflict_ns = t_ns;
        }
    }
    uint8_t miso = PULLED_UP;
    for (uint32_t slot = 0; rest != 0; slot++, rest >>= 1) {
        if ((rest & 1u) != 0) {
            miso &= sensor_transfer(&bus->sensors[slot], t_ns, mosi);
        }
    }
    if (fault_active(&bus->faults, FAULT_BUS, FAULT_MISO_LOW, t_ns) != NULL) {
        return 0x00;
    }
    return fault_active(&bus->faults, FAULT_BUS, FAULT_MISO_HIGH, t_ns) != NULL ? PULLED_UP : miso;
}

bool sensor_bus_miso(const struct sensor_bus *bus, uint64_t t_ns, bool pulled_up) {
    if (fault_active(&bus->faults, FAULT_BUS, FAULT_MISO_LOW, t_ns) != NULL) {
        return false;
    }
    return pulled_up || fault_active(&bus->faults, FAULT_BUS, FAULT_MISO_HIGH, t_ns) != NULL;
}

void sensor_bus_select_clock(void *context, uint64_t t_ns, bool data) {
    struct sensor_bus *bus = context;
    flip_flop_chain_clock(&bus->chain, data);
    select(bus, t_ns);
}
