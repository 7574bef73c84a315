"""Rules for alpha: against their definitions, and against the best constant one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import (
    NoiseLevel,
    NormBound,
    Tikhonov,
    TikhonovNormBound,
    circular_arc,
    disk,
    phantoms,
    reconstruct,
    solve,
)
from jaxtat.densities.cylindrical_waves import (
    RuleInputs,
    polar_geometry,
    solve_cylindrical_waves,
    wave_orders,
    wave_table,
)
from jaxtat.densities.single_layer import plane_wave_traces, potential_matrix
from jaxtat.regularization import single_crossing, tikhonov_rule
from jaxtat.regularization.alpha import FrequencyData, _alpha_of_matrix
from jaxtat.special import full_circle_norm
from jaxtat.steps import radial_transform

matrix_of, traces_of = jax.jit(potential_matrix), jax.jit(plane_wave_traces)
FREQUENCIES = jnp.array([3.0, 9.0])
N = 40
ARC, DISK = circular_arc(1.5, 1.1, N, angle=0.4), disk(1.0, n_boundary=160)
HALF_ARC = circular_arc(1.5, 0.1, N, angle=0.4)
HALF, ASKEW = (disk(1.0, 0.1, n_boundary=160, angle=angle) for angle in (0.4, 0.7))
NORMS = full_circle_norm(FREQUENCIES, 1.5)
ORDERS = int(wave_orders(polar_geometry(ARC, DISK), np.asarray(FREQUENCIES)).max())


@jax.jit
def zeros_solved(polar, table, rule, norms):
    """alpha of a rule that does not look at the data."""
    n = polar.detector_angles.shape[0]
    inputs = RuleInputs(jnp.ones(2), norms, rule)
    nothing = jnp.zeros((2, 1, 2, n))
    groups = ((0, 2, ORDERS),)
    return solve_cylindrical_waves(polar, table, groups, nothing, inputs)[1]


def alphas(curve, region, alpha, norms=NORMS):
    rule = tikhonov_rule(alpha, 2)
    polar = polar_geometry(curve, region, offset=(0.0, 0.0))
    return zeros_solved(polar, wave_table(polar, FREQUENCIES, ORDERS), rule, norms)


def diagonal_problem(values):
    """What a rule sees of a diagonal A A^T with plane waves that are white."""
    values = jnp.asarray(values)
    return FrequencyData(
        matrix=jnp.diag(values)[None],
        plane=jnp.eye(len(values))[None],
        diagonal=values[None],
        unit_norm=jnp.array(2.0),
        data_power=jnp.array(5.0),
        noise_power=jnp.array(0.25),
        single_crossing=single_crossing(jnp.array(3.0)),
        unit=values.max(),
        n_data=8,
    )


def test_numbers_are_relative_to_the_largest_diagonal_entry():
    """One for all frequencies or one for each; on a disk the diagonal is known in closed form."""
    problem = diagonal_problem([4.0, 2.0])
    assert Tikhonov(1e-3).absolute(problem) == 4e-3
    each = alphas(ARC, DISK, [1e-4, 1e-6])
    np.testing.assert_allclose(each.relative_alpha, [1e-4, 1e-6], rtol=1e-12)
    one = alphas(ARC, DISK, 1e-6)
    np.testing.assert_allclose(each.alpha / one.alpha, [100.0, 1.0], rtol=1e-12)
    # no diagonal entry exceeds the largest eigenvalue, and the largest is of its size
    for lam, alpha in zip(FREQUENCIES, one.alpha, strict=True):
        sigma = np.linalg.svd(matrix_of(lam, ARC, DISK), compute_uv=False)
        assert 0.1 * sigma[0] ** 2 < alpha / 1e-6 <= sigma[0] ** 2


def test_noise_level_is_noise_over_signal():
    """sigma² noise / tau² with tau² tr(A A^T) = |data|² - |noise|²; more noise, more alpha."""
    problem = diagonal_problem([4.0, 2.0])
    noise = 0.3**2 * 0.25
    signal = (8 * 5.0 - 8 * noise) / 6.0
    np.testing.assert_allclose(NoiseLevel(0.3).absolute(problem), noise / signal, rtol=1e-12)
    found = [float(NoiseLevel(sigma).absolute(problem)) for sigma in (1e-3, 0.1, 3.0, 5.0, 50.0)]
    assert (np.diff(found) >= 0).all() and np.isfinite(found).all()


BELLS = phantoms.Bells([[0.3, 0.1], [-0.35, -0.2], [0.0, 0.5]], [0.3, 0.4, 0.25], [1, -0.6, 0.8])


@pytest.fixture(scope="module")
def noisy(arc):
    """A problem, data with white noise of 3 % of the largest value, and its standard deviation."""
    exact = BELLS.circular_integrals(arc.curve, arc.radii)
    sigma = 0.03 * float(exact.max())
    noise = sigma * np.random.default_rng(0).standard_normal(exact.shape)
    return arc, exact + noise, sigma


def test_noise_level_by_brute_force(noisy):
    """alpha of the whole pipeline from traces of the boundary matrix and sums over all data."""
    setup, g, sigma = noisy
    curve, region, radii = setup.curve, setup.region, setup.radii
    report = solve(setup, g, NoiseLevel(sigma)).report
    for i in (0, 9, 19):
        lam = setup.frequencies[i]
        transform = radial_transform(jnp.eye(len(radii))[:, None], radii, lam[None])[:, 0, :, 0]
        root = np.sqrt(np.asarray(curve.weights))
        data = np.asarray(jnp.einsum("kr,rj->jk", g, transform)) * root
        noise = sigma**2 * (root**2).sum() * (np.asarray(transform) ** 2).sum()
        trace = np.sum(np.asarray(matrix_of(lam, curve, region)) ** 2)
        signal = max((data**2).sum() - noise, 0.01 * noise) / trace
        per_datum = noise / data.size
        np.testing.assert_allclose(report.alpha[i], per_datum / signal, rtol=1e-6)


@pytest.mark.filterwarnings("ignore:detectors are too few")  # the least alphas: noise, and so said
def test_noise_level_is_nearly_the_best_alpha(noisy):
    """The error of the image is within 20 % of that of the best constant alpha."""
    setup, g, sigma = noisy
    inside, exact = setup.region.contains(setup.grid.points), BELLS.image(setup.grid)

    def error(alpha):
        return float(jnp.linalg.norm((reconstruct(setup, g, alpha) - exact)[inside]))

    scanned = [error(alpha) for alpha in np.logspace(-6, 1, 15)]
    best = min(scanned)
    assert 0 < scanned.index(best) < 14 and max(scanned) > 1.5 * best
    assert error(NoiseLevel(sigma)) < 1.2 * best


def mean_norm(lam, curve, region, alpha):
    """Root mean square of ||rho|| over all directions.

    With rho = A^T (A A^T + alpha)^-1 u, A and u at points of the boundary.
    """
    angles = jnp.arange(90) * 2 * jnp.pi / 90
    a = np.asarray(matrix_of(lam, curve, region))
    u = np.asarray(traces_of(lam, angles, region))
    rho = a.T @ np.linalg.solve(a @ a.T + float(alpha) * np.eye(len(a)), u)
    return np.sqrt(np.mean(np.sum(np.abs(rho) ** 2, axis=0)))


@pytest.mark.parametrize("K", [1.0, 1.2])
@pytest.mark.parametrize(("curve", "region"), [(ARC, DISK), (ARC, ASKEW)], ids=["disk", "askew"])
def test_norm_bound_is_the_mean_norm_of_the_densities(curve, region, K):
    """Densities by brute force have the norm K N(lambda) on average."""
    report = alphas(curve, region, TikhonovNormBound(K))
    for lam, alpha, norm in zip(FREQUENCIES, report.alpha, NORMS, strict=True):
        np.testing.assert_allclose(mean_norm(lam, curve, region, alpha), K * norm, rtol=1e-6)


def test_norm_bound_out_of_reach():
    """A norm that is never reached gives the least alpha, a vanishing one the largest."""
    report = alphas(ARC, DISK, TikhonovNormBound(1e30))
    assert (report.relative_alpha < 1e-13).all()
    report = alphas(ARC, DISK, TikhonovNormBound(1e-30))
    assert (report.relative_alpha > 1).all()


def test_derivatives_of_the_norm_bound():
    """On a mirrored full circle, in K and R_g, against finite differences."""

    @jax.jit
    def found(parameters):
        K, radius = parameters
        norms = full_circle_norm(FREQUENCIES, radius, 60)
        circle = circular_arc(radius, 2 * radius, N)
        return jnp.log(alphas(circle, DISK, TikhonovNormBound(K), norms).alpha)

    point = jnp.array([0.6, 1.5])
    slopes = jax.jit(jax.jacfwd(found))(point)
    for i in (0, 1):
        step = 1e-4 * np.eye(2)[i]
        difference = (found(point + step) - found(point - step)) / 2e-4
        np.testing.assert_allclose(slopes[:, i], difference, rtol=1e-6)
    assert (jnp.abs(slopes) > 1e-2).all()


def test_derivatives_where_eigenvalues_coincide(check_both_modes):
    """Any change of matrix and plane waves, where eigenvectors have no derivative."""
    rng = np.random.default_rng(0)
    turn, _ = np.linalg.qr(rng.standard_normal((4, 4)))
    matrix = jnp.asarray(turn @ np.diag([3.0, 1.0, 1.0, 0.2]) @ turn.T)[None]
    root = jnp.asarray(rng.standard_normal((1, 4, 4)))

    def found(change, root, square):
        symmetric = matrix + change + jnp.swapaxes(change, -1, -2)
        return jnp.log(_alpha_of_matrix(symmetric, root @ jnp.swapaxes(root, -1, -2), square))

    for square in (0.5, 3.0):
        check_both_modes(found, (jnp.zeros((1, 4, 4)), root, square), rtol=1e-6, atol=1e-6)


def test_derivatives_at_a_tiny_alpha():
    """At a bound of three norms alpha is 1e-11 of the diagonal, and its derivative still exact."""
    found = jax.jit(lambda K: jnp.log(alphas(ARC, DISK, TikhonovNormBound(K)).alpha))
    slope = jax.jacfwd(found)(jnp.array(3.0))
    np.testing.assert_allclose(slope, (found(3.0003) - found(2.9997)) / 6e-4, rtol=1e-5)
    assert (slope < -1).all()


def test_refusals(noisy):
    for bad, message in (
        (-1.0, "above zero"),
        ([1e-3, 0.0], "above zero"),
        (jnp.ones(3), "one per frequency"),
        (jnp.ones((2, 1)), "one per frequency"),
        (NoiseLevel(jnp.ones(3)), "one per frequency"),
        (np.inf, "infinite"),
        ("much", "rule is 'much', expected alpha, a number or one for each frequency, or a rule"),
    ):
        with pytest.raises(ValueError, match=message):
            tikhonov_rule(bad, 2)
    for sigma in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="sigma"):
            NoiseLevel(sigma)
    with pytest.raises(ValueError, match=r"or TikhonovNormBound\(K\) here"):
        tikhonov_rule(NormBound(3.0), 2)
