import { button, element, icon, write } from '../dom';
import { clock } from '../format';
import type { Hello, Mark, State } from '../types';
import type { Answer, Command } from '../connection';

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

type Send = (command: Command) => Promise<Answer>;

/** Pause, step and mark buttons; for a recording also its position and speed. */
export class Timeline {
  readonly root = element('footer', 'timeline');
  private readonly play = button('round', 'pause', () => this.toggle());
  private readonly back = button('round', 'one frame back (,)', () => this.step(-1), icon('previous'));
  private readonly forth = button('round', 'one frame further (.)', () => this.step(1), icon('next'));
  private readonly note = button('', 'mark this moment in the recording (m)', () => this.mark(), icon('mark'), 'Mark');
  private readonly slider = element('input');
  private readonly track = element('div', 'track');
  private readonly ticks = element('div', 'ticks');
  private readonly time = element('span', 'number');
  private readonly speed = element('select');
  private isDragging = false;
  private desired: number | null = null; // s, target of the next seek, sent once the current one is answered
  private isSeeking = false;
  private isPaused: boolean | null = null;
  private numMarks = 0; // marks requested so far
  private kind: Hello['kind'] = 'tool';

  constructor(private readonly send: Send) {
    this.slider.type = 'range';
    this.slider.min = '0';
    this.slider.step = 'any';
    this.slider.setAttribute('aria-label', 'time in the recording');
    this.slider.addEventListener('input', () => {
      this.isDragging = true;
      this.seek(Number(this.slider.value));
    });
    this.slider.addEventListener('change', () => (this.isDragging = false));
    this.speed.setAttribute('aria-label', 'speed of playing');
    this.speed.append(...SPEEDS.map((factor) => new Option(`${factor}×`, String(factor))));
    this.speed.addEventListener('change', () => {
      void this.send({ command: 'speed', factor: Number(this.speed.value) });
    });
    this.track.append(this.slider, this.ticks);
    this.root.append(this.back, this.play, this.forth, this.track, this.time, this.speed, this.note);
    this.setPaused(false);
  }

  setHello(hello: Hello): void {
    this.kind = hello.kind;
    this.root.hidden = hello.kind === 'tool';
    this.root.dataset.kind = hello.kind;
    const isRecording = hello.kind === 'recording';
    for (const part of [this.back, this.track, this.speed, this.time]) part.hidden = !isRecording;
    this.note.hidden = isRecording;
    this.numMarks = 0;
    this.ticks.replaceChildren();
  }

  update(state: State): void {
    this.setPaused(state.paused);
    const total = state.duration ?? 0;
    if (this.kind !== 'recording' || total <= 0) return;
    this.slider.max = String(total);
    if (!this.isDragging && !this.isSeeking) this.slider.value = String(state.time);
    this.slider.style.setProperty('--share', `${(100 * Number(this.slider.value)) / total}%`);
    write(this.time, `${clock(Number(this.slider.value))} / ${clock(total)}`);
    if (state.speed && document.activeElement !== this.speed) this.setSpeed(state.speed);
    this.ticks.style.setProperty('--total', String(total));
    if (state.num_marks !== undefined && state.num_marks !== this.numMarks) void this.getMarks(state.num_marks);
  }

  toggle(): void {
    if (this.kind !== 'tool') void this.send({ command: this.isPaused ? 'resume' : 'pause' });
  }

  step(frames: number): void {
    if (this.kind === 'tool' || (frames < 0 && this.kind !== 'recording')) return;
    void this.send({ command: 'step', frames });
  }

  mark(text = ''): void {
    if (this.kind === 'live') void this.send({ command: 'mark', text: text || 'marked in the page' });
  }

  /** Seeks, one request at a time; of targets set meanwhile only the last is used. */
  private seek(time: number): void {
    this.desired = time;
    if (this.isSeeking) return;
    this.isSeeking = true;
    void (async () => {
      while (this.desired !== null) {
        const target: number = this.desired;
        this.desired = null;
        await this.send({ command: 'seek', time: target });
      }
      this.isSeeking = false;
    })();
  }

  private setPaused(isPaused: boolean): void {
    if (isPaused === this.isPaused) return;
    this.isPaused = isPaused;
    const words = isPaused ? 'go on (space)' : 'pause (space)';
    this.play.title = words;
    this.play.setAttribute('aria-label', words);
    this.play.replaceChildren(icon(isPaused ? 'play' : 'pause'));
  }

  private setSpeed(factor: number): void {
    const value = String(factor);
    if (![...this.speed.options].some((option) => option.value === value)) {
      this.speed.append(new Option(`${factor}×`, value));
    }
    this.speed.value = value;
  }

  private async getMarks(num: number): Promise<void> {
    this.numMarks = num;
    const { ok, marks } = await this.send({ command: 'marks' });
    if (!ok) return;
    this.ticks.replaceChildren(
      ...(marks as Mark[]).map(({ time, text }) => {
        const tick = button('tick', `${clock(time)} ${text}`, () => this.seek(time));
        tick.style.left = `min(100%, ${time} * 100% / var(--total))`;
        return tick;
      }),
    );
  }
}
