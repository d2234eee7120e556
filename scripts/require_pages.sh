#!/usr/bin/env bash
# Fails if a build could not make its pages: what is handed to others has its viewer and its reports.
# A build that was told to have none (-DPALPATE_PAGE=OFF) passes.
#
# usage: scripts/require_pages.sh FOLDER_OF_A_BUILD
set -euo pipefail

build=${1:?usage: scripts/require_pages.sh FOLDER_OF_A_BUILD}
if grep -q '^PALPATE_PAGE:BOOL=OFF' "$build/CMakeCache.txt"; then exit 0; fi
grep -qs kReport "$build/src/pages/page_files.cpp" || {
  echo "require_pages: $build has no pages, because npm or node failed (see the warning above); build again once they work" >&2
  exit 1
}
