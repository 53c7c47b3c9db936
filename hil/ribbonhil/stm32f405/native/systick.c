/* SysTick (Armv7-M ARM, B3.3): counts down from the reload value, at HCLK or an eighth of it. */
#include "machine.h"

enum { CSR = 0xE010, RVR = 0xE014, CVR = 0xE018, CALIB = 0xE01C };

#define CSR_ENABLE    (1u << 0)
#define CSR_TICKINT   (1u << 1)
#define CSR_CLKSOURCE (1u << 2)
#define CSR_COUNTFLAG (1u << 16)

void systick_reset(struct mcu *mcu) {
    mcu->systick = (struct systick){0};
}

static uint64_t ticks_of_counts(const struct mcu *mcu, uint64_t counts) {
    const uint64_t divider = (mcu->systick.csr & CSR_CLKSOURCE) != 0 ? 1 : 8;
    return counts * TICKS_HZ * divider / rcc_hclk_hz(mcu);
}

static void start(struct mcu *mcu, uint64_t at) {
    mcu->systick.started = at;
    const bool runs = (mcu->systick.csr & CSR_ENABLE) != 0 && mcu->systick.rvr != 0;
    time_schedule(mcu, EVENT_SYSTICK, runs ? at + ticks_of_counts(mcu, mcu->systick.rvr + 1ull) : NEVER);
}

void systick_event(struct mcu *mcu) {
    struct systick *const systick = &mcu->systick;
    systick->flagged = true;
    if ((systick->csr & CSR_TICKINT) != 0) {
        nvic_pend(mcu, EXCEPTION_SYSTICK);
    }
    start(mcu, systick->started + ticks_of_counts(mcu, systick->rvr + 1ull));
}

uint32_t systick_read(struct mcu *mcu, uint32_t offset) {
    struct systick *const systick = &mcu->systick;
    switch (offset) {
    case CSR: {
        const uint32_t value = systick->csr | (systick->flagged ? CSR_COUNTFLAG : 0);
        systick->flagged = false;
        return value;
    }
    case RVR:
        return systick->rvr;
    case CVR: {
        const uint64_t next = mcu->events[EVENT_SYSTICK];
        return next == NEVER || next <= mcu->now ? 0
                                                 : (uint32_t)((next - mcu->now) / (ticks_of_counts(mcu, 1)));
    }
    default:
        return 0; /* CALIB: nothing is known */
    }
}

void systick_write(struct mcu *mcu, uint32_t offset, uint32_t value) {
    struct systick *const systick = &mcu->systick;
    switch (offset) {
    case CSR: {
        const bool was_running = (systick->csr & CSR_ENABLE) != 0;
        systick->csr = value & (CSR_ENABLE | CSR_TICKINT | CSR_CLKSOURCE);
        if (was_running != ((value & CSR_ENABLE) != 0)) {
            start(mcu, mcu->now);
        }
        break;
    }
    case RVR:
        systick->rvr = value & 0x00FFFFFFu;
        break;
    case CVR:
        systick->flagged = false;
        start(mcu, mcu->now);
        break;
    default:
        break;
    }
}
