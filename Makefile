# Every command of the project; hooks and CI call these same targets. `make help` lists them.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
CORE := python/phasestereo/_core.abi3.so
# Where `make c` installs to, below DESTDIR.
PREFIX ?= $(CURDIR)/target/c/installed
TOOLS := target/tools/bin
# There are some 9500 places that `make mutants` could change: each week each PART of three takes others, over all files.
SHARDS := 285
PART ?= 0
SHARD = $(shell expr \( `date +%s` / 604800 \* 3 + $(PART) \) % $(SHARDS))
# Distributions on top of the core: installed from here before anything asks for them, so that PyPI is not asked.
OURS := python/phasestereo-live python/phasestereo-large benches/harness
RUST := Cargo.toml Cargo.lock $(shell find rust -name '*.rs' -o -name '*.wgsl' -o -name Cargo.toml)
# What installs or builds waits for another make that does; without flock, as on macOS, there should be one make at a time.
# A line every 15 s shows that a step goes on; the last crate alone compiles for a minute.
ALONE := $(if $(shell command -v flock),flock --close Makefile )sh -c '\
	(trap "kill \$$s; exit" TERM; while kill -0 $$$$; do sleep 15 & s=$$!; wait $$s; date "+   %T still running"; done) & beat=$$!; \
	sh -ec "$$0"; code=$$?; kill $$beat; exit $$code'
# What is built is as old as the start of its build: an edit in the meantime is built by the next make.
BEGUN = touch $@.begun
DONE = touch -r $@.begun $@ && rm $@.begun

.DEFAULT_GOAL := help
.PHONY: help demo test test-wheel test-core test-gpu test-oldest test-arm64 fuzz soak nightly mutants lint format settings licenses bench tables bench-core bench-gpu docs wheel c web hooks clean

help: ## List the commands
	@grep -E '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## (.*)/  make \1\t\2/' | expand -t 18

demo: $(VENV)/harness ## Render a pair, spoil one image, match it, print the score, write pictures and a report
	@echo "== Match a rendered pair"
	$(BIN)/phasestereo demo --output demo

test: $(VENV)/counterparts ## Build and run all the tests on every core; on two 20 minutes the first time, then 7 (PHASESTEREO_DATA: the real pairs, default ../shared)
	CARGO_PROFILE_TEST_OPT_LEVEL=0 cargo test --locked --all-features --lib
	cargo test --locked --all-features --test '*'
	cargo test --locked --all-features --doc
	cargo build --locked --all-features --profile test --lib --test '*' # tests in Python link to the C library
	$(BIN)/python -m pytest --numprocesses auto --dist worksteal
	$(MAKE) test-wheel

test-wheel: $(VENV)/ready $(CORE) ## Try the wheel in an empty environment; with CI=true the source distribution, too, in 3 minutes
	rm -rf target/wheel
	$(BIN)/maturin build --release --locked --out target/wheel
	$(BIN)/python tests/smoke_wheel.py target/wheel/*.whl
	test "$$CI" != true || { $(BIN)/maturin sdist --out target/wheel && \
		CARGO_TARGET_DIR="$(CURDIR)/target" $(BIN)/python tests/smoke_wheel.py target/wheel/*.tar.gz; }

test-core: $(VENV)/harness $(VENV)/dev ## Test the matcher alone: its stages and its Python face
	CARGO_PROFILE_TEST_OPT_LEVEL=0 cargo test --locked --all-features --lib
	cargo test --locked --all-features --test rust
	$(BIN)/python -m pytest --numprocesses auto --dist worksteal tests/core --ignore tests/core/test_c.py

# The libraries that it needs are not optimized for the tests in Rust, so that they compile in two minutes. On Debian:
# mesa-vulkan-drivers.
test-gpu: $(VENV)/harness $(VENV)/dev ## Lint and test the engine for GPUs, and its wheel, on a software driver (PHASESTEREO_GPU: a part of the name of another adapter)
	cargo clippy --locked --package phasestereo-gpu --all-features --all-targets -- --deny warnings
	RUSTDOCFLAGS="--deny warnings" cargo doc --locked --no-deps --document-private-items --quiet --package phasestereo-gpu
	XDG_RUNTIME_DIR="$${XDG_RUNTIME_DIR:-/tmp}" cargo test --locked --package phasestereo-gpu --config 'profile.test.package."*".opt-level=0' -- --nocapture
	rm -rf target/wheel-gpu
	$(BIN)/maturin build --release --locked --out target/wheel-gpu
	cd python/phasestereo-gpu && "$(CURDIR)/$(BIN)/maturin" build --release --locked --out "$(CURDIR)/target/wheel-gpu"
	$(BIN)/pip install --quiet --no-deps --force-reinstall target/wheel-gpu/phasestereo_gpu-*.whl
	$(BIN)/python -m pytest tests/gpu
	$(BIN)/python tests/smoke_wheel.py target/wheel-gpu/phasestereo_gpu-*.whl

test-oldest: $(CORE) ## Test with the oldest versions that pyproject.toml names of what is installed with it
	PYTHON=$(CURDIR)/$(BIN)/python tests/oldest.sh

test-arm64: $(VENV)/dev ## Test the core and its wheel on an emulated aarch64 (ARGS=rust, wheel or python: one part)
	PYTHON=$(CURDIR)/$(BIN)/python tests/arm64.sh $(ARGS)

fuzz: $(VENV)/counterparts ## Tests by new random examples, mutated files, strange arrays (ARGS="--seconds 7200"; 5 minutes)
	$(BIN)/python -m pytest -m hypothesis --hypothesis-profile explore
	PYTHONPATH=tests $(BIN)/python -m support.fuzzing $(ARGS)

soak: $(CORE) ## Stream pairs with faults through one Matcher (make soak ARGS="--seconds 3600"; 5 minutes)
	$(BIN)/python benches/soak.py $(ARGS)

nightly: $(VENV)/counterparts web/phasestereo.wasm ## Tests of tests/nightly whole, of which `make test` takes a sample; fuzz and soak, half an hour each
	cargo build --locked --profile test --package phasestereo-c --lib
	PHASESTEREO_NIGHTLY=1 PHASESTEREO_SEED="$$(date +%Y%m%d)" $(BIN)/python -m pytest --numprocesses auto \
		$(if $(WITHOUT),-k "not $(WITHOUT)") tests/nightly
	$(MAKE) fuzz ARGS="--seconds 1800"
	$(MAKE) soak ARGS="--seconds 1800"

mutants: $(TOOLS)/cargo-mutants $(VENV)/ready ## Change the core in 33 places, one at a time: tests notice 95 %; hours (ARGS="--file '**/halo.rs'")
	PATH="$(CURDIR)/$(TOOLS):$$PATH" $(BIN)/python tests/mutants.py $(or $(ARGS),--sharding round-robin --shard $(SHARD)/$(SHARDS))

lint: $(VENV)/counterparts ## Check formats, lints, types, stubs and the documentation of the code, about a minute
	cargo fmt --all --check
	cargo clippy --locked --workspace --exclude phasestereo-gpu --all-targets --all-features -- --deny warnings
	RUSTDOCFLAGS="--deny warnings" cargo doc --locked --no-deps --all-features --document-private-items --quiet
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/lint-imports
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest phasestereo._core

format: $(VENV)/dev ## Format the code
	cargo fmt --all
	$(BIN)/ruff format
	$(BIN)/ruff check --fix

settings: $(CORE) ## Write what Python and the glossary repeat of the table of settings

licenses: $(TOOLS)/cargo-about ## Write the licenses of the crates in the extension modules, which their wheels hold
	cd rust/python && "$(CURDIR)/$(TOOLS)/cargo-about" generate --offline --locked --fail about.hbs --output-file LICENSES.txt
	cd rust/gpu && "$(CURDIR)/$(TOOLS)/cargo-about" generate --offline --locked --fail --features python --config ../python/about.toml \
		../python/about.hbs --output-file ../../python/phasestereo-gpu/LICENSES.txt

bench: $(VENV)/harness ## Time a match against OpenCV, in a quarter of an hour (PHASESTEREO_DATA as above)
	PHASESTEREO_DATA="$${PHASESTEREO_DATA:-../shared}" $(BIN)/phasestereo bench speed --output speed/speed.jsonl $(ARGS)

tables: $(VENV)/counterparts ## Make every table and picture of comparison of the documentation, in an hour (PHASESTEREO_DATA as above)
	$(BIN)/phasestereo bench tables "$${PHASESTEREO_DATA:-../shared}" --output tables --export docs/results.json \
		--readme README.md docs/*.md $(ARGS)
	$(BIN)/phasestereo bench compare docs/results.json -o docs/images --readme docs/compare.md

bench-core: ## Time each stage of the core (make bench-core ARGS=optimization: one of them)
	cargo bench --locked --package phasestereo -- $(ARGS)

bench-gpu: ## Time the search on a GPU beside that of the core, and compare their bits (ARGS: a part of the adapter's name)
	cargo run --release --locked --package phasestereo-gpu --example bench -- $(ARGS)

docs: $(VENV)/counterparts web/phasestereo.wasm ## Build the documentation, and the pictures in it, into site/
	$(BIN)/mkdocs build --strict

wheel: $(VENV)/ready ## Build a wheel into dist/
	$(BIN)/maturin build --release --locked --out dist

c: $(TOOLS)/cargo-cinstall ## Build the C libraries, and install them by cargo-c below PREFIX (make c PREFIX=/usr/local)
	PATH="$(CURDIR)/$(TOOLS):$$PATH" cargo cinstall --release --locked --package phasestereo-c --target-dir target/c \
		--prefix "$(PREFIX)" --libdir "$(PREFIX)/lib" --destdir "$(or $(DESTDIR),/)"

web: $(VENV)/page web/phasestereo.wasm ## Build the core for browsers, and the page "try it" with it into web/dist/
	$(BIN)/python docs/try_page.py web/dist

hooks: ## Check every push as CI would
	git config core.hooksPath .githooks

clean: ## Remove all that was built
	rm -rf $(VENV) target dist site demo speed tables $(CORE) web/phasestereo.wasm web/dist

# Debian's Python comes without ensurepip unless python3-venv is installed; virtualenv needs neither.
$(VENV)/ready: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "phasestereo needs Python 3.11 or newer")'
	@echo "== Set up Python in $(VENV)"
	@$(ALONE) 'test -x $(BIN)/pip || $(PYTHON) -m venv --clear $(VENV) || \
		($(PYTHON) -m pip install --quiet --target $(VENV)/bootstrap virtualenv && \
		PYTHONPATH=$(VENV)/bootstrap $(PYTHON) -m virtualenv --quiet $(VENV)); \
		$(BIN)/python -m pip install --quiet --upgrade "pip>=25.1"; \
		$(BIN)/pip install --quiet --group build; \
		touch $@'

$(VENV)/dev: $(VENV)/ready
	@echo "== Install what tests and lints"
	@$(ALONE) '$(BIN)/pip install --quiet --group dev; touch $@'

$(VENV)/counterparts: $(VENV)/harness $(VENV)/dev
	@echo "== Install what the tests hold the library against"
	@$(ALONE) '$(BIN)/pip install --quiet --group counterparts; touch $@'

$(VENV)/page: $(CORE)
	@echo "== Install what makes a page"
	@$(ALONE) '$(BIN)/pip install --quiet "phasestereo[report]"; touch $@'

# Another environment may be active, of conda, too.
$(CORE): $(VENV)/ready pyproject.toml $(RUST)
	@echo "== Compile the matcher, which takes some minutes"
	@$(ALONE) '$(BEGUN); env -u CONDA_PREFIX VIRTUAL_ENV="$(CURDIR)/$(VENV)" \
		$(BIN)/maturin develop --release --locked; $(BIN)/python rust/python/write_settings.py || { rm -f $@; exit 1; }; $(DONE)'

$(TOOLS)/cargo-mutants:
	cargo install --debug --locked --root target/tools --version 27.1.0 cargo-mutants

$(TOOLS)/cargo-about:
	cargo install --debug --locked --root target/tools --version 0.9.3 --features cli cargo-about

# Newer ones want a newer Rust. Compiled without optimization, in four minutes.
$(TOOLS)/cargo-cinstall:
	cargo install --debug --locked --root target/tools --version 0.10.24 cargo-c

web/phasestereo.wasm: $(RUST) web/build.sh web/toolchain.sh
	$(ALONE) '$(BEGUN); web/build.sh; $(DONE)'

$(VENV)/harness: $(CORE) $(OURS:%=%/pyproject.toml)
	@echo "== Install the benchmarks, and what they need"
	@$(ALONE) '$(BIN)/pip install --quiet --no-deps $(OURS:%=--editable %); \
		$(BIN)/pip install --quiet phasestereo-bench; touch $@' # there by now: what it needs of others
