# `make paper` and `make test` need nothing but make and Python 3.11: they make the environment.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
# one thread for the library of linear algebra: more only get in the way of XLA's own
export OPENBLAS_NUM_THREADS := 1

.PHONY: help paper test check bench clean

help:
	@echo "make paper   reproduce the paper: table, figures and metrics.json in out/paper"
	@echo "make test    style, types and all tests, the paper's run among them"
	@echo "make bench   time, error and memory of everything, into benchmarks/results.json and .md"
	@echo "make check   style and types alone"
	@echo "make clean   remove the environment and all results"

paper: .venv/ready
	$(BIN)/jaxtat paper --out out/paper

test: check
	$(BIN)/python -m pytest --numprocesses 2 --dist loadfile --no-loadscope-reorder

check: .venv/ready
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright

.venv/ready: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "jaxtat needs Python 3.11")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
		--constraint constraints.txt --editable '.[test]'
	touch $@

bench: .venv/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
		--constraint constraints.txt --editable '.[bench]'
	$(BIN)/python -m pytest benchmarks -c benchmarks/pytest.ini \
		--benchmark-json=benchmarks/results.json
	$(BIN)/python benchmarks/report.py benchmarks/results.json

clean:
	rm -rf .venv out
