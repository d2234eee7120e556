// Where a hand has the tool: the centre of mass and how the tool is turned about it, all in W.

import { Quaternion, Vector3 } from 'three';
import type { Pose } from '../types';

const FASTEST = 1, FASTEST_TURN = 8; // m/s and rad/s: what a person's hand does

export class HeldPose {
  readonly centre = new Vector3();
  readonly turned = new Quaternion();
  private readonly centre_T = new Vector3();

  /// `centre` of mass in T.
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

  /// About an axis through the centre of mass, by the right hand, rad.
  turn(axis: Vector3, angle: number): void {
    this.turned.premultiply(new Quaternion().setFromAxisAngle(axis, angle)).normalize();
  }

  /// Towards another one, no faster than a hand.
  follow(goal: HeldPose, seconds: number): void {
    const way = goal.centre.clone().sub(this.centre);
    this.centre.add(way.clampLength(0, FASTEST * seconds));
    this.turned.rotateTowards(goal.turned, FASTEST_TURN * seconds).normalize();
  }

  /// As it is sent to the program: x y z qx qy qz qw of T.
  numbers(): number[] {
    const origin = this.centre_T.clone().applyQuaternion(this.turned).negate().add(this.centre);
    return [...origin.toArray(), ...this.turned.toArray()];
  }
}
