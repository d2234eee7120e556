// A camera as a small pyramid of what it sees, with its name where there are several.

import {
  BufferAttribute, BufferGeometry, CanvasTexture, Group, LineBasicMaterial, LineSegments, Sprite, SpriteMaterial,
} from 'three';
import type { Stream } from '../types';
import { THEMES } from './colours';

export const PYRAMID = 0.06; // m, its height
const LONGEST_NAME = 28;
const TEXT = 40, SIZE = 0.028; // pixels of the texture; height of a line, of the canvas

/// What people call them: no two alike.
export function cameraNames(streams: readonly Stream[]): string[] {
  const isShared = (name: string) => streams.filter((stream) => stream.name === name).length > 1;
  return streams.map(({ name }, i) => {
    const short = name.length > LONGEST_NAME ? `…${name.slice(1 - LONGEST_NAME)}` : name;
    return isShared(name) || short !== name ? `${i + 1}: ${short}` : short;
  });
}

export class Frustum {
  readonly object = new Group();
  private readonly lines = new LineBasicMaterial({ transparent: true, opacity: 0.8 });
  private readonly pyramid = new LineSegments(new BufferGeometry(), this.lines);
  private readonly label: Sprite | null;

  /// `name` empty: without a label.
  constructor({ width, height, fx, fy, cx, cy }: Stream, name: string) {
    const corner = (u: number, v: number) => [((u - cx) / fx) * PYRAMID, ((v - cy) / fy) * PYRAMID, PYRAMID];
    const [w, h] = [width - 0.5, height - 0.5];
    const corners = [corner(-0.5, -0.5), corner(w, -0.5), corner(w, h), corner(-0.5, h)];
    const ends = corners.flatMap((c, i) => [[0, 0, 0], c, c, corners[(i + 1) % 4]]);
    this.pyramid.geometry.setAttribute('position', new BufferAttribute(new Float32Array(ends.flat()), 3));
    this.label = name ? written(name) : null;
    this.object.add(this.pyramid, ...(this.label ? [this.label] : []));
  }

  update(isDark: boolean): void {
    const { line, metal } = THEMES[isDark ? 'dark' : 'light'];
    this.lines.color.set(line);
    this.label?.material.color.set(metal);
  }

  dispose(): void {
    this.pyramid.geometry.dispose();
    this.lines.dispose();
    this.label?.material.map?.dispose();
    this.label?.material.dispose();
  }
}

/// As large as text on the page, wherever it is.
function written(name: string): Sprite {
  const canvas = document.createElement('canvas');
  const context = canvas.getContext('2d')!;
  const font = `${0.7 * TEXT}px system-ui, sans-serif`;
  context.font = font;
  canvas.width = Math.ceil(context.measureText(name).width) + 8;
  canvas.height = TEXT;
  context.font = font;
  context.fillStyle = '#fff';
  context.textBaseline = 'middle';
  context.fillText(name, 4, TEXT / 2);
  const label = new Sprite(new SpriteMaterial({ map: new CanvasTexture(canvas), sizeAttenuation: false, depthWrite: false }));
  label.center.set(0, 1.4); // below the camera, to its right
  label.scale.set((SIZE * canvas.width) / canvas.height, SIZE, 1);
  return label;
}
