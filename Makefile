# make demo and make test are all a new user needs: they make .venv and install into it, once.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO := $(VENV)/installed-demo
STAMP := $(VENV)/installed
SOURCES := pyproject.toml setup.py $(wildcard scarfmt/native/*.c scarfmt/native/*.h)
WORKERS ?= 2

# Idle OpenMP threads that spin take the processor from those that work (10 to 100 times slower on busy machines).
export OMP_WAIT_POLICY := passive
export OPENBLAS_NUM_THREADS := 1
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.DEFAULT_GOAL := help
.PHONY: help demo test frozen weigh test-slow fuzz sanitize lint types check wheel bench bench-full pictures
.PHONY: dist dist-test first-hour portability web clean

help:
	@sed -n 's/^\([a-z-]*\):.*## /  make \1\t/p' $(MAKEFILE_LIST) | expand -t 22

# What a user installs to encode and to compare: no torch, no tools of developers.
$(DEMO): $(SOURCES)
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable '.[render]'
	touch $(DEMO)

# torch alone and first: whatever else is installed afterwards then finds the pinned build in place.
$(STAMP): $(SOURCES) conformance/suite/pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet 'torch==2.13.0'
	$(BIN)/python -m pip install --quiet --editable '.[train,heic,video,render,http,import,cluster,usd,dev]'
	$(BIN)/python -m pip install --quiet --no-deps --editable conformance/suite
	touch $(DEMO) $(STAMP)

demo: $(DEMO) ## encode, inspect, truncate and decode a real scene; pictures in demo-out/
	PATH="$(CURDIR)/$(BIN):$$PATH" sh examples/demo.sh

test: $(STAMP) ## all tests but the slow ones
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --quiet

frozen: $(STAMP) ## compare what the code makes with build/frozen.json; RECORD=1 records it first
	$(BIN)/python -m tests.frozen build/frozen.json $(if $(RECORD),--record)

weigh: $(STAMP) ## lines, files, classes, circles, words, cases: how much there is
	$(BIN)/python -m tests.weigh --walk

test-slow: $(STAMP) ## the tests that take minutes
	$(BIN)/python -m pytest -m slow

fuzz: $(STAMP) ## damaged files through decode and validate, ten minutes
	$(BIN)/python -m fuzz.campaign --count 100000000 --minutes 10 --jobs $(WORKERS) --seed $(or $(SEED),1)

sanitize: $(STAMP) ## the kernel under address and undefined-behaviour sanitizers, MINUTES=5 of damaged files
	$(BIN)/python -m fuzz.sanitize --minutes $(or $(MINUTES),5) --seed $(or $(SEED),1)

lint: $(STAMP) ## ruff, and which module may import which
	$(BIN)/ruff check .
	$(BIN)/lint-imports

types: $(STAMP) ## mypy --strict
	$(BIN)/mypy

check: test lint types ## tests, lint and types; CI runs a short sanitize too

wheel: $(STAMP) web ## build the wheels into dist/ and try them in an empty environment
	PYTHON=$(BIN)/python .ci/wheel

dist: $(STAMP) ## what a release consists of, from the last commit, into dist/
	rm -rf dist
	$(BIN)/python -m release.build dist

dist-test: $(STAMP) ## dist twice, compared, and each part installed and used in an empty environment; network, half an hour
	$(BIN)/python -m pytest -m release tests/release

first-hour: $(STAMP) ## every printed command of README and the guides, in an empty environment; network
	$(BIN)/python -m release.first_hour

# The files that quality encodes are used again by the others; full runs of trained need captures, see there.
BENCHMARKS := quality rivals trained time scale

bench: $(STAMP) ## the five benchmark programs, short, on the example scene: prints, writes to build/bench/ alone
	set -e; for name in $(BENCHMARKS); do $(BIN)/python -m benchmarks.$$name --short --no-write; done

bench-full: $(STAMP) ## the five benchmark programs on every scene found, hours; rewrites README.md and docs/
	set -e; for name in quality rivals time; do $(BIN)/python -m benchmarks.$$name; done
	$(BIN)/python -m benchmarks.trained --report
	$(BIN)/python -m benchmarks.scale --gaussians 10000000 --workers 1 2
	$(BIN)/python -m benchmarks.pictures

pictures: $(STAMP) ## redraw the sheet of layers in docs/images/
	$(BIN)/python -m benchmarks.pictures

portability: $(STAMP) ## the vectors on emulated s390x and arm64, half an hour; needs qemu-user and cross compilers
	$(BIN)/python -m conformance.portability

web/node_modules/.package-lock.json: web/package-lock.json
	npm ci --prefix web --ignore-scripts --no-audit --no-fund
	touch $@

# Zig compiles the decoder to WebAssembly; nothing else of Python is needed.
$(VENV)/zig-installed: web/requirements.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -c 'import ziglang' 2>/dev/null || $(BIN)/python -m pip install --quiet --requirement web/requirements.txt
	touch $@

web: web/node_modules/.package-lock.json $(VENV)/zig-installed ## the browser package and the page of `scarfmt view` (needs node 20 and npm)
	npm run --prefix web types
	PYTHON="$(CURDIR)/$(BIN)/python" npm run --prefix web build

clean: ## remove what make made, .venv included
	rm -rf $(VENV) demo-out build scarfmt/viewer/page web/dist web/node_modules *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
