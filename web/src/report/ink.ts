// Dark or light: as the system is set, and always light on paper.

const system = matchMedia('(prefers-color-scheme: dark)');
const listeners: (() => void)[] = [];
let isOnPaper = false;

export const isDark = () => system.matches && !isOnPaper;
export const onPaper = () => isOnPaper;

/// Calls at once, and whenever the ink or the paper changes.
export function onInk(draw: () => void): void {
  listeners.push(draw);
  draw();
}

/// A colour of the style sheet as it is now.
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
