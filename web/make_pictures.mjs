// The picture of README, from the real page: a pen in a simulated hand, held and pushed by keys until it
// is pressed firmly.
//
//   node web/make_pictures.mjs PALPATE OUTPUT.png        (make pictures)
//
// The hand sways: of some pictures, the one with the largest force is kept.
import { spawn, spawnSync } from 'node:child_process';
import { copyFileSync, existsSync, mkdtempSync, rmSync, statSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

const [palpate, output] = process.argv.slice(2);
const SIZE = { width: 1000, height: 600 }, ZOOM = -500; // CSS pixels; of the wheel
const PALM = '0.003,0.02,0.52'; // m
const FIRM = 4, NUM_PICTURES = 12; // N, on the pen, at which it is pushed no more

function fail(words) {
  console.error(`make pictures: ${words}`);
  process.exit(1);
}

const executablePath = ['/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome'].find((path) => existsSync(path));
if (!executablePath) fail('no Chromium (package chromium)');
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
await page.mouse.move(0.5 * SIZE.width, 0.45 * SIZE.height);
await push(0.5);
await page.evaluate(() => { window.palpate.scene.options.view = 'free'; });
await page.keyboard.down('Control');
await page.mouse.wheel(0, ZOOM);
await page.keyboard.up('Control');
// A machine that is late because it draws in software says so, which is not what the picture is about.
await page.addStyleTag({ content: '.banner { display: none !important; }' });
const shown = () => page.evaluate(() => {
  const label = document.querySelector('.newtons');
  return label.hidden ? 0 : parseFloat(label.textContent);
});
let largest = 0;
for (let i = 0; i < NUM_PICTURES; ++i) {
  await push(FIRM);
  const path = join(folder, 'picture.png'), before = await shown();
  await page.screenshot({ path });
  const force = Math.min(before, await shown()); // the page goes on meanwhile
  if (force > largest) copyFileSync(path, output);
  largest = Math.max(largest, force);
}
await browser.close();
run.kill('SIGINT');
await ended;
rmSync(folder, { recursive: true });
if (largest === 0) fail('the pen was never pressed');
console.log(`${output}: ${largest} N, ${Math.round(statSync(output).size / 1024)} KiB`);
