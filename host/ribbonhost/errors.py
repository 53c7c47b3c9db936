"""Everything that can go wrong for a user, each with the exit code that a command ends with."""

from typing import ClassVar


class RibbonError(Exception):
    """What went wrong, as one sentence for a person that says what was found and what to do."""

    exit_code: ClassVar[int] = 1


class UsageError(RibbonError):
    """What was typed, or a file that was given, cannot be meant."""

    exit_code = 2


class CombFileError(UsageError):
    """A comb file that describes no comb."""


class LinkError(RibbonError):
    """A port cannot be opened or used."""


class LinkLostError(LinkError):
    """A port that was open is gone."""


class DeviceError(RibbonError):
    """A device answers, but not as it must."""


class NoAnswerError(DeviceError):
    """Nothing on the link speaks the protocol."""


class WireVersionError(DeviceError):
    """The device needs a host that speaks a later version of the protocol."""


class CommandTimeoutError(DeviceError):
    """A command was repeated and never acknowledged."""


class CommandRefusedError(DeviceError):
    """A command was acknowledged with a code other than ok.

    Attributes:
        code: the code, one of `ribbonhost.wire.AckCode` if this host knows it.
    """

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


class MissingExtraError(RibbonError):
    """A library that only some commands need is not installed."""

    def __init__(self, what: str, library: str, extra: str) -> None:
        super().__init__(f'{what} needs {library}: type `pip install "ribbonhost[{extra}]"`')


class RecordingError(RibbonError):
    """A recording that cannot be written or read."""


class CalibrationError(RibbonError):
    """Data that give no calibration to be trusted."""


class ValidationError(RibbonError):
    """A recording and a truth that cannot be compared."""
