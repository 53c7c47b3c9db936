/* When the next scan starts: evenly spaced, at any rate, without drift, at a phase that the host may set. */
#ifndef SCHEDULE_H
#define SCHEDULE_H

#include <stdbool.h>
#include <stdint.h>

struct schedule {
    uint32_t rate_hz;
    uint32_t next_us; /* device time at which the next scan starts */
    uint32_t
        remainder; /* what the period has beyond whole microseconds, in 1/rate_hz microseconds, added up */
};

/* Whether t_us has come, on a clock that wraps. */
static inline bool schedule_is_past(uint32_t t_us, uint32_t now_us) {
    return (int32_t)(now_us - t_us) >= 0;
}

/* Scans at rate_hz (1 or more), the first at first_us. */
void schedule_start(struct schedule *schedule, uint32_t rate_hz, uint32_t first_us);

/* To be called when a scan is done, at now_us: moves on to the next one that is not late by more than half a
 * period; returns how many were left out. */
uint32_t schedule_advance(struct schedule *schedule, uint32_t now_us);

/* Moves the scans, by half a period at most, such that t_us is whole periods away from them; none is before
 * now_us. Returns by how many microseconds they moved. */
int32_t schedule_set_phase(struct schedule *schedule, uint32_t t_us, uint32_t now_us);

#endif
