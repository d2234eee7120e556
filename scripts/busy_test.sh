#!/usr/bin/env bash
# Runs every test that waits for something, in random order, beside a program that keeps two cores busy.
# Ends with a line for each round; its exit status is 1 if a test failed in any of them.
#
# usage: scripts/busy_test.sh PRESET [ROUNDS] [ctest options ...]
set -euo pipefail
cd "$(dirname "$0")/.."

preset=${1:?usage: scripts/busy_test.sh PRESET [ROUNDS] [ctest options ...]}
rounds=${2:-5}
shift $(($# < 2 ? $# : 2))
command -v stress-ng >/dev/null || { echo "busy_test: install the package stress-ng" >&2; exit 2; }

stress-ng --quiet --cpu 2 &
stress=$!
trap 'kill "$stress"' EXIT
status=0
said=()
for ((round = 1; round <= rounds; ++round)); do
  log=build/$preset/busy-$round.log
  begin=$SECONDS
  scripts/test.sh "$preset" -L 'clock|threads' --schedule-random "$@" | tee "$log" || status=1
  said+=("round $round: $(tail -n 1 "$log"), $((SECONDS - begin)) s, load $(cut -d ' ' -f 1 /proc/loadavg)")
done
printf '%s\n' "${said[@]}"
exit "$status"
