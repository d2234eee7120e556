#!/usr/bin/env bash
# Installs a build into an empty prefix and moves it, so that nothing may rely on its place.
# usage: install.sh BUILD PREFIX
set -euo pipefail
build=$1 prefix=$2
rm -rf "$prefix" "$prefix.first"
cmake --install "$build" --prefix "$prefix.first" >/dev/null
if grep -rIl -e "$build" -e "$prefix.first" "$prefix.first"; then
  echo "install: these files name a folder of this machine" >&2
  exit 1
fi
mv "$prefix.first" "$prefix"
