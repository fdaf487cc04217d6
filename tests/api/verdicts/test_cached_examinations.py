"""The memory holds what was used last, and asks the store for the rest."""

from service.api.verdicts.examiner import CachedExaminations
from service.storage.examinations import CacheRow


class Store:
    def __init__(self, **contents):
        self.contents, self.asked = contents, []

    def get(self, keys):
        self.asked.append(list(keys))
        return {key: self.contents[key] for key in keys if key in self.contents}


def test_the_store_is_asked_once_for_what_it_has():
    store = Store(a="one", b="two")
    kept = CachedExaminations(store)
    assert kept.get(["a", "c"]) == {"a": "one"}
    assert kept.get(["a", "b"]) == {"a": "one", "b": "two"}
    assert kept.get(["b", "a"]) == {"a": "one", "b": "two"}
    assert store.asked == [["a", "c"], ["b"]]
    assert kept.counts == (5, 1)


def test_what_was_not_used_for_longest_is_dropped_first():
    kept = CachedExaminations(Store(), most_bytes=30)
    kept.put(CacheRow(name, name * 10) for name in "abc")
    kept.get(["a"])
    kept.put([CacheRow("d", "d" * 10)])
    assert set(kept.in_memory("abcd")) == {"a", "c", "d"}


def test_an_entry_that_comes_twice_counts_once():
    kept = CachedExaminations(Store(), most_bytes=30)
    for _ in range(5):
        kept.put([CacheRow("a", "x" * 20)])
    kept.put([CacheRow("b", "x" * 10)])
    assert set(kept.in_memory("ab")) == {"a", "b"}


def test_an_entry_larger_than_the_memory_is_not_held():
    kept = CachedExaminations(Store(), most_bytes=30)
    kept.put([CacheRow("a", "x" * 31)])
    assert kept.in_memory("a") == {}
