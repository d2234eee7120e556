// Quiet lines that say where things are: the depth camera with what it sees, and for a tool alone
// the axes of its frame over a grid.

import {
  AxesHelper, BufferAttribute, BufferGeometry, Group, GridHelper, LineBasicMaterial, LineSegments,
} from 'three';
import type { Hello, SceneOptions } from '../types';
import { THEMES } from './colours';

const LENGTH = 0.06; // m, of the camera's pyramid

export class Landmarks {
  readonly object = new Group();
  private readonly lines = new LineBasicMaterial({ transparent: true, opacity: 0.8 });
  private readonly pyramid = new LineSegments(new BufferGeometry(), this.lines);
  private grid = new GridHelper();
  private axes = new AxesHelper();

  constructor() {
    this.object.add(this.pyramid);
  }

  setHello(hello: Hello): void {
    this.object.remove(this.grid, this.axes);
    this.grid.dispose();
    this.axes.dispose();
    this.pyramid.visible = hello.stream !== null;
    if (hello.stream) {
      this.setStream(hello.stream);
      this.axes = new AxesHelper(0.7 * LENGTH);
    } else {
      const { radius, centre_of_mass: centre } = hello.tool;
      this.axes = new AxesHelper(1.3 * radius);
      this.grid = new GridHelper(6 * radius, 12);
      this.grid.material = this.lines;
      this.grid.geometry.deleteAttribute('color');
      this.grid.position.set(centre[0], centre[1] + 1.15 * radius, centre[2]);
      this.object.add(this.grid);
    }
    this.object.add(this.axes);
  }

  update(options: SceneOptions): void {
    this.lines.color.set(THEMES[options.dark ? 'dark' : 'light'].line);
    this.object.visible = options.view !== 'camera';
  }

  dispose(): void {
    this.pyramid.geometry.dispose();
    this.grid.dispose();
    this.axes.dispose();
    this.lines.dispose();
  }

  private setStream({ width, height, fx, fy, cx, cy }: NonNullable<Hello['stream']>): void {
    const corner = (u: number, v: number) => [((u - cx) / fx) * LENGTH, ((v - cy) / fy) * LENGTH, LENGTH];
    const [w, h] = [width - 0.5, height - 0.5];
    const corners = [corner(-0.5, -0.5), corner(w, -0.5), corner(w, h), corner(-0.5, h)];
    const ends = corners.flatMap((c, i) => [[0, 0, 0], c, c, corners[(i + 1) % 4]]);
    this.pyramid.geometry.setAttribute('position', new BufferAttribute(new Float32Array(ends.flat()), 3));
  }
}
