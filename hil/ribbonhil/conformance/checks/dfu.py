"""enter_dfu with its key: the last check, as the device leaves its firmware."""

from __future__ import annotations

from ribbonhost.wire import ENTER_DFU_KEY, AckCode, CommandCode

from ribbonhil.conformance.check import Group, Permission, expect
from ribbonhil.conformance.client import code_name
from ribbonhil.conformance.device import Device

GROUP = Group("dfu")

LEAVE_S = 1.5


@GROUP.check("COMMAND", Permission.DFU)
def enter_dfu_leaves_the_firmware(device: Device) -> None:
    """enter_dfu with its key is acknowledged, then all is silent; or it is unsupported, and all goes on."""
    reply = device.command(CommandCode.ENTER_DFU, ENTER_DFU_KEY)
    if reply.ack.code == AckCode.UNSUPPORTED:
        device.get_status()
        return
    expect(reply.ack.code == AckCode.OK, "ok, or unsupported", code_name(reply.ack.code), reply.frame)
    device.gone = True
    device.receive(0.1)
    late = device.receive(LEAVE_S)
    expect(not late, "silence after the ACK", f"{len(late)} frames", *late[:1])
    expect(device.try_command(CommandCode.GET_INFO) is None, "no answer from the boot loader", "an ACK")
