"""Derives the constants of the C solver (tables.h); with --check it compares instead of writing."""

import sys
from pathlib import Path

import numpy as np
from numpy.polynomial import chebyshev

TABLES = Path(__file__).with_name("tables.h")
GAMMA_DEGREE = 18
ARC_POINTS = 16
PIECE_POINTS = 8
PRECISE_ARC_POINTS = 64


def arc_rule(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights (points,) on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(points)
    return (x + 1) / 2, w / 2


def chord_over_length(c: float) -> float:
    """Chord of the symmetric cubic Hermite segment of arc length 1 whose unit end tangents have cosine c.

    In the coordinates along the bisector and along t0 - t1, with v in [-1, 1] and even in it, the
    derivative is (m (1 + v^2) / 4 + (3 chord - m) (1 - v^2) / 2, D v / 2), m = |t0 + t1|, D = |t0 -
    t1|.
    """
    v, w = arc_rule(PRECISE_ARC_POINTS)
    m, difference = np.sqrt(2 + 2 * c), np.sqrt(2 - 2 * c)
    chord = 1.0
    for _ in range(20):
        along = m / 4 * (1 + v * v) + (3 * chord - m) / 2 * (1 - v * v)
        speed = np.hypot(along, difference / 2 * v)
        chord -= (w @ speed - 1) / (w @ (along / speed * 1.5 * (1 - v * v)))
    return float(chord)


def gamma_coefficients() -> np.ndarray:
    """Power coefficients (GAMMA_DEGREE + 1,), lowest first, of gamma in y = 1 - 2c, for c in [0, 1]."""
    y = np.cos(np.pi * (np.arange(GAMMA_DEGREE + 1) + 0.5) / (GAMMA_DEGREE + 1))
    c = (1 - y) / 2
    gamma = [chord_over_length(ci) / np.sqrt(2 + 2 * ci) for ci in c]
    return chebyshev.cheb2poly(chebyshev.chebfit(y, gamma, GAMMA_DEGREE))


def rows(values: np.ndarray) -> str:
    return "".join(f"    {value!r},\n" for value in values.tolist())


def table(name: str, size: str, values: np.ndarray) -> str:
    return f"static const double {name}[{size}] = {{\n{rows(values)}}};\n"


def tables() -> str:
    nodes, weights = arc_rule(ARC_POINTS)
    piece_nodes, piece_weights = arc_rule(PIECE_POINTS)
    return (
        "/* Constants of the solver, written by generate_tables.py: do not edit. */\n"
        "#ifndef TABLES_H\n#define TABLES_H\n\n/* clang-format off */\n"
        f"#define GAMMA_TERMS {GAMMA_DEGREE + 1}\n"
        f"#define ARC_POINTS {ARC_POINTS}\n"
        f"#define PIECE_POINTS {PIECE_POINTS}\n\n"
        "/* gamma(c) for c in [0, 1], powers of 1 - 2c, lowest first. */\n"
        + table("gamma_power", "GAMMA_TERMS", gamma_coefficients())
        + "\n/* Gauss-Legendre rule on [0, 1] for the length of a symmetric cubic segment. */\n"
        + table("arc_node", "ARC_POINTS", nodes)
        + table("arc_weight", "ARC_POINTS", weights)
        + "\n/* Gauss-Legendre rule on [0, 1] for the integral of a tangent over a piece of a spline. */\n"
        + table("piece_node", "PIECE_POINTS", piece_nodes)
        + table("piece_weight", "PIECE_POINTS", piece_weights)
        + "\n#endif\n"
    )


def numbers(text: str) -> np.ndarray:
    return np.array([float(line.strip(" ,")) for line in text.splitlines() if line.startswith("    ")])


def main(arguments: list[str]) -> int:
    derived = tables()
    if arguments == ["--check"]:
        # Another NumPy may round the last bits of the fit differently; the function is the same to 1e-14.
        written = numbers(TABLES.read_text())
        expected = numbers(derived)
        if written.shape != expected.shape or not np.allclose(written, expected, rtol=0, atol=1e-13):
            print(f"{TABLES} is not what generate_tables.py derives: run it without --check")
            return 1
        return 0
    TABLES.write_text(derived)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
