"""Every public name has a docstring with an example, and the examples are true."""

import doctest
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import weld_force_ros as wf

ROOT = Path(__file__).parents[2]


def public_members() -> Iterator[tuple[str, Any]]:
    """Every public name, and of classes every public method and property of their own."""
    for name in wf.__all__:
        public = getattr(wf, name)
        yield name, public
        if inspect.isclass(public) and not issubclass(public, Exception):
            for member, value in vars(public).items():
                if not member.startswith("_"):
                    yield f"{name}.{member}", getattr(value, "__func__", value)


MEMBERS = dict(public_members())


def test_there_is_something_to_hold():
    assert {"Profile.quality_index", "Model.force_map", "Track.from_parts", "Recording.verdicts"} <= MEMBERS.keys()


@pytest.mark.parametrize("name", MEMBERS)
def test_every_public_name_has_a_docstring_with_an_example(name: str):
    member = MEMBERS[name]
    text = inspect.getdoc(member) or ""
    first, _, rest = text.partition("\n")
    assert first.endswith("."), "the first line is a sentence"
    assert "Examples:" in rest
    assert ">>> " in rest
    if inspect.isfunction(member) or isinstance(member, property):
        assert re.match(r"(Return|Yield|Make|Compute|Read|Write|Draw|Simulate|Search) ", first)
    target = member if inspect.isfunction(member) else getattr(member, "__init__", None)
    if inspect.isfunction(target) and not (inspect.isclass(member) and issubclass(member, Exception)):
        signature = list(inspect.signature(target).parameters.values())
        parameters = [p.name for p in signature if p.name not in ("self", "cls")]
        made_by_functions = name in ("Verdict", "GrindingPlan")
        assert made_by_functions or all(re.search(rf"^ +{parameter}:", text, re.M) for parameter in parameters)


@pytest.mark.untraced
def test_the_examples_are_true(monkeypatch: pytest.MonkeyPatch):
    """Those of a class's members go on from those of the class."""
    monkeypatch.chdir(ROOT)  # the recording that ships lies here
    finder, runner = doctest.DocTestFinder(), doctest.DocTestRunner()
    for name in wf.__all__:
        names: dict[str, Any] = {}
        for example in finder.find(getattr(wf, name), name, globs=names):
            example.globs = names
            runner.run(example, clear_globs=False)
    assert runner.tries > 100
    assert not runner.failures
