// Builds the page and writes it down as C++: the function page_files() of src/viewer/page_files.h.
// usage: node make_page.mjs FOLDER    writes FOLDER/page_files.cpp and FOLDER/page/
//
// The packages are installed first if package-lock.json asks for others than are there. Where npm
// cannot get them, the program is built without its page, and the next build tries again.
import { spawnSync } from 'node:child_process';
import { mkdirSync, readdirSync, readFileSync, utimesSync, writeFileSync } from 'node:fs';
import { dirname, extname, join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';
import { gzipSync } from 'node:zlib';

const TYPES = {
  '.css': 'text/css; charset=utf-8',
  '.html': 'text/html; charset=utf-8',
  '.js': 'text/javascript; charset=utf-8',
  '.svg': 'image/svg+xml',
};

const web = dirname(fileURLToPath(import.meta.url));

function run(program, ...parameters) {
  return spawnSync(program, parameters, { cwd: web, stdio: 'inherit' }).status === 0;
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
  if (!run('npm', 'ci', '--ignore-scripts', '--loglevel=error')) return false;
  writeFileSync(installed, wanted);
  return true;
}

function bytes(buffer) {
  const lines = [];
  for (let i = 0; i < buffer.length; i += 32) lines.push(`    ${buffer.subarray(i, i + 32).join(',')},`);
  return lines.join('\n');
}

/// `files`: [{name, gzip}].
function cpp(files) {
  const arrays = files.map(
    ({ gzip }, i) => `constexpr unsigned char kFile${i}[] = {\n${bytes(gzip)}\n};\n`,
  );
  const rows = files.map(({ name, gzip }, i) => {
    const path = name === 'index.html' ? '/' : `/${name}`;
    return `    {"${path}", "${TYPES[extname(name)]}", {kFile${i}, ${gzip.length}}},\n`;
  });
  const list = `constexpr PageFile kFiles[] = {\n${rows.join('')}};\n`;
  return `// Made by web/make_page.mjs.
#include "src/viewer/page_files.h"

namespace palpate {
namespace {

${files.length > 0 ? [...arrays, list].join('\n') : ''}
}  // namespace

std::span<const PageFile> page_files() { return ${files.length > 0 ? 'kFiles' : '{}'}; }

}  // namespace palpate
`;
}

const folder = resolve(process.argv[2]);
const source = join(folder, 'page_files.cpp');
mkdirSync(folder, { recursive: true });

if (!install()) {
  console.log(
    'warning: npm could not install what web/package-lock.json names (see its message above): this ' +
      'build has no page for --view. Build again once npm works, or configure with -DPALPATE_PAGE=OFF.',
  );
  writeFileSync(source, cpp([]));
  utimesSync(source, 0, 0); // older than its sources, so that the next build tries again
  process.exit(0);
}

const page = join(folder, 'page');
const vite = join('node_modules', 'vite', 'bin', 'vite.js');
if (!run(process.execPath, vite, 'build', '--outDir', page, '--emptyOutDir', '--logLevel', 'warn')) {
  process.exit(1);
}
const files = readdirSync(page)
  .sort()
  .map((name) => ({ name, gzip: gzipSync(readFileSync(join(page, name)), { level: 9 }) }));
writeFileSync(source, cpp(files));
const size = files.reduce((sum, { gzip }) => sum + gzip.length, 0);
console.log(`page: ${files.length} files, ${Math.round(size / 1024)} KiB compressed`);
