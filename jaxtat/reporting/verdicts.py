"""Conclusions in words: what can be trusted and what not."""

from collections.abc import Iterable, Sequence
from enum import Enum
from typing import NamedTuple

import numpy as np

from ..base.units import Units
from ..plotting import gray_levels
from ..studies import DataNoise, DataResidual, Diagnosis, NoiseSource, Uncertainty, WaveAccuracy

_REACHED = 0.1  # error up to which a plane wave counts as reached
_HALF = 0.5  # up to which it counts as there
_LITTLE = 0.03  # relative residual that does no harm, whatever it comes from
_ABOVE_NOISE = 5.0  # times the noise, from which on a residual is not that
_NAMED = 12  # detectors, at most, that are listed by number


class Severity(Enum):
    """How serious a finding is."""

    GOOD = "good"
    CAUTION = "caution"
    BAD = "bad"


class Finding(NamedTuple):
    """One or two sentences, and how serious they are."""

    severity: Severity
    text: str


def findings(
    diagnosis: Diagnosis, unit: str | None, channels: Sequence[int] | None = None
) -> list[Finding]:
    """All findings, in the order of the page.

    Args:
        diagnosis: from `diagnose`.
        unit: of length; None if it is not known.
        channels: number of every detector in its file; None if that is its number.
    """
    conclusions = [_visibility(diagnosis, unit)]
    if diagnosis.waves is not None:
        held = _held(diagnosis)
        conclusions += [_reached(diagnosis.waves, held, unit), _noise_gain(diagnosis.waves)]
    conclusions += [_explained(diagnosis), *_outside(diagnosis.residual)]
    conclusions.append(_unusual(diagnosis.residual, channels))
    if diagnosis.uncertainty is not None:
        conclusions.append(
            _noise(diagnosis.noise, diagnosis.uncertainty, np.asarray(diagnosis.image))
        )
    return conclusions


def _severity(value: float, caution: float, bad: float) -> Severity:
    """How bad it is, of a number that should be small."""
    if value >= bad:
        return Severity.BAD
    return Severity.CAUTION if value >= caution else Severity.GOOD


def _percent(share: float) -> str:
    """A percentage that rounds neither small shares to 0 % nor large ones to 100 %.

    >>> [_percent(share) for share in (0.0, 0.0004, 0.123, 0.9999, 1.0)]
    ['0 %', 'less than 0.1 %', '12 %', 'more than 99.9 %', '100 %']
    """
    if 0 < share < 0.001:
        return "less than 0.1 %"
    if 0.999 < share < 1:
        return "more than 99.9 %"
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.3g} %"


def _length(length: float, unit: str | None) -> str:
    """A length in millimetres, if the unit is known."""
    return Units(unit).of_length(length, 3)


def _visibility(diagnosis: Diagnosis, unit: str | None) -> Finding:
    seen = np.asarray(diagnosis.visible)
    inside = np.isfinite(seen)
    partly = float((seen[inside] < 1).mean())
    missed = float(diagnosis.lines.invisible_fraction)
    if partly == 0 and missed == 0:
        return Finding(
            Severity.GOOD,
            "Every edge in the region of interest sends its wave to the detectors, so that all of "
            "them can be reconstructed.",
        )
    worst = np.unravel_index(np.nanargmin(seen), seen.shape)
    x1, x2 = (_length(float(x), unit) for x in np.asarray(diagnosis.setup.grid.points)[worst])
    most = (
        f"At {_percent(partly)} of the pixels some edge directions are not, or hardly, recorded: "
        f"such edges are missing or blurred there. The fewest are recorded at ({x1}, {x2}), "
        f"{_percent(float(seen[worst]))} of the directions; on average "
        f"{_percent(float(seen[inside].mean()))}."
    )
    if missed == 0:
        return Finding(
            Severity.GOOD if seen[inside].mean() > 0.95 else Severity.CAUTION,
            f"Every line through the region meets the curve, but some only at its ends. {most}",
        )
    lines = f" {_percent(missed)} of the lines through the region miss the detectors."
    return Finding(_severity(1 - float(seen[inside].mean()), 0.0, 0.05), most + lines)


def _held(diagnosis: Diagnosis) -> np.ndarray:
    """Energy of the image in each ring of frequencies, (frequencies,)."""
    assert diagnosis.waves is not None
    frequencies = np.asarray(diagnosis.waves.frequencies)
    image = np.nan_to_num(np.asarray(diagnosis.image))
    power = np.abs(np.fft.fft2(image)) ** 2
    axes = (
        2 * np.pi * np.fft.fftfreq(n, float(step))
        for n, step in zip(image.shape, diagnosis.setup.grid.spacing, strict=True)
    )
    lam = np.hypot(*np.meshgrid(*axes, indexing="ij"))
    middles = (frequencies[1:] + frequencies[:-1]) / 2
    ring = np.digitize(lam.ravel(), middles)
    inside = lam.ravel() <= frequencies[-1]
    return np.bincount(ring[inside], power.ravel()[inside], len(frequencies))


def _reached(waves: WaveAccuracy, held: np.ndarray, unit: str | None) -> Finding:
    """Finding on the error of plane waves, weighted by the image: noise hides the finest first."""
    error, frequencies = np.asarray(waves.residual), np.asarray(waves.frequencies)
    area = np.broadcast_to(frequencies[:, None], error.shape)  # of the plane, for each node
    good = float(np.sum(area * (error < _REACHED)) / area.sum())
    of_ring = np.mean(error**2, axis=1)
    whole = float(held.sum())
    lost = float(np.sqrt(np.sum(held * of_ring) / whole)) if whole > 0 else float(error.max())
    half = np.sqrt(of_ring) < _HALF
    finest = _length(np.pi / float(frequencies[-1]), unit)
    text = (
        "Weighted by the energy of the image, its plane waves have an error of "
        f"{_percent(lost)} (root mean square). Of all waves down to details of {finest} (half a "
        f"wave) {_percent(good)} have an error below {_percent(_REACHED)}"
    )
    if not half.all():
        resolved = np.flatnonzero(half)
        text += (
            f"; errors are below a half down to details of "
            f"{_length(np.pi / float(frequencies[resolved[-1]]), unit)}"
            if resolved.size
            else "; none has an error below a half"
        )
    text += "."
    eta = np.asarray(waves.low_pass)
    if eta.min() < 0.99:
        halved = frequencies[np.argmin(np.abs(eta - 0.5))]
        text += f" The low-pass halves waves of details of {_length(np.pi / float(halved), unit)}."
    return Finding(_severity(lost, 0.15, 0.5), text)


def _noise_gain(waves: WaveAccuracy) -> Finding:
    gain = np.asarray(waves.noise_gain)
    area = np.broadcast_to(np.asarray(waves.frequencies)[:, None], gain.shape)
    mean = float(np.sqrt(np.sum(area * gain**2) / area.sum()))
    return Finding(
        _severity(mean, 3.0, 8.0),
        f"Noise in the image's plane waves is {mean:.2g} times (root mean square) that of waves "
        f"recorded on both sides of the region, {float(gain.max()):.2g} times at worst; waves "
        "recorded on one side only have about 1.4.",
    )


def _explained(diagnosis: Diagnosis) -> Finding:
    """Graded by what is left besides noise, and by whether noise can be what is left."""
    residual, noise = diagnosis.residual, diagnosis.noise
    relative, of_noise = float(residual.relative), _relative_noise(diagnosis)
    text = (
        f"The image explains {_percent(max(0.0, 1 - relative**2))} of the data's energy on circles "
        f"that meet the region of interest; what is left has a relative norm of {relative:.2g}"
    )
    if noise.source is NoiseSource.UNKNOWN:
        return Finding(_severity(relative, 0.15, 0.5), f"{text}, noise and errors of the model.")
    model = float(np.sqrt(max(0.0, relative**2 - of_noise**2)))
    more = relative > max(_LITTLE, _ABOVE_NOISE * of_noise)
    times = f", {relative / of_noise:.2g} times the noise" if more and of_noise > 0 else ""
    return Finding(
        _severity(model, 0.0 if more else 0.15, 0.5),
        f"{text}{times}. Noise has {min(of_noise, relative):.2g}, known by {noise.source.value}; "
        f"the rest, {model:.2g}, is what model and image get wrong or leave out: sound speed, "
        "positions, sources outside the plane or the region, details finer than the image.",
    )


def _relative_noise(diagnosis: Diagnosis) -> float:
    """Norm of the noise over that of the data, on circles that meet the region."""
    meets = np.asarray(diagnosis.residual.meets)
    size = float(np.sqrt(np.mean(np.asarray(diagnosis.g)[meets] ** 2)))
    return float(diagnosis.noise.sigma) / size if size > 0 else 0.0


def _outside(residual: DataResidual) -> list[Finding]:
    share = float(residual.outside)
    if share < 0.01:
        return []
    return [
        Finding(
            Severity.CAUTION,
            f"{_percent(share)} of the data's energy lies on circles that miss the region of "
            "interest: sources outside it, or noise. Such sources cause no error in the region if "
            "the data contain all circles that meet them, and errors if not.",
        )
    ]


def _unusual(residual: DataResidual, channels: Sequence[int] | None) -> Finding:
    unusual = residual.unusual
    if not unusual.size:
        text = "No detector differs from the image's data more than the others do."
        return Finding(Severity.GOOD, text)
    one = unusual.size == 1
    in_file = ""
    if channels is not None:
        in_file = (
            f" ({'row' if one else 'rows'} {_listed(channels[k] for k in unusual)} of the file)"
        )
    return Finding(
        _severity(unusual.size / residual.gains.shape[0], 0.0, 0.05),
        f"{'Detector' if one else 'Detectors'} {_listed(unusual)}{in_file} "
        f"{'differs' if one else 'differ'} from the others (counted from 0): check the data, and "
        "leave bad detectors out.",
    )


def _listed(numbers: Iterable[int]) -> str:
    names = [str(number) for number in numbers]
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


def _noise(noise: DataNoise, uncertainty: Uncertainty, image: np.ndarray) -> Finding:
    deviation = np.asarray(uncertainty.deviation)
    low, high = gray_levels(image)
    middle, most = float(np.nanmedian(deviation)), float(np.nanmax(deviation))
    share = middle / (high - low) if high > low else np.inf
    text = (
        f"The standard deviation of a pixel by noise is {middle:.2g} (median; {most:.2g} at "
        f"worst), {_percent(share)} of the range of the image."
    )
    if noise.source is NoiseSource.GIVEN:
        return Finding(_severity(share, 0.05, 0.2), text)
    text += f" The noise is known by {noise.source.value}."
    if noise.source is NoiseSource.UNKNOWN:  # nothing that is worse than this can be said
        return Finding(Severity.GOOD if share < 0.05 else Severity.CAUTION, text)
    return Finding(_severity(share, 0.05, 0.2), text)
