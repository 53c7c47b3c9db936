/* The chain of flip-flops that selects one slot of the sensor string at a time. */
#ifndef SELECT_CHAIN_H
#define SELECT_CHAIN_H

#include "board.h"

/* Fills the chain of `slots` flip-flops with ones, so that nothing is selected: after power-up it holds
 * anything. */
void select_chain_flush(struct board *board, unsigned slots);

/* Selects slot 0. The chain must hold ones only. */
void select_chain_first(struct board *board);

/* Selects the slot after the selected one; after the last slot nothing is selected. */
void select_chain_next(struct board *board);

#endif
