// What every report is made of.

import { element } from '../dom';

export function title(main: HTMLElement, words: string, below: string): void {
  document.title = `Palpate: ${words}`;
  main.append(element('h1', '', words), element('p', 'below', below));
}

export const heading = (words: string): HTMLElement => element('h2', '', words);
export const paragraph = (words: string): HTMLElement => element('p', '', words);
export const warning = (words: string): HTMLElement => element('p', 'warning', words);
export const footer = (words: string): HTMLElement => element('footer', '', words);

/// Numbers in large type, each with what it is.
export function cards(list: [value: string, words: string][]): HTMLElement {
  return element('div', 'cards', ...list.map(([value, words]) =>
    element('div', 'card', element('b', '', value), element('span', '', words))));
}

export type Row = (string | number)[];

/// With a head of more than three: numbers, which are not broken into lines.
export function table(rows: Row[], head?: Row): HTMLElement {
  const line = (row: Row, tag: 'td' | 'th') => element('tr', '', ...row.map((cell) => element(tag, '', String(cell))));
  const made = element('table', (head?.length ?? 0) > 3 ? 'numbers' : '', element('tbody', '', ...rows.map((row) => line(row, 'td'))));
  if (head) made.prepend(element('thead', '', line(head, 'th')));
  return element('div', 'wide', made);
}

/// Side by side where there is room.
export const columns = (...parts: HTMLElement[]): HTMLElement => element('div', 'columns', ...parts);

/// What most readers can do without.
export function folded(words: string, ...parts: HTMLElement[]): HTMLElement {
  return element('details', '', element('summary', '', words), ...parts);
}

/// Colours and what they stand for.
export function key(list: [colour: string, words: string][]): HTMLElement {
  return element('div', 'key', ...list.map(([colour, words]) => {
    const dot = element('i');
    dot.style.background = colour;
    return element('span', '', dot, words);
  }));
}

export function captioned(what: HTMLElement, caption: string): HTMLElement {
  return element('figure', '', what, element('figcaption', '', caption));
}
