// A camera as a small pyramid of its field of view, with its name if there are several.

import { BufferAttribute, BufferGeometry, Group, LineBasicMaterial, LineSegments } from 'three';
import type { Stream } from '../../types';
import { THEMES } from '../colors';
import { Label } from '../label';

export const PYRAMID = 0.06; // m, its height
const LONGEST_NAME = 28;

/** Returns the display names of cameras, all different. */
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
  private readonly label: Label | null;

  /** `name` empty: no label. */
  constructor({ width, height, fx, fy, cx, cy }: Stream, name: string) {
    const corner = (u: number, v: number) => [((u - cx) / fx) * PYRAMID, ((v - cy) / fy) * PYRAMID, PYRAMID];
    const [w, h] = [width - 0.5, height - 0.5];
    const corners = [corner(-0.5, -0.5), corner(w, -0.5), corner(w, h), corner(-0.5, h)];
    const ends = corners.flatMap((c, i) => [[0, 0, 0], c, c, corners[(i + 1) % 4]]);
    this.pyramid.geometry.setAttribute('position', new BufferAttribute(new Float32Array(ends.flat()), 3));
    this.label = name ? new Label(name, [0, 1.4]) : null; // below the camera, to its right
    this.object.add(this.pyramid, ...(this.label ? [this.label.object] : []));
  }

  update(isDark: boolean): void {
    const theme = THEMES[isDark ? 'dark' : 'light'];
    this.lines.color.set(theme.line);
    this.label?.paint(theme);
  }

  dispose(): void {
    this.pyramid.geometry.dispose();
    this.lines.dispose();
    this.label?.dispose();
  }
}
