// Rate control of the tool by held keys, the card's buttons and a gamepad's sticks.

import { Vector3 } from 'three';
import type { SceneView } from '../types';
import type { Hand } from './hand';

const SPEED = 0.06, TURN_SPEED = 0.8; // m/s and rad/s at full rate

/** Rates from -1 to 1: along and about the picture's right, up and the line of sight. */
export type Rates = [right: number, up: number, away: number, aboutRight: number, aboutUp: number, aboutAway: number];

export function moveAt(rates: Rates, seconds: number, scene: SceneView, hand: Hand): void {
  if (rates.every((rate) => rate === 0)) return;
  const { right, up, away } = scene.pictureAxes();
  const axes = [right, up, away];
  const way = new Vector3();
  axes.forEach((axis, i) => way.addScaledVector(axis, rates[i] * SPEED * seconds));
  hand.move(way);
  axes.forEach((axis, i) => hand.turn(axis, rates[3 + i] * TURN_SPEED * seconds));
}

const KEYS: Record<string, [axis: number, sign: number]> = {
  ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowDown: [1, -1], ArrowUp: [1, 1], PageDown: [2, -1], PageUp: [2, 1],
};
/** With Shift: axis and sign of the turn that moves the tool's near side in the arrow's direction. */
const TURNS: Record<string, [axis: number, sign: number]> = {
  ArrowLeft: [4, -1], ArrowRight: [4, 1], ArrowDown: [3, 1], ArrowUp: [3, -1], PageDown: [5, -1], PageUp: [5, 1],
};

/** Arrow and Page keys that are down. */
export class HeldKeys {
  private readonly down = new Map<string, [number, number]>();

  constructor(isRequested: () => boolean) {
    addEventListener('keydown', (event) => {
      const found = (event.shiftKey ? TURNS : KEYS)[event.key];
      if (!found || event.ctrlKey || event.metaKey || event.altKey) return;
      if ((event.target as HTMLElement).closest('input, select, textarea, dialog')) return;
      if (isRequested()) event.preventDefault();
      this.down.set(event.key, found); // one that is down before the tool is held moves it, too
    });
    addEventListener('keyup', (event) => {
      if (event.key === 'Meta') this.down.clear(); // macOS reports no other key that is let go before it
      else this.down.delete(event.key);
    });
    addEventListener('blur', () => this.down.clear());
    document.addEventListener('visibilitychange', () => document.hidden && this.down.clear());
  }

  rates(): Rates {
    const rates: Rates = [0, 0, 0, 0, 0, 0];
    for (const [axis, sign] of this.down.values()) rates[axis] += sign;
    return rates;
  }
}

const DEAD = 0.12;      // dead zone of a stick
const HOLD = 0, LET_GO = 1; // buttons of the standard layout: A or cross, B or circle

const beyondDead = (value: number) =>
  Math.abs(value) < DEAD ? 0 : (Math.sign(value) * (Math.abs(value) - DEAD)) / (1 - DEAD);

/**
 * The first gamepad: left stick moves in the picture, right stick moves along and turns about the line of
 * sight, the D-pad tilts.
 */
export class Pad {
  private pressed: boolean[] = [];

  constructor(private readonly onHold: () => void, private readonly onLetGo: () => void) {}

  static first(): Gamepad | null {
    return navigator.getGamepads?.().find((pad) => pad?.connected) ?? null;
  }

  get isThere(): boolean {
    return Pad.first() !== null;
  }

  /** Polls the buttons; each acts when it is pressed. */
  look(): void {
    const pad = Pad.first();
    if (!pad) return;
    const pressed = pad.buttons.map((button) => button.pressed);
    if (pressed[HOLD] && !this.pressed[HOLD]) this.onHold();
    if (pressed[LET_GO] && !this.pressed[LET_GO]) this.onLetGo();
    this.pressed = pressed;
  }

  rates(): Rates {
    const pad = Pad.first();
    if (!pad) return [0, 0, 0, 0, 0, 0];
    const stick = (i: number) => beyondDead(pad.axes[i] ?? 0);
    const button = (i: number) => (pad.buttons[i]?.pressed ? 1 : 0);
    const [up, down, left, right] = [12, 13, 14, 15].map(button);
    return [stick(0), -stick(1), -stick(3), down - up, right - left, stick(2)];
  }
}
