"""alpha of a scan by what no image explains: beside the best of all, and where it is left alone."""

from dataclasses import replace

import numpy as np
import pytest
from made_scans import BELLS, RATE, SPEED, TIMES, positions, raw_counts, record, scan, truth

from jaxtat import detector_curve, phantoms
from jaxtat.io import Scan
from jaxtat.records import circular_integrals_to_pressure
from jaxtat.scans import choose, reconstruct
from jaxtat.scans.noise import estimate_alpha

GIVEN = {"region_radius": 0.011, "pixels": 33, "inversion": "fourier", "max_frequency": 3500.0}
GIVEN |= {"sound_speed": SPEED}  # which need not be searched for
ALPHAS = 10.0 ** np.arange(-6.0, 0.0)


def error(of, choices):
    found = reconstruct(of, choices)
    exact = truth(found.grid.points)
    inside = np.asarray(found.region.contains(found.grid.points))
    return np.linalg.norm((found.image - exact)[inside]) / np.linalg.norm(exact[inside])


def two_dimensional():
    """Waves of the same bells in the plane, with a tail."""
    bells = phantoms.Bells(BELLS["centers"], BELLS["radii"], [1.0, 0.7, 0.5])
    radii = SPEED / RATE * np.arange(1, len(TIMES) + 1)
    g = bells.circular_integrals(detector_curve(positions()[:, :2]), radii)
    return np.asarray(circular_integrals_to_pressure(g, radii, SPEED * TIMES))


def noisy(pressure, noise, seed=0):
    rng = np.random.default_rng(seed)
    return pressure + noise * np.abs(pressure).max() * rng.standard_normal(pressure.shape)


@pytest.mark.parametrize("noise", [0.001, 0.03, 0.2])
def test_no_other_alpha_gives_a_much_better_image(noise):
    of = scan(noisy(two_dimensional(), noise))
    chosen = choose(of, model="2d", **GIVEN)
    best = min(error(of, replace(chosen, alpha=alpha)) for alpha in ALPHAS)
    assert error(of, chosen) < 1.1 * best
    assert chosen.grade("alpha") == "likely"
    assert chosen.low_pass == "none"


def test_what_is_no_noise_of_the_elements_counts_too():
    """Sound from far outside the region: the quiet part is as quiet as before."""
    pressure = two_dimensional()
    other = np.roll(np.random.default_rng(0).permutation(pressure), 20, axis=1)
    other[:, TIMES < 27e-6] = 0.0
    found = [
        choose(of, model="2d", **GIVEN).alpha
        for of in (scan(noisy(pressure, 0.003)), scan(noisy(pressure + 0.3 * other, 0.003)))
    ]
    assert found[1] > 10 * found[0]


def test_a_filter_that_is_given_stays():
    of = scan(noisy(two_dimensional(), 0.03))
    chosen = choose(of, model="2d", low_pass="cosine", **GIVEN)
    assert chosen.low_pass == "cosine"
    assert dict(chosen.reasons)["alpha"].startswith("by cross-validation")


def test_it_is_left_alone_elsewhere():
    of = scan(raw_counts(record(), 0.03))
    fitted = {"penalty": "tv", "inversion": None, "model": "2d"}
    for given in ({"model": "in-plane"}, {"model": "2d", "alpha": 1e-2}, fitted):
        chosen = choose(of, **GIVEN | given)
        assert estimate_alpha(of, chosen) is chosen
    of_waves = choose(of, **GIVEN | {"model": "2d"})
    body = {"water_speed": 1480.0, "body_radius": 0.01, "body_center": (0.0, 0.0)}
    through = replace(of_waves, **body)  # a body of another speed
    assert estimate_alpha(of, through) is through
    curve, radii = detector_curve(positions()[:, :2]), np.linspace(0.02, 0.06, 60)
    g = np.asarray(phantoms.Bells([[0.0, 0.0]], [4e-3]).circular_integrals(curve, radii))
    integrals = Scan("circular_integrals", g, {"detectors": positions(), "radii": radii})
    chosen = choose(integrals, region_radius=0.011)
    assert estimate_alpha(integrals, chosen) is chosen
