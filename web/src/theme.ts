import { recall, remember } from './dom';

/** Dark or light theme: by the address, the choice stored in the browser, or the system. */
export class Theme {
  private readonly system = matchMedia('(prefers-color-scheme: light)');
  private isDark: boolean;

  constructor(private readonly onChange: (isDark: boolean) => void, requested: string | null) {
    const chosen = requested ?? recall('theme');
    this.isDark = chosen ? chosen !== 'light' : !this.system.matches;
    this.apply();
    this.system.addEventListener('change', () => {
      if (recall('theme') !== null) return;
      this.isDark = !this.system.matches;
      this.apply();
    });
  }

  toggle(): void {
    this.isDark = !this.isDark;
    remember('theme', this.isDark ? 'dark' : 'light');
    this.apply();
  }

  private apply(): void {
    document.documentElement.dataset.theme = this.isDark ? 'dark' : 'light';
    this.onChange(this.isDark);
  }
}
