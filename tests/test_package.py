"""What `import jaxtat` gives: everything, but only when it is asked for."""

import pkgutil
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import jaxtat
from jaxtat import everything

PACKAGE = Path(jaxtat.__file__).parent


def test_public_names_are_those_of_the_package():
    """And none is a submodule's too, whose import would put the module in its place."""
    assert sorted(jaxtat.__all__) == sorted(set(jaxtat.__all__)) == sorted(dir(jaxtat))
    modules = {module.name for module in pkgutil.iter_modules(jaxtat.__path__)}
    for name in set(jaxtat.__all__) - {"__version__"}:
        found = getattr(jaxtat, name)
        assert found is getattr(everything, name)
        assert found.__doc__, name
        assert isinstance(found, ModuleType) or name not in modules
    given = {name for name in vars(everything) if not name.startswith("_")}
    assert given - {"jaxtyping"} == set(jaxtat.__all__) - {"__version__"}


def test_no_module_has_the_name_of_a_function_of_its_package():
    """Whichever is imported last would hide the other."""
    for package in PACKAGE.glob("**/__init__.py"):
        public = set(re.findall(r'^    "(\w+)",$', package.read_text(), re.MULTILINE))
        for path in package.parent.glob("*.py"):
            made = re.findall(r"^(?:def|class) (\w+)", path.read_text(), re.MULTILINE)
            assert path.stem not in public.union(made), path


def test_no_two_classes_share_a_name():
    """Nor does a private one with a public one: in a traceback only the name is seen."""
    places = {}
    for path in PACKAGE.rglob("*.py"):
        for name in re.findall(r"^class _?(\w+)", path.read_text(), re.MULTILINE):
            places.setdefault(name, []).append(path.relative_to(PACKAGE).as_posix())
    assert {name: paths for name, paths in places.items() if len(paths) > 1} == {}


def test_unknown_names_are_refused():
    with pytest.raises(AttributeError, match="module 'jaxtat' has no attribute 'circle'"):
        jaxtat.circle  # noqa: B018
    with pytest.raises(ImportError, match="cannot import name 'circle'"):
        from jaxtat import circle  # noqa: F401


def test_nothing_is_imported_before_it_is_asked_for():
    program = """
import sys
import jaxtat
assert "jax" not in sys.modules
jaxtat.__version__, dir(jaxtat)
assert "jax" not in sys.modules
jaxtat.steps.cosine_filter  # a submodule that is no public name
from jaxtat import circular_arc, phantoms
from jaxtat import *
assert studies.sharpness is jaxtat.studies.image_sharpness.sharpness
"""
    subprocess.run([sys.executable, "-c", program], check=True)
