"""Compiles a formula to a list of instructions: shared parts once, exact constants, no recursion."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Literal, NamedTuple, TypeVar  # Any: what others derive from a tape

from service.dynamics.errors import UnknownNameError
from service.dynamics.formula.algebra import Algebra
from service.dynamics.formula.parameters import PI
from service.dynamics.formula.programs import Programs, Run, Way
from service.dynamics.formula.tree import (
    VARIABLES,
    Binary,
    BinaryOperator,
    FunctionName,
    Negation,
    Number,
    Symbol,
    Tree,
    fold_binary,
    fold_call,
    post_order,
    require_exponent,
)

T = TypeVar("T")

Operation = Literal[
    "constant", "pi", "add", "subtract", "multiply", "divide", "negate", "power", "general_power", "call"
]

_ARITHMETIC: dict[BinaryOperator, Operation] = {"+": "add", "-": "subtract", "*": "multiply", "/": "divide"}


class Instruction(NamedTuple):
    """One operation on registers; its result is appended as a new register.

    ``number`` is the value of a constant or the exponent of a power, ``name``
    the function of a call; operands that an operation lacks are -1.
    """

    operation: Operation
    left: int = -1
    right: int = -1
    number: Fraction | None = None
    name: str = ""


@dataclass(frozen=True, slots=True)
class Tape:
    """Instructions on registers, the first of which are the ``variables``; ``result`` is a register."""

    variables: tuple[str, ...]
    instructions: tuple[Instruction, ...]
    result: int
    derived: dict[object, Any] = field(default_factory=dict, compare=False, repr=False)
    """Results that were found for this formula, by name: shared by all tapes that are equal."""
    programs: Programs = field(default_factory=Programs, init=False, compare=False, repr=False)

    def evaluate(self, algebra: Algebra[T], inputs: Sequence[T]) -> T:
        """Return the value at ``inputs``, one per variable, computed in ``algebra``."""
        return self.registers(algebra, inputs)[self.result]

    def registers(self, algebra: Algebra[T], inputs: Sequence[T]) -> list[T]:
        """Return all registers, computed in ``algebra``: of a tape that has several results."""
        add, multiply, divide, power = algebra.add, algebra.multiply, algebra.divide, algebra.power
        registers = list(inputs)
        for operation, left, right, number, name in self.instructions:
            if operation == "add":
                value = add(registers[left], registers[right])
            elif operation == "multiply":
                value = multiply(registers[left], registers[right])
            elif number is not None:
                value = power(registers[left], number) if operation == "power" else algebra.constant(number)
            elif operation == "divide":
                value = divide(registers[left], registers[right])
            elif operation == "subtract":
                value = algebra.subtract(registers[left], registers[right])
            elif operation == "negate":
                value = algebra.negate(registers[left])
            elif operation == "call":
                value = algebra.call(name, registers[left])
            elif operation == "general_power":
                value = algebra.general_power(registers[left], registers[right])
            else:
                value = algebra.pi()
            registers.append(value)
        return registers

    def program(self, name: object, way: Way) -> Run | None:
        """Return a compiled way to ask this tape, None until it is asked often: :meth:`.Programs.find`."""
        return self.programs.find(self, name, way)


def compile_tape(tree: Tree, variables: Sequence[str] = VARIABLES, *, formally: bool = True) -> Tape:
    """Return the tape of ``tree``, whose symbols must be ``variables`` or ``pi``.

    Constant parts become exact numbers, by the rules of
    :func:`~service.dynamics.formula.tree.fold_binary`; x + 0, 1·x and x^1 are x. If not ``formally``,
    what is multiplied by 0, divides 0 or has the exponent 0 stays: the tape has a value only where all
    parts of the formula have one.

    Raises
    ------
    UnknownNameError
        Another symbol is left: the tree was not bound.
    UndefinedConstantError, FormulaLimitError
        A constant part has no value, or is too large.
    """
    return _Compiler(tuple(variables), formally).compile(tree)


class Recorder:
    """Instructions appended one by one, equal ones once; registers are numbers, the variables' first."""

    def __init__(self, variables: tuple[str, ...]) -> None:
        self._variables = variables
        self._instructions: list[Instruction] = []
        self._registers: dict[object, int] = {}

    def emit(self, instruction: Instruction) -> int:
        """Return the register of an instruction, which is appended unless it is there."""
        operation, left, right, number, name = instruction
        # The hash of a fraction takes a power of its denominator.
        key = instruction if number is None else (operation, left, right, *number.as_integer_ratio(), name)
        register = self._registers.get(key)
        if register is None:
            register = len(self._variables) + len(self._instructions)
            self._instructions.append(instruction)
            self._registers[key] = register
        return register

    def instruction(self, register: int) -> Instruction | None:
        """Return what made a register, None for a variable."""
        place = register - len(self._variables)
        return None if place < 0 else self._instructions[place]

    def whole(self, result: int) -> Tape:
        """Return the tape of a register beside all the others, numbered as here."""
        return Tape(self._variables, tuple(self._instructions), result)


_Operand = Fraction | int
"""While compiling: an exact constant, or the number of a register.

It is asked whether one is an int: a check of Fraction, which is an abstract class's, takes ten times as long.
"""


class _Compiler:
    def __init__(self, variables: tuple[str, ...], formally: bool) -> None:
        self._inputs = {name: register for register, name in enumerate(variables)}
        self._formally = formally
        self._recorder = Recorder(variables)
        self._emit = self._recorder.emit

    def compile(self, tree: Tree) -> Tape:
        # As fold_tree goes, without a call for each node.
        found: list[_Operand] = []
        for node in post_order(tree):
            if isinstance(node, Binary):
                right = found.pop()
                found[-1] = self._binary(node.operator, found[-1], right)
            elif isinstance(node, Number):
                found.append(node.value)
            elif isinstance(node, Symbol):
                found.append(self._symbol(node.name))
            elif isinstance(node, Negation):
                found[-1] = self._negate(found[-1])
            else:
                found[-1] = self._call(node.function, found[-1])
        return without_unused(self._recorder.whole(self._register(found[0])))

    def _symbol(self, name: str) -> _Operand:
        register = self._inputs.get(name)
        if register is not None:
            return register
        if name == PI:
            return self._emit(Instruction("pi"))
        raise UnknownNameError(f"{name!r} is not known here; known are {', '.join(self._inputs)}, {PI}")

    def _call(self, function: FunctionName, operand: _Operand) -> _Operand:
        if not isinstance(operand, int):
            value = fold_call(function, operand)
            if value is not None:
                return value
        if function == "sqrt":
            return self._power(operand, Fraction(1, 2))
        return self._emit(Instruction("call", self._register(operand), name=function))

    def _negate(self, operand: _Operand) -> _Operand:
        if not isinstance(operand, int):
            return -operand
        return self._emit(Instruction("negate", operand))

    def _binary(self, operator: BinaryOperator, left: _Operand, right: _Operand) -> _Operand:
        # Most operations are these, in which nothing is folded.
        if isinstance(left, int):
            if operator == "^":
                if not isinstance(right, int) and right:
                    require_exponent(right)
                    return self._power(left, right)
            elif isinstance(right, int):
                return self._emit(Instruction(_ARITHMETIC[operator], left, right))
        value = fold_binary(operator, _constant(left), _constant(right), formally=self._formally)
        if value is not None:
            return value
        if operator == "^":
            if not isinstance(left, int) and left == 1:
                return self._one_where_defined(right)
            if not isinstance(right, int) and right == 0:
                return self._one_where_defined(left)
            if not isinstance(right, int):
                return self._power(left, right)
            return self._emit(Instruction("general_power", self._register(left), self._register(right)))
        simple = self._without_neutral(operator, left, right)
        if simple is not None:
            return simple
        return self._emit(Instruction(_ARITHMETIC[operator], self._register(left), self._register(right)))

    def _one_where_defined(self, operand: _Operand) -> _Operand:
        """Return 1 + 0·x."""
        return self._binary("+", Fraction(1), self._binary("*", Fraction(0), operand))

    def _without_neutral(self, operator: BinaryOperator, left: _Operand, right: _Operand) -> _Operand | None:
        """Return what is left of an operation with a constant 0, 1 or -1, None if all of it is."""
        if not isinstance(right, int):
            if operator in "+-" and right == 0:
                return left
            if operator in "*/" and abs(right) == 1:
                return left if right == 1 else self._negate(left)
        if not isinstance(left, int):
            if operator in "+-" and left == 0:
                return right if operator == "+" else self._negate(right)
            if operator == "*" and abs(left) == 1:
                return right if left == 1 else self._negate(right)
        return None

    def _power(self, base: _Operand, exponent: Fraction) -> _Operand:
        """Emit base^exponent; what is a rational constant has been folded already."""
        if exponent == 1:
            return base
        return self._emit(Instruction("power", self._register(base), number=exponent))

    def _register(self, operand: _Operand) -> int:
        if not isinstance(operand, int):
            return self._emit(Instruction("constant", number=operand))
        return operand


def with_inputs(tape: Tape, places: Sequence[int]) -> Tape:
    """Return the tape with the constants of these instructions, by their places, as further variables."""
    inputs = len(tape.variables)
    names = tuple(f"constant {place}" for place in places)
    renumbered = {register: register for register in range(-1, inputs)}
    kept: list[Instruction] = []
    for place, instruction in enumerate(tape.instructions):
        if place in places:
            renumbered[inputs + place] = inputs + places.index(place)
            continue
        renumbered[inputs + place] = inputs + len(places) + len(kept)
        kept.append(
            instruction._replace(left=renumbered[instruction.left], right=renumbered[instruction.right])
        )
    return Tape((*tape.variables, *names), tuple(kept), renumbered[tape.result])


def _constant(operand: _Operand) -> Fraction | None:
    return None if isinstance(operand, int) else operand


def without_unused(tape: Tape) -> Tape:
    """Return the tape without the instructions its result does not need."""
    inputs = len(tape.variables)
    needed = {tape.result}
    for register in range(inputs + len(tape.instructions) - 1, inputs - 1, -1):
        if register in needed:
            instruction = tape.instructions[register - inputs]
            needed |= {instruction.left, instruction.right}
    if len(needed - set(range(-1, inputs))) == len(tape.instructions):
        return tape
    renumbered = {register: register for register in range(-1, inputs)}
    kept: list[Instruction] = []
    for register, instruction in enumerate(tape.instructions, start=inputs):
        if register in needed:
            renumbered[register] = inputs + len(kept)
            kept.append(
                instruction._replace(left=renumbered[instruction.left], right=renumbered[instruction.right])
            )
    return Tape(tape.variables, tuple(kept), renumbered[tape.result])
