/* Virtual time: what happens next, and jumps over what nobody needs to live through. */
#include "machine.h"

void time_schedule(struct mcu *mcu, enum event event, uint64_t at) {
    mcu->events[event] = at;
    if (at < mcu->stop_at) {
        mcu->stop_at = at;
    }
}

/* The CPU returns before its next block of code. */
void time_stop_now(struct mcu *mcu) {
    mcu->stop_at = 0;
}

void time_find_next(struct mcu *mcu) {
    mcu->stop_at = mcu->horizon;
    for (int event = 0; event < EVENT_COUNT; event++) {
        if (mcu->events[event] < mcu->stop_at) {
            mcu->stop_at = mcu->events[event];
        }
    }
}

static bool take(struct mcu *mcu, int event) {
    if (mcu->events[event] > mcu->now) {
        return false;
    }
    mcu->events[event] = NEVER;
    return true;
}

void time_handle_events(struct mcu *mcu) {
    if (take(mcu, EVENT_SYSTICK)) {
        systick_event(mcu);
    }
    for (unsigned timer = 0; timer < 4; timer++) {
        if (mcu->events[EVENT_TIMER_FIRST + timer] <= mcu->now) {
            timers_event(mcu, timer);
        }
    }
    while (mcu->events[EVENT_LINK_SENT] <= mcu->now) {
        usart_sent(mcu);
    }
    if (mcu->events[EVENT_LINK_RECEIVED] <= mcu->now) {
        usart_received(mcu);
    }
    if (take(mcu, EVENT_CRYSTAL_FAILS)) {
        rcc_crystal_fails(mcu);
    }
    if (take(mcu, EVENT_WATCHDOG)) {
        mcu->counters.watchdog_resets++;
        mcu_request_reset(mcu, 1u << 29); /* WDGRSTF */
    }
}

void time_warp(struct mcu *mcu, uint64_t to) {
    if (mcu->polled && to != NEVER && to > mcu->now) {
        mcu->now = to;
    }
}
