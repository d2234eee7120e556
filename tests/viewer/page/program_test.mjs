// The real program from a bare mesh to the page: a live run, its recording, the tool alone.
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after } from 'node:test';

import { color, isJust } from './colors.mjs';
import { command, drawn, look, openPage, options, pageTest, runProgram, stat, state, until } from './harness.mjs';

const folder = mkdtempSync(join(tmpdir(), 'palpate-page-'));
after(() => rmSync(folder, { recursive: true, force: true }));
const tool = join(folder, 'tool.palp');
const recording = join(folder, 'run');

/// Starts the program and waits for the address of its page, wherever it prints it.
async function viewed(args) {
  const run = await runProgram(args);
  run.url = await until(`an address from palpate ${args[0]}`, () => {
    assert.equal(run.code, undefined, `palpate ${args.join(' ')} ended:\n${run.errors}`);
    return `${run.lines.join('\n')}\n${run.errors}`.match(/http:\/\/\S+/)?.[0];
  });
  return run;
}

async function finished(args) {
  const run = await runProgram(args);
  assert.equal(await run.ended, 0, `palpate ${args.join(' ')}\n${run.errors}`);
}

pageTest('a live run is seen, turned and ended from the page', async (t) => {
  const mesh = join(folder, 'shape.ply');
  await finished(['shape', 'stylus', '-o', mesh]);
  await finished(['pack', mesh, '-o', tool, '--spheres', '1000']);
  // A machine that is busy with tests is late; that is not what is tested here.
  const settings = join(folder, 'patient.toml');
  const limits = ['max_contact_age', 'max_sensor_age', 'max_device_silence', 'max_tick',
    'energy_tank'];
  writeFileSync(settings, `[safety]\n${limits.map((name) => `${name} = 60\n`).join('')}`);
  const run = await viewed(['touch', tool, '--scene', 'hand', '--device', 'sim', '--duration', '1800',
    '--object', `${tool}@0.1 0 0.4 0 0 0 1,friction=0.4`, '--settings', settings, '--view', '--view-port', '0', '-o', recording]);
  const page = await openPage(run.url);
  await drawn(page, 5);
  const before = await state(page);
  await until('counters that move', async () => {
    const now = await state(page);
    return now.ticks > before.ticks && now.frames > before.frames && now.contacts > before.contacts;
  });
  assert.equal(before.fault, null);
  const { controls } = await page.evaluate(() => window.palpate.hello);
  const method = controls.find(({ key }) => key === 'contact.method');
  for (const choice of method.choices) {
    const answer = await command(page, { command: 'set', key: 'contact.method', value: choice });
    assert.ok(answer.ok, answer.error);
    await until(choice, async () => (await state(page)).settings['contact.method'] === choice);
  }
  for (const friction of [0.1, 'auto']) {
    const answer = await command(page, { command: 'set', key: 'objects.tool.friction', value: friction });
    assert.ok(answer.ok, answer.error);
    await until(`${friction}`, async () => (await state(page)).settings['objects.tool.friction'] === friction);
  }
  const refused = await command(page, { command: 'set', key: 'objects.tool.friction', value: 'rough' });
  assert.equal(refused.error, "objects.tool.friction must be a number from 0 to 10 or auto, not 'rough'");
  assert.ok((await command(page, { command: 'pause' })).ok);
  await until('paused', async () => (await state(page)).paused);
  assert.ok((await command(page, { command: 'step', frames: 1 })).ok);
  assert.ok((await command(page, { command: 'resume' })).ok);
  assert.ok((await command(page, { command: 'mark', text: 'here' })).ok);
  await drawn(page, 3);
  page.expectsErrors = true; // the server goes
  assert.ok((await command(page, { command: 'end' })).ok);
  assert.equal(await run.ended, 0, run.errors);
  t.diagnostic(`${(await stat(page)).pictures} pictures`);
});

pageTest('the recording is played and searched', async () => {
  const run = await viewed(['view', recording, '--port', '0']);
  const page = await openPage(run.url);
  await until('a state', () => state(page));
  assert.ok((await command(page, { command: 'pause' })).ok);
  const { duration } = await state(page);
  const { marks } = await command(page, { command: 'marks' });
  assert.ok(duration > 0.5, `${duration} s`);
  assert.ok(marks.some(({ text }) => text === 'here'), JSON.stringify(marks));
  await until('a tick of the mark', () => page.evaluate(() =>
    [...document.querySelectorAll('.ticks button')].some((tick) => tick.title.includes('here'))));
  for (const share of [0.75, 0.25]) {
    assert.ok((await command(page, { command: 'seek', time: share * duration })).ok);
    await until(`time ${share}`, async () => Math.abs((await state(page)).time - share * duration) < 0.1);
  }
  const { time } = await state(page);
  assert.ok((await command(page, { command: 'step', frames: 1 })).ok);
  await until('a later time', async () => (await state(page)).time > time);
  assert.ok((await command(page, { command: 'seek', time: 0 })).ok);
  assert.ok((await command(page, { command: 'resume' })).ok);
  await drawn(page, 2);
  page.expectsErrors = true;
  await run.stop();
  assert.equal(run.code, 0, run.errors);
});

pageTest('a run along a path is seen', async () => {
  const run = await viewed(['touch', tool, '--scene', 'moving-box', '--duration', '1800', '--view', '--view-port', '0',
    '-o', join(folder, 'path-run')]);
  const page = await openPage(run.url);
  await drawn(page, 3);
  const before = await state(page);
  assert.equal((await page.evaluate(() => window.palpate.hello)).kind, 'live');
  await until('a later time and more frames', async () => {
    const now = await state(page);
    return now.time > before.time && now.frame_number > before.frame_number;
  });
  // It can be turned as any run can.
  const keys = await page.evaluate(() => window.palpate.hello.controls.map((control) => control.key));
  assert.ok(keys.includes('contact.method'), keys);
  page.expectsErrors = true;
  assert.ok((await command(page, { command: 'end' })).ok);
  assert.equal(await run.ended, 0, run.errors);
});

pageTest('a tool alone stands upright, y up', async () => {
  const mesh = join(folder, 'pyramid.obj');
  writeFileSync(mesh, ['v 0 0.05 0', 'v -0.05 -0.05 -0.05', 'v 0.05 -0.05 -0.05', 'v 0.05 -0.05 0.05', 'v -0.05 -0.05 0.05',
    'f 1 3 2', 'f 1 4 3', 'f 1 5 4', 'f 1 2 5', 'f 2 3 4', 'f 2 4 5'].join('\n'));
  const pyramid = join(folder, 'pyramid.palp');
  await finished(['pack', mesh, '-o', pyramid, '--spheres', '500']);
  const run = await viewed(['view', pyramid, '--port', '0']);
  const page = await openPage(run.url, { bare: true });
  await until('its spheres', async () => (await page.evaluate(() => window.palpate.hello))?.tool.spheres === 500);
  await options(page, { toolLook: 'mesh' });
  const ground = color('ground');
  // How wide it is in a row of the picture.
  const wide = (picture, v) => {
    let num = 0;
    for (let u = 0; u < picture.width; ++u) num += isJust(picture.at(u, v), ground) ? 0 : 1;
    return num;
  };
  await until('a point at the top', async () => {
    const picture = await look(page);
    const rows = [...Array(picture.height).keys()].filter((v) => wide(picture, v) > 0);
    if (rows.length < 50) return false;
    const [top, bottom] = [0.1, 0.7].map((share) => rows[Math.floor(share * rows.length)]);
    return wide(picture, top) < 0.4 * wide(picture, bottom);
  });
  page.expectsErrors = true;
  await run.stop();
});

pageTest('a tool alone is seen', async () => {
  const run = await viewed(['view', tool, '--port', '0']);
  const page = await openPage(run.url);
  await until('its spheres', async () => (await page.evaluate(() => window.palpate.hello))?.tool.spheres === 1000);
  page.expectsErrors = true;
  await run.stop();
  assert.equal(run.code, 0, run.errors);
});
