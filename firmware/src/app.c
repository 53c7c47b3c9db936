/* The application: one loop that scans, fuses, packs and answers. */
#include <string.h>

#include "app_state.h"
#include "commands.h"
#include "packets.h"

static const uint32_t US_PER_S = 1000000u;
static const uint32_t BLINK_US = 125000u;

/* INFO, the first packet, waits until it can say which parts there are; so does everything else. */
static const uint32_t ANNOUNCE_US = 200000u;

/* A patrol must be over before the next step of a scan. */
static const uint32_t PATROL_US = 1500u;
/* While parts are brought up, patrols follow each other so fast. */
static const uint32_t PATROL_INTERVAL_US = 2000u;

void app_use_calibration(struct app *app) {
    const struct wire_calibration *const values = &app->calibration.values;
    app->fusion_params.field_horizontal_ut = values->field_horizontal_ut;
    app->fusion_params.field_down_ut = values->field_down_ut;
    app->fusion_params.has_two_axes = values->mag_axes == 2u;
    memcpy(app->fusion_params.blind, app->calibration.blind, sizeof app->fusion_params.blind);
    fusion_reset(&app->fusion_params, &app->fusion_state, &app->fusion_derived);
    health_reset(&app->health);
    sensor_string_recalibrated(&app->string);
}

void app_init(struct app *app, struct board *board) {
    memset(app, 0, sizeof *app);
    app->board = board;
    board_identify(board, &app->identity);
    calibration_init(&app->calibration);
    calibration_store_load(&app->store, board, &app->calibration, app->staged_record);
    memcpy(app->staged_record, app->calibration.record, sizeof app->staged_record);
    fusion_params_default(&app->fusion_params);
    app_use_calibration(app);
    outbox_init(&app->outbox);
    framing_reader_init(&app->reader);
    app->mode = WIRE_MODE_ORIENT;

    sensor_string_init(&app->string, board, RIBBON_RATE_HZ);
    const uint32_t now_us = board_now_us(board);
    schedule_start(&app->schedule, RIBBON_RATE_HZ, now_us + US_PER_S / RIBBON_RATE_HZ);
    app->last_scan_us = now_us;
    app->announce_us = now_us + ANNOUNCE_US;
    app->second_us = now_us + US_PER_S;
    app->patrol_us = now_us;
}

static void send_stream(struct app *app, uint32_t t_us) {
    uint8_t packet[WIRE_MAX_PACKET_BYTES];
    if ((app->mode & WIRE_MODE_ORIENT) != 0u)
        outbox_add_stream(&app->outbox, packet, packets_orient(app, t_us, packet));
    if ((app->mode & WIRE_MODE_ORIENT_COMPACT) != 0u)
        outbox_add_stream(&app->outbox, packet, packets_orient_compact(app, t_us, packet));
    if ((app->mode & WIRE_MODE_RAW) != 0u)
        outbox_add_stream(&app->outbox, packet, packets_raw(app, t_us, packet));
}

static void fill_fusion_input(struct app *app, float dt_s) {
    struct fusion_input *const input = &app->fusion_input;
    const struct sensor_string *const string = &app->string;
    input->dt_s = dt_s;
    for (unsigned k = 0; k < RIBBON_NODE_COUNT; k++) {
        const unsigned accel = 2u * k;
        const unsigned mag = 2u * k + 1u;
        memcpy(input->accel_mps2[k], string->reading[accel], sizeof input->accel_mps2[k]);
        memcpy(input->field_ut[k], string->reading[mag], sizeof input->field_ut[k]);
        input->accel_valid[k] = string->slots[accel].reason == WIRE_SLOT_REASON_OK;
        input->field_valid[k] = string->slots[mag].reason == WIRE_SLOT_REASON_OK;
        input->field_implausible[k] = !input->field_valid[k] && string->slots[mag].is_implausible;
        input->accel_age_s[k] = 1e-6f * (float)(sensor_string_age_us(string, accel) + app->scan_us / 2u);
        input->field_age_s[k] = 1e-6f * (float)(sensor_string_age_us(string, mag) + app->scan_us / 2u);
        input->accel_noise_mps2[k] = sensor_string_noise(string, accel);
        input->field_noise_ut[k] = sensor_string_noise(string, mag);
    }
}

static void scan(struct app *app) {
    const uint32_t start_us = board_now_us(app->board);
    const uint32_t t_us = sensor_string_read(&app->string, app->board);
    /* Judging takes longer at times, which must not move the time that the readings are of. */
    sensor_string_judge(&app->string, &app->calibration, t_us);
    const uint32_t scan_us = t_us - start_us;
    app->scan_us = scan_us < UINT16_MAX ? (uint16_t)scan_us : UINT16_MAX;

    fill_fusion_input(app, (float)(t_us - app->last_scan_us) / (float)US_PER_S);
    app->last_scan_us = t_us;
    fusion_update(&app->fusion_params, &app->fusion_state, &app->fusion_derived, &app->fusion_input,
                  app->nodes);
    health_watch(&app->health, &app->fusion_params, &app->fusion_state, &app->fusion_input,
                 app->fusion_derived.field_ut);
    app->scans++;
    if (app->is_announced) {
        send_stream(app, t_us);
        app->sequence++;
    }
    app->is_started = false;
    app->overruns += schedule_advance(&app->schedule, board_now_us(app->board));
}

static void receive(struct app *app) {
    uint8_t byte;
    while (commands_have_room(app) && board_link_read(app->board, &byte, 1u) == 1u) {
        const uint8_t *packet;
        const size_t n = framing_read_byte(&app->reader, byte, &packet);
        if (n > 0u)
            commands_take(app, packet, n, board_now_us(app->board));
    }
}

/* The time at which a CLOCK_PONG leaves is known only now. */
static size_t stamp(struct app *app, uint8_t *packet, size_t n) {
    struct wire_clock_pong pong;
    if (packet[0] != WIRE_PACKET_CLOCK_PONG || wire_clock_pong_unpack(packet, n, &pong) < 0)
        return n;
    pong.t_transmit_us = board_now_us(app->board);
    return wire_clock_pong_pack(&pong, packet, n);
}

static void send(struct app *app) {
    if (board_link_sending(app->board))
        return;
    if (app->is_leaving && !outbox_has_reply(&app->outbox)) {
        app->is_leaving = false;
        board_enter_dfu(app->board);
    }
    uint8_t packet[WIRE_MAX_PACKET_BYTES];
    size_t n = outbox_take(&app->outbox, packet, sizeof packet);
    if (n == 0u)
        return;
    n = framing_encode(packet, stamp(app, packet, n), app->frame, sizeof app->frame);
    board_link_send(app->board, app->frame, n);
}

static void announce(struct app *app, uint32_t now_us) {
    if (!app->string.is_settled && !schedule_is_past(app->announce_us, now_us))
        return;
    uint8_t packet[WIRE_MAX_PACKET_BYTES];
    app->is_announced = true;
    outbox_add_reply(&app->outbox, packet, packets_info(app, packet));
}

static void count_second(struct app *app) {
    app->second_us += US_PER_S;
    app->uptime_s++;
    uint8_t packet[WIRE_MAX_PACKET_BYTES];
    if (app->is_announced)
        outbox_add_reply(&app->outbox, packet, packets_status(app, packet));
}

static void blink(struct app *app, uint32_t now_us) {
    if (schedule_is_past(app->identify_end_us, now_us)) {
        app->is_identifying = false;
        app->is_led_on = false;
    } else if (schedule_is_past(app->blink_us, now_us)) {
        app->blink_us = now_us + BLINK_US;
        app->is_led_on = !app->is_led_on;
    }
    board_led(app->board, app->is_led_on);
}

/* When the next step of a scan is due. */
static uint32_t next_step_us(const struct app *app) {
    return app->is_started ? app->schedule.next_us : app->schedule.next_us - app->string.lead_us;
}

static uint32_t earlier(uint32_t a_us, uint32_t b_us) {
    return schedule_is_past(a_us, b_us) ? a_us : b_us;
}

/* When the next patrol is due, and whether it would be over before the next step of the scan. */
static bool find_patrol(const struct app *app, uint32_t now_us, uint32_t *due_us) {
    *due_us = app->string.patrol_due_us;
    if (!schedule_is_past(app->patrol_us, *due_us))
        *due_us = app->patrol_us;
    const uint32_t start_us = schedule_is_past(*due_us, now_us) ? now_us : *due_us;
    return !schedule_is_past(next_step_us(app), start_us + PATROL_US);
}

/* A scan that leaves no time for patrols is followed by one all the same. */
static void patrol(struct app *app, bool has_scanned, uint32_t now_us) {
    uint32_t due_us;
    const bool has_time = find_patrol(app, now_us, &due_us);
    if (!schedule_is_past(due_us, now_us) || !(has_time || has_scanned))
        return;
    sensor_string_patrol(&app->string, app->board);
    app->patrol_us = board_now_us(app->board) + PATROL_INTERVAL_US;
}

static void wait(struct app *app) {
    uint32_t patrol_us;
    uint32_t wake_us = earlier(next_step_us(app), app->second_us);
    if (app->is_identifying)
        wake_us = earlier(wake_us, app->blink_us);
    if (find_patrol(app, board_now_us(app->board), &patrol_us))
        wake_us = earlier(wake_us, patrol_us);
    board_wait_until(app->board, wake_us);
}

void app_poll(struct app *app) {
    board_made_progress(app->board);
    if (app->is_announced)
        receive(app);

    bool has_scanned = false;
    if (schedule_is_past(next_step_us(app), board_now_us(app->board))) {
        if (!app->is_started) {
            sensor_string_start(&app->string, app->board);
            app->is_started = true;
        } else {
            scan(app);
            has_scanned = true;
        }
    }

    const uint32_t now_us = board_now_us(app->board);
    if (!app->is_announced)
        announce(app, now_us);
    if (schedule_is_past(app->second_us, now_us))
        count_second(app);
    if (app->is_identifying)
        blink(app, now_us);
    patrol(app, has_scanned, now_us);
    send(app);
    wait(app);
}
