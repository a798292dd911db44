"""The page of nodes, topics, services and parameters is what the nodes are."""

from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("foxglove")
pytest.importorskip("jinja2")

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.slow
def test_the_page_is_that_of_the_nodes_as_they_run(domain_id: int) -> None:
    from benchmarks.interface_page import page

    assert (DOCS / "nodes.md").read_text() == page(), "python -m benchmarks.interface_page > docs/nodes.md"
