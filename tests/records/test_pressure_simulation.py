"""Simulated records against exact waves, other people's data, and the way back."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from test_pressure import gaussian_integrals, gaussian_wave

import jaxtat
from jaxtat import AccuracyWarning
from jaxtat.forward import circle_integrals, circle_sizes
from jaxtat.records import circular_integrals_to_pressure, pressure_to_circular_integrals
from jaxtat.records.pressure_simulation import pressure_matrix

RADII = 0.025 * (1 + np.arange(90))
MODELS = ["2d", "in-plane"]


@pytest.mark.parametrize(("speed", "end"), [(1.0, 4.0), (1500.0, 2.0e-3)])
def test_two_dimensional_waves_are_the_exact_ones(speed, end):
    times = np.linspace(0, end, 101)
    record = circular_integrals_to_pressure(
        gaussian_integrals(RADII)[None], RADII, times, sound_speed=speed
    )
    assert np.abs(np.asarray(record[0]) - gaussian_wave(speed * times)).max() < 1e-7


def test_records_are_those_of_poissons_formula():
    """∂_s (1/2π) ∫ g / √(s² - r²) dr by quadrature, with the derivative under the integral."""

    def g(r):
        return np.exp(-(((r - 1.0) / 0.12) ** 2))

    def exact(s):  # r = s sin a, so that the integral is that of g(s sin a)
        def slope(a):
            return -2 * (s * np.sin(a) - 1) / 0.12**2 * g(s * np.sin(a)) * np.sin(a)

        return quad(slope, 0, np.pi / 2, epsabs=1e-13, limit=200)[0] / (2 * np.pi)

    times = np.array([0.0, 0.7, 1.0, 1.3, 3.0])
    record = circular_integrals_to_pressure(g(RADII)[None], RADII, times)
    assert np.allclose(record[0], [exact(t) for t in times], atol=1e-10)


def test_in_plane_records_are_the_slope_of_the_means():
    times = np.linspace(0, 2.0, 57)
    c = 1.1

    def mean(r):
        return np.exp(-(((r - 1.0) / 0.12) ** 2))

    record = circular_integrals_to_pressure(
        (RADII * mean(RADII))[None], RADII, times, sound_speed=c, model="in-plane"
    )
    exact = -2 * (c * times - 1.0) / 0.12**2 * mean(c * times)
    assert np.allclose(record[0], exact, atol=1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_there_and_back(model):
    """Integrals, record, integrals; then from the record, which is band-limited, and back to it."""
    times = np.linspace(0, 6, 601)
    g = gaussian_integrals(RADII)[None]
    record = circular_integrals_to_pressure(g, RADII, times, model=model)
    again = pressure_to_circular_integrals(record, times, RADII, model=model)
    assert np.abs(again - g).max() < 1e-9
    once_more = circular_integrals_to_pressure(again, RADII, times, model=model)
    assert np.abs(once_more - record).max() < 1e-7


@pytest.mark.parametrize("data_file", ["full_circle_64_detectors.npz"], indirect=True)
def test_records_are_those_of_another_code(data_file):
    """From the image that comes with them: 2-D waves, unit circle, speed 1, 0 to 6 inclusive."""
    with np.load(data_file) as file:
        theirs, truth = file["pressure"][:, ::16].T, file["truth"].T  # rows are x2
    angles = 2 * np.pi * np.arange(0, 64, 16) / 64
    curve = jaxtat.detector_curve(np.stack([np.cos(angles), np.sin(angles)], axis=1), closed=True)
    radii = jnp.arange(1, 2 * 257) / 256
    grid = jaxtat.ImageGrid(257)
    sizes = circle_sizes(curve, grid)
    g = circle_integrals(curve, grid, radii, sizes, None, 1e-9)(jnp.asarray(truth[None], float))[0]
    record = circular_integrals_to_pressure(g, radii, np.linspace(0, 6, theirs.shape[1]))
    assert np.linalg.norm(record - theirs) < 0.01 * np.linalg.norm(theirs)


@pytest.mark.parametrize("model", MODELS)
def test_the_adjoint_passes_the_dot_test(model):
    radii, times = 0.1 * (1 + np.arange(16)), np.linspace(0, 3, 25)

    def simulate(g):
        return circular_integrals_to_pressure(g, radii, times, model=model)

    rng = np.random.default_rng(0)
    g, p = (rng.standard_normal((2, 3, n)) for n in (16, 25))
    g[..., [0, -1]] = 0.0
    (adjoint,) = jax.linear_transpose(simulate, jnp.asarray(g))(jnp.asarray(p))
    assert np.isclose(np.sum(simulate(g) * p), np.sum(g * adjoint), rtol=1e-12)


@pytest.mark.parametrize("model", MODELS)
def test_derivatives_in_integrals_and_sound_speed(model, check_both_modes):
    radii, times = 0.1 * (1 + np.arange(16)), np.linspace(0, 1.5, 25)
    g = jnp.asarray(np.exp(-(((radii - 0.8) / 0.2) ** 2)))[None]

    @jax.jit
    def simulate(g, speed):
        return circular_integrals_to_pressure(g, radii, times, sound_speed=speed, model=model)

    assert np.allclose(
        simulate(g, 1.1),
        circular_integrals_to_pressure(g, radii, times, sound_speed=1.1, model=model),
    )
    check_both_modes(simulate, (g, 1.1), rtol=1e-4)


def test_a_traced_speed_too_high_for_the_panels_gives_nan_not_a_wrong_record():
    g = gaussian_integrals(RADII)[None]

    @jax.jit
    def simulate(speed):
        return circular_integrals_to_pressure(g, RADII, np.linspace(0, 4, 9), sound_speed=speed)

    wanted = circular_integrals_to_pressure(g, RADII, np.linspace(0, 4, 9), sound_speed=2.2)
    assert np.allclose(simulate(2.2), wanted, atol=1e-12)
    assert np.isnan(simulate(2.6)).all()


def test_missing_ends_are_said():
    with pytest.warns(AccuracyWarning, match="first or last radius"):
        circular_integrals_to_pressure(gaussian_integrals(RADII)[None, :50], RADII[:50], [1.0])


@pytest.mark.parametrize("model", MODELS)
def test_before_the_laser_fires_nothing_is_recorded(model):
    """The waves are even in time, the record is not."""
    radii, times = np.linspace(0.1, 2.0, 40), np.linspace(-1.0, 2.0, 31)
    matrix = np.asarray(pressure_matrix(radii, times, model=model))
    assert not matrix[times < 0].any()
    wanted = pressure_matrix(radii, times[times >= 0], model=model)
    np.testing.assert_allclose(matrix[times >= 0], wanted, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"integrals": np.zeros((3, 89))}, "integrals has shape"),
        ({"integrals": np.full((3, 90), np.nan)}, "NaN"),
        ({"radii": RADII - 0.025}, "radii is"),
        ({"radii": RADII**2}, "radii have steps"),
        ({"radii": RADII[:4], "integrals": np.zeros((3, 4))}, "got 4 radii"),
        ({"times": [-2.0, -1.0]}, "times are -1 at most"),
        ({"times": np.zeros(0)}, "times are none"),
        ({"sound_speed": 0.0}, "sound_speed is 0"),
        ({"model": "3d"}, "expected '2d' or 'in-plane'"),
    ],
)
def test_bad_arguments_are_refused(change, message):
    arguments = {"integrals": np.zeros((3, 90)), "radii": RADII, "times": [0.0, 1.0]} | change
    with pytest.raises(ValueError, match=message):
        circular_integrals_to_pressure(**arguments)


def test_traced_radii_and_times_are_refused():
    g = np.zeros((1, 90))
    with pytest.raises(ValueError, match="radii are traced"):
        jax.jit(lambda r: circular_integrals_to_pressure(g, r, [1.0]))(RADII)
    with pytest.raises(ValueError, match="times are traced"):
        jax.jit(lambda t: circular_integrals_to_pressure(g, RADII, t))(jnp.ones(2))
