// The server goes and comes back; the stream stands still; the loop faults: the page says so.
import assert from 'node:assert/strict';

import { banner, command, drawn, openPage, pageTest, Served, sleep, stat, state, until } from './harness.mjs';
import { lively, oneSphere } from './worlds.mjs';

const says = (page, words) => until(`the page says ${words}`, async () => words.test(await banner(page)));
const isQuiet = (page) => until('no banner', async () => (await banner(page)) === '');

pageTest('the page reconnects when the server is back', async () => {
  const served = await Served.start(oneSphere);
  await served.apply(lively);
  const page = await openPage(served.url, { expectErrors: true });
  await drawn(page);
  await isQuiet(page);

  const { port } = new URL(served.url);
  await served.apply({ server: 'stop' });
  await says(page, /does not answer/);
  const before = await stat(page);
  await served.stop(); // the whole program, as when somebody restarts it

  const again = await Served.start({ ...oneSphere, port: Number(port), title: 'another' });
  await again.apply(lively);
  await until('pictures again', async () => (await stat(page)).pictures > before.pictures + 3);
  await isQuiet(page);
  await until('the new title', async () => (await page.textContent('body')).includes('another'));
  assert.equal((await state(page)).settings['coupling.stiffness'], 800);
});

pageTest('a short loss of the server is survived more than once', async () => {
  const served = await Served.start(oneSphere);
  await served.apply(lively);
  const page = await openPage(served.url, { expectErrors: true });
  for (let i = 0; i < 2; ++i) {
    await drawn(page);
    await served.apply({ server: 'stop' });
    await says(page, /does not answer/);
    await served.apply({ server: 'start' });
  }
  await drawn(page);
  await isQuiet(page);
});

pageTest('a host that takes requests and does not answer them is lost at once', async () => {
  const served = await Served.start(oneSphere);
  await served.apply(lively);
  const page = await openPage(served.url, { expectErrors: true });
  await drawn(page);
  let isSilent = true;
  await page.route('**/api/hello*', (route) => (isSilent ? undefined : route.continue()));
  await served.apply({ server: 'stop' });
  for (let i = 0; i < 20; ++i) {  // whatever it is asked for is answered, and at once
    assert.equal((await command(page, { command: 'pause' })).ok, false);
    await sleep(50);
  }
  await says(page, /does not answer/);
  // The page tries again although nobody has answered its request.
  await served.apply({ server: 'start' });
  await drawn(page);
  isSilent = false;
});

pageTest('a stale stream is said', async () => {
  const served = await Served.start(oneSphere);
  await served.apply(lively);
  const page = await openPage(served.url);
  await drawn(page);
  await isQuiet(page);
  await served.apply({ frozen: true, state: { sensor_age: 3.2 } });
  await says(page, /sent nothing for 3 s/);
  await served.apply({ frozen: false, state: { sensor_age: 0.02 } });
  await drawn(page);
  await isQuiet(page);
  // The program itself stands still.
  await served.apply({ frozen: true });
  await says(page, /Nothing new from Palpate/);
  await served.apply({ frozen: false });
  await drawn(page);
  await isQuiet(page);
});

pageTest('a fault, a note and the end are said in their words', async () => {
  const served = await Served.start(oneSphere);
  await served.apply(lively);
  const page = await openPage(served.url);
  await drawn(page);
  await served.apply({ state: { note: 'The scheduler refused real time.' } });
  await until('the note', async () => (await page.textContent('body')).includes('refused real time'));
  await served.apply({ state: { fault: 'The device has been silent for 60 ms.' } });
  await says(page, /silent for 60 ms/);
  await served.apply({ state: { fault: '<img src=x onerror="window.harmed=1">' } });
  await says(page, /<img/);
  assert.equal(await page.evaluate(() => window.harmed), undefined);
  await served.apply({ state: { fault: null, note: 'Depth frames are held.', force: 'engaged' } });
  await says(page, /are held/);
  const button = page.locator('.banner button');
  assert.equal(await button.isVisible(), false, 'there is a force');
  await served.apply({ state: { force: 'held_off', note: 'too many faults (for 3 s, fault 12)' } });
  await says(page, /too many faults \(for 3 s, fault 12\)/);
  await button.click();
  await served.heard('force');
  await isQuiet(page);
  await served.apply({ state: { running: false } });
  await says(page, /has ended/);
});
