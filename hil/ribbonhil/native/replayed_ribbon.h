/* The firmware on the host board, made to live through what another build of it was seen to live through. */
#ifndef REPLAYED_RIBBON_H
#define REPLAYED_RIBBON_H

#include <stddef.h>
#include <stdint.h>

#include "event_log.h"

struct replayed_ribbon;

/* A ribbon that starts from reset with an erased store. The events must outlive it. A null pointer if there
 * is no memory. */
struct replayed_ribbon *replayed_ribbon_new(const struct logged_event *events, size_t count);
void replayed_ribbon_free(struct replayed_ribbon *ribbon);

/* Runs through the events, and returns how many of them the firmware followed: all, or those before the first
 * thing that it did otherwise. */
size_t replayed_ribbon_run(struct replayed_ribbon *ribbon);

/* Takes bytes that the firmware sent, at most capacity. */
size_t replayed_ribbon_read(struct replayed_ribbon *ribbon, uint8_t *bytes, size_t capacity);

#endif
