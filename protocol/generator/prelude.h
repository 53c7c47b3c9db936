/* What every codec needs whatever the schema says; generate.py copies it into wire.h. */

static inline uint8_t *wire_put_u8(uint8_t *out, uint8_t value) {
    out[0] = value;
    return out + 1;
}

static inline uint8_t *wire_put_u16(uint8_t *out, uint16_t value) {
    out[0] = (uint8_t)value;
    out[1] = (uint8_t)(value >> 8);
    return out + 2;
}

static inline uint8_t *wire_put_u32(uint8_t *out, uint32_t value) {
    out = wire_put_u16(out, (uint16_t)value);
    return wire_put_u16(out, (uint16_t)(value >> 16));
}

static inline uint8_t *wire_put_u64(uint8_t *out, uint64_t value) {
    out = wire_put_u32(out, (uint32_t)value);
    return wire_put_u32(out, (uint32_t)(value >> 32));
}

static inline uint8_t *wire_put_i24(uint8_t *out, int32_t value) {
    const int32_t limit = 0x7FFFFF;
    const uint32_t bits = (uint32_t)(value > limit ? limit : value < -limit - 1 ? -limit - 1 : value);
    out = wire_put_u16(out, (uint16_t)bits);
    return wire_put_u8(out, (uint8_t)(bits >> 16));
}

static inline uint8_t *wire_put_f32(uint8_t *out, float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return wire_put_u32(out, bits);
}

static inline uint8_t *wire_put_bytes(uint8_t *out, const uint8_t *bytes, size_t n) {
    memcpy(out, bytes, n);
    return out + n;
}

/* `value` in steps of `scale`, rounded half away from zero and kept within low ... high; NaN: `invalid`. */
static inline int32_t wire_scaled(float value, float scale, int32_t low, int32_t high, int32_t invalid) {
    const float steps = value / scale;
    if (isnan(steps))
        return invalid;
    if (steps <= (float)low)
        return low;
    if (steps >= (float)high)
        return high;
    return (int32_t)(steps < 0.0f ? steps - 0.5f : steps + 0.5f);
}

/* What is left of a packet being read; past its end everything reads as zero. */
struct wire_reader {
    const uint8_t *at;
    size_t left;
    bool truncated;
};

static inline uint32_t wire_get(struct wire_reader *reader, unsigned bytes) {
    uint32_t value = 0;
    if (reader->left < bytes) {
        reader->truncated = true;
        reader->left = 0;
        return 0;
    }
    for (unsigned i = 0; i < bytes; i++)
        value |= (uint32_t)reader->at[i] << (8 * i);
    reader->at += bytes;
    reader->left -= bytes;
    return value;
}

static inline uint64_t wire_get_u64(struct wire_reader *reader) {
    const uint64_t low = wire_get(reader, 4);
    return low | (uint64_t)wire_get(reader, 4) << 32;
}

/* Two's complement number of so many bytes. */
static inline int32_t wire_get_signed(struct wire_reader *reader, unsigned bytes) {
    const uint32_t sign = 1u << (8 * bytes - 1);
    return (int32_t)((wire_get(reader, bytes) ^ sign) - sign);
}

static inline float wire_get_f32(struct wire_reader *reader) {
    const uint32_t bits = wire_get(reader, 4);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static inline void wire_get_bytes(struct wire_reader *reader, uint8_t *bytes, size_t n) {
    for (size_t i = 0; i < n; i++)
        bytes[i] = (uint8_t)wire_get(reader, 1);
}

/* Index of the component of q of largest magnitude, and the codes of the other three: c of the normalised q
 * as levels + c * sqrt(2) * levels, rounded. False if q cannot be normalised.
 *
 * Errors e of the three, in steps, cost s = v . e in the largest, v being their ratios to it: the rotation is
 * wrong by an angle proportional to sqrt(e . e + s * s), at worst 1.73 when each is rounded to nearest.
 * Rounding one of them the other way where that lowers the sum makes it 1, the least that any choice of
 * codes can reach. A code at the end of its range never leaves it: the other two ratios, and with them
 * s, are next to zero then. */
static inline bool wire_smallest_three(const float q[4], float levels, uint32_t *index, uint32_t codes[3]) {
    const float norm2 = (q[0] * q[0] + q[1] * q[1]) + (q[2] * q[2] + q[3] * q[3]);
    if (!(norm2 >= FLT_MIN && norm2 <= FLT_MAX))
        return false;
    static const uint8_t others[4][3] = {{1, 2, 3}, {0, 2, 3}, {0, 1, 3}, {0, 1, 2}};
    unsigned largest = 0;
    for (unsigned i = 1; i < 4; i++)
        if (fabsf(q[i]) > fabsf(q[largest]))
            largest = i;
    const float steps = levels * 1.41421356f / sqrtf(norm2);
    const float scale = q[largest] < 0.0f ? -steps : steps;
    const float inverse = 1.0f / (q[largest] * scale);

    float error[3], ratio[3], s = 0.0f;
    for (unsigned k = 0; k < 3; k++) {
        const float x = q[others[largest][k]] * scale;
        codes[k] = (uint32_t)(x + (levels + 0.5f));
        error[k] = ((float)codes[k] - levels) - x;
        ratio[k] = x * inverse;
        s += ratio[k] * error[k];
    }
    unsigned best = 3;
    float least = 0.0f;
    for (unsigned k = 0; k < 3; k++) {
        const float step = error[k] < 0.0f ? -1.0f : 1.0f;
        const float change = (1.0f - 2.0f * fabsf(error[k])) + ratio[k] * (ratio[k] - 2.0f * s * step);
        if (change < least) {
            least = change;
            best = k;
        }
    }
    if (best < 3)
        codes[best] = error[best] < 0.0f ? codes[best] + 1 : codes[best] - 1;
    *index = largest;
    return true;
}

/* The inverse, of unit length. False, and q NaN, if the three are longer than 1. */
static inline bool wire_smallest_three_inverse(uint32_t index, const uint32_t codes[3], int32_t levels,
                                               float q[4]) {
    const float step = 0.707106781f / (float)levels;
    const int32_t whole = 2 * levels * levels; /* 1, squared, in steps */
    int32_t rest = whole;
    for (unsigned i = 0, k = 0; i < 4; i++)
        if (i != index) {
            const int32_t steps = (int32_t)codes[k++] - levels;
            rest -= steps * steps;
            q[i] = (float)steps * step;
        }
    if (rest < 0) {
        q[0] = q[1] = q[2] = q[3] = NAN;
        return false;
    }
    q[index] = sqrtf((float)rest / (float)whole);
    return true;
}
