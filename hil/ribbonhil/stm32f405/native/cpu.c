/* The run loop around unicorn's Cortex-M4: counting instructions, sleeping, and what unicorn leaves to its
 * user. */
#include <string.h>

#include "machine.h"

#define WFI_OPCODE       0xBF30u
#define WFE_OPCODE       0xBF20u
#define BRANCH_TO_ITSELF 0xE7FEu

/* Numbers that unicorn gives to exceptions of the CPU (qemu's EXCP_*). */
enum { UNICORN_SVC = 2, UNICORN_BKPT = 7, UNICORN_EXCEPTION_RETURN = 8 };

#define CFSR_IBUSERR    (1u << 8)
#define CFSR_PRECISERR  (1u << 9)
#define CFSR_BFARVALID  (1u << 15)
#define CFSR_UNDEFINSTR (1u << 16)
#define HFSR_FORCED     (1u << 30)
#define HFSR_DEBUGEVT   (1u << 31)

#define CONTROL_FPCA (1u << 2)

uint32_t cpu_read(struct mcu *mcu, int register_id) {
    uint32_t value = 0;
    uc_reg_read(mcu->uc, register_id, &value);
    return value;
}

void cpu_write(struct mcu *mcu, int register_id, uint32_t value) {
    uc_reg_write(mcu->uc, register_id, &value);
}

static uint16_t halfword_at(const struct mcu *mcu, uint32_t address) {
    uint16_t halfword = 0;
    if (address - FLASH_START < FLASH_BYTES - 1) {
        memcpy(&halfword, mcu->flash.memory + (address - FLASH_START), 2);
    } else if (address - RAM_START < RAM_BYTES - 1) {
        memcpy(&halfword, mcu->ram + (address - RAM_START), 2);
    }
    return halfword;
}

/* Halfwords from 0xE800 on begin an instruction of two (Armv7-M ARM, A5.1). */
static uint32_t count_instructions(const struct mcu *mcu, uint32_t address, uint32_t bytes) {
    uint32_t count = 0;
    for (uint32_t offset = 0; offset < bytes; count++) {
        offset += halfword_at(mcu, address + offset) >= 0xE800u ? 4 : 2;
    }
    return count;
}

/* Before each block of code. Stopping before the first block after a start would never get anywhere. */
static void on_block(uc_engine *uc, uint64_t address64, uint32_t bytes, void *user) {
    struct mcu *const mcu = user;
    struct cpu *const cpu = &mcu->cpu;
    if (mcu->now >= mcu->stop_at && !cpu->first_block) {
        cpu->stopped_by_us = true;
        uc_emu_stop(uc);
        return;
    }
    cpu->first_block = false;
    const uint32_t address = (uint32_t)address64;
    uint32_t count;
    if (address - FLASH_START < FLASH_BYTES) {
        uint8_t *const cached = &cpu->instructions_of_block[(address - FLASH_START) / 2];
        if (*cached == 0) {
            const uint32_t counted = count_instructions(mcu, address, bytes);
            *cached = (uint8_t)(counted < 255 ? counted : 255);
        }
        count = *cached;
        if (cpu->profile != NULL) {
            cpu->profile[(address - FLASH_START) / 2] += count;
        }
    } else {
        count = count_instructions(mcu, address, bytes);
        if (address - SYSTEM_START < SYSTEM_BYTES) {
            mcu->in_boot_loader = true;
            time_stop_now(mcu);
        }
    }
    if (bytes == 2 && halfword_at(mcu, address) == BRANCH_TO_ITSELF && mcu->now < mcu->stop_at) {
        mcu->now = mcu->stop_at; /* only an event changes anything */
    }
    mcu->counters.instructions += count;
    cpu->tick_fraction += count * cpu->ticks_per_instruction_256;
    mcu->now += cpu->tick_fraction >> 8;
    cpu->tick_fraction &= 255u;
}

static void on_interrupt(uc_engine *uc, uint32_t number, void *user) {
    struct mcu *const mcu = user;
    mcu->cpu.interrupt_number = (int)number;
    uc_emu_stop(uc);
}

static bool on_bad_memory(uc_engine *uc, uc_mem_type type, uint64_t address, int size, int64_t value,
                          void *user) {
    (void)uc;
    (void)size;
    (void)value;
    struct mcu *const mcu = user;
    mcu->cpu.fault_address = (uint32_t)address;
    mcu->cpu.fault_is_write = type == UC_MEM_WRITE_UNMAPPED || type == UC_MEM_WRITE_PROT;
    return false;
}

bool cpu_open(struct mcu *mcu) {
    uc_hook hook;
    return uc_open(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS, &mcu->uc) == UC_ERR_OK &&
           uc_ctl_set_cpu_model(mcu->uc, UC_CPU_ARM_CORTEX_M4) == UC_ERR_OK &&
           uc_hook_add(mcu->uc, &hook, UC_HOOK_BLOCK, (void *)on_block, mcu, 1, 0) == UC_ERR_OK &&
           uc_hook_add(mcu->uc, &hook, UC_HOOK_INTR, (void *)on_interrupt, mcu, 1, 0) == UC_ERR_OK &&
           uc_hook_add(mcu->uc, &hook, UC_HOOK_MEM_INVALID, (void *)on_bad_memory, mcu, 1, 0) == UC_ERR_OK;
}

void cpu_forget_code(struct mcu *mcu) {
    memset(mcu->cpu.instructions_of_block, 0, sizeof mcu->cpu.instructions_of_block);
    uc_ctl_flush_tb(mcu->uc);
}

void cpu_set_clock(struct mcu *mcu, uint32_t hclk_hz) {
    mcu->cpu.ticks_per_instruction_256 =
        TICKS_HZ * 256u / 2u * mcu->options.half_cycles_per_instruction / hclk_hz;
}

void cpu_reset(struct mcu *mcu) {
    const uint32_t *const vectors = (const uint32_t *)(const void *)mcu->flash.memory;
    static const int cleared[] = {UC_ARM_REG_IPSR,    UC_ARM_REG_CONTROL,   UC_ARM_REG_PRIMASK,
                                  UC_ARM_REG_BASEPRI, UC_ARM_REG_FAULTMASK, UC_ARM_REG_FPSCR};
    for (size_t i = 0; i < sizeof cleared / sizeof cleared[0]; i++) {
        cpu_write(mcu, cleared[i], 0);
    }
    cpu_write(mcu, UC_ARM_REG_XPSR, 1u << 24);
    cpu_write(mcu, UC_ARM_REG_SP, vectors[0] & ~3u);
    cpu_write(mcu, UC_ARM_REG_LR, 0xFFFFFFFFu);
    mcu->cpu.pc = vectors[1];
    mcu->cpu.asleep = false;
    cpu_set_clock(mcu, rcc_hclk_hz(mcu));
}

/* Lets time pass until something is wanted of the core, or the horizon. */
static void sleep_through(struct mcu *mcu) {
    const uint64_t asleep_from = mcu->now;
    while (mcu->nvic.wanted == 0 && !mcu->reset_wanted && mcu->now < mcu->horizon) {
        time_find_next(mcu);
        if (mcu->stop_at > mcu->now) {
            mcu->now = mcu->stop_at;
        }
        time_handle_events(mcu);
    }
    mcu->sleep_ticks += mcu->now - asleep_from;
    mcu->cpu.asleep = mcu->nvic.wanted == 0 && !mcu->reset_wanted;
}

/* A fault that the handler of a fault makes stops the core for good; only the watchdog helps then. */
static bool hard_fault(struct mcu *mcu, uint32_t cfsr, uint32_t hfsr) {
    mcu->nvic.cfsr |= cfsr;
    mcu->nvic.hfsr |= hfsr;
    if (nvic_running_priority(mcu) < 0) {
        return false;
    }
    exception_enter(mcu, EXCEPTION_HARD_FAULT);
    return true;
}

static bool memory_fault(struct mcu *mcu, uc_err error) {
    uint32_t cfsr = CFSR_PRECISERR | CFSR_BFARVALID;
    if (error == UC_ERR_FETCH_UNMAPPED || error == UC_ERR_FETCH_PROT) {
        cfsr = CFSR_IBUSERR;
    } else if (error == UC_ERR_INSN_INVALID || error == UC_ERR_EXCEPTION) {
        cfsr = CFSR_UNDEFINSTR;
    } else {
        mcu->nvic.bfar = mcu->cpu.fault_address;
    }
    return hard_fault(mcu, cfsr, HFSR_FORCED);
}

/* False if nothing will ever start the core again. */
static bool is_saved_by_watchdog(struct mcu *mcu) {
    const uint64_t watchdog = mcu->events[EVENT_WATCHDOG];
    mcu->now = watchdog < mcu->horizon ? watchdog : mcu->horizon;
    return watchdog != NEVER;
}

/* One uninterrupted stretch of code; false if the core locked up. */
static bool run_code(struct mcu *mcu) {
    struct cpu *const cpu = &mcu->cpu;
    cpu->interrupt_number = -1;
    cpu->first_block = true;
    cpu->stopped_by_us = false;
    const uc_err error = uc_emu_start(mcu->uc, cpu->pc | 1u, 0xFFFFFFFEu, 0, 0);
    cpu->pc = cpu_read(mcu, UC_ARM_REG_PC) | 1u;
    const uint16_t before = halfword_at(mcu, (cpu->pc & ~1u) - 2u);

    if ((mcu->nvic.cpacr & 0x00F00000u) != 0x00F00000u &&
        (cpu_read(mcu, UC_ARM_REG_CONTROL) & CONTROL_FPCA) != 0) {
        mcu_forbid(mcu, "floating point before CPACR switched it on, near %#x", cpu->pc & ~1u);
    }
    if (error == UC_ERR_INSN_INVALID && before == WFE_OPCODE) {
        return true; /* unicorn does not know WFE, which may return at any time */
    }
    if (error != UC_ERR_OK) {
        return memory_fault(mcu, error);
    }
    switch (cpu->interrupt_number) {
    case -1:
        if (!cpu->stopped_by_us && before == WFI_OPCODE && mcu->nvic.wanted == 0) {
            mcu->counters.sleeps++;
            sleep_through(mcu);
        }
        return true;
    case UNICORN_EXCEPTION_RETURN:
        exception_return(mcu, cpu->pc);
        return true;
    case UNICORN_SVC:
        exception_enter(mcu, EXCEPTION_SVCALL);
        return true;
    case UNICORN_BKPT:
        return hard_fault(mcu, 0, HFSR_DEBUGEVT);
    default:
        return hard_fault(mcu, CFSR_UNDEFINSTR, HFSR_FORCED);
    }
}

enum mcu_stop cpu_run(struct mcu *mcu, bool stop_at_reset) {
    while (mcu->now < mcu->horizon) {
        if (mcu->cpu.asleep) {
            sleep_through(mcu);
            continue;
        }
        time_handle_events(mcu);
        if (mcu->power_cut || mcu->in_boot_loader) {
            mcu->now = mcu->horizon;
            return mcu->power_cut ? MCU_POWER_CUT : MCU_BOOT_LOADER;
        }
        if (mcu->reset_wanted) {
            mcu->counters.resets++;
            mcu_reset(mcu, mcu->reset_flag);
            if (stop_at_reset) {
                return MCU_RESET;
            }
        }
        if (mcu->nvic.wanted != 0) {
            const int exception = nvic_best(mcu);
            if (exception >= 0) {
                exception_enter(mcu, (uint32_t)exception);
            }
        }
        time_find_next(mcu);
        if (mcu->nvic.wanted != 0) {
            time_stop_now(
                mcu); /* unicorn does not tell when the code unmasks it: look again at every block */
        }
        if (!run_code(mcu) && !is_saved_by_watchdog(mcu)) {
            return MCU_LOCKUP;
        }
    }
    return MCU_AT_HORIZON;
}
