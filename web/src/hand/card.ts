// Card at the lower edge of the scene: how to hold the tool, who holds it and its force.

import './hand.css';
import { button, element, write } from '../dom';
import { digits } from '../format';
import { heat } from '../scene/colors';

export type Holding = 'free' | 'mine' | 'other';

const isTouch = matchMedia('(pointer: coarse)').matches;
const HOW_TO_HOLD = isTouch ? 'or touch it and drag' : 'or press the mouse on it and drag';
const HOW_TO_MOVE = isTouch
  ? [['drag', 'move'], ['pinch', 'push and pull'], ['rings, two fingers', 'turn']]
  : [['drag', 'move'], ['scroll', 'push and pull'], ['rings, Shift-drag', 'turn'], ['arrows, Page keys', 'all of that']];

export class HoldCard {
  readonly root = element('section', 'card hold');
  /** Force label beside the hand, in the scene. */
  readonly label = element('output', 'newtons');
  /** Direction of the pressed push button: 1 away, -1 nearer, 0 none. */
  pushes = 0;

  private readonly title = element('b');
  private readonly how = element('span', 'how');
  private readonly take: HTMLButtonElement;
  private readonly leave: HTMLButtonElement;
  private readonly push = [this.pusher('Push', 'push the tool away from you (Page up)', 1),
    this.pusher('Pull', 'pull the tool to you (Page down)', -1)];
  private readonly bar = element('i');
  private readonly meter = element('div', 'meter', this.bar);
  private readonly force = element('b', 'number');

  constructor(onHold: () => void, onLetGo: () => void) {
    this.take = button('main', 'hold the tool (T)', onHold, 'Hold the tool');
    this.leave = button('', 'let go of the tool (Esc)', onLetGo, 'Let go', element('kbd', '', 'Esc'));
    this.root.setAttribute('aria-label', 'hold the tool');
    this.meter.setAttribute('aria-hidden', 'true');
    this.label.setAttribute('aria-hidden', 'true');
    const numbers = element('div', 'holding', this.title, this.meter, this.force, ...this.push, this.leave, this.take);
    this.root.append(numbers, this.how);
    this.root.hidden = this.label.hidden = true;
  }

  show(holding: Holding | null): void {
    this.root.hidden = holding === null;
    if (holding === null || this.root.dataset.holding === holding) return;
    this.root.dataset.holding = holding;
    this.pushes = 0;
    const isMine = holding === 'mine';
    for (const part of [this.meter, this.force, this.leave, ...this.push]) part.hidden = !isMine;
    this.take.hidden = holding !== 'free';
    this.title.hidden = holding === 'free';
    write(this.title, isMine ? 'You hold the tool' : 'Another page holds the tool');
    this.how.hidden = holding === 'other';
    if (isMine) {
      this.how.replaceChildren(...HOW_TO_MOVE.map(([what, does]) => element('span', '', element('b', '', what), ` ${does}`)));
    } else {
      this.how.replaceChildren(HOW_TO_HOLD);
    }
  }

  /** Shows the force in N and as a share of the largest force. */
  setForce(newtons: number, share: number): void {
    const text = digits(newtons);
    write(this.force, `${text} N`);
    const color = heat(share);
    this.bar.style.width = `${100 * Math.min(1, share)}%`;
    this.bar.style.background = color;
    write(this.label, `${text} N`);
    this.label.style.borderColor = color;
  }

  private pusher(words: string, label: string, sign: number): HTMLButtonElement {
    const made = button('', label, () => {}, words);
    made.addEventListener('pointerdown', (event) => {
      made.setPointerCapture(event.pointerId);
      this.pushes = sign;
    });
    for (const end of ['pointerup', 'pointercancel', 'lostpointercapture'] as const) {
      made.addEventListener(end, () => (this.pushes = 0));
    }
    return made;
  }
}
