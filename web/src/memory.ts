// Small choices kept in the browser's local storage.

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
