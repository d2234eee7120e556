// Short helpers for DOM elements and for what the browser keeps.

type Child = Node | string;

export function element<Tag extends keyof HTMLElementTagNameMap>(
  tag: Tag, className = '', ...children: Child[]
): HTMLElementTagNameMap[Tag] {
  const made = document.createElement(tag);
  if (className) made.className = className;
  made.append(...children);
  return made;
}

/** `label` says what the button does, to screen readers and as a tooltip. */
export function button(
  className: string, label: string, onClick: () => void, ...children: Child[]
): HTMLButtonElement {
  const made = element('button', className, ...children);
  made.type = 'button';
  made.title = label;
  made.setAttribute('aria-label', label);
  made.addEventListener('click', onClick);
  return made;
}

/** Writes the text only if it differs, to keep the DOM untouched otherwise. */
export function write(where: Node, text: string): void {
  if (where.textContent !== text) where.textContent = text;
}

const PATHS = {
  play: 'M7 4.5v15l12-7.5z',
  pause: 'M7 5h3.5v14H7zM13.5 5H17v14h-3.5z',
  next: 'M6 5l9 7-9 7zM16 5h2.5v14H16z',
  previous: 'M18 5l-9 7 9 7zM5.5 5H8v14H5.5z',
  mark: 'M6 3h2v18H6zM9 4h10l-3 4 3 4H9z',
  plots: 'M3 19h18v2H3zM4 15l5-6 4 4 6-9 1.6 1.1L13.3 16 9.1 11.8 5.5 16.2z',
  camera: 'M4 6h4l2-2h4l2 2h4v13H4zM12 9a4 4 0 100 8 4 4 0 000-8z',
  controls: 'M3 6h8v2H3zM15 6h6v2h-6zM11 4h3v6h-3zM3 16h4v2H3zM11 16h10v2H11zM7 14h3v6H7z',
  help: 'M12 3a5 5 0 015 5c0 2-1.2 3-2.4 4-1 .8-1.6 1.4-1.6 3h-2c0-2.6 1.2-3.6 2.4-4.6.9-.8 1.6-1.3 1.6-2.4a3 3 0 00-6 0H7a5 5 0 015-5zM11 17.5h2V20h-2z',
  theme: 'M12 3a9 9 0 100 18 9 9 0 000-18zm0 2v14a7 7 0 010-14z',
  close: 'M6.4 5L12 10.6 17.6 5 19 6.4 13.4 12 19 17.6 17.6 19 12 13.4 6.4 19 5 17.6 10.6 12 5 6.4z',
};
export type IconName = keyof typeof PATHS;

export function icon(name: IconName): SVGSVGElement {
  const space = 'http://www.w3.org/2000/svg';
  const svg = document.createElementNS(space, 'svg');
  svg.setAttribute('viewBox', '0 0 24 24');
  svg.setAttribute('aria-hidden', 'true');
  const path = document.createElementNS(space, 'path');
  path.setAttribute('d', PATHS[name]);
  path.setAttribute('fill-rule', 'evenodd');
  svg.append(path);
  return svg;
}

/** Prefix of the names of small choices that the browser's local storage keeps. */
const PREFIX = 'palpate.';

export function recall(name: string): string | null {
  try {
    return localStorage.getItem(PREFIX + name);
  } catch {
    return null;
  }
}

export function remember(name: string, value: string): void {
  try {
    localStorage.setItem(PREFIX + name, value);
  } catch {
    // Private windows refuse storage; the choice then lasts as long as the page.
  }
}
