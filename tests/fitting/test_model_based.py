"""Images with constraints: against other minimisers, exact images and differences."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize

import jaxtat
from jaxtat import model_based
from jaxtat.fitting import (
    FitCancelled,
    NoPenalty,
    Ridge,
    SecondOrderVariation,
    TotalVariation,
    cancelled_by,
)
from jaxtat.fitting.implicit import Problem, objective
from jaxtat.records import circular_integrals_to_pressure, condition_record

BELL = jaxtat.phantoms.Bells([[0.1, 0.2], [-0.3, -0.2]], [0.5, 0.6], [1.0, 0.7])
DISK = jaxtat.phantoms.Disks([[0.1, 0.1]], [0.5], [1.0])
LONG = {"max_steps": 3000}  # alike in most tests: another number makes another program


@pytest.fixture(scope="module")
def few():
    """Twelve detectors on an arc: far fewer data than pixels."""
    curve = jaxtat.circular_arc(1.3, 1.0, 12)
    return jaxtat.Setup(curve, jaxtat.disk(1.0), jaxtat.ImageGrid(17), max_frequency=10.0)


@pytest.fixture(scope="module")
def data(few):
    g = BELL.circular_integrals(few.curve, few.radii)
    return g + 0.03 * np.random.default_rng(1).standard_normal(g.shape)


@pytest.fixture(scope="module")
def matrix(few):
    """A on the pixels of the region."""
    inside = np.asarray(few.region.contains(few.grid.points)).ravel()
    return np.asarray(jaxtat.forward_operator(few).as_matrix())[:, inside], inside


@functools.partial(jax.jit, static_argnames="reshape")
def penalised(values, a, b, penalty, delta, where, reshape):
    """||a u - b||² / 2 + 0.05 P(u) of pixels u of the region, and its gradient."""

    def cost(values):
        images = jnp.zeros(np.prod(reshape)).at[where].set(values).reshape(1, *reshape)
        charged = jnp.sum(images**2) / 2
        if not isinstance(penalty, Ridge):
            charged = penalty.value(images, delta)
        return jnp.sum((a @ values - b) ** 2) / 2 + 0.05 * charged

    return jax.value_and_grad(cost)(values)


def error(setup, image, phantom):
    inside = setup.region.contains(setup.grid.points)
    off = jnp.where(inside, image - phantom.image(setup.grid), 0.0)
    return float(jnp.linalg.norm(off) / jnp.linalg.norm(phantom.image(setup.grid)))


def test_ridge_is_what_dense_equations_give(few, data, matrix):
    a, inside = matrix
    found = model_based(few, data, penalty=Ridge(), weight=0.3, noise=0.5, tolerance=1e-10)
    wanted = np.linalg.solve(a.T @ a / 0.25 + 0.3 * np.eye(inside.sum()), a.T @ data.ravel() / 0.25)
    assert found.converged
    assert_allclose(found.image.ravel()[inside], wanted, atol=1e-7)
    assert_allclose(found.image.ravel()[~inside], 0, atol=0)
    left = np.linalg.norm(a @ wanted - data.ravel()) / np.linalg.norm(data)
    assert_allclose(found.residual, left, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("penalty", "nonnegative"),
    [
        (TotalVariation(smoothing=0.05), False),
        (TotalVariation(smoothing=0.05), True),
        (SecondOrderVariation(smoothing=0.05), False),
        (Ridge(), True),
    ],
    ids=["tv", "tv, nonnegative", "second order", "ridge, nonnegative"],
)
def test_minima_are_those_of_another_minimiser(few, data, matrix, penalty, nonnegative):
    """L-BFGS-B with a dense matrix; without noise rows are weighted by 1/√r."""
    a, inside = matrix
    rows = 1 / np.sqrt(np.broadcast_to(few.radii, few.data_shape)).ravel()
    a, b = a * rows[:, None], data.ravel() * rows
    options = {"nonnegative": nonnegative, "weight": 0.05, "tolerance": 3e-7, "max_steps": 9000}
    found = model_based(few, data, penalty=penalty, **options)
    assert found.converged
    # the size of the image, of which smoothing is a fraction
    where = np.flatnonzero(inside)
    kernel = np.zeros(17 * 17)
    kernel[where] = a.T @ a[:, np.searchsorted(where, 8 * 17 + 8)]  # of the pixel in the middle
    kernel = np.roll(np.pad(kernel.reshape(17, 17), (0, 8)), (-8, -8), (0, 1))
    delta = (
        getattr(penalty, "smoothing", 0.0) * np.abs(a.T @ b).max() / np.fft.fft2(kernel).real.max()
    )

    def cost(values):
        return penalised(values, a, b, penalty, delta, where, reshape=few.grid.shape)

    best = minimize(
        lambda u: tuple(map(np.asarray, cost(u))),
        np.zeros(inside.sum()),
        jac=True,
        method="L-BFGS-B",
        bounds=[(0.0 if nonnegative else None, None)] * int(inside.sum()),
        options={"maxiter": 20000, "maxfun": 40000, "ftol": 1e-15, "gtol": 1e-9},
    )
    ours = float(cost(found.image.ravel()[inside])[0])
    assert ours <= best.fun * (1 + 1e-6)
    assert_allclose(found.image.ravel()[inside], best.x, atol=5e-3)


def test_constraints_help_where_a_formula_does_not(few):
    g = DISK.circular_integrals(few.curve, few.radii)
    found = model_based(few, g, nonnegative=True, **LONG)
    plain = model_based(few, g, penalty=NoPenalty())
    assert float(found.image.min()) >= 0
    assert error(few, found.image, DISK) < 0.6 * error(few, plain.image, DISK)


@pytest.mark.slow
def test_the_weight_follows_the_noise(arc):
    """It is near the best one, on a phantom that it was not chosen on."""
    phantom = jaxtat.phantoms.Disks([[-0.2, 0.3], [0.3, -0.2]], [0.4, 0.3], [1.0, 0.6])
    exact = phantom.circular_integrals(arc.curve, arc.radii)
    for level in (0.05, 0.15):
        sigma = level * float(jnp.sqrt(jnp.mean(exact**2)))
        g = exact + sigma * np.random.default_rng(2).standard_normal(exact.shape)
        errors = [
            error(arc, model_based(arc, g, noise=sigma, weight=w, nonnegative=True).image, phantom)
            for w in (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
        ]
        for noise in (sigma, None):
            found = model_based(arc, g, noise=noise, nonnegative=True)
            assert found.converged
            assert error(arc, found.image, phantom) < 1.2 * min(errors)


@pytest.mark.filterwarnings("ignore::jaxtat.VisibilityWarning")
@pytest.mark.filterwarnings("ignore::jaxtat.steps.TooFewDetectors")
def test_no_image_of_zeros_balances_its_own_weight():
    """Small rods from few detectors: what a weight leaves unexplained asks for a larger one."""
    x = np.arange(-0.6, 0.61, 0.15)
    centers = np.array([(a, b) for a in x for b in x if a**2 + b**2 < 0.4])
    rods = jaxtat.phantoms.Disks(centers, np.full(len(centers), 0.04), np.ones(len(centers)))
    curve = jaxtat.circular_arc(1.3, 0.0, 12)
    setup = jaxtat.Setup(curve, jaxtat.disk(0.9), jaxtat.ImageGrid(65, 0.9), max_frequency=50.0)
    g = rods.circular_integrals(curve, setup.radii)
    exact = np.asarray(circular_integrals_to_pressure(g, setup.radii, setup.radii))
    record = exact + 0.1 * exact.std() * np.random.default_rng(0).standard_normal(exact.shape)
    options = {"nonnegative": True, "dtype": jnp.float32, "max_steps": 200}
    found = model_based(setup, record, times=setup.radii, **options)
    assert found.residual < 0.3


@pytest.mark.slow
def test_stacks_are_found_one_by_one_and_joint_ones_together(few, data):
    stack = jnp.stack([data, 2 * data, data[::-1]])
    found = model_based(few, stack, weight=0.05, **LONG)
    assert found.image.shape == (3, 17, 17) and found.converged.shape == (3,)
    assert_allclose(found.image[0], model_based(few, data, weight=0.05, **LONG).image, atol=1e-12)
    # two equal images share edges: √(d² + d²) = √2 d, so that each pays what it would pay alone
    options = {"tolerance": 1e-7, **LONG}
    alone = model_based(
        few, data, penalty=TotalVariation(smoothing=1e-2 / 2**0.5), weight=0.05, **options
    )
    shared = TotalVariation(smoothing=1e-2, joint=True)
    joint = model_based(
        few, jnp.stack([data, data]), penalty=shared, weight=0.05 * 2**0.5, **options
    )
    assert joint.steps.shape == () and joint.image.shape == (2, 17, 17)
    assert_allclose(joint.image, jnp.stack([alone.image, alone.image]), atol=1e-4)


def test_data_that_are_left_out_do_not_matter(few, data):
    mask = np.ones(few.data_shape, bool)
    mask[3], mask[7, :5] = False, False
    spoiled = np.where(mask, data, np.nan)
    options = {"weight": 0.05, "tolerance": 1e-6, **LONG}
    found = model_based(few, spoiled, mask=mask, **options)
    noise = np.where(mask, np.sqrt(few.radii), 1e12)  # as good as not there
    other = model_based(few, np.where(mask, data, 5.0), noise=noise, **options)
    assert_allclose(found.image, other.image, atol=1e-5)
    rows = model_based(few, data, mask=np.arange(12)[:, None] != 3, weight=0.05, **LONG)
    assert rows.converged


def test_short_records_are_fitted_and_refused_elsewhere():
    curve = jaxtat.circular_arc(1.3, 1.3, 64)
    whole = jaxtat.Setup(curve, jaxtat.disk(0.8), jaxtat.ImageGrid(21, 0.8))
    radii = whole.radii[whole.radii < 1.35]
    setup = jaxtat.Setup(curve, whole.region, whole.grid, radii)
    assert whole.complete and not setup.complete
    g = BELL.circular_integrals(curve, radii)
    # without a penalty the problem is ill-posed: where it stops would be a matter of rounding
    found = model_based(setup, g, penalty=Ridge(), weight=1e-3, tolerance=1e-5)
    assert found.converged and error(setup, found.image, BELL) < 0.015
    for refused in (jaxtat.solve, jaxtat.reconstruct):
        with pytest.raises(ValueError, match=r"radii run from .* model_based"):
            refused(setup, g)
    with pytest.raises(ValueError, match="model_based"):
        jaxtat.build_plan(setup)


def test_pressure_is_fitted_as_it_was_conditioned(few):
    """A band-passed record has lost the low frequencies that f >= 0 brings back."""
    setup = jaxtat.Setup(few.curve, few.region, few.grid, jaxtat.data_radii(
        few.curve, few.region, 1 / 32))  # fmt: skip
    times = jnp.linspace(0.0, 3.0, 300)
    g = BELL.circular_integrals(setup.curve, setup.radii)
    raw = circular_integrals_to_pressure(g, setup.radii, times)
    high_pass = functools.partial(condition_record, times=times, band=(0.5, 40.0), baseline=False)
    record = high_pass(raw)
    found = model_based(
        setup, record, times=times, conditioning=high_pass, nonnegative=True, weight=1e-4,
        max_steps=400,
    )  # fmt: skip
    assert found.residual < 0.05
    assert error(setup, found.image, BELL) < 0.15
    blind = model_based(setup, record, times=times, nonnegative=True, weight=1e-4, max_steps=400)
    assert blind.residual > 3 * found.residual  # of a model that does not know of the band


def test_a_proximal_map_of_ones_own_is_taken(few, data, matrix):
    """Ridge's, so that the answer f is known, with its derivative in a parameter.

    H f = A^T W² g with H = A^T W² A + weight, so that the derivative in the weight is -H^-1 f.
    """

    class Shrink(eqx.Module):
        strength: jax.Array

        def __call__(self, images, step):
            return images / (1 + self.strength * step)

    @jax.jit
    @functools.partial(jax.value_and_grad, has_aux=True)
    def size(strength):
        options = {"weight": 0.5, "tolerance": 1e-9, **LONG}
        image = model_based(few, data, penalty=Shrink(strength), **options).image
        return jnp.sum(image**2), image

    (_, own), slope = size(2.0)
    a, inside = matrix
    rows = 1 / np.broadcast_to(few.radii, few.data_shape).ravel()
    h = (a.T * rows) @ a + 2.0 * 0.5 * np.eye(inside.sum())
    wanted = np.linalg.solve(h, (a.T * rows) @ data.ravel())
    assert_allclose(own.ravel()[inside], wanted, atol=1e-6)
    assert_allclose(slope, -2 * 0.5 * wanted @ np.linalg.solve(h, wanted), rtol=1e-4)


@pytest.mark.slow
def test_derivatives_are_those_of_differences(few, data, check_both_modes):
    """In data, weight, noise, radii, detectors' radius and smoothing, in both modes.

    With f >= 0, so that some pixels are held at zero and others are free.
    """

    def image(g, log_weight, noise, radii, radius, smoothing, **options):
        return model_based(
            few.replace(curve=jaxtat.circular_arc(radius, 1.0, 12), radii=radii),
            g,
            penalty=TotalVariation(smoothing=smoothing),
            weight=10**log_weight,
            noise=noise,
            nonnegative=True,
            **options,
        ).image

    start = (data, -1.0, 0.4, few.radii, 1.3, 0.3)
    held = image(*start, **LONG)[few.region.contains(few.grid.points)] == 0
    assert 0.05 < float(held.mean()) < 0.95
    exact = functools.partial(image, tolerance=1e-10, max_steps=20000)
    check_both_modes(exact, start, step=1e-4, rtol=2e-4, atol=2e-5)


@pytest.mark.slow
def test_unrolled_steps_are_differentiated_as_they_are(few, data):
    """By reverse mode, for which they are."""

    @jax.jit
    @functools.partial(jax.value_and_grad, argnums=(0, 1), has_aux=True)
    def size(g, weight):
        found = model_based(few, g, weight=weight, steps=4, unrolled=True)
        return jnp.sum(found.image**2), found

    (_, unrolled), slopes = size(data, 0.1)
    assert int(unrolled.steps) == 4
    state = model_based(few, data, weight=0.1, max_steps=4, tolerance=1e-15)
    assert_allclose(unrolled.image, state.image, atol=1e-12)
    along = np.random.default_rng(7).standard_normal(data.shape), 1.0
    ends = [size(data + h * along[0], 0.1 + h * along[1])[0][0] for h in (1e-4, -1e-4)]
    found = sum(map(np.vdot, slopes, along))
    assert_allclose(found, (ends[0] - ends[1]) / 2e-4, rtol=1e-4)


def test_in_single_precision(few, data):
    options = {"penalty": Ridge(), "tolerance": 3e-3}  # rounding bounds how near it comes
    assert model_based(few, data, dtype=jnp.float32, **options).converged
    single = model_based(few, data, weight=0.05, dtype=jnp.float32).image
    assert_allclose(single, model_based(few, data, weight=0.05, **LONG).image, atol=2e-3)


def test_it_works_inside_jit_and_a_new_number_compiles_nothing(few, data):
    @jax.jit
    def image(g, weight):
        return model_based(few, g, weight=weight, nonnegative=True, **LONG).image

    plain = model_based(few, data, weight=0.05, nonnegative=True, **LONG)
    assert_allclose(image(data, 0.05), plain.image, atol=1e-10)
    image(2 * data, 0.01)
    assert image._cache_size() == 1


def test_progress_changes_nothing(few, data, capsys):
    shown = model_based(few, data, weight=0.05, progress=True, **LONG)
    assert "off=" in capsys.readouterr().err
    assert_allclose(shown.image, model_based(few, data, weight=0.05, **LONG).image, atol=0)
    assert np.isfinite(np.asarray(shown.history)).sum() == int(shown.steps)


def nan_later(images, step):
    """Fine for the first image, which is zero."""
    return jnp.where(jnp.any(images != 0), jnp.nan, images)


@pytest.mark.parametrize("nonnegative", [False, True])
def test_zeros_are_fitted_by_zeros_and_a_weight_may_be_zero(few, data, nonnegative):
    options = {"nonnegative": nonnegative, "max_steps": 40}
    zero = model_based(few, 0 * data, **options)
    assert zero.converged and not np.asarray(zero.image).any()
    plain = model_based(few, data, weight=0.0, **options)
    assert np.isfinite(np.asarray(plain.image)).all() and float(plain.residual) < 0.2


def test_the_highest_frequency_cannot_be_traced(few, data):
    with pytest.raises(ValueError, match="max_frequency is traced"):
        jax.jit(lambda highest: model_based(few, data, max_frequency=highest).image)(8.0)


def test_not_converged_is_said(few, data):
    early = model_based(few, data, weight=1e-3, max_steps=4)
    assert not early.converged and "too few steps to tell" in early.unsettled()
    late = model_based(few, jnp.stack([data, 2 * data]), weight=1e-3, max_steps=60, tolerance=1e-9)
    said = f"change it by some {100 * float(late.remaining.max()):.0f} %, most of that in "
    assert said in late.unsettled()
    assert ("wide parts, such as" in late.unsettled()) == (late.wide[late.remaining.argmax()] > 0.5)
    assert not model_based(few, data, penalty=NoPenalty(), max_steps=2).converged


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weight": -1.0}, "weight is -1"),
        ({"penalty": "tv"}, "penalty is 'tv', expected TotalVariation"),
        ({"penalty": TotalVariation}, "penalty is"),
        ({"penalty": lambda images, step: images}, "weight is None"),
        ({"penalty": lambda images, step: images[:, 1:], "weight": 1.0}, "same shape"),
        ({"penalty": lambda images, step: images / 0, "weight": 1.0}, "proximal map makes"),
        ({"penalty": nan_later, "weight": 1.0}, "proximal map gave NaN or infinite values in step"),
        ({"penalty": lambda images, step: np.asarray(images), "weight": 1.0}, "pure_callback"),
        ({"penalty": lambda images, step: (images, step), "weight": 1.0}, "makes a tuple"),
        ({"sound_speed": 1.5}, "without times"),
        ({"conditioning": lambda record: record}, "without times"),
        ({"mask": np.zeros((12, 1), bool)}, "mask is False everywhere"),
        ({"mask": np.ones((12, 1))}, "mask has dtype float64"),
        ({"mask": np.ones((5, 1), bool)}, "mask has shape"),
        ({"noise": 0.0}, "noise is"),
        ({"noise": np.ones(3)}, "noise has shape"),
        ({"tolerance": 0.0}, "tolerance is"),
        ({"max_steps": 0}, "max_steps is 0"),
        ({"max_frequency": 0.0}, "max_frequency is 0"),
        ({"max_frequency": np.nan}, "max_frequency is nan"),
        ({"max_frequency": "high"}, "max_frequency"),
        ({"steps": 3}, "steps= and unrolled=True"),
        ({"unrolled": True}, "steps= and unrolled=True"),
        ({"initial": np.zeros((3, 3))}, "initial has shape"),
        ({"dtype": int}, "dtype is"),
    ],
)
def test_bad_input_is_refused(few, data, change, message):
    with pytest.raises(ValueError, match=message):
        model_based(few, data, **change)
    with pytest.raises(ValueError, match="data has shape"):
        model_based(few, data[:, :-1])
    with pytest.raises(ValueError, match="data holds 1 NaN"):
        model_based(few, data.at[0, 0].set(np.nan))


def test_what_is_minimised_is_the_formula(few, data):
    """The objective from which derivatives come, spelled out with the operator."""
    from jaxtat.fitting.arguments import checked_data, data_fits
    from jaxtat.fitting.level import Scale

    (fit,) = data_fits(few, None, False, 0.5, None, None, None, [few.grid])
    whitened, *_ = checked_data(data, fit)
    scale = Scale(jnp.array(30.0), jnp.array(2.0))
    image = jnp.where(few.region.contains(few.grid.points), BELL.image(few.grid), 0.0)
    problem = Problem(fit, whitened, TotalVariation(), jnp.array(0.1), scale)
    misfit = jnp.sum((jaxtat.forward_operator(few)(image) - data) ** 2) / 0.5**2 / 2
    variation = TotalVariation().value(image[None], 1e-3 * scale.image)
    wanted = (misfit + 0.1 * variation) / scale.square
    assert_allclose(objective(problem, image[None]), wanted, rtol=1e-9)


@pytest.mark.parametrize("factor", [2.0**600, 2.0**-600, 1e200, 1e-200])
@pytest.mark.parametrize("known", [False, True])
def test_images_are_in_proportion_to_their_data(arc, factor, known):
    """To the last bit for a power of two; else rounding differs from the first step on."""
    data = BELL.circular_integrals(arc.curve, arc.radii)
    size = 0.02 * float(data.max()) if known else None
    options = {"nonnegative": True, "max_steps": 30}
    one = model_based(arc, data, noise=size, **options)
    many = model_based(arc, factor * data, noise=factor * size if known else None, **options)
    exact = np.log2(factor) % 1 == 0
    assert_allclose(many.image / factor, one.image, rtol=0, atol=0 if exact else 1e-9)
    assert_allclose(many.residual, one.residual, rtol=1e-9)
    assert int(many.steps) == int(one.steps)


def test_data_that_single_precision_cannot_hold_are_refused(arc):
    data = BELL.circular_integrals(arc.curve, arc.radii)
    with pytest.raises(ValueError, match=r"data are as large as .*e\+.*leave out dtype"):
        model_based(arc, 1e200 * data, dtype=jnp.float32)


def test_a_fit_that_is_cancelled_ends_soon_and_one_that_is_not_is_the_same(few, data):
    looks = []

    def asked():
        looks.append(1)
        return len(looks) == 3

    options = {"nonnegative": True, "tolerance": 1e-12, **LONG}
    with pytest.raises(FitCancelled), cancelled_by(asked):
        model_based(few, data, **options)
    assert len(looks) == 3
    options["tolerance"] = 1e-3
    alone = model_based(few, data, **options)
    told = []
    with cancelled_by(lambda: False, told.append):
        looked = model_based(few, data, **options)
    # one iteration of two steps follows the last one that is told
    assert f": step {int(looked.steps) - 2}, off by " in told[-1]
    assert looked.steps == alone.steps and jnp.array_equal(looked.image, alone.image)


@pytest.mark.slow
@pytest.mark.parametrize(
    "options", [{"nonnegative": True}, {"penalty": Ridge(), "weight": 1e-3}, {"dtype": jnp.float32}]
)
def test_a_start_worse_than_zeros_is_no_start(few, data, options):
    options = {"max_steps": 100} | options
    from_zeros = model_based(few, data, initial=np.zeros(few.grid.shape), **options)
    for size in (1e3, 1e30, -1e300, 1e300):
        found = model_based(few, data, initial=np.full(few.grid.shape, size), **options)
        assert_allclose(found.image, from_zeros.image, atol=1e-12 * abs(from_zeros.image).max())
        assert found.steps == from_zeros.steps
