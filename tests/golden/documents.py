"""Problems whose digits are pinned to the declared version of the numerics."""

TIMES = {"times": [0, 1, "7/2", 1000]}


def expression(text: str) -> dict[str, object]:
    return {"type": "expression", "expression": text}


def problem(moments: dict[str, object], potential: dict[str, object], **fields: object) -> dict[str, object]:
    return {"body": moments, "potential": potential, "time": TIMES, **fields}


DOUBLE = {"A": 2, "B": "3/2", "C": 1}
NU_1 = {"type": "planar", "nu": 1}
QUADRATURE = {"method": "quadrature"}

DOCUMENTS: dict[str, dict[str, object]] = {
    "doubles, rotation": problem(DOUBLE, {"type": "gravity", "a": -1}, motion=NU_1),
    "doubles, libration": problem(DOUBLE, expression("-g1 + 1/20/g3^2"), motion=NU_1),
    "quadrature, rotation": problem(DOUBLE, {"type": "gravity", "a": -1}, motion=NU_1, **QUADRATURE),
    "quadrature, libration": problem(
        {"A": 3, "B": "5/2", "C": 1},
        expression("(3*g1^2+g3^2)*(g2^2-1/2+g2^3/5)"),
        motion={"type": "planar", "lambda": "4/5"},
        **QUADRATURE,
    ),
    "pole passed by convention": problem(
        {"A": "17/10", "C": 1},
        {"type": "homogeneous", "B": [-1]},
        motion={"type": "planar", "lambda": 1},
        accuracy={"tolerance": 1e-8},
    ),
    "an integral": problem(
        {"A": "17/10", "C": 1},
        {"type": "general", "F": "exp(-w)", "G": "3/10*g2 - 3*(3/5 - g2^2)"},
        motion={"type": "planar", "lambda": "11/10"},
    ),
    "collision": problem(
        DOUBLE,
        {"type": "rational", "a": [-1], "b": ["-1/20"], "c": ["-1/2"]},
        motion=NU_1,
    )
    | {"time": {"times": [0, "1/2", 1]}},
    "certified": problem(
        DOUBLE,
        expression("-g1 + 1/50/g3^2 + 6/5*(g1^2-g2^2)"),
        motion=NU_1,
        accuracy={"tier": "certified", "bits": 128},
    ),
    "any state": problem(
        DOUBLE,
        {"type": "gravity", "a": 1, "c": "-1/2"},
        motion={"type": "state", "omega": ["2/5", "1/10", "9/10"], "gamma": ["3/5", 0, "4/5"]},
    )
    | {"time": {"times": [0, 1, 5]}},
}
