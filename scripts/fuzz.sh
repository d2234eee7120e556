#!/usr/bin/env bash
# Runs the fuzz targets that make fuzz has built, one after the other, and says how many inputs each
# has met. What brings one down stays in build/fuzz/crashes; once fixed, put it into
# tests/fuzz/corpus/NAME, where every later run of the tests meets it.
#
# usage: scripts/fuzz.sh HOURS [TARGET ...]
#   HOURS   for all targets together, e.g. 0.5; 0: a minute each
set -euo pipefail
cd "$(dirname "$0")/.."

hours=${1:-0}
shift || true
targets=("$@")
if [ ${#targets[@]} -eq 0 ]; then
  for program in build/fuzz/bin/fuzz_*; do targets+=("${program##*/fuzz_}"); done
fi
seconds=60
if [ "$hours" != 0 ]; then seconds=$(awk "BEGIN { print int($hours * 3600 / ${#targets[@]}) }"); fi
memory_limit_mb=2048

status=0
mkdir -p build/fuzz/crashes
for target in "${targets[@]}"; do
  corpus=build/fuzz/corpus/$target
  log=build/fuzz/$target.log
  mkdir -p "$corpus" "tests/fuzz/corpus/$target"
  result=held
  if ! PALPATE_FUZZ_SEEDS=$corpus UBSAN_OPTIONS=print_stacktrace=1 \
    LSAN_OPTIONS=suppressions=tests/leaks.txt:print_suppressions=0 \
    "build/fuzz/bin/fuzz_$target" -max_total_time="$seconds" -rss_limit_mb=$memory_limit_mb \
    -timeout=20 -max_len=65536 -print_final_stats=1 -artifact_prefix="build/fuzz/crashes/$target-" \
    "$corpus" "tests/fuzz/corpus/$target" >"$log" 2>&1; then
    result="FAILED, see $log"
    status=1
  fi
  rmdir "tests/fuzz/corpus/$target" 2>/dev/null || true
  executions=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
  printf '%-14s %12s executions  %s\n' "$target" "${executions:-?}" "$result"
done
exit $status
