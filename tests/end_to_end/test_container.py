"""The container file: what it copies is there and suffices, and its steps after apt's run in an environment like its own.

No image is built: that takes a registry of images.
"""

import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.docs.test_commands import parse

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "Containerfile").read_text(encoding="utf-8").replace("\\\n", " ")
STEPS = [tuple(line.split(maxsplit=1)) for line in TEXT.splitlines() if line and not line.startswith("#")]
COPIED = {
    source: target
    for instruction, rest in STEPS
    if instruction == "COPY"
    for *sources, target in [rest.split()]
    for source in sources
}
INSTALLED = re.search(r"pip install --no-cache-dir '/src(\[.*?\])'", TEXT)
OF_UBUNTU = ("numpy==1.26.4", "scipy==1.11.4")  # 24.04, below ROS Jazzy


def test_the_image_is_that_of_ros_jazzy():
    assert STEPS[0] == ("FROM", "docker.io/library/ros:jazzy")


def test_what_is_copied_is_there_and_keeps_its_name():
    for source, target in COPIED.items():
        assert (ROOT / source).exists()
        assert target in ("/src/", f"/src/{source}")


def test_the_extras_exist_and_none_brings_another_ros():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert INSTALLED is not None
    asked = INSTALLED[1].strip("[]").split(",")
    assert set(asked) <= set(extras)
    assert not any("ros-jazzy" in requirement for name in asked for requirement in extras[name])


@pytest.mark.parametrize("instruction", ["RUN", "CMD"])
def test_its_commands_are_ones_that_the_program_takes(
    instruction: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "measurements").mkdir()
    lines = [re.sub(r'[\[\]",]', " ", rest) for asked, rest in STEPS if asked == instruction]
    commands = [shlex.split(line)[1:] for line in lines if line.strip().startswith("weld-force ")]
    assert commands
    for command in commands:
        parse(command)


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_its_steps_run_over_the_libraries_of_ubuntu(tmp_path: Path):
    """In an environment over another that has apt's NumPy and SciPy, from nothing but what is copied."""
    python = shutil.which("python3.12") or sys.executable
    below, above, source = tmp_path / "apt", tmp_path / "opt", tmp_path / "src"
    for name in COPIED:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        source.mkdir(exist_ok=True)
        copy(ROOT / name, source / name)

    def run(*command: str | Path) -> str:
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, env={"HOME": "."})
        assert done.returncode == 0, done.stderr
        return done.stdout

    run(python, "-m", "venv", below)
    run(below / "bin/pip", "install", "--quiet", *OF_UBUNTU)
    run(python, "-m", "venv", above)
    (found,) = below.glob("lib/python*/site-packages")
    (packages,) = above.glob("lib/python*/site-packages")
    (packages / "apt.pth").write_text(str(found))  # as --system-site-packages does
    run(above / "bin/pip", "install", "--quiet", f"{source}{INSTALLED[1]}")
    assert run(
        above / "bin/python", "-c", "import numpy, scipy; print(numpy.__version__, scipy.__version__)"
    ).split() == [requirement.partition("==")[2] for requirement in OF_UBUNTU]
    run(above / "bin/weld-force", "simulate", "weld-1-dip", "--uncertainty-samples", "0", "--json", "force_map.json")
