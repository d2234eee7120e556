#!/usr/bin/env bash
# Runs the tests of a build preset and ends with one line of counts.
#
# usage: scripts/test.sh PRESET [MODULE] [ctest options ...]
#   MODULE   only the tests of one module, e.g. contact
set -euo pipefail
cd "$(dirname "$0")/.."

preset=${1:?usage: scripts/test.sh PRESET [MODULE] [ctest options ...]}
shift
folder=build/$preset
case "${1:-}" in
  '' | -*) ;;
  *)
    folder=$folder/tests/$1
    [ -d "$folder" ] || { echo "test: no such module: $1 (or not built: $folder)" >&2; exit 2; }
    shift
    ;;
esac

# For builds with sanitizers: where a fault was, and leaks that are not ours.
export UBSAN_OPTIONS=${UBSAN_OPTIONS:-print_stacktrace=1}
export LSAN_OPTIONS=${LSAN_OPTIONS:-suppressions=$PWD/tests/leaks.txt:print_suppressions=0}

results=$PWD/build/$preset/test-results.xml
rm -f "$results"
status=0
ctest --test-dir "$folder" --output-on-failure --no-tests=error -j "${TEST_JOBS:-$((3 * $(nproc)))}" \
  --output-junit "$results" "$@" || status=$?

# Counts from CTest's own record, so that skipped tests are neither hidden nor taken for passed.
if [ -f "$results" ]; then
  python3 - "$results" <<'PYTHON'
import sys
import xml.etree.ElementTree as ElementTree

suite = ElementTree.parse(sys.argv[1]).getroot()
count = {key: int(suite.get(key, 0)) for key in ("tests", "failures", "skipped", "disabled")}
passed = count["tests"] - count["failures"] - count["skipped"] - count["disabled"]
print(f"{passed} passed, {count['failures']} failed, {count['skipped'] + count['disabled']} skipped")
PYTHON
fi
exit "$status"
