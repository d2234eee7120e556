// Pose of a held tool: its center of mass and its rotation about that, in W.

import { Quaternion, Vector3 } from 'three';
import type { Pose } from '../types';

const FASTEST = 1, FASTEST_TURN = 8; // m/s and rad/s: limits of a person's hand

export class HeldPose {
  readonly centre = new Vector3();
  readonly turned = new Quaternion();
  private readonly centre_T = new Vector3();

  /** Sets the pose; `centre` of mass in T. */
  set(X_WT: Pose, centre: readonly [number, number, number]): void {
    this.centre_T.fromArray(centre);
    this.turned.fromArray(X_WT.quaternion).normalize();
    this.centre.fromArray(centre).applyQuaternion(this.turned).add(new Vector3(...X_WT.position));
  }

  copy(other: HeldPose): void {
    this.centre_T.copy(other.centre_T);
    this.centre.copy(other.centre);
    this.turned.copy(other.turned);
  }

  /** Turns by `angle`, rad, about an axis through the center of mass (right-hand rule). */
  turn(axis: Vector3, angle: number): void {
    this.turned.premultiply(new Quaternion().setFromAxisAngle(axis, angle)).normalize();
  }

  /** Moves towards `goal` at no more than the speed of a person's hand. */
  follow(goal: HeldPose, seconds: number): void {
    const way = goal.centre.clone().sub(this.centre);
    this.centre.add(way.clampLength(0, FASTEST * seconds));
    this.turned.rotateTowards(goal.turned, FASTEST_TURN * seconds).normalize();
  }

  /** Returns the message to the program: x y z qx qy qz qw of T. */
  numbers(): number[] {
    const origin = this.centre_T.clone().applyQuaternion(this.turned).negate().add(this.centre);
    return [...origin.toArray(), ...this.turned.toArray()];
  }
}
