import pytest

from benchmarks.physics import FIGURES, Figure


@pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: figure.name)
def test_figure_is_reached(figure: Figure):
    measured = figure.compute()
    assert figure.ok(measured), f"{measured:g} {figure.unit}, not {figure.least:g} to {figure.most:g}"
