// Pixels of worlds of which the truth is known: a ray through every pixel is cut with the same solid
// in closed form.
import assert from 'node:assert/strict';

import { color, isJust, isLit, isPale } from './colors.mjs';
import { drawn, look, openPage, options, pageTest, project, Served } from './harness.mjs';
import { oneSphere, radius, threeSpheres, uncut } from './worlds.mjs';

const ground = color('ground');
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const minus = (a, b) => a.map((x, i) => x - b[i]);
const times = (a, s) => a.map((x) => x * s);

/// Only the tool, seen from the depth camera.
const bare = {
  cloud: false, toolLook: 'caps', outside: false, graph: false, treeLevel: -1, normals: false,
  edges: false, edgePlanes: false, arrows: false, ghost: false, trace: false, view: 'camera',
};

/// From pixels to rays of the camera view, x and y at z = 1.
async function rays(page) {
  const [o, x, y] = await project(page, [[0, 0, 1], [0.1, 0, 1], [0, 0.1, 1]]);
  assert.ok(Math.abs(x[1] - o[1]) < 1e-3 && Math.abs(y[0] - o[0]) < 1e-3, 'the image is upright');
  assert.ok(x[0] > o[0] + 10 && y[1] > o[1] + 10, 'x goes right, y goes down');
  assert.ok(Math.abs((x[0] - o[0]) / (y[1] - o[1]) - 1) < 1e-3, 'pixels are square');
  const f = (x[0] - o[0]) / 0.1;
  return (u, v) => [(u + 0.5 - o[0]) / f, (v + 0.5 - o[1]) / f, 1];
}

/// What a ray from the origin meets of the part n . x <= d of a ball: 'none', 'round' or 'flat'.
function meets(ray, center, r, n, d) {
  const a = dot(ray, ray), b = dot(ray, center), c = dot(center, center) - r * r;
  if (b * b < a * c) return 'none';
  const root = Math.sqrt(b * b - a * c);
  const front = (b - root) / a, back = (b + root) / a;
  if (dot(n, minus(times(ray, front), center)) <= d) return 'round';
  const t = (d + dot(n, center)) / dot(n, ray); // where the ray goes through the plane
  return t > front && t <= back ? 'flat' : 'none';
}

/// Compares every third pixel with the truth, but those near a border of it.
function compare(picture, ray, truth, state) {
  const counts = { none: 0, round: 0, flat: 0 };
  const flats = [];
  for (let y = 3; y < picture.height - 3; y += 3) {
    for (let x = 3; x < picture.width - 3; x += 3) {
      const kind = truth(ray(x, y));
      const isBorder = [[-2, 0], [2, 0], [0, -2], [0, 2], [-1, -1], [1, 1]]
        .some(([dx, dy]) => truth(ray(x + dx, y + dy)) !== kind);
      if (isBorder) continue;
      const seen = picture.at(x, y);
      ++counts[kind];
      if (kind === 'flat') flats.push(seen);
      const isRight = kind === 'none' ? isJust(seen, ground)
        : kind === 'flat' ? isPale(seen, state) : isLit(seen, state);
      assert.ok(isRight, `at (${x}, ${y}) should be ${kind}, is ${seen}`);
    }
  }
  return { counts, flats };
}

const cuts = [
  // n and d in W, towards the eye or aside; what there must be of it.
  { name: 'through the middle, seen from above', n: [0, -0.6, -0.8], d: 0 },
  { name: 'above the middle', n: [0.48, -0.6, -0.64], d: 0.02 },
  { name: 'below the middle', n: [-0.8, 0, -0.6], d: -0.025 },
  { name: 'along the view', n: [0, -1, 0], d: 0.01 },
  { name: 'the flat side away', n: [0.6, 0, 0.8], d: -0.01, noFlat: true },
];

pageTest('a sphere is cut exactly by its plane', async (t) => {
  const served = await Served.start(oneSphere);
  const page = await openPage(served.url, { bare: true });
  const center = [0.02, -0.01, 0.4];
  // The tool is turned, so that planes of the wrong frame are found out: by 90 degrees about z,
  // x of T is y of W and y of T is -x of W.
  const quaternion = [0, 0, Math.SQRT1_2, Math.SQRT1_2];
  for (const { name, n, d, noFlat } of cuts) {
    const n_T = [n[1], -n[0], n[2]];
    await served.apply({ contact: { position: center, quaternion, states: [1], planes: [[...n_T, d]] } });
    await options(page, bare);
    await drawn(page, 3);
    const ray = await rays(page);
    const { counts, flats } = compare(
      await look(page), ray, (direction) => meets(direction, center, radius, n, d), color('boundary'));
    t.diagnostic(`${name}: ${JSON.stringify(counts)}`);
    assert.ok(counts.none > 1000 && counts.round + counts.flat > 300, name);
    assert.ok(noFlat ? counts.flat === 0 : counts.flat > 100 || n[2] === 0, name);
    // A flat side is lit alike everywhere.
    for (let i = 0; i < 3; ++i) {
      const channel = flats.map((c) => c[i]);
      assert.ok(flats.length === 0 || Math.max(...channel) - Math.min(...channel) <= 3, `${name}: not flat`);
    }
  }
});

pageTest('what is cut away is a veil where the outside is wanted', async () => {
  const served = await Served.start(oneSphere);
  const page = await openPage(served.url, { bare: true });
  const center = [0, 0, 0.4];
  await served.apply({ contact: { position: center, states: [1], planes: [[0, -1, 0, 0]] } });
  await options(page, { ...bare, outside: true });
  await drawn(page, 3);
  const ray = await rays(page);
  const picture = await look(page);
  const isVeil = (c) => isLit(c, color('outside'));
  let veil = 0, through = 0;
  for (let y = 3; y < picture.height - 3; ++y) {
    for (let x = 3; x < picture.width - 3; ++x) {
      const direction = ray(x, y);
      // How near the ray comes to the center, in radii.
      const t = dot(direction, center) / dot(direction, direction);
      const near = Math.hypot(...minus(times(direction, t), center)) / radius;
      const seen = picture.at(x, y);
      if (near > 1.03) assert.ok(isJust(seen, ground), `(${x}, ${y}) ${seen}`);
      if (near > 0.97 || Math.abs(direction[1]) < 0.01) continue;
      if (direction[1] > 0) assert.ok(!isVeil(seen), `(${x}, ${y}) ${seen}`); // is kept
      else if (isVeil(seen)) ++veil;
      else if (isJust(seen, ground)) ++through;
    }
  }
  assert.ok(veil > 500 && through > veil, `one sees through it: ${veil} pixels of ${veil + through}`);
});

pageTest('inside is blue, boundary purple, outside red', async () => {
  const served = await Served.start(threeSpheres);
  const page = await openPage(served.url, { bare: true });
  const centers = threeSpheres.spheres.map(([x, y]) => [x, y, 0.4]);
  const contact = { position: [0, 0, 0.4], states: [0, 1, 2], planes: [uncut, uncut, uncut] };
  await served.apply({ contact });
  const hues = ['outside', 'boundary', 'inside'].map(color);
  const [red, purple, blue] = hues;
  assert.ok(red[0] > 1.5 * red[1] && red[0] > 1.5 * red[2], 'red');
  assert.ok(purple[0] > 1.3 * purple[1] && purple[2] > 1.3 * purple[1], 'purple');
  assert.ok(blue[2] > 1.5 * blue[0] && blue[2] > 1.5 * blue[1], 'blue');

  await options(page, { ...bare, toolLook: 'spheres', outside: true });
  await drawn(page, 3);
  let picture = await look(page);
  for (const [i, [x, y]] of (await project(page, centers)).entries()) {
    assert.ok(isLit(picture.at(x, y), hues[i]), `${i}: ${picture.at(x, y)}`);
  }
  // The states follow the contact: the other way round.
  await served.apply({ contact: { ...contact, states: [2, 1, 0] } });
  await drawn(page, 3);
  picture = await look(page);
  for (const [i, [x, y]] of (await project(page, centers)).entries()) {
    assert.ok(isLit(picture.at(x, y), hues[2 - i]), `turned round, ${i}: ${picture.at(x, y)}`);
  }
  // Without what is outside there is nothing at its place.
  await options(page, { outside: false });
  await drawn(page, 3);
  picture = await look(page);
  const [, , outside] = await project(page, centers);
  assert.ok(isJust(picture.at(...outside), ground));
});

pageTest('the cloud lies where the depth image says', async () => {
  const served = await Served.start(oneSphere);
  const page = await openPage(served.url, { bare: true });
  await drawn(page, 3); // a camera that begins with empty images
  // From the left: a near wall, a hole, a far wall.
  await served.apply({ depth: [[0, 0.5], [70, 0], [90, 0.9]] });
  await options(page, { ...bare, cloud: true, cloudColor: 'depth', toolLook: 'hidden', pointSize: 4, stride: 1 });
  await drawn(page, 3);
  const { focal, width, height } = oneSphere.stream;
  const point = (u, v, z) => [(u - (width - 1) / 2) / focal * z, (v - (height - 1) / 2) / focal * z, z];
  const wall = (u, z) => Array.from({ length: 10 }, (_, i) => point(u, 15 + 10 * i, z));
  const seen = async (picture, points) =>
    (await project(page, points)).map(([x, y]) => picture.at(x, y));

  let picture = await look(page);
  const near = await seen(picture, wall(30, 0.5)), far = await seen(picture, wall(130, 0.9));
  const hole = await seen(picture, wall(80, 0.7));
  for (const c of near) assert.ok(isJust(c, near[0]) && !isJust(c, ground), `near ${c}`);
  for (const c of far) assert.ok(isJust(c, far[0]) && !isJust(c, ground), `far ${c}`);
  for (const c of hole) assert.ok(isJust(c, ground), `hole ${c}`);
  assert.ok(!isJust(near[0], far[0]), 'depth is seen as color');

  // From above the walls are two lines; nothing is between or behind them.
  // Also when the camera has changed its unit.
  await options(page, { view: 'bird' });
  for (const unit of [0.001, 0.0002]) {
    await served.apply({ unit });
    await drawn(page, 3);
    picture = await look(page);
    const lines = await seen(picture, [point(20, 60, 0.5), point(40, 60, 0.5), point(110, 60, 0.9), point(140, 60, 0.9)]);
    for (const c of lines) assert.ok(!isJust(c, ground), `line ${c}`);
    const empty = await seen(picture, [point(30, 60, 0.63), point(30, 60, 0.81), point(130, 60, 0.72), point(130, 60, 0.935)]);
    for (const c of empty) assert.ok(isJust(c, ground), `empty ${c}`);
  }
});

pageTest('the camera view is the pinhole camera, the bird sees from above', async () => {
  const served = await Served.start(oneSphere);
  await served.apply({ depth: [[0, 0.5], [80, 0.8]] });
  const page = await openPage(served.url, { bare: true });
  await options(page, bare);
  await drawn(page, 3);
  await rays(page);
  const [a, b] = await project(page, [[0.1, 0.05, 0.5], [0.2, 0.1, 1]]);
  assert.ok(Math.hypot(a[0] - b[0], a[1] - b[1]) < 0.01, 'points of one ray are at one pixel');

  await options(page, { view: 'bird' });
  await drawn(page, 3);
  const [middle, right, far, low] =
    await project(page, [[0, 0, 0.6], [0.1, 0, 0.6], [0, 0, 0.7], [0, 0.05, 0.6]]);
  assert.ok(right[0] > middle[0] + 10 && Math.abs(right[1] - middle[1]) < 2, 'x goes right');
  assert.ok(far[1] < middle[1] - 10 && Math.abs(far[0] - middle[0]) < 2, 'what is farther is higher up');
  assert.ok(Math.hypot(low[0] - middle[0], low[1] - middle[1]) < 10, 'one looks along y');
  await page.setViewportSize({ width: 400, height: 500 });
  await drawn(page, 3);
  const [origin, along_x, along_z] = await project(page, [[0, 0, 0.6], [0.1, 0, 0.6], [0, 0, 0.7]]);
  assert.ok(Math.abs((along_x[0] - origin[0]) / (origin[1] - along_z[1]) - 1) < 0.02, 'as long in both directions');
});
