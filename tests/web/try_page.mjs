// The page without a program in a browser, for its tests.
//
// Environment: PALPATE_WEB_CORE, folder of make web-core; PALPATE_TRY_PICTURES, a folder for pictures.
import { existsSync } from 'node:fs';
import { join } from 'node:path';
import { crc32, deflateSync } from 'node:zlib';

const folder = process.env.PALPATE_WEB_CORE ?? new URL('../../build/web', import.meta.url).pathname;
export const file = join(folder, 'try/try.html');
if (!existsSync(file)) {
  console.log('SKIPPED: no page (make web-core)');
  process.exit(77);
}
export const { browser, launchWith } = await import('../viewer/page/harness.mjs');
const pictures = process.env.PALPATE_TRY_PICTURES;

export async function open({ viewport = { width: 800, height: 500 }, isMobile = false, query = '', before = () => {} } = {}) {
  const context = await browser.newContext({ viewport, isMobile, hasTouch: isMobile });
  await context.addInitScript(before);
  const page = await context.newPage(), requests = [], errors = [];
  page.on('request', (request) => /^https?:/.test(request.url()) && requests.push(request.url()));
  page.on('pageerror', (error) => errors.push(error.message));
  await page.goto(`file://${file}${query}`);
  await page.waitForFunction(() => window.palpate?.hello && window.palpate.sample && window.palpate.counters.contacts > 1, null, { timeout: 240000 });
  return { page, context, requests, errors };
}
export const picture = async (page, name) => pictures && page.screenshot({ path: join(pictures, `${name}.png`) });

export const line = (page) => page.textContent('.try-line');
/// Gives a file, and says what a mesh becomes if the page asks.
export async function give(page, name, buffer, role = 'the tool') {
  await page.evaluate(() => { document.querySelector('.try-line').textContent = ''; });
  await page.setInputFiles('.try-open input', { name, mimeType: 'application/octet-stream', buffer });
  if (/\.png$/.test(name)) return;
  await page.waitForFunction(() => document.querySelector('.try-answers').childElementCount > 1 || /\.$/.test(document.querySelector('.try-line').textContent));
  const answer = page.getByRole('button', { name: role, exact: true });
  if (await answer.count() > 0) await answer.click();
}

/// A closed ellipsoid whose longest half axis is `r` m as binary STL, of 4 n (n - 1) triangles.
export function ellipsoid(n, r, shares = [1, 0.7, 0.4]) {
  const at = (i, k) => [Math.sin(Math.PI * i / n) * Math.cos(Math.PI * k / n), Math.sin(Math.PI * i / n) * Math.sin(Math.PI * k / n), Math.cos(Math.PI * i / n)];
  const exact = (i, k) => (i === 0 || i === n ? [0, 0, (i === 0 ? 1 : -1) * shares[2] * r] : at(i, k % (2 * n)).map((x, axis) => r * shares[axis] * x)); // equal corners have equal bits
  const triangles = [];
  for (let i = 0; i < n; ++i)
    for (let k = 0; k < 2 * n; ++k) {
      if (i > 0) triangles.push([exact(i, k), exact(i + 1, k), exact(i, k + 1)]);
      if (i < n - 1) triangles.push([exact(i, k + 1), exact(i + 1, k), exact(i + 1, k + 1)]);
    }
  const file = Buffer.alloc(84 + 50 * triangles.length);
  file.writeUInt32LE(triangles.length, 80);
  triangles.forEach((triangle, t) => triangle.flat().forEach((x, i) => file.writeFloatLE(x, 84 + 50 * t + 12 + 4 * i)));
  return file;
}
export const corner = (i, size) => [0, 1, 2].map((axis) => size * ((i >> axis) & 1));
export const faces = [0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4, 2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5];
export function png(width, height, bits, value, filter = 0) {
  const chunk = (name, data) => {
    const part = Buffer.alloc(12 + data.length);
    part.writeUInt32BE(data.length);
    part.write(name, 4);
    data.copy(part, 8);
    part.writeUInt32BE(crc32(part.subarray(4, 8 + data.length)), 8 + data.length);
    return part;
  };
  const header = Buffer.alloc(13);
  header.writeUInt32BE(width);
  header.writeUInt32BE(height, 4);
  header[8] = bits;
  const rows = Buffer.alloc((width * bits / 8 + 1) * height);
  for (let v = 0; v < height; ++v) rows[v * (width * bits / 8 + 1)] = filter;
  for (let v = 0; v < height; ++v)
    for (let u = 0; u < width && bits === 16; ++u) rows.writeUInt16BE(value, v * (2 * width + 1) + 1 + 2 * u);
  return Buffer.concat([Buffer.from([137, 80, 78, 71, 13, 10, 26, 10]), chunk('IHDR', header), chunk('IDAT', deflateSync(rows)), chunk('IEND', Buffer.alloc(0))]);
}
/// Makes a closed box of `size` m as binary STL, or without its last triangle.
export function box(size, isClosed = true) {
  const num = isClosed ? 12 : 11, file = Buffer.alloc(84 + 50 * num);
  file.writeUInt32LE(num, 80);
  for (let t = 0; t < num; ++t)
    for (let k = 0; k < 3; ++k) corner(faces[3 * t + k], size).forEach((n, axis) => file.writeFloatLE(n, 84 + 50 * t + 12 + 12 * k + 4 * axis));
  return file;
}
