/* What the core does on exceptions, as lines "name value" on USART2: the same program runs on each model of
 * the core, and the lines must agree. It links with the port's own start-up and uses interrupts of its own.
 */
#include "port.h"

struct board the_board;

enum { LOW = 0x80, MIDDLE = 0x40, HIGH = 0x20, LOWEST = 0xF0 };
enum { FIRST_IRQ = 17, SECOND_IRQ = 28 };

static volatile uint32_t svc_argument, svc_exc_return, pendsv_count, tick_count;
static volatile uint32_t order, depth, deepest; /* order: one hexadecimal digit an event */
static volatile uint32_t fault_pc, fault_cfsr;
static volatile float handler_float = 1.0f;

static void send(char c) {
    while ((USART2->SR & USART_SR_TXE) == 0) {
    }
    USART2->DR = (uint32_t)c;
}

static void report(const char *name, uint32_t value) {
    while (*name != '\0') {
        send(*name++);
    }
    send(' ');
    for (int shift = 28; shift >= 0; shift -= 4) {
        send("0123456789abcdef"[value >> shift & 15u]);
    }
    send('\n');
}

static void note(uint32_t digit) {
    order = order << 4 | digit;
}

static void pend(uint32_t irq) {
    *(volatile uint32_t *)0xE000E200u = 1u << irq; /* NVIC_ISPR0 */
    barrier();
}

#define SCB_ICSR_PENDSVSET (1u << 28)
static void pend_pendsv(void) {
    SCB->ICSR = SCB_ICSR_PENDSVSET;
    barrier();
}

/* ---- handlers */

__attribute__((naked)) static void svc_handler(void) {
    __asm volatile("tst lr, #4\n\tite eq\n\tmrseq r0, msp\n\tmrsne r0, psp\n\tmov r1, lr\n\tb svc_body");
}

__attribute__((used)) void svc_body(uint32_t *frame, uint32_t exc_return);
void svc_body(uint32_t *frame, uint32_t exc_return) {
    svc_argument = *(const uint8_t *)(frame[6] - 2u);
    svc_exc_return = exc_return;
    frame[0] += 100u;
}

static void pendsv_handler(void) {
    pendsv_count++;
    note(0xE);
    handler_float = handler_float * 1.5f + 1.0f;
}

static void second_handler(void) {
    note(2);
    depth++;
    deepest = depth > deepest ? depth : deepest;
    pend(FIRST_IRQ);
    note(3);
    handler_float += 2.0f;
    depth--;
}

static void first_handler(void) {
    note(1);
    depth++;
    deepest = depth > deepest ? depth : deepest;
    handler_float *= 0.5f;
    depth--;
}

static void tick_handler(void) {
    tick_count++;
    handler_float = handler_float * 0.5f + (float)tick_count;
}

/* Skips the four bytes of the instruction that faulted. */
__attribute__((naked)) static void fault_handler(void) {
    __asm volatile("mrs r0, msp\n\tb fault_body");
}

__attribute__((used)) void fault_body(uint32_t *frame);
void fault_body(uint32_t *frame) {
    fault_pc = frame[6];
    fault_cfsr = SCB->CFSR;
    SCB->CFSR = fault_cfsr;
    frame[6] += 4u;
}

static void stray_handler(void) {
    uint32_t ipsr;
    __asm volatile("mrs %0, ipsr" : "=r"(ipsr));
    report("stray", ipsr);
    for (;;) {
    }
}

static void (*vectors[16 + IRQ_COUNT])(void) __attribute__((aligned(512)));

static void install(void) {
    for (unsigned i = 1; i < 16 + IRQ_COUNT; i++) {
        vectors[i] = stray_handler;
    }
    vectors[3] = fault_handler;
    vectors[11] = svc_handler;
    vectors[14] = pendsv_handler;
    vectors[15] = tick_handler;
    vectors[16 + FIRST_IRQ] = first_handler;
    vectors[16 + SECOND_IRQ] = second_handler;
    SCB->VTOR = (uint32_t)vectors;
    SCB->SHPR[10] = LOWEST; /* PendSV */
    NVIC->ISER[0] = 1u << FIRST_IRQ | 1u << SECOND_IRQ;
    barrier();
}

/* ---- what is tried */

static uint32_t svc(uint32_t value) {
    register uint32_t r0 __asm("r0") = value;
    __asm volatile("svc #42" : "+r"(r0)::"memory");
    return r0;
}

static void try_supervisor_calls(void) {
    report("svc_result", svc(5));
    report("svc_argument", svc_argument);
    report("svc_exc_return_thread_msp", svc_exc_return | 0x10u); /* with or without floating point before */
    __asm volatile("vmov s8, %0\n\tvmov s20, %0" ::"t"(1.25f) : "s8", "s20");
    svc(6);
    report("svc_exc_return_with_fp", svc_exc_return);
    uint32_t control;
    __asm volatile("mrs %0, control" : "=r"(control));
    report("control_fpca", control & 4u);
}

static void try_masks(void) {
    pend_pendsv();
    report("pendsv_at_once", pendsv_count);
    interrupts_off();
    pend_pendsv();
    report("pendsv_under_primask", pendsv_count);
    report("pendsv_pending", SCB->ICSR >> 28 & 1u);
    __asm volatile("wfi");
    interrupts_on();
    report("pendsv_after_primask", pendsv_count);

    NVIC->IPR[SECOND_IRQ] = MIDDLE;
    NVIC->IPR[FIRST_IRQ] = HIGH;
    uint32_t basepri = MIDDLE;
    __asm volatile("msr basepri, %0\n\tisb" ::"r"(basepri));
    order = 0;
    pend(SECOND_IRQ);
    report("order_under_basepri", order);
    basepri = 0;
    __asm volatile("msr basepri, %0\n\tisb" ::"r"(basepri));
    report("order_after_basepri", order);
}

static void try_nesting(void) {
    order = deepest = 0;
    pend(SECOND_IRQ);
    report("order_nested", order);
    report("depth_nested", deepest);
    NVIC->IPR[FIRST_IRQ] = LOW;
    order = deepest = 0;
    pend(SECOND_IRQ);
    report("order_one_after_the_other", order);
    report("depth_one_after_the_other", deepest);
    NVIC->IPR[FIRST_IRQ] = MIDDLE;
    interrupts_off();
    order = 0;
    pend(SECOND_IRQ);
    pend(FIRST_IRQ);
    pend_pendsv();
    interrupts_on();
    report("order_of_equals", order);
}

static uint32_t process_stack[128] __attribute__((aligned(8)));

static void try_process_stack(void) {
    uint32_t sp;
    __asm volatile("msr psp, %1\n\tmov r0, #2\n\tmsr control, r0\n\tisb\n\tmov %0, sp"
                   : "=r"(sp)
                   : "r"(&process_stack[120])
                   : "r0", "memory");
    const uint32_t result = svc(7);
    const uint32_t exc_return = svc_exc_return;
    __asm volatile("mov r0, #0\n\tmsr control, r0\n\tisb" ::: "r0", "memory");
    report("process_stack_used", sp == (uint32_t)&process_stack[120]);
    report("process_svc_result", result);
    report("process_exc_return", exc_return | 0x10u);
}

/* Arithmetic and conditional execution that a tick interrupts at every place; both must not notice. */
static void try_ticks(void) {
    SYSTICK->RVR = 997;
    SYSTICK->CVR = 0;
    SYSTICK->CSR = 1u << 2 | SYSTICK_CSR_TICKINT | SYSTICK_CSR_ENABLE;
    uint32_t wrong = 0;
    for (int i = 0; i < 20000; i++) {
        const float a = (float)i * 0.5f;
        float one = (a * 3.0f + 1.0f) - a * 3.0f;
        __asm volatile("" : "+t"(one));
        wrong += one < 0.99f || one > 1.01f;
        uint32_t two;
        __asm volatile(
            "movs r2, #1\n\tcmp r2, #1\n\tittee eq\n\tmoveq %0, #1\n\taddeq %0, %0, #1\n\tmovne %0, #9\n\t"
            "addne %0, #9"
            : "=r"(two)::"r2", "cc");
        wrong += two != 2;
    }
    SYSTICK->CSR = 0;
    report("wrong_under_ticks", wrong);
    report("many_ticks", tick_count > 50);
}

extern char read_nowhere[], undefined_instruction[];

static void try_faults(void) {
    uint32_t nowhere = 0x60000000u;
    __asm volatile(".global read_nowhere\nread_nowhere: ldr.w %0, [%0]" : "+r"(nowhere));
    report("bus_fault_at_its_instruction", fault_pc == (uint32_t)read_nowhere);
    report("bus_fault_cfsr", fault_cfsr);
    __asm volatile(".global undefined_instruction\nundefined_instruction: udf.w #0");
    report("undefined_at_its_instruction", fault_pc == (uint32_t)undefined_instruction);
    report("undefined_cfsr", fault_cfsr);
}

static void try_memory(void) {
    static const uint32_t words[2] = {0x44332211u, 0x88776655u};
    const volatile uint32_t *const unaligned = (const volatile uint32_t *)((uint32_t)words + 1u);
    report("unaligned_load", *unaligned);
    uint32_t returned = 0;
    for (int i = 0; i < 3; i++) {
        __asm volatile("sev\n\twfe");
        returned++;
    }
    report("wfe_returns", returned);
}

int main(void) {
    RCC->AHB1ENR |= RCC_AHB1ENR_GPIOAEN;
    RCC->APB1ENR |= RCC_APB1ENR_USART2EN;
    gpio_set_up_alternate(PIN('A', 2), 7);
    USART2->BRR = 16000000u / 921600u;
    USART2->CR1 = USART_CR1_UE | USART_CR1_TE;
    install();
    try_supervisor_calls();
    try_masks();
    try_nesting();
    try_process_stack();
    try_ticks();
    try_faults();
    try_memory();
    report("end", 0);
    for (;;) {
        __asm volatile("wfi");
    }
}
