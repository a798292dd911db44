"""Arrays with a row each for many things, each made when it is first asked for."""

import threading
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Rows = TypeVar("Rows", bound=tuple[NDArray[Any], ...])
Run = Callable[..., Any]


class KeptRows(Generic[Rows]):
    """Named arrays whose rows are made once, when they are asked for; from several threads.

    Args:
        count: of rows.
        make: returns the rows (n, ...) of some numbers (n,); it is also given what maps functions over many arguments.
    """

    def __init__(self, count: int, make: Callable[[NDArray[np.intp], Run], Rows]) -> None:
        self._make, self._is_made, self._making = make, np.zeros(count, dtype=np.bool_), threading.Lock()
        self._rows: Rows | None = None

    def of(self, numbers: NDArray[np.intp], run: Run = map) -> Rows:
        """Return the arrays (count, ...), in which the rows of these numbers are made; others may hold anything."""
        with self._making:
            missing = np.unique(numbers[~self._is_made[numbers]])
            if self._rows is None or len(missing):
                made = self._make(missing, run)
                if self._rows is None:
                    shapes = [(len(self._is_made), *new.shape[1:]) for new in made]
                    self._rows = type(made)(*(np.empty(s, new.dtype) for s, new in zip(shapes, made, strict=True)))
                for rows, new in zip(self._rows, made, strict=True):
                    rows[missing] = new
                self._is_made[missing] = True
            return self._rows

    @property
    def size_bytes(self) -> int:
        """Return what the rows that were made take of memory."""
        of_each = sum(int(rows[0].nbytes) for rows in self._rows or ())
        return of_each * int(np.count_nonzero(self._is_made))
