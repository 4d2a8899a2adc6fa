# `make run`: the paper's main scenario. `make test`: the fast tests. `make check`: all of CI.
# Needs Python 3.11 to 3.13 and nothing else.
SHELL := /bin/sh
PYTHON ?= $(shell for p in python3.13 python3.12 python3.11 python3 python; do \
	$$p -c 'import sys, venv, ensurepip; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null \
	&& echo $$p && break; done)
BIN := .venv/bin
# what runs need, and what work on the code needs beside it
READY := .venv/.ready
ALL := .venv/.all
# the compiled libraries; made anew where their sources have changed
CORE := .venv/.core
# a complete lock needs no search for what fits, and what nobody imports needs no bytecode
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-compile

.PHONY: run test check check-more nightly prove lint format typecheck paper bench docs references site gallery lock clean

run: $(CORE)
	$(BIN)/dtb run controller=nimc_twin

# the fast tier: no broker, no diagnosis from end to end, no integration of references. Files whose tests share what is
# costly stay with one worker and come first (tests/conftest.py).
TEST := $(BIN)/python -m pytest -n 2 --dist loadscope

test: $(ALL)
	$(TEST)

# what a change has to pass, all that CI runs
check: lint typecheck site test check-more

# the rest of the tests of a change, and the blind proof on six recordings; fails if the score is below what was reached
check-more: $(ALL)
	$(TEST) -m "check and not nightly"
	$(BIN)/dtb prove --quick n=6 out="$$(mktemp -d)/proof"

# campaigns, every diagnosis, the references integrated anew, the blind proof on twenty recordings
nightly: $(ALL) prove
	$(TEST) -m nightly

prove: $(CORE)
	$(BIN)/dtb prove --quick out="$$(mktemp -d)/proof"

paper: $(CORE)
	$(BIN)/dtb paper

lint: $(ALL)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache
	$(BIN)/python tests/ratchet.py

format: $(ALL)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

typecheck: $(ALL)
	$(BIN)/mypy

# what tests/reference says of its cases, solved anew where the equations or a rig have changed: up to fifteen minutes
references: $(ALL)
	cd tests && ../$(BIN)/python -m reference.store

# the tables that are generated from the code: docs/effects.md, docs/configuration.md
docs: $(ALL)
	$(BIN)/python -m dtbacklash.docs

# the docs as a site, in build/site; a link that leads nowhere or a page that the navigation lacks fails it
site: $(ALL)
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

# docs/gallery.md with its figures: conceals and diagnoses a recording for each, minutes
gallery: $(ALL)
	$(BIN)/python -m studies gallery docs

bench: $(ALL)
	$(BIN)/python -m studies

# The locks hold for every Python and every platform; `make lock` after a change of the dependencies. What only the
# baselines need does not hold back everything else: sysidentpy's upper limit of numpy is overridden, and its test runs.
# What runs need is a part of the rest.
COMPILE = $(BIN)/uv pip compile pyproject.toml --no-config --universal --python-version 3.11 --fork-strategy fewest \
	--generate-hashes --no-annotate --no-emit-index-url --no-header --quiet
FOR_RUNS := --extra build --extra excel --extra remote

lock: $(ALL)
	echo 'numpy>=2.1' | $(COMPILE) $(FOR_RUNS) --extra compare --extra dask --extra dev --extra docs --extra fmu --extra matlab \
		--extra mujoco --extra submitit --upgrade --override - --output-file requirements-all.lock
	$(COMPILE) $(FOR_RUNS) --constraint requirements-all.lock --upgrade --output-file requirements.lock
	echo 'ziglang>=0.13' | $(COMPILE:pyproject.toml=-) --upgrade --output-file requirements-compiler.lock

# A half-finished set-up has no stamp and is done again; the project itself is installed in place.
$(READY): requirements.lock pyproject.toml hatch_build.py
	@test -n "$(PYTHON)" || { echo "make: needs Python 3.11, 3.12 or 3.13 with venv; set PYTHON=..." >&2; exit 1; }
	@rm -f $(READY)
	$(PYTHON) -m venv .venv
	$(INSTALL) --require-hashes -r requirements.lock
	@test -n "$$CC" || command -v cc > /dev/null || { \
		echo "make: no C compiler here; takes that of the package ziglang" >&2 \
		&& $(INSTALL) --require-hashes -r requirements-compiler.lock; }
	$(INSTALL) --no-build-isolation -e .
	@touch $(READY)

$(CORE): $(wildcard dtbacklash/core/*.[ch] dtbacklash/prove/simulator/*.[ch]) dtbacklash/core/build.py $(READY)
	@$(BIN)/python -m dtbacklash.core.build
	@touch $(CORE)

$(ALL): requirements-all.lock $(CORE)
	$(INSTALL) --require-hashes -r requirements-all.lock
	@touch $(ALL)

clean:
	rm -f dtbacklash/core/_core.so dtbacklash/prove/simulator/_simulator.so dtbacklash/*/_declared.py dtbacklash/*/*/_declared.py
	rm -rf .venv build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
