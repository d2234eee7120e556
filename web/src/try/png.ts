// Reads a gray PNG of 16 bits. A canvas would give 8 of them.
import type { GivenImage } from './given_image';

const SIGNATURE = [137, 80, 78, 71, 13, 10, 26, 10];
const LARGEST = 4096, SMALLEST = 8; // pixels
const BYTES = 2;

/** Returns the inflated bytes if they are `size` many, else null; no more than that are kept. */
async function inflated(parts: Uint8Array[], size: number): Promise<Uint8Array | null> {
  const reader = new Blob(parts as BlobPart[]).stream().pipeThrough(new DecompressionStream('deflate')).getReader();
  const all = new Uint8Array(size);
  for (let at = 0; ;) {
    const { done, value } = await reader.read();
    if (done) return at === size ? all : null;
    if (at + value.length > size) {
      await reader.cancel();
      return null;
    }
    all.set(value, at);
    at += value.length;
  }
}

/** Returns the bytes of all rows without the filters that the PNG specification (section 9) puts before them; null for unknown filters. */
function unfiltered(raw: Uint8Array, width: number, height: number): Uint8Array | null {
  const stride = BYTES * width, rows = new Uint8Array(stride * height);
  for (let v = 0; v < height; ++v) {
    const filter = raw[v * (stride + 1)];
    if (filter > 4) return null;
    for (let i = 0; i < stride; ++i) {
      const at = v * stride + i;
      const a = i >= BYTES ? rows[at - BYTES] : 0, b = v > 0 ? rows[at - stride] : 0;
      const c = i >= BYTES && v > 0 ? rows[at - stride - BYTES] : 0;
      const p = a + b - c, [pa, pb, pc] = [Math.abs(p - a), Math.abs(p - b), Math.abs(p - c)];
      const predicted = [0, a, b, (a + b) >> 1, pa <= pb && pa <= pc ? a : pb <= pc ? b : c][filter];
      rows[at] = raw[v * (stride + 1) + 1 + i] + predicted;
    }
  }
  return rows;
}

/** Reads the image; throws one sentence if it is no 16-bit gray PNG. */
export async function readDepthPng(name: string, bytes: Uint8Array): Promise<GivenImage> {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (bytes.length < 33 || SIGNATURE.some((byte, i) => bytes[i] !== byte)) throw new Error(`${name} is no PNG file; export the depth image as a 16-bit PNG.`);
  const width = view.getUint32(16), height = view.getUint32(20), [depth, color, , , interlace] = bytes.subarray(24, 29);
  if (depth !== 16 || color !== 0)
    throw new Error(`${name} has ${depth} bits per pixel${color === 0 ? '' : ' and colors'}, and depth needs 16 in gray; save the raw depth image of the camera as a 16-bit PNG.`);
  if (interlace !== 0) throw new Error(`${name} is interlaced; save it as a plain PNG.`);
  if (Math.min(width, height) < SMALLEST || Math.max(width, height) > LARGEST)
    throw new Error(`${name} has ${width} x ${height} pixels; give an image of ${SMALLEST} to ${LARGEST} on each side.`);
  const parts: Uint8Array[] = [];
  for (let at = 8; at + 12 <= bytes.length;) {
    const length = view.getUint32(at);
    if (String.fromCharCode(...bytes.subarray(at + 4, at + 8)) === 'IDAT') parts.push(bytes.subarray(at + 8, at + 8 + length));
    at += 12 + length;
  }
  const raw = await inflated(parts, (BYTES * width + 1) * height).catch(() => null), rows = raw && unfiltered(raw, width, height);
  if (!rows) throw new Error(`${name} is damaged or truncated; export it again.`);
  const counts = new Uint16Array(width * height);
  for (let i = 0; i < counts.length; ++i) counts[i] = (rows[BYTES * i] << 8) | rows[BYTES * i + 1];
  return { name, width, height, counts };
}
