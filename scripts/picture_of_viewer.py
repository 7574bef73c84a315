"""docs/pictures/viewer.png: the page of `jaxtat view`, photographed in Chromium.

It takes chromium and chromedriver on the path, and the public scan that `jaxtat.io.datasets` finds.
"""

import io
import shutil
import tempfile
import time
from pathlib import Path

import jax
from PIL import Image
from selenium import webdriver

import jaxtat
from jaxtat.io import load_scan

OUT = Path(__file__).resolve().parents[1] / "docs" / "pictures" / "viewer.png"
FLAGS = (  # no window, and nobody asked for anything
    "headless=new no-sandbox disable-gpu disable-quic no-first-run disable-sync "
    "disable-background-networking disable-component-update window-size=1180,1300"
)
THERE = """
const models = [...(window.Bokeh?.documents[0]?._all_models.values() ?? [])];
const fitted = (model) => model.type == "Div" && model.text.startsWith("model-based image in");
return models.some((model) => model.data?.share?.length > 0) && models.some(fitted);
"""  # the curve above the slider of the speed, and the fit in place of the direct image
SECONDS = 1200  # on a busy machine


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    source = jaxtat.io.datasets.fetch("msot_scan9")
    scan = load_scan(source)
    choices = jaxtat.scans.choose(scan, pixels=257, sound_speed=1477.0)
    viewer = jaxtat.view(scan, choices, source=source.name)
    driver = webdriver.ChromeService(shutil.which("chromedriver"))  # else Selenium looks for one
    with tempfile.TemporaryDirectory() as folder:
        browser = webdriver.Chrome(options_in(folder), driver)
        browser.get(viewer.address)
        wait_for_fit(browser)
        browser.refresh()  # the page says how long the image took: now without compiling
        wait_for_fit(browser)
        time.sleep(2)  # and is drawn
        page = Image.open(io.BytesIO(browser.get_screenshot_as_png()))
        browser.quit()
    viewer.close()
    page.convert("RGB").quantize(256, method=Image.Quantize.MEDIANCUT).save(OUT, optimize=True)
    print(f"{OUT.name}: {OUT.stat().st_size // 1024} kB")


def wait_for_fit(browser: webdriver.Chrome) -> None:
    """Until the page has all of what `THERE` asks for."""
    end = time.monotonic() + SECONDS
    while not browser.execute_script(THERE):
        if time.monotonic() > end:
            raise TimeoutError(f"no curve and fitted image in {SECONDS} s")
        time.sleep(0.5)


def options_in(folder: str) -> webdriver.ChromeOptions:
    """Without a window, and with a profile that is empty."""
    options = webdriver.ChromeOptions()
    for flag in FLAGS.split():
        options.add_argument(f"--{flag}")
    options.add_argument(f"--user-data-dir={folder}")
    return options


if __name__ == "__main__":
    main()
