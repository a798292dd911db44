"""Compiled functions whose machine code outlives the process.

Numba's own cache knows one source file of several, demands a folder that it can write to, and stops at a damaged file.
Here every signature of a function has a file, sealed with a digest of itself and of all that it was made from: the
compiler's versions, and the source of the function's module and of all modules that it imports, directly or not. What
is stale or damaged is compiled again; what cannot be written is not kept.
"""

import ast
import contextlib
import hashlib
import inspect
import pickle
import sys
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.runtime import rtsys
from numba.core.serialize import dumps

from weld_force_ros import _files

_SEAL_BYTES = hashlib.sha256().digest_size


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return `numba.njit` with `options`, its machine code kept: compiled at the first call, and then once.

    Kept beside the source or, where that is read-only, in the user's cache; in NUMBA_CACHE_DIR alone if that is set.
    What a function uses is compiled in. It must come from modules that are imported at the top of its own, of the same
    package or of this one.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = numba.njit(**options)(function)
        if not numba.config.DISABLE_JIT:
            dispatcher._cache = _MachineCode(function)
        return dispatcher

    return decorate


class _MachineCode(NullCache):  # type: ignore[misc]  # Numba ships no types for it
    """One function's machine code as Numba's dispatcher asks for it and hands it over."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._name = function.__name__
        self._home = Path(inspect.getfile(function)).parent
        # Read now: by the first call the sources may no longer be those that were imported.
        self._made_from = _made_from(function.__module__)

    def load_overload(self, signature: Any, target: Any) -> CompileResult | None:
        rtsys.initialize(target)
        for path in self._paths(signature, target.codegen()):
            with contextlib.suppress(OSError):
                sealed = path.read_bytes()
                code = sealed[_SEAL_BYTES:]
                if sealed == self._sealed(code):
                    return CompileResult._rebuild(target, *pickle.loads(code))  # noqa: S301
        return None

    def save_overload(self, signature: Any, result: CompileResult) -> None:
        if result.lifted or result.library.has_dynamic_globals:  # tied to this process
            return
        sealed = self._sealed(dumps(result._reduce()))
        for path in self._paths(signature, result.codegen):
            with contextlib.suppress(OSError):
                _files.write_whole(path, sealed)
                return

    def _sealed(self, code: bytes) -> bytes:
        return hashlib.sha256(self._made_from + code).digest() + code

    def _paths(self, signature: Any, codegen: Any) -> list[Path]:
        """Return where machine code for this signature, processor and Python may lie, best first."""
        made_for = (str(self._home), signature, codegen.magic_tuple(), sys.implementation.cache_tag)
        name = f"{self._name}-{hashlib.sha256(repr(made_for).encode()).hexdigest()[:16]}.nbc"
        if numba.config.CACHE_DIR:
            return [Path(numba.config.CACHE_DIR) / "weld_force_ros" / name]
        return [self._home / "__pycache__" / name, _files.cache_folder("compiled") / name]


def _made_from(module: str) -> bytes:
    """Return a digest of the compiler and of the sources that may be compiled into a function of `module`."""
    digest = hashlib.sha256(repr((numba.__version__, llvmlite.__version__, np.__version__)).encode())
    for name, source in sorted(_sources(module).items()):
        digest.update(name.encode() + source)
    return digest.digest()


def _sources(module: str) -> dict[str, bytes]:
    """Return the sources of a module and of all that it imports from its own package and this one."""
    packages = {module.partition(".")[0], __name__.partition(".")[0]}
    found: dict[str, bytes] = {}
    waiting = [module, __name__]
    while waiting:
        name = waiting.pop()
        file = getattr(sys.modules.get(name), "__file__", None)
        if file is None or name in found or name.partition(".")[0] not in packages:
            continue
        found[name] = Path(file).read_bytes()
        if name != __name__:  # what keeps machine code is not compiled in
            inside = f"{name}.__init__" if Path(file).stem == "__init__" else name
            waiting += _imported(inside, found[name])
    return found


@lru_cache(64)
def _imported(module: str, source: bytes) -> tuple[str, ...]:
    """Return names of modules that may be imported at the top of a source, objects in them included."""
    return tuple(_names(module, ast.parse(source)))


def _names(module: str, tree: ast.Module) -> Iterator[str]:
    for node in tree.body:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = module.split(".")[: -node.level] if node.level else []
            origin = ".".join([*above, *([node.module] if node.module else [])])
            yield origin
            yield from (f"{origin}.{alias.name}" for alias in node.names)
