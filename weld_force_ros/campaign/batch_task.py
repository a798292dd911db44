"""Assess a batch of welds and write its results: the task of any process that sees the campaign's folder.

A process makes simulators once, on one thread: there is one process a core. Nothing but a batch's description goes to
it, nothing but a record comes back.
"""

import threading
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
from msgspec import UNSET
from threadpoolctl import threadpool_limits

from weld_force_ros.assessment.judge import gravity, judge
from weld_force_ros.campaign import batch_records, result_store, sources, tables
from weld_force_ros.campaign import plan as plans
from weld_force_ros.campaign.batch_records import BatchRecord
from weld_force_ros.campaign.campaign_file import NetworkSection
from weld_force_ros.campaign.plan import Plan
from weld_force_ros.campaign.profile_table import ProfileRow, RejectedRow
from weld_force_ros.campaign.sources import WeldBatch
from weld_force_ros.errors import InputError, WeldForceError
from weld_force_ros.messages import ForceMap, Verdict, WeldProfile
from weld_force_ros.simulation import fit_file, fit_store, track_file
from weld_force_ros.simulation.force_map_view import whole_map
from weld_force_ros.simulation.simulator import Simulator

FITS = "fits"
"""Folder beside the results for the fits of its tracks."""

_loading = threading.Lock()


class AssessedWeld(NamedTuple):
    """The results of a weld under a vehicle.

    Attributes:
        row: of `tables.VERDICTS`.
        speeds: columns of `tables.SPEEDS`.
        decides: whether the verdict is that of the weld.
    """

    number: int
    section: str
    vehicle: str
    row: dict[str, Any]
    speeds: dict[str, Any]
    force_map: ForceMap
    verdict: Verdict
    decides: bool = False


class RejectedWeld(NamedTuple):
    """A row of `tables.REJECTIONS`."""

    row: dict[str, Any]


def assess_batch(out: str, plan_sha256: str, batch: WeldBatch) -> BatchRecord:
    """Assess a batch, write its results and record that it is finished."""
    with threadpool_limits(limits=1):
        assessor = _assessor(Path(out), plan_sha256)
        return save(assessor.assess(assessor.welds(batch)), batch, Path(out), plan_sha256)


def _assessor(out: Path, plan_sha256: str) -> "Assessor":
    with _loading:  # not by several threads of a worker at once
        return _load_assessor(out, plan_sha256)


@lru_cache(2)
def _load_assessor(out: Path, plan_sha256: str) -> "Assessor":
    plan = plans.results(out)
    if plan.sha256 != plan_sha256:
        raise InputError(f"{out} holds another plan than the one that is run", "run one campaign a folder")
    import_fits(out)
    return Assessor(plan)


class SourceWeld(NamedTuple):
    """A weld of a source; `row` begins its rows in the results: number, line and origin."""

    row: dict[str, Any]
    weld: ProfileRow


_Placed = list[tuple[dict[str, Any], WeldProfile]]
"""Welds of one section, each with the begin of its row."""


class Assessor:
    """Assesses the welds of a plan."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self._simulators = {
            settings.config_sha256: Simulator(settings, threads=1, curves=False)
            for section in plan.sections
            for settings in section.vehicles.values()
        }

    def welds(self, batch: WeldBatch) -> Iterator[SourceWeld]:
        """Yield the welds of a batch, read from their sources."""
        number = batch.first
        for part in batch.slices:
            source = self.plan.sources[part.source]
            for weld in sources.read(source, part):
                yield SourceWeld({"weld_number": number, "line": source.line, "origin": source.origin}, weld)
                number += 1

    def assess(self, welds: Iterable[SourceWeld]) -> list[AssessedWeld | RejectedWeld]:
        """Return the outcome of each weld: under each of its section's vehicles, or that it has none.

        A weld is rejected if one of its vehicles cannot be assessed, as that one might decide.
        """
        rejected = list[RejectedWeld]()
        placed: dict[str, _Placed] = {section.name: [] for section in self.plan.sections}
        for row, weld in welds:
            if isinstance(weld, RejectedRow):
                rejected.append(RejectedWeld(row | weld._asdict()))
                continue
            section = next((s for s in self.plan.sections if s.contains(row["line"], weld.chainage_m)), None)
            if section is None:
                outside = InputError("it lies in no section of the campaign", "add a section")
                rejected.append(_rejected(row, weld, outside))
            else:
                placed[section.name].append((row, weld))
        outcomes: list[AssessedWeld | RejectedWeld] = [*rejected]
        for section in self.plan.sections:
            by_vehicle = [[*self._outcomes(placed[section.name], section, vehicle)] for vehicle in section.vehicles]
            for of_weld in zip(*by_vehicle, strict=True):
                outcomes += _of_one_weld(of_weld)
        return outcomes

    def _outcomes(
        self, placed: _Placed, section: NetworkSection, vehicle: str
    ) -> Iterator[AssessedWeld | RejectedWeld]:
        """Yield the outcome of each weld of a section under one vehicle."""
        limits, simulator = self.plan.limits, self._simulators[section.vehicles[vehicle].config_sha256]
        force_maps = _force_maps(simulator, [weld for _, weld in placed])
        for (weld_row, weld), force_map in zip(placed, force_maps, strict=True):
            row = weld_row | {"vehicle": vehicle}
            if isinstance(force_map, WeldForceError):
                yield _rejected(row, weld, force_map)
                continue
            try:
                verdict = judge(force_map, limits)
            except InputError as error:
                yield _rejected(row, weld, error)
                continue
            row |= tables.verdict_row(weld, force_map, verdict)
            speeds = tables.speed_columns(force_map, limits)
            yield AssessedWeld(row["weld_number"], section.name, vehicle, row, speeds, force_map, verdict)


def _of_one_weld(by_vehicle: Sequence[AssessedWeld | RejectedWeld]) -> Sequence[AssessedWeld | RejectedWeld]:
    """Return the outcomes of a weld with the one that decides marked, or the first vehicle's that has none."""
    assessed = [one for one in by_vehicle if isinstance(one, AssessedWeld)]
    if len(assessed) < len(by_vehicle):
        return [next(one for one in by_vehicle if isinstance(one, RejectedWeld))]
    deciding = max(assessed, key=lambda one: gravity(one.verdict))
    return [one._replace(decides=one is deciding) for one in assessed]


def _rejected(row: dict[str, Any], weld: WeldProfile, error: WeldForceError) -> RejectedWeld:
    return RejectedWeld(row | {"source": weld.source, "reason": error.reason, "remedy": error.remedy})


def _force_maps(simulator: Simulator, welds: list[WeldProfile]) -> list[ForceMap | WeldForceError]:
    """Compute all maps at once; where one cannot be, one by one, so that the other welds have theirs."""
    try:
        return [*simulator.force_maps(welds)]
    except WeldForceError:
        return [_force_map(simulator, weld) for weld in welds]


def _force_map(simulator: Simulator, weld: WeldProfile) -> ForceMap | WeldForceError:
    try:
        return simulator.force_map(weld)
    except WeldForceError as error:
        return error


def save(outcomes: list[AssessedWeld | RejectedWeld], batch: WeldBatch, out: Path, plan_sha256: str) -> BatchRecord:
    """Write a batch's results, then its record."""
    assessed = [outcome for outcome in outcomes if isinstance(outcome, AssessedWeld)]
    rejected = [outcome.row for outcome in outcomes if isinstance(outcome, RejectedWeld)]
    files: dict[str, str] = {}
    for section in sorted({one.section for one in assessed}):
        inside = sorted((one for one in assessed if one.section == section), key=lambda one: one.number)
        for kind, decides in (("verdicts", True), ("other_vehicles", False)):
            if rows := [one.row for one in inside if one.decides is decides]:
                verdicts = result_store.table_of(rows, tables.VERDICTS)
                files |= result_store.write_table(verdicts, out, result_store.part(kind, batch.number, section))
        files |= result_store.write_table(_speeds(inside), out, result_store.part("speeds", batch.number, section))
        for vehicle in sorted({one.vehicle for one in inside}):
            blocks = _blocks([one for one in inside if one.vehicle == vehicle], batch)
            files |= result_store.write_maps(blocks, out, f"{section}/{vehicle}", batch.first)
    if rejected:
        rejections = result_store.table_of(rejected, tables.REJECTIONS)
        files |= result_store.write_table(rejections, out, result_store.part("rejections", batch.number))
    decided = sum(one.decides for one in assessed)
    record = BatchRecord(plan_sha256, batch.number, batch.welds, decided, len(rejected), files)
    batch_records.write(record, out)
    return record


def _speeds(assessed: list[AssessedWeld]) -> Any:
    counts = [len(one.speeds["speed_kmh"]) for one in assessed]
    columns = {name: np.concatenate([one.speeds[name] for one in assessed]) for name in assessed[0].speeds}
    columns["weld_number"] = np.repeat([one.number for one in assessed], counts)
    columns["vehicle"] = np.repeat([one.vehicle for one in assessed], counts)
    return pa.table(columns, schema=tables.SPEEDS)


def _blocks(assessed: list[AssessedWeld], batch: WeldBatch) -> dict[str, Any]:
    """Return a batch's part of the maps, NaN where it has none."""
    a_map = assessed[0].force_map
    shape = (batch.welds, len(a_map.speeds_kmh), len(a_map.positions_m))
    blocks: dict[str, Any] = {name: np.full(shape, np.nan, dtype=np.float32) for name in result_store.MAP_VARIABLES}
    blocks["chainage_m"] = np.full(batch.welds, np.nan)
    for one in assessed:
        row = one.number - batch.first
        whole = whole_map(one.force_map)
        for name, values in {**whole.passages.columns, "peak_x_m": whole.peak_x_m}.items():
            blocks[name][row] = values
        if one.force_map.chainage_m is not UNSET:
            blocks["chainage_m"][row] = one.force_map.chainage_m
    return {name: block for name, block in blocks.items() if not np.isnan(block).all()}


def export_fits(plan: Plan, out: Path) -> None:
    """Make the fits that the plan needs and write them beside the results, so that no worker has to make one.

    Raises:
        OSError: they cannot be written.
    """
    for section in plan.sections:
        for settings in section.vehicles.values():
            if settings.engine != "reference":
                definition = track_file.parse(settings.track_definition, settings.track)
                fits: list[fit_file.AnyFit] = [fit_store.fitted(definition, settings.engine)]
                if settings.poles == "moving":
                    fits.append(fit_store.fitted_moving(definition))
                for fit in fits:
                    fit_file.write(fit, out / FITS / f"{fit.key}.json")


def import_fits(out: Path) -> None:
    """Copy the fits that came with the campaign into this user's cache, from where they are loaded."""
    for file in sorted((out / FITS).glob("*.json")):
        fit_store.keep(msgspec.json.decode(file.read_bytes(), type=fit_file.AnyFit))
