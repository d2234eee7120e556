// Pose of a held tool: its center of mass and its rotation about that, in W.

import { Quaternion, Vector3 } from 'three';
import type { Pose } from '../types';

const FASTEST = 1, FASTEST_TURN = 8; // m/s and rad/s: limits of a person's hand

export class HeldPose {
  readonly center = new Vector3();
  readonly turned = new Quaternion();
  private readonly center_T = new Vector3();

  /** Sets the pose; `center` of mass in T. */
  set(X_WT: Pose, center: readonly [number, number, number]): void {
    this.center_T.fromArray(center);
    this.turned.fromArray(X_WT.quaternion).normalize();
    this.center.fromArray(center).applyQuaternion(this.turned).add(new Vector3(...X_WT.position));
  }

  copy(other: HeldPose): void {
    this.center_T.copy(other.center_T);
    this.center.copy(other.center);
    this.turned.copy(other.turned);
  }

  /** Turns by `angle`, rad, about an axis through the center of mass (right-hand rule). */
  turn(axis: Vector3, angle: number): void {
    this.turned.premultiply(new Quaternion().setFromAxisAngle(axis, angle)).normalize();
  }

  /** Moves towards `goal` at no more than the speed of a person's hand. */
  follow(goal: HeldPose, seconds: number): void {
    const way = goal.center.clone().sub(this.center);
    this.center.add(way.clampLength(0, FASTEST * seconds));
    this.turned.rotateTowards(goal.turned, FASTEST_TURN * seconds).normalize();
  }

  /** Returns the message to the program: x y z qx qy qz qw of T. */
  numbers(): number[] {
    const origin = this.center_T.clone().applyQuaternion(this.turned).negate().add(this.center);
    return [...origin.toArray(), ...this.turned.toArray()];
  }
}
