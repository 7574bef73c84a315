"""The page of a scan in space without a browser: a queue stands for its thread."""

import queue
import shlex
import threading
from types import SimpleNamespace

import h5py
import nibabel
import numpy as np
import pytest
from bokeh.document import Document
from made_volumes import MAX_FREQUENCY, RADIUS, RATE, SOUND, cup, record, shuffled
from viewed import GIVEN, OPTIONS, write_scan

from jaxtat.cli import main
from jaxtat.fitting import FitCancelled
from jaxtat.io import Scan, load_scan
from jaxtat.scans import choose, reconstruct, with_best_method
from jaxtat.scans.acquisition import some_frames
from jaxtat.viewer.serve import Viewer, _session
from jaxtat.viewer.volume_page import VolumePage
from jaxtat.viewer.volume_session import VolumeSession

pytestmark = pytest.mark.slow

BALL = {"region_radius": RADIUS, "pixels": 9, "max_frequency": MAX_FREQUENCY}
KNOWN = {"detectors": shuffled()[0], "sampling_rate": RATE, "sound_speed": SOUND}
WAVELENGTHS = [700.0, 800.0, 900.0]


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Three frames of the bell, of different strength."""
    path = tmp_path_factory.mktemp("volumes") / "cap.h5"
    with h5py.File(path, "w") as file:
        file["pressure"] = np.stack([factor * record() for factor in (1.0, 2.0, 3.0)])
        file["wavelengths"] = WAVELENGTHS
        file.update(KNOWN)
    return path


@pytest.fixture(scope="module")
def session(path):
    scan = load_scan(path)
    return VolumeSession(scan, choose(scan, **BALL))


@pytest.fixture(scope="module")
def wanted(session):
    """Volumes of `scans.reconstruct`, blank outside of the ball."""
    made = {}

    def of(method, frame):
        if (method, frame) not in made:
            choices = session.choices
            if method == "model-based":
                choices = with_best_method(session.scan, choices)
            image = reconstruct(some_frames(session.scan, [frame]), choices).image[0]
            inside = choices.region.contains(choices.grid.points)
            made[method, frame] = np.where(inside, image, np.nan)
        return made[method, frame]

    return of


@pytest.fixture
def make_page(path, tmp_path, monkeypatch):
    waiting = queue.Queue()
    monkeypatch.setattr(VolumePage, "_later", lambda self, work: waiting.put(work))

    def make(session):
        page = VolumePage(Document(), session, "cap.h5", path, tmp_path)
        page.waiting = waiting
        return page

    return make


@pytest.fixture
def page(session, make_page):
    """A page that shows the fit."""
    page = make_page(session)
    until(page, lambda: says(page, "model-based volume of frame 0 in"))
    return page


def until(page, there):
    """Do what waits for the page's thread until something is there."""
    while not there():
        page.waiting.get(timeout=120)()


def says(page, start):
    return page.status.text.startswith(start)


def shown(page, axis):
    """The picture across an axis as the browser gets it, (first axis, second)."""
    return page.slices._made[axis].pixels.data["image"][0].T


def same(one, other):
    return np.array_equal(one, np.asarray(other, np.float32), equal_nan=True)


def test_a_slider_shows_the_slice_of_the_volume_and_sends_no_other(page, session, wanted):
    volume, nodes = wanted("model-based", 0), [1e3 * session.choices.grid.axis(k) for k in range(3)]
    for axis in range(3):
        assert same(shown(page, axis), np.take(volume, 4, axis=axis))
    for axis, k in ((0, 6), (1, 3), (2, 8), (0, 0)):
        sent = [made.pixels.data for made in page.slices._made]
        slider = page.slices.sliders[axis]
        assert slider.step == pytest.approx(RADIUS * 1e3 / 4)
        slider.value = float(nodes[axis][k]) + 0.3  # the nearest voxel's
        assert same(shown(page, axis), np.take(volume, k, axis=axis))
        assert page.slices._made[axis].title.text == f"x{'₁₂₃'[axis]} = {nodes[axis][k]:.1f} [mm]"
        for other in {0, 1, 2} - {axis}:
            assert page.slices._made[other].pixels.data is sent[other]
            assert page.slices._lines[other][axis].location == pytest.approx(nodes[axis][k])
    x2, x3 = (page.slices.figures[0].xaxis[0], page.slices.figures[0].yaxis[0])
    assert (x2.axis_label, x3.axis_label) == ("x₂ [mm]", "x₃ [mm]")
    assert page.slices._lines[0][1].dimension == "height"  # x₂ is to the right


def test_projections_are_the_largest_values(page, wanted):
    volume = wanted("model-based", 0)
    page.slices.shown.active = 1
    filled = np.where(np.isnan(volume), -np.inf, volume)
    for axis in range(3):
        largest = filled.max(axis=axis)
        assert same(shown(page, axis), np.where(np.isfinite(largest), largest, np.nan))
        assert not any(line.visible for line in page.slices._lines[axis].values())
    assert all(slider.disabled for slider in page.slices.sliders)
    low, high = np.nanpercentile(volume, (0.2, 99.8))
    colours = {made.glyph.glyph.color_mapper for made in page.slices._made}
    assert [(c.low, c.high) for c in colours] == [(pytest.approx(low), pytest.approx(high))]
    page.slices.shown.active = 0
    assert same(shown(page, 1), volume[:, 4]) and page.slices._lines[0][1].visible


def test_the_direct_volume_is_shown_until_the_fit_is_there(session, make_page, wanted):
    page = make_page(session)
    assert session.start == "model-based" and session.direct_first
    until(page, lambda: page.slices.volume is not None)
    assert same(shown(page, 2), wanted("direct", 0)[:, :, 4])
    assert "alpha" in page.table.text and "f &gt;= 0" not in page.table.text
    until(page, lambda: ": step " in page.status.text)
    assert says(page, "computing the model-based volume of frame 0 ... 9 x 9 x 9: step ")
    assert same(shown(page, 2), wanted("direct", 0)[:, :, 4])
    until(page, lambda: says(page, "model-based volume of frame 0 in"))
    assert same(shown(page, 2), wanted("model-based", 0)[:, :, 4])
    assert "f &gt;= 0" in page.table.text


def test_frames_and_methods_that_were_there_are_there_at_once(page, wanted, monkeypatch):
    assert page.frame.title == "frame (700 nm)"
    page.frame.value = 2
    assert page.frame.title == "frame (900 nm)"
    until(page, lambda: says(page, "model-based volume of frame 2 in"))
    assert same(shown(page, 0), wanted("model-based", 2)[4])
    monkeypatch.setattr(VolumeSession, "volume", None)
    page.method.active = 0
    assert says(page, "direct volume of frame 2 in")
    assert same(shown(page, 0), wanted("direct", 2)[4])
    page.frame.value, page.method.active = 0, 1
    assert says(page, "model-based volume of frame 0 in")
    assert same(shown(page, 0), wanted("model-based", 0)[4])


def test_a_fit_ends_when_another_frame_is_wanted(page, wanted, monkeypatch):
    """The first one waits in the middle; what is shown in the end is that of the second."""
    volume, begun, go, ended = VolumeSession.volume, threading.Event(), threading.Event(), []

    def slow(session, method, frame):
        if (method, frame) != ("model-based", 1):
            return volume(session, method, frame)
        begun.set()
        assert go.wait(60)
        try:
            return volume(session, method, frame)
        except FitCancelled:
            ended.append(frame)
            raise

    monkeypatch.setattr(VolumeSession, "volume", slow)
    page.frame.value = 1
    until(page, lambda: same(shown(page, 0), wanted("direct", 1)[4]))
    assert begun.wait(60)
    page.frame.value = 2
    until(page, lambda: same(shown(page, 0), wanted("direct", 2)[4]))
    go.set()
    until(page, lambda: says(page, "model-based volume of frame 2 in"))
    assert ended == [1] and ("model-based", 1) not in page._computed
    assert same(shown(page, 0), wanted("model-based", 2)[4])


def test_an_error_is_a_line_and_the_volume_stays(page, monkeypatch):
    def refuse(*_):
        raise ValueError("frame 1 <is damaged>")

    before = shown(page, 0)
    monkeypatch.setattr(VolumeSession, "volume", refuse)
    page.frame.value = 1
    until(page, lambda: "frame 1 &lt;is damaged&gt;" in page.status.text)
    assert same(shown(page, 0), before)


def test_a_kept_volume_is_the_one_that_is_shown(page, path, tmp_path, monkeypatch, wanted):
    page.frame.value = 1
    until(page, lambda: says(page, "model-based volume of frame 1 in"))
    volume = np.nan_to_num(wanted("model-based", 1))
    for suffix in (".nii.gz", ".h5", ".h5"):
        page._keep(suffix)
        until(page, lambda suffix=suffix: says(page, "written") and suffix in page.status.text)
    until(page, lambda: "cap-1-2.h5" in page.status.text)
    image = nibabel.load(tmp_path / "cap-1-1.nii.gz")
    np.testing.assert_array_equal(image.get_fdata()[..., 0], volume)
    monkeypatch.chdir(tmp_path)
    again = f"reconstruct {path} --repeat cap-1-1.h5 --out again.h5 --quiet"
    assert main(again.split()) == 0
    for name in ("cap-1-1.h5", "again.h5"):
        with h5py.File(name) as file:
            np.testing.assert_allclose(file["image"][0], volume, atol=1e-12)
            assert file["frames"][:] == WAVELENGTHS[1]


@pytest.mark.parametrize("method", ["direct", "model-based"])
def test_the_command_makes_the_volume(page, path, tmp_path, monkeypatch, wanted, method):
    page.method.active = ["direct", "model-based"].index(method)
    until(page, lambda: says(page, f"{method} volume of frame 0 in"))
    for tag in ("<code>", "</code>", "<span style='white-space: nowrap'>", "</span>"):
        page.command.text = page.command.text.replace(tag, "")
    monkeypatch.chdir(tmp_path)
    program, *words = shlex.split(page.command.text)
    assert program == "jaxtat" and main([*words, "--quiet"]) == 0
    found, volume = nibabel.load("volume.nii.gz").get_fdata()[..., 0], wanted(method, 0)
    np.testing.assert_allclose(found, np.nan_to_num(volume), atol=1e-3 * np.nanmax(volume))


@pytest.mark.filterwarnings("ignore:.*miss the detectors")
def test_off_rings_there_is_nothing_before_the_fit(make_page, monkeypatch):
    scan = Scan("pressure", record(cup(70)), KNOWN | {"detectors": cup(70)})
    choices = choose(scan, **BALL | {"max_frequency": 450.0})
    session, asked = VolumeSession(scan, choices), []
    assert list(session.by_method) == ["direct", "model-based"] and not session.direct_first

    def volume(session, method, frame):
        asked.append(method)
        raise ValueError("enough")

    monkeypatch.setattr(VolumeSession, "volume", volume)
    page = make_page(session)
    assert page.status.text == "computing the model-based volume ..." and not page.frame.visible
    until(page, lambda: "enough" in page.status.text)
    assert asked == ["model-based"] and page.slices.volume is None
    page._keep(".h5")
    assert "no volume is there yet" in page.status.text


def test_what_the_formula_does_not_take_is_fitted():
    points = cup(900, bent=2.0)
    scan = Scan("pressure", record(points), KNOWN | {"detectors": points})
    assert list(VolumeSession(scan, choose(scan, **BALL)).by_method) == ["model-based"]
    with pytest.raises(ValueError, match="up to 800 detectors off rings, here are 900"):
        VolumeSession(scan, choose(scan, **BALL, alpha=1e-3))


@pytest.fixture(scope="module")
def plane_path(tmp_path_factory):
    return write_scan(tmp_path_factory.mktemp("plane") / "scan.h5")


def test_every_scan_gets_its_page(path, plane_path, monkeypatch):
    made = []
    for name in ("page.ViewerPage", "volume_page.VolumePage"):
        monkeypatch.setattr(
            f"jaxtat.viewer.{name}", lambda *of, name=name: made.append((name, of[1].scan.kind))
        )
    for each, given in ((plane_path, GIVEN), (path, BALL)):
        scan = load_scan(each)
        session = _session(scan, choose(scan, **given), None)
        Viewer._fill(SimpleNamespace(_what=(session, "a", None, None)), Document(), "o")  # type: ignore
    assert made == [("page.ViewerPage", "pressure"), ("volume_page.VolumePage", "pressure")]


def test_the_command_shows_volumes_in_voxels_of_their_own_number(path, plane_path, monkeypatch):
    """And images in the plane with 257 x 257 pixels."""
    found = []

    def view(scan, choices, **_):
        found.append(choices.pixels)
        return SimpleNamespace(address="", wait=lambda: None)

    monkeypatch.setattr("jaxtat.viewer.view", view)
    in_plane = OPTIONS.replace("--pixels 45", "")
    for line in (f"{path} --region-radius {RADIUS}", f"{plane_path} {in_plane}"):
        assert main(["view", *line.split(), "--no-browser", "--quiet"]) == 0
    assert found == [choose(load_scan(path), region_radius=RADIUS).pixels, 257]
