/* Random numbers as a function of where they are used: nothing is stored, any order gives the same noise. */
#ifndef NOISE_H
#define NOISE_H

#include <stdint.h>

/* What a number is for, so that no two uses share one. */
enum noise_use {
    NOISE_SAMPLE,
    NOISE_OSCILLATOR,
    NOISE_PHASE,
    NOISE_OFFSET,
    NOISE_POLARITY,
    NOISE_SELECT_CHAIN,
    NOISE_GARBAGE,
    NOISE_CONTACT,
    NOISE_BIT_FLIP,
};

/* 64 random bits for the counter-th use of this kind in this slot. */
uint64_t noise_bits(uint64_t seed, uint32_t slot, enum noise_use use, uint64_t counter);

/* The same as a number in [0, 1). */
double noise_uniform(uint64_t seed, uint32_t slot, enum noise_use use, uint64_t counter);

/* Three independent normal numbers of variance 1. */
void noise_normal(uint64_t seed, uint32_t slot, enum noise_use use, uint64_t counter, double out[3]);

#endif
