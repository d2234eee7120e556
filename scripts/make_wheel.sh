#!/usr/bin/env bash
# The Python package with the program and its viewer inside, as one wheel in build/wheels: runs on
# Linux of this architecture with Python 3.10 or newer and nothing of ours installed.
#
# usage: scripts/make_wheel.sh [JOBS] [cmake options ...]     e.g. scripts/make_wheel.sh 8 -DPALPATE_CUDA=ON
set -euo pipefail
cd "$(dirname "$0")/.."
jobs=${1:-$(nproc)}
shift || true
tools=build/wheel-tools/bin
if ! "$tools/python" -c "import scikit_build_core, nanobind, auditwheel" 2>/dev/null; then
  scripts/setup.sh --wheel >&2
  [ -x "$tools/auditwheel" ] || { echo "make_wheel: the tools are not in build/wheel-tools, see above" >&2; exit 77; }
fi

# The stub is made with the module alone: no other palpate may be in the way.
unset PYTHONPATH
raw=build/wheel/raw
rm -rf "$raw"
# As CMake calls them everywhere else: so the compiler cache knows what it has compiled before.
export CC=${CC:-cc} CXX=${CXX:-c++}
options=-DPALPATE_BUILT=  # not that of an earlier time
built=build/wheel
for option in -DPALPATE_CUDA=OFF "$@"; do
  options+=";$option"
  case "$option" in -DPALPATE_BUILT=?*) built=${option#*=} ;; esac
done
CMAKE_BUILD_PARALLEL_LEVEL=$jobs PATH="$PWD/$tools:$PATH" \
  "$tools/python" -m pip wheel --quiet --no-build-isolation --no-deps --no-index \
  --config-settings "cmake.args=$options" -w "$raw" .  # in one: the pip of Debian 12 keeps the last of several

scripts/require_pages.sh "$built"
# What a fresh Linux lacks goes into the wheel. Its C library has to be as new as that of this machine.
rm -rf build/wheels
PATH="$PWD/$tools:$PATH" "$tools/auditwheel" repair --only-plat -z 9 -w build/wheels "$raw"/palpate-*.whl >build/wheel/auditwheel.log 2>&1 || {
  cat build/wheel/auditwheel.log >&2
  exit 1
}
python3 tools/wheel_notices.py build/wheels/palpate-*.whl
ls -l build/wheels
