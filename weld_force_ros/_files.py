"""User cache, and the only place that writes a file whole: under a temporary name, then renamed.

Another process sees the old file or all of the new one, never a part. Every function raises OSError and leaves nothing
behind when it does; what a killed process leaves ends in `TEMPORARY`.
"""

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import platformdirs

TEMPORARY = ".part"
"""The ending of a file's or folder's name while it is written."""


def cache_folder(kind: str) -> Path:
    """Return the user's cache folder for one kind of file; it may not exist yet.

    For a user without a home the folder cannot be made, so that writing to it raises OSError.
    """
    try:
        return platformdirs.user_cache_path("weld_force_ros") / kind
    except RuntimeError:
        return Path(os.devnull) / kind


@contextmanager
def whole_file(path: Path, *, fsync: bool = False) -> Iterator[BinaryIO]:
    """Give a stream to a temporary file beside `path`, which takes the place of `path` once all is written.

    Args:
        path: the file, in a folder that exists.
        fsync: force the file, and the name that it has then, to the disk.

    Raises:
        OSError: the file cannot be written.
    """
    temporary = _temporary(path)
    try:
        with temporary.open("xb") as stream:
            yield stream
            if fsync:
                stream.flush()
                os.fsync(stream.fileno())
        temporary.replace(path)
        if fsync:
            sync_folder(path.parent)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_whole(path: Path, data: bytes, *, fsync: bool = False) -> None:
    """Write a file as `whole_file` does; its folder is made if need be.

    Raises:
        OSError: the folder cannot be made or written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path, fsync=fsync) as stream:
        stream.write(data)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Give a temporary folder beside `path`, which gets the name `path`, forced to the disk, once all in it is written.

    Args:
        path: the new folder; nothing but an empty folder may have this name.

    Raises:
        OSError: the folder cannot be made or written.
    """
    temporary = _temporary(path.with_name(f".{path.resolve().name}"))
    temporary.mkdir(parents=True)
    try:
        yield temporary
        temporary.rename(path)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    sync_folder(path.resolve().parent)


def sync_folder(folder: Path) -> None:
    """Force the names of the files in a folder to the disk; not on Windows, which opens no folders.

    Raises:
        OSError: the folder cannot be opened or forced to the disk.
    """
    if not hasattr(os, "O_DIRECTORY"):
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _temporary(path: Path) -> Path:
    return path.with_name(f"{path.name}.{secrets.token_hex(4)}{TEMPORARY}")
