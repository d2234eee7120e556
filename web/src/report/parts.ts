// Building blocks of all reports.

import { element } from '../dom';

export function title(main: HTMLElement, words: string, below: string): void {
  document.title = `Palpate: ${words}`;
  main.append(element('h1', '', words), element('p', 'below', below));
}

export const heading = (words: string): HTMLElement => element('h2', '', words);
export const paragraph = (words: string): HTMLElement => element('p', '', words);
export const warning = (words: string): HTMLElement => element('p', 'warning', words);
export const footer = (words: string): HTMLElement => element('footer', '', words);

/** Cards of large numbers with their names. */
export function cards(list: [value: string, words: string][]): HTMLElement {
  return element('div', 'cards', ...list.map(([value, words]) =>
    element('div', 'card', element('b', '', value), element('span', '', words))));
}

export type Row = (string | number)[];

/** Table of rows; with more than three columns the cells are numbers, which do not wrap. */
export function table(rows: Row[], head?: Row): HTMLElement {
  const line = (row: Row, tag: 'td' | 'th') => element('tr', '', ...row.map((cell) => element(tag, '', String(cell))));
  const made = element('table', (head?.length ?? 0) > 3 ? 'numbers' : '', element('tbody', '', ...rows.map((row) => line(row, 'td'))));
  if (head) made.prepend(element('thead', '', line(head, 'th')));
  return element('div', 'wide', made);
}

/** Columns side by side where there is room. */
export const columns = (...parts: HTMLElement[]): HTMLElement => element('div', 'columns', ...parts);

/** Folded section for details. */
export function folded(words: string, ...parts: HTMLElement[]): HTMLElement {
  return element('details', '', element('summary', '', words), ...parts);
}

/** Color key. */
export function key(list: [color: string, words: string][]): HTMLElement {
  return element('div', 'key', ...list.map(([color, words]) => {
    const dot = element('i');
    dot.style.background = color;
    return element('span', '', dot, words);
  }));
}

export function captioned(what: HTMLElement, caption: string): HTMLElement {
  return element('figure', '', what, element('figcaption', '', caption));
}
