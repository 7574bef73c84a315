"""Images of scans under constraints, through Python and the command."""

import h5py
import numpy as np
import pytest
from made_scans import RATE, SPEED, positions, raw_counts, record, scan, truth

from jaxtat.cli import main
from jaxtat.io import Scan, load_settings
from jaxtat.records import apply_impulse_response
from jaxtat.scans import choose, reconstruct, setup_of, to_look_at, with_best_method
from jaxtat.scans.constrained import compared, fitted
from jaxtat.steps import AccuracyWarning

pytestmark = pytest.mark.slow

# one size for most tests: few programs
SIZES = {"region_radius": 0.011, "pixels": 41, "max_frequency": 3500.0}
GIVEN = SIZES | {"model_based": True, "nonnegative": True}
BAND = (1e5, 1.5e6)  # without the low frequencies


def relative_error(found):
    wanted = truth(found.grid.points)
    inside = np.asarray(found.region.contains(found.grid.points))
    return np.linalg.norm((found.image - wanted)[inside]) / np.linalg.norm(wanted[inside])


def test_a_band_passed_record_is_fitted_as_it_is():
    """Without the band the formula's image has shadows; f >= 0 takes them away."""
    counts = raw_counts(record(), noise=0.01)
    made = scan(counts)
    direct = reconstruct(made, choose(made, band=BAND, **SIZES))
    fitted = reconstruct(made, choose(made, band=BAND, **GIVEN))
    size = np.linalg.norm(truth(fitted.grid.points)) / np.linalg.norm(fitted.image)
    wanted = truth(fitted.grid.points)
    assert fitted.image.min() >= 0
    assert "% of the record is not explained" in fitted.report
    off = [
        np.linalg.norm(size * f.image - wanted) / np.linalg.norm(wanted) for f in (direct, fitted)
    ]
    assert off[1] < 0.2 and off[1] < 0.5 * off[0]


@pytest.mark.parametrize("known", [{}, {"impulse_response": np.full((90, 1), 2.0)}])
def test_images_are_compared_as_they_are_fitted(known):
    """By records that each of them leaves unexplained; elements may have a response each."""
    made = scan((2.0 if known else 1.0) * np.asarray(record()), **known)
    choices = choose(made, band="none", **GIVEN)
    setup, frame = setup_of(made, choices), np.asarray(made.frame(0))
    image = fitted(made, choices, setup, frame).image
    both = compared(made, choices, setup, frame, image, 0.5 * image)
    assert both.misfits[0] < 0.1
    assert 0.45 < both.misfits[1] < 0.55
    assert 0.99 < both.differ < 1.01


def test_the_model_goes_through_the_impulse_response():
    response = np.exp(-((np.arange(31) - 15) ** 2) / 18) * np.cos((np.arange(31) - 15) / 1.5)
    spread = np.asarray(apply_impulse_response(record(), response, origin=15))
    made = scan(spread, impulse_response=response)
    found = reconstruct(made, choose(made, band="none", weight=1e-3, **GIVEN))
    assert relative_error(found) < 0.1
    blind = reconstruct(
        made, choose(made, band="none", weight=1e-3, impulse_response=False, **GIVEN)
    )
    assert relative_error(blind) > 3 * relative_error(found)


def test_frames_are_fitted_one_by_one():
    made = scan(np.stack([record(), 2 * record()]))
    found = reconstruct(made, choose(made, **GIVEN))
    alone = reconstruct(scan(record()), choose(scan(record()), **GIVEN))
    assert found.image.shape == (2, 41, 41)
    assert relative_error(alone) < 0.1
    assert np.abs(found.image[0] - alone.image).max() < 1e-3 * alone.image.max()


def test_a_penalty_that_is_given_says_how():
    made = scan(record())
    chosen = choose(made, penalty="ridge")
    assert chosen.model_based and dict(chosen.reasons)["model_based"] == "penalty is given"
    assert not choose(made).model_based and "model_based" not in choose(made).table()
    with pytest.raises(ValueError, match="penalty is 'l1', expected one of tv"):
        choose(made, penalty="l1")


def test_pixels_of_a_part_of_the_region_are_not_fitted():
    """Those that are left out would be explained by the others."""
    made = scan(record())
    part = with_best_method(made, choose(made, half_width=0.004, **SIZES))
    whole = with_best_method(made, choose(made, **SIZES))
    assert whole.model_based and not part.model_based
    assert "a fit needs all of it" in dict(part.reasons)["model_based"]
    beyond = reconstruct(made, choose(made, **SIZES | {"pixels": 111})).image[35:76, 35:76]
    assert np.abs(reconstruct(made, part).image - beyond).max() < 1e-6 * np.abs(beyond).max()
    with pytest.raises(ValueError, match=r"half_width is 4 mm, but .* of radius 11 mm: leave it"):
        choose(made, half_width=0.004, **GIVEN)


def test_the_table_says_why_an_image_is_not_fitted():
    made = scan(record())
    asked = with_best_method(made, choose(made, alpha=1e-3, **SIZES))
    assert dict(asked.reasons)["model_based"] == "alpha is of the formula"
    waves = with_best_method(made, choose(made, model="2d", **SIZES))
    assert "every line through the region meets" in dict(waves.reasons)["model_based"]
    assert "alpha" not in to_look_at(with_best_method(made, choose(made, **SIZES)), 10)


@pytest.mark.parametrize(("share", "fitted"), [(1.9, False), (2.1, True)])
def test_two_dimensional_waves_finer_than_the_spacing_tells_are_fitted(share, fitted):
    """Detectors s apart at the radius R sample waves of pi R / (s r) at the distance r."""
    made, angle, radius = scan(record()), np.radians(270 / 89 * 6), 0.011
    few = Scan("pressure", made.data[::6], {**made.known, "detectors": positions()[::6]})
    tells = np.pi / (angle * radius / 2)  # in the inner half of the region
    given = {"region_radius": radius, "pixels": 41, "max_frequency": share * tells}
    assert with_best_method(few, choose(few, model="2d", **given)).model_based == fitted


def test_the_command_stores_and_repeats_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    np.savez("scan.npz", pressure=record(), detectors=positions(), sampling_rate=RATE,
             sound_speed=SPEED)  # fmt: skip
    line = "reconstruct scan.npz --region-radius 0.011 --pixels 41 --max-frequency 3500 --out"
    options = "--model-based --nonnegative --penalty second-order --weight 0.01"
    assert main([*line.split(), "a.h5", *options.split()]) == 0
    said = capsys.readouterr()
    assert (
        "penalty            second-order" in " ".join(said.out.splitlines())
        or "second-order" in said.out
    )
    assert "off=" in said.err
    settings = load_settings("a.h5")
    assert settings["model_based"] is True and settings["weight"] == 0.01
    assert main(["reconstruct", "scan.npz", "--repeat", "a.h5", "--out", "b.h5", "--quiet"]) == 0
    with h5py.File("a.h5") as first, h5py.File("b.h5") as second:
        assert np.array_equal(first["image"][()], second["image"][()])
    for other in ("--plan a.h5", "--K 4", "--repeat a.h5"):
        capsys.readouterr()
        refused = f"reconstruct scan.npz --out c.h5 --nonnegative {other}"
        assert main(refused.split()) == 2
        assert "--nonnegative" in capsys.readouterr().err


def test_records_that_end_early_are_fitted_by_themselves(tmp_path, monkeypatch, capsys):
    """Circular integrals whose radii do not cover the region that is asked for."""
    import jaxtat

    curve = jaxtat.circular_arc(1.3, 1.3, 48)
    bells = jaxtat.phantoms.Bells([[0.1, 0.2], [-0.2, -0.3]], [0.4, 0.3])
    radii = np.arange(0.5, 1.4, 0.05)
    monkeypatch.chdir(tmp_path)
    np.savez("short.npz", circular_integrals=bells.circular_integrals(curve, radii), radii=radii,
             detectors=curve.points)  # fmt: skip
    line = "reconstruct short.npz --region-radius 0.8 --pixels 33 --out a.npy"
    assert main(line.split()) == 0
    assert "there is no formula: radii run from 0.5 to 1.35" in capsys.readouterr().out
    grid = jaxtat.ImageGrid(33, 0.8)
    inside = np.asarray(jaxtat.disk(0.8).contains(grid.points))
    off = (np.load("a.npy") - np.asarray(bells.image(grid)))[inside]
    assert np.linalg.norm(off) < 0.1 * np.linalg.norm(np.asarray(bells.image(grid))[inside])


def test_a_record_that_ends_before_all_sound_is_heard_is_fitted():
    """Sound from within 7 mm, detectors at 40 mm, and a record of 45 mm."""
    last = round(0.045 / SPEED * RATE)
    short = scan(record()[:, :last])
    chosen = choose(short, pixels=41, nonnegative=True)
    assert chosen.model_based and chosen.region_radius > 0.007
    reasons = dict(chosen.reasons)
    assert reasons["model_based"].startswith("there is no formula: the record ends")
    assert reasons["region_radius"].startswith("sound comes from within")
    found = reconstruct(short, chosen)
    assert relative_error(found) < 0.1
    bare = {name: short.known[name] for name in ("detectors", "sampling_rate")}
    unknown = Scan("pressure", short.data, bare)
    wider = choose(unknown)
    assert wider.region_radius == pytest.approx(chosen.region_radius, rel=0.1)
    assert wider.sound_speed == pytest.approx(SPEED, rel=0.01)


def test_an_image_of_hardly_anything_is_said():
    made = scan(raw_counts(record(), noise=0.01))
    choices = choose(made, band=BAND, weight=1e9, **GIVEN)
    with pytest.warns(AccuracyWarning, match=r"leaves 100% of the record unexplained"):
        assert reconstruct(made, choices).unexplained > 0.99


def test_frames_of_hardly_anything_are_named():
    """By their numbers in the file, from 0."""
    sound = record()
    noise = np.abs(sound).max() * np.random.default_rng(0).standard_normal((2, *sound.shape))
    made = scan(np.stack([sound, *noise]))
    choices = choose(made, band=BAND, dead_time=0.0, weight=5e-2, **GIVEN)
    with pytest.warns(AccuracyWarning, match=r"fitted images of frames 1-2 leave"):
        reconstruct(made, choices)
