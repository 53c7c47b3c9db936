/* The independent watchdog: restarts a main loop that makes no progress. */
#include "port.h"

/* 2.0 s at the nominal 32 kHz, 1.4 s at the fastest 47 kHz: an erase stalls the core for at most 1 s. */
#define RELOAD    1000u
#define POLLS_MAX 100000u

void watchdog_start(void) {
    IWDG->KR = IWDG_KR_KEY_START; /* also starts the oscillator that the next two writes wait for */
    IWDG->KR = IWDG_KR_KEY_UNLOCK;
    IWDG->PR = IWDG_PR_PR_DIV64;
    IWDG->RLR = RELOAD;
    (void)poll_until(&IWDG->SR, 3u, 0, POLLS_MAX);
    watchdog_feed();
}

void watchdog_feed(void) {
    IWDG->KR = IWDG_KR_KEY_FEED;
}

void board_made_progress(struct board *board) {
    (void)board;
    watchdog_feed();
}
