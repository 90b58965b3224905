# Every target does its own set-up. `make demo` and `make test` are all one needs; the rest is for those who change things.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
MARKER := $(VENV)/installed
# One file of each room: layers, algebra, answers, constraints, solvers, statics, mechanisms, motion, a page's code.
QUICK := $(addprefix tests/,test_layers.py test_cones.py test_problem.py test_residuals.py test_solution.py test_least_constraint.py \
	test_state.py test_dynamics.py test_robot.py test_equilibrium.py test_rows.py test_errors.py solvers/test_kkt.py \
	solvers/test_newton.py constraints/test_loop.py mechanism/test_assembly.py simulation/test_impacts.py test_readme.py)

.PHONY: help demo docs test test-long time-tests quick exhaustive lint pythons dist viewer bench bench-contact fuzz mutants coverage pictures clean

help:
	@echo "make demo      Talos held by its feet and pushed: tables, and the page talos.html"
	@echo "make test      the tests, but those that take longest"
	@echo "make test-long the others, in a quarter of an hour; CI runs both"
	@echo "make quick     what a change breaks first, in half a minute"
	@echo "make exhaustive all tests, statistical ones with all their draws"
	@echo "make pythons   the quick tests on every Python that is installed, which the classifiers follow"
	@echo "make dist      wheel and sdist into dist/, and the demo from each in a clean environment"
	@echo "make viewer    the viewer of the pages, bundled anew from rbd/visual/pages/viewer (needs npm)"
	@echo "make bench     what answers and steps cost beside Pinocchio's and MuJoCo's own calls, with their marks"
	@echo "make bench-contact  friction solvers by recomputed residual: the tables of docs/reference/contact_bench.md; FILES=folder of public problems"
	@echo "make fuzz      robot files broken on purpose (N=20000 URDF, N_MJCF=4000 MJCF) and PROBLEMS=5000 random problems: refused by name, or right"
	@echo "make mutants   small faults put into the code on purpose, N=300 of them by SEED=0: each noticed by a test"
	@echo "make coverage  which lines and branches the tests execute, in processes that they start, too"
	@echo "make lint      ruff and mypy"
	@echo "make docs      the site: docs/_build/index.html, readable without a network"
	@echo "make pictures  the pictures of README and docs again (needs Chromium)"

# pip only: a lock file would name package hosts. The stamp is renewed when the dependencies change.
$(MARKER): pyproject.toml
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(f"rbd needs Python 3.11 or newer, and {sys.executable} is {v.major}.{v.minor}: make PYTHON=python3.12" if v < (3, 11) else 0)'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "installing into $(VENV) ..."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[dev]"
	@touch $(MARKER)

demo: $(MARKER)
	$(BIN)/rbd stand talos --push 0,80,0 --at torso_2_link --html talos.html

# One worker a core; tests/conftest.py gives each worker one BLAS thread.
test: $(MARKER)
	$(BIN)/rbd warm-up
	$(BIN)/python -m pytest -n auto --dist worksteal --long without

test-long: $(MARKER)
	$(BIN)/python -m pytest -n auto --dist worksteal --long only

# On a quiet machine: which tests `make test` leaves out, so that it takes less than three minutes.
time-tests: $(MARKER)
	$(BIN)/python -m pytest -n auto --dist worksteal --write-long 0.35

exhaustive: $(MARKER)
	$(BIN)/python -m pytest -n auto --dist worksteal --exhaustive

quick: $(MARKER)
	$(BIN)/python -m pytest -n auto --dist worksteal $(QUICK)

pythons: $(MARKER)
	$(BIN)/python tests/pythons.py $(QUICK)

dist: $(MARKER)
	$(BIN)/python tests/dist.py

# No lock file, which would name package hosts: versions are exact in package.json, and three.js depends on nothing.
viewer:
	cd rbd/visual/pages/viewer && npm install --silent --no-package-lock --no-audit --no-fund --ignore-scripts && npm run --silent build && rm -rf node_modules

lint: $(MARKER)
	$(BIN)/ruff check .
	$(BIN)/mypy

bench: $(MARKER)
	$(BIN)/python tests/bench.py

bench-contact: $(MARKER)
	$(BIN)/python tests/bench_contact.py --write $(if $(FILES),--files $(FILES))

fuzz: N ?= 20000
N_MJCF ?= 4000
PROBLEMS ?= 5000
mutants: N ?= 300
SEED ?= 0
fuzz: $(MARKER)
	$(BIN)/python tests/fuzz.py --n $(N) --seed $(SEED) --keep $(VENV)/fuzz_failures
	$(BIN)/python tests/fuzz.py --mjcf --n $(N_MJCF) --seed $(SEED) --keep $(VENV)/fuzz_failures
	$(BIN)/python tests/fuzz_problems.py --n $(PROBLEMS) --seed $(SEED)

# What was found is kept in .mutants: an interrupted run goes on where it stopped.
mutants: $(MARKER)
	$(BIN)/python tests/mutants.py --n $(N) --seed $(SEED)

# Compiled code is seen where it is interpreted; last bits, and warnings of NaN, are then others.
COMPILED := $(addprefix tests/,solvers/test_compiled.py simulation/test_ground_dynamics.py simulation/test_contact_solve.py \
	constraints/test_plane_contact.py) -k "not last_bit and not infinite_merit"
coverage: $(MARKER)
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest
	NUMBA_DISABLE_JIT=1 $(BIN)/coverage run -m pytest $(COMPILED)
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report

docs: $(MARKER)
	$(BIN)/python -m sphinx -b html -W --keep-going -d $(VENV)/doctrees docs docs/_build
	@echo "open docs/_build/index.html"

pictures: $(MARKER)
	$(BIN)/python docs/pictures/make.py

clean:
	rm -rf $(VENV) docs/_build .mutants .coverage* .pytest_cache .mypy_cache .ruff_cache dist talos.html
