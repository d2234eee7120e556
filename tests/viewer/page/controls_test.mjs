// Every control and command: from the page to the program and back.
import assert from 'node:assert/strict';

import { banner, command, drawn, openPage, options, pageTest, Served, stat, state, until } from './harness.mjs';
import { controls, lively, oneSphere } from './worlds.mjs';

/// What else a control can be than it is.
const others = ({ kind, choices, low, high, value }) =>
  kind === 'choice' ? choices.filter((choice) => choice !== value)
    : kind === 'switch' ? [!value, value]
      : [low, high, (low + 2 * high) / 3, ...(choices ?? [])];

async function begin(script = oneSphere) {
  const served = await Served.start(script);
  await served.apply(lively);
  const page = await openPage(served.url);
  await drawn(page);
  return { served, page };
}

pageTest('every control by its command', async () => {
  const { served, page } = await begin();
  let revisions = 0;
  for (const control of controls) {
    for (const value of others(control)) {
      const answer = await command(page, { command: 'set', key: control.key, value });
      assert.ok(answer.ok, answer.error);
      const heard = await served.heard('set');
      assert.deepEqual([heard.key, heard.value], [control.key, value]);
      const now = await until(`${control.key} = ${value} in the state`, async () => {
        const seen = await state(page);
        return seen.settings[control.key] === value && seen;
      });
      assert.equal(now.revision, ++revisions);
    }
  }
});

pageTest('every control by hand, and what another page turns is shown', async () => {
  const { served, page } = await begin();
  await page.evaluate(() => document.querySelectorAll('.controls .lil-title').forEach((title) => {
    if (title.getAttribute('aria-expanded') === 'false') title.click();
  }));
  for (const control of controls) {
    const [value] = others(control);
    const row = page.locator(`.controls [title*="(${control.key})"]`);
    await row.scrollIntoViewIfNeeded();
    if (control.kind === 'choice') {
      await row.locator('select').selectOption({ label: value });
    } else if (control.kind === 'switch') {
      await row.locator('input').click();
    } else {
      const input = row.locator('input');
      await input.fill(String(value));
      await input.press('Enter');
    }
    const heard = await served.heard('set');
    assert.deepEqual([heard.key, heard.value], [control.key, value]);
    await until(`${control.key} in the state`, async () => (await state(page)).settings[control.key] === value);
  }
  // A number that may be a word is typed, and shown again as either.
  const friction = page.locator('.controls [title*="(objects.block.friction)"] input');
  assert.equal(await friction.inputValue(), '0');
  for (const value of ['auto', 0.25]) {
    await friction.fill(` ${value} `);
    await friction.press('Enter');
    assert.equal((await served.heard('set')).value, value);
    await until(`${value} in the state`, async () => (await state(page)).settings['objects.block.friction'] === value);
  }
  // As a script would do it.
  await page.evaluate(() => document.activeElement?.blur());
  const answer = await fetch(served.address('/api/command'), {
    method: 'POST', body: JSON.stringify({ command: 'set', key: 'coupling.damping', value: 1.25 }),
  });
  assert.equal(answer.status, 200);
  await until('the page shows it', () => page.evaluate(() => {
    const row = document.querySelector('.controls [title*="(coupling.damping)"]');
    return Number(row.querySelector('input').value) === 1.25;
  }));
  await fetch(served.address('/api/command'), {
    method: 'POST', body: JSON.stringify({ command: 'set', key: 'objects.block.friction', value: 'auto' }),
  });
  await until('the word is shown', async () => await friction.inputValue() === 'auto');
});

pageTest('a value that is refused is said, and the old one shown', async () => {
  const { served, page } = await begin();
  for (const [key, value] of [['coupling.stiffness', 1e9], ['coupling.stiffness', 'much'], ['contact.method', 'magic'],
    ['surface.filter', 3], ['objects.block.friction', 11], ['objects.block.friction', 'rough'],
    ['objects.other.friction', 1], ['no.such', 1]]) {
    const answer = await command(page, { command: 'set', key, value });
    assert.equal(answer.ok, false);
    assert.match(answer.error, new RegExp(key.replace('.', '\\.')));
  }
  // By hand.
  await page.evaluate(() => document.querySelectorAll('.controls .lil-title').forEach((title) => {
    if (title.getAttribute('aria-expanded') === 'false') title.click();
  }));
  const input = page.locator('.controls [title*="(coupling.stiffness)"] input');
  await input.fill('99999');
  await input.press('Enter');
  await until('the banner says it', async () => /coupling\.stiffness/.test(await banner(page)));
  await page.evaluate(() => document.activeElement?.blur());
  await until('the old value', async () => Number(await input.inputValue()) === 800);
  assert.equal((await state(page)).settings['coupling.stiffness'], 800);
  assert.equal((await served.apply()).pages, 1);
});

pageTest('the commands of a live run', async () => {
  const { served, page } = await begin();
  for (const [name, more, reached] of [
    ['pause', {}, (now) => now.paused],
    ['resume', {}, (now) => !now.paused],
    ['step', { frames: 1 }, (now) => now.paused],
    ['mark', { text: 'äöü "quoted" <b>' }, () => true],
  ]) {
    const answer = await command(page, { command: name, ...more });
    assert.ok(answer.ok, answer.error);
    const heard = await served.heard(name);
    for (const [key, value] of Object.entries(more)) assert.equal(heard[key], value);
    await until(name, async () => reached(await state(page)));
  }
  assert.equal((await command(page, { command: 'no such' })).ok, false);
  // Keys: the space bar pauses and goes on, m marks.
  await page.keyboard.press('Space');
  await served.heard('resume');
  await until('going on', async () => !(await state(page)).paused);
  await page.keyboard.press('Space');
  await served.heard('pause');
  await page.keyboard.press('.');
  await served.heard('step');
  await page.keyboard.press('m');
  await served.heard('mark');
  const answer = await command(page, { command: 'end' });
  assert.ok(answer.ok, answer.error);
  await until('the end', async () => /ended/.test(await banner(page)));
});

pageTest('the commands of a recording', async () => {
  const { served, page } = await begin({ ...oneSphere, kind: 'recording' });
  for (const [name, more, reached] of [
    ['pause', {}, (now) => now.paused],
    ['seek', { time: 12.5 }, (now) => Math.abs(now.time - 12.5) < 1e-9],
    ['step', { frames: -3 }, (now) => Math.abs(now.time - 12.4) < 1e-9],
    ['speed', { factor: 0.01 }, (now) => now.speed === 0.01], // a busy machine takes seconds to show what follows
    ['resume', {}, (now) => !now.paused && now.time > 12.4],
  ]) {
    const answer = await command(page, { command: name, ...more });
    assert.ok(answer.ok, answer.error);
    await served.heard(name);
    await until(name, async () => reached(await state(page)));
  }
  for (const wrong of [{ command: 'seek', time: 1e6 }, { command: 'speed', factor: 0 }, { command: 'seek' }]) {
    const answer = await command(page, wrong);
    assert.equal(answer.ok, false);
    assert.ok(answer.error.length > 5);
  }
  // By hand: the slider.
  served.lines.splice(0);
  await page.locator('.timeline input[type=range]').fill('30');
  assert.equal((await served.heard('seek')).time, 30);
  await until('30 s', async () => Math.abs((await state(page)).time - 30) < 2);
});

pageTest('what is stored is got once, what nobody wants is not sent', async () => {
  const { page } = await begin();
  await options(page, { toolLook: 'spheres', graph: true, treeLevel: 2 });
  await drawn(page, 3);
  await options(page, { toolLook: 'mesh' });
  await drawn(page, 3);
  assert.ok((await stat(page)).pictures > 0);
});
