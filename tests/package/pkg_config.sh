#!/usr/bin/env bash
# Builds and runs one program with what pkg-config says about an installed Palpate.
# usage: pkg_config.sh PREFIX COMPILER SOURCE
set -euo pipefail
prefix=$1 compiler=$2 source=$3
if ! command -v pkg-config >/dev/null; then
  echo "SKIPPED: there is no pkg-config"
  exit 77
fi
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
PKG_CONFIG_PATH=$(dirname "$(find "$prefix" -name palpate.pc)")
export PKG_CONFIG_PATH
cd "$folder"
read -ra flags < <(pkg-config --cflags palpate)
read -ra libraries < <(pkg-config --static --libs palpate)
"$compiler" -std=c++20 "${flags[@]}" "$source" -o program "${libraries[@]}"
LD_LIBRARY_PATH=$(pkg-config --variable=libdir palpate) ./program | tee output
grep -Eq 'inside: (49\.[5-9]|50\.[0-5]) %' output
