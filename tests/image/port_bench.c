/* Does what board.h offers, one thing a command, for tests of the port alone.
 *
 * A command is a letter and three 32-bit numbers, little-endian; the answer two 32-bit numbers. It says READY
 * twice when it starts. */
#include <string.h>

#include "port.h"

#define DATA_BYTES 256u
#define READY      0x59444552u /* "REDY" */

struct board the_board;

struct command {
    uint8_t letter;
    uint32_t a, b, c;
};

static uint8_t data[DATA_BYTES];

static uint32_t word_at(const uint8_t *bytes) {
    uint32_t word;
    memcpy(&word, bytes, 4);
    return word;
}

static void read_exactly(struct board *board, uint8_t *bytes, size_t n) {
    for (size_t got = 0; got < n;) {
        got += board_link_read(board, bytes + got, n - got);
        board_made_progress(board);
        board_wait_until(board, board_now_us(board) + 1000u);
    }
}

static void answer(struct board *board, uint32_t first, uint32_t second) {
    static uint8_t bytes[8];
    memcpy(bytes, &first, 4);
    memcpy(bytes + 4, &second, 4);
    while (!board_link_send(board, bytes, sizeof bytes)) {
    }
    while (board_link_sending(board)) {
    }
}

/* Area: bit 0 of a; offset: its upper half; b bytes that count up from c. */
static bool write_store(struct board *board, const struct command *command) {
    for (uint32_t i = 0; i < DATA_BYTES; i++) {
        data[i] = (uint8_t)(command->c + i);
    }
    return board_store_write(board, command->a & 1u, command->a >> 16, data, command->b);
}

static uint32_t sum_store(struct board *board, const struct command *command) {
    uint32_t sum = 0;
    for (uint32_t offset = 0; offset < command->b; offset++) {
        uint8_t byte;
        board_store_read(board, command->a & 1u, (command->a >> 16) + offset, &byte, 1);
        sum = sum * 31u + byte;
    }
    return sum;
}

static void obey(struct board *board, const struct command *command) {
    switch (command->letter) {
    case 'c': /* causes and clocks */
        answer(board, board->identity.reset_cause, board->identity.clock_source);
        break;
    case 'f': /* fault */
        answer(board, board->identity.fault_pc, board->identity.fault_cfsr);
        break;
    case 'u': { /* unique id, word a */
        answer(board, word_at(board->identity.unique_id + 4u * command->a), board->identity.board);
        break;
    }
    case 't': /* temperature in millidegrees */
        answer(board, (uint32_t)(int32_t)(board_temperature_c(board) * 1000.0f), board_has_dfu(board));
        break;
    case 'w': { /* how late a wait of a microseconds ends, and how long it took */
        const uint32_t start_us = board_now_us(board);
        board_wait_until(board, start_us + command->a);
        const uint32_t took_us = board_now_us(board) - start_us;
        answer(board, took_us - command->a, took_us);
        break;
    }
    case 'E':
        answer(board, board_store_erase(board, command->a), 0);
        break;
    case 'W':
        answer(board, write_store(board, command), 0);
        break;
    case 'R':
        answer(board, sum_store(board, command), 0);
        break;
    case 'S': { /* select clocks: a times b, and then a byte c */
        for (uint32_t i = 0; i < command->a; i++) {
            board_select_clock(board, command->b != 0);
        }
        uint8_t byte = (uint8_t)command->c;
        board_spi_transfer(board, &byte, &byte, 1);
        answer(board, byte, 0);
        break;
    }
    case 'G': { /* a transfer of two bytes whose answer nobody takes */
        uint8_t bytes[2] = {0x11, 0x22};
        SPI1->CR2 = SPI_CR2_TXDMAEN;
        board_spi_transfer(board, bytes, bytes, sizeof bytes);
        SPI1->CR2 = SPI_CR2_RXDMAEN | SPI_CR2_TXDMAEN;
        answer(board, bytes[0], bytes[1]);
        break;
    }
    case 'L':
        board_led(board, command->a != 0);
        answer(board, 0, 0);
        break;
    case 'H': /* hang */
        for (;;) {
        }
    case 'A': /* answers, and leaves with the last bytes still on their way */
        answer(board, READY, READY);
        board_enter_dfu(board);
        break;
    case 'D':
        board_enter_dfu(board);
        answer(board, 0, 0);
        break;
    case 'J': /* as a boot loader does that leaves its clocks on */
        interrupts_off();
        __asm volatile("b reset_handler");
        break;
    case 'X': /* a read from where nothing is */
        answer(board, *(volatile uint32_t *)0x60000000u, 0);
        break;
    case 'O': /* overflow of the stack */
        __asm volatile("1: push {r0-r7}\n\tb 1b");
        break;
    default:
        answer(board, 0xFFFFFFFFu, command->letter);
        break;
    }
}

int main(void) {
    struct board *const board = &the_board;
    board_start(board);
    answer(board, READY, READY);
    for (;;) {
        uint8_t bytes[13];
        read_exactly(board, bytes, sizeof bytes);
        const struct command command = {bytes[0], word_at(bytes + 1), word_at(bytes + 5), word_at(bytes + 9)};
        obey(board, &command);
    }
}
