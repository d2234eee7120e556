// The page as a haptic device: the real program, whose tool a pointer holds.
import assert from 'node:assert/strict';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after } from 'node:test';

import { banner, browser, openPage, pageTest, runProgram, state, until } from './harness.mjs';

const folder = mkdtempSync(join(tmpdir(), 'palpate-hand-'));
after(() => rmSync(folder, { recursive: true, force: true }));
const tool = join(folder, 'box.palp');

const SIDE = 0.1;       // m, of the box
const MOST = 10;        // N, of a page, and so at an eighth of the box
const SPRING = 400;     // N/m, of a page
const depth = 1;        // m, of the wall
const WALL = 8 * MOST / SIDE; // N/m, of a wall that a side of the box lies on: volume over depth

async function finished(args) {
  const run = await runProgram(args);
  assert.equal(await run.ended, 0, `palpate ${args.join(' ')}\n${run.errors}`);
  return run;
}

/// A run with a box before a wall, on a machine that may be late.
async function begin(name) {
  if (!begin.isReady) {
    const mesh = join(folder, 'box.ply');
    await finished(['shape', 'box', '--size', String(SIDE), '-o', mesh]);
    await finished(['pack', mesh, '-o', tool, '--spheres', '2000']);
    const limits = ['max_contact_age', 'max_sensor_age', 'max_device_silence', 'max_tick', 'energy_tank'];
    writeFileSync(join(folder, 'patient.toml'), `[safety]\n${limits.map((limit) => `${limit} = 60\n`).join('')}`);
    begin.isReady = true;
  }
  const output = join(folder, name);
  const run = await runProgram(['touch', tool, '--scene', 'wall', '--device', 'page', '--settings',
    join(folder, 'patient.toml'), '--set', 'loop.thin_out=false', '--view-port', '0', '-o', output]);
  run.output = output;
  run.url = await until('an address', () => {
    assert.equal(run.code, undefined, `it ended:\n${run.errors}`);
    return `${run.lines.join('\n')}\n${run.errors}`.match(/http:\/\/\S+/)?.[0];
  });
  return run;
}

/// Small, so that drawing it takes a busy machine no time.
async function look(run) {
  const page = await openPage(`${run.url}?view=camera&plots=0&image=0&controls=0&stride=8`, { width: 480, height: 400 });
  await until('the tool', async () => (await sample(page)) && (await state(page))?.running);
  return page;
}

const sample = (page) => page.evaluate(() => window.palpate.sample);
const handAt = (page) => page.evaluate(() => {
  const { left, top } = document.querySelector('canvas.scene').getBoundingClientRect();
  const [x, y] = window.palpate.scene.projectHand();
  return [left + x, top + y];
});
const holding = (page) => page.evaluate(() => document.querySelector('.hold').dataset.holding);
const force = (s) => Math.hypot(s.force_x, s.force_y, s.force_z);
const contact = (s) => Math.hypot(s.contact_force_x, s.contact_force_y, s.contact_force_z);

/// Presses the mouse on the tool, wherever the page has it now that it is laid out.
async function grab(page) {
  let nudge = 0;
  await until('the pointer is over the tool', async () => {
    const [x, y] = await handAt(page);
    await page.mouse.move(x + (nudge = 1 - nudge), y);
    return page.evaluate(() => document.querySelector('.stage').style.cursor === 'grab');
  });
  await page.mouse.down();
  await until('the tool is held', async () => (await holding(page)) === 'mine');
}

/// Of the last samples, once nothing moves any more.
async function atRest(page) {
  let before = null;
  return until('rest', async () => {
    const now = await sample(page);
    const rests = before && now.time > before.time + 0.2 && now.gain === 1
      && ['x', 'y', 'z'].every((c) => Math.abs(now[`hand_${c}`] - before[`hand_${c}`]) < 1e-5
        && Math.abs(now[`tool_${c}`] - before[`tool_${c}`]) < 1e-4
        && Math.abs(now[`hand_q${c}`] - before[`hand_q${c}`]) < 1e-5);
    if (!before || now.time > before.time + 0.2) before = now;
    return rests && now;
  });
}

async function end(page, run) {
  page.expectsErrors = true; // the server goes
  await run.stop();
  assert.equal(run.code, 0, run.errors);
}

pageTest('a pointer presses the tool into a wall, meets the force of the closed form, and lets go', async (t) => {
  const run = await begin('pressed');
  const page = await look(run);
  assert.equal((await state(page)).handle, 'free');
  const start = await sample(page);
  await grab(page);

  // In the picture plane: the middle of the tool stays below the pointer.
  const [x, y] = await handAt(page);
  await page.mouse.move(x + 30, y - 20, { steps: 5 });
  await until('the tool is below the pointer', async () => {
    const [u, v] = await handAt(page);
    return Math.hypot(u - x - 30, v - y + 20) < 1.5;
  });
  await page.mouse.up();
  const aside = await atRest(page);
  assert.ok(Math.abs(aside.hand_z - start.hand_z) < 1e-3, 'the picture plane of the camera is that of the image');
  assert.equal(contact(aside), 0);

  // Along the line of sight: to the wall, and further twice.
  const felt = [];
  for (const wanted of [0.012, 0.024]) {
    for (;;) { // a notch of the wheel at a time
      const now = await sample(page);
      if (now.hand_z + SIDE / 2 - depth >= wanted) break;
      await page.mouse.wheel(0, -60);
      await until('the hand moves', async () => (await sample(page)).hand_z > now.hand_z + 1e-5);
      await atRest(page);
    }
    const now = await atRest(page);
    const pressed = now.hand_z + SIDE / 2 - depth, inside = now.tool_z + SIDE / 2 - depth;
    felt.push({ pressed, inside, stretch: now.stretch, force: force(now), contact: contact(now) });
    t.diagnostic(JSON.stringify(felt.at(-1)));
  }
  for (const { pressed, inside, stretch, force: F, contact: F_c } of felt) {
    const expected = pressed / (1 / SPRING + 1 / WALL);
    assert.ok(Math.abs(F - expected) < 0.05 * expected, `${F} N, not the ${expected} N of spring and wall`);
    assert.ok(Math.abs(F - SPRING * stretch) < 0.01 * F, 'the spring');
    assert.ok(Math.abs(F_c - F) < 0.03 * F, 'what the tool meets is what the hand feels');
    assert.ok(Math.abs(F_c - WALL * inside) < 0.1 * F_c, 'the volume in the wall');
  }
  // It is seen.
  assert.match(await page.locator('.newtons').innerText(), /^\d+(\.\d+)? N$/);
  assert.match(await page.locator('.hold').innerText(), /You hold the tool/);

  await page.keyboard.press('Escape');
  const free = await until('no force', async () => {
    const now = await sample(page);
    return force(now) === 0 && now.gain === 0 && now;
  });
  assert.ok(contact(free) < 0.02 * felt[1].contact, `${contact(free)} N are left on the tool`);
  assert.equal((await until('it is free', async () => (await state(page)).handle === 'free' && state(page))).running, true);
  await end(page, run);

  // The recording tells the same, and repeats to the bit.
  const { faults } = JSON.parse(readFileSync(join(run.output, 'summary.json')));
  assert.deepEqual(faults ?? [], []);
  const [names, ...rows] = readFileSync(join(run.output, 'wrench.csv'), 'utf8').trim().split('\n')
    .map((line) => line.split(','));
  const length = (row, name) => Math.hypot(...['x', 'y', 'z'].map((c) => Number(row[names.indexOf(`${name}_${c}_N`)])));
  const hardest = rows.find((row) => Math.abs(length(row, 'hand_force') - felt[1].force) < 1e-3 * felt[1].force);
  assert.ok(hardest, 'the force that was seen is in the recording');
  const volume = Number(hardest[names.indexOf('volume_m3')]);
  assert.ok(Math.abs(length(hardest, 'force') - (WALL / SIDE ** 2) * volume) < 0.05 * felt[1].force);
  assert.equal(length(rows.at(-1), 'hand_force'), 0);
  const repeated = await finished(['replay', run.output]);
  assert.match(repeated.lines.join('\n'), /^identical: /);
});

pageTest('one page holds the tool at a time, and who closes it lets go', async () => {
  const run = await begin('handed-over');
  const [first, second] = [await look(run), await look(run)];
  await first.bringToFront();
  await grab(first);
  await until('the other one sees that', async () => (await holding(second)) === 'other');
  const before = await sample(second);

  // Neither by its pointer nor by messages.
  await until('it is told so', async () => {
    await second.mouse.up();
    const [x, y] = await handAt(second);
    await second.mouse.move(x, y);
    await second.mouse.down();
    return /another page/i.test(await banner(second));
  });
  const [x, y] = await handAt(second);
  await second.mouse.move(x + 50, y, { steps: 5 });
  await second.mouse.up();
  const refused = await second.evaluate(async (url) => {
    const socket = new WebSocket(url);
    const answers = [];
    socket.onmessage = ({ data }) => typeof data === 'string' && answers.push(JSON.parse(data));
    await new Promise((resolve) => { socket.onopen = resolve; });
    socket.send(JSON.stringify({ id: 1, command: 'hold' }));
    socket.send(JSON.stringify({ id: 2, command: 'release' }));
    socket.send(JSON.stringify({ hand: [0, 0, 0.2, 0, 0, 0, 1] }));
    while (answers.filter(({ type }) => type === 'answer').length < 3) await new Promise((resolve) => setTimeout(resolve, 20));
    socket.close();
    return answers.filter(({ type }) => type === 'answer');
  }, run.url.replace('http', 'ws') + 'ws');
  assert.deepEqual(refused.map(({ ok }) => ok), [false, true, false]);
  const now = await sample(second);
  for (const c of ['x', 'y', 'z']) assert.ok(Math.abs(now[`hand_${c}`] - before[`hand_${c}`]) < 1e-3);
  assert.equal(await holding(first), 'mine');

  await first.close();
  await until('it is free', async () => (await holding(second)) === 'free');
  assert.equal((await state(second)).running, true);
  await grab(second);
  await second.mouse.up();
  await end(second, run);
});

pageTest('a page of another origin cannot take the tool', async () => {
  const run = await begin('stranger');
  const page = await look(run);
  const before = await sample(page);
  const elsewhere = createServer((_, answer) => {
    answer.setHeader('Content-Type', 'text/html');
    answer.end('<!doctype html><title>elsewhere</title>');
  });
  await new Promise((resolve) => elsewhere.listen(0, '127.0.0.1', resolve));
  try {
    const stranger = await browser.newPage();
    await stranger.goto(`http://127.0.0.1:${elsewhere.address().port}/`);
    const opened = await stranger.evaluate(async (url) => {
      for (const body of ['{"command": "hold"}', '{"hand": [0, 0, 1, 0, 0, 0, 1]}']) {
        try { await fetch(`${url}api/command`, { method: 'POST', mode: 'no-cors', body }); } catch { /* refused */ }
      }
      return new Promise((resolve) => {
        const socket = new WebSocket(`${url.replace('http', 'ws')}ws`);
        socket.onopen = () => { socket.send('{"id": 1, "command": "hold"}'); resolve(true); };
        socket.onerror = () => resolve(false);
      });
    }, run.url);
    assert.equal(opened, false);
    await stranger.close();
  } finally {
    elsewhere.close();
  }
  const { time } = await state(page);
  await until('a later state', async () => (await state(page)).time > time + 0.5);
  assert.equal((await state(page)).handle, 'free');
  const now = await sample(page);
  for (const c of ['x', 'y', 'z']) assert.equal(now[`hand_${c}`], before[`hand_${c}`]);
  await end(page, run);
});

pageTest('rings, keys, fingers and a gamepad turn and move the tool', async (t) => {
  const run = await begin('turned');
  const page = await look(run);
  await page.evaluate(() => { // a pad whose sticks and motors are numbers
    const pad = { connected: true, axes: [0, 0, 0, 0], buttons: Array.from({ length: 17 }, () => ({ pressed: false })) };
    pad.rumbles = [];
    pad.vibrationActuator = { playEffect: async (_, how) => { pad.rumbles.push(how.strongMagnitude); } };
    navigator.getGamepads = () => [pad];
    window.pad = pad;
    dispatchEvent(new Event('gamepadconnected'));
  });
  const pad = (change) => page.evaluate((all) => {
    if (all.axes) window.pad.axes = all.axes;
    for (const [i, pressed] of Object.entries(all.buttons ?? {})) window.pad.buttons[i].pressed = pressed;
  }, change);
  const angle = (s, o) => 2 * Math.acos(Math.min(1, Math.abs(
    ['x', 'y', 'z', 'w'].reduce((sum, c) => sum + s[`hand_q${c}`] * o[`hand_q${c}`], 0))));
  const moved = async (what, from, condition) => until(what, async () => condition(await sample(page), from));

  let from = await sample(page);
  await pad({ buttons: { 0: true } });
  await until('held by the pad', async () => (await holding(page)) === 'mine');
  await pad({ axes: [0, -1, 0, 0] });
  await moved('the left stick moves it up', from, (s, o) => s.hand_y < o.hand_y - 0.005);
  await pad({ axes: [0, 0, 0, -1] });
  await moved('the right stick pushes it into the wall', from, (s) => force(s) > 3);
  await pad({ axes: [0, 0, 0, 0] });
  const now = await atRest(page);
  const last = await until('it rumbles as hard as the force', async () => {
    const strong = await page.evaluate(() => window.pad.rumbles.at(-1));
    return Math.abs(strong - force(now) / MOST) < 0.03 && strong;
  });
  t.diagnostic(`${force(now).toFixed(2)} N rumble at ${last.toFixed(3)}`);
  await pad({ axes: [0, 0, 0, 1] });
  await moved('back', from, (s) => contact(s) === 0);
  await pad({ axes: [0, 0, 0, 0] });

  from = await atRest(page);
  await page.keyboard.down('Shift');
  await page.keyboard.down('ArrowRight');
  await moved('Shift and an arrow turn it', from, (s, o) => angle(s, o) > 0.1);
  await page.keyboard.up('ArrowRight');
  await page.keyboard.up('Shift');
  from = await atRest(page);
  await page.keyboard.down('ArrowLeft');
  await moved('an arrow moves it', from, (s, o) => s.hand_x < o.hand_x - 0.003);
  await page.keyboard.up('ArrowLeft');

  from = await atRest(page);
  const ring = await page.evaluate(() => {
    const { left, top, width, height } = document.querySelector('canvas.scene').getBoundingClientRect();
    for (let y = 4; y < height; y += 3) {
      for (let x = 4; x < width; x += 3) {
        const found = window.palpate.scene.graspAt(x, y, 3);
        const over = document.elementFromPoint(left + x, top + y);
        if (found?.kind === 'ring' && over?.matches('canvas.scene')) return { x: left + x, y: top + y, perRadian: found.perRadian };
      }
    }
    return null;
  });
  assert.ok(ring, 'a ring is to be seen');
  const [gx, gy] = ring.perRadian, length = Math.hypot(gx, gy);
  await page.mouse.move(ring.x, ring.y);
  await page.mouse.down();
  await page.mouse.move(ring.x + (20 * gx) / length, ring.y + (20 * gy) / length, { steps: 4 });
  await page.mouse.up();
  const turned = await atRest(page);
  const expected = (20 * length) / Math.max(length * length, 400);
  assert.ok(Math.abs(angle(turned, from) - expected) < 0.02, `${angle(turned, from)} rad, not ${expected}`);

  // Two fingers that come together push it away.
  const fingers = await page.context().newCDPSession(page);
  const [x, y] = await handAt(page);
  const touch = (type, ...apart) => fingers.send('Input.dispatchTouchEvent', {
    type, touchPoints: apart.map((u, id) => ({ x: x + u, y, id })),
  });
  from = await atRest(page);
  await touch('touchStart', 0);
  await touch('touchStart', 0, 80);
  for (const u of [76, 72, 68]) await touch('touchMove', 0, u);
  await touch('touchEnd');
  await moved('two fingers push it away', from, (s, o) => s.hand_z > o.hand_z + 0.01);

  await pad({ buttons: { 0: false, 1: true } });
  await until('let go by the pad', async () => (await holding(page)) === 'free');
  await end(page, run);
});
