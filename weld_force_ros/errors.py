"""The package's errors. Each message is one line that says what is wrong, where, and what to do."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


class WeldForceError(Exception):
    """The base of all errors of this package.

    Attributes:
        reason: what is wrong and where.
        remedy: what the user can do about it; empty where nothing is known.

    Examples:
        >>> import weld_force_ros as wf
        >>> try:
        ...     wf.Profile([0.0, 1.0], [0.0, 0.0], weld_id="short")
        ... except wf.WeldForceError as error:
        ...     print(error)
        short: 2 samples, 20 are needed; give the whole weld, at a spacing of 10 mm or finer
    """

    def __init__(self, reason: str, remedy: str = "") -> None:
        super().__init__(reason, remedy)  # both, so that it passes from one process to another
        self.reason = reason
        self.remedy = remedy

    def __str__(self) -> str:
        return f"{self.reason}; {self.remedy}" if self.remedy else self.reason


class InputError(WeldForceError):
    """An input (profile, track, option, message, bag) that cannot be used as it stands; there is always a remedy.

    Examples:
        >>> import weld_force_ros as wf
        >>> try:
        ...     wf.Vehicle("coach")
        ... except wf.InputError as error:
        ...     print(error.reason)
        vehicle 'coach' is unknown
    """

    def __init__(self, reason: str, remedy: str) -> None:
        super().__init__(reason, remedy)


class ProfileError(InputError):
    """A weld profile that cannot be used.

    Examples:
        >>> import weld_force_ros as wf
        >>> issubclass(wf.ProfileError, wf.InputError)
        True
    """


class TrackError(InputError):
    """A track description that cannot be used.

    Examples:
        >>> import weld_force_ros as wf
        >>> try:
        ...     wf.Track("nowhere")
        ... except wf.TrackError as error:
        ...     print(error.reason)
        no track 'nowhere'
    """


class MessageError(InputError):
    """A message that breaks the contract."""


class BagError(InputError):
    """A recording that cannot be read or written.

    Examples:
        >>> import weld_force_ros as wf
        >>> try:
        ...     wf.Recording("/nowhere")
        ... except wf.BagError as error:
        ...     print(error.reason)
        /nowhere does not exist
    """


class DiskFullError(BagError):
    """A message was not recorded because the disk is full; it may be written again when there is room."""


class NumericalError(WeldForceError):
    """A computation that did not yield a usable number.

    Examples:
        >>> import weld_force_ros as wf
        >>> issubclass(wf.NumericalError, wf.WeldForceError)
        True
    """


@contextmanager
def os_errors_as(kind: type[InputError], path: "Path", remedy: str) -> Iterator[None]:
    """Raise an OSError as an error of this package: the path, what the operating system says, and what to do."""
    try:
        yield
    except OSError as error:
        raise kind(f"{path}: {error.strerror or error}", remedy) from error
