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

# All in one process: starting Python for each takes longer than reading them.
mapfile -t other_files < <(python3 tools/project_files.py .py; python3 tools/project_files.py .json)
while read -r text; do problem "$text"; done < <(python3 - "${other_files[@]}" <<'PYTHON'
import ast
import json
import sys

for name in sys.argv[1:]:
    try:
        text = open(name, encoding="utf-8").read()
        ast.parse(text, name) if name.endswith(".py") else json.loads(text)
    except (SyntaxError, ValueError) as error:
        print(f"{name}:1: {'not JSON' if name.endswith('.json') else 'python cannot parse it'}: {error}")
PYTHON
)

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

echo "check_scripts: $((${#shell_files[@]} + ${#other_files[@]} + ${#documents[@]})) files, $problems problems"
[ "$problems" -eq 0 ]
