"""The residual sinogram: what an exact image leaves, bad channels, sources outside, derivatives."""

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxtat import (
    ImageGrid,
    Setup,
    circular_arc,
    data_radii,
    disk,
    forward_operator,
    phantoms,
)
from jaxtat.studies import data_residual

GRID = ImageGrid(33)
CURVE, REGION = circular_arc(1.3, 1.0, 24), disk(0.7, n_boundary=200, center=(0.1, 0.0))
RADII = data_radii(CURVE, REGION, GRID.spacing[0], sources=disk(1.0))
SETUP = Setup(CURVE, REGION, GRID, RADII, max_frequency=12.0)
BELL = phantoms.Bells([[0.2, 0.1]], [0.5])
IMAGE, DATA = np.asarray(BELL.image(GRID)), np.asarray(BELL.circular_integrals(CURVE, RADII))


def residual(g, image=IMAGE):
    return data_residual(SETUP, g, image)


def test_an_exact_image_leaves_the_error_of_the_interpolation():
    found = residual(DATA)
    expected = DATA - np.asarray(forward_operator(SETUP)(IMAGE))
    assert_allclose(found.values, expected, atol=1e-12)
    assert 1e-4 < float(found.relative) < 5e-3
    assert_allclose(found.gains, 1, atol=1e-3)
    assert not found.unusual.size
    assert abs(float(found.outside)) < 1e-12


def test_circles_that_meet_a_disk():
    """Those whose radius differs from the distance of its centre by less than its own."""
    distance = np.linalg.norm(np.asarray(CURVE.points) - [0.1, 0.0], axis=1)
    off = np.abs(distance[:, None] - np.asarray(RADII)) - 0.7
    clear = np.abs(off) > 1e-3  # the boundary is sampled
    assert clear.mean() > 0.98
    assert (np.asarray(residual(DATA).meets) == (off < 0))[clear].all()


def test_relative_norms_are_what_they_say():
    noise = 0.05 * np.random.default_rng(0).standard_normal(DATA.shape)
    found = residual(DATA + noise)
    meets = np.asarray(found.meets)
    left, whole = meets * np.asarray(found.values), meets * (DATA + noise)
    assert_allclose(found.relative, np.linalg.norm(left) / np.linalg.norm(whole), rtol=1e-12)
    assert_allclose(found.relative, np.sqrt(np.mean(np.asarray(found.per_detector) ** 2)))
    typical = np.sqrt(np.mean(np.sum(whole**2, axis=1)))
    assert_allclose(found.per_detector, np.linalg.norm(left, axis=1) / typical, rtol=1e-12)
    assert_allclose(found.typical, 0.05, rtol=0.08)  # 1/√(2 n) is 2 %
    assert_allclose(found.outside, np.sum((~meets * noise) ** 2) / np.sum((DATA + noise) ** 2))


def test_channels_that_are_dead_loud_inverted_or_noisy_stand_out():
    bad = DATA + 1e-3 * np.random.default_rng(1).standard_normal(DATA.shape)
    bad[3], bad[7], bad[12] = 0.0, 2 * DATA[7], -DATA[12]
    bad[20] += 0.5 * np.random.default_rng(2).standard_normal(len(RADII))
    found = residual(bad)
    assert found.unusual.tolist() == [3, 7, 12, 20]
    assert_allclose(np.asarray(found.gains)[[3, 7, 12]], [0, 2, -1], atol=2e-3)


def test_gains_that_rise_towards_the_ends_do_not_stand_out():
    """As where an open curve's ends see less of the region; one dead or loud there does."""
    gains = 1 + 0.04 * np.maximum(np.abs(np.arange(24) - 11.5) - 6.5, 0.0)
    data = gains[:, None] * DATA + 1e-3 * np.random.default_rng(1).standard_normal(DATA.shape)
    rising = residual(data)
    assert rising.gains[0] > 1.15 and not rising.unusual.size
    data[2], data[21] = 0.0, 2 * data[21]
    assert residual(data).unusual.tolist() == [2, 21]


def test_equal_noise_makes_no_channel_stand_out():
    """Of 24 detectors, in 200 draws: five standard deviations of a mean square over 50 radii are
    rare, but the deviation itself is uncertain."""
    rng = np.random.default_rng(3)
    draws = [
        residual(DATA + 0.1 * rng.standard_normal(DATA.shape)).unusual.size for _ in range(200)
    ]
    assert np.mean(np.array(draws) > 0) < 0.05


def test_sources_outside_the_region_are_told():
    """Their energy on circles that miss the region, from exact integrals."""
    far = 2 * np.asarray(phantoms.Bells([[-0.8, 0.4]], [0.15]).circular_integrals(CURVE, RADII))
    found = residual(DATA + far)
    meets = np.asarray(found.meets)
    share = np.sum((~meets * far) ** 2) / np.sum((DATA + far) ** 2)
    assert share > 0.01
    assert_allclose(found.outside, share, rtol=1e-9)
    assert_allclose(found.values - np.asarray(residual(DATA).values), far, atol=1e-12)


def test_what_is_outside_the_region_does_not_matter():
    inside = np.asarray(REGION.contains(GRID.points))
    found = residual(DATA, np.where(inside, IMAGE, np.nan))
    assert_allclose(found.values, residual(DATA).values, atol=1e-15)


def test_nothing_leaves_nothing():
    found = residual(np.zeros_like(DATA), np.zeros_like(IMAGE))
    for leaf in jax.tree.leaves(found):
        assert np.isfinite(np.asarray(leaf, float)).all()
    assert float(found.relative) == 0


def test_gradient():
    """Of R = ||m(g - A f)|| / ||m g||: along h it is -<m(g - A f), A h> / (R ||m g||²), and by g
    m (g - A f) / (R ||m g||²) - R m g / ||m g||²."""
    rng = np.random.default_rng(4)
    noisy, h = DATA + 0.05 * rng.standard_normal(DATA.shape), rng.standard_normal(GRID.shape)
    h *= np.asarray(REGION.contains(GRID.points))
    found = residual(noisy)
    meets, size = np.asarray(found.meets), np.sum((np.asarray(found.meets) * noisy) ** 2)
    left = meets * np.asarray(found.values) / (float(found.relative) * size)
    by_image, by_g = jax.grad(lambda f, g: residual(g, f).relative, (0, 1))(
        *jax.device_put((IMAGE, noisy))
    )
    expected = -np.sum(left * np.asarray(forward_operator(SETUP)(h)))
    assert_allclose(np.sum(h * np.asarray(by_image)), expected, rtol=1e-9)
    assert_allclose(by_g, left - float(found.relative) * meets * noisy / size, atol=1e-12)


@pytest.mark.parametrize(
    ("g", "image", "message"),
    [
        (DATA[None], IMAGE, r"g has shape \(1, 24, "),
        (DATA[:5], IMAGE, r"g has shape \(5, "),
        (DATA, IMAGE[:5], "image has shape"),
        (DATA, np.where(IMAGE > 0.5, np.nan, IMAGE), "image holds"),
        (np.where(DATA > 0.1, np.nan, DATA), IMAGE, "g holds"),
    ],
)
def test_bad_arguments_are_refused(g, image, message):
    with pytest.raises(ValueError, match=message):
        residual(g, image)
