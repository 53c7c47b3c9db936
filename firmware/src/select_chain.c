/* The chain of flip-flops that selects one slot of the sensor string at a time. */
#include "select_chain.h"

static const bool SELECT = false; /* an output that is low selects its slot */

void select_chain_flush(struct board *board, unsigned slots) {
    for (unsigned i = 0; i < slots; i++)
        board_select_clock(board, !SELECT);
}

void select_chain_first(struct board *board) {
    board_select_clock(board, SELECT);
}

void select_chain_next(struct board *board) {
    board_select_clock(board, !SELECT);
}
