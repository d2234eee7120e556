// Reports in a real browser, as a double click opens them: their numbers are those of the files
// beside them, plots zoom, and they are readable on a phone, in the dark and on paper.
import assert from 'node:assert/strict';
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after } from 'node:test';
import { pathToFileURL } from 'node:url';

import { color, isJust, isLit, isPale } from './colors.mjs';
import { decoded, evaluation, openPage, pageTest, runProgram, until } from './harness.mjs';

const folder = mkdtempSync(join(tmpdir(), 'palpate-report-'));
after(() => rmSync(folder, { recursive: true, force: true }));
const address = (...parts) => pathToFileURL(join(folder, ...parts)).href;

async function finished(args, which) {
  const run = await runProgram(args, which);
  assert.equal(await run.ended, 0, `${args.join(' ')}\n${run.errors}`);
}

const hasEvaluation = existsSync(evaluation); // else make long-test looks at its report
const tool = join(folder, 'tool.palp');
let isMade = false;
/// A tool with its page, and runs with theirs: along a path, with a hand, against a block that it pushes
/// over a table, and before two cameras.
async function make() {
  if (isMade) return;
  isMade = true;
  const mesh = join(folder, 'shape.ply');
  await finished(['shape', 'stylus', '-o', mesh]);
  await finished(['pack', mesh, '-o', tool, '--spheres', '1000', '--report', join(folder, 'packing.html')]);
  await finished(['touch', tool, '--scene', 'hand', '--duration', '4', '-o', join(folder, 'path')]);
  await finished(['touch', tool, '--scene', 'hand', '--device', 'sim', '--duration', '3', '-o', join(folder, 'hand')]);
  const block = join(folder, 'block.palp'), push = join(folder, 'push.tum'), around = join(folder, 'around.tum');
  await finished(['shape', 'box', '--size', '0.05', '-o', mesh]);
  await finished(['pack', mesh, '-o', block, '--spheres', '300']);
  writeFileSync(push, '0 -0.295 0.1 1.03 1 0 0 0\n2 -0.195 0.1 1.03 1 0 0 0\n');
  await finished(['touch', tool, '--scene', 'hand', '--path', push, '--set', 'bodies.gravity_y=0', '--set', 'bodies.gravity_z=9.81',
    '--object', `${block}@-0.25 0.1 1.07 0 0 0 1,moving`, '-o', join(folder, 'pushed')]);
  writeFileSync(around, '0 0.62 0 1.5 0 0 0 1\n1 0.575 0 1.5 0 0 0 1\n');
  await finished(['touch', block, '--path', around, '--camera', 'scene:sphere-out-320',
    '--camera', 'scene:sphere-out-320?pose=1.4,0,1,0,-0.574,0,0.819', '-o', join(folder, 'two')]);
  // With pictures of both kinds, plots of each kind of axis, and a verdict against the thesis.
  if (hasEvaluation) await finished(['--quick', '-o', join(folder, 'evaluation'), '3.2', '4.4', '4.5-4.7', 'noise'], evaluation);
}

/// Opens a report and waits until it is drawn.
async function openReport(where, how = {}) {
  const page = await openPage(address(...where), { width: 1200, height: 900, ...how });
  await page.waitForFunction(() => window.palpate?.governor); // the page may still be read
  await page.evaluate(() => { window.palpate.governor.enabled = false; }); // pictures are compared
  await until('a footer', () => page.locator('footer').count());
  // A plot is drawn when a reader comes near it.
  await until('all plots', () => page.evaluate(() => {
    const next = [...document.querySelectorAll('.plot .area')].find((area) => !area.querySelector('canvas'));
    next?.scrollIntoView();
    if (!next) scrollTo(0, 0);
    return !next;
  }));
  return page;
}

/// Writes a report with other data in it.
function changed(name, change) {
  const before = readFileSync(join(folder, name, 'report.html'), 'utf8');
  const after = before.replace(/(id="data">)(.*)(?=<\/script>)/, (_, begin, text) => {
    const data = JSON.parse(text);
    change(data);
    return begin + JSON.stringify(data).replaceAll('<', '\\u003c');
  });
  assert.notEqual(after, before);
  writeFileSync(join(folder, 'changed.html'), after);
  return ['changed.html'];
}

/// How many of the canvases of a kind show one color only.
const empty = (page, selector) => page.evaluate((wanted) =>
  [...document.querySelectorAll(wanted)].filter((canvas) => {
    const { width, height } = canvas;
    if (width === 0 || height === 0) return true;
    const data = new Uint32Array(canvas.getContext('2d').getImageData(0, 0, width, height).data.buffer);
    return new Set(data).size < 4;
  }).length, selector);

/// Its 3-D picture, once it stands still.
async function stillPicture(page) {
  let before = Buffer.alloc(0);
  return decoded(await until('a picture that stands still', async () => {
    const picture = await page.locator('canvas.scene').screenshot();
    const stands = before.equals(picture);
    before = picture;
    return stands && picture;
  }));
}
/// Counts the pixels of its 3-D picture that are as `wanted` says, once it stands still.
async function count(page, wanted) {
  const picture = await stillPicture(page);
  let found = 0;
  for (let v = 0; v < picture.height; ++v) for (let u = 0; u < picture.width; ++u) found += wanted(picture.at(u, v)) ? 1 : 0;
  return found;
}
/// Recognizes small words in the dark; what else is bright is not bluish.
const isText = (rgb) => Math.min(...rgb) > 190 && rgb[2] >= rgb[0];
const isShaded = (name) => (rgb) => isLit(rgb, color(name)) || isPale(rgb, color(name));

/// Whether its 3-D picture shows these colors of the scene.
async function seen(page, names) {
  const picture = await decoded(await page.locator('canvas.scene').screenshot());
  const found = new Set();
  for (let v = 0; v < picture.height; ++v) {
    for (let u = 0; u < picture.width; ++u) {
      for (const name of names) {
        const rgb = picture.at(u, v);
        if (!found.has(name) && (isLit(rgb, color(name)) || isPale(rgb, color(name)))) found.add(name);
      }
    }
  }
  return names.every((name) => found.has(name));
}

const cardTexts = (page) => page.locator('.card b').allInnerTexts();

/// Reads the first and the last time, s, that a plot shows, in its legend, where one points at them.
async function shownTimes(page, plot) {
  await plot.scrollIntoViewIfNeeded();
  const { x, y, width, height } = await plot.locator('.u-over').boundingBox();
  const times = [];
  for (const u of [x + 1, x + width - 1]) {
    await page.mouse.move(u, y + height / 2);
    times.push(parseFloat(await plot.locator('.u-legend .u-value').first().innerText()));
  }
  return times;
}

pageTest('a run: its numbers are those of summary.json', async () => {
  await make();
  const page = await openReport(['path', 'report.html']);
  const summary = JSON.parse(readFileSync(join(folder, 'path', 'summary.json')));
  const [force, torque, volume, contact, cameras] = await cardTexts(page);
  const [value, unit] = volume.split(/\s/);
  const factor = { 'mm³': 1e9, 'cm³': 1e6 }[unit];
  assert.ok(Math.abs(Number(value) / (factor * summary.peaks.volume_m3) - 1) < 6e-3, `${volume}, ${summary.peaks.volume_m3}`);
  assert.ok(Math.abs(parseFloat(force) / summary.peaks.force_N - 1) < 6e-3, `${force}, ${summary.peaks.force_N}`);
  const number = (words, units) => parseFloat(words) / units[words.split(/\s(.*)/)[1]];
  for (const [words, units, wanted] of [[torque, { 'N m': 1, 'N mm': 1e3 }, summary.peaks.torque_Nm],
    [contact, { s: 1, ms: 1e3 }, (summary.seconds * summary.ticks_in_contact) / summary.ticks]]) {
    assert.ok(Math.abs(number(words, units) / wanted - 1) < 6e-3, `${words}, ${wanted}`);
  }
  assert.equal(cameras, '1');
  const verdict = await page.locator('.verdict').innerText();
  const [, rate, kept, share] = verdict.match(/^([\d.]+) kHz (kept|not kept): ([\d.]+)\s% of \d+ ticks took less than 1\sms/);
  assert.equal(Number(rate), summary.rate / 1000);
  assert.ok(Math.abs(share / (100 * (1 - summary.missed / summary.ticks)) - 1) < 6e-3, verdict);
  assert.equal(kept, summary.missed <= 0.01 * summary.ticks ? 'kept' : 'not kept');
  const text = await page.locator('main').innerText();
  for (const words of [summary.tool.source, `of ${summary.ticks} ticks`, 'the path has ended',
    'What the tool felt', 'How long it took', 'The deepest moment, at', '640 × 480']) {
    assert.ok(text.includes(words), words);
  }
  assert.ok(!text.includes('What the hand felt'));
  assert.ok(!/NaN|undefined|null/.test(text), text.match(/.*(NaN|undefined|null).*/)?.[0]);
  assert.equal(await empty(page, '.plot canvas'), 0);
  assert.equal(await page.locator('.plot').count(), 4);
});

pageTest('a run: its times may begin shortly before a power of ten', async () => {
  await make();
  const page = readFileSync(join(folder, 'path', 'report.html'), 'utf8');
  const other = page.replace(/("latencies":{"[a-z_]+":)\[(\[[^\]]*\],?)*\]/, '$1[[9.7,7999],[97,1]]');
  assert.notEqual(page, other);
  writeFileSync(join(folder, 'other.html'), other);
  const shown = await openReport(['other.html']);
  assert.equal(await empty(shown, '.plot canvas'), 0);
  assert.deepEqual(shown.problems, []);
});

pageTest('a run: the deepest moment shows cloud, tool and wrench', async () => {
  await make();
  const page = await openReport(['path', 'report.html'], { colorScheme: 'light' });
  await until('force, torque and the inside of the tool', () => seen(page, ['force', 'torque', 'inside']));
  await page.getByRole('button', { name: 'no cloud' }).click();
  await until('a picture without a cloud', async () => {
    const picture = await decoded(await page.locator('canvas.scene').screenshot());
    let ground = 0;
    for (let v = 0; v < picture.height; v += 4) {
      for (let u = 0; u < picture.width; u += 4) ground += isJust(picture.at(u, v), [244, 245, 247]) ? 1 : 0;
    }
    return ground > 0.7 * (picture.width / 4) * (picture.height / 4);
  });
});

pageTest('a run: dragging zooms all plots of time to what was dragged, a double click shows all again', async () => {
  await make();
  const page = await openReport(['hand', 'report.html']);
  assert.ok((await page.locator('main').innerText()).includes('What the hand felt'));
  assert.equal(await empty(page, '.plot canvas'), 0);
  const whole = page.locator('.whole:visible');
  const plots = page.locator('.plot');
  const numTime = (await plots.count()) - 1; // all but the one of latencies
  const sides = await page.evaluate(() => [...document.querySelectorAll('.plot .u-over')].map((over) => {
    const { left, right } = over.getBoundingClientRect();
    return `${left} ${right}`;
  }));
  assert.equal(new Set(sides.slice(0, numTime)).size, 1, `plots of time below each other: ${sides}`);
  const [first, last] = await shownTimes(page, plots.first());
  for (const dragged of [0, 1, numTime - 1]) {
    assert.equal(await whole.count(), 0);
    const plot = plots.nth(dragged);
    await plot.scrollIntoViewIfNeeded();
    const { x, y, width } = await plot.locator('.u-over').boundingBox();
    await page.mouse.move(x + 0.25 * width, y + 40);
    await page.mouse.down();
    await page.mouse.move(x + 0.75 * width, y + 60, { steps: 40 });
    await page.mouse.up();
    await until('zoomed plots', async () => (await whole.count()) === numTime);
    for (let i = 0; i < numTime; ++i) {
      const [from, to] = await shownTimes(page, plots.nth(i));
      const near = 0.01 * (last - first);
      assert.ok(Math.abs(from - (first + 0.25 * (last - first))) < near && Math.abs(to - (first + 0.75 * (last - first))) < near,
        `dragged plot ${dragged}, plot ${i}: ${from} to ${to} s of ${first} to ${last} s`);
    }
    assert.equal(await empty(page, '.plot canvas'), 0);
    await plot.scrollIntoViewIfNeeded();
    const at = await plot.locator('.u-over').boundingBox();
    await page.mouse.dblclick(at.x + 0.5 * at.width, at.y + 50);
    await until('all again', async () => (await whole.count()) === 0);
    assert.deepEqual(await shownTimes(page, plots.first()), [first, last]);
  }
});

pageTest('a run: arrows have the scale of its largest force and torque, with their values beside them', async () => {
  await make();
  const page = await openReport(['path', 'report.html']);
  const { moment, summary: { peaks } } = JSON.parse(
    readFileSync(join(folder, 'path', 'report.html'), 'utf8').match(/id="data">(.*)<\/script>/)[1]);
  const text = await page.locator('main').innerText();
  for (const [words, value, unit] of [
    ['force on the tool: ', Math.hypot(...moment.force_N), 'N'], ['torque on the tool: ', 1000 * Math.hypot(...moment.torque_Nm), 'N mm'],
    ['at the largest of the run: ', peaks.force_N, 'N'], ['N and ', 1000 * peaks.torque_Nm, 'N mm']]) {
    const [, number, found] = text.match(new RegExp(`${words}([\\d.]+)\\s(N mm|N)`));
    assert.equal(found, unit, words);
    assert.ok(Math.abs(number / value - 1) < 6e-3, `${words}${number} ${found}, ${value}`);
  }
  await page.getByRole('button', { name: 'no cloud' }).click();
  assert.ok(await count(page, isText) > 40, 'values at the arrows');
  // The same moment in a run with larger ones.
  const other = await openReport(changed('path', ({ summary }) => {
    summary.peaks.force_N *= 3;
    summary.peaks.torque_Nm *= 3;
  }));
  await other.getByRole('button', { name: 'no cloud' }).click();
  for (const name of ['force', 'torque']) {
    const [long, short] = [await count(page, isShaded(name)), await count(other, isShaded(name))];
    assert.ok(short > 0.1 * long && short < 0.6 * long, `${name}: ${short} of ${long} pixels`);
  }
});

pageTest('a run: pointing at a plot moves the tool in the picture, which stays in view', async () => {
  await make();
  const page = await openReport(['path', 'report.html']);
  const data = JSON.parse(readFileSync(join(folder, 'path', 'report.html'), 'utf8').match(/id="data">(.*)<\/script>/)[1]);
  const { series, summary: { peaks } } = data;
  const plot = page.locator('.plot').first();
  // Without a pointer, the legend has the values of the deepest moment.
  const shown = async () => parseFloat(await plot.locator('.u-legend .u-value').first().innerText());
  assert.ok(Math.abs(await shown() - peaks.volume_time_s) < 0.01, `${await shown()} and ${peaks.volume_time_s} s`);
  const deepest = await count(page, isShaded('inside'));
  assert.ok(deepest > 20);
  await plot.scrollIntoViewIfNeeded();
  await page.evaluate(() => scrollBy(0, innerHeight));
  const last = page.locator('.plot').nth(2), at = await last.locator('.u-over').boundingBox();
  await page.mouse.move(at.x + 2, at.y + 0.5 * at.height);
  await until('words about another moment', async () => (await page.locator('.when').innerText()).startsWith('the tool at 0'));
  assert.equal(await page.locator('.stage.floating').count(), 1);
  const { top, bottom } = await page.evaluate(() => document.querySelector('canvas.scene').getBoundingClientRect().toJSON());
  assert.ok(top >= 0 && bottom <= 900, `${top} to ${bottom}`);
  await page.addStyleTag({ content: '.when { visibility: hidden; }' }); // is in the pictures, too
  const early = await stillPicture(page);
  await page.mouse.move(at.x + 0.3 * at.width, at.y + 0.5 * at.height);
  await until('words about a later moment', async () => !(await page.locator('.when').textContent()).startsWith('the tool at 0'));
  const late = await stillPicture(page);
  let num = 0;
  for (let v = 0; v < early.height; ++v) for (let u = 0; u < early.width; ++u) num += String(early.at(u, v)) === String(late.at(u, v)) ? 0 : 1;
  assert.ok(num > 30 && num < 0.2 * early.width * early.height, `the tool alone has moved: ${num} pixels`);
  assert.ok(series.tool_x_m.length === series.time_s.length && series.tool_qw.every((w) => Math.abs(w) <= 1));
  await page.mouse.move(at.x + 2, at.y - 400);
  await page.evaluate(() => scrollTo(0, 0));
  await page.mouse.move(5, 5);
  await until('the picture at its place', async () => (await page.locator('.stage.floating').count()) === 0);
  assert.ok(Math.abs(await count(page, isShaded('inside')) / deepest - 1) < 0.2);
});

pageTest('a run without contact: what was nearest, and when', async () => {
  await make();
  const page = await openReport(changed('path', (data) => {
    data.summary.peaks = { ...data.summary.peaks, volume_m3: 0, fraction: 0, force_N: 0, torque_Nm: 0 };
    Object.assign(data.moment, { volume_m3: 0, force_N: [0, 0, 0], torque_Nm: [0, 0, 0] });
    data.nearest = { distance_m: 0.351, time_s: 2.1 };
  }));
  const text = await page.locator('main').innerText();
  assert.match(text, /The tool never touched the surface/);
  assert.match(text, /It was nearest at 2\.1 s: 350\smm away/);
  assert.ok(!/NaN|undefined/.test(text));
});

pageTest('a run: objects are in the picture, and what is felt of them is said to be theirs', async () => {
  await make();
  const page = await openReport(['pushed', 'report.html']);
  assert.match(await page.locator('.card').nth(2).innerText(), /in objects/);
  assert.match(await page.locator('h2').first().innerText(), /^The deepest moment, at .* s, in objects$/);
  assert.match(await page.locator('.below').innerText(), /depth images and 1 object /);
  assert.ok(await count(page, isShaded('wood')) > 500, 'the block');
  const cloud = await openReport(['path', 'report.html']);
  assert.ok(!(await cloud.locator('main').innerText()).includes('in objects'));
});

pageTest('a run: all cameras are in the picture, and counted', async () => {
  await make();
  const page = await openReport(['two', 'report.html']);
  const text = await page.locator('main').innerText();
  for (const words of ['seen by 2 cameras', 'the depth images of 2 cameras', 'camera 1: image', 'camera 2: image']) {
    assert.ok(text.includes(words), words);
  }
  const alone = await openReport(changed('two', ({ moment }) => moment.cameras.pop()));
  const isDrawn = (rgb) => !isJust(rgb, color('ground'));
  const [both, first] = [await count(page, isDrawn), await count(alone, isDrawn)];
  assert.ok(both > 1.2 * first, `${both} and ${first} pixels`);
  await page.getByRole('button', { name: 'above' }).click();
  assert.ok(await count(page, isText) > 40, 'their names');
});

pageTest('two runs: their difference is that of wrench.csv, pointing moves the tool', async () => {
  await make();
  const [before, after] = ['path', 'retried'].map((name) => join(folder, name));
  await finished(['replay', before, '-o', after, '--method', 'graph']);
  await finished(['report', before, after, '-o', join(folder, 'both.html')]);
  const page = await openReport(['both.html']);
  const forces = [before, after].map((run) => {
    const [head, ...rows] = readFileSync(join(run, 'wrench.csv'), 'utf8').trim().split('\n').map((line) => line.split(','));
    return rows.map((row) => ['x', 'y', 'z'].map((axis) => Number(row[head.indexOf(`force_${axis}_N`)])));
  });
  const apart = Math.max(...forces[0].map((force, i) => Math.hypot(...force.map((value, k) => value - forces[1][i][k]))));
  const texts = await cardTexts(page);
  assert.ok(apart > 0.01 && Math.abs(parseFloat(texts.at(-1)) / apart - 1) < 0.01, `${texts.at(-1)}, ${apart} N`);
  const peaks = [before, after].map((run) => JSON.parse(readFileSync(join(run, 'summary.json'))).peaks.force_N);
  texts[0].split('→').forEach((words, i) => assert.ok(Math.abs(parseFloat(words) / peaks[i] - 1) < 6e-3, `${words}, ${peaks[i]} N`));
  const text = await page.locator('main').innerText();
  assert.match(text, /contact\.method\s+field\s+graph/);
  assert.ok(!text.includes('moves differently') && !/NaN|undefined|null/.test(text), text);
  assert.equal(await empty(page, '.plot canvas'), 0);
  const plot = page.locator('.plot').first();
  await plot.scrollIntoViewIfNeeded();
  const at = await plot.locator('.u-over').boundingBox();
  await page.mouse.move(at.x + 2, at.y + 0.5 * at.height);
  await until('the tool at its start', async () => (await page.locator('.when').innerText()).startsWith('the tool at 0'));
});

pageTest('an evaluation: every claim is there, curves go where their numbers are', async () => {
  if (!hasEvaluation) return;
  await make();
  const page = await openReport(['evaluation', 'index.html'], { colorScheme: 'light' });
  const figure = (id) => JSON.parse(readFileSync(join(folder, 'evaluation', 'data', `${id}.json`)));
  const text = await page.locator('main').innerText();
  for (const id of ['4.5-4.7', 'noise']) {
    for (const { claim, measured, verdict } of figure(id).claims) {
      for (const words of [claim, measured, verdict]) assert.ok(text.includes(words), words);
    }
  }
  assert.ok(text.indexOf('Results against') < text.indexOf('Claims of the thesis', 200));
  assert.ok(!/NaN|undefined|null/.test(text), text.match(/.*(NaN|undefined|null).*/)?.[0]);
  assert.equal(await page.locator('canvas.scene').count(), 5);
  assert.equal(await empty(page, '.plot canvas'), 0);
  // A marked point has the color of its curve; beside it there is none.
  const [plot] = figure('noise').plots, curve = plot.curves.find(({ style }) => style === 'graph');
  const found = await page.locator('.plot').first().evaluate((root, { x, y, low, high }) => {
    const canvas = root.querySelector('canvas'), over = root.querySelector('.u-over').getBoundingClientRect();
    const size = canvas.width / canvas.getBoundingClientRect().width, frame = canvas.getBoundingClientRect();
    const color = getComputedStyle(document.documentElement).getPropertyValue('--graph').trim();
    const rgb = [1, 3, 5].map((at) => parseInt(color.slice(at, at + 2), 16));
    const share = (value, from, to) => (Math.log(value) - Math.log(from)) / (Math.log(to) - Math.log(from));
    const u = over.left - frame.left + over.width * x;
    const v = over.top - frame.top + over.height * (1 - share(y, low / 1.3, high * 1.3));
    const at = (dv) => [...canvas.getContext('2d').getImageData(Math.round(u * size), Math.round((v + dv) * size), 1, 1).data];
    const isCurve = (pixel) => rgb.every((value, i) => Math.abs(pixel[i] - value) < 40);
    return [isCurve(at(0)), isCurve(at(9)), isCurve(at(-9))];
  }, {
    x: 0.5, y: Math.sqrt(curve.y[0] * curve.y[curve.y.length - 1]),
    low: Math.min(...plot.curves.flatMap(({ y }) => y)), high: Math.max(...plot.curves.flatMap(({ y }) => y)),
  });
  assert.deepEqual(found, [true, false, false]);
});

for (const name of ['path/report.html', 'hand/report.html', 'two/report.html', 'packing.html', ...(hasEvaluation ? ['evaluation/index.html'] : [])]) {
  pageTest(`${name}: on a phone, in the dark and on paper`, async () => {
    await make();
    const phone = await openReport([name], { width: 390, height: 844 });
    const text = await phone.locator('main').innerText();
    assert.ok(!/NaN|undefined|null/.test(text), text.match(/.*(NaN|undefined|null).*/)?.[0]);
    const widths = await phone.evaluate(() => [document.documentElement.scrollWidth, innerWidth]);
    assert.ok(widths[0] <= widths[1], `${widths[0]} of ${widths[1]} pixels`);
    const ground = (page) => page.evaluate(() => getComputedStyle(document.body).backgroundColor);
    assert.equal(await ground(phone), 'rgb(20, 23, 31)');
    await phone.emulateMedia({ colorScheme: 'light' });
    await until('light', async () => (await ground(phone)) === 'rgb(252, 252, 250)');
    await phone.emulateMedia({ colorScheme: 'dark' });
    await until('dark', async () => (await ground(phone)) === 'rgb(20, 23, 31)');

    // What happens when a person prints.
    await phone.evaluate(() => dispatchEvent(new Event('beforeprint')));
    assert.equal(await ground(phone), 'rgb(252, 252, 250)');
    await until('plots on paper', async () => (await empty(phone, '.plot canvas')) === 0);
    assert.equal(await empty(phone, 'canvas.still'), 0);
    await phone.evaluate(() => dispatchEvent(new Event('afterprint')));
    assert.equal(await ground(phone), 'rgb(20, 23, 31)');
    const pdf = await phone.pdf({ format: 'A4' });
    assert.equal(pdf.subarray(0, 5).toString(), '%PDF-');
    assert.ok(pdf.length > 30000, `${pdf.length} bytes`);
  });
}
