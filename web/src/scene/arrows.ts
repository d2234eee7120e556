// Force and torque on the tool, and the force of the coupling on the hand.
//
// Contact force and torque are known in W and start at the tool's center of mass: the force as a
// straight arrow, the torque as an arrow bent about its axis by the right-hand rule. The device's
// force is known in the device's base frame, whose pose in W the page does not know; but the
// coupling is a spring, so its force on the hand points from the hand's pose to the tool's. It is
// drawn in that direction, with the length of the device's force.

import { Group } from 'three';
import { digits } from '../format';
import type { ArrowScale, Pose, Sample } from '../types';
import { Arrow } from './arrow';
import { ARROW_COLORS, THEMES } from './colors';
import { Label } from './label';
import { sampledVector, transformed } from './poses';
import { COVARIANCE, Spread } from './spread';
import { SteadyScale } from './steady_scale';

const LEAST_STRETCH = 1e-4; // m: shorter has no direction

export class Arrows {
  readonly object = new Group();
  private readonly force = new Arrow(ARROW_COLORS.force);
  private readonly spread = new Spread(ARROW_COLORS.force); // of the force, if its covariance is known
  private readonly torque = new Arrow(ARROW_COLORS.torque);
  private readonly hand = new Arrow(ARROW_COLORS.hand);
  private readonly newtons = new SteadyScale(0.05);
  private readonly newtonMeters = new SteadyScale(0.0005);
  private scale: ArrowScale | null = null; // null: follows the recent samples
  private readonly labels = [0, 1].map(() => new Label('', [0.5, 0.5], true)); // of force and torque
  private radius = 0.1; // of the tool
  private hasSpring = false;
  private center: [number, number, number] = [0, 0, 0]; // of mass, in T

  constructor() {
    this.object.add(this.spread.object, this.force.object, this.torque.object, this.hand.object, ...this.labels.map(({ object }) => object));
  }

  /** `hasSpring`: the hand's force is drawn as a spring, and written there, instead of as an arrow. */
  setTool(radius: number, center: [number, number, number], hasSpring: boolean): void {
    this.radius = radius;
    this.hasSpring = hasSpring;
    this.center = center;
    for (const { object } of [this.spread, this.force, this.torque, this.hand, ...this.labels]) object.visible = false;
  }

  setScale(scale: ArrowScale): void {
    this.scale = scale;
  }

  setSample(sample: Sample, X_WT: Pose, X_WT_hand: Pose | null): void {
    const { radius } = this;
    const center = transformed(X_WT, this.center);
    const contactForce = sampledVector(sample, 'contact_force');
    const contactTorque = sampledVector(sample, 'contact_torque');
    const handForce = sampledVector(sample, 'force').length();
    // An arrow of the scale's full length is twice as long as the tool's radius.
    const perNewton = (2 * radius) /
      (this.scale?.force ?? this.newtons.update(sample.time, Math.max(contactForce.length(), handForce)));
    const words = [`${digits(contactForce.length())} N`, `${digits(1000 * contactTorque.length(), 1)} N mm`];
    this.force.straight(center, contactForce.multiplyScalar(perNewton), 0.042 * radius);
    this.spread.place(this.force.tip, COVARIANCE.map((part) => sample[`contact_force_${part}`] ?? 0), perNewton);
    this.spread.object.visible &&= this.force.object.visible;

    const full = this.scale?.torque ?? this.newtonMeters.update(sample.time, contactTorque.length());
    this.torque.bent(center, contactTorque, 1.15 * radius, (1.75 * Math.PI * contactTorque.length()) / full,
      0.028 * radius);
    this.labels.forEach((made, i) => {
      const { object, tip } = [this.force, this.torque][i], label = made.object;
      made.words = words[i];
      label.visible = object.visible && !this.hasSpring;
      label.position.subVectors(tip, center).setLength(0.25 * radius).add(tip);
    });

    this.hand.object.visible = false;
    if (!X_WT_hand || this.hasSpring) return;
    const held = transformed(X_WT_hand, this.center);
    const stretch = center.sub(held);
    if (stretch.length() < LEAST_STRETCH) return;
    this.hand.straight(held, stretch.setLength(handForce * perNewton), 0.034 * radius);
  }

  update(shown: boolean, isDark: boolean): void {
    this.object.visible = shown;
    for (const label of this.labels) label.paint(THEMES[isDark ? 'dark' : 'light']);
  }

  dispose(): void {
    for (const part of [this.spread, this.force, this.torque, this.hand, ...this.labels]) part.dispose();
  }
}
