"""Energies of the light, and standard deviations of frames: against arrays given directly."""

from dataclasses import replace

import numpy as np
import pytest
from made_scans import raw_counts, record, scan

from jaxtat.io import Scan
from jaxtat.scans import choose, reconstruct, standard_deviations
from jaxtat.scans.frames import integrals, lit_frames, setup_of

# as in test_scan_images.py
GIVEN = {"region_radius": 0.011, "pixels": 45, "max_frequency": 3500.0, "band": (2e4, 1.5e6)}
GIVEN |= {"inversion": "fourier", "alpha": 1e-2, "dead_time": 4e-6}
ENERGIES = np.array([40.0, 80.0])


@pytest.fixture(scope="module")
def frames():
    pressure = record()
    return np.stack([raw_counts(pressure, 0.02), raw_counts(pressure, 0.02, seed=1)])


@pytest.fixture(scope="module")
def lit(frames):
    """Of two pulses, and what was chosen for it."""
    made = scan(frames, laser_energy=ENERGIES)
    return made, choose(made, **GIVEN)


def test_images_are_per_energy_with_one_set_of_choices(frames, lit):
    made, chosen = lit
    assert ("laser_energy", "divided out") in [row[:2] for row in chosen.rows()]
    plain = scan(frames)
    chosen_plain = choose(plain, **GIVEN)
    assert not chosen_plain.laser_energy
    assert "laser_energy" not in dict(chosen_plain.reasons)
    without = {"reasons": (), "grades": ()}
    assert replace(chosen, laser_energy=False, **without) == replace(chosen_plain, **without)
    found, counts = reconstruct(made, chosen).image, reconstruct(plain, chosen_plain).image
    size = abs(counts).max()
    np.testing.assert_allclose(found * ENERGIES[:, None, None], counts, rtol=0, atol=1e-9 * size)
    kept = choose(made, laser_energy=False, **GIVEN)
    assert np.array_equal(lit_frames(made, kept, 0, 2), frames)


def test_energies_that_are_not_there_cannot_be_divided_out(frames):
    with pytest.raises(ValueError, match="the file has no energies of its pulses"):
        choose(scan(frames), laser_energy=True)
    with pytest.raises(ValueError, match="laser energy is 0, expected a value above zero"):
        scan(frames, laser_energy=[0.0, 1.0])


@pytest.mark.parametrize(("drift", "most"), [(0.0, 1.1), (1.0, 1.25)])
def test_standard_deviations_are_those_of_repeated_scans(drift, most):
    """Many records of the same object with new noise: their images spread as was said.

    Where offsets drift, each record otherwise, by as much as the sound, slow noise is guessed from
    what is faster, and a little too much is said.
    """
    pressure = record()
    counts = np.stack([raw_counts(pressure, 0.02, seed, drift) for seed in range(34)])
    made = scan(counts[:2], laser_energy=ENERGIES)
    chosen = choose(made, **GIVEN)
    said = standard_deviations(made, chosen)
    np.testing.assert_allclose(said[0], 2 * said[1], rtol=0.2)  # half the light, twice the noise
    repeated = replace(chosen, laser_energy=False)
    images = reconstruct(scan(counts[2:]), repeated).image / ENERGIES[0]
    inside = np.asarray(chosen.region.contains(chosen.grid.points))
    ratio = (said[0] / images.std(axis=0, ddof=1))[inside]
    # both are known from 32 images: each pixel to a sixth, their mean much better
    assert 0.9 < np.sqrt(np.mean(ratio**2)) < most
    if drift == 0:
        assert np.quantile(ratio, [0.02, 0.98]) == pytest.approx([1, 1], abs=0.6)


def test_where_noise_cannot_be_told_nothing_is_said(frames, lit):
    made, chosen = lit
    assert standard_deviations(made, replace(chosen, model_based=True)) is None
    setup = setup_of(made, chosen)
    g = integrals(made, chosen, setup, frames)
    known = {"detectors": np.asarray(setup.curve.points), "radii": np.asarray(setup.radii)}
    of_circles = Scan("circular_integrals", np.asarray(g), known)
    assert standard_deviations(of_circles, choose(of_circles, region_radius=0.011)) is None
