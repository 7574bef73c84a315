"""Responses of elements that a file does not hold: in a file of their own, or by a data sheet."""

import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from made_scans import RATE, SPEED, positions, record, truth

import jaxtat
from jaxtat.cli import main
from jaxtat.io import Scan, load_response, load_scan, load_settings
from jaxtat.records import apply_impulse_response, gaussian_response
from jaxtat.scans import choose, reconstruct, with_best_method, with_facts

pytestmark = pytest.mark.slow

CENTER, WIDTH = 0.4e6, 1.2
GIVEN = {"region_radius": 0.011, "pixels": 33, "max_frequency": 3000.0}
OPTIONS = "--region-radius 0.011 --pixels 33 --max-frequency 3000 --quiet --force"


def heard():
    """The record of elements with a band."""
    response = gaussian_response(RATE, CENTER, WIDTH)
    return np.asarray(apply_impulse_response(record(), response, origin=len(response) // 2))


def scan(**known):
    facts = {"detectors": positions(), "sampling_rate": RATE, "sound_speed": SPEED}
    return Scan("pressure", heard(), facts | known)


def error(scan):
    found = reconstruct(scan, choose(scan, **GIVEN, model="in-plane", model_based=True))
    exact = truth(found.grid.points)
    return np.linalg.norm(found.image - exact) / np.linalg.norm(exact)


def test_a_band_is_half_as_high_at_its_ends():
    """And symmetric in time."""
    response = gaussian_response(40e6, 5e6, 0.6)
    spectrum = np.abs(np.fft.rfft(response, 8000))[[700, 1000, 1300]]  # 5 kHz apart
    np.testing.assert_allclose(spectrum, [0.5, 1.0, 0.5], atol=2e-3)
    np.testing.assert_allclose(response, response[::-1], atol=1e-15)


def test_images_through_a_band_are_those_through_its_response():
    """To the last bit, and better than without: what the elements suppress is told by f >= 0."""
    by_band = with_facts(scan(), element_band=(CENTER, WIDTH))
    response = gaussian_response(RATE, CENTER, WIDTH)
    by_file, by_hand = (
        scan(impulse_response=response),
        with_facts(scan(), element_response=response),
    )
    assert error(by_band) == error(by_file) == error(by_hand)
    assert error(by_band) < 0.5 * error(scan())
    reasons = [
        dict(choose(each, **GIVEN, model="in-plane").reasons)["impulse_response"]
        for each in (by_band, by_file, by_hand)
    ]
    assert len(set(reasons)) == 3


def test_the_command_takes_them(tmp_path, monkeypatch, capsys):
    """From .npy, .npz and numbers, also once more with --repeat."""
    monkeypatch.chdir(tmp_path)
    np.savez("scan.npz", pressure=heard(), **scan().known)
    response = gaussian_response(RATE, CENTER, WIDTH)
    np.save("response.npy", response)
    np.savez("response.npz", irf=response, other=np.ones(3))
    line = f"reconstruct scan.npz --model in-plane {OPTIONS} --out"
    main([*line.split(), "a.h5", "--element-band", str(CENTER), str(WIDTH)])
    main([*line.split(), "b.h5", "--impulse-response", "response.npy"])
    main([*line.split(), "c.h5", "--impulse-response", "response.npz"])
    main(["reconstruct", "scan.npz", "--repeat", "a.h5", "--out", "d.h5", "--quiet", "--force"])
    again = ["reconstruct", "scan.npz", "--quiet", "--force", "--repeat"]
    assert main([*again, "b.h5", "--out", "e.h5"]) == 2
    assert "which is opened only if you name it" in capsys.readouterr().err
    main([*again, "b.h5", "--out", "e.h5", "--impulse-response", "response.npy"])
    images = [read(tmp_path / f"{name}.h5") for name in "abcde"]
    assert all((image == images[0]).all() for image in images)
    assert load_settings(tmp_path / "b.h5")["impulse_response_file"] == "response.npy"
    by_python = jaxtat.reconstruct_file(
        "scan.npz", element_band=(CENTER, WIDTH), model="in-plane", **GIVEN
    )
    assert (np.asarray(by_python.image) == images[0]).all()


def read(path):
    with h5py.File(path) as file:
        return file["image"][...]


def status(words):
    """The exit code; argparse raises it."""
    try:
        return main(words)
    except SystemExit as end:
        return end.code


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ("--element-band 4e5 60", "bandwidth is 60, expected a share"),
        ("--element-band 1.9e6 0.5", "up to half the sampling rate, 2e[+]06"),
        ("--element-band 0.4 1.2", "samples. Is the frequency in the unit of the sampling rate"),
        ("--element-band 4e4 0.1", "no more than the record's 230"),
        ("--impulse-response zeros.npy", "expected some that are not 0"),
        ("--impulse-response none.npy", "there is no file none.npy"),
        ("--impulse-response scan.npz", "it holds detectors, pressure, .* expected one array"),
        ("--impulse-response text.npy", "neither .npy nor .npz"),
        ("--impulse-response cut.npy", "cannot read cut.npy: an array is shorter than it claims"),
        ("--impulse-response three.npy", r"impulse_response has shape \(3, 5\)"),
        ("--impulse-response three.npy --element-band 4e5 0.6", "not allowed with"),
    ],
)
def test_what_is_no_response_is_refused(tmp_path, monkeypatch, capsys, options, why):
    monkeypatch.chdir(tmp_path)
    np.savez("scan.npz", pressure=heard(), **scan().known)
    np.save("three.npy", np.ones((3, 5)))
    np.save("zeros.npy", np.zeros(5))
    (tmp_path / "text.npy").write_text("0.1 1.0 0.1\n")
    (tmp_path / "cut.npy").write_bytes((tmp_path / "three.npy").read_bytes()[:-9])
    assert status(["info", "scan.npz", *options.split()]) == 2
    said = capsys.readouterr().err
    assert re.search(why, said), said


def test_both_and_integrals_are_refused():
    with pytest.raises(ValueError, match="expected one of them"):
        with_facts(scan(), element_band=(CENTER, WIDTH), element_response=np.ones(3))
    integrals = Scan("circular_integrals", np.ones((9, 20)), {"radii": np.arange(1.0, 21)})
    with pytest.raises(ValueError, match="responses of elements are of pressure records"):
        with_facts(integrals, element_band=(CENTER, WIDTH))


def test_responses_of_each_element_come_before_that_of_all(tmp_path):
    path = tmp_path / "responses.npz"
    np.savez(path, EIR=np.arange(3.0), EIR_indiv_mat=np.ones((4, 3)))
    assert load_response(path).tolist() == np.ones((4, 3)).tolist()
    with pytest.raises(ValueError, match="expected data under one of"):
        load_scan(path)


def test_a_band_replaces_what_an_earlier_image_had(tmp_path, monkeypatch):
    """None, or a file that is no longer there; a band that is given counts as one of the file."""
    monkeypatch.chdir(tmp_path)
    np.savez("scan.npz", pressure=heard(), **scan().known)
    np.save("response.npy", np.ones(3))
    line = f"reconstruct scan.npz --model in-plane {OPTIONS} --out"
    band = ["--element-band", str(CENTER), str(WIDTH)]
    main([*line.split(), "plain.h5"])
    main([*line.split(), "other.h5", "--impulse-response", "response.npy"])
    main([*line.split(), "band.h5", *band])
    (tmp_path / "response.npy").unlink()
    for name in ("plain", "other"):
        again = ["reconstruct", "scan.npz", "--repeat", f"{name}.h5", "--quiet", "--force", *band]
        assert main([*again, "--out", "again.h5"]) == 0
        assert (read(tmp_path / "again.h5") != read(tmp_path / f"{name}.h5")).any()


def test_settings_of_python_need_the_response_too():
    chosen = choose(with_facts(scan(), element_band=(CENTER, WIDTH)), **GIVEN, model="in-plane")
    with pytest.raises(ValueError, match="the scan has none: give it"):
        reconstruct(scan(), chosen)


def test_elements_that_are_alike_may_have_a_response_each():
    """Fits end within 2 % of the same image; a (1, taps) array is of all elements."""
    response = gaussian_response(RATE, CENTER, WIDTH)
    of_all = with_facts(scan(), element_response=response)
    of_each = with_facts(scan(), element_response=np.tile(response, (90, 1)))
    images = [
        reconstruct(each, choose(each, **GIVEN, model="in-plane", weight=1e-3)).image
        for each in (of_all, of_each)
    ]
    assert np.linalg.norm(images[1] - images[0]) < 0.05 * np.linalg.norm(images[0])
    assert with_facts(scan(), element_response=response[None]).known["impulse_response"].ndim == 1


@pytest.mark.parametrize("silent", [(), (7, 40)])
def test_responses_of_each_element_are_fitted(silent):
    """By default; better than their mean, which the formula and the fit then take for all."""
    rng = np.random.default_rng(5)
    each = np.stack(
        [
            rng.uniform(0.6, 1.4) * gaussian_response(RATE, center, WIDTH)[:9]
            for center in rng.uniform(0.7, 1.3, 90) * CENTER
        ]
    )
    heard = np.array(apply_impulse_response(record(), each, origin=4))
    heard[list(silent)] = 0
    facts = {"detectors": positions(), "sampling_rate": RATE, "sound_speed": SPEED}

    def image_error(response, **options):
        made = Scan("pressure", heard, facts | {"impulse_response": response})
        chosen = with_best_method(made, choose(made, **GIVEN, model="in-plane", **options))
        assert set(silent) <= set(chosen.left_out)
        found = reconstruct(made, chosen)
        exact = truth(found.grid.points)
        return np.linalg.norm(found.image - exact) / np.linalg.norm(exact)

    error_of_each = image_error(each)
    assert error_of_each < 0.6 * image_error(each.mean(axis=0))
    assert error_of_each < 0.6 * image_error(each, model_based=False)


def test_live_images_take_one_response_of_all():
    of_each = with_facts(scan(), element_response=np.ones((90, 3)))
    with pytest.raises(ValueError, match="live images take one of all"):
        jaxtat.live(of_each, choose(of_each, **GIVEN, model="in-plane"))


def test_another_response_is_another_image_of_a_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("scans").mkdir()
    np.savez("scans/a.npz", pressure=heard(), **scan().known)
    line = f"reconstruct scans --model in-plane {OPTIONS} --out images"
    made = []
    for width in (1.2, 0.8):  # in the folder it is no scan
        np.save("scans/r.npy", gaussian_response(RATE, CENTER, width))
        assert main([*line.split(), "--impulse-response", "scans/r.npy"]) == 0
        made.append(read("images/a.npz.h5"))
    assert (made[0] != made[1]).any()
