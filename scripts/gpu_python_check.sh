#!/usr/bin/env bash
# Tries the Python package of make wheel CUDA=1 on a machine with a GPU and nothing else of ours: imports it without and
# with the GPU, runs its tests with the arrays of PyTorch and CuPy that are there, and measures what a call costs.
# Needs Python 3.10 or newer with pip and NumPy; no network.
#
# usage: scripts/gpu_python_check.sh WHEELS      a folder with the wheels of palpate, nanobind_backend and pytest
#   scripts/gpu_python_check.sh --fetch WHEELS 3.12     puts there what Python 3.12 needs, where there is a network
set -euo pipefail
cd "$(dirname "$0")/.."
usage() { sed -n '6,7s/^# //p' "$0" >&2; exit 2; }

if [ "${1:-}" = --fetch ]; then
  [ $# -eq 3 ] || usage
  wheel=$(ls build/wheels/palpate-*.whl) || { echo "gpu_python_check: make wheel CUDA=1 first" >&2; exit 1; }
  mkdir -p "$2"
  cp "$wheel" "$2"
  build/wheel-tools/bin/pip download -q --no-deps -d "$2" --python-version "$3" --only-binary=:all: \
    'nanobind-backend>=1.0,<2' pytest pluggy iniconfig packaging pygments
  ls -l "$2"
  exit 0
fi
[ $# -eq 1 ] && [ -d "$1" ] || usage
wheels=$(cd "$1" && pwd)
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
python3 -m pip install -q --no-index --no-deps --target "$place" "$wheels"/*.whl
export PYTHONPATH=$place
unset LD_LIBRARY_PATH  # a toolkit that happens to be there must not help

size=$(stat -c %s "$wheels"/palpate-*.whl)
echo "== $(python3 --version), wheel of $((size >> 20)) MB"
[ "$size" -le $((80 << 20)) ] || { echo "gpu_python_check: the wheel is larger than 80 MB" >&2; exit 1; }
python3 - <<'PYTHON'
import importlib

for name in ("numpy", "torch", "cupy"):
    try:
        print(name, importlib.import_module(name).__version__)
    except ImportError as error:
        print(name, "is missing:", error)
PYTHON

echo "== without a GPU"
CUDA_VISIBLE_DEVICES='' python3 - <<'PYTHON'
import numpy as np
import palpate

depth, camera, _ = palpate.render_scene("wall")
try:
    palpate.Sensor(camera, place="cuda")
    raise SystemExit("a sensor on a GPU that is not there")
except palpate.Error as error:
    print("refused:", error)
vertices = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.02
faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
         [1, 5, 7], [1, 7, 3]]
tool = palpate.pack(vertices, faces, 300)
force = palpate.Contact(tool).measure(palpate.Sensor(camera).update(depth), [0, 0, 0.99, 0, 0, 0, 1]).force
assert force[2] < 0, force
print("on the CPU:", force)
PYTHON

echo "== tests"
status=0
python3 -m pytest -q -rs -p no:cacheprovider python/tests/gpu python/tests/test_batch.py python/tests/test_contact.py \
  python/tests/test_surface.py python/tests/test_torch.py || status=$?

echo "== what a call costs"
python3 bench/gpu_python_overhead.py || status=$?
exit "$status"
