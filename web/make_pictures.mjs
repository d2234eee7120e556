// The pictures of README and guides, from the real pages: reports and recordings of generated scenes, made by the
// commands that the guides show.
//
//   node web/make_pictures.mjs PALPATE FOLDER [NAME ...]        (make pictures)
//
// The moving picture is a recording, looked at from moment to moment: so it is as smooth on a machine that draws in
// software. For the same reason runs have a simulated clock, but for those that a hand or a robot moves. Guides in Python
// and C++ are drawn by tools/draw_guides.py. ffmpeg makes WebP of all of them.
import { spawn, spawnSync } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync, statSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { delimiter, dirname, join, resolve } from 'node:path';
import { fileURLToPath, pathToFileURL } from 'node:url';

const palpate = resolve(process.argv[2]), output = resolve(process.argv[3]), names = process.argv.slice(4);
const root = fileURLToPath(new URL('..', import.meta.url)), guides = join(root, 'docs/guide');
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

/// Screenshots are kept here until they are written.
const kept = (name) => join(folder, `${name}.png`);

/// Writes screenshots as WebP, side by side if there are two.
function write(name, shots) {
  const beside = shots.length > 1 ? ['-filter_complex', '[0]scale=-2:360[a];[1]scale=-2:360[b];[a][b]hstack'] : [];
  ffmpeg([...shots.flatMap((shot) => ['-i', shot]), ...beside, '-c:v', 'libwebp', '-quality', '82', join(output, name)]);
}

function ffmpeg(words) {
  const { status, stderr } = spawnSync('ffmpeg', ['-y', '-loglevel', 'error', ...words]);
  if (status !== 0) fail(`ffmpeg (package ffmpeg): ${stderr}`);
}

/// A screenshot of the 3-D picture of a report, or of another part of it.
async function report(page, { part = 'figure.picture .place', clicks = [], width = 960, height = 900 } = {}) {
  const view = await browser.newPage({ viewport: { width, height }, colorScheme: 'dark' });
  view.setDefaultTimeout(120000);
  await view.goto(pathToFileURL(join(folder, page)).href);
  await view.locator('footer').waitFor();
  await view.locator('canvas.scene').first().waitFor();
  for (const words of clicks) await view.getByRole('button', { name: words, exact: true }).click();
  const at = view.locator(part).first();
  await at.scrollIntoViewIfNeeded();
  await sleep(3000); // it glides
  const shot = kept(page.replaceAll('/', '-'));
  await at.screenshot({ path: shot });
  await view.close();
  return shot;
}

/// Holds the tool of a page in the view of the camera, pushes it by keys until it meets a force, N, and looks from beside.
async function press(page, newtons) {
  await page.addStyleTag({ content: '.banner, .hint { display: none !important; }' });
  await page.keyboard.press('t');
  const force = () => page.evaluate(() => Math.hypot(...['x', 'y', 'z'].map((axis) => window.palpate.sample[`force_${axis}`])));
  await until(`${newtons} N`, async () => {
    if (await force() > newtons) return true;
    await page.keyboard.press('PageUp', { delay: 60 });
    await sleep(200); // the hand is led there
    return false;
  });
  for (let i = 0; i < 3; ++i) await page.keyboard.press('v'); // camera, from above, tool, free
  await page.evaluate(() => {
    Object.assign(window.palpate.governor ?? {}, { enabled: false, fine: true });
    window.palpate.scene.resetView();
  });
  await sleep(10000); // it glides
}

/// Starts a command that serves a page, calls `look` with the page, and ends the command as Ctrl-C does.
async function served(words, address, size, look) {
  const server = spawn(palpate, words, { cwd: folder });
  const ended = new Promise((resolve) => server.on('close', resolve));
  let said = '';
  for (const stream of [server.stdout, server.stderr]) stream.on('data', (text) => { said += text; });
  const url = await until('an address', () => said.match(/http:\/\/\S+/)?.[0]);
  const page = await browser.newPage({ viewport: size, colorScheme: 'dark' });
  page.setDefaultTimeout(0);
  await page.goto(`${url}?${address}`);
  await until('the tool', () => page.evaluate(() => window.palpate.sample && window.palpate.state));
  await look(page);
  await page.close();
  server.kill('SIGINT');
  await ended;
}

/// Serves a recording that stands still and is drawn completely, however slow.
async function viewed(run, address, size, look) {
  await served(['view', run, '--port', '0'], `stride=2&${address}`, size, async (page) => {
    await page.evaluate(() => { Object.assign(window.palpate.governor, { enabled: false, fine: true }); });
    await page.addStyleTag({ content: '.banner, .hint { display: none !important; }' });
    await page.evaluate(() => window.palpate.command({ command: 'pause' }));
    await look(page);
  });
}

/// Shows a moment of a recording, completely.
async function seek(page, time) {
  const before = await page.evaluate(() => window.palpate.counters.pictures);
  await page.evaluate((to) => window.palpate.command({ command: 'seek', time: to }), time);
  await until(`${time} s`, () => page.evaluate(([to, from]) =>
    Math.abs(window.palpate.state.time - to) < 0.03 && window.palpate.counters.pictures > from, [time, before]));
  await page.evaluate(() => new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn))));
}

/// A screenshot of a recording at a time, seen from beside the push.
async function moment(run, time, { address = 'plots=0&image=0&controls=0', size = { width: 960, height: 540 } } = {}) {
  const shot = kept(run);
  await viewed(run, address, size, async (page) => {
    await seek(page, time);
    await page.evaluate(() => window.palpate.scene.resetView());
    await sleep(3000); // it glides
    await page.screenshot({ path: shot });
  });
  return shot;
}

const made = new Set();
/// Runs commands that several pictures need once.
function once(commands) {
  if (!made.has(commands)) shell(commands);
  made.add(commands);
}
const makePen = () => once('palpate shape stylus --size 0.12 -o pen.stl && palpate pack pen.stl --spheres 2000 -o pen.palp');

/// Each picture by its name; it returns its screenshots, or null if it has written the picture itself.
const pictures = {
  async pressed(name) {
    makePen();
    shell('palpate touch pen.palp --scene hand -o pressed');
    const rate = 6, from = 2.8, to = 6.8, size = { width: 960, height: 540 };
    await viewed('pressed', 'plots=0&image=0&controls=0', size, async (page) => {
      await page.addStyleTag({ content: '.legend, .dock, .timeline, .badge, .rate, .link { display: none !important; }' });
      await seek(page, 4.4);
      await page.evaluate(() => window.palpate.scene.resetView());
      await page.mouse.move(0.5 * size.width, 0.5 * size.height);
      for (let i = 0; i < 3; ++i) await page.mouse.wheel(0, -100);
      await sleep(3000); // it glides
      for (let i = 0; i < rate * (to - from); ++i) {
        await seek(page, from + i / rate);
        await page.screenshot({ path: kept(`moment-${String(i).padStart(3, '0')}`) });
      }
    });
    ffmpeg(['-framerate', String(rate), '-i', kept('moment-%03d'), '-c:v', 'libwebp_anim', '-quality', '60',
      '-compression_level', '6', '-loop', '0', join(output, name)]);
    return null;
  },
  async report() {
    shell(shown('first-touch', '-o probe.palp'));
    shell(shown('first-touch', '-o first/', /depth-sequence/));
    return [await report('first/report.html')];
  },
  async try(name) {
    const limits = ['max_contact_age', 'max_sensor_age', 'max_device_silence', 'max_tick', 'energy_tank'].map((limit) => `${limit}=60`);
    shell(`${shown('try-it', '-o mine', /--device page/)}\nprintf '%s\n' '[safety]' ${limits.join(' ')} > patient.toml`); // drawing in software is late
    const words = shown('try-it', '-o mine').match(/palpate (touch .*)/)[1].split(' ');
    await served([...words, '--settings', 'patient.toml', '--set', 'loop.thin_out=false', '--view-port', '0'], 'stride=2&view=camera',
      { width: 1280, height: 720 }, async (page) => {
        await press(page, 3);
        await page.screenshot({ path: kept(name) });
      });
    return [kept(name)];
  },
  async browser(name) {
    const file = join(root, 'build/web/try/try.html');
    if (!existsSync(file)) fail(`${file} is not there: make web-core`);
    const page = await browser.newPage({ viewport: { width: 1280, height: 720 }, colorScheme: 'dark' });
    page.setDefaultTimeout(0);
    await page.goto(`${pathToFileURL(file).href}?view=camera&objects.shape=box`);
    await until('the tool', () => page.evaluate(() => window.palpate?.sample && window.palpate.counters.contacts > 1));
    await press(page, 3);
    await page.screenshot({ path: kept(name) });
    await page.close();
    return [kept(name)];
  },
  async ros2() {
    shell(shown('ros2', '-o gripper.palp'));
    const robot = spawn(join(root, 'build/python/bin/python'), [join(root, 'tests/ros/cyclone_peer.py'), '77', 'good', '640x480'],
      { stdio: ['pipe', 'ignore', 'ignore'] });
    shell(shown('ros2', 'cyclone_peer.py', /setup.sh|peer.py|palpate view|kill/).replace('DOMAIN_ID=7', 'DOMAIN_ID=77'));
    robot.stdin.end(); // which ends it
    return [await report('palpate-ros2/report.html')];
  },
  async viewer() {
    shell(shown('viewer', '--view -o live1').replace('--device sim --duration 60 --view', '--coupling virtual --duration 4'));
    return [await moment('live1', 2.5, { address: '', size: { width: 1280, height: 760 } })];
  },
  async hand() {
    shell(shown('haptics', '-o live1', /devices|replay|live1/));
    shell(shown('haptics', '-o coupled'));
    return [await report('coupled/report.html', { part: 'h2:text("What the hand felt") + figure.plot' })];
  },
  async 'two-cameras'() {
    shell(shown('several-cameras', '-o two-cameras', /one-camera|replay/));
    return [await report('two-cameras/report.html')];
  },
  async pushed() {
    shell(shown('moving-bodies', '-o pushed'));
    return [await report('pushed/report.html')];
  },
  async ring() {
    shell(shown('packing', '-o ring.palp'));
    return [await report('ring.html')];
  },
  async cameras() {
    shell(shown('cameras', '-o live/', /folder:|palpate cameras/).replace('--device sim', ''));
    return [await report('live/report.html', { clicks: ['camera', 'by depth'] })];
  },
  async memory() {
    shell(shown('memory', '-o remembered', /replay/));
    return [await report('memory.html', { part: 'figure.plot' })];
  },
  async robot() {
    shell(shown('robot', '-o without-robot', /replay/));
    const size = { width: 560, height: 900 };
    return [await report('with-robot/report.html', size), await report('without-robot/report.html', size)];
  },
  async rough() {
    shell(shown('materials', '-o rough', /ridges/));
    return [await report('rough/report.html')];
  },
  async block() {
    shell(shown('several-bodies', '--object').replaceAll('run/', 'block/'));
    return [await report('block/report.html')];
  },
  async 'two-runs'() {
    makePen();
    shell('palpate touch pen.palp --scene hand --duration 5 -o run && palpate replay run -o other --method graph --time latest && ' +
      'palpate report run other -o both.html');
    return [await report('both.html', { part: 'figure.plot' })];
  },
  async methods() {
    shell(shown('contact-methods', '-o methods.html'));
    return [await report('methods.html', { part: 'figure.plot' })];
  },
  async time() {
    shell(shown('time', '-o times.html'));
    return [await report('times.html', { part: 'figure.plot' })];
  },
};

/// Those that tools/draw_guides.py draws, where the wheel is installed.
for (const name of ['python', 'planning', 'robots', 'library', 'gpu', 'alternatives']) {
  pictures[name] = async () => {
    const python = join(root, 'build/python-pictures/bin/python');
    const { status, stderr } = spawnSync(python, [join(root, 'tools/draw_guides.py'), folder, name]);
    if (status !== 0) fail(`${python} tools/draw_guides.py ${name} (make pictures installs what it needs)\n${stderr ?? ''}`);
    return [kept(name)];
  };
}

for (const [name, make] of Object.entries(pictures)) {
  const file = `${name}.webp`;
  if (names.length > 0 && !names.includes(name) && !names.includes(file)) continue;
  const shots = await make(file);
  if (shots) write(file, shots);
  console.log(`${file}: ${Math.round(statSync(join(output, file)).size / 1024)} KiB`);
}
await browser.close();
