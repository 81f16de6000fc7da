"""The exceptions of the package: one class for each kind of error of the library, with the library's message.

All of them are :class:`EcmError`. ``slave`` is the slave that an error is about, ``code`` the error code of an alarm or the
abort code of an SDO transfer; both are ``None`` if the error has none.
"""

from __future__ import annotations

import builtins
from typing import Optional


class EcmError(Exception):
    """An error of the board, of its network, or of a call. The message ends with what to do."""

    def __init__(self, message: str, slave: Optional[int] = None, code: Optional[int] = None) -> None:
        super().__init__(message)
        self.slave = slave
        self.code = code


class LinkError(EcmError):
    """The link to the board failed."""


class UriError(LinkError, ValueError):
    """The URI of a link, or one of its keys, is wrong."""


class NoBoardError(LinkError):
    """No board answers behind the link."""


class InUseError(LinkError):
    """Another program, or another link of this one, has the board open."""


class LostError(LinkError):
    """The board is gone: unplugged, or reset. Open it again."""


class ClosedError(LinkError):
    """The board was closed, by this thread or another one, or the stream has ended."""


class ConfigError(EcmError, ValueError):
    """The configuration cannot be used. Nothing of it was sent."""


class MachineFileError(EcmError, ValueError):
    """The machine file cannot be used."""


class NoSuchAxisError(EcmError, LookupError):
    """No axis has this name."""


class SlotUnknownError(EcmError):
    """The link does not know the slot size, and reports did not show it."""


class SettingError(EcmError, ValueError):
    """The value of an option or of a parameter is not allowed."""


class NoReportError(EcmError):
    """The board has made no usable report."""


class TimeoutError(EcmError, builtins.TimeoutError):
    """Reports did not show the effect of the call in time."""


class StateStuckError(EcmError):
    """A change of state ended in another state; the message names the slave that probably prevented it."""


class WrongStateError(EcmError):
    """The call is not allowed in the present state of the network."""


class SlaveCountError(EcmError):
    """The network and the configuration have different numbers of slaves."""


class NoSuchSlaveError(EcmError, LookupError):
    """No slave with that number is configured."""


class WrongKindError(EcmError):
    """The call is not for this kind of slave."""


class WrongModeError(EcmError):
    """The axis is configured for another mode."""


class SdoAbortedError(EcmError):
    """A slave refused an SDO transfer; ``code`` is the abort code."""


class SdoTooWideError(EcmError):
    """The value of an object does not fit the type with which it was read."""


class NotEnabledError(EcmError):
    """The axis is not in Operation enabled."""


class SecondOffError(EcmError):
    """The first channel of a pulse module is switched on, the second one is not."""


class SlaveLostError(EcmError):
    """A slave was lost in OP."""


class TooDeepError(EcmError):
    """The depth of a stream is too large for its axes to be stopped in time."""


class AlarmError(EcmError):
    """The drive has an alarm; ``code`` is its error code (0x603F)."""


class TooFarError(EcmError):
    """The guard of the axis refused a target."""


class SoftLimitError(EcmError):
    """A target is beyond the soft limits of its axis."""


class OutOfRangeError(EcmError, ValueError):
    """A position in units does not fit the 32 bits of the wire."""


class ClearedError(EcmError):
    """The FIFO was cleared while the stream was open."""


class IsHomingError(EcmError):
    """The axis is homing, and takes no other command until that ends."""


class HomingFailedError(EcmError):
    """Homing ended without "homing attained"."""


class BusyError(EcmError):
    """Another thread uses what the call needs, or a call of this thread does."""


class RecordingError(EcmError):
    """A recording cannot be read."""
