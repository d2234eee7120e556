// The moving picture of README, from the real page: a pen in a simulated hand, held and pushed by keys until it is pressed firmly.
//
//   node web/make_pictures.mjs PALPATE OUTPUT.webp        (make pictures)
//
// A picture is taken whenever the page has drawn a new one, so that a slow machine gives the same motion
// in fewer pictures; each is shown for as long as it was the newest one. ffmpeg makes the file.
import { spawn, spawnSync } from 'node:child_process';
import { existsSync, mkdtempSync, rmSync, statSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

const [palpate, output] = process.argv.slice(2);
const SIZE = { width: 1000, height: 640 }, SHOWN_WIDTH = 800;
const PALM = '0.003,0.02,0.52'; // m
const FIRM = 6; // N, on the pen, at which it is pushed no more
const AFTERWARDS = [[null, 1200], ['ArrowLeft', 500], ['ArrowRight', 500], [null, 500], ['PageDown', 1200], [null, 400]]; // ms
const MAX_BYTES = 2e6;

function fail(words) {
  console.error(`make pictures: ${words}`);
  process.exit(1);
}

const executablePath = ['/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome'].find((path) => existsSync(path));
if (!executablePath) fail('no Chromium (package chromium)');
if (spawnSync('ffmpeg', ['-version']).error) fail('no ffmpeg (package ffmpeg)');
const { chromium } = createRequire(import.meta.url)('playwright-core');

const folder = mkdtempSync(join(tmpdir(), 'palpate-pictures-'));
const [mesh, tool, patient] = ['pen.stl', 'pen.palp', 'patient.toml'].map((name) => join(folder, name));
// A machine that draws in software is late, which is no fault here.
const limits = ['max_contact_age', 'max_sensor_age', 'max_device_silence', 'max_tick', 'energy_tank'];
writeFileSync(patient, `[safety]\n${limits.map((limit) => `${limit} = 60\n`).join('')}`);
for (const words of [['shape', 'stylus', '--size', '0.12', '-o', mesh], ['pack', mesh, '--spheres', '2000', '-o', tool]]) {
  if (spawnSync(palpate, words).status !== 0) fail(`palpate ${words.join(' ')}`);
}
const run = spawn(palpate, ['touch', tool, '--scene', 'hand', '--device', 'page', '--probe', PALM, '--view-port', '0', '--settings', patient,
  '--set', 'loop.thin_out=false', '-o', join(folder, 'run')]);
const ended = new Promise((resolve) => run.on('close', resolve));
let said = '';
for (const stream of [run.stdout, run.stderr]) stream.on('data', (text) => { said += text; });
const sleep = (milliseconds) => new Promise((resolve) => setTimeout(resolve, milliseconds));
async function until(what, condition) {
  for (let i = 0; i < 1200; ++i) {
    const value = await condition();
    if (value) return value;
    await sleep(100);
  }
  return fail(`waited in vain for ${what}\n${said}`);
}

const url = await until('an address', () => said.match(/http:\/\/\S+/)?.[0]);
const browser = await chromium.launch({
  executablePath, timeout: 0, chromiumSandbox: process.getuid() !== 0, args: ['--use-angle=swiftshader', '--enable-unsafe-swiftshader'],
});
const page = await browser.newPage({ viewport: SIZE, colorScheme: 'dark' });
page.setDefaultTimeout(0);
await page.goto(`${url}?plots=0&image=0&controls=0&stride=2&view=camera`);
await until('the tool', () => page.evaluate(() => window.palpate.sample && window.palpate.state?.running));
await page.evaluate(() => { window.palpate.governor.enabled = false; }); // full detail, however slow
await page.getByRole('button', { name: 'Hold the tool' }).click();
await until('a force that is on', () => page.evaluate(() => window.palpate.state.force === 'engaged'));

const force = () => page.evaluate(() => Math.hypot(...['x', 'y', 'z'].map((axis) => window.palpate.sample[`contact_force_${axis}`])));
/// Pushes along the line of sight.
async function push(newtons) {
  await page.keyboard.down('PageUp');
  await until(`${newtons} N`, async () => (await force()) > newtons);
  await page.keyboard.up('PageUp');
}
// As the camera sees it, straight ahead is onto the palm; from the side one sees more.
await push(0.5);
await page.evaluate(() => { window.palpate.scene.options.view = 'free'; });
await sleep(2500);

const pictures = []; // of [file, ms since the first one]
let number = -1, isOver = false;
const begin = Date.now();
const taking = (async () => {
  while (!isOver) {
    const drawn = await page.evaluate(() => window.palpate.counters.pictures);
    if (drawn === number) {
      await sleep(15);
      continue;
    }
    number = drawn;
    const file = join(folder, `${String(pictures.length).padStart(4, '0')}.png`);
    pictures.push([file, Date.now() - begin]);
    await page.screenshot({ path: file });
  }
})();
await push(FIRM);
for (const [key, milliseconds] of AFTERWARDS) {
  if (key) await page.keyboard.down(key);
  await sleep(milliseconds);
  if (key) await page.keyboard.up(key);
}
isOver = true;
await taking;
await browser.close();
run.kill('SIGINT');
await ended;

const list = pictures.map(([file, from], i) => {
  const until_ = pictures[i + 1]?.[1] ?? from + 500;
  return `file '${file}'\nduration ${((until_ - from) / 1000).toFixed(3)}\n`;
});
writeFileSync(join(folder, 'list.txt'), list.join(''));
for (let quality = 80; quality >= 30; quality -= 10) {
  const made = spawnSync('ffmpeg', ['-y', '-v', 'error', '-f', 'concat', '-safe', '0', '-i', join(folder, 'list.txt'),
    '-vf', `fps=12,scale=${SHOWN_WIDTH}:-2`, '-c:v', 'libwebp_anim', '-loop', '0', '-quality', String(quality), output], { encoding: 'utf8' });
  if (made.status !== 0) fail(made.stderr);
  if (statSync(output).size < MAX_BYTES) break;
}
rmSync(folder, { recursive: true });
console.log(`${output}: ${pictures.length} pictures, ${Math.round(statSync(output).size / 1024)} KiB`);
