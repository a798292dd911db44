"""Compare two clones in one run: `python -m benchmarks.compare BEFORE [--rounds 5]`.

The quick benchmark of either clone runs in turn, in processes of their own, so that a machine's drift meets both alike.
Prints, for every figure, the median over the rounds of each and their ratio.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import Annotated

import typer

HERE = Path(__file__).parents[1]


def figures(clone: Path) -> dict[str, float]:
    """Return the figures of a clone's quick benchmark."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "bench.json"
        command = [sys.executable, "-m", "weld_force_ros.cli", "bench", "--quick", "--json", str(target)]
        environment = os.environ | {"PYTHONPATH": str(clone)}
        subprocess.run(
            command, cwd=clone, env=environment, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        found = json.loads(target.read_text())
    return {name: value for name, value in found.items() if isinstance(value, int | float)}


def main(
    before: Annotated[Path, typer.Argument(help="A clone of the commit to compare with.")],
    rounds: Annotated[int, typer.Option(help="Runs of each.")] = 5,
) -> None:
    """Compare this clone's quick benchmark with another's, in turn."""
    pairs = [(figures(before.resolve()), figures(HERE)) for _ in range(rounds)]
    print(f"{'figure':40} {'before':>12} {'now':>12} {'ratio':>8}")
    for name in pairs[0][0]:
        values = [(then[name], now[name]) for then, now in pairs if name in now]
        if values and any(then for then, _ in values):
            then, now = (median(side) for side in zip(*values, strict=True))
            print(f"{name:40} {then:12.5g} {now:12.5g} {now / then:8.3f}")


if __name__ == "__main__":
    typer.run(main)
