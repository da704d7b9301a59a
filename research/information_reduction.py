"""Write the table of the information reduction factor.

    python -m research.information_reduction [FILE]

Definition, in whitened two-dimensional innovation coordinates: N clutter returns x_i, Poisson with density b =
rho sqrt(det S) in the disc of radius g; and the target's return, standard normal, received with probability Pd if it
lies in the disc.
With e(x) = exp(-|x|^2 / 2), a = 2 pi b (1 - Pd Pg) / Pd and Pg = 1 - exp(-g^2 / 2),
    nu = sum e(x_i) x_i / (a + sum e(x_i)),    q2 = E |nu|^2 / 2.
The integral: the likelihood ratio of returns with the target to returns of clutter alone is
Pd (a + sum e(x_i)) / (2 pi b), so with E_0 the mean over clutter alone
    q2 = Pd / (4 pi b) E_0[ |sum e(x_i) x_i|^2 / (a + sum e(x_i)) ]
       = Pd / (4 pi) int e(x)^2 |x|^2 E_0[ 1 / (a + e(x) + sum e(x_j)) ] dx:
the angles of the x_i are independent and uniform, so that only the squares remain, and Mecke's formula separates one
point from their sum. With 1/z = int exp(-z t) dt and the Laplace functional of the Poisson process,
    q2 = Pd int_0^inf exp(-a t - 2 pi b [Ein(t) - Ein(u t)]) W(t) dt,
    W(t) = 1/4 int_0^(g^2) s exp(-s - t exp(-s/2)) ds,    Ein(t) = int_0^t (1 - exp(-y)) / y dy,    u = exp(-g^2 / 2).
The table contains this integral. The script also prints a Monte Carlo simulation of nu, which uses only the definition.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from research.information_reduction_kernels import simulated_reduction
from wavegym.core.arrays import FloatArray
from wavegym.trackers.jpda import TABLE
from wavegym.trackers.jpda_kernels import GATE

PD = np.append(np.round(special.expit(np.linspace(-9.0, 7.0, 65)), 6), 1.0)  # as dense near 0 as near 1
CLUTTER = 10.0 ** np.linspace(-3.0, 5.0, 65)
STEP, LOWEST = 0.1, -60.0  # trapezoidal rule in log t: half the step or -80 agree to 1e-13
POINTS = 3e8  # clutter points in one simulation
SCENES = 1_000_000


def integrated_reduction(pd: ArrayLike, clutter: ArrayLike, gate: float = GATE) -> FloatArray:
    """q2 for Pd in (0, 1] and rho V > 0, V the volume of the gate, by the integral above; relative error 1e-12."""
    p, n = (np.asarray(a, np.float64)[..., None] for a in (pd, clutter))
    u, edge = np.exp(-0.5 * gate**2), gate**2
    t = np.exp(np.arange(LOWEST, np.log(50.0 / u), STEP))
    node, weight = special.roots_legendre(128)
    s = (node + 1.0) * edge / 2.0
    W = (weight * edge / 8.0 * s * np.exp(-s)) @ np.exp(-np.exp(-s / 2.0)[:, None] * t)
    density = 2.0 * n / edge  # 2 pi b
    a = density * (1.0 - p * (1.0 - u)) / p
    exponent = a * t + density * (_ein(t) - _ein(u * t))
    return np.asarray(p[..., 0] * STEP * np.sum(t * W * np.exp(-exponent), axis=-1))


def _ein(t: FloatArray) -> FloatArray:
    """The entire exponential integral Ein; a power series where E1(t) + log t + Euler's constant would cancel."""
    k = np.arange(1, 12)
    small = np.minimum(t, 0.1)[:, None]
    series = -np.sum((-small) ** k / (k * special.factorial(k)), axis=-1)
    large = np.maximum(t, 0.1)
    return np.asarray(np.where(t < 0.1, series, special.exp1(large) + np.log(large) + np.euler_gamma))


def write_table(path: Path) -> None:
    """Write the table as CSV: the first row holds the clutter rho V, the first column Pd."""
    q2 = integrated_reduction(PD[:, None], CLUTTER)
    lines = [",".join(["pd"] + [f"{n:.9g}" for n in CLUTTER])]
    lines += [",".join([f"{p:.6g}"] + [f"{value:.9g}" for value in row]) for p, row in zip(PD, q2, strict=True)]
    path.write_text("\n".join(lines) + "\n", "utf-8")


def main(arguments: list[str]) -> int:
    """Write the table and print the deviation of the simulation from it."""
    write_table(Path(arguments[0]) if arguments else TABLE)
    pd = np.array([0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 0.999])
    print("deviation of the simulated q2 from the table, in standard errors (standard error / q2, %)")
    print("rho V  " + "".join(f"{f'Pd = {p:g}':>15}" for p in pd))
    for key, clutter in enumerate(10.0 ** np.arange(-3.0, 6.0)):
        scenes = int(min(SCENES, POINTS / clutter))
        mean, error = simulated_reduction(np.uint64(key), scenes, clutter, GATE, pd)
        exact = integrated_reduction(pd, clutter)
        cells = [f"{z:7.2f} ({e:.2f})" for z, e in zip((mean - exact) / error, 100 * error / exact, strict=True)]
        print(f"{clutter:<7g}" + "".join(f"{cell:>15}" for cell in cells), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
