/* Frames on the link: COBS(packet + CRC-16), ended by a zero byte; and the CRCs of packets and records. */
#ifndef FRAMING_H
#define FRAMING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "wire.h" /* largest packet */

#define FRAMING_CRC_BYTES 2u

/* Of a frame: COBS adds a byte for each started 254, and the delimiter follows. */
#define FRAMING_OVERHEAD_BYTES(content) ((content) / 254u + 2u)
#define FRAMING_MAX_FRAME_BYTES                                                                              \
    (WIRE_MAX_PACKET_BYTES + FRAMING_CRC_BYTES +                                                             \
     FRAMING_OVERHEAD_BYTES(WIRE_MAX_PACKET_BYTES + FRAMING_CRC_BYTES))

/* CRC-16/CCITT-FALSE: polynomial 0x1021, starts at 0xFFFF; 0x29B1 for "123456789". */
uint16_t framing_crc16(const uint8_t *bytes, size_t n);

/* CRC-32 as in Ethernet and zip; 0xCBF43926 for "123456789". */
uint32_t framing_crc32(const uint8_t *bytes, size_t n);

/* The frame of a packet of n bytes, with its CRC and delimiter, to `frame`; returns its length. Returns 0 if
 * the packet is empty or longer than WIRE_MAX_PACKET_BYTES, or the frame does not fit in `capacity`: room for
 * n + FRAMING_CRC_BYTES + FRAMING_OVERHEAD_BYTES(n + FRAMING_CRC_BYTES) always suffices. The two may not
 * overlap. */
size_t framing_encode(const uint8_t *packet, size_t n, uint8_t *frame, size_t capacity);

/* Takes a stream of bytes apart. Caller-owned; the counters may be read and cleared at any time. */
struct framing_reader {
    uint32_t crc_errors; /* frames with a wrong CRC */
    uint32_t malformed;  /* frames that are no COBS, too short to hold a packet and its CRC, or too long */

    uint8_t content[WIRE_MAX_PACKET_BYTES + FRAMING_CRC_BYTES];
    uint16_t count;
    uint8_t block_left; /* bytes until the next code byte */
    bool zero_is_next;  /* a zero stands where the next code byte is, unless the frame ends there */
    bool empty;         /* nothing came since the delimiter */
    bool too_long;
};

/* Ready for a frame, counters at zero. */
void framing_reader_init(struct framing_reader *reader);

/* The length of the packet that this byte completes, whose bytes are then at *packet until the next call;
 * else 0. Frames in error are counted, two delimiters in a row are no error, and after each delimiter
 * everything is new. */
size_t framing_read_byte(struct framing_reader *reader, uint8_t byte, const uint8_t **packet);

#endif
