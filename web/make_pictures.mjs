// The pictures of README and guides, from the real pages: reports and recordings of generated scenes, made by the
// commands that the guides show.
//
//   node web/make_pictures.mjs PALPATE FOLDER [NAME ...]        (make pictures)
//
// The moving picture is a recording, looked at from moment to moment: so it is as smooth on a machine that draws in
// software. ffmpeg puts its moments together.
import { spawn, spawnSync } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync, statSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { delimiter, dirname, join, resolve } from 'node:path';
import { fileURLToPath, pathToFileURL } from 'node:url';

const palpate = resolve(process.argv[2]), output = resolve(process.argv[3]), names = process.argv.slice(4);
const guides = fileURLToPath(new URL('../docs/guide/', import.meta.url));
const folder = mkdtempSync(join(tmpdir(), 'palpate-pictures-'));
process.on('exit', () => rmSync(folder, { recursive: true }));

function fail(words) {
  console.error(`make pictures: ${words}`);
  process.exit(1);
}

const executablePath = ['/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome'].find((path) => existsSync(path));
if (!executablePath) fail('no Chromium (package chromium)');
const { chromium } = createRequire(import.meta.url)('playwright-core');
const browser = await chromium.launch({
  executablePath, timeout: 0, chromiumSandbox: process.getuid() !== 0, args: ['--use-angle=swiftshader', '--enable-unsafe-swiftshader'],
});

const sleep = (milliseconds) => new Promise((resolve) => setTimeout(resolve, milliseconds));
async function until(what, condition) {
  for (let i = 0; i < 1200; ++i) {
    const value = await condition();
    if (value) return value;
    await sleep(100);
  }
  return fail(`waited in vain for ${what}`);
}

/// Runs commands of a shell, in a folder that all pictures share.
function shell(commands) {
  const PATH = `${dirname(palpate)}${delimiter}${process.env.PATH}`;
  const { status, stderr } = spawnSync('bash', ['-e', '-c', commands], { cwd: folder, env: { ...process.env, PATH } });
  if (status !== 0) fail(`${commands}\n${stderr}`);
}

/// The commands of a guide: of its block with this text, without what needs more than the guide has.
function shown(guide, text, without = /$^/) {
  const blocks = [...readFileSync(join(guides, `${guide}.md`), 'utf8').matchAll(/```sh\n([^]*?)```/g)].map(([, block]) => block);
  const block = blocks.find((commands) => commands.includes(text)) ?? fail(`${guide}.md has no command ${text}`);
  return block.replaceAll('\\\n', ' ').split('\n').filter((line) => !without.test(line)).join('\n');
}

/// The 3-D picture of a report, or another part of it.
async function report(page, name, { part = 'figure.picture .place', clicks = [], width = 960, height = 900 } = {}) {
  const view = await browser.newPage({ viewport: { width, height }, colorScheme: 'dark' });
  view.setDefaultTimeout(0);
  await view.goto(pathToFileURL(join(folder, page)).href);
  await view.locator('footer').waitFor();
  await view.locator('canvas.scene').first().waitFor();
  for (const words of clicks) await view.getByRole('button', { name: words, exact: true }).click();
  const at = view.locator(part).first();
  await at.scrollIntoViewIfNeeded();
  await sleep(3000); // it glides
  await at.screenshot({ path: join(output, name), type: 'jpeg', quality: 84 });
  await view.close();
}

/// Serves a recording, and calls `look` with its page, without panels.
async function viewed(run, look, { width, height }) {
  const server = spawn(palpate, ['view', join(folder, run), '--port', '0']);
  const ended = new Promise((resolve) => server.on('close', resolve));
  let said = '';
  for (const stream of [server.stdout, server.stderr]) stream.on('data', (text) => { said += text; });
  const url = await until('an address', () => said.match(/http:\/\/\S+/)?.[0]);
  const page = await browser.newPage({ viewport: { width, height }, colorScheme: 'dark' });
  page.setDefaultTimeout(0);
  await page.goto(`${url}?stride=2&plots=0&image=0&controls=0`);
  await until('the tool', () => page.evaluate(() => window.palpate.sample && window.palpate.state));
  await page.evaluate(() => { Object.assign(window.palpate.governor, { enabled: false, fine: true }); }); // full detail, however slow
  await page.addStyleTag({ content: '.banner, .hint { display: none !important; }' });
  await page.evaluate(() => window.palpate.command({ command: 'pause' }));
  await look(page);
  await page.close();
  server.kill('SIGINT');
  await ended;
}

/// Shows a moment of a recording, completely.
async function seek(page, time) {
  const before = await page.evaluate(() => window.palpate.counters.pictures);
  await page.evaluate((to) => window.palpate.command({ command: 'seek', time: to }), time);
  await until(`${time} s`, () => page.evaluate(([to, from]) =>
    Math.abs(window.palpate.state.time - to) < 0.03 && window.palpate.counters.pictures > from, [time, before]));
  await page.evaluate(() => new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn))));
}

const pen = 'palpate shape stylus --size 0.12 -o pen.stl && palpate pack pen.stl --spheres 2000 -o pen.palp';
let hasPen = false;
function makePen() {
  if (!hasPen) shell(pen);
  hasPen = true;
}

/// Each picture by its name.
const pictures = {
  async 'pressed.webp'(name) {
    makePen();
    shell('palpate touch pen.palp --scene hand -o pressed');
    const rate = 6, from = 2.8, to = 6.8, size = { width: 960, height: 540 };
    await viewed('pressed', async (page) => {
      await page.addStyleTag({ content: '.legend, .dock, .timeline { display: none !important; }' });
      await seek(page, 4.4);
      await page.evaluate(() => window.palpate.scene.resetView());
      await page.mouse.move(0.5 * size.width, 0.5 * size.height);
      for (let i = 0; i < 3; ++i) await page.mouse.wheel(0, -100);
      await sleep(3000); // it glides
      for (let i = 0; i < rate * (to - from); ++i) {
        await seek(page, from + i / rate);
        await page.screenshot({ path: join(folder, `moment-${String(i).padStart(3, '0')}.png`) });
      }
    }, size);
    const { status, stderr } = spawnSync('ffmpeg', ['-y', '-framerate', String(rate), '-i', join(folder, 'moment-%03d.png'),
      '-c:v', 'libwebp_anim', '-quality', '60', '-compression_level', '6', '-loop', '0', join(output, name)]);
    if (status !== 0) fail(`ffmpeg (package ffmpeg): ${stderr}`);
  },
  async 'report.jpg'(name) {
    makePen();
    shell('palpate touch pen.palp --scene hand --duration 5 -o reported');
    await report('reported/report.html', name);
  },
  async 'two-cameras.jpg'(name) {
    shell(shown('several-cameras', '-o two-cameras', /one-camera|replay/));
    await report('two-cameras/report.html', name);
  },
  async 'pushed.jpg'(name) {
    shell(shown('moving-bodies', '-o pushed'));
    await report('pushed/report.html', name);
  },
  async 'ring.jpg'(name) {
    shell(shown('packing', '-o ring.palp'));
    await report('ring.html', name);
  },
  async 'two-runs.jpg'(name) {
    makePen();
    shell('palpate touch pen.palp --scene hand --duration 5 -o run && palpate replay run -o other --method graph --time latest && ' +
      'palpate report run other -o both.html');
    await report('both.html', name, { part: 'figure.plot' });
  },
};

for (const [name, make] of Object.entries(pictures)) {
  if (names.length > 0 && !names.includes(name)) continue;
  await make(name);
  console.log(`${name}: ${Math.round(statSync(join(output, name)).size / 1024)} KiB`);
}
await browser.close();
