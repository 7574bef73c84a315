"""Derive the coefficients of jaxtat/special/_coefficients.py with mpmath.

    python scripts/derive_bessel_coefficients.py            write the file
    python scripts/derive_bessel_coefficients.py --check    recompute, and compare with the file

Below the switch point X = 5 the functions are, up to a zero or a logarithm, entire and even in x,
so polynomials in x^2 are fitted to (z_n is the first positive zero of J_n)

    J0(x) / (x^2 - z_0^2)                           J1(x) / (x (x^2 - z_1^2))
    Y0(x) - (2/pi) log(x/2) J0(x)                   (Y1(x) - (2/pi) (log(x/2) J1(x) - 1/x)) / x

in the variable u = 2 (x/X)^2 - 1. From X on the modulus and the phase are smooth,

    J_n + i Y_n = sqrt(2 / (pi x)) m_n(w) exp(i (x - (2n + 1) pi/4 + t_n(w) / x)),  w = (X/x)^2,

and m_n and t_n are fitted for 0 < w <= 1, in the variable u = 2 w - 1 (DLMF 10.18). Degrees are
the lowest that leave the truncation below TRUNCATION: 12 or 13 below X, 18 or 19 above. Each fit
interpolates at Chebyshev points, which is within a small factor of the best polynomial of its
degree, and is then written in powers of u: on [-1, 1] the loss by that change of basis stays near
one rounding because the Chebyshev coefficients fall much faster than the powers grow.

X = 5 lies between the first and the second zeros of both J0 (2.40, 5.52) and J1 (3.83, 7.02).
"""

import argparse
import difflib
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mpmath as mp

TARGET = Path(__file__).resolve().parents[1] / "jaxtat" / "special" / "_coefficients.py"
SWITCH_POINT = 5
DIGITS = 50
# What the terms beyond a degree may change in the function, relative to its amplitude
# sqrt(2 / (pi x)); a sixteenth of the rounding unit.
TRUNCATION = 2.0**-57

Number = Any  # of mpmath, whose operators have no types to rely on
Function = Callable[[Number], Number]


def chebyshev_coefficients(function: Function, degree: int) -> list[Number]:
    """c_0 .. c_degree with sum_j c_j T_j(u) equal to the function at degree + 1 points."""
    size = degree + 1
    angles = [mp.pi * (2 * k + 1) / (2 * size) for k in range(size)]
    values = [function(mp.cos(angle)) for angle in angles]
    sums = [mp.fdot(values, [mp.cos(j * angle) for angle in angles]) for j in range(size)]
    return [sums[0] / size] + [2 * s / size for s in sums[1:]]


def powers_from_chebyshev(coefficients: Sequence[Number]) -> list[Number]:
    """Coefficients of 1, u, u^2, ... by T_{j+1} = 2 u T_j - T_{j-1}."""
    size = len(coefficients)
    powers = [mp.mpf(0)] * size
    previous, current = [0, 1] + [0] * size, [1] + [0] * size  # T_{-1} = T_1 = u, and T_0
    for c in coefficients:
        powers = [p + c * t for p, t in zip(powers, current, strict=False)]
        following = [2 * t - s for t, s in zip([0, *current], previous, strict=False)]
        previous, current = current, following
    return powers


def fit(name: str, function: Function, weight: Number) -> tuple[float, ...]:
    """Coefficients in powers of u, of the lowest degree that keeps weight * error small enough."""
    trial = chebyshev_coefficients(function, 32)
    tails = [weight * mp.fsum(abs(c) for c in trial[degree + 1 :]) for degree in range(32)]
    degree = next(d for d, tail in enumerate(tails) if tail < TRUNCATION)
    print(f"{name}: degree {degree}, truncated at {mp.nstr(tails[degree], 2)} of the amplitude")
    return tuple(float(p) for p in powers_from_chebyshev(chebyshev_coefficients(function, degree)))


def leading_bits(value: Number, bits: int) -> Number:
    """``value`` cut to its first ``bits`` binary digits."""
    mantissa, exponent = mp.frexp(value)
    return mp.ldexp(mp.floor(mp.ldexp(mantissa, bits)), int(exponent) - bits)


def split(value: Number, bits: int, parts: int) -> tuple[float, ...]:
    """Summands of ``value``: all but the last of ``bits`` binary digits, the last rounded."""
    summands = []
    for _ in range(parts - 1):
        summands.append(leading_bits(value, bits))
        value = value - summands[-1]
    return tuple(float(s) for s in [*summands, value])


def below(u: Number) -> Number:
    """x for u = 2 (x/X)^2 - 1."""
    return SWITCH_POINT * mp.sqrt((1 + u) / 2)


def amplitude() -> Number:
    """sqrt(2 / (pi X)), the least that the functions below the switch point are compared with."""
    return mp.sqrt(2 / (mp.pi * SWITCH_POINT))


def above(u: Number) -> Number:
    """x for u = 2 (X/x)^2 - 1."""
    return SWITCH_POINT / mp.sqrt((1 + u) / 2)


def reduced_j(order: int) -> tuple[float, ...]:
    """J_n(x) / (x^n (x^2 - z^2)), z the first positive zero."""
    zero = mp.besseljzero(order, 1)

    def function(u: Number) -> Number:
        x = below(u)
        return mp.besselj(order, x) / (x**order * (x**2 - zero**2))

    factor = SWITCH_POINT**order * (SWITCH_POINT**2 - zero**2)
    return fit(f"reduced J{order}", function, factor / amplitude())


def regular_y(order: int) -> tuple[float, ...]:
    """The part of Y_n / x^n that is entire: the logarithm and, for n = 1, the pole taken off."""

    def function(u: Number) -> Number:
        x = below(u)
        singular = mp.log(x / 2) * mp.besselj(order, x) - (1 / x if order else 0)
        return (mp.bessely(order, x) - 2 / mp.pi * singular) / x**order

    return fit(f"regular Y{order}", function, SWITCH_POINT**order / amplitude())


def modulus(order: int) -> tuple[float, ...]:
    """sqrt(pi x / 2) |H_n(x)|."""

    def function(u: Number) -> Number:
        x = above(u)
        return mp.sqrt(mp.pi * x / 2) * abs(mp.hankel1(order, x))

    return fit(f"modulus of H{order}", function, mp.mpf(1))


def phase(order: int) -> tuple[float, ...]:
    """x times the phase of H_n(x) exp(-i (x - (2n + 1) pi/4)), which is less than pi."""

    def function(u: Number) -> Number:
        x = above(u)
        return x * mp.arg(mp.hankel1(order, x) * mp.expj((2 * order + 1) * mp.pi / 4 - x))

    return fit(f"phase of H{order}", function, 1 / mp.mpf(SWITCH_POINT))


def tables() -> list[tuple[str, str, object]]:
    """Comment, name and value of everything in the file."""
    zeros = [(leading_bits(z, 24), z) for z in (mp.besseljzero(0, 1), mp.besseljzero(1, 1))]
    return [
        (
            "Polynomials in x^2 below this argument, modulus and phase from it on.",
            "SWITCH_POINT",
            float(SWITCH_POINT),
        ),
        (
            "For the first positive zeros z of J0 and J1: 24 binary digits c of z, and z^2 - c^2.\n"
            "Then x^2 - z^2 = (x - c) (x + c) - (z^2 - c^2), and x - c is exact near the zero.",
            "ZERO",
            tuple((float(c), float(z**2 - c**2)) for c, z in zeros),
        ),
        (
            "J_n(x) / (x^n (x^2 - z^2)), powers of u = 2 (x/X)^2 - 1.",
            "REDUCED_J",
            (reduced_j(0), reduced_j(1)),
        ),
        (
            "(Y_n(x) - (2/pi) (log(x/2) J_n(x) - n/x)) / x^n, powers of the same u.",
            "REGULAR_Y",
            (regular_y(0), regular_y(1)),
        ),
        (
            "sqrt(pi x / 2) |H_n(x)|, powers of u = 2 (X/x)^2 - 1.",
            "MODULUS",
            (modulus(0), modulus(1)),
        ),
        (
            "x (arg H_n(x) - x + (2n + 1) pi/4), powers of the same u.",
            "PHASE",
            (phase(0), phase(1)),
        ),
        (
            "pi/4 as sums; an odd multiple m < 2^26 (2^13) of a summand but the last is exact.",
            "QUARTER_PI_FLOAT64",
            split(mp.pi / 4, 27, 3),
        ),
        ("", "QUARTER_PI_FLOAT32", split(mp.pi / 4, 11, 3)),
    ]


def written(value: object, indent: int = 0) -> str:
    """A number or a nested tuple as Python source, one number a line."""
    if not isinstance(value, tuple):
        return repr(value)
    inner = " " * (indent + 4)
    items = "".join(f"{inner}{written(item, indent + 4)},\n" for item in value)
    return f"(\n{items}{' ' * indent})"


def source() -> str:
    """The text of the file."""
    lines = [
        '"""Coefficients of the Bessel functions in bessel.py, which says how they are used.\n',
        "Written by scripts/derive_bessel_coefficients.py, which says what they are. Do not edit.",
        '"""\n',
    ]
    for comment, name, value in tables():
        lines += [f"# {line}" for line in comment.splitlines()]
        lines.append(f"{name} = {written(value)}\n")
    return "\n".join(lines)


def write_atomically(path: Path, text: str) -> None:
    """Replace the file in one step, so that no reader sees half of it."""
    with tempfile.NamedTemporaryFile("w", dir=path.parent, delete=False) as file:
        file.write(text)
    os.chmod(file.name, 0o644)
    os.replace(file.name, path)


def main() -> int:
    parser = argparse.ArgumentParser(description="Derive the Bessel coefficients.")
    parser.add_argument("--check", action="store_true", help="compare only; 1 if the file differs")
    arguments = parser.parse_args()
    with mp.workdps(DIGITS):
        text = source()
    if not arguments.check:
        write_atomically(TARGET, text)
        print(f"wrote {TARGET}")
        return 0
    stored = TARGET.read_text() if TARGET.exists() else ""
    difference = difflib.unified_diff(stored.splitlines(), text.splitlines(), "stored", "derived")
    report = "\n".join(difference)
    print(report or f"{TARGET.name} is what this script derives.")
    return 1 if report else 0


if __name__ == "__main__":
    sys.exit(main())
