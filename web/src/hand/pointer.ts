// Mouse, pen and touch on the tool. Events that miss the tool go to the camera controls.

import { Vector3 } from 'three';
import type { Grasp, SceneView } from '../types';
import type { Hand } from './hand';

const LINE = 33, SCREEN = 400; // pixels of one wheel step in line and page units
const DEPTH_PER_TURN = 0.1;    // pixel widths in depth per wheel pixel
const TURN_PER_PIXEL = 0.008;  // rad

interface Finger { x: number; y: number }

export class Pointer {
  private readonly fingers = new Map<number, Finger>();
  private grasp: Grasp | null = null;

  /** `stage` contains the canvas, so that it receives every event first. */
  constructor(
    private readonly stage: HTMLElement,
    private readonly scene: SceneView,
    private readonly hand: Hand,
    private readonly canBeHeld: () => boolean,
    private readonly requestDraw: () => void,
  ) {
    stage.addEventListener('pointerdown', (event) => this.press(event), { capture: true });
    stage.addEventListener('pointermove', (event) => this.move(event), { capture: true });
    for (const end of ['pointerup', 'pointercancel'] as const) {
      stage.addEventListener(end, (event) => this.release(event), { capture: true });
    }
    stage.addEventListener('wheel', (event) => this.roll(event), { capture: true, passive: false });
    stage.addEventListener('contextmenu', (event) => this.grasp && event.preventDefault(), { capture: true });
  }

  private place(event: MouseEvent): [number, number] {
    const { left, top } = this.stage.getBoundingClientRect();
    return [event.clientX - left, event.clientY - top];
  }

  private press(event: PointerEvent): void {
    if (!this.canBeHeld() || event.button === 1) return;
    const [x, y] = this.place(event);
    if (this.fingers.size === 0) {
      this.grasp = this.scene.graspAt(x, y, event.pointerType === 'mouse' ? 6 : 18);
      if (!this.grasp) return;
      // The right button turns the tool, as Shift does.
      if (this.grasp.kind === 'tool' && (event.shiftKey || event.button === 2)) this.grasp = { kind: 'turn' };
      if (!this.hand.isMine) void this.hand.hold();
    } else if (event.pointerType === 'mouse' || this.fingers.size >= 2) {
      return;
    }
    this.take(event);
    this.fingers.set(event.pointerId, { x, y });
    this.stage.setPointerCapture(event.pointerId);
    this.stage.style.cursor = 'grabbing';
    (document.activeElement as HTMLElement | null)?.blur(); // keys go to the hand
  }

  private move(event: PointerEvent): void {
    const finger = this.fingers.get(event.pointerId);
    const [x, y] = this.place(event);
    if (!finger) return this.hover(event, x, y);
    this.take(event);
    const before = [...this.fingers.values()].map(({ x, y }) => ({ x, y }));
    Object.assign(finger, { x, y });
    const now = [...this.fingers.values()];
    if (now.length === 2) this.pinch(before, now);
    else this.drag(x - before[0].x, y - before[0].y);
    this.requestDraw();
  }

  private release(event: PointerEvent): void {
    if (!this.fingers.delete(event.pointerId)) return;
    this.take(event);
    if (this.fingers.size > 0) return;
    this.grasp = null;
    this.scene.setGrasp(null);
    this.stage.style.cursor = '';
  }

  private hover(event: PointerEvent, x: number, y: number): void {
    if (event.pointerType !== 'mouse' || event.buttons !== 0 || this.fingers.size > 0) return;
    const over = this.canBeHeld() ? this.scene.graspAt(x, y, 6) : null;
    this.scene.setGrasp(over);
    const cursor = over ? 'grab' : '';
    if (this.stage.style.cursor !== cursor) this.stage.style.cursor = cursor;
  }

  private drag(dx: number, dy: number): void {
    const { right, up, perPixel } = this.scene.pictureAxes();
    const { grasp } = this;
    if (grasp?.kind === 'ring') {
      const [gx, gy] = grasp.perRadian;
      this.hand.turn(grasp.axis, (dx * gx + dy * gy) / Math.max(gx * gx + gy * gy, 400));
    } else if (grasp?.kind === 'turn') {
      this.hand.turn(up, TURN_PER_PIXEL * dx);
      this.hand.turn(right, TURN_PER_PIXEL * dy);
    } else {
      this.hand.move(right.multiplyScalar(dx * perPixel).addScaledVector(up, -dy * perPixel));
    }
  }

  /** Two fingers: their middle moves the tool, pinching pushes it away, twisting turns it. */
  private pinch(before: Finger[], now: Finger[]): void {
    const { right, up, away, perPixel, distance } = this.scene.pictureAxes();
    const middle = ([a, b]: Finger[]) => ({ x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 });
    const apart = ([a, b]: Finger[]) => Math.max(20, Math.hypot(b.x - a.x, b.y - a.y));
    const angle = ([a, b]: Finger[]) => Math.atan2(b.y - a.y, b.x - a.x);
    const [from, to] = [middle(before), middle(now)];
    this.hand.move(new Vector3()
      .addScaledVector(right, (to.x - from.x) * perPixel)
      .addScaledVector(up, (from.y - to.y) * perPixel)
      .addScaledVector(away, distance * (apart(before) / apart(now) - 1)));
    const turn = angle(now) - angle(before);
    this.hand.turn(away, Math.atan2(Math.sin(turn), Math.cos(turn)));
  }

  /** The wheel moves the tool along the line of sight; with Ctrl (a touchpad pinch) it zooms the camera. */
  private roll(event: WheelEvent): void {
    if (!this.hand.isMine || event.ctrlKey) return;
    this.take(event);
    const pixels = event.deltaY * (event.deltaMode === 1 ? LINE : event.deltaMode === 2 ? SCREEN : 1);
    const { away, perPixel } = this.scene.pictureAxes();
    this.hand.move(away.multiplyScalar(-pixels * DEPTH_PER_TURN * perPixel));
    this.requestDraw();
  }

  private take(event: Event): void {
    event.stopPropagation();
    if (event.cancelable) event.preventDefault();
  }
}
