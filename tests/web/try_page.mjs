// The page without a program in a browser, for its tests.
//
// Environment: PALPATE_WEB_CORE, folder of make web-core; PALPATE_TRY_PICTURES, a folder for pictures.
import { existsSync } from 'node:fs';
import { join } from 'node:path';
import { deflateSync } from 'node:zlib';

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

export const corner = (i, size) => [0, 1, 2].map((axis) => size * ((i >> axis) & 1));
export const faces = [0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4, 2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5];
/// Makes a gray PNG with a checksum of zero, which browsers' decoders would refuse and ours does not look at.
export function png(width, height, bits, value, filter = 0) {
  const chunk = (name, data) => {
    const head = Buffer.alloc(8);
    head.writeUInt32BE(data.length);
    head.write(name, 4);
    return Buffer.concat([head, data, Buffer.alloc(4)]);
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
