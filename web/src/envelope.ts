// History of some columns over the last seconds, for plots: minimum and maximum of each short interval, so
// that no peak is lost at any sample rate. Memory use is constant.

export class Envelope {
  private readonly times: Float64Array;
  private readonly columns: Float64Array[];
  private readonly kept: number;
  private end = 0;
  private interval = -1; // of the last two entries

  constructor(numColumns: number, readonly seconds = 10, private readonly perSecond = 50) {
    this.kept = 2 * seconds * perSecond;
    this.times = new Float64Array(2 * this.kept);
    this.columns = Array.from({ length: numColumns }, () => new Float64Array(2 * this.kept));
  }

  clear(): void {
    this.end = 0;
    this.interval = -1;
  }

  get firstTime(): number {
    return this.end > 0 ? this.times[Math.max(0, this.end - this.kept)] : 0;
  }

  get lastTime(): number {
    return this.end > 0 ? this.times[this.end - 1] : 0;
  }

  add(time: number, values: ArrayLike<number>): void {
    const interval = Math.floor(time * this.perSecond);
    const isJump = interval < this.interval || interval > this.interval + this.kept;
    if (isJump) this.clear();
    if (interval !== this.interval) {
      this.interval = interval;
      this.begin();
      for (let i = 0; i < this.columns.length; ++i) {
        this.columns[i][this.end - 2] = this.columns[i][this.end - 1] = values[i];
      }
      return;
    }
    for (let i = 0; i < this.columns.length; ++i) {
      const column = this.columns[i];
      if (values[i] < column[this.end - 2]) column[this.end - 2] = values[i];
      if (values[i] > column[this.end - 1]) column[this.end - 1] = values[i];
    }
  }

  /** Returns times and columns, oldest first; valid until the next add(). */
  data(): Float64Array[] {
    const begin = Math.max(0, this.end - this.kept);
    return [this.times, ...this.columns].map((column) => column.subarray(begin, this.end));
  }

  /** Appends two entries and drops those older than `seconds`. */
  private begin(): void {
    if (this.end + 2 > this.times.length) {
      for (const column of [this.times, ...this.columns]) column.copyWithin(0, this.end - this.kept, this.end);
      this.end = this.kept;
    }
    this.times[this.end] = this.interval / this.perSecond;
    this.times[this.end + 1] = (this.interval + 0.5) / this.perSecond;
    this.end += 2;
  }
}
