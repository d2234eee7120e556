// A browser, a served world, and what is to be seen of it.
//
// Run by CTest, which says in the environment where the programs are; a file is also run alone:
//   PALPATE_PAGE_SERVER=build/release/bin/page_server node tests/viewer/page/pixels_test.mjs
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { existsSync, mkdirSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { createInterface } from 'node:readline';
import { join } from 'node:path';
import { after, test } from 'node:test';

const root = new URL('../../../', import.meta.url);
const failures = process.env.PALPATE_PAGE_FAILURES ?? new URL('build/page-failures', root).pathname;
export const pageServer =
  process.env.PALPATE_PAGE_SERVER ?? new URL('build/release/bin/page_server', root).pathname;
export const program =
  process.env.PALPATE_PROGRAM ?? new URL('build/release/bin/palpate', root).pathname;

/// Ends the whole file, for CTest to count as skipped.
function skip(reason) {
  console.log(`SKIPPED: ${reason}`);
  process.exit(77);
}

const executablePath = ['/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome']
  .find((path) => existsSync(path));
if (!executablePath) skip('no Chromium (package chromium)');
let playwright;
try {
  playwright = createRequire(new URL('web/package.json', root))('playwright-core');
} catch {
  skip('no playwright-core (npm ci in web/)');
}

// Software drawing: Mesa's if it is there, else the browser's own. Never --disable-gpu, with which
// the page's messages starve.
const drawing = [
  ['--use-angle=gl-egl', '--ignore-gpu-blocklist'],
  ['--use-angle=swiftshader', '--enable-unsafe-swiftshader'],
];

/// Starts a browser with these flags, which the caller closes.
export const launchWith = (args) =>
  playwright.chromium.launch({ executablePath, chromiumSandbox: process.getuid() !== 0, args });

async function launch() {
  for (const flags of drawing) {
    const browser = await launchWith(flags);
    const page = await browser.newPage();
    const works = await page.evaluate(
      () => !!document.createElement('canvas').getContext('webgl2'));
    await page.close();
    if (works) return browser;
    await browser.close();
  }
  skip('this Chromium cannot draw with WebGL 2 (packages libegl-mesa0, libgl1-mesa-dri)');
}

export const browser = await launch();
after(() => browser.close());

/// One program that reads commands from its input and answers in lines.
class Program {
  constructor(file, args, options = {}) {
    this.lines = [];
    this.waiting = [];
    this.errors = '';
    this.child = spawn(file, args, { stdio: ['pipe', 'pipe', 'pipe'], ...options });
    this.child.stderr.on('data', (text) => { this.errors += text; });
    this.ended = new Promise((resolve) => this.child.on('close', (code) => {
      this.code = code;
      this.waiting.forEach((wake) => wake());
      resolve(code);
    }));
    createInterface({ input: this.child.stdout }).on('line', (line) => {
      this.lines.push(line);
      this.waiting.splice(0).forEach((wake) => wake());
    });
  }

  /// The next line for which `wanted` is true is taken out and returned.
  async line(wanted, seconds = 120) {
    const end = Date.now() + seconds * 1000;
    for (;;) {
      const found = this.lines.findIndex(wanted);
      if (found >= 0) return this.lines.splice(found, 1)[0];
      if (this.code !== undefined || Date.now() > end) {
        throw new Error(`no such line: ${wanted}\n${this.lines.slice(-20).join('\n')}\n${this.errors}`);
      }
      await Promise.race([new Promise((wake) => this.waiting.push(wake)), sleep(200)]);
    }
  }

  /// Ends it as a person would, and hard if that does not help.
  async stop(signal = 'SIGINT') {
    if (this.code === undefined) this.child.kill(signal);
    const hard = setTimeout(() => this.child.kill('SIGKILL'), 600000);
    await this.ended;
    clearTimeout(hard);
  }
}

/// A world of tests/viewer/page/scripted_world.h behind the real server.
export class Served extends Program {
  static async start(script) {
    const served = new Served(pageServer, [JSON.stringify(script)]);
    started.add(served);
    served.url = (await served.line((line) => line.startsWith('serving '))).slice(8);
    return served;
  }

  /// Changes the world; returns what the server's process says of itself.
  async apply(change = {}) {
    this.child.stdin.write(`${JSON.stringify(change)}\n`);
    return JSON.parse((await this.line((line) => line.startsWith('done '))).slice(5));
  }

  /// The next command of that name which a page has sent.
  async heard(name) {
    const line = await this.line(
      (text) => text.startsWith('command ') && JSON.parse(text.slice(8)).command === name);
    return JSON.parse(line.slice(8));
  }

  /// Its address with another path, the token kept.
  address(path, scheme = 'http:') {
    const url = new URL(this.url);
    url.pathname = path;
    url.protocol = scheme;
    return url.href;
  }
}

/// The real program, until it says where the page is.
export const evaluation =
  process.env.PALPATE_EVALUATION ?? new URL('build/release/bin/palpate_eval', root).pathname;

export async function runProgram(args, which = program) {
  const run = new Program(which, args);
  started.add(run);
  return run;
}

const started = new Set();
after(async () => {
  for (const one of started) await one.stop('SIGKILL');
});

export const sleep = (milliseconds) => new Promise((resolve) => setTimeout(resolve, milliseconds));

/// Until `condition` returns something true, which is returned. The limit is for what never comes: a
/// busy machine takes minutes for what takes a moment.
export async function until(what, condition, seconds = 400) {
  const end = Date.now() + seconds * 1000;
  for (;;) {
    const value = await condition();
    if (value) return value;
    if (Date.now() > end) assert.fail(`waited ${seconds} s in vain: ${typeof what === 'function' ? what() : what}`);
    await sleep(50);
  }
}

const shown = new Set(); // pages, for pictures of them when a test fails

/// Opens the page. `page.problems` collects what must not happen: errors on the console, exceptions,
/// requests to other hosts. `bare`: without panels, and drawn in full detail however long that takes.
export async function openPage(
  url, { width = 800, height = 500, expectErrors = false, bare = false, colorScheme = 'dark' } = {}) {
  const page = await browser.newPage({ viewport: { width, height }, colorScheme });
  page.problems = [];
  page.expectsErrors = expectErrors; // the server will go away
  const origin = new URL(url).host;
  page.on('console', (message) => {
    if (message.type() === 'error' && !page.expectsErrors) page.problems.push(message.text());
  });
  page.on('pageerror', (error) => page.problems.push(String(error)));
  page.on('request', (request) => {
    const to = new URL(request.url());
    if (to.host !== origin && !['data:', 'blob:'].includes(to.protocol)) {
      page.problems.push(`asks another host: ${request.url()}`);
    }
  });
  shown.add(page);
  page.on('close', () => shown.delete(page));
  const to = new URL(url);
  // A look of the address stays when the program says what it shows.
  if (bare) for (const [key, value] of [['plots', '0'], ['image', '0'], ['controls', '0'], ['look', 'caps']]) to.searchParams.set(key, value);
  await page.goto(to.href, { waitUntil: 'load' });
  if (bare) await page.evaluate(() => { window.palpate.governor.enabled = false; });
  return page;
}

/// The page's own numbers; see `window.palpate` in web/src/main.ts.
export const stat = (page) => page.evaluate(() => ({ ...window.palpate.counters }));

/// The newest state that the page has heard of.
export const state = (page) => page.evaluate(() => window.palpate.state);

/// The answer to a command of the page.
export const command = (page, what) => page.evaluate((c) => window.palpate.command(c), what);

/// Changes what the scene shows, as the panels do.
export const options = (page, wanted) => page.evaluate((all) => {
  Object.assign(window.palpate.scene.options, all);
  document.querySelector('.page').dispatchEvent(new Event('panels')); // asks for what that needs
}, wanted);

/// What the page says that a person should know now; '' if nothing.
export const banner = (page) => page.evaluate(() => {
  const root = document.querySelector('.banner');
  return root && !root.hidden ? root.innerText : '';
});

/// Until the page has drawn `more` further pictures.
export async function drawn(page, more = 2) {
  let got = 0;
  const before = (await stat(page)).pictures;
  await until(() => `${more} more pictures drawn, ${got} came`, async () => {
    got = (await stat(page)).pictures - before;
    return got >= more;
  });
}

/// What is to be seen of the scene: colors by CSS pixel of its canvas.
class Picture {
  constructor(width, height, pixels) {
    Object.assign(this, { width, height, pixels });
  }
  /// Red, green, blue, 0 to 255.
  at(x, y) {
    const [u, v] = [Math.floor(x), Math.floor(y)];
    assert.ok(u >= 0 && v >= 0 && u < this.width && v < this.height, `(${x}, ${y}) is off the canvas`);
    const i = 4 * (v * this.width + u);
    return [...this.pixels.subarray(i, i + 3)];
  }
}

let decoder; // a blank page, for its PNG reader

/// The canvas of the scene alone, as the browser shows it.
export async function look(page) {
  const style = 'body * { visibility: hidden !important } canvas.scene { visibility: visible !important }';
  return decoded(await page.locator('canvas.scene').screenshot({ style }));
}

/// A PNG as pixels.
export async function decoded(png) {
  decoder ??= await browser.newPage();
  const { width, height, text } = await decoder.evaluate(async (base64) => {
    const bytes = await (await fetch(`data:image/png;base64,${base64}`)).blob();
    const bitmap = await createImageBitmap(bytes, { colorSpaceConversion: 'none' });
    const { width, height } = bitmap;
    const context = new OffscreenCanvas(width, height).getContext('2d');
    context.drawImage(bitmap, 0, 0);
    const { data } = context.getImageData(0, 0, width, height);
    let text = '';
    for (let i = 0; i < data.length; i += 32768) {
      text += String.fromCharCode(...data.subarray(i, i + 32768));
    }
    return { width, height, text: btoa(text) };
  }, png.toString('base64'));
  return new Picture(width, height, Buffer.from(text, 'base64'));
}

/// Where points of W are on the canvas, CSS pixels.
export const project = (page, points) =>
  page.evaluate((list) => list.map((p) => window.palpate.scene.project(...p)), points);

/// A test that leaves pictures of all pages behind when it fails, and fails for their problems.
export function pageTest(name, body, seconds = 900) {
  test(name, { timeout: 1000 * seconds }, async (t) => {
    try {
      await body(t);
      for (const page of shown) assert.deepEqual(page.problems, [], 'problems of the page');
    } catch (error) {
      mkdirSync(failures, { recursive: true });
      let number = 0;
      for (const page of shown) {
        const file = join(failures, `${name.replace(/\W+/g, '_')}_${number++}.png`);
        const saved = await page.screenshot({ path: file }).then(() => file, (why) => `none, ${why.message.split('\n')[0]}`);
        console.log(`# picture: ${saved}`);
      }
      throw error;
    } finally {
      for (const page of [...shown]) await page.close();
    }
  });
}
