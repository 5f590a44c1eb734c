#!/usr/bin/env bash
# Tests the core and its wheel on aarch64, emulated: no board is needed, and nothing on this machine is changed.
#
# Debian's packages for arm64 are unpacked into target/arm64 (1.6 GB in all): the standard library of Rust, which rustup would
# have to fetch, a Python and the C library; and QEMU, which runs all that. Zig links, from PyPI. Then:
#   rust    the whole Rust suite
#   wheel   a manylinux wheel, into target/arm64/wheels
#   python  tests by that wheel under the emulated Python, of which test_platforms.py pins the bits
# Without an argument all three.
set -euo pipefail
cd "$(dirname "$0")/.."
repository=$PWD
here=$repository/target/arm64
root=$here/root
python=${PYTHON:-$repository/.venv/bin/python}
triple=aarch64-unknown-linux-gnu
# The oldest glibc that the wheel is for.
glibc=2.28

# Debian's bookworm, whatever is installed here: `rustc-web` is the newest Rust of its security archive.
host_packages="rustc-web libllvm22 libstd-rust-web-dev libstd-rust-web-1.96 qemu-user-static"
arm_packages="libstd-rust-web-dev libstd-rust-web-1.96 libc6 libgcc-s1 libstdc++6 zlib1g libexpat1 libffi8 libssl3
    libbz2-1.0 liblzma5 libuuid1 libpython3.11-minimal libpython3.11-stdlib python3.11-minimal"
test_files="test_platforms.py test_settings.py test_descriptor.py test_cost.py test_aggregation.py"

# A configuration with lists, cache and sources of its own: apt neither reads nor writes the machine's.
configure_apt() {
    mkdir -p "$here"/apt/{lists,archives}/partial
    touch "$here/apt/status"
    cat >"$here/apt/apt.conf" <<END
APT::Architecture "amd64";
APT::Architectures { "amd64"; "arm64"; };
APT::Sandbox::User "";
Dir::State "$here/apt";
Dir::State::status "$here/apt/status";
Dir::Cache "$here/apt";
Dir::Etc::sourcelist "$here/apt/sources.list";
Dir::Etc::sourceparts "-";
Acquire::Languages "none";
END
    local signed="[signed-by=/usr/share/keyrings/debian-archive-keyring.gpg]"
    cat >"$here/apt/sources.list" <<END
deb $signed http://deb.debian.org/debian bookworm main
deb $signed http://deb.debian.org/debian-security bookworm-security main
END
}

unpack_packages() {
    [ -e "$here/unpacked" ] && return
    rm -rf "$root" "$here/debs"
    configure_apt
    mkdir -p "$root" "$here/debs"
    (
        cd "$here/debs"
        export APT_CONFIG=$here/apt/apt.conf
        apt-get update --quiet=2
        # shellcheck disable=SC2086  # the lists are of words
        apt-get download --quiet=2 $(printf '%s:amd64 ' $host_packages) $(printf '%s:arm64 ' $arm_packages)
    )
    for package in "$here"/debs/*.deb; do dpkg --extract "$package" "$root"; done
    rm -r "$here/debs" "$here/apt"
    touch "$here/unpacked"
}

# The tools that link, and what the emulated Python imports, beside the wheel.
install_from_pypi() {
    [ -e "$here/installed" ] && return
    rm -rf "$here/tools" "$here/site"
    "$python" -m pip install --quiet --target "$here/tools" --group arm64
    "$python" -m pip install --quiet --target "$here/site" --only-binary :all: --implementation cp --python-version 3.11 \
        --platform "manylinux_${glibc/./_}_aarch64" --platform manylinux_2_27_aarch64 --platform manylinux2014_aarch64 \
        numpy --group test
    touch "$here/installed"
}

# Environment of all that compiles. Cargo is the machine's, the compiler is not: its libraries lie beside it.
use_tools() {
    cat >"$here/rustc" <<END
#!/bin/sh
LD_LIBRARY_PATH="$root/usr/lib/x86_64-linux-gnu" exec "$root/usr/bin/rustc" "\$@"
END
    chmod +x "$here/rustc"
    export RUSTC=$here/rustc
    export PATH=$here/tools/bin:$PATH PYTHONPATH=$here/tools CARGO_ZIGBUILD_PYTHON_PATH=$python
    export CARGO_TARGET_DIR=$here/build
    export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="$root/usr/bin/qemu-aarch64-static -L $root"
}

test_rust() {
    cargo-zigbuild test --locked --package phasestereo --target "$triple.$glibc" --lib --tests
}

build_wheel() {
    rm -rf "$here/wheels"
    PYO3_CROSS_PYTHON_VERSION=3.11 "$python" -m maturin build --release --locked --zig --target "$triple" \
        --compatibility "manylinux_${glibc/./_}" --out "$here/wheels"
    "$python" -m pip install --quiet --target "$here/site" --upgrade --no-deps --only-binary :all: \
        --platform "manylinux_${glibc/./_}_aarch64" --implementation cp --python-version 3.11 "$here"/wheels/*.whl
}

test_python() {
    (
        cd tests/core
        # shellcheck disable=SC2086  # the list is of words
        PYTHONPATH=$here/site "$root/usr/bin/qemu-aarch64-static" -L "$root" "$root/usr/bin/python3.11" \
            -m pytest --import-mode=append -p no:cacheprovider $test_files
    )
}

unpack_packages
install_from_pypi
for step in "${@:-rust wheel python}"; do
    for word in $step; do
        case $word in
            rust) (use_tools; time test_rust) ;;
            wheel) (use_tools; time build_wheel) ;;
            python) time test_python ;;
            *) echo "$0: $word is none of rust, wheel, python" >&2 && exit 2 ;;
        esac
    done
done
