/* The string of sensors: walks the select chain, reads all slots, and turns readings into vectors. */
#ifndef SENSOR_STRING_H
#define SENSOR_STRING_H

#include "board.h"
#include "calibration.h"
#include "drift.h"
#include "ribbon.h"
#include "slot.h"

struct sensor_string {
    struct slot slots[RIBBON_SLOT_COUNT];
    struct slot_setup setup;
    float reading[RIBBON_SLOT_COUNT][3];  /* of the last scan, calibrated: m/s^2 or uT, node frame */
    float previous[RIBBON_SLOT_COUNT][3]; /* of the scan before */
    bool has_previous[RIBBON_SLOT_COUNT];
    struct drift drifts[2]; /* of accelerometers and magnetometers */

    /* What follows from the states of all slots, up to date after every call. */
    uint32_t lead_us; /* the measurements must start so long before the scan; 0: nothing needs a start */
    uint32_t patrol_due_us; /* when the first slot has something to do in a patrol */
    bool is_flip_wanted;    /* some bridge is to be flipped before the next measurement */
    bool is_settled;        /* it is known of every slot if it is usable, or what is wrong with it */
};

/* Flushes the select chain; every slot is to be found and brought up. */
void sensor_string_init(struct sensor_string *string, struct board *board, uint32_t rate_hz);

/* Parts are configured for the new rate in the patrols that follow, and read all the while. */
void sensor_string_set_rate(struct sensor_string *string, struct board *board, uint32_t rate_hz);

/* Flips bridges where it is time to, and starts the measurements of all parts that wait for it, in two
 * passes. */
void sensor_string_start(struct sensor_string *string, struct board *board);

/* Reads all slots in one pass. Returns when that was done. */
uint32_t sensor_string_read(struct sensor_string *string, struct board *board);

/* Judges what was read at now_us and fills `reading`; slots[i].reason tells which are usable. */
void sensor_string_judge(struct sensor_string *string, const struct calibration *calibration,
                         uint32_t now_us);

/* Tells that readings are calibrated otherwise from now on. */
void sensor_string_recalibrated(struct sensor_string *string);

/* One pass for what slots have to do besides being read. */
void sensor_string_patrol(struct sensor_string *string, struct board *board);

/* What one count of a slot is, m/s^2 or uT, and the noise of its readings; 0 when absent. */
float sensor_string_lsb(const struct sensor_string *string, unsigned slot);
float sensor_string_noise(const struct sensor_string *string, unsigned slot);

/* How old the middle of a slot's sample is when the scan begins, microseconds. */
uint32_t sensor_string_age_us(const struct sensor_string *string, unsigned slot);

/* When the readings of a kind of sensor are taken, as RAW tells it. */
struct sensor_timing {
    uint16_t age_us;    /* at the end of a scan */
    uint16_t period_us; /* 0: measured when the scan asks for it */
    uint16_t span_us;
};

/* That of the first part found among the slots `first`, `first` + 2 ..., 0 for the accelerometers and 1 for
 * the magnetometers; all 0 if there is none. scan_us: how long the scan took. */
struct sensor_timing sensor_string_timing(const struct sensor_string *string, unsigned first,
                                          uint32_t scan_us);

#endif
