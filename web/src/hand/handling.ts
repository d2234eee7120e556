// The page as a haptic device: connects the inputs that move the hand with the displays of its force.

import type { Answer, Command } from '../connection';
import type { Hello, Sample, SceneView, State } from '../types';
import { norm } from '../format';
import { HoldCard } from './card';
import { Hand } from './hand';
import { Pointer } from './pointer';
import { HeldKeys, moveAt, Pad, type Rates } from './rates';
import { Vibration } from './vibration';

const LEAST_FORCE = 0.02; // N: smallest force that is labeled at the tool

export interface HandlingLinks {
  scene: SceneView;
  stage: HTMLElement;
  send(command: Command): Promise<Answer>;
  tell(message: object): void;
  /** Requests a drawing of the scene. */
  requestDraw(): void;
}

export class Handling {
  readonly card: HoldCard;
  readonly hand: Hand;
  private readonly keys = new HeldKeys(() => this.hand.isMine);
  private readonly pad: Pad;
  private readonly vibration = new Vibration();
  private hello: Hello | null = null;
  private state: State | null = null;
  private share = 0; // of the largest force
  private newtons = 0;

  constructor(private readonly links: HandlingLinks) {
    const { scene, stage, send, tell } = links;
    this.hand = new Hand({
      send, tell,
      pose: () => scene.handPose,
      onFrame: (seconds) => this.move(seconds),
      onChange: () => this.show(),
    });
    this.card = new HoldCard(() => void this.hand.hold(), () => this.hand.letGo());
    this.pad = new Pad(() => void this.hand.hold(), () => this.hand.letGo());
    new Pointer(stage, scene, this.hand, () => this.canBeHeld, links.requestDraw);
    stage.append(this.card.label);
    addEventListener('gamepadconnected', () => this.lookAtPad());
  }

  private get canBeHeld(): boolean {
    return this.hello?.handle != null && this.state?.running === true;
  }

  setHello(hello: Hello): void {
    this.hello = hello;
    this.state = null;
    this.hand.setHello(hello);
    this.show();
  }

  setState(state: State): void {
    this.state = state;
    if (!state.running) this.hand.lose();
    this.show();
  }

  lose(): void {
    this.state = null;
    this.hand.lose();
    this.show();
  }

  toggle(): void {
    if (this.hand.isMine) this.hand.letGo();
    else if (this.canBeHeld) void this.hand.hold();
  }

  setSample(sample: Sample): void {
    const most = this.hello?.handle?.max_force;
    if (!most) return;
    const force: [number, number, number] = [sample.force_x, sample.force_y, sample.force_z];
    this.newtons = norm(...force);
    this.share = this.newtons / most;
    this.links.scene.setStrain(this.share);
    if (this.hand.isMine) this.vibration.follow([force[0] / most, force[1] / most, force[2] / most], Pad.first());
    else this.vibration.stop();
  }

  /** Places the force label at the hand; called once per drawing. */
  place(): void {
    const { label } = this.card;
    const pose = this.links.scene.handPose;
    label.hidden = !this.hello?.handle || this.newtons < LEAST_FORCE || !pose;
    if (label.hidden || !pose) return;
    const [x, y] = this.links.scene.projectHand();
    label.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
  }

  /** Updates the card; called a few times a second. */
  update(): void {
    if (this.hello?.handle) this.card.setForce(this.newtons, this.share);
  }

  private show(): void {
    const { hello, state, hand } = this;
    this.links.scene.setHeld(hand.isMine);
    const holding = hand.isMine ? 'mine' : state?.handle === 'held' ? 'other' : 'free';
    this.card.show(hello?.handle && this.canBeHeld ? holding : null);
    this.links.requestDraw();
  }

  private move(seconds: number): void {
    const [keys, pad] = [this.keys.rates(), this.pad.rates()];
    const rates = keys.map((rate, i) => rate + pad[i]) as Rates;
    rates[2] += this.card.pushes;
    moveAt(rates, seconds, this.links.scene, this.hand);
  }

  /** Polls the gamepad: the browser reports its buttons only when polled. */
  private lookAtPad(): void {
    if (!this.pad.isThere) return;
    if (this.canBeHeld) this.pad.look();
    requestAnimationFrame(() => this.lookAtPad());
  }
}
