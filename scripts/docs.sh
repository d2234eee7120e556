#!/usr/bin/env bash
# The documentation as a site in build/docs/site: guides (MkDocs) and the C++ reference (Doxygen).
set -euo pipefail
cd "$(dirname "$0")/.."
out=build/docs
python=$out/python

if [ ! -x $python/bin/mkdocs ]; then
  python3 -m venv $python
  $python/bin/pip -q install mkdocs-material==9.8.1
fi

rm -rf $out/pages $out/doxygen $out/site
mkdir -p $out/pages
cp -r docs/. $out/pages
rm $out/pages/Doxyfile
# README is the first page; what lies beside the documentation is named, not linked.
sed -E 's#\]\(docs/#](#g' README.md >$out/pages/index.md
find $out/pages -name '*.md' -exec sed -i -E 's#\[([^]]*)\]\((\.\./)*(bench/|scripts/|LICENSE|CHANGELOG|CONTRIBUTING|THIRD_PARTY|CITATION|include/|examples|web/|tests/|eval/)[^)]*\)#\1#g' {} +
cat >$out/pages/api.md <<'END'
# C++ library

[Every class and function](doxygen/html/index.html){target=_blank} of the public headers. Start with
`palpate/palpate.h`: `load_tool`, `Sensor`, `Contact`. All functions are on the page of the
[namespace](doxygen/html/namespacepalpate.html){target=_blank}.
END
mkdir -p $out/doxygen
doxygen docs/Doxyfile
# Functions stand on the page of their namespace; it has been missing once, and nobody saw it.
grep -q load_tool $out/doxygen/html/namespacepalpate.html
NO_MKDOCS_2_WARNING=1 $python/bin/mkdocs build --quiet --config-file mkdocs.yml
cp -r $out/doxygen $out/site/
echo "docs: open $PWD/$out/site/index.html"
