"""Compiles functions by numba; :mod:`workers.solvers.ways` is told of each, so that its code is kept."""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar, cast

from numba.core import types
from numba.extending import intrinsic

from workers.solvers import ways
from workers.solvers.compiled.linking import Kernel

F = TypeVar("F", bound=Callable[..., object])


def kernel(function: F) -> F:
    """Compile ``function`` at its first call; division by zero gives inf or NaN, sums keep their order."""
    compiled = Kernel(function)
    ways.made(compiled)
    return cast("F", compiled)


class _Builder(Protocol):
    """The part of llvmlite's builder of instructions that is used."""

    def fma(self, a: object, b: object, c: object) -> object: ...


def _fused(_: object, __: object, ___: object, ____: object) -> tuple[object, object]:
    def build(_: object, builder: _Builder, __: object, operands: Sequence[object]) -> object:
        a, b, c = operands
        return builder.fma(a, b, c)

    number = types.float64
    return number(number, number, number), build


fused: Callable[[float, float, float], float] = cast(
    "Callable[[float, float, float], float]", intrinsic(_fused)
)
"""Gives a b + c with one rounding, in kernels: an instruction where the processor has it, else a function of
the C library that has the same bits."""


def inlined(function: F) -> F:
    """Put ``function`` into the kernels that call it, which loops over several numbers at once need."""
    compiled = Kernel(function, is_inlined=True)
    ways.made(compiled)
    return cast("F", compiled)
