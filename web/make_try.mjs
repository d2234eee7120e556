// Builds the page without a program as one file, with core, worker and scene inside.
// usage: node make_try.mjs PALPATE_WASM FOLDER    writes FOLDER/try.html
import { spawnSync } from 'node:child_process';
import { mkdirSync, readFileSync, writeFileSync } from 'node:fs';
import { dirname, join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';
import { gzipSync } from 'node:zlib';

const web = dirname(fileURLToPath(import.meta.url));
const [core, folder] = process.argv.slice(2).map((path) => resolve(path));
const read = (...path) => readFileSync(join(...path), 'utf8');

mkdirSync(folder, { recursive: true });
const built = join(folder, 'parts');
const { status } = spawnSync(
  process.execPath, [join('node_modules', 'vite', 'bin', 'vite.js'), 'build', '--mode', 'try', '--outDir', built, '--emptyOutDir', '--logLevel', 'warn'],
  { cwd: web, stdio: 'inherit' });
if (status !== 0) process.exit(1);
const parties = JSON.parse(read(web, '../licenses/third_party.json')).filter(({ how }) => how === 'page' || how === 'web');
const parts = {
  style: read(built, 'try.css').trim(),
  script: read(built, 'try.js').replaceAll('</script', '<\\/script'),
  core: gzipSync(readFileSync(core), { level: 9 }).toString('base64'),
  licenses: [...new Set(parties.map(({ spdx }) => spdx))].map((spdx) => [
    ...parties.filter((party) => party.spdx === spdx).map(({ name, url, copyright }) => `${name} (${url}): copyright ${copyright.join('; ')}`),
    '', read(web, `../licenses/${spdx}.txt`).trim()].join('\n')).join('\n\n\n'),
};
const page = read(web, 'try_template.html').replace(/{{(style|script|core|licenses)}}/g, (_, name) => parts[name]);
writeFileSync(join(folder, 'try.html'), page);
console.log(`try.html: ${Math.round(gzipSync(page, { level: 9 }).length / 1024)} KiB compressed`);
