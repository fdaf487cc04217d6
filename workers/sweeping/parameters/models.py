"""The numbers in potentials that vary with the moments and with parameters, exactly, by their families."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from flint import fmpq

from service.dynamics.errors import FormulaError
from service.dynamics.exact import exact_number
from service.dynamics.formula.algebras.monomials import as_fmpq
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import Tape
from service.dynamics.formula.tree import VARIABLES, Binary, Call, Negation, Number, Symbol, Tree, fold_tree
from service.dynamics.potentials.families.coefficients import B_coefficients
from service.dynamics.potentials.potential import Potential
from service.schemas.problem.trusted import potential_of
from service.schemas.reading.documents import with_values
from workers.sweeping.parameters.coefficients import ExactParts, split_formula
from workers.sweeping.parameters.family import Path, degree_in
from workers.sweeping.parameters.templates import Key, Model, MomentsOfPoint, kind_of

_STEP = fmpq(104_729, 611_953)
"""A ratio of primes, far from any number that a formula would fold."""
_ONLY = (fmpq(1),)
"""The coefficients of the first term of either list."""
_NONE = fmpq(0)
"""Stands for a moment that nobody asks for."""


def model_of(document: Mapping[str, object], paths: Sequence[Path], moments: frozenset[str]) -> Model | None:
    """Return the potential whose numbers at ``paths`` and ``moments`` vary; None if it has no model."""
    kind = document.get("type")
    if kind == "expression" and all(path[0] == "parameters" for path in paths):
        return _expression(document, tuple(path[-1] for path in paths), moments)
    # The formulas of two families do not know of the body.
    if kind in ("gravity", "rational") or not moments:
        return ListedModel(document, tuple(paths))
    plain = kind == "homogeneous" and all(path[0] in ("A", "B", "C") for path in paths)
    return _homogeneous(document, paths) if plain else None


@dataclass(frozen=True, slots=True)
class ListedModel:
    """A potential whose numbers are those on the axes; "rational" is one for A = 2C."""

    document: Mapping[str, object]
    paths: tuple[Path, ...]

    @property
    def order(self) -> Sequence[int] | None:
        """See Model.order."""
        return range(len(self.paths))

    def values(self, moments: MomentsOfPoint, numbers: Sequence[fmpq]) -> list[fmpq] | None:
        """See Model.values."""
        return list(numbers)

    def key(self, values: Sequence[fmpq]) -> Key:
        """See Model.key: a family writes a sum by signs."""
        return tuple(map(kind_of, values))

    def probes(
        self, moments: MomentsOfPoint, numbers: Sequence[fmpq]
    ) -> list[tuple[list[fmpq], Tape]] | None:
        """See Model.probes."""
        return [(probe, self.potential(moments, probe).tape) for probe in probes_like(numbers)]

    def potential(self, moments: MomentsOfPoint, numbers: Sequence[fmpq]) -> Potential:
        """See Model.potential."""
        values: dict[Path, object] = {
            path: str(value) for path, value in zip(self.paths, numbers, strict=True)
        }
        return potential_of(with_values(self.document, values), moments.body())


def probes_like(values: Sequence[fmpq]) -> tuple[list[fmpq], list[fmpq]]:
    """Return two sets of numbers with the signs of these; what is 0, 1 or -1 stays, no two have one ratio."""
    first, second = list[fmpq](), list[fmpq]()
    for k, value in enumerate(values):
        # Not large: some are exponents.
        size = value if kind_of(value) in (0, 1, -1) else (13 + k) * _STEP * (1 if value > 0 else -1)
        first.append(size)
        second.append(size if size == value else size * (1 + _STEP / (7 + k)))
    return first, second


@dataclass(frozen=True, slots=True)
class ExpressionModel:
    """A formula with its largest parts that are made of parameters, moments and numbers alone."""

    document: Mapping[str, object]
    names: tuple[str, ...]
    """Names of the parameters on the axes."""
    holed: Mapping[str, object]
    """The same with a parameter for each part."""
    holes: tuple[str, ...]
    parts: ExactParts
    """Makes them of the parameters on the axes, A, C and B."""
    needs_moment: bool
    """Whether B is in any of them."""

    @property
    def order(self) -> Sequence[int] | None:
        """See Model.order."""
        results = self.parts.results
        return results if all(index < len(self.names) for index in results) else None

    def values(self, moments: MomentsOfPoint, numbers: Sequence[fmpq]) -> list[fmpq] | None:
        """See Model.values."""
        A, B, C = moments
        if B is None and self.needs_moment:
            return None
        try:
            return self.parts.values([*numbers, A, C, _NONE if B is None else B])
        except ZeroDivisionError:
            return None

    def key(self, values: Sequence[fmpq]) -> Key:
        """See Model.key."""
        return tuple(map(kind_of, values))

    def probes(
        self, moments: MomentsOfPoint, numbers: Sequence[fmpq]
    ) -> list[tuple[list[fmpq], Tape]] | None:
        """See Model.probes."""
        values = self.values(moments, numbers)
        if values is None:
            return None
        probes, body = list[tuple[list[fmpq], Tape]](), moments.body()
        for probe in probes_like(values):
            shown: dict[Path, object] = {
                ("parameters", hole): str(value) for hole, value in zip(self.holes, probe, strict=True)
            }
            probes.append((probe, potential_of(with_values(self.holed, shown), body).tape))
        return probes

    def potential(self, moments: MomentsOfPoint, numbers: Sequence[fmpq]) -> Potential:
        """See Model.potential."""
        values: dict[Path, object] = {
            ("parameters", name): str(value) for name, value in zip(self.names, numbers, strict=True)
        }
        return potential_of(with_values(self.document, values), moments.body())


@dataclass(frozen=True, slots=True)
class HomogeneousModel:
    """The homogeneous family without logarithmic terms."""

    document: Mapping[str, object]
    paths: tuple[Path, ...]
    lists: Mapping[str, tuple[fmpq, ...]]

    @property
    def order(self) -> Sequence[int] | None:
        """See Model.order."""
        return None

    def values(self, moments: MomentsOfPoint, numbers: Sequence[fmpq]) -> list[fmpq] | None:
        """See Model.values: coefficients and exponents of each power, then what is beside A g1² + C g3²."""
        lists = {name: list(row) for name, row in self.lists.items()}
        for (name, index), number in zip(self.paths, numbers, strict=True):
            lists[name][int(index)] = number
        alpha = moments.A / moments.C
        sums: dict[tuple[int, int, int, int], list[fmpq]] = {}
        for name, ratio in (("B", alpha), ("C", 1 / alpha)):
            for n, weight in enumerate(lists[name]):
                if not weight:
                    continue
                if n and _has_gap(ratio, n):
                    return None
                exponent = 2 * (ratio - 1) * (n + 1) / ratio
                sign = 1 if name == "B" or n % 2 == 0 else -1
                for k, factor in enumerate(B_coefficients(ratio, n) if n else _ONLY):
                    first, third = exponent - 2 * k, fmpq(2 * k)
                    if name == "C":
                        first, third = third, first
                    key = (int(first.p), int(first.q), int(third.p), int(third.q))
                    known = sums.setdefault(key, [fmpq(0), first, third])
                    known[0] += weight * (sign * factor)
        coefficients = [value for term in sums.values() for value in term]
        return [*coefficients, moments.A, moments.C, *lists["A"]]

    def key(self, values: Sequence[fmpq]) -> Key:
        """See Model.key: a family writes a sum by signs, and even powers without absolute values."""
        of_terms = len(values) - 2 - len(self.lists["A"])
        even = tuple(
            int(value.p) if index % 3 and value.q == 1 and int(value.p) % 2 == 0 else None
            for index, value in enumerate(values[:of_terms])
        )
        return even, tuple(map(kind_of, values))

    def probes(
        self, moments: MomentsOfPoint, numbers: Sequence[fmpq]
    ) -> list[tuple[list[fmpq], Tape]] | None:
        """See Model.probes: all numbers a little larger, each by another share."""
        values = self.values(moments, numbers)
        probes: list[tuple[list[fmpq], Tape]] = []
        for size in (1, 2):
            shares = [1 + fmpq(size, 1_000_003 + 7919 * k) for k in range(len(numbers) + 2)]
            # What is 0, 1 or -1 stays.
            A, C, *moved = (
                number if kind_of(number) in (0, 1, -1) else number * share
                for number, share in zip((moments.A, moments.C, *numbers), shares, strict=True)
            )
            near = MomentsOfPoint(A, None, C)
            probe = self.values(near, moved)
            if values is None or probe is None or self.key(probe) != self.key(values):
                return None
            probes.append((probe, self.potential(near, moved).tape))
        return probes

    def potential(self, moments: MomentsOfPoint, numbers: Sequence[fmpq]) -> Potential:
        """See Model.potential."""
        values: dict[Path, object] = {
            path: str(value) for path, value in zip(self.paths, numbers, strict=True)
        }
        return potential_of(with_values(self.document, values), moments.body())


def _homogeneous(document: Mapping[str, object], paths: Sequence[Path]) -> Model | None:
    lists: dict[str, tuple[fmpq, ...]] = {}
    for name in ("A", "B", "C", "log"):
        stated = document.get(name, [])
        if not isinstance(stated, list):
            return None
        lists[name] = tuple(as_fmpq(exact_number(value)) for value in stated)
    if any(lists["log"]):
        return None
    return HomogeneousModel(document, tuple(paths), lists)


def _expression(
    document: Mapping[str, object], names: tuple[str, ...], moments: frozenset[str]
) -> Model | None:
    try:
        tree = parse(str(document.get("expression")))
        if not _is_plain(tree, {*names, *moments}):
            return None
        holed, holes, parts, trees = split_formula(document, tree, names, tuple(moments), ("A", "C", "B"))
    except (FormulaError, ValueError):
        return None
    needs_moment = any(degree_in(part, {"B"}) for part in trees)
    return ExpressionModel(document, names, holed, holes, parts, needs_moment)


def _is_plain(tree: Tree, varying: set[str]) -> bool:
    """Tell whether no power of numbers that vary may be rational for some and not for others."""

    def look(_: int, node: Tree, below: Sequence[tuple[bool, bool, bool]]) -> tuple[bool, bool, bool]:
        """Return whether a variable is in it, whether a number that varies is, and whether it is plain."""
        if isinstance(node, Symbol):
            return node.name in VARIABLES, node.name in varying, True
        has, varies = any(each[0] for each in below), any(each[1] for each in below)
        is_plain = all(each[2] for each in below)
        if isinstance(node, Call) and node.function == "sqrt":
            is_plain &= has or not varies
        if isinstance(node, Binary) and node.operator == "^":
            is_plain &= below[0][0] or not varies or _is_whole(node.right)
        return has, varies, is_plain

    return fold_tree(tree, look)[2]


def _is_whole(tree: Tree) -> bool:
    tree = tree.operand if isinstance(tree, Negation) else tree
    return isinstance(tree, Number) and tree.value.denominator == 1


def _has_gap(ratio: fmpq, n: int) -> bool:
    """Tell whether a term with n > 0 has no value, or is nothing new: see :func:`.multiplicity`."""
    m = (n + 1) * min(ratio, 1 / ratio)
    return m.q == 1 and m <= n
