"""Draws the pictures of docs/theorem.md from the formulas of that page alone.

Run it from the top folder of the repository: ``.venv/bin/python docs/figures/theorem.py``.
"""

import matplotlib.pyplot as plt
import numpy as np
from motions import path_on_sphere, save, use_files

A, C = 2.0, 1.0
a, b = -1.0, 0.05


def main() -> None:
    """Write the three pictures."""
    use_files()
    _curves()
    _windows()
    _energies()


def curve(level: float, n: int = 801) -> np.ndarray:
    """Return points (n, 3) of |g3| = level |g1|^(C/A) with g1, g3 > 0, from pole to pole."""
    low, high = 0.0, 1.0
    for _ in range(80):  # the equator, where g1² + g3² = 1
        middle = (low + high) / 2
        low, high = (low, middle) if middle**2 + (level * middle ** (C / A)) ** 2 > 1 else (middle, high)
    # Squared sines: places near the equator, where g2 turns, and near the poles are not far apart.
    upper = low * np.sin(np.linspace(0, np.pi / 2, n // 2 + 1)) ** 2
    g1 = np.concatenate([upper, upper[-2::-1]])
    g3 = level * g1 ** (C / A)
    g2 = np.sqrt(np.maximum(0.0, 1 - g1**2 - g3**2))
    g2[n // 2 + 1 :] *= -1
    return np.stack([g1, g2, g3], axis=1)


def squared_p(points: np.ndarray) -> np.ndarray:
    """Return p² = C g3 D / ((A - C) A g1), D = g1 V3 - g3 V1, of V = a g1 + b / g3²."""
    g1, _, g3 = points.T
    with np.errstate(divide="ignore", invalid="ignore"):
        found: np.ndarray = C * g3 * (g1 * (-2 * b / g3**3) - g3 * a) / ((A - C) * A * g1)
    return found


def _curves() -> None:
    figure = plt.figure(figsize=(5.2, 4.6), layout="constrained")
    axes = figure.add_subplot(projection="3d")
    for level, colour in ((0.4, "tab:green"), (1.0, "tab:blue"), (2.5, "tab:orange")):
        points = curve(level)
        path_on_sphere(axes, points, color=colour, label=f"λ = {level:g}")
    axes.set(xlabel="γ₁", ylabel="γ₂", zlabel="γ₃", xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
    axes.legend(fontsize=8)
    save(figure, "theorem-curves")


def _windows() -> None:
    figure, axes = plt.subplots(figsize=(7, 3.2), layout="constrained")
    for level, colour in ((0.5, "tab:green"), (1.0, "tab:blue"), (1.6, "tab:orange")):
        points = curve(level)
        p2 = squared_p(points)
        axes.plot(points[:, 1], p2, color=colour, label=f"λ = {level:g}")
        axes.fill_between(points[:, 1], 0, p2, where=p2 > 0, color=colour, alpha=0.15)
    axes.axhline(0, color="grey", linewidth=0.8)
    axes.set(xlabel="γ₂ along the curve", ylabel="p²", ylim=(-0.4, 1.5))
    axes.legend(fontsize=8)
    save(figure, "theorem-windows")


def _energies() -> None:
    """H = V + Q D / (2 (A - C) g1 g3) along the curves: constant where V is admissible."""
    figure, plots = plt.subplots(1, 2, figsize=(8, 3), layout="constrained", sharey=True)
    for axes, tilt in zip(plots, (0.0, 0.1), strict=True):
        for level, colour in ((0.7, "tab:green"), (1.0, "tab:blue"), (1.4, "tab:orange")):
            g1, g2, g3 = curve(level)[20:-20].T
            v1, v3 = a, -2 * b / g3**3
            potential = a * g1 + b / g3**2 + tilt * g2
            energy = potential + (A * g1**2 + C * g3**2) * (g1 * v3 - g3 * v1) / (2 * (A - C) * g1 * g3)
            axes.plot(g2, energy, color=colour, label=f"λ = {level:g}")
        axes.set(xlabel="γ₂ along the curve", title="V" if not tilt else "V + γ₂/10")
    plots[0].set_ylabel("H[V]")
    plots[0].legend(fontsize=8)
    save(figure, "theorem-energies")


if __name__ == "__main__":
    main()
