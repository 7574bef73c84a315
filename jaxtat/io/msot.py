"""Raw scans of iThera MSOT scanners: NAME.msot (XML), NAME.bin (samples), NAME.irf (response)."""

import math
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from .frames import LazyFrames, in_native_order
from .limits import Allowance, require_held
from .scan import Kind, Scan

_XML_MEMORY = 64  # bytes of memory for one of XML, at most
_SAMPLE = np.dtype("<u2")
_PREFIXES = {"none": 1.0, "G": 1e9, "M": 1e6, "k": 1e3, "c": 1e-2, "m": 1e-3, "u": 1e-6, "n": 1e-9}
_ENERGIES = ("POWER", "OverallCorrectionFactor")  # with which frames are corrected
_MARK = 1000.0  # added to the first value of a response by some versions of the software
# texts that are kept, by their names in `Scan.about`
_ABOUT = {
    "name": "ScanNode/Name",
    "comment": "ScanNode/Comment",
    "date": "CreationTime",
    "device": "ScanNode/DeviceSN",
    "transducer": "ScanNode/TransducerSN",
    "software": "ScanNode/SW_Version",
    "averages": "MEASUREMENT-DESC/AVERAGES-PER-PROJECTION",
    "temperature [C]": "ScanNode/ScanFrames/DataModelScanFrame/Frame/TEMPERATURE",
}


def is_msot(path: Path, start: bytes) -> bool:
    return start.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<")


def load_msot(path: Path, kind: Kind | None, allowance: Allowance) -> Scan:
    """Pressure (raw counts) as a memory map of NAME.bin, with positions, rate and wavelengths.

    Frames are in the order of the XML file, which has the place of each in NAME.bin. NAME.irf need
    not be there. The speed of sound is not stored. NAME.bin has no checksum: a wrong number cannot
    be told.
    """
    if kind == "circular_integrals":
        raise ValueError("MSOT files hold pressure, expected circular integrals.")
    allowance.require("the XML file", _XML_MEMORY * path.stat().st_size)
    root = _parse(path)
    positions = _positions(root)
    samples = _number(_found(root, "MEASUREMENT-DESC/RECORDED-LENGTH"))
    if not (samples >= 1 and samples.is_integer()):
        raise ValueError(f"RECORDED-LENGTH is {samples:g}, expected a whole number above zero.")
    frames = _all(root, "ScanNode/ScanFrames/DataModelScanFrame")
    data = _samples(path.with_suffix(".bin"), _places(frames), len(positions), int(samples))
    known = {
        "detectors": positions,
        "sampling_rate": _number(_found(root, "HARDWARE-DESC/SAMPLING-FREQUENCY")),
        "wavelengths": np.array(
            [1e9 * _number(_found(frame, "Frame/WAVELENGTH")) for frame in frames]
        ),
    }
    known |= _laser_energy(frames)
    known["wavelengths"] = np.round(known["wavelengths"], 6)  # 1e9 * 1e-9 is not 1
    response = path.with_suffix(".irf")
    if response.is_file():
        known["impulse_response"] = _response(response, allowance)
    about = {"format": "iThera MSOT"}
    for name, where in _ABOUT.items():
        element = _first(root, where)
        if element is not None and element.text and element.text.strip():
            about[name] = _shortened(element.text.strip())
    return Scan("pressure", data[0] if len(data) == 1 else data, known, about)


class _Builder(ElementTree.TreeBuilder):
    """Refuses a document type where it begins, before any entity is defined."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise ValueError("it declares a document type, which scans have not: refused.")


def _parse(path: Path) -> Element:
    """The root of an XML file without a document type, in which entities could be defined."""
    root = ElementTree.parse(path, ElementTree.XMLParser(target=_Builder())).getroot()
    if root.tag != "DataModelMsotProject":
        raise ValueError(f"its root is {root.tag!r:.60}, expected DataModelMsotProject.")
    return root


def _all(element: Element, where: str) -> list[Element]:
    """Elements at the end of a path of names, in whatever namespace."""
    return element.findall("/".join(f"{{*}}{step}" for step in where.split("/")))


def _first(element: Element, where: str) -> Element | None:
    return next(iter(_all(element, where)), None)


def _found(element: Element, where: str) -> Element:
    found = _first(element, where)
    if found is None:
        raise ValueError(f"its XML has no {where}.")
    return found


def _number(element: Element) -> float:
    """A finite number in its unit without prefix: 40 with unit-modifier M is 4e7."""
    name, prefix = element.tag.rpartition("}")[2], element.get("unit-modifier", "none")
    try:
        number = float(element.text or "") * _PREFIXES[prefix]
    except (ValueError, KeyError):
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{name} is {element.text!r:.60} (unit modifier {prefix!r:.20}).")
    return number


def _positions(root: Element) -> np.ndarray:
    """Positions of the detectors [m] by their numbers."""
    found: dict[int, list[float]] = {}
    for projection in _all(root, "HARDWARE-DESC/FRAME-DESC/PROJECTION"):
        values = {value.get("axis-ref", ""): _number(value) for value in _all(projection, "VALUE")}
        try:
            found[int(projection.get("number", ""))] = [values["1"], values["2"], values["3"]]
        except (ValueError, KeyError):
            raise ValueError(
                f"detector number {projection.get('number')!r:.20} has coordinates on axes "
                f"{sorted(values)}, expected 1, 2 and 3."
            ) from None
    if sorted(found) != list(range(1, len(found) + 1)) or not found:
        raise ValueError(f"its XML has {len(found)} detectors whose numbers are not 1, 2, 3 ...")
    return np.array([found[number] for number in sorted(found)])


def _places(frames: list[Element]) -> list[int]:
    """Position of each frame in the file of samples, counted in frames."""
    offsets = [_first(frame, "IDOffset") for frame in frames]
    places = [number if at is None else _number(at) for number, at in enumerate(offsets)]
    if len(set(places)) < len(places) or any(place < 0 or place % 1 for place in places):
        raise ValueError("the places of its frames (IDOffset) are not different whole numbers.")
    if not places:
        raise ValueError("its XML has no frames.")
    return [int(place) for place in places]


def _samples(path: Path, places: list[int], rows: int, columns: int) -> np.ndarray | LazyFrames:
    """Frames (frames, detectors, samples) of the file of samples."""
    if not path.is_file():
        raise ValueError(f"there is no {path.name} beside it, which holds its samples.")
    size, frame = path.stat().st_size, rows * columns * _SAMPLE.itemsize
    require_held(path.name, (max(places) + 1) * frame, size)
    if size % frame:
        raise ValueError(
            f"{path.name} has {size} bytes, no whole number of frames of {rows} detectors and "
            f"{columns} samples ({frame} bytes)."
        )
    data = np.memmap(path, _SAMPLE, "r", shape=(size // frame, rows, columns))
    if places == list(range(len(places))):
        return in_native_order(data[: len(places)])
    where, native = np.array(places), _SAMPLE.newbyteorder("=")
    shape = (len(places), rows, columns)
    return LazyFrames(shape, native, lambda chosen: data[where[chosen]].astype(native, copy=False))


def _laser_energy(frames: list[Element]) -> dict[str, np.ndarray]:
    """Pulse energy of each frame [mJ], by the first name that all frames have; empty if none."""
    for name in _ENERGIES:
        elements = [_first(frame, f"Frame/{name}") for frame in frames]
        found = [np.nan if element is None else _energy(element) for element in elements]
        if all(value > 0 for value in found):
            return {"laser_energy": np.array(found)}
    return {}


def _energy(element: Element) -> float:
    """A number [mJ], NaN where there is none; a factor without unit as it is."""
    try:
        found = _number(element)
    except ValueError:
        return np.nan
    return 1e3 * found if element.get("unit") == "J" else found


def _response(path: Path, allowance: Allowance) -> np.ndarray:
    size = path.stat().st_size
    if size == 0 or size % 8:
        raise ValueError(f"{path.name} has {size} bytes, expected numbers of 8 bytes.")
    allowance.take(path.name, size)
    response = np.fromfile(path, "<f8").astype(float)
    if response[0] >= _MARK:
        response[0] -= _MARK
    return response


def _shortened(text: str) -> str:
    """A number without the digits that rounding made."""
    try:
        return f"{float(text):.6g}"
    except ValueError:
        return text
