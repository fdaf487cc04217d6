"""Points survive being stored, bit by bit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from service.storage.codecs.packing import (
    SOLVED,
    ChunkPoints,
    CodecError,
    bounds_of,
    chunk_outcome,
    decode_points,
    encode_points,
)

OUTCOMES = st.sampled_from([SOLVED, "no_motion", "several_windows"])


@st.composite
def points(draw):
    count, samples = draw(st.integers(1, 20)), draw(st.integers(1, 5))
    numbers = arrays.arrays(np.float64, (count,))
    series = arrays.arrays(np.float64, (count, samples))
    names = st.sampled_from(["period", "energy", "error", "t", "p"])
    return ChunkPoints(
        draw(st.lists(OUTCOMES, min_size=count, max_size=count)),
        draw(st.dictionaries(names, numbers, max_size=3)),
        draw(st.dictionaries(names, series, max_size=3)),
    )


def bits(columns):
    return {name: (values.shape, values.tobytes()) for name, values in columns.items()}


@given(points())
def test_points_come_back_as_they_were(given):
    found = decode_points(encode_points(given))
    assert list(found.outcomes) == list(given.outcomes)
    assert bits(found.numbers) == bits(given.numbers)
    assert bits(found.series) == bits(given.series)


@given(points())
def test_the_series_can_be_left_packed(given):
    found = decode_points(encode_points(given), with_series=False)
    assert bits(found.numbers) == bits(given.numbers)
    assert not found.series


@given(points())
def test_bounds_enclose_every_number_that_is_one(given):
    bounds = bounds_of(given.numbers)
    for name, values in given.numbers.items():
        finite = values[np.isfinite(values)]
        assert (name in bounds) == bool(len(finite))
        if len(finite):
            assert bounds[name] == (finite.min(), finite.max())


def test_an_outcome_counts_what_was_refused():
    outcome = chunk_outcome(ChunkPoints([SOLVED, "no_motion", SOLVED], {}), seconds=1.5)
    assert (outcome.count, outcome.refused, outcome.seconds) == (3, 1, 1.5)


@given(given=points(), place=st.floats(0, 1, exclude_max=True))
def test_damage_is_noticed(given, place):
    data = bytearray(encode_points(given))
    data[int(place * len(data))] ^= 0x55
    try:
        found = decode_points(bytes(data))
    except CodecError:
        return
    # Only a name may have become another one: numbers are under a checksum.
    assert [v.tobytes() for v in found.numbers.values()] == [v.tobytes() for v in given.numbers.values()]


@pytest.mark.parametrize("data", [b"", b"PLH", b"\xff\xff\xff\xff" + b"x" * 20])
def test_what_are_no_points_is_refused(data):
    with pytest.raises(CodecError):
        decode_points(data)
