#!/usr/bin/env bash
# Is the source text laid out as .clang-format says? Versions of clang-format differ in small things,
# so only version 14 decides. usage: tools/check_format.sh [--fix]
set -euo pipefail
cd "$(dirname "$0")/.."

formatter=
for candidate in clang-format-14 clang-format; do
  if command -v "$candidate" >/dev/null && "$candidate" --version | grep -q 'version 14\.'; then
    formatter=$candidate
    break
  fi
done

if [ -z "$formatter" ]; then
  found=$(clang-format --version 2>/dev/null || echo "none")
  if [ "${1:-}" = --fix ]; then
    echo "check_format: needs clang-format 14 (found: $found); install the package clang-format-14" >&2
    exit 1
  fi
  echo "check_format: skipped, needs clang-format 14 (found: $found)"
  exit 0
fi

mapfile -t files < <(python3 tools/project_files.py .h .cpp .cu .cuh)
if [ "${1:-}" = --fix ]; then
  "$formatter" -i "${files[@]}"
  echo "check_format: ${#files[@]} files laid out"
  exit 0
fi

differing=0
for file in "${files[@]}"; do
  # Line numbers are those of the file as it is.
  line=$(diff "$file" <("$formatter" "$file") | sed -nE '1s/^([0-9]+).*/\1/p' || true)
  if [ -n "$line" ]; then
    echo "$file:$line: not laid out as .clang-format says; run 'make format'"
    differing=$((differing + 1))
  fi
done
echo "check_format: ${#files[@]} files, $differing problems"
[ "$differing" -eq 0 ]
