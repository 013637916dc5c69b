# Two commands do everything on a bare machine: `make demo` and `make test`. `make test-all` runs the
# slow tests too, and the renderer's without LLVM; `.ci/matrix` tries the wheel with the lowest and newest versions.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
export PIP_CONSTRAINT := $(CURDIR)/constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Tests start some fifty processes, each of which would compile the package anew without bytecode.
export PYTHONDONTWRITEBYTECODE :=

include benchmarks/results.mk

.PHONY: install demo test test-slow test-scalar test-all lint types docs pictures bench clean
.DEFAULT_GOAL := install

install: $(VENV)/installed

$(VENV)/installed: pyproject.toml setup.py constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "megalopta needs Python 3.11 or newer: make PYTHON=python3.11 $(MAKECMDGOALS)")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

demo: install
	$(BIN)/megalopta demo --out out/demo

# All cores; a file stays on one, as its tests share what is costly.
PYTEST := $(BIN)/python -m pytest --numprocesses auto --dist loadfile

# A test that hangs ends its process after five minutes, with the lines where every thread stands.
test: lint types
	$(PYTEST) -m 'not slow' -o faulthandler_timeout=300 -o faulthandler_exit_on_timeout=true

test-slow: install
	$(PYTEST) -m slow

test-scalar: install
	DRJIT_LIBLLVM_PATH=/none $(PYTEST) tests/render

test-all: test test-slow test-scalar

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/codespell

# Type checkers do not follow an editable install's import hook: give them a tree of links.
types: install
	rm -rf build/types && mkdir -p build/types/megalopta
	ln -s $(CURDIR)/megalopta/* $(addprefix $(CURDIR)/,assets_gen flow render scenes sensor) build/types/megalopta/
	$(BIN)/mypy --package megalopta
	$(BIN)/mypy docs/gallery docs/pictures examples/dissertation

# The site, in build/docs; without the network once its tools are installed. Any warning is an error.
docs: install
	$(BIN)/python -c 'import furo, myst_parser, numpydoc, sphinx_gallery' 2>/dev/null || $(BIN)/python -m pip install --quiet --editable '.[docs]'
	$(BIN)/python -m sphinx --quiet --fail-on-warning --keep-going --doctree-dir build/doctrees docs build/docs
	@echo "open build/docs/index.html"

# The pictures in docs/, an hour in all; `make docs` draws those of its gallery.
pictures: install
	for script in docs/pictures/*.py; do PATH=$(CURDIR)/$(BIN):$$PATH python $$script || exit 1; done

bench: install
	for script in benchmarks/bench_*.py; do $(BIN)/python $$script || exit 1; done

clean:
	rm -rf $(VENV) build out docs/generated
