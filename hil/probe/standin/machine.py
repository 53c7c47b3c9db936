"""`machine` for MicroPython's unix port, as far as the probe uses it: an emulated MCU's pins, SPI and ADC."""

import os

import link


class _Cpu:
    def __getattr__(self, name):
        return name


class Pin:
    """A pin by the MCU's name, as Pin.cpu.A5."""

    IN, OUT = "in", "out"
    PULL_NONE, PULL_UP, PULL_DOWN = "none", "up", "down"
    cpu = _Cpu()

    def __init__(self, name, mode, pull=PULL_NONE, value=None):
        self._name = name
        if value is not None:
            self.value(value)
        self.init(mode, pull)

    def init(self, mode, pull=PULL_NONE):
        link.tell(f"mode {self._name} {mode} {pull}")

    def value(self, level=None):
        if level is None:
            return int(link.ask(f"level {self._name}"))
        return link.tell(f"drive {self._name} {level}")


class SoftSPI:
    """Exchanges bytes with the emulated string; leaves MISO without a pull, as that of the STM32 does."""

    def __init__(self, baudrate=500000, *, polarity=0, phase=0, sck, mosi, miso):
        link.tell(f"mode {sck} out none")
        link.tell(f"mode {mosi} out none")
        link.tell(f"mode {miso} in none")
        self._pins = f"{sck} {mosi} {miso} {polarity} {phase} {baudrate}"

    def write_readinto(self, send, receive):
        answer = link.ask(f"spi {self._pins} {send.hex()}")
        receive[:] = bytes.fromhex(answer)


if not os.getenv("PROBE_WITHOUT_ADC"):

    class ADC:
        """The internal reference in 1/65535 of the supply."""

        CORE_VREF = 17

        def __init__(self, channel):
            self._channel = channel

        def read_u16(self):
            return int(link.ask(f"adc {self._channel}"))

    class _Memory:
        def __getitem__(self, address):
            return int(link.ask(f"memory {address}"))

    mem16 = _Memory()
