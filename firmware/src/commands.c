/* What the host asks for: COMMAND to ACK, CLOCK_PING to CLOCK_PONG. */
#include "commands.h"

#include <string.h>

#include "app_state.h"
#include "packets.h"

/* An ACK, and INFO after it. */
enum { ANSWERS_MAX = 2, ANSWER_BYTES_MAX = WIRE_ACK_MAX_BYTES + WIRE_INFO_MAX_BYTES };

/* Type, tag and command of a COMMAND: without them there is nothing to acknowledge. */
enum { ACKNOWLEDGED_BYTES = 4 };

/* Before the first scan at a new rate parts are told of it, and measurements under way end. */
static const uint32_t RATE_CHANGE_US = 20000u;

bool commands_have_room(const struct app *app) {
    return outbox_has_reply_room(&app->outbox, ANSWERS_MAX, ANSWER_BYTES_MAX);
}

static enum wire_ack_code set_rate(struct app *app, const struct wire_command *command,
                                   struct wire_ack *ack) {
    if (command->argument < WIRE_INFO_RATE_HZ_MIN || command->argument > RIBBON_RATE_MAX_HZ)
        return WIRE_ACK_CODE_BAD_ARGUMENT;
    sensor_string_set_rate(&app->string, app->board, command->argument);
    schedule_start(&app->schedule, command->argument, board_now_us(app->board) + RATE_CHANGE_US);
    app->is_started = false;
    ack->value = command->argument;
    return WIRE_ACK_CODE_OK;
}

static enum wire_ack_code set_mode(struct app *app, const struct wire_command *command,
                                   struct wire_ack *ack) {
    const uint32_t both = WIRE_MODE_ORIENT | WIRE_MODE_ORIENT_COMPACT;
    if ((command->argument & ~(both | WIRE_MODE_RAW)) != 0u || (command->argument & both) == both)
        return WIRE_ACK_CODE_BAD_ARGUMENT;
    app->mode = (uint8_t)command->argument;
    ack->value = app->mode;
    return WIRE_ACK_CODE_OK;
}

static enum wire_ack_code set_phase(struct app *app, const struct wire_command *command,
                                    struct wire_ack *ack) {
    /* Measurements under way serve the moved scan: one started now would be ignored by parts still busy,
     * though their coils were flipped already. */
    ack->value = (uint32_t)schedule_set_phase(&app->schedule, command->argument, board_now_us(app->board));
    return WIRE_ACK_CODE_OK;
}

static enum wire_ack_code identify(struct app *app, const struct wire_command *command) {
    if (command->argument > WIRE_IDENTIFY_MAX_MS)
        return WIRE_ACK_CODE_BAD_ARGUMENT;
    const uint32_t now_us = board_now_us(app->board);
    app->is_identifying = true;
    app->identify_end_us = now_us + command->argument * 1000u;
    app->blink_us = now_us;
    return WIRE_ACK_CODE_OK;
}

static enum wire_ack_code calibration_read(const struct app *app, const struct wire_command *command,
                                           struct wire_ack *ack) {
    ack->value = CALIBRATION_RECORD_BYTES;
    if (command->argument >= CALIBRATION_RECORD_BYTES)
        return WIRE_ACK_CODE_OK;
    const uint32_t left = CALIBRATION_RECORD_BYTES - command->argument;
    ack->data_count = (uint8_t)(left < WIRE_ACK_DATA_COUNT_MAX ? left : WIRE_ACK_DATA_COUNT_MAX);
    memcpy(ack->data, app->calibration.record + command->argument, ack->data_count);
    return WIRE_ACK_CODE_OK;
}

static enum wire_ack_code calibration_write(struct app *app, const struct wire_command *command,
                                            struct wire_ack *ack) {
    if (command->data_count == 0u || command->argument >= CALIBRATION_RECORD_BYTES ||
        command->data_count > CALIBRATION_RECORD_BYTES - command->argument)
        return WIRE_ACK_CODE_BAD_ARGUMENT;
    memcpy(app->staged_record + command->argument, command->data, command->data_count);
    ack->value = command->data_count;
    return WIRE_ACK_CODE_OK;
}

static enum wire_ack_code calibration_commit(struct app *app, const struct wire_command *command,
                                             struct wire_ack *ack) {
    struct calibration *const calibration = &app->calibration;
    const uint32_t sequence = calibration->sequence + 1u;
    if (framing_crc32(app->staged_record, CALIBRATION_RECORD_BYTES) != command->argument)
        return WIRE_ACK_CODE_BAD_CRC;
    if (!calibration_accepts(calibration, app->staged_record))
        return WIRE_ACK_CODE_BAD_ARGUMENT;
    /* A host repeats the command while the store is being written. */
    if (memcmp(app->staged_record, calibration->record, CALIBRATION_RECORD_BYTES) == 0) {
        ack->value = calibration->sequence;
        return WIRE_ACK_CODE_OK;
    }
    if (!calibration_store_save(&app->store, app->board, app->staged_record, sequence))
        return WIRE_ACK_CODE_STORAGE_FAILED;
    calibration_use(calibration, app->staged_record, sequence);
    app_use_calibration(app);
    ack->value = sequence;
    return WIRE_ACK_CODE_OK;
}

static enum wire_ack_code enter_dfu(struct app *app, const struct wire_command *command) {
    if (!board_has_dfu(app->board))
        return WIRE_ACK_CODE_UNSUPPORTED;
    if (command->argument != WIRE_ENTER_DFU_KEY)
        return WIRE_ACK_CODE_BAD_ARGUMENT;
    app->is_leaving = true;
    return WIRE_ACK_CODE_OK;
}

static enum wire_ack_code execute(struct app *app, const struct wire_command *command, struct wire_ack *ack) {
    switch (command->command) {
    case WIRE_COMMAND_CODE_GET_INFO:
    case WIRE_COMMAND_CODE_GET_STATUS:
        return WIRE_ACK_CODE_OK;
    case WIRE_COMMAND_CODE_SET_RATE:
        return set_rate(app, command, ack);
    case WIRE_COMMAND_CODE_SET_MODE:
        return set_mode(app, command, ack);
    case WIRE_COMMAND_CODE_SET_PHASE:
        return set_phase(app, command, ack);
    case WIRE_COMMAND_CODE_IDENTIFY:
        return identify(app, command);
    case WIRE_COMMAND_CODE_CALIBRATION_READ:
        return calibration_read(app, command, ack);
    case WIRE_COMMAND_CODE_CALIBRATION_WRITE:
        return calibration_write(app, command, ack);
    case WIRE_COMMAND_CODE_CALIBRATION_COMMIT:
        return calibration_commit(app, command, ack);
    case WIRE_COMMAND_CODE_ENTER_DFU:
        return enter_dfu(app, command);
    default:
        return WIRE_ACK_CODE_UNKNOWN_COMMAND;
    }
}

static void take_command(struct app *app, const uint8_t *packet, size_t n) {
    struct wire_command command = {.tag = 0u};
    struct wire_ack ack = {.value = 0u, .data_count = 0u};
    const int used = wire_command_unpack(packet, n, &command);
    if (n < ACKNOWLEDGED_BYTES) {
        app->rx_short++;
        return;
    }
    ack.tag = command.tag;
    ack.command = command.command;
    ack.code = (uint8_t)(used < 0 ? WIRE_ACK_CODE_BAD_LENGTH : execute(app, &command, &ack));

    uint8_t reply[WIRE_MAX_PACKET_BYTES];
    outbox_add_reply(&app->outbox, reply, wire_ack_pack(&ack, reply, sizeof reply));
    if (ack.code != WIRE_ACK_CODE_OK)
        return;
    if (command.command == WIRE_COMMAND_CODE_GET_INFO)
        outbox_add_reply(&app->outbox, reply, packets_info(app, reply));
    else if (command.command == WIRE_COMMAND_CODE_GET_STATUS)
        outbox_add_reply(&app->outbox, reply, packets_status(app, reply));
}

static void take_ping(struct app *app, const uint8_t *packet, size_t n, uint32_t t_us) {
    struct wire_clock_ping ping;
    if (wire_clock_ping_unpack(packet, n, &ping) < 0) {
        app->rx_short++;
        return;
    }
    const struct wire_clock_pong pong = {
        .tag = ping.tag,
        .t_host_us = ping.t_host_us,
        .t_receive_us = t_us,
        .t_transmit_us = t_us, /* set when it leaves */
    };
    uint8_t reply[WIRE_CLOCK_PONG_MAX_BYTES];
    outbox_add_reply(&app->outbox, reply, wire_clock_pong_pack(&pong, reply, sizeof reply));
}

void commands_take(struct app *app, const uint8_t *packet, size_t n, uint32_t t_us) {
    switch (packet[0]) {
    case WIRE_PACKET_COMMAND:
        take_command(app, packet, n);
        break;
    case WIRE_PACKET_CLOCK_PING:
        take_ping(app, packet, n, t_us);
        break;
    default:
        app->rx_unknown++;
        break;
    }
}
