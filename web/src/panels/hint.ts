import { button, element, icon } from '../dom';
import { recall, remember } from '../memory';

/** Hint for the first visit, until it is closed or the scene is turned. */
export function hint(canvas: HTMLCanvasElement): HTMLElement {
  const isTouch = matchMedia('(pointer: coarse)').matches;
  const words = isTouch
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
  return root;
}
