"""Sixteen doubles as one value inside compiled code, so that sixteen passages advance in one instruction stream.

LLVM does not vectorise the kernel's loops by itself (it cannot know that its arrays do not overlap). Here the vector is
a type of its own: arithmetic, `load`, `store` and a few functions become LLVM vector instructions, which every
processor executes in registers as wide as it has. Lanes never mix, so that a lane's result does not depend on the
others. A step waits for its contact's solution (roots and quotients); twice the width of the widest registers fills
that wait.
"""

import operator

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, register_model
from numba.np.arrayobj import make_array

LANES = 16
_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
# As the kernel's scalar code: sums may be regrouped, NaN and infinity keep their meaning.
_FLAGS = ("reassoc", "contract", "arcp", "nsz")


class _Lanes(types.Type):
    def __init__(self):
        super().__init__(name=f"Lanes{LANES}")


_lanes = _Lanes()


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, _VECTOR)


def _arithmetic(operation, instruction):
    @infer_global(operation)
    class _Typing(AbstractTemplate):
        def generic(self, args, kws):
            return signature(_lanes, _lanes, _lanes) if tuple(args) == (_lanes, _lanes) else None

    @lower_builtin(operation, _Lanes, _Lanes)
    def _lower(context, builder, sig, args):
        return getattr(builder, instruction)(*args, flags=_FLAGS)


for _operation, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _arithmetic(_operation, _instruction)


def _address(context, builder, kind, array, index):
    first = builder.mul(index, ir.Constant(index.type, LANES))
    data = make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [first]), _VECTOR.as_pointer())


@intrinsic
def load(typing, array, index):
    """Neighbours of a flat float64 array, from LANES x index."""

    def generate(context, builder, sig, args):
        return builder.load(_address(context, builder, sig.args[0], *args), align=8)

    return _lanes(array, types.intp), generate


@intrinsic
def store(typing, array, index, value):
    """Write neighbours of a flat float64 array, from LANES x index."""

    def generate(context, builder, sig, args):
        builder.store(args[2], _address(context, builder, sig.args[0], *args[:2]), align=8)
        return context.get_dummy_value()

    return types.none(array, types.intp, _lanes), generate


@intrinsic
def splat(typing, value):
    """One number in every lane."""

    def generate(context, builder, sig, args):
        nothing = ir.Constant(_VECTOR, ir.Undefined)
        one = builder.insert_element(nothing, args[0], ir.Constant(ir.IntType(32), 0))
        every = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return builder.shuffle_vector(one, nothing, every)

    return _lanes(types.float64), generate


def _call(builder, name, arity, args):
    kind = ir.FunctionType(_VECTOR, [_VECTOR] * arity)
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64"), args)


@intrinsic
def square_root(typing, value):
    """Lane by lane."""

    def generate(context, builder, sig, args):
        return _call(builder, "sqrt", 1, args)

    return _lanes(_lanes), generate


@intrinsic
def multiply_add(typing, a, b, c):
    """Product of a and b plus c, rounded once."""

    def generate(context, builder, sig, args):
        return _call(builder, "fma", 3, args)

    return _lanes(_lanes, _lanes, _lanes), generate


@intrinsic
def where_greater(typing, a, b, then, otherwise):
    """`then` in the lanes where a > b, `otherwise` in the rest."""

    def generate(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered(">", args[0], args[1]), args[2], args[3])

    return _lanes(_lanes, _lanes, _lanes, _lanes), generate
