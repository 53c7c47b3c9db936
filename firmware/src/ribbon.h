/* The ribbon that this firmware drives: how many slots, how far apart, how often it is scanned. */
#ifndef RIBBON_H
#define RIBBON_H

#define FIRMWARE_VERSION_MAJOR 0u
#define FIRMWARE_VERSION_MINOR 1u
#define FIRMWARE_VERSION_PATCH 0u

/* Accelerometers at slots 0, 2, 4 ..., magnetometers at 1, 3, 5 ...; slot i sits at i * pitch. */
#define RIBBON_SLOT_COUNT 32u
#define RIBBON_NODE_COUNT (RIBBON_SLOT_COUNT / 2u)

#define RIBBON_PITCH_M     0.025f /* until a calibration says otherwise */
#define RIBBON_MAG_AXES    2u     /* of a magnetometer, the same: x and y */
#define RIBBON_RATE_HZ     100u   /* after reset */
#define RIBBON_RATE_MAX_HZ 200u

#endif
