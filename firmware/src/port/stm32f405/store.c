/* The calibration store: flash sectors 2 and 3, 16 KiB each. */
#include <string.h>

#include "port.h"

#define STORE_FIRST_SECTOR 2u
#define POLLS_MAX          40000000u /* 1 s, should the core not stall and a poll take 4 cycles */
#define ERRORS (FLASH_SR_OPERR | FLASH_SR_WRPERR | FLASH_SR_PGAERR | FLASH_SR_PGPERR | FLASH_SR_PGSERR)

extern uint8_t store_area_0[], store_area_1[]; /* link.ld */

static uint8_t *area_start(unsigned area) {
    return area == 0 ? store_area_0 : store_area_1;
}

static bool wait_idle(void) {
    return poll_until(&FLASH->SR, FLASH_SR_BSY, 0, POLLS_MAX);
}

static bool begin(void) {
    if (!wait_idle()) {
        return false;
    }
    FLASH->KEYR = FLASH_KEYR_KEY_FIRST;
    FLASH->KEYR = FLASH_KEYR_KEY_SECOND;
    FLASH->SR = ERRORS; /* cleared by writing ones */
    return (FLASH->CR & FLASH_CR_LOCK) == 0;
}

/* The data cache may still hold what was there before. It may only be reset while it is off. */
static bool end(void) {
    const bool done = wait_idle() && (FLASH->SR & ERRORS) == 0;
    FLASH->CR = FLASH_CR_LOCK;
    const uint32_t acr = FLASH->ACR;
    FLASH->ACR = acr & ~FLASH_ACR_DCEN;
    FLASH->ACR = (acr & ~FLASH_ACR_DCEN) | FLASH_ACR_DCRST;
    FLASH->ACR = acr & ~FLASH_ACR_DCEN;
    FLASH->ACR = acr;
    return done;
}

/* The core stalls while the flash it runs from is being erased: the watchdog is fed just before. */
bool board_store_erase(struct board *board, unsigned area) {
    (void)board;
    if (area > 1 || !begin()) {
        return false;
    }
    watchdog_feed();
    FLASH->CR = FLASH_CR_PSIZE_32 | FLASH_CR_SER | FLASH_CR_SNB(STORE_FIRST_SECTOR + area);
    FLASH->CR |= FLASH_CR_STRT;
    barrier();
    const bool done = end();
    watchdog_feed();
    return done;
}

bool board_store_write(struct board *board, unsigned area, size_t offset, const uint8_t *bytes, size_t n) {
    (void)board;
    if (area > 1 || offset % 4 != 0 || n % 4 != 0 || offset > BOARD_STORE_BYTES ||
        n > BOARD_STORE_BYTES - offset || !begin()) {
        return false;
    }
    volatile uint32_t *word = (volatile uint32_t *)(area_start(area) + offset);
    FLASH->CR = FLASH_CR_PSIZE_32 | FLASH_CR_PG;
    bool going = true;
    for (size_t i = 0; i < n && going; i += 4) {
        uint32_t value;
        memcpy(&value, bytes + i, 4);
        *word++ = value;
        barrier();
        going = wait_idle() && (FLASH->SR & ERRORS) == 0;
    }
    const bool done = end() && going;
    return done && memcmp(area_start(area) + offset, bytes, n) == 0;
}

void board_store_read(struct board *board, unsigned area, size_t offset, uint8_t *bytes, size_t n) {
    (void)board;
    if (area > 1 || offset > BOARD_STORE_BYTES || n > BOARD_STORE_BYTES - offset) {
        memset(bytes, 0xFF, n);
        return;
    }
    memcpy(bytes, area_start(area) + offset, n);
}
