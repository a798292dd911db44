"""The package's root: its public names, loaded when they are first used."""

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np

import weld_force_ros as wf
from weld_force_ros import errors, messages

PUBLIC = {
    "Assessment", "AssessmentSettings", "BagError", "Criterion", "DiskFullError", "ForceHistory", "ForceMap",
    "GrindingAdvice", "InputError", "Inquiry", "Limit", "MessageError", "NumericalError", "ProfileError", "RailSurface",
    "Recording", "Rejection", "Rules", "Settled", "SimulationSettings", "Simulator", "TrackError", "Uncertainty",
    "Verdict", "WeldForceError", "WeldMarker", "WeldProfile", "assess", "judge", "load_limits", "open_recording",
    "read_profile", "replay", "shipped_profile", "simulation_settings",
}  # fmt: skip
"""A name that leaves this list is a breaking change, and belongs into the changelog."""


def test_the_public_names_are_these_and_each_can_be_imported():
    assert {name for name in dir(wf) if name in PUBLIC} == PUBLIC
    assert set(wf._MODULE_OF) == PUBLIC
    assert all(getattr(wf, name) is not None for name in PUBLIC)


def test_every_message_and_every_error_is_public():
    assert {kind.__name__ for kind in messages.SCHEMAS} <= PUBLIC
    assert {
        name for name, kind in vars(errors).items() if isinstance(kind, type) and issubclass(kind, Exception)
    } <= PUBLIC


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


def test_the_first_lines_of_the_packages_help_work():
    simulator = wf.Simulator(wf.simulation_settings(track="bilbao", speeds_kmh=[80.0, 120.0], positions=[0.3]))
    assessment = wf.assess(wf.shipped_profile("weld-1-dip"), simulator, wf.load_limits())
    assert assessment.verdict.decision in ("accept", "grind", "reject", "undecided")
    assert assessment.verdict.peak_force_n == max(assessment.force_map.peak_force_n)
    assert max(np.array(assessment.history.force_n)) > assessment.force_map.static_load_n
