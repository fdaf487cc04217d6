"""What is kept of an object is of that very object, and no more of it is kept than said."""

from fractions import Fraction

from service.dynamics.identity_cache import MAX_OBJECTS_CACHED, IdentityCache


def test_what_is_made_once_is_made_no_more_and_equal_objects_are_apart():
    asked = []

    def noted(number: Fraction) -> list[Fraction]:
        asked.append(number)
        return [number]

    kept = IdentityCache(noted)
    one, other = Fraction(10, 7), Fraction(10, 7)
    assert kept(one) is kept(one)
    assert kept(other) is not kept(one)
    assert asked == [one, other]


def test_the_oldest_is_forgotten_first():
    asked = []

    def noted(number: Fraction) -> int:
        asked.append(number)
        return len(asked)

    kept = IdentityCache(noted)
    numbers = [Fraction(k, 3) for k in range(MAX_OBJECTS_CACHED + 1)]
    made = [kept(number) for number in numbers]
    assert [kept(number) for number in numbers[1:]] == made[1:]
    assert kept(numbers[0]) == MAX_OBJECTS_CACHED + 2
