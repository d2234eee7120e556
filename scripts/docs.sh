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
# README is the first page. The examples with their sources are a page, too; what else lies beside the
# documentation is named, not linked.
sed -E 's#\]\(docs/#](#g' README.md >$out/pages/index.md
sed -E 's#\]\(([0-9a-z_]+)\.(cpp|py)\)#](\#\1\2)#g; s#\]\(\.\./docs/#](#g' examples/README.md >$out/pages/examples.md
for source in examples/*.cpp examples/*.py; do
  printf '\n## %s\n\n```%s\n%s\n```\n' "$(basename $source)" "${source##*.}" "$(cat $source)"
done >>$out/pages/examples.md
sed -E 's#\]\(docs/#](#g' CHANGELOG.md >$out/pages/changelog.md
find $out/pages/guide $out/pages/reference -name '*.md' -exec sed -i -E \
  's#\]\(\.\./\.\./examples/README\.md\)#](../examples.md)#g; s#\]\(\.\./\.\./examples/([0-9a-z_]+)\.(cpp|py)\)#](../examples.md\#\1\2)#g' {} +
{
  printf '# Decisions\n\nWhy things are as they are, one page for each.\n\n'
  for page in $out/pages/decisions/*.md; do
    sed -nE "1s#^\# (.*)#* [\1]($(basename "$page"))#p" "$page"
  done
} >$out/decisions.md
mv $out/decisions.md $out/pages/decisions/index.md
sed -i -E 's#\[C\+\+ reference\]\([^)]*\)#[C++ reference](../api.md)#' $out/pages/guide/paths.md
sed -i -E 's#\]\(decisions\)#](decisions/index.md)#g; s#\]\(examples\)#](examples.md)#g; s#\]\(CHANGELOG\.md\)#](changelog.md)#g' $out/pages/index.md $out/pages/changelog.md
find $out/pages -name '*.md' -exec sed -i -E 's#\[([^]]*)\]\((\.\./)*(bench/|src/|scripts/|LICENSE|CONTRIBUTING|THIRD_PARTY|CITATION|include/|examples/|web/|tests/|eval/)[^)]*\)#\1#g' {} +
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
# The page that needs no program, where make web-core has made it.
if [ -f build/web/try/try.html ]; then
  mkdir -p $out/pages/try
  cp build/web/try/try.html $out/pages/try/index.html
  # Below the first paragraph.
  sed -i '0,/^!\[/s##[**Try it now**: touch a depth image in this browser, nothing to install](try/index.html){.md-button .md-button--primary}\n\n![#' $out/pages/index.md
  # Below a picture, what is in it can be felt: <!-- feel: settings of the page's address -->
  sed -i -E 's#^<!-- feel: (.*) -->$#[Feel this in your browser](try/index.html?\1)#' $out/pages/*.md
  sed -i -E 's#^<!-- feel: (.*) -->$#[Feel this in your browser](../try/index.html?\1)#' $out/pages/guide/*.md
else
  echo "docs: without the page Try it; make web-core makes it"
fi
if [ -f demo/hand/report.html ]; then
  mkdir -p $out/pages/report
  cp demo/hand/report.html $out/pages/report/index.html
  sed -i '0,/^## /s##[**A report**: what a pen met on a hand, to turn and zoom](report/index.html){.md-button}\n\n## #' $out/pages/index.md
else
  echo "docs: without the report of the demo; make demo makes it"
fi
NO_MKDOCS_2_WARNING=1 $python/bin/mkdocs build --quiet --config-file mkdocs.yml
cp -r $out/doxygen $out/site/
echo "docs: open $PWD/$out/site/index.html"
