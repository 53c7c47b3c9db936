/* The packets that tell what the application knows. */
#include "packets.h"

#include <string.h>

#include "app_state.h"

enum { ALL_AXES = WIRE_AXES_X | WIRE_AXES_Y | WIRE_AXES_Z };

static void describe_slot(const struct app *app, unsigned i, struct wire_slot_info *info) {
    const struct part *const part = slot_part(&app->string.slots[i]);
    *info = (struct wire_slot_info){.part = WIRE_PART_NONE};
    if (part == NULL)
        return;
    const bool has_z = part->kind == PART_ACCELEROMETER || app->calibration.values.mag_axes == 3u;
    info->part = (uint8_t)part->id;
    info->axes = (uint8_t)(has_z ? ALL_AXES : ALL_AXES & ~WIRE_AXES_Z);
    info->lsb = sensor_string_lsb(&app->string, i);
}

size_t packets_info(const struct app *app, uint8_t *packet) {
    struct wire_info info = {
        .wire_version = WIRE_VERSION,
        .oldest_host_version = WIRE_OLDEST_HOST_VERSION,
        .schema_hash = WIRE_SCHEMA_HASH,
        .firmware_version = {FIRMWARE_VERSION_MAJOR, FIRMWARE_VERSION_MINOR, FIRMWARE_VERSION_PATCH},
        .board = (uint8_t)app->identity.board,
        .pitch_m = app->calibration.values.pitch_m,
        .rate_hz = (uint16_t)app->schedule.rate_hz,
        .rate_max_hz = RIBBON_RATE_MAX_HZ,
        .mode = app->mode,
        .calibration_sequence = app->calibration.sequence,
        .calibration_crc32 = app->calibration.crc32,
        .node_count = RIBBON_NODE_COUNT,
        .slot_count = RIBBON_SLOT_COUNT,
    };
    memcpy(info.unique_id, app->identity.unique_id, sizeof info.unique_id);
    for (unsigned i = 0; i < RIBBON_SLOT_COUNT; i++)
        describe_slot(app, i, &info.slots[i]);
    return wire_info_pack(&info, packet, WIRE_MAX_PACKET_BYTES);
}

size_t packets_status(const struct app *app, uint8_t *packet) {
    struct wire_status status = {
        .t_us = board_now_us(app->board),
        .uptime_s = app->uptime_s,
        .scans = app->scans,
        .overruns = app->overruns,
        .frames_dropped = app->outbox.dropped,
        .rx_crc_errors = app->reader.crc_errors,
        .rx_malformed = app->reader.malformed + app->rx_short,
        .rx_unknown = app->rx_unknown,
        .scan_us = app->scan_us,
        .rate_hz = (uint16_t)app->schedule.rate_hz,
        .mode = app->mode,
        .reset_cause = (uint8_t)app->identity.reset_cause,
        .clock_source = (uint8_t)app->identity.clock_source,
        .temperature_c = board_temperature_c(app->board),
        .fault_pc = app->identity.fault_pc,
        .fault_lr = app->identity.fault_lr,
        .fault_cfsr = app->identity.fault_cfsr,
        .slot_count = RIBBON_SLOT_COUNT,
    };
    for (unsigned i = 0; i < RIBBON_SLOT_COUNT; i++)
        status.slots[i] = (struct wire_slot_status){
            .reason = app->string.slots[i].reason,
            .errors = app->string.slots[i].errors,
        };
    status.health_count = RIBBON_SLOT_COUNT;
    for (unsigned i = 0; i < RIBBON_SLOT_COUNT; i++)
        status.health[i] = (struct wire_slot_health){
            .misfit = app->health.misfit[i],
            .length_permille =
                health_length_permille(&app->health, &app->fusion_params, app->fusion_derived.field_ut, i),
        };
    return wire_status_pack(&status, packet, WIRE_MAX_PACKET_BYTES);
}

static uint8_t quality_of(const struct fusion_node *node) {
    return (uint8_t)(node->flags | wire_sigma_code(node->sigma_rad));
}

size_t packets_orient(const struct app *app, uint32_t t_us, uint8_t *packet) {
    struct wire_orient
        orient; /* only the nodes that there are get values: clearing the others takes its time */
    orient.t_us = t_us;
    orient.sequence = app->sequence;
    orient.node_count = RIBBON_NODE_COUNT;
    for (unsigned k = 0; k < RIBBON_NODE_COUNT; k++) {
        const struct fusion_node *const node = &app->nodes[k];
        memcpy(orient.nodes[k].q_world_node, node->q_world_node, sizeof node->q_world_node);
        orient.nodes[k].q_world_node_valid = node->valid;
        orient.nodes[k].quality = quality_of(node);
    }
    return wire_orient_pack(&orient, packet, WIRE_MAX_PACKET_BYTES);
}

size_t packets_orient_compact(const struct app *app, uint32_t t_us, uint8_t *packet) {
    struct wire_orient_compact orient = {
        .t_us = t_us, .sequence = app->sequence, .node_count = RIBBON_NODE_COUNT};
    for (unsigned k = 0; k < RIBBON_NODE_COUNT; k++) {
        const struct fusion_node *const node = &app->nodes[k];
        memcpy(orient.nodes[k].q_world_node, node->q_world_node, sizeof node->q_world_node);
        orient.nodes[k].q_world_node_valid = node->valid;
        orient.nodes[k].quality = quality_of(node);
    }
    return wire_orient_compact_pack(&orient, packet, WIRE_MAX_PACKET_BYTES);
}

size_t packets_raw(const struct app *app, uint32_t t_us, uint8_t *packet) {
    const struct sensor_timing accel_timing = sensor_string_timing(&app->string, 0u, app->scan_us);
    const struct sensor_timing mag_timing = sensor_string_timing(&app->string, 1u, app->scan_us);
    struct wire_raw raw = {
        .t_us = t_us,
        .sequence = app->sequence,
        .accel_count = RIBBON_NODE_COUNT,
        .mag_count = RIBBON_NODE_COUNT,
        .accel_age_us = accel_timing.age_us,
        .accel_period_us = accel_timing.period_us,
        .accel_span_us = accel_timing.span_us,
        .mag_age_us = mag_timing.age_us,
        .mag_period_us = mag_timing.period_us,
        .mag_span_us = mag_timing.span_us,
    };
    for (unsigned k = 0; k < RIBBON_NODE_COUNT; k++) {
        const struct slot *const accel = &app->string.slots[2u * k];
        const struct slot *const mag = &app->string.slots[2u * k + 1u];
        raw.accels[k].reason = accel->reason;
        raw.mags[k].reason = mag->reason;
        for (unsigned axis = 0; axis < 3u; axis++) {
            raw.accels[k].counts[axis] = (int16_t)slot_reading(accel)[axis];
            raw.mags[k].counts[axis] = slot_reading(mag)[axis];
        }
    }
    return wire_raw_pack(&raw, packet, WIRE_MAX_PACKET_BYTES);
}
