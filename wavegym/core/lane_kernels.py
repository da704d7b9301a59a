"""Several environments in one number: ``Lanes`` are LANES float64 that kernels compute with as with a single one.

A processor adds or divides eight numbers in about the time of one. So a kernel may keep eight environments, or eight
particles of one, side by side in arrays of Lanes (``lane_array_kernels.py``), and call the same functions for them as
for single numbers: Numba compiles a function once for each type. Arithmetic, comparisons, ``min``, ``max``, ``abs``,
``np.sqrt``, ``np.rint``, ``np.copysign``, ``np.arctan`` and ``np.arcsin`` work lane by lane and round as those of
single numbers do. So a lane has the same bits as a single number, whatever its neighbours hold.

A comparison of Lanes gives a truth value for each lane, which no ``if`` takes: ``where`` chooses by lanes, and
``somewhere`` tells whether any lane is true. What few lanes need goes through a loop over ``width``, where ``lane`` and
``with_lane`` read and replace one of them; ``each_lane`` calls a kernel of single numbers for all. All of these take
single numbers and truth values too, of width 1: so one source serves both.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import operator

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing import signature
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic, models, register_model

from wavegym.core.kernels import inlined

LANES = 8


class LanesType(types.Type):
    """LANES float64; a single number converts to equal lanes."""

    def can_convert_from(self, typingctx, other):
        """Numba's rule for arguments, and for variables of several types."""
        return Conversion.safe if isinstance(other, NUMBER) else None


class TruthsType(types.Type):
    """LANES truth values; a single one converts to equal lanes."""

    def can_convert_from(self, typingctx, other):
        """See ``LanesType``."""
        return Conversion.safe if isinstance(other, types.Boolean) else None


NUMBER = (types.Float, types.Integer)
lanes, truths = LanesType(f"Lanes({LANES})"), TruthsType(f"Truths({LANES})")
VECTOR, BITS = ir.VectorType(ir.DoubleType(), LANES), ir.VectorType(ir.IntType(1), LANES)
SIZE = ir.IntType(64)


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, numba_type):
        super().__init__(manager, numba_type, VECTOR)


@register_model(TruthsType)
class _TruthsModel(models.PrimitiveModel):
    def __init__(self, manager, numba_type):
        super().__init__(manager, numba_type, BITS)


def broadcast(builder, value, vector):
    """All lanes equal to value."""
    index = ir.IntType(32)
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), value, index(0))
    return builder.shuffle_vector(first, first, ir.Constant(ir.VectorType(index, LANES), [0] * LANES))


@lower_cast(types.Float, lanes)
@lower_cast(types.Integer, lanes)
def _cast_number(context, builder, given, wanted, value):
    return broadcast(builder, context.cast(builder, value, given, types.float64), VECTOR)


@lower_cast(types.Boolean, truths)
def _cast_truth(context, builder, given, wanted, value):
    return broadcast(builder, value, BITS)


def _lane_by_lane(function, operands, result, instruction):
    """Let Numba compile ``function`` of Lanes, or truths, as ``instruction(builder, *values)``."""
    _type(function, operands, result)
    lower_builtin(function, *operands)(lambda context, builder, sig, args: instruction(builder, *args))


def _define(function, operands, result, python):
    """Let Numba compile ``function`` of Lanes, or truths, as the function ``python``."""
    _type(function, operands, result)
    lower_builtin(function, *operands)(
        lambda context, builder, sig, args: context.compile_internal(builder, python, sig, args)
    )


def _type(function, operands, result):
    """Tell Numba what ``function`` of Lanes, or truths, returns."""
    one, plain = operands[0], NUMBER if operands[0] is lanes else types.Boolean

    class Template(AbstractTemplate):
        key = function

        def generic(self, args, kws):
            fits = one in args and len(args) == len(operands) and all(a is one or isinstance(a, plain) for a in args)
            return signature(result, *operands) if fits else None

    infer_global(function, types.Function(Template))


def _of_llvm(name):
    """LLVM's function with this name, such as ``sqrt``, of one or two vectors."""

    def call(builder, *values):
        kind = ir.FunctionType(VECTOR, [VECTOR] * len(values))
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64")
        return builder.call(function, values)

    return call


def _compared(sign):
    return lambda builder, a, b: (builder.fcmp_unordered if sign == "!=" else builder.fcmp_ordered)(sign, a, b)


def _better(sign):
    """The lesser of two with the sign "<", the greater with ">"."""
    return lambda builder, a, b: builder.select(builder.fcmp_ordered(sign, a, b), a, b)


for _functions, _instruction in (
    ((operator.add, operator.iadd), lambda builder, a, b: builder.fadd(a, b)),
    ((operator.sub, operator.isub), lambda builder, a, b: builder.fsub(a, b)),
    ((operator.mul, operator.imul), lambda builder, a, b: builder.fmul(a, b)),
    ((operator.truediv, operator.itruediv), lambda builder, a, b: builder.fdiv(a, b)),
    ((np.copysign,), _of_llvm("copysign")),
    ((min,), _better("<")),
    ((max,), _better(">")),
):
    for _function in _functions:
        _lane_by_lane(_function, (lanes, lanes), lanes, _instruction)
for _function, _sign in (
    (operator.lt, "<"),
    (operator.le, "<="),
    (operator.gt, ">"),
    (operator.ge, ">="),
    (operator.eq, "=="),
    (operator.ne, "!="),
):
    _lane_by_lane(_function, (lanes, lanes), truths, _compared(_sign))
_lane_by_lane(np.sqrt, (lanes,), lanes, _of_llvm("sqrt"))
_lane_by_lane(np.rint, (lanes,), lanes, _of_llvm("rint"))
_lane_by_lane(abs, (lanes,), lanes, _of_llvm("fabs"))
_lane_by_lane(operator.neg, (lanes,), lanes, lambda builder, a: builder.fneg(a))
for _function in (operator.and_, operator.iand):
    _lane_by_lane(_function, (truths, truths), truths, lambda builder, a, b: builder.and_(a, b))
for _function in (operator.or_, operator.ior):
    _lane_by_lane(_function, (truths, truths), truths, lambda builder, a, b: builder.or_(a, b))


@intrinsic
def where(typingctx, condition, a, b):
    """a in lanes where the condition holds, else b; both are computed."""
    value = lanes if condition is truths or lanes in (a, b) else types.float64
    given = truths if value is lanes else types.boolean
    return value(given, value, value), lambda context, builder, sig, args: builder.select(*args)


@intrinsic
def somewhere(typingctx, condition):
    """Whether a condition holds in any lane."""

    def compiled(context, builder, sig, args):
        word = ir.IntType(LANES)
        return builder.icmp_unsigned("!=", builder.bitcast(args[0], word), word(0)) if condition is truths else args[0]

    return types.boolean(condition), compiled


@intrinsic
def width(typingctx, value):
    """The number of lanes: LANES, or 1 of a single number."""
    count = LANES if value in (lanes, truths) else 1
    return types.int64(value), lambda context, builder, sig, args: ir.IntType(64)(count)


@intrinsic
def lane(typingctx, value, number):
    """One lane of a value."""
    one = {lanes: types.float64, truths: types.boolean}.get(value, value)

    def compiled(context, builder, sig, args):
        return args[0] if one is value else builder.extract_element(*args)

    return one(value, types.int64), compiled


@intrinsic
def with_lane(typingctx, value, number, one):
    """The value with one lane replaced."""

    def compiled(context, builder, sig, args):
        return builder.insert_element(args[0], args[2], args[1]) if value is lanes else args[2]

    return value(value, types.int64, types.float64), compiled


def _one_by_one(function):
    """``function`` of the C library for each lane, with the bits that it gives single numbers."""

    def compiled(x):
        for number in range(LANES):
            x = with_lane(x, number, function(lane(x, number)))
        return x

    return compiled


_define(np.arctan, (lanes,), lanes, _one_by_one(np.arctan))
_define(np.arcsin, (lanes,), lanes, _one_by_one(np.arcsin))


def each_lane(function):
    """A kernel of single numbers, also for Lanes in some arguments: each lane by itself."""

    @intrinsic
    def call(typingctx, *given):
        ones = [{lanes: types.float64, truths: types.boolean}.get(kind, kind) for kind in given]
        called = typingctx.resolve_value_type(function)
        single = called.get_call_type(typingctx, ones, {})
        some = lanes in given or truths in given

        def compiled(context, builder, sig, args):
            one = context.get_function(called, single)
            context.active_code_library.add_linking_library(one.libs[0])
            args = cgutils.unpack_tuple(builder, args[0])
            if not some:
                return one(builder, args)
            value = ir.Constant(VECTOR if sig.return_type is lanes else BITS, ir.Undefined)
            for number in map(SIZE, range(LANES)):
                values = [
                    builder.extract_element(arg, number) if kind in (lanes, truths) else arg
                    for kind, arg in zip(given, args, strict=True)
                ]
                value = builder.insert_element(value, one(builder, values), number)
            return value

        together = {types.float64: lanes, types.boolean: truths}
        result = together[single.return_type] if some else single.return_type
        return result(types.StarArgTuple.from_types(given)), compiled

    return call


@intrinsic
def lane_numbers(typingctx):
    """Lanes 0, 1, ..."""
    return lanes(), lambda context, builder, sig, args: ir.Constant(VECTOR, [float(n) for n in range(LANES)])


@inlined
def rows_from(first, count):
    """Lanes first, first + 1, ..., and the last environment again where there are no more."""
    return min(first + lane_numbers(), count - 1)
