"""Whether a device is emulated is told from what it says of itself, over whatever link."""

import dataclasses

import pytest
from conformance.responder import Responder
from ribbonhil.emulated_device import drawn_device
from ribbonhil.ran_on import Kind, RanOn, kind_of
from ribbonhost.wire import Board, Info

A_PYBOARD = bytes.fromhex("2f0020000351343134383038")


def info(board: int, unique_id: bytes) -> Info:
    return dataclasses.replace(Responder().info(), board=board, unique_id=unique_id)


@pytest.mark.parametrize(
    ("board", "unique_id", "kind"),
    [
        (Board.HOST, drawn_device(0, 1).unique_id, Kind.MODULE),
        (Board.HOST, A_PYBOARD, Kind.MODULE),
        (Board.PYBOARD_V11, drawn_device(0, 1).unique_id, Kind.IMAGE),
        (Board.FEATHER_F405, drawn_device(5, 0).unique_id, Kind.IMAGE),
        (Board.PYBOARD_V11, A_PYBOARD, Kind.HARDWARE),
        (Board.FEATHER_F405, A_PYBOARD, Kind.HARDWARE),
        (Board.PYBOARD_V11, bytes(range(12)), Kind.UNKNOWN),
        (77, A_PYBOARD, Kind.UNKNOWN),
    ],
)
def test_kind_follows_from_info(board: int, unique_id: bytes, kind: Kind) -> None:
    device = RanOn("/dev/ttyACM0", info(board, unique_id))
    assert kind_of(device.info) is device.kind is kind
    assert device.as_json()["is_hardware"] is (kind is Kind.HARDWARE)
    assert str(device).startswith(
        {
            Kind.MODULE: "emulated module, firmware 1.2.3, serial number ",
            Kind.IMAGE: "emulated STM32F405 that runs the image 1.2.3 for ",
            Kind.HARDWARE: "hardware: ",
            Kind.UNKNOWN: "a device not known to be hardware: ",
        }[kind]
    )


def test_every_emulated_device_is_marked_and_its_own() -> None:
    devices = [drawn_device(seed, index) for seed in range(20) for index in range(7)]
    assert len({device.serial for device in devices}) == len(devices)
    assert all(device.unique_id.endswith(b"EMUL") for device in devices)
