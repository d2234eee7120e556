// Three rings that turn a held tool: red, green and blue about x, y and z of T.

import { BufferAttribute, BufferGeometry, Group, LineBasicMaterial, LineLoop, Quaternion, Vector3 } from 'three';
import type { Grasp } from '../../types';
import { RING_COLORS } from '../colors';

const CORNERS = 96;
const QUIET = 0.75; // opacity of a ring without pointer

export class Rings {
  readonly object = new Group();
  private readonly rings: LineLoop<BufferGeometry, LineBasicMaterial>[] = [];
  private radius = 0.1;
  private pointed = -1;

  constructor() {
    RING_COLORS.forEach((color, axis) => {
      const corners: number[] = [];
      for (let i = 0; i < CORNERS; ++i) {
        const angle = (2 * Math.PI * i) / CORNERS, p = [0, 0, 0];
        p[(axis + 1) % 3] = Math.cos(angle);
        p[(axis + 2) % 3] = Math.sin(angle);
        corners.push(...p);
      }
      const geometry = new BufferGeometry();
      geometry.setAttribute('position', new BufferAttribute(new Float32Array(corners), 3));
      const material = new LineBasicMaterial({ color, transparent: true, opacity: QUIET, depthTest: false });
      const ring = new LineLoop(geometry, material);
      ring.renderOrder = 2;
      ring.frustumCulled = false;
      this.rings.push(ring);
      this.object.add(ring);
    });
    this.object.visible = false;
  }

  place(center: Vector3, turned: Quaternion, toolRadius: number): void {
    this.radius = 1.12 * toolRadius;
    this.object.position.copy(center);
    this.object.quaternion.copy(turned);
    this.object.scale.setScalar(this.radius);
  }

  point(at: Grasp | null): void {
    this.pointed = at?.kind === 'ring' ? at.number : -1;
    this.rings.forEach((ring, i) => (ring.material.opacity = i === this.pointed ? 1 : QUIET));
  }

  /** Returns the nearest ring within `reach` pixels. `project`: W to pixels. */
  grasp(x: number, y: number, reach: number, project: (p: Vector3) => [number, number]): Grasp | null {
    if (!this.object.visible) return null;
    let found: Grasp | null = null, nearest = reach;
    const { position, quaternion } = this.object;
    for (let axis = 0; axis < 3; ++axis) {
      for (let i = 0; i < CORNERS; ++i) {
        const at = (angle: number): [number, number] => {
          const p = new Vector3();
          p.setComponent((axis + 1) % 3, this.radius * Math.cos(angle));
          p.setComponent((axis + 2) % 3, this.radius * Math.sin(angle));
          return project(p.applyQuaternion(quaternion).add(position));
        };
        const angle = (2 * Math.PI * i) / CORNERS, step = 0.01;
        const [u, v] = at(angle), apart = Math.hypot(u - x, v - y);
        if (apart >= nearest) continue;
        nearest = apart;
        const [u1, v1] = at(angle + step);
        const direction = new Vector3().setComponent(axis, 1).applyQuaternion(quaternion);
        found = { kind: 'ring', number: axis, axis: direction, perRadian: [(u1 - u) / step, (v1 - v) / step] };
      }
    }
    return found;
  }

  dispose(): void {
    for (const ring of this.rings) {
      ring.geometry.dispose();
      ring.material.dispose();
    }
  }
}
