// Memory of page and server while much of everything moves.
//
// PALPATE_SOAK_SECONDS says for how long (30; `make view-soak`: 600). The first third fills buffers;
// after it neither may grow by more than a bound that does not depend on the time.
import assert from 'node:assert/strict';

import { drawn, openPage, pageTest, Served, sleep, stat } from './harness.mjs';
import { busy, busyNow } from './worlds.mjs';

const seconds = Number(process.env.PALPATE_SOAK_SECONDS ?? 30);
const heapBound = 4, serverBound = 4; // MiB

/// MiB that the page's program uses after a collection: objects, and arrays of numbers.
async function heap(session) {
  await session.send('HeapProfiler.collectGarbage');
  const usage = await session.send('Runtime.getHeapUsage');
  return (usage.usedSize + (usage.backingStorageSize ?? 0)) / 2 ** 20;
}

pageTest(`memory stands still for ${seconds} s`, async () => {
  const served = await Served.start(busy);
  await served.apply(busyNow);
  const page = await openPage(served.url);
  await drawn(page);
  const session = await page.context().newCDPSession(page);
  const measure = async () => {
    const { rss_kib: rss, cpu } = await served.apply();
    return { time: Date.now() / 1000, heap: await heap(session), rss: rss / 1024, cpu,
      pictures: (await stat(page)).pictures };
  };
  const begin = await measure();
  const rows = [];
  const isDrawn = () => rows.at(-1).pictures > begin.pictures + seconds / 2;
  while (rows.length < 12 || (!isDrawn() && rows.length < 120)) { // a busy machine draws them later
    await sleep(seconds / 12 * 1000 - 50);
    rows.push(await measure());
  }
  const settled = rows.slice(3);
  const last = rows.at(-1);
  const growth = (name) => {
    // Between the means of the first and the last third of what is settled.
    const mean = (part) => part.reduce((sum, row) => sum + row[name], 0) / part.length;
    return mean(settled.slice(-3)) - mean(settled.slice(0, 3));
  };
  const took = last.time - begin.time;
  console.log(`# heap ${rows.map((row) => row.heap.toFixed(1)).join(' ')} MiB`);
  console.log(`# server ${rows.map((row) => row.rss.toFixed(1)).join(' ')} MiB`);
  console.log(`# ${((last.pictures - begin.pictures) / took).toFixed(1)} pictures/s, ` +
    `server ${(100 * (last.cpu - begin.cpu) / took).toFixed(1)} % of a core`);
  assert.ok(isDrawn(), 'pictures were drawn all the time');
  assert.ok(growth('heap') < heapBound, `the page grew by ${growth('heap').toFixed(1)} MiB`);
  assert.ok(growth('rss') < serverBound, `the server grew by ${growth('rss').toFixed(1)} MiB`);
}, seconds + 900);
