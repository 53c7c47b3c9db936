/* The firmware on the host board, made to live through what another build of it was seen to live through. */
#include "replayed_ribbon.h"

#include <stdlib.h>
#include <string.h>

#include "app.h"
#include "app_state.h" /* memory for an app is this file's to provide */
#include "port/host/host_board.h"

#define SENT_CHUNK 65536u

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

/* Ends the send in progress: how long it took is in the log, not in a baud rate. */
static void take_sent(struct replayed_ribbon *ribbon) {
    struct board *const board = &ribbon->board;
    const size_t n = board->tx_count - board->tx_taken;
    if (ribbon->sent_count + n > ribbon->sent_capacity) {
        const size_t capacity = 2u * ribbon->sent_capacity + SENT_CHUNK;
        uint8_t *const larger = realloc(ribbon->sent, capacity);
        if (larger == NULL) {
            ribbon->is_over = true;
            return;
        }
        ribbon->sent = larger;
        ribbon->sent_capacity = capacity;
    }
    if (n > 0) {
        memcpy(ribbon->sent + ribbon->sent_count, board->tx + board->tx_taken, n);
    }
    ribbon->sent_count += n;
    board->tx_taken = board->tx_count;
}

/* What happens on the link between two things that the firmware does is there when it looks for it next. */
static void live_through_link(struct replayed_ribbon *ribbon) {
    for (; ribbon->next < ribbon->count; ribbon->next++) {
        const struct logged_event *const event = &ribbon->events[ribbon->next];
        if (event->kind == LOGGED_RECEIVED) {
            host_board_write(&ribbon->board, &event->in, 1);
        } else if (event->kind == LOGGED_SENT) {
            take_sent(ribbon);
        } else {
            break;
        }
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
    live_through_link(ribbon);
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

struct replayed_ribbon *replayed_ribbon_new(const struct logged_event *events, size_t count) {
    struct replayed_ribbon *const ribbon = calloc(1, sizeof *ribbon);
    if (ribbon == NULL) {
        return NULL;
    }
    ribbon->events = events;
    ribbon->count = count;
    host_board_init(&ribbon->board);
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

size_t replayed_ribbon_run(struct replayed_ribbon *ribbon) {
    live_through_link(ribbon);
    app_init(&ribbon->app, &ribbon->board);
    while (!ribbon->is_over) {
        app_poll(&ribbon->app);
    }
    take_sent(ribbon);
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
