"""Which moment is shown: the newest, or one that was chosen, from which it may play on."""

import threading

import numpy as np

from ribbonhost.view.history import History


class Playhead:
    """Follows a stream, or plays what is kept.

    Attributes:
        follows: the newest moment is shown, whatever comes; never so in a recording.
        playing: time goes on.
        speed: times real time, when it does not follow.
        t_s: the time that is shown.
    """

    def __init__(self, history: History, *, live: bool, start_s: float = 0.0, speed: float = 1.0) -> None:
        """live: the stream goes on, and positions are told from when it was paused; otherwise from 0."""
        self.live = live
        self.follows = live
        self.playing = True
        self.speed = speed
        self.t_s = start_s
        self._history = history
        self._now_s = 0.0
        self._lock = threading.Lock()

    @property
    def position_s(self) -> float:
        """Where the slider stands."""
        return self.t_s - self._now_s

    @property
    def range_s(self) -> tuple[float, float]:
        """Between which positions it can stand."""
        first_s, last_s = self._history.span_s
        if np.isnan(first_s):
            return 0.0, 0.0
        return (min(first_s - self._now_s, 0.0), 0.0) if self.live else (0.0, last_s)

    def advance(self, dt_s: float) -> None:
        """Lets time pass."""
        with self._lock:
            first_s, last_s = self._history.span_s
            if np.isnan(first_s):
                return
            if self.follows:
                self.t_s = self._now_s = last_s
            elif self.playing:
                self.t_s = self.t_s + self.speed * dt_s
                if self.t_s >= last_s:
                    self.follows = self.live
                    self.t_s = last_s if self.live else first_s
            self.t_s = min(max(self.t_s, first_s), last_s)

    def toggle(self) -> None:
        """Pauses what goes on, and lets go on what is paused."""
        with self._lock:
            self.playing = not self.playing
            self.follows = False

    def follow(self) -> None:
        """Shows the newest from now on; in a recording, begins anew."""
        with self._lock:
            self.playing = True
            self.follows = self.live
            if not self.live:
                self.t_s = 0.0

    def seek(self, position_s: float) -> None:
        """Pauses at a position of the slider."""
        with self._lock:
            self.playing = self.follows = False
            self.t_s = self._now_s + position_s
