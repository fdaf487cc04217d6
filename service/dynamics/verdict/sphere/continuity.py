"""Decides from its operations whether a formula is continuous where an absolute value is 0."""

from service.dynamics.formula.tape import Instruction, Tape
from service.dynamics.verdict.sphere.switches import needs_positive


def flows_continuously(tape: Tape, target: int) -> bool:
    """Whether what is done with the absolute value of a register is continuous at 0, or infinite."""
    # What depends on |x| continuously, and what has log |x| in it.
    smooth: set[int] = set()
    logarithmic: set[int] = set()
    for register, made in enumerate(tape.instructions, start=len(tape.variables)):
        if made.operation == "call" and made.name == "abs" and made.left == target:
            smooth.add(register)
            continue
        operands = {made.left, made.right}
        if operands & logarithmic:
            divides = made.operation == "divide" and made.right in smooth | logarithmic
            if divides or not _is_polynomial(made):
                return False
            logarithmic.add(register)
        elif operands & smooth:
            is_log = made.operation == "call" and made.name == "log"
            if is_log and _is_absolute_of(tape, made.left, target):
                logarithmic.add(register)
            elif _is_regular(made, smooth):
                smooth.add(register)
            else:
                return False
    return True


def _is_absolute_of(tape: Tape, register: int, target: int) -> bool:
    made = tape.instructions[register - len(tape.variables)]
    return made.operation == "call" and made.name == "abs" and made.left == target


def _is_polynomial(made: Instruction) -> bool:
    if made.operation == "power":
        return made.number is not None and made.number.denominator == 1 and made.number > 0
    return made.operation in ("add", "subtract", "multiply", "divide", "negate")


def _is_regular(made: Instruction, smooth: set[int]) -> bool:
    """Whether an instruction is continuous at 0 in what depends on the absolute value."""
    if made.operation == "divide":
        return made.right not in smooth
    if made.operation == "power":
        return made.number is not None and made.number > 0
    if needs_positive(made):
        return False
    return made.operation != "call" or made.name in ("exp", "sin", "cos", "abs")
