/* The chain of flip-flops that selects one sensor after the other; output low = selected. */
#ifndef FLIP_FLOP_CHAIN_H
#define FLIP_FLOP_CHAIN_H

#include <stdbool.h>
#include <stdint.h>

#define FLIP_FLOP_CHAIN_MAX 64u

struct flip_flop_chain {
    uint32_t slots;    /* 1 to FLIP_FLOP_CHAIN_MAX */
    uint64_t selected; /* bit i: the output of slot i is low */
};

/* Power-up: the flip-flops hold anything, the same for the same seed. */
void flip_flop_chain_power_up(struct flip_flop_chain *chain, uint32_t slots, uint64_t seed);

/* A pulse on SEL_CLK: `data` enters at slot 0, everything moves one slot outward. */
void flip_flop_chain_clock(struct flip_flop_chain *chain, bool data);

#endif
