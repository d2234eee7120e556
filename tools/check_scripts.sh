#!/usr/bin/env bash
# Scripts at least parse, can be run, and stop at the first error. usage: tools/check_scripts.sh
set -euo pipefail
cd "$(dirname "$0")/.."

problems=0
problem() {
  echo "$1"
  problems=$((problems + 1))
}

mapfile -t shell_files < <(python3 tools/project_files.py .sh; echo .ci/run)
for file in "${shell_files[@]}"; do
  bash -n "$file" || problem "$file:1: bash cannot parse it"
  [ -x "$file" ] || problem "$file:1: not executable (chmod +x)"
  grep -q '^set -euo pipefail$' "$file" || problem "$file:1: has no 'set -euo pipefail'"
done

mapfile -t python_files < <(python3 tools/project_files.py .py)
for file in "${python_files[@]}"; do
  python3 -c 'import ast, sys; ast.parse(open(sys.argv[1]).read(), sys.argv[1])' "$file" ||
    problem "$file:1: python cannot parse it"
done

mapfile -t json_files < <(python3 tools/project_files.py .json)
for file in "${json_files[@]}"; do
  python3 -m json.tool "$file" >/dev/null || problem "$file:1: not JSON"
done

# Targets of the Makefile are names: one that a folder has, too, would be up to date for ever.
for target in $(grep -oE '^[a-z0-9 -]+:' Makefile | tr -d :); do
  grep -qE "^\.PHONY:.* $target( |\$)" Makefile || problem "Makefile:1: $target is not in .PHONY"
done

# A link in the documentation, outside of its code, leads to a file that is there.
mapfile -t documents < <(python3 tools/project_files.py .md)
for file in "${documents[@]}"; do
  while IFS=: read -r number target; do
    [ -e "$(dirname "$file")/${target%%#*}" ] || problem "$file:$number: broken link to $target"
  done < <(awk '/^```/ { is_code = !is_code } { print is_code ? "" : $0 }' "$file" |
    grep -noE '\]\([^)#][^)]*\)' | sed -E 's/\]\((.*)\)$/\1/' | grep -vE '^[0-9]+:(https?|mailto):' || true)
done

echo "check_scripts: $((${#shell_files[@]} + ${#python_files[@]} + ${#json_files[@]} + ${#documents[@]})) files, $problems problems"
[ "$problems" -eq 0 ]
