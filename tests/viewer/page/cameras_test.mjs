// Cameras that stand anywhere: what they see lies where it is in W, and is looked at from there.
import assert from 'node:assert/strict';

import { cameraColors, color, isJust, isLit } from './colors.mjs';
import { drawn, look, openPage, options, pageTest, project, Served, until } from './harness.mjs';
import { oneSphere, threeSpheres, uncut } from './worlds.mjs';

const ground = color('ground');
const { width, height, focal } = oneSphere.stream;
const cloudAlone = {
  cloud: true, cloudColor: 'shaded', toolLook: 'hidden', outside: false, graph: false, treeLevel: -1, normals: false,
  fog: false, edges: false, edgePlanes: false, arrows: false, ghost: false, trace: false, view: 'bird', pointSize: 4, stride: 1,
};

/// A camera turned by an angle about y, so that it looks to the left where that is positive.
const turned = (x, y, z, angle) => [x, y, z, 0, -Math.sin(angle / 2), 0, Math.cos(angle / 2)];
const rotated = (angle, [x, y, z]) =>
  [x * Math.cos(angle) - z * Math.sin(angle), y, x * Math.sin(angle) + z * Math.cos(angle)];

/// What such a camera sees of all that is behind z = wall in W: meters of each column.
function wallSeen([, , z], angle, wall) {
  return Array.from({ length: width }, (_, u) => {
    const ray = rotated(angle, [(u - (width - 1) / 2) / focal, 0, 1]);
    return [u, (wall - z) / ray[2]];
  });
}

const angle = 0.6, wall = 0.6;
const aside = [0.4, 0, 0.1];
const two = { ...oneSphere, title: 'two cameras', cameras: [[0, 0, 0, 0, 0, 0, 1], turned(...aside, angle)] };
const seenAside = wallSeen(aside, angle, wall);
const nothing = [[0, 0]];

pageTest('spheres tell who decided, or that nobody sees them', async () => {
  const served = await Served.start({ ...threeSpheres, cameras: two.cameras });
  const page = await openPage(served.url, { bare: true });
  const centers = threeSpheres.spheres.map(([x, y]) => [x, y, 0.4]);
  const contact = { position: [0, 0, 0.4], states: [1, 2, 2], planes: [uncut, uncut, uncut] };
  await options(page, { ...cloudAlone, cloud: false, toolLook: 'spheres', outside: true, sphereColor: 'camera', view: 'camera' });
  const seen = async (decided) => {
    await served.apply({ contact: { ...contact, ...decided } });
    await drawn(page, 3);
    const picture = await look(page);
    return (await project(page, centers)).map((place) => picture.at(...place));
  };
  const [first, second] = cameraColors, fog = color('fog'), remembered = color('remembered');
  for (const [decided, want] of [
    [{ deciders: [0, 1, 7] }, [first, second, remembered]],
    [{ deciders: [1, -1, 0], unseen: [0, 0, 1] }, [second, fog, fog]],
    [{ states: [0, 0, 1], deciders: [-1, -1, 1], unseen: [1, 0, 0] }, [fog, color('outside'), second]],
  ]) {
    for (const [i, got] of (await seen(decided)).entries()) assert.ok(isLit(got, want[i]), `${i}: ${got}, not ${want[i]}`);
  }
  // By their states as ever.
  await options(page, { sphereColor: 'state' });
  for (const [i, got] of (await seen({ deciders: [0, 1, 7], unseen: [1, 1, 1] })).entries()) {
    assert.ok(isLit(got, color(['boundary', 'inside', 'inside'][i])), `${i}: ${got}`);
  }
});

pageTest('two clouds of one wall coincide', async () => {
  const served = await Served.start(two);
  const both = [[[0, wall]], seenAside];
  await served.apply({ depths: both });
  const page = await openPage(served.url, { bare: true });
  await options(page, cloudAlone);
  await drawn(page, 3);
  const xs = [-0.1, -0.05, 0, 0.05, 0.1]; // both see it there
  const at = async (z) => project(page, xs.map((x) => [x, 0, z]));
  const [on, before, behind] = [await at(wall), await at(wall - 0.03), await at(wall + 0.03)];
  const colors = [];
  for (const depths of [both, [[[0, wall]], nothing], [nothing, seenAside]]) {
    await served.apply({ depths });
    let picture;
    for (let i = 0; i < 20; ++i) { // until the depth has come
      await drawn(page, 3);
      picture = await look(page);
      if (on.every((place) => !isJust(picture.at(...place), ground))) break;
    }
    for (const place of on) assert.ok(!isJust(picture.at(...place), ground), `the wall at ${place}`);
    for (const place of [...before, ...behind]) {
      assert.ok(isJust(picture.at(...place), ground), `nothing at ${place}: ${picture.at(...place)}`);
    }
    colors.push(on.map((place) => picture.at(...place)));
  }
  // Lit alike, whoever saw it.
  for (let i = 0; i < xs.length; ++i) {
    assert.ok(colors[1][i].every((c, k) => Math.abs(c - colors[2][i][k]) <= 12), `${colors[1][i]} and ${colors[2][i]}`);
  }
});

pageTest('fog is where no camera sees', async () => {
  const served = await Served.start(two);
  // Something near hides the left half of a wall, and on the right there is something far away.
  const shadow = [[0, 0.4], [80, 0.55], [120, 0.9]];
  await served.apply({ depths: [shadow, nothing] });
  const page = await openPage(served.url, { bare: true });
  await drawn(page, 3);
  await options(page, { ...cloudAlone, cloud: false, fog: true });
  const fogAt = async (depths) => {
    await served.apply({ depths });
    await drawn(page, 3);
    const picture = await look(page);
    const places = await project(page, [[-0.08, 0, 0.5], [-0.06, 0, 0.3], [0.05, 0, 0.7], [0.05, 0, 0.5]]);
    return places.map(([x, y]) => {
      let count = 0;
      for (let v = Math.round(y) - 6; v <= y + 6; ++v) {
        for (let u = Math.round(x) - 6; u <= x + 6; ++u) count += !isJust(picture.at(u, v), ground);
      }
      return count;
    });
  };
  const [hidden, before, behind, free] = await fogAt([shadow, nothing]);
  assert.ok(hidden > 5, `behind what is near: ${hidden}`);
  assert.ok(behind > 5, `behind the wall: ${behind}`);
  assert.equal(before, 0, 'none before what is near');
  assert.equal(free, 0, 'none before the wall');
  // The other camera sees all that is before a wall at 0.6.
  const [seen, , still] = await fogAt([shadow, seenAside]);
  assert.equal(seen, 0, 'none where the other camera sees');
  assert.ok(still > 5, `behind the wall nobody sees: ${still}`);
  await options(page, { fog: false });
  assert.deepEqual(await fogAt([shadow, nothing]), [0, 0, 0, 0]);
});

pageTest('each camera is drawn where it is, with its name', async () => {
  const served = await Served.start(two);
  await served.apply({ depths: [[[0, wall]], seenAside] });
  const page = await openPage(served.url, { bare: true });
  await drawn(page, 3);
  await options(page, { ...cloudAlone, cloud: false });
  await drawn(page, 3);
  const picture = await look(page);
  const places = [0, -0.05].map((x) => rotated(angle, [x, 0, 0]).map((p, i) => p + aside[i]));
  const [tip, beside] = (await project(page, places)).map(([x, y]) => {
    let count = 0;
    for (let v = y - 8; v <= y + 8; ++v) {
      for (let u = x - 8; u <= x + 8; ++u) count += !isJust(picture.at(u, v), ground);
    }
    return count;
  });
  assert.ok(tip > 5, `the tip of the pyramid: ${tip} pixels`);
  assert.equal(beside, 0, 'and nothing beside it');
  const names = await page.evaluate(() => [...document.querySelectorAll('.image option')].map((o) => o.textContent));
  assert.deepEqual(names, ['1: scripted', '2: scripted']);
});

pageTest('one looks from the first camera where it is, and drags in its picture', async () => {
  const pose = turned(...aside, angle);
  const served = await Served.start({ ...oneSphere, cameras: [pose] });
  await served.apply({
    depths: [seenAside], contact: { position: [0.1, 0, 0.5], states: [1], planes: [uncut] }, sample: { hand: [0.1, 0, 0.5] },
  });
  const page = await openPage(served.url, { bare: true });
  await options(page, { ...cloudAlone, view: 'camera' });
  await drawn(page, 3);
  const inW = (p) => rotated(angle, p).map((x, i) => x + aside[i]);
  const [a, b, right, down] = await project(page, [[0, 0, 0.3], [0, 0, 0.9], [0.1, 0, 0.5], [0, 0.1, 0.5]].map(inW));
  assert.ok(Math.hypot(a[0] - b[0], a[1] - b[1]) < 0.01, 'its axis is one pixel');
  assert.ok(right[0] > a[0] + 10 && Math.abs(right[1] - a[1]) < 0.01, 'x goes right');
  assert.ok(down[1] > a[1] + 10 && Math.abs(down[0] - a[0]) < 0.01, 'y goes down');
  const axes = await page.evaluate(() => {
    const { right, up, perPixel } = window.palpate.scene.pictureAxes();
    return { right: right.toArray(), up: up.toArray(), perPixel };
  });
  const near = (p, q) => p.every((x, i) => Math.abs(x - q[i]) < 1e-6);
  assert.ok(near(axes.right, rotated(angle, [1, 0, 0])), `${axes.right}`);
  assert.ok(near(axes.up, [0, -1, 0]), `${axes.up}`);
  // The camera goes on: so does the view.
  await served.apply({ cameras: [turned(...aside, -angle)], depths: [nothing] });
  await until('the view goes along', async () => {
    const [p, q] = await project(page, [0.3, 0.9].map((z) => rotated(-angle, [0, 0, z]).map((x, i) => x + aside[i])));
    return Math.hypot(p[0] - q[0], p[1] - q[1]) < 0.01;
  });
});
