"""The cache keeps what was used last, in no more room than it was given."""

from concurrent.futures import ThreadPoolExecutor

from hypothesis import given
from hypothesis import strategies as st

from service.cache import Cache


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 5), st.binary(max_size=12))), st.integers(0, 30))
def test_it_is_the_dictionary_of_what_was_used_last(steps, most):
    """A list in the order of use, cut where it is full, says the same."""
    cache, model = Cache(most, len), []
    for is_put, key, value in steps:
        known = dict(model)
        if is_put:
            cache.put(key, value)
            model = [pair for pair in model if pair[0] != key] + [(key, value)]
            while sum(len(value) for _, value in model) > most:
                model.pop(0)
        else:
            assert cache.get(key) == known.get(key)
            model.sort(key=lambda pair: pair[0] == key)
    assert {key: cache.get(key) for key in range(6)} == {key: dict(model).get(key) for key in range(6)}


def test_a_value_is_made_once_as_long_as_there_is_room():
    cache, made = Cache(most=2), []

    def ask(key):
        return cache.get_or_make(key, lambda: made.append(key) or key.upper())

    assert [ask(key) for key in "aabacab"] == list("AABACAB")
    assert made == ["a", "b", "c", "b"]  # c took the place of b, which was used before a


def test_threads_leave_it_within_its_bounds():
    cache = Cache(100, len)
    with ThreadPoolExecutor(8) as threads:
        list(threads.map(lambda k: cache.get_or_make(k % 30, lambda: bytes(10)), range(4000)))
    assert sum(cache.get(k) is not None for k in range(30)) == 10
