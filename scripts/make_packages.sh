#!/usr/bin/env bash
# Debian packages and a relocatable archive of this machine's architecture, into build/packages/packages.
#
# usage: scripts/make_packages.sh [JOBS]
set -euo pipefail
cd "$(dirname "$0")/.."
jobs=${1:-$(nproc)}
build=build/packages

cmake --preset packages -DCMAKE_INSTALL_RPATH=
cmake --build --preset packages -j "$jobs"
scripts/require_pages.sh "$build"
rm -rf "$build/packages"
(cd "$build" && cpack -G DEB)
# In the archive, libraries find each other beside themselves.
# shellcheck disable=SC2016
cmake --preset packages -DCMAKE_INSTALL_RPATH='$ORIGIN' >/dev/null
cmake --build --preset packages -j "$jobs" >/dev/null
(cd "$build" && cpack -G TGZ)
rm -rf "$build/packages/_CPack_Packages"

if command -v lintian >/dev/null; then
  lintian --fail-on error --tag-display-limit 0 "$build"/packages/*.deb
else
  echo "packages: lintian is not installed: the packages were not checked"
fi
ls -l "$build/packages"
