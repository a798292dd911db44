"""The paper's claims: what it says, what would count as agreement, and the result for what the studies measured.

The claims are in `data/claims.yaml`, their criteria decided from the paper's words before any study was run.
"""

import math
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal, TypeAlias, cast, get_args

import msgspec
import numpy as np
from msgspec import Meta

from weld_force_ros import _yaml
from weld_force_ros._files import whole_file
from weld_force_ros.errors import InputError, os_errors_as
from weld_force_ros.studies.result_table import Column, Table

Quantity: TypeAlias = float | bool | str | list[float]
GeometrySource: TypeAlias = Literal["exact", "inferred", "assumed", "none"]
StudyName: TypeAlias = Literal[
    "map", "curve", "motion", "smooth", "increment", "length", "hertz", "spectrum", "bands", "validation", "population"
]  # fmt: skip
ClaimResult: TypeAlias = Literal["agrees", "partly", "differs", "not evaluated", "not-testable"]

FOLDS = 5
RESULTS: tuple[ClaimResult, ...] = ("agrees", "partly", "differs", "not evaluated", "not-testable")

_Text = Annotated[str, Meta(min_length=1, max_length=1000)]
_Key = Annotated[str, Meta(pattern=r"^[a-z]+\.[a-z0-9_]+$")]
_REMEDY = "write it after the package's data/claims.yaml"
_UNITS = {"kmh": "km/h", "n": "N", "m": "m", "mm": "mm", "hz": "Hz", "s": "s"}
_MOST_LISTED = 6


class Condition(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """A condition on one measured quantity: within two ends (included), above, below, or true or false.

    Each element of a measured list must meet it. NaN, for a quantity that does not exist, never does.
    """

    key: _Key
    within: tuple[float, float] | None = None
    above: float | None = None
    below: float | None = None
    is_: bool | None = msgspec.field(name="is", default=None)

    def problem(self) -> str | None:
        """Return why this condition cannot be checked, or None."""
        forms = [form for form in (self.within, self.above, self.below, self.is_) if form is not None]
        if len(forms) != 1:
            return f"{self.key} needs exactly one of within, above, below, is"
        ends = self.within or (0.0, self.above or self.below or 0.0)
        if not all(map(math.isfinite, ends)) or (self.within and ends[0] > ends[1]):
            return f"{self.key} requires a number in {list(ends)}"
        return None

    def holds(self, value: Quantity) -> list[bool]:
        """Return for each element of the value whether it meets the condition; an empty list does not.

        Raises:
            InputError: a number where true or false is required, or the other way round.
        """
        if self.is_ is not None:
            return [self._flag(value) is self.is_]
        return [self._met(number) for number in self._numbers(value)] or [False]

    def in_words(self) -> str:
        """Return the condition in words, without the quantity."""
        unit = _unit(self.key)
        if self.within is not None:
            low, high = self.within
            return f"{low:g}{unit}" if low == high else f"{low:g} to {high:g}{unit}"
        if self.above is not None:
            return f"above {self.above:g}{unit}"
        return f"below {self.below:g}{unit}" if self.below is not None else _yes_or_no(bool(self.is_))

    def value_in_words(self, value: Quantity) -> str:
        """Return the value in words: `54.1 km/h`, `yes`, `13 of 15, 71 to 96 km/h`."""
        if self.is_ is not None:
            return _yes_or_no(self._flag(value))
        numbers, unit = self._numbers(value), _unit(self.key)
        if not isinstance(value, list):
            return _number(numbers[0], unit)
        held = sum(self.holds(value))
        share = f"{held} of {max(len(numbers), 1)}"
        if len(numbers) <= _MOST_LISTED:
            return f"{', '.join(_number(number) for number in numbers) or 'none'}{unit} ({share})"
        finite = [number for number in numbers if math.isfinite(number)]
        return f"{_number(min(finite))} to {_number(max(finite), unit)} ({share})" if finite else f"none ({share})"

    def _met(self, number: float) -> bool:
        if self.within is not None:
            return self.within[0] <= number <= self.within[1]
        return number > self.above if self.above is not None else number < cast(float, self.below)

    def _flag(self, value: Quantity) -> bool:
        if not isinstance(value, bool):
            raise InputError(f"{self.key} is {value!r}", "the study must measure true or false here")
        return value

    def _numbers(self, value: Quantity) -> list[float]:
        numbers = value if isinstance(value, list) else [value]
        if not all(isinstance(number, float) for number in numbers):
            raise InputError(f"{self.key} is {value!r}", "the study must measure a number, or a list of them, here")
        return cast(list[float], numbers)


class Correction(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """Criteria in place of those that asked for more than the statement says, found after the run, and why.

    They are evaluated and counted apart: the claim's result stays that of the criteria that were fixed beforehand.
    """

    criteria: Annotated[list[Condition], Meta(min_length=1)]
    reason: _Text


class Claim(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """A statement of the paper in our words; without criteria it cannot be tested.

    `where` is its section and figure in the paper. `geometry` is `exact` if the paper gives all that the statement
    depends on, `inferred` if the weld's shape was searched for with its words, `assumed` if the welds are synthetic,
    `none` if it gives too little for any check. `if_not` says beforehand what a difference would mean, `found` what
    explained one afterwards, `corrected` which criteria the statement itself asks for.
    """

    id: Annotated[str, Meta(pattern=r"^[a-z0-9]+(-[a-z0-9]+)*$")]
    where: _Text
    statement: _Text
    geometry: GeometrySource
    study: StudyName
    criteria: list[Condition]
    note: _Text
    if_not: _Text | None = None
    found: _Text | None = None
    corrected: Correction | None = None

    def problem(self) -> str | None:
        """Return why the claim is invalid beyond its types, or None."""
        if (self.geometry == "none") is not (not self.criteria):
            return "a claim has criteria unless its geometry is none"
        if self.corrected and not self.criteria:
            return "a claim without criteria has none to correct"
        foreign = [c.key for c in self.all_criteria if c.key.partition(".")[0] != self.study]
        if foreign:
            return f"{foreign[0]} is not measured by the study {self.study}"
        return next(filter(None, (condition.problem() for condition in self.all_criteria)), None)

    @property
    def all_criteria(self) -> list[Condition]:
        """Return the criteria, and those that correct them."""
        return [*self.criteria, *(self.corrected.criteria if self.corrected else ())]

    @property
    def stated_criteria(self) -> list[Condition]:
        """Return what the statement asks for: the criteria, or those that correct them."""
        return self.corrected.criteria if self.corrected else self.criteria


class HeldOutResult(msgspec.Struct, kw_only=True, frozen=True):
    """The result over shapes whose searches were not given the claims of this one's fold.

    `corrected_result` is by corrected criteria, if the claim has any, else the result.
    """

    fold: int
    measured: str
    result: ClaimResult
    corrected_result: ClaimResult


class CorrectedResult(msgspec.Struct, kw_only=True, frozen=True):
    """The result by criteria that were corrected after the run, and why they were."""

    criterion: str
    measured: str
    result: ClaimResult
    reason: str


class EvaluatedClaim(msgspec.Struct, kw_only=True, frozen=True):
    """A claim with its result, one entry of `claims.json`. A value there is null where the quantity does not exist.

    `result` is by the criteria that were fixed beforehand; `corrected` is beside it where they asked for more than the
    statement says. `held_out` is beside it where the geometry is inferred, as `result` is then over shapes that were
    searched for with this claim among others.
    """

    id: str
    statement: str = msgspec.field(name="claim")
    where: str
    study: StudyName
    geometry: GeometrySource
    criterion: str
    note: str
    measured: str
    values: dict[str, float | bool | str | list[float | None] | None]
    result: ClaimResult
    why: str
    corrected: CorrectedResult | None = None
    held_out: HeldOutResult | None = None

    @property
    def corrected_result(self) -> ClaimResult:
        """Return the result by the corrected criteria, if there are any, else the result."""
        return self.corrected.result if self.corrected else self.result


def load() -> list[Claim]:
    """Return the claims that come with the package.

    Raises:
        InputError: the file is damaged.
    """
    path = resources.files("weld_force_ros") / "data" / "claims.yaml"
    return parse(path.read_bytes(), "data/claims.yaml")


def folds(claims: Sequence[Claim]) -> dict[str, int]:
    """Return the fold of each claim of inferred geometry by its id: 1 to `FOLDS` in turn, in the claims' order."""
    inferred = [claim.id for claim in claims if claim.geometry == "inferred"]
    return {name: 1 + index % FOLDS for index, name in enumerate(inferred)}


def parse(data: bytes, source: str) -> list[Claim]:
    """Read claims from the bytes of their YAML file; `source` names it in errors.

    Raises:
        InputError: not YAML, a field unknown, missing or out of place, or an id given twice.
    """
    try:
        claims = _yaml.decode(data, list[Claim])
    except (msgspec.DecodeError, ValueError) as error:
        raise InputError(f"claims file {source}: {' '.join(str(error).split())}", _REMEDY) from None
    seen: set[str] = set()
    for claim in claims:
        problem = f"the id {claim.id} is given twice" if claim.id in seen else claim.problem()
        if problem:
            raise InputError(f"claims file {source}, claim {claim.id}: {problem}", _REMEDY)
        seen.add(claim.id)
    return claims


def evaluate(
    claims: Sequence[Claim],
    measured: Mapping[str, Quantity],
    without_folds: Mapping[int, Mapping[str, Quantity]] | None = None,
) -> list[EvaluatedClaim]:
    """Compare each claim with what the studies measured, in the order of the claims.

    A claim agrees if every element of every quantity meets its condition, differs if none does, and agrees partly
    otherwise. It is not evaluated if a quantity was not measured.

    Args:
        claims: all, as their order decides on folds.
        measured: by the studies.
        without_folds: of each fold, what is measured over shapes that were searched for without its claims.

    Raises:
        InputError: a quantity is of the wrong kind for its criterion.
    """
    fold_of, over_other_shapes = folds(claims), without_folds or {}
    held_out = {
        claim.id: _held_out(claim, fold_of[claim.id], over_other_shapes[fold_of[claim.id]])
        for claim in claims
        if fold_of.get(claim.id) in over_other_shapes
    }
    return [_evaluated(claim, measured, held_out.get(claim.id)) for claim in claims]


def write(evaluated: Sequence[EvaluatedClaim], path: Path) -> None:
    """Write `claims.json`, one object a claim.

    Raises:
        InputError: the place cannot be written.
    """
    with os_errors_as(InputError, path, "name a writable folder"), whole_file(path) as stream:
        stream.write(msgspec.json.format(msgspec.json.encode(evaluated), indent=2) + b"\n")


def table(evaluated: Sequence[EvaluatedClaim]) -> Table:
    """Return a row for each claim with its result; columns without heading are for the file only."""
    columns = (
        Column("id", "claim"),
        Column("where", "in the paper"),
        Column("statement"),
        Column("geometry", "geometry"),
        Column("result", "result"),
        Column("held_out", "held out"),
        Column("measured", "measured"),
        Column("why"),
    )
    rows = [
        (
            e.id, e.where, e.statement, e.geometry, e.result, e.held_out.result if e.held_out else None, e.measured,
            e.why,
        )
        for e in evaluated
    ]  # fmt: skip
    return Table("What the paper says and what was measured", columns, list(rows))


def summary(evaluated: Sequence[EvaluatedClaim]) -> Table:
    """Count the claims by geometry and result, with the share of those evaluated that agree.

    Claims of inferred geometry are counted over the shapes that ship, and again over those that were searched for
    without their fold. The last two columns count those as well whose criteria asked for more than the statement says,
    by what it says.
    """
    columns = (
        Column("geometry", "geometry"),
        *(Column(result.replace(" ", "_").replace("-", "_"), result) for result in RESULTS),
        Column("agree_percent", "agree %", 0),
        Column("agrees_corrected", "agrees, criteria corrected", 0),
        Column("agree_corrected_percent", "agree %, criteria corrected", 0),
    )
    of_kind = {kind: [one for one in evaluated if one.geometry == kind] for kind in get_args(GeometrySource)}
    held_out = [one.held_out for one in evaluated if one.held_out]
    rows = [
        ("exact", *_counts(of_kind["exact"])),
        ("inferred, all claims given", *_counts(of_kind["inferred"])),
        ("inferred, held out", *_counts(held_out)),
        ("assumed", *_counts(of_kind["assumed"])),
        ("none", *_counts(of_kind["none"])),
    ]
    return Table("Claims by what the paper gives of the geometry", columns, rows)


def _counts(evaluated: Sequence[EvaluatedClaim] | Sequence[HeldOutResult]) -> tuple[float | None, ...]:
    counts = [sum(one.result == result for one in evaluated) for result in RESULTS]
    evaluable = sum(counts[:3])
    corrected = sum(one.corrected_result == "agrees" for one in evaluated)
    shares = [100 * agreeing / evaluable if evaluable else None for agreeing in (counts[0], corrected)]
    return (*counts, shares[0], corrected, shares[1])


def _held_out(claim: Claim, fold: int, measured: Mapping[str, Quantity]) -> HeldOutResult:
    values = _values(claim, measured)
    return HeldOutResult(
        fold=fold,
        measured=_measured(claim.criteria, values),
        result=_result(claim.criteria, values),
        corrected_result=_result(claim.stated_criteria, values),
    )


def _evaluated(claim: Claim, measured: Mapping[str, Quantity], held_out: HeldOutResult | None) -> EvaluatedClaim:
    values = _values(claim, measured)
    missing = [c.key for c in claim.criteria if c.key not in values]
    result = _result(claim.criteria, values)
    failed = [c for c in claim.criteria if c.key in values and not all(c.holds(values[c.key]))]
    corrected = claim.corrected
    return EvaluatedClaim(
        id=claim.id,
        statement=claim.statement,
        where=claim.where,
        study=claim.study,
        geometry=claim.geometry,
        criterion=_criterion(claim.criteria),
        note=claim.note,
        measured=_measured(claim.criteria, values),
        values={key: _jsonable(value) for key, value in values.items()},
        result=result,
        why=_why(claim, result, missing, failed),
        corrected=CorrectedResult(
            criterion=_criterion(corrected.criteria),
            measured=_measured(corrected.criteria, values),
            result=_result(corrected.criteria, values),
            reason=corrected.reason.strip(),
        )
        if corrected
        else None,
        held_out=held_out,
    )


def _values(claim: Claim, measured: Mapping[str, Quantity]) -> dict[str, Quantity]:
    return {c.key: _plain(measured[c.key]) for c in claim.all_criteria if c.key in measured}


def _result(criteria: Sequence[Condition], values: Mapping[str, Quantity]) -> ClaimResult:
    if not criteria:
        return "not-testable"
    if any(condition.key not in values for condition in criteria):
        return "not evaluated"
    holds = [held for condition in criteria for held in condition.holds(values[condition.key])]
    return "agrees" if all(holds) else "partly" if any(holds) else "differs"


def _criterion(criteria: Sequence[Condition]) -> str:
    return "; ".join(f"{_label(c, len(criteria))}{c.in_words()}" for c in criteria)


def _measured(criteria: Sequence[Condition], values: Mapping[str, Quantity]) -> str:
    return "; ".join(
        f"{_label(c, len(criteria))}{c.value_in_words(values[c.key])}, required: {c.in_words()}"
        for c in criteria
        if c.key in values
    )


def _label(condition: Condition, count: int) -> str:
    """Return the quantity's name to stand before its value if there are several."""
    return f"{_quantity(condition.key)} " if count > 1 else ""


def _why(claim: Claim, result: ClaimResult, missing: Sequence[str], failed: Sequence[Condition]) -> str:
    if result == "not-testable":
        return claim.note
    if result == "not evaluated":
        return f"Not measured: {', '.join(missing)}"
    if result == "agrees":
        return "Meets its criteria"
    unmet = ", ".join(_quantity(condition.key) for condition in failed)
    reasons = [f"Does not meet its criteria: {unmet}", claim.if_not, claim.found]
    if claim.geometry == "inferred":
        reasons.append("The shape is inferred from the paper's text, which does not give it")
    return ". ".join(reason.strip().rstrip(".") for reason in reasons if reason)


def _plain(value: Quantity) -> Quantity:
    """Return the value in Python's own types, whole numbers as floats."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, list | np.ndarray):
        return [cast(float, _plain(element)) for element in value]
    return value if isinstance(value, str) else float(value)


def _jsonable(value: Quantity) -> float | bool | str | list[float | None] | None:
    if isinstance(value, list):
        return [number if math.isfinite(number) else None for number in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _quantity(key: str) -> str:
    """Return the quantity in words: `length.first_maximum_48mm_kmh` -> `first maximum 48mm`."""
    words = key.partition(".")[2].split("_")
    return " ".join(words[:-1] if len(words) > 1 and words[-1] in _UNITS else words)


def _unit(key: str) -> str:
    return f" {_UNITS[last]}" if (last := key.rpartition("_")[2]) in _UNITS else ""


def _number(value: float, unit: str = "") -> str:
    if not math.isfinite(value):
        return "none"
    return f"{value:.0f}{unit}" if abs(value) >= 1000 else f"{value:.4g}{unit}"


def _yes_or_no(flag: bool) -> str:
    return "yes" if flag else "no"
