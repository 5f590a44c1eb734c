#!/usr/bin/env bash
# Test ours with the oldest versions that pyproject.toml names of what is installed with it: by `make test-oldest`, which has built
# the extension module. Once with NumPy and image files, once with every extra. Tests for which a counterpart is too old are skipped.
set -euo pipefail
cd "$(dirname "$0")/.."
: "${PYTHON:=python3}"
work=target/oldest
rm -rf "$work"
"$PYTHON" -m maturin build --release --locked --out "$work/dist"
"$PYTHON" -m pip install --quiet uv
uv() { "$PYTHON" -m uv --quiet "$@"; }
for folder in python/phasestereo-*; do uv build --wheel --out-dir "$work/dist" "$folder"; done

# try NAME "PROJECTS AND EXTRAS" TESTS...
try() {
    name=$1 python=$work/$1/bin/python
    uv venv --python "$PYTHON" "$work/$name"
    # shellcheck disable=SC2086
    uv pip compile --python "$python" --resolution lowest-direct --only-binary :all: --find-links "$work/dist" $2 \
        $(for ours in phasestereo $(cd python && echo phasestereo-*); do echo --no-emit-package "$ours"; done) \
        --output-file "$work/$name.txt"
    uv pip install --python "$python" --no-deps --requirements "$work/$name.txt" "$work"/dist/*.whl --editable benches/harness
    uv pip install --python "$python" --requirements "$work/$name.txt" --group test scipy
    shift 2
    env --unset CI "$python" -m pytest --import-mode=append --override-ini filterwarnings= --numprocesses auto "$@"
}

try numpy "--extra io pyproject.toml" tests/core/test_refusals.py tests/core/test_pixel_types.py tests/core/test_settings.py \
    tests/rig/test_rig.py tests/io/test_io_*.py
# What is left out is of FFmpeg's handling of damage, of what NumPy 2.0 loads, and of its words on full disks.
try all "--all-extras pyproject.toml $(echo python/*/pyproject.toml)" tests/cli tests/views tests/large tests/live tests/io/test_io_*.py \
    tests/io/test_meshing.py tests/integrations -k "not build_on_a_damaged_one and not loads_none_of_what and not (full_disk and npy)"
