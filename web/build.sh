#!/bin/sh
# Builds web/phasestereo.wasm: the C interface as WebAssembly with 128-bit SIMD. With the Rust that is installed, if it has
# the standard library of the target (`rustup target add wasm32-unknown-unknown`); else, on Debian, with a Rust that is
# downloaded into target/.
set -eu
cd "$(dirname "$0")/.."

target=wasm32-unknown-unknown
folder=$PWD/target/wasm-toolchain
rebuild=

if [ ! -d "$(rustc --print target-libdir --target $target)" ]; then
    [ -d "$folder" ] || web/toolchain.sh "$folder"
    export PATH="$folder/usr/bin:$PATH" RUSTC="$folder/usr/bin/rustc"
    export LD_LIBRARY_PATH="$folder/usr/lib/x86_64-linux-gnu"
    export CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER=wasm-ld
    # Debian has the sources of the standard library alone, which are built by what is not stable yet.
    export RUSTC_BOOTSTRAP=1
    rebuild=-Zbuild-std=std,panic_abort
fi

# A fifth smaller to load, and as fast: what is hot is inlined whatever the threshold.
export CARGO_PROFILE_RELEASE_OPT_LEVEL=2
export CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_RUSTFLAGS="-C target-feature=+simd128 -C strip=symbols -C llvm-args=--inline-threshold=60"
cargo build --release --locked --package phasestereo-c --target $target --target-dir target/wasm $rebuild
# In one step: a test may be reading the one before.
cp target/wasm/$target/release/phasestereo.wasm web/phasestereo.wasm.new
mv web/phasestereo.wasm.new web/phasestereo.wasm
