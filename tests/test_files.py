"""Files written whole: others see the old content or all of the new, and nothing is left behind."""

import threading
from pathlib import Path

import pytest

from weld_force_ros._files import TEMPORARY, whole_file, whole_folder, write_whole


def test_a_file_keeps_its_old_content_until_the_new_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"old")
    with whole_file(path, fsync=True) as stream:
        stream.write(b"new")
        stream.flush()
        assert path.read_bytes() == b"old"
        assert [name.suffix for name in tmp_path.iterdir() if name != path] == [TEMPORARY]
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


def test_what_fails_leaves_the_old_content_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"old")
    with pytest.raises(TypeError), whole_file(path) as stream:
        stream.writelines([b"new", "no bytes"])  # type: ignore[list-item]
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_several_writers_of_one_file_do_not_mix(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "file"
    contents = [bytes([letter]) * 100_000 for letter in b"abcd"]
    writers = [threading.Thread(target=write_whole, args=(path, content)) for content in contents]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert path.read_bytes() in contents
    assert list(path.parent.iterdir()) == [path]


def test_only_write_whole_makes_the_folder(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), whole_file(tmp_path / "none" / "file"):
        pass
    assert not list(tmp_path.iterdir())


def test_a_folder_appears_with_all_its_files_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "folder"
    with pytest.raises(TypeError), whole_folder(path) as folder:
        (folder / "file").write_bytes("no bytes")  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())
    with whole_folder(path) as folder:
        (folder / "file").touch()
        assert not path.exists()
    assert list(tmp_path.rglob("*")) == [path, path / "file"]
