/* When the next scan starts: evenly spaced, at any rate, without drift, at a phase that the host may set. */
#include "schedule.h"

static const uint32_t US_PER_S = 1000000u;

void schedule_start(struct schedule *schedule, uint32_t rate_hz, uint32_t first_us) {
    *schedule = (struct schedule){.rate_hz = rate_hz, .next_us = first_us, .remainder = 0u};
}

static void add_period(struct schedule *schedule) {
    schedule->next_us += US_PER_S / schedule->rate_hz;
    schedule->remainder += US_PER_S % schedule->rate_hz;
    if (schedule->remainder >= schedule->rate_hz) {
        schedule->remainder -= schedule->rate_hz;
        schedule->next_us++;
    }
}

uint32_t schedule_advance(struct schedule *schedule, uint32_t now_us) {
    const uint32_t half_period_us = US_PER_S / schedule->rate_hz / 2u;
    uint32_t left_out = 0u;
    add_period(schedule);
    while (schedule_is_past(schedule->next_us + half_period_us, now_us)) {
        add_period(schedule);
        left_out++;
    }
    return left_out;
}

int32_t schedule_set_phase(struct schedule *schedule, uint32_t t_us, uint32_t now_us) {
    /* In units of 1/rate_hz microseconds a period is a whole number; whole seconds are whole periods. */
    const int32_t period = (int32_t)US_PER_S;
    const int32_t rate_hz = (int32_t)schedule->rate_hz;
    const int32_t remainder = (int32_t)schedule->remainder;
    int32_t move = ((int32_t)(t_us - schedule->next_us) % period * rate_hz - remainder) % period;
    if (move > period / 2)
        move -= period;
    else if (move < -period / 2)
        move += period;
    const int32_t moved = move + remainder;
    const int32_t moved_us = (moved >= 0 ? moved + rate_hz / 2 : moved - rate_hz / 2) / rate_hz;
    schedule->next_us += (uint32_t)moved_us;
    schedule->remainder = 0u;
    while (!schedule_is_past(now_us, schedule->next_us))
        add_period(schedule);
    return moved_us;
}
