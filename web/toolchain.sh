#!/bin/sh
# Unpacks what `make web` builds WebAssembly with into a folder, from Debian's packages: Rust with the sources of its standard
# library and LLVM's linker. Nothing is installed: no root is needed, and the machine's own Rust stays as it is.
set -eu

folder=$1
# A release that Debian gives a newer Rust for the web than its own. Debian keeps no earlier versions, so the
# build takes what there is today: apt says what Rust needs, and the newest linker reads what the newest LLVM writes.
release=bookworm

# A configuration of apt of our own: the lists and the cache of the machine's are neither read nor written.
rm -rf "$folder.part"
mkdir -p "$folder.part/apt/lists/partial" "$folder.part/apt/cache/archives/partial"
cd "$folder.part"
signed="[arch=amd64 signed-by=/usr/share/keyrings/debian-archive-keyring.gpg]"
cat > apt/sources.list <<END
deb $signed http://deb.debian.org/debian $release main
deb $signed http://deb.debian.org/debian-security $release-security main
END
# What the machine has is not downloaded, but the tools themselves are: the build names them in this folder.
awk 'BEGIN { RS = ""; ORS = "\n\n" } !/^Package: (lld|cargo-web|clippy-web|rust[a-z]*-web|libstd-rust-web)/' \
    /var/lib/dpkg/status > apt/status
cat > apt/apt.conf <<END
Dir::Etc::sourcelist "$PWD/apt/sources.list";
Dir::Etc::sourceparts "/dev/null";
Dir::State "$PWD/apt";
Dir::State::status "$PWD/apt/status";
Dir::Cache "$PWD/apt/cache";
APT::Architecture "amd64";
APT::Architectures { "amd64"; };
END
export APT_CONFIG="$PWD/apt/apt.conf"
apt-get update --quiet
linker=$(apt-cache pkgnames lld- | grep -x 'lld-[0-9]*' | sort --version-sort | tail -n 1)
apt-get install --quiet --yes --download-only --no-install-recommends rustc-web cargo-web rust-web-src "$linker"
for package in apt/cache/archives/*.deb; do dpkg-deb --extract "$package" .; done
ln -s "wasm-ld-${linker#lld-}" usr/bin/wasm-ld
rm -rf apt
mv "$folder.part" "$folder"
