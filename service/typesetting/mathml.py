"""Boxes as presentation MathML (MathML Core): one ``math`` element, well-formed by construction."""

from xml.etree.ElementTree import Element, SubElement, tostring

from service.typesetting.boxes import (
    Box,
    Fenced,
    Fraction,
    Integral,
    Name,
    Numeral,
    Power,
    RootBox,
    RowBox,
    Sign,
)

NAMESPACE = "http://www.w3.org/1998/Math/MathML"
INVISIBLE_TIMES = "\u2062"


def mathml(box: Box) -> str:
    """Return a ``math`` element in its namespace, displayed as a block."""
    root = Element("math", {"xmlns": NAMESPACE, "display": "block"})
    _append(root, box)
    return tostring(root, encoding="unicode")


def _append(parent: Element, box: Box) -> None:
    """Add the elements of a box; those of a row stand beside each other."""
    match box:
        case Name(letters, _, subscript, is_upright):
            place = SubElement(parent, "msub") if subscript else parent
            is_marked = is_upright and len(letters) == 1
            SubElement(place, "mi", {"mathvariant": "normal"} if is_marked else {}).text = letters
            if subscript:
                SubElement(place, "mn").text = subscript
        case Numeral(digits):
            SubElement(parent, "mn").text = digits
        case Sign(character, is_prefix):
            sign = SubElement(parent, "mo", {"form": "prefix"} if is_prefix else {})
            sign.text = character or INVISIBLE_TIMES
        case RowBox(items):
            for item in items:
                _append(parent, item)
        case Fraction(numerator, denominator):
            _append_parts(SubElement(parent, "mfrac"), numerator, denominator)
        case RootBox(radicand, degree):
            if degree == 2:
                _append(SubElement(parent, "msqrt"), radicand)
            else:
                _append_parts(SubElement(parent, "mroot"), radicand, Numeral(str(degree)))
        case Power(Name(letters, name, subscript, is_upright), exponent) if subscript:
            # Both scripts at the same place, as γ₁² has them.
            both = SubElement(parent, "msubsup")
            _append(both, Name(letters, name, is_upright=is_upright))
            _append_parts(both, Numeral(subscript), exponent)
        case Power(base, exponent):
            _append_parts(SubElement(parent, "msup"), base, exponent)
        case Fenced(item, fences):
            row = SubElement(parent, "mrow")
            SubElement(row, "mo", {"form": "prefix"}).text = fences[0]
            _append(SubElement(row, "mrow"), item)
            SubElement(row, "mo", {"form": "postfix"}).text = fences[1]
        case Integral(integrand):
            SubElement(parent, "mo").text = "∫"
            _append(SubElement(parent, "mrow"), integrand)


def _append_parts(parent: Element, *parts: Box) -> None:
    """Add each part as exactly one element: the meaning of scripts and fractions depends on their number."""
    for part in parts:
        _append(SubElement(parent, "mrow"), part)
