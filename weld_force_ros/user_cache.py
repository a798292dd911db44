"""What is kept between runs in the user's cache folder: whole files or none, and nothing that cannot be made again."""

import os
import tempfile
from pathlib import Path

import platformdirs


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
