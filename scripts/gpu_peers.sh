#!/usr/bin/env bash
# Measures other libraries beside ours on a GPU, and pegs in Newton against our batch alone: rows in the columns of
# bench/results/contact-peers-2-cores.csv and simulators-2-cores.csv. Every part runs in a process of its own, so that one
# that fails or hangs loses nothing of the others. Kernels are compiled for all parts at once before anything is measured.
# Needs Python 3.10 or newer with NumPy, SciPy and CuPy; no network.
#
# usage: scripts/gpu_peers.sh SITE RESULTS     SITE: a folder with palpate, newton, warp, mujoco and mujoco_warp
#   scripts/gpu_peers.sh --build SITE [PREFIX]    compiles palpate into SITE, where there is nanobind; PREFIX: libraries it needs
set -euo pipefail
cd "$(dirname "$0")/.."
usage() { sed -n '7,8s/^# //p' "$0" >&2; exit 2; }

if [ "${1:-}" = --build ]; then
  [ $# -ge 2 ] && [ -d "$2" ] || usage
  site=$(cd "$2" && pwd)
  options=(-DPALPATE_PYTHON=ON -DPALPATE_CUDA=ON -DPALPATE_APPS=OFF "-DPALPATE_COMPONENTS=cameras" -DPALPATE_PAGE=OFF
    -DPALPATE_TESTS=OFF -DPALPATE_EVAL=OFF -DCMAKE_BUILD_TYPE=Release "-DPython_EXECUTABLE=$(command -v python3)")
  architecture=$(nvidia-smi --query-gpu=compute_cap --format=csv,noheader 2>/dev/null | head -1 | tr -d .) || true
  options+=("-DCMAKE_CUDA_ARCHITECTURES=${architecture:-90}")
  if [ $# -ge 3 ]; then
    options+=("-DCMAKE_PREFIX_PATH=$3/usr" "-DZLIB_ROOT=$3/usr")
    headers=$(python3 -c 'import sysconfig; print(sysconfig.get_path("include"))')
    [ -e "$headers/Python.h" ] || options+=("-DPython_INCLUDE_DIR=$(echo "$3"/python/python3*)")
  fi
  build=${PALPATE_BUILD:-build/gpu-python}
  mkdir -p "$build"
  export PYTHONPATH=$site
  cmake -S . -B "$build" -G Ninja "${options[@]}" >"$build/cmake.log" 2>&1 || { tail -40 "$build/cmake.log" >&2; exit 1; }
  sed -i 's/ -Werror / /g' "$build/build.ninja"  # what a newer compiler warns of is no matter here
  cmake --build "$build" --target _core >"$build/build.log" 2>&1 || { grep -E 'error|FAILED' "$build/build.log" | head -40 >&2; exit 1; }
  rm -rf "$site/palpate"
  cp -r python/palpate "$site/palpate"
  cp "$build"/python/_core*.so "$site/palpate"
  echo "== $site/palpate"
  exit 0
fi
[ $# -eq 2 ] && [ -d "$1" ] || usage
export PYTHONPATH PYTHONUNBUFFERED=1
PYTHONPATH=$(cd "$1" && pwd)
mkdir -p "$2"
results=$(cd "$2" && pwd)
device=${PALPATE_DEVICE:-cuda:0}
worlds=${PALPATE_WORLDS:-16384}
seconds=${PALPATE_SECONDS:-500}  # of all together
parts=$(mktemp -d)
trap 'rm -rf "$parts"' EXIT
python3 -c 'import palpate, newton, warp, mujoco, mujoco_warp; print("== all there, Warp", warp.__version__)' ||
  echo "gpu_peers: some packages are missing, see above: their parts fail" >&2

# SECONDS COMMAND ...: stops it after so long, or when the time of all is over.
within() {
  local most=$1 left=$((seconds - SECONDS))
  shift
  timeout $((left < 1 ? 1 : left < most ? left : most)) "$@"
}
peers() { within "$1" python3 bench/contact_peers.py "$2" --device "$device" --peers "$3" --poses "$4" --scenes "$5" --noises 1.5; }
pegs() { within "$1" python3 bench/simulator_figures.py "$2" --parts batch --worlds "$3" --device "$device"; }
all="palpate image warp mujoco-warp newton"

echo "== kernels"
for peer in $all; do
  peers 240 /dev/null "$peer" 4 wall >"$parts/kernels-$peer.log" 2>&1 &
done
pegs 240 /dev/null 64 >"$parts/kernels-pegs.log" 2>&1 &
wait
cat "$parts"/kernels-*.log >"$results/kernels.txt"
grep -h FAILED "$results/kernels.txt" || true
echo "== kernels are there after $SECONDS s"

status=0
pegs 120 "$results/simulators-nvidia-h200.csv" "$worlds" || status=1
echo "== pegs, after $SECONDS s"
for peer in $all; do
  peers 90 "$parts/peer-$peer.csv" "$peer" "${PALPATE_POSES:-60}" wall,sphere-out-160,ridge-90 || status=1
  # One file of all: the columns are the same.
  awk 'FNR > 1 || !seen++' "$parts"/peer-*.csv >"$results/contact-peers-nvidia-h200.csv" || true
  echo "== $peer, after $SECONDS s"
done
exit "$status"
