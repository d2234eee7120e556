// The page's hold on the tool: takes hold of it, sends its pose with every picture, releases it.
// Only one page holds it at a time; the program decides which.

import type { Vector3 } from 'three';
import type { Answer, Command } from '../connection';
import type { Hello, Pose } from '../types';
import { HeldPose } from './held_pose';

const LONGEST_FRAME = 0.05; // s: a page that hung does not leap

export interface HandLinks {
  send(command: Command): Promise<Answer>;
  /** Sends a message that is answered only if it is wrong. */
  tell(message: object): void;
  /** Hand pose that the program reported last; null if none. */
  pose(): Pose | null;
  /** Called at every picture while the tool is held: moves it by keys and sticks. */
  onFrame(seconds: number): void;
  onChange(): void;
}

export class Hand {
  private hello: Hello | null = null;
  private readonly goal = new HeldPose();
  private readonly at = new HeldPose();
  private holds = false;
  private isRequesting = false;
  private last = 0; // ms
  private frame = 0;

  constructor(private readonly links: HandLinks) {
    // A hidden page releases the tool: its moves would not be seen.
    document.addEventListener('visibilitychange', () => document.hidden && this.letGo());
    addEventListener('pagehide', () => this.letGo());
  }

  get isMine(): boolean {
    return this.holds;
  }

  setHello(hello: Hello): void {
    this.hello = hello;
    this.stop();
  }

  /** Holds the tool at the current hand pose. Returns false if that fails; the page has shown why. */
  async hold(): Promise<boolean> {
    const pose = this.links.pose();
    if (!this.hello?.handle || !pose || this.isRequesting) return this.holds;
    this.isRequesting = true;
    const { ok } = await this.links.send({ command: 'hold' });
    this.isRequesting = false;
    this.stop();
    if (!ok) return false;
    this.goal.set(this.links.pose() ?? pose, this.hello.tool.center_of_mass);
    this.at.copy(this.goal);
    this.holds = true;
    this.last = performance.now();
    this.frame = requestAnimationFrame((now) => this.step(now));
    this.links.tell({ hand: this.at.numbers() });
    this.links.onChange();
    return true;
  }

  letGo(): void {
    if (!this.holds) return;
    this.stop();
    void this.links.send({ command: 'release' });
  }

  /** Ends the hold after the connection was lost. */
  lose(): void {
    this.stop();
  }

  /** Takes hold again at the current hand pose after the program rejected one. */
  refused(): void {
    if (this.holds) void this.hold();
  }

  /** Moves the goal by `way`, m in W. */
  move(way: Vector3): void {
    if (this.holds) this.goal.center.add(way);
  }

  /** Turns the goal by `angle`, rad, about an axis in W through the tool's center of mass. */
  turn(axis: Vector3, angle: number): void {
    if (this.holds) this.goal.turn(axis, angle);
  }

  private stop(): void {
    cancelAnimationFrame(this.frame);
    const held = this.holds;
    this.holds = false;
    if (held) this.links.onChange();
  }

  private step(now: number): void {
    const seconds = Math.min(LONGEST_FRAME, Math.max(0, (now - this.last) / 1000));
    this.last = now;
    this.links.onFrame(seconds);
    this.at.follow(this.goal, seconds);
    this.links.tell({ hand: this.at.numbers() });
    this.frame = requestAnimationFrame((next) => this.step(next));
  }
}
