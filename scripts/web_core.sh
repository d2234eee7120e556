#!/usr/bin/env bash
# The package for npm and the page without a program, of a build of the preset web; then the tests of all.
# usage: scripts/web_core.sh BUILD
set -euo pipefail
cd "$(dirname "$0")/.."
build=$1
export PATH="$PWD/build/node/bin:$PATH"
if ! command -v npm >/dev/null; then
  echo "web-core: SKIPPED package and page: no npm (make setup installs it); $build/bin/palpate.wasm is built"
  exit 0
fi
[ -d web/node_modules ] || (cd web && npm ci --ignore-scripts --loglevel=error)
package=$build/package
rm -rf "$package"
mkdir -p "$package"
node web/node_modules/typescript/bin/tsc --target ES2022 --module ESNext --moduleResolution bundler --lib ES2022,DOM --strict --declaration \
  --outDir "$package" web/core/palpate.ts
cp web/core/package.json LICENSE THIRD_PARTY.md "$build/bin/palpate.wasm" "$package"
node web/make_try.mjs "$build/bin/palpate.wasm" "$build/try"
failed=0
python=build/python-web/bin/python
[ -x $python ] || python=python3
for test in "$python tests/web/wasmtime_test.py $build/bin" "node tests/web/core_test.mjs" "node tests/web/try_test.mjs" "node tests/web/object_test.mjs" "node tests/web/headset_test.mjs"; do
  status=0
  PALPATE_WEB_CORE="$PWD/$build" $test || status=$?
  [ $status -eq 0 ] || [ $status -eq 77 ] || failed=1
done
exit $failed
