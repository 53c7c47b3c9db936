/* The independent watchdog (RM0090, 21): once started only a reset stops it. */
#include "machine.h"

enum { KR = 0x00, PR = 0x04, RLR = 0x08, SR = 0x0C };
enum { KEY_UNLOCK = 0x5555, KEY_FEED = 0xAAAA, KEY_START = 0xCCCC };

#define LSI_HZ 32000u

void iwdg_reset(struct mcu *mcu) {
    mcu->iwdg = (struct iwdg){.rlr = 0xFFF};
}

static void feed(struct mcu *mcu) {
    const struct iwdg *const iwdg = &mcu->iwdg;
    const uint32_t shift = iwdg->pr < 6 ? iwdg->pr : 6;
    const uint64_t ticks = (4ull << shift) * (iwdg->rlr + 1ull) * (TICKS_HZ / LSI_HZ);
    time_schedule(mcu, EVENT_WATCHDOG, iwdg->running ? mcu->now + ticks : NEVER);
}

uint32_t iwdg_read(struct mcu *mcu, unsigned instance, uint32_t offset) {
    (void)instance;
    switch (offset) {
    case PR:
        return mcu->iwdg.pr;
    case RLR:
        return mcu->iwdg.rlr;
    default:
        return 0; /* KR cannot be read; SR: an update takes no time here */
    }
}

void iwdg_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value) {
    (void)instance;
    struct iwdg *const iwdg = &mcu->iwdg;
    switch (offset) {
    case KR:
        iwdg->unlocked = value == KEY_UNLOCK;
        if (value == KEY_START) {
            iwdg->running = true;
        }
        if (value == KEY_START || value == KEY_FEED) {
            feed(mcu);
        }
        break;
    case PR:
    case RLR:
        if (!iwdg->unlocked) {
            mcu_forbid(mcu, "IWDG register %#x written while locked", offset);
        } else if (offset == PR) {
            iwdg->pr = value & 7u;
        } else {
            iwdg->rlr = value & 0xFFFu;
        }
        break;
    default:
        mcu_forbid(mcu, "write to IWDG register %#x", offset);
        break;
    }
}
