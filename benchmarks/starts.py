"""How soon a fresh process is of use: imports, and one weld's force map with its compiled code kept and without.

Each figure is the median of processes that were started one after the other, kinds interleaved, and its `_spread` their
least and most. A kept cache is one that the process before has filled; without, the process compiles what it calls.
"""

import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from typing import Any

import msgspec

from benchmarks import timing
from benchmarks.study import POSITIONS, SPEEDS

_WELD = "weld-1-dip"
_SIMULATE = ["simulate", _WELD, "--speeds", SPEEDS, "--positions", str(POSITIONS), "--json", "map.json"]

_IMPORT = """
import time
began = time.perf_counter()
import {module}
print(time.perf_counter() - began)
"""

_FIRST_RESULT = f"""
import time
laps = [time.perf_counter()]
from weld_force_ros.measurement import profile_file
from weld_force_ros.simulation.settings import parse_speeds, simulation_settings
from weld_force_ros.simulation.simulator import Simulator
laps.append(time.perf_counter())
simulator = Simulator(simulation_settings(speeds_kmh=parse_speeds({SPEEDS!r}), positions={POSITIONS}, running='with'))
profile = profile_file.read_profile(profile_file.find({_WELD!r}))
laps.append(time.perf_counter())
simulator.force_map(profile)
laps.append(time.perf_counter())
print([after - before for before, after in zip(laps, laps[1:])])
"""


def starts(repetitions: int = 3) -> dict[str, Any]:
    """Time fresh processes; `simulate_*` from the shell's side, the others from within, interpreter started.

    `first_result_*` splits the same simulation, compiled code kept: imports, track and profile, force map.
    """
    seconds: dict[str, list[float]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as folder:
        for repetition in range(repetitions):
            kept = Path(folder, f"compiled-{repetition}")
            seconds["simulate_cache_absent_s"].append(_simulated_s(kept))
            seconds["simulate_cache_present_s"].append(_simulated_s(kept))
            for part, spent in zip(("import", "load", "map"), _printed(_FIRST_RESULT, kept), strict=True):
                seconds[f"first_result_{part}_s"].append(spent)
            for name, module in (("package", "weld_force_ros"), ("cli", "weld_force_ros.cli.main")):
                seconds[f"import_{name}_s"].append(_printed(_IMPORT.format(module=module), kept))
        passages = len(msgspec.json.decode(Path(folder, "map.json").read_bytes())["peak_force_n"])
    found: dict[str, Any] = {"simulate_passages": passages}
    for name, values in seconds.items():
        found |= timing.figure(name, values)
    return found


def _simulated_s(compiled: Path) -> float:
    return timing.seconds(lambda: _run(["-m", "weld_force_ros.cli", *_SIMULATE], compiled))


def _printed(code: str, compiled: Path) -> Any:
    return msgspec.json.decode(_run(["-c", code], compiled))


def _run(arguments: list[str], compiled: Path) -> bytes:
    """Return standard output of a fresh interpreter that works beside, and with, this folder of compiled code."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(compiled)}
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=compiled.parent, env=environment, capture_output=True, check=True).stdout
