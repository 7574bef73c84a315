"""Live images of raw frames against those of `scans.reconstruct`, step by step."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_scans import SPEED, TIMES, N, raw_counts, record, scan

from jaxtat.scans import choose, reconstruct
from jaxtat.streams import live

pytestmark = pytest.mark.slow

GIVEN = {"region_radius": 0.011, "pixels": 45, "max_frequency": 3500.0, "band": (2e4, 1.5e6)}
GIVEN |= {"alpha": 1e-2, "dead_time": 4e-6, "inversion": "fourier", "sound_speed": SPEED}
RESPONSE = np.exp(-((np.arange(31) - 15) ** 2) / 18) * np.cos((np.arange(31) - 15) / 1.5)


def relative(one, other):
    return float(np.abs(np.asarray(one) - other).max() / np.abs(other).max())


@pytest.fixture(scope="module")
def frames():
    """Counts with artefact, offsets and drift; a dead detector."""
    counts = np.stack([raw_counts(record(), 0.01, seed) for seed in range(3)])
    counts[:, N // 3] = 32768
    return counts


@pytest.mark.parametrize("known", [{}, {"impulse_response": RESPONSE}])
def test_raw_frames_come_out_as_from_the_scan(frames, known):
    made = scan(frames, **known)
    choices = choose(made, **GIVEN)
    wanted = reconstruct(made, choices).image
    assert N // 3 in choices.left_out
    assert relative(live(made, choices, dtype=np.float64)(frames), wanted) < 1e-10
    single = live(made, choices)
    assert relative(single(frames), wanted) < 1e-4
    assert relative(single(frames[1].astype(float)), wanted[1]) < 1e-4


def test_a_muted_start_is_no_record_live_either(frames):
    muted = frames.copy()
    muted[..., :60] = 0
    made = scan(muted)
    choices = choose(made, **GIVEN)
    wanted = reconstruct(made, choices).image
    assert relative(live(made, choices, dtype=np.float64)(muted), wanted) < 1e-10


def test_images_are_over_the_energies_of_pulses(frames):
    """Of each frame where they are said, else the mean; and in single precision throughout."""
    energies = np.array([40.0, 70.0, 35.0])
    made = scan(frames, laser_energy=energies)
    choices = choose(made, **GIVEN)
    wanted = reconstruct(made, choices).image
    with jax.enable_x64(False):
        to_images = live(made, choices)
        found = to_images(frames, energy=energies)
        assert jnp.zeros(1).dtype == found.dtype == np.float32
    assert relative(found, wanted) < 1e-4
    by_mean = to_images(frames[1])
    assert relative(by_mean * energies.mean() / 70.0, wanted[1]) < 1e-4
    for energy, said in ((0.0, "energy is 0"), ([1.0, 2.0], r"shape \(2,\), expected one number")):
        with pytest.raises(ValueError, match=said):
            to_images(frames, energy=energy)


@pytest.mark.parametrize("radius", [0.008, 0.011])
def test_within_reach_the_region_moves(frames, radius):
    """Against a grid of the wider region that has the moved pixels among its own."""
    made, given = scan(frames), GIVEN | {"region_radius": radius, "pixels": 23}
    choices = choose(made, **given, half_width=0.0055)
    moved = live(made, choices, dtype=np.float64, reach=0.011).replace(
        region_center=(1e-3, -2e-3), region_radius=radius / 2
    )
    wide = replace(choices, region_radius=0.011, region_cut=0.011, half_width=0.011)
    wide = replace(wide, pixels=89)
    wanted = reconstruct(made, wide).image
    rows = np.searchsorted(wide.grid.x1, np.asarray(moved.setup.grid.x1) - 1e-9)
    columns = np.searchsorted(wide.grid.x2, np.asarray(moved.setup.grid.x2) - 1e-9)
    assert relative(moved(frames), wanted[:, rows[:, None], columns]) < 1e-10


@pytest.mark.parametrize(("dtype", "limit"), [(np.float32, 1e-4), (np.float64, 1e-10)])
def test_another_center_is_that_of_other_choices(frames, dtype, limit):
    """With the same radii, which cover it too; and so are speed, alpha and low-pass after it."""
    made, center = scan(frames), (4e-4, -7e-4)
    choices = choose(made, **GIVEN | {"region_radius": 0.009})
    moved = live(made, choices, dtype=dtype).replace(region_center=center)
    there = replace(choices, region_center=center)
    assert relative(moved(frames), reconstruct(made, there).image) < limit
    turned = moved.replace(sound_speed=1520.0, rule=0.1, low_pass="none")
    asked = {"sound_speed": 1520.0, "alpha": 0.1, "low_pass": "none"}
    other = reconstruct(made, replace(there, **asked, **_like(turned.radii))).image
    assert relative(turned(frames), other) < limit
    assert relative(other, reconstruct(made, there).image) > 0.01


def _like(radii):
    first, last = float(radii[0]), float(radii[-1])
    return {"first_radius": first, "radial_step": (last - first) / (len(radii) - 1)}


def test_another_speed_is_that_of_other_choices(frames):
    """Of a lower one too, at which the record ends nearer."""
    made = scan(frames)
    choices = choose(made, **GIVEN)
    first = live(made, choices, dtype=np.float64)
    for speed in (1430.0, 1560.0):
        other = reconstruct(made, replace(choices, sound_speed=speed, **_radii(choices, speed)))
        assert relative(first.replace(sound_speed=speed)(frames), other.image) < 1e-10
    with pytest.raises(ValueError, match=r"with sound_speed 500 and a record up to .* radii run"):
        first.replace(sound_speed=500.0)
    with pytest.raises(ValueError, match=r"with sound_speed 1e\+09 samples of the record are"):
        first.replace(sound_speed=1e9)
    with pytest.raises(ValueError, match="sound_speed is -1"):
        first.replace(sound_speed=-1.0)


@pytest.mark.parametrize("known", [{}, {"impulse_response": RESPONSE}])
def test_another_start_is_that_of_other_choices(frames, known):
    """The silenced start ends at the same time, and so at another sample."""
    made = scan(frames, **known)
    choices = choose(made, **GIVEN, time_shift=3e-7)
    first = live(made, choices, dtype=np.float64)
    before = np.asarray(first(frames))
    for shift in (-1.1e-6, 0.0, 1.62e-6):
        later = first.replace(time_shift=shift, sound_speed=1480.0)
        other = replace(choices, time_shift=shift, sound_speed=1480.0, **_like(later.radii))
        wanted = reconstruct(made, other).image
        assert later.time_shift == shift and relative(wanted, before) > 0.1
        assert relative(later(frames), wanted) < 1e-10
        back = later.replace(time_shift=3e-7, sound_speed=SPEED)
        assert relative(back(frames), before) < 1e-12
    with pytest.raises(ValueError, match="radii run"):
        first.replace(time_shift=-3e-5)


def _radii(choices, speed):
    """As many, as far as the record reaches."""
    end = min(float(choices.radii[-1]), speed * TIMES[-1])
    return {"radial_step": (end - choices.first_radius) / (choices.n_radii - 1)}


def test_two_dimensional_waves_keep_their_tail(frames):
    made = scan(frames + 0.1)
    choices = choose(made, **GIVEN | {"model": "2d"})
    wanted = reconstruct(made, choices).image
    assert relative(live(made, choices, dtype=np.float64)(made.data), wanted) < 1e-10


def test_choices_that_are_no_formula_are_refused():
    made = scan(record())
    fitted = choose(made, region_radius=0.011, pixels=41, model_based=True)
    with pytest.raises(ValueError, match="live images are by the formula"):
        live(made, fitted)
    with pytest.raises(ValueError, match="in its choices"):
        live(made, choose(made, **GIVEN), rule=1e-3)
