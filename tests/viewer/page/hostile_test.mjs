// What other web pages, wrong tokens and broken messages must not achieve.
import assert from 'node:assert/strict';
import { createServer, request } from 'node:http';

import { banner, browser, drawn, openPage, pageTest, Served, sleep, stat, until } from './harness.mjs';
import { lively, oneSphere } from './worlds.mjs';

/// Status of a request with any headers.
const ask = (url, { method = 'GET', headers = {}, body } = {}) => new Promise((resolve, reject) => {
  const asked = request(url, { method, headers }, (answer) => {
    answer.resume();
    answer.on('end', () => resolve(answer.statusCode));
  });
  asked.on('error', reject);
  asked.end(body);
});

/// Does a WebSocket of this address open, as seen from `page`? And is anything received?
const opens = (page, address) => page.evaluate((to) => new Promise((resolve) => {
  const socket = new WebSocket(to);
  socket.onopen = () => { socket.close(); resolve(true); };
  socket.onerror = () => resolve(false);
}), address);

const command = JSON.stringify({ command: 'set', key: 'coupling.stiffness', value: 1 });

pageTest('a page of another origin can neither read nor command', async () => {
  const served = await Served.start(oneSphere);
  const elsewhere = createServer((_, answer) => {
    answer.setHeader('Content-Type', 'text/html');
    answer.end('<!doctype html><title>elsewhere</title>');
  });
  await new Promise((resolve) => elsewhere.listen(0, '127.0.0.1', resolve));
  try {
    const page = await browser.newPage();
    await page.goto(`http://127.0.0.1:${elsewhere.address().port}/`);
    const read = await page.evaluate(async (url) => {
      try { return await (await fetch(url)).text(); } catch { return null; }
    }, served.address('/api/state'));
    assert.equal(read, null);
    // A request that needs nobody's leave still does nothing.
    await page.evaluate(async ([url, body]) => {
      try { await fetch(url, { method: 'POST', mode: 'no-cors', body }); } catch { /* refused */ }
    }, [served.address('/api/command'), command]);
    assert.equal(await opens(page, served.address('/ws', 'ws:')), false);
    await page.close();
    await sleep(100);
    await served.apply();
    assert.deepEqual(served.lines.filter((line) => line.startsWith('command')), []);

    const origin = `http://127.0.0.1:${elsewhere.address().port}`;
    const url = served.address('/api/command');
    assert.equal(await ask(url, { method: 'POST', body: command, headers: { Origin: origin } }), 403);
    assert.equal(await ask(url, { method: 'POST', body: command, headers: { Origin: 'null' } }), 403);
    assert.equal(await ask(served.address('/'), { headers: { Host: 'example.org' } }), 403);
    assert.equal(await ask(url, { method: 'POST', body: command }), 200); // a script
  } finally {
    elsewhere.close();
  }
});

pageTest('with a token nothing is told without it', async () => {
  const token = 'abcdefgh-0123456789_ABCDEFGH';
  const served = await Served.start({ ...oneSphere, token });
  await served.apply(lively);
  const { origin } = new URL(served.url);
  for (const query of ['', '?token=', '?token=abc', `?token=${token}x`, `?token=${token.toLowerCase()}`]) {
    for (const path of ['/api/state', '/api/hello', '/ws']) {
      const status = await ask(`${origin}${path}${query}`);
      assert.ok(status === 401 || status === 403, `${path}${query} answers ${status}`);
    }
  }
  assert.equal(await ask(`${origin}/api/state`, { headers: { Authorization: `Bearer ${token}` } }), 200);

  const page = await openPage(served.url);
  await drawn(page);
  const stranger = await openPage(`${origin}/?token=wrong-wrong-wrong-wrong`, { expectErrors: true });
  await until('the page says why', async () => /token/.test(await banner(stranger)));
  assert.equal((await stat(stranger)).pictures, 0);
  // From a page of the right origin, too.
  page.problems.splice(0);
  assert.equal(await opens(page, served.address('/ws', 'ws:')), true);
  assert.equal(await opens(page, `${origin.replace('http', 'ws')}/ws?token=wrong-wrong-wrong`), false);
  page.problems.splice(0); // the browser reports the refusal on the console, as it should
});

pageTest('broken messages harm nobody', async () => {
  const served = await Served.start(oneSphere);
  await served.apply(lively);
  const page = await openPage(served.url);
  await drawn(page);
  const bare = await browser.newPage();
  await bare.goto(served.address('/favicon.svg'));
  const answers = await bare.evaluate(async (address) => {
    const messages = [
      '', 'rubbish', '{', '[]', 'null', '1e999', '"text"', '{"ack": "x"}', '{"ack": -1}', '{"ack": 1e30}',
      '{"id": {}, "command": 1}', '{"id": 1}', '{"id": 1, "command": "no such"}',
      '{"id": 2, "command": "get"}', '{"id": 3, "command": "get", "what": "../../etc/passwd"}',
      '{"id": 4, "command": "show", "frames": "yes"}', '{"id": 5, "command": "set"}',
      '{"id": 6, "command": "set", "key": "coupling.stiffness", "value": 1e9}',
      '{"id": 7, "command": "set", "key": "coupling.stiffness", "value": "much"}',
      '{"id": 8, "command": "set", "key": "contact.method", "value": "magic"}',
      '{"id": 9, "command": "seek", "time": null}', '\ud800', '['.repeat(60000),
      `{"id": 10, "command": "${'x'.repeat(60000)}"}`, 'x'.repeat(70000),
      new Uint8Array(1000), new Uint8Array(0), new Uint8Array(100000),
    ];
    const heard = [];
    for (const message of messages) {
      const socket = new WebSocket(address);
      await new Promise((resolve) => { socket.onopen = resolve; socket.onclose = resolve; });
      // What is sent after it is answered after it.
      const last = new Promise((resolve) => {
        socket.onmessage = ({ data }) => {
          if (typeof data !== 'string') return;
          const answer = JSON.parse(data);
          if (answer.type !== 'answer') return;
          if (answer.id === 99) resolve();
          else heard.push(answer);
        };
      });
      const closed = new Promise((resolve) => { socket.onclose = resolve; });
      if (socket.readyState === WebSocket.OPEN) {
        socket.send(message);
        socket.send('{"id": 99, "command": "no such"}');
        await Promise.race([closed, last, new Promise((resolve) => setTimeout(resolve, 60000))]);
      }
      socket.close();
      await Promise.race([closed, new Promise((resolve) => setTimeout(resolve, 500))]);
    }
    return heard;
  }, served.address('/ws', 'ws:'));
  assert.ok(answers.length >= 8, `only ${answers.length} answers`);
  for (const answer of answers) {
    assert.equal(answer.ok, false, JSON.stringify(answer));
    assert.ok(answer.error.length > 5, 'an error says what is wrong');
  }
  for (const [path, options] of [
    ['/../../etc/passwd'], ['/%2e%2e/%2e%2e/etc/passwd'], ['/nothing'], ['/api/command'],
    ['/api/command', { method: 'POST', body: 'x'.repeat(100000) }],
    ['/api/command', { method: 'POST', body: '[[[' }], ['/', { method: 'DELETE' }],
  ]) {
    const { hostname, port } = new URL(served.url);
    const status = await new Promise((resolve) => {
      const asked = request({ hostname, port, path, ...options }, (answer) => {
        answer.resume();
        resolve(answer.statusCode);
      });
      asked.on('error', () => resolve(0)); // hung up on
      asked.end(options?.body);
    });
    assert.ok(status === 0 || (status >= 400 && status < 500), `${path} answers ${status}`);
  }
  // Nothing was changed, and the page that was there goes on.
  const state = await (await fetch(served.address('/api/state'))).json();
  assert.equal(state.settings['coupling.stiffness'], 800);
  assert.equal(state.settings['contact.method'], 'field');
  await drawn(page, 5);
  await until('only the page is left', async () => (await served.apply()).pages === 1);
  await bare.close();
  assert.ok((await stat(page)).pictures > 5);
});
