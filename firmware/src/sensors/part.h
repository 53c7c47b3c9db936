/* What all sensor parts have in common: how one is found, brought up, triggered, read and checked.
 *
 * A part is data (struct part) and two pure functions, part_configure() and part_decode(), that parts.c hands
 * on to the part's own files; parts.c is the only place that lists the parts. Every transaction is one
 * selection of one slot: a command byte and what follows it. */
#ifndef PART_H
#define PART_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "wire.h" /* enum wire_part */

#define PART_ID_MAX     3u /* bytes of an identity */
#define PART_CONFIG_MAX 6u /* consecutive control registers */
#define PART_BURST_MAX  9u /* bytes of a reading */

enum part_kind { PART_ACCELEROMETER, PART_MAGNETOMETER };

struct part {
    enum wire_part id;
    enum part_kind kind;

    uint8_t identity_command; /* reads the identity registers */
    uint8_t identity_count;
    uint8_t identity[PART_ID_MAX];

    uint8_t reset[2]; /* command and value that set every register to its default */
    bool has_reset;
    uint32_t reset_us; /* from then until the part answers again */

    uint8_t config_write_command; /* writes the control registers of struct part_config in one burst */
    uint8_t config_read_command;  /* reads them back; 0: they can only be written */
    uint8_t config_count;

    uint8_t burst_command; /* reads a sample and what tells whether it is new */
    uint8_t burst_count;

    bool has_polarity;      /* the bridge can be flipped, so that its offset can be told from the field */
    uint8_t polarise[2][2]; /* command and value, for polarity 0 (field reads as it is) and 1 (reversed) */

    uint8_t trigger[2]; /* command and value that start one measurement, where the configuration says so */
};

/* What a part is set to for a scan rate, and what follows from it. */
struct part_config {
    uint8_t registers[PART_CONFIG_MAX];
    uint8_t mask[PART_CONFIG_MAX]; /* bits that must read back as written */
    float lsb;                     /* m/s^2 or uT a count */
    float noise;                   /* standard deviation of one axis of a reading, m/s^2 or uT */
    float sample_hz;               /* samples a second */
    uint32_t measurement_us;       /* from trigger to sample, longest; 0: samples by itself at sample_hz */
    /* From the trigger to the middle of what the sample is a mean of; without trigger from there to when the
     * sample is read, on average. */
    uint32_t middle_us;
    uint32_t span_us; /* that a sample is a mean over */
};

/* One burst, decoded. */
struct part_sample {
    int32_t counts[3]; /* x, y, z in the frame of the part, null at 0 */
    bool is_new;       /* not read before */
    bool is_saturated;
    bool is_configured; /* false if the burst itself shows that the part lost its configuration */
};

/* The parts that this firmware knows. */
#define PART_COUNT 3u
extern const struct part *const PARTS[PART_COUNT];

/* Fills *config for rate_hz scans a second, 1 to 200. */
void part_configure(const struct part *part, uint32_t rate_hz, struct part_config *config);

/* Decodes part->burst_count bytes as read after the command byte. */
void part_decode(const struct part *part, const uint8_t *burst, struct part_sample *sample);

#endif
