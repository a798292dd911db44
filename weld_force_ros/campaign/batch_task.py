"""The task: a batch of welds assessed and its results written, by any process that sees the campaign's folder.

A process makes simulators once, on one thread: there is one process a core. Nothing but a batch's description goes to
it, nothing but a record comes back.
"""

import threading
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
from msgspec import UNSET
from threadpoolctl import threadpool_limits

from weld_force_ros.assessment.judge import judge
from weld_force_ros.campaign import batch_records, result_store, sources, tables
from weld_force_ros.campaign import plan as plans
from weld_force_ros.campaign.batch_records import Record
from weld_force_ros.campaign.campaign_file import Section
from weld_force_ros.campaign.plan import Plan
from weld_force_ros.campaign.profile_table import ProfileRow, RejectedRow
from weld_force_ros.campaign.sources import Batch
from weld_force_ros.errors import InputError, NumericalError
from weld_force_ros.messages import ForceMap, WeldProfile
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.simulation.simulator import Simulator

FITS = "fits"
"""Folder beside the results for the fits of its tracks."""

_making = threading.Lock()


class AssessedWeld(NamedTuple):
    """A weld under a vehicle."""

    number: int
    section: str
    vehicle: str
    row: dict[str, Any]
    speeds: dict[str, Any]
    force_map: ForceMap


class RejectedWeld(NamedTuple):
    """A row of `tables.REJECTIONS`."""

    row: dict[str, Any]


def assess_batch(out: str, plan_sha256: str, batch: Batch) -> Record:
    """Assess a batch, write its results and say that it is finished."""
    with threadpool_limits(limits=1):
        assessor = _assessor(Path(out), plan_sha256)
        return save(assessor.assess(assessor.welds(batch)), batch, Path(out), plan_sha256)


def _assessor(out: Path, plan_sha256: str) -> "Assessor":
    with _making:  # not by several threads of a worker at once
        return _remembered(out, plan_sha256)


@lru_cache(2)
def _remembered(out: Path, plan_sha256: str) -> "Assessor":
    plan = plans.results(out)
    if plan.sha256 != plan_sha256:
        raise InputError(f"{out} holds another plan than the one that is run", "run one campaign a folder")
    import_fits(out)
    return Assessor(plan)


_Usable = tuple[dict[str, Any], WeldProfile]
"""What a row says beforehand, and a weld."""


class SourceWeld(NamedTuple):
    """A weld of a source, with what its row says beforehand."""

    about: dict[str, Any]
    weld: ProfileRow


class Assessor:
    """Assesses the welds of a plan."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self._simulators = {
            settings.config_sha256: Simulator(settings, threads=1, curves=False)
            for section in plan.sections
            for settings in section.vehicles.values()
        }

    def welds(self, batch: Batch) -> Iterator[SourceWeld]:
        """The welds of a batch, read from their sources."""
        number = batch.first
        for piece in batch.pieces:
            source = self.plan.sources[piece.source]
            for weld in sources.read(source, piece):
                yield SourceWeld({"weld_number": number, "line": source.line, "origin": source.origin}, weld)
                number += 1

    def assess(self, welds: Iterable[SourceWeld]) -> list[AssessedWeld | RejectedWeld]:
        """What becomes of welds that lie beside each other."""
        refused = list[RejectedWeld]()
        placed: dict[str, list[_Usable]] = {section.name: [] for section in self.plan.sections}
        for about, weld in welds:
            if isinstance(weld, RejectedRow):
                refused.append(RejectedWeld(about | weld._asdict()))
                continue
            section = next((s for s in self.plan.sections if s.holds(about["line"], weld.chainage_m)), None)
            if section is None:
                refused.append(_refused(about, weld, "it lies in no section of the campaign", "add a section"))
            else:
                placed[section.name].append((about, weld))
        rolled = [
            outcome
            for section in self.plan.sections
            for vehicle in section.vehicles
            for outcome in self._outcomes(placed[section.name], section, vehicle)
        ]
        return [*refused, *rolled]

    def _outcomes(self, placed: list[_Usable], section: Section, vehicle: str) -> Iterator[AssessedWeld | RejectedWeld]:
        """Of welds of a section under one of its vehicles."""
        limits, simulator = self.plan.limits, self._simulators[section.vehicles[vehicle].config_sha256]
        rolled = _force_maps(simulator, [weld for _, weld in placed])
        for (of_weld, weld), force_map in zip(placed, rolled, strict=True):
            about = of_weld | {"vehicle": vehicle}
            if isinstance(force_map, NumericalError):
                yield _refused(about, weld, str(force_map), "")
                continue
            try:
                verdict = judge(force_map, limits)
            except InputError as error:
                yield _refused(about, weld, error.reason, error.remedy)
                continue
            row = about | tables.verdict_row(weld, force_map, verdict)
            speeds = tables.speed_columns(force_map, limits)
            yield AssessedWeld(about["weld_number"], section.name, vehicle, row, speeds, force_map)


def _refused(about: dict[str, Any], weld: WeldProfile, reason: str, remedy: str) -> RejectedWeld:
    return RejectedWeld(about | {"source": weld.source, "reason": reason, "remedy": remedy})


def _force_maps(simulator: Simulator, welds: list[WeldProfile]) -> list[ForceMap | NumericalError]:
    """All maps at once; where a passage fails, one by one, so that the others do not suffer from it."""
    try:
        return [*simulator.force_maps(welds)]
    except NumericalError:
        return [_force_map(simulator, weld) for weld in welds]


def _force_map(simulator: Simulator, weld: WeldProfile) -> ForceMap | NumericalError:
    try:
        return simulator.force_map(weld)
    except NumericalError as error:
        return error


def save(outcomes: list[AssessedWeld | RejectedWeld], batch: Batch, out: Path, plan_sha256: str) -> Record:
    """Write a batch's results, then its record."""
    found = [outcome for outcome in outcomes if isinstance(outcome, AssessedWeld)]
    refused = [outcome.row for outcome in outcomes if isinstance(outcome, RejectedWeld)]
    files: dict[str, str] = {}
    for section in sorted({one.section for one in found}):
        inside = sorted((one for one in found if one.section == section), key=lambda one: one.number)
        verdicts = result_store.table_of((one.row for one in inside), tables.VERDICTS)
        files |= result_store.write_table(verdicts, out, result_store.part("verdicts", batch.number, section))
        files |= result_store.write_table(_speeds(inside), out, result_store.part("speeds", batch.number, section))
        for vehicle in sorted({one.vehicle for one in inside}):
            blocks = _blocks([one for one in inside if one.vehicle == vehicle], batch)
            files |= result_store.write_maps(blocks, out, f"{section}/{vehicle}", batch.first)
    if refused:
        rejections = result_store.table_of(refused, tables.REJECTIONS)
        files |= result_store.write_table(rejections, out, result_store.part("rejections", batch.number))
    record = Record(plan_sha256, batch.number, batch.welds, len(found), len(refused), files)
    batch_records.keep(record, out)
    return record


def _speeds(found: list[AssessedWeld]) -> Any:
    counts = [len(one.speeds["speed_kmh"]) for one in found]
    columns = {name: np.concatenate([one.speeds[name] for one in found]) for name in found[0].speeds}
    columns["weld_number"] = np.repeat([one.number for one in found], counts)
    columns["vehicle"] = np.repeat([one.vehicle for one in found], counts)
    return pa.table(columns, schema=tables.SPEEDS)


def _blocks(found: list[AssessedWeld], batch: Batch) -> dict[str, Any]:
    """A batch's part of the maps, NaN where it has none."""
    a_map = found[0].force_map
    shape = (batch.welds, len(a_map.speeds_kmh), len(a_map.positions_m))
    blocks: dict[str, Any] = {name: np.full(shape, np.nan, dtype=np.float32) for name in result_store.MAP_VARIABLES}
    blocks["chainage_m"] = np.full(batch.welds, np.nan)
    for one in found:
        row = one.number - batch.first
        for name in result_store.MAP_VARIABLES:
            blocks[name][row] = np.reshape(getattr(one.force_map, name), shape[1:])
        if one.force_map.chainage_m is not UNSET:
            blocks["chainage_m"][row] = one.force_map.chainage_m
    return {name: block for name, block in blocks.items() if not np.isnan(block).all()}


def export_fits(plan: Plan, out: Path) -> None:
    """Make the fits that the plan needs and lay them beside the results, so that no worker has to make one.

    Raises:
        OSError: they cannot be written.
    """
    for section in plan.sections:
        for settings in section.vehicles.values():
            if settings.engine != "reference":
                fit = fit_store.fitted(track_file.parse(settings.track_definition, settings.track), settings.engine)
                fit_store.write(fit, out / FITS / f"{fit.key}.json")


def import_fits(out: Path) -> None:
    """Put the fits that came with the campaign into this user's cache, from where they are loaded."""
    for file in sorted((out / FITS).glob("*.json")):
        fit_store.keep(msgspec.json.decode(file.read_bytes(), type=fit_store.AnyFit))
