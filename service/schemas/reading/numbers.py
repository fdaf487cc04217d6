"""Reads numbers, and long lists of them: JSON numbers, or strings that hold exact values."""

from collections.abc import Callable
from fractions import Fraction
from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainSerializer,
    PlainValidator,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WithJsonSchema,
    WrapValidator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError, PydanticKnownError

from service.dynamics.errors import InvalidNumberError
from service.dynamics.exact import exact_number, exact_text
from service.schemas.reading.documents import MAX_FAULTS, Document

LARGEST = Fraction(10) ** 300
"""Numbers other than 0 lie between 1/LARGEST and LARGEST in absolute value: within a double's range."""

_RANGE = "1e-300 to 1e300"

MAX_SAMPLES = 100_000
"""Times of one trajectory."""
HIGHEST_PRIORITY = 100
HIGHEST_DEGREE = 24
"""Largest degree up to which the nearest admissible polynomial is searched: some seconds of work at worst."""
LATEST = Fraction(10) ** 15
"""Largest |t| and number of periods: beyond it doubles are too coarse to resolve the phase."""
_LARGEST, _LATEST = int(LARGEST), int(LATEST)
"""The same as integers, for fast comparison with lists of 100 000 numbers."""
_TIMES = f"accepted are 0 and times of 1e-300 to {float(LATEST):.0e}"
"""Built once: a document may have 100 000 times."""


def refuse(code: str, message: str, *, below: str = "") -> PydanticCustomError:
    """Return the error to raise in a validator; ``below`` names the field at fault of an object."""
    context = {"message": message, "below": below}
    # Pydantic's annotation asks for a literal string; at run time any string works.
    return PydanticCustomError(code, "{message}", context)  # type: ignore[arg-type,unused-ignore]


def read_exact(value: object, *, accepted: str = f"accepted are 0 and {_RANGE}") -> Fraction:
    """Return the exact value of a JSON number or string; ``accepted`` names the range in its error."""
    if isinstance(value, bool) or not isinstance(value, int | float | str | Fraction):
        raise refuse("invalid_number", 'a number, or a string such as "17/10", is expected')
    try:
        number = exact_number(value)
    except InvalidNumberError as error:
        raise refuse("invalid_number", error.message) from error
    above, below = abs(number.numerator), number.denominator
    if above and not (below <= above * _LARGEST and above <= below * _LARGEST):
        raise refuse("invalid_number", f"out of range; {accepted}")
    return number


def read_positive(value: object, *, accepted: str = f"accepted are {_RANGE}") -> Fraction:
    """Return an exact value above 0."""
    number = read_exact(value, accepted=accepted)
    if number <= 0:
        raise refuse("out_of_range", f"{_short(number)} is not positive; {accepted}")
    return number


def read_moment(value: object) -> Fraction:
    """Return an exact moment of inertia."""
    number = read_exact(value, accepted=f"a moment of inertia is {_RANGE}")
    if number <= 0:
        raise refuse("invalid_inertia", f"{_short(number)} is not positive; a moment of inertia is > 0")
    return number


def read_nonzero(value: object) -> Fraction:
    """Return an exact value other than 0."""
    number = read_exact(value, accepted=f"accepted are {_RANGE}, of either sign")
    if number == 0:
        raise refuse("out_of_range", "0 is not accepted here; any other number is")
    return number


def read_integer(value: object, *, accepted: str = "an integer is accepted") -> int:
    """Return an integer, however it is written."""
    number = read_exact(value, accepted=accepted)
    if number.denominator != 1:
        raise refuse("invalid_number", f"{_short(number)} is not an integer; {accepted}")
    return number.numerator


def read_sign(value: object) -> Literal[-1, 1]:
    """Return 1 or -1."""
    number = read_integer(value, accepted="1 and -1 are accepted")
    if number == 1:
        return 1
    if number == -1:
        return -1
    raise refuse("out_of_range", "a sign is expected: 1 and -1 are accepted")


def read_time(value: object) -> Fraction:
    """Return an exact instant."""
    number = read_exact(value, accepted=_TIMES)
    if abs(number.numerator) > _LATEST * number.denominator:
        raise refuse("out_of_range", f"too far away; times up to ±{float(LATEST):.0e} are accepted")
    return number


def read_periods(value: object) -> Fraction:
    """Return an exact number of periods."""
    number = read_positive(value, accepted=f"1e-300 to {float(LATEST):.0e} periods are accepted")
    if number > LATEST:
        raise refuse("out_of_range", f"too many; up to {float(LATEST):.0e} periods are accepted")
    return number


def read_window(value: object) -> int:
    """Return the number of a window."""
    number = read_integer(value, accepted="0 to 999 are accepted")
    if not 0 <= number < 1000:
        raise refuse("out_of_range", "not the number of a window; 0 to 999 are accepted")
    return number


def read_samples(value: object) -> int:
    """Return a number of samples."""
    number = read_integer(value, accepted=f"1 to {MAX_SAMPLES} are accepted")
    if not 1 <= number <= MAX_SAMPLES:
        raise refuse("out_of_range", f"{number:.6g} samples; 1 to {MAX_SAMPLES} are accepted")
    return number


def read_search_degree(value: object) -> int:
    """Return the degree up to which the nearest admissible polynomial is searched."""
    accepted = f"0 to {HIGHEST_DEGREE} are accepted"
    number = read_integer(value, accepted=accepted)
    if not 0 <= number <= HIGHEST_DEGREE:
        raise refuse("out_of_range", f"out of range; {accepted}")
    return number


def check_priority(priority: int) -> int:
    """Return a priority, larger first."""
    if abs(priority) > HIGHEST_PRIORITY:
        raise refuse("out_of_range", f"-{HIGHEST_PRIORITY} to {HIGHEST_PRIORITY} are accepted")
    return priority


def _short(number: Fraction) -> str:
    text = exact_text(number)
    return text if len(text) <= 40 else f"{float(number):.6g}"


_EXACT_TEXT: Document = {
    "type": "string",
    # A ratio of integers or a decimal, as exact_number reads it, apart from limits of length.
    "pattern": r"^\s*([+-]?[0-9]+(/[0-9]+)?|[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]{1,4})?)\s*$",
}
_NUMBER_TEXT = {**_EXACT_TEXT, "examples": ["17/10", "1e-12"]}
_NUMBER = [{"type": "number"}, _NUMBER_TEXT]


def integer_schema(example: str, *, minimum: int, maximum: int) -> Document:
    """Return the JSON schema of an integer that may also be written as text."""
    number = {"type": "integer", "minimum": minimum, "maximum": maximum}
    return {"anyOf": [number, {**_EXACT_TEXT, "examples": [example]}]}


_TEXT = PlainSerializer(exact_text, return_type=str)

Exact = Annotated[Fraction, PlainValidator(read_exact), _TEXT, WithJsonSchema({"anyOf": _NUMBER})]
Positive = Annotated[
    Fraction,
    PlainValidator(read_positive),
    _TEXT,
    WithJsonSchema({"anyOf": [{"type": "number", "exclusiveMinimum": 0}, _NUMBER_TEXT]}),
]
Moment = Annotated[
    Fraction,
    PlainValidator(read_moment),
    _TEXT,
    WithJsonSchema({"anyOf": [{"type": "number", "exclusiveMinimum": 0}, _NUMBER_TEXT]}),
]
Instant = Annotated[Fraction, PlainValidator(read_time), _TEXT, WithJsonSchema({"anyOf": _NUMBER})]
Periods = Annotated[
    Fraction,
    PlainValidator(read_periods),
    _TEXT,
    WithJsonSchema({"anyOf": [{"type": "number", "exclusiveMinimum": 0}, _NUMBER_TEXT]}),
]
Nonzero = Annotated[Fraction, PlainValidator(read_nonzero), _TEXT, WithJsonSchema({"anyOf": _NUMBER})]
WindowNumber = Annotated[
    int,
    PlainValidator(read_window),
    WithJsonSchema(integer_schema("0", minimum=0, maximum=999)),
]
Samples = Annotated[
    int,
    PlainValidator(read_samples),
    WithJsonSchema(integer_schema("101", minimum=1, maximum=MAX_SAMPLES)),
]
SearchDegree = Annotated[
    int,
    PlainValidator(read_search_degree),
    WithJsonSchema(integer_schema("12", minimum=0, maximum=HIGHEST_DEGREE)),
]
Sign = Annotated[
    Literal[-1, 1], PlainValidator(read_sign), WithJsonSchema({"type": "integer", "enum": [-1, 1]})
]
Priority = Annotated[
    int,
    # To JSON 70.0 is an integer.
    BeforeValidator(lambda value: int(value) if isinstance(value, float) and value.is_integer() else value),
    AfterValidator(check_priority),
    Field(json_schema_extra={"minimum": -HIGHEST_PRIORITY, "maximum": HIGHEST_PRIORITY}),
]


def each_of(read: Callable[[object], Fraction], *, most: int) -> WrapValidator:
    """Return the validator of a long list of numbers: it reads each once, and stops after very many faults.

    The wrapped schema limits the length; ``most`` is its largest.
    """

    def read_list(value: object, handler: ValidatorFunctionWrapHandler) -> object:
        if not isinstance(value, list) or not value:
            return handler(value)
        if len(value) > most:
            limits = {"field_type": "List", "max_length": most, "actual_length": len(value)}
            raise PydanticKnownError("too_long", limits)
        numbers: list[Fraction] = []
        faults: list[InitErrorDetails] = []
        for index, item in enumerate(value):
            try:
                numbers.append(read(item))
            except PydanticCustomError as fault:
                faults.append(InitErrorDetails(type=fault, loc=(index,), input=None))
                if len(faults) > MAX_FAULTS:
                    break
        if faults:
            raise ValidationError.from_exception_data("numbers", faults)
        return numbers

    return WrapValidator(read_list)
