/* The registers of the STM32F405 (RM0090) and of its Cortex-M4 core that this port uses, and no others.
 *
 * Names are ST's and Arm's: PERIPHERAL_REGISTER_FIELD. A field of more than one bit is given as the values
 * that are used, already shifted; the whole field is PERIPHERAL_REGISTER_FIELD_MASK. */
#ifndef REGISTERS_H
#define REGISTERS_H

#include <stdint.h>

/* ---- reset and clock control */

struct rcc_registers {
    volatile uint32_t CR;
    volatile uint32_t PLLCFGR;
    volatile uint32_t CFGR;
    uint32_t reserved_0[9];
    volatile uint32_t AHB1ENR;
    uint32_t reserved_1[3];
    volatile uint32_t APB1ENR;
    volatile uint32_t APB2ENR;
    uint32_t reserved_2[11];
    volatile uint32_t CSR;
};
#define RCC ((struct rcc_registers *)0x40023800u)

#define RCC_CR_HSION         (1u << 0)
#define RCC_CR_HSIRDY        (1u << 1)
#define RCC_CR_HSEON         (1u << 16)
#define RCC_CR_HSERDY        (1u << 17)
#define RCC_CR_CSSON         (1u << 19)
#define RCC_CR_PLLON         (1u << 24)
#define RCC_CR_PLLRDY        (1u << 25)
#define RCC_PLLCFGR_PLLM(m)  ((uint32_t)(m) << 0)
#define RCC_PLLCFGR_PLLN(n)  ((uint32_t)(n) << 6)
#define RCC_PLLCFGR_PLLP_2   (0u << 16)
#define RCC_PLLCFGR_PLLSRC   (1u << 22)
#define RCC_PLLCFGR_PLLQ(q)  ((uint32_t)(q) << 24)
#define RCC_CFGR_SW_MASK     (3u << 0)
#define RCC_CFGR_SW_HSI      (0u << 0)
#define RCC_CFGR_SW_PLL      (2u << 0)
#define RCC_CFGR_SWS_MASK    (3u << 2)
#define RCC_CFGR_SWS_PLL     (2u << 2)
#define RCC_CFGR_HPRE_MASK   (15u << 4)
#define RCC_CFGR_PPRE1_MASK  (7u << 10)
#define RCC_CFGR_PPRE1_DIV4  (5u << 10)
#define RCC_CFGR_PPRE2_MASK  (7u << 13)
#define RCC_CFGR_PPRE2_DIV2  (4u << 13)
#define RCC_AHB1ENR_GPIOAEN  (1u << 0)
#define RCC_AHB1ENR_GPIOBEN  (1u << 1)
#define RCC_AHB1ENR_GPIOCEN  (1u << 2)
#define RCC_AHB1ENR_DMA1EN   (1u << 21)
#define RCC_AHB1ENR_DMA2EN   (1u << 22)
#define RCC_APB1ENR_TIM2EN   (1u << 0)
#define RCC_APB1ENR_USART2EN (1u << 17)
#define RCC_APB1ENR_USART3EN (1u << 18)
#define RCC_APB2ENR_ADC1EN   (1u << 8)
#define RCC_APB2ENR_SPI1EN   (1u << 12)
#define RCC_APB2ENR_SYSCFGEN (1u << 14)
#define RCC_CSR_RMVF         (1u << 24)
#define RCC_CSR_BORRSTF      (1u << 25)
#define RCC_CSR_PADRSTF      (1u << 26)
#define RCC_CSR_PORRSTF      (1u << 27)
#define RCC_CSR_SFTRSTF      (1u << 28)
#define RCC_CSR_WDGRSTF      (1u << 29)
#define RCC_CSR_WWDGRSTF     (1u << 30)

/* ---- flash interface */

struct flash_registers {
    volatile uint32_t ACR;
    volatile uint32_t KEYR;
    volatile uint32_t OPTKEYR;
    volatile uint32_t SR;
    volatile uint32_t CR;
};
#define FLASH ((struct flash_registers *)0x40023C00u)

#define FLASH_ACR_LATENCY_5   (5u << 0)
#define FLASH_ACR_PRFTEN      (1u << 8)
#define FLASH_ACR_ICEN        (1u << 9)
#define FLASH_ACR_DCEN        (1u << 10)
#define FLASH_ACR_DCRST       (1u << 12)
#define FLASH_KEYR_KEY_FIRST  0x45670123u
#define FLASH_KEYR_KEY_SECOND 0xCDEF89ABu
#define FLASH_SR_OPERR        (1u << 1)
#define FLASH_SR_WRPERR       (1u << 4)
#define FLASH_SR_PGAERR       (1u << 5)
#define FLASH_SR_PGPERR       (1u << 6)
#define FLASH_SR_PGSERR       (1u << 7)
#define FLASH_SR_BSY          (1u << 16)
#define FLASH_CR_PG           (1u << 0)
#define FLASH_CR_SER          (1u << 1)
#define FLASH_CR_SNB(sector)  ((uint32_t)(sector) << 3)
#define FLASH_CR_PSIZE_32     (2u << 8)
#define FLASH_CR_STRT         (1u << 16)
#define FLASH_CR_LOCK         (1u << 31)

/* ---- pins */

struct gpio_registers {
    volatile uint32_t MODER;
    volatile uint32_t OTYPER;
    volatile uint32_t OSPEEDR;
    volatile uint32_t PUPDR;
    volatile uint32_t IDR;
    volatile uint32_t ODR;
    volatile uint32_t BSRR;
    volatile uint32_t LCKR;
    volatile uint32_t AFRL;
    volatile uint32_t AFRH;
};
#define GPIOA      ((struct gpio_registers *)0x40020000u)
#define GPIOB      ((struct gpio_registers *)0x40020400u)
#define GPIOC      ((struct gpio_registers *)0x40020800u)
#define GPIO_BYTES 0x400u

/* ---- SPI */

struct spi_registers {
    volatile uint32_t CR1;
    volatile uint32_t CR2;
    volatile uint32_t SR;
    volatile uint32_t DR;
};
#define SPI1 ((struct spi_registers *)0x40013000u)

#define SPI_CR1_CPHA    (1u << 0)
#define SPI_CR1_CPOL    (1u << 1)
#define SPI_CR1_MSTR    (1u << 2)
#define SPI_CR1_BR(b)   ((uint32_t)(b) << 3)
#define SPI_CR1_SPE     (1u << 6)
#define SPI_CR1_SSI     (1u << 8)
#define SPI_CR1_SSM     (1u << 9)
#define SPI_CR2_RXDMAEN (1u << 0)
#define SPI_CR2_TXDMAEN (1u << 1)
#define SPI_SR_BSY      (1u << 7)

/* ---- USART */

struct usart_registers {
    volatile uint32_t SR;
    volatile uint32_t DR;
    volatile uint32_t BRR;
    volatile uint32_t CR1;
    volatile uint32_t CR2;
    volatile uint32_t CR3;
};
#define USART2 ((struct usart_registers *)0x40004400u)
#define USART3 ((struct usart_registers *)0x40004800u)

#define USART_SR_ORE     (1u << 3)
#define USART_SR_RXNE    (1u << 5)
#define USART_SR_TC      (1u << 6)
#define USART_SR_TXE     (1u << 7)
#define USART_CR1_RE     (1u << 2)
#define USART_CR1_TE     (1u << 3)
#define USART_CR1_RXNEIE (1u << 5)
#define USART_CR1_UE     (1u << 13)
#define USART_CR3_DMAT   (1u << 7)

/* ---- DMA */

struct dma_stream_registers {
    volatile uint32_t CR;
    volatile uint32_t NDTR;
    volatile uint32_t PAR;
    volatile uint32_t M0AR;
    volatile uint32_t M1AR;
    volatile uint32_t FCR;
};

struct dma_registers {
    volatile uint32_t LISR;
    volatile uint32_t HISR;
    volatile uint32_t LIFCR;
    volatile uint32_t HIFCR;
    struct dma_stream_registers S[8];
};
#define DMA1 ((struct dma_registers *)0x40026000u)
#define DMA2 ((struct dma_registers *)0x40026400u)

#define DMA_SxCR_EN                (1u << 0)
#define DMA_SxCR_TEIE              (1u << 2)
#define DMA_SxCR_TCIE              (1u << 4)
#define DMA_SxCR_DIR_TO_PERIPHERAL (1u << 6)
#define DMA_SxCR_MINC              (1u << 10)
#define DMA_SxCR_CHSEL(c)          ((uint32_t)(c) << 25)
#define DMA_LISR_TCIF0             (1u << 5)
#define DMA_LIFCR_CFEIF0           (1u << 0)
#define DMA_LIFCR_CDMEIF0          (1u << 2)
#define DMA_LIFCR_CTEIF0           (1u << 3)
#define DMA_LIFCR_CHTIF0           (1u << 4)
#define DMA_LIFCR_CTCIF0           (1u << 5)
#define DMA_LISR_TEIF3             (1u << 25)
#define DMA_LISR_TCIF3             (1u << 27)
#define DMA_LIFCR_CFEIF3           (1u << 22)
#define DMA_LIFCR_CDMEIF3          (1u << 24)
#define DMA_LIFCR_CTEIF3           (1u << 25)
#define DMA_LIFCR_CHTIF3           (1u << 26)
#define DMA_LIFCR_CTCIF3           (1u << 27)
#define DMA_HISR_TEIF6             (1u << 19)
#define DMA_HISR_TCIF6             (1u << 21)
#define DMA_HIFCR_CFEIF6           (1u << 16)
#define DMA_HIFCR_CDMEIF6          (1u << 18)
#define DMA_HIFCR_CTEIF6           (1u << 19)
#define DMA_HIFCR_CHTIF6           (1u << 20)
#define DMA_HIFCR_CTCIF6           (1u << 21)

/* ---- timer */

struct tim_registers {
    volatile uint32_t CR1;
    volatile uint32_t CR2;
    volatile uint32_t SMCR;
    volatile uint32_t DIER;
    volatile uint32_t SR;
    volatile uint32_t EGR;
    uint32_t reserved_0[3];
    volatile uint32_t CNT;
    volatile uint32_t PSC;
    volatile uint32_t ARR;
};
#define TIM2 ((struct tim_registers *)0x40000000u)

#define TIM_CR1_CEN (1u << 0)
#define TIM_EGR_UG  (1u << 0)

/* ---- independent watchdog */

struct iwdg_registers {
    volatile uint32_t KR;
    volatile uint32_t PR;
    volatile uint32_t RLR;
    volatile uint32_t SR;
};
#define IWDG ((struct iwdg_registers *)0x40003000u)

#define IWDG_KR_KEY_UNLOCK 0x5555u
#define IWDG_KR_KEY_FEED   0xAAAAu
#define IWDG_KR_KEY_START  0xCCCCu
#define IWDG_PR_PR_DIV64   4u

/* ---- analog to digital converter, for the temperature sensor */

struct adc_registers {
    volatile uint32_t SR;
    volatile uint32_t CR1;
    volatile uint32_t CR2;
    volatile uint32_t SMPR1;
    uint32_t reserved_0[7];
    volatile uint32_t SQR1;
    volatile uint32_t SQR2;
    volatile uint32_t SQR3;
    uint32_t reserved_1[5];
    volatile uint32_t DR;
};
#define ADC1 ((struct adc_registers *)0x40012000u)

struct adc_common_registers {
    volatile uint32_t CSR;
    volatile uint32_t CCR;
};
#define ADC_COMMON ((struct adc_common_registers *)0x40012300u)

#define ADC_SR_EOC              (1u << 1)
#define ADC_CR2_ADON            (1u << 0)
#define ADC_CR2_SWSTART         (1u << 30)
#define ADC_SMPR1_SMP16_480     (7u << 18)
#define ADC_SQR3_SQ1(channel)   ((uint32_t)(channel) << 0)
#define ADC_COMMON_CCR_ADCPRE_4 (1u << 16)
#define ADC_COMMON_CCR_TSVREFE  (1u << 23)

/* ---- what is mapped at address 0 */

struct syscfg_registers {
    volatile uint32_t MEMRMP;
};
#define SYSCFG ((struct syscfg_registers *)0x40013800u)

#define SYSCFG_MEMRMP_MEM_MODE_SYSTEM (1u << 0)

/* ---- system memory: the ROM boot loader and what the factory measured (data sheet DS8626, 5.3.21, 39.1) */

#define SYSTEM_MEMORY           0x1FFF0000u
#define UNIQUE_ID               ((const uint32_t *)0x1FFF7A10u)
#define TEMPERATURE_RAW_30_C    (*(const volatile uint16_t *)0x1FFF7A2Cu)
#define TEMPERATURE_RAW_110_C   (*(const volatile uint16_t *)0x1FFF7A2Eu)
#define ADC_CHANNEL_TEMPERATURE 16u

/* ---- Cortex-M4 core (Armv7-M Architecture Reference Manual, B3) */

struct systick_registers {
    volatile uint32_t CSR;
    volatile uint32_t RVR;
    volatile uint32_t CVR;
};
#define SYSTICK ((struct systick_registers *)0xE000E010u)

#define SYSTICK_CSR_ENABLE  (1u << 0)
#define SYSTICK_CSR_TICKINT (1u << 1)
#define SYSTICK_RVR_MAX     0x00FFFFFFu

struct nvic_registers {
    volatile uint32_t ISER[8];
    uint32_t reserved_0[184];
    volatile uint8_t IPR[240];
};
#define NVIC ((struct nvic_registers *)0xE000E100u)

struct scb_registers {
    volatile uint32_t CPUID;
    volatile uint32_t ICSR;
    volatile uint32_t VTOR;
    volatile uint32_t AIRCR;
    volatile uint32_t SCR;
    volatile uint32_t CCR;
    volatile uint8_t SHPR[12];
    volatile uint32_t SHCSR;
    volatile uint32_t CFSR;
    uint32_t reserved_0[23];
    volatile uint32_t CPACR;
};
#define SCB ((struct scb_registers *)0xE000ED00u)

#define SCB_AIRCR_VECTKEY_SYSRESETREQ (0x05FA0000u | 1u << 2)
#define SCB_CCR_DIV_0_TRP             (1u << 4)
#define SCB_CPACR_FPU_FULL            (15u << 20)
#define SCB_SHPR_SYSTICK              11u

/* Positions in the vector table after the 16 of the core. */
enum interrupt {
    IRQ_DMA1_STREAM3 = 14,
    IRQ_DMA1_STREAM6 = 17,
    IRQ_USART2 = 38,
    IRQ_USART3 = 39,
    IRQ_COUNT = 82,
};

#endif
