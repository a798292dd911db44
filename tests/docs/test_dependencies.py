"""What every installation brings is listed with its reason, and is imported by the package."""

import re
import tomllib

import pytest

from tests.docs.pages import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
DEPENDENCIES = [re.split(r"[<>=~!\[]", requirement)[0] for requirement in PROJECT["dependencies"]]
IMPORTED_AS = {"scikit-fem": "skfem", "pyyaml": "yaml", "mcap-ros2-support": "mcap_ros2"}
SOURCES = {path: path.read_text(encoding="utf-8") for path in (ROOT / "weld_force_ros").rglob("*.py")}


@pytest.mark.parametrize("name", DEPENDENCIES)
def test_a_dependency_is_imported_by_more_than_the_nodes(name: str):
    module = IMPORTED_AS.get(name, name.replace("-", "_"))
    imported = re.compile(rf"^\s*(?:from|import) {module}\b", re.MULTILINE)
    assert [path for path, source in SOURCES.items() if "ros" not in path.parts[-3:-1] and imported.search(source)]


def test_contributing_says_why_each_is_needed_and_names_every_extra():
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = page.partition("## What the package needs")[2].partition("\n## ")[0]
    listed = [name for row in re.findall(r"^\| ([^|]+) \|", section, re.MULTILINE)[1:] for name in row.split(", ")]
    assert sorted(listed[1:] if listed[0].startswith("--") else listed) == sorted(DEPENDENCIES)
    assert set(PROJECT["optional-dependencies"]) <= set(re.findall(r"`([a-z]+)`", section))
