"""The package's root: its public names, loaded when they are first used."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import weld_force_ros as wf
from benchmarks.library import program

ROOT = Path(__file__).parents[2]

PUBLIC = {
    "BagError", "GrindingPlan", "InputError", "Limits", "Model", "NumericalError", "Profile", "ProfileError",
    "Recording", "Track", "TrackError", "Vehicle", "Verdict", "WeldForceError", "assess", "grind", "read_profile",
    "read_profiles",
}  # fmt: skip
"""A name that leaves this list is a breaking change, and belongs into the changelog."""


def test_the_public_names_are_these_and_each_can_be_imported():
    assert set(wf.__all__) == set(wf._MODULE_OF) == PUBLIC
    assert set(dir(wf)) >= PUBLIC
    assert all(getattr(wf, name) is not None for name in PUBLIC)


def test_type_checkers_see_the_same_names():
    tree = ast.parse(Path(wf.__file__).read_text(encoding="utf-8"))
    (typed,) = (node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in typed.body if isinstance(node, ast.ImportFrom)]
    assert {(alias.asname, node.module) for node in imports for alias in node.names} == {
        (name, f"weld_force_ros.{module}") for name, module in wf._MODULE_OF.items()
    }


def test_the_import_loads_no_other_package():
    heavy = {"numpy", "scipy", "numba", "msgspec", "typer", "rich", "yaml", "mcap"}
    code = f"import sys, weld_force_ros; sys.exit(' '.join({heavy} & sys.modules.keys()) or 0)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_an_unknown_name_is_an_attribute_error():
    assert not hasattr(wf, "simulate_everything")


def test_a_force_map_of_own_arrays_takes_five_lines():
    arrays = ("import numpy", "x =", "z =")
    assert len([line for line in program().splitlines() if line and not line.startswith(arrays)]) == 5
    done = subprocess.run([sys.executable, "-c", program()], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    shown = re.search(r"```\n(\[.*\])\n```", (ROOT / "README.md").read_text())
    assert shown is not None
    assert done.stdout.strip() == shown[1], "the README shows what comes out"
