"""Formulas in balls as compiled straight-line Python: the same operations, decided once.

What a tape does in an algebra is traced (:mod:`.traces`), and the trace becomes one function of operators
and methods of flint. Every operation is that of :class:`~.algebras.ball.BallAlgebra` or
:class:`~.algebras.complex_ball.ComplexBallAlgebra`, in an order that gives the same balls to the last bit.
Its text is made of numbers of registers and fixed words: nothing that a client wrote gets into it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, Literal  # Any: a function of balls or of complex ones

from flint import acb, ctx, fmpq

from service.dynamics.formula.algebra import Algebra
from service.dynamics.formula.algebras.ball import BallAlgebra, whole_power
from service.dynamics.formula.algebras.complex_ball import ComplexBallAlgebra
from service.dynamics.formula.traces import Step, Traced, Tracer

if TYPE_CHECKING:
    from service.dynamics.formula.tape import Tape

OFTEN = 24
"""Evaluations of one kind after which a program pays for its making."""
LONGEST = 4000
"""Steps of a program: making longer ones takes longer than is sure to be saved."""
FORMULAS = 64
"""Number of formulas whose programs are cached for the next problem."""
PRECISIONS = 16
"""Number of precisions for which the constants of a program are cached."""

Kind = Literal["real", "complex", "analytic"]
Run = Callable[..., tuple[Any, ...]]
"""Returns the results, given the inputs."""

_METHODS = {name: f"{{}}.{name}()" for name in ("exp", "sin", "cos", "tan", "log")}
_CALLS: dict[Kind, dict[str, str]] = {
    "real": _METHODS | {"abs": "abs({})", "sign": "{}.sgn()"},
    "complex": _METHODS | {"abs": "{}.real_abs()", "sign": "{}.real_sgn()"},
    "analytic": _METHODS | {"abs": "{}.real_abs(True)", "sign": "{}.real_sgn(True)", "log": "{}.log(True)"},
}
"""Every function there is: no other name gets into a program."""
_OPERATORS = {"add": "+", "subtract": "-", "multiply": "*", "divide": "/"}


@dataclass(frozen=True, slots=True)
class Way:
    """A way to ask a tape: which inputs it has beside its variables, and what is wanted."""

    kind: Kind
    trace: "Callable[[Tape, Tracer], tuple[Sequence[Traced], Sequence[Traced]]]"
    """Returns the inputs and the results of a tape, as values of the tracer."""
    is_shared: bool = False
    """True if the trace depends on the tape alone: equal tapes of later problems have the same program."""
    often: int = OFTEN


class Programs:
    """The programs of one tape, by the way it is asked; made when it has been asked often."""

    __slots__ = ("_asked", "_made", "_of_equal_tapes")

    def __init__(self) -> None:
        self._asked: dict[object, int] = {}
        self._made: dict[object, _Program | None] = {}
        self._of_equal_tapes: Programs | None = None

    def __reduce__(self) -> tuple[type["Programs"], tuple[()]]:
        """Leave the programs behind: they are made again where they are asked for."""
        return Programs, ()

    def find(self, tape: "Tape", name: object, way: Way) -> Run | None:
        """Return the program at the current precision; None while it is not worth its making.

        ``name`` is the way's, and tells it from other ways to ask this tape.
        """
        if way.is_shared:
            if self._of_equal_tapes is None:
                # Hashing a tape takes longer than using a program.
                self._of_equal_tapes = _of_equal_tapes(tape)
            return self._of_equal_tapes._own(tape, name, way)
        return self._own(tape, name, way)

    def _own(self, tape: "Tape", name: object, way: Way) -> Run | None:
        made = self._made.get(name)
        if made is not None:
            return made.at(ctx.prec)
        if name in self._made:
            return None
        asked = self._asked.get(name, 0) + 1
        self._asked[name] = asked
        if asked > way.often:
            self._made[name] = _made(tape, way)
        return None


@lru_cache(maxsize=FORMULAS)
def _of_equal_tapes(_: "Tape") -> Programs:
    return Programs()


@dataclass(slots=True)
class _Program:
    bind: Callable[..., Run]
    """Returns the function, given the constants."""
    constants: tuple[Callable[[], Any], ...]
    runs: dict[int, Run] = field(default_factory=dict)

    def at(self, precision: int) -> Run:
        run = self.runs.get(precision)
        if run is None:
            if len(self.runs) >= PRECISIONS:
                self.runs.clear()
            run = self.runs[precision] = self.bind(*(constant() for constant in self.constants))
        return run


def _made(tape: "Tape", way: Way) -> _Program | None:
    tracer = Tracer()
    inputs, results = way.trace(tape, tracer)
    steps = tracer.steps(results)
    if len(steps) > LONGEST:
        return None
    names: list[str] = []
    constants: list[Callable[[], Any]] = []
    lines: list[str] = []
    for number, step in steps:
        if step.operation == "variable":
            continue
        constant = _constant(step, way.kind)
        if constant is not None:
            names.append(f"v{number}")
            constants.append(constant)
        else:
            lines.append(f"v{number} = {_text(step, way.kind)}")
    head = ", ".join(f"v{value.number}" for value in inputs)
    tail = "".join(f"v{value.number}, " for value in results)
    body = "".join(f"\n        {line}" for line in lines)
    inner = f"    def run({head}):{body}\n        return ({tail})"
    text = f"def bind({', '.join(names)}):\n{inner}\n    return run"
    return _Program(_compiled(text), tuple(constants))


@lru_cache(maxsize=FORMULAS)
def _compiled(text: str) -> Callable[..., Run]:
    """Return what takes the constants; formulas that differ in them alone have one text."""
    space: dict[str, Any] = {"whole_power": whole_power, "fmpq": fmpq, "acb": acb}
    exec(compile(text, "<program of a tape>", "exec"), space)
    bind: Callable[..., Run] = space["bind"]
    return bind


def _constant(step: Step, kind: Kind) -> Callable[[], Any] | None:
    """Return what makes a constant at the current precision, None for another step."""
    algebra: Algebra[Any] = BallAlgebra() if kind == "real" else ComplexBallAlgebra(analytic=True)
    if step.operation == "pi":
        return algebra.pi
    if step.operation == "constant" and step.number is not None:
        return partial(algebra.constant, step.number)
    return None


def _text(step: Step, kind: Kind) -> str:
    left, right = f"v{step.left}", f"v{step.right}"
    if step.operation in _OPERATORS:
        return f"{left} {_OPERATORS[step.operation]} {right}"
    if step.operation == "negate":
        return f"-{left}"
    if step.operation == "power" and step.number is not None:
        return _power(left, *step.number.as_integer_ratio(), kind)
    if step.operation == "general_power":
        return f"({right} * {left}.log({'True' if kind == 'analytic' else ''})).exp()"
    return _CALLS[kind][step.name].format(left)


def _power(base: str, numerator: int, denominator: int, kind: Kind) -> str:
    analytic = "True" if kind == "analytic" else ""
    if denominator == 2 and abs(numerator) == 1:
        return f"{base}.{'sqrt' if numerator == 1 else 'rsqrt'}({analytic})"
    if denominator != 1:
        exponent = f"fmpq({numerator}, {denominator})"
        if kind == "real":
            return f"{base} ** {exponent}"
        return f"{base}.pow(acb({exponent}), analytic={analytic or 'False'})"
    if kind != "real":
        return f"{base} ** {numerator}"
    if abs(numerator) == 2:
        return f"{base} * {base}" if numerator > 0 else f"1 / ({base} * {base})"
    return f"whole_power({base}, {numerator})"
