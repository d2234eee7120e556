import { element, write } from '../dom';
import { clock } from '../format';
import type { Link } from '../connection';
import type { Hello, State } from '../types';

const KINDS = { live: 'Live', recording: 'Recording', tool: 'Tool' };
const LINKS: Record<Link, string> = {
  connecting: 'connecting',
  open: 'connected',
  lost: 'trying again',
  refused: 'refused',
};

/** Bar with the run's title, state, time, picture rate and connection. */
export class TopBar {
  readonly root = element('header', 'bar');
  private readonly title = element('h1');
  private readonly badge = element('span', 'badge');
  private readonly time = element('span', 'number time');
  private readonly rate = element('span', 'number rate');
  private readonly link = element('span', 'link');

  constructor() {
    const mark = element('span', 'mark', 'Palpate');
    this.root.append(mark, this.title, this.badge, this.time, this.rate, this.link);
    this.rate.title = 'pictures that come from the program';
    this.setLink('connecting');
  }

  setHello(hello: Hello): void {
    write(this.title, hello.title);
    this.title.title = hello.title;
    document.title = `${hello.title} – Palpate`;
    this.time.hidden = this.rate.hidden = hello.kind === 'tool';
  }

  setLink(link: Link): void {
    write(this.link, LINKS[link]);
    this.link.dataset.link = link;
  }

  update(hello: Hello, state: State | null, rate: number): void {
    const isEnded = hello.kind === 'live' && state !== null && !state.running;
    const kind = isEnded ? 'ended' : state?.fault ? 'fault' : state?.paused ? 'paused' : hello.kind;
    write(this.badge, kind === 'live' || kind === 'recording' || kind === 'tool' ? KINDS[kind] : kind);
    this.badge.dataset.kind = kind;
    if (state) write(this.time, clock(state.time));
    write(this.rate, `${Math.round(rate)} pictures/s`);
  }
}
