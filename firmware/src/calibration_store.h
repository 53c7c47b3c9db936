/* Where the calibration outlives a power cut: two areas of the board's store, written in turn.
 *
 * An area holds a header and a record. The header is written last and its CRC covers both, so that an area is
 * either whole or not there; the newer of two whole ones counts. */
#ifndef CALIBRATION_STORE_H
#define CALIBRATION_STORE_H

#include "board.h"
#include "calibration.h"

struct calibration_store {
    unsigned next_area; /* where the next commit goes: not the area that holds the record in use */
};

/* Takes the newest whole record into use; leaves *calibration as it is if there is none. `scratch` holds
 * CALIBRATION_RECORD_BYTES. */
void calibration_store_load(struct calibration_store *store, struct board *board,
                            struct calibration *calibration, uint8_t *scratch);

/* Stores a record that calibration_accepts(). False if the board could not; the record stored before is then
 * still whole. A power cut at any moment leaves that one or the new one. */
bool calibration_store_save(struct calibration_store *store, struct board *board, const uint8_t *record,
                            uint32_t sequence);

#endif
