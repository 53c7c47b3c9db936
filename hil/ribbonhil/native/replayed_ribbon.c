/* The firmware on the host board, made to live through what another build of it was seen to live through. */
#include "replayed_ribbon.h"

#include <stdlib.h>
#include <string.h>

#include "app.h"
#include "app_state.h" /* memory for an app is this file's to provide */
#include "port/host/host_board.h"

#define READ_CHUNK    1024u
#define LAST_BYTES_NS 1000000000u

struct replayed_ribbon {
    struct board board;
    struct app app;
    const struct logged_event *events;
    size_t count, next;
    bool is_over; /* the events are used up, or the firmware did something else */
    uint32_t looked_us;
    uint8_t *sent;
    size_t sent_count, sent_capacity;
};

/* What comes from the link between two things that the firmware does is there when it looks for it next. */
static void receive(struct replayed_ribbon *ribbon) {
    while (ribbon->next < ribbon->count && ribbon->events[ribbon->next].kind == LOGGED_RECEIVED) {
        host_board_write(&ribbon->board, &ribbon->events[ribbon->next++].in, 1);
    }
}

/* The next event if it is of that kind and gives out that byte, else a null pointer: then it is over. */
static const struct logged_event *follow(struct replayed_ribbon *ribbon, enum logged_kind kind, uint8_t out) {
    if (ribbon->is_over || ribbon->next == ribbon->count) {
        ribbon->is_over = true;
        return NULL;
    }
    const struct logged_event *const event = &ribbon->events[ribbon->next];
    if (event->kind != kind || (kind != LOGGED_LOOK && event->out != out)) {
        ribbon->is_over = true;
        return NULL;
    }
    ribbon->next++;
    receive(ribbon);
    return event;
}

static uint32_t look_us(void *context) {
    struct replayed_ribbon *const ribbon = context;
    const struct logged_event *const event = follow(ribbon, LOGGED_LOOK, 0);
    if (event != NULL) {
        ribbon->board.t_ns += (event->t_us - ribbon->looked_us) * (uint64_t)1000;
        ribbon->looked_us = event->t_us;
    }
    return ribbon->looked_us;
}

static uint8_t transfer(void *context, uint64_t t_ns, uint8_t mosi) {
    (void)t_ns;
    const struct logged_event *const event = follow(context, LOGGED_BYTE, mosi);
    return event != NULL ? event->in : 0xFF;
}

static void select_clock(void *context, uint64_t t_ns, bool data) {
    (void)t_ns;
    (void)follow(context, LOGGED_PULSE, data);
}

struct replayed_ribbon *replayed_ribbon_new(const struct logged_event *events, size_t count, uint32_t baud) {
    struct replayed_ribbon *const ribbon = calloc(1, sizeof *ribbon);
    if (ribbon == NULL) {
        return NULL;
    }
    ribbon->events = events;
    ribbon->count = count;
    host_board_init(&ribbon->board);
    ribbon->board.baud = baud;
    ribbon->board.bus =
        (struct host_bus){.context = ribbon, .transfer = transfer, .select_clock = select_clock};
    ribbon->board.clock = (struct host_clock){.context = ribbon, .look_us = look_us};
    return ribbon;
}

void replayed_ribbon_free(struct replayed_ribbon *ribbon) {
    if (ribbon != NULL) {
        free(ribbon->sent);
        free(ribbon);
    }
}

static void take_sent_bytes(struct replayed_ribbon *ribbon) {
    uint8_t bytes[READ_CHUNK];
    size_t n;
    while ((n = host_board_read(&ribbon->board, bytes, sizeof bytes)) > 0) {
        if (ribbon->sent_count + n > ribbon->sent_capacity) {
            const size_t capacity = 2u * ribbon->sent_capacity + READ_CHUNK;
            uint8_t *const larger = realloc(ribbon->sent, capacity);
            if (larger == NULL) {
                return;
            }
            ribbon->sent = larger;
            ribbon->sent_capacity = capacity;
        }
        memcpy(ribbon->sent + ribbon->sent_count, bytes, n);
        ribbon->sent_count += n;
    }
}

size_t replayed_ribbon_run(struct replayed_ribbon *ribbon) {
    receive(ribbon);
    app_init(&ribbon->app, &ribbon->board);
    while (!ribbon->is_over) {
        take_sent_bytes(ribbon);
        app_poll(&ribbon->app);
    }
    ribbon->board.t_ns += LAST_BYTES_NS;
    take_sent_bytes(ribbon);
    return ribbon->next;
}

size_t replayed_ribbon_read(struct replayed_ribbon *ribbon, uint8_t *bytes, size_t capacity) {
    const size_t n = ribbon->sent_count < capacity ? ribbon->sent_count : capacity;
    if (n > 0) {
        memcpy(bytes, ribbon->sent, n);
        ribbon->sent_count -= n;
        memmove(ribbon->sent, ribbon->sent + n, ribbon->sent_count);
    }
    return n;
}
