"""Scanners against a file of one of them, and against the numbers in their sources."""

import numpy as np
import pytest

from jaxtat.base.scanners import SCANNERS, scanner_named
from jaxtat.geometry import fit_arc


@pytest.mark.parametrize("data_file", ["msot_scan9.npz"], indirect=True)
def test_the_preset_is_the_array_of_a_scan_of_that_scanner(data_file):
    scan, scanner = np.load(data_file), SCANNERS["msot-invision-256"]
    assert np.abs(scanner.positions - scan["geometry"]).max() < 1e-6  # [m]
    assert scanner.sampling_rate == scan["fs"]


@pytest.mark.parametrize(
    ("name", "pitch", "radius", "n", "width"),
    [
        ("msot-invision-256", 0.74e-3, 40e-3, 256, 0.64e-3),  # SIMPA rounds the radius
        ("msot-acuity-echo", 0.34e-3, 40e-3, 256, 0.24e-3),  # SIMPA
        ("quarter-ring-128", np.pi / 2 * 25e-3 / 128, 25e-3, 128, None),  # Gamelin et al. 2008
    ],
)
def test_pitch_radius_number_and_width_of_elements(name, pitch, radius, n, width):
    scanner = scanner_named(name)
    assert scanner.positions.shape == (n, 3)
    arc = fit_arc(scanner.positions[:, :2])
    assert np.isclose(arc.radius, radius, rtol=0.02)
    assert np.isclose(arc.step * arc.radius, pitch, rtol=0.02)
    assert np.isclose(np.degrees(arc.opening), -90.0)
    assert scanner.element_width == width
    assert len(scanner.source) > 40


def test_an_unknown_scanner_is_refused_with_those_that_are_known():
    with pytest.raises(ValueError, match="'ct', expected one of msot-invision-256, "):
        scanner_named("ct")
