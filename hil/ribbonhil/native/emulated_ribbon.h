/* A whole ribbon in a program: the firmware on the host board, wired to a sensor string that feels a truth.
 *
 * All times are true time in nanoseconds since power-up. Nothing here waits. */
#ifndef EMULATED_RIBBON_H
#define EMULATED_RIBBON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "fault.h"
#include "sensor_bus.h"
#include "truth_table.h"

struct emulated_ribbon; /* board, firmware and sensors */

struct emulated_ribbon_config {
    struct sensor_bus_config bus;
    double clock_ppm; /* by which the device's clock is fast */
    uint32_t clock_offset_us;
    uint32_t baud;
    uint8_t unique_id[12];
};

/* A ribbon that powers up; a null pointer if the configuration is none or there is no memory. The table and
 * what it points to must outlive the ribbon. */
struct emulated_ribbon *emulated_ribbon_new(const struct emulated_ribbon_config *config,
                                            const struct truth_table *truth);
void emulated_ribbon_free(struct emulated_ribbon *ribbon);

/* Lets the firmware run until t_ns; it may be in the middle of a scan then and a little later. */
void emulated_ribbon_run_until(struct emulated_ribbon *ribbon, uint64_t t_ns);

/* The time at which the ribbon got to. */
uint64_t emulated_ribbon_now_ns(const struct emulated_ribbon *ribbon);

/* When there is something to do or to read next: the firmware wakes up, or a send ends. Call it after
 * emulated_ribbon_run_until. */
uint64_t emulated_ribbon_next_event_ns(const struct emulated_ribbon *ribbon);

/* Whether bytes are on their way out, the last of which leaves at a next event. */
bool emulated_ribbon_is_sending(struct emulated_ribbon *ribbon);

/* Bytes toward the device, which arrive now; returns how many fitted. */
size_t emulated_ribbon_write(struct emulated_ribbon *ribbon, const uint8_t *bytes, size_t n);

/* Takes bytes that have left the device by the time it was run until, at most capacity. */
size_t emulated_ribbon_read(struct emulated_ribbon *ribbon, uint8_t *bytes, size_t capacity);

/* Bytes that nobody read until there was no memory for them. */
uint64_t emulated_ribbon_lost(const struct emulated_ribbon *ribbon);

/* What the device's clock shows now. */
uint32_t emulated_ribbon_device_us(struct emulated_ribbon *ribbon);

/* The sensor string, to put faults into and to read counters from. */
struct sensor_bus *emulated_ribbon_bus(struct emulated_ribbon *ribbon);

#endif
