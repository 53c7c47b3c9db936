/* Reset and clock control (RM0090, 7): oscillators that take time to start, or do not, and what they clock.
 */
#include "machine.h"

enum { CR = 0x00, PLLCFGR = 0x04, CFGR = 0x08, AHB1ENR = 0x30, APB1ENR = 0x40, APB2ENR = 0x44, CSR = 0x74 };

#define CR_HSION   (1u << 0)
#define CR_HSIRDY  (1u << 1)
#define CR_HSEON   (1u << 16)
#define CR_HSERDY  (1u << 17)
#define CR_CSSON   (1u << 19)
#define CR_PLLON   (1u << 24)
#define CR_PLLRDY  (1u << 25)
#define CR_WRITTEN (CR_HSION | CR_HSEON | CR_CSSON | CR_PLLON | 0xF8u)
#define CSR_FLAGS  0xFE000000u
#define CSR_RMVF   (1u << 24)

#define HSI_HZ          16000000u
#define HSE_START_TICKS (2000 * TICKS_PER_US)
#define PLL_LOCK_TICKS  (200 * TICKS_PER_US)
#define HCLK_HZ_MAX     168000000u
#define SW_HSI          0u
#define SW_HSE          1u
#define SW_PLL          2u

void rcc_power_on(struct mcu *mcu) {
    mcu->rcc.csr = 0;
}

void rcc_reset(struct mcu *mcu) {
    struct rcc *const rcc = &mcu->rcc;
    *rcc = (struct rcc){.cr = 0x80u | CR_HSION,
                        .pllcfgr = 0x24003010u,
                        .csr = rcc->csr & CSR_FLAGS,
                        .crystal_failed = rcc->crystal_failed};
    rcc->hse_ready = rcc->pll_ready = NEVER;
}

static uint32_t pll_hz(const struct rcc *rcc, const struct mcu_wiring *wiring) {
    const uint32_t m = rcc->pllcfgr & 0x3Fu;
    const uint32_t n = rcc->pllcfgr >> 6 & 0x1FFu;
    const uint32_t p = 2u * ((rcc->pllcfgr >> 16 & 3u) + 1u);
    const uint32_t input = (rcc->pllcfgr >> 22 & 1u) != 0 ? wiring->crystal_hz : HSI_HZ;
    return m == 0 ? 0 : input / m * n / p;
}

/* The source in use is the one asked for once that is ready. */
static uint32_t source(const struct mcu *mcu) {
    const struct rcc *const rcc = &mcu->rcc;
    const uint32_t wanted = rcc->cfgr & 3u;
    if (wanted == SW_HSE && mcu->now >= rcc->hse_ready) {
        return SW_HSE;
    }
    return wanted == SW_PLL && mcu->now >= rcc->pll_ready ? SW_PLL : SW_HSI;
}

static uint32_t divided(uint32_t hz, uint32_t code, uint32_t first) {
    return code < first ? hz : hz >> (code - first + 1u);
}

uint32_t rcc_hclk_hz(const struct mcu *mcu) {
    const uint32_t in_use = source(mcu);
    const uint32_t hz = in_use == SW_PLL   ? pll_hz(&mcu->rcc, &mcu->wiring)
                        : in_use == SW_HSE ? mcu->wiring.crystal_hz
                                           : HSI_HZ;
    return divided(hz, mcu->rcc.cfgr >> 4 & 15u, 8);
}

uint32_t rcc_pclk_hz(const struct mcu *mcu, unsigned bus) {
    return divided(rcc_hclk_hz(mcu), mcu->rcc.cfgr >> (bus == 1 ? 10 : 13) & 7u, 4);
}

uint32_t rcc_timer_hz(const struct mcu *mcu) {
    const bool undivided = (mcu->rcc.cfgr >> 10 & 7u) < 4;
    return undivided ? rcc_pclk_hz(mcu, 1) : 2 * rcc_pclk_hz(mcu, 1);
}

/* What a switch of clocks must not do (data sheet DS8626, 5.3.1; RM0090, table 10). */
static void check_limits(struct mcu *mcu) {
    const uint32_t hclk_hz = rcc_hclk_hz(mcu);
    if (hclk_hz == 0 || hclk_hz > HCLK_HZ_MAX) {
        mcu_forbid(mcu, "HCLK of %u Hz", hclk_hz);
    }
    if (rcc_pclk_hz(mcu, 1) > 42000000u || rcc_pclk_hz(mcu, 2) > 84000000u) {
        mcu_forbid(mcu, "PCLK1 of %u Hz, PCLK2 of %u Hz", rcc_pclk_hz(mcu, 1), rcc_pclk_hz(mcu, 2));
    }
    if (hclk_hz > 30000000u * ((mcu->flash.acr & 7u) + 1u)) {
        mcu_forbid(mcu, "%u flash wait states at %u Hz", mcu->flash.acr & 7u, hclk_hz);
    }
    if (hclk_hz != 0) {
        cpu_set_clock(mcu, hclk_hz);
    }
}

static bool crystal_runs(const struct mcu *mcu) {
    return mcu->wiring.crystal_hz != 0 && !mcu->rcc.crystal_failed;
}

static void start_pll(struct mcu *mcu) {
    struct rcc *const rcc = &mcu->rcc;
    const bool from_crystal = (rcc->pllcfgr >> 22 & 1u) != 0;
    if (from_crystal && mcu->now < rcc->hse_ready) {
        return;
    }
    const uint32_t vco_input = (from_crystal ? mcu->wiring.crystal_hz : HSI_HZ) / (rcc->pllcfgr & 0x3Fu);
    if (vco_input < 950000u || vco_input > 2100000u) {
        mcu_forbid(mcu, "PLL input of %u Hz", vco_input);
    }
    rcc->pll_ready = mcu->now + PLL_LOCK_TICKS;
}

static void write_cr(struct mcu *mcu, uint32_t value) {
    struct rcc *const rcc = &mcu->rcc;
    const uint32_t before = rcc->cr;
    rcc->cr = value & CR_WRITTEN;
    if ((value & CR_HSEON) == 0) {
        rcc->hse_ready = NEVER;
    } else if ((before & CR_HSEON) == 0 && crystal_runs(mcu)) {
        rcc->hse_ready = mcu->now + HSE_START_TICKS;
    }
    if ((value & CR_PLLON) == 0) {
        rcc->pll_ready = NEVER;
    } else if ((before & CR_PLLON) == 0) {
        start_pll(mcu);
    }
}

uint32_t rcc_read(struct mcu *mcu, unsigned instance, uint32_t offset) {
    (void)instance;
    struct rcc *const rcc = &mcu->rcc;
    switch (offset) {
    case CR: {
        const uint64_t next = rcc->hse_ready > mcu->now ? rcc->hse_ready : rcc->pll_ready;
        time_warp(mcu, next);
        return rcc->cr | (rcc->cr & CR_HSION ? CR_HSIRDY : 0) | (mcu->now >= rcc->hse_ready ? CR_HSERDY : 0) |
               (mcu->now >= rcc->pll_ready ? CR_PLLRDY : 0);
    }
    case PLLCFGR:
        return rcc->pllcfgr;
    case CFGR:
        return rcc->cfgr | source(mcu) << 2;
    case AHB1ENR:
        return rcc->ahb1enr;
    case APB1ENR:
        return rcc->apb1enr;
    case APB2ENR:
        return rcc->apb2enr;
    case CSR:
        return rcc->csr;
    default:
        mcu_forbid(mcu, "read of RCC register %#x, which is not modelled", offset);
        return 0;
    }
}

void rcc_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value) {
    (void)instance;
    struct rcc *const rcc = &mcu->rcc;
    switch (offset) {
    case CR:
        write_cr(mcu, value);
        check_limits(mcu);
        break;
    case PLLCFGR:
        if ((rcc->cr & CR_PLLON) != 0) {
            mcu_forbid(mcu, "PLLCFGR written while the PLL is on");
            break;
        }
        rcc->pllcfgr = value;
        break;
    case CFGR:
        rcc->cfgr = value & ~0xCu;
        check_limits(mcu);
        break;
    case AHB1ENR:
        rcc->ahb1enr = value;
        break;
    case APB1ENR:
        rcc->apb1enr = value;
        break;
    case APB2ENR:
        rcc->apb2enr = value;
        break;
    case CSR:
        rcc->csr = (value & CSR_RMVF) != 0 ? 0 : rcc->csr;
        break;
    default:
        mcu_forbid(mcu, "write to RCC register %#x, which is not modelled", offset);
        break;
    }
}

/* The clock security system goes over to the internal oscillator and says so by NMI; without it the core
 * stands still, and with it the watchdog is the only thing that goes on. */
void rcc_crystal_fails(struct mcu *mcu) {
    struct rcc *const rcc = &mcu->rcc;
    const bool in_use = (rcc->cr & CR_HSEON) != 0 && mcu->now >= rcc->hse_ready;
    rcc->crystal_failed = true;
    rcc->hse_ready = NEVER;
    if (!in_use) {
        return;
    }
    rcc->pll_ready = NEVER;
    rcc->cfgr &= ~3u;
    check_limits(mcu);
    if ((rcc->cr & CR_CSSON) != 0) {
        rcc->cr &= ~(CR_HSEON | CR_PLLON);
        nvic_pend(mcu, EXCEPTION_NMI);
    } else {
        mcu_forbid(mcu, "the crystal failed with the clock security system off");
    }
}
