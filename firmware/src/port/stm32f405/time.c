/* Time: TIM2 counts microseconds; SysTick wakes the core when a wait ends. */
#include "port.h"

/* SysTick runs at an eighth of the core clock and counts 24 bits: 0.79 s at 168 MHz. */
#define SYSTICK_DIVIDER  8u
#define SLEEP_LONGEST_US 500000

void time_start(const struct clocks *clocks) {
    RCC->APB1ENR |= RCC_APB1ENR_TIM2EN;
    (void)RCC->APB1ENR;
    /* Timers run at twice their bus clock unless that bus is undivided. */
    const uint32_t timer_hz = clocks->pclk1_hz == clocks->hclk_hz ? clocks->pclk1_hz : 2 * clocks->pclk1_hz;
    TIM2->PSC = timer_hz / 1000000u - 1;
    TIM2->ARR = 0xFFFFFFFFu;
    TIM2->EGR = TIM_EGR_UG; /* loads the prescaler */
    TIM2->CR1 = TIM_CR1_CEN;
}

uint32_t board_now_us(struct board *board) {
    (void)board;
    return TIM2->CNT;
}

void systick_handler(void);
void systick_handler(void) {
    SYSTICK->CSR = 0;
    the_board.slept = true;
}

static bool is_disturbed(const struct board *board) {
    return board->rx_head != board->rx_tail || board->send_ended;
}

/* Looks at the clock once: a log of all looks then tells what each of them was for. With interrupts off
 * nothing can come between a look at what they change and WFI, which wakes for a pending one. */
void board_wait_until(struct board *board, uint32_t t_us) {
    int32_t left_us = (int32_t)(t_us - TIM2->CNT);
    interrupts_off();
    while (left_us > 0 && !is_disturbed(board)) {
        const int32_t sleep_us = left_us < SLEEP_LONGEST_US ? left_us : SLEEP_LONGEST_US;
        board->slept = false;
        SYSTICK->RVR = (uint32_t)sleep_us * (board->clocks.hclk_hz / SYSTICK_DIVIDER / 1000000u);
        SYSTICK->CVR = 0;
        SYSTICK->CSR = SYSTICK_CSR_ENABLE | SYSTICK_CSR_TICKINT;
        while (!board->slept && !is_disturbed(board)) {
            __asm volatile("dsb\n\twfi" ::: "memory");
            interrupts_on();
            interrupts_off();
        }
        SYSTICK->CSR = 0;
        left_us -= sleep_us;
    }
    board->send_ended = false;
    interrupts_on();
}
