#!/usr/bin/env bash
# All checks that need no build; every one runs, so that all problems are seen at once.
# usage: tools/lint.sh
set -euo pipefail
cd "$(dirname "$0")/.."

outputs=$(mktemp -d)
trap 'rm -rf "$outputs"' EXIT
names=() jobs=()
run() {  # together with all others
  "$@" >"$outputs/${#names[@]}" 2>&1 &
  names+=("$*") jobs+=($!)
}

run tools/check_headers.sh
run tools/check_format.sh
run tools/check_scripts.sh
run python3 -m unittest discover -q -s tools -p '*_test.py'
run python3 tools/check_modules.py
run python3 tools/check_types.py
run python3 tools/check_words.py
run python3 tools/check_docs.py
run python3 bench/peer_tables.py --check

failed=()
for i in "${!names[@]}"; do
  wait "${jobs[$i]}" || failed+=("${names[$i]}")
  cat "$outputs/$i"
done
if [ ${#failed[@]} -gt 0 ]; then
  printf 'lint: failed: %s\n' "${failed[@]}"
  exit 1
fi
echo "lint: all checks passed"
