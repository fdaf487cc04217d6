import mpmath as mp
import numpy as np
import pytest

from workers.solvers.closed_form import make_amplitude


def quotient(a, b, theta):
    """Return sn and cn at u = a θ / M(a, b), m = 1 − (b/a)², by mpmath."""
    m = 1 - mp.mpf(b) ** 2 / mp.mpf(a) ** 2
    u = mp.mpf(a) * mp.mpf(float(theta)) / mp.agm(a, b)
    return [mp.re(mp.ellipfun(kind, u, m=m)) for kind in ("sn", "cn")]


@pytest.mark.parametrize(
    ("a", "b"), [(1.0, 1.0), (1.0, 0.3), (1.0, 5.0), (1e-3, 1.0), (1.0, 1e-6), (1e-6, 1.0)]
)
def test_against_jacobian_functions(a, b):
    theta = np.linspace(-7.0, 7.0, 15)
    sine, cosine = make_amplitude(a, b).sine_cosine(np.sin(theta), np.cos(theta), 1.0)
    with mp.workdps(40):
        expected = np.array([[float(value) for value in quotient(a, b, t)] for t in theta])
    # θ itself is exact: what is left are the roundings of the steps of the mean.
    np.testing.assert_allclose(np.stack([sine, cosine], axis=1), expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize(("a", "b"), [(1.0, 0.3), (1e-6, 1.0), (1.0, 1e-6)])
def test_small_sines_and_cosines_keep_their_digits(a, b):
    small = np.array([1e-12, 1e-8, 1e-4])
    sine, _ = make_amplitude(a, b).sine_cosine(np.sin(small), np.cos(small), 1.0)
    _, cosine = make_amplitude(a, b).sine_cosine(np.cos(small), np.sin(small), 1.0)
    with mp.workdps(60):
        quarter = mp.pi / 2
        sines = np.array([float(quotient(a, b, t)[0]) for t in small])
        m = 1 - mp.mpf(b) ** 2 / mp.mpf(a) ** 2
        at = [mp.mpf(a) * (quarter - mp.mpf(float(t))) / mp.agm(a, b) for t in small]
        cosines = np.array([float(mp.re(mp.ellipfun("cn", u, m=m))) for u in at])
    # Relative: nothing cancels, and eight steps round a few times each.
    np.testing.assert_allclose(sine, sines, rtol=2e-15)
    np.testing.assert_allclose(cosine, cosines, rtol=2e-15)


def test_exact_zeros_stay():
    amplitude = make_amplitude(1.0, 3.0)
    sine, cosine = amplitude.sine_cosine(np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, -1.0]), 2.0)
    assert sine.tolist() == [0.0, 1.0, 0.0]
    assert cosine.tolist() == [1.0, 0.0, -1.0]
