"""Validates long lists of numbers in one pass, which stops after very many faults."""

from collections.abc import Callable
from fractions import Fraction

from pydantic import ValidationError, ValidatorFunctionWrapHandler, WrapValidator
from pydantic_core import InitErrorDetails, PydanticCustomError, PydanticKnownError

from service.schemas.reading.faults import MAX_FAULTS


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
