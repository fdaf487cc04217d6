"""Writes an atlas as text for people."""

from collections import Counter
from collections.abc import Iterator, Sequence

from service.schemas.atlas.picture import KINDS
from service.schemas.atlas.replies import AtlasOut, AtlasPartOut, AtlasStabilityOut, AtlasWindowOut, ProofOut


def describe_atlas(atlas: AtlasOut) -> str:
    """Return a line for each part, its windows below it, and for each change between them."""
    return "\n".join(_lines(atlas))


def _lines(atlas: AtlasOut) -> Iterator[str]:
    if atlas.verdict == "undecided":
        yield "the potential is neither proved admissible nor refuted; these motions are those it would have"
    told = [(part.lambda_[0], list(_part(part))) for part in atlas.parts]
    told += [
        (
            change.lambda_.value,
            [
                f"  at λ = {change.lambda_.value!r} ± {change.lambda_.error:.2g}: {KINDS[change.kind]}"
                f"{_seen(change.proof)}"
            ],
        )
        for change in atlas.changes
    ]
    told += [(low, [f"λ from {low:.12g} to {high:.12g}: not decided"]) for low, high in atlas.undecided]
    for _, lines in sorted(told, key=lambda each: each[0]):
        yield from lines


def _seen(proof: ProofOut) -> str:
    return " (seen at single λ, not proved)" if proof == "seen" else ""


def _part(part: AtlasPartOut) -> Iterator[str]:
    low, high = part.lambda_
    where = f"λ from {low:.12g} to {high:.12g}"
    if part.samples is None:
        reason = "" if part.reason is None else f": {part.reason.code}: {part.reason.detail}"
        yield f"{where}{reason}"
        return
    windows = part.samples.windows
    if not windows:
        yield f"{where}: no motion{_seen(part.proof)}"
        return
    count = "1 window" if len(windows) == 1 else f"{len(windows)} windows"
    yield f"{where}: {count}, energy {_range(part.samples.energy)}{_seen(part.proof)}"
    for window in windows:
        yield _window(window)


def _window(window: AtlasWindowOut) -> str:
    period = "" if window.period is None else f", period {_range(window.period)}"
    ends = f"{window.ends[0]} to {window.ends[1]}"
    return f"  window {window.window}: {window.kind}, {ends}{period}{_stability(window.stability)}"


def _stability(stability: AtlasStabilityOut | None) -> str:
    """Return how many of the λ that were looked at have which verdict."""
    if stability is None:
        return ""
    found = Counter(verdict or "not told" for verdict in stability.verdict)
    return "".join(f", {verdict} at {count} of {found.total()} λ" for verdict, count in found.most_common())


def _range(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    return f"{min(known):.6g} to {max(known):.6g}" if known else "unknown"
