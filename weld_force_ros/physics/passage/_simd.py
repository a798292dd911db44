"""Thirty-two doubles as one value inside compiled code: eight speeds at each of four places advance in one stream.

LLVM does not vectorise the kernel's loops by itself (it cannot know that its arrays do not overlap). Here the vector is
a type of its own: arithmetic, `load`, `store` and a few functions become LLVM vector instructions, which every
processor executes in registers as wide as it has. Lanes never mix, so that a lane's result does not depend on the
others. A step waits for its contact's solution (roots and quotients); four times the width of the widest registers
fills that wait. Single precision, `single`, serves for first guesses: its roots and quotients take a quarter of the
time.
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

SPEEDS = 8
PLACES = 4
LANES = PLACES * SPEEDS
# As the kernel's scalar code: sums may be regrouped, NaN and infinity keep their meaning.
_FLAGS = ("reassoc", "contract", "arcp", "nsz")


class _Lanes(types.Type):
    def __init__(self, element, suffix):
        super().__init__(name=f"Lanes{LANES}{suffix}")
        self.suffix = suffix
        self.vector = ir.VectorType(element, LANES)


_doubles = _Lanes(ir.DoubleType(), "f64")
_singles = _Lanes(ir.FloatType(), "f32")


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, kind.vector)


def _arithmetic(operation, instruction):
    @infer_global(operation)
    class _Typing(AbstractTemplate):
        def generic(self, args, kws):
            same = len(args) == 2 and isinstance(args[0], _Lanes) and args[0] == args[1]
            return signature(args[0], *args) if same else None

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


def _element(context, builder, kind, array, index):
    return builder.gep(make_array(kind)(context, builder, array).data, [index])


def _neighbours(context, builder, kind, array, index, count):
    """Return the address of `count` neighbours as a vector, from count x index."""
    first = builder.mul(index, ir.Constant(index.type, count))
    vector = ir.VectorType(ir.DoubleType(), count)
    return builder.bitcast(_element(context, builder, kind, array, first), vector.as_pointer())


def _mask(indices):
    return ir.Constant(ir.VectorType(ir.IntType(32), len(indices)), indices)


@intrinsic
def load(typing, array, index):
    """Return neighbours of a flat float64 array, from LANES x index."""

    def generate(context, builder, sig, args):
        return builder.load(_neighbours(context, builder, sig.args[0], *args, LANES), align=8)

    return _doubles(array, types.intp), generate


@intrinsic
def store(typing, array, index, value):
    """Write neighbours of a flat float64 array, from LANES x index."""

    def generate(context, builder, sig, args):
        builder.store(args[2], _neighbours(context, builder, sig.args[0], *args[:2], LANES), align=8)
        return context.get_dummy_value()

    return types.none(array, types.intp, _doubles), generate


@intrinsic
def load_four(typing, array, indices):
    """Return neighbours of a flat float64 array, from SPEEDS x each of four indices on: a quarter of the lanes each."""

    def generate(context, builder, sig, args):
        kind, (flat, four) = sig.args[0], args
        quarters = [
            builder.load(_neighbours(context, builder, kind, flat, index, SPEEDS), align=8)
            for index in cgutils.unpack_tuple(builder, four)
        ]
        return _joined(builder, quarters)

    return _doubles(array, indices), generate


@intrinsic
def spread_four(typing, array, indices):
    """Return four numbers of a flat float64 array, each in a quarter of the lanes."""

    def generate(context, builder, sig, args):
        kind, (flat, four) = sig.args[0], args
        nothing = ir.Constant(ir.VectorType(ir.DoubleType(), SPEEDS), ir.Undefined)
        quarters = []
        for index in cgutils.unpack_tuple(builder, four):
            number = builder.load(_element(context, builder, kind, flat, index))
            first = builder.insert_element(nothing, number, ir.Constant(ir.IntType(32), 0))
            quarters.append(builder.shuffle_vector(first, nothing, _mask([0] * SPEEDS)))
        return _joined(builder, quarters)

    return _doubles(array, indices), generate


def _joined(builder, parts):
    """Return four vectors as one."""
    while len(parts) > 1:
        both = _mask(list(range(2 * parts[0].type.count)))
        parts = [builder.shuffle_vector(*parts[k : k + 2], both) for k in range(0, len(parts), 2)]
    return parts[0]


@intrinsic
def splat(typing, value):
    """Return one number in every lane."""

    def generate(context, builder, sig, args):
        nothing = ir.Constant(_doubles.vector, ir.Undefined)
        one = builder.insert_element(nothing, args[0], ir.Constant(ir.IntType(32), 0))
        return builder.shuffle_vector(one, nothing, _mask([0] * LANES))

    return _doubles(types.float64), generate


@intrinsic
def single(typing, value):
    """Round to single precision."""

    def generate(context, builder, sig, args):
        return builder.fptrunc(args[0], _singles.vector)

    return _singles(_doubles), generate


@intrinsic
def double(typing, value):
    """Return to double precision."""

    def generate(context, builder, sig, args):
        return builder.fpext(args[0], _doubles.vector)

    return _doubles(_singles), generate


def _call(builder, name, kind, args):
    function = ir.FunctionType(kind.vector, [kind.vector] * len(args))
    called = cgutils.get_or_insert_function(builder.module, function, f"llvm.{name}.v{LANES}{kind.suffix}")
    return builder.call(called, args)


@intrinsic
def square_root(typing, value):
    """Return the square root of every lane."""

    def generate(context, builder, sig, args):
        return _call(builder, "sqrt", value, args)

    return value(value), generate


@intrinsic
def magnitude(typing, value):
    """Return the magnitude of every lane."""

    def generate(context, builder, sig, args):
        return _call(builder, "fabs", value, args)

    return value(value), generate


@intrinsic
def multiply_add(typing, a, b, c):
    """Return the product of a and b plus c, rounded once."""

    def generate(context, builder, sig, args):
        return _call(builder, "fma", a, args)

    return a(a, a, a), generate


@intrinsic
def where_greater(typing, a, b, then, otherwise):
    """Return `then` in the lanes where a > b, `otherwise` in the rest."""

    def generate(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered(">", args[0], args[1]), args[2], args[3])

    return then(a, a, then, then), generate


@intrinsic
def any_greater(typing, a, b):
    """Return whether a > b in any lane."""

    def generate(context, builder, sig, args):
        greater = builder.bitcast(builder.fcmp_ordered(">", *args), ir.IntType(LANES))
        return builder.icmp_unsigned("!=", greater, ir.Constant(greater.type, 0))

    return types.boolean(a, a), generate
