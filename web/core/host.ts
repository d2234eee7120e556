// The WebAssembly module of Palpate with its memory, and what every object of it shares. palpate.ts has the objects.

export type Progress = (spheres: number, fill: number) => boolean;
export type Exports = Record<string, (...parameters: (number | bigint)[]) => number> & { memory: WebAssembly.Memory };

const OUT_OF_MEMORY = 'Palpate needs more than the 512 MB of memory that it may use in a page; give a smaller mesh, fewer spheres or a smaller image.';

/** The module with its memory, and what it asks of its surroundings. */
export class Host {
  exports!: Exports;
  progress: Progress = () => true;
  private message = '';
  private views = { bytes: new DataView(new ArrayBuffer(0)), doubles: new Float64Array(0) }; // of the memory that is there now
  private error = 0;

  imports(module: WebAssembly.Module): WebAssembly.Imports {
    const own: Record<string, Record<string, (...numbers: number[]) => number>> = {
      palpate: {
        out_of_memory: () => { throw new Error(OUT_OF_MEMORY); },
        progress: (spheres, fill) => Number(this.progress(spheres, fill)),
      },
      wasi_snapshot_preview1: {
        clock_time_get: (_clock, _precision, to) => {
          this.view.setBigUint64(to, BigInt(Math.round(performance.now() * 1e6)), true);
          return 0;
        },
        environ_sizes_get: (num, size) => {
          this.view.setUint32(num, 0, true);
          this.view.setUint32(size, 0, true);
          return 0;
        },
        environ_get: () => 0,
        fd_write: (_file, parts, num, written) => this.write(parts, num, written),
        proc_exit: (code) => { throw new Error(`Palpate has stopped (${code}). ${this.message}`.trim()); },
      },
    };
    const imports: WebAssembly.Imports = {};
    const ENOSYS = 52;
    for (const { module: from, name } of WebAssembly.Module.imports(module))
      (imports[from] ??= {})[name] = own[from]?.[name] ?? (() => ENOSYS);
    return imports;
  }

  private get all(): { bytes: DataView; doubles: Float64Array } {
    const { buffer } = this.exports.memory;
    if (this.views.bytes.buffer !== buffer) this.views = { bytes: new DataView(buffer), doubles: new Float64Array(buffer) };
    return this.views;
  }
  get view(): DataView { return this.all.bytes; }

  allocate(bytes: number): number {
    const at = this.exports.malloc(Math.max(1, bytes));
    if (at === 0) throw new Error(OUT_OF_MEMORY);
    return at;
  }
  /** Calls `work` with the address of memory that is free again afterwards. */
  with<T>(bytes: number, work: (at: number) => T): T {
    const at = this.allocate(bytes);
    try {
      return work(at);
    } finally {
      this.exports.free(at);
    }
  }
  text<T>(words: string, work: (at: number) => T): T {
    const bytes = new TextEncoder().encode(`${words}\0`);
    return this.with(bytes.length, (at) => {
      new Uint8Array(this.exports.memory.buffer).set(bytes, at);
      return work(at);
    });
  }
  readText(at: number): string {
    const bytes = new Uint8Array(this.exports.memory.buffer);
    return new TextDecoder().decode(bytes.slice(at, bytes.indexOf(0, at)));
  }
  doubles(at: number, num: number): Float64Array { return new Float64Array(this.exports.memory.buffer, at, num); }
  numbers(at: number, num: number): number[] {
    const { doubles } = this.all, numbers = new Array<number>(num);
    for (let i = 0; i < num; ++i) numbers[i] = doubles[at / 8 + i];
    return numbers;
  }
  put(at: number, numbers: ArrayLike<number>): void {
    const { doubles } = this.all;
    for (let i = 0; i < numbers.length; ++i) doubles[at / 8 + i] = numbers[i];
  }
  /** Calls `work` with an error to fill; throws its sentence if `isBad` says that it failed. */
  checked(work: (error: number) => number, isBad: (result: number) => boolean): number {
    this.error ||= this.allocate(512);
    const result = work(this.error);
    if (isBad(result)) throw new Error(sentence(this.readText(this.error + 4)));
    return result;
  }
  make(work: (error: number) => number): number { return this.checked(work, (handle) => handle === 0); }
  do(work: (error: number) => number): number { return this.checked(work, (result) => result < 0); }

  private write(parts: number, num: number, written: number): number {
    const { view } = this;
    let size = 0;
    for (let i = 0; i < num; ++i) {
      const at = view.getUint32(parts + 8 * i, true), length = view.getUint32(parts + 8 * i + 4, true);
      this.message = (this.message + new TextDecoder().decode(new Uint8Array(view.buffer.slice(at, at + length)))).slice(-1000);
      size += length;
    }
    view.setUint32(written, size, true);
    return 0;
  }
}

function sentence(text: string): string {
  const isName = /^\S*\./.test(text); // a setting keeps its letters
  return `${isName ? text.charAt(0) : text.charAt(0).toUpperCase()}${text.slice(1)}${/[.!?]$/.test(text) ? '' : '.'}`;
}

/** An object of the core, with the memory that it exchanges data through. Free is free, however often. */
export class Owned {
  private readonly blocks: number[] = [];

  constructor(protected readonly host: Host, private address: number, private readonly kind: string) {}

  get handle(): number {
    if (this.address === 0) throw new Error(`This ${this.kind} has been freed; make a new one.`);
    return this.address;
  }
  free(): void {
    if (this.address === 0) return;
    this.host.exports[`palpate_${this.kind}_free`](this.address);
    this.address = 0;
    for (const block of this.blocks) this.host.exports.free(block);
  }
  protected allocate(bytes: number): number {
    const block = this.host.allocate(bytes);
    this.blocks.push(block);
    return block;
  }
}
