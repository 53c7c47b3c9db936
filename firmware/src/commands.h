/* What the host asks for: COMMAND to ACK, CLOCK_PING to CLOCK_PONG. */
#ifndef COMMANDS_H
#define COMMANDS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct app;

/* Whether the outbox has room for whatever one packet may be answered with. */
bool commands_have_room(const struct app *app);

/* Does what a received packet (type byte and fields) asks for and queues the answers. t_us: when its last
 * byte was read. Needs commands_have_room(). */
void commands_take(struct app *app, const uint8_t *packet, size_t n, uint32_t t_us);

#endif
