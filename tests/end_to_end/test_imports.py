import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

BLOCKED = """
import sys
OPTIONAL = {
    "rclpy", "std_msgs", "matplotlib", "jinja2", "dask", "distributed", "zarr", "xarray", "pandas", "duckdb", "pymoo",
    "pyarrow", "watchfiles",
}
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in OPTIONAL:
            raise ModuleNotFoundError(f"{name} is blocked", name=name)
sys.meta_path.insert(0, Blocker())
"""

SIMULATION = """
import weld_force_ros
assert not {"numba", "numpy"} & sys.modules.keys(), "the root imports the science"
import json
import numpy as np
from weld_force_ros.assessment.judge import assess
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.messages import WeldProfile, encode, profile_sha256
from weld_force_ros.simulation.settings import simulation_settings
from weld_force_ros.simulation.simulator import Simulator
x = (np.arange(-50, 51) * 1e-3).tolist()
z = (-1e-4 * np.exp(-((np.array(x) / 0.02) ** 2))).tolist()
weld = WeldProfile(weld_id="w", source="s", x_m=x, z_m=z, profile_sha256=profile_sha256(x, z))
simulator = Simulator(simulation_settings(track="bilbao-continuous", speeds_kmh=[80.0], positions=1))
found = assess(weld, simulator, load_limits())
print(encode(found.force_map).decode())
assert not OPTIONAL & sys.modules.keys()
"""


def test_simulation_needs_no_optional_package():
    done = subprocess.run([sys.executable, "-c", BLOCKED + SIMULATION], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["peak_force_n"][0] > found["static_load_n"] == 100e3


def test_a_force_map_is_computed_without_the_slow_parts_of_scipy():
    slow = {f"scipy.{part}" for part in ("interpolate", "linalg", "ndimage", "optimize", "signal", "special", "stats")}
    needed = f"assert not {slow} & sys.modules.keys()"
    simulated = SIMULATION.replace("found = assess(weld, simulator, load_limits())", "simulator.force_map(weld)")
    program = BLOCKED + simulated.partition("print(")[0] + needed
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


LIBRARY = """
OPTIONAL -= {"xarray", "pandas"}
import importlib.util
find = importlib.util.find_spec  # xarray asks whether there is Dask
importlib.util.find_spec = lambda name, *of: None if name.partition(".")[0] in OPTIONAL else find(name, *of)
import weld_force_ros as wf
weld = wf.read_profile("weld-1-dip")
found = wf.Model("bilbao-continuous").force_map(weld, [80.0], 1)
verdict = wf.assess(weld, wf.Model("bilbao-continuous"), speeds_kmh=[80.0], positions=1, uncertainty_samples=0)
print(float(found.peak_force_n.max()), len(verdict.criteria), repr(weld))
assert not OPTIONAL & sys.modules.keys()
"""


def test_the_library_needs_no_extra():
    done = subprocess.run([sys.executable, "-c", BLOCKED + LIBRARY], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_command_line_needs_no_optional_package():
    command = "from weld_force_ros.cli.main import main; sys.argv = ['weld-force', '--help']; main()"
    done = subprocess.run([sys.executable, "-c", BLOCKED + command], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "simulate" in done.stdout


def test_nodes_without_their_extra_say_which_it_is():
    node = "import weld_force_ros.ros.nodes.folder_watcher"
    done = subprocess.run([sys.executable, "-c", BLOCKED + node], capture_output=True, text=True, check=False)
    assert "weld_force_ros[nodes]" in done.stderr


def test_imports_point_one_way():
    lint = shutil.which("lint-imports", path=str(Path(sys.executable).parent))
    if lint is None:
        pytest.skip("import-linter is not installed; `make lint` runs it")
    done = subprocess.run([lint, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
