"""Plans through files: equal to the last bit, or refused with the reason."""

import hashlib

import equinox as eqx
import h5py
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxtat import (
    FixedRank,
    ImageGrid,
    NormBound,
    SingularValueCutoff,
    build_plan,
    circular_arc,
    data_radii,
    phantoms,
    reconstruct,
    truncated_disk,
)
from jaxtat.io import load_plan, save_plan
from jaxtat.regularization import Regularization

BLOCK = 512  # bytes of the user block, before the digest's range
BELL = phantoms.Bells([[0.1, -0.2]], [0.6])


@pytest.fixture(scope="module")
def tiny_plan():
    """Closed form on 16 detectors: a plan of a few kilobytes."""
    curve, region, grid = circular_arc(1.3, 1.3, 16), truncated_disk(0.8, 0.8, 32), ImageGrid(5)
    radii = data_radii(curve, region, 0.5)
    return build_plan(
        curve, region, grid, radii, method="series", max_frequency=4, n_directions=4, progress=False
    )


@pytest.fixture(scope="module")
def tiny_file(tiny_plan, tmp_path_factory):
    path = tmp_path_factory.mktemp("tiny") / "plan.h5"
    save_plan(tiny_plan, path)
    return path


def differences(one, two):
    """What tells two plans apart: kinds and static fields, or leaves by number."""
    if jax.tree.structure(one) != jax.tree.structure(two):
        return ["structure"]

    def same(a, b):
        return (
            type(a) is type(b)
            and (a.dtype, a.shape) == (b.dtype, b.shape)
            and np.asarray(a).tobytes() == np.asarray(b).tobytes()
        )

    leaves = zip(jax.tree.leaves(one), jax.tree.leaves(two), strict=True)
    return [number for number, (a, b) in enumerate(leaves) if not same(a, b)]


def seal(path):
    """Give a changed file the digest that goes with it: the format, spelled out once more."""
    content = path.read_bytes()
    digest = hashlib.blake2b(content[BLOCK:]).hexdigest()
    line = f"jaxtat plan 1 {digest}\n".encode()
    path.write_bytes(line + content[len(line) :])


def test_a_plan_comes_back_to_the_last_bit_and_gives_the_same_image(small_plan, tmp_path):
    path = tmp_path / "plan.h5"
    save_plan(small_plan, path)
    loaded = load_plan(path)
    assert differences(loaded, small_plan) == []
    assert loaded.curve.closed is False
    assert loaded.grid.shape == (33, 33)
    assert all(type(size) is int for size in loaded.grid.shape)
    assert np.array_equal(loaded.grid.points, small_plan.grid.points)
    g = BELL.circular_integrals(small_plan.curve, small_plan.radii)
    assert np.array_equal(reconstruct(loaded, g), reconstruct(small_plan, g))


def test_single_precision_halves_the_densities_and_keeps_six_digits(small_plan, tmp_path):
    whole, half = tmp_path / "whole.h5", tmp_path / "half.h5"
    save_plan(small_plan, whole)
    save_plan(small_plan, half, precision="single")
    saved = whole.stat().st_size - half.stat().st_size
    assert abs(saved - small_plan.densities.nbytes / 2) < 4096
    loaded = load_plan(half)
    assert loaded.densities.dtype == jnp.complex64
    others = eqx.tree_at(lambda plan: plan.densities, loaded, small_plan.densities)
    assert differences(others, small_plan) == []
    g = BELL.circular_integrals(small_plan.curve, small_plan.radii)
    exact = reconstruct(small_plan, g)
    error = float(jnp.abs(reconstruct(loaded, g) - exact).max() / jnp.abs(exact).max())
    assert 0 < error < 1e-6
    again = tmp_path / "again.h5"
    save_plan(loaded, again)
    assert differences(load_plan(again), loaded) == []


@pytest.mark.parametrize(
    "rule",
    [
        NormBound(4.287),
        NormBound(1 / 3, fractional=False),
        FixedRank(20.25),
        SingularValueCutoff(1e-7),
        None,
    ],
)
def test_every_regularization_comes_back(tiny_plan, tmp_path, rule):
    plan = eqx.tree_at(lambda p: p.regularization, tiny_plan, rule, is_leaf=lambda x: x is None)
    save_plan(plan, tmp_path / "plan.h5")
    loaded = load_plan(tmp_path / "plan.h5")
    assert differences(loaded, plan) == []
    assert type(loaded.regularization) is type(rule)
    if isinstance(rule, NormBound):
        assert loaded.regularization.fractional is rule.fractional


def test_a_series_plan_comes_back(tiny_plan, tiny_file):
    loaded = load_plan(tiny_file)
    assert differences(loaded, tiny_plan) == []
    assert loaded.regularization is None
    assert loaded.curve.closed is True
    assert loaded.report.singular_values.shape == (tiny_plan.frequencies.shape[0], 0)


def test_arrays_of_numpy_are_saved_too(tiny_plan, tmp_path):
    save_plan(jax.tree.map(np.asarray, tiny_plan), str(tmp_path / "plan.h5"))
    assert differences(load_plan(str(tmp_path / "plan.h5")), tiny_plan) == []


def test_a_file_of_one_plan_is_replaced_by_another(tiny_plan, tmp_path):
    path = tmp_path / "plan.h5"
    path.write_text("something else")
    save_plan(tiny_plan, path)
    assert differences(load_plan(path), tiny_plan) == []
    assert [p.name for p in tmp_path.iterdir()] == ["plan.h5"]


def test_nothing_in_a_file_is_pickled(tiny_file):
    kinds = set()

    def look(name, item):
        kinds.update(np.asarray(value).dtype.kind for value in item.attrs.values() if value.shape)
        if isinstance(item, h5py.Dataset):
            kinds.add(item.dtype.kind)

    with h5py.File(tiny_file, "r") as file:
        kinds_of_names = {type(file["plan"].attrs["kind"])}
        file["plan"].visititems(
            lambda name, item: look(name, item) if isinstance(item, h5py.Dataset) else None
        )
        groups = ["plan", *(f"plan/{k}" for k, v in file["plan"].items() if hasattr(v, "keys"))]
        attributes = [value for group in groups for value in file[group].attrs.values()]
    assert kinds == {"f", "c"}
    assert kinds_of_names == {str}
    assert {type(value) for value in attributes} == {str, np.bool_, np.ndarray, h5py.Empty}
    assert {v.dtype.kind for v in attributes if isinstance(v, np.ndarray)} == {"i"}


@pytest.mark.parametrize("failing_call", [0, 3])
def test_a_failing_write_leaves_the_old_file_and_no_other(
    tiny_plan, tmp_path, monkeypatch, failing_call
):
    path = tmp_path / "plan.h5"
    save_plan(tiny_plan, path)
    before, calls, create = path.read_bytes(), [], h5py.Group.create_dataset

    def failing(*arguments, **options):
        calls.append(arguments)
        if len(calls) > failing_call:
            raise OSError("no space left on device")
        return create(*arguments, **options)

    monkeypatch.setattr(h5py.Group, "create_dataset", failing)
    with pytest.raises(OSError, match="no space left"):
        save_plan(tiny_plan, path)
    assert len(calls) == failing_call + 1
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["plan.h5"]


class Everything(Regularization):
    """A rule that files do not know."""

    def factors(self, sigma, size, unit_norm):
        return jnp.ones_like(size)


def test_what_cannot_be_saved_is_refused_and_leaves_no_file(tiny_plan, tmp_path):
    with pytest.raises(ValueError, match="'half', expected 'as is' or 'single'"):
        save_plan(tiny_plan, tmp_path / "a.h5", precision="half")
    plan = eqx.tree_at(
        lambda p: p.regularization, tiny_plan, Everything(), is_leaf=lambda x: x is None
    )
    with pytest.raises(ValueError, match="Everything cannot be saved"):
        save_plan(plan, tmp_path / "a.h5")
    with pytest.raises(ValueError, match="no folder"):
        save_plan(tiny_plan, tmp_path / "nowhere" / "a.h5")
    with pytest.raises(ValueError, match="it is a folder"):
        save_plan(tiny_plan, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_missing_files_and_folders(tmp_path):
    for path in (tmp_path / "nowhere.h5", tmp_path):
        with pytest.raises(FileNotFoundError, match=path.name):
            load_plan(path)


@pytest.mark.parametrize("kept", [0, 1, 20, 100, 200, BLOCK - 1, BLOCK, BLOCK + 1, 0.3, 0.9, -1])
def test_truncated_files_are_refused(tiny_file, tmp_path, kept):
    content = tiny_file.read_bytes()
    end = int(kept * len(content)) if isinstance(kept, float) else kept
    path = tmp_path / "cut.h5"
    path.write_bytes(content[:end])
    with pytest.raises(ValueError, match=r"cut\.h5 is (damaged|not|a jaxtat plan of version)"):
        load_plan(path)


@given(st.data())
@settings(deadline=None, max_examples=200)
def test_a_wrong_byte_anywhere_is_refused_or_changes_nothing(tiny_plan, tiny_file, data):
    content = bytearray(tiny_file.read_bytes())
    last = len(content) - 1
    places = [st.integers(0, 200), st.integers(0, BLOCK + 2000), st.integers(0, last)]
    offset = data.draw(st.one_of(places), label="offset")
    content[offset] ^= data.draw(st.integers(1, 255), label="changed bits")
    path = tiny_file.with_name("flipped.h5")
    path.write_bytes(content)
    try:
        loaded = load_plan(path)
    except ValueError as error:
        assert "flipped.h5" in str(error)
        return
    assert offset < BLOCK, "every byte behind the user block is under the digest"
    assert differences(loaded, tiny_plan) == []


@given(st.data())
@settings(deadline=None, max_examples=30)
def test_a_wrong_byte_in_the_densities_is_refused(tiny_plan, tiny_file, data):
    content = bytearray(tiny_file.read_bytes())
    densities = np.asarray(tiny_plan.densities).tobytes()
    start = content.find(densities)
    assert start > BLOCK
    offset = start + data.draw(st.integers(0, len(densities) - 1), label="offset")
    content[offset] ^= 1 << data.draw(st.integers(0, 7), label="bit")
    path = tiny_file.with_name("flipped.h5")
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"flipped\.h5 is damaged"):
        load_plan(path)


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "other.h5"
    path.write_text("no plan at all\n" * 100)
    with pytest.raises(ValueError, match=r"other\.h5 is not a jaxtat plan"):
        load_plan(path)
    with h5py.File(path, "w") as file:
        file["image"] = np.ones((3, 3))
    with pytest.raises(ValueError, match=r"other\.h5 is not a jaxtat plan"):
        load_plan(path)
    path.write_bytes(b"jaxtat plan 1 " + hashlib.blake2b(b"text").hexdigest().encode() + b"\n")
    path.write_bytes(path.read_bytes().ljust(BLOCK, b"\0") + b"text")
    with pytest.raises(ValueError, match=r"other\.h5 holds a plan that this jaxtat cannot read"):
        load_plan(path)


def test_another_version_is_refused(tiny_file, tmp_path):
    path = tmp_path / "later.h5"
    path.write_bytes(tiny_file.read_bytes().replace(b"jaxtat plan 1 ", b"jaxtat plan 2 ", 1))
    with pytest.raises(ValueError, match=r"later\.h5 .* version '2', this jaxtat reads version 1"):
        load_plan(path)


@pytest.mark.parametrize(
    "missing", ["densities", "radii", "curve/weights", "report/residual", "region", "grid"]
)
def test_a_missing_part_is_refused(tiny_file, tmp_path, missing):
    path = tmp_path / "part.h5"
    path.write_bytes(tiny_file.read_bytes())
    with h5py.File(path, "r+") as file:
        del file["plan"][missing]
    seal(path)
    with pytest.raises(ValueError, match=rf"part\.h5 .*{missing.split('/')[-1]}"):
        load_plan(path)


@pytest.mark.parametrize(
    ("group", "name", "value"),
    [("curve", "closed", None), ("", "regularization", None), ("region", "kind", "Heptagon")],
)
def test_a_missing_or_unknown_attribute_is_refused(tiny_file, tmp_path, group, name, value):
    path = tmp_path / "part.h5"
    path.write_bytes(tiny_file.read_bytes())
    with h5py.File(path, "r+") as file:
        attributes = file[f"plan/{group}"].attrs
        del attributes[name]
        if value is not None:
            attributes[name] = value
    seal(path)
    with pytest.raises(ValueError, match=rf"part\.h5 .*{value or name}"):
        load_plan(path)


def test_a_resealed_file_is_read(tiny_plan, tiny_file, tmp_path):
    """The refusals above come from what was changed, not from the sealing."""
    path = tmp_path / "same.h5"
    path.write_bytes(tiny_file.read_bytes())
    with h5py.File(path, "r+") as file:
        file["plan/radii"][...] *= 1.0
    seal(path)
    assert differences(load_plan(path), tiny_plan) == []


@pytest.mark.parametrize(
    ("part", "shorten"),
    [
        (lambda p: p.densities, lambda a: a[..., :-1]),
        (lambda p: p.densities, lambda a: a[:, :, :1]),
        (lambda p: p.densities, lambda a: a[0]),
        (lambda p: p.frequencies, lambda a: a[:-1]),
        (lambda p: p.angles, lambda a: a[:-1]),
        (lambda p: p.curve.points, lambda a: a[:-1]),
        (lambda p: p.curve.weights, lambda a: a[:-1]),
        (lambda p: p.curve.normals, lambda a: a[:-1]),
        (lambda p: p.region.normals, lambda a: a[:-1]),
        (lambda p: p.region.center, lambda a: a[:-1]),
        (lambda p: p.radii, lambda a: a[None]),
    ],
)
def test_arrays_that_do_not_fit_each_other_are_refused(tiny_plan, tmp_path, part, shorten):
    save_plan(eqx.tree_at(part, tiny_plan, shorten(part(tiny_plan))), tmp_path / "odd.h5")
    with pytest.raises(ValueError, match=r"odd\.h5 .*shape"):
        load_plan(tmp_path / "odd.h5")


def test_plans_are_not_loaded_in_32_bits(tiny_file):
    with jax.enable_x64(False), pytest.raises(ValueError, match="jax_enable_x64"):
        load_plan(tiny_file)
