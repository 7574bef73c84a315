"""Notebooks run from top to bottom, and what they claim holds."""

import base64
import io
import os
import re
from pathlib import Path

import nbformat
import pytest
from jupyter_client.manager import KernelManager
from nbclient import NotebookClient
from PIL import Image

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
# by the time they take
NAMES = (
    "10_images_with_constraints.ipynb",
    "11_learning_through_ten_steps.ipynb",
    "01_paper.ipynb",
    "12_looking_at_a_scan.ipynb",
    "13_two_speeds.ipynb",
    "05_uncertainty.ipynb",
    "03_choosing_K_by_gradient.ipynb",
    "02_truncation_and_tikhonov.ipynb",
    "04_calibration.ipynb",
    "07_three_dimensions.ipynb",
    "06_any_curve.ipynb",
    "08_designing_an_array.ipynb",
    "09_your_own_phantom.ipynb",
)
# Notebooks are kept as they were run at full size. Here they take fewer steps, draws and settings
# of the same kind, and smaller images where it is the time: each cell runs, and asserts what it
# always does. What the first says of the paper's size tests/paper asserts of the same plan.
# {name: {shown: run here}}
SMALLER = {
    "01_paper.ipynb": {  # two thirds of the pixels and detectors
        "n_detectors=500": "n_detectors=345",
        "ImageGrid(129)": "ImageGrid(89)",
        "jnp.ones(129)": "jnp.ones(89)",
        "jnp.arange(256) - 128": "jnp.arange(176) - 88",
        "(3, 31, 127)": "(3, 31, 87)",
        "plan.frequencies[-1], 128": "plan.frequencies[-1], 88",
    },
    "02_truncation_and_tikhonov.ipynb": {
        "n_detectors=250": "n_detectors=160",
        "ImageGrid(65)": "ImageGrid(41)",
        "(9, 39, 63)": "(9, 24, 39)",
        "singular_values[39]": "singular_values[24]",
        "singular_values[39, 0]": "singular_values[24, 0]",
        "j_max[39]": "j_max[24]",
        "20 * np.pi": "12.5 * np.pi",
        "K=[1.2, 1.5, 2.0, 3.0, 4.3, 6.0, 10.0]": "K=[1.5, 4.3]",
        "alpha=[1e-1, 1e-2, 1e-3]": "alpha=[1e-1, 1e-2]",
    },
    "03_choosing_K_by_gradient.ipynb": {
        "jaxtat.ImageGrid(33)": "jaxtat.ImageGrid(25)",
        "arc(0.0, grid, 130, n_directions=48)": "arc(0.0, grid, 100, n_directions=36)",
        "np.geomspace(1.0, 10.0, 8)": "np.geomspace(1.0, 10.0, 2)",
        "np.linspace(5.0, 200.0, 8)": "np.linspace(5.0, 200.0, 2)",
        "(0.02, 0.05, 0.15)": "(0.15,)",  # the largest noise
        '("geometry #1", 1.0), ("geometry #2", 0.0)': '("geometry #2", 0.0),',
        "steps=12": "steps=4",
        "jaxtat.ImageGrid(41)": "jaxtat.ImageGrid(25)",
        "arc(cut, grid, 160)": "arc(cut, grid, 100)",
        "np.geomspace(0.1, 12, 15)": "np.geomspace(0.1, 12, 8)",
        "np.geomspace(1e-6, 1e4, 15)": "np.geomspace(1e-6, 1e4, 11)",
    },
    "04_calibration.ipynb": {  # of the measured scan every fourth detector
        'file["geometry"]': 'file["geometry"][::4]',
        'file["raw"].astype(float)': 'file["raw"][::4].astype(float)',
        "ImageGrid(91,": "ImageGrid(61,",
        "highest = 7000.0": "highest = 3000.0",  # rad/m
    },
    "05_uncertainty.ipynb": {
        "ImageGrid(33)": "ImageGrid(25)",
        "n_detectors=130": "n_detectors=100",
        "(n_samples, 130,": "(n_samples, 100,",
        "[:, 16]": "[:, 12]",
        "n_samples = 400": "n_samples = 200",
        "bounds = 1.5, 2.0, 3.0, jaxtat.PAPER_K, 8.0, 16.0": "bounds = 2.0, jaxtat.PAPER_K, 8.0",
    },
    "07_three_dimensions.ipynb": {
        "VolumeGrid(33)": "VolumeGrid(27)",
        "n_rings=48, n_azimuths=128": "n_rings=39, n_azimuths=104",
        "volume = reconstruct(g, exact_data)  # compiles\n": "",
        "VolumeGrid(37)": "VolumeGrid(33)",
        "n_rings=40, n_azimuths=144": "n_rings=36, n_azimuths=128",
    },
    "08_designing_an_array.ipynb": {"N = 60": "N = 40"},
    "10_images_with_constraints.ipynb": {
        "ImageGrid(65)": "ImageGrid(45)",
        "n_detectors=250": "n_detectors=174",
        "np.arange(250)": "np.arange(174)",
        "(0.02, tenth)": "(0.05, tenth)",  # fits end sooner
        "(0.01, early)": "(0.05, early)",
        "(100, *g.shape)": "(30, *g.shape)",
        "1.2 * pixel, 1.6": "1.2 * pixel, 1.4",  # a vessel of larger pixels
        "shape = (120, 120)": "shape = (96, 96)",
        "24:89, 24:89": "24:69, 24:69",
    },
    "11_learning_through_ten_steps.ipynb": {
        "examples(disks, 16, 0.1": "examples(disks, 4, 0.1",
        "rng.choice(16, 8,": "rng.choice(4, 4,",
        "range(1, 41)": "range(1, 4)",
        "examples(kind, 8, level, seed=99)": "examples(kind, 2, level, seed=99)",
    },
    "12_looking_at_a_scan.ipynb": {
        "pixels=81, max_frequency=6e3": "pixels=45, max_frequency=3.5e3",
    },
    "13_two_speeds.ipynb": {
        "0.7, n_detectors=90": "0.7, n_detectors=56",
        "jaxtat.ImageGrid(41,": "jaxtat.ImageGrid(25,",
        "2.6, 501)": "2.6, 351)",
        "(1.005, 1.01, 1.015, 1.02, 1.03)": "(1.01, 1.02)",
    },
}


def smaller(name, source):
    for full, less in SMALLER.get(name, {}).items():
        source = source.replace(full, less)
    return source.replace('"figure.dpi": 150', '"figure.dpi": 50')


@pytest.fixture(scope="module")
def kernel(unoptimised_flags):
    """One process for all notebooks: they import once, and share compiled programs."""
    manager = KernelManager(kernel_name="python3")
    environment = os.environ | {"XLA_FLAGS": unoptimised_flags}
    manager.start_kernel(cwd=str(FOLDER), env=environment)
    yield manager
    manager.shutdown_kernel(now=True)


# What is left of the last notebook is programs and modules: not to be looked through for garbage
# again and again, which costs two seconds each time, and half a second by `%reset`.
FRESH = """import gc, os
for name in get_ipython().user_ns.keys() - get_ipython().user_ns_hidden.keys():
    if not name.startswith("_") and name not in ("gc", "os"):
        del globals()[name]
gc.freeze()
gc.set_threshold(200_000, 20, 100)
"""


def run(kernel, name, data_folder, cells=None):
    """What all or some of a notebook's cells print, without variables of others, and its code."""
    notebook = nbformat.read(FOLDER / name, as_version=4)
    notebook.cells = [notebook.cells[i] for i in cells or range(len(notebook.cells))]
    for cell in notebook.cells:
        cell.source = smaller(name, cell.source)
    fresh = FRESH + f"os.environ['JAXTAT_DATA'] = {str(data_folder)!r}"
    notebook.cells.insert(0, nbformat.v4.new_code_cell(fresh))
    client = NotebookClient(notebook, km=kernel, timeout=None)
    try:
        client.execute()
    finally:
        client.kc.stop_channels()
    text = "".join(o.get("text", "") for c in notebook.cells for o in c.get("outputs", []))
    return text, "\n".join(c.source for c in notebook.cells if c.cell_type == "code")


def test_all_are_run():
    assert sorted(NAMES) == sorted(path.name for path in FOLDER.glob("*.ipynb"))


@pytest.mark.parametrize("name", NAMES)
def test_notebooks_run_from_top_to_bottom(name, kernel, data_folder):
    """What a notebook claims it asserts itself, or prints as an error that is almost rounding."""
    text, code = run(kernel, name, data_folder)
    assert 'jax.config.update("jax_enable_x64", True)' in code  # in each, for it stays on
    errors = [float(v) for v in re.findall(r"largest error: (\S+)", text)]
    assert errors or "\nassert " in code
    assert max(errors, default=0.0) < 1e-7


def test_what_is_made_smaller_is_there():
    for name, changes in SMALLER.items():
        notebook = nbformat.read(FOLDER / name, as_version=4)
        code = "\n".join(c.source for c in notebook.cells if c.cell_type == "code")
        assert all(full in code for full in changes), name


DRAWS = ("plt.subplots(", "plt.figure(", "show_image(", "show_slices(")
LARGEST = 1_000_000  # bytes of a notebook
SHARP = 150  # dots per inch


@pytest.mark.parametrize("name", NAMES)
def test_notebooks_are_kept_with_their_pictures(name):
    """The documentation shows them as they are: every cell run in order, a picture of each plot."""
    assert (FOLDER / name).stat().st_size < LARGEST
    cells = [c for c in nbformat.read(FOLDER / name, as_version=4).cells if c.cell_type == "code"]
    counts = [cell.execution_count for cell in cells]
    assert None not in counts
    assert counts == sorted(set(counts))
    for cell in cells:
        kinds = {output.output_type for output in cell.outputs}
        assert "error" not in kinds
        assert "stderr" not in {output.get("name") for output in cell.outputs}  # no warnings
        pictures = [
            o["data"]["image/png"] for o in cell.outputs if "image/png" in o.get("data", {})
        ]
        for picture in pictures:
            resolution = Image.open(io.BytesIO(base64.b64decode(picture))).info["dpi"]
            assert resolution == pytest.approx((SHARP, SHARP), rel=1e-3)
        body = re.sub(r"^(?:def|class|@).*\n(?:(?: .*)?\n)*", "", cell.source, flags=re.M)
        if any(draws in body for draws in DRAWS):
            assert pictures, body


def test_calibration_without_the_measured_scan_says_so(kernel, tmp_path):
    text, _ = run(kernel, "04_calibration.ipynb", tmp_path, [1, 8, 10])
    assert text == f"msot_scan9.npz is not in {tmp_path}: nothing is measured here.\n"
