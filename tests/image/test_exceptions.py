"""Exceptions of the core: the model and QEMU agree on every line, and the lines are what Arm says."""

from image.programs import built
from image.qemu import Qemu
from ribbonhil.stm32f405.elf import read_elf
from ribbonhil.stm32f405.mcu import Mcu

# Armv7-M Architecture Reference Manual: B1.5.8 for EXC_RETURN, B1.5.4 for priorities, B3.2.15 for CFSR.
# The digits of an order are events: 2 and 3 begin and end the slow handler, 1 is the fast one, e is PendSV.
EXPECTED = {
    "svc_result": 105,
    "svc_argument": 42,
    "svc_exc_return_thread_msp": 0xFFFFFFF9,
    "svc_exc_return_with_fp": 0xFFFFFFE9,
    "control_fpca": 4,
    "pendsv_at_once": 1,
    "pendsv_under_primask": 1,
    "pendsv_pending": 1,
    "pendsv_after_primask": 2,
    "order_under_basepri": 0,
    "order_after_basepri": 0x213,
    "order_nested": 0x213,
    "depth_nested": 2,
    "order_one_after_the_other": 0x231,
    "depth_one_after_the_other": 1,
    "order_of_equals": 0x1231E,
    "process_stack_used": 1,
    "process_svc_result": 107,
    "process_exc_return": 0xFFFFFFFD,
    "wrong_under_ticks": 0,
    "many_ticks": 1,
    "bus_fault_at_its_instruction": 1,
    "bus_fault_cfsr": 0x8200,
    "undefined_at_its_instruction": 1,
    "undefined_cfsr": 0x10000,
    "unaligned_load": 0x55443322,
    "wfe_returns": 3,
    "end": 0,
}


def lines(output: bytes) -> dict[str, int]:
    """Names and values of the whole lines."""
    return {name: int(value, 16) for name, value in (line.split() for line in output.decode().splitlines())}


def test_model_does_what_the_architecture_says() -> None:
    with Mcu(read_elf(built("exceptions", core=False)).image) as mcu:
        mcu.run_until(0.3)
        assert lines(mcu.read()) == EXPECTED
        assert mcu.counters.fp_frames > 100
        assert mcu.violation == ""


def test_qemu_agrees() -> None:
    with Qemu(built("exceptions", core=False)) as qemu:
        assert lines(qemu.run_until(lambda output: output.endswith(b"end 00000000\n"))) == EXPECTED
