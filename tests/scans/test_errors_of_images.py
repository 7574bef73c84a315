"""How far a scan's fitted image may be off, and what is said of it."""

import jax.numpy as jnp
import numpy as np
import pytest
from made_scans import SPEED, record, scan, truth

from jaxtat import ImageGrid
from jaxtat.fitting import NINETY, Comparison
from jaxtat.reporting.constrained import Constrained, errors_in_words, not_in_the_data
from jaxtat.scans import choose, image_errors, reconstruct, setup_of, standard_deviations
from jaxtat.scans.constrained import fitted
from jaxtat.scans.errors_of_images import ImageErrors, _heard, _means, fit_errors

pytestmark = pytest.mark.slow

GIVEN = {"region_radius": 0.011, "pixels": 45, "max_frequency": 3500.0, "band": (2e4, 1.5e6)}
GIVEN |= {"sound_speed": SPEED, "model_based": True, "nonnegative": True}


@pytest.fixture(scope="module")
def measured():
    noise = 0.03 * np.abs(record()).max() * np.random.default_rng(0).standard_normal((90, 230))
    return scan(record() + noise)


@pytest.fixture(scope="module")
def choices(measured):
    return choose(measured, **GIVEN)


def test_simulated_records_are_those_of_the_scanner(measured, choices):
    setup = setup_of(measured, choices)
    heard = _heard(measured, choices, setup, jnp.asarray(truth(setup.grid.points))[None])[0]
    wanted = record()
    assert np.linalg.norm(heard - wanted) < 0.05 * np.linalg.norm(wanted)


def test_nine_of_ten_errors_are_as_small_as_said(measured, choices):
    setup = setup_of(measured, choices)
    image = fitted(measured, choices, setup, measured.frame(0)).image
    found = fit_errors(measured, choices, measured.frame(0), image)
    fine = found.grid.finer(4)
    errors = np.asarray(found.image) - np.asarray(found.grid.means(truth(fine.points)))
    inside = np.isfinite(found.deviation)
    assert found.grid.shape == (22, 22) and 0.6 < inside.mean() < 0.8
    held = np.abs(errors)[inside] <= NINETY * np.asarray(found.deviation)[inside]
    assert held.mean() > 0.8


def test_means_are_those_of_a_plane_and_of_the_same_grid():
    fine, coarse = ImageGrid(41, 1.0, (0.3, 0.1)), ImageGrid(11, 0.7, (0.3, 0.1))

    def plane(grid):
        points = np.asarray(grid.points)
        return 2 * points[..., 0] - points[..., 1]

    assert np.allclose(_means(fine, jnp.asarray(plane(fine)), coarse), plane(coarse))


def test_what_is_not_in_the_record_is_said():
    numbers = tuple(np.float64(x) for x in (0.2, 0.1)), np.float64(0.3), np.float64(0.2)
    found = Constrained(None, "tv, f >= 0", Comparison(*numbers), "", "0.1 to 4 MHz")
    assert "level inside the body is not in the record (band from 0.1 to 4 MHz); edges are" in (
        not_in_the_data(found)
    )
    assert not_in_the_data(found._replace(band="")) == ""
    image, off = np.full((5, 5), 4.0), np.full((5, 5), 0.2)
    image[0] = off[0] = np.nan
    text = errors_in_words(ImageErrors(ImageGrid(5), image, off))
    assert "off by 0.2 in the median (5.0% of its largest value)" in text


def test_errors_of_the_formula_are_those_of_noise(measured):
    direct = choose(measured, **GIVEN | {"model_based": False, "nonnegative": None, "alpha": 1e-2})
    image = reconstruct(measured, direct).image
    found = image_errors(measured, direct, 0, image)
    outside = ~np.asarray(direct.region.contains(direct.grid.points))
    assert np.isnan(found.deviation[outside]).all()
    with pytest.raises(ValueError, match=r"image has shape \(44, 45\), expected .* \(45, 45\)"):
        image_errors(measured, direct, 0, image[1:])
    wanted = standard_deviations(measured, direct)[0]
    assert np.array_equal(np.asarray(found.deviation)[~outside], wanted[~outside])
