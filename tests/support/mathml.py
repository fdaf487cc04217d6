"""Presentation MathML read back: its elements checked, and the value of what it shows computed."""

import math
from collections.abc import Callable, Mapping
from xml.etree.ElementTree import Element, fromstring

NAMESPACE = "{http://www.w3.org/1998/Math/MathML}"
CHILDREN: Mapping[str, int | None] = {
    **{"math": None, "mrow": None, "msqrt": None},
    **{"mi": 0, "mn": 0, "mo": 0, "mfrac": 2, "mroot": 2, "msup": 2, "msub": 2, "msubsup": 3},
}
"""How many children an element has; None: any number."""
TIMES = ("·", "\u2062")
FUNCTIONS: Mapping[str, Callable[[float], float]] = {
    "ln": math.log,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
}


def checked(text: str) -> Element:
    """Return the ``math`` element, all of whose descendants are MathML with the children they must have."""
    root = fromstring(text)
    assert root.tag == f"{NAMESPACE}math"
    for element in root.iter():
        assert element.tag.startswith(NAMESPACE), element.tag
        number = CHILDREN[element.tag.removeprefix(NAMESPACE)]
        assert number is None or len(element) == number, element.tag
        assert set(element.attrib) <= {"display", "form", "mathvariant"}
        assert (number == 0) == bool((element.text or "").strip())
        assert not (element.tail or "").strip()
    return root


def value_of(text: str, names: Mapping[str, float]) -> float:
    """Return the value of what stands there, as people read it; ``names`` are letters with subscripts."""
    return _Reader(names).row(list(checked(text)))


class _Reader:
    def __init__(self, names: Mapping[str, float]) -> None:
        self._names = names

    def row(self, items: list[Element]) -> float:
        """Sums of products; a minus sign in front negates the product behind it."""
        total, sign, factors = 0.0, 1.0, []
        for item in items:
            if _operator(item) in ("+", "−"):
                assert factors or item is items[0], "two signs stand together"
                total += sign * self._product(factors) if factors else 0.0
                sign, factors = (1.0 if _operator(item) == "+" else -1.0), []
            else:
                factors.append(item)
        return total + sign * self._product(factors)

    def _product(self, items: list[Element]) -> float:
        """Factors with signs of multiplication between; a slash between numbers in exponents."""
        value, position, divides = 1.0, 0, False
        while position < len(items):
            factor, position = self._factor(items, position)
            value = value / factor if divides else value * factor
            if position < len(items):
                operator = _operator(items[position])
                assert operator in (*TIMES, "/"), operator
                divides = operator == "/"
                position += 1
                assert position < len(items)
        return value

    def _factor(self, items: list[Element], position: int) -> tuple[float, int]:
        item = items[position]
        function, power = _function(item)
        if function is not None:
            return FUNCTIONS[function](self.element(items[position + 1])) ** power, position + 2
        return self.element(item), position + 1

    def element(self, item: Element) -> float:
        tag, parts = item.tag.removeprefix(NAMESPACE), list(item)
        match tag:
            case "mn":
                return float(item.text or "")
            case "mi":
                return math.e if item.text == "e" else self._names[item.text or ""]
            case "msub":
                return self._names[f"{parts[0].text}{parts[1].text}"]
            case "msubsup":
                subscript = "".join(parts[1].itertext())
                return math.pow(self._names[f"{parts[0].text}{subscript}"], self.element(parts[2]))
            case "mfrac":
                return self.element(parts[0]) / self.element(parts[1])
            case "msqrt":
                return math.sqrt(self.row(parts))
            case "mroot":
                return self.element(parts[0]) ** (1 / self.element(parts[1]))
            case "msup":
                return math.pow(self.element(parts[0]), self.element(parts[1]))
            case "mrow" if parts and _operator(parts[0]) == "(":
                return self.row(list(parts[1]))
            case "mrow" if parts and _operator(parts[0]) == "|":
                return abs(self.row(list(parts[1])))
        return self.row(parts)


def _operator(item: Element) -> str | None:
    return item.text if item.tag == f"{NAMESPACE}mo" else None


def _function(item: Element) -> tuple[str | None, int]:
    """Return the name of a function, and its power if it is written sin² x."""
    if item.tag == f"{NAMESPACE}mi" and item.text in FUNCTIONS:
        return item.text, 1
    if item.tag == f"{NAMESPACE}msup":
        base, exponent = list(item[0]), list(item[1])
        if len(base) == 1 and base[0].tag == f"{NAMESPACE}mi" and base[0].text in FUNCTIONS:
            return base[0].text, int(exponent[0].text or "")
    return None, 1
