"""Notebooks run from top to bottom, and what they claim holds."""

import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
# these compute longer than they compile
COMPUTE = ("01_paper.ipynb", "03_choosing_K_by_gradient.ipynb", "05_uncertainty.ipynb")


def run(name, cells=None):
    """What all or some of a notebook's cells print, run where the notebook is, and its code."""
    notebook = nbformat.read(FOLDER / name, as_version=4)
    notebook.cells = [notebook.cells[i] for i in cells or range(len(notebook.cells))]
    folder = {"metadata": {"path": str(FOLDER)}}
    NotebookClient(notebook, timeout=900, kernel_name="python3", resources=folder).execute()
    text = "".join(o.get("text", "") for c in notebook.cells for o in c.get("outputs", []))
    return text, "\n".join(c.source for c in notebook.cells if c.cell_type == "code")


@pytest.mark.parametrize("name", sorted(path.name for path in FOLDER.glob("*.ipynb")))
def test_notebooks_run_from_top_to_bottom(name, data_folder, monkeypatch, request):
    """What a notebook claims it asserts itself, or prints as an error that is almost rounding."""
    request.getfixturevalue("little_optimised" if name in COMPUTE else "unoptimised")
    monkeypatch.setenv("JAXTAT_DATA", str(data_folder))
    text, code = run(name)
    errors = [float(v) for v in re.findall(r"largest error: (\S+)", text)]
    assert errors or "\nassert " in code
    assert max(errors, default=0.0) < 1e-7


DRAWS = ("plt.subplots(", "plt.figure(", "show_image(", "show_slices(")
LARGEST = 1_000_000  # bytes of a notebook


@pytest.mark.parametrize("name", sorted(path.name for path in FOLDER.glob("*.ipynb")))
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
        body = re.sub(r"^(?:def|class|@).*\n(?:(?: .*)?\n)*", "", cell.source, flags=re.M)
        if any(draws in body for draws in DRAWS):
            assert any("image/png" in output.get("data", {}) for output in cell.outputs), body


def test_calibration_without_the_measured_scan_says_so(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXTAT_DATA", str(tmp_path))
    text, _ = run("04_calibration.ipynb", [1, 8, 10])
    assert text == f"msot_scan9.npz is not in {tmp_path}: nothing is measured here.\n"
