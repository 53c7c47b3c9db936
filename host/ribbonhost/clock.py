"""When a device's clock says t_us, what does the host's clock say: offset and drift from ping exchanges.

An exchange gives four times, as in NTP (RFC 5905, section 8): the host sends at T1, the device receives at
T2 and answers at T3, the host receives at T4. The middle of T1 and T4 on the host's clock is the middle of
T2 and T3 on the device's, but for half the difference of the two travel times. That difference is at most
the time by which the round trip was longer than the shortest possible one (Cristian, "Probabilistic clock
synchronization", Distributed Computing 3, 1989), so an exchange is trusted by how little its round trip
exceeds the shortest one in the window.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

WRAP_US = 1 << 32
WINDOW = 128
"""Exchanges that the fit rests on."""

SIGMA_MIN_S = 30e-6
"""Standard deviation of the best exchange: scheduling on both sides."""

SIGMA_DRIFT = 1e-3
"""Prior standard deviation of a drift of which nothing is known."""

STEP_S = 0.05
"""An exchange further off than this and its own uncertainty is no noise: the clock was set anew or lies."""

STEP_EXCHANGES = 3
"""So many such exchanges in a row mean that the clock was set anew."""


def extend_us(t_us: int, near_us: int) -> int:
    """The 64-bit device time that is congruent to `t_us` modulo 2^32 and nearest to `near_us`."""
    return near_us + (t_us - near_us + WRAP_US // 2) % WRAP_US - WRAP_US // 2


@dataclass(frozen=True)
class Exchange:
    """One ping and its pong: (T1 + T4) / 2 in seconds, (T2 + T3) / 2 in microseconds, the time on the way."""

    t_host_s: float
    t_device_us: float
    round_trip_s: float


@dataclass(frozen=True)
class _Fit:
    """t_host_s = host_s + (t_device_us - device_us) * 1e-6 * (1 + drift)."""

    host_s: float
    device_us: float
    drift: float


class DeviceClock:
    """The clock of one device as seen from the host.

    One thread may add exchanges while others convert times.

    Attributes:
        sigma_drift: prior standard deviation of the drift, so that a fit over the first fraction of a second
            does not invent one.
        restarts: how often the clock was found to be set anew, as after a reset of the device.
    """

    def __init__(self) -> None:
        self.sigma_drift = SIGMA_DRIFT
        self.restarts = 0
        self._exchanges: deque[Exchange] = deque(maxlen=WINDOW)
        self._steps: list[Exchange] = []
        self._fit: _Fit | None = None
        self._last_us: int | None = None

    @property
    def synced(self) -> bool:
        """Whether times can be converted."""
        return self._fit is not None

    @property
    def drift_ppm(self) -> float:
        """How much longer a device second is than a host second, parts per million; 0 until synced."""
        return self._fit.drift * 1e6 if self._fit else 0.0

    @property
    def round_trip_s(self) -> float:
        """The shortest round trip in the window; half of it bounds the offset's error. NaN until synced."""
        return min((e.round_trip_s for e in tuple(self._exchanges)), default=float("nan"))

    def restart(self) -> None:
        """Forgets everything: the device's clock started anew."""
        self.restarts += 1
        self._exchanges.clear()
        self._steps = []
        self._fit = None
        self._last_us = None

    def extend(self, t_us: int, t_host_s: float) -> int:
        """The 64-bit extension of `t_us`, which was received at about `t_host_s`.

        Until synced it is the nearest to the one before; then the nearest to what the clock must read now,
        so that neither a long silence nor one absurd value leads astray.
        """
        if self._fit:
            near_us = round(self.t_device_us(t_host_s))
        else:
            near_us = t_us if self._last_us is None else self._last_us
        self._last_us = extend_us(t_us, near_us)
        return self._last_us

    def t_host_s(self, t_device_us: float) -> float:
        """Host time at a 64-bit device time; NaN until synced."""
        fit = self._fit
        if fit is None:
            return float("nan")
        return fit.host_s + (t_device_us - fit.device_us) * 1e-6 * (1 + fit.drift)

    def t_device_us(self, t_host_s: float) -> float:
        """64-bit device time at a host time; NaN until synced."""
        fit = self._fit
        if fit is None:
            return float("nan")
        return fit.device_us + (t_host_s - fit.host_s) / (1e-6 * (1 + fit.drift))

    def add_exchange(self, t1_s: float, t2_us: int, t3_us: int, t4_s: float) -> bool:
        """Takes one exchange; the device times are 64-bit extensions of the same epoch.

        Returns False for one that is impossible or that contradicts the others; after STEP_EXCHANGES of the
        latter in a row the clock restarts from them.
        """
        round_trip_s = (t4_s - t1_s) - (t3_us - t2_us) * 1e-6
        if t3_us < t2_us or t4_s < t1_s or round_trip_s < 0:
            return False
        exchange = Exchange((t1_s + t4_s) / 2, (t2_us + t3_us) / 2, round_trip_s)
        if (
            self._fit
            and abs(self.t_host_s(exchange.t_device_us) - exchange.t_host_s) > STEP_S + round_trip_s / 2
        ):
            self._steps.append(exchange)
            if len(self._steps) < STEP_EXCHANGES:
                return False
            steps = self._steps
            self.restart()
            self._exchanges.extend(steps)
        else:
            self._steps = []
            self._exchanges.append(exchange)
        self._fit = _fit(self._exchanges, self.sigma_drift)
        return True


def _fit(exchanges: deque[Exchange], sigma_drift: float) -> _Fit:
    """Weighted straight line through the exchanges; Cauchy weights hold outliers down."""
    newest = exchanges[-1]
    device_s = np.array([(e.t_device_us - newest.t_device_us) * 1e-6 for e in exchanges])
    offset_s = np.array([e.t_host_s - newest.t_host_s for e in exchanges]) - device_s
    round_trip_s = np.array([e.round_trip_s for e in exchanges])
    sigma_s = SIGMA_MIN_S + (round_trip_s - round_trip_s.min()) / 2
    weight = 1 / sigma_s**2
    for _ in range(3):
        total = weight.sum()
        device_mean_s = float(weight @ device_s / total)
        offset_mean_s = float(weight @ offset_s / total)
        x = device_s - device_mean_s
        drift = float((weight * x) @ (offset_s - offset_mean_s) / ((weight * x) @ x + 1 / sigma_drift**2))
        residual = (offset_s - offset_mean_s - drift * x) / (3 * sigma_s)
        weight = 1 / (sigma_s**2 * (1 + residual**2))
    return _Fit(
        newest.t_host_s + device_mean_s + offset_mean_s, newest.t_device_us + device_mean_s * 1e6, drift
    )
