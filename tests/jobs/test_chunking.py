"""How a sweep is cut: nothing twice, nothing left out, and about a second each."""

from hypothesis import given
from hypothesis import strategies as st

from service.jobs.queue import (
    CHUNK_SECONDS,
    CHUNKS_A_SECOND,
    LARGEST_BLOCK,
    LARGEST_CHUNK,
    LONGEST_SECONDS,
    PARTS,
    WAITING_CHUNKS,
    Range,
    cut,
    cut_rest,
    further,
    largest_chunk,
    next_size,
)

SECONDS = st.floats(1e-7, 1e3)


def points_of(ranges):
    return [index for each in ranges for index in range(each.first, each.first + each.count)]


@given(first=st.integers(0, 10**6), count=st.integers(1, 1000), parts=st.integers(1, 20))
def test_parts_are_nearly_equal_and_make_the_whole(first, count, parts):
    found = cut(Range(first, count), parts)
    assert points_of(found) == list(range(first, first + count))
    assert len(found) == min(parts, count)
    assert max(each.count for each in found) - min(each.count for each in found) <= 1


@given(first=st.integers(0, 10**6), count=st.integers(1, 1000), seconds=SECONDS)
def test_what_came_back_is_cut_into_few_parts(first, count, seconds):
    found = cut_rest(Range(first, count), seconds)
    assert points_of(found) == list(range(first, first + count))
    assert len(found) <= PARTS


@given(
    points=st.integers(1, 10**7),
    share=st.floats(0, 1, exclude_max=True),
    waiting=st.integers(0, 40),
    seconds=SECONDS,
    most=st.integers(1, LARGEST_CHUNK),
)
def test_the_queue_is_filled_with_what_comes_next(points, share, waiting, seconds, most):
    start = int(points * share)
    found = list(further(start, points, waiting, seconds, most))
    at = start
    for each in found:
        assert each.first == at
        assert 1 <= each.count <= most
        at += each.count
    assert at <= points
    assert len(found) <= max(0, WAITING_CHUNKS - waiting)
    assert len(found) == max(0, WAITING_CHUNKS - waiting) or at == points


@given(seconds=st.floats(1e-4, 0.25), left=st.integers(10**6, 10**7))
def test_far_from_the_end_a_chunk_takes_about_a_second(seconds, left):
    assert 0.5 <= next_size(seconds, left, LARGEST_CHUNK) * seconds <= 2.0


@given(seconds=st.floats(1e-4, 1e-2), left=st.integers(1000, 10**5))
def test_towards_the_end_several_workers_share_what_is_left(seconds, left):
    size = next_size(seconds, left, LARGEST_CHUNK)
    assert size <= left / 8 + 1 or size * seconds <= 0.25 + seconds


@given(seconds=st.floats(1e-3, 0.25), places=st.integers(1, 1000))
def test_where_many_compute_chunks_are_longer_so_that_fewer_end_in_a_second(seconds, places):
    taken = next_size(seconds, 10**9, LARGEST_CHUNK, places) * seconds
    # Of points there are whole numbers: a chunk is shorter by less than one of them.
    assert CHUNK_SECONDS - seconds <= taken <= LONGEST_SECONDS
    assert places / (taken + seconds) <= CHUNKS_A_SECOND or taken + seconds >= LONGEST_SECONDS


@given(seconds=st.floats(1e-4, 1e-2), left=st.integers(1000, 10**6), places=st.integers(8, 1000))
def test_towards_the_end_all_places_share_what_is_left(seconds, left, places):
    size = next_size(seconds, left, LARGEST_CHUNK, places)
    assert size <= left / places + 1 or size * seconds <= LONGEST_SECONDS / 4 + seconds


@given(samples=st.integers(0, 100_000), columns=st.integers(1, 13))
def test_series_keep_chunks_small(samples, columns):
    most = largest_chunk(samples, columns)
    assert 1 <= most <= LARGEST_CHUNK
    assert most == 1 or most * samples * columns <= LARGEST_BLOCK
