/* Counter-based random numbers: two rounds of the finaliser of SplitMix64 (Steele, Lea, Flood 2014) over the
 * key. */
#include "noise.h"

#include <math.h>

#define GOLDEN_GAMMA 0x9E3779B97F4A7C15u
#define TWO_PI       6.283185307179586

static uint64_t mixed(uint64_t z) {
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

uint64_t noise_bits(uint64_t seed, uint32_t slot, enum noise_use use, uint64_t counter) {
    uint64_t stream = mixed(seed + GOLDEN_GAMMA * (((uint64_t)slot << 8) + (uint64_t)use + 1u));
    return mixed(stream + GOLDEN_GAMMA * (counter + 1u));
}

double noise_uniform(uint64_t seed, uint32_t slot, enum noise_use use, uint64_t counter) {
    return (double)(noise_bits(seed, slot, use, counter) >> 11) * 0x1p-53;
}

void noise_normal(uint64_t seed, uint32_t slot, enum noise_use use, uint64_t counter, double out[3]) {
    double pair[4];
    for (int i = 0; i < 4; i += 2) {
        /* Box and Muller; 1 - u keeps the logarithm finite. */
        double radius = sqrt(-2.0 * log(1.0 - noise_uniform(seed, slot, use, 4u * counter + (uint64_t)i)));
        double angle = TWO_PI * noise_uniform(seed, slot, use, 4u * counter + (uint64_t)i + 1u);
        pair[i] = radius * cos(angle);
        pair[i + 1] = radius * sin(angle);
    }
    for (int i = 0; i < 3; i++) {
        out[i] = pair[i];
    }
}
