"""Documents of potentials that are others seen differently: multiplied by a number, or in a mirror."""

import re
from fractions import Fraction

from service.schemas.problem.problem import read_question

_SWAP = {"g1": "g3", "g3": "g1", "A": "C", "C": "A"}


def scaled(document: dict, k: Fraction) -> dict:
    """Return the question with k V."""

    def times(text: str) -> str:
        return f"({k})*({text})"

    def numbers(values: list) -> list:
        return [str(k * Fraction(value)) for value in values]

    potential = dict(document["potential"])
    match potential.pop("type"):
        case "expression":
            potential["expression"] = times(potential["expression"])
        case "gravity":
            potential = {name: str(k * Fraction(value)) for name, value in potential.items()}
        case "general":
            kept = ("parameters", "reference_angle")
            potential = {name: value if name in kept else times(value) for name, value in potential.items()}
        case _:
            potential = {name: numbers(values) for name, values in potential.items()}
    return {**document, "potential": {"type": document["potential"]["type"], **potential}}


def mirrored(document: dict) -> dict:
    """Return the question with the first and the third axis exchanged."""
    body = document["body"]
    potential = dict(document["potential"])
    match potential["type"]:
        case "expression":
            potential["expression"] = _swapped(potential["expression"])
        case "gravity":
            potential["a"], potential["c"] = potential.get("c", 0), potential.get("a", 0)
        case "rational":  # has no mirror image in its family
            question = {name: document[name] for name in ("body", "potential")}
            text = read_question(question).potential.formula()
            potential = {"type": "expression", "expression": _swapped(text)}
        case "homogeneous":
            B, C = potential.get("B", []), potential.get("C", [])
            potential["B"], potential["C"] = (
                [str((-1) ** n * Fraction(value)) for n, value in enumerate(values)] for values in (C, B)
            )
        case "general":
            potential = _mirrored_general(potential, Fraction(body["A"]) / Fraction(body["C"]))
    exchanged = {"A": body["C"], "C": body["A"]}
    return {"body": {**body, **exchanged}, "potential": potential}


def _mirrored_general(potential: dict, alpha: Fraction) -> dict:
    changed = {
        "type": "general",
        "parameters": potential.get("parameters", {}),
        "reference_angle": f"pi/2 - ({potential.get('reference_angle', 'pi/4')})",
    }
    for name, text in potential.items():
        if name[0] in "FG":
            quadrant = name[2:]
            # On a curve the mirror's w is this one's w^(-1/α).
            text = re.sub(r"\bw\b", f"(w^(-{alpha}))", _swapped(text)) if name[0] == "F" else _swapped(text)
            changed[f"{name[0]}_{quadrant[::-1]}" if quadrant else name] = text
    return changed


def _swapped(text: str) -> str:
    return re.sub(r"\b(g1|g3|A|C)\b", lambda match: _SWAP[match[0]], text)
