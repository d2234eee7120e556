#!/usr/bin/env bash
# Tries things in a fresh Debian 12 that exists for this only. Needs mmdebstrap, and root or user namespaces.
#
# usage: scripts/try_fresh.sh packages   installs those of build/packages, feels the simulated hand with the
#                                        program, builds and runs the examples with the library and the archive
#        scripts/try_fresh.sh demo       make demo from a copy of the sources, each line with its second
#        scripts/try_fresh.sh test       the same with make test
set -euo pipefail
cd "$(dirname "$0")/.."
what=${1:?usage: scripts/try_fresh.sh packages|demo|test}

inside=$(mktemp -d)
trap 'rm -rf "$inside"' EXIT

case "$what" in
  packages)
    cp build/packages/packages/*.deb build/packages/packages/*.tar.gz "$inside"
    cat >"$inside/try.sh" <<'INSIDE'
set -eu
export DEBIAN_FRONTEND=noninteractive HOME=/tmp
cd /try
say() { printf '\n== %s s: %s\n' "$(($(date +%s) - begin))" "$*"; }
begin=$(date +%s)

say "apt-get install palpate"
apt-get -q install -y --no-install-recommends ./palpate_*.deb >install.log 2>&1 || { tail install.log; exit 1; }
say "a stylus"
palpate shape stylus --size 0.12 -o stylus.stl
palpate pack stylus.stl -o stylus.palp
say "the stylus feels a hand"
palpate touch stylus.palp --scene hand -o hand
test -s hand/report.html
say "the first report is there"
palpate --licenses | grep -q three.js
test -s /usr/share/man/man1/palpate-touch.1.gz || echo "(this root keeps no manual pages)"

begin=$(date +%s)
say "apt-get install libpalpate-dev, a compiler and CMake"
apt-get -q install -y --no-install-recommends ./libpalpate*.deb g++ make cmake >>install.log 2>&1 || { tail install.log; exit 1; }
say "the examples, against the shared library"
cp -r /usr/share/doc/libpalpate-dev/examples .
cmake -S examples -B built >/dev/null
cmake --build built
ctest --test-dir built --output-on-failure
if objdump -T built/0* | grep PALPATE_PRIVATE; then echo "the examples need what is private (decision 37)"; exit 1; fi

say "the same from the archive, wherever it is unpacked"
apt-get -q purge -y libpalpate0.1 libpalpate-dev palpate >>install.log 2>&1
mkdir elsewhere
tar -C elsewhere --strip-components=1 -xf palpate-*.tar.gz
elsewhere/bin/palpate info stylus.palp >/dev/null
cmake -S examples -B built2 -DCMAKE_PREFIX_PATH=/try/elsewhere >/dev/null
cmake --build built2
ctest --test-dir built2 --output-on-failure
say "done"
INSIDE
    ;;
  demo | test)
    python3 tools/project_files.py | tar -cf "$inside/sources.tar" -T -
    echo "$what" >"$inside/what"
    # pip and npm use the registries and certificates of this machine: it may have its own.
    settings=()
    for file in /etc/pip.conf "$HOME/.config/pip/pip.conf" "$HOME/.npmrc" /etc/ssl/certs/ca-certificates.crt \
      /usr/local/share/ca-certificates; do
      [ ! -e "$file" ] || settings+=("$file")
    done
    tar -cPf "$inside/settings.tar" -T /dev/null "${settings[@]}"
    cat >"$inside/try.sh" <<'INSIDE'
set -eu
cd /try
tar -C / -xPf settings.tar
mkdir project
cd project
tar -xf ../sources.tar
apt-get -q install -y --no-install-recommends make >../install.log 2>&1 || { tail ../install.log; exit 1; }
exec bash -c 'set -o pipefail
  make "$1" 2>&1 | while IFS= read -r line; do printf "%4d s  %s\n" "$SECONDS" "$line"; done' bash "$(cat ../what)"
INSIDE
    ;;
  *)
    echo "try_fresh: there is nothing called $what" >&2
    exit 2
    ;;
esac

# shellcheck disable=SC2016
mmdebstrap --quiet --variant=apt --aptopt='Apt::Install-Recommends "false"' \
  --customize-hook="mkdir -p \"\$1/try\" && cp $inside/* \"\$1/try\"" \
  --customize-hook='chroot "$1" sh /try/try.sh' \
  bookworm /dev/null $(ls /etc/apt/sources.list.d/debian.sources 2>/dev/null || true)
echo "try_fresh: $what: all went well in a fresh Debian 12"
