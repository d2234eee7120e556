// The worker as the page's connection: what a WebSocket carries elsewhere.
import type { Wire } from '../connection';
import type { Order, Report } from './worker';
import TryWorker from './worker?worker&inline';

export class WorkerWire implements Wire {
  onmessage: ((event: MessageEvent) => void) | null = null;
  onclose: ((event: CloseEvent) => void) | null = null;
  private readonly worker = new TryWorker();

  constructor(core: ArrayBuffer, settings: [string, string][], private readonly onTrouble: (text: string) => void) {
    this.worker.onmessage = (event: MessageEvent<string | ArrayBuffer | Report>) => {
      const { data } = event;
      if (typeof data === 'string' || data instanceof ArrayBuffer) this.onmessage?.(event);
      else if (data.kind === 'trouble') this.onTrouble(data.text);
    };
    this.worker.onerror = (event) => this.onTrouble(event.message);
    this.order({ kind: 'start', core, settings });
  }

  send(text: string): void {
    this.worker.postMessage(text);
  }
  order(order: Order): void {
    this.worker.postMessage(order);
  }
}

/** Packs a mesh in a worker of its own, so that the hand goes on. `cancel` ends it at once. */
export function packInWorker(
  order: Extract<Order, { kind: 'pack' }>, onProgress: (share: number) => void,
): { result: Promise<Uint8Array | null>; cancel(): void } {
  const worker = new TryWorker();
  let cancel = () => {};
  const result = new Promise<Uint8Array | null>((resolve, reject) => {
    cancel = () => resolve(null);
    worker.onmessage = ({ data }: MessageEvent<Report>) => {
      if (data.kind === 'progress') onProgress(data.share);
      else if (data.kind === 'packed') resolve(data.bytes);
      else reject(new Error(data.text));
    };
    worker.onerror = (event) => reject(new Error(event.message));
    worker.postMessage(order);
  }).finally(() => worker.terminate());
  return { result, cancel: () => cancel() };
}
