"""What is chosen for scans of which everything is known."""

import re

import jax
import numpy as np
import pytest
from made_scans import BELLS, RADIUS, RATE, SPEED, TIMES, N, positions, raw_counts, record, scan

from jaxtat import detector_curve, disk, phantoms
from jaxtat.base.choice_table import GUESSED, LIKELY
from jaxtat.io import Scan
from jaxtat.io.frames import LazyFrames
from jaxtat.records import circular_integrals_to_pressure, supported
from jaxtat.scans import choose, describe, with_facts
from jaxtat.scans.estimate import Estimate
from jaxtat.scans.region import _within
from jaxtat.steps import AccuracyWarning, TooFewDetectors

REACH = max(np.hypot(*c) + r for c, r in zip(BELLS["centers"], BELLS["radii"], strict=True))


@pytest.fixture(scope="module")
def pressure():
    return record()


@pytest.fixture(scope="module")
def counts(pressure):
    return raw_counts(pressure)


@pytest.fixture(scope="module")
def chosen(counts):
    return choose(scan(counts))


def test_a_raw_scan(chosen):
    reasons = dict(chosen.reasons)
    assert chosen.model == "in-plane"
    assert chosen.sound_speed == SPEED
    assert reasons["sound_speed"] == "from the file"
    assert not chosen.impulse_response
    assert chosen.channels == tuple(range(N))
    assert 1.5e-6 < chosen.dead_time < 9e-6  # the artefact is below the noise from 2.3e-6 on
    assert chosen.band is not None
    assert chosen.band[0] < 1.5e5 < chosen.band[1]
    # all that sounds, and not much more; nine tenths of a bell's rim are hardly heard
    assert 0.8 * REACH < chosen.region_radius < 1.6 * REACH
    assert chosen.region_cut >= chosen.region_radius
    assert abs(chosen.region_angle + 90) < 1e-9
    assert np.allclose(chosen.region_center, 0, atol=1e-12)
    assert chosen.low_pass == "cosine"
    assert 2 * chosen.half_width / (chosen.pixels - 1) <= np.pi / chosen.max_frequency / 1.9
    # circles for sources anywhere within the array but its rim
    last = chosen.first_radius + chosen.radial_step * (chosen.n_radii - 1)
    assert 1.94 * RADIUS < last <= SPEED * TIMES[-1]


@pytest.mark.parametrize("noise", [0.003, 0.03])
def test_alpha_is_noise_over_signal_power(pressure, noise):
    """Signal over the whole of the record that may sound, noise of this size in all of it."""
    chosen = choose(scan(raw_counts(pressure, noise)))
    arrival = (RADIUS - chosen.region_radius) / SPEED
    signal = np.mean(pressure[:, arrival < TIMES] ** 2) / np.abs(pressure).max() ** 2
    assert 0.3 < chosen.alpha / (noise**2 / signal) < 3


def test_a_muted_start_does_not_make_a_record_exact(pressure):
    """Nothing at all before the sound, and noise in it: alpha is as without that."""
    noise = 0.03 * np.abs(pressure).max() * np.random.default_rng(4).standard_normal(pressure.shape)
    muted = pressure + noise
    muted[:, TIMES < 16e-6] = 0.0
    chosen, heard = choose(scan(muted)), choose(scan(pressure + noise))
    assert 0.3 < chosen.alpha / heard.alpha < 3
    assert chosen.region_radius == pytest.approx(heard.region_radius, rel=0.2)
    muted[:, TIMES < 0.98 * (RADIUS - REACH) / SPEED] = 0.0  # up to the sound: by differences
    chosen = choose(scan(muted))
    assert 0.3 < chosen.alpha / heard.alpha < 3
    assert chosen.grade("alpha") == "guessed"


def test_exact_records_are_hardly_regularised_and_not_smoothed(pressure):
    chosen = choose(scan(pressure))
    assert chosen.alpha == 1e-6
    assert chosen.low_pass == "none"
    assert chosen.dead_time == 0.0


def test_bad_channels_are_left_out_and_named(counts, pressure):
    bad = counts.copy()
    bad[5] = 0
    bad[40] = 32768
    rng = np.random.default_rng(1)
    bad[61] = (32768 + 8000 * rng.standard_normal(len(TIMES))).clip(0, 65535)
    chosen = choose(scan(bad))
    assert chosen.left_out == (5, 40, 61)
    assert dict(chosen.reasons)["channels"] == "left out: dead 5, 40; noisy 61"
    assert set(chosen.channels) == set(range(N)) - {5, 40, 61}
    blank = pressure.copy()
    blank[7, 20], blank[12, 3] = np.nan, np.inf
    blanks = choose(scan(blank))
    assert blanks.left_out == (7, 12)
    assert dict(blanks.reasons)["channels"] == "left out: NaN or infinite 7, 12"
    with pytest.raises(ValueError, match="4: left out: NaN or infinite 0-89"):
        choose(scan(np.full_like(pressure, np.nan)))
    with pytest.warns(AccuracyWarning, match="no image explains"):  # noise is most of it
        assert choose(scan(bad), use=np.arange(N), sound_speed=SPEED).left_out == ()
    with pytest.raises(ValueError, match="of 90 detectors are good"):
        choose(scan(np.zeros_like(counts)))


def faded_record(pressure, first, last):
    """Gains fall over eight channels and are nothing between."""
    gain = np.ones(N)
    gain[first : last + 1] = 0.0
    taper = np.sin(np.pi / 2 * np.arange(1, 9) / 9) ** 2
    gain[first - 8 : first], gain[last + 1 : last + 9] = taper[::-1], taper
    return gain[:, None] * pressure, np.flatnonzero(gain < 1)


def test_faded_channels_are_left_out_and_the_arc_is_that_of_the_others(pressure):
    """A ring of which a quarter is silent, and faded to both sides, is an arc."""
    points = positions(n=N, span=360.0 * (N - 1) / N)[:, :2]
    bells = phantoms.Bells(BELLS["centers"], BELLS["radii"], [1.0, 0.7, 0.5])
    radii, h = np.maximum(SPEED * TIMES, 1e-3), 1e-6
    both = np.concatenate([radii - h / 2, radii + h / 2])
    means = np.asarray(bells.circular_integrals(detector_curve(points), both)) / both
    whole = (means[:, len(radii) :] - means[:, : len(radii)]) / h
    record, out = faded_record(whole, 40, 55)
    known = {"detectors": points, "times": TIMES, "sound_speed": SPEED}
    chosen = choose(found := Scan("pressure", record, known), model="in-plane")
    assert set(out) - set(chosen.left_out) <= {31, 64}  # of 97 % of the gain
    assert set(chosen.left_out) <= set(out)
    assert "dead 39-56; faded 3" in dict(chosen.reasons)["channels"]
    assert chosen.channels[0] in (64, 65) and chosen.channels[-1] in (30, 31)
    assert dict(chosen.reasons)["region_angle"] == "the arc opens there"
    middle = np.degrees(np.arctan2(*points[[47, 48]].mean(axis=0)[::-1]))
    assert abs((chosen.region_angle - middle + 180) % 360 - 180) < 5
    assert not bool(chosen.curve(points).closed)
    assert "opens towards" in describe(found, chosen)
    assert choose(Scan("pressure", whole, known), model="in-plane").left_out == ()


@pytest.mark.slow
def test_positions_in_the_plane_are_a_scanners_if_sizes_rate_and_counts_are(counts, pressure):
    """Two columns, as people save them: the physics does not follow from the missing third."""
    known = {"detectors": positions()[:, :2], "sampling_rate": RATE, "sound_speed": SPEED}
    for data in (counts, counts.astype(float), pressure + 40 * pressure.max()):
        chosen = choose(Scan("pressure", data, known))
        assert chosen.model == "in-plane"
        assert "rate and counts" in dict(chosen.reasons)["model"]
    found = choose(Scan("pressure", pressure, known))  # exact: no counts, but no tail either
    assert (found.model, found.grade("model")) == ("in-plane", "likely")
    radii = np.arange(1e-3, 62e-3, 4e-4)
    bells = phantoms.Bells(BELLS["centers"], BELLS["radii"])
    g = bells.circular_integrals(detector_curve(positions()[:, :2]), radii)
    waves = np.asarray(circular_integrals_to_pressure(g, radii, SPEED * TIMES))
    noise = 0.1 * waves.std() * np.random.default_rng(0).standard_normal(waves.shape)
    with pytest.warns(AccuracyWarning, match="needs model in-plane"):
        found = choose(Scan("pressure", waves + noise, known))
    assert (found.model, found.grade("model")) == ("2d", "likely")
    assert choose(Scan("pressure", pressure, known), model="2d", sound_speed=SPEED).model == "2d"


@pytest.mark.parametrize("turn", [0.0, 70.0, 211.0])
def test_wherever_the_arc_opens(counts, chosen, turn):
    """A file whose arc is turned, detectors in any order: the same choices, turned."""
    mixed = np.random.default_rng(int(turn)).permutation(N)
    other = Scan(
        "pressure",
        counts[mixed],
        {"detectors": positions(turn)[mixed], "times": TIMES, "sound_speed": SPEED},
    )
    found = choose(other)
    assert np.array_equal(mixed[list(found.order)], np.arange(N))
    away = (found.region_angle - (turn - 90) + 180) % 360 - 180
    assert abs(away) < 1e-9
    for name in ("region_radius", "max_frequency", "alpha", "dead_time", "first_radius"):
        assert np.isclose(getattr(found, name), getattr(chosen, name), rtol=1e-9), name
    assert (found.pixels, found.n_radii) == (chosen.pixels, chosen.n_radii)


def test_millimetres_and_microseconds(counts, chosen):
    other = Scan(
        "pressure", counts, {"detectors": 1e3 * positions(), "times": 1e6 * TIMES}, {"date": "now"}
    )
    assert choose(other, two_speeds=False).sound_speed == pytest.approx(1.5, rel=1e-3)
    found = choose(other, sound_speed=1e-3 * SPEED)
    assert found.model == "in-plane"
    assert found.sound_speed == 1.5  # nominal
    assert np.isclose(found.region_radius, 1e3 * chosen.region_radius)
    assert np.isclose(found.max_frequency, 1e-3 * chosen.max_frequency)


def test_the_unit_of_length_that_is_given_is_that_of_table_and_reasons(counts, chosen):
    """Lengths of this size would be taken for millimetres."""
    known = {"detectors": 1e2 * positions(), "times": TIMES}
    found = choose(Scan("pressure", counts, known), length_unit="cm", two_speeds=False)
    assert found.sound_speed == pytest.approx(1.5e5, rel=1e-3)
    known["sound_speed"] = 1e2 * SPEED
    found = choose(Scan("pressure", counts, known), length_unit="cm")
    assert found.units == ("cm", "s")
    wanted = [row for row in chosen.rows() if row[0] != "length_unit"]
    assert [row for row in found.rows() if row[0] != "length_unit"] == wanted
    assert ("length_unit", "cm", "sure", "given") in found.rows()
    metres = Scan("pressure", counts, {"detectors": positions(), "times": TIMES})
    with pytest.raises(ValueError, match=r"expected 0\.044 to 4\. Check that positions"):
        choose(metres, length_unit="mm")
    with pytest.raises(ValueError, match="the unit of length is 'inch'"):
        choose(scan(counts), length_unit="inch")


def test_a_simulation_without_units(pressure):
    known = {"detectors": positions()[:, :2] / RADIUS, "times": TIMES * SPEED / RADIUS}
    chosen = choose(Scan("pressure", pressure, known))
    assert (chosen.model, chosen.sound_speed, chosen.band) == ("2d", 1.0, None)
    assert "taken to be 1" in dict(chosen.reasons)["sound_speed"]
    assert 0.8 * REACH < RADIUS * chosen.region_radius < 1.6 * REACH


def test_the_file_bounds_the_view(counts):
    view = [-5e-3, 5e-3, -4e-3, 4e-3, 0.0, 0.0]
    chosen = choose(scan(counts, field_of_view=view))
    assert np.isclose(chosen.region_radius, np.hypot(5e-3, 4e-3))
    assert dict(chosen.reasons)["region_radius"] == "the field of view in the file"
    wide = choose(scan(counts, field_of_view=[-0.03, 0.03] * 3))
    assert wide.region_radius < 2 * REACH
    assert choose(scan(counts, field_of_view=[0.0] * 6)).region_radius == wide.region_radius


@pytest.mark.filterwarnings("ignore:no image explains")  # noise alone
def test_beyond_the_ends_of_the_arc_nothing_is_seen(pressure):
    """Sources all over: the region ends at the chord of the opening."""
    points = positions(n=N, span=240.0)  # the chord is half the radius from the middle
    loud = np.random.default_rng(0).standard_normal(pressure.shape)
    made = Scan("pressure", loud, {"detectors": points, "times": TIMES})
    chosen = choose(made, sound_speed=SPEED)
    assert chosen.region_radius > 0.6 * RADIUS
    assert np.isclose(chosen.region_cut, 0.5 * RADIUS)
    given = choose(made, sound_speed=SPEED, region_radius=0.7 * RADIUS)
    assert given.region_cut == given.region_radius  # as asked


@pytest.mark.filterwarnings("ignore:no image explains")  # noise alone
@pytest.mark.parametrize("degrees", [180.0, 90.0])
def test_the_chord_of_a_short_arc_does_not_cut_off_the_middle(pressure, degrees):
    """Sources all over, from detectors whose chord leaves half of the disk, or hardly any of it."""
    loud = np.random.default_rng(0).standard_normal(pressure.shape)
    known = {"detectors": positions(n=N, span=degrees), "times": TIMES, "sound_speed": SPEED}
    chosen = choose(Scan("pressure", loud, known))
    assert chosen.grade("region_radius") == "guessed"
    assert chosen.region_cut == chosen.region_radius > 0.6 * RADIUS


@pytest.mark.filterwarnings("ignore:no image explains")  # of five
def test_detectors_too_few_for_an_image_are_said_so(pressure):
    """Five of them show three details across the region; so many as are asked for suffice."""

    def chosen_from(step):
        known = {"detectors": positions()[::step], "times": TIMES}
        made = Scan("pressure", pressure[::step], known)
        return choose(made, region_radius=0.011, sound_speed=SPEED)

    with pytest.warns(TooFewDetectors, match=r"5 detectors show .* too few .* About (\d+)") as said:
        chosen_from(N // 5)
    (few,) = (str(each.message) for each in said if each.category is TooFewDetectors)
    needed = int(re.search(r"About (\d+)", few)[1])
    assert 5 < needed < 45
    chosen_from(2)


def test_far_between_detectors_waves_are_finer_as_far_as_few_pixels_hold_them(pressure):
    """Twice what the spacing tells in half of the region, up to what 257 pixels hold at 2 each."""
    points = positions()[::6]
    few = Scan("pressure", pressure[::6], {"detectors": points, "sampling_rate": RATE})
    inner = supported(detector_curve(points[:, :2]), disk(0.0055), TIMES)
    told = float(inner.frequency_of_detectors)
    given = {"region_radius": 0.011, "sound_speed": SPEED}
    assert choose(few, **given).max_frequency == pytest.approx(2 * told, rel=0.02)
    wide = choose(few, half_width=0.08, **given)
    assert wide.max_frequency == pytest.approx(np.pi * 256 / 0.16 / 2) and wide.pixels == 257
    whole = choose(few, half_width=0.12, **given)  # where they do not hold what the spacing tells
    assert whole.max_frequency == pytest.approx(told, rel=0.02) and whole.pixels > 257


def test_what_sounds_beyond_the_ends_of_the_arc_is_shown():
    """A half circle, whose chord runs through the middle of what sounds."""
    t = np.arange(600) / (4 * RATE)
    record = np.sin(2 * np.pi * 1.7e6 * t) * (np.abs(t - RADIUS / SPEED) < 8e-3 / SPEED)
    known = {"detectors": positions(span=180.0), "times": t, "sound_speed": SPEED}
    noise = 0.01 * np.random.default_rng(0).standard_normal((N, 600))
    chosen = choose(Scan("pressure", record + noise, known))
    assert 8e-3 < chosen.region_radius < 12e-3 and chosen.region_cut == chosen.region_radius
    assert "reaches beyond the arc's ends" in dict(chosen.reasons)["region_cut"]


@pytest.mark.parametrize(
    "given",
    [
        {"model": "2d", "sound_speed": 1450.0, "alpha": 0.5, "low_pass": "none"},
        {"dead_time": 0.0, "band": (2e5, 1e6), "pixels": 41, "half_width": 4e-3},
        {"region_radius": 5e-3, "region_center": (1e-3, 2e-3), "max_frequency": 1234.0},
        {"region_cut": 1e-3, "region_angle": 10.0, "inversion": "fourier"},
    ],
)
@pytest.mark.filterwarnings("ignore:no image explains")  # an artefact that is kept
def test_every_choice_can_be_given(counts, given):
    chosen = choose(scan(counts), **{"sound_speed": SPEED} | given)
    assert {name: getattr(chosen, name) for name in given} == given
    assert {dict(chosen.reasons)[name] for name in given} == {"given"}


def test_details_beyond_what_is_supported_are_named(counts, chosen):
    reason = dict(choose(scan(counts), max_frequency=1e5).reasons)["max_frequency"]
    assert reason == f"given; {dict(chosen.reasons)['max_frequency']} supports " + (
        f"{chosen.max_frequency * 1e-3:.5g} rad/mm"
    )


def test_no_band_can_be_asked_for(counts):
    assert choose(scan(counts), band="none").band is None


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"colour": 1}, "unknown options \\['colour'\\]"),
        ({"pixels": 2}, "pixels is 2"),
        ({"alpha": 0.0}, "alpha is 0"),
        ({"sound_speed": -1.0}, "sound_speed is -1"),
        ({"region_radius": 0.05}, "inside or on the region"),
        ({"use": [1, 2]}, "expected at least 3|detector"),
        ({"region_center": (0.0, 0.0, 0.0)}, r"region_center has shape \(3,\), expected \(2\)"),
        ({"region_center": (0.0, np.nan)}, "region_center"),
    ],
)
def test_what_cannot_be_given(counts, given, reason):
    with pytest.raises(ValueError, match=reason):
        choose(scan(counts), **given)


def test_choices_are_not_traced(counts):
    with pytest.raises(ValueError, match=r"sound_speed is traced, .* for derivatives take a Setup"):
        jax.grad(lambda speed: choose(scan(counts), sound_speed=speed).sound_speed)(1500.0)


def test_what_a_file_lacks(counts, tmp_path):
    bare = Scan("pressure", counts)
    with pytest.raises(ValueError, match="no detector positions"):
        choose(bare)
    with pytest.raises(ValueError, match="no sample times"):
        choose(with_facts(bare, detectors=positions()))
    twice = Scan("pressure", counts, {"times": TIMES, "sampling_rate": 2 * RATE})
    with pytest.raises(ValueError, match="times and sampling_rate contradict each other"):
        choose(twice)
    for clock in ({"times": TIMES}, {"sampling_rate": RATE}):
        assert set(with_facts(twice, **clock).known) == set(clock)
    known = with_facts(bare, detectors=positions(), sampling_rate=4e6)
    assert choose(known, sound_speed=SPEED).model == "in-plane"
    line = np.stack([np.linspace(-0.02, 0.02, N), np.zeros(N)], axis=1)
    with pytest.raises(ValueError, match="see no point from all sides"):
        choose(with_facts(bare, detectors=line, sampling_rate=4e6))
    with pytest.raises(ValueError, match="the scanner is 'ct'"):
        with_facts(bare, scanner="ct")
    with pytest.raises(ValueError, match="256"):
        with_facts(bare, scanner="msot-invision-256")
    turned = with_facts(Scan("pressure", counts.T), detectors=positions(), sampling_rate=4e6)
    assert np.array_equal(turned.data, counts)


@pytest.mark.parametrize(
    ("tells", "wanted", "covered"), [(True, 0.001, 0.03), (False, 0.01, 0.003)]
)
def test_where_no_place_is_told_the_region_is_half_the_circle(tells, wanted, covered):
    """From less than a tenth, or nowhere that can be told and the record covers less."""
    region = _within(Estimate(wanted, grade=LIKELY), tells, RADIUS, covered)
    assert region.value == RADIUS / 2 and region.grade == GUESSED


@pytest.mark.filterwarnings("ignore:no image explains")  # noise alone
def test_a_record_that_ends_early_bounds_the_region_and_what_is_asked_beyond_is_fitted():
    """48.4 mm of sound from everywhere, detectors at 40."""
    short, end = scan(np.random.default_rng(0).standard_normal((N, 130))), SPEED * TIMES[129]
    chosen = choose(short, sound_speed=SPEED)
    assert chosen.region_radius == pytest.approx(end - RADIUS)
    assert "detectors and record (path 48.37 mm) cover" in dict(chosen.reasons)["region_radius"]
    last = chosen.first_radius + chosen.radial_step * (chosen.n_radii - 1)
    assert end - 1.01 * chosen.radial_step < last <= end
    asked = choose(short, sound_speed=SPEED, region_radius=0.011)
    assert asked.model_based  # there is no formula for more than the record covers
    assert re.search(
        r"ends 0.0026\d+ before .* up to 0.0083\d+ is possible", dict(asked.reasons)["model_based"]
    )
    with pytest.raises(ValueError, match=r"record ends .* before the far side .* fit each other"):
        choose(scan(short.data, sampling_rate=3 * RATE), sound_speed=SPEED, region_radius=0.011)


@pytest.mark.parametrize(
    ("known", "path"),
    [
        ({"detectors": 1e3 * positions()}, "a path of 0.08588, while the detectors are 40 "),
        ({"sampling_rate": 4.0}, "a path of 8.588e\\+04, while the detectors are 0.04 "),
    ],
)
def test_units_that_do_not_fit_each_other_are_refused(counts, known, path):
    with pytest.raises(ValueError, match=path + ".* in units that fit each other") as refused:
        choose(scan(counts, **known))
    assert ("--sound-speed 1.5e+06 would fit" in str(refused.value)) == ("detectors" in known)


def test_a_scanner_gives_what_a_file_lacks():
    bare = Scan("pressure", np.zeros((2, 256, 2030), np.uint16))
    known = with_facts(bare, scanner="msot-invision-256").known
    assert known["detectors"].shape == (256, 3)
    assert known["sampling_rate"] == 40e6
    faster = with_facts(bare, scanner="msot-invision-256", sampling_rate=50e6)
    assert faster.known["sampling_rate"] == 50e6


def test_of_many_frames_few_are_read(counts, chosen):
    asked = []

    def read(numbers):
        asked.extend(numbers.tolist())
        return np.stack([counts * (k % 7 != 0) for k in numbers])

    many = scan(LazyFrames((1000, *counts.shape), counts.dtype, read))
    assert choose(many).alpha == pytest.approx(chosen.alpha)
    assert len(asked) <= 5


def test_a_description_tells_data_detectors_and_choices(counts, chosen):
    text = describe(scan(counts[None].repeat(2, 0), wavelengths=[700.0, 850.0]), chosen)
    for part in (
        "2 frames of 90 detectors, 230 samples (uint16)",
        "wavelengths: 700, 850",
        "lengths are taken to be in m, times in s",
        "arc of 270.0 degrees, radius 40 mm about (0, 0) mm",
        "opens towards -90.0 degrees",
        "every line through the region meets the curve",
        "details down to",
        "all of them are good",
        "max_frequency",
    ):
        assert part in text, part


def test_too_few_detectors_or_samples_are_named(counts):
    with pytest.raises(ValueError, match="2 detectors, expected at least 4"):
        choose(scan(counts), use=(0, 5))
    with pytest.raises(ValueError, match="the record has 10 samples, expected at least 32"):
        choose(scan(counts[:, :10]))


def test_pixels_too_far_apart_for_radii_are_refused(counts):
    with pytest.raises(ValueError, match="the data do not cover two of them: take more pixels"):
        choose(scan(counts), half_width=2.0, pixels=65, max_frequency=4e3)


def test_a_record_that_is_cut_off_in_all_channels_is_said_to_be(counts, chosen):
    """And one that is not is not."""
    assert chosen.grade("channels") == "likely"
    middle, peak = np.median(counts), np.abs(counts - np.median(counts))[:, 40:].max()
    cut = choose(scan(np.clip(counts, middle - 0.3 * peak, middle + 0.3 * peak)))
    assert cut.grade("channels") == "guessed"
    assert re.search(r"[\d.]+% of all samples have the highest", dict(cut.reasons)["channels"])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:no image explains")  # it is the record of an arc
def test_a_line_of_a_scanners_size_has_a_scanners_units():
    """Half its extent stands in for a radius: water's speed is known then."""
    line = np.stack([np.linspace(-0.04, 0.04, 64), np.zeros(64)], axis=1)
    made = Scan("pressure", record()[:64], {"detectors": line, "sampling_rate": RATE})
    with pytest.warns(AccuracyWarning, match="no image explains"):  # the record of an arc
        chosen = choose(made, region_radius=8e-3, region_center=(0.0, 0.02))
    assert chosen.sound_speed == pytest.approx(1500.0, rel=0.1)  # not 1
    assert chosen.grade("sound_speed") == "guessed"


def test_fitted_images_have_pixels_for_half_a_minute(pressure):
    """Of a record that ends before the far side of the region, and no more details than these."""
    short = scan(pressure[:, : int(1.05 * RADIUS / SPEED * RATE)])
    given = {"region_radius": 0.012, "max_frequency": 2e5}
    assert choose(scan(pressure), **given).pixels > 513
    fitted = choose(short, **given)
    assert fitted.model_based and fitted.pixels == 513


@pytest.mark.parametrize(
    "made",
    [
        scan(record()),
        Scan(
            "circular_integrals",
            np.ones((N, 9)),
            {"detectors": positions(), "radii": 0.01 * np.arange(1.0, 10.0)},
        ),
    ],
)
def test_a_center_beyond_the_detectors_is_refused(made):
    with pytest.raises(ValueError, match=r"region_center is 0.05 from .* beyond its radius 0.04"):
        choose(made, region_center=(0.05, 0.0), region_radius=5e-3)


class ImagesAsked(Exception):
    """Behind all that is refused before."""


def ask_images(*arguments):
    raise ImagesAsked


def line(*more):
    """Noise, recorded by 128 detectors on a line and some more."""
    positions = np.stack([np.linspace(-0.019, 0.019, 128), np.zeros(128)], axis=1)
    positions = np.concatenate([positions, np.reshape(more, (-1, 2))])
    record = np.random.default_rng(0).standard_normal((len(positions), 800))
    known = {"detectors": positions, "sampling_rate": 4e7, "sound_speed": 1500.0}
    return Scan("pressure", record, known)


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"region_size": (30, 18)}, "a region 3e.04 mm across is given, while the detectors are"),
        ({"region_radius": 1e-6}, "a region 0.002 mm across is given"),
        ({"region_size": (0.03, 0.018), "region_center": (0, 5e-3)}, "lie inside or on the region"),
        (
            {"region_radius": 0.01, "sound_speed": 1.5e6},
            r"the record ends after a path of 2.996e\+04 mm",
        ),
    ],
)
def test_units_of_a_line_and_of_its_region_are_alike(monkeypatch, given, reason):
    monkeypatch.setattr("jaxtat.scans.pipeline.tell_acoustics", ask_images)
    with pytest.raises(ValueError, match=reason):
        choose(line(), **given)


def test_a_detector_that_is_not_used_may_lie_in_the_region(monkeypatch):
    monkeypatch.setattr("jaxtat.scans.pipeline.tell_acoustics", ask_images)
    given = {"region_size": (0.03, 0.018), "region_center": (0, 0.012)}
    with pytest.raises(ImagesAsked):
        choose(line((0.0, 0.012)), use=np.arange(128), **given)
