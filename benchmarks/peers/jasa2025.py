"""The table of the comparison of 2025 on digital twins, and jaxtat in it.

    python benchmarks/peers/jasa2025.py [FOLDER] [--source sim_raw]

FOLDER holds `calibration` and `testing` of record 15388429 of Zenodo, unpacked; by default it is
what `jaxtat.io.datasets.fetch("digital_twins_2025")` gives. As there, one slope and one intercept
per method come from the calibration set, and pixels count in the phantom's disk and where the
truth is above its median. Two measures differ in detail from theirs: SSIM is given the range of the
truth, and HaarPSI is the mean over the images, not that of all of them as one array.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from measures import MEASURES

METHODS = {
    "BP": ("bp", "BP"),
    "BPH": ("bph", "BPH"),
    "MB": ("mb", "MB"),
    "TR": ("tr", "TR_interp", "TR"),
    "ITTR": ("ittr", "ITTR_interp", "ITTR"),
    "FFT": ("fft", "FFT"),
    "jaxtat": ("jaxtat",),  # written by a person who reconstructs raw/SOURCE into it
}
DISK = 125  # pixels of 0.10667 mm about the middle


def main() -> int:
    parser = argparse.ArgumentParser(description="Table of the comparison on digital twins.")
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--source", default="sim_raw", help="sim_raw, sim or exp")
    options = parser.parse_args()
    try:
        rows = table(options.folder or _fetched(), options.source)
    except (ConnectionError, FileNotFoundError) as error:
        print(f"jasa2025: {error}", file=sys.stderr)
        return 2
    print("| | R |", " | ".join(MEASURES), "|")
    for name, values in rows.items():
        print(f"| {name} |", " | ".join(f"{value:.2f}" for value in values), "|")
    return 0


def _fetched() -> Path:
    from jaxtat.io.datasets import fetch

    return fetch("digital_twins_2025")


def table(folder: Path, source: str) -> dict[str, list[float]]:
    """Correlation in the calibration set, and means of all measures over the testing set.

    Raises:
        FileNotFoundError: if the folder has not what is needed.
    """
    truths = {part: _images(folder / part / "p0") for part in ("calibration", "testing")}
    rows = {}
    for name, spellings in METHODS.items():
        found = {part: _method(folder / part / "recons", spellings, source) for part in truths}
        if all(images is not None for images in found.values()):
            rows[name] = _measured(found, truths)
    if not rows:
        raise FileNotFoundError(f"{folder}/*/recons has no images of METHOD/{source}/*.npy.")
    return rows


def _images(folder: Path) -> np.ndarray:
    paths = sorted(folder.glob("*.npy"))
    if not paths:
        raise FileNotFoundError(
            f"there is no {folder}/*.npy: unpack record 15388429 of Zenodo "
            "(https://doi.org/10.5281/zenodo.15388429) and name the folder of `testing`."
        )
    return np.stack([np.load(path).astype(float) for path in paths])


def _method(recons: Path, spellings: tuple[str, ...], source: str) -> np.ndarray | None:
    for spelling in spellings:
        if (folder := recons / spelling / source).is_dir():
            return _images(folder)
    return None


def _measured(found: dict, truths: dict) -> list[float]:
    """The method's row."""
    values, truth = found["calibration"], truths["calibration"]
    inside = np.stack([_inside(one) for one in truth])
    slope, intercept = np.polyfit(values[inside], truth[inside], 1)
    correlation = np.corrcoef(values[inside], truth[inside])[0, 1]
    images = intercept + slope * found["testing"]
    pairs = [
        (image, one, _inside(one)) for image, one in zip(images, truths["testing"], strict=True)
    ]
    means = [np.mean([measure(*pair) for pair in pairs]) for measure in MEASURES.values()]
    return [float(correlation), *map(float, means)]


def _inside(truth: np.ndarray) -> np.ndarray:
    """The phantom: a disk, and what is brighter than its median outside of that."""
    axis = np.arange(len(truth)) - len(truth) // 2
    disk = np.hypot(axis[:, None], axis) <= DISK
    return disk | (truth > np.median(truth[disk]))


if __name__ == "__main__":
    sys.exit(main())
