/* What the files of the model share: its state, one structure a peripheral, and time. */
#ifndef MACHINE_H
#define MACHINE_H

#include <unicorn/unicorn.h>

#include "mcu.h"

/* Virtual time counts 336 MHz: 16, 42, 84 and 168 MHz, microseconds and the watchdog's 32 kHz are all whole.
 */
#define TICKS_HZ     336000000ull
#define TICKS_PER_US 336ull
#define NEVER        UINT64_MAX

#define FLASH_START  0x08000000u
#define FLASH_BYTES  0x00100000u
#define RAM_START    0x20000000u
#define RAM_BYTES    0x00020000u
#define SYSTEM_START 0x1FFF0000u
#define SYSTEM_BYTES 0x00008000u
#define STORE_START  0x08008000u /* sectors 2 and 3 are programmed through flash.c */
#define STORE_END    0x08010000u
#define SECTOR_BYTES 0x00004000u

#define EXCEPTION_COUNT 98u /* 16 of the core, 82 interrupts */
enum exception {
    EXCEPTION_NMI = 2,
    EXCEPTION_HARD_FAULT = 3,
    EXCEPTION_SVCALL = 11,
    EXCEPTION_PENDSV = 14,
    EXCEPTION_SYSTICK = 15,
    EXCEPTION_DMA1_STREAM3 = 16 + 14,
    EXCEPTION_DMA1_STREAM6 = 16 + 17,
    EXCEPTION_TIM2 = 16 + 28,
    EXCEPTION_TIM3 = 16 + 29,
    EXCEPTION_TIM4 = 16 + 30,
    EXCEPTION_USART2 = 16 + 38,
    EXCEPTION_USART3 = 16 + 39,
    EXCEPTION_TIM5 = 16 + 50,
};

/* What can happen on its own, each at most once at a time. */
enum event {
    EVENT_SYSTICK,
    EVENT_TIMER_FIRST,
    EVENT_TIMER_LAST = EVENT_TIMER_FIRST + 3,
    EVENT_LINK_SENT,
    EVENT_LINK_RECEIVED,
    EVENT_WATCHDOG,
    EVENT_CRYSTAL_FAILS,
    EVENT_COUNT
};

struct cpu {
    uint32_t pc; /* where to go on; bit 0 set */
    bool first_block;
    bool stopped_by_us;
    bool asleep;          /* in WFI */
    int interrupt_number; /* unicorn's, -1 if none */
    uint32_t fault_address;
    bool fault_is_write;
    uint64_t tick_fraction; /* in 1/256 ticks */
    uint64_t ticks_per_instruction_256;
    uint8_t instructions_of_block[FLASH_BYTES / 2]; /* by its first halfword; 0: not counted yet */
    uint64_t *profile; /* of the owner, as mcu_profile() says; or a null pointer */
};

struct nvic {
    bool pending[EXCEPTION_COUNT];
    bool enabled[EXCEPTION_COUNT];
    bool line[EXCEPTION_COUNT]; /* level of the peripheral's request */
    uint8_t priority[EXCEPTION_COUNT];
    uint8_t active[EXCEPTION_COUNT]; /* a stack: the last is running */
    uint32_t active_count;
    uint32_t wanted; /* how many are pending and enabled */
    uint32_t vtor, ccr, cfsr, hfsr, bfar, shcsr, cpacr;
};

struct systick {
    uint32_t csr, rvr;
    uint64_t started; /* when the count was last at the reload value */
    bool flagged;
};

struct rcc {
    uint32_t cr, pllcfgr, cfgr, ahb1enr, apb1enr, apb2enr, csr;
    uint64_t hse_ready, pll_ready;
    bool crystal_failed;
};

struct gpio {
    uint32_t moder, otyper, ospeedr, pupdr, odr, afr[2];
};

struct spi {
    uint32_t cr1, cr2;
    bool shifting, tx_full, rx_full, overrun;
    uint64_t shift_end;
    uint8_t shift_in, tx, rx;
};

struct usart {
    uint32_t brr, cr1, cr2, cr3;
    bool shifting, tx_full, tx_complete, rx_full, overrun;
    bool status_read; /* by the core: a write of DR after it clears TC */
    uint8_t shift, tx, rx;
};

struct dma {
    struct dma_stream {
        uint32_t cr, ndtr, par, m0ar, fcr;
        uint32_t moved;
    } stream[8];
    uint32_t flags[2];
};

struct timer {
    uint32_t cr1, dier, sr, psc_preload, psc, arr, count;
    uint64_t started; /* when the count was `count` */
};

struct iwdg {
    uint32_t pr, rlr;
    bool unlocked, running;
};

struct adc {
    uint32_t cr1, cr2, smpr1, sqr1, sqr3, ccr;
    uint64_t done;
    bool converting, end_of_conversion;
};

struct flash {
    uint8_t *memory;
    uint32_t acr, sr, cr;
    uint32_t keys_given;
    bool key_wrong;
    uint32_t cut_in; /* operations until power fails; 0: not asked for */
};

#define LINK_QUEUE_BYTES 65536u
struct byte_queue {
    uint8_t bytes[LINK_QUEUE_BYTES];
    size_t first, count;
};

static inline bool queue_put(struct byte_queue *queue, uint8_t byte) {
    if (queue->count == LINK_QUEUE_BYTES) {
        return false;
    }
    queue->bytes[(queue->first + queue->count++) % LINK_QUEUE_BYTES] = byte;
    return true;
}

static inline bool queue_take(struct byte_queue *queue, uint8_t *byte) {
    if (queue->count == 0) {
        return false;
    }
    *byte = queue->bytes[queue->first];
    queue->first = (queue->first + 1) % LINK_QUEUE_BYTES;
    queue->count--;
    return true;
}

struct mcu {
    uc_engine *uc;
    struct mcu_wiring wiring;
    struct mcu_options options;
    struct mcu_bus bus;
    struct mcu_counters counters;
    char violation[160];

    uint8_t *ram, *system_memory;
    uint64_t now;
    uint64_t events[EVENT_COUNT];
    uint64_t stop_at; /* the next event or the horizon: run no further */
    uint64_t horizon;
    uint64_t sleep_ticks;
    uint64_t random;

    bool reset_wanted, power_cut, in_boot_loader;
    uint32_t reset_flag;

    /* Two reads of one register with nothing between are somebody waiting for it. */
    uint32_t last_read;
    bool polled;

    struct logged_event *log;
    size_t log_count, log_capacity;

    struct byte_queue to_firmware, from_firmware;

    struct cpu cpu;
    struct nvic nvic;
    struct systick systick;
    struct rcc rcc;
    struct gpio gpio[3];
    struct spi spi;
    struct usart usart;
    struct dma dma[2];
    struct timer timer[4];
    struct iwdg iwdg;
    struct adc adc;
    struct flash flash;
    uint32_t syscfg_memrmp;
    bool sel_clk_high;
};

/* mcu.c */
void mcu_forbid(struct mcu *mcu, const char *format, ...) __attribute__((format(printf, 2, 3)));
void mcu_log(struct mcu *mcu, enum logged_kind kind, uint32_t t_us, uint8_t out, uint8_t in);
bool mcu_write_ram(struct mcu *mcu, uint32_t address, const void *bytes, size_t n);
void mcu_request_reset(struct mcu *mcu, uint32_t rcc_flag);
void mcu_reset(struct mcu *mcu, uint32_t rcc_flags);
uint64_t mcu_random(struct mcu *mcu);
static inline uint64_t ticks_to_ns(uint64_t ticks) {
    return ticks / 42 * 125 + ticks % 42 * 125 / 42;
}

/* time.c */
void time_schedule(struct mcu *mcu, enum event event, uint64_t at);
void time_stop_now(struct mcu *mcu);
void time_find_next(struct mcu *mcu);
void time_handle_events(struct mcu *mcu);
/* For a status register that is being polled: jumps to the time at which it changes. */
void time_warp(struct mcu *mcu, uint64_t to);

/* cpu.c */
bool cpu_open(struct mcu *mcu);
void cpu_reset(struct mcu *mcu);
void cpu_forget_code(struct mcu *mcu);
void cpu_set_clock(struct mcu *mcu, uint32_t hclk_hz);
uint32_t cpu_read(struct mcu *mcu, int register_id);
void cpu_write(struct mcu *mcu, int register_id, uint32_t value);
enum mcu_stop cpu_run(struct mcu *mcu, bool stop_at_reset);

/* exceptions.c */
void exception_enter(struct mcu *mcu, uint32_t number);
void exception_return(struct mcu *mcu, uint32_t exc_return);

/* nvic.c: the interrupt controller and the system control block */
void nvic_reset(struct mcu *mcu);
void nvic_pend(struct mcu *mcu, uint32_t exception);
void nvic_set_line(struct mcu *mcu, uint32_t exception, bool high);
void nvic_start(struct mcu *mcu, uint32_t exception);
uint32_t nvic_end(struct mcu *mcu);
int nvic_best(struct mcu *mcu); /* the exception that preempts what runs, or -1 */
int nvic_running_priority(const struct mcu *mcu);
uint32_t nvic_read(struct mcu *mcu, uint32_t offset, uint32_t size);
void nvic_write(struct mcu *mcu, uint32_t offset, uint32_t size, uint32_t value);

/* systick.c */
void systick_reset(struct mcu *mcu);
uint32_t systick_read(struct mcu *mcu, uint32_t offset);
void systick_write(struct mcu *mcu, uint32_t offset, uint32_t value);
void systick_event(struct mcu *mcu);

/* peripherals.c: which peripheral answers at an address */
bool peripherals_map(struct mcu *mcu);

/* rcc.c */
void rcc_power_on(struct mcu *mcu);
void rcc_reset(struct mcu *mcu);
uint32_t rcc_hclk_hz(const struct mcu *mcu);
uint32_t rcc_pclk_hz(const struct mcu *mcu, unsigned bus); /* 1 or 2 */
uint32_t rcc_timer_hz(const struct mcu *mcu);              /* of the timers on APB1 */
uint32_t rcc_read(struct mcu *mcu, unsigned instance, uint32_t offset);
void rcc_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value);
void rcc_crystal_fails(struct mcu *mcu);

/* gpio.c */
void gpio_reset(struct mcu *mcu);
bool gpio_is_alternate(const struct mcu *mcu, uint8_t pin, uint32_t function);
bool gpio_drives(const struct mcu *mcu, uint8_t pin, bool *high);
uint32_t gpio_read(struct mcu *mcu, unsigned instance, uint32_t offset);
void gpio_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value);

/* string.c: the wires of the sensor string */
void string_pins_changed(struct mcu *mcu);
uint8_t string_transfer(struct mcu *mcu, uint64_t end, uint8_t mosi);

/* spi.c, usart.c, dma.c, timers.c, iwdg.c, adc.c, flash.c, syscfg.c */
void spi_reset(struct mcu *mcu);
uint32_t spi_read(struct mcu *mcu, unsigned instance, uint32_t offset);
void spi_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value);
void spi_serve_dma(struct mcu *mcu, uint64_t at); /* a byte each way, if DMA has one and takes one */
void spi_finish(struct mcu *mcu); /* lets whoever polls wait for the end of what DMA has for it */

void usart_reset(struct mcu *mcu);
uint32_t usart_read(struct mcu *mcu, unsigned instance, uint32_t offset);
void usart_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value);
void usart_sent(struct mcu *mcu);
void usart_received(struct mcu *mcu);
void usart_expect(struct mcu *mcu);
uint64_t usart_all_sent(const struct mcu *mcu);
bool usart_wants_dma(const struct mcu *mcu);
void usart_put(struct mcu *mcu, uint8_t byte);

void dma_reset(struct mcu *mcu);
uint32_t dma_read(struct mcu *mcu, unsigned instance, uint32_t offset);
void dma_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value);
void dma_serve_usart(struct mcu *mcu);
uint32_t dma_left(const struct mcu *mcu);          /* bytes that the link's stream has still to move */
bool dma_take_spi(struct mcu *mcu, uint8_t *byte); /* the next byte for SPI1; false if there is none */
bool dma_give_spi(struct mcu *mcu, uint8_t byte);  /* from SPI1; false if no stream takes it */
uint32_t dma_left_of_spi(const struct mcu *mcu);   /* bytes that SPI1 has still to be given */

void timers_reset(struct mcu *mcu);
uint32_t timers_count(const struct mcu *mcu, unsigned instance);
uint32_t timers_read(struct mcu *mcu, unsigned instance, uint32_t offset);
void timers_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value);
void timers_event(struct mcu *mcu, unsigned instance);

void iwdg_reset(struct mcu *mcu);
uint32_t iwdg_read(struct mcu *mcu, unsigned instance, uint32_t offset);
void iwdg_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value);

void adc_reset(struct mcu *mcu);
uint32_t adc_read(struct mcu *mcu, unsigned instance, uint32_t offset);
void adc_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value);

void flash_reset(struct mcu *mcu);
uint32_t flash_read(struct mcu *mcu, unsigned instance, uint32_t offset);
void flash_write(struct mcu *mcu, unsigned instance, uint32_t offset, uint32_t value);
uint64_t flash_store_read(struct mcu *mcu, uint32_t address, unsigned size);
void flash_store_write(struct mcu *mcu, uint32_t address, unsigned size, uint32_t value);

#endif
