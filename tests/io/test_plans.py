"""Plans through files: equal to the last bit, or refused with the reason."""

import hashlib
import json
from dataclasses import replace

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
    Setup,
    SingularValueCutoff,
    Tikhonov,
    TikhonovNormBound,
    build_plan,
    circular_arc,
    detector_curve,
    disk,
    phantoms,
    polygon,
    reconstruct,
)
from jaxtat.geometry import union_of_regions
from jaxtat.io import load_plan, save_plan
from jaxtat.regularization import Regularization

BLOCK = 512  # bytes of the user block, before the digest's range
BELL = phantoms.Bells([[0.1, -0.2]], [0.6])


TINY = {"max_frequency": 5, "n_directions": 4}


def tiny(curve, method):
    """A plan of a few ten kilobytes, for three frequencies and four directions."""
    region = disk(0.8, n_boundary=48)
    return build_plan(Setup(curve, region, ImageGrid(5), **TINY), method=method)


@pytest.fixture(scope="module")
def plans():
    """One for every kind of densities and curve: in closed form, by collocation, in waves."""
    arc = circular_arc(1.3, 1.0, 16)
    wide = detector_curve(arc.points, element_width=np.linspace(0.1, 0.2, 16))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "jaxtat.densities.cylindrical_waves.orders.WORTH_A_GROUP", 1.0
        )  # several, as in large plans
        return {
            "series": tiny(circular_arc(1.3, 1.3, 16), "series"),
            "collocation": tiny(wide, "collocation"),
            "cylindrical": tiny(arc, "cylindrical"),
        }


@pytest.fixture(scope="module")
def files(plans, tmp_path_factory):
    folder = tmp_path_factory.mktemp("tiny")
    for name, plan in plans.items():
        save_plan(plan, folder / f"{name}.h5")
    return {name: folder / f"{name}.h5" for name in plans}


KINDS = ("cylindrical", "collocation")


@pytest.fixture(params=KINDS)
def kind(request):
    """Plans whose densities are rows of waves, in a tuple of groups, or samples."""
    return request.param


@pytest.fixture
def tiny_plan(plans, kind):
    return plans[kind]


@pytest.fixture
def tiny_file(files, kind):
    return files[kind]


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
    line = f"jaxtat plan 8 {digest}\n".encode()
    path.write_bytes(line + content[len(line) :])


@pytest.mark.slow
def test_a_plan_comes_back_to_the_last_bit_and_gives_the_same_image(tiny_plan, tiny_file):
    plan, loaded = tiny_plan, load_plan(tiny_file)
    assert differences(loaded, plan) == []
    assert loaded.curve.closed is False
    assert loaded.grid.shape == (5, 5)
    assert loaded.setup.sizes == plan.setup.sizes
    assert hash(loaded.setup.sizes.groups) == hash(plan.setup.sizes.groups)  # a key of programs
    assert all(type(size) is int for size in loaded.grid.shape)
    assert np.array_equal(loaded.grid.points, plan.grid.points)
    g = BELL.circular_integrals(plan.curve, plan.radii)
    assert np.array_equal(reconstruct(loaded, g), reconstruct(plan, g))


def test_single_precision_halves_the_densities_and_keeps_six_digits(
    tiny_plan, tiny_file, kind, tmp_path
):
    whole, half, plan = tiny_file, tmp_path / "half.h5", tiny_plan
    save_plan(plan, half, precision="single")
    large = jax.tree.leaves(plan.densities.groups if kind == "cylindrical" else plan.densities)
    saved = whole.stat().st_size - half.stat().st_size
    assert abs(saved - sum(leaf.nbytes for leaf in large) / 2) < 4096
    loaded = load_plan(half)
    assert differences(loaded.densities, plan.densities.in_single_precision()) == []
    others = eqx.tree_at(lambda plan: plan.densities, loaded, plan.densities)
    assert differences(others, plan) == []
    g = BELL.circular_integrals(plan.curve, plan.radii)
    exact = reconstruct(plan, g)
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
        SingularValueCutoff(1e-7, fractional=False),
        Tikhonov(1e-9),
        TikhonovNormBound(2.5),
        None,
    ],
)
def test_every_regularization_comes_back(plans, tmp_path, rule):
    plan = eqx.tree_at(lambda p: p.regularization, plans["cylindrical"], rule)
    save_plan(plan, tmp_path / "plan.h5")
    loaded = load_plan(tmp_path / "plan.h5")
    assert differences(loaded, plan) == []
    assert type(loaded.regularization) is type(rule)
    if hasattr(rule, "fractional"):
        assert loaded.regularization.fractional is rule.fractional


def test_a_rule_for_every_frequency_comes_back(plans, tmp_path):
    plan = plans["cylindrical"]
    each = np.linspace(1, 5, len(plan.frequencies))
    save_plan(eqx.tree_at(lambda p: p.regularization, plan, NormBound(each)), tmp_path / "a.h5")
    assert np.array_equal(load_plan(tmp_path / "a.h5").regularization.K, each)
    rule = NormBound(each[1:])
    save_plan(eqx.tree_at(lambda p: p.regularization, plan, rule), tmp_path / "b.h5")
    with pytest.raises(ValueError, match=r"b\.h5 holds a rule whose K has shape .* one per freq"):
        load_plan(tmp_path / "b.h5")


def test_a_series_plan_comes_back(plans, files):
    loaded = load_plan(files["series"])
    assert differences(loaded, plans["series"]) == []
    assert loaded.regularization is None
    assert loaded.curve.closed is True
    assert loaded.report.singular_values.shape == (plans["series"].frequencies.shape[0], 0)


def test_regions_of_several_kinds_come_back(plans, tmp_path):
    """Numbers of boundary points are those of each side of each region, not as many everywhere."""
    triangle = polygon([(0.2, -0.3), (0.6, 0.0), (0.2, 0.3)])
    region = union_of_regions(disk(0.3, 0.1, center=(-0.4, 0.0)), triangle)
    plan = eqx.tree_at(lambda p: p.setup.region, plans["collocation"], region)
    save_plan(plan, tmp_path / "plan.h5")
    loaded = load_plan(tmp_path / "plan.h5")
    assert differences(loaded, plan) == []
    assert [len(counts) for counts in loaded.region.counts] == [2, 3]


def test_a_region_of_many_sides_comes_back(plans, tmp_path):
    angles = np.linspace(0, 2 * np.pi, 1500, endpoint=False)
    sides = polygon(0.7 * np.stack([np.cos(angles), np.sin(angles)], axis=1), n_boundary=6000)
    plan = eqx.tree_at(lambda p: p.setup.region, plans["collocation"], sides)
    save_plan(plan, tmp_path / "plan.h5")
    assert differences(load_plan(tmp_path / "plan.h5"), plan) == []


def test_every_kind_of_part_comes_back_as_itself(plans, files):
    """Curves that are arcs stay arcs; groups come back in order, each with sizes of its own."""
    for name, plan in plans.items():
        loaded = load_plan(files[name])
        assert differences(loaded, plan) == []
        assert type(loaded.curve) is type(plan.curve)
        assert type(loaded.densities) is type(plan.densities)
    groups = loaded.densities.groups
    assert len(groups) == 3
    assert len({group.rows.shape[-2] for group in groups}) > 1
    assert type(loaded.densities.mirror) is bool
    assert type(loaded.curve.n) is int


def test_groups_of_different_lengths_and_more_than_ten_come_back_in_order(plans, tmp_path):
    """Names of members are sorted as text in the file, 0, 1, 10, 11, 2: not so when read."""
    plan, numbers = plans["cylindrical"], range(12)
    densities = plan.densities
    grown = eqx.tree_at(
        lambda d: (d.groups, d.phases),
        densities,
        (
            tuple(
                jax.tree.map(lambda a, k=k: (k + 1) * a, densities.groups[k % 3]) for k in numbers
            ),
            jnp.tile(densities.phases, (4, 1)),
        ),
    )
    repeated = [
        jnp.tile(leaf, (4, *[1] * (leaf.ndim - 1))) for leaf in jax.tree.leaves(plan.report)
    ]
    report = jax.tree.unflatten(jax.tree.structure(plan.report), repeated)
    larger = eqx.tree_at(
        lambda p: (p.densities, p.report, p.setup.sizes, p.kernels),
        plan,
        (
            grown,
            report,
            replace(plan.setup.sizes, n_frequencies=12, groups=((0, 12, 8),)),
            jnp.tile(plan.kernels, (4, 1, 1)),
        ),
    )
    save_plan(larger, tmp_path / "plan.h5")
    assert differences(load_plan(tmp_path / "plan.h5"), larger) == []


def test_arrays_of_numpy_are_saved_too(tiny_plan, tmp_path):
    save_plan(jax.tree.map(np.asarray, tiny_plan), str(tmp_path / "plan.h5"))
    assert differences(load_plan(str(tmp_path / "plan.h5")), tiny_plan) == []


def test_a_file_of_one_plan_is_replaced_by_another(tiny_plan, tmp_path):
    path = tmp_path / "plan.h5"
    path.write_text("something else")
    save_plan(tiny_plan, path)
    assert differences(load_plan(path), tiny_plan) == []
    assert [p.name for p in tmp_path.iterdir()] == ["plan.h5"]


def test_a_file_holds_a_text_and_numbers(tiny_file):
    with h5py.File(tiny_file, "r") as file:
        assert set(file) == {"plan", "arrays"}
        assert json.loads(file["plan"][()])["kind"] == "ReconstructionPlan"
        assert {array.dtype.kind for array in file["arrays"].values()} == {"f", "c"}
        assert not file.attrs


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
    plan = eqx.tree_at(lambda p: p.regularization, tiny_plan, Everything())
    with pytest.raises(ValueError, match="Everything cannot be saved"):
        save_plan(plan, tmp_path / "a.h5")
    plan = eqx.tree_at(lambda p: p.setup.radii, tiny_plan, np.sin)
    with pytest.raises(ValueError, match=r"setup.radii is a ufunc, which cannot be saved"):
        save_plan(plan, tmp_path / "a.h5")
    with pytest.raises(ValueError, match="no folder"):
        save_plan(tiny_plan, tmp_path / "nowhere" / "a.h5")
    with pytest.raises(ValueError, match="it is a folder"):
        save_plan(tiny_plan, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_missing_files_and_folders(tmp_path):
    for path, error in ((tmp_path / "nowhere.h5", FileNotFoundError), (tmp_path, ValueError)):
        with pytest.raises(error, match=path.name):
            load_plan(path)


@pytest.mark.parametrize("kept", [0, 1, 20, 100, 200, BLOCK - 1, BLOCK, BLOCK + 1, 0.3, 0.9, -1])
def test_truncated_files_are_refused(tiny_file, tmp_path, kept):
    content = tiny_file.read_bytes()
    end = int(kept * len(content)) if isinstance(kept, float) else kept
    path = tmp_path / "cut.h5"
    path.write_bytes(content[:end])
    with pytest.raises(ValueError, match=r"cut\.h5 is (damaged|not|a jaxtat plan of version)"):
        load_plan(path)


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
@settings(deadline=None, max_examples=200)
def test_a_wrong_byte_anywhere_is_refused(files, kind, data):
    content = bytearray(files[kind].read_bytes())
    line, last = content.index(b"\n"), len(content) - 1
    places = (0, line - 1), (BLOCK, BLOCK + 2000), (BLOCK, last)
    offset = data.draw(st.one_of(*[st.integers(*ends) for ends in places]), label="offset")
    content[offset] ^= data.draw(st.integers(1, 255), label="changed bits")
    path = files[kind].with_name("flipped.h5")
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"flipped\.h5 "):
        load_plan(path)


@pytest.mark.parametrize("offset", [200, BLOCK - 1])
def test_a_wrong_byte_in_what_is_left_of_the_block_changes_nothing(
    tiny_plan, tiny_file, tmp_path, offset
):
    content = bytearray(tiny_file.read_bytes())
    content[offset] ^= 7
    (tmp_path / "flipped.h5").write_bytes(content)
    assert differences(load_plan(tmp_path / "flipped.h5"), tiny_plan) == []


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
@settings(deadline=None, max_examples=30)
def test_a_wrong_byte_in_the_densities_is_refused(plans, files, kind, data):
    tiny_file, content = files[kind], bytearray(files[kind].read_bytes())
    leaves = [leaf for leaf in jax.tree.leaves(plans[kind].densities) if leaf.size]
    densities = np.asarray(data.draw(st.sampled_from(leaves), label="array")).tobytes()
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
    path.write_bytes(b"jaxtat plan 8 " + hashlib.blake2b(b"text").hexdigest().encode() + b"\n")
    path.write_bytes(path.read_bytes().ljust(BLOCK, b"\0") + b"text")
    with pytest.raises(ValueError, match=r"other\.h5 holds a plan that this jaxtat cannot read"):
        load_plan(path)


@pytest.mark.parametrize("version", [1, 2, 7, 9])
def test_another_version_is_refused(tiny_file, tmp_path, version):
    path, line = tmp_path / "other.h5", f"jaxtat plan {version} ".encode()
    path.write_bytes(tiny_file.read_bytes().replace(b"jaxtat plan 8 ", line, 1))
    message = (
        rf"other\.h5 .* version '{version}', this jaxtat reads version 8: build the plan again"
    )
    with pytest.raises(ValueError, match=message):
        load_plan(path)


def altered(source, path, change):
    """A copy of a file whose plan was changed, text or arrays, and that was sealed again."""
    path.write_bytes(source.read_bytes())
    with h5py.File(path, "r+") as file:
        tree = json.loads(file["plan"][()])
        changed = change(tree, file["arrays"])
        del file["plan"]
        file["plan"] = np.bytes_(json.dumps(tree) if changed is None else changed)
    seal(path)
    return path


def module_at(tree, place):
    """The part of a plan's text that is the module at a/b/c."""
    for name in filter(None, place.split("/")):
        tree = tree["fields"][name] if isinstance(tree, dict) else tree[int(name)]
    return tree


EITHER = ["densities", "setup", "report/residual"]
EITHER += [f"setup/{part}" for part in ("radii", "region", "region/points", "grid", "sizes")]
EITHER += ["setup/curve/closed", "setup/sizes/n_directions", "regularization"]
MISSING = {
    "collocation": [*EITHER, "setup/curve/weights", "densities/values", "setup/region/counts"],
    "cylindrical": [
        *EITHER,
        "setup/curve/half_opening",
        "setup/curve/n",
        "densities/groups",
        "densities/phases",
        "densities/mirror",
        "densities/groups/1/rows",
        "densities/groups/2/extra",
        "regularization/fractional",
    ],
}


@pytest.mark.parametrize(
    ("kind", "missing"), [(kind, part) for kind in KINDS for part in MISSING[kind]]
)
def test_a_missing_part_is_refused(tiny_file, tmp_path, missing):
    above, _, name = missing.rpartition("/")

    def remove(tree, arrays):
        del module_at(tree, above)["fields"][name]

    path = altered(tiny_file, tmp_path / "part.h5", remove)
    with pytest.raises(ValueError, match=rf"part\.h5 .*'{name}'"):
        load_plan(path)


def test_a_missing_array_is_refused(tiny_file, tmp_path):
    def remove(tree, arrays):
        del arrays["setup.radii"]

    path = altered(tiny_file, tmp_path / "part.h5", remove)
    with pytest.raises(ValueError, match=r"part\.h5 .*'setup.radii' is missing"):
        load_plan(path)


@pytest.mark.parametrize("gone", [0, 1, 2])
def test_a_missing_member_of_a_tuple_is_refused(files, tmp_path, gone):
    """Be it the first, one between, or the last: those that are left do not pass for all."""

    def remove(tree, arrays):
        del module_at(tree, "densities/groups")[gone]

    path = altered(files["cylindrical"], tmp_path / "part.h5", remove)
    with pytest.raises(ValueError, match=r"part\.h5 .*build the plan again"):
        load_plan(path)


@pytest.mark.parametrize(
    ("kind", "place", "value"),
    [
        ("collocation", "setup/region", "Heptagon"),
        ("collocation", "densities", None),
        ("cylindrical", "densities/groups/1", "Module"),
        ("cylindrical", "setup/curve", ["CircularArc"]),
        ("series", "", {}),
        ("cylindrical", "", "NormBound"),
        ("cylindrical", "setup/curve", "ImageGrid"),
        ("cylindrical", "setup/region", "ImageGrid"),
        ("cylindrical", "setup", "NormBound"),
        ("cylindrical", "setup/sizes", "ImageGrid"),
    ],
)
def test_a_part_of_an_unknown_or_wrong_class_is_refused(files, tmp_path, kind, place, value):
    """Even if its fields are whole: what a plan needs is written in its annotations."""
    fields = {
        "NormBound": {"K": 4.0, "fractional": True, "softness": None},
        "ImageGrid": {"shape": [5, 5], "half_width": 1.0, "center": 1.0},
    }

    def change(tree, arrays):
        part = module_at(tree, place)
        part["kind"] = value
        part["fields"] = fields.get(str(value), part["fields"])

    path = altered(files[kind], tmp_path / "kind.h5", change)
    with pytest.raises(ValueError, match=r"kind\.h5 holds .*build the plan again"):
        load_plan(path)


def test_a_resealed_file_is_read(tiny_plan, tiny_file, tmp_path):
    """The refusals above come from what was changed, not from the sealing."""
    path = altered(tiny_file, tmp_path / "same.h5", lambda tree, arrays: None)
    assert differences(load_plan(path), tiny_plan) == []


@pytest.mark.parametrize(
    ("part", "shorten"),
    [
        (lambda p: p.setup.sizes, lambda s: replace(s, n_frequencies=s.n_frequencies - 1)),
        (lambda p: p.setup.sizes, lambda s: replace(s, n_frequencies=10**12)),
        (lambda p: p.setup.sizes, lambda s: replace(s, n_directions=s.n_directions - 1)),
        (lambda p: p.setup.region.normals, lambda a: a[:-1]),
        (lambda p: p.setup.region.center, lambda a: a[:-1]),
        (lambda p: p.setup.radii, lambda a: a[None]),
        (lambda p: p.report.residual, lambda a: a[:, 1:]),
        (lambda p: p.report, lambda r: jax.tree.map(lambda a: a[1:], r)),
    ],
)
def test_arrays_that_do_not_fit_each_other_are_refused(tiny_plan, tmp_path, part, shorten):
    require_misfit(tiny_plan, tmp_path, part, shorten)


@pytest.mark.parametrize(
    ("part", "shorten"),
    [
        (lambda p: p.densities.values, lambda a: a[..., :-1]),
        (lambda p: p.densities.values, lambda a: a[:, :, :1]),
        (lambda p: p.densities.values, lambda a: a[:, :1]),
        (lambda p: p.densities.values, lambda a: a[:1]),
        (lambda p: p.densities.values, lambda a: a[0]),
        (lambda p: p.densities.values, lambda a: a.real),
        (lambda p: p.setup.curve.points, lambda a: a[:-1]),
        (lambda p: p.setup.curve.weights, lambda a: a[:-1]),
        (lambda p: p.setup.curve.normals, lambda a: a[:-1]),
        (lambda p: p.setup.curve, lambda c: jax.tree.map(lambda a: a[:-1], c)),
        (lambda p: p.setup.curve.element_width, lambda a: a[:-1]),
        (lambda p: p.setup.curve.element_width, lambda a: a[None]),
    ],
)
def test_samples_that_do_not_fit_are_refused(plans, tmp_path, part, shorten):
    require_misfit(plans["collocation"], tmp_path, part, shorten)


@pytest.mark.parametrize(
    ("part", "shorten"),
    [
        # of a member against its own other arrays
        (lambda p: p.densities.groups[0].rows, lambda a: a[0]),
        (lambda p: p.densities.groups[1].rows, lambda a: a[..., :-1]),
        (lambda p: p.densities.groups[1].rows, lambda a: a[:0]),
        (lambda p: p.densities.groups[2].rows, lambda a: a[:, :1]),
        (lambda p: p.densities.groups[2].extra, lambda a: a[..., 1:, :]),
        (lambda p: p.densities.groups[1].extra, lambda a: a.real),
        # of a member against the other parts of the plan
        (lambda p: p.densities.groups[1].extra, lambda a: a[..., :1]),
        (lambda p: p.densities.groups[1].extra, lambda a: a[..., 1:]),
        (lambda p: p.densities.groups[2], lambda g: jax.tree.map(lambda a: a[:, :1], g)),
        (lambda p: p.densities.groups[0], lambda g: twice_the_frequencies(g)),
        (lambda p: p.densities.groups[2], lambda g: twice_the_frequencies(g)),
        (lambda p: p.densities.groups[0], lambda g: half_the_columns(g)),
        (lambda p: p.densities.groups, lambda groups: groups[:-1]),
        (lambda p: p.densities.groups, lambda groups: groups[:1]),
        (lambda p: p.densities.groups, lambda groups: (*groups, groups[-1])),
        (lambda p: p.densities.groups, lambda groups: tuple(map(one_block, groups))),
        (lambda p: p.densities.phases, lambda a: a[:-1]),
        (lambda p: p.densities.phases, lambda a: a[:1]),
        (lambda p: p.densities.phases, lambda a: a[:, :1]),
        (lambda p: p.densities.angles, lambda a: a[:-1]),
        (lambda p: p.densities.angles, lambda a: a[:1]),
        (lambda p: p.setup.curve.center, lambda a: a[:-1]),
        (lambda p: p.setup.curve.radius, lambda a: a[None]),
        # one less has the same sizes: one of its mirrored halves would be on the axis
        (lambda p: p.setup.curve, lambda c: replace(c, n=c.n + 1)),
        (lambda p: p.setup.curve, lambda c: replace(c, n=c.n - 2)),
        (lambda p: p.densities, lambda d: replace(d, mirror=not d.mirror)),
    ],
)
def test_rows_of_waves_that_do_not_fit_are_refused(plans, tmp_path, part, shorten):
    require_misfit(plans["cylindrical"], tmp_path, part, shorten)


def twice_the_frequencies(group):
    return jax.tree.map(lambda a: jnp.concatenate([a, a]), group)


def half_the_columns(group):
    n = group.rows.shape[-1] // 2
    rows, extra_rows = group.rows[..., :n], group.extra_rows[..., :n]
    return eqx.tree_at(lambda g: (g.rows, g.extra_rows), group, (rows, extra_rows))


def one_block(group):
    return jax.tree.map(lambda a: a[:, :1], group)


def require_misfit(plan, folder, part, shorten):
    save_plan(eqx.tree_at(part, plan, shorten(part(plan))), folder / "odd.h5")
    with pytest.raises(ValueError, match=r"odd\.h5 .*shape"):
        load_plan(folder / "odd.h5")


def test_elements_that_cannot_be_are_refused(plans, tmp_path):
    plan = eqx.tree_at(
        lambda p: p.setup.curve.element_width, plans["collocation"], replace_fn=jnp.negative
    )
    save_plan(plan, tmp_path / "odd.h5")
    with pytest.raises(ValueError, match=r"odd\.h5 holds a curve whose element_width is -0\.2"):
        load_plan(tmp_path / "odd.h5")


def test_plans_are_not_loaded_in_32_bits(tiny_file):
    with jax.enable_x64(False), pytest.raises(ValueError, match="jax_enable_x64"):
        load_plan(tiny_file)


def require_refused(path, reason):
    with pytest.raises(ValueError, match=reason) as refused:
        load_plan(path)
    assert len(str(refused.value)) <= 300
    assert str(refused.value).isprintable()


def test_one_array_under_two_names_is_refused(files, tmp_path):
    """It could be a thousand, and much be made of little."""

    def link(tree, arrays):
        module_at(tree, "report")["fields"]["unit_norm"] = {"array": "setup.radii"}

    path = altered(files["cylindrical"], tmp_path / "a.h5", link)
    require_refused(path, "there twice.*build the plan again")


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (np.ones(5, "f4"), "arrays of different precision"),
        (np.ones(3, int), "radii of shape"),
        (["a" * 1000] * 3, "setup.radii has dtype"),
        (h5py.Empty("f8"), "has no numbers of its own"),
    ],
)
def test_arrays_of_another_type_are_refused(files, tmp_path, value, reason):
    def change(tree, arrays):
        del arrays["setup.radii"]
        arrays["setup.radii"] = value

    require_refused(altered(files["series"], tmp_path / "a.h5", change), reason)


def test_a_plan_without_radii_is_refused(files, tmp_path):
    def change(tree, arrays):
        for name in ("setup.radii", "totals", "kernels"):
            none = arrays[name][..., :0]
            del arrays[name]
            arrays[name] = none

    path = altered(files["series"], tmp_path / "a.h5", change)
    require_refused(path, "no frequencies, directions or radii")


@pytest.mark.parametrize("text", ["", "[5, 5", "[" * 9000, "[]", "7", '{"fields": {}}', "NaN"])
def test_texts_that_are_no_plan_are_refused(files, tmp_path, text):
    path = altered(files["series"], tmp_path / "a.h5", lambda tree, arrays: text)
    require_refused(path, "a.h5 holds .*build the")


@pytest.mark.parametrize(
    ("place", "name", "value", "reason"),
    [
        ("grid", "shape", [5.0, 5.0], "shape"),
        ("grid", "shape", [5, 5, 5], "shape"),
        ("grid", "shape", [-5, 5], "expected"),
        ("grid", "shape", [True, True], "expected"),
        ("grid", "shape", 5, "shape"),
        ("grid", "shape", {"a": 5}, "there is no class"),
        ("grid", "shape", [5, 1099511627776], "a grid whose 1099511627776 pixels a side"),
        ("curve", "n", 10**12, "no plan can hold"),
        ("curve", "n", 2**25, "and 33554432 detectors"),  # of which no array is made
        ("curve", "n", [0.0] * 10**3, "n "),
        ("curve", "n", 16.5, "n 16.5"),
        ("curve", "closed", 0.5, "closed 0.5"),
        ("region", "counts", [47, 0], "counts"),
        ("region", "counts", [[24, 24], 0], "counts"),
        ("sizes", "groups", [[0, 2, 8]], "groups"),
        ("sizes", "groups", [[0, 4, 8], [1, 3, 8]], "groups"),
        ("sizes", "groups", [[0, 3]], "groups"),
        ("sizes", "n_frequencies", 10**12, "residuals of shape"),
        ("sizes", "n_directions", 4.0, "n_directions"),
        ("sizes", "max_frequency", [5.0], "max_frequency"),
        ("sizes", "n_nodes", 10**9, "1000000000 nodes on an element, expected 1 to 100"),
        ("sizes/operator", "n_frequencies", 10**12, "sizes of a forward operator"),
        ("sizes/operator", "groups", [[0, 1]], "groups"),
        ("", "complete", False, "radii that do not cover its region"),
    ],
)
def test_sizes_and_flags_of_another_type_are_refused(files, tmp_path, place, name, value, reason):
    def change(tree, arrays):
        module_at(tree, f"setup/{place}")["fields"][name] = value

    require_refused(altered(files["cylindrical"], tmp_path / "a.h5", change), reason)
