#!/bin/sh
# Unpacks what `make web` builds WebAssembly with into a folder, from Debian's packages: Rust with the sources of its standard
# library and LLVM's linker. Nothing is installed: no root is needed, and the machine's own Rust stays as it is.
set -eu

folder=$1
release=bookworm
packages="rustc-web cargo-web libstd-rust-web-dev libstd-rust-web-1.96 rust-web-src libllvm22 lld-19 libllvm19
    libgit2-1.5 libhttp-parser2.9 libmbedtls14 libmbedx509-1 libmbedcrypto7"

# A configuration of apt of our own: the lists and the cache of the machine's are neither read nor written.
rm -rf "$folder.part"
mkdir -p "$folder.part/apt/lists/partial" "$folder.part/apt/cache/archives/partial" "$folder.part/debs"
cd "$folder.part"
signed="[arch=amd64 signed-by=/usr/share/keyrings/debian-archive-keyring.gpg]"
cat > apt/sources.list <<END
deb $signed http://deb.debian.org/debian $release main
deb $signed http://deb.debian.org/debian-security $release-security main
END
touch apt/status
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
# shellcheck disable=SC2086
(cd debs && apt-get download --quiet $packages)
for package in debs/*.deb; do dpkg-deb --extract "$package" .; done
rm -rf apt debs
mv "$folder.part" "$folder"
