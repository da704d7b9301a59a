"""Arrays of ``Lanes`` (``lane_kernels.py``): scratch arrays, and the ways between them and NumPy's arrays.

A kernel keeps its Lanes in scratch arrays, ``empty_lanes``. ``gathered`` and ``gather_part`` fill them from a NumPy
array with a place for each lane, ``scatter`` and ``scatter_part`` write them back.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import math
import operator

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.core.imputils import lower_builtin, lower_getattr
from numba.core.typing import signature
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr, infer_global
from numba.extending import intrinsic, models, register_model

from wavegym.core.kernels import kernel
from wavegym.core.lane_kernels import LANES, SIZE, VECTOR, broadcast, lane, lanes


class LanesArray(types.Type):
    """A scratch array of Lanes on the stack, whose shape is part of its type."""

    def __init__(self, shape):
        self.shape = shape
        super().__init__(f"array({lanes}, {shape})")


@register_model(LanesArray)
class _LanesArrayModel(models.PrimitiveModel):
    def __init__(self, manager, numba_type):
        super().__init__(manager, numba_type, VECTOR.as_pointer())


@intrinsic
def empty_lanes(typingctx, sizes):
    """A scratch array of Lanes; sizes: for each axis a tuple that is as long.

    The compiler knows the shape, and keeps what fits in registers. It is gone with the kernel that made it. Indices
    count from the first element; with fewer than axes they give a part of the array, not a copy. The first size may
    also be an integer, not known to the compiler: such an array has no ``len`` and no ``shape``, and is made outside
    loops, because each one made takes its own place on the stack.
    """
    made = LanesArray(tuple(getattr(axis, "count", None) for axis in sizes))

    def compiled(context, builder, sig, args):
        if made.shape[0] is not None:
            return cgutils.alloca_once(builder, VECTOR, size=math.prod(made.shape))
        rows = context.cast(builder, builder.extract_value(args[0], 0), sig.args[0][0], types.int64)
        return builder.alloca(VECTOR, size=builder.mul(rows, SIZE(math.prod(made.shape[1:]))))

    return made(sizes), compiled


def _indices(index):
    """The types of all indices, or None for others than integers."""
    listed = tuple(index) if isinstance(index, types.BaseTuple) else (index,)
    return listed if all(isinstance(one, types.Integer) for one in listed) else None


def _found(array, index):
    """The type of array[index], or None."""
    listed = _indices(index) if isinstance(array, LanesArray) else None
    if listed is None or len(listed) > len(array.shape):
        return None
    return LanesArray(array.shape[len(listed) :]) if len(listed) < len(array.shape) else lanes


@infer_global(operator.getitem)
class _GetItem(AbstractTemplate):
    def generic(self, args, kws):
        found = _found(*args)
        return found and signature(found, *args)


@infer_global(operator.setitem)
class _SetItem(AbstractTemplate):
    def generic(self, args, kws):
        return signature(types.none, *args[:2], lanes) if _found(*args[:2]) is lanes else None


@infer_global(len)
class _Len(AbstractTemplate):
    def generic(self, args, kws):
        return signature(types.int64, *args) if isinstance(args[0], LanesArray) else None


@infer_getattr
class _Attributes(AttributeTemplate):
    key = LanesArray

    def resolve_shape(self, array):
        """The sizes of all axes."""
        return types.UniTuple(types.int64, len(array.shape))


def _address(context, builder, sig, args):
    """The address of array[index]."""
    array, index = sig.args[:2]
    values = cgutils.unpack_tuple(builder, args[1]) if isinstance(index, types.BaseTuple) else [args[1]]
    place = SIZE(0)
    for axis, (kind, value) in enumerate(zip(_indices(index), values, strict=True)):
        step = SIZE(math.prod(array.shape[axis + 1 :]))
        place = builder.add(place, builder.mul(context.cast(builder, value, kind, types.int64), step))
    return builder.gep(args[0], [place])


@lower_builtin(operator.getitem, LanesArray, types.Any)
def _get_item(context, builder, sig, args):
    found = _address(context, builder, sig, args)
    return builder.load(found) if sig.return_type is lanes else found


@lower_builtin(operator.setitem, LanesArray, types.Any, lanes)
def _set_item(context, builder, sig, args):
    builder.store(args[2], _address(context, builder, sig, args))
    return context.get_dummy_value()


@lower_builtin(len, LanesArray)
def _length(context, builder, sig, args):
    return SIZE(sig.args[0].shape[0])


@lower_getattr(LanesArray, "shape")
def _shape(context, builder, array, value):
    return context.make_tuple(builder, types.UniTuple(types.int64, len(array.shape)), [SIZE(n) for n in array.shape])


@intrinsic
def gathered(typingctx, array, index):
    """Lanes array[index]; index: for each axis an integer, or Lanes of them."""

    def compiled(context, builder, sig, args):
        value = ir.Constant(VECTOR, ir.Undefined)
        for number, place in enumerate(_places(context, builder, sig, args)):
            one = context.cast(builder, builder.load(place), array.dtype, types.float64)
            value = builder.insert_element(value, one, SIZE(number))
        return value

    return lanes(array, index), compiled


@intrinsic
def scatter(typingctx, array, index, value):
    """array[index] = value, the first lane last: it counts where several lanes have the same place."""

    def compiled(context, builder, sig, args):
        for number, place in reversed(list(enumerate(_places(context, builder, sig, args)))):
            one = builder.extract_element(args[2], SIZE(number))
            builder.store(context.cast(builder, one, types.float64, array.dtype), place)
        return context.get_dummy_value()

    return types.void(array, index, lanes), compiled


@intrinsic
def gather_part(typingctx, array, index, out):
    """out = array[index], for each lane its part of the array, from the first axes' index as in ``gathered``.

    Four numbers at a time where the array is C-contiguous: in a third of the time of ``gathered`` for each number. The
    part has the shape of out.
    """

    def compiled(context, builder, sig, args):
        places = _places(context, builder, sig, args, len(out.shape))
        for first, size in _quads(out):
            quads = [_loaded(context, builder, sig, args, place, first, size) for place in places]
            quads = [_shuffled(builder, quad, quad, [min(i, size - 1) for i in range(4)]) for quad in quads]
            pairs = [_shuffled(builder, *quads[i::4], range(LANES)) for i in range(4)]
            for i, value in enumerate(_transposed(builder, pairs)[:size]):
                builder.store(value, builder.gep(args[2], [SIZE(first + i)]))
        return context.get_dummy_value()

    return types.void(array, index, out), compiled


@intrinsic
def scatter_part(typingctx, array, index, part):
    """array[index] = part of a C-contiguous array, as in ``gather_part``; the first lane last, as in ``scatter``."""

    def compiled(context, builder, sig, args):
        places = _places(context, builder, sig, args, len(part.shape))
        for first, size in _quads(part):
            values = [builder.load(builder.gep(args[2], [SIZE(first + min(i, size - 1))])) for i in range(4)]
            pairs = _transposed(builder, values)
            for number in reversed(range(LANES)):
                half, pair = number // 4 * 4, pairs[number % 4]
                quad = _shuffled(builder, pair, pair, range(half, half + size))
                builder.store(quad, _quad(builder, places[number], first, size), align=8)
        return context.get_dummy_value()

    if not _is_in_quads(array):
        raise TypingError(f"{array}, expected contiguous float64")
    return types.void(array, index, part), compiled


@intrinsic
def prefetch(typingctx, array, index):
    """Let the processor load array[index] into its cache, for each lane the line of that place; changes nothing."""

    def compiled(context, builder, sig, args):
        byte, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        for place in _places(context, builder, sig, args):
            builder.call(function, [builder.bitcast(place, byte), number(0), number(3), number(1)])  # to read, data
        return context.get_dummy_value()

    return types.void(array, index), compiled


def _is_in_quads(array):
    """Whether each part of an array lies in memory as vectors do."""
    return array.layout == "C" and array.dtype == types.float64


def _quads(part):
    """First number and size of each four numbers of a part; the last may be fewer."""
    count = math.prod(part.shape)
    return [(first, min(4, count - first)) for first in range(0, count, 4)]


def _loaded(context, builder, sig, args, place, first, size):
    """The vector of ``size`` numbers from number ``first`` of the part of an array at ``place``."""
    array, _, out = sig.args
    if _is_in_quads(array):
        return builder.load(_quad(builder, place, first, size), align=8)
    strides = cgutils.unpack_tuple(builder, context.make_array(array)(context, builder, args[0]).strides)
    value, kind = ir.Constant(ir.VectorType(ir.DoubleType(), size), ir.Undefined), place.type
    for i in range(size):
        offset, left = builder.ptrtoint(place, SIZE), first + i
        for length, stride in zip(reversed(out.shape), reversed(strides), strict=False):
            offset, left = builder.add(offset, builder.mul(stride, SIZE(left % length))), left // length
        one = context.cast(builder, builder.load(builder.inttoptr(offset, kind)), array.dtype, types.float64)
        value = builder.insert_element(value, one, SIZE(i))
    return value


def _quad(builder, place, first, size):
    """The address of ``size`` numbers from number ``first`` of a part at ``place``, as one vector."""
    return builder.bitcast(builder.gep(place, [SIZE(first)]), ir.VectorType(ir.DoubleType(), size).as_pointer())


def _shuffled(builder, a, b, order):
    """The elements of a and then b in this order."""
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(ir.IntType(32), len(order)), list(order)))


def _transposed(builder, rows):
    """Four vectors of two quads: the first quads as the rows of a matrix, transposed, and the second ones alike.

    First the matrix of blocks of two by two is transposed, then each block.
    """
    for step in (2, 1):
        kept = [j if j & step == 0 else j - step + LANES for j in range(LANES)]  # of the upper row, then of the lower
        moved = [j + step for j in kept]
        rows = [_shuffled(builder, rows[i & ~step], rows[i | step], moved if i & step else kept) for i in range(4)]
    return rows


def _places(context, builder, sig, args, axes_of_part=0):
    """The address of array[index] for each lane; the index has no numbers for the last axes, those of a part."""
    array = context.make_array(sig.args[0])(context, builder, args[0])
    strides, common = cgutils.unpack_tuple(builder, array.strides), SIZE(0)
    strides = strides[: len(strides) - axes_of_part]
    own = ir.Constant(ir.VectorType(SIZE, LANES), [0] * LANES)
    for kind, value, stride in zip(sig.args[1], cgutils.unpack_tuple(builder, args[1]), strides, strict=True):
        if kind is lanes:
            numbers = builder.fptosi(value, own.type)
            own = builder.add(own, builder.mul(numbers, broadcast(builder, stride, own.type)))
        else:
            common = builder.add(common, builder.mul(context.cast(builder, value, kind, types.int64), stride))
    offsets = [builder.add(builder.extract_element(own, SIZE(number)), common) for number in range(LANES)]
    return [cgutils.pointer_add(builder, array.data, offset) for offset in offsets]


@kernel
def copy_lane_vector(source, number, out):
    """Copy one lane of source (n,) Lanes to out (n,)."""
    for i in range(len(out)):
        out[i] = lane(source[i], number)


@kernel
def copy_lane_matrix(source, number, out):
    """Copy one lane of source (n, m) Lanes to out (n, m)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = lane(source[i, j], number)
