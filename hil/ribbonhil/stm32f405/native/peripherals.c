/* Which peripheral answers at an address, if its clock is on. */
#include "machine.h"

#define PERIPHERALS_START 0x40000000u
#define PERIPHERALS_BYTES 0x00080000u
#define CORE_START        0xE0000000u
#define CORE_BYTES        0x00100000u
#define SYSTICK_FIRST     0xE010u
#define SYSTICK_LAST      0xE01Cu

enum gate { GATE_NONE, GATE_AHB1, GATE_APB1, GATE_APB2 };

struct peripheral {
    uint32_t address;
    uint32_t (*read)(struct mcu *mcu, unsigned instance, uint32_t offset);
    void (*write)(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value);
    unsigned instance;
    enum gate gate;
    unsigned gate_bit;
};

static uint32_t syscfg_read(struct mcu *mcu, unsigned instance, uint32_t offset) {
    (void)instance;
    return offset == 0 ? mcu->syscfg_memrmp : 0;
}

static void syscfg_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value) {
    (void)instance;
    if (offset == 0) {
        mcu->syscfg_memrmp = value & 3u;
    }
}

static const struct peripheral PERIPHERALS[] = {
    {0x40000000u, timers_read, timers_write, 0, GATE_APB1, 0},
    {0x40000400u, timers_read, timers_write, 1, GATE_APB1, 1},
    {0x40000800u, timers_read, timers_write, 2, GATE_APB1, 2},
    {0x40000C00u, timers_read, timers_write, 3, GATE_APB1, 3},
    {0x40003000u, iwdg_read, iwdg_write, 0, GATE_NONE, 0},
    {0x40004400u, usart_read, usart_write, 2, GATE_APB1, 17},
    {0x40004800u, usart_read, usart_write, 3, GATE_APB1, 18},
    {0x40012000u, adc_read, adc_write, 0, GATE_APB2, 8},
    {0x40013000u, spi_read, spi_write, 0, GATE_APB2, 12},
    {0x40013800u, syscfg_read, syscfg_write, 0, GATE_APB2, 14},
    {0x40020000u, gpio_read, gpio_write, 0, GATE_AHB1, 0},
    {0x40020400u, gpio_read, gpio_write, 1, GATE_AHB1, 1},
    {0x40020800u, gpio_read, gpio_write, 2, GATE_AHB1, 2},
    {0x40023800u, rcc_read, rcc_write, 0, GATE_NONE, 0},
    {0x40023C00u, flash_read, flash_write, 0, GATE_NONE, 0},
    {0x40026000u, dma_read, dma_write, 0, GATE_AHB1, 21},
    {0x40026400u, dma_read, dma_write, 1, GATE_AHB1, 22},
};

/* The peripheral at an address, or a null pointer: none is there, or it has no clock. */
static const struct peripheral *find(struct mcu *mcu, uint32_t address) {
    for (size_t i = 0; i < sizeof PERIPHERALS / sizeof PERIPHERALS[0]; i++) {
        const struct peripheral *const peripheral = &PERIPHERALS[i];
        if (peripheral->address != (address & ~0x3FFu)) {
            continue;
        }
        const uint32_t enabled[] = {~0u, mcu->rcc.ahb1enr, mcu->rcc.apb1enr, mcu->rcc.apb2enr};
        if ((enabled[peripheral->gate] >> peripheral->gate_bit & 1u) == 0) {
            mcu_forbid(mcu, "access to %#x, whose clock is off", address);
            return NULL;
        }
        return peripheral;
    }
    mcu_forbid(mcu, "access to a peripheral that is not modelled: %#x", address);
    return NULL;
}

/* A part of a register is read from the whole. */
static uint64_t on_read(uc_engine *uc, uint64_t offset, unsigned size, void *user) {
    (void)uc;
    (void)size;
    struct mcu *const mcu = user;
    const uint32_t address = PERIPHERALS_START + (uint32_t)offset;
    mcu->polled = address == mcu->last_read;
    mcu->last_read = address;
    const struct peripheral *const peripheral = find(mcu, address);
    if (peripheral == NULL) {
        return 0;
    }
    return peripheral->read(mcu, peripheral->instance, address & 0x3FCu) >> 8 * (address & 3u);
}

static void on_write(uc_engine *uc, uint64_t offset, unsigned size, uint64_t value, void *user) {
    (void)uc;
    struct mcu *const mcu = user;
    const uint32_t address = PERIPHERALS_START + (uint32_t)offset;
    mcu->polled = false;
    mcu->last_read = 0;
    const struct peripheral *const peripheral = find(mcu, address);
    if (peripheral == NULL) {
        return;
    }
    if (size != 4) {
        mcu_forbid(mcu, "write of %u bytes to %#x: only whole registers are modelled", size, address);
        return;
    }
    peripheral->write(mcu, peripheral->instance, address & 0x3FFu, (uint32_t)value);
}

static uint64_t on_core_read(uc_engine *uc, uint64_t offset, unsigned size, void *user) {
    (void)uc;
    struct mcu *const mcu = user;
    if (offset >= SYSTICK_FIRST && offset <= SYSTICK_LAST) {
        return systick_read(mcu, (uint32_t)offset);
    }
    return nvic_read(mcu, (uint32_t)offset, size);
}

static void on_core_write(uc_engine *uc, uint64_t offset, unsigned size, uint64_t value, void *user) {
    (void)uc;
    struct mcu *const mcu = user;
    if (offset >= SYSTICK_FIRST && offset <= SYSTICK_LAST) {
        systick_write(mcu, (uint32_t)offset, (uint32_t)value);
    } else {
        nvic_write(mcu, (uint32_t)offset, size, (uint32_t)value);
    }
}

static uint64_t on_store_read(uc_engine *uc, uint64_t offset, unsigned size, void *user) {
    (void)uc;
    return flash_store_read(user, STORE_START + (uint32_t)offset, size);
}

static void on_store_write(uc_engine *uc, uint64_t offset, unsigned size, uint64_t value, void *user) {
    (void)uc;
    flash_store_write(user, STORE_START + (uint32_t)offset, size, (uint32_t)value);
}

bool peripherals_map(struct mcu *mcu) {
    return uc_mmio_map(mcu->uc, PERIPHERALS_START, PERIPHERALS_BYTES, on_read, mcu, on_write, mcu) ==
               UC_ERR_OK &&
           uc_mmio_map(mcu->uc, CORE_START, CORE_BYTES, on_core_read, mcu, on_core_write, mcu) == UC_ERR_OK &&
           uc_mmio_map(mcu->uc, STORE_START, STORE_END - STORE_START, on_store_read, mcu, on_store_write,
                       mcu) == UC_ERR_OK;
}
