"""Errors about where a recording is written: what the disk reports, and names that are taken."""

from contextlib import AbstractContextManager
from pathlib import Path

from weld_force_ros.errors import BagError, os_errors_as


def as_bag_error(path: Path, remedy: str = "choose another place or free space") -> AbstractContextManager[None]:
    """Raise an OSError as a BagError about `path`."""
    return os_errors_as(BagError, path, remedy)


def refuse_existing(path: Path) -> None:
    """Raise a BagError if something is there: recordings are never overwritten."""
    if path.exists():
        raise refusal_to_overwrite(path)


def refusal_to_overwrite(path: Path) -> BagError:
    """Return the error that something is there already."""
    return BagError(f"{path} exists and is not overwritten", "choose another name or remove it")
