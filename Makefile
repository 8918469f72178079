# make install   .venv with everything, at the versions in constraints.txt
# make demo      train Shooting Birds for a few minutes; ends with scores, a plot and a video
# make check     style, types and the quick tests, in about two minutes
# make test      style, types and all tests but those marked nightly, which CI runs
# make coverage  which lines the tests that are not slow reach
# make docs      the site with all pages and the reference, into site/; needs no PyTorch
# make bench     how fast it is on this machine

PYTHON ?= python3
BIN := .venv/bin

# Modules are compiled when they are first imported, not by the installation. Where nothing may be written then, each of
# the many programs that the tests start would compile PyTorch again, which takes longer than the tests.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: install demo check test coverage docs bench proto

install: .venv/installed

# pip comes first: the one that Python 3.11 brings takes twice as long to choose the packages.

.venv/installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --upgrade pip
	$(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt --editable ".[dev]"
	touch $@

demo: install
	$(BIN)/python -m tools.demo

check: install
	$(BIN)/python -m tools.check --quick

test: install
	$(BIN)/python -m tools.check

coverage: install
	$(BIN)/python -m tools.check --coverage

docs: .venv-docs/installed
	.venv-docs/bin/python -m tools.docs

.venv-docs/installed: pyproject.toml constraints.txt
	test -x .venv-docs/bin/python || $(PYTHON) -m venv .venv-docs
	.venv-docs/bin/python -m pip install --quiet --constraint constraints.txt --upgrade pip
	.venv-docs/bin/python -m pip install --quiet --no-compile --constraint constraints.txt --editable ".[docs]"
	touch $@

bench: install
	$(BIN)/python -m tools.bench all

proto: install
	$(BIN)/python -m tools.generate_proto
