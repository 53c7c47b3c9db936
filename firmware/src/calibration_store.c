/* Where the calibration outlives a power cut: two areas of the board's store, written in turn. */
#include "calibration_store.h"

#include <string.h>

#include "framing.h"

enum { AREAS = 2, HEADER_BYTES = 16, RECORD_OFFSET = HEADER_BYTES };

static const uint32_t MAGIC = 0x4C414352u; /* "RCAL" */

/* An area's first bytes: magic, sequence, CRC of the record, CRC of the three before; little-endian. */
struct header {
    uint32_t sequence;
    uint32_t record_crc32;
};

_Static_assert(RECORD_OFFSET + CALIBRATION_RECORD_BYTES <= BOARD_STORE_BYTES, "a record must fit in an area");
_Static_assert(CALIBRATION_RECORD_BYTES % 4u == 0u, "the store is written in words");

static void pack_header(const struct header *header, uint8_t *bytes) {
    uint8_t *at = wire_put_u32(bytes, MAGIC);
    at = wire_put_u32(at, header->sequence);
    at = wire_put_u32(at, header->record_crc32);
    wire_put_u32(at, framing_crc32(bytes, HEADER_BYTES - 4u));
}

static bool read_header(struct board *board, unsigned area, struct header *header) {
    uint8_t bytes[HEADER_BYTES];
    board_store_read(board, area, 0u, bytes, sizeof bytes);
    struct wire_reader reader = {bytes, sizeof bytes, false};
    const uint32_t magic = wire_get(&reader, 4u);
    header->sequence = wire_get(&reader, 4u);
    header->record_crc32 = wire_get(&reader, 4u);
    return magic == MAGIC && wire_get(&reader, 4u) == framing_crc32(bytes, HEADER_BYTES - 4u);
}

static bool read_record(struct board *board, unsigned area, const struct header *header, uint8_t *record) {
    board_store_read(board, area, RECORD_OFFSET, record, CALIBRATION_RECORD_BYTES);
    return framing_crc32(record, CALIBRATION_RECORD_BYTES) == header->record_crc32;
}

void calibration_store_load(struct calibration_store *store, struct board *board,
                            struct calibration *calibration, uint8_t *scratch) {
    struct header headers[AREAS];
    bool is_candidate[AREAS];
    for (unsigned area = 0; area < AREAS; area++)
        is_candidate[area] = read_header(board, area, &headers[area]);

    store->next_area = 0u;
    /* Newest first; sequence numbers wrap. */
    unsigned area =
        is_candidate[1] && (!is_candidate[0] || (int32_t)(headers[1].sequence - headers[0].sequence) > 0);
    for (unsigned tried = 0; tried < AREAS; tried++, area ^= 1u) {
        if (is_candidate[area] && read_record(board, area, &headers[area], scratch) &&
            calibration_use(calibration, scratch, headers[area].sequence)) {
            store->next_area = area ^ 1u;
            return;
        }
    }
}

static bool is_as_written(struct board *board, unsigned area, size_t offset, const uint8_t *bytes, size_t n) {
    uint8_t chunk[64];
    for (size_t done = 0; done < n; done += sizeof chunk) {
        const size_t count = n - done < sizeof chunk ? n - done : sizeof chunk;
        board_store_read(board, area, offset + done, chunk, count);
        if (memcmp(chunk, bytes + done, count) != 0)
            return false;
    }
    return true;
}

bool calibration_store_save(struct calibration_store *store, struct board *board, const uint8_t *record,
                            uint32_t sequence) {
    const unsigned area = store->next_area;
    const struct header header = {sequence, framing_crc32(record, CALIBRATION_RECORD_BYTES)};
    uint8_t bytes[HEADER_BYTES];
    pack_header(&header, bytes);
    if (!board_store_erase(board, area) ||
        !board_store_write(board, area, RECORD_OFFSET, record, CALIBRATION_RECORD_BYTES) ||
        !is_as_written(board, area, RECORD_OFFSET, record, CALIBRATION_RECORD_BYTES) ||
        !board_store_write(board, area, 0u, bytes, sizeof bytes) ||
        !is_as_written(board, area, 0u, bytes, sizeof bytes))
        return false;
    store->next_area = area ^ 1u;
    return true;
}
