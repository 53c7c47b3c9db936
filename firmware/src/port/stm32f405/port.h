/* What the files of this port share: the board's state, and one set of functions a file. */
#ifndef PORT_H
#define PORT_H

#include "board.h"
#include "registers.h"

#define LINK_RX_BYTES 1024u /* a power of two; two largest packets framed */

struct clocks {
    uint32_t hclk_hz;
    uint32_t pclk1_hz;
    uint32_t pclk2_hz;
    enum wire_clock_source source;
    bool answered; /* the RCC does what it is told; false only on a machine that emulates none of it */
};

struct board {
    struct clocks clocks;
    struct board_identity identity;

    /* Written by the receive interrupt (head) and by board_link_read (tail) only. */
    volatile uint8_t rx[LINK_RX_BYTES];
    volatile uint32_t rx_head;
    volatile uint32_t rx_tail;

    bool sel_data; /* what SEL_DATA carries */

    volatile bool sending;
    volatile bool send_ended; /* since board_wait_until looked last */
    volatile bool slept;      /* SysTick has run down */
    bool dma_answers;
};

extern struct board the_board; /* main.c; interrupt handlers know no other */

/* start.c */
void board_start(struct board *board);

/* clocks.c: 168 MHz from the crystal, or else from the internal oscillator, or else 16 MHz; bounded. */
void clocks_start(struct clocks *clocks);
bool clocks_are_reset(void);

/* gpio.c: a pin is PIN(port letter, number). */
#define PIN(port, number) ((uint32_t)((port) - 'A') << 4 | (uint32_t)(number))
void gpio_start(void);
void gpio_set_up_output(uint32_t pin);
void gpio_set_up_alternate(uint32_t pin, uint32_t function);
void gpio_pull_up(uint32_t pin);

static inline struct gpio_registers *gpio_port(uint32_t pin) {
    return (struct gpio_registers *)((uint32_t)GPIOA + (pin >> 4) * GPIO_BYTES);
}

static inline void gpio_write(uint32_t pin, bool high) {
    const uint32_t bit = 1u << (pin & 15u);
    gpio_port(pin)->BSRR = high ? bit : bit << 16;
}

/* time.c */
void time_start(const struct clocks *clocks);

/* bus.c */
void bus_start(struct board *board);

/* link.c */
void link_start(struct board *board);
void link_flush(struct board *board);

/* watchdog.c: resets the MCU when board_made_progress was not called for 2 s (1.4 to 3.8 s: the oscillator
 * is an RC), which is longer than the longest erase stalls the CPU. */
void watchdog_start(void);
void watchdog_feed(void);

/* temperature.c */
void temperature_start(void);

/* faults.c: the record that a hard fault leaves in memory that no start clears. */
struct fault_record {
    uint32_t magic;
    uint32_t pc;
    uint32_t lr;
    uint32_t cfsr;
};
bool faults_take_record(struct fault_record *record);
void faults_start(void);

/* identity.c */
void identity_read(const struct clocks *clocks, struct board_identity *identity);

/* dfu.c: called first of all after a reset; does not return if the boot loader was asked for. */
void dfu_enter_if_asked(void);

/* startup.c */
_Noreturn void system_reset(void);

static inline void interrupts_off(void) {
    __asm volatile("cpsid i" ::: "memory");
}

static inline void interrupts_on(void) {
    __asm volatile("cpsie i\n\tisb" ::: "memory");
}

static inline void barrier(void) {
    __asm volatile("dsb\n\tisb" ::: "memory");
}

/* Polls *r until its bits under `mask` equal `value`, at most `polls` times. */
static inline bool poll_until(const volatile uint32_t *r, uint32_t mask, uint32_t value, uint32_t polls) {
    for (; polls > 0; polls--) {
        if ((*r & mask) == value) {
            return true;
        }
    }
    return false;
}

#endif
