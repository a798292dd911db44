"""`weld-force population`: synthetic welds as measurements, for trying things out at any size."""

from pathlib import Path
from typing import Annotated

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import in_existing_folder
from weld_force_ros.errors import InputError, os_errors_as

_TABLE = ".parquet"


def population(
    count: Annotated[int, typer.Argument(metavar="N", min=1, help="How many welds.")],
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", callback=in_existing_folder, help="A folder for profile files, or a .parquet file."
        ),
    ],
    seed: Annotated[int, typer.Option(min=0, help="Weld k of a seed is the same in a population of any size.")] = 1,
    json: Annotated[
        str | None,
        typer.Option("--json", metavar="FILE|-", callback=in_existing_folder, help="Say where they are as JSON."),
    ] = None,
) -> None:
    """Write seeded synthetic welds along a line: geometries of the population study, chainage, speed, position."""
    from weld_force_ros.campaign.synthetic_network import network
    from weld_force_ros.cli import terminal

    with terminal.progress() as bar:
        welds = bar.track(network(count, seed), total=count, description="making welds")
        if out.suffix == _TABLE:
            _check_pyarrow()
            from weld_force_ros.campaign import profile_table

            profile_table.write(out, welds)
        else:
            from weld_force_ros.measurement.profile_file import write_profile

            _make_folder(out)
            for weld in welds:
                write_profile(weld, out / f"{weld.weld_id}.csv")
    terminal.say(f"written: {terminal.counted(count, 'weld')} of seed {seed} to {out}")
    with json_output.lines(json) as lines:
        json_output.write(lines, {"welds": count, "seed": seed, "out": str(out)})


def _make_folder(folder: Path) -> None:
    with os_errors_as(InputError, folder, "name a writable folder"):
        folder.mkdir(parents=True, exist_ok=True)


def _check_pyarrow() -> None:
    try:
        import pyarrow  # type: ignore[import-untyped]  # noqa: F401
    except ImportError:
        raise InputError(
            "a Parquet table needs pyarrow",
            "install it with `pip install 'weld_force_ros[campaign]'`, or name a folder",
        ) from None
