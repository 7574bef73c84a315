"""From coarse to fine grids: the grids, the operators on them, and where the iteration ends."""

import itertools
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxtat
from jaxtat import ImageGrid, VolumeGrid, model_based
from jaxtat.fitting import Ridge, SecondOrderVariation, TotalVariation, coarse_grids
from jaxtat.fitting.arguments import data_fits
from jaxtat.fitting.coarse_grids import between_nodes, ladder
from jaxtat.fitting.progress import EVERY, after, before, wide_share
from jaxtat.fitting.spectrum import middle_pixel, period, preconditioned, spectrum_of
from jaxtat.reconstruction import operator_on

pytestmark = pytest.mark.slow


def test_each_grid_covers_the_same_square_with_a_quarter_of_the_nodes():
    grids = ladder(ImageGrid((433, 300), (2.0, 1.4), (0.3, 0.1)))
    assert [grid.shape for grid in grids] == [(109, 75), (433, 300)]
    for grid in grids:
        assert_allclose(grid.half_width, [2.0, 1.4])
        assert_allclose(grid.center, [0.3, 0.1])
    assert [grid.shape for grid in ladder(VolumeGrid(65))] == [(17, 17, 17), (65, 65, 65)]
    assert [grid.shape for grid in ladder(VolumeGrid(32))] == [(32, 32, 32)]


@pytest.mark.parametrize("grid", [ImageGrid((9, 12)), VolumeGrid((5, 6, 7))])
def test_planes_are_kept_between_nodes(grid):
    slope = np.arange(1.0, grid.dimension + 1)
    fine = type(grid)(tuple(2 * n for n in grid.shape))
    found = between_nodes(jnp.asarray(grid.points @ slope)[None], fine.shape)
    assert_allclose(found[0], fine.points @ slope, atol=1e-12)


def in_the_plane():
    arc = jaxtat.circular_arc(1.3, 1.0, 16, element_width=0.1)
    bell = jaxtat.phantoms.Bells([[0.1, 0.2]], [0.7])
    setup = jaxtat.Setup(arc, jaxtat.disk(1.0), ImageGrid(49), max_frequency=20.0)
    return setup, bell.image, ImageGrid(25)


def off_circles():
    angles = np.arange(24) / 4
    ellipse = jaxtat.detector_curve(np.stack([1.5 * np.cos(angles), 1.3 * np.sin(angles)], axis=-1))
    bell = jaxtat.phantoms.Bells([[0.1, 0.2]], [0.7])
    return jaxtat.Setup(ellipse, jaxtat.disk(0.9), ImageGrid(49)), bell.image, ImageGrid(25)


def in_space():
    cap = jaxtat.spherical.spherical_cap(1.5, 1.0, 10, 20)
    bell = jaxtat.spherical.SolidBells([[0.1, 0.0, 0.2]], [0.8])
    setup = jaxtat.Setup(cap, jaxtat.spherical.ball(1.0), VolumeGrid(33), max_frequency=9.0)
    return setup, bell.volume, VolumeGrid(17)


@pytest.mark.parametrize("made", [in_the_plane, off_circles, in_space])
def test_operators_on_coarse_grids_give_the_data_of_fine_ones(made):
    """Of a bell, which both resolve; a lower highest frequency leaves it out."""
    setup, of_grid, coarse = made()
    g = jaxtat.forward_operator(setup)(of_grid(setup.grid))
    found = operator_on(setup, coarse)(of_grid(coarse))
    assert_allclose(found, g, atol=3e-3 * float(jnp.abs(g).max()))
    low = operator_on(setup, setup.grid, max_frequency=0.8 * np.pi / float(coarse.spacing[0]))
    assert low.report.n_frequencies < 0.5 * setup.sizes.operator.n_frequencies
    assert_allclose(low(of_grid(setup.grid)), g, atol=3e-2 * float(jnp.abs(g).max()))


@pytest.mark.parametrize("penalty", [TotalVariation(), SecondOrderVariation(), Ridge()])
def test_fits_end_where_those_on_one_grid_end(penalty, monkeypatch):
    monkeypatch.setattr(coarse_grids, "COARSEST", 9)  # also of small images
    setup, of_grid, _ = in_the_plane()
    setup = jaxtat.Setup(setup.curve, setup.region, ImageGrid(37), max_frequency=20.0)
    assert [level.shape for level in ladder(setup.grid)] == [(10, 10), (37, 37)]
    g = jaxtat.forward_operator(setup)(of_grid(setup.grid))
    options = {"penalty": penalty, "nonnegative": True, "weight": 0.01, "tolerance": 1e-4}
    found = model_based(setup, g, max_steps=3000, **options)
    alone = model_based(setup, g, max_steps=3000, initial=jnp.zeros((37, 37)), **options)
    assert found.converged and alone.converged
    size = float(jnp.linalg.norm(alone.image))
    assert float(jnp.linalg.norm(found.image - alone.image)) < 2e-3 * size


def test_the_symbol_is_that_of_a_convolution():
    """Of D^T D exactly, and of B^T B, a wave in the middle is an eigenvector nearly."""
    setup, _, _ = in_the_plane()
    whole = jaxtat.circular_arc(1.3, np.pi, 200)
    setup = jaxtat.Setup(whole, jaxtat.disk(1.0), ImageGrid(65))
    (fit,) = data_fits(setup, None, False, None, None, None, None, [setup.grid])
    kernel = fit.transposed(fit.modelled(middle_pixel(fit)))
    spectrum = spectrum_of(fit, TotalVariation(), kernel)
    waves = [2 * np.pi * np.fft.fftfreq(p) for p in period((65, 65))]
    wanted = (2 - 2 * np.cos(waves[0]))[:, None] + (2 - 2 * np.cos(waves[1]))
    differences = np.asarray(spectrum.differences)
    assert_allclose(differences, wanted[:, : differences.shape[1]], atol=1e-12)
    points = setup.grid.points
    packet = jnp.exp(-jnp.sum(points**2, axis=-1) / 0.1) * jnp.cos(25 * points[..., 0])
    there_and_back = fit.transposed(fit.modelled(packet[None]))
    back = preconditioned(there_and_back, spectrum.data + 1e-3 * spectrum.data.max())[0]
    assert float(jnp.vdot(back, packet) / jnp.vdot(packet, packet)) == pytest.approx(1, abs=0.15)


def looked_at(images, extrapolated=False):
    """The way along images after each step, and that it is unknown until the second look."""
    progress = before(images[0], 200)
    step = jax.jit(partial(after, extrapolated=extrapolated))
    for old, new in itertools.pairwise(images):
        assert bool(jnp.isinf(progress.remaining)) == (int(progress.step) < 2 * EVERY)
        progress = step(progress, old, new)
    return progress


@pytest.mark.parametrize("factor", [0.97, 0.99])
def test_what_remains_of_a_geometric_series_is_known(factor):
    """It is 1 + 1/s times the rest for s = √q."""
    end, way = jnp.ones((1, 3, 3)), jnp.arange(9.0).reshape(1, 3, 3)
    images = [end + way * factor**k for k in range(5 * EVERY + 1)]
    left = jnp.linalg.norm(images[-1] - end) / jnp.linalg.norm(images[-1])
    slower = factor ** (EVERY / 2)
    found = looked_at(images).remaining
    assert float(found) == pytest.approx(float(left * (1 + 1 / slower)), rel=1e-6)
    # extrapolated images are not taken to be settled because moves have shrunk by a half
    cautious = float(looked_at(images, extrapolated=True).remaining)
    q = factor**EVERY
    move = float(left) * (1 / q - 1)
    s = np.sqrt(max(q, 0.7))
    assert cautious == pytest.approx(move * s / (1 - s), rel=1e-6)


def test_what_remains_follows_from_moves_three_looks_apart():
    """The last two moves grow, but the last one is half as long as that of three looks before."""
    moves = [4.0, 2.0, 2.0, 0.5, 1.0]
    levels = 10 + np.concatenate([[0], np.cumsum(moves)])
    images = [jnp.full((1, 2, 2), levels[0])]
    for level in levels[1:]:
        images += EVERY * [jnp.full((1, 2, 2), level)]
    s = np.sqrt((1.0 / 2.0) ** (1 / 3))
    found = float(looked_at(images).remaining)
    assert found == pytest.approx(1.0 / levels[-1] * s / (1 - s), rel=1e-6)


def test_waves_of_at_most_four_periods_are_wide():
    x = jnp.arange(24) / 24
    wide, fine = jnp.cos(2 * jnp.pi * 3 * x), jnp.cos(2 * jnp.pi * 7 * x)
    move = (2 * wide[:, None] + jnp.outer(jnp.ones(24), fine))[None]
    assert float(wide_share(move)) == pytest.approx(0.8)
    assert float(wide_share(0 * move)) == 0
