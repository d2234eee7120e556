// First sight, a phone's window, the keyboard.
import assert from 'node:assert/strict';

import { drawn, openPage, pageTest, Served, stat, until } from './harness.mjs';
import { busy, busyNow, lively, oneSphere } from './worlds.mjs';

pageTest('the first picture', async () => {
  const served = await Served.start(busy);
  await served.apply(busyNow);
  const begun = Date.now();
  const page = await openPage(served.url, { width: 1280, height: 720 });
  await until('a picture', async () => (await stat(page)).drawn >= 1 && (await stat(page)).pictures >= 1);
  console.log(`# first picture drawn ${Date.now() - begun} ms after the page was asked for`);
  const sizes = await page.evaluate(() => performance.getEntriesByType('resource')
    .reduce((sum, entry) => sum + entry.encodedBodySize, 0));
  console.log(`# loaded ${Math.round(sizes / 1024)} KiB`);
  assert.ok(sizes < 1 << 20, 'the page is at most 1 MiB, compressed');
});

pageTest('a phone', async () => {
  const served = await Served.start(oneSphere);
  await served.apply(lively);
  const page = await openPage(served.url, { width: 360, height: 640 });
  await drawn(page);
  const wide = () => page.evaluate(() => ({
    scroll: document.scrollingElement.scrollWidth, window: window.innerWidth,
    beyond: [...document.querySelectorAll('body *')].filter((e) => {
      const box = e.getBoundingClientRect();
      return box.width > 0 && box.left >= 0 && box.left < 360 && box.right > 361 &&
        getComputedStyle(e).visibility !== 'hidden';
    }).map((e) => `${e.tagName}.${e.className}`),
  }));
  const shut = await wide();
  assert.equal(shut.scroll, shut.window, `wider than the window: ${shut.beyond}`);
  const canvas = await page.evaluate(() => {
    const { width, height } = document.querySelector('canvas').getBoundingClientRect();
    return width * height;
  });
  assert.ok(canvas > 0.3 * 360 * 640, 'the scene has a good part of the window');

  // Everything can be reached with a finger.
  for (const panel of ['Plots', 'Camera', 'Controls']) {
    const button = page.locator('.dock button', { hasText: panel });
    const box = await button.boundingBox();
    assert.ok(box.x >= 0 && box.x + box.width <= 360 && box.height >= 32, `${panel}: ${JSON.stringify(box)}`);
    await button.click();
    await drawn(page, 1);
    const open = await wide();
    assert.equal(open.scroll, open.window, `${panel}, wider than the window: ${open.beyond}`);
  }
  await page.locator('.controls .lil-title', { hasText: 'Coupling' }).click();
  const input = page.locator('.controls [title*="(coupling.stiffness)"] input');
  await input.fill('500');
  await input.press('Enter');
  assert.equal((await served.heard('set')).value, 500);
});

pageTest('panels do not cover each other', async () => {
  const served = await Served.start(busy);
  await served.apply(busyNow);
  for (const [width, height] of [[800, 500], [1024, 600], [1280, 720], [1366, 768], [1920, 1080]]) {
    const page = await openPage(served.url, { width, height });
    await drawn(page);
    for (const panel of ['Plots', 'Camera', 'Controls']) {
      const button = page.locator('.dock button', { hasText: panel });
      if (await button.getAttribute('aria-pressed') !== 'true') await button.click();
    }
    await drawn(page, 1);
    const boxes = await page.evaluate(() => ['readouts', 'legend', 'plots', 'image', 'controls'].map((name) => {
      const card = document.querySelector(`.${name}`);
      const { left, top, right, bottom } = card.getBoundingClientRect();
      return { name, left, top, right, bottom };
    }).filter((box) => box.right > box.left && box.bottom > box.top));
    assert.ok(boxes.length >= 4, `${width} x ${height}: ${boxes.map((box) => box.name)}`);
    for (const a of boxes) {
      for (const b of boxes) {
        if (a.name >= b.name) continue;
        const over = Math.min(a.right, b.right) - Math.max(a.left, b.left);
        const deep = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
        assert.ok(over <= 1 || deep <= 1, `${width} x ${height}: ${a.name} covers ${b.name} by ${over} x ${deep}`);
      }
    }
    await page.close();
  }
});

pageTest('help comes by the question mark and goes by escape', async () => {
  const served = await Served.start(oneSphere);
  await served.apply(lively);
  const page = await openPage(served.url);
  await drawn(page);
  const help = async () => (await page.evaluate(() => document.body.innerText)).toLowerCase();
  const without = await help();
  await page.keyboard.press('?');
  const words = await until('help', async () => {
    const now = await help();
    return now.length > without.length + 40 && now;
  });
  for (const word of ['pause', 'view']) assert.ok(words.includes(word), `help names ${word}`);
  await page.keyboard.press('Escape');
  await until('no help', async () => (await help()).length < without.length + 40);
});

pageTest('the colors are explained on the page', async () => {
  const served = await Served.start(oneSphere);
  await served.apply(lively);
  const page = await openPage(served.url);
  await drawn(page);
  const words = (await page.evaluate(() => document.body.innerText)).toLowerCase();
  for (const word of ['inside', 'cut by the surface', 'outside']) assert.ok(words.includes(word), word);
});
