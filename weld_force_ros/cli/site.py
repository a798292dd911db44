"""Settings of a site: the option `--site` of several commands, and `weld-force init`, which writes the files."""

import difflib
import inspect
from collections.abc import Callable
from functools import wraps
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import typer

from weld_force_ros import _yaml
from weld_force_ros._files import whole_file
from weld_force_ros.cli.options import in_existing_folder
from weld_force_ros.errors import InputError, os_errors_as

SITE = "site.yaml"

SitePath = Annotated[
    Path | None,
    typer.Option(metavar="SITE.yaml", help="Settings of a site, see `weld-force init`; other options override them."),
]


class _Site(msgspec.Struct, frozen=True):
    """What a site states, None where it states nothing; the names of the options that it stands for."""

    limits: str | list[str] | None = None
    vehicle: str | list[str] | None = None
    track: str | None = None
    running: Literal["with", "against", "both"] | None = None
    line_speed_kmh: Annotated[float, msgspec.Meta(gt=0, le=1000)] | None = None
    format: str | None = None


def with_site(command: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate a command of which a site states options: `--site` gives those that stand in no other way."""
    signature = inspect.signature(command)
    option = inspect.Parameter("site", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=SitePath)

    @wraps(command)
    def run(*, site: Path | None, **given: Any) -> Any:
        stated = {} if site is None else read_site(site)
        of_site = {name: value for name, value in stated.items() if name in given and given[name] is None}
        return command(**{**given, **of_site})

    run.__signature__ = signature.replace(parameters=[*signature.parameters.values(), option])  # type: ignore[attr-defined]
    run.__annotations__ = {**command.__annotations__, "site": SitePath}
    return run


def read_site(path: Path) -> dict[str, Any]:
    """Return the options that a site states, as commands take them; files by their path.

    Raises:
        InputError: not readable, an unknown key (the nearest is named), or a value that cannot be.
    """
    remedy = "write it with `weld-force init FOLDER`, and change that"
    try:
        content = _yaml.decode(_yaml.read(path), dict[str, Any])
        for key in content.keys() - set(_Site.__struct_fields__):
            near = difflib.get_close_matches(key, _Site.__struct_fields__, 1)
            known = f"write {near[0]}" if near else f"use {', '.join(_Site.__struct_fields__)}"
            raise InputError(f"site {path}: {key!r} is no setting of a site", known)
        site = msgspec.convert(content, _Site)
    except OSError as error:
        raise InputError(f"site {path}: {error.strerror or error}", remedy) from None
    except (msgspec.MsgspecError, ValueError) as error:
        raise InputError(f"site {path}: {error}", remedy) from None
    limits, vehicles = _all_from(site.limits, path.parent), _all_from(site.vehicle, path.parent)
    options = {
        "limits": limits and ",".join(limits),
        "vehicle": vehicles,
        "track": site.track and _from(site.track, path.parent),
        "running": site.running,
        "line_speed_kmh": site.line_speed_kmh,
        "format": site.format and _from(site.format, path.parent),
    }
    return {name: value for name, value in options.items() if value}


def _all_from(names: str | list[str] | None, folder: Path) -> list[str]:
    listed = names.split(",") if isinstance(names, str) else names or []
    return [_from(name.strip(), folder) for name in listed]


def _from(name: str, folder: Path) -> str:
    """Return the path of a file as a site's folder has it; the name of what is bundled as it is."""
    return str(folder / name) if name.endswith((".yaml", ".yml")) else name


def init(
    folder: Annotated[
        Path, typer.Argument(callback=in_existing_folder, help="New folder, or one without these files.")
    ],
) -> None:
    """Write the files of a site to fill in: settings for --site, limits, a vehicle, an instrument's format."""
    from weld_force_ros.assessment.rule_books import FORCE, text_of
    from weld_force_ros.cli import terminal

    vehicle = (resources.files("weld_force_ros.data") / "vehicles" / "passenger.yaml").read_text(encoding="utf-8")
    texts = {
        SITE: _template(SITE).replace("{folder}", str(folder)),
        "limits.yaml": text_of(FORCE, "limits"),
        "vehicle.yaml": _template("vehicle.yaml") + vehicle.replace("name: passenger\n", "name: vehicle\n", 1),
        "instrument.yaml": _template("instrument.yaml").replace("{folder}", str(folder)),
    }
    for name in texts:
        if (folder / name).exists():
            raise InputError(f"{folder / name} is there already", "name another folder, or remove it")
    with os_errors_as(InputError, folder, "name a writable folder"):
        folder.mkdir(exist_ok=True)
        for name, text in texts.items():
            with whole_file(folder / name) as file:
                file.write(text.encode())
    terminal.say(f"written: {', '.join(str(folder / name) for name in texts)}")
    terminal.say(f"next:    weld-force assess FILES --site {folder / SITE}")


def _template(name: str) -> str:
    return (resources.files("weld_force_ros.data") / "site" / name).read_text(encoding="utf-8")
