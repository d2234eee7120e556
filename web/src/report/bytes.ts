// Binary data inside the JSON of a report.

export function bytes(base64: string): Uint8Array<ArrayBuffer> {
  return Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
}

/** Decodes floats, little-endian as on every browser. */
export const floats = (base64: string) => new Float32Array(bytes(base64).buffer);
export const integers = (base64: string) => new Uint32Array(bytes(base64).buffer);

export interface Depth { width: number; height: number; values: Uint16Array }

/**
 * Unpacks a depth image of src/session/report/run_page.cpp: zlib of the differences of each pixel to the one on its
 * left, first all low bytes, then all high ones.
 */
export async function unpackDepth(base64: string, width: number, height: number): Promise<Depth> {
  const plain = new Blob([bytes(base64)]).stream().pipeThrough(new DecompressionStream('deflate'));
  const parts = new Uint8Array(await new Response(plain).arrayBuffer());
  const num = width * height;
  const values = new Uint16Array(num);
  for (let i = 0; i < num; ++i) values[i] = (i % width ? values[i - 1] : 0) + parts[i] + 256 * parts[num + i];
  return { width, height, values };
}
