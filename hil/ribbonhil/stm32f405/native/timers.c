/* TIM2 to TIM5 (RM0090, 18) as up-counters with an update interrupt; TIM2 and TIM5 count 32 bits. */
#include "machine.h"

enum {
    CR1 = 0x00,
    CR2 = 0x04,
    SMCR = 0x08,
    DIER = 0x0C,
    SR = 0x10,
    EGR = 0x14,
    CNT = 0x24,
    PSC = 0x28,
    ARR = 0x2C
};

#define CR1_CEN  (1u << 0)
#define DIER_UIE (1u << 0)
#define SR_UIF   (1u << 0)
#define EGR_UG   (1u << 0)

static const uint32_t EXCEPTIONS[4] = {EXCEPTION_TIM2, EXCEPTION_TIM3, EXCEPTION_TIM4, EXCEPTION_TIM5};

void timers_reset(struct mcu *mcu) {
    for (unsigned i = 0; i < 4; i++) {
        mcu->timer[i] = (struct timer){.arr = i == 0 || i == 3 ? 0xFFFFFFFFu : 0xFFFFu};
    }
}

static uint64_t ticks_of_count(const struct mcu *mcu, const struct timer *timer) {
    return TICKS_HZ * (timer->psc + 1ull) / rcc_timer_hz(mcu);
}

static uint64_t period(const struct timer *timer) {
    return timer->arr + 1ull;
}

static uint32_t count(const struct mcu *mcu, const struct timer *timer) {
    if ((timer->cr1 & CR1_CEN) == 0) {
        return timer->count;
    }
    const uint64_t counted = (mcu->now - timer->started) / ticks_of_count(mcu, timer);
    return (uint32_t)((timer->count + counted) % period(timer));
}

uint32_t timers_count(const struct mcu *mcu, unsigned instance) {
    return count(mcu, &mcu->timer[instance]);
}

/* An update sets UIF; without an interrupt nobody is woken and no event is needed. */
static void schedule(struct mcu *mcu, unsigned instance) {
    const struct timer *const timer = &mcu->timer[instance];
    uint64_t at = NEVER;
    if ((timer->cr1 & CR1_CEN) != 0 && (timer->dier & DIER_UIE) != 0) {
        const uint64_t counts = period(timer) - count(mcu, timer);
        const uint64_t ticks = ticks_of_count(mcu, timer);
        at = timer->started + ((mcu->now - timer->started) / ticks + counts) * ticks;
    }
    time_schedule(mcu, EVENT_TIMER_FIRST + instance, at);
}

static void update_interrupt(struct mcu *mcu, unsigned instance) {
    const struct timer *const timer = &mcu->timer[instance];
    nvic_set_line(mcu, EXCEPTIONS[instance], (timer->sr & timer->dier & SR_UIF) != 0);
}

void timers_event(struct mcu *mcu, unsigned instance) {
    struct timer *const timer = &mcu->timer[instance];
    timer->sr |= SR_UIF;
    mcu->events[EVENT_TIMER_FIRST + instance] += period(timer) * ticks_of_count(mcu, timer);
    update_interrupt(mcu, instance);
}

uint32_t timers_read(struct mcu *mcu, unsigned instance, uint32_t offset) {
    const struct timer *const timer = &mcu->timer[instance];
    switch (offset) {
    case CR1:
        return timer->cr1;
    case CR2:
    case SMCR:
    case EGR:
        return 0;
    case DIER:
        return timer->dier;
    case SR:
        return timer->sr;
    case CNT: {
        const uint32_t value = count(mcu, timer);
        if (instance == 0) {
            mcu_log(mcu, LOGGED_LOOK, value, 0, 0);
        }
        return value;
    }
    case PSC:
        return timer->psc_preload;
    case ARR:
        return timer->arr;
    default:
        mcu_forbid(mcu, "read of timer register %#x, which is not modelled", offset);
        return 0;
    }
}

void timers_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value) {
    struct timer *const timer = &mcu->timer[instance];
    const uint32_t now = count(mcu, timer);
    switch (offset) {
    case CR1:
        timer->count = now;
        timer->started = mcu->now;
        timer->cr1 = value;
        if ((value & ~CR1_CEN) != 0) {
            mcu_forbid(mcu, "timer mode %#x is not modelled", value);
        }
        break;
    case DIER:
        timer->dier = value;
        if ((value & ~DIER_UIE) != 0) {
            mcu_forbid(mcu, "timer interrupts %#x are not modelled", value);
        }
        break;
    case SR:
        timer->sr &= value;
        break;
    case EGR: /* an update: loads the prescaler and starts from 0 */
        if ((value & EGR_UG) != 0) {
            timer->psc = timer->psc_preload;
            timer->count = 0;
            timer->started = mcu->now;
            timer->sr |= SR_UIF;
        }
        break;
    case CNT:
        timer->count = value;
        timer->started = mcu->now;
        break;
    case PSC:
        timer->psc_preload = value & 0xFFFFu;
        break;
    case ARR:
        timer->arr = instance == 0 || instance == 3 ? value : value & 0xFFFFu;
        break;
    default:
        mcu_forbid(mcu, "write to timer register %#x, which is not modelled", offset);
        break;
    }
    schedule(mcu, instance);
    update_interrupt(mcu, instance);
}
