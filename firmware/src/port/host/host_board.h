/* A board made of memory and virtual time, so that the firmware runs inside a program.
 *
 * The owner (the emulator) provides the SPI bus as two functions, moves time forward and carries the
 * link's bytes. Nothing here waits: board_wait_until() only moves t_ns. */
#ifndef HOST_BOARD_H
#define HOST_BOARD_H

#include "board.h"

#define HOST_BOARD_RX_BYTES 4096u

struct host_bus {
    void *context;
    /* The byte clocked out by whatever is selected while mosi is clocked in; the transfer of this byte
     * ends at t_ns. */
    uint8_t (*transfer)(void *context, uint64_t t_ns, uint8_t mosi);
    void (*select_clock)(void *context, uint64_t t_ns, bool data);
};

/* Where the device's clock comes from, if not from t_ns: asked once by each board_now_us() and once by each
 * board_wait_until(), which then returns at once. */
struct host_clock {
    void *context;
    uint32_t (*look_us)(void *context); /* a null pointer: the clock runs with t_ns */
};

struct host_store_area {
    uint8_t bytes[BOARD_STORE_BYTES];
};

struct board {
    struct host_bus bus;
    struct host_clock clock;
    struct board_identity identity;

    uint64_t t_ns;       /* true (not device) time now */
    uint64_t horizon_ns; /* board_wait_until never moves t_ns beyond this */
    uint64_t wake_ns;   /* true time that the last board_wait_until waits for, also if the horizon ended it */
    double clock_ratio; /* device seconds a true second, 1 + ppm * 1e-6 */
    uint32_t clock_offset_us;
    uint32_t spi_hz;
    uint32_t baud;
    float temperature_c;

    uint8_t rx[HOST_BOARD_RX_BYTES]; /* ring of bytes on their way to the firmware */
    size_t rx_head, rx_count;
    bool rx_arrived; /* since the last board_wait_until */

    const uint8_t *tx; /* bytes being sent, owned by the firmware */
    size_t tx_count, tx_taken;
    uint64_t tx_start_ns;

    struct host_store_area store[2];
    uint64_t store_steps_left; /* words programmed and halves of an area erased until the power is cut */
    bool led_on;
    uint64_t progress_count; /* calls of board_made_progress: a watchdog's view of the loop */
};

/* Sets everything to power-on values: erased store, t_ns = 0, clock_ratio 1, spi_hz 5000000,
 * baud 921600, temperature 25 degC, no power cut. The caller fills bus and identity before app_init. */
void host_board_init(struct board *board);

/* Bytes toward the firmware; returns how many fitted. */
size_t host_board_write(struct board *board, const uint8_t *bytes, size_t n);

/* Takes bytes whose last bit has left the device by t_ns (one byte every 10 bit times), at most capacity.
 * A send ends when its last byte was taken: to be called after each app_poll(). */
size_t host_board_read(struct board *board, uint8_t *bytes, size_t capacity);

/* When the send in progress ends, true time; UINT64_MAX if none. */
uint64_t host_board_send_end_ns(const struct board *board);

#endif
