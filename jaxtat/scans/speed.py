"""The speed of sound of a scan whose file lacks it: of the sharpest image, if detectors agree.

The speed stretches the radii only, so that the systems of a frequency are solved for all speeds at
once, and sharpness (`jaxtat.studies.sharpness`) needs no image: by Parseval's formula

    ∫ |grad f|² dx = (1/2π)² ∫ |xi|² |fhat(xi)|² dxi.
"""

import warnings
from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ..base.choice_table import GUESSED
from ..io import Scan
from ..regularization import tikhonov_rule
from ..steps import AccuracyWarning
from .all_speeds import data_by_speed
from .best_explained import speed_best_explained
from .choices import Choices
from .facts import FASTEST, SLOWEST, facts_of, typical_frame
from .frames import integrals, problem_of
from .hearing import speed_heard
from .least_negative import speed_least_negative
from .one_side import SEEN_TWICE, span
from .opposite_detectors import speed_from_both_sides, speed_in_space
from .speed_found import UNSURE, SpeedFound, believed, beside, jackknife, peaks, summit, unknown

SPEEDS = np.linspace(SLOWEST, FASTEST, 21)
STANDS_OUT = 1.05  # sharpness at a peak over its surroundings, at least
BESIDE = 2  # speeds to each side that belong to a peak, not to its surroundings
SECTORS = 8  # of directions of edges, each with its own estimate
APART = 0.07  # from the speed by the times, at most: a peak farther off is noise
TOLD_APART = 110.0  # degrees, from which on a slower speed and a body farther off sound different


def estimate_sound_speed(scan: Scan, choices: Choices) -> Choices:
    """Choices with the speed of sound at which a typical frame is sharpest, if none is known.

    Images are of half the resolution: that is quicker, and sharpness falls off less steeply beside
    its peak, which is easier to find. Radii keep their ratio to the speed. What counts is a peak
    over its surroundings: beside it sharpness may rise slowly to an end of the range. A speed of
    which the sharpness hardly depends, as with smooth objects, is not believed, nor one on which
    the edges of different directions do not agree. Detectors on one side only see every edge once:
    at a wrong speed it is displaced, but not doubled, and other things make an image sharper. And
    where there are detectors opposite each other, these must agree on that speed: at a wrong one
    the parts of a regular object may fall onto each other's places.
    """
    if "sound_speed" not in choices.to_estimate:
        return choices
    found = (_speed_in_space if choices.in_space else _speed_in_plane)(scan, choices)
    error = None if found.standard_error is None else choices.sound_speed * found.standard_error
    why = found.why if error is None else f"{found.why}; none in the file"
    return at_speed(choices, found.stretch).with_reason("sound_speed", why, found.grade, error)


def compare_sound_speed(scan: Scan, choices: Choices) -> Choices:
    """The same speed of sound where it is the file's, and a guess if the sharpest image is another.

    Where edges are seen twice, and unless opposite detectors agree on the file's: a body that
    differs from the water around it is sharpest at a speed between them.
    """
    own = "sound_speed" in choices.to_estimate + choices.user_set
    if own or choices.in_space or not (scan.kind == "pressure" and "sound_speed" in scan.known):
        return choices
    points = facts_of(scan).points[list(choices.channels)]
    if span(points, np.asarray(choices.region_center)) < SEEN_TWICE:
        return choices
    sharpness_at = sharpness_by_speed(scan, choices, typical_frame(scan))
    if sharpness_at is None or _is_same(sharp := sharpest(sharpness_at)):
        return choices
    agreed = speed_from_both_sides(scan, choices)
    if agreed.standard_error is not None and _is_same(agreed):
        return choices
    speed = choices.units.of_speed(choices.sound_speed * sharp.stretch)
    why = f"{dict(choices.reasons)['sound_speed']}; but {sharp.why}, at {speed}: try that"
    return choices.with_reason("sound_speed", why, GUESSED)


def _is_same(found: SpeedFound) -> bool:
    """Whether no other speed of sound is known to be better."""
    return found.standard_error is None or abs(found.stretch - 1) <= UNSURE


def at_speed(choices: Choices, stretch: float) -> Choices:
    """Choices at another speed of sound: radii for the same times, no farther apart than before.

    Args:
        choices: of a pressure record.
        stretch: the other speed over that of the choices.
    """
    n_steps = choices.n_radii - 1
    n_more = max(n_steps, int(np.ceil(n_steps * stretch - 1e-9)))
    return replace(
        choices,
        sound_speed=choices.sound_speed * stretch,
        first_radius=choices.first_radius * stretch,
        radial_step=choices.radial_step * stretch * n_steps / n_more,
        n_radii=n_more + 1,
    )


def _speed_in_space(scan: Scan, choices: Choices) -> SpeedFound:
    found = speed_in_space(scan, choices)
    return unknown(f"water's: {found.why}") if found.standard_error is None else found


def _speed_in_plane(scan: Scan, choices: Choices) -> SpeedFound:
    """By sharpness and opposite detectors, or, from one side, by other signs."""
    points = facts_of(scan).points[list(choices.channels)]
    degrees = span(points, np.asarray(choices.region_center))
    if degrees < SEEN_TWICE:
        return _from_one_side(scan, choices, degrees)
    agreed = speed_from_both_sides(scan, choices)
    sharpness_at = sharpness_by_speed(scan, choices, typical_frame(scan))
    if sharpness_at is None:
        why = "the record ends early"
        if agreed.standard_error is None:
            return unknown(f"water's: {why}, and {agreed.why}")
        return _guessed(agreed, f"but {why}")
    sharp = sharpest(sharpness_at)
    return by_both(sharp, agreed) or _heard(scan, choices, sharp.why)


def _from_one_side(scan: Scan, choices: Choices, degrees: float) -> SpeedFound:
    """By what an image explains; else a guess, by negative values, or first and last sound."""
    explained, doubt = speed_best_explained(scan, choices)
    if explained.standard_error is not None:
        return _guessed(explained, doubt) if doubt else explained
    why = f"from {degrees:.0f} degrees edges are seen once, and {explained.why}"
    if degrees < TOLD_APART:
        return unknown(f"water's: {why}")
    heard, speed = _heard(scan, choices, why), speed_least_negative(scan, choices)
    if speed is None or abs(speed / heard.stretch - 1) > APART:
        return heard
    return SpeedFound(speed, f"the image is least negative: {why}", GUESSED, None)


def by_both(sharp: SpeedFound, agreed: SpeedFound) -> SpeedFound | None:
    """The speed by the sharpest image and by opposite detectors, which may know none; or None.

    That of the sharpest image if the others confirm it. Else it is a guess: by the detectors, if
    these know one, since sharpness has been misled more often.

    Warns:
        AccuracyWarning: for two speeds that contradict each other.

    >>> sharp = SpeedFound(1.02, "the image is sharpest", "likely", 1e-4)
    >>> by_both(sharp, unknown("opposite detectors agree on none")).why
    'the image is sharpest; but opposite detectors agree on none'
    """
    if agreed.standard_error is None:
        return None if sharp.standard_error is None else _guessed(sharp, f"but {agreed.why}")
    if sharp.standard_error is None:
        return _guessed(agreed, f"but {sharp.why}")
    apart = sharp.stretch / agreed.stretch - 1
    if abs(apart) <= UNSURE:
        return sharp
    more = f"{abs(apart):.1%} {'more' if apart > 0 else 'less'}"
    warnings.warn(
        f"the image is sharpest at a speed of sound {more} than that by which opposite detectors "
        "agree: the body's may differ from the water's, or the record does not start when its file "
        "says (see --start-time), or positions or the sampling rate are wrong.",
        AccuracyWarning,
        stacklevel=5,
    )
    return _guessed(agreed, f"but the image is sharpest at {more}")


def _guessed(found: SpeedFound, doubt: str) -> SpeedFound:
    return SpeedFound(found.stretch, f"{found.why}; {doubt}", GUESSED, None)


def _heard(scan: Scan, choices: Choices, why: str) -> SpeedFound:
    """The speed by the times of first and last sound, where no image shows it: a guess."""
    speed = speed_heard(scan, choices)
    if speed is None:
        return unknown(f"water's: {why}")
    return SpeedFound(speed, f"by the times of first and last sound: {why}", GUESSED, None)


def sharpness_by_speed(
    scan: Scan, choices: Choices, frame: np.ndarray
) -> Callable[[np.ndarray], Float[np.ndarray, "speeds sectors"]] | None:
    """How sharp the images of a frame are by speed of sound, up to a factor.

    Args:
        scan, choices: in the plane; of pressure.
        frame: (detectors, samples), rows as in the file.

    Returns:
        From speeds over that of the choices, (speeds,), to c² ∫ |grad f|² dx in sectors of
        directions that add up, (speeds, sectors); None for a record that ends before all sound from
        the region is heard.
    """
    coarse = replace(
        choices, pixels=choices.pixels // 4 * 2 + 1, max_frequency=choices.max_frequency / 2
    )
    problem = problem_of(scan, coarse)  # to solve once takes less time than to trace twice
    if not problem.setup.complete:
        return None
    g = problem.data(integrals(scan, coarse, problem.setup, frame))
    basis, frequencies = problem.basis(), problem.sizes.frequencies
    rule = tikhonov_rule(coarse.alpha, frequencies.shape[0])
    eta = problem.low_pass(coarse.low_pass)

    def sharpness_at(speeds: np.ndarray) -> np.ndarray:
        stretches = jax.device_put(speeds)
        fhat, _ = basis.fhat(data_by_speed(g, problem.radii, stretches, frequencies), rule)
        return np.asarray(_sharpness(fhat, eta, stretches, frequencies))

    return sharpness_at


def sharpest(
    sharpness_at: Callable[[np.ndarray], Float[np.ndarray, "speeds sectors"]],
) -> SpeedFound:
    """The speed at which sharpness has the highest peak over its surroundings.

    As many speeds again between the neighbours of that peak, without the slope of the straight line
    through what is beside it, and a parabola through the three highest values. The standard error
    is the jackknife's, by leaving out each sector of directions in turn: edges of all directions
    must agree on the speed.

    Args:
        sharpness_at: of speeds over that of water, in sectors that add up.

    >>> peak = lambda speeds: 1 + np.exp(-(((speeds[:, None] - 0.9877) / 0.01) ** 2)) * np.ones(8)
    >>> found = sharpest(peak)
    >>> round(found.stretch, 5), round(found.standard_error, 9)
    (0.9877, 0.0)
    """
    coarse = sharpness_at(SPEEDS)
    best, height = _peak(coarse.sum(axis=1))
    around = beside(best, len(SPEEDS), BESIDE)
    slope = np.polyfit(SPEEDS[around], coarse[around], 1)[0]
    if height < STANDS_OUT:
        return unknown("none within 10 % gives an image much sharper than those beside it")
    near = np.linspace(SPEEDS[best - 1], SPEEDS[best + 1], len(SPEEDS))
    fine = sharpness_at(near) - (near[:, None] - near[0]) * slope
    total = fine.sum(axis=1)
    speed = summit(near, total)
    error = jackknife([summit(near, total - part) for part in fine.T])
    why = f"the image is sharpest, by {height - 1:.0%}"
    return believed(speed, error, why, "edges")


def _peak(values: Float[np.ndarray, " speeds"]) -> tuple[int, float]:
    """Number of the highest peak, and its height over what its surroundings lead one to expect."""
    heights = {k: float(values[k]) / line for k, line in peaks(values, BESIDE) if line > 0}
    best = max(heights, key=heights.__getitem__, default=0)
    return best, heights.get(best, 0.0)


@jax.jit
def _sharpness(
    fhat: Complex[Array, "speeds frequencies directions"],
    eta: Float[Array, " all_frequencies"],
    stretches: Float[Array, " speeds"],
    frequencies: Float[Array, " frequencies"],
) -> Float[Array, "speeds sectors"]:
    """c² ∫ |grad f|² dx, up to a factor: f has the unit of g per length, which grows with c.

    In sectors of directions of the gradient, which add up.
    """
    power = jnp.einsum("sfd,f->sd", jnp.abs(fhat) ** 2, eta[1:] ** 2 * frequencies**3)
    sectors = np.minimum(np.arange(power.shape[1]) * SECTORS // power.shape[1], SECTORS - 1)
    of_sectors = power @ jnp.asarray(np.eye(SECTORS)[sectors]) / power.shape[1]
    return stretches[:, None] ** 2 * of_sectors
