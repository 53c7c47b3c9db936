/* Frames on the link: COBS(packet + CRC-16), ended by a zero byte; and the CRCs of packets and records. */
#include "framing.h"

/* Eight steps of the polynomial x^16 + x^12 + x^5 + 1 at once: its feedback reaches no bit of a byte twice
 * but by x^12, four bits on. */
static uint16_t crc16_byte(uint16_t crc, uint8_t byte) {
    uint32_t x = (uint32_t)(crc >> 8 ^ byte);
    x ^= x >> 4;
    return (uint16_t)((uint32_t)crc << 8 ^ x << 12 ^ x << 5 ^ x);
}

enum { CRC16_START = 0xFFFF };

uint16_t framing_crc16(const uint8_t *bytes, size_t n) {
    uint16_t crc = CRC16_START;
    for (size_t i = 0; i < n; i++)
        crc = crc16_byte(crc, bytes[i]);
    return crc;
}

uint32_t framing_crc32(const uint8_t *bytes, size_t n) {
    static const uint32_t remainder[16] = {
        0x00000000, 0x1DB71064, 0x3B6E20C8, 0x26D930AC, 0x76DC4190, 0x6B6B51F4, 0x4DB26158, 0x5005713C,
        0xEDB88320, 0xF00F9344, 0xD6D6A3E8, 0xCB61B38C, 0x9B64C2B0, 0x86D3D2D4, 0xA00AE278, 0xBDBDF21C,
    };
    uint32_t crc = 0xFFFFFFFF;
    for (size_t i = 0; i < n; i++) {
        crc = crc >> 4 ^ remainder[(crc ^ bytes[i]) & 15];
        crc = crc >> 4 ^ remainder[(crc ^ bytes[i] >> 4) & 15];
    }
    return ~crc;
}

/* A COBS block being written: its code byte, known only once it ends, and where the next byte goes. */
struct cobs_writer {
    uint8_t *code, *end;
};

enum { COBS_BLOCK_BYTES = 0xFF };

static inline void cobs_end_block(struct cobs_writer *writer) {
    *writer->code = (uint8_t)(writer->end - writer->code);
    writer->code = writer->end++;
}

static inline void cobs_put(struct cobs_writer *writer, uint8_t byte) {
    if (writer->end == writer->code + COBS_BLOCK_BYTES)
        cobs_end_block(writer);
    if (byte == 0)
        cobs_end_block(writer);
    else
        *writer->end++ = byte;
}

size_t framing_encode(const uint8_t *packet, size_t n, uint8_t *frame, size_t capacity) {
    if (n == 0 || n > WIRE_MAX_PACKET_BYTES)
        return 0;
    const size_t content = n + FRAMING_CRC_BYTES;
    if (capacity < content + FRAMING_OVERHEAD_BYTES(content))
        return 0;
    struct cobs_writer writer = {frame, frame + 1};
    uint16_t crc = CRC16_START;
    for (size_t i = 0; i < n; i++) {
        crc = crc16_byte(crc, packet[i]);
        cobs_put(&writer, packet[i]);
    }
    cobs_put(&writer, (uint8_t)crc);
    cobs_put(&writer, (uint8_t)(crc >> 8));
    cobs_end_block(&writer);
    *writer.code = 0;
    return (size_t)(writer.end - frame);
}

static void start_frame(struct framing_reader *reader) {
    reader->count = 0;
    reader->block_left = 0;
    reader->zero_is_next = false;
    reader->empty = true;
    reader->too_long = false;
}

void framing_reader_init(struct framing_reader *reader) {
    reader->crc_errors = 0;
    reader->malformed = 0;
    start_frame(reader);
}

static void append(struct framing_reader *reader, uint8_t byte) {
    if (reader->count < sizeof reader->content)
        reader->content[reader->count++] = byte;
    else
        reader->too_long = true;
}

static size_t end_frame(struct framing_reader *reader) {
    if (reader->empty)
        return 0;
    if (reader->too_long || reader->block_left != 0 || reader->count <= FRAMING_CRC_BYTES) {
        reader->malformed++;
        return 0;
    }
    const size_t n = reader->count - FRAMING_CRC_BYTES;
    const uint32_t crc = reader->content[n] | (uint32_t)reader->content[n + 1] << 8;
    if (crc != framing_crc16(reader->content, n)) {
        reader->crc_errors++;
        return 0;
    }
    return n;
}

size_t framing_read_byte(struct framing_reader *reader, uint8_t byte, const uint8_t **packet) {
    if (byte == 0) {
        const size_t n = end_frame(reader);
        start_frame(reader);
        *packet = reader->content;
        return n;
    }
    reader->empty = false;
    if (reader->block_left != 0) {
        reader->block_left--;
        append(reader, byte);
        return 0;
    }
    if (reader->zero_is_next)
        append(reader, 0);
    reader->zero_is_next = byte != 0xFF;
    reader->block_left = (uint8_t)(byte - 1);
    return 0;
}
