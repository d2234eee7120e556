import { button, element, icon } from '../dom';
import type { IconName } from '../dom';

export type PanelName = 'plots' | 'image' | 'controls';

const NARROW = matchMedia('(max-width: 719px), (max-height: 479px)');
const BUTTONS: [PanelName, string, string, IconName][] = [
  ['plots', 'Plots', 'plots (p)', 'plots'],
  ['image', 'Camera', 'camera image (i)', 'camera'],
  ['controls', 'Controls', 'controls (k)', 'controls'],
];

/** Opens and closes the panels. A narrow window shows one at a time, in the drawer. */
export class Dock {
  readonly root = element('nav', 'dock');
  private readonly open = new Set<PanelName>();
  private readonly buttons = new Map<PanelName, HTMLButtonElement>();
  private readonly hidden = new Set<PanelName>();

  constructor(private readonly page: HTMLElement, onTheme: () => void, onHelp: () => void) {
    this.root.setAttribute('aria-label', 'panels');
    for (const [name, words, label, picture] of BUTTONS) {
      const made = button('', label, () => this.toggle(name), icon(picture), element('span', '', words));
      this.buttons.set(name, made);
      this.root.append(made);
    }
    this.root.append(
      button('theme', 'dark or light (d)', onTheme, icon('theme')),
      button('', 'keys and help (?)', onHelp, icon('help'), element('span', 'narrow', 'Help')),
    );
    NARROW.addEventListener('change', () => this.begin(['plots', 'controls', 'image']));
  }

  /** Opens these panels in a wide window. */
  begin(names: PanelName[]): void {
    this.open.clear();
    if (!NARROW.matches) for (const name of names) this.open.add(name);
    this.update();
  }

  /** Hides these panels, which have nothing to show. */
  hide(names: PanelName[]): void {
    this.hidden.clear();
    for (const name of names) this.hidden.add(name);
    this.update();
  }

  toggle(name: PanelName): void {
    const isOpen = this.open.has(name);
    if (NARROW.matches) this.open.clear();
    if (isOpen) this.open.delete(name);
    else this.open.add(name);
    this.update();
  }

  isOpen(name: PanelName): boolean {
    return this.open.has(name) && !this.hidden.has(name);
  }

  private update(): void {
    for (const [name, made] of this.buttons) {
      made.hidden = this.hidden.has(name);
      made.setAttribute('aria-pressed', String(this.isOpen(name)));
      this.page.classList.toggle(`with-${name}`, this.isOpen(name));
    }
    this.page.dispatchEvent(new Event('panels'));
  }
}
