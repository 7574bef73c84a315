"""iThera MSOT: the measured scan against an independent reading, and files that do not fit."""

import numpy as np
import pytest
from scan_writers import write_msot

from jaxtat.io import load_scan
from jaxtat.io.frames import LazyFrames

RNG = np.random.default_rng(3)
POSITIONS = RNG.standard_normal((12, 3))
DATA = RNG.integers(0, 2**16, (4, 12, 7), np.uint16)
WAVELENGTHS = [700.0, 850.0, 700.0, 850.0]


@pytest.mark.parametrize("data_file", ["msot_scan9_raw/Scan_9.msot"], indirect=True)
def test_the_measured_scan_is_that_of_an_independent_reading(data_file, data_folder):
    scan = load_scan(data_file)
    with np.load(data_folder / "msot_scan9.npz") as file:
        assert scan.data.dtype == file["raw"].dtype
        assert np.array_equal(scan.data, file["raw"])
        assert np.array_equal(scan.known["detectors"], file["geometry"])
        assert scan.known["sampling_rate"] == file["fs"]
    assert isinstance(scan.data, np.memmap)
    assert scan.known["wavelengths"].tolist() == [700]
    response = scan.known["impulse_response"]
    assert response.shape == (2030,)
    assert abs(np.abs(response).argmax() - 1015) <= 1  # time 0 is in the middle
    assert np.abs(response).max() < 1  # without the mark of its version
    assert scan.about["name"] == "201001_05_GC_SS"
    assert scan.about["date"].startswith("2020-10-01")
    assert scan.about["averages"] == "6"
    assert scan.known["laser_energy"] == pytest.approx([1193.8654300273377])  # POWER [mJ]


def test_frames_wavelengths_and_response(tmp_path):
    path = write_msot(
        tmp_path / "a.msot", DATA, POSITIONS, 37.5, WAVELENGTHS, response=[1001, 2, 3]
    )
    scan = load_scan(path)
    assert isinstance(scan.data, np.memmap)
    assert np.array_equal(scan.data, DATA)
    assert scan.known["sampling_rate"] == 37.5e6
    assert scan.known["wavelengths"].tolist() == WAVELENGTHS
    assert scan.known["impulse_response"].tolist() == [1, 2, 3]
    assert np.array_equal(scan.known["detectors"], POSITIONS)
    assert scan.about == {
        **{"format": "iThera MSOT", "name": "a scan", "device": "7", "temperature [C]": "33.5"}
    }


@pytest.mark.parametrize("name", ["POWER", "OverallCorrectionFactor"])
def test_energies_of_the_pulses(tmp_path, name):
    path = write_msot(tmp_path / "a.msot", DATA, POSITIONS, wavelengths=WAVELENGTHS)
    text = path.read_text().replace("<TEMPERATURE>", f"<{name}>60.5</{name}><TEMPERATURE>")
    path.write_text(text)
    assert load_scan(path).known["laser_energy"].tolist() == [60.5] * 4
    path.write_text(text.replace(f"<{name}>", f'<{name} unit="J" unit-modifier="m">'))
    assert np.allclose(load_scan(path).known["laser_energy"], 60.5, rtol=1e-14)
    for wrong in ("0", "nan", "NaN", "much"):  # of one frame
        path.write_text(text.replace(">60.5<", f">{wrong}<", 1))
        assert "laser_energy" not in load_scan(path).known


@pytest.mark.parametrize(
    ("delay", "said"), [("0", None), ("0.0", None), ("", None), ("40", "40, in a unit")]
)
def test_a_delay_of_the_trigger_is_said_and_not_used(tmp_path, delay, said):
    path = write_msot(tmp_path / "a.msot", DATA, POSITIONS, wavelengths=WAVELENGTHS)
    without = load_scan(path)
    tag = f"<DAQTriggerDelay>{delay}</DAQTriggerDelay></HARDWARE-DESC>"
    path.write_text(path.read_text().replace("</HARDWARE-DESC>", tag))
    scan = load_scan(path)
    found = scan.about.get("trigger delay")
    assert (found is None) if said is None else found.startswith(said)
    assert set(scan.known) == set(without.known) and "times" not in scan.known


def test_a_single_frame_and_no_response(tmp_path):
    scan = load_scan(write_msot(tmp_path / "a.msot", DATA[:1], POSITIONS, wavelengths=[700]))
    assert np.array_equal(scan.data, DATA[0])
    assert "impulse_response" not in scan.known


def test_frames_are_where_their_offsets_say(tmp_path):
    places = [3, 0, 1]
    write_msot(tmp_path / "a.msot", DATA[:3], POSITIONS, 40, [700, 710, 720], places)
    (tmp_path / "a.bin").write_bytes(DATA.tobytes())
    scan = load_scan(tmp_path / "a.msot")
    assert isinstance(scan.data, LazyFrames)
    assert np.array_equal(np.asarray(scan.data), DATA[places])


def test_more_frames_than_are_named_are_left(tmp_path):
    path = write_msot(tmp_path / "a.msot", DATA[:3], POSITIONS, wavelengths=[700] * 3)
    (tmp_path / "a.bin").write_bytes(DATA.tobytes())
    assert np.array_equal(load_scan(path).data, DATA[:3])


def test_detectors_are_in_the_order_of_their_numbers(tmp_path):
    path = write_msot(tmp_path / "a.msot", DATA, POSITIONS, wavelengths=WAVELENGTHS)
    text = (
        path.read_text().replace('number="12"', 'number="0"').replace('number="1"', 'number="12"')
    )
    path.write_text(text.replace('number="0"', 'number="1"'))
    wanted = POSITIONS[[11, *range(1, 11), 0]]
    assert np.array_equal(load_scan(path).known["detectors"], wanted)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("DataModelMsotProject", "svg", "its root is 'svg', expected DataModelMsotProject"),
        (">7</RECORDED", ">8</RECORDED", "a.bin claims 768 bytes, but the file holds 672"),
        (">7</RECORDED", ">99999999999</RECORDED", "a.bin claims 9599999999904 bytes"),
        (">7</RECORDED", ">5</RECORDED", "a.bin has 672 bytes, no whole number of frames"),
        (">7</RECORDED", ">0</RECORDED", "RECORDED-LENGTH is 0, expected a whole number"),
        (">7</RECORDED", ">6.5</RECORDED", "RECORDED-LENGTH is 6.5, expected a whole number"),
        (">7</RECORDED", ">many</RECORDED", "RECORDED-LENGTH is 'many'"),
        ("RECORDED-LENGTH>", "LENGTH>", "its XML has no MEASUREMENT-DESC/RECORDED-LENGTH"),
        (">3</IDOffset>", ">4</IDOffset>", "a.bin claims 840 bytes"),
        (">3</IDOffset>", ">1</IDOffset>", "places of its frames .IDOffset. are not different"),
        (">3</IDOffset>", ">-1</IDOffset>", "places of its frames .IDOffset. are not different"),
        (">3</IDOffset>", ">1e30</IDOffset>", "a.bin claims"),
        ("DataModelScanFrame>", "Shot>", "its XML has no frames"),
        ('number="5"', 'number="6"', "11 detectors whose numbers are not 1, 2, 3"),
        ('number="5"', 'number="five"', "detector number 'five'"),
        ('axis-ref="2"', 'axis-ref="1"', "coordinates on axes .*, expected 1, 2 and 3"),
        ("PROJECTION", "EQUAL", "its XML has 0 detectors"),
        ('unit-modifier="M"', 'unit-modifier="?"', "SAMPLING-FREQUENCY is '40.0' .unit modifier"),
        (">40.0</SAMPLING", ">nan</SAMPLING", "SAMPLING-FREQUENCY is 'nan'"),
        (">40.0</SAMPLING", ">-40</SAMPLING", "the sampling rate is -4e"),
        ("</DataModelMsotProject>", "", "damaged"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, old, new, message):
    path = write_msot(tmp_path / "a.msot", DATA, POSITIONS, wavelengths=WAVELENGTHS)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(ValueError, match=f"cannot read .*a.msot: .*({message})"):
        load_scan(path)


BOMB = (
    '<!DOCTYPE lolz [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY {chr(98 + n)} "{10 * f"&{chr(97 + n)};"}">' for n in range(9))
    + "]>"
)
FOREIGN = '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/hostname">]>'


@pytest.mark.parametrize("declared", [BOMB, FOREIGN, "<!DOCTYPE DataModelMsotProject>"])
def test_document_types_are_refused(tmp_path, declared):
    path = write_msot(tmp_path / "a.msot", DATA, POSITIONS, wavelengths=WAVELENGTHS)
    text = path.read_text().replace("?><", f"?>{declared}<").replace("a scan", "&j;&x;")
    path.write_text(text)  # of which the first would become 20 GB
    with pytest.raises(ValueError, match="declares a document type, which scans have not: refused"):
        load_scan(path)


def test_a_namespace_is_not_copied_into_every_tag(tmp_path):
    """30 kB in each of 150,000 tags would be 4.5 GB."""
    path = write_msot(tmp_path / "a.msot", DATA, POSITIONS, wavelengths=WAVELENGTHS)
    spaced = f'<ScanNode xmlns="{30_000 * "n"}">{150_000 * "<b/>"}'
    path.write_text(path.read_text().replace("<ScanNode>", spaced))
    assert np.array_equal(load_scan(path).data, DATA)


def test_prefixes_of_namespaces_are_left_out(tmp_path):
    path = write_msot(tmp_path / "a.msot", DATA, POSITIONS, wavelengths=WAVELENGTHS)
    text = path.read_text().replace("<HARDWARE-DESC", '<h:HARDWARE-DESC xmlns:h="H"')
    path.write_text(text.replace("</HARDWARE-DESC", "</h:HARDWARE-DESC"))
    assert np.array_equal(load_scan(path).known["detectors"], POSITIONS)


def test_samples_and_response_beside_it(tmp_path):
    path = write_msot(tmp_path / "a.msot", DATA, POSITIONS, 40, WAVELENGTHS)
    for content in (b"", b"1234567"):
        (tmp_path / "a.irf").write_bytes(content)
        with pytest.raises(ValueError, match=r"a.irf has . bytes, expected numbers of 8 bytes"):
            load_scan(path)
    (tmp_path / "a.irf").write_bytes(np.array([np.nan]).tobytes())
    with pytest.raises(ValueError, match="impulse_response holds NaN"):
        load_scan(path)
    (tmp_path / "a.bin").unlink()
    with pytest.raises(ValueError, match=r"there is no a.bin beside it, which holds its samples"):
        load_scan(path)
