"""Record what is finished: a file for each batch, written last and whole, and a manifest of all of them.

Records name every file of a batch with its hash. A batch without a record, or with files that do not match, is assessed
again; as results depend on nothing but the plan, it comes out the same.
"""

import hashlib
from collections.abc import Iterator
from pathlib import Path

import msgspec

from weld_force_ros import _files

FOLDER = "done"
MANIFEST = "manifest.json"


class BatchRecord(msgspec.Struct, frozen=True):
    """A finished batch.

    Attributes:
        plan_sha256: identity of the plan that the batch belongs to.
        verdicts: number of welds with a verdict.
        rejections: number of welds without one.
        files: SHA-256 of each file of its results, by the path below the campaign's folder.
    """

    plan_sha256: str
    batch: int
    welds: int
    verdicts: int
    rejections: int
    files: dict[str, str]


class Manifest(msgspec.Struct, frozen=True):
    """A finished campaign; `results_sha256` is of all names and hashes, so that two campaigns compare by it."""

    plan_sha256: str
    software: str
    batches: int
    welds: int
    verdicts: int
    rejections: int
    results_sha256: str
    files: dict[str, str]


def write(record: BatchRecord, out: Path) -> None:
    """Record that a batch is finished."""
    _files.write_whole(_path(out, record.batch), msgspec.json.encode(record))


def finished(out: Path, plan_sha256: str, batches: int) -> Iterator[BatchRecord]:
    """Yield the records of a plan's batches whose files are all there and as they were written."""
    for number in range(batches):
        record = _read(_path(out, number))
        if record is not None and record.plan_sha256 == plan_sha256 and not differing(record.files, out):
            yield record


def differing(files: dict[str, str], out: Path) -> list[str]:
    """Return the files that are missing or other than recorded."""
    return [name for name, sha256 in files.items() if _sha256(out / name) != sha256]


def complete(out: Path, plan_sha256: str, software: str, batches: int) -> Manifest:
    """Write the manifest of a campaign all of whose batches are finished.

    Raises:
        OSError: the manifest cannot be written.
    """
    records = [record for n in range(batches) if (record := _read(_path(out, n)))]
    files = {name: sha256 for record in records for name, sha256 in record.files.items()}
    manifest = Manifest(
        plan_sha256,
        software,
        len(records),
        sum(record.welds for record in records),
        sum(record.verdicts for record in records),
        sum(record.rejections for record in records),
        hashlib.sha256(msgspec.json.encode(files, order="sorted")).hexdigest(),
        files,
    )
    _files.write_whole(out / MANIFEST, msgspec.json.format(msgspec.json.encode(manifest), indent=1))
    return manifest


def _path(out: Path, batch: int) -> Path:
    return out / FOLDER / f"{batch:06d}.json"


def _read(path: Path) -> BatchRecord | None:
    try:
        return msgspec.json.decode(path.read_bytes(), type=BatchRecord)
    except (OSError, msgspec.DecodeError):
        return None


def _sha256(path: Path) -> str | None:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return None
