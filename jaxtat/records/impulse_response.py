"""The transducer's impulse response, divided out of the record.

A transducer records p * h, the pressure folded with its response h. In the frequency domain the
least-squares pressure, with a penalty on its size, is

    P(f) = conj H / (|H|² + eps max|H|²) · Y(f) = |H|² / (|H|² + eps max|H|²) · P_true(f) + noise:

nothing is shifted, frequencies with |H|² >> eps max|H|² come back in full, those with less fade out
instead of blowing up, and no frequency of the noise grows by more than 1/(2 √eps max|H|).
"""

from typing import Any

import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, by_library, is_concrete, real_array, require_positive
from .pressure import require_equispaced

_ENDS = 4.0  # of s, where a Gaussian is 1e-7
_WIDEST = 1.5  # bandwidth over the centre, beyond which the band about -f_0 fills the lower end
_MOST_TAPS = 10**5


def remove_impulse_response(
    pressure: Numbers,
    times: Numbers,
    impulse_response: Numbers,
    *,
    regularization: Numbers = 1e-2,
    origin: Numbers = 0.0,
) -> Float[Array, "*batch detectors times"]:
    """p from y = p * h: the inverse filter conj H/(|H|² + eps max|H|²), with zeros beyond the ends.

    H(f) = Σ_m h_m exp(-2πi f (m - m_0) dt). The record must contain the complete responses, and
    must not jump at its ends: use `condition_record` first.
    Linear in the record; differentiable with respect to everything but times.

    Args:
        pressure: y, (..., detectors, times), any unit.
        times: equispaced, (times,) [time].
        impulse_response: h at the same sampling rate, (taps,), or (detectors, taps) if every
            detector has its own. In units of 1/sample: a response of a single 1 changes nothing.
        regularization: eps > 0, a share of the largest |H|². Frequencies that the detector passes
            with a gain below √eps of its best are left out more than they are amplified.
        origin: m_0, the sample of the response that is time zero, not necessarily whole: 0 for a
            response that starts with the pulse, taps // 2 for one that is stored centred, as in
            the .irf files of iThera's scanners.

    Returns:
        (..., detectors, times), unit of y over that of h.

    Raises:
        ValueError: for shapes that do not fit, times that are not equispaced, a response of zeros,
            or eps not above zero.

    Source: Wiener, Extrapolation, Interpolation, and Smoothing of Stationary Time Series (1949),
    with white spectra; the same filter is Tikhonov's solution of y = p * h.

    >>> times, response = np.arange(200) / 40e6, np.array([0.2, 1.0, -0.4])
    >>> p = np.exp(-((np.arange(200) - 90) ** 2) / 50)[None]
    >>> y = np.convolve(p[0], response, mode="full")[None, 1:201]  # the second tap is time zero
    >>> pressure = remove_impulse_response(y, times, response, regularization=1e-12, origin=1)
    >>> bool(np.abs(np.asarray(pressure) - p).max() < 1e-9)
    True
    """
    times = real_array("times", times, ("times",))
    pressure = real_array("pressure", pressure, ("...", "detectors", times.shape[0]))
    require_equispaced(times)
    response = real_array("impulse_response", impulse_response, None)
    if response.ndim == 0 or response.shape[:-1] not in ((), pressure.shape[-2:-1]):
        raise ValueError(
            f"impulse_response has shape {response.shape}, expected (taps,) or "
            f"({pressure.shape[-2]}, taps): one for all detectors or one for each."
        )
    if is_concrete(response) and not np.asarray(response).any(axis=-1).all():
        raise ValueError("impulse_response is zero throughout: nothing was recorded through it.")
    regularization = real_array("regularization", regularization, ())
    require_positive("regularization", regularization)
    arrays = pressure, response, regularization, real_array("origin", origin, ())
    return by_library(_removed, arrays)


def apply_impulse_response(
    pressure: Numbers, impulse_response: Numbers, *, origin: Numbers = 0.0
) -> Float[Array, "*batch detectors times"]:
    """y = p * h, the signal of a transducer with the response h; p is zero beyond its ends.

    Args:
        pressure: p, (..., detectors, times), any unit.
        impulse_response, origin: as in `remove_impulse_response`.

    Returns:
        (..., detectors, times), unit of p times that of h.

    >>> p = np.eye(8)[[3]]  # a pulse
    >>> np.round(apply_impulse_response(p, [0.5, 1.0], origin=1), 9)[0, 2:4].tolist()
    [0.5, 1.0]
    """
    pressure = real_array("pressure", pressure, ("...", "detectors", "times"))
    response = real_array("impulse_response", impulse_response, None)
    return by_library(_applied, (pressure, response, real_array("origin", origin, ())))


def gaussian_response(
    sampling_rate: Numbers, center_frequency: Numbers, bandwidth: Numbers
) -> Float[np.ndarray, " taps"]:
    """h_n ~ cos(2π f_0 t) exp(-(t/s)²), s = 2 √(ln 2)/(π b f_0): a Gaussian band about f_0.

    What a data sheet says of an element, where nobody has measured its response: waves neither
    early nor late, the largest |H| is 1, and a half (-6 dB) at f_0 (1 ± b/2). Of wide bands the
    lower end has a little more, from the band about -f_0: 0.52 for b = 1.2.

    Args:
        sampling_rate: of the record [1/time].
        center_frequency: f_0, of that unit.
        bandwidth: b, between the frequencies at -6 dB, over f_0: 0.6 of 60 %.

    Returns:
        h, time 0 in the middle.

    Raises:
        ValueError: for a band that the sampling rate cannot hold, or that is none.

    Source: the pulse of `scipy.signal.gausspulse`.

    >>> response = gaussian_response(40e6, 5e6, 0.6)
    >>> spectrum = np.abs(np.fft.rfft(response, 4000))  # 10 kHz apart
    >>> spectrum[[350, 500, 650]].round(3).tolist()
    [0.5, 1.0, 0.5]
    """
    rate = float(real_array("sampling_rate", sampling_rate, ()))
    center = float(real_array("center_frequency", center_frequency, ()))
    share = float(real_array("bandwidth", bandwidth, ()))
    if not 0 < share <= _WIDEST:
        raise ValueError(
            f"bandwidth is {share:g}, expected a share of the centre frequency above 0, at most "
            f"{_WIDEST:g}: 0.6 of 60 %."
        )
    if not 0 < center * (1 + share / 2) <= rate / 2:
        raise ValueError(
            f"center_frequency is {center:g} and bandwidth {share:g}, expected a band above 0 and "
            f"up to half the sampling rate, {rate / 2:g}, in its unit."
        )
    spread = 2 * np.sqrt(np.log(2)) / (np.pi * share * center)
    half = int(np.ceil(_ENDS * spread * rate))
    if half > _MOST_TAPS:
        raise ValueError(
            f"center_frequency is {center:g} and bandwidth {share:g}: their response has "
            f"{2 * half:g} samples. Is the frequency in the unit of the sampling rate, {rate:g}?"
        )
    t = np.arange(-half, half + 1) / rate
    pulse = np.cos(2 * np.pi * center * t) * np.exp(-((t / spread) ** 2))
    return pulse / np.abs(np.fft.rfft(pulse, 16 * len(pulse))).max()


def _applied(xp: Any, pressure: Any, response: Any, origin: Any) -> Any:
    n = pressure.shape[-1]
    padded = 2 * max(n, response.shape[-1])
    transfer = transfer_function(xp, padded, response, origin)
    return xp.fft.irfft(xp.fft.rfft(pressure, padded) * transfer, padded)[..., :n]


def transfer_function(xp: Any, padded: int, response: Any, origin: Any) -> Any:
    """H at the frequencies of so many samples, enough for the convolution not to wrap."""
    cycles = xp.fft.rfftfreq(padded)
    return xp.fft.rfft(response, padded) * xp.exp(2j * np.pi * cycles * origin)


def _removed(xp: Any, pressure: Any, response: Any, regularization: Any, origin: Any) -> Any:
    n = pressure.shape[-1]
    padded = 2 * max(n, response.shape[-1])  # the inverse has room to fade
    transfer = transfer_function(xp, padded, response, origin)
    power = transfer.real**2 + transfer.imag**2
    floor = regularization * xp.max(power, axis=-1, keepdims=True)
    inverse = xp.conj(transfer) / (power + floor)
    return xp.fft.irfft(xp.fft.rfft(pressure, padded) * inverse, padded)[..., :n]
