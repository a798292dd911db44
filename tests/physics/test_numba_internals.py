"""Undocumented names of Numba and llvmlite that are used: a new version must still have them."""

import importlib
import inspect

import numba
import pytest

# Where each is used: `_numba_cache.py` keeps machine code, `passage/_simd.py` adds a type of its own.
INTERNALS = [
    ("numba.core.caching", "NullCache"),
    ("numba.core.caching", "NullCache.load_overload"),
    ("numba.core.caching", "NullCache.save_overload"),
    ("numba.core.compiler", "CompileResult._rebuild"),
    ("numba.core.compiler", "CompileResult._reduce"),
    ("numba.core.runtime", "rtsys.initialize"),
    ("numba.core.serialize", "dumps"),
    ("numba.core.codegen", "CPUCodegen.magic_tuple"),
    ("numba.core.codegen", "CPUCodeLibrary.has_dynamic_globals"),
    ("numba.core.cgutils", "get_or_insert_function"),
    ("numba.core.datamodel.models", "PrimitiveModel"),
    ("numba.core.imputils", "lower_builtin"),
    ("numba.core.typing.templates", "AbstractTemplate"),
    ("numba.core.typing.templates", "infer_global"),
    ("numba.core.typing.templates", "signature"),
    ("numba.extending", "intrinsic"),
    ("numba.extending", "register_model"),
    ("numba.np.arrayobj", "make_array"),
    ("llvmlite.ir", "VectorType.as_pointer"),
    ("llvmlite.ir", "IRBuilder.shuffle_vector"),
    ("llvmlite.ir", "IRBuilder.insert_element"),
    ("llvmlite.ir", "IRBuilder.fcmp_ordered"),
]


@pytest.mark.parametrize(("module", "name"), INTERNALS)
def test_name_is_there(module: str, name: str):
    place = importlib.import_module(module)
    for part in name.split("."):
        assert hasattr(place, part), (
            f"{module}.{name} is not in numba {numba.__version__}: adapt physics/_numba_cache.py, passage/_simd.py "
            "or lower the bound in pyproject.toml"
        )
        place = getattr(place, part)


def test_a_dispatcher_asks_the_cache_that_it_was_given():
    dispatcher = numba.njit(lambda x: x)
    assert hasattr(dispatcher, "_cache"), "numba's dispatcher keeps its cache elsewhere: adapt physics/_numba_cache.py"
    for method, arguments in (("load_overload", 2), ("save_overload", 2)):
        parameters = inspect.signature(getattr(dispatcher._cache, method)).parameters
        assert len(parameters) == arguments, f"numba calls {method} otherwise: adapt physics/_numba_cache.py"


def test_a_result_names_what_the_cache_reads():
    dispatcher = numba.njit(lambda x: x + 1)
    dispatcher(1)
    (result,) = dispatcher.overloads.values()
    for name in ("lifted", "library"):
        assert hasattr(result, name), f"numba's CompileResult has no {name}: adapt physics/_numba_cache.py"
    assert hasattr(dispatcher.targetctx, "codegen")
