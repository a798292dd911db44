"""Compiled functions whose machine code outlives the process.

Numba's own cache knows one source file of several, demands a folder that it can write to, and stops at a damaged file.
Here every signature of a function has a file, sealed with a digest of itself and of all that it was made from. What is
stale, damaged or half another version's is compiled again; what cannot be written is not kept.
"""

import contextlib
import hashlib
import inspect
import pickle
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps

from weld_force_ros import user_cache

_SEAL_BYTES = hashlib.sha256().digest_size


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit` with `options`, its machine code kept: nothing is compiled before the first call, and then once.

    Kept beside the source or, where that is read-only, in the user's cache; in NUMBA_CACHE_DIR alone if that is set.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = numba.njit(**options)(function)
        if isinstance(dispatcher, Dispatcher):  # a plain function under NUMBA_DISABLE_JIT
            dispatcher._cache = _MachineCode(function)
        return dispatcher

    return decorate


class _MachineCode(NullCache):  # type: ignore[misc]  # Numba ships no types
    """One function's machine code as Numba's dispatcher asks for it and hands it over."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._name = function.__name__
        self._home = Path(inspect.getfile(function)).parent

    def load_overload(self, signature: Any, target: Any) -> CompileResult | None:
        target.refresh()
        for path in self._paths(signature, target.codegen()):
            with contextlib.suppress(OSError):
                sealed = path.read_bytes()
                if sealed == _sealed(sealed[_SEAL_BYTES:], self._home):
                    return CompileResult._rebuild(target, *pickle.loads(sealed[_SEAL_BYTES:]))  # noqa: S301
        return None

    def save_overload(self, signature: Any, result: CompileResult) -> None:
        if result.lifted or result.library.has_dynamic_globals:  # tied to this process
            return
        sealed = _sealed(dumps(result._reduce()), self._home)
        for path in self._paths(signature, result.codegen):
            with contextlib.suppress(OSError):
                user_cache.write_whole(sealed, path)
                return

    def _paths(self, signature: Any, codegen: Any) -> list[Path]:
        """Where machine code for this signature, processor and Python may lie, best first."""
        made_for = (self._home, signature, codegen.magic_tuple(), sys.implementation.cache_tag)
        name = f"{self._name}-{hashlib.sha256(repr(made_for).encode()).hexdigest()[:16]}.nbc"
        if numba.config.CACHE_DIR:
            return [Path(numba.config.CACHE_DIR) / "weld_force_ros" / name]
        return [self._home / "__pycache__" / name, user_cache.folder("compiled") / name]


def _sealed(code: bytes, home: Path) -> bytes:
    return hashlib.sha256(_made_from(home) + code).digest() + code


@cache
def _made_from(home: Path) -> bytes:
    """Digest of the sources and the compiler: functions compile in what they use from the private modules beside them."""
    digest = hashlib.sha256(repr((numba.__version__, llvmlite.__version__, np.__version__)).encode())
    for source in [Path(__file__), *sorted(home.glob("_*.py"))]:
        digest.update(source.name.encode() + source.read_bytes())
    return digest.digest()
