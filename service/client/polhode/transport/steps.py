"""Operations as generators: they yield what they need from outside, and never wait or send themselves.

The same operation is carried out by a thread or by an event loop; ``operation`` makes it a method that
returns its result in the one case, and something to await in the other.
"""

import re
from collections.abc import Callable, Coroutine, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import update_wrapper
from inspect import Signature, formatannotation, signature
from types import MethodType
from typing import Concatenate, Generic, ParamSpec, Protocol, TypeVar, get_args, overload

P = ParamSpec("P")
T = TypeVar("T")
Owner = TypeVar("Owner")


@dataclass(frozen=True, slots=True)
class Send:
    """Send a request, and receive the whole answer."""

    method: str
    path: str
    """Below the address of the service, with the query."""
    headers: Mapping[str, str] = field(default_factory=dict)
    content: bytes | None = None
    is_stream: bool = False
    """Receive the head only; the lines follow one by one by :class:`NextLine`."""


@dataclass(frozen=True, slots=True)
class NextLine:
    """Receive the next line of the stream that was opened last."""


@dataclass(frozen=True, slots=True)
class Pause:
    """Wait."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Together:
    """Carry out operations at the same time, all to their ends; the first of what they raise is thrown in."""

    operations: "Sequence[Operation[None]]"


@dataclass(frozen=True, slots=True)
class Reply:
    """The result of a step; names of headers are in lower case."""

    status: int = 0
    headers: Mapping[str, str] = field(default_factory=dict)
    content: bytes = b""
    line: str | None = None
    """The line that :class:`NextLine` asked for; None at the end of the stream."""


class LostConnectionError(Exception):
    """No answer, or not all of it, has arrived; thrown into the operation that asked."""


Step = Send | NextLine | Pause | Together
Operation = Generator[Step, Reply, T]


class Thread(Protocol):
    """Carries out operations in the thread that calls."""

    def run(self, steps: Operation[T]) -> T:
        """Return the operation's result."""


class Loop(Protocol):
    """Carries out operations in an event loop."""

    async def run_soon(self, steps: Operation[T]) -> T:
        """Return the operation's result."""


class Synchronous(Protocol):
    """Whose operations return their results."""

    @property
    def carrier(self) -> Thread:
        """The carrier that carries the operations out."""


class Asynchronous(Protocol):
    """Whose operations are awaited."""

    @property
    def carrier(self) -> Loop:
        """The carrier that carries the operations out."""


class operation(Generic[Owner, P, T]):  # noqa: N801 - used as a decorator
    """A method written once, as a generator, for both kinds of owner."""

    def __init__(self, function: Callable[Concatenate[Owner, P], Operation[T]]) -> None:
        def call(owner: Owner, /, *given: P.args, **named: P.kwargs) -> object:
            steps = function(owner, *given, **named)
            carrier: object = owner.carrier  # type: ignore[attr-defined]  # both kinds of owner have one
            return carrier.run_soon(steps) if hasattr(carrier, "run_soon") else carrier.run(steps)  # type: ignore[attr-defined]

        self.call = update_wrapper(call, function)
        self.call.__signature__ = as_called(signature(function))  # type: ignore[attr-defined]  # they take any

    @overload
    def __get__(self, instance: None, owner: type) -> Callable[Concatenate[Owner, P], object]: ...
    @overload
    def __get__(self, instance: Synchronous, owner: type) -> Callable[P, T]: ...
    @overload
    def __get__(self, instance: Asynchronous, owner: type) -> Callable[P, Coroutine[object, object, T]]: ...
    def __get__(self, instance: object, owner: type) -> object:
        """Return the method bound to ``instance``: a method as any other, which pickles by its name."""
        return self.call if instance is None else MethodType(self.call, instance)


def as_called(own: Signature) -> Signature:
    """Return the signature of an operation as a person calls it: with the result, without the steps."""
    result = (get_args(own.return_annotation) or (own.return_annotation,))[-1]
    parameters = [
        each if each.annotation is each.empty else each.replace(annotation=_words(each.annotation))
        for each in own.parameters.values()
    ]
    return own.replace(parameters=parameters, return_annotation=_words(result))


_NUMBER = "int | float | str | fractions.Fraction | decimal.Decimal"
_PATHS = re.compile(r"(polhode|collections|numpy|os)(\.\w+)*\.|\[~CarrierT\]|~")


def _words(annotation: object) -> "_Words":
    text = re.sub(r"ForwardRef\('(.*?)'\)", r"\1", formatannotation(annotation))
    return _Words(_PATHS.sub("", text.replace(_NUMBER, "Exact")))


class _Words(str):
    """An annotation that is shown as it is."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)
