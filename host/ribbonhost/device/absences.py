"""When the link of a device was gone."""


class Absences:
    """How often and for how long; written by one thread.

    Attributes:
        count: how often the link was lost.
        since_s: host time at which it was lost; None while it is there.
    """

    def __init__(self) -> None:
        self.count = 0
        self.since_s: float | None = None
        self._ended_s = 0.0

    def begin(self, t_host_s: float) -> None:
        """The link is gone."""
        self.count += 1
        self.since_s = t_host_s

    def end(self, t_host_s: float) -> float:
        """The link is there again; returns for how long it was gone, seconds."""
        gone_s = 0.0 if self.since_s is None else t_host_s - self.since_s
        self._ended_s += gone_s
        self.since_s = None
        return gone_s

    def total_s(self, now_s: float) -> float:
        """For how long it was gone, all in all, until a host time."""
        return self._ended_s + (0.0 if self.since_s is None else max(0.0, now_s - self.since_s))
