# `make paper` and `make test` need nothing but make and Python 3.11: they make the environment.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
# one thread for the library of linear algebra: more only get in the way of XLA's own
export OPENBLAS_NUM_THREADS := 1
# large pages of memory, where Linux has them: compilers and tracing take 5 % less time
export GLIBC_TUNABLES := glibc.malloc.hugetlb=1
# where it is set, as in many containers, every process would compile all that it imports
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help paper test pytest test-slow test-lowest test-newest test-interop test-deepinv test-napari has-newest check bench peers docs pictures package clean

help:
	@echo "make paper   reproduce the paper: table, figures and metrics.json in out/paper"
	@echo "make test    style, types and most tests, the paper's run among them"
	@echo "make test-slow   the tests that take long, notebooks among them"
	@echo "make test-lowest   a part of the tests with the oldest versions that are supported"
	@echo "make test-newest   all tests with the newest Python that is found, and the newest packages"
	@echo "make test-interop   the adapters, with the checks of PACFISH and OME-Zarr, in an environment of theirs"
	@echo "make test-deepinv   those with PyTorch, for DeepInverse and SIMPA, likewise"
	@echo "make test-napari   those with napari, without a screen"
	@echo "make bench   time, error and memory of everything: results.json, .md and history.csv in benchmarks"
	@echo "make peers   other packages on the same problems, each in an environment of its own"
	@echo "make docs    the documentation, in out/site"
	@echo "make pictures   the pictures in it, in docs/pictures"
	@echo "make package wheel and source distribution in dist, made twice alike, installed and tried"
	@echo "make check   style and types alone"
	@echo "make clean   remove the environment and all results"

paper: .venv/ready
	$(BIN)/jaxtat paper --out out/paper

# style and types, on one core, beside the tests
test: .venv/ready
	$(MAKE) --jobs=2 check pytest

PYTEST := $(BIN)/python -m pytest --numprocesses 2 --dist loadfile --no-loadscope-reorder

pytest: .venv/ready
	$(PYTEST) -m "not slow"

test-slow: .venv/ready
	$(PYTEST) -m slow

check: .venv/ready
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright

# --no-compile: Python compiles what is imported, which is a small part
.venv/ready: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "jaxtat needs Python 3.11")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile \
		--constraint constraints.txt --editable '.[interop,test]'
	touch $@

bench: .venv/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
		--constraint constraints.txt --editable '.[bench]'
	$(BIN)/python -m pytest benchmarks -c benchmarks/pytest.ini \
		--benchmark-json=benchmarks/results.json
	$(BIN)/python benchmarks/report.py benchmarks/results.json docs/pictures/history.png

# needs a network for pip. Clones of what is no package: TORCH_TAT=FOLDER FAST_HANKEL=FOLDER
peers: .venv/ready
	$(BIN)/python -W ignore benchmarks/peers/run.py
	$(BIN)/python benchmarks/peers/report.py

# code of every kind that depends on JAX: kernels, solvers, loops, custom derivatives, files
LOWEST := tests/regularization/test_filtered_solve.py tests/fitting/test_penalties.py \
	tests/base/test_parallel.py tests/studies/test_comparison.py tests/steps/test_steps.py \
	tests/special tests/io/test_images.py tests/io/test_plans.py jaxtat/steps jaxtat/reconstruction \
	jaxtat/studies/uncertainty.py

# old packages may use what newer ones among them deprecate: that is no error here
test-lowest: .venv-lowest/ready
	.venv-lowest/bin/python -m pytest --numprocesses 2 --dist loadfile \
		-W default::DeprecationWarning $(LOWEST)

.venv-lowest/ready: pyproject.toml constraints-lowest.txt
	$(PYTHON) -m venv .venv-lowest
	.venv-lowest/bin/python -m pip install --quiet --disable-pip-version-check \
		--constraint constraints-lowest.txt --editable '.[test]'
	touch $@

# what `pip install` gives most people. The newest Python on the path or among pyenv's versions
NEWEST_PYTHON ?= $(lastword $(foreach v,3.12 3.13 3.14,$(firstword $(shell \
	for p in $$(command -v python$(v)) $(HOME)/.pyenv/versions/$(v).*/bin/python; do \
	$$p -c pass 2>/dev/null && echo $$p; done))))
NEWEST :=  # of the tests; all by default

# new packages may deprecate what others among them use: warnings of theirs are no errors here
test-newest: .venv-newest/ready
	.venv-newest/bin/python -m pytest --numprocesses 2 --dist loadfile --no-loadscope-reorder \
		-W default -W error:::jaxtat $(NEWEST)

has-newest:
	@test -n '$(NEWEST_PYTHON)'

.venv-newest/ready: pyproject.toml
	@test -n '$(NEWEST_PYTHON)' || { echo 'no Python 3.12 or later was found' >&2; exit 1; }
	$(NEWEST_PYTHON) -m venv --clear .venv-newest
	.venv-newest/bin/python -m pip install --quiet --disable-pip-version-check --no-compile \
		--upgrade --editable '.[interop,test]'
	touch $@

# packages of others that not everyone wants to install: what jaxtat gives them, judged by them
test-interop: .venv-interop/ready
	.venv-interop/bin/python -m pytest tests/interop

.venv-interop/ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv-interop
	.venv-interop/bin/python -m pip install --quiet --disable-pip-version-check --no-compile \
		--constraint constraints.txt --editable '.[interop,test]' ome-zarr-models pacfish
	.venv-interop/bin/python -m pip install --quiet --disable-pip-version-check --no-compile \
		--no-deps scico==0.0.7  # its own bound on JAX is older than what it runs with
	touch $@

# PyTorch for the processor alone, unless TORCH_INDEX is another list of wheels, or empty
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu
test-deepinv: .venv-deepinv/ready
	.venv-deepinv/bin/python -m pytest tests/interop/test_deepinv.py tests/interop/test_simpa.py

.venv-deepinv/ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv-deepinv
	sed '/^mpmath/d' constraints.txt > .venv-deepinv/constraints.txt  # SymPy wants an older one
	.venv-deepinv/bin/python -m pip install --quiet --disable-pip-version-check --no-compile \
		$(if $(TORCH_INDEX),--extra-index-url $(TORCH_INDEX)) \
		--constraint .venv-deepinv/constraints.txt --editable '.[deepinv,simpa]' beartype pytest
	touch $@

# napari brings plugins of pytest, which warn of themselves while pytest starts
test-napari: .venv-napari/ready
	QT_QPA_PLATFORM=offscreen .venv-napari/bin/python -m pytest -W ignore tests/interop/test_napari.py

.venv-napari/ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv-napari
	.venv-napari/bin/python -m pip install --quiet --disable-pip-version-check --no-compile \
		--constraint constraints.txt --editable '.[napari]' beartype pyqt6 pytest
	touch $@

docs: .venv/docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	$(BIN)/python scripts/check_site.py out/site

.venv/docs: .venv/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
		--constraint constraints.txt --editable '.[docs]'
	touch $@

pictures: .venv/ready
	$(BIN)/python scripts/docs_pictures.py
	$(BIN)/python scripts/picture_of_folder.py
	$(BIN)/python scripts/picture_of_viewer.py

# from the source distribution, as others will: what it lacks is missing in the wheel. Twice, as of
# the last commit: the same sources give the same bytes, so that anyone can tell what was released
package: export SOURCE_DATE_EPOCH = $(shell git log -1 --format=%ct)
package: .venv/ready
	rm -rf dist out/package
	$(PYTHON) -m venv out/package
	out/package/bin/python -m pip install --quiet --disable-pip-version-check build
	out/package/bin/python -m build --outdir dist .
	out/package/bin/python -m build --outdir out/package/again .
	diff --recursive dist out/package/again
	out/package/bin/python -m pip install --quiet --disable-pip-version-check \
		--constraint constraints.txt dist/*.whl
	cd out/package && bin/jaxtat --help > help.txt && bin/python -c \
		'import jaxtat; print(jaxtat.__version__, jaxtat.__file__)'

clean:
	rm -rf .venv .venv-lowest .venv-newest .venv-interop .venv-deepinv .venv-napari .venv-peers \
		.pytest_cache out dist
