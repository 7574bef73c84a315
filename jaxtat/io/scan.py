"""What a scan is: data, and what is known of how they were recorded."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np

from .frames import LazyFrames

Kind = Literal["pressure", "circular_integrals"]
SAME_RATE = 1e-2  # by which times may be off the sampling rate: one sample of a short record
OF_ELEMENTS = "element_radius", "element_size"
REAL = "fiu"  # NumPy's kinds of real numbers


@dataclass(frozen=True, eq=False)
class Scan:
    """Data of one or more frames, and the facts about the scan that the file has.

    Attributes:
        kind: "pressure" or "circular_integrals", over spheres if detectors surround a volume.
        data: (detectors, samples), or (frames, detectors, samples); samples are times or radii.
            Many frames may be `LazyFrames` or a memory map, which read only the frames that are
            asked for. Numbers are those of the file, NaN too: whoever uses them refuses those, for
            a dead detector may be left out.
        known: the facts in the file, by name, as arrays of finite numbers. Of

            - detectors: positions (detectors, 2 or 3) [m, or any length], in the order of the data;
            - times: (samples,) [s]; they count where the sampling rate is known too, with which
              they have to agree (`require_one_rate`);
            - sampling_rate: () [Hz], samples from time 0;
            - radii: (samples,) [m, or that length] of circular integrals;
            - sound_speed: () or a map [m/s, or that length by time];
            - wavelengths: (frames,) [nm] of the light, of one frame (1,);
            - laser_energy: (frames,) of the pulses, by which images are divided [mJ, or any unit];
            - frame_numbers: (frames,) in the file, of a scan of some of its frames;
            - field_of_view: (6,) first and last x1, x2 and x3 [m];
            - impulse_response: (any,) of all detectors or (detectors, any) of each, at the sampling
              rate, its time 0 in the middle (index n // 2);
            - element_radius, element_size: () or (detectors,) of round elements, the side of square
              ones, of detectors in space [m, or that length];
            - normals: (detectors, 3) of these, to either side; else they face the middle;
            - frequency_response: (detectors, 2, any), frequencies [Hz] above responses,

            those that are there.
        about: what else the file says, as text for people: "format", "device", "date" and so on.

    Raises:
        ValueError: for shapes that do not fit each other, and values that cannot be.

    >>> scan = Scan("pressure", np.zeros((5, 8, 20)), {"sampling_rate": 4e7})
    >>> scan.n_frames, scan.n_detectors, scan.n_samples, scan.frame(3).shape
    (5, 8, 20, (8, 20))
    """

    kind: Kind
    data: np.ndarray | LazyFrames
    known: Mapping[str, Any] = field(default_factory=dict)
    about: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_kind(self.kind)
        require_real("data", self.data.dtype)
        if self.data.ndim not in (2, 3) or 0 in self.data.shape:
            raise ValueError(
                f"the data have shape {self.data.shape}, expected (detectors, samples) or "
                "(frames, detectors, samples), none of them 0."
            )
        known = {name: _known(self, name, value) for name, value in self.known.items()}
        object.__setattr__(self, "known", MappingProxyType(known))
        about = {name: _printable(text) for name, text in self.about.items()}
        object.__setattr__(self, "about", MappingProxyType(about))

    @property
    def n_frames(self) -> int:
        return self.data.shape[0] if self.data.ndim == 3 else 1

    @property
    def n_detectors(self) -> int:
        return self.data.shape[-2]

    @property
    def n_samples(self) -> int:
        return self.data.shape[-1]

    def frame(self, number: int) -> np.ndarray:
        """One frame, (detectors, samples), read now if the data are lazy."""
        if not 0 <= number < self.n_frames:
            raise ValueError(f"frame {number}: there are {self.n_frames}, from 0.")
        return np.asarray(self.data[number] if self.data.ndim == 3 else self.data)


def require_one_rate(scan: Scan) -> None:
    """Raise ValueError for times and a sampling rate that contradict each other.

    Not when a file is read: whoever gives one of them then replaces both, see `scans.with_facts`.
    """
    if scan.kind != "pressure" or not {"times", "sampling_rate"} <= set(scan.known):
        return
    times, rate = np.asarray(scan.known["times"], float), float(scan.known["sampling_rate"])
    steps, lasts = len(times) - 1, float(times[-1] - times[0])
    if abs(rate * lasts - steps) > SAME_RATE * steps:
        by_times = steps / lasts if lasts else 0.0
        raise ValueError(
            f"times and sampling_rate contradict each other: {len(times)} times from "
            f"{times[0]:.6g} to {times[-1]:.6g} are {by_times:.6g} samples per time, and the "
            f"sampling rate is {rate:.6g}. Give one of the two, which replaces both."
        )


def require_kind(kind: str) -> None:
    """Raise ValueError for what is no `Kind`."""
    if kind not in get_args(Kind):
        raise ValueError(f"kind is {kind!r}, expected one of {', '.join(get_args(Kind))}.")


def _known(scan: Scan, name: str, value: Any) -> np.ndarray:
    """One entry as an array that cannot be written to, or ValueError."""
    sizes = {"detectors": scan.n_detectors, "samples": scan.n_samples, "frames": scan.n_frames}
    pressure = scan.kind == "pressure"
    shapes: dict[str, tuple[str, ...] | None] = {
        "detectors": ("detectors", "2 or 3"),
        "times": ("samples",) if pressure else ("times",),
        "sampling_rate": (),
        "radii": ("radii",) if pressure else ("samples",),
        "sound_speed": None,
        "wavelengths": ("frames",),
        "laser_energy": ("frames",),
        "frame_numbers": ("frames",),
        "field_of_view": ("6",),
        "impulse_response": ("detectors", "any") if np.ndim(value) == 2 else ("any",),
        "frequency_response": ("detectors", "2", "any"),
        "normals": ("detectors", "3"),
        **dict.fromkeys(OF_ELEMENTS, ("detectors",) if np.ndim(value) else ()),
    }
    if name not in shapes:
        raise ValueError(f"known has {name!r}, expected only {', '.join(shapes)}.")
    array, wanted = np.asarray(value).view(), shapes[name]
    array.flags.writeable = False
    require_real(name, array.dtype)
    said = "any" if wanted is None else f"({', '.join(wanted)})"
    have, hold = ("have", "hold") if name.endswith(("s", "ii")) else ("has", "holds")
    if array.size == 0 or (wanted is not None and array.ndim != len(wanted)):
        raise ValueError(f"{name} {have} shape {array.shape}, expected {said}.")
    for size, axis in zip(array.shape, wanted or (), strict=wanted is not None):
        if axis in sizes and size != sizes[axis]:
            raise ValueError(
                f"{name} {have} shape {array.shape}, expected {said}, but the data have "
                f"{sizes[axis]} {axis} (shape {scan.data.shape})."
            )
        if axis[0].isdigit() and str(size) not in axis.split(" or "):
            raise ValueError(f"{name} {have} shape {array.shape}, expected {said}.")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} {hold} NaN or infinite values, expected finite ones.")
    if (
        name in ("sampling_rate", "sound_speed", "wavelengths", "laser_energy", *OF_ELEMENTS)
        and not (array > 0).all()
    ):
        worst = array.min()
        raise ValueError(f"the {name.replace('_', ' ')} is {worst:g}, expected a value above zero.")
    return array


def _printable(text: str) -> str:
    """A text of a file in one line, without what would command a terminal."""
    return "".join(sign if sign.isprintable() else " " for sign in text[:1000])


def require_real(name: str, dtype: np.dtype) -> None:
    """Raise ValueError for numbers that JAX does not take, or none at all."""
    require_numbers(name, dtype, REAL)


def require_numbers(name: str, dtype: np.dtype, kinds: str) -> None:
    """Raise ValueError for what is not of these kinds, or longer than JAX's numbers."""
    if dtype.kind not in kinds or dtype.itemsize > (16 if dtype.kind == "c" else 8):
        raise ValueError(
            f"{name} has dtype {dtype!s:.80}, expected real numbers of 64 bits at most."
        )
