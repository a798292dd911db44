"""One page of all figures: self-contained HTML that needs no network, for a phone and for print (extra: report)."""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from weld_force_ros import SOFTWARE
from weld_force_ros._files import whole_file
from weld_force_ros.errors import InputError, os_errors_as
from weld_force_ros.report.figures import save
from weld_force_ros.studies.result_table import Table
from weld_force_ros.studies.study_context import StudyResult


@dataclass(frozen=True)
class RenderedStudy:
    """A study whose figures and tables are written."""

    name: str
    title: str
    pictures: list[tuple[str, str, Path]]
    tables: list[str]


def write_study(found: StudyResult, out: Path) -> RenderedStudy:
    """Write figures (PNG, SVG) and tables (CSV) into the study's own folder.

    Raises:
        InputError: the folder cannot be written, or matplotlib is not installed.
    """
    folder = make_folder(out / found.name)
    pictures = []
    for picture in found.pictures:
        for ending in ("svg", "png"):
            save(picture.figure, folder / f"{picture.name}.{ending}")
            picture.figure.set_layout_engine("none")  # laid out once: it takes as long as drawing
        pictures.append((picture.title, picture.caption, folder / f"{picture.name}.png"))
    for name, table in found.tables.items():
        table.write_csv(folder / f"{name}.csv")
    return RenderedStudy(found.name, found.title, pictures, [f"{found.name}/{name}.csv" for name in found.tables])


def write_alone(found: StudyResult, folder: Path, introduction: str) -> RenderedStudy:
    """Write a study as `write_study` does, and a page of it alone, which has its name."""
    rendered = write_study(found, folder)
    write_page(folder / f"{found.name}.html", [rendered], title=found.title, introduction=introduction)
    return rendered


def make_folder(folder: Path) -> Path:
    """Make a folder, if it does not exist, and return it.

    Raises:
        InputError: it cannot be made.
    """
    with os_errors_as(InputError, folder, "name a writable folder with --out"):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def write_page(
    path: Path,
    studies: Sequence[RenderedStudy],
    *,
    title: str,
    introduction: str,
    claims: Sequence[dict[str, Any]] = (),
    counts: Table | None = None,
) -> None:
    """Write the page.

    Args:
        path: of the HTML file.
        studies: in their order.
        title: of the page.
        introduction: a sentence or two below it.
        claims: each with claim, where, measured, result and why.
        counts: the claims' summary.

    Raises:
        InputError: jinja2 is not installed, or the place cannot be written.
    """
    try:
        import jinja2
    except ImportError:
        remedy = "install it with `pip install 'weld_force_ros[report]'`"
        raise InputError("the gallery needs jinja2", remedy) from None
    template = (resources.files("weld_force_ros.report") / "assets" / "gallery.html").read_text(encoding="utf-8")
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    page = environment.from_string(template).render(
        title=title,
        introduction=introduction,
        studies=[_as_embedded(study) for study in studies],
        claims=claims,
        counts=counts
        and {
            "headings": [column.heading for column in counts.columns],
            "rows": [[c.shown(cell) for c, cell in zip(counts.columns, row, strict=True)] for row in counts.rows],
        },
        software=SOFTWARE,
    )
    with os_errors_as(InputError, path, "name a writable folder with --out"), whole_file(path) as stream:
        stream.write(page.encode())


def _with_palette(png: Path) -> bytes:
    """Return a picture in 256 colours, a third of its size."""
    from PIL import Image  # comes with matplotlib

    small = io.BytesIO()
    Image.open(png).convert("RGB").quantize(256).save(small, "PNG", optimize=True)
    return small.getvalue()


def _as_embedded(study: RenderedStudy) -> dict[str, Any]:
    pictures = [
        {"title": title, "caption": caption, "png": base64.b64encode(_with_palette(png)).decode()}
        for title, caption, png in study.pictures
    ]
    return {"name": study.name, "title": study.title, "pictures": pictures, "tables": study.tables}
