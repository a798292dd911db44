"""Store results on disk: Parquet parts and Zarr chunks, each there as a whole or not at all, each of one batch.

    verdicts/section=SECTION/batch-000007.parquet        rows of `tables.VERDICTS`, one a weld
    other_vehicles/section=SECTION/batch-000007.parquet  of the vehicles over a weld that do not decide
    speeds/section=SECTION/batch-000007.parquet          rows of `tables.SPEEDS`
    rejections/batch-000007.parquet                      rows of `tables.REJECTIONS`
    maps.zarr/SECTION/VEHICLE/peak_force_n …             (weld, speed, position), a chunk a batch

Along `weld` a map stands at its weld's number; welds of other sections, and rejected ones, are NaN there.
"""

import hashlib
import io
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
import zarr

from weld_force_ros import _files
from weld_force_ros.campaign.campaign_file import NetworkSection
from weld_force_ros.campaign.plan import Plan
from weld_force_ros.messages import SimulationSettings

MAPS = "maps.zarr"
_CACHED_GROUPS = 64

MAP_VARIABLES = {
    "peak_force_n": ("N", "greatest contact force"),
    "peak_x_m": ("m", "place of the wheel at the greatest force, after the sleeper before the weld"),
    "min_force_n": ("N", "least contact force"),
    "contact_loss_s": ("s", "time without contact"),
    "p2_force_n": ("N", "greatest force below 120 Hz"),
    "force_20hz_n": ("N", "greatest force below 20 Hz"),
}


def write_table(table: Any, out: Path, name: str) -> dict[str, str]:
    """Write one Parquet part; return its name and hash."""
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    data = buffer.getvalue()
    _files.write_whole(out / name, data)
    return {name: hashlib.sha256(data).hexdigest()}


def part(kind: str, batch: int, section: str | None = None) -> str:
    """Return the name of a batch's part of a dataset."""
    partition = f"section={section}/" if section else ""
    return f"{kind}/{partition}batch-{batch:06d}.parquet"


def table_of(rows: Iterable[dict[str, Any]], schema: Any) -> Any:
    """Return rows as a table."""
    return pa.Table.from_pylist(list(rows), schema)


def create_maps(plan: Plan, out: Path) -> None:
    """Create the store's groups and arrays, empty; existing ones stay.

    Raises:
        OSError: it cannot be written.
    """
    root = zarr.open_group(out / MAPS, mode="a", zarr_format=3)
    root.attrs.update({"title": plan.name, "source": plan.software})
    for section in plan.sections:
        for vehicle, settings in section.vehicles.items():
            _create_group(root.require_group(f"{section.name}/{vehicle}"), plan, section, settings)


def _create_group(group: Any, plan: Plan, section: NetworkSection, settings: SimulationSettings) -> None:
    group.attrs.update(
        {"track": settings.track, "config_sha256": settings.config_sha256, "static_load_n": settings.static_load_n}
    )
    _axis(group, "speed_kmh", settings.speeds_kmh, "km/h", "speed")
    _axis(group, "position_m", settings.positions_m, "m", "weld's centre after the sleeper")
    shape = (plan.welds, len(settings.speeds_kmh), len(settings.positions_m))
    for name, (units, long_name) in MAP_VARIABLES.items():
        if name not in group:
            group.create_array(
                name, shape=shape, chunks=(plan.batch_welds, *shape[1:]), dtype="float32", fill_value=np.nan,
                dimension_names=("weld", "speed_kmh", "position_m"),
                attributes={"units": units, "long_name": long_name, "coordinates": "chainage_m"},
            )  # fmt: skip
    if "chainage_m" not in group:
        group.create_array(
            "chainage_m", shape=shape[:1], chunks=(plan.batch_welds,), dtype="float64", fill_value=np.nan,
            dimension_names=("weld",), attributes={"units": "m", "long_name": "chainage of the weld"},
        )  # fmt: skip


def _axis(group: Any, name: str, values: list[float], units: str, long_name: str) -> None:
    if name not in group:
        array = group.create_array(
            name, data=np.array(values), dimension_names=(name,), attributes={"units": units, "long_name": long_name}
        )
        del array


@lru_cache(_CACHED_GROUPS)
def _group(path: Path, name: str) -> Any:
    return zarr.open_group(path, path=name, mode="r+")


def write_maps(blocks: dict[str, Any], out: Path, case: str, first: int) -> dict[str, str]:
    """Write a batch's chunk of every array of a case; return the chunks' names and hashes.

    Args:
        blocks: by variable, (n_weld, ...).
        out: the campaign's folder.
        case: section and vehicle, as the group is named.
        first: number of the first weld.
    """
    group, files = _group(out / MAPS, case), {}
    for name, block in blocks.items():
        array = group[name]
        array[first : first + len(block)] = block
        chunk = "/".join(["c", str(first // array.chunks[0]), *"0" * (block.ndim - 1)])
        path = f"{MAPS}/{case}/{name}/{chunk}"
        files[path] = hashlib.sha256((out / path).read_bytes()).hexdigest()
    return files
