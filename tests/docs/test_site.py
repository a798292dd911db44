"""The site: it builds without a warning, loads nothing from a network, and holds every page."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tests.docs.pages import ROOT

LOADED = re.compile(r"""<(?:script|img|iframe|source|video|audio)\b[^>]*?\bsrc=["']?([^"'\s>]+)|<link\b[^>]*?>""")
HREF = re.compile(r"""\bhref=["']?([^"'\s>]+)""")
LOADING = ("stylesheet", "icon", "preload", "prefetch", "preconnect", "dns-prefetch", "modulepreload", "manifest")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as `make docs` builds it."""
    pytest.importorskip("mkdocs", reason="the extra `docs`")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def loaded_from_a_network(page: str) -> list[str]:
    """Return what a page of HTML loads by itself from another place than its own folder."""
    addresses = []
    for element in LOADED.finditer(page):
        relation = re.search(r"""\brel=["']?([\w-]+)""", element[0])
        href = HREF.search(element[0])
        address = element[1] or (href[1] if href else "")
        if (element[1] or (relation and relation[1] in LOADING)) and re.match(r"(\w+:)?//", address):
            addresses.append(address)
    return addresses + re.findall(r"@import\s[^;]*//[^;]*", page)


def test_what_is_loaded_from_a_network_is_found():
    assert loaded_from_a_network('<script src="https://unpkg.com/iframe-worker/shim"></script>')
    assert loaded_from_a_network('<link rel="stylesheet" href="//fonts.googleapis.com/css">')
    assert not loaded_from_a_network('<a href="https://github.com/ros2/ros2">x</a><script src="../a.js"></script>')


def test_readme_is_short_and_says_what_to_do():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert readme.count("\n") <= 140
    assert {"make run", "make test"} <= {line.split("  ")[0] for line in readme.split("\n")}
    for address in re.findall(r"\]\(([^)#:]+)\)", readme):
        assert (ROOT / address).exists(), address


def test_the_citation_has_the_version_that_is_installed():
    import weld_force_ros

    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == weld_force_ros.__version__


@pytest.mark.long
def test_the_site_builds_without_a_warning_and_loads_nothing_from_a_network(site: Path):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 35
    assert {page: found for page in pages if (found := loaded_from_a_network(page.read_text(encoding="utf-8")))} == {}


@pytest.mark.long
def test_the_site_has_every_command_and_every_public_name(site: Path):
    import weld_force_ros as wf

    commands = (site / "reference/command-line.html").read_text(encoding="utf-8")
    assert all(f'id="weld-force-{name}"' in commands for name in ("assess", "bag-export", "study-all", "up"))
    names = (site / "reference/python.html").read_text(encoding="utf-8")
    assert [name for name in wf.__all__ if not re.search(rf'id="weld_force_ros[\w.]*\.{name}"', names)] == []
