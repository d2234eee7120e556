// Builds the pages and writes them down as C++: the functions of src/pages/internal/pages.h.
// usage: node make_page.mjs FOLDER [NPM]    writes FOLDER/page_files.cpp, FOLDER/page/ and FOLDER/report/
//
// The packages are installed first if package-lock.json asks for others than are there. Where npm
// cannot get them, the program is built without its pages, and the next build tries again.
import { spawnSync } from 'node:child_process';
import { mkdirSync, readdirSync, readFileSync, utimesSync, writeFileSync } from 'node:fs';
import { delimiter, dirname, extname, join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';
import { gzipSync } from 'node:zlib';

const TYPES = {
  '.css': 'text/css; charset=utf-8',
  '.html': 'text/html; charset=utf-8',
  '.js': 'text/javascript; charset=utf-8',
  '.svg': 'image/svg+xml',
};

const web = dirname(fileURLToPath(import.meta.url));
const npm = process.argv[3] ?? 'npm';

function run(program, ...parameters) {
  // npm is a script for whatever node is in the path: for this one.
  const env = { ...process.env, PATH: `${dirname(process.execPath)}${delimiter}${process.env.PATH}` };
  return spawnSync(program, parameters, { cwd: web, env, stdio: 'inherit' }).status === 0;
}

function read(file) {
  try {
    return readFileSync(file, 'utf8');
  } catch {
    return '';
  }
}

/// npm ci, unless the packages are those of the lock file already.
function install() {
  const wanted = read(join(web, 'package-lock.json'));
  const installed = join(web, 'node_modules', '.installed-lock.json');
  if (read(installed) === wanted) return true;
  if (!run(npm, 'ci', '--ignore-scripts', '--loglevel=error')) return false;
  writeFileSync(installed, wanted);
  return true;
}

function bytes(buffer) {
  const lines = [];
  for (let i = 0; i < buffer.length; i += 32) lines.push(`    ${buffer.subarray(i, i + 32).join(',')},`);
  return lines.join('\n');
}

/// All reports: report_template.html with style, licenses and script, which is compressed: so a report of a
/// few seconds is smaller than a photograph.
function reportTemplate(folder) {
  const parts = {
    style: read(join(folder, 'report.css')).trim(),
    script: gzipSync(readFileSync(join(folder, 'report.js')), { level: 9 }).toString('base64'),
    licenses: ['three', 'uplot'].map((name) => `${name}: ${read(join(web, 'node_modules', name, 'LICENSE')).trim()}`)
      .join('\n\n').replaceAll('--', '-'),
  };
  return read(join(web, 'report_template.html')).replace(/{{(style|script|licenses)}}/g, (_, name) => parts[name]);
}

/// `files`: [{name, gzip}]; `report`: the template, empty without pages.
function cpp(files, report) {
  const arrays = files.map(
    ({ gzip }, i) => `constexpr unsigned char kFile${i}[] = {\n${bytes(gzip)}\n};\n`,
  );
  const rows = files.map(({ name, gzip }, i) => {
    const path = name === 'index.html' ? '/' : `/${name}`;
    return `    {"${path}", "${TYPES[extname(name)]}", {kFile${i}, ${gzip.length}}},\n`;
  });
  if (files.length > 0) {
    arrays.push(`constexpr PageFile kFiles[] = {\n${rows.join('')}};\n`);
    // ASCII, so that every number fits a char.
    const ascii = Buffer.from(report.replace(/[^\0-\x7f]/g, (c) => `&#${c.codePointAt(0)};`));
    arrays.push(`constexpr char kReport[] = {\n${bytes(ascii)}\n};\n`);
  }
  return `// Made by web/make_page.mjs.
#include "src/pages/internal/pages.h"

namespace palpate { inline namespace v0 {
namespace {

${arrays.join('\n')}
}  // namespace

std::span<const PageFile> page_files() { return ${files.length > 0 ? 'kFiles' : '{}'}; }
std::string_view report_template() { return ${files.length > 0 ? '{kReport, sizeof kReport}' : '{}'}; }

}}  // namespace palpate::v0
`;
}

const folder = resolve(process.argv[2]);
const source = join(folder, 'page_files.cpp');
mkdirSync(folder, { recursive: true });

if (!install()) {
  console.log(
    'warning: npm could not install what web/package-lock.json names (see its message above): this ' +
      'build has no page for --view and writes no reports. Build again once npm works, or configure ' +
      'with -DPALPATE_PAGE=OFF.',
  );
  writeFileSync(source, cpp([], ''));
  utimesSync(source, 0, 0); // older than its sources, so that the next build tries again
  process.exit(0);
}

/// Returns the folder.
function build(name) {
  const page = join(folder, name);
  const vite = join('node_modules', 'vite', 'bin', 'vite.js');
  const options = ['--mode', name, '--outDir', page, '--emptyOutDir', '--logLevel', 'warn'];
  if (!run(process.execPath, vite, 'build', ...options)) process.exit(1);
  return page;
}

const page = build('page');
const files = readdirSync(page)
  .sort()
  .map((name) => ({ name, gzip: gzipSync(readFileSync(join(page, name)), { level: 9 }) }));
const report = reportTemplate(build('report'));
writeFileSync(source, cpp(files, report));
const size = files.reduce((sum, { gzip }) => sum + gzip.length, 0);
console.log(`page: ${files.length} files, ${Math.round(size / 1024)} KiB compressed; ` +
  `report: ${Math.round(report.length / 1024)} KiB beside its data`);
