/* The firmware under a 50 kHz tick whose handler calculates with floating point: none of its orientations may
 * notice. */
#include <string.h>

#include "app_state.h"
#include "port.h"

enum { TICK_HZ = 50000, TIMER_HZ = 84000000, VECTORS = 16 + IRQ_COUNT };

#define TIM5       ((struct tim_registers *)0x40000C00u)
#define TIM5_IRQ   50u
#define TIM5_CLOCK (1u << 3) /* RCC_APB1ENR_TIM5EN */
#define UPDATE     (1u << 0) /* TIM_DIER_UIE, TIM_SR_UIF */

struct board the_board;

volatile uint32_t stress_ticks;
static volatile float sum = 1.0f;

static void tick_handler(void) {
    TIM5->SR = ~UPDATE;
    stress_ticks++;
    float x = sum;
    for (int i = 0; i < 4; i++) {
        x = x * 0.5f + (float)stress_ticks / (x + 3.0f);
    }
    sum = x;
}

static void start_tick(void) {
    static void (*vectors[VECTORS])(void) __attribute__((aligned(512)));
    memcpy(vectors, (const void *)SCB->VTOR, sizeof vectors);
    vectors[16 + TIM5_IRQ] = tick_handler;
    interrupts_off();
    SCB->VTOR = (uint32_t)vectors;
    barrier();
    RCC->APB1ENR |= TIM5_CLOCK;
    (void)RCC->APB1ENR;
    TIM5->ARR = TIMER_HZ / TICK_HZ - 1;
    TIM5->EGR = TIM_EGR_UG;
    TIM5->SR = 0;
    TIM5->DIER = UPDATE;
    TIM5->CR1 = TIM_CR1_CEN;
    NVIC->ISER[TIM5_IRQ >> 5] = 1u << (TIM5_IRQ & 31u);
    interrupts_on();
}

int main(void) {
    static struct app app;
    board_start(&the_board);
    start_tick();
    app_init(&app, &the_board);
    for (;;) {
        app_poll(&app);
    }
}
