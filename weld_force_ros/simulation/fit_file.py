"""Fits as files hold them: input, errors and coefficients; each makes the model that engines step."""

from importlib import resources
from pathlib import Path

import msgspec
import numpy as np

from weld_force_ros import _files
from weld_force_ros.physics.engines.common_poles import PoleModel
from weld_force_ros.physics.engines.moving_poles import MovingPoleModel
from weld_force_ros.physics.engines.rational_fractions import RfpModel


class Fit(msgspec.Struct, kw_only=True, tag_field="engine"):
    """A fit on disk: its input, its errors, and the errors that no causal fit could avoid.

    `*_by_band` follow `bands_hz` (pairs of ends): RMS of |fit - exact| / |exact + contact and wheel|, and the same for
    the exact receptance cut at the impulse, mid-span.
    """

    key: str
    track: str
    software: str
    order: int
    spacing_m: float
    error: float
    bands_hz: list[float]
    error_by_band: list[float]
    acausal_energy_share: float
    acausal_floor_by_band: list[float]

    @property
    def engine(self) -> str:
        """The engine that uses it."""
        return str(self.__struct_config__.tag)


class PolesFit(Fit, kw_only=True, tag="common-poles"):
    """Common poles; `residues_*` are row-major (section, pole), `node_*` as `PoleModel.nodes`."""

    section_m: list[float]
    poles_re_rad_s: list[float]
    poles_im_rad_s: list[float]
    residues_re: list[float]
    residues_im: list[float]
    spans: int = 1
    image_m: float = 0.0
    node_poles: list[int] = []
    node_m: list[float] = []

    def model(self) -> PoleModel:
        """Return the fitted track."""
        shape = (len(self.section_m), len(self.poles_re_rad_s))
        return PoleModel(
            poles_rad_s=np.array(self.poles_re_rad_s) + 1j * np.array(self.poles_im_rad_s),
            residues=(np.array(self.residues_re) + 1j * np.array(self.residues_im)).reshape(shape),
            section_m=np.array(self.section_m),
            spacing_m=self.spacing_m,
            spans=self.spans,
            image_m=self.image_m,
            nodes=tuple(zip(self.node_poles, self.node_m, strict=True)),
        )


class RfpFit(Fit, kw_only=True, tag="rfp"):
    """Rational fractions; tables are row-major (section, coefficient) or (section, pole).

    `front_*` are the objectives of all fits that the search found unbeaten, `knee` the chosen one among them, `plain_*`
    those of the fit with weights 1 / |h|; `genes` are the chosen weights' logarithms and the tie's.
    """

    seed: int
    generations: int
    population: int
    section_count: int
    scale_rad_s: float
    denominator: list[float]
    numerator: list[float]
    poles_re_rad_s: list[float]
    poles_im_rad_s: list[float]
    genes: list[float]
    front_error: list[float]
    front_variation: list[float]
    knee: int
    plain_error: float
    plain_variation: float

    def model(self) -> RfpModel:
        """Return the fitted track."""
        shape = (self.section_count, self.order)
        return RfpModel(
            denominator=np.array(self.denominator).reshape(shape),
            numerator=np.array(self.numerator).reshape(shape),
            spacing_m=self.spacing_m,
            scale_rad_s=self.scale_rad_s,
        )


class MovingPolesFit(Fit, kw_only=True, tag="moving-poles"):
    """Common poles that change with speed, as of `physics.engines.moving_poles`; `series_*` are row-major."""

    rates_re: list[float]
    rates_im: list[float]
    rate_changes_re: list[float]
    rate_changes_im: list[float]
    strengths: list[float]
    strength_changes_re: list[float]
    strength_changes_im: list[float]
    series_re: list[float]
    series_im: list[float]
    symmetries: list[int]

    def model(self) -> MovingPoleModel:
        """Return the fitted track."""
        return MovingPoleModel(
            rates=np.array(self.rates_re) + 1j * np.array(self.rates_im),
            rate_changes=np.array(self.rate_changes_re) + 1j * np.array(self.rate_changes_im),
            strengths=np.array(self.strengths),
            strength_changes=np.array(self.strength_changes_re) + 1j * np.array(self.strength_changes_im),
            series=(np.array(self.series_re) + 1j * np.array(self.series_im)).reshape(len(self.rates_re), -1),
            symmetries=np.array(self.symmetries),
            spacing_m=self.spacing_m,
        )


AnyFit = PolesFit | RfpFit | MovingPolesFit


def write(fit: AnyFit, path: Path) -> None:
    """Write a fit so that another process sees either the whole file or none."""
    _files.write_whole(path, msgspec.json.format(msgspec.json.encode(fit), indent=0) + b"\n")


def read(file: resources.abc.Traversable, key: str) -> AnyFit | None:
    """Return the fit of that key in a file, or None: a damaged one counts as absent."""
    try:
        fit: AnyFit = msgspec.json.decode(file.read_bytes(), type=AnyFit)
        fit.model()
    except (OSError, ValueError):
        return None
    return fit if fit.key == key else None
