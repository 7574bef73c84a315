"""64 bits, shapes and types of every call checked, and what several tests share."""

import atexit
import os
import shutil
import tempfile
from pathlib import Path

import jax
import jaxlib.version
import pytest
from jaxtyping import install_import_hook

UNOPTIMISED = "--xla_backend_optimization_level=0"
if jaxlib.version.__version_info__ < (0, 11):  # a process with a flag that XLA lacks is ended by it
    UNOPTIMISED += " --xla_cpu_use_fusion_emitters=false"
if "XLA_FLAGS" not in os.environ:
    # Most of the suite's time is the compiler's, for programs that run once: not worth optimising.
    # Only here: the commands that tests start get what users get.
    os.environ["XLA_FLAGS"] = UNOPTIMISED
    jax.devices()  # reads them
    del os.environ["XLA_FLAGS"]
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    # many tests want the same programs, and so do commands and notebooks: they are compiled once
    folder = tempfile.mkdtemp(prefix="jaxtat-tests-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["JAX_COMPILATION_CACHE_DIR"] = folder
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.1"
# what tests compile, write and start stays out of the user's own cache
os.environ["JAXTAT_CACHE"] = os.environ["JAX_COMPILATION_CACHE_DIR"]
# in a folder of its own: the flags that are gone are not in a program's key
own = os.path.join(os.environ["JAX_COMPILATION_CACHE_DIR"], "unoptimised")
jax.config.update("jax_compilation_cache_dir", own)
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
jax.config.update("jax_enable_x64", True)
# every annotation of an array in the package is checked, in every test
with install_import_hook("jaxtat", "beartype.beartype"):
    import jaxtat

    for name in jaxtat.__all__:  # imported when it is asked for
        getattr(jaxtat, name)


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Data made by others: JAXTAT_DATA, or ../shared/data beside the checkout."""
    default = Path(__file__).resolve().parents[1] / "shared" / "data"
    return Path(os.environ.get("JAXTAT_DATA", default))


@pytest.fixture
def unoptimised(monkeypatch):
    """For processes that compile longer than they compute."""
    monkeypatch.setenv("XLA_FLAGS", UNOPTIMISED)


@pytest.fixture
def little_optimised(monkeypatch):
    """For processes that compile as long as they compute."""
    monkeypatch.setenv("XLA_FLAGS", UNOPTIMISED.replace("level=0", "level=1"))


@pytest.fixture(scope="module", autouse=True)
def few_programs():
    """Each compiled program takes maps of memory, of which Linux grants a process 65530."""
    yield
    jax.clear_caches()


@pytest.fixture
def data_file(data_folder, request):
    """The file named by the test's parameter, or a skip that says what is missing."""
    path = data_folder / request.param
    if not path.is_file():
        pytest.skip(f"{path.name} is not in {data_folder} (set JAXTAT_DATA)")
    return path


@pytest.fixture(scope="session")
def small():
    """A three-quarter arc small enough for unit tests: (curve, region, grid, radii)."""
    grid = jaxtat.ImageGrid(33)
    curve = jaxtat.circular_arc(1.3, 1.0, 130)
    region = jaxtat.truncated_disk(1.0, 1.0, 260)
    return curve, region, grid, jaxtat.data_radii(curve, region, grid.spacing[0])


@pytest.fixture(scope="session")
def small_plan(small):
    return jaxtat.build_plan(*small, progress=False)
