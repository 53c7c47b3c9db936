/* The select chain as a shift register. */
#include "flip_flop_chain.h"

#include "noise.h"

static uint64_t mask(const struct flip_flop_chain *chain) {
    return UINT64_MAX >> (FLIP_FLOP_CHAIN_MAX - chain->slots);
}

void flip_flop_chain_power_up(struct flip_flop_chain *chain, uint32_t slots, uint64_t seed) {
    chain->slots = slots;
    chain->selected = noise_bits(seed, 0, NOISE_SELECT_CHAIN, 0) & mask(chain);
}

void flip_flop_chain_clock(struct flip_flop_chain *chain, bool data) {
    chain->selected = ((chain->selected << 1) | (data ? 0u : 1u)) & mask(chain);
}
