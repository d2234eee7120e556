// Keyboard shortcuts, ignored while text is typed.

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
