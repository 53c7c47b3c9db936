/* Samples in equal steps of a part's own oscillator. */
#include "sample_clock.h"

#include <math.h>
#include <stddef.h>

void sample_clock_start(struct sample_clock *clock, double start_ns, double period_ns) {
    clock->start_ns = start_ns;
    clock->period_ns = period_ns;
    clock->run = 0;
}

static uint64_t samples_until(const struct sample_clock *clock, double t_ns) {
    double count = floor((t_ns - clock->start_ns) / clock->period_ns);
    return count > 0.0 ? (uint64_t)count : 0u;
}

bool sample_clock_advance(struct sample_clock *clock, const struct fault_list *faults, uint32_t slot,
                          uint64_t t_ns, double *ended_ns, uint64_t *passed) {
    if (clock->period_ns <= 0.0) {
        return false;
    }
    uint64_t due = samples_until(clock, (double)t_ns);
    while (due > clock->run) {
        double end_ns = clock->start_ns + (double)due * clock->period_ns;
        const struct fault *stale = fault_active(faults, slot, FAULT_STALE, (uint64_t)end_ns);
        if (stale == NULL) {
            *ended_ns = end_ns;
            *passed = due - clock->run;
            clock->taken += *passed;
            clock->run = due;
            return true;
        }
        uint64_t before = samples_until(clock, (double)stale->start_ns);
        due = before < due ? before : due - 1u;
    }
    return false;
}
