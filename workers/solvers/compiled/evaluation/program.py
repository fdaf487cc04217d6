"""A formula as arrays of instructions and constants: kernels interpret them, no formula is compiled."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.formula.tape import Instruction, Tape
from service.dynamics.formula.tree import VARIABLES
from service.dynamics.identity_cache import IdentityCache

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_REST_OF_PI = 1.2246467991473532e-16
_ALL_EXACT = 2**53

_OPERATIONS = ("constant", "add", "subtract", "multiply", "divide", "negate", "power", "general_power")
_FUNCTIONS = ("exp", "log", "sin", "cos", "tan", "abs", "sign")
CONSTANT, ADD, SUBTRACT, MULTIPLY, DIVIDE, NEGATE, POWER, GENERAL_POWER = range(8)
EXP, LOG, SIN, COS, TAN, ABS, SIGN = range(8, 15)


@dataclass(frozen=True, slots=True)
class Program:
    """The structure of a formula in g1, g2, g3 without its constants: rows (operation, left, right, slot).

    ``slot`` is the place of the constant (or exponent) among the constants, -1 for none.
    """

    code: IntArray
    """Shape (instructions, 4); the result is register ``result``; registers 0, 1, 2 are g1, g2, g3."""
    result: int

    @property
    def key(self) -> bytes:
        """Return what two formulas of one structure have in common."""
        return self.code.tobytes() + self.result.to_bytes(4, "little")


def rests_of(tape: Tape, constants: FloatArray) -> FloatArray:
    """Return what the doubles of a tape's constants leave out, in the order of :func:`make_program`.

    NaN where a constant has no double.
    """
    rests = [0.0] * (len(tape.variables) - len(VARIABLES))
    for instruction in tape.instructions:
        if instruction.operation == "pi" or instruction.number is not None:
            rests.append(rest_of(instruction.number, float(constants[len(rests)])))
    return np.array(rests)


def rest_of(number: Fraction | None, known: float) -> float:
    """Return what a double leaves out of a number, of π for None; NaN where that is no small number."""
    if number is None:
        return _REST_OF_PI
    if number.denominator == 1 and abs(number.numerator) < _ALL_EXACT:
        return 0.0
    return float(number - Fraction(known)) if math.isfinite(known) else math.nan


def make_program(tape: Tape) -> tuple[Program, FloatArray]:
    """Return the structure of a tape over g1, g2, g3 and further variables, and its constants.

    Further variables become constants, the first ones, with the value 0 until it is replaced.
    """
    extra = len(tape.variables) - len(VARIABLES)
    if extra:
        return _program(tape.instructions, tape.result, extra)
    # Every problem has a tape of its own; those of a known potential have their instructions in common.
    known = _PLAIN(tape.instructions).get(tape.result)
    if known is None:
        known = _PLAIN(tape.instructions)[tape.result] = _program(tape.instructions, tape.result, extra)
    program, constants = known
    return program, constants.copy()


def _program(instructions: Sequence[Instruction], result: int, extra: int) -> tuple[Program, FloatArray]:
    rows: list[tuple[int, int, int, int]] = [(CONSTANT, -1, -1, slot) for slot in range(extra)]
    constants = [0.0] * extra
    for instruction in instructions:
        slot = -1
        if instruction.operation == "pi" or instruction.number is not None:
            slot = len(constants)
            constants.append(np.pi if instruction.number is None else nearest_double(instruction.number))
        if instruction.operation == "call":
            operation = len(_OPERATIONS) + _FUNCTIONS.index(instruction.name)
        else:
            operation = _OPERATIONS.index(
                "constant" if instruction.operation == "pi" else instruction.operation
            )
        rows.append((operation, instruction.left, instruction.right, slot))
    code = np.array(rows, dtype=np.int64).reshape(-1, 4)
    return Program(code, result), np.array(constants)


def _none_yet(_: Sequence[Instruction]) -> dict[int, tuple[Program, FloatArray]]:
    return {}


_PLAIN = IdentityCache(_none_yet)
"""Programs of tapes without further variables: of their instructions, by the result."""
