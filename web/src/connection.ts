// The one WebSocket to the program. It is opened again whenever it is lost.

import type { Hello, State } from './types';

/// refused: the server is there, but does not let this page in.
export type Link = 'connecting' | 'open' | 'lost' | 'refused';

export interface Command {
  command: string;
  [member: string]: unknown;
}

export interface Answer {
  id: number | null; // null: of what is not answered when all is well
  ok: boolean;
  error?: string;
  [member: string]: unknown;
}

export interface Listener {
  onLink(link: Link): void;
  onHello(hello: Hello): void;
  onState(state: State): void;
  onBinary(buffer: ArrayBuffer): void;
  /// All binary messages of this picture have come; it wants to be acknowledged once drawn.
  onPicture(number: number): void;
  /// A message that is not taken.
  onRefusal(error: string): void;
}

const FIRST_WAIT = 250, LONGEST_WAIT = 4000; // ms
const PATIENCE = 3000; // ms, for an answer to a request

export class Connection {
  link: Link = 'connecting';
  /// Times that it was opened again.
  reconnects = 0;

  private socket: WebSocket | null = null;
  private wait = FIRST_WAIT;
  private hasBeenOpen = false;
  private nextId = 1;
  private readonly waiting = new Map<number, (answer: Answer) => void>();

  /// The token stays in memory, and in the address that the person opened.
  constructor(private readonly listener: Listener, private readonly token: string | null) {
    this.open();
  }

  /// Always answered: a connection that is lost meanwhile answers for the server.
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

  /// What is answered only if something is wrong with it: by onRefusal.
  tell(message: object): void {
    if (this.link === 'open') this.socket?.send(JSON.stringify(message));
  }

  private address(path: string): URL {
    const url = new URL(path, document.baseURI);
    if (this.token !== null) url.searchParams.set('token', this.token);
    return url;
  }

  private open(): void {
    const url = this.address('ws');
    url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
    const socket = new WebSocket(url);
    socket.binaryType = 'arraybuffer';
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

  /// A WebSocket does not say why it could not be opened; a request does.
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
