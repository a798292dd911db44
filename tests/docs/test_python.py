"""The Python of README and docs runs, and gives what the pages show."""

import contextlib
import io
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, ROOT, blocks, shown_after

NOT_RUN = {
    "x = np.linspace(-0.5, 0.5, 201)": "README's, run by tests/end_to_end/test_public_api.py",
    "from weld_force_ros.campaign import query": "of a campaign's results; examples/campaign_results.ipynb is run",
}

SNIPPETS = {
    block: page
    for page in PAGES
    for block in blocks(page, "python")
    if not any(beginning in block for beginning in NOT_RUN)
}


def test_every_exception_still_stands_on_a_page():
    everything = [block for page in PAGES for block in blocks(page, "python")]
    assert all(any(beginning in block for block in everything) for beginning in NOT_RUN)


def test_the_start_page_has_the_program_of_the_readme():
    program = next(blocks(ROOT / "README.md", "python"))
    start = ROOT / "docs/start/python.md"
    assert program in blocks(start, "python")
    assert shown_after(start, program) == shown_after(ROOT / "README.md", program)


@pytest.mark.slow
@pytest.mark.parametrize("snippet", SNIPPETS, ids=lambda snippet: SNIPPETS[snippet].stem)
def test_the_python_runs(snippet: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(ROOT)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(snippet, str(Path("snippet")), "exec"), {})  # noqa: S102
    if printed.getvalue():
        assert printed.getvalue() == shown_after(SNIPPETS[snippet], snippet)
