/* Hard faults: where it happened is kept over the restart that follows. */
#include "port.h"

#define RECORD_MAGIC 0x46415554u
#define UNKNOWN      0xFFFFFFFFu /* the stack itself was gone */

__attribute__((section(".noinit"))) static struct fault_record kept;

extern uint32_t ram_start[], ram_end[]; /* link.ld */

/* What the core stacks on entry of an exception (Armv7-M ARM, B1.5.6). */
struct exception_frame {
    uint32_t r0, r1, r2, r3, r12, lr, pc, xpsr;
};

void faults_start(void) {
    SCB->CCR |= SCB_CCR_DIV_0_TRP;
}

bool faults_take_record(struct fault_record *record) {
    *record = kept;
    kept.magic = 0;
    return record->magic == RECORD_MAGIC;
}

/* The stack pointer is set anew: the fault may be that the stack is full. */
__attribute__((naked)) void hard_fault_handler(void);
void hard_fault_handler(void) {
    __asm volatile("mrs r0, msp\n\t"
                   "ldr r1, =stack_top\n\t"
                   "mov sp, r1\n\t"
                   "b fault_record_and_restart");
}

__attribute__((used)) _Noreturn void fault_record_and_restart(const struct exception_frame *frame);
void fault_record_and_restart(const struct exception_frame *frame) {
    const bool readable =
        (uintptr_t)frame >= (uintptr_t)ram_start && (uintptr_t)(frame + 1) <= (uintptr_t)ram_end;
    kept.pc = readable ? frame->pc : UNKNOWN;
    kept.lr = readable ? frame->lr : UNKNOWN;
    kept.cfsr = SCB->CFSR;
    kept.magic = RECORD_MAGIC;
    system_reset();
}
