// The page without a program with a CAD object in its scene: the program's numbers for the same bodies, and those of a ball and a plane.
//
// Environment: that of try_page.mjs; PALPATE_PROGRAM, without which its numbers are not compared.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, test } from 'node:test';

const { box, ellipsoid, give, line, open, picture, png } = await import('./try_page.mjs');
const { program } = await import('../viewer/page/harness.mjs');

const RADIUS = 0.02, SIDE = 0.1; // m: the tool is a ball, the object a box
const WALL = 0.6;                // m
const FIRMNESS = 10;             // N at an eighth of the tool
const wall = png(160, 120, 16, 1000 * WALL), focal = 0.85 * 160;
const capVolume = (depth) => Math.PI * depth ** 2 * (3 * RADIUS - depth) / 3;

const folder = mkdtempSync(join(tmpdir(), 'palpate-object-'));
after(() => rmSync(folder, { recursive: true }));
const hasProgram = existsSync(program);

function run(...words) {
  const { status, stdout, stderr } = spawnSync(program, words, { cwd: folder, encoding: 'utf8' });
  assert.equal(status, 0, stderr);
  return stdout;
}
/// Returns a mesh as the program's tool file, or as it is where there is no program.
function packed(name, mesh) {
  writeFileSync(join(folder, `${name}.stl`), mesh);
  if (!hasProgram) return [`${name}.stl`, mesh];
  run('pack', `${name}.stl`, '--spheres', '1000', '-o', `${name}.palp`);
  return [`${name}.palp`, readFileSync(join(folder, `${name}.palp`))];
}
/// Returns what the program measures where the page has measured.
function measured(sample, X_WB) {
  writeFileSync(join(folder, 'wall.png'), wall);
  const pose = ['x', 'y', 'z', 'qx', 'qy', 'qz', 'qw'].map((name) => sample[`tool_${name}`]).join(' ');
  const words = ['query', 'ball.palp', '--depth', 'wall.png', '--intrinsics', `${focal},${focal},79.5,59.5`, '--pose', pose, '--json'];
  return JSON.parse(run(...words, ...(X_WB ? ['--object', `box.palp@${X_WB.join(' ')}`] : []))).results[0];
}

/// Opens the page with ball, box and wall, without friction; returns the pose of the box, too.
async function withBox() {
  const { page, context, requests, errors } = await open({ query: '?friction.coefficient=0' });
  await give(page, 'wall.png', wall);
  await page.waitForFunction(() => window.palpate.hello.streams[0].width === 160, null, { timeout: 60000 });
  await give(page, ...packed('ball', ellipsoid(24, RADIUS, [1, 1, 1])));
  await page.waitForFunction((r) => Math.abs(window.palpate.hello.tool.radius / r - 1) < 0.01, RADIUS, { timeout: 120000 });
  assert.equal(await page.evaluate(() => window.palpate.hello.objects), 0);
  await give(page, ...packed('box', box(SIDE)), 'an object');
  await page.waitForFunction(() => window.palpate.hello.objects === 1 && window.palpate.contact?.objects.length === 1, null, { timeout: 120000 });
  const { position, quaternion } = await page.evaluate(() => window.palpate.contact.objects[0]);
  return { page, context, requests, errors, X_WB: [...position, ...quaternion] };
}

/// Holds the tool at a point of W, leads its hand by `way` (m), and returns a sample of rest with a force.
async function press(page, at, way) {
  return page.evaluate(async ({ at, way }) => {
    const { palpate } = window, pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms)), turn = [0, 0, 0, 1];
    let share = 0, rest = 0, last = null;
    const tell = () => palpate.tell({ hand: [...at.map((x, i) => x + share * way[i]), ...turn] });
    for (let i = 0; i < 3000 && rest < 20; ++i) {
      if (share === 0 || palpate.state.handle === 'free') { // at first, and after a busy computer was silent for too long
        share = 0;
        await palpate.command({ command: 'hold', at: [...at, ...turn] });
        tell();
        await pause(200);
        share = 0.02;
      }
      tell();
      if (palpate.state.force === 'engaged') share = Math.min(1, share + 0.02);
      await pause(30);
      const { tool_x: x, tool_y: y, tool_z: z, gain } = palpate.sample, now = [x, y, z];
      const isAtRest = share === 1 && gain > 0.999 && last && now.every((n, k) => Math.abs(n - last[k]) < 1e-7);
      rest = isAtRest ? rest + 1 : 0;
      last = now;
    }
    if (rest < 20) throw new Error('the tool did not come to rest');
    return { ...palpate.sample };
  }, { at, way });
}

/// The middle of a side of the box: `axis` of W, `side` 1 or -1.
const faceOf = (X_WB, axis, side) => {
  const [x, y, z, ...q] = X_WB;
  assert.ok(Math.abs(Math.abs(q[0]) - 1) < 1e-9, 'the box stands with z to the camera');
  const middle = [x + SIDE / 2, y - SIDE / 2, z - SIDE / 2]; // its corner is its origin
  return middle.map((n, k) => (k === axis ? n + side * SIDE / 2 : n));
};
const near = (got, want, share, words) => assert.ok(Math.abs(got - want) <= share * Math.abs(want), `${words}: ${got}, not ${want}`);

test('a ball pressed into a box gives the force of the program, and none when the box is switched off', async () => {
  const { page, context, requests, errors, X_WB } = await withBox();
  const face = faceOf(X_WB, 2, -1), sample = await press(page, [face[0], face[1], face[2] - RADIUS - 0.01], [0, 0, 0.025]);
  await picture(page, 'object-pressed');
  const depth = sample.tool_z + RADIUS - face[2], newtons = 8 * FIRMNESS / await page.evaluate(() => window.palpate.hello.tool.volume);
  console.log(JSON.stringify({ depth, volume: sample.volume, cap: capVolume(depth), force: sample.contact_force_z }));
  assert.ok(depth > 0.003);
  assert.equal(sample.objects_volume, sample.volume);
  near(sample.volume, capVolume(depth), 0.03, 'a cap of the ball');
  near(-sample.contact_force_z, newtons * capVolume(depth), 0.05, 'its force');
  near(sample.hand_z - sample.tool_z, -sample.force_z / 400, 0.01, 'the spring of the hand');
  assert.ok(Math.hypot(sample.contact_force_x, sample.contact_force_y) < 1e-3 * -sample.contact_force_z, 'no force along the face');
  if (hasProgram) {
    const { volume, force, objects } = measured(sample, X_WB);
    console.log(JSON.stringify({ volume, force, objects }));
    near(sample.volume, volume, 1e-4, 'the volume of the program');
    near(sample.objects_volume, objects.volume, 1e-4, 'its share');
    near(sample.contact_force_z, newtons * force[2], 1e-4, 'its force');
  }
  const words = await page.innerText('.readouts');
  assert.match(words, /of it in objects\s*100\s*%/);

  const before = await page.evaluate(() => window.palpate.sample.tool_z);
  await page.selectOption('.try-object select', 'none');
  await page.waitForFunction(() => window.palpate.hello.objects === 0 && window.palpate.sample, null, { timeout: 60000 });
  const off = await page.evaluate(() => window.palpate.sample);
  assert.ok(Math.abs(off.tool_z - before) < 1e-4, 'the tool stays');
  assert.deepEqual(['volume', 'objects_volume', 'force_z', 'contact_force_z'].map((name) => Math.abs(off[name])), [0, 0, 0, 0]);
  assert.ok(!/in objects/.test(await page.innerText('.readouts')));

  // Switched on where the tool is, it does not hit: the force begins once the tool has been free.
  await page.selectOption('.try-object select', `box.${hasProgram ? 'palp' : 'stl'}`);
  await page.waitForFunction(() => window.palpate.hello.objects === 1 && window.palpate.sample?.volume > 0, null, { timeout: 60000 });
  await page.waitForTimeout(300);
  const on = await page.evaluate(() => window.palpate.sample);
  assert.ok(on.volume > 0);
  assert.equal(Math.hypot(on.force_x, on.force_y, on.force_z), 0);
  assert.deepEqual(requests, []);
  assert.deepEqual(errors, []);
  await context.close();
});

test('the wall and the box are felt together, and the share of the box is its own', async () => {
  const { page, context, X_WB } = await withBox();
  const side = X_WB[0] + SIDE / 2 > 0 ? -1 : 1, face = faceOf(X_WB, 0, side); // the side of the box towards the middle of the image
  const sample = await press(page, [face[0] + side * (RADIUS + 0.01), face[1], WALL - RADIUS - 0.01], [-side * 0.032, 0, 0.032]);
  const deep = (face[0] - sample.tool_x) * side + RADIUS, behind = sample.tool_z + RADIUS - WALL;
  console.log(JSON.stringify({ deep, behind, share: sample.objects_volume / sample.volume }));
  assert.ok(deep > 0.004 && behind > 0.004); // lighter touches of 1,000 spheres err more
  near(sample.objects_volume, capVolume(deep), 0.06, 'the cap in the box');
  near(sample.volume - sample.objects_volume, capVolume(behind), 0.06, 'the cap behind the wall');
  const shown = await page.waitForFunction((share) => {
    const found = document.querySelector('.readouts').innerText.match(/of it in objects\s*(\d+)/);
    return found && Math.abs(Number(found[1]) - share) <= 1;
  }, 100 * sample.objects_volume / sample.volume, { timeout: 20000 });
  assert.ok(shown);
  if (hasProgram) {
    const { volume, force, objects } = measured(sample, X_WB), newtons = 8 * FIRMNESS / await page.evaluate(() => window.palpate.hello.tool.volume);
    near(sample.objects_volume, objects.volume, 1e-4, 'the share of the program');
    near(sample.volume, volume, 1e-4, 'its volume');
    ['x', 'y', 'z'].forEach((axis, i) => assert.ok(Math.abs(sample[`contact_force_${axis}`] - newtons * force[i]) < 1e-4 * newtons * Math.hypot(...force), axis));
  }
  await context.close();
});

test('an object of the page rests on what the camera sees, clear of the tool, and is moved by its settings', async () => {
  const { page, context, requests, errors } = await open({ viewport: { width: 1280, height: 800 }, query: '?objects.shape=box' });
  await page.waitForFunction(() => window.palpate.contact?.objects.length === 1, null, { timeout: 60000 });
  await picture(page, 'object-box');
  const { X_WB, volume, radius } = await page.evaluate(() => ({ X_WB: window.palpate.contact.objects[0], volume: window.palpate.sample.volume, radius: window.palpate.hello.tool.radius }));
  assert.equal(volume, 0);
  assert.ok(X_WB.position[2] > 0.3 && X_WB.position[2] < 0.56, `between the camera and the hand, not at ${X_WB.position[2]} m`);
  const set = (key, value) => page.evaluate(([key, value]) => window.palpate.command({ command: 'set', key, value }), [key, value]);
  await set('objects.right', 0.03);
  await page.waitForFunction((x) => Math.abs(window.palpate.contact.objects[0].position[0] - x - 0.03) < 1e-9, X_WB.position[0]);
  await set('objects.right', 0);
  const refused = await set('objects.shape', 'cone');
  assert.match(refused.error, /^There is no object cone; give none, box, sphere, [^\n]+\.$/);
  assert.equal(await page.inputValue('.try-object select'), 'box');
  await page.selectOption('.try-object select', 'sphere');
  await page.waitForFunction(() => window.palpate.state?.settings['objects.shape'] === 'sphere' && window.palpate.contact?.objects.length === 1);
  await picture(page, 'object-sphere');
  await set('scene.name', 'moving-wall'); // the object is there, too, with that scene's tool
  await page.waitForFunction((r) => window.palpate.hello.objects === 1 && window.palpate.hello.tool.radius > 1.2 * r, radius);
  await page.waitForFunction(() => window.palpate.sample?.volume === 0 && window.palpate.contact?.objects.length === 1);
  assert.deepEqual(requests, []);
  assert.deepEqual(errors, []);
  await context.close();
});

test('a file as an object: chosen, refused in one sentence, and reached by keys', async () => {
  const { page, context } = await open({ viewport: { width: 390, height: 844 }, isMobile: true });
  await give(page, 'open.stl', box(0.05, false), 'an object');
  await page.waitForFunction(() => /solid/.test(document.querySelector('.try-line').textContent), null, { timeout: 120000 });
  assert.match(await line(page), /first at/);
  await give(page, 'bad.palp', Buffer.from('nothing'), 'an object');
  await page.waitForFunction(() => /tool file/.test(document.querySelector('.try-line').textContent));
  assert.equal(await page.evaluate(() => window.palpate.hello.objects), 0);
  assert.equal(await page.inputValue('.try-object select'), 'none');

  await page.setInputFiles('.try-open input', { name: 'part.stl', mimeType: 'model/stl', buffer: box(0.03) });
  await page.waitForFunction(() => document.activeElement.textContent === 'the tool');
  await picture(page, 'object-asked');
  const outside = await page.evaluate(() => [...document.querySelectorAll('.try-files > *, .try-answer')].filter((e) => e.checkVisibility()).map((e) =>
    [e.textContent, e.getBoundingClientRect()]).filter(([, { left, right, bottom }]) => left < 0 || right > innerWidth || bottom > innerHeight).map(([text]) => text));
  assert.deepEqual(outside, []);
  await page.keyboard.press('Tab');
  await page.keyboard.press('Enter');
  await page.waitForFunction(() => window.palpate.hello.objects === 1 && window.palpate.contact?.objects.length === 1, null, { timeout: 120000 });
  assert.equal(await page.inputValue('.try-object select'), 'part.stl');
  await picture(page, 'object-own');
  await page.setInputFiles('.try-open input', { name: 'other.stl', mimeType: 'model/stl', buffer: box(0.02) });
  await page.getByRole('button', { name: 'cancel', exact: true }).click();
  assert.equal(await line(page), 'other.stl is not used: cancelled.');
  await page.locator('.try-object select').focus();
  await page.keyboard.press('Home');
  await page.waitForFunction(() => window.palpate.hello.objects === 0, null, { timeout: 60000 });
  await context.close();
});
