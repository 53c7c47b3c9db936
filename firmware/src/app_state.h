/* The memory of the application, for those who provide it (start.c of a port, the emulator). */
#ifndef APP_STATE_H
#define APP_STATE_H

#include "app.h"
#include "calibration.h"
#include "calibration_store.h"
#include "framing.h"
#include "fusion.h"
#include "health.h"
#include "outbox.h"
#include "schedule.h"
#include "sensor_string.h"

struct app {
    struct board *board;
    struct board_identity identity;
    struct sensor_string string;
    struct calibration calibration;
    struct calibration_store store;
    uint8_t staged_record[CALIBRATION_RECORD_BYTES]; /* what calibration_write fills and calibration_commit
                                                        takes */
    struct fusion_params fusion_params;
    struct fusion_state fusion_state;
    struct fusion_derived fusion_derived;
    struct fusion_input fusion_input;
    struct fusion_node nodes[RIBBON_NODE_COUNT];
    struct health health;
    struct outbox outbox;
    struct framing_reader reader;
    uint8_t frame[FRAMING_MAX_FRAME_BYTES]; /* being sent: must not change until the board is done with it */

    struct schedule schedule;
    bool is_started;       /* the measurements for the next scan */
    uint32_t last_scan_us; /* end of it */
    uint32_t patrol_us;    /* no patrol before */
    uint16_t sequence;     /* of the next scan */
    uint8_t mode;          /* enum wire_mode */

    bool is_announced;    /* INFO was sent */
    uint32_t announce_us; /* when it is sent at the latest */
    uint32_t second_us;   /* when uptime_s counts next */
    bool is_identifying;
    bool is_led_on;
    uint32_t identify_end_us;
    uint32_t blink_us; /* when the LED changes next */
    bool is_leaving;   /* for the boot loader, when the replies are out */

    uint32_t uptime_s;
    uint32_t scans;
    uint32_t overruns;
    uint32_t rx_unknown; /* packets of a type that is not known */
    uint32_t rx_short;   /* packets too short to be answered */
    uint16_t scan_us;
};

/* Takes the calibration in use into the fusion. */
void app_use_calibration(struct app *app);

#endif
