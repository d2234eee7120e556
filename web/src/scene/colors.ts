// The colors of the scene, also for legends and tests. The states of the spheres are colored as
// in the thesis (Fig. 4.4): blue inside, purple boundary, red outside. The three differ in
// lightness too, so that color-blind people can distinguish them, and all are legible on dark and
// on light ground.

import { Vector3 } from 'three';

export const STATE_COLORS = {
  inside: '#1f66e8',
  boundary: '#b45cf2',
  outside: '#e5472f',
  unknown: '#b9c0c9', // no measurement of the tool
} as const;

export const ARROW_COLORS = {
  force: '#ffb000',
  torque: '#12b886',
  hand: '#ff7a45',
} as const;

/** Start and end of a depth-change vector, as in Fig. 3.13. */
export const EDGE_COLORS = { start: '#2fb344', end: '#a33bd6' } as const;

export const OTHER_COLORS = {
  normal: '#22b8e6',
  tree: '#e0a83c',
  ghost: '#e8a13a',
  trace: '#f06595',
  fog: '#7d8794', // space that no camera sees
  wall: '#db333d', // of the mesh, at a cut
  remembered: '#a08a5c', // decided by remembered frames
} as const;

const CAMERA_COLORS = ['#2f8fe8', '#e58a1f', '#2fae5b', '#c44fd0', '#d7c22b', '#1fb8b0'] as const;

/** Returns the color of what a camera decides; -1: no camera, from `count` on: a remembered frame. */
export function cameraColor(number: number, count: number): string {
  if (number < 0) return OTHER_COLORS.fog;
  return number < count ? CAMERA_COLORS[number % CAMERA_COLORS.length] : OTHER_COLORS.remembered;
}

/** Colors of the rings that turn a tool about x, y and z. */
export const RING_COLORS = ['#f0716a', '#5cc87d', '#62a4f7'] as const;

const HEAT = ['#3fbf7f', '#f0b429', '#f2453a']; // none, half and all of the largest force

/** Returns the color of a share of the largest force. */
export function heat(share: number): string {
  const at = 2 * Math.min(1, Math.max(0, share)), i = Math.min(1, Math.floor(at));
  const mixed = rgb(HEAT[i]).lerp(rgb(HEAT[i + 1]), at - i).multiplyScalar(255).round();
  return `rgb(${mixed.x}, ${mixed.y}, ${mixed.z})`;
}

export interface Theme {
  ground: string;
  surface: string; // of the cloud
  metal: string; // of the tool's mesh
  wood: string; // of objects
  line: string; // grid and outline of the depth camera
  text: string;
  quiet: string; // text and lines of scales
}

export const THEMES: { dark: Theme; light: Theme } = {
  dark: {
    ground: '#14171c', surface: '#cfc9bf', metal: '#a9b2bd', wood: '#c49a61', line: '#5b6572', text: '#f2f3f7', quiet: '#98a2b0',
  },
  light: {
    ground: '#f4f5f7', surface: '#b5afa6', metal: '#8d97a3', wood: '#b58444', line: '#9aa3ae', text: '#1d2230', quiet: '#5d6677',
  },
};

/** Parses #rrggbb or rgb(r, g, b) to red, green and blue from 0 to 1 (sRGB). */
export function rgb(hex: string): Vector3 {
  if (hex.startsWith('rgb')) return new Vector3(...hex.match(/\d+/g)!.map(Number)).divideScalar(255);
  const n = parseInt(hex.slice(1), 16);
  return new Vector3((n >> 16) & 255, (n >> 8) & 255, n & 255).divideScalar(255);
}
