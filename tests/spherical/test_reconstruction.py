"""Steps 1 to 5 in space: dense solutions, exact transforms, exact volumes, derivatives."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import spherical_jn, spherical_yn

from jaxtat import (
    NoiseLevel,
    RelativeTikhonov,
    Setup,
    TikhonovNormBound,
    VolumeGrid,
    reconstruct,
    solve,
)
from jaxtat.geometry.rings import DetectorRings
from jaxtat.regularization import tikhonov_rule
from jaxtat.spherical import (
    DetectorPoints,
    SolidBells,
    back_projection,
    ball,
    cap_radii,
    pressure_to_spherical_integrals,
    spherical_cap,
)
from jaxtat.spherical.polar_fourier import meridian_fourier
from jaxtat.spherical.scattered import solve_points
from jaxtat.spherical.tikhonov import _shared as shared_by_orders
from jaxtat.spherical.tikhonov import solve_rings
from jaxtat.spherical.waves import cap_waves

CENTER = np.array([0.1, -0.2, 0.3])
OFFSETS = np.array([[0.05, 0.1, 0.02], [-0.1, -0.05, -0.1]])


def low_pass(relative):
    return jnp.cos(jnp.pi / 2 * relative) ** 4


class CapProblem:
    """A cap that sees all of the ball, two bells and their data, of two amplitudes."""

    cap = spherical_cap(1.5, 1.1, 26, 64, center=CENTER)
    region = ball(1.0, center=CENTER)
    grid = VolumeGrid(13, center=CENTER)
    radii = cap_radii(cap, region, 1 / 26)  # what aliases is 1e-9 of the bells
    setup = Setup(cap, region, grid, radii, max_frequency=6 * np.pi)
    sizes = setup.sizes
    bells = SolidBells(CENTER + OFFSETS, [0.4, 0.35], [1.0, -0.6])
    g = bells.spherical_integrals(cap, radii)
    stack = jnp.stack([g, 2 * g])


def filtered(bells, highest, points):
    """The bells with their transform times `low_pass`: a radial integral for each."""
    node, weight = np.polynomial.legendre.leggauss(100)
    k, w = highest * (node + 1) / 2, highest / 2 * weight
    total = np.zeros(points.shape[:-1])
    for center, size, amplitude in zip(bells.centers, bells.radii, bells.amplitudes, strict=True):
        one = SolidBells([[0.0, 0.0, 0.0]], size[None]).fourier(np.stack([k, 0 * k, 0 * k], axis=1))
        spectrum = np.asarray(one).real * np.asarray(low_pass(k / highest)) * k**2 * w
        distance = np.linalg.norm(points - np.asarray(center), axis=-1)
        waves = np.sinc(distance[..., None] * k / np.pi)
        total += float(amplitude) * np.sqrt(2 / np.pi) * waves @ spectrum
    return total


@pytest.fixture(scope="module")
def solved():
    """F of two volumes, with next to no regularisation, and the report."""
    p = CapProblem
    rule = tikhonov_rule(1e-12, p.sizes.n_frequencies)
    return solve_rings(p.cap, p.region, p.radii, p.stack, rule, p.sizes)


in_some_planes = jax.jit(meridian_fourier, static_argnums=(2, 3))


def in_planes(spectrum, n, n_sets):
    planes = [
        np.asarray(in_some_planes(spectrum, jnp.asarray(k), n_sets, n)) for k in range(n_sets)
    ]
    return np.stack(planes, axis=1).reshape(n, *planes[0].shape[1:])


def directions(n):
    """Unit vectors of all planes q and angles j, (planes, directions, 3)."""
    phi, t = np.pi / n * np.arange(n)[:, None], np.pi / n * np.arange(n)
    parts = np.cos(t) * np.cos(phi), np.cos(t) * np.sin(phi), np.sin(t) + 0 * phi
    return np.stack(parts, axis=-1)


def test_polar_transform_is_that_of_the_bells(solved):
    """Steps 1 to 3, phases about the centre; and twice the data give twice the transform."""
    p, (spectra, report) = CapProblem, solved
    n, frequencies = p.sizes.n_directions, np.asarray(p.sizes.frequencies)
    xi = frequencies[:, None, None, None] * directions(n)
    local = SolidBells(OFFSETS, p.bells.radii, p.bells.amplitudes)
    exact = np.moveaxis(np.sqrt(2 * np.pi) * np.asarray(local.fourier(xi)), 0, 1)
    largest = np.abs(exact).max()
    for n_sets, size, spectrum in ((1, 1, spectra[0]), (4, 2, spectra[1])):
        found = in_planes(spectrum, n, n_sets)
        assert np.abs(found - size * exact).max() < 1e-7 * largest
    assert report.converged.all() and report.residual.max() < 1e-12
    np.testing.assert_allclose(report.relative_alpha, 1e-12)


def test_groups_pieces_and_sizes_change_nothing(solved):
    """Two groups of frequencies, four pieces of orders in three sizes."""
    p = CapProblem
    l_max = p.sizes.groups[-1]
    sizes = dataclasses.replace(p.sizes, groups=(l_max - 9, l_max), in_group=6, piece=6, n_sizes=3)
    assert len({size for row in sizes.degrees for size in row}) == 3
    rule = tikhonov_rule(1e-12, 12)
    spectra, _ = solve_rings(p.cap, p.region, p.radii, p.stack, rule, sizes)
    assert np.abs(spectra - solved[0]).max() < 1e-9 * np.abs(solved[0]).max()


def test_volume_is_that_of_the_filtered_bells():
    """All five steps; nothing is left of the discretisation, on a grid of 13^3 too."""
    p = CapProblem
    expected = filtered(p.bells, p.sizes.max_frequency, np.asarray(p.grid.points))
    inside = np.asarray(p.region.contains(p.grid.points))
    for inversion in ("fourier", "fbp"):
        found = solve(p.setup, p.stack, 1e-12, low_pass=low_pass, inversion=inversion)
        assert found.image.shape == (2, 13, 13, 13) and bool(found.converged)
        assert found.basis == "spherical"
        error = np.abs(np.asarray(found.image[0]) - expected)[inside].max()
        assert error < 5e-6, (inversion, error)  # of 0.19; the low-pass has tails beyond the ball
        np.testing.assert_allclose(found.image[1], 2 * found.image[0], atol=1e-10)


# --- the linear algebra against a dense solution on the boundary ---------------------------------

SMALL_CAP, SMALL_RADIUS = spherical_cap(2.0, 1.2, 7, 44), 0.5
SMALL_RADII = jax.device_put(1.5 + 0.1 * np.arange(11))


def traces(points, normals, frequency, detectors):
    """(j_0|y_0)(lambda |x - z|) and (1/lambda) d/dn, (2 points, 2 detectors)."""
    difference = points[:, None] - detectors
    r = np.linalg.norm(difference, axis=-1)
    x, cosine = frequency * r, np.einsum("pkc,pc->pk", difference, normals) / r
    values = np.sin(x) / x, -np.cos(x) / x
    slopes = np.cos(x) / x - np.sin(x) / x**2, np.sin(x) / x + np.cos(x) / x**2
    return np.block([list(values), [slope * cosine for slope in slopes]])


def boundary_points(region):
    """Points, normals and weights of a product rule, exact for the waves that matter."""
    if region.whole:
        t, w = np.polynomial.legendre.leggauss(24)
        distance, flat, area = 0 * t + float(region.radius), 0 * t, 2 * np.pi * 0.25 * w
    else:
        edge = jax.tree.map(np.asarray, region.boundary((36, 24)))
        t, distance, flat, area = edge.cosine, edge.distance, edge.flat, edge.weights
    phi = 2 * np.pi / 46 * np.arange(46)
    s = np.sqrt(1 - t**2)[:, None]
    unit = np.stack(np.broadcast_arrays(s * np.cos(phi), s * np.sin(phi), t[:, None]), axis=-1)
    normal = np.where(flat[:, None, None] > 0, np.array([0.0, 0.0, 1.0]), unit)
    points = distance[:, None, None] * unit
    return points.reshape(-1, 3), normal.reshape(-1, 3), np.repeat(area / 46, 46)


def dense(region, frequency, alpha, data, xi):
    """fhat = (2π)^(-3/2) rho·√w G, rho = A^T (A A^T + alpha)^-1 u = (A^T A + alpha)^-1 A^T u."""
    points, normals, weights = boundary_points(region)
    root = np.sqrt(np.tile(weights, 2))[:, None]
    w = np.sqrt(np.asarray(SMALL_CAP.weights).ravel())
    a = root * traces(points, normals, frequency, np.asarray(SMALL_CAP.points).reshape(-1, 3))
    a *= np.tile(w, 2)
    wave = np.exp(-1j * points @ xi.T)
    u = root * np.concatenate([wave, -1j * (normals @ xi.T) / frequency * wave])
    rho = np.linalg.solve(a.T @ a + alpha * np.eye(a.shape[1]), a.T @ u)
    return (np.concatenate([w * data[0], w * data[1]]) @ rho) / (2 * np.pi) ** 1.5


@pytest.mark.parametrize("kind", ["ball", "lower part", "ball, any positions"])
def test_solution_is_that_of_the_dense_matrix_on_the_boundary(kind):
    """For data of no volume at all, and an alpha that matters."""
    region = ball(SMALL_RADIUS, 0.1 if kind == "lower part" else None)
    grid = VolumeGrid(9, half_width=SMALL_RADIUS)
    sizes = Setup(SMALL_CAP, region, grid, SMALL_RADII, max_frequency=9.0).sizes
    if kind == "lower part":  # as many points as the dense matrix has
        sizes = dataclasses.replace(sizes, boundary=(36, 24))
    g = jax.device_put(np.random.default_rng(3).standard_normal((1, 7, 44, 11)))
    rule = tikhonov_rule(1e-4, sizes.n_frequencies)
    if kind == "ball, any positions":
        detectors = DetectorPoints(SMALL_CAP.points.reshape(-1, 3), SMALL_CAP.weights.reshape(-1))
        more = dataclasses.replace(sizes, n_orders=sizes.groups[-1] + 1)
        found = solve_points(detectors, region, SMALL_RADII, g.reshape(1, -1, 11), rule, more)
    else:
        found = solve_rings(SMALL_CAP, region, SMALL_RADII, g, rule, sizes)
    spectrum, report = found
    found = in_planes(spectrum[0], sizes.n_directions, 1) / np.sqrt(2 * np.pi)
    planes, angles = np.array([0, 5, 20]), np.array([0, 3, 16, 25])
    unit = directions(sizes.n_directions)[planes][:, angles].reshape(-1, 3)
    for number in (0, 4, 7):
        frequency = float(sizes.frequencies[number])
        x = frequency * np.asarray(SMALL_RADII)
        step = np.full(11, 0.1)
        step[[0, -1]] /= 2
        flat = np.asarray(g).reshape(-1, 11)
        data = flat @ (step * np.sin(x) / x), flat @ (-step * np.cos(x) / x)
        alpha = float(report.alpha[number])
        exact = dense(region, frequency, alpha, data, frequency * unit)
        here = found[np.ix_(planes, [number], angles)].ravel()
        # what is left out of waves beyond the boundary's rule is 1e-11 of the largest
        assert np.abs(here - exact).max() < 1e-8 * np.abs(exact).max()


# --- rules, positions, records -------------------------------------------------------------------


def test_alpha_of_noise_and_of_visibility():
    """Wiener's ratio, computed here from the kernels; and half the sphere's eigenvalue."""
    p = CapProblem
    frequencies, sigma = np.asarray(p.sizes.frequencies), 0.05

    @jax.jit  # without the solutions, which compile long
    def alphas(g):
        rules = RelativeTikhonov(0.1), 1.0, NoiseLevel(sigma)
        rules = [tikhonov_rule(rule, p.sizes.n_frequencies) for rule in rules]
        where, sizes = (p.cap, p.region, p.radii, g), (p.sizes, p.sizes.frequencies)
        return [shared_by_orders(*where, rule, *sizes)[0].alpha for rule in rules]

    of_visibility, unit, found = map(np.asarray, alphas(p.g[None]))
    seen_once = 0.01 * 8 * np.pi**2 / frequencies**4
    np.testing.assert_allclose(of_visibility, seen_once, rtol=1e-12)
    x = frequencies[:, None] * np.asarray(p.radii)
    step = np.gradient(np.asarray(p.radii))
    step[[0, -1]] /= 2
    kernels = np.stack([np.sin(x) / x, -np.cos(x) / x], axis=1) * step
    weights = np.asarray(p.cap.weights)
    noise = sigma**2 * weights.mean() * (kernels**2).sum(axis=-1).mean(axis=-1)
    values = np.einsum("fjr,pkr->fjpk", kernels, p.g) ** 2 * weights
    power = values.mean(axis=(1, 2, 3))
    # the unit is the largest entry of the diagonal
    # where noise is small the ratio is sigma_G² tr(A A^T) / (n |G|²); the trace by summation
    trace = found / (noise / np.maximum(power - noise, 0.01 * noise)) * 2 * weights.size
    degrees = trace / unit  # how many waves count as much as the strongest
    assert (np.diff(degrees) > 0).all()
    n = np.arange(p.sizes.groups[-1] + 1)
    reach = frequencies[:, None]
    square = spherical_jn(n, reach) ** 2 + spherical_jn(n, reach, True) ** 2
    there = spherical_jn(n, 1.5 * reach) ** 2 + spherical_yn(n, 1.5 * reach) ** 2
    terms = np.where(np.isfinite(there), square * there, 0.0)
    terms *= (4 * np.pi) ** 2 * weights.sum() / (4 * np.pi)
    np.testing.assert_allclose(unit, terms.max(axis=1), rtol=1e-10)
    np.testing.assert_allclose(trace, (terms * (2 * n + 1)).sum(axis=1), rtol=1e-8)
    with pytest.raises(ValueError, match="not available in space"):
        solve(p.setup, p.g, TikhonovNormBound(2.0))


def test_waves_seen_once_have_half_the_sphere_s_eigenvalue():
    """Those of the whole sphere are (4π/lambda²)² for l well below lambda R."""
    frequencies = jnp.array([40.0, 80.0])
    waves = jax.jit(cap_waves, static_argnums=3)(frequencies, 1.0, 1.5, 40)
    sphere = 1.5**2 * np.sum(np.asarray(waves.at_detectors) ** 2, axis=1) * waves.norms**2
    ratio = np.asarray(sphere * frequencies[:, None] ** 4) / (4 * np.pi) ** 2
    assert np.abs(ratio[0, :10] - 1).max() < 0.08 and np.abs(ratio[1, :10] - 1).max() < 0.02


def test_measured_positions_give_the_volume_too():
    """Detectors at random on a sphere, each moved by up to 2 %, from exact data."""
    rng = np.random.default_rng(5)
    unit = rng.standard_normal((260, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    points = 1.5 * unit * rng.uniform(0.98, 1.02, (260, 1))
    detectors, region, grid = DetectorPoints(points), ball(1.0), VolumeGrid(9)
    radii = 0.45 + 0.08 * np.arange(27)
    bell = SolidBells([[0.1, 0.0, -0.1]], [0.6])
    g = bell.spherical_integrals(detectors, radii)
    setup = Setup(detectors, region, grid, radii, max_frequency=9.0)
    image = reconstruct(setup, g, 1e-8, low_pass=low_pass, inversion="fourier")
    inside = np.asarray(region.contains(grid.points))
    exact = filtered(bell, 9.0, np.asarray(grid.points))
    assert np.abs(np.asarray(image) - exact)[inside].max() < 5e-3 * exact.max()


def test_pressure_of_a_bell_in_space():
    """p = ((d - t) h(|d - t|) + (d + t) h(d + t)) / 2d about the bell's centre, c = 1500."""
    speed, times = 1500.0, np.arange(800) * 2e-6
    detectors = DetectorPoints([[0.0, 0.0, 1.3], [0.9, 0.2, 0.4]])
    bell = SolidBells([[0.1, 0.0, -0.1]], [0.5])
    d = np.linalg.norm(np.asarray(detectors.points) - [0.1, 0.0, -0.1], axis=1)[:, None]
    tau = speed * times

    def h(s):
        return np.asarray(bell._profile(jnp.asarray(np.abs(s) / 0.5)))

    pressure = ((d - tau) * h(d - tau) + (d + tau) * h(d + tau)) / (2 * d)
    radii = np.array([0.6, 0.9, 1.3, 1.8])
    found = pressure_to_spherical_integrals(pressure, times, radii, sound_speed=speed)
    exact = np.asarray(bell.spherical_integrals(detectors, radii))
    np.testing.assert_allclose(found, exact, atol=1e-9)


def test_bad_data_are_refused():
    p = CapProblem
    for g, message in (
        (np.asarray(p.g)[:-1], "g has shape"),
        (np.asarray(p.g).astype(int), "raw counts go through"),
        (np.full(p.g.shape, np.nan), "NaN"),
        (np.zeros((0, *p.g.shape)), "no images at all"),
    ):
        with pytest.raises(ValueError, match=message):
            solve(p.setup, g)
    with pytest.raises(ValueError, match="inversion is 'nufft'"):
        solve(p.setup, p.g, inversion="nufft")
    with pytest.raises(ValueError, match="alpha is"):
        solve(p.setup, p.g, 0.0)


# --- derivatives ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_derivatives_in_everything_but_sizes(check_both_modes):
    """A weighted sum of voxels; both modes against differences, of the lower part of a ball.

    Rings are turned, and moved from where those of a cap are; elements are wide.
    """
    cap, region = spherical_cap(1.6, 0.9, 6, 12), ball(0.8, 0.5)
    grid, radii = VolumeGrid((5, 4, 4), half_width=0.5), 0.7 + 0.2 * np.arange(10)
    rng = np.random.default_rng(7)
    weights = jax.device_put(rng.standard_normal(grid.shape))
    g = jax.device_put(rng.standard_normal((6, 12, 10)))
    moved, turns = jnp.asarray(rng.uniform(-0.02, 0.02, 6)), jnp.asarray(rng.uniform(-1, 1, 6))

    def rings_of(radius, opening, center, moved, turns, size):
        changed = eqx.tree_at(lambda c: (c.radius, c.half_opening), cap, (radius, opening))
        theta = jnp.arccos(changed.cosines) + moved
        where = center, radius, opening, 6, 12, "given", theta, turns
        return DetectorRings(*where, element_radius=size)

    rings = jax.jit(rings_of)(cap.radius, cap.half_opening, cap.center, moved, turns, 0.2)
    setup = Setup(rings, region, grid, radii, max_frequency=4.0)

    def loss(
        g, radius, speed, top, opening, log_alpha, center, reach, half_width, moved, turns, size
    ):
        here = setup.replace(
            curve=rings_of(radius, opening, center, moved, turns, size),
            region=ball(reach, top, center=center),
            grid=VolumeGrid((5, 4, 4), half_width, center),
            radii=speed * radii,
        )
        return jnp.sum(weights * reconstruct(here, g, jnp.exp(log_alpha), inversion="fourier"))

    at = (1.6, 1.0, 0.5, 0.97, -7.0, np.zeros(3), 0.8, np.full(3, 0.5))
    at = [jnp.asarray(value) for value in (*at, moved, turns, 0.2)]
    check_both_modes(loss, (g, *at))


def test_derivatives_of_a_cap_s_rings():
    """Of ∫ (1 + cos theta) dS = π R² (1 + cos opening)², which Gauss rules have exactly."""

    def integral(radius, opening):
        cap = eqx.tree_at(lambda c: (c.radius, c.half_opening), CapProblem.cap, (radius, opening))
        return cap.ring_areas @ (1 + cap.cosines)

    top, slopes = 1 + np.cos(0.7), jax.grad(integral, (0, 1))(1.5, 0.7)
    exact = 2 * np.pi * 1.5 * top**2, -2 * np.pi * 1.5**2 * top * np.sin(0.7)
    np.testing.assert_allclose(slopes, exact, rtol=1e-12)


@pytest.mark.filterwarnings("ignore:.*miss the detectors")
def test_derivatives_in_any_positions_also_on_the_axis():
    """The gradient in each group of parameters along a random direction, against differences.

    Two detectors are on the axis of the spherical harmonics, where azimuths are none. One program
    gives value and gradient, and both differences are its values.
    """
    rng, radii = np.random.default_rng(12), 0.7 + 0.2 * np.arange(10)
    unit = rng.standard_normal((16, 3))
    unit[:2] = [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    center = np.array([0.01, 0.02, -0.01])
    at = (1.6 * unit + center, rng.uniform(1, 2, 16), center, np.array(0.8))
    at = [jax.device_put(value) for value in at]

    def where(points, weights, center, reach):
        return DetectorPoints(points, weights, center), ball(reach, center=center)

    sizes = Setup(*where(*at), VolumeGrid(4, 0.5), radii, max_frequency=2.4).sizes
    g, rule = jax.device_put(rng.standard_normal((16, 10))), tikhonov_rule(1e-3, 8)
    weights = rng.standard_normal((2, 1, 8, 2, sizes.n_directions // 2 + 1, sizes.n_orders))

    @jax.jit
    @jax.value_and_grad
    def loss(at):
        found, _ = solve_points(*where(*at), jax.device_put(radii), g, rule, sizes)
        return jnp.sum(weights[0] * found.real + weights[1] * found.imag)

    value, gradient = loss(at)
    for k, of_group in enumerate(gradient):
        direction = rng.standard_normal(of_group.shape)
        moved = [[*at[:k], at[k] + h * direction, *at[k + 1 :]] for h in (1e-5, -1e-5)]
        difference = float(loss(moved[0])[0] - loss(moved[1])[0]) / 2e-5
        found = float(np.sum(np.asarray(of_group) * direction))
        assert abs(found - difference) < 1e-6 * abs(difference) + 1e-7 * abs(float(value)), k


# --- sizes ---------------------------------------------------------------------------------------


def test_the_lowest_frequencies_alone():
    """A wave across the ball or less: the transform of a bell below lambda = 1."""
    cap, region, grid = spherical_cap(1.5, 1.1, 6, 12), ball(1.0), VolumeGrid(4)
    radii, bell = cap_radii(cap, region, 0.1), SolidBells([[0.1, 0.0, -0.1]], [0.7])
    g = bell.spherical_integrals(cap, radii)
    setup = Setup(cap, region, grid, radii, max_frequency=1.0)
    image = reconstruct(setup, g, 1e-10, low_pass=low_pass, inversion="fourier")
    exact = filtered(bell, 1.0, np.asarray(grid.points))
    assert np.abs(np.asarray(image) - exact).max() < 1e-3 * exact.max()


@pytest.mark.slow
def test_49_voxels_on_a_side_to_1e_5():
    """A cap that covers z_3 < 1 of R_g = 1.3, half the grid's step between radii."""
    cap, region, grid = spherical_cap(1.3, 1.0, 65, 156), ball(1.0), VolumeGrid(49)
    radii = cap_radii(cap, region, grid.spacing[0] / 2)
    bells = SolidBells([[0.1, -0.25, 0.2]], [0.6])
    g = bells.spherical_integrals(cap, radii)
    image = reconstruct(Setup(cap, region, grid, radii), g, 1e-8, inversion="fourier")
    error = np.abs(np.asarray(image - bells.volume(grid)))
    assert error[np.asarray(region.contains(grid.points))].max() < 1e-5


def test_back_projection_of_points_is_that_of_their_cap():
    """In any order; exact on a whole sphere, see the doctest of the cap's."""
    cap, radii = spherical_cap(1.3, 0.7, 6, 12), 0.3 + 0.1 * np.arange(20)
    rng = np.random.default_rng(3)
    g, x = rng.standard_normal((6, 12, 20)), rng.uniform(-0.4, 0.4, (5, 3))
    order = rng.permutation(72)
    flat = [np.asarray(v).reshape(72, -1)[order] for v in (cap.points, cap.weights, g)]
    points = DetectorPoints(flat[0], flat[1][:, 0])
    found = np.asarray(back_projection(points, radii, flat[2], x))
    wanted = np.asarray(back_projection(cap, radii, g, x))
    np.testing.assert_allclose(found, wanted, rtol=1e-10, atol=1e-12 * np.abs(wanted).max())
