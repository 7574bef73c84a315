"""Scans in space from file to file: the right volumes in every format, and what is refused."""

import warnings

import equinox as eqx
import h5py
import jax.numpy as jnp
import nibabel
import numpy as np
import pytest
import scipy.io
import tifffile
from made_volumes import (
    BELL,
    CAP,
    CENTER,
    MAX_FREQUENCY,
    RADIUS,
    RATE,
    REGION,
    SOUND,
    cup,
    record,
    round_record,
    shuffled,
    wide_record,
)

from jaxtat import Setup, VolumeGrid, reconstruct_file
from jaxtat.cli import main
from jaxtat.forward import pressure_terms
from jaxtat.geometry.elements import across
from jaxtat.io import Scan, load_scan, load_settings, save_ipasc
from jaxtat.reconstruction import operator_on
from jaxtat.records import apply_impulse_response, water_speed
from jaxtat.scans import choose, describe, misfit_in_space, reconstruct, setup_of, with_best_method
from jaxtat.scans import integrals as integrals_of
from jaxtat.scans.constrained import fitted
from jaxtat.scans.space import facts_in_space
from jaxtat.spherical import (
    BallBody,
    DetectorPoints,
    SolidBells,
    ball,
    cap_radii,
    spherical_cap,
)
from jaxtat.spherical.sizes import resolved_frequency
from jaxtat.spherical.visible import covered_share
from jaxtat.steps import Contradiction

pytestmark = pytest.mark.slow

REACH = 0.018 + 0.0015  # how far from the middle the bell sounds
# the ball in nine voxels across, and the radii of the command's rule
GRID = VolumeGrid(9, RADIUS, CENTER)
OPTIONS = f"--region-radius {RADIUS} --pixels 9 --max-frequency {MAX_FREQUENCY} --quiet"


def radii_of(end):
    reach = min(0.95 * 0.04, end - RADIUS / 8 - 0.04)
    return cap_radii(CAP, REGION, RADIUS / 8, sources=ball(reach, center=CENTER))


def bell_below(max_frequency):
    """The bell without its frequencies beyond: √(2/π) ∫ fhat(k) sin(kr)/(kr) k² dk, 0.15 off it."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    k = max_frequency * (nodes + 1) / 2
    about_zero = SolidBells(np.zeros((1, 3)), BELL.radii)
    fhat = np.asarray(about_zero.fourier(k[:, None] * np.eye(3)[0])).real
    r = np.linalg.norm(np.asarray(GRID.points) - np.asarray(BELL.centers)[0], axis=-1)
    waves = np.sinc(k * r[..., None] / np.pi)
    return np.sqrt(2 / np.pi) * waves @ (weights * max_frequency / 2 * fhat * k**2)


@pytest.fixture(scope="module")
def integrals():
    """Radii, g, and the volume of which they are, as far as its frequencies go."""
    radii = radii_of(1.0)
    g = BELL.spherical_integrals(CAP, radii)
    inside = np.asarray(REGION.contains(GRID.points))
    return radii, np.asarray(g), np.where(inside, bell_below(MAX_FREQUENCY), 0.0)


@pytest.fixture(scope="module")
def scan_file(integrals, tmp_path_factory):
    path = tmp_path_factory.mktemp("space") / "cap.h5"
    points, order = shuffled()
    radii, g, _ = integrals
    with h5py.File(path, "w") as file:
        file["spherical_integrals"] = g.reshape(-1, len(radii))[order]
        file["detectors"], file["radii"] = points, radii
    return path


def test_every_format_holds_the_volume(scan_file, integrals, tmp_path):
    """Measured rings differ from the cap in the areas only, and so by what is not exact."""
    wanted = integrals[2]
    settings = f"reconstruct {scan_file} {OPTIONS} --length-unit m --direct"
    for name in ("v.h5", "v.nii.gz", "v.tif", "v.png", "v.npy", "v.ome.zarr"):
        assert main([*settings.split(), "--out", str(tmp_path / name)]) == 0
    volume = np.load(tmp_path / "v.npy")
    assert volume.shape == (9, 9, 9) and np.abs(volume - wanted).max() < 0.02
    with h5py.File(tmp_path / "v.h5") as file:
        np.testing.assert_array_equal(file["image"], volume)
        for k in range(3):
            np.testing.assert_allclose(file[f"x{k + 1}"], GRID.axis(k), atol=1e-12)
            assert file["image"].dims[k].label == f"x{k + 1}"
    image = nibabel.load(tmp_path / "v.nii.gz")
    np.testing.assert_allclose(image.get_fdata(), volume)
    corner = image.affine @ [8, 0, 4, 1]
    np.testing.assert_allclose(corner[:3], 1e3 * np.asarray(GRID.points[8, 0, 4]), atol=1e-9)
    pixels = tifffile.imread(tmp_path / "v.tif")
    np.testing.assert_allclose(pixels[3], volume[:, ::-1, 3].T, atol=1e-6)
    assert (tmp_path / "v.png").stat().st_size > 10_000
    zarr = pytest.importorskip("zarr")
    voxels = zarr.open_group(tmp_path / "v.ome.zarr", mode="r")["0"][0]  # z, y, x of one channel
    np.testing.assert_allclose(np.nan_to_num(voxels), volume.T, rtol=1e-6, atol=1e-9)
    again = f"reconstruct {scan_file} --repeat {tmp_path / 'v.h5'} --out {tmp_path / 'again.npy'}"
    assert main(again.split()) == 0
    np.testing.assert_array_equal(np.load(tmp_path / "again.npy"), volume)
    assert load_settings(tmp_path / "v.h5")["region_center"] == pytest.approx(CENTER.tolist())


def test_an_ome_zarr_that_is_there_is_refused_before_anything_is_computed(
    scan_file, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("jaxtat.scans.choose", None)  # not called
    (tmp_path / "v.ome.zarr").mkdir()
    line = f"reconstruct {scan_file} {OPTIONS} --out {tmp_path / 'v.ome.zarr'}"
    assert main(line.split()) == 2
    assert "cannot write" in capsys.readouterr().err


def test_no_trials_are_suggested_in_space(scan_file, capsys):
    """Which are pictures in the plane."""
    assert main(["info", str(scan_file)]) == 0
    said = capsys.readouterr().out.split("Look at these first")[1]
    assert "--region-radius" in said and "--try" not in said


def test_upside_down_is_turned_over(scan_file, integrals):
    """The mirror image of detectors and object."""
    points, order = shuffled(upside_down=True)
    radii, g, wanted = integrals
    data = np.stack([g, 2 * g]).reshape(2, -1, len(radii))[:, order]
    np.savez(scan_file.with_suffix(".npz"), g=data, detectors=points, radii=radii)
    found = reconstruct_file(
        scan_file.with_suffix(".npz"),
        region_radius=RADIUS,
        pixels=9,
        max_frequency=MAX_FREQUENCY,
        model_based=False,
    )
    assert found.image.shape == (2, 9, 9, 9)
    inside = np.asarray(found.region.contains(found.grid.points))
    np.testing.assert_allclose(found.image[1], 2 * found.image[0], atol=1e-12)
    error = np.abs(found.image[0][:, :, ::-1] - wanted) * inside
    assert error.max() < 0.02


def test_pressure_in_the_exchange_format(integrals, tmp_path, capsys):
    """IPASC needs positions alone; everything is chosen, and said."""
    path = tmp_path / "scan.hdf5"
    known = {"detectors": shuffled()[0], "sampling_rate": RATE}
    save_ipasc(path, Scan("pressure", record(), known))
    assert main(["info", str(path)]) == 0
    said = capsys.readouterr().out
    rings = "13 rings of 28 on a sphere, open upwards, radius 40 mm"
    assert "memory: a fit of " in said and " GB are free" in said
    assert all(text in said for text in (rings, "in-space", "opposite detectors agree best"))
    choices = choose(load_scan(path))
    rim = (choices.region_radius - (REACH - 0.018)) / 0.018  # of the bell, at its far side
    profile = np.asarray(BELL._profile(jnp.array([0.0, min(rim, 1.0)])))
    assert profile[1] < 1e-3 * profile[0] and choices.region_radius <= 1.5 * REACH
    assert choices.grade("region_radius") == "likely"
    assert choices.region_cut == choices.region_radius
    assert choices.alpha < 1e-5 and choices.low_pass == "none"
    given = {"region_radius": RADIUS, "pixels": 9, "max_frequency": MAX_FREQUENCY}
    found = reconstruct_file(path, model_based=False, **given)
    inside = np.asarray(found.region.contains(found.grid.points))
    error = np.abs(found.image * inside - integrals[2]).max()
    assert found.unit == "m" and error < 0.02
    speed_error = dict(found.choices.standard_errors)["sound_speed"]
    assert found.choices.sound_speed == pytest.approx(SOUND, abs=2 * speed_error)
    assert speed_error < 0.005 * SOUND
    assert found.choices.grade("sound_speed") == "guessed"  # there is no start in the format


@pytest.mark.filterwarnings("ignore:.*miss the detectors")
def test_records_of_scattered_elements_are_fitted(tmp_path, capsys, monkeypatch):
    """A cup of 70 wide ones that sees half: dead ones, a pulse, noise, a start; beside --direct.

    Of half of them, each with its own response, a coarse volume says no contradiction.
    """
    monkeypatch.setattr(misfit_in_space, "LISTENED", 40)
    points, rng = cup(70), np.random.default_rng(2)
    pulse = np.exp(-((np.arange(9) - 4) ** 2) / np.linspace(2, 6, 70)[:, None])  # of each
    wide = wide_record(points, (points - CENTER) / 0.04, 0.006, range(40, 170))
    data = np.asarray(apply_impulse_response(wide, pulse, origin=4))
    data = data + 0.03 * np.abs(data).max() * rng.standard_normal(data.shape)
    data[[5, 33]] = 0.0
    path, times = tmp_path / "cup.npz", np.arange(40, 170) / RATE
    known = {"impulse_response": pulse, "element_size": 0.006}
    np.savez(path, pressure=data, detectors=points, times=times, **known)
    options = f"--region-radius {RADIUS} --pixels 13 --max-frequency {1.5 * MAX_FREQUENCY}"
    options += f" --sound-speed {SOUND}"
    scan = load_scan(path)
    choices = choose(scan, region_radius=RADIUS, sound_speed=SOUND)
    curve = setup_of(scan, choices).curve
    assert "disks of radius 3.464 mm" in choices.table()
    assert float(curve.element_radius) == pytest.approx(0.006 / np.sqrt(3))
    errors = []
    for method in ("", "--direct"):
        line = f"reconstruct {path} {options} {method} --out {tmp_path / 'v.h5'}"
        assert main(line.split()) == 0
        with h5py.File(tmp_path / "v.h5") as file:
            volume = np.asarray(file["image"])
        grid = VolumeGrid(13, RADIUS, CENTER)
        wanted = np.asarray(BELL.volume(grid))
        errors.append(np.linalg.norm(volume - wanted) / np.linalg.norm(wanted))
        assert ("% of the record is not explained" in capsys.readouterr().out) == (not method)
    assert errors[0] < 0.15 and errors[0] < errors[1] / 2.5


@pytest.mark.filterwarnings("ignore:.*miss the detectors")
def test_a_matlab_file_of_elements_that_face_elsewhere_becomes_a_volume(tmp_path):
    """Size and normals of the file count: without normals the volume is worse."""
    points = cup(70)
    towards = (points - CENTER) / 0.04
    aside = towards + np.asarray(across(jnp.asarray(towards))[0])  # by 45 degrees
    normals = aside / np.linalg.norm(aside, axis=1, keepdims=True)
    known = {"positions": points, "fs": RATE, "element_size": 0.008, "normals": normals}
    known["pressure"] = wide_record(points, normals, 0.008, range(170))
    options = f"--region-radius {RADIUS} --pixels 13 --sound-speed {SOUND} --length-unit m --quiet"
    grid, errors = VolumeGrid(13, RADIUS, CENTER), []
    wanted = np.asarray(BELL.volume(grid))
    for name in ("facing", "unknown"):
        path, out = tmp_path / f"{name}.mat", tmp_path / f"{name}.nii.gz"
        scipy.io.savemat(path, known)
        assert main([*f"reconstruct {path} {options} --out".split(), str(out)]) == 0
        image = nibabel.load(out)
        volume = image.get_fdata()
        assert volume.shape == (13, 13, 13)
        corner = image.affine @ [12, 0, 6, 1]
        np.testing.assert_allclose(corner[:3], 1e3 * np.asarray(grid.points[12, 0, 6]), atol=1e-9)
        errors.append(np.linalg.norm(volume - wanted) / np.linalg.norm(wanted))
        known.pop("normals", None)
    assert errors[0] < 0.07 and errors[0] < errors[1] / 2


@pytest.mark.filterwarnings("ignore:.*miss the detectors")
def test_an_ipasc_file_of_disks_becomes_a_volume(tmp_path, capsys):
    """Size and orientation in the file count, and are said; without the size it is worse."""
    points = cup(70)
    towards = (points - CENTER) / 0.04
    aside = towards + np.asarray(across(jnp.asarray(towards))[0])  # by 45 degrees
    normals, path, out = aside / np.sqrt(2), tmp_path / "cup.hdf5", tmp_path / "v.npy"
    known = {"detectors": points, "sampling_rate": RATE, "sound_speed": SOUND}
    known |= {"element_radius": 0.0045, "normals": normals}
    save_ipasc(path, Scan("pressure", round_record(points, normals, 0.0045, range(170)), known))
    options = f"--region-radius {RADIUS} --pixels 13"
    wanted, errors = np.asarray(BELL.volume(VolumeGrid(13, RADIUS, CENTER))), []
    for sized in (True, False):
        assert main([*f"reconstruct {path} {options} --quiet --out".split(), str(out)]) == 0
        errors.append(np.linalg.norm(np.load(out) - wanted) / np.linalg.norm(wanted))
        assert main([*f"info {path} {options}".split()]) == 0
        said = capsys.readouterr().out.splitlines()
        (channels,) = (line for line in said if line.startswith("channels"))
        assert " sure " in channels and ("elements (in the file) as wide" in channels) == sized
        with h5py.File(path, "a") as file:
            for element in file["meta_data_device/detectors"].values():
                for tag in {"detector_geometry", "detector_geometry_type"} & set(element):
                    del element[tag]
    assert errors[0] < 0.07 and errors[0] < errors[1] / 2


@pytest.mark.filterwarnings("ignore:.*miss the detectors")
def test_fits_in_space_have_shorter_waves_than_detectors_tell_alone():
    """Half as short at most, as the record and voxels allow; the formula keeps its own."""
    points, rng = cup(70), np.random.default_rng(3)
    data = record(points, range(40, 170))
    data = data + 0.03 * np.abs(data).max() * rng.standard_normal(data.shape)
    known = {"detectors": points, "times": np.arange(40, 170) / RATE}
    scan, given = Scan("pressure", data, known), {"region_radius": RADIUS, "sound_speed": SOUND}
    direct = choose(scan, **given)
    alone = resolved_frequency(facts_in_space(scan).detectors, RADIUS)
    assert direct.max_frequency == pytest.approx(alone)
    fit = with_best_method(scan, direct)
    assert 1.2 * alone < fit.max_frequency <= 2.001 * alone
    assert fit.pixels == max(17, 1 + 2 * np.ceil(RADIUS * fit.max_frequency / np.pi))
    assert float(fit.radii[-1]) == pytest.approx(float(direct.radii[-1]))

    errors = []
    for choices in (fit, with_best_method(scan, choose(scan, max_frequency=alone, **given))):
        image = reconstruct(scan, choices).image
        wanted = np.asarray(BELL.volume(choices.grid))
        errors.append(np.linalg.norm(image - wanted) / np.linalg.norm(wanted))
    assert choices.max_frequency == alone  # as given
    assert errors[0] < 0.7 * errors[1]

    few = with_best_method(scan, choose(scan, pixels=11, **given))
    assert few.pixels == 11 and few.max_frequency <= np.pi * 10 / (2 * RADIUS)
    asked = with_best_method(scan, choose(scan, model_based=True, **given))
    assert asked.max_frequency == fit.max_frequency
    coarse = choose(scan, max_frequency=0.5 * alone, **given)
    assert with_best_method(scan, coarse).max_frequency == 0.5 * alone


@pytest.mark.filterwarnings("ignore:.*miss the detectors")
def test_a_volume_of_a_series_starts_from_the_one_before():
    """Fewer steps to the same volume, within what a fit leaves."""
    points, rng = cup(70), np.random.default_rng(4)
    bells, bell = of_bells(points), record(points)
    frames = np.stack([bells + bell, 0.9 * bells + 1.1 * bell])
    frames += 0.05 * frames.std() * rng.standard_normal(frames.shape)
    known = {"detectors": points, "sampling_rate": RATE, "sound_speed": SOUND}
    scan = Scan("pressure", frames, known)
    choices = choose(scan, region_radius=RADIUS, pixels=13, model_based=True)
    setup, series = setup_of(scan, choices), reconstruct(scan, choices).image
    alone = [fitted(scan, choices, setup, frame) for frame in frames]
    again = fitted(scan, choices, setup, frames[1], initial=alone[0].image)

    def off(one, other):
        return np.linalg.norm(one - np.asarray(other)) / np.linalg.norm(one)

    assert again.steps < alone[1].steps
    assert off(series[0], alone[0].image) < 1e-3 and off(series[1], again.image) < 1e-3
    assert 5e-3 < off(series[1], alone[1].image) < 3e-2


def test_normals_in_the_file_count_where_elements_face_elsewhere():
    """On rings and off them; those within a degree of the middle, and of points, do not."""
    for points in (cup(30), shuffled()[0]):
        towards = (points - CENTER) / 0.04
        aside = np.asarray(across(jnp.asarray(towards))[0])
        known = {"detectors": points, "sampling_rate": RATE, "sound_speed": SOUND}
        for turn, size, counts in ((0.01, 1e-3, False), (0.1, 1e-3, True), (0.1, None, False)):
            given = {"normals": -2 * (towards + turn * aside)}
            given |= {} if size is None else {"element_size": size}
            scan = Scan("pressure", record(points, range(60)), known | given)
            facts = facts_in_space(scan)
            assert (getattr(facts.detectors, "normals", None) is not None) == counts
            assert ("face where the file says" in facts.arrangement) == counts
            if counts:
                found = np.asarray(facts.detectors.normals)
                wanted = -(towards + turn * aside) / np.hypot(1, turn)
                np.testing.assert_allclose(found, wanted[facts.order], atol=1e-12)


def test_a_ball_of_another_speed():
    """By a record of the forward operator, which goes through the ball."""
    body, times = BallBody(CENTER, RADIUS, 1590.0, SOUND), np.arange(240) / RATE
    setup = Setup(CAP, REGION, GRID, medium=body, max_frequency=MAX_FREQUENCY)
    terms = pressure_terms(setup.sizes.inside, jnp.asarray(SOUND * times))
    pressure = operator_on(setup, GRID, record=terms)(BELL.volume(GRID))
    points, order = shuffled()
    known = {"detectors": points, "sampling_rate": RATE, "sound_speed": 1590.0}
    scan = Scan("pressure", np.asarray(pressure).reshape(-1, len(times))[order], known)
    given = {"region_radius": RADIUS, "pixels": 9, "max_frequency": MAX_FREQUENCY}
    choices = choose(scan, water_speed=SOUND, **given)
    assert eqx.tree_equal(choices.medium, body, rtol=1e-9)
    inside, truth = np.asarray(REGION.contains(GRID.points)), np.asarray(BELL.volume(GRID))
    through, one = (reconstruct(scan, each).image for each in (choices, choose(scan, **given)))
    errors = [np.linalg.norm((found - truth)[inside]) for found in (through, one)]
    assert errors[0] < 0.15 * np.linalg.norm(truth) and errors[0] < 0.7 * errors[1]
    with pytest.raises(ValueError, match=r"body_center has shape \(2,\), expected \(3\)"):
        choose(scan, water_speed=SOUND, body_center=(0.0, 0.0), **given)
    warm = choose(scan, water_temperature=30.0, **given)
    assert warm.water_speed == pytest.approx(float(water_speed(30.0)))


def test_the_formula_takes_no_thousand_scattered_elements():
    points = cup(900, bent=2.0)
    known = {"detectors": points, "sampling_rate": RATE, "sound_speed": SOUND}
    scan = Scan("pressure", record(points), known)
    choices = choose(scan, region_radius=RADIUS, pixels=9, max_frequency=MAX_FREQUENCY)
    with pytest.raises(ValueError, match="up to 800 detectors off rings, here are 900"):
        reconstruct(scan, choices)


@pytest.mark.parametrize(
    ("points", "samples", "given", "message"),
    [
        (cup(70) * [1, 1, 0], 250, {}, "lie in a plane and fill an area of it"),
        (
            np.r_[cup(70), [CENTER + 0.003]],
            250,
            {"region_radius": RADIUS},
            r"1 of 71 detectors are not outside of the region, .* number 70 at",
        ),
        (cup(70)[:1], 250, {}, "1 detectors, expected at least 4"),
        (cup(70), 100, {}, "the record ends after a path of 0.037.*are 0.04 from their middle"),
        (cup(70), 110, {"region_radius": RADIUS}, "the record ends 0.019.* before the far side"),
    ],
    ids=["flat", "in the region", "one", "short", "shorter than the region"],
)
def test_geometries_that_cannot_be_are_refused_in_one_line(points, samples, given, message):
    known = {"detectors": points, "sampling_rate": RATE, "sound_speed": SOUND}
    scan = Scan("pressure", record(points, range(samples)), known)
    with pytest.raises(ValueError, match=message) as refused:
        choose(scan, **given)
    assert "\n" not in str(refused.value)


def test_opposite_detectors_agree_on_the_speed_of_sound():
    """Within twice the standard error, in noise of a tenth of the sound; not of noise alone."""
    sound, times = record(), np.arange(250) / (0.97 * RATE)
    known = {"detectors": shuffled()[0], "times": times}
    rng = np.random.default_rng(0)
    noise = 0.1 * sound.std() * rng.standard_normal(sound.shape)
    scan = Scan("pressure", sound + noise, known)
    found = choose(scan)
    error = dict(found.standard_errors)["sound_speed"]
    assert found.sound_speed == pytest.approx(0.97 * SOUND, abs=2 * error)
    assert error < 0.005 * SOUND and found.grade("sound_speed") == "likely"
    silent = Scan("pressure", rng.standard_normal(sound.shape), known)
    with pytest.warns(Contradiction, match="no image explains this record"):
        found = choose(silent, region_radius=RADIUS)
    assert found.sound_speed == 1500.0 and found.grade("sound_speed") == "guessed"


def of_bells(points, samples=range(250)):
    """Of three bells about the middle, of which few detectors hear the same."""
    middles = CENTER + 0.001 * np.array([[6, -2, 1], [-5, 4, -3], [0, -6, 5]])
    tau = SOUND / RATE * np.asarray(samples)
    total = np.zeros((len(points), len(tau)))
    for middle in middles:
        d = np.linalg.norm(points - middle, axis=1)[:, None]
        h = [(1 - np.clip(s / 0.005, -1, 1) ** 2) ** 3 for s in (d - tau, d + tau)]
        total += ((d - tau) * h[0] + (d + tau) * h[1]) / (2 * d)
    return total


def test_without_a_start_in_the_file_the_speed_is_a_guess():
    """A record that starts late tells another speed as surely."""
    known = {"detectors": shuffled()[0], "sampling_rate": RATE}
    found = choose(Scan("pressure", record(samples=range(6, 250)), known))  # 1.5 us late
    assert found.sound_speed > 1.03 * SOUND
    assert {found.grade(name) for name in ("sound_speed", "time_shift")} == {"guessed"}
    assert "1 us more would make the speed" in dict(found.reasons)["time_shift"]


@pytest.mark.parametrize("told", [True, False], ids=["speed told", "speed untold"])
def test_rows_in_another_order_are_said_to_contradict(told):
    """Of a hemisphere, where hardly any detectors are opposite; in order nothing is said."""
    points, rng = cup(120, bent=1.0), np.random.default_rng(5)
    data = of_bells(points)
    data = data + 0.03 * np.abs(data).max() * rng.standard_normal(data.shape)
    known = {"detectors": points, "sampling_rate": RATE}
    known |= {"sound_speed": SOUND} if told else {}
    given = {"region_radius": 0.014}
    if told:  # a small region and a band are no contradiction
        narrow = {"region_radius": 0.005, "band": (1e5, 6e5)}
        assert choose(Scan("pressure", data, known), **narrow).sound_speed == SOUND
    mixed = Scan("pressure", data[rng.permutation(120)], known)
    with pytest.warns(Contradiction, match="no image explains this record"):
        found = choose(mixed, **given)
    assert "likely" not in dict(found.grades).values()


def test_the_volume_tells_the_speed_where_no_detectors_are_opposite():
    points = cup(160, bent=1.0)
    known = {"detectors": points, "sampling_rate": 1.03 * RATE}
    found = choose(Scan("pressure", of_bells(points), known), region_radius=0.014)
    assert found.sound_speed == pytest.approx(1.03 * SOUND, rel=5e-3)
    assert found.grade("sound_speed") == "guessed"
    assert dict(found.standard_errors)["sound_speed"] < 0.01 * SOUND
    points = cup(160, bent=0.4)
    found = choose(
        Scan("pressure", of_bells(points), known | {"detectors": points}), region_radius=0.014
    )
    assert found.sound_speed == 1500.0
    assert "less than half of the sphere" in dict(found.reasons)["sound_speed"]


@pytest.mark.parametrize("given", [{}, {"use": np.arange(70)}], ids=["all", "as chosen"])
def test_noisy_and_saturated_channels_are_left_out_unless_chosen(given):
    points, rng = cup(70), np.random.default_rng(6)
    data = of_bells(points)
    data = data + 1e-3 * np.abs(data).max() * rng.standard_normal(data.shape)
    data[11] += 0.1 * np.abs(data).max() * rng.standard_normal(data.shape[1])
    data[40] = np.clip(3 * data[40], -0.3 * data.max(), 0.3 * data.max())
    known = {"detectors": points, "sampling_rate": RATE, "sound_speed": SOUND}
    found = choose(Scan("pressure", data, known), region_radius=0.014, **given)
    assert found.left_out == (() if given else (11, 40))
    if not given:
        assert "40 saturated; 11 noisy" in found.table()


@pytest.mark.parametrize("n", [140, 150, 155])
def test_radii_end_with_a_short_record(n):
    """Where the region is as much as the record covers, its last radius must be there too."""
    known = {"detectors": shuffled()[0], "sampling_rate": RATE, "sound_speed": SOUND}
    scan = Scan("pressure", record()[:, :n], known)
    choices = choose(scan)
    end = SOUND / RATE * (n - 1)
    assert choices.region_radius == pytest.approx(end - 0.04)
    assert choices.radii[-1] <= end < choices.radii[-1] + 1.01 * choices.radial_step
    setup = setup_of(scan, choices)  # they still cover the region
    integrals_of(scan, choices, setup, scan.frame(0))  # and are in it


def of_open_cap():
    """Integrals over spheres of a bell in what a cap up to z_3 = R_g / 2 sees."""
    cap = spherical_cap(1.3, 0.65, 22, 56)
    radii = cap_radii(cap, ball(0.975), 0.06, sources=ball(1.2))
    bell = SolidBells([[0.02, 0.0, -0.2]], [0.75])
    known = {"detectors": np.asarray(cap.points).reshape(-1, 3), "radii": np.asarray(radii)}
    g = np.asarray(bell.spherical_integrals(cap, radii)).reshape(-1, len(radii))
    return Scan("circular_integrals", g, known), bell


def test_caps_open_above_the_middle_too():
    """Points on the boundary of what is seen suffice at any opening; and one to the end."""
    for top in (0.1, 0.3, 0.7):
        points = np.asarray(spherical_cap(1.3, 1.3 * top, 22, 56).points).reshape(-1, 3)
        known = {"detectors": points, "radii": 0.3 + 0.05 * np.arange(40)}
        noise = np.random.default_rng(4).random((len(points), 40))
        choices = choose(scan := Scan("circular_integrals", noise, known), pixels=33)
        assert choices.region_cut < choices.region_radius
        setup_of(scan, choices)
    scan, bell = of_open_cap()
    found = reconstruct(scan, choose(scan, pixels=17))
    inside = np.array(found.region.contains(found.grid.points))
    inside &= np.asarray(found.grid.points)[..., 2] < 0.4
    error = np.abs(found.image - np.asarray(bell.volume(found.grid)))[inside].max()
    assert inside.sum() > 400 and error < 0.03


def test_choices_of_few_detectors_anywhere_and_of_a_hemisphere():
    rng = np.random.default_rng(1)
    data, radii = rng.random((90, 40)), 0.1 + 0.06 * np.arange(40)
    unit = rng.standard_normal((90, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    scan = Scan("circular_integrals", data, {"detectors": unit, "radii": radii})
    choices = choose(scan)
    on_sphere = 90 / covered_share(DetectorPoints(unit))  # those at random leave holes
    assert choices.max_frequency < (np.sqrt(on_sphere) - 1) / 0.7
    assert "on no rings" in choices.table()
    assert "radius 1 about" in describe(scan, choices).replace("radius 1.0", "radius 1")
    half = np.asarray(spherical_cap(1.3, 0.0, 12, 24, rule="equal").points).reshape(-1, 3)
    known = {"detectors": half, "radii": radii}
    choices = choose(Scan("circular_integrals", rng.random((288, 40)), known))
    assert abs(choices.region_cut) < 1e-9 < choices.region_radius == pytest.approx(0.975)


def test_detectors_without_data_are_named():
    """Dead on a ring, or NaN; whole rings can be left out."""
    cap = spherical_cap(1.3, 0.5, 12, 80)
    data = np.random.default_rng(2).random((960, 40))
    data[[7, 500]], data[90, 2] = 0.0, np.nan
    radii = 0.1 + 0.06 * np.arange(40)
    known = {"detectors": np.asarray(cap.points).reshape(-1, 3), "radii": radii}
    scan = Scan("circular_integrals", data, known)
    with pytest.raises(ValueError, match=r"3 of 960 detectors .* \(rows 7, 90, 500 recorded"):
        choose(scan)
    with pytest.raises(ValueError, match=r"same even number.*up to 800 .* choose some with --use"):
        choose(scan, use=np.delete(np.arange(960), [7, 90, 500]))
    whole = np.setdiff1d(np.arange(960), np.r_[0:160, 480:560])
    assert "9 rings of 80" in choose(scan, use=whole).table()


def test_scattered_detectors_without_data_are_left_out(integrals):
    """Twenty of 364 on rings, dead or NaN: the others lie anywhere, the volume is as good."""
    radii, g, wanted = integrals
    data = np.array(g.reshape(-1, len(radii)))
    bad = np.sort(np.random.default_rng(3).choice(len(data), 20, replace=False))
    data[bad[:15]], data[bad[15:], 4] = 0.0, np.nan
    known = {"detectors": np.asarray(CAP.points).reshape(-1, 3), "radii": radii}
    scan = Scan("circular_integrals", data, known)
    choices = choose(scan, region_radius=RADIUS, pixels=9, max_frequency=MAX_FREQUENCY)
    assert choices.left_out == tuple(bad) and len(choices.channels) == 344
    assert "344 of 364" in choices.table() and f"left out: {bad[0]}" in choices.table()
    assert "on no rings" in describe(scan, choices)
    image = np.where(np.asarray(REGION.contains(GRID.points)), reconstruct(scan, choices).image, 0)
    assert np.abs(image - wanted).max() < 0.02 * wanted.max()


@pytest.mark.parametrize("offset", [0.0, 2.0])
def test_an_offset_is_said(offset):
    points = cup(70)
    pressure = record(points)
    pressure = pressure + offset * np.ptp(pressure)
    scan = Scan("pressure", pressure, {"detectors": points, "sampling_rate": RATE})
    with warnings.catch_warnings(record=True) as noted:
        warnings.simplefilter("always")
        choose(scan, region_radius=RADIUS, sound_speed=SOUND, pixels=9)
    said = [str(one.message) for one in noted if "the record has an offset" in str(one.message)]
    assert len(said) == (offset > 0)


def test_contradictions_in_space_are_refused():
    """Times, radii, sampling and sizes that do not fit each other, as in the plane."""
    points = shuffled()[0]
    data, known = record(), {"detectors": points, "sampling_rate": RATE}
    whole = Scan("pressure", data, known)
    for rate, path in ((1.2, r"3.112e\+05"), (1e9, "0.0003735")):
        other = Scan("pressure", data, known | {"sampling_rate": rate, "sound_speed": SOUND})
        with pytest.raises(ValueError, match=f"path of {path}, while .* 0.04 from their middle"):
            choose(other)
    with pytest.raises(ValueError, match=r"ends 0\.005.* before the far side"):
        choose(Scan("pressure", data[:, :160], known), region_radius=0.025)
    slow = Scan("pressure", data, known | {"sampling_rate": 1e4, "sound_speed": SOUND})
    with pytest.raises(ValueError, match=r"more than the whole region, 0\.04 across"):
        choose(slow, region_radius=RADIUS)
    assert choose(whole, max_frequency=10.0).max_frequency == 10.0  # as asked
    known = {"detectors": points, "radii": 0.03 + 1e-3 * np.arange(20)}
    integrals = Scan("circular_integrals", np.ones((364, 20)) * np.arange(20), known)
    chosen = choose(integrals)
    assert chosen.region_radius == pytest.approx(0.009)
    assert dict(chosen.reasons)["region_radius"] == "as much as the radii cover"
    short = choose(integrals, region_radius=RADIUS)  # fitted, as there is no formula
    assert short.model_based
    assert "radii run from 0.03 to 0.049" in dict(short.reasons)["model_based"]


def test_what_does_not_apply_in_space_is_refused(scan_file, tmp_path, capsys):
    for option in ("--region-center 0 0", "--model 2d", "--region-angle 30"):
        line = f"reconstruct {scan_file} --out {tmp_path / 'a.npy'} {option}"
        assert main(line.split()) == 2
        assert "there is no choice" in capsys.readouterr().err
    page = f"report {scan_file} --out {tmp_path / 'a.html'}"
    assert main(page.split()) == 2
    assert "are not for volumes: use jaxtat reconstruct" in capsys.readouterr().err
    for line in (
        f"plan --detectors-from {scan_file} --out {tmp_path / 'a.npz'} {OPTIONS}",
        f"reconstruct {scan_file} --K 2 --out {tmp_path / 'a.npy'} {OPTIONS}",
    ):
        assert main(line.split()) == 2
        assert "are not for volumes: use jaxtat reconstruct" in capsys.readouterr().err
    points = np.random.default_rng(0).standard_normal((900, 3))
    with pytest.raises(ValueError, match="Only up to 800 detectors may lie anywhere"):
        choose(Scan("circular_integrals", np.ones((900, 5)), {"detectors": points}))


@pytest.mark.parametrize("dimension", [2, 3])
def test_rows_that_are_not_there_are_refused(dimension):
    points = shuffled()[0] if dimension == 3 else np.eye(364)[:, :2]
    scan = Scan("circular_integrals", np.ones((364, 5)), {"detectors": points})
    for use, message in (
        ([0, 1, 364], "use holds 364, but the data have rows 0 to 363"),
        ([-1, 0], "use holds -1"),
        ([3, 4, 3], "more than once"),
        (np.ones(364, bool), "expected whole numbers"),
    ):
        with pytest.raises(ValueError, match=message):
            choose(scan, use=use)


def test_detectors_in_a_plane_do_not_record_volumes():
    theta = np.linspace(0.0, 6.0, 64)
    points = np.stack([np.cos(theta), np.sin(theta), 0 * theta], axis=1)
    scan = Scan("pressure", np.ones((64, 300)), {"detectors": points, "sampling_rate": 1e2})
    with pytest.raises(ValueError, match="model is 'in-space', but the detectors lie in a plane"):
        choose(scan, model="in-space")
