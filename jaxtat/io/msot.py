"""Raw scans of iThera MSOT scanners: NAME.msot (XML), NAME.bin (samples), NAME.irf (response)."""

import math
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from .file_contents import FileContents
from .limits import require_held
from .scan import Kind

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


def read_msot(path: Path, kind: Kind | None) -> FileContents:
    """Positions, rate, wavelengths, and where the pressure (raw counts) is in NAME.bin.

    Frames are in the order of the XML file, which has the place of each in NAME.bin. NAME.irf need
    not be there. The speed of sound is not stored. NAME.bin has no checksum: a wrong number cannot
    be told.
    """
    if kind == "circular_integrals":
        raise ValueError("MSOT files hold pressure, expected circular integrals.")
    root = _parse(path)
    positions = _positions(root)
    samples = _number(_element(root, "MEASUREMENT-DESC/RECORDED-LENGTH"))
    if not (samples >= 1 and samples.is_integer()):
        raise ValueError(f"RECORDED-LENGTH is {samples:g}, expected a whole number above zero.")
    frames = root.findall("ScanNode/ScanFrames/DataModelScanFrame")
    wavelengths = [1e9 * _number(_element(frame, "Frame/WAVELENGTH")) for frame in frames]
    known = {
        "detectors": positions,
        "sampling_rate": _number(_element(root, "HARDWARE-DESC/SAMPLING-FREQUENCY")),
        "wavelengths": np.round(wavelengths, 6),  # 1e9 * 1e-9 is not 1
    }
    known |= _laser_energy(frames)
    response = path.with_suffix(".irf")
    if response.is_file():
        known["impulse_response"] = _response(response)
    about: dict[str, Any] = {"format": "iThera MSOT"}
    for name, where in _ABOUT.items():
        element = root.find(where)
        if element is not None and element.text and element.text.strip():
            about[name] = _shortened(element.text.strip())
    about |= _trigger_delay(root)
    about["map"] = _samples(path, _places(frames), len(positions), int(samples))
    return FileContents(about, known)


def _parse(path: Path) -> Element:
    """The root of an XML file, whose tags are as they are written, without namespaces.

    A namespace may be of any length and would be copied into every tag. A document type, in which
    entities could be defined, is refused where it begins.
    """
    builder, parser = TreeBuilder(), expat.ParserCreate()
    parser.StartElementHandler = lambda tag, of_it: builder.start(tag.rpartition(":")[2], of_it)
    parser.EndElementHandler = lambda tag: builder.end(tag.rpartition(":")[2])
    parser.CharacterDataHandler, parser.buffer_text = builder.data, True
    parser.StartDoctypeDeclHandler = _refuse_doctype
    parser.Parse(path.read_bytes(), True)
    root = builder.close()
    if root.tag != "DataModelMsotProject":
        raise ValueError(f"its root is {root.tag!r:.60}, expected DataModelMsotProject.")
    return root


def _refuse_doctype(*_: Any) -> None:
    raise ValueError("it declares a document type, which scans have not: refused.")


def _element(element: Element, where: str) -> Element:
    first = element.find(where)
    if first is None:
        raise ValueError(f"its XML has no {where}.")
    return first


def _number(element: Element) -> float:
    """A finite number in its unit without prefix: 40 with unit-modifier M is 4e7."""
    name, prefix = element.tag, element.get("unit-modifier", "none")
    try:
        number = float(element.text or "") * _PREFIXES[prefix]
    except (ValueError, KeyError):
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{name} is {element.text!r:.60} (unit modifier {prefix!r:.20}).")
    return number


def _positions(root: Element) -> np.ndarray:
    """Positions of the detectors [m] by their numbers."""
    positions: dict[int, list[float]] = {}
    for projection in root.findall("HARDWARE-DESC/FRAME-DESC/PROJECTION"):
        values = {
            value.get("axis-ref", ""): _number(value) for value in projection.findall("VALUE")
        }
        try:
            positions[int(projection.get("number", ""))] = [values["1"], values["2"], values["3"]]
        except (ValueError, KeyError):
            raise ValueError(
                f"detector number {projection.get('number')!r:.20} has coordinates on axes "
                f"{sorted(values)}, expected 1, 2 and 3."
            ) from None
    n = len(positions)
    if sorted(positions) != list(range(1, n + 1)) or n == 0:
        raise ValueError(f"its XML has {n} detectors whose numbers are not 1, 2, 3 ...")
    return np.array([positions[number] for number in sorted(positions)])


def _places(frames: list[Element]) -> list[int]:
    """Position of each frame in the file of samples, counted in frames."""
    offsets = [frame.find("IDOffset") for frame in frames]
    places = [number if at is None else _number(at) for number, at in enumerate(offsets)]
    if len(set(places)) < len(places) or any(place < 0 or place % 1 for place in places):
        raise ValueError("the places of its frames (IDOffset) are not different whole numbers.")
    if not places:
        raise ValueError("its XML has no frames.")
    return [int(place) for place in places]


def _samples(path: Path, places: list[int], rows: int, columns: int) -> dict[str, Any]:
    """Where frames (frames, detectors, samples) are in the file of samples."""
    samples = path.with_suffix(".bin")
    if not samples.is_file():
        raise ValueError(f"there is no {samples.name} beside it, which holds its samples.")
    size, frame = samples.stat().st_size, rows * columns * _SAMPLE.itemsize
    require_held(samples.name, (max(places) + 1) * frame, size)
    if size % frame:
        raise ValueError(
            f"{samples.name} has {size} bytes, no whole number of frames of {rows} detectors and "
            f"{columns} samples ({frame} bytes)."
        )
    shape = (size // frame, rows, columns)
    return {"suffix": ".bin", "dtype": _SAMPLE.str, "shape": shape, "places": places}


def _laser_energy(frames: list[Element]) -> dict[str, np.ndarray]:
    """Pulse energy of each frame [mJ], by the first name that all frames have; empty if none."""
    for name in _ENERGIES:
        elements = [frame.find(f"Frame/{name}") for frame in frames]
        energies = [np.nan if element is None else _energy(element) for element in elements]
        if all(value > 0 for value in energies):
            return {"laser_energy": np.array(energies)}
    return {}


def _energy(element: Element) -> float:
    """A number [mJ], NaN where there is none; a factor without unit as it is."""
    try:
        number = _number(element)
    except ValueError:
        return np.nan
    return 1e3 * number if element.get("unit") == "J" else number


def _trigger_delay(root: Element) -> dict[str, str]:
    """That samples may begin after the laser fires; PATATO and other readers name no unit."""
    element = root.find("HARDWARE-DESC/DAQTriggerDelay")
    delay = "0" if element is None else _shortened((element.text or "0").strip())
    if delay == "0":
        return {}
    said = f"{delay}, in a unit that is not known: not used, give --start-time"
    return {"trigger delay": said}


def _response(path: Path) -> np.ndarray:
    size = path.stat().st_size
    if size == 0 or size % 8:
        raise ValueError(f"{path.name} has {size} bytes, expected numbers of 8 bytes.")
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
