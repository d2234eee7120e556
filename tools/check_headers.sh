#!/usr/bin/env bash
# Every public header compiles on its own and stays short enough to read as a table of contents.
# usage: [CXX=g++] tools/check_headers.sh
set -euo pipefail
cd "$(dirname "$0")/.."

export CXX=${CXX:-g++}
max_lines=300

check() {
  local header=$1 included=${1#include/}
  echo "#include \"$included\"" |
    "$CXX" -std=c++20 -fsyntax-only -Wall -Wextra -Wpedantic -Wshadow -Werror -Iinclude -I. -x c++ - ||
    { echo "$header:1: does not compile on its own"; return 1; }
  local lines
  lines=$(wc -l <"$header")
  [ "$lines" -le "$2" ] ||
    { echo "$header:$lines: longer than $2 lines; split it by concept"; return 1; }
}
export -f check

mapfile -t headers < <(find include scenes/scene.h -name '*.h' | sort)
status=0
printf '%s\n' "${headers[@]}" |
  xargs -P "$(nproc)" -I{} bash -c 'check "$1" "$2"' check {} "$max_lines" || status=1
echo "check_headers: ${#headers[@]} headers, $([ "$status" -eq 0 ] && echo 'no problems' || echo 'problems above')"
exit "$status"
