// Reference lines: the axes of W; for a tool alone its axes over a grid.

import { AxesHelper, GridHelper, Group, LineBasicMaterial } from 'three';
import type { Hello, SceneOptions } from '../types';
import { RING_COLORS, THEMES } from './colors';
import { PYRAMID } from './cameras/frustum';

export class Landmarks {
  readonly object = new Group();
  private readonly lines = new LineBasicMaterial({ transparent: true, opacity: 0.8 });
  private grid = new GridHelper();
  private axes = new AxesHelper();

  setHello(hello: Hello): void {
    this.object.remove(this.grid, this.axes);
    this.grid.dispose();
    this.axes.dispose();
    if (hello.streams.length > 0) {
      this.axes = new AxesHelper(0.7 * PYRAMID);
    } else {
      const { radius, center_of_mass: center } = hello.tool;
      this.axes = new AxesHelper(1.3 * radius);
      this.axes.quaternion.set(1, 0, 0, 0); // y up, as the tool
      this.grid = new GridHelper(6 * radius, 12);
      this.grid.material = this.lines;
      this.grid.geometry.deleteAttribute('color');
      this.grid.position.set(center[0], center[1] + 1.15 * radius, center[2]);
      this.object.add(this.grid);
    }
    this.axes.setColors(...(RING_COLORS as unknown as [string, string, string]));
    this.object.add(this.axes);
  }

  update(options: SceneOptions): void {
    this.lines.color.set(THEMES[options.dark ? 'dark' : 'light'].line);
    this.object.visible = options.view !== 'camera';
  }

  dispose(): void {
    this.grid.dispose();
    this.axes.dispose();
    this.lines.dispose();
  }
}
