#!/usr/bin/env bash
# Builds the core and its CUDA backend on a machine with a GPU, runs all tests on it, the four
# checkers of compute-sanitizer and the benchmarks, and prints a short table. Needs nvcc, CMake, make,
# a C++ compiler and GoogleTest; nothing is downloaded.
#
# usage: scripts/gpu_check.sh [--no-sanitizer] [--quick] [BUILD_DIR [RESULTS_DIR]]
#   RESULTS_DIR gets gpu-MACHINE-COMMIT.csv, in the columns of bench/results/
set -euo pipefail
cd "$(dirname "$0")/.."

sanitizer=1
quick=()
while [[ ${1:-} == --* ]]; do
  case $1 in
    --no-sanitizer) sanitizer=0 ;;
    --quick) quick=(--quick) ;;
    *) sed -n '6,7s/^# //p' "$0" >&2; exit 2 ;;
  esac
  shift
done
build=${1:-build/gpu}
mkdir -p "$(dirname "$build")"
results=${2:-$build}

for tool in nvcc cmake nvidia-smi; do
  command -v "$tool" >/dev/null || { echo "gpu_check: $tool is missing; install it and run this again" >&2; exit 1; }
done
gpu=$(nvidia-smi --query-gpu=name --format=csv,noheader | head -1)
architecture=$(nvidia-smi --query-gpu=compute_cap --format=csv,noheader | head -1 | tr -d .)
echo "== $gpu, compute capability $architecture, $(nproc) cores"

echo "== build"
cmake -S . -B "$build" -G "Unix Makefiles" -DCMAKE_BUILD_TYPE=Release -DPALPATE_APPS=OFF -DPALPATE_CUDA=ON \
  -DPALPATE_BENCH=ON -DCMAKE_CUDA_ARCHITECTURES="$architecture" >"$build.cmake.log" 2>&1 ||
  { cat "$build.cmake.log"; exit 1; }
make -C "$build" -j"$(nproc)" >"$build.make.log" 2>&1 || { tail -40 "$build.make.log"; exit 1; }

echo "== tests"
status=0
ctest --test-dir "$build" -j24 --output-on-failure >"$build.ctest.log" 2>&1 || status=1
grep -E "tests passed|Failed|\*\*\*" "$build.ctest.log" || true
[ "$status" -eq 0 ] || { tail -60 "$build.ctest.log"; exit 1; }

if [ "$sanitizer" -eq 1 ]; then
  echo "== compute-sanitizer"
  check() {  # CHECKER TEST: one line
    local log="$build.$1.$(basename "$2").log"
    # The failing allocation of one test is meant to fail.
    PALPATE_SHORT_TESTS=1 PALPATE_GPU_PATIENCE=200 compute-sanitizer --tool "$1" --error-exitcode 9 "$2" \
      --gtest_filter='-Memory.*' >"$log" 2>&1 || touch "$build.failed"
    printf '%-10s %-28s %s\n' "$1" "$(basename "$2")" \
      "$(grep 'ERROR SUMMARY\|RACECHECK SUMMARY' "$log" | sed 's/=* //' || echo failed)"
  }
  rm -f "$build.failed"
  for test in "$build"/bin/test_*_cuda "$build"/bin/test_gpu_team; do
    for checker in memcheck racecheck initcheck synccheck; do check "$checker" "$test" & done
    wait
  done
  [ ! -e "$build.failed" ] || status=1
  [ "$status" -eq 0 ] || { echo "gpu_check: compute-sanitizer found errors, see $build.*.log" >&2; exit 1; }
fi

echo "== benchmarks"
commit=$(git rev-parse --short HEAD 2>/dev/null || echo unknown)
machine=$(echo "$gpu" | tr 'A-Z ' 'a-z-')
mkdir -p "$results"
rows="$results/gpu-$machine-$commit.csv"
export PALPATE_COMMIT="$commit"
"$build/bin/gpu_bench" ${quick[@]+"${quick[@]}"} | tee "$rows"
"$build/bin/gpu_batch_bench" ${quick[@]+"${quick[@]}"} | tail -n +2 | tee -a "$rows"
echo "== rows in $rows"
