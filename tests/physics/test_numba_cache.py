"""A start compiles nothing that was compiled before, wherever the package is installed and whoever runs it."""

import errno
import importlib
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
import platformdirs
import pytest
from numba.core import event

import weld_force_ros
from weld_force_ros import _files
from weld_force_ros.physics._numba_cache import compiled
from weld_force_ros.simulation import fit_store, track_file

PACKAGE = Path(weld_force_ros.__file__).parent

KERNEL = """
from weld_force_ros.physics._numba_cache import compiled
from science.parts import law

@compiled(nogil=True)
def scaled(x):
    return law.FACTOR * x
"""


@pytest.fixture
def science(tmp_path, monkeypatch) -> Iterator[Callable[[float], Any]]:
    """Installs a package whose kernel compiles in a factor, which reaches it through two other modules; imports it."""
    monkeypatch.syspath_prepend(tmp_path / "installed")
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # two versions within a second look the same to Python
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))

    def forget() -> None:
        for name in [name for name in sys.modules if name.partition(".")[0] == "science"]:
            del sys.modules[name]
        importlib.invalidate_caches()

    def install(factor: float) -> Any:
        package = tmp_path / "installed" / "science"
        (package / "parts").mkdir(parents=True, exist_ok=True)
        (package / "__init__.py").touch()
        (package / "parts" / "__init__.py").touch()
        (package / "_kernel.py").write_text(KERNEL)
        (package / "parts" / "law.py").write_text("from ..numbers import FACTOR\n")
        (package / "numbers.py").write_text(f"FACTOR = {factor}\n")
        forget()
        return importlib.import_module("science._kernel")

    yield install
    forget()


def called(kernel: Any, argument: float) -> tuple[float, int]:
    """What a freshly started process would get, and how many functions it would compile for that."""
    function = compiled(nogil=True)(kernel.scaled.py_func)
    with event.install_recorder("numba:compile") as recorder:
        result = function(argument)
    return result, sum(found.is_start for _, found in recorder.buffer)


def machine_code(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.nbc"))


def test_the_next_start_compiles_nothing_for_signatures_seen(science, tmp_path):
    kernel = science(2.0)
    assert [called(kernel, 1.5), called(kernel, 3)] == [(3.0, 1), (6.0, 1)]
    assert [called(kernel, 1.5), called(kernel, 3)] == [(3.0, 0), (6.0, 0)]
    assert {path.parent.name for path in machine_code(tmp_path)} == {"__pycache__"}


def test_a_change_in_a_module_at_second_hand_is_compiled_and_takes_the_stale_codes_place(science, tmp_path):
    called(science(2.0), 1.5)
    changed = science(5.0)
    assert called(changed, 1.5) == (7.5, 1)
    assert called(changed, 1.5) == (7.5, 0)
    assert len(machine_code(tmp_path)) == 1


@pytest.mark.parametrize(
    "damage",
    [
        lambda whole: b"",
        lambda whole: whole[: len(whole) // 2],
        lambda whole: whole[: len(whole) // 2] + bytes([whole[len(whole) // 2] ^ 1]) + whole[len(whole) // 2 + 1 :],
        lambda whole: b"something else",
    ],
    ids=["empty", "cut", "one bit", "foreign"],
)
def test_damaged_machine_code_is_compiled_again(science, tmp_path, damage):
    kernel = science(2.0)
    called(kernel, 1.5)
    (file,) = machine_code(tmp_path)
    file.write_bytes(damage(file.read_bytes()))
    assert called(kernel, 1.5) == (3.0, 1)
    assert called(kernel, 1.5) == (3.0, 0)


def read_only_installation(tmp_path: Path) -> None:
    # Not by permissions, which do not bind root: a file stands where the folder would have to be.
    (tmp_path / "installed" / "science" / "__pycache__").touch()


def test_a_read_only_installation_keeps_machine_code_in_the_users_cache(science, tmp_path):
    kernel = science(2.0)
    read_only_installation(tmp_path)
    assert [called(kernel, 1.5), called(kernel, 1.5)] == [(3.0, 1), (3.0, 0)]
    assert len(machine_code(tmp_path / "home" / "weld_force_ros")) == 1


def test_a_read_only_installation_shares_the_machine_code_that_came_with_it(science, tmp_path, monkeypatch):
    kernel = science(2.0)
    called(kernel, 1.5)

    def read_only(path: Path, data: bytes) -> None:
        raise PermissionError(errno.EACCES, "read-only", str(path))

    monkeypatch.setattr(_files, "write_whole", read_only)
    assert called(kernel, 1.5) == (3.0, 0)


def test_nowhere_to_write_costs_compilation_and_nothing_else(science, tmp_path):
    kernel = science(2.0)
    read_only_installation(tmp_path)
    (tmp_path / "home").touch()
    assert [called(kernel, 1.5), called(kernel, 1.5)] == [(3.0, 1), (3.0, 1)]


def test_a_full_disk_leaves_nothing_behind(science, tmp_path, monkeypatch):
    kernel = science(2.0)

    def full(self: Path, target: Path) -> None:
        raise OSError(errno.ENOSPC, "no space left", str(target))

    monkeypatch.setattr(Path, "replace", full)
    assert called(kernel, 1.5) == (3.0, 1)
    assert not [path for path in tmp_path.rglob("*") if path.suffix in (".nbc", ".part")]


def test_numbas_own_setting_names_the_only_folder(science, tmp_path, monkeypatch):
    kernel = science(2.0)
    called(kernel, 1.5)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "named"))
    assert [called(kernel, 1.5), called(kernel, 1.5)] == [(3.0, 1), (3.0, 0)]
    assert len(machine_code(tmp_path / "named")) == 1


def test_a_user_without_a_home_gets_the_shipped_fits(monkeypatch):
    def nobody(name: str) -> Path:
        raise RuntimeError("could not determine the home directory")  # as platformdirs says it

    monkeypatch.setattr(platformdirs, "user_cache_path", nobody)
    assert fit_store.fitted(track_file.load("bilbao")).track == "bilbao"
    with pytest.raises(OSError, match=os.devnull):
        _files.write_whole(_files.cache_folder("fits") / "fit.json", b"")


STARTED = """
import weld_force_ros
from numba.core import event
with event.install_recorder("numba:compile") as importing:
    import importlib, pkgutil
    from weld_force_ros import cli, physics, recording
    for module in pkgutil.walk_packages(physics.__path__, physics.__name__ + "."):
        importlib.import_module(module.name)
    from weld_force_ros.physics.passage import _contact
    from weld_force_ros.simulation.settings import simulation_settings
    from weld_force_ros.simulation.simulator import Simulator
Simulator(simulation_settings())
with event.install_recorder("numba:compile") as calling:
    force = _contact.contact_force(4e-4, 1e-9, 1e11)
print(weld_force_ros.__file__, len(importing.buffer), len(calling.buffer) > 0, force)
"""


def test_the_package_starts_from_a_read_only_folder_without_a_home_and_compiles_nothing_on_import(tmp_path):
    copy = tmp_path / "weld_force_ros"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in (copy / "physics", copy / "physics" / "passage"):
        (folder / "__pycache__").touch()
    environment = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    environment |= {"HOME": f"{os.devnull}/home", "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", STARTED], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    where, importing, calling, force = done.stdout.split()
    assert (where, importing, calling) == (str(copy / "__init__.py"), "0", "True")
    # The contact law itself: f = hertz (free - compliance f)^(3/2).
    assert float(force) == pytest.approx(1e11 * (4e-4 - 1e-9 * float(force)) ** 1.5, rel=1e-9)
    assert not list(tmp_path.rglob("*.nbc"))


def test_the_command_line_loads_no_science_before_it_is_asked_to():
    heavy = "{'numpy', 'scipy', 'numba', 'rich', 'matplotlib', 'rclpy'} & sys.modules.keys()"
    code = f"import sys, weld_force_ros.cli.main; sys.exit(str({heavy}) if {heavy} else 0)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
