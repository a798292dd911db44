"""The container file: what it copies is there and suffices; its steps after apt's run in a like environment.

No image is built: that takes a registry of images.
"""

import os
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
INSTALLED = re.search(r"pip install --no-cache-dir '/src(\[.*?\])' '(.*)'", TEXT)
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
    below, above, source = tmp_path / "apt", tmp_path / "opt", tmp_path / "src"
    outer = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    source.mkdir()
    for name in COPIED:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, source / name)

    def run(*command: str | Path) -> str:
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, env=outer)
        assert done.returncode == 0, done.stderr
        return done.stdout

    for environment in (below, above):
        run(sys.executable, "-m", "venv", environment)
    run(below / "bin/pip", "install", "--quiet", *OF_UBUNTU)
    (of_apt,) = below.glob("lib/python*/site-packages")
    (own,) = above.glob("lib/python*/site-packages")
    (own / "apt.pth").write_text(str(of_apt))  # as --system-site-packages does
    run(above / "bin/pip", "install", "--quiet", f"{source}{INSTALLED[1]}", INSTALLED[2])
    versions = "import numpy, scipy; print('numpy==' + numpy.__version__, 'scipy==' + scipy.__version__)"
    assert tuple(run(above / "bin/python", "-c", versions).split()) == OF_UBUNTU
    run(above / "bin/weld-force", "simulate", "weld-1-dip", "--uncertainty-samples", "0", "--json", "force_map.json")
