// A scale bar and the axes of the world (of a tool alone, its own), in the corner of the picture.

import {
  BufferAttribute, BufferGeometry, type Camera, LineBasicMaterial, LineSegments, OrthographicCamera, Quaternion, Scene, Vector3,
  type WebGLRenderer,
} from 'three';
import { RING_COLORS, THEMES } from './colors';
import { Label } from './label';
import { roundUp } from './steady_scale';

const EDGE = 18, AXIS = 24, SHORTEST = 60; // CSS pixels: from the edges of the picture; of an axis; of the bar
const MIDDLE = [EDGE + AXIS + 8, EDGE + AXIS + 44];

export class Gauge {
  private readonly scene = new Scene();
  private readonly view = new OrthographicCamera(0, 1, 1, 0, -100, 100);
  private readonly barLines = new LineBasicMaterial();
  private readonly bar = new LineSegments(lines(3), this.barLines);
  private readonly axes = RING_COLORS.map((color) => new LineSegments(lines(1), new LineBasicMaterial({ color })));
  private readonly names = ['x', 'y', 'z'].map((name) => new Label(name, [0.5, 0.5], true, 'quiet'));
  private readonly size = new Label('', [0.5, 0], true, 'quiet');

  constructor() {
    this.scene.add(this.bar, this.size.object, ...this.axes, ...this.names.map(({ object }) => object));
    for (const object of [this.bar, ...this.axes]) object.frustumCulled = false;
  }

  /** Draws over a picture of `camera`; `metersPerPixel` where one looks at, `turned`: the shown frame in W. */
  draw(
    renderer: WebGLRenderer, camera: Camera, [width, height]: readonly number[], metersPerPixel: number, turned: Quaternion,
    isDark: boolean,
  ): void {
    Object.assign(this.view, { right: width, top: height });
    this.view.updateProjectionMatrix();
    const theme = THEMES[isDark ? 'dark' : 'light'];
    this.barLines.color.set(theme.quiet);
    const meters = roundUp(SHORTEST * metersPerPixel), right = EDGE + meters / metersPerPixel;
    this.size.words = meters < 0.01 ? `${Number((1000 * meters).toPrecision(1))} mm` :
      meters < 1 ? `${Math.round(100 * meters)} cm` : `${meters} m`;
    for (const label of [this.size, ...this.names]) label.paint(theme);
    this.size.object.position.set(0.5 * (EDGE + right), EDGE + 2, 0);
    place(this.bar, [EDGE, EDGE, right, EDGE, EDGE, EDGE - 4, EDGE, EDGE + 4, right, EDGE - 4, right, EDGE + 4]);
    const seen = camera.getWorldQuaternion(new Quaternion()).conjugate().multiply(turned);
    this.axes.forEach((axis, i) => {
      const { x, y } = new Vector3().setComponent(i, AXIS).applyQuaternion(seen);
      place(axis, [MIDDLE[0], MIDDLE[1], MIDDLE[0] + x, MIDDLE[1] + y]);
      this.names[i].object.position.set(MIDDLE[0] + 1.35 * x, MIDDLE[1] + 1.35 * y, 0);
    });
    renderer.autoClear = false;
    renderer.clearDepth();
    renderer.render(this.scene, this.view);
    renderer.autoClear = true;
  }

  dispose(): void {
    for (const object of [this.bar, ...this.axes]) {
      object.geometry.dispose();
      object.material.dispose();
    }
    for (const label of [this.size, ...this.names]) label.dispose();
  }
}

/** Makes this many lines; place() sets both ends, x y each. */
function lines(count: number): BufferGeometry {
  return new BufferGeometry().setAttribute('position', new BufferAttribute(new Float32Array(6 * count), 3));
}

function place({ geometry }: LineSegments, ends: number[]): void {
  const positions = geometry.attributes.position;
  for (let i = 0; i < positions.count; ++i) positions.setXY(i, ends[2 * i], ends[2 * i + 1]);
  positions.needsUpdate = true;
}
