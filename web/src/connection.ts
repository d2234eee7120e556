// The one WebSocket to the program, or what stands for it in a page without a program. Reopened whenever it is lost.

import type { Hello, State } from './types';

/** State of the connection; refused: the server runs but rejects this page. */
export type Link = 'connecting' | 'open' | 'lost' | 'refused';

export interface Command {
  command: string;
  [member: string]: unknown;
}

export interface Answer {
  id: number | null; // null: an error of a message that is acknowledged only by silence
  ok: boolean;
  error?: string;
  [member: string]: unknown;
}

export interface Listener {
  onLink(link: Link): void;
  onHello(hello: Hello): void;
  onState(state: State): void;
  onBinary(buffer: ArrayBuffer): void;
  /** All binary messages of this picture have arrived; acknowledge it once it is drawn. */
  onPicture(number: number): void;
  /** The program rejected a message. */
  onRefusal(error: string): void;
}

/** The part of a WebSocket that is used: src/try/wire.ts has another one, to a worker. */
export interface Wire {
  onmessage: ((event: MessageEvent) => void) | null;
  onclose: ((event: CloseEvent) => void) | null;
  send(text: string): void;
}
export type OpenWire = (url: URL) => Wire;

function openSocket(url: URL): Wire {
  url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
  const socket = new WebSocket(url);
  socket.binaryType = 'arraybuffer';
  return socket;
}

const FIRST_WAIT = 250, LONGEST_WAIT = 4000; // ms
const PATIENCE = 3000; // ms, for an answer to a request

export class Connection {
  link: Link = 'connecting';
  /** Number of reconnects. */
  reconnects = 0;

  private socket: Wire | null = null;
  private wait = FIRST_WAIT;
  private hasBeenOpen = false;
  private nextId = 1;
  private readonly waiting = new Map<number, (answer: Answer) => void>();

  /** `token` is kept in memory only; it comes from the address that the person opened. */
  constructor(
    private readonly listener: Listener, private readonly token: string | null, private readonly openWire: OpenWire = openSocket,
  ) {
    this.open();
  }

  /** Sends a command. Always resolves: if the connection is lost, with an error. */
  send(command: Command): Promise<Answer> {
    const id = this.nextId++;
    if (this.link !== 'open') {
      return Promise.resolve({ id, ok: false, error: 'There is no connection to Palpate.' });
    }
    return new Promise((resolve) => {
      this.waiting.set(id, resolve);
      this.socket?.send(JSON.stringify({ id, ...command }));
    });
  }

  acknowledge(number: number): void {
    this.tell({ ack: number });
  }

  /** Sends a message that is answered only if it is wrong, through onRefusal. */
  tell(message: object): void {
    if (this.link === 'open') this.socket?.send(JSON.stringify(message));
  }

  private address(path: string): URL {
    const url = new URL(path, document.baseURI);
    if (this.token !== null) url.searchParams.set('token', this.token);
    return url;
  }

  private open(): void {
    const socket = this.openWire(this.address('ws'));
    socket.onmessage = ({ data }) => {
      if (socket !== this.socket) return;
      if (data instanceof ArrayBuffer) this.listener.onBinary(data);
      else this.onText(JSON.parse(data as string));
    };
    socket.onclose = () => {
      if (socket === this.socket) void this.onClose();
    };
    this.socket = socket;
  }

  private onText(message: { type: string }): void {
    switch (message.type) {
      case 'hello':
        this.wait = FIRST_WAIT;
        if (this.hasBeenOpen) ++this.reconnects;
        this.hasBeenOpen = true;
        this.setLink('open');
        this.listener.onHello(message as unknown as Hello);
        break;
      case 'state':
        this.listener.onState(message as unknown as State);
        break;
      case 'picture':
        this.listener.onPicture((message as unknown as { number: number }).number);
        break;
      case 'answer': {
        const answer = message as unknown as Answer;
        if (answer.id === null) this.listener.onRefusal(answer.error ?? '');
        else this.waiting.get(answer.id)?.(answer);
        this.waiting.delete(answer.id ?? 0);
        break;
      }
    }
  }

  private async onClose(): Promise<void> {
    this.socket = null;
    for (const [id, resolve] of this.waiting) {
      resolve({ id, ok: false, error: 'The connection to Palpate was lost.' });
    }
    this.waiting.clear();
    if (this.link === 'open') this.setLink('lost');
    this.setLink((await this.isRefused()) ? 'refused' : 'lost');
    setTimeout(() => this.open(), this.wait);
    this.wait = Math.min(2 * this.wait, LONGEST_WAIT);
  }

  /** Requests a page to find out why the WebSocket failed, which a WebSocket does not report. */
  private async isRefused(): Promise<boolean> {
    try {
      const { status } = await fetch(this.address('api/hello'), {
        cache: 'no-store', signal: AbortSignal.timeout(PATIENCE),
      });
      return status === 401 || status === 403;
    } catch {
      return false;
    }
  }

  private setLink(link: Link): void {
    if (this.link === link) return;
    this.link = link;
    this.listener.onLink(link);
  }
}
