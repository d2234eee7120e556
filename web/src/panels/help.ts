// Help: the hint of the first visit, the keys, and their dialog.

import { button, element, icon, recall, remember } from '../dom';

export const KEYS: [keys: string, does: string][] = [
  ['Space', 'pause and go on'],
  ['. ,', 'one frame further, or back in a recording'],
  ['V', 'next view: free, camera, from above, tool'],
  ['R', 'look at the whole again'],
  ['1 2 3 4', 'tool as spheres, cut caps, mesh, hidden'],
  ['C', 'cloud'],
  ['N', 'normals'],
  ['U', 'unseen space as fog'],
  ['W', 'sphere color by the camera that determined the depth'],
  ['E', 'depth-change vectors'],
  ['G', 'graph of touching spheres'],
  ['P', 'plots'],
  ['I', 'camera image'],
  ['K', 'controls'],
  ['T', 'hold the tool, with palpate touch --device page'],
  ['Esc', 'let go of it'],
  ['M', 'mark this moment in the recording'],
  ['S', 'save a picture'],
  ['D', 'dark or light'],
  ['?', 'this help'],
];

/** True if the main pointer is a finger: then there are mostly no keys. */
const isTouch = () => matchMedia('(pointer: coarse)').matches;

/** Dialog of keys and pointer gestures. */
export class Help {
  readonly root = element('dialog', 'help');

  constructor() {
    const rows = KEYS.map(([keys, does]) =>
      element('tr', '', element('th', '', ...keys.split(' ').map((key) => element('kbd', '', key))), element('td', '', does)));
    const close = button('round', 'close', () => this.root.close(), icon('close'));
    this.root.append(
      element('h2', '', 'Feeling', close),
      element('p', '', 'Hold the tool, or touch it and drag it to what is seen; Push moves it away from you. Where it meets something, ' +
        'the force in newtons appears.'),
      element('h2', '', 'Looking around'),
      element('p', '', isTouch() ? 'Drag with one finger to turn, pinch to zoom, drag with two fingers to move. The buttons below ' +
        'open the plots, the camera image and the controls, which also choose the view and what is shown.' :
        'Drag to turn, scroll or pinch to zoom, drag with the right button or two fingers to move.'),
      ...(isTouch() ? [] : [element('table', '', element('tbody', '', ...rows))]),
    );
    this.root.setAttribute('aria-label', 'help');
    this.root.addEventListener('click', (event) => {
      if (event.target === this.root) this.root.close();
    });
  }

  toggle(): void {
    if (this.root.open) this.root.close();
    else this.root.showModal();
  }
}

/** Time of the hint on the page, ms. */
const HINT_TIME = 12000;

/** Hint for the first visit, for a while, or until it is closed or the scene is turned. */
export function hint(canvas: HTMLCanvasElement): HTMLElement {
  const words = isTouch()
    ? 'Drag to rotate, pinch to zoom.'
    : 'Drag to rotate, scroll to zoom, press ? for all keys.';
  const close = () => {
    root.hidden = true;
    remember('hint', 'seen');
  };
  const cross = button('round', 'close this hint', close, icon('close'));
  const root = element('aside', 'hint', element('span', '', words), cross);
  root.hidden = recall('hint') === 'seen';
  canvas.addEventListener('pointerup', close, { once: true });
  setTimeout(() => (root.hidden = true), HINT_TIME);
  return root;
}

export type Keys = Record<string, () => void>;

/** Actions by key label, lowercase. */
export function listenToKeys(keys: Keys): void {
  window.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
    const target = event.target as HTMLElement;
    if (target.closest('input:not([type=checkbox]):not([type=range]), select, textarea, dialog')) return;
    const isPress = event.key === ' ' || event.key === 'Enter';
    if (isPress && target.closest('button, input')) return; // a button or input handles it
    const action = keys[event.key.toLowerCase()];
    if (!action) return;
    event.preventDefault();
    action();
  });
}
