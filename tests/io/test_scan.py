"""A scan: what fits together, and messages for what does not."""

import dataclasses

import numpy as np
import pytest

from jaxtat.io import Scan
from jaxtat.io.scan import require_kind

DATA = np.zeros((3, 4, 7))


def test_one_frame_and_many():
    one, many = Scan("pressure", DATA[0]), Scan("pressure", DATA)
    assert (one.n_frames, one.n_detectors, one.n_samples) == (1, 4, 7)
    assert (many.n_frames, many.n_detectors, many.n_samples) == (3, 4, 7)
    assert one.frame(0).shape == many.frame(2).shape == (4, 7)
    for scan, number in ((one, 1), (many, 3), (many, -1)):
        with pytest.raises(ValueError, match=f"frame {number}: there are {scan.n_frames}"):
            scan.frame(number)


def test_everything_known():
    known = {
        "detectors": np.ones((4, 2)),
        "times": np.arange(7),
        "sampling_rate": 4e7,
        "radii": np.arange(5.0),
        "sound_speed": np.full((2, 2), 1500.0),
        "wavelengths": [700, 800, 900],
        "field_of_view": np.zeros(6),
        "impulse_response": np.ones(9),
        "frequency_response": np.ones((4, 2, 5)),
    }
    scan = Scan("pressure", DATA, known)
    assert set(scan.known) == set(known)
    assert all(np.array_equal(scan.known[name], known[name]) for name in known)


def test_a_scan_is_frozen():
    scan = Scan("pressure", DATA, {"sampling_rate": 1.0}, {"device": "a"})
    with pytest.raises(dataclasses.FrozenInstanceError):
        scan.kind = "circular_integrals"  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(TypeError):
        scan.known["times"] = np.arange(7)  # pyright: ignore[reportIndexIssue]
    with pytest.raises(TypeError):
        scan.about["device"] = "b"  # pyright: ignore[reportIndexIssue]
    with pytest.raises(ValueError, match="read-only"):
        scan.known["sampling_rate"][...] = 2
    positions = np.ones((4, 2))
    Scan("pressure", DATA, {"detectors": positions})
    positions[0] = 2  # the caller's own array is still the caller's


def test_what_a_file_says_cannot_command_a_terminal():
    scan = Scan("pressure", DATA, {}, {"device": "\x1b[31mred\x07\nline" + 5000 * "x"})
    assert scan.about["device"].startswith(" [31mred  line")
    assert len(scan.about["device"]) == 1000


@pytest.mark.parametrize(
    ("shape", "kind", "known", "message"),
    [
        ((7,), "pressure", {}, r"shape \(7,\), expected \(detectors, samples\) or"),
        ((2, 3, 4, 5), "pressure", {}, "expected .detectors, samples. or"),
        ((0, 7), "pressure", {}, "none of them 0"),
        ((4, 7), "pressure", {"detectors": np.ones((3, 2))}, r"have shape \(3, 2\).*4 detectors"),
        ((4, 7), "pressure", {"detectors": np.ones((4, 4))}, r"expected \(detectors, 2 or 3\)"),
        ((4, 7), "pressure", {"detectors": np.ones(4)}, r"expected \(detectors, 2 or 3\)"),
        ((4, 7), "pressure", {"detectors": np.full((4, 2), np.nan)}, "detectors hold NaN"),
        ((4, 7), "pressure", {"times": np.arange(6)}, "times have shape .6,.*have 7 samples"),
        ((4, 7), "circular_integrals", {"radii": np.arange(6)}, "radii have.*have 7 samples"),
        ((4, 7), "pressure", {"times": np.full(7, np.inf)}, "times hold NaN or infinite"),
        ((4, 7), "pressure", {"sampling_rate": 0.0}, "the sampling rate is 0, expected a value"),
        ((4, 7), "pressure", {"sampling_rate": [1.0]}, r"sampling_rate has shape \(1,\)"),
        ((4, 7), "pressure", {"sound_speed": -1500.0}, "the sound speed is -1500"),
        ((4, 7), "pressure", {"sound_speed": []}, "sound_speed has shape"),
        ((3, 4, 7), "pressure", {"wavelengths": [700, 800]}, "wavelengths.*have 3 frames"),
        ((3, 4, 7), "pressure", {"wavelengths": [700, 0, 800]}, "the wavelengths is 0"),
        ((4, 7), "pressure", {"field_of_view": np.zeros(4)}, "field_of_view has shape"),
        ((4, 7), "pressure", {"sound_speed": "fast"}, "sound_speed has dtype <U4, expected real"),
        ((4, 7), "pressure", {"gain": 1.0}, "known has 'gain', expected only detectors, times"),
    ],
)
def test_what_cannot_be_is_refused(shape, kind, known, message):
    with pytest.raises(ValueError, match=message):
        Scan(kind, np.zeros(shape), known)


def test_there_are_two_kinds():
    require_kind("pressure")
    with pytest.raises(ValueError, match="kind is 'image', expected one of pressure, circular_i"):
        require_kind("image")


@pytest.mark.parametrize("dtype", [complex, bool, object, "U3", np.longdouble])
def test_data_are_real_numbers_of_64_bits_at_most(dtype):
    with pytest.raises(ValueError, match=r"data has dtype .*, expected real numbers"):
        Scan("pressure", np.zeros((4, 7), dtype))
