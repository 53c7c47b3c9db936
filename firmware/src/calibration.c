/* What turns counts into vectors of the node frame, and what a ribbon must know of its place. */
#include "calibration.h"

#include <math.h>
#include <string.h>

#include "framing.h"
#include "vec3.h"

/* Dip 62 degrees. */
static const float FIELD_HORIZONTAL_UT = 22.53f;
static const float FIELD_DOWN_UT = 42.38f;

static bool is_within(float value, float low, float high) {
    return value >= low && value <= high; /* false for NaN */
}

static bool is_usable(const struct wire_calibration *values) {
    if (values->layout != WIRE_CALIBRATION_LAYOUT || values->slot_count != RIBBON_SLOT_COUNT ||
        values->mag_axes < WIRE_CALIBRATION_MAG_AXES_MIN || values->mag_axes > WIRE_CALIBRATION_MAG_AXES_MAX)
        return false;
    if (!is_within(values->pitch_m, WIRE_CALIBRATION_PITCH_M_MIN, WIRE_CALIBRATION_PITCH_M_MAX) ||
        !is_within(values->field_horizontal_ut, WIRE_CALIBRATION_FIELD_HORIZONTAL_UT_MIN,
                   WIRE_CALIBRATION_FIELD_HORIZONTAL_UT_MAX) ||
        !is_within(values->field_down_ut, WIRE_CALIBRATION_FIELD_DOWN_UT_MIN,
                   WIRE_CALIBRATION_FIELD_DOWN_UT_MAX))
        return false;
    for (unsigned i = 0; i < RIBBON_SLOT_COUNT; i++) {
        const struct wire_slot_calibration *const slot = &values->slots[i];
        for (unsigned j = 0; j < 3u; j++)
            if (!isfinite(slot->offset[j]))
                return false;
        for (unsigned j = 0; j < 9u; j++)
            if (!isfinite(slot->matrix[j]))
                return false;
    }
    return true;
}

static void take_record(struct calibration *calibration, const uint8_t *record, uint32_t sequence) {
    memmove(calibration->record, record, CALIBRATION_RECORD_BYTES);
    calibration->crc32 = framing_crc32(calibration->record, CALIBRATION_RECORD_BYTES);
    calibration->sequence = sequence;
    for (unsigned k = 0; k < RIBBON_NODE_COUNT; k++)
        calibration_blind_direction(&calibration->values.slots[2u * k + 1u], calibration->blind[k]);
}

void calibration_init(struct calibration *calibration) {
    struct wire_calibration *const values = &calibration->values;
    memset(calibration, 0, sizeof *calibration);
    values->layout = WIRE_CALIBRATION_LAYOUT;
    values->mag_axes = RIBBON_MAG_AXES;
    values->slot_count = RIBBON_SLOT_COUNT;
    values->pitch_m = RIBBON_PITCH_M;
    values->field_horizontal_ut = FIELD_HORIZONTAL_UT;
    values->field_down_ut = FIELD_DOWN_UT;
    for (unsigned i = 0; i < RIBBON_SLOT_COUNT; i++)
        for (unsigned j = 0; j < 3u; j++)
            values->slots[i].matrix[4u * j] = 1.0f;
    wire_calibration_pack(values, calibration->record, CALIBRATION_RECORD_BYTES);
    take_record(calibration, calibration->record, 0u);
}

static bool unpack(struct calibration *calibration, const uint8_t *record) {
    const int size = wire_calibration_unpack(record, CALIBRATION_RECORD_BYTES, &calibration->values);
    return size == (int)CALIBRATION_RECORD_BYTES && is_usable(&calibration->values);
}

bool calibration_accepts(struct calibration *calibration, const uint8_t *record) {
    const bool is_accepted = unpack(calibration, record);
    unpack(calibration, calibration->record);
    return is_accepted;
}

bool calibration_use(struct calibration *calibration, const uint8_t *record, uint32_t sequence) {
    if (unpack(calibration, record)) {
        take_record(calibration, record, sequence);
        return true;
    }
    unpack(calibration, calibration->record);
    return false;
}

void calibration_blind_direction(const struct wire_slot_calibration *slot, float direction[3]) {
    for (unsigned row = 0; row < 3u; row++)
        direction[row] = slot->matrix[3u * row + 2u];
    if (!vec3_normalise(direction)) {
        direction[0] = direction[1] = 0.0f;
        direction[2] = 1.0f;
    }
}
