"""Estimate how long a campaign takes and how much it writes, from a few welds timed on this machine.

    time = start + max(rounds x welds of a batch x vehicles x time of one / EFFICIENCY, batches x DRIVER_S)
    rounds = batches / workers, rounded up
    size = batches x size of an empty batch + welds x vehicles x size of one

The time of one is measured in this process on one thread, reading, judging and writing included; another machine is
faster or slower in proportion. The range has twice the standard error of the trials' mean to either side, and DRIFT
beyond it.
"""

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from weld_force_ros.campaign import batch_task, result_store, sources
from weld_force_ros.campaign.batch_task import AssessedWeld, Assessor, RejectedWeld, SourceWeld
from weld_force_ros.campaign.plan import Plan
from weld_force_ros.campaign.sources import SourceSlice, WeldBatch

EFFICIENCY = 0.87
"""Relative speed of a worker beside others: they share memory, caches and the cores' clock."""
START_S = 8.0
"""Time until workers have started, imported and loaded compiled code."""
DRIVER_S = 0.01
"""Time of a batch in the scheduler and its client, which run on one core."""

DRIFT = 0.15
"""Relative change of a machine's speed over time: the machine of development changed by as much within an hour."""

TRIALS = 10
"""Number of batches of which some welds are timed."""
_TRIAL_WELDS = 16  # simulated together: they share the SIMD lanes as those of a batch do


@dataclass(frozen=True)
class Estimate:
    """Expected time and size of a run, with the quantities they are computed from.

    Attributes:
        weld_s: time of one weld under one vehicle on one thread, and twice its standard error.
        vehicle_share: number of vehicles over a weld, on average of the timed ones.
        batch_bytes: size of the results of a batch without welds.
        weld_bytes: size of the results of one weld under one vehicle.
    """

    welds: int
    batches: int
    workers: int
    weld_s: tuple[float, float]
    vehicle_share: float
    batch_bytes: float
    weld_bytes: float

    @property
    def seconds(self) -> tuple[float, float, float]:
        """Least, expected and most seconds."""
        mean, doubt = self.weld_s
        least, most = max(0.0, mean - doubt) / (1 + DRIFT), (mean + doubt) * (1 + DRIFT)
        return self._seconds(least), self._seconds(mean), self._seconds(most)

    def _seconds(self, weld_s: float) -> float:
        rounds = -(-self.batches // self.workers)  # a last batch may keep one worker while the others are done
        batch_s = self.welds / self.batches * self.vehicle_share * weld_s
        return START_S + max(rounds * batch_s / EFFICIENCY, self.batches * DRIVER_S)

    @property
    def bytes(self) -> float:
        """Size of all results."""
        return self.batches * self.batch_bytes + self.welds * self.vehicle_share * self.weld_bytes


def estimate(plan: Plan, workers: int, on_trial: Callable[[], None] = lambda: None) -> Estimate:
    """Time a few welds from all over a plan's sources, and measure the size of their results."""
    assessor = Assessor(plan)
    trials = [_trial(assessor, batch) for batch in _batches(plan)]
    for trial in trials:  # loads compiled code and makes the tables that any of them needs
        assessor.assess(trial.welds)
    seconds, outcomes = list[float](), list[AssessedWeld | RejectedWeld]()
    for trial in trials:
        began = time.perf_counter()
        found = assessor.assess(trial.welds)
        assessed_s = time.perf_counter() - began
        seconds.append((assessed_s + len(trial.welds) * trial.read_s) / len(found))
        outcomes += found
        on_trial()
    welds = sum(len(trial.welds) for trial in trials)
    saved_s, batch_bytes, weld_bytes = _saved(plan, outcomes)
    error = 2 * float(np.std(seconds)) / len(seconds) ** 0.5
    return Estimate(
        welds=plan.welds,
        batches=plan.batches,
        workers=workers,
        weld_s=(float(np.mean(seconds)) + saved_s, error),
        vehicle_share=len(outcomes) / welds,
        batch_bytes=batch_bytes,
        weld_bytes=weld_bytes,
    )


class _Trial(NamedTuple):
    """Some welds of a batch, and the seconds that reading one weld took on average."""

    welds: list[SourceWeld]
    read_s: float


def _trial(assessor: Assessor, batch: WeldBatch) -> _Trial:
    began = time.perf_counter()
    read = [*assessor.welds(batch)]
    read_s = (time.perf_counter() - began) / len(read)
    return _Trial([read[place] for place in np.unique(np.linspace(0, len(read) - 1, _TRIAL_WELDS).astype(int))], read_s)


def _batches(plan: Plan) -> list[WeldBatch]:
    """Return a few batches, evenly over all."""
    chosen = set(np.linspace(0, plan.batches - 1, min(TRIALS, plan.batches)).astype(int).tolist())
    return [batch for batch in sources.batches(plan.sources, plan.batch_welds) if batch.number in chosen]


def _saved(plan: Plan, outcomes: list[AssessedWeld | RejectedWeld]) -> tuple[float, float, float]:
    """Return the seconds of writing an outcome within a full batch, the bytes of a batch and of an outcome.

    All outcomes are written, and half of them: what grows with their number is theirs.
    """
    numbered = [one._replace(number=n) if isinstance(one, AssessedWeld) else one for n, one in enumerate(outcomes)]
    count = len(numbered)
    with tempfile.TemporaryDirectory(prefix="weld-force-plan-") as folder:
        out = Path(folder)
        source = sources.Source("", "", "", count, "")
        batch_welds = max(count, plan.batch_welds)
        trial = Plan(plan.software, plan.name, [source], plan.sections, plan.limits, batch_welds)
        result_store.create_maps(trial, out)
        half = _write(numbered[: count // 2], out, count)
        began = time.perf_counter()
        all_of_them = _write(numbered, out, count)
        taken = time.perf_counter() - began
    weld_bytes = max(0.0, (all_of_them - half) / max(1, count - count // 2))
    return taken / batch_welds, max(0.0, all_of_them - count * weld_bytes), weld_bytes


def _write(outcomes: list[AssessedWeld | RejectedWeld], out: Path, welds: int) -> int:
    """Write outcomes as one batch; return the bytes."""
    batch = WeldBatch(0, 0, [SourceSlice(0, 0, welds)])
    record = batch_task.save(outcomes, batch, out, "")
    return sum((out / name).stat().st_size for name in record.files)
