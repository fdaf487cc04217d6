"""JSON pointers find what they say, and a copy has something else there and nothing else changed."""

import copy

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.schemas.reading.documents import NoSuchPlaceError, split_pointer, value_at, with_values

KEYS = st.text(alphabet="ab~/01", max_size=3)
DOCUMENTS = st.recursive(
    st.integers(0, 9),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=12,
)


def places(document, path=()):
    """Every path in a document, but the empty one."""
    inside = (
        document.items()
        if isinstance(document, dict)
        else enumerate(document)
        if isinstance(document, list)
        else ()
    )
    for key, value in inside:
        yield (*path, str(key)), value
        yield from places(value, (*path, str(key)))


@given(DOCUMENTS)
def test_every_place_is_found_by_its_pointer(document):
    for path, value in places(document):
        pointer = "".join("/" + part.replace("~", "~0").replace("/", "~1") for part in path)
        assert split_pointer(pointer) == path
        assert value_at(document, path) is value


@given(document=DOCUMENTS, data=st.data())
def test_a_copy_differs_only_where_it_was_told(document, data):
    document = {"inside": document}
    leaves = [path for path, value in places(document) if isinstance(value, int)]
    chosen = data.draw(st.sets(st.sampled_from(leaves), max_size=3)) if leaves else set()
    before = copy.deepcopy(document)
    changed = with_values(document, dict.fromkeys(chosen, "new"))
    assert document == before
    found, expected = dict(places(changed)), dict(places(document))
    assert found.keys() == expected.keys()
    for path in leaves:
        assert found[path] == ("new" if path in chosen else expected[path])


@pytest.mark.parametrize("pointer", ["a", "/b", "/a/2", "/a/-1", "/a/01", "/a/x", "/a/0/x", "/a/²"])
def test_what_leads_nowhere_is_refused_with_what_is_there(pointer):
    with pytest.raises(NoSuchPlaceError) as refusal:
        value_at({"a": [1, 2]}, split_pointer(pointer))
    assert len(str(refusal.value)) > 20
