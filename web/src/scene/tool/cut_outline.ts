// Outline of the tool's mesh in a cutting plane, as line segments.

import { BufferAttribute, BufferGeometry, LineBasicMaterial, LineSegments } from 'three';
import type { Mesh } from '../../types';
import { OTHER_COLORS } from '../colors';

export class CutOutline {
  readonly object = new LineSegments(new BufferGeometry(), new LineBasicMaterial({ color: OTHER_COLORS.wall }));
  private mesh: Mesh | null = null;

  constructor() {
    this.object.frustumCulled = this.object.visible = false;
  }

  setMesh(mesh: Mesh): void {
    this.mesh = mesh;
  }

  /** Sets the plane n . p = d in T. */
  setPlane(n: readonly number[], d: number): void {
    if (!this.mesh) return;
    const ends = sections(this.mesh, n, d);
    this.object.visible = ends.length > 0;
    this.object.geometry.dispose();
    this.object.geometry = new BufferGeometry();
    this.object.geometry.setAttribute('position', new BufferAttribute(new Float32Array(ends), 3));
  }

  dispose(): void {
    this.object.geometry.dispose();
    this.object.material.dispose();
  }
}

/** Returns both ends, x y z each, of the intersection of each triangle with the plane. */
function sections({ positions, triangles }: Mesh, n: readonly number[], d: number): number[] {
  const height = (i: number) =>
    n[0] * positions[3 * i] + n[1] * positions[3 * i + 1] + n[2] * positions[3 * i + 2] - d;
  const ends: number[] = [];
  for (let t = 0; t < triangles.length; t += 3) {
    const corners = [triangles[t], triangles[t + 1], triangles[t + 2]];
    const heights = corners.map(height);
    // The plane cuts both edges at the vertex that is alone on its side.
    const alone = [0, 1, 2].find((k) =>
      (heights[k] > 0) !== (heights[(k + 1) % 3] > 0) && (heights[k] > 0) !== (heights[(k + 2) % 3] > 0));
    if (alone === undefined) continue;
    for (const other of [(alone + 1) % 3, (alone + 2) % 3]) {
      const share = heights[alone] / (heights[alone] - heights[other]);
      for (let k = 0; k < 3; ++k) {
        const a = positions[3 * corners[alone] + k], b = positions[3 * corners[other] + k];
        ends.push(a + share * (b - a));
      }
    }
  }
  return ends;
}
