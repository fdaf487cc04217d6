"""Problem documents of any kind, as Hypothesis strategies."""

from fractions import Fraction

from hypothesis import strategies as st

numbers = st.fractions(min_value=Fraction(1, 1000), max_value=1000, max_denominator=1000)
written = st.one_of(
    numbers.map(str), numbers.map(float), st.integers(1, 1000), numbers.map(lambda x: f" {x} ")
)
"""A number in any of its forms."""
signs = st.sampled_from([-1, 1, "-1", 1.0])
potentials = st.one_of(
    st.fixed_dictionaries({"type": st.just("gravity")}, optional=dict.fromkeys("abc", written)),
    st.fixed_dictionaries(
        {"type": st.just("rational")},
        optional={name: st.lists(written, max_size=4) for name in "abc"},
    ),
    st.fixed_dictionaries(
        {
            "type": st.just("expression"),
            "expression": st.sampled_from(["k*g1", "(k)*(g1)", "g1**2 - k/(g3^2)", "sqrt(A)*sin(g2)+k"]),
            "parameters": st.fixed_dictionaries({"k": written}),
        }
    ),
)
families = st.one_of(
    potentials,
    st.fixed_dictionaries(
        {"type": st.just("homogeneous")},
        # For A = 2C: B_3 has no value, log_1 and log_3 are there.
        optional={name: st.lists(written, max_size=3) for name in "ABC"}
        | {"log": st.tuples(st.just("0"), written).map(list)},
    ),
    st.fixed_dictionaries(
        {
            "type": st.just("general"),
            "F": st.sampled_from(["k*w", "(k)*(w)", "exp(-w)", "w**2/A"]),
            "parameters": st.fixed_dictionaries({"k": written}),
        },
        optional={
            "G": st.sampled_from(["g2^2", "k + g2", "0"]),
            "reference_angle": st.sampled_from(["pi/4", "pi / 3", 0.5, "0.5", "1/2", 1]),
        },
    ),
)
starts = st.one_of(
    st.none(),
    st.fixed_dictionaries({"at": st.just("equator")}, optional={"s_sign": signs}),
    st.fixed_dictionaries({"at": st.just("rest")}, optional={"g2_sign": signs}),
    st.fixed_dictionaries({"g1": written}, optional={"g2_sign": signs, "s_sign": signs}),
)
motions = st.one_of(
    st.fixed_dictionaries(
        {"type": st.just("planar"), "lambda": written},
        optional={
            "g1_sign": signs,
            "g3_sign": signs,
            "window": st.sampled_from([0, 5, "2", 3.0, None]),
            "start": starts,
        },
    ),
    st.fixed_dictionaries(
        {"type": st.just("planar"), "nu": written}, optional={"g3_sign": signs, "start": starts}
    ),
    st.fixed_dictionaries(
        {
            "type": st.just("state"),
            "omega": st.lists(written, min_size=3, max_size=3),
            "gamma": st.sampled_from([["3/5", 0, "4/5"], [0, -1, 0], ["2/7", "3/7", "-6/7"]]),
        }
    ),
)
times = st.one_of(
    st.fixed_dictionaries(
        {"stop": written, "samples": st.sampled_from([1, "9", 3.0])}, optional={"start": st.just(-1)}
    ),
    st.fixed_dictionaries({"times": st.lists(written, min_size=1, max_size=5)}),
)
problems = st.fixed_dictionaries(
    {"body": st.just({"A": 2, "B": 2, "C": 1}), "potential": families, "motion": motions, "time": times},
    optional={
        "accuracy": st.sampled_from(
            [
                {"tier": "standard"},
                {"tier": "high", "bits": None},
                {"tolerance": "1e-9"},
                {"tolerance": 1e-14},
                {"relative": "1/1000"},
                {"budget_seconds": 0.5},
            ]
        ),
        "method": st.just("auto"),
        "outputs": st.lists(st.sampled_from(["gamma", "omega", "invariants"]), min_size=1, max_size=5),
    },
)
