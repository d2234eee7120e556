import './style.css';
import { Page } from './page';
import { governor } from './scene/governor';
import type { Command } from './connection';

const page = new Page(new URLSearchParams(location.search));

/** Access for scripts and tests. */
declare global {
  interface Window {
    palpate: unknown;
  }
}
window.palpate = {
  counters: page.counters,
  scene: page.scene,
  governor,
  get hello() { return page.hello; },
  get state() { return page.state; },
  get sample() { return page.sample; },
  command: (command: Command) => page.command(command),
};
