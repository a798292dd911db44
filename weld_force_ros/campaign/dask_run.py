"""Run a campaign on Dask, from its plan to its manifest.

The client hands out a bounded number of batches at a time and keeps nothing of them but counts: its memory does not
grow with the campaign. What a lost worker had under way is given to another; what a lost client left open is found open
by the next run.
"""

import contextlib
import itertools
import logging
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any, NamedTuple

from weld_force_ros._files import TEMPORARY
from weld_force_ros.campaign import batch_records, batch_task, result_store, sources
from weld_force_ros.campaign import plan as plans
from weld_force_ros.campaign.batch_records import BatchRecord, Manifest
from weld_force_ros.campaign.plan import Plan
from weld_force_ros.errors import InputError, WeldForceError, os_errors_as

LOCAL = "127.0.0.1"
DASHBOARD_PORT = 8787
_LOST_WORKERS = 10  # that may take one batch with them before it is held to be the cause
_LOCAL_SETTINGS = {
    "distributed.scheduler.allowed-failures": _LOST_WORKERS,
    "distributed.worker.profile.enabled": False,  # it looks at every thread a hundred times a second
}
_LEAST_SUBMITTED = 16
_SUBMITTED_PER_THREAD = 4
_WAIT_FOR_WORKERS_S = 60.0
_LEFTOVERS = (f"*{TEMPORARY}", "*.partial")


class FailedBatch(NamedTuple):
    """A batch that could not be assessed because it killed every worker that took it."""

    batch: int
    reason: str


@contextlib.contextmanager
def cluster(scheduler: str | None, workers: int) -> Iterator[Any]:
    """Yield a Dask client of the scheduler at an address, or of worker processes of one thread each on this machine.

    Raises:
        InputError: dask is not installed, or nobody answers at the address.
    """
    try:
        import dask
        import distributed
    except ImportError:
        raise InputError("a campaign needs Dask", "install it with `pip install 'weld_force_ros[campaign]'`") from None
    with contextlib.ExitStack() as stack:
        if scheduler is None:
            stack.enter_context(dask.config.set(_LOCAL_SETTINGS))
            logging.getLogger("distributed").setLevel(logging.CRITICAL)
            local = stack.enter_context(_local(distributed, workers))
            client = stack.enter_context(distributed.Client(local))
        else:
            client = stack.enter_context(_connected(distributed, scheduler))
        yield client


def _local(distributed: Any, workers: int) -> Any:
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Port .* is already in use")  # another one is taken, and said
            return distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                host=LOCAL,
                dashboard_address=f"{LOCAL}:{DASHBOARD_PORT}",
                worker_dashboard_address=None,
                silence_logs=logging.CRITICAL,
            )
    except (RuntimeError, OSError, TimeoutError) as error:  # a worker that ended before it had begun
        raise InputError(f"workers did not start: {error}", "run the same command again") from None


def _connected(distributed: Any, scheduler: str) -> Any:
    try:
        client = distributed.Client(scheduler)
        client.wait_for_workers(1, timeout=_WAIT_FOR_WORKERS_S)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(
            f"scheduler {scheduler}: {error}", "start one with `dask scheduler`, and workers with `dask worker`"
        ) from None
    return client


def threads(client: Any) -> int:
    """Return the number of batches that the workers assess at once."""
    return int(sum(client.nthreads().values()))


def prepare(plan: Plan, out: Path) -> list[BatchRecord]:
    """Prepare the folder of results; return the records of the batches that are finished in it.

    Raises:
        InputError: other results are there, or it cannot be written.
    """
    with os_errors_as(InputError, out, "give --out a writable folder"):
        plans.claim_folder(plan, out)
        result_store.create_maps(plan, out)
        batch_task.export_fits(plan, out)
    return list(batch_records.finished(out, plan.sha256, plan.batches))


def distribute(
    client: Any, plan: Plan, out: Path, finished: set[int], on_done: Callable[[BatchRecord], None]
) -> list[FailedBatch]:
    """Have every batch assessed that is not finished; return those that could not be.

    Raises:
        InputError: a worker cannot write or read what it must, or the scheduler is lost.
    """
    from distributed import as_completed

    sha256, failed = plan.sha256, list[FailedBatch]()
    open_batches = (b for b in sources.batches(plan.sources, plan.batch_welds) if b.number not in finished)

    def submitted(batch: sources.WeldBatch) -> Any:
        # Dask makes one task of the key `PLAN-BATCH`, however often it is submitted.
        return client.submit(batch_task.assess_batch, str(out), sha256, batch, key=f"{sha256[:12]}-{batch.number}")

    completed = as_completed(
        map(submitted, itertools.islice(open_batches, max(_LEAST_SUBMITTED, _SUBMITTED_PER_THREAD * threads(client))))
    )
    for future in completed:
        if (record := _record(future, out, failed)) is not None:
            on_done(record)
        future.release()
        for batch in itertools.islice(open_batches, 1):
            completed.add(submitted(batch))
    return failed


def _record(future: Any, out: Path, failed: list[FailedBatch]) -> BatchRecord | None:
    from distributed import KilledWorker
    from distributed.comm import CommClosedError

    try:
        record: BatchRecord = future.result()
    except KilledWorker as error:
        failed.append(FailedBatch(int(future.key.rpartition("-")[2]), f"it took {_LOST_WORKERS} workers: {error}"))
    except WeldForceError:
        raise
    except (CancelledError, ConnectionError, CommClosedError):
        raise InputError("the scheduler was lost", "start it and run the same command again: it goes on") from None
    except OSError as error:
        where = error.filename or out
        raise InputError(
            f"{where}: {error.strerror or error}", "see to it and run the same command again: it goes on"
        ) from None
    else:
        return record
    return None


def complete(plan: Plan, out: Path) -> Manifest:
    """Remove what killed processes left half written, and write the manifest.

    Raises:
        InputError: it cannot be written.
    """
    with os_errors_as(InputError, out, "see to it and run the same command again"):
        for pattern in _LEFTOVERS:
            for leftover in out.rglob(pattern):
                leftover.unlink(missing_ok=True)
        return batch_records.complete(out, plan.sha256, plan.software, plan.batches)
