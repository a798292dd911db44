"""The package as ROS users and pip users install it: by colcon, from a wheel, editable."""

import ast
import os
import shutil
import subprocess
import sys
import tarfile
import tomllib
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

import pytest

from benchmarks.library import program
from tests.docs.pages import shown_after

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
PACKAGE = "weld_force_ros"
# In one process: what they import is the same and takes seconds.
HELP_OF_EACH = """
import runpy, sys
for command in list(sys.argv[1:]):
    sys.argv = [command, "--help"]
    try:
        runpy.run_path(command, run_name="__main__")
    except SystemExit as ended:
        if ended.code:
            raise
"""
NODES = {"profile_node", "simulator_node", "assessment_node", "trolley_node", "dashboard_node", "foxglove_node"}


def run(*command: str | Path, **options: object) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "AMENT_PREFIX_PATH")}
    return subprocess.run(
        command, capture_output=True, text=True, check=False, env=environment, **({"timeout": 120.0} | options)
    )


def install(python: Path, *what: str | Path) -> None:
    """Install into a virtual environment."""
    uv = (sys.executable, "-m", "uv", "pip", "install", "--quiet", "--python", python)
    done = run(*uv, "--constraint", ROOT / "constraints.txt", *what)
    if done.returncode and "error sending request" in done.stderr.lower():
        pytest.skip("the package index cannot be reached")
    assert done.returncode == 0, done.stderr


def virtual_environment(folder: Path) -> Path:
    """The Python of a new one, without pip."""
    done = run(sys.executable, "-m", "venv", "--without-pip", folder)
    assert done.returncode == 0, done.stderr
    return folder / "bin" / "python"


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace whose `src` holds what a clone of this checkout would."""
    folder = tmp_path_factory.mktemp("workspace")
    listed = run("git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", cwd=ROOT)
    assert listed.returncode == 0, listed.stderr
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file():
            copy = folder / "src" / PACKAGE / name
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes((ROOT / name).read_bytes())
    return folder


@pytest.fixture(scope="module")
def colcon(tmp_path_factory: pytest.TempPathFactory) -> Path:
    python = virtual_environment(tmp_path_factory.mktemp("colcon"))
    install(python, *tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]["colcon"])
    return python.with_name("colcon")


@pytest.fixture
def shares(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """For a test to set where ROS looks for packages."""
    pytest.importorskip("ament_index_python")
    return monkeypatch


def check_share(prefix: Path, patch: pytest.MonkeyPatch) -> None:
    from ament_index_python.packages import get_package_share_directory

    patch.setenv("AMENT_PREFIX_PATH", str(prefix))
    share = Path(get_package_share_directory(PACKAGE))
    assert share == prefix / "share" / PACKAGE
    sources = [
        ROOT / "package.xml",
        ROOT / "launch" / "weld_force.launch.py",
        *(ROOT / PACKAGE / "data" / "config").glob("*.yaml"),
    ]
    assert len(sources) > 2
    for source in sources:
        parts = () if source.parent == ROOT else (source.parent.name,)
        assert share.joinpath(*parts, source.name).read_bytes() == source.read_bytes()


@pytest.mark.parametrize("options", [(), ("--symlink-install",)], ids=["copied", "linked"])
def test_colcon_builds_it_and_its_commands_run(
    options: tuple[str, ...], workspace: Path, colcon: Path, shares: pytest.MonkeyPatch, tmp_path: Path
):
    base = ("--build-base", tmp_path / "build", "--install-base", tmp_path / "install")
    done = run(
        *(colcon, "--log-base", tmp_path / "log", "build", *base, "--packages-select", PACKAGE, *options), cwd=workspace
    )
    assert done.returncode == 0, done.stdout + done.stderr

    prefix = tmp_path / "install" / PACKAGE
    check_share(prefix, shares)
    commands = prefix / "lib" / PACKAGE
    assert {command.name for command in commands.iterdir()} == NODES | {"weld-force"}
    assert all(os.access(command, os.X_OK) for command in commands.iterdir())

    # The commands name colcon's Python, which has neither rclpy nor numpy; the one of these tests has.
    sourced = ("bash", "-c", '. "$0" && exec "$@"', tmp_path / "install" / "local_setup.sh", sys.executable)
    where = run(*sourced, "-c", f"import {PACKAGE}; print({PACKAGE}.__file__)", cwd=tmp_path)
    assert Path(where.stdout.strip()).is_relative_to(tmp_path), where.stderr
    asked = ("weld-force", *sorted(NODES)) if not options else ("weld-force", "profile_node")
    done = run(*sourced, "-c", HELP_OF_EACH, *(commands / command for command in asked), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.lower().count("usage: ") == len(asked)


@pytest.mark.parametrize("options", [(), ("--editable",)], ids=["wheel", "editable"])
def test_pip_installs_one_command_and_the_share(
    options: tuple[str, ...], workspace: Path, shares: pytest.MonkeyPatch, tmp_path: Path
):
    python = virtual_environment(tmp_path / "venv")
    before = set(python.parent.iterdir())

    install(python, "--no-deps", *options, workspace / "src" / PACKAGE)

    assert {command.name for command in set(python.parent.iterdir()) - before} == {"weld-force"}
    check_share(tmp_path / "venv", shares)
    found = run(python, "-c", f"import {PACKAGE}; print({PACKAGE}.__file__)", cwd=tmp_path)
    assert Path(found.stdout.strip()).is_relative_to(workspace if options else tmp_path), found.stderr


@pytest.fixture(scope="module")
def released(workspace: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """What `python -m build` makes of a clone."""
    folder = tmp_path_factory.mktemp("dist")
    done = run(sys.executable, "-m", "uv", "build", "--quiet", "--out-dir", folder, workspace / "src" / PACKAGE)
    if done.returncode and "error sending request" in done.stderr.lower():
        pytest.skip("the package index cannot be reached")
    assert done.returncode == 0, done.stderr
    return {"wheel": next(folder.glob("*.whl")), "sdist": next(folder.glob("*.tar.gz"))}


def test_what_is_released_is_small_and_whole(released: dict[str, Path], workspace: Path):
    """The source distribution holds what the tests read; pictures of the studies stay in the repository."""
    assert all(file.stat().st_size < 5e6 for file in released.values())
    clone = workspace / "src" / PACKAGE
    cloned = {str(file.relative_to(clone)) for file in clone.rglob("*") if file.is_file()}
    cloned = {name for name in cloned if name.partition("/")[0] not in ("build", f"{PACKAGE}.egg-info")}  # of pip
    not_released = {name for name in cloned if name.startswith("docs/study/") or name in (".gitignore", "MANIFEST.in")}
    with tarfile.open(released["sdist"]) as sdist:
        in_sdist = {name.partition("/")[2] for name in sdist.getnames()}
    assert cloned - not_released <= in_sdist
    assert in_sdist & not_released <= {"MANIFEST.in"}

    in_wheel = set(zipfile.ZipFile(released["wheel"]).namelist())
    assert {name for name in cloned if name.startswith(f"{PACKAGE}/")} <= in_wheel
    beside = {name.partition("/")[0] for name in in_wheel} - {PACKAGE}
    assert {name.rpartition(".")[2] for name in beside} == {"data", "dist-info"}, "nothing else on the user's path"
    assert f"{PACKAGE}/py.typed" in in_wheel


@pytest.mark.long
@pytest.mark.timeout(1200)  # everything is compiled anew
@pytest.mark.parametrize("kind", ["wheel", "sdist"])
def test_a_release_works_in_an_empty_environment(kind: str, released: dict[str, Path], tmp_path: Path):
    """It needs what `dependencies` names, and no extra."""
    python = virtual_environment(tmp_path / "venv")
    install(python, released[kind])
    command, readme = python.with_name("weld-force"), ROOT / "README.md"
    shutil.copy(ROOT / "examples/weld.csv", tmp_path)

    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert run(command, "--version", cwd=tmp_path).stdout.strip() == f"{PACKAGE} {version}"
    assessed = run(
        command, "assess", "weld.csv", "--limits", "force,banenor-531", "--json", "-", cwd=tmp_path, timeout=900.0
    )
    assert assessed.returncode in (0, 1), assessed.stderr
    assert '"decision"' in assessed.stdout
    assert run(python, "-c", program(), cwd=tmp_path).stdout == shown_after(readme, program())


def test_package_xml_agrees_with_the_project():
    package = package_xml()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]

    assert package.get("format") == "3"
    assert package.findtext("name") == project["name"]
    assert package.findtext("version") == project["version"]
    assert package.findtext("export/build_type") == "ament_python"


def test_every_ros_package_that_is_imported_is_declared():
    ament = pytest.importorskip("ament_index_python.packages")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AMENT_PREFIX_PATH", sys.prefix)
        ros_packages = {"launch", "launch_ros", *ament.get_packages_with_prefixes()} - {PACKAGE}
    sources = [*(ROOT / PACKAGE).rglob("*.py"), *(ROOT / "launch").glob("*.py")]

    imported = ros_packages & set().union(*map(top_level_imports, sources))

    declared = {depend.text for depend in package_xml().iter("exec_depend")}
    assert {"rclpy", "launch_ros", "std_msgs"} <= imported
    assert imported <= declared


def package_xml() -> ElementTree.Element:
    return ElementTree.parse(ROOT / "package.xml").getroot()  # noqa: S314 - the project's own file


def top_level_imports(source: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(source.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.partition(".")[0])
    return found
