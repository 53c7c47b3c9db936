/* The way into the boot loader in ROM: through a reset, after which no watchdog runs and no clock is set. */
#include "port.h"

#define ASKED 0x21554644u /* "DFU!" */

__attribute__((section(".noinit"))) static uint32_t request;

bool board_has_dfu(struct board *board) {
    return board->clocks.answered;
}

void board_enter_dfu(struct board *board) {
    if (!board_has_dfu(board)) {
        return;
    }
    link_flush(board);
    request = ASKED;
    system_reset();
}

void dfu_enter_if_asked(void) {
    if (request != ASKED) {
        return;
    }
    request = 0;
    RCC->APB2ENR |= RCC_APB2ENR_SYSCFGEN;
    (void)RCC->APB2ENR;
    SYSCFG->MEMRMP = SYSCFG_MEMRMP_MEM_MODE_SYSTEM;
    barrier();
    const uint32_t *const vectors = (const uint32_t *)SYSTEM_MEMORY;
    __asm volatile("msr msp, %0\n\tbx %1" ::"r"(vectors[0]), "r"(vectors[1]) : "memory");
}
