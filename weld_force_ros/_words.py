"""All words of reports and verdicts, from one file a language: `data/words/en.json`, or a translation beside it."""

from collections.abc import Mapping
from functools import cache
from importlib import resources
from pathlib import Path
from string import Formatter
from typing import Any

import msgspec

from weld_force_ros.errors import InputError


class Words:
    """A catalogue of sentences by dotted keys (`decision.accept`); `{name}` in a sentence stands for a value.

    Args:
        content: sections of sentences by name.
        fallback: asked for what is not there.
    """

    def __init__(self, content: Mapping[str, Mapping[str, str]], fallback: "Words | None" = None) -> None:
        self._content, self._fallback = content, fallback

    def __call__(self, key: str, /, **values: object) -> str:
        """Return the sentence of a key with its values filled in.

        Raises:
            KeyError: there is no such key.
        """
        section, _, name = key.partition(".")
        sentence = self._content.get(section, {}).get(name)
        if sentence is not None:
            return sentence.format(**values) if values else sentence
        if self._fallback is None:
            raise KeyError(key)
        return self._fallback(key, **values)

    def get(self, section: str, name: str, default: str) -> str:
        """Return the word of a name that may be none of ours, such as a criterion's of a later version."""
        return self.section(section).get(name, default)

    def section(self, name: str) -> dict[str, str]:
        """Return all sentences of a section by their names."""
        base = self._fallback.section(name) if self._fallback else {}
        return base | dict(self._content.get(name, {}))


@cache
def english() -> Words:
    """Return the words of `data/words/en.json`."""
    text = (resources.files("weld_force_ros.data") / "words" / "en.json").read_bytes()
    return Words(msgspec.json.decode(text, type=dict[str, dict[str, str]]))


def read_words(path: Path) -> Words:
    """Read a translation: a file like `data/words/en.json`; what it leaves out stays English.

    Raises:
        InputError: it cannot be read, is none, or names a key or a value that there is not.
    """
    try:
        content = msgspec.json.decode(path.read_bytes(), type=dict[str, dict[str, str]])
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}", "name a file like data/words/en.json") from None
    except msgspec.DecodeError as error:
        raise InputError(f"{path}: {error}", "name a file like data/words/en.json") from None
    base = english()
    for section, sentences in content.items():
        ours = base.section(section)
        for name, sentence in sentences.items():
            if name not in ours:
                raise InputError(f"{path}: no word is called {section}.{name}", "keep the keys of data/words/en.json")
            if problem := _problem(sentence, ours[name]):
                raise InputError(f"{path}: {section}.{name}: {problem}", "keep the values of data/words/en.json")
    return Words(content, base)


def sentence(clause: str) -> str:
    """Return a clause with a capital letter and a full stop; nothing of nothing."""
    return clause and clause[0].upper() + clause[1:] + ("" if clause.endswith((".", "!", "?")) else ".")


def _problem(translated: str, ours: str) -> str | None:
    """Return why a translated sentence cannot be filled in as ours is, or None."""
    values: dict[str, Any] = dict.fromkeys(_placeholders(ours), "")
    try:
        translated.format(**values)
    except (KeyError, IndexError, ValueError, AttributeError) as error:
        return f"cannot be filled in ({error})"
    return None


def _placeholders(text: str) -> set[str]:
    return {name for _, name, _, _ in Formatter().parse(text) if name}
