/* Generated from protocol/schema.toml by protocol/generate.py; change that and run it. */

/* What goes over the wire between a ribbon and its host: values, and their bytes.
 *
 * wire_X_pack writes packet X (its type byte first) and returns how many bytes that took; 0, with nothing
 * written, if it does not fit in `capacity` or a count is above its limit.
 * wire_X_unpack reads it and returns how many bytes it used; bytes after those are fields that a newer
 * device appended. Or it returns a negative WIRE_ERROR_*; fields beyond the end of the packet are zero then.
 * Both are the same for a record, which has no type byte. A quaternion that is not valid, or cannot be
 * normalised, is packed as invalid and unpacked as NaN. Integers of 24 bits and scaled numbers saturate. */
#ifndef WIRE_H
#define WIRE_H

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define WIRE_VERSION             2
#define WIRE_OLDEST_HOST_VERSION 1
#define WIRE_SCHEMA_HASH         0x00337FC8u
#define WIRE_MAX_PACKET_BYTES    576u
#define WIRE_NODE_MAX            32u
#define WIRE_SLOT_MAX            64u

/* `layout` of the calibration record defined here. */
#define WIRE_CALIBRATION_LAYOUT 1u

/* longest blinking that identify accepts. */
#define WIRE_IDENTIFY_MAX_MS 60000u

/* argument of enter_dfu, "DFU!" read little-endian: keeps a stray command from stopping a device. */
#define WIRE_ENTER_DFU_KEY 0x21554644u

#define WIRE_ERROR_TRUNCATED (-1) /* shorter than its fields say */
#define WIRE_ERROR_COUNT     (-2) /* a count is above its limit */
#define WIRE_ERROR_TYPE      (-3) /* the type byte of another packet */

/* Type byte of a packet. */
enum wire_packet {
    /* Who the device is. Sent once at start and on get_info. */
    WIRE_PACKET_INFO = 1,
    /* Orientations of all nodes from one scan. */
    WIRE_PACKET_ORIENT = 2,
    /* ORIENT for slow links. */
    WIRE_PACKET_ORIENT_COMPACT = 3,
    /* All readings of one scan, for calibration and re-processing. */
    WIRE_PACKET_RAW = 4,
    /* Health, once a second and on get_status. Counters run since start and wrap. */
    WIRE_PACKET_STATUS = 5,
    /* Asks for something. Answered by one ACK with the same tag; a host repeats it after 0.25 s. */
    WIRE_PACKET_COMMAND = 16,
    /* Ends a COMMAND. */
    WIRE_PACKET_ACK = 17,
    /* Answered at once by CLOCK_PONG, to find the device clock's offset and drift. */
    WIRE_PACKET_CLOCK_PING = 18,
    /* Answer to CLOCK_PING. */
    WIRE_PACKET_CLOCK_PONG = 19,
};

/* What a slot of the sensor string holds, found by its identity register. */
enum wire_part {
    /* nothing answered, or an identity that no driver knows */
    WIRE_PART_NONE = 0,
    /* three-axis accelerometer, 14 bit */
    WIRE_PART_LIS2DW12 = 1,
    /* AMR magnetometer, 18 bit, with set/reset coil */
    WIRE_PART_MMC5983MA = 2,
    /* AMR magnetometer, 12 bit */
    WIRE_PART_HMC5983 = 3,
};

/* Why the reading of a slot is not used; 0 while it is. */
enum wire_slot_reason {
    /* the reading is fresh and plausible */
    WIRE_SLOT_REASON_OK = 0,
    /* nothing answers: the bus reads all ones or all zeros */
    WIRE_SLOT_REASON_ABSENT = 1,
    /* something answers with an identity that no driver knows */
    WIRE_SLOT_REASON_WRONG_ID = 2,
    /* being brought up, or lost its configuration */
    WIRE_SLOT_REASON_NOT_CONFIGURED = 3,
    /* no new sample for longer than four sample periods of the part */
    WIRE_SLOT_REASON_STALE = 4,
    /* new samples, but the same counts over and over */
    WIRE_SLOT_REASON_STUCK = 5,
    /* an axis is at the end of its range */
    WIRE_SLOT_REASON_SATURATED = 6,
    /* |a| or |B| far outside what the calibrated part can read here */
    WIRE_SLOT_REASON_OUT_OF_RANGE = 7,
    /* jumps that no motion explains: bit flips or a loose contact */
    WIRE_SLOT_REASON_NOISY = 8,
};

/* Why the device last started. */
enum wire_reset_cause {
    /* the device cannot tell */
    WIRE_RESET_CAUSE_UNKNOWN = 0,
    /* power applied */
    WIRE_RESET_CAUSE_POWER_ON = 1,
    /* reset pin */
    WIRE_RESET_CAUSE_PIN = 2,
    /* asked for by the firmware */
    WIRE_RESET_CAUSE_SOFTWARE = 3,
    /* the main loop made no progress */
    WIRE_RESET_CAUSE_WATCHDOG = 4,
    /* supply voltage dipped */
    WIRE_RESET_CAUSE_BROWN_OUT = 5,
    /* a fault handler restarted the device; fault_* tell where */
    WIRE_RESET_CAUSE_HARD_FAULT = 6,
};

/* What times the device. */
enum wire_clock_source {
    /* the device cannot tell */
    WIRE_CLOCK_SOURCE_UNKNOWN = 0,
    /* external crystal: tens of ppm */
    WIRE_CLOCK_SOURCE_CRYSTAL = 1,
    /* the crystal did not start; internal RC oscillator, about 1 % */
    WIRE_CLOCK_SOURCE_INTERNAL_RC = 2,
    /* the firmware runs on a computer */
    WIRE_CLOCK_SOURCE_HOST = 3,
};

/* The circuit board the firmware was built for. */
enum wire_board {
    /* a computer: the firmware as a module */
    WIRE_BOARD_HOST = 0,
    /* pyboard v1.1 */
    WIRE_BOARD_PYBOARD_V11 = 1,
    /* Feather STM32F405 */
    WIRE_BOARD_FEATHER_F405 = 2,
};

/* What a COMMAND asks for. `argument` and `data` are 0 and empty unless said otherwise. */
enum wire_command_code {
    /* ACK, then an INFO packet */
    WIRE_COMMAND_CODE_GET_INFO = 1,
    /* ACK, then a STATUS packet */
    WIRE_COMMAND_CODE_GET_STATUS = 2,
    /* argument: scans a second, 1 to 200 Hz, at most INFO.rate_max_hz. ACK.value: the rate in use. The
     * sequence goes on, the phase starts anew */
    WIRE_COMMAND_CODE_SET_RATE = 3,
    /* argument: flags.mode. orient and orient_compact exclude each other; unknown bits are a bad_argument.
     * ACK.value: the mode in use */
    WIRE_COMMAND_CODE_SET_MODE = 4,
    /* argument: a device time, microseconds, at which a scan shall start; later (and earlier) scans stay
     * whole periods away. Lets a host make several ribbons sample together. ACK.value: microseconds by
     * which the scans moved, as a signed 32-bit integer, at most half a period */
    WIRE_COMMAND_CODE_SET_PHASE = 5,
    /* argument: milliseconds to blink for, 0 to identify_max_ms (60000), more is a bad_argument; 0 ends it */
    WIRE_COMMAND_CODE_IDENTIFY = 6,
    /* argument: offset in bytes into the calibration record in use. ACK.value: size of the record,
     * ACK.data: bytes from there, at most 192, none at or beyond the end */
    WIRE_COMMAND_CODE_CALIBRATION_READ = 7,
    /* argument: offset in bytes, data: 1 to 192 bytes for the staging area. Beyond the size of a record:
     * bad_argument. ACK.value: bytes written */
    WIRE_COMMAND_CODE_CALIBRATION_WRITE = 8,
    /* argument: CRC-32 of the staged record. The record is checked (CRC, layout, slot count, ranges,
     * finite numbers), stored atomically, then used; one equal to that in use is ok and changes nothing.
     * ACK.value: the calibration sequence in use */
    WIRE_COMMAND_CODE_CALIBRATION_COMMIT = 9,
    /* argument: enter_dfu_key (0x21554644), else bad_argument. ACK, then the ROM boot loader; a device
     * without one answers unsupported */
    WIRE_COMMAND_CODE_ENTER_DFU = 10,
};

/* How a COMMAND ended. */
enum wire_ack_code {
    /* done */
    WIRE_ACK_CODE_OK = 0,
    /* the device does not know this command */
    WIRE_ACK_CODE_UNKNOWN_COMMAND = 1,
    /* argument or data out of range */
    WIRE_ACK_CODE_BAD_ARGUMENT = 2,
    /* the packet is shorter than its fields say, or data_count is out of range */
    WIRE_ACK_CODE_BAD_LENGTH = 3,
    /* the staged record does not have the CRC given */
    WIRE_ACK_CODE_BAD_CRC = 4,
    /* flash could not be erased or written; the old record is still in use */
    WIRE_ACK_CODE_STORAGE_FAILED = 5,
    /* known, but this board cannot do it */
    WIRE_ACK_CODE_UNSUPPORTED = 6,
};

/* What the device sends after each scan. */
enum wire_mode {
    /* ORIENT */
    WIRE_MODE_ORIENT = 1,
    /* ORIENT_COMPACT */
    WIRE_MODE_ORIENT_COMPACT = 2,
    /* RAW */
    WIRE_MODE_RAW = 4,
};

/* Which axes of a part are used, in the node frame. */
enum wire_axes {
    /* along the tangent */
    WIRE_AXES_X = 1,
    /* along the binormal */
    WIRE_AXES_Y = 2,
    /* along the normal */
    WIRE_AXES_Z = 4,
};

/* Upper four bits of a node's quality byte: why its orientation deserves less trust. The lower four bits
 * are sigma_code. */
enum wire_quality {
    /* the accelerometers are not a level now: |a| differs from g, or they change */
    WIRE_QUALITY_MOVING = 16,
    /* |B| does not fit */
    WIRE_QUALITY_FIELD_MAGNITUDE = 32,
    /* the dip angle does not fit */
    WIRE_QUALITY_FIELD_DIP = 64,
    /* two headings explain the two-axis field, of which one was chosen by continuity, or a wide range does */
    WIRE_QUALITY_HEADING_AMBIGUOUS = 128,
};

/* What a slot reads at rest, or on the whole, that its calibration does not explain. */
enum wire_misfit {
    /* |a| is outside 0.99 to 1.01 g, or |B| not that of the local field */
    WIRE_MISFIT_LENGTH = 1,
    /* an accelerometer's level is not the one that its neighbours read */
    WIRE_MISFIT_NEIGHBOURS = 2,
    /* the dip angle of the field is not the local one */
    WIRE_MISFIT_DIP = 4,
};

/* Bytes on the wire. MIN: with empty arrays. */
#define WIRE_SLOT_INFO_BYTES        6u
#define WIRE_SLOT_STATUS_BYTES      3u
#define WIRE_NODE_BYTES             7u
#define WIRE_NODE_COMPACT_BYTES     5u
#define WIRE_SLOT_HEALTH_BYTES      2u
#define WIRE_ACCEL_RAW_BYTES        7u
#define WIRE_MAG_RAW_BYTES          10u
#define WIRE_SLOT_CALIBRATION_BYTES 48u

#define WIRE_CALIBRATION_MIN_BYTES    20u
#define WIRE_CALIBRATION_MAX_BYTES    3092u
#define WIRE_INFO_MIN_BYTES           42u
#define WIRE_INFO_MAX_BYTES           426u
#define WIRE_ORIENT_MIN_BYTES         8u
#define WIRE_ORIENT_MAX_BYTES         232u
#define WIRE_ORIENT_COMPACT_MIN_BYTES 8u
#define WIRE_ORIENT_COMPACT_MAX_BYTES 168u
#define WIRE_RAW_MIN_BYTES            21u
#define WIRE_RAW_MAX_BYTES            565u
#define WIRE_STATUS_MIN_BYTES         56u
#define WIRE_STATUS_MAX_BYTES         376u
#define WIRE_COMMAND_MIN_BYTES        9u
#define WIRE_COMMAND_MAX_BYTES        201u
#define WIRE_ACK_MIN_BYTES            10u
#define WIRE_ACK_MAX_BYTES            202u
#define WIRE_CLOCK_PING_MIN_BYTES     11u
#define WIRE_CLOCK_PING_MAX_BYTES     11u
#define WIRE_CLOCK_PONG_MIN_BYTES     19u
#define WIRE_CLOCK_PONG_MAX_BYTES     19u

/* Ranges of fields. */
#define WIRE_CALIBRATION_MAG_AXES_MIN            2u
#define WIRE_CALIBRATION_MAG_AXES_MAX            3u
#define WIRE_CALIBRATION_SLOT_COUNT_MAX          WIRE_SLOT_MAX
#define WIRE_CALIBRATION_PITCH_M_MIN             0.001f
#define WIRE_CALIBRATION_PITCH_M_MAX             1.0f
#define WIRE_CALIBRATION_FIELD_HORIZONTAL_UT_MIN 1.0f
#define WIRE_CALIBRATION_FIELD_HORIZONTAL_UT_MAX 100.0f
#define WIRE_CALIBRATION_FIELD_DOWN_UT_MIN       (-100.0f)
#define WIRE_CALIBRATION_FIELD_DOWN_UT_MAX       100.0f
#define WIRE_INFO_RATE_HZ_MIN                    1u
#define WIRE_INFO_RATE_HZ_MAX                    200u
#define WIRE_INFO_RATE_MAX_HZ_MIN                1u
#define WIRE_INFO_RATE_MAX_HZ_MAX                200u
#define WIRE_INFO_NODE_COUNT_MAX                 WIRE_NODE_MAX
#define WIRE_INFO_SLOT_COUNT_MAX                 WIRE_SLOT_MAX
#define WIRE_ORIENT_NODE_COUNT_MAX               WIRE_NODE_MAX
#define WIRE_ORIENT_COMPACT_NODE_COUNT_MAX       WIRE_NODE_MAX
#define WIRE_RAW_ACCEL_COUNT_MAX                 WIRE_NODE_MAX
#define WIRE_RAW_MAG_COUNT_MAX                   WIRE_NODE_MAX
#define WIRE_STATUS_SLOT_COUNT_MAX               WIRE_SLOT_MAX
#define WIRE_STATUS_HEALTH_COUNT_MAX             WIRE_SLOT_MAX
#define WIRE_COMMAND_DATA_COUNT_MAX              192u
#define WIRE_ACK_DATA_COUNT_MAX                  192u

/* One slot of the sensor string, in order of distance from the connector; slot i sits at i * pitch. */
struct wire_slot_info {
    /* the part found (wire_part) */
    uint8_t part;
    /* axes that are used (wire_axes) */
    uint8_t axes;
    /* what one count of RAW is, before calibration; 0 when absent (m/s^2 or uT a count) */
    float lsb;
};

/* Health of one slot. */
struct wire_slot_status {
    /* state now (wire_slot_reason) */
    uint8_t reason;
    /* scans without a usable reading since start, stops at 65535 */
    uint16_t errors;
};

/* Orientation of one node, at the place of a magnetometer. */
struct wire_node {
    /* 48 bits: index of the largest component in bits 0 and 1, the other three in order w, x, y, z in bits
     * 2 to 16, 17 to 31 and 32 to 46; bit 47 is set when valid, all bits are 0 when not (world from node) */
    float q_world_node[4];
    bool q_world_node_valid;
    /* sigma_code in bits 0 to 3, flags.quality in bits 4 to 7 */
    uint8_t quality;
};

/* Orientation of one node in 32 bits. */
struct wire_node_compact {
    /* 32 bits: index of the largest component in bits 0 and 1, the other three in order w, x, y, z in bits
     * 2 to 11, 12 to 21 and 22 to 31; all bits are set when invalid (world from node) */
    float q_world_node[4];
    bool q_world_node_valid;
    /* as in node */
    uint8_t quality;
};

/* How well one slot's calibration fits. */
struct wire_slot_health {
    /* what does not fit; 0: nothing was found (wire_misfit) */
    uint8_t misfit;
    /* by how much |a| at rest exceeds g, or |B| the local field; 127: by that or more; -127: falls short
     * by that or more; -128: not known */
    int8_t length_permille;
};

/* One accelerometer reading. */
struct wire_accel_raw {
    /* ok, or why the counts are not usable (wire_slot_reason) */
    uint8_t reason;
    /* x, y, z specific force as read (slot_info.lsb, part frame) */
    int16_t counts[3];
};

/* One magnetometer reading. */
struct wire_mag_raw {
    /* ok, or why the counts are not usable (wire_slot_reason) */
    uint8_t reason;
    /* x, y, z field as read, null field at 0, the part's own bridge offset already cancelled where it can
     * be (slot_info.lsb, part frame) */
    int32_t counts[3];
};

/* What turns a part's reading v (SI) into the node frame: matrix * (v - offset). */
struct wire_slot_calibration {
    /* bias, or hard iron (m/s^2 or uT, part frame) */
    float offset[3];
    /* row-major: scale, cross-axis, soft iron and mounting in one (node from part) */
    float matrix[9];
};

/* All that a device knows of its sensors. `layout` is 1. */
struct wire_calibration {
    /* 1 */
    uint16_t layout;
    /* 2: only x and y of the magnetometers are used, as the part names its axes: what it does not measure
     * lies along the third column of its slot's matrix; 3: all */
    uint8_t mag_axes;
    /* slots that follow; must be the device's own number */
    uint8_t slot_count;
    /* when it was made; 0: the identity calibration of an uncalibrated device (s since 1970-01-01 UTC, 0:
     * invalid) */
    uint32_t created_s;
    /* distance between neighbouring slots (m) */
    float pitch_m;
    /* horizontal part of the local field (uT) */
    float field_horizontal_ut;
    /* vertical part of the local field, positive down (uT) */
    float field_down_ut;
    /* one a slot, identity where nothing is known */
    struct wire_slot_calibration slots[WIRE_SLOT_MAX];
};

/* Who the device is. Sent once at start and on get_info. */
struct wire_info {
    /* version of this schema the device speaks */
    uint8_t wire_version;
    /* a host that speaks an older version than this cannot work with the device */
    uint8_t oldest_host_version;
    /* first four bytes, read little-endian, of the SHA-256 of the schema's layout */
    uint32_t schema_hash;
    /* major, minor, patch */
    uint8_t firmware_version[3];
    /* circuit board (wire_board) */
    uint8_t board;
    /* of the MCU; its hexadecimal form is the serial number */
    uint8_t unique_id[12];
    /* distance between neighbouring slots (m) */
    float pitch_m;
    /* scans a second (Hz) */
    uint16_t rate_hz;
    /* largest rate that set_rate accepts (Hz) */
    uint16_t rate_max_hz;
    /* what is sent after each scan (wire_mode) */
    uint8_t mode;
    /* counts commits; 0: never calibrated */
    uint32_t calibration_sequence;
    /* CRC-32 of the calibration record in use */
    uint32_t calibration_crc32;
    /* orientations in ORIENT */
    uint8_t node_count;
    /* slots that follow */
    uint8_t slot_count;
    /* one a slot */
    struct wire_slot_info slots[WIRE_SLOT_MAX];
};

/* Orientations of all nodes from one scan. */
struct wire_orient {
    /* device time at the end of the scan, wraps every 71.6 minutes (us) */
    uint32_t t_us;
    /* counts scans, wraps; the same in ORIENT and RAW of one scan */
    uint16_t sequence;
    /* nodes that follow */
    uint8_t node_count;
    /* from the connector outward */
    struct wire_node nodes[WIRE_NODE_MAX];
};

/* ORIENT for slow links. */
struct wire_orient_compact {
    /* as in ORIENT (us) */
    uint32_t t_us;
    /* as in ORIENT */
    uint16_t sequence;
    /* nodes that follow */
    uint8_t node_count;
    /* from the connector outward */
    struct wire_node_compact nodes[WIRE_NODE_MAX];
};

/* All readings of one scan, for calibration and re-processing. */
struct wire_raw {
    /* as in ORIENT (us) */
    uint32_t t_us;
    /* as in ORIENT */
    uint16_t sequence;
    /* accelerometers that follow: the slots 0, 2, 4 ... */
    uint8_t accel_count;
    /* magnetometers that follow: the slots 1, 3, 5 ... */
    uint8_t mag_count;
    /* from the connector outward */
    struct wire_accel_raw accels[WIRE_NODE_MAX];
    /* from the connector outward */
    struct wire_mag_raw mags[WIRE_NODE_MAX];
    /* how old the accelerometers' readings are at t_us, on average: since the middle of the time that a
     * reading is a mean over (us) */
    uint16_t accel_age_us;
    /* between samples of accelerometers that sample by clocks of their own: the age is up to half of it
     * more or less; 0: they sample when the scan tells them to (us) */
    uint16_t accel_period_us;
    /* time that a reading of an accelerometer is a mean over (us) */
    uint16_t accel_span_us;
    /* the same of the magnetometers (us) */
    uint16_t mag_age_us;
    /* the same of the magnetometers (us) */
    uint16_t mag_period_us;
    /* the same of the magnetometers (us) */
    uint16_t mag_span_us;
};

/* Health, once a second and on get_status. Counters run since start and wrap. */
struct wire_status {
    /* device time (us) */
    uint32_t t_us;
    /* since start (s) */
    uint32_t uptime_s;
    /* scans done */
    uint32_t scans;
    /* scans left out because the one before took too long */
    uint32_t overruns;
    /* frames given up because the link was slower than they came */
    uint32_t frames_dropped;
    /* frames received with a wrong CRC */
    uint32_t rx_crc_errors;
    /* frames received that are no COBS, too short for a packet and its CRC, or too long; packets shorter
     * than their fields that no ACK can answer */
    uint32_t rx_malformed;
    /* packets received of a type that is not known, or that only a device sends */
    uint32_t rx_unknown;
    /* how long the last scan took (us) */
    uint16_t scan_us;
    /* scans a second (Hz) */
    uint16_t rate_hz;
    /* what is sent after each scan (wire_mode) */
    uint8_t mode;
    /* why the device last started (wire_reset_cause) */
    uint8_t reset_cause;
    /* what times the device (wire_clock_source) */
    uint8_t clock_source;
    /* of the MCU, or of the sensors if it has none (degC, NaN: invalid) */
    float temperature_c;
    /* program counter of the last hard fault; 0: none (0: invalid) */
    uint32_t fault_pc;
    /* link register there (0: invalid) */
    uint32_t fault_lr;
    /* configurable fault status register there (0: invalid) */
    uint32_t fault_cfsr;
    /* slots that follow */
    uint8_t slot_count;
    /* one a slot */
    struct wire_slot_status slots[WIRE_SLOT_MAX];
    /* slots whose health follows: all or none */
    uint8_t health_count;
    /* one a slot */
    struct wire_slot_health health[WIRE_SLOT_MAX];
};

/* Asks for something. Answered by one ACK with the same tag; a host repeats it after 0.25 s. */
struct wire_command {
    /* chosen by the host, comes back in the ACK */
    uint16_t tag;
    /* what (wire_command_code) */
    uint8_t command;
    /* meaning depends on the command */
    uint32_t argument;
    /* bytes that follow */
    uint8_t data_count;
    /* meaning depends on the command */
    uint8_t data[WIRE_COMMAND_DATA_COUNT_MAX];
};

/* Ends a COMMAND. */
struct wire_ack {
    /* of the COMMAND */
    uint16_t tag;
    /* of the COMMAND */
    uint8_t command;
    /* how it ended (wire_ack_code) */
    uint8_t code;
    /* meaning depends on the command */
    uint32_t value;
    /* bytes that follow */
    uint8_t data_count;
    /* meaning depends on the command */
    uint8_t data[WIRE_ACK_DATA_COUNT_MAX];
};

/* Answered at once by CLOCK_PONG, to find the device clock's offset and drift. */
struct wire_clock_ping {
    /* comes back */
    uint16_t tag;
    /* host time of sending, comes back (us) */
    uint64_t t_host_us;
};

/* Answer to CLOCK_PING. */
struct wire_clock_pong {
    /* of the CLOCK_PING */
    uint16_t tag;
    /* of the CLOCK_PING (us) */
    uint64_t t_host_us;
    /* device time when the last byte of the CLOCK_PING was read (us) */
    uint32_t t_receive_us;
    /* device time when this packet was put on the way (us) */
    uint32_t t_transmit_us;
};

/* Lower four bits of a quality byte: standard deviation of the orientation, largest axis. Code c in 0..14
 * means sigma <= smallest_rad * ratio^c, rounded up; 14 also stands for more; 15 means unknown. Negative
 * or NaN: unknown. */
static inline uint8_t wire_sigma_code(float sigma_rad) {
    static const float threshold_rad[15] = {
        0.000872664626f, /* 0.05 deg */
        0.00138308023f,  /* 0.0792 deg */
        0.00219203443f,  /* 0.126 deg */
        0.00347414045f,  /* 0.199 deg */
        0.00550614155f,  /* 0.315 deg */
        0.00872664626f,  /* 0.5 deg */
        0.0138308023f,   /* 0.792 deg */
        0.0219203443f,   /* 1.26 deg */
        0.0347414045f,   /* 1.99 deg */
        0.0550614155f,   /* 3.15 deg */
        0.0872664626f,   /* 5 deg */
        0.138308023f,    /* 7.92 deg */
        0.219203443f,    /* 12.6 deg */
        0.347414045f,    /* 19.9 deg */
        0.550614155f,    /* 31.5 deg */
    };
    uint8_t code = 0;
    if (!(sigma_rad >= 0.0f))
        return 15;
    for (uint8_t step = 8; step > 0; step /= 2)
        if (code + step <= 14 && sigma_rad > threshold_rad[code + step - 1])
            code = (uint8_t)(code + step);
    return code;
}

static inline uint8_t *wire_put_u8(uint8_t *out, uint8_t value) {
    out[0] = value;
    return out + 1;
}

static inline uint8_t *wire_put_u16(uint8_t *out, uint16_t value) {
    out[0] = (uint8_t)value;
    out[1] = (uint8_t)(value >> 8);
    return out + 2;
}

static inline uint8_t *wire_put_u32(uint8_t *out, uint32_t value) {
    out = wire_put_u16(out, (uint16_t)value);
    return wire_put_u16(out, (uint16_t)(value >> 16));
}

static inline uint8_t *wire_put_u64(uint8_t *out, uint64_t value) {
    out = wire_put_u32(out, (uint32_t)value);
    return wire_put_u32(out, (uint32_t)(value >> 32));
}

static inline uint8_t *wire_put_i24(uint8_t *out, int32_t value) {
    const int32_t limit = 0x7FFFFF;
    const uint32_t bits = (uint32_t)(value > limit ? limit : value < -limit - 1 ? -limit - 1 : value);
    out = wire_put_u16(out, (uint16_t)bits);
    return wire_put_u8(out, (uint8_t)(bits >> 16));
}

static inline uint8_t *wire_put_f32(uint8_t *out, float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return wire_put_u32(out, bits);
}

static inline uint8_t *wire_put_bytes(uint8_t *out, const uint8_t *bytes, size_t n) {
    memcpy(out, bytes, n);
    return out + n;
}

/* `value` in steps of `scale`, rounded half away from zero and kept within low ... high; NaN: `invalid`. */
static inline int32_t wire_scaled(float value, float scale, int32_t low, int32_t high, int32_t invalid) {
    const float steps = value / scale;
    if (isnan(steps))
        return invalid;
    if (steps <= (float)low)
        return low;
    if (steps >= (float)high)
        return high;
    return (int32_t)(steps < 0.0f ? steps - 0.5f : steps + 0.5f);
}

/* What is left of a packet being read; past its end everything reads as zero. */
struct wire_reader {
    const uint8_t *at;
    size_t left;
    bool truncated;
};

static inline uint32_t wire_get(struct wire_reader *reader, unsigned bytes) {
    uint32_t value = 0;
    if (reader->left < bytes) {
        reader->truncated = true;
        reader->left = 0;
        return 0;
    }
    for (unsigned i = 0; i < bytes; i++)
        value |= (uint32_t)reader->at[i] << (8 * i);
    reader->at += bytes;
    reader->left -= bytes;
    return value;
}

static inline uint64_t wire_get_u64(struct wire_reader *reader) {
    const uint64_t low = wire_get(reader, 4);
    return low | (uint64_t)wire_get(reader, 4) << 32;
}

/* Two's complement number of so many bytes. */
static inline int32_t wire_get_signed(struct wire_reader *reader, unsigned bytes) {
    const uint32_t sign = 1u << (8 * bytes - 1);
    return (int32_t)((wire_get(reader, bytes) ^ sign) - sign);
}

static inline float wire_get_f32(struct wire_reader *reader) {
    const uint32_t bits = wire_get(reader, 4);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static inline void wire_get_bytes(struct wire_reader *reader, uint8_t *bytes, size_t n) {
    for (size_t i = 0; i < n; i++)
        bytes[i] = (uint8_t)wire_get(reader, 1);
}

/* Index of the component of q of largest magnitude, and the codes of the other three: c of the normalised q
 * as levels + c * sqrt(2) * levels, rounded. False if q cannot be normalised.
 *
 * Errors e of the three, in steps, cost s = v . e in the largest, v being their ratios to it: the rotation is
 * wrong by an angle proportional to sqrt(e . e + s * s), at worst 1.73 when each is rounded to nearest.
 * Rounding one of them the other way where that lowers the sum makes it 1, the least that any choice of
 * codes can reach. A code at the end of its range never leaves it: the other two ratios, and with them
 * s, are next to zero then. */
static inline bool wire_smallest_three(const float q[4], float levels, uint32_t *index, uint32_t codes[3]) {
    const float norm2 = (q[0] * q[0] + q[1] * q[1]) + (q[2] * q[2] + q[3] * q[3]);
    if (!(norm2 >= FLT_MIN && norm2 <= FLT_MAX))
        return false;
    static const uint8_t others[4][3] = {{1, 2, 3}, {0, 2, 3}, {0, 1, 3}, {0, 1, 2}};
    unsigned largest = 0;
    for (unsigned i = 1; i < 4; i++)
        if (fabsf(q[i]) > fabsf(q[largest]))
            largest = i;
    const float steps = levels * 1.41421356f / sqrtf(norm2);
    const float scale = q[largest] < 0.0f ? -steps : steps;
    const float inverse = 1.0f / (q[largest] * scale);

    float error[3], ratio[3], s = 0.0f;
    for (unsigned k = 0; k < 3; k++) {
        const float x = q[others[largest][k]] * scale;
        codes[k] = (uint32_t)(x + (levels + 0.5f));
        error[k] = ((float)codes[k] - levels) - x;
        ratio[k] = x * inverse;
        s += ratio[k] * error[k];
    }
    unsigned best = 3;
    float least = 0.0f;
    for (unsigned k = 0; k < 3; k++) {
        const float step = error[k] < 0.0f ? -1.0f : 1.0f;
        const float change = (1.0f - 2.0f * fabsf(error[k])) + ratio[k] * (ratio[k] - 2.0f * s * step);
        if (change < least) {
            least = change;
            best = k;
        }
    }
    if (best < 3)
        codes[best] = error[best] < 0.0f ? codes[best] + 1 : codes[best] - 1;
    *index = largest;
    return true;
}

/* The inverse, of unit length. False, and q NaN, if the three are longer than 1. */
static inline bool wire_smallest_three_inverse(uint32_t index, const uint32_t codes[3], int32_t levels,
                                               float q[4]) {
    const float step = 0.707106781f / (float)levels;
    const int32_t whole = 2 * levels * levels; /* 1, squared, in steps */
    int32_t rest = whole;
    for (unsigned i = 0, k = 0; i < 4; i++)
        if (i != index) {
            const int32_t steps = (int32_t)codes[k++] - levels;
            rest -= steps * steps;
            q[i] = (float)steps * step;
        }
    if (rest < 0) {
        q[0] = q[1] = q[2] = q[3] = NAN;
        return false;
    }
    q[index] = sqrtf((float)rest / (float)whole);
    return true;
}

static inline uint8_t *wire_put_smallest_three_15(uint8_t *out, const float q[4], bool valid) {
    uint32_t index, codes[3];
    uint64_t word = 0;
    if (valid && wire_smallest_three(q, 16383.0f, &index, codes)) {
        word = index | (uint64_t)1 << 47;
        for (unsigned k = 0; k < 3; k++)
            word |= (uint64_t)codes[k] << (2 + 15 * k);
    }
    out = wire_put_u32(out, (uint32_t)word);
    return wire_put_u16(out, (uint16_t)(word >> 32));
}

static inline bool wire_get_smallest_three_15(struct wire_reader *reader, float q[4]) {
    const uint64_t low = wire_get(reader, 4);
    const uint64_t word = low | (uint64_t)wire_get(reader, 2) << 32;
    uint32_t codes[3];
    for (unsigned k = 0; k < 3; k++)
        codes[k] = (uint32_t)(word >> (2 + 15 * k)) & 0x7FFFu;
    if ((word >> 47 & 1) != 0)
        return wire_smallest_three_inverse(word & 3, codes, 16383, q);
    q[0] = q[1] = q[2] = q[3] = NAN;
    return false;
}

static inline uint8_t *wire_put_smallest_three_10(uint8_t *out, const float q[4], bool valid) {
    uint32_t index, codes[3];
    uint32_t word = 0xFFFFFFFFu;
    if (valid && wire_smallest_three(q, 511.0f, &index, codes)) {
        word = index;
        for (unsigned k = 0; k < 3; k++)
            word |= (uint32_t)codes[k] << (2 + 10 * k);
    }
    return wire_put_u32(out, word);
}

static inline bool wire_get_smallest_three_10(struct wire_reader *reader, float q[4]) {
    const uint32_t word = wire_get(reader, 4);
    uint32_t codes[3];
    for (unsigned k = 0; k < 3; k++)
        codes[k] = (uint32_t)(word >> (2 + 10 * k)) & 0x3FFu;
    if (word != 0xFFFFFFFFu)
        return wire_smallest_three_inverse(word & 3, codes, 511, q);
    q[0] = q[1] = q[2] = q[3] = NAN;
    return false;
}

static inline uint8_t *wire_put_slot_info(uint8_t *out, const struct wire_slot_info *item) {
    out = wire_put_u8(out, item->part);
    out = wire_put_u8(out, item->axes);
    out = wire_put_f32(out, item->lsb);
    return out;
}

static inline void wire_get_slot_info(struct wire_reader *reader, struct wire_slot_info *item) {
    item->part = (uint8_t)wire_get(reader, 1);
    item->axes = (uint8_t)wire_get(reader, 1);
    item->lsb = wire_get_f32(reader);
}

static inline uint8_t *wire_put_slot_status(uint8_t *out, const struct wire_slot_status *item) {
    out = wire_put_u8(out, item->reason);
    out = wire_put_u16(out, item->errors);
    return out;
}

static inline void wire_get_slot_status(struct wire_reader *reader, struct wire_slot_status *item) {
    item->reason = (uint8_t)wire_get(reader, 1);
    item->errors = (uint16_t)wire_get(reader, 2);
}

static inline uint8_t *wire_put_node(uint8_t *out, const struct wire_node *item) {
    out = wire_put_smallest_three_15(out, item->q_world_node, item->q_world_node_valid);
    out = wire_put_u8(out, item->quality);
    return out;
}

static inline void wire_get_node(struct wire_reader *reader, struct wire_node *item) {
    item->q_world_node_valid = wire_get_smallest_three_15(reader, item->q_world_node);
    item->quality = (uint8_t)wire_get(reader, 1);
}

static inline uint8_t *wire_put_node_compact(uint8_t *out, const struct wire_node_compact *item) {
    out = wire_put_smallest_three_10(out, item->q_world_node, item->q_world_node_valid);
    out = wire_put_u8(out, item->quality);
    return out;
}

static inline void wire_get_node_compact(struct wire_reader *reader, struct wire_node_compact *item) {
    item->q_world_node_valid = wire_get_smallest_three_10(reader, item->q_world_node);
    item->quality = (uint8_t)wire_get(reader, 1);
}

static inline uint8_t *wire_put_slot_health(uint8_t *out, const struct wire_slot_health *item) {
    out = wire_put_u8(out, item->misfit);
    out = wire_put_u8(out, (uint8_t)item->length_permille);
    return out;
}

static inline void wire_get_slot_health(struct wire_reader *reader, struct wire_slot_health *item) {
    item->misfit = (uint8_t)wire_get(reader, 1);
    item->length_permille = (int8_t)wire_get_signed(reader, 1);
}

static inline uint8_t *wire_put_accel_raw(uint8_t *out, const struct wire_accel_raw *item) {
    out = wire_put_u8(out, item->reason);
    for (unsigned i = 0; i < 3; i++)
        out = wire_put_u16(out, (uint16_t)item->counts[i]);
    return out;
}

static inline void wire_get_accel_raw(struct wire_reader *reader, struct wire_accel_raw *item) {
    item->reason = (uint8_t)wire_get(reader, 1);
    for (unsigned i = 0; i < 3; i++)
        item->counts[i] = (int16_t)wire_get_signed(reader, 2);
}

static inline uint8_t *wire_put_mag_raw(uint8_t *out, const struct wire_mag_raw *item) {
    out = wire_put_u8(out, item->reason);
    for (unsigned i = 0; i < 3; i++)
        out = wire_put_i24(out, item->counts[i]);
    return out;
}

static inline void wire_get_mag_raw(struct wire_reader *reader, struct wire_mag_raw *item) {
    item->reason = (uint8_t)wire_get(reader, 1);
    for (unsigned i = 0; i < 3; i++)
        item->counts[i] = wire_get_signed(reader, 3);
}

static inline uint8_t *wire_put_slot_calibration(uint8_t *out, const struct wire_slot_calibration *item) {
    for (unsigned i = 0; i < 3; i++)
        out = wire_put_f32(out, item->offset[i]);
    for (unsigned i = 0; i < 9; i++)
        out = wire_put_f32(out, item->matrix[i]);
    return out;
}

static inline void wire_get_slot_calibration(struct wire_reader *reader, struct wire_slot_calibration *item) {
    for (unsigned i = 0; i < 3; i++)
        item->offset[i] = wire_get_f32(reader);
    for (unsigned i = 0; i < 9; i++)
        item->matrix[i] = wire_get_f32(reader);
}

static inline size_t wire_calibration_pack(const struct wire_calibration *calibration, uint8_t *out,
                                           size_t capacity) {
    if (calibration->slot_count > WIRE_CALIBRATION_SLOT_COUNT_MAX)
        return 0;
    size_t size = WIRE_CALIBRATION_MIN_BYTES;
    size += calibration->slot_count * WIRE_SLOT_CALIBRATION_BYTES;
    if (size > capacity)
        return 0;
    out = wire_put_u16(out, calibration->layout);
    out = wire_put_u8(out, calibration->mag_axes);
    out = wire_put_u8(out, calibration->slot_count);
    out = wire_put_u32(out, calibration->created_s);
    out = wire_put_f32(out, calibration->pitch_m);
    out = wire_put_f32(out, calibration->field_horizontal_ut);
    out = wire_put_f32(out, calibration->field_down_ut);
    for (unsigned i = 0; i < calibration->slot_count; i++)
        out = wire_put_slot_calibration(out, &calibration->slots[i]);
    return size;
}

static inline int wire_calibration_unpack(const uint8_t *record, size_t n,
                                          struct wire_calibration *calibration) {
    struct wire_reader whole = {record, n, false}, *reader = &whole;
    calibration->layout = (uint16_t)wire_get(reader, 2);
    calibration->mag_axes = (uint8_t)wire_get(reader, 1);
    calibration->slot_count = (uint8_t)wire_get(reader, 1);
    calibration->created_s = wire_get(reader, 4);
    calibration->pitch_m = wire_get_f32(reader);
    calibration->field_horizontal_ut = wire_get_f32(reader);
    calibration->field_down_ut = wire_get_f32(reader);
    if (calibration->slot_count > WIRE_CALIBRATION_SLOT_COUNT_MAX)
        return WIRE_ERROR_COUNT;
    for (unsigned i = 0; i < calibration->slot_count; i++)
        wire_get_slot_calibration(reader, &calibration->slots[i]);
    return whole.truncated ? WIRE_ERROR_TRUNCATED : (int)(n - whole.left);
}

static inline size_t wire_info_pack(const struct wire_info *info, uint8_t *out, size_t capacity) {
    if (info->slot_count > WIRE_INFO_SLOT_COUNT_MAX)
        return 0;
    size_t size = WIRE_INFO_MIN_BYTES;
    size += info->slot_count * WIRE_SLOT_INFO_BYTES;
    if (size > capacity)
        return 0;
    out = wire_put_u8(out, WIRE_PACKET_INFO);
    out = wire_put_u8(out, info->wire_version);
    out = wire_put_u8(out, info->oldest_host_version);
    out = wire_put_u32(out, info->schema_hash);
    out = wire_put_bytes(out, info->firmware_version, 3);
    out = wire_put_u8(out, info->board);
    out = wire_put_bytes(out, info->unique_id, 12);
    out = wire_put_f32(out, info->pitch_m);
    out = wire_put_u16(out, info->rate_hz);
    out = wire_put_u16(out, info->rate_max_hz);
    out = wire_put_u8(out, info->mode);
    out = wire_put_u32(out, info->calibration_sequence);
    out = wire_put_u32(out, info->calibration_crc32);
    out = wire_put_u8(out, info->node_count);
    out = wire_put_u8(out, info->slot_count);
    for (unsigned i = 0; i < info->slot_count; i++)
        out = wire_put_slot_info(out, &info->slots[i]);
    return size;
}

static inline int wire_info_unpack(const uint8_t *packet, size_t n, struct wire_info *info) {
    struct wire_reader whole = {packet, n, false}, *reader = &whole;
    if (wire_get(reader, 1) != WIRE_PACKET_INFO)
        return WIRE_ERROR_TYPE;
    info->wire_version = (uint8_t)wire_get(reader, 1);
    info->oldest_host_version = (uint8_t)wire_get(reader, 1);
    info->schema_hash = wire_get(reader, 4);
    wire_get_bytes(reader, info->firmware_version, 3);
    info->board = (uint8_t)wire_get(reader, 1);
    wire_get_bytes(reader, info->unique_id, 12);
    info->pitch_m = wire_get_f32(reader);
    info->rate_hz = (uint16_t)wire_get(reader, 2);
    info->rate_max_hz = (uint16_t)wire_get(reader, 2);
    info->mode = (uint8_t)wire_get(reader, 1);
    info->calibration_sequence = wire_get(reader, 4);
    info->calibration_crc32 = wire_get(reader, 4);
    info->node_count = (uint8_t)wire_get(reader, 1);
    info->slot_count = (uint8_t)wire_get(reader, 1);
    if (info->slot_count > WIRE_INFO_SLOT_COUNT_MAX)
        return WIRE_ERROR_COUNT;
    for (unsigned i = 0; i < info->slot_count; i++)
        wire_get_slot_info(reader, &info->slots[i]);
    return whole.truncated ? WIRE_ERROR_TRUNCATED : (int)(n - whole.left);
}

static inline size_t wire_orient_pack(const struct wire_orient *orient, uint8_t *out, size_t capacity) {
    if (orient->node_count > WIRE_ORIENT_NODE_COUNT_MAX)
        return 0;
    size_t size = WIRE_ORIENT_MIN_BYTES;
    size += orient->node_count * WIRE_NODE_BYTES;
    if (size > capacity)
        return 0;
    out = wire_put_u8(out, WIRE_PACKET_ORIENT);
    out = wire_put_u32(out, orient->t_us);
    out = wire_put_u16(out, orient->sequence);
    out = wire_put_u8(out, orient->node_count);
    for (unsigned i = 0; i < orient->node_count; i++)
        out = wire_put_node(out, &orient->nodes[i]);
    return size;
}

static inline int wire_orient_unpack(const uint8_t *packet, size_t n, struct wire_orient *orient) {
    struct wire_reader whole = {packet, n, false}, *reader = &whole;
    if (wire_get(reader, 1) != WIRE_PACKET_ORIENT)
        return WIRE_ERROR_TYPE;
    orient->t_us = wire_get(reader, 4);
    orient->sequence = (uint16_t)wire_get(reader, 2);
    orient->node_count = (uint8_t)wire_get(reader, 1);
    if (orient->node_count > WIRE_ORIENT_NODE_COUNT_MAX)
        return WIRE_ERROR_COUNT;
    for (unsigned i = 0; i < orient->node_count; i++)
        wire_get_node(reader, &orient->nodes[i]);
    return whole.truncated ? WIRE_ERROR_TRUNCATED : (int)(n - whole.left);
}

static inline size_t wire_orient_compact_pack(const struct wire_orient_compact *orient_compact, uint8_t *out,
                                              size_t capacity) {
    if (orient_compact->node_count > WIRE_ORIENT_COMPACT_NODE_COUNT_MAX)
        return 0;
    size_t size = WIRE_ORIENT_COMPACT_MIN_BYTES;
    size += orient_compact->node_count * WIRE_NODE_COMPACT_BYTES;
    if (size > capacity)
        return 0;
    out = wire_put_u8(out, WIRE_PACKET_ORIENT_COMPACT);
    out = wire_put_u32(out, orient_compact->t_us);
    out = wire_put_u16(out, orient_compact->sequence);
    out = wire_put_u8(out, orient_compact->node_count);
    for (unsigned i = 0; i < orient_compact->node_count; i++)
        out = wire_put_node_compact(out, &orient_compact->nodes[i]);
    return size;
}

static inline int wire_orient_compact_unpack(const uint8_t *packet, size_t n,
                                             struct wire_orient_compact *orient_compact) {
    struct wire_reader whole = {packet, n, false}, *reader = &whole;
    if (wire_get(reader, 1) != WIRE_PACKET_ORIENT_COMPACT)
        return WIRE_ERROR_TYPE;
    orient_compact->t_us = wire_get(reader, 4);
    orient_compact->sequence = (uint16_t)wire_get(reader, 2);
    orient_compact->node_count = (uint8_t)wire_get(reader, 1);
    if (orient_compact->node_count > WIRE_ORIENT_COMPACT_NODE_COUNT_MAX)
        return WIRE_ERROR_COUNT;
    for (unsigned i = 0; i < orient_compact->node_count; i++)
        wire_get_node_compact(reader, &orient_compact->nodes[i]);
    return whole.truncated ? WIRE_ERROR_TRUNCATED : (int)(n - whole.left);
}

static inline size_t wire_raw_pack(const struct wire_raw *raw, uint8_t *out, size_t capacity) {
    if (raw->accel_count > WIRE_RAW_ACCEL_COUNT_MAX)
        return 0;
    if (raw->mag_count > WIRE_RAW_MAG_COUNT_MAX)
        return 0;
    size_t size = WIRE_RAW_MIN_BYTES;
    size += raw->accel_count * WIRE_ACCEL_RAW_BYTES;
    size += raw->mag_count * WIRE_MAG_RAW_BYTES;
    if (size > capacity)
        return 0;
    out = wire_put_u8(out, WIRE_PACKET_RAW);
    out = wire_put_u32(out, raw->t_us);
    out = wire_put_u16(out, raw->sequence);
    out = wire_put_u8(out, raw->accel_count);
    out = wire_put_u8(out, raw->mag_count);
    for (unsigned i = 0; i < raw->accel_count; i++)
        out = wire_put_accel_raw(out, &raw->accels[i]);
    for (unsigned i = 0; i < raw->mag_count; i++)
        out = wire_put_mag_raw(out, &raw->mags[i]);
    out = wire_put_u16(out, raw->accel_age_us);
    out = wire_put_u16(out, raw->accel_period_us);
    out = wire_put_u16(out, raw->accel_span_us);
    out = wire_put_u16(out, raw->mag_age_us);
    out = wire_put_u16(out, raw->mag_period_us);
    wire_put_u16(out, raw->mag_span_us);
    return size;
}

static inline int wire_raw_unpack(const uint8_t *packet, size_t n, struct wire_raw *raw) {
    struct wire_reader whole = {packet, n, false}, *reader = &whole;
    if (wire_get(reader, 1) != WIRE_PACKET_RAW)
        return WIRE_ERROR_TYPE;
    raw->t_us = wire_get(reader, 4);
    raw->sequence = (uint16_t)wire_get(reader, 2);
    raw->accel_count = (uint8_t)wire_get(reader, 1);
    raw->mag_count = (uint8_t)wire_get(reader, 1);
    if (raw->accel_count > WIRE_RAW_ACCEL_COUNT_MAX)
        return WIRE_ERROR_COUNT;
    for (unsigned i = 0; i < raw->accel_count; i++)
        wire_get_accel_raw(reader, &raw->accels[i]);
    if (raw->mag_count > WIRE_RAW_MAG_COUNT_MAX)
        return WIRE_ERROR_COUNT;
    for (unsigned i = 0; i < raw->mag_count; i++)
        wire_get_mag_raw(reader, &raw->mags[i]);
    raw->accel_age_us = (uint16_t)wire_get(reader, 2);
    raw->accel_period_us = (uint16_t)wire_get(reader, 2);
    raw->accel_span_us = (uint16_t)wire_get(reader, 2);
    raw->mag_age_us = (uint16_t)wire_get(reader, 2);
    raw->mag_period_us = (uint16_t)wire_get(reader, 2);
    raw->mag_span_us = (uint16_t)wire_get(reader, 2);
    return whole.truncated ? WIRE_ERROR_TRUNCATED : (int)(n - whole.left);
}

static inline size_t wire_status_pack(const struct wire_status *status, uint8_t *out, size_t capacity) {
    if (status->slot_count > WIRE_STATUS_SLOT_COUNT_MAX)
        return 0;
    if (status->health_count > WIRE_STATUS_HEALTH_COUNT_MAX)
        return 0;
    size_t size = WIRE_STATUS_MIN_BYTES;
    size += status->slot_count * WIRE_SLOT_STATUS_BYTES;
    size += status->health_count * WIRE_SLOT_HEALTH_BYTES;
    if (size > capacity)
        return 0;
    out = wire_put_u8(out, WIRE_PACKET_STATUS);
    out = wire_put_u32(out, status->t_us);
    out = wire_put_u32(out, status->uptime_s);
    out = wire_put_u32(out, status->scans);
    out = wire_put_u32(out, status->overruns);
    out = wire_put_u32(out, status->frames_dropped);
    out = wire_put_u32(out, status->rx_crc_errors);
    out = wire_put_u32(out, status->rx_malformed);
    out = wire_put_u32(out, status->rx_unknown);
    out = wire_put_u16(out, status->scan_us);
    out = wire_put_u16(out, status->rate_hz);
    out = wire_put_u8(out, status->mode);
    out = wire_put_u8(out, status->reset_cause);
    out = wire_put_u8(out, status->clock_source);
    out = wire_put_u16(out, (uint16_t)wire_scaled(status->temperature_c, 0.01f, -32767, 32767, -32768));
    out = wire_put_u32(out, status->fault_pc);
    out = wire_put_u32(out, status->fault_lr);
    out = wire_put_u32(out, status->fault_cfsr);
    out = wire_put_u8(out, status->slot_count);
    for (unsigned i = 0; i < status->slot_count; i++)
        out = wire_put_slot_status(out, &status->slots[i]);
    out = wire_put_u8(out, status->health_count);
    for (unsigned i = 0; i < status->health_count; i++)
        out = wire_put_slot_health(out, &status->health[i]);
    return size;
}

static inline int wire_status_unpack(const uint8_t *packet, size_t n, struct wire_status *status) {
    struct wire_reader whole = {packet, n, false}, *reader = &whole;
    if (wire_get(reader, 1) != WIRE_PACKET_STATUS)
        return WIRE_ERROR_TYPE;
    status->t_us = wire_get(reader, 4);
    status->uptime_s = wire_get(reader, 4);
    status->scans = wire_get(reader, 4);
    status->overruns = wire_get(reader, 4);
    status->frames_dropped = wire_get(reader, 4);
    status->rx_crc_errors = wire_get(reader, 4);
    status->rx_malformed = wire_get(reader, 4);
    status->rx_unknown = wire_get(reader, 4);
    status->scan_us = (uint16_t)wire_get(reader, 2);
    status->rate_hz = (uint16_t)wire_get(reader, 2);
    status->mode = (uint8_t)wire_get(reader, 1);
    status->reset_cause = (uint8_t)wire_get(reader, 1);
    status->clock_source = (uint8_t)wire_get(reader, 1);
    const int32_t temperature_c = (int16_t)wire_get_signed(reader, 2);
    status->temperature_c = temperature_c == -32768 ? NAN : (float)temperature_c * 0.01f;
    status->fault_pc = wire_get(reader, 4);
    status->fault_lr = wire_get(reader, 4);
    status->fault_cfsr = wire_get(reader, 4);
    status->slot_count = (uint8_t)wire_get(reader, 1);
    if (status->slot_count > WIRE_STATUS_SLOT_COUNT_MAX)
        return WIRE_ERROR_COUNT;
    for (unsigned i = 0; i < status->slot_count; i++)
        wire_get_slot_status(reader, &status->slots[i]);
    status->health_count = (uint8_t)wire_get(reader, 1);
    if (status->health_count > WIRE_STATUS_HEALTH_COUNT_MAX)
        return WIRE_ERROR_COUNT;
    for (unsigned i = 0; i < status->health_count; i++)
        wire_get_slot_health(reader, &status->health[i]);
    return whole.truncated ? WIRE_ERROR_TRUNCATED : (int)(n - whole.left);
}

static inline size_t wire_command_pack(const struct wire_command *command, uint8_t *out, size_t capacity) {
    if (command->data_count > WIRE_COMMAND_DATA_COUNT_MAX)
        return 0;
    size_t size = WIRE_COMMAND_MIN_BYTES;
    size += command->data_count;
    if (size > capacity)
        return 0;
    out = wire_put_u8(out, WIRE_PACKET_COMMAND);
    out = wire_put_u16(out, command->tag);
    out = wire_put_u8(out, command->command);
    out = wire_put_u32(out, command->argument);
    out = wire_put_u8(out, command->data_count);
    out = wire_put_bytes(out, command->data, command->data_count);
    return size;
}

static inline int wire_command_unpack(const uint8_t *packet, size_t n, struct wire_command *command) {
    struct wire_reader whole = {packet, n, false}, *reader = &whole;
    if (wire_get(reader, 1) != WIRE_PACKET_COMMAND)
        return WIRE_ERROR_TYPE;
    command->tag = (uint16_t)wire_get(reader, 2);
    command->command = (uint8_t)wire_get(reader, 1);
    command->argument = wire_get(reader, 4);
    command->data_count = (uint8_t)wire_get(reader, 1);
    if (command->data_count > WIRE_COMMAND_DATA_COUNT_MAX)
        return WIRE_ERROR_COUNT;
    wire_get_bytes(reader, command->data, command->data_count);
    return whole.truncated ? WIRE_ERROR_TRUNCATED : (int)(n - whole.left);
}

static inline size_t wire_ack_pack(const struct wire_ack *ack, uint8_t *out, size_t capacity) {
    if (ack->data_count > WIRE_ACK_DATA_COUNT_MAX)
        return 0;
    size_t size = WIRE_ACK_MIN_BYTES;
    size += ack->data_count;
    if (size > capacity)
        return 0;
    out = wire_put_u8(out, WIRE_PACKET_ACK);
    out = wire_put_u16(out, ack->tag);
    out = wire_put_u8(out, ack->command);
    out = wire_put_u8(out, ack->code);
    out = wire_put_u32(out, ack->value);
    out = wire_put_u8(out, ack->data_count);
    out = wire_put_bytes(out, ack->data, ack->data_count);
    return size;
}

static inline int wire_ack_unpack(const uint8_t *packet, size_t n, struct wire_ack *ack) {
    struct wire_reader whole = {packet, n, false}, *reader = &whole;
    if (wire_get(reader, 1) != WIRE_PACKET_ACK)
        return WIRE_ERROR_TYPE;
    ack->tag = (uint16_t)wire_get(reader, 2);
    ack->command = (uint8_t)wire_get(reader, 1);
    ack->code = (uint8_t)wire_get(reader, 1);
    ack->value = wire_get(reader, 4);
    ack->data_count = (uint8_t)wire_get(reader, 1);
    if (ack->data_count > WIRE_ACK_DATA_COUNT_MAX)
        return WIRE_ERROR_COUNT;
    wire_get_bytes(reader, ack->data, ack->data_count);
    return whole.truncated ? WIRE_ERROR_TRUNCATED : (int)(n - whole.left);
}

static inline size_t wire_clock_ping_pack(const struct wire_clock_ping *clock_ping, uint8_t *out,
                                          size_t capacity) {
    const size_t size = WIRE_CLOCK_PING_MIN_BYTES;
    if (size > capacity)
        return 0;
    out = wire_put_u8(out, WIRE_PACKET_CLOCK_PING);
    out = wire_put_u16(out, clock_ping->tag);
    wire_put_u64(out, clock_ping->t_host_us);
    return size;
}

static inline int wire_clock_ping_unpack(const uint8_t *packet, size_t n,
                                         struct wire_clock_ping *clock_ping) {
    struct wire_reader whole = {packet, n, false}, *reader = &whole;
    if (wire_get(reader, 1) != WIRE_PACKET_CLOCK_PING)
        return WIRE_ERROR_TYPE;
    clock_ping->tag = (uint16_t)wire_get(reader, 2);
    clock_ping->t_host_us = wire_get_u64(reader);
    return whole.truncated ? WIRE_ERROR_TRUNCATED : (int)(n - whole.left);
}

static inline size_t wire_clock_pong_pack(const struct wire_clock_pong *clock_pong, uint8_t *out,
                                          size_t capacity) {
    const size_t size = WIRE_CLOCK_PONG_MIN_BYTES;
    if (size > capacity)
        return 0;
    out = wire_put_u8(out, WIRE_PACKET_CLOCK_PONG);
    out = wire_put_u16(out, clock_pong->tag);
    out = wire_put_u64(out, clock_pong->t_host_us);
    out = wire_put_u32(out, clock_pong->t_receive_us);
    wire_put_u32(out, clock_pong->t_transmit_us);
    return size;
}

static inline int wire_clock_pong_unpack(const uint8_t *packet, size_t n,
                                         struct wire_clock_pong *clock_pong) {
    struct wire_reader whole = {packet, n, false}, *reader = &whole;
    if (wire_get(reader, 1) != WIRE_PACKET_CLOCK_PONG)
        return WIRE_ERROR_TYPE;
    clock_pong->tag = (uint16_t)wire_get(reader, 2);
    clock_pong->t_host_us = wire_get_u64(reader);
    clock_pong->t_receive_us = wire_get(reader, 4);
    clock_pong->t_transmit_us = wire_get(reader, 4);
    return whole.truncated ? WIRE_ERROR_TRUNCATED : (int)(n - whole.left);
}

#endif
