// The page's own constants (web/src/scene/colors.ts), and what a lit surface of a color looks like.
import { readFileSync } from 'node:fs';

const source = readFileSync(new URL('../../../web/src/scene/colors.ts', import.meta.url), 'utf8');

/// E.g. color('boundary') is [194, 123, 255].
export function color(name) {
  const [, hex] = source.match(new RegExp(`\\b${name}: '#([0-9a-f]{6})'`));
  return [0, 2, 4].map((i) => parseInt(hex.slice(i, i + 2), 16));
}

/// Of what the first, second, ... camera decides.
export const cameraColors = source.match(/CAMERA_COLORS = \[([^\]]*)\]/)[1].match(/[0-9a-f]{6}/g)
  .map((hex) => [0, 2, 4].map((i) => parseInt(hex.slice(i, i + 2), 16)));

/// Light makes a color brighter or darker, flat sides are paler as well: `seen` is nearest to a c +
/// b white. Returns the share of white in it, its brightness, and how far off it is (0 to 255).
function paint(seen, c) {
  const dot = (p, q) => p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
  const w = [255, 255, 255];
  const [cc, cw, ww, sc, sw] = [dot(c, c), dot(c, w), dot(w, w), dot(seen, c), dot(seen, w)];
  const det = cc * ww - cw * cw;
  const a = (sc * ww - sw * cw) / det, b = (sw * cc - sc * cw) / det;
  const off = Math.hypot(...seen.map((x, i) => x - a * c[i] - b * w[i]));
  return { white: b / (a + b), bright: a + b, off };
}

/// Is `seen` the color `c` under some light? (Antialiased rims are not.)
export function isLit(seen, c) {
  const { white, bright, off } = paint(seen, c);
  return off < 6 && bright > 0.15 && Math.abs(white) * bright < 0.04;
}
/// The same, but paler.
export function isPale(seen, c) {
  const { white, bright, off } = paint(seen, c);
  return off < 6 && bright > 0.15 && white > 0.1 && white < 0.7;
}
/// The same without light.
export const isJust = (seen, c) => Math.hypot(...seen.map((x, i) => x - c[i])) < 9;
