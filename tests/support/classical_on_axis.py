"""Classical particular solutions with the centre on axis 1: q² = Q(p), r² = R(p), with A = 1.

The rest follows from the equations of motion: with β = B - C

    a g1 = h - (p² + B Q + C R)/2,   a g2 = q ((1-B) p - (C β/2) R'(p)),   a g3 = r ((1-C) p + (B β/2) Q'(p)).
"""

from collections.abc import Callable
from fractions import Fraction

import numpy as np
from numpy.polynomial import Polynomial

from tests.support.classical import ClassicalMotion, FloatArray, Residuals, motion

Branch = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""p to a function of it and its derivative with respect to p."""


def axis_one(B: str, C: str, h: float, scale: float, Q: Branch, R: Branch) -> Residuals:
    """Return the residuals of q² = Q(p), r² = R(p) and of the three for γ.

    Q, R and the energy h are those of a centre a0 such that ω → ``scale`` ω makes it 1.
    """
    moment_B, moment_C = float(Fraction(B)), float(Fraction(C))
    beta = moment_B - moment_C

    def residuals(samples: FloatArray) -> FloatArray:
        p, q, r = samples[:, :3].T / scale
        g1, g2, g3 = samples[:, 3:].T / scale**2
        (Q_p, slope_Q), (R_p, slope_R) = Q(p), R(p)
        found = [
            q**2 - Q_p,
            r**2 - R_p,
            g1 - (h - (p**2 + moment_B * Q_p + moment_C * R_p) / 2),
            g2 - q * ((1 - moment_B) * p - moment_C * beta / 2 * slope_R),
            g3 - r * ((1 - moment_C) * p + moment_B * beta / 2 * slope_Q),
        ]
        return np.array(found) * scale**2

    return residuals


def in_p(*coefficients: float) -> Branch:
    """A polynomial in p, from the constant up."""
    polynomial = Polynomial(coefficients)
    return lambda p: (polynomial(p), polynomial.deriv()(p))


def in_s(p0: float, *coefficients: float) -> Branch:
    """A polynomial in s = -sqrt(p - p0), from the constant up."""
    polynomial = Polynomial(coefficients)

    def branch(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        s = -np.sqrt(p - p0)
        return polynomial(s), polynomial.deriv()(s) / (2 * s)

    return branch


def in_x(k: float, *coefficients: float) -> Branch:
    """A polynomial in x² divided by x², from the constant up, where p = x - k/x and x > 0."""
    polynomial = Polynomial(coefficients)

    def branch(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        x = (p + np.sqrt(p**2 + 4 * k)) / 2
        slope = 2 * x * (polynomial.deriv()(x**2) - polynomial(x**2) / x**2) / x**2
        return polynomial(x**2) / x**2, slope / (1 + k / x**2)

    return branch


GORIACHEV = motion(
    "Goriachev 1899",
    "1 61/100 671/475",
    "1 0 0",
    "1.0034172039966195287 2.0726214680448652137 1.7888846179921081154",
    "0.61250680616724906781 0.58231713075450531735 -0.53454856807275832118",
    axis_one(
        "61/100",
        "671/475",
        1483524 / 7968125,
        5.0170860199830976436,
        in_p(1989792 / 11256025, 0, -2912 / 40931, 0, -7600 / 3721),
        in_p(134064 / 1023275, 0, -361 / 3721),
    ),
    "4.6864235055724417",
    0,
    4.821493368440772,
)

# Q = (C-1) p²/(β (2B-1)) + 2 h (2C-1)/(β D), R = -(B-1) p²/(β (2C-1)) - 2 h (2B-1)/(β D),
# D = 2BC - 2B - 2C + 1, h = |D|/(2 |(B-1)(C-1)|). With D = -31/25, h = 31/6, β = 4/5:
STEKLOV = motion(
    "Steklov 1899",
    "1 6/5 2/5",
    "1 0 0",
    "1.3944336145780360048 1.0206205526778414916 4.1247896570812906928",
    "0.16666638337207142857 -0.85391256382991718928 0.49300674436268244055",
    axis_one("6/5", "2/5", 31 / 6, 1.0, in_p(25 / 12, 0, -15 / 28), in_p(175 / 12, 0, 5 / 4)),
    "31/6",
    0,
    2.611553220020971,
)
# And with A the largest moment: D = -22/25, h = 22/3, β = 1/2; started at p = 2, q, r > 0.
STEKLOV_LARGEST_A = motion(
    "Steklov 1899, A > B",
    "1 9/10 2/5",
    "1 0 0",
    "2 0.816496580927726032732 4.760952285695233332",
    "1/2 0.48989794855663561964 -0.7141428428542849998",
    axis_one("9/10", "2/5", 22 / 3, 1.0, in_p(20 / 3, 0, -3 / 2), in_p(80 / 3, 0, -1)),
    "22/3",
    0,
)

KOWALEWSKI = motion(
    "N. Kowalewski 1908",
    "1 5/8 9/8",
    "1 0 0",
    "-0.1259890284747144487 1.9444879789567831922 1.4806240813663596853",
    "-0.089315567716853191178 0.71194059370640569789 0.69653666120053349251",
    axis_one(
        "5/8",
        "9/8",
        49 / 1600,
        8.7287156094396952506,
        in_p(28 / 625, -42 / 125, -4 / 25, -16 / 5),
        in_p(7 / 225, 7 / 45, -4 / 9),
    ),
    "7/3",
    "2.0367003088692622",
    9.537016653695952,
)

KONOSEVICH_1 = motion(
    "Konosevich and Pozdnyakovich 1968, I",
    "1 0.41190456653168838819 0.70644312885674086139",
    "1 0 0",
    "1.834878170106322072 0.48505330284889045669 1.2762644530724949458",
    "0.78821531264409345144 0.15685445307806571101 0.5950741982836719297",
    axis_one(
        "0.41190456653168838819",
        "0.70644312885674086139",
        16.82779736774392767,
        0.42888921493362296922,
        in_s(
            2.639810097659594810239232,
            -5.095041804025096754,
            7.3839166880644209762,
            8.376681627086840709,
            -8.2425431736171282294,
            -5.6567462160679539695,
        ),
        in_s(
            2.639810097659594810239232,
            0,
            0,
            42.163649801214024967,
            22.528011636759130113,
            -4.835876667116014436,
        ),
    ),
    "3.0954053193897892",
    "2.014141719734588674",
    11.419721817760639,
)
KONOSEVICH_2 = motion(
    "Konosevich and Pozdnyakovich 1968, II",
    "1 0.70818636116882971134 0.41233512240077183892",
    "1 0 0",
    "1.6145675398966807386 1.6842222363970820552 0.39628782846967886843",
    "0.72700942068679444081 0.66332381368220987844 0.17736634527085587511",
    axis_one(
        "0.70818636116882971134",
        "0.41233512240077183892",
        0.038632737498968279735,
        8.9103539474969128771,
        in_s(
            0.1643012799278577849372197,
            0.057018173782156935441,
            0.28954481735546495535,
            1.6685907314869396811,
            4.7728638885372383188,
            -4.7706117483480426648,
        ),
        in_s(
            0.1643012799278577849372197,
            0,
            0,
            -0.028431503926488631513,
            -1.8503744118907891977,
            -5.6256999832072987741,
        ),
    ),
    "3.0672233026620350",
    "1.9939630534147483",
    17.030487665744968,
)

# 176 B³ - 272 B² - 9 B + 81 = 0; found by a search and proved, without a name of its own.
RATIONAL_IN_X = motion(
    "elliptic motion with p = x - k/x",
    "1 1.32009552842919944600 1.42900056737246388274",
    "1 0 0",
    "-0.26077975331554460754 0.29967051230494800541 0.22529498876998825034",
    "-0.88900990559350934226 -0.31766665220202610407 -0.32977156614143765571",
    axis_one(
        "1.32009552842919944600",
        "1.42900056737246388274",
        -0.056968746698902025,
        3.6512029815907178486,
        in_x(
            0.38790617852641506085,
            -0.361383938282560,
            -0.816607773362109,
            2.994708644635824,
            6.955793259148641,
        ),
        in_x(0.38790617852641506085, 0.238034031332856, 1.138430480115284, -5.269677869808978),
    ),
    "-0.759466496520015",
    0,
    6.4309110730287875,
)

ON_AXIS_ONE: tuple[ClassicalMotion, ...] = (
    GORIACHEV,
    STEKLOV,
    STEKLOV_LARGEST_A,
    KOWALEWSKI,
    KONOSEVICH_1,
    KONOSEVICH_2,
    RATIONAL_IN_X,
)
