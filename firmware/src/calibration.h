/* What turns counts into vectors of the node frame, and what a ribbon must know of its place: the record that
 * protocol/schema.toml calls calibration. */
#ifndef CALIBRATION_H
#define CALIBRATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "ribbon.h"
#include "wire.h"

#define CALIBRATION_RECORD_BYTES                                                                             \
    (WIRE_CALIBRATION_MIN_BYTES + RIBBON_SLOT_COUNT * WIRE_SLOT_CALIBRATION_BYTES)

struct calibration {
    struct wire_calibration values;
    float blind[RIBBON_NODE_COUNT][3]; /* what a two-axis magnetometer does not measure: the direction of its
                                          z axis, a unit vector of the node frame */
    uint8_t record[CALIBRATION_RECORD_BYTES]; /* `values`, packed */
    uint32_t crc32;                           /* of `record` */
    uint32_t sequence;                        /* counts commits; 0: never calibrated */
};

/* The identity for every slot, the nominal pitch, a field of 48 uT that dips 62 degrees, two axes. */
void calibration_init(struct calibration *calibration);

/* Whether a record of CALIBRATION_RECORD_BYTES can be used here: layout, slot count, ranges, finite numbers.
 * *calibration serves as scratch memory and is as before on return. */
bool calibration_accepts(struct calibration *calibration, const uint8_t *record);

/* Takes a record into use; false, and nothing changes, if calibration_accepts() does not. */
bool calibration_use(struct calibration *calibration, const uint8_t *record, uint32_t sequence);

/* v_node = matrix * (v_part - offset), all in SI units. */
static inline void calibration_apply(const struct wire_slot_calibration *slot, const float v_part[3],
                                     float v_node[3]) {
    const float *const m = slot->matrix;
    const float x = v_part[0] - slot->offset[0];
    const float y = v_part[1] - slot->offset[1];
    const float z = v_part[2] - slot->offset[2];
    v_node[0] = m[0] * x + m[1] * y + m[2] * z;
    v_node[1] = m[3] * x + m[4] * y + m[5] * z;
    v_node[2] = m[6] * x + m[7] * y + m[8] * z;
}

/* The direction in the node frame of what the part reads along its z axis: the third column of its matrix, of
 * length 1; the node's z if that is zero. */
void calibration_blind_direction(const struct wire_slot_calibration *slot, float direction[3]);

#endif
