"""Simplifies a formula's program: merges equal parts and removes identical cancellations."""

from collections.abc import Collection, Mapping
from fractions import Fraction

from service.dynamics.formula.tape import Instruction, Recorder, Tape, without_unused


class TapeBuilder(Recorder):
    """Instructions appended one by one, simplified where that is free."""

    def constant(self, value: Fraction) -> int:
        """Return a number."""
        return self.emit(Instruction("constant", number=value))

    def negate(self, register: int) -> int:
        """Return minus a register; twice is the register itself."""
        made = self.instruction(register)
        if made is not None and made.operation == "negate":
            return made.left
        return self.emit(Instruction("negate", register))

    def multiply(self, left: int, right: int) -> int:
        """Return a product; a factor 1 is left out."""
        for one, other in ((left, right), (right, left)):
            made = self.instruction(one)
            if made is not None and made.operation == "constant" and made.number == 1:
                return other
        return self.emit(Instruction("multiply", left, right))

    def divide(self, left: int, right: int) -> int:
        """Return a quotient; x/x is 1, (-x)/x is -1 and x y/x is y, wherever they have a value."""
        if left == right:
            return self.constant(Fraction(1))
        if self.negate(left) == right or self.negate(right) == left:
            return self.constant(Fraction(-1))
        made = self.instruction(left)
        if made is not None and made.operation == "multiply":
            for one, other in ((made.left, made.right), (made.right, made.left)):
                if one == right:
                    return other
                if self.negate(one) == right or self.negate(right) == one:
                    return self.negate(other)
        if made is not None and made.operation == "negate":
            inner = self.instruction(made.left)
            if inner is not None and inner.operation == "multiply":
                return self.negate(self.divide(made.left, right))
        return self.emit(Instruction("divide", left, right))

    def power(self, base: int, exponent: Fraction) -> int:
        """Return base^exponent."""
        if exponent == 0:
            return self.constant(Fraction(1))
        return base if exponent == 1 else self.emit(Instruction("power", base, number=exponent))

    def call(self, name: str, argument: int) -> int:
        """Return the function of a register."""
        return self.emit(Instruction("call", argument, name=name))

    def again(self, instruction: Instruction, registers: Mapping[int, int]) -> int:
        """Append an instruction of another tape, whose registers became ``registers``."""
        left, right = registers.get(instruction.left, -1), registers.get(instruction.right, -1)
        if instruction.operation == "negate":
            return self.negate(left)
        if instruction.operation == "divide":
            return self.divide(left, right)
        return self.emit(instruction._replace(left=left, right=right))

    def tape(self, result: int) -> Tape:
        """Return the tape of a register."""
        return without_unused(self.whole(result))


def with_signs(tape: Tape, signs: Mapping[int, int]) -> Tape:
    """Return a tape with the absolute values of some registers written as plus or minus the register."""
    return with_sides(tape, signs, ())


def with_sides(tape: Tape, signs: Mapping[int, int], growing: Collection[int]) -> Tape:
    """Return a tape for where some registers have these signs, and others, ``growing``, are positive.

    |x| is x or −x there; a/(b + exp x) is a exp(−x)/(b exp(−x) + 1), anywhere, which does not overflow.
    """
    builder = TapeBuilder(tape.variables)
    registers = {register: register for register in range(len(tape.variables))}
    for register, made in enumerate(tape.instructions, start=len(tape.variables)):
        sign = signs.get(made.left) if made.operation == "call" and made.name == "abs" else None
        split = exponential_in(tape, made.right) if made.operation == "divide" else None
        if sign is not None:
            argument = registers[made.left]
            registers[register] = argument if sign > 0 else builder.negate(argument)
        elif split is not None and split[0] in growing:
            decaying = builder.call("exp", builder.negate(registers[split[0]]))
            rest = builder.multiply(registers[split[1]], decaying)
            below = builder.emit(Instruction("add", rest, builder.constant(Fraction(1))))
            above = builder.multiply(registers[made.left], decaying)
            registers[register] = builder.emit(Instruction("divide", above, below))
        else:
            registers[register] = builder.again(made, registers)
    return builder.tape(registers[tape.result])


def exponential_in(tape: Tape, register: int) -> tuple[int, int] | None:
    """Return the registers (x, b) of exp x + b, None for another one."""

    def made_by(register: int) -> Instruction | None:
        place = register - len(tape.variables)
        return None if place < 0 else tape.instructions[place]

    total = made_by(register)
    if total is None or total.operation != "add":
        return None
    for one, other in ((total.left, total.right), (total.right, total.left)):
        made = made_by(one)
        if made is not None and made.operation == "call" and made.name == "exp":
            return made.left, other
    return None


def copied(tape: Tape) -> tuple[TapeBuilder, dict[int, int]]:
    """Return a builder that holds a tape, and what its registers became."""
    builder = TapeBuilder(tape.variables)
    registers = {register: register for register in range(len(tape.variables))}
    for register, made in enumerate(tape.instructions, start=len(tape.variables)):
        registers[register] = builder.again(made, registers)
    return builder, registers
