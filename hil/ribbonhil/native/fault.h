/* What goes wrong on a sensor bus, in which slot, and when. */
#ifndef FAULT_H
#define FAULT_H

#include <stdint.h>

enum fault_kind {
    FAULT_ABSENT,       /* without power: drives nothing; powers up again when the fault ends */
    FAULT_WRONG_ID,     /* the identity register reads `parameter` */
    FAULT_STUCK,        /* new samples with the same counts over and over */
    FAULT_GARBAGE,      /* every byte read is random */
    FAULT_STALE,        /* no new samples */
    FAULT_INTERMITTENT, /* bad contact: drives nothing in a share `parameter` of all 20 ms */
    FAULT_DRIFT,        /* every axis moves by `parameter` m/s^2 or uT a second */
    FAULT_BIT_FLIPS,    /* each bit read is wrong with probability `parameter` */
    FAULT_BROWN_OUT,    /* at its start all registers fall to their power-up values */
    FAULT_SELECTED,     /* the select output is stuck low: this slot is always selected */
    FAULT_CROSSED,      /* the selects of this slot and slot `parameter` lead to each other's part */
    FAULT_SHORTED,      /* the selects of this slot and slot `parameter` touch: low on one is low on both */
    FAULT_MISO_LOW,     /* whole bus: every byte reads 0x00 */
    FAULT_MISO_HIGH,    /* whole bus: every byte reads 0xFF */
    FAULT_KIND_COUNT
};

#define FAULT_CAPACITY   128
#define FAULT_BUS        255 /* slot of the faults of the whole bus */
#define FAULT_CONTACT_NS 20000000u

struct fault {
    uint8_t kind; /* enum fault_kind */
    uint8_t slot;
    uint64_t start_ns; /* true time */
    uint64_t end_ns;
    double parameter;
};

struct fault_list {
    uint32_t count;
    struct fault faults[FAULT_CAPACITY];
};

/* Adds a fault; 0, or -1 if the list is full or the fault is none. */
int fault_add(struct fault_list *list, const struct fault *fault);

/* The fault of this kind that this slot has at t_ns (start <= t < end), or a null pointer. */
const struct fault *fault_active(const struct fault_list *list, uint32_t slot, enum fault_kind kind,
                                 uint64_t t_ns);

/* The last time in (after_ns, until_ns] at which a fault made the slot start from power-up; 0 if none. */
uint64_t fault_last_power_up_ns(const struct fault_list *list, uint32_t slot, uint64_t after_ns,
                                uint64_t until_ns);

#endif
