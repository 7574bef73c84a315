"""Pressure records against exact waves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import i0e, j0

from jaxtat.records import condition_record, pressure_to_circular_integrals

WIDTH, DISTANCE = 0.1, 1.3
RADII = np.linspace(0.9, 1.7, 9)


def gaussian_wave(times):
    """2-D wave from exp(-|x|²/2a²) at a distance d: ∫ a² e^{-a²k²/2} J0(kd) cos(kt) k dk."""
    k = np.linspace(0, 9 / WIDTH, 20001)
    spectrum = WIDTH**2 * np.exp(-((WIDTH * k) ** 2) / 2) * j0(k * DISTANCE) * k
    return np.array([np.trapezoid(spectrum * np.cos(k * t), k) for t in times])


def gaussian_integrals(radii):
    """2π r exp(-(d² + r²)/2a²) I0(d r/a²)."""
    scaled = DISTANCE * radii / WIDTH**2
    return 2 * np.pi * radii * np.exp(-((DISTANCE - radii) ** 2) / (2 * WIDTH**2)) * i0e(scaled)


@pytest.mark.parametrize(("speed", "end"), [(1.0, 3.0), (1500.0, 2.0e-3)])
def test_two_dimensional_waves_give_exact_circular_integrals(speed, end):
    times = np.linspace(0, end, 400)
    record = gaussian_wave(speed * times)
    g = pressure_to_circular_integrals(record[None], times, RADII, sound_speed=speed)
    assert np.abs(np.asarray(g[0]) - gaussian_integrals(RADII)).max() < 2e-6


@pytest.mark.parametrize("model", ["2d", "in-plane"])
@pytest.mark.parametrize("off", [0.0, 0.3, 0.7])
def test_samples_before_the_laser_fires_do_not_count(model, off):
    """Whatever they hold; also where no sample is taken at time 0."""
    step = 3.0 / 600
    times = step * (np.arange(-40, 601) + off)
    record = np.where(times < -step / 2, 7.0, gaussian_wave(times))
    found = pressure_to_circular_integrals(record[None], times, RADII, model=model)
    late = times > 0.5
    wanted = pressure_to_circular_integrals(record[None, late], times[late], RADII, model=model)
    assert np.abs(np.asarray(found - wanted)).max() < 1e-4 * np.abs(np.asarray(wanted)).max()


def test_records_that_start_late_count_as_zero_before():
    times = np.linspace(0, 3.0, 601)
    record = gaussian_wave(times) * (times > 0.5)
    whole = pressure_to_circular_integrals(record[None], times, RADII)
    late = pressure_to_circular_integrals(record[None, 60:], times[60:], RADII)
    assert np.allclose(whole, late, atol=1e-12)


def test_records_may_end_at_the_largest_radius():
    times = np.linspace(0, 1.7, 800)
    g = pressure_to_circular_integrals(gaussian_wave(times)[None], times, RADII)
    assert np.abs(np.asarray(g[0]) - gaussian_integrals(RADII)).max() < 1e-5


def test_in_plane_model_integrates_the_record():
    times = np.linspace(0, 2.0, 300)
    c = 1.2

    def p(tau):
        return np.exp(-(((tau - 1.0) / 0.2) ** 2)) * (tau - 1.0)

    g = pressure_to_circular_integrals(
        p(c * times)[None], times, RADII, sound_speed=c, model="in-plane"
    )
    exact = [r * quad(p, 0, r, epsabs=1e-14)[0] for r in RADII]
    assert np.allclose(g[0], exact, atol=1e-9)


@pytest.mark.parametrize("model", ["2d", "in-plane"])
def test_waves_beyond_the_highest_frequency_do_not_count(model):
    times = np.linspace(0, 3, 200)
    slow, fast = (np.cos(np.pi / 3 * m * times)[None] for m in (7, 120))
    found = pressure_to_circular_integrals(
        slow + fast, times, RADII, model=model, max_frequency=30.0
    )
    wanted = pressure_to_circular_integrals(slow, times, RADII, model=model)
    assert np.abs(np.asarray(found - wanted)).max() < 1e-11


def test_batches_are_converted_alike():
    times = np.linspace(0, 3, 200)
    batch = np.random.default_rng(0).standard_normal((2, 3, 4, 200))
    g = pressure_to_circular_integrals(batch, times, RADII)
    assert g.shape == (2, 3, 4, 9)
    assert np.allclose(g[1, 2], pressure_to_circular_integrals(batch[1, 2], times, RADII))


@pytest.mark.parametrize("model", ["2d", "in-plane"])
def test_derivatives_in_record_radii_and_sound_speed(model, check_both_modes):
    times = np.linspace(0, 3, 60)
    record = jnp.asarray(gaussian_wave(times))[None]

    def g(record, radii, speed):
        return pressure_to_circular_integrals(record, times, radii, sound_speed=speed, model=model)

    arguments = (record, jnp.asarray(RADII), jnp.array(1.1))
    check_both_modes(g, arguments, rtol=1e-4, order=2)
    if model == "2d":
        slope = jax.jit(jax.grad(lambda r: g(record, r, 1.0)[0].sum()))(RADII)
        step = 1e-5
        exact = (gaussian_integrals(RADII + step) - gaussian_integrals(RADII - step)) / (2 * step)
        assert np.allclose(slope, exact, atol=1e-3)


def test_conditioning_removes_offset_drift_and_start_but_keeps_the_signal():
    rate, n = 40e6, 2000
    times = np.arange(n) / rate
    signal = np.exp(-(((times - 25e-6) / 2e-6) ** 2)) * np.sin(2 * np.pi * 2e6 * times)
    drift = 300 + 50 * times / times[-1]
    spike = 4000 * (times < 1e-6)
    clean = condition_record(
        (signal + drift + spike)[None], times, dead_time=1.5e-6, band=(2e5, 8e6)
    )[0]
    assert np.abs(np.asarray(clean) - signal)[200:-200].max() < 0.05
    assert np.abs(np.asarray(clean))[:40].max() < 5.0


def test_conditioning_without_a_band_only_centres_and_fades():
    times = np.arange(400) / 40e6
    signal = np.sin(2 * np.pi * 2e6 * times)
    clean = np.asarray(condition_record((signal + 512)[None], times, dead_time=5e-7)[0])
    assert np.all(clean[:20] == 0)
    assert np.allclose(clean[60:], signal[60:], atol=1e-9 + abs(np.median(signal[20:])))


def test_band_pass_has_the_response_it_states():
    times = np.arange(4000) / 40e6
    for frequency in (2e5, 1e6, 8e6):
        wave = np.sin(2 * np.pi * frequency * times)
        passed = np.asarray(condition_record(wave[None], times, band=(2e5, 8e6), order=3)[0])
        middle = slice(1600, 2400)
        gain = np.linalg.norm(passed[middle]) / np.linalg.norm(wave[middle])
        response = (1 + (2e5 / frequency) ** 6) * (1 + (frequency / 8e6) ** 6)
        assert abs(gain - response**-0.5) < 0.02


def test_conditioning_has_derivatives(check_both_modes):
    times = jnp.arange(64) / 64.0
    record = jnp.asarray(np.random.default_rng(3).standard_normal((1, 64)))

    def clean(record, low, high):
        return condition_record(record, times, dead_time=0.1, band=(low, high))

    check_both_modes(clean, (record, 2.0, 20.0))


def test_equal_samples_share_the_derivative_of_a_median():
    """An offset that counts or silence have in common is taken away, whatever its derivative."""
    times = np.arange(48) / 48.0

    @jax.jit
    def slopes(record):
        def clean(p):
            return condition_record(p, times)

        _, forward = jax.jvp(clean, (record,), (jnp.ones((1, 48)),))
        return forward, jax.grad(lambda p: clean(p)[0, 0])(record)

    for record in (np.zeros((1, 48)), np.random.default_rng(3).integers(0, 9, (1, 48))):
        forward, back = map(np.asarray, slopes(record * 1.0))
        assert np.abs(forward).max() < 1e-12
        alike = record[0, 1:16] == np.median(record[0, :16])
        assert len(np.unique(np.round(back[0, 1:16][alike], 12))) <= 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pressure": np.zeros((3, 99))}, "pressure has shape"),
        ({"pressure": np.full((3, 100), np.inf)}, "infinite"),
        ({"times": np.linspace(0, 3, 100) ** 2}, "expected equal"),
        ({"times": np.linspace(3, 0, 100)}, "expected equal"),
        ({"times": np.linspace(-3, 0, 100)}, "times end at 0, expected samples after t = 0"),
        ({"radii": np.linspace(1, 4, 5)}, "the record ends at 3"),
        ({"radii": np.linspace(0, 1, 5)}, "radii is"),
        ({"sound_speed": 0.0}, "sound_speed is 0"),
        ({"sound_speed": 1e-3}, "check the units"),
        ({"model": "3d"}, "expected '2d' or 'in-plane'"),
        ({"max_frequency": 0.0}, "max_frequency is 0"),
        ({"max_frequency": np.nan}, "max_frequency is nan, expected a number"),
    ],
)
def test_bad_records_are_refused(change, message):
    arguments = {
        "pressure": np.zeros((3, 100)),
        "times": np.linspace(0, 3, 100),
        "radii": RADII,
        "sound_speed": 1.0,
        "model": "2d",
    } | change
    with pytest.raises(ValueError, match=message):
        pressure_to_circular_integrals(
            arguments.pop("pressure"), arguments.pop("times"), arguments.pop("radii"), **arguments
        )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"band": (0.3, 0.2)}, "expected 0 <= f_lo < f_hi"),
        ({"band": (2e5, 7e6)}, "cycles per unit of times"),
        ({"band": (0.0, 1e-6)}, "cycles per unit of times"),
        ({"dead_time": 50.0}, "same unit as times"),
        ({"dead_time": -1.0}, "same unit as times"),
        ({"order": 0}, "order is 0"),
    ],
)
def test_conditioning_in_the_wrong_unit_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        condition_record(np.zeros((1, 50)), np.arange(50.0), **options)


def test_nothing_asked_changes_nothing():
    record = np.exp(-np.arange(50.0) / 9)[None]
    assert np.array_equal(condition_record(record, np.arange(50.0), baseline=False), record)


def test_memory_does_not_grow_with_the_square_of_the_samples():
    from jaxtat.records.pressure import _convert

    times, radii = jnp.arange(20_000) / 1e4, jnp.linspace(0.5, 1.0, 9)
    where = times, times[-1], radii, 1.0, 20_000
    lowered = _convert.lower(jnp.zeros((1, 20_000)), *where, "2d", 79)
    assert lowered.compile().memory_analysis().temp_size_in_bytes < 200e6


def test_times_in_another_unit_than_the_speed_are_refused():
    times = np.arange(200) / 40e6
    radii, record = 1e-4 * np.arange(1, 71), np.zeros((3, 200))
    pressure_to_circular_integrals(record, times, radii, sound_speed=1500.0)
    with pytest.raises(
        ValueError, match=r"70 radii lie within 0\.0069, .* a sample is 37\.5: check"
    ):
        pressure_to_circular_integrals(record, 1e6 * times, radii, sound_speed=1500.0)


def test_records_are_checked_inside_jit_too():
    times = np.linspace(0, 3.0, 60)

    @jax.jit
    def g(record):
        clean = condition_record(record, times, dead_time=0.2, band=(0.5, 5.0))
        return pressure_to_circular_integrals(clean, times, RADII, sound_speed=1.1)

    record = np.random.default_rng(0).standard_normal((1, 60))
    outside = condition_record(record, times, dead_time=0.2, band=(0.5, 5.0))
    outside = pressure_to_circular_integrals(outside, times, RADII, sound_speed=1.1)
    assert np.allclose(g(record), outside, atol=1e-12)
    with pytest.raises(ValueError, match="the record ends at 3"):
        jax.jit(lambda p: pressure_to_circular_integrals(p, times, RADII + 3))(record)
