/* Packets that wait for the link: the stream may lose its oldest, replies wait their turn. */
#ifndef OUTBOX_H
#define OUTBOX_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* About 16 ORIENT frames: a link that pauses for as long as they last loses nothing. */
#define OUTBOX_STREAM_BYTES 2048u
#define OUTBOX_REPLY_BYTES  1024u

/* Packets, each after its length in two bytes, in a ring. */
struct outbox_queue {
    uint8_t *bytes;
    size_t capacity;
    size_t head; /* index of the oldest byte */
    size_t used;
};

struct outbox {
    struct outbox_queue replies; /* ACK, INFO, STATUS, CLOCK_PONG: leave first */
    struct outbox_queue stream;  /* ORIENT, RAW: the oldest is dropped when there is no room */
    uint32_t dropped;
    uint8_t reply_bytes[OUTBOX_REPLY_BYTES];
    uint8_t stream_bytes[OUTBOX_STREAM_BYTES];
};

void outbox_init(struct outbox *outbox);

/* Adds a packet of the stream, dropping as many of the oldest as its room needs; counts them, or the packet
 * itself if it is larger than the queue. */
void outbox_add_stream(struct outbox *outbox, const uint8_t *packet, size_t n);

/* Whether replies of n bytes in all, of `packets` packets, have room. */
bool outbox_has_reply_room(const struct outbox *outbox, size_t packets, size_t n);

/* Whether a reply waits. */
bool outbox_has_reply(const struct outbox *outbox);

/* Adds a reply; if there is no room it is counted as dropped, and false. */
bool outbox_add_reply(struct outbox *outbox, const uint8_t *packet, size_t n);

/* Moves the packet that is next to `packet` and returns its length; 0 if none waits or it exceeds capacity.
 */
size_t outbox_take(struct outbox *outbox, uint8_t *packet, size_t capacity);

#endif
