import { button, element, write } from '../dom';
import type { Link } from '../connection';
import { PROTOCOL } from '../messages';
import type { Hello, State } from '../types';

export interface Notice {
  level: 'error' | 'warning' | 'note';
  words: string;
  /** The force is off and can be switched on; for a tool that a page holds, only while it is held. */
  offersForce?: boolean;
}

/** Inputs of notice(). */
export interface Situation {
  link: Link;
  hello: Hello | null;
  state: State | null;
  /** Time since the last picture, s; 0 if the page has pictures left to draw. */
  pictureAge: number;
  /** Error of the last command or of the page itself. */
  trouble: string | null;
}

const WITHOUT_FORCE = ['fading', 'off', 'held_off', 'waiting'];
const OLD_SENSOR = 0.5, OLD_PICTURE = 1; // s

/** Returns the most urgent notice, or null. */
export function notice({ link, hello, state, pictureAge, trouble }: Situation): Notice | null {
  if (link === 'refused') {
    const words = 'This address is not let in: its token is missing or wrong. ' +
      'Open the whole address that palpate has printed.';
    return { level: 'error', words };
  }
  if (link === 'lost') {
    const words = hello
      ? 'Palpate does not answer: it may have ended. This is the last that was seen; trying again …'
      : 'Palpate does not answer at this address. Trying again …';
    return { level: 'error', words };
  }
  if (!hello) return null;
  if (hello.protocol !== PROTOCOL) {
    const words = `The program speaks protocol ${hello.protocol}, this page ${PROTOCOL}: reload the page.`;
    return { level: 'error', words };
  }
  if (state?.fault) return { level: 'error', words: state.fault };
  if (trouble) return { level: 'warning', words: trouble };
  if (hello.kind === 'live' && state) {
    if (!state.running) return { level: 'note', words: 'The run has ended. This is its last moment.' };
    if (state.note && state.force && WITHOUT_FORCE.includes(state.force)) {
      const level = state.force === 'waiting' ? 'note' : 'warning';
      return { level, words: state.note, offersForce: state.handle !== 'free' };
    }
    if (!state.paused && state.sensor_age !== undefined && state.sensor_age > OLD_SENSOR) {
      const words = `The camera has sent nothing for ${age(state.sensor_age)}: the scene that you see is old.`;
      return { level: 'warning', words };
    }
    if (pictureAge > OLD_PICTURE) {
      return { level: 'warning', words: `Nothing new from Palpate for ${age(pictureAge)}: what you see is old.` };
    }
  }
  return state?.note ? { level: 'note', words: state.note } : null;
}

/** Formats an age: tenths of a second only while short, so that screen readers repeat it once a second at most. */
function age(seconds: number): string {
  if (!(seconds < 3600)) return 'a long time';
  return seconds < 2 ? `${seconds.toFixed(1)} s` : `${Math.floor(seconds)} s`;
}

export class Banner {
  readonly root = element('div', 'banner');
  private readonly words = element('span');
  private readonly force: HTMLButtonElement;

  constructor(askForForce: () => void) {
    this.force = button('', 'bring the force back, also in contact', askForForce, 'Force on');
    this.root.setAttribute('role', 'status');
    this.root.setAttribute('aria-live', 'polite');
    this.root.hidden = true;
    this.root.append(this.words, this.force);
  }

  show(found: Notice | null): void {
    this.root.hidden = found === null;
    if (!found) return;
    this.root.dataset.level = found.level;
    this.force.hidden = !found.offersForce;
    write(this.words, found.words);
  }
}
