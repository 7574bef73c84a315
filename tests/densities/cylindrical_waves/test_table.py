"""The potentials' matrix in cylindrical waves, against the one on the boundary."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import circular_arc, detector_curve, disk
from jaxtat.densities.cylindrical_waves import polar_geometry, wave_orders, wave_table
from jaxtat.densities.cylindrical_waves.cut_disks import cut_disk
from jaxtat.densities.cylindrical_waves.table import (
    RegionFactor,
    alpha_unit,
    blocks,
    circle_gram,
    cut_gram,
    detector_matrix,
    detector_powers,
    pairs,
    region_factor,
    region_gram,
)
from jaxtat.densities.cylindrical_waves.waves import boundary_traces
from jaxtat.densities.single_layer import potential_matrix

PLACE = {"center": (0.3, -0.2), "angle": 0.8}
ARC = circular_arc(1.5, 0.3, 31, **PLACE)
WIDTHS = 0.3 * np.cos(np.linspace(-1.5, 1.5, 31))
JITTER = np.random.default_rng(0).uniform(-0.02, 0.02, (31, 2))
DISK = disk(1.0, n_boundary=240, **PLACE)
HALF = disk(1.0, 0.3, n_boundary=240, **PLACE)
THROUGH = disk(1.0, 0.0, n_boundary=240, **PLACE)
ASKEW = disk(1.0, 0.3, n_boundary=240, center=PLACE["center"])
GEOMETRIES = {
    "disk": (ARC, DISK),
    "half disk": (ARC, HALF),
    "askew": (ARC, ASKEW),
    "measured": (detector_curve(ARC.points + JITTER), DISK),
    # elements of finite width: alike on a circle, as arcs and straight, and each for itself
    "wide": (circular_arc(1.5, 0.3, 31, **PLACE, element_width=0.3), HALF),
    "straight": (detector_curve(ARC.points, element_width=0.3), DISK),
    "uneven": (circular_arc(1.5, 0.3, 31, **PLACE, element_width=WIDTHS), HALF),
    "wide, measured": (detector_curve(ARC.points + JITTER, element_width=0.3), DISK),
}
FREQUENCIES = jnp.array([1.0, 8.0])


def table_of(polar):
    n_max = int(wave_orders(polar, np.asarray(FREQUENCIES)).max())
    return wave_table(polar, FREQUENCIES, n_max)


def at(table, i):
    return jax.device_put(jax.tree.map(lambda leaf: np.asarray(leaf)[i], table))


traced_table = eqx.filter_jit(wave_table)
matrix_of, traces_of = eqx.filter_jit(potential_matrix), eqx.filter_jit(boundary_traces)


@eqx.filter_jit
def parts_of(polar, wave):
    """R, M √w, R M √w and the unit of alpha."""
    factor = region_factor(polar, wave)
    matrix = jnp.moveaxis(detector_matrix(polar, wave) * jnp.sqrt(polar.weights), 0, -2)
    matrix = matrix.reshape(*matrix.shape[:2], -1)
    unit = alpha_unit(factor.powers, detector_powers(polar, wave))
    return factor.values, matrix, factor.matrix_times(matrix), unit


@pytest.mark.parametrize("name", GEOMETRIES)
def test_it_acts_as_the_matrix_on_the_boundary(name):
    """A = R M acts as the collocation matrix does, up to an isometry.

    The unit of alpha is that of the strongest wave, max_n |B_n|² |M_n|², by the columns and rows of
    both; on a disk the diagonal of A A^T.
    """
    curve, region = GEOMETRIES[name]
    polar = polar_geometry(curve, region)
    table = table_of(polar)
    for i, frequency in enumerate(np.asarray(FREQUENCIES)):
        r, waves, a, unit = map(np.asarray, parts_of(polar, at(table, i)))
        found = np.sort(np.linalg.svd(a, compute_uv=False).ravel())[::-1]
        expected = np.linalg.svd(matrix_of(frequency, curve, region), compute_uv=False)
        n = min(len(found), len(expected))
        # waves are cut at 1e-12; both matrices have the same points on the boundary
        np.testing.assert_allclose(found[:n], expected[:n], atol=2e-12 * expected[0])
        assert not len(found[n:]) or found[n:].max() < 2e-12 * expected[0]
        squares = r**2 if polar.disk else np.sum(r**2, axis=1)
        assert polar.disk == (r.ndim == 2)
        each = squares * np.sum(waves**2, axis=-1)
        np.testing.assert_allclose(unit, each.max(), rtol=1e-12)
        if polar.disk:
            np.testing.assert_allclose(unit, np.sum(a**2, axis=-1).max(), rtol=1e-12)


@pytest.mark.parametrize("name", ["half disk", "askew"])
def test_factor_of_the_gram_matrix(name):
    """R^T R is the Gram matrix of the traces; one side of a mirrored boundary stands for both."""
    polar = polar_geometry(*GEOMETRIES[name])
    whole = eqx.tree_at(lambda tree: tree.region, polar, GEOMETRIES[name][1])
    wave = at(table_of(polar), 1)
    r = np.asarray(parts_of(polar, wave)[0])
    traces = np.asarray(traces_of(wave.frequencies, wave.steps, whole))
    n = traces.shape[2]
    gram = np.tensordot(traces, traces, (0, 0))
    found = r.swapaxes(1, 2) @ r
    if polar.mirror:
        assert np.abs(gram[0, :, 1]).max() < 1e-12 * np.abs(gram).max()
        expected = np.stack([gram[0, :, 0], gram[1, :, 1]])
    else:
        expected = gram.reshape(1, 2 * n, 2 * n)
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


@eqx.filter_jit
def gram_in_parts(polar, wave):
    return region_gram(polar, wave, cut_disk(polar, wave.steps.shape[-1] - 2))


IN_PARTS = {
    "half disk": GEOMETRIES["half disk"],
    "through the centre": (ARC, THROUGH),
    "askew": GEOMETRIES["askew"],
}


@pytest.mark.parametrize("name", IN_PARTS)
def test_gram_matrix_of_a_cut_disk_in_parts(name):
    """Arc and chord apart, without a table of derivatives, are the sums over all traces."""
    curve, region = IN_PARTS[name]
    polar = polar_geometry(curve, region)
    assert polar.halved == (name == "through the centre")
    assert polar.rim == region.counts[0] // (2 if polar.mirror else 1)
    table = table_of(polar)
    for i in range(2):
        wave = at(table, i)
        r = np.asarray(parts_of(polar, wave)[0])
        expected = r.swapaxes(1, 2) @ r
        found = gram_in_parts(polar, wave)
        np.testing.assert_allclose(found, expected, atol=1e-12 * expected.max())


def test_only_a_cut_disk_about_the_centre_falls_into_arc_and_chord():
    aside = disk(0.8, 0.3, n_boundary=240, center=(0.35, -0.2), angle=0.8)
    for curve, region in (GEOMETRIES["disk"], (ARC, aside)):
        polar = polar_geometry(curve, region)
        assert polar.rim == 0 and cut_disk(polar, 12) is None


PRODUCTS = ("times", "transposed_times", "matrix_times", "transposed_matrix_times", "around")


@jax.jit
def products(values, vectors, matrix):
    """All products with R of these values."""
    factor = RegionFactor(values)
    arguments = vectors, vectors, matrix, matrix, matrix
    return [getattr(factor, name)(x) for name, x in zip(PRODUCTS, arguments, strict=True)]


def test_diagonal_factors_act_like_matrices():
    """All products with R agree between its two forms, and with those of a triangle."""
    rng = np.random.default_rng(0)
    values, vectors = rng.uniform(1, 2, (2, 5)), rng.normal(size=(3, 2, 5))
    matrix = rng.normal(size=(2, 5, 5))
    matrix = matrix + matrix.swapaxes(1, 2)
    full = np.stack([np.diag(row) for row in values])
    each = products(values, vectors, matrix), products(full, vectors, matrix)
    for name, *pair in zip(PRODUCTS, *each, strict=True):
        np.testing.assert_allclose(*pair, rtol=1e-12, err_msg=name)
    r = np.triu(matrix) + 5 * np.eye(5)
    expected = np.einsum("bij,bjk,blk->bil", r, matrix, r)
    np.testing.assert_allclose(products(r, vectors, matrix)[-1], expected, atol=1e-10)


@pytest.mark.parametrize("name", ["disk", "askew"])
def test_gram_matrix_of_the_detectors(name):
    """T from sums over m - n and m + n is the direct sum, for fewer orders a part of it."""
    polar = polar_geometry(*GEOMETRIES[name])
    n = np.arange(13)
    phase = n[:, None] * np.asarray(polar.detector_angles)
    waves = np.stack([np.cos(phase), np.sin(phase)])
    if not polar.mirror:
        waves = waves.reshape(1, 26, -1)
    expected = np.einsum("brk,bsk,k->brs", waves, waves, polar.weights)

    @eqx.filter_jit
    def grams(polar):
        gram = circle_gram(polar, 12)
        return gram, cut_gram(polar, gram, 12), cut_gram(polar, gram, 5), circle_gram(polar, 5)

    gram, uncut, cut, small = grams(polar)
    np.testing.assert_allclose(gram, expected, atol=1e-12)
    np.testing.assert_array_equal(uncut, gram)
    np.testing.assert_allclose(cut, small, atol=1e-13)


def test_a_table_may_be_cut():
    """A table of many orders and frequencies holds those of few."""
    polar = polar_geometry(*GEOMETRIES["disk"])  # whose table has all parts
    many = at(wave_table(polar, FREQUENCIES, 90), slice(1, None))
    small = wave_table(polar, FREQUENCIES[1:], 60)
    leaves = (jax.tree.leaves(table) for table in (many.up_to(60), small))
    for found, expected in zip(*leaves, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_detectors_on_a_circle_and_one_by_one_have_the_same_matrix():
    polar = polar_geometry(ARC, HALF)
    each = jnp.full(31, polar.detector_radius)
    single = eqx.tree_at(lambda tree: tree.detector_radius, polar, each)
    assert polar.on_circle and not single.on_circle
    waves_of = eqx.filter_jit(detector_matrix)
    matrices = [waves_of(p, at(table_of(p), 0)) for p in (polar, single)]
    np.testing.assert_allclose(*matrices, rtol=1e-12)


def test_blocks_and_pairs_are_inverse():
    waves = jnp.arange(24.0).reshape(3, 2, 4)
    for name, shape in (("disk", (3, 2, 4)), ("askew", (3, 1, 8))):
        polar = polar_geometry(*GEOMETRIES[name])
        assert blocks(polar, waves).shape == shape
        np.testing.assert_array_equal(pairs(blocks(polar, waves)), waves)
