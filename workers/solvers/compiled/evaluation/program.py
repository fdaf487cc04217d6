"""A formula as arrays of instructions and constants: kernels interpret them, no formula is compiled."""

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.dynamics.formula import derived
from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.formula.derived import Derived
from service.dynamics.formula.tape import Instruction, Tape
from service.dynamics.formula.tree import VARIABLES
from service.dynamics.identity_cache import IdentityCache
from workers.solvers.compiled.records import Instructions

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

REST_OF_PI = 1.2246467991473532e-16
"""The rest of π beyond its double, as a double."""
_ALL_EXACT = 2**53

_OPERATIONS = ("constant", "add", "subtract", "multiply", "divide", "negate", "power", "general_power")
_FUNCTIONS = ("exp", "log", "sin", "cos", "tan", "abs", "sign")
CONSTANT, ADD, SUBTRACT, MULTIPLY, DIVIDE, NEGATE, POWER, GENERAL_POWER = range(8)
EXP, LOG, SIN, COS, TAN, ABS, SIGN = range(8, 15)


class Program(NamedTuple):
    """The structure of a formula in g1, g2, g3 without its constants: rows (operation, left, right, slot).

    ``slot`` is the place of the constant (or exponent) among the constants, -1 for 0; an integer in the place
    of ``right`` is added to it.
    """

    code: IntArray
    """Shape (instructions, 4); the result is register ``result``; registers 0, 1, 2 are g1, g2, g3."""
    result: int
    turn: Instructions
    """The instructions of D = g1 V_3 − g3 V_1, with the same constants."""
    gradient: Instructions
    """The instructions of V and of its derivatives V_1, V_2 and V_3, with the same constants."""
    tape: Tape
    """A formula of this structure."""

    @property
    def across(self) -> Instructions:
        """Return the instructions of :func:`.derived.across`, with the same constants."""
        return _INSTRUCTIONS(derived.derived(self.tape, derived.across))

    @property
    def key(self) -> bytes:
        """Return what two formulas of one structure have in common."""
        return self.code.tobytes() + self.result.to_bytes(4, "little")


def rests_of(tape: Tape, constants: FloatArray) -> FloatArray:
    """Return what the doubles of a tape's constants leave out, in the order of :func:`make_program`.

    NaN where a constant has no double.
    """
    rests = [0.0] * (len(tape.variables) - len(VARIABLES))
    for number in numbers_of(tape):
        rests.append(rest_of(number, float(constants[len(rests)])))
    return np.array(rests)


def numbers_of(tape: Tape) -> list[Fraction | None]:
    """Return the numbers of a tape in the order of :func:`make_program`, None for π."""
    return [instruction.number for instruction in tape.instructions if has_number(instruction)]


def has_number(instruction: Instruction) -> bool:
    """Tell whether there is a number in an instruction."""
    return instruction.operation == "pi" or instruction.number is not None


def rest_of(number: Fraction | None, known: float) -> float:
    """Return what a double leaves out of a number, of π for None; NaN where that is no small number."""
    if number is None:
        return REST_OF_PI
    if number.denominator == 1 and abs(number.numerator) < _ALL_EXACT:
        return 0.0
    return float(number - Fraction(known)) if math.isfinite(known) else math.nan


def make_program(tape: Tape) -> tuple[Program, FloatArray]:
    """Return the structure of a tape over g1, g2, g3 and further variables, and its constants.

    Further variables become constants, the first ones, with the value 0 until it is replaced.
    """
    extra = len(tape.variables) - len(VARIABLES)
    if extra:
        return _program(tape, extra)
    # Every problem has a tape of its own; those of a known potential have their instructions in common.
    known = _PLAIN(tape.instructions).get(tape.result)
    if known is None:
        known = _PLAIN(tape.instructions)[tape.result] = _program(tape, extra)
    program, constants = known
    return program, constants.copy()


def _program(tape: Tape, extra: int) -> tuple[Program, FloatArray]:
    rows: list[tuple[int, int, int, int]] = [(CONSTANT, -1, 0, slot) for slot in range(extra)]
    constants = [0.0] * extra
    for instruction in tape.instructions:
        number, right, slot = instruction.number, instruction.right, -1
        if has_number(instruction):
            slot, right = len(constants), 0
            constants.append(np.pi if number is None else nearest_double(number))
        rows.append((_operation(instruction), instruction.left, right, slot))
    turn, gradient = (_INSTRUCTIONS(derived.derived(tape, each)) for each in (derived.turn, derived.gradient))
    return Program(_code(rows), tape.result, turn, gradient, tape), np.array(constants)


def _operation(instruction: Instruction) -> int:
    if instruction.operation == "call":
        return len(_OPERATIONS) + _FUNCTIONS.index(instruction.name)
    return _OPERATIONS.index("constant" if instruction.operation == "pi" else instruction.operation)


def _instructions(program: Derived) -> Instructions:
    rows: list[tuple[int, int, int, int]] = []
    for instruction, exact in zip(program.instructions, program.numbers, strict=True):
        right, slot = (instruction.right, -1) if exact is None else (exact.more, exact.place)
        rows.append((_operation(instruction), instruction.left, right, slot))
    return Instructions(_code(rows), np.array(program.results, dtype=np.int64))


_INSTRUCTIONS = IdentityCache(_instructions)


def _code(rows: list[tuple[int, int, int, int]]) -> IntArray:
    return np.array(rows, dtype=np.int64).reshape(-1, 4)


def _none_yet(_: Sequence[Instruction]) -> dict[int, tuple[Program, FloatArray]]:
    return {}


_PLAIN = IdentityCache(_none_yet)
"""Programs of tapes without further variables: of their instructions, by the result."""
