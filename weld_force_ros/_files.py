"""What is kept between runs in the user's cache folder: whole files or none, and nothing that cannot be made again."""

import contextlib
import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, BinaryIO

import platformdirs

from weld_force_ros.errors import BagError, InputError


def folder(kind: str) -> Path:
    """The folder for one kind of file; for a user without a home one that cannot be made, as any OSError will say."""
    try:
        return platformdirs.user_cache_path("weld_force_ros") / kind
    except RuntimeError:
        return Path(os.devnull) / kind


def write_whole(data: bytes, path: Path) -> None:
    """Write a file so that another process sees all of it or nothing.

    Raises:
        OSError: the folder cannot be made or written; nothing is left behind.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        Path(name).chmod(0o644)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


PART = ".part"
"""What the name of a file ends in while it is written."""
NO_ROOM = (errno.ENOSPC, errno.EDQUOT)
"""What the operating system says of a full disk, and of a user's full share of it."""


@contextmanager
def as_bag_error(path: Path, remedy: str = "choose another place or free space") -> Iterator[None]:
    """Turn what the operating system refuses into a BagError about `path`."""
    try:
        yield
    except OSError as error:
        raise BagError(f"{path}: {error.strerror or error}", remedy) from error


@contextmanager
def new_file(path: Path) -> Iterator[BinaryIO]:
    """Write beside, force to the disk, and only then name: who looks finds the old file or all of the new one."""
    part = path.with_name(f"{path.name}{PART}")
    try:
        with part.open("wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(path)
        sync_folder(path.parent)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A folder that gets its name once all in it is written.

    Raises:
        BagError: something of this name is there.
    """
    refuse_existing(path)
    part = path.with_name(f".{path.resolve().name}.{os.getpid()}{PART}")
    part.mkdir(parents=True)
    try:
        yield part
        part.rename(path)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise
    sync_folder(path.resolve().parent)


def refuse_existing(path: Path) -> None:
    """Raise a BagError if something is there: recordings are never overwritten."""
    if path.exists():
        raise BagError(f"{path} exists and is not overwritten", "choose another name or remove it")


def sync_folder(directory: Path) -> None:
    """Force to the disk what files a folder has."""
    handle = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextlib.contextmanager
def writing(path: Path) -> Iterator[IO[str]]:
    """A text file, its folder made.

    Raises:
        InputError: the place cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w", encoding="utf-8") as file:
            yield file
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}", "name a file in a writable folder") from None
