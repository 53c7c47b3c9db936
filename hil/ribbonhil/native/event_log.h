/* All that a firmware did outside of itself and all that it saw there, to play it to another build of it. */
#ifndef EVENT_LOG_H
#define EVENT_LOG_H

#include <stdint.h>

enum logged_kind {
    LOGGED_LOOK,     /* at the clock, which showed t_us */
    LOGGED_BYTE,     /* `out` to the sensor string, `in` from there */
    LOGGED_PULSE,    /* on SEL_CLK, with SEL_DATA = out */
    LOGGED_RECEIVED, /* `in` from the link */
    LOGGED_SENT      /* it learnt that what it was sending is out */
};

struct logged_event {
    uint32_t t_us;
    uint8_t kind;
    uint8_t out;
    uint8_t in;
};

#endif
