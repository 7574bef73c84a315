"""What the viewer computes, without a browser: against the images of `scans.reconstruct`."""

import shlex
from dataclasses import replace

import h5py
import numpy as np
import pytest
from made_scans import SPEED
from viewed import GIVEN, OPTIONS, relative, write_scan

from jaxtat import DiskBody, OutlineBody
from jaxtat.cli import main
from jaxtat.io import Scan, load_scan
from jaxtat.io.frames import LazyFrames
from jaxtat.scans import Choices, choose, reconstruct, standard_deviations, with_facts
from jaxtat.scans.acquisition import some_frames
from jaxtat.viewer import ControlValues, Session, command_line, keep


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write_scan(tmp_path_factory.mktemp("viewed") / "scan.h5")


@pytest.fixture(scope="module")
def session(path):
    scan = load_scan(path)
    return Session(scan, choose(scan, **GIVEN))


def wanted(session, controls):
    """By the choices of the image, zero outside."""
    scan = with_facts(session.scan, frames=[controls.frame])
    image = reconstruct(scan, session.choices_of(controls)).image[0]
    return np.where(session.inside, image, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "turned",
    [
        {},
        {"sound_speed": 1460.0},
        {"alpha": 0.1, "low_pass": "none", "frame": 3},
        {"sound_speed": 1530.0, "alpha": 1e-3, "frame": 5},
        {"time_shift": -7e-7, "sound_speed": 1510.0},
    ],
)
def test_a_changed_control_gives_the_image_of_its_choices(session, turned):
    controls = replace(session.start, **turned)
    mine = session.copy()
    image = mine.image(controls)
    assert np.isnan(image[~mine.inside]).all()
    image = np.nan_to_num(image)
    assert relative(image, wanted(mine, controls)) < 1e-4
    if turned:
        assert relative(image, np.nan_to_num(session.image(session.start))) > 1e-2
    choices = mine.choices_of(controls)
    reasons = dict(choices.reasons)
    for name in {"sound_speed", "alpha", "low_pass", "time_shift"} & set(turned):
        assert getattr(choices, name) == turned[name]
        assert reasons[name] == "set in the viewer"


def test_what_one_person_turns_another_does_not_see(session):
    one, other = session.copy(), session.copy()
    before = other.image(other.start)
    one.image(replace(one.start, sound_speed=1450.0, alpha=0.5, frame=2))
    assert np.array_equal(other.image(other.start), before, equal_nan=True)


def test_of_thousands_of_frames_those_are_read_that_are_shown(session):
    frames, read = np.asarray(session.scan.data), []

    def some(numbers):
        read.extend(numbers.tolist())
        return frames[numbers % len(frames)]

    known = {name: session.scan.known[name] for name in ("detectors", "sampling_rate")}
    many = LazyFrames((5000, *frames.shape[1:]), frames.dtype, some)
    known |= {
        "sound_speed": SPEED,
        "laser_energy": np.resize(session.scan.known["laser_energy"], 5000),
    }
    scan = Scan("pressure", many, known)
    mine = Session(scan, choose(scan, **GIVEN))
    assert len(set(read)) <= 6  # to choose by
    read.clear()
    first = mine.image(replace(mine.start, frame=3001))
    mine.image(replace(mine.start, frame=3001, alpha=0.3))
    assert set(read) == {3001}
    assert relative(np.nan_to_num(first), wanted(session, replace(session.start, frame=1))) < 1e-4


@pytest.mark.parametrize(
    "turned", [{"sound_speed": 1470.0, "alpha": 0.03, "frame": 4}, {"method": "model-based"}]
)
def test_a_kept_file_gives_the_image_again(session, path, tmp_path, monkeypatch, turned):
    monkeypatch.chdir(tmp_path)
    mine, controls = session.copy(), replace(session.start, **turned)
    kept = keep(mine, controls, tmp_path, ".h5", path)
    assert kept.name == f"scan-{controls.frame}-1.h5"
    assert main(shlex.split(f"reconstruct {path} --repeat {kept} --out again.h5 --quiet")) == 0
    with h5py.File(kept) as one, h5py.File("again.h5") as other:
        assert relative(one["image"][:], other["image"][:]) < 1e-4
        assert np.array_equal(one["frames"][:], other["frames"][:])
        assert relative(one["image"][0], np.nan_to_num(mine.image(controls))) < 1e-12


def test_files_are_never_replaced(session, path, tmp_path):
    names = [keep(session, session.start, tmp_path, ".png", path).name for _ in range(2)]
    assert names == ["scan-0-1.png", "scan-0-2.png"]


def test_the_command_makes_the_image(session, path, tmp_path, monkeypatch):
    """Its radii are chosen anew, and differ by less than a step."""
    monkeypatch.chdir(tmp_path)
    mine, controls = session.copy(), replace(session.start, sound_speed=1490.0, alpha=0.02, frame=2)
    controls = replace(controls, time_shift=2.5e-7)
    line = command_line(mine.choices_of(controls), mine.frame_facts(2), str(path))
    program, *words = shlex.split(line.replace("image.png", "image.h5"))
    assert program == "jaxtat" and main([*words, "--quiet"]) == 0
    with h5py.File("image.h5") as file:
        assert relative(file["image"][0], np.nan_to_num(mine.image(controls))) < 1e-2
    said = "--use 0:30,31:90", "--frames 2:3", "--sound-speed 1490", "--alpha 0.02"
    for option in (*said, "--time-shift 0.00000025"):
        assert option in line


def test_back_projection_is_shown_but_is_no_choice(session):
    controls = replace(session.start, method="back-projection")
    image = session.image(controls)[session.inside]
    direct = session.image(session.start)[session.inside]
    assert np.corrcoef(image, direct)[0, 1] > 0.8
    with pytest.raises(ValueError, match="for comparison"):
        session.choices_of(controls)


def test_least_is_unexplained_at_the_speed_of_the_record(session):
    speeds, shares = session.unexplained(session.start)
    assert speeds[0] <= 1400.0 and speeds[-1] >= 1600.0 and 0 < shares.min() < shares.max() < 1
    assert abs(speeds[np.argmin(shares)] - SPEED) < 12.0


def test_what_is_unexplained_by_speed_is_that_of_the_start(session):
    """Sound that comes later by the way to the middle is slower."""
    distance, later = 0.04, 1e-6
    speeds, shares = session.unexplained(replace(session.start, time_shift=later))
    wanted = distance / (distance / SPEED + later)
    assert abs(speeds[np.argmin(shares)] - wanted) < 12.0 < SPEED - wanted


def test_a_body_keeps_its_outline_at_other_speeds(path, monkeypatch):
    scan = load_scan(path)
    choices = choose(scan, **GIVEN, sound_speed=1520.0, water_speed=1490.0)
    outline = OutlineBody.ellipse((0.001, 0.0), (0.013, 0.0125), 1520.0, 1490.0, 1.05)
    monkeypatch.setattr(Choices, "medium", property(lambda _: outline))
    mine = Session(scan, choices)
    controls = replace(mine.start, method="direct", sound_speed=1540.0, water_speed=1480.0)
    image, body = mine.image(controls), mine._live.setup.medium
    assert isinstance(body, OutlineBody) and np.array_equal(body.points, outline.points)
    assert (body.sound_speed, body.water_speed, body.density_ratio) == (1540.0, 1480.0, 1.05)
    assert not np.allclose(image, mine.image(replace(controls, sound_speed=1520.0)), equal_nan=True)


def test_another_region(session):
    mine = session.copy()
    controls = replace(session.start, alpha=0.02, time_shift=1e-7)
    moved = mine.with_region(0.008, (0.001, -0.002), controls)
    assert moved.choices.region_radius == 0.008
    assert moved.choices.region_center == (0.001, -0.002)
    assert moved.choices.channels == mine.choices.channels
    assert moved.start.alpha == 0.02 and moved.start.time_shift == 1e-7
    assert relative(np.nan_to_num(moved.image(controls)), wanted(moved, controls)) < 1e-4
    match = r"a region of radius 50 mm about \(0, 0\) mm: the nearest detector is 40 mm from there"
    with pytest.raises(ValueError, match=match):
        mine.with_region(0.05, (0.0, 0.0), controls)
    with pytest.raises(ValueError, match=r"region_center is 0.05 .* \(lengths in m\)"):
        mine.with_region(0.005, (0.05, 0.0), controls)


def test_a_part_of_the_region_is_looked_at_with_as_many_pixels(session):
    """Every second pixel of the part is one of the whole; files keep the whole."""
    mine, n = session.copy(), session.choices.pixels
    whole, quarter = mine.image(mine.start), (n - 1) // 4
    radius = mine.choices.region_radius / 2
    part = replace(mine.start, disk=(radius, (radius / 2, 0.0)))
    image, grid = mine.image(part), mine.grid(part)
    assert image.shape == whole.shape
    assert np.allclose(grid.center, [radius / 2, 0.0]) and np.allclose(grid.half_width, radius)
    middle = (n - 1) // 2
    first = np.searchsorted(session.choices.grid.x1, float(grid.x1[1]) - 1e-9)
    rows = slice(first, first + quarter * 2)
    columns = slice(middle - quarter, middle + quarter + 1)
    one, other = image[1::2, ::2], whole[rows, columns]
    assert np.isnan(image).any()
    both = np.isfinite(one) & np.isfinite(other)
    assert both.sum() > 200
    assert np.abs((one - other)[both]).max() < 1e-5 * np.nanmax(np.abs(whole))
    assert np.array_equal(mine.image(mine.start), whole, equal_nan=True)
    match = r"a disk of radius 5.5 mm that is 8.25 mm off the middle leaves .* radius is 11 mm"
    with pytest.raises(ValueError, match=match):
        mine.image(replace(mine.start, disk=(radius, (1.5 * radius, 0.0))))


def test_what_cannot_be_is_said_and_the_rest_goes_on(session):
    mine = session.copy()
    before = mine.image(mine.start)
    with pytest.raises(ValueError, match=r"with sound_speed 500 .* radii run .* \(lengths in m\)"):
        mine.image(replace(mine.start, sound_speed=500.0))
    with pytest.raises(ValueError, match="frame 6: there are 6"):
        mine.image(replace(mine.start, frame=6))
    with pytest.raises(ValueError, match="medium: these are images of one speed"):
        mine._live.replace(medium=DiskBody((0.0, 0.0), 0.011, 1540.0, 1500.0))
    with pytest.raises(ValueError, match="method is 'magic'"):
        ControlValues(1500.0, 1e-2, "none", method="magic")
    assert np.array_equal(mine.image(mine.start), before, equal_nan=True)


def test_a_scan_that_cannot_be_read_is_one_line(tmp_path, capsys):
    (tmp_path / "no.h5").write_bytes(b"\x89HDF\r\n\x1a\n and nothing")
    assert main(["view", str(tmp_path / "no.h5"), "--no-browser"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("jaxtat: error: cannot read")
    assert main(["view", str(tmp_path / "none.h5")]) == 2
    assert "there is no file" in capsys.readouterr().err


def test_plans_are_refused(path, capsys):
    assert main(["view", str(path), *OPTIONS.split(), "--K", "4"]) == 2
    assert "--alpha is for a reconstruction without" in capsys.readouterr().err
    assert main(["view", str(path), "--K", "4"]) == 2
    assert "leave out --K" in capsys.readouterr().err


def test_choices_of_a_fit_are_kept_for_its_images(session, path):
    scan = load_scan(path)
    given = {name: value for name, value in GIVEN.items() if name != "alpha"}
    fit = choose(scan, **given, penalty="second-order", nonnegative=True)
    mine = Session(scan, fit)
    assert mine.start.method == "model-based" and not mine.choices.model_based
    found, direct = mine.choices_of(mine.start), replace(mine.start, method="direct")
    assert (found.penalty, found.nonnegative, found.model_based) == ("second-order", True, True)
    assert dict(found.reasons)["penalty"] == "given"
    assert "penalty" not in dict(mine.choices_of(direct).reasons)
    moved = mine.with_region(0.008, (0.001, -0.002), mine.start)
    assert moved.choices_of(moved.start).penalty == "second-order"
    assert session.start.method == "direct"  # its alpha is given


def test_errors_are_those_of_the_choices(session):
    """Of the frame that is shown, whatever part of it is looked at."""
    direct = replace(session.start, method="direct", frame=1)
    found = session.errors(replace(direct, disk=(0.005, (0.001, 0.0))))
    choices = session.choices_of(direct)
    wanted = standard_deviations(some_frames(session.scan, [1]), choices)[0]
    inside = session.inside
    assert np.isnan(found.deviation[~inside]).all()
    assert relative(np.asarray(found.deviation)[inside], wanted[inside]) < 1e-12
