"""Mend pages while MkDocs builds them: links out of docs/, files from there, the command line's reference."""

import re
from pathlib import Path, PurePosixPath
from posixpath import normpath, relpath
from typing import Any

from mkdocs.structure.files import File

_ROOT = Path(__file__).parents[1]
_LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)\s#:]+)(#[^)\s]*)?\)")
_COMMANDS = "<!-- every command -->"
_INCLUDED = re.compile(r"<!-- file: (\S+) -->")
_PAGES_OF = {"README.md": "index.md", "CHANGELOG.md": "changelog.md", "CONTRIBUTING.md": "contributing.md"}


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Return the page with every link leading to a page, or to a copy of the source in the site."""
    if _COMMANDS in markdown:
        markdown = markdown.replace(_COMMANDS, _command_reference())
    included = _INCLUDED.search(markdown)
    origin = "" if included else f"docs/{PurePosixPath(page.file.src_uri).parent}/"
    if included:
        markdown = markdown.replace(included[0], (_ROOT / included[1]).read_text(encoding="utf-8"))

    def mended(link: re.Match[str]) -> str:
        text, target, anchor = link[1], link[2], link[3] or ""
        path = normpath(origin + target)
        if not (_ROOT / path).exists():
            raise FileNotFoundError(f"{page.file.src_uri}: {target} leads to {path}, which is not there")
        inside = _PAGES_OF.get(path) or path.removeprefix("docs/")
        if inside == path:
            if (_ROOT / path).is_dir():
                return text if path in text else f"{text} (`{path}`)"
            inside = f"source/{path}"
            if inside not in files.src_uris:
                files.append(File.generated(config, inside, abs_src_path=str(_ROOT / path)))
        return f"[{text}]({relpath(inside, PurePosixPath(page.file.src_uri).parent)}{anchor})"

    return _LINK.sub(mended, markdown)


def _command_reference() -> str:
    """Return every command with its help, as `weld-force COMMAND --help` prints it."""
    import typer

    from weld_force_ros.cli.main import app

    def sections(command: Any, words: list[str], parent: Any) -> list[str]:
        context = command.make_context(words[-1], [], parent=parent, resilient_parsing=True, terminal_width=100)
        name = " ".join(words)
        own = [f"## {name}\n\n```text\n{command.get_help(context).rstrip()}\n```\n"]
        below = getattr(command, "commands", {})
        return own + [text for each in below for text in sections(below[each], [*words, each], context)]

    return "\n".join(sections(typer.main.get_command(app), ["weld-force"], None))
