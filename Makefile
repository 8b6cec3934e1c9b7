# On a machine with nothing but Python 3.11 or newer and make: `make demo` shows what slkit does, `make test` proves it.

PYTHON ?= python3
BIN := .venv/bin
INSTALLED := .venv/.installed
BENCH := .venv-bench/bin
BENCH_INSTALLED := .venv-bench/.installed

.PHONY: install demo compare test check bench faults patterns lock clean

install: $(INSTALLED)

$(INSTALLED): requirements.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "slkit needs Python 3.11 or newer; set PYTHON=...")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

demo: $(INSTALLED)
	$(BIN)/python examples/00_demo.py demo

# One object by two methods on one simulated calibration, as in the paper's figures 9 and 10; results in comparison/.
compare: $(INSTALLED)
	$(BIN)/python examples/06_compare.py comparison

test: $(INSTALLED)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2

check: $(INSTALLED)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright
	$(BIN)/lint-imports
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

# Speeds as ratios within one run; with PAGE=docs/performance.md they are written there, too.
bench: $(INSTALLED) $(BENCH_INSTALLED)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/benchmarks.py
	mkdir -p .benchmarks
	OPENBLAS_NUM_THREADS=1 $(BENCH)/python -m pytest --quiet --noconftest -c /dev/null --rootdir tests \
	  -p no:cacheprovider -p no:dash --benchmark-quiet --benchmark-json .benchmarks/others.json tests/bench_others.py
	OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/decoding_benchmarks.py --large --others .benchmarks/others.json \
	  $(if $(PAGE),--page $(PAGE))

# The others bring an OpenCV that takes the place of ours; the lock leaves ours out, hence no dependencies.
$(BENCH_INSTALLED): requirements-bench.lock pyproject.toml
	$(PYTHON) -m venv .venv-bench
	$(BENCH)/python -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes -r requirements-bench.lock
	$(BENCH)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

# Makes every mistake of docs/faults.md on purpose and fills its table; takes a while.
faults: $(INSTALLED)
	$(BIN)/python docs/faults.py

# After a change to codecs or targets; tests/test_patterns.py says when.
patterns: $(INSTALLED)
	$(BIN)/python tests/regenerate_patterns.py patterns

# Needs uv; the result names versions and hashes for every platform, and no index.
lock:
	uv pip compile pyproject.toml --group check --group test --group build --universal --python-version 3.11 \
	  --generate-hashes --no-header --no-emit-index-url --upgrade --quiet --output-file requirements.lock
	uv pip compile pyproject.toml --group bench --group build --universal --python-version 3.11 \
	  --no-emit-package opencv-python-headless --no-emit-package opencv-contrib-python \
	  --generate-hashes --no-header --no-emit-index-url --upgrade --quiet --output-file requirements-bench.lock

clean:
	rm -rf .venv .venv-bench .benchmarks demo comparison site
