// Theme: dark or light as the system is set, always light on paper.

const system = matchMedia('(prefers-color-scheme: dark)');
const listeners: (() => void)[] = [];
let isOnPaper = false;

export const isDark = () => system.matches && !isOnPaper;
export const onPaper = () => isOnPaper;

/** Calls `draw` now and whenever the theme changes or the page is printed. */
export function onInk(draw: () => void): void {
  listeners.push(draw);
  draw();
}

/** Returns the current value of a color of the style sheet. */
export const ink = (name: string) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function change(): void {
  document.documentElement.dataset.ink = isDark() ? 'dark' : 'light';
  document.documentElement.classList.toggle('paper', isOnPaper);
  for (const draw of listeners) draw();
}

function usePaper(desired: boolean): void {
  if (isOnPaper === desired) return;
  isOnPaper = desired;
  change();
}

system.addEventListener('change', change);
addEventListener('beforeprint', () => usePaper(true));
addEventListener('afterprint', () => usePaper(false));
change();
