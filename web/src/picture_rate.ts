/** Rate of pictures per second, and age of the last one. */
export class PictureRate {
  private readonly times: number[] = []; // of the last seconds, ms
  private start = performance.now();

  /** Restarts the measurement; earlier time does not count as waiting. */
  begin(): void {
    this.times.length = 0;
    this.start = performance.now();
  }

  count(): void {
    this.times.push(performance.now());
    if (this.times.length > 200) this.times.splice(0, 100);
  }

  get perSecond(): number {
    const window = 2000, now = performance.now();
    const recent = this.times.filter((time) => time > now - window);
    return recent.length < 2 ? recent.length / 2 : (1000 * (recent.length - 1)) / (now - recent[0]);
  }

  /** Time since the last picture, s. */
  get age(): number {
    return (performance.now() - (this.times.at(-1) ?? this.start)) / 1000;
  }
}
