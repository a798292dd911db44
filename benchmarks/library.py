"""Time the README's force map of own arrays, each run in a new process: `python -m benchmarks.library`."""

import re
import subprocess
import sys
import time
from pathlib import Path

RUNS = 6
README = Path(__file__).parents[1] / "README.md"


def program() -> str:
    """Return the Python of the README's section "From Python".

    Raises:
        ValueError: there is none.
    """
    found = re.search(r"### From Python\n.*?```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    if found is None:
        raise ValueError("the README has no Python under `From Python`")
    return found[1]


def main() -> None:
    timed = f"{program()}\nimport time; print(time.process_time())"
    runs = []
    for _ in range(RUNS):
        began = time.perf_counter()
        done = subprocess.run([sys.executable, "-c", timed], capture_output=True, text=True, check=True)
        runs.append((time.perf_counter() - began, float(done.stdout.splitlines()[-1])))
    first, *later = runs
    print(f"first run: {first[0]:.1f} s, {first[1]:.1f} s of processor time")
    wall_s, processor_s = (min(times) for times in zip(*later, strict=True))
    print(f"best of {len(later)} more: {wall_s:.1f} s, {processor_s:.1f} s of processor time")


if __name__ == "__main__":
    main()
