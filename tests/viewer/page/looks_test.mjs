// Everything else that the scene can show: that it shows, where it belongs, in its color.
import assert from 'node:assert/strict';

import { color, isJust, isLit, isPale } from './colors.mjs';
import { drawn, look, openPage, options, pageTest, project, Served, until } from './harness.mjs';
import { oneSphere, threeSpheres, uncut } from './worlds.mjs';

const ground = color('ground');
const nothing = {
  cloud: false, toolLook: 'hidden', outside: false, graph: false, treeLevel: -1, normals: false, fog: false,
  edges: false, edgePlanes: false, arrows: false, ghost: false, trace: false, view: 'camera',
};

/// The scene with only these things.
async function only(page, wanted) {
  await options(page, { ...nothing, ...wanted });
  await drawn(page, 3);
  return look(page);
}

/// How many pixels of a picture are as `wanted` says: of all, or around a point (x, y, half a side).
function count(picture, wanted, [x, y, half] = [picture.width / 2, picture.height / 2, 1e4]) {
  let number = 0;
  for (let v = Math.max(0, Math.floor(y - half)); v < Math.min(picture.height, y + half); ++v) {
    for (let u = Math.max(0, Math.floor(x - half)); u < Math.min(picture.width, x + half); ++u) {
      if (wanted(picture.at(u, v))) ++number;
    }
  }
  return number;
}
const isDrawn = (c) => !isJust(c, ground);

pageTest('nothing is shown when nothing is wanted', async () => {
  const served = await Served.start(oneSphere);
  await served.apply({ contact: { position: [0, 0, 0.4], states: [1], planes: [uncut] }, depth: [[0, 0.5]] });
  const page = await openPage(served.url, { bare: true });
  assert.equal(count(await only(page, {}), isDrawn), 0);
});

pageTest('the mesh of the tool', async () => {
  const served = await Served.start(threeSpheres);
  await served.apply({ contact: { position: [0, 0, 0.5], states: [0, 0, 0], planes: [uncut, uncut, uncut] } });
  const page = await openPage(served.url, { bare: true });
  await only(page, { toolLook: 'mesh' });
  // The box is 0.15 m wide; it is fetched when it is first wanted.
  const [middle, corner, beside] = await project(page, [[0, 0, 0.425], [0.07, 0.07, 0.425], [0.08, 0, 0.425]]);
  const picture = await until('the mesh', async () => {
    const now = await look(page);
    return isDrawn(now.at(...middle)) && now;
  });
  const seen = picture.at(...middle);
  assert.ok(isLit(seen, color('metal')) || isPale(seen, color('metal')), `${seen}`);
  assert.ok(isDrawn(picture.at(...corner)));
  assert.ok(isJust(picture.at(...beside), ground));

  // A face of a box is flat: light is the same all over it.
  const places = [[-0.06, -0.06], [0.06, -0.06], [0.06, 0.06], [-0.06, 0.06], [0, 0.065], [0.03, -0.02]];
  for (const place of await project(page, places.map(([x, y]) => [x, y, 0.425]))) {
    assert.ok(isJust(picture.at(...place), seen), `${picture.at(...place)} at ${place}, ${seen} in the middle`);
  }
  await only(page, { toolLook: 'mesh', view: 'tool' });
  const turned = await look(page);
  const shades = new Map();
  for (let v = 0; v < turned.height; ++v) {
    for (let u = 0; u < turned.width; ++u) {
      const shade = turned.at(u, v).map((c) => c >> 2).join();
      shades.set(shade, (shades.get(shade) ?? 0) + 1);
    }
  }
  const largest = [...shades.values()].sort((a, b) => b - a).slice(0, 4);
  const share = largest.reduce((sum, number) => sum + number) / (turned.width * turned.height);
  assert.ok(share > 0.97, `the ground and three faces: ${largest}`);
});

pageTest('arrows point where forces point', async () => {
  const served = await Served.start(oneSphere);
  await served.apply({ contact: { position: [0, 0, 0.4], states: [1], planes: [uncut] } });
  const page = await openPage(served.url, { bare: true });
  for (const sign of [1, -1]) {
    await served.apply({ sample: { force: [0, 0, 2], contact_force: [2 * sign, 0, 0], contact_torque: [0, 0, 0.05],
      hand: [0, -0.08, 0.4] } });
    const picture = await only(page, { arrows: true });
    const places = await project(page, [[0.02 * sign, 0, 0.4], [-0.02 * sign, 0, 0.4], [0, -0.07, 0.4], [0, -0.1, 0.4]]);
    const [along, against, hand, behind] = places.map((place) => [...place, 6]);
    assert.ok(count(picture, (c) => isLit(c, color('force')), along) > 10, 'the force on the tool');
    assert.equal(count(picture, isDrawn, against), 0, 'not against it');
    // The coupling pulls the hand to the tool.
    assert.ok(count(picture, (c) => isLit(c, color('hand')), hand) > 5, 'the force on the hand');
    assert.equal(count(picture, isDrawn, behind), 0, 'not away from the tool');
    assert.ok(count(picture, (c) => isLit(c, color('torque'))) > 30, 'the torque');
  }
  await served.apply({ sample: {} });
  assert.equal(count(await only(page, { arrows: true }), isDrawn), 0, 'no force, no arrow');
});

pageTest('the legend has a hand only where there is one', async () => {
  const served = await Served.start(oneSphere);
  await served.apply({ contact: { position: [0, 0, 0.4], states: [1], planes: [uncut] }, depth: [[0, 0.5]] });
  const page = await openPage(served.url);
  const legend = () => page.locator('.legend').innerText();
  await until('a hand', async () => /red arrow[^]*force on the hand[^]*where the hand is/.test(await legend()));
  await served.apply({ state: { settings: { 'coupling.kind': 'none' } } });
  await until('none', async () => !(await legend()).includes('hand'));
  assert.match(await legend(), /yellow arrow\s*force on the tool/);
});

pageTest('edges, normals, ghost, path, graph and tree', async () => {
  const served = await Served.start(threeSpheres);
  await served.apply({
    contact: { position: [0, 0, 0.45], states: [0, 1, 2], planes: [uncut, uncut, uncut] },
    depth: [[0, 0.5], [80, 0.9]], sample: { hand: [0.05, 0.03, 0.45] },
  });
  const page = await openPage(served.url, { bare: true });
  const u = (79 - 79.5) / 140 * 0.5; // where the near wall ends

  const edges = await only(page, { edges: true });
  const [at, off] = await project(page, [[u + 0.002, 0, 0.5], [-0.1, 0, 0.5]]);
  assert.ok(count(edges, isDrawn, [...at, 20]) > 20, 'depth-change vectors');
  assert.equal(count(edges, isDrawn, [...off, 20]), 0, 'none on the wall');

  // They contain the viewing rays: the camera would see them from the side.
  const planes = await only(page, { edgePlanes: true, view: 'free' });
  const [shadow, lit] = await project(page, [[u * 1.04, 0, 0.52], [u * 0.84, 0, 0.42]]);
  assert.ok(count(planes, isDrawn, [...shadow, 15]) > 20, 'edge planes go along the ray');
  assert.equal(count(planes, isDrawn, [...lit, 15]), 0);

  const normals = await only(page, { normals: true, view: 'bird' });
  const [before, behind] = await project(page, [[-0.1, 0, 0.495], [-0.1, 0, 0.52]]);
  assert.ok(count(normals, isDrawn, [...before, 8]) > 3, 'normals point to the camera');
  assert.equal(count(normals, isDrawn, [...behind, 4]), 0);

  const ghost = await only(page, { ghost: true });
  const [hand] = await project(page, [[0.05, 0.03, 0.45]]);
  assert.ok(count(ghost, isDrawn, [...hand, 60]) > 50, 'the ghost is where the hand is');

  assert.ok(count(await only(page, { graph: true }), isDrawn) > 20, 'the graph');
  const tree = await only(page, { treeLevel: 0 });
  assert.ok(count(tree, isDrawn) > 200, 'the root of the tree');

  await served.apply({ moving: true });
  await options(page, { ...nothing, trace: true });
  await drawn(page, 20);
  assert.ok(count(await look(page), isDrawn) > 50, 'the path');
});

pageTest('dark and light, every coloring and view', async () => {
  const served = await Served.start(oneSphere);
  await served.apply({ contact: { position: [0, 0, 0.4], states: [1], planes: [uncut] }, depth: [[0, 0.5], [80, 0.7]] });
  const page = await openPage(served.url, { bare: true });
  const light = await only(page, { dark: false });
  assert.ok(Math.min(...light.at(5, 5)) > 200, 'light');
  await options(page, { dark: true });
  for (const cloudColor of ['shaded', 'depth', 'normals']) {
    assert.ok(count(await only(page, { cloud: true, cloudColor, pointSize: 4 }), isDrawn) > 10000, cloudColor);
  }
  for (const view of ['free', 'camera', 'bird', 'tool']) {
    assert.ok(count(await only(page, { toolLook: 'spheres', outside: true, view }), isDrawn) > 100, view);
  }
});
