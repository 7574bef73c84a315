"""64 bits, shapes and types of every call checked, and what several tests share."""

import gc
import logging
import os
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from zlib import crc32

import jax
import jax.numpy as jnp
import jaxlib.version
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from jaxtyping import install_import_hook

import jaxtat

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # more only get in the way of XLA's own
# in one piece: to split each program for threads to compile costs more time than they have to gain
UNOPTIMISED = "--xla_backend_optimization_level=0 --xla_cpu_parallel_codegen_split_count=1"
UNOPTIMISED += " --xla_llvm_disable_expensive_passes=true"
# What only makes loops faster, or is for what is not there. Not the motion of code out of loops:
# without it one function is rounded differently in programs of different derivatives.
UNOPTIMISED += " --xla_disable_hlo_passes=simplify-while-loops,while-loop-constant-sinking"
UNOPTIMISED += ",tree_reduction_rewriter,zero_sized_hlo_elimination"
if jaxlib.version.__version_info__ < (0, 11):  # a process with a flag that XLA lacks is ended by it
    UNOPTIMISED += " --xla_cpu_use_fusion_emitters=false"
if "XLA_FLAGS" not in os.environ:
    # Most of the suite's time is the compiler's, for programs that run once: not worth optimising.
    # Only here: the commands that tests start get what users get.
    os.environ["XLA_FLAGS"] = UNOPTIMISED
    jax.devices()  # reads them
    del os.environ["XLA_FLAGS"]
PROGRAMS = Path(__file__).parent / ".pytest_cache" / "programs"
MOST_BYTES = 1e9  # of them; the oldest go
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    # many tests want the same programs, and so do commands, notebooks and the next run: they are
    # compiled once, and what tests compile stays out of the user's own cache
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(PROGRAMS)
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
# in a folder of these flags: they are gone, and not in a program's key
OWN = Path(os.environ["JAX_COMPILATION_CACHE_DIR"]) / f"{crc32(UNOPTIMISED.encode()):08x}"
jax.config.update("jax_compilation_cache_dir", str(OWN))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.config.update("jax_enable_x64", True)
# the lines of Python that operations come from: written into programs, and read by no one here
jax.config.update("jax_traceback_in_locations_limit", 0)


def pytest_configure(config):
    """Import the package so that every annotation of an array in it is checked, in every test."""
    if config.getoption("numprocesses", None) and not hasattr(config, "workerinput"):
        return  # the process that only hands the tests out to others
    with install_import_hook("jaxtat", "beartype.beartype"):
        for name in jaxtat.__all__:  # imported when it is asked for
            getattr(jaxtat, name)
    # Tracing makes many small objects, few of them garbage: looked for less often, not in modules.
    gc.collect()
    gc.freeze()
    gc.set_threshold(200_000, 20, 100)


def pytest_sessionfinish(session):
    """Remove the programs that were not used for longest."""
    if PROGRAMS in OWN.parents and not hasattr(session.config, "workerinput"):
        from jaxtat.cli.cache import remove_oldest

        for folder in (PROGRAMS, OWN):
            remove_oldest(folder, MOST_BYTES / 2)


# modules that are one with a package that not everyone has: nothing in them without it
collect_ignore = [
    f"jaxtat/interop/{name}.py"
    for name in ("deepinv", "patato", "simpa")
    if find_spec(name) is None
]


# The longest files, longest first: begun last, one of them would run on alone.
LONGEST = (
    "scans/test_ball_estimate.py",
    "test_notebooks.py",
    "tests/test_others_data.py",
    "reconstruction/test_medium.py",
    "reconstruction/test_laddered.py",
    "tests/test_docs.py",
    "fitting/test_model_based.py",
    "paper/test_paper.py",
    "reconstruction/test_waiting.py",
    "scans/test_acoustics.py",
    "scans/test_body_estimate.py",
    "viewer/test_session.py",
    "scans/test_misfit.py",
    "scans/test_choose.py",
    "scans/test_scan_images.py",
    "scans/test_two_speeds.py",
    "base/test_linear_algebra.py",
    "viewer/test_browser.py",
    "scans/test_constrained.py",
    "scans/test_live_scan.py",
    "viewer/test_page.py",
    "scans/test_space.py",
    "scans/test_many_scans.py",
    "studies/test_calibration.py",
    "fitting/test_coarse_grids.py",
    "cli/test_cli.py",
    "reconstruction/test_setup.py",
    "interop/test_patato.py",
    "streams/test_live.py",
)


def pytest_collection_modifyitems(items):
    def place(item):
        path = item.path.as_posix()
        return next((i for i, name in enumerate(LONGEST) if path.endswith(name)), len(LONGEST))

    files = {path: number for number, path in enumerate(dict.fromkeys(i.path for i in items))}
    items.sort(key=lambda item: (place(item), files[item.path]))


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Data made by others: JAXTAT_DATA, or ../shared/data beside the checkout."""
    default = Path(__file__).resolve().parents[1] / "shared" / "data"
    return Path(os.environ.get("JAXTAT_DATA", default))


@pytest.fixture(scope="session")
def unoptimised_flags() -> str:
    """XLA_FLAGS for processes that compile longer than they compute."""
    return UNOPTIMISED


@pytest.fixture
def unoptimised(monkeypatch, unoptimised_flags):
    """Those flags for what a test starts."""
    monkeypatch.setenv("XLA_FLAGS", unoptimised_flags)


@pytest.fixture(scope="module", autouse=True)
def few_programs():
    """Modules share programs, until these are 16000 maps of memory: 5 to 6 GB with all else.

    Linux grants a process 65530 maps; a module's programs take 1000 to 4000.
    """
    yield
    maps = Path("/proc/self/maps")
    if not maps.exists() or len(maps.read_bytes().splitlines()) > 16000:
        jax.clear_caches()
        gc.collect()


# What is found at full size, and printed: the files of tests that are about that.
WHOLE = (
    "test_best_explained.py",
    "test_constrained.py",
    "test_misfit.py",
    "test_others_data.py",
    "test_readme.py",
    "test_start_time.py",
)


@pytest.fixture(scope="module", autouse=True)
def coarse_criterion(request):
    """Speed, model and contradictions of scans told by images of half as many pixels an axis.

    They take a third of the time. That all is told at full size, too, is for the files above.
    """
    name = request.path.name
    with pytest.MonkeyPatch.context() as patch:
        if name.startswith("test_") and name not in WHOLE:
            coarse = partial(jaxtat.scans.misfit.place_of, pixels=49)
            patch.setattr("jaxtat.scans.misfit.place_of", coarse)
        yield


@pytest.fixture
def none_made():
    """A context in which no program is made yet: for what is counted, or read, when one is.

    Programs are known by the precision of products, too, which in double changes nothing. To forget
    all of them would take long, and the tests that follow would make theirs again.
    """
    return partial(jax.default_matmul_precision, "highest")


def names_of_programs(work):
    """Names of the programs that are compiled for it, as JAX logs them."""
    names = []

    class Kept(logging.Handler):
        def emit(self, record):
            if record.getMessage().startswith("Finished XLA compilation"):
                names.append(record.getMessage().split(" in ")[0])

    logger, handler = logging.getLogger("jax._src.dispatch"), Kept()
    logger.addHandler(handler)
    old, logger.propagate = logger.propagate, False
    try:
        with jax.log_compiles():
            work()
    finally:
        logger.removeHandler(handler)
        logger.propagate = old
    return names


@pytest.fixture
def programs_of():
    """`names_of_programs`, for the tests of all folders."""
    return names_of_programs


@partial(jax.jit, static_argnums=0)
def ahead(function, at, along, h):
    """The function h along a direction, and its derivative that way, all entries in one row."""
    moved = tuple(x + h * d for x, d in zip(at, along, strict=True))
    return jax.jvp(lambda *at: ravel_pytree(function(*at))[0], moved, along)


@partial(jax.jit, static_argnums=0)
def back(function, at, weights):
    """Derivatives of the weighted sum of all entries."""
    return jax.vjp(lambda *at: ravel_pytree(function(*at))[0], *at)[1](weights)


@partial(jax.jit, static_argnums=0)
def there_and_back(function, at, along, h):
    """What ``ahead`` gives, random weights, and ``back`` with them, in one program."""
    value, forward = ahead(function, at, along, h)
    weights = jnp.asarray(np.random.default_rng(8).standard_normal(value.shape))
    moved = tuple(x + h * d for x, d in zip(at, along, strict=True))
    return value, forward, weights, back(function, moved, weights)


def with_slopes(function, at):
    """The function, and its derivatives in reverse mode, of all entries with random weights."""
    size = sum(x.size for x in jax.tree.leaves(jax.eval_shape(function, *at)))
    weights = jnp.asarray(np.random.default_rng(9).standard_normal(size))
    return lambda *at: (function(*at), back(function, at, weights))


def both_modes(function, at, step=1e-5, rtol=1e-5, atol=1e-5, order=1):
    """Forward mode against central differences along a random direction, reverse against forward.

    In one program for all arguments ``at`` together, and for all calls with this function;
    `jax.test_util.check_grads` makes about six. With order 2 the derivatives in reverse mode are
    derived again, with the function. Returns those of all entries with random weights.
    """
    rng = np.random.default_rng(7)
    at = tuple(map(jnp.asarray, at))
    if order > 1:
        function = with_slopes(function, at)
    along = tuple(jnp.asarray(np.asarray(rng.standard_normal(x.shape))) for x in at)
    _, forward, weights, slopes = there_and_back(function, at, along, 0.0)
    far, near = (np.asarray(there_and_back(function, at, along, h)[0]) for h in (step, -step))
    np.testing.assert_allclose(forward, (far - near) / (2 * step), rtol=rtol, atol=atol)
    backward = sum(map(np.vdot, slopes, along))
    np.testing.assert_allclose(backward, np.vdot(weights, forward), rtol=rtol, atol=atol)
    return slopes


@pytest.fixture(scope="session")
def check_both_modes():
    """`both_modes`, for the tests of all folders."""
    return both_modes


@pytest.fixture
def data_file(data_folder, request):
    """The file named by the test's parameter, or a skip that says what is missing."""
    path = data_folder / request.param
    if not path.is_file():
        pytest.skip(f"{path.name} is not in {data_folder} (set JAXTAT_DATA)")
    return path


# Five problems that most tests, examples and pages share, so that they share programs too. Their
# radii go with the pixels; data of a phantom: phantom.circular_integrals(setup.curve, setup.radii).
@pytest.fixture(scope="session")
def arc():
    """A three-quarter arc that sees all of a disk: geometry #1 of the paper, small."""
    return jaxtat.Setup(jaxtat.circular_arc(1.3, 1.0, 80), jaxtat.disk(1.0), jaxtat.ImageGrid(21))


@pytest.fixture(scope="session")
def half_arc():
    """Half a circle around half a disk: geometry #2 of the paper, small."""
    curve, region = jaxtat.circular_arc(1.3, 0.0, 80), jaxtat.disk(1.0, 0.0)
    return jaxtat.Setup(curve, region, jaxtat.ImageGrid(21))


@pytest.fixture(scope="session")
def l_shape():
    """Detectors on an L beside a triangle, where no waves about a centre reach."""
    curve = jaxtat.polyline([(-0.8, 1.2), (-0.8, -0.8), (1.2, -0.8)], 60)
    region = jaxtat.polygon([(-0.65, -0.65), (0.75, -0.65), (-0.65, 0.75)])
    return jaxtat.Setup(curve, region, jaxtat.ImageGrid(17, 0.7), max_frequency=12.0)


@pytest.fixture(scope="session")
def ring():
    """A closed ring of detectors."""
    return jaxtat.Setup(jaxtat.circular_arc(1.3, 1.3, 64), jaxtat.disk(0.8), jaxtat.ImageGrid(17))


@pytest.fixture(scope="session")
def cap():
    """Rings of detectors on a spherical cap about a ball."""
    curve = jaxtat.spherical.spherical_cap(1.5, 1.1, 24, 56)
    return jaxtat.Setup(curve, jaxtat.spherical.ball(1.0), jaxtat.VolumeGrid(17))


@pytest.fixture(scope="session")
def arc_plan(arc):
    return jaxtat.build_plan(arc)
