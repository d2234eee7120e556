// The core as WebAssembly in Chromium: the bits of golden.txt, a force, and one sentence for what is wrong.
//
// usage: node core_test.mjs FOLDER    with golden.wasm and package/, as make web-core builds them
import assert from 'node:assert/strict';
import { existsSync, readFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';

const folder = process.env.PALPATE_WEB_CORE ?? new URL('../../build/web', import.meta.url).pathname;
if (!existsSync(join(folder, 'bin/golden.wasm'))) {
  console.log('SKIPPED: no WebAssembly (make web-core)');
  process.exit(77);
}
const { browser } = await import('../viewer/page/harness.mjs');
const base64 = (file) => readFileSync(join(folder, file)).toString('base64');

test('golden hashes in Chromium are those of the program', async () => {
  const page = await browser.newPage();
  const said = await page.evaluate(async (core) => {
    const module = await WebAssembly.compile(Uint8Array.from(atob(core), (c) => c.charCodeAt(0)));
    let memory, text = '';
    const view = () => new DataView(memory.buffer);
    const known = {
      fd_write: (file, parts, num, written) => {
        let size = 0;
        for (let i = 0; i < num; ++i) {
          const at = view().getUint32(parts + 8 * i, true), length = view().getUint32(parts + 8 * i + 4, true);
          text += new TextDecoder().decode(new Uint8Array(memory.buffer, at, length));
          size += length;
        }
        view().setUint32(written, size, true);
        return 0;
      },
      environ_sizes_get: (a, b) => (view().setUint32(a, 0, true), view().setUint32(b, 0, true), 0),
      environ_get: () => 0,
      proc_exit: () => { throw new Error('ended'); },
    };
    const imports = {};
    for (const { module: from, name } of WebAssembly.Module.imports(module)) (imports[from] ??= {})[name] = known[name] ?? (() => 52);
    const { exports } = await WebAssembly.instantiate(module, imports);
    memory = exports.memory;
    try { exports._start(); } catch (error) { if (error.message !== 'ended') throw error; }
    return text;
  }, base64('bin/golden.wasm'));
  const rows = (text) => text.trim().split('\n').map((line) => line.split(/\s+/).slice(0, 2).join(' '));
  const wanted = rows(readFileSync(new URL('../contact/golden.txt', import.meta.url), 'utf8'));
  assert.ok(wanted.length > 30);
  assert.deepEqual(rows(said), wanted);
  await page.close();
});

test('the package has the notices of what is in it', () => {
  for (const name of ['LICENSE', 'THIRD_PARTY.md']) assert.ok(readFileSync(join(folder, 'package', name), 'utf8').length > 1000);
  assert.ok(JSON.parse(readFileSync(join(folder, 'package/package.json'))).files.includes('THIRD_PARTY.md'));
});

test('the package measures and says what is wrong', async () => {
  const page = await browser.newPage();
  const result = await page.evaluate(async ({ core, code, host }) => {
    const script = (text) => URL.createObjectURL(new Blob([text], { type: 'text/javascript' }));
    const { load } = await import(script(atob(code).replace('./host.js', script(atob(host)))));
    const palpate = await load(Uint8Array.from(atob(core), (c) => c.charCodeAt(0)));
    const sensor = palpate.sensor({ width: 320, height: 240, fx: 288, fy: 288, cx: 159.5, cy: 119.5 });
    sensor.update(new Uint16Array(320 * 240).fill(600));
    const scene = palpate.scene(), tool = palpate.packShape('stylus', 0.12, 'packing.spheres = 1000'), contact = palpate.contact(tool);
    scene.addSensor(sensor);
    const measured = contact.measure(scene, [0, 0, 0.57, 0, 1, 0, 0]);
    const errors = [];
    for (const wrong of [
      () => palpate.packShape('bix', 0.1), () => palpate.packShape('box', 0.1, 'packing.spheres = many'),
      () => palpate.loadTool(new Uint8Array(100)), () => sensor.update(new Uint16Array(5)),
      () => palpate.pack([0, 0, 0, 1, 0, 0, 0, 1, 0], [0, 1, 2]),
    ]) try { wrong(); } catch (error) { errors.push(error.message); }
    return { force: measured.force, volume: measured.volume, errors, version: palpate.version, memory: palpate.memory };
  }, { core: base64('bin/palpate.wasm'), code: base64('package/palpate.js'), host: base64('package/host.js') });
  console.log(JSON.stringify(result, null, 1));
  assert.ok(result.volume > 0 && result.force[2] < 0);
  assert.equal(result.errors.length, 5);
  for (const error of result.errors) assert.match(error, /^[A-Zp].*\.$/);
  await page.close();
});
