/* Brings a board up, from the core's reset state to everything that board.h offers. */
#include BOARD_HEADER
#include "port.h"

void board_start(struct board *board) {
    faults_start();
    clocks_start(&board->clocks);
    watchdog_start();
    identity_read(&board->clocks, &board->identity);
    time_start(&board->clocks);
    gpio_start();
    gpio_set_up_output(BOARD_LED);
    temperature_start();
    bus_start(board);
    link_start(board);
}

void board_led(struct board *board, bool on) {
    (void)board;
    gpio_write(BOARD_LED, on);
}
