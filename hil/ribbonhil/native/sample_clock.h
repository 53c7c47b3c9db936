/* When a part takes its samples: by its own oscillator, not the firmware's clock. */
#ifndef SAMPLE_CLOCK_H
#define SAMPLE_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

#include "fault.h"

struct sample_clock {
    double start_ns;  /* true time; the first sample ends one period later */
    double period_ns; /* 0: stopped */
    uint64_t run;     /* samples since the start */
    uint64_t taken;   /* samples since power-up, counted on over stops: numbers the noise */
};

/* Starts anew, or stops with period_ns = 0. */
void sample_clock_start(struct sample_clock *clock, double start_ns, double period_ns);

/* Moves to t_ns; true if at least one sample has ended since the last call. Then *ended_ns is the end of the
 * newest and *passed counts all that ended. While a stale fault lasts, no sample ends. */
bool sample_clock_advance(struct sample_clock *clock, const struct fault_list *faults, uint32_t slot,
                          uint64_t t_ns, double *ended_ns, uint64_t *passed);

#endif
