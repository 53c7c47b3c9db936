/* The seam between the application and a circuit board: link-time functions on an opaque board.
 *
 * The application (app.c) calls these and nothing else of a board; each port in port/ defines them
 * once. No function blocks longer than its contract says. None may be called from an interrupt. */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "wire.h" /* enums of board, reset cause and clock source */

struct board;

struct board_identity {
    uint8_t unique_id[12];
    enum wire_board board;
    enum wire_reset_cause reset_cause;
    enum wire_clock_source clock_source;
    uint32_t fault_pc; /* record of the hard fault that caused the restart, zeros if none */
    uint32_t fault_lr;
    uint32_t fault_cfsr;
};

/* Fills *identity. The same values until the next reset. */
void board_identify(struct board *board, struct board_identity *identity);

/* Microseconds since an arbitrary start, wraps at 2^32, never goes back. */
uint32_t board_now_us(struct board *board);

/* Sleeps until board_now_us() reaches t_us, a byte was received, or a send ended, whichever is first;
 * returns at once if t_us is in the past (compared modulo 2^32, as a signed difference). */
void board_wait_until(struct board *board, uint32_t t_us);

/* Tells the watchdog that the main loop made progress. */
void board_made_progress(struct board *board);

/* One pulse on SEL_CLK with SEL_DATA = data: the select chain moves one slot outward, `data` enters at
 * slot 0. Output low = selected. After power-up the chain holds anything. */
void board_select_clock(struct board *board, bool data);

/* Exchanges n bytes with whatever is selected, SPI mode 3, at most 10 MHz. tx and rx may be the same
 * memory. Bounded: a bus that does not answer gives 0xFF or 0x00. */
void board_spi_transfer(struct board *board, const uint8_t *tx, uint8_t *rx, size_t n);

/* Moves up to `capacity` received bytes to `bytes`, returns how many. */
size_t board_link_read(struct board *board, uint8_t *bytes, size_t capacity);

/* Starts sending n bytes; false if the send before has not ended. `bytes` must stay unchanged until
 * board_link_sending() is false. */
bool board_link_send(struct board *board, const uint8_t *bytes, size_t n);
bool board_link_sending(struct board *board);

/* Non-volatile store: two areas (0 and 1) of at least BOARD_STORE_BYTES, erased to 0xFF, in which a bit
 * can be cleared once after an erase. offset and n of a write are multiples of 4. A write or erase
 * that fails, or is cut by a power loss, leaves that area undefined and the other one untouched.
 * An erase may take up to 1 s; the port keeps the watchdog quiet meanwhile. */
#define BOARD_STORE_BYTES 8192u
bool board_store_erase(struct board *board, unsigned area);
bool board_store_write(struct board *board, unsigned area, size_t offset, const uint8_t *bytes, size_t n);
void board_store_read(struct board *board, unsigned area, size_t offset, uint8_t *bytes, size_t n);

/* The LED that tells one ribbon from the others. */
void board_led(struct board *board, bool on);

/* Temperature of the MCU in degrees Celsius; NaN if it has no sensor. */
float board_temperature_c(struct board *board);

/* Whether enter_dfu can work here, so that the command can be refused before it is acknowledged. */
bool board_has_dfu(struct board *board);

/* Leaves the firmware for the ROM boot loader once the bytes being sent are out. Returns only if it cannot.
 */
void board_enter_dfu(struct board *board);

#endif
