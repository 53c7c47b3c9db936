/* Entry to and return from exceptions (Armv7-M ARM, B1.5.6 to B1.5.8), floating-point registers included. */
#include "machine.h"

#define CONTROL_SPSEL (1u << 1)
#define CONTROL_FPCA  (1u << 2)
#define XPSR_KEPT     0xF80F0000u /* flags */
#define XPSR_THUMB    (1u << 24)
#define XPSR_ALIGNED  (1u << 9)

#define EXC_RETURN_BASE        0xFFFFFFE1u
#define EXC_RETURN_PROCESS     (1u << 2) /* the frame is on the process stack */
#define EXC_RETURN_THREAD      (1u << 3)
#define EXC_RETURN_BASIC_FRAME (1u << 4)

enum { BASIC_WORDS = 8, FP_REGISTERS = 16, EXTENDED_WORDS = 26 };

static const int STACKED[6] = {UC_ARM_REG_R0, UC_ARM_REG_R1,  UC_ARM_REG_R2,
                               UC_ARM_REG_R3, UC_ARM_REG_R12, UC_ARM_REG_LR};

void exception_enter(struct mcu *mcu, uint32_t number) {
    const uint32_t control = cpu_read(mcu, UC_ARM_REG_CONTROL);
    const uint32_t ipsr = cpu_read(mcu, UC_ARM_REG_IPSR);
    const uint32_t xpsr = cpu_read(mcu, UC_ARM_REG_XPSR);
    const bool fp = (control & CONTROL_FPCA) != 0;
    const uint32_t words = fp ? EXTENDED_WORDS : BASIC_WORDS;

    uint32_t sp = cpu_read(mcu, UC_ARM_REG_SP);
    const bool aligned = (sp & 4u) != 0;
    sp = (sp - 4u * words) & ~7u;

    uint32_t frame[EXTENDED_WORDS] = {0};
    for (int i = 0; i < 6; i++) {
        frame[i] = cpu_read(mcu, STACKED[i]);
    }
    frame[6] = mcu->cpu.pc & ~1u;
    frame[7] = (xpsr & ~XPSR_ALIGNED) | (aligned ? XPSR_ALIGNED : 0);
    if (fp) {
        for (int i = 0; i < FP_REGISTERS; i++) {
            frame[BASIC_WORDS + i] = cpu_read(mcu, UC_ARM_REG_S0 + i);
        }
        frame[BASIC_WORDS + FP_REGISTERS] = cpu_read(mcu, UC_ARM_REG_FPSCR);
        mcu->counters.fp_frames++;
    }
    /* A stack that is not memory loses the frame; the handler starts all the same. */
    (void)mcu_write_ram(mcu, sp, frame, 4u * words);
    cpu_write(mcu, UC_ARM_REG_SP, sp);

    const bool from_thread = ipsr == 0;
    cpu_write(mcu, UC_ARM_REG_LR,
              EXC_RETURN_BASE | (fp ? 0 : EXC_RETURN_BASIC_FRAME) | (from_thread ? EXC_RETURN_THREAD : 0) |
                  (from_thread && (control & CONTROL_SPSEL) != 0 ? EXC_RETURN_PROCESS : 0));
    cpu_write(mcu, UC_ARM_REG_XPSR, (xpsr & XPSR_KEPT) | XPSR_THUMB | number);
    cpu_write(mcu, UC_ARM_REG_IPSR, number); /* unicorn goes over to the main stack with this */
    if (fp) {
        cpu_write(mcu, UC_ARM_REG_CONTROL, control & ~(CONTROL_FPCA | 8u)); /* unicorn shows FPCA as 0xC */
    }
    nvic_start(mcu, number);
    mcu->counters.exceptions++;
    uint32_t handler = 0;
    (void)mcu_peek(mcu, mcu->nvic.vtor + 4u * number, (uint8_t *)&handler, sizeof handler);
    mcu->cpu.pc = handler;
}

void exception_return(struct mcu *mcu, uint32_t exc_return) {
    const uint32_t preempted = nvic_end(mcu);
    cpu_write(mcu, UC_ARM_REG_IPSR, preempted);
    const bool process = (exc_return & EXC_RETURN_PROCESS) != 0;
    const bool fp = (exc_return & EXC_RETURN_BASIC_FRAME) == 0;
    const uint32_t control = cpu_read(mcu, UC_ARM_REG_CONTROL) & ~(CONTROL_SPSEL | CONTROL_FPCA | 8u);
    cpu_write(mcu, UC_ARM_REG_CONTROL, control | (process ? CONTROL_SPSEL : 0));

    const uint32_t sp = cpu_read(mcu, UC_ARM_REG_SP);
    const uint32_t words = fp ? EXTENDED_WORDS : BASIC_WORDS;
    uint32_t frame[EXTENDED_WORDS] = {0};
    (void)mcu_peek(mcu, sp, (uint8_t *)frame, 4u * words);
    for (int i = 0; i < 6; i++) {
        cpu_write(mcu, STACKED[i], frame[i]);
    }
    if (fp) {
        for (int i = 0; i < FP_REGISTERS; i++) {
            cpu_write(mcu, UC_ARM_REG_S0 + i, frame[BASIC_WORDS + i]);
        }
        cpu_write(mcu, UC_ARM_REG_FPSCR, frame[BASIC_WORDS + FP_REGISTERS]);
        cpu_write(mcu, UC_ARM_REG_CONTROL, cpu_read(mcu, UC_ARM_REG_CONTROL) | CONTROL_FPCA | 8u);
    }
    cpu_write(mcu, UC_ARM_REG_SP, sp + 4u * words + ((frame[7] & XPSR_ALIGNED) != 0 ? 4u : 0));
    cpu_write(mcu, UC_ARM_REG_XPSR, frame[7] & ~XPSR_ALIGNED);
    cpu_write(mcu, UC_ARM_REG_IPSR, preempted);
    mcu->cpu.pc = frame[6] | 1u;
}
