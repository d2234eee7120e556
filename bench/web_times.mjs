// The core in Chromium for bench/web_times.py. Its first line has the mesh to be packed; each other line of its input, a name and a
// number of calls, is answered with the seconds of processor that these calls took in the page's thread.
import { readFileSync } from 'node:fs';
import { createInterface } from 'node:readline';
import { join } from 'node:path';

const folder = process.argv[2];
const { browser } = await import('../tests/viewer/page/harness.mjs');
const page = await browser.newPage();
const base64 = (file) => readFileSync(join(folder, file)).toString('base64');

const lines = createInterface({ input: process.stdin })[Symbol.asyncIterator]();
const mesh = JSON.parse((await lines.next()).value);

await page.evaluate(async ({ core, code, mesh }) => {
  const { load } = await import(URL.createObjectURL(new Blob([atob(code)], { type: 'text/javascript' })));
  const palpate = await load(Uint8Array.from(atob(core), (c) => c.charCodeAt(0)));
  const sensor = palpate.sensor({ width: 320, height: 240, fx: 288, fy: 288, cx: 159.5, cy: 119.5 });
  const image = new Uint16Array(320 * 240).fill(600), scene = palpate.scene();
  sensor.update(image);
  scene.addSensor(sensor);
  const vertices = Float64Array.from(mesh.vertices), triangles = Uint32Array.from(mesh.triangles);
  window.work = { frame: () => sensor.update(image), packing: () => palpate.pack(vertices, triangles, 'packing.spheres = 1000').free() };
  for (const spheres of [1000, 5000]) {
    const contact = palpate.contact(palpate.packShape('stylus', 0.12, `packing.spheres = ${spheres}`));
    window.work[`query of ${spheres}`] = () => contact.measure(scene, [0, 0, 0.57, 0, 1, 0, 0]);
  }
}, { core: base64('bin/palpate.wasm'), code: base64('package/palpate.js'), mesh });

// The renderer that has worked most is the page's; its first thread computes.
const session = await browser.newBrowserCDPSession();
const { processInfo } = await session.send('SystemInfo.getProcessInfo');
const { id } = processInfo.filter(({ type }) => type === 'renderer').sort((a, b) => b.cpuTime - a.cpuTime)[0];
const seconds = () => Number(readFileSync(`/proc/${id}/schedstat`, 'utf8').split(' ')[0]) / 1e9;

for await (const line of lines) {
  const [, name, calls] = line.match(/^(.*) (\d+)$/);
  const begin = seconds();
  await page.evaluate(({ name, calls }) => { for (let i = 0; i < calls; ++i) window.work[name](); }, { name, calls: Number(calls) });
  console.log(`seconds ${seconds() - begin}`);
}
await browser.close();
