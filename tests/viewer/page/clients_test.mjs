// Several pages at once: none waits for another.
import assert from 'node:assert/strict';

import { browser, drawn, openPage, pageTest, Served, sleep, stat, state, until } from './harness.mjs';
import { busy, busyNow, lively, oneSphere } from './worlds.mjs';

/// A page of the server without its program, in which tests open sockets of their own.
async function barePage(served) {
  const page = await browser.newPage();
  await page.goto(served.address('/favicon.svg'));
  return page;
}

/// Opens a socket in `page` that wants `subscription`, and counts what comes. It acknowledges pictures
/// only if told to.
const listen = (page, served, subscription, acknowledges) => page.evaluate(
  async ([address, show, acks]) => {
    const socket = new WebSocket(address);
    socket.binaryType = 'arraybuffer';
    const counts = window.counts ??= [];
    const count = { pictures: 0, states: 0, bytes: 0, kinds: {} };
    counts.push(count);
    socket.onmessage = ({ data }) => {
      if (typeof data !== 'string') {
        const kind = new DataView(data).getUint16(0, true);
        count.kinds[kind] = (count.kinds[kind] ?? 0) + 1;
        count.bytes += data.byteLength;
        return;
      }
      const message = JSON.parse(data);
      if (message.type === 'state') ++count.states;
      if (message.type === 'picture') {
        ++count.pictures;
        if (acks) socket.send(JSON.stringify({ ack: message.number }));
      }
    };
    await new Promise((resolve, reject) => { socket.onopen = resolve; socket.onerror = reject; });
    socket.send(JSON.stringify({ id: 1, command: 'show', ...show }));
    return counts.length - 1;
  }, [served.address('/ws', 'ws:'), subscription, acknowledges]);

/// Of each plot, how many pixels of its curves' area are of a color, not gray.
const curves = (page) => page.evaluate(() => [...document.querySelectorAll('.plots canvas')].map((canvas) => {
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  let number = 0;
  for (let i = 0; i < data.length; i += 4) {
    const [low, , high] = [data[i], data[i + 1], data[i + 2]].sort((a, b) => a - b);
    if (data[i + 3] > 128 && high - low > 60) ++number;
  }
  return number;
}));

const counts = (page, number) => page.evaluate((i) => window.counts[i], number);

pageTest('pages with different subscriptions both continue', async () => {
  const served = await Served.start(oneSphere);
  await served.apply(lively);
  const page = await openPage(served.url);
  const bare = await barePage(served);
  const onlySamples = await listen(bare, served, { samples: true }, true);
  const onlyContacts = await listen(bare, served, { contacts: true }, true);
  await drawn(page, 5);
  await until('samples without frames', async () => (await counts(bare, onlySamples)).pictures > 5);
  await until('contacts', async () => (await counts(bare, onlyContacts)).pictures > 5);
  assert.deepEqual(Object.keys((await counts(bare, onlySamples)).kinds), ['20']);
  assert.deepEqual(Object.keys((await counts(bare, onlyContacts)).kinds), ['11']);
  await until('the state counts three', async () => (await state(page)).pages === 3);
  await bare.close();
  await until('the state counts one', async () => (await state(page)).pages === 1);
});

pageTest('a page that joins a paused run shows its last seconds', async () => {
  const served = await Served.start(oneSphere);
  await served.apply(lively);
  const first = await openPage(served.url);
  await until('three seconds of samples', async () => (await stat(first)).samples > 3000);
  await served.apply({ frozen: true });
  await sleep(3000);
  const newest = (page) => page.evaluate(() => window.palpate.sample.time);
  const second = await openPage(served.url);
  await until('its samples', async () => (await stat(second)).samples > 2000);
  await until('the same sample', async () => Math.abs((await newest(second)) - (await newest(first))) < 5e-4);
  const readouts = (page) => page.locator('.readouts').innerText();
  await until('the same numbers', async () => (await readouts(second)) === (await readouts(first)));
  const [plot] = await curves(second);
  assert.ok(plot > 30, `the plot of the force has ${plot} colored pixels`);
  await second.close();
});

pageTest('a page that never acknowledges gets one picture and stops nobody', async () => {
  const served = await Served.start(busy); // a backlog would be tens of MiB a second
  await served.apply(busyNow);
  const page = await openPage(served.url);
  const bare = await barePage(served);
  const subscription = { frames: true, contacts: true, surfaces: true, samples: true };
  const slow = await listen(bare, served, subscription, false);
  await until('its first picture', async () => (await counts(bare, slow)).pictures === 1);
  const { bytes } = await counts(bare, slow);
  await drawn(page, 5);
  const { states } = await counts(bare, slow);
  await until('states still come', async () => (await counts(bare, slow)).states >= states + 2);
  const after = await counts(bare, slow);
  assert.equal(after.pictures, 1);
  assert.equal(after.bytes, bytes);
  const before = await served.apply();
  await drawn(page, 5);
  const later = await served.apply();
  assert.ok(later.rss_kib - before.rss_kib < 4096, 'what it missed is not kept');
  await bare.close();
});

pageTest('one page too many is refused and the others go on', async () => {
  const served = await Served.start({ ...oneSphere, max_pages: 2 });
  await served.apply(lively);
  const page = await openPage(served.url);
  await drawn(page);
  const bare = await barePage(served);
  await listen(bare, served, { samples: true }, true);
  await assert.rejects(listen(bare, served, { samples: true }, true));
  await drawn(page, 3);
  await bare.close();
});
