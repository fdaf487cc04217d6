"""Classical particular solutions with their own relations: the centre off the axes, or p^(2/3)."""

import numpy as np
from numpy.typing import NDArray

from tests.support.classical import ClassicalMotion, motion

FloatArray = NDArray[np.float64]


def hess(samples: FloatArray) -> FloatArray:
    """A = 3, B = 2, C = 3/2, centre (1, 0, 1): no momentum along it, and the elliptic rate of x = |M|².

    x' = 2 M·(γ×c) and x'² = 4 (x (c² - u²) - c² l²), u = h - x/(2B), where c·γ = u.
    """
    momentum = samples[:, :3] * [3.0, 2.0, 1.5]
    gamma, centre = samples[:, 3:], np.array([1.0, 0.0, 1.0])
    x = (momentum**2).sum(axis=1)
    rate = 2 * (momentum * np.cross(gamma, centre)).sum(axis=1)
    u = 2.135 - x / 4
    return np.array([momentum @ centre, rate**2 - 4 * (x * (2 - u**2) - 2 * 0.636**2), gamma @ centre - u])


HESS = motion(
    "Hess 1890",
    "3 2 3/2",
    "1 0 1",
    "0.3 0.7 -0.6",
    "0.6 0.48 0.64",
    hess,
    "2.135",
    "0.636",
)

STAUDE_GAMMA = "0.70014004201400490176 -0.70014004201400490176 -0.14002800840280098035"
STAUDE_OMEGA = "1.0247975717286840608 -1.0247975717286840608 -0.20495951434573681216"


def staude(samples: FloatArray) -> FloatArray:
    """ω = w γ, both at rest in the body."""
    return (samples - [float(x) for x in (*STAUDE_OMEGA.split(), *STAUDE_GAMMA.split())]).T


STAUDE = motion(
    "Staude 1894",
    "3 2 3/2",
    "1 1/2 1/4",
    STAUDE_OMEGA,
    STAUDE_GAMMA,
    staude,
    # h = w² (A g1² + B g2² + C g3²)/2 + c·γ, I3 = w (A g1² + B g2² + C g3²).
    2.1424285285628549994 * (5 + 1.5 * 0.04) / 2.04 / 2 + (1 - 0.5 - 0.05) / np.sqrt(2.04),
    np.sqrt(2.1424285285628549994) * (5 + 1.5 * 0.04) / 2.04,
)


def bobylev(energy: float, p0: float = 0.4):
    """A = 2, C = 1, centre (1, 0, 0): q = 0, p = p0, a g3 = C p0 r, a g1 = h - C p0² - C r²/2."""

    def residuals(samples: FloatArray) -> FloatArray:
        p, q, r, g1, _, g3 = samples.T
        return np.array([q, p - p0, g3 - p0 * r, g1 - (energy - p0**2 - r**2 / 2)])

    return residuals


BOBYLEV = motion(
    "Bobylev and Steklov 1896",
    "2 3/2 1",
    "1 0 0",
    "0.4 0 0.9",
    "-0.3 0.8834025130143110477 0.36",
    bobylev(0.265),
    "0.265",
    "0.084",
    7.340179054514055,
)
BOBYLEV_ZERO_AREAS = motion(
    "Bobylev and Steklov 1896, I3 = 0",
    "2 3/2 1",
    "1 0 0",
    "0.4 0 0.9",
    "-0.405 0.84046118292280459132 0.36",
    bobylev(0.16),
    "0.16",
    0,
    7.124331997472408,
)


def chaplygin(samples: FloatArray) -> FloatArray:
    """H = I3 = 0 and, with U = B β q², W = C β r², polynomial relations: p^(2/3) is rough at rest."""
    B, C = 31 / 20, 189 / 316
    p, q, r, g1, g2, g3 = samples.T
    beta = B - C
    alpha = (
        864 * B**5 * (5 * B - 3) ** 2 / ((2 * B - 3) * (2 * B - 1) * (4 * B - 3) ** 2 * (16 * B - 9) ** 3)
    ) ** (1 / 3)
    u, w = B * (C - 1) / (2 * B - 1), -C * (B - 1) / (2 * C - 1)
    w1 = 3 * alpha * (2 * B - 3) * (2 * B - 1) ** 2 * (16 * B - 9) / (8 * B**2 * (5 * B - 3))
    U, W = B * beta * q**2, C * beta * r**2
    s_squared = (U - u * p**2) / alpha
    return np.array(
        [
            w1 * U - alpha * W - (w1 * u - alpha * w) * p**2,
            (U - u * p**2) ** 3 - alpha**3 * p**2,
            g1 + (p**2 + B * q**2 + C * r**2) / 2,
            p * g2 - q * (-w1 / 3 * s_squared + (1 - B - w) * p**2),
            p * g3 - r * (alpha / 3 * s_squared + (1 - C + u) * p**2),
        ]
    )


CHAPLYGIN = motion(
    "Chaplygin 1904",
    "1 31/20 189/316",
    "1 0 0",
    "0.057495121920034371555 0.52529695233068344052 0.39292834394255990482",
    "-0.26167516253104694909 -0.25055085822800398498 0.93206779622276447937",
    chaplygin,
    0,
    0,
    9.09947106830838,
)


def grioli_state(times: FloatArray) -> FloatArray:
    """The regular precession of A = 3, B = 2, C = 3/2, centre (sqrt 2, 0, 1); shape (n, 6).

    ω = n (e + ν), γ = (n²/G)(J ν + D sin ψ e×ν - D cos ψ e), ν = cos ψ f1 + sin ψ f2, ψ = 1/2 - n t.
    """
    a, c, A, B, C = np.sqrt(2.0), 1.0, 3.0, 2.0, 1.5
    G = np.hypot(a, c)
    D, J = (A - C) * a * c / G**2, A + C - B
    n = (G**2 / (J**2 + D**2)) ** 0.25
    e, f1, f2 = np.array([a, 0, c]) / G, np.array([c, 0, -a]) / G, np.array([0.0, 1.0, 0.0])
    psi = (0.5 - n * np.asarray(times))[:, None]
    nu = np.cos(psi) * f1 + np.sin(psi) * f2
    gamma = n**2 / G * (J * nu + D * np.sin(psi) * np.cross(e, nu) - D * np.cos(psi) * e)
    return np.hstack([n * (e + nu), gamma])


def grioli(samples: FloatArray) -> FloatArray:
    """ω·e = n, |ω|² = 2 n², and the axis ν = ω/n - e makes a constant angle with the vertical."""
    G, n = np.sqrt(3.0), (3 / (6.25 + 0.5)) ** 0.25
    e = np.array([np.sqrt(2.0), 0.0, 1.0]) / G
    omega, gamma = samples[:, :3], samples[:, 3:]
    nu = omega / n - e
    return np.array(
        [omega @ e - n, (omega**2).sum(axis=1) - 2 * n**2, (nu * gamma).sum(axis=1) - n**2 * 2.5 / G]
    )


GRIOLI = motion(
    "Grioli 1947",
    "3 2 3/2",
    "1.4142135623730950488 0 1",
    "1.0803630537091637204 0.39144931307976527627 -0.11365052046921679448",
    "0.25641025876162892973 0.57583713662345220055 -0.77631525251478740935",
    grioli,
    "1.5",
    "1.4142135623730950488",
    2 * np.pi / 0.81649658092772603273,
)


def dokshevich(samples: FloatArray) -> FloatArray:
    """A = 3, B = 2, C = 3/2, centre e = (1, 0, 1)/√2: momentum x along e, y along (1, 0, -1)/√2, z.

    x (y - η x) = m, x² z² = z2 x⁴ + z0 x² + zm, and γ along the three directions.
    """
    root = np.sqrt(0.5)
    b1, at, ct = 0.5 * (1 / 3 - 2 / 3), 0.5 * (1 / 3 + 2 / 3), 0.5
    al, k = at / b1, ct / b1
    eta = (-(4 * al - 2 * k) + np.sqrt((4 * al - 2 * k) ** 2 - 12 * (al**2 - al * k - 1))) / 6
    m = -abs(1 / b1) * abs(al**2 + 4 * al * eta + 3 * eta**2 - 1) / (eta**2 + 1)
    hh = m * (eta * k**2 + k**3 - 8 * eta - 4 * al + 6 * k) / (k * (k**2 + 4))
    z2 = -((al + eta) ** 2) * (eta**2 + 1) / ((al + eta) ** 2 + 1)
    z0 = 2 * ((al - k + 2 * eta) * m - k * (k * eta * m + m - hh)) / k**2
    zm = -(m**2)
    p, q, r, g1, g2, g3 = samples.T
    x, y, z = root * (3 * p + 1.5 * r), root * (3 * p - 1.5 * r), 2 * q
    return np.array(
        [
            x * (y - eta * x) - m,
            x**2 * z**2 - (z2 * x**4 + z0 * x**2 + zm),
            g2 + b1 * z * x * (al - k + 2 * eta),
            root * (g1 + g3) + b1 * ((al * x**2 + k * y**2 + k * z**2) / 2 + x * y - hh),
            root * (g1 - g3) + b1 * (-(z2 * x**2 - zm / x**2) + (al - k) * x * y + y**2 - x**2),
        ]
    )


DOKSHEVICH = motion(
    "Dokshevich 1966",
    "3 2 3/2",
    "0.70710678118654752440 0 0.70710678118654752440",
    "0.67304880071045724665 0.38517814850276213465 0.24635287889241973634",
    "-0.33416737204232531521 0.93454345383924266795 -0.12231394175867870363",
    dokshevich,
    "0.550590511520996",
    0,
    7.404320634922648,
)

OBLIQUE: tuple[ClassicalMotion, ...] = (
    HESS,
    STAUDE,
    BOBYLEV,
    BOBYLEV_ZERO_AREAS,
    CHAPLYGIN,
    GRIOLI,
    DOKSHEVICH,
)
