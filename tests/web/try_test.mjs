// The page without a program, as one file from the disk: a held pen pushes into the hand and is pushed back; what readers give it.
//
// Environment: that of try_page.mjs; PALPATE_TRY_SECONDS, how long ticks are counted (3); PALPATE_TRY_FIRST, for root: the browser is
// scheduled before other work of the computer while they are.
import assert from 'node:assert/strict';
import { readdirSync, readFileSync, writeFileSync } from 'node:fs';
import { test } from 'node:test';
import { gzipSync } from 'node:zlib';

const { box, browser, corner, ellipsoid, faces, file, give, launchWith, line, open, picture, png } = await import('./try_page.mjs');
const seconds = Number(process.env.PALPATE_TRY_SECONDS ?? 3);

/// Holds the tool and moves it by `way` (m, W), by the messages that a pointer sends.
async function push(page, way, steps = 40) {
  return page.evaluate(async ({ way, steps }) => {
    const { palpate } = window, pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
    const at = () => ['x', 'y', 'z', 'qx', 'qy', 'qz', 'qw'].map((name) => palpate.sample[`hand_${name}`]);
    const start = at(), goal = start.map((n, k) => n + (k < 3 ? way[k] : 0)), isThere = () => palpate.sample.hand_z - start[2] > 0.9 * way[2];
    let most = 0, base = start, begin = -1;
    // On a busy computer the run is slower than the clock, and loses a page that is late: the hand is led until it is there.
    for (let i = 0; i <= steps + 20 || (i < 1500 && !(isThere() && palpate.state.force === 'engaged')); ++i) {
      if (begin < 0 || palpate.state.handle === 'free') {
        await palpate.command({ command: 'hold' });
        [base, begin] = [at(), i];
      }
      const share = Math.min(1, (i - begin) / steps);
      palpate.tell({ hand: base.map((n, k) => n + share * (goal[k] - n)) });
      await pause(30);
      most = Math.max(most, Math.hypot(palpate.sample.force_x, palpate.sample.force_y, palpate.sample.force_z));
    }
    const { force, ticks } = palpate.state;
    return { most, force, ticks, volume: palpate.sample.volume, z: palpate.sample.tool_z - start[2], hand: palpate.sample.hand_z - start[2] };
  }, { way, steps });
}

async function drop(page, name, buffer) {
  await page.evaluate(([name, text]) => {
    const dataTransfer = new DataTransfer();
    dataTransfer.items.add(new File([Uint8Array.from(atob(text), (c) => c.charCodeAt(0))], name));
    dispatchEvent(new DragEvent('drop', { dataTransfer, cancelable: true }));
  }, [name, buffer.toString('base64')]);
}
const volumeIs = (page, volume) =>
  page.waitForFunction((v) => Math.abs(window.palpate.hello.tool.volume / v - 1) < 1e-5, volume, { timeout: 120000 });

/// A closed box of `size` m as glTF with its vertices at an address, by default inside, and a texture elsewhere.
function gltf(size, uri = `data:application/octet-stream;base64,${Buffer.from(new Float32Array(faces.flatMap((i) => corner(i, size))).buffer).toString('base64')}`) {
  const byteLength = 12 * faces.length;
  return Buffer.from(JSON.stringify({
    asset: { version: '2.0' }, scene: 0, scenes: [{ nodes: [0] }], nodes: [{ mesh: 0 }],
    meshes: [{ primitives: [{ attributes: { POSITION: 0 }, material: 0 }] }],
    accessors: [{ bufferView: 0, componentType: 5126, count: faces.length, type: 'VEC3', min: [0, 0, 0], max: [size, size, size] }],
    bufferViews: [{ buffer: 0, byteLength }], buffers: [{ uri, byteLength }],
    materials: [{ pbrMetallicRoughness: { baseColorTexture: { index: 0 } } }], textures: [{ source: 0 }], images: [{ uri: 'http://127.0.0.1:9/wood.png' }],
  }));
}

/// A box with edges of 1 m in a GLB whose node turns and scales it.
function glb(scale) {
  const corners = Buffer.from(new Float32Array(faces.flatMap((i) => corner(i, 1))).buffer), { nodes, materials, textures, images, ...rest } = JSON.parse(gltf(1, ''));
  const content = { ...rest, nodes: [{ mesh: 0, rotation: [0, 0.6, 0, 0.8], translation: [1, 2, 3], scale: [scale, scale, scale] }], buffers: [{ byteLength: corners.length }] };
  delete content.meshes[0].primitives[0].material;
  const text = JSON.stringify(content), json = Buffer.from(text.padEnd(4 * Math.ceil(text.length / 4)));
  const numbers = (...values) => Buffer.from(new Uint32Array(values).buffer);
  return Buffer.concat([numbers(0x46546c67, 2, 28 + json.length + corners.length), numbers(json.length, 0x4e4f534a), json, numbers(corners.length, 0x4e4942), corners]);
}

test('a held pen pushes into the hand and is pushed back; letting go ends the force', async () => {
  const { page, context, requests, errors } = await open({ viewport: { width: 1280, height: 800 } });
  await picture(page, 'desktop');
  const free = await page.evaluate(() => window.palpate.sample.force_z);
  assert.equal(Math.abs(free), 0);
  const felt = await push(page, [0, 0, 0.14]);
  console.log(JSON.stringify(felt));
  await picture(page, 'desktop-touching');
  assert.equal(felt.force, 'engaged');
  assert.ok(felt.most > 0.5 && felt.most <= 10.001, `${felt.most} N`);
  assert.ok(felt.z < felt.hand - 0.001, 'the tool stays behind the hand');
  await page.evaluate(() => window.palpate.command({ command: 'release' }));
  await page.waitForFunction(() => Math.abs(window.palpate.sample.force_z) < 1e-6, null, { timeout: 10000 });
  assert.deepEqual(requests, []);
  assert.deepEqual(errors, []);
  await context.close();
});

test('a hidden tab fades the force', async () => {
  const { page, context } = await open();
  await push(page, [0, 0, 0.14]);
  await page.evaluate(() => {
    Object.defineProperty(document, 'hidden', { value: true });
    document.dispatchEvent(new Event('visibilitychange'));
  });
  await page.waitForFunction(() => window.palpate.state.handle === 'free' && // no pose arrives any more
    Math.hypot(window.palpate.sample.force_x, window.palpate.sample.force_y, window.palpate.sample.force_z) < 1e-6, null, { timeout: 30000 });
  await context.close();
});

/// Seconds of processor and of waiting for one that the page's workers have taken, where the system counts them.
async function workerSeconds() {
  const session = await browser.newBrowserCDPSession(), { processInfo } = await session.send('SystemInfo.getProcessInfo');
  const sums = [0, 0];
  for (const { id } of processInfo.filter(({ type }) => type === 'renderer'))
    for (const thread of readdirSync(`/proc/${id}/task`)) {
      const at = `/proc/${id}/task/${thread}/`;
      try {
        if (!/^DedicatedWorker/.test(readFileSync(`${at}comm`, 'utf8'))) continue;
        readFileSync(`${at}schedstat`, 'utf8').split(' ').slice(0, 2).forEach((ns, i) => { sums[i] += ns / 1e9; });
      } catch { /* the thread has just ended, or the system does not count */ }
    }
  return sums;
}

test('ticks at 1 kHz', async () => {
  const { page, context } = await open();
  if (process.env.PALPATE_TRY_FIRST) {
    const { processInfo } = await (await browser.newBrowserCDPSession()).send('SystemInfo.getProcessInfo');
    for (const { id } of processInfo) writeFileSync(`/proc/${id}/autogroup`, '-19');
    await page.waitForTimeout(3000);
  }
  const state = () => page.evaluate(() => window.palpate.state);
  const [before, worked] = [await state(), await workerSeconds()];
  await page.waitForTimeout(1000 * seconds);
  const [after, works] = [await state(), await workerSeconds()];
  const ticks = after.ticks - before.ticks, missed = after.missed - before.missed, [used, waited] = works.map((s, i) => s - worked[i]);
  console.log(JSON.stringify({
    ticks, missed, computed: ticks / (ticks + missed), late: (after.late - before.late) / ticks, longest_delay_ms: after.longest_delay, query_ms: after.query_ms,
    processor_us_per_tick: 1e6 * used / ticks, waited_seconds: waited,
  }));
  assert.ok(ticks > 0);
  await context.close();
});

test('the reader\'s own files, and one sentence for each that is wrong', async () => {
  const { page, context, requests } = await open();
  for (const [name, buffer, words] of [
    ['photo.png', png(64, 48, 8, 0), /8 bits per pixel.*16/],
    ['text.png', Buffer.from('no image at all, and longer than thirty-three bytes'), /no PNG/],
    ['cut.png', png(64, 48, 16, 500).subarray(0, 60), /damaged or truncated/],
    ['filter.png', png(64, 48, 16, 500, 5), /damaged or truncated/],
    ['far.gltf', gltf(0.05, 'http://127.0.0.1:9/box.bin'), /refers to another file/],
    ['tool.step', Buffer.from('x'), /neither a mesh nor a depth image/],
    ['open.stl', box(0.05, false), /does not bound a solid.*open edges.*first at/],
    ['bad.palp', Buffer.from('nothing'), /tool file/],
  ]) {
    await give(page, name, buffer);
    await page.waitForFunction((source) => new RegExp(source).test(document.querySelector('.try-line').textContent), words.source, { timeout: 20000 })
      .catch(async () => assert.match(await line(page), words));
    assert.match(await line(page), /^[^\n]+[.!]$/);
  }
  await give(page, 'cube.gltf', gltf(0.04));
  await volumeIs(page, 0.04 ** 3);
  await drop(page, 'cube.glb', glb(0.03));
  await page.getByRole('button', { name: 'the tool', exact: true }).click();
  await volumeIs(page, 0.03 ** 3);
  await give(page, 'cube.stl', box(50)); // mm
  await page.waitForFunction(() => window.palpate.hello.tool.spheres === 1000 && Math.abs(window.palpate.hello.tool.volume - 1.25e-4) < 1e-9, null, { timeout: 120000 });
  await give(page, 'wall.png', png(160, 120, 16, 600));
  await page.waitForFunction(() => window.palpate.hello.streams[0].width === 160, null, { timeout: 20000 });
  await page.waitForFunction(() => window.palpate.sample && window.palpate.counters.contacts > 1);
  const felt = await push(page, [0, 0, 0.2]);
  console.log(JSON.stringify(felt));
  assert.ok(felt.most > 0.5, `${felt.most} N of a wall`);
  await page.evaluate(() => window.palpate.command({ command: 'set', key: 'contact.method', value: 'graph' }));
  assert.equal(await page.evaluate(async () => (await window.palpate.command({ command: 'set', key: 'contact.method', value: 'feel' })).ok), false);
  const after = await push(page, [0, 0, 0.05]);
  assert.ok(after.most > 0.5 && after.volume > 0, `${after.most} N after a method was refused`);
  assert.deepEqual(requests, []);
  await context.close();
});

test('damaged images and meshes: what they show, or one sentence', async () => {
  const { page, context } = await open();
  const { taken, refused } = await page.evaluate(async (seeds) => {
    let state = 20, taken = 0, refused = 0;
    const below = (n) => (state = (Math.imul(state, 1664525) + 1013904223) >>> 0) % n;
    for (let i = 0; i < 1500; ++i) {
      const bytes = Array.from(atob(seeds[i % seeds.length]), (c) => c.charCodeAt(0));
      for (let changes = 1 + below(4); changes > 0; --changes) {
        const at = below(bytes.length);
        [() => { bytes[at] = below(256); }, () => bytes.splice(at, 1 + below(9)), () => bytes.splice(at, 0, ...bytes.slice(0, below(40))),
          () => { bytes.length = at; }, () => { bytes[at] ^= 1 << below(8); }, () => bytes.splice(at, 4, 127, 255, 255, 255)][below(6)]();
        if (bytes.length === 0) break;
      }
      try {
        const image = await window.palpate.readPng('image.png', Uint8Array.from(bytes));
        if (image.counts.length !== image.width * image.height) throw new Error('pixels are missing');
        ++taken;
      } catch (error) {
        if (!/^image\.png [^\n]+\.$/.test(error.message)) throw error;
        ++refused;
      }
    }
    return { taken, refused };
  }, [png(16, 9, 16, 500), png(16, 9, 16, 60000, 4), png(16, 9, 16, 500, 2)].map((image) => image.toString('base64')));
  console.log(`${taken} images taken, ${refused} refused`);
  assert.ok(taken > 50 && refused > 500);
  const corpus = new URL('../fuzz/corpus/glb/', import.meta.url), meshes = readdirSync(corpus).map((name) => readFileSync(new URL(name, corpus)));
  const whole = glb(0.03);
  for (const mesh of [...meshes, ...[1, 5, 13, 20, 60, 300, 700].map((at) => Buffer.concat([whole.subarray(0, at), whole.subarray(at + 3)]))]) {
    const said = await page.evaluate(async (text) => {
      await window.palpate.take(new File([Uint8Array.from(atob(text), (c) => c.charCodeAt(0))], 'tool.glb'), 'tool');
      return document.querySelector('.try-line').textContent;
    }, mesh.toString('base64'));
    assert.match(said, /^tool\.glb [^\n]+\.$|solid/);
  }
  await context.close();
});

test('a packing shows its progress and is cancelled by a click', async () => {
  const { page, context } = await open();
  await give(page, 'pebble.stl', ellipsoid(40, 0.03));
  await page.waitForFunction(() => /: \d+ %/.test(document.querySelector('.try-line').textContent), null, { timeout: 120000 });
  await picture(page, 'packing');
  await page.click('.try-answer');
  await page.waitForFunction(() => /not used: cancelled/.test(document.querySelector('.try-line').textContent));
  assert.equal(await page.locator('.try-answer').count(), 0);
  await context.close();
});

test('the address has settings, and one that is wrong is named', async () => {
  const { page, context } = await open({ query: '?contact.method=weighted&friction.coefficient=1.2&coupling.firmness=1' });
  const settings = await page.evaluate(() => window.palpate.state.settings);
  assert.equal(settings['contact.method'], 'weighted');
  assert.equal(settings['friction.coefficient'], 1.2);
  assert.match(await line(page), /no setting coupling\.firmness/);
  await context.close();
});

/// Holds the tool by T and pushes it by Page up until it feels `newtons`; a busy computer may lose hold of it meanwhile.
async function pushByKeys(page, newtons) {
  await page.keyboard.down('PageUp');
  let force = 0;
  for (let i = 0; i < 2000 && force < newtons; ++i) {
    const { handle, felt } = await page.evaluate(() => ({
      handle: window.palpate.state.handle, felt: Math.hypot(window.palpate.sample.force_x, window.palpate.sample.force_y, window.palpate.sample.force_z) }));
    force = felt;
    if (handle === 'free' && i % 10 === 0) await page.keyboard.press('t');
    await page.waitForTimeout(50);
  }
  await page.keyboard.up('PageUp');
  assert.ok(force >= newtons, `${force} N`);
}

test('the keyboard alone', async () => {
  const { page, context } = await open({ query: '?view=camera' });
  await pushByKeys(page, 0.5);
  await picture(page, 'keyboard');
  await page.keyboard.down('PageDown');
  await page.evaluate(() => dispatchEvent(new KeyboardEvent('keyup', { key: 'Meta' }))); // on macOS nothing says that PageDown was let go before
  let way = Infinity;
  for (let i = 0; i < 20 && way > 1e-4; ++i) way = await page.evaluate(async () => {
    const before = window.palpate.sample.hand_z;
    await new Promise((resolve) => setTimeout(resolve, 1000));
    return Math.abs(window.palpate.sample.hand_z - before);
  });
  assert.ok(way <= 1e-4, `the hand still moves by ${way} m in a second`);
  await page.keyboard.up('PageDown');
  await page.keyboard.press('Escape');
  await page.waitForFunction(() => window.palpate.state.handle === 'free');
  const reached = [];
  for (let i = 0; i < 20; ++i) {
    await page.keyboard.press('Tab');
    reached.push(await page.evaluate(() => document.activeElement.getAttribute('aria-label') ?? document.activeElement.textContent));
  }
  assert.ok(reached.some((name) => /open your own/.test(name)), reached.join(', '));
  assert.ok(reached.every((name) => name !== ''), 'every control has a name');
  await context.close();
});

test('a phone vibrates as the force changes, and what is on it can be read', async () => {
  const { page, context } = await open({ viewport: { width: 390, height: 844 }, isMobile: true, query: '?view=camera&theme=dark', before: () => {
    window.pulses = [];
    navigator.vibrate = (ms) => window.pulses.push({ ms, at: performance.now() });
  } });
  await page.evaluate(() => window.palpate.command({ command: 'set', key: 'camera.noise', value: 0 }));
  await picture(page, 'phone');
  await pushByKeys(page, 1);
  await picture(page, 'phone-touching');
  const pulses = await page.evaluate(() => window.pulses);
  console.log(JSON.stringify(pulses));
  assert.ok(pulses.length > 0 && pulses.every(({ ms }) => ms >= 10 && ms <= 60));
  const outside = await page.evaluate(() => [...document.querySelectorAll('button, label, .card, .newtons')].filter((e) => e.checkVisibility()).map((e) =>
    [e.textContent, e.getBoundingClientRect()]).filter(([, { left, top, right, bottom }]) => left < 0 || top < 0 || right > innerWidth || bottom > innerHeight).map(([text]) => text));
  assert.deepEqual(outside, []);
  assert.equal(await page.evaluate(() => innerWidth), 390);
  await context.close();
});

test('the page is small, and shows the licenses of what is in it', async () => {
  const bytes = gzipSync(readFileSync(file), { level: 9 }).length;
  console.log(`${(bytes / 1e6).toFixed(2)} MB compressed`);
  assert.ok(bytes <= 1.5e6);
  const { page, context } = await open({ viewport: { width: 390, height: 844 } });
  await page.click('.try-licenses');
  const text = await page.textContent('dialog[open] pre');
  for (const words of [/three\.js/, /uPlot/, /lil-gui/, /musl/, /Permission is hereby granted/, /Redistributions in binary form/]) assert.match(text, words);
  await picture(page, 'licenses');
  await page.click('dialog[open] button[aria-label="close"]');
  await context.close();
});

test('one sentence for a file over the limit, and for a mesh with a hole it says where', async () => {
  const { page, context } = await open();
  await page.evaluate(() => window.palpate.take(new File([new Uint8Array(65 << 20)], 'big.stl')));
  assert.match(await line(page), /^big\.stl has 65 MB, and this page takes at most 64; [^\n]+\.$/);
  await give(page, 'open.stl', box(0.05, false));
  await page.waitForFunction(() => /solid/.test(document.querySelector('.try-line').textContent), null, { timeout: 120000 });
  const said = await line(page), at = said.match(/first at \((.*)\) m;/)?.[1].split(', ').map(Number) ?? [];
  const missing = faces.slice(-3).map((i) => corner(i, 0.05)), middles = [0, 1, 2].map((k) => missing[k].map((x, axis) => (x + missing[(k + 1) % 3][axis]) / 2));
  assert.ok(middles.some((middle) => Math.hypot(...middle.map((x, axis) => x - at[axis])) < 1e-4), said);
  await picture(page, 'refused');
  await context.close();
});

for (const [lacks, flags, words, where = 'body', before = () => {}] of [
  ['vector instructions', ['--js-flags=--no-enable-sse4-1'], /^This browser cannot run Palpate: it needs WebAssembly with vector instructions \(SIMD\); update the browser[^\n]+\.$/, '[role=alert]'],
  ['unpacking', [], /^This browser cannot unpack Palpate: it lacks DecompressionStream; update the browser[^\n]+\.$/, '[role=alert]', () => { delete window.DecompressionStream; }],
  ['WebGL', ['--disable-3d-apis'], /This browser shows no 3-D picture \([^\n]+\); turn on its graphics acceleration[^\n]+\./],
])
  test(`one sentence in a browser without ${lacks}`, async () => {
    const poor = await launchWith(flags);
    try {
      const page = await poor.newPage(), errors = [];
      page.on('pageerror', (error) => errors.push(error.message));
      await page.addInitScript(before);
      await page.goto(`file://${file}`);
      await page.waitForFunction(([where, source]) => new RegExp(source, 'm').test(document.querySelector(where)?.innerText), [where, words.source], { timeout: 120000 });
      await picture(page, `without-${lacks.split(' ')[0]}`);
      assert.deepEqual(errors, []);
    } finally {
      await poor.close();
    }
  });
