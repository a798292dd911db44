"""The notebooks run, and print what is committed in them."""

import json
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[2] / "examples"
NOTEBOOKS = sorted(path.stem for path in FOLDER.glob("*.ipynb"))
IN_THE_SUITE = ("recording",)
"""What runs each time; the others take some seconds each."""


def printed(notebook: Any) -> list[str]:
    """The standard output of every cell; what a cache or a machine adds goes to standard error."""
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    return ["".join(o.text for o in cell.outputs if o.get("name") == "stdout") for cell in cells]


def test_there_are_eight_and_none_is_large():
    assert len(NOTEBOOKS) == 8
    assert max((FOLDER / f"{name}.ipynb").stat().st_size for name in NOTEBOOKS) < 150_000


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_pictures_are_there_and_nothing_failed(name: str):
    content = json.loads((FOLDER / f"{name}.ipynb").read_text())
    outputs = [output for cell in content["cells"] for output in cell.get("outputs", [])]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert not [o for o in outputs if o["output_type"] == "error" or o.get("name") == "stderr"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [name if name in IN_THE_SUITE else pytest.param(name, marks=pytest.mark.long) for name in NOTEBOOKS]
)
def test_a_notebook_prints_what_is_committed_in_it(name: str):
    committed = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    again = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)

    NotebookClient(again, timeout=200, coalesce_streams=True, resources={"metadata": {"path": str(FOLDER)}}).execute()

    assert printed(again) == printed(committed)
    assert any(printed(committed))
