/* Clocks: 168 MHz from the crystal or the internal oscillator; every wait is bounded. */
#include BOARD_HEADER
#include "port.h"

#define HSI_HZ     16000000u
#define PLL_HZ     168000000u
#define PLL_IN_HZ  1000000u
#define VCO_FACTOR (2u * PLL_HZ / PLL_IN_HZ)
#define USB_FACTOR 7u /* 336 MHz / 7 = 48 MHz for the PLL's second output, which must not run faster */

/* A poll takes at least 4 cycles of 16 MHz: 25 ms. A crystal starts within 5, the PLL locks within 0.3. */
#define POLLS_MAX 100000u

/* As a reset leaves them. */
bool clocks_are_reset(void) {
    return (RCC->CR & (RCC_CR_HSEON | RCC_CR_PLLON)) == 0 &&
           (RCC->CFGR & RCC_CFGR_SW_MASK) == RCC_CFGR_SW_HSI;
}

static bool start_pll(uint32_t input_hz, uint32_t source) {
    RCC->PLLCFGR = RCC_PLLCFGR_PLLM(input_hz / PLL_IN_HZ) | RCC_PLLCFGR_PLLN(VCO_FACTOR) |
                   RCC_PLLCFGR_PLLP_2 | source | RCC_PLLCFGR_PLLQ(USB_FACTOR);
    RCC->CR |= RCC_CR_PLLON;
    if (!poll_until(&RCC->CR, RCC_CR_PLLRDY, RCC_CR_PLLRDY, POLLS_MAX)) {
        RCC->CR &= ~RCC_CR_PLLON;
        return false;
    }
    FLASH->ACR = FLASH_ACR_LATENCY_5 | FLASH_ACR_PRFTEN | FLASH_ACR_ICEN | FLASH_ACR_DCEN;
    (void)FLASH->ACR; /* the wait states count from when they read back (RM0090, 3.5.1) */
    RCC->CFGR = (RCC->CFGR & ~(RCC_CFGR_HPRE_MASK | RCC_CFGR_PPRE1_MASK | RCC_CFGR_PPRE2_MASK)) |
                RCC_CFGR_PPRE1_DIV4 | RCC_CFGR_PPRE2_DIV2;
    RCC->CFGR = (RCC->CFGR & ~RCC_CFGR_SW_MASK) | RCC_CFGR_SW_PLL;
    if (!poll_until(&RCC->CFGR, RCC_CFGR_SWS_MASK, RCC_CFGR_SWS_PLL, POLLS_MAX)) {
        RCC->CFGR &= ~(RCC_CFGR_SW_MASK | RCC_CFGR_PPRE1_MASK | RCC_CFGR_PPRE2_MASK);
        RCC->CR &= ~RCC_CR_PLLON;
        return false;
    }
    return true;
}

static bool start_crystal(void) {
    RCC->CR |= RCC_CR_HSEON;
    if (!poll_until(&RCC->CR, RCC_CR_HSERDY, RCC_CR_HSERDY, POLLS_MAX)) {
        RCC->CR &= ~RCC_CR_HSEON;
        return false;
    }
    return true;
}

void clocks_start(struct clocks *clocks) {
    *clocks = (struct clocks){.hclk_hz = HSI_HZ,
                              .pclk1_hz = HSI_HZ,
                              .pclk2_hz = HSI_HZ,
                              .source = WIRE_CLOCK_SOURCE_INTERNAL_RC,
                              .answered = (RCC->CR & RCC_CR_HSIRDY) != 0};
    bool pll = false;
    if (start_crystal() && start_pll(BOARD_CRYSTAL_HZ, RCC_PLLCFGR_PLLSRC)) {
        pll = true;
        clocks->source = WIRE_CLOCK_SOURCE_CRYSTAL;
        RCC->CR |= RCC_CR_CSSON;
    } else {
        pll = start_pll(HSI_HZ, 0);
    }
    if (pll) {
        clocks->hclk_hz = PLL_HZ;
        clocks->pclk1_hz = PLL_HZ / 4;
        clocks->pclk2_hz = PLL_HZ / 2;
    }
}

/* The crystal stopped and the hardware went over to 16 MHz, with every baud rate and prescaler now wrong:
 * starting again finds the best clock there is. */
void nmi_handler(void);
void nmi_handler(void) {
    system_reset();
}
