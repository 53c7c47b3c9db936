/* The packets that tell what the application knows. */
#ifndef PACKETS_H
#define PACKETS_H

#include <stddef.h>
#include <stdint.h>

struct app;

/* Each writes a packet (type byte and fields) of at most WIRE_MAX_PACKET_BYTES to `packet` and returns its
 * length. */
size_t packets_info(const struct app *app, uint8_t *packet);
size_t packets_status(const struct app *app, uint8_t *packet);

/* Of the scan that ended at t_us. */
size_t packets_orient(const struct app *app, uint32_t t_us, uint8_t *packet);
size_t packets_orient_compact(const struct app *app, uint32_t t_us, uint8_t *packet);
size_t packets_raw(const struct app *app, uint32_t t_us, uint8_t *packet);

#endif
