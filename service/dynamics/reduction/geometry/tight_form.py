"""Rewrites a formula to an equal one on the sphere that gives tighter interval bounds.

Two rewritings, for parts that depend on g2 alone there: a polynomial that does, such as g1² + g3² − c, is
written in g2 where a function, a root or a quotient is taken of it, so that it does not change at all around
the second axis; and |x| + x is written x (1 + sign x), which is 0 where x < 0 and not the width of x.
"""

from fractions import Fraction

from service.dynamics.formula.register_polynomials import RegisterPolynomials, written_in_g2
from service.dynamics.formula.tape import Instruction, Recorder, Tape

_G2 = 1
_ORDER = (2, 0, _G2)
"""g3² is replaced on the sphere: a polynomial in g2 stays one."""


def tight_form(tape: Tape) -> Tape:
    """Return the tape rewritten; its variables begin with g1, g2, g3."""
    found: Tape | None = tape.derived.get(tight_form)
    if found is None:
        found = tape.derived[tight_form] = _rewritten(tape)
    return found


def _rewritten(tape: Tape) -> Tape:
    writer = _Writer(tape.variables)
    at = list(range(len(tape.variables)))
    for instruction in tape.instructions:
        at.append(writer.write(instruction, at))
    return writer.whole(at[tape.result])


class _Writer(Recorder):
    def __init__(self, variables: tuple[str, ...]) -> None:
        super().__init__(variables)
        self._polynomials = RegisterPolynomials(self, _ORDER)
        self._turns = {k: k != _G2 for k in range(len(variables))}
        """Whether a register is written with g1 or g3, or with anything but g2."""

    def emit(self, instruction: Instruction) -> int:
        """Return the register of an instruction, which is appended unless it is there."""
        register = super().emit(instruction)
        self._turns[register] = any(self._turns[k] for k in _operands(instruction))
        return register

    def write(self, instruction: Instruction, at: list[int]) -> int:
        """Write one instruction of the old tape, whose registers are now those of ``at``."""
        operation, _, _, number, _ = instruction
        left, right = (at[k] if k >= 0 else k for k in (instruction.left, instruction.right))
        is_whole = number is not None and number.denominator == 1 and number > 0
        is_power = operation == "power" and not is_whole
        if operation in ("call", "general_power") or is_power:
            left = self._in_g2(left)
        if operation in ("divide", "general_power"):
            right = self._in_g2(right)
        found = self._without_width(operation, left, right)
        return self.emit(instruction._replace(left=left, right=right)) if found is None else found

    def _without_width(self, operation: str, left: int, right: int) -> int | None:
        """Return the register of |x| ± x or x − |x|, None if it is something else."""
        if operation not in ("add", "subtract"):
            return None
        for size, x in ((left, right), (right, left)):
            if not self._is_size_of(size, x) or self._turns[x]:
                continue
            sign = self.emit(Instruction("call", x, name="sign"))
            one = self._constant(Fraction(1))
            ends = (one, sign) if operation == "add" or size == right else (sign, one)
            factor = self.emit(Instruction("add" if operation == "add" else "subtract", *ends))
            return self.emit(Instruction("multiply", x, factor))
        return None

    def _is_size_of(self, register: int, x: int) -> bool:
        made = self.instruction(register)
        # What |x| was taken of may have been written in g2.
        return made is not None and made.name == "abs" and made.left in (x, self._in_g2(x))

    def _in_g2(self, register: int) -> int:
        """Return the register of a polynomial in g2 alone if this is one, else this."""
        polynomial = self._polynomials.in_g2(register) if self._turns[register] else None
        if polynomial is None:
            return register
        made = self.instruction(register)
        if made is not None:
            parts = {k: self._in_g2(k) for k in _operands(made)}
            if parts and not any(self._turns[k] for k in parts.values()):
                # As it is written: multiplied out, a square loses its sign and a root its place.
                left, right = (parts.get(k, k) for k in (made.left, made.right))
                return self.emit(made._replace(left=left, right=right))
        return written_in_g2(self, polynomial)

    def _constant(self, value: Fraction) -> int:
        return self.emit(Instruction("constant", number=value))


def _operands(instruction: Instruction) -> list[int]:
    return [k for k in (instruction.left, instruction.right) if k >= 0]
