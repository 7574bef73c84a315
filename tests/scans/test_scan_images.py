"""Images of scans against the truth, and against each other where they must agree."""

import shlex

import numpy as np
import pytest
import scipy.ndimage
from made_scans import RATE, SPEED, N, positions, raw_counts, record, scan, truth

import jaxtat.scans.images
from jaxtat import phantoms, polyline, reconstruct_file
from jaxtat.cli import main
from jaxtat.io import Scan, load_settings, save_ipasc
from jaxtat.io.frames import LazyFrames
from jaxtat.scans import choose, reconstruct

pytestmark = pytest.mark.slow

# one size for nearly all tests: few programs
GIVEN = {"region_radius": 0.011, "pixels": 45, "max_frequency": 3500.0, "band": (2e4, 1.5e6)}
GIVEN |= {"inversion": "fourier"}  # exactly alike in all directions
NOISE = 0.01


@pytest.fixture(scope="module")
def pressure():
    return record()


@pytest.fixture(scope="module")
def counts(pressure):
    return raw_counts(pressure, NOISE)


@pytest.fixture(scope="module")
def clean(counts):
    return image(scan(counts))


@pytest.fixture(scope="module")
def noise_level(pressure, clean):
    """Difference of images by another realisation of the noise alone, relative."""
    return relative(image(scan(raw_counts(pressure, NOISE, seed=1))), clean)


def image(of, **given):
    chosen = choose(of, **GIVEN | {"alpha": 1e-2, "dead_time": 4e-6} | given)
    found = reconstruct(of, chosen)
    return np.where(found.region.contains(found.grid.points), found.image, 0.0)


def relative(one, other):
    return np.linalg.norm(one - other) / np.linalg.norm(other)


def like(found, wanted):
    return np.corrcoef(found.ravel(), wanted.ravel())[0, 1]


def grid_points():
    x = np.linspace(-0.011, 0.011, 45)
    return np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1)


def test_everything_chosen_the_image_is_that_of_the_phantom(counts, tmp_path):
    path = tmp_path / "scan.hdf5"
    save_ipasc(path, scan(counts))
    lines = []
    found = reconstruct_file(path, report=lines.append)
    inside = np.asarray(found.region.contains(found.grid.points))
    assert found.unit == "m"
    assert found.frames is None
    assert like(found.image[inside], truth(found.grid.points)[inside]) > 0.98
    assert "region_radius" in lines[0]


def test_around_an_l_the_largest_disk_that_is_seen(tmp_path):
    """On no circle, and too near for waves about a centre; the rest of the error is band limit."""
    curve = polyline([(-0.8, 1.2), (-0.8, -0.8), (1.2, -0.8)], 60)
    bell, radii = phantoms.Bells([[-0.15, -0.15]], [0.45]), 0.04 * np.arange(1, 60)
    g = bell.circular_integrals(curve, radii)
    np.savez(tmp_path / "l.npz", circular_integrals=g, radii=radii, detectors=curve.points)
    found = reconstruct_file(tmp_path / "l.npz", pixels=21, max_frequency=30.0)
    inscribed = 2 * (1 - 0.5**0.5)  # of the triangle
    assert 0.75 * inscribed < found.choices.region_radius < inscribed
    inside = np.asarray(found.region.contains(found.grid.points))
    assert relative(found.image[inside], np.asarray(bell(found.grid.points))[inside]) < 0.05


def test_shuffled_detectors_give_the_same_image(counts, clean):
    mixed = np.random.default_rng(5).permutation(N)
    known = {"detectors": positions()[mixed], "sampling_rate": RATE, "sound_speed": SPEED}
    assert relative(image(Scan("pressure", counts[mixed], known)), clean) < 1e-9


def test_without_a_tenth_of_the_channels_the_image_is_the_same_within_the_noise(
    counts, clean, noise_level
):
    dead = np.random.default_rng(6).permutation(N)[:9]
    broken = counts.copy()
    broken[dead[:5]] = 0
    broken[dead[5:]] = 32768
    found = scan(broken)
    assert set(choose(found).left_out) == set(dead.tolist())
    assert relative(image(found), clean) < 1.5 * noise_level
    # as zeros they would be data, and wrong ones
    assert relative(image(found, use=np.arange(N)), clean) > 3 * noise_level


@pytest.mark.parametrize("level", [0, 32768])
def test_a_muted_start_changes_the_image_no_more_than_noise(counts, clean, noise_level, level):
    muted = counts.copy()
    muted[:, :60] = level  # sound from the region begins at sample 77
    assert relative(image(scan(muted)), clean) < 1.5 * noise_level


@pytest.mark.parametrize("turn", [90.0, 180.0, 33.0])
def test_a_turned_array_gives_the_image_turned(counts, clean, noise_level, turn):
    """The same record, detectors elsewhere: the same image there."""
    known = {"detectors": positions(turn), "sampling_rate": RATE, "sound_speed": SPEED}
    found = image(Scan("pressure", counts, known))
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    back = grid_points() @ np.array([[c, s], [-s, c]]).T  # where each pixel was before
    places = np.moveaxis((back / 0.011 + 1) * 22, -1, 0)
    inner = np.hypot(*np.moveaxis(grid_points(), -1, 0)) < 0.0105
    expected = scipy.ndimage.map_coordinates(clean, places, order=3)
    off = np.linalg.norm((found - expected)[inner]) / np.linalg.norm(expected[inner])
    # splines between pixels are good to a few parts in a thousand
    assert off < (1e-6 if turn % 90 == 0 else 0.1 * noise_level + 0.01)
    assert like(found[inner], truth(grid_points(), turn)[inner]) > 0.95


def test_frames_are_read_a_few_at_a_time_and_each_is_its_own(counts, clean, monkeypatch):
    frames = np.stack([counts, counts // 2, counts[::-1], counts, counts[::-1] // 2])
    together = []

    def read(numbers):
        together.append(len(numbers))
        return frames[numbers]

    known = {"wavelengths": [700.0, 730.0, 760.0, 800.0, 850.0]}
    lazy = scan(LazyFrames(frames.shape, frames.dtype, read), **known)
    chosen = choose(lazy, **GIVEN, alpha=1e-2, dead_time=4e-6)
    together.clear()
    monkeypatch.setattr(jaxtat.scans.images, "AT_A_TIME", 2 * 8 * counts.size)
    out = np.full((5, 45, 45), np.nan)
    found = reconstruct(lazy, chosen, out=out)
    assert max(together) == 2
    assert found.image is out
    assert found.frames.tolist() == known["wavelengths"]
    inside = np.asarray(found.region.contains(found.grid.points))
    assert relative(out[0][inside], clean[inside]) < 1e-9
    assert np.array_equal(out[0], out[3])
    assert relative(out[1][inside], clean[inside] / 2) < 5e-3  # half counts are rounded
    assert relative(out[4][inside], out[2][inside] / 2) < 5e-3
    with pytest.raises(ValueError, match="out has shape"):
        reconstruct(lazy, chosen, out=out[:4])
    endless = scan(LazyFrames((10**12, *counts.shape), frames.dtype, read))
    with pytest.raises(ValueError, match="1000000000000 frames do not fit into memory"):
        reconstruct(endless, chosen)


def test_an_impulse_response_is_removed(pressure, clean):
    """Recorded with an echo, noise afterwards; in the file time 0 is in the middle."""
    response = np.zeros(31)
    response[15], response[21] = 1.0, -0.6
    through = scipy.ndimage.convolve1d(pressure, response, axis=1, mode="constant")
    through *= np.abs(pressure).max() / np.abs(through).max()
    heard = raw_counts(through, NOISE / 10)
    kept = image(scan(heard, impulse_response=response), impulse_response=False)
    removed = image(scan(heard, impulse_response=response))
    assert like(removed, clean) > 0.98
    assert 1 - like(removed, clean) < 0.2 * (1 - like(kept, clean))


@pytest.fixture
def command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda line: main(shlex.split(line))


def test_the_command_chooses_prints_keeps_and_repeats(counts, command, capsys):
    np.savez("scan.npz", raw=counts, detectors=positions(), fs=RATE, sound_speed=SPEED)
    options = "--region-radius 0.011 --pixels 45 --max-frequency 3500 --inversion fourier"
    assert command(f"reconstruct scan.npz {options} --out a.h5") == 0
    printed = capsys.readouterr().out
    for part in ("in-plane", "all of them are good", "the artefact at the start", "given"):
        assert part in printed
    settings = load_settings("a.h5")
    assert settings["model"] == "in-plane"
    assert settings["region_radius"] == 0.011
    assert command("reconstruct scan.npz --repeat a.h5 --quiet --out b.h5") == 0
    assert load_settings("b.h5")["alpha"] == settings["alpha"]
    for name in ("a", "b"):
        assert command(f"reconstruct scan.npz --repeat {name}.h5 --quiet --out {name}.npy") == 0
    assert np.array_equal(np.load("a.npy"), np.load("b.npy"))
    for other in ("--alpha 1", "--length-unit m"):
        assert command(f"reconstruct scan.npz --repeat a.h5 {other} --out c.npy") == 2
        assert f"{other.split()[0]} and --repeat" in capsys.readouterr().err


def test_info_tells_without_an_image(counts, command, capsys):
    np.savez("scan.npz", raw=counts, fs=RATE)
    np.save("positions.npy", positions())
    assert command("info scan.npz") == 2
    assert "no detector positions" in capsys.readouterr().err
    np.savez("scan.npz", raw=counts, fs=RATE, detectors=positions())
    assert command("info scan.npz") == 0
    printed = capsys.readouterr().out
    assert "arc of 270.0 degrees" in printed
    assert "the best image leaves" in printed


def test_a_contradiction_is_an_exit_code(command, capsys):
    """Of rows that are not in the order of the positions; the image is made all the same."""
    rows = np.random.default_rng(0).permutation(len(record()))
    np.savez("mixed.npz", pressure=record()[rows], detectors=positions(), sampling_rate=RATE)
    assert command("info mixed.npz --sound-speed 1500") == 3
    assert "no image explains this record" in capsys.readouterr().err
    line = "reconstruct mixed.npz --sound-speed 1500 --direct --pixels 21 --out a.npy"
    assert command(line) == 3
    assert np.load("a.npy").shape == (21, 21)
    assert command("info mixed.npz --sound-speed 1500 --force") == 0
