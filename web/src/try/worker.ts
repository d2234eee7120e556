// The worker behind the page without a program: a World with its clock, or the packing of one mesh.
import { load, whyNot } from '../../core/palpate';
import { World } from './world';
import type { GivenImage } from './given_image';

/** Orders of the page, beside the texts of the protocol. */
export type Order =
  | { kind: 'start'; core: ArrayBuffer; settings: [key: string, value: string][] }
  | { kind: 'tool'; name: string; bytes: Uint8Array }
  | { kind: 'object'; name: string; bytes: Uint8Array }
  | { kind: 'image'; image: GivenImage | null }
  | { kind: 'pack'; core: ArrayBuffer; vertices: Float64Array; triangles: Uint32Array; spheres: number };
/** Answers to them, beside the messages of the protocol. */
export type Report =
  | { kind: 'trouble'; text: string } | { kind: 'progress'; spheres: number; share: number } | { kind: 'packed'; bytes: Uint8Array };

const scope = self as unknown as { postMessage(message: unknown, transfer?: Transferable[]): void; onmessage: unknown };
const PAUSE = 2; // ms between two wakes, which a browser may make longer
let world: World | null = null;

async function start(core: ArrayBuffer, settings: [string, string][]): Promise<void> {
  const palpate = await load(core);
  const run = world = new World(palpate, {
    text: (message) => scope.postMessage(JSON.stringify(message)),
    binary: (buffer) => scope.postMessage(buffer, [buffer]),
  });
  for (const [key, value] of settings) {
    try {
      run.set(key, value);
    } catch (error) {
      report({ kind: 'trouble', text: (error as Error).message });
    }
  }
  scope.postMessage(JSON.stringify(run.hello()));
  scope.postMessage(JSON.stringify(run.state()));
  const begin = performance.now(), soon = new MessageChannel(); // sooner than any timer, and after messages that wait
  const wake = () => {
    try {
      const hasCaughtUp = run.run((performance.now() - begin) / 1000);
      run.send();
      if (hasCaughtUp) setTimeout(wake, PAUSE);
      else soon.port2.postMessage(null);
    } catch (error) {
      report({ kind: 'trouble', text: (error as Error).message });
    }
  };
  soon.port1.onmessage = wake;
  wake();
}

async function pack(order: Extract<Order, { kind: 'pack' }>): Promise<void> {
  const palpate = await load(order.core);
  const tool = palpate.pack(order.vertices, order.triangles, `packing.spheres = ${order.spheres}`, (spheres) => {
    report({ kind: 'progress', spheres, share: spheres / order.spheres });
    return true;
  });
  report({ kind: 'packed', bytes: tool.save() });
}

function report(message: Report): void {
  scope.postMessage(message);
}

scope.onmessage = ({ data }: MessageEvent<string | Order>) => {
  const fail = (error: unknown) => report({ kind: 'trouble', text: whyNot() ?? (error as Error).message });
  try {
    if (typeof data === 'string') world?.take(JSON.parse(data) as Record<string, unknown>);
    else if (data.kind === 'start') start(data.core, data.settings).catch(fail);
    else if (data.kind === 'pack') pack(data).catch(fail);
    else if (data.kind === 'tool') world?.useTool(data.bytes, data.name);
    else if (data.kind === 'object') world?.useObject(data.bytes, data.name);
    else world?.useImage(data.image);
  } catch (error) {
    fail(error);
  }
};
