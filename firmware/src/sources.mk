# Which source belongs to which part of the firmware, relative to this folder: the one list for every build.

# Pure: values in, values out; no board, build anywhere.
PURE_SOURCES := \
    branch.c bridge_offset.c calibration.c drift.c framing.c fusion.c fusion_field.c fusion_quality.c health.c \
    outbox.c plausibility.c quaternion.c rest_filter.c schedule.c slot.c slot_bring_up.c \
    stencil.c two_axis.c \
    sensors/hmc5983.c sensors/hmc5983_decode.c sensors/lis2dw12.c sensors/lis2dw12_decode.c \
    sensors/mmc5983ma.c sensors/mmc5983ma_decode.c sensors/parts.c

# What runs on a board, through board.h.
APPLICATION_SOURCES := \
    app.c calibration_store.c commands.c packets.c select_chain.c sensor_string.c

# Of these, what every scan runs through and is faster if built for speed, and where it pays to unroll the loops
# over three axes.
SCANNED_SOURCES := \
    bridge_offset.c framing.c fusion.c fusion_field.c fusion_quality.c packets.c rest_filter.c \
    select_chain.c slot.c two_axis.c \
    sensors/hmc5983_decode.c sensors/lis2dw12_decode.c sensors/mmc5983ma_decode.c port/stm32f405/bus.c
UNROLLED_SOURCES := \
    bridge_offset.c fusion_field.c packets.c slot.c two_axis.c \
    sensors/hmc5983_decode.c sensors/lis2dw12_decode.c sensors/mmc5983ma_decode.c

# The board that is made of memory.
HOST_PORT_SOURCES := port/host/host_board.c
