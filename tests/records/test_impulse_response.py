"""The transducer's response: folded in with NumPy, divided out, and what noise makes of it."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat.records import remove_impulse_response

N, RATE = 256, 40e6
TIMES = np.arange(N) / RATE
# minimum and mixed phase, none with a zero of H near the unit circle
RESPONSES = [[1.0], [0.5, 1.0, -0.3], [1.0, 0.6, -0.2, 0.1, 0.05], [-0.2, 0.3, 1.5, 0.4, -0.1]]


def pulses():
    """(3, N): smooth pulses that keep clear of the ends."""
    j = np.arange(N)
    middles, widths = np.array([[80], [128], [170]]), np.array([[6], [3], [9]])
    return np.exp(-(((j - middles) / widths) ** 2)) * np.sin((j - middles) / 2)


def folded(record, response, origin):
    """Σ_m h_m p_{t - m + origin}, cut to the record."""
    return np.stack([np.convolve(p, response)[origin : origin + N] for p in record])


def transfer(response, origin=0.0, n=2 * N):
    v = np.fft.rfftfreq(n)
    m = np.arange(len(response)) - origin
    return np.exp(-2j * np.pi * v[:, None] * m) @ np.asarray(response)


@pytest.mark.parametrize("response", RESPONSES)
def test_a_known_response_is_divided_out_wherever_its_time_zero_is(response):
    p = pulses()
    padded = np.pad(response, (0, 5 - len(response)))  # of one length: one program
    for origin in (0, len(response) - 1):
        y = folded(p, response, origin)
        found = remove_impulse_response(y, TIMES, padded, regularization=1e-14, origin=origin)
        assert np.abs(found - p).max() < 1e-10


def test_each_detector_may_have_its_own_response():
    p = pulses()
    own = np.array([np.pad(h, (0, 5 - len(h))) for h in RESPONSES[1:]])
    y = np.concatenate([folded(p[k : k + 1], own[k], 0) for k in range(3)])
    found = remove_impulse_response(y, TIMES, own, regularization=1e-14)
    assert np.abs(found - p).max() < 1e-10
    frames = remove_impulse_response(np.stack([y, 2 * y]), TIMES, own, regularization=1e-14)
    assert np.allclose(frames[1], 2 * found, atol=1e-12)


def test_what_remains_of_each_frequency_is_what_is_stated():
    """|H|²/(|H|² + eps max|H|²) and no shift, by a filter of our own in the frequency domain."""
    p, response, eps = pulses(), np.array([0.3, 1.0, 0.8, 0.1, -0.4]), 0.05
    power = np.abs(transfer(response)) ** 2
    kept = power / (power + eps * power.max())
    expected = np.fft.irfft(np.fft.rfft(p, 2 * N) * kept)[:, :N]
    found = remove_impulse_response(
        folded(p, response, 2), TIMES, response, regularization=eps, origin=2
    )
    # the highest |H|² is taken on the same frequencies; what is folded beyond the ends is nothing
    assert np.abs(found - expected).max() < 1e-9
    assert kept.min() < 0.5  # so that something was to be seen


def test_a_delay_of_half_a_sample_is_taken_away():
    j, middle = np.arange(N), 100.0
    response = np.zeros(5)
    response[2] = 1.0

    def pulse(at):
        return np.exp(-(((j - at) / 6) ** 2))[None]

    found = remove_impulse_response(
        pulse(middle + 0.5), TIMES, response, regularization=1e-14, origin=1.5
    )
    assert np.abs(found - pulse(middle)).max() < 1e-10


@pytest.mark.parametrize("eps", [1e-4, 1e-1])
def test_no_frequency_of_the_noise_grows_by_more_than_the_bound(eps):
    rng = np.random.default_rng(0)
    for _ in range(5):
        response = rng.standard_normal(5)
        largest = np.abs(transfer(response)).max()
        bound = 1 / (2 * np.sqrt(eps) * largest)
        gain = np.abs(transfer(response)) / (np.abs(transfer(response)) ** 2 + eps * largest**2)
        noise = rng.standard_normal((3, N))
        found = remove_impulse_response(noise, TIMES, response, regularization=eps)
        grown = np.linalg.norm(found) / np.linalg.norm(noise)
        assert grown <= bound
        assert abs(grown / np.sqrt(np.mean(gain**2)) - 1) < 0.2  # white noise: the mean gain


def test_derivatives_in_record_response_origin_and_regularization(check_both_modes):
    rng = np.random.default_rng(1)
    record = jnp.asarray(rng.standard_normal((1, 24)))
    response = jnp.asarray(rng.standard_normal(4))

    def found(record, response, eps, origin):
        return remove_impulse_response(
            record, np.arange(24.0), response, regularization=eps, origin=origin
        )

    arguments = (record, response, jnp.asarray(0.03), jnp.asarray(1.3))
    check_both_modes(found, arguments)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"impulse_response": 1.0}, r"impulse_response has shape \(\)"),
        ({"impulse_response": np.ones((2, 5))}, r"expected \(taps,\) or \(3, taps\)"),
        ({"impulse_response": np.zeros(5)}, "zero throughout"),
        ({"impulse_response": np.array([[1.0], [0.0], [1.0]])}, "zero throughout"),
        ({"impulse_response": [1.0, np.nan]}, "NaN"),
        ({"regularization": 0.0}, "regularization is 0"),
        ({"pressure": np.zeros((3, 99))}, "pressure has shape"),
        ({"times": TIMES**2}, "expected equal"),
    ],
)
def test_bad_responses_are_refused(change, message):
    arguments = {"pressure": np.zeros((3, N)), "times": TIMES, "impulse_response": [1.0]} | change
    with pytest.raises(ValueError, match=message):
        remove_impulse_response(**arguments)


@pytest.mark.parametrize("data_file", ["msot_scan9_raw/Scan_9.irf"], indirect=True)
def test_stored_responses_of_scanners_are_centred(data_file):
    """float64, as many as a record has samples, 1000 added to the first as a mark."""
    response = np.fromfile(data_file, "<f8")
    assert len(response) == 2030
    response[0] -= 1000
    n = np.arange(len(response))
    assert abs((n @ response**2) / (response @ response) - len(response) // 2) < 0.5
    assert abs(np.argmax(np.abs(response)) - len(response) // 2) <= 1
    assert abs(response.sum() - 1) < 1e-12  # normalised: slow pressure comes through as it is
