/* From reset to main: vectors, memory, floating point. */
#include "port.h"

/* Places that link.ld gives. */
extern uint32_t data_load[], data_start[], data_end[], bss_start[], bss_end[], stack_top[];

int main(void);
void reset_handler(void);
void nmi_handler(void);
void hard_fault_handler(void);
void systick_handler(void);

/* An interrupt that nobody asked for leaves its trace like any other fault. */
__attribute__((naked)) void unexpected_handler(void);
void unexpected_handler(void) {
    __asm volatile("b hard_fault_handler");
}

#define USED_BY_SOME_BOARDS __attribute__((weak, alias("unexpected_handler")))
void dma1_stream3_handler(void) USED_BY_SOME_BOARDS;
void dma1_stream6_handler(void) USED_BY_SOME_BOARDS;
void usart2_handler(void) USED_BY_SOME_BOARDS;
void usart3_handler(void) USED_BY_SOME_BOARDS;

struct vector_table {
    uint32_t *initial_stack;
    void (*core[15])(void);
    void (*interrupts[IRQ_COUNT])(void);
};

__attribute__((section(".vectors"), used)) static const struct vector_table vectors = {
    .initial_stack = stack_top,
    .core =
        {
            reset_handler,
            nmi_handler,
            hard_fault_handler,
            unexpected_handler,
            unexpected_handler,
            unexpected_handler,
            unexpected_handler,
            unexpected_handler,
            unexpected_handler,
            unexpected_handler,
            unexpected_handler,
            unexpected_handler,
            unexpected_handler,
            unexpected_handler,
            systick_handler,
        },
    .interrupts =
        {
            [0 ... IRQ_DMA1_STREAM3 - 1] = unexpected_handler,
            [IRQ_DMA1_STREAM3] = dma1_stream3_handler,
            [IRQ_DMA1_STREAM3 + 1 ... IRQ_DMA1_STREAM6 - 1] = unexpected_handler,
            [IRQ_DMA1_STREAM6] = dma1_stream6_handler,
            [IRQ_DMA1_STREAM6 + 1 ... IRQ_USART2 - 1] = unexpected_handler,
            [IRQ_USART2] = usart2_handler,
            [IRQ_USART3] = usart3_handler,
            [IRQ_USART3 + 1 ... IRQ_COUNT - 1] = unexpected_handler,
        },
};

/* Runs before memory is initialised: what is called first looks only at registers and at memory that no start
 * clears. A boot loader that has written a new image jumps here with its own clocks and interrupts still on.
 */
void reset_handler(void) {
    if (!clocks_are_reset()) {
        system_reset();
    }
    dfu_enter_if_asked();

    SCB->VTOR = (uint32_t)&vectors; /* a debugger or boot loader may have started us without a reset */
    SCB->CPACR |= SCB_CPACR_FPU_FULL;
    barrier();

    const uint32_t *load = data_load;
    for (uint32_t *p = data_start; p < data_end; p++) {
        *p = *load++;
    }
    for (uint32_t *p = bss_start; p < bss_end; p++) {
        *p = 0;
    }
    main();
    system_reset();
}

_Noreturn void system_reset(void) {
    barrier();
    SCB->AIRCR = SCB_AIRCR_VECTKEY_SYSRESETREQ;
    barrier();
    for (;;) {
    }
}
