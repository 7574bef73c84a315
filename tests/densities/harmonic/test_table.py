"""The potentials' matrix in cylindrical waves, against the one on the boundary."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import circular_arc, detector_curve, disk
from jaxtat.densities.harmonic import harmonic_orders, polar_geometry, wave_table
from jaxtat.densities.harmonic.cut_disks import cut_disk
from jaxtat.densities.harmonic.table import (
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
from jaxtat.densities.harmonic.waves import boundary_traces
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
    n_max = int(harmonic_orders(polar, np.asarray(FREQUENCIES)).max())
    return wave_table(polar, FREQUENCIES, n_max)


def at(table, i):
    return jax.device_put(jax.tree.map(lambda leaf: np.asarray(leaf)[i], table))


matrix_of, waves_of = eqx.filter_jit(potential_matrix), eqx.filter_jit(detector_matrix)
factor_of, traces_of = eqx.filter_jit(region_factor), eqx.filter_jit(boundary_traces)


@pytest.mark.parametrize("name", GEOMETRIES)
def test_singular_values_are_those_of_the_matrix_on_the_boundary(name):
    """A = R M acts as the collocation matrix does, up to an isometry."""
    curve, region = GEOMETRIES[name]
    polar = polar_geometry(curve, region)
    table = table_of(polar)
    for i in range(2):
        wave = at(table, i)
        factor = factor_of(polar, wave)
        matrix = jnp.moveaxis(waves_of(polar, wave) * jnp.sqrt(polar.weights), 0, -2)
        a = factor.matrix_times(matrix.reshape(*matrix.shape[:2], -1))
        found = np.sort(np.linalg.svd(a, compute_uv=False).ravel())[::-1]
        expected = np.linalg.svd(matrix_of(FREQUENCIES[i], curve, region), compute_uv=False)
        n = min(len(found), len(expected))
        # waves are cut at 1e-12; both matrices have the same points on the boundary
        np.testing.assert_allclose(found[:n], expected[:n], atol=2e-12 * expected[0])
        assert not len(found[n:]) or found[n:].max() < 2e-12 * expected[0]


@pytest.mark.parametrize("name", ["half disk", "askew"])
def test_factor_of_the_gram_matrix(name):
    """R^T R is the Gram matrix of the traces; one side of a mirrored boundary stands for both."""
    polar = polar_geometry(*GEOMETRIES[name])
    whole = eqx.tree_at(lambda tree: tree.region, polar, GEOMETRIES[name][1])
    wave = at(table_of(polar), 1)
    r = factor_of(polar, wave).values
    traces = traces_of(wave.frequencies, wave.steps, whole)
    gram = jnp.einsum("tpm,tqn->pmqn", traces, traces)
    found = jnp.einsum("bij,bik->bjk", r, r)
    if polar.mirror:
        scale = jnp.abs(gram).max()
        assert jnp.abs(gram[0, :, 1]).max() < 1e-12 * scale
        expected = jnp.stack([gram[0, :, 0], gram[1, :, 1]])
    else:
        n = gram.shape[1]
        expected = gram.reshape(1, 2 * n, 2 * n)
    np.testing.assert_allclose(found, expected, atol=1e-12 * float(jnp.abs(expected).max()))


@eqx.filter_jit
def gram_in_parts(polar, wave):
    return region_gram(polar, wave, cut_disk(polar, wave.steps.shape[-1] - 2))


IN_PARTS = {
    "half disk": GEOMETRIES["half disk"],
    "through the centre": (ARC, THROUGH),
    "askew": GEOMETRIES["askew"],
    "off a circle": (GEOMETRIES["measured"][0], HALF),
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
        r = factor_of(polar, wave).values
        expected = jnp.einsum("bij,bik->bjk", r, r)
        found = gram_in_parts(polar, wave)
        np.testing.assert_allclose(found, expected, atol=1e-12 * float(expected.max()))


def test_only_a_cut_disk_about_the_centre_falls_into_arc_and_chord():
    aside = disk(0.8, 0.3, n_boundary=240, center=(0.35, -0.2), angle=0.8)
    for curve, region in (GEOMETRIES["disk"], (ARC, aside)):
        polar = polar_geometry(curve, region)
        assert polar.rim == 0 and cut_disk(polar, 12) is None


def test_diagonal_factors_act_like_matrices():
    """All products with R agree between its two forms."""
    rng = np.random.default_rng(0)
    values, vectors = (
        jnp.asarray(rng.uniform(1, 2, (2, 5))),
        jnp.asarray(rng.normal(size=(3, 2, 5))),
    )
    matrix = jnp.asarray(rng.normal(size=(2, 5, 5)))
    matrix = matrix + jnp.swapaxes(matrix, 1, 2)
    diagonal, full = RegionFactor(values), RegionFactor(jax.vmap(jnp.diag)(values))
    assert diagonal.is_diagonal and not full.is_diagonal
    for name, argument in (
        ("times", vectors),
        ("transposed_times", vectors),
        ("matrix_times", matrix),
        ("transposed_matrix_times", matrix),
        ("around", matrix),
    ):
        found = [getattr(factor, name)(argument) for factor in (diagonal, full)]
        np.testing.assert_allclose(*found, rtol=1e-12, err_msg=name)
    inverse = [
        factor.inverse_around(jnp.asarray(values), jnp.array(0.1))(vectors[0])
        for factor in (diagonal, full)
    ]
    np.testing.assert_allclose(*inverse, rtol=1e-12)
    triangle = RegionFactor(jnp.triu(matrix) + 5 * jnp.eye(5))
    r = np.asarray(triangle.values)
    system = r @ (np.asarray(values)[:, :, None] * r.swapaxes(1, 2)) + 0.1 * np.eye(5)
    expected = np.linalg.solve(system, np.asarray(vectors[0])[..., None])[..., 0]
    solved = triangle.inverse_around(values, jnp.array(0.1))(vectors[0])
    np.testing.assert_allclose(solved, expected, rtol=1e-10)
    expected = np.einsum("bij,bjk,blk->bil", r, matrix, r)
    np.testing.assert_allclose(triangle.around(matrix), expected, atol=1e-10)


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
    gram = circle_gram(polar, 12)
    np.testing.assert_allclose(gram, expected, atol=1e-12)
    np.testing.assert_array_equal(cut_gram(polar, gram, 12), gram)
    np.testing.assert_allclose(cut_gram(polar, gram, 5), circle_gram(polar, 5), atol=1e-13)


def test_a_table_may_be_cut():
    """A table of many orders and frequencies holds those of few."""
    for name in ("disk", "measured"):
        polar = polar_geometry(*GEOMETRIES[name])
        many = wave_table(polar, FREQUENCIES, 90)
        cut = jax.tree.map(lambda leaf: leaf[1:], many).up_to(60)
        small = wave_table(polar, FREQUENCIES[1:], 60)
        for found, expected in zip(jax.tree.leaves(cut), jax.tree.leaves(small), strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_detectors_on_a_circle_and_one_by_one_have_the_same_matrix():
    polar = polar_geometry(ARC, HALF)
    each = jnp.full(31, polar.detector_radius)
    single = eqx.tree_at(lambda tree: tree.detector_radius, polar, each)
    assert polar.on_circle and not single.on_circle
    matrices = [waves_of(p, at(table_of(p), 0)) for p in (polar, single)]
    np.testing.assert_allclose(*matrices, rtol=1e-12)


def test_blocks_and_pairs_are_inverse():
    waves = jnp.arange(24.0).reshape(3, 2, 4)
    for name, shape in (("disk", (3, 2, 4)), ("askew", (3, 1, 8))):
        polar = polar_geometry(*GEOMETRIES[name])
        assert blocks(polar, waves).shape == shape
        np.testing.assert_array_equal(pairs(blocks(polar, waves)), waves)


@pytest.mark.parametrize("name", GEOMETRIES)
def test_the_unit_of_alpha_is_that_of_the_strongest_wave(name):
    """max_n |B_n|² |M_n|², by the columns and rows of both; on a disk the diagonal of A A^T."""
    polar = polar_geometry(*GEOMETRIES[name])
    wave = at(table_of(polar), 1)
    factor = factor_of(polar, wave)
    waves = jnp.moveaxis(waves_of(polar, wave) * jnp.sqrt(polar.weights), 0, -2)
    waves = waves.reshape(*waves.shape[:2], -1)
    found = alpha_unit(factor.powers, detector_powers(polar, wave))
    r = factor.values if not factor.is_diagonal else jax.vmap(jnp.diag)(factor.values)
    each = np.sum(np.asarray(r) ** 2, axis=1) * np.sum(np.asarray(waves) ** 2, axis=-1)
    np.testing.assert_allclose(found, each.max(), rtol=1e-12)
    if factor.is_diagonal:
        largest = jnp.sum(factor.matrix_times(waves) ** 2, axis=-1).max()
        np.testing.assert_allclose(found, largest, rtol=1e-12)
