"""The page without a browser: its controls are moved here, and a queue stands for its thread."""

import queue
import threading

import numpy as np
import pytest
from bokeh.document import Document
from viewed import GIVEN, relative, write_scan

from jaxtat.io import load_scan
from jaxtat.scans import choose
from jaxtat.viewer import Session
from jaxtat.viewer.page import ViewerPage


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write_scan(tmp_path_factory.mktemp("page") / "scan.h5")


@pytest.fixture(scope="module")
def session(path):
    scan = load_scan(path)
    return Session(scan, choose(scan, **GIVEN))


@pytest.fixture
def page(session, path, monkeypatch):
    waiting = queue.Queue()
    monkeypatch.setattr(ViewerPage, "_later", lambda self, work: waiting.put(work))
    page = ViewerPage(Document(), session.copy(), "scan.h5", path, path.parent)
    page.waiting = waiting
    until(page, lambda: page.status.text.startswith("image in"))
    return page


def until(page, there):
    """Do what waits for the page's thread until something is there."""
    while not there():
        page.waiting.get(timeout=60)()


def shown(page):
    return np.nan_to_num(page.picture._image)


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
