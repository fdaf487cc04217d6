"""Eight numbers at once: a value of compiled code with the arithmetic of doubles, lane by lane.

The compiler does not find by itself that eight sums of products can be taken side by side. Each lane has the
very digits that it has alone: operations are correctly rounded, and none is contracted or reordered. Where a
processor has shorter registers, the same operations are carried out in parts.
"""

import operator
from collections.abc import Callable
from typing import Any, Protocol, cast  # Any: numba and llvmlite have no types

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.datamodel import models
from numba.core.datamodel.registry import register_default
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic
from numpy.typing import NDArray

from workers.solvers.compiled.kernels import kernel

FloatArray = NDArray[np.float64]

LANES = 8
ROW = 8 * LANES
"""Bytes of a row."""
_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_INDEX = ir.IntType(64)
_ALIGNED = 8
"""Bytes: arrays begin anywhere that doubles may."""


class Lanes(Protocol):
    """Eight numbers as kernels see them; it exists in compiled code only."""

    def __add__(self, other: "Lanes") -> "Lanes": ...
    def __sub__(self, other: "Lanes") -> "Lanes": ...
    def __mul__(self, other: "Lanes") -> "Lanes": ...
    def __truediv__(self, other: "Lanes") -> "Lanes": ...


class LanesType(types.Type):  # type: ignore[misc,unused-ignore]
    """The type of :class:`Lanes` for the compiler."""


lanes: Any = cast("Any", LanesType)("Lanes")


@register_default(LanesType)
class _Model(models.PrimitiveModel):  # type: ignore[misc,unused-ignore]
    def __init__(self, manager: Any, kind: Any) -> None:  # noqa: ANN401
        cast("Any", super().__init__)(manager, kind, _VECTOR)


def _defined(operation: Callable[..., object], instruction: str) -> None:
    kinds = cast("Any", signature)(lanes, lanes, lanes)
    cast("Any", infer_global)(operation)(type("Typed", (ConcreteTemplate,), {"cases": [kinds]}))

    def lower(_: object, builder: Any, __: object, operands: Any) -> object:  # noqa: ANN401
        return cast("object", getattr(builder, instruction)(*operands))

    cast("Any", lower_builtin)(operation, lanes, lanes)(lower)


_defined(operator.add, "fadd")
_defined(operator.sub, "fsub")
_defined(operator.mul, "fmul")
_defined(operator.truediv, "fdiv")


def _row(builder: Any, place: object, row: object) -> object:  # noqa: ANN401
    far = builder.mul(row, ir.Constant(_INDEX, ROW))
    return cast("object", builder.inttoptr(builder.add(place, far), _VECTOR.as_pointer()))


def _place(_: object, array: Any) -> tuple[object, object]:  # noqa: ANN401
    def build(context: Any, builder: Any, kinds: Any, operands: Any) -> object:  # noqa: ANN401
        data = context.make_array(kinds.args[0])(context, builder, operands[0]).data
        return cast("object", builder.ptrtoint(data, _INDEX))

    return types.int64(array), build


def _take(_: object, __: object, ___: object) -> tuple[object, object]:
    def build(_: object, builder: Any, __: object, operands: Any) -> object:  # noqa: ANN401
        return cast("object", builder.load(_row(builder, *operands), align=_ALIGNED))

    return lanes(types.int64, types.int64), build


def _put(_: object, __: object, ___: object, ____: object) -> tuple[object, object]:
    def build(context: Any, builder: Any, __: object, operands: Any) -> object:  # noqa: ANN401
        builder.store(operands[2], _row(builder, *operands[:2]), align=_ALIGNED)
        return cast("object", context.get_dummy_value())

    return types.void(types.int64, types.int64, lanes), build


def _number(builder: Any, place: object, row: object, lane: object) -> object:  # noqa: ANN401
    far = builder.add(builder.mul(row, ir.Constant(_INDEX, LANES)), lane)
    far = builder.mul(far, ir.Constant(_INDEX, 8))
    return cast("object", builder.inttoptr(builder.add(place, far), ir.DoubleType().as_pointer()))


def _number_at(_: object, __: object, ___: object, ____: object) -> tuple[object, object]:
    def build(_: object, builder: Any, __: object, operands: Any) -> object:  # noqa: ANN401
        return cast("object", builder.load(_number(builder, *operands)))

    return types.float64(types.int64, types.int64, types.int64), build


def _put_number(_: object, __: object, ___: object, ____: object, _____: object) -> tuple[object, object]:
    def build(context: Any, builder: Any, __: object, operands: Any) -> object:  # noqa: ANN401
        builder.store(operands[3], _number(builder, *operands[:3]))
        return cast("object", context.get_dummy_value())

    return types.void(types.int64, types.int64, types.int64, types.float64), build


def _spread(_: object, number: object) -> tuple[object, object]:
    def build(_: object, builder: Any, __: object, operands: Any) -> object:  # noqa: ANN401
        alone = builder.insert_element(
            ir.Constant(_VECTOR, ir.Undefined), operands[0], ir.Constant(_INDEX, 0)
        )
        places = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return cast("object", builder.shuffle_vector(alone, ir.Constant(_VECTOR, ir.Undefined), places))

    return lanes(types.float64), build


def _size(_: object, value: object) -> tuple[object, object]:
    def build(_: object, builder: Any, __: object, operands: Any) -> object:  # noqa: ANN401
        # Without the bits of the signs.
        kind = ir.VectorType(_INDEX, LANES)
        bits = builder.and_(builder.bitcast(operands[0], kind), ir.Constant(kind, [2**63 - 1] * LANES))
        return cast("object", builder.bitcast(bits, _VECTOR))

    return lanes(lanes), build


def _larger(_: object, __: object, ___: object) -> tuple[object, object]:
    def build(_: object, builder: Any, __: object, operands: Any) -> object:  # noqa: ANN401
        return cast("object", builder.select(builder.fcmp_ordered(">", *operands), *operands))

    return lanes(lanes, lanes), build


place_of = cast("Callable[[FloatArray], int]", intrinsic(_place))
"""Returns where the numbers of a contiguous array are. Whoever asks keeps the array: a place has no owner.
It is passed on instead of arrays, the owners of which take longer to count than the arithmetic takes."""
take = cast("Callable[[int, int], Lanes]", intrinsic(_take))
"""Returns a row of ``LANES`` numbers: of a place, the number of the row."""
put = cast("Callable[[int, int, Lanes], None]", intrinsic(_put))
"""Puts numbers into a row: a place, the number of the row, the numbers."""
number_at = cast("Callable[[int, int, int], float]", intrinsic(_number_at))
"""Returns one number: of a place, the number of the row, and the lane."""
put_number = cast("Callable[[int, int, int, float], None]", intrinsic(_put_number))
"""Puts one number into a row."""
spread = cast("Callable[[float], Lanes]", intrinsic(_spread))
"""Returns one number in every lane."""
size_of = cast("Callable[[Lanes], Lanes]", intrinsic(_size))
"""Returns absolute values."""
larger = cast("Callable[[Lanes, Lanes], Lanes]", intrinsic(_larger))
"""Returns the larger number in every lane; the second one where one is NaN."""


@kernel
def new_rows(count: int) -> FloatArray:
    """Return room for rows of zeros, shape (count + 1, LANES); they begin at :func:`first_row` of it."""
    return np.zeros((count + 1, LANES))


@kernel
def first_row(room: FloatArray) -> int:
    """Return the first place at which a row is within one line of the processor's memory."""
    return (place_of(room) + ROW - 1) // ROW * ROW


@kernel
def combine(table: int, width: int, rows: int, columns: int, first: int, x: int, out: int) -> None:
    """Put sums of the rows of ``x``, by the numbers in a row of a table, into each of ``rows`` rows.

    A row begins with column ``first`` times its number; the table has ``width`` numbers a row. Four sums do
    not wait for one another.
    """
    for row in range(0, rows, 4):
        second, third, fourth = min(row + 1, rows - 1), min(row + 2, rows - 1), min(row + 3, rows - 1)
        i, j, k, m = row * width, second * width, third * width, fourth * width
        a, b, c, d = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
        for n in range(first * row, columns):
            value = take(x, n)
            a = a + spread(number_at(table, 0, i + n)) * value
            b = b + spread(number_at(table, 0, j + n)) * value
            c = c + spread(number_at(table, 0, k + n)) * value
            d = d + spread(number_at(table, 0, m + n)) * value
        put(out, row, a)
        put(out, second, b)
        put(out, third, c)
        put(out, fourth, d)
