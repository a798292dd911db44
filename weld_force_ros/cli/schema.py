"""Run `weld-force schema`: the JSON Schemas of messages, and the parameter file."""

import sys
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer

from weld_force_ros.cli.json_output import output_file
from weld_force_ros.cli.options import in_existing_folder


def schema(
    write: Annotated[
        Path | None, typer.Option(callback=in_existing_folder, help="Folder to write one JSON Schema a message to.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(callback=in_existing_folder, help="Folder for the parameter file and its schema.")
    ] = None,
) -> None:
    """Write the messages' JSON Schemas to standard output or a folder; also the parameter file and its schema."""
    from weld_force_ros.messages import SCHEMAS, json_schema
    from weld_force_ros.ros import parameters

    for kind in SCHEMAS:
        if write is None and config is None:
            sys.stdout.write(msgspec.json.encode(json_schema(kind)).decode() + "\n")
        elif write is not None:
            _write(write / f"{kind.__name__}.json", _indented(json_schema(kind)))
    if config is not None:
        _write(config / "schema.json", _indented(parameters.parameter_file_schema()))
        _write(config / "default.yaml", parameters.default_parameter_text())


def _indented(content: dict[str, Any]) -> str:
    return msgspec.json.format(msgspec.json.encode(content), indent=2).decode() + "\n"


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(exist_ok=True)
    with output_file(path) as file:
        file.write(text)
