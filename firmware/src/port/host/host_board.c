/* A board made of memory and virtual time, so that the firmware runs inside a program. */
#include "host_board.h"

#include <math.h>
#include <string.h>

static const uint64_t NS_PER_S = 1000000000u;
static const uint64_t SELECT_CLOCK_NS = 500u; /* of a microcontroller that toggles two pins */
static const unsigned BITS_PER_BYTE_ON_LINK = 10u;

void host_board_init(struct board *board) {
    memset(board, 0, sizeof *board);
    memset(board->store, 0xFF, sizeof board->store);
    board->store_steps_left = UINT64_MAX;
    board->horizon_ns = UINT64_MAX;
    board->clock_ratio = 1.0;
    board->spi_hz = 5000000u;
    board->baud = 921600u;
    board->temperature_c = 25.0f;
}

void board_identify(struct board *board, struct board_identity *identity) {
    *identity = board->identity;
}

static double elapsed_us(const struct board *board) {
    return (double)board->t_ns * board->clock_ratio * 1e-3;
}

uint32_t board_now_us(struct board *board) {
    if (board->clock.look_us != NULL)
        return board->clock.look_us(board->clock.context);
    return board->clock_offset_us + (uint32_t)(uint64_t)elapsed_us(board);
}

void board_wait_until(struct board *board, uint32_t t_us) {
    const bool has_arrived = board->rx_arrived;
    board->rx_arrived = false;
    board->wake_ns = board->t_ns;
    const int32_t left_us = (int32_t)(t_us - board_now_us(board));
    if (has_arrived || left_us <= 0 || board->clock.look_us != NULL)
        return;

    const double target_us = floor(elapsed_us(board)) + (double)left_us;
    uint64_t wake_ns = (uint64_t)ceil(target_us * 1e3 / board->clock_ratio);
    if (wake_ns <= board->t_ns) /* rounding: there, the device's clock shows a microsecond too few */
        wake_ns = board->t_ns + 1u;
    const uint64_t send_end_ns = host_board_send_end_ns(board);
    if (send_end_ns < wake_ns)
        wake_ns = send_end_ns;
    if (wake_ns > board->t_ns)
        board->wake_ns = wake_ns;
    if (board->horizon_ns > board->t_ns)
        board->t_ns = board->wake_ns < board->horizon_ns ? board->wake_ns : board->horizon_ns;
}

void board_made_progress(struct board *board) {
    board->progress_count++;
}

void board_select_clock(struct board *board, bool data) {
    board->t_ns += SELECT_CLOCK_NS;
    board->bus.select_clock(board->bus.context, board->t_ns, data);
}

void board_spi_transfer(struct board *board, const uint8_t *tx, uint8_t *rx, size_t n) {
    for (size_t i = 0; i < n; i++) {
        board->t_ns += 8u * NS_PER_S / board->spi_hz;
        rx[i] = board->bus.transfer(board->bus.context, board->t_ns, tx[i]);
    }
}

size_t host_board_write(struct board *board, const uint8_t *bytes, size_t n) {
    size_t i = 0;
    while (i < n && board->rx_count < HOST_BOARD_RX_BYTES) {
        board->rx[(board->rx_head + board->rx_count) % HOST_BOARD_RX_BYTES] = bytes[i++];
        board->rx_count++;
        board->rx_arrived = true;
    }
    return i;
}

size_t board_link_read(struct board *board, uint8_t *bytes, size_t capacity) {
    size_t n = 0;
    while (n < capacity && board->rx_count > 0u) {
        bytes[n++] = board->rx[board->rx_head];
        board->rx_head = (board->rx_head + 1u) % HOST_BOARD_RX_BYTES;
        board->rx_count--;
    }
    return n;
}

bool board_link_send(struct board *board, const uint8_t *bytes, size_t n) {
    if (board_link_sending(board))
        return false;
    board->tx = bytes;
    board->tx_count = n;
    board->tx_taken = 0u;
    board->tx_start_ns = board->t_ns;
    return true;
}

bool board_link_sending(struct board *board) {
    return board->tx_taken < board->tx_count;
}

uint64_t host_board_send_end_ns(const struct board *board) {
    if (board->tx_taken >= board->tx_count)
        return UINT64_MAX;
    const uint64_t bits = (uint64_t)board->tx_count * BITS_PER_BYTE_ON_LINK;
    return board->tx_start_ns + (bits * NS_PER_S + board->baud - 1u) / board->baud;
}

size_t host_board_read(struct board *board, uint8_t *bytes, size_t capacity) {
    if (board->tx_taken >= board->tx_count)
        return 0u;
    const uint64_t bits = (board->t_ns - board->tx_start_ns) * board->baud / NS_PER_S;
    const size_t left_device = (size_t)(bits / BITS_PER_BYTE_ON_LINK);
    const size_t available = left_device < board->tx_count ? left_device : board->tx_count;
    size_t n = 0;
    while (n < capacity && board->tx_taken < available)
        bytes[n++] = board->tx[board->tx_taken++];
    return n;
}

static bool store_step(struct board *board) {
    if (board->store_steps_left == 0u)
        return false;
    if (board->store_steps_left != UINT64_MAX)
        board->store_steps_left--;
    return true;
}

bool board_store_erase(struct board *board, unsigned area) {
    for (size_t half = 0; half < 2u; half++) {
        if (!store_step(board))
            return false;
        memset(board->store[area].bytes + half * BOARD_STORE_BYTES / 2u, 0xFF, BOARD_STORE_BYTES / 2u);
    }
    return true;
}

bool board_store_write(struct board *board, unsigned area, size_t offset, const uint8_t *bytes, size_t n) {
    if (offset > BOARD_STORE_BYTES || n > BOARD_STORE_BYTES - offset || offset % 4u != 0u || n % 4u != 0u)
        return false;
    for (size_t i = 0; i < n; i++) {
        if (i % 4u == 0u && !store_step(board))
            return false;
        board->store[area].bytes[offset + i] &= bytes[i]; /* flash: a bit can only be cleared */
    }
    return true;
}

void board_store_read(struct board *board, unsigned area, size_t offset, uint8_t *bytes, size_t n) {
    memcpy(bytes, board->store[area].bytes + offset, n);
}

void board_led(struct board *board, bool on) {
    board->led_on = on;
}

float board_temperature_c(struct board *board) {
    return board->temperature_c;
}

bool board_has_dfu(struct board *board) {
    (void)board;
    return false;
}

void board_enter_dfu(struct board *board) {
    (void)board;
}
