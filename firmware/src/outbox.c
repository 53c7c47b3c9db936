/* Packets that wait for the link: the stream may lose its oldest, replies wait their turn. */
#include "outbox.h"

#include <string.h>

#define LENGTH_BYTES 2u

static size_t smaller(size_t a, size_t b) {
    return a < b ? a : b;
}

/* Copies n bytes out of the ring, from `at` on; returns where the next one is. */
static size_t copy_out(const struct outbox_queue *queue, size_t at, uint8_t *bytes, size_t n) {
    const size_t to_end = smaller(n, queue->capacity - at);
    memcpy(bytes, queue->bytes + at, to_end);
    memcpy(bytes + to_end, queue->bytes, n - to_end);
    return (at + n) % queue->capacity;
}

static size_t copy_in(struct outbox_queue *queue, size_t at, const uint8_t *bytes, size_t n) {
    const size_t to_end = smaller(n, queue->capacity - at);
    memcpy(queue->bytes + at, bytes, to_end);
    memcpy(queue->bytes, bytes + to_end, n - to_end);
    return (at + n) % queue->capacity;
}

/* The length of the oldest packet, and where its bytes are. */
static size_t find_oldest(const struct outbox_queue *queue, size_t *at) {
    uint8_t length[LENGTH_BYTES];
    *at = copy_out(queue, queue->head, length, sizeof length);
    return (size_t)length[0] | ((size_t)length[1] << 8);
}

static void remove_oldest(struct outbox_queue *queue) {
    size_t at;
    const size_t n = LENGTH_BYTES + find_oldest(queue, &at);
    queue->head = (queue->head + n) % queue->capacity;
    queue->used -= n;
}

static void add(struct outbox_queue *queue, const uint8_t *packet, size_t n) {
    const uint8_t length[LENGTH_BYTES] = {(uint8_t)(n & 0xFFu), (uint8_t)(n >> 8)};
    const size_t at = copy_in(queue, (queue->head + queue->used) % queue->capacity, length, sizeof length);
    copy_in(queue, at, packet, n);
    queue->used += LENGTH_BYTES + n;
}

static bool has_room(const struct outbox_queue *queue, size_t n) {
    return queue->used + n <= queue->capacity;
}

void outbox_init(struct outbox *outbox) {
    outbox->replies = (struct outbox_queue){.bytes = outbox->reply_bytes, .capacity = OUTBOX_REPLY_BYTES};
    outbox->stream = (struct outbox_queue){.bytes = outbox->stream_bytes, .capacity = OUTBOX_STREAM_BYTES};
    outbox->dropped = 0u;
}

void outbox_add_stream(struct outbox *outbox, const uint8_t *packet, size_t n) {
    struct outbox_queue *const queue = &outbox->stream;
    if (LENGTH_BYTES + n > queue->capacity) {
        outbox->dropped++;
        return;
    }
    while (!has_room(queue, LENGTH_BYTES + n)) {
        remove_oldest(queue);
        outbox->dropped++;
    }
    add(queue, packet, n);
}

bool outbox_has_reply_room(const struct outbox *outbox, size_t packets, size_t n) {
    return has_room(&outbox->replies, packets * LENGTH_BYTES + n);
}

bool outbox_has_reply(const struct outbox *outbox) {
    return outbox->replies.used > 0u;
}

bool outbox_add_reply(struct outbox *outbox, const uint8_t *packet, size_t n) {
    if (!has_room(&outbox->replies, LENGTH_BYTES + n)) {
        outbox->dropped++;
        return false;
    }
    add(&outbox->replies, packet, n);
    return true;
}

size_t outbox_take(struct outbox *outbox, uint8_t *packet, size_t capacity) {
    struct outbox_queue *const queue = outbox->replies.used > 0u ? &outbox->replies : &outbox->stream;
    if (queue->used == 0u)
        return 0u;
    size_t at;
    const size_t n = find_oldest(queue, &at);
    if (n > capacity)
        return 0u;
    copy_out(queue, at, packet, n);
    remove_oldest(queue);
    return n;
}
