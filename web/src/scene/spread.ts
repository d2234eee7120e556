// The ellipsoid of one standard deviation of a vector, at the tip of its arrow. A unit sphere
// times a factor L of its covariance, L L^T, is that ellipsoid.

import { BackSide, Group, Matrix4, Mesh, MeshBasicMaterial, SphereGeometry, type Vector3 } from 'three';

/** xx, xy, xz, yy, yz, zz of a covariance. */
export type Covariance = readonly number[];
export const COVARIANCE = ['xx', 'xy', 'xz', 'yy', 'yz', 'zz'] as const;

export class Spread {
  readonly object = new Group();
  private readonly geometry = new SphereGeometry(1, 24, 16);
  private readonly material: MeshBasicMaterial;

  constructor(color: string) {
    // The far side alone: what lies inside stays visible, and no face is drawn twice.
    this.material = new MeshBasicMaterial({ color, transparent: true, opacity: 0.35, depthWrite: false, side: BackSide });
    this.object.add(new Mesh(this.geometry, this.material));
    this.object.matrixAutoUpdate = false;
    this.object.visible = false;
  }

  /** Shows it around `tip`; `scale`: length of one unit of the vector. Without a covariance it is hidden. */
  place(tip: Vector3, covariance: Covariance, scale: number): void {
    const [xx, xy, xz, yy, yz, zz] = covariance;
    this.object.visible = xx > 0 && yy > 0 && zz > 0;
    if (!this.object.visible) return;
    // Cholesky; rounding may leave a little less than nothing.
    const a = Math.sqrt(xx), b = xy / a, c = xz / a;
    const d = Math.sqrt(Math.max(yy - b * b, 1e-6 * yy)), e = (yz - b * c) / d;
    const f = Math.sqrt(Math.max(zz - c * c - e * e, 1e-6 * zz));
    this.object.matrix.copy(new Matrix4().set(
      scale * a, 0, 0, tip.x, scale * b, scale * d, 0, tip.y, scale * c, scale * e, scale * f, tip.z, 0, 0, 0, 1));
    this.object.matrixWorldNeedsUpdate = true;
  }

  dispose(): void {
    this.geometry.dispose();
    this.material.dispose();
  }
}
