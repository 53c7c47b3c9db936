/* The flash interface (RM0090, 3): what programming and erasing need, refuse, and leave when power fails. */
#include <string.h>

#include "machine.h"

enum { ACR = 0x00, KEYR = 0x04, OPTKEYR = 0x08, SR = 0x0C, CR = 0x10 };

#define KEY_FIRST  0x45670123u
#define KEY_SECOND 0xCDEF89ABu
#define SR_EOP     (1u << 0)
#define SR_WRPERR  (1u << 4)
#define SR_PGAERR  (1u << 5)
#define SR_PGPERR  (1u << 6)
#define SR_PGSERR  (1u << 7)
#define SR_ERRORS  (SR_WRPERR | SR_PGAERR | SR_PGPERR | SR_PGSERR | 2u)
#define CR_PG      (1u << 0)
#define CR_SER     (1u << 1)
#define CR_MER     (1u << 2)
#define CR_STRT    (1u << 16)
#define CR_LOCK    (1u << 31)
#define ACR_DCEN   (1u << 10)
#define ACR_DCRST  (1u << 12)

void flash_reset(struct mcu *mcu) {
    struct flash *const flash = &mcu->flash;
    flash->acr = 0;
    flash->sr = 0;
    flash->cr = CR_LOCK;
    flash->keys_given = 0;
    flash->key_wrong = false;
}

/* Counts an operation; true if power fails in the middle of it. */
static bool power_fails(struct mcu *mcu) {
    mcu->counters.flash_operations++;
    if (mcu->flash.cut_in == 0 || --mcu->flash.cut_in > 0) {
        return false;
    }
    mcu->power_cut = true;
    time_stop_now(mcu);
    return true;
}

/* The core runs from this flash: it stands still until the operation ends. */
static void stall(struct mcu *mcu, uint32_t us) {
    mcu->now += us * TICKS_PER_US;
    mcu->flash.sr |= SR_EOP;
}

static void erase(struct mcu *mcu) {
    struct flash *const flash = &mcu->flash;
    const uint32_t sector = flash->cr >> 3 & 15u;
    if ((flash->cr & CR_LOCK) != 0 || (flash->cr & CR_MER) != 0 || sector > 3) {
        mcu_forbid(mcu, "erase of sector %u with CR = %#x", sector, flash->cr);
        return;
    }
    if (sector < 2) {
        mcu_forbid(mcu, "the firmware erases itself");
    }
    uint8_t *const bytes = flash->memory + sector * SECTOR_BYTES;
    if (power_fails(mcu)) {
        for (uint32_t i = 0; i < SECTOR_BYTES; i++) {
            bytes[i] |= (uint8_t)mcu_random(mcu);
        }
        return;
    }
    memset(bytes, 0xFF, SECTOR_BYTES);
    stall(mcu, mcu->options.erase_us);
}

uint32_t flash_read(struct mcu *mcu, unsigned instance, uint32_t offset) {
    (void)instance;
    switch (offset) {
    case ACR:
        return mcu->flash.acr;
    case SR:
        return mcu->flash.sr;
    case CR:
        return mcu->flash.cr;
    default:
        return 0; /* keys cannot be read */
    }
}

/* A wrong key locks the interface until the next reset. */
static void give_key(struct flash *flash, uint32_t key) {
    if (flash->key_wrong || (flash->cr & CR_LOCK) == 0) {
        return;
    }
    if (key != (flash->keys_given == 0 ? KEY_FIRST : KEY_SECOND)) {
        flash->key_wrong = true;
    } else if (++flash->keys_given == 2) {
        flash->keys_given = 0;
        flash->cr &= ~CR_LOCK;
    }
}

void flash_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value) {
    (void)instance;
    struct flash *const flash = &mcu->flash;
    if (mcu->power_cut) {
        return;
    }
    switch (offset) {
    case ACR:
        if ((value & ACR_DCRST) != 0 && (flash->acr & ACR_DCEN) != 0) {
            mcu_forbid(mcu, "the data cache is reset while it is on");
        }
        flash->acr = value;
        break;
    case KEYR:
        give_key(flash, value);
        break;
    case SR:
        flash->sr &= ~value;
        break;
    case CR:
        if ((flash->cr & CR_LOCK) != 0) {
            mcu_forbid(mcu, "FLASH_CR written while locked");
            break;
        }
        flash->cr = value & ~CR_STRT;
        if ((value & CR_STRT) != 0 && (value & CR_SER) != 0) {
            erase(mcu);
        }
        break;
    default:
        mcu_forbid(mcu, "write to flash register %#x", offset);
        break;
    }
}

uint64_t flash_store_read(struct mcu *mcu, uint32_t address, unsigned size) {
    uint64_t value = 0;
    memcpy(&value, mcu->flash.memory + (address - FLASH_START), size);
    return value;
}

/* Programming can only clear bits; where it would have to set one, the result is not what was asked for. */
void flash_store_write(struct mcu *mcu, uint32_t address, unsigned size, uint32_t value) {
    struct flash *const flash = &mcu->flash;
    if (mcu->power_cut) {
        return;
    }
    if ((flash->cr & (CR_LOCK | CR_PG | CR_SER)) != CR_PG) {
        flash->sr |= SR_PGSERR;
        mcu_forbid(mcu, "write to flash at %#x without PG", address);
        return;
    }
    if (size != 1u << (flash->cr >> 8 & 3u)) {
        flash->sr |= SR_PGPERR;
        return;
    }
    if (address % size != 0) {
        flash->sr |= SR_PGAERR;
        return;
    }
    if ((flash->sr & SR_ERRORS) != 0) {
        return;
    }
    uint8_t *const bytes = flash->memory + (address - FLASH_START);
    uint32_t before = 0;
    memcpy(&before, bytes, size);
    if ((~before & value & (size == 4 ? ~0u : (1u << 8 * size) - 1u)) != 0) {
        mcu_forbid(mcu, "flash at %#x programmed without an erase before", address);
    }
    const bool fails = power_fails(mcu);
    const uint32_t after = before & (fails ? value | (uint32_t)mcu_random(mcu) : value);
    memcpy(bytes, &after, size);
    if (!fails) {
        stall(mcu, mcu->options.program_us);
    }
}
