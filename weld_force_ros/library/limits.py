"""Limits by which welds are judged."""

from pathlib import Path

import pandas as pd

from weld_force_ros._files import write_whole
from weld_force_ros.assessment import rule_books
from weld_force_ros.errors import InputError, os_errors_as
from weld_force_ros.library.notebook import table
from weld_force_ros.messages import known

_COLUMNS = (
    "name", "limit", "reject_limit", "unit", "form", "base_m", "above_kmh", "from_kmh", "below_kmh", "to_kmh",
    "decides", "rule_book", "source", "verified",
)  # fmt: skip


class Limits:
    """The limits of one or several rule books, each with its source, and how they become a decision.

    Args:
        chosen: bundled rule books (`Limits.bundled()`) or paths of files of their form, with commas between them.

    Raises:
        InputError: there is no such rule book, or it ships without numbers; says what to do.

    Examples:
        >>> import weld_force_ros as wf
        >>> wf.Limits("force,banenor-531")
        Limits('force,banenor-531'): 9 limits, 3 verified
    """

    def __init__(self, chosen: str | Path = rule_books.FORCE) -> None:
        self.chosen = str(chosen)
        self.message = rule_books.load_limits(chosen)

    @staticmethod
    def bundled() -> list[str]:
        """Return the names of the rule books that come with the package, templates without numbers among them.

        Examples:
            >>> import weld_force_ros as wf
            >>> wf.Limits.bundled()[0]
            'force'
        """
        return rule_books.bundled()

    @staticmethod
    def template(path: str | Path, *, like: str = rule_books.FORCE) -> Path:
        """Write a rule book to fill in or change: a copy of a bundled one, under the file's name.

        Args:
            path: of the file, ending in .yaml; it must not exist.
            like: the rule book to begin with.

        Returns:
            The path, for `Limits`.

        Raises:
            InputError: there is no such rule book, the file is there already or cannot be written.

        Examples:
            >>> import tempfile
            >>> import weld_force_ros as wf
            >>> with tempfile.TemporaryDirectory() as folder:
            ...     ours = wf.Limits(wf.Limits.template(f"{folder}/ours.yaml"))
            >>> ours.table["rule_book"].unique().tolist()
            ['ours']
        """
        target = Path(path)
        if target.exists():
            raise InputError(f"{target} is there already", "name another file, or remove it")
        text = rule_books.text_of(like, target.stem)
        with os_errors_as(InputError, target, "name a file in a writable folder"):
            write_whole(target, text.encode())
        return target

    @property
    def table(self) -> pd.DataFrame:
        """Return the limits, a row each: criterion, limit, unit, the line speeds it holds for, and its source.

        Examples:
            >>> import weld_force_ros as wf
            >>> print(wf.Limits().table.loc[:1, ["name", "limit", "unit", "form"]])
                     name    limit unit         form
            0  peak_force  50000.0    N  plus_static
            1    p2_force  50000.0    N  plus_static
        """
        rows = [[known(getattr(limit, name)) for name in _COLUMNS] for limit in self.message.limits]
        return pd.DataFrame(rows, columns=list(_COLUMNS))

    def __repr__(self) -> str:
        limits = self.message.limits
        verified = sum(limit.verified for limit in limits)
        return f"Limits({self.chosen!r}): {len(limits)} limits, {verified} verified"

    def _repr_html_(self) -> str:
        facts = {limit.name: f"{limit.limit:g} {limit.unit}; {limit.source}" for limit in self.message.limits}
        return table(f"Limits {self.chosen}", facts)
