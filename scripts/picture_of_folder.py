"""The contact sheet of the documentation: docs/pictures/contact_sheet.png.

Six scans of the same simulated body, each with fewer detectors and more noise than the one before,
as a folder that one command reconstructs.
"""

import shutil
import tempfile
from pathlib import Path

import jax
import numpy as np

from jaxtat.cli import main as jaxtat
from jaxtat.io.datasets import sample_scan

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "pictures" / "contact_sheet.png"
FEWER = 30  # detectors, from scan to scan
LEAST_NOISE, MORE_NOISE = 8.0, 10.0  # besides the sample's, and more from scan to scan [counts]


def write_scans(folder: Path) -> None:
    """Six scans, scan_1.npz to scan_6.npz."""
    sample_scan(folder / "scan_1.npz")
    sample, rng = dict(np.load(folder / "scan_1.npz")), np.random.default_rng(0)
    for k in range(6):
        rows = slice(0, len(sample["detectors"]) - FEWER * k)
        record = sample["pressure"][rows]
        noise = rng.normal(0, LEAST_NOISE + MORE_NOISE * k, record.shape)
        noisy = np.round(record + noise).astype(record.dtype)
        positions = {"detectors": sample["detectors"][rows]}
        np.savez(folder / f"scan_{k + 1}.npz", **sample | positions | {"pressure": noisy})


def main() -> None:
    """Reconstruct the folder and keep its sheet."""
    jax.config.update("jax_enable_x64", True)
    with tempfile.TemporaryDirectory() as place:
        scans, images = Path(place) / "scans", Path(place) / "images"
        scans.mkdir()
        write_scans(scans)
        jaxtat(["reconstruct", str(scans), "--out", str(images)])
        print((images / "summary.csv").read_text())
        shutil.copy(images / "contact_sheet.png", PICTURE)


if __name__ == "__main__":
    main()
