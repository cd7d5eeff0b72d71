# Nothing but Python 3.11+ and make is needed: every target installs what it uses into .venv. `make demo` needs the
# package alone; the other targets need the tools of development too, which take twice the space again.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
CORE   := $(VENV)/.core
DEV    := $(VENV)/.dev
# Python compiles what it imports; to compile everything costs time and a fifth of the space.
INSTALL := $(BIN)/python -m pip install --quiet --no-compile
OUT    ?= out/demo
FUZZ_SECONDS ?= 120
CORES   := $(shell getconf _NPROCESSORS_ONLN)
# Tests of links, screens and processes wait most of their time: two more workers than cores keep the cores busy.
WORKERS := $(shell echo $$(($(CORES) + 2)))
# Tests of one file share what they record and identify, so one process gets them all; tests/conftest.py sorts the files.
SPREAD  := -n $(WORKERS) --dist loadfile --no-loadscope-reorder
# Without it every process that tests compiles all tests again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-fast test-all check docs bench fuzz format clean

demo: $(CORE)  ## record a simulated pendulum through the real protocol, identify it, compare, draw; then a blind trial
	$(BIN)/dpr-lab demo --out $(OUT)

test: $(DEV)  ## all tests but the long ones, the fast ones first
	$(BIN)/pytest -m "not long and not hardware" $(SPREAD)

test-fast: $(DEV)  ## the fast tests alone
	$(BIN)/pytest -m "not slow and not hardware" $(SPREAD)

test-all: test  ## and the long ones: every case of every table, before a release
	DPR_LAB_FULL=1 $(BIN)/pytest -m "slow and not hardware" $(SPREAD)

check: $(DEV)  ## style, types, import contracts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports

docs: $(DEV)  ## the documentation as a site in out/site; a warning is an error
	$(BIN)/sphinx-build -W --keep-going -q -b html docs out/site
	@echo "out/site/index.html"

bench: $(DEV)  ## speed and reliability figures, with their targets
	for name in evaluator wall_time uncertainty identify mujoco_sysid tui_redraw large_table; do $(BIN)/python benchmarks/$$name.py || exit 1; done
	$(BIN)/python benchmarks/diagnosis.py --quick
	$(BIN)/python benchmarks/clean_rigs.py --quick
	$(BIN)/python benchmarks/drift.py --quick
	$(BIN)/python benchmarks/soak.py --minutes 10

fuzz: $(DEV)  ## every reader of foreign bytes against inputs made to break it, FUZZ_SECONDS each
	$(INSTALL) --editable '.[fuzz]'
	for target in frames slcan session run_file run_content table rig model; do \
		$(BIN)/python fuzz/run.py $$target --seconds $(FUZZ_SECONDS) || exit 1; done

format: $(DEV)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf $(VENV) out

$(CORE): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(None if sys.version_info >= (3, 11) else "dpr-lab needs Python 3.11 or newer; this is " + sys.version.split()[0] + ". Try: make PYTHON=python3.12")'
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) --upgrade pip
	$(INSTALL) --editable .
	touch $@

$(DEV): $(CORE)
	$(INSTALL) --editable '.[dev]'
	touch $@
