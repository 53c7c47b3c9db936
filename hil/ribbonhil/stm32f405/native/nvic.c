/* Pending, enabled and running exceptions, and the system control block (Armv7-M ARM, B3.2 and B3.4). */
#include <string.h>

#include "machine.h"

/* Offsets in the private peripheral bus, from 0xE0000000. */
enum {
    NVIC_ISER = 0xE100,
    NVIC_ICER = 0xE180,
    NVIC_ISPR = 0xE200,
    NVIC_ICPR = 0xE280,
    NVIC_IABR = 0xE300,
    NVIC_IPR = 0xE400,
    NVIC_END = 0xE4F0,
    SCB_CPUID = 0xED00,
    SCB_ICSR = 0xED04,
    SCB_VTOR = 0xED08,
    SCB_AIRCR = 0xED0C,
    SCB_CCR = 0xED14,
    SCB_SHPR = 0xED18,
    SCB_SHCSR = 0xED24,
    SCB_CFSR = 0xED28,
    SCB_HFSR = 0xED2C,
    SCB_BFAR = 0xED38,
    SCB_CPACR = 0xED88,
};

#define CPUID_CORTEX_M4_R0P1 0x410FC241u
#define PRIORITY_MASK        0xF0u /* four bits are implemented */
#define RCC_CSR_SFTRSTF      (1u << 28)

void nvic_reset(struct mcu *mcu) {
    struct nvic *const nvic = &mcu->nvic;
    memset(nvic, 0, sizeof *nvic);
    for (uint32_t i = 0; i < 16; i++) {
        nvic->enabled[i] = true;
    }
    nvic->vtor = FLASH_START;
    nvic->ccr = 0x200; /* STKALIGN */
}

static void set_pending(struct nvic *nvic, uint32_t exception, bool pending) {
    if (nvic->pending[exception] != pending) {
        nvic->pending[exception] = pending;
        if (nvic->enabled[exception]) {
            nvic->wanted += pending ? 1u : -1u;
        }
    }
}

static void set_enabled(struct nvic *nvic, uint32_t exception, bool enabled) {
    if (nvic->enabled[exception] != enabled) {
        nvic->enabled[exception] = enabled;
        if (nvic->pending[exception]) {
            nvic->wanted += enabled ? 1u : -1u;
        }
    }
}

void nvic_pend(struct mcu *mcu, uint32_t exception) {
    set_pending(&mcu->nvic, exception, true);
    time_stop_now(mcu);
}

static bool is_active(const struct nvic *nvic, uint32_t exception) {
    for (uint32_t i = 0; i < nvic->active_count; i++) {
        if (nvic->active[i] == exception) {
            return true;
        }
    }
    return false;
}

/* A request pends its exception when it rises, and again on return if it is still there. */
void nvic_set_line(struct mcu *mcu, uint32_t exception, bool high) {
    struct nvic *const nvic = &mcu->nvic;
    if (high && !nvic->line[exception] && !is_active(nvic, exception)) {
        nvic_pend(mcu, exception);
    }
    nvic->line[exception] = high;
}

static int priority_of(const struct nvic *nvic, uint32_t exception) {
    switch (exception) {
    case EXCEPTION_NMI:
        return -2;
    case EXCEPTION_HARD_FAULT:
        return -1;
    default:
        return nvic->priority[exception];
    }
}

int nvic_running_priority(const struct mcu *mcu) {
    int lowest = 256;
    for (uint32_t i = 0; i < mcu->nvic.active_count; i++) {
        const int priority = priority_of(&mcu->nvic, mcu->nvic.active[i]);
        lowest = priority < lowest ? priority : lowest;
    }
    return lowest;
}

int nvic_best(struct mcu *mcu) {
    const struct nvic *const nvic = &mcu->nvic;
    int threshold = nvic_running_priority(mcu);
    const int basepri = (int)(cpu_read(mcu, UC_ARM_REG_BASEPRI) & PRIORITY_MASK);
    if (basepri != 0 && basepri < threshold) {
        threshold = basepri;
    }
    if ((cpu_read(mcu, UC_ARM_REG_PRIMASK) & 1u) != 0 && threshold > 0) {
        threshold = 0;
    }
    if ((cpu_read(mcu, UC_ARM_REG_FAULTMASK) & 1u) != 0 && threshold > -1) {
        threshold = -1;
    }
    int best = -1;
    for (uint32_t i = 1; i < EXCEPTION_COUNT; i++) {
        if (nvic->pending[i] && nvic->enabled[i] && priority_of(nvic, i) < threshold) {
            threshold = priority_of(nvic, i);
            best = (int)i;
        }
    }
    return best;
}

void nvic_start(struct mcu *mcu, uint32_t exception) {
    set_pending(&mcu->nvic, exception, false);
    mcu->nvic.active[mcu->nvic.active_count++] = (uint8_t)exception;
}

/* Ends what runs; the exception that was preempted, 0 for none. */
uint32_t nvic_end(struct mcu *mcu) {
    struct nvic *const nvic = &mcu->nvic;
    if (nvic->active_count == 0) {
        mcu_forbid(mcu, "exception return outside of a handler");
        return 0;
    }
    const uint32_t ended = nvic->active[--nvic->active_count];
    if (nvic->line[ended]) {
        nvic_pend(mcu, ended);
    }
    return nvic->active_count == 0 ? 0 : nvic->active[nvic->active_count - 1];
}

static uint32_t read_icsr(const struct nvic *nvic) {
    uint32_t value = nvic->active_count == 0 ? 0 : nvic->active[nvic->active_count - 1];
    if (nvic->active_count <= 1) {
        value |= 1u << 11; /* RETTOBASE */
    }
    int best = -1;
    int threshold = 256;
    for (uint32_t i = 1; i < EXCEPTION_COUNT; i++) {
        if (nvic->pending[i] && nvic->enabled[i] && priority_of(nvic, i) < threshold) {
            threshold = priority_of(nvic, i);
            best = (int)i;
        }
        if (i >= 16 && nvic->pending[i]) {
            value |= 1u << 22; /* ISRPENDING */
        }
    }
    value |= best < 0 ? 0 : (uint32_t)best << 12; /* VECTPENDING */
    value |= nvic->pending[EXCEPTION_PENDSV] ? 1u << 28 : 0;
    value |= nvic->pending[EXCEPTION_SYSTICK] ? 1u << 26 : 0;
    return value;
}

static void write_icsr(struct mcu *mcu, uint32_t value) {
    if ((value & 1u << 31) != 0) {
        nvic_pend(mcu, EXCEPTION_NMI);
    }
    if ((value & 1u << 28) != 0) {
        nvic_pend(mcu, EXCEPTION_PENDSV);
    }
    if ((value & 1u << 27) != 0) {
        set_pending(&mcu->nvic, EXCEPTION_PENDSV, false);
    }
    if ((value & 1u << 26) != 0) {
        nvic_pend(mcu, EXCEPTION_SYSTICK);
    }
    if ((value & 1u << 25) != 0) {
        set_pending(&mcu->nvic, EXCEPTION_SYSTICK, false);
    }
}

static uint32_t read_bits(const bool *flags, uint32_t first) {
    uint32_t value = 0;
    for (uint32_t i = 0; i < 32 && first + i < EXCEPTION_COUNT; i++) {
        value |= flags[first + i] ? 1u << i : 0;
    }
    return value;
}

static void write_bits(struct mcu *mcu, uint32_t bank, uint32_t first, uint32_t value) {
    for (uint32_t i = 0; i < 32 && first + i < EXCEPTION_COUNT; i++) {
        if ((value >> i & 1u) == 0) {
            continue;
        }
        const uint32_t exception = first + i;
        switch (bank) {
        case NVIC_ISER:
            set_enabled(&mcu->nvic, exception, true);
            time_stop_now(mcu);
            break;
        case NVIC_ICER:
            set_enabled(&mcu->nvic, exception, false);
            break;
        case NVIC_ISPR:
            nvic_pend(mcu, exception);
            break;
        default:
            set_pending(&mcu->nvic, exception, false);
            break;
        }
    }
}

/* The priority byte at a register offset, or a null pointer. */
static uint8_t *priority_at(struct nvic *nvic, uint32_t offset) {
    uint32_t exception = EXCEPTION_COUNT;
    if (offset >= NVIC_IPR && offset < NVIC_END) {
        exception = 16 + offset - NVIC_IPR;
    } else if (offset >= SCB_SHPR && offset < SCB_SHCSR) {
        exception = 4 + offset - SCB_SHPR;
    }
    return exception < EXCEPTION_COUNT ? &nvic->priority[exception] : NULL;
}

uint32_t nvic_read(struct mcu *mcu, uint32_t offset, uint32_t size) {
    struct nvic *const nvic = &mcu->nvic;
    if (offset >= NVIC_ISER && offset < NVIC_IABR) {
        const uint32_t first = 16 + 8 * (offset & 0x7Cu);
        return read_bits(offset < NVIC_ISPR ? nvic->enabled : nvic->pending, first);
    }
    if (priority_at(nvic, offset) != NULL) {
        uint32_t value = 0;
        for (uint32_t i = 0; i < size; i++) {
            const uint8_t *const priority = priority_at(nvic, offset + i);
            value |= priority != NULL ? (uint32_t)*priority << 8 * i : 0;
        }
        return value;
    }
    switch (offset) {
    case SCB_CPUID:
        return CPUID_CORTEX_M4_R0P1;
    case SCB_ICSR:
        return read_icsr(nvic);
    case SCB_VTOR:
        return nvic->vtor;
    case SCB_AIRCR:
        return 0xFA050000u;
    case SCB_CCR:
        return nvic->ccr;
    case SCB_SHCSR:
        return nvic->shcsr;
    case SCB_CFSR:
        return nvic->cfsr;
    case SCB_HFSR:
        return nvic->hfsr;
    case SCB_BFAR:
        return nvic->bfar;
    case SCB_CPACR:
        return nvic->cpacr;
    default:
        mcu_forbid(mcu, "read of a core register that is not modelled: 0xe000%04x", offset);
        return 0;
    }
}

void nvic_write(struct mcu *mcu, uint32_t offset, uint32_t size, uint32_t value) {
    struct nvic *const nvic = &mcu->nvic;
    if (offset >= NVIC_ISER && offset < NVIC_IABR) {
        write_bits(mcu, offset & ~0x7Fu, 16 + 8 * (offset & 0x7Cu), value);
        return;
    }
    if (priority_at(nvic, offset) != NULL) {
        for (uint32_t i = 0; i < size; i++) {
            uint8_t *const priority = priority_at(nvic, offset + i);
            if (priority != NULL) {
                *priority = (uint8_t)(value >> 8 * i & PRIORITY_MASK);
            }
        }
        return;
    }
    switch (offset) {
    case SCB_ICSR:
        write_icsr(mcu, value);
        break;
    case SCB_VTOR:
        nvic->vtor = value & ~0x1FFu;
        break;
    case SCB_AIRCR:
        if (value >> 16 == 0x05FAu && (value & 4u) != 0) {
            mcu_request_reset(mcu, RCC_CSR_SFTRSTF);
        }
        break;
    case SCB_CCR:
        nvic->ccr = value;
        break;
    case SCB_SHCSR:
        nvic->shcsr = value;
        break;
    case SCB_CFSR:
        nvic->cfsr &= ~value;
        break;
    case SCB_HFSR:
        nvic->hfsr &= ~value;
        break;
    case SCB_CPACR:
        nvic->cpacr = value;
        break;
    default:
        mcu_forbid(mcu, "write to a core register that is not modelled: 0xe000%04x", offset);
        break;
    }
}
