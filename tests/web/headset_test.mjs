// The page without a program with an emulated headset (npm's iwer and @iwer/sem): its depth is felt by a controller, which vibrates.
//
// Environment: that of try_page.mjs.
import assert from 'node:assert/strict';
import { existsSync, readFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';
import { fileURLToPath } from 'node:url';

const packages = fileURLToPath(new URL('../../build/web-headset', import.meta.url));
if (!existsSync(packages)) {
  console.log('SKIPPED: no emulated headset (scripts/setup.sh --web)');
  process.exit(77);
}
const { box, browser, file, give, picture, png } = await import('./try_page.mjs');

const SIDE = 0.04;             // m, of the tool, a box
const WALL = -0.6, EYE = 1.6;  // m: where the wall stands, and the height of the eyes
const SPRING = 400;            // N/m, of a page
const WALL_STIFFNESS = 8 * 10 / SIDE; // N/m: 10 N at an eighth of the box
const TURN = 0.2;              // rad, of the head to the side
const JITTER = 1e-6;           // share by which the lens differs from image to image

/// A wall of 2 m, whose front is at z = WALL of the floor's frame.
const room = { type: 'scene', version: 1, spatialEntities: [{
  uuid: '00000000-0000-4000-8000-000000000001', semanticLabel_META: 'OTHER',
  locatable_META: { orientation: { x: 0, y: 0, z: 0, w: 1 }, position: { x: 0, y: EYE, z: WALL } },
  bounded3D_META: { offset: { x: -1, y: -1, z: -0.5 }, extent: { width: 2, height: 2, depth: 0.5 } },
}] };

/// Opens the page in an emulated headset, which may lack depth sensing.
async function open(query, hasDepth = true) {
  const page = await browser.newPage({ viewport: { width: 800, height: 500 } }), requests = [], errors = [];
  page.on('request', (request) => /^https?:/.test(request.url()) && requests.push(request.url()));
  page.on('pageerror', (error) => errors.push(error.message));
  for (const name of ['iwer/build/iwer.min.js', 'iwer-sem/build/iwer-sem.min.js']) await page.addInitScript(readFileSync(join(packages, name), 'utf8'));
  await page.addInitScript(([scene, turn, jitter, hasDepth]) => addEventListener('DOMContentLoaded', () => {
    const { metaQuest3: quest } = window.IWER, device = window.headset = new window.IWER.XRDevice({ ...quest, supportedFeatures: quest.supportedFeatures.filter((name) => hasDepth || name !== 'depth-sensing') });
    device.installRuntime({ forceInstall: true });
    device.installSEM(window.IWER_SEM.SyntheticEnvironmentModule);
    device.sem.loadEnvironment(scene);
    // It unpacks the depth that three.js packs without the factor of 255 / 256, which makes 0.60 m 0.61 m.
    const compute = device.sem.computeDepthBuffer.bind(device.sem);
    device.sem.computeDepthBuffer = (view, projection, width, height, near, far) => {
      const image = compute(view, projection, width, height, near, far), depth = new Float32Array(image.data);
      for (let i = 0; i < depth.length; ++i) if (depth[i] < far) depth[i] = near / (1 - (1 - near / depth[i]) * (255 / 256));
      return image;
    };
    const { get } = Object.getOwnPropertyDescriptor(XRView.prototype, 'projectionMatrix');
    Object.defineProperty(XRView.prototype, 'projectionMatrix', { get() {
      const P = new Float32Array(get.call(this));
      P[0] *= 1 + jitter * Math.random();
      return P;
    } });
    device.quaternion.set(0, Math.sin(turn / 2), 0, Math.cos(turn / 2));
    window.pulses = [];
    for (const motor of device.controllers.right.inputSource.gamepad.hapticActuators)
      motor.pulse = (strength, ms) => (window.pulses.push([strength, ms]), Promise.resolve(true));
  }, { once: true, capture: true }), [room, TURN, JITTER, hasDepth]);
  await page.goto(`file://${file}${query}`);
  await page.waitForFunction(() => window.palpate?.hello && window.palpate.sample, null, { timeout: 240000 });
  return { page, requests, errors };
}

test('the depth of a headset is felt by its controller, and pulses follow the change of the force', async () => {
  const { page, requests, errors } = await open('?friction.coefficient=0&look=spheres'); // its window needs no mesh
  await give(page, 'wall.png', png(160, 120, 16, 600));
  await page.waitForFunction(() => window.palpate.hello.streams[0].name === 'wall.png', null, { timeout: 120000 });
  await give(page, 'box.stl', box(SIDE));
  await page.waitForFunction((v) => Math.abs(window.palpate.hello.tool.volume / v - 1) < 1e-5, SIDE ** 3, { timeout: 120000 });
  await page.click('.try-headset');
  await page.waitForFunction(() => window.palpate.hello.streams[0].name === 'the headset' && window.palpate.hello.streams[0].is_moving && window.palpate.counters.contacts > 1, null, { timeout: 120000 });
  await page.waitForFunction((side) => { // the drawn tool is the felt one
    const x = window.palpate.mesh?.positions.filter((_, i) => i % 3 === 0) ?? [];
    return Math.abs(Math.max(...x) - Math.min(...x) - side) < 1e-6;
  }, SIDE, { timeout: 60000 });

  const felt = await page.evaluate(async ([eye, wall]) => {
    const { controllers: { right } } = window.headset, { palpate } = window, pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
    const tip = (z) => right.position.set(0, eye, z), push = (s) => s.contact_force_z;
    const start = wall + 2 * palpate.hello.tool.radius + 0.03, seen = [];
    right.quaternion.set(0, 0, 0, 1);
    const isTouching = () => palpate.state.force === 'engaged' && palpate.sample.gain > 0.999 && push(palpate.sample) > 0.5;
    const step = async () => {
      if (palpate.state.handle === 'free') { // at first, and after a busy computer was silent for too long
        right.updateButtonValue('trigger', 0);
        tip(start);
        await pause(300);
        right.updateButtonValue('trigger', 1);
        await pause(300);
      }
      if (right.position.z > start - 0.06 && palpate.state.force === 'engaged') tip(right.position.z - 0.004);
      await pause(30);
    };
    for (let i = 0; i < 1500 && seen.length < 60; ++i) {
      await step();
      if (isTouching()) seen.push({ ...palpate.sample });
    }
    const pulses = window.pulses.slice();
    const during = []; // pulses in seconds of steady force
    for (let i = 0; i < 1500 && during.length < 20 && !during.includes(0); ++i) {
      await step();
      if (!isTouching()) continue;
      const num = window.pulses.length;
      await pause(1000);
      if (isTouching()) during.push(window.pulses.length - num);
    }
    const { getDepthInformation } = XRFrame.prototype;
    let hasFaded = false; // without new depth
    for (let i = 0, waits = 0; i < 1500 && waits < 300 && !hasFaded; ++i) {
      await step();
      if (!isTouching()) continue;
      XRFrame.prototype.getDepthInformation = () => null;
      for (waits = 0; waits < 300 && palpate.state.handle === 'held' && !hasFaded; ++waits) {
        await pause(30);
        hasFaded = /^no depth frame/.test(palpate.state.fault) && palpate.sample.gain < 1e-3;
      }
      XRFrame.prototype.getDepthInformation = getDepthInformation;
    }
    right.updateButtonValue('trigger', 0);
    return { seen, pulses, during, hasFaded };
  }, [EYE, WALL]);
  await picture(page, 'headset');
  assert.ok(felt.seen.length > 20, `${felt.seen.length} samples with a force`);
  // Behind the wall is a slab of the box: its front is at z = 0 of the tool's frame.
  const errorsOfDepth = felt.seen.map((s) => s.volume / SIDE ** 2 - (WALL - s.tool_z));
  const worst = Math.max(...errorsOfDepth.map(Math.abs)), last = felt.seen.at(-1);
  console.log(JSON.stringify({ worst, volume: last.volume, z: last.tool_z, force: last.force_z, hand: last.hand_z, pulses: felt.pulses.length, during: felt.during }));
  assert.ok(worst < 0.001, `the slab is ${worst} m thicker than it should be`);
  const slab = last.volume / SIDE ** 2;
  assert.ok(Math.abs(last.force_z / (WALL_STIFFNESS * slab) - 1) < 0.05, 'the wall pushes out by its stiffness');
  assert.ok(Math.abs(last.force_z / (SPRING * (last.tool_z - last.hand_z)) - 1) < 0.05, 'the spring of the hand holds it');
  assert.ok(Math.hypot(last.force_x, last.force_y) < 0.05 * last.force_z, 'across the wall is no force');
  assert.ok(felt.pulses.length > 0 && felt.pulses.every(([strength, ms]) => strength > 0 && strength <= 1 && ms < 200));
  assert.ok(felt.during.includes(0), `no pulse while the force is steady, but in seconds ${felt.during}`);
  assert.ok(felt.hasFaded, 'without new depth the force fades');
  await page.waitForFunction(() => window.palpate.state.handle === 'free', null, { timeout: 20000 });

  const before = await page.evaluate(async () => {
    const { controllers: { right } } = window.headset, pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
    for (let i = 0; i < 50 && window.palpate.state.handle !== 'held'; ++i)
      for (const value of [0, 1]) {
        right.updateButtonValue('trigger', value);
        await pause(300);
      }
    window.headset.recenter();
    return window.palpate.state.handle;
  });
  assert.equal(before, 'held');
  await page.waitForFunction(() => window.palpate.state.handle === 'free', null, { timeout: 20000 });

  await page.evaluate(() => window.headset.activeSession.end());
  await page.waitForFunction(() => window.palpate.hello.streams[0].name === 'wall.png', null, { timeout: 60000 });
  assert.deepEqual(requests, []);
  assert.deepEqual(errors, []);
  await page.close();
});

test('one sentence for a headset without depth', async () => {
  const { page, errors } = await open('', false);
  await page.click('.try-headset');
  await page.waitForFunction(() => /^The headset shows no depth here \([^\n]+\); take one [^\n]+\.$/.test(document.querySelector('.try-line').textContent), null, { timeout: 60000 });
  assert.deepEqual(errors, []);
  await page.close();
});
