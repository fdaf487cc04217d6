"""The whole catalogue, and further members of every family: what the suite runs over."""

from dataclasses import dataclass

from service.catalogue import cases, families


@dataclass(frozen=True)
class Specimen:
    name: str
    document: dict
    energy: str | None = None
    """h in ``lambda`` and the signs ``s1``, ``s3`` of g1 and g3: of an expression, whose family has none."""

    def __str__(self) -> str:
        return self.name


def specimen(name: str, A, C, potential: dict, *, energy: str | None = None, lambda_="9/10") -> Specimen:
    document = {
        "body": {"A": A, "C": C},
        "potential": potential,
        "motion": {"type": "planar", "lambda": lambda_},
        "time": {"stop": 1, "samples": 3},
    }
    return Specimen(name, document, energy)


# a1 = -1, b1 = 1/50, c1 = 6/5 of the printed h = -a1 nu/2 - 2 b1/nu² - c1, nu = s1 λ².
_ELLIPTIC_ENERGY = "s1*lambda^2/2 - 1/(25*lambda^4) - 6/5"

CATALOGUE = [
    *(
        Specimen(f"family-{item.type}", item.example, _ELLIPTIC_ENERGY if item.type == "expression" else None)
        for item in families()
    ),
    *(Specimen(f"case-{case.name}", case.example) for case in cases()),
]


def homogeneous(**lists: list) -> dict:
    return {"type": "homogeneous", **lists}


def general(**formulas: object) -> dict:
    return {"type": "general", **formulas}


SPECIMENS = [
    *CATALOGUE,
    specimen(
        "expression-any-moments",
        7,
        3,
        {
            "type": "expression",
            "expression": "(A*g1^2 + C*g3^2)*(exp(g2) - k*sin(g2)) - k*abs(g1)^(2*(A-C)/A) + 1",
            "parameters": {"k": "1/3"},
        },
        energy="lambda^2/7 + 1",
    ),
    specimen("gravity-third-axis", 1, 2, {"type": "gravity", "c": "-3/2"}),
    specimen(
        "rational-fourth", 3, "3/2", {"type": "rational", "a": [0, 0, 1, "1/7"], "b": [0, "1/3", 0, -1, 2]}
    ),
    specimen(
        "rational-conditional", "1/2", "1/4", {"type": "rational", "a": [1], "c": ["-1/3", 2, 0, "1/5"]}
    ),
    specimen(
        "homogeneous-above-one",
        17,
        10,
        homogeneous(A=["1/2", -1, 2], B=[1, "-1/2", "1/3", 2], C=["1/5", "1/7", -1]),
    ),
    specimen("homogeneous-below-one", 3, 5, homogeneous(A=[1], B=["1/5", 0, "1/9"], C=[-1, "1/2", "1/3", 4])),
    specimen("homogeneous-far-from-one", "61/10", "1", homogeneous(B=[-1, 1], C=["1/100"])),
    specimen("homogeneous-close-to-one", "101/100", 1, homogeneous(B=[1, -2, 1], C=[1, "1/2"])),
    specimen(
        "homogeneous-double", 2, 1, homogeneous(B=[-1, 0, "1/20"], C=[0, "1/50"], log=[0, "1/3", 0, -1])
    ),
    specimen("homogeneous-half", 3, 6, homogeneous(A=[0, 1], B=["1/9"], C=[-2], log=[0, "1/4", 0, "1/30"])),
    specimen("homogeneous-five-halves", 5, 2, homogeneous(B=[1], log=[0, 0, 0, 0, "-1/40"])),
    specimen("homogeneous-third", 1, 3, homogeneous(C=[0, 1], log=[0, 0, "1/8"])),
    specimen("homogeneous-trivial", 4, 3, homogeneous(B=[1, 0, 0, "-1/2"], log=[0, 0, 0, "1/5"])),
    specimen("general-power", 3, 1, general(F="-k*w^(2/3)", G="g2", parameters={"k": "2/5"})),
    specimen("general-below-one", 3, 5, general(F="exp(-w)", G="3*sin(g2) - C", reference_angle="1/2")),
    specimen(
        "general-quadrants",
        2,
        1,
        general(
            F_pp="w",
            F_mp="sqrt(w)",
            F_pm="w/(1+w)",
            F_mm="1/w",
            G_pp="g2",
            G_mp="1",
            G_pm="0",
            G_mm="-g2^3",
            reference_angle="pi/3",
        ),
    ),
]
