"""Names of formulas as mechanicians write them: ``g1`` is γ₁, ``lambda`` is λ, ``a12`` is a₁₂.

Different names never look alike: of two that would, the one that comes later keeps its own letters,
upright.
"""

import re
from collections.abc import Iterable, Mapping
from types import MappingProxyType

from service.typesetting.boxes import Name

_GREEK: Mapping[str, str] = MappingProxyType(
    {
        **{"alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "eta": "η"},
        **{"theta": "θ", "iota": "ι", "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ"},
        **{"rho": "ρ", "sigma": "σ", "tau": "τ", "upsilon": "υ", "phi": "φ", "chi": "χ", "psi": "ψ"},
        **{"omega": "ω", "Gamma": "Γ", "Delta": "Δ", "Theta": "Θ", "Lambda": "Λ", "Xi": "Ξ", "Pi": "Π"},
        **{"Sigma": "Σ", "Upsilon": "Υ", "Phi": "Φ", "Psi": "Ψ", "Omega": "Ω"},
    }
)
_OWN: Mapping[str, Name] = MappingProxyType(
    {
        **{f"g{axis}": Name("γ", r"\gamma", str(axis)) for axis in (1, 2, 3)},
        "pi": Name("π", r"\pi"),
        "lambda": Name("λ", r"\lambda"),
        "nu": Name("ν", r"\nu"),
        "w": Name("w", "w"),
    }
)
"""Symbols of the formulas themselves: parameters give way to these."""
_PARTS = re.compile(r"([A-Za-z]+)_?([0-9]*)\Z", re.ASCII)


def names_of(symbols: Iterable[str], reserved: Iterable[str] = ()) -> dict[str, Name]:
    """Return the name of each of the ``symbols``, no two alike.

    ``reserved`` are letters that mean something else beside the formula: no parameter looks like them.
    """
    taken = {usual_name(letter) for letter in (*reserved, *_OWN)}
    found: dict[str, Name] = {}
    for symbol in sorted(symbols, key=lambda symbol: (len(symbol), symbol)):
        name = usual_name(symbol)
        if symbol not in _OWN and name in taken:
            name = _upright(symbol)
        taken.add(name)
        found[symbol] = name
    return found


def usual_name(symbol: str) -> Name:
    """Return a letter, Latin or Greek, with the digits at the end as its subscript; else an upright word."""
    if symbol in _OWN:
        return _OWN[symbol]
    parts = _PARTS.match(symbol)
    if parts is None:
        return _upright(symbol)
    word, digits = parts.groups()
    if len(word) == 1:
        return Name(word, word, digits)
    if word in _GREEK:
        return Name(_GREEK[word], rf"\{word}", digits)
    return Name(word, rf"\mathrm{{{word}}}", digits, is_upright=True)


def _upright(symbol: str) -> Name:
    escaped = symbol.replace("_", r"\_")
    return Name(symbol, rf"\mathrm{{{escaped}}}", is_upright=True)
