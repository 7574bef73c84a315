"""The page in a real browser, one server for all; and its server without one."""

import asyncio
import json
import shutil
import sys
import time
import urllib.error
import urllib.request
from dataclasses import replace

import h5py
import numpy as np
import pytest
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect
from viewed import GIVEN, relative, write_scan

from jaxtat import view
from jaxtat.cli import main
from jaxtat.io import load_scan
from jaxtat.scans import choose
from jaxtat.viewer import Session

FLAGS = (  # no window, and nobody asked for anything
    "headless=new no-sandbox disable-gpu disable-quic no-first-run disable-sync "
    "disable-background-networking disable-component-update window-size=1180,1250"
)
PATIENCE = 600.0  # [s] until a page that does not answer ends a test; machines may be slow
SEEN = """
const models = [...Bokeh.documents[0]._all_models.values()];
const one = (type, test) => models.find((model) => model.type == type && test(model));
const source = one("ColumnDataSource", (model) => model.data.image);
const texts = models.filter((model) => model.type == "Div").map((model) => model.text);
const image = source.data.image[0];
return {texts, shape: [...image.shape], image: [...image].map((x) => isNaN(x) ? 0 : x)};
"""
# what lies behind the roots of shadow trees is found from each of them
ALL = """
const found = [];
const look = (root) => {
  for (const element of root.querySelectorAll("*")) {
    if (element.matches(arguments[0])) found.push(element);
    if (element.shadowRoot) look(element.shadowRoot);
  }
};
look(document);
return found;
"""
MOVE = """
const models = [...Bokeh.documents[0]._all_models.values()];
const wanted = (model) => model.type == "Slider" && model.title.startsWith(arguments[0]);
models.find(wanted).value = arguments[1];
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write_scan(tmp_path_factory.mktemp("viewed") / "scan.h5")


@pytest.fixture(scope="module")
def session(path):
    scan = load_scan(path)
    return Session(scan, choose(scan, **GIVEN))


@pytest.fixture(scope="module")
def viewer(path, session):
    with pytest.MonkeyPatch.context() as patch:
        # of every page that is opened: images of all speeds, in threads that go on after the tests
        patch.setattr(Session, "unexplained", lambda *_: None)
        viewer = view(session.scan, session.choices, source=path, folder=path.parent)
        yield viewer
        viewer.close()


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Chromium without a window, that asks nobody for anything."""
    webdriver = pytest.importorskip("selenium.webdriver")
    places = [shutil.which(name) for name in ("chromium", "chromedriver")]
    if None in places:
        pytest.skip("there is no chromium with a chromedriver on the path")
    options = webdriver.ChromeOptions()
    options.binary_location = places[0]
    for flag in FLAGS.split():
        options.add_argument(f"--{flag}")
    options.add_argument(f"--user-data-dir={tmp_path_factory.mktemp('browser')}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    service = webdriver.ChromeService(places[1])
    driver = webdriver.Chrome(options, service)
    driver.set_script_timeout(PATIENCE)
    driver.command_executor.client_config.timeout = PATIENCE
    yield driver
    driver.quit()


def until(asked):
    """What is asked for, as soon as it is there."""
    end = time.monotonic() + PATIENCE
    while not (found := asked()):
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.05)
    return found


def seen(browser):
    """Texts and image of the page, once there is one."""

    def asked():
        if not browser.execute_script("return !!(window.Bokeh && Bokeh.documents.length)"):
            return None
        found = browser.execute_script(SEEN)
        words = "direct image in", "<code>"  # the command, which comes last
        there = [any(text.startswith(word) for text in found["texts"]) for word in words]
        return found if all(there) else None

    found = until(asked)
    return np.reshape(found["image"], found["shape"]).T, found["texts"]


def other_than(browser, image):
    """The next image that is another."""

    def asked():
        now, _ = seen(browser)
        return now if not np.array_equal(now, image) else None

    return until(lambda: [found] if (found := asked()) is not None else None)[0]


def press(browser, words):
    (button,) = [b for b in browser.execute_script(ALL, "button") if b.text == words]
    button.click()


@pytest.fixture
def page(viewer, browser):
    """A page just opened, with its first image."""
    browser.get(viewer.address)
    return seen(browser)


def test_the_page_opens_with_the_image_and_asks_nobody_else(viewer, browser, session, page):
    image, texts = page
    assert relative(image, np.nan_to_num(session.image(session.start))) < 1e-6
    text = " ".join(texts)
    assert "scan.h5" in text and "6 frames of 90 detectors" in text
    assert "given" in text and "--region-radius" in text
    origin = viewer.address.rpartition("/")[0]
    asked = []
    for entry in browser.get_log("performance"):
        message = json.loads(entry["message"])["message"]
        if message["method"] == "Network.requestWillBeSent":
            asked.append((message["params"]["documentURL"], message["params"]["request"]["url"]))
        if message["method"] == "Network.webSocketCreated":
            asked.append((viewer.address, message["params"]["url"]))
    asked = [url for document, url in asked if not document.startswith("chrome")]
    assert any(url.startswith("ws://127.0.0.1") for url in asked)
    for url in asked:
        assert url.startswith((f"{origin}/", origin.replace("http", "ws"), "data:", "blob:")), url
    bad = [entry for entry in browser.get_log("browser") if entry["level"] != "INFO"]
    assert not bad


def test_a_slider_changes_the_picture_and_a_kept_file_gives_it_again(
    browser, session, page, path, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    first, _ = page
    handles = browser.execute_script(ALL, ".noUi-handle")
    frame, _, alpha, *_ = (handle for handle in handles if handle.is_displayed())
    frame.send_keys("\ue014")  # an arrow to the right
    second = other_than(browser, first)
    alpha.send_keys("\ue012")  # and to the left
    third = other_than(browser, second)
    controls = replace(session.start, frame=1)
    assert relative(second, np.nan_to_num(session.copy().image(controls))) < 1e-6
    before = set(path.parent.iterdir())
    press(browser, "Keep all choices (.h5)")
    until(lambda: [t for t in browser.execute_script(SEEN)["texts"] if t.startswith("written")])
    (kept,) = set(path.parent.iterdir()) - before
    assert kept.name == "scan-1-1.h5"
    assert main(["reconstruct", str(path), "--repeat", str(kept), "--out", "a.h5", "--quiet"]) == 0
    with h5py.File("a.h5") as file:
        assert relative(third, file["image"][0]) < 1e-4


def test_a_part_of_the_region_is_seen_at_once(browser, session, page):
    """A smaller radius by a step of its slider, of the same systems."""
    first, _ = page
    browser.execute_script(MOVE, "look at a radius", 8.0)
    second = other_than(browser, first)
    controls = replace(session.start, disk=(0.008, session.choices.region_center))
    assert relative(second, np.nan_to_num(session.copy().image(controls))) < 1e-6


def test_another_start_of_the_record_is_seen_at_once(browser, session, page):
    first, _ = page
    browser.execute_script(MOVE, "times of the record", 0.5)  # microseconds
    second = other_than(browser, first)
    controls = replace(session.start, time_shift=0.5 / 1e6)
    assert relative(second, np.nan_to_num(session.copy().image(controls))) < 1e-6


def test_a_second_page_has_controls_of_its_own(viewer, browser, page):
    first, _ = page
    here = browser.current_window_handle
    browser.switch_to.new_window("tab")
    browser.get(viewer.address)
    other, _ = seen(browser)
    assert np.array_equal(first, other)
    browser.execute_script(ALL, ".noUi-handle")[0].send_keys("\ue014")
    other_than(browser, first)
    browser.close()
    browser.switch_to.window(here)
    assert np.array_equal(seen(browser)[0], first)
    browser.execute_script(ALL, ".noUi-handle")[1].send_keys("\ue014")
    other_than(browser, first)  # and it still turns


def test_an_error_is_a_line_on_the_page(browser, page, session, monkeypatch):
    def refuse(self, controls):
        raise ValueError("frame 1 <is damaged>")

    monkeypatch.setattr(Session, "image", refuse)
    browser.execute_script(ALL, ".noUi-handle")[0].send_keys("\ue014")

    def said():
        texts = browser.execute_script(SEEN)["texts"]
        return [text for text in texts if "frame 1 &lt;is damaged&gt;" in text]

    assert until(said)


def status(address):
    """Of the answer, whenever it comes: the server's thread makes a page for each that asks."""
    try:
        return urllib.request.urlopen(address, timeout=PATIENCE).status
    except urllib.error.HTTPError as error:
        return error.code


def test_without_the_token_there_is_nothing(viewer):
    origin, _, token = viewer.address.rpartition("/")
    assert origin.startswith("http://127.0.0.1:") and len(token) >= 32
    assert status(viewer.address) == 200
    for path in ("", "/", f"/{token[:-1]}", "/token", f"/{token[::-1]}"):
        assert status(origin + path) == 404


@pytest.mark.parametrize(
    ("header", "value"),
    [
        ("Host", "elsewhere.example:{port}"),  # a name that leads to this machine
        ("Host", "127.0.0.1:1"),
        ("Host", ""),
        ("Origin", "http://elsewhere.example"),
        ("Origin", "http://127.0.0.1:1"),
        ("Origin", "null"),
    ],
)
def test_other_names_and_pages_of_others_are_refused(viewer, header, value):
    """Even by those who know the token, of the page and of what it loads."""
    origin, _, token = viewer.address.rpartition("/")
    headers = {header: value.format(port=origin.rpartition(":")[2])}
    for path in (f"/{token}", "/static/js/bokeh.min.js"):
        assert status(urllib.request.Request(origin + path, headers=headers)) == 403
        assert status(urllib.request.Request(origin + path, headers={"Origin": origin})) == 200


def test_pages_from_elsewhere_cannot_connect(viewer):
    address = viewer.address.replace("http", "ws") + "/ws"
    request = HTTPRequest(address, headers={"Origin": "http://elsewhere.example"})
    with pytest.raises(HTTPClientError, match="403"):
        asyncio.run(connect(request))


async def connect(request):
    return await websocket_connect(request)


def test_a_port_in_use_is_refused_and_the_end_is_one(viewer, session):
    port = int(viewer.address.rpartition("/")[0].rpartition(":")[2])
    with pytest.raises(ValueError, match=f"no server at port {port}"):
        view(session.scan, session.choices, port=port)
    other = view(session.scan, session.choices)
    assert other.address in other._repr_html_() and status(other.address) == 200
    other.close()
    other.close()
    with pytest.raises(urllib.error.URLError):
        status(other.address)
    assert status(viewer.address) == 200


def test_without_bokeh_it_says_what_to_install(session, monkeypatch):
    monkeypatch.setitem(sys.modules, "bokeh", None)
    with pytest.raises(ValueError, match=r"pip install 'jaxtat\[view\]'"):
        view(session.scan, session.choices)
