"""The page without a browser: its controls are moved here, and a queue stands for its thread."""

import queue
import threading
from dataclasses import replace

import numpy as np
import pytest
from bokeh.document import Document
from viewed import GIVEN, relative, write_scan

from jaxtat.fitting import FitCancelled
from jaxtat.io import Scan, load_scan
from jaxtat.scans import choose, integrals, setup_of
from jaxtat.viewer import Session
from jaxtat.viewer.page import ViewerPage

SPEEDS, SHARES = np.linspace(1400.0, 1600.0, 5), np.array([0.9, 0.6, 0.5, 0.7, 0.8])


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write_scan(tmp_path_factory.mktemp("page") / "scan.h5")


@pytest.fixture(scope="module")
def session(path):
    scan = load_scan(path)
    return Session(scan, choose(scan, **GIVEN))


@pytest.fixture
def make_page(path, monkeypatch):
    waiting = queue.Queue()
    monkeypatch.setattr(ViewerPage, "_later", lambda self, work: waiting.put(work))
    # the images of all speeds, which test_session makes, take longer than all that is tested here
    monkeypatch.setattr(Session, "unexplained", lambda *_: (SPEEDS, SHARES))

    def make(session):
        page = ViewerPage(Document(), session, "scan.h5", path, path.parent)
        page.waiting = waiting
        until(page, lambda: page.status.text.startswith("direct image in"))
        return page

    return make


@pytest.fixture
def page(session, make_page):
    return make_page(session.copy())


@pytest.fixture(scope="module")
def fitting_session(path):
    """Of a scan of which nothing asks for the formula."""
    scan = load_scan(path)
    given = {name: value for name, value in GIVEN.items() if name != "alpha"}
    return Session(scan, replace(choose(scan, **given), alpha=1e-2))


@pytest.fixture
def fitting_page(fitting_session, make_page):
    return make_page(fitting_session.copy())


def until(page, there):
    """Do what waits for the page's thread until something is there."""
    while not there():
        page.waiting.get(timeout=60)()


def shown(page):
    return np.nan_to_num(page.picture.image)


def test_the_page_goes_on_while_another_region_is_computed(page, session, monkeypatch):
    go, with_region = threading.Event(), Session.with_region

    def later(*arguments):
        assert go.wait(60)
        return with_region(*arguments)

    monkeypatch.setattr(Session, "with_region", later)
    before, first = shown(page), page._session
    page.region[0].value = 8.0
    page._take_region()
    assert page.move.disabled
    page.alpha.value = -1.0
    until(page, lambda: not np.array_equal(shown(page), before))
    assert page._session is first and page.move.disabled
    go.set()
    until(page, lambda: not page.move.disabled)
    assert page._session is not first and page._session.choices.region_radius == 0.008
    meanwhile = shown(page)
    until(page, lambda: not np.array_equal(shown(page), meanwhile))
    controls = page.controls
    assert controls.alpha == pytest.approx(0.1)
    wanted = first.with_region(0.008, session.choices.region_center, session.start)
    assert relative(shown(page), np.nan_to_num(wanted.image(controls))) < 1e-5


def test_a_region_that_cannot_be_leaves_the_page_as_it_is(page):
    before, first = shown(page), page._session
    page.region[0].value = 80.0
    page._take_region()
    until(page, lambda: not page.move.disabled)
    assert "region" in page.status.text
    assert page._session is first and np.array_equal(shown(page), before)


def test_the_direct_image_is_shown_until_the_fit_is_there(fitting_page):
    page, session = fitting_page, fitting_page._session
    assert session.start.method == "model-based" and page.method.active == 2
    assert page.picture.title.text == "direct image"
    assert page.status.text.endswith("; fitting under constraints ...")
    direct = session.copy().image(replace(session.start, method="direct"))
    assert relative(shown(page), np.nan_to_num(direct)) < 1e-6
    until(page, lambda: page.picture.title.text == "model-based image")
    assert page.status.text.startswith("model-based image in")
    fit = np.nan_to_num(session.copy().image(session.start))
    assert relative(shown(page), fit) < 1e-6 and fit.min() >= 0


def test_a_fit_ends_when_a_control_is_moved(fitting_page, monkeypatch):
    """The first one waits in the middle; what is shown in the end is that of the second."""
    page, image = fitting_page, Session.image
    until(page, lambda: page.picture.title.text == "model-based image")
    begun, go, ended = threading.Event(), threading.Event(), []

    def slow(session, controls):
        if controls.method == "model-based" and not begun.is_set():
            begun.set()
            assert go.wait(60)
            try:
                return image(session, controls)
            except FitCancelled:
                ended.append(controls.frame)
                raise
        return image(session, controls)

    monkeypatch.setattr(Session, "image", slow)
    page.frame.value = 1
    until(page, lambda: page.picture.title.text == "direct image")
    assert begun.wait(60)
    before = shown(page)
    page.frame.value = 2
    until(page, lambda: not np.array_equal(shown(page), before))
    assert page.picture.title.text == "direct image" and not ended
    go.set()
    until(page, lambda: page.picture.title.text == "model-based image")
    assert ended == [1]
    wanted = image(page._session.copy(), replace(page._session.start, frame=2))
    assert relative(shown(page), np.nan_to_num(wanted)) < 1e-6


def test_another_method_leaves_the_direct_image(fitting_page, monkeypatch):
    page, go = fitting_page, threading.Event()
    until(page, lambda: page.picture.title.text == "model-based image")
    image = Session.image
    monkeypatch.setattr(
        Session,
        "image",
        lambda session, controls: (
            (controls.method == "direct" or go.wait(60)) and image(session, controls)
        ),
    )
    assert page.alpha.disabled and all(slider.disabled for slider in page.looking.sliders)
    page.frame.value = 3
    until(page, lambda: page.picture.title.text == "direct image")
    page.method.active = 0
    go.set()
    until(page, lambda: not page._fits._busy and "fitting" not in page.status.text)
    assert not page.alpha.disabled and page.picture.title.text == "direct image"


def test_undo_goes_back_by_one_movement(page, monkeypatch):
    """A slider that is dragged is moved once, whatever it went through."""
    now = iter([10.0, 10.1, 10.2, 30.0, 31.0])
    monkeypatch.setattr("jaxtat.viewer.undoing.monotonic", lambda: next(now))
    start, begin = page.controls, page.alpha.value
    for power in (-1.0, -0.5, -0.25):
        page.alpha.value = power
    dragged = page.controls
    page.low_pass.active = 0
    page.undoing.undo()
    assert page.controls == dragged and page.low_pass.active == 1
    page.undoing.counter.value += 1  # as Ctrl-Z does
    assert page.controls == start and page.alpha.value == pytest.approx(begin)
    assert page.undoing.button.disabled
    page.undoing.undo()
    assert page.controls == start


def test_a_body_and_the_water_have_a_slider_each(path, make_page, page):
    assert not page.water.visible and page.controls.water_speed is None
    scan = load_scan(path)
    session = Session(scan, choose(scan, **GIVEN, sound_speed=1520.0, water_speed=1490.0))
    page = make_page(session)
    before, start = shown(page), page.controls
    assert page.water.visible and start == session.start and start.water_speed == 1490.0
    page.water.value = 1480.0
    until(page, lambda: not np.array_equal(shown(page), before))
    assert page.controls == replace(start, water_speed=1480.0)
    assert "1520 m/s in 1480 m/s" in page._in_words(page.controls)
    page.undoing.undo()
    assert page.controls == start


def test_the_start_of_a_record_has_a_slider_in_microseconds(page):
    before, start = shown(page), page.controls
    assert page.shift.visible and (page.shift.start, page.shift.end) == pytest.approx((-2, 2))
    page.shift.value = 0.5
    until(page, lambda: not np.array_equal(shown(page), before))
    assert page.controls == replace(start, time_shift=0.5 / 1e6)
    assert "later by 0.5 us" in page._in_words(page.controls)
    wanted = page._session.copy().image(page.controls)
    assert relative(shown(page), np.nan_to_num(wanted)) < 1e-6
    page.undoing.undo()
    assert page.controls == start and page.shift.value == 0


def test_circular_integrals_have_no_start(make_page, session):
    setup = setup_of(session.scan, session.choices)
    known = {"detectors": setup.curve.points, "radii": setup.radii}
    g = integrals(session.scan, session.choices, setup, session.scan.frame(0))
    scan = Scan("circular_integrals", np.asarray(g), known)
    given = {name: value for name, value in GIVEN.items() if name not in ("band", "dead_time")}
    page = make_page(Session(scan, choose(scan, **given)))
    assert not (page.shift.visible or page.speed.visible)
    assert page.controls.time_shift == 0 and page.shift.start < page.shift.end


def test_what_no_image_explains_is_shown_by_speed(page):
    until(page, lambda: page.curve_plot.visible)
    assert np.allclose(page.curve.data["speed"], SPEEDS)
    assert np.array_equal(page.curve.data["share"], SHARES)


def test_an_image_is_kept_beside_the_next(page):
    before = shown(page)
    page.beside.toggle.active = True
    page.alpha.value = 0.0
    until(page, lambda: relative(shown(page), before) > 0.1)
    kept = np.nan_to_num(page.beside._pixels.data["image"][0].T)
    assert page.beside.figure.visible and relative(kept, before) < 1e-6
    assert "direct image: frame 0, " in page.beside.title.text
    assert page.beside.title.text.endswith("alpha 0.01, cosine")
    page.beside.toggle.active = False
    assert not page.beside.figure.visible


def test_errors_are_shown_until_a_control_is_moved(page):
    page.errors.active = True
    until(page, lambda: page.picture.title.text == "may be off: direct image")
    assert 0 < np.nanmax(page.picture.image) < np.inf
    assert page.status.text.startswith("standard deviation")
    page.alpha.value = -1.0
    until(page, lambda: page.picture.title.text == "direct image")
    assert not page.errors.active
    page.method.active = 1
    page.errors.active = True
    until(page, lambda: "its errors" in page.status.text)
