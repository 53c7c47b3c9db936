"""The sensor string at the MCU's pins: the chain of flip-flops that selects one slot, and SPI."""

import time

import hardware
from machine import Pin, SoftSPI

# The pins of the string are those of a hardware SPI on one board only, and slow edges forgive more.
BAUD = 500_000
SELECT = 0  # an output that is low selects its slot
RELEASE = 1
SETTLE_US = 100


def _pin(name):
    # By the MCU's name: a board may call another of its pins A5.
    return getattr(Pin.cpu, hardware.PINS[name])


class SensorString:
    """Between two calls no slot is selected."""

    def __init__(self, slots):
        self.slots = slots
        self._clock = Pin(_pin("SEL_CLK"), Pin.OUT, value=0)
        self._data = Pin(_pin("SEL_DATA"), Pin.OUT, value=1)
        self.release()
        sck, mosi, miso = _pin("SPI_SCK"), _pin("SPI_MOSI"), _pin("SPI_MISO")
        self._spi = SoftSPI(baudrate=BAUD, polarity=1, phase=1, sck=sck, mosi=mosi, miso=miso)
        self._miso = Pin(miso, Pin.IN, Pin.PULL_UP)

    def _pulse(self, level):
        self._data.value(level)
        self._clock.value(1)
        self._clock.value(0)

    def release(self):
        """Fills the chain with ones, also one twice as long as expected: its flip-flops may hold anything."""
        for _ in range(2 * self.slots):
            self._pulse(RELEASE)

    def miso_levels(self):
        """What MISO reads while nothing is selected, with the MCU's pull-up and with its pull-down."""
        levels = []
        for pull in (Pin.PULL_DOWN, Pin.PULL_UP):
            self._miso.init(Pin.IN, pull)
            time.sleep_us(SETTLE_US)
            levels.append(self._miso.value())
        down, up = levels
        return up, down

    def exchange(self, command):
        """Sends a command byte and what follows it; returns what came meanwhile, the command byte's not."""
        answer = bytearray(len(command))
        self._spi.write_readinto(command, answer)
        return bytes(answer[1:])

    def walk(self, commands, after=None):
        """One transaction a place along the chain, none where the command is None; the answers, or None.

        after: called after every transaction. Fewer commands than slots leave a slot selected.
        """
        answers = []
        self._pulse(SELECT)
        for command in commands:
            answers.append(self.exchange(command) if command else None)
            if after:
                after()
            self._pulse(RELEASE)
        return answers
