// Full-scale value of the arrows. It is 1, 2 or 5 times a power of ten and changes seldom: arrows of
// two moments can be compared.

const MEMORY = 10; // s, decay time of a peak

export class SteadyScale {
  private peak = 0;
  private full: number;
  private shown: number; // follows `full` quickly but smoothly, so that arrows do not jump
  private last = -Infinity;

  constructor(private readonly least: number) {
    this.full = this.shown = least;
  }

  /** Returns the full-scale value after a new value at a time in s. */
  update(time: number, value: number): number {
    const elapsed = Math.min(1, Math.max(0, time - this.last));
    this.last = time;
    this.peak = Math.max(value, this.peak * Math.exp(-elapsed / MEMORY));
    if (this.peak > this.full || this.peak < 0.3 * this.full) {
      this.full = Math.max(this.least, roundUp(this.peak));
    }
    this.shown *= (this.full / this.shown) ** Math.min(1, 5 * elapsed);
    return Math.max(this.shown, value);
  }
}

/** Rounds up to 1, 2 or 5 times a power of ten. */
export function roundUp(value: number): number {
  if (!(value > 0)) return 0;
  const power = 10 ** Math.floor(Math.log10(value));
  const factor = [1, 2, 5].find((f) => f * power >= value);
  return (factor ?? 10) * power;
}
