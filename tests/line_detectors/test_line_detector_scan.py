"""Angles of a scan: half a turn, a whole one, or an error that says what is wrong."""

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxtat.line_detectors import LineDetectorScan


@settings(deadline=None, max_examples=20)
@given(st.integers(3, 500), st.floats(-10, 10), st.booleans())
def test_equispaced_angles_are_half_a_turn_or_a_whole_one(n, first, whole):
    n = 2 * n if whole else n
    scan = LineDetectorScan(first + np.arange(n) * ((2 if whole else 1) * np.pi / n))
    assert scan.whole_turn is whole
    assert scan.n_rotations == n


@pytest.mark.parametrize(
    ("angles", "message"),
    [
        ([0.0], "got 1 angles, expected at least 2"),
        ([[0.0, 1.0]], "angles has shape"),
        ([0.0, np.nan], "NaN"),
        (np.arange(180.0), r"180 angles run from 0 to 179 rad .* give radians"),
        (np.linspace(0, np.pi, 180), "leave out repeated angles"),
        (-np.arange(180) * np.pi / 180, "reverse a scan"),
        (np.arange(99) * 2 * np.pi / 99, "got 99 angles over a whole turn, expected an even"),
        (np.pi / 10 * (np.arange(10) + 0.1 * (np.arange(10) == 4)), "interpolate the data"),
    ],
)
def test_other_angles_are_refused(angles, message):
    with pytest.raises(ValueError, match=message):
        LineDetectorScan(angles)


def test_traced_angles_are_refused_with_the_remedy():
    with pytest.raises(ValueError, match="make the scan outside"):
        jax.eval_shape(LineDetectorScan, jax.ShapeDtypeStruct((4,), float))
