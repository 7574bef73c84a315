"""One environment per peer, made by pip; jaxtat's is the one that the driver runs in."""

import os
import subprocess
import sys
import venv
from dataclasses import dataclass
from pathlib import Path

from problems import IN_SPACE, NAMES, PLANE, TWO_SPEEDS


@dataclass(frozen=True)
class Peer:
    """A method: its script, what its environment holds, and the variable that names a clone.

    Of a ``reason`` it is not run; ``only`` are the problems that it is for.
    """

    title: str
    script: str
    environment: str = ""
    clone: str = ""
    only: tuple[str, ...] = PLANE
    reason: str = ""


REQUIREMENTS = {
    "patato": ["patato==0.7.0"],
    "kwave": ["k-Wave-python==0.6.2"],
    # the last version of JAX with which its simulation runs
    "jwave": ["jwave==0.2.1", "jax==0.4.38", "jaxlib==0.4.38", "scipy"],
    "scikit-image": ["scikit-image"],
    "gapat": ["gapat==1.2.0"],
    "torch-tat": ["numpy", "scipy", "torch"],
    "fast-hankel": ["numpy", "scipy"],
}
PEERS = [
    Peer("jaxtat, own choices", "jaxtat_choices", only=NAMES),
    Peer("jaxtat, told the same, fitted", "jaxtat_fitted", only=NAMES),
    Peer("jaxtat, told the same, direct", "jaxtat_direct"),
    Peer("PATATO, back-projection", "patato_backprojection", "patato"),
    Peer("PATATO, FFT", "patato_fft", "patato"),
    Peer("PATATO, FFT, fading mended", "patato_fft_mended", "patato"),
    Peer("PATATO, model-based", "patato_model_based", "patato"),
    Peer("k-Wave, time reversal", "kwave_time_reversal", "kwave"),
    Peer("jwave, time reversal", "jwave_time_reversal", "jwave"),
    Peer("scikit-image, iradon", "skimage_iradon", "scikit-image"),
    Peer("straight rays, two speeds", "straight_rays", only=TWO_SPEEDS),
    Peer("GAPAT, delay and sum", "gapat_sum", "gapat", only=IN_SPACE),
    Peer("GAPAT, back-projection", "gapat_universal", "gapat", only=IN_SPACE),
    Peer("beamax", "beamax", reason="it is for detectors on a line or a plane"),
    Peer("torch-TAT", "torch_tat", "torch-tat", "TORCH_TAT"),
    Peer("Fast-Hankel solver", "fast_hankel", "fast-hankel", "FAST_HANKEL"),
]


class Absent(Exception):
    """A peer cannot be run here: the reason."""


def python_of(environment: str, folder: Path) -> Path:
    """Its interpreter, the environment being made if it is not there.

    Raises:
        Absent: if pip fails.
    """
    if not environment:
        return Path(sys.executable)
    place = folder / environment
    python = place / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if not python.is_file():
        venv.create(place, with_pip=True)
    options = ["--quiet", "--disable-pip-version-check", *REQUIREMENTS[environment]]
    done = subprocess.run(
        [python, "-m", "pip", "install", *options], capture_output=True, text=True
    )
    if done.returncode:
        raise Absent(f"pip: {last_line(done.stderr)}")
    return python


def last_line(text: str) -> str:
    """Of what a program said, the reason why it ended."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    errors = [line for line in lines if "Error" in line.split(":")[0]]  # JAX adds a note to them
    return [*lines, *errors][-1] if lines else "no message"


def clone_of(peer: Peer, given: dict[str, str]) -> str | None:
    """Where the peer's repository was cloned.

    Raises:
        Absent: if nobody said, it is not there, or the peer is not run at all.
    """
    if peer.reason:
        raise Absent(peer.reason)
    if not peer.clone:
        return None
    place = given.get(peer.script) or os.environ.get(peer.clone)
    if not place:
        raise Absent(f"it is no package: clone it and name the folder in {peer.clone}")
    if not Path(place).is_dir():
        raise Absent(f"there is no folder {place}")
    return str(Path(place).resolve())
