/* Wires firmware, host board, sensor bus and truth together. */
#include "emulated_ribbon.h"

#include <stdlib.h>
#include <string.h>

#include "app.h"
#include "app_state.h" /* memory for an app is this file's to provide */
#include "port/host/host_board.h"

#define READ_CHUNK 1024u

struct emulated_ribbon {
    struct board board;
    struct app app;
    struct sensor_bus bus;
    uint8_t *sent; /* bytes that have left the device and were not read yet */
    size_t sent_count, sent_capacity;
    uint64_t lost; /* bytes that found no memory */
};

struct emulated_ribbon *emulated_ribbon_new(const struct emulated_ribbon_config *config,
                                            const struct truth_table *truth) {
    struct emulated_ribbon *ribbon = calloc(1, sizeof *ribbon);
    if (ribbon == NULL || config->baud == 0 || sensor_bus_init(&ribbon->bus, &config->bus, truth) != 0) {
        free(ribbon);
        return NULL;
    }
    host_board_init(&ribbon->board);
    ribbon->board.bus = (struct host_bus){
        .context = &ribbon->bus,
        .transfer = sensor_bus_transfer,
        .select_clock = sensor_bus_select_clock,
    };
    ribbon->board.identity.board = WIRE_BOARD_HOST;
    ribbon->board.identity.reset_cause = WIRE_RESET_CAUSE_POWER_ON;
    ribbon->board.identity.clock_source = WIRE_CLOCK_SOURCE_HOST;
    memcpy(ribbon->board.identity.unique_id, config->unique_id, sizeof config->unique_id);
    ribbon->board.clock_ratio = 1.0 + config->clock_ppm * 1e-6;
    ribbon->board.clock_offset_us = config->clock_offset_us;
    ribbon->board.baud = config->baud;
    ribbon->board.temperature_c = (float)config->bus.temperature.start_c;
    app_init(&ribbon->app, &ribbon->board);
    return ribbon;
}

void emulated_ribbon_free(struct emulated_ribbon *ribbon) {
    if (ribbon != NULL) {
        free(ribbon->sent);
        free(ribbon);
    }
}

/* A wire does not wait for a reader: bytes leave the board as time goes by. */
static void take_sent_bytes(struct emulated_ribbon *ribbon) {
    uint8_t bytes[READ_CHUNK];
    size_t n;
    while ((n = host_board_read(&ribbon->board, bytes, sizeof bytes)) > 0) {
        if (ribbon->sent_count + n > ribbon->sent_capacity) {
            size_t capacity = 2u * ribbon->sent_capacity + READ_CHUNK;
            uint8_t *larger = realloc(ribbon->sent, capacity);
            if (larger == NULL) {
                ribbon->lost += n;
                continue;
            }
            ribbon->sent = larger;
            ribbon->sent_capacity = capacity;
        }
        memcpy(ribbon->sent + ribbon->sent_count, bytes, n);
        ribbon->sent_count += n;
    }
}

void emulated_ribbon_run_until(struct emulated_ribbon *ribbon, uint64_t t_ns) {
    ribbon->board.horizon_ns = t_ns;
    while (ribbon->board.t_ns < t_ns || (ribbon->board.t_ns == t_ns && ribbon->board.wake_ns <= t_ns)) {
        take_sent_bytes(ribbon);
        app_poll(&ribbon->app);
    }
    if (ribbon->board.t_ns == t_ns) {
        take_sent_bytes(ribbon);
    }
}

uint64_t emulated_ribbon_now_ns(const struct emulated_ribbon *ribbon) {
    return ribbon->board.t_ns;
}

uint64_t emulated_ribbon_next_event_ns(const struct emulated_ribbon *ribbon) {
    const struct board *board = &ribbon->board;
    return board->t_ns > board->horizon_ns ? board->t_ns : board->wake_ns;
}

bool emulated_ribbon_is_sending(struct emulated_ribbon *ribbon) {
    return board_link_sending(&ribbon->board);
}

size_t emulated_ribbon_write(struct emulated_ribbon *ribbon, const uint8_t *bytes, size_t n) {
    return host_board_write(&ribbon->board, bytes, n);
}

size_t emulated_ribbon_read(struct emulated_ribbon *ribbon, uint8_t *bytes, size_t capacity) {
    size_t n = ribbon->sent_count < capacity ? ribbon->sent_count : capacity;
    if (n > 0) {
        memcpy(bytes, ribbon->sent, n);
        ribbon->sent_count -= n;
        memmove(ribbon->sent, ribbon->sent + n, ribbon->sent_count);
    }
    return n;
}

uint64_t emulated_ribbon_lost(const struct emulated_ribbon *ribbon) {
    return ribbon->lost;
}

uint32_t emulated_ribbon_device_us(struct emulated_ribbon *ribbon) {
    return board_now_us(&ribbon->board);
}

struct sensor_bus *emulated_ribbon_bus(struct emulated_ribbon *ribbon) {
    return &ribbon->bus;
}
