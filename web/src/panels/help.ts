import { button, element, icon } from '../dom';

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

/** Dialog of keys and pointer gestures. */
export class Help {
  readonly root = element('dialog', 'help');

  constructor() {
    const rows = KEYS.map(([keys, does]) =>
      element('tr', '', element('th', '', ...keys.split(' ').map((key) => element('kbd', '', key))), element('td', '', does)));
    const close = button('round', 'close', () => this.root.close(), icon('close'));
    this.root.append(
      element('h2', '', 'Looking around', close),
      element('p', '', 'Drag to turn, scroll or pinch to zoom, drag with the right button or two fingers to move.'),
      element('table', '', element('tbody', '', ...rows)),
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
