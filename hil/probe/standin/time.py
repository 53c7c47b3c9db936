"""`time` for MicroPython's unix port, as far as the probe uses it: the time of the emulated string."""

import link

_WRAP = 1 << 30


def ticks_us():
    return int(link.ask("time")) % _WRAP


def ticks_add(ticks, delta):
    return (ticks + delta) % _WRAP


def ticks_diff(end, start):
    return (end - start + _WRAP // 2) % _WRAP - _WRAP // 2


def sleep_us(us):
    link.tell(f"sleep {us}")
