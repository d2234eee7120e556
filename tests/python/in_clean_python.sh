#!/usr/bin/env bash
# Installs the wheel into a clean folder of Python, and does there what its users do.
#
# usage: tests/python/in_clean_python.sh install|test|types|torch|ray|robot|simulators|docs
# Ends with 77 where something is missing that scripts/setup.sh --test fetches.
set -euo pipefail
cd "$(dirname "$0")/../.."
root=$PWD
clean=build/wheel-clean
wheels=build/wheelhouse
unset PYTHONPATH

install_from_wheels() { "$clean/bin/python" -m pip install -q --no-compile --no-index --find-links "$wheels" "$@"; }
# Installs packages one by one, of which there need not be a wheel.
install_if_there() {
  local package name
  for package in "$@"; do
    name=${package%%[[=]*}
    compgen -G "$wheels/${name//-/_}-*" >/dev/null || continue
    install_from_wheels "$package" 2>/dev/null || true
  done
}
is_there() { "$clean/bin/python" -c "import $1" 2>/dev/null; }

case "${1:-}" in
  install)
    wheel=$(ls build/wheels/palpate-*.whl 2>/dev/null) || { echo "skipped: there is no wheel in build/wheels"; exit 77; }
    [ -d "$wheels" ] || { echo "skipped: $wheels is missing; scripts/setup.sh --test fetches it"; exit 77; }
    size=$(stat -c %s "$wheel")
    echo "$wheel: $size bytes"
    [ "$size" -le $((30 << 20)) ] || { echo "the wheel is larger than 30 MB"; exit 1; }
    python3 -m venv --clear "$clean"
    start=$(date +%s.%N)
    install_from_wheels "$wheel"
    # The five lines of the guide.
    cd "$(mktemp -d)"
    "$root/$clean/bin/palpate" shape box --size 0.04 -o tool.stl >/dev/null
    "$root/$clean/bin/python" - <<'PYTHON'
import palpate
tool = palpate.pack_file("tool.stl", 1000)
depth, camera, X_WC = palpate.render_scene("wall")
surface = palpate.Sensor(camera).update(depth)
force = palpate.Contact(tool).measure(surface, [0, 0, 0.99, 0, 0, 0, 1]).force
assert force[2] < 0, force
PYTHON
    echo "from pip install to a first wrench: $(echo "$(date +%s.%N) - $start" | bc) s"
    cd "$root"
    # Whatever the loader finds comes from the wheel or is part of every Linux.
    site=$("$clean/bin/python" -c "import palpate, pathlib; print(pathlib.Path(palpate.__file__).parent)")
    for file in "$site"/_core.abi3.so "$site"/bin/palpate "$site".libs/*; do
      if ldd "$file" | grep -E "not found|=> /usr" | grep -vE "lib(c|m|dl|rt|pthread|stdc\+\+|gcc_s|resolv|z)\.so"; then
        echo "$file needs what a clean machine lacks"
        exit 1
      fi
    done
    install_from_wheels pytest mypy pandas matplotlib pyarrow foxglove-sdk mcap-protobuf-support
    # shellcheck disable=SC2046
    install_if_there zarr torch "ray[data]" rerun-sdk pin quadprog ompl example-robot-data $(grep -v '^#' examples/simulators/requirements.txt)
    ;;
  *) [ -x "$clean/bin/pytest" ] || { echo "skipped: the wheel is not installed in $clean"; exit 77; } ;;&
  test)
    PALPATE_PROGRAM=$root/$clean/bin/palpate "$clean/bin/pytest" -q -rs -p no:cacheprovider python/tests \
      --ignore python/tests/test_types.py --ignore python/tests/test_torch.py --ignore python/tests/test_ray.py \
      --ignore python/tests/robot/test_guard.py --ignore python/tests/simulators
    ;;
  types) "$clean/bin/pytest" -q -p no:cacheprovider python/tests/test_types.py ;;
  torch)
    is_there torch || { echo "skipped: PyTorch is not installed (3 GB); build/wheel-tools/bin/pip download -d $wheels torch gets it"; exit 77; }
    "$clean/bin/pytest" -q -p no:cacheprovider python/tests/test_torch.py
    ;;
  ray)
    is_there ray || { echo "skipped: Ray is not installed (80 MB); build/wheel-tools/bin/pip download -d $wheels 'ray[data]' gets it"; exit 77; }
    RAY_AUTH_MODE=disabled "$clean/bin/pytest" -q -p no:cacheprovider python/tests/test_ray.py
    ;;
  robot)
    { is_there pinocchio && is_there quadprog; } || { echo "skipped: Pinocchio and quadprog are not installed; scripts/setup.sh --test fetches them"; exit 77; }
    "$clean/bin/pytest" -q -p no:cacheprovider python/tests/robot
    ;;
  # Without simulators, the law of contact is tested alone, and each example is skipped by its name.
  simulators) "$clean/bin/pytest" -q -rs -p no:cacheprovider python/tests/simulators ;;
  docs) "$clean/bin/python" tests/docs/python_blocks.py ;;
esac
