"""The pages that users read, and what stands in their fenced blocks."""

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]

_FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page: Path, *languages: str) -> Iterator[str]:
    """Yield the fenced blocks of a page that are in one of the languages; "" is none stated."""
    for language, block in _FENCED.findall(page.read_text(encoding="utf-8")):
        if language in languages:
            yield block


def shown_after(page: Path, block: str) -> str:
    """Return what the page shows as a block's output: the block right after it."""
    text = page.read_text(encoding="utf-8")
    found = _FENCED.match(text[text.index(f"{block}```") + len(block) + 3 :].lstrip("\n"))
    assert found is not None, f"{page.name} shows nothing after {block!r}"
    return found[2]
