// Helpers for poses.

import { type Object3D, Quaternion, Vector3 } from 'three';
import type { Pose, Sample } from '../types';

export const NO_POSE: Pose = { position: [0, 0, 0], quaternion: [0, 0, 0, 1] };

export function setPose(object: Object3D, pose: Pose): void {
  object.position.fromArray(pose.position);
  object.quaternion.fromArray(pose.quaternion);
}

/** Reads the pose of the columns PREFIX_x ... PREFIX_qw; null if they are not finite. */
export function sampledPose(sample: Sample, prefix: 'tool' | 'hand'): Pose | null {
  const of = (name: string) => sample[`${prefix}_${name}`];
  const p = [of('x'), of('y'), of('z')], q = [of('qx'), of('qy'), of('qz'), of('qw')];
  const length = Math.hypot(...q);
  if (!p.every(Number.isFinite) || !(length > 0.5)) return null;
  return {
    position: p as Pose['position'],
    quaternion: q.map((c) => c / length) as Pose['quaternion'],
  };
}

export function sampledVector(sample: Sample, prefix: string): Vector3 {
  const of = (name: string) => sample[`${prefix}_${name}`];
  const v = new Vector3(of('x'), of('y'), of('z'));
  return Number.isFinite(v.lengthSq()) ? v : new Vector3();
}

/** Transforms a point from T to W. */
export function transformed(X_WT: Pose, p_T: readonly [number, number, number]): Vector3 {
  return new Vector3(...p_T).applyQuaternion(new Quaternion(...X_WT.quaternion))
    .add(new Vector3(...X_WT.position));
}

/** Transforms a point from W to T. */
export function inverted(X_WT: Pose, p_W: Vector3): Vector3 {
  return p_W.clone().sub(new Vector3(...X_WT.position)).applyQuaternion(new Quaternion(...X_WT.quaternion).conjugate());
}

/** Returns X_CT of X_WC and X_WT. */
export function inFrame(X_WC: Pose, X_WT: Pose): Pose {
  const q_CT = new Quaternion(...X_WC.quaternion).conjugate().multiply(new Quaternion(...X_WT.quaternion));
  return {
    position: inverted(X_WC, new Vector3(...X_WT.position)).toArray(),
    quaternion: q_CT.toArray() as Pose['quaternion'],
  };
}

export function distance(a: Pose, b: Pose): number {
  return Math.hypot(...a.position.map((x, i) => x - b.position[i]));
}

/** Returns the angle between two orientations, rad. */
export function rotationBetween(a: Pose, b: Pose): number {
  return new Quaternion(...a.quaternion).angleTo(new Quaternion(...b.quaternion));
}
