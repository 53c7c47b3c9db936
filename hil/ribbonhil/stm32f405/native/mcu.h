/* An STM32F405 that runs an image byte for byte: the face to its owner.
 *
 * The CPU is unicorn's; everything around it is here, one file a peripheral. Time is virtual: instructions
 * take as long as the clock tree of the moment says, SPI and USART bytes as long as their baud rates say. */
#ifndef MCU_H
#define MCU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "event_log.h"

/* A pin is 16 * port + number, port A being 0. */
struct mcu_wiring {
    uint8_t spi_sck, spi_miso, spi_mosi; /* of SPI1 */
    uint8_t sel_clk, sel_data;
    uint8_t link_usart; /* 2 or 3 */
    uint8_t link_tx, link_rx;
    uint8_t led;
    uint32_t crystal_hz; /* 0: there is none, or it does not start */
};

struct mcu_options {
    uint32_t link_baud;                   /* of the other end */
    uint32_t half_cycles_per_instruction; /* 3: 1.5 cycles on average */
    uint32_t erase_us;                    /* of a 16 KiB sector */
    uint32_t program_us;                  /* of a word */
    uint64_t crystal_fails_us;            /* when the crystal stops; 0: never */
    float temperature_c;
    uint8_t unique_id[12];
    uint64_t seed; /* of what memory holds at power-on and what a power cut leaves in flash */
};

/* The sensor string. Functions are called with the true time at which the byte or pulse ends. */
struct mcu_bus {
    void *context;
    uint8_t (*transfer)(void *context, uint64_t t_ns, uint8_t mosi);
    void (*select_clock)(void *context, uint64_t t_ns, bool data);
};

enum mcu_stop {
    MCU_AT_HORIZON,
    MCU_RESET,       /* and started again; only if stop_at_reset */
    MCU_POWER_CUT,   /* as asked for; call mcu_power_on */
    MCU_BOOT_LOADER, /* the firmware left for the boot loader in ROM */
    MCU_LOCKUP,      /* a fault inside a fault handler, and no watchdog runs */
};

struct mcu_counters {
    uint64_t instructions;
    uint64_t exceptions;
    uint64_t fp_frames; /* exceptions that had to stack floating-point registers */
    uint64_t sleeps;    /* WFI that waited */
    uint64_t bus_bytes;
    uint64_t bus_pulses;
    uint64_t link_bytes_sent;
    uint64_t link_bytes_lost; /* toward the firmware: not listening, or the one before was not read in time */
    uint64_t link_bytes_unread; /* from the firmware: lost because the owner left 64 KiB unread */
    uint64_t resets;
    uint64_t watchdog_resets;
    uint64_t flash_operations; /* words programmed and sectors erased */
    uint64_t violations;       /* things the real part forbids or does not do; see mcu_violation */
    uint64_t sleep_ns;         /* time asleep */
    uint32_t hclk_hz;
    uint32_t spi_hz;
    uint32_t link_baud; /* as the firmware set it */
};

struct mcu;

/* A new MCU, powered on. `image` goes to the start of flash, the rest is erased. A null pointer if there is
 * no memory, the image is larger than the flash, or unicorn does not work. */
struct mcu *mcu_new(const uint8_t *image, size_t n, const struct mcu_wiring *wiring,
                    const struct mcu_options *options, const struct mcu_bus *bus);
void mcu_free(struct mcu *mcu);

/* Takes power away and gives it back: RAM holds anything, flash keeps what it has, time goes on. Bytes on the
 * link are lost. */
void mcu_power_on(struct mcu *mcu);

/* Runs to t_ns or to a reset, and says why it came back. Time goes on without a core that runs. */
enum mcu_stop mcu_run(struct mcu *mcu, uint64_t t_ns, bool stop_at_reset);
uint64_t mcu_now_ns(const struct mcu *mcu);

/* When the core, if it sleeps, has something to do or to send next; now if it does not sleep. */
uint64_t mcu_next_event_ns(const struct mcu *mcu);

/* What the firmware's microsecond timer shows. */
uint32_t mcu_device_us(const struct mcu *mcu);

/* The first forbidden thing since the start, as a sentence, or an empty string. */
const char *mcu_violation(const struct mcu *mcu);
void mcu_read_counters(const struct mcu *mcu, struct mcu_counters *counters);

/* Bytes toward the firmware, one after the other at the link's baud rate; returns how many were taken. */
size_t mcu_link_write(struct mcu *mcu, const uint8_t *bytes, size_t n);
/* Takes bytes that have left the firmware. */
size_t mcu_link_read(struct mcu *mcu, uint8_t *bytes, size_t capacity);

bool mcu_is_sending(const struct mcu *mcu);

bool mcu_led(const struct mcu *mcu);

/* Memory as a debugger sees it, flash included; false if the range is not all memory. */
bool mcu_peek(struct mcu *mcu, uint32_t address, uint8_t *bytes, size_t n);
bool mcu_poke(struct mcu *mcu, uint32_t address, const uint8_t *bytes, size_t n);

/* Power is cut in the middle of the `operations`-th flash operation from now on (1: the next). */
void mcu_cut_power_in_flash_operation(struct mcu *mcu, uint32_t operations);

/* Starts, or with capacity 0 ends, logging what the firmware does and sees into caller-owned memory; what
 * does not fit is not logged. Returns how many events the log before has. */
size_t mcu_log_events(struct mcu *mcu, struct logged_event *events, size_t capacity);

/* Adds the instructions of every block of code that runs to the element of its first halfword in flash, into
 * caller-owned memory of MCU_PROFILE_COUNT elements; until it is called with a null pointer. */
#define MCU_PROFILE_COUNT 524288
void mcu_profile(struct mcu *mcu, uint64_t *instructions);

#endif
